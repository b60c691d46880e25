"""Convergence of the whole window for several coefficients of friction: sqrt(eta) against the iteration.

The crushing of two specimens as one window over the whole interval, started from zero. Where mu = 0 the package has no
tangential unknowns; the published iteration has them at every mu. With them the number of iterations hardly depends on
friction, and it is larger than without: a dashpot k_t lets the slow shear of a specimen pass, which stores energy and
radiates none. A search direction with a spring as well,

    F - F_hat = -k (W - W_hat) - K (U - U_hat),    K = G / L along the face (G shear modulus, L edge of a specimen)

follows that shear; with it, friction makes little difference. The package has the dashpot alone; the spring is tried
here, with the linear stage of latin_in_numpy. Writes convergence_friction.png, and prints what else was tried and other
meshes, steps and materials (five minutes in all).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from example_tools import COLOURS, MODELS, Array, options, save, table, tidy
from latin_in_numpy import Material, Scene, Substructure, law
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import sparse

import latin_fmu
from latin_fmu.kernels.acceleration import Anderson

SCENE = MODELS / "two_specimen_crushing" / "scene.toml"
FRICTION = (0.0, 0.05, 0.1, 0.3, 10.0)
NEARLY_NONE = 1e-9  # keeps the tangential unknowns of the package
COARSER = ("substructure.lower.box.elements=[3, 3, 3]", "substructure.upper.box.elements=[3, 3, 3]", "time.step=0.3e-6")
TOLERANCE, MOST = 1e-3, 120
# The figure shows the indicator, so the stopping rule on forces is out of the way here.
WINDOW = (
    "solver.window='whole'",
    "solver.start='zero'",
    f"solver.max_iterations={MOST}",
    f"solver.tolerance={TOLERANCE}",
    "solver.force_tolerance=1.0",
)
PANELS = {"none": "plain iteration", "anderson": "with Anderson acceleration (depth 6)"}
DEPTH = {"none": 0, "anderson": 6}
SPRING = 1.0  # times G / L
FULL, COARSE = (Scene(cells=cells, step=0.15e-6, instants=200) for cells in (6, 3))
QUICK = Scene(cells=3, step=0.3e-6, instants=100)
TRIED = {  # factor on k_n, on k_t, springs over G / L, depth, relaxation
    "k, depth 6": (1.0, 1.0, 0.0, 6, 1.0),
    "k, depth 20": (1.0, 1.0, 0.0, 20, 1.0),
    "k, plain, relaxation 0.9": (1.0, 1.0, 0.0, 0, 0.9),
    "k_t / 2": (1.0, 0.5, 0.0, 6, 1.0),
    "2 k_t": (1.0, 2.0, 0.0, 6, 1.0),
    "k_n / 2": (0.5, 1.0, 0.0, 6, 1.0),
    "spring G / 2 L": (1.0, 1.0, 0.5, 6, 1.0),
    "spring G / L": (1.0, 1.0, 1.0, 6, 1.0),
    "spring 2 G / L": (1.0, 1.0, 2.0, 6, 1.0),
}
STEEL, ALUMINIUM, SOFT = COARSE.materials[1], COARSE.materials[0], Material(2.1e9, 0.3, 1200.0)
VARIED = {
    "4 elements per edge": replace(COARSE, cells=4),
    "steps of 0.3 us": QUICK,
    "Newmark": replace(COARSE, alpha=0.0),
    "steel on steel": replace(COARSE, materials=(STEEL, STEEL)),
    "steel on a soft specimen": replace(COARSE, materials=(SOFT, STEEL)),
    "aluminium on steel": replace(COARSE, materials=(STEEL, ALUMINIUM)),
}


def indicator(friction: float, acceleration: str, settings: Sequence[str]) -> list[float]:
    """sqrt(eta) of the package after each iteration of the window; a stall is followed by relaxation 1/2."""
    chosen = (f"interface.crush.friction_coefficient={friction}", f"solver.acceleration='{acceleration}'")
    solution = latin_fmu.solve(latin_fmu.load_scene(SCENE, (*chosen, *WINDOW, *settings)))
    return solution.windows[0].error_indicator[:MOST]  # behind it: that of windows of one instant, the next fall-back


class Window:
    """The whole window with dashpots and springs on the interface: F + k W + K U is what the iteration works on."""

    def __init__(self, scene: Scene, normal: float = 1.0, tangential: float = 1.0, spring: float = 0.0) -> None:
        self.scene, self.bodies = scene, [Substructure(scene, side) for side in (0, 1)]
        springs = []
        for body, material in zip(self.bodies, scene.materials, strict=True):
            points = len(body.k) // 3
            body.k = body.k * np.tile([tangential, tangential, normal], points)
            springs.append(np.tile([1.0, 1.0, 0.0], points) * spring * material.lame[1] / scene.edge)
            body.stiffness = body.stiffness + (body.trace.T * (body.area * springs[-1])) @ body.trace
            body.factorise()
            body.stiffness, body.trace = sparse.csr_array(body.stiffness), sparse.csr_array(body.trace)
        self.k, self.area = (np.stack([getattr(b, name) for b in self.bodies]) for name in ("k", "area"))
        self.spring = np.stack(springs)
        self.z = np.stack([np.tile(m.impedance, self.k.shape[1] // 3) for m in scene.materials])

    def linear_stage(self, q: Array) -> tuple[Array, Array]:
        """W, and F - k W - K U."""
        loads = np.zeros(len(q)), self.scene.loads
        marched = [b.linear_stage(q[:, e], loads[e], b.start) for e, b in enumerate(self.bodies)]
        w, without = (np.stack([one[i] for one in marched], axis=1) for i in (0, 1))
        motion = (np.zeros_like(w[0]),) * 3
        displacement = np.zeros_like(w)
        for i in range(len(w)):
            motion = self.scene.follow(*motion, w[i])
            displacement[i] = motion[0]
        return w, without - self.k * w - 2.0 * self.spring * displacement  # the stage gives q - k W = F + K U

    def local_stage(self, p: Array) -> tuple[Array, Array, Array]:
        """W_hat, F_hat and F_hat + k W_hat + K U_hat from F_hat - k W_hat - K U_hat = p."""
        scene, q = self.scene, np.zeros_like(p)
        w_hat, f_hat, motion = np.zeros_like(p), np.zeros_like(p), (np.zeros_like(p[0]),) * 3
        stiff = self.k + self.spring * scene.beta * scene.step / scene.gamma  # of a velocity of the new instant
        kappa = (1.0 / (1.0 / stiff[0] + 1.0 / stiff[1])).reshape(-1, 3)
        for i in range(len(p)):
            rest = scene.follow(*motion, np.zeros_like(p[0]))[0]
            s = -(p[i] + self.spring * rest) / stiff
            gap = (motion[0][1] - motion[0][0])[2::3]
            reach = np.maximum(gap, 0.0) / scene.step
            traction = law((s[1] - s[0]).reshape(-1, 3), kappa, reach, scene.friction).ravel()
            f_hat[i] = traction, -traction
            w_hat[i] = s + f_hat[i] / stiff
            motion = scene.follow(*motion, w_hat[i])
            q[i] = f_hat[i] + self.k * w_hat[i] + self.spring * motion[0]
        return w_hat, f_hat, q

    def error(self, w: Array, f: Array, w_hat: Array, f_hat: Array) -> float:
        """sqrt(eta) as in the package: relative to the tractions and to the velocities of the sides relative to each
        other."""
        both = self.area[0] * self.z[0] * self.z[1] / self.z.sum(axis=0)
        apart = (self.area * ((f - f_hat) ** 2 / self.z + (w - w_hat) ** 2 * self.z)).sum()
        size = sum(
            (self.area * g * g / self.z).sum() + (both * (v[:, 1] - v[:, 0]) ** 2).sum()
            for v, g in ((w, f), (w_hat, f_hat))
        )
        return float(np.sqrt(apart / size))

    def iterate(self, friction: float | None, depth: int, relaxation: float = 1.0) -> list[float]:
        """sqrt(eta) after each iteration from zero; ``friction`` None: bonded."""
        self.scene = replace(self.scene, friction=friction)
        q, errors = np.zeros((self.scene.instants, *self.k.shape)), list[float]()
        acceleration = Anderson(np.tile((self.area / self.k).ravel(), len(q)), depth, relaxation)
        while len(errors) < MOST and (not errors or errors[-1] > TOLERANCE):
            w, p = self.linear_stage(q)
            w_hat, f_hat, new = self.local_stage(p)
            f = 0.5 * (q + p)  # q = F + k W + K U
            errors.append(self.error(w, f, w_hat, f_hat))
            q = acceleration.next(q.ravel(), (new - q).ravel()).reshape(q.shape)
        self.fields = w_hat, f_hat
        return errors


def iterations_to(errors: Sequence[float], level: float) -> float:
    """First iteration at or below ``level``; infinite when it is never reached."""
    return next((float(i) for i, e in enumerate(errors, 1) if e <= level), float("inf"))


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)

    # solve: the package, with a black curve without tangential unknowns, and springs
    settings, coefficients = (COARSER, FRICTION[::2]) if arguments.quick else ((), FRICTION)
    curves = {a: {mu: indicator(mu or NEARLY_NONE, a, settings) for mu in coefficients} for a in PANELS}
    without = {a: indicator(0.0, a, settings) for a in PANELS}
    sprung = Window(QUICK if arguments.quick else FULL, spring=SPRING)
    with_springs = {a: {mu: sprung.iterate(mu, DEPTH[a]) for mu in coefficients} for a in PANELS}

    # check
    numbers = {
        f"{direction}{name}_iterations_to_{level:g}_mu_{mu:g}": iterations_to(errors, level)
        for direction, panels in (("", curves), ("springs_", with_springs))
        for name, rows in panels.items()
        for level in (1e-2, TOLERANCE)
        for mu, errors in rows.items()
    }
    numbers |= {f"{a}_iterations_without_tangential_unknowns": iterations_to(e, TOLERANCE) for a, e in without.items()}
    for name in ("k, depth 6", "spring G / L") if arguments.quick else TRIED:
        normal, tangential, spring, depth, relaxation = TRIED[name]
        window = Window(QUICK if arguments.quick else COARSE, normal, tangential, spring)
        for mu in (10.0,) if arguments.quick else (0.0, 0.1, 0.3, 10.0, None):
            count = iterations_to(window.iterate(mu, depth, relaxation), TOLERANCE)
            numbers[f"tried: {name}, {'bonded' if mu is None else f'mu {mu:g}'}"] = count
    for name, scene in ({} if arguments.quick else VARIED).items():
        for spring in (0.0, SPRING):
            window = Window(scene, spring=spring)
            for mu in (0.0, 0.1, 10.0):
                count = iterations_to(window.iterate(mu, DEPTH["anderson"]), TOLERANCE)
                numbers[f"varied: {name}, spring {spring:g} G/L, mu {mu:g}"] = count

    # save
    figure = figure_of_convergence([curves, with_springs], without)
    save(figure, arguments.folder, "convergence_friction", dpi=110)
    return numbers


def figure_of_convergence(
    rows: Sequence[dict[str, dict[float, list[float]]]], without: dict[str, list[float]]
) -> Figure:
    """Plain and accelerated side by side, one curve per coefficient; dashpots above, springs as well below."""
    figure = Figure(figsize=(10.0, 7.2), layout="constrained")
    figure.suptitle("Crushing of two specimens, one window of 200 instants from zero", fontweight="bold")
    axes = figure.subplots(2, len(PANELS), sharex=True, sharey=True)
    for line, panels, direction in zip(axes, rows, ("dashpot k", "dashpot k, spring G/L"), strict=True):
        for axis, (name, title) in zip(line, PANELS.items(), strict=True):
            if direction == "dashpot k":
                label = "$\\mu$ = 0, without\ntangential unknowns"
                axis.semilogy(range(1, 1 + len(without[name])), without[name], "k--", linewidth=1.2, label=label)
            draw_curves(axis, panels[name])
            axis.set_title(f"{direction}: {title}", fontsize="medium")
        line[0].set_ylabel("sqrt(eta)")
    for axis in axes[-1]:
        axis.set_xlabel("iteration")
    axes[0, 0].legend(fontsize="small", frameon=False)
    return figure


def draw_curves(axis: Axes, rows: dict[float, list[float]]) -> None:
    """sqrt(eta) against the iteration; a dot where the tolerance is met."""
    for (mu, errors), colour in zip(rows.items(), COLOURS, strict=False):
        axis.semilogy(range(1, len(errors) + 1), errors, color=colour, linewidth=1.5, label=f"$\\mu$ = {mu:g}")
        axis.plot(len(errors), errors[-1], "o", color=colour, markersize=5)
    for level in (1e-2, TOLERANCE):
        axis.axhline(level, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    axis.set_xlim(left=0.0)
    axis.grid(axis="y", color="0.92", linewidth=0.6)
    tidy(axis)


if __name__ == "__main__":
    print(table(main()))
