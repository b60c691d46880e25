"""Frequency and damping of a measured joint against the amplitude: the thin Brake-Reuss beam.

models/thin_beam with the measured ring-down of its first mode beside it. Flat faces give the first mode 8 % too high.
A crown of 1.6 m along the beam gives the measured frequency; damping, higher modes and another friction follow from it
without any further choice. Measured is also what the joint does not take: the excess is the damping less that towards
which it falls at small amplitudes.

Curves have four amplitudes: of the crown with three coefficients of friction, of the flat faces, and of the crown on a
second mesh of the lap (``python models/bolted_beam/bolted_beam.py --thin --fine`` makes it; left out where it is not
there). --quick: the crown with friction 0.6 alone, at one amplitude. Twenty minutes of processor time, two with
--quick. A curve is written as thin_beam_CURVE.csv beside the figure; one that is there is read.
Writes thin_beam.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from example_tools import BLUE, GREEN, MODELS, ORANGE, VERMILION, Array, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu

FOLDER = MODELS / "thin_beam"
CROWN = 'interface.lap.form={type="crown",radius=1.6,axis=[0.0,1.0,0.0],centre=[0.0,0.0,0.0]}'
FINE = FOLDER / "thin_beam_fine.msh"
AT_REST = 0.14e-2  # measured damping ratio towards small amplitudes
LEVELS = np.geomspace(10e-6, 100e-6, 4)  # m
TOLERANCE, INCREMENTS = 1e-8, 4
LOOKS = {
    "crown_friction_0.2": (ORANGE, "v-", "crown, friction 0.2"),
    "crown_friction_0.3": (BLUE, "o-", "crown, friction 0.3"),
    "crown_friction_0.6": (GREEN, "^-", "crown, friction 0.6"),
    "fine_friction_0.3": (BLUE, "s:", "finer lap, friction 0.3"),
    "flat_friction_0.3": (VERMILION, "D-", "flat, friction 0.3"),
}


def curve(name: str, folder: Path, levels: Array) -> Array:
    """Amplitude, m, frequency, Hz, and damping ratio (n, 3) of one of the ``LOOKS``."""
    path = folder / f"thin_beam_{name}.csv"
    if not path.exists():
        form, _, friction = name.split("_")
        settings = [f"interface.lap.friction_coefficient={friction}"]
        settings += [] if form == "flat" else [CROWN]
        settings += [f'mesh.beam.file="{FINE.name}"'] if form == "fine" else []
        scene = latin_fmu.load_scene(FOLDER / "scene.toml", settings)
        sensor = "accelerometer1"
        made = latin_fmu.backbone(scene, 1, levels, sensor, tolerance=TOLERANCE, increments=INCREMENTS, within=np.inf)
        path.write_text(made.as_csv(), encoding="utf-8")
        print("\n".join(made.lines()), flush=True)
    return np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)[:, :3]


def measured() -> Array:
    """Amplitude, m, frequency, Hz, and damping ratio (n, 3)."""
    return np.loadtxt(FOLDER / "measured.csv", delimiter=",", skiprows=1) * [1e-6, 1.0, 1e-2]


def exponent(rows: Array, low: float = 10e-6, high: float = 50e-6) -> float:
    """Of the amplitude in the damping between two amplitudes, m; NaN where nothing slides at two of them."""
    inside = (rows[:, 0] > 0.95 * low) & (rows[:, 0] < 1.05 * high) & (rows[:, 2] > 0.0)
    if inside.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(rows[inside, 0]), np.log(rows[inside, 2]), 1)[0])


def figure(curves: dict[str, Array]) -> Figure:
    """Frequency, and damping by the joint, over the amplitude; measured points beside."""
    drawing = Figure(figsize=(9.6, 4.2), layout="constrained")
    drawing.suptitle(
        "Thin Brake-Reuss beam, three bolts of 12 kN: flat faces lose more than measured, a crown less",
        fontweight="bold",
    )
    frequency, damping = drawing.subplots(1, 2)
    points = measured()
    look = {"color": "black", "marker": "x", "linestyle": "none"}
    frequency.plot(1e6 * points[:, 0], points[:, 1], label="measured (damping less 0.14 %)", **look)
    excess = 100 * (points[:, 2] - AT_REST)
    above = excess > 0.005
    damping.plot(1e6 * points[above, 0], excess[above], **look)
    for name, rows in curves.items():
        colour, style, label = LOOKS[name]
        frequency.plot(1e6 * rows[:, 0], rows[:, 1], style, color=colour, markersize=4, label=label)
        slips = rows[:, 2] > 0.0
        if slips.any():
            damping.plot(1e6 * rows[slips, 0], 100 * rows[slips, 2], style, color=colour, markersize=4)
    frequency.set(xscale="log", xlabel="amplitude at accelerometer 1 (µm)", ylabel="frequency (Hz)")
    damping.set(xscale="log", yscale="log", xlabel="amplitude at accelerometer 1 (µm)")
    damping.set_ylabel("damping ratio by friction (%)")
    damping.set_ylim(bottom=5e-4)  # %: below is round-off of the iteration
    frequency.legend(frameon=False, fontsize=8)  # of both
    for axis in (frequency, damping):
        tidy(axis)
    return drawing


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Make the curves, draw them; the numbers."""
    arguments = options(argv, __doc__)
    names = ["crown_friction_0.6"] if arguments.quick else [n for n in LOOKS if "fine" not in n or FINE.exists()]
    levels = LEVELS[-1:] if arguments.quick else LEVELS
    curves = {name: curve(name, arguments.folder, levels) for name in names}
    numbers = {}
    for name, rows in curves.items():
        numbers[f"{name}: frequency, Hz"] = float(rows[0, 1])
        numbers[f"{name}: damping at {1e6 * rows[-1, 0]:.0f} um, %"] = float(100 * rows[-1, 2])
        numbers[f"{name}: exponent, 10 to 50 um"] = exponent(rows)
        numbers[f"{name}: exponent, 20 to 100 um"] = exponent(rows, 20e-6, 100e-6)
    save(figure(curves), arguments.folder, "thin_beam")
    print(table(numbers))
    return numbers


if __name__ == "__main__":
    main()
