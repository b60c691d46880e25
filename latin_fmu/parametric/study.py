"""A parametric study: the full factorial of some keys of a scene over processes, resumable, as one dataset.

The parameters are the dimensions of the dataset, by the key of the scene with underscores for dots; the attribute
``scene_key`` has the key:

================  ==============================  ===========================================================
variable          dimensions                      content
================  ==============================  ===========================================================
``state``         parameters                      0 converged, 1 not converged, 2 failed
``converged``     parameters                      1 where the point converged, else 0
``message``       parameters                      how the run ended, or why there is none (a label)
quantities        parameters (, part)             ``point.QUANTITIES``; NaN where a point has none
``force`` ...     parameters, part, time           resultants of the interfaces, where histories are kept; ``force``
                                                  along ``component``, too
================  ==============================  ===========================================================

``part`` is ``interface``, ``sensor``, ``boundary`` or ``energy_term``. The scene is in the attributes.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import threading
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ..accuracy.runs import Log
from ..building import discretise
from ..effects.cost import Prediction, amount, memory_need
from ..errors import InputError, LatinError, SceneError, SolverError
from ..latin.state_serialization import decode, encode, opened, sealed
from ..machine import memory_room
from ..reader import read_tables
from ..results.checkpoint import scene_digest
from ..results.files import write_netcdf
from ..results.groups import SCENE_KEY, label_in, root_attributes, unit_attributes
from ..results.quantities import AXES, LABELS
from ..results.writing import check_target, unwritable, write_bytes
from ..scene.schema import Scene, with_settings
from .point import (
    CONVERGED,
    FAILED,
    QUANTITIES,
    SAMPLE,
    STATES,
    Grid,
    Index,
    Parameter,
    Plan,
    Quantity,
    Record,
    failed,
    in_scene_units,
    parameters_of,
    solve_point,
    value_text,
)

_KIND: Final = "points of a study"
_HEAD: Final = "study"  # name of the file that identifies the study of the points in a folder
_HEADING: Final = "the study cannot be made"
_MOST_JOBS: Final = 1024
LOST: Final = "the process that solved this point has ended (killed, or out of memory)"
_MOST_LOST: Final = 3  # processes lost one after the other: nothing can be solved
_WAIT: Final = 10.0  # s to wait for the scheduler
KIND: Final = "parametric study"
"""Attribute ``kind`` of the file of a study."""
_HISTORIES: Final = {
    "force": ("N", "force on side E of an interface"),
    "normal_force": ("N", "normal force of an interface, positive in compression"),
}


class Store:
    """Records of the points of a study in a folder beside its file: each is written whole, as soon as it is known.

    Parameters
    ----------
    output : file of the study. digest : of the scene and of what is kept of each point.
    """

    def __init__(self, output: Path, grid: Grid, digest: str) -> None:
        self.folder = Path(f"{output}.points")
        self._grid = grid
        self._digest = digest

    def begin(self) -> dict[Index, Record]:
        """Make the folder, or read the records of the points in it.

        Raises
        ------
        InputError : the points are of another scene or version. ResultsError : the folder cannot be written to.
        """
        head = self.folder / _HEAD
        # a folder without a head holds no points yet
        if not head.exists():
            try:
                self.folder.mkdir(exist_ok=True)
            except OSError as error:
                raise unwritable(
                    self.folder, f"cannot be made: {error.strerror or error}", "choose another place"
                ) from error
            write_bytes(head, sealed(b"", _KIND, self._digest), rescue=False)
            return {}
        try:
            opened(head.read_bytes(), _KIND, self._digest)
        except SolverError as error:
            what = "the points here are of another scene, of other parameters, or of another version"
            remedy = "name another output, or remove this folder"
            raise InputError.of("the study cannot be continued", str(self.folder), what, remedy=remedy) from error
        return {point: record for point in self._grid.order if (record := self._read(point)) is not None}

    def _read(self, point: Index) -> Record | None:
        """The record of a point; None where it is not there, or damaged."""
        with suppress(OSError, LatinError):
            content = (self.folder / self._grid.file_name(point)).read_bytes()
            record: Record = decode(opened(content, _KIND, self._digest), _KIND)
            return record
        return None

    def keep(self, point: Index, record: Record) -> None:
        """Write the record of a point."""
        content = sealed(encode(record, _KIND), _KIND, self._digest)
        write_bytes(self.folder / self._grid.file_name(point), content, rescue=False)

    def remove(self) -> None:
        """Remove the folder: the study has been written."""
        shutil.rmtree(self.folder, ignore_errors=True)


def _line(record: Record, point: str, done: int, total: int, seconds: float) -> str:
    """Line on a point that has come: the ``done``-th of ``total``; ``seconds`` : a point has taken so far."""
    left = seconds * (total - done)
    if left < 90.0:
        more = f"; about {left:.0f} s left"
    else:
        more = f"; about {left / 60.0:.0f} min left"
    state = STATES[int(record["state"])].replace("_", " ")
    if record["state"] == FAILED:
        why = f": {record['message']}"
    else:
        why = ""
    return f"{done} of {total}: {point}: {state}{why}{more if done < total else ''}"


def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, Sequence[Any]] | Sequence[str],
    output: str | Path | None = None,
    *,
    settings: Sequence[str] = (),
    jobs: int = 1,
    scheduler: str | None = None,
    histories: bool = False,
    guesses: bool = True,
    log: Log | None = None,
    max_cpu: float | None = None,
) -> xr.Dataset:
    """Solve a scene for all combinations of the values of some of its keys.

    Points that fail are marked in the result, with their message. With windows of several instants, a point begins with
    the fields of its neighbours, which saves iterations and moves results within the tolerance of the iteration.

    Parameters
    ----------
    scene : file, or a scene. vary : values by key, ``{"load.press.pressure": [1e8, 2e8]}``, or texts as for the option
        ``--vary`` of the command line.
    output : netCDF file of the study. Points that are done are kept beside it (``OUTPUT.points``) until it is written,
        so that the same call continues after an interruption.
    settings : changes of the scene that hold at all points, as for ``--set``.
    jobs : processes on this machine, one thread each; with more than one a script needs ``if __name__ == "__main__":``.
    scheduler : address of a dask scheduler whose workers solve the points instead (files of meshes and laws must be
        found at the same place there).
    histories : keep the resultants of the interfaces over time. guesses : whether neighbours give first guesses.
    log : takes a line of text after each point. max_cpu : CPU seconds that a point may take.

    Returns
    -------
    Dataset with the parameters as dimensions; see ``parametric.study``.

    Raises
    ------
    InputError : no such key, absurd sizes, a folder with the points of another study, dask.distributed missing.
    ResultsError : the output cannot be written.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> study = latin_fmu.sweep(scene, {"interface.wall.gap": [0.5, 0.6]})
    >>> study.sizes["interface_wall_gap"]
    2
    """
    tables, base_dir = tables_of(scene, settings)
    grid = Grid(tables, base_dir, in_scene_units(parameters_of(vary), tables))
    plan = Plan(grid, histories, guesses, max_cpu)
    checked, records, done = solved_points(plan, output, jobs, scheduler, log)
    study = dataset_of(grid, checked, records, histories)
    if output is not None:
        write_netcdf(xr.DataTree(study), output)
    done()
    return study


def tables_of(scene: Scene | str | Path, settings: Sequence[str]) -> tuple[dict[str, Any], str]:
    """Tables of a file, or of a scene, with settings, and the folder that its files are relative to."""
    if isinstance(scene, Scene):
        tables, base_dir = with_settings(scene.tables(), settings), scene.base_dir
    else:
        tables, base_dir = read_tables(scene, settings), Path(scene).parent
    # absolute, as workers may run in other folders
    return tables, str(base_dir.resolve())


def solved_points(
    plan: Plan, output: str | Path | None, jobs: int, scheduler: str | None, log: Log | None
) -> tuple[Scene, dict[Index, Record], Callable[[], None]]:
    """The scene of a study as written, the records of all points, and what removes their folder when the study has been
    written; parameters and errors as for ``sweep``."""
    grid = plan.grid
    checked = grid.check()
    _check_options(grid, jobs, scheduler, plan.histories)
    _check_memory(checked.undifferentiated, min(jobs, len(grid.order)))
    # keys alone: values are in the names of the points, so that a study can be continued with more of them
    kept = f"histories {plan.histories}{f', {SAMPLE}' if grid.samples else ''}"
    kept += "" if plan.evaluation is None else f", {plan.evaluation.plain()}"
    digest = scene_digest(checked, [*(p.key for p in grid.parameters), kept])
    target = None if output is None else check_target(output)
    store = None if target is None else Store(target, grid, digest)
    records = {} if store is None else store.begin()
    if log is not None and records:
        log(f"{len(records)} of {len(grid.order)} points were done before")
    before = len(records)
    begun = clock.monotonic()
    again = False

    def keep(point: Index, record: Record, lost: bool) -> None:
        nonlocal again
        records[point] = record
        again |= lost  # worth another try: its process is to blame, not the point
        if store is not None and not lost:
            store.keep(point, record)
        if log is not None:
            # points read from the folder have taken no time here
            seconds = (clock.monotonic() - begun) / (len(records) - before)
            log(_line(record, grid.words(point), len(records), len(grid.order), seconds))

    waiting = [point for point in grid.order if point not in records]
    solve_points(waiting, plan.text(), jobs, scheduler, keep)

    def done() -> None:
        # with points lost the folder stays: the same call solves what was lost, and only that
        if store is not None and not again:
            store.remove()

    return checked, records, done


def _check_options(grid: Grid, jobs: int, scheduler: str | None, histories: bool) -> None:
    if not 1 <= jobs <= _MOST_JOBS:
        raise InputError.of(_HEADING, "--jobs", "number of processes", str(jobs), f"1 to {_MOST_JOBS}")
    if scheduler is not None and jobs > 1:
        what, remedy = "the workers of the scheduler solve the points", "omit --jobs or --scheduler"
        raise InputError.of(_HEADING, "--jobs", what, str(jobs), remedy=remedy)
    for p in grid.parameters if histories else ():
        if p.key.startswith("time.") or p.key == "output.interfaces_every":
            what, remedy = "histories need the same instants at all points", "leave --histories out"
            raise InputError.of(_HEADING, f"--vary {p.key}", what, remedy=remedy)


def _check_memory(scene: Scene, jobs: int) -> None:
    """Make sure that so many runs fit in the memory that this process may take."""
    if jobs == 1:
        return
    try:
        need = memory_need(Prediction(discretise(scene))).total
    except SceneError:  # some of the points may be better
        return
    room, limit = memory_room()
    if limit and jobs * need > room:
        what = f"{jobs} processes of about {amount(need)} each"
        fitting = f"at most {max(1, int(room / need))} processes in {amount(max(room, 0.0))} ({limit})"
        raise InputError.of(_HEADING, "--jobs", "the runs need more memory than there is", what, fitting)


def dataset_of(grid: Grid, scene: Scene, records: Mapping[Index, Record], histories: bool) -> xr.Dataset:
    """Dataset of a study (module docstring): ``records`` of all points of the ``grid``, ``scene`` as written."""
    coords = {
        name: _coordinate(p, SAMPLE if grid.samples else name)
        for name, p in zip(grid.names, grid.parameters, strict=True)
    }
    study, dims = xr.Dataset(coords=coords, attrs=_attributes(scene)), grid.dims
    records = {grid.at(point): record for point, record in records.items()}
    # of all points: each has a record by now
    states = np.full(grid.shape, 0, dtype=np.int8)
    messages = np.full(grid.shape, "", dtype=object)
    for point, record in records.items():
        states[point], messages[point] = record["state"], record["message"]
    meanings = {"flag_values": np.arange(len(STATES), dtype=np.int8), "flag_meanings": " ".join(STATES)}
    flags = {"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "no yes"}
    converged = (states == CONVERGED).astype(np.int8)
    study["state"] = dims, states, {"long_name": "state of the point", **meanings}
    study["converged"] = dims, converged, {"long_name": "whether it converged", **flags}
    # a label: numbers of two studies can be subtracted
    study.coords["message"] = dims, messages.astype(np.str_), {"long_name": "how the run ended, or why there is none"}
    for quantity in QUANTITIES:
        _add_quantity(study, records, quantity)
    if histories:
        _add_histories(study, records)
    for variable in study.variables.values():
        label_in(variable.attrs, scene.unit_system)
    return study


def _coordinate(parameter: Parameter, along: str) -> Any:
    attributes = {"long_name": f"scene key {parameter.key}", SCENE_KEY: parameter.key}
    values = parameter.values
    if not parameter.numeric:
        return along, np.array([value_text(v) for v in values], dtype=np.str_), attributes
    if unit := parameter.unit:
        attributes["units"] = unit
    return along, np.array(values, dtype=float), attributes


def _attributes(scene: Scene) -> dict[str, Any]:
    return {
        **root_attributes("parametric study", scene.name, scene.text()),
        "kind": KIND,
        **unit_attributes(scene.unit_system),
    }


def _add_quantity(study: xr.Dataset, records: Mapping[Index, Record], quantity: Quantity) -> None:
    """Add one quantity, where some point has it; parts are a coordinate that all quantities of their kind share."""
    given = {point: record[quantity.name] for point, record in records.items() if quantity.name in record}
    if not given:
        return
    dims, shape = study["state"].dims, study["state"].shape
    if quantity.of:
        parts = _parts(study, records, quantity.of)
        dims, shape = (*dims, quantity.of), (*shape, len(parts))
        # places of the parts behind those of the parameters
        given = {(*point, parts.index(part)): v for point, values in given.items() for part, v in values.items()}
    values = np.full(shape, np.nan)
    for place, value in given.items():
        values[place] = value
    study[quantity.name] = dims, values, {"units": quantity.unit, "long_name": quantity.long_name}


def _parts(study: xr.Dataset, records: Mapping[Index, Record], kind: str) -> list[str]:
    """Names of the parts of one kind, in the order of the first points that name them; a coordinate of the study."""
    if kind not in study.coords:
        names = [q.name for q in QUANTITIES if q.of == kind]
        found = (part for name in names for record in records.values() for part in record.get(name, ()))
        parts = np.array(list(dict.fromkeys(found)), dtype=np.str_)
        study.coords[kind] = kind, parts, {"long_name": kind.replace("_", " ")}
    return [str(part) for part in study[kind].values]


def _add_histories(study: xr.Dataset, records: Mapping[Index, Record]) -> None:
    """Add the resultants of the interfaces over time; points cut short have no values at the instants they lack."""
    given = {point: record for point, record in records.items() if "histories" in record}
    if not given:
        return
    # points cut short have the first instants of it
    time = max((np.asarray(record["time"]) for record in given.values()), key=len)
    parts = _parts(study, records, "interface")
    study.coords["time"] = "time", time, {"units": "s", "long_name": "time since the start"}
    study.coords["component"] = "component", np.array(AXES, dtype=np.str_), LABELS["component"].attributes
    for name, (unit, long_name) in _HISTORIES.items():
        more, more_dims = ((len(AXES),), ("component",)) if name == "force" else ((), ())
        values = np.full((*study["state"].shape, len(parts), len(time), *more), np.nan)
        for point, record in given.items():
            for part, history in record["histories"][name].items():
                # instants that it lacks stay NaN
                values[point][parts.index(part), : len(history)] = history
        dims = (*study["state"].dims, "interface", "time", *more_dims)
        study[name] = dims, values, {"units": unit, "long_name": long_name}


# -- processes: this one, others of this machine, or those of a dask cluster ------------------------------------------
# Each worker is an executor for one process, and has points that follow each other in the order of the study; one that
# has finished takes the second half of the longest list left. A process solves one point at a time on one thread.

Keep = Callable[[Index, Record, bool], None]
"""Takes a point, its record, and whether its process was lost."""
Renew = Callable[[], Executor]
"""Makes the executor of a worker, at first and after its process was lost."""


class _Here(Executor):
    """Executor that calls in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The finished future of a call."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


