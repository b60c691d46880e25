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
    """Opening of the points of each group with its velocity and acceleration; (n_point,) arrays per group, or jumps
    (n_point, n_component) for elastic behaviours. For one instant ``gap`` alone is there, as ``left`` gives it."""

    gap: list[Array]
    velocity: list[Array]
    acceleration: list[Array]


def read_gaps(assembly: Assembly) -> list[Array]:
    """Gap (n_point,) of each group in the present state of the substructures (no drift: from displacements)."""
    u = assembly.displacement()
    jumps = [group.block(u) for group in assembly.layout.groups]
    return [g.gap + j[1, :, 0] - j[0, :, 0] for g, j in zip(assembly.layout.groups, jumps, strict=True)]


def read_opening(assembly: Assembly) -> Opening:
    """Opening in the present state of the substructures."""
    v, a = assembly.rates()
    gap = _jumps(assembly, assembly.displacement())
    for group, jump in zip(assembly.layout.groups, gap, strict=True):
        normal = jump[:, 0] if group.behaviour.elastic else jump
        normal += group.gap
    return Opening(gap, _jumps(assembly, v), _jumps(assembly, a))


def _jumps(assembly: Assembly, flat: Array) -> list[Array]:
    """Jumps of each group: along N, or all components for elastic behaviours."""
    pairs = [(group.behaviour.elastic, group.block(flat)) for group in assembly.layout.groups]
    return [block[1] - block[0] if elastic else block[1, :, 0] - block[0, :, 0] for elastic, block in pairs]


def left(assembly: Assembly, gaps: list[Array]) -> list[Array]:
    """What the next instant starts from (``Group.reach``): the gaps, and for elastic behaviours the jumps to come."""
    elastic = [g for g, group in enumerate(assembly.layout.groups) if group.behaviour.elastic]
    if not elastic:
        return gaps
    opening, found = read_opening(assembly), list(gaps)
    for g in elastic:
        moving = opening.gap[g], opening.velocity[g], opening.acceleration[g]
        found[g] = assembly.scheme.layer_jump(*moving, assembly.dt)[0]
    return found


def span(assembly: Assembly) -> float:
    """Displacement that elastic behaviours see per jump of velocity at the new instant, s."""
    nothing = np.zeros(0)
    return assembly.scheme.layer_jump(nothing, nothing, nothing, assembly.dt)[1]


class LocalStage:
    """Local stage of an assembly for one search direction."""

    def __init__(self, assembly: Assembly, k: Array) -> None:
        self.assembly, self.k = assembly, k
        self.z = np.divide(1.0, k, out=np.zeros_like(k), where=k > 0)
        self.span = span(assembly)
        # without inertia there is no energy to add: a penetration the tolerance has left is pushed out
        self._deepest = -np.inf if assembly.quasi_static else 0.0
        self.z_sums = []
        for group in assembly.layout.groups:
            both = group.block(self.z).sum(axis=0)
            self.z_sums.append(np.ascontiguousarray(both[:, [0, min(1, group.n_component - 1)]]))

    def instant(self, s: Array, gaps: list[Array]) -> tuple[Array, Array]:
        """F_hat and W_hat (n_flat,) at one instant; ``gaps`` per group, see ``left``."""
        f_hat = np.empty_like(s)
        for group, z, gap in zip(self.assembly.layout.groups, self.z_sums, gaps, strict=True):
            block, out = group.block(s), group.block(f_hat)
            reach, rate = group.reach(gap, self.assembly.dt, self.span, self._deepest)
            jump = block[1] - block[0]
            traction = group.behaviour.local(jump, z, reach, rate, group.parameters)
            out[0] = traction
            np.negative(traction, out=out[1])
        return f_hat, s + self.z * f_hat

    def window(self, s: Array, opening: Opening) -> tuple[Array, Array, list[Array]]:
        """F_hat, W_hat (n, n_flat) over a window, and per group the opening (n, n_point) at its instants."""
        scheme, dt = self.assembly.scheme, self.assembly.dt
        f_hat, w_hat = np.empty_like(s), np.empty_like(s)
        gap, velocity, acceleration = list(opening.gap), list(opening.velocity), list(opening.acceleration)
        followed = [np.empty((len(s), len(g))) for g in gap]
        groups = self.assembly.layout.groups
        elastic = [g for g, group in enumerate(groups) if group.behaviour.elastic]
        for i in range(len(s)):
            start = list(gap)
            for g in elastic:
                start[g] = scheme.layer_jump(gap[g], velocity[g], acceleration[g], dt)[0]
            f_hat[i], w_hat[i] = self.instant(s[i], start)
            moved = _jumps(self.assembly, w_hat[i])
            for g, group in enumerate(groups):
                if not (group.behaviour.opens or group.behaviour.elastic):
                    continue
                gap[g], acceleration[g] = scheme.advance_opening(
                    gap[g], velocity[g], acceleration[g], moved[g], dt
                )
                velocity[g] = moved[g]
                followed[g][i] = gap[g][:, 0] if group.behaviour.elastic else gap[g]
        return f_hat, w_hat, followed
