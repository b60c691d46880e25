"""Peak memory of the process, and the memory of the machine."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path


def peak_memory() -> int:
    """Largest resident size so far, bytes; 0 where the system does not tell (Windows).

    On Linux what ``getrusage`` tells includes the process that started this one; the process status does not.
    """
    told = _told_by_getrusage()
    if told == 0 or sys.platform == "darwin":
        return told
    return told if told > _inherited() else _own_peak(told)


@cache
def _inherited() -> int:
    """What ``getrusage`` knows from the process that started this one, bytes; 0 where all it tells is of this one."""
    told = _told_by_getrusage()
    return told if told > _own_peak(told) else 0


def _told_by_getrusage() -> int:
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _own_peak(otherwise: int) -> int:
    """Peak by the process status, bytes; reading it takes a hundred times as long as ``getrusage``."""
    with suppress(OSError):
        told = Path("/proc/self/status").read_bytes()
        if (at := told.find(b"VmHWM:")) >= 0:
            return 1024 * int(told[at:].split(maxsplit=2)[1])
    return otherwise


def physical_memory() -> int:
    """Memory of the machine, bytes; 0 where the system does not tell (Windows)."""
    try:
        return int(os.sysconf("SC_PHYS_PAGES")) * int(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return 0
