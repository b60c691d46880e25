"""Points of a study: parameters, their combinations, the order in which these are solved; the run of one, its
quantities, and what a process keeps for the points that follow.

Kept are operators, and fields of windows of several instants as first guesses of the next point. The iterate of a
window is its history of tractions and velocities on the interfaces. Where a parameter changes a little, the converged
history of a neighbour is close to the solution (P.A. Boucard, L. Champaney, "A suitable computational strategy for the
parametric analysis of problems with multiple contact", Int. J. Numer. Meth. Engng 57 (2003) 1259-1281); two neighbours
on a line are continued linearly, which is exact between two changes of a contact state. The guess changes the number of
iterations, not the tolerance that ends them: results agree with those of other first guesses within it. A window that
does not converge from a guess starts again without it.

Windows of one instant have no use for it: each begins with the fields of the instant before, which are closer.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
import time as clock
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from threading import Lock
from typing import Any, Final

import numpy as np

from .. import api
from ..accuracy.runs import message_of
from ..assembly.models import KeptOperators
from ..attempts import StandingRun, standing_again
from ..errors import InputError, LatinError, Problem, SceneError, shown
from ..latin.outcome import Array
from ..reader import scene_from_dict
from ..results.groups import plain_name
from ..results.interface_fields import Force
from ..results.owner_records import BoltRecord, InterfaceRecord, SensorRecord
from ..results.sensitivities import scalars_of
from ..results.solution import Solution
from ..results.spread import linear_results, results_in, spectrum_groups
from ..scene.describe import unit_at
from ..scene.overrides import parse_value
from ..scene.quantity_table import BOLT, BOUNDARY, INTERFACE, RUN, SENSOR, values_of
from ..scene.quantity_table import QUANTITIES as ROWS
from ..scene.random_bases import at_window
from ..scene.raw_scene import plain
from ..scene.schema import Scene, toml_value, with_settings
from ..scene.unit_texts import si_unit, unit_size, value_and_unit
from ..scene.unit_values import value_in_scene_units
from ..scene.units import system_named
from .window_statistics import WindowEvaluation, window_of

MOST_POINTS: Final = 20_000
"""Largest number of points of a study."""
MOST_PARAMETERS: Final = 8
SAMPLE: Final = "sample"
"""Dimension of a study of samples."""
WINDOW: Final = "window"
"""What a record has of a window of a random vibration."""
_TRIED: Final = 200  # points of which one must be valid

_FORM: Final = "name.key=from:to:count or name.key=value,value,..., e.g. load.press.pressure=0:2e8:5 or =1MPa:2MPa:5"
_RANGE: Final = re.compile(r"\s*([^:,\[\]\"'{}]+):([^:,\[\]\"'{}]+):\s*([0-9]+)\s*")
_HEADING: Final = "the study cannot be made"
_NO_FIELDS: Final = ("fields", "stress", "nodal_stress", "principal_stress", "strain", "surfaces")
_OUTSIDE_OPERATORS: Final = ("interface", "contact", "load", "boundary", "sensor", "limit", "output")
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
        return unit_at(Scene, self.key)

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
    # no integer is made of any number of digits that somebody writes
    if len(count) < 10:
        n = int(count)
    else:
        n = MOST_POINTS + 1
    if not 2 <= n <= MOST_POINTS:
        raise InputError.of(_HEADING, f"--vary {key}", "number of values", count, f"2 to {MOST_POINTS}")
    ends, unit = _ends(key, first, last)
    digits = 12 - math.ceil(math.log10(max(map(abs, ends)) or 1.0))  # round-off of steps such as 0.1 is left out
    values = [float(value) for value in np.round(np.linspace(*ends, n), digits) + 0.0]  # no -0.0
    if unit:
        return tuple(f"{value!r} {unit}" for value in values)
    whole = all(re.fullmatch(r"\s*[+-]?[0-9]+\s*", end) for end in (first, last))
    if whole and all(value.is_integer() for value in values):
        return tuple(int(value) for value in values)
    return tuple(values)


def _ends(key: str, first: str, last: str) -> tuple[tuple[float, float], str]:
    """Ends of a range, and the unit of both, empty where they are numbers alone."""
    one, other = value_and_unit(first), value_and_unit(last)
    with suppress(OverflowError):
        if one is not None and other is not None:
            known = si_unit(one[1])
            size = Fraction(1) if one[1] == other[1] else None
            if known is not None and (begin := unit_size(one[1], known)) and (end := unit_size(other[1], known)):
                size = end / begin
            if size is not None:
                return (float(one[0]), float(other[0] * size)), one[1]
    what, allowed = "ends of the range", "two numbers, or two values with units of the same kind"
    raise InputError.of(_HEADING, f"--vary {key}", what, f"{first}:{last}", allowed, _FORM)


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


def in_scene_units(parameters: Sequence[Parameter], tables: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Parameters with numbers in the units of the scene in the place of texts with units; checked again.

    tables : of the scene, as written.

    Raises
    ------
    InputError : texts that are no values of their keys; the same value twice.
    """
    system = system_named(tables.get("units"))
    problems = list[Problem]()
    made = []
    for p in parameters:
        values = []
        for value in p.values:
            number, misfits = value_in_scene_units(Scene, tables, p.key, value, system)
            problems += [Problem(f"--vary {p.key}", m.what, m.value, m.allowed, m.remedy) for m in misfits]
            values.append(number)
        made.append(Parameter(p.key, tuple(values)))
    if problems or (problems := list(_set_problems(made))):
        raise InputError(problems, _HEADING)
    return tuple(made)


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
        for value in p.values:
            if isinstance(value, float) and not math.isfinite(value):
                yield Problem(f"--vary {p.key}", "not a finite number", repr(value), _FORM)
        for text in dict.fromkeys(t for t in texts if texts.count(t) > 1):
            yield Problem(f"--vary {p.key}", "the value is given twice", text)


