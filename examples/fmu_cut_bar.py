"""A bar cut into two FMUs, coupled through velocity and force, against the same bar in one run.

The first bar of `models/beam_in_traction` is cut at its joint. Each half becomes an FMU with a load on the cut
(set from outside) and a sensor there. The master iterates every communication step with rollback until both sides
have the same velocity; its search direction is the impedance rho c of the bars.
"""

from __future__ import annotations

import tempfile
import tomllib
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import FmuPeer
from latin_fmu.cosim.waveform_relaxation import Coupling, Side, WaveformMaster

MODEL = Path(__file__).parents[1] / "models" / "beam_in_traction" / "scene.toml"
HALVES = {"front": ("bar1_a",), "back": ("bar1_b", "bar2")}
CUT = {"front": "bar1_a.zmax", "back": "bar1_b.zmin"}
UNIT = 100e6  # Pa, of the load on the cut: the size of what is expected, to which the tolerances are relative
N_STEP = 100  # of the 250: the wave is through the cut, and half of it through the contact


def half(whole: latin_fmu.Scene, name: str) -> latin_fmu.Scene:
    """One half of the scene, with a traction on the cut to be set from outside, and a sensor."""
    data = tomllib.loads(whole.text())
    bodies = HALVES[name]
    keep = {
        "substructure": {n: b for n, b in data["substructure"].items() if n in bodies},
        "interface": {
            n: i for n, i in data["interface"].items() if n != "joint" and i["sides"][0].split(".")[0] in bodies
        },
        "load": {n: v for n, v in data["load"].items() if v["face"].split(".")[0] in bodies},
    }
    keep["load"]["cut"] = {"face": CUT[name], "traction": [0.0, 0.0, UNIT], "law": {"type": "input"}}
    sensor = {"cut": {"substructure": CUT[name].split(".")[0], "point": [0.0, 0.0, 0.5]}}
    solver = {"tolerance": 1e-9, "force_tolerance": 1e-9}
    return latin_fmu.scene_from_dict({**data, **keep, "name": name, "sensor": sensor, "solver": solver, "output": {}})


def main() -> dict[str, float]:
    """Run both; numbers that tests look at."""
    # scene
    whole = latin_fmu.load_scene(MODEL, ["solver.window=1", "solver.tolerance=1e-9", "solver.force_tolerance=1e-9"])
    steel = whole.material["steel"]
    impedance = float(np.sqrt(steel.young_modulus * steel.density))
    dt = whole.time.time_step

    # solve
    one = latin_fmu.solve(whole)
    forces, iterations = [], []
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        peers = {
            name: stack.enter_context(closing(FmuPeer(build_fmu(half(whole, name), folder / f"{name}.fmu"))))
            for name in HALVES
        }
        sides = [Side(name, "cut", "sensor.cut.velocity[3]", impedance / UNIT) for name in HALVES]
        master = WaveformMaster(peers, [Coupling(*sides)])
        for i in range(N_STEP):
            report = master.step(i * dt, dt)
            forces.append(UNIT * report.force[0])
            iterations.append(report.iterations)

    # check
    joint = one.interfaces["joint"]
    expected = joint.force()[1 : N_STEP + 1, 2] / joint.areas.sum()
    error = float(np.abs(np.array(forces) - expected).max() / np.abs(expected).max())
    print(f"stress at the cut: peak {np.abs(expected).max() / 1e6:.1f} MPa, two FMUs against one run: {error:.1e}")
    print(f"iterations of the master: {np.mean(iterations):.1f} a step on average, {max(iterations)} at most")
    return {"error": error, "iterations": float(np.mean(iterations))}


if __name__ == "__main__":
    main()
