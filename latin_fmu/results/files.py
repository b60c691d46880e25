"""Writing a result file so that it is either complete or not there."""

from __future__ import annotations

import os
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import Problem, ResultsError


def unwritable(path: Path, what: str, remedy: str) -> ResultsError:
    """The error for a file that cannot be written."""
    return ResultsError([Problem(str(path), what, remedy=remedy)], "cannot write the results")


def check_target(path: str | Path) -> None:
    """Make sure that a file can be created at ``path``; meant to be called before a long run.

    Raises
    ------
    ResultsError : ``path`` is a folder, its folder is missing, is not a folder or refuses new files.
    """
    target = Path(path)
    if target.is_dir():
        raise unwritable(target, "this is a folder, a file is needed", f"name a file, e.g. {target / 'out.nc'}")
    check_folder(target.parent)


def check_folder(folder: Path) -> None:
    """Make sure that new files can be created in ``folder``.

    Raises
    ------
    ResultsError : missing, not a folder, or not writable.
    """
    if not folder.is_dir():
        what = "this is a file, not a folder" if folder.exists() else "the folder does not exist"
        raise unwritable(folder, what, "create the folder or choose another place")
    try:
        # Trying is the only sure test: permissions do not tell about read-only or full file systems.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise unwritable(
            folder,
            f"no file can be created here: {error.strerror or error}",
            "choose a folder you may write to, with free space",
        ) from error


@contextmanager
def written_whole(path: str | Path) -> Iterator[Path]:
    """Give a temporary file name beside ``path``; rename it to ``path`` when the block ends well.

    On any failure, an interruption included, the temporary file is removed and an existing ``path`` is left
    as it was. The suffix is kept (writers guess formats from it).

    Raises
    ------
    ResultsError : the folder cannot be written to, or the block met an ``OSError`` (e.g. a full disk).
    """
    target = Path(path)
    check_target(target)
    draft = target.with_name(f".{target.stem}-{uuid.uuid4().hex}{target.suffix}")
    try:
        yield draft
        os.replace(draft, target)
    except OSError as error:
        raise unwritable(
            target, f"writing failed: {error.strerror or error}", "check free space and permissions"
        ) from error
    finally:
        draft.unlink(missing_ok=True)