@dataclass(frozen=True)
class Grid:
    """A scene and the parameters that vary: a full factorial design, or samples.

    Attributes
    ----------
    tables : the scene as read, with what ``--set`` changes. base_dir : that its files are relative to.
    samples : whether a point has the values of one number of all parameters, which then have as many.
    """

    tables: Mapping[str, Any]
    base_dir: str
    parameters: tuple[Parameter, ...]
    samples: bool = False

    @property
    def shape(self) -> Index:
        """Number of values of every parameter; of samples their number."""
        return tuple(len(p.values) for p in (self.parameters[:1] if self.samples else self.parameters))

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of a study."""
        if self.samples:
            return (SAMPLE,)
        return self.names

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in a study: those of their keys with underscores, each once."""
        taken = {SAMPLE, "state", "converged", "message", "time", "component", *(q.name for q in QUANTITIES)}
        taken |= {q.of for q in QUANTITIES} | {"force", "normal_force"}
        made: list[str] = []
        for parameter in self.parameters:
            short = plain_name(parameter.key)
            others = (f"{short}_{n}" for n in itertools.count(2))
            made.append(next(name for name in itertools.chain([short], others) if name not in taken))
            taken.add(made[-1])
        return tuple(made)

    def at(self, point: Index) -> Index:
        """Place of a point in the arrays of a study."""
        if self.samples:
            return point[:1]
        return point

    def settings(self, point: Index) -> list[str]:
        """Settings of a point, as ``--set`` takes them."""
        return [p.setting(i) for p, i in zip(self.parameters, point, strict=True)]

    def words(self, point: Index) -> str:
        """The values of a point as text, e.g. for progress."""
        values = [p.values[i] for p, i in zip(self.parameters, point, strict=True)]
        texts = [f"{v:g}" if isinstance(v, float) else value_text(v) for v in values]
        return ", ".join(f"{p.key} = {text}" for p, text in zip(self.parameters, texts, strict=True))

    def scene(self, point: Index | None = None) -> Scene:
        """Scene of a point without fields of the substructures and derivatives, of which a study keeps nothing; the
        scene itself where None.

        Raises
        ------
        SceneError : values that the scene does not allow.
        """
        if point is None:
            return scene_from_dict(dict(self.tables), self.base_dir)
        scene = scene_from_dict(with_settings(self.tables, self.settings(point)), self.base_dir).undifferentiated
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
                if first is None:
                    first = error
        assert first is not None, "a study has at least one point"
        raise first

    @cached_property
    def order(self) -> list[Index]:
        """All points, each one step of one parameter from the one before; keys outside the operators vary fastest.
        Samples have their own order."""
        if self.samples:
            return [(i,) * len(self.parameters) for i in range(*self.shape)]
        keys = [p.key.partition(".")[0] for p in self.parameters]
        slow_first = sorted(range(len(keys)), key=lambda axis: keys[axis] in _OUTSIDE_OPERATORS)  # False before True
        points = []
        for steps in to_and_fro([self.shape[axis] for axis in slow_first]):
            point = [0] * len(keys)
            for axis, number in zip(slow_first, steps, strict=True):
                point[axis] = number
            points.append(tuple(point))
        return points

    def file_name(self, point: Index) -> str:
        """Name of the file of a point: of its values, so that more values may be added to a study."""
        # values, not their numbers, and keys in order: the same point in a larger study
        values = {p.key: p.values[i] for p, i in zip(self.parameters, point, strict=True)}
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:24] + ".point"

    def place(self, point: Index) -> list[float]:
        """Coordinates of a point in parameter space: values over the range of each parameter; for texts the number."""
        place = []
        for p, i in zip(self.parameters, point, strict=True):
            # texts have places too, one apart
            values = p.values if p.numeric else range(len(p.values))
            span = max(values) - min(values)
            place.append(float(values[i]) / span if span else 0.0)
        return place


