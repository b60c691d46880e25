"""Values with units in a scene as written: texts such as "5.5 N m" become numbers in the units of the scene.

The unit of a key is the one that its table declares; ``g`` is gravity or gram by that. A text that does not begin like
a number stays as it is, for the check of its field.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..errors import did_you_mean, shown
from .describe import allowed_text, is_named, kind_of, tables_in, tag_of, unit_of
from .unit_texts import begins_as_number, names_for, si_unit, unit_size, value_and_unit, words_for
from .units import UnitSystem

_REAL: Final = re.compile("number")
Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Misfit:
    """A text that is no value of its key: its place, what is wrong, value, what is allowed, remedy."""

    place: Place
    what: str
    value: str
    allowed: str | None = None
    remedy: str | None = None


def unit_of_values(key: FieldInfo) -> str | None:
    """Unit (UDUNITS, SI) of a key whose numbers may be texts with units; None of other keys."""
    kind = kind_of(key)
    # names of columns and of units are texts of their own
    if _REAL.search(kind) and "string" not in kind:
        return unit_of(key)
    return None


def in_scene_units(
    root: type[BaseModel], raw: Mapping[str, Any], system: UnitSystem
) -> tuple[Mapping[str, Any], list[Misfit]]:
    """A table as written, of the class ``root``, with numbers in the place of texts with units, and the texts that are
    no values; the table itself where it has no such texts."""
    conversion = _Conversion(system)
    return conversion.table([root], raw, ()), conversion.misfits


def value_in_scene_units(
    root: type[BaseModel], tables: Any, path: str, value: Any, system: UnitSystem
) -> tuple[Any, list[Misfit]]:
    """The value of a key, ``a.b.c``, likewise; ``tables`` : of the scene, which choose the types of tables."""
    place = tuple(int(part) if part.isascii() and part.isdigit() else part for part in path.split("."))
    if any(isinstance(part, int) and part > _LONGEST for part in place):
        return value, []
    converted, misfits = in_scene_units(root, _alone(tables, place, value), system)
    here: Any = converted
    for part in place:
        here = here[part]
    return here, misfits


_LONGEST: Final = 10_000  # list of which an item has a path of its own
_CHOOSING: Final = ("type", "components")
"""Keys that units of other keys of their table depend on."""


def _alone(tables: Any, place: Place, value: Any) -> Any:
    """A scene with one value at a place, and with what its unit depends on."""
    if not place:
        return value
    first, rest = place[0], place[1:]
    if isinstance(first, int):
        there = None
        if isinstance(tables, list | tuple) and first < len(tables):
            there = tables[first]
        return [*[None] * first, _alone(there, rest, value)]
    # "hht" is short for {type = "hht"}
    table: Mapping[str, Any] = {}
    if isinstance(tables, str):
        table = {"type": tables}
    elif isinstance(tables, Mapping):
        table = tables
    return {k: table[k] for k in _CHOOSING if k in table} | {first: _alone(table.get(first), rest, value)}


@dataclass(frozen=True)
class _Key:
    """A key of a table as written, whose numbers have a unit."""

    owner: type[BaseModel]
    name: str
    raw: Mapping[str, Any]
    unit: str

    def unit_of(self, index: tuple[int, ...]) -> str:
        """Unit (UDUNITS, SI) of an item."""
        of_item = getattr(self.owner, "unit_of_item", None)
        if of_item is None:
            return self.unit
        return str(of_item(self.name, self.raw, self.unit, index))

    def allowed(self, index: tuple[int, ...]) -> str:
        """What may stand there."""
        about = allowed_text(self.owner.model_fields[self.name], item=bool(index))
        return f"{about}, or a text in {names_for(self.unit_of(index))}"


@dataclass
class _Conversion:
    """Conversion of texts into the units of one system."""

    system: UnitSystem
    misfits: list[Misfit] = field(default_factory=list)

    def table(self, tables: list[type[BaseModel]], raw: Mapping[str, Any], place: Place) -> Mapping[str, Any]:
        """A table that is one of these classes."""
        chosen = [table for table in tables if tag_of(table) == raw.get("type")] or tables
        changed = {}
        for key, value in raw.items():
            owner = next((table for table in chosen if key in table.model_fields), None)
            # most values of a scene are numbers and flags
            if owner is None or not isinstance(value, str | list | tuple | Mapping):
                continue
            converted = self._of_key(owner, key, raw, (*place, key))
            if converted is not value:
                changed[key] = converted
        if changed:
            return {**raw, **changed}
        return raw

    def _of_key(self, owner: type[BaseModel], key: str, raw: Mapping[str, Any], place: Place) -> Any:
        """The value of one key of a table."""
        about, value = owner.model_fields[key], raw[key]
        inner = tables_in(about.annotation)
        if not inner:
            unit = unit_of_values(about)
            if unit is None:
                return value
            return self._value(_Key(owner, key, raw, unit), value, place, ())
        if not is_named(about) or not isinstance(value, Mapping):
            return self._tables(inner, value, place)
        converted = {name: self._tables(inner, item, (*place, name)) for name, item in value.items()}
        if any(converted[name] is not item for name, item in value.items()):
            return converted
        return value

    def _tables(self, inner: list[type[BaseModel]], value: Any, place: Place) -> Any:
        """A table, or a list of tables."""
        if isinstance(value, Mapping):
            return self.table(inner, value, place)
        if not isinstance(value, list | tuple):
            return value
        converted = [self._tables(inner, item, (*place, i)) for i, item in enumerate(value)]
        if any(new is not old for new, old in zip(converted, value, strict=True)):
            return converted
        return value

    def _value(self, key: _Key, value: Any, place: Place, index: tuple[int, ...]) -> Any:
        """A number, or a list of numbers."""
        if isinstance(value, list | tuple):
            if not any(isinstance(item, str | list | tuple) for item in value):
                return value
            converted = [self._value(key, item, (*place, i), (*index, i)) for i, item in enumerate(value)]
            if any(new is not old for new, old in zip(converted, value, strict=True)):
                return converted
            return value
        if not isinstance(value, str) or not begins_as_number(value):
            return value
        found = number_in(value, key.unit_of(index), self.system)
        if isinstance(found, float):
            return found
        allowed = None
        if self.system.measurable:
            allowed = key.allowed(index)
        self.misfits.append(Misfit(place, found[0], shown(value), allowed, found[1]))
        return value


def number_in(text: str, unit: str, system: UnitSystem) -> float | tuple[str, str | None]:
    """The number of a text in the units of a system, for a key with a unit of SI; else what is wrong, and the remedy.

    >>> from latin_fmu.scene.units import SI, UNIT_SYSTEMS
    >>> number_in("5.5 kN", "N", SI), number_in("20 um", "m", UNIT_SYSTEMS["mm-t-s-MPa"])
    (5500.0, 0.02)
    >>> number_in("100 g", "kg", SI), number_in("100 g", "m s-2", SI)
    (0.1, 980.665)
    """
    found = value_and_unit(text)
    if found is None:
        comma = "numbers have a decimal point, and no separators of thousands: 5.5, not 5,5"
        return "no number with a unit", comma if "," in text else None
    number, name = found
    if not system.measurable:
        return "the numbers of the scene have no units", 'write the number without a unit, or units = "SI"'
    if not name:
        return "a text without a unit", f'write the number without quotes, or a unit behind it: "{text.strip()} {unit}"'
    size = unit_size(name, unit)
    if size is not None:
        try:
            return float(number * size / system.exact_size(unit))
        except OverflowError:
            return "too large for a number", None
    base = si_unit(name)
    if base is None:
        return f"unknown unit {shown(name)}", did_you_mean(name, names_for(unit).split(", "))
    if name == "g":
        words = "an acceleration or a mass"
    else:
        words = words_for(base)
    return f"{words}, but the key takes {words_for(unit)}", None
