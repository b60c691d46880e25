"""Ports: forces, motions and waves on faces, against closed forms, and two cut halves against the whole bar.

Limits are set before the runs: 2 % of a wave reflected by its own impedance (linear elements, 25 a pulse), 1 % of the
velocity or force of a wave in a bar (5 % in an explicit march, whose sampled force is a step early), 1e-9 in statics,
1e-6 for an exact delay, 1e-8 for an iterated cut, 25 % for a cut that delays by a step.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.variables import HOLD, RATE
from latin_fmu.cosim.waveform_relaxation import Coupling, Side, WaveformMaster
from latin_fmu.stability.scenes import Box, Material, column

from .segments import GridPart, Loads

E, RHO, SIDE, EDGE = 200e9, 8000.0, 0.01, 0.01
C, AREA = np.sqrt(E / RHO), SIDE**2
Z = RHO * C * AREA
PULSE = {"type": "half_sine", "duration": 25 * EDGE / C}
FORCE = 1000.0
CUT = "port.cut.incident[3]", "port.cut.reflected[3]"


def bar(n: int, steps: int, dt: float = 0.5 * EDGE / C, propagator: str = "direct", **tables: Any) -> latin_fmu.Scene:
    """A bar of n elements along z, one-dimensional, without supports along z."""
    steel, keys = Material(E, RHO, name="steel"), {"bending_modes": propagator != "explicit"}
    data = column(
        {"bar": Box(steel, (SIDE, SIDE, n * EDGE), (1, 1, n), keys=keys)},
        {},
        {"end": steps * dt, "step": dt},
        name="bar",
        boundary={k: {"type": "fixed", "face": f"bar.{k}", "components": ["x", "y"]} for k in ("xmin", "xmax")},
        solver={"propagator": propagator},
    )
    return latin_fmu.scene_from_dict(data | tables)


def smooth(t: float) -> float:
    """A pulse between 0 and 1 that starts without a kink."""
    return float(np.sin(np.pi * min(t / PULSE["duration"], 1.0)) ** 2)


def marched(session: Session, steps: int, names: list[str], give: Any = None) -> np.ndarray:
    """Outputs (steps + 1, n) of a session that makes steps of one time step; ``give`` sets inputs at the time t."""
    dt = session.scene.time.time_step
    if give:
        give(session, 0.0)
    session.initialize()
    rows = [session.values(names)]
    for i in range(steps):
        if give:
            give(session, i * dt)
        report = session.step(i * dt, dt)
        assert report, report.message
        rows.append(session.values(names))
    return np.array(rows)


@pytest.mark.parametrize(("propagator", "limit"), [("direct", 0.01), ("reduced", 0.01), ("explicit", 0.05)])
def test_a_force_launches_its_wave(propagator, limit):
    """Velocity of the end F / (rho c A), its displacement the integral, before the wave returns."""
    n, steps = 40, 60
    port = {"foot": {"face": "bar.zmax", "components": ["z"]}}
    scene = bar(n, steps, propagator=propagator, port=port)
    dt = scene.time.time_step

    def give(session: Session, t: float) -> None:
        session.set_load("port.foot.force[3]", FORCE * smooth(t), FORCE * (smooth(t + dt) - smooth(t)) / dt)

    names = ["port.foot.velocity[3]", "port.foot.displacement[3]"]
    got = marched(Session(scene), steps, names, give)
    shape = np.array([smooth(i * dt) for i in range(steps + 1)])
    velocity = FORCE / Z * shape
    path = np.concatenate([[0.0], np.cumsum(0.5 * dt * (velocity[1:] + velocity[:-1]))])
    assert np.abs(got[:, 0] - velocity).max() <= limit * velocity.max()
    assert np.abs(got[:, 1] - path).max() <= limit * path.max()
    # the same as a law of the scene, which then is no input
    law = {"type": "table", "times": (dt * np.arange(steps + 1)).tolist(), "values": (FORCE * shape).tolist()}
    own = Session(bar(n, steps, propagator=propagator, port={"foot": {**port["foot"], "laws": {"z": law}}}))
    assert own.loads == ()
    assert np.abs(marched(own, steps, names) - got).max() <= 1e-9 * np.abs(got).max()


@pytest.mark.parametrize(("propagator", "limit"), [("direct", 0.01), ("reduced", 0.01), ("explicit", 0.05)])
def test_a_moved_face_exerts_the_force_of_its_wave(propagator, limit):
    """Force - rho c A v on what moves the face, a sine whose velocity starts at zero."""
    n, steps = 40, 60
    port = {"foot": {"face": "bar.zmax", "causality": "motion_in", "components": ["z"]}}
    scene, speed = bar(n, steps, propagator=propagator, port=port), 0.25
    dt = scene.time.time_step

    def give(session: Session, t: float) -> None:
        session.set_load("port.foot.velocity[3]", speed * smooth(t), speed * (smooth(t + dt) - smooth(t)) / dt)

    force = marched(Session(scene), steps, ["port.foot.force[3]"], give)[:, 0]
    wanted = -Z * speed * np.array([smooth(i * dt) for i in range(steps + 1)])
    assert np.abs(force - wanted).max() <= limit * np.abs(wanted).max()


@pytest.mark.parametrize("propagator", ["direct", "reduced", "explicit"])
def test_a_wave_port_of_the_impedance_of_the_bar_absorbs(propagator):
    """A pulse from the free end leaves through the other one; force -p A and velocity p / (rho c) pass there."""
    n, pressure = 50, 1e7
    steps = round(3 * n / 0.5)
    port = {"cut": {"face": "bar.zmax", "causality": "wave", "components": ["z"], "impedance": [Z]}}
    load = {"p": {"face": "bar.zmin", "pressure": pressure, "law": PULSE}}
    sensor = {"free": {"face": "bar.zmin"}}
    output = {"energy": True}
    session = Session(bar(n, steps, propagator=propagator, port=port, load=load, sensor=sensor, output=output))
    names = ["sensor.free.velocity[3]", "port.cut.velocity[3]", "port.cut.force[3]", CUT[1], "energy.balance"]
    free, velocity, force, reflected, balance = marched(session, steps, names).T
    peak = pressure / (RHO * C)
    assert np.abs(free[round(n / 0.5) + 60 :]).max() <= 0.02 * peak
    assert velocity.max() == pytest.approx(peak, rel=0.02)
    assert force.min() == pytest.approx(-pressure * AREA, rel=0.02)
    assert np.allclose(reflected, Z * velocity - force, rtol=0, atol=1e-9 * pressure * AREA)
    assert np.abs(balance).max() <= 1e-6 * pressure * AREA * peak * PULSE["duration"]


def quasi_static(**port: Any) -> Session:
    """A cantilever along z, held at zmin, with a port of six components at zmax."""
    six = ["x", "y", "z", "rx", "ry", "rz"]
    scene = bar(
        20,
        10,
        boundary={"wall": {"type": "fixed", "face": "bar.zmin"}},
        port={"tip": {"face": "bar.zmax", "components": six, **port}},
        time={"end": 1.0, "instants": 10, "quasi_static": True},
        solver={},
    )
    return Session(scene)


def test_forces_and_moments_bend_and_stretch_a_cantilever():
    """Tip rotation L / EI (M - F L / 2), deflection - M L^2 / 2 EI + F L^3 / 3 EI, stretch F L / EA."""
    session, length, stiffness = quasi_static(), 20 * EDGE, E * SIDE**4 / 12
    for name, value in (("force[2]", 3.0), ("force[3]", 50.0), ("moment[1]", 0.7)):
        session.set_load(f"port.tip.{name}", value)
    session.initialize()
    assert session.step(0.0, 0.1)
    got = session.values([f"port.tip.{n}" for n in ("rotation[1]", "displacement[2]", "displacement[3]")])
    turned = (0.7 * length - 3.0 * length**2 / 2) / stiffness
    deflected = -0.7 * length**2 / (2 * stiffness) + 3.0 * length**3 / (3 * stiffness)
    assert got == pytest.approx([turned, deflected, 50.0 * length / (E * AREA)], rel=2e-3)


def test_motions_and_forces_are_inverse_to_each_other():
    """What a moved face exerts, with the other sign as the load of a free one, moves it back to the same place."""
    driven = quasi_static(causality="motion_in")
    speeds = dict(zip(driven.loads, (1e-6, -2e-6, 3e-7, 4e-5, 2e-5, -3e-5), strict=True))
    for name, speed in speeds.items():
        driven.set_load(name, 0.0, speed)  # from rest: the way over the interval is half of speed x time
    driven.initialize()
    assert driven.step(0.0, 1.0)
    loaded = quasi_static()
    for name, source in zip(loaded.loads, driven.loads, strict=True):
        words = source.replace("angularVelocity", "moment").replace("velocity", "force")
        loaded.set_load(name, -driven.value(words))
    loaded.initialize()
    assert loaded.step(0.0, 1.0)
    names = [n.replace("angularVelocity", "rotation").replace("velocity", "displacement") for n in driven.loads]
    # a load that is not uniform strains the face, a moved face is rigid: equal mean motions to 1 %
    assert loaded.values(names) == pytest.approx([0.5 * s for s in speeds.values()], rel=1e-2)


def test_a_rigid_body_moves_by_force_and_moment():
    """Velocity F t / m and angular velocity M t / J of a cube pushed at a face, the force at the centre of the face."""
    data = bar(1, 10).tables()
    data["substructure"]["bar"] |= {"rigid": True, "bending_modes": False}
    port = {"foot": {"face": "bar.zmax", "components": ["x", "z", "ry"]}}
    session = Session(latin_fmu.scene_from_dict({**data, "boundary": {}, "port": port}))
    force, mass = {"force[1]": 0.0, "force[3]": 5.0, "moment[2]": 0.02}, RHO * SIDE**3
    session.initialize()
    for i in range(10):
        for name, value in force.items():
            session.set_load(f"port.foot.{name}", value)
        assert session.step(i * session.scene.time.time_step, session.scene.time.time_step)
    t = session.time
    inertia = mass * SIDE**2 / 6
    assert session.value("port.foot.velocity[3]") == pytest.approx(5.0 * t / mass, rel=1e-9)
    assert session.value("port.foot.angularVelocity[2]") == pytest.approx(0.02 * t / inertia, rel=1e-2)


# -- cut bars ---------------------------------------------------------------------------------------------------------
def halves(first: int, second: int, steps: int, rule: int = RATE, **more: Any) -> list[Session]:
    """Two bars that end at the cut; the first one is loaded at its free end."""
    made = []
    for n, face, tables in ((first, "bar.zmax", {"load": PUSH}), (second, "bar.zmin", {})):
        port = {"cut": {"face": face, "causality": "wave", "components": ["z"], "impedance": [Z]}}
        made.append(Session(bar(n, steps, port=port, **tables, **more), Settings(interpolation=rule, keep=False)))
    return made


PUSH = {"p": {"face": "bar.zmin", "pressure": 1e7, "law": {"type": "half_sine", "duration": 8 * EDGE / C}}}


def exchanged(pair: list[Session], i: int, h: float) -> None:
    """One communication step without rollback: every side gets what the other one has sent."""
    for session, sent in zip(pair, [s.value(CUT[1]) for s in pair][::-1], strict=True):
        session.set_load(CUT[0], sent)
    for session in pair:
        report = session.step(i * h, h)
        assert report, report.message


def test_a_strip_of_one_step_is_the_delay_of_the_waves():
    """Two bars without rollback are one bar with a strip of length c H between them: central differences at the step
    h / c are exact, so that both are equal to round-off."""
    steps, dt = 60, EDGE / C
    more = {"dt": dt, "propagator": "explicit"}
    pair = halves(7, 6, steps, **more)
    ends = {
        "a": {"substructure": "bar", "point": [0, 0, 7 * EDGE]},
        "b": {"substructure": "bar", "point": [0, 0, 8 * EDGE]},
    }
    whole = Session(bar(14, steps, load=PUSH, sensor=ends, **more))
    wanted = marched(whole, steps, [f"sensor.{name}.velocity[3]" for name in "ab"])
    got = [[0.0, 0.0]]
    for session in pair:
        session.initialize()
    for i in range(steps):
        exchanged(pair, i, dt)
        got.append([session.value("port.cut.velocity[3]") for session in pair])
    assert np.abs(wanted).max() > 0.1
    assert np.abs(np.array(got) - wanted).max() <= 1e-6 * np.abs(wanted).max()


def iterated(pair: list[Session], i: int, h: float, before: list[float]) -> list[float]:
    """One step with rollback: the waves at its end are iterated until both sides agree."""
    states, new = [s.snapshot() for s in pair], before
    for _ in range(60):
        for session, state, old, sent in zip(pair, states, before, new, strict=True):
            session.restore(state)
            session.set_load(CUT[0], old, (sent - old) / h)
            assert session.step(i * h, h)
        sent = [s.value(CUT[1]) for s in pair][::-1]
        if np.abs(np.subtract(sent, new)).max() <= 1e-10 * 1e7 * AREA:
            return new
        new = sent
    raise AssertionError("the waves do not converge")


def test_iterated_waves_are_one_run():
    steps = 60
    pair = halves(8, 7, steps)
    whole = Session(bar(15, steps, load=PUSH, sensor={"cut": {"substructure": "bar", "point": [0, 0, 8 * EDGE]}}))
    wanted = marched(whole, steps, ["sensor.cut.velocity[3]"])[:, 0]
    waves, got = [0.0, 0.0], [[0.0, 0.0]]
    for session in pair:
        session.initialize()
    for i in range(steps):
        waves = iterated(pair, i, whole.scene.time.time_step, waves)
        got.append([session.value("port.cut.velocity[3]") for session in pair])
    assert pair[0].value("port.cut.force[3]") == pytest.approx(-pair[1].value("port.cut.force[3]"), abs=1e-8 * 1e3)
    assert np.abs(np.array(got) - wanted[:, None]).max() <= 1e-8 * np.abs(wanted).max()


def test_iterated_forces_are_one_run():
    """The master of the package over ports with forces as inputs: velocities that agree at the end of every step."""
    steps, port = 40, {"components": ["z"]}
    first = bar(8, steps, port={"cut": {"face": "bar.zmax", **port}}, load=PUSH)
    scenes = {"a": first, "b": bar(7, steps, port={"cut": {"face": "bar.zmin", **port}})}
    peers = {name: Session(scene, Settings(interpolation=RATE)) for name, scene in scenes.items()}
    whole = Session(bar(15, steps, load=PUSH, sensor={"cut": {"substructure": "bar", "point": [0, 0, 8 * EDGE]}}))
    wanted = marched(whole, steps, ["sensor.cut.velocity[3]"])[:, 0]
    for peer in peers.values():
        peer.initialize()
    sides = [Side(name, "port.cut.force[3]", "port.cut.velocity[3]", Z) for name in peers]
    master, dt, got = WaveformMaster(peers, [Coupling(*sides)], tolerance=1e-11), whole.scene.time.time_step, [0.0]
    for i in range(steps):
        master.step(i * dt, dt)
        got.append(peers["a"].value("port.cut.velocity[3]"))
    assert np.abs(np.array(got) - wanted).max() <= 1e-8 * np.abs(wanted).max()


def test_a_rigid_body_on_a_wave_port():
    """A constant incident wave I on a mass m: velocity I / Z (1 - exp(-Z t / m)), to second order in the step."""
    data, dt = bar(1, 40, dt=2e-7).tables(), 2e-7  # a tenth of m / Z
    data["substructure"]["bar"] |= {"rigid": True, "bending_modes": False}
    port = {"foot": {"face": "bar.zmax", "causality": "wave", "components": ["z"], "impedance": [Z]}}
    session, mass = Session(latin_fmu.scene_from_dict({**data, "boundary": {}, "port": port})), RHO * SIDE**3
    got = marched(session, 40, ["port.foot.velocity[3]"], lambda s, _: s.set_load("port.foot.incident[3]", 100.0))[:, 0]
    wanted = 100.0 / Z * (1.0 - np.exp(-Z * dt * np.arange(41) / mass))
    assert np.abs(got - wanted).max() <= 0.02 * wanted.max()


@pytest.mark.parametrize("propagator", ["direct", "explicit"])
@pytest.mark.parametrize("parts", [1, 5])
def test_waves_without_rollback_are_bounded(propagator, parts):
    """The energy of free bars does not grow; held waves would gain some in every step."""
    pair = halves(4, 3, 2000, propagator=propagator)
    force = []
    for session in pair:
        session.initialize()
    for i in range(400):
        exchanged(pair, i, parts * pair[0].scene.time.time_step)
        force.append(abs(pair[0].value("port.cut.force[3]")))
    assert 0.1 * 1e7 * AREA < max(force) <= 2 * 1e7 * AREA
    assert max(force[200:]) <= 1.01 * max(force[:200])


def test_held_waves_gain_energy():
    """Why a wave without a rate is a straight line: the same bars with held waves and five time steps a step."""
    pair, force = halves(4, 3, 4000, rule=HOLD), []
    for session in pair:
        session.initialize()
    for i in range(500):
        exchanged(pair, i, 5 * pair[0].scene.time.time_step)
        force.append(abs(pair[0].value("port.cut.force[3]")))
    assert max(force[400:]) > 10 * max(force[:100])


# -- states, modes, messages ------------------------------------------------------------------------------------------
PORTS = {
    "foot": {"face": "bar.zmax", "components": ["z", "ry"]},
    "side": {"face": "bar.ymin", "causality": "wave", "components": ["y", "rx"], "impedance": [40.0, 0.01]},
    "hand": {"face": "bar.zmin", "causality": "motion_in", "components": ["x", "y", "z", "rz"]},
}
GIVEN = {
    "port.foot.force[3]": 70.0,
    "port.foot.moment[2]": 0.3,
    "port.side.incident[2]": 9.0,
    "port.hand.velocity[1]": 0.1,
}


def test_states_roll_back_to_the_last_bit():
    session = Session(bar(4, 20, port=PORTS, boundary={}, output={"energy": True}), Settings(keep=True))
    session.initialize()
    dt = session.scene.time.time_step

    def ahead() -> np.ndarray:
        for i in range(5, 10):
            for name, value in GIVEN.items():
                session.set_load(name, value * (i - 4), value / dt)
            assert session.step(i * dt, dt)
        return session.row.copy()

    for i in range(5):
        assert session.step(i * dt, dt)
    state = session.snapshot()
    first = ahead()
    session.restore(state)
    assert np.array_equal(first, ahead())
    assert np.abs(first[: 6 * len(PORTS)]).max() > 0.0
    tree = session.dataset()
    assert {"port_foot_force_3", "port_foot_velocity", "port_hand_force"} <= set(tree["exchange"].data_vars)


def test_derivatives_by_inputs_of_ports():
    """A step repeated with another input, by rollback, against the directional derivatives: the bar is linear."""
    session = Session(bar(4, 20, port=PORTS, boundary={}, solver={"window": 1}))
    session.initialize()
    dt, names = session.scene.time.time_step, [n for n in session.outputs if n.startswith("port.")]
    state = session.snapshot()

    def stepped(name: str, change: float) -> np.ndarray:
        session.restore(state)
        for given, value in GIVEN.items():
            session.set_load(given, value + change * (given == name))
        assert session.step(0.0, 3 * dt)
        return session.values(names)

    for name, value in GIVEN.items():
        difference = (stepped(name, value) - stepped(name, 0.0)) / value
        derivative = session.derivative(names, [name], [1.0])
        assert np.abs(difference).max() > 0.0
        assert np.abs(derivative - difference).max() <= 1e-8 * np.abs(difference).max()
    with pytest.raises(latin_fmu.InputError, match="has no derivative with respect to the rate"):
        session.derivative(names, ["port.side.incidentRate[2]"], [1.0])


def test_velocities_are_motions_and_go_on_from_where_they_are():
    """A jump of a velocity takes the first time step; that of a force happens where a step begins."""
    loads = Loads(bar(4, 20, port=PORTS, boundary={}))
    for name, value in GIVEN.items():
        loads.set(name, value, 0.0)
    lines = loads.driving(GridPart(4, 0.0), 1e-6, HOLD)
    assert lines["port.hand.velocity[1]"].tolist() == [0.0, 0.1, 0.1, 0.1, 0.1]
    assert lines["port.foot.force[3]"].tolist() == [70.0] * 5


def test_prescribed_is_windowed():
    """Histories give what steps with values and rates give; a port under a law of its own too."""
    scene = bar(4, 20, port=PORTS, boundary={})
    dt, names = scene.time.time_step, [n for n in Session(scene).outputs if n.startswith("port.")]

    def give(session: Session, t: float) -> None:
        for name, value in GIVEN.items():
            session.set_load(name, value * t / dt, value / dt)

    windowed = marched(Session(scene), 20, names, give)
    prescribed = Session(scene, Settings(mode=1))
    for name, value in GIVEN.items():
        prescribed.set_history(name, [0.0, 20 * dt], [0.0, 20 * value])
    # at t = 0 a step does not know yet how the motion goes on
    assert np.abs(marched(prescribed, 20, names) - windowed)[1:].max() <= 1e-9 * np.abs(windowed).max()


def test_a_static_start_holds_the_force_of_the_port():
    """The motion starts from the equilibrium under the force set before, and stays there; moved faces stand still."""
    port = {
        "foot": {"face": "bar.zmax", "components": ["z"]},
        "hand": {"face": "bar.zmin", "causality": "motion_in", "components": ["z"]},
    }
    session = Session(bar(10, 20, port=port, time={"end": 1e-5, "step": 1e-6, "start": "static"}))

    def give(session: Session, _: float) -> None:
        session.set_load("port.foot.force[3]", FORCE)

    rows = marched(session, 10, ["port.foot.displacement[3]", "port.hand.force[3]"], give)
    assert rows[:, 0] == pytest.approx(FORCE * 10 * EDGE / (E * AREA), rel=1e-6)
    assert rows[:, 1] == pytest.approx(FORCE, rel=1e-6)


WAVE = {"causality": "wave", "components": ["z"], "impedance": [1.0]}
RIGID = {"bar": {"material": "steel", "rigid": True, "box": {"size": [0.01] * 3, "elements": [1] * 3}}}
WIDE = {"bar": {"material": "steel", "box": {"size": [1.0, 1.0, 0.02], "elements": [60, 60, 1]}}}
STATIC = {"end": 1.0, "instants": 2, "quasi_static": True}


@pytest.mark.parametrize(
    ("port", "tables", "message"),
    [
        ({"causality": "wave"}, {}, "needs the impedance of each component"),
        ({"causality": "wave", "impedance": [1.0]}, {}, "needs the impedance of each component"),
        ({"impedance": [1.0, 1.0, 1.0]}, {}, "has no impedance"),
        ({"components": ["z", "z"]}, {}, "one to six different"),
        ({"components": ["z"], "laws": {"x": "constant"}}, {}, "not connected"),
        ({"face": "bar.top"}, {}, "no face of this name"),
        ({"causality": "motion_in", "components": ["z", "rx"]}, {}, ""),
        ({"causality": "motion_in"}, {"substructure": RIGID, "boundary": {}}, "whose motion is given is not known"),
        (WAVE, {"substructure": WIDE, "boundary": {}}, "couples every node of its face"),
        ({"face": "bar.*"}, {"boundary": {"b": {"type": "fixed", "face": "bar.*", "components": ["x"]}}}, ""),
        ({"causality": "motion_in", "components": ["z", "rz"]}, {}, "add x, y to the components"),
        ({"causality": "motion_in"}, {"boundary": {"b": {"type": "fixed", "face": "bar.zmin"}}}, "already held"),
        ({**WAVE, "components": ["rz"]}, {"solver": {"propagator": "explicit"}}, "couple the nodes"),
        (WAVE, {"time": STATIC}, "acts on velocities"),
    ],
)
def test_bad_ports(port, tables, message):
    def build() -> None:
        given = {"foot": {"face": "bar.zmin", **port}}
        latin_fmu.check(bar(2, 4, **({"boundary": {}} | tables), port=given))

    if not message:
        build()
        return
    with pytest.raises(latin_fmu.SceneError, match=message):
        build()


# -- the beam in traction, cut ----------------------------------------------------------------------------------------
MODEL = Path(__file__).parents[2] / "models" / "beam_in_traction" / "scene.toml"
BODIES = {"bar1_a.zmax": ("bar1_a",), "bar1_b.zmin": ("bar1_b", "bar2")}


@pytest.mark.slow
@pytest.mark.parametrize(("steps", "tolerance", "limit"), [(250, 1e-6, 0.25), (100, 1e-9, 1e-8)])
def test_the_cut_beam(steps, tolerance, limit):
    """Force of the joint of two bars that meet a third: exchanged once a time step, or iterated."""
    settings = {"tolerance": tolerance, "force_tolerance": 10 * tolerance}
    whole = latin_fmu.load_scene(MODEL, ["solver.window=1", "solver.tolerance=1e-9", "solver.force_tolerance=1e-9"])
    joint = latin_fmu.solve(whole).interfaces["joint"]
    steel, dt, pair = whole.material["steel"], whole.time.time_step, []
    impedance = float(np.sqrt(steel.young_modulus * steel.density) * joint.areas.sum())
    for face, bodies in BODIES.items():
        data = tomllib.loads(whole.text())
        own = {
            "substructure": {n: b for n, b in data["substructure"].items() if n in bodies},
            "interface": {"contact": data["interface"]["contact"]} if "bar2" in bodies else {},
            "load": data["load"] if "bar1_a" in bodies else {},
            "port": {"cut": {"face": face, "causality": "wave", "components": ["z"], "impedance": [impedance]}},
        }
        scene = latin_fmu.scene_from_dict({**data, **own, "solver": settings, "output": {}})
        pair.append(Session(scene, Settings(interpolation=RATE, keep=False)))
        pair[-1].initialize()
    force, waves = [0.0], [0.0, 0.0]
    for i in range(steps):
        if limit < 1e-3:
            waves = iterated(pair, i, dt, waves)
        else:
            exchanged(pair, i, dt)
        force.append(pair[0].value("port.cut.force[3]"))
    wanted = joint.force()[: steps + 1, 2]
    assert np.linalg.norm(np.array(force) - wanted) <= limit * np.linalg.norm(wanted)
