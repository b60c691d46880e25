"""Faces with a form: flat meshes with a crown pressed against Hertz; the forms against their formulas.

A sphere (Johnson, Contact Mechanics, 4.2): a^3 = 3 P R / (4 E*), p0 = 3 P / (2 pi a^2). For that pressure

    int p dA = 2 p0 A / 3,    int p^2 dA = p0^2 A / 2,    so that    A = 9 (int p dA)^2 / (8 int p^2 dA).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError
from latin_fmu.pictures.assembly_picture import assembly_figure
from tests.scenes import given_motion, ramp

from .curved_meshes import outwards, write_block

E, NU, RADIUS, WIDTH = 210e9, 0.3, 0.1, 1e-3
STAR = E / (2 * (1 - NU**2))
DEPTH = WIDTH**2 / RADIUS
CROWN = {"type": "crown", "radius": RADIUS, "centre": [0.0, 0.0, 0.0]}
AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0]}


def blocks(folder: Path, per_width: int) -> dict[str, Any]:
    """A quarter of two flat blocks with a crown between them, pressed to 1.5 DEPTH in 3 parts, without friction."""
    size = WIDTH / per_width
    x = np.concatenate([size * np.arange(1.5 * per_width), 1.5 * WIDTH + outwards(1.4 * size, 8.5 * WIDTH, 1.4)])
    z = outwards(size, 10 * WIDTH, 1.4)
    write_block(folder / "flat.msh", x, x, -z[::-1], None)
    write_block(folder / "round.msh", x, x, z, None)
    bodies = ("flat", "round")
    sides = [(body, side) for body in bodies for side in ("xmin", "ymin")]
    return {
        "name": "crowned",
        "material": {"steel": {"young_modulus": E, "poisson_ratio": NU, "density": 7800.0}},
        "substructure": {
            name: {"material": "steel", "mesh": {"file": f"{name}.msh", "group": "body"}} for name in bodies
        },
        "interface": {"touch": {"sides": ["flat.surface", "round.surface"], "form": CROWN}},
        "boundary": {
            "foot": {"type": "fixed", "face": "flat.back"},
            "down": given_motion("round.back", [-1.5 * DEPTH], ramp((0, 0), (1, 1)), "z", kind="displacement"),
            **{f"{body}_{side}": {"type": "symmetry", "face": f"{body}.{side}"} for body, side in sides},
        },
        "time": {"end": 1.0, "instants": 3, "quasi_static": True},
        "solver": {"tolerance": 1e-4, "max_iterations": 400},
    }


def pressed(folder: Path, per_width: int) -> np.ndarray:
    """Of each increment: area by the pressure and largest pressure, relative to Hertz, less one; radius of the area
    counted by points less that of Hertz, in elements."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(blocks(folder, per_width), folder))
    assert solution.converged, solution.status
    history, shares = solution.interfaces["touch"], []
    r, area = np.hypot(*history.points[:, :2].T), 4 * history.areas
    for pressure in history.pressure()[1:]:
        force = float(area @ pressure)
        a = (3 * force * RADIUS / (4 * STAR)) ** (1 / 3)
        assert 0.5 * WIDTH < a < 1.5 * WIDTH
        exact, p0 = np.pi * a**2, 3 * force / (2 * np.pi * a**2)
        inside = r < 0.8 * a
        table = np.stack([np.ones(inside.sum()), r[inside] ** 2], axis=1)
        height = np.sqrt(np.linalg.lstsq(table, pressure[inside] ** 2, rcond=None)[0][0])
        by_pressure = 9 * force**2 / (8 * float(area @ pressure**2))
        counted = np.sqrt(float(area[pressure > 0].sum()) / np.pi)
        shares.append((by_pressure / exact - 1, height / p0 - 1, (counted - a) * per_width / WIDTH))
    return np.array(shares)


@pytest.mark.slow
def test_crown_pressed_as_hertz(tmp_path: Path) -> None:
    """Area and largest pressure within 2 % at every force; the area counted by points to half an element around."""
    coarse, fine = (np.abs(pressed(tmp_path, n)) for n in (4, 8))
    assert fine[:, :2].max() < 0.02
    assert fine[:, 0].max() < 0.5 * coarse[:, 0].max()
    assert max(coarse[:, 2].max(), fine[:, 2].max()) < 0.5


