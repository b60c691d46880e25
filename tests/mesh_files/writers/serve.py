"""Runs in the environment of a program: ``python -m writers.serve MODULE FOLDER`` writes every solid of the folder in
every format of the program, each in a process of its own, and says to ``written.json`` what came out."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import shutil
import sys
import traceback
from importlib.metadata import version
from pathlib import Path
from typing import Any

from .solid import Format, Solid

LONGEST = 60  # seconds for a file


def one(module: Any, solid: Solid, form: Format, path: Path) -> str:
    """Write a file in a process of its own; what went wrong, else empty."""
    reason = path.with_name("reason.txt")
    child = os.fork()
    if not child:
        code = 1
        with contextlib.suppress(BaseException):
            import signal

            signal.alarm(LONGEST)
            quiet = os.open(os.devnull if "-v" not in sys.argv else "/dev/stderr", os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            try:
                module.write(solid, form, path)
                code = 0
            except BaseException as error:
                traceback.print_exc()
                reason.write_text(f"{type(error).__name__}: {' '.join(str(error).split())[:160]}")
        os._exit(code)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return f"ends with signal {os.WTERMSIG(status)}"
    said = reason.read_text() if reason.exists() else ""
    if os.WEXITSTATUS(status):
        return said or "ends with an error"
    return "" if path.exists() and path.stat().st_size else said or "no file"


def main(name: str, folder: Path, only: str = "") -> None:
    """Every file of a program."""
    module = importlib.import_module(f"{__package__}.{name}")
    found: dict[str, Any] = {"title": module.TITLE, "version": _version(module), "formats": []}
    for label, form in module.FORMATS.items():
        if only and only != label:
            continue
        row: dict[str, Any] = {"label": label, **form.__dict__, "files": {}}
        del row["option"]
        for source in sorted(folder.glob("*.npz")):
            if form.own != source.stem.startswith("own"):
                continue
            place = folder / name / label.replace(" ", "_").replace(",", "") / source.stem
            shutil.rmtree(place, ignore_errors=True)  # some programs ask before they write over a file
            place.mkdir(parents=True)
            path = place / f"solid{form.suffix}"
            said = one(module, Solid.load(source), form, path)
            row["files"][source.stem] = [str(path.relative_to(folder)), said]
        found["formats"].append(row)
    (folder / f"{name}.json").write_text(json.dumps(found, indent=1))


def _version(module: Any) -> str:
    return str(module.version() if hasattr(module, "version") else version(module.PACKAGE))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *[a for a in sys.argv[3:] if a != "-v"])
