"""Largest stresses of bodies: by which kind, where, when, with and without cells at edges of contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from latin_fmu import api
from latin_fmu.fem.elasticity import von_mises
from latin_fmu.fem.elements import principal
from latin_fmu.fem.footprints import near_rims, rim
from latin_fmu.fem.mesh import Array, box_mesh
from latin_fmu.latin.outcome import NodeMarks, SubstructureHistory
from latin_fmu.reader import scene_from_dict
from latin_fmu.results.stresses import _of_body, largest_principal, stress_rows
from latin_fmu.scene.units import SI
from latin_fmu.stability.scenes import Box, Material, column

STEEL = Material(210e9, 7800.0, 0.3, "steel")


def test_the_rim_is_where_a_footprint_ends() -> None:
    """The middle third of a face of 6 x 6: a square of 2 x 2 facets, whose rim has 8 nodes, and cells around it."""
    mesh = box_mesh(np.zeros(3), np.array([6.0, 6.0, 2.0]), (6, 6, 2))
    top = mesh.nodes[:, 2] == 2.0
    inside = top & (np.abs(mesh.nodes[:, :2] - 3.0) <= 1.0).all(axis=1)
    places = mesh.nodes[rim(mesh, np.flatnonzero(inside))]
    assert len(places) == 8
    assert (np.abs(places[:, :2] - 3.0).max(axis=1) == 1.0).all()
    near = near_rims(mesh, [np.flatnonzero(inside)])
    wanted = (np.abs(mesh.nodes[:, :2] - 3.0).max(axis=1) <= 2.0) & (mesh.nodes[:, 2] >= 1.0)
    np.testing.assert_array_equal(near, wanted)
    # a whole face ends at its edges, one without facets nowhere
    assert len(rim(mesh, np.flatnonzero(top))) == 24
    assert len(rim(mesh, np.flatnonzero(inside)[:3])) == 0


def test_the_largest_principal_stress_without_all_of_them() -> None:
    """The bound by mean and von Mises stress leaves the right node, also in pure compression and at rest."""
    stress = np.random.default_rng(3).normal(size=(20, 50, 6)) * np.array([1, 1, 1, 0.3, 0.3, 0.3])
    stress[5, :, :3] -= 40.0
    stress[6] = 0.0
    for fields in stress:
        every = principal(fields)[:, 0]
        node, value = largest_principal(fields, von_mises(fields))
        assert value == every.max()
        assert every[node] == value


@dataclass(frozen=True)
class Given:
    """Stresses that no displacement makes."""

    stress: Array
    nodal_stress: bool = True

    def stress_at_nodes(self, _: Array, time: Array) -> Array:
        return self.stress[np.rint(time).astype(int)]


def history(edge: list[bool], n_time: int) -> SubstructureHistory:
    n = len(edge)
    nodes = 1e-3 * np.arange(3.0 * n).reshape(n, 3)
    marks = NodeMarks(np.zeros(n, dtype=bool), np.array(edge))
    moved = np.zeros((n_time, n, 3))
    cells = np.arange(n, dtype=np.int64)[None]
    return SubstructureHistory("body", nodes, cells, "tetra", np.arange(float(n_time)), moved, None, None, None, marks)


def uniaxial(sizes: list[list[float]]) -> Array:
    stress = np.zeros((len(sizes), len(sizes[0]), 6))
    stress[..., 0] = sizes
    return stress


def said(edge: list[bool], sizes: list[list[float]]) -> str:
    request: Any = Given(uniaxial(sizes))
    ((name, text),) = stress_rows({"body": _of_body(history(edge, len(sizes)), request)}, SI)
    assert name == "body body"
    return text


def test_largest_stresses_are_told_with_and_without_edges() -> None:
    """Compression has the larger von Mises stress, tension the larger principal one; the node at an edge has both."""
    text = said([True, False, False, False], [[20e6, 5e6, 0, 0], [-90e6, 30e6, -60e6, 0], [80e6, 10e6, 0, 0]])
    assert text == (
        "von Mises stress up to 90.0 MPa at (0, 1.00, 2.00) mm, 1.00 s; away from edges of contacts 60.0 MPa at (6.00, "
        "7.00, 8.00) mm, 1.00 s; at the start 20.0 MPa (away 5.00 MPa); largest principal stress 80.0 MPa (away "
        "30.0 MPa)"
    )


def test_what_is_the_same_is_said_once() -> None:
    text = said([True, False, False, False], [[20e6, 50e6, 0, 0]])
    assert text == "von Mises stress up to 50.0 MPa at (3.00, 4.00, 5.00) mm, 0 s; largest principal stress 50.0 MPa"
    assert "every cell touches the edge of a contact" in said([True] * 4, [[20e6, 50e6, 0, 0]])


@pytest.fixture(scope="module")
def punched() -> Callable[[], Any]:
    """A block pressed on the corner of a wider one that is held below."""
    blocks = {"lower": Box(STEEL, (6e-3, 6e-3, 4e-3), (6, 6, 4)), "upper": Box(STEEL, (2e-3, 2e-3, 2e-3), (2, 2, 2))}
    scene = column(
        blocks,
        {"seat": {"behaviour": "contact", "friction_coefficient": 0.2}},
        {"end": 1.0, "instants": 2, "quasi_static": True},
        boundary={
            "base": {"type": "fixed", "face": "lower.zmin"},
            "side": {"type": "fixed", "face": "upper.zmax", "components": ["x", "y"]},
        },
        load={
            "press": {
                "face": "upper.zmax",
                "pressure": 50e6,
                "law": {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]},
            }
        },
        output={"nodal_stress": True},
    )
    return lambda: api.solve(scene_from_dict(scene))


def test_of_a_run(punched: Callable[[], Any]) -> None:
    solution = punched()
    lower = solution.to_datatree()["substructures/lower"].to_dataset()
    np.testing.assert_array_equal(lower["support"].values == 1, lower["node_z"].values == lower["node_z"].values.min())
    edge = lower["contact_edge"].values == 1
    # cells at the rim of the upper block, and at the edge of the held face
    height = lower["node_z"].values - lower["node_z"].values.min()
    x, y = lower["node_x"].values, lower["node_y"].values
    inward = np.minimum(np.minimum(x, 6e-3 - x), np.minimum(y, 6e-3 - y))
    wanted = (height > 2.9e-3) & (np.maximum(x, y) < 3.1e-3) | (height < 1.1e-3) & (inward < 1.1e-3)
    np.testing.assert_array_equal(edge, wanted)
    mises = lower["nodal_von_mises"].values
    assert mises == pytest.approx(von_mises(lower["nodal_stress"].values), rel=1e-9, abs=1e-3)
    found = solution.report()["stresses"]["lower"]["run"]["von_mises"]
    assert found["everywhere"]["stress"] == pytest.approx(mises.max())
    assert found["away_from_contact_edges"]["stress"] == pytest.approx(mises[:, ~edge].max())
    assert found["everywhere"]["time"] == 1.0
    assert "body lower  von Mises stress up to " in solution.summary()
    assert "stresses" not in type(solution)(solution.outcome, "", "").report()
