"""Resultants, maps, skins and spectra from results, by closed forms; UGRID meshes for xugrid; zarr."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import latin_fmu
from latin_fmu.errors import InputError
from latin_fmu.results import views

from .test_sensors import pressed


@pytest.fixture(scope="module")
def solved() -> latin_fmu.Solution:
    return latin_fmu.solve(pressed(output={"surfaces": True, "fields": True, "stress": True}))


@pytest.fixture(scope="module")
def tree(solved: latin_fmu.Solution, tmp_path_factory: pytest.TempPathFactory) -> xr.DataTree:
    file = tmp_path_factory.mktemp("views") / "out.nc"
    solved.save(file)
    return latin_fmu.open_results(file)


def test_resultant(solved: latin_fmu.Solution, tree: xr.DataTree) -> None:
    history, made = solved.interfaces["crush"], views.resultant(tree, "crush")
    assert np.array_equal(made["force"].values, history.force())
    assert made["normal"].values == pytest.approx(-history.force()[:, 2], rel=1e-12)
    assert made["friction"].values == pytest.approx(np.hypot(*history.force()[:, :2].T), rel=1e-9, abs=1e-9)
    assert float(made["normal"].max()) > 1e3
    assert {v.attrs["units"] for v in made.data_vars.values()} == {"N"}


def test_pressure_map_has_the_resultant(tree: xr.DataTree) -> None:
    normal = views.resultant(tree, "crush")["normal"]
    for time in (None, float(normal["time"][3])):
        made = views.pressure_map(tree, "crush", time)
        expected = normal.max() if time is None else normal[3]
        assert float((made["pressure"] * made["area"]).sum()) == pytest.approx(float(expected), rel=1e-9)
    assert made.attrs["time"] == float(normal["time"][3])


def test_skin_is_the_boundary_of_the_box(solved: latin_fmu.Solution, tree: xr.DataTree) -> None:
    made, body = views.skin(tree, "upper"), solved.substructures["upper"]
    corners = np.stack([made[f"node_{axis}"].values for axis in "xyz"], axis=1)[made["faces"].values]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
    low, high = body.nodes.min(axis=0), body.nodes.max(axis=0)
    a, b, c = high - low
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(2 * (a * b + b * c + c * a))
    assert normals.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-18)
    volume = np.einsum("fi,fi->", corners.mean(axis=1), normals) / 3
    assert volume == pytest.approx(a * b * c)
    place = np.stack([made[f"node_{axis}"].values for axis in "xyz"], axis=1)
    same = [int(np.flatnonzero((body.nodes == p).all(axis=1))[0]) for p in place]
    scale = np.abs(body.velocity).max()  # the file holds fields in single precision
    assert made["velocity"].values == pytest.approx(body.velocity[:, same], abs=1e-6 * scale)


@pytest.mark.filterwarnings("ignore:No standard_name", "ignore:No CRS", "ignore:Using")
@pytest.mark.parametrize("what", ["pressure", "velocity"])
def test_xugrid_opens_and_plots(tree: xr.DataTree, what: str) -> None:
    xugrid = pytest.importorskip("xugrid")
    import matplotlib as mpl

    mpl.use("Agg")
    if what == "pressure":
        grid = xugrid.UgridDataset(views.pressure_map(tree, "crush"))
        values = grid["pressure"]
    else:
        grid = xugrid.UgridDataset(views.skin(tree, "upper"))
        values = grid["velocity"].isel(time=-1, component=2)
    assert values.ugrid.plot() is not None
    assert float(np.abs(values).max()) > 0.0


def test_shapes_of_cells(tree: xr.DataTree) -> None:
    group = tree["substructures/upper"]
    shape = group[group["mesh"].attrs["volume_shape_type"]]
    meaning = shape.attrs["flag_meanings"].split()
    assert {meaning[int(value)] for value in shape.values} == {"hexahedron"}
    assert shape.dims == ("cell",)


def harmonic() -> xr.DataTree:
    """Results with one sensor: 3 m/s2 at 50 Hz and 1 m/s2 at rest, over 0.1 s."""
    time = np.arange(1000) * 1e-4
    values = np.stack([3.0 * np.sin(2 * np.pi * 50.0 * time) + 1.0, 0.0 * time, 0.0 * time], axis=1)
    data = xr.Dataset(
        {"acceleration": (("time", "component"), values, {"units": "m s-2"})},
        {"time": time, "component": ["x", "y", "z"]},
    )
    return xr.DataTree.from_dict({"/sensors/head": data})


def test_amplitudes_of_a_harmonic() -> None:
    made = views.amplitude_spectrum(harmonic(), "head")
    assert float(made.sel(frequency=50.0, component="x")) == pytest.approx(3.0, rel=1e-9)
    assert float(made.sel(frequency=0.0, component="x")) == pytest.approx(1.0, rel=1e-9)
    rest = made.sel(component="x").where(~made["frequency"].isin([0.0, 50.0]), drop=True)
    assert float(rest.max()) < 1e-9
    assert made.attrs["units"] == "m s-2"


def test_response_spectrum_is_that_of_the_samples() -> None:
    tree, frequencies = harmonic(), [20.0, 80.0]
    made = views.sensor_spectrum(tree, "head", frequencies, quality=25.0)
    samples = tree["sensors/head/acceleration"].values
    known = latin_fmu.shock_response_spectrum(samples, 1e-4, frequencies, 25.0, interpolation="lines")
    assert np.array_equal(made["acceleration"].values, known.acceleration)
    assert np.array_equal(made["pseudo_velocity"].values, known.pseudo_velocity)
    assert made["acceleration"].sel(response="maximax").shape == (2, 3)


def test_names_that_are_not_there(tree: xr.DataTree) -> None:
    for call, words in (
        (lambda: views.resultant(tree, "none"), "crush"),
        (
            lambda: views.skin(latin_fmu.solve(pressed(output={"fields": False})).to_datatree(), "upper"),
            r"output\.fields = true",
        ),
        (lambda: views.amplitude_spectrum(tree, "none"), "not in the results"),
        (lambda: views.amplitude_spectrum(harmonic(), "head", "force"), "acceleration"),
    ):
        with pytest.raises(InputError, match=words):
            call()


def test_zarr_round_trip_without_warnings(solved: latin_fmu.Solution, tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    tree = solved.to_datatree()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="Consolidated metadata")  # of the format, whatever is written
        tree.to_zarr(tmp_path / "out.zarr")
        back = xr.open_datatree(tmp_path / "out.zarr", engine="zarr").load()
    for node in tree.subtree:
        xr.testing.assert_identical(node.to_dataset(), back[node.path].to_dataset())


def test_a_file_goes_to_zarr_without_warnings(solved: latin_fmu.Solution, tmp_path: Path) -> None:
    """Texts are strings in what is opened, and in zarr."""
    pytest.importorskip("zarr")
    solved.save(tmp_path / "out.nc")
    with latin_fmu.open_results(tmp_path / "out.nc") as tree:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", message="Consolidated metadata")  # of the format, whatever is written
            tree.to_zarr(tmp_path / "out.zarr")
            back = xr.open_datatree(tmp_path / "out.zarr", engine="zarr", decode_times=False).load()
        for node in tree.subtree:
            xr.testing.assert_identical(node.to_dataset(), back[node.path].to_dataset())
        assert list(tree["interfaces/crush/side"].values) == ["E", "Ep"]


def decaying(order: float, floor: float = 0.0, step: float = 1e-4, end: float = 3.0) -> xr.DataTree:
    """Free vibration at 80 Hz, along (0.6, 0, 0.8), whose damping is .002 (a / 1 mm)^order + .001, and whose frequency
    falls by 2 % x a / 1 mm; with a rigid drift and a mode at 240 Hz. ``floor`` : damping instead, where it is given."""
    time = np.arange(0.0, end, step)
    a, theta, rows = 1e-3, 0.0, []
    for _ in time:
        rows.append((a, theta))
        for _ in range(4):
            omega = 2 * np.pi * 80.0 * (1 - 0.02 * a / 1e-3)
            zeta = floor or 0.002 * (a / 1e-3) ** order + 0.001
            a *= 1 - zeta * omega * step / 4
            theta += omega * step / 4 * np.sqrt(1 - zeta**2)
    size, turned = np.array(rows).T
    other = 2e-4 * np.exp(-5 * time) * np.sin(2 * np.pi * 240 * time) + 1e-3 * time
    moved = (size * np.cos(turned))[:, None] * [0.6, 0.0, 0.8] + other[:, None] * [0.8, 0.0, -0.6]
    data = xr.Dataset(
        {"displacement": (("time", "component"), moved, {"units": "m"})}, {"time": time, "component": list("xyz")}
    )
    return xr.DataTree.from_dict({"/sensors/tip": data})


def test_ring_down_of_a_known_vibration() -> None:
    """Frequency to 5e-5 behind the first windows, damping to 2 % there, over a decade of amplitudes; it finds the
    direction."""
    made = latin_fmu.ring_down(decaying(1.0), "tip", (60.0, 110.0), without_slip=decaying(1.0, 0.0005))
    a = made["amplitude"].values
    assert a.max() > 5 * a.min()
    wanted = 80.0 * (1 - 0.02 * a / 1e-3)
    assert made["frequency"].values == pytest.approx(wanted, rel=1e-3)
    assert made["frequency"].values[5:-5] == pytest.approx(wanted[5:-5], rel=5e-5)
    ratio = 0.002 * a / 1e-3 + 0.001
    assert made["damping"].values[5:-10] == pytest.approx(ratio[5:-10], rel=0.02)
    assert (made["damping_error"].values[5:-10] < 0.1 * ratio[5:-10]).all()
    assert np.abs(made.attrs["direction"]) == pytest.approx([0.6, 0.0, 0.8], abs=1e-3)
    assert made.attrs["floor"] == pytest.approx(0.0005, rel=0.01)
    assert {name: v.attrs["units"] for name, v in made.data_vars.items()} == {
        "amplitude": "m",
        "frequency": "Hz",
        "damping": "1",
        "frequency_error": "Hz",
        "damping_error": "1",
    }


def of_one(moved: np.ndarray, time: np.ndarray) -> xr.DataTree:
    """Results with a sensor that moves along z."""
    history = (("time", "component"), moved[:, None] * [0.0, 0.0, 1.0])
    sensor = xr.Dataset({"displacement": history}, {"time": time, "component": list("xyz")})
    return xr.DataTree.from_dict({"/sensors/tip": sensor})


@pytest.mark.parametrize("damping", [0.01, 0.02, 0.05])
def test_a_ring_down_ends_where_the_vibration_has_died(damping: float) -> None:
    """A record that goes on: what the start leaves in filter and transform is no vibration."""
    time = np.arange(0.0, 2.0, 1e-3)
    omega = 100 * np.pi
    moved = 1e-3 * np.exp(-damping * omega * time) * np.cos(omega * np.sqrt(1 - damping**2) * time)
    tree = of_one(moved, time)
    if damping == 0.05:  # three periods from the end of the transient of the filter to a twentieth
        with pytest.raises(InputError, match="too short for a window"):
            latin_fmu.ring_down(tree, "tip", (30.0, 80.0), periods=20)
    made = latin_fmu.ring_down(tree, "tip", (30.0, 80.0), periods=4)
    assert made["damping"].values == pytest.approx(damping, rel=0.05)
    assert made["frequency"].values == pytest.approx(50.0, rel=0.01)
    assert made["amplitude"].values.min() > 0.03 * made["amplitude"].values.max()


def test_errors_of_a_ring_down_are_those_of_noise() -> None:
    """White noise of 2 % of the first amplitude: root mean squares of what is off and of what is said to be."""
    random, time, omega, off = np.random.default_rng(1), np.arange(0.0, 4.0, 1e-3), 100 * np.pi, []
    for _ in range(6):
        moved = np.exp(-0.002 * omega * time) * np.cos(omega * np.sqrt(1 - 0.002**2) * time)
        tree = of_one(moved + 0.02 * random.standard_normal(len(time)), time)
        made = latin_fmu.ring_down(tree, "tip", (30.0, 80.0))
        apart = made["frequency"] - 50.0, made["damping"] - 0.002
        off.append([v.values for v in (apart[0], made["frequency_error"], apart[1], made["damping_error"])])
    size = np.sqrt((np.concatenate(off, axis=1) ** 2).mean(axis=1))
    assert size[0::2] == pytest.approx(size[1::2], rel=0.3)


@pytest.mark.parametrize(
    ("options", "told"),
    [({"direction": [1.0, 1.0]}, "direction"), ({"direction": [0.0] * 3}, "direction"), ({"periods": 2}, "periods")],
)
def test_a_ring_down_needs_a_direction_and_periods(options: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        latin_fmu.ring_down(decaying(1.0), "tip", (60.0, 110.0), **options)


def test_ring_downs_that_cannot_be_read() -> None:
    tree = decaying(1.0, end=0.2)
    for sensor, band, words in (
        ("top", (60.0, 110.0), "is not in the results"),
        ("tip", (110.0, 60.0), "0 < lowest < highest"),
        ("tip", (60.0, 6000.0), "0 < lowest < highest"),
        ("tip", (75.0, 85.0), "too short for this band"),
        ("tip", (60.0, 110.0), "too short for a window"),
    ):
        with pytest.raises(InputError, match=words):
            latin_fmu.ring_down(tree, sensor, band, periods=20)
