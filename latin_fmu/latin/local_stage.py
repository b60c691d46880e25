"""Local stage (15)-(17): every interface point on its own, instant after instant.

Given s = W - F / k of both sides, the behaviour gives F_hat, and E+ gives W_hat = s + F_hat / k.
The time law of contact is end-of-instant: with G the opening at the start of the instant (recursion of the time
scheme applied to the opening velocity),

    0 <= max(G, 0) / dt + d_{i+1}   perp   P_{i+1} >= 0.

Following G by the scheme's own displacement recursion removes the half-step bias that a first-order gap
(G + dt d) gives the closing instant of an accelerated body; taking max(G, 0) never pushes a penetrated point
out, so that it adds no energy. The penetration left is at most dt/2 times the closing velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .assembly import Assembly
from .layout import Array


@dataclass
class Opening:
    """Opening of the points of each group with its velocity and acceleration; (n_point,) arrays per group."""

    gap: list[Array]
    velocity: list[Array]
    acceleration: list[Array]


def read_gaps(assembly: Assembly) -> list[Array]:
    """Gap (n_point,) of each group in the present state of the substructures (no drift: from displacements)."""
    jumps = _normal_jumps(assembly, assembly.displacement())
    return [group.gap + jump for group, jump in zip(assembly.layout.groups, jumps, strict=True)]


def read_opening(assembly: Assembly) -> Opening:
    """Opening in the present state of the substructures."""
    v, a = assembly.rates()
    return Opening(read_gaps(assembly), _normal_jumps(assembly, v), _normal_jumps(assembly, a))


def _normal_jumps(assembly: Assembly, flat: Array) -> list[Array]:
    blocks = [group.block(flat) for group in assembly.layout.groups]
    return [block[1, :, 0] - block[0, :, 0] for block in blocks]


class LocalStage:
    """Local stage of an assembly for one search direction."""

    def __init__(self, assembly: Assembly, k: Array) -> None:
        self.assembly, self.k = assembly, k
        self.z = np.divide(1.0, k, out=np.zeros_like(k), where=k > 0)
        self._rate = 1 / assembly.dt
        self.z_sums = []
        for group in assembly.layout.groups:
            both = group.block(self.z).sum(axis=0)
            self.z_sums.append(np.ascontiguousarray(both[:, [0, min(1, group.n_component - 1)]]))

    def instant(self, s: Array, gaps: list[Array]) -> tuple[Array, Array]:
        """F_hat and W_hat (n_flat,) at one instant; ``gaps`` per group, (n_point,) at its start."""
        f_hat = np.empty_like(s)
        for group, z, gap in zip(self.assembly.layout.groups, self.z_sums, gaps, strict=True):
            block, out = group.block(s), group.block(f_hat)
            reach = np.maximum(gap, 0.0) * self._rate
            traction = group.behaviour.local(block[1] - block[0], z, reach, self._rate, group.parameters)
            out[0] = traction
            np.negative(traction, out=out[1])
        return f_hat, s + self.z * f_hat

    def window(self, s: Array, opening: Opening) -> tuple[Array, Array, list[Array]]:
        """F_hat, W_hat (n, n_flat) over a window, and per group the opening (n, n_point) at its instants."""
        scheme, dt = self.assembly.scheme, self.assembly.dt
        f_hat, w_hat = np.empty_like(s), np.empty_like(s)
        gap, velocity, acceleration = list(opening.gap), list(opening.velocity), list(opening.acceleration)
        followed = [np.empty((len(s), len(g))) for g in gap]
        for i in range(len(s)):
            f_hat[i], w_hat[i] = self.instant(s[i], gap)
            for g, group in enumerate(self.assembly.layout.groups):
                if not group.behaviour.opens:
                    continue
                block = group.block(w_hat[i])
                new = block[1, :, 0] - block[0, :, 0]
                gap[g], acceleration[g] = scheme.advance_opening(
                    gap[g], velocity[g], acceleration[g], new, dt
                )
                velocity[g] = new
                followed[g][i] = gap[g]
        return f_hat, w_hat, followed
