"""Energies of the explicit propagator: the identity of ``time_scheme.central_difference``, term by term.

Over one step, exactly, on the full dofs (Dv = v_{n+1} - v_n, Du = dt (v_n + v_{n+1}) / 2):

    D[v.M v / 2] + D[u.K u / 2] - dt^2/8 D[v.K v] + Du.(C v_n + C_d Dv / 2) = Du.(f_n + f_{n+1})/2 + Du.lambda_{n+1}
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from .energy import TERMS
from .forcing import Forcing
from .model import Array, SubstructureModel
from .resumable import Motion


class ExplicitMeter:
    """Accumulates the energy terms of a class; ``totals`` holds them at the present instant, (n_member,) each.

    Parameters
    ----------
    members : with lumped masses. forcing : their loads and motions. dashpots : lumped damping C_d, full dofs, or None.
    """

    def __init__(
        self, members: Sequence[SubstructureModel], forcing: Forcing, dashpots: sp.csr_array | None
    ) -> None:
        self._model, self._forcing, self._dashpots = members[0], forcing, dashpots
        self.dt = 0.0
        self.totals: dict[str, Array] = {}
        p = self._model.expansion
        self._free = np.asarray(p.sum(axis=1)).ravel() > 0
        self._once = p.multiply(1 / np.maximum(p.sum(axis=0), 1)[None, :]).tocsr()

    def _fields(self, state: Motion) -> tuple[Array, Array]:
        p, forcing, i = self._model.expansion, self._forcing, state.instant
        return p @ state.u + forcing.imposed_u(i), p @ state.v + forcing.imposed_v(i)

    def start(self, state: Motion, interface: Array) -> None:  # noqa: ARG002, as the other meters
        """Energies at t = 0."""
        u, v = self._fields(state)
        model = self._model
        self.totals = dict.fromkeys(TERMS, np.zeros(u.shape[1]))
        elastic, kv = model.stiffness @ u, model.stiffness @ v
        self.totals["kinetic"], self.totals["elastic"] = (
            0.5 * _dot(v, model.inertia @ v),
            0.5 * _dot(u, elastic),
        )
        self._last = (u, v, kv, self._forcing.full_external(state.instant))

    def advance(self, state: Motion, interface: Array) -> None:
        """Add the step that ends in ``state``; ``interface`` (n, n_member) reduced nodal forces of its instant, N."""
        model, dt = self._model, self.dt
        u_old, v_old, kv_old, f_old = self._last
        u, v = self._fields(state)
        f, kv, elastic = self._forcing.full_external(state.instant), model.stiffness @ v, model.stiffness @ u
        tractions = self._once @ interface
        step, loads = u - u_old, 0.5 * (f_old + f)
        # K x = K (u + dt/2 v) of the old instant = mean of K u and dt/4 K (v_old - v)
        internal = model.stiffness @ (u_old + 0.5 * dt * v_old)
        totals = dict(self.totals)
        totals["scheme_dissipation"] = totals["scheme_dissipation"] - dt * dt / 8 * (
            _dot(v, kv) - _dot(v_old, kv_old)
        )
        force = model.inertia @ ((v - v_old) / dt) + internal - loads - tractions
        if model.damping is not None:
            damping = model.damping @ v_old
            if self._dashpots is not None:
                damping = damping + self._dashpots @ (0.5 * (v - v_old))
            totals["damping_dissipation"] = totals["damping_dissipation"] + _dot(step, damping)
            force = force + damping
        held = np.where(self._free[:, None], 0.0, force)  # reactions work where the motion is prescribed
        totals["work_of_loads"] = totals["work_of_loads"] + _dot(step, loads) + _dot(step, held)
        totals["interface_work"] = totals["interface_work"] + _dot(step, tractions)
        totals["kinetic"], totals["elastic"] = 0.5 * _dot(v, model.inertia @ v), 0.5 * _dot(u, elastic)
        self.totals = totals
        self._last = (u, v, kv, f)

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
        u, v, kv, f = tree["last"]
        self.totals, self._last = dict(tree["totals"]), (u, v, kv, f)


def _dot(a: Array, b: Array) -> Array:
    """Column-wise scalar product."""
    product: Array = np.einsum("nm,nm->m", a, b)
    return product
