"""A static problem solved over the whole assembly at once (``static_assembly``), and what its bodies do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..assembly.body_motions import joined_histories
from ..assembly.initial_state import InitialState, TightBolts
from ..assembly.models import Kept
from ..assembly.problem import DiscretisedProblem, settings_of
from ..joined.bond_forces import BondForces
from ..joined.static_assembly import StaticAssembly
from ..latin.assembly import Array, Assembly, GroundState
from ..latin.probes import OutputRequest
from ..latin.recorder import Recorder
from ..latin.settings import SolverSettings
from ..propagator import StaticPropagator
from ..time_scheme import QuasiStatic


@dataclass(frozen=True)
class StaticMarch:
    """A static problem as one substructure, ready to be solved.

    Attributes
    ----------
    problem : of the bodies. whole : the assembly as one substructure. assembly : of that one alone, with its histories.
    """

    problem: DiscretisedProblem
    whole: StaticAssembly
    assembly: Assembly

    @property
    def settings(self) -> SolverSettings:
        """The rules of the iteration."""
        return settings_of(self.problem.scene)

    @property
    def propagator(self) -> StaticPropagator:
        """Of the one substructure."""
        (one,) = self.assembly.propagators
        assert isinstance(one, StaticPropagator)
        return one

    def recorder(self) -> Recorder:
        """One that keeps the interfaces with relative motions alone."""
        return Recorder(self.assembly, OutputRequest(), {})

    @property
    def _moved(self) -> Array:
        """Displacements (n_full,) of all bodies at the present instant, m."""
        one = self.propagator
        moved: Array = one.members[0].expansion @ one.state.u[:, 0] + one.forcing.imposed_u(one.instant)[:, 0]
        return moved

    def displacement(self) -> dict[str, Array]:
        """Displacements (n_full,) of the bodies at the present instant, m."""
        moved = self._moved
        return {name: moved[where] for name, where in self.whole.where.items()}

    def tractions(self, f_hat: Array) -> dict[str, Array]:
        """Tractions (n_point, n_component) on side E of all interfaces at the present instant, Pa, by name; ``f_hat``
        (n_flat,) of the relative motions."""
        whole = self.whole
        units = self.problem.units
        layout = self.problem.layout
        by_name = {unit.name: f_hat[whole.layout.channels(j, 0)] for j, unit in enumerate(whole.units)}
        if whole.bonded:
            model, on_points = whole.model, f_hat[whole.channels] * whole.model.channel_area
            forces = model.stiffness @ self._moved - self.load(self.propagator.instant) - model.trace.T @ on_points
            for i, traction in self.bonds.tractions(forces[:, None]).items():
                by_name[units[i].name] = traction[0].reshape(layout.channels(i, 0).shape)
        return {unit.name: by_name[unit.name] for unit in units}

    def load(self, instant: int) -> Array:
        """Loads (n_full,) on all bodies at an instant, N."""
        one = self.propagator
        total = np.zeros(self.whole.model.n_full)
        for load, amplitude in zip(one.members[0].loads, one.forcing.amplitudes[0], strict=True):
            total += amplitude[instant] * load.pattern
        return total

    @cached_property
    def bonds(self) -> BondForces:
        """Tractions of the bonds."""
        expansion = sp.csr_array(sp.block_diag([m.expansion for m in self.whole.models], format="csr"))
        return BondForces(self.whole.bonded, self.problem.layout, self.whole.trace, expansion)


def static_assembly(problem: DiscretisedProblem, operators: Kept | None = None) -> StaticAssembly:
    """The assembly of a static problem as one substructure; ``operators`` as for ``StaticAssembly.of``. Raises
    TieError : bonds that cannot be eliminated."""
    return StaticAssembly.of(problem.classes, problem.units, problem.layout, problem.bodies, operators)


def static_march(
    problem: DiscretisedProblem, start: InitialState | None, whole: StaticAssembly, operators: Kept | None = None
) -> StaticMarch:
    """A static problem, with its assembly ``whole``, at t = 0.

    start : initial state in the place of that of the scene. operators : by ``StaticAssembly.key``, used again and
    added to.

    Raises
    ------
    SolverError : bodies that nothing holds.
    """
    cache: list[tuple[float, object]] = []
    if operators is not None:
        cache = operators.setdefault(whole.key, [])
    joined = bool(whole.relative)  # else a matrix without interfaces
    one = StaticPropagator([whole.model], problem.dt, problem.scene.output.energy, whole.springs, cache, joined)
    channels = whole.channels
    assembly = Assembly(
        [one],
        [channels[:, None]],
        whole.units,
        whole.layout,
        _impedance(problem, whole),
        problem.characteristic_traction,
        QuasiStatic(),
    )
    assembly.rest_traction = -1.0
    if start is not None:
        start.hand_over(assembly)
    bolts, displacement = TightBolts(), dict[str, Array]()
    if start is not None:
        bolts, displacement = start.bolts, dict(start.displacement)
    timeline = problem.timeline_with(bolts)
    one.begin([joined_histories(problem, timeline, whole.models, whole.model)], problem.dt)
    _displace(whole, one, displacement)
    ground = timeline.ground(problem.units, problem.time)
    velocity = {j: ground.get(i, np.zeros((len(problem.time), 3))) for j, i in enumerate(whole.relative)}
    still = {j: GroundState(np.zeros(3), None) for j in range(len(whole.relative))}
    assembly.begin(problem.time, problem.dt, velocity, still)
    return StaticMarch(problem, whole, assembly)


def _displace(whole: StaticAssembly, one: StaticPropagator, start: Mapping[str, Array]) -> None:
    """Give the assembly the initial displacements of its bodies, those of ``start`` where they are there."""
    full = np.concatenate([start.get(m.name, m.displacement) for m in whole.models]) - one.forcing.imposed_u(0)[:, 0]
    if not full.any():
        return
    u = whole.reduced(full)
    one.state.set(u, np.zeros_like(u))


def _impedance(problem: DiscretisedProblem, whole: StaticAssembly) -> Array:
    """Stiffness per area (n_flat,) of both sides of the relative motions in series; of the one that there is."""
    impedance = np.zeros(whole.layout.n_flat)
    for j, i in enumerate(whole.relative):
        first, second = (problem.impedance[problem.layout.channels(i, side)] for side in (0, 1))
        both = first * second / np.maximum(first + second, np.finfo(float).tiny)
        impedance[whole.layout.channels(j, 0)] = np.where(
            np.minimum(first, second) > 0.0, both, np.maximum(first, second)
        )
    return impedance
