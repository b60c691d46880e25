"""The contract of a time scheme, its numbers for the kernels, and the explicit scheme, central differences.

Rules

1. The operator ``A = mass * M + damping * C + stiffness * K`` depends on dt only.
2. One instant is ``A a = b + gain_force * lambda``: linear in loads, interface forces and initial state.
3. ``declared_order`` is the order observed on a smooth problem.
4. One window equals two half windows: the state holds all that the next instant needs.
5. The energy identity of rule-2 motion is closed by ``dissipation``, a quadratic form of the state alone.

Central differences keep displacements between the instants.

With x halfway between two instants and v at the instants (leapfrog),

    x_{n+1/2} = u_n + dt/2 v_n
    M (v_{n+1} - v_n) / dt = (f_n + f_{n+1})/2 - K x_{n+1/2} - C v + lambda_{n+1}
    u_{n+1} = x_{n+1/2} + dt/2 v_{n+1}

Gaps follow from x: x_{n+3/2} = x_{n+1/2} + dt v_{n+1}, so that the law gap + dt d >= 0 is the exact displacement
condition and nothing penetrates. Second order; stable while dt <= 2 / omega_max (``propagator.stable_step``).

Energy over one step, exactly (Du = u_{n+1} - u_n, D the change over the step; undamped):

    D[v.M v / 2 + u.K u / 2 - dt^2/8 v.K v] = Du.(f_n + f_{n+1})/2 + Du.lambda_{n+1}

so that the dissipation of the scheme is - dt^2/8 D[v.K v], which sums to zero over a motion that starts and ends at
rest.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class TimeScheme(Protocol):
    """A one-step scheme in the acceleration a of the new instant (rules in the module docstring).

    Attributes
    ----------
    name : key in the registry of schemes.
    explicit : whether the march is explicit: a diagonal operator, a stable step, displacements between the instants.
    massless_contact : whether the nodes of contact interfaces carry no mass.
    landing_damping : viscosity of the layer of elements at faces that land, in units of (h / c_p) K_e of each element.
    old_weights : weights of M a, and of f - C v - K u, of the old instant where the scheme takes each by its own.
    one_step_energy : whether the energy identity is that of the equation of motion of the new instant alone.
    """

    name: str
    explicit: bool = False
    massless_contact: bool = False
    landing_damping: float = 0.0
    old_weights: tuple[float, float] = (0.0, 0.0)
    one_step_energy: bool = False

    @property
    def declared_order(self) -> int:
        """Order of accuracy in dt."""

    def consistent_share(self, courant: float) -> float:
        """Share of the consistent mass in the mass, the rest is lumped; ``courant`` : the smallest of a body."""
        return 1.0

    @property
    def force_weight(self) -> float:
        """Weight of the forces of the new instant in its equation of motion."""
        return 1.0

    @property
    def memory_weight(self) -> float:
        """Weight of the residual force of the old instant (0 for Newmark)."""
        return 0.0

    @property
    def traction_weight(self) -> float:
        """Weight of the interface tractions of the new instant in its equation of motion."""
        return self.force_weight

    def operator(self, dt: float) -> tuple[float, float, float]:
        """Factors (mass, damping, stiffness) of M, C, K in A; units 1, s, s2."""

    def velocity_gain(self, dt: float) -> float:
        """Derivative dv/da at the new instant, s."""

    def displacement_gain(self, dt: float) -> float:
        """Derivative du/da at the new instant, s2."""

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:
        """Displacement and velocity of the new instant if its acceleration were zero."""

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:
        """Acceleration of the new instant from the velocity increment ``jump``."""

    def free_acceleration(self, a_old: Array, old: Array, new: Array) -> Array:
        """Acceleration of the new instant of a free body, from that of the old one and the forces per mass at both
        instants: the equation of motion of the scheme without C and K."""
        if self.explicit:
            # as in the equation of motion of the step
            mean: Array = 0.5 * (old + new)
            return mean
        a_m, a_f = self.old_weights
        # one of a_f and ``memory_weight`` is zero in every scheme
        weighted: Array = self.force_weight * new + (a_f - self.memory_weight) * old - a_m * a_old
        return weighted / (1.0 - a_m)

    def interface_gain(self, dt: float) -> float:
        """Derivative dW/da of the velocity W of the interfaces, s."""
        return self.velocity_gain(dt)

    def interface_velocity(self, u_old: Array, u: Array, v: Array, dt: float) -> Array:
        """Velocity W of the interfaces from the displacement of the old instant and the state u, v of the new one."""
        return v

    def gap_offset(self, dt: float) -> float:
        """Time from an instant to the displacements that give its gaps, s."""
        return 0.0

    def advance_opening(self, gap: Array, v: Array, a: Array, new: Array, dt: float) -> tuple[Array, Array]:
        """Opening and its acceleration at the new instant from those of the old one and the ``new`` opening velocity;
        gap + dt * new unless a scheme overrides it."""
        return gap + dt * new, a

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:
        """Displacement that the elastic forces of an interface follow in the step, from the opening of the old instant
        (as ``advance_opening``): ``(rest, span)``, displacement = rest + span * new opening velocity; m and s."""

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Weights of forces at (n-1, n, n+1) and of accelerations at (n, n+1) in the work over one step."""

    def traction_weights(self) -> tuple[float, float, float]:
        """Weights of the interface tractions at (n-1, n, n+1) in the work over one step."""
        return self.energy_weights()[0]

    def inertia_dissipation(self, dt: float) -> float:
        """Factor of a_w . M (a_new - a_old) in the energy identity, s2 (a_w the weighted acceleration)."""
        return 0.0

    def inertia_drift(self, dt: float) -> float:
        """Factor of (v_old + v_new)/2 . M (a_new - a_old) in the energy identity, s."""
        return 0.0


