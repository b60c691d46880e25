"""Tables of compliances of large interfaces for short steps: exact columns of all points by a few solutions (probing).

Within a step a force on a point of an interface moves the points around it only. With R the distance beyond which the
blocks of a compliance are below a share ``truncation`` of its largest entry, points further than 2 R apart move no
point in common. Forces on all points of one colour, of which no two are closer than that, act at once: the velocities
at a point within R of one of them are a block of the compliance. The number of colours depends on R alone, not on the
number of points. Distances are straight ones, no longer than the way of a wave through the mesh, so that faces may have
any shape, and several faces of a body may be near each other.

R comes from exact columns of points in the middle and at the ends of every face. Blocks are averaged with their
transposes, dropped below the truncation, and kept as float32. One solution with random forces verifies a table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..kernels.sparse_response import multiply
from .interface_matrices import STILL
from .interface_sweeps import applied
from .model import Array, Index

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_OF_NORMS = (
    ("normal", slice(0, 1), 1e-3),
    ("tangential", slice(1, None), 1e-2),
)  # truncation of the compliances of the force residual
_NORM_ERROR = 0.1  # of sqrt(x C x), above which the force residual is computed by substitution
_ERROR = 10.0  # of the product with random forces, in truncations, above which there is no table
SHARE: Final = 0.15
"""Share of all blocks above which a table costs as much as substitution."""
ROUGH: Final = 1e-5
"""Tolerance from which on the iteration may take factors in single precision, and tables."""
_OF_TOLERANCE = 0.1  # truncation of tables of Y
_COLUMNS = 72  # of right-hand sides at a time
_SEED = 19


@dataclass(frozen=True)
class Points:
    """Points of the interfaces of a substructure.

    Attributes
    ----------
    positions : (n_point, 3), m. channels : (n_point, h) channel of each component, the normal one first, -1 where there
    is none. faces : (n_point,) number of the face of each point.
    """

    positions: Array
    channels: Index
    faces: Index

    def of(self, components: slice, moving: NDArray[np.bool_]) -> Points:
        """These points with some of the components, and with channels that can move only."""
        channels = self.channels[:, components]
        # -1 reads the last channel, and is masked
        channels = np.where((channels >= 0) & moving[channels], channels, -1)
        # without components at the end that no point has
        channels = channels[:, : 1 + np.flatnonzero((channels >= 0).any(axis=0)).max(initial=0)]
        mask = (channels >= 0).any(axis=1)
        return Points(self.positions[mask], channels[mask], self.faces[mask])

    def in_rows(self) -> Points:
        """These points in an order in which neighbours follow each other, as rows of a table are read."""
        if len(self.positions) < 2:
            return self
        from scipy.spatial import cKDTree  # a tenth of a second to load, and dense interfaces do without

        nearest = np.asarray(cKDTree(self.positions).query(self.positions, 2)[0])[:, 1]
        # 1.0 where points coincide
        spacing = float(np.median(nearest)) or 1.0
        x, y, z = (self.positions / spacing).T
        # the last key first: by face, then by lines along x
        order = np.lexsort((x, np.rint(y), np.rint(z), self.faces))
        return Points(self.positions[order], self.channels[order], self.faces[order])

    def picked(self) -> Index:
        """A point in the middle of each face, two at its ends, and one between."""
        picked: list[int] = []
        for face in np.unique(self.faces):
            points = np.flatnonzero(self.faces == face)
            x = self.positions[points]
            middle = x.mean(axis=0)
            end = x[np.argmax(np.linalg.norm(x - middle, axis=1))]
            other = x[np.argmax(np.linalg.norm(x - end, axis=1))]
            between = 0.6 * middle + 0.4 * end
            picked += [points[np.argmin(np.linalg.norm(x - p, axis=1))] for p in (middle, end, other, between)]
        return np.unique(picked)


@dataclass(frozen=True)
class Table:
    """A compliance as the kernels multiply by it, see ``kernels.sparse_response``; without the gain of the scheme.

    Attributes
    ----------
    width : components per point. places : (n_point, width). starts : (n_point + 1,). runs : (n_run, 2). values :
    float32. radius : m. truncation : share of the largest entry. share : of all blocks that are kept.
    """

    width: int
    places: Index
    starts: Index
    runs: Index
    values: NDArray[np.float32]
    radius: float
    truncation: float
    share: float

    def fields(self, name: str, put: Callable[..., int]) -> dict[str, int]:
        """Fields of the record of a class; ``put`` : arrays into a block."""
        record = {"points": len(self.starts) - 1, "width": self.width, "entries": len(self.values)}
        record |= {part: put(getattr(self, part), np.int64) for part in ("places", "starts", "runs")}
        record["values"] = put(self.values, np.float32)
        return {f"{name}_{field}": value for field, value in record.items()}


def interface_tables(propagator: Any, points: Points, truncation: float, largest: float) -> dict[str, Table]:
    """Tables of a swept class by their names in ``kernels.sparse_response``; what costs more than substitution, or is
    not accurate enough, is left out.

    Parameters
    ----------
    propagator : of the class, bound to the search direction. points : of its interfaces. truncation, largest : of Y,
    and the largest share of its blocks that may be kept; 0 where no table of it is wanted.
    """
    ops, tables = propagator.operators, dict[str, Table]()
    diagonal = ops.compliance.diagonal()
    moving, points = diagonal > STILL * diagonal.max(initial=0.0), points.in_rows()
    solve = partial(applied, ops.factor, ops.trace, 1.0)
    for name, components, rough in _OF_NORMS:
        part = points.of(components, moving)
        if len(part.channels):
            table = _probed(solve, part, len(moving), rough, SHARE)
            if table is None or not _equal_norms(table, solve, part, len(moving)):
                # both or none: a force residual takes its two parts from one kind of operator
                tables.clear()
                break
            tables[name] = table
    # both are positive
    if truncation > 0.0 < largest:
        solve = partial(applied, propagator.condensed, ops.trace, 1.0)
        part = points.of(slice(None), moving)
        table = _probed(solve, part, len(moving), truncation, largest)
        if table is not None and _accurate(table, solve, part, len(moving)):
            tables["y"] = table
            # in the place of the factor
            propagator.release()
    return tables


def truncation_of(tolerance: float) -> float:
    """Share of the largest entry below which tables of Y are truncated; 0 where there are none, as single precision is
    not enough."""
    if tolerance >= ROUGH:
        return _OF_TOLERANCE * tolerance
    return 0.0


def _probed(
    solve: Callable[[Array], Array], points: Points, n_channel: int, truncation: float, most: float
) -> Table | None:
    """Table of a compliance; None where it holds more than a share ``most`` of the blocks.

    solve : velocities (n_channel, m) of forces on the channels.
    """
    from scipy.spatial import cKDTree

    columns = _Columns(solve, points, n_channel)
    picked = points.picked()
    sizes = columns.sizes(picked)
    largest = float(sizes.max(initial=0.0))
    apart = np.linalg.norm(points.positions[:, None] - points.positions[picked], axis=2)
    # a little more, so that round-off of distances does not leave out the farthest one
    radius = 1.0001 * float(apart[sizes > truncation * largest].max(initial=0.0))
    tree = cKDTree(points.positions)
    # ordered pairs, each point with itself among them
    within = float(tree.count_neighbors(tree, radius)) / len(points.positions) ** 2
    if within > 2.0 * most:  # about half of them are below the truncation
        return None
    # i < j: each pair once, and the diagonal in front
    pairs = tree.query_pairs(radius, output_type="ndarray")
    every = np.arange(len(points.positions))
    i, j = np.concatenate([every, pairs[:, 0]]), np.concatenate([every, pairs[:, 1]])
    blocks = columns.blocks(i, j, coloured(tree, points.positions, 2.0 * radius))
    pattern = np.abs(blocks).max(axis=(1, 2)) > truncation * largest
    share = float((2 * pattern.sum() - pattern[: len(every)].sum()) / len(every) ** 2)
    if share > most:
        return None
    return _in_runs(points, i[pattern], j[pattern], blocks[pattern], (radius, truncation, share))


class _Columns:
    """Columns of a compliance between the components of points."""

    def __init__(self, solve: Callable[[Array], Array], points: Points, n_channel: int) -> None:
        self._solve, self._n = solve, n_channel
        self._channels = points.channels
        self._rows = np.where(points.channels >= 0, points.channels, n_channel)  # of zeros

    def _velocities(self, groups: Index, count: int) -> Array:
        """Velocities (n_point, h, count, h) of unit forces on the components of the points of each group, -1: none."""
        width = self._channels.shape[1]
        forces = np.zeros((self._n + 1, count, width))
        on = groups >= 0
        for e in range(width):
            # row n takes what has no channel, and is cut off
            forces[self._rows[on, e], groups[on], e] = 1.0
        velocities = np.zeros((self._n + 1, count * width))
        velocities[:-1] = self._solve(forces[:-1].reshape(self._n, -1))
        return velocities[self._rows].reshape(*self._rows.shape, count, width)

    def sizes(self, picked: Index) -> Array:
        """Largest entries (n_point, n_picked) of the blocks of the columns of some points."""
        groups = np.full(len(self._channels), -1)
        groups[picked] = np.arange(len(picked))
        sizes: Array = np.abs(self._velocities(groups, len(picked))).max(axis=(1, 3))
        return sizes

    def blocks(self, i: Index, j: Index, colour: Index) -> Array:
        """Blocks (n, h, h) between the points i and j, the mean of both orders."""
        width = self._channels.shape[1]
        blocks, together = np.zeros((len(i), width, width)), max(1, _COLUMNS // width)
        batch = colour // together
        ends = np.arange(int(batch.max(initial=-1)) + 2)
        # pairs by the batch that their column is in, either way
        sorted_by = [np.argsort(batch[columns], kind="stable") for columns in (j, i)]
        starts = [np.searchsorted(batch[c][order], ends) for c, order in zip((j, i), sorted_by, strict=True)]
        for number in ends[:-1]:
            colours = np.where(batch == number, colour - number * together, -1)
            velocities = self._velocities(colours, together)
            for turned, (rows, columns) in enumerate(((i, j), (j, i))):
                here = sorted_by[turned][starts[turned][number] : starts[turned][number + 1]]
                # half from each order: symmetric to the last bit
                part = 0.5 * velocities[rows[here], :, colours[columns[here]]]
                if turned:
                    part = part.transpose(0, 2, 1)
                blocks[here] += part
        return blocks

    def difference(self, table: Table, forces: Array) -> tuple[Array, Array]:
        """Product of a table less the exact one, and the latter, on the points (n_point, h)."""
        x = np.where(self._channels >= 0, np.append(forces, 0.0)[self._rows], 0.0)
        on_channels = np.zeros(self._n + 1)
        on_channels[self._rows] = x
        exact = np.append(self._solve(on_channels[:-1]), 0.0)[self._rows]
        return product(table, x.ravel()).reshape(x.shape) - exact, exact


def _equal_norms(table: Table, solve: Callable[[Array], Array], points: Points, n_channel: int) -> bool:
    """Whether a table gives x C x of random and of uniform forces."""
    columns = _Columns(solve, points, n_channel)
    for forces in (np.random.default_rng(_SEED).standard_normal(n_channel), np.ones(n_channel)):
        x = np.where(points.channels >= 0, forces[points.channels], 0.0)
        rest, exact = columns.difference(table, forces)
        # x C x is the square of the norm: twice its relative error
        if abs(float(np.vdot(x, rest))) > 2.0 * _NORM_ERROR * float(np.vdot(x, exact)):
            return False
    return True


def _accurate(table: Table, solve: Callable[[Array], Array], points: Points, n_channel: int) -> bool:
    """Whether a table gives the velocities under random forces."""
    forces = np.random.default_rng(_SEED).standard_normal(n_channel)
    rest, exact = _Columns(solve, points, n_channel).difference(table, forces)
    return float(np.linalg.norm(rest)) <= _ERROR * table.truncation * float(np.linalg.norm(exact))


def coloured(tree: cKDTree, positions: Array, distance: float) -> Index:
    """Colours (n,) so that points of one colour are further apart than a distance, by the first that is free."""
    n = len(positions)
    pairs = tree.query_pairs(distance, output_type="ndarray")
    # the earlier neighbours of each point: pairs are i < j
    near = sp.csr_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 1], pairs[:, 0])), shape=(n, n))
    starts = near.indptr
    earlier = near.indices
    colour = np.empty(n, dtype=np.int64)
    # one colour more than the most neighbours: some colour is always free
    taken = np.zeros(int(np.diff(starts).max(initial=0)) + 1, dtype=bool)
    for p in range(n):
        others = colour[earlier[starts[p] : starts[p + 1]]]
        taken[others] = True
        colour[p] = taken.argmin()
        taken[others] = False
    return colour


def _in_runs(points: Points, i: Index, j: Index, blocks: Array, about: tuple[float, float, float]) -> Table:
    """Table of symmetric blocks; i <= j or i >= j of each pair once."""
    other = i != j
    rows, columns = np.concatenate([i, j[other]]), np.concatenate([j, i[other]])
    both = np.concatenate([blocks, blocks[other].transpose(0, 2, 1)])
    order = np.lexsort((columns, rows))
    rows = rows[order]
    columns = columns[order]
    both = both[order]
    n, width = points.channels.shape
    begins = np.ones(len(rows), dtype=bool)
    begins[1:] = (np.diff(rows) != 0) | (np.diff(columns) != 1)
    first = np.flatnonzero(begins)
    lengths = np.diff(np.append(first, len(rows)))
    starts = np.searchsorted(rows[first], np.arange(n + 1))
    # within a run the entries of the first component of the point, then those of the next
    run = np.cumsum(begins) - 1
    within = np.arange(len(rows)) - first[run]
    component, entry = np.arange(width)[:, None], np.arange(width)
    at = width * width * first[run] + width * within
    places = at[:, None, None] + width * lengths[run][:, None, None] * component + entry
    values = np.empty(both.size, dtype=np.float32)
    values[places.ravel()] = both.ravel()
    runs = np.stack([width * columns[first], width * lengths], axis=1)
    return Table(width, points.channels.ravel(), starts, runs, values, *about)


def product(table: Table, x: Array) -> Array:
    """A table times x (n_point h,)."""
    out = np.empty(len(x))
    multiply(len(table.starts) - 1, table.width, table.starts, table.runs.ravel(), table.values, x, out)
    return out
