"""Substructures of one run distributed over processes that exchange interface data (MPI).

Every process holds the interfaces of the whole assembly, and the factors and motions of its own substructures only. One
iteration is

1. the linear stage of the own substructures: W at their channels,
2. one exchange, after which every process has the W of all channels,
3. local stage, error indicator, verdict and acceleration, on all channels.

The third step is the same computation on the same numbers everywhere. Its sums are taken in one order, whatever the
number of processes, which therefore agree on every verdict without a message, and do what one process does. The
acceleration needs that: its least-squares problem enlarges round-off by the inverse of pivots down to 1e-12. The norms
of the force residual are sums over substructures, added in the order of the processes where the indicator is within
tolerance. A Newton step adds the contributions of the substructures to its matrix, which every process factorises.

An instant of a window of its own costs one exchange per iteration, one for the displacements at its end, and one at its
start while no traction acts. The step that all processes repeat limits their number: see ``docs/processes.md``.

A class of identical substructures may be divided among processes. Each reuses the previous solve of its members by the
change of q at all members of the class, and a divided class is never passed over at rest, so that all members are
treated alike.
"""

from __future__ import annotations

import copy
import os
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from ..errors import InputError, SolverError
from ..kernels import entries
from ..kernels.iteration import BROKEN, CONVERGED, STALLED
from ..kernels.newton import ACTIVE, MADE
from ..machine import usable_cores
from ..propagator.image import Image
from .assembly import Array, Assembly, Index
from .run_image import Stages
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
        beside = sum(name == os.uname().nodename for name in self.collect(os.uname().nodename))
        self._crowded = beside > usable_cores()

    def collect(self, value: Any) -> list[Any]:
        """The value of every process, in their order; any object."""
        values: list[Any] = self._communicator.allgather(value)
        return values

    def gather(self, own: Array, ends: Sequence[int]) -> Array:
        """The numbers of all processes one after the other, those of process r from ``ends[r]`` to ``ends[r + 1]``."""
        before, every = clock.perf_counter(), np.empty(ends[-1])
        sizes = [b - a for a, b in pairwise(ends)]
        into = [every, (sizes, list(ends[:-1]))]
        if self._crowded:  # waiting processes would take the cores of those that compute
            request, looks = self._communicator.Iallgatherv(own, into), 0
            while not request.Test():
                looks += 1
                clock.sleep(0.0 if looks < _PATIENT else _SLEEP)
        else:
            self._communicator.Allgatherv(own, into)
        self.waited += clock.perf_counter() - before
        return every

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


def own_part(assembly: Assembly, rank: int) -> Assembly:
    """The assembly with the classes of one process alone; interfaces and instants are shared."""
    part, own = copy.copy(assembly), [c for c, owner in enumerate(assembly.owner) if owner == rank]
    part.propagators, part.channels = [assembly.propagators[c] for c in own], [assembly.channels[c] for c in own]
    return part


def checked_channels(assembly: Assembly, rank: int) -> list[Index | None]:
    """Per class of a process the channels of all members of the class, None where the process holds them all."""
    whole: dict[int, list[Index]] = {}
    for divided, channels in zip(assembly.part_of, assembly.channels, strict=True):
        whole.setdefault(divided, []).append(channels)
    every = [whole[assembly.part_of[c]] for c, owner in enumerate(assembly.owner) if owner == rank]
    return [None if len(parts) == 1 else np.concatenate([p.ravel() for p in parts]) for parts in every]


def check_newton(direction: Direction) -> None:
    """Refuse Newton steps by products alone, whose vectors stay in one process."""
    if direction.relative.get("krylov"):
        what = "large interfaces at long steps take Newton steps by products, which stay in one process"
        remedy = "set it to false, take smaller steps, or run without mpiexec"
        heading = "the run cannot be distributed over processes"
        raise InputError.of(heading, "solver.newton", what, "true", remedy=remedy)


class Exchange:
    """Exchanges the fields of an image; ``assembly`` : the whole one."""

    def __init__(self, processes: Processes, image: Image, assembly: Assembly) -> None:
        self.processes, self.image = processes, image
        self.layers = bool(image.run[0]["layers"])
        places = [
            np.concatenate([np.zeros(0, dtype=np.int64), *(c.ravel() for c in own_part(assembly, r).channels)])
            for r in range(processes.size)
        ]
        self._own, self._every = places[processes.rank], np.concatenate(places)
        self._places, self._ends = places, [0, *np.cumsum([len(p) for p in places]).tolist()]

    def share(self, name: str, n: int = 1) -> None:
        """Give all processes the values of a field (n, n_flat) at the channels of every substructure."""
        field = self.image.field(name, n, self.image.n_flat)
        every = self.processes.gather(field[:, self._own].ravel(), [n * end for end in self._ends])
        if n == 1:
            field[0, self._every] = every
            return
        for places, (first, last) in zip(self._places, pairwise(self._ends), strict=True):
            field[:, places] = every[n * first : n * last].reshape(n, -1)

    def share_displacements(self) -> None:
        """Give all processes what gaps and layers start from."""
        self.share("displacement")
        if self.layers:
            self.share("layer")

    def force_residual(self, n: int) -> None:
        """Force residual over a window of n instants, from the norms of all substructures."""
        self.image.call(entries.NORMS, n)
        self.processes.add(self.image.field("norms", n, 4))
        self.image.call(entries.RELATIVE_FORCES, n)


