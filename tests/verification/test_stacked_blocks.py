"""Many contact surfaces: the work per instant does not grow with their number."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import numpy as np
import pytest

import latin_fmu
from tests.scenes import MODELS, solved


def test_passes_do_not_grow_with_the_number_of_interfaces():
    """Windows of one instant, Anderson: iterations at N = 16 at most 1.3 times those at N = 2, in the instants where
    anything touches (the others take one, and a tall stack has fewer of them); no fall-back anywhere."""
    few, many = (solved(f"stacked_blocks/{n}") for n in ("n02", "n16"))
    counts = [np.mean([w.iterations for w in run.windows if w.iterations > 1]) for run in (few, many)]
    assert counts[1] <= 1.3 * counts[0], counts
    assert all(not w.fallbacks for w in many.windows)


@pytest.mark.slow
def test_memory_of_sixteen_blocks(tmp_path):
    """Interior history is not kept unless requested: a run in a process of its own stays below 500 MB."""
    scene = str(MODELS / "stacked_blocks/n16.toml")
    command = [sys.executable, "-m", "latin_fmu", "run", scene, "--json", "-o", str(tmp_path / "out.nc")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=MODELS.parent)
    assert json.loads(done.stdout)["peak_memory_bytes"] < 500e6
    assert solved("stacked_blocks/n16", "output.energy=false").substructures == {}


@pytest.mark.slow
def test_cpu_time_is_linear_in_blocks_and_instants():
    """Slope of CPU time over N (2 ... 16) and over the number of instants, on a log scale: at most about 1."""

    def seconds(name, *overrides):
        scene = latin_fmu.load_scene(MODELS / f"stacked_blocks/{name}.toml", overrides)
        runs = []
        for _ in range(3):
            start = time.process_time()
            latin_fmu.solve(scene)
            runs.append(time.process_time() - start)
        return sorted(runs)[1]

    blocks = [seconds(n) for n in ("n02", "n04", "n08", "n16")]
    slope = np.polyfit(np.log([2, 4, 8, 16]), np.log(blocks), 1)[0]
    assert slope < 1.15, blocks
    instants = [seconds("n04", f"time.end={n * 0.2e-6}", f"time.step={0.2e-6}") for n in (100, 200, 400)]
    assert np.polyfit(np.log([1, 2, 4]), np.log(instants), 1)[0] < 1.15, instants
