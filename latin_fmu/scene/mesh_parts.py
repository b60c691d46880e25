"""Table [mesh.NAME]: one file with many parts, written out as one [substructure.PART] for each of them.

The parts that a scene says nothing else about need no table of their own; a table [substructure.PART] holds what
differs. Reading the file is left to ``mesh_files``; the effective scene has substructures only.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError

from ..errors import MeshError, Problem
from ..mesh_files.content import MeshContent, listed
from ..mesh_files.reading import read_content
from .fields import GROUND, Name, Real, Table, Text, _as_list, about, refusal
from .raw_scene import given, named_tables
from .wording import shown

ALL = "*"


def _all_or_listed(value: object) -> object:
    if isinstance(value, str) and value != ALL:
        raise refusal(
            "must be a list of volume groups, or all of them", value=value, allowed='"*", or e.g. ["bolt", "nut"]'
        )
    return (ALL,) if value == ALL else _as_list(value)


class MeshParts(Table):
    """A mesh file with several parts: every volume group, or each group listed, becomes a substructure of its name."""

    file: Annotated[Text, about("mesh file, relative to the scene file (.msh, .inp, .bdf, .e, .vtu, .med ...)")]
    scale: Annotated[Real, about("length of one file unit (1e-3 for a mesh in mm)", "m", gt=0)] = 1.0
    parts: Annotated[
        tuple[Text, ...],
        BeforeValidator(_all_or_listed),
        about('volume groups that become substructures; "*": all of them that share the cells out'),
        Field(min_length=1),
    ] = (ALL,)
    material: Annotated[Name | None, about("material of the parts whose [substructure.PART] names none")] = None


def part_name(group: str) -> str:
    """Name of the substructure made of a volume group: what no name may hold becomes an underscore."""
    name = re.sub("[^A-Za-z0-9_]", "_", group)
    if not name[:1].isalpha():
        name = f"part_{name}"
    return f"{name}_" if name == GROUND else name[:100]


def with_parts(raw: Any, base_dir: Path) -> tuple[Any, list[Problem]]:
    """The scene with the parts of its mesh files as substructures and without [mesh.NAME]; what is wrong with them.

    A scene with problems comes back as it was, and so does one with wrong fields in [mesh.NAME], which are told where
    the fields are checked.
    """
    written = named_tables(raw, "mesh")
    own = raw.get("substructure", {}) if written else None
    if not isinstance(own, Mapping):
        return raw, []
    tables = {name: table for name, item in written.items() if (table := _checked(item)) is not None}
    problems: list[Problem] = []
    found: dict[str, Any] = {}
    owner: dict[str, str] = {}
    for name, table in tables.items():
        for part, group in _parts(name, table, base_dir, problems).items():
            if part in owner:
                what = f"the part {part!r} is in mesh.{owner[part]} too"
                problems.append(Problem(f"mesh.{name}.parts", what, remedy="list the parts of each file"))
                continue
            owner[part] = name
            found[part] = _substructure(part, group, table, own.get(part), problems)
    if problems or len(tables) < len(raw["mesh"]):
        return raw, problems
    rest = {name: table for name, table in own.items() if name not in found}
    files = ", ".join(table.file for table in tables.values())
    problems = [
        Problem(
            f"substructure.{name}",
            f"no part of this name in {files}",
            None,
            listed(found),
            "give it a box or a mesh of its own, or one of these names",
        )
        for name, table in rest.items()
        if isinstance(table, Mapping) and not given(table, "box") and not given(table, "mesh")
    ]
    if problems:
        return raw, problems
    whole = {key: value for key, value in raw.items() if key != "mesh"}
    return {**whole, "substructure": {**found, **rest}}, []


def _checked(table: Mapping[str, Any]) -> MeshParts | None:
    """The table, None where a field of it is wrong."""
    try:
        return MeshParts.model_validate(dict(table))
    except ValidationError:
        return None


def _parts(name: str, table: MeshParts, base_dir: Path, problems: list[Problem]) -> dict[str, str | None]:
    """Volume group of every part by the name of its substructure (None: the whole file, which names no group)."""
    try:
        content = read_content(base_dir / table.file)
        if table.parts != (ALL,):
            groups = _listed_groups(name, table, content, problems)
        elif not content.solids:
            problems.append(Problem(f"mesh.{name}.file", "the file holds no solid cells", table.file))
            return {}
        elif not (groups := list(content.part_names(table.file))):
            return {part_name(name): None}
    except MeshError as error:
        where = f"mesh.{name}.file"
        problems += [Problem(where, f"{p.where}: {p.what}", p.value, p.allowed, p.remedy) for p in error.problems]
        return {}
    parts: dict[str, str | None] = {}
    for group in groups:
        part = part_name(group)
        if part in parts:
            what = "two volume groups make the same name of a substructure"
            both = f"{parts[part]}, {group}"
            problems.append(Problem(f"mesh.{name}.parts", what, both, remedy="rename one of them, or list one"))
        parts[part] = group
    return parts


def _listed_groups(name: str, table: MeshParts, content: MeshContent, problems: list[Problem]) -> list[str]:
    """Groups that are listed as parts, by the name in the file or the one of the substructure."""
    by_name = {part_name(group): group for group in content.volumes}
    groups = []
    for i, text in enumerate(table.parts):
        group = text if text in content.volumes else by_name.get(text)
        if group is None:
            where = f"mesh.{name}.parts[{i}]"
            problems.append(Problem(where, "no such volume group", shown(text), listed(content.volumes)))
        else:
            groups.append(group)
    return groups


def _substructure(part: str, group: str | None, table: MeshParts, own: Any, problems: list[Problem]) -> Any:
    """The table of a part: material and mesh of the file, then what [substructure.PART] says."""
    mesh: dict[str, Any] = {"file": table.file, "scale": table.scale}
    if group is not None:
        mesh["group"] = group
    default = {} if table.material is None else {"material": table.material}
    if own is None:
        return {**default, "mesh": mesh}
    if not isinstance(own, Mapping):
        return own  # the check of the fields says what it must be
    for key in ("box", "mesh"):
        if given(own, key):
            what = "this part has its mesh from a file with many parts"
            remedy = f"leave this key out, or the group {group!r} out of the parts of that file"
            problems.append(Problem(f"substructure.{part}.{key}", what, remedy=remedy))
    return {**default, **own, "mesh": mesh}
