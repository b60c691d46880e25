"""Partial slip of an elastic bar gripped between two rough planes: closed forms of the one-dimensional shear lag.

A bar of section A = b h and modulus E is held by a pressure p between two planes with friction mu (traction 2 mu p b
per length where it slips) and pulled at one end by F. Slip runs in from that end over s = F / q, q = 2 mu p b:

    first pull     u_end = F^2 / (2 E A q)
    then           every change of F counts half as much: u_end = u_0 -+ (F - F_0)^2 / (4 E A q)      (Masing)
    full cycle     work lost 2 F^3 / (3 E A q)

Poisson's ratio is 0 and one element spans the height, so that the mesh holds the one-dimensional state exactly.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import latin_fmu
from tests.scenes import ramp, solve, solved

from .static_scenes import add_block, scene

E, FRICTION, GRIP = 200e9, 0.25, 50e6
LENGTH, WIDTH, HEIGHT, N = 0.5, 0.02, 0.02, 50
LOST = 2 * FRICTION * GRIP * WIDTH  # friction force per length, both planes
PULL = 0.6 * LENGTH * LOST
STIFFNESS = E * WIDTH * HEIGHT


def gripped(*turns: tuple[float, float], steps: int) -> dict[str, Any]:
    """The bar under a pull that follows (time, fraction of PULL)."""
    made = scene(steps, end=turns[-1][0], tolerance=1e-4)
    made["material"]["steel"] |= {"young_modulus": E, "poisson_ratio": 0.0}
    add_block(made, "bar", (0.0, 0.0, 0.0), (LENGTH, WIDTH, HEIGHT), (N, 1, 1))
    for side in ("zmin", "zmax"):
        made["interface"][side] = {
            "sides": [f"bar.{side}", "ground"],
            "friction_coefficient": FRICTION,
            "preload": GRIP,
        }
    made["load"]["pull"] = {"face": "bar.xmax", "traction": [PULL / (WIDTH * HEIGHT), 0.0, 0.0], "law": ramp(*turns)}
    return made


@cache
def cycled() -> latin_fmu.Solution:
    """Pulled, pushed and pulled again."""
    return solve(gripped((0, 0), (1, 1), (3, -1), (5, 1), steps=50))


def end(solution: latin_fmu.Solution) -> np.ndarray:
    """Displacement of the pulled end."""
    bar = solution.substructures["bar"]
    return bar.displacement[:, bar.nodes[:, 0] > 0.999 * LENGTH, 0].mean(axis=1)


def test_first_pull():
    """u_end = F^2 / (2 E A q) along the whole pull; the slip front stands at L - F / q."""
    solution = cycled()
    time, u = solution.time[:11], end(solution)[:11]
    exact = (time * PULL) ** 2 / (2 * STIFFNESS * LOST)
    assert u == pytest.approx(exact, abs=3e-3 * exact[-1])
    history = solution.interfaces["zmin"]
    slips = history.points[:, 0][history.contact_status[10] == 2]
    assert slips.min() == pytest.approx(LENGTH - PULL / LOST, abs=1.5 * LENGTH / N)
    assert len(slips) == 2 * round((LENGTH - slips.min()) / (LENGTH / N) + 1)  # without islands of stick


def test_pressure_and_friction_stay_on_the_cone():
    """The planes keep the pressure (nu = 0); traction in slip is mu p."""
    solution = cycled()
    for history in solution.interfaces.values():
        pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
        assert pressure == pytest.approx(np.full_like(pressure, GRIP), rel=1e-3)
        shear = np.hypot(history.traction[..., 0], history.traction[..., 1])
        assert shear[history.contact_status == 2] == pytest.approx(FRICTION * GRIP, rel=1e-3)
        assert shear.max() <= FRICTION * GRIP * (1 + 1e-3)


def test_unloading_follows_masing():
    """Both reversals: a quarter instead of a half of the square of the change."""
    solution = cycled()
    u, time = end(solution), solution.time
    force = PULL * np.interp(time, [0, 1, 3, 5], [0, 1, -1, 1])
    top = PULL**2 / (2 * STIFFNESS * LOST)
    down, up = (time >= 1) & (time <= 3), time >= 3
    assert u[down] == pytest.approx(top - (PULL - force[down]) ** 2 / (4 * STIFFNESS * LOST), abs=5e-3 * top)
    assert u[up] == pytest.approx(-top + (PULL + force[up]) ** 2 / (4 * STIFFNESS * LOST), abs=5e-3 * top)


def test_work_lost_in_a_cycle():
    """2 F^3 / (3 E A q), by the friction of the interfaces and by the work of the load alike."""
    energy, time = cycled().energy, cycled().time
    first, last = np.searchsorted(time, 1.0), len(time) - 1
    exact = 2 * PULL**3 / (3 * STIFFNESS * LOST)
    friction = energy["friction_dissipation"]
    assert friction[last] - friction[first] == pytest.approx(exact, rel=0.02)
    work = energy["work_of_loads"]
    assert work[last] - work[first] == pytest.approx(exact, rel=0.02)
    assert (np.diff(friction) >= -1e-12 * friction[-1]).all()


def test_energy_balance():
    """Substructure identity to round-off; what the interfaces take is friction, but for the finite increments."""
    energy = cycled().energy
    assert np.abs(energy["balance"]).max() < 1e-12 * energy["elastic"].max()
    assert not energy["kinetic"].any()
    assert not energy["scheme_dissipation"].any()
    taken = -energy["interface_work"] - energy["friction_dissipation"] - energy["contact_dissipation"]
    assert np.abs(taken).max() < 0.02 * energy["friction_dissipation"][-1]


def test_shipped_model():
    """models/gripped_bar: the numbers of its README."""
    solution = solved("gripped_bar/scene")
    top = PULL**2 / (2 * STIFFNESS * LOST)
    assert end(solution)[[10, 30, 50]] == pytest.approx([top, -top, top], rel=1e-3)
    friction = solution.energy["friction_dissipation"]
    assert friction[50] - friction[10] == pytest.approx(2 * PULL**3 / (3 * STIFFNESS * LOST), rel=2e-3)
    history = solution.interfaces["below"]
    stuck = (history.contact_status[1:] == 1).all(axis=0)
    assert history.points[stuck, 0].max() == pytest.approx(LENGTH - PULL / LOST, abs=1e-9)


def test_refining_the_increments_changes_little():
    """Monotone loading: the result does not depend on the number of increments, nor on the unit of time."""
    ends = [end(solve(gripped((0, 0), (t, 1), steps=n)))[-1] for n, t in ((1, 1.0), (4, 1e-6), (10, 1e6))]
    for one, other in pairwise(ends):
        assert one == pytest.approx(other, rel=2e-3)
