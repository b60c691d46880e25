"""``latin-fmu fmu``: a scene as an FMU, validated."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import BAD_INPUT, CONVERGED
from .scene_arguments import AddParser, add_scene, read_scene

_EXAMPLES = """\
examples:
  latin-fmu fmu scene.toml -o crushing.fmu --set "load.press.law={type='input'}"
  latin-fmu fmu scene.toml --fmi 3

A load with law = "input" becomes an input of the FMU; other loads keep their law.
"""


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "make an FMU of a scene for co-simulation, and validate it"
    parser = add(
        "fmu", help=text, description=text.capitalize() + ".", epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    add_scene(parser)
    parser.add_argument(
        "-o", "--output", metavar="X.fmu", type=Path, help="file to write (default: <name of the scene>.fmu)"
    )
    parser.add_argument("--fmi", choices=("2", "3"), default="2", help="version of the FMI (default: 2)")
    parser.set_defaults(command=_fmu)


def _fmu(arguments: argparse.Namespace) -> int:
    from importlib import import_module

    scene = read_scene(arguments)
    target = arguments.output or Path(f"{scene.name}.fmu")
    try:
        import_module("fmu_build.build").build_fmu(scene, target, arguments.fmi)
        problems = import_module("fmu_build.validate").validate(target)
    except ModuleNotFoundError as error:
        print(f"latin-fmu: {error.msg}; pip install 'latin-fmu[fmu]' gives what FMUs need")
        return BAD_INPUT
    if problems:
        print("\n".join([f"{target} is not valid:", *(f"  {problem}" for problem in problems)]))
        return BAD_INPUT
    print(f"FMU: {target} ({target.stat().st_size / 1e6:.1f} MB), valid")
    return CONVERGED
