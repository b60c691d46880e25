"""Cantilever 100 x 10 x 5 mm against the beam of Timoshenko, and the warning where linear elements are too stiff."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from latin_fmu import api
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError
from latin_fmu.fem.elasticity import Isotropic
from latin_fmu.fem.elements import Elements, mass, stiffness
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.reader import scene_from_dict

from .conftest import write_msh
from .meshes import cut

L, B, H = 0.1, 0.01, 0.005
E, NU, LOAD = 210e9, 0.3, 1e5


def beam(body: dict[str, Any], axis: int = 2) -> dict[str, Any]:
    """Clamped at x = 0, pulled along an axis at the other end, in two increments."""
    traction = [0.0, 0.0, 0.0]
    traction[axis] = LOAD
    ramp = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    return {
        "name": "beam",
        "material": {"steel": {"young_modulus": E, "poisson_ratio": NU, "density": 7800.0}},
        "substructure": {"beam": {"material": "steel", **body}},
        "boundary": {"root": {"type": "fixed", "face": "beam.xmin"}},
        "load": {"tip": {"face": "beam.xmax", "traction": traction, "law": ramp}},
        "time": {"end": 1.0, "instants": 2, "quasi_static": True},
        "output": {"fields": True},
    }


def box(elements: tuple[int, int, int], **keys: Any) -> dict[str, Any]:
    return {"box": {"size": [L, B, H], "elements": list(elements)}, **keys}


def meshed(folder: Path, cell_type: str, elements: tuple[int, int, int]) -> dict[str, Any]:
    """The beam from a mesh file with the faces of the box."""
    mesh = cut(box_mesh(np.zeros(3), np.array([L, B, H]), elements), cell_type)
    groups: dict[str, Any] = {b.cell_type: (b.cell_type, b.cells) for b in mesh.blocks}
    for name, face in mesh.faces.items():
        (block,) = face.blocks
        groups[name] = (block.kind, block.facets)
    write_msh(folder / "beam.msh", mesh.nodes, groups)
    return {"mesh": {"file": str(folder / "beam.msh")}}


def tip(body: dict[str, Any], axis: int = 2) -> float:
    """Mean deflection of the end over that of the beam: F L^3 / 3 E I + F L / k G A, k of Cowper."""
    history = api.solve(scene_from_dict(beam(body, axis))).substructures["beam"]
    assert history.displacement is not None
    end = np.abs(history.nodes[:, 0] - L) < 1e-9
    height, width = (H, B) if axis == 2 else (B, H)
    force, shear, k = LOAD * B * H, E / (2 * (1 + NU)), 10 * (1 + NU) / (12 + 11 * NU)
    exact = force * L**3 / (3 * E * width * height**3 / 12) + force * L / (k * shear * B * H)
    return float(history.displacement[-1, end, axis].mean() / exact)


@pytest.mark.parametrize("axis", [1, 2])
def test_hexahedra_with_bending_modes(axis: int) -> None:
    """One element over the thickness; one over depth and thickness; plain ones are 35 % too stiff."""
    assert 0.95 < tip(box((20, 2, 1), bending_modes=True), axis) < 1.0
    assert 0.95 < tip(box((10, 1, 1), bending_modes=True), axis) < 1.0
    if axis == 2:
        assert tip(box((20, 2, 1))) == pytest.approx(0.645, abs=0.005)


@pytest.mark.parametrize("cell_type", ["tetra10", "hexahedron20", "hexahedron27"])
def test_quadratic_cells(tmp_path: Path, cell_type: str) -> None:
    for axis in (1, 2):
        assert 0.98 < tip(meshed(tmp_path, cell_type, (20, 2, 1)), axis) < 1.0


def warned(tables: dict[str, Any]) -> list[str]:
    return [r for r in discretise(scene_from_dict(tables)).remarks if "too stiff in bending" in r]


@pytest.mark.parametrize(
    ("cell_type", "elements", "stiffness"),
    [("hexahedron", (20, 2, 1), 55), ("tetra", (20, 2, 1), 378), ("tetra", (40, 4, 2), 102), ("wedge", (20, 2, 1), 53)],
)
def test_coarse_linear_meshes_are_warned_of(
    tmp_path: Path, cell_type: str, elements: tuple[int, int, int], stiffness: float
) -> None:
    """From a file as for a box; the stiffness stated is that of the tip to about a third."""
    (remark,) = warned(beam(meshed(tmp_path, cell_type, elements)))
    assert "wall thickness of 0.005 m" in remark
    stated = float(remark.split("about ")[1].split(" %")[0])
    assert stated == pytest.approx(stiffness, rel=0.35)
    assert ("bending_modes" in remark) == (cell_type == "hexahedron")


def test_meshes_that_bend_are_not_warned_of(tmp_path: Path) -> None:
    assert not warned(beam(meshed(tmp_path, "hexahedron", (40, 4, 2))))
    assert not warned(beam(meshed(tmp_path, "tetra", (80, 9, 5))))
    assert not warned(beam(meshed(tmp_path, "hexahedron", (20, 2, 1)) | {"bending_modes": True}))
    assert not warned(beam(box((20, 2, 1), bending_modes=True)))
    (remark,) = warned(beam(box((20, 2, 1))) | {"units": "mm-t-s-MPa"})
    assert "wall thickness of 0.005 mm" in remark


@pytest.mark.parametrize("from_file", [False, True])
def test_symmetry_planes_that_forbid_bending_silence_the_warning(tmp_path: Path, from_file: bool) -> None:
    """Held along z it may still bend along y, where it is 10 mm thick; held along y as well it cannot bend."""
    body = meshed(tmp_path, "hexahedron", (8, 2, 1)) if from_file else box((8, 2, 1))
    tables = beam(body)
    assert "wall thickness of 0.005 m" in warned(tables)[0]
    tables["boundary"]["z"] = {"type": "symmetry", "face": "beam.zmin"}
    assert "wall thickness of 0.01 m" in warned(tables)[0]
    tables["boundary"]["y"] = {"type": "symmetry", "face": "beam.ymax"}
    assert not warned(tables)


def test_a_thin_arm_of_a_bulky_body_is_warned_of(tmp_path: Path) -> None:
    """An L of a block and a thin plate: its bounding box is not slender."""
    plate = box_mesh(np.zeros(3), np.array([0.1, 0.02, 0.004]), (20, 4, 1))
    block = box_mesh(np.array([0.0, 0.0, 0.004]), np.array([0.02, 0.02, 0.08]), (4, 4, 16))
    nodes = np.concatenate([plate.nodes, block.nodes])
    cells = np.concatenate([plate.blocks[0].cells, plate.n_node + block.blocks[0].cells])
    unique, number = np.unique(np.round(nodes, 9), axis=0, return_inverse=True)
    write_msh(
        tmp_path / "l.msh",
        unique,
        {"part": ("hexahedron", number.ravel()[cells]), "xmin": ("quad", plate.faces["xmin"].blocks[0].facets)},
    )
    tables = beam({"mesh": {"file": str(tmp_path / "l.msh")}})
    del tables["load"], tables["boundary"]
    tables["time"] = {"end": 1e-5, "instants": 2}
    (remark,) = warned(tables)
    assert "wall thickness of 0.004 m" in remark


def test_bending_modes_need_hexahedra(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="the mesh has no 8-node hexahedra"):
        discretise(scene_from_dict(beam(meshed(tmp_path, "tetra", (4, 1, 1)) | {"bending_modes": True})))


@pytest.mark.parametrize(("cell_type", "bending"), [("hexahedron", True), ("tetra10", False), ("hexahedron27", False)])
def test_first_frequencies_of_the_cantilever(cell_type: str, bending: bool) -> None:
    """1.8751^2 / 2 pi sqrt(E I / rho A L^4) about both axes; plain hexahedra are 24 % too high about the thin one."""
    mesh = cut(box_mesh(np.zeros(3), np.array([L, B, H]), (20, 2, 1)), cell_type)
    held = (3 * mesh.faces["xmin"].nodes[:, None] + np.arange(3)).ravel()
    free = np.setdiff1d(np.arange(3 * mesh.n_node), held)
    elements = Elements(mesh)
    m = mass(elements, 7800.0)[free][:, free].tocsc()
    exact = [1.8751**2 / (2 * np.pi) * np.sqrt(E * h**2 / 12 / (7800.0 * L**4)) for h in (H, B)]

    def frequencies(with_modes: bool) -> np.ndarray:
        k = stiffness(elements, Isotropic(1.0, E, NU), with_modes)[free][:, free].tocsc()
        return np.sqrt(eigsh(k, 2, m, sigma=0.0, return_eigenvectors=False)[::-1]) / (2 * np.pi)

    np.testing.assert_allclose(np.sort(frequencies(bending)), exact, rtol=0.012)
    if bending:
        assert np.sort(frequencies(False))[0] > 1.2 * exact[0]
