"""Bands of the results of a run whose parameters scatter, to first order in them: data, groups of the file, sentences.

With the derivatives q_i of a result by independent parameters of standard deviations s_i, its standard deviation is
sigma = sqrt(sum (q_i s_i)^2), and its mean that of the run but for parameters whose range has another middle than their
value. Ends at 95 % are mean +- k sigma: k = 1.960 where all parameters are normal, 1.645 for one uniform one. Between,
the excess kurtosis of the sum, -1.2 sum over the uniform ones of (q_i s_i)^4 / sigma^4, chooses the symmetric
distribution of Pearson's family (a beta distribution): exact for one uniform parameter and for normal ones, within
1 % for two equal uniform ones (R. Willink, A procedure for the evaluation of measurement uncertainty based on
moments, Metrologia 42 (2005) 329-343).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from ..latin.outcome import Array, BoltHistory, InterfaceHistory, Outcome, SensorHistory
from ..scene.quantity_table import in_words as quantity_in_words
from ..scene.readable_numbers import percent, readable
from ..scene.sensors import Sensor
from ..scene.spread import Distribution
from ..scene.units import SI, UnitSystem
from .groups import StoredGroup, StoredVariable, finite
from .quantities import AXES, BOLT, INTERFACE, LABELS, ByQuantity, named, rows
from .sensitivities import DOUBT, Sensitivities, in_words
from .sensors import filter_of, sensor_group
from .sentences import named_lines
from .spectra import ShockSpectrum, spectrum_group

LEVEL: Final = 0.95
"""Probability of a band."""
PATH: Final = "/spread/"
"""Of the groups of bands in a file."""
SAMPLED: Final = "sampled"
"""Part of the names of variables of samples, beside those of the bands to first order."""
UNIFORM: Final = -1.2
"""Excess kurtosis of a uniform distribution."""
_NORMAL: Final = 1e-5  # excess kurtosis above which a sum counts as normal
_COUNTS: Final = 0.01  # share of a variance from which on a flagged derivative counts
_ASKEW: Final = 0.02  # shift of the middle of a band over its half width that is printed


def coverage(kurtosis: Array) -> Array:
    """Half width of a band at LEVEL over the standard deviation, from the excess kurtosis, -1.2 to 0.

    >>> coverage(np.array([0.0, -1.2])).round(3).tolist()
    [1.96, 1.645]
    """
    from scipy.special import betaincinv, ndtri

    upper, size = 0.5 + 0.5 * LEVEL, np.minimum(kurtosis, -_NORMAL)
    alpha = -0.5 * (6.0 / size + 3.0)
    beta = (2.0 * betaincinv(alpha, alpha, upper) - 1.0) * np.sqrt(2.0 * alpha + 1.0)
    return np.asarray(np.where(kurtosis > -_NORMAL, ndtri(upper), beta))


@dataclass(frozen=True)
class ResultBand:
    """Band of a result of any shape: mean, standard deviation, and ``factor``, half its width at LEVEL over that."""

    mean: Array
    deviation: Array
    factor: Array

    @property
    def half(self) -> Array:
        """Half width of the band, in the unit of the result."""
        return self.factor * self.deviation

    @property
    def low(self) -> Array:
        """Lower end of the band."""
        return np.asarray(self.mean - self.half)

    @property
    def high(self) -> Array:
        """Upper end of the band."""
        return np.asarray(self.mean + self.half)


@dataclass(frozen=True)
class Scatter:
    """Parameters that scatter.

    Attributes
    ----------
    distributions : by name. places : of them among the derivatives of a run. scales : changes that derivatives are for.
    """

    distributions: Mapping[str, Distribution]
    places: Sequence[int]
    scales: Array

    @property
    def _all(self) -> Sequence[Distribution]:
        return list(self.distributions.values())

    def parts(self, changes: Array) -> Array:
        """q_i s_i of each parameter, (n, ...), from derivatives (n_derivative, ...)."""
        weights = np.array([d.deviation for d in self._all]) / self.scales
        return np.asarray(changes[self.places] * weights.reshape(-1, *[1] * (changes.ndim - 1)))

    def band(self, value: Array, changes: Array) -> ResultBand:
        """Band of a result with its derivatives (n_derivative, ...)."""
        parts = self.parts(changes)
        squares = parts * parts
        variance = squares.sum(axis=0)
        uniform = np.array([d.uniform for d in self._all])
        shifts = np.array([(d.mean - d.value) / d.deviation for d in self._all]).reshape(-1, *[1] * (parts.ndim - 1))
        fourth = np.square(squares[uniform] / np.where(variance > 0.0, variance, 1.0)).sum(axis=0)
        return ResultBand(value + (shifts * parts).sum(axis=0), np.sqrt(variance), coverage(UNIFORM * fourth))


@dataclass(frozen=True)
class QuantityBand:
    """A scalar quantity, ``owner.key``, of the run, with its band; ``shares`` of the parameters in its variance,
    ``flagged`` : whether the derivative by one of these is."""

    quantity: str
    unit: str
    value: float
    band: ResultBand
    shares: Array
    flagged: bool

    def text(self, label: str) -> str:
        """Value and band with their unit, ``label``."""
        half, shift = float(self.band.half), float(self.band.mean) - self.value
        text = readable(self.value, label)
        if half == 0.0:
            return f"{text}, does not change"
        if abs(shift) > _ASKEW * half:
            return f"{text}, {readable(float(self.band.low), label)} to {readable(float(self.band.high), label)}"
        if self.value:
            share = f" ({percent(half / abs(self.value))})"
        else:
            share = ""
        return f"{text} +- {readable(half, label, 3)}{share}"


@dataclass(frozen=True)
class Bands(ByQuantity[QuantityBand]):
    """Bands of a run (module docstring).

    Attributes
    ----------
    scatter : its parameters. quantities : scalars. histories : results over time and spectra of the run, groups by
        path. bands : of these, by path and name of the variable.
    alone : whether the scene names no other parameters to differentiate by.
    """

    scatter: Scatter
    quantities: Sequence[QuantityBand]
    histories: Mapping[str, StoredGroup]
    bands: Mapping[str, Mapping[str, ResultBand]]
    alone: bool

    @staticmethod
    def of(
        outcome: Outcome,
        sensitivities: Sensitivities,
        distributions: Mapping[str, Distribution],
        requests: Mapping[str, Sensor],
        spectra: Mapping[str, ShockSpectrum],
    ) -> Bands:
        """Bands of a run from its derivatives; ``requests``, ``spectra`` : tables and spectra of its sensors."""
        names = [d.name for d in sensitivities.derivatives]
        places = [names.index(name) for name in distributions]
        scatter = Scatter(distributions, places, np.array([sensitivities.derivatives[i].scale for i in places]))
        quantities = []
        for q in sensitivities.quantities:
            band, squares = scatter.band(np.array(q.value), q.changes), scatter.parts(q.changes) ** 2
            shares = squares / (squares.sum() or 1.0)
            flagged = bool((q.flagged[places] & (shares > _COUNTS)).any())
            quantities.append(QuantityBand(q.quantity, q.unit, q.value, band, shares, flagged))
        linear = linear_results(outcome, outcome.time, requests)
        changed = [linear_results(d, outcome.time, requests) for d in sensitivities.derivatives]
        changes = {
            path: {name: np.stack([results_in(other[path])[name] for other in changed]) for name in results_in(group)}
            for path, group in linear.items()
        }
        changes |= {path: results_in(group) for path, group in spectrum_groups(sensitivities.spectra).items()}
        histories = linear | spectrum_groups(spectra)
        bands = {
            path: {name: scatter.band(values, changes[path][name]) for name, values in results_in(group).items()}
            for path, group in histories.items()
        }
        return Bands(scatter, quantities, histories, bands, len(places) == len(names))

    def groups(self, units: UnitSystem = SI) -> dict[str, StoredGroup]:
        """Groups of the results file by path."""
        distributions, quantities = list(self.scatter.distributions.values()), self.quantities
        labels = {
            "parameter": np.array(list(self.scatter.distributions), dtype=np.str_),
            "quantity": np.array([q.quantity for q in quantities], dtype=np.str_),
        }
        of_parameters: dict[str, object] = {
            "parameter_mean": np.array([d.mean for d in distributions]),
            "parameter_deviation": np.array([d.deviation for d in distributions]),
            "distribution": np.array([d.uniform for d in distributions], dtype=np.int8),
            "quantity_unit": np.array([units.label(q.unit) for q in quantities], dtype=np.str_),
            "value": np.array([q.value for q in quantities]),
            "deviation": np.array([q.band.deviation for q in quantities]),
            "low": np.array([q.band.low for q in quantities]),
            "high": np.array([q.band.high for q in quantities]),
            "share": np.array([q.shares for q in quantities]).reshape(-1, len(distributions)),
            "flagged": np.array([q.flagged for q in quantities], dtype=np.int8),
        }
        groups = {"/spread": StoredGroup.of(named(_ROWS, of_parameters), named(_ROWS, labels), {"probability": LEVEL})}
        return groups | {
            path: StoredGroup(group.variables | ends_of(group, self.bands[path]), group.labels)
            for path, group in self.histories.items()
        }

    def lines(self, units: UnitSystem = SI) -> list[str]:
        """One line a quantity: value, band, the parameter with the largest share of its variance."""
        texts = [(quantity_in_words(q.quantity), self._text(q, units)) for q in self.quantities]
        head = f"  at {100 * LEVEL:g} %, to first order in {len(self.scatter.distributions)} parameters that scatter:"
        return [head, *named_lines(texts)]

    def _text(self, q: QuantityBand, units: UnitSystem) -> str:
        text = q.text(units.shown(q.unit))
        if q.shares.any():
            most = int(np.argmax(q.shares))
            text += (
                f"; {100 * q.shares[most]:.0f} % of its variance by {in_words(list(self.scatter.distributions)[most])}"
            )
        return text + DOUBT * q.flagged

    def report(self, units: UnitSystem = SI) -> dict[str, Any]:
        """Plain data for strict JSON: per quantity its unit, value, standard deviation, ends of the band, shares of the
        parameters in its variance, whether it is flagged; ``parameters`` with mean and standard deviation."""
        names = list(self.scatter.distributions)
        quantities = {
            q.quantity: {
                "unit": units.label(q.unit),
                "value": finite(q.value),
                "deviation": finite(float(q.band.deviation)),
                "low": finite(float(q.band.low)),
                "high": finite(float(q.band.high)),
                "shares": dict(zip(names, map(finite, q.shares.tolist()), strict=True)),
                "flagged": q.flagged,
            }
            for q in self.quantities
        }
        scattered = self.scatter.distributions.items()
        parameters = {n: {"mean": d.mean, "deviation": d.deviation, "uniform": d.uniform} for n, d in scattered}
        return {"probability": LEVEL, "parameters": parameters, "quantities": quantities}


class _Histories(Protocol):
    """Histories of a run, or their derivatives."""

    @property
    def interfaces(self) -> Mapping[str, InterfaceHistory]: ...

    @property
    def sensors(self) -> Mapping[str, SensorHistory]: ...

    @property
    def bolts(self) -> Mapping[str, BoltHistory]: ...


def linear_results(of: _Histories, time: Array, requests: Mapping[str, Sensor]) -> dict[str, StoredGroup]:
    """Results over time that are linear in tractions and motions, of a run or of derivatives, by path of their group;
    motions of sensors behind their filters, which are linear, too."""
    along = named(LABELS, {"time": time, "component": AXES})
    groups = {
        f"{PATH}interfaces/{name}": StoredGroup.of(
            [(INTERFACE["force"], h.force()), (_NORMAL_FORCE, h.normal_resultant())], along
        )
        for name, h in of.interfaces.items()
    }
    for name, sensor in of.sensors.items():
        whole = sensor_group(sensor, time, filter_of(requests, name))
        variables = {key: v for key, v in whole.variables.items() if key not in whole.labels or v.dims == (key,)}
        groups[f"{PATH}sensors/{name}"] = StoredGroup(variables, whole.labels & set(variables))
    for name, bolt in of.bolts.items():
        group = StoredGroup.of([(BOLT["force"], bolt.force)], named(LABELS, {"time": time}))
        groups[f"{PATH}bolts/{name}"] = group
    return groups


def spectrum_groups(spectra: Mapping[str, ShockSpectrum]) -> dict[str, StoredGroup]:
    """Spectra of sensors, or their derivatives, by path of their group."""
    return {f"{PATH}sensors/{name}/spectrum": spectrum_group(spectrum) for name, spectrum in spectra.items()}


def results_in(group: StoredGroup) -> dict[str, Array]:
    """Values of the variables of a group that are no labels."""
    return {name: v.values for name, v in group.variables.items() if name not in group.labels}


def ends_of(group: StoredGroup, bands: Mapping[str, ResultBand], of: str = "") -> dict[str, StoredVariable]:
    """Both ends of the bands of the variables of a group; ``of`` : what else has bands, as part of their names."""
    ends = {}
    for name, band in bands.items():
        variable = group.variables[name]
        for word, values, share in (("low", band.low, 0.5 - 0.5 * LEVEL), ("high", band.high, 0.5 + 0.5 * LEVEL)):
            meaning = f"{variable.attrs['long_name']}: {100 * share:g} % of all are below"
            end = f"{name}_{word}"
            if of:
                meaning = f"{meaning}, {of}"
                end = f"{name}_{of}_{word}"
            attrs = {key: v for key, v in variable.attrs.items() if key == "units"} | {"long_name": meaning}
            ends[end] = StoredVariable(variable.dims, values, attrs)
    return ends


_NORMAL_FORCE: Final = rows("normal_force | N | time | normal resultant, positive in compression")["normal_force"]
_ROWS: Final = rows(
    """
    parameter | - | parameter | dotted name of a number of the scene that scatters
    quantity  | - | quantity  | name of the quantity
    parameter_mean | 1 | parameter | mean of the parameter, over its unit
    parameter_deviation | 1 | parameter | standard deviation of the parameter, over its unit
    distribution | - | parameter | distribution of the parameter | | normal uniform
    quantity_unit | - | quantity | unit of the quantity
    value     | 1 | quantity | value of the quantity in the run, over its unit
    deviation | 1 | quantity | standard deviation of the quantity, over its unit, to first order
    low       | 1 | quantity | lower end of the band of the quantity, over its unit
    high      | 1 | quantity | upper end of the band of the quantity, over its unit
    share     | 1 | quantity parameter | share of the parameter in the variance of the quantity
    flagged   | - | quantity | whether states change at instants that the quantity depends on | | no yes
    """
)
