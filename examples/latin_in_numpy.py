"""The LATIN method in NumPy and SciPy, to be read beside the paper: two bodies, contact with friction between them.

    P. Ladeveze, H. Lemoussu, P.A. Boucard, A modular approach to 3-D impact computation with frictional contact,
    Computers and Structures 78 (2000) 45-51

Numbers in parentheses are its equations. Nothing is imported from the package, and no step is made fast. The scene is
that of its section 3.2, coarse: a hard specimen on a soft one that stands on a wall, quarter model, a half-sine
pressure on the top. Unknown are the velocity W and the traction F of both sides of the interface at every instant:
arrays (instant, side, 3 * point + component). F is what the interface exerts on a side; the normal N = z points from
side 0 (E, the lower specimen) to side 1 (E', the upper one).

    python examples/latin_in_numpy.py                      one window over all instants, and windows of one instant
    python examples/latin_in_numpy.py --friction 0.3       another coefficient
    python examples/latin_in_numpy.py --figure latin.png   histories, and sqrt(eta) against the iteration

What the package does beyond this: docs/the_paper.md.
"""

from __future__ import annotations

from argparse import ArgumentParser
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]


# -- The scene ---------------------------------------------------------------------------------------------------------
class Material(NamedTuple):
    """Young's modulus, Pa, Poisson's ratio and density, kg m-3."""

    young: float
    poisson: float
    density: float

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's constants lambda and G, Pa."""
        shear = self.young / (2 * (1 + self.poisson))
        return 2 * shear * self.poisson / (1 - 2 * self.poisson), shear

    @property
    def impedance(self) -> Array:
        """rho c_s, rho c_s, rho c_p: traction over velocity of plane waves along z that move along x, y, z; Pa s/m."""
        first, shear = self.lame
        return np.sqrt(self.density * np.array([shear, shear, first + 2 * shear]))


@dataclass(frozen=True)
class Scene:
    """Two cubes of cells^3 elements each, and the time scheme: Newmark's average acceleration for alpha = 0, as in the
    paper; HHT for alpha < 0, which damps what the mesh does not resolve."""

    friction: float | None = 0.1  # coefficient mu; None: the specimens are bonded
    alpha: float = -0.1
    edge: float = 10e-3  # m
    cells: int = 3
    pressure: float = 200e6  # on the top, Pa
    pulse: float = 10e-6  # its duration, s
    step: float = 0.3e-6  # s
    instants: int = 60
    materials: tuple[Material, Material] = (Material(70e9, 0.3, 2700.0), Material(210e9, 0.3, 7800.0))

    @property
    def loads(self) -> Array:
        """Pressure on the top at the instants 1, 2, ...; at t = 0 everything is at rest."""
        t = self.step * np.arange(1, self.instants + 1)
        return self.pressure * np.sin(np.pi * t / self.pulse) * (t <= self.pulse)

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
        dt = self.step
        return u + dt * v + dt**2 * (0.5 - self.beta) * a, v + dt * (1 - self.gamma) * a

    def follow(self, u: Array, v: Array, a: Array, new: Array) -> tuple[Array, Array, Array]:
        """The same recursion where the velocity of the new instant is known: (u, v, a) of the new instant."""
        u_free, v_free = self.predict(u, v, a)
        a_new = (new - v_free) / (self.gamma * self.step)
        return u_free + self.beta * self.step**2 * a_new, new, a_new


