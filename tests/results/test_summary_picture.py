"""The summary figure: panels present, curves right, nothing overlapping, files whole."""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from latin_fmu import ResultsError
from latin_fmu.latin.outcome import BoltHistory, SensorHistory
from latin_fmu.pictures.style import save_figure
from latin_fmu.pictures.summary_picture import summary_figure
from latin_fmu.results.estimates import ErrorEstimate, QuantityEstimate
from latin_fmu.results.solution import Solution


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
    assert {"Energy of the assembly", "Iterations of each of 200 windows"} <= full
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
    (curve,) = [line for line in axes["Acceleration of the sensors"].lines if line.get_label() == "tip, along y"]
    assert curve.get_ydata()[-1] == pytest.approx(-5.0)
    (curve,) = [line for line in axes["Tension of the bolts"].lines if str(line.get_label()).startswith("m6")]
    assert axes["Tension of the bolts"].get_ylim() == pytest.approx((3.95, 5.05))
    assert (curve.get_label(), curve.get_ydata()[0]) == ("m6: 20 % lost at the end", 5.0)
    assert " ± 2 % over " in str(axes["Normal resultant (compression > 0)"].lines[1].get_label())


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
