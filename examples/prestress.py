"""What the stress that a motion starts from does to frequencies: a stack under a clamp force, a strip under heat.

Left: four slender parts on each other, held by friction under a force, tapped from the side. Modes about the pressed
state, the ring-down of runs with contact and friction, and the exact frequency of a column whose load is the same share
of that at which it buckles. Right: a strip between walls under heat, whose frequency falls to zero where it buckles and
rises where it is cooled, nearly by f^2 = f_0^2 (1 - T/T_0), exact where it buckles and vibrates in one shape. Grey:
without the stiffness of stress. Half a minute. Writes prestress.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.optimize
from example_tools import BLUE, EXACT, VERMILION, Array, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu

STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0, "thermal_expansion": 12e-6}
SIDE, HEIGHT, PARTS = 0.01, 0.075, 4
STEP = 4e-5
GREY = {"color": "0.6", "linewidth": 1.2}


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, print, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)
    forces = np.array([500.0, 2500.0, 4300.0]) if arguments.quick else np.linspace(500.0, 4500.0, 9)
    changes = np.array([-20.0, 14.0]) if arguments.quick else np.array([-40.0, -20.0, 0.0, 8.0, 14.0, 20.0, 24.0, 27.0])
    pressed = np.array([modes(stack(force)) for force in forces])
    rung = np.array([ring_down(stack(force, end=8.0 / f)) for force, (f, _) in zip(forces, pressed, strict=True)])
    plain = modes(stack(forces[0], prestress="off"))[0]
    buckles = float(np.median(forces * pressed[:, 1]))
    heated = np.array([modes(strip(change))[0] for change in changes])
    cold = modes(strip(1.0, prestress="off"))[0]
    critical = modes(strip(14.0))[1] * 14.0
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    grid = np.linspace(0.0, 0.999, 200)
    left.plot(grid * buckles / 1e3, plain * np.array([column(share) for share in grid]), **EXACT)
    left.plot(forces / 1e3, np.full(len(forces), plain), **GREY, label="without the stiffness of stress")
    left.plot(forces / 1e3, pressed[:, 0], "o", color=BLUE, label="modes")
    left.plot(forces / 1e3, rung, "x", color=VERMILION, label="ring-down of the run")
    left.set(xlabel="clamp force, kN", ylabel="frequency, Hz", title="Four parts in contact, with friction")
    grid = np.linspace(changes.min(), critical, 200)
    one_shape = {**EXACT, "label": "$f_0\\sqrt{1 - T/T_0}$"}
    right.plot(grid, cold * np.sqrt(1.0 - grid / critical), **one_shape)
    right.plot(changes, np.full(len(changes), cold), **GREY)
    right.plot(changes, heated, "o", color=BLUE)
    right.set(xlabel="change of temperature, K", ylabel="frequency, Hz", title="A strip between walls")
    for axis in (left, right):
        axis.legend(frameon=False, fontsize=8, loc="lower left")
        axis.set_ylim(bottom=0.0)
        tidy(axis)
    save(figure, arguments.folder, "prestress")
    exact = plain * np.array([column(force / buckles) for force in forces])
    numbers = {
        "stack without load, Hz": plain,
        "buckling of the stack, N": buckles,
        "modes against the column, %": 100.0 * float(np.abs(pressed[:, 0] / exact - 1.0).max()),
        "ring-down against modes, %": 100.0 * float(np.abs(rung / pressed[:, 0] - 1.0).max()),
        "strip, buckling at K": critical,
        "strip against f_0 sqrt(1 - T/T_0), %": 100.0
        * float(np.abs(heated / (cold * np.sqrt(1.0 - changes / critical)) - 1.0).max()),
    }
    print(table(numbers))
    return numbers


def stack(force: float, prestress: str = "automatic", end: float = 0.01) -> latin_fmu.Scene:
    """Four slender parts on each other under a force, N, tapped from the side."""
    box = {"size": [SIDE, SIDE, HEIGHT], "elements": [2, 2, 10]}
    parts = {f"p{i}": box | {"origin": [0.0, 0.0, HEIGHT * i]} for i in range(PARTS)}
    joints = {
        f"i{i}": {"sides": [f"p{i - 1}.zmax", f"p{i}.zmin"], "friction_coefficient": 0.3} for i in range(1, PARTS)
    }
    top = f"p{PARTS - 1}"
    tap = {"face": f"{top}.xmax", "force": [0.2, 0.0, 0.0], "law": {"type": "half_sine", "duration": 1e-3}}
    data: dict[str, Any] = {
        "name": "stack",
        "material": {"steel": STEEL},
        "substructure": {n: {"material": "steel", "bending_modes": True, "box": b} for n, b in parts.items()},
        "interface": joints,
        "boundary": {
            "base": {"type": "fixed", "face": "p0.zmin"},
            **{f"{name}_side": {"type": "symmetry", "face": f"{name}.ymin"} for name in parts},
        },
        "load": {"clamp": {"face": f"{top}.zmax", "pressure": force / SIDE**2, "law": "constant"}, "tap": tap},
        "sensor": {"top": {"substructure": top, "point": [SIDE, SIDE / 2, PARTS * HEIGHT]}},
        "effects": {"prestress": prestress},
        "solver": {"tolerance": 1e-5},
        "time": {"end": STEP * round(end / STEP), "step": STEP, "start": {"type": "static"}},
    }
    return latin_fmu.scene_from_dict(data)


def strip(change: float, prestress: str = "automatic") -> latin_fmu.Scene:
    """A strip between two walls, heated by a number of K."""
    box = {"size": [0.1, 0.01, 0.001], "elements": [40, 4, 1]}
    data: dict[str, Any] = {
        "name": "strip",
        "material": {"steel": STEEL},
        "substructure": {"strip": {"material": "steel", "bending_modes": True, "box": box}},
        "boundary": {face: {"type": "fixed", "face": f"strip.{face}"} for face in ("xmin", "xmax")},
        "temperature": {"heat": {"change": change}} if change else {},
        "effects": {"prestress": prestress},
        "time": {"end": 1e-3, "step": 1e-5, "start": {"type": "static"}},
    }
    return latin_fmu.scene_from_dict(data)


def modes(scene: latin_fmu.Scene) -> tuple[float, float]:
    """First frequency about the state at t = 0, Hz, and load factor of buckling; infinite where none is said."""
    found = latin_fmu.vibration_modes(scene, count=1)
    words = " ".join(found.remarks).partition("buckles at ")[2]
    return float(found.frequency[found.n_rigid]), float(words.split()[0]) if words else np.inf


def ring_down(scene: latin_fmu.Scene) -> float:
    """Frequency of the free motion after the tap, Hz, by the times at which it passes its mean upwards."""
    solution = latin_fmu.solve(scene)
    assert solution.converged, solution.status
    later = solution.time > 2e-3
    time, motion = solution.time[later], solution.sensors["top"].displacement[later, 0]
    motion = motion - motion.mean()
    before = np.flatnonzero((motion[:-1] < 0.0) & (motion[1:] >= 0.0))
    passes: Array = time[before] + motion[before] / (motion[before] - motion[before + 1]) * np.diff(time)[before]
    return float((len(passes) - 1) / (passes[-1] - passes[0]))


def column(share: float) -> float:
    """Lowest frequency of a column, fixed below and free above, under a share of its buckling load, over that without:
    w'''' + p w'' = q^4 w on a length of 1."""

    def lowest(load: float) -> float:
        def determinant(fourth: float) -> float:
            root = np.sqrt(load**2 / 4.0 + fourth)
            a, b = np.sqrt(root - load / 2.0), np.sqrt(root + load / 2.0)
            # w = A (cosh a x - cos b x) + B (sinh a x / a - sin b x / b): fixed at x = 0, no moment and shear at x = 1
            bent = a**2 * np.cosh(a) + b**2 * np.cos(b), a * np.sinh(a) + b * np.sin(b)
            cut = (
                a * (a**2 + load) * np.sinh(a) - b * (b**2 - load) * np.sin(b),
                (a**2 + load) * np.cosh(a) + (b**2 - load) * np.cos(b),
            )
            return float(bent[0] * cut[1] - bent[1] * cut[0])

        return float(scipy.optimize.brentq(determinant, 1e-9, 20.0))

    return float(np.sqrt(lowest(share * np.pi**2 / 4.0) / lowest(0.0)))


if __name__ == "__main__":
    main()
