"""Dense symmetric matrices of contact faces in patches of neighbouring points.

Forces on a patch reach points far from it by a few resultants and moments alone. With the points in patches I, and A
scaled to a diagonal of ones, the blocks between a patch and all others are of low rank,

    A = blocks within patches + U^T C U,    U_I (r_I, n_I),  C (r, r) without its blocks within patches,

where the bases U_I are those of the largest singular values of A_I,others (block low rank with shared bases). Numbers
are read once or twice per product: where the patches are far apart, a fraction of those of a triangle of the matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

OF_RESPONSE: Final = 1e-5
"""Tolerance of the response Y to changes of the tractions within an instant; the iteration takes away what it lacks."""
OF_INVERSE: Final = 1e-7
"""Tolerance of S^-1, which acts on changes from instant to instant; the next instant takes what it lacks as a load."""
EXACT: Final = 1e-13
"""Tolerance of what acts on whole displacements, and of Y for tolerances of the iteration beyond single precision."""
MOST_PATCHES: Final = 32
_CANDIDATES: Final = 3  # partitions that are tried: those with the widest gaps between their patches
_POWERS: Final = 12  # iterations for the norm of a matrix, of which the order alone counts


@dataclass(frozen=True)
class Patches:
    """A symmetric matrix (n, n) in patches (module docstring).

    Attributes
    ----------
    order : (n,) row of the matrix at each place, patch after patch. first : (n_patch + 1,) first place of each patch.
    ranks : (n_patch,). numbers : for each patch its lower triangle row by row and U_I, then the lower triangle of C.
    """

    order: Index
    first: Index
    ranks: Index
    numbers: NDArray[Any]

    @property
    def header(self) -> Index:
        """Patches, n, rank, first places, ranks, order, as ``kernels.patched`` reads them."""
        sizes = [len(self.ranks), len(self.order), int(self.ranks.sum())]
        return np.concatenate([np.array(sizes, dtype=np.int64), self.first, self.ranks, self.order])

    @property
    def reads(self) -> int:
        """Numbers that a product reads, bases twice."""
        return int(self.numbers.size + (self.ranks * np.diff(self.first)).sum())


def partition(places: Array, matrix: Array, tolerance: float) -> list[Index]:
    """Patches of points, each the sorted rows of the matrix at these points, with which a product reads the least.

    places : (n, 3) of each row of ``matrix`` (n, n), m. tolerance : as for ``in_patches``.
    """
    # 0.1 s, which runs without such faces do not pay
    from scipy.cluster import hierarchy

    whole = [np.arange(len(places))]
    points, point_of = np.unique(places, axis=0, return_inverse=True)
    if len(points) < 3:
        return whole
    tree = hierarchy.linkage(points, "ward")
    heights = tree[:, 2][::-1][:MOST_PATCHES]  # of the merges that leave 1, 2, 3, ... patches
    gaps = heights[:-1] / np.maximum(heights[1:], np.finfo(float).tiny)  # that leave 2, 3, ...
    counts = 2 + np.argsort(-gaps, kind="stable")[:_CANDIDATES]
    best, least = whole, len(places) * (len(places) + 1) // 2
    for count in np.sort(counts):
        label = hierarchy.fcluster(tree, int(count), "maxclust")[point_of.ravel()]
        patches = [np.flatnonzero(label == k) for k in np.unique(label)]
        reads = in_patches(matrix, patches, tolerance, np.float32).reads
        if reads < least:
            best, least = patches, reads
    return best


def in_patches(matrix: Array, patches: Sequence[Index], tolerance: float, kind: type[np.floating[Any]]) -> Patches:
    """A symmetric matrix (n, n) with a positive diagonal in ``patches``.

    tolerance : singular values that are left out, over the largest eigenvalue of the matrix scaled to a diagonal of
    ones. kind : of the numbers, float64 or float32.
    """
    scale = np.sqrt(matrix.diagonal())
    order, sizes = np.concatenate(patches), [len(p) for p in patches]
    scaled = matrix[np.ix_(order, order)] / (scale[order][:, None] * scale[order])
    first = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes)])
    bases = _bases(scaled, first, tolerance)
    ranks = np.array([basis.shape[1] for basis in bases], dtype=np.int64)
    parts = []
    for p, basis in enumerate(bases):
        place = slice(first[p], first[p + 1])
        weights = scale[order[place]]
        block = scaled[place, place] * (weights[:, None] * weights)
        parts += [block[np.tril_indices(len(weights))], (basis * weights[:, None]).T.ravel()]
    core, at = np.zeros((ranks.sum(), ranks.sum())), np.concatenate([[0], np.cumsum(ranks)])
    for p in range(len(bases)):
        for q in range(p):
            between = scaled[first[p] : first[p + 1], first[q] : first[q + 1]]
            core[at[p] : at[p + 1], at[q] : at[q + 1]] = bases[p].T @ between @ bases[q]
    parts.append(core[np.tril_indices(len(core))])
    return Patches(order, first, ranks, np.concatenate(parts).astype(kind))


def leave_out_digits(header: Index, numbers: NDArray[np.float32], rounding: float) -> None:
    """Round the numbers of a matrix in patches in place, so that files of them have few digits.

    header, numbers : of ``Patches``, the first numbers of their arrays. rounding : the change of the matrix, scaled to
    a diagonal of ones, over its largest eigenvalue, about: with n rows and independent errors in +-step/2 the change
    has a norm of step sqrt(n / 3).
    """
    count, n = int(header[0]), int(header[1])
    first, ranks = header[3 : 4 + count], header[4 + count : 4 + 2 * count]
    at, blocks = 0, list[_ScaledPatch]()
    for low, high, rank in zip(first[:-1], first[1:], ranks, strict=True):
        size, rank = int(high - low), int(rank)
        triangle = numbers[at : (at := at + size * (size + 1) // 2)]
        blocks.append(_ScaledPatch.of(triangle, numbers[at : (at := at + rank * size)].reshape(rank, size)))
    total = int(ranks.sum())
    core = numbers[at : at + total * (total + 1) // 2]
    between = _symmetric(core, total)
    if not n:
        return

    def times(x: Array) -> Array:
        parts = np.split(x, first[1:-1])
        sums = np.concatenate([block.basis @ part for block, part in zip(blocks, parts, strict=True)])
        outer = np.split(between @ sums, np.cumsum(ranks)[:-1])
        return np.concatenate(
            [b.scaled @ part + b.basis.T @ y for b, part, y in zip(blocks, parts, outer, strict=True)]
        )

    step = rounding * _largest(times, n) * float(np.sqrt(3.0 / n))
    of_basis = step / max(1.0, float(np.linalg.norm(between, 2)) if total else 0.0)
    for block in blocks:
        scales = block.weights[:, None] * block.weights
        block.triangle[:] = _rounded(block.triangle, step * scales[np.tril_indices(len(scales))])
        block.rows[:] = _rounded(block.rows, of_basis * block.weights)
    core[:] = _rounded(core, np.asarray(step))


class _ScaledPatch(NamedTuple):
    """A patch: the numbers of its triangle and of its basis, views; its weights, block and basis, scaled."""

    triangle: NDArray[np.float32]
    rows: NDArray[np.float32]
    weights: Array
    scaled: Array
    basis: Array

    @classmethod
    def of(cls, triangle: NDArray[np.float32], rows: NDArray[np.float32]) -> _ScaledPatch:
        """From its numbers."""
        block = _symmetric(triangle, rows.shape[1])
        weights = np.sqrt(block.diagonal())
        return cls(triangle, rows, weights, block / (weights[:, None] * weights), rows / weights)


def _symmetric(triangle: NDArray[np.float32], n: int) -> Array:
    """The matrix (n, n) of a lower triangle, row by row."""
    matrix = np.zeros((n, n))
    matrix[np.tril_indices(n)] = triangle
    return np.asarray(matrix + np.tril(matrix, -1).T)


def _rounded(values: NDArray[np.float32], step: Array) -> Array:
    """Values as multiples of the power of two at or below a step."""
    unit = np.exp2(np.floor(np.log2(step)))
    return np.asarray(np.rint(values / unit) * unit)


def _bases(scaled: Array, first: Index, tolerance: float) -> list[Array]:
    """Bases (n_I, r_I) of the blocks of a scaled matrix between each patch and all others."""
    limit, bases = tolerance * _norm(scaled), []
    for low, high in pairwise(first):
        others = np.delete(scaled[low:high], np.s_[low:high], axis=1)
        if not others.size:
            bases.append(np.zeros((high - low, 0)))
            continue
        if tolerance > np.sqrt(np.finfo(float).eps):  # of the squares nothing is lost
            squares, vectors = np.linalg.eigh(others @ others.T)
            sizes = np.sqrt(np.maximum(squares, 0.0))
        else:
            vectors, sizes, _ = np.linalg.svd(others, full_matrices=False)
        bases.append(vectors[:, sizes > limit])
    return bases


def _norm(matrix: Array) -> float:
    """Largest eigenvalue of a symmetric positive matrix, about."""
    return _largest(lambda x: np.asarray(matrix @ x), len(matrix))


def _largest(times: Callable[[Array], Array], n: int) -> float:
    """That of the matrix that a vector (n,) is multiplied by."""
    x, size = np.ones(n), 1.0
    for _ in range(_POWERS):
        x = times(x)
        size = float(np.linalg.norm(x))
        x /= size
    return size
