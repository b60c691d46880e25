"""The keys of a scene that a deck cannot say: what is left out with its consequence, and what is refused.

Keys that stand in no table here are written. A key of a scene that none of the modules of the export knows is refused
by ``tests/decks/test_export.py``, which holds the table against the scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

from pydantic import BaseModel

from .export_draft import DeckDraft

_NONE: Final[Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True)
class TableKeys:
    """Keys of one kind of tables.

    Attributes
    ----------
    written : that become cards. left_out : consequence by key. refused : reason by key.
    """

    written: tuple[str, ...]
    left_out: Mapping[str, str] = field(default_factory=lambda: _NONE)
    refused: Mapping[str, str] = field(default_factory=lambda: _NONE)


_JUDGED: Final = "stresses and margins of the screw are judged here alone"
_OTHER_PROGRAM: Final = "a setting of this program"
_NO_CARD: Final = "no card says this"
_START: Final = "bodies start at rest, or with one velocity of all their nodes"
_OTHER_SIDE: Final = "what comes from outside, or goes there, has no card"
KEYS: Final[Mapping[str, TableKeys]] = MappingProxyType(
    {
        "scene": TableKeys(
            (
                *(
                    "name",
                    "description",
                    "material",
                    "mesh",
                    "substructure",
                    "damping",
                    "interface",
                    "contact",
                    "boundary",
                ),
                *("load", "gravity", "rotation", "temperature", "bolt", "sensor", "time", "output"),
            ),
            {
                "units": "a deck has none: give them when it is read, latin-fmu import --units",
                "limit": "the run is judged here alone",
                "solver": _OTHER_PROGRAM,
                "accuracy": _OTHER_PROGRAM,
                "effects": _OTHER_PROGRAM,
                "fmu": _OTHER_PROGRAM,
                "spread": "numbers of a deck do not scatter",
            },
            {
                "point_mass": "masses at points are not written",
                "spring": "springs and dashpots are not written",
                "coupling": "couplings are not written",
                "port": _OTHER_SIDE,
                "motion": "a velocity that supports share",
                "initial_state": "a state of an earlier run",
            },
        ),
        "material": TableKeys(
            (
                *("young_modulus", "poisson_ratio", "orthotropic", "thermal_expansion", "density", "rayleigh_mass"),
                *("rayleigh_stiffness", "frame", "loss_factor", "at_frequency", "damping_ratios"),
            ),
            {"yield_stress": "stresses are judged here alone"},
        ),
        "substructure": TableKeys(
            (
                *("material", "box", "mesh", "rigid", "bending_modes", "reduced_integration", "uniform_strain"),
                *("initial_velocity", "body_force", "body_force_law"),
            ),
            {"modal_damping": "motions go on longer in the deck"},
            {
                "initial_spin": _START,
                "initial_displacement": _START,
                "initial_velocity_gradient": _START,
                "initial_displacement_gradient": _START,
                "initial_velocity_field": _START,
                "initial_displacement_field": _START,
            },
        ),
        "interface": TableKeys(
            (
                *(
                    "sides",
                    "behaviour",
                    "friction_coefficient",
                    "normal_stiffness",
                    "tangential_stiffness",
                    "search",
                    "gap",
                ),
                *("overlap", "points_from"),
            ),
            {
                "points_at": "contact is at all nodes of the facets in the deck",
                "damping_ratios": "the layer loses no energy in the deck",
            },
            {
                "ground": _NO_CARD,
                "ground_velocity": _NO_CARD,
                "interference": "an overlap that the meshes have not",
                "form": "a form that the meshes have not",
                "preload": "a pressure that is there at the start; press the faces by bolts or loads",
                "preload_force": "a force that is there at the start; press the faces by bolts or loads",
                "relaxation_time": _NO_CARD,
                "normal_viscosity": _NO_CARD,
                "tangential_viscosity": _NO_CARD,
            },
        ),
        "bolt": TableKeys(
            (
                *(
                    "substructure",
                    "axis",
                    "force",
                    "torque",
                    "diameter",
                    "nut_factor",
                    "thread_friction",
                    "head_friction",
                ),
                *("head_bearing", "shortening", "point", "order", "parts", "thread", "share", "shank"),
            ),
            {
                "property_class": _JUDGED,
                "nut_bearing": _JUDGED,
                "permissible_pressure": _JUDGED,
                "clamp_length": _JUDGED,
                "rolled": _JUDGED,
            },
            {"hardening": "a shank that yields"},
        ),
        "load": TableKeys(("face", "pressure", "traction", "force", "moment", "point", "nodal_force", "axes", "law")),
        "sensor": TableKeys(
            ("substructure", "point"),
            {
                "face": "the mean over a face is not printed",
                "filter": "the deck prints unfiltered motions",
                "spectrum": "no spectra are in a deck",
            },
        ),
        "output": TableKeys(
            ("fields", "stress", "nodal_stress", "strain", "energy", "surfaces", "reactions"),
            {
                "principal_stress": "cgx has them",
                "every": "all increments are printed",
                "interfaces_every": "all increments are printed",
                "sensitivities": "no derivatives are in a deck",
                "check_sensitivities": "no derivatives are in a deck",
                "peak_duration": "peaks are judged here alone",
                "acceleration": "numbers are in the units of the scene",
            },
        ),
    }
)
"""Keys by kind of table."""


def keys_given(table: BaseModel) -> Iterator[str]:
    """Keys of a table that are not at their default."""
    for key, described in type(table).model_fields.items():
        value = getattr(table, key)
        if value != described.get_default(call_default_factory=True) and value != {}:
            yield key


def check_keys(deck: DeckDraft, kind: str, where: str, table: BaseModel) -> None:
    """Say of each key of a table that is not written what becomes of it."""
    keys = KEYS[kind]
    for key in keys_given(table):
        place = ".".join(part for part in (where, key) if part)
        if key in keys.left_out:
            deck.left_out(place, keys.left_out[key])
        elif key in keys.refused:
            deck.refuse(place, keys.refused[key], _shown(getattr(table, key)))
        elif key not in keys.written:
            deck.refuse(place, _NO_CARD, _shown(getattr(table, key)))


def _shown(value: Any) -> str | None:
    """A value in a message: names of tables, or a short text."""
    if isinstance(value, Mapping):
        return ", ".join(map(str, value))
    if isinstance(value, BaseModel):
        return None
    return str(value)
