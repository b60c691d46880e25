"""Progress on terminals and in logs, with a clock of our own."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu import commands
from latin_fmu.commands import PATIENCE, Progress, Waiting

MODELS = Path(__file__).parents[2] / "models"


class Clock:
    """A clock that the test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Terminal(io.StringIO):
    """A stream that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def run(clock: Clock) -> Progress:
    """The progress of a run to the tolerance 1e-3 whose first seconds are over."""
    progress = Progress(1e-3, stream=Terminal(), clock=clock)
    clock.now += 1000.0
    return progress


def test_a_run_shows_its_windows_and_the_time_left_without_that_of_the_set_up(clock: Clock, run: Progress) -> None:
    assert run.line() == "set-up: 17 min so far"
    for done in range(25):
        run.update(done, 100, 1, 0.5)
        clock.now += 0.125
    clock.now -= 0.125
    assert run.line() == "24 % (24 of 100 windows), iteration 1, sqrt(eta) 5.0e-01, about 10 s left"


def test_derivatives_begin_anew(clock: Clock, run: Progress) -> None:
    run.update(99, 100, 1, 0.5)
    run.update(20, 200, 0, 0.0)
    clock.now += 1.0
    run.update(40, 200, 0, 0.0)
    assert run.line() == "derivatives: 20 % (40 of 200 instants), about 8 s left"


def test_a_run_that_checks_derivatives_begins_anew(clock: Clock, run: Progress) -> None:
    for done in (0, 100):
        run.update(done, 100, 1, 0.5)
        clock.now += 50.0
    for done in (0, 20):
        run.update(done, 100, 1, 0.5)
        clock.now += 2.0
    clock.now -= 2.0
    assert run.line() == "20 % (20 of 100 windows), iteration 1, sqrt(eta) 5.0e-01, about 8 s left"


def test_a_short_run_leaves_no_line(clock: Clock) -> None:
    progress = Progress(1e-3, stream=io.StringIO(), clock=clock)
    progress.update(0, 1, 1, 0.5)
    clock.now += 0.9 * PATIENCE
    assert progress.line() is None


def test_one_window_extrapolates_the_error_to_the_tolerance(clock: Clock, run: Progress) -> None:
    for iteration in range(1, 4):
        run.update(0, 1, iteration, 10.0 ** -(0.5 * iteration))
        clock.now += 60.0
    clock.now -= 60.0
    # 10^-1.5 after two steps of 60 s; three more to 10^-3
    assert run.line() == "iteration 3, sqrt(eta) 3.2e-02, about 3 min left"


@pytest.mark.parametrize("error", [0.0, float("nan"), float("inf")])
def test_odd_errors_give_no_estimate(clock: Clock, run: Progress, error: float) -> None:
    for iteration in (1, 2):
        run.update(0, 1, iteration, error)
        clock.now += 10.0
    assert "left" not in str(run.line())


def test_long_times_are_told_in_hours(clock: Clock, run: Progress) -> None:
    run.update(0, 100, 1, 0.1)
    clock.now += 360.0
    run.update(1, 100, 1, 0.1)
    assert str(run.line()).endswith("about 9.9 h left")


def test_a_wait_shows_the_time_left_by_its_share(clock: Clock) -> None:
    waiting = Waiting("spectra", stream=Terminal(), clock=clock)
    clock.now += 0.9 * PATIENCE
    assert waiting.line() is None
    clock.now += 10.0 - 0.9 * PATIENCE
    assert waiting.line() == "spectra: 10 s so far"
    waiting.reached(0.25, "spectrum of tip")
    assert waiting.line() == "spectrum of tip: 10 s so far, about 30 s left"
    clock.now += 10_000.0
    assert str(waiting.line()).endswith("8.3 h left")


def test_a_wait_of_known_length(clock: Clock) -> None:
    waiting = Waiting("study", 20.0, stream=Terminal(), clock=clock)
    clock.now += 15.0
    assert waiting.line() == "study: 15 s so far, about 5 s left"
    clock.now += 15.0
    assert waiting.line() == "study: 30 s so far, about 0 s left"


@pytest.mark.parametrize("kind", [Terminal, io.StringIO], ids=["terminal", "log"])
@pytest.mark.parametrize("run", [False, True], ids=["work", "run"])
def test_a_wait_prints_by_itself_and_clears_its_line(
    kind: type[io.StringIO], run: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = kind()
    monkeypatch.setattr(commands, "PATIENCE", 0.01)
    monkeypatch.setattr(commands, "_AGAIN_ON_TERMINAL", 0.01)
    monkeypatch.setattr(commands, "_AGAIN_IN_LOG", 0.01)
    with Progress(1e-3, stream=stream) if run else Waiting("work", stream=stream) as waiting:
        if isinstance(waiting, Progress):
            waiting.update(1, 4, 2, 0.1)
        while ("windows" if run else "so far") not in stream.getvalue():
            time.sleep(0.005)
        waiting.log("a line that stays")
    assert "a line that stays\n" in stream.getvalue()
    assert stream.getvalue().endswith(("\r", "\n"))  # no text is left on the line
    assert kind is io.StringIO or stream.getvalue().count("\n") == 1  # of the line that stays


def test_a_quiet_wait_prints_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "PATIENCE", 0.0)
    stream = io.StringIO()
    with Waiting("work", quiet=True, stream=stream) as waiting:
        waiting.log("a line")
        time.sleep(0.02)
    assert stream.getvalue() == ""


def test_the_error_estimate_reports_its_share() -> None:
    """Runs of the estimate count by their cost; the share never falls, and ends at 1."""
    scene = latin_fmu.load_scene(MODELS / "impact_bar" / "scene.toml", ["time.end=0.6", "time.instants=120"])
    shares: list[float] = []
    latin_fmu.estimate_error(scene, latin_fmu.solve(scene), report=shares.append)
    assert len(shares) >= 3
    assert shares == sorted(shares)
    assert shares[0] < 0.5
    assert shares[-1] == pytest.approx(1.0)
