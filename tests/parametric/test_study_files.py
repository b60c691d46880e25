"""Files of studies in other tools: names that CF allows, texts as labels, whole numbers; files of the layout before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

import latin_fmu
from latin_fmu.file_digest import add_digest
from latin_fmu.parametric.figure import study_figure
from latin_fmu.parametric.point import Grid, Parameter
from latin_fmu.results.files import write_groups
from latin_fmu.results.groups import StoredGroup, StoredVariable, root_attributes

FRICTION, PRESSURE = "interface.crush.friction_coefficient", "load.press.pressure"


def test_names_of_parameters_are_those_of_their_keys_each_once() -> None:
    keys = (FRICTION, "substructure.a.box.size.0", "load.a_b.pressure", "load.a.b_pressure", "time")
    names = Grid({}, ".", tuple(Parameter(key, (1.0,)) for key in keys)).names
    assert names[:2] == ("interface_crush_friction_coefficient", "substructure_a_box_size_0")
    assert names[2:4] == ("load_a_b_pressure", "load_a_b_pressure_2")
    assert names[4] == "time_2"  # the instants of histories are called time


def test_a_study_of_the_layout_before_is_opened_with_the_names_of_today(tmp_path: Path) -> None:
    old = xr.Dataset(
        {
            "state": ((FRICTION, PRESSURE), np.zeros((2, 3), dtype=np.int8)),
            "force": ((FRICTION, PRESSURE, "axis"), np.ones((2, 3, 3)), {"units": "N"}),
            "impulse": ((FRICTION, PRESSURE, "interface"), np.ones((2, 3, 1)), {"units": "N s"}),
        },
        {FRICTION: [0.1, 0.2], PRESSURE: [1e7, 2e7, 3e7], "axis": list("xyz"), "interface": ["crush"]},
    )
    old[PRESSURE].attrs["units"] = "Pa"
    old.attrs = {**root_attributes("parametric study", "old", ""), "kind": "parametric study", "schema_version": "1.5"}
    old.to_netcdf(tmp_path / "old.nc")
    add_digest(tmp_path / "old.nc")
    with latin_fmu.open_results(tmp_path / "old.nc") as tree:
        study = tree.to_dataset()
        assert study["force"].dims == ("interface_crush_friction_coefficient", "load_press_pressure", "component")
        assert study["load_press_pressure"].attrs == {"units": "Pa", "scene_key": PRESSURE}
        assert study["load_press_pressure"].values.tolist() == [1e7, 2e7, 3e7]
        assert study_figure(study, ["impulse"]).axes[0].get_xlabel() == FRICTION


def test_nodes_of_cells_are_whole_numbers_in_a_mesh_of_several_shapes(tmp_path: Path) -> None:
    """Three and four corners: in xarray and in ``open_results`` the nodes are indices."""
    cells = np.array([[0, 1, 2, 3], [1, 4, 2, -1]], dtype=np.int32)
    variables = {"cells": StoredVariable(("cell", "corner"), cells), "cell_nodes": StoredVariable(("cell", "c"), cells)}
    write_groups(
        {"/": StoredGroup({}, attrs=root_attributes("mesh", "m", "")), "/a": StoredGroup(variables)}, tmp_path / "m.nc"
    )
    with latin_fmu.open_results(tmp_path / "m.nc") as tree, xr.open_datatree(tmp_path / "m.nc") as plain:
        for read in (tree, plain):
            for name in variables:
                assert read[f"a/{name}"].dtype == np.int32
                assert np.arange(5.0)[read[f"a/{name}"].values[1, :3]].tolist() == [1.0, 4.0, 2.0]
