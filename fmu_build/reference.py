"""Reference of an FMU: inputs and outputs of its default experiment, as files of the layered standard FMI-LS-REF.

FMI-LS-REF 1.0.0-beta.1 (https://github.com/modelica/fmi-ls-ref) names the files in a manifest: NAME.exp, the
experiment, NAME_in.csv, its inputs, NAME_ref.csv, its outputs, and NAME.ssv, a parameter set with the values of the
scene. The outputs are those of a session of the solver, no
FMI between: a host that runs the experiment compares the FMU with the solver.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element, SubElement, register_namespace

import numpy as np

import latin_fmu
from latin_fmu.assembly.interfaces import completed
from latin_fmu.building import discretise
from latin_fmu.compiled import PLAIN
from latin_fmu.cosim.input_table import inputs_of
from latin_fmu.cosim.session import Session
from latin_fmu.cosim.settings import Settings
from latin_fmu.cosim.variable import input_variable
from latin_fmu.cosim.variables import scalar_table
from latin_fmu.effects.cost import Prediction
from latin_fmu.latin.settings import accuracy_of
from latin_fmu.scene.laws import InputLaw, TableLaw, TimeLaw
from latin_fmu.scene.schema import Scene

from .compiled import CONSTANTS
from .description import identifier_of, suggested_step, unit_definitions, unit_name, xml_bytes
from .parameter_set import MIME, parameter_set

NAME: Final = "org.fmi-standard.fmi-ls-ref"
VERSION: Final = "1.0.0-beta.1"
FOLDER: Final = f"extra/{NAME}"
NOTE: Final = "documentation/fmi-ls-ref.txt"
LONGEST: Final = 10.0
"""CPU time, s, predicted for a run, beyond which the experiment is cut. A prediction, so that building twice gives the
same bytes."""
MOST_NUMBERS: Final = 20_000
"""Outputs times communication points from which on rows are left out of NAME_ref.csv."""
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_LABELS: Final = {
    "experiment": ("experiment:default", "Files of the default experiment"),
    "parameter": ("variant:scene", "Values of the scene that the FMU was made from"),
}
_DESCRIPTION = "Layered Standard providing information on related files included in an FMU."
_ROUND_OFF = ("solver.", "energy.balance")  # outputs that depend on round-off, or are nothing else

_TEXT = """\
Reference run of this FMU, by the layered standard FMI-LS-REF {version}

Files in {folder}:
{stem}.exp      the experiment: start, stop, communication step, tolerance
{stem}.ssv      a parameter set: the values of the scene
{inputs}{stem}_ref.csv  outputs at {rows} of its {points} communication points

{extent}
{note}
The outputs were computed by a session of {program}, without the FMI. Counts of
iterations and the residual of the energies, which depend on round-off, are left out.

