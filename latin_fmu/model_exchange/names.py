"""The variables of a reduced model as a host numbers them, and as JSON; light enough for the inside of an FMU."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from ..cosim.table_file import table_from, table_text
from ..cosim.variable import Variable


@dataclass(frozen=True)
class Local:
    """A state, the derivative of one, or an event indicator.

    start, nominal : of a state. derivative_of : reference of the state.
    """

    name: str
    unit: str
    description: str
    start: float | None = None
    nominal: float | None = None
    derivative_of: int | None = None


@dataclass(frozen=True)
class Names:
    """All variables; their place is the value reference, those of ``table`` first.

    states : references in the order of the states. derivatives, indicators : first of consecutive references.
    """

    table: tuple[Variable, ...]
    locals: tuple[Local, ...]
    states: tuple[int, ...]
    derivatives: int
    indicators: int

    @property
    def count(self) -> int:
        """Number of variables."""
        return len(self.table) + len(self.locals)

    def to_text(self) -> str:
        """As JSON."""
        rest = [asdict(local) for local in self.locals]
        places = [list(self.states), self.derivatives, self.indicators]
        return "\n".join([json.dumps(places), json.dumps(rest), table_text(self.table)])

    @classmethod
    def from_text(cls, text: str) -> Names:
        """The names of ``to_text``."""
        places, rest, table = text.split("\n", 2)
        states, derivatives, indicators = json.loads(places)
        rows = tuple(Local(**row) for row in json.loads(rest))
        return cls(table_from(table), rows, tuple(states), derivatives, indicators)
