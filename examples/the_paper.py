"""The examples of the paper: a beam in traction and the crushing of two specimens, with HHT and with Newmark.

Each is solved as published (one window over the interval, from zero, without acceleration) and in windows of one
instant, the default. Writes two figures, in the order of those of the paper (docs/the_paper.md):
  the_paper_beam.png      stress along the bars, how the iterations build it, sqrt(eta) against the iteration
  the_paper_crushing.png  forces between the specimens through the iterations; displacements for four coefficients
The convergence for several coefficients is drawn by convergence_friction.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import convergence_friction as convergence
import numpy as np
import waves_in_bars as bars
from example_tools import BLUE, EXACT, GREEN, MODELS, VERMILION, Array, options, save, table, tidy
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

import latin_fmu
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.pictures.style import LINES

BEAM = MODELS / "beam_in_traction" / "scene.toml"
SPECIMENS = MODELS / "two_specimen_crushing" / "scene.toml"
FRICTION = (0.0, 0.05, 0.1, 10.0)
COARSER = ("substructure.lower.box.elements=[3, 3, 3]", "substructure.upper.box.elements=[3, 3, 3]")
SCHEMES = {"HHT": "time.scheme='hht'", "Newmark": "time.scheme='newmark'"}
OTHERS = {
    "Newmark_damped": "time.scheme={type='newmark',gamma=0.6,beta=0.3025}",
    "generalized_alpha": "time.scheme='generalized_alpha'",
}
ACCELERATED, SINGLE = ("solver.acceleration='anderson'",), ("solver.acceleration='anderson'", "solver.window=1")
TIMES = (bars.SHOWN[1], bars.SHOWN[3], bars.SHOWN[4])  # L/c
EDGE = 0.01  # of a specimen, m
BUILT = (1, 2, 3, 4, 6)  # iterations
# One window over the whole interval from zero fields and without acceleration: the published iteration.
PAPER = (
    "solver.window='whole'",
    "solver.start='zero'",
    "solver.acceleration='none'",
    "solver.max_iterations=60",
    "solver.tolerance=2e-3",
    "solver.force_tolerance=1.0",
)
SHADES = [colormaps["plasma"](float(s)) for s in np.linspace(0.85, 0.1, 6)]


class Recorder:
    """Observer: keeps the displacement of the bars at chosen times after every iteration."""

    def __init__(self, instants: Sequence[int]) -> None:
        self.instants = list(instants)
        self.kept: list[dict[str, Array]] = []

    def __call__(self, event: latin_fmu.Iteration) -> None:
        """The window holds instants 1, 2, ...: instant 0 is the given start."""
        after_start = [i - 1 for i in self.instants]
        self.kept.append({name: event.displacement(name)[after_start] for name in bars.BARS})


@dataclass(frozen=True)
class Beam:
    """A run of the beam: stress, stress at the last of TIMES after each iteration where watched, sqrt(eta), checked
    numbers."""

    stress: bars.Stress
    built: list[bars.Stress]
    errors: list[float]
    numbers: dict[str, float]


def beam(settings: Sequence[str], watched: bool = False) -> Beam:
    """Solve the beam in traction."""
    scene = latin_fmu.load_scene(BEAM, settings)
    watcher = Recorder([round(TIMES[-1] * bars.TRANSIT / scene.time.time_step)])
    solution = latin_fmu.solve(scene, observer=watcher if watched else None)
    nodes = {name: solution.substructures[name].nodes for name in bars.BARS}
    moved = {name: solution.substructures[name].displacement for name in bars.BARS}
    stress = bars.joined(nodes, moved, solution.time / bars.TRANSIT)
    contact = solution.interfaces["contact"]
    area, force = contact.areas.sum(), contact.normal_resultant()
    numbers = {
        "iterations": max(float(w.iterations) for w in solution.windows),
        "sqrt_eta": solution.error_indicator,
        "passes": solution.passes,
        "impulse_over_exact": -contact.impulse(solution.time)[-1, 2] / (0.7 * bars.PRESSURE * bars.TRANSIT * area),
        "largest_force_over_exact": force.max() / (bars.PRESSURE * area),
        "stress_error": bars.relative_error(stress, bars.exact_stress(stress.time[-1])),
    }
    built = [bars.joined(nodes, kept, np.array(TIMES[-1:])) for kept in watcher.kept]
    return Beam(stress, built, solution.windows[0].error_indicator, numbers)


@dataclass(frozen=True)
class Contact:
    """Histories of the contact between the specimens (quarter model): ``normal`` compression > 0 and ``friction`` along
    x on the lower specimen, N; ``slip`` distance slipped while pressed, mean over the face, m."""

    time: Array
    normal: Array
    friction: Array
    slip: Array

    @property
    def separation(self) -> float:
        """Last instant at which the normal force exceeds 1 % of its peak, s."""
        return float(self.time[np.flatnonzero(self.normal > 0.01 * self.normal.max())[-1]])


def contact(time: Array, history: InterfaceHistory) -> Contact:
    """Resultants and slip from the local-stage fields; a window without its start gets it as zero."""
    force, sliding = history.force(), (history.velocity[:, 1] - history.velocity[:, 0])[:, :, :2]  # N is z
    assert history.contact_status is not None
    speed = np.where(history.contact_status > 0, np.linalg.norm(sliding, axis=2), 0.0) @ history.areas
    columns = np.column_stack([-force[:, 2], force[:, 0], speed / history.areas.sum()])
    columns = np.vstack([np.zeros((len(time) - len(columns), 3)), columns])
    slip = np.concatenate([[0.0], np.cumsum(np.diff(time) * columns[1:, 2])])
    return Contact(time, columns[:, 0], columns[:, 1], slip)


def solve(friction: float, settings: Sequence[str]) -> tuple[Contact, latin_fmu.Solution]:
    """The crushing with another friction coefficient and other settings."""
    scene = latin_fmu.load_scene(SPECIMENS, (f"interface.crush.friction_coefficient={friction}", *settings))
    solution = latin_fmu.solve(scene)
    return contact(solution.time, solution.interfaces["crush"]), solution


@dataclass(frozen=True)
class Crushing:
    """Runs of the crushing with one scheme: converged at mu = 0.1, after each iteration; by mu the displacement along z
    of the centres x = y = 0 of both faces (n_time, 2), m, and by how much that of the middle of the free edge y = 0 of
    the lower one along x exceeds that of the upper one (n_time,), m; checked numbers."""

    reference: Contact
    steps: list[Contact]
    centres: dict[float, Array]
    edges: dict[float, Array]
    numbers: dict[str, float]


def crush(settings: Sequence[str]) -> Crushing:
    """Solve the crushing of two specimens."""
    centres, edges, numbers = {}, {}, dict[str, float]()
    for mu in FRICTION:
        found, solution = solve(mu, (*settings, "output.fields=true"))
        centres[mu] = np.stack([moved(solution, name, 0.0)[:, 2] for name in ("lower", "upper")], axis=1)
        edges[mu] = moved(solution, "lower", EDGE)[:, 0] - moved(solution, "upper", EDGE)[:, 0]
        numbers |= {f"passes_mu_{mu:g}": solution.passes, f"separation_us_mu_{mu:g}": 1e6 * found.separation}
        numbers[f"slip_um_mu_{mu:g}"] = 1e6 * float(found.slip[-1])
    reference, _ = solve(0.1, (*settings, "solver.tolerance=1e-6"))
    steps, errors = iterates(0.1, settings, reference.time)
    numbers |= {"sqrt_eta_10": errors[9], "sqrt_eta_30": errors[29]}
    numbers["force_error_30"] = error(steps[29].normal, reference.normal)
    numbers["friction_error_30"] = error(steps[29].friction, reference.friction)
    return Crushing(reference, steps, centres, edges, numbers)


def iterates(friction: float, settings: Sequence[str], time: Array) -> tuple[list[Contact], list[float]]:
    """The same histories, and sqrt(eta), after each iteration of one window over the whole interval."""
    scene = latin_fmu.load_scene(SPECIMENS, (f"interface.crush.friction_coefficient={friction}", *settings, *PAPER))
    kept: list[Contact] = []

    def keep(event: latin_fmu.Iteration) -> None:
        kept.append(contact(time, event.interface("crush")))

    solution = latin_fmu.solve(scene, observer=keep)
    return kept, solution.windows[0].error_indicator


def error(found: Array, reference: Array) -> float:
    """Relative distance of two histories in the mean square."""
    return float(np.linalg.norm(found - reference) / np.linalg.norm(reference))


def moved(solution: latin_fmu.Solution, name: str, x: float) -> Array:
    """Displacement (n_time, 3) of the point (x, 0) of the face at the interface, m."""
    body = solution.substructures[name]
    node = int(np.linalg.norm(body.nodes - [x, 0.0, EDGE], axis=1).argmin())
    assert body.displacement is not None
    return np.asarray(body.displacement[:, node])


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)

    # solve
    coarser = bars.COARSER if arguments.quick else ()
    schemes = SCHEMES | OTHERS
    found = {name: beam((scheme, *coarser), watched=name == "HHT") for name, scheme in schemes.items()}
    ways = {
        f"{name}_{way}": beam((scheme, *settings, *coarser))
        for name, scheme in schemes.items()
        for way, settings in (("accelerated", ACCELERATED), ("single_instants", SINGLE))
    }
    coarser = COARSER if arguments.quick else ()
    crushed = {name: crush((scheme, *coarser)) for name, scheme in SCHEMES.items()}

    # check
    runs = found | ways
    numbers = {f"beam_{name}_{key}": value for name, run in runs.items() for key, value in run.numbers.items()}
    numbers |= {f"beam_{name}_sqrt_eta_6": run.errors[5] for name, run in found.items()}
    numbers |= {f"crushing_{name}_{key}": value for name, run in crushed.items() for key, value in run.numbers.items()}

    coefficients = convergence.FRICTION[:1] if arguments.quick else convergence.FRICTION
    for name, scheme in SCHEMES.items():
        for mu in coefficients:
            _, long = solve(mu, (scheme, "solver.window='whole'", *coarser))
            numbers[f"crushing_{name}_long_window_iterations_mu_{mu:g}"] = float(long.windows[0].iterations)
            numbers[f"crushing_{name}_long_window_passes_mu_{mu:g}"] = long.passes
    for acceleration in convergence.PANELS:
        for mu in coefficients:
            kept = mu or convergence.NEARLY_NONE  # tangential unknowns
            errors = convergence.indicator(kept, acceleration, (SCHEMES["Newmark"], *coarser))
            numbers[f"crushing_Newmark_{acceleration}_iterations_mu_{mu:g}"] = convergence.iterations_to(errors, 1e-3)

    # save
    save(figure_of_beam(found), arguments.folder, "the_paper_beam", dpi=110)
    save(figure_of_crushing(crushed), arguments.folder, "the_paper_crushing", dpi=96)
    return numbers


def figure_of_beam(found: dict[str, Beam]) -> Figure:
    """Stress by both schemes on the left; on the right the iterations that build it, and sqrt(eta)."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=(1.7, 1.0))
    left, right = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    exact = bars.exact_stress(found["HHT"].stress.time[-1])
    axes = left.subplots(len(TIMES), len(SCHEMES), sharex=True, sharey=True)
    for column, name in zip(axes.T, SCHEMES, strict=True):
        run = found[name]
        for axis, time in zip(column, TIMES, strict=True):
            bars.draw_bars(axis)
            axis.plot(run.stress.x, run.stress.at(time), color=BLUE, linewidth=1.3, label="computed")
            axis.plot(exact.x, exact.at(time), **EXACT)
            axis.text(0.01, 0.93, f"t = {time:.2f} L/c", va="top", fontsize="small", transform=axis.transAxes)
        column[0].set_title(f"{name}, converged", fontsize="medium", pad=16)
        bars.name_bars(column[0])
        column[-1].set_xlabel("place along the bars (m)")
    axes[0, 0].legend(loc="upper right", fontsize="small", ncols=2, frameon=False)
    left.supylabel("stress (MPa), tension > 0", fontsize="medium")
    curves = {name: found[name].errors for name in SCHEMES}
    curves["Newmark, $\\gamma$ = 0.6"] = found["Newmark_damped"].errors
    draw_iterations(right, found["HHT"], exact, curves)
    return figure


