"""The estimated error of a session: that of the plain run it amounts to, and above the true one."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.step_history import AcceptedStep, curves_of
from latin_fmu.cosim.variables import CAUSAL, HOLD, LINE, PRESCRIBED, RATE
from latin_fmu.results.estimates import ErrorEstimate
from latin_fmu.scene.quantity_table import FLOOR
from latin_fmu.scene.schema import Scene

from ..verification.known_answers import Known, smooth_pulse

END, STEPS = 6.0, 100
KNOWN = smooth_pulse(0.05)


def with_law(known: Known, law: object) -> Scene:
    """The scene of a known solution with another law of its load, and fields for its sensors; round-off, in which two
    drivers differ, grows from instant to instant up to the tolerance."""
    data = tomllib.loads(known.scene.text())
    data["load"]["push"]["law"] = law
    data["output"] = {"fields": True}
    data["solver"] = {"tolerance": 1e-8}
    return latin_fmu.scene_from_dict(data)


def pulse(times: np.ndarray) -> np.ndarray:
    """Half a sine of two seconds: the load of the known solution."""
    return np.sin(np.pi * np.minimum(times / 2.0, 1.0)).round(15)


def driven(rule: int, steps: int = STEPS, last: float = 1.0) -> Session:
    """A windowed session that hands the pulse over step by step; the last step is ``last`` times as long."""
    session = Session(with_law(KNOWN, "input"), Settings(interpolation=rule, keep=True))
    session.initialize()
    h = END / STEPS
    for i in range(steps):
        now, then = pulse(np.array([i * h, (i + 1) * h]))
        session.set_load("push", float(then if rule == LINE else now), float(then - now) / h)
        report = session.step(i * h, h if i < steps - 1 else last * h)
        assert report.accepted, report.message
    return session


def check_true(estimate: ErrorEstimate, session: Session) -> None:
    """Every estimated error is at least the true one, errors below 0.1 % counted as that."""
    assert {q.quantity for q in estimate.quantities} >= set(KNOWN.quantities)
    for quantity in KNOWN.quantities:
        owner, _, key = quantity.rpartition(".")
        estimated = estimate[quantity]
        if key not in ("force_rms", "displacement"):
            true = abs(estimated.value - KNOWN.exact.values[quantity]) / KNOWN.exact.scales[quantity]
            assert max(estimated.error, FLOOR) >= true, quantity
        assert owner in ("meet", *session.scene.sensor)


def test_windowed_estimate_is_that_of_the_plain_run() -> None:
    """Straight lines between communication points: a table, solved here as a plain scene and judged there."""
    session = driven(LINE)
    estimate = session.estimate_error()
    check_true(estimate, session)
    times = np.linspace(0.0, END, STEPS + 1)
    plain = with_law(KNOWN, {"type": "table", "times": times.tolist(), "values": pulse(times).tolist()})
    expected = latin_fmu.estimate_error(plain, latin_fmu.solve(plain))
    assert len(estimate.quantities) == len(expected.quantities) == 18
    for ours, theirs in zip(estimate.quantities, expected.quantities, strict=True):
        assert ours.quantity == theirs.quantity
        assert ours.value == pytest.approx(theirs.value, rel=1e-6)
        assert ours.error == pytest.approx(theirs.error, rel=1e-3, abs=1e-6), ours.quantity


def test_prescribed_estimate_is_that_of_the_plain_run() -> None:
    times = np.linspace(0.0, END, STEPS + 1)
    session = Session(with_law(KNOWN, "input"), Settings(mode=PRESCRIBED))
    session.set_history("push", times, pulse(times))
    session.initialize()
    plain = with_law(KNOWN, {"type": "table", "times": times.tolist(), "values": pulse(times).tolist()})
    estimate = session.estimate_error()
    check_true(estimate, session)
    expected = latin_fmu.estimate_error(plain, latin_fmu.solve(plain))
    assert [q.error for q in estimate.quantities] == pytest.approx([q.error for q in expected.quantities], rel=1e-9)


@pytest.mark.parametrize("rule", [HOLD, RATE])
def test_jumps_at_communication_points_are_covered(rule: int) -> None:
    """A staircase, and lines from value and rate: the estimate grants what coarser steps make of the jumps."""
    session = driven(rule)
    estimate = session.estimate_error()
    scales, exact = KNOWN.exact.scales, KNOWN.exact.values
    if rule == RATE:
        check_true(estimate, session)
    true = abs(estimate["meet.impulse"].value - exact["meet.impulse"]) / scales["meet.impulse"]
    assert max(estimate["meet.impulse"].error, FLOOR) >= true


@pytest.mark.parametrize("rule", [HOLD, RATE, LINE, CAUSAL])
def test_curves_keep_the_impulse_of_the_steps(rule: int) -> None:
    """The area below a curve is that of what was set, whatever the jumps."""
    rng = np.random.default_rng(7)
    ends = 2.0 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.3, 6))])
    value, rate = rng.normal(size=6), rng.normal(size=6)
    steps = [
        AcceptedStep(a, b, np.zeros(1), {"p": float(v)}, {"p": float(r)}, None)
        for a, b, v, r in zip(ends[:-1], ends[1:], value, rate, strict=True)
    ]
    times, values = curves_of(steps, rule, {"p": ((0.0, 9.0), (0.4, 0.4))})["p"]
    assert np.all(np.diff(times) > 0.0)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(ends[-1] - 2.0)
    h, before = np.diff(ends), np.concatenate([[0.4], value[:-1]])
    areas = {HOLD: value * h, RATE: value * h + 0.5 * rate * h**2, LINE: 0.5 * (before + value) * h}
    areas[CAUSAL] = areas[RATE]  # the rates of the lines are kept
    assert np.trapezoid(values, times) == pytest.approx(areas[rule].sum(), rel=1e-5)


def test_what_is_not_known_is_not_estimated() -> None:
    """Nothing solved; a part of a time step at the end, which waits for its rest; a state restored elsewhere."""
    fresh = Session(with_law(KNOWN, "input"), Settings(keep=True))
    assert fresh.estimate_error().quantities == ()
    assert "nothing was solved" in fresh.estimate_error().remarks[0]
    uneven = driven(HOLD, steps=60, last=0.37)
    grid = END / STEPS / uneven.scene.time.time_step
    even = driven(HOLD, steps=60, last=np.floor(0.37 * grid) / grid)
    assert len(even.estimate_error().quantities) == 18
    for ours, theirs in zip(uneven.estimate_error().quantities, even.estimate_error().quantities, strict=True):
        assert (ours.quantity, ours.error) == (theirs.quantity, pytest.approx(theirs.error, rel=1e-9, abs=1e-12))
    moved = Session(uneven.scene, uneven.settings)
    moved.restore(uneven.snapshot())
    assert "a state was restored" in moved.estimate_error().remarks[0]