class _WaitingPoints:
    """Points that wait, by worker."""

    def __init__(self, points: Sequence[Index], workers: int) -> None:
        # successive points stay with one worker: each is a neighbour of the last
        ends = [round(len(points) * i / workers) for i in range(workers + 1)]
        self._waiting = [list(points[a:b]) for a, b in pairwise(ends)]

    def next(self, worker: int) -> Index | None:
        """The next point of a worker; None where none is left."""
        own = self._waiting[worker]
        if not own:
            longest = max(self._waiting, key=len)
            # a list of one gives it away whole; where the longest is empty nothing is left
            half = len(longest) // 2
            # the second half: its points are neighbours of each other as well
            own += longest[half:]
            del longest[half:]
        if own:
            return own.pop(0)
        return None


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
        if scheduler is not None:
            workers = stack.enter_context(_cluster(scheduler))
        else:
            workers = stack.enter_context(make(min(jobs, len(points))))
        _distribute(_WaitingPoints(points, len(workers)), plan, workers, keep)


def _distribute(points: _WaitingPoints, plan: str, workers: Sequence[Renew], keep: Keep) -> None:
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
                # one that returns is enough: the processes themselves are in order
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
                # an executor that has lost its process takes nothing more
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

    # processes that are lost are replaced: those of the context are all children that were not there before
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
    # without the clean-up of the interpreter, which would wait for the point under way
    os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[list[Renew]]:
    """Executors of the workers of a dask cluster."""
    try:
        from distributed import Client
    except ImportError:
        what, remedy = "dask.distributed is not installed", "pip install latin-fmu[cluster], or omit the option"
        raise InputError.of(_HEADING, "--scheduler", what, address, remedy=remedy) from None
    try:
        client = Client(address, timeout=_WAIT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        what, remedy = f"the scheduler cannot be reached: {error}", "name its address, e.g. tcp://127.0.0.1:8786"
        raise InputError.of(_HEADING, "--scheduler", what, address, remedy=remedy) from None
    with client:
        names = sorted(client.nthreads())
        if not names:
            what, remedy = "the scheduler has no workers", f"start some: dask worker {address} --nthreads 1"
            raise InputError.of(_HEADING, "--scheduler", what, address, remedy=remedy)
        # a worker that ends does not hold up its points; equal calls are not merged
        options: dict[str, Any] = {"allow_other_workers": True, "pure": False}

        # a function, so that each has its own name
        def make(name: str) -> Renew:
            executor: Executor = client.get_executor(workers=[name], **options)
            return lambda: executor

        yield [make(name) for name in names]
