"""Cards of a deck as text: keyword, parameters, data lines, as CalculiX and Abaqus read them.

CalculiX 2.20 takes 20 characters of a field and 16 fields of a line, and goes on below a line that ends with a comma.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np

from ..fem.mesh import Array, Index

Field = str | int | float
_FIELDS: Final = 16  # of a line
_NUMBERS: Final = 12  # of members of a set in a line
_NONE: Final[Mapping[str, Field]] = MappingProxyType({})


def field_text(value: Field) -> str:
    """A field of a data line or the value of a parameter; 13 digits of a number have 20 characters with all signs.

    >>> field_text(7), field_text(-1.0 / 3.0), field_text(2.1e11), field_text("S2")
    ('7', '-0.3333333333333', '210000000000', 'S2')
    """
    if isinstance(value, float):
        # + 0.0: no minus of a zero
        return f"{value + 0.0:.13g}"
    return str(value)


def card(keyword: str, parameters: Mapping[str, Field] = _NONE, rows: Iterable[Sequence[Field]] = ()) -> Iterator[str]:
    """Lines of a card.

    Parameters
    ----------
    keyword : without its star. parameters : by name; an empty text is a parameter without a value. rows : fields of the
        data lines; more than a line holds go on in the next.

    Examples
    --------
    >>> list(card("CONTACT PAIR", {"INTERACTION": "lap", "SMALL SLIDING": ""}, [("upper", "lower")]))
    ['*CONTACT PAIR, INTERACTION=lap, SMALL SLIDING', 'upper, lower']
    """
    words = [key if value == "" else f"{key}={field_text(value)}" for key, value in parameters.items()]
    yield ", ".join([f"*{keyword}", *words])
    for row in rows:
        fields = [field_text(value) for value in row]
        for first in range(0, len(fields), _FIELDS):
            more = "," * (first + _FIELDS < len(fields))
            yield ", ".join(fields[first : first + _FIELDS]) + more


def node_card(points: Array, numbers: Index, name: str = "") -> Iterator[str]:
    """Nodes (n, 3) with their numbers (n,), in a node set of this name."""
    parameters: dict[str, Field] = {}
    if name:
        parameters["NSET"] = name
    rows = zip(numbers.tolist(), points.tolist(), strict=True)
    yield from card("NODE", parameters, ((number, *place) for number, place in rows))


def element_card(kind: str, cells: Index, numbers: Index, elset: str) -> Iterator[str]:
    """Elements of a type: numbers (n,) of their own and (n, n_node) of their nodes."""
    rows = zip(numbers.tolist(), cells.tolist(), strict=True)
    yield from card("ELEMENT", {"TYPE": kind, "ELSET": elset}, ((number, *nodes) for number, nodes in rows))


def node_set_card(name: str, numbers: Index) -> Iterator[str]:
    """A node set of these numbers (n,)."""
    members = numbers.tolist()
    rows = [members[first : first + _NUMBERS] for first in range(0, len(members), _NUMBERS)]
    yield from card("NSET", {"NSET": name}, rows)


def surface_card(name: str, faces: Iterable[tuple[int, int]]) -> Iterator[str]:
    """A surface of faces of elements: numbers of the elements, and those of their faces."""
    yield from card("SURFACE", {"NAME": name, "TYPE": "ELEMENT"}, ((element, f"S{face}") for element, face in faces))


def amplitude_card(name: str, times: Array, values: Array) -> Iterator[str]:
    """An amplitude of points (n,), linear between them; those on the line between their neighbours are left out."""
    pairs = np.stack([times, values], axis=1)[corners(times, values)].ravel().tolist()
    yield from card("AMPLITUDE", {"NAME": name}, [pairs[first : first + 8] for first in range(0, len(pairs), 8)])


def corners(times: Array, values: Array) -> Index:
    """Rows of the points (n,) without which a history that is linear between its points would be another one.

    >>> corners(np.arange(5.0), np.array([0.0, 1.0, 2.0, 2.0, 2.0])).tolist()
    [0, 2, 4]
    """
    slopes = np.diff(values) / np.diff(times)
    steep = float(np.abs(slopes).max(initial=0.0))
    bends = np.abs(np.diff(slopes)) > 1e-12 * steep
    kept = np.flatnonzero(np.concatenate([[True], bends, [True]]))
    return np.asarray(kept, dtype=np.int64)