def value_text(value: Any) -> str:
    """A value as text; texts without quotes."""
    if isinstance(value, str):
        return value
    return toml_value(value)


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
        # every second line backwards: successive points are neighbours
        yield from ((*outer, i) for i in (inner if count % 2 == 0 else reversed(inner)))


CONVERGED = 0
NOT_CONVERGED = 1
FAILED = 2
STATES: Final = ("converged", "not_converged", "failed")
"""States of a point, by number."""

Record = dict[str, Any]
"""A point as plain data: ``point``, ``state``, ``message``, and quantities by name: of the run a number, of its parts
numbers by name of the part; ``histories`` and their ``time``."""

_MOST_BYTES: Final = 256e6  # of fields kept by one process
_JUDGED: Final = 4  # guessed points after which their cost is compared with that of others
_BACK: Final = (0, 1, 2, 4, 8)  # steps between the two points of a continuation
_FADING: Final = 0.5  # weight of the errors of earlier points
_AGAIN: Final = 12  # points without a guess after which one is tried again


@dataclass(frozen=True)
class Quantity:
    """A variable of a study: its dimension beside the parameters ("" for none), UDUNITS unit and long name."""

    name: str
    of: str
    unit: str
    long_name: str


QUANTITIES: Final = (
    *(Quantity(q.key, "" if q.owner == RUN else q.owner, q.unit, q.long_name) for q in ROWS if q.study is not None),
    Quantity("energy", "energy_term", "J", "term of the energy balance at the end"),
    Quantity("cpu", "", "s", "CPU time of the run"),
    Quantity("guessed", "", "1", "whether windows began with fields of neighbouring points"),
)
"""All quantities of a point; those a scene has none of are left out of its study."""


