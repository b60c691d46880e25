"""The march of a solver-ready problem: its options, what watches it, and the outcome of its end."""

from __future__ import annotations

import tempfile
import time as clock
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, Protocol, cast

import numpy as np

from .assembly.models import KeptOperators
from .assembly.problem import SolverReadyProblem
from .checks.run_checks import balance_words, body_ends, faults_of, resultants, run_remarks, with_faults
from .interface import Behaviour
from .latin.assembly import Array, Assembly
from .latin.interface_rows import InterfaceRows, interface_history
from .latin.outcome import InterfaceHistory, Outcome, Timings
from .latin.part import Part
from .latin.processes import Processes
from .latin.recorder import Recorder
from .latin.solver import IterationEvent, WindowFields
from .latin.windows import Run, RunControl
from .machine import one_thread, peak_memory
from .propagator.base import accuracy_remarks, full_displacement
from .remarks import remarks_of
from .results.checkpoint import Checkpoint
from .results.writing import IN_MEMORY, STREAMED, check_folder
from .scene.schema import Scene

_THINNED: Final = "output.interfaces_every = {}: forces, impulses, contact times and estimates follow from these alone"
_STREAMED: Final = (
    "long run: the results file holds all histories of the interfaces; forces, impulses, contact times and estimates "
    "shown here follow from every {}th instant"
)


@dataclass(frozen=True)
class Iteration:
    """One LATIN iteration, as an observer receives it; its fields are computed on request.

    Attributes
    ----------
    window : counts from 0. iteration : counts from 1. error_indicator : sqrt(eta). force_mismatch : NaN where it was
        not evaluated.

    Examples
    --------
    >>> counts = []
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> solution = latin_fmu.solve(scene, observer=lambda event: counts.append(event.iteration))
    >>> max(counts)
    3
    """

    window: int
    iteration: int
    error_indicator: float
    force_mismatch: float
    _event: IterationEvent
    _assembly: Assembly

    def interface(self, name: str) -> InterfaceHistory:
        """Local-stage fields of this iterate over the window's instants (gap left out).

        Raises
        ------
        KeyError : unknown interface.
        """
        names = [u.name for u in self._assembly.interfaces]
        if name not in names:
            raise KeyError(f"no interface {name!r}; there are {', '.join(names)}")
        return interface_history(self._assembly, names.index(name), self._event.f_hat, self._event.w_hat)

    def displacement(self, name: str) -> Array:
        """Linear-stage displacement of a substructure in this iterate, (n, n_node, 3), m: costs one more march.

        Raises
        ------
        KeyError : unknown substructure.
        """
        where = {n: (p, m) for p in self._assembly.propagators for m, n in enumerate(p.names)}
        if name not in where:
            raise KeyError(f"no substructure {name!r}; there are {', '.join(where)}")
        propagator, member = where[name]
        fields: list[Array] = []
        # of all instants of the window: the march of the iterate is made once more
        self._event.trial(lambda _: fields.append(full_displacement(propagator, member)))
        return np.stack(fields)


Observer = Callable[[Iteration], None]


class ProgressSink(Protocol):
    """Receiver of the progress of a run."""

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """``done`` of ``total`` windows finished, now at ``iteration`` with indicator ``error``; in the march of
        derivatives instants, with iteration 0."""


@dataclass(frozen=True)
class RunOptions:
    """Options of a run; their meaning is that of the arguments of ``solve``.

    Raises
    ------
    ValueError : options that exclude each other.
    """

    observer: Observer | None = None
    progress: ProgressSink | None = None
    behaviours: Mapping[str, Behaviour] | None = None
    checkpoint: Checkpoint | None = None
    stream: Path | None = None
    kept: KeptOperators | None = None
    fields: WindowFields | None = None
    processes: Processes | None = None
    max_cpu: float | None = None

    def __post_init__(self) -> None:
        single = (self.observer, self.behaviours, self.checkpoint, self.stream, self.fields)
        if self.processes is not None and any(option is not None for option in single):
            what = "observers, laws in Python, checkpoints, streams and given first guesses"
            raise ValueError(f"{what} take one process")

    @property
    def n_process(self) -> int:
        """Processes among which the substructures are divided."""
        if self.processes is None:
            return 1
        return self.processes.size

    @property
    def iterates_all_interfaces(self) -> bool:
        """Whether the run has to iterate every interface of the scene, as its iterates are looked at or begun from."""
        return self.observer is not None or self.fields is not None

    @property
    def may_leave_bodies_out(self) -> bool:
        """Whether bodies that are never touched may be left out of the run."""
        return not self.iterates_all_interfaces and self.behaviours is None and self.processes is None


