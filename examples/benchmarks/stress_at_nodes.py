"""Stresses at the nodes by this package and by CalculiX: a plate with a hole, a shouldered bar, a bolted flange.

The decks of plate and bar are written here, 10-node tetrahedra, and run by both codes as they are; both have closed
forms. The flange is that of against_calculix.py: ten
parts of 4-node tetrahedra with contact and friction (gmsh meshes it), compared away from edges of contacts, where
linear elasticity has no limit, and over all nodes. Without ccx only the closed forms are compared.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import flange
import numpy as np
from calculix import MISSING, installed, run
from harness import prepared, tools

import latin_fmu
from latin_fmu.decks.card_text import card, element_card, node_card, node_set_card
from latin_fmu.decks.exporting import export_deck
from latin_fmu.decks.importing import import_deck
from latin_fmu.fem.elasticity import von_mises
from latin_fmu.fem.elements import principal
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.fem.reference_cells import CELL_EDGES
from latin_fmu.mesh_files.abaqus import SOLID_FACES

PULL = 100.0  # MPa
FLANGE = flange.Mesh(5.0, 5.0, 2.0)
# tetrahedra of a hexahedron around a diagonal: neighbours cut their common face alike
SIX = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))


@dataclass(frozen=True)
class Solid:
    """A part under tension.

    Attributes
    ----------
    nodes : (n, 3), mm. cells : 10-node tetrahedra (m, 10). held : nodes held along each axis. pulled : elements with
        the numbers of their faces under ``PULL``. factor : largest stress over it in closed form. ratio : Poisson's.
        axis : of the tension.
    """

    name: str
    nodes: tools.Array
    cells: np.ndarray
    held: Sequence[np.ndarray]
    pulled: Sequence[tuple[int, int]]
    factor: float
    ratio: float = 0.3
    axis: int = 2

    def deck(self) -> str:
        """Deck for CalculiX, mm, t, s."""
        numbers = np.arange(1, len(self.nodes) + 1)
        elements = np.arange(1, len(self.cells) + 1)
        lines = [*node_card(self.nodes, numbers, "NALL"), *element_card("C3D10", self.cells + 1, elements, "SOLID")]
        for axis, nodes in enumerate(self.held, 1):
            lines += node_set_card(f"HELD{axis}", nodes + 1)
        lines += card("MATERIAL", {"NAME": "STEEL"})
        lines += card("ELASTIC", rows=[(210e3, self.ratio)])
        lines += card("DENSITY", rows=[(7.8e-9,)])
        lines += card("SOLID SECTION", {"ELSET": "SOLID", "MATERIAL": "STEEL"})
        lines += card("BOUNDARY", rows=[(f"HELD{axis}", axis, axis) for axis in range(1, len(self.held) + 1)])
        lines += [*card("STEP"), *card("STATIC", rows=[(1.0, 1.0)])]
        lines += card("DLOAD", rows=[(element + 1, f"P{face}", -PULL) for element, face in self.pulled])
        lines += [*card("NODE FILE", rows=[("U",)]), *card("EL FILE", rows=[("S",)]), *card("END STEP")]
        return "\n".join([*lines, ""])


def quadratic(
    ticks: Sequence[tools.Array], places: Callable[[tools.Array], tools.Array]
) -> tuple[tools.Array, tools.Array, np.ndarray]:
    """Parameters (n, 3) and nodes (n, 3) of a grid of 10-node tetrahedra (m, 10).

    ticks : of the three parameters. places : nodes of parameters.
    """
    counts = [len(t) - 1 for t in ticks]
    box = box_mesh(np.zeros(3), np.array(counts, dtype=float), (counts[0], counts[1], counts[2]))
    corners = np.rint(box.nodes).astype(int)
    at = np.stack([t[corners[:, axis]] for axis, t in enumerate(ticks)], axis=1)
    cells = box.blocks[0].cells[:, SIX].reshape(-1, 4)
    ends = np.sort(cells[:, np.array(CELL_EDGES["tetra"])], axis=2).reshape(-1, 2)
    unique, inverse = np.unique(ends, axis=0, return_inverse=True)
    middles = box.n_node + inverse.reshape(len(cells), -1)
    at = np.concatenate([at, at[unique].mean(axis=1)])
    return at, places(at), np.concatenate([cells, middles], axis=1)


def faces_on(cells: np.ndarray, chosen: np.ndarray) -> list[tuple[int, int]]:
    """Elements and numbers of their faces whose corners are all among the ``chosen`` nodes (a mask)."""
    return [
        (element, number)
        for number, local in enumerate(SOLID_FACES[4], 1)
        for element in np.flatnonzero(chosen[cells[:, list(local)]].all(axis=1)).tolist()
    ]


def plate(around: int = 12, out: int = 14) -> Solid:
    """Quarter of a plate 400 mm long and 200 mm wide with a hole of 20 mm, pulled along x, in plane stress: without
    contraction across. Heywood's factor of the gross section."""
    hole, wide = 10.0, 100.0

    def places(at: tools.Array) -> tools.Array:
        turn = 0.5 * np.pi * at[:, 1]
        ray = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        # up the end, then back along the side
        edge = (
            np.stack([2.0 * np.clip(2.0 - 2.0 * at[:, 1], 0.0, 1.0), np.clip(2.0 * at[:, 1], 0.0, 1.0)], axis=1) * wide
        )
        return np.column_stack([hole * ray + at[:, :1] * (edge - hole * ray), at[:, 2]])

    _, nodes, cells = quadratic(
        (np.linspace(0, 1, out + 1) ** 2.2, np.linspace(0, 1, around + 1), np.arange(2)), places
    )
    held = [np.flatnonzero(np.abs(nodes[:, axis]) < 1e-9) for axis in range(3)]
    share = hole / wide
    factor = (2.0 + (1.0 - share) ** 3) / (1.0 - share)
    return Solid(
        "plate with a hole",
        nodes,
        cells,
        held,
        faces_on(cells, np.abs(nodes[:, 0] - 2.0 * wide) < 1e-9),
        factor,
        0.0,
        0,
    )


