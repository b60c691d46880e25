"""A piston drives a rod against an anvil: the piston is an FMU of another tool, rod and anvil are one with a port.

The piston, written below for the exporter of pythonfmu, is a mass under a pulse of gas pressure; a stiff spring, its
crown, pushes the rod. It takes displacement and velocity of the port and gives the force, in N; a stock master has the
two make their steps in turn. The same in one run, the piston a rigid body: the error of the force falls with the
communication step, once as a force that is held, and twice as fast with its rate. Writes piston.png.
"""

from __future__ import annotations

import tempfile
import textwrap
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from example_tools import BLUE, EXACT, GREEN, VERMILION, Array, options, save, table, tidy
from matplotlib.figure import Figure
from pythonfmu import FmuBuilder

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import FmuPeer

MASS, CROWN, GAS, PULSE = 0.06, 2e8, 30e3, 60e-6  # kg, N/m, N, s
SIDE, LENGTH, GAP = 0.01, 0.1, 10e-6  # m, of the rod; its distance from the anvil
STEP, END = 0.5e-6, 112e-6  # s; the piston then leaves the rod
PISTON = f'''
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Piston(Fmi2Slave):
    """A mass under gas pressure on a spring that only pushes; symplectic Euler in small steps."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.displacement, self.velocity = 0.0, 0.0
        self.travel, self.speed, self.force, self.meanForce = 0.0, 0.0, 0.0, 0.0
        for name in ("displacement", "velocity"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("travel", "speed", "force", "meanForce"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        h, impulse = step_size / 200, 0.0
        for i in range(200):
            t = current_time + (i + 0.5) * h
            gas = {GAS} * math.sin(math.pi * t / {PULSE}) if t < {PULSE} else 0.0
            self.travel += 0.5 * h * self.speed
            squeeze = self.travel - self.displacement - self.velocity * (i + 0.5) * h
            self.force = max(0.0, {CROWN} * squeeze)
            self.speed += h * (gas - self.force) / {MASS}
            self.travel += 0.5 * h * self.speed
            impulse += h * self.force
        self.meanForce = impulse / step_size
        self.force = max(0.0, {CROWN} * (self.travel - self.displacement - self.velocity * step_size))
        return True
'''


def scene(**tables: Any) -> latin_fmu.Scene:
    """Rod above an anvil, z upwards; the piston pushes down."""
    rod = {"origin": [0.0, 0.0, GAP], "size": [SIDE, SIDE, LENGTH], "elements": [1, 1, 20]}
    anvil = {"origin": [-SIDE, -SIDE, -2 * SIDE], "size": [3 * SIDE, 3 * SIDE, 2 * SIDE], "elements": [3, 3, 3]}
    steel = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    data = {
        "name": "rod_and_anvil",
        "material": {"steel": steel},
        "substructure": {
            "rod": {"material": "steel", "box": rod, "bending_modes": True},
            "anvil": {"material": "steel", "box": anvil, "bending_modes": True},
        },
        "interface": {
            "blow": {"sides": ["anvil.zmax", "rod.zmin"], "behaviour": "contact", "friction_coefficient": 0.2}
        },
        "boundary": {"ground": {"type": "fixed", "face": "anvil.zmin"}},
        "time": {"end": END, "step": STEP, "scheme": {"type": "generalized_alpha"}},
        "solver": {"tolerance": 1e-6, "window": 1},
    }
    for key, table_ in tables.items():
        data[key] = {**data.get(key, {}), **table_}
    return latin_fmu.scene_from_dict(data)


def one_run() -> tuple[Array, Array, Array]:
    """Times, force of the crown on the rod and contact force, N, with the piston as a rigid body of the scene."""
    size, top = [SIDE, SIDE, MASS / (7800.0 * SIDE**2)], GAP + LENGTH + 1e-3
    box = {"origin": [0.0, 0.0, top], "size": size, "elements": [1, 1, 1]}
    gas = {"face": "piston.zmax", "force": [0.0, 0.0, -GAS], "law": {"type": "half_sine", "duration": PULSE}}
    whole = scene(
        substructure={"piston": {"material": "steel", "rigid": True, "box": box}},
        spring={"crown": {"ends": ["piston.zmin", "rod.zmax"], "direction": [0, 0, -1], "stiffness": CROWN}},
        boundary={"guide": {"type": "fixed", "face": "piston.zmax", "components": ["x", "y"]}},
        load={"gas": gas},
        sensor={"piston": {"face": "piston.zmin"}, "rod": {"face": "rod.zmax"}},
    )
    solved = latin_fmu.solve(whole)
    piston, rod = (solved.sensors[name].displacement[:, 2] for name in ("piston", "rod"))
    return solved.time, CROWN * (rod - piston), -solved.interfaces["blow"].force()[:, 2]


