"""Implicit time schemes: Newmark, HHT, massless contact nodes, generalised alpha, increments without inertia.

Newmark and Hilber-Hughes-Taylor: motion at the new instant, forces R = f - C v - K u with every force (loads, interface
tractions, dashpots) weighted alike:

    M a_{n+1} = (1 + alpha) R_{n+1} - alpha R_n
    u_{n+1} = u_n + dt v_n + dt^2 ((1/2 - beta) a_n + beta a_{n+1})
    v_{n+1} = v_n + dt ((1 - gamma) a_n + gamma a_{n+1})

HHT: alpha in [-1/3, 0], gamma = 1/2 - alpha, beta = (1 - alpha)^2 / 4 (Hilber, Hughes, Taylor 1977): second
order, unconditionally stable, dissipative at high frequency for alpha < 0. Newmark: alpha = 0, free beta and
gamma; second order for gamma = 1/2 only.

Energy over one step (Krenk 2006, exact): with a_w = (1 - gamma) a_n + gamma a_{n+1},

    Delta T + Delta V + Du.(C v)_w + Du.[(K u)_w - (K u_n + K u_{n+1})/2] + dt^2 (beta - gamma/2) a_w.M Da = Du.f_w

where ( )_w weights the instants n-1, n, n+1 as a_w and the equation of motion do.

Massless contact nodes: average-acceleration Newmark with the exact displacement law of contact. The nodes of contact
interfaces carry no mass (``fem.contact_layer`` moves it to their inner neighbours), so that an impact stops no mass at
once, and the velocity of the interface is

    W_{n+1} = (u_{n+1} - u_n) / dt

for which gap_{n+1} = gap_n + dt d_{n+1} exactly: no penetration, and next to no energy lost at impacts (Khenous,
Laborde, Renard 2008). Undamped elsewhere; keep the Courant number at most about 0.8. When to choose it: long runs with
many impacts (it keeps 97 to 100 % of a bouncing bar's energy over twenty impacts, where HHT -0.1 keeps 15 %). Price: a
less accurate contact force on coarse faces (crushing of two specimens at 4 elements per edge: 1.6 % against 1.3 % in
L2), and an energy that may rise by up to 1 % in corners.

Its energies, and those of the next scheme, follow from the equation of motion of the new instant alone, since massless
nodes need not be in balance at the old one (Dv, Da changes over the step, v_m = (v_n + v_{n+1})/2):

    Delta T + Delta V + Du.C v_w + Du.[K u_w - (K u_n + K u_{n+1})/2]
        + dt (1 - a_m - gamma) v_m.M Da + dt^2 (beta - gamma/2) Da.M a_w = Du.f_w + Du.lambda_{n+1}

Generalised alpha (Chung, Hulbert 1993) with the interface tractions unweighted: with a_m = (2 rho - 1)/(rho + 1),
a_f = rho/(rho + 1), gamma = 1/2 - a_m + a_f, beta = (1 - a_m + a_f)^2/4 and rho the spectral radius at infinity,

    M a_w + C v_w + K u_w = f_w + lambda_{n+1},    a_w = (1 - a_m) a_{n+1} + a_m a_n,  others with a_f
    W_{n+1} = (u_{n+1} - u_n) / dt,                D = beta dt T A^-1 T^T

The work of a frictionless contact over a step is lambda_{n+1} (gap_n - gap_{n+1}) = lambda_{n+1} gap_n with the sign of
the law: it never adds energy, so that no step is too long. For a body that lands three more things are needed
(``fem.contact_layer``): nodes of faces that may open carry no mass, the mass is between the consistent and the lumped
one (``consistent_share``), and the one layer of elements at these faces is viscous (``landing_damping``). Peak of
the contact force of a bar of 40 elements that lands on a wall, over the exact plateau, at Courant numbers 0.05 to 4: at
most 1.08, where HHT -0.1 gives 10.4 at 0.05, 2.5 at 0.2, 1.25 at 1 (``examples/landing.py``). The price is energy,
about h/L per impact; without viscosity, and with the contact mass on four layers, 99.9 % are kept at peaks of 1.14 to
1.21.

Springs of an interface follow the displacement of the time that the scheme takes forces at, u_w, as those of a mesh.

No inertia: a succession of equilibria, Eqs. (9)-(11) without mass, backward Euler:

    K u_{n+1} = f_{n+1},    v_{n+1} = (u_{n+1} - u_n) / dt,    a_{n+1} = (v_{n+1} - v_n) / dt

Contact and friction hold in terms of displacements exactly: the opening at the end of an increment is ``gap + dt d``,
the slip of the increment ``dt`` times the sliding velocity. The solution does not depend on dt: time only orders the
increments of load. Works take the mean of the forces before and after, exact for an elastic body, so that only friction
dissipates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scheme import Array, TimeScheme


@dataclass(frozen=True)
class Newmark(TimeScheme):
    """Newmark scheme with parameters beta, gamma (average acceleration by default)."""

    beta: float = 0.25
    gamma: float = 0.5
    alpha: float = 0.0
    name: str = "newmark"

    @property
    def declared_order(self) -> int:
        """2 for gamma = 1/2 - alpha, else 1."""
        if abs(self.gamma - 0.5 + self.alpha) < 1e-12:
            return 2
        return 1

    @property
    def force_weight(self) -> float:
        """Weight 1 + alpha."""
        return 1.0 + self.alpha

    @property
    def memory_weight(self) -> float:
        """Weight alpha of the forces of the old instant."""
        return self.alpha

    def operator(self, dt: float) -> tuple[float, float, float]:
        """A = M + (1 + alpha) (gamma dt C + beta dt^2 K)."""
        weight = self.force_weight
        return 1.0, weight * self.gamma * dt, weight * self.beta * dt * dt

    def velocity_gain(self, dt: float) -> float:
        """Derivative dv/da = gamma dt."""
        return self.gamma * dt

    def displacement_gain(self, dt: float) -> float:
        """Derivative du/da = beta dt^2."""
        return self.beta * dt * dt

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:
        """Newmark predictors (shapes of the arguments)."""
        return u + dt * (v + dt * (0.5 - self.beta) * a), v + dt * (1 - self.gamma) * a

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:
        """a_{n+1} = ((v_{n+1} - v_n)/dt - (1 - gamma) a_n)/gamma."""
        return (jump / dt - (1 - self.gamma) * a_old) / self.gamma

    def advance_opening(self, gap: Array, v: Array, a: Array, new: Array, dt: float) -> tuple[Array, Array]:
        """The displacement recursion applied to the opening."""
        rate = self.invert_velocity(a, new - v, dt)
        free, _ = self.predict(gap, v, a, dt)
        return free + self.displacement_gain(dt) * rate, rate

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:
        """The displacement of the new instant: springs of a layer are those of a mesh."""
        zero, one = np.zeros(1), np.ones(1)
        # the recursion is linear in the new velocity: its value without one, and its factor
        rest, _ = self.advance_opening(gap, v, a, np.zeros_like(v), dt)
        return rest, float(self.advance_opening(zero, zero, zero, one, dt)[0][0])

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Weights of the energy identity in the module docstring."""
        # (1 - gamma) times the equation of motion of n, gamma times that of n + 1, each with its alpha
        new, old = self.gamma, 1 - self.gamma
        force = (-old * self.alpha, old * (1 + self.alpha) - new * self.alpha, new * (1 + self.alpha))
        return force, (old, new)

    def inertia_dissipation(self, dt: float) -> float:
        """Factor dt^2 (beta - gamma / 2)."""
        return dt * dt * (self.beta - 0.5 * self.gamma)


