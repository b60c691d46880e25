"""Solution of the derivatives of an instant for the copies of a reduced assembly, all together.

The relative motions of all contacts are one substructure. With the change e of their velocities under the tractions F +
x on side E, F being those at which the free velocities w are known, and the inverse B of the compliance per traction,

    x = B e,        the law at every point:   F + x = J (g - w - e + z (F + x) + m reach) + dF_hat/dp

with the velocity g of the ground, so that with P = 1 - J z, which couples the components of a point alone,

    P x + J e = b,        b = J (g - w + z F + m reach) + dF_hat/dp - F

Rows of P are zero where a point sticks, and along N where it is pressed: e is known there. The others, those of open
points and along the face of those that slip, are the unknowns: a small matrix beside that of all points in contact. It
is the same for all parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from ..latin.assembly import Array, Assembly, Index
from ..propagator.image import Image

_STUCK = 1e-9  # largest entry of a row of P that is round-off


@dataclass(frozen=True)
class _Places:
    """Places of a group: its components at the points of the first copy, among the channels of a class.

    Attributes
    ----------
    number, points, width : of the group, points of a copy and components. rows : (n_point, width) channels.
    """

    number: int
    points: int
    width: int
    rows: Index


class ReducedSolution:
    """Solves the derivatives of an instant.

    Parameters
    ----------
    assembly : copies of the reduced assembly. copies : their number.
    """

    def __init__(self, assembly: Assembly, copies: int) -> None:
        first = assembly.propagators[0]
        self._copies = copies
        self._area = first.operators.area
        compliance = first.operators.compliance
        # what is held on both sides does not move
        moves = np.flatnonzero(compliance.diagonal())
        self._inverse = np.zeros_like(compliance)
        self._inverse[np.ix_(moves, moves)] = la.inv(compliance[np.ix_(moves, moves)])
        self._held = compliance.diagonal() == 0.0
        layout, n = assembly.layout, len(assembly.interfaces) // copies
        size = len(self._area)
        self._near = [channels[:, 0] for channels in assembly.channels]
        self._far = [
            np.concatenate([layout.channels(i, 1).ravel() for i in range(k * n, (k + 1) * n)]) for k in range(copies)
        ]
        at = np.zeros(layout.n_flat, dtype=np.int64)
        at[self._near[0]] = np.arange(len(self._near[0]))
        self._groups = layout.groups
        self._places = list[_Places]()
        # of each channel its component, and the channels of its point: itself for those that a point does not have
        self._component = np.zeros(size, dtype=np.int64)
        self._point = np.repeat(np.arange(size)[:, None], 3, axis=1)
        for g, group in enumerate(layout.groups):
            count = group.n_point // copies
            channels = group.start + np.arange(count * group.n_component).reshape(count, -1)
            rows = at[channels]
            self._places.append(_Places(g, count, group.n_component, rows))
            for a in range(group.n_component):
                self._component[rows[:, a]] = a
                self._point[rows[:, a], : group.n_component] = rows

    def solve(self, image: Image, row: int) -> None:
        """Write q and W of the instant whose tangents are in a ``row`` into an image."""
        n = image.n_flat
        q, w = image.field("q", n), image.field("w", n)
        k = image.fixed[int(image.run[0]["k"]) :][:n]
        rows = [image.row(copy) for copy in range(self._copies)]
        size = len(self._area)
        free, tractions = (
            np.stack([image.moving[row_of[name] :][:size] for row_of in rows], axis=1)
            for name in ("w_free", "reference")
        )
        ground = np.stack([w[far] for far in self._far], axis=1)
        p, j, b = self._equations(image, row, ground - free, tractions)
        e, x = self._solved(p, j, b)
        for copy, (near, far) in enumerate(zip(self._near, self._far, strict=True)):
            traction, velocity = tractions[:, copy] + x[:, copy], free[:, copy] + e[:, copy]
            w[near] = velocity
            q[near] = traction + k[near] * velocity
            q[far] = -traction

    def _equations(self, image: Image, row: int, approach: Array, tractions: Array) -> tuple[Array, Array, Array]:
        """P and J of the points, rows (n, 3) with the components of their own point, and b (n, copies), from
        velocities g - w (n, copies) under the tractions (n, copies)."""
        n = len(self._area)
        p, j, b = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, self._copies))
        for at in self._places:
            group, h, every = self._groups[at.number], at.width, (self._copies, at.points)
            reaching = h if group.behaviour.elastic else 1
            fields = {"slopes": (3, 3), "sources": (h,), "follows": (reaching,)}
            slopes, sources, follows = (
                image.group_field(at.number, name, image.rows, self._copies * at.points, *shape)[row].reshape(
                    *every, *shape
                )
                for name, shape in fields.items()
            )
            reach = image.group_field(at.number, "reach", *every, reaching)
            place = int(image.groups[at.number]["z_sum"])
            z = image.fixed[place : place + 2 * at.points].reshape(-1, 2)[:, [0, 1, 1][:h]]
            slope = slopes[0, :, :h, :h]
            j[at.rows, :h] = slope
            p[at.rows, :h] = np.eye(h) - slope * z[:, None, :]
            own = tractions[at.rows]
            jump = approach[at.rows] + z[..., None] * own
            jump[:, :reaching] += (follows * reach).transpose(1, 2, 0)
            b[at.rows] = np.einsum("pab,pbc->pac", slope, jump) + sources.transpose(1, 2, 0) - own
        return p, j, b

    def _solved(self, p: Array, j: Array, b: Array) -> tuple[Array, Array]:
        """e and x (n, copies)."""
        n = len(self._area)
        stuck = np.abs(p).max(axis=1) < _STUCK
        e = np.zeros_like(b)
        stuck &= ~self._held
        e[stuck] = b[stuck] / j[stuck, self._component[stuck]][:, None]
        forces = self._inverse @ e
        free = np.flatnonzero(~(stuck | self._held))
        if len(free):
            points = self._point[free]
            softness, stiffness = p[free], j[free]
            rest = b[free] - np.einsum("tk,tkc->tc", softness, forces[points] / self._area[points][..., None])
            rest -= np.einsum("tk,tkc->tc", stiffness, e[points])
            place = np.full(n, -1)
            place[free] = np.arange(len(free))
            matrix = np.zeros((len(free), len(free)))
            for k in range(3):
                at = points[:, k]
                # unlike components of a point couple where it slips
                some = np.flatnonzero(softness[:, k])
                matrix[some] += (softness[some, k] / self._area[at[some]])[:, None] * self._inverse[
                    np.ix_(at[some], free)
                ]
                own = np.flatnonzero((place[at] >= 0) & (stiffness[:, k] != 0.0))
                matrix[own, place[at[own]]] += stiffness[own, k]
            e[free] = np.linalg.solve(matrix, rest)
            forces += self._inverse[free].T @ e[free]
        return e, forces / self._area[:, None]
