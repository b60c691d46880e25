"""Command line ``latin-fmu``: parser, dispatch to ``commands``, and the exit code of every error.

Nothing prints but this module and ``commands``.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from .commands import (
    BAD_INPUT,
    CONVERGED,
    INTERRUPTED,
    SOLVER_FAILED,
    check,
    cost,
    explain,
    fmu,
    plot,
    reference,
    run,
    simulate,
    stress,
)
from .errors import InputError, LatinError

COMMANDS = (run, check, explain, cost, plot, fmu, simulate, stress, reference)

_EXAMPLES = """\
examples:
  latin-fmu check models/two_specimen_crushing/scene.toml
  latin-fmu explain models/two_specimen_crushing/scene.toml
  latin-fmu cost models/two_specimen_crushing/scene.toml -o study
  latin-fmu run models/beam_in_traction/scene.toml -o beam.nc
  latin-fmu run models/two_specimen_crushing/scene.toml --set interface.crush.friction_coefficient=0.3
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
    try:
        arguments = _parser().parse_args(argv)
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="latin-fmu",
        description="Impact of elastic bodies with frictional contact, by the LATIN method.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and stop")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.register(commands.add_parser)
    return parser


class _Version(argparse.Action):
    """Prints the version; looks it up only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from .results.dataset import package_version

        print(f"latin-fmu {package_version()}")
        parser.exit()