def draw_iterations(figure: SubFigure, run: Beam, exact: bars.Stress, curves: dict[str, list[float]]) -> None:
    """Stress after some iterations with HHT above, sqrt(eta) of the schemes below."""
    top, bottom = figure.subplots(2, 1)
    bars.draw_bars(top)
    for iteration, shade in zip(BUILT, SHADES, strict=False):
        line = run.built[iteration - 1]
        top.plot(line.x, line.at(TIMES[-1]), color=shade, linewidth=1.3, label=f"{iteration}")
    top.plot(exact.x, exact.at(TIMES[-1]), **{**EXACT, "label": None})
    top.legend(fontsize="small", frameon=False, ncols=5, loc="upper center", title="after iteration", columnspacing=0.8)
    top.set(xlabel="place along the bars (m)", ylabel="MPa", ylim=(-150, 290))
    top.set_title(f"HHT, t = {TIMES[-1]:.2f} L/c", fontsize="medium")
    for (name, errors), colour, style in zip(curves.items(), (BLUE, VERMILION, GREEN), LINES, strict=False):
        bottom.semilogy(range(1, len(errors) + 1), errors, color=colour, linestyle=style, linewidth=1.4, label=name)
        bottom.plot(len(errors), errors[-1], "o", color=colour, markersize=4)
    bottom.axhline(1e-3, color="0.6", linewidth=0.8, linestyle=":")
    bottom.set(xlabel="iteration", ylabel="sqrt(eta)")
    bottom.legend(fontsize="small", frameon=False)
    tidy(bottom)


