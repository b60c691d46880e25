"""Command line ``latin-fmu``: parser, dispatch to ``commands``, and the exit code of every error.

Nothing prints but this module and ``commands``.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from types import MappingProxyType
from typing import Final

from . import __version__
from .commands import BAD_INPUT, CONVERGED, INTERRUPTED, SOLVER_FAILED
from .errors import InputError, LatinError

COMMANDS: Final = MappingProxyType(
    {
        "run": "run",
        "check": "describe",
        "explain": "describe",
        "plot": "describe",
        "reference": "describe",
        "cost": "studies",
        "stress": "studies",
        "fmu": "fmu",
        "simulate": "fmu",
    }
)
"""Module of ``commands`` that declares each subcommand."""

# What costs time at the start and serves nothing: threads of BLAS, of which the solver uses one (machine), and
# the search for plugins of pydantic in all installed packages
_ENVIRONMENT: Final = MappingProxyType({"OPENBLAS_NUM_THREADS": "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"})

_EXAMPLES = """\
examples:
  latin-fmu check models/two_specimen_crushing/scene.toml
  latin-fmu explain models/two_specimen_crushing/scene.toml
  latin-fmu cost models/two_specimen_crushing/scene.toml -o study
  latin-fmu run models/beam_in_traction/scene.toml -o beam.nc
  latin-fmu run models/two_specimen_crushing/scene.toml --set load.press.pressure=100e6
  latin-fmu plot beam.nc -o beam.png
  latin-fmu plot models/lap_joint/scene.toml -o assembly.png
  latin-fmu fmu models/two_specimen_crushing/scene.toml -o crushing.fmu
  latin-fmu simulate crushing.fmu -o out.csv
  latin-fmu stress --quick -o stability.md
  latin-fmu reference

exit codes: 0 converged, 1 not converged (results are written and marked), 2 bad input,
            3 the solver cannot continue, 130 interrupted
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line ``argv`` (default: that of the process) and return its exit code."""
    for variable, value in _ENVIRONMENT.items():
        os.environ.setdefault(variable, value)
    words = sys.argv[1:] if argv is None else list(argv)
    try:
        arguments = _parser(words).parse_args(words)
    except SystemExit as stop:  # argparse has printed the help, the version or what is wrong
        return stop.code if isinstance(stop.code, int) else BAD_INPUT
    try:
        code: int = arguments.command(arguments)
        sys.stdout.flush()
    except LatinError as error:
        print(f"latin-fmu: {error}", file=sys.stderr)
        return BAD_INPUT if isinstance(error, InputError) else SOLVER_FAILED
    except KeyboardInterrupt:
        print("latin-fmu: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone, e.g. `latin-fmu reference | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CONVERGED
    return code


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Parser of the subcommand that ``words`` begin with; of all where they begin otherwise."""
    parser = argparse.ArgumentParser(
        prog="latin-fmu",
        description="Impact of elastic bodies with frictional contact, by the LATIN method.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"latin-fmu {__version__}", help="print the version")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    named = COMMANDS.get(words[0]) if words else None
    for module in dict.fromkeys(COMMANDS.values()) if named is None else (named,):
        import_module(f".commands.{module}", __package__).register(commands.add_parser)
    return parser
