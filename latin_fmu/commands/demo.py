"""``latin-fmu demo``: list the models that come with the package, or copy one into the current folder."""

from __future__ import annotations

import argparse
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ..errors import InputError, did_you_mean, listed
from . import CONVERGED, AddParser, declare

_EXAMPLES = """\
examples:
  latin-fmu demo                    the models, one a line
  latin-fmu demo hammer_on_plate    copies the folder, and prints the commands that solve and draw it
"""
_ROW: Final = re.compile(r"\| `(\w+)` \| (.+?) \| (.+?) \| (.+?) \|")
_UNAVAILABLE: Final = "../../"  # links of a README to files that are not copied
_HEADING: Final = "the model cannot be copied"


@dataclass(frozen=True)
class _Model:
    """A row of the table of models.

    Attributes
    ----------
    name : of the folder. shows : what it is for. size : nodes and time steps of its first scene. cpu : time of a run.
    """

    name: str
    shows: str
    size: str
    cpu: str


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    parser = declare(add, "demo", "list the models that come with the package, or copy one", _demo, _EXAMPLES)
    parser.add_argument("name", metavar="NAME", nargs="?", help="model to copy into the current folder")


def _demo(arguments: argparse.Namespace) -> int:
    folder = models_folder()
    if arguments.name is None:
        print("\n".join(_list(_models(folder))))
    else:
        print("\n".join(_copy(folder, arguments.name)))
    return CONVERGED


def models_folder() -> Path:
    """Folder of the models: inside the installed package, beside the package in a source tree.

    Raises
    ------
    InputError : the installation has none.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "models", package.parent / "models"):
        if (folder / "README.md").is_file():
            return folder
    what, remedy = "this installation of latin-fmu has no models", "install it from a wheel or from its repository"
    raise InputError.of(_HEADING, str(package / "models"), what, remedy=remedy)


def _models(folder: Path) -> list[_Model]:
    """Rows of the table in the README of the models."""
    rows = map(_ROW.fullmatch, (folder / "README.md").read_text(encoding="utf-8").splitlines())
    return [_Model(*row.groups()) for row in rows if row is not None]


def _list(models: list[_Model]) -> list[str]:
    """Table of the models, and how to copy one."""
    from ..results.summary import aligned

    rows = [("model", "nodes, steps", "CPU"), *((m.name, m.size, m.cpu) for m in models)]
    texts = ("shows", *(m.shows for m in models))
    table = [f"{line}  {text}" for line, text in zip(aligned(rows), texts, strict=True)]
    return [*table, "", "copy one into the current folder: latin-fmu demo NAME"]


def _copy(folder: Path, name: str) -> list[str]:
    """Copy a model into the current folder, whole or not at all; the text on what to do next.

    Raises
    ------
    InputError : there is no such model, or its place is taken. ResultsError : the place cannot be written to.
    """
    from ..results.writing import check_folder, write_whole

    known = [model.name for model in _models(folder)]
    if name not in known:
        raise InputError.of(_HEADING, "NAME", "no model of this name", name, listed(known), did_you_mean(name, known))

    def check(path: str | Path) -> Path:
        target = Path(path)
        if os.path.lexists(target):
            what, remedy = "this is there already", "remove or rename it, or change to another folder"
            raise InputError.of(_HEADING, str(target), what, remedy=remedy)
        check_folder(target.absolute().parent)
        return target

    target = check(name)
    write_whole(target, lambda draft: _fill(draft, folder / name), check, rescue=False)
    scenes = sorted(target.glob("*.toml"), key=lambda path: (path.stem != "scene", path.stem))
    others = [f"other scenes: {', '.join(map(str, scenes[1:]))}"] if scenes[1:] else []
    return [
        f"copied to {target}{os.sep}: {', '.join(sorted(path.name for path in target.iterdir()))}",
        *others,
        "next:",
        f"  latin-fmu run {scenes[0]} -o {name}.nc",
        f"  latin-fmu plot {name}.nc -o {name}.png",
    ]


def _fill(draft: Path, source: Path) -> None:
    """Copy the files of a model; its README names the paths of the copy."""
    draft.mkdir()
    for file in sorted(path for path in source.iterdir() if path.is_file()):
        if file.suffix == ".md":
            lines = file.read_text(encoding="utf-8").replace(f"models/{source.name}/", f"{source.name}/").splitlines()
            kept = (line for line in lines if _UNAVAILABLE not in line)
            (draft / file.name).write_text("\n".join(kept) + "\n", encoding="utf-8")
        else:
            shutil.copyfile(file, draft / file.name)
