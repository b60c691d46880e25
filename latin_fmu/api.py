"""Solve and check a scene: the Python interface, from a scene to its solution."""

from __future__ import annotations

import tempfile
import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, Protocol, cast

import numpy as np

from .assembly.models import Kept, KeptOperators
from .assembly.problem import SolverReadyProblem
from .assembly.supports import port_lines
from .assembly.untouched import touched
from .assembly.yielding_bolts import Yielding
from .building import discretise
from .checks.mesh_checks import body_lines
from .checks.run_checks import balance_words, body_ends, faults_of, resultants, run_remarks, with_faults
from .effects.cost import IN_MEMORY, STREAMED, Prediction, check_memory, least_output, memory_line, memory_need
from .errors import InputError, LatinError, ResultsError, SolverError
from .interface import Behaviour
from .latin.assembly import Array, Assembly, InterfaceUnit
from .latin.interface_rows import InterfaceRows, interface_history
from .latin.outcome import InterfaceHistory, Outcome, Timings
from .latin.part import Part
from .latin.processes import Processes
from .latin.recorder import Recorder
from .latin.solver import IterationEvent, WindowFields
from .latin.windows import Run, RunControl
from .machine import one_thread, peak_memory
from .preparation import Attempt, Prepared, prepared
from .propagator.base import accuracy_remarks, full_displacement
from .remarks import Remark, remarks_of
from .results.checkpoint import Checkpoint, scene_digest
from .results.estimates import TruncationError
from .results.sensitivities import CHECKED, Sensitivities, scalars_of
from .results.sensors import spectra_of
from .results.solution import Solution
from .results.spread import Bands
from .results.writing import check_folder
from .scene.histories import histories_of, history_lines
from .scene.schema import Scene
from .scene.units import UnitSystem
from .sensitivities.copies import Marched, marched_beside
from .sensitivities.tangents import Tangents
from .statics.statics import Stage

_THINNED: Final = "output.interfaces_every = {}: forces, impulses, contact times and estimates follow from these alone"
_UNCHECKED: Final = (
    "fields",
    "stress",
    "nodal_stress",
    "principal_stress",
    "strain",
    "surfaces",
    "reactions",
    "energy",
)
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


