"""One exchanged variable."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Final, Literal

Kind = Literal["real", "integer", "string", "count"]
Causality = Literal["independent", "structuralParameter", "parameter", "input", "output"]
Variability = Literal["fixed", "discrete", "continuous"]


@dataclass(frozen=True)
class Variable:
    """A row of the variable table; model descriptions, documentation and netCDF attributes come from it.

    Attributes
    ----------
    name : structured name, components counted from 1, e.g. ``interface.crush.force[3]``.
    causality, variability : words of the FMI.
    kind : "real", "integer", "string", or "count" (a size, FMI 3 only).
    description : one sentence without final stop.
    unit : UDUNITS string, None where there is none (strings, whole numbers).
    start : initial value; None for outputs, which are calculated.
    minimum, maximum, nominal : None where not stated. A nominal is the size expected, > 0.
    initial_dependencies : names of the variables an output depends on when initialization ends. (During a step
        no output depends on an input of the same communication point: there is no direct feedthrough.)
    dimensions : sizes of an array, numbers or names of structural parameters; () for a scalar. FMI 3 only.
    """

    name: str
    causality: Causality
    variability: Variability
    kind: Kind
    description: str
    unit: str | None = None
    start: float | int | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    initial_dependencies: tuple[str, ...] = ()
    dimensions: tuple[int | str, ...] = ()

    @property
    def is_array(self) -> bool:
        """Whether it has dimensions."""
        return bool(self.dimensions)


AXES = ("x", "y", "z")


def vector(name: str, unit: str, description: str, *, depends: tuple[str, ...] = ()) -> list[Variable]:
    """Outputs ``name[1]``, ``name[2]``, ``name[3]`` along the global axes."""
    return [output(f"{name}[{i}]", unit, f"{description}, {axis}", depends=depends) for i, axis in enumerate(AXES, 1)]


def output(
    name: str,
    unit: str,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    nominal: float | None = None,
    depends: tuple[str, ...] = (),
    dimensions: tuple[int | str, ...] = (),
) -> Variable:
    """A real output."""
    return Variable(
        name, "output", "continuous", "real", description, unit, None, minimum, maximum, nominal, depends, dimensions
    )


def parameter(
    name: str,
    kind: Kind,
    start: float | int | str,
    description: str,
    *,
    unit: str | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    dimensions: tuple[int | str, ...] = (),
) -> Variable:
    """A parameter, fixed before initialization ends."""
    return Variable(name, "parameter", "fixed", kind, description, unit, start, minimum, maximum, dimensions=dimensions)


# -- Units of the exchanged variables: UDUNITS strings (netCDF) and their FMI names and SI exponents.
@dataclass(frozen=True)
class Unit:
    """An SI unit: ``name`` as FMI writes it, ``exponents`` of kg, m, s."""

    name: str
    exponents: Mapping[str, int]


UNITS: Final[Mapping[str, Unit]] = {
    "1": Unit("1", {}),
    "s-1": Unit("1/s", {"s": -1}),
    "s": Unit("s", {"s": 1}),
    "m": Unit("m", {"m": 1}),
    "m s-1": Unit("m/s", {"m": 1, "s": -1}),
    "m s-2": Unit("m/s2", {"m": 1, "s": -2}),
    "W": Unit("W", {"kg": 1, "m": 2, "s": -3}),
    "N": Unit("N", {"kg": 1, "m": 1, "s": -2}),
    "N s": Unit("N.s", {"kg": 1, "m": 1, "s": -1}),
    "J": Unit("J", {"kg": 1, "m": 2, "s": -2}),
    "Pa": Unit("Pa", {"kg": 1, "m": -1, "s": -2}),
}
"""By UDUNITS string."""


# -- The variable table as JSON, so that a participant can be opened without reading the scene.
def table_text(table: Sequence[Variable]) -> str:
    """One variable a line, facts that are not given left out."""
    plain = Variable("", "output", "fixed", "real", "")
    lines = []
    for variable in table:
        facts = {
            k: v
            for k, v in asdict(variable).items()
            if v != getattr(plain, k) or k in ("causality", "kind", "variability")
        }
        lines.append(json.dumps(facts))
    return "[\n" + ",\n".join(lines) + "\n]\n"


def table_from(text: str) -> tuple[Variable, ...]:
    """The table of ``table_text``."""
    rows = []
    for facts in json.loads(text):
        for key in ("dimensions", "initial_dependencies"):
            facts[key] = tuple(facts.get(key, ()))
        rows.append(Variable(**facts))
    return tuple(rows)
