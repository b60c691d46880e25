"""One style: curves that differ in grey, colour maps of even lightness, maps of interfaces, films."""

from __future__ import annotations

import itertools
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import TriMesh
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.errors import ResultsError
from latin_fmu.parametric.figure import study_figure
from latin_fmu.pictures.body_fields import Look
from latin_fmu.pictures.result_picture import Window, bodies_in_motion, map_figure, map_in_motion, save_film
from latin_fmu.pictures.style import PRESSURE, SEQUENTIAL, curve_styles, styled
from latin_fmu.pictures.summary_picture import STATUS_COLOURS, summary_figure
from latin_fmu.results import views

from .test_sensors import pressed

LEAST = 0.1  # difference of lightness that is seen in grey print


def lightness(colour: object) -> float:
    """CIE lightness L* of a colour, over 100."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = float(linear @ [0.2126, 0.7152, 0.0722])
    return 1.16 * y ** (1 / 3) - 0.16 if y > 0.008856 else 9.033 * y


def alike_in_grey(figure: Figure) -> list[tuple[str, str]]:
    """Pairs of curves of one panel that have names, and that are equal in grey print."""
    pairs = []
    for axis in [axis for part in (figure, *figure.subfigs) for axis in part.axes]:
        named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
        for a, b in itertools.combinations(named, 2):
            same = a.get_linestyle(), a.get_marker(), a._unscaled_dash_pattern
            other = b.get_linestyle(), b.get_marker(), b._unscaled_dash_pattern
            if same == other and abs(lightness(a.get_color()) - lightness(b.get_color())) < LEAST:
                pairs.append((str(a.get_label()), str(b.get_label())))
    return pairs


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("films") / "out.nc"
    sensor = {"top": {"face": "upper.zmax", "spectrum": {"lowest": 1e5, "highest": 4e5}}}
    latin_fmu.solve(pressed(output={"surfaces": True, "fields": True, "energy": True}, sensor=sensor)).save(target)
    return target


@pytest.fixture(scope="module")
def tree(file: Path) -> xr.DataTree:
    return latin_fmu.open_results(file).load()


@pytest.mark.parametrize("name", [SEQUENTIAL, PRESSURE])
def test_lightness_of_colour_maps_is_monotonic(name: str) -> None:
    steps = np.diff([lightness(mpl.colormaps[name](share)[:3]) for share in np.linspace(0.0, 1.0, 65)])
    assert (steps > 0).all() or (steps < 0).all()
    assert np.abs(steps).max() < 3.0 * np.abs(steps).mean()


def test_contact_states_differ_in_grey() -> None:
    levels = sorted(lightness(colour) for colour in STATUS_COLOURS)
    assert np.diff(levels).min() > LEAST


def test_curves_differ_in_grey(tree: xr.DataTree) -> None:
    assert alike_in_grey(summary_figure(tree)) == []
    names = ["load.press.pressure", "interface.crush.friction_coefficient"]
    values = np.arange(18.0).reshape(3, 6)
    data = {"iterations": (names, values), "state": (names, np.zeros((3, 6), dtype=np.int8))}
    study = xr.Dataset(data, {names[0]: [1e8, 2e8, 3e8], names[1]: np.linspace(0.0, 0.5, 6)})
    study[names[0]].attrs["units"] = "Pa"
    figure = study_figure(study)
    assert alike_in_grey(figure) == []
    assert figure.axes[0].get_xlabel() == "load.press.pressure (Pa)"
    eight, plain = Figure(), Figure()
    for drawn, looks in ((eight, curve_styles(8)), (plain, [{"color": c["color"]} for c in curve_styles(8)])):
        axis = drawn.subplots()
        for i, look in enumerate(looks):
            axis.plot([0, 1], [i, i], label=str(i), **look)
    assert alike_in_grey(eight) == []
    assert alike_in_grey(plain) != []  # colours alone would not do


def test_a_style_ends_with_its_function() -> None:
    before = dict(mpl.rcParams)
    assert styled(lambda: mpl.rcParams["axes.spines.top"])() is False
    assert dict(mpl.rcParams) == before


def test_a_map_shows_the_instant_of_the_largest_force(tree: xr.DataTree) -> None:
    figure = map_figure(tree, "crush")
    expected = views.pressure_map(tree, "crush")
    mesh = next(c for c in figure.axes[0].collections if isinstance(c, TriMesh))
    assert np.asarray(mesh.get_array()) * 1e6 == pytest.approx(expected["pressure"].values, rel=1e-9)
    states = tree["interfaces/crush"].to_dataset().sel(time=expected.attrs["time"], method="nearest")["contact_status"]
    marks = [len(c.get_offsets()) for c in figure.axes[0].collections if not isinstance(c, TriMesh)]
    assert marks == [int((states == i).sum()) for i in range(3)]
    later = map_figure(tree, None, 1e-6)
    assert "1.000 µs" in later.get_suptitle()


def test_maps_and_bodies_keep_scales_and_limits_over_a_film(tree: xr.DataTree) -> None:
    instants = tree["interfaces/crush"]["time"].values[[4, 12]]
    for figure, drawn in (map_in_motion(tree, "crush", instants), bodies_in_motion(tree, instants, Look("crush"))):
        looks = []
        for time in instants:
            drawn(float(time))
            axis = figure.axes[0]
            looks.append((axis.get_xlim(), axis.get_ylim(), [a.get_ylim() for a in figure.axes[2:]]))
        assert looks[0] == looks[1]


@pytest.mark.parametrize("maps", [True, False])
def test_a_film_has_its_frames(tree: xr.DataTree, maps: bool, tmp_path: Path) -> None:
    from PIL import Image

    shares: list[float] = []
    save_film(tree, tmp_path / "film.gif", Window(1e-6, 3e-6, 2), Look("crush"), maps, shares.append)
    assert shares == [0.5, 1.0]
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 2
    assert [path.name for path in tmp_path.iterdir()] == ["film.gif"]


def test_windows_of_films() -> None:
    stored = np.linspace(0.0, 1.0, 11)
    assert np.array_equal(Window().instants(stored), stored)
    assert Window(0.2, 0.6, 3).instants(stored) == pytest.approx([0.2, 0.4, 0.6])
    with pytest.raises(ResultsError, match=r"0\.61 to 0\.69 s"):
        Window(0.61, 0.69).instants(stored)


def test_plot_makes_films_maps_and_spectra(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    at = str(tmp_path)
    assert main(["plot", str(file), "--map", "--frames", "2", "-o", f"{at}/a.gif"]) == 0
    assert main(["plot", str(file), "--map", "--interface", "crush", "--time", "2e-6", "-o", f"{at}/b.png"]) == 0
    assert main(["srs", str(file), "-o", f"{at}/s"]) == 0
    assert main(["plot", f"{at}/s.nc", "-o", f"{at}/c.png"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"a.gif", "b.png", "c.png", "s.csv", "s.nc", "s.png"}
    capsys.readouterr()
    for options, words in (
        (["--frames", "3"], "name a file that ends in .gif"),
        (["--map", "--interface", "none"], "no interface of this name"),
        (["--map", "--bodies"], "one figure at a time"),
        (["-o", f"{at}/d.gif", "--time", "1e-6"], "--from and --to"),
        (["-o", f"{at}/d.gif", "--from", "5e-6"], "fewer than two stored instants"),
    ):
        assert main(["plot", str(file), *options]) == 2
        assert words in capsys.readouterr().err
