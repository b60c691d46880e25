"""Places of the arrays that a run changes, from their declarations in ``kernels.records``.

A declaration ``"work (4, p, h if elastic else 1): ..."`` says pool and shape; ``"state (1,) if shared: ..."`` also when
the array is there, ``"work (c, m) if kind == STATIC else w_free: ..."`` whose place it takes where it is not. Shapes
and conditions are expressions of the sizes of the record, of the run, and of the letters of ``records`` (``sizes_of``).
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import dataclass
from math import isqrt, prod
from types import CodeType
from typing import Any, Final

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
    **{"isqrt": isqrt, "max": max, "padded": padded, "STATIC": records.STATIC},
    **{"LANES": LANES, "SPARE": SPARE, "TILED": TILED, "LINE": LINE, "MARKS": MARKS, "PARTS": PARTS},
    **{"FIELDS": FIELDS, "N_COURSE": N_COURSE, "N_TERM": N_TERM, "N_WORK": N_WORK},
    **{"SCRATCH": SCRATCH, "SMALL": SMALL, "VECTORS": VECTORS},
}


@dataclass(frozen=True, slots=True)
class Declared:
    """An array: ``shape`` and ``when`` it is there as compiled expressions, the name of the array whose place it takes
    ``elsewhere``."""

    name: str
    pool: str
    shape: CodeType
    when: CodeType | None
    elsewhere: str | None

    def size(self, sizes: Mapping[str, Any]) -> int:
        """Its numbers; 0 where it is not there."""
        # the expressions are those of this package, never read from outside
        if self.when is not None and not eval(self.when, _KNOWN, sizes):
            return 0
        return prod(eval(self.shape, _KNOWN, sizes))


def declared(fields: Iterable[records.Field]) -> tuple[Declared, ...]:
    """The arrays of the pools POOLS among the fields of a record.

    Raises
    ------
    ValueError : a declaration that cannot be read.
    """
    found = []
    for name, meaning in fields:
        if not meaning.startswith(tuple(f"{pool}{end}" for pool in POOLS for end in (" (", ","))):
            continue
        place = _PLACE.fullmatch(meaning.partition(":")[0])
        if place is None:
            raise ValueError(f"{name}: pool, shape and condition cannot be read: {meaning!r}")
        when, shape = place["when"], f"({place['shape']})"
        condition = compile(when, name, "eval") if when else None
        found.append(Declared(name, place["pool"], compile(shape, name, "eval"), condition, place["at"]))
    return tuple(found)


CLASS: Final = declared(records.CLASS_FIELDS)
GROUP: Final = declared(records.GROUP_FIELDS)
RUN: Final = declared(records.RUN_FIELDS)
_LETTERS: Final = {"g": "n_inner", "c": "n_channel", "p": "n_point", "h": "n_component"}
_TABLES = records.CLASS_FIELDS, records.GROUP_FIELDS, records.RUN_FIELDS
_NOTHING: Final = {name: 0 for table in _TABLES for name, _ in table}


def sizes_of(
    record: dict[str, Any], run: dict[str, Any], rows: int, classes: int = 0, tasks: int = 0
) -> Mapping[str, Any]:
    """Names that the declarations of a class, of a group or of the run itself may use; sizes that were not set are 0.

    rows : R of the output. classes : of this process. tasks : that the threads share at most.
    """
    letters = {letter: record[name] for letter, name in _LETTERS.items() if name in record}
    letters |= {"N": run["n_flat"], "w": run["longest_window"], "R": rows, "classes": classes, "tasks": tasks}
    return ChainMap(letters, record, run, _NOTHING)


def place(
    block: Any, arrays: Iterable[Declared], pool: str, record: MutableMapping[str, Any], sizes: Mapping[str, Any]
) -> None:
    """Reserve the arrays of a pool in a block, one after the other, and set their places in the record."""
    for array in arrays:
        if array.pool != pool:
            continue
        size = array.size(sizes)
        here = size > 0 or array.elsewhere is None
        record[array.name] = block.reserve(size) if here else record[str(array.elsewhere)]
