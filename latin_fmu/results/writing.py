"""Writing of outputs: one way for files and folders of every kind.

An output is absent or a regular file (a folder of files); links are followed. Its place is checked before a long run
(``check_target``). It is drafted beside its place, flushed to the disk and renamed, so that it is whole or not there.
Where that fails at the end, it is written to the temporary folder instead, and the error names the place.
"""

from __future__ import annotations

import os
import platform
import shutil
import stat
import tempfile
import uuid
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from ..errors import Problem, ResultsError

PRINTED: Final = ".dat"
"""Suffix of what a deck prints."""
FILED: Final = ".frd"
"""Suffix of the fields that a deck files."""
Write = Callable[[Path], object]
"""Writes an output to the path it is given."""
STREAMED: Final = 64e6
"""Bytes of interface histories from which on a run that may do so keeps them in a file."""
IN_MEMORY: Final = 20_000
"""Instants of such histories that are kept in memory, at most."""

_KINDS: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISLNK, "a link that leads to itself"),
)


class UnwrittenError(ResultsError):
    """An output could not be written at the end of the work; the problem names the place it was written to instead."""


def unwritable(path: Path, what: str, remedy: str) -> ResultsError:
    """The error for a place that cannot be written to."""
    return ResultsError([Problem(str(path), what, remedy=remedy)], "cannot write the results")


def check_target(path: str | Path, size: float = 0.0) -> Path:
    """Make sure that a file of ``size`` bytes can be created at ``path``; the place that its links lead to.

    Raises
    ------
    ResultsError : ``path`` is neither absent nor a regular file, is protected against writing, or its folder is
        missing, is not a folder, refuses new files or has too little space.
    """
    target, mode = _behind_links(path)
    if mode is not None and not stat.S_ISREG(mode):
        kind = next((text for test, text in _KINDS if test(mode)), "not a regular file")
        raise unwritable(target, f"this is {kind}, a file is needed", f"name a file, e.g. {_example(target)}")
    if mode is not None and not os.access(target, os.W_OK):
        raise unwritable(target, "the file is protected against writing", "allow writing, or name another file")
    check_folder(target.parent, size)
    return target


def _example(target: Path) -> Path:
    if target.is_dir():
        return target / "out.nc"
    if Path("/dev") in target.parents:
        return Path("out.nc")
    return target.parent / "out.nc"


def _behind_links(path: str | Path) -> tuple[Path, int | None]:
    """The place that the links of ``path`` lead to, and its mode, None where nothing is there."""
    target = Path(os.path.realpath(path))
    try:
        return target, target.lstat().st_mode
    except FileNotFoundError:
        with suppress(OSError):  # /dev/stdout leads to a pipe that has no name
            return Path(path), Path(path).stat().st_mode
        return target, None
    except NotADirectoryError:
        return target, None  # reported by the check of the folder
    except OSError as error:
        raise unwritable(target, f"cannot be reached: {error.strerror or error}", "choose another place") from error


def check_folder(folder: Path, size: float = 0.0) -> None:
    """Make sure that a new file of ``size`` bytes can be created in ``folder``.

    Raises
    ------
    ResultsError : missing, not a folder, not writable, or too little space.
    """
    if not folder.is_dir():
        if folder.exists():
            what = "this is a file, not a folder"
        else:
            what = "the folder does not exist"
        raise unwritable(folder, what, "create the folder or choose another place")
    try:
        # permissions do not show read-only or full file systems
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0")
        free = shutil.disk_usage(folder).free
    except OSError as error:
        what = f"no file can be created here: {error.strerror or error}"
        raise unwritable(folder, what, "choose a writable folder with free space") from error
    if free < size:
        what = f"{free / 1e6:.0f} MB are free, the file may need {size / 1e6:.0f} MB"
        raise unwritable(folder, what, "free space, choose another folder, or store less (output.every, output.fields)")


