"""Pictures of bodies: what is in front is visible, faces have their colours, every file is refused or drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from latin_fmu import api
from latin_fmu.cli import main
from latin_fmu.errors import ResultsError
from latin_fmu.fem.mesh import Array, box_mesh
from latin_fmu.pictures.assembly_picture import _assembly, assembly_figure
from latin_fmu.pictures.body_fields import (
    STRESSES,
    Look,
    away,
    base_motion,
    largest_stresses,
    nodal_stress,
    stored_bodies,
)
from latin_fmu.pictures.frame import Skin, View, draw, edges_of, mapped, sharp_edges, shifts_apart, skin_of
from latin_fmu.pictures.result_picture import _on_facets, _round, result_figure, stored_instants
from latin_fmu.reader import scene_from_dict
from latin_fmu.stability.scenes import Box, Material, column

RED, BLUE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def block(origin: list[float], size: list[float], n: int, colour: Array) -> Skin:
    return skin_of(box_mesh(np.array(origin), np.array(size), (n, n, n)), colour)


def pixel(skins: list[Skin], view: View, at: list[float]) -> Array:
    """Colour of the picture at the projection of a point, red, green, blue between 0 and 1."""
    figure = Figure(figsize=(3.0, 3.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw(axis, skins, view)
    canvas.draw()
    x, y = axis.transData.transform(view.project(np.array([at]))[0])
    image = np.asarray(canvas.buffer_rgba())
    colour: Array = image[image.shape[0] - 1 - int(y), int(x), :3] / 255.0
    return colour


@pytest.mark.parametrize(("elevation", "seen"), [(90.0, BLUE), (-90.0, RED)])
def test_the_nearer_body_hides_the_other(elevation: float, seen: Array) -> None:
    """A finely meshed red slab below a blue one of a single element, from above and from below."""
    red, blue = block([0, 0, 0], [4, 4, 1], 9, RED), block([0.5, 0.5, 1.01], [3, 3, 1], 1, BLUE)
    for skins in ([red, blue], [blue, red]):
        colour = pixel(skins, View.at(20.0, elevation), [2.13, 2.0, 1.0])
        assert colour[seen == 1.0] > 0.8  # lit: its back, in the shade, would have 0.55
        assert colour[seen == 0.0].max() < 0.1


def test_a_small_body_before_a_large_facet() -> None:
    """Sorting whole facets by their centres would draw the large facet over the small body."""
    wall, ball = block([0, 0, 0], [10, 10, 1], 1, RED), block([0.5, 8.5, 1.0], [1, 1, 1], 2, BLUE)
    colour = pixel([ball, wall], View.at(-60.0, 25.0), [1.03, 8.5, 1.47])
    assert colour[2] > 0.3
    assert colour[0] < 0.1


def test_skin_of_a_box() -> None:
    mesh = box_mesh(np.zeros(3), np.array([1.0, 2.0, 3.0]), (2, 3, 4))
    skin = skin_of(mesh, RED)
    assert len(skin.facets) == 2 * (2 * 3 + 3 * 4 + 2 * 4)
    centres = skin.points[skin.facets].mean(axis=1)
    assert (np.einsum("fi,fi->f", skin.normals(), centres - [0.5, 1.0, 1.5]) > 0).all()
    painted = skin.painted(mesh.faces["zmax"].nodes, BLUE)
    assert (painted.colours[:, 2] == 1.0).sum() == 2 * 3
    np.testing.assert_array_equal(painted.normals()[painted.colours[:, 2] == 1.0], np.tile([0, 0, 1.0], (6, 1)))


def test_sharp_edges_of_a_box() -> None:
    """From a corner three faces are visible: 9 edges of the box, each of three pieces, are strong."""
    skin = block([0, 0, 0], [1, 1, 1], 3, RED)
    edges, strength = edges_of(skin, View.at(-45.0, 35.0))
    assert (strength == 1.0).sum() == 9 * 3
    lengths = np.linalg.norm(skin.points[edges[:, 1]] - skin.points[edges[:, 0]], axis=1)
    np.testing.assert_allclose(lengths, 1 / 3)


def test_views_are_right_handed() -> None:
    for view in (View.at(-60.0, 25.0), View.at(120.0, -35.0)):
        np.testing.assert_allclose(np.cross(view.right, view.up), view.viewer, atol=1e-15)


def tower() -> dict[str, Any]:
    """Three blocks on each other, pressed from above, held below."""
    return column(
        dict.fromkeys("abc", Box(Material(2e11, 7800.0, 0.3, "steel"), (1e-2,) * 3, (2, 2, 2))),
        {"ab": {}, "bc": {}},
        {"end": 2e-6, "step": 2e-7},
        name="tower",
        boundary={"bed": {"type": "fixed", "face": "a.zmin"}},
        load={"press": {"face": "c.zmax", "pressure": 1e6}},
        output={"fields": True},
        accuracy={"estimate": False},
    )


def texts(figure: Figure) -> str:
    words = [t.get_text() for axis in figure.axes for t in axis.texts] + [a.get_title() for a in figure.axes]
    words += [t.get_text() for legend in figure.legends for t in legend.get_texts()]
    return "\n".join(words)


def test_assembly_names_what_it_draws() -> None:
    warnings: list[str] = []
    labels = texts(assembly_figure(scene_from_dict(tower()), warnings))
    assert warnings == []
    for words in ("a (steel)", "ab: contact, 9 points", "fixed: bed", "press\n1.00 MPa", "x (mm)", "from below"):
        assert words in labels


def test_bodies_move_apart_along_the_normals() -> None:
    assembly = _assembly(scene_from_dict(tower()), [])
    pairs = [(*joint.nodes, joint.normal) for joint in assembly.joints if len(joint.nodes) == 2]
    shifts = shifts_apart(list(assembly.bodies), pairs, 0.5)
    np.testing.assert_allclose(shifts["b"] - shifts["a"], [0, 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(shifts["c"] - shifts["b"], [0, 0, 0.5], atol=1e-12)


def test_a_scene_that_does_not_build_is_drawn_all_the_same() -> None:
    data = tower()
    data["substructure"]["c"]["box"]["origin"] = [1.0, 0.0, 0.02]
    warnings: list[str] = []
    labels = texts(assembly_figure(scene_from_dict(data), warnings))
    assert len(warnings) == 1
    assert "interface.bc" in warnings[0]
    assert "bc: contact" in labels


def test_labels_of_a_short_axis_do_not_touch() -> None:
    """A bar of a tenth of its length in width."""
    bar = Box(Material(2e11, 7800.0, 0.3, "steel"), (0.2, 0.02, 0.02), (4, 2, 2))
    figure = assembly_figure(scene_from_dict(column({"a": bar}, {}, {"end": 2e-6, "step": 2e-7})), [])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    ticks = [t for t in figure.axes[0].texts if t.get_text().lstrip("-").replace(".", "").isdigit()]
    boxes = [t.get_window_extent(canvas.get_renderer()) for t in ticks]
    assert len(boxes) > 6
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])


@pytest.mark.parametrize("builds", [True, False])
def test_contacts_that_are_found_are_in_the_legend(builds: bool) -> None:
    """Before any number of bonds, which have one entry; also in a scene that does not build."""
    n = 12
    names = [f"p{i:02d}" for i in range(n)]
    data = column(
        dict.fromkeys(names, Box(Material(2e11, 7800.0, 0.3, "steel"), (1e-2,) * 3, (2, 2, 2))),
        {f"bond{i}": {"behaviour": "perfect"} for i in range(n - 1)},
        {"end": 2e-6, "step": 2e-7},
    )
    for name in [f"bond{i}" for i in range(8, n - 1)]:
        del data["interface"][name]
    data["contact"] = {"all": {"search": 1e-4}}
    if not builds:
        data["interface"]["wrong"] = {"sides": ["p00.zmin", "p05.zmax"], "behaviour": "contact"}
    warnings: list[str] = []
    figure = assembly_figure(scene_from_dict(data), warnings)
    assert bool(warnings) != builds
    labels = texts(figure).splitlines()
    found = [f"p{i:02d}_p{i + 1:02d}: contact" for i in range(8, n - 1)]
    for words in found:
        assert sum(label.startswith(words) for label in labels) == 1
    assert "perfect: bond0, bond1, bond2 ... (8)" in labels
    assembly = _assembly(scene_from_dict(data), [])
    joint = next(joint for joint in assembly.joints if joint.name == "p08_p09")
    assert [len(nodes) for nodes in joint.nodes.values()] == [9, 9]
    # edge nodes of whole surfaces have a part of the sides
    assert joint.normal / np.linalg.norm(joint.normal) == pytest.approx([0.0, 0.0, 1.0])
    assert joint.normal[2] > 0.7


@pytest.fixture(scope="module")
def results() -> Any:
    return api.solve(scene_from_dict(tower())).to_datatree()


def test_bodies_of_results(results: Any) -> None:
    labels = texts(result_figure(results, look=Look("bc")))
    assert "bc: pressure on b" in labels
    assert "times as large" in labels
    assert "drawn 7 times" in texts(result_figure(results, 1e-6, Look(magnify=7.0)))


def test_without_interfaces_the_last_instant_is_drawn(results: Any) -> None:
    alone = results.copy()
    del alone["interfaces"]
    last = float(stored_instants(alone)[-1])
    assert result_figure(alone).get_suptitle() == result_figure(alone, time=last).get_suptitle()
    assert result_figure(alone).get_suptitle() != result_figure(alone, time=0.0).get_suptitle()


def test_results_that_cannot_be_drawn(results: Any) -> None:
    with pytest.raises(ResultsError, match="allowed: ab, bc"):
        result_figure(results, look=Look("cd"))
    bare = results.copy()
    del bare["substructures"]
    with pytest.raises(ResultsError, match=r"output\.fields=true"):
        result_figure(bare)


@pytest.fixture(scope="module")
def shaken() -> Any:
    """A block on a driven one that starts under its weight: stresses at the nodes, and a base that moves."""
    scene = tower()
    scene["boundary"] = {
        "base": {
            "type": "acceleration",
            "face": "a.zmin",
            "components": ["x", "y", "z"],
            "value": [3e4, 0.0, 4e4],
            "law": {"type": "step"},
        }
    }
    scene["output"] = {"nodal_stress": True}
    return api.solve(scene_from_dict(scene)).to_datatree()


def test_displacements_are_relative_to_a_base_that_moves(shaken: Any, results: Any) -> None:
    bodies = stored_bodies(shaken)
    instants = stored_instants(shaken)
    time = instants[-1]
    base = base_motion(bodies, np.array([time]))[0]
    np.testing.assert_allclose(base / time**2, [1.5e4, 0.0, 2e4], rtol=0.2, atol=1.0)
    held = bodies["a"]["support"].values == 1
    np.testing.assert_allclose(bodies["a"]["displacement"].values[-1][held], np.tile(base, (held.sum(), 1)), rtol=1e-6)
    assert "displacement relative to the base, drawn" in texts(result_figure(shaken))
    # supports that move apart have no motion in common, bodies without supports none at all
    apart = bodies["a"].copy(deep=True)
    apart["displacement"][:, int(np.flatnonzero(held)[0])] += 1.0
    assert not base_motion({"a": apart}, instants).any()
    assert not base_motion(stored_bodies(results), instants).any()


@pytest.mark.parametrize("stress", ["von_mises", "principal"])
def test_bodies_are_coloured_by_stress(shaken: Any, results: Any, stress: str) -> None:
    """The scale ends at the largest stress away from edges, at the instant of which the bodies are drawn."""
    bodies, instants = stored_bodies(shaken, stress), stored_instants(shaken)
    sizes = {n: np.stack([nodal_stress(d, stress, t) for t in instants]) for n, d in bodies.items()}
    far = np.max([np.where(away(d), sizes[n], 0.0).max(axis=1) for n, d in bodies.items()], axis=0)
    found = largest_stresses(bodies, stress, instants)
    np.testing.assert_allclose(found[0], np.clip(far, 0.0, None), rtol=1e-6, atol=1.0)
    assert (found[1] >= found[0]).all()
    assert found[1].max() == pytest.approx(max(s.max() for s in sizes.values()), rel=1e-6)
    figure = result_figure(shaken, look=Look(stress=stress))
    words = texts(figure)
    assert figure.axes[-1].get_xlabel().startswith(STRESSES[stress])
    assert "away from edges of contacts up to" in words
    assert figure.get_suptitle() == result_figure(shaken, float(instants[far.argmax()])).get_suptitle()
    with pytest.raises(ResultsError, match=r"output\.nodal_stress=true"):
        result_figure(results, look=Look(stress=stress))


def test_fields_are_drawn_between_the_nodes() -> None:
    """A field that rises across one facet has the colour of its middle there; without one the body has its own."""
    skin = block([0, 0, 0], [1, 1, 1], 1, RED)
    share = skin.points[:, 0].copy()
    above = View.at(-90.0, 90.0)
    coloured = pixel([replace(skin, field=(share, "viridis"))], above, [0.52, 0.46, 1.0])
    np.testing.assert_allclose(coloured, mapped("viridis", np.array([0.52]))[0], atol=0.12)
    plain = pixel([replace(skin, field=(np.full(8, np.nan), "viridis"))], above, [0.52, 0.46, 1.0])
    assert plain[0] > 0.8
    assert plain[1:].max() < 0.1


@pytest.mark.parametrize(("sides", "drawn"), [(6, True), (7, False)])
def test_facets_around_a_circle_are_no_edges(sides: int, drawn: bool) -> None:
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1)
    k = np.arange(sides)
    facets = np.stack([k, (k + 1) % sides, (k + 1) % sides + sides, k + sides], axis=1)
    skin = Skin(np.concatenate([ring, ring + np.array([0.0, 0.0, 1.0])]), facets, np.zeros((sides, 3)))
    upright = np.ptp(sharp_edges(skin) % sides, axis=1)
    assert (upright == 0).sum() == sides * drawn


@pytest.mark.parametrize(("factor", "rounded"), [(0.2, 1.0), (1.0, 1.0), (19.9, 10.0), (51.0, 50.0), (4e5, 2e5)])
def test_factors_are_round(factor: float, rounded: float) -> None:
    assert _round(factor) == pytest.approx(rounded, rel=1e-12)


def test_command(tmp_path: Path, results: Any, capsys: pytest.CaptureFixture[str]) -> None:
    scene, figure = tmp_path / "tower.toml", tmp_path / "tower.png"
    scene.write_text(scene_from_dict(tower()).text())
    assert main(["plot", str(scene), "--set", "load.press.pressure=2e6"]) == 0
    assert figure.stat().st_size > 20_000
    file = tmp_path / "out.nc"
    results.to_netcdf(file)
    assert main(["plot", str(file), "--bodies", "--interface", "ab", "-o", str(tmp_path / "b.pdf")]) == 0
    capsys.readouterr()
    assert main(["plot", str(file), "--time", "-1", "--set", "a=1"]) == 2
    assert "3 problems" in capsys.readouterr().err
    assert main(["plot", str(scene), "--bodies"]) == 2
    assert "a scene has no results" in capsys.readouterr().err


def test_pressures_are_drawn_on_the_facets_of_their_points() -> None:
    """Points on the top of a box with the value x: facets there have the mean of their corners, others nothing."""
    mesh = box_mesh(np.zeros(3), np.array([2.0, 1.0, 1.0]), (4, 2, 2))
    skin, nodes = skin_of(mesh, RED), mesh.faces["zmax"].nodes
    points = mesh.nodes[nodes]
    drawn = _on_facets(skin, points, np.tile([0.0, 0.0, 1.0], (15, 1)), points[:, 0], np.full(15, 0.5))
    centres = skin.points[skin.facets].mean(axis=1)
    top = centres[:, 2] == 1.0
    np.testing.assert_allclose(drawn[top], centres[top, 0])
    assert np.isnan(drawn[~top]).all()
