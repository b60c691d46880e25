"""Central differences: order, stability limit, energy identity and exact gap law of the recursion in its module."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from latin_fmu.time_scheme import CentralDifference

SCHEME = CentralDifference()


def leapfrog(
    m: float, k: float, f: Callable[[float], float], dt: float, n: int, u: float, v: float
) -> list[tuple[float, float]]:
    """(u, v) at the instants, by the scheme's own operators."""
    states = [(u, v)]
    for i in range(n):
        x = u + SCHEME.gap_offset(dt) * v
        a = (0.5 * (f(i * dt) + f((i + 1) * dt)) - k * x) / m
        free_u, free_v = SCHEME.predict(np.array([u]), np.array([v]), np.zeros(1), dt)
        u = float(free_u[0]) + SCHEME.displacement_gain(dt) * a
        v = float(free_v[0]) + SCHEME.velocity_gain(dt) * a
        states.append((u, v))
    return states


def test_order_two() -> None:
    """Loaded oscillator with the motion cos 2t + 0.3 sin 5t; error in u and v at t = 1."""
    m, k = 1.3, 30.0

    def motion(t: float) -> tuple[float, float, float]:
        return (
            math.cos(2 * t) + 0.3 * math.sin(5 * t),
            -2 * math.sin(2 * t) + 1.5 * math.cos(5 * t),
            -4 * math.cos(2 * t) - 7.5 * math.sin(5 * t),
        )

    errors = []
    for n in (80, 160, 320):
        u, v = leapfrog(m, k, lambda t: m * motion(t)[2] + k * motion(t)[0], 1 / n, n, *motion(0.0)[:2])[-1]
        errors.append(math.hypot(u - motion(1.0)[0], (v - motion(1.0)[1]) / math.sqrt(k / m)))
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert orders[-1] == pytest.approx(SCHEME.declared_order, abs=0.1), f"{errors}"


@pytest.mark.parametrize(("w_dt", "stable"), [(0.1, True), (1.0, True), (1.98, True), (2.02, False)])
def test_stable_up_to_two_over_omega(w_dt: float, stable: bool) -> None:
    columns = [leapfrog(1.0, w_dt**2, lambda _: 0.0, 1.0, 1, *unit)[-1] for unit in ((1.0, 0.0), (0.0, 1.0))]
    radius = np.abs(np.linalg.eigvals(np.array(columns).T)).max()
    assert (radius <= 1 + 1e-9) == stable


@pytest.mark.parametrize("w_dt", [0.05, 1.0, 1.9])
def test_energy_identity_closes(w_dt: float) -> None:
    """T + V - dt^2/8 k v^2 changes by the work of the mean load over every step."""
    m, k = 1.7, 8.0
    dt = w_dt / math.sqrt(k / m)
    loads = np.random.default_rng(4).normal(size=60)
    states = leapfrog(m, k, lambda t: float(loads[round(t / dt)]), dt, 50, 0.3, -0.5)

    def stored(u: float, v: float) -> float:
        return 0.5 * m * v * v + 0.5 * k * u * u - dt * dt / 8 * k * v * v

    for i, (old, new) in enumerate(itertools.pairwise(states)):
        work = (new[0] - old[0]) * 0.5 * (loads[i] + loads[i + 1])
        size = max(stored(*old), stored(*new), 0.5 * k * old[0] ** 2)
        assert stored(*new) - stored(*old) == pytest.approx(work, abs=1e-12 * size)


def test_the_gap_law_is_exact_between_the_instants() -> None:
    """x_{n+3/2} - x_{n+1/2} = dt v_{n+1}, x the displacement that gaps are read from."""
    dt = 0.03
    states = leapfrog(1.0, 5.0, math.sin, dt, 20, 0.2, -1.0)
    x = [u + SCHEME.gap_offset(dt) * v for u, v in states]
    opened, _ = SCHEME.advance_opening(np.array(x[:-1]), np.zeros(20), np.zeros(20), np.array(states)[1:, 1], dt)
    np.testing.assert_allclose(opened, x[1:], rtol=1e-13)


def test_prescribed_velocities_move_by_the_trapezoid_rule() -> None:
    v = np.array([0.3, -0.2])
    a = SCHEME.invert_velocity(np.zeros(1), v[1:] - v[:1], 0.1)
    free, _ = SCHEME.predict(np.zeros(1), v[:1], np.zeros(1), 0.1)
    assert float((free + SCHEME.displacement_gain(0.1) * a)[0]) == pytest.approx(0.1 * v.mean(), rel=1e-13)
