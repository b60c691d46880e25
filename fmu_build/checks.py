"""Checks of an FMU: validation by fmpy and the XML schemas, error of one with reduced bodies.

For the error of an FMU whose bodies are reduced to a few modes the scene is solved with its elastic bodies and with the
reduced ones, under the laws that its loads have before they become inputs.
"""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import util
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from latin_fmu import api
from latin_fmu.cosim.input_table import inputs_of, settable_of, with_laws
from latin_fmu.errors import InputError, Problem, SolverError, did_you_mean, listed
from latin_fmu.run_quantities import Quantities, measure_solution
from latin_fmu.scene.laws import InputLaw, TimeLaw
from latin_fmu.scene.quantity_table import FIRST_CONTACT, IMPULSE, PEAK_FORCE, SEPARATION, definition_of
from latin_fmu.scene.schema import Scene

from .build import build_fmu

_TOLD: Final = tuple(quantity.key for quantity in (PEAK_FORCE, IMPULSE, FIRST_CONTACT, SEPARATION))
SETTING: Final = "solver.propagator={{type='reduced',modes={}}}"
"""Setting of a scene whose bodies are reduced to so many modes."""


@dataclass(frozen=True)
class Inputs:
    """A scene whose chosen loads are inputs, and the laws they had: the histories of the reference run."""

    scene: Scene
    laws: Mapping[str, TimeLaw]


def with_inputs(scene: Scene, names: Sequence[str]) -> Inputs:
    """Make laws of a scene inputs.

    names : of loads, and of what else drives the scene as its inputs are called (``boundary.NAME``,
    ``gravity.acceleration``, ...), or ``all`` for everything that can be set from outside. A law that is an input
    already keeps its start value as history.

    Raises InputError for a name that is not there.
    """
    loads = settable_of(scene)
    if list(names) == ["all"]:
        wanted = list(loads)
    else:
        wanted = list(names)
    if unknown := [name for name in wanted if name not in loads]:
        close = {name: did_you_mean(name, loads) for name in unknown}
        close |= {n: f"did you mean {full!r}?" for n in unknown for full in loads if full.rpartition(".")[2] == n}
        what = "no such load, and nothing else that drives the scene"
        raise InputError([Problem(f"input {n}", what, None, listed(loads), close[n]) for n in unknown])
    laws: dict[str, TimeLaw] = {name: loads[name] for name in wanted}
    laws.update(inputs_of(scene))
    inputs = {name: InputLaw(start_value=float(laws[name].sample(np.zeros(1))[0])) for name in wanted}  # at t = 0
    return Inputs(with_laws(scene, inputs), laws)


_SCHEMAS = {"2.0": "fmi2/fmi2ModelDescription.xsd", "3.0": "fmi3/fmi3ModelDescription.xsd"}
_TERMINALS = "fmi3/fmi3TerminalsAndIcons.xsd"


def validate(fmu: str | Path) -> list[str]:
    """Problems of an FMU; empty where there are none.

    Raises ModuleNotFoundError without fmpy and lxml (``pip install 'latin-fmu[fmu]'``).
    """
    from fmpy.validation import validate_fmu

    return [*(f"fmpy: {problem}" for problem in validate_fmu(str(fmu))), *schema_problems(fmu)]


def schema_problems(fmu: str | Path) -> list[str]:
    """Errors of modelDescription.xml and terminalsAndIcons.xml against the schemas of the standard."""
    from lxml import etree

    spec = util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("validation needs fmpy: pip install 'latin-fmu[fmu]'", name="fmpy")
    # fmpy ships the schemas of the standard
    schemas = Path(spec.origin).parent / "schema"
    problems = []
    with zipfile.ZipFile(fmu) as archive:
        description = archive.read("modelDescription.xml")
        version = str(etree.fromstring(description).get("fmiVersion"))
        checks = {"modelDescription.xml": _SCHEMAS[version]}
        if "terminalsAndIcons/terminalsAndIcons.xml" in archive.namelist():
            checks["terminalsAndIcons/terminalsAndIcons.xml"] = _TERMINALS
        for name, schema in checks.items():
            validator = etree.XMLSchema(etree.parse(schemas / schema))
            validator.validate(etree.parse(io.BytesIO(archive.read(name))))
            problems += [f"{name}: line {e.line}: {e.message}" for e in validator.error_log]
    return problems


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
            full.scene.unit_system.label(definition_of(name).unit),
            exact.value(name, exact),
            # peak and separation are by means over the duration that the exact run defines
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
        # extra: the reference run would be made and counted
        return build_fmu(scene, Path(folder) / "size.fmu", extra={}).stat().st_size


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
