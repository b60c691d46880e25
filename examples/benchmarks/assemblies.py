"""Bolted assemblies marched in four ways, in turn: time, memory and differences; and one whose joints are all bonded.

    python examples/benchmarks/assemblies.py [--rounds N] [--share X] [--former PYTHON] [--sweep|--fmu|--derivatives]

``iterate`` marches each body for itself, with bonds among the interfaces that are iterated; ``direct`` marches bonded
bodies as one; ``modal`` the modes of the assembly; ``automatic`` is the choice of the program with the march for the
estimate of its error. For the electronics box and the bolted beam (5 ms of it): seconds of the processor for the set-up
with the static start, for the march and for the rest, by rounds in turn, medians; the peak memory of a process of its
own; and what the others differ from ``iterate`` by: tensions of the bolts, work of friction, the shock response
spectrum of each sensor up to 5 kHz.

The box with all its joints bonded, undamped, and hit by a pressure on its lid: the march beside a linear transient of
the merged mesh: HHT with one solution by the same Cholesky factor and one product with K and with M in a step, nothing
recorded but the motion of the sensor, by which both are compared. Bonds iterated have matrices of the bodies alone.

``--sweep`` prints instead what the points of a sweep of the friction of the box cost in one process: the first one,
which makes the set-up, and those that follow, over a run of the scene itself without fields. Shortened runs are not
marched by modes.

``--fmu`` prints instead what an FMU of each assembly costs by its modes: the export, its size, instantiation with
initialization in fmpy, and its steps of one instant over those of the march of a run by modes.

``--derivatives`` prints instead what the derivatives of a run of the box by friction, the torques of two screws, the
amplitude of the shock and a damping ratio cost, without checks by runs, over the run without them.

``--share`` shortens the runs, to see that it works. ``--former`` is the interpreter of an environment with a former
version of this package, which runs in turn with the others as it marches by default (one is made by ``git worktree add
FOLDER d672431a`` and the two commands of the README there).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

MODELS = Path(__file__).resolve().parents[2] / "models"
ENDS = {"electronics_box": 10e-3, "bolted_beam": 5e-3}  # s
KINDS = ("iterate", "direct", "modal", "automatic")
FRICTIONS = [round(0.1 + 0.03 * i, 2) for i in range(10)]
PARAMETERS = [
    "contact.joints.friction_coefficient",
    "bolt.screw1.torque",
    "bolt.screw2.torque",
    "boundary.base.value.2",
    "material.aluminium.damping_ratios.ratios.0",
]
BONDED = ("iterate", "with energies", "direct", "transient")
HIT = """
[boundary.base]
type = "fixed"
face = "tray.base"
components = ["x", "y", "z"]

[load.hit]
face = "component.top"
pressure = 1e6
law = {type = "half_sine", duration = 0.5e-3}

[sensor.component]
face = "component.top"

[time]
end = 10e-3
step = 10e-6
scheme = "hht"

