"""The loop over one window: when it stops, what it returns, and its fall-back chain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from latin_fmu.latin import solver as loop
from latin_fmu.latin import windows
from latin_fmu.latin.acceleration import Relaxation
from latin_fmu.latin.error_indicator import Scales
from latin_fmu.latin.record import Timings, WindowRecord
from latin_fmu.latin.settings import Settings
from latin_fmu.latin.solver import Iterate, WindowSolver

SCALES = Scales(1.0, (1.0, 1.0))


class Direction:
    """What the solver asks of a direction when its evaluation is scripted."""

    weight = np.ones(1)


class Scripted(WindowSolver):
    """Meets given errors (and mismatches) one after the other; notes the q it was asked to evaluate."""

    def __init__(
        self, settings: Settings, errors: list[float], mismatches: list[float] | None = None
    ) -> None:
        super().__init__(Direction(), settings, Timings())  # type: ignore[arg-type]
        self.errors = errors
        self.mismatches = [0.0] * len(errors) if mismatches is None else mismatches
        self.asked: list[float] = []

    def _evaluate(self, stage: Any, q: Any, opening: Any, scales: Any) -> tuple[Iterate, float]:  # noqa: ARG002
        i = len(self.asked)
        self.asked.append(float(q[0, 0]))
        field = np.full((1, 1), float(i))
        return Iterate(q, field, field, np.ones((1, 1)), self.errors[i], SCALES), self.mismatches[i]

    def go(self) -> tuple[Iterate, WindowRecord]:
        record = WindowRecord(1, 1)
        stage: Any = SimpleNamespace(
            n=2, answers=None
        )  # of a longer window: the fall-back of one instant does not apply
        accepted = self.solve(stage, np.zeros((1, 1)), None, SCALES, record, 0)  # type: ignore[arg-type]
        return accepted, record


def test_stops_at_the_first_iterate_within_both_tolerances() -> None:
    settings = Settings(tolerance=1e-3, force_tolerance=1e-2, anderson_depth=0)
    accepted, record = Scripted(settings, [1.0, 9e-4, 8e-4, 7e-4], [1.0, 0.5, 9e-3, 0.0]).go()
    assert record.converged
    assert record.iterations == 3
    assert accepted.error == 8e-4
    assert record.error_indicator == [1.0, 9e-4, 8e-4]
    assert record.force_mismatch == [1.0, 0.5, 9e-3]
    assert record.fallbacks == []


def test_tolerances_are_met_with_equality() -> None:
    settings = Settings(tolerance=1e-3, force_tolerance=1e-2, anderson_depth=0)
    assert Scripted(settings, [1e-3], [1e-2]).go()[1].converged


def test_out_of_iterations_returns_the_best_and_not_the_last() -> None:
    errors = [1.0, 0.2, 0.05, 0.4, 0.3]
    accepted, record = Scripted(Settings(max_iterations=5), errors).go()
    assert not record.converged
    assert record.iterations == 5
    assert accepted.error == 0.05
    assert accepted.f_hat[0, 0] == 2.0


@pytest.mark.parametrize("broken", [float("nan"), float("inf")])
def test_a_broken_iterate_ends_the_window_with_the_best(broken: float) -> None:
    accepted, record = Scripted(Settings(), [1.0, 0.3, broken, 0.1]).go()
    assert not record.converged
    assert record.iterations == 3
    assert accepted.error == 0.3


def test_stall_of_the_acceleration_gives_way_to_relaxation_from_the_best_iterate() -> None:
    errors = [1.0, 0.1, *[0.5] * 40]
    scripted = Scripted(Settings(), errors)
    accepted, record = scripted.go()
    assert record.fallbacks == ["relaxation 1/2"]
    assert not record.converged
    assert accepted.error == 0.1
    # 12 iterates without progress, then q restarts from the best one (the second) plus half its residual
    assert scripted.asked[12] == scripted.asked[1] + 0.5
    assert scripted.asked[13] == scripted.asked[12] + 0.5
    assert record.iterations == 12 + 12  # relaxation has as much patience, then the chain ends


def test_a_run_that_recovers_under_relaxation_is_converged() -> None:
    errors = [1.0, *[0.5] * 11, *[0.5 * 0.3**i for i in range(8)]]
    _, record = Scripted(Settings(), errors).go()
    assert record.converged
    assert record.fallbacks == ["relaxation 1/2"]


def test_steady_progress_is_no_stall() -> None:
    for rate, depth in ((0.9, 6), (0.99, 0)):
        errors = [rate**i for i in range(120)]
        _, record = Scripted(Settings(tolerance=1e-12, max_iterations=120, anderson_depth=depth), errors).go()
        assert record.fallbacks == [], f"rate {rate}"


@pytest.mark.parametrize(("accelerated", "slow"), [(True, 0.98), (False, 0.9999)])
def test_stall(accelerated: bool, slow: float) -> None:
    stalled = WindowSolver._stalled
    assert not stalled([1.0] * 11, accelerated)  # patience
    assert stalled([1.0] * 12, accelerated)
    assert stalled([slow**i for i in range(30)], accelerated)
    assert not stalled([0.5**i for i in range(30)], accelerated)
    assert stalled([0.1, *[0.5] * 11], accelerated)  # an early best that is never met again


def test_without_acceleration_the_given_relaxation_is_used() -> None:
    scripted = Scripted(Settings(anderson_depth=0, relaxation=0.25), [1.0, 0.5, 1e-9])
    scripted.go()
    assert scripted.asked == [0.0, 0.25, 0.5]
    assert isinstance(scripted._accelerator(0), Relaxation)


def test_real_chain_marks_its_windows(
    blocks_scene: Any, made: Any, begun: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tolerance below round-off and no patience: relaxation, then the best iterate; the run goes on and says so."""
    monkeypatch.setattr(loop, "PATIENCE", 7)
    monkeypatch.setattr(loop, "STALL_ACCELERATED", 0.0)
    monkeypatch.setattr(loop, "STALL_PLAIN", 0.0)
    monkeypatch.setattr(
        windows, "marches", lambda _: False
    )  # the road with the fall-backs, from the first iteration
    built = made(blocks_scene(solver={"tolerance": 1e-20}))
    run = begun(built)
    run.all()
    active = [w for w in run.state.windows if w.fallbacks]
    assert len(run.state.windows) == 12
    assert len(active) >= 10
    for window in active:
        assert window.fallbacks == ["relaxation 1/2", "points one after the other"]
        assert window.iterations >= 14
        assert (
            not window.converged or window.final_error == 0.0
        )  # point by point may hit the answer to the bit
    assert np.isfinite(run.state.f_hat).all()


def test_a_failed_window_commits_its_best_iterate(
    blocks_scene: Any, made: Any, begun: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[float, np.ndarray]] = []
    run = begun(made(blocks_scene(solver={"tolerance": 1e-20, "max_iterations": 9})))
    run._observer = lambda event: seen.append((event.error_indicator, event.f_hat.copy()))
    monkeypatch.setattr(loop, "PATIENCE", 100)
    run.advance(1, 0, 12)
    assert len(seen) == 9
    best = min(seen, key=lambda pair: pair[0])
    np.testing.assert_array_equal(run.state.f_hat, best[1][-1])
