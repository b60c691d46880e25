"""A run of an assembly by its modes and the relative motions of its contacts (``reduced_assembly``).

The reduced assembly is one substructure whose contacts meet the ground: the motion of their sides E relative to E' is
that of its channels, the traction on E acts on it, and all laws of the interfaces are those of the scene. It has the
time scheme of massless contact nodes, as the relative motions have no mass, and is marched as any other assembly.

Driven faces enter as loads: with the shapes B of all bodies that follow them without inertia, u = B d + (the rest), the
forces are -K B d - C B d' - M B d''. Energies are those of the whole motion, B d included.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..assembly.initial_state import InitialState
from ..assembly.models import KeptOperators, ModelClass, operator_parts
from ..errors import SolverError
from ..latin.assembly import Array, Assembly, GroundState, Index, InterfaceUnit, Layout
from ..latin.probes import FacePlace, OutputRequest
from ..latin.recorder import Recorder
from ..latin.settings import SolverSettings
from ..propagator import Histories, LoadTerm, SubstructureModel
from ..propagator.direct import DirectPropagator
from ..propagator.model import FaceStiffness, closest_reduced
from ..propagator.patches import OF_RESPONSE, partition
from ..scene.schema import Scene
from ..scene.settings import ModalPropagatorTable
from ..time_scheme import MasslessContact
from .reduced_assembly import (
    MOST_MODES,
    ReducedAssembly,
    coarser,
    coordinates,
    marched_rows,
    mean_branches,
    strain_rows,
    with_bodies,
    with_forces,
    without_stiffness,
)
from .rigid_parts import RigidParts
from .static_assembly import against_ground
from .tied_assembly import DAMPING, MASS, STIFFNESS, Joints, TiedAssembly, TieError

_SEARCH: Final = 3.3  # factor on the search direction
_SHARE: Final = 0.2  # of the inverse of the step: frequency up to which modes are taken
_BEYOND: Final = 4.0  # the same over the highest frequency of a spectrum, at least
COARSER: Final = 2.0
"""Cut-off of the modes of a march over that of the one for the estimate of its error."""
NAME = "assembly"
"""Name of the one substructure of a reduced assembly, and of the histories of its modes."""
RELATIVE = "relative"
"""Name of the histories of its relative motions."""


@dataclass(frozen=True)
class DrivenLoads:
    """What drives a reduced assembly.

    Attributes
    ----------
    forces : (n_full, n_drive) on all bodies for amplitude 1, N: loads, then -K B, -C B and -M B of the driven faces.
    amplitudes : (n_drive, n_time) of these. motions : d, d', d'' (3, n_motion, n_time). shapes : B (n_full, n_motion).
    """

    forces: Array
    amplitudes: Array
    motions: Array
    shapes: Array

    @property
    def n_load(self) -> int:
        """Loads of the scene, which come first."""
        return int(self.forces.shape[1] - 3 * self.shapes.shape[1])

    @property
    def rates(self) -> Array:
        """Rates of the amplitudes (n_drive, n_time) over a step, the time in steps."""
        if self.amplitudes.shape[1] < 2:
            return np.zeros_like(self.amplitudes)
        return np.asarray(np.gradient(self.amplitudes, axis=1))


def drives_of(tied: TiedAssembly, shapes: Array, bodies: Assembly) -> DrivenLoads:
    """Loads and driven faces of an assembly whose bodies have begun; ``shapes`` : ``static_shapes``."""
    n = tied.expansion.shape[0]
    columns = [np.zeros((n, 0))]
    for model in tied.models:
        for load in _acting(model):
            column = np.zeros((n, 1))
            column[tied.where[model.name], 0] = load.pattern
            columns.append(column)
    columns += [-tied.times(kind, shapes) for kind in (STIFFNESS, DAMPING, MASS)]
    return DrivenLoads(np.hstack(columns), *drive_histories(tied, bodies), shapes)


def _acting(model: SubstructureModel) -> list[LoadTerm]:
    """Loads of a body that exert forces, whatever their amplitudes are."""
    return [load for load in model.loads if load.pattern.any()]


class DrivePlace(NamedTuple):
    """Where the amplitude of a column of ``DrivenLoads.forces`` is: class and member of the body, number of the load
    of the member, or of its motion with ``kind`` 0, 1, 2 for d, d' and d''; None for a load."""

    number: int
    member: int
    entry: int
    kind: int | None = None

    def amplitude(self, bodies: Assembly) -> Array:
        """At the instants (n_time,) that the bodies have begun with."""
        forcing = bodies.propagators[self.number].forcing
        if self.kind is None:
            return forcing.amplitudes[self.member][self.entry]
        histories = forcing.motion_histories(self.member)
        assert histories is not None, "a body without motions has no place of one"
        return np.asarray(histories[self.kind][:, self.entry])