# -- The substructures -------------------------------------------------------------------------------------------------
def cube(material: Material, h: float) -> tuple[Array, Array]:
    """Stiffness and consistent mass (24, 24) of a cube of edge h with 8 nodes: (3) and (5) in their weak form."""
    corners = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    first, shear = material.lame
    hooke = np.diag([2 * shear] * 3 + [shear] * 3)  # (5): sigma = K eps
    hooke[:3, :3] += first
    stiffness, mass = np.zeros((24, 24)), np.zeros((24, 24))
    for point in corners / np.sqrt(3):  # the Gauss points
        factors = (1 + corners * point) / 2  # a shape function is the product of its three
        shape = factors.prod(axis=1)
        slope = np.stack([corners[:, i] / h * np.delete(factors, i, axis=1).prod(axis=1) for i in range(3)], axis=1)
        strain = np.zeros((6, 8, 3))  # xx, yy, zz, 2 xy, 2 yz, 2 zx per nodal displacement
        for i, j in ((0, 1), (1, 2), (2, 0)):
            strain[i, :, i] = slope[:, i]
            strain[3 + i, :, i], strain[3 + i, :, j] = slope[:, j], slope[:, i]
        strain = strain.reshape(6, 24)
        stiffness += h**3 / 8 * strain.T @ hooke @ strain
        mass += h**3 / 8 * material.density * np.kron(np.outer(shape, shape), np.eye(3))
    return stiffness, mass


class State(NamedTuple):
    """Displacement, velocity, acceleration and resultant force of the dofs of a body at an instant."""

    u: Array
    v: Array
    a: Array
    r: Array


class Substructure:
    """One specimen: side 0, whose top is the interface, or side 1, whose bottom is.

    Kinematic conditions (1): x = 0 and y = 0 are planes of symmetry, and the bottom of the lower specimen stays on the
    wall. A held direction at the interface never gets a traction: the iteration starts from zero, and W stays zero.
    """

    def __init__(self, scene: Scene, side: int) -> None:
        self.scene, material, n, h = scene, scene.materials[side], scene.cells + 1, scene.edge / scene.cells
        number = np.arange(n**3).reshape(n, n, n)  # of the node at z, y, x
        stiffness, mass = np.zeros((3 * n**3, 3 * n**3)), np.zeros((3 * n**3, 3 * n**3))
        of_cube = cube(material, h)
        for z, y, x in np.ndindex(scene.cells, scene.cells, scene.cells):
            dofs = (3 * number[z : z + 2, y : y + 2, x : x + 2].reshape(-1, 1) + np.arange(3)).ravel()
            stiffness[np.ix_(dofs, dofs)] += of_cube[0]
            mass[np.ix_(dofs, dofs)] += of_cube[1]
        zyx = np.indices((n, n, n)).reshape(3, -1)
        free = np.flatnonzero(np.stack([zyx[2] > 0, zyx[1] > 0, (zyx[0] > 0) | (side == 1)], axis=1))
        self.stiffness, self.mass = stiffness[np.ix_(free, free)], mass[np.ix_(free, free)]
        faces = [(3 * number[layer].reshape(-1, 1) + np.arange(3)).ravel() for layer in (0, -1)]
        bottom, top = (np.eye(3 * n**3)[np.ix_(face, free)] for face in faces)
        self.trace = (top, bottom)[side]  # velocities of the dofs -> W
        width = np.where((np.arange(n) % scene.cells) == 0, h / 2, h)
        self.area = np.repeat(np.outer(width, width), 3)  # of the points: T^T (area F) are nodal forces
        self.press = top.T @ (self.area * np.tile([0.0, 0.0, -1.0], n * n)) * (side == 1)  # forces of a unit pressure
        self.k = np.tile(material.impedance, n * n)  # search direction: k_n along N, k_t across
        self.start = State(*np.zeros((4, len(free))))  # (2)
        self.factorise()

    def factorise(self) -> None:
        """The one operator of all instants and iterations: mass, dashpots k on the interface (14), stiffness."""
        scene, weight = self.scene, 1 + self.scene.alpha
        dashpots = (self.trace.T * (self.area * self.k)) @ self.trace
        operator = scene.gamma * scene.step * dashpots + scene.beta * scene.step**2 * self.stiffness
        self.factor = cho_factor(self.mass + weight * operator)

    def linear_stage(self, q: Array, loads: Array, state: State) -> tuple[Array, Array, State]:
        """(8)-(14): W and F (instant, 3 point) over a window and the state at its end, for incoming F_hat + k W_hat.

        The search direction (12), (13) F - F_hat = -k (W - W_hat) is a traction q = F_hat + k W_hat and a dashpot k.
        """
        scene, w, f = self.scene, np.zeros_like(q), np.zeros_like(q)
        for i in range(len(q)):
            u, v = scene.predict(*state[:3])
            given = loads[i] * self.press + self.trace.T @ (self.area * q[i])
            free = given - self.stiffness @ u - self.trace.T @ (self.area * self.k * (self.trace @ v))
            a = cho_solve(self.factor, (1 + scene.alpha) * free - scene.alpha * state.r)  # (9)
            u, v = u + scene.beta * scene.step**2 * a, v + scene.gamma * scene.step * a  # (10), (11)
            w[i] = self.trace @ v
            f[i] = q[i] - self.k * w[i]  # (12), (13); sigma n = F (4) on the interface
            state = State(u, v, a, loads[i] * self.press + self.trace.T @ (self.area * f[i]) - self.stiffness @ u)
        return w, f, state


