"""Which keys each interface behaviour takes, which it needs, and what follows between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from ..errors import Problem, shown
from .raw_scene import RawTable, given, number

# Keys of an interface that only some behaviours take.
TAKES: Final[Mapping[str, tuple[str, ...]]] = {
    "perfect": (),
    "contact": ("friction_coefficient", "gap", "preload", "preload_force"),
    "no_slip": ("gap", "preload", "preload_force"),
    "elastic_layer": ("normal_stiffness", "tangential_stiffness", "preload", "preload_force"),
    "soft_contact": ("normal_stiffness", "friction_coefficient", "gap", "preload", "preload_force", "interference"),
    "viscous_joint": ("normal_viscosity", "tangential_viscosity"),
}
BEHAVIOUR_NAMES: Final = tuple(sorted(TAKES))
NEEDS: Final[Mapping[str, tuple[str, ...]]] = {
    "elastic_layer": ("normal_stiffness", "tangential_stiffness"),
    "soft_contact": ("normal_stiffness",),
    "viscous_joint": ("normal_viscosity", "tangential_viscosity"),
}
PARAMETERS: Final[tuple[str, ...]] = (
    "friction_coefficient",
    "normal_stiffness",
    "tangential_stiffness",
    "normal_viscosity",
    "tangential_viscosity",
)
_ALL: Final = tuple(dict.fromkeys(key for keys in TAKES.values() for key in keys))
MEANINGLESS: Final[Mapping[str, tuple[str, ...]]] = {
    name: tuple(key for key in _ALL if key not in keys) for name, keys in TAKES.items()
}
_PRESSED: Final = ("preload", "preload_force", "interference")


def key_problems(where: str, table: RawTable, behaviour: str) -> Iterator[Problem]:
    """Keys that mean nothing with this behaviour, and those that are missing."""
    kind = "a perfect connection" if behaviour == "perfect" else f'behaviour = "{behaviour}"'
    for key in MEANINGLESS.get(behaviour, ()):
        if given(table, key):
            taking = " or ".join(f'"{name}"' for name, keys in TAKES.items() if key in keys)
            yield Problem(
                f"{where}.{key}",
                f"{key!r} means nothing on {kind}",
                shown(table[key]),
                None,
                f"remove it, or choose behaviour = {taking}",
            )
    for key in NEEDS.get(behaviour, ()):
        if not given(table, key):
            yield Problem(f"{where}.{key}", f"missing: {kind} needs it", None, "a number >= 0")
    yield from _value_problems(where, table, behaviour)


def _value_problems(where: str, table: RawTable, behaviour: str) -> Iterator[Problem]:
    pressed = [key for key in _PRESSED if (number(table, key) or 0.0) > 0.0 and key in TAKES.get(behaviour, ())]
    if len(pressed) > 1:
        yield Problem(f"{where}.{pressed[1]}", f"given together with {pressed[0]!r}", None, "one of them")
    gap = number(table, "gap")
    for key in pressed[:1]:
        if gap is not None and gap > 0.0:
            yield Problem(
                f"{where}.{key}",
                "an open interface carries no preload",
                f"{number(table, key):g} with gap = {gap:g}",
                f"{key} > 0 only where gap = 0",
                "set gap = 0 or remove the preload",
            )
    if number(table, "normal_stiffness") != 0.0:
        return
    if behaviour == "soft_contact" or (behaviour == "elastic_layer" and pressed):
        what = "no force can be carried" if behaviour == "soft_contact" else "nothing holds the preload"
        yield Problem(f"{where}.normal_stiffness", what, "0", "> 0")
