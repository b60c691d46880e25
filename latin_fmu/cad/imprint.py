"""Faces split along the outline of what touches them, each part by itself: parts share no nodes afterwards.

A part is cut by copies of the flat faces that its neighbours touch it with. It must keep its volume; a part that does
not, or that would have slivers, stays as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from .facts import CadPair, CadPart

EXACT: Final = 1e-6
"""Relative change of the volume of a part that is split, at most."""
NOTHING: Final = "nothing to split"
_SLIVER: Final = 0.3  # root of the area of a new face over the least one of the part and of the tools


def split_faces(gmsh: Any, parts: Sequence[CadPart], pairs: Sequence[CadPair]) -> tuple[dict[str, int], list[str]]:
    """Split the faces of all parts that touch others; the numbers of the volumes by part, and what is said of parts
    that stay as they are."""
    occ = gmsh.model.occ
    tools = {part.name: occ.copy([(2, f) for f in _touching(gmsh, part.name, pairs)] or []) for part in parts}
    numbers, said = {}, []
    for part in parts:
        numbers[part.name] = part.number
        if not tools[part.name]:
            continue
        new = _split(occ, part, tools[part.name])
        if new == NOTHING:
            continue
        if isinstance(new, str):
            said.append(f"{part.name}: its faces are not split along its neighbours, {new}")
        else:
            occ.remove([(3, part.number)], recursive=True)
            numbers[part.name] = new
    occ.synchronize()
    return numbers, said


def _touching(gmsh: Any, name: str, pairs: Sequence[CadPair]) -> Iterator[int]:
    """Flat faces of other parts that touch one."""
    for pair in pairs:
        if name in pair.parts:
            for face in pair.faces[1 - pair.parts.index(name)]:
                if gmsh.model.getType(2, face) == "Plane":
                    yield face


def _split(occ: Any, part: CadPart, tools: Sequence[tuple[int, int]]) -> int | str:
    """Number of the volume with split faces; the reason where there is none."""
    least = min([part.smallest, *(float(occ.getMass(*tool)) ** 0.5 for tool in tools)])
    body = occ.copy([(3, part.number)])
    try:
        _, origins = occ.fragment(body, list(tools), removeObject=True, removeTool=True)
    except Exception as error:  # the library raises plain exceptions
        return f"the library cannot cut it: {error}"
    solids = [tag for dim, tag in origins[0] if dim == 3]
    pieces = {entity for origin in origins[1:] for entity in origin if entity[0] == 2}
    skin = {face for solid in solids for loop in occ.getSurfaceLoops(solid)[1] for face in loop}
    occ.remove(sorted(entity for entity in pieces if entity[1] not in skin), recursive=True)
    why = ""
    if len(solids) != 1 or abs(float(occ.getMass(3, solids[0])) - part.volume) > EXACT * part.volume:
        why = "its volume would change"
    elif min(float(occ.getMass(2, face)) for face in skin) ** 0.5 < _SLIVER * least:
        why = "it would have slivers"
    before = sum(len(loop) for loop in occ.getSurfaceLoops(part.number)[1])
    if len(skin) == before:
        why = NOTHING
    if why:
        occ.remove([(3, solid) for solid in solids], recursive=True)
        return why
    return int(solids[0])


def faces_of(gmsh: Any, numbers: Mapping[str, int]) -> dict[str, list[int]]:
    """Faces of the volumes, by part."""
    return {
        name: [abs(f) for _, f in gmsh.model.getBoundary([(3, number)], oriented=False)]
        for name, number in numbers.items()
    }
