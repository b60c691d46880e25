"""No inertia: a succession of equilibria, Eqs. (9)-(11) without mass.

    K u_{n+1} = f_{n+1},    v_{n+1} = (u_{n+1} - u_n) / dt,    a_{n+1} = (v_{n+1} - v_n) / dt

that is backward Euler, for which contact and friction hold in terms of displacements exactly: the opening at the end
of an increment is ``gap + dt d``, the slip of the increment ``dt`` times the sliding velocity. The answer does not
depend on dt: time only orders the increments of load. Works take the mean of the forces before and after, exact for an
elastic body, so that nothing is dissipated but by friction.
"""

from __future__ import annotations

from dataclasses import dataclass

from .scheme import Array


@dataclass(frozen=True)
class QuasiStatic:
    """Increments of load without inertia; not in the registry of schemes, whose entries are all schemes of motion."""

    name: str = "quasi_static"

    @property
    def declared_order(self) -> int:
        """1 (of the velocities; displacements are exact)."""
        return 1

    @property
    def explicit(self) -> bool:
        """Implicit."""
        return False

    def operator(self, dt: float) -> tuple[float, float, float]:
        """A = dt C + dt^2 K."""
        return 0.0, dt, dt * dt

    @property
    def force_weight(self) -> float:
        """1."""
        return 1.0

    @property
    def memory_weight(self) -> float:
        """0."""
        return 0.0

    def velocity_gain(self, dt: float) -> float:
        """dt."""
        return dt

    def displacement_gain(self, dt: float) -> float:
        """dt^2."""
        return dt * dt

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """u + dt v, v."""
        return u + dt * v, v

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:  # noqa: ARG002
        """(v_{n+1} - v_n) / dt."""
        return jump / dt

    @property
    def massless_contact(self) -> bool:
        """There is no mass to take away."""
        return False

    def interface_gain(self, dt: float) -> float:
        """That of the velocity."""
        return dt

    def interface_velocity(self, u_old: Array, u: Array, v: Array, dt: float) -> Array:  # noqa: ARG002
        """The velocity of the increment."""
        return v

    def advance_opening(self, gap: Array, v: Array, a: Array, new: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """gap + dt d, exactly."""
        return gap + dt * new, a

    def gap_lead(self, dt: float) -> float:  # noqa: ARG002
        """None."""
        return 0.0

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:  # noqa: ARG002
        """gap + dt d."""
        return gap, dt

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Mean of the forces before and after."""
        return (0.0, 0.5, 0.5), (0.0, 1.0)

    def inertia_dissipation(self, dt: float) -> float:  # noqa: ARG002
        """None."""
        return 0.0
