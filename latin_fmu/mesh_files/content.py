"""The content of a mesh file in one form for all formats, what the readers of formats share, and the tables that an
Abaqus deck with several parts gives a scene.

A deck says beyond its mesh: materials, tied surfaces, fixed sets; keywords of which nothing is used.

``*MATERIAL`` with ``*ELASTIC`` (isotropic) and ``*DENSITY`` at one temperature, by ``*SOLID SECTION``; ``*TIE``;
``*BOUNDARY`` of node sets held at zero (components 1 to 3, ENCASTRE, PINNED). Numbers are in the units of the deck.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, Problem, listed
from ..scene.raw_scene import given, named_tables
from ..scene.substructures import part_name
from ..scene.units import SI, system_named

_MESH: Final = frozenset(
    {
        "HEADING",
        "PREPRINT",
        "NODE",
        "ELEMENT",
        "NSET",
        "ELSET",
        "SURFACE",
        "SOLID SECTION",
        "PART",
        "END PART",
        "ASSEMBLY",
        "END ASSEMBLY",
        "INSTANCE",
        "END INSTANCE",
        "END STEP",
    }
)
_KEYS: Final = ("young_modulus", "poisson_ratio", "density")
_AXES: Final = "xyz"
_NAMED: Final = {"ENCASTRE": (1, 3), "PINNED": (1, 3)}  # first and last component of displacement


@dataclass
class DeckModel:
    """Materials, ties and supports of a deck.

    Attributes
    ----------
    materials : constants ``young_modulus``, ``poisson_ratio``, ``density`` by the name of the material in capitals.
    sections : (element set, material), both in capitals. ties : (name, slave surface, master surface).
    fixed : (node set, components out of "xyz"), held at zero. unused : number of the keywords that are not read.
    """

    materials: dict[str, dict[str, float]] = field(default_factory=dict)
    sections: list[tuple[str, str]] = field(default_factory=list)
    ties: list[tuple[str, str, str]] = field(default_factory=list)
    fixed: list[tuple[str, str]] = field(default_factory=list)
    unused: Counter[str] = field(default_factory=Counter)
    _material: str = ""

    def take(self, keyword: str, parameters: Mapping[str, str], rows: Sequence[Sequence[str]]) -> None:
        """Add what a card says: its keyword and parameters, in capitals, and the fields of its data lines."""
        name = parameters.get("NAME", "")
        if keyword == "SOLID SECTION":
            self.sections.append((parameters.get("ELSET", "").upper(), parameters.get("MATERIAL", "").upper()))
        elif keyword == "MATERIAL":
            self._material = name.upper()
            self.materials.setdefault(self._material, {})
        elif keyword == "ELASTIC" and parameters.get("TYPE", "").upper() in ("", "ISOTROPIC", "ISO"):
            self._constants(keyword, rows, _KEYS[:2])
        elif keyword == "DENSITY":
            self._constants(keyword, rows, _KEYS[2:])
        elif keyword == "TIE":
            for names in rows:
                if len(names) > 1:
                    stem, known = name or "tie", {tie[0] for tie in self.ties}
                    # one card may tie several pairs: names of ties stay different
                    own = stem if stem not in known else f"{stem}_{len(known) + 1}"
                    self.ties.append((own, names[0], names[1]))
        elif keyword == "BOUNDARY" and "TYPE" not in parameters:
            for fields in rows:
                if not self._fix(fields):
                    self.unused["BOUNDARY"] += 1
        elif keyword not in _MESH:
            self.unused[keyword] += 1

    def _constants(self, keyword: str, rows: Sequence[Sequence[str]], keys: tuple[str, ...]) -> None:
        """Numbers of the first data line, of a material that does not depend on temperature."""
        try:
            values = [float(text.upper().replace("D", "E")) for text in rows[0][: len(keys)]]
        except (ValueError, IndexError):
            values = []
        if len(rows) == 1 and len(values) == len(keys) and self._material:
            self.materials[self._material].update(zip(keys, values, strict=True))
        else:
            self.unused[keyword] += 1

    def _fix(self, fields: Sequence[str]) -> bool:
        """Add a set that is held at zero; False for anything else."""
        try:
            name, first, *rest = fields
            if first.upper() in _NAMED:
                low, high = _NAMED[first.upper()]
            else:
                low = int(first)
                high = int(rest[0]) if rest and rest[0] else low
            # fourth field: the value
            still = len(rest) < 2 or not rest[1] or float(rest[1]) == 0.0
        except ValueError:
            return False
        # rotations alone hold nothing of a solid; a number is a node and no set
        if not still or not 1 <= low <= high <= 6 or low > 3 or name.rpartition(".")[2].isdigit():
            return False
        self.fixed.append((name, _AXES[low - 1 : min(high, 3)]))
        return True

    def material_of(self, sections: list[str]) -> tuple[str, dict[str, float]] | None:
        """Name and constants of the one material of these element sets (in capitals); None where it is not whole."""
        names = {material for elset, material in self.sections if elset in sections}
        if len(names) != 1:
            return None
        constants = self.materials.get(name := names.pop(), {})
        return (name, constants) if set(constants) == set(_KEYS) else None

    def unused_words(self) -> list[str]:
        """Keywords that are not used, with their number, as they stand in the deck."""
        return [f"*{keyword}" + (f" ({count})" if count > 1 else "") for keyword, count in sorted(self.unused.items())]


Array = NDArray[np.float64]
Index = NDArray[np.int64]

CORNERS: Final = {
    kind: n_corner
    for n_corner, kinds in (
        (4, "tetra tetra8 tetra10 tetra14 tetra20 tetra35"),
        (5, "pyramid pyramid13 pyramid14"),
        (6, "wedge wedge15 wedge18"),
        (8, "hexahedron hexahedron9 hexahedron20 hexahedron24 hexahedron27 hexahedron64 hexahedron125"),
    )
    for kind in kinds.split()
}
"""Corner nodes of the solid cells that files may hold (not all of them can be computed with)."""

FLAT: Final = {
    kind: n_corner
    for n_corner, kinds in ((3, "triangle triangle6 triangle7 triangle10"), (4, "quad quad5 quad8 quad9 quad16"))
    for kind in kinds.split()
}
"""Corner nodes of the surface cells, which come first in their connectivity."""

SOLIDS: Final = {
    4: "tetra",
    5: "pyramid",
    6: "wedge",
    8: "hexahedron",
    10: "tetra10",
    15: "wedge15",
    20: "hexahedron20",
}
"""Solid cells of decks by number of nodes."""

SHELLS: Final = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
"""Shell, membrane, plane and surface cells of decks by number of nodes."""

_UPPER_EDGES_LAST: Final = {15: (*range(9), 12, 13, 14, 9, 10, 11), 20: (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)}
"""Order of the nodes, by their number, of files with the middle nodes of vertical edges before those of upper ones."""

NO_ROWS: Final = np.zeros(0, dtype=np.int64)
_DEEPEST: Final = 10  # levels of decks that include each other: a file that includes itself ends with a message

Include = Callable[[str], str]
"""Text of a file that a deck includes (MeshError where there is none)."""

MAX_PROBLEMS: Final = 8
"""So many problems of one file are listed; the rest follow from them more often than not."""


@dataclass
class MeshContent:
    """Content of a mesh file.

    Attributes
    ----------
    points : (n_point, 3) coordinates, units of the file.
    solids : cell type -> (n_cell, n_node) connectivity, rows of ``points``, VTK order of nodes.
    volumes : name of a volume group -> cell type -> rows of its cells in ``solids``.
    facets : name of a surface group -> arrays (n_facet, 3 | 4) of corner nodes, any orientation.
    node_sets : name -> rows of ``points``.
    parts : the volume groups that are the parts of the model where the format defines them, else None.
    skipped : cells that are neither solids nor surfaces (beams, springs, ...), number by type.
    unit : of length, as the file names it; empty where it does not. said : sentences on how the file was read.
    deck : what an Abaqus deck says beyond its mesh, None for other formats. sections : element sets of the solid
        sections of its volume groups, in capitals.
    """

    points: Array
    solids: dict[str, Index] = field(default_factory=dict)
    volumes: dict[str, dict[str, Index]] = field(default_factory=dict)
    facets: dict[str, list[Index]] = field(default_factory=dict)
    node_sets: dict[str, Index] = field(default_factory=dict)
    parts: tuple[str, ...] | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    unit: str = ""
    said: list[str] = field(default_factory=list)
    deck: DeckModel | None = None
    sections: dict[str, list[str]] = field(default_factory=dict)

    def add_solids(self, kind: str, cells: Index) -> Index:
        """Append cells of a type to ``solids``; their rows there, (n_cell,)."""
        before = self.solids.get(kind)
        start = 0 if before is None else len(before)
        self.solids[kind] = cells if before is None else np.concatenate([before, cells])
        return start + np.arange(len(cells), dtype=np.int64)

    def add_volume(self, name: str, kind: str, rows: Index) -> None:
        """Add rows of ``solids`` to a volume group; a cell given twice is in it once."""
        group = self.volumes.setdefault(name, {})
        group[kind] = np.union1d(group.get(kind, NO_ROWS), rows)

    def add_facets(self, name: str, kind: str, cells: Index) -> None:
        """Add surface cells (n_facet, n_node) of a type to a surface group: their corners, which come first."""
        self.facets.setdefault(name, []).append(cells[:, : FLAT[kind]])

    def add_nodes(self, name: str, rows: Index) -> None:
        """Add rows of ``points`` to a node set."""
        self.node_sets[name] = np.union1d(self.node_sets.get(name, NO_ROWS), rows)

    def without_solids(self) -> str:
        """What a file without solid cells holds, for a message."""
        plane = len(self.points) > 0 and bool((np.ptp(self.points, axis=0) == 0.0).any())
        faces = sum(len(table) for tables in self.facets.values() for table in tables)
        words = [f"{faces} surface cells in named groups"] if faces else []
        words += [f"{count} {kind}" for kind, count in self.skipped.items()]
        return "; ".join([*(["a plane mesh"] if plane else []), *words])

    def touching(self, group: str, name: str) -> bool:
        """Whether a surface group or node set has whole facets on the cells of a volume group."""
        cells = {kind: self.solids[kind][rows] for kind, rows in self.volumes[group].items()}
        if name in self.facets:
            nodes = np.unique(np.concatenate([table.ravel() for table in cells.values()]))
            return any(bool(np.isin(table, nodes).all(axis=1).any()) for table in self.facets[name] if len(table))
        some = self.node_sets.get(name, NO_ROWS)
        for kind, table in cells.items():
            corners = CORNERS[kind]
            least = 3 if corners == 4 else 4  # of the corners of a side; a wedge counts by its quadrilaterals
            if (np.isin(table[:, :corners], some).sum(axis=1) >= least).any():
                return True
        return False

    def part_names(self, where: str) -> tuple[str, ...]:
        """The volume groups that share the cells out among them: the parts of an assembly, in file order.

        Groups that only unite others (a set of all elements) are no parts. An empty tuple: the file has no group.

        Raises
        ------
        MeshError : the groups overlap, so that which of them are parts is the user's choice.
        """
        if self.parts is not None:
            return self.parts
        members = {name: _cell_keys(cells) for name, cells in self.volumes.items()}
        members = {name: keys for name, keys in members.items() if len(keys)}
        fine: list[str] = []
        taken = NO_ROWS
        # smallest first, so that a set of sets comes last; of equal ones the last in the file, which the user named
        # (gmsh writes Volume1 with the elements, and the physical group after them)
        late_first = dict.fromkeys(reversed(members))
        for name in sorted(late_first, key=lambda n: len(members[n])):
            inside = np.isin(members[name], taken)
            # a set of whole groups only unites them; one that cuts across is another choice of parts
            united = [other for other in fine if np.isin(members[other], members[name]).all()]
            if inside.all() and sum(len(members[other]) for other in united) == len(members[name]):
                continue
            if inside.any():
                what = "the volume groups overlap, so they cannot all be parts"
                known = f"parts = a list out of: {listed(members)}"
                problem = Problem(where, what, name, known, "list the groups that are parts")
                raise MeshError([problem], "unusable mesh")
            fine.append(name)
            taken = np.concatenate([taken, members[name]])
        return tuple(name for name in self.volumes if name in fine)


def _cell_keys(cells: dict[str, Index]) -> Index:
    """One number per cell, unique over the cell types."""
    kinds = sorted(CORNERS)
    parts = [rows * len(kinds) + kinds.index(kind) for kind, rows in cells.items()]  # (row, type) as one number
    return np.concatenate(parts) if parts else NO_ROWS


def upper_edges_last(cells: Index) -> Index:
    """Cells (n_cell, n_node) in the VTK order, from files that number middle nodes of vertical edges before those of
    upper edges."""
    n_node = cells.shape[1]
    return cells[:, list(_UPPER_EDGES_LAST.get(n_node, range(n_node)))]


class FileProblems:
    """Problems of one file, collected up to ``MAX_PROBLEMS`` and raised together."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.problems: list[Problem] = []

    def add(
        self,
        what: str,
        value: object = None,
        allowed: str | None = None,
        remedy: str | None = None,
        line: int | None = None,
    ) -> None:
        """One more problem; ``line`` counts from 1."""
        place = self.where if line is None else f"{self.where}, line {line}"
        text = None if value is None else str(value)[:80]
        problem = Problem(place, what, text, allowed, remedy)
        # the same problem of many lines is reported once
        if len(self.problems) < MAX_PROBLEMS and problem not in self.problems:
            self.problems.append(problem)

    @contextmanager
    def included(self, name: str, include: Include, depth: int, line: int) -> Iterator[str]:
        """Text of a file that a deck includes in this line, empty where decks are nested too deeply; lines of problems
        are counted in that file meanwhile. ``depth`` : of the deck, 0 for the outermost."""
        if depth >= _DEEPEST:
            self.add("files include each other too deeply", name, f"{_DEEPEST} levels", line=line)
            yield ""
            return
        text, outer = include(name), self.where
        self.where = f"{outer}, in {name}"
        yield text
        self.where = outer

    def stop(self) -> None:
        """Raise the problems, if there are any."""
        if self.problems:
            raise MeshError(self.problems, "unreadable mesh")