[output]
reactions = false
"""
HIGHEST, QUALITY = 5000.0, 10.0  # Hz and Q of the spectra that are compared


def one(model: str, kind: str, share: float) -> dict[str, Any]:
    """Times and results of a run."""
    import latin_fmu

    scene = latin_fmu.load_scene(MODELS / model / "scene.toml")
    scene = scene.replace("time.end", share * ENDS[model])
    scene = scene.replace("solver.propagator", kind if kind in ("modal", "automatic") else "direct")
    scene = scene.replace("solver.bonds", "iterate") if kind == "iterate" else scene
    solution = latin_fmu.solve(scene)
    outcome, timings = solution.outcome, solution.outcome.timings
    dt = float(solution.time[1] - solution.time[0])
    accelerations = {
        name: sensor.acceleration.tolist()
        for name, sensor in outcome.sensors.items()
        if sensor.acceleration is not None
    }
    friction = sum(float(h.friction_power.sum()) * dt for h in outcome.interfaces.values() if h.has_friction)
    return {
        "converged": outcome.converged,
        "setup": timings.setup,
        "march": timings.march,
        "rest": timings.other,
        "memory": timings.peak_memory,
        "iterations": float(np.mean([w.iterations for w in outcome.windows])),
        "bolts": {name: bolt.force.tolist() for name, bolt in outcome.bolts.items()},
        "friction": friction,
        "dt": dt,
        "accelerations": accelerations,
    }


def spectra(run: dict[str, Any]) -> dict[str, Any]:
    """Largest shock response (40,) over the directions of each sensor of a run, m s-2."""
    import latin_fmu

    frequencies = np.geomspace(200.0, HIGHEST, 40)
    return {
        name: latin_fmu.shock_response_spectrum(
            np.array(acceleration), run["dt"], frequencies, QUALITY, interpolation="lines"
        )
        .acceleration[0]
        .max(axis=-1)
        for name, acceleration in run["accelerations"].items()
    }


def bonded_scene(share: float) -> Any:
    """The box with all its joints bonded, without damping, bolts and start, hit by a pressure."""
    import latin_fmu

    model = MODELS / "electronics_box" / "scene.toml"
    text = model.read_text().split("[bolt.screw1]")[0].replace("friction_coefficient = 0.2", 'behaviour = "perfect"')
    lines = [line for line in text.splitlines() if not line.startswith("damping_ratios")]
    with tempfile.NamedTemporaryFile("w", suffix=".toml", dir=model.parent) as file:  # beside the mesh
        file.write("\n".join(lines) + HIT)
        file.flush()
        scene = latin_fmu.load_scene(file.name)
    return scene.replace("time.end", share * 10e-3).replace("solver.propagator", "direct")


def bonded(kind: str, share: float) -> dict[str, Any]:
    """Time of the march of the bonded box, s, and velocity of its sensor."""
    import latin_fmu

    scene = bonded_scene(share)
    if kind == "transient":
        return transient(scene)
    scene = scene.replace("solver.bonds", "iterate") if kind == "iterate" else scene
    solution = latin_fmu.solve(scene.replace("output.energy", kind == "with energies"))
    velocity = solution.sensors["component"].velocity[:, 2]
    return {"march": solution.outcome.timings.march, "velocity": velocity.tolist()}


def transient(scene: Any) -> dict[str, Any]:
    """HHT on the merged mesh, as ``bonded``."""
    from latin_fmu.building import discretise
    from latin_fmu.cholesky.factor import CholeskyFactor
    from latin_fmu.joined.bonded_run import grouped_assembly

    discretised = discretise(scene)
    grouped, _ = grouped_assembly(discretised, False)
    (merged,) = grouped.groups
    (mass, _, stiffness), rank = merged.model.reduced, merged.model.at_interface[2]
    sensor = discretised.sensors["component"]
    rows = np.zeros((3, merged.model.n_full))
    rows[:, merged.where[sensor.substructure]] = sensor.rows.toarray()
    rows = rows @ merged.model.expansion
    (load,) = [term for term in merged.model.loads if term.name == "hit"]
    pattern = merged.model.expansion.T @ load.pattern
    time, dt, alpha = discretised.time, discretised.dt, -0.1
    gamma, beta = 0.5 - alpha, (1.0 - alpha) ** 2 / 4
    factor = CholeskyFactor(mass + (1 + alpha) * beta * dt**2 * stiffness, np.zeros(0, dtype=np.int64), rank)
    amplitude = np.where(time < 0.5e-3, np.sin(np.pi * time / 0.5e-3), 0.0)
    u, v, a, velocity = np.zeros_like(pattern), np.zeros_like(pattern), np.zeros_like(pattern), [0.0]
    residual, begin = np.zeros_like(pattern), process_time()
    for t in range(1, len(time)):
        u, v = u + dt * v + dt**2 * (0.5 - beta) * a, v + dt * (1 - gamma) * a
        forces = (1 + alpha) * (amplitude[t] * pattern - stiffness @ u) - alpha * residual
        a = factor.solve(forces[:, None])[:, 0]
        u, v = u + dt**2 * beta * a, v + dt * gamma * a
        residual = (mass @ a + alpha * residual) / (1 + alpha)
        velocity.append(float(rows[2] @ v))
    return {"march": process_time() - begin, "velocity": velocity}


def apart(share: float, *given: str, python: str = sys.executable) -> dict[str, Any]:
    """A run in a process of its own, on one thread; ``given`` : model and kind, or kind of the bonded box."""
    command = [python, __file__, "--one", *given, "--share", f"{share:g}"]
    made = subprocess.run(
        command, capture_output=True, text=True, check=True, env=os.environ | {"OMP_NUM_THREADS": "1"}
    )
    found: dict[str, Any] = json.loads(made.stdout.splitlines()[-1])
    return found


def compare(model: str, share: float, rounds: int, former: str | None) -> None:
    """Print the table of a model; ``former`` : interpreter with a former version."""
    kinds = KINDS if former is None else ("former", *KINDS)
    runs: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
    for _ in range(rounds):
        for kind in kinds:
            python = former if kind == "former" and former is not None else sys.executable
            runs[kind].append(apart(share, model, kind, python=python))
    print(f"\n{model}: {1e3 * share * ENDS[model]:g} ms, medians of {rounds}")
    for part in ("setup", "march", "rest", "whole"):
        named = ("setup", "march", "rest") if part == "whole" else (part,)
        times = {kind: median(sum(run[name] for name in named) for run in runs[kind]) for kind in kinds}
        print(f"  {part:6} " + "  ".join(f"{kind} {t:8.2f} s" for kind, t in times.items()))
        for base in ("former", "iterate"):
            if base in times:
                ratios = (f"{kind} {times[base] / times[kind]:.2f}" for kind in kinds if kind != base)
                print(f"         {base} over " + ", ".join(ratios))
    first = runs["iterate"][-1]
    for kind in kinds:
        last = runs[kind][-1]
        print(
            f"  {kind:9} {last['iterations']:.1f} iterations an instant, peak memory {last['memory'] / 1e9:.2f} GB"
            + ("" if last["converged"] else ", NOT CONVERGED")
        )
        if kind == "iterate":
            continue
        off = max(np.abs(np.subtract(f, last["bolts"][name])).max() for name, f in first["bolts"].items())
        friction = last["friction"] / first["friction"] - 1
        print(f"          bolts differ from iterate by {off:.3g} N, work of friction {friction:+.2%}")
        wanted, found = spectra(first), spectra(last)
        for name, spectrum in wanted.items():
            change = np.abs(found[name] / spectrum - 1.0)
            sizes = f"up to {change.max():.1%}, median {np.median(change):.1%}"
            print(f"          spectrum of {name} up to {HIGHEST:g} Hz differs by {sizes}")


def compare_bonded(share: float, rounds: int) -> None:
    """Print the march of the bonded box beside the transient."""
    runs: dict[str, list[dict[str, Any]]] = {kind: [] for kind in BONDED}
    for _ in range(rounds):
        for kind in BONDED:
            runs[kind].append(apart(share, kind))
    print(f"\nelectronics_box with all joints bonded: {10 * share:g} ms, medians of {rounds}")
    times = {kind: median(run["march"] for run in runs[kind]) for kind in BONDED}
    wanted = np.array(runs["transient"][-1]["velocity"])
    for kind, t in times.items():
        off = np.abs(np.array(runs[kind][-1]["velocity"]) - wanted).max() / np.abs(wanted).max()
        print(f"  {kind:14} {t:8.2f} s, {t / times['transient']:.2f} of the transient, velocity differs by {off:.1e}")


def sweep_apart(share: float) -> dict[str, Any]:
    """Seconds of the processor of a run of the box, and of the points of a sweep of its friction."""
    import latin_fmu

    scene = latin_fmu.load_scene(MODELS / "electronics_box" / "scene.toml")
    scene = scene.replace("time.end", share * ENDS["electronics_box"]).replace("output.fields", False)
    begin = process_time()
    latin_fmu.solve(scene)
    alone = process_time() - begin
    begin = process_time()
    study = latin_fmu.sweep(scene, {"contact.joints.friction_coefficient": FRICTIONS})
    whole = process_time() - begin
    return {"alone": alone, "whole": whole, "points": study.cpu.values.tolist(), "states": study.state.values.tolist()}


def derivatives_apart(share: float) -> dict[str, Any]:
    """Seconds of the processor of a run of the box by its modes, and of one with derivatives."""
    import latin_fmu

    scene = latin_fmu.load_scene(MODELS / "electronics_box" / "scene.toml")
    scene = scene.replace("time.end", share * ENDS["electronics_box"])
    if share < 1.0:
        scene = scene.replace("solver.propagator", "modal")
    seconds = {}
    differentiated = scene.replace("output.sensitivities", PARAMETERS).replace("output.check_sensitivities", "none")
    for name, case in (("alone", scene), ("with", differentiated)):
        begin = process_time()
        solution = latin_fmu.solve(case)
        seconds[name] = process_time() - begin
    found = solution.sensitivities
    return seconds | {"quantities": 0 if found is None else len(found.quantities)}


def compare_derivatives(share: float, rounds: int) -> None:
    """Print the price of derivatives."""
    runs = [apart(share, "price", "derivatives") for _ in range(rounds)]
    alone, whole = (median(run[key] for run in runs) for key in ("alone", "with"))
    print(f"electronics_box, derivatives by {len(PARAMETERS)} parameters: {10 * share:g} ms, medians of {rounds}")
    print(f"  a run {alone:.1f} s, with derivatives of {runs[-1]['quantities']} quantities {whole:.1f} s")
    print(f"  the derivatives over a run {(whole - alone) / alone:.2f}")


def compare_sweep(share: float, rounds: int) -> None:
    """Print the points of a sweep beside a run."""
    runs = [apart(share, "sweep", "points") for _ in range(rounds)]
    alone, whole = (median(run[key] for run in runs) for key in ("alone", "whole"))
    first = median(run["points"][0] for run in runs)
    later = median(t for run in runs for t in run["points"][1:])
    print(f"electronics_box, {len(FRICTIONS)} frictions in one process: {10 * share:g} ms, medians of {rounds}")
    print(f"  a run {alone:.1f} s, the first point {first:.1f} s, each of the others {later:.1f} s")
    print(f"  a later point over a run {later / alone:.2f}, the sweep over a run {whole / alone:.2f}")


def fmu_apart(model: str, share: float) -> dict[str, Any]:
    """What an FMU of an assembly by its modes costs, and the march of the run."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    import latin_fmu
    from fmu_build.build import build_fmu

    changes = ["solver.propagator=modal", "output.energy=false", "output.fields=false"]
    scene = latin_fmu.load_scene(MODELS / model / "scene.toml", changes).replace("time.end", share * ENDS[model])
    with tempfile.TemporaryDirectory() as folder:
        begin = process_time()
        file = build_fmu(scene, Path(folder) / "assembly.fmu", extra={})
        export = process_time() - begin
        about, unpacked = read_model_description(str(file)), extract(str(file), folder)
        options = {"guid": about.guid, "modelIdentifier": about.coSimulation.modelIdentifier, "instanceName": "one"}
        begin = perf_counter()
        fmu = FMU2Slave(unzipDirectory=unpacked, **options)
        fmu.instantiate()
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        start = perf_counter() - begin
        begin, dt = process_time(), scene.time.time_step
        for i in range(scene.time.n_step):
            fmu.doStep(i * dt, dt)
        steps = process_time() - begin
        fmu.terminate()
        size = file.stat().st_size / 1e6
    solution = latin_fmu.solve(scene)
    outputs = sum(variable.causality == "output" for variable in about.modelVariables)
    numbers = {"export": export, "size": size, "start": start, "outputs": outputs}
    return numbers | {"steps": steps, "march": solution.timings.march}