def coefficients(scheme: Any, dt: float) -> dict[str, float]:
    """Numbers of ``kernels.records.RUN_NUMBERS`` that belong to a time scheme and a step: the factors of its linear
    recursions, which are the values of its own functions for unit arguments."""
    # unit vectors for arguments: entry i of a result is its factor of argument i
    nothing, (first, second, third) = np.zeros(3), np.eye(3)
    # half of an explicit step is made before the forces are known, half after
    if scheme.explicit:
        late = 0.5 * dt
    else:
        late = 0.0
    u, v = scheme.predict(nothing, first, second, dt)
    w = scheme.interface_velocity(first, second, third, dt)
    layer, span = scheme.layer_jump(nothing, first, second, dt)
    opening, rate = scheme.advance_opening(nothing, first, second, third, dt)
    forces, accelerations = scheme.energy_weights()
    tractions = scheme.traction_weights()
    mass_old, force_old = scheme.old_weights
    numbers = {
        "dt": dt,
        # of the first half of an explicit step: the second one follows as ``u_late``
        "u_v": u[0] - late,
        "u_a": u[1],
        "v_a": v[1],
        "velocity_gain": scheme.velocity_gain(dt),
        "displacement_gain": scheme.displacement_gain(dt),
        "interface_gain": scheme.interface_gain(dt),
        "force_weight": scheme.force_weight,
        "memory_weight": scheme.memory_weight,
        "mass_weight": scheme.operator(dt)[0],
        "mass_old": mass_old,
        "force_old": force_old,
        "traction_weight": scheme.traction_weight,
        "w_u_old": w[0],
        "w_u": w[1],
        "w_v": w[2],
        "u_late": late,
        "gap_offset": scheme.gap_offset(dt),
        "layer_v": layer[0],
        "layer_a": layer[1],
        "layer_rate": 1 / span,  # displacement laws take the jump of displacement times this
        "opening_v": opening[0],
        "opening_a": opening[1],
        "opening_new": opening[2],
        "rate_v": rate[0],
        "rate_a": rate[1],
        "rate_new": rate[2],
        "energy_before": forces[0],
        "energy_old": forces[1],
        "energy_new": forces[2],
        "traction_before": tractions[0],
        "traction_old": tractions[1],
        "traction_new": tractions[2],
        "energy_a_old": accelerations[0],
        "energy_a_new": accelerations[1],
        "inertia_dissipation": scheme.inertia_dissipation(dt),
        "inertia_drift": scheme.inertia_drift(dt),
        "one_step": float(scheme.one_step_energy),
    }
    return {name: float(value) for name, value in numbers.items()}


class CentralDifference(TimeScheme):
    """Central differences with a lumped mass (module docstring); marched by the explicit propagator only."""

    name = "central_difference"
    declared_order = 2
    explicit = True

    def operator(self, dt: float) -> tuple[float, float, float]:
        """A = M + dt/2 C."""
        return 1.0, 0.5 * dt, 0.0

    def velocity_gain(self, dt: float) -> float:
        """Derivative dv/da = dt."""
        return dt

    def displacement_gain(self, dt: float) -> float:
        """Derivative du/da = dt^2 / 2."""
        return 0.5 * dt * dt

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:
        """Displacement u + dt v, velocity v."""
        return u + dt * v, v.copy()

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:
        """(v_{n+1} - v_n) / dt."""
        return jump / dt

    def gap_offset(self, dt: float) -> float:
        """dt / 2: gaps follow from x."""
        return 0.5 * dt

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:
        """Mean of the step, u_n + dt/4 (v_n + v_{n+1}) = x + dt/4 (v_{n+1} - v_n): second order, and a layer of any
        stiffness leaves the stable step alone."""
        return gap - 0.25 * dt * v, 0.25 * dt  # the gap is that of x, dt/2 after the old instant

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Interface tractions act over the step that ends in their instant."""
        return (0.0, 0.0, 1.0), (0.0, 1.0)
