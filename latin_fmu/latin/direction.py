"""All data of a run that depend on the search direction: k, and the weights made from it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from .assembly import Assembly
from .coarse import Coarse
from .layout import Array
from .point_by_point import PointByPoint
from .search_direction import channel_k
from .settings import Settings

_FLOOR = 1e-3  # fields below this fraction of the characteristic traction are negligible


class Direction:
    """Search direction for windows of ``n`` instants.

    Attributes
    ----------
    k : (n_flat,), Pa s m-1. choice : what it is, in words. z : 1/k, 0 where k is. metric : (n_flat,) squared weights of
    the norm sum area / k q^2 (a power) in which iterates are compared.
    """

    def __init__(self, assembly: Assembly, settings: Settings, n: int) -> None:
        self.assembly = assembly
        self.k, self.choice = channel_k(assembly, settings.search_direction, n)
        self.z = np.divide(1.0, self.k, out=np.zeros_like(self.k), where=self.k > 0)
        self.metric = assembly.layout.area * self.z
        self.coarse: Coarse | None = None  # without inertia, from ``bind``

    @cached_property
    def points(self) -> PointByPoint:
        """Gauss-Seidel over the points, built where it is needed."""
        return PointByPoint(self.assembly)

    @cached_property
    def weights(self) -> Array:
        """Weights (3, n_flat) of r^2, F^2 and W^2 in the error indicator (``kernels.indicator``)."""
        layout, k = self.assembly.layout, self.k
        area = np.where(k > 0, layout.area, 0.0)
        impedance = np.where(self.assembly.impedance > 0, self.assembly.impedance, 1.0)
        f_weight, w_weight = area / impedance, area * impedance
        moving = 0.0 if self.assembly.quasi_static else 1.0
        return np.stack([0.25 * (f_weight + w_weight * self.z * self.z), f_weight, moving * w_weight])

    @property
    def level(self) -> Array:
        """Tractions (n_flat,) that are negligible, Pa: a small part of what the loads can bring, along the normals."""
        level = _FLOOR * self.assembly.characteristic_traction
        return np.where(self.assembly.layout.normal, level, 0.0)

    def bind(self) -> None:
        """Condense the propagators on this direction."""
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            propagator.bind(self.k[channels[:, 0]])
        if self.assembly.quasi_static:
            self.coarse = Coarse(self.assembly, self.k)

    def incoming(self, f_hat: Array, w_hat: Array) -> Array:
        """q = F_hat + k W_hat."""
        q: Array = f_hat + self.k * w_hat
        return q

    def run_fields(self) -> dict[str, Any]:
        """Fields of the run's record."""
        fields: dict[str, Any] = {"k": self.k, "z": self.z, "weights": self.weights, "metric": self.metric}
        if self.coarse is not None and self.coarse.size:
            fields |= self.coarse.fields()
        return fields

    def group_fields(self) -> list[dict[str, Any]]:
        """Fields of the groups' records: 1/k of both sides, normal and tangential."""
        fields = []
        for group in self.assembly.layout.groups:
            both = group.block(self.z).sum(axis=0)
            fields.append({"z_sum": np.ascontiguousarray(both[:, [0, min(1, group.n_component - 1)]])})
        return fields
