"""Compilation of the kernels ahead of time, when a wheel is built; a run needs neither numba nor LLVM.

numba lowers every entry once, LLVM optimises all of them together and emits an object file for each target
(``lowering``). Its undefined symbols are compared to a list, and the compiler of ``ziglang`` links it with the
functions of the FMI in C (``linking``). ``python -m latin_fmu.aot`` builds the library into ``build/`` of a source
tree, where the package finds it: of use after a change of a kernel.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path

from ..compiled import library
from ..compiled.declare import Entry, Kernel
from ..cosim import c_runtime

_LOG = logging.getLogger(__name__)


def build(folder: Path, targets: Sequence[str]) -> list[Path]:
    """Libraries for the targets in a folder; those that are there and of these very sources are kept. So are the object
    files of the kernels: a change of the C sources takes a link alone."""
    from . import linking

    package = library.PACKAGE
    sources = library.sources_of(package)
    manifest = "\n".join([*(source.as_posix() for source in sources), library.digest_of(package, sources)])
    key = _key(manifest, "*.py", "*.c", c_runtime.digest())
    wanted = {target: folder / library.file_name(target) for target in targets}
    missing = {t: path for t, path in wanted.items() if not _is_of(path, key)}
    if missing:
        for path in missing.values():
            # gone before the link: a build that is broken off leaves no library that seems to fit
            _note(path).unlink(missing_ok=True)
        for target, content in _objects(folder, list(missing), _key(manifest, "*.py")).items():
            linking.link(content, manifest, linking.TARGETS[target], wanted[target])
            _LOG.info("%s: %d bytes", wanted[target], wanted[target].stat().st_size)
        for path in missing.values():
            _note(path).write_text(key)
    return list(wanted.values())


def _is_of(path: Path, key: str) -> bool:
    """Whether a library is there and what it depends on has not changed."""
    return path.is_file() and _note(path).is_file() and _note(path).read_text() == key


def _note(path: Path) -> Path:
    return path.with_suffix(".key")


def _key(manifest: str, *parts: str) -> str:
    """What a library or an object file depends on: kernels, who compiles, files of this folder by their patterns, which
    are among ``parts``, and other parts as they are."""
    import llvmlite
    import numba

    here = Path(__file__).parent
    digest = hashlib.sha256(repr((manifest, parts, sys.version, numba.__version__, llvmlite.__version__)).encode())
    files = [path for part in parts if "*" in part for path in here.glob(part)]
    for path in sorted([*files, *Path(library.__file__).parent.glob("*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _objects(folder: Path, targets: Sequence[str], key: str) -> dict[str, bytes]:
    """Object files of the kernels; those of a key that are in the folder are read, others made and kept there."""
    paths = {target: folder / f"_kernels-{target}.o" for target in targets}
    contents = {target: path.read_bytes() for target, path in paths.items() if path.is_file()}
    # the key stands before the content: an object file of other sources is read as none
    there = {target: content[len(key) :] for target, content in contents.items() if content.startswith(key.encode())}
    objects = _make([target for target in targets if target not in there])
    folder.mkdir(parents=True, exist_ok=True)
    for target, content in objects.items():
        paths[target].write_bytes(key.encode() + content)
    return there | objects


def _make(targets: Sequence[str]) -> dict[str, bytes]:
    """Lower the kernels once, optimise once, then emit for each target."""
    if not targets:
        return {}
    import llvmlite.binding as llvm

    from . import linking, lowering

    modules, exported = lowering.lower(lowering.start(), declared())
    whole = lowering.joined(modules, exported, shared())
    plain = whole.as_bitcode()
    optimised: dict[str, bytes] = {}
    objects = {}
    for target in targets:
        kind = linking.TARGETS[target]
        if kind.cpu not in optimised:  # one processor: its code serves every operating system
            fresh = llvm.parse_bitcode(plain)
            lowering.optimise(fresh, kind)
            optimised[kind.cpu] = fresh.as_bitcode()
        content = lowering.emit(llvm.parse_bitcode(optimised[kind.cpu]), kind)
        if target.startswith("linux"):
            linking.check(content)
        objects[target] = content
    return objects


def _kernels() -> Iterator[Kernel]:
    """Kernels and entries of all modules that declare some."""
    root = library.__name__.removesuffix(".compiled.library")
    for source in library.kernel_sources(library.PACKAGE):
        if source.parts[0] == "compiled":
            continue
        module = import_module(".".join((root, *source.with_suffix("").parts)))
        for value in vars(module).values():
            if isinstance(value, Kernel) and value.py_func.__module__ == module.__name__:
                yield value


def declared() -> Iterator[Entry]:
    """Entries of all modules with kernels."""
    return (kernel for kernel in _kernels() if isinstance(kernel, Entry))


def shared() -> Iterator[str]:
    """Beginnings of the names that numba gives the kernels that keep one body of machine code."""
    for kernel in _kernels():
        if kernel.shared:
            path = (*kernel.py_func.__module__.split("."), kernel.py_func.__name__)
            yield "_ZN" + "".join(f"{len(part)}{part}" for part in path) + "B"


def host() -> str | None:
    """Target of this machine; None where there is none for it."""
    from .linking import TARGETS

    target = library.target()
    musl = target.startswith("linux") and not os.confstr("CS_GNU_LIBC_VERSION")  # linked to glibc
    return target if target in TARGETS and not musl else None
