"""Derivatives of a run that was marched by the modes of its assembly (``joined.reduced_run``).

The reduced equations are those of one substructure, linear but for the laws of its contacts. Their derivative by a
parameter has the same matrices: a copy of the substructure for each parameter, with the derivatives of loads, driven
faces and initial values projected as those themselves are, under the tangents of the laws (``kernels.tangent_march``).
What the bodies do is a linear function of the motion of a copy, its loads and driven faces, so that their derivatives
are recovered as the run itself is (``joined.recovered_fields``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ..assembly.body_motions import BodyMotions
from ..joined.recovered_fields import MarchHistories, RelativeShapes
from ..joined.reduced_assembly import with_forces
from ..joined.reduced_run import (
    NAME,
    RELATIVE,
    ReducedMarch,
    drives_of,
    ground_velocity,
    relative_channels,
    relative_impedance,
    start_of,
)
from ..joined.static_assembly import against_ground
from ..latin.assembly import Array, Assembly, InterfaceUnit, Layout
from ..latin.interface_rows import InterfaceRows
from ..latin.probes import OutputRequest
from ..latin.recorder import Recorder
from ..propagator import Histories, LoadTerm
from ..propagator.direct import DirectPropagator
from ..propagator.model import share_operators
from ..statics.statics import Stage
from ..time_scheme import MasslessContact
from .copies import MARK, Marched, named, places_in, unit_of
from .data_changes import (
    Ends,
    StateChange,
    VariedParameter,
    balance_start,
    changed_bolt,
    changed_model,
    changed_unit,
    ground_changes,
    hand_over,
    law_changes,
    ramp_changes,
)
from .reduced_damping import DampingChange
from .spanned_recorder import SpannedRecorder, spanned
from .tangent_run import SolvedFields, TangentRun


@dataclass(frozen=True)
class _CopyHistories:
    """Histories of a copy among those of all: ``MarchHistories``."""

    n_kept: int
    rows: InterfaceRows
    paths: Mapping[str, Array]

    def series(self, _kind: str) -> Mapping[str, Array]:
        """Motions of modes and relative motions."""
        return self.paths


@dataclass(frozen=True)
class ReducedCopy:
    """The reduced assembly with the derivatives of its data by a parameter.

    Attributes
    ----------
    march : as one to be marched, with an assembly of its own, whose bodies have the derivatives of theirs. units : the
    interfaces with relative motions of the bodies, with the derivatives of gaps and preloads. laws : parameters of
    their laws (``SolvedFields.changes``). damping : its change, None where there is none. forces : (n_time, n) that it
    brings, N.
    """

    march: ReducedMarch
    units: Sequence[InterfaceUnit]
    laws: Sequence[tuple[Array, Array, float] | None]
    damping: DampingChange | None
    forces: Array | None

    @staticmethod
    def of(
        stage: Stage, marched: MarchHistories, number: int, parameter: VariedParameter, state: StateChange
    ) -> ReducedCopy:
        """That of a motion, of this ``number`` among all; ``state`` : derivative of the initial state of the bodies."""
        march = cast(ReducedMarch, stage.ready.reduced)
        ends = stage.likewise(parameter.more), stage.likewise(parameter.less)
        bodies = _bodies(stage, parameter, ends, state)
        models = [model for propagator in bodies.propagators for model in propagator.members]
        drives = drives_of(replace(march.tied, models=models), march.drives.shapes, bodies)
        reduced = with_forces(march.reduced, drives.forces, models)
        displacement, velocity = start_of(reduced.tied, reduced, drives)
        damping, forces = DampingChange.of(stage, parameter, marched), None
        if damping is not None:
            moved, speed = damping.start
            displacement, velocity, forces = displacement + moved, velocity + speed, damping.forces()
        base = march.assembly.propagators[0]
        loads = [LoadTerm(f"drive {k}", column) for k, column in enumerate(reduced.drives.T)]
        if forces is not None:
            loads.append(LoadTerm(MARK, forces[0]))
        model = replace(
            base.members[0], name=named(number, NAME), loads=loads, displacement=displacement, velocity=velocity
        )
        share_operators(base.members[0], model)
        propagator = DirectPropagator([model], base.scheme, march.bodies.dt, False, cast(DirectPropagator, base))
        units = [against_ground(bodies.interfaces[i]) for i in march.units]
        laws = [Layout([against_ground(end.units[i]) for i in march.units]) for end in ends]
        own = replace(
            march, assembly=_assembled([propagator], units), bodies=bodies, reduced=reduced, drives=drives, stored=0.0
        )
        return ReducedCopy(own, units, law_changes(parameter, *laws), damping, forces)

    @property
    def histories(self) -> Histories:
        """What drives the copy."""
        time = self.march.bodies.time
        amplitudes = list(self.march.drives.amplitudes)
        if self.forces is not None:
            amplitudes.append(np.eye(1, len(time))[0])  # at t = 0, before the march
        return Histories(time, amplitudes, np.zeros((len(time), 0)))

    def recovered(self, histories: _CopyHistories, request: OutputRequest, span: RelativeShapes | None) -> Marched:
        """What the bodies do, from the march; ``span`` : shapes of relative motions."""
        recorder = SpannedRecorder(self.march, histories, request, span)
        if self.damping is not None:
            self.damping.add_to(recorder, request, span)
        return Marched(recorder.interfaces(), recorder.sensors(self.march.bodies), recorder.bolt_histories())


def marched_by_modes(
    stage: Stage,
    marched: MarchHistories,
    parameters: Sequence[VariedParameter],
    states: Sequence[StateChange],
    progress: Callable[[int, int], None] | None = None,
) -> list[Marched]:
    """Derivatives of a motion that was marched by modes, by parameter, from those of the initial state of its bodies;
    ``marched`` : histories of its march. ``progress`` and errors as for ``Tangents.march``."""
    march = cast(ReducedMarch, stage.ready.reduced)
    data = enumerate(zip(parameters, states, strict=True))
    copies = [ReducedCopy.of(stage, marched, number, p, state) for number, (p, state) in data]
    propagators = [cast(DirectPropagator, copy.march.assembly.propagators[0]) for copy in copies]
    whole = _assembled(propagators, [unit_of(number, unit) for number, c in enumerate(copies) for unit in c.units])
    balance_start(stage, whole)
    hand_over(states, whole)
    time = stage.problem.time
    ground = dict[int, Array]()
    for number, copy in enumerate(copies):
        whole.propagators[number].begin([copy.histories], march.bodies.dt)
        first = number * len(march.units)
        ground |= {first + j: ground_velocity(copy.march.bodies, i) for j, i in enumerate(march.units)}
    whole.begin(time, march.bodies.dt, ground, whole.ground.start)
    places = {named(k, key): place for k in range(len(copies)) for key, place in march.places(named(k, NAME)).items()}
    recorder = Recorder(whole, OutputRequest(faces=places), {})
    solved = SolvedFields(march.assembly, stage.rows, [copy.laws for copy in copies])
    forced = any(copy.forces is not None for copy in copies)
    run = TangentRun(whole, march.settings(stage.ready.settings), recorder, solved, forced)
    run.march((lambda n, row: _act(run, copies, n, row)) if forced else None, progress)
    request = stage.ready.output
    request = OutputRequest(
        sensors=request.sensors, bolts={name: changed_bolt(bolt) for name, bolt in request.bolts.items()}
    )
    parts = [*_parts(recorder, whole, copies)]
    span = spanned(march, [marched, *parts] if forced else parts)
    return [copy.recovered(part, request, span) for copy, part in zip(copies, parts, strict=True)]


def _act(run: TangentRun, copies: Sequence[ReducedCopy], n: int, row: int) -> None:
    """Write the forces of the next n instants into the image, from a row on."""
    image, first = run.image, run.assembly.instant + 1
    for c, (propagator, copy) in enumerate(zip(image.propagators, copies, strict=True)):
        constant = propagator.forcing.loads_over_time()[0]
        rows = image.class_field(c, "forces", image.rows, *constant.shape)[row : row + n]
        rows[:] = constant
        if copy.forces is not None:
            rows[..., 0] += copy.forces[first : first + n]


def _bodies(stage: Stage, parameter: VariedParameter, ends: Ends, state: StateChange) -> Assembly:
    """The assembly of all bodies with the derivatives of their data, begun."""
    problem, base = stage.problem, stage.ready.assembly
    ramps = ramp_changes(stage, parameter, state)
    more, less = ends
    units = [changed_unit(unit, parameter, (more.units[i], less.units[i])) for i, unit in enumerate(problem.units)]
    propagators, histories = list[BodyMotions](), list[list[Histories]]()
    for c in problem.classes:
        changed = [changed_model(model, problem.time, parameter, ends, state, ramps) for model in c.members]
        members = [model for model, _ in changed]
        share_operators(c.members[0], members[0])
        propagators.append(BodyMotions(members, base.scheme, problem.dt, False))
        histories.append([driven for _, driven in changed])
    layout = Layout(units)
    bodies = Assembly(
        list(propagators), [c.channels for c in problem.classes], units, layout, problem.impedance, 0.0, base.scheme
    )
    for propagator, driven in zip(propagators, histories, strict=True):
        propagator.begin(driven, problem.dt)
    bodies.begin(problem.time, problem.dt, ground_changes(base, parameter, ends), bodies.ground.start)
    return bodies


def _assembled(propagators: Sequence[DirectPropagator], units: Sequence[InterfaceUnit]) -> Assembly:
    """Substructures of equal reduced assemblies with as many interfaces each, those of the first one first."""
    layout, count = Layout(units), len(units) // len(propagators)
    channels = [relative_channels(layout, range(k * count, (k + 1) * count)) for k in range(len(propagators))]
    impedance = np.zeros(layout.n_flat)
    for propagator, own in zip(propagators, channels, strict=True):
        impedance += relative_impedance(propagator, own, layout.n_flat)
    assembly = Assembly(
        list(propagators), [own[:, None] for own in channels], units, layout, impedance, 0.0, MasslessContact()
    )
    assembly.rest_traction = -1.0
    return assembly


def _parts(recorder: Recorder, whole: Assembly, copies: Sequence[ReducedCopy]) -> Iterator[_CopyHistories]:
    """Histories of each copy among those of the whole."""
    paths, n = recorder.series("path"), recorder.n_kept
    places = places_in(copies[0].march.assembly.layout, whole.layout, len(copies[0].units), len(copies))
    for number, (copy, to) in enumerate(zip(copies, places, strict=True)):
        own = copy.march.assembly
        rows = InterfaceRows(own, np.zeros((n, InterfaceRows.width_of(own))))
        rows.f_hat[:], rows.w_hat[:] = recorder.rows.f_hat[:n, to], recorder.rows.w_hat[:n, to]
        for g, gaps in rows.gaps.items():
            count = gaps.shape[1]
            gaps[:] = recorder.rows.gaps[g][:n, number * count : (number + 1) * count]
        yield _CopyHistories(n, rows, {key: paths[named(number, key)] for key in (NAME, RELATIVE)})
