"""Contacts that lose the forces whose stress has its stiffness in a run: what they pressed is marched as if they still
did."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from ..assembly.problem import SolverReadyProblem
from ..latin.assembly import Array
from ..latin.outcome import InterfaceHistory
from ..scene.readable_numbers import readable

_LOST: Final = 0.1
"""Share of its force at the start below which a contact has lost it."""
_COUNTS: Final = 0.1  # of the largest force of the start: contacts with less press nothing that counts


def lost_stress(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], time: Array) -> Iterator[str]:
    """Sentences on contacts that have less than a tenth of the force of t = 0 for longer than a period of the motion
    that stress changes most. ``time`` : (n_time,) of the histories, s."""
    prestress, start = problem.prestress, problem.start
    if prestress is None or start is None:
        return
    assembly = problem.assembly
    forces = {}
    for unit in assembly.interfaces:
        if unit.behaviour.opens and unit.name in start.traction and unit.name in histories:
            forces[unit.name] = -float(unit.geometry.areas @ start.traction[unit.name][:, 0])
    largest = max(forces.values(), default=0.0)
    for name, force in forces.items():
        if force <= _COUNTS * largest:
            continue
        pressed = histories[name].normal_resultant()[: len(time)]
        longest = _longest(pressed < _LOST * force, time)
        if longest > prestress.period:
            seconds = problem.unit_system["s"]
            yield (
                f"interface {name} carries less than {100 * _LOST:g} % of its force of t = 0 for "
                f"{readable(longest, seconds, 3)}, and the stress that it causes keeps its stiffness: end the run "
                'before, or set effects.prestress = "off" if the slender parts do not count after that'
            )


def _longest(holds: np.ndarray, time: Array) -> float:
    """Longest time, s, during which a condition (n_time,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    ends = np.minimum(edges[1::2], len(time) - 1)
    return float((time[ends] - time[edges[::2]]).max(initial=0.0))
