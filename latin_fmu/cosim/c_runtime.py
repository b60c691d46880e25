"""The runtime of co-simulation in C: its sources, and the library of them for this process.

The library of the kernels has the functions of these files linked in (``latin_fmu.aot``). Where there is none that was
made from these very files, a C compiler makes a library of them alone, which takes the kernels as they are here.
"""

from __future__ import annotations

import atexit
import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from ..compiled import library
from ..errors import InputError, Problem

HERE: Final = Path(__file__).with_name("runtime")
"""Folder of the C files."""
_OPTIONS: Final = ("-std=gnu99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-DLATIN_FMU_WITHOUT_KERNELS")


def sources() -> list[Path]:
    """C files and headers."""
    return sorted([*HERE.glob("*.c"), *HERE.glob("*.h")])


@cache
def digest() -> str:
    """Digest of these files, which a library of them holds."""
    content = hashlib.sha256()
    for path in sources():
        content.update(path.read_bytes().replace(b"\r\n", b"\n"))  # as git writes them on Windows
    return content.hexdigest()


@cache
def loaded() -> ctypes.CDLL:
    """The library.

    Raises
    ------
    InputError : there is none, and no C compiler that makes it.
    """
    shared = library.loaded()
    if shared is not None and _digest_in(shared) == digest():
        return shared
    return ctypes.CDLL(str(_compiled()))


def _digest_in(shared: ctypes.CDLL) -> str:
    """Digest of the C files that a library of the kernels was linked with; empty where it has none."""
    try:
        return ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(shared, "latin_fmu_functions"))).decode()
    except ValueError:
        return ""


def _compiled() -> Path:
    """The library of these files alone, made where it is not there yet."""
    name = f"_runtime-{library.target()}-{digest()[:12]}{library.suffix(library.target())}"
    build = library.PACKAGE.parent / "build"
    if not (build.is_dir() and os.access(build, os.W_OK)):  # no source tree
        build = Path(tempfile.mkdtemp(prefix="latin_fmu_"))
        atexit.register(shutil.rmtree, build, True)
    if not (build / name).is_file():
        with tempfile.TemporaryDirectory(dir=build) as folder:
            output = Path(folder) / name
            files = [str(path) for path in sources() if path.suffix == ".c"]
            more = []
            if sys.platform != "win32":
                more = ["-lm"]
            cache = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(build / "zig"))
            command = [*_compiler(), *_OPTIONS, "-o", str(output), *files, *more]
            done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **cache})
            if done.returncode:
                raise _missing(f"cannot be compiled here: {done.stderr.strip()[-500:]}")
            os.replace(output, build / name)  # whole or not at all
    return build / name


def _compiler() -> list[str]:
    if shutil.which("cc"):
        return ["cc"]
    if find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise _missing("is missing, and there is no C compiler to build it")


def _missing(what: str) -> InputError:
    remedy = "install a wheel for this machine, or a C compiler (pip install ziglang)"
    return InputError([Problem("library of the co-simulation", what, None, None, remedy)], "no session can be opened")
