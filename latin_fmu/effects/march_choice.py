"""Whether bonded bodies are one substructure of a march or bonds are iterated: what is cheaper by its predicted cost.

A group takes one factor of all its bodies, where alike bodies share one of their own; bodies at rest are not passed
over, and the tables of its interfaces couple all of them. A prediction follows from sizes alone: names, order and
processes do not change the choice.
"""

from __future__ import annotations

from dataclasses import replace

from ..assembly.bond_groups import GroupedAssembly
from ..assembly.bonded_run import grouped_assembly
from ..assembly.problem import DiscretisedProblem
from .cost import Prediction, march_counts, operator_counts, seconds


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
    together = Prediction(discretised, iterated.preparation, grouped)
    # without the static start, which both have
    costs = [
        seconds(operator_counts(run) + march_counts(replace(run, increments=0))) for run in (together.run, iterated.run)
    ]
    if costs[0] > costs[1]:
        return None, iterated, f"bonded bodies as one take {costs[0] / costs[1]:.2g} times its time, as predicted"
    return grouped, together, ""
