"""A bar lands on a wall: contact force, its peak, its error and the energy kept against the Courant number.

Unit bar (E, rho, length 1, nu = 0) thrown at a rigid wall with velocity 1: exact force rho c A from the first contact
to 2 L / c, and no energy lost. Schemes: the default for landing bodies with its viscous contact layer, the same without
viscosity, HHT and massless contact nodes. The instant of contact falls on several places between two steps; the worst
of them is drawn. Right: share of the energy kept after one impact. At every Courant number from 0.05 to 4 the default
stays within 8 % of the exact plateau; HHT is at ten times the plateau at 0.05. Writes landing.png.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from example_tools import EXACT, Array, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.pictures.style import curve_styles

SIDE, END = 0.1, 2.6
SCHEMES: dict[str, dict[str, Any]] = {
    "generalized_alpha": {"type": "generalized_alpha"},
    "generalized_alpha, landing_damping 0": {"type": "generalized_alpha", "landing_damping": 0.0},
    "hht": {"type": "hht"},
    "massless_contact": {"type": "massless_contact"},
}
LOOKS = dict(zip(SCHEMES, curve_styles(len(SCHEMES), markers=True), strict=True))
COURANT, PHASES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0), (0.02, 0.2, 0.4, 0.6, 0.9)
QUICK_COURANT, QUICK_PHASES = (0.2, 1.0), (0.4,)


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Solve, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)
    courants, phases = (QUICK_COURANT, QUICK_PHASES) if arguments.quick else (COURANT, PHASES)
    elements = 20 if arguments.quick else 40

    # scene and solve
    measured = {
        name: np.array([np.max([measure(elements, c, p, scheme) for p in phases], axis=0) for c in courants])
        for name, scheme in SCHEMES.items()
    }
    shown = {
        name: landed(elements, courants[0] if arguments.quick else 0.1, 0.4, SCHEMES[name])[:2] for name in SCHEMES
    }

    # check
    numbers = {
        f"{name}, {what}, Courant {c:g}": float(rows[i, j])
        for name, rows in measured.items()
        for i, c in enumerate(courants)
        for j, what in enumerate(("peak", "L2", "energy lost"))
    }

    # save
    figure = Figure(figsize=(13.5, 3.9), layout="constrained")
    force, peak, error, energy = figure.subplots(1, 4)
    for name in reversed(SCHEMES):
        time, history = shown[name]
        force.plot(time, history, **LOOKS[name] | {"marker": ""}, linewidth=0.9, label=name)
    force.plot([0, 0, 2, 2, END], [0, 1, 1, 0, 0], **EXACT)
    force.set(title="Force at Courant number 0.1", xlabel="t c / L", ylabel="force / (rho c A v)", ylim=(-0.2, 3))
    for j, (axis, title) in enumerate(
        ((peak, "Largest force"), (error, "Error of the force (L2)"), (energy, "Energy kept"))
    ):
        for name, rows in measured.items():
            values = 1 - rows[:, j] if j == 2 else rows[:, j]
            axis.plot(courants, values, **LOOKS[name], markersize=4, linewidth=1.1, label=name)
        axis.set(title=title, xlabel="Courant number", xscale="log")
        axis.set_xticks(courants, [f"{c:g}" for c in courants])
        axis.minorticks_off()
    peak.set(yscale="log")
    peak.axhline(1.0, **{**EXACT, "label": None})
    peak.set_yticks([1, 1.5, 2, 3, 5, 10], ["1", "1.5", "2", "3", "5", "10"])
    peak.minorticks_off()
    error.set(ylim=(0, None))
    for axis in (force, peak, error, energy):
        tidy(axis)
    figure.legend(*peak.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    save(figure, arguments.folder, "landing")
    return numbers


def landed(elements: int, courant: float, phase: float, scheme: dict[str, Any]) -> tuple[Array, Array, Any]:
    """Time since the contact, force over the plateau, energies of a bar that touches ``phase`` steps after t = 0."""
    step = courant / elements
    gap = phase * step
    description = {
        "name": "landing",
        "material": {"unit": {"young_modulus": 1.0, "poisson_ratio": 0.0, "density": 1.0}},
        "substructure": {
            "bar": {
                "material": "unit",
                "box": {"origin": [0.0, 0.0, gap], "size": [SIDE, SIDE, 1.0], "elements": [1, 1, elements]},
                "initial_velocity": [0.0, 0.0, -1.0],
            }
        },
        "interface": {"wall": {"sides": ["bar.zmin", "ground"], "gap": gap}},
        "time": {"end": round(END / step) * step, "step": step, "scheme": scheme},
        "output": {"energy": True},
    }
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(description))
    force: Array = solution.interfaces["wall"].normal_resultant() / SIDE**2
    return solution.time - gap, force, solution.energy


def measure(elements: int, courant: float, phase: float, scheme: dict[str, Any]) -> tuple[float, float, float]:
    """Peak and L2 error of the force against the exact one, meant over each step; share of the energy lost."""
    time, force, energy = landed(elements, courant, phase, scheme)
    step = time[1] - time[0]
    exact = np.clip((np.minimum(time, 2.0) - np.maximum(time - step, 0.0)) / step, 0.0, 1.0)
    stored = energy["kinetic"] + energy["elastic"]
    lost = 1 - float(stored[-1] / stored[0])
    return float(force.max()), float(np.linalg.norm(force - exact) / np.linalg.norm(exact)), lost


if __name__ == "__main__":
    print(table(main()))
