"""Result of a calibration: values with intervals, combinations that are not determined, residuals; text and data.

With the residuals r of n data over their weights, the Jacobian J of the predictions over the weights by the p free
parameters, and S the standard deviations of the data over their weights,

    s^2 = r^T r / (n - p),    S = max(s, error of the run),    A = (J^T J)^-1 J^T,    C = A S^2 A^T

and a parameter is known to +- t sqrt(C_ii), t of the t distribution with n - p degrees of freedom at 95 %. The error
of a run is not random. ``shift`` is the largest change of a parameter by it: sum_j |A_ij| times the error of datum j.

A combination of parameters, a right singular vector of J by the logarithms of the parameters, whose interval t s /
(singular value) is above 1 is not determined by the data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from ..accuracy.estimate import band_remarks, estimate_error
from ..accuracy.runs import message_of
from ..errors import LatinError
from ..latin.outcome import Array
from ..results.estimates import ErrorEstimate
from ..results.groups import finite
from ..results.sensitivities import PART, in_words
from ..results.sentences import wrapped
from ..results.solution import Solution
from ..scene.describe import unit_at
from ..scene.overrides import text_with_numbers
from ..scene.readable_numbers import aligned, readable
from ..scene.schema import NAMED, Scene
from .data import Column, MeasuredTable, columns_of
from .prediction import Names, Predicted, Predictor

CONFIDENCE: Final = 0.95
TOGETHER: Final = 0.95
"""Correlation from which on two parameters are called correlated."""
_ENTERS: Final = 0.2  # of the largest entry of a combination: smaller ones are left out of its words
AT_BOUND: Final = 1e-4  # of the start
_FOLLOWING: Final = 0.5  # correlation of residuals from one datum to the next from which on they are not independent
_FEW: Final = 20  # data for that
_LEFT: Final = 0.5  # residual over the data, root mean squares, from which on a scene does not follow them
_NEAR: Final = (1e-3, 0.3)  # change of parameters over their start in the check of flagged derivatives


@dataclass(frozen=True)
class FitParameter:
    """A parameter to fit: ``names`` of the numbers of the scene that it is the value of, start and bounds."""

    names: Names
    start: float
    low: float
    high: float

    @property
    def scale(self) -> float:
        """What the parameter is divided by in the fit."""
        # a start of 0 has no size
        return abs(self.start) or min(1.0, self.high - self.low)

    @property
    def words(self) -> str:
        """The parameter in words, e.g. "force of left, right"."""
        first = in_words(self.names[0])
        owners = [name.split(".")[1] for name in self.names[1:] if name.count(".") > 1]
        return ", ".join([first, *owners])

    def unit(self) -> str:
        """UDUNITS unit, in SI."""
        return unit_at(Scene, self.names[0]) or "1"


@dataclass(frozen=True)
class FittedParameter:
    """Value of a parameter.

    Attributes
    ----------
    half : half of its 95 % interval; infinite where the data do not depend on it, NaN at a bound. shift : by the error
    of the run, at most. bound : "lower" or "upper" where it is at one, else "".
    """

    of: FitParameter
    value: float
    half: float
    shift: float
    bound: str


@dataclass(frozen=True)
class ColumnFit:
    """A column of data beside its predictions, (n,) each; ``error`` : estimated relative error of the run, NaN where
    there is none, of the root mean square or of the largest value, ``of_rms``."""

    table: MeasuredTable
    column: Column
    before: Array
    after: Array
    error: float = math.nan
    of_rms: bool = True

    @property
    def floor(self) -> float:
        """Error of the run in the unit of the column, 0 where none is known."""
        size = float(np.sqrt(np.mean(self.after**2)) if self.of_rms else np.abs(self.after).max())
        if math.isfinite(self.error):
            return self.error * size
        return 0.0

    def rms(self, predicted: Array) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean((predicted - self.column.values) ** 2)))


@dataclass(frozen=True)
class Calibration:
    """Result of ``calibrate``.

    Attributes
    ----------
    scene : with the fitted values. parameters, columns : as fitted. correlation : (p, p), NaN at a bound.
    scatter : root mean square of the residuals over their weights, with n - p. combinations : sentences on
    combinations of parameters that the data do not determine. runs : of the scene. converged : within the runs allowed.
    remarks : on derivatives, residuals, errors.
    """

    scene: Scene
    parameters: tuple[FittedParameter, ...]
    columns: tuple[ColumnFit, ...]
    correlation: Array
    scatter: float
    combinations: tuple[str, ...]
    runs: int
    converged: bool
    remarks: tuple[str, ...]

    def __getitem__(self, name: str) -> FittedParameter:
        """The parameter that a number of the scene belongs to (KeyError where there is none)."""
        for known in self.parameters:
            if name in known.of.names:
                return known
        raise KeyError(name)

    def text(self, source: str | None = None) -> str:
        """The scene with the fitted values, to 6 digits: the text it was read from with these numbers where it has all
        of them, else the effective scene."""
        numbers = {name: float(f"{p.value:.6g}") for p in self.parameters for name in p.of.names}
        made = None if source is None else text_with_numbers(source, numbers, NAMED)
        if made is None:
            return self.scene.text()
        return made

    @property
    def status(self) -> str:
        """How the fit ended."""
        if self.converged:
            return "converged"
        return "not converged within the runs allowed (--max-runs)"

    def lines(self) -> list[str]:
        """Text: values, combinations that are not determined, residuals, remarks."""
        count = sum(len(c.after) for c in self.columns)
        units = self.scene.unit_system
        head = f"{self.scene.name}: {len(self.parameters)} parameter(s) fitted to {count} data"
        head += f", {self.runs} runs, {self.status}"
        table: list[tuple[str, ...]] = [("parameter", "start", "value", "95 % interval", "+-", "by error of run")]
        for p in self.parameters:
            unit, ends = units.shown(p.of.unit()), (p.value - p.half, p.value + p.half)
            known, shift = math.isfinite(p.half) and p.value != 0.0, readable(p.shift, unit, 2) if p.shift else "-"
            if p.bound:
                between = f"at its {p.bound} bound"
            else:
                between = " to ".join(readable(e, unit) for e in ends)
            if known:
                much = f"{100 * p.half / abs(p.value):.2g} %"
            else:
                much = "-"
            table.append((p.of.words, readable(p.of.start, unit), readable(p.value, unit), between, much, shift))
        rows: list[tuple[str, ...]] = [("data", "residual before", "after", "of the data", "error of run")]
        for c in self.columns:
            unit = units.shown(c.column.unit)
            size = float(np.sqrt(np.mean(c.column.values**2))) or math.inf
            sizes = [readable(c.rms(y), unit, 3) for y in (c.before, c.after)]
            if math.isfinite(c.error):
                error = f"{100 * c.error:.2g} %"
            else:
                error = "-"
            name = f"{c.column.name} of {c.table.path}"
            rows.append((name, *sizes, f"{100 * c.rms(c.after) / size:.2g} %", error))
        lines = [head, "", *aligned(table)]
        lines += [line for text in self.combinations for line in wrapped("note", text)]
        lines += ["", *aligned(rows)]
        return [*lines, *(line for text in self.remarks for line in wrapped("warning", text))]

    def report(self) -> dict[str, Any]:
        """Plain data for strict JSON."""
        units = self.scene.unit_system
        parameters = [
            {
                "names": list(p.of.names),
                "unit": units.label(p.of.unit()),
                "start": p.of.start,
                "bounds": [finite(p.of.low), finite(p.of.high)],
                "value": p.value,
                "half_interval": finite(p.half),
                "shift_by_error_of_run": finite(p.shift),
                "at_bound": p.bound or None,
            }
            for p in self.parameters
        ]
        columns = [
            {
                "file": c.table.path,
                "column": c.column.name,
                "unit": units.label(c.column.unit),
                "count": len(c.after),
                "residual_before": finite(c.rms(c.before)),
                "residual_after": finite(c.rms(c.after)),
                "relative_error_of_run": finite(c.error),
            }
            for c in self.columns
        ]
        return {
            "scene": self.scene.name,
            "status": self.status,
            "converged": self.converged,
            "runs": self.runs,
            "confidence": CONFIDENCE,
            "scatter": finite(self.scatter),
            "parameters": parameters,
            "correlation": [[finite(float(x)) for x in row] for row in self.correlation],
            "not_determined": list(self.combinations),
            "columns": columns,
            "warnings": list(self.remarks),
        }


@dataclass(frozen=True)
class FitStatistics:
    """Statistics of a fit (module docstring).

    Attributes
    ----------
    slopes : (n, p) Jacobian over the weights. residuals : (n,) over the weights. floor : (n,) error of the run over the
    weights. free : (p,) parameters that are at no bound.
    """

    slopes: Array
    residuals: Array
    floor: Array
    free: NDArray[np.bool_]

    @property
    def freedom(self) -> int:
        """Degrees of freedom, at least 1."""
        return max(len(self.residuals) - int(self.free.sum()), 1)

    @property
    def scatter(self) -> float:
        """s, of the module docstring."""
        return math.sqrt(float(self.residuals @ self.residuals) / self.freedom)

    @property
    def quantile(self) -> float:
        """t, of the module docstring."""
        return float(student.ppf(0.5 + 0.5 * CONFIDENCE, self.freedom))

    @cached_property
    def _inverse(self) -> Array:
        """A (p_free, n), infinite for parameters that the data do not depend on."""
        own = self.slopes[:, self.free]
        sizes = np.linalg.norm(own, axis=0)
        scaled = np.where(sizes > 0.0, sizes, 1.0)
        # columns of unit length: singular values must not depend on the units of the parameters
        u, size, v = np.linalg.svd(own / scaled, full_matrices=False)
        with np.errstate(divide="ignore"):
            kept = np.maximum(size, np.finfo(float).eps)
        made = (v.T / kept) @ u.T / scaled[:, None]
        return np.where((sizes > 0.0)[:, None], made, np.inf)

    def covariance(self) -> Array:
        """C (p, p), NaN at bounds."""
        made = np.full((len(self.free),) * 2, np.nan)
        with np.errstate(invalid="ignore"):
            half = self._inverse * np.maximum(self.scatter, self.floor)
            made[np.ix_(self.free, self.free)] = half @ half.T
        return made

    def shifts(self) -> Array:
        """Shift (p,) of each parameter by the error of the run, at most; 0 at bounds."""
        made = np.zeros(len(self.free))
        if self.floor.any():
            made[self.free] = np.abs(self._inverse) @ self.floor
        return made

    def directions(self, values: Array) -> list[tuple[float, Array]]:
        """Relative interval and combination (p,) of relative changes, of each singular vector, the smallest interval
        first."""
        _, size, v = np.linalg.svd(self.slopes[:, self.free] * values[self.free], full_matrices=False)
        made = []
        for one, row in zip(size, v, strict=True):
            whole = np.zeros(len(self.free))
            whole[self.free] = row
            made.append((self.quantile * self.scatter / one if one > 0.0 else math.inf, whole))
        return made


def combinations(
    statistics: FitStatistics, parameters: Sequence[FitParameter], values: Array, correlation: Array
) -> list[str]:
    """Sentences on combinations of parameters that the data do not determine."""
    words = [p.words for p in parameters]
    said = list[str]()
    told = set[int]()
    scales = np.where(values != 0.0, np.abs(values), [p.scale for p in parameters])
    directions = statistics.directions(scales)
    for interval, combination in directions:
        if interval <= 1.0:
            continue
        if not math.isfinite(interval):
            much = "at all"
        else:
            much = f"(+-{100 * interval:.2g} %)"
        entering = [
            int(i) for i in np.argsort(-np.abs(combination)) if abs(combination[i]) > _ENTERS * max(abs(combination))
        ]
        told |= set(entering)
        if len(entering) == 1:
            said.append(f"not determined by these data {much}: {words[entering[0]]}")
            continue
        changes = combination[entering] / combination[entering[0]] * 100 * PART
        listing = ", ".join(f"{c:+.2g} % {words[i]}" for c, i in zip(changes, entering, strict=True))
        said.append(f"not determined {much}: {listing} together leave the data as they are within their scatter")
    for i in range(len(words)):
        for j in range(i):
            if abs(correlation[i, j]) > TOGETHER and not {i, j} <= told:
                if correlation[i, j] < 0:
                    sense = "more of one with less of the other"
                else:
                    sense = "more of both"
                said.append(f"{words[j]} and {words[i]} are correlated ({correlation[i, j]:+.3f}): {sense}")
    if said and math.isfinite(directions[0][0]) and len(words) > 1:
        best = directions[0][1] / directions[0][1][np.argmax(np.abs(directions[0][1]))]
        powers = " ".join(f"({w})^{x:.2g}" for w, x in zip(words, best, strict=True) if abs(x) > _ENTERS)
        said.append(f"best determined: {powers}, to +-{100 * directions[0][0]:.2g} %")
    return said


def calibration_of(
    predictor: Predictor,
    parameters: Sequence[FitParameter],
    weights: Array,
    found: tuple[Predicted, Array, bool],
    done: Sequence[Predicted],
    runs: int,
    estimate: bool,
) -> Calibration:
    """The result of a fit: ``found`` the best run, its Jacobian (n, p) and whether the fit came to rest; ``done`` all
    runs that succeeded, in their order."""
    best, slopes, converged = found
    remarks: list[str] = []
    columns, estimated = list[ColumnFit](), None
    if estimate and predictor.runs_in_time and best.solution is not None:
        measured_columns = [column for _, column, _ in columns_of(predictor.tables)]
        estimated = _estimated(predictor.at(best.values), best.solution, measured_columns, remarks)
    for table, column, place in columns_of(predictor.tables):
        error, of_rms = (math.nan, True) if estimated is None else _error_of(estimated, column)
        columns.append(ColumnFit(table, column, done[0].predicted[place], best.predicted[place], error, of_rms))
    values = np.array(best.values)
    scale = np.array([p.scale for p in parameters])
    bound = [_bound(p, v) for p, v in zip(parameters, best.values, strict=True)]
    measured = np.concatenate([c.column.values for c in columns])
    floor = np.concatenate([np.full(len(c.after), c.floor) for c in columns]) / weights
    statistics = FitStatistics(
        slopes / weights[:, None], (best.predicted - measured) / weights, floor, np.array([not b for b in bound])
    )
    covariance = statistics.covariance()
    sizes = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(sizes, sizes)
    fitted = [
        FittedParameter(p, float(v), float(half), float(shift), b)
        for p, v, half, shift, b in zip(
            parameters, values, statistics.quantile * sizes, statistics.shifts(), bound, strict=True
        )
    ]
    if predictor.reason:
        remarks.append(f"derivatives by secants: {predictor.reason}")
        if not converged:
            remarks += ["the secants were not made anew at the end: intervals are rough, give more --max-runs"]
    remarks += _on_derivatives(best, done, weights, scale)
    remarks += _on_residuals(columns, statistics)
    return Calibration(
        scene=predictor.at(best.values),
        parameters=tuple(fitted),
        columns=tuple(columns),
        correlation=correlation,
        scatter=statistics.scatter,
        combinations=tuple(combinations(statistics, parameters, values, correlation)),
        runs=runs,
        converged=converged,
        remarks=tuple(remarks),
    )


def _bound(p: FitParameter, value: float) -> str:
    near = AT_BOUND * p.scale
    if value <= p.low + near:
        return "lower"
    if value >= p.high - near:
        return "upper"
    return ""


def _estimated(scene: Scene, solution: Solution, columns: Sequence[Column], remarks: list[str]) -> ErrorEstimate | None:
    """Estimated error of the last run; why there is none, and its remarks but for those on sensors without a motion in
    ``columns`` that they are about, go to the remarks."""
    try:
        made = estimate_error(scene, solution)
    except LatinError as error:
        remarks.append(f"no estimate of the error of the run: {message_of(error)}")
        return None
    every = band_remarks(scene, solution, list(solution.sensors))
    measured = {c.owner for c in columns if c.of.motion in ("velocity", "acceleration") and not c.of.filtered}
    own = [*(text for text in made.remarks if text not in every), *band_remarks(scene, solution, sorted(measured))]
    remarks += [f"error of the run: {text}" for text in own]
    return made


def _error_of(estimate: ErrorEstimate, column: Column) -> tuple[float, bool]:
    """Estimated relative error of a column, and whether it is one of its root mean square."""
    if (of := column.of.error) is None:
        return math.nan, True
    found = estimate.by_quantity.get(f"{column.owner}.{of.key}")
    return (math.nan if found is None else found.error), of.key.endswith("_rms")


def _on_derivatives(best: Predicted, done: Sequence[Predicted], weights: Array, scale: Array) -> list[str]:
    """Remarks on flagged derivatives, with what they predicted of the last change that two runs show."""
    if not best.flagged:
        return []
    said = [f"derivatives flagged: {text}" for text in best.flagged]
    # pairs of neighbours from the last on
    for a, b in zip(done[-2::-1], done[:0:-1], strict=True):
        step = np.array(b.values) - np.array(a.values)
        if a.slopes is not None and b.slopes is not None and _NEAR[0] < np.abs(step / scale).max() < _NEAR[1]:
            change = (b.predicted - a.predicted) / weights
            # trapezoidal rule along the step
            off = change - 0.5 * (a.slopes + b.slopes) @ step / weights
            share = float(np.linalg.norm(off) / np.linalg.norm(change))
            return [
                *said,
                f"the derivatives predict the change of the data between two runs with an error of {100 * share:.2g} %",
            ]
    return said


def _on_residuals(columns: Sequence[ColumnFit], statistics: FitStatistics) -> list[str]:
    """Remarks on residuals that are not independent, or larger than their standard deviations."""
    said = []
    for c in columns:
        r = c.after - c.column.values
        if (left := c.rms(c.after) / (float(np.sqrt(np.mean(c.column.values**2))) or math.inf)) > _LEFT:
            said.append(
                f"the scene does not follow {c.column.name}: {100 * left:.2g} % of the data are left; check unit, "
                "sign, axis and times of the data, and the parameters"
            )
        if c.table.kind == "history" and len(r) >= _FEW and (total := float(r @ r)) > 0.0:
            following = float(r[1:] @ r[:-1]) / total
            if following > _FOLLOWING:
                # variance of the mean of an autoregressive process of first order
                wider = math.sqrt((1.0 + following) / (1.0 - min(following, 0.99)))
                said.append(
                    f"residuals of {c.column.name} are correlated ({following:.2f} from one to the next): the scene "
                    "does not follow the data, or the noise is not independent; intervals should be some "
                    f"{wider:.1f} times as wide"
                )
    if all(c.column.sd is not None for c in columns) and statistics.scatter > 2.0:
        said.append(f"residuals are {statistics.scatter:.1f} times the standard deviations given")
    return said
