"""Command line ``latin-fmu``: parser, dispatch to ``commands``, and the exit code of every error.

Nothing prints but this module and ``commands``.
"""

from __future__ import annotations

import argparse
import errno
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Final, TextIO

from . import __version__
from .commands import BAD_INPUT, NO_MEMORY, NOT_WRITTEN, SOLVER_FAILED, StopSignals, say
from .commands.options import Command, CommandParser, function_name
from .errors import InputError, LatinError, ResultsError, did_you_mean

COMMANDS: Final = MappingProxyType(
    {
        "run": "run",
        "check": "describe",
        "explain": "describe",
        "import": "decks",
        "mesh": "cad",
        "scene": "cad",
        "plot": "describe",
        "view": "describe",
        "report": "report",
        "reference": "describe",
        "demo": "describe",
        "cost": "studies",
        "stress": "studies",
        "sweep": "studies",
        "random": "random",
        "calibrate": "studies",
        "fmu": "fmu",
        "simulate": "fmu",
        "srs": "analyses",
        "base": "base",
        "envelope": "base",
        "export": "analyses",
        "modes": "analyses",
        "frf": "analyses",
        "backbone": "analyses",
    }
)
"""Module of ``commands`` with the function of each subcommand."""

# What costs time at the start and serves nothing: threads of BLAS, of which the solver uses one (machine), and
# the search for plugins of pydantic in all installed packages
_ENVIRONMENT: Final = MappingProxyType({"OPENBLAS_NUM_THREADS": "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"})

_EXAMPLES = """\
examples:
  latin-fmu demo two_specimen_crushing
  latin-fmu check two_specimen_crushing/scene.toml
  latin-fmu explain two_specimen_crushing/scene.toml
  latin-fmu run two_specimen_crushing/scene.toml -o crushing.nc
  latin-fmu plot crushing.nc -o crushing.png
  latin-fmu plot two_specimen_crushing/scene.toml -o assembly.png
  latin-fmu view crushing.nc
  latin-fmu run two_specimen_crushing/scene.toml --set load.press.pressure=100e6
  latin-fmu import bracket.inp
  latin-fmu mesh bracket.step
  latin-fmu scene bracket.msh
  latin-fmu cost two_specimen_crushing/scene.toml -o study
  latin-fmu sweep two_specimen_crushing/scene.toml --vary interface.crush.friction_coefficient=0:0.6:13
  latin-fmu calibrate scene.toml shock.csv --fit bolt.m6.force --fit interface.lap.friction_coefficient
  latin-fmu fmu two_specimen_crushing/scene.toml -o crushing.fmu
  latin-fmu simulate crushing.fmu -o out.csv
  latin-fmu stress --quick -o stability.md
  latin-fmu srs out.nc --sensor tip
  latin-fmu base spec.csv -o shock
  latin-fmu modes scene.toml --joints open
  latin-fmu frf scene.toml --damping 0.02
  latin-fmu backbone scene.toml --mode 1 --amplitude 1um:1mm
  latin-fmu reference

exit codes: 0 converged, 1 not converged or not trustworthy (results are marked), 2 bad input,
            3 the solver cannot continue, 4 an output could not be written to its path (stderr gives the other path),
            5 insufficient memory, 6 there are warnings (run, check and explain with --strict),
            7 stopped by --max-cpu (results so far are written and marked),
            128 + the number of a signal that ended it (130 interrupted, 143 terminated)
"""
_LESS = "use a coarser mesh, fewer instants or fewer outputs; `latin-fmu check` prints the memory that a scene needs"

_NO_MEMORY = ("cannot allocate memory", "failed to map segment")  # of the system, and of its loader of libraries
_LIBRARIES = 400_000_000  # bytes of address space: a run of a small scene takes 330 to 350 MB
_INPUTS = ("scene", "scenes", "results", "file", "fmu", "input", "data")  # arguments that name a file which is read


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line ``argv`` (default: that of the process) and return its exit code."""
    for variable, value in _ENVIRONMENT.items():
        os.environ.setdefault(variable, value)
    signals = StopSignals()
    with _streams(), signals.handled(), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # absurd numbers overflow, which ends in an error or a status
        try:
            return _run(sys.argv[1:] if argv is None else list(argv), signals)
        except LatinError as error:
            return _told(str(error), _code(error))
        except KeyboardInterrupt:
            return _told("interrupted", signals.exit_code)
        except Exception as error:
            if signals.received:  # a library turned the interruption into an error of its own
                return _told("interrupted", signals.exit_code)
            if not _lacks_memory(error):
                raise
            return _told(f"insufficient memory: {str(error) or 'an array could not be created'}; {_LESS}", NO_MEMORY)


def _run(words: list[str], signals: StopSignals) -> int:
    """Parse and run a command."""
    _check_address_space()
    if words and words[0][0:1] not in ("", "-") and words[0] not in COMMANDS:
        allowed, remedy = ", ".join(COMMANDS), did_you_mean(words[0], COMMANDS)
        raise InputError.of("bad argument", words[0], "no command of this name", allowed=allowed, remedy=remedy)
    try:
        with signals.deferred():
            parser = _parser(words)
        arguments = parser.parse_args(words, argparse.Namespace(signals=signals))
    except SystemExit as stop:  # argparse has printed the help, the version or what is wrong
        if isinstance(stop.code, int):
            return stop.code
        return BAD_INPUT
    _check_paths(arguments)
    command: Command = arguments.command
    return command(arguments)


def _check_address_space() -> None:
    """Make sure that the libraries can be loaded: where its buffer does not fit, OpenBLAS tries for ever to get it.

    Raises
    ------
    MemoryError : a limit (``ulimit -v``) below what they take.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < _LIBRARIES:
        taken = f"{_LIBRARIES / 1e6:.0f} MB of address space"
        raise MemoryError(f"loading the libraries takes {taken}, allowed: {limit / 1e6:.0f} MB (RLIMIT_AS, ulimit -v)")
    if limit != resource.RLIM_INFINITY:
        _take_buffers()


