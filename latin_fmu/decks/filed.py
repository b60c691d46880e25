"""What a deck files of a run: displacements, velocities, forces, stresses and strains at nodes, as blocks of
``frd_file``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from ..mesh_files.content import Array, Index
from ..mesh_files.deck_scene import rows_of_set
from ..results.solution import Solution
from .frd_file import KINDS, FrdBlock, FrdMesh, frd_text
from .print_cards import DeckPrints
from .printed import PrintedValues

_ORDER: Final = (0, 1, 2, 5, 3, 4)
"""xx yy zz xy yz zx of tensors in the order of ``fem.elasticity``."""


def filed_text(prints: DeckPrints, solution: Solution) -> Iterator[str]:
    """The ``.frd`` of a run, in pieces."""
    return frd_text(filed_mesh(prints), filed_blocks(prints, solution))


def filed_mesh(prints: DeckPrints) -> FrdMesh:
    """Nodes and elements of the solids of a deck, by their numbers."""
    content = prints.content
    materials = list(content.deck.materials) if content.deck is not None else []
    elements: list[tuple[int, str, list[int], int]] = []
    for group in prints.parts:
        found = content.deck.material_of(content.sections.get(group, [])) if content.deck is not None else None
        number = 1 + materials.index(found[0]) if found is not None else 1
        for kind, rows in content.volumes[group].items():
            labels = content.cell_labels[kind][rows].tolist()
            nodes = content.labels[content.solids[kind][rows]].tolist()
            elements += [(label, kind, cell, number) for label, cell in zip(labels, nodes, strict=True)]
    elements.sort()
    used = _used_nodes(prints)
    return FrdMesh(content.labels[used], content.points[used], elements, materials)


def _used_nodes(prints: DeckPrints) -> Index:
    """Rows of the nodes of the solids of a deck, in the order of their numbers."""
    content = prints.content
    used = np.unique(np.concatenate([content.nodes_of(group) for group in prints.parts]))
    return np.asarray(used[np.argsort(content.labels[used])])


def filed_blocks(prints: DeckPrints, solution: Solution) -> Iterator[FrdBlock]:
    """The blocks that a deck files, in the order of CalculiX; instants that a run has not reached have none."""
    values = PrintedValues(prints, solution)
    content = prints.content
    used = _used_nodes(prints)
    reached = solution.time[-1] + 1e-9 * abs(solution.time[-1])
    for instant in prints.instants:
        wanted = {word: request for request in prints.filed(instant) for word in request.words}
        if instant.scene > reached:
            return
        for word in KINDS:
            if word not in wanted:
                continue
            rows = used
            if wanted[word].target:
                rows = used[np.isin(used, rows_of_set(content, wanted[word].target))]
            found = _at_nodes(values, word, instant.scene)[rows]
            there = ~np.isnan(found).any(axis=1)
            if there.any():
                moving = instant.step in prints.moving
                labels = content.labels[rows[there]]
                yield FrdBlock(word, instant.deck, labels, found[there], instant.step, instant.increment, moving)


def _at_nodes(values: PrintedValues, word: str, time: float) -> Array:
    """Values (n_point, 3 | 6) of all nodes; NaN where there are none."""
    if word == "RF":
        return values.nodal_forces(time)
    if word in ("U", "V"):
        return values.motion(np.arange(len(values.content.points)), word, time)
    return values.tensors(word, time)[:, _ORDER]
