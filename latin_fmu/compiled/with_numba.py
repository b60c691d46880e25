"""Compilation by numba where the library of the wheel does not fit: once, kept in a cache folder by content.

numba keeps compiled code by the file that holds a function. A kernel whose callee in another file has changed would go
on with the old one, and the package inside an FMU has a new path at every extraction. Here numba is given copies of the
sources in a folder named by a digest of all of them, and keeps its files there, each with a checksum: a damaged one is
compiled anew.

``LATIN_FMU_CACHE`` in the environment names another folder; with 0 or nothing the code is compiled in every process.
"""

from __future__ import annotations

import ctypes
import hashlib
import io
import logging
import os
import shutil
import stat
import sys
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any, Final

from . import library

# Sums may be taken in another (fixed) order: without that they are not vectorised.
ORDERED: Final = {"fastmath": {"contract", "nsz"}}
OPTIONS: Final[dict[str, Any]] = {"nogil": True, "fastmath": {"reassoc", "contract", "nsz"}, "error_model": "numpy"}
BUILD: Final[dict[str, Any]] = {}  # further options in a process that builds the library
_CHECKSUM: Final = hashlib.sha256().digest_size  # bytes at the end of a file of the cache
KEPT: Final = 8  # folders; those not used for longest are removed


def dispatcher(function: Callable[..., Any], ordered: bool = False) -> Any:
    """``numba.njit`` of a kernel, kept in the cache folder where there is one; ``ordered``: sums stay in order."""
    numba: Any = import_module("numba")
    numba.config.SLP_VECTORIZE = 1  # several sums side by side become one vector
    options = OPTIONS | ORDERED if ordered else OPTIONS
    if BUILD:
        return _by_types(numba.njit(**options, **BUILD)(function))
    _name_yield()
    placed = _placed(function)
    if placed is not None:
        with suppress(RuntimeError):  # the folder went away: compile in this process only
            made = numba.njit(cache=True, **options)(placed)
            # numba has no setting for it: the files of its cache get the class that checks them
            made._cache._cache_file.__class__ = _checked_files()
            return _by_types(made)
    return _by_types(numba.njit(**options)(function))


@cache
def _name_yield() -> None:
    """Give compiled code the function by which a thread gives up its core (``kernels.team``)."""
    import llvmlite.binding as llvm

    system: Any = ctypes
    give_way = system.windll.kernel32.SwitchToThread if os.name == "nt" else ctypes.CDLL(None).sched_yield
    llvm.add_symbol("latin_fmu_yield", ctypes.cast(give_way, ctypes.c_void_p).value)


def _by_types(made: Any) -> Any:
    """The dispatcher, which compiles for the types of its arguments and not once more for every constant among them."""
    unliteral = import_module("numba").types.unliteral
    original = made.get_call_template

    def template(arguments: Any, keywords: Any) -> Any:
        return original(tuple(unliteral(a) for a in arguments), {k: unliteral(a) for k, a in keywords.items()})

    made.get_call_template = template
    return made


@cache
def _checked_files() -> type:
    """Class of numba's cache files that checks them before they are unpickled, and goes on without those it cannot
    read or write."""
    caching: Any = import_module("numba.core.caching")

    class CheckedFiles(caching.IndexDataCacheFile):  # type: ignore[misc]
        def save(self, key: Any, data: Any) -> None:
            try:
                super().save(key, data)
            except OSError as error:
                _warn_once(f"{self._cache_path}: compiled kernels cannot be kept ({error.strerror or error})")

        def _load_index(self) -> Any:
            # an empty index: numba takes its files for missing
            return super()._load_index() if self._intact(self._index_path) else {}

        def _load_data(self, name: str) -> Any:
            if not self._intact(self._data_path(name)):
                raise FileNotFoundError  # numba then compiles, and writes the file anew
            return super()._load_data(name)

        def _intact(self, path: str) -> bool:
            try:
                content = Path(path).read_bytes()
            except OSError:
                return False
            # the last bytes are the digest of the others
            if hashlib.sha256(content[:-_CHECKSUM]).digest() == content[-_CHECKSUM:]:
                return True
            _warn_once(f"{self._cache_path}: damaged files of compiled kernels: numba compiles these kernels again")
            return False

        @contextmanager
        def _open_for_write(self, path: str) -> Iterator[io.BytesIO]:
            # gathered first, since the digest stands behind the whole
            buffer = io.BytesIO()
            yield buffer
            content = buffer.getvalue()
            with super()._open_for_write(path) as file:
                file.write(content + hashlib.sha256(content).digest())

    return CheckedFiles


@cache
def _warn_once(text: str) -> None:
    logging.getLogger("latin_fmu").warning("%s", text)


