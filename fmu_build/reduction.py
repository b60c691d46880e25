"""Error and size of an FMU whose bodies are reduced to a few modes, for its documentation and for ``explain``.

The scene is solved with its elastic bodies and with the reduced ones, under the laws that its loads have before they
become inputs.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

from latin_fmu import api
from latin_fmu.accuracy.quantities import Quantities
from latin_fmu.accuracy.runs import measure_solution
from latin_fmu.cosim.variables import with_laws
from latin_fmu.errors import SolverError
from latin_fmu.results.quantities_of_interest import FIRST_CONTACT, IMPULSE, PEAK_FORCE, SEPARATION, definition_of
from latin_fmu.scene.schema import Scene

from .build import build_fmu
from .checks import Inputs

_TOLD: Final = tuple(quantity.key for quantity in (PEAK_FORCE, IMPULSE, FIRST_CONTACT, SEPARATION))
SETTING: Final = "solver.propagator={{type='reduced',modes={}}}"
"""Setting of a scene whose bodies are reduced to so many modes."""


class ReductionError(NamedTuple):
    """A contact quantity ``interface.key`` of the scene and of its reduced model, and the distance of both, relative to
    the scale of the quantity (``results.quantities_of_interest``)."""

    quantity: str
    unit: str
    full: float
    reduced: float
    error: float

    def __str__(self) -> str:
        return f"{self.quantity} {self.reduced:.4g} {self.unit}, {100 * self.error:.2g} % from {self.full:.4g}"


def reduction_errors(full: Inputs, reduced: Inputs) -> list[ReductionError]:
    """Errors of the peak force, the impulse and the instants of contact of every interface that may open.

    full, reduced : the scene, with inputs, and the laws that these had. Empty where no interface carries a force: an
    input whose law is nothing but its start value may load nothing.

    Raises
    ------
    SolverError : one of both runs does not converge.
    """
    exact, coarse = _quantities(full), _quantities(reduced)
    if not any(force.raw_peak() > 0.0 for force in exact.forces.values()):
        return []
    names = [name for name in exact.values if name.rpartition(".")[2] in _TOLD]
    return [
        ReductionError(
            name,
            definition_of(name).unit,
            exact.value(name, exact),
            coarse.value(name, exact) if name in coarse.values else float("nan"),
            coarse.error(name, exact) if name in coarse.values else float("inf"),
        )
        for name in names
    ]


def compiled_size(scene: Scene) -> int:
    """Bytes of the archive of the compiled FMU (FMI 2) of a scene, which is made and thrown away.

    Raises
    ------
    InputError : the scene cannot be compiled, or the library is missing. SceneError : it cannot be built.
    """
    with tempfile.TemporaryDirectory() as folder:
        return build_fmu(scene, Path(folder) / "size.fmu", compiled=True).stat().st_size


def _quantities(inputs: Inputs) -> Quantities:
    scene = with_laws(inputs.scene, inputs.laws)
    solution = api.solve(scene)
    if not solution.converged:
        raise SolverError(f"the error of the reduced model is not known: {solution.status}")
    return measure_solution(scene, solution)


def reduction_note(n_mode: int, errors: Sequence[ReductionError]) -> str:
    """Passage of the documentation of an FMU with ``n_mode`` modes a body."""
    rows = "".join(
        f"<tr><td>{escape(e.quantity)}</td><td>{e.full:.4g} {e.unit}</td><td>{e.reduced:.4g} {e.unit}</td>"
        f"<td>{100 * e.error:.2g} %</td></tr>\n"
        for e in errors
    )
    table = f"<table><tr><th>quantity</th><th>scene</th><th>reduced</th><th>error</th></tr>\n{rows}</table>\n"
    text = (
        f"<p>Every elastic body is reduced to {n_mode} modes and a static shape for each interface unknown. "
        f"{'Errors under the laws that the loads of the scene had:' if errors else 'No load acted: no error is known.'}"
        "</p>\n"
    )
    return text + (table if errors else "")
