"""Strain, nodal stress and principal values of a run: in the DataTree, in netCDF, in VTK, in a session."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import xarray as xr
from meshio._mesh import topological_dimension

from latin_fmu import api
from latin_fmu.cosim import Session, Settings
from latin_fmu.effects.explanation import explain
from latin_fmu.reader import scene_from_dict
from latin_fmu.results.files import open_results
from latin_fmu.results.vtk import export_vtu

from .meshes import IN_MSH
from .scenes import box_file, steel
from .test_bending import LOAD, B, H, L, beam, box, meshed

WANTED = {"nodal_stress": True, "principal_stress": True, "strain": True, "stress": True}


def pulled(folder: Path, cell_type: str) -> dict[str, Any]:
    """A cube drawn along z with free sides, nu = 0.3: stress 2 MPa, nothing else."""
    ramp = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    return {
        "name": "cube",
        "material": steel(0.3),
        "substructure": {"cube": box_file(folder / "cube.msh", cell_type, (1.0, 1.0, 1.0), (2, 2, 2))},
        "boundary": {side: {"type": "symmetry", "face": f"cube.{side}"} for side in ("xmin", "ymin", "zmin")},
        "load": {"pull": {"face": "cube.zmax", "pressure": -2e6, "law": ramp}},
        "time": {"end": 1.0, "instants": 2, "quasi_static": True},
        "output": dict(WANTED),
    }


@pytest.mark.parametrize("cell_type", IN_MSH)
def test_uniform_tension(tmp_path: Path, cell_type: str) -> None:
    solution = api.solve(scene_from_dict(pulled(tmp_path, cell_type)))
    solution.save(tmp_path / "cube.nc")
    with open_results(tmp_path / "cube.nc") as stored:
        export_vtu(stored, tmp_path / "vtk")
        # whole numbers, which are indices of nodes; -1 where a cell has fewer than others
        cells = stored["substructures/cube"]["cell_nodes"].values
        assert cells.dtype.kind == "i"
        assert (cells < 0).any() == (cell_type == "mixed")
        for tree, exactness in ((solution.to_datatree(), 1e-9), (stored, 1e-6)):
            check_tension(tree["substructures/cube"].to_dataset(), exactness)
    # missing in a table of meshio 5.3.5, which reads these cells otherwise
    topological_dimension.setdefault("wedge15", 3)
    mesh = meshio.read(tmp_path / "vtk" / "substructure_cube_00002.vtu")
    assert {c.type for c in mesh.cells} == ({"hexahedron", "wedge"} if cell_type == "mixed" else {cell_type})
    np.testing.assert_allclose(mesh.point_data["nodal_stress"][:, 2], 2e6, rtol=1e-6)
    np.testing.assert_allclose(mesh.point_data["nodal_von_mises"], 2e6, rtol=1e-6)
    np.testing.assert_allclose(np.concatenate(mesh.cell_data["von_mises"]), 2e6, rtol=1e-6)
    np.testing.assert_allclose(np.concatenate(mesh.cell_data["principal_stress"])[:, 0], 2e6, rtol=1e-6)
    np.testing.assert_allclose(np.concatenate(mesh.cell_data["strain"])[:, 0], -0.3 * 2e6 / 210e9, rtol=1e-6)


def check_tension(dataset: xr.Dataset, exactness: float) -> None:
    last = dataset.isel(time=-1)
    for name in ("stress", "nodal_stress"):
        wanted = np.array([0, 0, 2e6, 0, 0, 0])
        assert float(np.abs(last[name] - wanted).max()) < exactness * 2e6
    np.testing.assert_allclose(dataset["nodal_von_mises"].isel(time=-1), 2e6, rtol=exactness)
    for name in ("principal_stress", "nodal_principal_stress"):
        assert float(np.abs(last[name] - np.array([2e6, 0, 0])).max()) < exactness * 2e6
    strain = last["strain"].sel(strain_component="xx")
    np.testing.assert_allclose(strain, -0.3 * 2e6 / 210e9, rtol=exactness)
    assert dataset["nodal_stress"].attrs["location"] == "node"
    assert dataset["strain"].attrs["location"] == "volume"
    assert dataset["nodal_stress"].attrs["units"] == "Pa"


@pytest.mark.parametrize("body", ["bending modes", "tetra10", "hexahedron20"])
def test_stress_of_the_bent_beam_at_half_length(tmp_path: Path, body: str) -> None:
    """sigma_xx = M z / I on the outer fibres, away from the ends."""
    made = box((20, 2, 1), bending_modes=True) if body == "bending modes" else meshed(tmp_path, body, (20, 2, 1))
    tables = beam(made)
    tables["output"] = {"nodal_stress": True}
    dataset = api.solve(scene_from_dict(tables)).to_datatree()["substructures/beam"].to_dataset()
    top = np.flatnonzero(
        (np.abs(dataset["node_x"] - L / 2) < 1e-9) & (np.abs(dataset["node_z"] - H) < 1e-9)
    )  # the middle of a layer, both its sides averaged
    stress = dataset["nodal_stress"].isel(time=-1, node=top).sel(stress_component="xx")
    exact = -LOAD * B * H * (L / 2) * (H / 2) / (B * H**3 / 12)
    assert len(top) >= 3
    np.testing.assert_allclose(stress, exact, rtol=0.03)


def test_only_what_is_asked_for(tmp_path: Path) -> None:
    tables = pulled(tmp_path, "hexahedron")
    tables["output"] = {"stress": True, "principal_stress": True}
    dataset = api.solve(scene_from_dict(tables)).to_datatree()["substructures/cube"].to_dataset()
    assert {str(n) for n in dataset.data_vars} == {"stress", "principal_stress", "cell_nodes", "cell_shape", "mesh"}
    tables["output"] = {"strain": True}
    scene = scene_from_dict(tables)
    dataset = api.solve(scene).to_datatree()["substructures/cube"].to_dataset()
    assert {str(n) for n in dataset.data_vars} == {
        "displacement",
        "velocity",
        "strain",
        "support",
        "contact_edge",
        "cell_nodes",
        "cell_shape",
        "mesh",
    }
    (history,) = (e for e in explain(scene).effects if e.name == "interior history")
    assert history.on
    assert history.switch == "output.strain = false"


def test_a_session_keeps_them_too(tmp_path: Path) -> None:
    tables = pulled(tmp_path, "hexahedron")
    del tables["boundary"]
    tables["time"] = {"end": 1e-5, "instants": 4}
    session = Session(scene_from_dict(tables), Settings(keep=True))
    session.initialize()
    session.step(0.0, 1e-5)
    dataset = session.dataset()["substructures/cube"].to_dataset()
    assert dataset["nodal_stress"].shape == (5, 27, 6)
    assert dataset["nodal_principal_stress"].shape == (5, 27, 3)
