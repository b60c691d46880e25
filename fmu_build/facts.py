"""What a model description says about the FMU as a whole."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from latin_fmu.cosim.variable import Variable
from latin_fmu.scene.schema import Scene

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
    description, version : text and version of the package. stop_time, step_size : s. tolerance : relative
    accuracy that the tolerance of the scene goes with.
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


def identifier_of(scene: Scene) -> str:
    """The name of the scene as one word: of the binaries and the cross-check files."""
    return re.sub(r"\W", "_", scene.name)


def suggested_step(scene: Scene) -> float:
    """Suggested communication step, s: about a fiftieth of the interval, a whole number of time steps."""
    n = scene.time.n_step
    parts = next((p for p in range(min(50, n), 0, -1) if n % p == 0), 1)
    return scene.time.end / parts
