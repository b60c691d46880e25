"""Ten lines of fmpy: an FMU of a scene, run with a load that ramps up."""

from __future__ import annotations

import tempfile
from pathlib import Path

import fmpy
import fmpy.validation
import numpy as np

import latin_fmu
from fmu_build.build import build_fmu

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"


def main() -> dict[str, float]:
    """Build, run, show; numbers that tests look at."""
    scene = latin_fmu.load_scene(MODEL, ["load.press.law=input"])  # the load becomes an input
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, Path(folder) / "crushing.fmu")
        assert fmpy.validation.validate_fmu(str(fmu)) == []
        h, n = 1.5e-6, 10  # communication step, s; number of steps
        names = ["time", "load.press.value", "load.press.rate"]
        ramp = np.array([(i * h, i / n, 1.0 / (n * h)) for i in range(n + 1)], dtype=[(name, float) for name in names])
        result = fmpy.simulate_fmu(str(fmu), stop_time=n * h, output_interval=h, input=ramp)
    force, slipping = result["interface.crush.normalForce"], result["interface.crush.slipping"]
    print(f"normal force at the end {force[-1] / 1e3:.2f} kN, {100 * slipping[-1]:.0f} % of the area slips")
    return {"force": float(force[-1]), "slipping": float(slipping[-1])}


if __name__ == "__main__":
    main()