@dataclass(frozen=True)
class Plan:
    """Data that every process of a study needs.

    Attributes
    ----------
    grid : scene and parameters. histories : whether to keep the resultants of the interfaces over time.
    guesses : whether windows of several instants begin with fields of neighbouring points.
    max_cpu : CPU seconds that a point may take, None for no limit. evaluation : of the points as windows of a random
        vibration, None of others.
    """

    grid: Grid
    histories: bool = False
    guesses: bool = True
    max_cpu: float | None = None
    evaluation: WindowEvaluation | None = None

    def text(self) -> str:
        """The plan as text, for other processes."""
        grid = self.grid
        vary = [[p.key, p.values] for p in grid.parameters], grid.samples
        evaluation = None if self.evaluation is None else self.evaluation.plain()
        return json.dumps([grid.tables, grid.base_dir, *vary, self.histories, self.guesses, self.max_cpu, evaluation])

    @classmethod
    def of_text(cls, text: str) -> Plan:
        """The plan from its text."""
        tables, base_dir, vary, samples, histories, guesses, max_cpu, evaluation = json.loads(text)
        parameters = tuple(Parameter(key, tuple(values)) for key, values in vary)
        how = None if evaluation is None else WindowEvaluation(**evaluation)
        return cls(Grid(tables, base_dir, parameters, samples), histories, guesses, max_cpu, how)


