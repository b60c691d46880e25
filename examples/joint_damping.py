"""Frequency and damping of a bolted joint against the amplitude: the Brake-Reuss beam after hammer hits.

models/bolted_beam is tightened once and hit at one end with forces of several sizes. Half the sum of the motions of
both ends less that of the middle is free of rigid motions. Over every two periods of its ring-down,

    b(t) = exp(-zeta w t) (A cos w t + B sin w t) + C + D t

is fitted to it. Friction at the rims of the pressure below the bolts takes energy: damping rises with the amplitude,
the frequency falls. Error bars: difference to the same fit with steps twice as long, and the damping of a run without
friction, which is that of time scheme and iteration (both only without --quick, which takes a minute; ten minutes
else).
Writes joint_damping.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from example_tools import BLUE, MODELS, VERMILION, Array, options, save, table, tidy
from matplotlib.figure import Figure
from scipy.optimize import least_squares

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.march import march
from latin_fmu.scene.schema import Scene
from latin_fmu.statics.statics import tightened

SCENE = MODELS / "bolted_beam" / "scene.toml"
PULSE, GUESS = 2.6e-3, 170.0  # s, of the hammer; Hz
PERIODS = 2.0  # of one fit


@dataclass(frozen=True)
class RingDown:
    """Bending of the beam after one hit.

    Attributes
    ----------
    force : of the hammer, N. time : (n,), s. bending : (n,), m.
    """

    force: float
    time: Array
    bending: Array

    def fits(self) -> Array:
        """Amplitude, m, frequency, Hz, and damping ratio of one window after the other, (n_window, 3)."""
        rows, start = [], PULSE + 0.5 / GUESS
        while start + PERIODS / GUESS <= self.time[-1] + 1e-9:
            rows.append(fit(*self._window(start, start + PERIODS / GUESS)))
            start += PERIODS / GUESS
        return np.array(rows)

    def _window(self, start: float, end: float) -> tuple[Array, Array]:
        inside = (self.time >= start) & (self.time <= end)
        return self.time[inside] - start, self.bending[inside]


def fit(time: Array, bending: Array) -> tuple[float, float, float]:
    """Amplitude, m, frequency, Hz, and damping ratio of a damped oscillation about a line; (n,) each."""

    def parts(unknown: Array) -> tuple[Array, Array]:
        w, zeta = 2 * np.pi * GUESS * unknown[0], unknown[1]
        decay = np.exp(-zeta * w * time)
        basis = np.stack([decay * np.cos(w * time), decay * np.sin(w * time), np.ones_like(time), time], axis=1)
        return basis, np.linalg.lstsq(basis, bending, rcond=None)[0]

    def miss(unknown: Array) -> Array:
        basis, weights = parts(unknown)
        rest: Array = (basis @ weights - bending) / np.abs(bending).max()
        return rest

    best = least_squares(miss, np.array([1.0, 1e-3]), x_scale=[1e-2, 1e-3], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    weights = parts(best)[1]
    return float(np.hypot(*weights[:2])), float(GUESS * best[0]), float(best[1])


def ring_downs(scene: Scene, forces: Sequence[float]) -> list[RingDown]:
    """The beam tightened once, and its motion after hits of each of the forces, N."""
    made, state = [], None
    for force in forces:
        data = scene.tables()
        data["load"]["hammer"]["force"] = [0.0, 0.0, force]
        discretised = discretise(latin_fmu.scene_from_dict(data, scene.base_dir))
        state = tightened(discretised, {}) if state is None else state
        outcome = march(discretised.build(state)).outcome
        if not outcome.converged:
            raise ValueError(outcome.status)
        left, right, middle = (outcome.sensors[name].displacement[:, 2] for name in ("left", "right", "middle"))
        made.append(RingDown(force, outcome.time, 0.5 * (left + right) - middle))
        print(f"hit of {force:g} N: {outcome.status}", flush=True)
    return made


def figure(runs: Sequence[RingDown], fits: Sequence[Array], errors: Sequence[Array]) -> Figure:
    """Ring-downs over the hits, frequency and damping over the amplitude."""
    drawing = Figure(figsize=(11.0, 3.9), layout="constrained")
    drawing.suptitle(
        "Brake-Reuss beam, three bolts of 12 kN: the harder the hit, the lower and the more damped", fontweight="bold"
    )
    motion, frequency, damping = drawing.subplots(1, 3)
    for one in runs:
        motion.plot(1e3 * one.time, 1e6 * one.bending / one.force, linewidth=1.0, label=f"{one.force:g} N")
    motion.set(xlabel="time (ms)", ylabel="bending over force of the hit (µm/N)")
    motion.legend(frameon=False, title="hit", ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    size = np.concatenate([1e6 * f[:, 0] for f in fits])
    both = np.concatenate([f[:, 1:] for f in fits])
    bars = np.concatenate(list(errors))
    style = {"fmt": "o", "markersize": 4, "capsize": 3, "linewidth": 1.0}
    frequency.errorbar(size, both[:, 0], yerr=bars[:, 0], color=BLUE, **style)
    frequency.set(xscale="log", xlabel="amplitude of the bending (µm)", ylabel="frequency (Hz)")
    below = np.minimum(bars[:, 1], 0.9 * np.abs(both[:, 1]))  # the scale is logarithmic
    damping.errorbar(size, 100 * both[:, 1], yerr=100 * np.stack([below, bars[:, 1]]), color=VERMILION, **style)
    damping.set(xscale="log", yscale="log", xlabel="amplitude of the bending (µm)", ylabel="damping ratio (%)")
    for axis in (motion, frequency, damping):
        tidy(axis)
    return drawing


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Hit, fit, draw; the numbers."""
    arguments = options(argv, __doc__)
    forces, step, end = ((1000.0,), 40e-6, 18e-3) if arguments.quick else ((10.0, 100.0, 1000.0), 10e-6, 30e-3)
    settings = [f"time.step={step}", f"time.end={end}", "output.energy=false", "output.interfaces_every=50"]
    if arguments.quick:
        # steps of 40 us: in the first slip an instant needs Newton steps, which the scene leaves out for shorter ones
        settings += ["solver.tolerance=1e-5", "time.start.increments=1", "solver.newton=true"]
    runs = ring_downs(latin_fmu.load_scene(SCENE, settings), forces)
    fits = [one.fits() for one in runs]
    errors = [np.zeros((len(f), 2)) for f in fits]
    numbers: dict[str, float] = {}
    if not arguments.quick:
        coarse = ring_downs(latin_fmu.load_scene(SCENE, [*settings, f"time.step={2 * step}"]), forces)
        errors = [np.abs(f[:, 1:] - c.fits()[:, 1:]) for f, c in zip(fits, coarse, strict=True)]
        smooth = latin_fmu.load_scene(SCENE, [*settings, "interface.lap.friction_coefficient=0.0"])
        floor = ring_downs(smooth, forces[-1:])[0].fits()
        numbers["damping_without_friction"] = float(floor[0, 2])
        errors = [e + np.abs([0.0, floor[0, 2]]) for e in errors]
    for one, rows in zip(runs, fits, strict=True):
        numbers |= {
            f"{what}_{one.force:g}_N": float(value)
            for what, value in zip(("amplitude_um", "frequency_Hz", "damping"), rows[0] * [1e6, 1, 1], strict=True)
        }
    if len(forces) > 1:
        low, high = (numbers[f"damping_{force:g}_N"] for force in (forces[0], forces[-1]))
        numbers["damping_ratio"], numbers["frequency_fall_Hz"] = high / low, fits[0][0, 1] - fits[-1][0, 1]
    save(figure(runs, fits, errors), arguments.folder, "joint_damping")
    print(table(numbers))
    return numbers


if __name__ == "__main__":
    main()
