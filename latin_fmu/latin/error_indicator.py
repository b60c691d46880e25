"""Indicator (24) and force mismatch: when to stop.

    eta = ||s - s_hat||^2 / (||s||^2 + ||s_hat||^2),  ||s||^2 = sum of int F Z^-1 F + int W Z W

over interfaces, sides and time, Z the material impedance of the side whatever k is used. ``error_indicator``
is sqrt(eta). By E+, F_hat - F = r/2 and W_hat - W = r/(2k) with the residual r = (F_hat + k W_hat) - q.

The indicator is blind to shear and to soft sides of a contrast. The run stops on both it and the force mismatch:
nodal forces f of F - F_hat in the norm sqrt(f . C f) of the admittance C of one instant (the velocity error the
mismatch would cause), normal and tangential parts each against its own largest value so far.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .assembly import Assembly
from .layout import Array

# Fields below this fraction of the characteristic traction are negligible.
_FLOOR = 1e-3
# Tangential mismatch is measured against its own scale, at least this fraction of the normal one.
_TANGENTIAL_FLOOR = 1e-2


@dataclass(frozen=True)
class Scales:
    """Largest norms met in accepted windows: of the fields, and of the forces (normal, tangential)."""

    field: float
    force: tuple[float, float]


@dataclass(frozen=True)
class Measure:
    """``value`` (sqrt(eta) or force mismatch) of one iterate, and the scales it would leave if accepted."""

    value: float
    scales: Scales


class Indicator:
    """Indicator and mismatch of an assembly for one search direction."""

    def __init__(self, assembly: Assembly, k: Array) -> None:
        self.assembly = assembly
        layout = assembly.layout
        free = k > 0
        z = np.divide(1.0, k, out=np.zeros_like(k), where=free)
        area = np.where(free, layout.area, 0.0)
        impedance = np.where(assembly.impedance > 0, assembly.impedance, 1.0)
        self._f_weight, self._w_weight = area / impedance, area * impedance
        self._r_weight = 0.25 * (self._f_weight + self._w_weight * z * z)
        self._half_area = 0.5 * layout.area
        self._parts = [layout.normal] if layout.normal.all() else [layout.normal, ~layout.normal]

    def floor(self) -> Scales:
        """Scales of negligible fields, relative to the largest load."""
        level = _FLOOR * self.assembly.characteristic_traction
        uniform = np.where(self.assembly.layout.normal, level, 0.0)
        force = self._admittance_norm(uniform * self.assembly.layout.area)
        field = level**2 * float(self._f_weight[self.assembly.layout.normal].sum())
        tiny = np.finfo(float).tiny
        return Scales(max(field, tiny), (max(force, tiny), max(_TANGENTIAL_FLOOR * force, tiny)))

    def field(self, residual: Array, fields: tuple[Array, Array, Array, Array], scales: Scales) -> Measure:
        """sqrt(eta) over the window; ``fields`` = F, W, F_hat, W_hat, each (n, n_flat) like ``residual``."""
        n = len(residual)
        f, w, f_hat, w_hat = fields
        size = self._square(self._f_weight, f, f_hat) + self._square(self._w_weight, w, w_hat)
        reached = Scales(max(scales.field, size / n), scales.force)
        difference = float(np.einsum("j,ij,ij->", self._r_weight, residual, residual)) / n
        return Measure(float(np.sqrt(difference / reached.field)), reached)

    def per_interface(self, residual: Array, scales: Scales) -> Array:
        """sqrt(eta) of each interface alone against the common scale, (n_interface,)."""
        n = len(residual)
        density = np.einsum("j,ij,ij->j", self._r_weight, residual, residual) / n
        layout = self.assembly.layout
        return np.array(
            [
                np.sqrt(sum(density[layout.channels(i, side)].sum() for side in (0, 1)) / scales.field)
                for i in range(len(self.assembly.interfaces))
            ]
        )

    def mismatch(self, residual: Array, f_hat: Array, scales: Scales) -> Measure:
        """Largest relative force mismatch over the instants of the window, (n, n_flat) arguments."""
        area = self.assembly.layout.area
        force = list(scales.force)
        error = [0.0, 0.0]
        for i in range(len(residual)):
            for part, mask in enumerate(self._parts):
                force[part] = max(force[part], self._admittance_norm(np.where(mask, f_hat[i] * area, 0.0)))
                gap = self._admittance_norm(np.where(mask, residual[i] * self._half_area, 0.0))
                error[part] = max(error[part], gap)
        force[1] = max(force[1], _TANGENTIAL_FLOOR * force[0])
        return Measure(
            max(e / f for e, f in zip(error, force, strict=True)), Scales(scales.field, (force[0], force[1]))
        )

    def _admittance_norm(self, force: Array) -> float:
        total = 0.0
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            f = force[channels]
            total += float(np.einsum("cm,cm->", f, propagator.operators.compliance @ f))
        return float(np.sqrt(max(total, 0.0)))

    @staticmethod
    def _square(weight: Array, a: Array, b: Array) -> float:
        return float(np.einsum("j,ij,ij->", weight, a, a) + np.einsum("j,ij,ij->", weight, b, b))
