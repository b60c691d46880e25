"""What a mesh was made from: parts, screws and faces in a file beside it, for names that stay and lists of changes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .facts import CadAssembly, CadPart, Screw

_VERSION: Final = 1


def record_text(assembly: CadAssembly) -> str:
    """The record of an assembly as JSON."""
    data = {
        "version": _VERSION,
        "file": assembly.file,
        "unit": assembly.unit,
        "scale": assembly.scale,
        "parts": [_table(part) | {"faces": assembly.faces.get(part.name, [])} for part in assembly.parts],
        "whole": [_table(part) for part in assembly.whole],
        "screws": [
            {
                "part": screw.part,
                "used": screw.used,
                "kind": screw.kind,
                "why": screw.why,
                "diameter": screw.diameter,
                "size": screw.size,
                "threads": list(screw.threads),
                "clamped": list(screw.clamped),
                "axis": list(screw.axis),
                "middle": list(screw.middle),
            }
            for screw in assembly.screws
        ],
    }
    return json.dumps(data, indent=1) + "\n"


def _table(part: CadPart) -> dict[str, Any]:
    return {
        "name": part.name,
        "path": list(part.path),
        "volume": part.volume,
        "area": part.area,
        "centre": list(part.centre),
        "low": list(part.low),
        "high": list(part.high),
        "colour": part.colour,
        "material": part.material,
        "density": part.density,
    }


def read_record(path: Path) -> CadAssembly | None:
    """The assembly of a record, as far as it is in it; None where there is no file.

    Raises
    ------
    MeshError : the file is no record.
    """
    if not path.is_file():
        return None
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        assembly = CadAssembly(data["file"], data["unit"], data["scale"])
        assembly.parts = [_part(number, table) for number, table in enumerate(data["parts"], start=1)]
        assembly.whole = [_part(number, table) for number, table in enumerate(data.get("whole", []), start=1)]
        assembly.faces = {table["name"]: list(table["faces"]) for table in data["parts"]}
        assembly.screws = [_screw(table) for table in data["screws"]]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        what, remedy = f"not a record of a mesh: {error}", "remove it: parts are then named anew"
        raise MeshError.of("not meshed", path.name, what, remedy=remedy) from None
    return assembly


def _part(number: int, table: dict[str, Any]) -> CadPart:
    return CadPart(
        str(table["name"]),
        tuple(table["path"]),
        number,
        float(table["volume"]),
        float(table["area"]),
        tuple(table["centre"]),
        tuple(table["low"]),
        tuple(table["high"]),
        tuple(table["colour"]) if table["colour"] else None,
        (),
        np.zeros((0, 3)),
        0.0,
        table["material"],
        table["density"],
    )


def _screw(table: dict[str, Any]) -> Screw:
    return Screw(
        table["part"],
        bool(table["used"]),
        table["kind"],
        table["why"],
        float(table["diameter"]),
        table["size"],
        tuple(table["threads"]),
        tuple(table["clamped"]),
        tuple(table["axis"]),
        tuple(table["middle"]),
    )


def changes(before: CadAssembly, after: CadAssembly) -> Iterator[str]:
    """What has changed between two readings of a CAD file, a line for each part, face and screw."""
    old, new = before.by_name, after.by_name
    gone = [part for name, part in old.items() if name not in new]
    come = [part for name, part in new.items() if name not in old]
    for part in list(gone):
        same = [p for p in come if p.same_place(part) and p.same_shape(part)]
        if same:
            yield f"renamed: {part.name} is now {same[0].name} (same place and shape)"
            gone.remove(part)
            come.remove(same[0])
    yield from (f"gone: {part.name}" for part in gone)
    yield from (f"new: {part.name}" for part in come)
    for name, part in new.items():
        if name not in old:
            continue
        if how := _changed(old[name], part):
            yield f"changed: {name}, {how}"
        lost = [face for face in before.faces.get(name, []) if face not in after.faces.get(name, [])]
        found = [face for face in after.faces.get(name, []) if face not in before.faces.get(name, [])]
        yield from (f"gone: face {name}.{face}" for face in lost)
        yield from (f"new: face {name}.{face}" for face in found)
    were, are = ({s.part: s for s in a.screws if s.used} for a in (before, after))
    yield from (f"no longer a screw: {name}" for name in were if name not in are)
    yield from (f"a new screw: {name}" for name in are if name not in were)


def _changed(old: CadPart, new: CadPart) -> str:
    """How a part has changed; empty where it has not."""
    if not new.same_shape(old):
        return f"its volume was {old.volume:.6g} mm3 and is {new.volume:.6g} mm3"
    moved = np.linalg.norm(np.subtract(new.centre, old.centre))
    if moved > 1e-6 * max(new.diagonal, 1e-9):
        if new.same_place(old):
            return f"something in it has moved (its centre of mass by {moved:.3g} mm)"
        return f"it has moved by {moved:.4g} mm"
    return ""
