"""A system of two FMUs as one .ssp: the crushing twice, the second loaded as the first slips."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fmpy.ssp.ssd import read_ssd

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.ssp import write_ssp

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"


def main() -> dict[str, float]:
    """Pack and read back; numbers that tests look at."""
    scene = latin_fmu.load_scene(MODEL, ["load.press.law=input"])
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, Path(folder) / "crushing.fmu")
        line = ("first", "interface.crush.slipping", "second", "load.press.value")
        components, parameters = {"first": fmu, "second": fmu}, {"first": {"load.press.value": 1.0}}
        package = write_ssp(Path(folder) / "pair.ssp", "pair", components, [line], scene.time.end, parameters)
        described = read_ssd(str(package))
    system = described.system
    print(f"{system.name}: {[e.name for e in system.elements]}, {len(system.connections)} connection(s)")
    return {"components": len(system.elements), "connections": len(system.connections)}


if __name__ == "__main__":
    main()
