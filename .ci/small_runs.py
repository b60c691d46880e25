"""Three scenes, an FMU and a sweep: writes their numbers to a file, or compares them with those in it."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.checks import validate
from latin_fmu import cli

MODELS = Path(__file__).parents[1] / "models"
SCENES = {
    "two_specimen_crushing/scene.toml": ["output.energy=true"],  # boxes, friction
    "lap_joint/shock.toml": ["time.end=4e-6"],  # a mesh file, a bolt, a start from its equilibrium
    "gripped_bar/scene.toml": ["time.instants=10"],  # no inertia
}
SAME = 1e-6  # of the largest of a history, where the iteration ends at a tolerance of 1e-4 or less


def scenes() -> dict[str, list[float]]:
    """Resultants (n_time, 3) of every interface, flat, by scene and interface."""
    numbers = {}
    for name, overrides in SCENES.items():
        solution = latin_fmu.solve(latin_fmu.load_scene(MODELS / name, overrides))
        if not solution.converged:
            raise SystemExit(f"{name}: {solution.status}")
        numbers |= {f"{name} {i}": history.force().ravel().tolist() for i, history in solution.interfaces.items()}
    return numbers


def fmu(folder: Path) -> dict[str, list[float]]:
    """Force of a compiled FMU under a constant load, in fmpy."""
    from fmpy import simulate_fmu

    scene = latin_fmu.load_scene(MODELS / "two_specimen_crushing" / "scene.toml", ["load.press.law=input"])
    file = build_fmu(scene, folder / "crushing.fmu")
    if problems := validate(file):
        raise SystemExit("\n".join(problems))
    result = simulate_fmu(str(file), start_values={"load.press.value": 1.0}, stop_time=3e-6)
    return {"fmu": result["interface.crush.normalForce"].tolist()}


def sweep(folder: Path) -> dict[str, list[float]]:
    """Impulses of a sweep of three coefficients of friction."""
    study, scene = folder / "study.nc", str(MODELS / "two_specimen_crushing" / "scene.toml")
    arguments = ["sweep", scene, "--vary", "interface.crush.friction_coefficient=0:0.2:3", "-o", str(study), "--quiet"]
    if code := cli.main(arguments):
        raise SystemExit(f"the sweep ended with {code}")
    with latin_fmu.open_results(study) as tree:
        return {"sweep": tree["impulse"].values.ravel().tolist()}


def main(file: Path) -> None:
    """Write the numbers, or compare them where the file is there."""
    with tempfile.TemporaryDirectory() as folder:
        numbers = scenes() | fmu(Path(folder)) | sweep(Path(folder))
    if not file.exists():
        file.write_text(json.dumps(numbers))
        return
    expected = json.loads(file.read_text())
    if numbers.keys() != expected.keys():
        raise SystemExit(f"other results: {numbers.keys() ^ expected.keys()}")
    for name, values in numbers.items():
        off, size = np.abs(np.subtract(values, expected[name])).max(), np.abs(expected[name]).max()
        if not off <= SAME * size:
            raise SystemExit(f"{name}: {off:g} apart, of at most {size:g}")
    print(f"lowest versions: {len(numbers)} results as with the newest")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
