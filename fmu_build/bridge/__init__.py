"""Compile and find the library of an FMU: C functions of FMI 2.0 and 3.0 that call methods in the Python of the host.

``python.c`` finds the interpreter of the process or starts one; the functions themselves are those of the runtime
(``latin_fmu.cosim.runtime``).

The compiler of ``ziglang`` makes the libraries of all platforms when a wheel is built; in
a source tree the library of this machine is compiled when the first FMU is built (by ``cc`` where there is one, which
is quicker), and kept in ``build/``.

python -m fmu_build.bridge                    # the libraries of all platforms, into build/
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Final

from latin_fmu.compiled.library import suffix, target
from latin_fmu.cosim import runtime

HERE: Final = Path(__file__).parent
BUILD: Final = HERE.parents[1] / "build"

PLATFORMS: Final[Mapping[str, Mapping[str, str]]] = MappingProxyType(
    {
        "linux-x86_64": {"2": "linux64", "3": "x86_64-linux"},
        "windows-x86_64": {"2": "win64", "3": "x86_64-windows"},
        "darwin-aarch64": {"3": "aarch64-darwin"},  # darwin64 of FMI 2 is x86-64
        "linux-aarch64": {"3": "aarch64-linux"},
    }
)
"""Folders below ``binaries`` by target and version of the FMI."""

_WARNINGS: Final = ("-Wall", "-Wextra", "-Werror")


def sources() -> list[Path]:
    """The C sources, in the order of compilation."""
    return [HERE / "python.c", *(runtime.HERE / name for name in ("common.c", "calls.c", "fmi2.c", "fmi3.c"))]


def file_name(target: str) -> str:
    """Name of the library for an operating system and processor; it holds the digest of its sources."""
    digest = hashlib.sha256()
    for path in (runtime.HERE / "instance.h", *sources()):
        digest.update(path.read_bytes().replace(b"\r\n", b"\n"))  # as git writes them on Windows
    return f"_bridge-{target}-{digest.hexdigest()[:12]}{suffix(target)}"


def libraries() -> dict[str, Path]:
    """Libraries by target: those that are there; that of this machine is compiled where none is.

    Raises
    ------
    ModuleNotFoundError : there is neither a library nor a compiler; the message names a package with one.
    """
    there = {}
    for name in PLATFORMS:
        for folder in (HERE, BUILD):
            if (folder / file_name(name)).is_file():
                there[name] = folder / file_name(name)
                break
    own = target()
    if own in PLATFORMS and own not in there:
        there[own] = compiled(own, BUILD, ["cc"] if shutil.which("cc") else zig(own))
    return there


def compiled(target: str, folder: Path, compiler: Sequence[str]) -> Path:
    """Compile the library for a target into a folder.

    Raises
    ------
    RuntimeError : the compiler refuses; its message.
    """
    library = folder / file_name(target)
    folder.mkdir(parents=True, exist_ok=True)
    # beside its target: a file is replaced at once in one file system only
    with tempfile.TemporaryDirectory(dir=folder) as place:
        made = Path(place) / library.name
        # hidden: functions of FMUs in one process have the same names
        options = ["-std=c99", "-D_GNU_SOURCE", "-O2", *_WARNINGS, "-shared", "-fPIC", "-fvisibility=hidden", "-s"]
        options.append(f"-I{runtime.HERE}")
        libraries = [] if target.startswith("windows") else ["-ldl"]
        if target.startswith("darwin"):
            # the name by which others would link it, and not the path where it is made
            libraries.append(f"-Wl,-install_name,@rpath/{library.name}")
        command = [*compiler, *options, "-o", str(made), *map(str, sources()), *libraries]
        environment = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(folder / "zig"))
        done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
        if done.returncode:
            raise RuntimeError(f"the library of the FMU for {target} cannot be compiled: {done.stderr.strip()}")
        os.replace(made, library)  # whole or not at all
    return library


def zig(target: str) -> Sequence[str]:
    """Command of the compiler of ``ziglang`` for a target.

    Raises
    ------
    ModuleNotFoundError : it is not installed.
    """
    from latin_fmu.aot.linking import TARGETS

    if find_spec("ziglang") is None:
        raise ModuleNotFoundError(
            f"building an FMU needs its library for {target}, which this installation lacks, or a C compiler to make "
            "it: pip install ziglang",
            name="ziglang",
        )
    return (sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target].zig)
