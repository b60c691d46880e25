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
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from ..errors import InputError, SolverError
from ..kernels import entries
from ..machine import usable_cores
from ..propagator.image import Image
from .assembly import Array
from .search_direction import Direction

if TYPE_CHECKING:
    from .part import Part

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
        beside = sum(name == os.uname().nodename for name in self.collect(os.uname().nodename))
        self._crowded = beside > usable_cores()

    def collect(self, value: Any) -> list[Any]:
        """The value of every process, in their order; any object."""
        values: list[Any] = self._communicator.allgather(value)
        return values

    def gather(self, own: Array, ends: Sequence[int]) -> Array:
        """The numbers of all processes one after the other, those of process r from ``ends[r]`` to ``ends[r + 1]``."""
        every = np.empty(ends[-1])
        self.gathering(np.ascontiguousarray(own), every, [b - a for a, b in pairwise(ends)])()
        return every

    def gathering(self, own: Array, every: Array, sizes: Sequence[int]) -> Callable[[], None]:
        """A function that puts the numbers of all processes one after the other into ``every``; ``sizes`` : how many
        each has, this one those of ``own``."""
        into = [every, (list(sizes), np.cumsum([0, *sizes[:-1]]).tolist())]
        return lambda: self._gather(own, into)

    def _gather(self, own: Array, into: Any) -> None:
        before = clock.perf_counter()
        if self._crowded:  # waiting processes would take the cores of those that compute
            self._patiently(self._communicator.Iallgatherv(own, into).Test)
        else:
            self._communicator.Allgatherv(own, into)
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
            clock.sleep(0.0 if looks < _PATIENT else _SLEEP)

    def add(self, values: Array) -> None:
        """Replace an array by its sum over the processes, added in their order."""
        own = np.ascontiguousarray(values).ravel()
        every = self.gather(own, range(0, (self.size + 1) * own.size, max(own.size, 1)) if own.size else [0] * 2)
        total = np.zeros(own.size)
        for part in every.reshape(self.size, -1) if own.size else ():
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
        problems = tuple(getattr(error, "problems", ()))
        told = self.collect(None if error is None else (type(error), problems, str(error) or type(error).__name__))
        if failed := [r for r, what in enumerate(told) if what is not None]:
            self.ended = True
            kind, problems, text = told[failed[0]]
            raise error or (kind(problems) if problems else SolverError(f"process {failed[0]} of {self.size}: {text}"))

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
        last = ranks[-1] if ranks else -1
        ranks.append(min(max(int(middle), last, size - (n - i), 0), last + 1, size - 1))
    return ranks


def check_newton(direction: Direction) -> None:
    """Refuse Newton steps by products alone, whose vectors stay in one process."""
    if direction.relative.get("krylov"):
        what = "large interfaces at long steps take Newton steps by products, which stay in one process"
        remedy = "set it to false, take smaller steps, or run without mpiexec"
        heading = "the run cannot be distributed over processes"
        raise InputError.of(heading, "solver.newton", what, "true", remedy=remedy)


