"""Reading a scene: a TOML file, or a dictionary of the same shape."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from .errors import MeshError, Problem, SceneError, did_you_mean, listed, shown
from .file_digest import is_damaged
from .scene.fields import split_face
from .scene.initial_fields import InitialStateTable
from .scene.overrides import key_lines
from .scene.raw_scene import chosen_type, given, named_tables, single_table
from .scene.schema import WITHOUT_MESHES, Scene, with_settings
from .scene.substructures import ALL, MeshParts, part_name
from .scene.units import SI, UnitSystem, system_named

if TYPE_CHECKING:
    from .mesh_files.content import MeshContent

MAX_SCENE_BYTES = 100_000_000
MOST_LEVELS = 30  # of tables in tables


_FOLDER = "solver.operators.folder"


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read and check a scene file.

    path : TOML file.
    overrides : settings such as ``"solver.tolerance=1e-4"``, applied in order.

    Raises SceneError with every problem found, whatever the file holds.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml", ["time.instants=800"])
    >>> scene.name, scene.time.instants
    ('impact_bar', 800)
    """
    file = Path(path)
    tables = read_tables(file, overrides)
    _check_written_folder(tables, file, overrides)
    try:
        return scene_from_dict(tables, file.parent)
    except SceneError as error:
        raise SceneError(_with_lines(error.problems, _text(file), overrides), error.heading) from None


def _check_written_folder(tables: Mapping[str, Any], file: Path, overrides: Sequence[str]) -> None:
    """Refuse a file that lets a run write beside its own folder: scenes come from others. Who runs it may name any."""
    named = {setting.partition("=")[0].strip() for setting in overrides}
    value: Any = tables
    for key in ("solver", "operators", "folder"):
        value = value.get(key) if isinstance(value, Mapping) else None
    if not isinstance(value, str) or named & {"solver", "solver.operators", _FOLDER}:
        return
    try:
        inside = (file.parent / value).resolve().is_relative_to(file.parent.resolve())
    except (OSError, ValueError):  # no name of a file
        inside = False
    if not inside:
        what = "a folder outside that of the scene file, which a run would write to"
        remedy = f"name it on the command line: --set {_FOLDER}={value}"
        problem = Problem(_FOLDER, what, value, "a folder below that of the scene file", remedy)
        raise SceneError(_with_lines([problem], _text(file), overrides), "the scene cannot be used")


