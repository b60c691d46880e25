"""Communication steps of any length: the state at the last instant of the grid, nothing of the input lost."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import fmpy
import numpy as np
import pytest

from fmu_build.build import build_fmu
from latin_fmu import load_scene
from latin_fmu.cosim import Session
from tests.cosim.scenes import bar

from .host import COMPILED, Host

DT = 0.2e-6
END = 30 * DT
LIMIT = 1e-9  # of the largest of a unit
BASE, SLOPE = 0.2, 1.0 / END  # of the load: a ramp


@pytest.fixture
def hosts(made, fmi, tmp_path) -> Iterator[list[Host]]:
    both = [Host(made[fmi], tmp_path / str(number)) for number in range(2)]
    yield both
    for host in both:
        host.close()


def marched(host: Host, times: Sequence[float], start: float = 0.0) -> np.ndarray:
    """Outputs at communication points under the ramp."""
    host.set(load__press__value=BASE, inputInterpolation=1)
    host.start(start)
    rows = [host.read()]
    for t, following in pairwise(times):
        host.set(load__press__value=BASE + SLOPE * t, load__press__rate=SLOPE)
        assert host.step(start + t, (start + following) - (start + t)), host.messages
        rows.append(host.read())
    return np.array(rows)


CUTS = {
    "500 points": np.linspace(0.0, END, 501),
    "a part of a time step": np.append(np.arange(0.0, END, 0.37 * DT), END),
    "more than a time step, a short end": np.append(np.arange(0.0, END, 2.6 * DT), END),
    "7 points": np.linspace(0.0, END, 8),
}


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("start", [0.0, 2.5])
def test_outputs_are_those_of_the_grid_at_the_inner_time(hosts, cut, start):
    """A straight line is the same whatever it is cut into."""
    first, second = hosts
    grid = marched(first, DT * np.arange(31), start)
    times = CUTS[cut]
    rows = marched(second, times, start)
    inner = first.outputs.index("innerTime")
    made = np.rint((rows[:, inner] - start) / DT).astype(int)
    assert (made == np.floor(times / DT + 1e-6)).all()
    counted = [i for i, name in enumerate(first.outputs) if name.startswith(("solver.", "window."))]
    for i in range(len(first.outputs)):
        if i not in counted:
            unit = [k for k in range(len(first.outputs)) if k not in counted and same_unit(first, i, k)]
            assert np.abs(rows[:, i] - grid[made, i]).max() <= LIMIT * np.abs(grid[:, unit]).max(), first.outputs[i]


def same_unit(host: Host, i: int, k: int) -> bool:
    return host.variables[host.outputs[i]].unit == host.variables[host.outputs[k]].unit


def test_any_steps_with_rollback_are_those_without(hosts):
    """Bit for bit, by all rules."""
    generator = random.Random(3)
    for rule in (0, 1, 2, 3):
        for host in hosts:
            host.fmu.reset()
            host.set(inputInterpolation=rule)
            host.start()
        t, straight, other = 0.0, *hosts
        while t < 0.9 * END:
            h = DT * min(10.0 ** generator.uniform(-1.0, np.log10(30.0)), (END - t) / DT)
            value, rate = generator.uniform(0.0, 1.0), generator.choice([0.0, 1e4])
            state = other.save()
            other.set(load__press__value=-value, load__press__rate=1.0)
            other.step(t, h * generator.uniform(0.1, 1.0))
            other.restore(other.from_bytes(other.to_bytes(state)))
            for host in hosts:
                host.set(load__press__value=value, load__press__rate=rate)
                assert host.step(t, h), host.messages
            assert np.array_equal(straight.read(), other.read())
            t += h
        block = straight.to_bytes(straight.save())
        assert block == other.to_bytes(other.save())
        other.fmu.reset()  # restored before it was initialized
        other.restore(other.from_bytes(block))
        for host in hosts:
            assert host.step(t, 0.7 * DT), host.messages
        assert np.array_equal(straight.read(), other.read())


@pytest.mark.parametrize("interval", [None, 0.37 * DT, END / 499])
def test_a_host_with_its_own_step(made, fmi, interval):
    result = fmpy.simulate_fmu(
        str(made[fmi]), stop_time=END, output_interval=interval, start_values={"load.press.value": 1.0}
    )
    assert result["time"][-1] == pytest.approx(END)
    assert np.ptp(result["interface.crush.normalForce"]) > 0.0


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=COMPILED)])
def test_initialization_mode_has_the_values_of_the_start(fmi, compiled, tmp_path):
    """Under what is set at that moment, and nothing else follows from the reading; events are counted in whole
    numbers."""
    path = build_fmu(bar(), tmp_path / "bar.fmu", fmi, python=not compiled)
    read, plain = (Host(path, tmp_path / str(number)) for number in range(2))
    assert (read.read()[read.outputs.index("interface.wall.gap")] if read.three else 0.0) == 0.0
    read.prepare(0.5)
    first = read.read()
    assert first[read.outputs.index("interface.wall.velocityE[3]")] == pytest.approx(-10.0)
    assert first[read.outputs.index("innerTime")] == 0.5
    state = read.save()
    read.restore(state)
    assert np.array_equal(read.read(), first)
    read.fmu.exitInitializationMode()
    plain.start(0.5)
    for k in range(5):
        assert np.array_equal(read.read(), plain.read())
        assert all(host.step(0.5 + 0.02 * k, 0.02) for host in (read, plain))
    assert read.variables["interface.wall.touches"].type == ("Int32" if read.three else "Integer")
    assert read.variables["interface.wall.touches"].variability == "discrete"
    number = [read.reference("interface.wall.touches")]
    assert (read.fmu.getInt32 if read.three else read.fmu.getInteger)(number) == [1]
    for host in (read, plain):
        host.close()


@pytest.mark.parametrize("mode", [0, 1])
def test_inputs_set_in_initialization_mode_count(made, fmi, mode, tmp_path):
    """The last ones that were set, whatever was read before."""
    read, plain = (Host(made[fmi], tmp_path / str(number)) for number in range(2))
    for host in (read, plain):
        host.set(mode=mode)
        host.prepare()
    for value in (0.9, 0.4):
        read.set(load__press__value=value)
        read.read()
    plain.set(load__press__value=0.4)
    for host in (read, plain):
        host.fmu.exitInitializationMode()
        assert host.step(0.0, 5 * DT), host.messages
    assert np.array_equal(read.read(), plain.read())
    for host in (read, plain):
        host.close()


@COMPILED
def test_a_motion_that_begins_in_the_first_step(fmi, tmp_path):
    """A face moved through a port, at rest at t = 0 as its bar, with a rate from then on: as the session."""
    file = Path(__file__).parents[2] / "models" / "impact_bar" / "scene.toml"
    model = load_scene(file, ["substructure.bar.initial_velocity=[0.0,0.0,0.0]"])
    port = {"tool": {"face": "bar.zmax", "causality": "motion_in", "components": ["x", "y", "z"]}}
    scene = type(model).model_validate(model.model_dump(exclude_unset=True) | {"port": port})
    session, dt = Session(scene), scene.time.time_step
    host = Host(build_fmu(scene, tmp_path / "moved.fmu", fmi), tmp_path / "instance")
    host.start()
    session.initialize()
    for i in range(6):
        value, rate = 0.2 * i, 0.2 / dt
        host.set(**{"port__tool__velocity[3]": value, "port__tool__velocityRate[3]": rate})
        session.set_load("port.tool.velocity[3]", value, rate)
        assert host.step(i * dt, dt), host.messages
        assert session.step(i * dt, dt)
        names = [name for name in host.outputs if name.startswith(("port.", "interface.")) and "last" not in name]
        for found, wanted in zip(host.read(names), session.values(names), strict=True):
            assert abs(found - wanted) <= LIMIT * np.abs(session.values(names)).max()
    host.close()


@pytest.mark.parametrize("mode", [0, 1])
def test_a_step_of_round_off_moves_the_clock_alone(hosts, mode):
    """Some hosts end so. Outputs stay, and the steps after it are those without it, bit for bit."""
    _, second = hosts
    rows = []
    for host in hosts:
        host.set(mode=mode, load__press__value=BASE)
        host.start()
        assert host.step(0.0, 2 * DT)
        now = 2 * DT
        if host is second:
            before = host.read()
            for h in (0.5e-9 * DT, 8.7e-19 * DT, 5e-324):
                assert host.step(now, h), host.messages[-1]
                now += h
            assert np.array_equal(host.read(), before)
        assert host.step(now, 3 * DT - now), host.messages[-1]
        assert host.step(3 * DT, 1.4 * DT)
        rows.append(host.read())
    assert np.array_equal(*rows)
