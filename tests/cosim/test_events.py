"""Contact events against closed forms, over steps of any length, rollback and early ends of steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.variables import PRESCRIBED
from latin_fmu.kernels.inputs import N_MEMORY, REACHED
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import Box, Material, column, rubbing
from tests.scenes import given_motion

from .scenes import bar, blocks

NAMES = ("touches", "lastTouch", "separations", "lastSeparation", "slips", "lastSlip")
EDGE, DENSITY, FRICTION = 0.1, 1000.0, 0.4
WEIGHT, MASS = 50.0, DENSITY * EDGE**3  # N, kg
AREA = EDGE**2


def events(session: Session, interface: str = "floor") -> dict[str, float]:
    """Outputs of the events of an interface."""
    return dict(zip(NAMES, session.values([f"interface.{interface}.{name}" for name in NAMES]), strict=True))


def ramp(first: float, last: float, end: float) -> dict[str, Any]:
    return {"type": "table", "times": [0.0, end], "values": [first, last]}


def block(end: float, step: float, gap: float = 0.0, **changes: Any) -> Scene:
    """A rigid block on the ground, or above it, where a layer says how it rebounds."""
    body = Box(Material(1e9, DENSITY), (EDGE,) * 3, (1, 1, 1), keys={"rigid": True})
    floor = rubbing("block.zmin", "ground", FRICTION) | {"gap": gap}
    if gap > 0.0 and changes.get("body", {}).get("rigid", True):
        floor |= {"behaviour": "soft_contact", "normal_stiffness": 1e6}
    time, solver = {"end": end, "step": step}, {"tolerance": 1e-8}
    data = column({"block": body}, {}, time, interface={"floor": floor}, solver=solver)
    data["substructure"]["block"] |= changes.pop("body", {})
    data["substructure"]["block"]["box"]["origin"][2] = gap
    return latin_fmu.scene_from_dict(data | changes)


def marched(scene: Scene, steps: int = 1, **settings: Any) -> Session:
    """A session at the end of the scene, in equal steps."""
    session, h = Session(scene, Settings(keep=False, **settings)), scene.time.end / steps
    session.initialize()
    for i in range(steps):
        report = session.step(i * h, h)
        assert report, report.message
    return session


# -- closed forms -------------------------------------------------------------------------------------------------
def test_a_block_in_flight_touches_at_gap_over_speed() -> None:
    seen = events(marched(block(0.034, 1e-3, gap=0.0337, body={"initial_velocity": [0.0, 0.0, -1.0]})))
    assert seen["touches"] == 1.0
    assert seen["lastTouch"] == pytest.approx(0.0337, rel=1e-9)


@pytest.mark.parametrize("step", [4e-3, 2e-3, 1e-3, 0.5e-3])
def test_a_falling_block_touches_to_second_order(step) -> None:
    """gap = v t + a t^2 / 2; limit of the error a step^2 / v, twice what the line leaves over."""
    gap, speed, acceleration = 0.0337, 0.5, 9.81
    touch = (np.sqrt(speed**2 + 2.0 * acceleration * gap) - speed) / acceleration
    falling = {"body": {"initial_velocity": [0.0, 0.0, -speed]}, "gravity": {"acceleration": [0.0, 0.0, -acceleration]}}
    end = step * np.ceil(touch / step)
    session = marched(block(end, step, gap, **falling))
    assert session.value("interface.floor.touches") == 1.0
    assert abs(session.value("interface.floor.lastTouch") - touch) <= acceleration * step**2 / speed


def pushed(step: float, end: float = 1.0) -> Scene:
    """The block under its weight, pushed by a force that grows by 32 N/s: it slips at 20 N."""
    weight = {"face": "block.zmax", "pressure": WEIGHT / AREA}
    push = {"face": "block.xmin", "traction": [32.0 / AREA, 0.0, 0.0], "law": ramp(0.0, 1.0, 1.0)}
    return block(end, step, load={"weight": weight, "push": push})


@pytest.mark.parametrize("step", [0.04, 0.017])
def test_a_block_slips_where_the_push_reaches_friction(step) -> None:
    end = step * np.ceil(0.66 / step)
    seen = events(marched(pushed(step, end)))
    assert seen["slips"] == 1.0
    assert seen["lastSlip"] == pytest.approx(FRICTION * WEIGHT / 32.0, rel=1e-6)
    assert seen["separations"] == 0.0


def test_a_block_that_is_pulled_off_separates_where_its_force_ends() -> None:
    press = {"face": "block.zmax", "pressure": WEIGHT / AREA, "law": ramp(1.0, -0.6, 1.0)}
    seen = events(marched(block(0.68, 0.04, load={"press": press})))
    assert seen["separations"] == 1.0
    assert seen["lastSeparation"] == pytest.approx(1.0 / 1.6, rel=1e-6)


@pytest.mark.parametrize("steps", [1, 32])
def test_a_face_driven_without_inertia_touches_where_its_way_is_the_gap(steps) -> None:
    """The rates of equilibria are those over the steps: 2.5 gaps in the time 1."""
    gap = 1e-4
    boundary = {
        "top": given_motion("block.zmax", [-2.5 * gap], ramp(0.0, 1.0, 1.0), "z", kind="displacement"),
        "side": {"type": "fixed", "face": "block.zmax", "components": ["x", "y"]},
    }
    time = {"end": 1.0, "step": 0.03125, "quasi_static": True}
    scene = block(1.0, 0.03125, gap, body={"rigid": False}, boundary=boundary, time=time)
    seen = events(marched(scene, steps))
    assert seen["touches"] == 1.0
    assert seen["lastTouch"] == pytest.approx(0.4, rel=1e-9)


# -- steps, rollback, modes ---------------------------------------------------------------------------------------
def thrown() -> Scene:
    """A soft bar thrown at a wall, which it leaves after two transits."""
    return bar()


def slid() -> Scene:
    return pushed(0.04, 0.8)


@pytest.mark.parametrize("make", [thrown, slid])
def test_events_do_not_depend_on_the_communication_step(make) -> None:
    scene = make()
    name, n = next(iter(scene.joints)), scene.time.n_step
    whole = events(marched(scene), name)
    assert any(whole.values())
    for steps in (n, n // 5):
        assert events(marched(scene, steps), name) == pytest.approx(whole, rel=1e-6)
    played = marched(scene, n, mode=PRESCRIBED)
    assert events(played, name) == pytest.approx(whole, rel=1e-6)


def test_a_prescribed_run_shows_an_event_from_its_instant_on() -> None:
    """Between two instants a counter is no fraction, and an instant no mean of two."""
    session = Session(thrown(), Settings(mode=PRESCRIBED))
    session.initialize(3.0)
    for t, count in ((0.0, 0.0), (0.045, 0.0), (0.052, 1.0)):
        if t > 0.0:
            assert session.step(session.time, 3.0 + t - session.time)
        assert session.value("interface.wall.touches") == count
    assert session.value("interface.wall.lastTouch") == pytest.approx(3.05)


def test_a_step_taken_back_takes_its_events_back() -> None:
    straight, other = Session(thrown()), Session(thrown())
    for session in (straight, other):
        session.initialize()
        assert session.step(0.0, 0.04)
    saved = other.snapshot()
    assert other.step(0.04, 0.2)
    assert events(other, "wall")["touches"] == 1.0
    other.restore(saved)
    assert events(other, "wall")["touches"] == 0.0
    third = Session(thrown())
    third.restore(saved, check=True)
    for session in (straight, other, third):
        for i in range(2, 50):
            assert session.step(i * 0.02, 0.02)
    assert straight.snapshot() == other.snapshot() == third.snapshot()
    assert events(third, "wall")["separations"] == 1.0


def test_instants_are_those_of_the_simulation() -> None:
    late = Session(thrown())
    late.initialize(7.0)
    assert late.step(7.0, 0.1)
    assert events(late, "wall")["lastTouch"] == pytest.approx(7.05)


# -- early ends ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("mode", [0, PRESCRIBED])
def test_a_step_ends_early_after_an_event(mode) -> None:
    """It ends with the time step of the event, and the run goes on as if it had been cut there."""
    early, plain = (Session(thrown(), Settings(mode=mode)) for _ in range(2))
    early.initialize()
    plain.initialize()
    ends, t = [], 0.0
    while t < 1.0 - 1e-9:
        report = early.step(t, min(0.3, 1.0 - t), early=True)
        assert report
        ends += [report.early]
        t = early.time
    assert [e for e in ends if e is not None] == pytest.approx([0.06, 0.74])
    assert events(early, "wall")["lastTouch"] == pytest.approx(0.05)
    for i in range(50):
        assert plain.step(i * 0.02, 0.02)
    skip = [i for i, name in enumerate(plain.outputs) if not name.startswith("solver.")]
    assert early.row[skip] == pytest.approx(plain.row[skip], rel=1e-6, abs=1e-9)


def test_an_early_end_keeps_the_loads_of_the_part_that_was_made() -> None:
    session = Session(blocks(), Settings(keep=True))
    session.set_load("press", 0.5, 2e5)
    session.initialize()
    report = session.step(0.0, 1e-6, early=True)
    assert report.early == pytest.approx(0.2e-6)
    step = session.step_history.head.step
    assert (step.end, step.rate["press"]) == (report.early, 2e5)
    run = session._solver.run
    assert run is not None
    assert run.image.field("inputs", N_MEMORY, 1)[REACHED, 0] == pytest.approx(0.5 + 0.2e-6 * 2e5)
    assert session.time == session.window()[0][-1] == report.early
