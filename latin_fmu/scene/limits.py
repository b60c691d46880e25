"""Table [limit]: what a run is judged by, spectra of sensors and safeties of bolts."""

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import ValidationInfo, model_validator

from ..errors import Problem, shown
from ..shock.oscillators import Kind, Response
from ..shock.specification import Specification, breakpoint_problems
from .fields import Name, Real, SceneTable, Series, Text, about, refusal, units_in
from .laws import base_dir_of
from .number_files import SpectralUnit, factor, unit_problem
from .raw_scene import RawTable, exactly_one, given, named_tables, number, reference_problems, single_table
from .sensors import spectrum_problems, with_quality
from .unit_texts import names_for
from .units import UnitSystem

UNIT_OF: Final[dict[Kind, str]] = {
    "acceleration": "m s-2",
    "pseudo_velocity": "m s-1",
    "relative_displacement": "m",
    "equivalent_static_acceleration": "m s-2",
}
"""Units (UDUNITS) of spectra by kind."""
Check = Literal[
    "assembly_yield", "service_yield", "edge_yield", "fatigue", "pressure_head", "pressure_nut", "slip", "separation"
]
"""Checks of bolts by VDI 2230-1 (``results.bolt_margins.CHECKS``)."""
_OF_SENSOR: Final = ("kind", "response", "component", "quality", "damping", "frequencies", "values", "file", "unit")
_OF_BOLT: Final = ("check", "least")


class Limit(SceneTable):
    """A limit that a run is judged by: with `sensor` the largest shock response spectrum, with `bolt` the smallest
    safety. What exceeds it is in the summary, in `--json` and in the report.

    Between its breakpoints the logarithm of a spectrum is a straight line over the logarithm of the frequency; the
    response is compared at every twelfth of an octave from the first to the last one.
    """

    sensor: Annotated[Name | None, about("name of a [sensor.NAME] table")] = None
    kind: Annotated[Kind, about("which spectrum of the sensor")] = "acceleration"
    response: Annotated[Response, about("which response of the oscillators")] = "maximax"
    component: Annotated[
        Literal["x", "y", "z"] | None, about("axis; default: the largest of the three at each frequency")
    ] = None
    quality: Annotated[
        Real, about("amplification Q = 1 / (2 damping ratio) of the oscillators; follows from damping", "1", gt=0.5)
    ] = 10.0
    damping: Annotated[Real | None, about("damping ratio of the oscillators, instead of quality", "1", gt=0, lt=1)] = (
        None
    )
    frequencies: Annotated[Series, about("breakpoints: increasing", "Hz")] = ()
    values: Annotated[Series, about("limits at these, in `unit` or in the units of the scene", "1")] = ()
    file: Annotated[
        Text, about("file with two columns, frequency in Hz and limit, instead; its header or `unit` names the unit")
    ] = ""
    unit: Annotated[
        SpectralUnit | None,
        about("unit of the limits, one of what `kind` is; or the factor to the units of the scene", "1"),
    ] = None
    bolt: Annotated[Text | None, about('name of a [bolt.NAME] table, or a pattern such as "m6*"')] = None
    check: Annotated[
        Check | None, about("which check by VDI 2230-1; default: all but separation, whose safety is a share")
    ] = None
    least: Annotated[Real | None, about("smallest safety that is allowed", "1", gt=0)] = None

    @model_validator(mode="before")
    @classmethod
    def _load(cls, data: Any, info: ValidationInfo) -> Any:
        data = with_quality(data)
        if not isinstance(data, dict) or not given(data, "sensor") or data.get("kind", "acceleration") not in UNIT_OF:
            return data
        return _with_values(data, base_dir_of(info.context), units_in(info.context))

    @model_validator(mode="after")
    def _check_breakpoints(self) -> Self:
        if self.sensor is not None:
            if len(self.frequencies) != len(self.values):
                counts = [len(self.frequencies), len(self.values)]
                raise refusal("frequencies and values differ in number", value=counts, allowed="a value a frequency")
            for row, what, value, allowed in breakpoint_problems(self.frequencies, self.values):
                raise refusal(f"breakpoint {row}: {what}", value=value, allowed=allowed)
        return self

    @property
    def specification(self) -> Specification:
        """The limit of a spectrum, in the units of the scene."""
        return Specification.of(self.frequencies, self.values, self.quality)

    def bolts(self, names: Any) -> list[str]:
        """Those of the names of bolts that are meant."""
        return [name for name in names if fnmatchcase(name, self.bolt or "")]


