"""Resultants of an interface over some instants: what the outputs of a co-simulation are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..interface.behaviour import SEPARATION, SLIP, STICK
from ..latin.record import Array, InterfaceHistory


@dataclass(frozen=True)
class InterfaceSeries:
    """Resultants of one interface at n instants.

    Attributes
    ----------
    force : (n, 3) on side E, N. velocity : (n, 2, 3) means of both sides weighted by area, m s-1.
    normal_force : (n,) positive in compression, N. gap, smallest_gap : (n,), m, None where it cannot open.
    shares : (n, 3) closed, sticking, slipping shares of the area; None where it cannot open.
    """

    force: Array
    velocity: Array
    normal_force: Array
    gap: Array | None
    smallest_gap: Array | None
    shares: Array | None

    @classmethod
    def of(cls, history: InterfaceHistory) -> InterfaceSeries:
        """Resultants of a history."""
        share = history.areas / history.areas.sum()
        gap = smallest = shares = None
        if history.gap is not None:
            gap, smallest = history.gap @ share, history.gap.min(axis=1)
        if history.contact_status is not None:
            status = history.contact_status
            states = (status != SEPARATION, status == STICK, status == SLIP)
            shares = np.stack([state @ share for state in states], axis=1)
        return cls(
            history.force(),
            np.einsum("p,tspc->tsc", share, history.velocity),
            history.normal_resultant() + 0.0,  # no negative zero
            gap,
            smallest,
            shares,
        )

    def last(self) -> InterfaceSeries:
        """The last instant only."""
        cut = (None if v is None else v[-1:] for v in (self.gap, self.smallest_gap, self.shares))
        return InterfaceSeries(self.force[-1:], self.velocity[-1:], self.normal_force[-1:], *cut)

    def columns(self, impulse: Array) -> Array:
        """(n, n_output): the scalar outputs of the interface in the order of the variable table.

        impulse : (n, 3), N s.
        """
        relative = self.velocity[:, 1] - self.velocity[:, 0]
        parts = [self.force, impulse, self.velocity[:, 0], self.velocity[:, 1], relative, self.normal_force[:, None]]
        if self.gap is not None and self.smallest_gap is not None and self.shares is not None:
            parts += [self.gap[:, None], self.smallest_gap[:, None], self.shares]
        return np.concatenate(parts, axis=1)


def impulse_steps(force: Array, dt: float) -> Array:
    """Running trapezoid (n, 3) of a force (n, 3) at instants dt apart, 0 at the first."""
    steps = 0.5 * dt * (force[1:] + force[:-1])
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
