"""What friction and preload change in a bolted electronics box under a shock of 1500 g: models/electronics_box.

Four runs: friction of 0.1, 0.2 (the scene) and 0.3, and screws that are tight by hand alone. Shock response spectrum at
the component, tension of the screws, and how far the board slides on the bosses of the tray. A fifth run, at a
tolerance of 1e-6, shows what the default one leaves of tensions and spectra.
Nine minutes of processor time; --quick runs the first 0.3 ms of three of them.
Writes electronics_box.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from example_tools import BLUE, GREEN, MODELS, ORANGE, VERMILION, Array, label_few, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.results.sensors import share_lost

SCENE = MODELS / "electronics_box" / "scene.toml"
G = 9.80665  # m s-2
SHOCK, DURATION, QUALITY = 14710.0, 0.5e-3, 10.0  # of the half sine, m s-2, s; of the oscillators
FREQUENCIES = np.geomspace(100.0, 5000.0, 120)
SCREWS = range(1, 5)
STRICT = "solver.tolerance=1e-6"
CASES = {
    "friction 0.1": (ORANGE, ("contact.joints.friction_coefficient=0.1",)),
    "friction 0.2": (BLUE, ()),
    "friction 0.3": (GREEN, ("contact.joints.friction_coefficient=0.3",)),
    "no preload (10 N)": (VERMILION, tuple(f"bolt.screw{i}.torque=0.006" for i in SCREWS)),
}


@dataclass(frozen=True)
class Run:
    """What is compared of a run.

    Attributes
    ----------
    time : (n,), s. spectrum : (n, 3) maximax at ``FREQUENCIES``, m s-2. tension : (n, 4) of the screws, N.
    slide : (n,) path of the board on the bosses since the start, mean over the area, m. work : of friction, J.
    iterations : mean of an instant. peak : largest acceleration of the component, m s-2.
    """

    time: Array
    spectrum: Array
    tension: Array
    slide: Array
    work: float
    iterations: float
    peak: float

    @property
    def clamp_loss(self) -> float | None:
        """Loss of the mean tension of the four screws over that at the start, None where they were never tight. The end
        is the mean of the second half of the run, by a window that leaves vibrations out."""
        mean = self.tension.mean(axis=1)
        late = mean[len(mean) // 2 :]
        end = np.average(late, weights=np.hanning(len(late)))
        return share_lost(mean, float(end))


def solved(settings: Sequence[str]) -> Run:
    """The scene with other settings."""
    solution = latin_fmu.solve(latin_fmu.load_scene(SCENE, settings))
    outcome = solution.outcome
    if not outcome.converged:
        raise ValueError(outcome.status)
    time, motion, seat = outcome.time, outcome.sensors["component"], outcome.interfaces["tray_board"]
    assert motion.acceleration is not None
    steps = np.linalg.norm(np.diff(seat.slip_path(time), axis=0), axis=2) @ seat.areas / seat.areas.sum()
    friction = [h.friction_power for h in outcome.interfaces.values() if h.friction_power is not None]
    return Run(
        time,
        spectrum_of(motion.acceleration, time[1] - time[0]),
        np.stack([outcome.bolts[f"screw{i}"].force for i in SCREWS], axis=1),
        np.concatenate([[0.0], np.cumsum(steps)]),
        float(np.trapezoid(np.sum(friction, axis=0), time)),
        float(np.mean([w.iterations for w in outcome.windows])),
        float(np.abs(motion.acceleration[:, 2]).max()),
    )


def spectrum_of(acceleration: Array, step: float) -> Array:
    """Maximax of a history (n, ...) at ``FREQUENCIES``, m s-2."""
    made = latin_fmu.shock_response_spectrum(acceleration, step, FREQUENCIES, quality=QUALITY, interpolation="lines")
    return made.acceleration[0]


def figure(runs: dict[str, Run]) -> Figure:
    """Spectra, tensions and slides side by side."""
    drawing = Figure(figsize=(11.0, 4.0), layout="constrained")
    spectra, tensions, slides = drawing.subplots(1, 3)
    step = 1e-6
    pulse = np.where((t := np.arange(0.0, 10e-3, step)) < DURATION, SHOCK * np.sin(np.pi * t / DURATION), 0.0)
    grey = {"color": "0.45", "linewidth": 1.0, "linestyle": (0, (5, 2))}
    spectra.plot(FREQUENCIES, spectrum_of(pulse, step) / G, label="base", **grey)
    for label, one in runs.items():
        colour = CASES[label][0]
        spectra.plot(FREQUENCIES, one.spectrum[:, 2] / G, color=colour, linewidth=1.4, label=label)
        tensions.plot(1e3 * one.time, one.tension.mean(axis=1), color=colour, linewidth=1.0)
        slides.plot(1e3 * one.time, 1e6 * one.slide, color=colour, linewidth=1.4)
    spectra.set(xscale="log", yscale="log", xlabel="frequency (Hz)", ylabel="shock response at the component (g)")
    spectra.set_title("Spectrum, Q = 10", fontsize="medium")
    tensions.set(xlabel="time (ms)", ylabel="tension of a screw, mean of four (N)", ylim=(0.0, None))
    tensions.set_title("Clamp force", fontsize="medium")
    slides.set(xlabel="time (ms)", ylabel="path of the board on the bosses (µm)", ylim=(0.0, None))
    slides.set_title("Slip", fontsize="medium")
    label_few(spectra)
    spectra.set_xticks([100, 200, 500, 1000, 2000, 5000], [100, 200, 500, 1000, 2000, 5000])
    for axis in (spectra, tensions, slides):
        tidy(axis)
    drawing.legend(loc="outside lower center", ncols=5, frameon=False)
    return drawing


def apart(one: Run, strict: Run) -> dict[str, float]:
    """Differences of a run from the one at ``STRICT``, %."""
    spectra = np.abs(one.spectrum / strict.spectrum - 1.0)
    numbers = {"tension": float(np.abs(one.tension / strict.tension - 1.0).max())}
    if one.clamp_loss is not None and strict.clamp_loss is not None:
        numbers["clamp loss, of the tension"] = abs(one.clamp_loss - strict.clamp_loss)
    for axis, own in zip("xyz", spectra.T, strict=True):
        numbers[f"spectrum along {axis}"] = float(own.max())
        numbers[f"spectrum along {axis} from 110 Hz on"] = float(own[FREQUENCIES > 110.0].max())
    found = {f"default against {STRICT}: {name}, %": 100.0 * value for name, value in numbers.items()}
    return found | {f"{STRICT}: iterations": strict.iterations}


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw; the numbers."""
    arguments = options(argv, __doc__)
    chosen = ("friction 0.1", "friction 0.3") if arguments.quick else tuple(CASES)
    shorter = ("time.end=0.3e-3",) if arguments.quick else ()
    runs, numbers = {}, dict[str, float]()
    for label in chosen:
        runs[label] = one = solved((*CASES[label][1], *shorter))
        numbers |= {
            f"{label}: peak of the component, g": one.peak / G,
            f"{label}: largest of the spectrum, g": float(one.spectrum[:, 2].max()) / G,
            f"{label}: at, Hz": float(FREQUENCIES[one.spectrum[:, 2].argmax()]),
            f"{label}: smallest tension, N": float(one.tension.min()),
            f"{label}: largest tension, N": float(one.tension.max()),
            f"{label}: slip, um": 1e6 * float(one.slide[-1]),
            f"{label}: friction work, mJ": 1e3 * one.work,
            f"{label}: iterations": one.iterations,
        }
        if (lost := one.clamp_loss) is None:
            numbers[f"{label}: screws that were never tight"] = len(SCREWS)
        else:
            numbers[f"{label}: clamp loss, %"] = 100.0 * lost
    save(figure(runs), arguments.folder, "electronics_box")
    label = "friction 0.2" if "friction 0.2" in runs else chosen[0]
    return numbers | apart(runs[label], solved((*CASES[label][1], *shorter, STRICT)))


if __name__ == "__main__":
    print(table(main()))
