"""An assembly by its modes and the static relative motions of its contacts.

With the free dofs q and the relative motions r of an assembly tied at all interfaces (``tied_assembly``), the rigid
motions R and elastic modes Phi of K_qq phi = lambda M_qq phi, and the static response to r and to the loads f,

    q = R zeta_0 + Phi (zeta - G r - Phi^T f / lambda) + Psi r + K+ f,    Psi = -K+ K_qr - R R^T M_qr

K+ being the inverse of K_qq with inertia relief, G = Phi^T (M_qq Psi + M_qr) = Phi^T (M_qr - K_qr / lambda), the
equations of motion are

    zeta_0'' = R^T f_q
    zeta'' + C zeta' + lambda (zeta - G r) = Phi^T f_q
    S r - G^T lambda (zeta - G r) = f_r + Psi^T f_q - G^T Phi^T f_q + T^T area F

with the stiffness S of r when the modes have settled, S = K_rr - K_rq K+ K_qr, and the tractions F of the contacts.
Modes that are left out and r itself have no inertia of their own, but for that of parts which move as a whole
(``rigid_parts``).

A mode of frequency omega keeps it in the march: average acceleration takes a pole s of the motion for s~ with
s = (2/dt) artanh(s~ dt/2), so that the march is given the poles s~ = (2/dt) tanh(s dt/2). With x = omega dt/2 what a
mode is driven by and what is read of it are p times theirs, p^2 = tan x / (x cos^2 x), and G is g times its own,
g^2 = x^3 cos x / sin^3 x: the residues of the poles are those of the motion then, and the static response is exact.

Damping by Maxwell branches of the materials acts on r and between the modes as it does on the modes: one set of
branches, those of all bodies weighted by their share of the strain energy, is marched with S and with every mode, in a
mode with the strength that gives its pole, s~^2 + d s~ + lambda~ (1 + share R(s~)) = 0. A viscous force in its place
would be right at one frequency alone, and what modes far above a frequency and relative motions do there is not that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..assembly.models import same
from ..cholesky.factor import CholeskyFactor, InsideFactor
from ..latin.assembly import Array, Index
from ..propagator.interface_sweeps import NONE
from ..propagator.lanczos import lowest_modes
from ..propagator.model import SubstructureModel, relaxing_part
from ..propagator.vibration import DENSE
from ..time_scheme import NO_BRANCHES, MaxwellBranches
from .dynamic_stiffness import ProjectedStiffness, pole_of
from .rigid_parts import RigidInertia, RigidParts
from .tied_assembly import DAMPING, TiedAssembly

MOST_MODES: Final = 400
"""Elastic modes at most."""
_LARGEST: Final = 1.2
"""Largest omega dt / 2 of a mode that is marched."""
_SHIFT: Final = 1e-10  # of the eigenvalues, over trace(K) / trace(M)
_RIGID: Final = 1e-2  # of the shift: eigenvalues below are those of rigid motions
_ROUND_OFF: Final = 1e-12  # of the largest damping
_FIXED_POINT: Final = 50  # steps, each of which gains the digits of a loss factor
_OF_MATRICES: Final = ("coupling", "rigid_share", "gamma", "beyond", "of_bodies")  # of the tied assembly
_OF_FORCES: Final = ("static_loads", "drives")  # what follows from loads
_EXACT: Final = 1e-4  # of the largest change of the relative motions, left out of their shapes
_BLOCK: Final = 32  # shapes that are looked for at a time
_COLUMNS: Final = 40  # that are solved together: vectors of all dofs
_MOST_ROWS: Final = 8  # groups of rows whose responses are kept
_SUPPORT: Final = 1.0  # stiffness of the statically determinate supports, over the largest of a dof


class StaticSolver:
    """K+ and S of the module docstring, by one factor of the tied assembly with the relative motions last. K+ : static
    responses to forces with inertia relief, orthogonal to the rigid motions in the mass.

    Parameters
    ----------
    tied : the assembly. rigid : (n_free, k) its rigid motions, orthonormal in the mass.

    Attributes
    ----------
    relative : S (n_r, n_r), N m-1, positive semidefinite: parts that contacts alone hold move without force.
    """

    def __init__(self, tied: TiedAssembly, rigid: Array) -> None:
        n, size = tied.n_free, tied.n_relative
        self.rigid, self._pulled = rigid, np.asarray(tied.mass[:n, :n] @ rigid)
        supports = np.vstack([rigid, np.zeros((size, rigid.shape[1]))])
        last: Index = np.arange(n, n + size, dtype=np.int64)
        self._factor = InsideFactor(supported(tied.stiffness, supports), last, tied.rank)
        self.relative = self._factor.schur
        self._n_relative = size
        self._rows: list[tuple[sp.csr_array, Array]] = []

    def transposed(self, rows: sp.csr_array) -> Array:
        """A K+ (k, n_free) of rows A (k, n_free): K+ is symmetric. Those of runs before are taken again."""
        for before, found in self._rows:
            if same(before, rows):
                return found
        found = np.asarray(self.solve(rows.T.toarray()).T)
        self._rows = [*self._rows[-_MOST_ROWS:], (rows, found)]
        return found

    def spanning(self, histories: Array, coupling: sp.csr_array, share: float | None = None) -> tuple[Array, Array]:
        """Shapes (n_r, k) of relative motions (n_time, n_r) as ``compressed`` finds them, and the static responses
        (n_free, k) to them without their inertia relief; ``coupling`` : K_qr. share : left out, None for that of
        results."""
        shapes = compressed(histories, share)
        blocks = [shapes[:, at : at + _COLUMNS] for at in range(0, shapes.shape[1], _COLUMNS)]
        solved = [self.solve(-np.asarray(coupling @ block)) for block in blocks]
        return shapes, np.hstack([np.zeros((coupling.shape[0], 0)), *solved])

    def solve(self, forces: Array) -> Array:
        """Responses (n_free, m) to forces (n_free, m)."""
        moved = forces - self._pulled @ (self.rigid.T @ forces)
        moved = self._factor.held_solve(np.vstack([moved, np.zeros((self._n_relative, forces.shape[1]))]))
        moved = moved[: len(forces)]
        return np.asarray(moved - self.rigid @ (self._pulled.T @ moved))


def compressed(histories: Array, share: float | None = None) -> Array:
    """Orthonormal shapes (n, k) of histories (n_time, n) whose span holds them to a ``share`` of the largest, None for
    that of results: a span found by random sums of what is left, and of it the fewest shapes that do."""
    if share is None:
        share = _EXACT
    rest, found = histories.copy(), list[Any]()
    size = np.linalg.norm(rest, axis=1).max(initial=0.0)
    random = np.random.default_rng(0)  # the same shapes every time
    while size > 0.0 and np.linalg.norm(rest, axis=1).max() > share * size:
        rank = sum(shape.shape[1] for shape in found)
        count = min(_BLOCK, min(histories.shape) - rank)
        if count <= 0:
            break
        mixed = rest.T @ random.normal(size=(len(rest), count))
        for shape in found:
            mixed -= shape @ (shape.T @ mixed)
        new, _ = la.qr(mixed, mode="economic", check_finite=False)
        found.append(new)
        rest -= (rest @ new) @ new.T
    shapes = np.hstack([np.zeros((histories.shape[1], 0)), *found])
    if not shapes.shape[1]:
        return shapes
    weights, sizes, turn = la.svd(histories @ shapes, full_matrices=False)
    # of each history, what the shapes from each one on hold, and what none does
    shares = np.cumsum((weights * sizes)[:, ::-1] ** 2, axis=1)[:, ::-1] + (rest**2).sum(axis=1)[:, None]
    count = int((shares.max(axis=0) > (share * size) ** 2).sum())
    return np.asarray(shapes @ turn[:count].T)


def supported(stiffness: sp.csr_array, rigid: Array) -> sp.csr_array:
    """The stiffness with springs at as many dofs as there are rigid motions: statically determinate, so that forces in
    balance leave them without force."""
    if not rigid.shape[1]:
        return stiffness
    # the dofs at which the rigid motions are most independent
    _, _, order = la.qr(rigid.T, mode="economic", pivoting=True)
    springs = np.zeros(stiffness.shape[0])
    springs[order[: rigid.shape[1]]] = _SUPPORT * float(stiffness.diagonal().max())
    total = sp.csr_array(stiffness + sp.diags_array(springs))
    total.sort_indices()
    return total


class DigitalModes(NamedTuple):
    """Modes as average acceleration marches them: eigenvalues (m,), s-2, damping (m,), s-1, factors p and g (m,), and
    shares (m,) of the strength of the branches."""

    values: Array
    damping: Array
    p: Array
    g: Array
    shares: Array


def digital(
    values: Array,
    damping: Array,
    dt: float,
    viscous: Array | None = None,
    losses: Array | None = None,
    branches: MaxwellBranches = NO_BRANCHES,
) -> DigitalModes:
    """Elastic modes with eigenvalues (m,) and diagonal damping (m,) for steps dt (module docstring).

    viscous, losses : (m,) in the damping, the viscous part, s-1, and the part that ``branches`` have with their whole
    strength; all of it is viscous without branches.
    """
    half = np.emath.sqrt(0.25 * damping**2 - values)
    poles = np.stack([-0.5 * damping + half, -0.5 * damping - half]).astype(complex)
    marched = (2.0 / dt) * np.tanh(0.5 * dt * poles)
    x = 0.5 * dt * np.sqrt(values)
    p = np.sqrt(np.tan(x) / (x * np.cos(x) ** 2))
    g = np.sqrt(x**3 * np.cos(x) / np.sin(x) ** 3)
    values_of_march, damping_of_march = np.real(marched[0] * marched[1]), -np.real(marched[0] + marched[1])
    shares = np.zeros(len(values))
    if viscous is not None and losses is not None and len(branches):
        for i in np.flatnonzero((losses > 0.0) & (damping**2 < 4.0 * values)):
            found = _with_branches(complex(marched[0, i]), float(viscous[i]), float(losses[i]), branches)
            values_of_march[i], damping_of_march[i], shares[i] = found
    return DigitalModes(values_of_march, damping_of_march, p, g, shares)


def _with_branches(s: complex, viscous: float, loss: float, branches: MaxwellBranches) -> tuple[float, float, float]:
    """lambda, d and share of s^2 + d s + lambda (1 + share R(s)) = 0 for a pole s, d and share being the same multiple
    of ``viscous`` and ``loss``."""
    rise = complex(branches.rise(s))
    value, factor = abs(s) ** 2, 1.0
    for _ in range(_FIXED_POINT):
        factor = -2.0 * s.real * s.imag / (viscous * s.imag + value * loss * rise.imag)
        value = -((s * s).real + factor * viscous * s.real) / (1.0 + factor * loss * rise.real)
    return value, factor * viscous, factor * loss


@dataclass(frozen=True)
class ReducedAssembly:
    """Modes, static stiffness and loads of a tied assembly (module docstring); rigid motions come first among modes.

    Attributes
    ----------
    tied : the assembly. dt : step of the march, s. rigid, elastic : (n_free, k), mass-orthonormal. values : (m,) of
    the elastic modes, s-2. forces : loads (n, n_load) on [q, r] for amplitude 1, N. solver : K+ and S. viscosities : b
    of the damping b K by strains, s, by body. parts : what moves as a whole.
    """

    tied: TiedAssembly
    dt: float
    rigid: Array
    elastic: Array
    values: Array
    forces: Array
    solver: StaticSolver
    viscosities: Mapping[str, float]
    parts: RigidParts

    @staticmethod
    def of(
        tied: TiedAssembly, parts: RigidParts, dt: float, cutoff: float, viscosities: Mapping[str, float]
    ) -> ReducedAssembly | None:
        """The assembly without loads with its modes up to ``cutoff``, Hz; None where they are too many."""
        n = tied.n_free
        stiffness, mass = (sp.csr_array(matrix[:n, :n]) for matrix in (tied.stiffness, tied.mass))
        rank = None if tied.rank is None else tied.rank[:n]
        limit = min(2.0 * np.pi * cutoff, 2.0 * _LARGEST / dt) ** 2
        found = lowest(stiffness, mass, rank, limit)
        if found is None:
            return None
        rigid, values, elastic = found
        none = np.zeros((tied.mass.shape[0], 0))
        return ReducedAssembly(tied, dt, rigid, elastic, values, none, StaticSolver(tied, rigid), viscosities, parts)

    @property
    def relative(self) -> Array:
        """S (n_r, n_r), N m-1."""
        return self.solver.relative

    @property
    def n_mode(self) -> int:
        """Rigid motions and elastic modes."""
        return int(self.rigid.shape[1] + self.elastic.shape[1])

    @cached_property
    def coupling(self) -> sp.csr_array:
        """K_qr (n_free, n_r)."""
        n = self.tied.n_free
        return sp.csr_array(self.tied.stiffness[:n, n:])

    @cached_property
    def rigid_share(self) -> Array:
        """R^T M_qr (k, n_r)."""
        n = self.tied.n_free
        return np.asarray(self.rigid.T @ self.tied.mass[:n, n:])

    @cached_property
    def gamma(self) -> Array:
        """G (m, n_r) of the elastic modes."""
        n = self.tied.n_free
        stiff = np.asarray(self.elastic.T @ self.coupling) / self.values[:, None]
        return np.asarray(self.elastic.T @ self.tied.mass[:n, n:]) - stiff

    @cached_property
    def damping(self) -> Array:
        """Phi^T C Phi (n_mode, n_mode), modal damping of bodies included."""
        basis = np.hstack([self.rigid, self.elastic])
        projected = self.tied.projected(DAMPING, basis)
        for model in self.tied.models:
            if model.modal_rows is not None:
                rates = model.modal_rows @ self.tied.moved(model.name, basis)
                projected += rates.T @ rates
        return 0.5 * (projected + projected.T)

    @cached_property
    def drag(self) -> Array:
        """Part (n_mode, n_mode) of ``damping`` that does not come from strains: of media and dashpots at rest."""
        first = self.rigid.shape[1]
        rest = self.damping.copy()
        for name, viscosity in self.viscosities.items():
            if viscosity:
                rest[first:, first:] -= viscosity * self.of_bodies[name]
        return rest

    @cached_property
    def of_bodies(self) -> dict[str, Array]:
        """Phi^T K Phi (m, m) of each body in the elastic modes, K that of its strains."""
        moved = ((model, self.tied.moved(model.name, self.elastic)) for model in self.tied.models)
        return {model.name: np.asarray(motions.T @ (relaxing_part(model) @ motions)) for model, motions in moved}

    @cached_property
    def poles(self) -> tuple[Array, Array]:
        """Eigenvalues (m,), s-2, and damping (m,), s-1, of the elastic modes at their own frequencies: where damping by
        strain stiffens bodies, each mode has the stiffness there."""
        first = self.rigid.shape[1]
        values, damping = self.values.copy(), self.damping.diagonal()[first:].copy()
        strained = self._strained
        for i in range(len(values)) if strained else ():
            strains = [ProjectedStiffness(branches, stiffness[i : i + 1, None]) for branches, stiffness in strained]
            one = np.ones(1, dtype=np.complex128)
            s = pole_of(1j * np.sqrt(values[i]), one, values[i : i + 1], np.diag(damping[i : i + 1]), strains)
            values[i], damping[i] = abs(s) ** 2, -2.0 * s.real
        return values, damping

    @cached_property
    def _strained(self) -> list[tuple[MaxwellBranches, Array]]:
        """Stiffness (m,), s-2, that the bodies with the same branches have in the elastic modes."""
        shares: dict[MaxwellBranches, Array] = {}
        for model in self.tied.models:
            if len(model.branches):
                share = self.of_bodies[model.name].diagonal()
                shares[model.branches] = shares.get(model.branches, 0.0) + share
        return list(shares.items())

    @cached_property
    def marched(self) -> DigitalModes:
        """The elastic modes as they are marched."""
        first, branches = self.rigid.shape[1], self.branches
        omega = np.sqrt(self.poles[0])
        whole = branches.rise(1j * omega).imag
        lost = sum(
            (stiffness / self.values * b.rise(1j * omega).imag for b, stiffness in self._strained), np.zeros(len(omega))
        )
        losses = np.divide(lost, whole, out=np.zeros_like(omega), where=whole > 0.0)
        return digital(*self.poles, self.dt, self.damping.diagonal()[first:], losses, branches)

    @cached_property
    def branches(self) -> MaxwellBranches:
        """Branches of all bodies, weighted by their strain energy in the elastic modes, each normed to 1."""
        strengths, times = list[float](), list[float]()
        for branches, stiffness in self._strained:
            if len(self.values):
                share = float((stiffness / self.values).mean())
            else:
                share = 0.0
            strengths += [share * g for g in branches.strengths]
            times += branches.times
        return MaxwellBranches(tuple(strengths), tuple(times))

    @cached_property
    def static_loads(self) -> Array:
        """K+ f (n_free, n_load)."""
        return self.solver.solve(self.forces[: self.tied.n_free])

    # -- the equations that are marched --------------------------------------------------------------------------
    @cached_property
    def marched_gamma(self) -> Array:
        """G as it is marched, (m, n_r): sqrt(lambda) G has the digits of float32, others would make FMUs larger. What
        is read of the motion takes the same, so that statics stay exact."""
        sizes = np.sqrt(self.marched.values)[:, None]
        return (sizes * self.marched.g[:, None] * self.gamma).astype(np.float32) / sizes

    @cached_property
    def inertia(self) -> RigidInertia:
        """The inertia of r that modes leave out of parts which move as a whole."""
        forces = self.parts.forces[: self.tied.n_free]
        on_modes = self.elastic.T @ forces
        marched = np.vstack([self.rigid.T @ forces, self.marched.g[:, None] * on_modes])
        return self.parts.inertia_left(self.beyond - self.gamma.T @ on_modes, marched)

    @cached_property
    def beyond(self) -> Array:
        """Inertia (n_r, k), kg, of r in motions of parts as a whole, that of all modes included."""
        return self._beyond_modes(self.parts.forces, self.solver.solve(self.parts.forces[: self.tied.n_free]))

    @property
    def relative_viscosity(self) -> float:
        """Time b, s, of the damping b S that relative motions have by the viscous strains of the bodies: the mean over
        the bodies by their strain energy in the elastic modes."""
        total = damped = 0.0
        for model in self.tied.models if len(self.values) else ():
            energy = float((self.of_bodies[model.name].diagonal() / self.values).sum())
            total += energy
            damped += energy * self.viscosities.get(model.name, 0.0)
        if total > 0.0:
            return damped / total
        return 0.0

    @cached_property
    def drives(self) -> Array:
        """Loads (n_mode + n_r, n_load) on the modes and on r, for amplitude 1."""
        n, on_modes = self.tied.n_free, self.marched.p[:, None] * (self.elastic.T @ self.forces[: self.tied.n_free])
        on_relative = self._beyond_modes(self.forces, self.static_loads) - self.marched_gamma.T @ on_modes
        return np.vstack([self.rigid.T @ self.forces[:n], on_modes, on_relative])

    def _beyond_modes(self, forces: Array, static: Array) -> Array:
        """f_r + Psi^T f_q (n_r, k) of forces (n, k) and their static response K+ f_q (n_free, k)."""
        n = self.tied.n_free
        on_relative = forces[n:] - self.coupling.T @ static - self.rigid_share.T @ (self.rigid.T @ forces[:n])
        return np.asarray(on_relative)


def mean_branches(reduced: ReducedAssembly) -> MaxwellBranches:
    """Branches of the bodies that have some, weighted by their strain energy in the elastic modes."""
    relaxing = [model.name for model in reduced.tied.models if len(model.branches)]
    share = sum(float((reduced.of_bodies[name].diagonal() / reduced.values).mean()) for name in relaxing)
    return MaxwellBranches(tuple(g / share for g in reduced.branches.strengths), reduced.branches.times)


def with_forces(
    reduced: ReducedAssembly, forces: Array, models: list[SubstructureModel] | None = None
) -> ReducedAssembly:
    """The same under loads (n_full, n_load), N for amplitude 1; ``models`` : of the bodies, with equal matrices and
    other initial values, None for those that it has."""
    tied = reduced.tied if models is None else replace(reduced.tied, models=models)
    other = replace(reduced, tied=tied, forces=np.asarray(tied.expansion.T @ forces))
    # what does not follow from loads, some of it from matrices that may be gone
    given = {field.name for field in fields(reduced)}
    known = {name: part for name, part in reduced.__dict__.items() if name not in given and name not in _OF_FORCES}
    other.__dict__.update(known)
    return other


def marched_rows(reduced: ReducedAssembly) -> Array:
    """Rows (m + j, n_mode + n_r): E of the stiffness E^T E of the modes, lambda on zeta - G r, then inertia of r
    in steps dt (``kernels.face``)."""
    first = reduced.rigid.shape[1]
    sizes = np.sqrt(reduced.marched.values)
    # as it was rounded
    coupling = (sizes[:, None] * reduced.marched_gamma).astype(np.float32)
    elastic = np.hstack([np.zeros((len(sizes), first)), np.diag(sizes), -coupling])
    inertia = reduced.inertia.rows
    inertial = np.hstack([np.zeros((len(inertia), reduced.n_mode)), (inertia / reduced.dt).astype(np.float32)])
    return np.vstack([elastic, inertial])


def strain_rows(reduced: ReducedAssembly) -> Array | None:
    """Rows A (k, n_mode + n_r) of the damping A^T A by strains, which acts on zeta' - G r' alone: modes that follow
    a relative motion without delay are not strained by it; None without such damping."""
    first = reduced.rigid.shape[1]
    strained = (reduced.damping - reduced.drag)[first:, first:].copy()
    np.fill_diagonal(strained, reduced.marched.damping - reduced.drag.diagonal()[first:])
    sizes, turn = la.eigh(0.5 * (strained + strained.T))
    sound = sizes > _ROUND_OFF * max(sizes.max(initial=0.0), np.finfo(float).tiny)
    if not sound.any():
        return None
    rows = np.sqrt(sizes[sound])[:, None] * turn[:, sound].T
    return np.hstack([np.zeros((len(rows), first)), rows, -rows @ reduced.marched_gamma])


def coordinates(reduced: ReducedAssembly, q: Array, r: Array, loads: Array) -> Array:
    """Modes and r (n_mode + n_r,) of a motion q (n_free,), r (n_r,) under loads (n_load,)."""
    n, first = reduced.tied.n_free, reduced.rigid.shape[1]
    pulled = reduced.tied.mass[:n] @ np.concatenate([q, r])
    static = reduced.gamma @ r + (reduced.elastic.T @ (reduced.forces[:n] @ loads)) / reduced.values
    moved = (reduced.elastic.T @ pulled - static) / reduced.marched.p
    drives = reduced.drives[first : reduced.n_mode] @ loads / reduced.marched.values
    return np.concatenate([reduced.rigid.T @ pulled, moved + reduced.marched_gamma @ r + drives, r])


def coarser(reduced: ReducedAssembly, dt: float, cutoff: float) -> ReducedAssembly:
    """The same, without loads, for longer steps dt and with the modes up to a lower ``cutoff``, Hz, alone."""
    some = reduced.values <= min(2.0 * np.pi * cutoff, 2.0 * _LARGEST / dt) ** 2
    every = np.concatenate([np.ones(reduced.rigid.shape[1], dtype=bool), some])
    none = np.zeros((len(reduced.forces), 0))
    coarse = replace(reduced, dt=dt, elastic=reduced.elastic[:, some], values=reduced.values[some], forces=none)
    # what follows from matrices that may be gone
    of_modes = {name: getattr(reduced, name)[np.ix_(every, every)] for name in ("damping", "drag")}
    same = {name: getattr(reduced, name) for name in ("coupling", "rigid_share", "beyond")}
    of_bodies = {name: part[np.ix_(some, some)] for name, part in reduced.of_bodies.items()}
    coarse.__dict__.update(of_modes | same | {"gamma": reduced.gamma[some], "of_bodies": of_bodies})
    return coarse


def without_stiffness(reduced: ReducedAssembly) -> ReducedAssembly:
    """The same without the stiffness of the tied assembly, which a march and its results do not need: what follows from
    it is there."""
    for name in _OF_MATRICES:
        getattr(reduced, name)
    lean = replace(reduced, tied=replace(reduced.tied, stiffness=sp.csr_array((0, 0))))
    lean.__dict__.update({name: reduced.__dict__[name] for name in _OF_MATRICES})
    return lean


def with_bodies(
    reduced: ReducedAssembly, models: list[SubstructureModel], viscosities: Mapping[str, float]
) -> ReducedAssembly:
    """The same for bodies of equal stiffness and mass with other damping, loads and motion at t = 0."""
    other = replace(reduced, tied=replace(reduced.tied, models=models), viscosities=viscosities)
    other.__dict__.update({name: reduced.__dict__[name] for name in _OF_MATRICES})
    return other


def lowest(
    stiffness: sp.csr_array, mass: sp.csr_array, rank: Array | None, limit: float
) -> tuple[Array, Array, Array] | None:
    """Rigid motions (n, k), eigenvalues (m,) up to ``limit`` and elastic modes (n, m), orthonormal in the mass; None
    for more than ``MOST_MODES``."""
    shift = _SHIFT * stiffness.trace() / mass.trace()
    if stiffness.shape[0] <= DENSE:
        values, modes = la.eigh(stiffness.toarray(), mass.toarray(), subset_by_value=(-np.inf, limit))
    else:
        shifted = sp.csr_array(stiffness + shift * mass)
        shifted.sort_indices()
        found = lowest_modes(mass, CholeskyFactor(shifted, NONE, rank).solve, shift, limit, MOST_MODES)
        if found is None:
            return None
        values, modes = found
    free = values < _RIGID * shift
    if (~free).sum() > MOST_MODES:
        return None
    # signs by a rule: those of eigenvectors are arbitrary
    modes = modes * np.where(modes[np.abs(modes).argmax(axis=0), np.arange(modes.shape[1])] < 0.0, -1.0, 1.0)
    return modes[:, free], values[~free], modes[:, ~free]
