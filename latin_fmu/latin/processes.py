"""Substructures of one run distributed over processes that exchange interface data (MPI).

Every process holds the factors and motions of its own substructures, and the fields of the interfaces that touch them
(``Part``). One iteration is

1. the linear stage of the own substructures: W at their channels,
2. an exchange of W with the processes that hold the other sides of their interfaces,
3. the local stage of the interfaces held, those between two processes on both,
4. sums over each interface, for the error indicator and for the acceleration, which all processes receive,
5. verdict and acceleration: the sums over the interfaces, and the next q of the channels held.

An interface is counted by the process that owns it, and the sums over the interfaces are taken in the order of the
scene. They are the same to the last bit for any number of processes, one included, which therefore do the same
iterations and agree on every verdict without a message. The acceleration needs that: its least-squares problem enlarges
round-off by the inverse of pivots down to 1e-12. The norms of the force residual are sums over classes in their order,
of divided ones over the parts. A Newton step adds the contributions of the substructures to its matrix, which every
process factorises.

An instant of a window of its own costs two exchanges per iteration, one for the norms where the indicator is within
tolerance, one for the displacements at its end, and one at its start while no traction acts.

A class of identical substructures may be divided among processes. Each reuses the previous solve of its members by the
change of q at all members of the class, which is one more exchange per iteration, and a divided class is never passed
over at rest, so that all members are treated alike.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from ..errors import InputError, SolverError
from ..machine import usable_cores
from .assembly import Array
from .search_direction import Direction

_PATIENT = 4  # looks for a message before a process sleeps, where there are more processes than cores
_SLEEP = 2e-5  # s


class Processes:
    """The processes of a run.

    Parameters
    ----------
    communicator : of mpi4py; all its processes take part.

    Attributes
    ----------
    rank, size : number of this process, and how many there are. waited : s of the wall clock spent in exchanges.
    ended : whether an error ended all of them together.
    """

    def __init__(self, communicator: Any) -> None:
        self._communicator = communicator
        self.rank, self.size, self.waited = int(communicator.Get_rank()), int(communicator.Get_size()), 0.0
        self.ended = False
        self._requests: list[Any] = []
        # processes on this machine
        beside = sum(name == os.uname().nodename for name in self.collect(os.uname().nodename))
        self._crowded = beside > usable_cores()

    def collect(self, value: Any) -> list[Any]:
        """The value of every process, in their order; any object."""
        values: list[Any] = self._communicator.allgather(value)
        return values

    def gather(self, values: Array, ends: Sequence[int]) -> Array:
        """The numbers of all processes one after the other, those of process r from ``ends[r]`` to ``ends[r + 1]``."""
        every = np.empty(ends[-1])
        self.gathering(np.ascontiguousarray(values), every, [b - a for a, b in pairwise(ends)])()
        return every

    def gathering(self, values: Array, every: Array, sizes: Sequence[int]) -> Callable[[], None]:
        """A function that puts the numbers of all processes one after the other into ``every``; ``sizes`` : how many
        each has, this one these ``values``."""
        into = [every, (list(sizes), np.cumsum([0, *sizes[:-1]]).tolist())]
        return lambda: self._gather(values, into)

    def _gather(self, values: Array, into: Any) -> None:
        before = clock.perf_counter()
        if self._crowded:  # waiting processes would take the cores of those that compute
            self._patiently(self._communicator.Iallgatherv(values, into).Test)
        else:
            self._communicator.Allgatherv(values, into)
        self.waited += clock.perf_counter() - before

    def sending(self, messages: Sequence[tuple[int, Array, Array]]) -> Callable[[], None]:
        """A function that exchanges messages with other processes: number of the process, what it is sent, where its
        message goes."""
        communicator = self._communicator
        requests = [communicator.Recv_init(into, rank) for rank, _, into in messages]
        requests += [communicator.Send_init(out, rank) for rank, out, _ in messages]
        self._requests += requests
        return lambda: self._exchange(requests)

    def forget(self) -> None:
        """Give up the messages of ``sending``."""
        for request in self._requests:
            request.Free()
        self._requests.clear()

    def _exchange(self, requests: list[Any]) -> None:
        if not requests:
            return
        before, kind = clock.perf_counter(), type(requests[0])
        kind.Startall(requests)
        if self._crowded:
            self._patiently(lambda: kind.Testall(requests))
        else:
            kind.Waitall(requests)
        self.waited += clock.perf_counter() - before

    @staticmethod
    def _patiently(test: Callable[[], bool]) -> None:
        """Wait until a test holds without taking the core of another process for long."""
        looks = 0
        while not test():
            looks += 1
            # first only the core is given away, for a message that is nearly there
            clock.sleep(0.0 if looks < _PATIENT else _SLEEP)

    def add(self, values: Array) -> None:
        """Replace an array by its sum over the processes, added in their order."""
        flat = np.ascontiguousarray(values).ravel()
        every = self.gather(flat, [rank * flat.size for rank in range(self.size + 1)])
        total = np.zeros(flat.size)
        # in the order of the processes, alike on all of them: the reductions of the library promise no order
        for part in every.reshape(self.size, -1):
            total += part
        values[...] = total.reshape(values.shape)

    @contextmanager
    def agreed(self) -> Iterator[None]:
        """Context whose error, on any process, is raised on all of them; nothing in it may wait for another process."""
        error: Exception | None = None
        try:
            yield
        except Exception as raised:
            error = raised
        report = None
        if error is not None:
            report = type(error), tuple(getattr(error, "problems", ())), str(error) or type(error).__name__
        told = self.collect(report)
        if failed := [r for r, what in enumerate(told) if what is not None]:
            self.ended = True
            kind, problems, text = told[failed[0]]
            # the error itself where it was raised, a copy of its text elsewhere
            if error is not None:
                raise error
            if problems:
                raise kind(problems)
            raise SolverError(f"process {failed[0]} of {self.size}: {text}")

    def abort(self, code: int) -> NoReturn:
        """End all processes with this exit code."""
        self._communicator.Abort(code)
        os._exit(code)  # where the library leaves that to its starter


def distributed(costs: Sequence[float], size: int) -> list[int]:
    """Process of each substructure: successive ones together, with shares of the cost as equal as whole substructures
    allow, and at least one each.

    >>> distributed([1.0, 1.0, 1.0, 1.0, 4.0], 2)
    [0, 0, 0, 0, 1]
    """
    n, ends = len(costs), np.cumsum(costs)
    middles = (ends - 0.5 * np.asarray(costs)) / ends[-1] * size
    ranks: list[int] = []
    for i, middle in enumerate(middles):
        if ranks:
            last = ranks[-1]
        else:
            last = -1
        # not back, no further than the next process, and one substructure left for each process behind
        ranks.append(min(max(int(middle), last, size - (n - i), 0), last + 1, size - 1))
    return ranks


def check_newton(direction: Direction) -> None:
    """Refuse Newton steps by products alone, whose vectors stay in one process."""
    if direction.relative.get("krylov"):
        what = "large interfaces at long steps take Newton steps by products, which stay in one process"
        remedy = "set it to false, use smaller steps, or run without mpiexec"
        heading = "the run cannot be distributed over processes"
        raise InputError.of(heading, "solver.newton", what, "true", remedy=remedy)
