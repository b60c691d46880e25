"""``latin-fmu explain``: which effects a scene calls for, and what each costs."""

from __future__ import annotations

import argparse
import json

from . import CONVERGED
from .scene_arguments import AddParser, add_scene, read_scene


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "tell which effects a scene calls for, why, what each costs and what would switch it"
    add_scene(parser := add("explain", help=text, description=text.capitalize() + ". Nothing is solved."))
    parser.add_argument("--json", action="store_true", help="print JSON instead")
    parser.set_defaults(command=_explain)


def _explain(arguments: argparse.Namespace) -> int:
    from ..effects import explain

    scene = read_scene(arguments)
    told = explain(scene, arguments.scene.read_text(encoding="utf-8-sig"))
    print(json.dumps(told.report(), indent=2, allow_nan=False) if arguments.json else told.text())
    return CONVERGED
