"""Parameters of a session that may change between its steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ..errors import InputError
from .engine import STEP, Engine, numbers_of, set_numbers
from .variable import Variable

_HEADING = "the parameter cannot be set"


class TunableParameters(Mapping[str, float]):
    """Values of the tunable parameters by name, each that of the scene until another is set.

    Parameters
    ----------
    table : variables. fixed : why none may be set; empty where they may.

    Examples
    --------
    >>> friction = Variable("interface.a.friction_coefficient", "parameter", "tunable", "real", "mu", "1", 0.2)
    >>> parameters = TunableParameters([friction])
    >>> parameters[friction.name] = 0.3
    >>> dict(parameters)
    {'interface.a.friction_coefficient': 0.3}
    """

    def __init__(self, table: Sequence[Variable], fixed: str = "") -> None:
        self._references = {v.name: i for i, v in enumerate(table) if v.variability == "tunable"}
        self._starts = {name: float(table[i].start or 0.0) for name, i in self._references.items()}
        self._values: dict[str, float] = {}
        self._fixed = fixed
        self.engine: Engine | None = None
        """That steps, and takes what is set."""

    def __len__(self) -> int:
        return len(self._references)

    def __iter__(self) -> Iterator[str]:
        return iter(self._references)

    def __getitem__(self, name: str) -> float:
        """Value of a parameter. Raises InputError for another name."""
        self._reference(name)
        return self._values.get(name, self._starts[name])

    def __setitem__(self, name: str, value: float) -> None:
        """Set a parameter from the next step on. Raises InputError for another name, a value that cannot be, and where
        none may be set."""
        reference = self._reference(name)
        if self._fixed:
            raise InputError.of(
                _HEADING, name, self._fixed, remedy="a session with Settings(keep=False), in windowed mode"
            )
        if self.engine is not None and self.engine.phase == STEP:
            set_numbers(self.engine, {reference: float(value)})
        self._values[name] = float(value)

    def reset(self) -> None:
        """Return to the values of the scene, before the start."""
        self._values.clear()

    def _reference(self, name: str) -> int:
        if name not in self._references:
            allowed = ", ".join(self._references) or "none"
            raise InputError.of(_HEADING, name, "no tunable parameter of this name", None, allowed)
        return self._references[name]

    def by_reference(self) -> Mapping[int, float]:
        """What is set, by value reference."""
        return {self._references[name]: value for name, value in self._values.items()}

    def take_over(self, engine: Engine) -> None:
        """Take the values of an engine, whose state was restored."""
        values = numbers_of(engine, list(self._references.values()))
        self._values = {name: values[reference] for name, reference in self._references.items()}
