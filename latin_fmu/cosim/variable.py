"""One exchanged variable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
