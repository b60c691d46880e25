"""Subcommands of ``latin-fmu``: functions whose parameters are the options of the command line (``options``).

A subcommand prints, and returns one of the exit codes below; ``cli`` turns what it does not handle (bad input, an
interruption) into an exit code. A subcommand imports what it needs when it runs, so that
``--help`` stays immediate. Work of several seconds shows elapsed and remaining time.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Self, TextIO

from ..errors import InputError
from .options import FROM_CALLER, Argument, Option

if TYPE_CHECKING:
    from ..latin.processes import Processes
    from ..scene.schema import Scene


PATIENCE: Final = 3.0
"""Time before the first line of progress is shown, s."""
_AGAIN_ON_TERMINAL, _AGAIN_IN_LOG = 0.5, 10.0  # seconds between two lines: a log is read afterwards


class Line:
    """A line of a stream that is refreshed in place on a terminal, and a line each time elsewhere."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.terminal = stream.isatty()
        self._width = 0

    def write(self, text: str) -> None:
        """Show ``text`` in the place of what is there."""
        if self.terminal:
            # padded to the width of the last text, so that nothing of it is left
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def clear(self) -> None:
        """Clear the refreshed line; does nothing elsewhere."""
        if self.terminal and self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()
            self._width = 0


class Waiting:
    """Context in which a thread shows the present work, its time so far, and the time left where it can be estimated.

    Nothing is shown in the first ``PATIENCE`` seconds.

    Parameters
    ----------
    text : the work. seconds : it is expected to take, None where this is not known. quiet : show nothing.
    stream : stderr where None. clock : seconds from any origin.
    """

    def __init__(
        self,
        text: str,
        seconds: float | None = None,
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._text = text
        self._seconds = seconds
        self._quiet = quiet
        self._clock = clock
        if stream is None:
            self._stream = sys.stderr
        else:
            self._stream = stream
        self._line = Line(self._stream)
        self._since, self._share = clock(), 0.0
        self._over, self._lock = threading.Event(), threading.Lock()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        if not self._quiet:
            # a daemon: an error that ends the process does not wait for it
            self._thread = threading.Thread(target=self._show, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Clear the line, and show nothing more."""
        # wakes the thread at once; the line is cleared when it writes no more
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        self._line.clear()

    def reached(self, share: float, text: str | None = None) -> None:
        """``share`` of the work is done; ``text``: what is being done now."""
        self._share, self._text = share, self._text if text is None else text

    def log(self, text: str) -> None:
        """Print a line that stays."""
        if not self._quiet:
            # the thread writes the same line
            with self._lock:
                self._line.clear()
                self._stream.write(text + "\n")
                self._stream.flush()

    def line(self) -> str | None:
        """The line to show now, None within the first seconds."""
        passed = self._clock() - self._since
        if passed < PATIENCE:
            return None
        # by the share that is done, if any, else by the time foreseen
        whole, remainder = self._seconds, None
        if self._share > 0.0:
            whole = passed / self._share
        if whole is not None:
            remainder = max(whole - passed, 0.0)
        return f"{self._text}: {_amount(passed)} so far{_left(remainder)}"

    def _show(self) -> None:
        if self._line.terminal:
            again = _AGAIN_ON_TERMINAL
        else:
            again = _AGAIN_IN_LOG
        wait = PATIENCE
        while not self._over.wait(wait):
            with self._lock:
                if (text := self.line()) is not None:
                    self._line.write(text)
            wait = again


class Progress(Waiting):
    """Waiting for a run: its set-up, and from the first call of ``update`` on its windows and their time left.

    Parameters
    ----------
    tolerance : value of sqrt(eta) at which a window is done; used to predict the end of a single window.
    quiet, stream, clock : as of ``Waiting``.
    """

    def __init__(
        self,
        tolerance: float,
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__("set-up", None, quiet, stream, clock)
        self._tolerance = tolerance
        self._state: tuple[int, int, int, float] | None = None  # of the last call, in one piece: a thread reads it
        self._origin = (0.0, 0)  # time and windows done at the first call: the set-up does not count
        self._first: tuple[float, float] | None = None  # time and log10 of the first error of a single window

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """Note ``done`` of ``total`` windows as finished, and the state of the current one.

        ``iteration`` counts from 1 in the current window and ``error`` is its sqrt(eta); 0 in the march of derivatives.
        """
        # windows of a run that was continued are done already; derivatives, and runs that check them, begin anew: the
        # rate counts from here
        if self._state is None or (iteration == 0) != (self._state[2] == 0) or done < self._state[0]:
            self._origin = (self._clock(), done)
        if total == 1 and self._first is None and 0.0 < error < math.inf:
            self._first = (self._clock(), math.log10(error))
        self._state = done, total, iteration, error

    def line(self) -> str | None:
        """The line to show now, None within the first seconds."""
        if self._state is None or self._clock() - self._since < PATIENCE:
            return super().line()
        done, total, iteration, error = self._state
        begun, before = self._origin
        remainder = None
        if done > before:
            remainder = (self._clock() - begun) * (total - done) / (done - before)
        if iteration == 0:
            return f"derivatives: {100 * done // max(total, 1)} % ({done} of {total} instants){_left(remainder)}"
        if total == 1:
            text, remainder = f"iteration {iteration}", self._single_window_left(error)
        else:
            text = f"{100 * done // max(total, 1)} % ({done} of {total} windows), iteration {iteration}"
        return f"{text}, sqrt(eta) {error:.1e}{_left(remainder)}"

    def _single_window_left(self, error: float) -> float | None:
        """Extrapolates log(error), which falls about linearly with the iterations, to the tolerance."""
        if self._first is None or not (0.0 < error < math.inf and self._tolerance > 0.0):
            return None
        since, at_first = self._first
        fallen, passed = at_first - math.log10(error), self._clock() - since
        if fallen <= 0.0 or passed <= 0.0:
            return None
        # as many seconds a decade as so far
        return max(0.0, (math.log10(error) - math.log10(self._tolerance)) * passed / fallen)


def _left(seconds: float | None) -> str:
    if seconds is None:
        return ""
    return f", about {_amount(seconds)} left"


def _amount(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"


CONVERGED = 0
NOT_CONVERGED = 1
BAD_INPUT = 2
SOLVER_FAILED = 3
NOT_WRITTEN = 4
NO_MEMORY = 5
REMARKED = 6
LIMITED = 7
"""Exit codes; CONVERGED also means "done" for a subcommand that solves nothing, REMARKED comes with ``--strict``,
LIMITED with ``--max-cpu``."""

Json = Annotated[bool, Option("print JSON, and nothing else, on stdout")]
Quiet = Annotated[bool, Option("no progress", flags="-q")]
Strict = Annotated[bool, Option(f"exit code {REMARKED} if there are warnings; no other effect")]
Jobs = Annotated[int | None, Option("processes, one thread each (default: as many as there are cores)", "N")]
Scheduler = Annotated[
    str | None, Option("solve on the workers of this dask scheduler (needs latin-fmu[cluster])", "ADDRESS")
]
"""Options of several commands."""

_TWICE: Final = (signal.SIGINT, signal.SIGTERM)  # of which a second one interrupts at once
_MORE_SIGNALS: Final = ("SIGHUP", "SIGQUIT", "SIGXCPU", "SIGUSR1")


class StopSignals:
    """Signals that end the process: they interrupt (KeyboardInterrupt), or are noted where this is deferred.

    SIGINT and SIGTERM; SIGHUP (a terminal that is closed), SIGQUIT, and those that batch systems send before a limit,
    SIGXCPU and SIGUSR1, unless the process has been told to ignore them (``nohup``).

    Attributes
    ----------
    received : number of the signal that came first, 0 before. noted : whether the first signal is only noted; a second
        SIGINT or SIGTERM interrupts (SIGXCPU comes again every second).
    """

    def __init__(self) -> None:
        self.received, self.noted = 0, False

    @property
    def exit_code(self) -> int:
        """Exit code of a process that a signal ended: 128 and its number, 130 after SIGINT, 143 after SIGTERM."""
        return 128 + (self.received or signal.SIGINT)

    @contextmanager
    def handled(self) -> Iterator[None]:
        """Handle the signals; those of other threads than the main one cannot be."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        more = [getattr(signal, name) for name in _MORE_SIGNALS if hasattr(signal, name)]
        # ignored signals stay ignored
        heard = [*_TWICE, *(number for number in more if signal.getsignal(number) is not signal.SIG_IGN)]
        before = {number: signal.signal(number, self._handle) for number in heard}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Interrupt at the end only, e.g. of imports, which must not be torn apart."""
        self.noted = True
        try:
            yield
        finally:
            self.noted = False
        if self.received:
            raise KeyboardInterrupt

    def _handle(self, number: int, _frame: object) -> None:
        # the first signal is kept: it names the exit code
        first, self.received = not self.received, self.received or number
        if not (self.noted and (first or number not in _TWICE)):
            raise KeyboardInterrupt


Signals = Annotated[StopSignals, FROM_CALLER]
"""Parameter of a command that asks what has been received."""

_STARTED: Final = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "PMIX_SIZE")
"""Variables in which starters of MPI give the number of processes."""
_BETWEEN: Final = 0.3  # s between the sentences of processes that fail


def started_together() -> Processes | None:
    """The processes that ``mpiexec`` has started with this one; None where it is alone.

    Raises
    ------
    InputError : there are several, and mpi4py or the library of MPI is missing.
    """
    counts = [os.environ.get(name, "") for name in _STARTED]
    if not any(count.isdigit() and int(count) > 1 for count in counts):
        return None
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError) as error:
        heading, remedy = "the run cannot be distributed over processes", "pip install latin-fmu[mpi]"
        raise InputError.of(heading, "mpiexec", str(error), remedy=remedy) from None
    from ..latin.processes import Processes

    if MPI.COMM_WORLD.Get_size() == 1:
        return None
    processes = Processes(MPI.COMM_WORLD)

    def end_all(*error: Any) -> None:
        """Print an unexpected error and end all processes; the others would wait for this one."""
        sys.__excepthook__(*error)
        processes.abort(SOLVER_FAILED)

    sys.excepthook = end_all
    return processes


@contextmanager
def ending_together(processes: Processes, signals: StopSignals) -> Iterator[None]:
    """Context in which an error of one process ends all of them, with its sentence and an exit code above 0."""
    try:
        yield
    except BaseException as error:
        if processes.ended:  # every process has the error: process 0 prints it
            if processes.rank:
                sys.stderr = io.StringIO()
            raise
        time.sleep(_BETWEEN * processes.rank)  # one sentence is enough where all of them fail
        if isinstance(error, KeyboardInterrupt):
            text = "interrupted"
        else:
            text = str(error) or type(error).__name__
        print(f"latin-fmu: process {processes.rank} of {processes.size}: {text}", file=sys.stderr, flush=True)
        if isinstance(error, MemoryError):
            code = NO_MEMORY
        else:
            code = SOLVER_FAILED
        processes.abort(signals.exit_code if signals.received else code)


@dataclass(frozen=True, kw_only=True)
class OfScene:
    """Options of a command that takes a scene."""

    scene: Annotated[Path, Argument("scene file (TOML)", "SCENE")]
    overrides: Annotated[
        tuple[str, ...], Option("change one setting of the scene; may be repeated", "a.b.c=value", "--set")
    ] = ()
    no_limit: Annotated[bool, Option("no limits of CPU time and memory for libraries that read mesh files")] = False

    def read_scene(self) -> Scene:
        """The scene that SCENE names, with the settings of ``--set``."""
        from ..reader import load_scene

        if self.no_limit:
            from ..mesh_files.child import NO_LIMIT

            os.environ[NO_LIMIT] = "0"  # of the processes of a study, too
        return load_scene(self.scene, self.overrides)


def tell(as_json: bool, lines: Sequence[str], data: Callable[[], Mapping[str, Any]]) -> None:
    """Print what was found on stdout: lines of text, or with ``--json`` its data."""
    print(json_lines(data()) if as_json else "\n".join(lines))


def tell_written(as_json: bool, text: str) -> None:
    """Print a line on files that were written; on stderr beside JSON."""
    (say if as_json else print)(text)


def seconds(text: str) -> float:
    """A length of time, s.

    Raises
    ------
    argparse.ArgumentTypeError : it is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a duration: give a number of seconds > 0")
    return value


def output_file(text: str) -> Path:
    """Path of a file to be written.

    Raises
    ------
    argparse.ArgumentTypeError : the text names a folder.
    """
    if text.endswith(("/", os.sep)):
        raise argparse.ArgumentTypeError(f"{text!r} names a folder; name a file in it")
    return Path(text)


def check_netcdf(output: Path) -> None:
    """Make sure that an output in netCDF has no suffix of another format.

    Raises
    ------
    InputError : it has.
    """
    if output.suffix.lower() not in ("", *_NETCDF):
        what = f"results are written as netCDF (.nc), not as {output.suffix}"
        remedy = "name OUT.nc; plot OUT.nc -o FIGURE.png draws it, latin_fmu.open_results reads it in Python"
        raise InputError.of("bad argument", "--output", what, str(output), remedy=remedy)


_NETCDF: Final = (".nc", ".nc4", ".cdf", ".netcdf", ".h5")


def say(text: str) -> None:
    """Print a line on stderr, where people read what is no result."""
    print(text, file=sys.stderr, flush=True)


def json_lines(data: Mapping[str, Any]) -> str:
    """Strict JSON with one key a line: the count of iterations of a thousand windows stays on one."""
    lines = (f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in data.items())
    return "{\n" + ",\n".join(lines) + "\n}"