@contextmanager
def computable() -> Iterator[None]:
    """Context, or decorator: arithmetic that fails inside is a SolverError.

    Products of absurd numbers overflow or vanish in ways that no check of a single number foresees.
    """
    try:
        # absurd numbers overflow, which ends in an error or a status; other threads keep their settings
        with np.errstate(all="ignore"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise SolverError(
            f"numbers of the scene are too large, too small or too far apart to compute with ({error.args[-1]}); "
            "check the units of materials, sizes, times and loads"
        ) from error
    except RuntimeError as error:  # how SuperLU reports a singular matrix
        if "singular" not in str(error):
            raise
        raise SolverError(
            "a matrix of the scene is singular: with generalized_alpha nodes of faces that may open have no mass, "
            "and a body of one layer of elements between such a face and a driven or held one has no other "
            'free node; take two layers of elements or more, or time.scheme = "hht"'
        ) from error


@dataclass(frozen=True)
class RunOptions:
    """Options of ``solve`` that belong to the march, as there."""

    observer: Observer | None = None
    progress: ProgressSink | None = None
    checkpoint: Checkpoint | None = None
    stream: Path | None = None
    fields: WindowFields | None = None
    processes: Processes | None = None
    max_cpu: float | None = None


@computable()
def solve(
    scene: Scene,
    *,
    observer: Observer | None = None,
    progress: ProgressSink | None = None,
    behaviours: Mapping[str, Behaviour] | None = None,
    checkpoint: Checkpoint | None = None,
    stream: Path | None = None,
    kept: KeptOperators | None = None,
    fields: WindowFields | None = None,
    processes: Processes | None = None,
    max_cpu: float | None = None,
) -> Solution:
    """Solve a scene.

    Parameters
    ----------
    scene : from ``load_scene`` or built in Python.
    observer : called after every LATIN iteration with an ``Iteration``.
    progress : called with the progress of the run.
    behaviours : laws of the caller's own (``interface.laws``), by interface, in the place of those that the scene
        names; they are called from Python, point by point in NumPy (``examples/own_law.py``).
    checkpoint : writes checkpoints, and continues from one; the run gives the same bits as an uninterrupted one.
    stream : folder of the results: its free space is checked, and where the histories of the interfaces are large
        (64 MB) they go to a temporary file there: ``Solution.save`` writes them all, energies follow from all of them,
        everything else from at most 20,000 instants. ``Solution.outcome.stream.close()`` removes the file.
    kept : operators of the scene solved before, used where they are equal, and replaced by those of this one.
    fields : first guesses of windows of several instants; see ``latin.windows.WindowFields``.
    processes : over which the substructures are distributed; all of them call this function with the same scene, and
        have the whole solution at its end.
    max_cpu : CPU time that the run may take, its set-up, derivatives and the runs that check them included, s. A run
        that reaches it stops before its next instant, not converged: ``Solution.interrupted`` says so, the results
        until then are kept, and a ``checkpoint`` is written, from which it can be continued. Where it is reached after
        the run, derivatives, or their checks, are left out, with a remark. On several processes: of each of them; all
        stop before the same instant.

    Raises
    ------
    SceneError : the scene cannot be built. A run that does not converge is no error: see ``Solution.converged``.
    SolverError : numbers that cannot be computed with.
    ResultsError : a checkpoint that is damaged, or of another scene, version or machine.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> solution = latin_fmu.solve(scene)
    >>> solution.converged
    True
    >>> solution.interfaces["wall"].impulse(solution.time)[-1].round()
    array([  0.,   0., 198.])
    """
    wall = clock.perf_counter()
    limit = _CpuLimit(max_cpu, clock.process_time())
    if processes is not None and (observer, behaviours, checkpoint, stream, fields) != (None,) * 5:
        what = "observers, laws in Python, checkpoints, streams and given first guesses"
        raise ValueError(f"{what} take one process")
    # observers and given first guesses see all interfaces
    looked_at, yielding = observer is not None or fields is not None, Yielding(scene)
    attempt = Attempt(
        leave_out=(observer, behaviours, fields, processes) == (None,) * 4,
        yielding=yielding,
        looked_at=looked_at,
        # studies compare runs, which are marched alike
        modes_open=kept is None and not looked_at and not yielding.tables,
    )
    kept = KeptOperators() if kept is None and yielding.tables else kept  # of the runs that may follow
    # derivatives take the histories of all instants from the memory
    stream = None if scene.differentiated else stream
    options = RunOptions(observer, progress, checkpoint, stream, fields, processes, max_cpu)
    ended = _attempted(scene, attempt, (behaviours, kept), options, limit, wall)
    (problem, prediction, tangent, _), outcome, recorder, timings, truncation = ended
    faults = yielding.faults()
    outcome = replace(
        outcome,
        settings=outcome.settings | yielding.words(),
        faults=(*outcome.faults, *faults),
        status=with_faults(outcome.status, faults),
    )
    if truncation is not None:
        outcome = replace(outcome, settings=outcome.settings | {"error of the modes": truncation.in_words()})
    if outcome.converged:
        timings.predicted = prediction.march
    outcome, sensitivities, bands = _derivatives(scene, outcome, tangent, (problem, recorder), progress, limit)
    return Solution(
        outcome,
        scene.text(),
        scene.name,
        recovered=problem.recovered,
        sensor_tables=scene.sensor,
        surfaces=scene.output.surfaces,
        units=scene.unit_system,
        sensitivities=sensitivities,
        bands=bands,
        truncation=truncation,
    )


class _Ended(NamedTuple):
    """A run that stands: what was run, its outcome, and the error of a march by modes that the program has chosen."""

    ready: Prepared
    outcome: Outcome
    recorder: Recorder
    timings: Timings
    truncation: TruncationError | None


def _attempted(
    scene: Scene,
    attempt: Attempt,
    given: tuple[Mapping[str, Behaviour] | None, KeptOperators | None],
    options: RunOptions,
    limit: _CpuLimit,
    wall: float,
) -> _Ended:
    """Run a scene until a run stands; ``given`` : behaviours and operators as for ``solve``."""
    checkpoint, stream = options.checkpoint, options.stream
    while True:
        ready = prepared(scene, *given, stream is not None, options.processes, attempt)
        problem = ready.problem
        left_out = ready.problem.untouched
        timings = Timings()
        if stream is not None:
            check_folder(stream, least_output(ready.prediction))
        timings.setup = clock.process_time() - limit.begin
        names = [] if left_out is None else [*left_out.info]
        names += ["by modes"] if ready.tries_modes else []
        digest = "" if checkpoint is None else scene_digest(scene, [*(given[0] or ()), *names])
        try:
            outcome, recorder = _marched(problem, timings, options, wall, digest)
        except ResultsError:
            if left_out is None and not ready.tries_modes:
                raise
            # the checkpoint may be of a run of the bodies, or with all of them
            modes_open = attempt.modes_open and not ready.tries_modes
            attempt = replace(attempt, leave_out=attempt.leave_out and ready.tries_modes, modes_open=modes_open)
            continue
        another, truncation = _another(scene, attempt, ready, outcome, limit)
        if another is None:
            return _Ended(ready, outcome, recorder, timings, truncation)
        # the run is void; its time counts as set-up: the limit begins where it did
        attempt = another
        if checkpoint is not None:
            checkpoint.remove()
        if outcome.stream is not None:
            outcome.stream.close()


def _another(
    scene: Scene, attempt: Attempt, ready: Prepared, outcome: Outcome, limit: _CpuLimit
) -> tuple[Attempt | None, TruncationError | None]:
    """The attempt that follows a run, None where it stands, and the error of modes that the program has chosen."""
    left_out, yielding = ready.problem.untouched, attempt.yielding
    if left_out is not None and touched([outcome.interfaces[n] for n in left_out.sides], ready.problem.assembly.dt):
        return replace(attempt, leave_out=False), None
    if ready.tries_modes and not outcome.interrupted:
        from .effects.modal_choice import truncation_of

        def march(coarser: SolverReadyProblem) -> Outcome:
            return _marched(coarser, Timings(), RunOptions(max_cpu=limit.left), None, "")[0]

        begin = clock.process_time()
        truncation, refused = truncation_of(scene, ready.prediction.discretised, ready.problem, outcome, march)
        outcome.timings.other += clock.process_time() - begin
        outcome.timings.peak_memory = peak_memory()
        if not refused:
            return None, truncation
        words = f"{refused}; the try took {clock.process_time() - limit.begin:.3g} s of CPU"
        return replace(attempt, modes_open=False, modes_refused=words), None
    another = yielding.tables and outcome.complete and yielding.goes_on(outcome.bolts)
    return (attempt if another else None), None


@dataclass(frozen=True)
class _CpuLimit:
    """Limit of CPU time of a run: ``seconds`` from ``begin`` of ``process_time`` on; None for no limit."""

    seconds: float | None
    begin: float

    @property
    def left(self) -> float | None:
        """CPU seconds that are left; None for no limit."""
        return None if self.seconds is None else max(self.begin + self.seconds - clock.process_time(), 0.0)

    def sentence(self, what: str) -> str:
        """That the limit leaves no time, and what a higher one gives."""
        return f"the limit of {self.seconds:g} s of CPU time leaves no time for them; a higher limit gives {what}"


def _derivatives(
    scene: Scene,
    outcome: Outcome,
    tangent: Tangents | None,
    ended: tuple[SolverReadyProblem, Recorder],
    progress: ProgressSink | None,
    limit: _CpuLimit,
) -> tuple[Outcome, Sensitivities | None, Bands | None]:
    """Derivatives of a run by parameters, and bands from those that scatter. None, and a remark, where they cannot be
    computed: the results of the run do not depend on them."""
    if tangent is None:
        return outcome, None, None
    begin = clock.process_time()
    made = None
    lost = "the run has not converged to its end"
    spectra = spectra_of(outcome, scene.sensor)

    def check() -> None:
        if limit.left == 0.0:
            raise SolverError(limit.sentence("the derivatives and the bands" if scene.spread else "the derivatives"))

    def shown(done: int, total: int) -> None:
        if done < total:
            check()
        if progress is not None:
            progress.update(done, total, 0, 0.0)

    if outcome.converged and outcome.complete:
        try:
            check()
            with one_thread():
                made = Sensitivities.of(outcome, tangent.march(*ended, shown), spectra)
        except SolverError as error:
            lost = str(error)
    if made is not None and scene.output.check_sensitivities != "none":
        motion = tangent.motion(*ended)
        made, missing = _checked(scene, made, outcome, (motion, tangent.statics), progress, limit)
        outcome = replace(outcome, warnings=(*outcome.warnings, *remarks_of("accuracy", missing)))
    outcome.timings.other += clock.process_time() - begin
    if made is None:
        remarks = remarks_of("accuracy", [f"no derivatives: {lost}"])
        return replace(outcome, warnings=(*outcome.warnings, *remarks)), None, None
    if not scene.spread:
        return outcome, made, None
    return outcome, made, Bands.of(outcome, made, scene.distributions, scene.sensor, spectra)


def _checked(
    scene: Scene,
    made: Sensitivities,
    outcome: Outcome,
    ended: tuple[Stage, Kept | None],
    progress: ProgressSink | None,
    limit: _CpuLimit,
) -> tuple[Sensitivities, list[str]]:
    """Derivatives checked by runs, for every parameter or those by which a quantity is flagged, and remarks on those of
    them that have none. ``ended`` : motion of the run, and operators of its static start; what is equal is taken."""
    (motion, statics), (larger, why) = ended, _larger(scene, made)
    runs: list[dict[str, float] | None] = [None] * len(made.derivatives)
    known = {q.quantity: q.value for q in made.quantities}
    steps, report = max(len(outcome.windows), 1), None if progress is None else progress.update
    newton = sum(window.newton_steps for window in outcome.windows) / steps
    together: list[tuple[Marched, Marched] | None] = [None] * len(larger)
    march, left = outcome.timings.march, limit.left
    # what cannot be computed together is run alone, and its error has the reason
    if left is None or left > (len(larger) + 1) * march:
        with suppress(LatinError), computable(), one_thread():
            together = marched_beside(motion, list(larger.values()), statics, newton, report)
    for (i, other), marched in zip(larger.items(), together, strict=True):
        if marched is not None:
            more, same = (_scalars(scene, outcome, copy) for copy in marched)
            runs[i] = {key: known[key] + more[key] - same[key] for key in known.keys() & more.keys() & same.keys()}
            continue
        kept, left = KeptOperators() if motion.problem.kept is None else motion.problem.kept.copy(), limit.left
        if left is not None and left <= march:
            why[i] = limit.sentence("their checks")
            continue
        try:
            solution = solve(other, kept=kept, progress=progress, max_cpu=left)
        except LatinError as error:
            why[i] = str(error.problems[0] if isinstance(error, InputError) else error)
            continue
        if solution.converged:
            runs[i] = scalars_of(replace(solution.outcome, energy=outcome.energy), solution.spectra)
        else:
            why[i] = limit.sentence("their checks") if solution.interrupted else solution.status
    missing = dict[str, list[str]]()
    for i in sorted(why):
        missing.setdefault(why[i], []).append(made.derivatives[i].name)
    return made.checked(runs), [
        f"the derivatives by {', '.join(names)} are not checked: {reason}" for reason, names in missing.items()
    ]


def _scalars(scene: Scene, outcome: Outcome, copy: Marched) -> dict[str, float]:
    """Scalar quantities of a copy of a run with this outcome."""
    ended = replace(outcome, interfaces=copy.interfaces, sensors=copy.sensors, bolts=copy.bolts)
    return scalars_of(ended, spectra_of(ended, scene.sensor))


def _larger(scene: Scene, made: Sensitivities) -> tuple[dict[int, Scene], dict[int, str]]:
    """Scenes with a parameter larger by CHECKED that check derivatives, by its number, and why others have none."""
    plain = scene.undifferentiated
    unkept = plain.output.model_copy(update=dict.fromkeys(_UNCHECKED, False))
    plain = plain.model_copy(update={"output": unkept})
    larger, why = dict[int, Scene](), dict[int, str]()
    every = scene.output.check_sensitivities == "all"
    for i, (d, flagged) in enumerate(zip(made.derivatives, made.flagged, strict=True)):
        if not (every or flagged):
            continue
        if d.value == 0.0:
            why[i] = "its value is 0"
            continue
        try:
            larger[i] = plain.replace(d.name, (1.0 + CHECKED) * d.value)
        except InputError as error:
            why[i] = str(error.problems[0])
    return larger, why


def run(
    problem: SolverReadyProblem,
    timings: Timings | None = None,
    options: RunOptions = RunOptions(),
    wall_start: float | None = None,
    digest: str = "",
) -> Outcome:
    """Run a solver-ready problem over its whole interval (once: its assembly keeps the final state).

    ``wall_start`` : wall-clock time at which the set-up began, s. ``digest`` : of the scene, for the header of the
    checkpoint.
    """
    return _marched(problem, timings, options, wall_start, digest)[0]


def _marched(
    problem: SolverReadyProblem, timings: Timings | None, options: RunOptions, wall_start: float | None, digest: str
) -> tuple[Outcome, Recorder]:
    """As ``run``, with what was recorded."""
    observer = options.observer
    progress = options.progress
    checkpoint = options.checkpoint
    timings = Timings() if timings is None else timings
    wall = clock.perf_counter() if wall_start is None else wall_start
    assembly = problem.assembly
    begin = clock.process_time()
    part = None if options.processes is None else Part(assembly, options.processes)
    reduced = problem.reduced
    settings = problem.settings
    held = assembly
    held = held if problem.grouped is None else problem.grouped.assembly
    if reduced is None:
        # of the substructures of this process, where there are several
        recorder = _recorder(problem, options.stream, assembly if part is None else part.assembly)
    else:
        recorder = reduced.recorder(problem.output.energy)
        settings = reduced.settings(settings)
        held = reduced.assembly

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
        march = Run(held, settings, recorder, timings, control, part=part)
        if reduced is not None:
            march.count_as_put_in(reduced.stored)
        ready = clock.process_time()
        timings.setup += ready - begin  # search directions, tables of interfaces
        with nullcontext() if checkpoint is None else checkpoint.of(march, digest):
            march.all()
        march.join()
        if reduced is not None:
            recorder = _recorder_of_bodies(problem, recorder)
        elif problem.grouped is not None:
            cast(Any, recorder).leave()
    outcome = _outcome(problem, march, recorder)
    timings.other = clock.process_time() - ready - timings.march
    timings.wall = clock.perf_counter() - wall
    timings.peak_memory = peak_memory()
    return outcome, recorder


def _recorder_of_bodies(problem: SolverReadyProblem, marched: Recorder) -> Recorder:
    """Histories of the bodies of a problem whose assembly was marched as one substructure, from those of that."""
    whole, output = cast(Any, problem.reduced), replace(problem.output, watch=True)
    if problem.assembly.quasi_static:
        from .statics.static_fields import StaticRecorder

        return StaticRecorder(whole, marched, output, problem.info)
    from .joined.recovered_fields import RecoveredRecorder

    return RecoveredRecorder(whole, marched, output, problem.info)


def _outcome(problem: SolverReadyProblem, march: Run, recorder: Recorder) -> Outcome:
    """Results of a run at its end."""
    assembly = problem.assembly
    converged, sentence = march.status(energy := recorder.assembly_energy(assembly))
    histories, bodies = recorder.interfaces(), recorder.substructures()
    balance, indicators, n_body = (
        # of the bodies, where the assembly was solved at once
        resultants(problem, march.tractions if problem.reduced is None else recorder.rows.f_hat[-1], histories),
        march.named_indicator(),
        assembly.n_substructure,
    )
    if problem.untouched is not None:
        histories, bodies = problem.untouched.complete(histories, bodies, recorder, assembly)
        n_body += len(problem.untouched.info)
    # bodies that were left out, and bonds that were not iterated
    indicators = {name: indicators.get(name, 0.0) for name in histories}
    time, ends = assembly.time[: recorder.n_kept], body_ends(problem)
    faults = faults_of(problem, histories, time[:: recorder.rows.every], march.account(), ends)
    return Outcome(
        time=time,
        interfaces=histories,
        substructures=bodies,
        windows=march.windows,
        interface_indicator=indicators,
        converged=converged,
        status=with_faults(sentence + (balance_words(balance) if converged else ""), faults),
        faults=tuple(faults),
        # marches, and solves on the interfaces, over substructures and instants
        passes=(march.marched + march.condensed) / (n_body * assembly.n_instant),
        marched=march.marched / (n_body * assembly.n_instant),
        energy=energy,
        timings=march.timings,
        warnings=(
            *problem.warnings,
            *remarks_of("accuracy", _thinning(recorder)),
            *run_remarks(problem, histories, time, recorder.rows.every, balance, ends, recorder.stresses.of(time)),
            *remarks_of("accuracy", accuracy_remarks(assembly.propagators)),
        ),
        settings=march.choices() | problem.choices,
        sensors=recorder.sensors(assembly),
        reactions=recorder.reactions(assembly),
        bolts=recorder.bolt_histories(),
        interfaces_every=recorder.rows.every,
        stream=recorder.stream,
        complete=assembly.instant == assembly.n_instant,
        interrupted=march.interrupted,
        resultants=balance,
    )


def _thinning(recorder: Recorder) -> list[str]:
    """A remark where forces and estimates follow from some of the instants."""
    text = _THINNED if recorder.stream is None else _STREAMED
    return [] if recorder.rows.every == 1 else [text.format(recorder.rows.every)]


def _recorder(problem: SolverReadyProblem, stream: Path | None, assembly: Assembly) -> Recorder:
    """The recorder of a run, with a temporary file where the histories of the interfaces are large; ``assembly`` : with
    the substructures of this process."""
    request = replace(problem.output, watch=True)
    make: Callable[..., Recorder] = partial(Recorder, assembly)
    make = make if problem.grouped is None else problem.grouped.recorder
    every = request.interfaces_every
    rows = len(range(0, len(assembly.time), every))
    size = 8.0 * rows * InterfaceRows.width_of(assembly)
    if stream is None or size <= STREAMED:
        return make(request, problem.info, every)
    check_folder(stream, size)
    file = cast(BinaryIO, tempfile.TemporaryFile(dir=stream, prefix=".latin-fmu-"))  # noqa: SIM115, closed by the caller
    # at most IN_MEMORY rows, at instants that the recorder keeps
    return make(request, problem.info, every, file, every * -(-rows // IN_MEMORY))


def check(scene: Scene) -> list[str]:
    """Build a scene without solving it; lines with its sizes and warnings.

    Raises
    ------
    SceneError : the scene cannot be built.

    Examples
    --------
    >>> latin_fmu.check(latin_fmu.load_scene("models/impact_bar/scene.toml"))[0]
    'scene impact_bar: 1 substructure(s) in 1 class(es), 1 interface(s), 400 steps of 0.005 s'
    """
    return checked(scene).text()


class Checked(NamedTuple):
    """What ``check`` finds: lines with the sizes of a scene, the remarks on it, and the sizes as plain data."""

    lines: list[str]
    remarks: tuple[Remark, ...]
    sizes: dict[str, Any]

    def text(self) -> list[str]:
        """The lines with the remarks, and the verdict at the end."""
        verdict = "the scene can be solved" + (", with the warnings above" if self.remarks else "")
        return [*self.lines, *(f"warning: {remark}" for remark in self.remarks), verdict]

    def report(self) -> dict[str, Any]:
        """Plain data: ``scene``, ``steps``, ``step`` (s), ``memory_bytes``, ``classes`` of substructures with unknowns
        and interface channels, ``interfaces``, ``histories`` from files (``SceneHistory.report``), ``warnings``."""
        return self.sizes | {"warnings": [{"code": remark.code, "text": str(remark)} for remark in self.remarks]}


@computable()
def checked(scene: Scene) -> Checked:
    """As ``check``, with the data."""
    discretised = discretise(scene)
    prediction = Prediction(discretised)
    check_memory(prediction, stream=True)  # as the command line runs it
    problem = discretised.build()  # a static start is left to the run
    assembly = problem.assembly
    lines = [
        f"scene {scene.name}: {assembly.n_substructure} substructure(s) in {len(assembly.propagators)} class(es), "
        f"{len(assembly.interfaces)} interface(s), {assembly.n_instant} steps of {assembly.dt:.6g} s"
    ]
    lines += discretised.files
    lines += body_lines(discretised.bodies)
    lines += [
        f"  {', '.join(p.names)}: {p.n_dof} unknowns, {p.n_channel} interface channels" for p in assembly.propagators
    ]
    lines += [_interface_line(u, u.name not in scene.interface, scene.unit_system) for u in assembly.interfaces]
    lines += port_lines(scene, discretised.bodies)
    lines += [cut.line(scene.unit_system) for cut in discretised.cuts.values()]
    lines += history_lines(scene)
    if discretised.scene.time.start.type == "static":
        lines.append("  start: equilibrium under what acts at t = 0, which the run solves first")
    lines.append(f"  {memory_line(prediction, stream=True)}")
    sizes = {
        "scene": scene.name,
        "steps": assembly.n_instant,
        "step": assembly.dt,
        "memory_bytes": int(memory_need(prediction, stream=True).total),
        "classes": [
            {"substructures": list(p.names), "unknowns": p.n_dof, "interface_channels": p.n_channel}
            for p in assembly.propagators
        ],
        "interfaces": [_interface_sizes(u) for u in assembly.interfaces if not u.attached],
        "histories": [history.report() for history in histories_of(scene)],
    }
    return Checked(lines, problem.warnings, sizes)


def _interface_sizes(unit: InterfaceUnit) -> dict[str, Any]:
    """An interface as plain data; ``gap``: the smallest and the largest one, of an interface that may open."""
    geometry = unit.geometry
    gap = [float(geometry.gap.min()), float(geometry.gap.max())] if unit.behaviour.opens else None
    sizes = {"points": geometry.n_point, "area": float(geometry.areas.sum()), "gap": gap}
    return {"name": unit.name, "behaviour": unit.behaviour.name, "sides": list(unit.sides), **sizes}


def _interface_line(unit: InterfaceUnit, by_search: bool, units: UnitSystem) -> str:
    """Sizes of an interface: points, area, gap, where the points come from; ``by_search``: from a [contact.NAME]."""
    geometry = unit.geometry
    if unit.attached:
        return f"  {unit.attached}: {unit.behaviour.name} between {unit.sides[0]} and {unit.sides[1]}"
    area = geometry.areas.sum()
    line = f"  interface {unit.name}: {unit.behaviour.name}, {geometry.n_point} points, area {area:.6g} {units['m2']}"
    if unit.behaviour.opens:
        gaps = dict.fromkeys(f"{gap:.4g}" for gap in (geometry.gap.min(), geometry.gap.max()))
        line += f", gap {' to '.join(gaps)} {units['m']}"
        if 0 < (closed := int((geometry.gap <= 0.0).sum())) < geometry.n_point:
            line += f", closed at {closed} of them"
        line += f" ({unit.note})" if unit.note else ""
    if geometry.traces[1] is not None:
        line += ", node against node" if geometry.matching else f", points of {unit.sides[geometry.owner]}"
    return line + (", found" if by_search else "")
