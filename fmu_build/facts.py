"""What a model description says about the FMU as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from latin_fmu.cosim.variable import Variable

NAME = "latin_fmu"
AUTHOR = "The latin-fmu developers"
LICENCE = "MIT; the exporter's library under its own licence, see documentation/licenses"
LOG_CATEGORIES = {
    "logAll": "All messages",
    "logStatusWarning": "Settings that were adjusted, inputs that have no effect",
    "logStatusDiscard": "Steps that were refused: why, and what to do",
    "logStatusError": "Initialization that failed: every later step is refused",
    "logStatusFatal": "Nothing can be done any more",
}


@dataclass(frozen=True)
class Facts:
    """Facts of one FMU.

    Attributes
    ----------
    model : name of the model, that of the scene. identifier : of the binaries. token : changes with the content.
    description, version : text and version of the package. stop_time, step_size : s. tolerance : of the scene.
    table : the variables; their order is the value reference.
    """

    model: str
    identifier: str
    token: str
    description: str
    version: str
    stop_time: float
    step_size: float
    tolerance: float
    table: Sequence[Variable]

    def references(self) -> dict[str, int]:
        """Value reference by name."""
        return {variable.name: number for number, variable in enumerate(self.table)}
