"""Subcommands of ``latin-fmu``: each module declares its own with ``register``.

A subcommand takes the parsed arguments, prints, and returns one of the exit codes below; ``cli`` turns what it does
not handle (bad input, an interruption) into an exit code. A subcommand imports what it needs when it runs, so that
``--help`` stays immediate.
"""

from __future__ import annotations

import argparse
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..scene.schema import Scene

CONVERGED, NOT_CONVERGED, BAD_INPUT, SOLVER_FAILED, NOT_WRITTEN, NO_MEMORY = 0, 1, 2, 3, 4, 5
"""Exit codes; CONVERGED also means "done" for a subcommand that solves nothing."""

AddParser = Callable[..., argparse.ArgumentParser]
"""``add_parser`` of the subcommands of a parser."""

Command = Callable[[argparse.Namespace], int]


class Signals:
    """SIGINT and SIGTERM of the process: they interrupt (KeyboardInterrupt), or are noted where this is deferred.

    Attributes
    ----------
    received : number of the signal that came first, 0 before. noted : whether the first signal is only noted; a second
        one interrupts.
    """

    def __init__(self) -> None:
        self.received, self.noted = 0, False

    @property
    def exit_code(self) -> int:
        """Exit code of a process that a signal ended: 130 after SIGINT, 143 after SIGTERM."""
        return 128 + (self.received or signal.SIGINT)

    @contextmanager
    def handled(self) -> Iterator[None]:
        """Handle the signals; those of other threads than the main one cannot be."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._handle) for number in (signal.SIGINT, signal.SIGTERM)}
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
        first, self.received = not self.received, self.received or number
        if not (first and self.noted):
            raise KeyboardInterrupt


def declare(
    add: AddParser, name: str, text: str, command: Command, examples: str | None = None
) -> argparse.ArgumentParser:
    """Parser of the subcommand ``name`` that ``command`` runs; ``text`` is its help, ``examples`` stand below it."""
    parser = add(
        name,
        help=text,
        description=text[0].upper() + text[1:] + ".",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter if examples else argparse.HelpFormatter,
    )
    parser.set_defaults(command=command)
    return parser


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Declare SCENE and ``--set``."""
    parser.add_argument("scene", metavar="SCENE", type=Path, help="scene file (TOML)")
    add_settings(parser, "change one setting of the scene; may be repeated")


def add_settings(parser: argparse.ArgumentParser, text: str) -> None:
    """Declare ``--set`` with its help ``text``."""
    parser.add_argument("--set", metavar="a.b.c=value", action="append", default=[], dest="overrides", help=text)


def output_file(text: str) -> Path:
    """Path of a file to be written.

    Raises
    ------
    argparse.ArgumentTypeError : the text names a folder.
    """
    if text.endswith(("/", os.sep)):
        raise argparse.ArgumentTypeError(f"{text!r} names a folder; name a file in it")
    return Path(text)


def read_scene(arguments: argparse.Namespace) -> Scene:
    """The scene that SCENE names, with the settings of ``--set``."""
    from ..reader import load_scene

    return load_scene(arguments.scene, arguments.overrides)