THICK, THIN, LENGTH = 5.0, 4.0, 12.0  # radii and length of both ends of the bar, mm
BORE = 0.1  # radius of a bore that keeps the mesh regular, mm


def bar(along: int = 8, out: int = 8, around: int = 4) -> Solid:
    """Quarter of a round bar that steps from 10 to 8 mm with a fillet of 1 mm, pulled along z; factor of Tipton, Sorem
    and Rolovic (Journal of Mechanical Design 118, 1996): charts of photoelastic tests are a tenth lower."""
    fillet = THICK - THIN

    def places(at: tools.Array) -> tools.Array:
        t, depth, turn = at[:, 0], at[:, 1], 0.5 * np.pi * at[:, 2]
        # thick end up to t = 1, fillet up to 2, thin end up to 3
        bend = 0.5 * np.pi * np.clip(t - 1.0, 0.0, 1.0)
        radius = THICK - fillet * np.sin(bend)
        height = fillet * (1.0 - np.cos(bend)) + LENGTH * (np.minimum(t - 1.0, 0.0) + np.maximum(t - 2.0, 0.0))
        # sections lean near the axis, for elements that are not flat at the shoulder
        middle = height + 3.0 * np.interp(t, [0.0, 1.0, 1.5, 2.0, 3.0], [0.0, -1.0, -0.4, 0.1, 0.0])
        r, z = radius + depth * (BORE - radius), height + depth * (middle - height)
        return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)

    end = np.linspace(0.0, 1.0, along + 1) ** 2.0
    ticks = np.concatenate([1.0 - end[:0:-1], 1.0 + np.linspace(0.0, 1.0, along + 1), 2.0 + end[1:]])
    # from the bore outwards, finer there
    inward = np.linspace(1.0, 0.0, out + 1) ** 1.6
    at, nodes, cells = quadratic((ticks, inward, np.linspace(0.0, 1.0, around + 1)), places)
    on = np.abs(at[:, 0]) < 1e-9, np.abs(at[:, 0] - 3.0) < 1e-9
    held = [*(np.flatnonzero(np.abs(nodes[:, axis]) < 1e-9) for axis in (0, 1)), np.flatnonzero(on[0])]
    step, blunt = THICK / THIN, 0.5 * fillet / THIN
    root = (3.43 - 3.41 * step**2 + 0.0232 * step**4) / (1.0 - 8.85 * step**2 - 0.078 * step**4)
    factor = 0.493 + 0.48 * step**-2.43 + blunt**-0.48 * root**0.5
    return Solid("shouldered bar", nodes, cells, held, faces_on(cells, on[1]), factor)