def drive_places(tied: TiedAssembly, bodies: Assembly) -> list[DrivePlace]:
    """Those of all columns."""
    where = {name: (c, j) for c, p in enumerate(bodies.propagators) for j, name in enumerate(p.names)}
    loads = list[DrivePlace]()
    for model in tied.models:
        acting = {id(load) for load in _acting(model)}
        loads += [DrivePlace(*where[model.name], k) for k, load in enumerate(model.loads) if id(load) in acting]
    moved = [(*where[model.name], k) for model in tied.models for k in range(model.imposed_pattern.shape[1])]
    return [*loads, *(DrivePlace(*place, kind) for kind in range(3) for place in moved)]


def drive_histories(tied: TiedAssembly, bodies: Assembly) -> tuple[Array, Array]:
    """Amplitudes (n_drive, n_time) of ``DrivenLoads.forces`` and motions d, d', d'' (3, n_motion, n_time) of the driven
    faces, at the instants that the bodies have begun with."""
    n_motion, n_time = tied.driven.shape[1], len(bodies.time)
    rows = [np.zeros((0, n_time)), *(place.amplitude(bodies)[None] for place in drive_places(tied, bodies))]
    amplitudes = np.concatenate(rows)
    return amplitudes, amplitudes[len(amplitudes) - 3 * n_motion :].reshape(3, n_motion, n_time)


def static_shapes(tied: TiedAssembly, reduced: ReducedAssembly) -> Array:
    """B (n_full, n_motion): shapes of all bodies that follow the driven faces without inertia."""
    if not tied.driven.shape[1]:
        return tied.driven
    forces = -(tied.expansion.T @ (tied.times(STIFFNESS, tied.driven)))
    moved = reduced.solver.solve(np.asarray(forces[: tied.n_free]))
    return np.asarray(tied.driven + tied.expansion[:, : tied.n_free] @ moved)


@dataclass(frozen=True)
class MotionPlace(FacePlace):
    """Dofs of the one substructure: displacements, velocities and accelerations, or the first ``count`` of them."""

    count: int = 3

    @property
    def shape(self) -> tuple[int, int]:
        """That of its series at an instant."""
        return self.count, self.trace.shape[0]

    def read(self, values: Array, _of: Any, /) -> Array:
        """The motion as it is, (n, count, n_dof)."""
        return values[:, : self.count]


