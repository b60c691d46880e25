"""The LATIN method in NumPy and SciPy, to be read beside the paper: two bodies, contact with friction between them.

    P. Ladeveze, H. Lemoussu, P.A. Boucard, A modular approach to 3-D impact computation with frictional contact,
    Computers and Structures 78 (2000) 45-51

Numbers in parentheses are its equations. Nothing is imported from the package; no step is made fast. The scene is that
of its section 3.2, coarse: a hard specimen on a soft one that stands on a wall, quarter model, a half-sine pressure on
the top. Unknown are the velocity W and the traction F on both sides of the interface, (side, point, component) at every
instant. F is what the interface exerts on a side, N = z points from side 0 (E, lower) to side 1 (E', upper).

    python examples/latin_in_numpy.py                      a table: one window over all instants, windows of one instant
    python examples/latin_in_numpy.py --friction 0.3       with another coefficient
    python examples/latin_in_numpy.py --figure latin.png   and histories, with the iterations that lead to them

The package adds: other elements, meshes, interfaces and laws; schemes for bodies that land; the condensation of an
instant on the interface, with k from it and Newton steps, instead of a march per iteration; acceleration, fall-backs and
a force residual; the drift that makes up what a finite tolerance leaves (here the tolerance is 1e-11); energies.
"""

from __future__ import annotations

from argparse import ArgumentParser
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]

EDGE, CELLS = 10e-3, 3  # of both specimens: length, m, and elements along it
PRESSURE, PULSE = 200e6, 10e-6  # half sine on the top, Pa, s
STEP, INSTANTS = 0.3e-6, 60  # s


# -- The substructures: space ------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Material:
    """Young's modulus, Pa, Poisson's ratio and density, kg m-3."""

    young: float
    poisson: float
    density: float

    @property
    def shear(self) -> float:
        """Shear modulus, Pa."""
        return self.young / (2 * (1 + self.poisson))

    @property
    def first(self) -> float:
        """First Lame constant, Pa."""
        return 2 * self.shear * self.poisson / (1 - 2 * self.poisson)

    @property
    def impedances(self) -> Array:
        """rho c_s, rho c_s, rho c_p of waves along z with motions along x, y, z, Pa s m-1."""
        moduli = np.array([self.shear, self.shear, self.first + 2 * self.shear])
        return np.sqrt(self.density * moduli)


ALUMINIUM, STEEL = Material(70e9, 0.3, 2700.0), Material(210e9, 0.3, 7800.0)


def cube(material: Material, h: float) -> tuple[Array, Array]:
    """Stiffness and consistent mass (24, 24) of a cube of edge h with a node at each corner: (3), (5) in weak form."""
    corners = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    hooke = np.diag([2 * material.shear] * 3 + [material.shear] * 3)  # sigma = K eps
    hooke[:3, :3] += material.first
    stiffness, mass = np.zeros((24, 24)), np.zeros((24, 24))
    for point in corners / np.sqrt(3):  # Gauss points, of weight h^3 / 8
        factors = (1 + corners * point) / 2  # a shape function is the product of three
        shape = factors.prod(axis=1)
        slope = np.stack([corners[:, i] / h * np.delete(factors, i, axis=1).prod(axis=1) for i in range(3)], axis=1)
        strain = np.zeros((6, 8, 3))  # eps_xx, eps_yy, eps_zz, 2 eps_xy, 2 eps_yz, 2 eps_zx
        for i, j in ((0, 1), (1, 2), (2, 0)):
            strain[i, :, i] = slope[:, i]
            strain[3 + i, :, i], strain[3 + i, :, j] = slope[:, j], slope[:, i]
        strain = strain.reshape(6, 24)
        stiffness += h**3 / 8 * strain.T @ hooke @ strain
        mass += h**3 / 8 * material.density * np.kron(np.outer(shape, shape), np.eye(3))
    return stiffness, mass


class State(NamedTuple):
    """Displacement, velocity, acceleration and resultant force R = f - K u of all free dofs at an instant."""

    u: Array
    v: Array
    a: Array
    r: Array


