"""Operators and static states on disk: what one run computes for them, the next run of the same bodies reads.

An entry holds arrays that are a function of others: the numbers of a factor, of a matrix, its interface, its order of
elimination and its type. Its name is the digest of these, of the version of the package and of the library of compiled
kernels, as other instructions round otherwise: what is read has the bits that would be computed. Loads, friction, gaps
and bolt forces enter no matrix, and a run in which they alone have changed factorises nothing; the state with tight
bolts depends on them, and on no load that begins with 0.

An entry is a folder of ``.npy`` files and a list of them with their checksums. It is written beside its place and then
renamed, so that processes may share a store; it is read without unpickling, the numbers of factors mapped into memory.
An entry that is incomplete or damaged is removed and computed anew. The entries used longest ago are removed where all
of them exceed the limit.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import sys
import tempfile
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .compiled import PLAIN
from .compiled.library import PACKAGE, digest_of
from .errors import Problem, ResultsError

Arrays = dict[str, NDArray[Any]]

_LIST: Final = "arrays.json"
_SMALLEST: Final = 100_000
"""Bytes below which an entry is not written: opening its files takes as long as computing it, about a millisecond."""

_BLOCK: Final = 1 << 20
"""Bytes of a file that are read at a time."""


@dataclass(eq=False)
class OperatorStore:
    """Entries of one folder.

    Parameters
    ----------
    folder : made where it does not exist; None: nothing is kept, every call computes.
    limit : of the sizes of all entries, bytes.

    Attributes
    ----------
    read, written, removed : numbers of entries since ``recount``; removed: incomplete or damaged ones.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> matrix = 2.0 * np.eye(200)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for _ in range(2):
    ...         store = OperatorStore(Path(folder))
    ...         inverse = store.remember(store.name("inverse", matrix), lambda: {"x": np.linalg.inv(matrix)})["x"]
    ...         print(inverse[0, 0], store.written, store.read)
    0.5 1 0
    0.5 0 1
    """

    folder: Path | None = None
    limit: float = np.inf
    read: int = field(default=0, init=False)
    written: int = field(default=0, init=False)
    removed: int = field(default=0, init=False)

    def name(self, kind: str, *given: Any) -> str:
        """Name of an entry; "" where nothing is kept.

        Parameters
        ----------
        kind : of its arrays. given : all that they depend on: arrays, sparse matrices, numbers, texts and None.
        """
        return "" if self.folder is None else f"{kind}-{_digest(given)}"

    def remember(
        self, name: str, make: Callable[[], Arrays], mapped: Collection[str] = (), smallest: int | None = None
    ) -> Arrays:
        """Arrays of an entry with this ``name``, read where they are known, else made; they may be written to.

        Parameters
        ----------
        mapped : names of arrays that stay in their file until they are used. Others are read into memory: sums of
            NumPy and of BLAS round by the address that an array begins at, and files begin elsewhere.
        smallest : bytes below which an entry is not written, ``_SMALLEST`` where None.

        Raises
        ------
        ResultsError : the folder cannot be written.
        """
        if self.folder is None:
            return make()
        place = self.folder / name
        known = self._known(place, mapped)
        if known is not None:
            self.read += 1
            return known
        made = make()
        if sum(array.nbytes for array in made.values()) >= (_SMALLEST if smallest is None else smallest):
            try:
                self._write(place, made)
            except OSError as error:
                raise _unwritable(self.folder, error) from error
        return made

    def _known(self, place: Path, mapped: Collection[str]) -> Arrays | None:
        """Arrays of an entry; None where there is none, or a damaged one, which is removed."""
        try:
            listed = json.loads((place / _LIST).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            listed = None
        arrays: Arrays = {}
        try:
            for name, checksum in listed.items():
                # copy on write: compiled functions take arrays that may be written to, the file stays
                mode: Literal["c"] | None = "c" if name in mapped else None
                # before it is read: NumPy meets a damaged header with any exception, and takes any shape from it
                if _checksum(place / f"{name}.npy") != checksum:
                    raise ValueError(name)
                # entries of kernels take arrays of NumPy's own class alone
                arrays[name] = np.asarray(np.load(place / f"{name}.npy", mmap_mode=mode, allow_pickle=False))
            os.utime(place / _LIST)  # used now: removed last
        except (OSError, ValueError, AttributeError, TypeError, EOFError):
            self.removed += 1
            shutil.rmtree(place, ignore_errors=True)
            return None
        return arrays

    def _write(self, place: Path, made: Mapping[str, NDArray[Any]]) -> None:
        """Write an entry under another name, then rename it; one that another process has written meanwhile stays."""
        place.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=".writing-", dir=place.parent))
        try:
            listed = {}
            for name, array in made.items():
                # ascontiguousarray makes a single number an array of one
                whole = np.ascontiguousarray(array).reshape(array.shape)
                np.save(beside / f"{name}.npy", whole, allow_pickle=False)
                listed[name] = _checksum(beside / f"{name}.npy")
            (beside / _LIST).write_text(json.dumps(listed), encoding="utf-8")
            # fails where another process has put it there: that entry stays
            beside.rename(place)
            self.written += 1
        except OSError:
            if not place.exists():
                raise
        finally:
            shutil.rmtree(beside, ignore_errors=True)
        self._fit(place)

    def _fit(self, newest: Path) -> None:
        """Remove the entries used longest ago until the others, and ``newest`` in any case, fit in the limit."""
        entries = []
        for entry in newest.parent.iterdir():
            try:
                entries.append(((entry / _LIST).stat().st_mtime, sum(f.stat().st_size for f in entry.iterdir()), entry))
            except OSError:  # no entry, or removed by another process
                continue
        size = sum(bytes_ for _, bytes_, _ in entries)
        for _, bytes_, entry in sorted(entries):
            if size <= self.limit:
                return
            if entry != newest:
                shutil.rmtree(entry, ignore_errors=True)  # an array in use stays mapped
                size -= bytes_

    def recount(self) -> None:
        """Count anew: a run begins."""
        self.read = self.written = self.removed = 0

    def remark(self) -> str:
        """What was read and written, in words; empty without a folder."""
        if self.folder is None:
            return ""
        damaged = f", {self.removed} damaged removed" if self.removed else ""
        return f"{self.read} read, {self.written} written{damaged}"


NO_STORE: Final = OperatorStore()
"""Keeps nothing."""


@cache
def store_at(folder: Path, limit: float) -> OperatorStore:
    """The store of a folder, one in this process."""
    return OperatorStore(folder, limit)


@cache
def _code() -> str:
    """Digest of the source of the package, and of what it runs on."""
    sources = sorted(PACKAGE.rglob("*.py"))
    # Python takes sums in another order than the library
    on = f"{platform.machine()} {sys.platform} {PLAIN}"
    return digest_of(PACKAGE, sources, on)


def _checksum(file: Path) -> int:
    """Checksum of a file."""
    total = 0
    with file.open("rb") as stream:
        while block := stream.read(_BLOCK):
            total = zlib.crc32(block, total)
    return total


def _digest(given: Iterable[Any]) -> str:
    """Digest of what an entry depends on."""
    digest = hashlib.blake2b(f"{_code()} {np.__version__}".encode(), digest_size=20)
    for part in given:
        if isinstance(part, sp.csr_array | sp.csc_array):
            # SciPy chooses the width of indices by how a matrix was made
            pattern = (np.asarray(indices, dtype=np.int64) for indices in (part.indptr, part.indices))
            arrays: tuple[Any, ...] = (np.array(part.shape), *pattern, part.data)
        elif isinstance(part, np.ndarray):
            arrays = (part,)
        else:
            arrays = ()
            digest.update(f"|{type(part).__name__} {part!r}".encode())
        for array in arrays:
            # the same bytes of another shape are another array
            digest.update(f"|{array.dtype} {array.shape}".encode())
            digest.update(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _unwritable(folder: Path, error: OSError) -> ResultsError:
    what, remedy = f"operators cannot be written ({error.strerror or error})", "free space, or leave the table out"
    problem = Problem("solver.operators.folder", what, str(folder), "a folder that can be written", remedy)
    return ResultsError([problem], "operators cannot be kept")
