"""Pressed joints that slip under steps far above the passage of a wave: counts do not grow with friction or points.

Scenes and measures are those of ``examples/long_steps.py``. The error of the tractions is that against the same instant
solved to a tolerance of 1e-5. Limits were set before the runs.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
scenes: Any = importlib.import_module("long_steps")
sys.path.pop(0)
SMALL = (24, 3, 2)


def within(counts: Any, mean: float, largest: int, most: int = 30) -> bool:
    """Whether all instants converged without fall-back, with Newton steps within these limits. They begin where they
    are cheaper than the iterations they save, on these small interfaces after at most thirty; ``most``: where an
    instant leaves them again."""
    steps, before = counts.newton_steps, counts.iterations - counts.newton_steps
    assert counts.unconverged == counts.fallbacks == 0
    assert before.max() <= most
    assert steps.mean() <= mean
    assert steps.max() <= largest
    return True


def started(start: str) -> float:
    """Mean iterations per increment of a static start, from its message."""
    words = start.split()
    return int(words[4]) / int(words[2])


@pytest.mark.parametrize("friction", [0.1, 0.6])
def test_bolted_halves(friction: float) -> None:
    """Newton steps mean 6, largest 11, all instants converged; tractions to 6e-3; the static start takes at most 25
    iterations per increment, to 1e-11, since Newton steps would cost more there."""
    counts = scenes.measure(scenes.beam(friction, SMALL, instants=8))
    assert within(counts, 6, 11)
    assert counts.error.mean() <= 6e-3
    assert started(counts.start) <= 25


def test_points_held_by_several_interfaces() -> None:
    """Mean 6, largest 12; one instant leaves the steps and takes some 70 iterations."""
    counts = scenes.measure(scenes.wall(1.0, 2, instants=8), error=False)
    assert within(counts, 6, 12, 100)


def test_stack() -> None:
    """Three Newton steps in the mean once started."""
    counts = scenes.measure(scenes.CASES["stack of 8"](), error=False)
    assert within(counts, 3, 11)


def test_thousand_transits_in_a_step() -> None:
    """Two plates at a step of 1 ms: at most 30 iterations, all converged."""
    counts = scenes.measure(scenes.plates(2, 6e7, (8, 4, 2), instants=8, step=1e-3), error=False)
    assert counts.unconverged == 0
    assert counts.iterations.max() <= 30


def test_bent_without_inertia() -> None:
    """At most 10 Newton steps per increment in the mean."""
    counts = scenes.measure(scenes.bent(0.3, 12, SMALL), error=False)
    assert within(counts, 10, 41)


@pytest.mark.parametrize("step", [1e-6, 1e-5])
def test_short_steps_stay_as_they_were(step: float) -> None:
    """At most one iteration more than without Newton steps."""
    tables = scenes.beam(0.3, SMALL, instants=6, step=step)
    now, former = (scenes.measure(tables, error=False, newton=newton).iterations for newton in (True, False))
    assert np.all(now <= former + 1)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.1, 0.3, 0.6, 1.0])
def test_bolted_halves_of_294_points(friction: float) -> None:
    counts = scenes.measure(scenes.beam(friction))
    assert within(counts, 6, 11)
    assert counts.error.mean() <= 6e-3
    assert started(counts.start) <= 15


@pytest.mark.slow
def test_bolted_halves_of_686_points() -> None:
    """The number of steps does not grow with the points."""
    counts = scenes.measure(scenes.beam(0.3, (97, 6, 2)))
    assert within(counts, 6, 11)
    assert counts.error.mean() <= 6e-3


@pytest.mark.slow
@pytest.mark.parametrize("elements", [3, 4])
@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_wall_of_cubes(elements: int, friction: float) -> None:
    counts = scenes.measure(scenes.wall(friction, elements), error=False)
    assert within(counts, 6, 12)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "most"), [("plates, 1000 us", 25), ("bent, mu 0.3", 50)])
def test_full_cases(case: str, most: int) -> None:
    """Largest number of iterations of an instant."""
    counts = scenes.measure(scenes.CASES[case](), error=False)
    assert counts.unconverged == 0
    assert counts.iterations.max() <= most


@pytest.mark.parametrize("case", ["plates", "wall"])
def test_windows_of_ten_instants(case: str) -> None:
    """One iteration certifies the pass over the instants; tractions of both stages agree to 2e-3 at tolerance 1e-3, and
    with those of windows of one instant at the tolerance of the pass."""
    tables = scenes.wall(0.3, 2) if case == "wall" else scenes.plates(2, 6e7, (8, 4, 1))
    one, ten = (scenes.solved(tables, window=n, tolerance=tolerance) for n, tolerance in ((1, 1e-4), (10, 1e-3)))
    assert [w.iterations for w in ten.windows] == [1, 1]
    assert max(w.disagreement for w in ten.windows) <= 2e-3
    assert "disagree" not in ten.status
    for name, history in ten.interfaces.items():
        apart = np.abs(history.force() - one.interfaces[name].force()).max()
        assert apart <= 0.02 * np.abs(one.interfaces[name].force()).max()
