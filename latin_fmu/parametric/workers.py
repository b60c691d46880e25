"""Processes that solve the points of a study: this one, others of this machine, or those of a dask cluster.

Each worker is an executor for one process, and has points that follow each other in the order of the study; one that
has finished takes the second half of the longest list left. A process solves one point at a time on one thread.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from typing import Any, Final

from ..errors import InputError, SolverError
from .grid import Index
from .point import Record, failed, solve_point

LOST: Final = "the process that solved this point has ended (killed, or out of memory)"
_MOST_LOST: Final = 3  # processes lost one after the other: nothing can be solved
_WAIT: Final = 10.0  # s to wait for the scheduler

Keep = Callable[[Index, Record, bool], None]
"""Takes a point, its record, and whether its process was lost."""


class _Here(Executor):
    """Executor that calls in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The finished future of a call."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


class _Points:
    """Points that wait, by worker."""

    def __init__(self, points: Sequence[Index], workers: int) -> None:
        ends = [round(len(points) * i / workers) for i in range(workers + 1)]
        self._waiting = [list(points[a:b]) for a, b in pairwise(ends)]

    def next(self, worker: int) -> Index | None:
        """The next point of a worker; None where none is left."""
        own = self._waiting[worker]
        if not own:
            longest = max(self._waiting, key=len)
            half = len(longest) // 2
            own += longest[half:]
            del longest[half:]
        return own.pop(0) if own else None


def solve_points(points: Sequence[Index], plan: str, jobs: int, scheduler: str | None, keep: Keep) -> None:
    """Solve the points of a study and hand each record to ``keep`` when it comes.

    Parameters
    ----------
    plan : of the study, as text. jobs : number of processes; 1 for this one. scheduler : address of a dask scheduler,
        whose workers take the place of the processes.

    Raises
    ------
    InputError : dask.distributed is not installed, the scheduler cannot be reached or has no workers.
    SolverError : the processes end before they give any result.
    """
    if not points:
        return
    with ExitStack() as stack:
        make = _here if jobs == 1 else _processes
        workers = (
            stack.enter_context(_cluster(scheduler))
            if scheduler is not None
            else stack.enter_context(make(min(jobs, len(points))))
        )
        _distribute(_Points(points, len(workers)), plan, workers, keep)


Renew = Callable[[], Executor]
"""Makes the executor of a worker, at first and after its process was lost."""


def _distribute(points: _Points, plan: str, workers: Sequence[Renew], keep: Keep) -> None:
    """Give every worker its next point until none is left."""
    executors = [make() for make in workers]
    running: dict[Future[Record], tuple[int, Index]] = {}
    lost = 0

    def start(worker: int) -> None:
        point = points.next(worker)
        if point is not None:
            running[executors[worker].submit(solve_point, plan, point)] = worker, point

    for worker in range(len(workers)):
        start(worker)
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            worker, point = running.pop(future)
            try:
                record, lost = future.result(), 0
                keep(point, record, False)
            except _lost_errors() as error:
                lost += 1
                keep(point, failed(LOST), True)
                if lost >= _MOST_LOST:
                    remedy = "with jobs > 1 a script needs `if __name__ == '__main__':` around its own calls"
                    raise SolverError(
                        f"{lost} processes ended one after the other without a result; {remedy}"
                    ) from error
                executors[worker] = workers[worker]()
            start(worker)


def _lost_errors() -> tuple[type[BaseException], ...]:
    """Types of errors that are raised when the process of a worker has ended."""
    try:
        from distributed.scheduler import KilledWorker
    except ImportError:
        return (BrokenProcessPool,)
    return BrokenProcessPool, KilledWorker


@contextmanager
def _here(_: int) -> Iterator[list[Renew]]:
    yield [_Here]


@contextmanager
def _processes(jobs: int) -> Iterator[list[Renew]]:
    """Executors of one process each; the processes end with the context."""
    context = multiprocessing.get_context("spawn")
    before, made = set(multiprocessing.active_children()), list[ProcessPoolExecutor]()

    def make() -> Executor:
        made.append(ProcessPoolExecutor(1, context, _prepare))
        return made[-1]

    try:
        yield [make] * jobs
    except BaseException:  # points under way would be waited for
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        for executor in made:
            executor.shutdown(wait=True, cancel_futures=True)


def _prepare() -> None:
    """Start of a process: the one that started it handles interruptions, and it ends with that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[list[Renew]]:
    """Executors of the workers of a dask cluster."""
    try:
        from distributed import Client
    except ImportError:
        what, remedy = "dask.distributed is not installed", "pip install latin-fmu[cluster], or leave the option out"
        raise InputError.of("the study cannot be made", "--scheduler", what, address, remedy=remedy) from None
    try:
        client = Client(address, timeout=_WAIT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        what, remedy = f"the scheduler cannot be reached: {error}", "name its address, e.g. tcp://127.0.0.1:8786"
        raise InputError.of("the study cannot be made", "--scheduler", what, address, remedy=remedy) from None
    with client:
        names = sorted(client.nthreads())
        if not names:
            what, remedy = "the scheduler has no workers", f"start some: dask worker {address} --nthreads 1"
            raise InputError.of("the study cannot be made", "--scheduler", what, address, remedy=remedy)
        options: dict[str, Any] = {"allow_other_workers": True, "pure": False}

        def make(name: str) -> Renew:
            executor: Executor = client.get_executor(workers=[name], **options)
            return lambda: executor

        yield [make(name) for name in names]
