"""Fit of the seconds per operation to measured times: non-negative, relative errors weighed alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from latin_fmu.assembly.run_cost import march, set_up
from latin_fmu.assembly.run_sizes import RunSizes
from latin_fmu.propagator.cost import MANY, Counts, seconds
from latin_fmu.propagator.seconds import SECONDS

PREPARATION = ("run", "body", "interface", "cell", "unknown")
OPERATORS = ("class", "flop", "cube", "square", "solved")
LOOP = ("call", "turn", "column")
_ROUNDS = 30


@dataclass(frozen=True)
class Measured:
    """A run: its sizes, CPU seconds of meshes and matrices, of operators and of the march, LATIN iterations per window,
    share of instants marched."""

    sizes: RunSizes
    preparation: float
    operators: float
    march: float
    iterations: float
    marched: float

    @property
    def total(self) -> float:
        """CPU seconds of the run."""
        return self.preparation + self.operators + self.march

    @property
    def known(self) -> RunSizes:
        """The sizes with what only the run can tell: the fit is not to make up for wrong iterations."""
        told = self.marched if self.sizes.compiled else 1.0
        classes = tuple(replace(c, marched=told) for c in self.sizes.classes)
        return replace(self.sizes, iterations=self.iterations, classes=classes)


def fitted(runs: Sequence[Measured]) -> dict[str, float]:
    """Seconds per operation."""
    found = dict(SECONDS)
    counts = [set_up(r.sizes) for r in runs]
    found |= _fit([_only(c, PREPARATION) for c in counts], [r.preparation for r in runs], PREPARATION, found)
    found |= _fit([_only(c, OPERATORS) for c in counts], [r.operators for r in runs], OPERATORS, found)
    counted = [(march(r.known), r) for r in runs]
    compiled = [(c, r.march) for c, r in counted if r.sizes.compiled]
    alone = [(c, t) for c, t in compiled if not any(name.startswith(MANY) for name in c)]
    names = tuple(n for n in SECONDS if n not in (*PREPARATION, *OPERATORS, *LOOP) and not n.startswith(MANY))
    found |= _fit([c for c, _ in alone], [t for _, t in alone], names, found)
    several = [(c, t) for c, t in compiled if any(name.startswith(MANY) for name in c)]
    if several:
        ratio = _ratio(several, found)
        found |= {n: ratio * found[n.removeprefix(MANY)] for n in SECONDS if n.startswith(MANY)}
    interpreted = [(c, r.march) for c, r in counted if not r.sizes.compiled]
    found |= _fit([c for c, _ in interpreted], [t for _, t in interpreted], LOOP, found)
    return found


def _only(counts: Counts, names: Sequence[str]) -> Counts:
    return {n: v for n, v in counts.items() if n in names}


def _fit(
    counts: Sequence[Counts], times: Sequence[float], names: Sequence[str], known: Mapping[str, float]
) -> dict[str, float]:
    """Seconds of the operations ``names``; the others, where they occur, are ``known``."""
    if not counts:
        return {n: known[n] for n in names}
    table = np.array([[c.get(n, 0.0) for n in names] for c in counts])
    rest = np.array([sum(known[n] * v for n, v in c.items() if n not in names) for c in counts])
    measured = np.array(times)
    wanted = np.maximum(measured - rest, 0.0)
    size = np.abs(table / measured[:, None]).max(axis=0)
    used = size > 0.0
    weight = 1.0 / measured
    x = np.zeros(used.sum())
    for _ in range(_ROUNDS):  # towards equal errors of the logarithm
        solved, _ = nnls(table[:, used] * weight[:, None] / size[used], wanted * weight)
        x = solved / size[used]
        weight = 1.0 / np.sqrt(measured * np.maximum(table[:, used] @ x + rest, 0.1 * measured))
    found = dict(zip(np.array(names)[used], x, strict=True))
    return {n: float(found.get(n, known[n])) for n in names}


def _ratio(runs: Sequence[tuple[Counts, float]], known: Mapping[str, float]) -> float:
    """Cost of an operation on one of several members over that on a single one."""

    def total(counts: Counts, ratio: float) -> float:
        return sum(
            (ratio * known[n.removeprefix(MANY)] if n.startswith(MANY) else known[n]) * v for n, v in counts.items()
        )

    tried = np.geomspace(0.1, 3.0, 200)
    misfit = [sum(np.log(total(c, ratio) / t) ** 2 for c, t in runs) for ratio in tried]
    return float(tried[int(np.argmin(misfit))])


def predicted(sizes: RunSizes, per: Mapping[str, float] | None = None) -> tuple[float, float]:
    """Seconds of set-up and march by these ``per`` operation, by those of the package where None."""
    if per is None:
        return seconds(set_up(sizes)), seconds(march(sizes))
    both = [sum(per[n] * v for n, v in counts.items()) for counts in (set_up(sizes), march(sizes))]
    return both[0], both[1]
