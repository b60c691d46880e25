"""``latin-fmu import``: a deck of Abaqus or CalculiX as a scene; ``latin-fmu export --deck``: a scene as a deck."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ..errors import InputError
from . import CONVERGED, output_file, say
from .options import Argument, Option, command

if TYPE_CHECKING:
    from ..decks.importing import ImportedDeck
    from ..decks.print_cards import DeckPrints
    from ..results.solution import Solution

Units = Annotated[
    Literal["mm-t-s", "m", "in", "none"] | None,
    Option("units of a deck: mm, t, s, MPa; m, kg, s, Pa; in, lbf, s, psi (default: by its modulus and density)"),
]
_UNWRITTEN = "the deck is not written"
_EXAMPLES = """\
examples:
  latin-fmu import bracket.inp
  latin-fmu import bracket.inp -o bracket.toml --units mm-t-s
  latin-fmu run bracket.inp                 the same, and a run
"""


@command(_EXAMPLES)
def import_(
    file: Annotated[Path, Argument("deck of Abaqus or CalculiX (.inp)", "DECK.inp")],
    output: Annotated[
        Path | None,
        Option("scene file (default: name of the deck, in the current folder)", "NAME.toml", "-o", output_file),
    ] = None,
    units: Units = None,
) -> int:
    """Write a deck as a scene, and say of each card what becomes of it."""
    target = output or Path(f"{file.stem}.toml")
    imported = scene_of_deck(file, target, units, replace=output is not None)
    print("\n".join([*imported.summary(), f"scene: {target}"]))
    return CONVERGED


def scene_of_deck(file: Path, target: Path, units: str | None, replace: bool = False) -> ImportedDeck:
    """Write the scene of a deck to a file, and check it; ``replace`` : a file with another text that is there.

    Raises
    ------
    InputError : the deck or its scene is refused; ``target`` is there and has another text.
    """
    from ..decks.importing import import_deck
    from ..reader import scene_from_dict
    from ..results.writing import check_target, write_bytes

    check_target(target)
    imported = import_deck(file, target.parent, units)  # type: ignore[arg-type]
    scene_from_dict(dict(imported.tables), target.parent)
    text = imported.text()
    if target.is_file() and not replace and target.read_text(encoding="utf-8") != text:
        what = "this file is there, and is not what the deck becomes: it may hold your changes"
        remedy = f"run it as it is, remove it, or name another file: latin-fmu import {file} -o NAME.toml"
        raise InputError.of("the scene is not written", str(target), what, remedy=remedy)
    write_bytes(target, text.encode())
    return imported


def deck_of_scene(file: Path, output: Path | None) -> int:
    """Write a scene as a deck, and say of each table what becomes of it.

    Raises
    ------
    InputError : tables that no card says; the deck is there with another text and was not named, or is a mesh of the
        scene.
    """
    from ..decks.exporting import export_deck
    from ..reader import load_scene
    from ..results.writing import check_target, write_bytes

    target = check_target(output or Path(f"{file.stem}.inp"))
    scene = load_scene(file)
    meshes = [body.mesh.file for body in scene.substructure.values() if body.mesh is not None]
    if any(target.resolve() == (scene.base_dir / mesh).resolve() for mesh in meshes):
        what, remedy = "this is a mesh of the scene", "name another file: -o NAME.inp"
        raise InputError.of(_UNWRITTEN, str(target), what, remedy=remedy)
    exported = export_deck(scene)
    if output is None and target.is_file() and target.read_text(encoding="utf-8", errors="replace") != exported.text:
        what = "this file is there, and is not what the scene becomes"
        raise InputError.of(_UNWRITTEN, str(target), what, remedy="remove it, or name it: -o NAME.inp")
    write_bytes(target, exported.text.encode())
    print("\n".join([*exported.summary(), f"deck: {target}"]))
    return CONVERGED


def is_deck_file(file: Path) -> bool:
    """Whether the argument of a command is a deck and no scene."""
    if file.suffix.lower() == ".toml":
        return False
    from ..decks.importing import is_deck

    return is_deck(file)


def told_scene(file: Path, units: str | None, quiet: bool = False) -> tuple[Path, ImportedDeck]:
    """The scene file of a deck beside the results of a run, in the current folder, and what the deck says; its summary
    goes to stderr."""
    target = Path(f"{file.stem}.toml")
    imported = scene_of_deck(file, target, units)
    if not quiet:
        say("\n".join([*imported.summary(), f"scene: {target}", ""]))
    return target, imported


def exact_lines(imported: ImportedDeck, solution: Solution, folder: Path) -> list[str]:
    """What the penalty of a deck costs, by a second run without it; ``folder`` : of the scene."""
    from .. import api
    from ..decks.exact import penalty_error, without_penalty
    from ..reader import scene_from_dict

    tables = without_penalty(imported.tables)
    if tables is None:
        return ["the deck has no penalty: contact is exact"]
    exact = api.solve(scene_from_dict(tables, folder))
    if not (exact.trustworthy and solution.trustworthy):
        return [f"error of the penalty: not known, without it the run has not succeeded: {exact.status}"]
    return ["error of the penalty (with it, and with exact contact):", *penalty_error(imported.prints, solution, exact)]


def write_printed(imported: ImportedDeck, solution: Solution, results: Path) -> list[Path]:
    """Write what a deck prints and files as CalculiX does, under the name of the results; the files that were written.

    Raises
    ------
    UnwrittenError : the file cannot be written.
    """
    from ..decks.printed import printed_text
    from ..results.writing import FILED, PRINTED, write_bytes, write_whole

    prints, made = imported.prints, []
    if any(True for _ in prints.printed()):
        made.append(results.with_suffix(PRINTED))
        write_bytes(made[-1], printed_text(prints, solution).encode())
    if any(prints.filed(instant) for instant in prints.instants):
        made.append(results.with_suffix(FILED))
        write_whole(made[-1], lambda draft: _file(prints, solution, draft))
    return made


def _file(prints: DeckPrints, solution: Solution, draft: Path) -> None:
    """Write the fields piece by piece: they may be large."""
    from ..decks.filed import filed_text

    with draft.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(filed_text(prints, solution))
