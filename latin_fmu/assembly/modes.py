"""Vibration modes of an assembly, and the damping that a run gives them.

Damping ratios of vibration modes in a run: of the time scheme, of the landing layer, of the bodies.

An undamped oscillator of angular frequency omega is marched by the scheme as x_{n+1} = G x_n, x = (u, v, a). For the
eigenvalue z of G that oscillates,

    zeta = -ln|z| / |ln z| = -ln|z| / sqrt(ln|z|^2 + arg(z)^2)

is its damping ratio, the logarithmic decrement of the march (Hughes, The Finite Element Method, 1987, section 9.3).
For small steps that is (a_f - a_m)(1 - a_f - a_m)^2 (omega dt)^3 / 8 with generalised alpha, of which HHT is the member
a_f = -alpha, a_m = 0, and (gamma - 1/2) omega dt / 2 with Newmark's schemes.

Joints that stay closed do not change it: the tractions of the new instant hold what they join together, with whatever
weight, so that each mode of the joined assembly is marched as one oscillator.

Matrices C of velocities give, to first order, for a mode phi of the mass M that the scheme takes,

    zeta = phi^T C phi / (2 omega phi^T M phi),    K phi = omega^2 M phi

or what the weights of the scheme make of it. C is the viscosity of the layer of elements at faces that may open
(``assembly.models.contact_layers``), closed or not and in every direction, or the damping of the bodies: Rayleigh's and
that of absorbing faces and wave ports. Not in it: dampers between bodies, viscous joints, friction, modal damping.

Natural frequencies and shapes of an assembly without loads, its joints open, sticking or bonded.

    K phi = omega^2 M phi    on the motions with C phi = 0

C holds what joints keep together: all components of perfect interfaces; of contacts, at points that are closed at the
start, the normal component and, with friction, the tangential ones (sticking); all components at all points (bonded).
In a scene with bolts, or with a static start, those points are closed that are under pressure when the bolts are tight
and what acts at t = 0 does. With open joints bolts have no tension, and their shanks are free to slide in the thread
(``bolts``).
Springs of layers add to K. Held and prescribed directions do not move.

Rows of C with one or two entries (nodes against nodes) make dofs one, or hold them: exact. Of other rows (mortar) each
gives one dof by the others (``merged_assembly.tied``; where they depend on each other, by a dense elimination). Only
a large number of dependent rows becomes springs ``_STIFF`` times as stiff as the stiffest dof.

The modes are undamped. The damping ratio that a run of the scene gives each of them is added (below), and how a base
that moves along an axis excites it: with the rigid translation r of all bodies, held dofs included,

    Gamma = phi^T M r / (phi^T M phi),    effective mass = (phi^T M r)^2 / (phi^T M phi)

for the phi of ``shapes``. The effective masses of all modes add up to the mass that the supports leave free to move.

Results are a table, files for ParaView, and the groups of a file::

    /                      provenance and scene, as attributes
    /modes                 frequency, rigid, modal_mass, scheme_damping, landing_damping, body_damping (mode),
                           participation, effective_mass (mode, component); joints, interfaces, mass, time_scheme and
                           time_step as attributes
    /substructures/<name>  shape (mode, node, component), and the mesh
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from ..machine import provenance
from ..propagator import SubstructureModel
from ..propagator.model import diagonal_matrix
from ..propagator.reduction import Vibration
from ..results.dataset import datatree
from ..results.files import write_groups
from ..results.groups import CONVENTIONS, SCHEMA_VERSION, StoredGroup, describe_mesh, in_units
from ..results.quantities import AXES, LABELS, MESH, NODES, columns, named, rows
from ..results.summary import aligned, readable
from ..results.vtk import export_vtu
from ..scene import settings as tables
from ..scene.fields import split_face
from ..scene.schema import Scene
from ..scene.settings import GeneralizedAlphaTable, GivenStart, ReducedPropagatorTable
from ..scene.units import SI, UnitSystem
from ..time_scheme import HHT, GeneralizedAlpha, QuasiStatic, TimeScheme
from ..time_scheme.scheme import coefficients
from .body import consecutive
from .build import discretise, starting_equilibrium
from .initial_state import InitialState
from .merged_assembly import jump, kept_together
from .models import chosen_scheme, contact_layers
from .problem import DiscretisedProblem
from .statics import tightened

LIMIT: Final = 5e-5
"""Numerical damping ratio above which there is a sentence on what lowers it; joints have 1e-3 to 1e-2 of their own."""
_SAME: Final = 1e-12  # changes of the mass below it are round-off
_ROUNDS: Final = 3  # of inverse iteration
_PARTS: Final = tuple(sorted(2**a * 5**b for a in range(7) for b in range(3) if 1 < 2**a * 5**b <= 100))
"""Numbers of parts that a step is cut into: the new one has few digits where the old one has."""


@dataclass(frozen=True)
class ModalDamping:
    """Damping ratios of modes in a run with the time scheme and the step of the scene.

    Attributes
    ----------
    time_scheme : name of the scheme, and why where it is chosen automatically. step : s.
    scheme : (n_mode,) ratio of the time scheme, of critical, 0 for rigid motions. landing : (n_mode,) of the viscous
        layer at faces that may open. bodies : (n_mode,) of Rayleigh damping, absorbing faces and wave ports.
    remedy : what lowers the numerical damping where it exceeds ``LIMIT``, else empty.
    """

    time_scheme: str
    step: float
    scheme: Array
    landing: Array
    bodies: Array
    remedy: str

    @property
    def numerical(self) -> Array:
        """(n_mode,) damping ratio of the time scheme and of the landing layer together."""
        return self.scheme + self.landing

    def columns(self) -> dict[str, Array]:
        """Columns of the table by heading, % of critical damping; that of the bodies where they have damping."""
        shown = {"scheme": self.scheme, "landing layer": self.landing}
        shown |= {"bodies": self.bodies} if self.bodies.any() else {}
        return {f"{name}, %": 100 * ratio for name, ratio in shown.items()}


@dataclass(frozen=True)
class RunMatrices:
    """What a run of a scene marches, the substructures side by side, full dofs.

    Attributes
    ----------
    scene : of the run. scheme, reason : its time scheme, and why where it is chosen automatically. dt : step, s.
    mass : (n_full, n_full), kg, as the scheme takes it. viscosity : of the landing layers, N s m-1. damping : of the
        bodies, N s m-1.
    """

    scene: Scene
    scheme: TimeScheme
    reason: str
    dt: float
    mass: sp.csr_array
    viscosity: sp.csr_array
    damping: sp.csr_array


@dataclass(frozen=True)
class Modes:
    """Modes of a joined assembly.

    Attributes
    ----------
    vibration : stiffness and mass (n, n) of its dofs. expansion : (n_full, n) from these to the full dofs.
    vectors : (n, n_mode) modes, mass-orthonormal, the rigid ones first. omega : (n_mode,) angular frequencies, s-1, 0
        of the ``n_rigid`` rigid motions.
    """

    vibration: Vibration
    expansion: sp.csr_array
    vectors: Array
    omega: Array
    n_rigid: int


def amplification_matrix(scheme: TimeScheme, omega: float, dt: float, ratio: float = 0.0) -> Array:
    """One step of an oscillator without load: matrix (3, 3) on (u, v/omega, a/omega^2), ``kernels.substructure``.

    omega : angular frequency, s-1. dt : step, s. ratio : damping ratio of the oscillator itself, implicit schemes only.
    """
    c, operator = coefficients(scheme, dt), scheme.operator(dt)
    size = np.array([1.0, omega, omega**2])  # with it a small step is a rotation, whose eigenvalues are exact
    u, v, a = np.diag(size)
    u_free = u + c["u_v"] * v + c["u_a"] * a
    v_free = v + c["v_a"] * a
    damping = 2 * ratio * omega
    old, free = (-(omega**2) * x - damping * rate for x, rate in ((u, v), (u_free, v_free)))
    load = c["force_weight"] * free + (c["force_old"] - c["memory_weight"]) * old - c["mass_old"] * a
    a_new = load / (c["mass_weight"] + operator[1] * damping + operator[2] * omega**2)
    u_new = u_free + c["u_late"] * v_free + c["displacement_gain"] * a_new
    # u_late: explicit steps end their displacement with the new velocity
    v_new = v_free + c["velocity_gain"] * a_new
    matrix: Array = np.stack([u_new, v_new, a_new]) / size[:, None]
    return matrix


def scheme_damping(scheme: TimeScheme, omega: float, dt: float, ratio: float = 0.0) -> float:
    """Damping ratio of critical that an oscillator has in the march of a time scheme (module docstring).

    Parameters
    ----------
    omega : angular frequency, s-1, > 0. dt : step, s. ratio : damping ratio of the oscillator itself.

    Example
    -------
    >>> from latin_fmu.time_scheme import HHT, Newmark
    >>> round(scheme_damping(HHT(-0.1), 1.0, 0.5), 5), abs(round(scheme_damping(Newmark(), 1.0, 0.5), 9))
    (0.00113, 0.0)
    """
    values = np.linalg.eigvals(amplification_matrix(scheme, omega, dt, ratio)).astype(complex)
    oscillating = values[values.imag > 0.0]
    z = max(oscillating if len(oscillating) else values, key=abs)  # the others are parasitic, and decay faster
    logarithm = np.log(z)
    return float(-logarithm.real / abs(logarithm))


def run_matrices(
    scene: Scene, discretised: DiscretisedProblem, models: Mapping[str, SubstructureModel]
) -> RunMatrices | None:
    """What a run of the scene marches; None without inertia.

    Parameters
    ----------
    scene : with its time scheme. discretised : the same scene, with a scheme that moves no mass. models : of its
        substructures, in the order of the full dofs.
    """
    scene = discretised.scene.model_copy(update={"time": scene.time})  # with the interfaces found by the program
    scheme, reason = chosen_scheme(scene, discretised.bodies, discretised.units)
    if isinstance(scheme, QuasiStatic):
        return None
    layers = contact_layers(discretised.bodies, discretised.units, scheme, discretised.dt)
    blocks: list[tuple[sp.csr_array, ...]] = []
    for name, model in models.items():
        faces, none = layers.get(name), sp.csr_array((model.n_full, model.n_full))
        mass, viscosity = (model.inertia, None) if faces is None else (faces.mass, faces.viscosity)
        if scheme.explicit and faces is not None:
            mass = model.with_lumped_mass.inertia if faces.lumped is None else diagonal_matrix(faces.lumped)
        own = (mass, viscosity, model.damping)
        blocks.append(tuple(none if matrix is None else matrix for matrix in own))
    whole = (sp.csr_array(sp.block_diag(matrices, format="csr")) for matrices in zip(*blocks, strict=True))
    return RunMatrices(scene, scheme, reason, discretised.dt, *whole)


def modal_damping(matrices: RunMatrices, modes: Modes) -> ModalDamping:
    """Damping of modes in a run (module docstring)."""
    scheme, dt = matrices.scheme, matrices.dt
    omega, vectors = _marched(modes, matrices.mass)
    full, elastic = modes.expansion @ vectors, np.flatnonzero(omega > 0.0)
    of_scheme, of_layer, of_bodies = np.zeros((3, len(omega)))
    for ratio, matrix in ((of_layer, matrices.viscosity), (of_bodies, matrices.damping)):
        ratio[elastic] = (_squares(matrix, full) / (2 * np.maximum(omega, 1e-300)))[elastic]
    of_scheme[elastic] = [scheme_damping(scheme, float(w), dt) for w in omega[elastic]]
    for i in np.flatnonzero(of_layer):  # its velocities have the weights of the scheme
        of_layer[i] = scheme_damping(scheme, float(omega[i]), dt, float(of_layer[i])) - of_scheme[i]
    words = scheme.name + (f" ({matrices.reason})" if matrices.reason else "")
    remedy = _remedy(matrices.scene, scheme, dt, omega, of_scheme, of_layer)
    return ModalDamping(words, dt, of_scheme, of_layer, of_bodies, remedy)


def _marched(modes: Modes, mass: sp.csr_array) -> tuple[Array, Array]:
    """Angular frequencies (n_mode,) and modes (n, n_mode) of modal mass 1 with the mass (n_full, n_full) of the scheme,
    those closest to the given ones.

    Rayleigh-Ritz on the given modes and on what inverse iteration with the mass of the scheme adds to them: nodes
    without mass move otherwise than the consistent mass makes them.
    """
    vibration, given, n_rigid = modes.vibration, modes.vectors, modes.n_rigid
    moved = sp.csr_array(modes.expansion.T @ mass @ modes.expansion)
    change = (moved - vibration.mass) @ given
    # no node has lost its mass: the modes are those of the scheme
    if np.abs(change).max(initial=0.0) <= _SAME * np.abs(vibration.mass @ given).max(initial=0.0):
        return modes.omega, given
    basis, last = given, given[:, n_rigid:]
    for _ in range(_ROUNDS):
        response = vibration.static(given[:, :n_rigid], moved @ last)
        added = response - basis @ (basis.T @ (vibration.mass @ response))
        squares, directions = la.eigh(added.T @ (vibration.mass @ added))
        kept = squares > _SAME * _squares(vibration.mass, response).max(initial=0.0)
        last = added @ (directions[:, kept] / np.sqrt(squares[kept]))
        basis = np.hstack([basis, last])
    # the shapes of massless nodes alone have no frequency: the shifted stiffness stands in the place of the mass
    mass_of, stiffness_of = (basis.T @ (matrix @ basis) for matrix in (moved, vibration.stiffness))
    inverse, inside = la.eigh(mass_of, stiffness_of + vibration.shift * mass_of)
    moves = inverse > _SAME * inverse.max(initial=0.0)
    inverse, inside = inverse[moves], inside[:, moves]
    # of the combinations found that which each given mode is most like
    shares = (given.T @ (vibration.mass @ (basis @ inside))) ** 2 / np.square(inside).sum(axis=0)
    closest = np.argmax(shares, axis=1)
    omega = np.sqrt(np.maximum(1 / inverse[closest] - vibration.shift, 0.0))
    omega[:n_rigid] = 0.0  # what the shift leaves is round-off
    return omega, basis @ (inside[:, closest] / np.sqrt(inverse[closest]))


def _squares(matrix: sp.csr_array, phi: Array) -> Array:
    """phi^T A phi (n_mode,) of each mode (n_full, n_mode)."""
    squares: Array = np.einsum("im,im->m", phi, matrix @ phi)
    return squares


def _remedy(scene: Scene, scheme: TimeScheme, dt: float, omega: Array, of_scheme: Array, of_layer: Array) -> str:
    """A sentence on what lowers numerical damping above ``LIMIT``; empty where no mode has more."""
    total = of_scheme + of_layer
    above = np.flatnonzero(total > LIMIT)
    if not len(above):
        return ""
    worst = int(np.argmax(total))
    parts, largest = [], min(LIMIT, float(max(of_scheme.max(), of_layer.max())))
    # the larger part is named, and the other one where it is above the limit by itself
    if of_scheme.max() >= largest:
        parts.append(_lower_scheme(scene, scheme, dt, float(omega[np.argmax(of_scheme)])))
    if of_layer.max() >= largest:
        parts.append(_lower_layer(scene, dt, float(omega[worst]), float(of_scheme[worst])))
    where = f"mode {above[0] + 1}" if len(above) == 1 else f"{len(above)} modes, most in mode {worst + 1}"
    head = f"numerical damping above {_percent(LIMIT)} of critical in {where} ({_percent(float(total[worst]))})"
    return "; ".join([f"{head}: {parts[0]}", *parts[1:]])


def _lower_scheme(scene: Scene, scheme: TimeScheme, dt: float, omega: float) -> str:
    """What lowers the damping of the scheme: a shorter step, another parameter or scheme; with numbers for a mode."""
    # the order shows at steps that are short for the mode, which dt need not be
    slope = np.log2(scheme_damping(scheme, omega, dt / 8) / scheme_damping(scheme, omega, dt / 16))
    power = {1: "the step", 2: "the square of the step", 3: "the third power of the step"}.get(round(slope), "the step")
    words = f"that of the scheme falls with {power}"
    parts = next((n for n in _PARTS if scheme_damping(scheme, omega, dt / n) <= LIMIT), None)
    if parts is not None:
        given = scene.time.step is not None
        key = f"time.step = {dt / parts:.12g}" if given else f"time.instants = {parts * scene.time.n_step}"
        left = _percent(scheme_damping(scheme, omega, dt / parts))
        words += f" ({key} leaves {left}, with {parts} times as many steps)"
    if isinstance(scheme, GeneralizedAlpha):
        undamped = _keys(scene, scheme.landing_damping, 1.0)
        return f"{words}, and {undamped} has none, and damps nothing that the step does not resolve"
    if scheme.name != "hht":
        return f'{words}, and time.scheme = "hht" leaves {_percent(scheme_damping(HHT(), omega, dt))}'
    if isinstance(scene.solver.propagator, ReducedPropagatorTable):
        left = _percent(scheme_damping(HHT(-0.01), omega, dt))
        return f'{words}, and time.scheme = {{type = "hht", alpha = -0.01}} leaves {left}, and less damping of noise'
    left = _percent(scheme_damping(GeneralizedAlpha(), omega, dt))
    return f"{words}, and {_keys(scene, 0.0)} leaves {left}, but shifts frequencies: contact nodes have no mass"


def _lower_layer(scene: Scene, dt: float, omega: float, of_scheme: float) -> str:
    """What lowers the damping of the landing layer, and what that costs; ``of_scheme`` is the rest in the mode."""
    return (
        f"that of the landing layer is in proportion to landing_damping ({_keys(scene, 0.0)} leaves "
        f"{_percent(of_scheme)} in that mode, with peaks of landings up to 1.21 instead of 1.08 times the exact ones) "
        f'and falls with smaller elements at faces that may open; time.scheme = "hht" has no layer and leaves '
        f"{_percent(scheme_damping(HHT(), omega, dt))}, with peaks of landings that grow as the step shrinks"
    )


def _keys(scene: Scene, landing_damping: float, rho_inf: float | None = None) -> str:
    """The time scheme generalized_alpha as a scene has it, its spectral radius that of the scene where None."""
    table = scene.time.scheme
    own = table.rho_inf if isinstance(table, GeneralizedAlphaTable) else GeneralizedAlphaTable().rho_inf
    rho = own if rho_inf is None else rho_inf
    radius = "" if rho == GeneralizedAlphaTable().rho_inf else f"rho_inf = {rho:g}, "
    return f'time.scheme = {{type = "generalized_alpha", {radius}landing_damping = {landing_damping:g}}}'


def _percent(ratio: float) -> str:
    return f"{100 * ratio:.2g} %"


Joints = Literal["sticking", "open", "bonded"]
_STIFF: Final = 1e4
_NO_DAMPING = 1e-7  # %, round-off
_NO_MASS = 1e-6  # of the assembly, round-off
_EFFECTIVE: Final = "effective mass along x, y, z"
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
    pressed = pressed_points(scene) if joints == "sticking" else {}
    joined = JoinedAssembly.of(scene, joints, pressed)
    modes = joined.modes(count)
    matrices = run_matrices(scene, joined.discretised, joined.parts.models)
    damping = None if matrices is None else modal_damping(matrices, modes)
    return _named(joined, modes, damping, joints)


@dataclass(frozen=True)
class JoinedAssembly:
    """Stiffness and mass of an assembly whose joints are linear.

    Attributes
    ----------
    discretised : the scene with a scheme that moves no mass. parts : matrices of its substructures, full dofs.
    vibration : stiffness and mass (n, n) of the dofs that are left. expansion : (n_full, n) from these to the full
        dofs. remarks : how each interface was taken.
    """

    discretised: DiscretisedProblem
    parts: Parts
    vibration: Vibration
    expansion: sp.csr_array
    remarks: tuple[str, ...]

    @staticmethod
    def of(scene: Scene, joints: Joints, pressed: Mapping[str, np.ndarray]) -> JoinedAssembly:
        """The assembly of a scene; ``pressed`` : (n_point,) points that are closed, by interface; the others by their
        gap. Errors as for ``vibration_modes``."""
        plain = {"scheme": tables.HHTTable(), "quasi_static": False, "start": GivenStart()}
        discretised = discretise(scene.model_copy(update={"time": scene.time.model_copy(update=plain)}))
        models = {m.name: m for c in discretised.classes for m in c.members}
        parts = Parts.of([models[name] for name in discretised.bodies])
        rows, springs, remarks = [sp.csr_array((0, parts.n))], [], []
        for unit in discretised.units:
            kept, stiffness, remark = _joint(unit, joints, parts, pressed.get(unit.name))
            rows += [] if kept is None else [kept]
            springs += [] if stiffness is None else [stiffness]
            remarks.append(f"{unit.name} ({unit.behaviour.name}): {remark}")
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
        vibration = Vibration(k, m, shift=_shift(discretised), dense=0 if left.shape[0] else None)
        return JoinedAssembly(discretised, parts, vibration, expansion, tuple(remarks))

    def modes(self, count: int) -> Modes:
        """Rigid motions and at least ``count`` elastic modes where there are as many."""
        values, vectors, n_rigid = _lowest(self.vibration, self.vibration.stiffness, count)
        omega = np.sqrt(np.maximum(values, 0.0))  # round-off of rigid motions may be negative
        return Modes(self.vibration, self.expansion, vectors, omega, n_rigid)


def pressed_points(scene: Scene) -> dict[str, np.ndarray]:
    """(n_point,) whether the points of each interface are under pressure when the bolts are tight and what acts at
    t = 0 does; empty for a scene without bolts and static start."""
    if not (scene.bolt or scene.time.start.type == "static"):
        return {}
    discretised = discretise(scene)
    state = tightened(discretised, {}) if scene.time.quasi_static else starting_equilibrium(discretised, {})
    return {} if state is None else pressed_of(state)


def pressed_of(state: InitialState) -> dict[str, np.ndarray]:
    """(n_point,) whether the points of each interface are under pressure in a state."""
    return {name: traction[:, 0] < 0.0 for name, traction in state.traction.items()}


@dataclass(frozen=True)
class Parts:
    """Matrices of all substructures side by side, full dofs; ``where``: their slices; ``models`` by name."""

    models: dict[str, SubstructureModel]
    where: dict[str, slice]
    stiffness: sp.csr_array
    mass: sp.csr_array
    expansion: sp.csr_array

    @staticmethod
    def of(models: Sequence[SubstructureModel]) -> Parts:
        """The parts in the order given."""
        where, _ = consecutive({m.name: m.n_full for m in models})
        blocks = [
            sp.csr_array(sp.block_diag(matrices, format="csr"))
            for matrices in zip(*((m.stiffness, m.inertia, m.expansion) for m in models), strict=True)
        ]
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
        return None, _spring(unit, parts, stiffness, np.ones(geometry.n_point, dtype=bool)), "elastic layer"
    if not unit.behaviour.opens:
        return None, None, "open: it has no stiffness"
    if joints == "open":
        return None, None, "open"
    # of the bolts: closed is what is under pressure when they are tight, whatever gap meshes have
    closed = geometry.gap <= _CLOSED * np.sqrt(geometry.areas.mean()) if pressed is None else pressed
    sticks = kind == "no_slip" or bool(coulomb_coefficient(unit.behaviour))
    share = f"{int(closed.sum())} of {geometry.n_point} points closed"
    share += "" if pressed is None else " when the bolts are tight"
    words = f"{'sticking' if sticks else 'free to slide'}, {share}"
    layer = getattr(unit.behaviour, "normal_stiffness", None)
    if layer is None and sticks and closed.all():
        return parts.jump(unit, local=False), None, words
    components = np.array([layer is None, sticks, sticks])
    rows = parts.jump(unit, local=True)[np.flatnonzero((closed[:, None] & components).ravel())]
    spring = None if layer is None else _spring(unit, parts, np.array([layer, 0.0, 0.0]), closed)
    return sp.csr_array(rows), spring, words


def _spring(unit: InterfaceUnit, parts: Parts, stiffness: Array, points: np.ndarray) -> sp.csr_array:
    """Stiffness (n, n) of springs per area (3,), N m-3, in the local frames of some points."""
    jump = parts.jump(unit, local=True)
    weights = (unit.geometry.areas * points)[:, None] * stiffness
    return sp.csr_array(jump.T @ sp.diags_array(weights.ravel()) @ jump)


def _shift(discretised: DiscretisedProblem) -> float:
    """Shift of the eigenvalues, s-2: far below the first elastic one, far above round-off."""
    bodies = discretised.bodies.values()
    slowest = min(body.shape.elasticity.wave_speeds[1] for body in bodies)
    places = np.concatenate([body.mesh.nodes for body in bodies])
    return float((2 * np.pi * _SLOWEST * slowest / np.ptp(places, axis=0).max()) ** 2)


def _lowest(vibration: Vibration, stiffness: sp.csr_array, count: int) -> tuple[Array, Array, int]:
    """Eigenvalues and vectors, rigid motions first, at least ``count`` elastic ones where there are as many; number of
    rigid motions."""
    separate = connected_components(stiffness, directed=False)[0]
    wanted = count + 6 * min(separate, 50)  # each separate part may have six rigid motions
    while True:
        # Lanczos finds n - 1 at most
        wanted = min(wanted, vibration.n - 1)
        rigid, values, vectors = vibration.modes(wanted)
        if len(values) >= count or wanted >= vibration.n - 1:
            break
        wanted += count - len(values) + 6
    values, vectors = values[:count], vectors[:, :count]
    return np.concatenate([np.zeros(rigid.shape[1]), values]), np.hstack([rigid, vectors]), rigid.shape[1]


def _named(joined: JoinedAssembly, modes: Modes, damping: ModalDamping | None, joints: str) -> VibrationModes:
    """The modes by substructure, the largest nodal displacement of each 1."""
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
        mass=float(parts.translations[:, 0] @ pulled[:, 0]),
        shapes={name: shape / size[:, None, None] for name, shape in shapes.items()},
        meshes=joined.discretised.info,
        remarks=joined.remarks,
        damping=damping,
        units=scene.unit_system,
    )


_MODES: Final = rows(
    """
    frequency  | Hz | mode | natural frequency, 0 for rigid motions
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
    body_damping | 1 | mode | damping ratio of Rayleigh damping, absorbing faces and wave ports \
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
class VibrationModes:
    """Modes of an assembly, undamped, and the damping ratio of each in a run.

    Attributes
    ----------
    scene, name : text and name of the scene. joints : how interfaces that may open were taken.
    frequency : (n_mode,), Hz, 0 for rigid motions, which come first. rigid : (n_mode,) whether it is one.
    modal_mass : (n_mode,), kg, with shapes whose largest nodal displacement is 1.
    participation : (n_mode, 3), of these shapes for a base that moves along x, y, z. mass : of the assembly, kg.
    shapes : (n_mode, n_node, 3) by substructure. meshes : of the substructures. remarks : on every interface.
    damping : ratios in a run with the time scheme and the step of the scene; None where the scene has no inertia.
    units : system of units of the scene.
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
        rows: list[tuple[str, ...]] = [
            ("mode", "frequency", "modal mass", *ratios, "moves most", "mean squares along x, y, z", _EFFECTIVE)
        ]
        if self.n_rigid:
            number = f"1 to {self.n_rigid}" if self.n_rigid > 1 else "1"
            carried = self._shares(self.effective_mass[: self.n_rigid].sum(axis=0))
            rows.append((number, "rigid", *["-"] * (len(rows[0]) - 3), carried))
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
        return [*top, *aligned(rows), total, *self._damping_lines()]

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
        groups = {"/": self._root(), "/modes": StoredGroup.of(stored, along, attrs)}
        for name, shape in self.shapes.items():
            groups[f"/substructures/{name}"] = _shapes(shape, number, self.meshes[name])
        return in_units(groups, self.units)

    def _root(self) -> StoredGroup:
        return StoredGroup(
            {},
            attrs={
                **provenance(),
                "Conventions": CONVENTIONS,
                "schema_version": SCHEMA_VERSION,
                "title": f"{self.name}: natural frequencies and shapes",
                "scene_name": self.name,
                "scene": self.scene,
            },
        )

    def to_datatree(self) -> xr.DataTree:
        """Everything as an xarray DataTree."""
        return datatree(self.groups(), self.name)

    def save(self, path: str | Path) -> None:
        """Write a netCDF-4 file, complete or not at all.

        Raises
        ------
        ResultsError : the file cannot be written.
        """
        write_groups(self.groups(), path)

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
