"""Faces that fit and faces that do not: pairing of points, gaps, preloads; every refusal has a remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu.errors import SceneError
from latin_fmu.fem.mesh import Mesh, box_mesh

MODELS = Path(__file__).parents[2] / "models"


def refused(make: Callable[[Any], Any], tables: Any, *words: str) -> SceneError:
    with pytest.raises(SceneError) as caught:
        make(tables)
    for word in words:
        assert word in str(caught.value)
    return caught.value


def write_inp(path: Path, mesh: Mesh, faces: Iterable[str]) -> None:
    """Volume group "part" and some of its faces."""
    lines = ["*NODE", *(f"{i + 1}, {x:.17g}, {y:.17g}, {z:.17g}" for i, (x, y, z) in enumerate(mesh.nodes))]
    tag = 0
    groups = [("C3D8", "part", mesh.blocks[0].cells), *(("S4", f, mesh.faces[f].blocks[0].facets) for f in faces)]
    for kind, name, cells in groups:
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
        for cell in cells:
            tag += 1
            lines.append(f"{tag}, " + ", ".join(str(c + 1) for c in cell))
    path.write_text("\n".join([*lines, ""]))


def with_mesh(tables: Any, name: str, path: Path, **mesh: Any) -> Any:
    """Replace a box by a mesh file."""
    tables["substructure"][name] = {"material": "m", "mesh": {"file": str(path), **mesh}}
    return tables


def test_matching_faces(bars_scene: Any, bar_box: Any, made: Any) -> None:
    """Points are those of side E; N points to E'; areas, traces and gap belong to the pairs."""
    tables = bars_scene(gap=0.02)
    tables["substructure"]["b"]["box"] = bar_box(1.0, n=3, across=2)
    tables["substructure"]["c"]["box"] = bar_box(2.02, n=2, across=2)
    tables["interface"].pop("joint")
    unit = made(tables).assembly.interfaces[0]
    geometry = unit.geometry
    assert geometry.n_point == 9
    np.testing.assert_allclose(geometry.points[:, 2], 2.0)
    np.testing.assert_allclose(geometry.gap, 0.02, rtol=1e-12)
    np.testing.assert_allclose(geometry.frames[:, 0], np.tile([0.0, 0.0, 1.0], (9, 1)))
    assert geometry.areas.sum() == pytest.approx(0.25)
    # T 1 = 1 and equal positions of both sides up to the gap
    for side, name, z in ((0, "b", 2.0), (1, "c", 2.02)):
        trace = geometry.traces[side]
        np.testing.assert_allclose(trace @ np.ones(trace.shape[1]), 1.0)
        nodes = box_mesh(
            np.array(tables["substructure"][name]["box"]["origin"]),
            np.array([0.5, 0.5, 1.0]),
            tuple(tables["substructure"][name]["box"]["elements"]),
        ).nodes
        traced = (trace @ nodes.ravel()).reshape(-1, 3)
        np.testing.assert_allclose(traced[:, :2], geometry.points[:, :2], atol=1e-12)
        np.testing.assert_allclose(traced[:, 2], z, rtol=1e-12)


def test_sides_exchanged_give_the_opposite_normal(bars_scene: Any, made: Any) -> None:
    tables = bars_scene()
    tables["interface"]["meet"]["sides"].reverse()
    np.testing.assert_allclose(made(tables).assembly.interfaces[1].geometry.frames[:, 0, 2], -1.0)


def test_different_numbers_of_nodes(bars_scene: Any, bar_box: Any, made: Any) -> None:
    """Nodes of the finer side are the points; the other side takes part by weights that sum to 1."""
    tables = bars_scene()
    tables["substructure"]["c"]["box"] = bar_box(2.0, across=2)
    geometry = made(tables).assembly.interfaces[1].geometry
    assert (geometry.n_point, geometry.owner, geometry.matching) == (9, 1, False)
    np.testing.assert_allclose(geometry.frames[:, 0], np.tile([0.0, 0.0, 1.0], (9, 1)))
    np.testing.assert_allclose(geometry.gap, 0.0, atol=1e-15)
    for trace in geometry.traces:
        np.testing.assert_allclose(trace @ np.ones(trace.shape[1]), 1.0, rtol=1e-13)


