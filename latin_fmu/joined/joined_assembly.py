"""An assembly whose joints are linear: matrices of its bodies side by side, what joints keep together, modes.

Each row that joints keep at zero gives one dof by the others, those that depend on each other as many as they determine
(``tied_assembly.eliminated``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..assembly.body import consecutive
from ..assembly.initial_state import InitialState
from ..assembly.merged_assembly import jump
from ..assembly.problem import DiscretisedProblem
from ..assembly.start_contacts import start_gap
from ..interface import Rods
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, InterfaceUnit
from ..laws.maxwell_joint import MaxwellJoint
from ..laws.viscous_joint import ViscousJoint
from ..propagator import SubstructureModel
from ..propagator.reduction import orthonormal_to
from ..propagator.vibration import Vibration
from ..scene.fields import split_face
from ..time_scheme import MaxwellBranches
from .dynamic_stiffness import BranchedStiffness, Complex, ProjectedStiffness, eigenvalues, strained_bodies
from .hierarchical_dofs import HierarchicalDofs
from .modal_damping import Modes
from .tied_assembly import eliminated, side_by_side

Joints = Literal["sticking", "open", "bonded"]
_UNMOVED = 1e-9  # of a mode of a body, whose rate is round-off
_NEAR = 1e-4  # of the size of the assembly: larger gaps are open
_ROUND_OFF = 1e-9  # of this, a gap that is none
_NO_PRESSURE = 1e-12  # of the stress that the displacements of a body would be, stretched
_CLOSED = 1e-6  # gaps below this share of the spacing of the points are closed
_SLOWEST = 0.01  # shift of the eigenvalues: this share of shear wave speed over size of the assembly, in Hz


@dataclass(frozen=True)
class JoinedAssembly:
    """Stiffness and mass of an assembly whose joints are linear.

    Attributes
    ----------
    discretised : the scene with a scheme that moves no mass. parts : matrices of its substructures, full dofs.
    vibration : stiffness and mass (n, n) of the dofs that are left. expansion : (n_full, n) from these to the full
        dofs. damping : (n_full, n_full) of bodies and viscous joints, N s m-1. strained : stiffnesses whose springs
        relax, of bodies and Maxwell joints, full dofs. remarks : how each interface was taken.
        to_ground : (n_full, n_full) the part of springs and layers between bodies and ground in the stiffness, N m-1;
        relaxing_to_ground : of ``strained``.
    """

    discretised: DiscretisedProblem
    parts: Parts
    vibration: Vibration
    expansion: sp.csr_array
    damping: sp.csr_array
    strained: tuple[BranchedStiffness, ...]
    remarks: tuple[str, ...]
    to_ground: sp.csr_array
    relaxing_to_ground: tuple[BranchedStiffness, ...]

    @staticmethod
    def of(discretised: DiscretisedProblem, joints: Joints, pressed: Mapping[str, np.ndarray]) -> JoinedAssembly:
        """The assembly of a problem by ``build.without_scheme``; ``pressed`` : (n_point,) points that are closed, by
        interface; the others by their gap."""
        models = {m.name: m for c in discretised.classes for m in c.members}
        parts = Parts.of([models[name] for name in discretised.bodies])
        rows = [sp.csr_array((0, parts.n))]
        springs = []
        dashpots = []
        remarks = []
        relaxing, grounded = list[BranchedStiffness](), list[BranchedStiffness]()
        to_ground = sp.csr_array((parts.n, parts.n))
        for unit in discretised.units:
            joint, stiffness, remark = _joint(unit, joints, parts, pressed.get(unit.name))
            if unit.name in pressed and unit.behaviour.opens and discretised.scene.bolt:
                remark += " when the bolts are tight"
            if joint is not None:
                rows += [joint]
            if stiffness is not None:
                springs += [stiffness]
            if not (stiffness is None or not unit.against_ground):
                to_ground = to_ground + stiffness
            remarks.append(f"{unit.name} ({unit.behaviour.name}): {remark}")
            if isinstance(unit.behaviour, MaxwellJoint):
                branch = MaxwellBranches((1.0,), (unit.behaviour.relaxation_time,))
                relaxing.append(BranchedStiffness(branch, _layer(unit, parts, _stiffness(unit), _every(unit))))
                if unit.against_ground:
                    grounded += relaxing[-1:]
            if isinstance(unit.behaviour, ViscousJoint):
                viscosity = [unit.behaviour.normal_viscosity, unit.behaviour.tangential_viscosity]
                dashpots.append(_layer(unit, parts, np.repeat(viscosity, [1, 2]), _every(unit)))
        if joints == "open":
            # g g^T / k: bolts without tension let their shanks slide
            springs += [-parts.of_body(cut.table.substructure, cut.softening()) for cut in discretised.cuts.values()]
        stiffness = sum(springs, parts.stiffness)
        hierarchical = HierarchicalDofs.of(discretised.units, parts.where, parts.expansion)
        expansion = _kept_together(sp.csr_array(sp.vstack(rows)), hierarchical.expanded(parts.expansion))
        k, m = (sp.csr_array(expansion.T @ matrix @ expansion) for matrix in (stiffness, parts.mass))
        vibration = Vibration(k, m, shift=_shift(discretised, parts))
        damping, strained = sum(dashpots, parts.damping), (*parts.strained, *relaxing)
        return JoinedAssembly(
            discretised, parts, vibration, expansion, damping, strained, tuple(remarks), to_ground, tuple(grounded)
        )

    def damping_of(self, full: Array) -> Array:
        """Phi^T C Phi (m, m) of motions (n_full, m), modal damping of bodies included where it has a limit."""
        projected: Array = full.T @ (self.damping @ full)
        for name, model in self.parts.models.items():
            if model.modal_rows is not None:
                rates = model.modal_rows @ full[self.parts.where[name]]
                projected += rates.T @ rates
        return projected

    def strained_of(self, full: Array) -> list[ProjectedStiffness]:
        """Stiffnesses whose springs relax in a basis of motions (n_full, m)."""
        return [part.projected(full) for part in self.strained]

    def eigenvalues(self, modes: Modes) -> Complex | None:
        """Eigenvalues s (n_mode,), s-1, of modes with the stiffness at their frequencies; None where nothing relaxes.

        Where materials differ the branches couple the modes: the basis gets the static responses to the forces that the
        bodies with branches exert in each mode, which are the first-order changes of the shapes.
        """
        if not self.strained:
            return None
        rigid, elastic = modes.vectors[:, : modes.n_rigid], modes.vectors[:, modes.n_rigid :]
        full = modes.expansion @ elastic
        forces = np.hstack([modes.expansion.T @ (part.stiffness @ full) for part in self.strained])
        size = np.linalg.norm(forces, axis=0)
        static = self.vibration.static(rigid, forces[:, size > 0.0] / size[size > 0.0])
        # orthogonal to the modes in K as in M
        added, squares = orthonormal_to(static, modes.vectors, self.vibration.mass, self.vibration.stiffness)
        omega = np.concatenate([modes.omega, np.sqrt(squares)])
        motions = modes.expansion @ np.hstack([modes.vectors, added])
        return eigenvalues(omega, self.damping_of(motions), self.strained_of(motions), len(modes.omega))

    def modal_drag(self, full: Array) -> Array:
        """Forces (n_full,), N s m-1, of the modal damping of bodies with a limit in a motion (n_full,)."""
        forces = np.zeros(self.parts.n)
        for name, model in self.parts.models.items():
            if model.modal_rows is not None:
                part = self.parts.where[name]
                rates = model.modal_rows @ full[part]
                # of rigid motions: round-off
                size = np.linalg.norm(model.modal_rows) * np.linalg.norm(full[part])
                forces[part] = model.modal_rows.T @ np.where(np.abs(rates) > _UNMOVED * size, rates, 0.0)
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
            closed = pressed.get(unit.name, touching(unit))
            # a point that touches without pressure is open by round-off
            open_by = np.where(closed | (gap > largest), np.nan, np.where(gap > _ROUND_OFF * largest, gap, 0.0))
            if not np.isnan(open_by).all():
                near[unit.name] = open_by
        return near

    def frequencies(self, count: int) -> Array:
        """The lowest natural frequencies (count,), Hz, rigid motions among them as 0; NaN where there are fewer."""
        modes = self.modes(count)
        damped = self.eigenvalues(modes)
        omega = (modes.omega if damped is None else np.abs(damped))[:count]
        return np.concatenate([omega / (2 * np.pi), np.full(count - len(omega), np.nan)])

    def modes(self, count: int) -> Modes:
        """Rigid motions and at least ``count`` elastic modes where there are as many."""
        values, vectors, n_rigid = _lowest(self.vibration, count)
        omega = np.sqrt(np.maximum(values, 0.0))  # round-off of rigid motions may be negative
        return Modes(self.vibration, self.expansion, vectors, omega, n_rigid)


def _kept_together(rows: sp.csr_array, expansion: sp.csr_array) -> sp.csr_array:
    """Expansion (n_full, n) that keeps the rows (n_row, n_full) at zero."""
    none = sp.csr_array((rows.shape[0], 0))
    eliminated_rows = eliminated(sp.csr_array(rows @ expansion), none.toarray(), none)
    return sp.csr_array(expansion @ eliminated_rows.q_part)


def pressed_of(discretised: DiscretisedProblem, state: InitialState | None) -> dict[str, np.ndarray]:
    """(n_point,) whether the points of each interface are under pressure in a state, beyond round-off of the stress of
    its bodies; empty without a state."""
    if state is None:
        return {}
    stress = 0.0
    for name, body in discretised.bodies.items():
        moved = state.displacement.get(name)
        if moved is not None and not body.rigid:
            strain = float(np.abs(moved).max(initial=0.0)) / body.mesh.size
            stress = max(stress, max(body.shape.elasticity.young_moduli) * strain)
    # local frames, the normal first; pressure is negative on side E
    return {name: traction[:, 0] < -_NO_PRESSURE * stress for name, traction in state.traction.items()}


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
        blocks = [side_by_side(matrices) for matrices in zip(*of_each, strict=True)]
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

    @cached_property
    def strained(self) -> tuple[BranchedStiffness, ...]:
        """Stiffness of the bodies with Maxwell branches, full dofs."""
        return strained_bodies(self.models, self.where, self.n)

    def jump(self, unit: InterfaceUnit, local: bool) -> sp.csr_array:
        """Displacement of the owner's side less that of the other at the points, (3 n_point, n), global axes or local
        frames."""
        traces = []
        for side, face in enumerate(unit.sides):
            if local:
                trace = unit.geometry.local_trace(side, 3)
            else:
                trace = unit.geometry.traces[side]
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
    if isinstance(unit.behaviour, MaxwellJoint):
        return None, None, "open: its springs are relaxed"
    if unit.behaviour.elastic and not unit.behaviour.opens:
        return None, _layer(unit, parts, _stiffness(unit), _every(unit)), "elastic layer"
    if not unit.behaviour.opens:
        return None, None, "open: it has no stiffness"
    if joints == "open":
        return None, None, "open"
    # of the bolts: closed is what is under pressure when they are tight, whatever gap meshes have
    if pressed is None:
        closed = touching(unit)
    else:
        closed = pressed
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


def _stiffness(unit: InterfaceUnit) -> Array:
    """Stiffness per area (3,) of an elastic layer or Maxwell joint, N m-3."""
    law = unit.behaviour
    return np.repeat([law.normal_stiffness, law.tangential_stiffness], [1, 2])  # type: ignore[attr-defined]


def _every(unit: InterfaceUnit) -> np.ndarray:
    """All points of an interface."""
    return np.ones(unit.geometry.n_point, dtype=bool)


def touching(unit: InterfaceUnit) -> NDArray[np.bool_]:
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
    share = max(1.0 - added / parts.total_mass, 1e-12)
    return float(share * (2 * np.pi * _SLOWEST * slowest / np.ptp(places, axis=0).max()) ** 2)


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
