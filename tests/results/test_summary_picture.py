"""The summary figure: panels present, curves right, nothing overlapping, files whole."""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu import ResultsError
from latin_fmu.latin.outcome import BoltHistory, SensorHistory
from latin_fmu.pictures.style import save_figure
from latin_fmu.pictures.summary_picture import spectra_figure, summary_figure
from latin_fmu.results.estimates import ErrorEstimate, QuantityEstimate
from latin_fmu.results.solution import Solution
from latin_fmu.results.spectra import axes_in_order, shock_axis, stored_spectra

from .test_sensor_filters import TOP
from .test_sensors import pressed


@pytest.mark.parametrize("kind", ["crushing", "bars", "stalled", "stack"])
def test_panels_do_not_overlap(kind: str, request: pytest.FixtureRequest) -> None:
    figure = summary_figure(request.getfixturevalue(kind).to_datatree(), details=True)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes = [axis for part in figure.subfigs for axis in part.axes]
    boxes = [axis.get_tightbbox(canvas.get_renderer()) for axis in axes]
    for (one, a), (two, b) in itertools.combinations(zip(axes, boxes, strict=True), 2):
        common = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert min(common) < 1.0, (one.get_title(), two.get_title())
    width, height = figure.get_size_inches() * figure.dpi
    assert all(box.x0 > -1 and box.y0 > -1 and box.x1 < width + 1 and box.y1 < height + 1 for box in boxes)


def test_panels_follow_the_run(crushing: Solution, bars: Solution, stack: Solution) -> None:
    many = [axis for part in summary_figure(stack.to_datatree()).subfigs for axis in part.axes]
    assert sum(len(axis.collections) == 3 for axis in many) == 16
    one = {axis.get_title() for part in summary_figure(bars.to_datatree(), True).subfigs for axis in part.axes}
    assert "Convergence" in one
    assert not any("Friction" in title or "Energy" in title for title in one)
    full = {axis.get_title() for part in summary_figure(crushing.to_datatree(), True).subfigs for axis in part.axes}
    assert {"Energy of the assembly (terms above 0.5 % of the largest)", "Iterations of each of 200 windows"} <= full
    plain = {axis.get_title() for part in summary_figure(crushing.to_datatree()).subfigs for axis in part.axes}
    assert full - plain == {"Iterations of each of 200 windows", r"Final $\sqrt{\eta}$ of each window"}


def test_sensors_and_bolts_have_panels(crushing: Solution) -> None:
    motion = np.zeros((crushing.time.size, 3))
    motion[:, 1] = np.linspace(0.0, -5.0, crushing.time.size)
    sensor = SensorHistory("tip", "beam", None, np.zeros(3), motion, motion, motion)
    force = np.linspace(5e3, 4e3, crushing.time.size)
    bolt = BoltHistory("m6", "bolt", 1, 5e3, 20e-6, 1e-5, force, (1,), (5e3,))
    estimate = ErrorEstimate((QuantityEstimate("crush.peak_force", 1.0, 0.02),))
    outcome = replace(crushing.outcome, sensors={"tip": sensor}, bolts={"m6": bolt})
    figure = summary_figure(replace(crushing, outcome=outcome, estimate=estimate).to_datatree())
    axes = {axis.get_title(): axis for part in figure.subfigs for axis in part.axes}
    (curve,) = [
        line for line in axes["Acceleration of the sensors"].lines if line.get_label() == "tip, along y, unfiltered"
    ]
    assert curve.get_ydata()[-1] == pytest.approx(-5.0)
    (curve,) = [line for line in axes["Tension of the bolts"].lines if str(line.get_label()).startswith("m6")]
    assert axes["Tension of the bolts"].get_ylim() == pytest.approx((3.95, 5.05))
    assert (curve.get_label(), curve.get_ydata()[0]) == ("m6: 5.000 kN, 20 % lost at the end", 5.0)
    assert " ± 2 %, mean of " in str(axes["Normal resultant (compression > 0)"].lines[1].get_label())


