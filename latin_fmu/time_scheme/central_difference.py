"""Central differences: the explicit time scheme, with displacements kept between the instants.

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

from .scheme import Array, TimeScheme


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

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """Displacement u + dt v, velocity v."""
        return u + dt * v, v.copy()

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:  # noqa: ARG002
        """(v_{n+1} - v_n) / dt."""
        return jump / dt

    def gap_offset(self, dt: float) -> float:
        """dt / 2: gaps follow from x."""
        return 0.5 * dt

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:  # noqa: ARG002
        """Mean of the step, u_n + dt/4 (v_n + v_{n+1}) = x + dt/4 (v_{n+1} - v_n): second order, and a layer of any
        stiffness leaves the stable step alone."""
        return gap - 0.25 * dt * v, 0.25 * dt

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Interface tractions act over the step that ends in their instant."""
        return (0.0, 0.0, 1.0), (0.0, 1.0)