def _with_values(data: dict[str, Any], base_dir: Path, system: UnitSystem) -> dict[str, Any]:
    """The keys of a limit of a sensor with its breakpoints in the units of the scene, and without file and unit.

    Raises the refusal of the table: no breakpoints, a file that has none, a unit of something else.
    """
    from .specifications import read_breakpoints  # loads the filters of SciPy

    of, file, unit = UNIT_OF[data.get("kind", "acceleration")], data.get("file"), data.get("unit")
    if isinstance(unit, str) and (what := unit_problem(unit, of)) is not None:
        raise refusal(f"unit: {what}", value=unit, allowed=names_for(of))
    listed = any(data.get(key) is not None and len(data[key]) for key in ("frequencies", "values"))
    if bool(file) == listed:
        allowed = "file, or frequencies and values"
        raise refusal("a limit of a spectrum is a file, or breakpoints", value=file or None, allowed=allowed)
    rest = {key: value for key, value in data.items() if key not in ("file", "unit")}
    if file:
        frequencies, values = read_breakpoints(base_dir, str(file), unit, system, of)
        return {**rest, "frequencies": frequencies, "values": values}
    size = factor(unit, system)
    # of what is no number the field says so
    values = [size * v if number({"of": v}, "of") is not None else v for v in data.get("values") or ()]
    return {**rest, "values": values}


def limit_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the limits of a scene as written, with other tables too."""
    for name, table in named_tables(raw, "limit").items():
        where = f"limit.{name}"
        yield from exactly_one(table, where, "sensor", "bolt")
        if given(table, "sensor") == given(table, "bolt"):
            continue
        if given(table, "sensor"):
            kind = "sensor"
            yield from _of_sensor(raw, where, table)
        else:
            kind = "bolt"
            yield from _of_bolt(raw, where, table)
        for key in useless_keys(table):
            if given(table, key):
                yield Problem(f"{where}.{key}", f"has no meaning in a limit of a {kind}", None, None, "remove it")


def useless_keys(table: RawTable) -> Sequence[str]:
    """Keys that have no meaning in a limit."""
    if given(table, "sensor"):
        return _OF_BOLT
    return _OF_SENSOR


def _of_sensor(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    sensors, name = named_tables(raw, "sensor"), table["sensor"]
    if not sensors:
        yield Problem(f"{where}.sensor", "the scene has no sensors", shown(name), None, f"add [sensor.{name}]")
    yield from reference_problems(raw, f"{where}.sensor", "sensor", name)
    if single_table(raw, "time").get("quasi_static") is True:
        what = "a quasi-static run has no acceleration, and its time only orders the increments of load"
        yield Problem(f"{where}.sensor", what, None, None, "remove the limit, or omit quasi_static")


def range_problems(limits: Mapping[str, Limit], step: float) -> list[Problem]:
    """Limits at frequencies that a run with this step, s, cannot have; of files, too."""
    of_sensors = {name: limit for name, limit in limits.items() if limit.sensor is not None}
    return [p for name, of in of_sensors.items() for p in spectrum_problems(f"limit.{name}", of.frequencies, step)]


def _of_bolt(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    bolts, pattern = named_tables(raw, "bolt"), table["bolt"]
    if not given(table, "least"):
        yield Problem(f"{where}.least", "this key is missing", None, "a number > 0, the smallest safety")
    if isinstance(pattern, str) and not any(fnmatchcase(name, pattern) for name in bolts):
        allowed = ", ".join(bolts) or "none: the scene has no [bolt.NAME]"
        yield Problem(f"{where}.bolt", "no bolt has this name", shown(pattern), allowed)
