"""Figure of the benchmark: price of contact against surfaces and against friction."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from example_tools import BLUE, GREEN, ORANGE, PURPLE, VERMILION, tidy
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator

Row = Mapping[str, Any]
COLOURS = {
    "direct": BLUE,
    "direct_batched": GREEN,
    "explicit": ORANGE,
    "explicit_batched": PURPLE,
    "reduced": VERMILION,
    "reduced_batched": "#7F3C00",
}
LABELS = {
    "direct": "direct, every block its own factor",
    "direct_batched": "direct, identical blocks share one",
    "explicit": "explicit",
    "explicit_batched": "explicit, identical blocks together",
    "reduced": "reduced, set-up apart",
    "reduced_batched": "reduced, identical blocks together, set-up apart",
}
_APART = 1.25  # of two labels
LINES = ("-", "--", ":")
MARKERS = ("o", "s", "^")


def figure(rows: Sequence[Row]) -> Figure:
    """Ratio to the linear transient: P3 against the number of blocks, P2 against friction, P1 for each mesh."""
    drawing = Figure(figsize=(12.5, 5.6), layout="constrained")
    drawing.suptitle("CPU time of contact in units of the linear transient of the same mesh", fontweight="bold")
    towers, crushing, bars = drawing.subplots(1, 3, width_ratios=(1.3, 1.3, 0.9), sharey=True)
    curves(towers, [r for r in rows if r["case"].startswith("P3")], "n_blocks")
    towers.set(xscale="log", xlabel="blocks", ylabel="ratio to the linear transient")
    towers.set_title("P3: contact surfaces", loc="left")
    ticks(towers, {r["n_blocks"] for r in rows if r["case"].startswith("P3")})
    curves(crushing, [r for r in rows if r["case"].startswith("P2")], "mu")
    crushing.set_xscale("symlog", linthresh=0.05)
    crushing.set_xlabel("friction coefficient")
    crushing.set_title("P2: friction", loc="left")
    ticks(crushing, {r["mu"] for r in rows if r["case"].startswith("P2")})
    slender(bars, [r for r in rows if r["case"].startswith("P1")])
    for axis in (towers, crushing, bars):
        axis.set_yscale("log")
        axis.axhline(1.0, color="0.4", linewidth=0.8, linestyle=(0, (5, 2)))
        axis.yaxis.set_major_locator(FixedLocator([0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 5.0, 10.0]))
        axis.yaxis.set_minor_locator(NullLocator())
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(axis="y", color="0.92", linewidth=0.6)
        tidy(axis)
    found = {r["propagator"] for r in rows}
    kinds = [Line2D([], [], color=c, marker="o", label=LABELS[k]) for k, c in COLOURS.items() if k in found]
    drawing.legend(handles=kinds, loc="outside lower center", ncols=3, frameon=False)
    return drawing


def ticks(axis: Axes, values: Collection[float]) -> None:
    """These ticks and no others."""
    places = sorted(values)
    axis.set_xticks(places, [f"{v:g}" for v in places])
    axis.minorticks_off()


def curves(axis: Axes, rows: Sequence[Row], over: str) -> None:
    """One curve for each mesh (by line and marker) and propagator (by colour)."""
    cases = sorted({r["case"] for r in rows}, key=lambda c: int(c.split("=")[1]))
    for kind, colour in COLOURS.items():
        for case, line, marker in zip(cases, LINES, MARKERS, strict=False):
            found = sorted((r[over], r["ratio"]) for r in rows if (r["case"], r["propagator"]) == (case, kind))
            if found:
                axis.plot(*zip(*found, strict=True), line, marker=marker, color=colour)
    meshes = [
        Line2D([], [], color="0.3", linestyle=line, marker=marker, label=case.split()[1])
        for case, line, marker in zip(cases, LINES, MARKERS, strict=False)
    ]
    axis.legend(handles=meshes, fontsize="small", frameon=False, loc="upper right", bbox_to_anchor=(1.0, 1.12), ncols=3)


def slender(axis: Axes, rows: Sequence[Row]) -> None:
    """P1: one point for each mesh and propagator."""
    meshes = list(dict.fromkeys(r["case"].split()[1] for r in rows))
    for place, mesh in enumerate(meshes):
        above = 0.0
        for row in sorted((r for r in rows if r["case"].split()[1] == mesh), key=lambda r: r["ratio"]):
            ratio = row["ratio"]
            axis.plot([place], [ratio], "o", color=COLOURS[row["propagator"]], markersize=8)
            above = max(ratio, _APART * above)  # labels of points that lie together: one above the other
            axis.annotate(f"  {ratio:.2f}", (place, above), va="center")
    axis.set_xticks(range(len(meshes)), meshes)
    axis.set(xlabel="elements in a bar", xlim=(-0.5, max(len(meshes), 1) - 0.3))
    axis.set_title("P1: slender bars", loc="left")
