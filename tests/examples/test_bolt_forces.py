"""Forces and moments in the shank of a bolt, by this package and by the nodal forces of CalculiX on one mesh."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.building import discretise
from latin_fmu.decks.card_text import card, element_card, node_card, node_set_card
from latin_fmu.decks.export_draft import DeckChoices
from latin_fmu.decks.exporting import export_deck
from latin_fmu.scene.fields import split_face
from tests.verification.bolted_meshes import write_joint
from tests.verification.test_bolts import joint

Array = np.ndarray
SIDES = {
    "head": ["upper.seat", "bolt.head"],
    "nut": ["bolt.nut", "lower.seat"],
    "plates": ["lower.joint", "upper.joint"],
}
HEIGHTS = {"head": 10e-3, "parting": 0.0, "thread": -10e-3}
RAMP = {"type": "table", "times": [0, 1], "values": [0, 1]}


def bonded_joint(folder: Path) -> dict[str, Any]:
    """Two plates that are bonded to a bolt and to each other beside it, pulled apart and sheared by the upper one."""
    data = joint(write_joint(folder))
    data["interface"] = {name: {"sides": pair, "behaviour": "perfect"} for name, pair in SIDES.items()}
    # a bolt that is not tightened: CalculiX has none
    data["bolt"]["b"] = {"substructure": "bolt", "axis": [0, 0, 1], "shortening": 1e-12}
    data["time"] = {"end": 1.0, "instants": 1, "quasi_static": True}
    data["load"] = {"pull": {"face": "upper.far", "traction": [3e6, 1e6, 5e6], "law": RAMP}}
    return data


def shared_nodes(ready: DiscretisedProblem) -> dict[str, Array]:
    """Numbers of the nodes of every body from 1, one number for two that a bond joins."""
    ends = np.cumsum([0, *(body.mesh.n_node for body in ready.bodies.values())])
    first = dict(zip(ready.bodies, ends.tolist(), strict=False))
    number = np.arange(ends[-1])
    for pair in SIDES.values():
        bodies, faces = zip(*(split_face(face) for face in pair), strict=True)
        nodes = [ready.bodies[b].mesh.faces[f].nodes for b, f in zip(bodies, faces, strict=True)]
        places = [ready.bodies[b].mesh.nodes[n] for b, n in zip(bodies, nodes, strict=True)]
        apart = np.linalg.norm(places[0][:, None] - places[1][None], axis=2)
        here, there = np.nonzero(apart < 1e-9)
        one, two = first[bodies[0]] + nodes[0][here], first[bodies[1]] + nodes[1][there]
        number[one] = number[two] = np.minimum(number[one], number[two])
    number = np.unique(number, return_inverse=True)[1]
    return {name: number[first[name] : first[name] + b.mesh.n_node] + 1 for name, b in ready.bodies.items()}


def held_part(ready: DiscretisedProblem, moved: Array, chosen: Array, section: Array) -> str:
    """A deck of some elements of the bolt whose nodes all have given displacements (n_node, 3), which prints the forces
    on the nodes of the section."""

    def lines() -> Iterator[str]:
        mesh = ready.bodies["bolt"].mesh
        cells = mesh.blocks[0].cells[chosen]
        used = np.unique(cells)
        yield from node_card(mesh.nodes[used], used + 1, "NALL")
        yield from element_card("C3D8", cells + 1, np.arange(1, len(cells) + 1), "PART")
        yield from card("MATERIAL", {"NAME": "STEEL"})
        yield from card("ELASTIC", rows=[(2.1e11, 0.3)])
        yield from card("SOLID SECTION", {"ELSET": "PART", "MATERIAL": "STEEL"})
        yield from node_set_card("CUT", section + 1)
        yield from (*card("STEP"), *card("STATIC", rows=[(1.0, 1.0)]))
        yield from card(
            "BOUNDARY", rows=[(int(n) + 1, k + 1, k + 1, float(moved[n, k])) for n in used for k in range(3)]
        )
        yield from (*card("NODE PRINT", {"NSET": "CUT"}, [("RF",)]), *card("END STEP"))

    return "\n".join(lines()) + "\n"


def resultant(deck: ModuleType, ready: DiscretisedProblem, moved: Array, height: float) -> Array:
    """Three forces and three moments (6,), N and N m, along z, x and y, that the part above a section of the shank
    exerts on the one below, about the point of the axis there: by nodal forces of CalculiX."""
    mesh = ready.bodies["bolt"].mesh
    section = np.flatnonzero(
        (np.abs(mesh.nodes[:, 2] - height) < 1e-9) & (np.hypot(mesh.nodes[:, 0], mesh.nodes[:, 1]) < 3.9e-3)
    )
    cells = mesh.blocks[0].cells
    # the side that no other part touches at the section
    above = height <= 0.0
    level = mesh.nodes[cells][..., 2].mean(axis=1)
    chosen = np.isin(cells, section).any(axis=1) & ((level > height) == above)
    text = held_part(ready, moved, chosen, section)
    printed = deck.run(text, 1.0).printed.held
    assert printed is not None
    forces = printed[-1][section]
    arms = mesh.nodes[section] - [0.0, 0.0, height]
    sums = np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])
    # the forces on the nodes hold the part: below the section they are those of the other side
    return (-1.0 if above else 1.0) * sums[[2, 0, 1, 5, 3, 4]]


@pytest.mark.slow
def test_section_forces_are_those_of_calculix(tmp_path: Path) -> None:
    deck = importlib.import_module("calculix")
    if not deck.installed():
        pytest.skip(deck.MISSING)
    scene = scene_from_dict(bonded_joint(tmp_path))
    bolt, ready = solve(scene).bolts["b"], discretise(scene)
    numbers = shared_nodes(ready)
    free = replace(ready, cuts={}, scene=ready.scene.model_copy(update={"bolt": {}}))
    whole = export_deck(free, DeckChoices(direct=True, every=True), numbers)
    there = deck.run(whole.text, 1.0).printed.displacement
    assert there is not None
    assert bolt.sections is not None
    assert bolt.section_force is not None
    assert bolt.section_moment is not None
    moved = there[-1][numbers["bolt"] - 1]
    for name, height in HEIGHTS.items():
        i = bolt.sections.names.index(name)
        here = np.concatenate([bolt.section_force[-1, i], bolt.section_moment[-1, i]])
        found = resultant(deck, ready, moved, height)
        for part in (slice(0, 3), slice(3, 6)):
            np.testing.assert_allclose(here[part], found[part], atol=1e-2 * np.abs(found[part]).max())
