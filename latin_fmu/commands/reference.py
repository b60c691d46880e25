"""``latin-fmu reference``: every key of a scene file."""

from __future__ import annotations

import argparse
import json

from . import CONVERGED
from .scene_arguments import AddParser


def register(add: AddParser) -> None:
    """Declare the subcommand."""
    text = "print every key of a scene file, with units and defaults"
    parser = add("reference", help=text, description=text.capitalize() + ".")
    parser.add_argument("--schema", action="store_true", help="print the JSON schema instead")
    parser.set_defaults(command=_reference)


def _reference(arguments: argparse.Namespace) -> int:
    from ..scene.reference import reference_schema, reference_text

    print(json.dumps(reference_schema(), indent=2) if arguments.schema else reference_text())
    return CONVERGED
