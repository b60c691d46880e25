"""The table of variables of the runtime in C as one file: what it sets and reads, by value reference.

=================  ================================================================================================
words of 8 bytes   content (numbers little-endian; places count words from the start of the file)
=================  ================================================================================================
0                  ``LATINVAR``
1 to ``HEADER``    ``HEADER`` in its order: checksum of all that follows, length, token, checksum of the image, ...
then               a row of words for each variable, of 4 for each input, of 3 for each whole number of the state,
                   of 4 for each part of a record of the results file (``RecordPart``), of 5 for each point at which
                   a rigid body is pressed at the start (``_pressed_points``)
then               texts, each with a zero behind it; rows refer to them by bytes from their start
=================  ================================================================================================
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Final

import numpy as np

from ..latin.initial_conditions import closed_points
from ..latin.run_image import friction_column
from ..scene.schema import Scene
from .communication import CommunicationRun
from .input_table import acting_of, inputs_of
from .output_table import AT_POINTS
from .variable import Variable, input_of, input_variable

HEADER: Final = (
    "magic",
    "checksum",
    "length",
    "token",
    "image",
    "n_variable",
    "variables",
    "n_input",
    "inputs",
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
)
"""Words of the header, in the order of the names T_... of runtime/runtime.h."""
_KINDS: Final = ("real", "integer", "string", "count")
_ROLES: Final = (
    *("time", "constant", "parameter", "value", "rate", "output", "text", "history_time", "history"),
    *("window_count", "window_time", "window", "points", "vector", "tunable"),
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
PARTS: Final = ("time", "output", "field")
"""What a part of a record is, in the order of the names R_... of runtime/runtime.h."""
_MIXERS: Final = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)


# -- variables ----------------------------------------------------------------------------------------------------
Role = tuple[str, int, int]


def _role(variable: Variable, places: Mapping[str, int], inputs: Sequence[str]) -> Role:
    """Role of a variable, its place, and the width of a row of a window."""
    name = variable.name
    if name == "time":
        return "time", 0, 0
    if variable.variability == "constant":
        return "constant", 0, 0
    if variable.kind == "string":
        return "text", 0, 0
    if variable.variability == "tunable":
        return "tunable", 0, 0
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
    family, interface, group, what = name.split(".")
    if group == "vector":
        return (
            "vector",
            min(at for number, at in places.items() if number.startswith(f"{family}.{interface}.{what}[")),
            0,
        )
    if group == "points":
        return "points", places[name], 0
    scalar = f"interface.{interface}.{what}"
    # components follow each other
    if scalar in places:
        return ("window", places[scalar], 1)
    return ("window", places[f"{scalar}[1]"], 3)


def output_places(table: Sequence[Variable], run: CommunicationRun) -> dict[str, int]:
    """Place of every scalar output in a row of outputs, of every array at points among their fields, by name.

    Raises
    ------
    RuntimeError : the table has other outputs than the run, an error of this package.
    """
    outputs = [v.name for v in table if v.causality == "output" and not v.is_array and v.name != "window.count"]
    n = int(run.image.run[0]["n_output"])
    if n != len(outputs):
        raise RuntimeError(f"{len(outputs)} outputs in the table, {n} in the image")
    return {name: i for i, name in enumerate(outputs)} | dict(_points(run))


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


@dataclass(frozen=True)
class RecordPart:
    """A variable of the results file in a record.

    kind : of ``PARTS``. place, count : of its numbers among outputs, or fields. whole : it has integers of 4 bytes.
    """

    kind: str
    place: int
    count: int
    whole: bool

    def row(self) -> tuple[int, int, int, int]:
        """Words in the table of variables."""
        return PARTS.index(self.kind), self.place, self.count, int(self.whole)


@dataclass(frozen=True)
class Identity:
    """What an instance and its states belong to: a token, checksums of image and results, 0 where there are no files;
    the parts of a record of the results; whether the laws of the scene go on beyond its end."""

    token: str
    image: int = 0
    results: int = 0
    record: Sequence[RecordPart] = ()
    endless: bool = False


def table_file(table: Sequence[Variable], scene: Scene, run: CommunicationRun, identity: Identity) -> bytes:
    """The file of the variables of a run; ``table`` : its variables, their place being their value reference."""
    texts, references = _Texts(), {v.name: i for i, v in enumerate(table)}
    inputs, places = list(inputs_of(scene)), output_places(table, run)
    words: list[int | float] = [0] * len(HEADER)
    begins = dict.fromkeys(HEADER, 0) | {"variables": len(words)}
    tuned = _tuned_places(run)
    for variable in table:
        words += _row(variable, _role(variable, places, inputs), texts, references, tuned.get(variable.name))
    begins["inputs"] = len(words)
    for name in inputs:
        value, rate = (input_variable(name, what) for what in ("value", "rate"))
        words += texts.place(name), texts.place(value), texts.place(rate), references[value]
    begins["wholes"] = len(words)
    wholes = list(_whole_numbers(run, identity.endless))
    words += [number for row in wholes for number in row]
    begins["records"] = len(words)
    words += [number for part in identity.record for number in part.row()]
    begins["pressed"] = len(words)
    pressed = list(_pressed_points(run))
    words += [number for place, size, mu, at, name in pressed for number in (place, size, mu, texts.place(name), at)]
    begins |= {
        "n_variable": len(table),
        "n_input": len(inputs),
        "n_whole": len(wholes),
        "n_record": len(identity.record),
        "n_pressed": len(pressed),
        "texts": len(words),
        "token": texts.place(identity.token),
        "solver": places["solver.iterations"],
        "image": identity.image,
        "results_sum": identity.results,
        "unloaded": int(not acting_of(scene)),
    }
    begins |= {key: references.get(name, -1) for key, name in _NAMED.items()}
    content = texts.content + bytes(-len(texts.content) % 8)  # whole words
    begins["length"] = len(words) + len(content) // 8
    words[: len(HEADER)] = [begins[name] for name in HEADER]
    body = b"".join(_word(word) for word in words[2:]) + content  # all but magic and checksum
    return b"LATINVAR" + _word(checksum(body)) + body


def _word(number: int | float) -> bytes:
    if isinstance(number, float):
        return struct.pack("<d", number)
    return struct.pack("<Q", number % 2**64)  # below 0: two's complement


def _row(
    variable: Variable, role: Role, texts: _Texts, references: Mapping[str, int], tuned: tuple[int, int, int] | None
) -> list[int | float]:
    """Words of a variable; ``tuned`` : of one that is tunable, place, number of points and numbers between them."""
    # below 0: the size is the value of a variable
    sizes = [size if isinstance(size, int) else -1 - references[size] for size in variable.dimensions]
    # words of other bits: the place of a text is a whole number
    start: int | float
    if variable.kind == "string":
        start = texts.place(str(variable.start or ""))
    else:
        start = float(variable.start or 0.0)
    kind = _ROLES.index(role[0])
    place = role[1]
    width = role[2]
    count = len(sizes)
    if tuned is not None:
        place, width, *sizes = tuned
    elif role[0] == "tunable":  # its law is Python's, which has its own number
        kind = _ROLES.index("constant")
    about = [texts.place(variable.name), _KINDS.index(variable.kind), kind, place, width, count]
    return [*about, *sizes, *[0] * (3 - len(sizes)), start]


def _tuned_places(run: CommunicationRun) -> dict[str, tuple[int, int, int]]:
    """Places of the coefficients of friction in the moving block, by variable: the first, points, numbers from point to
    point."""
    assembly, found = run.run.assembly, dict[str, tuple[int, int, int]]()
    for g, group in enumerate(assembly.layout.groups):
        column, row = friction_column(group), run.image.groups[g]
        if column is None or not row["tunable"]:
            continue
        stride = group.parameters.shape[1]
        for i, span in group.members.items():
            first = int(row["tuned"]) + span.start * stride + column
            name = f"interface.{assembly.interfaces[i].name}.friction_coefficient"
            found[name] = first, span.stop - span.start, stride
    return found


def _whole_numbers(run: CommunicationRun, endless: bool) -> Iterator[tuple[int, float, float]]:
    """Numbers of the state that the kernels take for whole ones: place, least and largest."""
    record = run.image.run[0]
    if endless:
        last = -1
    else:
        last = int(record["law_end"])
    yield int(record["progress"]), 0.0, float(last) if last >= 0 else 2.0**53  # whole numbers are exact up to there
    most = float(record["max_iterations"])
    # negative where no step ended the last instant (``newton.keep_course``)
    yield int(record["finish"]), -most, most
    for row in run.image.classes:
        yield int(row["rest"]), 0.0, 1.0
        if row["accounted"]:
            yield int(row["turn"]), 0.0, 2.0


def _pressed_points(run: CommunicationRun) -> Iterator[tuple[int, int, float, int, str]]:
    """Points at which a rigid body is pressed at the start: place of their traction, number of its components,
    coefficient of friction, its place where it is tunable, else -1, interface. The initial state is a linear function
    of the inputs while none slides or lifts.
    """
    assembly, at = run.run.assembly, int(run.image.run[0]["f_hat"])
    for g, point in sorted(closed_points(assembly)):
        group = assembly.layout.groups[g]
        channel, size = group.start + point * group.n_component, group.n_component
        if run.run.f_hat[channel] < 0.0:
            name = next(
                assembly.interfaces[i].name for i, span in group.members.items() if span.start <= point < span.stop
            )
            row, column = run.image.groups[g], friction_column(group)
            tuned = -1
            if column is not None and row["tunable"]:
                tuned = int(row["tuned"]) + point * group.parameters.shape[1] + column
            yield at + channel, size, float(group.parameters[point, 0]) if size > 1 else 0.0, tuned, name


def checksum(content: bytes) -> int:
    """The checksum of image.c; zeros stand behind the content up to a whole number of words."""
    words = np.frombuffer(content + bytes(-len(content) % 8), "<u8")
    first, second, third = (np.uint64(mixer) for mixer in _MIXERS)
    mixed = words + np.arange(1, len(words) + 1, dtype=np.uint64) * first
    mixed = (mixed ^ mixed >> np.uint64(30)) * second
    mixed = (mixed ^ mixed >> np.uint64(27)) * third
    mixed ^= mixed >> np.uint64(31)
    return (int(mixed.sum(dtype=np.uint64)) + len(words)) % 2**64