def figure_of_crushing(crushed: dict[str, Crushing]) -> Figure:
    """Force and friction after some iterations, one row per scheme; displacements for each mu with HHT."""
    figure = Figure(figsize=(11.0, 5.8), layout="constrained")
    axes = figure.subplots(len(crushed), 3, sharex=True)
    time = 1e6 * crushed["HHT"].reference.time
    for row, (name, run) in zip(axes, crushed.items(), strict=True):
        for iteration, shade in zip((1, 2, 4, 8, 30), SHADES, strict=False):
            step = run.steps[iteration - 1]
            row[0].plot(time, 1e-3 * step.normal, color=shade, linewidth=1.3, label=f"iteration {iteration}")
            row[1].plot(time, 1e-3 * step.friction, color=shade, linewidth=1.3)
        for axis, history in zip(row, (run.reference.normal, run.reference.friction), strict=False):
            axis.plot(time, 1e-3 * history, color="black", linewidth=0.9, linestyle=(0, (5, 2)), label="converged")
        row[0].set_title(f"{name}: normal force (kN), $\\mu$ = 0.1", fontsize="medium")
        row[1].set_title(f"{name}: friction force along x (kN), $\\mu$ = 0.1", fontsize="medium")
    draw_displacements(axes[0, 2], axes[1, 2], time, crushed["HHT"])
    for axis in axes.ravel():
        axis.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
        tidy(axis)
    for axis in axes[-1]:
        axis.set(xlabel="time (µs)", xlim=(0.0, time[-1]))
    axes[0, 0].legend(fontsize="small", frameon=False)
    axes[0, 2].legend(fontsize="small", frameon=False)
    return figure


def draw_displacements(centres: Axes, edges: Axes, time: Array, run: Crushing) -> None:
    """Displacement of the centres of both faces, equal until they part; sliding of the edges."""
    colours = (BLUE, GREEN, VERMILION, "black")
    for (mu, both), colour, style in zip(run.centres.items(), colours, LINES, strict=False):
        centres.plot(time, 1e6 * both[:, 0], color=colour, linestyle=style, linewidth=1.3, label=f"$\\mu$ = {mu:g}")
        centres.plot(time, 1e6 * both[:, 1], color=colour, linestyle=style, linewidth=1.3)
        edges.plot(time, 1e6 * run.edges[mu], color=colour, linestyle=style, linewidth=1.3)
    centres.set_title("HHT: centres of both faces, $u_z$ (µm)", fontsize="medium")
    edges.set_title("HHT: sliding of the free edges, $u_x - u'_x$ (µm)", fontsize="medium")


if __name__ == "__main__":
    print(table(main()))
