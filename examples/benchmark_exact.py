"""Exact contact stress of P1 by characteristics: two bars, a wall, a gap, a step of pressure.

In each bar s + Z v travels down and s - Z v travels up unchanged (s stress, v velocity along z, Z = rho c). On a grid
where a wave crosses one cell a step, the travelling waves are shifted and nothing is approximated inside the bars.
"""

from __future__ import annotations

import numpy as np
from benchmark_problems import BAR, LENGTH
from example_tools import Array

PRESSURE, GAP = 100e6, 1e-5  # of P1


def contact_stress(time: Array, cells: int = 2000) -> Array:
    """Contact pressure at the instants ``time``, Pa."""
    return bars_exact(time, cells)["contact force"]


def bars_exact(time: Array, cells: int = 2000) -> dict[str, Array]:
    """Contact pressure, Pa, and displacement of the top face, m, at the instants ``time``."""
    impedance = float(np.sqrt(BAR["young_modulus"] * BAR["density"]))
    step = LENGTH / cells * BAR["density"] / impedance
    steps = int(np.ceil(time[-1] / step)) + 1
    # travelling waves as rings: a wave that enters at step i leaves at step i + cells
    up, down = np.zeros((2, cells)), np.zeros((2, cells))
    gap, pressure, top = GAP, np.zeros(steps), np.zeros(steps)
    for i in range(steps):
        k = i % cells
        at_contact, at_wall = up[0, k], down[0, k]
        at_top, from_above = up[1, k], down[1, k]
        opening = (from_above + at_contact) / impedance  # speed without contact
        if gap + step * opening <= 0.0:
            pressure[i] = max(0.0, -0.5 * (from_above + at_contact) - 0.5 * impedance * gap / step)
        p = pressure[i]
        gap += step * (opening + 2.0 * p / impedance)
        top[i] = (-PRESSURE - at_top) / impedance  # s = -PRESSURE there
        up[0, k], down[0, k] = at_wall, -2.0 * p - at_contact  # the wall does not move
        up[1, k], down[1, k] = -2.0 * p - from_above, -2.0 * PRESSURE - at_top
    at = step * np.arange(steps)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * step * (top[1:] + top[:-1]))])
    return {"contact force": np.interp(time, at, pressure), "top displacement": np.interp(time, at, moved)}
