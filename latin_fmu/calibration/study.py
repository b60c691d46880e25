"""Fit of parameters of a scene to measured data by least squares.

    minimise  sum_i ((y_i(p) - d_i) / w_i)^2,    low <= p <= high

d the data, y their predictions by the scene, w their standard deviations. The method is the trust region of
``scipy.optimize.least_squares`` on parameters over their start, with the derivatives of the run. Where there are none,
a Jacobian of secants is made once, by a run a parameter, and updated after each run (Broyden); at the end it is made
anew, and the fit goes on where it has not converged then.

Columns without standard deviations are weighted in proportion to their values, see ``data.Column.scatter``. Where the
residuals of several columns differ much then, each is weighted by its own, and the fit repeated from there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from ..accuracy.runs import message_of
from ..errors import InputError, LatinError, Problem, Problems, SceneError, shown
from ..latin.outcome import Array
from ..reader import load_scene
from ..scene.schema import Scene
from ..scene.unit_texts import value_and_unit
from ..scene.unit_values import value_in_scene_units
from ..scene.units import UnitSystem
from ..sensitivities.tangents import value_of
from .data import HEADING, MeasuredTable, columns_of, read_measured, size_of
from .prediction import Predicted, Predictor
from .report import AT_BOUND, Calibration, FitParameter, calibration_of

_FORM: Final = "NAME[,NAME..][=START][:LOW:HIGH], e.g. interface.lap.friction_coefficient=0.2:0.05:0.8"
_FIT: Final = re.compile(r"([^=:]+)(?:=([^:]*))?(?::([^:]*):([^:]*))?")
_RANGE: Final = 10.0  # start over the lower bound, upper bound over the start, where none are given
MOST_PARAMETERS: Final = 8
_MOST_RUNS: Final = 1000
_BEYOND: Final = 1e3  # largest value of a column over that of the first run, up to which they can be compared
_SETTLED: Final = 1e-3  # change of a parameter over its start, and of the sum of squares over one residual
_SECANT: Final = 0.05  # change of a parameter over its start, in a Jacobian of secants
_NOISE: Final = 0.01  # change of parameters over their start below which a secant is one of the tolerance of the runs
_AT_REST: Final = 0.02  # of the sum of squares over one residual: what a new Jacobian of secants may gain at the end
_RENEWALS: Final = 3
_UNEVEN: Final = 1.5  # ratio of the residuals of two columns from which on each is weighted by its own
_EXACT: Final = 1e-6  # of the weights: residuals below are round-off

Log = Callable[[str], None]


class _SpentError(Exception):
    """The runs that the fit may take are done."""


def _numbers(text: str, given: Sequence[str | None], name: str, scene: Scene, problems: Problems) -> list[float | None]:
    """Numbers of an option in the units of the scene, None where they are left out; ``name`` : of the first of them."""
    made: list[float | None] = []
    for word in given:
        number, misfits = value_in_scene_units(Scene, scene.tables(), name, word, scene.unit_system)
        # a number alone is a text without a unit there
        if misfits and (value_and_unit(str(word)) or (0, ""))[1]:
            problems += [Problem("--fit", m.what, m.value, m.allowed, m.remedy or f"in {text}") for m in misfits]
            made.append(None)
            continue
        try:
            value = None if word is None else float(number)
            if value is not None and math.isnan(value):
                raise ValueError
            made.append(value)
        except ValueError:
            problems.add("--fit", "not a number", word or "nothing", _FORM, f"in {text}")
            made.append(None)
    return made


def parameters_of(fit: Sequence[str], scene: Scene) -> list[FitParameter]:
    """Parameters from options ``--fit``.

    Raises
    ------
    InputError : with all problems of all of them.
    """
    problems, made = Problems(), list[FitParameter]()
    if not 1 <= len(fit) <= MOST_PARAMETERS:
        problems.add("--fit", "number of parameters", str(len(fit)), f"1 to {MOST_PARAMETERS}", _FORM)
    for text in fit:
        match = _FIT.fullmatch(text.strip())
        names = () if match is None else tuple(name.strip() for name in match[1].split(","))
        if match is None or not all(names):
            problems.add("--fit", "not a parameter", shown(text), _FORM)
            continue
        values = []
        for name in names:
            try:
                values.append(value_of(scene, name))
            except SceneError as error:
                problems += [replace(problem, where="--fit") for problem in error.problems]
        start, low, high = _numbers(text, match.groups()[1:], names[0], scene, problems)
        if len(values) < len(names):
            continue
        if start is None and len(set(values)) > 1:
            problems.add("--fit", "the numbers have different values", text, remedy="give the start: NAME,NAME=START")
        if start is None:
            begin = values[0]
        else:
            begin = start
        # a factor has no meaning for numbers that may have either sign
        if begin > 0.0:
            ends = (begin / _RANGE, begin * _RANGE)
        else:
            ends = (-math.inf, math.inf)
        low, high = ends[0] if low is None else low, ends[1] if high is None else high
        if not (math.isfinite(begin) and low < begin < high):
            problems.add("--fit", "the start is not between the bounds", text, f"LOW < {begin:g} < HIGH")
        made.append(FitParameter(names, begin, low, high))
    every = [name for parameter in made for name in parameter.names]
    for name in dict.fromkeys(n for n in every if every.count(n) > 1):
        problems.add("--fit", "the parameter is given twice", name)
    if problems:
        raise InputError(problems, HEADING)
    return made


@dataclass(frozen=True)
class _Fit:
    """Where a search has ended: ``best`` prediction and its Jacobian ``slopes`` (n, p), by the parameters."""

    best: Predicted
    slopes: Array
    converged: bool


class LeastSquares:
    """Least squares by runs of a predictor, each counted and kept by its values."""

    def __init__(
        self, predictor: Predictor, parameters: Sequence[FitParameter], data: Array, max_runs: int, log: Log | None
    ) -> None:
        self._predictor = predictor
        self._parameters = parameters
        self._data = data
        self._most, self._log = max_runs, log
        self.scale = np.array([p.scale for p in parameters])
        self.known: dict[tuple[float, ...], Predicted | None] = {}
        self.weights = np.ones(len(data))
        self._reason = ""  # for secants, once it was said
        self._secants: Array | None = None  # by the parameters over their scale
        self._since: list[Predicted] = []  # runs that the secants do not contain yet

    @property
    def done(self) -> list[Predicted]:
        """Runs that could be compared with the data, in their order."""
        return [e for e in self.known.values() if e is not None]

    def residuals(self, evaluation: Predicted) -> Array:
        """Residuals (n,) over the weights."""
        return np.asarray((evaluation.predicted - self._data) / self.weights)

    def at(self, z: Array) -> Predicted | None:
        """The run with values ``z`` times the scale; None where it fails and is not the first."""
        values = tuple((z * self.scale).tolist())
        if values in self.known:
            return self.known[values]
        if len(self.known) >= self._most:
            raise _SpentError
        made: Predicted | None = None
        try:
            made = self._predictor(values)
        except LatinError as error:
            if not self.known:
                raise
            said = message_of(error)
        else:
            said = f"residual {math.sqrt(float(np.mean(self.residuals(made) ** 2))):.4g}"
            self._since.append(made)
            if self._predictor.reason != self._reason:
                self._reason = self._predictor.reason
                self._say(f"secants in the place of derivatives, with more runs: {self._reason}")
        self.known[values] = made
        text = ", ".join(f"{p.words} {v:.6g}" for p, v in zip(self._parameters, values, strict=True))
        self._say(f"run {len(self.known)}: {text}: {said}")
        self._let_go()
        return made

    def _say(self, text: str) -> None:
        if self._log is not None:
            self._log(text)

    def _let_go(self) -> None:
        """Keep the results of the best run alone: those of a run may be large."""
        best = self.best()
        for values, evaluation in self.known.items():
            if evaluation is not None and evaluation is not best and evaluation.solution is not None:
                self.known[values] = replace(evaluation, solution=None)

    def best(self) -> Predicted:
        """The run with the smallest sum of squares."""
        return min(self.done, key=lambda e: float(np.sum(self.residuals(e) ** 2)))

    def _rows(self, z: Array) -> Array:
        """Residuals of a trial, NaN where its run fails: the trust region shrinks then."""
        made = self.at(z)
        if made is None:
            return np.full(len(self._data), np.nan)
        return self.residuals(made)

    def _jacobian(self, z: Array) -> Array:
        return np.asarray(self.slopes(z) / self.weights[:, None])

    def slopes(self, z: Array) -> Array:
        """Derivatives (n, p) of the predictions by ``z``: of the run, or secants that fit the last runs."""
        here = self.at(z)
        assert here is not None, "derivatives follow a run that has succeeded"
        if here.slopes is not None:
            return np.asarray(here.slopes * self.scale)
        if self._secants is None:
            return self.renew(z)
        for other in self._since:
            step = np.array(other.values) / self.scale - z
            # Broyden's update: the secant to the other run is met, directions across stay
            if (size := float(step @ step)) > _NOISE**2:
                off = other.predicted - here.predicted - self._secants @ step
                self._secants = self._secants + np.outer(off, step) / size
        self._since = [here]
        return self._secants

    def renew(self, z: Array) -> Array:
        """The Jacobian of secants by a run a parameter; towards the other side where it would pass a bound or fails."""
        here, columns = self.at(z), []
        assert here is not None
        for i, p in enumerate(self._parameters):
            # a parameter at 0 has no size of its own
            length = _SECANT * max(abs(z[i]), _SECANT)
            for step in (length, -length):
                moved = z.copy()
                moved[i] += step
                if p.low <= moved[i] * p.scale <= p.high and (made := self.at(moved)) is not None:
                    columns.append((made.predicted - here.predicted) / step)
                    break
            else:
                columns.append(np.zeros(len(self._data)))
        self._secants, self._since = np.stack(columns, axis=1), [here]
        return self._secants

    def run(self, z: Array) -> _Fit:
        """Fit from ``z``."""
        low, high = (np.array([getattr(p, end) for p in self._parameters]) / self.scale for end in ("low", "high"))
        # ftol is relative to the whole sum, _SETTLED to the square of one residual
        few, converged = _SETTLED / len(self._data), False
        try:
            for _ in range(_RENEWALS):
                found = least_squares(
                    self._rows,
                    z,
                    self._jacobian,
                    (low, high),
                    method="trf",
                    ftol=few,
                    xtol=_SETTLED,
                    max_nfev=_MOST_RUNS,
                )
                z, converged = found.x, found.status > 0
                best = self.best()
                # derivatives of the run are exact at every step: where the method converges the fit does
                if best.slopes is not None:
                    break
                z = np.array(best.values) / self.scale
                jacobian = self.renew(z) / self.weights[:, None]
                free = (z > low + AT_BOUND) & (z < high - AT_BOUND)
                # what a full step along the free parameters would still gain
                gain = np.linalg.lstsq(jacobian[:, free], -self.residuals(best), rcond=None)[0]
                if np.sum((jacobian[:, free] @ gain) ** 2) <= _AT_REST * np.mean(self.residuals(best) ** 2):
                    break
        except _SpentError:
            converged = False
        best = self.best()
        known = (
            best.slopes if best.slopes is not None else None if self._secants is None else self._secants / self.scale
        )
        if known is None:
            slopes = np.full((len(self._data), len(self.scale)), np.nan)
        else:
            slopes = known
        return _Fit(best, slopes, converged)


def calibrate(
    scene: Scene | str | Path,
    data: str | Path | Sequence[str | Path],
    fit: str | Sequence[str],
    *,
    settings: Sequence[str] = (),
    max_runs: int = 20,
    estimate: bool = True,
    secants: bool = False,
    mode: int = 1,
    increments: int = 2,
    log: Log | None = None,
) -> Calibration:
    """Fit parameters of a scene to measured data (module docstring).

    Parameters
    ----------
    scene : file, or a scene. data : files, see ``calibration.data``.
    fit : parameters, as for the option ``--fit``: ``NAME[,NAME..][=START][:LOW:HIGH]``, names of numbers of the scene
        as in ``--set``; several names have one value. START is that of the scene where left out, the bounds a tenth
        and ten times the start.
    settings : changes of the scene, as for ``--set``. max_runs : runs of the scene, at most. estimate : the error of
        the last run is estimated by coarser ones. secants : differences of runs in the place of derivatives.
    mode : elastic mode of a backbone, from 1. increments : of load up to an amplitude of it. log : takes a line of text
        after each run.

    Raises
    ------
    InputError : data or parameters, with all problems; data far beyond the range of the first run. LatinError : the
        first run fails.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> run = latin_fmu.solve(scene)
    >>> rows = np.stack([run.time, run.interfaces["wall"].force()[:, 2]], axis=1)
    >>> np.savetxt(folder / "wall.csv", rows, delimiter=",", header="time,wall.force.z", comments="")
    >>> made = latin_fmu.calibrate(scene, folder / "wall.csv", "material.bar.density=1.1", estimate=False)
    >>> round(made["material.bar.density"].value, 2)
    1.0
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene, settings)
    parameters = parameters_of([fit] if isinstance(fit, str) else fit, scene)
    tables = read_measured([data] if isinstance(data, str | Path) else data, scene)
    _check(tables, parameters, {"--max-runs": max_runs, "--mode": mode, "--increments": increments})
    predictor = Predictor(scene, tables, [p.names for p in parameters], mode, increments)
    if secants:
        predictor.reason = "as requested"
    measured = np.concatenate([column.values for _, column, _ in columns_of(tables)])
    search = LeastSquares(predictor, parameters, measured, max_runs, log)
    search.weights = np.concatenate([scatter for table in tables for scatter in table.scatter()])
    start = np.array([p.start for p in parameters]) / search.scale
    # the first run of the fit, which keeps it
    first = search.at(start)
    if first is not None and (problems := list(_beyond(tables, first.predicted, scene.unit_system))):
        raise InputError(problems, HEADING)
    found = search.run(start)
    if _weigh(tables, search, found.best):
        found = search.run(np.array(found.best.values) / search.scale)
    last = found.best, found.slopes, found.converged
    wanted = estimate and scene.accuracy.estimate
    return calibration_of(predictor, parameters, search.weights, last, search.done, len(search.known), wanted)


