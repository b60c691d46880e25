"""Places of the arrays that a run changes, from their declarations in ``kernels.records``.

A declaration ``"work (4, p, h if elastic else 1): ..."`` says pool and shape; ``"state (1,) if shared: ..."`` also when
the array is there, ``"work (c, m) if kind == STATIC else w_free: ..."`` whose place it takes where it is not. Shapes
and conditions are expressions of the sizes of the record, of the run, and of the letters of ``records`` (``sizes_of``).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, MutableMapping, Sequence
from dataclasses import dataclass
from math import isqrt, prod
from typing import Any, Final, cast

from ..cholesky.substitution import LANES, SPARE, TILED
from ..kernels import records
from ..kernels.active_points import SCRATCH
from ..kernels.energy import FIELDS
from ..kernels.energy_parts import N_TERM, N_WORK
from ..kernels.krylov import SMALL, VECTORS
from ..kernels.newton import N_COURSE
from ..kernels.products import padded
from ..kernels.team import LINE, MARKS, PARTS

POOLS: Final = "state", "work", "output"
_PLACE = re.compile(
    r"(?P<pool>state|work|output)(?:, int64)? \((?P<shape>.*)\)(?: if (?P<when>.+?))?(?: else (?P<at>\w+))?"
)
_KNOWN: Final[dict[str, Any]] = {
    "__builtins__": {},
    **{"isqrt": isqrt, "max": max, "prod": prod, "padded": padded, "STATIC": records.STATIC},
    **{"LANES": LANES, "SPARE": SPARE, "TILED": TILED, "LINE": LINE, "MARKS": MARKS, "PARTS": PARTS},
    **{"FIELDS": FIELDS, "N_COURSE": N_COURSE, "N_TERM": N_TERM, "N_WORK": N_WORK},
    **{"SCRATCH": SCRATCH, "SMALL": SMALL, "VECTORS": VECTORS},
}


@dataclass(frozen=True, slots=True)
class Declared:
    """An array: its numbers as an expression, 0 where it is not there, and the name of the array whose place it takes
    ``elsewhere``."""

    name: str
    size: str
    elsewhere: str | None


class Arrays:
    """Arrays of one pool of a record, in their order; one expression gives all their sizes."""

    def __init__(self, arrays: Sequence[Declared]) -> None:
        self.arrays = tuple(arrays)
        self._sizes = compile(f"[{', '.join(array.size for array in arrays)}]", "sizes of arrays", "eval")

    def sizes(self, names: dict[str, Any]) -> list[int]:
        """Numbers of each array."""
        # the expressions are those of this package, never read from outside
        return cast(list[int], eval(self._sizes, _KNOWN, names))

    def place(self, block: Any, record: MutableMapping[str, Any], names: dict[str, Any]) -> None:
        """Reserve the arrays in a block, one after the other, and set their places in the record."""
        for array, size in zip(self.arrays, self.sizes(names), strict=True):
            here = size > 0 or array.elsewhere is None
            record[array.name] = block.reserve(size) if here else record[str(array.elsewhere)]


def declared(fields: Iterable[records.Field]) -> dict[str, Arrays]:
    """The arrays of the pools POOLS among the fields of a record, by pool.

    Raises
    ------
    ValueError : a declaration that cannot be read.
    """
    found: dict[str, list[Declared]] = {pool: [] for pool in POOLS}
    for name, meaning in fields:
        if not meaning.startswith(tuple(f"{pool}{end}" for pool in POOLS for end in (" (", ","))):
            continue
        place = _PLACE.fullmatch(meaning.partition(":")[0])
        if place is None:
            raise ValueError(f"{name}: pool, shape and condition cannot be read: {meaning!r}")
        size = f"prod(({place['shape']}))"
        found[place["pool"]].append(
            Declared(name, f"{size} if {place['when']} else 0" if place["when"] else size, place["at"])
        )
    return {pool: Arrays(arrays) for pool, arrays in found.items()}


CLASS: Final = declared(records.CLASS_FIELDS)
GROUP: Final = declared(records.GROUP_FIELDS)
RUN: Final = declared(records.RUN_FIELDS)
_LETTERS: Final = {"g": "n_inner", "c": "n_channel", "p": "n_point", "h": "n_component"}
_TABLES = records.CLASS_FIELDS, records.GROUP_FIELDS, records.RUN_FIELDS
_NOTHING: Final = {name: 0 for table in _TABLES for name, _ in table}


def sizes_of(
    record: dict[str, Any], run: dict[str, Any], rows: int, classes: int = 0, tasks: int = 0
) -> dict[str, Any]:
    """Names that the declarations of a class, of a group or of the run itself may use; sizes that were not set are 0.

    rows : R of the output. classes : of this process. tasks : that the threads share at most.
    """
    letters = {letter: record[name] for letter, name in _LETTERS.items() if name in record}
    letters |= {"N": run["n_flat"], "w": run["longest_window"], "R": rows, "classes": classes, "tasks": tasks}
    return _NOTHING | run | record | letters