def read_tables(path: str | Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Tables of a scene file with settings applied, as written: nothing else is checked (errors: ``load_scene``)."""
    return with_settings(_parsed(Path(path)), overrides)


def scene_from_dict(data: Any, base_dir: str | Path | None = None) -> Scene:
    """Check a scene given as a dictionary of the shape of the file.

    base_dir : folder that the files named in the scene are relative to; the current one where None.

    Raises SceneError with every problem found.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml")
    >>> latin_fmu.scene_from_dict(scene.tables(), scene.base_dir) == scene
    True
    """
    return _validated(data, base_dir, {})


def stored_scene(text: str, base_dir: str | Path | None = None) -> Scene:
    """The scene of a results file, by its text; files of its meshes may be away, until its bodies are built.

    Raises SceneError with every problem found.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError([Problem("scene", f"not TOML: {error}")], "the scene of the file cannot be read") from None
    return _validated(data, base_dir, {WITHOUT_MESHES: True})


def _validated(data: Any, base_dir: str | Path | None, more: dict[str, Any]) -> Scene:
    if not isinstance(data, dict):
        raise SceneError([Problem("scene", "a scene must be a table", type(data).__name__)], "the scene cannot be used")
    if _deeper_than(MOST_LEVELS, data):
        raise SceneError([Problem("scene", "nested too deeply")], "the scene cannot be used")
    try:
        context = {"base_dir": Path(base_dir or ""), "with_parts": with_files, "units": system_named(data.get("units"))}
        context |= more
        return Scene.model_validate(data, context=context)
    except RecursionError:
        raise SceneError([Problem("scene", "nested too deeply")], "the scene cannot be used") from None


def _with_lines(problems: Sequence[Problem], text: str, overrides: Sequence[str]) -> list[Problem]:
    """Problems with the line of the file that the key, or else the table around it, is on; none where a setting on top
    of the file gives the key."""
    lines = key_lines(text)
    given = [setting.partition("=")[0].strip() for setting in overrides]
    placed = []
    for problem in problems:
        parts = [part.rstrip("]") for part in re.split(r"[.\[]", problem.where)]
        around = [".".join(parts[:n]) for n in range(len(parts), 0, -1)]
        known = not any(path in around or path.startswith(f"{around[0]}.") for path in given)
        found = next((lines[path] for path in around if path in lines), None) if known else None
        placed.append(replace(problem, line=found))
    return placed


def _deeper_than(most: int, data: Any) -> bool:
    """Whether tables and lists are nested over more levels; deep nesting ends in the interpreter's own messages."""
    # by identity: an object that holds itself would be counted for ever
    level = {id(data): data}
    for _ in range(most):
        inner = (v for item in level.values() for v in (item.values() if isinstance(item, Mapping) else item))
        level = {id(v): v for v in inner if isinstance(v, Mapping | list | tuple)}
    return bool(level)


def _parsed(file: Path) -> dict[str, Any]:
    text = _text(file)
    if (keys := _longest_key(text)) > MOST_LEVELS:
        raise _unreadable(file, f"not usable: a key of {keys} parts, at most {MOST_LEVELS}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _unreadable(file, f"not valid TOML: {error}", _toml_remedy(str(error), text)) from None
    except RecursionError:
        raise _unreadable(file, "not usable: nested too deeply") from None
    except ValueError:  # tomllib lets the limit on the digits of an integer through
        raise _unreadable(file, "not usable: a number has too many digits") from None


def _longest_key(text: str) -> int:
    """Parts of the longest key or name of a table; tomllib takes a time that grows with their square."""
    lines = (_STRING.sub("s", line) for line in text.splitlines() if line.count(".") > MOST_LEVELS)
    return max((match[0].count(".") + 1 for line in lines for match in _KEY.finditer(line)), default=0)


_STRING = re.compile(r"\"(?:[^\"\\]|\\.)*\"|'[^']*'")
_KEY = re.compile(r"[\w-]+(?:[ \t]*\.[ \t]*[\w-]+)+")
_REMEDIES = (  # what the wrong line has, and what to write
    (re.compile(r"=\s*[-+]?\d+,\d+\s*(#.*)?$"), "numbers have a decimal point: 0.3, not 0,3"),
    (re.compile(r"=\s*[-+]?[\d.eE+-]+\s*,\s*[-+]?[\d.]"), "several numbers stand in brackets: [ ], e.g. [0.1, 0.2]"),
    (re.compile(r"=\s*[A-Za-z_][^\"']*$"), 'text stands in quotes: "fixed", not fixed'),
)


def _toml_remedy(message: str, text: str) -> str:
    """What to do about the line that an error of tomllib names."""
    lines, place = text.splitlines(), re.search(r"at line (\d+)", message)
    if place is not None and 0 < int(place[1]) <= len(lines):
        line = lines[int(place[1]) - 1]
    else:
        line = ""
    remedy = next((words for pattern, words in _REMEDIES if pattern.search(line)), None)
    return remedy or "strings need quotes, names of tables and keys must not repeat"


def _text(file: Path) -> str:
    try:
        if file.is_dir():
            raise _unreadable(file, "this is a folder", f"name the scene file, e.g. {(file / 'scene.toml').as_posix()}")
        if file.exists() and not file.is_file():
            raise _unreadable(file, "this is a device, pipe or socket", "name a scene file")
        if file.stat().st_size > MAX_SCENE_BYTES:
            raise _unreadable(file, f"larger than {MAX_SCENE_BYTES} bytes", "put long tables into CSV files")
        return file.read_text(encoding="utf-8-sig")  # with or without a mark of the byte order
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


def with_files(raw: Any, base_dir: Path) -> tuple[Any, list[Problem]]:
    """The scene with the content of its mesh and results files, and what is wrong with them (see ``with_parts``)."""
    written, problems = with_parts(raw, base_dir)
    if problems:
        return (raw, problems)
    return _with_initial_state(written, base_dir)


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
    said: list[tuple[MeshContent, dict[str, str], MeshParts]] = []
    for name, table in tables.items():
        groups, content = _parts(name, table, base_dir, problems)
        if content is not None:
            said.append((content, {group: part for part, group in groups.items() if group is not None}, table))
        problems += _idle_patterns(name, table, list(groups))
        for part, group in groups.items():
            if part in owner:
                what = f"the part {part!r} is in mesh.{owner[part]} too"
                problems.append(Problem(f"mesh.{name}.parts", what, remedy="list the parts of each file"))
                continue
            owner[part] = name
            parts[part] = _substructure(part, group, table, own.get(part), problems)
    # an unreadable table is reported with its fields
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
    whole["substructure"] = {**parts, **rest}
    for content, groups_of_file, table in said:
        if content.deck is not None and not table.mesh_only:
            from .mesh_files.deck_scene import with_deck

            whole = with_deck(whole, content, groups_of_file, table.scale, problems)
        if table.take:
            from .mesh_files.attachments import with_attached

            whole = with_attached(whole, content, groups_of_file, table, problems)
    if problems:
        return raw, problems
    return _with_body_names(whole, set(whole["substructure"])), []


def _idle_patterns(name: str, table: MeshParts, parts: Sequence[str]) -> Iterator[Problem]:
    """Patterns of materials that no part has a name like."""
    patterns = table.material if isinstance(table.material, dict) else {}
    for pattern in patterns:
        if parts and not any(fnmatchcase(part, pattern) for part in parts):
            where = f'mesh.{name}.material."{pattern}"'
            remedy = did_you_mean(pattern, parts) or "remove it, or change it"
            yield Problem(where, "no part has a name like this", None, listed(parts), remedy)


_FACES = ("face", "faces", "sides")  # keys with names of faces


def _with_body_names(value: Any, bodies: set[str], key: str = "") -> Any:
    """A scene in which faces of bodies are written by the names of the substructures, also where the file has dots in
    the name of the body: ``my.part.top.1`` is the face top.1 of my_part."""
    if isinstance(value, Mapping):
        return {k: _with_body_names(inner, bodies, k) for k, inner in value.items()}
    if isinstance(value, list | tuple) and key in _FACES:
        return [_with_body_names(inner, bodies, key) for inner in value]
    if isinstance(value, str) and key in _FACES and split_face(value)[0] not in bodies:
        words = value.split(".")
        for count in range(2, len(words)):
            if (body := part_name(".".join(words[:count]))) in bodies:
                return f"{body}.{'.'.join(words[count:])}"
    return value


def _checked(table: Mapping[str, Any]) -> MeshParts | None:
    """The table, None where a field of it is wrong."""
    try:
        return MeshParts.model_validate(dict(table))
    except ValidationError:
        return None


def _parts(
    name: str, table: MeshParts, base_dir: Path, problems: list[Problem]
) -> tuple[dict[str, str | None], MeshContent | None]:
    """Volume group of every part by the name of its substructure (None: the whole file, which names no group), and the
    content of the file."""
    from .mesh_files.reading import read_content

    try:
        content = read_content(base_dir / table.file)
        content.refuse(table.ignore)
        if table.parts != (ALL,):
            groups = _listed_groups(name, table, content, problems)
        elif not content.solids:
            what, holds = "the file holds no solid cells", content.without_solids()
            if holds:
                value = f"{table.file}: {holds}"
            else:
                value = table.file
            problems.append(
                Problem(f"mesh.{name}.file", what, value, remedy="mesh the volume, or extrude a plane mesh")
            )
            return {}, None
        elif not (groups := list(content.part_names(table.file))):
            return {part_name(name): None}, content
    except MeshError as error:
        where = f"mesh.{name}.file"
        problems += [Problem(where, f"{p.where}: {p.what}", p.value, p.allowed, p.remedy) for p in error.problems]
        return {}, None
    parts: dict[str, str | None] = {}
    for group in groups:
        part = part_name(group)
        if part in parts:
            what = "two volume groups give substructures of the same name"
            both = f"{parts[part]}, {group}"
            problems.append(Problem(f"mesh.{name}.parts", what, both, remedy="rename one of them, or list one"))
        parts[part] = group
    return parts, content


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
    """The table of a part: material and mesh of the file, then the keys of [substructure.PART]."""
    mesh: dict[str, Any] = {"file": table.file, "scale": table.scale, "refine": table.refine}
    if table.ignore:
        mesh["ignore"] = list(table.ignore)
    if table.mesh_only:
        mesh["mesh_only"] = True
    if table.adjust:
        mesh["adjust"] = True
    if table.points:
        mesh["points"] = list(table.points)
    if group is not None:
        mesh["group"] = group
    material = table.material_of(part)
    default = {} if material is None else {"material": material}
    if own is None:
        return {**default, "mesh": mesh}
    if not isinstance(own, Mapping):
        return own  # reported by the check of the fields
    for key in ("box", "mesh"):
        if given(own, key):
            what = "the mesh of this part comes from a file with several parts"
            remedy = f"omit this key, or remove the group {group!r} from the parts of that file"
            problems.append(Problem(f"substructure.{part}.{key}", what, remedy=remedy))
    return {**default, **own, "mesh": mesh}


_INITIAL = (
    "initial_velocity",
    "initial_spin",
    "initial_displacement",
    "initial_velocity_gradient",
    "initial_displacement_gradient",
    "initial_velocity_field",
    "initial_displacement_field",
)
_INSTANT = 1e-6  # of the time between stored instants


def _with_initial_state(raw: Any, base_dir: Path) -> tuple[Any, list[Problem]]:
    """The scene with the fields of its [initial_state] in the substructures and without this table; what is wrong."""
    if not isinstance(raw, Mapping) or raw.get("initial_state") is None:
        return raw, []
    if not isinstance(raw.get("substructure"), Mapping):
        return raw, []  # the check of the fields reports it
    try:
        table = InitialStateTable.model_validate(raw["initial_state"])
    except ValidationError:
        return raw, []  # the check of the fields reports it
    bodies, problems = named_tables(raw, "substructure"), []
    if table.bodies is None:
        chosen = list(bodies)
    else:
        chosen = list(table.bodies)
    for name in chosen:
        if name not in bodies:
            what = "no substructure of this name"
            problems.append(Problem("initial_state.bodies", what, shown(name), listed(bodies)))
            continue
        for key in _INITIAL:
            if given(bodies[name], key):
                what = "the body starts from the state of [initial_state]"
                remedy = f"omit one of the two: list in initial_state.bodies all bodies but {name}, or remove it"
                problems.append(Problem(f"substructure.{name}.{key}", what, remedy=remedy))
        if bodies[name].get("rigid") is True:
            remedy = "list the elastic bodies in initial_state.bodies, and give it initial_velocity and initial_spin"
            problems.append(Problem("initial_state", "a rigid body takes no fields", shown(name), remedy=remedy))
    if chosen_type(single_table(raw, "time"), "start") == "static" or named_tables(raw, "bolt"):
        what = "the scene starts from a static equilibrium (time.start, bolts)"
        remedy = 'omit [initial_state], or set time.start = "given" in a scene without bolts'
        problems.append(Problem("initial_state", what, remedy=remedy))
    fields = {} if problems else _fields_of(table, chosen, base_dir, system_named(raw.get("units")), problems)
    if problems:
        return raw, problems
    rest = {key: value for key, value in raw.items() if key != "initial_state"}
    own = {name: {**body, **fields.get(name, {})} for name, body in bodies.items()}
    return {**rest, "substructure": {**raw["substructure"], **own}}, []


def _fields_of(
    table: InitialStateTable, bodies: Sequence[str], base_dir: Path, units: UnitSystem, problems: list[Problem]
) -> dict[str, Any]:
    """Keys of the initial fields by substructure, from the results file."""
    from netCDF4 import Dataset

    path, fields = base_dir / table.file, dict[str, Any]()
    if not path.is_file():
        remedy = "file names are relative to the scene file"
        problems.append(Problem("initial_state.file", "no such file", shown(table.file), remedy=remedy))
        return fields
    try:
        if is_damaged(path):
            raise OSError("it is damaged: its digest does not match")
        with Dataset(str(path)) as file:
            own = str(getattr(file, "unit_system", SI.name))  # an attribute of ``results.groups``, a later layer
            if own != units.name:
                what, remedy = ("the file is in other units than the scene", "use the same units in both scenes")
                problems.append(Problem("initial_state.file", what, own, units.name, remedy))
                return fields
            stored = file.groups["substructures"].groups if "substructures" in file.groups else {}
            for name in bodies:
                keys = {"time", "node_x", "node_y", "node_z", "displacement", "velocity"}
                if name not in stored or not keys <= set(stored[name].variables):
                    what = f"no displacements and velocities of {name} in the file"
                    allowed = f"bodies with fields there: {listed([n for n in stored if stored[n].variables])}"
                    remedy = "run that scene with output.fields = true, or list other bodies in initial_state.bodies"
                    problems.append(Problem("initial_state.file", what, shown(table.file), allowed, remedy))
                elif (made := _at_instant(table, name, stored[name].variables, problems)) is not None:
                    fields[name] = made
            if not problems and "interfaces" in file.groups:
                _refuse_loaded_contacts(table, bodies, file.groups["interfaces"].groups, units, problems)
    except (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
        what = f"not a readable results file ({error})"  # the library of a damaged file raises many kinds
        problems.append(Problem("initial_state.file", what, shown(table.file), "the .nc file of a run"))
    return fields


def _refuse_loaded_contacts(
    table: InitialStateTable,
    bodies: Sequence[str],
    interfaces: Mapping[str, Any],
    units: UnitSystem,
    problems: list[Problem],
) -> None:
    """Problems of contacts of these bodies that carry tractions at the instant, which displacements do not give."""
    for name, group in interfaces.items():
        sides = {split_face(str(getattr(group, side, "")))[0] for side in ("face_E", "face_Ep")}
        if str(getattr(group, "behaviour", "")) not in ("contact", "no_slip") or not sides & set(bodies):
            continue
        i = int(np.argmin(np.abs(np.asarray(group.variables["time"][:], dtype=float) - table.time)))
        largest = float(np.abs(np.asarray(group.variables["traction"][i], dtype=float)).max(initial=0.0))
        if largest > 0.0:
            size = f"{largest:.4g} {units['Pa']}"
            what = f"the contact {name} carries tractions up to {size} at this instant, which would be lost"
            remedy = "choose an instant at which it is open, or continue that run itself from a checkpoint"
            problems.append(Problem("initial_state.time", what, f"{table.time:.9g} s", "contacts without load", remedy))


def _at_instant(
    table: InitialStateTable, name: str, stored: Mapping[str, Any], problems: list[Problem]
) -> dict[str, Any] | None:
    """Both fields of one body at the instant; None, with a problem, where the file does not have them."""
    times = np.asarray(stored["time"][:], dtype=float)
    i = int(np.argmin(np.abs(times - table.time)))
    step = float(times[-1] - times[0]) / max(len(times) - 1, 1)  # mean distance of stored instants
    if abs(times[i] - table.time) > _INSTANT * step:
        near = ", ".join(f"{t:.9g}" for t in times[max(i - 1, 0) : i + 2])
        what = f"the fields of {name} are not stored at this instant"
        allowed = f"one of {len(times)} instants, the nearest are {near} s"
        remedy = "choose one of these, or store more instants (output.every)"
        problems.append(Problem("initial_state.time", what, f"{table.time:.9g} s", allowed, remedy))
        return None
    points = np.stack([np.asarray(stored[f"node_{axis}"][:], dtype=float) for axis in "xyz"], axis=1)
    made: dict[str, Any] = {}
    for kind in ("displacement", "velocity"):
        # values that were left out in the file
        values: Any = np.ma.filled(np.ma.asarray(stored[kind][i], dtype=float), np.nan)
        if not np.isfinite(values).all():
            what = f"the {kind} of {name} holds values that are not finite numbers at this instant"
            remedy = "choose an earlier instant, at which all values are finite"
            problems.append(Problem("initial_state.time", what, f"{table.time:.9g} s", remedy=remedy))
            return None
        field = {"file": table.file, "time": table.time, "points": points.tolist(), "values": values.tolist()}
        made[f"initial_{kind}_field"] = field
    return made