@dataclass(frozen=True)
class ReducedMarch:
    """A reduced assembly that is ready to be marched.

    Attributes
    ----------
    assembly : the reduced one. bodies : the assembly of all bodies, with ``BodyMotions``. reduced : modes and
    stiffnesses. drives : loads and driven faces. units : numbers of the interfaces with relative motions. cutoff : of
    the modes, Hz. stored : elastic energy of all bodies at t = 0, J.
    """

    assembly: Assembly
    bodies: Assembly
    reduced: ReducedAssembly
    drives: DrivenLoads
    units: tuple[int, ...]
    cutoff: float
    stored: float

    @property
    def tied(self) -> TiedAssembly:
        """The assembly whose modes these are."""
        return self.reduced.tied

    @property
    def in_words(self) -> str:
        """What is marched."""
        reduced = self.reduced
        return (
            f"{reduced.n_mode} modes of the assembly up to {self.cutoff:.4g} Hz, {reduced.tied.n_relative} relative "
            "motions of contacts"
        )

    @property
    def scheme_in_words(self) -> str:
        """The time scheme, and why."""
        return f"{self.assembly.scheme.name} (relative motions of contacts have no mass, modes keep their frequencies)"

    def settings(self, settings: SolverSettings) -> SolverSettings:
        """The rules of the iteration: the search direction is that of the compliance of all contacts together, and the
        work of an iterate's error is far below that of the modes left out."""
        search = settings.search_direction
        if search.kind == "automatic":
            search = replace(search, factor=_SEARCH * search.factor)
        return replace(settings, search_direction=search, newton=False, residual_alone=True, skip_unchanged=False)

    def begin(self) -> None:
        """Begin a run, or the next segment of it, with what drives the bodies, which have begun with it."""
        bodies, tied = self.bodies, self.tied
        amplitudes, _ = drive_histories(tied, bodies)
        histories = Histories(bodies.time, list(amplitudes), np.zeros((len(bodies.time), 0)))
        self.assembly.propagators[0].begin([histories], bodies.dt)
        ground = {j: ground_velocity(bodies, i) for j, i in enumerate(self.units)}
        still = {j: bodies.ground.start.get(i, GroundState(np.zeros(3), None)) for j, i in enumerate(self.units)}
        self.assembly.begin(bodies.time, bodies.dt, ground, still)

    def rewound(self) -> ReducedMarch:
        """The same march, at t = 0 with the loads and motions that the bodies have begun with, by which results are
        read, too."""
        march = replace(self, drives=self._driven())
        march.restart()
        march.begin()
        return march

    def _driven(self) -> DrivenLoads:
        """What drives the bodies, which have begun with it."""
        amplitudes, motions = drive_histories(self.tied, self.bodies)
        return replace(self.drives, amplitudes=amplitudes, motions=motions)

    def restart(self) -> None:
        """Back to t = 0 with the loads and motions that the bodies have begun with; ``begin`` must follow."""
        drives = self._driven()
        (propagator,) = self.assembly.propagators
        displacement, velocity = start_of(self.tied, self.reduced, drives)
        propagator.members[0] = replace(propagator.members[0], displacement=displacement, velocity=velocity)
        propagator.restart()

    def follow_strains(self) -> None:
        """Let the march keep the elongations of the branches of the bodies, which what reads internal forces at every
        instant needs; before its image is made. Bodies with different branches have the mean of all."""
        kinds = {model.branches for model in self.tied.models if len(model.branches)}
        if len(kinds) > 1:
            kinds = {mean_branches(self.reduced)}
        for branches in kinds:
            (propagator,) = self.assembly.propagators
            # without any force: the stiffness beside that of modes and relative motions is zero
            propagator.members[0] = replace(propagator.members[0], branches=branches)

    def recorder(self, energy: bool) -> Recorder:
        """That of the march: motions of modes and relative motions at every instant, interfaces, energies."""
        return Recorder(self.assembly, OutputRequest(energy=energy, faces=self.places(NAME)), {})

    def places(self, name: str) -> dict[str, MotionPlace]:
        """What is read of the substructure of this ``name``: motions of modes, and relative motions."""
        dofs, m = sp.csr_array(sp.eye_array(self.assembly.propagators[0].n_dof)), self.reduced.n_mode
        # what has no mass has velocities and accelerations of the scheme alone
        return {NAME: MotionPlace(name, dofs[:m]), RELATIVE: MotionPlace(name, dofs[m:], count=1)}


def reduced_march(
    scene: Scene,
    classes: Sequence[ModelClass],
    bodies: Assembly,
    start: InitialState | None,
    viscosities: Mapping[str, float],
    finer: ReducedMarch | None = None,
    known: KeptOperators | None = None,
) -> ReducedMarch:
    """The reduced assembly of a scene.

    classes : of the bodies with their initial displacements. bodies : the assembly of all bodies, which has begun.
    start : the equilibrium that the motion starts from. viscosities : b of the damping b K by strains, s, by body.
    finer : of the same scene in shorter steps, whose modes up to 1 / ``COARSER`` of its cut-off are taken. known : of
    scenes solved before, whose modes and operators are taken where what they depend on is equal.

    Raises
    ------
    TieError : an assembly that cannot be reduced.
    """
    units, dt = bodies.interfaces, bodies.dt
    if known is None or finer is not None:
        known = KeptOperators()
    if finer is None:
        modes, cutoff = _modes(scene, classes, bodies, viscosities, known)
    else:
        modes, cutoff = _fewer_modes(finer, dt)
    tied = modes.tied
    drives = drives_of(tied, static_shapes(tied, modes), bodies)
    reduced = with_forces(modes, drives.forces)
    relative = tied.joints.relative
    alone = [against_ground(units[i]) for i in relative]
    layout = Layout(alone)
    channels = relative_channels(layout, range(len(relative)))
    patches = _patches(alone, reduced, layout, finer, known)
    model = reduced_model(reduced, start_of(tied, reduced, drives), layout, channels, patches)
    try:
        propagator = _propagator(model, dt, known)
    except SolverError as error:
        # they have no mass: what parts that nothing but contacts holds have, modes give
        what = f"relative motions of contacts have neither stiffness nor enough inertia in {reduced.n_mode} modes"
        raise TieError(f"{what}: parts that nothing but contacts holds need more of them (`highest`)") from error
    propagator.loads_only = not scene.output.energy
    assembly = Assembly(
        [propagator],
        [channels[:, None]],
        alone,
        layout,
        relative_impedance(propagator, channels, layout.n_flat),
        bodies.characteristic_traction,
        MasslessContact(),
    )
    assembly.rest_traction = -1.0
    if start is not None:
        start.hand_over(assembly)
    moved = np.concatenate([m.displacement for m in tied.models])
    stored = 0.5 * float(moved @ tied.times(STIFFNESS, moved))
    march = ReducedMarch(assembly, bodies, reduced, drives, relative, cutoff, stored)
    march.begin()
    return march


