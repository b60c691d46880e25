"""The netCDF file an FMU writes at its end, looked at with xarray: accepted steps only."""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import FmuPeer

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"


def main() -> dict[str, float]:
    """Run with a step taken back, read the file; numbers that tests look at."""
    scene = latin_fmu.load_scene(MODEL, ["output.fields=true", "output.every=5"])  # fields of the bodies too
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "crushing.nc"
        fmu = build_fmu(scene, Path(folder) / "crushing.fmu", "3")
        h = 1.5e-6
        with closing(FmuPeer(fmu, {"resultsFile": str(file)})) as peer:
            assert peer.step(0.0, h), peer.complaint
            state = peer.snapshot()
            assert peer.step(h, 5 * h)  # a trial, taken back
            peer.restore(state)
            for i in range(1, 8):
                assert peer.step(i * h, h)
            peer.terminate()
        with latin_fmu.open_results(file) as tree:
            exchange = tree["exchange"].to_dataset()
            velocity = tree["substructures/upper"]["velocity"]
            print(exchange["interface_crush_normalForce"].to_series().to_string())
            print(f"stored fields: {dict(velocity.sizes)}")
            return {"steps": exchange.sizes["time"], "fields": velocity.sizes["time"]}


if __name__ == "__main__":
    main()
