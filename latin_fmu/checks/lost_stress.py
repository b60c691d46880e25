"""Stiffness of the stress of t = 0 at the end of a run: where it was marched with and is gone, and where parts that
stand on contacts have rocked so far that it would have counted.

A part with its mass centre a height h above a face of width D, pressed by a force F, that rocks by an angle theta, is
righted by the moment F D/2 - F h theta: without stiffness of its stress by F D/2 alone.
"""

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
_STANDS: Final = 0.5  # of the force at the start: a part stands on its contact and does not fly
_TOPPLING: Final = 0.04
"""Share of the righting moment below which stress is left out unsaid: half of it is its share of the energy."""
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


def rocking(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory]) -> Iterator[str]:
    """Sentences on parts that have rocked on their contacts without the stiffness of their stress, though it takes off
    more than ``_TOPPLING`` of the moment that rights them."""
    start, assembly = problem.start, problem.assembly
    if problem.prestress is not None or start is None or assembly.quasi_static:
        return
    centres = {name: info.nodes.mean(axis=0) for name, info in problem.info.items()}
    for unit in assembly.interfaces:
        history = histories.get(unit.name)
        if history is None or history.gap is None or unit.name not in start.traction:
            continue
        force = -float(unit.geometry.areas @ start.traction[unit.name][:, 0])
        if force <= 0.0:
            continue
        stands = history.normal_resultant() > _STANDS * force
        angle, width = _tilt(history, stands)
        for side in unit.sides:
            name = side.partition(".")[0]
            if name not in centres or width == 0.0:
                continue
            height = abs(float((centres[name] - history.points.mean(axis=0)) @ history.normals.mean(axis=0)))
            share = 2.0 * height * angle / width
            if share > _TOPPLING:
                yield (
                    f"substructure {name} has rocked on {unit.name} by {np.degrees(angle):.2g} degrees: its weight "
                    f"rights it by {100 * share:.2g} % less than in this run, which leaves out the stiffness of its "
                    'stress; set effects.prestress = "on"'
                )


def _tilt(history: InterfaceHistory, stands: np.ndarray) -> tuple[float, float]:
    """Largest angle between the sides of an interface at some instants (n_time,), rad, and its width across the edge
    on which they tilt then, m."""
    gap = history.gap
    if gap is None or not stands.any() or len(history.points) < 3:
        return 0.0, 0.0
    arms = history.points - history.points.mean(axis=0)
    # the plane closest to the gaps: its slopes along the face
    slopes = gap[stands] @ np.linalg.pinv(arms, rcond=1e-6).T
    angles = np.linalg.norm(slopes, axis=1)
    worst = int(np.argmax(angles))
    if angles[worst] == 0.0:
        return 0.0, 0.0
    return float(angles[worst]), float(np.ptp(arms @ (slopes[worst] / angles[worst])))


def _longest(holds: np.ndarray, time: Array) -> float:
    """Longest time, s, during which a condition (n_time,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    ends = np.minimum(edges[1::2], len(time) - 1)
    return float((time[ends] - time[edges[::2]]).max(initial=0.0))
