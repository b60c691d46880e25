"""Faces closed in themselves: a shaft in a sleeve, joined over the whole circumference (a thread, a bore)."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.building import discretise
from latin_fmu.fem.mesh import FacetSet, Mesh
from latin_fmu.stability.surfaces import typed_box, write_mesh
from tests.scenes import ramp, solve

from .static_scenes import STEEL

INNER, RADIUS, OUTER, LENGTH = 1e-3, 5e-3, 9e-3, 20e-3


def tube(
    cell_type: str, radii: tuple[float, float], length: float, elements: tuple[int, int, int], start: float = 0.0
) -> Mesh:
    """Closed tube about z with elements along radius, circumference and axis; faces "inner", "outer", "foot", "top"."""
    n_radius, n_round, n_along = elements
    box = typed_box(cell_type, np.zeros(3), np.ones(3), (n_radius, n_round, n_along))
    seam = np.where(box.nodes[:, 1] > 1 - 1e-9, 0.0, box.nodes[:, 1])
    keys = np.round(np.column_stack([box.nodes[:, 0], seam, box.nodes[:, 2]]), 9)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = number.ravel()
    names = {"xmin": "inner", "xmax": "outer", "zmin": "foot", "zmax": "top"}
    faces = {name: FacetSet.of(*(number[b.facets] for b in box.faces[old].blocks)) for old, name in names.items()}
    across, around, along = box.nodes[first].T
    radius, angle = radii[0] + (radii[1] - radii[0]) * across, 2 * np.pi * around + start
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle), length * along], axis=1)
    blocks = Mesh.uniform(places, cell_type, number[box.blocks[0].cells]).blocks
    return Mesh(places, blocks, faces)


def joint(
    folder: Path,
    around: tuple[int, int],
    along: tuple[int, int],
    turn: float = 0.0,
    kind: str = "hexahedron",
    play: float = 0.0,
    **interface: Any,
) -> dict[str, Any]:
    """A hollow shaft pulled at its top, in a sleeve fixed at its foot; the sleeve's mesh is turned about the axis."""
    write_mesh(folder / "shaft.msh", tube(kind, (INNER, RADIUS), LENGTH, (3, around[0], along[0])))
    write_mesh(folder / "sleeve.msh", tube(kind, (RADIUS + play, OUTER), LENGTH, (3, around[1], along[1]), turn))
    return {
        "name": "joint",
        "material": {"steel": dict(STEEL)},
        "substructure": {
            n: {"material": "steel", "mesh": {"file": str(folder / f"{n}.msh"), "group": "body"}}
            for n in ("shaft", "sleeve")
        },
        "interface": {"thread": {"sides": ["shaft.outer", "sleeve.inner"], **interface}},
        "boundary": {"foot": {"type": "fixed", "face": "sleeve.foot"}},
        "load": {"pull": {"face": "shaft.top", "traction": [0.0, 0.0, 1e8], "law": ramp((0, 0), (1, 1))}},
        "time": {"end": 1.0, "instants": 1, "quasi_static": True},
        "solver": {"tolerance": 1e-6, "max_iterations": 200},
        "output": {"fields": True},
    }


def elongation(tables: dict[str, Any]) -> float:
    """Mean displacement of the top of the shaft along the axis, m."""
    shaft = solve(tables).substructures["shaft"]
    top = shaft.nodes[:, 2] > 0.999 * LENGTH
    return float(shaft.displacement[-1][top, 2].mean())


@cache
def of_one_mesh() -> float:
    with TemporaryDirectory() as folder:
        return elongation(joint(Path(folder), (24, 24), (6, 6), behaviour="perfect"))


@pytest.mark.parametrize(
    ("around", "along", "turn", "order"),
    [((16, 24), (6, 9), 0.0, 1), ((24, 16), (9, 6), 0.1, -1), ((24, 36), (6, 9), 0.05, 1)],
)
def test_bonded_thread(
    around: tuple[int, int], along: tuple[int, int], turn: float, order: int, tmp_path: Path
) -> None:
    """Meshes 2 to 3, turned against each other, either side first: the axial stiffness of one mesh to 2 %."""
    made = joint(tmp_path, around, along, turn, behaviour="perfect")
    made["interface"]["thread"]["sides"] = made["interface"]["thread"]["sides"][::order]
    assert elongation(made) == pytest.approx(of_one_mesh(), rel=0.02)


