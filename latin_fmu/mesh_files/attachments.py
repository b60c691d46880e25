"""Point masses and spiders of a Nastran deck (CONM2, RBE2, RBE3), and the tables of a scene that stand for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import Problem, listed
from ..scene.units import SI, system_named
from .content import Attached, FileLine, Index, MeshContent, rows_of
from .nastran_entries import BulkEntry, label_of

if TYPE_CHECKING:
    from ..scene.substructures import MeshParts
    from .coordinates import CoordinateSystem

_SPIDERS = ("RBE2", "RBE3")


def attached_of(entry: BulkEntry, labels: Index, system: Callable[[int, FileLine], CoordinateSystem]) -> Attached:
    """What an entry says; ``labels`` are those of the rows of nodes, ``system`` gives a coordinate system."""
    read = {"CONM2": _mass, "RBE2": _rigid, "RBE3": _distributing}[entry.name]
    try:
        return read(entry, labels, system)
    except ValueError as error:
        # a problem of those alone who want to take it
        if entry.text(1).isascii() and entry.text(1).isdigit():
            label = int(entry.text(1))
        else:
            label = 0
        why = f"it is not usable ({entry.place.where}, line {entry.place.line}: {error})"
        return Attached(entry.name, label, -1, _row(labels), problem=why)


def _row(labels: Index, *nodes: int) -> Index:
    rows, there = rows_of(labels, np.array([label_of(node) for node in nodes], dtype=np.int64))
    if not there.all():
        raise ValueError(f"no GRID {nodes[int(there.argmin())]}")
    return rows


def _mass(entry: BulkEntry, labels: Index, system: Callable[[int, FileLine], CoordinateSystem]) -> Attached:
    """EID G CID M X1 X2 X3, I11 I21 I22 I31 I32 I33 (MSC Nastran Quick Reference Guide, CONM2)."""
    node = int(_row(labels, entry.whole(2))[0])
    offset = np.array([entry.number(i) for i in (5, 6, 7)])
    inertia = tuple(entry.number(i) for i in range(9, 15))
    cid = entry.whole(3)
    if cid and (offset.any() or any(inertia)):
        placed = None if cid < 0 else system(cid, entry.place)
        if placed is None or placed.kind != "R" or (any(inertia) and not np.allclose(placed.axes, np.eye(3))):
            raise ValueError(f"an offset or inertia in the coordinate system {cid}")
        offset = offset @ placed.axes
    x, y, z = offset.tolist()
    return Attached(entry.name, entry.whole(1), node, _row(labels), "", entry.number(4), (x, y, z), inertia)


def _rigid(entry: BulkEntry, labels: Index, _: object) -> Attached:
    """EID GN CM GM1 GM2 ..., ALPHA at the end."""
    legs = [int(text) for text in entry.fields[4:] if text.isascii() and text.isdigit()]
    return Attached(
        entry.name, entry.whole(1), int(_row(labels, entry.whole(2))[0]), _row(labels, *legs), entry.text(3)
    )


def _distributing(entry: BulkEntry, labels: Index, _: object) -> Attached:
    """EID, blank, REFGRID REFC, then groups of a weight (a real number), components and nodes; after them UM or ALPHA
    with fields of their own."""
    legs: list[int] = []
    components = ""
    expects_components = False
    for text in entry.fields[5:]:
        if text.upper() in ("UM", "ALPHA"):
            break
        if not text:
            continue
        if not (text.isascii() and text.isdigit()):
            # the weight of the nodes that follow
            expects_components = True
        elif expects_components:
            components, expects_components = text, False
        else:
            legs.append(int(text))
    return Attached(entry.name, entry.whole(1), int(_row(labels, entry.whole(3))[0]), _row(labels, *legs), components)


def taken(content: MeshContent, scene: Any) -> list[str]:
    """Entries of which every one became a table of the scene (``Scene``)."""
    tables = {*scene.point_mass, *scene.coupling}
    used = {face.partition(".")[2] for mass in scene.point_mass.values() if (face := mass.face) is not None}
    return [
        word
        for word in dict.fromkeys(item.word for item in content.attached)
        if all(item.name in tables or item.name in used for item in content.attached if item.word == word)
    ]


def with_attached(
    raw: Mapping[str, Any], content: MeshContent, parts: Mapping[str, str], table: MeshParts, problems: list[Problem]
) -> dict[str, Any]:
    """The scene with the point masses and couplings that ``table.take`` names.

    A mass at a node of a part is a mass at that point; at the middle of a spider it moves with the face at the ends of
    the legs. An RBE2 makes that face rigid, an RBE3 does not; an RBE2 with legs on two parts couples them. Tables of
    these names in the scene count.
    """
    there = {item.word for item in content.attached}
    problems += [
        Problem(f"mesh.take in {table.file}", "the file has no such entry", word, listed(there))
        for word in dict.fromkeys(table.take)
        if word not in there
    ]
    build = _Tables(raw, content, parts, table.scale)
    try:
        for word in dict.fromkeys(table.take):
            for item in content.attached:
                if item.word == word:
                    build.add(item, table.take)
    except ValueError as error:
        problems.append(Problem(f"mesh.take in {table.file}", str(error)))
    problems += [Problem(f"mesh.take in {table.file}", what, remedy=_REMEDY) for what in build.lost]
    whole = dict(raw)
    for key, tables in (("point_mass", build.masses), ("coupling", build.couplings)):
        if tables:
            whole[key] = {**tables, **(raw.get(key) or {})}
    return whole


_REMEDY = "leave its word out of take, and write a table of the scene for what matters"


class _Tables:
    """The tables of a scene while they are made."""

    def __init__(self, raw: Mapping[str, Any], content: MeshContent, parts: Mapping[str, str], scale: float) -> None:
        self.content = content
        self.parts = parts
        self.scale = scale
        self.nodes = {part: content.nodes_of(group) for group, part in parts.items()}
        self.masses: dict[str, Any] = {}
        self.couplings: dict[str, Any] = {}
        self.lost: list[str] = []
        # as the density: units of the scene, or t of a deck in mm, t, s
        self.unit_of_mass: float | None = None
        if scale == 1.0:
            self.unit_of_mass = 1.0
        elif scale == 1e-3 and system_named(raw.get("units")) is SI:
            self.unit_of_mass = 1e3

    def add(self, item: Attached, words: tuple[str, ...]) -> None:
        """The tables of one mass or spider."""
        if item.problem:
            self.lost.append(f"{item.name}: {item.problem}")
        elif item.word == "CONM2":
            self._mass(item, words)
        else:
            self._spider(item)

    def _mass(self, item: Attached, words: tuple[str, ...]) -> None:
        if self.unit_of_mass is None:
            raise ValueError("the unit of mass of the deck is not known: scale = 1 or 1e-3 in SI are")
        if not item.mass > 0.0:
            self.lost.append(f"{item.name} has no mass")
            return
        mass, off = self.unit_of_mass * item.mass, np.array(item.offset)
        point = (self.scale * (self.content.points[item.node] + off)).tolist()
        i11, i21, i22, i31, i32, i33 = (self.unit_of_mass * self.scale**2 * value for value in item.inertia)
        if part := next((name for name, nodes in self.nodes.items() if np.isin(item.node, nodes)), None):
            # a node of solids has no rotation, so that an inertia does nothing there
            if off.any():
                self.lost.append(f"{item.name} has an offset from a node of solids, which has no rotation")
            else:
                self.masses[item.name] = {"substructure": part, "point": point, "mass": mass}
            return
        spider = next(
            (s for s in self.content.attached if s.node == item.node and s.word in words and len(s.legs)), None
        )
        face = None
        if spider is not None:
            face = next(iter(self._faces(spider)), None)
        if face is None:
            spiders = listed(word for word in _SPIDERS if word not in words) or "none"
            self.lost.append(
                f"{item.name} is at a node of no part and of no spider that is taken (not taken: {spiders})"
            )
        elif any((i21, i31, i32)):
            self.lost.append(f"{item.name} has products of inertia")
        else:
            table = {"face": face, "point": point, "mass": mass}
            if any((i11, i22, i33)):
                table["inertia"] = [i11, i22, i33]
            self.masses[item.name] = table

    def _spider(self, item: Attached) -> None:
        faces = list(self._faces(item))
        owner = next((name for name, nodes in self.nodes.items() if np.isin(item.node, nodes)), None)
        if not faces:
            self.lost.append(f"the legs of {item.name} end at no face of a part")
        elif not set("123") <= set(item.components):
            self.lost.append(f"{item.name} joins the components {item.components or 'none'} alone, not 123")
        else:
            self._join(item, faces, owner)

    def _join(self, item: Attached, faces: list[str], owner: str | None) -> None:
        """Couplings of a spider between the faces at its legs, and the part that its middle is a node of."""
        middle = (self.scale * self.content.points[item.node]).tolist()
        rigid = {}
        if item.word == "RBE2":
            rigid["rigid"] = True
        ends: list[Any] = [{"face": face, "point": middle} for face in faces]
        if owner is not None and owner not in [face.partition(".")[0] for face in faces]:
            ends.append({"substructure": owner, "point": middle})
            rigid["rotations"] = False
        others = [s for s in self.content.attached if s is not item and s.node == item.node and len(s.legs)]
        if others and others[0].label > item.label:
            ends += [{"face": face, "point": middle} for face in self._faces(others[0])]
        for i, end in enumerate(ends[1:]):
            name = item.name
            if i:
                name += f"_{i + 1}"
            self.couplings[name] = {"ends": [ends[0], end], **rigid}
        if len(ends) == 1 and rigid:
            self.couplings[item.name] = {"ends": [{"face": faces[0]}], **rigid}

    def _faces(self, item: Attached) -> Iterator[str]:
        """Faces of the parts at the ends of the legs of a spider."""
        for group, part in self.parts.items():
            if self.content.touching(group, item.name):
                yield f"{part}.{item.name}"
