"""Bodies that are not marched themselves: what results are read from where an assembly is marched otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..latin.assembly import Array, Assembly, Layout
from ..propagator import Histories, SubstructureModel
from ..propagator.base import Propagator
from ..propagator.model import Operators
from ..time_scheme import TimeScheme
from .initial_state import InitialState, TightBolts
from .models import ModelClass
from .problem import DiscretisedProblem
from .timeline import Timeline


class _Moves:
    """Diagonal of the compliance of channels, of which only is known which can move."""

    def __init__(self, trace: sp.csr_array) -> None:
        self._moves = (np.diff(trace.indptr) > 0).astype(float)

    def diagonal(self) -> Array:
        """1 where a channel can move, else 0."""
        return self._moves


class BodyMotions(Propagator):
    """Motions of a class of bodies that are not marched themselves: what results are read from."""

    def _build(self, dt: float) -> Operators:  # noqa: ARG002, the same for all steps
        model = self.members[0]
        if model.mass is None:
            n, stiffness = model.expansion.shape[1], model.reduced_stiffness
            mass = sp.csr_array((n, n))
            damping = None
            massless = np.zeros(0, dtype=np.int64)
        else:
            (mass, damping, stiffness), massless = model.reduced, model.massless
        dofs, trace, _ = model.at_interface
        factor: Any = None
        same = mass, damping, stiffness, factor, dofs, trace, model.spread, model.channel_area
        return Operators(*same, _Moves(trace), massless)

    def internal_forces(self) -> tuple[Array, Array]:
        """K u and C v of the free dofs, (n_dof, n_member), N."""
        _, damping, stiffness = self.members[0].reduced
        if damping is None:
            viscous = np.zeros_like(self.state.v)
        else:
            viscous = damping @ self.state.v
        return stiffness @ self.state.u, viscous

    def mass_factor(self) -> Any:
        """Refused: they are not marched."""
        raise TypeError("motions of bodies that are not marched have no factor")


def standing_bodies(
    problem: DiscretisedProblem, start: InitialState | None, scheme: TimeScheme
) -> tuple[list[ModelClass], Assembly, Timeline]:
    """Classes of the bodies, their assembly at t = 0 with ``BodyMotions``, and what drives it; ``start`` : the
    equilibrium there, None where there is none."""
    units = problem.units
    # ``start`` changes its gaps
    if start is None:
        layout = problem.layout
    else:
        layout = Layout(units)
    if start is None:
        classes = problem.classes
    else:
        classes = start.displaced(problem.classes)
    propagators = [BodyMotions(c.members, scheme, problem.dt, False) for c in classes]
    settings = units, layout, problem.impedance.copy(), problem.characteristic_traction, scheme
    assembly = Assembly(propagators, [c.channels for c in classes], *settings)
    if start is not None:
        start.hand_over(assembly)
    timeline = problem.timeline_with(TightBolts() if start is None else start.bolts)
    timeline.begin(assembly, problem.time, {}, assembly.ground.start)
    return classes, assembly, timeline


def joined_histories(
    problem: DiscretisedProblem, timeline: Timeline, models: Sequence[SubstructureModel], joined: SubstructureModel
) -> Histories:
    """What drives bodies that are ``joined`` in one substructure, whose loads are theirs by name."""
    of_members = [timeline.histories(member, problem.time) for member in models]
    named = {
        load.name: amplitude
        for member, histories in zip(models, of_members, strict=True)
        for load, amplitude in zip(member.loads, histories.amplitudes, strict=True)
    }
    imposed = np.concatenate([np.zeros((len(problem.time), 0)), *(h.imposed for h in of_members)], axis=1)
    kinds = tuple(kind for h in of_members for kind in h.motion_kinds)
    return Histories(problem.time, [named[load.name] for load in joined.loads], imposed, kinds)