def of_package(solid: Solid, folder: Path) -> tools.Array:
    """Stresses (n_node, 6) at the nodes, MPa, by this package, from the deck."""
    file = folder / "solid.inp"
    file.write_text(solid.deck())
    tables = dict(import_deck(file, folder, "mm-t-s").tables)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables, folder))
    ((name, request),) = solution.recovered.items()
    history = solution.substructures[name]
    assert history.displacement is not None
    return request.stress_at_nodes(history.displacement[-1:], history.time[-1:])[0]


@dataclass(frozen=True)
class StressComparison:
    """Stresses at the nodes of one problem: largest principal stress here and there, and by closed form, MPa, NaN where
    there is none; largest difference of von Mises stresses over the largest, away from edges of contacts (``away``) and
    over all nodes."""

    name: str
    here: float
    there: float
    closed: float
    away: float
    everywhere: float

    def line(self) -> str:
        """Row of the table."""
        return (
            f"    {self.name:18} largest principal {self.here:8.2f} MPa here, {self.there:8.2f} MPa there, "
            f"{self.closed:8.2f} MPa in closed form; von Mises apart by {self.away:.2%} away from edges of contacts, "
            f"{self.everywhere:.2%} anywhere"
        )


def compared(
    name: str, here: tools.Array, there: tools.Array | None, near: np.ndarray, closed: float
) -> StressComparison:
    """Two fields (n_node, 6); ``near`` (n_node,) an edge of a contact."""
    largest = float(principal(here).max())
    if there is None:
        return StressComparison(name, largest, np.nan, closed, np.nan, np.nan)
    size, other = von_mises(here), von_mises(there)
    apart = np.abs(size - other)
    return StressComparison(
        name,
        largest,
        float(principal(there).max()),
        closed,
        float(apart[~near].max() / other[~near].max()),
        float(apart.max() / other.max()),
    )


def of_calculix(deck: str) -> tools.Array | None:
    """Stresses (n_node, 6) at the nodes by CalculiX, as the deck has them; None where there is no ccx."""
    if not installed():
        return None
    return run(deck, 1.0).stress


def solid_comparison(solid: Solid) -> StressComparison:
    """Plate or bar by both codes."""
    with TemporaryDirectory() as folder:
        here = of_package(solid, Path(folder))
    nothing = np.zeros(len(solid.nodes), dtype=bool)
    return compared(solid.name, here, of_calculix(solid.deck()), nothing, solid.factor * PULL)


def flange_comparison(mesh: flange.Mesh, limit: float) -> StressComparison:
    """The flange by both codes, at its last instant."""
    with TemporaryDirectory() as folder:
        case = mesh.made(Path(folder) / "flange.msh")
        case.description["output"] |= {"nodal_stress": True}
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(case.description))
        ready = prepared(case, {})
    deck = export_deck(ready, replace(flange.PENALTY, stresses=True, last=True))
    stresses, near = [], []
    for name, request in solution.recovered.items():
        history = solution.substructures[name]
        assert history.displacement is not None
        assert history.marks is not None
        stresses.append(request.stress_at_nodes(history.displacement[-1:], history.time[-1:])[0])
        near.append(history.marks.contact_edge)
    there = None
    if installed():
        found = run(deck.text, float(ready.time[-1]), limit).stress
        if found is not None:
            there = np.concatenate([found[deck.nodes[name] - 1] for name in solution.recovered])
    here = 1e-6 * np.concatenate(stresses)
    return compared("bolted flange", here, None if there is None else 1e-6 * there, np.concatenate(near), np.nan)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=float, default=1800.0, help="wall-clock seconds for CalculiX on the flange")
    given = parser.parse_args(argv)
    if not installed():
        print(MISSING)
    for solid in (plate(), bar()):
        print(solid_comparison(solid).line(), flush=True)
    if find_spec("gmsh") is None:
        print(flange.NO_GMSH)
        return 0
    print(flange_comparison(FLANGE, given.limit).line())
    return 0


if __name__ == "__main__":
    sys.exit(main())
