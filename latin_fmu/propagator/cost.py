"""What a propagator costs: a small model of set-up, of one instant, and of memory.

An instant reads every operator it needs once or more and does little else, so that its time is the bytes read over the
speed of memory, plus what a call costs. Factors of three-dimensional meshes in nested dissection hold some 21 n^(4/3)
entries and take some 26 n^2 multiplications (George 1973 for the powers); where kernels are compiled the pattern is
analysed instead. The constants are those of one core of a common server; a prediction is meant to be right within a
factor of three and to order the propagators, no more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..compiled import COMPILES
from .model import SubstructureModel, reduced_rank
from .settings import Kind

BYTES_PER_SECOND = 18e9  # operators read
FLOPS_PER_SECOND = 12e9  # dense blocks
_SOLVED_PER_SECOND = 2.5e9  # of many right-hand sides, by the library that computes the modes
_ENTRIES, _FLOPS = 21.0, 26.0  # of a factor, see the module docstring
_CALL = 120e-6  # of a class at an instant, interpreted
_COMPILED_CALL = 6e-6
_SPARSE = 12  # bytes per entry of a sparse matrix
_CG_STEPS = 40  # conjugate gradient iterations of one solution, for steps near the wave transit of an element
_LANCZOS = 60  # products with K that a stable step takes


@dataclass(frozen=True)
class Size:
    """What the cost of a class of identical substructures depends on.

    Attributes
    ----------
    unknowns, interface, channels : of one member. members : their number. entries : of the stiffness matrix.
    factor_entries, factor_flops : of its Cholesky factor.
    """

    unknowns: int
    interface: int
    channels: int
    members: int
    entries: int
    factor_entries: float
    factor_flops: float


@dataclass(frozen=True)
class Cost:
    """Seconds of CPU and bytes. ``setup`` : operators. ``instant`` : one instant, iterations included."""

    setup: float
    instant: float
    memory: float

    def total(self, n_instant: int) -> float:
        """Seconds of a run."""
        return self.setup + n_instant * self.instant

    def __add__(self, other: Cost) -> Cost:
        return Cost(self.setup + other.setup, self.instant + other.instant, self.memory + other.memory)


def factor_bytes(unknowns: int) -> float:
    """Size of a Cholesky factor by the law of the module docstring, without looking at the pattern."""
    return float(8 * _ENTRIES * unknowns ** (4 / 3))


def size_of(model: SubstructureModel, members: int) -> Size:
    """Size of a class of so many members like ``model``."""
    stiffness = model.reduced_stiffness
    n = stiffness.shape[0]
    trace = (model.trace @ model.expansion).tocsc()
    last = np.flatnonzero(np.diff(trace.indptr)).astype(np.int64)
    rough = Size(
        n, len(last), trace.shape[0], members, stiffness.nnz, _ENTRIES * n ** (4 / 3), _FLOPS * float(n) ** 2
    )
    if not COMPILES or n == 0:
        return rough
    from .cholesky.symbolic import analyse

    rank = None if model.ordering is None else reduced_rank(model.expansion, model.ordering)
    pattern = analyse(stiffness, last, rank)
    width, below = np.diff(pattern.first).astype(float), np.diff(pattern.row_start).astype(float)
    flops = float((width**3 / 3 + width**2 * below + width * below**2).sum())
    return replace(rough, factor_entries=float(pattern.panel_start[-1]), factor_flops=flops)


def cost(
    kind: Kind,
    size: Size,
    modes: int = 50,
    precision: Literal["float64", "float32"] = "float64",
    compiled: bool | None = None,
) -> Cost:
    """Predicted cost of a class.

    Parameters
    ----------
    kind : propagator. size : of the class. modes, precision : of reduced and direct ones. compiled : whether whole
        instants are compiled; None: they are, but for conjugate gradients.
    """
    iterations = 2.7
    dense, inner = 8.0 * size.channels**2, 8.0 * size.interface**2
    item = 4.0 if precision == "float32" else 8.0
    factor = item * size.factor_entries
    sparse = float(_SPARSE * size.entries)
    condense = 3.0 * size.channels**3 / FLOPS_PER_SECOND
    # the admittance of a lumped mass is diagonal
    interface = 0.0 if kind == "explicit" else _read((iterations + 2.5) * dense, size.members)
    fast = COMPILES and (kind != "cg" if compiled is None else compiled)
    call = _COMPILED_CALL if fast else _CALL
    if kind == "direct":
        setup = (size.factor_flops + size.interface**3) / FLOPS_PER_SECOND
        march, memory = _read(2 * factor + 2 * sparse + 2 * inner, size.members), factor + 2 * inner
    elif kind == "explicit":
        setup = _LANCZOS * sparse / BYTES_PER_SECOND
        march, memory = _read(sparse + 64.0 * size.unknowns, size.members), 0.0
    elif kind == "reduced":
        basis = min(size.channels + modes, size.unknowns)
        solutions = 4.0 * size.factor_entries * (size.channels + 5 * modes)
        setup = solutions / _SOLVED_PER_SECOND
        setup += (2 * size.factor_flops + 6.0 * size.unknowns * basis**2) / FLOPS_PER_SECOND
        march, memory = (
            _read(24.0 * size.channels * basis, size.members),
            16.0 * size.factor_entries + 8.0 * size.unknowns * basis,
        )
    else:
        iteration = sparse + 80.0 * size.unknowns
        setup = size.interface * _CG_STEPS * iteration / BYTES_PER_SECOND
        march, memory = 2 * _CG_STEPS * _read(iteration, size.members), 2 * sparse + 2 * inner
    state = 8.0 * size.members * size.unknowns * 12
    return Cost(setup + condense, march + interface + call, memory + 4 * dense + 2 * sparse + state)


def _read(n_bytes: float, members: int) -> float:
    """Seconds to read operators once and multiply them with a column per member."""
    return max(n_bytes / BYTES_PER_SECOND, members * n_bytes / 4 / FLOPS_PER_SECOND)
