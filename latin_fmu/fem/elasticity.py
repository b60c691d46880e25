"""Linear elasticity of homogeneous materials: stresses of strains, moduli along a direction, waves.

Tensors are six numbers in the order xx yy zz yz xz xy; strains are components of the tensor (half the engineering
shear).

Isotropic: sigma = lambda tr(eps) I + 2 mu eps. Orthotropic, in the axes 1, 2, 3 of the material (Jones, Mechanics of
Composite Materials, 1999, section 2.3):

    eps_ii = sigma_ii / E_i - sum_(j != i) nu_ji sigma_jj / E_j,    2 eps_ij = sigma_ij / G_ij,
    nu_ji / E_j = nu_ij / E_i

Plane waves along n have the speeds c with rho c^2 an eigenvalue of Christoffel's tensor Gamma_ik = C_ijkl n_j n_l; the
traction that lets them out of a face is -(rho Gamma)^(1/2) v, which is rho c_p along the normal and rho c_s across it
in an isotropic body.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Self

import numpy as np

from .mesh import Array

ROWS: Final = (0, 1, 2, 1, 0, 0)
COLUMNS: Final = (0, 1, 2, 2, 2, 1)
"""First and second axis of the six components of a tensor."""
_PAIRS: Final = ((0, 1), (0, 2), (1, 2))
_DIRECTIONS: Final = 400  # on a hemisphere, 4 degrees apart: extreme speeds of waves within 1 %


@dataclass(frozen=True)
class Elasticity(ABC):
    """A homogeneous linear elastic material.

    Attributes
    ----------
    density : rho, kg m-3. expansions : coefficients of thermal expansion along the axes of the material, K-1.
    """

    density: float
    expansions: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), kw_only=True)

    @abstractmethod
    def products(self, pair: Array) -> Array:
        """int eps(v) : C : eps(u) of vector fields made of functions along each axis.

        Parameters
        ----------
        pair : (n_cell, n, 3, m, 3) int d_j phi_a d_l phi_b.

        Returns
        -------
        (n_cell, n, 3, m, 3), for the fields phi_a e_i and phi_b e_k.
        """

    @abstractmethod
    def stress(self, strain: Array) -> Array:
        """Stress (..., 6), Pa, of strains (..., 6)."""

    @abstractmethod
    def stiffened(self, factor: float) -> Self:
        """The same elasticity with every modulus times a factor."""

    @property
    @abstractmethod
    def wave_speeds(self) -> tuple[float, float]:
        """Speed of the fastest pressure wave and of the slowest shear wave (c_p, c_s), m s-1."""

    @property
    @abstractmethod
    def young_moduli(self) -> tuple[float, float]:
        """Smallest and largest Young's modulus along the axes of the material, Pa."""

    @property
    @abstractmethod
    def hourglass_modulus(self) -> float:
        """What the stiffness against hourglass modes of 8-node hexahedra is measured by (``elements``), Pa."""

    @property
    @abstractmethod
    def poisson_ratio(self) -> float:
        """Of the isotropic material that is as far from incompressible: its ratio of bulk and shear modulus."""

    @abstractmethod
    def moduli_along(self, directions: Array) -> tuple[Array, Array]:
        """Young's modulus (...) along unit vectors (..., 3), and shear modulus across them (the mean of both), Pa."""

    @abstractmethod
    def impedance(self, normals: Array) -> Array:
        """Traction over velocity (..., 3, 3) that lets waves out along unit normals (..., 3), Pa s m-1."""

    def pressure_speed(self, normals: Array) -> Array:
        """Speed (...), m s-1, of the wave that a pressure sends out along unit normals (..., 3): n . Z n / rho."""
        return np.asarray(np.einsum("...i,...ij,...j->...", normals, self.impedance(normals), normals) / self.density)

    @property
    def expansion(self) -> Array:
        """Strain (3, 3) of a free body per change of temperature, K-1."""
        return np.diag(self.expansions)

    @property
    def thermal_stress(self) -> Array:
        """C : alpha (6,), Pa K-1: the stress of a body that cannot expand is -C : alpha times the change."""
        return self.stress(self.expansion[ROWS, COLUMNS])

    @property
    def bar_speed(self) -> float:
        """Speed of waves along a thin bar, sqrt(E / rho) of the largest modulus, m s-1."""
        return float(np.sqrt(self.young_moduli[1] / self.density))

    def impedances(self, normals: Array) -> tuple[Array, Array]:
        """Parts (...) of ``impedance`` along unit normals (..., 3) and across them (the mean of both), Pa s m-1."""
        return _along_and_across(self.impedance(normals), normals)


