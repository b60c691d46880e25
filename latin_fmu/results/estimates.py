"""The estimated error of a run, quantity by quantity: plain data, its text and its dataset."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .groups import Group, Variable
from .summary import readable


@dataclass(frozen=True)
class QuantityEstimate:
    """What is known of the error of one quantity.

    Attributes
    ----------
    quantity : ``owner.key``. value : in ``unit`` (UDUNITS), of the run. error : estimated relative error.
    order : observed order of convergence, NaN where none can be told. expected_order : of this kind of quantity.
    bound_only : the observed order is not the expected one: the estimate is a bound, and may be far too large.
    mesh, time : relative change when the mesh alone, or the time step alone, is twice as coarse (NaN: not tried).
    """

    quantity: str
    value: float
    unit: str
    error: float
    order: float
    expected_order: float
    bound_only: bool
    mesh: float
    time: float


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimates of all quantities of a run.

    Attributes
    ----------
    quantities : in the order of the interfaces. remarks : what the estimate leaves out, what failed.
    cpu : CPU seconds of the companion runs. floor : relative error below which none is claimed.
    """

    quantities: tuple[QuantityEstimate, ...]
    remarks: tuple[str, ...]
    cpu: float
    floor: float

    def __getitem__(self, quantity: str) -> QuantityEstimate:
        """The estimate of one quantity (KeyError where there is none)."""
        for found in self.quantities:
            if found.quantity == quantity:
                return found
        raise KeyError(quantity)

    def report(self) -> dict[str, Any]:
        """Plain data for strict JSON."""
        return {
            "quantities": {
                q.quantity: {
                    "value": _plain(q.value),
                    "unit": q.unit,
                    "relative_error": _plain(max(q.error, self.floor)),
                    "bound_only": q.bound_only,
                    "observed_order": _plain(q.order),
                    "expected_order": q.expected_order,
                    "change_with_mesh": _plain(q.mesh),
                    "change_with_time_step": _plain(q.time),
                }
                for q in self.quantities
            },
            "cpu_seconds": self.cpu,
            "remarks": list(self.remarks),
        }

    def lines(self) -> list[str]:
        """Text for people: one row a quantity."""
        head = ("estimated error", "value", "error", "order (expected)", "")
        rows = [head, *(self._row(q) for q in self.quantities)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(head) - 1)]
        text = []
        for row in rows:
            middle = (cell.rjust(width) for cell, width in zip(row[1:4], widths[1:], strict=True))
            text.append("  ".join([row[0].ljust(widths[0]), *middle, row[4]]))
        return [line.rstrip() for line in text] + [f"  note: {remark}" for remark in self.remarks]

    def _row(self, q: QuantityEstimate) -> tuple[str, ...]:
        order = "-" if math.isnan(q.order) else f"{q.order:.1f}"
        return (
            q.quantity,
            readable(q.value, "" if q.unit == "N s0.5" else q.unit),
            error_text(q.error, self.floor),
            f"{order} ({q.expected_order:g})",
            "only a bound" if q.bound_only and q.error > self.floor else "",
        )

    def group(self) -> Group:
        """Group ``accuracy``: one entry a quantity."""
        found = self.quantities
        columns = {
            "value": ([q.value for q in found], None, "value of the quantity, in its unit"),
            "relative_error": ([max(q.error, self.floor) for q in found], "1", "estimated relative error"),
            "observed_order": ([q.order for q in found], "1", "observed order of convergence"),
            "expected_order": ([q.expected_order for q in found], "1", "expected order of convergence"),
            "change_with_mesh": ([q.mesh for q in found], "1", "relative change when the mesh alone is coarser"),
            "change_with_time_step": ([q.time for q in found], "1", "relative change when the step alone is longer"),
        }
        dims = ("quantity",)
        names = np.array([q.quantity for q in found], dtype=np.str_)
        units = np.array([q.unit for q in found], dtype=np.str_)
        variables = {
            "quantity": Variable(dims, names, {"long_name": "name of the quantity"}),
            "quantity_unit": Variable(dims, units, {"long_name": "unit of the quantity"}),
        }
        for name, (values, unit, meaning) in columns.items():
            attributes = {"long_name": meaning} | ({} if unit is None else {"units": unit})
            variables[name] = Variable(dims, np.array(values, dtype=float), attributes)
        flags = {"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "estimate bound_only"}
        bounds = np.array([q.bound_only for q in found], dtype=np.int8)
        variables["bound_only"] = Variable(dims, bounds, {"long_name": "whether the estimate is only a bound", **flags})
        attrs = {"remarks": "\n".join(self.remarks), "cpu_seconds": self.cpu}
        return Group(variables, frozenset(["quantity"]), attrs)


def error_text(error: float, floor: float) -> str:
    """A relative error in per cent, two digits.

    >>> error_text(0.0123, 1e-3), error_text(1e-5, 1e-3)
    ('1.2 %', '< 0.1 %')
    """
    if not math.isfinite(error):
        return "unknown"
    return f"< {100 * floor:g} %" if error < floor else f"{100 * error:.2g} %"


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