def compare_fmus(share: float, rounds: int) -> None:
    """Print what FMUs of the assemblies cost by modes; steps over the march are medians of the rounds."""
    for model in ENDS:
        found = [apart(share, "fmu", model) for _ in range(rounds)]
        export, size, start = (median(run[key] for run in found) for key in ("export", "size", "start"))
        over = median(run["steps"] / run["march"] for run in found)
        print(
            f"{model}: export {export:.0f} s, {size:.1f} MB, {found[0]['outputs']} outputs, start {start:.3f} s, steps "
            f"{over:.2f} of the march"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--share", type=float, default=1.0, help="of the time of each run")
    parser.add_argument("--former", help="interpreter of an environment with a former version")
    parser.add_argument("--sweep", action="store_true", help="what the points of a sweep cost")
    parser.add_argument("--fmu", action="store_true", help="what an FMU costs")
    parser.add_argument("--derivatives", action="store_true", help="what derivatives by five parameters cost")
    parser.add_argument("--one", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one == ["sweep", "points"]:
        print(json.dumps(sweep_apart(given.share)))
        return
    if given.one and given.one[0] == "fmu":
        print(json.dumps(fmu_apart(given.one[1], given.share)))
        return
    if given.one == ["price", "derivatives"]:
        print(json.dumps(derivatives_apart(given.share)))
        return
    if given.one:
        print(json.dumps(bonded(*given.one, given.share) if len(given.one) == 1 else one(*given.one, given.share)))
        return
    if given.sweep:
        compare_sweep(given.share, given.rounds)
        return
    if given.fmu:
        compare_fmus(given.share, given.rounds)
        return
    if given.derivatives:
        compare_derivatives(given.share, given.rounds)
        return
    compare_bonded(given.share, given.rounds)
    for model in ENDS:
        compare(model, given.share, given.rounds, given.former)


if __name__ == "__main__":
    main()
