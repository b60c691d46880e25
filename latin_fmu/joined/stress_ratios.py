"""How much the stress of a state changes the stiffness of an assembly, and whether the state has buckled.

    K_sigma x = mu K x

on the motions that clamped joints leave. With all that acts times a factor l the stiffness is K + l K_sigma, singular
at the load factor of buckling, l = -1/mu of the lowest mu. The square of every natural frequency changes by a factor
between 1 + min mu and 1 + max mu, as x^T (K + K_sigma) x does for every motion x. A small shift
of K by the mass lets floating assemblies have a factor; motions that it alone holds strain nothing, and are left out:
dead loads turn them, with or without stress.

Both ends of the spectrum are found by Lanczos' method (Golub and Van Loan, Matrix Computations, chapter 10) in the
inner product of K: one solution with the factor of K a step, some six of them where stress hardly counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..latin.assembly import Array
from ..propagator import SubstructureModel
from ..propagator.vibration import Vibration
from .joined_assembly import JoinedAssembly
from .tied_assembly import side_by_side

_FIRST: Final = 4  # steps before the first look at the ends
_MOST: Final = 120
_EXACT: Final = 1e-4  # of the larger end: residual of both
_SLOWER: Final = 1e-2
"""Frequency of the shift that lets floating bodies have a factor, over that of the search for modes: bending modes of
slender parts are far below this."""
_MOST_RIGID: Final = 30
_STRAINED: Final = 0.5  # share of the shifted stiffness of a motion that is elastic; below, it is a rigid one
_NOTHING: Final = 1e-10  # of the same: a space that holds all that K_sigma does


@dataclass(frozen=True)
class StressRatios:
    """Ends of the spectrum of K_sigma against K.

    Attributes
    ----------
    lowest, highest : mu. shapes : (n_full, 2) their modes, full dofs, of unit stiffness. moves_most : body that moves
    most in the mode of the lowest. period : of a vibration in the shape that stress changes most, s.
    """

    lowest: float
    highest: float
    shapes: Array
    moves_most: str
    period: float

    @property
    def load_factor(self) -> float:
        """Factor on all that acts at which the assembly buckles; infinite where none does."""
        if self.lowest >= 0.0:
            return np.inf
        return -1.0 / self.lowest

    @property
    def largest(self) -> float:
        """Larger of both in size."""
        return max(abs(self.lowest), abs(self.highest))


def stress_ratios(joined: JoinedAssembly, stiffness: Mapping[str, sp.csr_array], negligible: float) -> StressRatios:
    """Ends of the spectrum of an assembly without prestress.

    Parameters
    ----------
    stiffness : K_sigma (n_full, n_full) by body, N m-1. negligible : size of mu below which the ends need not be
    exact.
    """
    parts, expansion = joined.parts, joined.expansion
    onto, whole = sp.csr_array(expansion.T), _of_all(stiffness, parts.models)

    def stressed(x: Array) -> Array:
        return np.asarray(onto @ (whole @ (expansion @ x)))

    vibration = joined.vibration.shifted_by(_SLOWER**2 * joined.vibration.shift)
    if not vibration.n:
        return StressRatios(0.0, 0.0, np.zeros((parts.n, 2)), next(iter(parts.where)), 0.0)
    rigid = np.zeros((vibration.n, 0))
    for _ in range(_MOST_RIGID):
        lowest, highest, shapes = _ends(vibration, stressed, negligible, rigid)
        # of unit K + shift M: what the shift alone holds is no strain
        strained = np.einsum("ij,ij->j", shapes, vibration.stiffness @ shapes)
        moves = np.array([abs(lowest), abs(highest)]) >= negligible
        if (strained[moves] > _STRAINED).all():
            break
        rigid = np.hstack([rigid, shapes[:, moves & (strained <= _STRAINED)]])
    moved = expansion @ shapes
    largest = [float(np.abs(moved[where, 0]).max(initial=0.0)) for where in parts.where.values()]
    shape = shapes[:, int(abs(highest) > abs(lowest))]
    # Rayleigh's quotient, of unit stiffness
    period = 2.0 * np.pi * float(np.sqrt(shape @ (vibration.mass @ shape)))
    return StressRatios(lowest, highest, moved, list(parts.where)[int(np.argmax(largest))], period)


def known_ratio(shapes: Array, stiffness: Mapping[str, sp.csr_array], models: Iterable[SubstructureModel]) -> float:
    """Larger size of mu in modes of another stress (``StressRatios.shapes``), to second order in what changes them."""
    energy = shapes.T @ (_of_all(stiffness, {m.name: m for m in models}) @ shapes)
    return float(np.abs(la.eigvalsh(energy)).max())


def _of_all(stiffness: Mapping[str, sp.csr_array], models: Mapping[str, SubstructureModel]) -> sp.csr_array:
    """K_sigma of all bodies, (n_full, n_full)."""
    blocks = [stiffness.get(name, sp.csr_array((m.n_full, m.n_full))) for name, m in models.items()]
    return side_by_side(blocks)


def _ends(
    vibration: Vibration, stressed: Callable[[Array], Array], negligible: float, rigid: Array
) -> tuple[float, float, Array]:
    """Lowest and highest mu, and their modes (n, 2), of unit stiffness, of the forces K_sigma x, which ``stressed``
    gives of motions x (n,), on the motions orthogonal to ``rigid`` (n, k)."""
    elastic, n = vibration.shifted, vibration.n
    most = min(_MOST, n)
    space, pulled, gram = np.empty((most, n)).T, np.empty((most, n)).T, np.zeros((most, most))
    # what random forces do: hardly any short waves, which stress does not change
    rest, size, done = vibration.solve(np.random.default_rng(0).normal(size=n)), 0, False
    held = elastic @ rigid
    rest = rest - rigid @ (held.T @ rest)
    while not done:
        image = elastic @ rest
        norm = float(np.sqrt(rest @ image))
        space[:, size], pulled[:, size] = rest / norm, image / norm
        force = stressed(space[:, size])
        size += 1
        gram[size - 1, :size] = gram[:size, size - 1] = space[:, :size].T @ force
        rest = vibration.solve(force)
        # twice: once leaves round-off
        for _ in range(2):
            rest = rest - space[:, :size] @ (pulled[:, :size].T @ rest)
            rest = rest - rigid @ (held.T @ rest)
        left = float(np.sqrt(max(rest @ (elastic @ rest), 0.0)))
        done = size == most or left <= _NOTHING * float(np.abs(gram[:size, :size]).max())
        if size >= _FIRST and not done:
            values, turns = la.eigh(gram[:size, :size])
            largest = float(np.abs(values).max())
            residual = left * float(np.abs(turns[-1, [0, -1]]).max())
            done = largest + residual < negligible or residual <= _EXACT * largest
    values, turns = la.eigh(gram[:size, :size])
    return float(values[0]), float(values[-1]), space[:, :size] @ turns[:, [0, -1]]
