"""A parameter sweep with one FMU instance: prescribed load histories of growing size, reset in between."""

from __future__ import annotations

import tempfile
from contextlib import closing
from pathlib import Path

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import FmuPeer

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"
SIZES = (0.25, 0.5, 1.0)


def main() -> dict[str, float]:
    """Sweep; impulse through the interface by size of the load."""
    # scene
    scene = latin_fmu.load_scene(MODEL, ["load.press.law=input", "time.end=12e-6"])
    impulse = {}
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, Path(folder) / "crushing.fmu")
        with closing(FmuPeer(fmu)) as peer:  # builds and factorises once
            start = peer.snapshot()
            for size in SIZES:
                # solve
                peer.restore(start)
                for i in range(8):
                    rise = 1.0 if i < 4 else -1.0  # a triangle
                    value = size * (i if i < 4 else 8 - i) / 4
                    peer.set_load("press", value, rise * size / 6e-6)
                    assert peer.step(i * 1.5e-6, 1.5e-6), peer.complaint
                impulse[size] = peer.value("interface.crush.impulse[3]")
                # check
                print(f"load x {size:4.2f}: impulse {1e3 * impulse[size]:8.3f} mN s")
    return {"ratio": impulse[1.0] / impulse[0.5]}


if __name__ == "__main__":
    main()
