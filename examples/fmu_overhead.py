"""What the session and the FMI layer cost on top of the solver, and what hosts pay for instances and reading.

Crushing of two specimens, communication steps of 50 instants: the time of `doStep` and of reading all outputs,
against the time the solver itself takes for the same segment.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.peer import FmuPeer
from latin_fmu.scene.segments import SegmentedRun

MODEL = Path(__file__).parents[1] / "models" / "two_specimen_crushing" / "scene.toml"
N_INSTANT, N_REPEAT = 50, 7


def seconds(action: Callable[[], object]) -> float:
    """CPU time of a call (other programs on the machine do not count)."""
    start = time.process_time()
    action()
    return time.process_time() - start


def main() -> dict[str, float]:
    """Measure; numbers that tests look at."""
    # scene
    scene = latin_fmu.load_scene(MODEL, ["load.press.law={type='input', start_value=0.8}"])
    h = N_INSTANT * scene.time.time_step

    # solve
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(scene, Path(folder) / "crushing.fmu")
        start = time.perf_counter()
        with closing(FmuPeer(fmu)) as peer:
            opened = time.perf_counter() - start
            run = SegmentedRun(scene)
            loads = {"press": np.full(N_INSTANT + 1, 0.8)}
            blob, state = run.snapshot(), peer.snapshot()
            run.advance(h, N_INSTANT, loads)  # the first call of each compiles
            peer.step(0.0, h)
            core, layered = [], []
            for _ in range(N_REPEAT):  # turn by turn: the machine is as busy for both
                run.restore(blob)
                core.append(seconds(lambda: run.advance(h, N_INSTANT, loads)))
                peer.restore(state)
                layered.append(
                    seconds(lambda: (peer.set_load("press", 0.8), peer.step(0.0, h), peer.read(peer.outputs)))
                )
            thousand = [peer.outputs[i % len(peer.outputs)] for i in range(1000)]
            references = [peer.reference(name) for name in thousand]
            reading = statistics.median(seconds(lambda: peer.read_references(references)) for _ in range(20))

    # check
    overhead = min(layered) / min(core) - 1.0
    print(f"solver, {N_INSTANT} instants      {1e3 * min(core):8.1f} ms")
    print(f"FMU, the same step      {1e3 * min(layered):8.1f} ms ({100 * overhead:+.1f} %)")
    print(f"open and initialize     {1e3 * opened:8.1f} ms")
    print(f"read 1000 outputs       {1e3 * reading:8.2f} ms")
    return {"overhead": overhead, "opened": opened, "reading": reading}


if __name__ == "__main__":
    main()