class Substructure:
    """A cube of CELLS^3 elements.

    The planes x = 0 and y = 0 are planes of symmetry, and the bottom of the lower specimen does not move along z: (1).
    ``face``: at the bottom (0) or at the top (1) is the interface.
    """

    def __init__(self, material: Material, face: int, on_wall: bool, scheme: Scheme) -> None:
        n, h, self.scheme = CELLS + 1, EDGE / CELLS, scheme
        nodes = np.array([(x, y, z) for z in range(n) for y in range(n) for x in range(n)])
        number = np.arange(n**3).reshape(n, n, n)  # z, y, x
        size = 3 * n**3
        stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
        of_cube = cube(material, h)
        for z, y, x in np.ndindex(CELLS, CELLS, CELLS):
            corner = number[z : z + 2, y : y + 2, x : x + 2].ravel()
            dofs = (3 * corner[:, None] + np.arange(3)).ravel()
            stiffness[np.ix_(dofs, dofs)] += of_cube[0]
            mass[np.ix_(dofs, dofs)] += of_cube[1]
        held = nodes == 0
        held[:, 2] &= on_wall
        free = np.flatnonzero(~held.ravel())
        self.stiffness, self.mass = stiffness[np.ix_(free, free)], mass[np.ix_(free, free)]
        ends = np.where((np.arange(n) == 0) | (np.arange(n) == n - 1), h / 2, h)
        self.area = np.repeat(np.outer(ends, ends).ravel(), 3)  # of each point of a face, for its three components
        layers = [np.eye(size)[(3 * number[z].reshape(-1, 1) + np.arange(3)).ravel()][:, free] for z in (0, n - 1)]
        self.trace = layers[face]  # velocities of the dofs -> velocities of the points
        self.push = layers[1].T @ (self.area * np.tile([0.0, 0.0, -1.0], n * n))  # a unit pressure on the top
        self.k = np.tile(material.impedances, n * n)  # search direction k = k_n N N^T + k_t (1 - N N^T)
        # M a + dashpots and stiffness, weighted as the scheme weights forces: one constant matrix, factorised once
        dashpots = self.trace.T @ np.diag(self.area * self.k) @ self.trace  # (14)
        weight = 1 + scheme.alpha
        self.factor = cho_factor(
            self.mass + weight * (scheme.gamma * STEP * dashpots + scheme.beta * STEP**2 * self.stiffness)
        )
        self.at_rest = State(*np.zeros((4, len(free))))  # (2)

    def linear_stage(self, q: Array, pressure: Array, state: State) -> tuple[Array, Array, State]:
        """(8)-(14): W and F at the instants of a window, and the state at its end, for the incoming q = F_hat + k W_hat.

        F - F_hat = -k (W - W_hat) on the interface (12), (13): a given traction q and a dashpot, F = q - k W.
        """
        scheme, w, f = self.scheme, np.zeros_like(q), np.zeros_like(q)
        for i in range(len(q)):
            u, v = scheme.predict(state.u, state.v, state.a)
            force = pressure[i] * self.push - self.stiffness @ u
            force += self.trace.T @ (self.area * (q[i] - self.k * (self.trace @ v)))
            a = cho_solve(self.factor, (1 + scheme.alpha) * force - scheme.alpha * state.r)  # (9)
            u, v = u + scheme.beta * STEP**2 * a, v + scheme.gamma * STEP * a  # (10), (11)
            w[i] = self.trace @ v
            f[i] = q[i] - self.k * w[i]
            resultant = pressure[i] * self.push - self.stiffness @ u + self.trace.T @ (self.area * f[i])
            state = State(u, v, a, resultant)
        return w, f, state


