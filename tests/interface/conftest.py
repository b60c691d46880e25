"""Every registered behaviour with parameter sets, its relation, and random interface points to try it on.

A new behaviour inherits every test of this folder once it has an entry in ``PARAMETERS`` and ``RELATIONS``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType

import numpy as np
import pytest
from numpy.typing import NDArray

from latin_fmu.interface import BEHAVIOURS, Behaviour

Array = NDArray[np.float64]
Residual = Callable[[Behaviour, Array, Array, Array], float]  # behaviour, W' - W, F_hat on E, normalised gap

N_POINT = 400
RATE = 0.8  # of the behaviours that see the jump of displacement
SEED = 45


def perfect_residual(_: Behaviour, slip: Array, *__: Array) -> float:
    """Eq. (7): no relative velocity."""
    return float(np.abs(slip).max())


def contact_residual(behaviour: Behaviour, slip: Array, traction: Array, normalised_gap: Array) -> float:
    """Signorini 0 <= g + d perp P >= 0 and Coulomb's law, each in the unit of its argument (all of order 1)."""
    pressure, room = -traction[:, 0], normalised_gap + slip[:, 0]
    worst = max(0.0, float(-pressure.min()), float(-room.min()), float(np.abs(pressure * room).max()))
    if behaviour.n_component == 1:
        return worst
    limit = behaviour.friction_coefficient * pressure
    shear, slide = traction[:, 1:], slip[:, 1:]
    size, speed = np.linalg.norm(shear, axis=1), np.linalg.norm(slide, axis=1)
    outside = (size - limit).max()
    stuck = (speed * np.clip(limit - size, 0.0, 1.0)).max()  # inside the cone: no relative velocity
    # Friction on E is along the relative velocity of E': |F| |d| = F . d
    aligned = np.abs(size * speed - np.einsum("pi,pi->p", shear, slide)).max()
    return max(worst, float(outside), float(stuck), float(aligned))


def no_slip_residual(behaviour: Behaviour, slip: Array, traction: Array, normalised_gap: Array) -> float:
    """Signorini; no sliding where touching at the start of the instant, no shear elsewhere."""
    pressure, room = -traction[:, 0], normalised_gap + slip[:, 0]
    worst = max(0.0, float(-pressure.min()), float(-room.min()), float(np.abs(pressure * room).max()))
    wrong = np.where((normalised_gap <= RATE * behaviour.touch)[:, None], slip[:, 1:], traction[:, 1:])
    return max(worst, float(np.abs(wrong).max()))


def layer_residual(behaviour: Behaviour, slip: Array, traction: Array, normalised_gap: Array) -> float:
    """F = k [u] with [u] = (g + d) / rate."""
    stiffness = np.array([behaviour.normal_stiffness, *[behaviour.tangential_stiffness] * 2])[: slip.shape[1]]
    return float(np.abs(traction - stiffness * (normalised_gap + slip) / RATE).max() / max(1.0, stiffness.max()))


def soft_residual(behaviour: Behaviour, slip: Array, traction: Array, normalised_gap: Array) -> float:
    """P = k max(0, -[u].N); friction as for contact."""
    gap = (normalised_gap[:, 0] + slip[:, 0]) / RATE
    pressure = behaviour.normal_stiffness * np.maximum(0.0, -gap)
    normal = float(np.abs(-traction[:, 0] - pressure).max()) / max(1.0, behaviour.normal_stiffness)
    closed = pressure > 0  # friction: the points in touch, seen as contact with no room left
    room = np.where(closed, -slip[:, 0], 1.0 - slip[:, 0])
    seen = traction * np.where(closed, 1.0, 0.0)[:, None]
    return max(normal, contact_residual(behaviour, slip, seen, np.maximum(room, -slip[:, 0])))


def joint_residual(behaviour: Behaviour, slip: Array, traction: Array, _: Array) -> float:
    """F = c d."""
    viscosity = np.array([behaviour.normal_viscosity, *[behaviour.tangential_viscosity] * 2])[: slip.shape[1]]
    return float(np.abs(traction - viscosity * slip).max() / max(1.0, viscosity.max()))


def maxwell_residual(behaviour: Behaviour, slip: Array, traction: Array, normalised_gap: Array) -> float:
    """F = c_u k [u] with [u] = (g + d) / rate."""
    return layer_residual(behaviour, slip, traction / behaviour.share, normalised_gap)


def _sets(*values: dict[str, float]) -> tuple[Mapping[str, float], ...]:
    return tuple(MappingProxyType(v) for v in values)


