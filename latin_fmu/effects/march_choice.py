"""Whether bonded bodies are one substructure of a march or bonds are iterated: what is cheaper by its predicted cost.

A group takes one factor of all its bodies, where alike bodies share one of their own, and its set-up takes as long as
some steps; bodies at rest are not passed over. A prediction follows from sizes alone: names, order and processes do not
change the choice.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from ..assembly.problem import DiscretisedProblem
from ..joined.bond_groups import GroupedAssembly
from ..joined.bonded_run import grouped_assembly
from .cost import BONDED, Prediction, RunSize, march_counts, operator_counts, seconds

_SET_UP: Final = 4e-5
"""Time that the set-up of groups takes per unknown of them, s: bonds eliminated, elimination order, matrices."""


def cheaper_march(
    discretised: DiscretisedProblem, iterated: Prediction, restricted: bool
) -> tuple[GroupedAssembly | None, Prediction, str]:
    """The groups of a march, None where bonds are iterated, its prediction, and why bonds are iterated (empty where the
    scene asks for that, or has none).

    iterated : prediction where they are. restricted : as for ``grouped_assembly``.
    """
    grouped, why = grouped_assembly(discretised, restricted)
    if grouped is None:
        return None, iterated, why
    together, runs = Prediction(discretised, iterated.preparation, grouped), [iterated.run]
    # of large interfaces one solve per instant may be too large
    if iterated.run.at_once:
        runs.append(replace(iterated.run, at_once=False, iterations=iterated.run.effort * BONDED))
    unknowns = sum(group.model.expansion.shape[1] for group in grouped.groups)
    cost, least = _SET_UP * unknowns + _cost(together.run), min(map(_cost, runs))
    if cost > least:
        return None, iterated, f"bonded bodies as one take {cost / least:.2g} times as long, as predicted"
    return grouped, together, ""


def _cost(run: RunSize) -> float:
    """Predicted time of operators and march, s, without the static start, which is the same, and without outputs, which
    are not to change a bit."""
    bare = replace(run, increments=0, fields=False, stress=False, energy=False, every=1)
    return seconds(operator_counts(run) + march_counts(bare))
