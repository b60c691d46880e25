"""Subcommands of ``latin-fmu``: each module declares its own with ``register``.

A subcommand takes the parsed arguments, prints, and returns one of the exit codes below; ``cli`` turns what it does
not handle (bad input, an interruption) into an exit code. A subcommand imports what it needs when it runs, so that
``--help`` stays immediate.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..scene.schema import Scene

CONVERGED, NOT_CONVERGED, BAD_INPUT, SOLVER_FAILED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit codes; CONVERGED also means "done" for a subcommand that solves nothing."""

AddParser = Callable[..., argparse.ArgumentParser]
"""``add_parser`` of the subcommands of a parser."""

Command = Callable[[argparse.Namespace], int]


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


def read_scene(arguments: argparse.Namespace) -> Scene:
    """The scene that SCENE names, with the settings of ``--set``."""
    from ..reader import load_scene

    return load_scene(arguments.scene, arguments.overrides)
