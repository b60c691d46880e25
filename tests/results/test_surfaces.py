"""Surfaces of interfaces: cells between their points, pressure and slip, VTK, and UGRID meshes for xugrid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
import pytest

import latin_fmu
from latin_fmu.pictures.result_picture import _direction, map_figure
from latin_fmu.results.dataset import _plane_axes
from latin_fmu.results.interface_fields import slip_in_contact
from latin_fmu.results.vtk import export_vtu

from .test_sensors import pressed


@pytest.fixture(scope="module")
def solved() -> latin_fmu.Solution:
    return latin_fmu.solve(pressed(output={"surfaces": True, "fields": True}))


def test_pressure_and_slip(solved: latin_fmu.Solution) -> None:
    group = solved.to_datatree()["interfaces/crush"]
    history = solved.interfaces["crush"]
    assert np.array_equal(group["pressure"].values, -history.traction[:, :, 2])
    assert group["pressure"].attrs["units"] == "Pa"
    jump, closed = history.velocity[:, 1] - history.velocity[:, 0], history.contact_status > 0
    step = 0.5 * (jump[1:] + jump[:-1]) * (closed[1:] & closed[:-1])[:, :, None]
    expected = np.linalg.norm(np.cumsum(step, axis=0)[:, :, :2], axis=2) * solved.time[1]
    assert group["slip"].values[1:] == pytest.approx(expected, abs=1e-20)
    assert (group["slip"].values[0] == 0.0).all()
    bare = latin_fmu.solve(pressed()).to_datatree()["interfaces/crush"]
    assert "pressure" not in bare
    assert "cells" in bare
    thinned = latin_fmu.solve(pressed(output={"surfaces": True, "interfaces_every": 4})).to_datatree()
    assert np.array_equal(thinned["interfaces/crush/pressure"].values, group["pressure"].values[::4])
    assert "needs the velocities at all instants" in thinned["interfaces/crush"].attrs["slip"]


def test_friction_energy_and_accumulated_slip(solved: latin_fmu.Solution) -> None:
    """The energies of the points sum up to the work of friction; each is mu times the pressure over the way slid."""
    group, history = solved.to_datatree()["interfaces/crush"], solved.interfaces["crush"]
    energy, way = group["friction_energy"].values, group["accumulated_slip"].values
    work = np.concatenate([[0.0], np.cumsum(history.friction_power[1:] * np.diff(solved.time))])  # type: ignore[index]
    assert energy @ history.areas == pytest.approx(work, abs=1e-12 * work[-1])
    assert work[-1] > 0.0
    slides, step = history.contact_status == 2, np.diff(way, axis=0)
    limit = history.mu * history.pressure()
    assert np.diff(energy, axis=0)[slides[1:]] == pytest.approx((limit[1:] * step)[slides[1:]], rel=1e-6)
    assert (step[~slides[1:]] == 0.0).all()
    assert (way >= 0.999 * np.where(slides.all(axis=0), group["slip"].values, 0.0)).all()
    assert group["friction_energy"].attrs["units"] == "J m-2"


def test_slip_without_inertia_is_the_difference_of_displacements() -> None:
    time = {"end": 4e-6, "instants": 4, "quasi_static": True}
    law = {"type": "table", "times": [0, 4e-6], "values": [0, 1]}
    push = {"face": "upper.zmax", "traction": [30e6, 0.0, 0.0], "law": law}
    press = {"face": "upper.zmax", "pressure": 100e6}
    boundary = {"base": {"type": "fixed", "face": "lower.zmin"}}
    output = {"surfaces": True, "fields": True}
    load = {"press": press, "push": push}
    solver = {"tolerance": 1e-7}
    solution = latin_fmu.solve(pressed(time=time, load=load, boundary=boundary, output=output, solver=solver))
    history, surface = solution.interfaces["crush"], solution.to_datatree()["interfaces/crush"]
    lower, upper = (solution.substructures[n] for n in ("lower", "upper"))
    low = [int(np.argmin(np.linalg.norm(lower.nodes - p, axis=1))) for p in history.points]
    up = [int(np.argmin(np.linalg.norm(upper.nodes - p, axis=1))) for p in history.points]
    jump = (upper.displacement[:, up] - lower.displacement[:, low])[:, :, :2]
    assert surface["slip"].values == pytest.approx(np.linalg.norm(jump, axis=2), abs=2e-3 * np.abs(jump).max())
    assert np.abs(jump).max() > 1e-9


def test_vtk_has_surface_cells(solved: latin_fmu.Solution, tmp_path: Path) -> None:
    export_vtu(solved, tmp_path / "vtk")
    surface = meshio.read(tmp_path / "vtk" / "interface_crush_00010.vtu")
    assert [(block.type, len(block.data)) for block in surface.cells] == [("quad", 4)]
    assert surface.point_data["slip"].max() > 0
    assert surface.point_data["friction_energy"].max() > 0
    assert surface.point_data["pressure"] == pytest.approx(-solved.interfaces["crush"].traction[10, :, 2])
    assert "contact_status" in surface.point_data


@pytest.mark.filterwarnings("ignore:No standard_name", "ignore:No CRS")
@pytest.mark.parametrize("face", ["zmax", "xmax"])
def test_xugrid_opens_and_plots_it(face: str, tmp_path: Path) -> None:
    """The mesh lies in the mean plane of the interface, whatever its direction in space."""
    xugrid = pytest.importorskip("xugrid")
    import matplotlib as mpl

    mpl.use("Agg")
    scene = pressed(output={"surfaces": True}) if face == "zmax" else side_by_side()
    solution = latin_fmu.solve(scene)
    solution.save(tmp_path / "out.nc")
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    crush = xugrid.UgridDataset(tree["interfaces/crush"].to_dataset())
    (grid,) = crush.ugrid.grids
    assert (grid.n_face, grid.n_node) == (4, 9)
    assert grid.area.sum() == pytest.approx(1e-4, rel=1e-9)
    assert crush["pressure"].isel(time=-1).ugrid.plot() is not None
    on_faces = crush["contact_status"].isel(time=-1).ugrid.to_face()
    assert on_faces.sizes["cell"] == 4
    tree.close()


def test_maps_have_the_axes_and_the_origin_of_the_scene() -> None:
    """A face across x has y and z along its axes; an inclined one says where its axes point."""
    tree = latin_fmu.solve(side_by_side()).to_datatree()
    crush = tree["interfaces/crush"].to_dataset()
    np.testing.assert_array_equal(crush["surface_x"], crush["y"])
    np.testing.assert_array_equal(crush["surface_y"], crush["z"])
    figure = map_figure(tree)
    assert (figure.axes[0].get_ylabel(), figure.axes[2].get_xlabel()) == ("z (mm)", "y (mm)")
    assert "crush at x = 10.00 mm" in figure.get_suptitle()
    turn = np.array([[np.sqrt(0.75), 0.0, 0.5], [0.0, 1.0, 0.0], [-0.5, 0.0, np.sqrt(0.75)]])
    flat = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    history: Any = SimpleNamespace(areas=np.ones(4), points=flat @ turn.T)
    np.testing.assert_allclose(_plane_axes(history), [turn[:, 1], turn[:, 0]], atol=1e-12)
    coordinate = crush["surface_x"].assign_attrs(direction=turn[:, 0])
    assert _direction(coordinate) == "along (0.87, 0, -0.5)"


def side_by_side() -> latin_fmu.Scene:
    """Two blocks that meet in a plane across x."""
    box = {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 2]}
    data = pressed().tables()
    data["substructure"] = {
        "lower": {"material": "steel", "box": box},
        "upper": {"material": "steel", "box": {**box, "origin": [0.01, 0.0, 0.0]}},
    }
    data["interface"] = {"crush": {"sides": ["lower.xmax", "upper.xmin"], "friction_coefficient": 0.2}}
    data["boundary"] = {"base": {"type": "fixed", "face": "lower.xmin"}}
    data["load"] = {"press": {"face": "upper.xmax", "pressure": 1e8}}
    data["sensor"], data["output"] = {}, {"surfaces": True}
    return latin_fmu.scene_from_dict(data)


def test_free_flight_is_no_slip(solved: latin_fmu.Solution) -> None:
    """A point that moves along the face at 2 m/s from the first of five instants on, closed at some of them."""
    history = solved.interfaces["crush"]
    time, n = np.arange(5.0), len(history.points)
    velocity = np.zeros((5, 2, n, 3))
    velocity[:, 1, :, 0] = 2.0
    for status, expected in (
        ([0, 0, 0, 0, 0], [0.0, 0.0, 0.0, 0.0, 0.0]),
        ([2, 2, 2, 2, 2], [0.0, 2.0, 4.0, 6.0, 8.0]),
        ([0, 0, 2, 2, 0], [0.0, 0.0, 0.0, 2.0, 2.0]),
    ):
        states = np.repeat(np.array(status, dtype=np.int8)[:, None], n, axis=1)
        own = replace(history, velocity=velocity, contact_status=states)
        assert np.linalg.norm(slip_in_contact(own, time), axis=2)[:, 0] == pytest.approx(expected)
