"""What the kernels of an iteration work on, as tuples of arrays and numbers."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import fields
from ..time_scheme import TimeScheme

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Coefficients(NamedTuple):
    """A time scheme for one step dt as the factors of its linear recursions (see ``TimeScheme``)."""

    dt: float
    u_v: float
    u_a: float
    v_a: float
    velocity_gain: float
    displacement_gain: float
    interface_gain: float
    force_weight: float
    memory_weight: float
    w_u_old: float
    w_u: float
    w_v: float
    u_late: float  # weight of the free velocity in the new displacement
    gap_lead: float
    layer_v: float  # what layers see is u + layer_v v + layer_a a of the old instant + the new velocity / layer_rate
    layer_a: float
    layer_rate: float
    rest_traction: float  # see ``latin.resting``


def coefficients(scheme: TimeScheme, dt: float, rest_traction: float) -> Coefficients:
    """Read the factors off the scheme's own functions, which are linear."""
    zero, one = np.zeros(()), np.ones(())
    # explicit: half of the step is made before the forces are known, half after
    late = 0.5 * dt if scheme.explicit else 0.0
    u_v, _ = scheme.predict(zero, one, zero, dt)
    u_a, v_a = scheme.predict(zero, zero, one, dt)
    reached = [
        scheme.interface_velocity(u_old, u, v, dt)
        for u_old, u, v in ((one, zero, zero), (zero, one, zero), (zero, zero, one))
    ]
    layer_v, layer_a = (scheme.layer_jump(zero, *v_a, dt)[0] for v_a in ((one, zero), (zero, one)))
    return Coefficients(
        dt, float(u_v) - late, float(u_a), float(v_a), scheme.velocity_gain(dt), scheme.displacement_gain(dt),
        scheme.interface_gain(dt), scheme.force_weight, scheme.memory_weight,
        float(reached[0]), float(reached[1]), float(reached[2]),
        late, scheme.gap_lead(dt), float(layer_v), float(layer_a), 1 / scheme.layer_jump(zero, zero, zero, dt)[1],
        rest_traction,
    )  # fmt: skip


class Flat(NamedTuple):
    """Constants of the channels, (n_flat,): search direction k, z = 1/k, areas, weights (3, n_flat) of the indicator,
    squared weight of the acceleration, interface number, 1 where normal; motion of the ground channels, (n_time, ...),
    ``ground_layer`` what layers see of it."""

    k: Array
    z: Array
    area: Array
    weights: Array
    acceleration: Array
    interface: Index
    normal: Index
    ground: Index
    ground_velocity: Array
    ground_displacement: Array
    ground_layer: Array


class Limits(NamedTuple):
    """When to stop: tolerances and the rules of ``latin.solver``."""

    tolerance: float
    force_tolerance: float
    at_rest: float
    max_iterations: int
    patience: int
    recent: int
    stall: float
    tangential_floor: float
    relaxation: float
    rank: float
    tangential: int
    rest_traction: float  # see ``latin.resting``
    unchanged: float  # see ``latin.unchanged.negligible``


class History(NamedTuple):
    """Where accepted fields go (rows are instants) and how each window went."""

    f_hat: Array
    w_hat: Array
    errors: Array
    mismatches: Array
    iterations: Index


class Work(NamedTuple):
    """Scratch of one iteration, (n_flat,) unless said; scales (3,) and per-interface indicator are kept up to date."""

    q: Array
    w: Array
    f: Array
    s: Array
    f_hat: Array
    w_hat: Array
    residual: Array
    last_q: Array
    last_residual: Array
    displacement: Array
    layer: Array  # what layers see of the displacements, (0,) where there are none
    known: Array  # (max_iterations,) merits
    dq: Array  # (depth, 1, n_flat)
    dr: Array
    gram: Array  # (depth, depth)
    scales: Array  # field, normal force, tangential force
    norms: Array  # (4,)
    shares: Array  # (n_interface,)
    interface_indicator: Array  # (n_interface,)
    marched: Index  # (2,) substructure-instants marched, and solved through the condensed operator


def make_work(n_flat: int, n_interface: int, depth: int, max_iterations: int, layers: bool) -> Work:
    """Zeroed scratch; ``layers``: whether any behaviour is elastic."""
    return Work(
        np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat),
        np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat), np.zeros(n_flat if layers else 0),
        np.zeros(max_iterations),
        np.zeros((depth, 1, n_flat)), np.zeros((depth, 1, n_flat)), np.zeros((depth, depth)), np.zeros(3),
        np.zeros(4), np.zeros(n_interface), np.zeros(n_interface), np.zeros(2, dtype=np.int64),
    )  # fmt: skip


COEFFICIENTS: Final = fields(Coefficients, ", ".join(["f8"] * 18))
FLAT: Final = fields(
    Flat,
    "f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[::1], i8[::1], i8[::1], i8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1]",
)
LIMITS: Final = fields(Limits, "f8, f8, f8, i8, i8, i8, f8, f8, f8, f8, i8, f8, f8")
HISTORY: Final = fields(History, "f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], i8[::1]")
WORK: Final = fields(
    Work,
    ", ".join(["f8[::1]"] * 12 + ["f8[:, :, ::1]"] * 2 + ["f8[:, ::1]"] + ["f8[::1]"] * 4 + ["i8[::1]"]),
)
"""Types of the tuples in signatures of kernels."""
