"""The library of kernels that was compiled with the wheel: where it is, whether it fits.

It fits where its processor extensions are there and where the sources it was compiled from are those of this package
(a digest inside the library): a changed kernel makes it stale, and a run an error that says how to make it anew. It is
looked for in the package, then in ``build/`` beside the package, where ``python -m latin_fmu.aot`` leaves it in a
source tree.
"""

from __future__ import annotations

import ast
import ctypes
import hashlib
import platform
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from ..errors import KernelsError, Problem

PACKAGE: Final = Path(__file__).resolve().parents[1]
_BUILD: Final = PACKAGE.parent / "build"
_MARKS: Final = (b"@kernel", b"@ordered_kernel", b"@entry")  # sources that hold kernels
_MACHINES: Final = MappingProxyType({"amd64": "x86_64", "arm64": "aarch64"})
PORTABLE: Final = "-portable"
"""End of the name of a target for x86-64 processors without AVX2."""
_PROCESSOR: Final = "needs a processor with AVX2 and FMA"
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
    """Source files with kernels and all of the package that they import when they are loaded, but for those of a
    docstring alone: what they compute depends on these."""
    sources: set[Path] = set()
    seen: set[Path] = set()
    todo = kernel_sources(package)
    while todo:
        source = todo.pop()
        if source in seen:
            continue
        seen.add(source)
        tree = ast.parse((package / source).read_bytes())
        if len(tree.body) == 1 and ast.get_docstring(tree) is not None:
            continue
        sources.add(source)
        todo += _imported(package, source, tree)
    return sorted(sources)


def _imported(package: Path, source: Path, tree: ast.Module) -> Iterable[Path]:
    """Modules of the package that the module ``source`` imports from (under an ``if`` too), relative to it."""
    for node in ast.walk(tree):
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
    return None if isinstance(result, list) else result


def needed() -> ctypes.CDLL:
    """The library.

    Raises
    ------
    KernelsError : there is none that fits: the files looked at, what is wrong with them, and how to make one.
    """
    result = _search()
    if isinstance(result, list):
        raise KernelsError(result, "no run is possible")
    return result


@cache
def _search() -> ctypes.CDLL | list[Problem]:
    """The library, or why there is none. An installed one first, and of a folder the one for newer processors."""
    problems = []
    for folder in (PACKAGE, _BUILD):
        for name in (target(), f"{target()}{PORTABLE}"):
            path = folder / file_name(name)
            if path.is_file():
                result = opened(path, PACKAGE)
                if not isinstance(result, str):
                    return result
                problems.append(Problem(str(path), result, remedy=_remedy(_PROCESSOR in result)))
    places = " nor in ".join(map(str, dict.fromkeys((PACKAGE, _BUILD)) if _in_source_tree() else (PACKAGE,)))
    nowhere = Problem(file_name(target()), f"the library of compiled kernels is not in {places}", remedy=_remedy())
    return problems or [nowhere]


def _in_source_tree() -> bool:
    return (PACKAGE.parent / "hatch_build.py").is_file()


def _remedy(portable: bool = False) -> str:
    """How to get a library; ``portable`` : for a processor without AVX2."""
    name = f"{target()}{PORTABLE}" if portable else ""
    command = f"python -m latin_fmu.aot {name}".rstrip()
    if _in_source_tree():
        return f"run {command} there (minutes; it needs the packages of pip install -e '.[kernels]')"
    if not __name__.startswith("latin_fmu."):  # the package inside an FMU has a name of its own
        return f"make the FMU where a library for {name or target()} is: in a source tree {command} makes it"
    if portable:
        return f"install from a source tree (pip install -e) and run {command} there"
    return f"install the wheel of this version for {target()}, or from the sources: pip install FOLDER"


def shipped() -> dict[str, Path]:
    """Libraries that were made from these very sources, by target: what a copy of the package takes along."""
    digest = digest_of(PACKAGE, sources_of(PACKAGE)).encode()
    libraries = {
        path.stem.removeprefix("_kernels-"): path
        for folder in (_BUILD, PACKAGE)
        for path in folder.glob("_kernels-*.*")
        # libraries of other platforms cannot be loaded: their text is searched
        if path.suffix in _SUFFIXES.values() and digest in path.read_bytes()
    }
    return dict(sorted(libraries.items()))


def opened(path: Path, package: Path) -> ctypes.CDLL | str:
    """A library, or why it is not to be used."""
    try:
        shared = ctypes.CDLL(str(path))
        sources, digest = manifest(shared)
        fits: Any = shared.latin_fmu_fits
    except (OSError, AttributeError, ValueError) as error:
        return f"the library of compiled kernels cannot be loaded ({error})"
    if not fits():
        return f"the library of compiled kernels {_PROCESSOR}"
    try:
        same = digest_of(package, sources) == digest
    except OSError:
        same = False
    return shared if same else f"the library of compiled kernels was made from other sources than those in {package}"


def manifest(shared: ctypes.CDLL) -> tuple[list[Path], str]:
    """Source files that a library was compiled from, and their digest."""
    text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(shared, "latin_fmu_manifest"))).decode()
    *sources, digest = text.split("\n")
    return [Path(source) for source in sources], digest
