"""Figure of the benchmark: price of contact against surfaces and against friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from example_tools import BLUE, GREEN, ORANGE, PURPLE, VERMILION, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Row = Mapping[str, Any]
COLOURS = {
    "direct": BLUE, "direct_batched": GREEN, "explicit": ORANGE, "explicit_batched": PURPLE, "reduced": VERMILION,
    "reduced_batched": "#7F3C00",
}  # fmt: skip
LABELS = {
    "direct": "every block its own factor",
    "direct_batched": "identical blocks share one",
    "explicit": "explicit",
    "explicit_batched": "explicit, identical blocks together",
    "reduced": "reduced, set-up apart",
    "reduced_batched": "reduced, identical together, set-up apart",
}
LINES = ("-", "--", ":")
MARKERS = ("o", "s", "^")


def figure(rows: Sequence[Row]) -> Figure:
    """Ratio to the linear transient: P3 against the number of blocks, P2 against friction, P1 as bars."""
    drawing = Figure(figsize=(12.5, 4.8), layout="constrained")
    drawing.suptitle(
        "CPU time of contact in units of the linear transient of the same mesh", fontweight="bold"
    )
    towers, crushing, bars = drawing.subplots(1, 3, width_ratios=(1.3, 1.3, 0.9), sharey=True)
    curves(towers, [r for r in rows if r["case"].startswith("P3")], "n_blocks")
    towers.set(
        xscale="log", xlabel="blocks", title="P3: contact surfaces", ylabel="ratio to the linear transient"
    )
    counts = sorted({r["n_blocks"] for r in rows if r["case"].startswith("P3")})
    towers.set_xticks(counts, [str(c) for c in counts], minor=False)
    towers.minorticks_off()
    curves(crushing, [r for r in rows if r["case"].startswith("P2")], "mu")
    crushing.set(xscale="symlog", xlabel="friction coefficient", title="P2: friction")
    crushing.set_xscale("symlog", linthresh=0.05)
    ticks = sorted({r["mu"] for r in rows if r["case"].startswith("P2")})
    crushing.set_xticks(ticks, [f"{t:g}" for t in ticks])
    crushing.minorticks_off()
    slender(bars, [r for r in rows if r["case"].startswith("P1")])
    for axis in (towers, crushing, bars):
        axis.axhline(1.0, color="0.4", linewidth=0.8, linestyle=(0, (5, 2)))
        axis.set_ylim(bottom=0.0)
        tidy(axis)
    return drawing


def curves(axis: Axes, rows: Sequence[Row], over: str) -> None:
    """One curve for each mesh and propagator."""
    cases = sorted({r["case"] for r in rows}, key=lambda c: int(c.split("=")[1]))
    for kind, colour in COLOURS.items():
        for case, line, marker in zip(cases, LINES, MARKERS, strict=False):
            found = sorted(
                (r[over], r["ratio"]) for r in rows if (r["case"], r["propagator"]) == (case, kind)
            )
            if found:
                label = f"{LABELS[kind]}, {case.split()[1]}"
                axis.plot(*zip(*found, strict=True), line, marker=marker, color=colour, label=label)
    if rows:
        axis.legend(fontsize="small", frameon=False)


def slender(axis: Axes, rows: Sequence[Row]) -> None:
    """P1: one bar for each mesh and propagator."""
    names = []
    for place, row in enumerate(rows):
        axis.bar(place, row["ratio"], color=COLOURS.get(row["propagator"], PURPLE), width=0.6)
        axis.annotate(f"{row['ratio']:.2f}", (place, row["ratio"]), ha="center", va="bottom")
        names.append(
            row["case"].split()[1] + ("" if row["propagator"] == "direct" else f"\n{row['propagator']}")
        )
    axis.set_xticks(range(len(names)), names)
    axis.set(title="P1: slender bars", xlabel="elements in a bar")