def rows_of(labels: Index, some: Index) -> tuple[Index, NDArray[np.bool_]]:
    """Position of each of ``some`` in ``labels`` (unique, any order), and which of them are there."""
    if not len(labels):  # there is no last place to clip to
        return np.zeros(len(some), dtype=np.int64), np.zeros(len(some), dtype=bool)
    order = np.argsort(labels, kind="stable")
    # a label above all others has no place: clipped, and found to differ
    place = np.minimum(np.searchsorted(labels, some, sorter=order), len(labels) - 1)
    rows = order[place]
    return rows, labels[rows] == some


_UNITS: Final = {1.0: (1.0, 1.0), 1e-3: (1e6, 1e12)}
"""Factors of moduli and densities by the scale: units of the scene, and mm, t, s, MPa in a scene in SI."""


def with_deck(raw: Mapping[str, Any], content: MeshContent, parts: Mapping[str, str], scale: float) -> dict[str, Any]:
    """The scene with what the deck says and the scene does not.

    A part without a material takes that of its section. A tie becomes a perfect interface, unless the scene has one
    between these parts; a set held at zero becomes a fixed boundary, unless the scene has one on that face.

    Parameters
    ----------
    parts : names of substructures by volume group. scale : length of a unit of the deck in that of the scene; where it
        is 1, materials are in the units of the scene, where it is 1e-3 of a metre, in mm, t, s, MPa. Else they are
        left out.
    """
    deck, whole = content.deck, dict(raw)
    assert deck is not None
    if scale in _UNITS and (scale == 1.0 or system_named(raw.get("units")) is SI):
        whole = _with_materials(whole, content, parts, _UNITS[scale])
    interfaces = {part_name(name): table for name, table in _ties(content, parts)}
    joined = [_parts_of(table) for table in named_tables(raw, "interface").values()]
    new = {
        n: t for n, t in interfaces.items() if _parts_of(t) not in joined and n not in named_tables(raw, "interface")
    }
    if new:
        whole["interface"] = {**(raw.get("interface") or {}), **new}
    held = {str(table.get("face")) for table in named_tables(raw, "boundary").values()}
    supports = {part_name(name): table for name, table in _supports(content, parts) if table["face"] not in held}
    supports = {name: table for name, table in supports.items() if name not in named_tables(raw, "boundary")}
    if supports:
        whole["boundary"] = {**(raw.get("boundary") or {}), **supports}
    return whole