@pytest.mark.parametrize("fine", ["b", "c"])
def test_gap_of_different_meshes(bars_scene: Any, bar_box: Any, made: Any, fine: str) -> None:
    """Open > 0 and N from E to E', whichever side gives the points."""
    tables = bars_scene(gap=0.02)
    tables["substructure"][fine]["box"] = bar_box(1.0 if fine == "b" else 2.02, across=3)
    tables["interface"].pop("joint")
    geometry = made(tables).assembly.interfaces[0].geometry
    assert geometry.owner == ("b", "c").index(fine)
    np.testing.assert_allclose(geometry.gap, 0.02, rtol=1e-12)
    np.testing.assert_allclose(geometry.frames[:, 0], np.tile([0.0, 0.0, 1.0], (16, 1)))
    np.testing.assert_allclose(geometry.points[:, 2], 2.0 if fine == "b" else 2.02)


def test_faces_beside_each_other(bars_scene: Any, made: Any) -> None:
    """The points lie in the common part; without one the scene is refused."""
    tables = bars_scene()
    tables["substructure"]["c"]["box"]["origin"] = [0.1, 0.0, 2.0]
    geometry = made(tables).assembly.interfaces[1].geometry
    assert geometry.areas.sum() == pytest.approx(0.4 * 0.5)
    tables["substructure"]["c"]["box"]["origin"] = [0.6, 0.0, 2.0]
    refused(made, tables, "interface.meet.sides", "no part in common", "common area 0", "0.1 m apart")


def test_faces_that_look_the_same_way(bars_scene: Any, made: Any) -> None:
    tables = bars_scene()
    tables["interface"]["meet"]["sides"] = ["b.zmax", "c.zmax"]
    refused(made, tables, "interface.meet.sides", "are not turned towards each other", "b.zmax, c.zmax")


def test_overlapping_bodies(bars_scene: Any, made: Any) -> None:
    tables = bars_scene()
    tables["substructure"]["c"]["box"]["origin"] = [0.0, 0.0, 1.97]
    refused(made, tables, "interface.meet.sides", "overlap", "0.03 m", "move the meshes apart")


def test_rounding_of_coordinates_is_neither_gap_nor_overlap(bars_scene: Any, made: Any) -> None:
    for z in (2.0 + 1e-13, 2.0 - 1e-13):
        tables = bars_scene()
        tables["substructure"]["c"]["box"]["origin"] = [0.0, 0.0, z]
        np.testing.assert_array_equal(made(tables).assembly.interfaces[1].geometry.gap, 0.0)


@pytest.mark.parametrize("distance", [0.0, 0.02])
def test_gap_given(bars_scene: Any, made: Any, distance: float) -> None:
    """Touching meshes take the number, and meshes apart, too."""
    tables = bars_scene(gap=distance)
    tables["interface"]["meet"]["gap"] = 0.02
    np.testing.assert_allclose(made(tables).assembly.interfaces[1].geometry.gap, 0.02)
    if distance:
        tables["interface"]["meet"]["gap"] = 0.03
        np.testing.assert_allclose(made(tables).assembly.interfaces[1].geometry.gap, 0.03)
        assert any("gap = 0.03 m counts; the meshes are 0.02 to 0.02 m" in text for text in made(tables).warnings)


def test_gap_to_the_ground(bars_scene: Any, made: Any) -> None:
    tables = bars_scene()
    tables["interface"]["meet"] = {"sides": ["b.zmax", "ground"], "gap": 0.4}
    geometry = made(tables).assembly.interfaces[1].geometry
    np.testing.assert_array_equal(geometry.gap, 0.4)
    assert geometry.traces[1] is None


def test_preload_needs_a_closed_gap(bars_scene: Any, made: Any) -> None:
    tables = bars_scene(gap=0.02)
    tables["interface"]["meet"]["preload"] = 5.0
    refused(made, tables, "interface.meet.preload", "cannot be open", "0.02 m")
    closed = bars_scene()
    closed["interface"]["meet"]["preload"] = 5.0
    assert made(closed).assembly.interfaces[1].preload == 5.0


def test_unknown_face_of_a_box(bars_scene: Any, made: Any) -> None:
    tables = bars_scene()
    tables["interface"]["meet"]["sides"][0] = "b.zmx"
    refused(made, tables, "interface.meet.sides[0]", "b.zmx", "zmax", "did you mean")


def test_unknown_face_of_a_mesh(bars_scene: Any, made: Any) -> None:
    """Groups of the file that touch the volume are offered, the nearest one first."""
    path = MODELS / "punched_plates" / "plates.msh"
    tables = with_mesh(bars_scene(), "a", path, group="upper_plate", scale=1e-3)
    tables["interface"], tables["boundary"] = {}, {}
    tables["load"]["push"]["face"] = "a.uper_bottom"
    error = refused(
        made, tables, "load.push.face", "a.uper_bottom", "did you mean a.upper_bottom?", "upper_under_punch"
    )
    assert "punch_head" not in str(error)