def test_a_spectrum_that_is_asked_for_is_drawn() -> None:
    spectrum = {"lowest": 5e5, "highest": 2e6, "quality": 5.0}
    solution = latin_fmu.solve(pressed(sensor={"top": TOP | {"spectrum": spectrum}, "bare": TOP}))
    tree = solution.to_datatree()
    axis, *_ = [a for part in summary_figure(tree).subfigs for a in part.axes if "spectra" in a.get_title()]
    stored = tree["sensors/top/spectrum"]
    (curve,) = [line for line in axis.lines if str(line.get_label()).startswith("top, ")]
    along = int(stored["acceleration"].values[0].max(axis=0).argmax())
    assert curve.get_label() == "top, Q = 5"
    assert axis.get_title() == f"Shock response spectra along {'xyz'[along]}, maximax"
    np.testing.assert_array_equal(curve.get_ydata(), stored["acceleration"].values[0, :, along])
    np.testing.assert_array_equal(curve.get_xdata(), stored["frequency"].values)
    assert (axis.get_xscale(), axis.get_ylabel()) == ("log", "acceleration (m/s²)")
    canvas = FigureCanvasAgg(axis.figure.figure)
    canvas.draw()
    assert axis.get_xlabel() == "natural frequency (kHz)"
    assert {"500", "1000", "2000"} <= {text.get_text() for text in axis.get_xticklabels()}
    assert not any(text.get_text() for text in axis.get_yticklabels(minor=True))


def test_small_changes_of_large_values_are_readable(crushing: Solution) -> None:
    """A bolt that loses next to nothing has ticks without an offset; of a preloaded assembly the change of the elastic
    energy is drawn, beside which other terms are seen."""
    n = crushing.time.size
    force = 12e3 + np.linspace(0.0, 3.0, n)
    bolt = BoltHistory("m6", "bolt", 1, 12e3, 20e-6, 1e-5, force, (1,), (12e3,))
    energy = {
        "kinetic": np.linspace(0.0, 2e-3, n),
        "elastic": 10.0 + np.linspace(0.0, 1e-3, n),
        "drift_work": np.full(n, 1e-9),
    }
    outcome = replace(crushing.outcome, bolts={"m6": bolt}, energy=energy)
    figure = summary_figure(replace(crushing, outcome=outcome).to_datatree())
    FigureCanvasAgg(figure).draw()
    axes = {axis.get_title(): axis for part in figure.subfigs for axis in part.axes}
    assert not any(axis.yaxis.get_offset_text().get_text() for axis in axes.values())
    # 3 N of 12 kN, as change against the clamp force; 1 % and room for the legend
    (curve,) = [line for line in axes["Tension of the bolts"].lines if str(line.get_label()).startswith("m6")]
    np.testing.assert_allclose(curve.get_ydata()[[0, -1]], [0.0, 0.025], atol=1e-12)
    assert axes["Tension of the bolts"].get_ylabel() == "change of tension (%)"
    low, high = axes["Tension of the bolts"].get_ylim()
    assert 1.0 < high - low < 1.5
    axis = axes["Energy of the assembly (terms above 0.5 % of the largest)"]
    shown = {str(line.get_label()): line.get_ydata()[-1] for line in axis.lines}
    assert shown == {"kinetic": pytest.approx(2.0), "elastic, less 10.0 J of the start": pytest.approx(1.0)}


def test_energies_of_a_run_at_rest_have_no_legend(crushing: Solution) -> None:
    """Nor a warning that there are no curves."""
    outcome = replace(crushing.outcome, energy={"kinetic": np.zeros(crushing.time.size)})
    figure = summary_figure(replace(crushing, outcome=outcome).to_datatree())
    (axis,) = [a for part in figure.subfigs for a in part.axes if a.get_title().startswith("Energy")]
    assert (len(axis.lines), axis.get_legend()) == (0, None)


