"""Coefficients of friction that change between communication steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu import Scene, scene_from_dict
from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import InputError
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.verification.test_modal_march import lap

from .scenes import blocks
from .test_modal_sessions import modal

FRICTION = "interface.crush.friction_coefficient"
DT = 0.2e-6
G = 9.81


def steps(session: Session, first: int, count: int, dt: float = DT) -> np.ndarray:
    """Rows (count, n_output) of steps of one time step."""
    rows = []
    for i in range(first, first + count):
        report = session.step(i * dt, dt)
        assert report, report.message
        rows.append(session.row.copy())
    return np.array(rows)


def pressed(scene: Scene, friction: float | None = None) -> np.ndarray:
    """Rows of thirty steps under a constant load, the friction set before the start."""
    session = Session(scene)
    session.set_load("press", 0.3)
    if friction is not None:
        session.parameters[FRICTION] = friction
    session.initialize()
    return np.vstack([session.row, steps(session, 0, 30)])


@pytest.mark.parametrize("behaviour", ["contact", "soft_contact"])
def test_friction_set_before_the_start_is_that_of_another_scene(behaviour: str) -> None:
    joint: dict[str, Any] = {"sides": ["upper.zmin", "lower.zmax"], "friction_coefficient": 0.2, "behaviour": behaviour}
    if behaviour == "soft_contact":
        joint["normal_stiffness"] = 1e14
    scene = blocks(interface={"crush": joint})
    assert dict(Session(scene).parameters) == {FRICTION: 0.2}
    other = pressed(scene.replace(FRICTION, 0.05))
    np.testing.assert_array_equal(pressed(scene, 0.05), other)
    np.testing.assert_array_equal(pressed(scene, 0.2), pressed(scene))
    assert np.abs(other - pressed(scene)).max() > 1e-3 * np.abs(other).max()


def sliding() -> Scene:
    """A rigid plate that slides on the ground by its weight."""
    data = column({"plate": Box(STEEL, (0.04, 0.04, 0.01), (1, 1, 1))}, {}, {"end": 0.1, "step": 1e-3})
    data["substructure"]["plate"] |= {"rigid": True, "initial_velocity": [2.0, 0.0, 0.0]}
    data["interface"] = {"table": {"sides": ["plate.zmin", "ground"], "friction_coefficient": 0.3}}
    data["gravity"] = {"acceleration": [0.0, 0.0, -G]}
    data["sensor"] = {"plate": {"substructure": "plate", "point": [0.02, 0.02, 0.005]}}
    return scene_from_dict(data)


def test_a_sliding_plate_decelerates_by_the_friction_of_now() -> None:
    """dv/dt = -mu g; over the first step with another coefficient the mean of both, as the trapezoid rule has it."""
    session = Session(sliding())
    session.initialize()
    speed, time, before = 2.0, 0.0, 0.3
    for friction, duration in ((0.3, 0.02), (0.6, 0.03), (0.0, 0.02), (0.1, 0.03)):
        session.parameters["interface.table.friction_coefficient"] = friction
        assert session.parameters["interface.table.friction_coefficient"] == friction
        assert session.step(time, duration)
        time, speed = time + duration, speed - G * (friction * (duration - 0.5e-3) + before * 0.5e-3)
        before = friction
        assert session.value("sensor.plate.velocity[1]") == pytest.approx(speed, rel=1e-6)


def test_a_state_has_the_friction_of_its_time() -> None:
    session = Session(blocks())
    session.set_load("press", 0.3)
    session.initialize()
    steps(session, 0, 10)
    state = session.snapshot()
    plain = steps(session, 10, 10)
    session.restore(state)
    session.parameters[FRICTION] = 0.01
    slippery = session.snapshot()
    changed = steps(session, 10, 10)
    assert np.abs(changed - plain).max() > 1e-3 * np.abs(plain).max()
    session.restore(state)
    assert session.parameters[FRICTION] == 0.2
    np.testing.assert_array_equal(steps(session, 10, 10), plain)
    # another session of the scene goes on from it alike
    other = Session(blocks())
    other.restore(slippery)
    assert other.parameters[FRICTION] == 0.01
    np.testing.assert_array_equal(steps(other, 10, 10), changed)
    # before the start, too
    other.reset()
    assert other.parameters[FRICTION] == 0.2
    for session in (other, Session(blocks())):
        session.parameters[FRICTION] = 0.1
        before = session.snapshot()
        session.parameters[FRICTION] = 0.4
        session.restore(before)
        assert session.parameters[FRICTION] == 0.1


@pytest.mark.parametrize(
    ("name", "value", "settings", "words"),
    [
        (
            "interface.crash.friction_coefficient",
            0.1,
            None,
            "no tunable parameter of this name; allowed: interface.crush",
        ),
        (FRICTION, -0.1, None, "must be a finite number, 0 or more"),
        (FRICTION, float("nan"), None, "must be a finite number, 0 or more"),
        (FRICTION, 0.1, Settings(keep=True), "kept with the numbers of the scene"),
    ],
)
def test_what_cannot_be_set_is_refused(name: str, value: float, settings: Settings | None, words: str) -> None:
    session = Session(blocks(), settings)
    session.initialize()
    with pytest.raises(InputError, match=words):
        session.parameters[name] = value
    assert session.parameters[FRICTION] == 0.2
    assert session.step(0.0, DT)


def test_friction_of_a_law_in_python_is_fixed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has its own number, which no kernel reads: a value that had no effect would be taken for one that has."""
    monkeypatch.setattr("latin_fmu.latin.run_image.law_of", lambda _: -1)
    session = Session(blocks())
    session.initialize()
    with pytest.raises(InputError, match="it is fixed at"):
        session.parameters[FRICTION] = 0.1
    assert session.step(0.0, DT)