@dataclass(frozen=True)
class RunClock:
    """Time since the set-up of a run began, and the limit of its CPU time.

    Attributes
    ----------
    limit : CPU time that it may take, s; None for no limit. begin, wall_begin : of ``process_time`` and
        ``perf_counter``, s.
    """

    limit: float | None = None
    begin: float = field(default_factory=lambda: clock.process_time())
    wall_begin: float = field(default_factory=lambda: clock.perf_counter())

    @property
    def used(self) -> float:
        """CPU seconds since the beginning."""
        return clock.process_time() - self.begin

    @property
    def left(self) -> float | None:
        """CPU seconds that are left; None for no limit."""
        if self.limit is None:
            return None
        return max(self.limit - self.used, 0.0)

    def sentence(self, what: str) -> str:
        """That the limit leaves no time, and what a higher one gives."""
        return f"the limit of {self.limit:g} s of CPU time is reached before them; increase the limit to obtain {what}"


class MarchedRun(NamedTuple):
    """A problem, the outcome of its run, and what was recorded in it; ``marched`` : of the one substructure that was
    marched in the place of all bodies, None where they were marched themselves."""

    problem: SolverReadyProblem
    outcome: Outcome
    recorder: Recorder
    marched: Recorder | None = None


def rewound(problem: SolverReadyProblem, scene: Scene) -> SolverReadyProblem:
    """A problem that has been run, back at t = 0 with the laws of a scene that differs in nothing else: no operator is
    made anew. The march is that of ``scene`` alone but for the size of tractions that tolerances refer to, which stays
    that of the first one.

    Raises
    ------
    ValueError : bonded bodies that are marched as one.
    """
    if problem.grouped is not None:
        raise ValueError("bonded bodies that are marched as one begin with their assembly")
    bodies, reduced, timeline = problem.assembly, problem.reduced, problem.timeline.of(scene)
    for propagator in bodies.propagators:
        propagator.restart()
    timeline.begin(bodies, bodies.time, {}, dict(bodies.ground.start))
    if reduced is not None:
        reduced = cast(Any, reduced).rewound()
    return replace(problem, timeline=timeline, reduced=reduced)


def march(
    problem: SolverReadyProblem,
    options: RunOptions = RunOptions(),
    timings: Timings | None = None,
    started: RunClock | None = None,
    digest: str = "",
) -> MarchedRun:
    """Run a solver-ready problem over its whole interval (once: its assembly keeps the final state).

    Parameters
    ----------
    options : ``behaviours`` and ``kept`` are part of the problem, and not used. timings : CPU time of the set-up, to
        which that of the march is added. started : clock of the run; without it, wall-clock time begins here. digest :
        of the scene, for the header of the checkpoint.
    """
    observer = options.observer
    progress = options.progress
    checkpoint = options.checkpoint
    if timings is None:
        timings = Timings()
    if started is None:
        started = RunClock()
    assembly = problem.assembly
    begin = clock.process_time()
    part = None if options.processes is None else Part(assembly, options.processes)
    reduced = problem.reduced
    settings = problem.settings
    if reduced is None:
        # of the substructures of this process, where there are several
        recorder = _recorder(problem, options.stream, assembly if part is None else part.assembly)
    else:
        recorder = reduced.recorder(problem.output.energy)
        settings = reduced.settings(settings)

    def observe(event: IterationEvent) -> None:
        assert observer is not None
        observer(Iteration(event.window, event.iteration, event.error_indicator, event.force_mismatch, event, assembly))

    with one_thread():  # threads on small dense products cost more than they give, and take sums in another order
        control = RunControl(
            None if observer is None else observe,
            None if progress is None else progress.update,
            checkpoint,
            options.fields,
            options.max_cpu,
        )
        run = Run(problem.marched, settings, recorder, timings, control, part=part)
        if reduced is not None:
            run.count_as_put_in(reduced.stored)
        ready = clock.process_time()
        timings.setup += ready - begin  # search directions, tables of interfaces
        with nullcontext() if checkpoint is None else checkpoint.of(run, digest):
            run.all()
        run.join()
        inner = None
        if reduced is not None:
            inner, recorder = recorder, _recorder_of_bodies(problem, recorder)
        elif problem.grouped is not None:
            cast(Any, recorder).leave()
    outcome = _outcome(problem, run, recorder)
    timings.other = clock.process_time() - ready - timings.march
    timings.wall = clock.perf_counter() - started.wall_begin
    timings.peak_memory = peak_memory()
    return MarchedRun(problem, outcome, recorder, inner)


