"""One exchanged variable, its unit, and the table of variables as JSON: an FMU opens without reading the scene."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

Kind = Literal["real", "integer", "string", "count"]
Causality = Literal["independent", "structuralParameter", "parameter", "input", "output", "local"]
Variability = Literal["constant", "fixed", "tunable", "discrete", "continuous"]


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
    initial_dependencies : names of the variables an output depends on when initialization ends.
    follows_inputs : whether an output at the end of a step depends on the inputs over it; on all of them, as each moves
        the whole assembly.
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
    follows_inputs: bool = True
    dimensions: tuple[int | str, ...] = ()

    @property
    def is_array(self) -> bool:
        """Whether the variable has dimensions."""
        return bool(self.dimensions)


def is_wave(name: str) -> bool:
    """Whether an input (see ``input_table.sources_of``) is the incident wave of a port."""
    return _INCIDENT.match(name) is not None


def variable_of(name: str) -> str:
    """Beginning of the names of the variables of an input: ``load.NAME``, else the name of the input."""
    if "." in name:
        return name
    return f"load.{name}"


def input_variable(name: str, what: str) -> str:
    """Variable "value", "rate" or "history" of an input, e.g. ``load.NAME.rate``; of a port ``port.NAME.force[3]`` and
    ``port.NAME.forceRate[3]``."""
    port = _PORT.fullmatch(name)
    if port is None:
        return f"{variable_of(name)}.{what}"
    if what == "value":
        return name
    return f"{port[1]}{what.capitalize()}{port[3]}"


def input_of(variable: str) -> tuple[str, str]:
    """Input (see ``input_table.sources_of``) that a variable belongs to: "value", "rate" or "history" of it."""
    if port := _PORT.fullmatch(variable):
        return f"{port[1]}{port[3]}", (port[2] or "value").lower()
    name, _, what = variable.rpartition(".")
    return name.removeprefix("load."), what


# lazy (+?): else the name would take in Rate and History
_PORT = re.compile(r"(port\.\w+\.[a-zA-Z]+?)(Rate|History)?(\[\d\])")
_INCIDENT = re.compile(r"port\.\w+\.incident")
AXES = ("x", "y", "z")


def output(name: str, unit: str, description: str, **more: Any) -> Variable:
    """A real output; ``more`` as for ``Variable``."""
    return Variable(name, "output", "continuous", "real", description, unit, **more)


def parameter(name: str, kind: Kind, start: float | int | str, description: str, **more: Any) -> Variable:
    """A parameter, fixed before initialization ends; ``more`` as for ``Variable``."""
    return Variable(name, "parameter", "fixed", kind, description, start=start, **more)


@dataclass(frozen=True)
class Unit:
    """An SI unit: ``name`` as FMI writes it, ``exponents`` of kg, m, s, rad."""

    name: str
    exponents: Mapping[str, int]


UNITS: Final[Mapping[str, Unit]] = {
    "1": Unit("1", {}),
    "s-1": Unit("1/s", {"s": -1}),
    "s": Unit("s", {"s": 1}),
    "m": Unit("m", {"m": 1}),
    "m s-1": Unit("m/s", {"m": 1, "s": -1}),
    "m s-2": Unit("m/s2", {"m": 1, "s": -2}),
    "rad": Unit("rad", {"rad": 1}),
    "rad s-1": Unit("rad/s", {"rad": 1, "s": -1}),
    "rad s-2": Unit("rad/s2", {"rad": 1, "s": -2}),
    "W": Unit("W", {"kg": 1, "m": 2, "s": -3}),
    "N": Unit("N", {"kg": 1, "m": 1, "s": -2}),
    "N s": Unit("N.s", {"kg": 1, "m": 1, "s": -1}),
    "N s-1": Unit("N/s", {"kg": 1, "m": 1, "s": -3}),
    "N s m-1": Unit("N.s/m", {"kg": 1, "s": -1}),
    "N m": Unit("N.m", {"kg": 1, "m": 2, "s": -2}),
    "N m s": Unit("N.m.s", {"kg": 1, "m": 2, "s": -1}),
    "N m s-1": Unit("N.m/s", {"kg": 1, "m": 2, "s": -3}),
    "J": Unit("J", {"kg": 1, "m": 2, "s": -2}),
    "Pa": Unit("Pa", {"kg": 1, "m": -1, "s": -2}),
}
"""Units by UDUNITS string (netCDF): name in the FMI, exponents of SI base units."""


def table_text(table: Sequence[Variable]) -> str:
    """The table as JSON, one variable a line, without values that are the default."""
    default = Variable("", "output", "fixed", "real", "")
    always = ("causality", "kind", "variability")
    lines = [
        json.dumps({k: v for k, v in asdict(variable).items() if k in always or v != getattr(default, k)})
        for variable in table
    ]
    return "[\n" + ",\n".join(lines) + "\n]\n"


def table_from(text: str) -> tuple[Variable, ...]:
    """The table that ``table_text`` wrote."""
    rows = json.loads(text)
    for row in rows:
        # JSON has lists, and no defaults (``table_text``)
        row.update({key: tuple(row.get(key, ())) for key in ("dimensions", "initial_dependencies")})
    return tuple(Variable(**row) for row in rows)