def left_out(content: MeshContent, parts: Mapping[str, str], scene: Any) -> list[str]:
    """Keywords of a deck that a scene does not use, and its ties and supports that are in none of its tables.

    parts : names of substructures by volume group. scene : read (``Scene``).
    """
    deck = content.deck
    if deck is None:
        return []
    pairs = [frozenset(side.partition(".")[0] for side in i.sides) for i in scene.interface.values()]
    made = {name for name, table in _ties(content, parts) if _parts_of(table) in pairs}
    lost = [f"*TIE {name}" for name in dict.fromkeys(name for name, *_ in deck.ties) if name not in made]
    held = {b.face for b in scene.boundary.values() if hasattr(b, "face")}
    used = {name for name, table in _supports(content, parts) if table["face"] in held}
    lost += [f"*BOUNDARY {name}" for name, _ in deck.fixed if not any(u.startswith(_short(name)) for u in used)]
    return [*deck.unused_words(), *lost]


def _with_materials(
    raw: dict[str, Any], content: MeshContent, parts: Mapping[str, str], factors: tuple[float, float]
) -> dict[str, Any]:
    assert content.deck is not None
    materials, bodies = dict(raw.get("material") or {}), dict(raw["substructure"])
    for group, part in parts.items():
        table, known = bodies.get(part), content.deck.material_of(content.sections.get(group, []))
        if known is None or not isinstance(table, Mapping) or given(table, "material"):
            continue
        name, values = part_name(known[0]), known[1]
        stiffness, density = factors
        constants = {**values, "young_modulus": stiffness * values["young_modulus"]}
        # a material of that name in the scene stays as it is
        materials.setdefault(name, {**constants, "density": density * values["density"]})
        # keys of the scene win
        bodies[part] = {"material": name, **table}
    return {**raw, "material": materials, "substructure": bodies} if materials else raw