def coupled(piston_fmu: Path, rod_fmu: Path, parts: int, rates: bool) -> tuple[Array, Array, Array]:
    """Times, force at the port and contact force, exchanged every ``parts`` time steps."""
    h, n = parts * STEP, round(END / STEP / parts)
    rows, before = [(0.0, 0.0)], 0.0
    with closing(FmuPeer(piston_fmu)) as piston, closing(FmuPeer(rod_fmu, {"inputInterpolation": 1})) as rod:
        for i in range(n):
            piston.set("displacement", -rod.value("port.head.displacement[3]"))
            piston.set("velocity", -rod.value("port.head.velocity[3]") if rates else 0.0)
            assert piston.step(i * h, h)
            force, mean = piston.value("force"), piston.value("meanForce")
            slope = (force - before) / h if rates else 0.0
            rod.set_load("port.head.force[3]", -(mean - 0.5 * slope * h), -slope)
            assert rod.step(i * h, h), rod.complaint
            rows.append((force, rod.value("interface.blow.normalForce")))
            before = force
    return h * np.arange(n + 1), *np.array(rows).T


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Run all, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)
    sizes = (4, 8) if arguments.quick else (1, 2, 4, 8)
    time, crown, blow = one_run()
    runs = {}
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "piston_of_another_tool.py"
        script.write_text(textwrap.dedent(PISTON))
        piston = Path(FmuBuilder.build_FMU(script, dest=Path(folder) / "Piston.fmu"))
        rod = build_fmu(scene(port={"head": {"face": "rod.zmax", "components": ["z"]}}), Path(folder) / "rod.fmu")
        for rates in (False, True):
            for parts in sizes:
                runs[rates, parts] = coupled(piston, rod, parts, rates)

    # check
    def error(rates: bool, parts: int) -> float:
        at, force, _ = runs[rates, parts]
        wanted = np.interp(at, time, crown)
        return float(np.linalg.norm(force - wanted) / np.linalg.norm(wanted))

    numbers = {
        f"error of the force, {'rates' if rates else 'held'}, step {parts * STEP * 1e6:g} us": error(rates, parts)
        for rates, parts in runs
    }
    numbers["peak contact force, one run, N"] = float(blow.max())
    numbers["peak contact force, coupled, N"] = float(runs[True, sizes[0]][2].max())

    # save
    figure = Figure(figsize=(11.0, 3.9), layout="constrained")
    forces, errors = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    for values, colour, label in ((1, BLUE, "port: piston on rod"), (2, VERMILION, "contact: rod on anvil")):
        at = runs[True, sizes[0]]
        forces.plot(1e6 * at[0], 1e-3 * at[values], color=colour, linewidth=1.4, label=label)
    held = runs[False, 8]
    forces.plot(1e6 * held[0], 1e-3 * held[1], color=BLUE, linewidth=0.8, alpha=0.6, label="port, held for 4 us")
    for values in (crown, blow):
        forces.plot(1e6 * time, 1e-3 * values, **EXACT | {"label": "one run" if values is crown else None})
    forces.set(xlabel="time (us)", ylabel="force (kN)", title="Piston, rod and anvil: two FMUs against one run")
    forces.legend(frameon=False, fontsize="small")
    steps = np.array(sizes) * STEP * 1e6
    for rates, colour, label in ((False, VERMILION, "force held"), (True, GREEN, "force and rate")):
        errors.loglog(steps, [error(rates, parts) for parts in sizes], "o-", color=colour, label=label)
    for order in (1, 2):
        line = 0.6 * error(order == 2, sizes[-1]) * (steps / steps[-1]) ** order
        errors.loglog(steps, line, color="0.6", linewidth=0.8, linestyle=":")
        errors.annotate(f"order {order}", (steps[0], line[0]), color="0.4", fontsize="small", va="top")
    errors.set(xlabel="communication step (us)", ylabel="L2 error of the port force", title="Error of the exchange")
    errors.legend(frameon=False, fontsize="small")
    errors.minorticks_off()
    errors.set_xticks(steps, [f"{step:g}" for step in steps])
    for axis in (forces, errors):
        tidy(axis)
    print(f"figure: {save(figure, arguments.folder, 'piston')}")
    print(table(numbers))
    return numbers


if __name__ == "__main__":
    main()
