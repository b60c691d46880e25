"""Machine and software of a run: memory, cores, one thread for the dense linear algebra of the solver, versions.

Threads on small dense products cost more than they give, and the sums would depend on their number.
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext, suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def peak_memory() -> int:
    """Largest resident size so far, bytes; 0 where the system does not give it (Windows).

    On Linux ``getrusage`` includes the process that started this one; the process status does not.
    """
    peak = _peak_by_getrusage()
    if peak == 0 or sys.platform == "darwin":
        return peak
    return peak if peak > _inherited() else _own_peak(peak)


@cache
def _inherited() -> int:
    """Peak of the process that started this one as ``getrusage`` includes it, bytes; 0 where it does not."""
    peak = _peak_by_getrusage()
    return peak if peak > _own_peak(peak) else 0


def _peak_by_getrusage() -> int:
    try:
        import resource
    except ImportError:
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak  # bytes there, else kilobytes


def _own_peak(otherwise: int) -> int:
    """Peak by the process status, bytes; reading it takes a hundred times as long as ``getrusage``."""
    with suppress(OSError):
        status = Path("/proc/self/status").read_bytes()
        if (at := status.find(b"VmHWM:")) >= 0:
            return 1024 * int(status[at:].split(maxsplit=2)[1])
    return otherwise


def give_back_memory() -> None:
    """Return memory that was freed to the system where its allocator keeps it (glibc): between the parts of a run whose
    arrays differ in size, the next part would not fit into what the last one left."""
    if sys.platform == "linux":
        import ctypes

        with suppress(AttributeError, OSError):  # another C library
            ctypes.CDLL(None).malloc_trim(0)


def physical_memory() -> int:
    """Memory of the machine, bytes; 0 where the system does not give it (Windows)."""
    try:
        return int(os.sysconf("SC_PHYS_PAGES")) * int(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return 0


def usable_cores() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def free_memory(table: Path = Path("/proc/meminfo")) -> int:
    """Memory of the machine that new data can take, caches of files included, bytes; 0 where the system does not give
    it (``MemAvailable`` of Linux)."""
    with suppress(OSError, ValueError):
        for line in table.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return 0


def memory_room(now: bool = True) -> tuple[float, str]:
    """Bytes that this process may still take, and by which limit: the least of the memory of the machine, of the
    control groups (version 1 and 2) and of RLIMIT_AS; 0 and an empty text where none is known.

    now : without what other processes of the machine take at present, where the system gives that.
    """
    resident, mapped = _taken()
    rooms = [(float(limit - resident), text) for limit, text in group_limits() if limit > 0]
    if total := physical_memory():
        rooms.append((float(total - resident), "memory of the machine"))
        if now and (free := free_memory()):
            rooms.append((float(free), f"free now, of {total / 1e9:.3g} GB of this machine"))
    try:
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            rooms.append((float(limit - mapped), "RLIMIT_AS, ulimit -v"))
    except ImportError:
        pass
    return min(rooms, default=(0.0, ""))


def _taken() -> tuple[int, int]:
    """Resident and mapped memory of this process, bytes; 0 where the system does not give them."""
    try:
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()
        size = int(os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError, AttributeError):
        return 0, 0
    return int(pages[1]) * size, int(pages[0]) * size


def group_limits(
    groups: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")
) -> list[tuple[int, str]]:
    """Limits of the control groups of this process and of those above them, bytes; where their files are."""
    limits = []
    with suppress(OSError):
        for line in groups.read_text(encoding="utf-8").splitlines():
            number, controllers, path = line.split(":", 2)
            first = number == "0" and not controllers  # version 2
            if not first and "memory" not in controllers.split(","):
                continue
            folder, name = (root, "memory.max") if first else (root / "memory", "memory.limit_in_bytes")
            group = folder / path.strip("/")
            # the least of the groups above holds, too
            for place in (group, *group.parents):
                if place.is_relative_to(folder):
                    with suppress(OSError, ValueError):  # "max" is no number
                        limits.append((int((place / name).read_text(encoding="ascii")), "control group"))
    return [(limit, text) for limit, text in limits if limit < 1 << 60]  # version 1 writes a very large number for none


def in_threads(threads: int, function: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Results of a function of each item, in their order, by so many threads: of use where compiled code, which runs
    beside Python, does most of the work. The first error, in the order of the items, is raised."""
    items, settings = list(items), np.geterr()
    if threads == 1 or len(items) < 2:
        return [function(item) for item in items]

    def done(item: _Item) -> _Result:
        with np.errstate(**settings):  # a thread has its own
            return function(item)

    with ThreadPoolExecutor(min(threads, len(items)), thread_name_prefix="latin-fmu") as pool:
        return list(pool.map(done, items))


def one_thread() -> AbstractContextManager[object]:
    """Context in which BLAS uses one thread."""
    if all(library.get_num_threads() == 1 for library in _controller().lib_controllers):
        return nullcontext()  # ten times as quick
    limited: AbstractContextManager[object] = _controller().limit(limits=1)
    return limited


@cache
def _controller() -> ThreadpoolController:
    """The libraries of this process: looking for them takes longer than a small run, so it is done once."""
    import scipy.linalg.cython_blas  # noqa: F401, loads the library that the kernels call

    return ThreadpoolController()


def package_version() -> str:
    """Version of this package."""
    version: str = sys.modules[__name__.rpartition(".")[0]].__version__  # of the package, loaded before its modules
    return version


PAPER = (
    "P. Ladeveze, H. Lemoussu, P.A. Boucard, A modular approach to 3-D impact computation with frictional "
    "contact, Computers and Structures 78 (2000) 45-51"
)


def provenance() -> dict[str, str]:
    """Versions, source and time of creation, ready to be root attributes of a results file."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    version = package_version()
    return {
        "source": f"latin_fmu {version}: LATIN method",
        "history": f"{now} computed by latin_fmu {version}",
        "references": PAPER,
        "latin_fmu_version": version,
        "python_version": platform.python_version(),
        **_libraries(),
    }


@cache
def _libraries() -> dict[str, str]:
    """Versions of the libraries, read from their metadata once (a millisecond each: as much as a small run)."""
    from importlib import metadata

    return {f"{name}_version": metadata.version(name) for name in ("numpy", "scipy", "xarray")}
