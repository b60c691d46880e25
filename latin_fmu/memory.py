"""Peak memory of the process, and the memory of the machine."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def peak_memory() -> int:
    """Largest resident size so far, bytes; 0 where the system does not tell (Windows).

    On Linux from the process status: what ``getrusage`` tells there includes the process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def physical_memory() -> int:
    """Memory of the machine, bytes; 0 where the system does not tell (Windows)."""
    try:
        return int(os.sysconf("SC_PHYS_PAGES")) * int(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return 0