class HHT(Newmark):
    """HHT-alpha scheme, alpha in [-1/3, 0]."""

    def __init__(self, alpha: float = -0.1) -> None:
        super().__init__(beta=(1 - alpha) ** 2 / 4, gamma=0.5 - alpha, alpha=alpha, name="hht")


class MasslessContact(Newmark):
    """Newmark 1/4, 1/2 with massless contact nodes."""

    massless_contact = True
    one_step_energy = True  # massless nodes need not be in balance at the old instant

    def __init__(self) -> None:
        super().__init__(beta=0.25, gamma=0.5, alpha=0.0, name="massless_contact")

    def interface_gain(self, dt: float) -> float:
        """Derivative dW/da = beta dt."""
        return self.displacement_gain(dt) / dt

    def interface_velocity(self, u_old: Array, u: Array, v: Array, dt: float) -> Array:  # noqa: ARG002
        """Velocity (u - u_old) / dt."""
        return (u - u_old) / dt

    def advance_opening(self, gap: Array, v: Array, a: Array, new: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """Opening gap + dt * new, exactly."""
        # the acceleration of the opening has no part in it
        return gap + dt * new, a

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """The instant of the equation of motion."""
        return (0.0, 0.0, 1.0), (0.0, 1.0)

    def inertia_drift(self, dt: float) -> float:
        """Factor dt (1 - gamma)."""
        return dt * (1.0 - self.gamma)


class GeneralizedAlpha(MasslessContact):
    """Generalised alpha, unweighted tractions, massless contact nodes and a viscous contact layer (module docstring).

    Parameters
    ----------
    rho_inf : spectral radius at infinity, 0.5 ... 1. landing_damping : viscosity q of the contact layer, in units of
        (h / c_p) K_e of each element; 0: none, and the contact mass is spread over up to four layers.
    """

    def __init__(self, rho_inf: float = 0.8, landing_damping: float = 0.6) -> None:
        a_m, a_f = (2 * rho_inf - 1) / (rho_inf + 1), rho_inf / (rho_inf + 1)
        shape = {"beta": 0.25 * (1 - a_m + a_f) ** 2, "gamma": 0.5 - a_m + a_f}
        Newmark.__init__(self, **shape, alpha=0.0, name="generalized_alpha")
        # the fields of a frozen dataclass
        object.__setattr__(self, "old_weights", (a_m, a_f))
        object.__setattr__(self, "landing_damping", landing_damping)

    @property
    def declared_order(self) -> int:
        """2 for every rho_inf."""
        return 2

    def consistent_share(self, courant: float) -> float:
        """Share min(1, (1 + C^2)/2), which takes off most of the dispersion of the scheme at this Courant number."""
        return min(1.0, 0.5 * (1.0 + courant**2))

    @property
    def force_weight(self) -> float:
        """Weight 1 - a_f."""
        return 1.0 - self.old_weights[1]

    @property
    def traction_weight(self) -> float:
        """Tractions are unweighted."""
        return 1.0

    def operator(self, dt: float) -> tuple[float, float, float]:
        """A = (1 - a_m) M + (1 - a_f) (gamma dt C + beta dt^2 K)."""
        _, damping, stiffness = super().operator(dt)
        return 1.0 - self.old_weights[0], damping, stiffness

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:  # noqa: ARG002
        """The displacement u_w: springs of a layer are those of a mesh."""
        # a_f gap + (1 - a_f) (gap + dt new)
        return gap, self.force_weight * dt

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Weights of the equation of motion."""
        a_m, a_f = self.old_weights
        return (0.0, a_f, 1.0 - a_f), (a_m, 1.0 - a_m)

    def traction_weights(self) -> tuple[float, float, float]:
        """Tractions are unweighted."""
        return 0.0, 0.0, 1.0

    def inertia_drift(self, dt: float) -> float:
        """Factor dt (1 - a_m - gamma)."""
        return dt * (1.0 - self.old_weights[0] - self.gamma)


@dataclass(frozen=True)
class QuasiStatic(TimeScheme):
    """Increments of load without inertia; not in the registry, which holds schemes of motion only."""

    name: str = "quasi_static"

    @property
    def declared_order(self) -> int:
        """Order 1 of the velocities; displacements are exact."""
        return 1

    def operator(self, dt: float) -> tuple[float, float, float]:
        """A = dt C + dt^2 K."""
        return 0.0, dt, dt * dt

    def velocity_gain(self, dt: float) -> float:
        """Derivative dv/da = dt."""
        return dt

    def displacement_gain(self, dt: float) -> float:
        """Derivative du/da = dt^2."""
        return dt * dt

    def predict(self, u: Array, v: Array, a: Array, dt: float) -> tuple[Array, Array]:  # noqa: ARG002
        """Displacement u + dt v, velocity v."""
        return u + dt * v, v

    def invert_velocity(self, a_old: Array, jump: Array, dt: float) -> Array:  # noqa: ARG002
        """(v_{n+1} - v_n) / dt."""
        return jump / dt

    def layer_jump(self, gap: Array, v: Array, a: Array, dt: float) -> tuple[Array, float]:  # noqa: ARG002
        """Displacement gap + dt * new."""
        return gap, dt

    def energy_weights(self) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Mean of the forces before and after."""
        return (0.0, 0.5, 0.5), (0.0, 1.0)
