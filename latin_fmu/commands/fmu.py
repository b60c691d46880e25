"""``latin-fmu fmu``: a scene as an FMU, validated."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError, Problem
from . import BAD_INPUT, CONVERGED
from .scene_arguments import AddParser, add_scene, read_scene

_EXAMPLES = """\
examples:
  latin-fmu fmu scene.toml -o crushing.fmu --set "load.press.law={type='input'}"
  latin-fmu fmu scene.toml --fmi 3 --inputs all --cross-check
  latin-fmu fmu scene.toml --model-exchange --modes 20

A load with law = "input" becomes an input of the FMU, also one named by --inputs; other loads keep their law.
Energies are outputs where the scene says output.energy = true (--set output.energy=true).
--cross-check puts X_in.csv, X_ref.csv and X_ref.opt (inputs, outputs, experiment) into the FMU and beside it, X being
the name of the scene: a load named by --inputs follows the law it had in the scene.
--model-exchange makes a reduced model of the scene (a few modes per body, regularised contact) with the states and
events of FMI 3 Model Exchange, for a cross-check by another integrator; co-simulation solves the scene itself.
"""


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "make an FMU of a scene for co-simulation (or of a reduced model for model exchange), and validate it"
    parser = add(
        "fmu",
        help=text,
        description=text.capitalize() + ".",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_scene(parser)
    parser.add_argument(
        "-o", "--output", metavar="X.fmu", type=Path, help="file to write (default: <name of the scene>.fmu)"
    )
    parser.add_argument("--fmi", choices=("2", "3"), help="version of the FMI (default: 2; of a reduced model 3)")
    parser.add_argument(
        "--inputs", metavar="LOAD,...", default="", help="loads that become inputs; 'all' for every load"
    )
    parser.add_argument(
        "--cross-check", action="store_true", help="solve the default experiment and give its results along"
    )
    parser.add_argument(
        "--model-exchange", action="store_true", help="a reduced model as differential equations (FMI 3 only)"
    )
    parser.add_argument("--modes", metavar="N", type=int, help="reduced model: elastic modes per body (default: 12)")
    parser.add_argument("--patches", metavar="P", type=int, help="reduced model: patches per contact (default: 4)")
    parser.set_defaults(command=_fmu)


def _fmu(arguments: argparse.Namespace) -> int:
    from importlib import import_module

    from ..results.files import check_target, written_whole

    if problems := list(_contradictions(arguments)):
        raise InputError(problems, "the options contradict each other")
    scene = read_scene(arguments)
    target = arguments.output or Path(f"{scene.name}.fmu")
    check_target(target)
    names = [name.strip() for name in arguments.inputs.split(",") if name.strip()]
    try:
        check = import_module("fmu_build.cross_check")
        inputs = check.with_inputs(scene, names)
        files: dict[str, bytes] = check.cross_check_files(inputs) if arguments.cross_check else {}
        inside = {f"{check.FOLDER}/{name}": content for name, content in files.items()}
        if arguments.model_exchange:
            sizes = {"n_mode": arguments.modes, "n_patch": arguments.patches}
            given = {name: size for name, size in sizes.items() if size is not None}
            import_module("fmu_build.model_exchange").build_model_exchange(inputs.scene, target, **given)
        else:
            import_module("fmu_build.build").build_fmu(inputs.scene, target, arguments.fmi or "2", inside)
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
    print(f"FMU: {target} ({target.stat().st_size / 1e6:.1f} MB), valid{''.join(f', {n}' for n in sorted(files))}")
    return CONVERGED


def _contradictions(arguments: argparse.Namespace) -> Iterator[Problem]:
    if arguments.model_exchange and arguments.fmi == "2":
        yield Problem("--fmi", "model exchange needs FMI 3", "2", "3", "leave --fmi out")
    if arguments.model_exchange and arguments.cross_check:
        yield Problem("--cross-check", "belongs to co-simulation", remedy="leave --model-exchange out")
    for name in ("modes", "patches"):
        if getattr(arguments, name) is not None and not arguments.model_exchange:
            yield Problem(f"--{name}", "belongs to the reduced model", remedy="add --model-exchange")
