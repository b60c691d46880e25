"""Energies of the members of a class and the scheme's own discrete identity.

Over one step, exactly (full dofs, prescribed ones included):

    Delta T + Delta V + damping + scheme = work of loads + work of interface tractions + work of reactions

Each term is computed by itself from the fields; none is the remainder of the others. ``scheme`` is the closed
form given in the time scheme's module. Works use the scheme's weights of forces over the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..time_scheme import TimeScheme
from .forcing import Forcing
from .model import Array, SubstructureModel

TERMS = ("kinetic", "elastic", "work_of_loads", "interface_work", "damping_dissipation", "scheme_dissipation")


class Moving(Protocol):
    """The part of a state that the meter reads."""

    instant: int
    u: Array
    v: Array
    a: Array


class _Forces(NamedTuple):
    """Full-space forces at one instant."""

    elastic: Array
    damping: Array | None
    loads: Array
    interface: Array


class EnergyMeter:
    """Accumulates the energy terms of a class; ``totals`` holds them at the present instant, (n_member,) each."""

    def __init__(self, members: Sequence[SubstructureModel], forcing: Forcing, scheme: TimeScheme) -> None:
        model = members[0]
        self._model, self._forcing, self._scheme = model, forcing, scheme
        self.dt = 0.0  # set by ``begin`` of the propagator
        p = model.expansion
        self._free = np.asarray(p.sum(axis=1)).ravel() > 0
        # forces on tied dofs act once: shared by the full dofs they stand for
        self._once = p.multiply(1 / np.maximum(p.sum(axis=0), 1)[None, :]).tocsr()

    def _expand(self, state: Moving) -> tuple[Array, Array, Array]:
        p, forcing, i = self._model.expansion, self._forcing, state.instant
        return (
            p @ state.u + forcing.imposed_u(i),
            p @ state.v + forcing.imposed_v(i),
            p @ state.a + forcing.imposed_a(i),
        )

    def _forces(self, u: Array, v: Array, instant: int, interface: Array) -> _Forces:
        damping = None if self._model.damping is None else self._model.damping @ v
        full = self._once @ interface
        return _Forces(self._model.stiffness @ u, damping, self._forcing.full_external(instant), full)

    def start(self, state: Moving, interface: Array) -> None:
        """Energies at t = 0; ``interface`` (n, n_member) reduced nodal forces of the interfaces, N."""
        u, v, a = self._expand(state)
        now = self._forces(u, v, state.instant, interface)
        mass_v, mass_a = self._model.inertia @ v, self._model.inertia @ a
        self._last = (u, a, mass_a, now, now)
        zero = np.zeros(u.shape[1])
        totals = dict.fromkeys(TERMS, zero)
        totals["kinetic"], totals["elastic"] = 0.5 * _dot(v, mass_v), 0.5 * _dot(u, now.elastic)
        self.totals = totals

    def advance(self, state: Moving, interface: Array) -> None:
        """Add the step that ends in ``state``."""
        (w_before, w_old, w_new), (a_old_weight, a_new_weight) = self._scheme.energy_weights()
        u_old, a_old, mass_a_old, old, before = self._last
        u, v, a = self._expand(state)
        new = self._forces(u, v, state.instant, interface)
        mass_v, mass_a = self._model.inertia @ v, self._model.inertia @ a
        step = u - u_old

        def weighted(b: Array, o: Array, n: Array) -> Array:
            return w_before * b + w_old * o + w_new * n

        elastic = weighted(before.elastic, old.elastic, new.elastic)
        loads = weighted(before.loads, old.loads, new.loads)
        tractions = weighted(before.interface, old.interface, new.interface)
        a_weighted = a_old_weight * a_old + a_new_weight * a
        force = a_old_weight * mass_a_old + a_new_weight * mass_a + elastic - loads - tractions
        totals = dict(self.totals)
        totals["scheme_dissipation"] = (
            totals["scheme_dissipation"]
            + _dot(step, elastic - 0.5 * (old.elastic + new.elastic))
            + self._scheme.inertia_dissipation(self.dt) * _dot(a_weighted, mass_a - mass_a_old)
        )
        if new.damping is not None and old.damping is not None and before.damping is not None:
            damping = weighted(before.damping, old.damping, new.damping)
            totals["damping_dissipation"] = totals["damping_dissipation"] + _dot(step, damping)
            force = force + damping
        held = np.where(self._free[:, None], 0.0, force)  # reactions work where the motion is prescribed
        totals["work_of_loads"] = totals["work_of_loads"] + _dot(step, loads) + _dot(step, held)
        totals["interface_work"] = totals["interface_work"] + _dot(step, tractions)
        totals["kinetic"], totals["elastic"] = 0.5 * _dot(v, mass_v), 0.5 * _dot(u, new.elastic)
        self.totals = totals
        self._last = (u, a, mass_a, new, old)

    def snapshot(self) -> object:
        """State of the account."""
        return self.totals, self._last

    def tree(self) -> dict[str, object]:
        """State of the account as plain arrays."""
        u, a, mass_a, new, old = self._last
        return {"totals": dict(self.totals), "last": [u, a, mass_a, list(new), list(old)]}

    def resume(self, tree: dict[str, Any]) -> None:
        """Take up an account given by ``tree``."""
        u, a, mass_a, new, old = tree["last"]
        self.totals = dict(tree["totals"])
        self._last = (u, a, mass_a, _Forces(*new), _Forces(*old))

    def restore(self, snapshot: object) -> None:
        """Back to a snapshot."""
        self.totals, self._last = snapshot  # type: ignore[misc]


def _dot(a: Array, b: Array) -> Array:
    """Column-wise scalar product."""
    product: Array = np.einsum("nm,nm->m", a, b)
    return product
