"""Predictions of measured data by a scene, and their derivatives by its parameters.

Histories are taken linearly between the instants of the run, and their derivatives from ``output.sensitivities`` of the
same run, as those of spectra are. Frequencies and backbones have no derivatives here, nor have runs whose derivatives
are refused.

A backbone is computed at a few amplitudes over the range of the data, and taken linearly over the logarithm of the
amplitude between them and beyond.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from .. import api
from ..assembly.models import KeptOperators
from ..errors import InputError, SceneError, SolverError
from ..latin.outcome import Array, BoltHistory, InterfaceHistory
from ..modal.backbone import backbone
from ..modal.modes import vibration_modes
from ..results.filters import low_pass, uniform_step
from ..results.sensitivities import MANY, Sensitivities, in_words
from ..results.solution import Solution
from ..results.spectra import LINES, ShockSpectrum, shock_response_spectrum, spectrum_changes
from ..scene.schema import Scene
from .data import HEADING, Column, MeasuredTable, columns_of, size_of

LEVELS: Final = 6
"""Amplitudes at which a backbone is computed, at most."""
_KEY: Final = "output.sensitivities"
_NO_FIELDS: Final = ("fields", "stress", "nodal_stress", "principal_stress", "strain", "surfaces", "energy")
Names = tuple[str, ...]
"""Dotted names of the numbers of a scene that one parameter is the value of."""


@dataclass(frozen=True)
class Predicted:
    """Predictions of all data with one set of values.

    Attributes
    ----------
    values : (n_parameter,). predicted : (n,). slopes : (n, n_parameter) derivatives, None where there are none.
    flagged : sentences on derivatives that are flagged. solution : the run, None where there is none.
    """

    values: tuple[float, ...]
    predicted: Array
    slopes: Array | None
    flagged: tuple[str, ...] = ()
    solution: Solution | None = None


class Predictor:
    """Predicts the data from a scene.

    Parameters
    ----------
    parameters : names in the scene, by parameter. mode, increments : of backbones, see ``modal.backbone``.

    Attributes
    ----------
    exact : whether derivatives come from the run; ``reason``: why not.
    """

    def __init__(
        self, scene: Scene, tables: Sequence[MeasuredTable], parameters: Sequence[Names], mode: int, increments: int
    ) -> None:
        self.scene = scene
        self.tables = tables
        self._parameters = parameters
        self._mode, self._increments = mode, increments
        self._kept = KeptOperators()
        self.runs_in_time = any(table.kind in ("history", "spectrum") for table in tables)
        static = sorted({table.kind for table in tables} - {"history", "spectrum"})
        if static:
            self.reason = f"there are none of {' and '.join(static)}"
        else:
            self.reason = ""

    @property
    def exact(self) -> bool:
        """Whether derivatives come from the run."""
        return not self.reason

    def at(self, values: Sequence[float]) -> Scene:
        """The scene with these values of the parameters, with its output as written.

        Raises
        ------
        SceneError : values that the scene does not allow.
        """
        scene = self.scene
        for names, value in zip(self._parameters, values, strict=True):
            for name in names:
                scene = scene.replace(name, float(value))
        return scene

    def __call__(self, values: Sequence[float]) -> Predicted:
        """Predictions by one run of the scene, by its modes or by its backbone.

        Raises
        ------
        LatinError : the scene cannot be built or solved with these values, or the run does not converge.
        """
        scene, solution = self.at(values), None
        if self.runs_in_time:
            plain = scene.undifferentiated
            unkept = {**dict.fromkeys(_NO_FIELDS, False), "check_sensitivities": "none"}
            solution = self._solved(plain.model_copy(update={"output": plain.output.model_copy(update=unkept)}))
        curves = {table.path: self._static(table, scene) for table in self.tables}
        predicted = np.empty(size_of(self.tables))
        slopes = np.empty((len(predicted), len(self._parameters)))
        for table, column, place in columns_of(self.tables):
            if solution is None or table.kind not in ("history", "spectrum"):
                predicted[place] = curves[table.path][column.quantity]
                continue
            own = self._series(getattr(solution, column.of.table), column, solution)
            predicted[place] = self._of_series(table, column, own, solution)
            if self.exact:
                slopes[place] = self._slopes(table, column, solution)
        if not np.isfinite(predicted).all():
            raise SolverError("the run has no finite values at some of the data")
        flagged = tuple(self._flagged(solution)) if solution is not None and self.exact else ()
        return Predicted(tuple(map(float, values)), predicted, slopes if self.exact else None, flagged, solution)

    def _solved(self, scene: Scene) -> Solution:
        """The run, with derivatives where they are known."""
        wanted = [name for names in self._parameters for name in names] if self.exact else []
        try:
            solution = api.solve(scene.replace(_KEY, wanted), kept=self._kept)
        except SceneError as error:
            # other problems would come again without derivatives
            if not wanted or any(problem.where != _KEY for problem in error.problems):
                raise
            self.reason = "; ".join(f"{p.value}: {p.what}" if p.value else p.what for p in error.problems)
            return self._solved(scene)
        if not solution.converged:
            raise SolverError(f"the run did not converge: {solution.status}")
        if wanted and solution.sensitivities is None:
            self.reason = next((str(w) for w in solution.warnings if "no derivatives" in str(w)), "no derivatives")
        return solution

    def _static(self, table: MeasuredTable, scene: Scene) -> dict[str, Array]:
        """Predictions of frequencies and damping by the name of the column."""
        if table.kind == "modes":
            number = table.along.astype(int)
            modes = vibration_modes(scene, "sticking", int(number.max()))
            elastic = modes.frequency[~modes.rigid]
            if len(elastic) < number.max():
                what = f"the assembly has {len(elastic)} elastic modes"
                raise InputError.of(HEADING, table.path, what, str(number.max()), remedy="remove the row")
            return {"frequency": elastic[number - 1]}
        if table.kind == "backbone":
            ends = table.along[0], table.along[-1]
            # each costs a loop of static solutions; between them the curve is smooth
            if len(table.along) > LEVELS:
                levels = np.geomspace(*ends, LEVELS)
            else:
                levels = np.unique(table.along)
            curve = backbone(scene, self._mode, levels, table.sensor, increments=self._increments, within=np.inf)
            places, known = np.log(table.along), np.log(curve.amplitude)
            return {key: _linear(places, known, getattr(curve, key)) for key in ("frequency", "damping")}
        return {}

    def _series(self, histories: Mapping[str, Any], column: Column, solution: Solution) -> Array:
        """Series (n_time,) of a column from the histories, or their derivatives, of all owners by name."""
        history = histories[column.owner]
        if isinstance(history, BoltHistory):
            return history.force
        if isinstance(history, InterfaceHistory):
            if column.axis is None:
                return history.normal_resultant()
            return history.force()[:, column.axis]
        motion = getattr(history, column.of.motion)
        if motion is None:
            raise InputError.of(HEADING, f"sensor.{column.owner}", f"it has no acceleration ({history.remark})")
        chosen = self.scene.sensor[column.owner].filter
        if column.of.filtered and chosen is not None:
            motion = low_pass(motion, chosen, uniform_step(solution.time))
        return np.asarray(motion[:, column.axis])

    def _changes(self, solution: Solution, column: Column) -> Iterator[Array]:
        """Derivative of the series of a column by each parameter."""
        assert solution.sensitivities is not None
        known = {d.name: d for d in solution.sensitivities.derivatives}
        for names in self._parameters:
            # stored as the change for the scale of the parameter
            parts = [self._series(getattr(known[n], column.of.table), column, solution) / known[n].scale for n in names]
            yield np.sum(parts, axis=0)

    def _of_series(self, table: MeasuredTable, column: Column, series: Array, solution: Solution) -> Array:
        """What a series (n_time,) of the run gives at the data of a column."""
        if table.kind == "history":
            return np.interp(table.along, solution.time, series)
        return np.asarray(self._spectrum(table, column, series, solution).acceleration[0])

    def _spectrum(self, table: MeasuredTable, column: Column, motion: Array, solution: Solution) -> ShockSpectrum:
        """Spectrum of accelerations (n_time, ...) at the frequencies of a table."""
        request = self.scene.sensor[column.owner].spectrum
        if request is None:
            quality = 10.0
        else:
            quality = request.quality
        return shock_response_spectrum(motion, uniform_step(solution.time), table.along, quality, interpolation=LINES)

    def _slopes(self, table: MeasuredTable, column: Column, solution: Solution) -> Array:
        """Derivatives (n, n_parameter) of the data of a column."""
        moved = list(self._changes(solution, column))
        if table.kind == "history":
            return np.stack([self._of_series(table, column, series, solution) for series in moved], axis=1)
        history, changes = solution.sensors[column.owner], np.zeros((len(moved), len(solution.time), 3))
        changes[:, :, column.axis] = moved
        own = self._spectrum(table, column, np.asarray(history.acceleration), solution)
        return np.asarray(spectrum_changes(own, history, solution.time, changes).acceleration[:, 0, :, column.axis].T)

    def _flagged(self, solution: Solution) -> Iterator[str]:
        """Sentences on the derivatives of a run that are flagged."""
        known = solution.sensitivities
        assert known is not None
        for i, d in enumerate(known.derivatives):
            columns = [
                column.name
                for _, column, _ in columns_of(self.tables)
                for flag in column.of.flags
                if (q := known.by_quantity.get(f"{column.owner}.{flag}")) is not None and q.flagged[i]
            ]
            if columns:
                listing = ", ".join(dict.fromkeys(columns))
                yield f"{listing} by {in_words(d.name)}: contact states change at {_events(known, i)} of the instants"


def _linear(places: Array, known: Array, values: Array) -> Array:
    """Values (n,) at places by straight lines between those known, and beyond their ends: a joint that slides goes
    further than the amplitude aimed at, so that the smallest datum is below all of the curve."""
    if len(known) == 1:
        return np.full(len(places), values[0])
    i = np.clip(np.searchsorted(known, places) - 1, 0, len(known) - 2)
    return np.asarray(values[i] + (values[i + 1] - values[i]) * (places - known[i]) / (known[i + 1] - known[i]))


def _events(known: Sensitivities, parameter: int) -> str:
    """Share of the instants, in per cent, at which much of a contact area changes its state."""
    events = np.any([share[parameter] > MANY for share in known.changing.values()], axis=0)
    return f"{100 * np.mean(events):.2g} %"