def _propagator(model: SubstructureModel, dt: float, known: KeptOperators) -> DirectPropagator:
    """That of a reduced assembly, with the operators of one before where its matrices are equal."""

    def propagator(twin: DirectPropagator | None = None) -> DirectPropagator:
        return DirectPropagator([model], MasslessContact(), dt, True, twin)

    first = known.again("reduced assembly", (dt, *operator_parts(model)), propagator)
    if first.members[0] is model:
        return first
    return propagator(first)


def _modes(
    scene: Scene,
    classes: Sequence[ModelClass],
    bodies: Assembly,
    viscosities: Mapping[str, float],
    known: KeptOperators,
) -> tuple[ReducedAssembly, float]:
    """Modes of the assembly, and the frequency up to which they are taken, Hz."""
    units, cutoff = bodies.interfaces, cutoff_of(scene, bodies.dt)
    joints = Joints.of(units)
    for i in (*joints.bonded, *joints.linear):
        if units[i].against_ground and bodies.ground.velocity[i].any():
            raise TieError(f"interface {units[i].name} joins a body to a ground that moves")

    def modes() -> ReducedAssembly:
        tied = TiedAssembly.of(classes, units, bodies.layout)
        found = ReducedAssembly.of(tied, RigidParts.of(tied, bodies.layout), bodies.dt, cutoff, viscosities)
        if found is None:
            raise TieError(f"more than {MOST_MODES} modes are below {cutoff:g} Hz")
        return without_stiffness(found)

    basis = known.again("modes", (cutoff, *_of_modes(classes, bodies, joints)), modes)
    return with_bodies(basis, [m for c in classes for m in c.members], viscosities), cutoff


def _of_modes(classes: Sequence[ModelClass], bodies: Assembly, joints: Joints) -> Iterator[Any]:
    """All that the modes of a tied assembly and its static stiffness depend on, the frequency up to which they are
    taken left out: no load, damping, gap, friction or motion at t = 0."""
    yield from (bodies.dt, *joints, bodies.layout.area)
    for c in classes:
        yield c.channels
        for m in c.members:
            yield from (m.name, m.stiffness, m.inertia, m.expansion, m.trace, m.imposed_pattern, m.positions, m.nodal)
    for i, unit in enumerate(bodies.interfaces):
        yield from (unit.geometry.owner, unit.geometry.frames, *(bodies.layout.channels(i, side) for side in (0, 1)))
        if i in joints.linear:
            yield unit.behaviour.point_parameters(unit.geometry.n_point)


def _fewer_modes(finer: ReducedMarch, dt: float) -> tuple[ReducedAssembly, float]:
    """Those of a march in steps dt, s, for the estimate of the error of a finer one."""
    cutoff = finer.cutoff / COARSER
    return coarser(finer.reduced, dt, cutoff), cutoff


def cutoff_of(scene: Scene, dt: float) -> float:
    """Frequency up to which modes are taken for steps dt, Hz: that of the scene, else what the steps resolve."""
    table = scene.solver.propagator
    if isinstance(table, ModalPropagatorTable) and table.highest is not None:
        return table.highest
    return _SHARE / dt


def steps_resolve_spectra(scene: Scene, dt: float) -> bool:
    """Whether steps dt, s, march the modes that the spectra of a scene ask for."""
    spectra = [sensor.spectrum for sensor in scene.sensor.values() if sensor.spectrum is not None]
    return all(_BEYOND * spectrum.last(dt) <= _SHARE / dt * (1.0 + 1e-9) for spectrum in spectra)


