"""The error stated for an FMU with reduced bodies is that of the forces which come out of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from fmu_build.checks import SETTING, Inputs, reduction_errors, reduction_note, with_inputs
from latin_fmu.cosim import Session, Settings
from latin_fmu.stability.scenes import half_sine
from tests.cosim.scenes import blocks

PULSE = 4e-6


def pressed(n_mode: int | None = None, **law: Any) -> Inputs:
    """The two blocks under a pulse that becomes an input, their bodies reduced or not."""
    load = blocks().tables()["load"]
    load = {"press": {**load["press"], "law": law or half_sine(PULSE)}}
    tables = blocks(load=load, time={"end": 8e-6, "step": 0.1e-6}).tables()
    if n_mode is not None:
        tables["solver"] = {**tables.get("solver", {}), "propagator": {"type": "reduced", "modes": n_mode}}
    return with_inputs(latin_fmu.scene_from_dict(tables), ["press"])


def forces(inputs: Inputs) -> tuple[np.ndarray, float]:
    """Normal force of a session driven by the pulse, and its time step."""
    session, h = Session(inputs.scene, Settings(keep=False)), inputs.scene.time.time_step
    session.initialize()
    rows = [session.value("interface.crush.normalForce")]
    for i in range(inputs.scene.time.n_step):
        now, then = inputs.laws["press"].sample(np.array([i * h, (i + 1) * h]))
        session.set_load("press", float(now), float(then - now) / h)
        assert session.step(i * h, h)
        rows.append(session.value("interface.crush.normalForce"))
    return np.array(rows), h


@pytest.mark.parametrize("n_mode", [2, 20])
def test_the_estimated_error_is_that_of_the_sessions(n_mode: int) -> None:
    errors = {e.quantity: e for e in reduction_errors(pressed(), pressed(n_mode))}
    (full, h), (reduced, _) = forces(pressed()), forces(pressed(n_mode))
    impulse = [float(np.trapezoid(force, dx=h)) for force in (full, reduced)]
    entry = errors["crush.impulse"]
    assert (entry.full, entry.reduced) == pytest.approx(impulse, rel=1e-3)
    assert entry.error == pytest.approx(abs(impulse[1] - impulse[0]) / impulse[0], rel=0.05, abs=1e-5)
    apart = abs(reduced.max() - full.max()) / full.max()  # of the raw peak; the error is that of a mean
    assert errors["crush.peak_force"].error == pytest.approx(apart, abs=0.5 * apart + 2e-3)
    for name in ("crush.first_contact", "crush.separation"):
        instant = errors[name]
        assert instant.unit == "s"
        assert abs(instant.reduced - instant.full) <= instant.error * max(instant.full, 8e-8) * (1 + 1e-9)


def test_more_modes_less_error() -> None:
    worst = [max(e.error for e in reduction_errors(pressed(), pressed(n))) for n in (1, 60)]
    assert worst[1] < 0.2 * worst[0]
    assert worst[0] > 1e-3


def test_without_a_load_no_error_is_told() -> None:
    still = {"type": "input", "start_value": 0.0}
    errors = reduction_errors(pressed(**still), pressed(4, **still))
    assert errors == []
    assert "no error is known" in reduction_note(4, errors)


def test_note_holds_the_numbers() -> None:
    errors = reduction_errors(pressed(), pressed(2))
    note = reduction_note(2, errors)
    assert "2 modes" in note
    assert all(f"<td>{e.quantity}</td>" in note and f"{e.reduced:.4g} {e.unit}" in note for e in errors)
    assert SETTING.format(7) == "solver.propagator={type='reduced',modes=7}"