class PointSolver:
    """Solves points of a study one after the other in one process, and keeps what the next one can use.

    Attributes
    ----------
    kept : operators of the last point. guesses : fields of the last points.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.guesses = plan, FirstGuesses()
        self.kept = self._operators()
        self._window: tuple[Scene, StandingRun] | None = None  # the last one of a random vibration
        self._lock = Lock()  # a worker of a cluster may have several threads

    def _operators(self) -> KeptOperators:
        """Those of no point yet."""
        # samples have bands of histories, too, windows signals of contacts alone
        plan = self.plan
        alone = plan.evaluation is not None or not (plan.histories or plan.grid.samples)
        return KeptOperators(resultants_alone=alone)

    def solve(self, point: Index) -> Record:
        """The record of a point; an error in it becomes its message."""
        with self._lock:
            start = clock.process_time()
            try:
                record = self._solved(point) if self.plan.evaluation is None else self._of_window(point)
            except LatinError as error:
                record = failed(message_of(error))
            except MemoryError:
                record = failed("the memory does not suffice")
            except Exception as error:  # a study outlives whatever one of its points does
                record = failed(f"{type(error).__name__}: {error}")
            if record["state"] == FAILED:
                self.kept, self._window = self._operators(), None  # operators may be half made
            return {**record, "point": list(point), "cpu": clock.process_time() - start}

    def _of_window(self, point: Index) -> Record:
        """A window of a random vibration, which begins with the operators of the last one."""
        assert self.plan.evaluation is not None
        grid = self.plan.grid
        # one parameter stands for the windows of all bases
        number = int(grid.parameters[0].values[point[0]])
        before, standing = self._window or (grid.scene(point), None)
        scene = at_window(before, number)
        standing = standing_again(standing, scene, self.kept, self.plan.max_cpu)
        self._window = scene, standing
        outcome = standing.run.outcome
        record: Record = {"state": NOT_CONVERGED, "message": outcome.status}
        if outcome.trustworthy and outcome.complete:
            record |= {"state": CONVERGED, WINDOW: window_of(scene, outcome, self.plan.evaluation)}
        return record | {"marched": outcome.settings.get("propagator", "")}

    def _solved(self, point: Index) -> Record:
        grid, guesses = self.plan.grid, self.guesses
        scene = grid.scene(point)
        guesses.begin(point, grid.place(point))
        # windows of one instant begin with the instant before
        fields = guesses if self.plan.guesses and scene.solver.window != 1 else None
        solution = api.solve(scene, kept=self.kept, fields=fields, max_cpu=self.plan.max_cpu)
        guesses.end(solution.passes, solution.converged)
        if solution.trustworthy:
            state = CONVERGED
        else:
            state = NOT_CONVERGED
        record = {"state": state, "message": solution.status, "guessed": float(guesses.used)}
        record |= quantities_of(scene, solution)
        if grid.samples and solution.complete:
            record[SAMPLE] = sample_of(scene, solution)
        return record | (histories_of(solution) if self.plan.histories else {})


def failed(message: str) -> Record:
    """The record of a point without results."""
    return {"state": FAILED, "message": message}


@lru_cache(maxsize=1)
def _solver(plan: str) -> PointSolver:
    """The solver of a process, kept while the points belong to one study."""
    return PointSolver(Plan.of_text(plan))


def solve_point(plan: str, point: Index) -> Record:
    """Solve a point of a study in the process that calls it; ``plan`` as text."""
    return _solver(plan).solve(point)


def quantities_of(scene: Scene, solution: Solution) -> Record:
    """Quantities of a run by name; of its parts by name of the part, where it reached its end.

    Times of a contact that never closes are left out, and slip unless the whole history is kept.
    """
    outcome = solution.outcome
    numbers = values_of("study", RUN, outcome)
    if not solution.complete:
        return numbers
    time, end, whole = outcome.interface_time, scene.time.end, outcome.interfaces_every == 1
    duration = scene.output.peak_duration
    bonds = {name: Force(outcome.time, normal) for name, normal in outcome.bond_resultants.items()}
    records = [
        *((INTERFACE, name, InterfaceRecord(force, end, duration, opens=False)) for name, force in bonds.items()),
        *((INTERFACE, name, InterfaceRecord.of(h, time, end, whole)) for name, h in solution.interfaces.items()),
        *((SENSOR, name, SensorRecord.of(h, solution.time)) for name, h in solution.sensors.items()),
        *((BOUNDARY, name, reaction) for name, reaction in solution.reactions.items()),
        *(
            (BOLT, name, BoltRecord.of(bolt, solution.time, None, solution.interfaces))
            for name, bolt in solution.bolts.items()
        ),
    ]
    values: dict[str, dict[str, float]] = {}
    for kind, name, record in records:
        for key, value in values_of("study", kind, record).items():
            values.setdefault(key, {})[name] = value
    if solution.energy is not None:
        values["energy"] = {term: float(history[-1]) for term, history in solution.energy.items()}
    return {**values, **numbers}


def histories_of(solution: Solution) -> Record:
    """Resultants of the interfaces over time: force (n_time, 3) on side E and normal force (n_time,), N."""
    forces = {name: history.force() for name, history in solution.interfaces.items()}
    normal = {name: history.normal_resultant() for name, history in solution.interfaces.items()}
    return {"time": solution.outcome.interface_time, "histories": {"force": forces, "normal_force": normal}}


def sample_of(scene: Scene, solution: Solution) -> Record:
    """Results of a run that have bands: ``scalars`` by quantity, ``results`` by path of their group and variable."""
    outcome = solution.outcome
    groups = linear_results(outcome, outcome.time, scene.sensor) | spectrum_groups(solution.spectra)
    results = {path: results_in(group) for path, group in groups.items()}
    return {"scalars": scalars_of(outcome, solution.spectra), "results": results}


@dataclass
class _Solved:
    """Fields of a point by the first instant of the window; ``place`` : in parameter space."""

    point: Index
    place: Array
    fields: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Memory of the fields, bytes."""
        return sum(f.nbytes + w.nbytes for f, w in self.fields.values())


