"""Progress on terminals and in logs, with a clock of our own."""

from __future__ import annotations

import io

import pytest

from latin_fmu.commands.run import Progress


class Clock:
    """A clock that is told the time."""

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


def test_a_log_gets_a_line_every_few_seconds(clock: Clock) -> None:
    stream = io.StringIO()
    progress = Progress(stream, 1e-3, clock)
    for done in range(100):
        progress.update(done, 100, 1, 0.5)
        clock.now += 0.125
    progress.close()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 4
    assert lines[0].startswith("24 % (24 of 100 windows), iteration 1, sqrt(eta) 5.0e-01, about 10 s left")


def test_a_short_run_leaves_no_line_in_a_log(clock: Clock) -> None:
    stream = io.StringIO()
    progress = Progress(stream, 1e-3, clock)
    progress.update(0, 1, 1, 0.5)
    progress.close()
    assert stream.getvalue() == ""


def test_a_terminal_has_one_line_that_is_cleared(clock: Clock) -> None:
    stream = Terminal()
    progress = Progress(stream, 1e-3, clock)
    for done in range(10):
        progress.update(done, 10, 2, 1e-2)
        clock.now += 1.0
    progress.close()
    text = stream.getvalue()
    assert "\n" not in text
    assert "about 1 s left" in text
    assert text.endswith("\r")
    assert not text.split("\r")[-2].strip()


def test_set_up_time_does_not_spoil_the_estimate(clock: Clock) -> None:
    stream = Terminal()
    progress = Progress(stream, 1e-3, clock)
    clock.now += 1000.0
    for done in range(5):
        progress.update(done, 10, 1, 0.1)
        clock.now += 2.0
    assert "about 12 s left" in stream.getvalue().split("\r")[-1]


def test_one_window_extrapolates_the_error_to_the_tolerance(clock: Clock) -> None:
    stream = Terminal()
    progress = Progress(stream, 1e-3, clock)
    for iteration in range(1, 4):
        progress.update(0, 1, iteration, 10.0 ** -(0.5 * iteration))
        clock.now += 60.0
    last = stream.getvalue().split("\r")[-1]
    assert "iteration 3" in last
    assert "about 3 min left" in last  # 10^-1.5 after two steps of 60 s; three more to 10^-3


@pytest.mark.parametrize("error", [0.0, float("nan"), float("inf")])
def test_odd_errors_give_no_estimate(clock: Clock, error: float) -> None:
    stream = Terminal()
    progress = Progress(stream, 1e-3, clock)
    for iteration in (1, 2):
        progress.update(0, 1, iteration, error)
        clock.now += 10.0
    assert "left" not in stream.getvalue()


def test_long_times_are_told_in_hours(clock: Clock) -> None:
    stream = Terminal()
    progress = Progress(stream, 1e-3, clock)
    progress.update(0, 100, 1, 0.1)
    clock.now += 360.0
    progress.update(1, 100, 1, 0.1)
    assert "about 9.9 h left" in stream.getvalue()
