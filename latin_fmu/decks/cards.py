"""The table of cards of Abaqus and CalculiX: what translates each, or why it is left out or refused.

A card that stands in none of the tables is refused. To translate another one: a function of the deck and the card in
``model_cards``, ``step_cards`` or ``print_cards``, which says what becomes of it, and a row here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from ..mesh_files.deck_card import Card
from . import model_cards, print_cards, reference_nodes, step_cards
from .translation import Translation

Translator = Callable[[Translation, Card], None]


def _mesh(deck: Translation, card: Card) -> None:
    """What ``mesh_files`` has read."""
    deck.used(card, "the mesh, its sets and surfaces")


def _transform(deck: Translation, card: Card) -> None:
    """*TRANSFORM: axes of supports and loads, which look them up."""
    deck.used(card, "axes of the supports and loads of its nodes")


_MESH: Final = (
    *("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SYSTEM", "NGEN", "NFILL", "NCOPY", "ELGEN", "ELCOPY"),
    *("PART", "END PART", "ASSEMBLY", "END ASSEMBLY", "INSTANCE", "END INSTANCE"),
)
_OUTPUTS: Final = (
    *("NODE PRINT", "NODE FILE", "NODE OUTPUT", "EL PRINT", "EL FILE", "ELEMENT OUTPUT"),
    *("CONTACT PRINT", "CONTACT FILE", "CONTACT OUTPUT", "ENERGY OUTPUT"),
)
REFERENCES: Final[Mapping[str, Translator]] = MappingProxyType(
    {
        "RIGID BODY": reference_nodes.rigid_body,
        "COUPLING": reference_nodes.coupling,
        "KINEMATIC": reference_nodes.kinematic,
        "DISTRIBUTING": reference_nodes.distributing,
        "DISTRIBUTING COUPLING": reference_nodes.distributing_coupling,
        "EQUATION": reference_nodes.equation,
        "MPC": reference_nodes.equation,
    }
)
"""Those of reference nodes: loads and supports may stand before them."""
TRANSLATORS: Final[Mapping[str, Translator]] = MappingProxyType(
    {
        **dict.fromkeys(_MESH, _mesh),
        **dict.fromkeys(_OUTPUTS, print_cards.output),
        **dict.fromkeys(step_cards.OTHER_PROCEDURES, step_cards.other_procedure),
        "TRANSFORM": _transform,
        "MATERIAL": model_cards.material,
        "ELASTIC": model_cards.elastic,
        "ORIENTATION": model_cards.orientation,
        "DENSITY": model_cards.density,
        "EXPANSION": model_cards.expansion,
        "DAMPING": model_cards.damping,
        "SOLID SECTION": model_cards.solid_section,
        "SURFACE INTERACTION": model_cards.interaction,
        "FRICTION": model_cards.friction,
        "SURFACE BEHAVIOR": model_cards.behavior,
        "CONTACT PAIR": model_cards.contact_pair,
        "CLEARANCE": model_cards.clearance,
        "TIE": model_cards.tie,
        "PRE-TENSION SECTION": model_cards.pretension,
        "INITIAL CONDITIONS": model_cards.initial_conditions,
        **REFERENCES,
        "STEP": step_cards.step,
        "END STEP": step_cards.end_step,
        "STATIC": step_cards.static,
        "DYNAMIC": step_cards.dynamic,
        "AMPLITUDE": step_cards.amplitude,
        "CLOAD": step_cards.cload,
        "BOUNDARY": step_cards.boundary,
        "DLOAD": step_cards.dload,
        "DSLOAD": step_cards.dsload,
        "TEMPERATURE": step_cards.temperature,
    }
)
"""Function that translates each card."""

_FORMS: Final = "how results are written; those of a run are a .nc file"
_SETTINGS: Final = "settings of another solver"
LEFT_OUT: Final[Mapping[str, str]] = MappingProxyType(
    {
        "HEADING": "a text",
        "PREPRINT": _FORMS,
        "OUTPUT": _FORMS,
        "FILE FORMAT": _FORMS,
        "PRINT": _FORMS,
        "MONITOR": _FORMS,
        "SECTION PRINT": "forces on sections are not in the results; those of interfaces and supports are",
        "TIME POINTS": "instants of results: all are kept",
        "RESTART": "a run is continued from its checkpoint",
        "CONTROLS": _SETTINGS,
        "CONTACT CONTROLS": _SETTINGS,
        "SOLUTION TECHNIQUE": _SETTINGS,
        "SOLVER CONTROLS": _SETTINGS,
        "CONDUCTIVITY": "heat is not computed",
        "SPECIFIC HEAT": "heat is not computed",
        "PHYSICAL CONSTANTS": "no radiation or gravitation between bodies",
        "CONTACT DAMPING": "contacts have no damping of their own, so that motions last longer than in the deck",
        "USER OUTPUT VARIABLES": _FORMS,
    }
)
"""Cards without which the scene is the same, or changes as the text says."""

_PLASTICITY: Final = "materials are elastic here: stresses above yield would be too large"
_THIN: Final = "thin parts are meshed with solids here"
_HEAT: Final = "heat is not computed; temperatures that are known are *TEMPERATURE"
_CHANGES: Final = f"contact that changes from step to step: {model_cards.APART}"
_JOINTS: Final = "write the mesh of a scene with [spring.NAME] or [point_mass.NAME]"
REFUSED: Final[Mapping[str, str]] = MappingProxyType(
    {
        "PLASTIC": _PLASTICITY,
        "CYCLIC HARDENING": _PLASTICITY,
        "DEFORMATION PLASTICITY": _PLASTICITY,
        "CREEP": _PLASTICITY,
        "VISCO": _PLASTICITY,
        "MOHR COULOMB": _PLASTICITY,
        "MOHR COULOMB HARDENING": _PLASTICITY,
        "HYPERELASTIC": "large strains are not computed",
        "HYPERFOAM": "large strains are not computed",
        "USER MATERIAL": "materials of a user subroutine",
        "SHELL SECTION": _THIN,
        "MEMBRANE SECTION": _THIN,
        "BEAM SECTION": _THIN,
        "BEAM GENERAL SECTION": _THIN,
        "FLUID SECTION": "networks of fluids are not computed",
        "HEAT TRANSFER": _HEAT,
        "COUPLED TEMPERATURE-DISPLACEMENT": _HEAT,
        "UNCOUPLED TEMPERATURE-DISPLACEMENT": _HEAT,
        "CFLUX": _HEAT,
        "DFLUX": _HEAT,
        "FILM": _HEAT,
        "RADIATE": _HEAT,
        "CYCLIC SYMMETRY MODEL": "sectors of a cyclic structure are not joined here",
        "SELECT CYCLIC SYMMETRY MODES": "sectors of a cyclic structure are not joined here",
        "SENSITIVITY": "derivatives are those of output.sensitivities of a scene",
        "DESIGN VARIABLES": "derivatives are those of output.sensitivities of a scene",
        "OBJECTIVE": "derivatives are those of output.sensitivities of a scene",
        "MODEL CHANGE": _CHANGES,
        "CHANGE FRICTION": _CHANGES,
        "CHANGE SURFACE BEHAVIOR": _CHANGES,
        "CHANGE CONTACT TYPE": _CHANGES,
        "MASS": _JOINTS,
        "SPRING": _JOINTS,
        "DASHPOT": _JOINTS,
        "GAP": _JOINTS,
        "SUBMODEL": "motions from the results of another analysis",
    }
)
"""Cards without which the answer would be another one, and the reason."""


def translate(deck: Translation) -> None:
    """Translate all cards of a deck: each is used, left out or refused."""
    first = next((i for i, card in enumerate(deck.model.cards) if card.keyword == "STEP"), len(deck.model.cards))
    model, steps = deck.model.cards[:first], deck.model.cards[first:]
    # pairs may stand before the laws that they name
    pairs = [card for card in model if card.keyword == "CONTACT PAIR"]
    references = [card for card in model if card.keyword in REFERENCES]
    others = [card for card in model if card.keyword != "CONTACT PAIR" and card.keyword not in REFERENCES]
    for card in [*references, *others, *pairs, *steps]:
        translator = TRANSLATORS.get(card.keyword)
        if translator is not None:
            translator(deck, card)
        elif card.keyword in LEFT_OUT:
            deck.left_out(card, LEFT_OUT[card.keyword])
        else:
            deck.refuse(card, REFUSED.get(card.keyword, "this card is not translated"))
