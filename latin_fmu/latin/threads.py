"""Substructures on several cores: between two local stages they know nothing of each other.

The classes are dealt out to as many threads as there are cores given, the costliest first. Each computes what it would
compute alone, so that the result is the same to the last bit with any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .layout import Index


def dealt(costs: Sequence[float], threads: int) -> list[Index]:
    """Numbers of the classes for each thread; no thread is left without."""
    hands: list[list[int]] = [[] for _ in range(min(threads, len(costs)))]
    loads = [0.0] * len(hands)
    for c in sorted(range(len(costs)), key=lambda c: -costs[c]):
        lightest = loads.index(min(loads))
        hands[lightest].append(c)
        loads[lightest] += costs[c]
    return [np.array(sorted(hand), dtype=np.int64) for hand in hands]


class Threads:
    """Threads for the substructures of one run.

    Parameters
    ----------
    costs : of one instant of every class, in any unit. count : threads wanted.
    """

    def __init__(self, costs: Sequence[float], count: int) -> None:
        self._hands = dealt(costs, count)
        self._pool = ThreadPoolExecutor(len(self._hands) - 1) if len(self._hands) > 1 else None

    @property
    def several(self) -> bool:
        """Whether there is anything to share out."""
        return self._pool is not None

    def each(self, work: Callable[[int], object]) -> None:
        """Do the work for every class."""

        def all_of(hand: Index) -> None:
            for c in hand:
                work(int(c))

        if self._pool is None:
            for hand in self._hands:
                all_of(hand)
            return
        others = [self._pool.submit(all_of, hand) for hand in self._hands[1:]]
        all_of(self._hands[0])
        for other in others:
            other.result()
