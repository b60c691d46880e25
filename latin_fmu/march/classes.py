"""Table of the classes of identical substructures: sizes and addresses of all that a march reads and writes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..propagator.cholesky.factor import CholeskyFactor
from ..propagator.cholesky.kernels import routines
from ..propagator.diagonal import DiagonalFactor
from ..propagator.direct import DirectPropagator
from ..propagator.march import March
from ..propagator.resumable import Motion
from .class_row import CLASS, SCRATCH, STATE
from .lanes import LANES, SPARE, TILED, padded
from .packing import is_diagonal, lower_pattern, lower_values, rows_of
from .terms import Terms
from .views import address

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Row = dict[str, int]

_LINE = 8  # numbers in a line of the cache


class ClassTable:
    """Rows of the propagators of an assembly and the arrays behind them.

    Parameters
    ----------
    propagators : direct ones and their like (``propagator.march``), bound to their search direction.
    channels : (n_channel, m) flat indices per class.
    probes : per class the rows (n_probe, n) whose velocities are kept at each instant, or None.
    normal : (n_flat,) True where a channel is normal to its interface; left out where there are no channels.
    """

    def __init__(
        self,
        propagators: Sequence[DirectPropagator | March[Any]],
        channels: Sequence[Index],
        probes: Sequence[sp.csr_array | None],
        normal: NDArray[np.bool_] | None = None,
    ) -> None:
        self.rows = np.zeros(len(propagators), dtype=CLASS)
        self._propagators = list(propagators)
        self._normal = np.zeros(0, dtype=bool) if normal is None else normal
        self._alive: dict[int, tuple[int, Any]] = {}  # what the addresses point to
        self._begun: list[list[Any]] = [[] for _ in propagators]  # the same, of the present segment
        self._state: list[Array] = []  # (4, n, m): see STATE
        self._rest = np.zeros((len(propagators), 2), dtype=np.int64)
        self.probed: list[Array] = []
        for c, (propagator, flat, probe) in enumerate(zip(propagators, channels, probes, strict=True)):
            found = dict.fromkeys(CLASS.names, 0)  # type: ignore[arg-type]
            self._fixed(found, propagator, flat, probe)
            found["rest"] = address(self._rest[c])
            self.rows[c] = tuple(found.values())

    def _point(self, found: Row, name: str, array: NDArray[Any]) -> None:
        known = self._alive.get(id(array))
        if known is None:
            known = self._alive[id(array)] = address(array), array
        found[name] = known[0]

    def _matrix(self, found: Row, name: str, matrix: sp.csr_array | None) -> None:
        if matrix is None:
            return
        found[f"{name}_n"] = matrix.shape[0]
        self._point(found, f"{name}_starts", matrix.indptr.astype(np.int64))
        self._point(found, f"{name}_columns", matrix.indices.astype(np.uint32))
        self._point(found, f"{name}_values", np.ascontiguousarray(matrix.data, dtype=float))

    def _symmetric(
        self, found: Row, name: str, matrix: sp.csr_array | None, known: dict[int, tuple[Any, Any]]
    ) -> None:
        """Half of a symmetric matrix, all of it for several members (see ``products.add_symmetric``); ``known`` keeps
        the halves of patterns."""
        if matrix is None:
            return
        if found["m"] >= TILED:
            self._matrix(found, name, matrix)
            return
        held = known.get(id(matrix.indices))
        if held is None:
            held = known[id(matrix.indices)] = lower_pattern(matrix), matrix.indices
        lower, n = held[0], matrix.shape[0]
        values = np.empty(n + len(lower.places))
        lower_values(lower.places, lower.on_diagonal, matrix.data, values[:n], values[n:])
        found[f"{name}_n"] = n
        self._point(found, f"{name}_starts", lower.starts)
        self._point(found, f"{name}_columns", lower.columns)
        self._point(found, f"{name}_diagonal", values)
        found[f"{name}_values"] = found[f"{name}_diagonal"] + 8 * n

    def _fixed(
        self, found: Row, propagator: DirectPropagator | March[Any], flat: Index, probe: sp.csr_array | None
    ) -> None:
        """All that stays as long as step and search direction do."""
        ops = propagator.operators
        factor = ops.factor
        m = flat.shape[1]
        live = np.flatnonzero(ops.compliance.diagonal())  # the others cannot move
        sizes = {
            "n": propagator.n_dof, "m": m, "n_inner": len(ops.dofs), "n_channel": len(flat), "n_live": len(live),
            "n_massless": len(ops.massless), "n_probe": 0 if probe is None else probe.shape[0],
        }  # fmt: skip
        found.update(sizes)
        if isinstance(factor, DiagonalFactor):
            self._without_inside(found)
        else:
            assert isinstance(factor, CholeskyFactor)
            self._factor(found, factor)
        for name, array in (
            ("dofs", ops.dofs), ("area", ops.area), ("massless", ops.massless), ("live", live),
            ("k", np.ascontiguousarray(propagator.k[:, 0])), ("channels", np.ascontiguousarray(flat)),
        ):  # fmt: skip
            self._point(found, name, array)
        for name, matrix in (("mass", ops.mass), ("stiffness", ops.stiffness), ("damping", ops.damping)):
            self._symmetric(found, name, matrix, propagator.members[0].operator_pattern.forms)
        self._products(found, propagator, live, flat)
        self._matrix(found, "probe", probe)
        self._scratch(found)

    def _factor(self, found: Row, factor: CholeskyFactor) -> None:
        """What the sweeps read."""
        shape = factor.symbolic
        sizes = {
            "n_interior": shape.n_interior, "n_super": len(shape.first) - 1, "tallest": factor.tallest,
            "grouped": int(factor.grouped), "n_rows": len(shape.rows), "n_panels": factor.panels.size,
        }  # fmt: skip
        found.update(sizes)
        for name, array in (
            ("routines", routines(factor.dtype)), ("first", shape.first), ("row_start", shape.row_start),
            ("rows", shape.rows), ("panel_start", shape.panel_start), ("panels", factor.panels),
            ("order", shape.order),
        ):  # fmt: skip
            self._point(found, name, array)

    def _without_inside(self, found: Row) -> None:
        """The same where all dofs are kept for last: no supernode at all."""
        nothing = np.zeros(1, dtype=np.int64)
        for name in ("first", "row_start", "rows", "panel_start", "panels"):
            self._point(found, name, nothing)
        self._point(found, "routines", routines(np.dtype(np.float64)))
        self._point(found, "order", np.arange(found["n"]))

    def _scratch(self, found: Row) -> None:
        """One block for all that the kernels write."""
        m, n, n_channel, n_inner = found["m"], found["n"], found["n_channel"], found["n_inner"]
        lengths = dict.fromkeys(("w_free", "seen", "channel", "answer"), n_channel)
        lengths |= dict.fromkeys(("inner", "inner_answer", "free_a"), n_inner)
        sizes = {name: m * lengths.get(name, n) for name in SCRATCH}
        sizes |= {"vectors": 2 * m * found["n_live"], "answers": 2 * m * found["n_live"]}
        sizes |= {"sweep": padded(m) * n, "below": m * (found["tallest"] + 1)}
        sizes["tile"] = (max(n, n_channel) + SPARE) * LANES
        states = len(STATE) * n * m
        starts, end = places({"state": states, **sizes})
        block = np.zeros(end)
        self._point(found, STATE[0], block)
        base = found[STATE[0]]
        for i, name in enumerate(STATE):
            found[name] = base + 8 * i * n * m
        for name in sizes:
            found[name] = base + 8 * starts[name]
        self._state.append(block[:states].reshape(len(STATE), n, m))
        self.probed.append(np.zeros((0, 0, m)))

    def _products(
        self, found: Row, propagator: DirectPropagator | March[Any], live: Index, flat: Index
    ) -> None:
        """Matrices of the interface, as diagonals or tables where they are; C by its blocks between normal and between
        tangential channels, all that norms of one or the other need."""
        ops, m = propagator.operators, flat.shape[1]
        if isinstance(ops.factor, DiagonalFactor):
            found["plain_inverse"] = 1
            self._point(found, "schur_inverse", ops.factor.inverse)
        else:
            inverse, every = ops.factor.schur_inverse, np.arange(found["n_inner"])
            found["plain_inverse"] = plain = is_diagonal(inverse)
            self._point(found, "schur_inverse", rows_of(inverse, every, m, plain))
        found["plain_response"] = plain = is_diagonal(propagator.condensed) and is_diagonal(ops.compliance)
        self._point(found, "response", rows_of(propagator.condensed, live, m, plain))
        normal = self._normal[flat[live]]
        assert (normal == normal[:, :1]).all(), "identical substructures with unlike interfaces"
        blocks = [live[normal[:, 0]], live[~normal[:, 0]]]
        found["n_normal"] = len(blocks[0])
        self._point(found, "measured", np.concatenate(blocks))
        tables = [rows_of(ops.compliance, block, m, plain).ravel() for block in blocks]
        self._point(found, "compliance", np.concatenate(tables))
        if isinstance(ops.trace, np.ndarray):
            found["dense_trace"] = 1
            self._point(found, "trace_table", np.ascontiguousarray(ops.trace))
            self._point(found, "normal_table", ops.trace[blocks[0]])
            self._point(found, "spread_table", np.ascontiguousarray(ops.trace.T))
        else:
            self._matrix(found, "trace", ops.trace)
            self._matrix(found, "spread", ops.spread)

    def begin(self, n_time: int) -> None:
        """Take up the histories that the propagators have begun."""
        for c, propagator in enumerate(self._propagators):
            row, forcing = self.rows[c], propagator.forcing
            constant, terms = forcing.sums(propagator.members[0].trace)
            row["driven"] = forcing.moves or constant.any()
            held: dict[str, NDArray[Any]] = {"constant": constant}
            for name, sums in terms.items():
                row[f"{name}_n"] = len(sums.patterns)
                if not sums.patterns:
                    continue
                amplitudes = sums.amplitudes
                if propagator.scheme.explicit:  # loads act with their mean over the step
                    amplitudes = [np.concatenate([a[:1], 0.5 * (a[1:] + a[:-1])]) for a in amplitudes]
                now = Terms.of(sums.patterns, amplitudes)
                held |= {
                    f"{name}_{part}": getattr(now, part)
                    for part in ("starts", "rows", "values", "amplitudes")
                }
            held["probed"] = self.probed[c] = np.zeros((n_time, int(row["n_probe"]), int(row["m"])))
            for name, array in held.items():
                row[name] = address(array)
            self._begun[c] = list(held.values())

    def take_up(self) -> None:
        """Copy the states of the propagators in."""
        for c, (propagator, own) in enumerate(zip(self._propagators, self._state, strict=True)):
            state = propagator.state
            for into, name in zip(own, STATE, strict=True):
                into[...] = getattr(state, name)
            self._rest[c, 0] = not own.any()

    def store(self, steps: int, tractions: Sequence[Array | None]) -> None:
        """Copy the states back after so many instants (fresh arrays: states are never changed in place).

        ``tractions`` : per class those of the last instant where its energy is to be accounted for, else None.
        """
        for propagator, own, traction in zip(self._propagators, self._state, tractions, strict=True):
            propagator.take(Motion(propagator.state.instant + steps, *own.copy()), traction)


def places(sizes: Mapping[str, int]) -> tuple[dict[str, int], int]:
    """Where arrays of so many numbers go in one block, each on a line of the cache of its own, and how long it is."""
    starts, end = {}, 0
    for name, size in sizes.items():
        starts[name] = -(-end // _LINE) * _LINE
        end = starts[name] + size
    return starts, end