def _recorder_of_bodies(problem: SolverReadyProblem, marched: Recorder) -> Recorder:
    """Histories of the bodies of a problem whose assembly was marched as one substructure, from those of that."""
    whole, output = cast(Any, problem.reduced), replace(problem.output, watch=True)
    if problem.assembly.quasi_static:
        from .statics.static_fields import StaticRecorder

        return StaticRecorder(whole, marched, output, problem.info)
    from .joined.recovered_fields import RecoveredRecorder
    from .joined.recovered_resultants import ResultantRecorder, follows_resultants

    if output.contacts_alone and follows_resultants(whole):
        return ResultantRecorder(whole, marched, output, problem.info)
    return RecoveredRecorder(whole, marched, output, problem.info)


def _outcome(problem: SolverReadyProblem, run: Run, recorder: Recorder) -> Outcome:
    """Results of a run at its end."""
    assembly = problem.assembly
    converged, sentence = run.status(energy := recorder.assembly_energy(assembly))
    histories, bodies = recorder.interfaces(), recorder.substructures()
    balance, indicators, n_body = (
        # of the bodies, where the assembly was solved at once
        resultants(problem, run.tractions if problem.reduced is None else recorder.rows.f_hat[-1], histories),
        run.named_indicator(),
        assembly.n_substructure,
    )
    if problem.untouched is not None:
        histories, bodies = problem.untouched.complete(histories, bodies, recorder, assembly)
        n_body += len(problem.untouched.info)
    histories = {name: history for name, history in histories.items() if name not in recorder.unread}
    # bodies that were left out, and bonds that were not iterated
    indicators = {name: indicators.get(name, 0.0) for name in histories}
    time, ends = assembly.time[: recorder.n_kept], body_ends(problem)
    faults = faults_of(problem, histories, time[:: recorder.rows.every], run.account(), ends)
    return Outcome(
        time=time,
        interfaces=histories,
        substructures=bodies,
        windows=run.windows,
        interface_indicator=indicators,
        converged=converged,
        status=with_faults(sentence + (balance_words(balance) if converged else ""), faults),
        faults=tuple(faults),
        # marches, and solves on the interfaces, over substructures and instants
        passes=(run.marched + run.condensed) / (n_body * assembly.n_instant),
        marched=run.marched / (n_body * assembly.n_instant),
        energy=energy,
        timings=run.timings,
        warnings=(
            *problem.warnings,
            *remarks_of("accuracy", _thinning(recorder)),
            *run_remarks(problem, histories, time, recorder.rows.every, balance, ends, recorder.stresses.of(time)),
            *remarks_of("accuracy", accuracy_remarks(assembly.propagators)),
        ),
        settings=run.choices() | problem.choices,
        sensors=recorder.sensors(assembly),
        reactions=recorder.reactions(assembly),
        bolts=recorder.bolt_histories(),
        interfaces_every=recorder.rows.every,
        stream=recorder.stream,
        complete=assembly.instant == assembly.n_instant,
        interrupted=run.interrupted,
        resultants=balance,
        bond_resultants=recorder.bond_resultants,
    )


def _thinning(recorder: Recorder) -> list[str]:
    """A remark where forces and estimates follow from some of the instants."""
    if recorder.stream is None:
        text = _THINNED
    else:
        text = _STREAMED
    if recorder.rows.every == 1:
        return []
    return [text.format(recorder.rows.every)]


def _recorder(problem: SolverReadyProblem, stream: Path | None, assembly: Assembly) -> Recorder:
    """The recorder of a run, with a temporary file where the histories of the interfaces are large; ``assembly`` : with
    the substructures of this process."""
    request = replace(problem.output, watch=True)
    make: Callable[..., Recorder] = partial(Recorder, assembly)
    if problem.grouped is not None:
        make = problem.grouped.recorder
    every = request.interfaces_every
    rows = len(range(0, len(assembly.time), every))
    size = 8.0 * rows * InterfaceRows.width_of(assembly)
    if stream is None or size <= STREAMED:
        return make(request, problem.info, every)
    check_folder(stream, size)
    file = cast(BinaryIO, tempfile.TemporaryFile(dir=stream, prefix=".latin-fmu-"))  # noqa: SIM115, closed by the caller
    # at most IN_MEMORY rows, at instants that the recorder keeps
    return make(request, problem.info, every, file, every * -(-rows // IN_MEMORY))