# -- The interface -----------------------------------------------------------------------------------------------------
def law(jump: Array, kappa: Array, reach: Array, friction: float | None) -> Array:
    """Traction (point, 3) on side E under which the velocities of both sides fulfil R(W, W', F, F') = 0 (6).

    jump : (point, 3) velocity of E' relative to E without traction; a traction F reduces it by F / kappa.
    reach : opening velocity that closes the gap within the instant.
    """
    if friction is None:
        return kappa * jump  # (7): W = W'
    closing = np.maximum(0.0, -(jump[:, 2] + reach))  # (18), (19)
    pressure = kappa[:, 2] * closing  # (20): -k C_n where k = k' and the indicator C_n < 0
    shear = kappa[:, :2] * jump[:, :2]  # G of (21): it would stop the sliding
    size = np.linalg.norm(shear, axis=1)
    slips = size > friction * pressure
    shear[slips] *= (friction * pressure[slips] / size[slips])[:, None]  # slip (23); all others stick (22)
    return np.column_stack([shear, -pressure])


def local_stage(w: Array, f: Array, k: Array, gaps: tuple[Array, Array, Array], scene: Scene) -> tuple[Array, Array]:
    """(15)-(17): W_hat and F_hat, every point by itself, instant after instant.

    The search direction (16), (17) F_hat - F = k (W_hat - W) gives W_hat = s + F_hat / k with s = W - F / k.
    Contact holds at the end of the instant: 0 <= max(g, 0) / dt + opening velocity, perpendicular to P >= 0, with
    ``gaps``: the gap g at its start, positive when open, and its first two derivatives by time.
    """
    kappa = (1 / (1 / k[0] + 1 / k[1])).reshape(-1, 3)
    w_hat, f_hat, (g, v, a) = np.zeros_like(w), np.zeros_like(f), gaps
    for i in range(len(w)):
        s = w[i] - f[i] / k
        traction = law((s[1] - s[0]).reshape(-1, 3), kappa, np.maximum(g, 0.0) / scene.step, scene.friction).ravel()
        f_hat[i] = traction, -traction
        w_hat[i] = s + f_hat[i] / k
        g, v, a = scene.follow(g, v, a, (w_hat[i, 1] - w_hat[i, 0])[2::3])  # as the displacements of the bodies
    return w_hat, f_hat


def error_indicator(w: Array, f: Array, w_hat: Array, f_hat: Array, area: Array, z: Array) -> float:
    """sqrt(eta) of (24): distance of both stages over their size, in the norm int F Z^-1 F + int W Z W."""

    def squared(w: Array, f: Array) -> float:
        return float((area * (f * f / z + w * w * z)).sum())

    return float(np.sqrt(squared(w - w_hat, f - f_hat) / (squared(w, f) + squared(w_hat, f_hat))))


# -- The iteration -----------------------------------------------------------------------------------------------------
class Solution(NamedTuple):
    """W_hat and F_hat (instant, side, point, 3), and sqrt(eta) after every iteration, window by window."""

    w_hat: Array
    f_hat: Array
    errors: list[list[float]]


