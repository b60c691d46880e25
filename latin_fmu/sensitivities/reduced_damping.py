"""What a parameter that changes the damping of bodies changes in a march by the modes of their assembly.

The modes stay, while the equations that are marched have other coefficients: poles, damping by strains and media,
Maxwell branches, and what loads and relative motions do to a mode in a step (``joined.reduced_assembly``). With forces
R(z) of the motion z of the run, by the equations with the parameter a little larger and a little smaller, the
derivative of the motion is driven by

    g = -(R_more(z) - R_less(z)) / span

beside the changes of its initial values; and what the bodies do follows from z by other shapes, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ..assembly.body_motions import BodyMotions
from ..assembly.problem import DiscretisedProblem
from ..joined.modal_problem import viscosities_of
from ..joined.recovered_fields import MarchHistories, RecoveredRecorder, RelativeShapes, relaxing
from ..joined.reduced_assembly import with_bodies, with_forces
from ..joined.reduced_run import NAME, RELATIVE, ReducedMarch, drives_of, reduced_model, start_of
from ..latin.assembly import Array, Assembly
from ..latin.probes import OutputRequest
from ..propagator import SubstructureModel
from ..statics.statics import Stage
from .copies import models_of
from .data_changes import VariedParameter
from .spanned_recorder import SpannedRecorder


@dataclass(frozen=True)
class _Equations:
    """The equations of a march with another damping of its bodies: as it would be marched, and its one substructure."""

    march: ReducedMarch
    model: SubstructureModel

    @staticmethod
    def of(stage: Stage, whole: DiscretisedProblem) -> _Equations:
        """Those of a motion with the damping of another problem."""
        march = cast(ReducedMarch, stage.ready.reduced)
        bodies = _bodies(stage, whole)
        models = [model for propagator in bodies.propagators for model in propagator.members]
        reduced = with_bodies(march.reduced, models, viscosities_of(whole.bodies))
        drives = drives_of(reduced.tied, march.drives.shapes, bodies)
        reduced = with_forces(reduced, drives.forces)
        (base,) = march.assembly.propagators[0].members
        assert base.face is not None, "a reduced assembly has a stiffness of its relative motions"
        channels = march.assembly.channels[0][:, 0]
        start = start_of(reduced.tied, reduced, drives)
        model = reduced_model(reduced, start, march.assembly.layout, channels, base.face.patches)
        return _Equations(replace(march, bodies=bodies, reduced=reduced, drives=drives), model)

    def unbalance(self, place: Array, velocity: Array) -> Array:
        """Forces (n_time, n) of displacements and velocities (n_time, n) in these equations, without those of inertia
        that no damping changes, less the loads, N."""
        face, dt = self.model.face, self.march.bodies.dt
        assert face is not None, "a reduced assembly has a stiffness of its relative motions"
        first = self.march.reduced.n_mode
        elastic, inertial = np.split(face.rows, [len(face.rows) - face.n_inertial])
        strained = place @ elastic.T
        shares = face.row_shares[: len(elastic)]
        total = (strained + shares * relaxing(face.branches, dt, strained)) @ elastic
        moved = place[:, first:]
        relaxed = face.share * relaxing(face.branches, dt, moved)
        total[:, first:] += (moved + relaxed + face.viscosity * velocity[:, first:]) @ face.matrix
        if self.model.viscous_rows is not None:
            total += (velocity @ self.model.viscous_rows.T) @ self.model.viscous_rows
        assert self.model.damping is not None, "a reduced assembly has damping"
        total += np.asarray(self.model.damping @ velocity.T).T
        on_rows = place @ inertial.T
        total[2:] += np.diff(on_rows, 2, axis=0) @ inertial
        amplitudes = self.march.drives.amplitudes[:, : len(place)]
        return np.asarray(total - (self.march.reduced.drives @ amplitudes).T)


@dataclass(frozen=True)
class DampingChange:
    """A parameter that changes the damping of bodies: the equations with it a little larger and smaller, the difference
    of the parameter, and the march of the run."""

    more: _Equations
    less: _Equations
    span: float
    marched: MarchHistories

    @staticmethod
    def of(stage: Stage, parameter: VariedParameter, marched: MarchHistories) -> DampingChange | None:
        """That of a motion, from its march; None where the damping does not change."""
        if not parameter.changes_damping:
            return None
        more, less = (_Equations.of(stage, end) for end in (parameter.more, parameter.less))
        return DampingChange(more, less, parameter.span, marched)

    @property
    def start(self) -> tuple[Array, Array]:
        """Derivatives of the initial displacements and velocities (n,) for the same motion of the bodies."""
        more, less = self.more.model, self.less.model
        return (more.displacement - less.displacement) / self.span, (more.velocity - less.velocity) / self.span

    def forces(self) -> Array:
        """g (n_time, n) at all instants, N."""
        paths = self.marched.series("path")
        modes, relative = paths[NAME], paths[RELATIVE][:, 0]
        march = self.more.march
        (base,), dt = march.assembly.propagators[0].members, march.bodies.dt
        # of what has no mass the equations take the velocity over a step, extrapolated to its end
        over_steps = np.diff(relative, axis=0) / dt
        earlier = np.vstack([base.velocity[None, march.reduced.n_mode :], over_steps])[: len(over_steps)]
        rates = np.vstack([base.velocity[None, march.reduced.n_mode :], 2.0 * over_steps - earlier])
        place, velocity = np.hstack([modes[:, 0], relative]), np.hstack([modes[:, 1], rates])
        ends = [equations.unbalance(place, velocity) for equations in (self.more, self.less)]
        return np.asarray((ends[1] - ends[0]) / self.span)

    def add_to(self, recorder: RecoveredRecorder, request: OutputRequest, span: RelativeShapes | None) -> None:
        """Add what the same motion is in other shapes to what the bodies do; ``span`` : shapes of relative motions with
        the damping of the run, which have other shares of the modes here."""
        for equations, sign in ((self.more, 1.0), (self.less, -1.0)):
            shapes = None if span is None else span.damped(equations.march)
            end = SpannedRecorder(equations.march, self.marched, request, shapes)
            recorder.add(end, sign / self.span)


def _bodies(stage: Stage, whole: DiscretisedProblem) -> Assembly:
    """All bodies of a motion, with the damping of those of another problem, begun."""
    base, others = stage.ready.assembly, models_of(whole)
    propagators = []
    for propagator in base.propagators:
        members = [
            replace(m, damping=others[m.name].damping, landing=others[m.name].landing, branches=others[m.name].branches)
            for m in propagator.members
        ]
        propagators.append(BodyMotions(members, base.scheme, base.dt, False))
    bodies = Assembly(list(propagators), base.channels, base.interfaces, base.layout, base.impedance, 0.0, base.scheme)
    stage.ready.timeline.begin(bodies, base.time, {}, bodies.ground.start)
    return bodies
