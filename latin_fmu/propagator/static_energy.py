"""Energies of substructures without inertia.

Over one increment, exactly (full dofs, prescribed ones included; ( )_m the mean of both ends):

    Delta V = Delta u . (loads)_m + Delta u . (interface tractions)_m + Delta u . (reactions)_m

At t = 0 nothing acts but what is in equilibrium with the state there: loads that do not start from zero are counted as
growing over the first increment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .energy import TERMS, Moving
from .forcing import Forcing
from .model import Array, SubstructureModel


class StaticEnergyMeter:
    """Accumulates the energy terms of a class; ``totals`` holds them at the present instant, (n_member,) each."""

    def __init__(self, members: Sequence[SubstructureModel], forcing: Forcing) -> None:
        self._model, self._forcing = members[0], forcing
        self.dt = 0.0  # nothing depends on it
        p = self._model.expansion
        self._free = np.asarray(p.sum(axis=1)).ravel() > 0
        # forces on tied dofs act once: shared by the full dofs they stand for
        self._once = p.multiply(1 / np.maximum(p.sum(axis=0), 1)[None, :]).tocsr()

    def _expand(self, u: Array, instant: int) -> Array:
        full: Array = self._model.expansion @ u + self._forcing.imposed_u(instant)
        return full

    def start(self, state: Moving, interface: Array) -> None:
        """Energies at t = 0; ``interface`` (n, n_member) reduced nodal forces of the interfaces, N."""
        u = state.u
        full, tractions = self._expand(u, 0), self._once @ interface
        elastic = self._model.stiffness @ full
        loads = np.where(self._free[:, None], elastic - tractions, 0.0)
        self._last = [full, elastic, loads, tractions]
        zero = np.zeros(u.shape[1])
        self.totals = dict.fromkeys(TERMS, zero) | {"elastic": 0.5 * _dot(full, elastic)}

    def advance(self, state: Moving, interface: Array) -> None:
        """Add the increment that ends in ``state``."""
        u, instant = state.u, state.instant
        full, tractions = self._expand(u, instant), self._once @ interface
        elastic, loads = self._model.stiffness @ full, self._forcing.full_external(instant)
        old_u, old_elastic, old_loads, old_tractions = self._last
        step = full - old_u
        mean = [
            0.5 * (a + b) for a, b in ((elastic, old_elastic), (loads, old_loads), (tractions, old_tractions))
        ]
        held = np.where(self._free[:, None], 0.0, mean[0] - mean[1] - mean[2])
        totals = dict(self.totals)
        totals["work_of_loads"] = totals["work_of_loads"] + _dot(step, mean[1] + held)
        totals["interface_work"] = totals["interface_work"] + _dot(step, mean[2])
        totals["elastic"] = 0.5 * _dot(full, elastic)
        self.totals = totals
        self._last = [full, elastic, loads, tractions]

    def snapshot(self) -> object:
        """State of the account."""
        return self.totals, self._last

    def restore(self, snapshot: object) -> None:
        """Back to a snapshot."""
        self.totals, self._last = snapshot  # type: ignore[misc]

    def tree(self) -> dict[str, object]:
        """State of the account as plain arrays."""
        return {"totals": dict(self.totals), "last": list(self._last)}

    def resume(self, tree: dict[str, Any]) -> None:
        """Take up an account given by ``tree``."""
        self.totals, self._last = dict(tree["totals"]), list(tree["last"])


def _dot(a: Array, b: Array) -> Array:
    """Column-wise scalar product."""
    product: Array = np.einsum("nm,nm->m", a, b)
    return product