def _check(tables: Sequence[MeasuredTable], parameters: Sequence[FitParameter], counts: Mapping[str, int]) -> None:
    problems = []
    if (n := size_of(tables)) <= len(parameters):
        what, remedy = "too few data", "give more rows, or fit fewer parameters"
        problems.append(Problem(tables[0].path, what, str(n), f"more than the {len(parameters)} parameters", remedy))
    for option, count in counts.items():
        # a secant needs a second run
        if option == "--max-runs":
            least = 2
        else:
            least = 1
        if not least <= count <= _MOST_RUNS:
            problems.append(Problem(option, "out of range", str(count), f"{least} to {_MOST_RUNS}"))
    if problems:
        raise InputError(problems, HEADING)


def _beyond(tables: Sequence[MeasuredTable], predicted: Array, units: UnitSystem) -> Iterator[Problem]:
    """Columns with values far beyond those (n,) of the run with the start values: of another unit, or of another
    quantity; a fit would end anywhere."""
    for table, column, place in columns_of(tables):
        largest, range_of_run = float(np.abs(column.values).max()), float(np.abs(predicted[place]).max())
        if largest > _BEYOND * range_of_run > 0.0:
            what = f"{column.name} has values beyond {_BEYOND:g} times those of the run with the start values"
            unit = units.label(column.unit)
            allowed = f"up to {_BEYOND * range_of_run:.3g} {unit}".rstrip()
            remedy = f"check the unit of the column ({column.name} [unit]) and the start values"
            yield Problem(table.path, what, f"{largest:.6g} {unit}".rstrip(), allowed, remedy)


def _weigh(tables: Sequence[MeasuredTable], search: LeastSquares, best: Predicted) -> bool:
    """Weight columns without standard deviations by their residuals; whether that changes the weights."""
    residuals, sizes = search.residuals(best), dict[str, float]()
    places = {}
    for table, column, place in columns_of(tables):
        if column.sd is None:
            key = f"{table.path} {column.name}"
            places[key], sizes[key] = place, math.sqrt(float(np.mean(residuals[place] ** 2)))
    among = sum(len(table.columns) for table in tables)
    largest = max(sizes.values(), default=0.0)
    if among < 2 or not sizes or largest < _EXACT or (among == len(sizes) and largest < _UNEVEN * min(sizes.values())):
        return False
    for key, place in places.items():
        # a column met to round-off would weigh without limit
        search.weights[place] *= max(sizes[key], 1e-3 * largest)
    return True
