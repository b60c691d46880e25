"""The same scene with each time scheme and propagator the program knows, read off the tables of the scene."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import Any

from ..errors import LatinError
from ..scene.describe import tables_in, tag_of
from ..scene.reader import scene_from_dict
from ..scene.schema import Scene
from ..scene.solver_settings import WHOLE, Solver
from ..scene.time_settings import Time
from .refinement import in_short_windows

AS_WRITTEN = "as written"


@dataclass(frozen=True)
class Variant:
    """A way to solve a scene: its name in tables and curves, and the scene (None where refused, with the reason)."""

    name: str
    scene: Scene | None
    refusal: str = ""


def main_variant(scene: Scene) -> Variant:
    """The scene with its own scheme and propagator, in short windows (the same answer, fewer passes)."""
    return Variant(_name(scene), in_short_windows(scene))


def unreduced(scene: Scene) -> Variant | None:
    """The scene marched without reduction, everything else as it is; None where nothing is reduced."""
    if scene.solver.propagator.type != "reduced":
        return None
    direct = changed(in_short_windows(scene), {"solver": {"propagator": "direct"}})
    return Variant(_name(direct), direct)


def variants_of(scene: Scene) -> list[Variant]:
    """Every other way to march the scene, then the scene as written where it is one whole window.

    Schemes without inertia answer another question and are left out.
    """
    short = in_short_windows(scene)
    own = (scene.time.scheme.type, scene.solver.propagator.type)
    whole = unreduced(scene)
    found = [] if whole is None else [whole]
    found += [
        _changed(short, tag, {"time": {"scheme": tag}, "solver": {"propagator": "automatic"}})
        for tag in _tags(Time, "scheme")
        if tag != own[0] and "static" not in tag
    ]
    found += [
        _changed(short, tag, {"solver": {"propagator": tag}})
        for tag in _tags(Solver, "propagator")
        if tag not in ("automatic", "direct", "explicit", own[1])
    ]
    if scene.solver.window == WHOLE:
        found.append(Variant(AS_WRITTEN, scene))
    return found


def directions_of(scene: Scene) -> list[str]:
    """Search directions that need no parameters."""
    tables = tables_in(Solver.model_fields["search_direction"].annotation)
    return (
        [
            str(tag_of(table))
            for table in tables
            if not any(field.is_required() for field in table.model_fields.values())
        ]
        if scene.interface
        else []
    )


def changed(scene: Scene, changes: dict[str, dict[str, Any]]) -> Scene:
    """The scene with keys of its tables replaced, checked as a whole.

    Raises
    ------
    SceneError : the changes do not go with the rest of the scene.
    """
    data = tomllib.loads(scene.text())
    for table, keys in changes.items():
        data[table] = {**data.get(table, {}), **keys}
    return scene_from_dict(data, scene.base_dir)


def _changed(scene: Scene, name: str, changes: dict[str, dict[str, Any]]) -> Variant:
    try:
        return Variant(name, changed(scene, changes))
    except LatinError as error:
        return Variant(name, None, "; ".join(str(error).splitlines()[1:]).strip() or str(error))


def _tags(table: type[Time] | type[Solver], field: str) -> list[str]:
    return [str(tag_of(t)) for t in tables_in(table.model_fields[field].annotation)]


def _name(scene: Scene) -> str:
    propagator = scene.solver.propagator.type
    scheme = scene.time.scheme
    text = f"hht {scheme.alpha:g}" if scheme.type == "hht" else scheme.type
    return text if propagator in ("automatic", "direct", "explicit") else f"{propagator}, {text}"