def test_bodies_without_friction_have_no_such_parameter() -> None:
    joint = {"sides": ["upper.zmin", "lower.zmax"]}
    assert not Session(blocks(interface={"crush": joint})).parameters
    # a number of the scene, which hosts set before the start
    assert not Session(blocks(fmu={"parameters": [FRICTION]})).parameters


def test_an_assembly_marched_by_its_modes_has_them_too() -> None:
    """The shaken lap joint from rest: bits of the scene with this friction, whenever the same one is set."""
    rows = {}
    for written, tuned, at in ((0.3, None, 0), (0.3, 0.3, 20), (0.1, None, 0), (0.3, 0.1, 0), (0.3, 0.1, 20)):
        tables = modal(lap({"friction_coefficient": written}))
        del tables["time"]["start"]
        scene = scene_from_dict(tables)
        assert scene.solver.propagator.type == "modal"
        session, dt = Session(scene), scene.time.time_step
        (name,) = session.parameters
        if tuned is not None and at == 0:
            session.parameters[name] = tuned
        session.initialize()
        before = steps(session, 0, at or 20, dt)
        if tuned is not None and at > 0:
            session.parameters[name] = tuned
        rows[written, tuned, at] = np.vstack([before, steps(session, len(before), 60, dt)])
    np.testing.assert_array_equal(rows[0.3, 0.3, 20], rows[0.3, None, 0])
    np.testing.assert_array_equal(rows[0.3, 0.1, 0], rows[0.1, None, 0])
    np.testing.assert_array_equal(rows[0.3, 0.1, 20][:20], rows[0.3, None, 0][:20])
    moved = np.abs(rows[0.3, None, 0]).max(axis=0)
    assert (np.abs(rows[0.3, 0.1, 20] - rows[0.3, None, 0])[20:].max(axis=0) > 1e-3 * moved).any()
    assert (np.abs(rows[0.3, 0.1, 20] - rows[0.1, None, 0]).max(axis=0) > 1e-3 * moved).any()