@pytest.mark.slow
def test_bonded_thread_of_quadratic_cells(tmp_path: Path) -> None:
    """Curved 8-node facets: to 0.5 % of the same with matching nodes."""
    one = elongation(joint(tmp_path, (24, 24), (6, 6), kind="hexahedron20", behaviour="perfect"))
    other = elongation(joint(tmp_path, (16, 24), (6, 9), 0.05, kind="hexahedron20", behaviour="perfect"))
    assert other == pytest.approx(one, rel=0.005)


@pytest.mark.parametrize("turn", [0.0, 1e-7, 2 * np.pi / 24])
def test_matching_nodes_all_the_way_round(turn: float, tmp_path: Path) -> None:
    """Vector areas of a closed face sum to round-off: normals are compared point by point."""
    unit = discretise(latin_fmu.scene_from_dict(joint(tmp_path, (24, 24), (4, 4), turn, behaviour="perfect"))).units[0]
    assert unit.geometry.matching
    assert np.linalg.norm(unit.geometry.areas @ unit.geometry.frames[:, 0]) < 1e-12
    radial = unit.geometry.points * [1, 1, 0] / RADIUS
    assert unit.geometry.frames[:, 0] == pytest.approx(radial, abs=1e-6)


def test_one_radius_leaves_no_gap(tmp_path: Path) -> None:
    """Chords of two meshes of one cylinder overlap and gape by their distance from it: closed everywhere."""
    made = joint(tmp_path, (16, 24), (6, 9), 0.03, friction_coefficient=0.1)
    geometry = discretise(latin_fmu.scene_from_dict(made)).units[0].geometry
    assert not geometry.matching
    np.testing.assert_array_equal(geometry.gap, 0.0)
    assert geometry.areas.sum() == pytest.approx(2 * np.pi * RADIUS * LENGTH, rel=0.02)


def test_play_is_measured(tmp_path: Path) -> None:
    """A clearance far above the distance of the chords is the gap, to that distance."""
    play = 0.3e-3
    made = joint(tmp_path, (40, 60), (2, 3), 0.03, play=play, friction_coefficient=0.1)
    geometry = discretise(latin_fmu.scene_from_dict(made)).units[0].geometry
    chord = RADIUS * (2 * np.pi / 40) ** 2 / 8
    assert geometry.gap == pytest.approx(play, abs=1.5 * chord)
    made["interface"]["thread"]["gap"] = "closed"
    np.testing.assert_array_equal(discretise(latin_fmu.scene_from_dict(made)).units[0].geometry.gap, 0.0)


def test_interference_is_refused_unless_closed(tmp_path: Path) -> None:
    made = joint(tmp_path, (40, 60), (2, 3), 0.03, play=-0.1e-3, friction_coefficient=0.1)
    with pytest.raises(latin_fmu.SceneError, match=r'overlap at the start.*gap = "closed"'):
        discretise(latin_fmu.scene_from_dict(made))
    made["interface"]["thread"]["gap"] = "closed"
    np.testing.assert_array_equal(discretise(latin_fmu.scene_from_dict(made)).units[0].geometry.gap, 0.0)


def test_closed_has_its_limit(tmp_path: Path) -> None:
    made = joint(tmp_path, (40, 60), (20, 30), play=1e-3, gap="closed")
    with pytest.raises(latin_fmu.SceneError, match=r"gap or overlap of the faces too large.*node spacing"):
        discretise(latin_fmu.scene_from_dict(made))


def test_a_clearance_below_the_facets_is_refused(tmp_path: Path) -> None:
    """50 um between a shaft of 12 elements round, whose facets are 170 um from the circle, and a bore of 24; between
    meshes of 96 and 120, the clearance; no remark where the radius is one."""

    def made(around: tuple[int, int], play: float, turn: float = 0.0) -> DiscretisedProblem:
        tables = joint(tmp_path, around, (2, 3), turn, play=play, friction_coefficient=0.1)
        return discretise(latin_fmu.scene_from_dict(tables))

    with pytest.raises(latin_fmu.SceneError, match=r"interface\.thread\.gap: a clearance.*0\.00017|0\.000169"):
        made((12, 24), 50e-6)
    fine = made((96, 120), 50e-6)
    assert fine.units[0].geometry.gap == pytest.approx(50e-6, rel=0.2)
    for built in (fine, made((12, 24), 0.0), made((24, 12), 0.0), made((16, 24), 0.0, 0.03)):
        assert not [r for r in built.remarks if r.code == "gap"]
