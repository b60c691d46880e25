"""Lowest modes of K phi = lambda M phi by block Lanczos on the inverse (Grimes, Lewis and Simon 1994).

The Krylov space of (K + shift M)^-1 M with a block of several vectors, all of them kept and orthogonalised twice. A
factor solves for eight columns in little more than twice the time that it takes for one, and a block finds eigenvalues
that are equal.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK: Final = 8
"""Vectors of a block."""
_EXACT: Final = 1e-6  # residual of a mode, over its eigenvalue, whose relative error is the square of it
_DEPENDENT: Final = 1e-10  # what a vector of a block adds to the others, over its size
_LOOK: Final = 3  # blocks between two looks at the modes


def lowest_modes(
    mass: sp.csr_array, solve: Callable[[Array], Array], shift: float, limit: float, most: int
) -> tuple[Array, Array] | None:
    """Eigenvalues (k,) up to ``limit``, ascending, and their modes (n, k), orthonormal in the mass.

    Parameters
    ----------
    mass : (n, n). solve : (K + shift M)^-1 of columns (n, m). shift : of the factor. limit : largest eigenvalue.
    most : modes at most; None is returned where there are more.
    """
    n = mass.shape[0]
    room = min(n, int(3.5 * most) + 8 * BLOCK)
    space, pulled = np.empty((n, room), order="F"), np.empty((n, room), order="F")
    gram = np.zeros((room, room))
    random = np.random.default_rng(0)  # the same modes every time
    rest, size = solve(mass @ random.normal(size=(n, min(BLOCK, n)))), 0
    while True:
        block, image = _orthonormal(rest, space[:, :size], pulled[:, :size], mass, random)
        width = min(block.shape[1], room - size)
        space[:, size : size + width], pulled[:, size : size + width] = block[:, :width], image[:, :width]
        answer = solve(pulled[:, size : size + width])
        size += width
        projection = pulled[:, :size].T @ answer
        gram[:size, size - width : size], gram[size - width : size, :size] = projection, projection.T
        # the new direction, of which a mode has its last components
        rest = answer - space[:, :size] @ projection
        full = size >= room
        if full or (size // BLOCK) % _LOOK == 0:
            inverse, turn = la.eigh(gram[:size, :size])
            values = 1.0 / np.maximum(inverse[::-1], np.finfo(float).tiny) - shift
            turn = turn[:, ::-1]
            count = int((values <= limit).sum())
            if count > most:
                return None
            residual = np.sqrt(max(float(la.norm(rest.T @ (mass @ rest), 2)), 0.0))
            error = residual * la.norm(turn[size - width :, : count + 1], axis=0) * (values[: count + 1] + shift)
            if full or (size > count + BLOCK and error.max(initial=0.0) <= _EXACT):
                return values[:count], space[:, :size] @ turn[:, :count]


def _orthonormal(
    block: Array, space: Array, pulled: Array, mass: sp.csr_array, random: np.random.Generator
) -> tuple[Array, Array]:
    """The block orthonormal in the mass, and orthogonal to the space, to which it is up to round-off; random vectors in
    the place of dependent ones. With it its product with the mass."""
    for _ in range(3):
        size, turn = la.eigh(block.T @ block)
        sound = size > _DEPENDENT * size[-1]
        turn = turn[:, sound] / np.sqrt(size[sound])
        missing = block.shape[1] - turn.shape[1]
        block = block @ turn
        if missing:
            block = np.hstack([block, random.normal(size=(len(block), missing))])
        # once more: what round-off left of the space was enlarged with the block
        block = block - space @ (pulled.T @ block)
        if not missing:
            break
    image: Array = mass @ block
    size, turn = la.eigh(block.T @ image)
    turn = turn / np.sqrt(size)
    return block @ turn, image @ turn
