"""Estimated errors of the quantities of a run: data, text, JSON report and dataset."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Final

import numpy as np

from ..latin.outcome import Array, Outcome
from ..scene.quantity_table import FLOOR, definition_of
from ..scene.readable_numbers import aligned, percent, readable
from ..scene.units import SI, UnitSystem
from .groups import StoredGroup, finite
from .prices import Price, price_columns, price_report, price_rows
from .quantities import ByQuantity, rows

MOST_OF_HISTORY: Final = 1.0
"""Relative error of the history of a force beyond which what rests on it has no error."""


@dataclass(frozen=True)
class QuantityEstimate:
    """Estimated error of one quantity.

    Attributes
    ----------
    quantity : ``owner.key``. value : of the run, in ``unit``. error : estimated relative error.
    order : observed order of convergence, NaN where none is observed.
    bound_only : the changes do not decrease from one refinement to the next: the estimate is no more than a bound.
    expected_order : order of convergence that the estimate counts on.
    history : estimated relative error of the history of the force, of a quantity that rests on it: above
        ``MOST_OF_HISTORY`` its own error is infinite.
    prices : of smaller errors (``results.prices.TARGETS``), none where they were not predicted.
    """

    quantity: str
    value: float
    error: float
    order: float = math.nan
    bound_only: bool = True
    expected_order: float = 1.0
    history: float = 0.0
    prices: tuple[Price, ...] = ()

    @property
    def unit(self) -> str:
        """Unit of the value (UDUNITS) in SI."""
        return definition_of(self.quantity).unit

    @property
    def relative_error(self) -> float:
        """The estimated error, at least 0.1 %."""
        return max(self.error, FLOOR)

    @property
    def likely_order(self) -> float:
        """Order that the next refinement is predicted by: the observed one, the expected one where none is observed, or
        where it is out of the range that changes which do not cancel have."""
        if 0.3 <= self.order <= 2.0:
            return self.order
        return self.expected_order

    @property
    def error_text(self) -> str:
        """The estimated error in words, relative or in the unit of the quantity."""
        if definition_of(self.quantity).absolute and math.isfinite(self.error):
            return f"{self.relative_error:.2g}"
        return error_text(self.error)


@dataclass(frozen=True)
class TruncationError:
    """Error of a march by modes that the program has chosen.

    Attributes
    ----------
    errors : relative, by quantity (``run_quantities``). coarse : of the march that it is estimated by, in
        longer steps with fewer modes.
    """

    errors: dict[str, float]
    coarse: Outcome

    @property
    def largest(self) -> tuple[str, float]:
        """The quantity with the largest error, and that; infinite where one has no estimate."""
        if not self.errors:
            return "", math.inf
        name = max(self.errors, key=lambda q: np.nan_to_num(self.errors[q], nan=np.inf))
        return name, float(np.nan_to_num(self.errors[name], nan=np.inf))

    def in_words(self) -> str:
        """The largest error and its quantity."""
        name, error = self.largest
        if np.isfinite(error):
            return f"{100.0 * error:.2g} % ({name})"
        return f"not known ({name or 'no quantity'})"


_NUMBERS: Final = rows(
    """
    value                 | 1 | quantity | value of the quantity, over its unit
    relative_error        | 1 | quantity | estimated relative error
    observed_order        | 1 | quantity | observed order of convergence
    expected_order        | 1 | quantity | order of convergence that the estimate counts on
    """,
    {"observed_order": attrgetter("order")},
)
"""Of a ``QuantityEstimate``."""
_TEXTS: Final = rows(
    """
    quantity      | - | quantity | name of the quantity
    quantity_unit | - | quantity | unit of the quantity
    bound_only    | - | quantity | whether the estimate is only a bound | | estimate bound_only
    """
)


@dataclass(frozen=True)
class ErrorEstimate(ByQuantity[QuantityEstimate]):
    """Estimated errors of all quantities of a run.

    Attributes
    ----------
    quantities : in the order of the interfaces. remarks : limits of the estimate, failed coarser runs.
    cpu : CPU seconds of the coarser runs. spectra : relative errors of shock response spectra by sensor, see
        ``spectra.spectrum_error``.
    """

    quantities: tuple[QuantityEstimate, ...]
    remarks: tuple[str, ...] = ()
    cpu: float = 0.0
    spectra: Mapping[str, Array] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """The remarks, and quantities without an error with the reason."""
        bare = [q for q in self.quantities if not q.history <= MOST_OF_HISTORY]
        owners = dict.fromkeys(q.quantity.rpartition(".")[0] for q in bare)
        sentences = []
        for owner in owners:
            quantities = [q for q in bare if q.quantity.rpartition(".")[0] == owner]
            size = max(q.history for q in quantities)
            if math.isfinite(size):
                off = f"is {percent(size)}"
            else:
                off = "is unknown"
            sentences.append(
                f"{', '.join(q.quantity for q in quantities)}: no error: the history of the force, on which it rests, "
                f"has one that {off}, more than {percent(MOST_OF_HISTORY)}; refine steps and mesh"
            )
        return (*self.remarks, *sentences)

    def report(self, units: UnitSystem = SI) -> dict[str, Any]:
        """Plain data for strict JSON."""
        quantities = {
            q.quantity: {"unit": units.label(q.unit), "bound_only": q.bound_only}
            | {name: finite(row.of(q)) for name, row in _NUMBERS.items()}
            | {"prices": price_report(q.prices)}
            for q in self.quantities
        }
        return {"quantities": quantities, "cpu_seconds": self.cpu, "remarks": list(self.notes)}

    def lines(self, units: UnitSystem = SI) -> list[str]:
        """Text of one row a quantity, then the remarks."""
        notes = ["", *("  only a bound" if q.bound_only and q.error > FLOOR else "" for q in self.quantities)]
        table = [f"{line.strip()}{note}" for line, note in zip(aligned(self.rows(units)), notes, strict=True)]
        return table + [f"  note: {note}" for note in self.notes]

    def rows(self, units: UnitSystem = SI) -> list[tuple[str, ...]]:
        """Table of the quantities with their errors."""
        return [("estimated error", "value", "error", "order (expected)"), *(_row(q, units) for q in self.quantities)]

    def group(self, units: UnitSystem = SI) -> StoredGroup:
        """Group ``accuracy``: one entry a quantity."""
        names = np.array([q.quantity for q in self.quantities], dtype=np.str_)
        labels = np.array([units.label(q.unit) for q in self.quantities], dtype=np.str_)
        # netCDF has no booleans
        bounds = np.array([q.bound_only for q in self.quantities], dtype=np.int8)
        stored = [(row, np.array([row.of(q) for q in self.quantities], dtype=float)) for row in _NUMBERS.values()]
        texts = [(_TEXTS["quantity_unit"], labels), *stored, (_TEXTS["bound_only"], bounds)]
        prices, targets = price_columns(self.quantities)
        attrs = {"remarks": "\n".join(self.notes), "cpu_seconds": self.cpu}
        return StoredGroup.of([*texts, *prices], [(_TEXTS["quantity"], names), *targets], attrs)

    def price_rows(self, most: int | None = None) -> list[tuple[str, ...]]:
        """Table of the prices of smaller errors, its head alone without; ``most`` : of so many headline quantities,
        those with the largest errors."""
        chosen = [q for q in self.quantities if q.prices]
        if most is not None:
            chosen = [q for q in chosen if definition_of(q.quantity).headline]
            chosen = sorted(chosen, key=lambda q: -q.relative_error)[:most]
        return price_rows(chosen)


def _row(q: QuantityEstimate, units: UnitSystem) -> tuple[str, ...]:
    if math.isnan(q.order):
        order = "-"
    else:
        order = f"{q.order:.1f}"
    return q.quantity, readable(q.value, units.shown(q.unit)), q.error_text, f"{order} ({q.expected_order:g})"


def error_text(error: float) -> str:
    """A relative error in per cent, two digits.

    >>> error_text(0.0123), error_text(1e-5)
    ('1.2 %', '< 0.1 %')
    """
    if not math.isfinite(error):
        return "unknown"
    if error < FLOOR:
        return f"< {100 * FLOOR:g} %"
    return percent(error)
