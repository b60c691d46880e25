"""A static problem solved to the end of its increments: over the whole assembly at once, or body by body.

Over the whole assembly (``static_run``) bonds are not iterated, and where the relative motions of its contacts are dofs
an iteration is a product with one dense matrix, which problems of one set-up share: this comes first. Bodies are solved
one by one where there are more contacts; where bolts are tightened in many orders, each of which changes the stiffness
of its own bolts, and so of the whole; where derivatives need what was solved of each body; and where the assembly has
no such form. What finds no equilibrium in one way is tried in the other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ..assembly.initial_state import InitialState
from ..assembly.models import Kept
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem
from ..errors import SolverError
from ..joined.static_assembly import StaticAssembly, few_contacts
from ..joined.tied_assembly import TieError
from ..latin.outcome import Timings
from ..latin.settings import SolverSettings
from ..latin.windows import Run
from ..propagator import StaticPropagator

if TYPE_CHECKING:
    from .static_run import StaticMarch

_UNSEEN: Final = 1e-7  # share of the largest force: residual forces below it excite vibrations too small to be measured
_ORDERS: Final = 2  # of bolts, up to which an assembly is factorised anew for each
TIGHT: Final = 1e-11, 1e-9
"""Tolerances of the static solution; twice what was reached where round-off prevents both."""


@dataclass(frozen=True)
class Equilibrium:
    """A solved static problem.

    Attributes
    ----------
    run : of its increments. tolerance : that it has met. solved : what was run, the whole assembly or its bodies.
    """

    run: Run
    tolerance: float
    solved: StaticMarch | SolverReadyProblem

    @property
    def of_bodies(self) -> SolverReadyProblem:
        """What was run, of a problem whose bodies were solved one by one."""
        assert isinstance(self.solved, SolverReadyProblem)
        return self.solved

    def state(self, amplitudes: Mapping[str, float]) -> InitialState:
        """Displacements, tractions and gaps at the end; ``amplitudes`` of the loads that are set from outside."""
        run, tolerance = self.run, self.tolerance
        if isinstance(self.solved, SolverReadyProblem):
            displacement, traction = _of_bodies(self.solved, run)
        else:
            displacement, traction = self.solved.displacement(), self.solved.tractions(run.f_hat)
        closure, gaps = {}, dict(zip(map(id, run.assembly.layout.groups), run.gaps(), strict=True))
        for i, unit in enumerate(run.assembly.interfaces):
            group = run.assembly.layout.group(i)
            if unit.behaviour.opens and not unit.behaviour.elastic:
                # pressed points are closed: what gap they have is a residual of the iteration
                pressed = traction[unit.name][:, 0] < 0.0
                closure[unit.name] = np.where(pressed, gaps[id(group)][group.members[i]], 0.0)
        windows = run.windows
        message = f"static equilibrium, {len(windows)} increment(s), {sum(w.iterations for w in windows)} iterations"
        remarks: tuple[str, ...] = ()
        if tolerance > _UNSEEN:
            remarks = (
                f"the static start has converged to {tolerance:g} only (target {TIGHT[-1]:g}): "
                "the residual forces excite vibrations; reduce solver.tolerance, or refine the mesh at contacts",
            )
        return InitialState(displacement, traction, closure, dict(amplitudes), message, remarks)


def _of_bodies(problem: SolverReadyProblem, run: Run) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Displacements of the bodies and tractions of the interfaces at the end of a run of single bodies."""
    assembly, displacement = problem.assembly, {}
    for p in assembly.propagators:
        assert isinstance(p, StaticPropagator)
        imposed = p.forcing.imposed_u(p.instant)
        for j, member in enumerate(p.members):
            displacement[member.name] = member.expansion @ p.state.u[:, j] + imposed[:, j]
    traction = {unit.name: run.f_hat[assembly.layout.channels(i, 0)] for i, unit in enumerate(assembly.interfaces)}
    return displacement, traction


def equilibrium(
    discretised: DiscretisedProblem,
    start: InitialState | None,
    settings: SolverSettings,
    operators: Kept,
    bodies: bool = False,
) -> Equilibrium:
    """The static problem solved from an initial state; its run has not converged where no tolerance is reached, that of
    the ``settings`` of the scene neither. ``bodies`` : whether they are solved one by one alone."""

    def one_by_one() -> Equilibrium:
        return _solved(lambda: discretised.build(start, operators), settings)

    if bodies:
        return one_by_one()
    found = None
    orders = {cut.table.order for cut in discretised.cuts.values()}
    related = len(orders) <= _ORDERS and few_contacts(discretised.units)
    if related:
        found = _over_all(discretised, start, settings, operators, related)
        if found is not None and found.run.status()[0]:
            return found
    alone = one_by_one()
    if alone.run.status()[0] or found is not None:
        return alone
    whole = _over_all(discretised, start, settings, operators)
    if whole is not None and whole.run.status()[0]:
        return whole
    return alone


def _over_all(
    discretised: DiscretisedProblem,
    start: InitialState | None,
    settings: SolverSettings,
    operators: Kept,
    related: bool = False,
) -> Equilibrium | None:
    """The static problem solved over the whole assembly; None where it has no such form, or with ``related`` none with
    the relative motions of its contacts as dofs."""
    from .static_run import static_assembly

    try:
        assembly = static_assembly(discretised, operators)
        if related and assembly.model.swept:
            return None
        return _whole(assembly, discretised, start, settings, operators)
    except (TieError, SolverError):
        return None


def equilibrium_at_once(
    discretised: DiscretisedProblem, start: InitialState | None, settings: SolverSettings, operators: Kept
) -> Equilibrium:
    """The same over the whole assembly.

    Raises
    ------
    TieError : bonds that cannot be eliminated. SolverError : an assembly that nothing holds, or that has buckled.
    """
    from .static_run import static_assembly

    return _whole(static_assembly(discretised, operators), discretised, start, settings, operators)


def _whole(
    assembly: StaticAssembly,
    discretised: DiscretisedProblem,
    start: InitialState | None,
    settings: SolverSettings,
    operators: Kept,
) -> Equilibrium:
    from .static_run import static_march

    return _solved(lambda: static_march(discretised, start, assembly, operators), settings)


def _solved(make: Callable[[], StaticMarch | SolverReadyProblem], limits: SolverSettings) -> Equilibrium:
    """A problem solved to the smallest of the tolerances that it meets, made anew for each."""
    tolerance = force = TIGHT[0]
    while True:
        problem = make()
        recorder = problem.recorder()
        settings = replace(problem.settings, tolerance=tolerance, force_tolerance=force)
        run = Run(problem.assembly, settings, recorder, Timings())
        run.all()
        if run.status()[0] or tolerance == limits.tolerance:
            break
        # Soft supports of stiff bodies leave round-off above the tight tolerances.
        reached = 2.0 * max((max(w.final_error, w.final_mismatch) for w in run.windows), default=np.inf)
        # what round-off left allows, doubled: the next run must be able to meet it
        next_one = max(TIGHT[1], reached)
        if tolerance == TIGHT[0] and next_one < limits.tolerance:
            tolerance = force = next_one
        else:
            tolerance, force = limits.tolerance, limits.force_tolerance
    return Equilibrium(run, tolerance, problem)
