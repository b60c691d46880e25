"""Compile and find the libraries of FMUs with Python, in C: for co-simulation and for Model Exchange.

``interpreter.c`` finds the interpreter of the process or starts one. The functions of the FMI are those of the runtime
(``latin_fmu.cosim.runtime``): for co-simulation it makes the steps, and Python the image of the run (``make.c``); for
Model Exchange every call is one of a method in Python (``exchange.c``).

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
from typing import Final, Literal

from latin_fmu.compiled.library import suffix, target
from latin_fmu.cosim import c_runtime

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


Kind = Literal["maker", "exchange"]
"""Libraries: for co-simulation, whose image Python makes, and for Model Exchange, whose functions are Python's."""
KINDS: Final[tuple[Kind, ...]] = ("maker", "exchange")


def sources(kind: Kind) -> list[Path]:
    """The C sources of a library, in the order of compilation."""
    first = [HERE / "interpreter.c", HERE / ("make.c" if kind == "maker" else "exchange.c")]
    if kind == "maker":
        return [*first, *(path for path in c_runtime.sources() if path.suffix == ".c")]
    return [*first, *(c_runtime.HERE / name for name in ("common.c", "calls.c", "fmi2.c", "fmi3.c"))]


def options(kind: Kind) -> list[str]:
    """Options of the compiler for a library."""
    return [f"-I{c_runtime.HERE}", *(("-DLATIN_FMU_WITHOUT_KERNELS", "-DLATIN_FMU_MAKES") if kind == "maker" else ())]


def file_name(target: str, kind: Kind) -> str:
    """Name of a library for an operating system and processor; it holds the digest of its sources."""
    digest = hashlib.sha256()
    for path in (HERE / "interpreter.h", c_runtime.HERE / "instance.h", c_runtime.HERE / "runtime.h", *sources(kind)):
        digest.update(path.read_bytes().replace(b"\r\n", b"\n"))  # as git writes them on Windows
    return f"_{kind}-{target}-{digest.hexdigest()[:12]}{suffix(target)}"


def libraries(kind: Kind) -> dict[str, Path]:
    """Libraries of a kind by target: those that are there; that of this machine is compiled where none is.

    Raises
    ------
    ModuleNotFoundError : there is neither a library nor a compiler; the message names a package with one.
    """
    there = {}
    for name in PLATFORMS:
        for folder in (HERE, BUILD):
            if (folder / file_name(name, kind)).is_file():
                there[name] = folder / file_name(name, kind)
                break
    platform = target()
    if platform in PLATFORMS and platform not in there:
        there[platform] = compiled(platform, kind, BUILD, ["cc"] if shutil.which("cc") else zig(platform))
    return there


def compiled(target: str, kind: Kind, folder: Path, compiler: Sequence[str]) -> Path:
    """Compile a library for a target into a folder.

    Raises
    ------
    RuntimeError : the compiler refuses; its message.
    """
    library = folder / file_name(target, kind)
    folder.mkdir(parents=True, exist_ok=True)
    # beside its target: a file is replaced at once in one file system only
    with tempfile.TemporaryDirectory(dir=folder) as place:
        draft = Path(place) / library.name
        # hidden: functions of FMUs in one process have the same names
        shared = ["-std=gnu99", "-D_GNU_SOURCE", "-O2", *_WARNINGS, "-shared", "-fPIC", "-fvisibility=hidden", "-s"]
        libraries = [] if target.startswith("windows") else ["-ldl", "-lm"]
        if target.startswith("darwin"):
            # the name by which others would link it, and not the path where it is made
            libraries.append(f"-Wl,-install_name,@rpath/{library.name}")
        command = [*compiler, *shared, *options(kind), "-o", str(draft), *map(str, sources(kind)), *libraries]
        environment = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(folder / "zig"))
        done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **environment})
        if done.returncode:
            raise RuntimeError(f"the library of the FMU for {target} cannot be compiled: {done.stderr.strip()}")
        os.replace(draft, library)  # whole or not at all
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
