"""``latin-fmu check``: read and build a scene without solving it."""

from __future__ import annotations

import argparse

from . import CONVERGED
from .scene_arguments import AddParser, add_scene, read_scene


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "read a scene, build its meshes and interfaces, tell sizes and warnings"
    add_scene(parser := add("check", help=text, description=text.capitalize() + "."))
    parser.set_defaults(command=_check)


def _check(arguments: argparse.Namespace) -> int:
    from .. import api

    print("\n".join(api.check(read_scene(arguments))))
    return CONVERGED
