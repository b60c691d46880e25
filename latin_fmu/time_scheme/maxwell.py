"""Maxwell branches: springs with dashpots in series, side by side with the stiffness K of a body.

The generalised Maxwell model (Christensen, Theory of Viscoelasticity) of a body has the internal forces

    K u + sum_j g_j K e_j,        e_j' = u' - e_j / tau_j,

e_j the elongation of the spring of branch j, g_j its stiffness over K and tau_j its relaxation time. At the angular
frequency w this is K (1 + sum_j g_j i w tau_j / (1 + i w tau_j)) u: the static stiffness is K, that of fast motions
K (1 + sum_j g_j). Only strain is damped: in a rigid motion K u and K e_j are zero.

The trapezoidal rule gives the elongations of the new instant,

    e_new = c_e e + c_u (u_new - u),      h = dt / (2 tau),  c_e = (1 - h) / (1 + h),  c_u = 1 / (1 + h),

so that the operator of a march has K (1 + sum_j g_j c_u) in the place of K, constant and with its pattern. Over a step
the work of a branch, (u_new - u).g K (e + e_new) / 2, is exactly the change of its energy g e.K e / 2 plus

    g (h / 2) (e + e_new).K (e + e_new) >= 0.

Central differences take internal forces in the middle of the step: there the rule is applied to both halves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .scheme import Array, TimeScheme


@dataclass(frozen=True)
class MaxwellBranches:
    """Branches of a body, relaxed at the start.

    Attributes
    ----------
    strengths : g_j > 0, stiffness of each over that of the body. times : relaxation times tau_j > 0, s.
    """

    strengths: tuple[float, ...] = ()
    times: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.times)

    @property
    def instantaneous(self) -> float:
        """Stiffness of fast motions over the static one, 1 + sum_j g_j."""
        return 1.0 + sum(self.strengths)

    def marched(self, scheme: TimeScheme) -> MaxwellBranches:
        """The branches that a scheme marches: without inertia all are relaxed."""
        if scheme.name == "quasi_static":
            return NO_BRANCHES
        return self

    def weights(self, scheme: TimeScheme, dt: float) -> Array:
        """g, c_e, c_u and h (4, n_branch) of a step, of explicit schemes those of half a step (module docstring)."""
        h = np.array([(0.25 if scheme.explicit else 0.5) * dt / time for time in self.times])
        return np.stack([np.array(self.strengths), (1.0 - h) / (1.0 + h), 1.0 / (1.0 + h), h])

    def stiffening(self, scheme: TimeScheme, dt: float) -> float:
        """1 + sum_j g_j c_u: factor of K in the operator of the march."""
        strengths, _, of_motion, _ = self.weights(scheme, dt)
        return 1.0 + float(strengths @ of_motion)

    def modulus(self, s: complex | NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Dynamic stiffness over the static one at complex angular frequencies, i w of a harmonic motion, s-1."""
        ratio: NDArray[np.complex128] = 1.0 + self.rise(s)
        return ratio

    def rise(self, s: complex | NDArray[np.complex128]) -> NDArray[np.complex128]:
        """``modulus`` less 1: the stiffness of the branches over the static one."""
        turns = np.multiply.outer(s, np.array(self.times))
        ratio: NDArray[np.complex128] = np.asarray((turns / (1.0 + turns)) @ np.array(self.strengths))
        return ratio


NO_BRANCHES = MaxwellBranches()


def joint_weights(scheme: TimeScheme, dt: float, times: Array) -> Array:
    """c_e, c_u and (w_old + w_new c_e) / c_u (n, 3) of Maxwell joints with relaxation times (n,), s, over a step of a
    scheme, which takes springs of interfaces at w_old and w_new of its instants; 0 without inertia."""
    if scheme.name == "quasi_static":
        return np.zeros((len(times), 3))
    h = 0.5 * dt / times
    c_e, c_u = (1.0 - h) / (1.0 + h), 1.0 / (1.0 + h)
    # explicit steps have the elongation of the place at which the spring acts already
    if scheme.explicit:
        old = 1.0
    else:
        old = scheme.old_weights[1]
    return np.stack([c_e, c_u, (old + (1.0 - old) * c_e) / c_u], axis=1)
