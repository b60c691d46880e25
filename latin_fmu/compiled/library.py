"""The library of kernels that was compiled with the wheel: where it is, whether it fits.

It fits where its processor extensions are there and where the sources it was compiled from are those of this package
(a digest inside the library). It is looked for in the package, then in ``build/`` beside the package, where the build
of a wheel leaves it in a source tree.
"""

from __future__ import annotations

import ast
import ctypes
import hashlib
import os
import platform
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

PACKAGE: Final = Path(__file__).resolve().parents[1]
_MARKS: Final = (b"@kernel", b"@ordered_kernel", b"@entry", b"@lazy_intrinsic")  # sources that hold kernels
_MACHINES: Final = MappingProxyType({"amd64": "x86_64", "arm64": "aarch64"})
_SUFFIXES: Final = MappingProxyType({"linux": ".so", "windows": ".dll", "darwin": ".dylib"})


def target() -> str:
    """Operating system and processor of this process, ``linux-x86_64`` say."""
    machine = platform.machine().lower()
    return f"{'windows' if sys.platform == 'win32' else sys.platform}-{_MACHINES.get(machine, machine)}"


def suffix(target: str) -> str:
    """Suffix of the names of libraries on the operating system of a target; ``.so`` on others."""
    return _SUFFIXES.get(target.partition("-")[0], ".so")


def file_name(target: str) -> str:
    """Name of the library for an operating system and processor."""
    return f"_kernels-{target}{suffix(target)}"


def kernel_sources(package: Path) -> list[Path]:
    """Source files with kernels, relative to the package."""
    files = sorted(package.rglob("*.py"))
    return [path.relative_to(package) for path in files if any(mark in path.read_bytes() for mark in _MARKS)]


def sources_of(package: Path) -> list[Path]:
    """Source files with kernels and all of the package that they import when they are loaded: what they compute depends
    on these."""
    sources: set[Path] = set()
    todo = kernel_sources(package)
    while todo:
        source = todo.pop()
        if source not in sources:
            sources.add(source)
            todo += _imported(package, source)
    return sorted(sources)


def _imported(package: Path, source: Path) -> Iterable[Path]:
    """Modules of the package that a module imports from (under an ``if`` too), relative to it."""
    for node in ast.walk(ast.parse((package / source).read_bytes())):
        # modules of the package import each other relatively
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        base = source.parents[node.level - 1].joinpath(*(node.module or "").split("."))
        # what is imported may be a module itself
        for path in (base, *(base / alias.name for alias in node.names)):
            for file in (path.with_suffix(".py"), path / "__init__.py"):
                if (package / file).is_file():
                    yield file


def digest_of(package: Path, sources: Iterable[Path], more: str = "") -> str:
    """Digest of the contents of source files, and of more."""
    digest = hashlib.sha256(more.encode())
    for source in sources:
        content = (package / source).read_bytes().replace(b"\r\n", b"\n")  # as git writes them on Windows
        # name and length first: text that moves between two files changes the digest
        digest.update(f"{source.as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


@cache
def loaded() -> ctypes.CDLL | None:
    """The library, where there is one that fits."""
    result = _search()
    return None if isinstance(result, str) else result


@cache
def reason() -> str:
    """Why there is no library, for a log."""
    result = _search()
    return result if isinstance(result, str) else "a kernel outside the compiled library is called"


def switched_off() -> bool:
    """Whether the library is not to be used."""
    return os.environ.get("LATIN_FMU_LIBRARY", "1") == "0"


@cache
def _search() -> ctypes.CDLL | str:
    if switched_off():
        return "the compiled library is switched off (LATIN_FMU_LIBRARY=0)"
    name = file_name(target())
    message = f"this installation has no compiled library for {target()}"
    # an installed library first
    for folder in (PACKAGE, PACKAGE.parent / "build"):
        if (folder / name).is_file():
            result = opened(folder / name, PACKAGE)
            if not isinstance(result, str):
                return result
            message = result
    return message


def shipped() -> list[Path]:
    """Libraries of any platform that were made from these very sources: what a copy of the package takes along."""
    known = digest_of(PACKAGE, sources_of(PACKAGE)).encode()
    libraries = {
        path.name: path
        for folder in (PACKAGE.parent / "build", PACKAGE)
        for path in folder.glob("_kernels-*.*")
        # libraries of other platforms cannot be loaded: their text is searched
        if path.suffix in _SUFFIXES.values() and known in path.read_bytes()
    }
    return sorted(libraries.values())


def opened(path: Path, package: Path) -> ctypes.CDLL | str:
    """A library, or why it is not to be used."""
    try:
        shared = ctypes.CDLL(str(path))
        sources, known = manifest(shared)
        fits: Any = shared.latin_fmu_fits
    except (OSError, AttributeError, ValueError) as error:
        return f"the compiled library {path.name} cannot be loaded ({error})"
    if not fits():
        return "the compiled library needs a processor with AVX2 and FMA"
    try:
        same = digest_of(package, sources) == known
    except OSError:
        same = False
    return shared if same else f"the compiled library {path.name} was made from other sources"


def manifest(shared: ctypes.CDLL) -> tuple[list[Path], str]:
    """Source files that a library was compiled from, and their digest."""
    text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(shared, "latin_fmu_manifest"))).decode()
    *sources, digest = text.split("\n")
    return [Path(source) for source in sources], digest
