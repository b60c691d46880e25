"""Names, dimensions, units and absences of the DataTree."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.latin.outcome import WindowRecord
from latin_fmu.results import dataset
from latin_fmu.results.dataset import convergence_group
from latin_fmu.results.quantities import INTERFACE, rows
from latin_fmu.results.solution import Solution

DIMENSIONS = {
    "interfaces/crush/force": ("time", "component"),
    "interfaces/crush/impulse": ("time", "component"),
    "interfaces/crush/traction": ("time", "point", "component"),
    "interfaces/crush/velocity": ("time", "side", "point", "component"),
    "interfaces/crush/gap": ("time", "point"),
    "interfaces/crush/contact_status": ("time", "point"),
    "interfaces/crush/x": ("point",),
    "interfaces/crush/area": ("point",),
    "interfaces/crush/normal": ("point", "component"),
    "substructures/lower/displacement": ("time", "node", "component"),
    "substructures/lower/velocity": ("time", "node", "component"),
    "substructures/lower/stress": ("time", "cell", "stress_component"),
    "substructures/lower/energy/kinetic": ("time",),
    "substructures/lower/node_z": ("node",),
    "substructures/lower/cell_nodes": ("cell", "cell_node"),
    "substructures/lower/cell_shape": ("cell",),
    "convergence/error_indicator": ("window", "iteration"),
    "convergence/iterations": ("window",),
    "energy/kinetic": ("time",),
    "energy/friction_dissipation": ("time",),
    "energy/work_of_loads": ("time",),
    "energy/scheme_dissipation": ("time",),
    "energy/balance": ("time",),
}


@pytest.mark.parametrize("path", DIMENSIONS)
def test_stable_names_have_their_dimensions(crushing: Solution, path: str) -> None:
    assert crushing.to_datatree()[path].dims == DIMENSIONS[path]


def test_values_are_those_of_the_histories(crushing: Solution) -> None:
    tree = crushing.to_datatree()
    history = crushing.interfaces["crush"]
    np.testing.assert_array_equal(tree["interfaces/crush/force"].values, history.force())
    np.testing.assert_array_equal(tree["interfaces/crush/impulse"].values, history.impulse(crushing.time))
    pull = tree["interfaces/crush/force"].sel(component="z").min()
    assert float(pull) == pytest.approx(-history.normal_resultant().max())
    np.testing.assert_array_equal(
        tree["substructures/lower/stress"].sel(stress_component="zz").values[:, 0],
        crushing.substructures["lower"].stress[:, 0, 2],
    )


def test_every_variable_says_what_it_is_and_in_which_unit(crushing: Solution) -> None:
    without_unit = {
        "component",
        "side",
        "stress_component",
        "contact_status",
        "converged",
        "cell_nodes",
        "cell_shape",
        "mesh",
    }
    for node in crushing.to_datatree().subtree:
        for name, variable in node.to_dataset().variables.items():
            assert variable.attrs["long_name"], f"{node.path}/{name}"
            assert ("units" in variable.attrs) != (name in without_unit), f"{node.path}/{name}"
            assert "standard_name" not in variable.attrs


def test_contact_status_has_flags_of_its_own_type(crushing: Solution) -> None:
    status = crushing.to_datatree()["interfaces/crush/contact_status"]
    assert status.dtype == status.attrs["flag_values"].dtype == np.int8
    assert status.attrs["flag_meanings"].split() == ["separation", "stick", "slip"]


def test_what_was_not_asked_or_cannot_be_is_absent(crushing: Solution, bars: Solution) -> None:
    full, lean = crushing.to_datatree(), bars.to_datatree()
    assert "upper" not in full["substructures"].children
    assert {"substructures", "energy"}.isdisjoint(lean.children)
    assert {"gap", "contact_status", "friction_power"}.isdisjoint(lean["interfaces/joint"].data_vars)
    assert "friction_power" not in lean["interfaces/contact"]
    assert "friction_coefficient" not in lean["interfaces/joint"].attrs


def test_a_row_is_all_that_a_variable_needs(crushing: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    row = rows(
        "shear | Pa | time point | traction along x on side Ep | local-stage field",
        {"shear": lambda history: -history.traction[..., 0]},
    )
    monkeypatch.setattr(dataset, "INTERFACE", {**INTERFACE, **row})
    made = crushing.to_datatree()["interfaces/crush/shear"]
    np.testing.assert_array_equal(made.values, -crushing.interfaces["crush"].traction[..., 0])
    assert made.dims == ("time", "point")
    assert made.attrs == {"units": "Pa", "long_name": "traction along x on side Ep", "comment": "local-stage field"}


def test_energy_alone_brings_no_mesh(crushing: Solution) -> None:
    fieldless = {"displacement": None, "velocity": None, "stress": None}
    lower = crushing.substructures["lower"]
    outcome = crushing.outcome
    changed = type(outcome)(
        **outcome.__dict__ | {"substructures": {"lower": type(lower)(**lower.__dict__ | fieldless)}}
    )
    group = Solution(changed, "", "x").to_datatree()["substructures/lower"]
    assert not group.data_vars
    assert group["energy/kinetic"].sizes["time"] == crushing.time.size


def test_strided_fields_keep_their_own_time(crushing: Solution) -> None:
    tree = crushing.to_datatree()
    lower = crushing.substructures["lower"]
    np.testing.assert_array_equal(tree["substructures/lower/time"].values, lower.time)
    np.testing.assert_array_equal(tree["substructures/lower/energy/kinetic"].values, lower.energy["kinetic"][::2])
    assert tree["interfaces/crush"].sizes["time"] == crushing.time.size


def test_convergence_is_padded_with_nan(stalled: Solution) -> None:
    windows = [
        WindowRecord(1, 1, [0.5, 0.1], [np.nan, 0.2], [], True),
        WindowRecord(2, 3, [0.4], [0.3], ["relaxation", "one-step windows"], False),
    ]
    group = convergence_group(windows, np.array([0.0, 1.0, 2.0, 3.0]), 4.5).dataset()
    np.testing.assert_array_equal(group["error_indicator"].values, [[0.5, 0.1], [0.4, np.nan]])
    np.testing.assert_array_equal(group["end_time"].values, [1.0, 3.0])
    np.testing.assert_array_equal(group["converged"].values, [1, 0])
    assert list(group["fallbacks"].values) == ["", "relaxation; one-step windows"]
    assert float(group["passes"]) == 4.5
    assert stalled.to_datatree()["convergence"].attrs == {"setting_search_direction_one_instant": "diagonal"}
    assert "fallbacks" in stalled.to_datatree()["convergence"]


@pytest.mark.parametrize("windows", [[], [WindowRecord(1, 2)]])
def test_runs_without_iterations_have_a_convergence_group(windows: list[WindowRecord]) -> None:
    group = convergence_group(windows, np.array([0.0, 1.0, 2.0]), 1.0).dataset()
    assert float(group["passes"]) == 1.0


def test_provenance_is_at_the_root(stalled: Solution) -> None:
    attributes = stalled.to_datatree().attrs
    assert attributes["scene"] == stalled.scene_text
    assert attributes["status"] == stalled.status
    assert attributes["converged"] == 0
    assert attributes["Conventions"].startswith("CF-1.11")
    for key in ("schema_version", "history", "latin_fmu_version", "numpy_version", "scipy_version", "xarray_version"):
        assert attributes[key]
