"""Windows: hand-over, fall-back to windows of one instant, sequential start; settings never change the result."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels import entries
from latin_fmu.latin.outcome import Outcome
from latin_fmu.march import march as run

TIGHT = {"tolerance": 1e-9, "force_tolerance": 1e-8, "max_iterations": 400}


def same(actual: Outcome, expected: Outcome, tolerance: float) -> None:
    assert actual.converged, actual.status
    for name, history in expected.interfaces.items():
        scale = np.abs(history.traction).max()
        np.testing.assert_allclose(actual.interfaces[name].traction, history.traction, atol=tolerance * scale)
    for name, body in expected.substructures.items():
        scale = np.abs(body.displacement).max()
        np.testing.assert_allclose(actual.substructures[name].displacement, body.displacement, atol=tolerance * scale)


@pytest.fixture
def answer(blocks_scene: Any, made: Any) -> Outcome:
    """Blocks solved tightly, one instant at a time."""
    return run(made(blocks_scene(solver=TIGHT))).outcome


@pytest.mark.parametrize(
    "settings",
    [
        {"window": 2},
        {"window": 5},  # does not divide 12: the last window is shorter
        {"window": 11},  # leaves a window of one instant
        {"window": "whole"},
        {"window": "whole", "start": "zero"},
        {"acceleration": "none"},
        {"acceleration": {"type": "anderson", "depth": 2}},
        {"relaxation": 0.5},
        {"acceleration": "none", "relaxation": 0.5},
    ],
    ids=str,
)
def test_settings_never_change_the_answer(
    answer: Outcome, blocks_scene: Any, made: Any, settings: dict[str, Any]
) -> None:
    outcome = run(made(blocks_scene(solver=TIGHT | settings))).outcome
    # whole windows stop on an indicator over the window: its late instants are a little less exact
    same(outcome, answer, 1e-6)


def test_windows_cover_the_interval(blocks_scene: Any, made: Any, begun: Any) -> None:
    for length, count in ((1, 12), (5, 3), ("whole", 1)):
        march = begun(made(blocks_scene(solver={"window": length})))
        march.all()
        windows = march.windows
        assert len(windows) == count
        assert windows[0].first_instant == 1
        assert windows[-1].last_instant == 12
        for before, after in itertools.pairwise(windows):
            assert after.first_instant == before.last_instant + 1
        assert all(p.instant == 12 for p in march.assembly.propagators)


def test_a_long_window_that_fails_is_done_one_by_one(answer: Outcome, blocks_scene: Any, made: Any) -> None:
    """Too few iterations for the whole window, enough for single instants."""
    solver = TIGHT | {"window": "whole", "start": "zero", "max_iterations": 40, "acceleration": "none"}
    alone = run(made(blocks_scene(solver=TIGHT | {"max_iterations": 40, "acceleration": "none"}))).outcome
    few = 2 + max(w.iterations for w in alone.windows)
    outcome = run(made(blocks_scene(solver=solver | {"max_iterations": few}))).outcome
    assert len(outcome.windows) == 1
    record = outcome.windows[0]
    assert record.fallbacks[-1] == "windows of one instant"
    assert record.converged
    assert (record.first_instant, record.last_instant) == (1, 12)
    assert record.error_indicator[-1] <= TIGHT["tolerance"]
    assert "fall-backs used in 1" in outcome.status
    same(outcome, answer, 1e-6)


def test_a_run_that_fails_everywhere_says_where_and_why(blocks_scene: Any, made: Any) -> None:
    outcome = run(made(blocks_scene(solver={"tolerance": 1e-12, "window": 4, "max_iterations": 2}))).outcome
    assert not outcome.converged
    for word in (
        "not converged",
        "instant 1",
        "worst interface",
        "friction coefficient",
        "solver.max_iterations",
        "windows of one instant",
    ):
        assert word in outcome.status
    assert all("windows of one instant" in w.fallbacks for w in outcome.windows)
    for history in outcome.interfaces.values():
        assert np.isfinite(history.traction).all()


def test_a_failed_iterate_does_not_loosen_the_windows_that_follow(blocks_scene: Any, made: Any, begun: Any) -> None:
    march = begun(made(blocks_scene(solver={"tolerance": 1e-12, "max_iterations": 2})))
    before = march.image.field("scales", 3).copy()
    record = march.advance(1, 0, 12)
    assert not record.converged
    np.testing.assert_array_equal(march.image.field("scales", 3), before)


def test_the_sequential_start_leaves_no_trace_but_a_better_guess(blocks_scene: Any, made: Any, begun: Any) -> None:
    zero, sequential = (
        begun(made(blocks_scene(solver={"window": "whole", "start": s}))) for s in ("zero", "sequential")
    )
    recorded = sequential.recorder
    for march in (zero, sequential):
        march.all()
    assert sequential.recorder is recorded
    assert len(sequential.windows) == 1
    assert sequential.windows[0].iterations < zero.windows[0].iterations
    assert sequential.marched + sequential.condensed > 12 * 2 * sequential.windows[0].iterations


def test_an_error_in_the_sequential_pass_puts_recorder_and_state_back(
    blocks_scene: Any, made: Any, begun: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    march = begun(made(blocks_scene(solver={"window": "whole"})))
    recorder, windows, before = march.recorder, march.windows, march.image.state.copy()
    call = march.image.call

    def broken(action: int, *arguments: int) -> int:
        code: int = call(action, *arguments)
        if action == entries.MARCH:
            raise FloatingPointError("made up")
        return code

    monkeypatch.setattr(march.image, "call", broken)
    with pytest.raises(FloatingPointError):
        march.advance(12, 0, 1)
    assert march.recorder is recorder
    assert march.windows is windows
    assert not len(windows)
    np.testing.assert_array_equal(march.image.state, before)
    assert march.assembly.instant == 0


@pytest.mark.parametrize("window", [1, 4])
def test_scaled_units_give_equal_counts_and_results(blocks_scene: Any, made: Any, window: int) -> None:
    """Metres, kilograms, seconds against millimetres, grams, milliseconds."""
    length, mass, time = 1e3, 1e3, 1e3
    stress = mass / (length * time**2)
    si = blocks_scene(solver={"window": window})
    other = blocks_scene(solver={"window": window}, time={"end": 1.2 * time, "instants": 12})
    other["material"] = {
        n: m | {"young_modulus": m["young_modulus"] * stress, "density": m["density"] * mass / length**3}
        for n, m in si["material"].items()
    }
    for body in other["substructure"].values():
        body["box"] = body["box"] | {k: [length * x for x in body["box"][k]] for k in ("origin", "size")}
        if "initial_velocity" in body:
            body["initial_velocity"] = [x * length / time for x in body["initial_velocity"]]
    first, second = run(made(si)).outcome, run(made(other)).outcome
    assert [w.iterations for w in first.windows] == [w.iterations for w in second.windows]
    for name, history in first.interfaces.items():
        scale = np.abs(history.traction).max()
        np.testing.assert_allclose(second.interfaces[name].traction / stress, history.traction, atol=1e-11 * scale)


def test_nothing_happens_in_a_quiet_assembly(bars_scene: Any, made: Any) -> None:
    tables = bars_scene(load={})
    outcome = run(made(tables)).outcome
    assert outcome.converged
    assert max(w.iterations for w in outcome.windows) == 1
    assert not outcome.substructures["a"].displacement.any()


def test_perfect_interfaces_need_few_iterations_and_no_gap(bars_scene: Any, made: Any) -> None:
    outcome = run(made(bars_scene("perfect"))).outcome
    assert outcome.converged
    assert outcome.interfaces["joint"].gap is None
    assert max(w.iterations for w in outcome.windows) <= 6


def test_no_interface_is_a_plain_march(bars_scene: Any, made: Any) -> None:
    """a and b are alike and marched together, c rests."""
    outcome = run(made(bars_scene(interface={}))).outcome
    assert outcome.converged
    assert outcome.interfaces == {}
    assert outcome.passes == pytest.approx(2 / 3)
    assert np.abs(outcome.energy["balance"]).max() < 1e-12
