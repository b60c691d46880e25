"""What a propagator costs: counts of elementary operations of set-up and of one instant, and memory.

Times are counts times ``seconds.SECONDS``. The pattern of a factor is analysed where kernels are compiled; elsewhere,
and where nobody wants to look at it, factors of three-dimensional meshes in nested dissection hold some 21 n^(4/3)
entries and take some 26 n^2 multiplications (George 1973 for the powers).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from ..compiled import COMPILES
from .model import SubstructureModel
from .registry import Kind
from .seconds import SECONDS

Counts = dict[str, float]
"""Number of operations by their name in ``SECONDS``."""
Precision = Literal["float64", "float32"]

_ENTRIES, _FLOPS = 21.0, 26.0  # of a factor, see the module docstring
_SPARSE = 12  # bytes per entry of a sparse matrix
_CG_STEPS: Final = 40  # conjugate gradient iterations of one solution, for steps near the wave transit of an element
_LANCZOS: Final = 60  # products with K that a stable step takes
MANY: Final = "many_"  # operations on several members at once
ITERATIONS: Final = 2.7  # LATIN iterations of an instant where nothing better is known


@dataclass(frozen=True)
class Size:
    """What the cost of a class of identical substructures depends on.

    Attributes
    ----------
    unknowns, interface, channels : of one member. members : their number. entries, mass_entries, damping_entries : of
        its stiffness, mass and damping. factor_entries, factor_flops : of its Cholesky factor, interface apart.
    """

    unknowns: int
    interface: int
    channels: int
    members: int
    entries: int
    factor_entries: float
    factor_flops: float
    mass_entries: int = 0
    damping_entries: int = 0


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


def seconds(counts: Mapping[str, float]) -> float:
    """CPU time of so many operations, s."""
    return sum(SECONDS[name] * count for name, count in counts.items())


def added(*parts: Mapping[str, float]) -> Counts:
    """Counts together."""
    total: Counts = {}
    for part in parts:
        for name, count in part.items():
            total[name] = total.get(name, 0.0) + count
    return total


def scaled(counts: Mapping[str, float], factor: float) -> Counts:
    """Counts times a number."""
    return {name: factor * count for name, count in counts.items()}


def factor_bytes(unknowns: int) -> float:
    """Size of a Cholesky factor by the law of the module docstring, without looking at the pattern."""
    return float(8 * _ENTRIES * unknowns ** (4 / 3))


def size_of(model: SubstructureModel, members: int) -> Size:
    """Size of a class of so many members like ``model``."""
    mass_entries = damping_entries = 0
    if model.mass is None:
        stiffness = model.reduced_stiffness
    else:
        mass, damping, stiffness = model.reduced
        mass_entries, damping_entries = mass.nnz, 0 if damping is None else damping.nnz
    n = stiffness.shape[0]
    last, trace, rank = model.at_interface
    rough = Size(
        n,
        len(last),
        trace.shape[0],
        members,
        stiffness.nnz,
        _ENTRIES * n ** (4 / 3),
        _FLOPS * float(n) ** 2,
        mass_entries,
        damping_entries,
    )
    if not COMPILES or n == 0:
        return rough
    from ..cholesky.symbolic import analyse

    pattern = analyse(stiffness, last, rank)
    width, below = np.diff(pattern.first).astype(float), np.diff(pattern.row_start).astype(float)
    flops = float((width**3 / 3 + width**2 * below + width * below**2).sum())
    return replace(rough, factor_entries=float(pattern.panel_start[-1]), factor_flops=flops)


def set_up_counts(kind: Kind, size: Size, modes: int = 50) -> Counts:
    """Operations that make the operators of a class."""
    counts = {
        "class": 1.0,
        "cube": float(size.interface**3 + 3 * size.channels**3),
        "square": float(size.interface**2 + size.channels**2),
    }
    if kind == "direct":
        return counts | {"flop": size.factor_flops}
    if kind == "explicit":
        return counts | {"sparse": float(_LANCZOS * size.entries), "cube": 0.0}
    if kind == "reduced":
        basis = min(size.channels + modes, size.unknowns)
        return counts | {
            "flop": 2 * size.factor_flops + 6.0 * size.unknowns * basis**2,
            "solved": 4 * size.factor_entries * (size.channels + 5 * modes),
        }
    steps = size.interface * _CG_STEPS
    return counts | {"sparse": float(steps * size.entries), "vector": float(2 * steps * size.unknowns)}


def instant_counts(
    kind: Kind,
    size: Size,
    iterations: float = ITERATIONS,
    modes: int = 50,
    precision: Precision = "float64",
    compiled: bool | None = None,
    marched: float = 1.0,
) -> Counts:
    """Operations of one instant of a class.

    Parameters
    ----------
    kind : propagator. size : of the class. iterations : LATIN iterations. modes : of reduced substructures.
    compiled : whether whole instants are; None: they are, but for conjugate gradients and single precision.
    marched : share of the instants at which the class is marched, the others being at rest.
    """
    n, sparse = size.unknowns, size.entries + size.mass_entries + size.damping_entries
    interface = 2.0 * size.interface**2 + (iterations + 1.0) * size.channels**2
    if kind == "direct":
        half = 0.5 if precision == "float32" else 1.0
        one = {"sweep": 2 * half * size.factor_entries, "sparse": float(sparse), "vector": float(n), "dense": interface}
    elif kind == "explicit":  # the admittance of a lumped mass is diagonal
        one = {
            "sparse": float(size.entries + size.damping_entries),
            "vector": float(n + 2 * iterations * size.channels),
        }
    elif kind == "reduced":
        basis = min(size.channels + modes, n)
        one = {"dense": 4.0 * size.channels * basis + (iterations + 1.0) * size.channels**2, "vector": float(basis)}
    else:
        steps = 2 * _CG_STEPS
        one = {"sparse": float(steps * sparse), "vector": float(2 * steps * n), "dense": interface}
    fast = COMPILES and precision == "float64" and (kind != "cg" if compiled is None else compiled)
    together = "" if size.members == 1 else MANY
    done = {together + name: size.members * marched * count for name, count in one.items()}
    return done | {"march" if fast else "call": 1.0}


def bytes_held(kind: Kind, size: Size, modes: int = 50, precision: Precision = "float64") -> float:
    """Memory of the operators and states of a class."""
    dense, inner, n = 8.0 * size.channels**2, 8.0 * size.interface**2, size.unknowns
    factor = (4.0 if precision == "float32" else 8.0) * size.factor_entries
    sparse = float(_SPARSE * (size.entries + size.mass_entries + size.damping_entries))
    own = {
        "direct": factor + 2 * inner,
        "explicit": 0.0,
        "reduced": 2 * factor + 8.0 * n * min(size.channels + modes, n),
        "cg": 2 * inner,
    }[kind]
    return own + 4 * dense + sparse + 8.0 * size.members * n * 12


def bytes_read(kind: Kind, size: Size, iterations: float = ITERATIONS, modes: int = 50) -> float:
    """Operators that an instant of a class goes through, whatever the number of members."""
    sparse = 0.5 * _SPARSE * (size.entries + size.mass_entries + size.damping_entries)
    products = 4.0 * (iterations + 1.0) * size.channels**2
    if kind == "direct":
        return 16.0 * size.factor_entries + sparse + 8.0 * size.interface**2 + products
    if kind == "explicit":
        return sparse
    if kind == "reduced":
        return 16.0 * size.channels * min(size.channels + modes, size.unknowns) + products
    return 2 * _CG_STEPS * sparse + products


def cost(
    kind: Kind, size: Size, modes: int = 50, precision: Precision = "float64", compiled: bool | None = None
) -> Cost:
    """Predicted cost of a class; arguments as for ``instant_counts``."""
    instant = instant_counts(kind, size, modes=modes, precision=precision, compiled=compiled)
    return Cost(seconds(set_up_counts(kind, size, modes)), seconds(instant), bytes_held(kind, size, modes, precision))
