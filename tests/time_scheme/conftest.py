"""Every registered time scheme with parameter sets, and a plain march of one oscillator with it.

A new scheme inherits every test of this folder once it has an entry in ``PARAMETERS``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pytest
from numpy.typing import NDArray

from latin_fmu.time_scheme import SCHEMES, TimeScheme

Array = NDArray[np.float64]
Load = Callable[[float], float]

# Unconditionally stable sets only; gamma = 0.6 with beta = (gamma + 1/2)^2 / 4 is the damped Newmark scheme.
PARAMETERS: Mapping[str, tuple[Mapping[str, float], ...]] = MappingProxyType(
    {
        "hht": tuple(MappingProxyType({"alpha": alpha}) for alpha in (0.0, -0.05, -0.1, -1 / 3)),
        "newmark": (
            MappingProxyType({}),
            MappingProxyType({"beta": 0.3025, "gamma": 0.6}),
            MappingProxyType({"beta": 0.5, "gamma": 0.5}),
        ),
        "massless_contact": (MappingProxyType({}),),
        "generalized_alpha": tuple(MappingProxyType({"rho_inf": rho}) for rho in (0.5, 0.8, 1.0)),
        "central_difference": (MappingProxyType({}),),
    }
)
# explicit schemes march between the instants: tests of their own
CASES = [
    (name, parameters)
    for name in SCHEMES
    for parameters in PARAMETERS.get(name, ())
    if not SCHEMES[name](**parameters).explicit
]


def unloaded(_: float) -> float:
    """f = 0."""
    return 0.0


@dataclass(frozen=True)
class Oscillator:
    """m u'' + c u' + k u = f(t)."""

    m: float = 1.0
    c: float = 0.0
    k: float = 0.0
    f: Load = unloaded


@dataclass(frozen=True)
class Moment:
    """State that the next instant needs: time, motion, and the force f - c v - k u left."""

    t: float
    u: float
    v: float
    a: float
    residual: float


def begin(system: Oscillator, u: float, v: float) -> Moment:
    """State at t = 0 with the acceleration of equilibrium."""
    residual = system.f(0.0) - system.c * v - system.k * u
    return Moment(0.0, u, v, residual / system.m, residual)


def advance(scheme: TimeScheme, system: Oscillator, dt: float, old: Moment) -> Moment:
    """One step by the rules of the contract (weights and operator from the scheme)."""
    u, v = scheme.predict(np.array([old.u]), np.array([old.v]), np.array([old.a]), dt)
    force = system.f(old.t + dt) - system.c * v[0] - system.k * u[0]
    mass, damping, stiffness = scheme.operator(dt)
    operator = mass * system.m + damping * system.c + stiffness * system.k
    mass_old, force_old = scheme.old_weights
    memory = scheme.memory_weight * old.residual + mass_old * system.m * old.a - force_old * old.residual
    a = (scheme.force_weight * force - memory) / operator
    u_new, v_new = u[0] + scheme.displacement_gain(dt) * a, v[0] + scheme.velocity_gain(dt) * a
    residual = system.f(old.t + dt) - system.c * v_new - system.k * u_new
    return Moment(old.t + dt, u_new, v_new, a, residual)


def march(scheme: TimeScheme, system: Oscillator, dt: float, n: int, u: float = 0.0, v: float = 0.0) -> list[Moment]:
    """States at n + 1 instants."""
    states = [begin(system, u, v)]
    for _ in range(n):
        states.append(advance(scheme, system, dt, states[-1]))
    return states


@pytest.fixture(params=CASES, ids=lambda case: "-".join([case[0], *(f"{v:.3g}" for v in case[1].values())]))
def scheme(request: pytest.FixtureRequest) -> TimeScheme:
    """Every scheme with every parameter set."""
    name, parameters = request.param
    return SCHEMES[name](**parameters)


@pytest.fixture
def oscillator() -> type[Oscillator]:
    """m, c, k, f(t)."""
    return Oscillator


@pytest.fixture
def marched() -> Callable[..., list[Moment]]:
    """See ``march``."""
    return march


@pytest.fixture
def advanced() -> Callable[..., Moment]:
    """See ``advance``."""
    return advance


@pytest.fixture
def moment() -> type[Moment]:
    """t, u, v, a, residual."""
    return Moment


@pytest.fixture
def covered() -> Mapping[str, bool]:
    """Registry names, and whether this folder has parameters for them."""
    return {name: name in PARAMETERS for name in SCHEMES}
