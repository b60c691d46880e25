"""Geometry of an interface: its points, their areas, frames and initial gap, Eqs. (18)-(19)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .laws import Array

_ROUND_OFF = 1e-12


class Rotation:
    """Rotation of vectors (..., n_point, n_component) from the frames (n_point, n_component, 3) of their points into
    global axes."""

    def __init__(self, frames: Array) -> None:
        self._frames = frames
        self._one = frames[0] if len(frames) and (frames == frames[0]).all() else None
        self._along: list[tuple[int, float]] = []  # per global axis, component and factor: frames along these axes
        # a permutation with signs
        if self._one is not None and (np.count_nonzero(self._one, axis=0) <= 1).all():
            rows = np.abs(self._one).argmax(axis=0)
            self._along = [(int(row), float(self._one[row, axis])) for axis, row in enumerate(rows)]

    def __call__(self, values: Array) -> Array:
        """The vectors in global axes, (..., n_point, 3)."""
        if self._along:  # no sums
            vectors = np.empty((*values.shape[:-1], 3))
            for axis, (row, factor) in enumerate(self._along):
                np.multiply(values[..., row], factor, out=vectors[..., axis])
            return vectors
        if self._one is None:
            turned: Array = np.einsum("...pc,pci->...pi", values, self._frames)
            return turned
        product: Array = values.reshape(-1, len(self._one)) @ self._one  # one product instead of one per instant
        return product.reshape(*values.shape[:-1], 3)


@dataclass(frozen=True)
class InterfaceGeometry:
    """Points of one interface and the traces of its two sides.

    Attributes
    ----------
    points : (n_point, 3) on the owner's side, m. areas : (n_point,), m2, > 0.
    frames : (n_point, 3, 3) rows N, t1, t2; N from E to E'.
    gap : (n_point,) initial opening along N, m.
    traces : for each side the sparse matrix (3 n_point, 3 n_node) from nodal values to values at the points
        in global axes; None for rigid ground.
    cells : triangles and quadrilaterals (n_cell, 4) between the points, -1 behind the three of a triangle; None where
        they are not known.
    owner : side (0 for E, 1 for E') whose nodes the points are made of. matching : whether each point is one node of
        each side. linear : (n_node, n_node) values at the inner nodes of the owner's facets of second order by those at
        their corners, linear between these, where the corners alone are points; None elsewhere.

    The traces satisfy T 1 = 1, T_E X_E = T_E' X_E' up to the gap along N (X the places of the nodes), and
    T^T area = int phi on both sides, phi the functions of the nodes of that side.
    """

    points: Array
    areas: Array
    frames: Array
    gap: Array
    traces: tuple[sp.csr_array, sp.csr_array | None]
    owner: int = 0
    matching: bool = True
    cells: NDArray[np.int64] | None = None
    linear: sp.csr_array | None = None

    @cached_property
    def global_axes(self) -> Mapping[int, Rotation]:
        """Rotations into global axes of vectors with one component, along N, and with three."""
        return {n: Rotation(self.frames[:, :n]) for n in (1, 3)}

    @property
    def n_point(self) -> int:
        """Number of points."""
        return len(self.points)

    def local_trace(self, side: int, n_component: int) -> sp.csr_array | None:
        """Trace in the local frame, first ``n_component`` components: (n_point * n_component, 3 n_node)."""
        trace = self.traces[side]
        if trace is None:
            return None
        local = sp.csr_array(diagonal_blocks(self.frames[:, :n_component]) @ trace)
        local.eliminate_zeros()
        return local


def diagonal_blocks(blocks: Array) -> sp.csr_array:
    """Matrix (n r, n c) with the blocks (n, r, c) on its diagonal."""
    n, rows, columns = blocks.shape
    at = np.repeat(columns * np.arange(n)[:, None, None] + np.arange(columns), rows, axis=1)
    starts = columns * np.arange(n * rows + 1)
    return sp.csr_array((np.ascontiguousarray(blocks).ravel(), at.ravel(), starts), shape=(n * rows, n * columns))


def local_frames(normals: Array) -> Array:
    """Right-handed frames (n_point, 3, 3) with rows N, t1, t2; t1 and t2 follow the global axes where N does.

    Components of N below 1e-12 are round-off and are dropped, so that a held direction never leaks into another.
    """
    normals = np.where(np.abs(normals) < _ROUND_OFF, 0.0, normals)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    frames = np.empty((len(normals), 3, 3))
    axis = np.argmax(np.abs(normals), axis=1)
    # the global axis behind the largest component of N: never parallel to it
    first = np.eye(3)[(axis + 1) % 3]
    t1 = first - np.einsum("pi,pi->p", first, normals)[:, None] * normals
    t1 /= np.linalg.norm(t1, axis=1)[:, None]
    frames[:, 0], frames[:, 1], frames[:, 2] = normals, t1, np.cross(normals, t1)
    return frames + 0.0  # no negative zeros: equal interfaces compare equal
