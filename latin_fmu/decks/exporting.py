"""A scene as a deck of CalculiX: its text, and a summary with a line for each table and for what is left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from ..assembly.problem import DiscretisedProblem
from ..building import discretise
from ..errors import InputError
from ..fem.mesh import Index
from ..scene.schema import Scene
from .card_text import card
from .deck_mesh import NumberedMesh
from .export_draft import DeckChoices, DeckDraft, TableUse
from .export_keys import check_keys
from .export_model import bolt_cards, initial_cards, interface_cards, material_cards, mesh_cards
from .export_steps import DeckPlan, amplitude_cards, has_steps_before, load_sets, sensor_cards, step_cards
from .export_supports import driven_sets, support_cards
from .translation import LEFT_OUT

_HEADING: Final = "the scene cannot be written as a deck"
_DEFAULT: Final = DeckChoices()
_TABLES: Final = ("material", "substructure", "interface", "bolt", "load", "sensor")


@dataclass(frozen=True)
class ExportedDeck:
    """A scene as a deck.

    Attributes
    ----------
    model : cards before the steps, a text. steps : the steps. uses : a line for each table and each key left out.
    nodes : numbers (n_node,) of the nodes of each body. pairs : slave and master surface by interface. bolts : number
    of the node of each section.
    """

    model: str
    steps: str
    uses: tuple[TableUse, ...]
    nodes: Mapping[str, Index]
    pairs: Mapping[str, tuple[str, str]]
    bolts: Mapping[str, int]

    @property
    def text(self) -> str:
        """Model and steps in one text."""
        return self.model + self.steps

    def summary(self) -> list[str]:
        """Lines for a user: what is used, then what is left out and what that changes."""
        late = sorted(self.uses, key=lambda one: one.verdict == LEFT_OUT)
        return list(dict.fromkeys(one.line for one in late))


def export_deck(
    scene: Scene | DiscretisedProblem, choices: DeckChoices = _DEFAULT, nodes: Mapping[str, Index] | None = None
) -> ExportedDeck:
    """The deck of a scene, in its units.

    Parameters
    ----------
    scene : or the problem that it was discretised to. choices : what a scene leaves open. nodes : numbers, from 1, of
        the nodes of each body, in the place of interfaces: nodes of one number are one.

    Raises
    ------
    InputError : tables and keys that no card says, all at once.
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/pressed_plates/scene.toml")
    >>> deck = export_deck(scene)
    >>> deck.summary()[-1]
    'left out: solver: a setting of this program'
    >>> deck.text.count("*CONTACT PAIR")
    7
    """
    ready = scene
    if isinstance(scene, Scene):
        ready = discretise(scene)
    assert isinstance(ready, DiscretisedProblem)
    deck = DeckDraft(ready, NumberedMesh.of(ready.bodies, nodes), choices, bonded=nodes is not None)
    _check(deck)
    model = list(_model(deck))
    if deck.problems:
        # steps name what the model has
        raise InputError(deck.problems, _HEADING)
    acting, sets = load_sets(deck)
    plan = DeckPlan(acting, list(driven_sets(deck)))
    sensors = list(sensor_cards(deck))
    lines = [*model, *sets, *sensors, *amplitude_cards(deck, plan), *initial_cards(deck)]
    steps = list(step_cards(deck, plan))
    if deck.problems:
        raise InputError(deck.problems, _HEADING)
    head = [*_heading(deck), *(f"** {one.line}" for one in deck.uses if one.verdict == LEFT_OUT)]
    model_text, step_text = ("\n".join(part) + "\n" for part in ([*head, *lines], steps))
    return ExportedDeck(model_text, step_text, tuple(deck.uses), deck.mesh.nodes, dict(deck.pairs), dict(deck.bolts))


def _check(deck: DeckDraft) -> None:
    """Say what becomes of each key of the scene that is not written."""
    scene = deck.scene
    check_keys(deck, "scene", "", scene)
    check_keys(deck, "output", "output", scene.output)
    for kind in _TABLES:
        tables: Mapping[str, Any] = getattr(scene, kind)
        for name, table in tables.items():
            check_keys(deck, kind, f"{kind}.{name}", table)
    if deck.ready.untouched is not None:
        deck.left_out("substructure", "bodies that are never touched are not in the deck")


def _heading(deck: DeckDraft) -> Iterator[str]:
    text = " ".join((deck.scene.description or deck.scene.name).split())
    yield from card("HEADING", rows=[(text,)])
    yield f"** Written by latin-fmu export --deck from the scene {deck.scene.name}; units: {deck.scene.units}"


def _model(deck: DeckDraft) -> Iterator[str]:
    """Cards of the model; sets of sensors come later, so that names of supports and bolts stay as they are."""
    yield from mesh_cards(deck)
    if deck.problems:
        # without elements there is nothing to name
        return
    yield from material_cards(deck)
    yield from bolt_cards(deck)
    yield from support_cards(deck, has_steps_before(deck))
    yield from interface_cards(deck)
