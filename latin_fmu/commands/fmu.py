"""``latin-fmu fmu``: a scene as an FMU, validated."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import BAD_INPUT, CONVERGED
from .scene_arguments import AddParser, add_scene, read_scene

_EXAMPLES = """\
examples:
  latin-fmu fmu scene.toml -o crushing.fmu --set "load.press.law={type='input'}"
  latin-fmu fmu scene.toml --fmi 3 --inputs all --cross-check

A load with law = "input" becomes an input of the FMU, also one named by --inputs; other loads keep their law.
--cross-check puts X_in.csv, X_ref.csv and X_ref.opt (inputs, outputs, experiment) into the FMU and beside it, X being
the name of the scene: a load named by --inputs follows the law it had in the scene.
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
    parser.add_argument(
        "--inputs", metavar="LOAD,...", default="", help="loads that become inputs; 'all' for every load"
    )
    parser.add_argument(
        "--cross-check", action="store_true", help="solve the default experiment and give its results along"
    )
    parser.set_defaults(command=_fmu)


def _fmu(arguments: argparse.Namespace) -> int:
    from importlib import import_module

    from ..results.files import check_target, written_whole

    scene = read_scene(arguments)
    target = arguments.output or Path(f"{scene.name}.fmu")
    check_target(target)
    names = [name.strip() for name in arguments.inputs.split(",") if name.strip()]
    try:
        check = import_module("fmu_build.cross_check")
        inputs = check.with_inputs(scene, names)
        files: dict[str, bytes] = check.cross_check_files(inputs) if arguments.cross_check else {}
        inside = {f"{check.FOLDER}/{name}": content for name, content in files.items()}
        import_module("fmu_build.build").build_fmu(inputs.scene, target, arguments.fmi, inside)
        problems = import_module("fmu_build.validate").validate(target)
    except ModuleNotFoundError as error:
        print(f"latin-fmu: {error.msg}; pip install 'latin-fmu[fmu]' gives what FMUs need")
        return BAD_INPUT
    if problems:
        print("\n".join([f"{target} is not valid:", *(f"  {problem}" for problem in problems)]))
        return BAD_INPUT
    for name, content in files.items():
        with written_whole(target.with_name(name)) as draft:
            draft.write_bytes(content)
    print(
        f"FMU: {target} ({target.stat().st_size / 1e6:.1f} MB), valid{''.join(f', {n}' for n in sorted(files))}"
    )
    return CONVERGED
