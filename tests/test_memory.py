"""Peak memory of the process against the process status."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latin_fmu.machine import peak_memory


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no process status here")
def test_peak_memory_is_that_of_this_process() -> None:
    """Also after it has grown by 100 MB; to the half megabyte by which the two accounts of the system may differ."""
    for size in (1, 100_000_000):
        block = np.ones(size, dtype=np.uint8)
        status = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
        assert peak_memory() == pytest.approx(1024 * int(status), abs=5e5)
        assert peak_memory() > block.nbytes
