"""Central differences: the explicit scheme, with displacements kept between the instants.

With x halfway between two instants and v at the instants (leapfrog),

    x_{n+1/2} = u_n + dt/2 v_n
    M (v_{n+1} - v_n) / dt = (f_n + f_{n+1})/2 - K x_{n+1/2} - C v + lambda_{n+1}
    u_{n+1} = x_{n+1/2} + dt/2 v_{n+1}

Gaps are those of x: x_{n+3/2} = x_{n+1/2} + dt v_{n+1}, so that the law gap + dt d >= 0 is the exact displacement
condition and nothing penetrates. Second order; stable while dt <= 2 / omega_max (``propagator.stable_step``).

Energy over one step, exactly (Du = u_{n+1} - u_n, D the change over the step; undamped):

    D[v.M v / 2 + u.K u / 2 - dt^2/8 v.K v] = Du.(f_n + f_{n+1})/2 + Du.lambda_{n+1}

so that what the scheme itself takes is - dt^2/8 D[v.K v]: it is given back, nothing is lost.
"""

from __future__ import annotations

from .scheme import Array


class CentralDifference:
    """Central differences with a lumped mass (module docstring); marched by the explicit propagator only."""

    name = "central_difference"
    declared_order = 2
    explicit = True
    force_weight = 1.0
    memory_weight = 0.0
    massless_contact = False

    def operator(self, dt: float) -> tuple[float, float, float]:
        """A = M + dt/2 C."""
        return 1.0, 0.5 * dt, 0.0

    def velocity_gain(self, dt: float) -> float:
        """dt."""
        return dt

    def displacement_gain(self, dt: float) -> float:
        """dt^2 / 2."""
        return 0.5 * dt * dt

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """u + dt v, v."""
        return u + dt * v, v.copy()

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:  # noqa: ARG002
        """(v_{n+1} - v_n) / dt."""
        return jump / dt

    def interface_gain(self, dt: float) -> float:
        """That of the velocity."""
        return dt

    def interface_velocity(self, u_old: Array, u: Array, v: Array, dt: float) -> Array:  # noqa: ARG002
        """The velocity of the instant."""
        return v

    def gap_lead(self, dt: float) -> float:
        """dt / 2: gaps are those of x."""
        return 0.5 * dt

    def advance_opening(self, gap: Array, v: Array, a: Array, new: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """gap + dt d, exactly."""
        return gap + dt * new, a

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:  # noqa: ARG002
        """Mean of the step, u_n + dt/4 (v_n + v_{n+1}) = x + dt/4 (v_{n+1} - v_n): second order, and a layer of any
        stiffness leaves the stable step alone."""
        return gap - 0.25 * dt * v, 0.25 * dt

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Interface tractions act over the step that ends in their instant."""
        return (0.0, 0.0, 1.0), (0.0, 1.0)

    def inertia_dissipation(self, dt: float) -> float:  # noqa: ARG002
        """0: the kinetic energy needs no correction, see the module docstring for the elastic one."""
        return 0.0