def _take_buffers() -> None:
    """Have OpenBLAS take its buffers, of NumPy and of SciPy each, while there is room: with the first large product."""
    import numpy as np
    from scipy.linalg.blas import dgemm

    large = np.ones((256, 256))
    dgemm(1.0, large, large @ large)


def _check_paths(arguments: argparse.Namespace) -> None:
    """Make sure that there is a current folder, and that the output does not take the place of an input."""
    try:
        Path.cwd()
    except OSError as error:
        what = f"cannot be used: {error.strerror or error}"
        raise InputError.of(
            "bad surroundings", "current folder", what, remedy="change to a folder that exists"
        ) from None
    output: Path | None = getattr(arguments, "output", None)
    if output is None or not output.is_file():
        return
    for name in _INPUTS:
        value = getattr(arguments, name, None)
        for path in value if isinstance(value, list) else [value]:
            if path is not None and path.is_file() and output.samefile(path):
                what = "this file is an input, the output would replace it"
                raise InputError.of("bad argument", str(output), what, remedy="name another file")


def _code(error: LatinError) -> int:
    """Exit code of an error of the package."""
    if isinstance(error, ResultsError):
        from .results.writing import UnwrittenError  # loaded where there are results

        if isinstance(error, UnwrittenError):
            return NOT_WRITTEN
        return BAD_INPUT
    if isinstance(error, InputError):
        return BAD_INPUT
    return SOLVER_FAILED


def _told(text: str, code: int) -> int:
    """The exit code, after ``text`` has gone to stderr."""
    say(f"latin-fmu: {text}")
    return code


def _lacks_memory(error: BaseException | None) -> bool:
    """Whether an error, or one that it follows from, is a lack of memory; libraries report it in different ways."""
    while error is not None:
        if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
            return True
        if any(text in str(error).lower() for text in _NO_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


class _Output(io.TextIOBase):
    """Text stream that may be closed, full or without a reader: what cannot be written is dropped, and nothing else
    happens."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        self._attempt(lambda stream: stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._attempt(lambda stream: stream.flush())

    def isatty(self) -> bool:
        return self._stream is not None and not self._stream.closed and self._stream.isatty()

    def fileno(self) -> int:
        if self._stream is None:
            raise io.UnsupportedOperation("fileno")
        return self._stream.fileno()

    def _attempt(self, action: Callable[[TextIO], object]) -> None:
        if self._stream is None or self._stream.closed:
            return
        try:
            action(self._stream)
        except OSError:
            failed, self._stream = self._stream, None
            with suppress(OSError, ValueError):  # what is left in its buffer must not fail when the process ends
                os.dup2(os.open(os.devnull, os.O_WRONLY), failed.fileno())


@contextmanager
def _streams() -> Iterator[None]:
    """Standard streams whose failure changes nothing: a closed descriptor would be given to the next file opened."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Output(before[0]), _Output(before[1])
    try:
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        sys.stdout, sys.stderr = before


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Parser of the subcommand that ``words`` begin with; of all where they begin otherwise."""
    parser = argparse.ArgumentParser(
        prog="latin-fmu",
        description="Impact of elastic bodies with frictional contact, by the LATIN method.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    version = f"latin-fmu {__version__}"
    parser.add_argument("-V", "--version", action="version", version=version, help="print the version")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=CommandParser)
    for name in words[:1] if words and words[0] in COMMANDS else COMMANDS:
        module = import_module(f".commands.{COMMANDS[name]}", __package__)
        command: Command = getattr(module, function_name(name))
        command.declare(commands.add_parser)
    return parser
