"""How quantities of a run change with parameters of its scene: bars of relative changes, the longest first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError
from ..results.sensitivities import PART, in_words
from .style import BAD, DISTINCT, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH, _ROW, _COLUMNS = 4.2, 0.24, 2  # inches
_LEAST: Final = 1e-4  # relative change below which a quantity has no panel


@styled
def tornado_figure(tree: xr.DataTree) -> Figure:
    """A panel a quantity with a bar a parameter: change in % for parameters larger by PART; flagged ones are hatched.

    Raises
    ------
    ResultsError : the results have no derivatives.
    """
    from matplotlib.figure import Figure

    if "sensitivities" not in tree.children:
        remedy = "name parameters in output.sensitivities and run the scene"
        raise ResultsError([Problem("--tornado", "the results have no derivatives by parameters", remedy=remedy)])
    data = tree["sensitivities"].to_dataset()
    value = np.abs(np.asarray(data["value"].values, dtype=float))
    changes = PART * np.asarray(data["change"].values, dtype=float) / np.where(value > 0.0, value, np.inf)[:, None]
    flagged, names = np.asarray(data["flagged"].values) == 1, [in_words(str(p)) for p in data["parameter"].values]
    shown = np.flatnonzero(np.abs(changes).max(axis=1, initial=0.0) > _LEAST)
    rows = -(-max(len(shown), 1) // _COLUMNS)
    height = rows * (_ROW * len(names) + 0.6) + 0.6
    figure = Figure(figsize=(_WIDTH * _COLUMNS, height), layout="constrained")
    figure.suptitle(f"{tree.attrs.get('scene_name', 'run')}: change in % for {100 * PART:g} % more", fontweight="bold")
    for place, q in enumerate(shown):
        axis = figure.add_subplot(rows, _COLUMNS, place + 1)
        order = np.argsort(np.abs(changes[q]))
        bars = axis.barh([names[i] for i in order], 100 * changes[q, order], color=DISTINCT[0])
        for bar, i in zip(bars, order, strict=True):
            if flagged[q, i]:
                bar.set(facecolor="white", edgecolor=BAD, hatch="////")
        axis.axvline(0.0, color="0.4", linewidth=0.8)
        owner, _, key = str(data["quantity"].values[q]).rpartition(".")
        axis.set_title(f"{owner} {key.replace('_', ' ')}")
    if flagged[shown].any():
        figure.supxlabel("hatched: contact points change their state on the way", fontsize="medium", color=BAD)
    return figure
