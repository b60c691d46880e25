"""Whether the end of a run can be trusted, though its instants have converged.

Three measures that no test of an instant contains, each with the number, the place and a remedy:

    sinking    a point that never opened and has sunk (``InterfaceHistory.sunk``) by more than 1 % of the shortening
               of the bolt around whose shank it is, else of the elastic approach p (L/E + L'/E') of both bodies,
               p the largest mean pressure of the interface and L/E as in ``body.side_stiffness``; bodies without
               elasticity have none
    energy     the sum of the account of energies (``kernels.energy``) beyond 1 % of its largest term
    rotation   a body that has turned by more than 10 degrees: strains and normals are those of small rotations

The account of energies sums up to round-off; where it does not, the numbers of the run are beyond the precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..latin.outcome import InterfaceHistory
from ..latin.status import Account
from ..results.summary import percent
from .problem import SolverReadyProblem
from .run_checks import LARGEST_TURN, rotations

SUNK, OPEN = 0.01, 0.01
"""Share of the shortening of a bolt or of the elastic approach, and of the largest energy, likewise."""
_PRECISION = 1e-12  # of sizes and displacements: round-off of a gap


def faults_of(
    problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], account: Account | None
) -> list[str]:
    """Sentences on what makes a run not trustworthy at its end; none where it is.

    ``account`` : the energies at the end, None where they are not accounted for.
    """
    return [*_sunk(problem, histories), *_open(account, problem.unit_system["J"]), *_turned(problem)]


def with_faults(sentence: str, faults: Sequence[str]) -> str:
    """The status of a run with what makes it not trustworthy."""
    return f"not trustworthy: {'; '.join(faults)} ({sentence})" if faults else sentence


def _sunk(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory]) -> Iterator[str]:
    """Interfaces whose points have sunk into each other while they were closed."""
    length, clamps = problem.unit_system["m"], problem.clamps
    for name, history in histories.items():
        sunk = history.sunk()
        if not sunk.any():
            continue
        approach = problem.flexibility[name] * _mean_pressure(history)
        allowed, whose = np.full(len(sunk), SUNK * approach), np.full(len(sunk), -1)
        for number, clamp in enumerate(clamps):
            held = clamp.holds(history.points) & (SUNK * clamp.shortening > 0.0)
            allowed[held], whose[held] = SUNK * clamp.shortening, number
        deep = (allowed > 0.0) & ~(sunk <= allowed + _PRECISION * _size(problem, history))
        if not deep.any():
            continue
        worst = int(np.argmax(np.where(deep, sunk / np.maximum(allowed, np.finfo(float).tiny), 0.0)))
        of = f"the shortening of bolt {clamps[whose[worst]].bolt}" if whose[worst] >= 0 else "the elastic approach"
        at = ", ".join(f"{x:.4g}" for x in history.points[worst])
        yield (
            f"interface {name}: {int(deep.sum())} of {len(sunk)} points that never opened have sunk, at [{at}] by "
            f"{sunk[worst]:.3g} {length}, {percent(SUNK * sunk[worst] / allowed[worst])} "
            f"of {of} (allowed: {percent(SUNK)}), so that the clamp force is wrong: lower solver.tolerance, as to "
            f"{0.1 * problem.settings.tolerance:g}"
        )


def _mean_pressure(history: InterfaceHistory) -> float:
    """Largest pressure over time, mean over the points that touch, Pa."""
    pressed = history.pressure() > 0.0
    force, area = np.maximum(history.pressure(), 0.0) @ history.areas, pressed @ history.areas
    return float(np.divide(force, area, out=np.zeros_like(force), where=area > 0.0).max(initial=0.0))


def _size(problem: SolverReadyProblem, history: InterfaceHistory) -> float:
    """Size of coordinates and displacements at an interface, m."""
    sides = {side.split(".")[0] for side in history.sides}
    moved = [
        float(np.abs(p.full_displacement(j)).max())
        for p in problem.assembly.propagators
        for j, name in enumerate(p.names)
        if name in sides
    ]
    return float(np.ptp(history.points, axis=0).max()) + max(moved, default=0.0)


def _open(account: Account | None, joule: str) -> Iterator[str]:
    """The balance of energies, where it does not close."""
    if account is not None and not abs(account.open) <= OPEN * account.largest + account.negligible:
        share = abs(account.open) / account.largest if account.largest > 0.0 else np.inf
        yield (
            f"energy: the account of the bodies is open by {account.open:.3g} {joule} at the end, {percent(share)} of "
            f"its largest term, {account.largest:.3g} {joule} (allowed: {percent(OPEN)}): the numbers are beyond the "
            "precision; take smaller steps, and check the units of times and loads"
        )


def _turned(problem: SolverReadyProblem) -> Iterator[str]:
    """Bodies that have turned too far."""
    far = {name: degrees for name, degrees in rotations(problem).items() if not degrees <= LARGEST_TURN}
    if far:
        worst = max(far, key=lambda name: far[name])
        others = "" if len(far) == 1 else f" (and {len(far) - 1} more bodies by more than {LARGEST_TURN:g})"
        yield (
            f"substructure {worst} has turned by {far[worst]:.3g} degrees at the end{others}, where strains and "
            f"contact normals are those of small rotations (allowed: {LARGEST_TURN:g} degrees): end the run before, by "
            "time.end, or hold what turns"
        )