def _ties(content: MeshContent, parts: Mapping[str, str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Perfect interfaces between surfaces that belong to one part each."""
    assert content.deck is not None
    for name, *surfaces in content.deck.ties:
        sides = [_faces(content, parts, surface) for surface in surfaces]
        if all(len(side) == 1 for side in sides) and sides[0][0].split(".")[0] != sides[1][0].split(".")[0]:
            yield name, {"sides": [side[0] for side in sides], "behaviour": "perfect"}


def _supports(content: MeshContent, parts: Mapping[str, str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Fixed faces of the parts that a held set has whole facets of."""
    assert content.deck is not None
    for name, components in content.deck.fixed:
        # a set over several parts holds a face of each
        for face in _faces(content, parts, name):
            yield f"{_short(name)}_{face.split('.')[0]}", {"type": "fixed", "face": face, "components": [*components]}


def _faces(content: MeshContent, parts: Mapping[str, str], name: str) -> list[str]:
    """``part.face`` of the parts that a surface or node set of this name lies on; ``INSTANCE.SET`` names one part."""
    owner, short = name.rpartition(".")[0].upper(), _short(name).upper()
    spelled = next((n for n in (*content.facets, *content.node_sets) if n.upper() == short), None)
    if spelled is None:
        return []
    chosen = {group: part for group, part in parts.items() if not owner or group.upper() == owner}
    return [f"{part}.{spelled}" for group, part in chosen.items() if content.touching(group, spelled)]


def _short(name: str) -> str:
    return name.rpartition(".")[2]


def _parts_of(table: Mapping[str, Any]) -> frozenset[str]:
    """Substructures that an interface joins."""
    sides = table.get("sides")
    return frozenset(str(side).partition(".")[0] for side in sides) if isinstance(sides, list | tuple) else frozenset()
