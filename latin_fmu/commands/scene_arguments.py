"""The arguments of every subcommand that works on a scene."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..scene.schema import Scene

AddParser = Callable[..., argparse.ArgumentParser]
"""``add_parser`` of the subcommands of a parser."""


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Declare SCENE and ``--set``."""
    parser.add_argument("scene", metavar="SCENE", type=Path, help="scene file (TOML)")
    parser.add_argument(
        "--set",
        metavar="a.b.c=value",
        action="append",
        default=[],
        dest="overrides",
        help="change one setting of the scene; may be repeated",
    )


def read_scene(arguments: argparse.Namespace) -> Scene:
    """The scene the arguments name, with their changes."""
    from ..scene.reader import load_scene

    return load_scene(arguments.scene, arguments.overrides)
