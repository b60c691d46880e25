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
_SPUN: Final = 0.05
"""Share of its largest spin that stress may give a part whose contact is lost."""
_COUNTS: Final = 0.1  # of the largest force of the start: contacts with less press nothing that counts


def lost_stress(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], time: Array) -> Iterator[str]:
    """Sentences on contacts that have less than a tenth of the force of t = 0 for so long that the stress, which keeps
    its stiffness, changes the motion: for longer than a period of the vibration that it changes most, or while the part
    turns, which it drives on as if it still stood. ``time`` : (n_time,) of the histories, s."""
    prestress = problem.prestress
    if prestress is None:
        return
    forces = {}
    for unit in problem.assembly.interfaces:
        if unit.behaviour.opens and unit.name in prestress.pressure and unit.name in histories:
            forces[unit.name] = float(unit.geometry.areas @ prestress.pressure[unit.name])
    largest = max(forces.values(), default=0.0)
    for name, force in forces.items():
        if force <= _COUNTS * largest:
            continue
        history = histories[name]
        lost = history.normal_resultant()[: len(time)] < _LOST * force
        longest, seconds = _longest(lost, time), problem.unit_system["s"]
        drives = max((prestress.drives.get(side.partition(".")[0], 0.0) for side in history.sides), default=0.0)
        spun = _spun(history, lost, time, drives)
        if longest > prestress.period:
            why = "the stress that it causes keeps its stiffness"
        elif spun > _SPUN:
            why = f"the stress that it causes, which keeps its stiffness, changes its spin by {100 * spun:.2g} %"
        else:
            continue
        yield (
            f"interface {name} carries less than {100 * _LOST:g} % of its force of t = 0 for "
            f"{readable(longest, seconds, 3)}, and {why}: end the run before, or set "
            'effects.prestress = "off" if the slender parts do not count after that'
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


def _slopes(history: InterfaceHistory) -> Array:
    """Rotations (n_time, 3) between the sides of an interface as slopes of their gap, zero where it is not known."""
    if history.gap is None or len(history.points) < 3:
        return np.zeros((len(history.traction), 3))
    arms = history.points - history.points.mean(axis=0)
    # the plane closest to the gaps
    return np.asarray(history.gap @ np.linalg.pinv(arms, rcond=1e-6).T)


def _spun(history: InterfaceHistory, lost: np.ndarray, time: Array, drives: float) -> float:
    """Spin that the stiffness of stress has given a part while its contact was lost, over its largest spin; ``drives``
    : of it, s-2."""
    turned = _slopes(history)[: len(time)]
    spin = float(np.linalg.norm(np.diff(turned, axis=0), axis=1).max(initial=0.0) / np.diff(time).min(initial=np.inf))
    gained = drives * float(np.trapezoid(np.where(lost, np.linalg.norm(turned, axis=1), 0.0), time))
    if gained == 0.0:
        return 0.0
    return gained / max(spin, np.finfo(float).tiny)


def _tilt(history: InterfaceHistory, stands: np.ndarray) -> tuple[float, float]:
    """Largest angle between the sides of an interface at some instants (n_time,), rad, and its width across the edge
    on which they tilt then, m."""
    slopes = _slopes(history)[stands]
    if not len(slopes):
        return 0.0, 0.0
    angles = np.linalg.norm(slopes, axis=1)
    worst = int(np.argmax(angles))
    if angles[worst] == 0.0:
        return 0.0, 0.0
    arms = history.points - history.points.mean(axis=0)
    return float(angles[worst]), float(np.ptp(arms @ (slopes[worst] / angles[worst])))


def _longest(holds: np.ndarray, time: Array) -> float:
    """Longest time, s, during which a condition (n_time,) holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    ends = np.minimum(edges[1::2], len(time) - 1)
    return float((time[ends] - time[edges[::2]]).max(initial=0.0))
