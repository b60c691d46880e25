"""Checks of faces named in a scene: their substructure exists, and a box has the face."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ..errors import Problem, did_you_mean, shown
from .fields import ALL_OF_IT, NAME_PATTERN
from .raw_scene import given, named_tables, parsed_face
from .substructures import BOX_FACES

_MAX_LISTED = 12


def unknown_name(where: str, kind: str, name: str, known: Iterable[str]) -> Problem:
    """The problem of a name that no table has."""
    names = sorted(name for name in known if NAME_PATTERN.fullmatch(name))
    listed = ", ".join(names[:_MAX_LISTED]) + (", ..." if len(names) > _MAX_LISTED else "")
    return Problem(where, f"no {kind} of this name", shown(name), listed, did_you_mean(name, names))


def face_problems(raw: Any, where: str, face: str) -> Iterator[Problem]:
    """What is wrong with the face ``"substructure.face"``; faces of mesh files are checked with the mesh."""
    parsed = parsed_face(face)
    substructures = named_tables(raw, "substructure")
    if parsed is None or not substructures:
        return
    substructure, name = parsed
    if substructure not in substructures:
        known = [f"{other}.{name}" for other in substructures]
        problem = unknown_name(where, "substructure", substructure, substructures)
        close = did_you_mean(substructure, substructures)
        yield (
            problem
            if close is None
            else Problem(where, problem.what, shown(face), problem.allowed, did_you_mean(face, known) or close)
        )
    elif is_box(raw, substructure) and name not in (*BOX_FACES, ALL_OF_IT):
        yield Problem(
            where,
            f"the box {substructure!r} has no face of this name",
            shown(face),
            ", ".join(BOX_FACES),
            did_you_mean(name, BOX_FACES),
        )


def is_box(raw: Any, substructure: str) -> bool:
    """True for a substructure written as a box only."""
    table = named_tables(raw, "substructure").get(substructure, {})
    return given(table, "box") and not given(table, "mesh")