# -- The substructures: time -------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Scheme:
    """M a_new = (1 + alpha) R_new - alpha R_old with Newmark's u and v; alpha = 0 is the scheme of the paper, with the
    average acceleration; HHT with alpha = -0.1 dampens what the mesh does not resolve."""

    alpha: float = -0.1

    @property
    def gamma(self) -> float:
        """Weight of the new acceleration in the velocity."""
        return 0.5 - self.alpha

    @property
    def beta(self) -> float:
        """Weight of the new acceleration in the displacement."""
        return (1 - self.alpha) ** 2 / 4

    def predict(self, u: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Displacement and velocity of the new instant without its acceleration."""
        return u + STEP * v + STEP**2 * (0.5 - self.beta) * a, v + STEP * (1 - self.gamma) * a

    def follow(self, g: Array, v: Array, a: Array, v_new: Array) -> tuple[Array, Array]:
        """Gap and its acceleration at the new instant, whose opening velocity is known: the same recursion."""
        a_new = ((v_new - v) / STEP - (1 - self.gamma) * a) / self.gamma
        return g + STEP * v + STEP**2 * ((0.5 - self.beta) * a + self.beta * a_new), a_new


# -- The interface -----------------------------------------------------------------------------------------------------
class Gap(NamedTuple):
    """Gap (n_point,), positive when open, and its first two derivatives by time, at the start of an instant."""

    g: Array
    v: Array
    a: Array


def contact(s: Array, kappa: Array, reach: Array, friction: float) -> Array:
    """Traction (n_point, 3) on side E by unilateral contact and Coulomb's friction, explicitly: (18)-(23).

    s : (2, n_point, 3) velocities that the sides would have without traction. kappa : 1 / (1/k + 1/k').
    reach : opening velocity that closes the gap within the instant.
    """
    jump = s[1] - s[0]
    pressure = kappa[:, 2] * np.maximum(0.0, -(jump[:, 2] + reach))  # (18)-(20): -k C_n if the indicator C_n < 0
    shear = kappa[:, :2] * jump[:, :2]  # G of (21), which would stop the sliding
    size = np.linalg.norm(shear, axis=1)
    slips = size > friction * pressure
    shear[slips] *= (friction * pressure[slips] / size[slips])[:, None]  # (23); else (22), stick
    return np.column_stack([shear, -pressure])


def local_stage(
    w: Array, f: Array, k: Array, gap: Gap, friction: float, scheme: Scheme
) -> tuple[Array, Array]:
    """(15)-(17): F_hat and W_hat (n_instant, 2, 3 n_point), every point by itself, instant after instant.

    F_hat - F = k (W_hat - W) (16), (17) gives W_hat = s + F_hat / k with s = W - F / k of the linear stage.
    The gap of an instant is that at its start: 0 <= max(g, 0) / dt + opening velocity, perpendicular to P >= 0.
    """
    kappa = (1 / (1 / k[0] + 1 / k[1])).reshape(-1, 3)
    w_hat, f_hat = np.zeros_like(w), np.zeros_like(f)
    for i in range(len(w)):
        s = w[i] - f[i] / k
        traction = contact(s.reshape(2, -1, 3), kappa, np.maximum(gap.g, 0.0) / STEP, friction).ravel()
        f_hat[i] = traction, -traction  # (19): action and reaction
        w_hat[i] = s + f_hat[i] / k
        opening = (w_hat[i, 1] - w_hat[i, 0])[2::3]
        g, a = scheme.follow(*gap, opening)
        gap = Gap(g, opening, a)
    return w_hat, f_hat


def error_indicator(w: Array, f: Array, w_hat: Array, f_hat: Array, weight: Array, z: Array) -> float:
    """sqrt(eta) of (24): distance of both stages over their size, in the norm int F Z^-1 F + int W Z W."""

    def squared(w: Array, f: Array) -> float:
        return float((weight * (f * f / z + w * w * z)).sum())

    return float(np.sqrt(squared(w - w_hat, f - f_hat) / max(squared(w, f) + squared(w_hat, f_hat), 1e-300)))


# -- The iteration -----------------------------------------------------------------------------------------------------
@dataclass
class Result:
    """Fields of the local stage (n_instant, 2, n_point, 3), and sqrt(eta) after each iteration of each window."""

    w_hat: Array
    f_hat: Array
    errors: list[list[float]]


def solve(friction: float, window: int, scheme: Scheme, tolerance: float = 1e-11, most: int = 2000) -> Result:
    """The two specimens, in windows of ``window`` instants iterated at once; the paper has one for all of them."""
    bodies = Substructure(ALUMINIUM, 1, True, scheme), Substructure(STEEL, 0, False, scheme)
    k, weight = np.stack([b.k for b in bodies]), np.stack([b.area for b in bodies])
    times = STEP * np.arange(1, INSTANTS + 1)  # at t = 0 all is known
    pulse = PRESSURE * np.sin(np.pi * times / PULSE) * (times <= PULSE)
    loads, states = (np.zeros(INSTANTS), pulse), [b.at_rest for b in bodies]
    w_hat, f_hat, errors = np.zeros((INSTANTS, *k.shape)), np.zeros((INSTANTS, *k.shape)), []
    q = np.zeros((window, *k.shape))
    for first in range(0, INSTANTS, window):
        now = slice(first, first + window)
        moved = [[b.trace @ x for x in state[:3]] for b, state in zip(bodies, states, strict=True)]
        gap = Gap(*(upper[2::3] - lower[2::3] for lower, upper in zip(*moved, strict=True)))
        errors.append([])
        while True:
            stages = [b.linear_stage(q[:, e], loads[e][now], states[e]) for e, b in enumerate(bodies)]
            w, f = (np.stack([stage[i] for stage in stages], axis=1) for i in (0, 1))
            w_hat[now], f_hat[now] = local_stage(w, f, k, gap, friction, scheme)
            errors[-1].append(error_indicator(w, f, w_hat[now], f_hat[now], weight, k))
            if errors[-1][-1] <= tolerance or len(errors[-1]) == most:
                break
            q = f_hat[now] + k * w_hat[now]
        states = [stage[2] for stage in stages]
    shape = (INSTANTS, 2, -1, 3)
    return Result(w_hat.reshape(shape), f_hat.reshape(shape), errors)