def _along_and_across(tensor: Array, normals: Array) -> tuple[Array, Array]:
    """n T n and the mean of T across n, (...) each, of tensors (..., 3, 3)."""
    along = np.einsum("...i,...ij,...j->...", normals, tensor, normals)
    return along, 0.5 * (np.trace(tensor, axis1=-2, axis2=-1) - along)


@dataclass(frozen=True)
class Isotropic(Elasticity):
    """The same in all directions.

    Attributes
    ----------
    young_modulus : E, Pa. ratio : Poisson's ratio nu.
    """

    young_modulus: float
    ratio: float

    @property
    def lame(self) -> tuple[float, float]:
        """Lame constants (lambda, mu), Pa."""
        shear = self.young_modulus / (2 * (1 + self.ratio))
        return 2 * shear * self.ratio / (1 - 2 * self.ratio), shear

    def products(self, pair: Array) -> Array:
        """lambda int d_i phi_a d_k phi_b + mu int (d_k phi_a d_i phi_b + delta_ik d_j phi_a d_j phi_b)."""
        first, shear = self.lame
        block = first * pair + shear * np.swapaxes(pair, 2, 4)
        trace = shear * np.einsum("eakbk->eab", pair)
        for i in range(3):
            block[:, :, i, :, i] += trace
        return block

    def stress(self, strain: Array) -> Array:
        """Stress (..., 6), Pa: lambda tr(eps) I + 2 mu eps."""
        first, shear = self.lame
        stress: Array = 2.0 * shear * strain
        stress[..., :3] += first * strain[..., :3].sum(axis=-1, keepdims=True)
        return stress

    def stiffened(self, factor: float) -> Self:
        """The same elasticity with every modulus times a factor."""
        return replace(self, young_modulus=factor * self.young_modulus)

    @property
    def wave_speeds(self) -> tuple[float, float]:
        """(sqrt((lambda + 2 mu) / rho), sqrt(mu / rho)), m s-1."""
        first, shear = self.lame
        return float(np.sqrt((first + 2 * shear) / self.density)), float(np.sqrt(shear / self.density))

    @property
    def young_moduli(self) -> tuple[float, float]:
        """E twice, Pa."""
        return self.young_modulus, self.young_modulus

    @property
    def hourglass_modulus(self) -> float:
        """Young's modulus E, Pa."""
        return self.young_modulus

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio nu itself."""
        return self.ratio

    def moduli_along(self, directions: Array) -> tuple[Array, Array]:
        """E and mu, Pa, in every direction."""
        same = np.ones(directions.shape[:-1])
        return self.young_modulus * same, self.lame[1] * same

    def impedance(self, normals: Array) -> Array:
        """rho c_s I + rho (c_p - c_s) n n (..., 3, 3), Pa s m-1."""
        c_p, c_s = self.wave_speeds
        along, across = self.density * c_p, self.density * c_s
        return np.asarray(across * np.eye(3) + (along - across) * normals[..., :, None] * normals[..., None, :])

    def impedances(self, normals: Array) -> tuple[Array, Array]:
        """rho c_p and rho c_s, Pa s m-1, in every direction."""
        same = np.ones(normals.shape[:-1])
        c_p, c_s = self.wave_speeds
        return self.density * c_p * same, self.density * c_s * same


@dataclass(frozen=True)
class Orthotropic(Elasticity):
    """Three planes of symmetry.

    Attributes
    ----------
    moduli : (E_1, E_2, E_3), Pa. ratios : (nu_12, nu_13, nu_23), nu_ij the contraction along j under tension along i.
    shear_moduli : (G_12, G_13, G_23), Pa. axes : unit vectors of the axes 1, 2, 3, one a row.
    """

    moduli: tuple[float, float, float]
    ratios: tuple[float, float, float]
    shear_moduli: tuple[float, float, float]
    axes: tuple[tuple[float, float, float], ...] = field(default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))

    @cached_property
    def normal_compliance(self) -> Array:
        """Strains of unit normal stresses along the axes of the material (3, 3), Pa-1."""
        compliance = np.diag(1.0 / np.asarray(self.moduli))
        for (i, j), ratio in zip(_PAIRS, self.ratios, strict=True):
            # nu_ij / E_i = nu_ji / E_j: one ratio for both places
            compliance[[i, j], [j, i]] = -ratio / self.moduli[i]
        return compliance

    @cached_property
    def tensor(self) -> Array:
        """C_ijkl (3, 3, 3, 3) along the global axes, Pa."""
        tensor = np.zeros((3, 3, 3, 3))
        normal = np.linalg.inv(self.normal_compliance)
        for i in range(3):
            # round-off of the inverse is not symmetric
            tensor[i, i, range(3), range(3)] = 0.5 * (normal[i] + normal[:, i])
        for (i, j), shear in zip(_PAIRS, self.shear_moduli, strict=True):
            tensor[[i, i, j, j], [j, j, i, i], [i, j, i, j], [j, i, j, i]] = shear
        r = np.asarray(self.axes)
        return np.asarray(np.einsum("abcd,ai,bj,ck,dl->ijkl", tensor, r, r, r, r, optimize=True))

    @property
    def expansion(self) -> Array:
        """sum_i alpha_i a_i a_i (3, 3), K-1."""
        axes = np.asarray(self.axes)
        return np.asarray(axes.T @ np.diag(self.expansions) @ axes)

    def products(self, pair: Array) -> Array:
        """C_ijkl int d_j phi_a d_l phi_b."""
        return np.asarray(np.einsum("ijkl,eajbl->eaibk", self.tensor, pair, optimize=True))

    def stress(self, strain: Array) -> Array:
        """Stress (..., 6), Pa: C : eps."""
        # the contraction has every shear component twice
        six = self.tensor[ROWS, COLUMNS][:, ROWS, COLUMNS] * ([1.0] * 3 + [2.0] * 3)
        return np.asarray(strain @ six.T)

    def _christoffel(self, normals: Array) -> Array:
        return np.asarray(np.einsum("ijkl,...j,...l->...ik", self.tensor, normals, normals, optimize=True))

    def stiffened(self, factor: float) -> Self:
        """The same elasticity with every modulus times a factor."""
        moduli, shear_moduli = (factor * np.array(m) for m in (self.moduli, self.shear_moduli))
        return replace(self, moduli=tuple(moduli.tolist()), shear_moduli=tuple(shear_moduli.tolist()))

    @cached_property
    def wave_speeds(self) -> tuple[float, float]:
        """Largest and smallest over all directions, m s-1."""
        at = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
        # turns by the golden section: points of equal density, without poles
        turn, radius = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_DIRECTIONS), np.sqrt(1.0 - at**2)
        spiral = np.stack([radius * np.cos(turn), radius * np.sin(turn), at], axis=1)
        squares = np.linalg.eigvalsh(self._christoffel(np.concatenate([spiral, np.asarray(self.axes)]))) / self.density
        return float(np.sqrt(squares.max())), float(np.sqrt(squares.min()))

    @property
    def young_moduli(self) -> tuple[float, float]:
        """Smallest and largest of the three, Pa."""
        return min(self.moduli), max(self.moduli)

    @property
    def hourglass_modulus(self) -> float:
        """C_1111 along the global x axis, Pa."""
        return float(self.tensor[0, 0, 0, 0])

    @property
    def poisson_ratio(self) -> float:
        """nu with the bulk modulus under equal pressure and the mean of the three shear moduli."""
        # equal pressure p on all sides: the volume changes by p times the sum of the compliances
        bulk, shear = 1.0 / float(self.normal_compliance.sum()), sum(self.shear_moduli) / 3.0
        return (3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear)

    def moduli_along(self, directions: Array) -> tuple[Array, Array]:
        """1 / (n n : S : n n) and half of tr Gamma - n Gamma n, Pa."""
        squares = (directions @ np.asarray(self.axes).T) ** 2
        # n_i n_j of a unit stress n n shears twice by 1 / (2 G_ij)
        sheared = (squares[..., [0, 0, 1]] * squares[..., [1, 2, 2]]) @ (1.0 / np.asarray(self.shear_moduli))
        along = np.einsum("...i,ij,...j->...", squares, self.normal_compliance, squares) + sheared
        return 1.0 / along, _along_and_across(self._christoffel(directions), directions)[1]

    def impedance(self, normals: Array) -> Array:
        """(rho Gamma)^(1/2) (..., 3, 3), Pa s m-1."""
        # root of a symmetric tensor by its eigenvectors
        squares, shapes = np.linalg.eigh(self.density * self._christoffel(normals))
        return np.asarray((shapes * np.sqrt(squares)[..., None, :]) @ np.swapaxes(shapes, -1, -2))


def von_mises(stress: Array) -> Array:
    """Equivalent stress by von Mises (...,), Pa, of stresses (..., 6): sqrt(3/2 s : s) with the deviator s."""
    deviator = stress[..., :3] - stress[..., :3].mean(axis=-1, keepdims=True)
    size: Array = np.sqrt(1.5 * (deviator**2).sum(axis=-1) + 3.0 * (stress[..., 3:] ** 2).sum(axis=-1))
    return size