def two_blocks(form: dict[str, Any] | None, **keys: Any) -> dict[str, Any]:
    """Two blocks that touch, 20 mm long, their common face 10 mm x 20 mm in elements of 2.5 mm."""
    box = {"size": [0.02, 0.01, 0.005], "elements": [8, 4, 2]}
    return {
        "name": "blocks",
        "material": {"steel": {"young_modulus": E, "poisson_ratio": NU, "density": 7800.0}},
        "substructure": {
            name: {"material": "steel", "box": {**box, "origin": [0.0, 0.0, z]}}
            for name, z in (("lower", -0.005), ("upper", 0.0))
        },
        "interface": {
            "touch": {"sides": ["lower.zmax", "upper.zmin"]} | ({} if form is None else {"form": form}) | keys
        },
        "boundary": {"foot": {"type": "fixed", "face": "lower.zmin"}},
        "time": {"end": 4e-6, "instants": 40},
    }


def gaps(form: dict[str, Any], folder: Path | None = None, **keys: Any) -> tuple[np.ndarray, np.ndarray]:
    """Points of the common face from its middle, and the initial gap."""
    geometry = discretise(latin_fmu.scene_from_dict(two_blocks(form, **keys), folder)).units[0].geometry
    return geometry.points - [0.01, 0.005, 0.0], geometry.gap


def test_crowns() -> None:
    """Sphere, cylinder about an axis, unlike radii; added to a gap that is a number."""
    x, gap = gaps({"type": "crown", "radius": 2.0})
    assert gap == pytest.approx((x[:, 0] ** 2 + x[:, 1] ** 2) / 4)
    x, gap = gaps({"type": "crown", "radius": 2.0, "axis": [0.0, 3.0, 0.0]}, gap=1e-4)
    assert gap == pytest.approx(1e-4 + x[:, 0] ** 2 / 4)
    x, gap = gaps({"type": "crown", "radius": 2.0, "axis": [0, 1, 0], "radius_along": 0.5, "centre": [0.01, 0.0, 7.0]})
    assert gap == pytest.approx(x[:, 0] ** 2 / 4 + (x[:, 1] + 0.005) ** 2)


def test_polynomial_and_table(tmp_path: Path) -> None:
    """Both count from their smallest value; a grid is bilinear in between, given or from a file in other units."""
    x, gap = gaps({"type": "polynomial", "axes": AXES, "coefficients": [[5.0], [1e-3], [0.0, -4.0]]})
    values = 1e-3 * x[:, 0] - 4 * x[:, 0] ** 2 * x[:, 1]
    assert gap == pytest.approx(values - values.min(), abs=1e-15)
    places, heights = ([-0.01, 0.01], [-0.006, 0.0, 0.006]), [[3e-5, 1e-5, 0.0], [2e-5, 1e-5, 4e-5]]
    x, gap = gaps({"type": "table", "axes": AXES, "x": places[0], "y": places[1], "values": heights})
    share = (x[:, 0] + 0.01) / 0.02
    at = [np.interp(x[:, 1], places[1], row) for row in heights]
    values = (1 - share) * at[0] + share * at[1]
    assert gap == pytest.approx(values - values.min(), abs=1e-15)
    rows = [(1e3 * a, 1e3 * b, 1e6 * heights[i][j]) for i, a in enumerate(places[0]) for j, b in enumerate(places[1])]
    (tmp_path / "faces.csv").write_text("x,y,gap\n" + "\n".join(f"{a},{b},{c}" for a, b, c in rows[::-1]))
    of_file = {"type": "table", "axes": AXES, "file": "faces.csv", "length_unit": "mm", "value_unit": "um"}
    assert gaps(of_file, tmp_path)[1] == pytest.approx(gap, abs=1e-15)