def _placed(function: Callable[..., Any]) -> FunctionType | None:
    """The function as if it came from the copy of its source in the cache folder; None without one."""
    assert isinstance(function, FunctionType)
    folder = _ready(library.PACKAGE)
    if folder is None:
        return None
    try:
        source = Path(function.__code__.co_filename).relative_to(library.PACKAGE)
    except ValueError:  # no function of this package
        return None
    # numba names its files by the file name alone, and folders of ours are not deep
    code = function.__code__.replace(co_filename=str(folder / "_".join(source.parts)))
    # the globals stay: the kernels that it calls are found there
    placed = FunctionType(code, function.__globals__, function.__name__, function.__defaults__, function.__closure__)
    placed.__qualname__, placed.__module__ = function.__qualname__, function.__module__
    return placed


@cache
def _ready(package: Path) -> Path | None:
    """The cache folder with copies of the sources in it; logs what numba is about to do."""
    folder = cache_folder(package)
    # index files of numba: nothing is compiled yet without them
    fresh = folder is None or not any(folder.rglob("*.nbi"))
    if fresh:
        where = "in this process only" if folder is None else f"once; kept in {folder}"
        remedy = "unset LATIN_FMU_LIBRARY" if library.switched_off() else "python -m latin_fmu.aot makes the library"
        logging.getLogger("latin_fmu").warning(
            "%s: numba compiles the kernels now, up to seven minutes of processor time and 3 GB of memory (%s); to "
            "avoid it: %s",
            library.reason(),
            where,
            remedy,
        )
    return folder


@cache
def cache_folder(package: Path) -> Path | None:
    """The folder for the sources below ``package``, made where it is missing; None where there is no safe one."""
    base = _base()
    if base is None:
        return None
    sources = library.sources_of(package)
    folder = base / library.digest_of(package, sources, _versions())[:32]
    try:
        known = folder.is_dir()  # before it is made
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        if not _private(folder):
            return None
        os.utime(folder)  # age, for ``_prune``
        for source in sources:
            copy = folder / "_".join(source.parts)
            if not copy.exists():
                # a process that starts at the same time must not see half of it
                draft = folder / uuid.uuid4().hex
                draft.write_bytes((package / source).read_bytes())
                os.replace(draft, copy)
    except OSError:
        return None
    if not known:
        _prune(base, folder)
    return folder


def _versions() -> str:
    """What compiled code depends on beside the sources: versions, and the name under which the package is imported,
    because numba keeps types by the name of their module: an FMU imports its copy under a name of its own."""
    import llvmlite
    import numba
    import numpy

    name = __name__.partition(".")[0]
    return repr((name, sys.version, numba.__version__, llvmlite.__version__, numpy.__version__))


def _base() -> Path | None:
    chosen = os.environ.get("LATIN_FMU_CACHE")
    if chosen is not None:
        return None if chosen in ("", "0") else Path(chosen).absolute()
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"]).absolute() / "latin-fmu"
    place = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME")
    try:
        return (Path(place) if place else Path.home() / ".cache") / "latin-fmu"
    except RuntimeError:  # a user without a home
        return None


def _private(folder: Path) -> bool:
    """Whether only this user, or root, can write into it or put another folder in its place: what lies there is run.

    The folder and the files in it belong to this user. Every folder above, links followed and not, belongs to this user
    or to root, and others cannot write into it, or not rename what is in it (the sticky bit, as in /tmp).
    """
    if not hasattr(os, "geteuid"):
        return True  # Windows: the profile of the user is private
    if not stat.S_ISDIR(os.lstat(folder).st_mode) or not all(_own(path) for path in (folder, *folder.rglob("*"))):
        return False
    above = {*folder.parents, *Path(os.path.realpath(folder)).parents}
    return all(_safe(path) for path in above)


def _own(path: Path) -> bool:
    facts = os.lstat(path)
    return facts.st_uid == os.geteuid() and not facts.st_mode & 0o022


def _safe(path: Path) -> bool:
    """Whether nobody else can replace what a folder above the cache, or a link to one, holds."""
    link, facts = os.lstat(path), path.stat()
    trusted = (0, os.geteuid())
    if link.st_uid not in trusted or facts.st_uid not in trusted:
        return False
    return not facts.st_mode & 0o022 or bool(facts.st_mode & stat.S_ISVTX)


def _prune(base: Path, newest: Path) -> None:
    """Remove the folders of packages not used for longest."""
    with suppress(OSError):
        others = [f for f in base.iterdir() if f != newest and len(f.name) == 32 and f.is_dir()]  # names are digests
        # the newest counts among those that are kept
        for folder in sorted(others, key=lambda f: f.stat().st_mtime)[: max(0, len(others) + 1 - KEPT)]:
            shutil.rmtree(folder, ignore_errors=True)
