"""The contract of a time scheme, for every entry of the registry."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from latin_fmu.time_scheme import HHT, SCHEMES, GeneralizedAlpha, Newmark, TimeScheme

March = Callable[..., list[Any]]


def test_every_registered_scheme_is_tested_here(covered: Mapping[str, bool]) -> None:
    assert all(covered.values()), f"give parameters in conftest.py to: {covered}"


def test_registry_makes_what_it_says() -> None:
    assert isinstance(SCHEMES, MappingProxyType)
    for name in SCHEMES:
        assert SCHEMES[name]().name == name
    with pytest.raises(KeyError):
        SCHEMES["leapfrog"]


def manufactured(t: float) -> tuple[float, float, float]:
    """u, v, a of a smooth motion with two frequencies."""
    return (
        math.cos(2 * t) + 0.3 * math.sin(5 * t),
        -2 * math.sin(2 * t) + 1.5 * math.cos(5 * t),
        -4 * math.cos(2 * t) - 7.5 * math.sin(5 * t),
    )


def test_observed_order_is_the_declared_one(scheme: TimeScheme, marched: March, oscillator: Any) -> None:
    """Damped, loaded oscillator with a known motion; error in u and v at t = 1, three halvings of dt."""
    m, c, k = 1.3, 0.4, 30.0

    def load(t: float) -> float:
        u, v, a = manufactured(t)
        return m * a + c * v + k * u

    errors = []
    for n in (160, 320, 640):
        end = marched(scheme, oscillator(m, c, k, load), 1.0 / n, n, *manufactured(0.0)[:2])[-1]
        exact = manufactured(1.0)
        errors.append(math.hypot(end.u - exact[0], (end.v - exact[1]) / math.sqrt(k / m)))
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert orders[-1] == pytest.approx(scheme.declared_order, abs=0.1), f"errors {errors}, orders {orders}"


@pytest.mark.parametrize("dt", [1e-6, 1.0, 1e3])
def test_uniform_and_uniformly_accelerated_motion_are_exact(
    scheme: TimeScheme, marched: March, oscillator: Any, dt: float
) -> None:
    for force in (0.0, 2.5):
        for s in marched(scheme, oscillator(1.25, f=lambda _, p=force: p), dt, 20, 0.7, -0.3):
            assert s.u == pytest.approx(0.7 - 0.3 * s.t + 0.5 * force / 1.25 * s.t**2, rel=1e-12)
            assert s.v == pytest.approx(-0.3 + force / 1.25 * s.t, rel=1e-12)


@pytest.mark.parametrize("w_dt", [1e-2, 0.3, 3.0, 50.0])
def test_average_acceleration_keeps_the_energy_of_an_oscillator(marched: March, oscillator: Any, w_dt: float) -> None:
    for scheme in (Newmark(), HHT(alpha=0.0)):
        k = 9.0
        states = marched(scheme, oscillator(1.0, 0.0, k), w_dt / math.sqrt(k), 500, 0.4, 2.0)
        energy = [0.5 * s.v**2 + 0.5 * k * s.u**2 for s in states]
        np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


@pytest.fixture
def amplification(advanced: Any, oscillator: Any, moment: Any) -> Callable[[TimeScheme, float], np.ndarray]:
    """One step of the free oscillator on (u, v dt, a dt^2), dt = 1, as a function of w dt."""

    def matrix(scheme: TimeScheme, w_dt: float) -> np.ndarray:
        system = oscillator(1.0, 0.0, w_dt**2)
        steps = [
            advanced(scheme, system, 1.0, moment(0.0, *map(float, unit), -system.k * float(unit[0])))
            for unit in np.eye(3)
        ]
        return np.array([(s.u, s.v, s.a) for s in steps]).T

    return matrix


def test_spectral_radius_is_at_most_one(scheme: TimeScheme, amplification: Any) -> None:
    for w_dt in np.geomspace(1e-3, 1e3, 61):
        radius = np.abs(np.linalg.eigvals(amplification(scheme, w_dt))).max()
        assert radius <= 1 + 1e-6, f"w dt = {w_dt}"


@pytest.mark.parametrize("alpha", [-0.05, -0.1, -0.3])
def test_hht_damps_what_no_mesh_carries(amplification: Any, alpha: float) -> None:
    """Spectral radius at infinite frequency (1 + alpha)/(1 - alpha) (Hilber, Hughes, Taylor 1977); 1 at low ones."""
    scheme = HHT(alpha=alpha)
    high = np.abs(np.linalg.eigvals(amplification(scheme, 1e4))).max()
    assert high == pytest.approx((1 + alpha) / (1 - alpha), rel=1e-3)
    low = np.abs(np.linalg.eigvals(amplification(scheme, 1e-2))).max()
    assert 1 - 1e-6 < low <= 1 + 1e-12


@pytest.mark.parametrize("rho", [0.5, 0.8, 1.0])
def test_generalised_alpha_has_its_spectral_radius_at_infinity(amplification: Any, rho: float) -> None:
    """Chung, Hulbert 1993; and the displacement that contact prescribes decays with the same factor: both roots of
    beta x^2 + (1/2 - 2 beta + gamma) x + (1/2 + beta - gamma)."""
    scheme = GeneralizedAlpha(rho_inf=rho)
    high = np.abs(np.linalg.eigvals(amplification(scheme, 1e5))).max()
    assert high == pytest.approx(rho, rel=1e-2)
    be, ga = scheme.beta, scheme.gamma
    np.testing.assert_allclose(np.abs(np.roots([be, 0.5 - 2 * be + ga, 0.5 + be - ga])), rho, rtol=1e-6)


def test_parameters_of_generalised_alpha() -> None:
    """rho = 0.8: a_m = 1/3, a_f = 4/9, gamma = 11/18, beta = 25/81; tractions unweighted."""
    scheme = GeneralizedAlpha()
    assert scheme.old_weights == pytest.approx((1 / 3, 4 / 9))
    assert (scheme.beta, scheme.gamma) == pytest.approx((25 / 81, 11 / 18))
    assert (scheme.traction_weight, scheme.landing_damping) == (1.0, 0.6)


def test_parameters_of_hht() -> None:
    scheme = HHT(alpha=-0.1)
    assert (scheme.beta, scheme.gamma) == pytest.approx((0.3025, 0.6))
    assert HHT().alpha == -0.1
    assert scheme.declared_order == 2
    assert Newmark(gamma=0.6, beta=0.3025).declared_order == 1


def test_superposition(scheme: TimeScheme, marched: March, oscillator: Any) -> None:
    """Linear in loads and initial state together."""
    first = (lambda t: math.sin(3 * t), 0.2, -1.0)
    second = (lambda t: 2.0 if t > 0.5 else 0.0, -0.7, 0.4)

    def run(load: Callable[[float], float], u: float, v: float) -> np.ndarray:
        states = marched(scheme, oscillator(1.0, 0.3, 8.0, load), 0.1, 30, u, v)
        return np.array([(s.u, s.v, s.a) for s in states])

    both = run(
        lambda t: 2 * first[0](t) - 3 * second[0](t),
        *(2 * a - 3 * b for a, b in zip(first[1:], second[1:], strict=True)),
    )
    np.testing.assert_allclose(both, 2 * run(*first) - 3 * run(*second), atol=1e-11)


def test_restart(scheme: TimeScheme, marched: March, advanced: Any, oscillator: Any) -> None:
    """The state (u, v, a, residual) holds all that the next instant needs: no start-up step after a stop."""
    system = oscillator(1.0, 0.3, 8.0, lambda t: math.sin(3 * t))
    whole = marched(scheme, system, 0.1, 20, 1.0, 0.0)
    again = whole[10]
    for _ in range(10):
        again = advanced(scheme, system, 0.1, again)
    assert again == whole[-1]


def test_velocity_determines_the_acceleration(scheme: TimeScheme) -> None:
    """``invert_velocity`` undoes ``predict`` and ``velocity_gain``."""
    u, v, a_old, a_new = np.random.default_rng(2).normal(size=(4, 7))
    dt = 0.013
    _, free = scheme.predict(u, v, a_old, dt)
    v_new = free + scheme.velocity_gain(dt) * a_new
    np.testing.assert_allclose(scheme.invert_velocity(a_old, v_new - v, dt), a_new, rtol=1e-11)


def test_predictor_leaves_its_arguments_alone(scheme: TimeScheme) -> None:
    u, v, a = np.ones((3, 4))
    scheme.predict(u, v, a, 0.1)
    np.testing.assert_array_equal([u, v, a], np.ones((3, 4)))


@pytest.mark.parametrize("w_dt", [0.05, 1.0, 20.0])
def test_energy_identity_closes(scheme: TimeScheme, marched: March, oscillator: Any, w_dt: float) -> None:
    """dT + dV + damping + scheme dissipation = work of the load over every step, with the scheme's own weights."""
    m, c, k, dt = 1.7, 0.6, 8.0, w_dt / math.sqrt(8.0 / 1.7)
    rng = np.random.default_rng(4)
    loads = rng.normal(size=60)
    system = oscillator(m, c, k, lambda t: float(loads[round(t / dt)]))
    states = marched(scheme, system, dt, 50, 0.3, -0.5)
    force_weights, (a_old, a_new) = scheme.energy_weights()
    before = states[0]  # no instant before the first: its own forces are taken
    for old, new in itertools.pairwise(states):

        def weighted(values: tuple[float, float, float]) -> float:
            return sum(w * x for w, x in zip(force_weights, values, strict=True))

        step = new.u - old.u
        stored = 0.5 * m * (new.v**2 - old.v**2) + 0.5 * k * (new.u**2 - old.u**2)
        damping = step * weighted((c * before.v, c * old.v, c * new.v))
        elastic = weighted((k * before.u, k * old.u, k * new.u))
        work = step * weighted(tuple(system.f(s.t) for s in (before, old, new)))
        mean = a_old * old.a + a_new * new.a
        lost = step * (elastic - 0.5 * k * (old.u + new.u))
        lost += scheme.inertia_dissipation(dt) * mean * m * (new.a - old.a)
        lost += scheme.inertia_drift(dt) * 0.5 * (old.v + new.v) * m * (new.a - old.a)
        size = max(abs(stored), abs(damping), abs(work), abs(lost), 0.5 * m * new.v**2, 0.5 * k * new.u**2)
        assert stored + damping + lost - work == pytest.approx(0.0, abs=1e-12 * size)
        before = old