@pytest.mark.parametrize(
    ("form", "keys", "where", "words"),
    [
        ({"type": "crown"}, {}, "form.radius", ["missing"]),
        ({"type": "crown", "radius": -1.0}, {}, "form.radius", ["out of range", "> 0"]),
        ({"type": "crown", "radius": 1.0, "radius_along": 2.0}, {}, "form", ["without an axis"]),
        ({"type": "dome"}, {}, "form", ["crown"]),
        ({"type": "polynomial", "axes": AXES, "coefficients": [[]]}, {}, "form", ["too few"]),
        ({"type": "polynomial", "axes": AXES, "coefficients": [[1.0] * 14]}, {}, "form", ["14", "1 to 13"]),
        ({"type": "table", "axes": AXES, "x": [0], "y": [0, 1], "values": [[1]]}, {}, "form", ["x is no increasing"]),
        ({"type": "table", "axes": AXES, "x": [0, 1], "y": [0, 1], "values": [[1, 2]]}, {}, "form", ["2 rows (x)"]),
        (
            {"type": "table", "axes": AXES, "x": [0, 1], "y": [0, 1], "values": [[1, 2], [3, 4]]},
            {},
            "form",
            ["does not reach", "extend the grid"],
        ),
        ({"type": "table", "axes": AXES, "file": "none.csv"}, {}, "form", ["none.csv"]),
        ({"type": "crown", "radius": 1.0}, {"preload": 1e6}, "preload", ["touch in part"]),
        ({"type": "crown", "radius": 1.0}, {"behaviour": "perfect"}, "form", ["no effect"]),
    ],
)
def test_refused(form: dict[str, Any], keys: dict[str, Any], where: str, words: list[str]) -> None:
    with pytest.raises(SceneError) as error:
        gaps(form, **keys)
    text = str(error.value)
    assert f"interface.touch.{where}" in text
    for word in words:
        assert word in text


@pytest.mark.parametrize("rows", ["0,0,1\n0,1,2\n1,0,3\n", "0,0,1\n0,1,2\n1,0,3\n1,1,4\n1,1,5\n"])
def test_a_grid_with_a_hole_or_a_point_twice_is_refused(rows: str, tmp_path: Path) -> None:
    (tmp_path / "faces.csv").write_text(rows)
    with pytest.raises(SceneError, match="no grid"):
        gaps({"type": "table", "axes": AXES, "file": "faces.csv"}, tmp_path)


def test_a_crown_lands_with_its_middle() -> None:
    """In motion points close when the body has flown their gaps, while the waves of the first contact are small."""
    tables = two_blocks({"type": "crown", "radius": 25.0})
    tables["substructure"]["upper"]["initial_velocity"] = [0.0, 0.0, -1.0]
    tables["time"] |= {"scheme": "hht"}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    history = solution.interfaces["touch"]
    closed = history.pressure() > 0
    assert closed.any(axis=0).all()
    landing = solution.time[closed.argmax(axis=0)]
    assert landing[history.initial_gap == 0.0] == pytest.approx(1e-7)
    near = (history.initial_gap > 0) & (history.initial_gap < 1.1e-6)
    assert near.sum() > 8
    assert landing[near] == pytest.approx(history.initial_gap[near], abs=2.01e-7)
    assert landing[history.initial_gap > 2.4e-6].min() > 1.5e-6


def test_drawn_with_its_gap() -> None:
    """The legend has the largest gap, the faces fade towards it."""
    figure = assembly_figure(latin_fmu.scene_from_dict(two_blocks({"type": "crown", "radius": 2.0})), [])
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "touch: contact, 45 points, gap up to 31.3 µm (white)" in words, words
    plain = assembly_figure(latin_fmu.scene_from_dict(two_blocks(None)), [])
    colours = [
        {tuple(c) for axis in f.axes for part in axis.collections for c in part.get_facecolors()}
        for f in (figure, plain)
    ]
    assert len(colours[0]) > len(colours[1]) + 4


@pytest.mark.parametrize(
    "form",
    [
        {"type": "crown", "radius": 1.0, "axis": [1.0, 0.0, 1.0]},
        {"type": "polynomial", "coefficients": [[0.0], [1e-3]], "axes": {"x": [0.0, 0.0, 1.0], "y": [0.0, 1.0, 0.0]}},
    ],
)
def test_axes_out_of_the_face_are_refused(form: dict[str, Any]) -> None:
    with pytest.raises(SceneError, match="does not lie in the face"):
        gaps(form)
