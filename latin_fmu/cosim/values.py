"""Values of the variables of a table by reference, the place in the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .arrays import ArrayReader
from .guarded import WARNING, Log
from .variable import Variable

if TYPE_CHECKING:  # see ``participant``
    from ..latin.record import Array
    from .session import Session


class Values:
    """Numbers, texts and arrays.

    Parameters
    ----------
    table : the variables. log : takes level and message; hears of what could not be set.
    """

    def __init__(self, table: Sequence[Variable], log: Log) -> None:
        self.table, self._log = tuple(table), log
        self._place = {v.name: i for i, v in enumerate(self.table)}
        self._outputs = [i for i, v in enumerate(self.table) if v.causality == "output" and not v.is_array]
        self._arrays = ArrayReader(self.table)
        self.clear()

    def clear(self) -> None:
        """Every variable at its start value."""
        start = [v.start if isinstance(v.start, int | float) and not v.is_array else 0.0 for v in self.table]
        self._numbers: Array = np.array([float(value) for value in start])
        self._texts = {i: str(v.start) for i, v in enumerate(self.table) if v.kind == "string"}
        self._arrays.clear()

    def number(self, name: str) -> float:
        """A number by name."""
        return float(self._numbers[self._place[name]])

    def text(self, name: str) -> str:
        """A string by name."""
        return self._texts[self._place[name]]

    # -- by reference ---------------------------------------------------------------------------------------------
    def get(self, references: Sequence[int], session: Session | None) -> Sequence[float]:
        """Numbers, those of arrays one after the other in row-major order."""
        if not self._arrays.has(references):
            values: list[float] = self._numbers[references].tolist()
            return values
        found: list[float] = []
        for reference in references:
            if self.table[reference].is_array:
                found += self._arrays.read(reference, self._numbers, self._place, session)
            else:
                found.append(float(self._numbers[reference]))
        return found

    def size(self, references: Sequence[int]) -> int:
        """How many numbers ``get`` gives."""
        if not self._arrays.has(references):
            return len(references)
        return sum(
            self._arrays.size(r, self._numbers, self._place) if 0 <= r < len(self.table) else 1 for r in references
        )

    def set(self, references: Sequence[int], values: Sequence[float], ready: bool) -> None:
        """Set numbers; arrays take as many as they hold. ``ready``: initialized, only inputs can be set."""
        if not self._arrays.has(references):
            for reference, value in zip(references, values, strict=True):
                self._set(reference, value, ready)
            return
        at = 0
        for reference in references:
            if self.table[reference].is_array:
                size = self._arrays.size(reference, self._numbers, self._place)
                self._arrays.write(reference, values[at : at + size])
                at += size
            else:
                self._set(reference, values[at], ready)
                at += 1

    def _set(self, reference: int, value: float, ready: bool) -> None:
        variable = self.table[reference]
        if variable.causality in ("output", "independent"):
            self._log(WARNING, f"{variable.name} is calculated and was not set")
        elif ready and variable.causality != "input":
            self._log(WARNING, f"{variable.name} is fixed after initialization and was not set")
        else:
            self._numbers[reference] = value

    def get_texts(self, references: Sequence[int]) -> Sequence[str]:
        """Strings."""
        return [self._texts[reference] for reference in references]

    def set_texts(self, references: Sequence[int], values: Sequence[str], ready: bool) -> None:
        """Set strings."""
        for reference, value in zip(references, values, strict=True):
            if ready:
                name = self.table[reference].name
                self._log(WARNING, f"{name} is fixed after initialization and was not set")
            else:
                self._texts[reference] = value

    # -- to and from a session ------------------------------------------------------------------------------------
    def histories(self) -> dict[str, tuple[Array, Array]]:
        """Load histories given as arrays, by load."""
        return self._arrays.histories(self._numbers, self._place)

    def take(self, session: Session) -> None:
        """The outputs of a session."""
        row = session.row
        self._numbers[self._outputs[: len(row)]] = row
        self._numbers[0] = session.time
        self._arrays.changed()
        count = self._place.get("window.count")
        if count is not None:
            self._numbers[count] = self._arrays.count(session, self._numbers, self._place)

    def changed(self) -> None:
        """The session has been moved: arrays are read anew."""
        self._arrays.changed()

    def tree(self) -> dict[str, Any]:
        """All that was set and calculated."""
        return {
            "numbers": self._numbers.copy(),
            "texts": {str(i): text for i, text in self._texts.items()},
            "arrays": self._arrays.tree(),
        }

    def resume(self, tree: Mapping[str, Any]) -> None:
        """Back to a tree."""
        self._numbers = tree["numbers"]
        self._texts = {int(i): text for i, text in tree["texts"].items()}
        self._arrays.resume(tree["arrays"])
