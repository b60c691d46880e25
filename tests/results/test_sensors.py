"""Sensors of a run: equal to the fields with every propagator, face means, refusals, file, summary and VTK."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

import latin_fmu
from latin_fmu.fem.location import locate
from latin_fmu.fem.mesh import Mesh, cell_blocks
from latin_fmu.results.vtk import export_vtu
from latin_fmu.stability.scenes import STEEL, Box, Material, column, half_sine
from tests.scenes import given_motion

INSIDE = [0.0013, 0.0041, 0.0137]
SENSORS = {
    "inside": {"substructure": "upper", "point": INSIDE},
    "node": {"substructure": "upper", "point": [0.005, 0.005, 0.02]},
    "foot": {"substructure": "upper", "point": [0.004, 0.006, 0.01]},
    "top": {"face": "upper.zmax"},
    "base": {"face": "lower.zmin"},
}
LAYER = {"behaviour": "soft_contact", "normal_stiffness": 1e12}  # between rigid sides that land
SCHEMES: dict[str, dict[str, Any]] = {
    "direct": {},
    "massless": {"time": {"end": 4e-6, "step": 0.2e-6, "scheme": "massless_contact"}},
    "generalized_alpha": {"time": {"end": 4e-6, "step": 0.2e-6, "scheme": "generalized_alpha"}},
    "explicit": {"solver": {"propagator": "explicit"}},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 8}}},
    "cg": {"solver": {"propagator": "cg"}},
    "whole window": {"solver": {"window": "whole"}},
    "quasi_static": {"time": {"end": 4e-6, "instants": 4, "quasi_static": True}},
}


def pressed(**changes: Any) -> latin_fmu.Scene:
    """A block pressed on another one whose base moves; every field and sensor is kept."""
    block = Box(STEEL, (0.01,) * 3, (2,) * 3)
    data = column(
        {"lower": block, "upper": block},
        {"crush": {"friction_coefficient": 0.2}},
        {"end": 4e-6, "step": 0.2e-6},
        name="pressed",
        boundary={
            "base": given_motion("lower.zmin", [0.05], half_sine(6e-6), "z"),
            "side": {"type": "symmetry", "face": "upper.xmin"},
            "back": {"type": "symmetry", "face": "upper.ymin"},
            "front": {"type": "symmetry", "face": "lower.ymin"},
        },
        load={"press": {"face": "upper.zmax", "pressure": 100e6, "law": half_sine(6e-6)}},
        sensor=SENSORS,
        output={"fields": True},
    )
    return latin_fmu.scene_from_dict(data | changes)


def interpolated(solution: latin_fmu.Solution, name: str, field: str) -> np.ndarray:
    """A field at the place of a point sensor, from the stored nodal values."""
    history = solution.substructures["upper"]
    mesh = Mesh(history.nodes, cell_blocks(history.cells), {})
    place = locate(mesh, np.array(SENSORS[name]["point"]))
    assert place is not None
    values = getattr(history, field)
    return np.einsum("n,tni->ti", place.weights, values[:, place.nodes])


@pytest.mark.parametrize("changes", SCHEMES.values(), ids=SCHEMES)
def test_sensors_equal_the_fields(changes: dict[str, Any]) -> None:
    solution = latin_fmu.solve(pressed(**changes))
    assert solution.converged
    for name in ("inside", "node", "foot"):
        for field in ("displacement", "velocity"):
            expected = interpolated(solution, name, field)
            actual = getattr(solution.sensors[name], field)
            assert actual == pytest.approx(expected, abs=1e-13 * max(abs(expected).max(), 1e-300))
    base, driven = solution.sensors["base"], solution.substructures["lower"]
    on_base = driven.nodes[:, 2] == 0.0
    for field in ("displacement", "velocity"):  # one and the same motion of all nodes along z
        expected = getattr(driven, field)[:, on_base, 2].mean(axis=1)
        assert getattr(base, field)[:, 2] == pytest.approx(expected, rel=1e-12, abs=1e-20)
    assert base.velocity[-1, 2] > 0.01
    top, history = solution.sensors["top"], solution.substructures["upper"]
    on_top = np.flatnonzero(history.nodes[:, 2] > 0.0199)
    weights = np.array([1, 2, 1])[:, None] * np.array([1, 2, 1]) / 16  # trapezoidal rule on 2 x 2 elements
    assert top.displacement == pytest.approx(
        np.einsum("n,tni->ti", weights.ravel(), history.displacement[:, on_top]), rel=1e-12, abs=1e-20
    )
    if changes.get("time", {}).get("quasi_static"):
        assert top.acceleration is None
        assert "no inertia" in top.remark


@pytest.mark.parametrize("name", ["direct", "explicit", "reduced", "cg"])
def test_acceleration_is_the_rate_of_the_velocity(name: str) -> None:
    """Implicit schemes: the trapezoidal rule to their order in the step; explicit: the mean over a step, exactly."""
    solution = latin_fmu.solve(pressed(**SCHEMES[name]))
    for sensor in ("inside", "node", "top"):
        history = solution.sensors[sensor]
        assert history.acceleration is not None
        dt = solution.time[1]
        if name == "explicit":
            assert "mean over the step" in history.remark
            assert dt * history.acceleration[1:] == pytest.approx(np.diff(history.velocity, axis=0), abs=1e-12)
            continue
        gained = 0.5 * dt * (history.acceleration[1:] + history.acceleration[:-1]).cumsum(axis=0)
        change = history.velocity[1:] - history.velocity[0]
        assert gained == pytest.approx(change, abs=0.05 * np.abs(change).max())


def test_acceleration_of_generalized_alpha_lags_by_its_weights() -> None:
    """a_n belongs to t_n - (a_f - a_m) dt: a_m 1/3, a_f 4/9 for a radius of 0.8; against the slope of the velocity."""
    time = {"end": 4e-6, "step": 0.05e-6, "scheme": "generalized_alpha"}
    solution = latin_fmu.solve(pressed(time=time))
    history, dt = solution.sensors["node"], solution.time[1]
    slope = np.gradient(history.velocity[:, 2], dt)[5:-5]
    ahead = np.gradient(slope, dt) * dt
    lag = np.linalg.lstsq(ahead[:, None], slope - history.acceleration[5:-5, 2], rcond=None)[0][0]
    assert lag == pytest.approx(4 / 9 - 1 / 3, abs=0.03)


def test_nodes_without_mass_have_the_difference_quotient() -> None:
    solution = latin_fmu.solve(pressed(**SCHEMES["massless"]))
    foot = solution.sensors["foot"]
    assert "difference quotient" in foot.remark
    assert foot.acceleration[1:] == pytest.approx(np.diff(foot.velocity, axis=0) / solution.time[1])
    assert solution.sensors["node"].remark == ""


@pytest.mark.parametrize("rigid", [False, True], ids=["elastic", "rigid"])
def test_a_falling_body(rigid: bool) -> None:
    """u = g t^2 / 2, v = g t, a = g at every sensor, of an elastic or rigid body."""
    g, density = 9.81, STEEL.density
    keys = {"body_force": [0.0, 0.0, -density * g], "rigid": rigid}
    body = Box(Material(210e9, density, 0.3), elements=(2, 2, 2), keys=keys)
    scene = latin_fmu.scene_from_dict(
        column(
            {"body": body},
            {},
            {"end": 0.1, "instants": 10},
            interface={"floor": {"sides": ["body.zmin", "ground"], "gap": 1.0} | (LAYER if rigid else {})},
            sensor={"point": {"substructure": "body", "point": [0.3, 0.7, 0.2]}, "face": {"face": "body.ymax"}},
        )
    )
    solution = latin_fmu.solve(scene)
    t = solution.time
    for history in solution.sensors.values():
        assert history.acceleration[:, 2] == pytest.approx(np.full(11, -g), rel=1e-9)
        assert history.velocity[:, 2] == pytest.approx(-g * t, rel=1e-9)
        assert history.displacement[:, 2] == pytest.approx(-0.5 * g * t**2, rel=1e-9)
    assert solution.sensors["face"].point == pytest.approx([0.5, 1.0, 0.5])


def test_a_sensor_changes_nothing_else() -> None:
    with_sensors, without = (latin_fmu.solve(pressed(**changes)) for changes in ({}, {"sensor": {}}))
    assert np.array_equal(with_sensors.interfaces["crush"].traction, without.interfaces["crush"].traction)
    assert without.sensors == {}


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (
            {"substructure": "upper", "point": [0.005, 0.005, 0.0215]},
            ("sensor.s.point", "outside upper, 0.0015 m from its surface", "[0.005, 0.005, 0.02]"),
        ),
        ({"substructure": "upper"}, ("neither 'point' nor 'face' is given",)),
        ({"face": "upper.zmax", "point": [0, 0, 0.02], "substructure": "upper"}, ("the face names the body already",)),
        ({"face": "upper.top"}, ("no face of this name", "zmax")),
        ({"point": [0.0, 0.0, 0.0]}, ("sensor.s.substructure: a point needs its body",)),
        ({"face": "upper.zmax", "substructure": "upper"}, ("the face names the body already",)),
    ],
)
def test_refused_with_numbers(sensor: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(latin_fmu.SceneError) as refused:
        latin_fmu.solve(pressed(sensor={"s": sensor}))
    for word in words:
        assert word in str(refused.value)


def test_in_file_summary_report_and_vtk(tmp_path: Path) -> None:
    solution = latin_fmu.solve(pressed())
    solution.save(tmp_path / "out.nc")
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    inside = tree["sensors/inside"]
    for name, units in {"displacement": "m", "velocity": "m s-1", "acceleration": "m s-2"}.items():
        assert np.array_equal(inside[name].values, getattr(solution.sensors["inside"], name))
        assert inside[name].attrs["units"] == units
    assert [float(inside[axis]) for axis in "xyz"] == INSIDE
    assert inside.attrs["substructure"] == "upper"
    assert tree["sensors/top/velocity"].attrs["cell_methods"] == "area: mean"
    tree.close()
    assert "largest unfiltered acceleration" in solution.summary(details=True)
    largest = np.linalg.norm(solution.sensors["top"].velocity, axis=1).max()
    assert solution.report()["sensors"]["top"]["largest_unfiltered_velocity"] == largest
    export_vtu(solution, tmp_path / "vtk")
    cloud = meshio.read(tmp_path / "vtk" / "sensors_00007.vtu")
    assert cloud.points[0] == pytest.approx(INSIDE)
    assert cloud.point_data["velocity"][3] == pytest.approx(solution.sensors["top"].velocity[7])


def test_quasi_static_says_why_there_is_no_acceleration(tmp_path: Path) -> None:
    solution = latin_fmu.solve(pressed(**SCHEMES["quasi_static"]))
    solution.save(tmp_path / "out.nc")
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    assert "acceleration" not in tree["sensors/top"]
    assert "no inertia" in tree["sensors/top"].attrs["acceleration"]
    tree.close()
    assert solution.report()["sensors"]["top"]["largest_unfiltered_acceleration"] is None
    solution.summary(details=True)
