"""Faces and ground driven from outside: the wave in a bar is that of the closed form, in both modes and in FMUs."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import Material, bar, column

SPEED, IMPEDANCE = 30.0, 30.0  # m/s; Pa s/m, on 1 m2: E = 900 Pa, 1 kg/m3, no lateral strain
GROWTH, END, STEP = 10.0, 0.3, 0.005  # m/s2 of the driven face, s, s
FACE = {"face": "upper.zmax", "components": ["z"]}


def bars(law: Any, kind: str = "velocity", wall: Mapping[str, Any] = MappingProxyType({}), **changes: Any) -> Scene:
    """Two bars of 5 m bonded end to end, the upper end driven down, the lower end without reflection.

    The ground moves up against the lower end instead, where ``kind`` is ``ground``; ``wall`` : keys of that interface.
    Then the iteration is not accelerated, which would amplify the round-off that two drivers differ by.
    """
    part = bar(Material(900.0), 5.0, 25)
    data = column(
        {"lower": part, "upper": part},
        {"joint": {"behaviour": "perfect"}},
        {"end": END, "step": STEP},
        name="driven",
        boundary={"far": {"type": "absorbing", "face": "lower.zmin"}},
        solver={"tolerance": 1e-6},
    )
    if kind == "ground":
        data["boundary"] = {"far": {"type": "absorbing", "face": "upper.zmax"}}
        moving = {"direction": [0.0, 0.0, 1.0], "amplitude": 2.0, "law": law}
        data["solver"]["acceleration"] = "none"
        data["interface"]["wall"] = {"sides": ["lower.zmin", "ground"], "ground_velocity": moving, **wall}
    else:
        data["boundary"]["end"] = {"type": kind, **FACE, "value": [-2.0], "law": law}
    return latin_fmu.scene_from_dict(data | changes)


def closed_form(t: np.ndarray) -> np.ndarray:
    """Compressive force in the middle, N: rho c v of the driven end, 5 m away."""
    return IMPEDANCE * GROWTH * np.maximum(t - 5.0 / SPEED, 0.0)


def amplitude(kind: str, t: Any) -> Any:
    """Amplitude of a motion of value 2 whose velocity grows by ``GROWTH``."""
    return 0.5 * GROWTH * t if kind != "displacement" else 0.25 * GROWTH * t**2


KINDS = ("velocity", "displacement", "ground")


def name_of(kind: str) -> str:
    return "ground.wall" if kind == "ground" else "boundary.end"


def windowed(kind: str, session: Any, h: float, end: float = END) -> tuple[np.ndarray, np.ndarray]:
    """Communication points and forces; the amplitude is linear in every step."""
    name, forces, times = name_of(kind), [], []
    for i in range(round(end / h)):
        t = i * h
        rate = (amplitude(kind, t + h) - amplitude(kind, t)) / h
        session.set_load(name, float(amplitude(kind, t)), float(rate))
        if i == 0 and hasattr(session, "initialize"):
            session.initialize()
        assert session.step(t, h)
        times.append(t + h)
        forces.append(session.value("interface.joint.normalForce"))
    return np.array(times), np.array(forces)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("instants", [1, 4])
def test_windowed(kind, instants):
    session = Session(bars({"type": "input"}, kind), Settings(keep=False))
    times, forces = windowed(kind, session, instants * STEP)
    assert forces == pytest.approx(closed_form(times), abs=0.04 * closed_form(END))
    assert forces[-1] == pytest.approx(closed_form(END), rel=0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_a_state_taken_right_after_a_restored_one_is_the_same(kind):
    """No step is made between: the motion goes on from where the state has it, not from the steps made since."""
    session = Session(bars({"type": "input"}, kind), Settings(keep=False))
    windowed(kind, session, STEP, 5 * STEP)
    state, row = session.snapshot(), []
    for again in (False, True):
        session.restore(session.snapshot() if again else state)
        for i in range(5, 9):
            session.set_load(name_of(kind), float(amplitude(kind, i * STEP)), GROWTH)
            assert session.step(i * STEP, STEP)
        row.append(session.row)
        session.restore(state)
    assert (row[0] == row[1]).all()


@pytest.mark.parametrize("kind", KINDS)
def test_prescribed_is_the_run_with_a_table(kind):
    t = np.linspace(0.0, END, round(END / STEP) + 1)
    table = {"type": "table", "times": t.tolist(), "values": amplitude(kind, t).tolist()}
    exact = {"solver": {"tolerance": 1e-10}}
    session = Session(bars({"type": "input"}, kind, **exact), Settings(mode=1))
    session.set_history(name_of(kind), t, amplitude(kind, t))
    session.initialize()
    assert session.step(0.0, END)
    plain = latin_fmu.solve(bars(table, kind, **exact)).outcome.interfaces["joint"].normal_resultant()
    _, interfaces = session.window()
    # the table ends with the run: the last velocity of a displacement is one-sided there, a history goes on as constant
    assert interfaces["joint"].normal_resultant()[:-1] == pytest.approx(plain[:-1], abs=1e-6 * np.abs(plain).max())
    assert plain[-2] == pytest.approx(closed_form(END - STEP), rel=0.03)


def test_a_displacement_starts_where_it_is_set():
    """The start value of the scene gives way to that of the host; the equilibrium with it is where the run starts."""
    time = {"end": END, "step": STEP, "start": "static"}
    sensor = {"end": {"face": "upper.zmax"}}
    scene = bars({"type": "input", "start_value": 0.25}, "displacement", time=time, sensor=sensor)
    session = Session(scene, Settings(keep=False))
    for value in (0.25, 0.5):
        session.reset()
        session.set_load("boundary.end", value)
        session.initialize()
        assert session.value("sensor.end.displacement[3]") == pytest.approx(-2.0 * value)


def test_equilibrium_follows_a_driven_face():
    """Without inertia: a bar of 10 m between a held end and a face pushed by 0.1 m carries E / 100 on 1 m2."""
    held = {"type": "fixed", "face": "lower.zmin"}
    for kind, value in (("displacement", 0.05), ("velocity", 0.05 / END)):
        driven = {"type": kind, **FACE, "value": [-2.0], "law": {"type": "input"}}
        scene = bars(
            "input", time={"end": END, "step": STEP, "quasi_static": True}, boundary={"a": held, "end": driven}
        )
        session = Session(scene, Settings(keep=False))
        session.initialize()
        for i in range(10):
            h = END / 10
            if kind == "displacement":
                session.set_load("boundary.end", value * i / 10, value / END)
            else:
                session.set_load("boundary.end", value)
            assert session.step(i * h, h)
        # a velocity that jumps at the start takes its first time step: half of its way is missing
        way = 0.1 if kind == "displacement" else 0.1 * (1.0 - 0.5 * STEP / END)
        assert session.value("interface.joint.normalForce") == pytest.approx(900.0 * way / 10.0, rel=1e-3)
