"""Reading a scene: a TOML file, or a dictionary of the same shape."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from .errors import MeshError, Problem, SceneError, listed, shown
from .scene.overrides import apply_overrides
from .scene.raw_scene import given, named_tables
from .scene.schema import Scene
from .scene.substructures import ALL, MeshParts, part_name

if TYPE_CHECKING:
    from .mesh_files.content import MeshContent

MAX_SCENE_BYTES = 100_000_000
MOST_LEVELS = 30  # of tables in tables


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read and check a scene file.

    path : TOML file.
    overrides : settings such as ``"solver.tolerance=1e-4"``, applied in order.

    Raises SceneError with every problem found, whatever the file holds.
    """
    return scene_from_dict(read_tables(path, overrides), Path(path).parent)


def read_tables(path: str | Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Tables of a scene file with settings applied, as written: nothing else is checked (errors: ``load_scene``)."""
    return apply_overrides(_parsed(Path(path)), overrides)


def scene_from_dict(data: Any, base_dir: str | Path | None = None) -> Scene:
    """Check a scene given as a dictionary of the shape of the file.

    base_dir : folder that the files named in the scene are relative to; the current one where None.

    Raises SceneError with every problem found.
    """
    if not isinstance(data, dict):
        raise SceneError([Problem("scene", "a scene must be a table", type(data).__name__)], "the scene cannot be used")
    if _deeper_than(MOST_LEVELS, data):
        raise SceneError([Problem("scene", "nested too deeply")], "the scene cannot be used")
    try:
        return Scene.model_validate(data, context={"base_dir": Path(base_dir or ""), "with_parts": with_parts})
    except RecursionError:
        raise SceneError([Problem("scene", "nested too deeply")], "the scene cannot be used") from None


def _deeper_than(most: int, data: Any) -> bool:
    """Whether tables and lists are nested over more levels; deep nesting ends in the interpreter's own messages."""
    level = {id(data): data}
    for _ in range(most):
        inner = (v for item in level.values() for v in (item.values() if isinstance(item, Mapping) else item))
        level = {id(v): v for v in inner if isinstance(v, Mapping | list | tuple)}
    return bool(level)


def _parsed(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(_text(file))
    except tomllib.TOMLDecodeError as error:
        remedy = "strings need quotes, names of tables and keys must not repeat"
        raise _unreadable(file, f"not valid TOML: {error}", remedy) from None
    except RecursionError:
        raise _unreadable(file, "not usable: nested too deeply") from None
    except ValueError:  # tomllib lets the limit on the digits of an integer through
        raise _unreadable(file, "not usable: a number has too many digits") from None


def _text(file: Path) -> str:
    try:
        if file.is_dir():
            raise _unreadable(file, "this is a folder", f"name the scene file, e.g. {(file / 'scene.toml').as_posix()}")
        if file.stat().st_size > MAX_SCENE_BYTES:
            raise _unreadable(file, f"larger than {MAX_SCENE_BYTES} bytes", "put long tables into CSV files")
        return file.read_text(encoding="utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        raise _unreadable(file, "no such file") from None
    except UnicodeDecodeError as error:
        raise _unreadable(file, f"not a text file in UTF-8 (byte {error.start})", "is it a scene file?") from None
    except OSError as error:
        raise _unreadable(file, f"cannot be read ({error.strerror or type(error).__name__})") from None
    except ValueError as error:
        raise _unreadable(file, f"not a file name ({error})") from None


def _unreadable(file: Path, what: str, remedy: str | None = None) -> SceneError:
    return SceneError([Problem(repr(str(file))[1:-1], what, None, None, remedy)], "the scene cannot be read")


def with_parts(raw: Any, base_dir: Path) -> tuple[Any, list[Problem]]:
    """The scene with the parts of its mesh files as substructures and without [mesh.NAME]; what is wrong with them.

    A scene with problems comes back as it was, and so does one with wrong fields in [mesh.NAME], which the check of
    the fields reports.
    """
    written = named_tables(raw, "mesh")
    own = raw.get("substructure", {}) if written else None
    if not isinstance(own, Mapping):
        return raw, []
    tables = {name: table for name, item in written.items() if (table := _checked(item)) is not None}
    problems: list[Problem] = []
    parts: dict[str, Any] = {}
    owner: dict[str, str] = {}
    for name, table in tables.items():
        for part, group in _parts(name, table, base_dir, problems).items():
            if part in owner:
                what = f"the part {part!r} is in mesh.{owner[part]} too"
                problems.append(Problem(f"mesh.{name}.parts", what, remedy="list the parts of each file"))
                continue
            owner[part] = name
            parts[part] = _substructure(part, group, table, own.get(part), problems)
    if problems or len(tables) < len(raw["mesh"]):
        return raw, problems
    rest = {name: table for name, table in own.items() if name not in parts}
    files = ", ".join(table.file for table in tables.values())
    problems = [
        Problem(
            f"substructure.{name}",
            f"no part of this name in {files}",
            None,
            listed(parts),
            "give it a box or a mesh of its own, or one of these names",
        )
        for name, table in rest.items()
        if isinstance(table, Mapping) and not given(table, "box") and not given(table, "mesh")
    ]
    if problems:
        return raw, problems
    whole = {key: value for key, value in raw.items() if key != "mesh"}
    return {**whole, "substructure": {**parts, **rest}}, []


def _checked(table: Mapping[str, Any]) -> MeshParts | None:
    """The table, None where a field of it is wrong."""
    try:
        return MeshParts.model_validate(dict(table))
    except ValidationError:
        return None


def _parts(name: str, table: MeshParts, base_dir: Path, problems: list[Problem]) -> dict[str, str | None]:
    """Volume group of every part by the name of its substructure (None: the whole file, which names no group)."""
    from .mesh_files.reading import read_content

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
            what = "two volume groups give substructures of the same name"
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
    mesh: dict[str, Any] = {"file": table.file, "scale": table.scale, "refine": table.refine}
    if group is not None:
        mesh["group"] = group
    default = {} if table.material is None else {"material": table.material}
    if own is None:
        return {**default, "mesh": mesh}
    if not isinstance(own, Mapping):
        return own  # the check of the fields says what it must be
    for key in ("box", "mesh"):
        if given(own, key):
            what = "the mesh of this part comes from a file with several parts"
            remedy = f"leave this key out, or the group {group!r} out of the parts of that file"
            problems.append(Problem(f"substructure.{part}.{key}", what, remedy=remedy))
    return {**default, **own, "mesh": mesh}
