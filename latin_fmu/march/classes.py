"""Table of the classes of identical substructures: sizes and addresses of all that a march reads and writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..propagator.cholesky.factor import CholeskyFactor
from ..propagator.cholesky.kernels import routines
from ..propagator.direct import DirectPropagator, State
from ..propagator.march import March
from .lanes import LANES, SPARE, TILED, padded
from .views import address, kernel, record

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_MATRICES = ("mass", "stiffness", "damping", "trace", "spread", "probe")
_TERMS = ("force", "inertia", "velocity", "displacement", "acceleration")
_STATE = ("u", "v", "a", "residual")
# scratch: name -> rows (per member)
_SCRATCH = (
    "u_free",
    "v_free",
    "load",
    "sweep",
    "inner",
    "inner_answer",
    "free_a",
    "w_free",
    "seen",
    "channel",
    "answer",
)

CLASS = record(
    [
        "n", "m", "n_inner", "n_channel", "n_live", "n_normal", "n_interior", "n_super", "n_massless", "n_probe",
        "tallest", "grouped", "driven", "routines", "first", "row_start", "rows", "panel_start", "panels", "n_rows",
        "n_panels", "order", "schur_inverse", "dofs", "area", "live", "measured", "massless", "k", "response",
        "compliance", "channels", "below", "rest", "constant", "probed", "plain_inverse", "plain_response",
        "dense_trace", "trace_table", "spread_table",
        *_STATE, *_SCRATCH, "vectors", "answers", "tile",
        *(f"{m}_{part}" for m in _MATRICES for part in ("n", "diagonal", "starts", "columns", "values")),
        *(f"{t}_{part}" for t in _TERMS for part in ("n", "starts", "rows", "values", "amplitudes")),
    ]
)  # fmt: skip
"""One row per class. ``n`` dofs, ``m`` members, ``n_inner`` interface dofs, ``n_live`` channels that can move; arrays
per dof are (n, m). Matrices are compressed rows (``starts``, ``columns``, ``values``; mass, stiffness, damping: see
``products.add_symmetric``; dense ones: see ``products.dense``; C: its block between normal channels, then that between
tangential ones, both in the order of ``measured``), terms likewise (see ``Terms``). ``rest`` is 1
while the class has not moved, and 1 where it is passed over at this instant, ``driven`` 1 where more than loads that
come and go drives it. ``plain_inverse``, ``plain_response``: the Schur inverse, Y and C by their diagonals;
``dense_trace``: trace and transpose dense."""


@dataclass(frozen=True)
class Terms:
    """Patterns times histories: sum over t of amplitudes[instant, t] x values on rows (row x members + member)."""

    starts: Index
    rows: Index
    values: Array
    amplitudes: Array

    @classmethod
    def of(cls, patterns: Sequence[tuple[Index, Array]], amplitudes: Sequence[Array], n_time: int) -> Terms:
        """From (rows, values) per term and its history (n_time,)."""
        sizes = [len(rows) for rows, _ in patterns]
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(r for r, _ in patterns)]).astype(np.int64)
        values = np.concatenate([np.zeros(0), *(v for _, v in patterns)])
        table = np.stack(amplitudes, axis=1) if amplitudes else np.zeros((n_time, 0))
        return cls(starts, rows, values, np.ascontiguousarray(table, dtype=float))


@kernel
def lower_half(
    starts: Index, columns: Index, values: Array
) -> tuple[Array, Index, NDArray[np.uint32], Array]:
    """Diagonal and strict lower triangle (compressed rows) of a symmetric matrix in compressed rows."""
    n = len(starts) - 1
    count = 0
    for i in range(n):
        for e in range(starts[i], starts[i + 1]):
            count += columns[e] < i
    diagonal, first = np.zeros(n), np.zeros(n + 1, dtype=np.int64)
    column, value = np.empty(count, dtype=np.uint32), np.empty(count)
    count = 0
    for i in range(n):
        for e in range(starts[i], starts[i + 1]):
            if columns[e] < i:
                column[count], value[count] = columns[e], values[e]
                count += 1
            elif columns[e] == i:
                diagonal[i] += values[e]
        first[i + 1] = count
    return diagonal, first, column, value


def packed_rows(matrix: Array, m: int) -> Array:
    """A symmetric matrix as ``products.dense`` wants it for m members: its lower triangle row by row, or whole."""
    if m > 1:
        return np.ascontiguousarray(matrix)
    return packed(matrix)


@kernel
def packed(matrix: Array) -> Array:
    """Lower triangle, row by row."""
    n = len(matrix)
    out, at = np.empty(n * (n + 1) // 2), 0
    for i in range(n):
        for j in range(i + 1):
            out[at + j] = matrix[i, j]
        at += i + 1
    return out


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
        self._alive: list[list[Any]] = [[] for _ in propagators]  # what the addresses point to
        self._state: list[dict[str, Array]] = []
        self._rest: list[Index] = []
        self.probed: list[Array] = []
        for c, (propagator, flat, probe) in enumerate(zip(propagators, channels, probes, strict=True)):
            self._fixed(c, propagator, flat, probe)

    def _point(self, c: int, name: str, array: NDArray[Any]) -> None:
        self._alive[c].append(array)
        self.rows[c][name] = address(array)

    def _matrix(self, c: int, name: str, matrix: sp.csr_array | None) -> None:
        if matrix is None:
            return
        self.rows[c][f"{name}_n"] = matrix.shape[0]
        self._point(c, f"{name}_starts", matrix.indptr.astype(np.int64))
        self._point(c, f"{name}_columns", matrix.indices.astype(np.uint32))
        self._point(c, f"{name}_values", np.ascontiguousarray(matrix.data, dtype=float))

    def _symmetric(self, c: int, name: str, matrix: sp.csr_array | None) -> None:
        """Half of a symmetric matrix, all of it for several members (see ``products.add_symmetric``)."""
        if matrix is None:
            return
        if self.rows[c]["m"] >= TILED:
            self._matrix(c, name, matrix)
            return
        pattern = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64)
        diagonal, starts, columns, values = lower_half(*pattern, matrix.data)
        self.rows[c][f"{name}_n"] = matrix.shape[0]
        self._point(c, f"{name}_diagonal", diagonal)
        self._point(c, f"{name}_starts", starts)
        self._point(c, f"{name}_columns", columns)
        self._point(c, f"{name}_values", values)

    def _fixed(
        self, c: int, propagator: DirectPropagator | March[Any], flat: Index, probe: sp.csr_array | None
    ) -> None:
        """All that stays as long as step and search direction do."""
        row, ops = self.rows[c], propagator.operators
        factor = ops.factor
        assert isinstance(factor, CholeskyFactor)
        shape, m = factor.symbolic, flat.shape[1]
        row["n"], row["m"], row["n_inner"], row["n_channel"] = propagator.n_dof, m, len(ops.dofs), len(flat)
        row["n_interior"], row["n_super"] = shape.n_interior, len(shape.first) - 1
        live = np.flatnonzero(ops.compliance.any(axis=1)).astype(np.int64)  # the others cannot move
        row["n_live"] = len(live)
        row["n_massless"], row["tallest"] = len(ops.massless), factor.tallest
        row["grouped"] = factor.grouped
        row["n_rows"], row["n_panels"] = len(shape.rows), factor.panels.size
        for name, array in (
            ("routines", routines(factor.dtype)), ("first", shape.first), ("row_start", shape.row_start),
            ("rows", shape.rows), ("panel_start", shape.panel_start), ("panels", factor.panels),
            ("order", shape.order),
            ("dofs", ops.dofs), ("area", ops.area), ("massless", ops.massless.astype(np.int64)),
            ("k", np.ascontiguousarray(propagator.k[:, 0])),
            ("live", live), ("channels", np.ascontiguousarray(flat)),
        ):  # fmt: skip
            self._point(c, name, array)
        for name, matrix in (("mass", ops.mass), ("stiffness", ops.stiffness), ("damping", ops.damping)):
            self._symmetric(c, name, matrix)
        self._products(c, propagator, live, flat)
        self._matrix(c, "probe", probe)
        row["n_probe"] = 0 if probe is None else probe.shape[0]
        self._point(c, "below", np.zeros((factor.tallest + 1, m)))
        for name in _SCRATCH:
            size = {"inner": row["n_inner"], "inner_answer": row["n_inner"], "free_a": row["n_inner"]}.get(
                name, row["n_channel"] if name in ("w_free", "seen", "channel", "answer") else row["n"]
            )
            self._point(c, name, np.zeros((int(size), padded(m) if name == "sweep" else m)))
        self._point(c, "tile", np.zeros((max(propagator.n_dof, len(flat)) + SPARE) * LANES))
        for name in ("vectors", "answers"):
            self._point(c, name, np.zeros((2 * m, len(live))))
        self._state.append({name: np.zeros((int(row["n"]), m)) for name in _STATE})
        self._rest.append(np.zeros(2, dtype=np.int64))
        for name in _STATE:
            self._point(c, name, self._state[c][name])
        self._point(c, "rest", self._rest[c])
        self.probed.append(np.zeros((0, 0, m)))

    def _products(self, c: int, propagator: DirectPropagator | March[Any], live: Index, flat: Index) -> None:
        """Matrices of the interface, as diagonals or tables where they are; C by its blocks between normal and between
        tangential channels, all that norms of one or the other need."""
        row, ops, m = self.rows[c], propagator.operators, flat.shape[1]
        response = propagator.response[np.ix_(live, live)] / ops.area[live]
        compliance = ops.compliance[np.ix_(live, live)]
        row["plain_inverse"] = plain = _is_diagonal(ops.factor.schur_inverse)
        self._point(c, "schur_inverse", _rows(ops.factor.schur_inverse, m, plain))
        row["plain_response"] = plain = _is_diagonal(response) and _is_diagonal(compliance)
        self._point(c, "response", _rows(response, m, plain))
        normal = self._normal[flat[live]]
        assert (normal == normal[:, :1]).all(), "identical substructures with unlike interfaces"
        blocks = [np.flatnonzero(normal[:, 0] == which) for which in (True, False)] if len(live) else []
        row["n_normal"] = len(blocks[0]) if blocks else 0
        self._point(c, "measured", np.concatenate([np.zeros(0, dtype=np.int64), *(live[b] for b in blocks)]))
        tables = [_rows(compliance[np.ix_(b, b)], m, plain).ravel() for b in blocks]
        self._point(c, "compliance", np.concatenate([np.zeros(0), *tables]))
        if isinstance(ops.trace, np.ndarray):
            row["dense_trace"] = 1
            self._point(c, "trace_table", np.ascontiguousarray(ops.trace))
            self._point(c, "spread_table", np.ascontiguousarray(ops.trace.T))
        else:
            self._matrix(c, "trace", ops.trace)
            self._matrix(c, "spread", sp.csr_array(ops.trace.T))

    def begin(self, n_time: int) -> None:
        """Take up the histories that the propagators have begun."""
        for c, propagator in enumerate(self._propagators):
            forcing = propagator.forcing
            constant, terms = forcing.sums(propagator.members[0].trace)
            self._point(c, "constant", constant)
            self.rows[c]["driven"] = forcing.moves or constant.any()
            for name, sums in terms.items():
                amplitudes = sums.amplitudes
                if propagator.scheme.explicit:  # loads act with their mean over the step
                    amplitudes = [np.concatenate([a[:1], 0.5 * (a[1:] + a[:-1])]) for a in amplitudes]
                found = Terms.of(sums.patterns, amplitudes, n_time)
                self.rows[c][f"{name}_n"] = len(found.starts) - 1
                self._point(c, f"{name}_starts", found.starts)
                self._point(c, f"{name}_rows", found.rows)
                self._point(c, f"{name}_values", found.values)
                self._point(c, f"{name}_amplitudes", found.amplitudes)
            self.probed[c] = np.zeros((n_time, int(self.rows[c]["n_probe"]), int(self.rows[c]["m"])))
            self._point(c, "probed", self.probed[c])

    def take_up(self) -> None:
        """Copy the states of the propagators in."""
        for propagator, own, rest in zip(self._propagators, self._state, self._rest, strict=True):
            for name, array in own.items():
                array[...] = getattr(propagator.state, name)
            rest[0] = not any(array.any() for array in own.values())

    def store(self, steps: int, tractions: Sequence[Array | None]) -> None:
        """Copy the states back after so many instants (fresh arrays: states are never changed in place).

        ``tractions`` : per class those of the last instant where its energy is to be accounted for, else None.
        """
        for propagator, own, traction in zip(self._propagators, self._state, tractions, strict=True):
            arrays = (own[name].copy() for name in _STATE)
            propagator.take(State(propagator.state.instant + steps, *arrays), traction)


def _is_diagonal(matrix: Array) -> bool:
    """Whether a square matrix has nothing beside its diagonal."""
    return int(np.count_nonzero(matrix)) == int(np.count_nonzero(np.diagonal(matrix)))


def _rows(matrix: Array, m: int, diagonal: bool) -> Array:
    return np.ascontiguousarray(np.diagonal(matrix)) if diagonal else packed_rows(matrix, m)
