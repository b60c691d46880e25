"""Table of the groups of interfaces, and the local stage of all of them at one instant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..interface import Behaviour
from ..propagator.cholesky.kernels import fortran
from .views import address, floats, record

Array = NDArray[np.float64]

GROUP = record(
    ["start", "n_point", "n_component", "opens", "elastic", "local", "n_parameter", "parameters", "z_sum", "gap",
     "history", "jump", "reach", "traction"]
)  # fmt: skip
"""One row per group: block (2, n_point, n_component) from ``start``, address of the behaviour's native function,
arrays per point; ``history`` (n_time, n_point) receives the gaps. ``reach``, per component where ``elastic``: rule 3 of
``interface.behaviour``."""


class GroupLike(Protocol):
    """The part of a group of interfaces that the table reads."""

    @property
    def start(self) -> int:
        """Offset in the flat vector."""

    @property
    def n_point(self) -> int:
        """Points."""

    @property
    def n_component(self) -> int:
        """Unknowns per point."""

    @property
    def parameters(self) -> Array:
        """(n_point, n_parameter)."""

    @property
    def behaviour(self) -> Behaviour:
        """Of a member."""


class GroupTable:
    """Rows of the groups and the arrays behind them.

    Parameters
    ----------
    groups : of the layout. natives : address of the native function of each. z_sums : (n_point, 2) each.
    """

    def __init__(self, groups: Sequence[GroupLike], natives: Sequence[int], z_sums: Sequence[Array]) -> None:
        self.rows = np.zeros(len(groups), dtype=GROUP)
        self.gaps = [np.zeros(g.n_point) for g in groups]
        self.reaches = [np.zeros((g.n_point, g.n_component if g.behaviour.elastic else 1)) for g in groups]
        self._alive: list[list[Any]] = []
        for row, group, native, z_sum, gap, reach in zip(
            self.rows, groups, natives, z_sums, self.gaps, self.reaches, strict=True
        ):
            row["elastic"] = group.behaviour.elastic
            row["start"], row["n_point"], row["n_component"] = group.start, group.n_point, group.n_component
            row["local"], row["n_parameter"] = native, group.parameters.shape[1]
            block = np.zeros((group.n_point, group.n_component))
            arrays = {
                "parameters": np.ascontiguousarray(group.parameters), "z_sum": np.ascontiguousarray(z_sum), "gap": gap,
                "jump": block, "traction": np.zeros_like(block), "reach": reach,
            }  # fmt: skip
            for name, array in arrays.items():
                row[name] = address(array)
            self._alive.append(list(arrays.values()))

    def begin(self, histories: Sequence[Array | None]) -> None:
        """Where the gaps go, (n_time, n_point) per group; None where nothing can open."""
        self._histories = list(histories)
        for row, history in zip(self.rows, histories, strict=True):
            row["opens"] = history is not None
            row["history"] = 0 if history is None else address(history)


@kernel
def local_stage(groups: Any, scheme: Any, s: Array, z: Array, f_hat: Array, w_hat: Array) -> None:
    """F_hat and W_hat (n_flat,) of all groups from s; twin of ``LocalStage.instant``."""
    for g in range(len(groups)):
        row = groups[g]
        n_point, n_component = row.n_point, row.n_component
        size = n_point * n_component
        jump, traction = floats(row.jump, size), floats(row.traction, size)
        first, second = row.start, row.start + size
        for i in range(size):
            jump[i] = s[second + i] - s[first + i]
        rate = scheme.layer_rate
        if row.elastic == 0:
            rate = 1 / scheme.dt
            gap, reach = floats(row.gap, n_point), floats(row.reach, n_point)
            for p in range(n_point):
                reach[p] = max(gap[p], 0.0) * rate
        fortran(
            row.local,
            (n_point, n_component, row.n_parameter, rate, jump.ctypes.data, floats(row.z_sum, 2).ctypes.data,
             floats(row.reach, 1).ctypes.data, floats(row.parameters, 1).ctypes.data, traction.ctypes.data),
        )  # fmt: skip
        for i in range(size):
            f_hat[first + i] = traction[i]
            f_hat[second + i] = -traction[i]
            w_hat[first + i] = s[first + i] + z[first + i] * traction[i]
            w_hat[second + i] = s[second + i] - z[second + i] * traction[i]


@kernel
def read_gaps(groups: Any, start: Any, displacement: Array, instant: int) -> None:
    """Gaps from the displacements (n_flat,) of the channels and the gaps ``start`` (all points) of t = 0, kept."""
    at = 0
    for g in range(len(groups)):
        row = groups[g]
        n_point, n_component = row.n_point, row.n_component
        gap = floats(row.gap, n_point)
        second = row.start + n_point * n_component
        for p in range(n_point):
            gap[p] = (
                start[at + p]
                + displacement[second + p * n_component]
                - displacement[row.start + p * n_component]
            )
        if row.opens == 1:
            history = floats(row.history + 8 * n_point * instant, n_point)
            for p in range(n_point):
                history[p] = gap[p]
        at += n_point


@kernel
def read_reach(groups: Any, start: Any, seen: Array, rate: float) -> None:
    """``reach`` of the elastic groups at the next instant from the displacements ``seen`` (n_flat,) by layers."""
    at = 0
    for g in range(len(groups)):
        row = groups[g]
        n_point, n_component = row.n_point, row.n_component
        if row.elastic == 1:
            size = n_point * n_component
            reach = floats(row.reach, size)
            for i in range(size):
                reach[i] = rate * (seen[row.start + size + i] - seen[row.start + i])
            for p in range(n_point):
                reach[p * n_component] += rate * start[at + p]
        at += n_point
