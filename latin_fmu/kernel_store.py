"""Compiled kernels, kept in a folder of the user by the contents of their sources.

numba keeps compiled code by the path and the time of the one file that holds a function. A kernel whose callee in
another file has changed would go on with the old one; and an FMU is extracted to a new path every time, so that each
extraction would compile all kernels anew (half a minute). Here the folder is named by a digest of every source file
with kernels and of the versions of what compiles them. One file per compiled signature, written whole and checked
when it is read, so that processes may share the folder.

``LATIN_FMU_CACHE`` in the environment names another folder; 0 or nothing switches the store off, and the code is
kept beside the sources.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
import stat
import sys
import uuid
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

_MARKS = (b"@kernel", b"@compiled", b"@native", b"jitted(")  # sources that hold kernels
KEPT = 8  # folders; those not used for longest are removed


def keep(dispatcher: Any, folder: Path) -> bool:
    """Let a function of ``numba.njit`` or ``numba.cfunc`` keep its compiled code in a folder; False where this numba
    cannot do that."""
    try:
        function = dispatcher.py_func if hasattr(dispatcher, "py_func") else dispatcher._pyfunc
        kept = _cache_class(folder)(function)
        kept._cache_file = Files(folder, f"{function.__module__}.{kept._impl.filename_base}")
    except (ImportError, AttributeError, TypeError, RuntimeError):
        return False
    dispatcher._cache = kept
    return True


@cache
def _cache_class(folder: Path) -> Any:
    """numba's cache of functions, with everything in one folder, which is that of these very sources."""
    caching: Any = import_module("numba.core.caching")

    class Locator(caching._CacheLocator):  # type: ignore[misc]
        def __init__(self, function: Callable[..., Any], file: str) -> None:
            self._line, self._py_file = function.__code__.co_firstlineno, file

        def get_cache_path(self) -> str:
            return str(folder)

        def get_source_stamp(self) -> str:
            return folder.name

        def get_disambiguator(self) -> str:
            return str(self._line)

        @classmethod
        def from_function(cls, function: Callable[..., Any], file: str) -> Locator:
            return cls(function, file)

    class Impl(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator,)

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        _impl_class = Impl

    return Cache


class Files:
    """Compiled code of one function, a file per key (signature, processor, bytecode), without an index: two processes
    that save at once cannot mix up each other's entries."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def _path(self, key: Any) -> Path:
        digest = hashlib.sha256(f"{self._name} {key!r}".encode()).hexdigest()
        return self._folder / f"{digest[:40]}.kernel"

    def load(self, key: Any) -> Any:
        """What was saved under a key; None where there is nothing sound."""
        try:
            content = self._path(key).read_bytes()
            if hashlib.sha256(content[32:]).digest() != content[:32]:
                return None
            known, data = pickle.loads(content[32:])
        except (OSError, pickle.UnpicklingError, ImportError, AttributeError, ValueError, TypeError):
            return None
        return data if known == key else None

    def save(self, key: Any, data: Any) -> None:
        """Write whole or not at all; where that fails the code is compiled again next time."""
        dumps: Any = import_module("numba.core.serialize").dumps
        content: bytes = dumps((key, data))
        path = self._path(key)
        draft = path.with_suffix(f".{uuid.uuid4().hex[:12]}")
        try:
            draft.write_bytes(hashlib.sha256(content).digest() + content)
            os.replace(draft, path)
        except OSError:
            with suppress(OSError):
                draft.unlink()

    def flush(self) -> None:
        """numba asks for it before a function is compiled anew; every key has its own file, nothing is stale."""


@cache
def store_of(package: Path) -> Path | None:
    """The folder for the sources below ``package``, made where it is missing; None where there is no safe one."""
    base = _base()
    if base is None:
        return None
    folder = base / _digest(package)
    try:
        known = folder.is_dir()
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        if not _private(folder):
            return None
        os.utime(folder)
        probe = folder / f"probe.{uuid.uuid4().hex[:12]}"
        probe.touch()
        probe.unlink()
    except OSError:
        return None
    if not known:
        _prune(base, folder)
    return folder


def _base() -> Path | None:
    chosen = os.environ.get("LATIN_FMU_CACHE")
    if chosen is not None:
        return None if chosen in ("", "0") else Path(chosen)
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"]) / "latin-fmu"
    place = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME")
    try:
        return (Path(place) if place else Path.home() / ".cache") / "latin-fmu"
    except RuntimeError:  # a user without a home
        return None


def _digest(package: Path) -> str:
    import llvmlite
    import numba
    import numpy

    versions = (
        sys.version,
        sys.implementation.cache_tag,
        numba.__version__,
        llvmlite.__version__,
        numpy.__version__,
    )
    digest = hashlib.sha256(repr((package.name, *versions)).encode())
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        if not any(mark in content for mark in _MARKS):
            continue
        digest.update(f"{path.relative_to(package).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()[:32]


def _private(folder: Path) -> bool:
    """Whether it belongs to this user and nobody else can write into it: what lies there is run."""
    if not hasattr(os, "geteuid"):
        return True  # Windows: the profile of the user is private
    facts = os.lstat(folder)
    return stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.geteuid() and not facts.st_mode & 0o022


def _prune(base: Path, newest: Path) -> None:
    """Remove the folders of packages not used for longest."""
    with suppress(OSError):
        others = [f for f in base.iterdir() if f != newest and len(f.name) == 32 and f.is_dir()]
        for folder in sorted(others, key=lambda f: f.stat().st_mtime)[: max(0, len(others) + 1 - KEPT)]:
            shutil.rmtree(folder, ignore_errors=True)
