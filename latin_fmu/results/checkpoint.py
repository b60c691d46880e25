"""Checkpoints: what a run needs to continue after its process has ended, to the last bit.

Two files. ``NAME`` holds the state after a window and is replaced at every checkpoint, whole or not at all; its header
names the scene, the version and the kind of machine. ``NAME.histories`` grows by what was recorded since the last
checkpoint; the state holds its length and its checksum, so that a part written by a process that was killed meanwhile
does not count.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import time as clock
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import numpy as np

from ..compiled import library
from ..errors import InputError, SolverError
from ..latin.state_serialization import decode, encode, opened, sealed
from ..latin.windows import Run
from .writing import UnwrittenError, check_target, write_bytes

if TYPE_CHECKING:
    from ..scene.schema import Scene

_KIND: Final = "checkpoint"
_LENGTH: Final = 8  # bytes that hold the length of a part of the histories
_ANY: Final = 1 << 30  # instants: no limit


def machine() -> str:
    """What the bits of a run depend on beside the scene and the version of the package."""
    shared = library.loaded()
    kernels = "compiled by numba" if shared is None else library.manifest(shared)[1][:12]
    doubles = f"doubles {np.dtype(float).str} with {np.finfo(float).nmant} bits"
    versions = f"Python {platform.python_version()}, numpy {np.__version__}"
    return f"{library.target()}, {sys.byteorder}-endian, {doubles}, kernels {kernels}, {versions}"


def scene_digest(scene: Scene, more: Iterable[str] = ()) -> str:
    """Digest of a scene, of its mesh files, and of more."""
    digest = hashlib.sha256(scene.text().encode())
    meshes = {str(body.mesh.file) for body in scene.substructure.values() if body.mesh is not None}
    for file in sorted(meshes):
        digest.update(hashlib.sha256((scene.base_dir / file).read_bytes()).digest())
    for text in more:
        digest.update(hashlib.sha256(text.encode()).digest())
    return digest.hexdigest()


class Checkpoint:
    """Writes the checkpoints of a run between its windows, and continues from one.

    Parameters
    ----------
    path : of the file of the state. every : instants between two checkpoints, at most; None for no such limit.
    seconds : likewise, s of the wall clock. resume : continue from the checkpoint at ``path`` where there is one.
    stop : whether the run has to stop; called between windows, a checkpoint is then written. log : takes a sentence on
        a checkpoint that could not be written, and on one that was continued from.
    """

    def __init__(
        self,
        path: str | Path,
        every: int | None = None,
        seconds: float | None = None,
        resume: bool = False,
        stop: Callable[[], bool] | None = None,
        log: Callable[[str], None] | None = None,
    ) -> None:
        self.path, self.histories = Path(path), Path(f"{path}.histories")
        self._every, self._seconds, self._resume = every, seconds, resume
        self._stop = stop
        self._log: Callable[[str], None] = warnings.warn if log is None else log
        self._file: BinaryIO | None = None
        self._told = ""

    @contextmanager
    def of(self, run: Run, digest: str) -> Iterator[None]:
        """Context in which a run is marched: ``begin`` at its start; the files are closed at its end."""
        try:
            self.begin(run, digest)
            yield
        finally:
            if self._file is not None:
                with suppress(OSError):  # a full disk: what its buffer still holds belongs to no checkpoint
                    self._file.close()
                self._file = None

    # -- called by the run ------------------------------------------------------------------------------------------
    def begin(self, run: Run, digest: str) -> None:
        """Start with a run that is at t = 0; continue it where there is a checkpoint and ``resume`` is set.

        Raises
        ------
        InputError : the place is not good, windows are longer than ``every``, or another run writes here.
        SolverError : the checkpoint is damaged, or of another scene, version or machine.
        """
        self._digest, self._machine = digest, machine()
        recorder = run.recorder
        self._kept, self._fields, self._windows = recorder.n_kept, recorder.n_fields, 0
        self._bytes, self._checksum = 0, hashlib.blake2b(digest_size=32)
        self._last, self._written_at = 0, clock.monotonic()
        longest = run.settings.window or run.assembly.n_instant
        if self._every is not None and self._every < longest:
            what = f"a checkpoint is written between two windows, which have {longest} instants"
            raise InputError.of(
                "bad argument", "checkpoint", what, str(self._every), f">= {longest}", "use solver.window = 1"
            )
        if self._periodic or self._resume:
            check_target(self.path)
            check_target(self.histories)
            self._lock()
        if self._resume and self.path.exists():
            self._continue(run)

    def instants(self, run: Run) -> int:
        """Instants, at least 1, that may be solved until the next checkpoint."""
        return _ANY if self._every is None else max(1, self._every - (run.assembly.instant - self._last))

    def stops(self) -> bool:
        """Whether the run has to stop."""
        return self._stop is not None and self._stop()

    def check(self, run: Run) -> bool:
        """Write a checkpoint where one is due; whether the run has to stop."""
        instant, stops = run.assembly.instant, self.stops()
        since = instant - self._last
        ended = run.stopped or instant == run.assembly.n_instant
        due = self._every is not None and since + (run.settings.window or 1) > self._every
        due = due or (self._seconds is not None and clock.monotonic() - self._written_at >= self._seconds)
        if (stops and not ended) or ((due or (ended and self._periodic)) and since):
            self._write(run)
        return stops and not ended

    def remove(self) -> None:
        """Remove the files: the results have been written."""
        for path in (self.path, self.histories):
            with suppress(OSError):
                path.unlink(missing_ok=True)

    @property
    def _periodic(self) -> bool:
        return self._every is not None or self._seconds is not None

    # -- files --------------------------------------------------------------------------------------------------------
    def _lock(self) -> BinaryIO:
        """The file of the histories, for this process alone (where the system has such locks)."""
        if self._file is not None:
            return self._file
        file = os.fdopen(os.open(os.path.realpath(self.histories), os.O_RDWR | os.O_CREAT, 0o666), "r+b")
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:
            pass
        except OSError as error:
            file.close()
            what, remedy = "another run writes its checkpoint here", "wait for its end, or name another output"
            raise InputError.of("bad argument", str(self.path), what, remedy=remedy) from error
        self._file = file
        return file

    def _write(self, run: Run) -> None:
        """Write a checkpoint; where that fails the run goes on, and the last one stays."""
        try:
            file, recorder = self._lock(), run.recorder
            part = encode(
                {
                    "first": self._kept,
                    "recorder": recorder.part(self._kept, self._fields),
                    "windows": run.windows.part(self._windows),
                },
                _KIND,
            )
            added = len(part).to_bytes(_LENGTH, "little") + part
            file.truncate(self._bytes)
            file.seek(self._bytes)
            file.write(added)
            file.flush()
            os.fsync(file.fileno())
            checksum = self._checksum.copy()
            checksum.update(added)
            tree = {"run": run.snapshot(), "bytes": self._bytes + len(added), "checksum": checksum.hexdigest()}
            write_bytes(self.path, sealed(encode(tree, _KIND), _KIND, self._digest, self._machine), rescue=False)
        except (OSError, UnwrittenError, InputError) as error:
            if str(error) != self._told:
                self._told = str(error)
                self._log(f"the checkpoint could not be written, the run goes on: {error}")
            self._written_at = clock.monotonic()
            return
        self._bytes, self._checksum = self._bytes + len(added), checksum
        self._kept, self._fields, self._windows = recorder.n_kept, recorder.n_fields, len(run.windows)
        self._last, self._written_at = run.assembly.instant, clock.monotonic()

    def _continue(self, run: Run) -> None:
        """Bring a run at t = 0 to the state of the checkpoint."""
        try:
            tree = decode(opened(self.path.read_bytes(), _KIND, self._digest, self._machine), _KIND)
        except SolverError as error:
            raise SolverError(f"{self.path}: {error}; or run without --resume") from error
        for part in self._parts(tree["bytes"], tree["checksum"]):
            run.recorder.append(part["recorder"], part["first"])
            run.windows.extend(part["windows"])
        run.restore(tree["run"])
        self._kept, self._fields, self._windows = run.recorder.n_kept, run.recorder.n_fields, len(run.windows)
        self._bytes, self._last = tree["bytes"], run.assembly.instant
        self._log(f"continued from {self.path}: instant {self._last} of {run.assembly.n_instant}")

    def _parts(self, size: int, checksum: str) -> Iterator[Any]:
        """The parts of the histories, after all have been checked."""
        file = self._lock()
        file.seek(0)
        while (block := file.read(min(1 << 20, size - file.tell()))) and file.tell() <= size:
            self._checksum.update(block)
        if file.tell() != size or self._checksum.hexdigest() != checksum:
            raise SolverError(
                f"the checkpoint cannot be used: {self.histories} is damaged (its checksum does not fit); use an "
                "intact copy, or run without --resume"
            )
        file.seek(0)
        while file.tell() < size:
            yield decode(file.read(int.from_bytes(file.read(_LENGTH), "little")), _KIND)