class FirstGuesses:
    """First guesses of the points that one process solves, one after the other (``latin.windows.WindowFields``).

    Guesses stop where they cost more than they save, by the mean number of substructure-instants of the last points,
    and are tried again some points later.

    Attributes
    ----------
    used : whether a window of the present point began with fields of its neighbours.
    """

    def __init__(self) -> None:
        self._solved: list[_Solved] = []
        self._now = _Solved((), np.zeros(0))
        self._costs: dict[bool, list[float]] = {True: [], False: []}
        self._since = 0
        self._errors = {back: 0.0 if back == 1 else 1e-9 for back in _BACK}  # one step back is tried first
        self.used = False

    def begin(self, point: Index, place: list[float]) -> None:
        """Begin a point of the study."""
        self._now, self.used = _Solved(point, np.array(place)), False

    def end(self, cost: float, converged: bool) -> None:
        """End the point: ``cost`` in substructure-instants."""
        self._costs[self.used] = [*self._costs[self.used], cost][-_JUDGED:]
        if self.used:
            self._since = 0
        else:
            self._since = self._since + 1
        # fields that have not converged are no guess
        if converged and self._now.fields:
            self._compare()
            self._solved.append(self._now)
        # two points make a line: fewer could not be continued
        while len(self._solved) > 2 and sum(s.size for s in self._solved) > _MOST_BYTES:
            del self._solved[0]

    def first_guess(self, first: int, n: int, n_flat: int) -> tuple[Array, Array] | None:
        """Tractions and velocities (n, n_flat) of a window of the present point; None where no neighbour has them."""
        if not self._pays():
            return None
        guess = self._continued(first, (n, n_flat), min(_BACK, key=lambda back: self._errors[back]))
        self.used |= guess is not None
        return guess

    def _continued(self, first: int, shape: tuple[int, int], back: int) -> tuple[Array, Array] | None:
        """Fields of a window of the nearest point, continued along the line through a point ``back`` steps from it (0:
        as they are); None where no point has them."""
        here = self._now.place
        # a parameter may change the window or the number of points: such fields fit nowhere
        known = [s for s in self._solved if first in s.fields and s.fields[first][0].shape == shape]
        if not known:
            return None
        # of equally near ones the last
        near = min(reversed(known), key=lambda s: float(np.linalg.norm(s.place - here)))
        steps = [(t, s) for s in known if s is not near and (t := _along(s.place, near.place, here)) is not None]
        f, w = near.fields[first]
        if not steps or not back:
            return f, w
        steps.sort(key=lambda step: -abs(step[0]))  # the nearest ones first
        # where the line has fewer points, through the furthest
        t, other = steps[min(back, len(steps)) - 1]
        before = other.fields[first]
        return f + t * (f - before[0]), w + t * (w - before[1])

    def _compare(self) -> None:
        """Errors that the continuations would have had at the present point, over the change from its neighbour."""
        sizes = dict.fromkeys(_BACK, 0.0)
        for first, (f_hat, _) in self._now.fields.items():
            for back in _BACK:
                guess = self._continued(first, f_hat.shape, back)
                if guess is None:
                    return
                # by the tractions; velocities follow from them
                sizes[back] += float(np.linalg.norm(guess[0] - f_hat))
        if sizes[0] > 0.0:  # nothing changed: no error to compare with
            self._errors = {b: _FADING * self._errors[b] + sizes[b] / sizes[0] for b in _BACK}

    def keep(self, first: int, f_hat: Array, w_hat: Array) -> None:
        """Keep the converged fields (n, n_flat) of a window of the present point."""
        self._now.fields[first] = f_hat, w_hat

    def _pays(self) -> bool:
        """Whether guesses have been cheaper than no guesses so far."""
        with_guess, without = self._costs[True], self._costs[False]
        # too few to judge, or so long ago that it may have changed
        if len(with_guess) < _JUDGED or not without or self._since >= _AGAIN:
            return True
        # substructure-instants of the last points with guesses and without
        return float(np.mean(with_guess)) < float(np.mean(without))


def _along(first: Array, second: Array, third: Array) -> float | None:
    """t with third = second + t (second - first); None where the three are on no line, or second is far off."""
    step = second - first
    length = float(step @ step)
    # foot of the perpendicular on the line, in steps
    if length > 0.0:
        t = float((third - second) @ step) / length
    else:
        t = 0.0
    off = float(np.abs(third - second - t * step).max(initial=0.0))
    # t = 0: the nearest point is where the present one is, or the line passes beside it
    if abs(t) <= _FARTHEST and t != 0.0 and off <= _ON_LINE * length**0.5:
        return t
    return None


_FARTHEST: Final = 2.0  # continuation, in distances of the two points
_ON_LINE: Final = 1e-6
