"""The record of a class of identical substructures, and its arrays in the blocks of memory (``kernels.records``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cholesky.factor import CholeskyFactor, DiagonalFactor, LowRankFactor
from ..cholesky.pieces import pieces, row_parts
from ..cholesky.substitution import TILED
from ..kernels.products import lower_count, lower_pattern, lower_values, pack_triangle
from ..kernels.records import DIRECT, EXPLICIT, STATIC
from ..kernels.sparse_response import TABLES
from ..kernels.team import LINE, PARTS
from .forcing import SUMS, Sum
from .model import Array, Index, geometric_part, unrelaxed_part
from .patches import EXACT, OF_INVERSE, OF_RESPONSE, Patches, in_patches

Row = dict[str, int]
Halves = dict[int, tuple[int, int, int, int]]
"""Places of the row starts, columns and rows together of lower triangles and their numbers of entries, by the ``id`` of
the column indices of the whole matrix, which is kept as long."""
_NONE = np.zeros(1, dtype=np.int64)
_LARGE = 1000  # channels from which on a triangle of their table is larger than the cache of a core
_NO_TERMS = MappingProxyType({f"{name}_terms": 0 for name in SUMS})


class BlockLayout:
    """Positions of arrays in a block of float64 numbers; the same array put in twice before ``fill`` takes one place.

    Parameters
    ----------
    start : position of the first number.

    Attributes
    ----------
    size : position behind the last number used.
    """

    def __init__(self, start: int = 0) -> None:
        self.size = start
        self._positions: dict[int, tuple[int, Any]] = {}  # position by identity; the arrays are kept alive
        self._arrays: list[tuple[int, NDArray[Any]]] = []  # position in numbers of its kind, array
        self._waiting: list[Callable[[Array], None]] = []

    def reserve(self, size: int, owner: Any = None) -> int:
        """Position of ``size`` numbers, on a line of the cache; the same one each time for the same ``owner``."""
        entry = self._positions.get(id(owner))
        if entry is not None:
            return entry[0]
        at = self.size
        # up to a whole line of the cache: threads that write to neighbouring arrays share none
        self.size = at + -(-size // LINE) * LINE
        if owner is not None:
            self._positions[id(owner)] = at, owner
        return at

    def put(self, array: NDArray[Any], kind: type[np.generic] = np.float64) -> int:
        """Position of an array, in numbers of ``kind`` (float64, int64, uint32, float32)."""
        entry = self._positions.get(id(array))
        if entry is not None:
            return entry[0]
        packed = np.ascontiguousarray(array, dtype=kind).reshape(-1)
        position = self.reserve(-(-packed.nbytes // 8)) * (8 // packed.itemsize)  # a position in numbers of its kind
        self._arrays.append((position, packed))
        self._positions[id(array)] = position, array
        return position

    def fill_later(self, write: Callable[[Array], None]) -> None:
        """Let ``fill`` call ``write`` with the block itself, to write to positions that are reserved."""
        self._waiting.append(write)

    def fill(self, target: Array) -> None:
        """Write what was put in since the last time into the block itself; the arrays are no longer kept, each from
        when it is written on: a large factor and its copy are not there beside all others."""
        self._positions.clear()
        while self._arrays:
            position, array = self._arrays.pop()
            target.view(array.dtype)[position : position + array.size] = array
        while self._waiting:
            self._waiting.pop()(target)


def _copy(at: int, packed: NDArray[Any], target: Array) -> None:
    target[at : at + -(-packed.nbytes // 8)].view(packed.dtype)[: packed.size] = packed


def put_matrix(block: BlockLayout, row: Row, name: str, matrix: sp.csr_array | None) -> None:
    """A matrix in compressed rows."""
    if matrix is None or matrix.shape[0] == 0:
        return
    row[f"{name}_rows"] = int(matrix.shape[0])
    row[f"{name}_starts"] = block.put(matrix.indptr, np.int64)
    row[f"{name}_columns"] = block.put(matrix.indices, np.uint32)
    row[f"{name}_values"] = block.put(matrix.data)


def put_symmetric(block: BlockLayout, row: Row, name: str, matrix: sp.csr_array | None, halves: Halves) -> None:
    """A symmetric matrix (n, n), no entry twice: its diagonal and strict lower triangle, all of it where members are
    taken eight at a time."""
    if matrix is None:
        return
    if row["n_piece"]:
        row[f"{name}_parts"] = block.put(row_parts(matrix, PARTS), np.int64)
    if row["m"] >= TILED:
        put_matrix(block, row, name, matrix)
        return
    n, pattern = matrix.shape[0], (matrix.indptr, matrix.indices)
    half = halves.get(id(matrix.indices))
    if half is None:
        count = lower_count(*pattern)
        # columns and counts are of 32 bits: two in one number
        places = block.reserve(n + 1), block.reserve(-(-count // 2)), block.reserve(-(-n // 2))
        half = halves[id(matrix.indices)] = *places, count
        block.fill_later(partial(_fill_pattern, pattern, n, half))
    starts, columns, together, count = half
    values, diagonal = block.reserve(count), block.reserve(n)
    block.fill_later(
        lambda data: lower_values(*pattern, matrix.data, data[values : values + count], data[diagonal : diagonal + n])
    )
    # places in numbers of 32 bits
    row[f"{name}_rows"] = n
    row[f"{name}_starts"] = starts
    row[f"{name}_columns"] = 2 * columns
    row[f"{name}_values"] = values
    row[f"{name}_diagonal"] = diagonal
    row[f"{name}_together"] = 2 * together


def _fill_pattern(pattern: tuple[Any, Any], n: int, half: tuple[int, int, int, int], data: Array) -> None:
    starts, columns, together, count = half
    short = data.view(np.uint32)
    lower = short[2 * columns : 2 * columns + count], short[2 * together : 2 * together + n]
    lower_pattern(*pattern, data[starts : starts + n + 1].view(np.int64), *lower)


def put_terms(block: BlockLayout, sums: Sum) -> Row:
    """Patterns times histories: sum over t of amplitudes[instant, t] x values on rows (row x members + member)."""
    if not sums.patterns:
        return {"terms": 0}
    starts, rows, values = sums.packed
    return {
        "terms": len(sums.patterns),
        "starts": block.put(starts, np.int64),
        "rows": block.put(rows, np.int64),
        "values": block.put(values),
        "amplitudes": block.put(np.stack(sums.amplitudes, axis=1)),
    }


def is_diagonal(matrix: Array) -> bool:
    """Whether a square matrix has nothing beside its diagonal."""
    # the first row is enough for most full matrices
    if np.count_nonzero(matrix[:1, 1:]):
        return False
    return not np.count_nonzero(matrix) > np.count_nonzero(matrix.diagonal())


def put_dense(
    block: BlockLayout, matrix: Array, parts: Sequence[Index], m: int, diagonal: bool, single: bool = False
) -> int:
    """Picked rows and columns of a symmetric matrix, part after part, as ``products.product`` reads them for m members:
    the diagonal alone, the lower triangle row by row, or whole; ``single``: such a triangle as float32."""
    if diagonal:
        return block.put(np.concatenate([np.diagonal(matrix)[picked] for picked in parts]))
    if m >= TILED:
        return block.put(np.concatenate([matrix[np.ix_(picked, picked)].ravel() for picked in parts]))
    matrix = np.ascontiguousarray(matrix)
    sizes = [len(picked) * (len(picked) + 1) // 2 for picked in parts]
    kind: type[np.floating] = np.float64
    numbers = 1
    if single:
        kind, numbers = np.float32, 2
    # a place in numbers of its kind
    first = at = numbers * block.reserve(-(-sum(sizes) // numbers))
    for picked, size in zip(parts, sizes, strict=True):
        # bound now: a lambda would see the last turn of the loop
        block.fill_later(partial(_fill_triangle, matrix, picked, slice(at, at + size), kind))
        at += size
    return first


def _halves(n: int, row: Row) -> bool:
    """Whether a dense table (n, n) of a class is so large that reading it is the cost of a product, and may be kept in
    single precision: of a lower triangle alone."""
    return row["m"] == 1 and row["kind"] == DIRECT and row["plain_response"] == 0 and n >= _LARGE


def _fill_triangle(matrix: Array, picked: Index, part: slice, kind: type[np.generic], data: Array) -> None:
    pack_triangle(matrix, picked, data.view(kind)[part])


def constants(
    block: BlockLayout,
    propagator: Any,
    flat: Index,
    probe: sp.csr_array | None,
    sensor: sp.csr_array | None,
    normal: NDArray[np.bool_],
    halves: Halves,
) -> Row:
    """Sizes of a class and the arrays that are constant for a time step, put into the fixed block.

    Parameters
    ----------
    propagator : of the class. flat : (n_channel, m) places of its channels. probe : (n_probe, n) rows whose velocities
    are kept, or None. sensor : (n_sensor, n) rows whose motions are kept, or None. normal : (n_flat,) True where a
    channel is normal to its interface. halves : patterns that are in the block already.
    """
    ops = propagator.operators
    live = np.flatnonzero(ops.compliance.diagonal())  # the others cannot move
    motions = propagator.members[0].imposed_pattern.shape[1]
    row: Row = {
        "n": propagator.n_dof,
        "m": flat.shape[1],
        "n_inner": len(ops.dofs),
        "n_channel": len(flat),
        "n_live": len(live),
        "n_massless": len(ops.massless),
        "n_probe": 0 if probe is None else int(probe.shape[0]),
        "n_sensor": 0 if sensor is None else int(sensor.shape[0]),
        "n_motion": motions,
        "n_branch": len(propagator.branches),
        "n_sensed": propagator.n_sensed,
        "kind": _kind(propagator.scheme),
        "accounted": int(propagator.energy),
        "loads_only": int(propagator.loads_only),
    }
    _factor(block, row, ops.factor)
    row["dofs"], row["area"] = block.put(ops.dofs, np.int64), block.put(ops.area)
    row["massless"], row["live"] = block.put(ops.massless, np.int64), block.put(live, np.int64)
    row["channels"] = block.put(np.ascontiguousarray(flat), np.int64)
    _put_matrices(block, row, propagator, halves)
    face = propagator.members[0].face
    if row["n_modal"] or (face is not None and ops.modal is not None):
        row["n_viscous"], row["viscous_rows"] = len(ops.modal), block.put(ops.modal)
    if face is not None:
        row["n_elastic"], row["elastic_rows"] = len(face.rows), block.put(face.rows)
        row["n_inertial"] = face.n_inertial
        row |= {"on_face": 1, "face_viscosity": block.put(np.array([face.viscosity])), "n_relaxing": len(face.branches)}
        row["relaxing"] = block.put(face.branches.weights(propagator.scheme, propagator.dt))
        row["relaxing_shares"] = block.put(np.append(face.row_shares, face.share))
    row["branches"] = block.put(propagator.branches.weights(propagator.scheme, propagator.dt))
    put_matrix(block, row, "probe", probe)
    if sensor is not None:
        # long rows are read by their first and last column (``kernels.products.read_long_rows``)
        sensor.sum_duplicates()
    put_matrix(block, row, "sensor", sensor)
    if propagator.energy:
        _borders(block, row, propagator)
    is_normal = normal[flat]
    assert (is_normal == is_normal[:, :1]).all(), "identical substructures with unlike interfaces"
    if propagator.swept:
        _swept_interface(block, row, propagator, is_normal[:, 0])
    else:
        _dense_interface(block, row, propagator, live, is_normal[:, 0])
    return row


def _kind(scheme: Any) -> int:
    """Number of the march of a scheme in the kernels."""
    if scheme.name == "quasi_static":
        return STATIC
    if scheme.explicit:
        return EXPLICIT
    return DIRECT


def _put_matrices(block: BlockLayout, row: Row, propagator: Any, halves: Halves) -> None:
    """Mass, stiffness and damping of a class, as far as its march reads them."""
    ops = propagator.operators
    # rows of a node taken together pay where half of the matrix is read, and not by pieces
    if row["m"] < TILED and row["n_piece"] == 0:
        stiffness = propagator.members[0].stiffness_by_nodes
    else:
        stiffness = ops.stiffness
    # without inertia neither mass nor damping is read
    matrices = {"mass": None, "stiffness": stiffness, "damping": None, "unrelaxed": None}
    if _kind(propagator.scheme) != STATIC:
        unrelaxed = unrelaxed_part(propagator.members[0])
        matrices |= {"mass": ops.mass, "damping": ops.damping, "unrelaxed": unrelaxed}
    if propagator.energy:
        matrices["geometric"] = geometric_part(propagator.members[0])
    for name, matrix in matrices.items():
        put_symmetric(block, row, name, matrix, halves)


def _swept_interface(block: BlockLayout, row: Row, propagator: Any, is_normal: NDArray[np.bool_]) -> None:
    """Places of the interface dofs in the factor, and traces, of a class that is solved with by substitution."""
    ops, shape = propagator.operators, propagator.operators.factor.symbolic
    row |= {"swept": 1, "face_start": block.put(shape.face_start, np.int64)}
    row["face"] = block.put(shape.position[ops.dofs], np.int64)
    row["component"] = block.put((~is_normal).astype(np.int64), np.int64)
    _put_traces(block, row, ops)


def _dense_interface(block: BlockLayout, row: Row, propagator: Any, live: Index, is_normal: NDArray[np.bool_]) -> None:
    """Dense matrices of the interfaces of a class, and traces."""
    ops, m = propagator.operators, row["m"]
    if row.get("on_face"):
        _patched_interface(block, row, ops, live, is_normal)
        return
    if row["kind"] != STATIC:
        factor = ops.factor
        if isinstance(factor, DiagonalFactor):
            inverse = factor.inverse
        else:
            inverse = factor.schur_inverse
        row["plain_inverse"] = plain = int(inverse.ndim == 1 or is_diagonal(inverse))
        every = np.arange(row["n_inner"])
        if inverse.ndim == 1:
            row["schur_inverse"] = block.put(inverse)
        else:
            row["schur_inverse"] = put_dense(block, inverse, [every], m, bool(plain))
    row["plain_response"] = plain = int(is_diagonal(propagator.condensed) and is_diagonal(ops.compliance))
    # normal channels first: both kinds have a norm of their own in the force residual
    blocks = [live[is_normal[live]], live[~is_normal[live]]]
    row["n_normal"] = len(blocks[0])
    row["measured"] = block.put(np.concatenate(blocks), np.int64)
    single = _halves(len(live), row)
    row["halved_norms"] = int(single)
    row["compliance"] = put_dense(block, ops.compliance, blocks, m, bool(plain), single)
    if isinstance(ops.trace, np.ndarray):
        row["dense_trace"] = 1
        row["trace_table"], row["spread_table"] = (block.put(ops.trace), block.put(np.ascontiguousarray(ops.trace.T)))
        row["normal_table"] = block.put(ops.trace[blocks[0]])
    else:
        _put_traces(block, row, ops)


def _patched_interface(block: BlockLayout, row: Row, ops: Any, live: Index, is_normal: NDArray[np.bool_]) -> None:
    """S^-1, of which C is a multiple, in patches, and traces."""
    patches = in_patches(ops.factor.schur_inverse, ops.face.patches, OF_INVERSE, np.float32)
    row |= {"patched": 1, "halved_norms": 1}
    row["inverse_header"] = block.put(patches.header, np.int64)
    row["schur_inverse"] = block.put(patches.numbers, np.float32)
    normal_first = np.argsort(~is_normal[live], kind="stable")
    row["n_normal"] = int(is_normal[live].sum())
    row["measured"], row["measured_place"] = (block.put(x, np.int64) for x in (live[normal_first], normal_first))
    _put_traces(block, row, ops)


def _put_traces(block: BlockLayout, row: Row, ops: Any) -> None:
    """Sparse traces from interface dofs to channels and back."""
    put_matrix(block, row, "trace", ops.trace)
    put_matrix(block, row, "spread", ops.spread)
    # a class without channels: kernels slice the row starts all the same
    row.setdefault("trace_starts", block.put(np.zeros(row["n_channel"] + 1, dtype=np.int64), np.int64))
    row.setdefault("spread_starts", block.put(np.zeros(row["n_inner"] + 1, dtype=np.int64), np.int64))


def _factor(block: BlockLayout, row: Row, factor: Any) -> None:
    """Arrays of the substitutions; a diagonal matrix has all dofs on the interface and no supernode."""
    row["factored"] = 1
    row["n_piece"] = 0
    row["n_modal"] = 0
    if isinstance(factor, LowRankFactor):
        row["n_modal"] = len(factor.inside)
        row["modal_inside"], row["modal_edge"] = block.put(factor.inside), block.put(factor.edge)
        factor = factor.base
    if isinstance(factor, CholeskyFactor):
        shape = factor.symbolic
        row |= {
            "n_interior": shape.n_interior,
            "n_super": len(shape.first) - 1,
            "grouped": int(factor.grouped),
            "n_rows": len(shape.rows),
            "n_panels": factor.panels.size,
            "single": int(factor.dtype == np.float32),
        }
        for name, array in (
            ("first", shape.first),
            ("row_start", shape.row_start),
            ("rows", shape.rows),
            ("panel_start", shape.panel_start),
            ("order", shape.order),
        ):
            row[name] = block.put(array, np.int64)
        row["n_piece"], row["n_level"], table = pieces(shape)
        row["pieces"] = block.put(table, np.int64)
        numbers = 8 // factor.dtype.itemsize  # in one of float64
        # reserved for the factor itself: ``move_panels`` copies them there, and it reads them there
        row["panels"] = numbers * block.reserve(-(-factor.panels.size // numbers), factor)
        return
    row["factored"] = int(isinstance(factor, DiagonalFactor))
    for name in ("first", "row_start", "rows", "panel_start"):
        row[name] = block.put(_NONE, np.int64)
    row["order"] = block.put(np.arange(row["n"]), np.int64)


def move_panels(fixed: Array, row: Row, factor: Any) -> None:
    """Let a factor keep its panels in their place in the fixed block, ``fixed``, and nowhere else."""
    if isinstance(factor, LowRankFactor):
        factor = factor.base
    if isinstance(factor, CholeskyFactor):
        factor.keep_in(fixed.view(factor.dtype)[row["panels"] : row["panels"] + row["n_panels"]])


def _borders(block: BlockLayout, row: Row, propagator: Any) -> None:
    """Matrices between prescribed motions and dofs, for the account of energies; the lumped damping."""
    model = propagator.members[0]
    dashpots = propagator.dashpots
    p, shapes = model.expansion, model.imposed_pattern
    if dashpots is not None:
        reduced = sp.csr_array(p.T @ dashpots @ p)
        put_symmetric(block, row, "dashpots", reduced, {})
    landing = model.landing
    if landing is not None:
        reduced, damped = model.reduced_landing
        row["damped"] = int(damped or row.get("n_viscous", 0) > 0)
        put_symmetric(block, row, "landing", reduced, {})
    if not row["n_motion"]:
        return
    matrices = {"mass": model.mass, "stiffness": model.stiffness, "damping": model.damping, "dashpots": dashpots}
    matrices |= {"landing": landing, "unrelaxed": model.unrelaxed if len(model.branches) else None}
    matrices["geometric"] = model.geometric
    for name, matrix in matrices.items():
        if matrix is None:
            # a matrix without entries, so that the energies read rows of every kind
            matrix = sp.csr_array((model.n_full, model.n_full))
        # rows of the motions: with the dofs, then among themselves
        with_dofs = sp.csr_array(shapes.T @ (matrix @ p))
        border = sp.csr_array(sp.hstack([with_dofs, sp.csr_array(shapes.T @ (matrix @ shapes))]))
        if name == "damping" and model.modal_rows is not None:
            moved = model.modal_rows @ shapes
            border = sp.csr_array(border + moved.T @ np.hstack([model.modal_rows @ p, moved]))
        put_matrix(block, row, f"border_{name}", border)


def direction(block: BlockLayout, propagator: Any, constant: Row, run: Row) -> Row:
    """Search direction and responses of a class with constants, put into the fixed block; ``run`` : its fields."""
    m, row = constant["m"], {}
    # channels that can move at all
    live = np.flatnonzero(propagator.operators.compliance.diagonal())
    row["k"] = block.put(propagator.k[:, 0].copy())
    row |= {"sparse": int("y" in propagator.tables), **dict.fromkeys((f"{name}_points" for name in TABLES), 0)}
    for name, table in propagator.tables.items():
        row |= table.fields(name, block.put)
    if row["sparse"]:
        propagator.release()
        return row
    if propagator.swept:
        factor = propagator.condensed
        if factor is propagator.operators.factor:  # made on these springs: read where it is
            return row | {"k_panels": constant["panels"], "single": int(factor.dtype == np.float32)}
        numbers = 8 // factor.dtype.itemsize
        at = block.reserve(-(-factor.panels.size // numbers))
        # a copy, since the factor is dropped
        block.fill_later(partial(_copy, at, factor.panels))
        # counted in single numbers of the block
        row["k_panels"] = numbers * at
        row["single"] = 0
        if numbers != 1:
            row["single"] = 1 + int(propagator.operators.factor.dtype == np.float64)
        propagator.release()
        return row
    if constant.get("patched"):
        patches = in_response_patches(propagator, live)
        propagator.release()  # dense: the patches have it
        row["halved"] = int(propagator.single)
        row["response_header"] = block.put(patches.header, np.int64)
        row["response"] = block.put(patches.numbers, patches.numbers.dtype.type)
        return row
    single = propagator.single and _halves(len(live), constant)
    row["halved"] = int(single)
    row["response"] = put_dense(block, propagator.condensed, [live], m, bool(constant["plain_response"]), single)
    if run.get("newton") and constant["kind"] != STATIC:
        compliance = propagator.operators.compliance
        row["admittance"] = put_dense(block, compliance, [live], m, bool(constant["plain_response"]))
    if constant["kind"] == STATIC:
        every = np.arange(constant["n_inner"])
        row["spring_inverse"] = put_dense(block, propagator.spring_inverse, [every], m, False)
    return row


def in_response_patches(propagator: Any, live: Index) -> Patches:
    """Y of a class in patches."""
    response, patches = propagator.condensed[np.ix_(live, live)], propagator.operators.face.patches
    if propagator.single:
        return in_patches(response, patches, OF_RESPONSE, np.float32)
    return in_patches(response, patches, EXACT, np.float64)


def histories(block: BlockLayout, constant: Row, propagator: Any) -> Row:
    """Loads and prescribed motions of the class with the constants ``constant`` over a segment of time."""
    forcing = propagator.forcing
    force, terms = forcing.sums(propagator.members[0].trace, propagator.dashpots)
    assert force.shape == (constant["n"], constant["m"])
    driven = constant["kind"] == STATIC or forcing.moves or bool(force.any())
    row: Row = {"driven": int(driven), "constant": block.put(force)}
    row |= _NO_TERMS
    placed: dict[int, Row] = {}
    for name, sums in terms.items():
        # loads alone: "force" and "work" are the same sum, and take one place
        if id(sums) in placed:
            fields = placed[id(sums)]
        else:
            fields = placed.setdefault(id(sums), put_terms(block, sums))
        row |= {f"{name}_{field}": value for field, value in fields.items()}
    row["work_loads"] = row["constant"]
    if constant["n_motion"]:
        row["motions"] = block.put(forcing.motion_table())
    return row


def grown(data: Array, size: int) -> Array:
    """The block with room for ``size`` numbers: itself where it has it, else a copy that has, zeros behind it."""
    if size <= len(data):
        return data
    larger = np.zeros(size)
    larger[: len(data)] = data
    return larger