def solve(scene: Scene, window: int, tolerance: float = 1e-11, most: int = 1000) -> Solution:
    """Windows of ``window`` instants, each iterated at once; in the paper one window has all of them."""
    bodies = [Substructure(scene, side) for side in (0, 1)]
    k, area = (np.stack([getattr(b, name) for b in bodies]) for name in ("k", "area"))
    states, errors = [b.start for b in bodies], list[list[float]]()
    w_hat, f_hat = np.zeros((scene.instants, *k.shape)), np.zeros((scene.instants, *k.shape))
    for first in range(0, scene.instants, window):
        now, last = slice(first, first + window), max(first - 1, 0)
        lower, upper = ([b.trace @ x for x in state[:3]] for b, state in zip(bodies, states, strict=True))
        gaps = tuple((above - below)[2::3] for below, above in zip(lower, upper, strict=True))
        q = np.zeros_like(w_hat[now]) + f_hat[last] + k * w_hat[last]  # first guess: the fields stay as they are
        errors.append([])
        while len(errors[-1]) < most and (not errors[-1] or errors[-1][-1] > tolerance):
            marched = [b.linear_stage(q[:, e], scene.loads[now], states[e]) for e, b in enumerate(bodies)]
            w, f = (np.stack([one[i] for one in marched], axis=1) for i in (0, 1))
            w_hat[now], f_hat[now] = local_stage(w, f, k, gaps, scene)
            errors[-1].append(error_indicator(w, f, w_hat[now], f_hat[now], area, k))
            q = f_hat[now] + k * w_hat[now]
        if errors[-1][-1] > tolerance:
            raise RuntimeError(
                f"sqrt(eta) = {errors[-1][-1]:.2g} > {tolerance:g} in the window from instant {first + 1}"
            )
        states = [one[2] for one in marched]
    shape = (scene.instants, 2, -1, 3)
    return Solution(w_hat.reshape(shape), f_hat.reshape(shape), errors)


def main(argv: list[str] | None = None) -> None:
    """Solve with one window and with windows of one instant; print, and draw on request."""
    parser = ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--friction", type=float, default=0.1, help="coefficient mu")
    parser.add_argument("--alpha", type=float, default=-0.1, help="0: Newmark")
    parser.add_argument("--figure", help="file of a figure")
    arguments = parser.parse_args(argv)
    if not (0 <= arguments.friction < np.inf and -1 / 3 <= arguments.alpha <= 0):
        parser.error("--friction is at least 0 and finite, --alpha from -1/3 to 0")
    scene = Scene(friction=arguments.friction, alpha=arguments.alpha)
    area = Substructure(scene, 0).area[2::3]
    time, found = 1e6 * scene.step * np.arange(1, scene.instants + 1), {}
    print("window        iterations to sqrt(eta) = 1e-3     1e-11     largest force, N     |friction|, N")
    for name, window in (("all instants", scene.instants), ("one instant", 1)):
        solution = found[name] = solve(scene, window)
        to = [np.mean([np.argmax(np.array(e) <= level) + 1 for e in solution.errors]) for level in (1e-3, 1e-11)]
        force = np.einsum("tpc,p->tc", solution.f_hat[:, 0], area)
        print(f"{name:14}{to[0]:30.1f}{to[1]:10.1f}{-force[:, 2].min():21.3f}{np.hypot(*force.T[:2]).max():18.3f}")
    if arguments.figure:
        import matplotlib.pyplot as plt

        figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
        for label, component, sign in (("pressing", 2, -1), ("friction along x", 0, 1)):
            left.plot(time, 1e-3 * sign * found["all instants"].f_hat[:, 0, :, component] @ area, label=label)
        left.set(xlabel="time (µs)", ylabel="force on the lower specimen (kN)")
        right.semilogy(range(1, 1 + len(found["all instants"].errors[0])), found["all instants"].errors[0])
        right.set(xlabel="iteration of the whole window", ylabel="sqrt(eta)")
        left.legend(frameon=False)
        figure.savefig(arguments.figure, dpi=100)


if __name__ == "__main__":
    main()
