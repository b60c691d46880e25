"""A deck of Abaqus or CalculiX as a scene: its tables, its text, and a summary with a line for each card."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ..errors import InputError, MeshError, Problem
from ..mesh_files.abaqus_cards import is_abaqus
from ..mesh_files.adjusted_nodes import adjusted, has_adjusted
from ..mesh_files.content import MeshContent
from ..mesh_files.deck_card import FileLine
from ..mesh_files.reading import read_content
from ..scene.schema import toml_text
from ..scene.substructures import part_name
from ..scene.units import UNIT_SYSTEMS
from .assembling import add_bodies, add_bolts, add_loads, add_time
from .cards import translate
from .print_cards import DeckPrints, prints_of
from .step_cards import steps_of
from .translation import LEFT_OUT, USED, CardUse, Translation
from .units import UnitsOption, units_of

_ORDER: Final = (
    *("material", "mesh", "substructure", "interface", "contact", "coupling", "bolt", "boundary", "load", "gravity"),
    *("rotation", "temperature", "time", "solver", "sensor", "output"),
)
_HEADING: Final = "the deck cannot be translated"
_MOST_LINES: Final = 6  # of a file that a line of the summary lists
_WIDTH: Final = 118  # of a comment
WRITTEN: Final = "# Written by latin-fmu import from "
"""Begins the second line of a scene that was made from a deck."""


@dataclass(frozen=True)
class ImportedDeck:
    """A deck as a scene.

    Attributes
    ----------
    tables : the scene, of the shape of its file. uses : a line for each card. units : the sentence on units. prints :
    what the deck prints of a run.
    """

    deck: str
    tables: Mapping[str, Any]
    uses: tuple[CardUse, ...]
    units: str
    prints: DeckPrints

    def summary(self) -> list[str]:
        """Lines for a user: units first, what is used, what is left out and what that changes."""
        return [self.units, *self._lines()]

    def text(self) -> str:
        """The scene as TOML, the summary in its head as comments."""
        head = [f"# {self.units}.", f"{WRITTEN}{self.deck}.", "#"]
        head += [part for line in self._lines() for part in _comment(line)]
        return "\n".join(head) + "\n\n" + toml_text(self.tables)

    def _lines(self) -> Iterator[str]:
        """One line for all cards of one keyword that become the same."""
        for verdict, title in ((USED, "used"), (LEFT_OUT, "left out")):
            grouped: dict[tuple[str, str], dict[str, None]] = {}
            for use in self.uses:
                if use.verdict == verdict:
                    place = str(use.place.line)
                    if use.place.where != self.deck:
                        place = f"{use.place.line} of {use.place.where.removeprefix(self.deck + ', in ')}"
                    grouped.setdefault((use.keyword, use.text), {})[place] = None
            for (keyword, text), places in grouped.items():
                yield f"{title}: *{keyword} ({_placed(list(places))}): {text}"


def is_deck(path: Path) -> bool:
    """Whether a file is a deck and no scene, by its first keyword."""
    try:
        if not path.is_file():
            return False
        with path.open(encoding="utf-8", errors="replace") as file:
            return is_abaqus(file.read(20_000))
    except (OSError, ValueError):  # a name that the system refuses
        return False


def import_deck(path: str | Path, folder: str | Path | None = None, units: UnitsOption | None = None) -> ImportedDeck:
    """The scene that a deck describes.

    Parameters
    ----------
    path : of the deck. folder : that the scene stands in, to which the path of its mesh is relative; that of the deck
        where None. units : of the deck; guessed from modulus and density where None.

    Raises
    ------
    InputError : cards without which the scene would be another one, each with its line; units that are not known.
    MeshError : a mesh that cannot be read.

    Examples
    --------
    >>> import latin_fmu
    >>> deck = import_deck("tests/decks/pressed.inp")
    >>> deck.summary()[0]
    'Units mm, t, s, MPa: guessed from the modulus 210000 and the density 7.8e-09 of STEEL'
    >>> latin_fmu.scene_from_dict(deck.tables, "tests/decks").name
    'pressed'
    """
    file = Path(path)
    content = read_content(file)
    content.refuse()
    moved = has_adjusted(content)
    if moved:
        content = adjusted(content)
    if content.deck is None:
        raise InputError.of(_HEADING, file.name, "not a deck of Abaqus or CalculiX", remedy="name a .inp file")
    parts = _parts(content, file)
    system, sentence = units_of(units, _spelled_materials(content), file.name)
    deck = Translation(content, parts, steps_of(content.deck.cards))
    translate(deck)
    if not any(step.procedure is not None for step in deck.steps) and not deck.problems:
        deck.problems.append(Problem(file.name, "no step with *STATIC or *DYNAMIC: nothing to run"))
    if deck.problems:
        raise InputError(deck.problems, _HEADING)
    # of a modulus over a density and a squared speed in m/s
    speed = UNIT_SYSTEMS[system].size("m s-1") if UNIT_SYSTEMS[system].measurable else 1.0
    add_bodies(deck, speed**2)
    add_bolts(deck)
    axis = add_time(deck)
    add_loads(deck, axis)
    if deck.problems:
        raise InputError(deck.problems, _HEADING)
    where = os.path.relpath(file.resolve(), Path(folder if folder is not None else file.parent).resolve())
    mesh: dict[str, Any] = {"file": Path(where).as_posix(), "mesh_only": True, "parts": list(parts)}
    if moved:
        mesh["adjust"] = True
    if deck.single:
        mesh["points"] = sorted(deck.single)
    deck.tables["mesh"] = {part_name(file.stem): mesh}
    tables = {"name": part_name(file.stem), **_head(deck), "units": system}
    tables |= {key: deck.tables[key] for key in _ORDER if deck.tables.get(key)}
    return ImportedDeck(file.name, tables, tuple(deck.uses), sentence, prints_of(deck, axis.origin))


def _head(deck: Translation) -> dict[str, Any]:
    """The heading of the deck as the description of the scene."""
    for card in deck.model.cards:
        text = " ".join(" ".join(row.split()) for row in card.rows)
        if card.keyword == "HEADING" and text:
            return {"description": text[:500]}
    return {}


def _spelled_materials(content: MeshContent) -> dict[str, dict[str, float]]:
    """Constants of the materials of the deck that some section has; of all where none has any."""
    assert content.deck is not None
    named = {material for _, material in content.deck.sections}
    found = {name: constants for name, constants in content.deck.materials.items() if name in named}
    return found or content.deck.materials


def _parts(content: MeshContent, file: Path) -> dict[str, str]:
    """Names of substructures by volume group."""
    if not content.solids:
        assert content.deck is not None
        name, place = next(iter(content.deck.element_types.items()), ("no elements", FileLine(file.name, 1)))
        where = f"{place.where}, line {place.line}"
        raise MeshError.of(_HEADING, where, "the deck holds no solid elements", name, remedy="mesh it with solids")
    names = {group: part_name(group) for group in content.part_names(file.name)}
    if not names or len(set(names.values())) < len(names):
        what = "no element sets that are parts, or two of one name"
        raise InputError.of(_HEADING, file.name, what, remedy="give each body an ELSET with a *SOLID SECTION")
    return names


def _placed(places: list[str]) -> str:
    """Lines of a file in words."""
    shown = ", ".join(places[:_MOST_LINES])
    if len(places) > _MOST_LINES:
        shown += f", ... {len(places)} cards"
    return f"line{'s' * (len(places) > 1)} {shown}"


def _comment(line: str) -> Iterator[str]:
    """A line as comments of a file that is read."""
    words = line.split()
    row = "#"
    for word in words:
        if len(row) + 1 + len(word) > _WIDTH:
            yield row
            row = "#  "
        row += f" {word}"
    yield row
