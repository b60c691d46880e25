"""Indicator (24) and force mismatch: when to stop.

    eta = ||s - s_hat||^2 / (||s||^2 + ||s_hat||^2),  ||s||^2 = sum of int F Z^-1 F + int W Z W

over interfaces, sides and time, Z the material impedance of the side whatever k is used. ``error_indicator``
is sqrt(eta). Without inertia the denominator leaves out the velocities: a body may travel far under next to no force.
By E+, F_hat - F = r/2 and W_hat - W = r/(2k) with the residual r = (F_hat + k W_hat) - q.

The indicator is blind to shear and to soft sides of a contrast. The run stops on both it and the force mismatch:
nodal forces f of F - F_hat in the norm sqrt(f . C f) of the admittance C of one instant (the velocity error the
mismatch would cause), normal and tangential parts each against its own largest value so far.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .assembly import Assembly
from .kernels import close
from .layout import Array
from .stopping import TANGENTIAL_FLOOR

# Fields below this fraction of the characteristic traction are negligible.
_FLOOR = 1e-3


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
        f_weight, w_weight = area / impedance, area * impedance
        self._k = k
        moving = 0.0 if assembly.quasi_static else 1.0
        self.weights = np.stack([0.25 * (f_weight + w_weight * z * z), f_weight, moving * w_weight])
        self._half_area = 0.5 * layout.area
        self._parts = [layout.normal] if layout.normal.all() else [layout.normal, ~layout.normal]

    def floor(self) -> Scales:
        """Scales of negligible fields, relative to the largest load."""
        level = _FLOOR * self.assembly.characteristic_traction
        uniform = np.where(self.assembly.layout.normal, level, 0.0)
        force = float(self._admittance_norms((uniform * self.assembly.layout.area)[:, None])[0])
        field = level**2 * float(self.weights[1, self.assembly.layout.normal].sum())
        tiny = np.finfo(float).tiny
        return Scales(max(field, tiny), (max(force, tiny), max(force, tiny)))

    def field(
        self, q: Array, fields: tuple[Array, Array, Array, Array], scales: Scales
    ) -> tuple[Array, Measure]:
        """Residual of q and sqrt(eta) over the window; ``fields`` = F, W, F_hat, W_hat, all (n, n_flat)."""
        n = len(q)
        f, w, f_hat, w_hat = fields
        residual = np.empty_like(q)
        difference, size = close(q, self._k, f_hat, w_hat, f, w, self.weights, residual)
        reached = Scales(max(scales.field, size / n), scales.force)
        return residual, Measure(float(np.sqrt(difference / n / reached.field)), reached)

    def per_interface(self, residual: Array, scales: Scales) -> Array:
        """sqrt(eta) of each interface alone against the common scale, (n_interface,)."""
        density = self.weights[0] * np.einsum("ij,ij->j", residual, residual) / len(residual)
        layout = self.assembly.layout
        total = np.bincount(layout.interface, density, minlength=len(self.assembly.interfaces))
        shares: Array = np.sqrt(total / scales.field)
        return shares

    def mismatch(self, residual: Array, f_hat: Array, scales: Scales) -> Measure:
        """Largest relative force mismatch over the instants of the window, (n, n_flat) arguments."""
        area = self.assembly.layout.area
        force, error = list(scales.force), [0.0, 0.0]
        for i in range(len(residual)):
            # columns: tractions and their mismatch, normal and tangential parts
            vectors = np.stack([area * f_hat[i], self._half_area * residual[i]], axis=1)
            parts = np.concatenate([vectors * mask[:, None] for mask in self._parts], axis=1)
            norms = self._admittance_norms(parts)
            for part in range(len(self._parts)):
                force[part] = max(force[part], float(norms[2 * part]))
                error[part] = max(error[part], float(norms[2 * part + 1]))
        force[1] = max(force[1], TANGENTIAL_FLOOR * force[0])
        worst = max(e / f for e, f in zip(error, force, strict=True))
        return Measure(worst, Scales(scales.field, (force[0], force[1])))

    def _admittance_norms(self, force: Array) -> Array:
        """sqrt(f . C f) of each column of nodal forces (n_flat, n_vector)."""
        total = np.zeros(force.shape[1])
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            f = force[channels].reshape(len(channels), channels.shape[1] * force.shape[1])
            work = np.einsum("cv,cv->v", f, propagator.operators.compliance @ f)
            total += work.reshape(channels.shape[1], force.shape[1]).sum(axis=0)
        norms: Array = np.sqrt(np.maximum(total, 0.0))
        return norms
