"""The loop over one window: when it stops, what it returns, and its fall-back chain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels import iteration as loop
from latin_fmu.kernels.newton import advance_iterate
from latin_fmu.kernels.records import CLASS, GROUP, RUN
from latin_fmu.kernels.sums import MEASURES
from latin_fmu.latin.outcome import WindowRecord
from latin_fmu.latin.run_image import Iterate, Stages
from latin_fmu.latin.settings import SolverSettings
from latin_fmu.latin.solver import WindowSolver
from latin_fmu.propagator.image import pools_of
from tests.plain_kernels import in_python

ROOM = 32  # numbers between the fields


class OneNumber:
    """An image of one channel and no substructure: q and the rules of the iteration."""

    n_flat = 1

    def __init__(self, settings: SolverSettings) -> None:
        depth, most = settings.anderson_depth, 3 * settings.max_iterations + 64
        sizes = dict.fromkeys(("q", "local_f", "local_w", "r", "last_q", "last_r"), 2)
        sizes |= {"dq": 2 * depth, "dr": 2 * depth, "gram": depth**2, "least": (depth + 3) * depth}
        sizes |= {"merits": 2 * most, "measure": 9, "scales": 3}
        sizes |= {"parts": MEASURES + 2 * depth, "totals": MEASURES + 2 * depth}
        run, self.moving = np.zeros(1, dtype=RUN), np.zeros(ROOM * (len(sizes) + 1) + sum(sizes.values()))
        end = 0
        for name, size in sizes.items():
            run[name], end = end, end + size + ROOM
        # metric; first channels of both sides of the interface and their number; its row of sums; sides that are moved
        fixed = np.ones(6)
        fixed.view(np.int64)[1:] = 0, 0, 1, 0, 1
        numbers = {
            "n_flat": 1,
            "n_interface": 1,
            "n_part": 1,
            "part_width": MEASURES + 2 * depth,
            "own_parts": int(run["parts"][0]),
            "segments": 1,
            "part_order": 4,
            "sides": 5,
            "depth": depth,
            "relaxation": settings.relaxation,
            "longest_step": np.inf,
            "tolerance": settings.tolerance,
            "force_tolerance": settings.force_tolerance,
            "metric": 0,
        }
        for name, value in numbers.items():
            run[name] = value
        rows = (np.zeros(0, dtype=record).view(np.recarray) for record in (CLASS, GROUP))
        self.pools = pools_of(run.view(np.recarray), *rows, fixed, self.moving)

    def set(self, fields: dict[str, float]) -> None:
        """Numbers of the run."""
        for name, value in fields.items():
            self.pools.run[0][name] = value

    def field(self, name: str, *shape: int) -> Any:
        """A view."""
        at = int(self.pools.run[0][name])
        return self.moving[at : at + int(np.prod(shape))].reshape(shape)

    def judge(self, window: int, phase: int, iteration: int, accelerated: bool) -> int:
        """Verdict on an iterate."""
        with in_python():
            return int(loop.judge(self.pools, window, phase, iteration, accelerated))

    def advance(self, window: int, iteration: int, phase: int) -> None:
        """The next iterate."""
        with in_python():
            advance_iterate(self.pools, window, iteration, phase)


class Scripted(Stages):
    """Stages of a window of two instants that meet given errors (and force residuals) one after the other; ``asked``:
    the q that were evaluated. Of a longer window: the fall-back of one instant does not apply."""

    n = 2

    def __init__(
        self, settings: SolverSettings, errors: list[float], force_residuals: list[float] | None = None
    ) -> None:
        self.image: Any = OneNumber(settings)
        self.direction: Any = SimpleNamespace(metric=np.ones(1))
        self.settings, self.errors = settings, errors
        self.force_residuals = [0.0] * len(errors) if force_residuals is None else force_residuals
        self.asked: list[float] = []

    def iterations(self, counts: tuple[int, int, int, int], look: Any) -> int:
        """``iterate`` with the script in the place of both stages."""
        _, start, phase, limit = counts
        for iteration in range(start, limit):
            self.evaluate()
            bits = self.judge(phase, iteration, bool(self.image.pools.run[0]["depth"]))
            look(iteration, bits, 0)
            if bits & loop.CONVERGED:
                return iteration + 1
            if bits & (loop.BROKEN | loop.STALLED):
                return -(iteration + 1)
            if iteration + 1 < limit:
                self.image.advance(self.n, iteration, phase)
        return -limit

    def judge(self, phase: int, iteration: int, accelerated: bool) -> int:
        """Verdict on the iterate."""
        return int(self.image.judge(self.n, phase, iteration, accelerated))

    def evaluate(self) -> None:
        """The next of the script."""
        i = len(self.asked)
        self.asked.append(float(self.field("q")[0, 0]))
        self.field("local_f")[:] = self.field("local_w")[:] = float(i)
        self.field("r")[:] = 1.0
        self.image.field("measure", 8)[:5] = self.errors[i], self.force_residuals[i], 1.0, 1.0, 1.0

    def go(self) -> tuple[Iterate, WindowRecord]:
        """Solve from q = 0."""
        record = WindowRecord(1, 2)
        return WindowSolver(self.settings).solve(self, record, 0), record

    def flags(self, accelerated: bool) -> list[int]:
        """What each iterate of the script means."""
        bits = []
        for i in range(len(self.errors)):
            self.evaluate()
            bits.append(self.judge(0, i, accelerated))
        return bits


def test_stops_at_the_first_iterate_within_both_tolerances() -> None:
    settings = SolverSettings(tolerance=1e-3, force_tolerance=1e-2, anderson_depth=0)
    accepted, record = Scripted(settings, [1.0, 9e-4, 8e-4, 7e-4], [1.0, 0.5, 9e-3, 0.0]).go()
    assert record.converged
    assert record.iterations == 3
    assert accepted.error == 8e-4
    assert record.error_indicator == [1.0, 9e-4, 8e-4]
    assert record.force_mismatch == [1.0, 0.5, 9e-3]
    assert record.fallbacks == []


def test_tolerances_are_met_with_equality() -> None:
    settings = SolverSettings(tolerance=1e-3, force_tolerance=1e-2, anderson_depth=0)
    assert Scripted(settings, [1e-3], [1e-2]).go()[1].converged


def test_out_of_iterations_returns_the_best_and_not_the_last() -> None:
    errors = [1.0, 0.2, 0.05, 0.4, 0.3]
    accepted, record = Scripted(SolverSettings(max_iterations=5), errors).go()
    assert not record.converged
    assert record.iterations == 5
    assert accepted.error == 0.05
    assert accepted.f_hat[0, 0] == 2.0


@pytest.mark.parametrize("broken", [float("nan"), float("inf")])
def test_a_broken_iterate_ends_the_window_with_the_best(broken: float) -> None:
    accepted, record = Scripted(SolverSettings(), [1.0, 0.3, broken, 0.1]).go()
    assert not record.converged
    assert record.iterations == 3
    assert accepted.error == 0.3


def test_stall_of_the_acceleration_gives_way_to_relaxation_from_the_best_iterate() -> None:
    errors = [1.0, 0.1, *[0.5] * 40]
    scripted = Scripted(SolverSettings(), errors)
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
    _, record = Scripted(SolverSettings(), errors).go()
    assert record.converged
    assert record.fallbacks == ["relaxation 1/2"]


def test_steady_progress_is_no_stall() -> None:
    for rate, depth in ((0.9, 6), (0.99, 0)):
        errors = [rate**i for i in range(120)]
        _, record = Scripted(SolverSettings(tolerance=1e-12, max_iterations=120, anderson_depth=depth), errors).go()
        assert record.fallbacks == [], f"rate {rate}"


@pytest.mark.parametrize(("accelerated", "slow"), [(True, 0.98), (False, 0.9999)])
def test_stall(accelerated: bool, slow: float) -> None:
    def stalls(errors: list[float]) -> list[bool]:
        settings = SolverSettings(tolerance=1e-30, max_iterations=60)
        return [bool(flags & loop.STALLED) for flags in Scripted(settings, errors).flags(accelerated)]

    assert stalls([1.0] * 12) == [False] * 11 + [True]  # patience
    assert stalls([slow**i for i in range(30)])[-1]
    assert not any(stalls([0.5**i for i in range(30)]))
    assert stalls([0.1, *[0.5] * 11])[-1]  # an early best that is never met again


def test_the_best_iterate_is_marked() -> None:
    settings = SolverSettings(tolerance=1e-3, force_tolerance=1e-2)
    flags = Scripted(settings, [0.5, 0.6, 0.4, float("nan"), 9e-4, 5e-4], [0, 0, 0, 0, 1.0, 1e-3]).flags(True)
    best = [bool(bits & loop.BEST) for bits in flags]
    assert best == [True, False, True, False, True, True]
    assert [bool(bits & loop.BROKEN) for bits in flags] == [False, False, False, True, False, False]
    assert [bool(bits & loop.CONVERGED) for bits in flags] == [False] * 5 + [True]


def test_a_warm_start_within_tolerance_is_not_taken_as_it_is() -> None:
    """In windows of one instant, unless nothing happens at all."""
    settings = SolverSettings(tolerance=1e-3, force_tolerance=1e-2)
    for error, n, converged in ((9e-4, 1, False), (9e-4, 2, True), (0.9e-5, 1, True)):
        scripted = Scripted(settings, [error])
        scripted.n = n
        assert bool(scripted.flags(True)[0] & loop.CONVERGED) == converged


def test_without_acceleration_the_given_relaxation_is_used() -> None:
    scripted = Scripted(SolverSettings(anderson_depth=0, relaxation=0.25), [1.0, 0.5, 1e-9])
    scripted.go()
    assert scripted.asked == [0.0, 0.25, 0.5]


def test_real_chain_marks_its_windows(blocks_scene: Any, made: Any, begun: Any, python_driver: Any) -> None:
    """A tolerance below round-off: relaxation, point by point, then the best iterate; the run reports it. After two
    instants in vain there are no fall-backs."""
    python_driver()  # whose windows are solved with the fall-backs, from the first iteration
    run = begun(made(blocks_scene(solver={"tolerance": 1e-20})))
    run.all()
    active = [w for w in run.windows if w.fallbacks]
    assert len(run.windows) == 12
    assert len(active) >= 2
    in_vain = [i for i in range(2, 12) if not any(w.converged for w in run.windows[i - 2 : i])]
    assert all(not run.windows[i].fallbacks and run.windows[i].iterations <= 24 for i in in_vain)
    assert all(w in active or w.converged or i in in_vain for i, w in enumerate(run.windows))
    for window in active:
        assert window.fallbacks == ["relaxation 1/2", "point by point"]
        assert window.iterations >= 2 * loop.PATIENCE
        assert not window.converged or window.final_error == 0.0  # point by point may hit the answer to the bit
    assert np.isfinite(run.f_hat).all()


def test_a_failed_window_commits_its_best_iterate(blocks_scene: Any, made: Any, begun: Any) -> None:
    seen: list[tuple[float, np.ndarray]] = []
    run = begun(made(blocks_scene(solver={"tolerance": 1e-20, "max_iterations": 9})))
    run._observer = lambda event: seen.append((event.error_indicator, event.f_hat.copy()))
    run.advance(1, 0, 12)
    assert len(seen) == 9
    best = min(seen, key=lambda pair: pair[0])
    np.testing.assert_array_equal(run.f_hat, best[1][-1])


def test_free_motion_is_without_the_tractions_of_the_last_instant(blocks_scene: Any, made: Any, begun: Any) -> None:
    """``predict`` has them among the loads: the velocities differ by the compliance times these tractions."""
    run = begun(made(blocks_scene()))
    for number in range(6):
        run.advance(1, number, 12)
    stages, image, assembly = run.stages(1, run.assembly.instant + 1), run.image, run.assembly
    stages.begin()
    under = [image.class_field(c, "w_free", *channels.shape).copy() for c, channels in enumerate(assembly.channels)]
    stages.free_motion()
    free = image.field("w", image.n_flat)
    for velocity, channels, propagator in zip(under, assembly.channels, assembly.propagators, strict=True):
        operators = propagator.operators
        change = operators.compliance @ (operators.area[:, None] * run.f_hat[channels])
        assert np.abs(change).max() > 0.0
        np.testing.assert_allclose(velocity - free[channels], change, rtol=0.0, atol=1e-10 * np.abs(change).max())
