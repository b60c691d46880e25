"""What a run is judged by: spectra of sensors against their limits, safeties of bolts against the smallest allowed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..latin.outcome import Array, Outcome
from ..scene.limits import UNIT_OF, Limit
from ..scene.readable_numbers import readable
from ..scene.sensors import highest_frequency
from ..scene.units import SI, UnitSystem
from ..shock.oscillators import RESPONSES
from .bolt_margins import BoltMargin, BoltMargins
from .groups import StoredGroup, finite
from .quantities import LABELS, LIMIT, named
from .spectra import LINES, shock_response_spectrum

_ROUND_OFF: Final = 1e-9  # a value that is the limit does not exceed it
EXCEEDED: Final = "exceeded"
MET: Final = "met"
UNKNOWN: Final = "not judged"
"""States of a limit."""


class LimitCheck(ABC):
    """A limit beside what the run has; ``limit`` : name of its table, ``of`` : of the sensor or bolt."""

    limit: str
    of: str

    @property
    @abstractmethod
    def share(self) -> float | None:
        """What is there over what is allowed, of a safety the inverse; None where it is not known."""

    @property
    def state(self) -> str:
        """``EXCEEDED``, ``MET`` or ``UNKNOWN``."""
        if self.share is None:
            return UNKNOWN
        if self.share > 1.0 + _ROUND_OFF:
            return EXCEEDED
        return MET

    @abstractmethod
    def clause(self, units: UnitSystem = SI) -> str:
        """How the limit is met or exceeded, in words."""

    @abstractmethod
    def report(self) -> dict[str, Any]:
        """Plain data for JSON."""

    @abstractmethod
    def group(self, units: UnitSystem) -> StoredGroup:
        """Group ``limits/NAME`` of the results file, labelled in a system of units."""

    def _attributes(self, units: UnitSystem) -> dict[str, Any]:
        return {"limit": self.limit, "of": self.of, "state": self.state, "sentence": self.clause(units)}


@dataclass(frozen=True)
class SpectrumCheck(LimitCheck):
    """A spectrum of a sensor beside its limit.

    Attributes
    ----------
    table : the limit. frequency : (n,), Hz. values, allowed : (n,) there, in the unit of the kind; none where the
    sensor has no acceleration.
    """

    limit: str
    table: Limit
    frequency: Array
    values: Array
    allowed: Array

    @property
    def of(self) -> str:  # type: ignore[override]
        """Name of the sensor."""
        return str(self.table.sensor)

    @property
    def share(self) -> float | None:
        """Largest ratio of the spectrum to its limit."""
        if not len(self.frequency):
            return None
        return float(self._shares.max())

    @property
    def _shares(self) -> Array:
        return np.asarray(self.values / self.allowed)

    def clause(self, units: UnitSystem = SI) -> str:
        """Factor and frequency of the worst one, both values, and between which frequencies it is exceeded."""
        if self.share is None:
            return f"not judged: sensor {self.of} has no acceleration at these frequencies"
        i = int(self._shares.argmax())
        unit, at = units.shown(UNIT_OF[self.table.kind]), readable(float(self.frequency[i]), "Hz", 3)
        has, may = (readable(float(values[i]), unit, 3) for values in (self.values, self.allowed))
        along = "" if self.table.component is None else f" along {self.table.component}"
        what = f"{self.table.response} {self.table.kind.replace('_', ' ')} spectrum (Q {self.table.quality:g}){along}"
        numbers = f"{what} {has}, allowed {may}"
        if self.state == MET:
            return f"met: nearest at {at}, {self.share:.3g} times what is allowed: {numbers}"
        above = self.frequency[self._shares > 1.0 + _ROUND_OFF]
        where = ""
        if len(above) > 1:
            where = f"; above it between {readable(above[0], 'Hz', 3)} and {readable(above[-1], 'Hz', 3)}"
        return f"EXCEEDED {self.share:.3g} times at {at}: {numbers}{where}"

    def report(self) -> dict[str, Any]:
        """``sensor``, ``state``, ``factor`` (largest ratio of spectrum to limit), and its ``frequency``, ``value`` and
        ``allowed``."""
        found: dict[str, Any] = {"sensor": self.of, "state": self.state, "factor": None}
        if self.share is None:
            return found
        i = int(self._shares.argmax())
        found["factor"] = finite(self.share)
        return found | {
            "frequency": finite(float(self.frequency[i])),
            "value": finite(float(self.values[i])),
            "allowed": finite(float(self.allowed[i])),
        }

    def group(self, units: UnitSystem) -> StoredGroup:
        """``spectrum`` and ``allowed`` over frequency."""
        fields = {"spectrum": self.values, "allowed": self.allowed}
        stored = StoredGroup.of(named(LIMIT, fields), named(LABELS, {"frequency": self.frequency}))
        for name in fields:
            stored.variables[name].attrs["units"] = UNIT_OF[self.table.kind]
        stored.attrs |= self._attributes(units) | {
            "kind": self.table.kind,
            "response": self.table.response,
            "quality": self.table.quality,
        }
        return stored


@dataclass(frozen=True)
class SafetyCheck(LimitCheck):
    """A safety of a bolt beside the smallest one that is allowed.

    Attributes
    ----------
    of : name of the bolt. check : key of ``bolt_margins.CHECKS``, None where the limit is of all. margin : that, or
    the smallest one; None where it is not known. least : smallest safety. why : sentences on what is not known.
    """

    limit: str
    of: str
    check: str | None
    margin: BoltMargin | None
    least: float
    why: tuple[str, ...] = ()

    @property
    def share(self) -> float | None:
        """Smallest safety that is allowed over that of the run."""
        if self.margin is None or np.isnan(self.margin.safety):
            return None
        if self.margin.safety <= 0.0:
            return np.inf
        return self.least / self.margin.safety

    def clause(self, units: UnitSystem = SI) -> str:
        """The safety, its check and clause, and the smallest one that is allowed."""
        del units
        if self.margin is None or self.share is None:
            of = "none of its checks is known" if self.check is None else f"{self.check} is not known"
            return "; ".join([f"not judged: bolt {self.of}: {of}", *self.why])
        words = f"bolt {self.of}: {self.margin.check} ({self.margin.clause}) {self.margin.safety:.3g}"
        words += f", at least {self.least:g} is required"
        if self.check is None:
            words = "; ".join([words, *self.why])
        if self.state == MET:
            return f"met: {words}"
        return f"EXCEEDED {self.share:.3g} times: {words}"

    def report(self) -> dict[str, Any]:
        """``bolt``, ``check``, ``state``, ``factor`` (smallest allowed safety over that of the run), ``safety`` and
        ``least``."""
        check, safety, factor = self.check, None, None
        if self.margin is not None and self.share is not None:
            check, safety, factor = self.margin.check, finite(self.margin.safety), finite(self.share)
        found = {"bolt": self.of, "check": check, "state": self.state, "factor": factor}
        return found | {"safety": safety, "least": self.least}

    def group(self, units: UnitSystem) -> StoredGroup:
        """``safety`` and ``least``."""
        safety = np.nan if self.margin is None else self.margin.safety
        attrs = self._attributes(units) | {"check": self.check or (self.margin.check if self.margin else "")}
        return StoredGroup.of(named(LIMIT, {"safety": safety, "least": self.least}), attrs=attrs)


def limit_checks(outcome: Outcome, limits: Mapping[str, Limit]) -> dict[str, LimitCheck]:
    """Every limit beside what a run has, by its name; of a limit of several bolts by ``NAME.BOLT``."""
    found: dict[str, LimitCheck] = {}
    for name, table in limits.items():
        if table.sensor is not None:
            found[name] = _spectrum(name, table, outcome)
            continue
        safeties = list(_safeties(name, table, outcome))
        for of in safeties:
            found[name if len(safeties) == 1 else f"{name}.{of.of}"] = of
    return found


def _spectrum(name: str, table: Limit, outcome: Outcome) -> SpectrumCheck:
    history, time, grid = outcome.sensors.get(str(table.sensor)), outcome.time, table.specification.grid()
    nothing = np.zeros(0)
    if history is None or history.acceleration is None or len(time) < 2:
        return SpectrumCheck(name, table, nothing, nothing, nothing)
    step = float(time[-1] - time[0]) / (len(time) - 1)
    # of a run in longer steps than the scene has
    grid = grid[grid <= highest_frequency(step) * (1.0 + _ROUND_OFF)]
    if not len(grid):
        return SpectrumCheck(name, table, nothing, nothing, nothing)
    spectrum = shock_response_spectrum(history.acceleration, step, grid, table.quality, interpolation=LINES)
    values = np.asarray(getattr(spectrum, table.kind))[RESPONSES.index(table.response)]
    if table.component is None:
        values = values.max(axis=1)
    else:
        values = values[:, "xyz".index(table.component)]
    return SpectrumCheck(name, table, grid, values, table.specification.at(grid))


def _safeties(name: str, table: Limit, outcome: Outcome) -> Iterator[SafetyCheck]:
    least = float(table.least or 1.0)
    for bolt in table.bolts(outcome.bolts):
        margins = BoltMargins.of(outcome.bolts[bolt], outcome.interfaces)
        if table.check is None:
            margin = margins.smallest
        else:
            margin = margins.margins.get(table.check)
        yield SafetyCheck(name, bolt, table.check, margin, least, tuple(margins.missing))


def limit_groups(found: Mapping[str, LimitCheck], units: UnitSystem) -> dict[str, StoredGroup]:
    """Groups ``limits/NAME`` by path."""
    return {f"/limits/{name}": of.group(units) for name, of in found.items()}


def limit_rows(found: Mapping[str, LimitCheck], units: UnitSystem = SI) -> list[tuple[str, str]]:
    """Name and text of every limit."""
    return [(f"limit {name}", of.clause(units)) for name, of in found.items()]