class SharedStages(Stages):
    """The stages of a window whose substructures are distributed."""

    def __init__(self, image: Image, direction: Direction, n: int, first: int, exchange: Exchange) -> None:
        super().__init__(image, direction, n, first)
        self._exchange = exchange

    def of(self, direction: Direction) -> SharedStages:
        """Those of one instant with another search direction."""
        return SharedStages(self.image, direction, 1, self.first, self._exchange)

    def begin(self) -> None:
        """Openings at the start of the window."""
        super().begin()
        for kind in range(3 if self.n > 1 else 0):
            self.image.call(entries.MOTION, self.first - 1, kind)
            self._exchange.share("displacement")
            self.image.call(entries.JUMPS, kind)

    def free_motion(self) -> None:
        """Velocities of all channels without tractions, into ``w``."""
        super().free_motion()
        self._exchange.share("w")

    def first_guess(self) -> None:
        """First q of an instant."""
        image, run = self.image, self.image.run[0]
        bonded, static = run["direct_bonds"] == 1, run["static"] == 1
        if bonded or (not static and not image.field("f_hat", image.n_flat).any()):
            self.free_motion()
        super().first_guess()
        if self.direction.assembly.swept and not static:
            self._exchange.share("q")

    def evaluate(self, iteration: int) -> None:
        """``kernels.iteration.next_stage``, with the exchanges between its parts."""
        image, n = self.image, self.n
        course = image.field("course", 8)
        if iteration == 0:
            course[:] = 0.0
        elif n == 1 and course[ACTIVE] == 1.0:
            if self._newton_step(iteration):
                return
            image.call(entries.LEAVE, iteration)
        self._linear_stage(iteration)
        if image.call(entries.LOCAL_ERROR, n):
            self._exchange.force_residual(n)

    def _linear_stage(self, iteration: int) -> None:
        self.image.call(entries.LINEAR_STAGE, self.n, self.first, iteration)
        self._exchange.share("w", self.n)

    def _newton_step(self, iteration: int) -> bool:  # noqa: ARG002, as where laws are called by Python
        """``kernels.iteration.newton_step``, with the exchanges between its parts."""
        image, exchange = self.image, self._exchange
        image.call(entries.ADMIT)
        exchange.share("step_w")
        size = image.call(entries.MATRIX)
        if size:
            exchange.processes.add(image.field("matrix", size))
        if not image.call(entries.CHANGE, size):
            return False
        exchange.share("step_w")
        image.call(entries.FULL_STEP)
        self._linear_stage(1)
        if image.call(entries.SEARCH):
            exchange.force_residual(1)
        return True

    def end_instant(self, instant: int, i: int = 0) -> None:
        """Gaps and accepted fields at the end of an instant, the i-th of the window."""
        self._exchange.share_displacements()
        super().end_instant(instant, i)

    def march(self, first: int, n: int) -> int:
        """``kernels.instants.march_instants``: windows of one instant until one does not converge; how many did."""
        image, counts = self.image, self.image.field("counts", 2)
        used, steps = image.counts("iterations", image.rows), image.counts("newton_steps", image.rows)
        for call in range(n):
            self.first = instant = first + call
            self.predict()
            self.begin()
            self.first_guess()
            solved = counts[1]
            used[call] = self._iterate(call)
            steps[call] = int(image.field("course", 8)[MADE])
            if used[call] <= 0:
                counts[1] = solved  # the Python driver solves this instant again, and counts
                return call
            image.call(entries.ACCEPT, 1)
            for c in range(len(image.propagators)):
                image.call(entries.END_CLASS, c, instant)
            self.end_instant(instant)
        return n

    def _iterate(self, call: int) -> int:
        """``kernels.iteration.iterate`` for one instant."""
        image, most = self.image, int(self.image.run[0]["max_iterations"])
        errors, residuals = (image.field(name, image.rows, most) for name in ("errors", "force_residuals"))
        measure, accelerated = image.field("measure", 8), int(image.run[0]["depth"] > 0)
        for iteration in range(most):
            self.evaluate(iteration)
            errors[call, iteration], residuals[call, iteration] = measure[0], measure[1]
            bits = image.call(entries.JUDGE, 1, 0, iteration, accelerated)
            if bits & CONVERGED:
                return iteration + 1
            if bits & (STALLED | BROKEN):
                return -(iteration + 1)
            image.call(entries.NEXT, 1, iteration, 0)
        return -most
