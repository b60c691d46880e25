"""Readers of other people's libraries in a process of their own, with limits of processor time and memory.

On a damaged file such a library may not return, take all memory or end its process. The limits: 10 s of processor time
and 2 s for each MB of the file; 3 GB of memory and 200 bytes for each byte of the file, at most what is free. The
option ``--no-limit`` of the command line, or ``LATIN_FMU_MESH_LIMIT=0``, reads in this process and without limits. So
does a program in which no Python can be started: another one that has Python inside, such as a host of FMUs.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import pickle
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from ..errors import MeshError, Problem
from ..machine import memory_room
from .content import MeshContent

_Argument = TypeVar("_Argument")
_Result = TypeVar("_Result")

NO_LIMIT: Final = "LATIN_FMU_MESH_LIMIT"
"""Variable of the environment; 0: libraries read in this process."""

_SECONDS, _SECONDS_OF_MB = 10.0, 2.0
_MEMORY, _MEMORY_OF_BYTE = 3 << 30, 200
_START: Final = 30.0  # seconds by the clock until a process reads, on a machine with much else to do
_WAITING: Final = 10.0  # seconds by the clock for one of processor time: a library may wait for ever, too
_NO_MEMORY: Final = "no memory"
_ROOT: Final = Path(__file__).parents[__name__.count(".")]  # the folder that the package is in
_REMEDY: Final = "export the mesh again, best as .msh, .inp or .bdf, or read it without limits: --no-limit"


@dataclass(frozen=True)
class Limits:
    """What reading one file may take: seconds of processor time, bytes of memory."""

    seconds: float
    memory: int

    @classmethod
    def of(cls, path: Path) -> Limits:
        """Those of a file, by its size."""
        size = path.stat().st_size
        memory = _MEMORY + _MEMORY_OF_BYTE * size
        free, _ = memory_room()
        return cls(_SECONDS + _SECONDS_OF_MB * size / 1e6, int(min(memory, free)) if free > 0 else memory)


def read_in_child(reader: Callable[[Path], MeshContent], path: Path, title: str) -> MeshContent:
    """What a reader of the package makes of a file, in a process of its own.

    Parameters
    ----------
    reader : function of a module. title : format and library, for messages.

    Raises
    ------
    MeshError : of the reader; past a limit, or where the process dies, with the format and the library.
    """
    if os.environ.get(NO_LIMIT) == "0" or not can_start():
        return reader(path)

    def refused(what: str) -> MeshError:
        return MeshError([Problem(path.name, f"the reader of {title} {what}", remedy=_REMEDY)], "unreadable mesh")

    try:
        return in_child(reader, path.absolute(), Limits.of(path), refused)
    except OSError:  # no second process can be started
        return reader(path)


def can_start() -> bool:
    """Whether a process can be started in which this package is imported by its name."""
    return _is_python(sys.executable) and _is_below(_ROOT)


def in_child(
    work: Callable[[_Argument], _Result], argument: _Argument, limits: Limits, refused: Callable[[str], MeshError]
) -> _Result:
    """What a function of the package makes of an argument, in a process of its own.

    Parameters
    ----------
    work : function of a module. refused : the error for a process that does not return, from what it does in words.

    Raises
    ------
    MeshError : of the function; past a limit, or where the process dies, the one that ``refused`` makes.
    OSError : no process can be started.
    """
    path = [str(Path(p).absolute()) for p in sys.path]
    job = (path, work.__module__, work.__qualname__, argument, limits.seconds, limits.memory)
    code = f"from {__name__} import serve; serve()"
    # the pools of threads of numerical libraries take memory, and nothing here is worth a second thread
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(_ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    ) as process:
        try:
            result, said = process.communicate(pickle.dumps(job), timeout=_START + _WAITING * limits.seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            raise refused(f"does not return within {_WAITING * limits.seconds:.0f} s") from None
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0:
        raise refused(_end(limits, process.returncode, said))
    value, problems, heading = pickle.loads(result)
    if problems == _NO_MEMORY:
        raise refused(_past_memory(limits))
    if problems is not None:
        raise MeshError(problems, heading)
    return value  # type: ignore[no-any-return]


def _past_memory(limits: Limits) -> str:
    return f"takes more than {limits.memory / 1e9:.2g} GB of memory"


def _end(limits: Limits, code: int, said: bytes) -> str:
    """What a process does that ends with a code other than 0."""
    if code == -getattr(signal, "SIGXCPU", 0) or code == -getattr(signal, "SIGKILL", 0):
        return f"takes more than {limits.seconds:.3g} s of processor time"
    if b"MemoryError" in said or b"bad_alloc" in said:
        return _past_memory(limits)
    if code < 0:
        name = signal.Signals(-code).name
    else:
        name = f"exit code {code}"
    last = said.decode("utf-8", "replace").strip().splitlines()[-1:]
    return ": ".join([f"dies ({name})", *last])[:300]


def _is_python(program: str | None) -> bool:
    """Whether a program is a Python that takes ``-c``."""
    return bool(program) and Path(str(program)).stem.lower().startswith(("python", "pypy"))


def _is_below(root: Path) -> bool:
    """Whether this module can be imported from there by its name: not so in an FMU, whose package is loaded anew."""
    return Path(__file__).with_suffix("") == root.joinpath(*__name__.split("."))


def serve() -> None:
    """Do a job from stdin; what comes out of it, or what is wrong, goes to stdout.

    What libraries print, in C too, goes to stderr.
    """
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    sys.path[:], module, name, argument, seconds, memory = pickle.load(sys.stdin.buffer)
    _limit(seconds, memory)
    reply: tuple[object, object, str]
    try:
        reply = (getattr(importlib.import_module(module), name)(argument), None, "")
    except MeshError as error:
        reply = (None, error.problems, error.heading)
    except MemoryError:
        reply = (None, _NO_MEMORY, "")
    except BaseException:
        traceback.print_exc()
        answer.close()
        os._exit(1)
    pickle.dump(reply, answer, pickle.HIGHEST_PROTOCOL)
    answer.close()
    os._exit(0)  # destructors of a library may crash, and nothing is left to do


def _limit(seconds: float, memory: int) -> None:
    """Limits of this process, where the system has any."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        whole = math.ceil(seconds)
        resource.setrlimit(resource.RLIMIT_CPU, (whole, whole + 5))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