def ground_velocity(bodies: Assembly, i: int) -> Array:
    """Velocity (n_time, 3) of what side E of an interface moves relative to."""
    return bodies.ground.velocity.get(i, np.zeros((len(bodies.time), 3)))


def relative_channels(layout: Layout, numbers: Sequence[int]) -> Index:
    """Channels of the relative motions of some interfaces against ground, one after the other."""
    return np.concatenate([np.zeros(0, np.int64), *(layout.channels(j, 0).ravel() for j in numbers)])


def relative_impedance(propagator: DirectPropagator, channels: Index, n_flat: int) -> Array:
    """Impedance (n_flat,) of the relative motions: traction of a point per velocity of its own in a step, others free;
    steps are longer than waves take through an element, and those of the materials say little."""
    impedance = np.zeros(n_flat)
    admittance = propagator.operators.compliance.diagonal() * propagator.operators.area
    impedance[channels] = np.divide(1.0, admittance, out=np.zeros_like(admittance), where=admittance > 0.0)
    return impedance


def start_of(tied: TiedAssembly, reduced: ReducedAssembly, drives: DrivenLoads) -> tuple[Array, Array]:
    """Modes and relative motions (n,) at t = 0: displacements and velocities."""
    state = []
    for kind, loads in ((0, drives.amplitudes[:, 0]), (1, np.zeros(len(drives.amplitudes)))):
        full_state = np.concatenate([m.velocity if kind else m.displacement for m in tied.models])
        full = full_state - drives.shapes @ drives.motions[kind, :, 0]
        parts = [closest_reduced(m.expansion, full[tied.where[m.name], None])[:, 0] for m in tied.models]
        q, r = tied.hierarchical.of_reduced(np.concatenate(parts))[tied.free], np.asarray(tied.jump @ full)
        state.append(coordinates(reduced, q, r, loads))
    return state[0], state[1]


def _patches(
    units: Sequence[InterfaceUnit],
    reduced: ReducedAssembly,
    layout: Layout,
    finer: ReducedMarch | None,
    known: KeptOperators,
) -> list[Index]:
    """Rows of S, patch by patch: those of ``finer``, whose S it is, where there is one."""
    if finer is not None:
        face = finer.assembly.propagators[0].members[0].face
        assert face is not None, "a reduced assembly has a stiffness of its relative motions"
        return face.patches
    places = [np.zeros((0, 3))]
    for j, unit in enumerate(units):
        places.append(np.repeat(unit.geometry.points, layout.channels(j, 0).shape[1], axis=0))
    points = np.concatenate(places)[reduced.tied.exists]
    return known.again("patches", (points, reduced.relative), lambda: partition(points, reduced.relative, OF_RESPONSE))


def reduced_model(
    reduced: ReducedAssembly, start: tuple[Array, Array], layout: Layout, channels: Index, patches: list[Index]
) -> SubstructureModel:
    """The reduced assembly as one substructure; ``patches`` : of its relative motions."""
    m, n = reduced.n_mode, reduced.n_mode + reduced.tied.n_relative
    exists = np.flatnonzero(reduced.tied.exists)
    mass = np.zeros(n)
    mass[:m] = 1.0
    drag = np.zeros((n, n))
    drag[:m, :m] = reduced.drag
    stiffness = reduced.relative
    return SubstructureModel(
        name=NAME,
        mass=sp.csr_array(sp.diags_array(mass)),
        damping=sp.csr_array(drag),
        stiffness=sp.csr_array((n, n)),
        expansion=sp.csr_array(sp.eye_array(n)),
        trace=sp.csr_array(sp.coo_array((np.ones(n - m), (exists, np.arange(m, n))), shape=(len(channels), n))),
        channel_area=layout.area[channels],
        loads=[LoadTerm(f"drive {k}", column) for k, column in enumerate(reduced.drives.T)],
        displacement=start[0],
        velocity=start[1],
        imposed_pattern=np.zeros((n, 0)),
        imposed_start=np.zeros(0),
        viscous_rows=strain_rows(reduced),
        face=FaceStiffness(
            stiffness,
            reduced.relative_viscosity,
            marched_rows(reduced),
            patches,
            np.append(reduced.marched.shares, np.zeros(len(reduced.inertia.root))),
            reduced.branches,
            n_inertial=len(reduced.inertia.root),
        ),
    )
