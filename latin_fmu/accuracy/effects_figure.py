"""Figure of measured effects: what each costs, and how much the results change without it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ..effects.explanation import WORTH
from ..pictures.style import BAD, DISTINCT, styled
from .measured_effects import GROUPS, SMALL, MeasuredEffects

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEAST: Final = 0.01  # per cent, at which the axis of changes begins
_ROW: Final = 0.5  # inches


@styled
def effects_figure(measured: MeasuredEffects, title: str) -> Figure:
    """Two bars an effect, the costliest on top: CPU time that a run takes less without it, and changes of forces,
    motions and accelerations; a star marks what may go.

    Raises
    ------
    ValueError : no effect was measured.
    """
    from matplotlib.figure import Figure

    rows = sorted((e for e in measured.effects if e.times and e.changes), key=lambda e: -e.cpu)
    if not rows:
        raise ValueError("no effect was measured")
    figure = Figure(figsize=(11.0, _ROW * len(rows) + 1.7), layout="constrained")
    price, influence = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(rows))
    saved = [100.0 * (1.0 - e.cpu / measured.plain.cpu) for e in rows]
    price.barh(places, saved, color=[DISTINCT[2] if s > 0.0 else "0.7" for s in saved], height=0.6)
    for place, share in zip(places, saved, strict=True):
        price.text(max(share, 0.0) + 1.0, place, f"{share:+.0f} %", va="center", fontsize=8)
    price.set_yticks(places, [("* " if e in measured.suggested else "") + e.effect for e in rows])
    price.axvline(0.0, color="black", linewidth=0.8)
    # a run that takes several times as long without an effect says no more than one that takes twice as long
    price.set_xlim(max(min(*saved, 0.0) * 1.1, -100.0), max(*saved, 20.0) * 1.25)
    price.set_xlabel("CPU time saved without it (%)")
    price.set_title(f"price ({measured.plain.cpu:.2g} s a run)")
    _influence(influence, [e.changes for e in rows])
    figure.suptitle(f"{title}: effects, {measured.description.partition(' (')[0]}", fontsize=10)
    return figure


def _influence(axes: Axes, changes: list[dict[str, float]]) -> None:
    places = np.arange(len(changes))
    groups = [group for group in GROUPS if any(group in row for row in changes)]
    height = 0.75 / len(groups)
    for i, group in enumerate(groups):
        sizes = [100.0 * row.get(group, 0.0) for row in changes]
        # of a group, from the top of the row down
        offset = (0.5 * (len(groups) - 1) - i) * height
        axes.barh(places + offset, np.maximum(sizes, _LEAST), height, left=0.0, color=DISTINCT[i], label=group)
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, max(200.0, *(150.0 * max(row.values()) for row in changes)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.axvline(100.0 * SMALL, color=BAD, linestyle="--", linewidth=1.0)
    axes.set_xlabel(f"change of the results without it (%); dashed: {100 * SMALL:g} %")
    axes.set_title(f"influence (* saves {100 * WORTH:.0f} % or more, changes {100 * SMALL:g} % or less)")
    axes.legend(fontsize=8, loc="lower right")