def test_mesh_errors_name_the_substructure_and_come_all_at_once(bars_scene: Any, made: Any, tmp_path: Path) -> None:
    garbage = tmp_path / "garbage.msh"
    garbage.write_text("hello")
    tables = with_mesh(bars_scene(), "a", garbage)
    tables = with_mesh(tables, "b", MODELS / "punched_plates" / "plates.msh", group="uper_plate")
    error = refused(made, tables, "substructure.a.mesh", "substructure.b.mesh", "garbage.msh", "upper_plate")
    assert len(error.problems) == 2


def tilted(angle: float, bulge: float) -> Mesh:
    """A bar of 3 x 3 x 2 turned about y, its top bulged."""
    mesh = box_mesh(np.array([0.0, 0.0, 0.0]), np.array([0.5, 0.5, 1.0]), (3, 3, 2))
    nodes = mesh.nodes.copy()
    top = nodes[:, 2] == 1.0
    nodes[top, 2] -= bulge * (nodes[top, 0] - 0.25) ** 2
    c, s = np.cos(angle), np.sin(angle)
    return replace(mesh, nodes=nodes @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]))


@pytest.mark.parametrize(
    ("angle", "bulge", "fine"), [(0.0, 0.0, True), (0.3, 0.0, True), (0.0, 0.5, False), (np.pi / 2, 0.0, True)]
)
def test_symmetry_needs_a_plane_face(
    bars_scene: Any, made: Any, tmp_path: Path, angle: float, bulge: float, fine: bool
) -> None:
    path = tmp_path / "part.inp"
    write_inp(path, tilted(angle, bulge), ["zmax"])
    tables = with_mesh(bars_scene(), "a", path, group="part")
    tables["interface"], tables["load"] = {}, {}
    tables["boundary"] = {"mirror": {"type": "symmetry", "face": "a.zmax"}}
    if fine:
        held = made(tables).assembly.propagators[0].members[0].expansion
        assert held.shape[0] - held.shape[1] == 16
    else:
        refused(made, tables, "boundary.mirror.face", "plane", "a.zmax")


def test_curved_faces_are_paired_point_by_point(bars_scene: Any, made: Any, tmp_path: Path) -> None:
    """A bulged top and its counterpart: no gap, N along the curved normal, traces to the matching nodes."""
    below = tilted(0.0, 0.5)
    above = box_mesh(np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.5, 1.0]), (3, 3, 2))
    nodes = above.nodes.copy()
    low = nodes[:, 2] == 1.0
    nodes[low, 2] -= 0.5 * (nodes[low, 0] - 0.25) ** 2
    write_inp(tmp_path / "below.inp", below, ["zmax"])
    write_inp(tmp_path / "above.inp", replace(above, nodes=nodes), ["zmin"])
    tables = with_mesh(bars_scene(), "a", tmp_path / "below.inp", group="part")
    tables = with_mesh(tables, "b", tmp_path / "above.inp", group="part")
    tables["interface"] = {"meet": {"sides": ["a.zmax", "b.zmin"], "friction_coefficient": 0.1}}
    tables["boundary"], tables["load"] = {}, {}
    geometry = made(tables).assembly.interfaces[0].geometry
    np.testing.assert_array_equal(geometry.gap, 0.0)
    assert np.abs(geometry.frames[:, 0, 0]).max() > 0.05  # truly curved
    one, two = ((t @ n.ravel()).reshape(-1, 3) for t, n in zip(geometry.traces, (below.nodes, nodes), strict=True))
    np.testing.assert_allclose(one, two, atol=1e-14)


def test_periodic_faces_must_match(bars_scene: Any, made: Any, tmp_path: Path) -> None:
    mesh = box_mesh(np.zeros(3), np.array([0.5, 0.5, 1.0]), (2, 2, 2))
    moved = mesh.nodes.copy()
    inner = np.flatnonzero((moved[:, 0] == 0.5) & (moved[:, 2] == 0.5))
    moved[inner, 2] += 0.1
    write_inp(tmp_path / "part.inp", replace(mesh, nodes=moved), ["xmin", "xmax", "zmin"])
    tables = with_mesh(bars_scene(), "a", tmp_path / "part.inp", group="part")
    tables["interface"], tables["load"] = {}, {}
    for faces in (["a.xmin", "a.xmax"], ["a.xmin", "a.zmin"]):
        tables["boundary"] = {"tie": {"type": "periodic", "faces": faces}}
        refused(made, tables, "boundary.tie.faces", "match one to one", "mesh opposite faces alike")
