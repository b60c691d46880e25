"""Windowed and prescribed sessions against runs of the same scene."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import InputError, SolverError

from .scenes import bar, blocks, driven

H = 1e-6
FORCE = [f"interface.crush.force[{i}]" for i in (1, 2, 3)]


def ramped(session: Session, n: int, h: float = H) -> np.ndarray:
    """Rows of n steps under a load that rises and falls."""
    rows = []
    for i in range(n):
        session.set_load("press", 0.2 + 0.1 * i, 0.1 / h)
        report = session.step(i * h, h)
        assert report, report.message
        rows.append(session.row.copy())
    return np.array(rows)


def table_scene(times, values):
    law = {"type": "table", "times": list(times), "values": list(values)}
    load = blocks().model_dump()["load"]
    return blocks(load={**load, "press": {"face": "upper.zmax", "pressure": 100e6, "law": law}})


def test_outputs_are_those_of_the_table():
    session = Session(blocks())
    session.initialize()
    assert len(session.row) == len(session.outputs) == len(set(session.outputs))
    session.step(0.0, H)
    assert len(session.row) == len(session.outputs)
    assert np.isfinite(session.row).all()


def test_windowed_equals_a_run_with_the_same_load():
    """Steps that are multiples of the time step have the instants of the whole run."""
    session = Session(blocks())
    session.initialize()
    rows = ramped(session, 6)
    whole = latin_fmu.solve(table_scene(H * np.arange(7), 0.2 + 0.1 * np.arange(7)))
    history = whole.interfaces["crush"]
    index = [session.outputs.index(name) for name in FORCE]
    force = history.force()[5::5]
    scale = np.abs(force).max()
    assert scale > 100.0
    assert np.abs(rows[:, index] - force).max() <= 1e-6 * scale
    impulse = [session.outputs.index(f"interface.crush.impulse[{i}]") for i in (1, 2, 3)]
    assert rows[-1, impulse] == pytest.approx(history.impulse(whole.time)[-1], rel=1e-6, abs=1e-9)
    energy = session.outputs.index("energy.kinetic")
    assert rows[-1, energy] == pytest.approx(whole.energy["kinetic"][-1], rel=1e-6)


def test_prescribed_is_solve_to_the_last_digit():
    """Fields bit for bit; outputs but for the order of sums over the points: 1e-13 of the largest value."""
    times, values = np.array([0.0, 2e-6, 6e-6]), np.array([0.0, 1.0, 0.3])
    whole = latin_fmu.solve(table_scene(times, values))
    session = Session(blocks(), Settings(mode=1))
    session.set_history("press", times, values)
    session.initialize()
    n, dt = len(whole.time) - 1, 6e-6 / 30
    history = whole.interfaces["crush"]
    force, impulse = history.force(), history.impulse(whole.time)
    for i in range(n):
        assert session.step(i * dt, dt)
        assert np.abs(session.values(FORCE) - force[i + 1]).max() <= 1e-13 * np.abs(force).max()
        impulse_off = session.value("interface.crush.impulse[3]") - impulse[i + 1, 2]
        assert abs(impulse_off) <= 1e-13 * np.abs(impulse).max()
        assert session.value("energy.elastic") == pytest.approx(whole.energy["elastic"][i + 1], rel=1e-13)
    time, interfaces = session.window()
    assert np.array_equal(time, whole.time)
    assert np.array_equal(interfaces["crush"].traction, history.traction)


def test_prescribed_plays_back_between_instants():
    session = Session(blocks(), Settings(mode=1, end_time=3e-6))
    session.initialize()
    assert session.step(0.0, 0.3e-6)
    half = session.values(FORCE)
    time, interfaces = session.window()
    force = interfaces["crush"].force()
    assert half == pytest.approx(0.5 * (force[1] + force[2]))
    assert time[-1] == 3e-6
    refused = session.step(0.3e-6, 5e-6)
    assert not refused
    assert "endTime" in refused.message


def test_prescribed_refuses_changed_inputs():
    session = Session(blocks(), Settings(mode=1, end_time=1e-6))
    session.initialize()
    row = session.row.copy()
    session.set_load("press", 0.9)
    report = session.step(0.0, 1e-7)
    assert not report
    assert "no effect in prescribed mode" in report.message
    assert np.array_equal(session.row, row)
    session.set_load("press", 0.25)
    assert session.step(0.0, 1e-7)


@pytest.mark.parametrize(
    ("rule", "expected"), [(0, [0.5] * 5), (1, [0.55, 0.6, 0.65, 0.7, 0.75]), (2, [0.3, 0.35, 0.4, 0.45, 0.5])]
)
def test_loads_inside_a_step(rule, expected):
    session = Session(blocks(), Settings(interpolation=rule))
    session.initialize()
    session.set_load("press", 0.5, 0.25 / H)
    assert session.step(0.0, H)
    assert driven(session, 5)[:, 0] == pytest.approx(expected)


def test_lines_join():
    """A straight line from the end of the last step: the load has no jump."""
    session = Session(blocks(), Settings(interpolation=2))
    session.initialize()
    session.set_load("press", 0.5)
    assert session.step(0.0, H)
    session.set_load("press", 0.1)
    assert session.step(H, 0.4e-6)
    assert driven(session, 2)[:, 0] == pytest.approx([0.3, 0.1])


@pytest.mark.parametrize(
    ("t", "h", "words"),
    [
        (0.0, 0.0, "greater than 0"),
        (0.0, -1.0, "greater than 0"),
        (0.0, 1e3, "at most"),
        (0.0, math.nan, "finite"),
        (0.0, math.inf, "finite"),
        (math.nan, H, "finite"),
        (5e-7, H, "present time"),
    ],
)
def test_absurd_steps_are_refused(t, h, words):
    session = Session(blocks())
    session.initialize()
    assert session.step(0.0, H / 5) or True
    session.reset()
    session.initialize()
    before = session.snapshot()
    report = session.step(t, h)
    assert not report
    assert words in report.message
    assert session.snapshot() == before


@pytest.mark.parametrize("h", [0.5e-9, 1e-12, 1e-300])
def test_a_step_of_round_off_moves_the_clock_alone(h):
    """Late in a simulation it is below the last digit of the time; the history of the steps does not hold it."""
    session = Session(blocks(), Settings(keep=True))
    session.initialize(1e3)
    assert session.step(1e3, H)
    row, now = session.row, session.time
    assert session.step(now, h * H)
    assert session.time == now + h * H
    assert np.array_equal(session.row, row)
    assert session.step(session.time, H)
    assert len(session.dataset()["exchange"]["time"]) == 2


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("what", ["value", "rate"])
def test_inputs_that_are_no_numbers_are_refused(bad, what):
    session = Session(blocks())
    session.initialize()
    session.step(0.0, H)
    good = session.snapshot()
    session.set_load("press", **{"value": 0.3, "rate": 0.0, what: bad})
    report = session.step(H, H)
    assert not report
    assert f"load.press.{what}" in report.message
    session.set_load("press", 0.25)
    assert session.snapshot() == good


def test_overflow_is_refused_and_harmless():
    session = Session(blocks())
    session.initialize()
    session.set_load("press", 0.25)
    before = session.snapshot()
    session.set_load("press", 1e300)
    assert not session.step(0.0, H)
    session.set_load("press", 0.25)
    assert session.snapshot() == before
    assert session.step(0.0, H)


@pytest.mark.parametrize("most", [0, 100_001, 10**18])
def test_numbers_of_iterations_out_of_range_are_refused(most: int) -> None:
    with pytest.raises(InputError, match=r"maxIterations: out of range .*allowed: 1 to 100000"):
        Session(blocks(), Settings(max_iterations=most))


def test_no_convergence_is_refused_and_harmless():
    session = Session(blocks(), Settings(max_iterations=1, tolerance=1e-9))
    session.initialize()
    before = session.snapshot()
    report = session.step(0.0, H)
    assert not report
    assert "no convergence" in report.message
    assert session.snapshot() == before


def test_prescribed_without_convergence_raises():
    session = Session(blocks(), Settings(mode=1, max_iterations=1, tolerance=1e-9))
    with pytest.raises(SolverError):
        session.initialize()
    assert not session.step(0.0, H)


def test_settings_out_of_range_are_listed():
    with pytest.raises(InputError) as caught:
        Session(blocks(), Settings(time_step=-1.0, end_time=math.nan, tolerance=0.0))
    assert len(caught.value.problems) == 3


@pytest.mark.parametrize(
    ("settings", "words"),
    [(Settings(mode=7), "mode: unknown value"), (Settings(interpolation=9), "inputInterpolation: unknown value")],
)
def test_choices_that_are_none_are_refused_at_the_start(settings, words):
    session = Session(blocks(), settings)
    with pytest.raises(InputError, match=words):
        session.initialize()
    assert not session.step(0.0, H)


@pytest.mark.parametrize(
    ("times", "values", "words"),
    [
        ([0.0, 1.0], [0.0], "lists of equal length"),
        ([0.0, math.nan], [0.0, 1.0], "row 2 is not a pair of finite numbers"),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "the times must increase strictly; row 3"),
    ],
)
def test_histories_that_cannot_be_are_refused(times, values, words):
    with pytest.raises(InputError, match=words):
        Session(blocks(), Settings(mode=1)).set_history("press", times, values)


def test_unknown_names():
    session = Session(blocks())
    for call in (
        lambda: session.set_load("pres", 1.0),
        lambda: session.set_history("push", [0], [1]),
        lambda: session.value("x"),
    ):
        with pytest.raises(InputError):
            call()


def test_reset_gives_the_same_again():
    session = Session(blocks())
    session.initialize()
    first = ramped(session, 3)
    session.reset()
    session.initialize()
    assert np.array_equal(first, ramped(session, 3))


def test_rounded_steps_are_whole_time_steps():
    session, t = Session(bar()), 0.0
    session.initialize()
    for _ in range(1000):
        h = 0.02 * (1.0 + 1e-13 * math.sin(t))
        assert session.step(t, h).instants == 1
        t = t + h
    assert session.value("innerTime") == 1000 * 0.02


def test_the_time_step_of_the_settings_is_that_of_the_grid():
    """Bit for bit the session of a scene with that step."""
    rows = []
    for scene, settings in ((blocks(), Settings(time_step=0.1e-6)), (blocks(time={"end": 6e-6, "step": 0.1e-6}), None)):
        session = Session(scene, settings)
        session.initialize()
        rows.append(ramped(session, 5, 0.37e-6))
    assert np.array_equal(*rows)
    assert rows[0][-1, session.outputs.index("innerTime")] == pytest.approx(1.8e-6)


@pytest.mark.parametrize("keep", [False, True])
def test_a_step_that_ends_before_the_next_instant_holds_the_outputs(keep):
    session = Session(blocks(), Settings(keep=keep))
    session.initialize()
    ramped(session, 2)
    row, (time, fields) = session.row.copy(), session.window()
    session.set_load("press", 0.9)
    for i in range(2):
        assert session.step(2.0 * H + 0.06e-6 * i, 0.06e-6).instants == 0
    assert np.array_equal(session.row, row)
    held, last = session.window()
    assert held.tolist() == [time[-1]]
    assert np.array_equal(last["crush"].traction, fields["crush"].traction[-1:])
    assert session.derivative(FORCE, ["load.press.value"], [1.0]).tolist() == [0.0, 0.0, 0.0]
    assert session.step(2.12e-6, 0.88e-6).instants == 5
    if keep:
        tree = session.dataset()
        assert tree["exchange"].sizes["time"] == 5
        assert tree["interfaces/crush"].sizes["time"] == 16
        assert session.estimate_error().remarks == ("too few time steps for an estimate",)  # of 15, but known from 0 on


def test_no_history_is_kept_unless_asked_for():
    """Memory stays as it is however many steps are made; a dataset of them says what to do."""
    session = Session(blocks())
    session.initialize()
    for i in range(10):
        assert session.step(i * H, H)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for i in range(10, 60):
        assert session.step(i * H, H)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 50 * 200  # bytes; a step that is kept takes 10 kB
    for what in (session.dataset, session.estimate_error):
        with pytest.raises(InputError, match=r"not stored.*Settings\(keep=True\)"):
            what()
    whole = Session(blocks(), Settings(mode=1))
    whole.initialize()
    assert whole.step(0.0, H)
    tree = whole.dataset()
    assert "exchange" not in tree.children
    assert tree["interfaces/crush"].sizes["time"] == 31


def test_results_are_labelled_with_the_units_of_the_scene():
    session = Session(blocks(units="mm-t-s-MPa"), Settings(keep=True))
    session.initialize()
    ramped(session, 2)
    tree = session.dataset(estimate=True)
    assert tree.attrs["unit_system"] == "mm-t-s-MPa"
    assert tree["interfaces/crush"]["traction"].attrs["units"] == "MPa"
    assert tree["exchange"]["interface_crush_velocityE"].attrs["units"] == "mm s-1"
    assert tree["exchange"]["step_start"].attrs["units"] == "s"


def test_start_time_other_than_zero():
    first, late = Session(blocks()), Session(blocks())
    first.initialize()
    late.initialize(10.0 * H)
    assert first.step(0.0, H)
    assert late.step(10.0 * H, H)
    instants = np.array([name.rpartition(".")[2].startswith("last") for name in first.outputs])
    always = np.array([name == "innerTime" for name in first.outputs])
    shift = np.where(always | (instants & (first.row > 0.0)), 10.0 * H, 0.0)
    assert shift.any()
    assert late.row == pytest.approx(first.row + shift, rel=1e-6, abs=1e-9)
    assert late.window()[0][0] == 10.0 * H


def test_sensor_tells_the_motion_of_its_node():
    whole = latin_fmu.solve(blocks(output={"fields": True}))
    session = Session(blocks())
    session.initialize()
    for i in range(6):
        assert session.step(i * H, H)
    node = int(np.linalg.norm(whole.substructures["upper"].nodes - [0.005, 0.005, 0.02], axis=1).argmin())
    expected = whole.substructures["upper"].displacement[-1, node]
    actual = session.values([f"sensor.head.displacement[{i}]" for i in (1, 2, 3)])
    assert actual == pytest.approx(expected, rel=1e-6, abs=1e-12)
    played = Session(blocks(), Settings(mode=1))
    played.initialize()
    assert played.step(0.0, 6e-6)
    assert played.values([f"sensor.head.displacement[{i}]" for i in (1, 2, 3)]) == pytest.approx(expected, rel=1e-9)


def test_initial_outputs_hold_initial_velocity():
    session = Session(bar())
    session.initialize()
    assert session.value("interface.wall.velocityE[3]") == pytest.approx(-10.0)
    assert session.value("interface.wall.gap") == pytest.approx(0.5)
    assert session.value("interface.wall.closed") == 0.0


def test_quasi_static_session_equals_a_run_with_the_same_load():
    """Increments of load in place of time steps: the same variables, the same path."""
    time = {"end": 6e-6, "step": 0.2e-6, "quasi_static": True}
    solver = {"tolerance": 1e-9}  # first guesses differ, as a segment does not know the loads before it
    session = Session(blocks(time=time, solver=solver))
    session.initialize()
    rows = ramped(session, 6)
    whole = latin_fmu.solve(
        latin_fmu.scene_from_dict(
            table_scene(H * np.arange(7), 0.2 + 0.1 * np.arange(7)).model_dump(exclude={"interface"})
            | {
                "time": time,
                "solver": solver,
                "interface": {"crush": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.2}},
            }
        )
    )
    force = whole.interfaces["crush"].force()[5::5]
    index = [session.outputs.index(name) for name in FORCE]
    assert np.abs(rows[:, index] - force).max() <= 1e-6 * np.abs(force).max()
    assert rows[-1, session.outputs.index("energy.kinetic")] == 0.0


def test_the_histories_after_a_refused_step_are_those_of_the_step_before():
    known, refused = (Session(blocks(), Settings(keep=False)) for _ in range(2))
    for session in (known, refused):
        session.initialize()
        ramped(session, 3)
    refused.set_load("press", 1e300)
    assert not refused.step(3 * H, 3 * H)
    (time, own), (known_time, histories) = refused.window(), known.window()
    assert time.tolist() == known_time.tolist()
    assert own.keys() == histories.keys()
    assert all(np.array_equal(own[name].traction, h.traction) for name, h in histories.items())
