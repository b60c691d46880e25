"""Natural frequencies and shapes of an assembly without loads, its joints open, sticking or bonded.

    K phi = omega^2 M phi    on the motions with C phi = 0

C holds what joints keep together: all components of perfect interfaces; of contacts, at points that are closed at the
start, the normal component and, with friction, the tangential ones (sticking); all components at all points (bonded).
In a scene with bolts, or with a static start, those points are closed that are under pressure when the bolts are tight
and what acts at t = 0 does. With open joints bolts have no tension, and their shanks are free to slide in the thread
(``bolts``).
Springs of layers add to K. Held and prescribed directions do not move.

Points that are not closed, but by less than ``_NEAR`` of the size of the assembly, are nearly closed: a vibration that
strains the bodies by about as much closes them in a part of its period. It rings between the frequencies with these
points open and those with them closed as well, which are not lower, mode by mode: constraints raise every eigenvalue.

Rows of C with one or two entries (nodes against nodes) make dofs one, or hold them: exact. Of other rows (mortar) each
gives one dof by the others (``merged_assembly.tied``; where they depend on each other, by a dense elimination). Only
a large number of dependent rows becomes springs ``_STIFF`` times as stiff as the stiffest dof.

The modes are undamped. The damping ratio that a run of the scene gives each of them is added (``modal_damping``), and
how a base that moves along an axis excites it: with the rigid translation r of all bodies, held dofs included,

    Gamma = phi^T M r / (phi^T M phi),    effective mass = (phi^T M r)^2 / (phi^T M phi)

for the phi of ``shapes``. The effective masses of all modes add up to the mass that the supports leave free to move.

Results are a table, files for ParaView, and the groups of a file::

    /                      provenance and scene, as attributes
    /modes                 frequency, frequency_closed, rigid, modal_mass, scheme_damping, landing_damping,
                           body_damping (mode), participation, effective_mass (mode, component); joints, interfaces,
                           mass, time_scheme and time_step as attributes
    /substructures/<name>  shape (mode, node, component), and the mesh
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Final, Literal

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import xarray as xr
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..interface import Rods
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, InterfaceUnit
from ..latin.recorder import SubstructureInfo
from ..laws.viscous_joint import ViscousJoint
from ..propagator import SubstructureModel
from ..propagator.vibration import Vibration
from ..results.dataset import Stored
from ..results.groups import StoredGroup, describe_mesh, in_units, root_attributes
from ..results.quantities import AXES, LABELS, MESH, NODES, columns, named, rows
from ..results.summary import aligned, readable
from ..results.vtk import export_vtu
from ..scene import settings as tables
from ..scene.fields import split_face
from ..scene.schema import Scene
from ..scene.settings import GivenStart
from ..scene.units import SI, UnitSystem
from .body import consecutive
from .build import discretise, starting_equilibrium
from .initial_state import InitialState
from .merged_assembly import jump, kept_together
from .modal_damping import ModalDamping, Modes, modal_damping, run_matrices
from .problem import DiscretisedProblem
from .start_contacts import start_gap
from .statics import tightened

Joints = Literal["sticking", "open", "bonded"]
_STIFF: Final = 1e4
_NO_DAMPING = 1e-7  # %, round-off
_UNMOVED = 1e-9  # of a mode of a body, whose rate is round-off
_NO_MASS = 1e-6  # of the assembly, round-off
_EFFECTIVE: Final = "effective mass along x, y, z"
_NEAR = 1e-4  # of the size of the assembly: larger gaps are open
_ROUND_OFF = 1e-9  # of this, a gap that is none
_SAME = 1e-3  # of a frequency: smaller changes are not printed
_CLOSED = 1e-6  # gaps below this share of the spacing of the points are closed
_SLOWEST = 0.01  # shift of the eigenvalues: this share of shear wave speed over size of the assembly, in Hz


def vibration_modes(scene: Scene, joints: Joints = "sticking", count: int = 10) -> VibrationModes:
    """Natural frequencies and shapes of the assembly of a scene (module docstring), and the damping ratio of each mode
    in a run with the time scheme and the step of the scene (``VibrationModes.damping``).

    Parameters
    ----------
    joints : of interfaces that may open. count : elastic modes, the lowest ones; rigid motions come in addition.

    Returns
    -------
    Modes with frequencies, Hz, shapes, modal masses, kg, participation factors and effective masses, kg, and
    ``damping``: ratios (n_mode,) of critical ``scheme``, ``landing``, ``bodies``, ``numerical`` (scheme and landing
    layer), and ``remedy``, what lowers the numerical damping where it exceeds 5e-5; None for a quasi-static scene.

    Raises
    ------
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/beam_in_traction/scene.toml")
    >>> modes = latin_fmu.vibration_modes(scene, "open", count=3)
    >>> modes.frequency.size - 3  # rigid motions of the free bars and of their joints
    12
    """
    state = start_state(scene) if joints == "sticking" else None
    pressed = {} if state is None else pressed_of(state)
    joined = JoinedAssembly.of(scene, joints, pressed)
    modes = joined.modes(count)
    matrices = run_matrices(scene, joined.discretised, joined.parts.models)
    damping = None if matrices is None else modal_damping(matrices, modes, joined.damping_of)
    near = joined.nearly_closed(pressed, state) if joints == "sticking" else {}
    closed = None
    if near:
        units = {unit.name: unit for unit in joined.discretised.units}
        every = {name: pressed.get(name, _touching(units[name])) | ~np.isnan(gap) for name, gap in near.items()}
        closed = JoinedAssembly.of(scene, joints, pressed | every, joined.discretised).frequencies(len(modes.omega))
    return _named(joined, modes, damping, joints, near, closed)


def without_scheme(scene: Scene) -> DiscretisedProblem:
    """Matrices and interfaces of a scene with a scheme that moves no mass. Errors as for ``vibration_modes``."""
    plain = {"scheme": tables.HHTTable(), "quasi_static": False, "start": GivenStart()}
    return discretise(scene.model_copy(update={"time": scene.time.model_copy(update=plain)}))


def damped(problem: DiscretisedProblem) -> bool:
    """Whether a body or a joint of a discretised scene has damping."""
    models = (model for cls in problem.classes for model in cls.members)
    return any(isinstance(unit.behaviour, ViscousJoint) for unit in problem.units) or any(
        model.modal is not None or (model.damping is not None and bool(model.damping.count_nonzero()))
        for model in models
    )


@dataclass(frozen=True)
class JoinedAssembly:
    """Stiffness and mass of an assembly whose joints are linear.

    Attributes
    ----------
    discretised : the scene with a scheme that moves no mass. parts : matrices of its substructures, full dofs.
    vibration : stiffness and mass (n, n) of the dofs that are left. expansion : (n_full, n) from these to the full
        dofs. damping : (n_full, n_full) of bodies and viscous joints, N s m-1. remarks : how each interface was taken.
        to_ground : (n_full, n_full) the part of springs and layers between bodies and ground in the stiffness, N m-1.
    """

    discretised: DiscretisedProblem
    parts: Parts
    vibration: Vibration
    expansion: sp.csr_array
    damping: sp.csr_array
    remarks: tuple[str, ...]
    to_ground: sp.csr_array

    @staticmethod
    def of(
        scene: Scene, joints: Joints, pressed: Mapping[str, np.ndarray], problem: DiscretisedProblem | None = None
    ) -> JoinedAssembly:
        """The assembly of a scene; ``pressed`` : (n_point,) points that are closed, by interface; the others by their
        gap. ``problem`` : the scene by ``without_scheme``, made where None. Errors as for ``vibration_modes``."""
        discretised = without_scheme(scene) if problem is None else problem
        models = {m.name: m for c in discretised.classes for m in c.members}
        parts = Parts.of([models[name] for name in discretised.bodies])
        rows, springs, dashpots, remarks = [sp.csr_array((0, parts.n))], [], [], []
        to_ground = sp.csr_array((parts.n, parts.n))
        for unit in discretised.units:
            kept, stiffness, remark = _joint(unit, joints, parts, pressed.get(unit.name))
            if unit.name in pressed and unit.behaviour.opens and scene.bolt:
                remark += " when the bolts are tight"
            rows += [] if kept is None else [kept]
            springs += [] if stiffness is None else [stiffness]
            to_ground = to_ground if stiffness is None or not unit.against_ground else to_ground + stiffness
            remarks.append(f"{unit.name} ({unit.behaviour.name}): {remark}")
            if isinstance(unit.behaviour, ViscousJoint):
                viscosity = [unit.behaviour.normal_viscosity, unit.behaviour.tangential_viscosity]
                every = np.ones(unit.geometry.n_point, dtype=bool)
                dashpots.append(_layer(unit, parts, np.repeat(viscosity, [1, 2]), every))
        if joints == "open":
            # g g^T / k: bolts without tension let their shanks slide
            springs += [-parts.of_body(cut.table.substructure, cut.softening()) for cut in discretised.cuts.values()]
        stiffness = sum(springs, parts.stiffness)
        expansion, left = kept_together(sp.csr_array(sp.vstack(rows)), parts.expansion)
        k, m = (sp.csr_array(expansion.T @ matrix @ expansion) for matrix in (stiffness, parts.mass))
        # constraints that could not be eliminated are springs, far stiffer than the bodies
        if left.shape[0]:
            weight = _STIFF * float(k.diagonal().max())
            k = sp.csr_array(k + weight * (left.T @ left))
        vibration = Vibration(k, m, shift=_shift(discretised, parts), dense=0 if left.shape[0] else None)
        damping = sum(dashpots, parts.damping)
        return JoinedAssembly(discretised, parts, vibration, expansion, damping, tuple(remarks), to_ground)

    def damping_of(self, full: Array) -> Array:
        """Phi^T C Phi (m, m) of motions (n_full, m), modal damping of bodies included where it has a limit."""
        projected: Array = full.T @ (self.damping @ full)
        for name, model in self.parts.models.items():
            if model.modal_rows is not None:
                rates = model.modal_rows @ full[self.parts.where[name]]
                projected += rates.T @ rates
        return projected

    def modal_drag(self, full: Array) -> Array:
        """Forces (n_full,), N s m-1, of the modal damping of bodies with a limit in a motion (n_full,)."""
        forces = np.zeros(self.parts.n)
        for name, model in self.parts.models.items():
            if model.modal_rows is not None:
                own = self.parts.where[name]
                rates = model.modal_rows @ full[own]
                # of rigid motions: round-off
                size = np.linalg.norm(model.modal_rows) * np.linalg.norm(full[own])
                forces[own] = model.modal_rows.T @ np.where(np.abs(rates) > _UNMOVED * size, rates, 0.0)
        return forces

    def nearly_closed(self, pressed: Mapping[str, np.ndarray], state: InitialState | None) -> dict[str, Array]:
        """Gaps (n_point,), m, of the points that are nearly closed, NaN at all others, by interface that has some.

        ``pressed`` : points that are closed, by interface, of the others those whose gap is. ``state`` : of the start,
        None for the bodies as they are meshed.
        """
        nodes = np.concatenate([body.mesh.nodes for body in self.discretised.bodies.values()])
        largest, near = _NEAR * float(np.ptp(nodes, axis=0).max()), {}
        for unit in self.discretised.units:
            if not unit.behaviour.opens:
                continue
            gap = start_gap(unit, self.parts.models, {} if state is None else state.displacement)
            closed = pressed.get(unit.name, _touching(unit))
            # a point that touches without pressure is open by round-off
            open_by = np.where(closed | (gap > largest), np.nan, np.where(gap > _ROUND_OFF * largest, gap, 0.0))
            if not np.isnan(open_by).all():
                near[unit.name] = open_by
        return near

    def frequencies(self, count: int) -> Array:
        """The lowest natural frequencies (count,), Hz, rigid motions among them as 0; NaN where there are fewer."""
        omega = self.modes(count).omega[:count]
        return np.concatenate([omega / (2 * np.pi), np.full(count - len(omega), np.nan)])

    def modes(self, count: int) -> Modes:
        """Rigid motions and at least ``count`` elastic modes where there are as many."""
        values, vectors, n_rigid = _lowest(self.vibration, count)
        omega = np.sqrt(np.maximum(values, 0.0))  # round-off of rigid motions may be negative
        return Modes(self.vibration, self.expansion, vectors, omega, n_rigid)


def start_state(scene: Scene) -> InitialState | None:
    """The equilibrium with tight bolts under what acts at t = 0; None for a scene without bolts and static start."""
    if not (scene.bolt or scene.time.start.type == "static"):
        return None
    discretised = discretise(scene)
    return tightened(discretised, {}) if scene.time.quasi_static else starting_equilibrium(discretised, {})


def pressed_points(scene: Scene) -> dict[str, np.ndarray]:
    """(n_point,) whether the points of each interface are under pressure when the bolts are tight and what acts at
    t = 0 does; empty for a scene without bolts and static start."""
    state = start_state(scene)
    return {} if state is None else pressed_of(state)


def pressed_of(state: InitialState) -> dict[str, np.ndarray]:
    """(n_point,) whether the points of each interface are under pressure in a state."""
    # local frames, the normal first; pressure is negative on side E
    return {name: traction[:, 0] < 0.0 for name, traction in state.traction.items()}


@dataclass(frozen=True)
class Parts:
    """Matrices of all substructures side by side, full dofs; ``where``: their slices; ``models`` by name."""

    models: dict[str, SubstructureModel]
    where: dict[str, slice]
    stiffness: sp.csr_array
    mass: sp.csr_array
    damping: sp.csr_array
    expansion: sp.csr_array

    @staticmethod
    def of(models: Sequence[SubstructureModel]) -> Parts:
        """The parts in the order given."""
        where, _ = consecutive({m.name: m.n_full for m in models})
        none = sp.csr_array
        of_each = [
            (m.stiffness, m.inertia, none((m.n_full, m.n_full)) if m.damping is None else m.damping, m.expansion)
            for m in models
        ]
        blocks = [sp.csr_array(sp.block_diag(matrices, format="csr")) for matrices in zip(*of_each, strict=True)]
        return Parts({m.name: m for m in models}, where, *blocks)

    def of_body(self, name: str, matrix: sp.csr_array) -> sp.csr_array:
        """A matrix (n_full, n_full) of a substructure among those of all, (n, n)."""
        block, first = sp.coo_array(matrix), self.where[name].start
        place = tuple(index + first for index in block.coords)
        return sp.csr_array(sp.coo_array((block.data, place), shape=(self.n, self.n)))

    @property
    def n(self) -> int:
        """Number of full dofs."""
        return int(self.expansion.shape[0])

    @cached_property
    def translations(self) -> Array:
        """Rigid translations of all bodies along x, y and z, (n, 3)."""
        moved = []
        for model in self.models.values():
            n_node = (model.n_full if model.nodal is None else model.nodal.shape[0]) // 3
            nodes = np.tile(np.eye(3), (n_node, 1))
            moved.append(nodes if model.nodal is None else la.lstsq(model.nodal, nodes)[0])
        return np.concatenate(moved)

    @property
    def total_mass(self) -> float:
        """Mass of all substructures, kg."""
        return float(self.translations[:, 0] @ (self.mass @ self.translations[:, 0]))

    def jump(self, unit: InterfaceUnit, local: bool) -> sp.csr_array:
        """Displacement of the owner's side less that of the other at the points, (3 n_point, n), global axes or local
        frames."""
        traces = []
        for side, face in enumerate(unit.sides):
            trace = unit.geometry.local_trace(side, 3) if local else unit.geometry.traces[side]
            if trace is not None and (nodal := self.models[split_face(face)[0]].nodal) is not None:
                trace = sp.csr_array(trace @ nodal)
            traces.append(trace)
        return jump(unit, traces, self.where, self.n)


def _joint(
    unit: InterfaceUnit, joints: Joints, parts: Parts, pressed: np.ndarray | None
) -> tuple[sp.csr_array | None, sp.csr_array | None, str]:
    """Rows that the interface keeps at zero, stiffness of its layer (n, n), and a few words; ``pressed``: points that
    are closed by bolts, None without bolts."""
    kind, geometry = unit.behaviour.name, unit.geometry
    # along the rods: the normal components
    if isinstance(unit.behaviour, Rods):
        return parts.jump(unit, local=True)[::3], None, "joined"
    if kind == "perfect" or (unit.behaviour.opens and joints == "bonded"):
        return parts.jump(unit, local=False), None, "joined"
    if unit.behaviour.elastic and not unit.behaviour.opens:
        stiffness = np.repeat([unit.behaviour.normal_stiffness, unit.behaviour.tangential_stiffness], [1, 2])  # type: ignore[attr-defined]
        return None, _layer(unit, parts, stiffness, np.ones(geometry.n_point, dtype=bool)), "elastic layer"
    if not unit.behaviour.opens:
        return None, None, "open: it has no stiffness"
    if joints == "open":
        return None, None, "open"
    # of the bolts: closed is what is under pressure when they are tight, whatever gap meshes have
    closed = _touching(unit) if pressed is None else pressed
    sticks = kind == "no_slip" or bool(coulomb_coefficient(unit.behaviour))
    share = f"{int(closed.sum())} of {geometry.n_point} points closed"
    words = f"{'sticking' if sticks else 'free to slide'}, {share}"
    layer = getattr(unit.behaviour, "normal_stiffness", None)
    if layer is None and sticks and closed.all():
        return parts.jump(unit, local=False), None, words
    # a layer has its springs along the normal in the place of a rigid row
    components = np.array([layer is None, sticks, sticks])
    rows = parts.jump(unit, local=True)[np.flatnonzero((closed[:, None] & components).ravel())]
    spring = None if layer is None else _layer(unit, parts, np.array([layer, 0.0, 0.0]), closed)
    return sp.csr_array(rows), spring, words


def _touching(unit: InterfaceUnit) -> NDArray[np.bool_]:
    """(n_point,) whether the points of an interface are closed as they are meshed."""
    closed: NDArray[np.bool_] = unit.geometry.gap <= _CLOSED * np.sqrt(unit.geometry.areas.mean())
    return closed


def _layer(unit: InterfaceUnit, parts: Parts, stiffness: Array, points: np.ndarray) -> sp.csr_array:
    """Matrix (n, n) of springs or dashpots per area (3,), N m-3 or N s m-3, in the local frames of some points."""
    jump = parts.jump(unit, local=True)
    weights = (unit.geometry.areas * points)[:, None] * stiffness
    return sp.csr_array(jump.T @ sp.diags_array(weights.ravel()) @ jump)


def _shift(discretised: DiscretisedProblem, parts: Parts) -> float:
    """Shift of the eigenvalues, s-2: far below the first elastic one, far above round-off."""
    bodies = discretised.bodies.values()
    slowest = min(body.shape.elasticity.wave_speeds[1] for body in bodies)
    places = np.concatenate([body.mesh.nodes for body in bodies])
    # point masses slow light bodies down
    x = slice(0, None, 3)
    added = sum(float(body.added.matrix[x, x].sum()) for body in bodies if body.added is not None)
    own = max(1.0 - added / parts.total_mass, 1e-12)
    return float(own * (2 * np.pi * _SLOWEST * slowest / np.ptp(places, axis=0).max()) ** 2)


def _lowest(vibration: Vibration, count: int) -> tuple[Array, Array, int]:
    """Eigenvalues and vectors, rigid motions first, at least ``count`` elastic ones where there are as many; number of
    rigid motions."""
    # an upper estimate of rigid motions: more eigenvalues than needed cost little
    separate = connected_components(vibration.stiffness, directed=False)[0]
    wanted = count + 6 * min(separate, 50)  # each separate part may have six rigid motions
    while True:
        # Lanczos finds n - 1 at most
        wanted = min(wanted, vibration.n - 1)
        rigid, values, vectors = vibration.modes(wanted)
        if len(values) >= count or wanted >= vibration.n - 1:
            break
        wanted += count - len(values) + 6
    # small problems give all of them
    values, vectors = values[:count], vectors[:, :count]
    return np.concatenate([np.zeros(rigid.shape[1]), values]), np.hstack([rigid, vectors]), rigid.shape[1]


def _named(
    joined: JoinedAssembly,
    modes: Modes,
    damping: ModalDamping | None,
    joints: str,
    near: Mapping[str, Array],
    closed: Array | None,
) -> VibrationModes:
    """The modes by substructure, the largest nodal displacement of each 1; ``near``, ``closed`` : of
    ``VibrationModes``."""
    parts, scene = joined.parts, joined.discretised.scene
    full, omega, shapes = modes.expansion @ modes.vectors, modes.omega, {}
    for name, model in parts.models.items():
        own = full[parts.where[name]]
        own = own if model.nodal is None else model.nodal @ own
        shapes[name] = own.T.reshape(len(omega), len(own) // 3, 3)
    size = np.max([np.linalg.norm(s, axis=2).max(axis=1) for s in shapes.values()], axis=0)
    # the modal mass belongs to the scaled shape
    modal = np.einsum("im,im->m", full, parts.mass @ full) / size**2
    pulled = parts.mass @ parts.translations
    participation = (full.T @ pulled) / (size * modal)[:, None]
    return VibrationModes(
        scene=scene.text(),
        name=scene.name,
        joints=joints,
        frequency=omega / (2 * np.pi),
        rigid=np.arange(len(omega)) < modes.n_rigid,
        modal_mass=modal,
        participation=participation,
        mass=parts.total_mass,
        shapes={name: shape / size[:, None, None] for name, shape in shapes.items()},
        meshes=joined.discretised.info,
        remarks=joined.remarks,
        damping=damping,
        units=scene.unit_system,
        near=near,
        frequency_closed=closed,
    )


_MODES: Final = rows(
    """
    frequency  | Hz | mode | natural frequency, 0 for rigid motions
    frequency_closed | Hz | mode | natural frequency with the nearly closed points closed as well
    rigid      | -  | mode | whether the mode is a rigid motion | | elastic rigid
    modal_mass | kg | mode | modal mass | of the shape whose largest nodal displacement is 1
    participation | 1 | mode component | participation factor | of that shape, for a base that moves along x, y, z
    effective_mass | kg | mode component | effective mass | for a base that moves along x, y, z
    """,
    {"rigid": lambda modes: modes.rigid.astype(np.int8)},
)
"""Of ``VibrationModes``."""
_DAMPING: Final = rows(
    """
    scheme_damping | 1 | mode | damping ratio of the time scheme in a run with the step of the scene \
        | share of critical damping
    landing_damping | 1 | mode | damping ratio of the viscous layer at faces that may open | share of critical damping
    body_damping | 1 | mode | damping ratio of bodies, dampers, viscous joints, absorbing faces, wave ports \
        | share of critical damping
    """,
    {
        "scheme_damping": attrgetter("scheme"),
        "landing_damping": attrgetter("landing"),
        "body_damping": attrgetter("bodies"),
    },
)
"""Of their ``ModalDamping``."""
_SHAPE: Final = rows(
    "shape | 1 | mode node component | displacement in the mode, largest nodal displacement of the assembly 1"
)["shape"]


@dataclass(frozen=True)
class VibrationModes(Stored):
    """Modes of an assembly, undamped, and the damping ratio of each in a run.

    Attributes
    ----------
    scene, name : text and name of the scene. joints : how interfaces that may open were taken.
    frequency : (n_mode,), Hz, 0 for rigid motions, which come first. rigid : (n_mode,) whether it is one.
    modal_mass : (n_mode,), kg, with shapes whose largest nodal displacement is 1.
    participation : (n_mode, 3), of these shapes for a base that moves along x, y, z. mass : of the assembly, kg.
    shapes : (n_mode, n_node, 3) by substructure. meshes : of the substructures. remarks : on every interface.
    damping : ratios in a run with the time scheme and the step of the scene; None where the scene has no inertia.
    units : system of units of the scene. near : gaps (n_point,), m, of nearly closed points, NaN at all others, by
    interface that has some. frequency_closed : (n_mode,), Hz, with these points closed as well, rigid motions among
    them, NaN where there are fewer modes; None where no point is nearly closed.
    """

    scene: str
    name: str
    joints: str
    frequency: Array
    rigid: NDArray[np.bool_]
    modal_mass: Array
    participation: Array
    mass: float
    shapes: Mapping[str, Array]
    meshes: Mapping[str, SubstructureInfo]
    remarks: tuple[str, ...]
    damping: ModalDamping | None = None
    units: UnitSystem = SI
    near: Mapping[str, Array] = field(default_factory=dict)
    frequency_closed: Array | None = None

    @property
    def n_rigid(self) -> int:
        """Number of rigid motions."""
        return int(self.rigid.sum())

    @property
    def effective_mass(self) -> Array:
        """(n_mode, 3), kg, for a base that moves along x, y, z: modal mass times the square of the participation."""
        return self.modal_mass[:, None] * self.participation**2

    def lines(self) -> list[str]:
        """Text: the joints, and a table of the modes."""
        head = f"{self.name}: joints {self.joints}, {self.n_rigid} rigid motion(s), {int((~self.rigid).sum())} mode(s)"
        ratios = {} if self.damping is None else self.damping.columns()
        rises = ["if closed"] if self.rises else []
        rows: list[tuple[str, ...]] = [
            ("mode", "frequency", *rises, "modal mass", *ratios, "moves most", "mean squares along x, y, z", _EFFECTIVE)
        ]
        if self.n_rigid:
            number = f"1 to {self.n_rigid}" if self.n_rigid > 1 else "1"
            carried = self._shares(self.effective_mass[: self.n_rigid].sum(axis=0))
            beside = ["-"] * (len(rows[0]) - 3 - len(rises))
            rows.append((number, "rigid", *self._if_closed(slice(self.n_rigid)), *beside, carried))
        for i in range(self.n_rigid, len(self.frequency)):
            largest = {name: float(np.linalg.norm(shape[i], axis=1).max()) for name, shape in self.shapes.items()}
            squares = sum(np.square(shape[i]).sum(axis=0) for shape in self.shapes.values())
            shares = ", ".join(f"{100 * share:.0f} %" for share in squares / np.sum(squares))
            carried = self._shares(self.effective_mass[i])
            text = f"{self.frequency[i]:.5g} Hz"
            moves = max(largest, key=lambda name: largest[name])
            damped = [f"{ratio[i]:.2g}" if abs(ratio[i]) > _NO_DAMPING else "0" for ratio in ratios.values()]
            rows.append(
                (
                    f"{i + 1}",
                    text,
                    *self._if_closed(slice(i, i + 1)),
                    readable(self.modal_mass[i], self.units.label("kg"), 3),
                    *damped,
                    moves,
                    shares,
                    carried,
                )
            )
        weight = readable(self.mass, self.units.label("kg"), 4)
        total = f"effective masses of these modes: {self._shares(self.effective_mass.sum(axis=0))} of {weight}"
        top = [head, *(f"  {remark}" for remark in self.remarks), ""]
        return [*top, *aligned(rows), total, *self._near_lines(), *self._damping_lines()]

    @property
    def rises(self) -> bool:
        """Whether a frequency is another with the nearly closed points closed."""
        closed = self.frequency_closed
        return closed is not None and bool((~(closed <= (1.0 + _SAME) * self.frequency))[~self.rigid].any())

    def _if_closed(self, modes: slice) -> list[str]:
        """Cell of some modes in the column of the frequencies with the nearly closed points closed; none without
        column."""
        if not self.rises or self.frequency_closed is None:
            return []
        closed = self.frequency_closed[modes]
        largest = float(closed.max())
        if np.isnan(largest):
            return ["none"]
        return [f"{'up to ' if len(closed) > 1 else ''}{largest:.5g} Hz" if largest > 0.0 else "rigid"]

    def _near_lines(self) -> list[str]:
        """Which points are nearly closed, by how much, and what it means for the frequencies."""
        if not self.near:
            return []
        places, metre = [], self.units.label("m")
        for name, gap in self.near.items():
            least, most = (readable(float(f(gap)), metre, 3) for f in (np.nanmin, np.nanmax))
            size = f"{least} to {most}" if least != most else most
            places.append(f"{name} {int((~np.isnan(gap)).sum())} points by {size}")
        text = f"nearly closed, open by less than {_NEAR:g} of the size of the assembly: {', '.join(places)}"
        if not self.rises:
            return ["", f"{text}; closed, they change no frequency by more than {100 * _SAME:g} %"]
        rule = "a vibration that closes them in a part of its period rings between both frequencies"
        return ["", f"{text}; with them closed: column 'if closed'; {rule}"]

    def _shares(self, masses: Array) -> str:
        """Effective masses (3,) as shares of the mass of the assembly."""
        return ", ".join(
            f"{100 * share:.3g} %" for share in np.where(masses > _NO_MASS * self.mass, masses, 0.0) / self.mass
        )

    def _damping_lines(self) -> list[str]:
        """Scheme and step that the damping ratios are of, and what lowers them."""
        if self.damping is None:
            return ["", "no damping ratios: a quasi-static run has no inertia"]
        step = readable(self.damping.step, "s", 4)
        what = f"damping, % of critical, in a run with steps of {step} and time scheme {self.damping.time_scheme}"
        return ["", what, *([self.damping.remedy] if self.damping.remedy else [])]

    def groups(self) -> dict[str, StoredGroup]:
        """Groups by path: ``modes`` and one for every substructure with its shapes and mesh."""
        number = np.arange(1, len(self.frequency) + 1, dtype=np.int32)
        attrs: dict[str, object] = {"joints": self.joints, "interfaces": "\n".join(self.remarks), "mass": self.mass}
        stored = columns(_MODES, self)
        if self.damping is not None:
            stored += columns(_DAMPING, self.damping)
            attrs |= {"time_scheme": self.damping.time_scheme, "time_step": self.damping.step}
        along = named(LABELS, {"mode": number, "component": AXES})
        root = root_attributes("natural frequencies and shapes", self.name, self.scene)
        groups = {"/": StoredGroup({}, attrs=root), "/modes": StoredGroup.of(stored, along, attrs)}
        for name, shape in self.shapes.items():
            groups[f"/substructures/{name}"] = _shapes(shape, number, self.meshes[name])
        return in_units(groups, self.units)

    def export(self, folder: str | Path) -> Path:
        """Write files for ParaView, in which the number of the mode stands in the place of the time; the .pvd file.

        Raises
        ------
        ResultsError : the folder cannot be used.
        """
        bodies = {path: group for path, group in self.groups().items() if path.startswith("/substructures/")}
        played = {path: group.dataset().rename(mode="time") for path, group in bodies.items()}
        return export_vtu(xr.DataTree.from_dict(played), folder)


def _shapes(shape: Array, number: NDArray[np.int32], mesh: SubstructureInfo) -> StoredGroup:
    """Group of one substructure: its shapes and its mesh."""
    along = [*named(LABELS, {"mode": number, "component": AXES}), *columns(NODES, mesh)]
    group = StoredGroup.of([(_SHAPE, shape), *columns(MESH, mesh)], along)
    describe_mesh(group, mesh.cell_type, "mode")
    return group
