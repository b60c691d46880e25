"""Damping ratios of vibration modes in a run: of the time scheme, of the landing layer, of the bodies.

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
that of absorbing faces, wave ports, dampers and viscous joints, and modal damping up to a frequency. Where materials
have Maxwell branches the ratio of the bodies is that of the eigenvalue of the mode (``dynamic_stiffness``). Not in it:
friction, modal damping of a reduced basis without such a limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..assembly.models import chosen_scheme, contact_layers
from ..assembly.problem import DiscretisedProblem
from ..latin.assembly import Array
from ..propagator import SubstructureModel
from ..propagator.model import diagonal_matrix
from ..propagator.vibration import Vibration
from ..scene.schema import Scene
from ..scene.settings import GeneralizedAlphaTable, ReducedPropagatorTable
from ..time_scheme import HHT, GeneralizedAlpha, QuasiStatic, TimeScheme
from ..time_scheme.scheme import coefficients
from .dynamic_stiffness import Complex

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
        layer at faces that may open. bodies : (n_mode,) of bodies, dampers, viscous joints, absorbing faces and wave
        ports.
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
        if self.bodies.any():
            shown |= {"bodies": self.bodies}
        return {f"{name}, %": 100 * ratio for name, ratio in shown.items()}


@dataclass(frozen=True)
class RunMatrices:
    """What a run of a scene marches, the substructures side by side, full dofs.

    Attributes
    ----------
    scene : of the run. scheme, reason : its time scheme, and why where it is chosen automatically. dt : step, s.
    mass : (n_full, n_full), kg, as the scheme takes it. viscosity : of the landing layers, N s m-1.
    """

    scene: Scene
    scheme: TimeScheme
    reason: str
    dt: float
    mass: sp.csr_array
    viscosity: sp.csr_array


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
            if faces.lumped is None:
                mass = model.with_lumped_mass.inertia
            else:
                mass = diagonal_matrix(faces.lumped)
        blocks.append((mass, none if viscosity is None else viscosity))
    whole = (sp.csr_array(sp.block_diag(matrices, format="csr")) for matrices in zip(*blocks, strict=True))
    return RunMatrices(scene, scheme, reason, discretised.dt, *whole)


class DampedAssembly(Protocol):
    """Damping of an assembly with linear joints."""

    def damping_of(self, full: Array, /) -> Array:
        """Phi^T C Phi (m, m) of motions (n_full, m)."""

    def eigenvalues(self, modes: Modes, /) -> Complex | None:
        """Those of modes, s-1, where materials have Maxwell branches."""


def modal_damping(matrices: RunMatrices, modes: Modes, assembly: DampedAssembly) -> ModalDamping:
    """Damping of modes in a run (module docstring)."""
    scheme, dt = matrices.scheme, matrices.dt
    omega, vectors = _marched(modes, matrices.mass)
    full, elastic = modes.expansion @ vectors, np.flatnonzero(omega > 0.0)
    of_scheme, of_layer, of_bodies = np.zeros((3, len(omega)))
    damping = assembly.damping_of(full)
    for ratio, squares in ((of_layer, _squares(matrices.viscosity, full)), (of_bodies, np.diagonal(damping))):
        ratio[elastic] = (squares / (2 * np.maximum(omega, 1e-300)))[elastic]
    if (damped := assembly.eigenvalues(modes)) is not None:
        of_bodies[elastic] = -damped[elastic].real / np.abs(damped[elastic])
        # nodes without mass change the frequencies of the march little, and their rise by less
        rise = np.abs(damped[elastic]) / modes.omega[elastic]
        omega = omega.copy()  # that of the modes, where no node has lost its mass
        omega[elastic] *= rise
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
    vibration = modes.vibration
    vectors = modes.vectors
    n_rigid = modes.n_rigid
    moved = sp.csr_array(modes.expansion.T @ mass @ modes.expansion)
    change = (moved - vibration.mass) @ vectors
    # no node has lost its mass: the modes are those of the scheme
    if np.abs(change).max(initial=0.0) <= _SAME * np.abs(vibration.mass @ vectors).max(initial=0.0):
        return modes.omega, vectors
    basis, last = vectors, vectors[:, n_rigid:]
    for _ in range(_ROUNDS):
        response = vibration.static(vectors[:, :n_rigid], moved @ last)
        added = response - basis @ (basis.T @ (vibration.mass @ response))
        squares, directions = la.eigh(added.T @ (vibration.mass @ added))
        independent = squares > _SAME * _squares(vibration.mass, response).max(initial=0.0)
        last = added @ (directions[:, independent] / np.sqrt(squares[independent]))
        basis = np.hstack([basis, last])
    # the shapes of massless nodes alone have no frequency: the shifted stiffness stands in the place of the mass
    mass_of, stiffness_of = (basis.T @ (matrix @ basis) for matrix in (moved, vibration.stiffness))
    inverse, inside = la.eigh(mass_of, stiffness_of + vibration.shift * mass_of)
    moves = inverse > _SAME * inverse.max(initial=0.0)
    inverse, inside = inverse[moves], inside[:, moves]
    # of the combinations found that which each given mode is most like
    shares = (vectors.T @ (vibration.mass @ (basis @ inside))) ** 2 / np.square(inside).sum(axis=0)
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
    if len(above) == 1:
        where = f"mode {above[0] + 1}"
    else:
        where = f"{len(above)} modes, most in mode {worst + 1}"
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
        by_step = scene.time.step is not None
        if by_step:
            key = f"time.step = {dt / parts:.12g}"
        else:
            key = f"time.instants = {parts * scene.time.n_step}"
        ratio = _percent(scheme_damping(scheme, omega, dt / parts))
        words += f" ({key} leaves {ratio}, with {parts} times as many steps)"
    if isinstance(scheme, GeneralizedAlpha):
        undamped = _keys(scene, scheme.landing_damping, 1.0)
        return f"{words}, and {undamped} has none, and damps nothing that the step does not resolve"
    if scheme.name != "hht":
        return f'{words}, and time.scheme = "hht" leaves {_percent(scheme_damping(HHT(), omega, dt))}'
    if isinstance(scene.solver.propagator, ReducedPropagatorTable):
        ratio = _percent(scheme_damping(HHT(-0.01), omega, dt))
        return f'{words}, and time.scheme = {{type = "hht", alpha = -0.01}} leaves {ratio}, and less damping of noise'
    ratio = _percent(scheme_damping(GeneralizedAlpha(), omega, dt))
    return f"{words}, and {_keys(scene, 0.0)} leaves {ratio}, but shifts frequencies: contact nodes have no mass"


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
    if isinstance(table, GeneralizedAlphaTable):
        default = table.rho_inf
    else:
        default = GeneralizedAlphaTable().rho_inf
    if rho_inf is None:
        rho = default
    else:
        rho = rho_inf
    if rho == GeneralizedAlphaTable().rho_inf:
        radius = ""
    else:
        radius = f"rho_inf = {rho:g}, "
    return f'time.scheme = {{type = "generalized_alpha", {radius}landing_damping = {landing_damping:g}}}'


def _percent(ratio: float) -> str:
    return f"{100 * ratio:.2g} %"
