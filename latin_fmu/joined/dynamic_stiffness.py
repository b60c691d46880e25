"""Stiffness of an assembly that depends on frequency: damping by strain in modes and frequency responses.

With the Maxwell branches of the bodies (``time_scheme.maxwell``) the motions q of a basis obey, for q ~ exp(s t),

    [s^2 I + s C + K + sum_b (m_b(s) - 1) K_b] q = load,      m_b(s) = 1 + sum_j g_j s tau_j / (1 + s tau_j)

with K_b the stiffness of all bodies that have the branches b. Without load it is a nonlinear eigenvalue problem, whose
eigenvalue s of a mode gives its natural frequency |s| / (2 pi) and its damping ratio -Re s / |s|. To first order in the
damping that ratio is the sum over the bodies of the ratio of their material at this frequency times their share of the
strain energy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..latin.assembly import Array
from ..propagator import SubstructureModel
from ..propagator.model import relaxing_part
from ..scene.materials import MaterialTable
from ..time_scheme import MaxwellBranches

Complex = NDArray[np.complex128]
_ROUNDS: Final = 12  # of inverse iteration: each gains some digits
_EXACT: Final = 1e-12  # change of an eigenvalue over its size
_NEWTON: Final = 30
_CURVE: Final = 9  # frequencies of the printed curve, a decade beyond the band on both sides
STIFFENED: Final = 0.05
"""Rise of frequencies inside the band above which there is a warning."""


@dataclass(frozen=True)
class ProjectedStiffness:
    """Stiffness (m, m) of what has the same branches in a mass-orthonormal basis, s-2."""

    branches: MaxwellBranches
    stiffness: Array


@dataclass(frozen=True)
class BranchedStiffness:
    """Stiffness (n, n) of bodies or joints with the same branches among all dofs, N m-1."""

    branches: MaxwellBranches
    stiffness: sp.csr_array

    def projected(self, basis: Array) -> ProjectedStiffness:
        """The stiffness in a basis (n, m)."""
        return ProjectedStiffness(self.branches, np.asarray(basis.T @ (self.stiffness @ basis)))


def strained_bodies(
    models: Mapping[str, SubstructureModel], where: Mapping[str, slice], n: int
) -> tuple[BranchedStiffness, ...]:
    """Stiffnesses (n, n) of the substructures by their branches; ``where`` : dofs of each."""
    groups: dict[MaxwellBranches, sp.csr_array] = {}
    for name, model in models.items():
        if len(model.branches):
            block = sp.coo_array(relaxing_part(model))
            place = tuple(index + where[name].start for index in block.coords)
            placed = sp.csr_array(sp.coo_array((block.data, place), shape=(n, n)))
            total = groups.get(model.branches)
            groups[model.branches] = placed if total is None else sp.csr_array(total + placed)
    return tuple(BranchedStiffness(branches, stiffness) for branches, stiffness in groups.items())


def dynamic_matrix(s: complex, squares: Array, damping: Array, strained: Sequence[ProjectedStiffness]) -> Complex:
    """Matrix (m, m) of the module docstring in a mass-orthonormal basis with K = diag(``squares``)."""
    matrix: Complex = np.diag(squares + s * s) + s * damping
    for part in strained:
        matrix = matrix + (part.branches.modulus(s) - 1.0) * part.stiffness
    return matrix


def eigenvalues(omega: Array, damping: Array, strained: Sequence[ProjectedStiffness], count: int) -> Complex:
    """Eigenvalues s (count,), s-1, of the first modes of a mass-orthonormal basis in which K = diag(omega^2); 0 of
    rigid motions. ``damping`` : C (m, m), s-1."""
    found = np.zeros(count, dtype=np.complex128)
    squares = omega**2
    for i in np.flatnonzero(omega[:count] > 0.0):
        shape: Complex = np.zeros(len(omega), dtype=np.complex128)
        shape[i] = 1.0
        s = pole_of(1j * omega[i], shape, squares, damping, strained)
        for _ in range(_ROUNDS):
            last, matrix = s, dynamic_matrix(s, squares, damping, strained)
            # off the eigenvalue by round-off at least: the matrix stays regular
            matrix = matrix + 1e-13 * squares[i] * np.eye(len(omega))
            moved = np.linalg.solve(matrix, shape)
            shape = moved / moved[np.argmax(np.abs(moved))]
            s = pole_of(s, shape, squares, damping, strained)
            if abs(s - last) <= _EXACT * abs(s):
                break
        found[i] = s
    return found


def pole_of(s: complex, x: Complex, squares: Array, damping: Array, strained: Sequence[ProjectedStiffness]) -> complex:
    """The s near a given one for which x^T D(s) x = 0, by Newton's method."""
    inertia = complex(x @ x)
    viscous = complex(x @ (damping @ x))
    elastic = complex(x @ (squares * x))
    parts = [(part.branches, complex(x @ (part.stiffness @ x))) for part in strained]
    for _ in range(_NEWTON):
        value = inertia * s * s + viscous * s + elastic
        slope = 2.0 * inertia * s + viscous
        for branches, stiffness in parts:
            value += complex(branches.modulus(s) - 1.0) * stiffness
            times = np.array(branches.times)
            slope += complex((times / (1.0 + s * times) ** 2) @ np.array(branches.strengths)) * stiffness
        change = value / slope
        s = s - change
        if abs(change) <= 1e-14 * abs(s):
            break
    return s


def curve_lines(materials: Mapping[str, MaterialTable]) -> list[str]:
    """Text: damping ratio and rise of frequencies of materials with ``damping_ratios``, a decade beyond their bands."""
    lines = []
    for name, material in materials.items():
        if (table := material.damping_ratios) is None:
            continue
        first, last = table.frequencies
        at = np.geomspace(0.1 * first, 10.0 * last, _CURVE)
        damping = material.damping
        row = "; ".join(
            f"{f:.4g} Hz {100 * ratio:.3g} % (+{100 * rise:.2g} %)"
            for f, ratio, rise in zip(at, damping.ratio(at), damping.rise(at), strict=True)
        )
        most = float(damping.rise(np.array([last]))[0])
        lines.append(f"{name}: damping ratio (rise of frequencies over the static modulus) {row}")
        if most > STIFFENED:
            lines.append(
                f"warning: {name} stiffens: frequencies rise by up to {100 * most:.2g} % inside its band, as causal "
                "damping of this size requires; give young_modulus as measured at rest, not in the band"
            )
    return lines
