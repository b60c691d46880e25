"""Parameters of a study, their combinations, and the order in which these are solved."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from ..errors import InputError, Problem, SceneError, shown
from ..reader import scene_from_dict
from ..scene.describe import field_at, unit_of
from ..scene.overrides import apply_overrides, parse_value
from ..scene.raw_scene import plain
from ..scene.schema import Scene, toml_value

MOST_POINTS: Final = 20_000
"""Largest number of points of a study."""
MOST_PARAMETERS: Final = 8
_TRIED: Final = 200  # points of which one must be valid

_FORM: Final = "name.key=from:to:count or name.key=value,value,..., e.g. load.press.pressure=0:2e8:5"
_RANGE: Final = re.compile(r"\s*([^:,\[\]\"'{}]+):([^:,\[\]\"'{}]+):\s*([0-9]+)\s*")
_HEADING: Final = "the study cannot be made"
_NO_FIELDS: Final = ("fields", "stress", "nodal_stress", "principal_stress", "strain", "surfaces")
_OUTSIDE_OPERATORS: Final = ("interface", "contact", "load", "boundary", "sensor", "output")
"""Tables whose keys change no operator as a rule: the parameters that vary fastest."""

Index = tuple[int, ...]
"""A point of a study: numbers of the values of the parameters."""


@dataclass(frozen=True)
class Parameter:
    """A key of the scene, as ``--set`` names it, and its values."""

    key: str
    values: tuple[Any, ...]

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.values)

    @property
    def unit(self) -> str | None:
        """UDUNITS unit of the key, None where the scene declares none."""
        field = field_at(Scene, [int(part) if part.isdigit() else part for part in self.key.split(".")])
        return None if field is None else unit_of(field)

    def setting(self, number: int) -> str:
        """The setting of one value, as ``--set`` takes it."""
        return f"{self.key}={toml_value(self.values[number])}"


def read_parameter(text: str) -> Parameter:
    """Parameter of an option ``--vary``: a range ``key=from:to:count`` or a list ``key=value,value,...``.

    >>> read_parameter("load.push.pressure=1e5,2e5").values
    (100000.0, 200000.0)
    >>> read_parameter("load.push.pressure=0:6e5:3").values
    (0.0, 300000.0, 600000.0)

    Raises
    ------
    InputError : neither, or too many values.
    """
    key, equals, written = text.partition("=")
    key = key.strip()
    if not equals or not all(part.strip() for part in key.split(".")) or not written.strip():
        raise InputError.of(_HEADING, "--vary", "no parameter with values", shown(text), _FORM)
    match = _RANGE.fullmatch(written)
    return Parameter(key, _range(key, *match.groups()) if match else _listed(key, written))


def _range(key: str, first: str, last: str, count: str) -> tuple[Any, ...]:
    """``count`` equally spaced values; whole numbers where the ends are whole and all values are."""
    n = int(count) if len(count) < 10 else MOST_POINTS + 1
    if not 2 <= n <= MOST_POINTS:
        raise InputError.of(_HEADING, f"--vary {key}", "number of values", count, f"2 to {MOST_POINTS}")
    try:
        ends = float(first), float(last)
    except ValueError:
        ends = math.nan, math.nan
    if not all(map(math.isfinite, ends)):
        raise InputError.of(_HEADING, f"--vary {key}", "ends of the range", f"{first}:{last}", "two numbers", _FORM)
    digits = 12 - math.ceil(math.log10(max(map(abs, ends)) or 1.0))  # round-off of steps such as 0.1 is left out
    values = [float(value) for value in np.round(np.linspace(*ends, n), digits) + 0.0]
    whole = all(re.fullmatch(r"\s*[+-]?[0-9]+\s*", end) for end in (first, last))
    if whole and all(value.is_integer() for value in values):
        return tuple(int(value) for value in values)
    return tuple(values)


def _listed(key: str, written: str) -> tuple[Any, ...]:
    """Values of a list: of TOML, else bare words between commas."""
    try:
        values = parse_value(f"[{written}]")
    except ValueError:
        values = [_value(key, word) for word in written.split(",")]
    return tuple(values)


def _value(key: str, word: str) -> Any:
    try:
        return parse_value(word.strip())
    except ValueError as error:
        raise InputError.of(_HEADING, f"--vary {key}", str(error), shown(word), "a TOML value", _FORM) from None


def parameters_of(vary: Mapping[str, Sequence[Any]] | Sequence[str]) -> tuple[Parameter, ...]:
    """Parameters from options ``--vary``, or from values by key; checked.

    Raises
    ------
    InputError : none, too many, the same key or the same value twice, more than ``MOST_POINTS`` combinations.
    """
    if isinstance(vary, Mapping):
        made = tuple(Parameter(str(key), tuple(plain(v) for v in values)) for key, values in vary.items())
    else:
        made = tuple(read_parameter(text) for text in vary)
    problems = list(_set_problems(made))
    if problems:
        raise InputError(problems, _HEADING)
    return made


def _set_problems(parameters: Sequence[Parameter]) -> Iterator[Problem]:
    """What is wrong with parameters together, and with the values of each."""
    if not 1 <= len(parameters) <= MOST_PARAMETERS:
        yield Problem("--vary", "number of parameters", str(len(parameters)), f"1 to {MOST_PARAMETERS}", _FORM)
    keys = [p.key for p in parameters]
    for key in dict.fromkeys(key for key in keys if keys.count(key) > 1):
        yield Problem(f"--vary {key}", "the parameter is given twice", remedy="give all its values at once")
    counts = " x ".join(str(len(p.values)) for p in parameters)
    if (size := math.prod(len(p.values) for p in parameters)) > MOST_POINTS:
        remedy = "give fewer values, or make several studies"
        yield Problem("--vary", "the study is too large", f"{size} points ({counts})", f"at most {MOST_POINTS}", remedy)
        return
    for p in parameters:
        texts = [repr(value) for value in p.values]
        if not texts:
            yield Problem(f"--vary {p.key}", "no values", allowed=_FORM)
        for text in dict.fromkeys(t for t in texts if texts.count(t) > 1):
            yield Problem(f"--vary {p.key}", "the value is given twice", text)


@dataclass(frozen=True)
class Grid:
    """A scene and the parameters that vary: a full factorial design.

    Attributes
    ----------
    tables : the scene as read, with what ``--set`` changes. base_dir : that its files are relative to.
    """

    tables: Mapping[str, Any]
    base_dir: str
    parameters: tuple[Parameter, ...]

    @property
    def shape(self) -> Index:
        """Number of values of every parameter."""
        return tuple(len(p.values) for p in self.parameters)

    def settings(self, point: Index) -> list[str]:
        """Settings of a point, as ``--set`` takes them."""
        return [p.setting(i) for p, i in zip(self.parameters, point, strict=True)]

    def words(self, point: Index) -> str:
        """The values of a point as text, e.g. for progress."""
        values = [p.values[i] for p, i in zip(self.parameters, point, strict=True)]
        texts = [f"{v:g}" if isinstance(v, float) else value_text(v) for v in values]
        return ", ".join(f"{p.key} = {text}" for p, text in zip(self.parameters, texts, strict=True))

    def scene(self, point: Index | None = None) -> Scene:
        """Scene of a point without fields of the substructures, of which a study keeps nothing; the scene itself where
        None.

        Raises
        ------
        SceneError : values that the scene does not allow.
        """
        if point is None:
            return scene_from_dict(dict(self.tables), self.base_dir)
        scene = scene_from_dict(apply_overrides(self.tables, self.settings(point)), self.base_dir)
        output = scene.output.model_copy(update=dict.fromkeys(_NO_FIELDS, False))
        return scene.model_copy(update={"output": output})

    def check(self) -> Scene:
        """The scene itself, where it is valid and some of the first points are.

        Raises
        ------
        SceneError : the scene is not valid, or none of the first points is.
        """
        scene, first = self.scene(), None
        for point in self.order[:_TRIED]:
            try:
                self.scene(point)
                return scene
            except SceneError as error:
                first = error if first is None else first
        assert first is not None, "a study has at least one point"
        raise first

    @cached_property
    def order(self) -> list[Index]:
        """All points, each one step of one parameter from the one before; keys outside the operators vary fastest."""
        keys = [p.key.partition(".")[0] for p in self.parameters]
        slow_first = sorted(range(len(keys)), key=lambda axis: keys[axis] in _OUTSIDE_OPERATORS)
        points = []
        for steps in to_and_fro([self.shape[axis] for axis in slow_first]):
            point = [0] * len(keys)
            for axis, number in zip(slow_first, steps, strict=True):
                point[axis] = number
            points.append(tuple(point))
        return points

    def file_name(self, point: Index) -> str:
        """Name of the file of a point: of its values, so that more values may be added to a study."""
        values = {p.key: p.values[i] for p, i in zip(self.parameters, point, strict=True)}
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:24] + ".point"

    def place(self, point: Index) -> list[float]:
        """Coordinates of a point in parameter space: values over the range of each parameter; for texts the number."""
        place = []
        for p, i in zip(self.parameters, point, strict=True):
            values = p.values if p.numeric else range(len(p.values))
            span = max(values) - min(values)
            place.append(float(values[i]) / span if span else 0.0)
        return place


def value_text(value: Any) -> str:
    """A value as text; texts without quotes."""
    return value if isinstance(value, str) else toml_value(value)


def to_and_fro(shape: Sequence[int]) -> Iterator[Index]:
    """Index tuples of an array, the last index fastest and in turn up and down.

    >>> list(to_and_fro([2, 2]))
    [(0, 0), (0, 1), (1, 1), (1, 0)]
    """
    if not shape:
        yield ()
        return
    for count, outer in enumerate(to_and_fro(shape[:-1])):
        inner = range(shape[-1])
        yield from ((*outer, i) for i in (inner if count % 2 == 0 else reversed(inner)))