class Exchange:
    """What the processes of a run exchange between the calls of the kernels.

    Parameters
    ----------
    part, image : of the assembly that this process holds. direction : that of the part.

    Attributes
    ----------
    parts : gathers the sums over each interface. divided : whether some class of the assembly is divided.
    """

    def __init__(self, part: Part, image: Image, direction: Direction) -> None:
        self.part, self.processes, self._image = part, part.processes, image
        run, gathering = image.run_fields, self.processes.gathering
        width, owned = run["part_width"], list(map(len, part.owned))
        own, every = (image.field(name, n * width) for name, n in (("own_parts", part.n_owned), ("parts", sum(owned))))
        self.parts = gathering(own, every, [n * width for n in owned])
        self._norms: dict[int, Callable[[], None]] = {}
        self._neighbours: dict[int, Callable[[], None]] = {}
        self.divided = len(set(part.whole.part_of)) < len(part.whole.part_of)
        self.fields = 1 + int(run["layers"])
        self._point_owned = direction.relative.get("point_owned")
        self.has_coarse = bool(run.get("n_coarse", 0))
        if self.has_coarse and direction.coarse is not None:
            shares = direction.coarse.shares
            shares = [*shares, *[0] * (part.size - len(shares))]
            self.coarse = gathering(
                image.field("coarse_own", shares[part.rank]), image.field("coarse_parts", sum(shares)), shares
            )

    def neighbours(self, n: int) -> None:
        """Exchange messages of n fields with the neighbours."""
        if n not in self._neighbours:
            messages, at, start = [], 0, 0
            for rank, given, taken in self.part.neighbours:
                end, last = at + n * len(given), start + n * len(taken)
                messages.append((rank, self._field("outbox", at, end), self._field("inbox", start, last)))
                at, start = end, last
            self._neighbours[n] = self.processes.sending(messages)
        self._neighbours[n]()

    def _field(self, name: str, first: int, last: int) -> Array:
        return self._image.field(name, last)[first:]

    def share(self, name: str, n: int = 1) -> None:
        """Exchange n fields with the neighbours, the first of them by its name."""
        image = self._image
        given = image.run_fields[name], image.run_fields["layer"] - image.run_fields["displacement"]
        image.call(entries.SEND, *given, n)
        self.neighbours(n)
        image.call(entries.TAKE, *given, n)

    def displacements(self) -> None:
        """Exchange what gaps and layers start from."""
        self.share("displacement", self.fields)

    def norms(self, n: int) -> None:
        """Gather the norms of the force residual over a window of n instants."""
        if n not in self._norms:
            sizes = [4 * n * (self.part.whole.owner.count(r) + 1) for r in range(self.part.size)]
            own, every = (
                self._image.field("own_norms", sizes[self.part.rank]),
                self._image.field("all_norms", sum(sizes)),
            )
            self._norms[n] = self.processes.gathering(own, every, sizes)
        self._norms[n]()

    def force_residual(self, n: int) -> None:
        """Force residual over a window of n instants."""
        self._image.call(entries.NORMS, n)
        self.norms(n)
        self._image.call(entries.RELATIVE_FORCES, n)

    def touch(self) -> None:
        """Find out whether any traction of the last accepted instant acts."""
        acts = np.array([float(self._image.field("f_hat", self._image.n_flat).any())])
        self.processes.add(acts)
        self._image.field("touched", 1)[0] = float(acts[0] > 0.0)

    def changes(self, n: int) -> None:
        """Changes of q at all members of the divided classes over a window of n instants."""
        part, image = self.part, self._image
        own = [image.class_field(c, "changes", n) for c, divided in enumerate(part.divided) if divided]
        counts = np.bincount(part.whole.part_of)
        rows = [[c for c, r in enumerate(part.whole.owner) if r == rank] for rank in range(part.size)]
        rows = [[c for c in own_rows if counts[part.whole.part_of[c]] > 1] for own_rows in rows]
        ends = np.cumsum([0, *(n * len(r) for r in rows)]).tolist()
        every = self.processes.gather(np.concatenate([np.zeros(0), *own]), ends).reshape(-1, n)
        numbers = [part.whole.part_of[c] for r in rows for c in r]
        for field, c in zip(own, rows[part.rank], strict=True):
            total = np.zeros(n)
            for number, values in zip(numbers, every, strict=True):
                if number == part.whole.part_of[c]:
                    total += values
            field[:] = total

    def counts(self) -> None:
        """Unknowns of a Newton step at the points that other processes hold."""
        image = self._image
        n = int(image.run_fields["n_place"])
        every = (np.diff(image.counts("unknown_of", n + 1)) * self._point_owned).astype(float)
        self.processes.add(every)
        image.counts("elsewhere", n)[:] = every

    def matrix(self, size: int) -> None:
        """Sum over the processes of matrix and right-hand side of a Newton step."""
        image = self._image
        count = int(image.counts("unknown_of", int(image.run_fields["n_place"]) + 1)[-1])
        for name, n in (("matrix", size), ("unknowns", count)):
            self.processes.add(image.field(name, n))

    def whole(self, values: Array) -> Array:
        """Values (n, channels of the assembly) from those of the channels held, (n, n_flat)."""
        n, picked = len(values), self.part.owned_channels
        ends = np.cumsum([0, *(n * len(wide) for wide, _ in picked)]).tolist()
        every = self.processes.gather(values[:, picked[self.part.rank][1]].ravel(), ends)
        out = np.zeros((n, self.part.whole.layout.n_flat))
        for (wide, _), first, last in zip(picked, ends, ends[1:], strict=False):
            out[:, wide] = every[first:last].reshape(n, -1)
        return out