Deviations to be expected: round-off, 1e-9 of the peak of an output (of all components of a vector), as long as no
point changes its contact state at another instant.
"""
_INPUTS = "{stem}_in.csv   inputs, to be set at the start of every step, value and rate\n"


@dataclass(frozen=True)
class ReferenceRun:
    """Files of a reference by their path inside the archive, none where it was left out; one sentence on it."""

    files: dict[str, bytes]
    said: str


class _Run(NamedTuple):
    """Communication points, names and rows of outputs, columns of inputs by variable; why it ended early, or ''."""

    times: list[float]
    names: list[str]
    rows: list[list[float]]
    inputs: dict[str, list[float]]
    complaint: str


def reference_of(scene: Scene, laws: Mapping[str, TimeLaw] | None = None, whole: bool = False) -> ReferenceRun:
    """Run the default experiment of the FMU of a scene.

    scene : with its inputs. laws : histories of inputs, by the names of ``inputs_of``; a load without one rises in a
    straight line from its start value to 1, the amplitude of the scene, other inputs keep their start value.
    whole : the whole experiment, at every communication point, whatever it takes.

    Raises
    ------
    SceneError : the scene cannot be built.
    """
    scene = completed(scene)
    if PLAIN and not whole:
        return ReferenceRun({}, "no reference run: the kernels are plain Python here (--reference whole makes it)")
    step = suggested_step(scene)
    n = max(1, round(scene.time.end / step))
    if whole:
        n_step = n
    else:
        n_step = _within(Prediction(discretise(scene)), n)
    histories = {name: _history(name, law, laws or {}, scene.time.end) for name, law in inputs_of(scene).items()}
    run = _solved(scene, histories, [scene.time.end * i / n for i in range(n_step + 1)])
    if len(run.rows) < 2:
        return ReferenceRun({}, f"no reference run: {run.complaint}")
    if whole:
        every = 1
    else:
        every = -(-len(run.rows) * len(run.names) // MOST_NUMBERS)
    return _files(scene, run, n, every)


def _within(cost: Prediction, n: int) -> int:
    """Steps of n that stay within ``LONGEST``, one at least."""
    # the march goes on for what the set-up leaves of the time
    return min(n, max(1, int(n * (LONGEST - cost.operators) / cost.march)))


def _history(name: str, law: InputLaw, laws: Mapping[str, TimeLaw], end: float) -> TimeLaw:
    effective = laws.get(name, law)
    if not isinstance(effective, InputLaw):
        return effective
    start = law.start_value
    # names of loads alone have no dot
    return TableLaw(times=(0.0, end), values=(start, start if "." in name else 1.0))


def _solved(scene: Scene, laws: Mapping[str, TimeLaw], times: Sequence[float]) -> _Run:
    session = Session(scene, Settings(keep=False))
    names = [name for name in session.outputs if not name.startswith(_ROUND_OFF)]
    values = {name: law.sample(np.array(times)) for name, law in laws.items()}
    # no step follows the last point
    rates = {name: np.append(np.diff(column) / np.diff(times), 0.0) for name, column in values.items()}
    rows: list[list[float]] = []
    complaint = ""
    for i, t in enumerate(times):
        # the step that ends here starts with value and rate of the point before
        for name in laws:
            session.set_load(name, float(values[name][max(i - 1, 0)]), float(rates[name][max(i - 1, 0)]))
        if i == 0:
            session.initialize()
        elif not (report := session.step(times[i - 1], t - times[i - 1])):
            complaint = report.message
            break
        rows.append([t, *session.values(names)])
    session.close()
    inputs = {
        input_variable(name, what): column[name][: len(rows)].tolist()
        for name in laws
        for what, column in (("value", values), ("rate", rates))
    }
    return _Run(list(times[: len(rows)]), names, rows, inputs, complaint)


def _files(scene: Scene, run: _Run, n: int, every: int) -> ReferenceRun:
    stem, last = identifier_of(scene), len(run.rows) - 1
    rows = [row for i, row in enumerate(run.rows) if i % every == 0 or i == last]
    stop, step = run.times[-1], suggested_step(scene)
    extent = f"{last} steps of {step:g} s to {stop:g} s"
    if last < n:
        why = run.complaint or f"the whole of it was foreseen to take more than {LONGEST:g} s of CPU time"
        extent += f", the beginning of the default experiment of {scene.time.end:g} s: {why}"
    note = "Inputs that had a law in the scene follow it; other loads rise in a straight line from their start value\n"
    note += "to 1 (the amplitude of the scene), all other inputs keep their start value.\n"
    program = f"latin_fmu {latin_fmu.__version__}"
    text = _TEXT.format(
        version=VERSION,
        folder=FOLDER,
        stem=stem,
        inputs=_INPUTS.format(stem=stem) if run.inputs else "",
        rows=len(rows),
        points=last + 1,
        extent=f"Experiment: {extent}.",
        note=note if run.inputs else "",
        program=program,
    )
    files = {f"{stem}_ref.csv": _table(["time", *run.names], rows)}
    related = [(f"{stem}_ref.csv", "text/csv", "result", "Outputs of the experiment")]
    files[f"{stem}.ssv"] = scene_parameters(scene)
    related.append((f"{stem}.ssv", MIME, "parameter", "Values of the scene"))
    if run.inputs:
        files[f"{stem}_in.csv"] = _table(["time", *run.inputs], zip(run.times, *run.inputs.values(), strict=True))
        related.append((f"{stem}_in.csv", "text/csv", "other", "Inputs of the experiment"))
    files[f"{stem}.exp"] = _experiments(scene, stop, step, bool(run.inputs))
    about = "application/x-ma-hs-experiments", "experiment/smoke-test", "The default experiment, with its results"
    related.append((f"{stem}.exp", *about))
    files["fmi-ls-manifest.xml"] = _manifest(related)
    inside = {f"{FOLDER}/{name}": content for name, content in files.items()}
    return ReferenceRun({**inside, NOTE: text.encode()}, f"reference run: {extent}")


def _manifest(related: Iterable[tuple[str, str, str, str]]) -> bytes:
    register_namespace("fmi-ls", _NAMESPACE)
    facts = {"name": NAME, "version": VERSION, "description": _DESCRIPTION}
    root = Element("fmiReferences", {f"{{{_NAMESPACE}}}fmi-ls-{key}": value for key, value in facts.items()})
    for source, kind, role, text in related:
        file = SubElement(root, "Related", {"type": kind, "source": source, "role": role, "description": text})
        label, meaning = _LABELS.get(role, _LABELS["experiment"])
        SubElement(file, "Label", {"name": label, "description": meaning})
    return xml_bytes(root)


def scene_parameters(scene: Scene) -> bytes:
    """Parameter set of the numbers that a host may set before initialization, with their values in a scene."""
    kinds = {"real": "Real", "integer": "Integer"}
    table = [v for v in scalar_table(scene) if v.causality == "parameter" and v.kind in kinds]
    chosen = [v for v in table if v.name not in CONSTANTS]
    units = scene.unit_system
    rows = [(v.name, kinds[v.kind], v.start or 0, None if v.unit is None else unit_name(units, v.unit)) for v in chosen]
    return parameter_set(identifier_of(scene), rows, unit_definitions(units, (v.unit for v in chosen)))


def _experiments(scene: Scene, stop: float, step: float, inputs: bool) -> bytes:
    stem = identifier_of(scene)
    root = Element("Experiments", {"name": stem, "description": f"Default experiment of {scene.name}"})
    numbers = {"startTime": 0.0, "stopTime": stop, "tolerance": accuracy_of(scene.solver.tolerance), "stepSize": step}
    experiment = SubElement(root, "Experiment", {"name": "default", **{k: repr(v) for k, v in numbers.items()}})
    if inputs:
        SubElement(experiment, "Stimuli", {"source": f"{stem}_in.csv"})
    SubElement(experiment, "References", {"source": f"{stem}_ref.csv"})
    return xml_bytes(root)


def _table(header: Sequence[str], rows: Iterable[Sequence[float]]) -> bytes:
    lines = [",".join(header), *(",".join(repr(float(value)) for value in row) for row in rows)]
    return ("\n".join(lines) + "\n").encode()
