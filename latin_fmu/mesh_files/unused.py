"""What a mesh file holds beside the solids that a scene takes from it: named once, with its number and what to write in
its place."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import listed
from .content import NO_ROWS, FileLine, FileProblems, Index, MeshContent
from .deck_card import Card

_MASS: Final = "write [point_mass.NAME]"
_BEAM: Final = "write [spring.NAME], for a screw [bolt.NAME], or mesh them with solids"
_SPRING: Final = "write [spring.NAME]"
_COUPLING: Final = "write [coupling.NAME]"
_SHELL: Final = "mesh it with solids"
_NOTHING: Final = "they have no equivalent here"
_TAKE: Final = 'or take = ["{}"] in the table of the mesh'
TAKEN: Final = ("CONM2", "RBE2", "RBE3")
"""Entries of Nastran that ``take`` of the mesh table makes tables of."""
_REMEDIES: Final = tuple(
    (re.compile(pattern), remedy)
    for pattern, remedy in (
        # Nastran
        (r"CONM2", f"{_MASS}, {_TAKE.format('CONM2')}"),
        (r"CONM1|CMASS[1-4]", _MASS),
        (r"CBAR|CBEAM3?|CBEND|CROD|CONROD|CTUBE|BAROR|BEAMOR", _BEAM),
        (r"CELAS[1-4]|CDAMP[1-5]|CVISC|CBUSH(1D|2D)?|CGAP|GENEL", _SPRING),
        (r"RBE2", f"{_COUPLING} with rigid = true, {_TAKE.format('RBE2')}"),
        (r"RBE3", f"{_COUPLING} or a load on the face, {_TAKE.format('RBE3')}"),
        (r"RBE1|RBAR1?|RROD|RTRPLT1?|RSPLINE|RJOINT|RSSCON|MPC|MPCADD", _COUPLING),
        (r"CWELD|CFAST|CSEAM|CINTC", f"{_COUPLING}, or [interface.NAME] between the parts"),
        (r"CQUAD[A-Z0-9]*|CTRIA[A-Z0-9]*|CPLST[NS][0-9]|CSHEAR|CCONEAX", _SHELL),
        (r"CHBDY[EGP]|CAERO[1-7]|CRAC[23]D|CAABSF|CFLUID[234]|CSLOT[34]|CDUM[1-9]", _NOTHING),
        # Abaqus, CalculiX
        (r"MASS|ROTARYI", _MASS),
        (r"SPRING[12A]|DASHPOT[12A]|GAP[A-Z]*|CONN[23]D2|JOINTC|ITS[A-Z]*", _SPRING),
        (r"B[23][123]?[A-Z]*|T[23]D[23][A-Z]*|PIPE[23][A-Z0-9]*|ELBOW[0-9A-Z]*|FRAME[23]D|BR3?|B3\dR?", _BEAM),
        (r"DCOUP[23]D|RB[23]D2|R2D2|RAX2", _COUPLING),
        (r"S\w*|M3D\w*|CPS\w*|CPE\w*|CAX\w*|CGAX\w*|MAX\w*|MGAX\w*|SAX\w*", _SHELL),
        (r"D|U\w*|VU\w*|HEATCAP|F2D2|F3D[34]|AC[12]D\w*|ACAX\w*|DC[12]D\w*|DCAX\w*|DS\d", _NOTHING),
    )
)


@dataclass(frozen=True)
class Skipped:
    """Elements of a type that is not read.

    Attributes
    ----------
    word : the type. count : of elements. nodes : labels of their nodes, as far as they are needed. place : of the
    first. properties : as the file names them.
    """

    word: str
    count: int
    nodes: Index
    place: FileLine
    properties: tuple[str, ...] = ()

    @staticmethod
    def of_card(card: Card, name: str) -> Skipped:
        """The elements of an *ELEMENT card; a line that ends with a comma goes on."""
        count = 0
        nodes = []
        first = True
        for i, fields in card.tokens():
            numbers = [int(f) for f in fields if f.isascii() and f.isdigit() and len(f) < 19]
            count += first
            if first:
                # the first one is the label of the element
                numbers = numbers[1:]
            nodes += numbers
            first = not card.rows[i].rstrip().endswith(",")
        properties = tuple(filter(None, [card.name("ELSET")]))
        if is_known(name):
            nodes = []
        return Skipped(name, count, np.array(nodes, dtype=np.int64), card.place, properties)


def is_known(word: str) -> bool:
    """Whether a type of elements is known to be no solid."""
    return any(pattern.fullmatch(word.upper()) for pattern, _ in _REMEDIES)


def note(content: MeshContent, skipped: Skipped, in_cells: int, problems: FileProblems) -> None:
    """Add elements that are not read to the content; types that are not known are refused where most of their nodes
    are in no cell. ``in_cells`` : how many of ``skipped.nodes`` are in one."""
    content.skipped[skipped.word] = content.skipped.get(skipped.word, 0) + skipped.count
    names = content.properties.setdefault(skipped.word, {})
    names.update(dict.fromkeys(skipped.properties))
    if not is_known(skipped.word) and 2 * in_cells < len(skipped.nodes):
        problem = problems.problem(
            f"elements of a type that is not known, with {len(skipped.nodes) - in_cells} nodes that no other cell has",
            f"{skipped.count} {skipped.word}",
            None,
            f'export them as other cells; ignore = ["{skipped.word}"] in the table of the mesh leaves them out',
            skipped.place,
        )
        content.refused.setdefault(skipped.word, problem)


def unused_content(content: MeshContent, groups: Collection[str], taken: Collection[str]) -> Iterator[str]:
    """Sentences on what a file holds and a scene does not use, and on how it was read.

    groups : volume groups that are parts of the scene; none where the whole file is one. taken : entries that became
    tables of the scene.
    """
    yield from content.said
    for word, count in content.skipped.items():
        if word in taken:
            continue
        remedy = next((words for pattern, words in _REMEDIES if pattern.fullmatch(word.upper())), _NOTHING)
        names = list(content.properties.get(word, ()))
        if names:
            of = f" ({_named(names)})"
        else:
            of = ""
        yield f"{count} {word}{of} {'are' if count > 1 else 'is'} not used: {remedy}"
    apart = list(_facets_on_no_solid(content))
    yield from apart
    if not apart and not content.skipped:  # these have nodes of their own
        yield from _nodes_of_no_cell(content)
    if groups:
        yield from _cells_of_no_part(content, groups)


def _facets_on_no_solid(content: MeshContent) -> Iterator[str]:
    solid = np.unique(np.concatenate([NO_ROWS, *(cells.ravel() for cells in content.solids.values())]))
    apart = {
        name: sum(int((~np.isin(table, solid).all(axis=1)).sum()) for table in tables)
        for name, tables in content.facets.items()
    }
    count = sum(apart.values())
    if count:
        which = listed(f"{name}: {number}" for name, number in apart.items() if number)
        if count == 1:
            verb = "surface cell lies on no solid and is"
        else:
            verb = "surface cells lie on no solid and are"
        yield f"{count} {verb} not used ({which}): for a plate {_SHELL}"


# nodes, and part of all nodes, from which on they are more than points of reference
_LOOSE: Final = 4
_LOOSE_PART: Final = 0.01


def _nodes_of_no_cell(content: MeshContent) -> Iterator[str]:
    """Nodes that no cell has: what is left of cells that a writer leaves out."""
    tables = [cells.ravel() for cells in content.solids.values()]
    reference = np.array([item.node for item in content.attached], dtype=np.int64)
    loose = len(content.points) - len(np.unique(np.concatenate([NO_ROWS, reference, *tables])))
    if loose >= max(_LOOSE, _LOOSE_PART * len(content.points)):
        yield (
            f"{loose} of its {len(content.points)} nodes belong to no cell: compare volume and mass with the program "
            "that wrote it, which may leave out cells or middle nodes that the format does not have"
        )


def _named(names: list[str]) -> str:
    if not all(name.isdigit() for name in names):
        return listed(names)
    if len(names) > 1:
        return f"properties {listed(names)}"
    return f"property {listed(names)}"


def _cells_of_no_part(content: MeshContent, groups: Collection[str]) -> Iterator[str]:
    count, rest = 0, dict[str, Index]()
    for kind, cells in content.solids.items():
        used = np.concatenate(
            [NO_ROWS, *(content.volumes[g].get(kind, NO_ROWS) for g in groups if g in content.volumes)]
        )
        rest[kind] = np.setdiff1d(np.arange(len(cells)), used)
        count += len(rest[kind])
    if count:
        names = [
            name
            for name, rows in content.volumes.items()
            if any(np.isin(r, rest[kind]).any() for kind, r in rows.items())
        ]
        if names:
            which = f" ({listed(names)})"
        else:
            which = ""
        if count == 1:
            verb = "solid cell{} belongs"
        else:
            verb = "solid cells{} belong"
        yield f"{count} {verb.format(which)} to no part of the scene: list them in parts if they matter"


def nodes_in_cells(content: MeshContent, rows: Index) -> int:
    """How many of these rows of points are nodes of a solid or surface cell."""
    tables = [cells.ravel() for cells in content.solids.values()]
    tables += [table.ravel() for group in content.facets.values() for table in group]
    return int(np.isin(rows, np.concatenate([NO_ROWS, *tables])).sum())
