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
from ..kernels.local_stage import POINT
from ..kernels.newton import N_COURSE, N_FINISH
from ..kernels.prediction import KEPT, ORDER
from ..kernels.products import padded
from ..kernels.tasks import CHUNK
from ..kernels.team import LINE, MARKS, PARTS

POOLS: Final = "state", "work", "output"
COMMUNICATION_ROWS: Final = 65
"""Rows of output of a run for co-simulation: the start of a call, and the time steps that it makes at most."""
_OUTPUT: Final = 100_000  # numbers of output kept at a time, about: they stay in the cache
_ROWS: Final = (16, 512)  # and rows at least and at most
_PLACE = re.compile(
    r"(?P<pool>state|work|output)(?:, int64)? \((?P<shape>.*)\)(?: if (?P<when>.+?))?(?: else (?P<at>\w+))?"
)
_KNOWN: Final[dict[str, Any]] = {
    "__builtins__": {},
    **{"isqrt": isqrt, "max": max, "prod": prod, "padded": padded, "STATIC": records.STATIC},
    **{"LANES": LANES, "SPARE": SPARE, "TILED": TILED, "LINE": LINE, "MARKS": MARKS, "PARTS": PARTS},
    **{"FIELDS": FIELDS, "N_COURSE": N_COURSE, "N_FINISH": N_FINISH, "N_TERM": N_TERM, "N_WORK": N_WORK},
    **{"SCRATCH": SCRATCH, "POINT": POINT, "SMALL": SMALL, "VECTORS": VECTORS, "KEPT": KEPT, "ORDER": ORDER},
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
        self._places = tuple((array.name, array.elsewhere) for array in arrays)
        self._sizes = compile(f"[{', '.join(array.size for array in arrays)}]", "sizes of arrays", "eval")
        self.names = self._sizes.co_names

    def sizes(self, names: dict[str, Any]) -> list[int]:
        """Numbers of each array."""
        # the expressions are those of this package, never read from outside
        return cast(list[int], eval(self._sizes, _KNOWN, names))

    def place(self, block: Any, record: MutableMapping[str, Any], names: dict[str, Any]) -> None:
        """Reserve the arrays in a block, one after the other, and set their places in the record."""
        at = block.size
        for (name, elsewhere), size in zip(self._places, self.sizes(names), strict=True):
            if size > 0 or elsewhere is None:
                record[name] = at
                at += -(-size // LINE) * LINE
            else:
                record[name] = record[elsewhere]
        block.size = at


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
        if place["when"]:
            size = f"{size} if {place['when']} else 0"
        found[place["pool"]].append(Declared(name, size, place["at"]))
    return {pool: Arrays(arrays) for pool, arrays in found.items()}


CLASS: Final = declared(records.CLASS_FIELDS)
GROUP: Final = declared(records.GROUP_FIELDS)
RUN: Final = declared(records.RUN_FIELDS)
_LETTERS: Final = {"g": "n_inner", "c": "n_channel", "p": "n_point", "h": "n_component"}
_SIZES: Final = frozenset(
    name for table in (CLASS, GROUP, RUN) for arrays in table.values() for name in arrays.names if name not in _KNOWN
)
"""Sizes that the declarations use."""


def sizes_of(
    record: dict[str, Any], run: dict[str, Any], rows: int, classes: int = 0, tasks: int = 0
) -> dict[str, Any]:
    """Names that the declarations of a class, of a group or of the run itself may use; sizes that were not set are 0.

    rows : R of the output. classes : of this process. tasks : that the threads share at most.
    """
    letters = {letter: record[name] for letter, name in _LETTERS.items() if name in record}
    letters |= {"N": run["n_flat"], "w": run["longest_window"], "R": rows, "classes": classes, "tasks": tasks}
    return {name: record.get(name, run.get(name, 0)) for name in _SIZES} | letters


def place_moving(
    block: Any, run: dict[str, Any], groups: Sequence[dict[str, Any]], classes: Sequence[dict[str, Any]]
) -> tuple[int, int]:
    """Places of state, work and output in a block, written to the records; rows of output, and size of the state."""
    points = 0
    for group in groups:
        group["first_point"], points = points, points + group["n_point"]
    run["n_point"] = points
    chunks = sum(-(-group["n_point"] // CHUNK) for group in groups)
    tasks = max([len(classes), PARTS, chunks, *(row["n_piece"] for row in classes)])
    tables = (CLASS, classes), (GROUP, groups), (RUN, [run])
    records = [(arrays, record) for arrays, some in tables for record in some]
    sized = [(arrays, record, sizes_of(record, run, 1, len(classes), tasks)) for arrays, record in records]
    per_row = sum(sum(arrays["output"].sizes(sizes)) for arrays, _, sizes in sized)
    window = int(run["longest_window"])
    rows = max(min(max(_OUTPUT // max(per_row, 1), _ROWS[0]), _ROWS[1]), window)
    # row 0 is the start of the call
    if run.get("n_output", 0):
        rows = max(COMMUNICATION_ROWS, window + 1)
    state = 0
    for pool in POOLS:
        for arrays, record, sizes in sized:
            sizes["R"] = rows
            arrays[pool].place(block, record, sizes)
            if pool == "state" and arrays is CLASS:
                # known once the state of the class is placed, and needed by sizes of its work
                record["state"], record["energy"] = record["rest"], record["totals"]
                counts = {"n_state": record["totals"] - record["rest"], "n_energy": block.size - record["totals"]}
                record |= counts
                sizes |= counts  # of copies of the state
        if pool == "state":
            state = block.size
    return rows, int(state)
