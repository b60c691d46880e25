"""FMUs that need no Python: the functions of the FMI in C, in the library of the kernels, on the image of a run.

The C files beside this one, and those of ``bridge`` but ``python.c``, are linked into the library of the kernels
(``latin_fmu.aot``). An FMU carries that library, the image of the run (``latin_fmu.cosim.communication``) and the table
of its variables, written here:

=================  ================================================================================================
words of 8 bytes   content (numbers little-endian; places count words from the start of the file)
=================  ================================================================================================
0                  ``LATINVAR``
1 to ``HEADER``    ``HEADER`` in its order: checksum of all that follows, length, token, checksum of the image, ...
then               a row of words for each variable, of 4 for each input, of 3 for each whole number of the state,
                   of 4 for each part of a record of the results (``results``)
then               texts, each with a zero behind it; rows refer to them by bytes from their start
=================  ================================================================================================
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from latin_fmu.aot import linking
from latin_fmu.compiled import library
from latin_fmu.cosim.communication import CommunicationRun, write
from latin_fmu.cosim.variable import Variable, input_of, input_variable
from latin_fmu.cosim.variables import inputs_of, table_of
from latin_fmu.errors import InputError, Problem
from latin_fmu.scene.schema import Scene

from .results import RecordPart, results_file

HEADER: Final = (
    *("magic", "checksum", "length", "token", "image", "n_variable", "variables", "n_input", "inputs"),
    *(
        "texts",
        "mode",
        "rule",
        "end",
        "file",
        "window_size",
        "history_size",
        "solver",
        "tolerance",
        "n_whole",
        "wholes",
        "results",
        "n_record",
        "records",
        "results_sum",
    ),
)
"""Words of the header, in the order of the names T_... of compiled.h."""
_KINDS: Final = ("real", "integer", "string", "count")
_ROLES: Final = (
    *("time", "constant", "parameter", "value", "rate", "output", "text", "history_time", "history"),
    *("window_count", "window_time", "window", "points"),
)
_NAMED: Final = {
    "mode": "mode",
    "rule": "inputInterpolation",
    "end": "endTime",
    "file": "historyFile",
    "window_size": "window.size",
    "history_size": "history.size",
    "tolerance": "tolerance",
    "results": "resultsFile",
}
_CONSTANTS: Final = ("timeStep", "tolerance", "maxIterations")
_LEFT_OUT: Final = ("estimateError",)
_MIXERS: Final = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)


@dataclass(frozen=True)
class CompiledRun:
    """What the FMU of a scene carries: its variables, the files of its resources, its token."""

    table: tuple[Variable, ...]
    image: bytes
    variables: bytes
    results: bytes
    token: str


def compiled_run(scene: Scene, fmi: str) -> CompiledRun:
    """The compiled FMU of a scene with names for its interfaces.

    Raises
    ------
    InputError : the kernels do not hold something of this scene; SceneError : it cannot be built.
    """
    run = CommunicationRun(scene)
    image = write(run)
    n_point = {unit.name: unit.geometry.n_point for unit in run.run.assembly.interfaces}
    table = tuple(_variables(table_of(scene, n_point if fmi == "3" else None)))
    text = hashlib.sha256(image + repr((fmi, table)).encode()).hexdigest()[:32]
    token = f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:]}}}"
    outputs = [v.name for v in table if v.causality == "output" and not v.is_array and v.name != "window.count"]
    if int(run.image.run[0]["n_output"]) != len(outputs):
        raise RuntimeError(f"{len(outputs)} outputs in the table, {int(run.image.run[0]['n_output'])} in the image")
    places = {name: i for i, name in enumerate(outputs)} | dict(_points(run))
    results, record = results_file(run, table, places)
    return CompiledRun(table, image, _table(table, scene, run, (image, results), token, places, record), results, token)


def libraries() -> dict[str, bytes]:
    """Libraries of the kernels with the functions of the FMI, by target.

    Raises
    ------
    InputError : there is none that was made from these sources.
    """
    known = linking.functions_digest().encode()
    made = {path.stem.removeprefix("_kernels-"): path.read_bytes() for path in library.shipped()}
    fit = {target: content for target, content in made.items() if known in content}
    if not fit:
        remedy = (
            "install a wheel, or, in a source tree, run: python -m latin_fmu.aot linux-x86_64 windows-x86_64 (of "
            f"{', '.join(linking.TARGETS)} those on which it is to run)"
        )
        problem = Problem("--compiled", "the library of compiled kernels is missing here", None, None, remedy)
        raise InputError([problem], "the FMU cannot be compiled")
    return fit


# -- variables ----------------------------------------------------------------------------------------------------
def _variables(table: Sequence[Variable]) -> Iterator[Variable]:
    """The variables of the table that a compiled FMU has."""
    for variable in table:
        if variable.name in _LEFT_OUT:
            continue
        if variable.name in _CONSTANTS:
            about = f"{variable.description.partition(',')[0].partition(';')[0]}; fixed when the FMU is made"
            yield replace(variable, causality="local", variability="constant", description=about)
        elif variable.name == "historyFile":
            yield replace(variable, description=variable.description.replace("CSV or netCDF file", "CSV file"))
        else:
            yield variable


Role = tuple[str, int, int]


def _role(variable: Variable, places: Mapping[str, int], inputs: Sequence[str]) -> Role:
    """Role of a variable, its place, and the width of a row of a window."""
    name = variable.name
    if name == "time":
        return "time", 0, 0
    if variable.variability == "constant" or name in _CONSTANTS:
        return "constant", 0, 0
    if variable.kind == "string":
        return "text", 0, 0
    if variable.causality == "input":
        of, what = input_of(name)
        return what, inputs.index(of), 0
    if name == "history.time":
        return "history_time", len(inputs), 0
    if variable.is_array and variable.causality == "parameter":
        return "history", inputs.index(input_of(name)[0]), 0
    if name in ("window.count", "window.time"):
        return name.replace(".", "_"), 0, 0
    if variable.causality != "output":
        return "parameter", 0, 0
    if not variable.is_array:
        return "output", places[name], 0
    _, interface, group, what = name.split(".")
    if group == "points":
        return "points", places[name], 0
    scalar = f"interface.{interface}.{what}"
    return ("window", places[scalar], 1) if scalar in places else ("window", places[f"{scalar}[1]"], 3)


def _points(run: CommunicationRun) -> Iterator[tuple[str, int]]:
    """Arrays at the points by name, and where they begin among the fields of the points."""
    at = 0
    for unit in run.run.assembly.interfaces:
        sizes = {"traction": 3, "velocity": 6, **({"gap": 1, "status": 1} if unit.behaviour.opens else {})}
        for what, size in sizes.items():
            yield f"interface.{unit.name}.points.{what}", at
            at += size * unit.geometry.n_point


# -- the file -----------------------------------------------------------------------------------------------------
class _Texts:
    """Texts one after the other, and where each begins."""

    def __init__(self) -> None:
        self.content = b""

    def place(self, text: str) -> int:
        """Where a text begins, in bytes."""
        begin = len(self.content)
        self.content += text.encode() + b"\0"
        return begin


def _table(
    table: Sequence[Variable],
    scene: Scene,
    run: CommunicationRun,
    files: tuple[bytes, bytes],
    token: str,
    places: Mapping[str, int],
    record: Sequence[RecordPart],
) -> bytes:
    """The file of the variables; ``files``: image and beginning of the results."""
    texts, references = _Texts(), {v.name: i for i, v in enumerate(table)}
    inputs = list(inputs_of(scene))
    words: list[int | float] = [0] * len(HEADER)
    begins = dict.fromkeys(HEADER, 0) | {"variables": len(words)}
    for variable in table:
        words += _row(variable, _role(variable, places, inputs), texts, references)
    begins["inputs"] = len(words)
    for name in inputs:
        value, rate = (input_variable(name, what) for what in ("value", "rate"))
        words += texts.place(name), texts.place(value), texts.place(rate), references[value]
    begins["wholes"] = len(words)
    wholes = list(_whole_numbers(run))
    words += [number for row in wholes for number in row]
    begins["records"] = len(words)
    words += [number for part in record for number in part.row()]
    begins |= {
        "n_variable": len(table),
        "n_input": len(inputs),
        "n_whole": len(wholes),
        "n_record": len(record),
        "texts": len(words),
    }
    begins |= {key: references.get(name, -1) for key, name in _NAMED.items()}
    begins |= {"token": texts.place(token), "solver": places["solver.iterations"], "image": checksum(files[0])}
    begins["results_sum"] = checksum(files[1])
    content = texts.content + bytes(-len(texts.content) % 8)
    begins["length"] = len(words) + len(content) // 8
    words[: len(HEADER)] = [begins[name] for name in HEADER]
    body = b"".join(_word(word) for word in words[2:]) + content
    return b"LATINVAR" + _word(checksum(body)) + body


def _word(number: int | float) -> bytes:
    if isinstance(number, float):
        return struct.pack("<d", number)
    return struct.pack("<Q", number % 2**64)


def _row(variable: Variable, role: Role, texts: _Texts, references: Mapping[str, int]) -> list[int | float]:
    sizes = [size if isinstance(size, int) else -1 - references[size] for size in variable.dimensions]
    start = texts.place(str(variable.start or "")) if variable.kind == "string" else float(variable.start or 0.0)
    kind, place, width = _ROLES.index(role[0]), role[1], role[2]
    about = [texts.place(variable.name), _KINDS.index(variable.kind), kind, place, width, len(sizes)]
    return [*about, *sizes, *[0] * (3 - len(sizes)), start]


def _whole_numbers(run: CommunicationRun) -> Iterator[tuple[int, float, float]]:
    """Numbers of the state that the kernels take for whole ones: place, least and largest."""
    record = run.image.run[0]
    last = int(record["law_end"])
    yield int(record["progress"]), 0.0, float(last) if last >= 0 else 2.0**53
    most = float(record["max_iterations"])
    yield int(record["finish"]), -most, most
    for row in run.image.classes:
        yield int(row["rest"]), 0.0, 1.0
        if row["accounted"]:
            yield int(row["turn"]), 0.0, 2.0


def checksum(content: bytes) -> int:
    """The checksum of image.c; zeros stand behind the content up to a whole number of words."""
    words = np.frombuffer(content + bytes(-len(content) % 8), "<u8")
    first, second, third = (np.uint64(mixer) for mixer in _MIXERS)
    mixed = words + np.arange(1, len(words) + 1, dtype=np.uint64) * first
    mixed = (mixed ^ mixed >> np.uint64(30)) * second
    mixed = (mixed ^ mixed >> np.uint64(27)) * third
    mixed ^= mixed >> np.uint64(31)
    return (int(mixed.sum(dtype=np.uint64)) + len(words)) % 2**64