def test_many_sensors_are_named_and_a_stopped_run_says_so(crushing: Solution) -> None:
    motion = np.zeros((crushing.time.size, 3))
    motion[:, 1] = 1.0
    sensors = {f"s{i}": SensorHistory(f"s{i}", "beam", None, np.zeros(3), motion, motion, i * motion) for i in range(7)}
    outcome = replace(crushing.outcome, sensors=sensors, interrupted="its limit", interfaces={})
    figure = summary_figure(replace(crushing, outcome=outcome).to_datatree())
    assert "STOPPED BEFORE ITS END" in figure.get_suptitle()
    axes = {axis.get_title(): axis for part in figure.subfigs for axis in part.axes}
    axis = axes["Acceleration of the sensors"]
    assert len(axis.get_legend().get_texts()) == 7
    assert axis.get_xlabel() == "time (µs)"  # without interfaces, too


def test_force_curve_in_readable_units(crushing: Solution) -> None:
    axis = summary_figure(crushing.to_datatree()).subfigs[0].axes[0]
    curve = next(line for line in axis.lines if str(line.get_label()).startswith("crush: "))
    expected = crushing.interfaces["crush"].normal_resultant()
    np.testing.assert_allclose(curve.get_ydata(), expected / 1e3)
    np.testing.assert_allclose(curve.get_xdata(), crushing.time / 1e-6)
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("time (µs)", "force (kN)")


def test_tolerance_comes_from_the_scene(bars: Solution, crushing: Solution) -> None:
    def levels(solution: Solution, title: str) -> list[object]:
        figure = summary_figure(solution.to_datatree(), details=True)
        axes = [axis for part in figure.subfigs for axis in part.axes if title in axis.get_title()]
        return [line.get_ydata()[0] for line in axes[0].lines if line.get_label() == "tolerance"]

    assert levels(bars, "Convergence") == [1e-3]
    assert levels(crushing, "Final") == []


def test_an_unfinished_run_says_so(stalled: Solution) -> None:
    assert "NOT CONVERGED" in summary_figure(stalled.to_datatree()).get_suptitle()


def test_no_window_system_is_touched(crushing: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it would fail
    assert summary_figure(crushing.to_datatree()).axes


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_files(bars: Solution, suffix: str, tmp_path: Path) -> None:
    save_figure(summary_figure(bars.to_datatree()), tmp_path / f"figure{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"figure{suffix}"]
    assert (tmp_path / f"figure{suffix}").stat().st_size > 5000


@pytest.mark.parametrize("name", ["figure.doc", "figure"])
def test_other_formats_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match=r"allowed: .png"):
        save_figure(Figure(), tmp_path / name)


def test_spectra_and_motions_are_along_the_axis_of_the_shock() -> None:
    """A base driven along y: both sensors along it, though the top moves more across; then the other axes."""
    spectrum = {"lowest": 5e5, "highest": 2e6}
    base = {"face": "lower.zmin", "spectrum": spectrum}
    drive = {"type": "acceleration", "face": "lower.zmin", "components": ["x", "y", "z"], "value": [0.0, 1e4, 10.0]}
    scene = pressed(sensor={"top": TOP | {"spectrum": spectrum}, "foot": base}, boundary={"base": drive})
    tree = latin_fmu.solve(scene).to_datatree()
    assert shock_axis(tree) == 1
    spectra = stored_spectra(tree)
    assert axes_in_order(spectra)[0] == 2
    order = axes_in_order(spectra, 1)
    assert order[:2] == [1, 2]
    axes = {a.get_title(): a for part in summary_figure(tree).subfigs for a in part.axes}
    titles = [title for title in axes if "spectra" in title]
    assert titles == [f"Shock response spectra along {'xyz'[along]}, maximax" for along in order]
    labels = {str(line.get_label()) for line in axes["Acceleration of the sensors"].lines}
    assert {"top, along y, unfiltered", "foot, along y, unfiltered"} <= labels
    assert {str(line.get_label()) for line in axes[titles[0]].lines} == {"top, Q = 10", "foot, Q = 10"}
    figure = spectra_figure(spectra, shock=shock_axis(tree))
    assert [a.get_title() for a in figure.axes[::2]] == ["top, along y, Q = 10", "foot, along y, Q = 10"]
    alone = spectra_figure({"top": spectra["top"]}, shock=1)
    assert len(alone.axes) == 2 * len(axes_in_order({"top": spectra["top"]}, 1))
    assert shock_axis(xr.DataTree()) is None