PARAMETERS: Mapping[str, tuple[Mapping[str, float], ...]] = MappingProxyType(
    {
        "perfect": (MappingProxyType({}),),
        "no_slip": _sets({}, {"touch": 0.2}),
        "elastic_layer": _sets(
            {"normal_stiffness": 2.0, "tangential_stiffness": 0.7},
            {"normal_stiffness": 1e6, "tangential_stiffness": 1e-6},
            {"normal_stiffness": 3.0, "tangential_stiffness": 0.0},
            {"normal_stiffness": 0.0, "tangential_stiffness": 5.0},
        ),
        "soft_contact": _sets(
            {"normal_stiffness": 2.0, "friction_coefficient": 0.0},
            {"normal_stiffness": 0.5, "friction_coefficient": 0.3},
            {"normal_stiffness": 1e6, "friction_coefficient": 10.0},
        ),
        "maxwell_joint": _sets(
            {"normal_stiffness": 2.0, "tangential_stiffness": 0.7, "relaxation_time": 0.3, "share": 0.9},
            {"normal_stiffness": 1e6, "tangential_stiffness": 1e-6, "relaxation_time": 1e-3, "share": 0.5},
            {"normal_stiffness": 3.0, "tangential_stiffness": 0.0, "relaxation_time": 2.0, "share": 1.0},
        ),
        "viscous_joint": _sets(
            {"normal_viscosity": 2.0, "tangential_viscosity": 0.7},
            {"normal_viscosity": 1e6, "tangential_viscosity": 1e-6},
            {"normal_viscosity": 1.0, "tangential_viscosity": 0.0},
        ),
        "contact": tuple(MappingProxyType({"friction_coefficient": mu}) for mu in (0.0, 1e-6, 0.2, 1.0, 10.0, 1e6)),
    }
)
RELATIONS: Mapping[str, Residual] = MappingProxyType(
    {
        "perfect": perfect_residual,
        "contact": contact_residual,
        "no_slip": no_slip_residual,
        "elastic_layer": layer_residual,
        "soft_contact": soft_residual,
        "viscous_joint": joint_residual,
        "maxwell_joint": maxwell_residual,
    }
)
CASES = [(name, parameters) for name in BEHAVIOURS for parameters in PARAMETERS.get(name, ())]


@dataclass(frozen=True)
class Points:
    """Linear-stage fields of both sides at random points, of order 1.

    w, f, k : (2, n_point, n_component) velocity, traction and search direction of E and E'.
    normalised_gap : (n_point,), or (n_point, n_component) for elastic behaviours.
    """

    w: Array
    f: Array
    k: Array
    normalised_gap: Array

    @property
    def free(self) -> Array:
        """s = W - F / k, (2, n_point, n_component)."""
        return self.w - np.divide(self.f, self.k, out=np.zeros_like(self.f), where=np.isfinite(self.k))

    @property
    def z(self) -> Array:
        """(n_point, 2) sum of 1 / k, normal and tangential."""
        both = (1 / self.k).sum(axis=0)
        return np.ascontiguousarray(both[:, [0, min(1, both.shape[1] - 1)]])

    @property
    def jump(self) -> Array:
        """s' - s."""
        return self.free[1] - self.free[0]


def random_points(behaviour: Behaviour | int, seed: int = SEED, ground: bool = False) -> Points:
    """Random fields for a behaviour (or for contact with so many components); one tangential k per point; half of the
    points closed; ``ground``: rigid side E'."""
    n_component = behaviour if isinstance(behaviour, int) else behaviour.n_component
    rng = np.random.default_rng(seed)
    shape = (2, N_POINT, n_component)
    k = np.exp(rng.uniform(-2.0, 2.0, shape))
    k[..., 1:] = k[..., 1:2]
    if ground:
        k[1] = np.inf
    normalised_gap = np.where(rng.random(N_POINT) < 0.5, 0.0, rng.exponential(1.0, N_POINT))
    if not isinstance(behaviour, int) and behaviour.elastic:
        normalised_gap = rng.normal(size=shape[1:])
    return Points(rng.normal(size=shape), rng.normal(size=shape), k, normalised_gap)


@pytest.fixture(params=CASES, ids=lambda case: "-".join([case[0], *(f"{v:g}" for v in case[1].values())]))
def behaviour(request: pytest.FixtureRequest) -> Behaviour:
    """Every behaviour with every parameter set."""
    name, parameters = request.param
    return BEHAVIOURS[name](**parameters)


@pytest.fixture
def residual(behaviour: Behaviour) -> Residual:
    """Residual of the behaviour's own relation."""
    return RELATIONS[behaviour.name]


@pytest.fixture
def solve(behaviour: Behaviour) -> Callable[[Points], Array]:
    """F_hat on side E, (n_point, n_component)."""

    def local(points: Points) -> Array:
        parameters = behaviour.point_parameters(len(points.normalised_gap))
        return behaviour.local(points.jump, points.z, points.normalised_gap, RATE, parameters)

    return local


# Powers of c in a parameter where (F, k), and where (W, F, g), are multiplied by c; stiffness, viscosity: 1, 0.
POWERS: Mapping[str, tuple[int, int]] = MappingProxyType(
    {"touch": (0, 1), "friction_coefficient": (0, 0), "relaxation_time": (0, 0), "share": (0, 0)}
)


@pytest.fixture
def scaled(behaviour: Behaviour) -> Callable[..., Callable[[Points], Array]]:
    """F_hat with stiffness and viscosity, or with lengths, multiplied by a number."""

    def times(c: float, lengths: bool = False) -> Callable[[Points], Array]:
        powers = {f.name: POWERS.get(f.name, (1, 0))[lengths] for f in fields(behaviour)}
        other = replace(behaviour, **{name: c**power * getattr(behaviour, name) for name, power in powers.items()})

        def local(points: Points) -> Array:
            parameters = other.point_parameters(len(points.normalised_gap))
            return other.local(points.jump, points.z, points.normalised_gap, RATE, parameters)

        return local

    return times


@pytest.fixture
def points() -> Callable[..., Points]:
    """Random points, see ``random_points``."""
    return random_points


@pytest.fixture
def covered() -> Mapping[str, bool]:
    """Registry names, and whether this folder has parameters and a relation for them."""
    return {name: name in PARAMETERS and name in RELATIONS for name in BEHAVIOURS}