def write_whole(
    path: str | Path, write: Write, check: Callable[[str | Path], Path] = check_target, rescue: bool = True
) -> Path:
    """Write a file, or a folder of files, whole or not at all; the place it was written to, links followed.

    ``write`` is called with the path of a draft beside the target, of the same suffix (writers guess formats from it).
    On any failure, an interruption included, the draft is removed and an existing target is left as it was.

    Parameters
    ----------
    write : may be called a second time, with a path in the temporary folder. check : of the place.
    rescue : whether it is; False for what is not worth it.

    Raises
    ------
    UnwrittenError : the place is not good or writing failed, e.g. on a full disk; names the file that was written to
        the temporary folder instead.
    """
    draft: Path | None = None
    try:
        target = check(path)
        draft = target.with_name(f"{_draft_stem()}{os.getpid()}-{uuid.uuid4().hex}{target.suffix}")
        write(draft)
        _flush(draft)
        _move(draft, target)
    except (OSError, ResultsError) as error:
        copy = None
        if rescue:
            copy = _rescued(Path(path), write)
        raise _unwritten(Path(path), error, copy) from error
    finally:
        if draft is not None:
            _remove(draft)
    return target


def _draft_stem() -> str:
    """First part of the names of drafts of this machine; the number of a process says nothing on another one."""
    return f".latin-fmu-{zlib.crc32(platform.node().encode()):08x}-"


def remove_dead_drafts(folder: Path) -> None:
    """Remove drafts in a folder that processes of this machine have left which were killed."""
    stem = _draft_stem()
    with suppress(OSError):
        for path in folder.glob(f"{stem}*"):
            number = path.name.removeprefix(stem).split("-")[0]
            # a draft of a process that runs may be written right now
            if number.isdigit() and not _is_alive(int(number)):
                _remove(path)


def _is_alive(process: int) -> bool:
    """Whether a process of this number is there; True where the system does not tell."""
    if os.name != "posix":
        return True
    try:
        # signal 0 checks that the process exists, and sends nothing
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # no permission to signal it: it exists
    except (OSError, OverflowError):
        return True
    return True


def write_bytes(path: str | Path, content: bytes, rescue: bool = True) -> Path:
    """Write a file of ``content`` as ``write_whole`` does."""
    return write_whole(path, lambda draft: draft.write_bytes(content), rescue=rescue)


def _unwritten(target: Path, error: OSError | ResultsError, rescue: Path | None) -> UnwrittenError:
    """The error, with the cause and the place of the output."""
    if isinstance(error, ResultsError):
        where, what = error.problems[0].where, error.problems[0].what
    else:
        where, what = str(target), f"writing failed: {error.strerror or error}"
    if rescue is None:
        remedy = "it was not written to the temporary folder either; check free space and permissions"
    else:
        remedy = f"it was written to {rescue} instead: move it from there"
    return UnwrittenError([Problem(where, what, remedy=remedy)], "cannot write the results")


def _rescued(target: Path, write: Write) -> Path | None:
    """The output in the temporary folder; None where it cannot be written there."""
    folder = None
    try:
        folder = Path(tempfile.mkdtemp(prefix="latin-fmu-"))
        rescue = folder / target.name
        write(rescue)
        _flush(rescue)
    except OSError:
        if folder is not None:
            _remove(folder)
        return None
    return rescue


def _flush(written: Path) -> None:
    """Bring a file, or the files of a folder, to the disk."""
    # before the name: else after a crash the name might stand for an empty file
    files = [written]
    if written.is_dir():
        files = sorted(written.rglob("*"))
    for file in files:
        with file.open("r+b") as stream:
            os.fsync(stream.fileno())


def _move(draft: Path, target: Path) -> None:
    """Rename the draft to the target; a folder that is there makes way, a file gives its mode."""
    aside = None
    if target.is_dir():
        aside = target.with_name(f".latin-fmu-before-{uuid.uuid4().hex}")
        target.rename(aside)
    elif target.exists():
        draft.chmod(stat.S_IMODE(target.stat().st_mode))
    try:
        draft.replace(target)
    except OSError:
        if aside is not None:
            aside.rename(target)
        raise
    if aside is not None:
        _remove(aside)
    with suppress(OSError):  # the new name is brought to the disk as well, where the system can open folders
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _remove(path: Path) -> None:
    """Remove a file or a folder with its files, where there is one."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)
