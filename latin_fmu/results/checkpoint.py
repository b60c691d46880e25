"""Checkpoints: what a run needs to continue after its process has ended, to the last bit.

Three files. ``NAME`` holds the state after a window and is replaced at every checkpoint, whole or not at all; its
header names the scene, the version and the kind of machine. ``NAME.previous`` is the one before, for a disk that fails.
``NAME.histories`` grows by what was recorded since the last checkpoint; the state holds its length and its checksum,
so that a part written by a process that was killed meanwhile does not count.

A run that does not continue the checkpoint that it finds renames it to ``NAME.1``, ``NAME.1.histories`` (2, 3, ...)
before it writes its own. Links are not followed: another user of the folder could have placed them.
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
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import numpy as np

from ..compiled import PLAIN, library
from ..errors import InputError, LatinError, ResultsError, SolverError
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
    kernels = "in Python"
    if not PLAIN:
        kernels = library.manifest(library.needed())[1][:12]
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

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> kept = latin_fmu.Checkpoint(folder / "bar.checkpoint", every=100)
    >>> latin_fmu.solve(scene, checkpoint=kept).converged
    True
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
        self.path, self.histories, self.previous = Path(path), Path(f"{path}.histories"), Path(f"{path}.previous")
        self._every, self._seconds, self._resume = every, seconds, resume
        self._stop = stop
        self._log: Callable[[str], None] = warnings.warn if log is None else log
        self._file: BinaryIO | None = None
        self._told = ""
        self._owns_files = False  # whether the files at ``path`` are of this run

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
        ResultsError : the checkpoint is damaged, or of another scene, version or machine.
        """
        self._digest, self._machine = digest, machine()
        recorder = run.recorder
        self._first, self._fields, self._windows = recorder.n_kept, recorder.n_fields, 0
        self._bytes, self._checksum = 0, hashlib.blake2b(digest_size=32)
        self._last, self._written_at = 0, clock.monotonic()
        longest = run.settings.window or run.assembly.n_instant
        if self._every is not None and self._every < longest:
            what = f"a checkpoint is written between two windows, which have {longest} instants"
            raise InputError.of(
                "bad argument", "checkpoint", what, str(self._every), f">= {longest}", "use solver.window = 1"
            )
        if self._periodic or self._resume:
            for path in (self.path, self.histories):
                _refuse_link(path)
                check_target(path)
            self._lock()
        if self._resume and self.found:
            self._continue(run)

    def instants(self, run: Run) -> int:
        """Instants, at least 1, that may be solved until the next checkpoint."""
        return _ANY if self._every is None else max(1, self._every - (run.assembly.instant - self._last))

    def stops(self) -> bool:
        """Whether the run has to stop."""
        return self._stop is not None and self._stop()

    def check(self, run: Run) -> bool:
        """Write a checkpoint where one is due; whether the run has to stop."""
        instant, stops, ended = run.assembly.instant, bool(run.stops()), run.ended
        since = instant - self._last
        # due before the window that would end beyond ``every``, not after it
        due = self._every is not None and since + (run.settings.window or 1) > self._every
        due = due or (self._seconds is not None and clock.monotonic() - self._written_at >= self._seconds)
        if (stops and not ended) or ((due or (ended and self._periodic)) and since):
            self._write(run)
        return stops and not ended

    def remove(self) -> None:
        """Remove the files of this run: the results have been written. Those of another run stay."""
        if self._owns_files or not self.found:
            for path in (self.path, self.previous, self.histories):
                with suppress(OSError):
                    path.unlink(missing_ok=True)

    @property
    def found(self) -> bool:
        """Whether there is a checkpoint, of this run or of an earlier one."""
        return self.path.is_file() or self.previous.is_file()

    @property
    def _periodic(self) -> bool:
        return self._every is not None or self._seconds is not None

    # -- files --------------------------------------------------------------------------------------------------------
    def _lock(self) -> BinaryIO:
        """The file of the histories, for this process alone (where the system has such locks)."""
        if self._file is not None:
            return self._file
        _refuse_link(self.histories)
        # no O_TRUNC: the file may be that of a run to be continued
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        file = os.fdopen(os.open(self.histories, flags, 0o666), "r+b")
        try:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except ImportError:
            pass
        except OSError as error:
            holder = _holder(file.fileno())
            file.close()
            what, remedy = "another run uses this checkpoint", "wait until it has ended, or choose another output"
            raise InputError.of("bad argument", str(self.path), what, holder, remedy=remedy) from error
        self._file = file
        return file

    def _take_over(self) -> None:
        """Make the place free for the checkpoints of this run: those of an earlier one get a number."""
        _refuse_link(self.path)
        if not self._owns_files and self.found:
            number = next(n for n in count(1) if not os.path.lexists(f"{self.path}.{n}"))
            for suffix in ("", ".previous", ".histories"):
                with suppress(FileNotFoundError):
                    os.rename(f"{self.path}{suffix}", f"{self.path}.{number}{suffix}")
            if self._file is not None:
                self._file.close()
                self._file = None
            text = (
                f"the checkpoint of an earlier run is kept as {self.path}.{number} and {self.path}.{number}.histories"
            )
            self._log(f"{text}: rename both to continue it with --resume")
        self._owns_files = True

    def _write(self, run: Run) -> None:
        """Write a checkpoint; where that fails the run goes on, and the last one stays."""
        try:
            self._lock()
            self._take_over()
            file, recorder = self._lock(), run.recorder
            part = encode(
                {
                    "first": self._first,
                    "recorder": recorder.part(self._first, self._fields),
                    "windows": run.windows.part(self._windows),
                },
                _KIND,
            )
            added = len(part).to_bytes(_LENGTH, "little") + part
            # behind the last checkpoint: a part of a process that was killed
            file.truncate(self._bytes)
            file.seek(self._bytes)
            file.write(added)
            file.flush()
            # the histories first: the state names their length and checksum
            os.fsync(file.fileno())
            checksum = self._checksum.copy()
            checksum.update(added)
            tree = {"run": run.snapshot(), "bytes": self._bytes + len(added), "checksum": checksum.hexdigest()}
            state = sealed(encode(tree, _KIND), _KIND, self._digest, self._machine)
            self._keep_previous()
            write_bytes(self.path, state, rescue=False)
        except (OSError, UnwrittenError, InputError) as error:
            if str(error) != self._told:
                self._told = str(error)
                self._log(f"the checkpoint could not be written, the run continues: {error}")
            # the next attempt after ``seconds``, not after every window
            self._written_at = clock.monotonic()
            return
        self._bytes, self._checksum = self._bytes + len(added), checksum
        self._first, self._fields, self._windows = recorder.n_kept, recorder.n_fields, len(run.windows)
        self._last, self._written_at = run.assembly.instant, clock.monotonic()

    def _keep_previous(self) -> None:
        """Give the present state its second name, under which it outlives the next one; file systems without hard
        links keep one generation."""
        with suppress(OSError):
            self.previous.unlink(missing_ok=True)
            os.link(self.path, self.previous)

    def _continue(self, run: Run) -> None:
        """Bring a run at t = 0 to the state of the checkpoint; of the one before where it is damaged.

        Raises
        ------
        ResultsError : none of both can be used.
        """
        failure: ResultsError | None = None
        for path in (self.path, self.previous):
            if not path.is_file():
                continue
            try:
                tree = decode(opened(path.read_bytes(), _KIND, self._digest, self._machine), _KIND)
                checksum = self._checked(tree["bytes"], tree["checksum"])
            except (LatinError, OSError) as error:
                failure = failure or ResultsError.of(
                    "the run cannot be continued", str(path), str(error), remedy="or run without --resume"
                )
                continue
            if failure is not None:
                self._log(f"{failure.problems[0]}; the previous checkpoint is used")
            self._checksum, self._owns_files = checksum, True
            for part in self._parts(tree["bytes"]):
                run.recorder.append(part["recorder"], part["first"])
                run.windows.extend(part["windows"])
            run.restore(tree["run"])
            self._first, self._fields, self._windows = run.recorder.n_kept, run.recorder.n_fields, len(run.windows)
            self._bytes, self._last = tree["bytes"], run.assembly.instant
            self._log(f"continued from {path}: instant {self._last} of {run.assembly.n_instant}")
            return
        if failure is not None:
            raise failure

    def _checked(self, size: int, checksum: str) -> Any:
        """Digest of the first ``size`` bytes of the histories, which must be the ``checksum``."""
        file, digest = self._lock(), hashlib.blake2b(digest_size=32)
        file.seek(0)
        # a megabyte at a time: histories may be larger than the memory
        while (block := file.read(min(1 << 20, size - file.tell()))) and file.tell() <= size:
            digest.update(block)
        if file.tell() != size or digest.hexdigest() != checksum:
            raise SolverError(
                f"the checkpoint cannot be used: {self.histories} is damaged (its checksum does not fit); use an "
                "intact copy"
            )
        return digest

    def _parts(self, size: int) -> Iterator[Any]:
        """The parts of the histories, which have been checked."""
        file = self._lock()
        file.seek(0)
        while file.tell() < size:
            yield decode(file.read(int.from_bytes(file.read(_LENGTH), "little")), _KIND)


def _refuse_link(path: Path) -> None:
    """Refuse a link at the place of a checkpoint.

    Raises
    ------
    InputError : there is one.
    """
    if path.is_symlink():
        what = "this is a link; checkpoints do not follow links"
        raise InputError.of("bad argument", str(path), what, remedy="remove it, or name another output")


def _holder(descriptor: int) -> str | None:
    """The process that has locked an open file, where the system tells (Linux, of processes of this machine)."""
    number = os.fstat(descriptor).st_ino
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()  # 1: FLOCK  ADVISORY  WRITE 812 08:01:4711 0 EOF
            if words[1] == "FLOCK" and int(words[5].rsplit(":", 1)[1]) == number:
                return f"process {words[4]}"
    return None
