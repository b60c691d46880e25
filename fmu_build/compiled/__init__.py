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
                   of 4 for each part of a record of the results file (``RecordPart``), of 4 for each point at which
                   a rigid body is pressed at the start (``_pressed_points``)
then               texts, each with a zero behind it; rows refer to them by bytes from their start
=================  ================================================================================================
"""

from __future__ import annotations

import hashlib
import re
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import Final

import netCDF4
import numpy as np

import latin_fmu
from latin_fmu.aot import linking
from latin_fmu.compiled import library
from latin_fmu.cosim.communication import CommunicationRun, write
from latin_fmu.cosim.input_table import acting_of, inputs_of
from latin_fmu.cosim.output_table import AT_POINTS
from latin_fmu.cosim.variable import Variable, input_of, input_variable
from latin_fmu.cosim.variable import Variable as FmiVariable
from latin_fmu.cosim.variables import table_of
from latin_fmu.errors import NeedsPythonError, Problem
from latin_fmu.latin.initial_conditions import closed_points
from latin_fmu.latin.interface_rows import InterfaceRows
from latin_fmu.results.dataset import interface_group
from latin_fmu.results.groups import SCHEMA_VERSION, StoredGroup, StoredVariable, in_units
from latin_fmu.results.quantities import AXES, BOLT, ENERGY, LABELS, SENSOR, named
from latin_fmu.scene.schema import Scene

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
        "unloaded",
        "n_pressed",
        "pressed",
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
    NeedsPythonError : the kernels do not hold something of this scene; SceneError : it cannot be built.
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


def libraries(portable: bool = False) -> dict[str, bytes]:
    """Libraries of the kernels with the functions of the FMI, by platform; ``portable`` : those that need no AVX2.

    Raises
    ------
    NeedsPythonError : there is none that was made from these sources.
    """
    known, end = linking.functions_digest().encode(), "-portable" if portable else ""
    made = {path.stem.removeprefix("_kernels-"): path for path in library.shipped()}
    wanted = {name.removesuffix(end): made[name] for name in made if name.endswith("-portable") == portable}
    fit = {name: content for name, path in wanted.items() if known in (content := path.read_bytes())}
    if not fit:
        targets = " ".join(f"{name}{end}" for name in ("linux-x86_64", "windows-x86_64"))
        known_targets = ", ".join(name for name in linking.TARGETS if name.endswith("-portable") == portable)
        remedy = (
            f"in a source tree run: python -m latin_fmu.aot {targets} (of {known_targets} those on which it is to run)"
        )
        if not portable:
            remedy = f"install a wheel, or, {remedy}"
        problem = Problem("compiled FMU", "the library of compiled kernels is missing here", None, None, remedy)
        raise NeedsPythonError([problem], "the FMU cannot be compiled")
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
        return "history_time", len(inputs), 0  # behind those of the inputs
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
    # components follow each other
    return ("window", places[scalar], 1) if scalar in places else ("window", places[f"{scalar}[1]"], 3)


def _points(run: CommunicationRun) -> Iterator[tuple[str, int]]:
    """Arrays at the points by name, and where they begin among the fields of the points."""
    at = 0
    for unit in run.run.assembly.interfaces:
        for what, (_, _, shape) in AT_POINTS.items():
            if len(shape) > 1 or unit.behaviour.opens:
                yield f"interface.{unit.name}.points.{what}", at
                at += prod(size or unit.geometry.n_point for size in shape)


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
    begins["pressed"] = len(words)
    pressed = list(_pressed_points(run))
    words += [number for place, size, mu, name in pressed for number in (place, size, mu, texts.place(name))]
    begins |= {
        "n_variable": len(table),
        "n_input": len(inputs),
        "n_whole": len(wholes),
        "n_record": len(record),
        "n_pressed": len(pressed),
        "texts": len(words),
    }
    begins |= {key: references.get(name, -1) for key, name in _NAMED.items()}
    begins |= {"token": texts.place(token), "solver": places["solver.iterations"], "image": checksum(files[0])}
    begins["results_sum"] = checksum(files[1])
    begins["unloaded"] = int(not acting_of(scene))
    content = texts.content + bytes(-len(texts.content) % 8)  # whole words
    begins["length"] = len(words) + len(content) // 8
    words[: len(HEADER)] = [begins[name] for name in HEADER]
    body = b"".join(_word(word) for word in words[2:]) + content  # all but magic and checksum
    return b"LATINVAR" + _word(checksum(body)) + body


def _word(number: int | float) -> bytes:
    if isinstance(number, float):
        return struct.pack("<d", number)
    return struct.pack("<Q", number % 2**64)  # below 0: two's complement


def _row(variable: Variable, role: Role, texts: _Texts, references: Mapping[str, int]) -> list[int | float]:
    # below 0: the size is the value of a variable
    sizes = [size if isinstance(size, int) else -1 - references[size] for size in variable.dimensions]
    start = texts.place(str(variable.start or "")) if variable.kind == "string" else float(variable.start or 0.0)
    kind, place, width = _ROLES.index(role[0]), role[1], role[2]
    about = [texts.place(variable.name), _KINDS.index(variable.kind), kind, place, width, len(sizes)]
    return [*about, *sizes, *[0] * (3 - len(sizes)), start]


def _whole_numbers(run: CommunicationRun) -> Iterator[tuple[int, float, float]]:
    """Numbers of the state that the kernels take for whole ones: place, least and largest."""
    record = run.image.run[0]
    last = int(record["law_end"])
    yield int(record["progress"]), 0.0, float(last) if last >= 0 else 2.0**53  # whole numbers are exact up to there
    most = float(record["max_iterations"])
    # negative where no step ended the last instant (``newton.keep_course``)
    yield int(record["finish"]), -most, most
    for row in run.image.classes:
        yield int(row["rest"]), 0.0, 1.0
        if row["accounted"]:
            yield int(row["turn"]), 0.0, 2.0


def _pressed_points(run: CommunicationRun) -> Iterator[tuple[int, int, float, str]]:
    """Points at which a rigid body is pressed at the start: place of their traction, number of its components,
    coefficient of friction, interface. The initial state is a linear function of the inputs while none slides or lifts.
    """
    assembly, at = run.run.assembly, int(run.image.run[0]["f_hat"])
    for g, point in sorted(closed_points(assembly)):
        group = assembly.layout.groups[g]
        channel, size = group.start + point * group.n_component, group.n_component
        if run.run.f_hat[channel] < 0.0:
            name = next(
                assembly.interfaces[i].name for i, own in group.members.items() if own.start <= point < own.stop
            )
            yield at + channel, size, float(group.parameters[point, 0]) if size > 1 else 0.0, name


def checksum(content: bytes) -> int:
    """The checksum of image.c; zeros stand behind the content up to a whole number of words."""
    words = np.frombuffer(content + bytes(-len(content) % 8), "<u8")
    first, second, third = (np.uint64(mixer) for mixer in _MIXERS)
    mixed = words + np.arange(1, len(words) + 1, dtype=np.uint64) * first
    mixed = (mixed ^ mixed >> np.uint64(30)) * second
    mixed = (mixed ^ mixed >> np.uint64(27)) * third
    mixed ^= mixed >> np.uint64(31)
    return (int(mixed.sum(dtype=np.uint64)) + len(words)) % 2**64


# -- the results file ---------------------------------------------------------------------------------------------
# netCDF-3 has no groups: ``interfaces.crush.traction`` stands for the variable ``traction`` of the group
# ``interfaces/crush``; its dimensions and the attributes of groups are named in the same way. An instant is a record:
# the time, scalar outputs, and fields at the points (``cosim.communication``, action FIELDS).
_PARTS: Final = ("time", "output", "field")
"""What a part of a record is, in the order of the names R_... of compiled.h."""
_POINTS: Final = {"traction": "traction", "velocity": "velocity", "gap": "gap", "contact_status": "status"}
"""Names in the results of what ``interface.NAME.points`` has."""
_COMPONENT: Final = re.compile(r"(.*)\[([123])\]")
_FAMILIES: Final = {"sensor": ("sensors", SENSOR), "bolt": ("bolts", BOLT), "energy": ("energy", ENERGY)}
"""Groups of the results by the first part of the name of an output, and what their variables mean."""


@dataclass(frozen=True)
class RecordPart:
    """A variable of the file in a record.

    kind : of ``_PARTS``. place, count : of its numbers among outputs, or fields. whole : it has integers of 4 bytes.
    """

    kind: str
    place: int
    count: int
    whole: bool

    def row(self) -> tuple[int, int, int, int]:
        """Words in the table of variables."""
        return _PARTS.index(self.kind), self.place, self.count, int(self.whole)


def results_file(
    run: CommunicationRun, table: Sequence[FmiVariable], places: Mapping[str, int]
) -> tuple[bytes, list[RecordPart]]:
    """The file without records, and the parts of a record in the order of the file.

    Parameters
    ----------
    table : variables of the FMU. places : of scalar outputs in a row, of arrays at points among the fields, by name.
    """
    root = {
        "source": f"latin_fmu {latin_fmu.__version__}: LATIN method, compiled FMU",
        "scene_name": run.scene.name,
        "schema_version": SCHEMA_VERSION,
        "unit_system": run.scene.unit_system.name,
    }
    time = StoredGroup.of((), named(LABELS, {"time": np.zeros(1)}), root)
    groups = in_units({"/": time, **dict(_interfaces(run)), **dict(_outputs(table))}, run.scene.unit_system)
    parts: dict[str, RecordPart] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "results.nc"
        with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as file:
            file.createDimension("time", None)
            for of_group, group in groups.items():
                parts |= _add_group(file, of_group, group, places)
        whole = path.read_bytes()
    record = sum(part.count * (4 if part.whole else 8) for part in parts.values())
    # the file has one record, which is cut off; the number of records stands behind the magic number
    return whole[:4] + bytes(4) + whole[8:-record], list(parts.values())


def _add_group(
    file: netCDF4.Dataset, path: str, group: StoredGroup, places: Mapping[str, int]
) -> dict[str, RecordPart]:
    """Write a group; its variables over time in their order."""
    parts: dict[str, RecordPart] = {}
    attributes = {**group.attrs, "coordinates": " ".join(sorted(group.labels))}
    for name, value in attributes.items():
        file.setncattr(_flat(path, name), value)
    for name, variable in group.variables.items():
        # one coordinate for all groups
        if name == "time" and path != "/":
            continue
        if "time" in variable.dims:
            source = ("time", 0) if name == "time" else _source(path, name, places)
            if source is None:
                continue
            whole, count = variable.values.dtype.kind in "iu", variable.values[0].size
            parts[_flat(path, name)] = RecordPart(*source, count, whole)
        _add_variable(file, path, name, variable)
    return parts


def _flat(path: str, name: str) -> str:
    """Name in the file of what a group has."""
    return ".".join([*(part for part in path.split("/") if part), name])


def _add_variable(file: netCDF4.Dataset, path: str, name: str, variable: StoredVariable) -> None:
    """Write a variable with its dimensions; texts as characters along a dimension of their own."""
    values = np.asarray(variable.values)
    dims = ["time" if dim == "time" else _flat(path, dim) for dim in variable.dims]
    if values.dtype.kind in "OUS":
        values = np.char.encode(values.astype(str), "utf-8")
        dims.append(f"text{values.dtype.itemsize}")  # characters are a dimension in netCDF-3
        values = values.view("S1").reshape(*values.shape, -1)
    elif values.dtype.kind in "iub":
        values = values.astype("i4")  # netCDF-3 has no integers of 8 bytes
    for dim, size in zip(dims, values.shape, strict=True):
        if dim not in file.dimensions:
            file.createDimension(dim, size)
    made = file.createVariable(_flat(path, name), values.dtype, dims)
    if values.dtype.kind == "S":
        made.setncattr("_Encoding", "utf-8")
        made.set_auto_chartostring(False)
    made[...] = values
    for key, value in variable.attrs.items():
        made.setncattr(key, value.astype("i4") if isinstance(value, np.ndarray) and value.dtype.kind == "i" else value)


def _interfaces(run: CommunicationRun) -> Iterator[tuple[str, StoredGroup]]:
    """Groups of the interfaces in the present state, one instant."""
    assembly, image = run.run.assembly, run.image
    rows = InterfaceRows(assembly, np.zeros((1, InterfaceRows.width_of(assembly))))
    rows.keep(image, None, 0, 1, 0)
    for name, history in rows.histories(1, None).items():
        group = interface_group(history, np.zeros(1))
        for of_the_whole in ("peak_force", "peak_force_raw"):
            del group.variables[of_the_whole]
        yield f"/interfaces/{name}", group


def _outputs(table: Sequence[FmiVariable]) -> Iterator[tuple[str, StoredGroup]]:
    """Groups of sensors, bolts and energies from the scalar outputs, one instant."""
    names = {
        _COMPONENT.sub(r"\1", v.name): 3 if _COMPONENT.fullmatch(v.name) else 1
        for v in table
        if v.causality == "output" and not v.is_array
    }
    made: dict[str, dict[str, np.ndarray]] = {}
    for name, n in names.items():
        family, *own, what = name.split(".") if "." in name else ("", name)
        if family in _FAMILIES and what in _FAMILIES[family][1]:
            path = "/".join(["", _FAMILIES[family][0], *own])
            made.setdefault(path, {})[what] = np.zeros((1, 3) if n == 3 else 1)
    meanings = dict(_FAMILIES.values())
    for path, arrays in made.items():
        labels = {"component": AXES} if any(values.ndim > 1 for values in arrays.values()) else {}
        yield path, StoredGroup.of(named(meanings[path.split("/")[1]], arrays), named(LABELS, labels))


def _source(path: str, name: str, places: Mapping[str, int]) -> tuple[str, int] | None:
    """Where a variable of a record comes from; None where C has no such numbers."""
    family, _, own = path.removeprefix("/").partition("/")
    prefix = {known: key for key, (known, _) in _FAMILIES.items()} | {"interfaces": "interface"}
    stem = ".".join(part for part in (prefix[family], own) if part)
    if family == "interfaces" and name in _POINTS:
        return "field", places[f"{stem}.points.{_POINTS[name]}"]
    for known in (f"{stem}.{name}", f"{stem}.{name}[1]"):
        if known in places:
            return "output", places[known]
    return None
