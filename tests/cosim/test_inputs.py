"""Inputs of hosts that set values only: the causal line; histories as tables."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.variables import CAUSAL, HOLD, PRESCRIBED, RATE
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import Box, Material, column

from .scenes import blocks
from .segments import GridPart, Loads

H = 1e-6
SOFT = Material(1.0, 1.0)


# -- the causal line ----------------------------------------------------------------------------------------------
def over(values: list[float], spans: list[float], rates: dict[int, float] | None = None) -> list[tuple[float, float]]:
    """Amplitudes of ``press`` at the start and the end of steps, the value set at the start of each."""
    loads, ends = Loads(blocks()), []
    for i, (value, h) in enumerate(zip(values, spans, strict=True)):
        loads.set("press", value, (rates or {}).get(i, 0.0))
        if i == 0:
            loads.begin()
        amplitudes = loads.driving(GridPart(4, 0.0), h / 4, CAUSAL)
        loads.accept(GridPart(4, 0.0), h / 4, CAUSAL)
        ends.append((float(amplitudes["press"][0]), float(amplitudes["press"][-1])))
    return ends


def test_a_load_goes_on_straight_through_its_last_two_values() -> None:
    """Unequal steps: a load that is linear in time is met from the second step on; the first one is held."""
    spans = [1.0, 2.0, 0.5, 3.0]
    starts = np.concatenate([[0.0], np.cumsum(spans)[:-1]])
    ends = over([0.5 + 0.25 * t for t in starts], spans)
    assert ends[0] == (0.5, 0.5)
    for start, h, (first, last) in list(zip(starts, spans, ends, strict=True))[1:]:
        assert (first, last) == pytest.approx((0.5 + 0.25 * start, 0.5 + 0.25 * (start + h)))


def test_a_value_that_was_held_jumps() -> None:
    """A staircase of treads of two steps or more is met as it is, from its first jump after two equal values on."""
    values = [1.0, 1.0, 3.0, 3.0, -2.0]
    assert over(values, [1.0] * 5) == [(value, value) for value in values]


def test_a_rate_counts_from_the_first_that_is_not_zero_on() -> None:
    ends = over([1.0, 2.0, 5.0, 9.0], [1.0] * 4, {2: -1.0})
    assert ends == [(1.0, 1.0), (2.0, 3.0), (5.0, 4.0), (9.0, 9.0)]


def pulse(t: np.ndarray) -> np.ndarray:
    """Raised cosine over the first 0.8 of the time 1."""
    return np.where(t < 0.8, 0.5 - 0.5 * np.cos(2.0 * np.pi * np.minimum(t, 0.8) / 0.8), 0.0)


def half_sine(t: np.ndarray) -> np.ndarray:
    """Half a period of a sine over the first 0.8 of the time 1, with kinks at both ends."""
    return np.where(t < 0.8, np.sin(np.pi * np.minimum(t, 0.8) / 0.8), 0.0)


def long_blocks() -> Scene:
    """The two blocks with friction under the pulse, 240 time steps."""
    return blocks(time={"end": 48e-6, "step": 0.2e-6})


def squeezed_bars() -> Scene:
    """Two equal bars between a wall and the pulse, 240 time steps in six transits."""
    bar = Box(SOFT, (0.2, 0.2, 1.0), (1, 1, 20))
    wall = {"wall": {"type": "fixed", "face": "low.zmin", "components": ["z"]}}
    load = {"press": {"face": "up.zmax", "pressure": 0.1, "law": {"type": "input"}}}
    time = {"end": 12.0, "step": 0.05}
    return latin_fmu.scene_from_dict(
        column({"low": bar, "up": bar}, {"meet": {}}, time, name="squeezed", boundary=wall, load=load)
    )


def force_error(scene: Scene, rule: int, shape: Callable[[np.ndarray], np.ndarray]) -> float:
    """L2 norm over time of the error of the interface force, relative, at steps of five time steps."""
    end, n = scene.time.end, scene.time.n_step
    name = next(iter(scene.joints))
    times = np.linspace(0.0, end, 20 * n + 1)
    true = Session(scene, Settings(mode=PRESCRIBED, keep=False))
    true.set_history("press", times, shape(times / end))
    true.initialize()
    expected = true.window()[1][name].force()[1:]
    session, forces, h = Session(scene, Settings(interpolation=rule, keep=False)), [], 5 * end / n
    session.set_load("press", 0.0)
    session.initialize()
    for i in range(n // 5):
        session.set_load("press", float(shape(np.array(i * h / end))))
        assert session.step(i * h, h)
        forces.append(session.window()[1][name].force()[1:])
    return float(np.linalg.norm(np.concatenate(forces) - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("make", [long_blocks, squeezed_bars])
@pytest.mark.parametrize(("shape", "times"), [(pulse, 5.0), (half_sine, 2.0)])
def test_the_force_is_nearer_than_under_a_staircase(make, shape, times) -> None:
    line, staircase = force_error(make(), CAUSAL, shape), force_error(make(), HOLD, shape)
    assert staircase < 0.5
    assert staircase >= times * line, (staircase, line)


def test_steps_keep_the_rates_of_the_line() -> None:
    """What the results file holds is what was solved: the same steps with these rates give the same numbers."""
    first, second = Session(blocks(), Settings(keep=True)), Session(blocks(), Settings(interpolation=RATE, keep=True))
    for session in (first, second):
        session.initialize()
    for i in range(4):
        first.set_load("press", math.sin(0.4 * i))
        assert first.step(i * H, H)
    for i, step in enumerate(first.step_history):
        second.set_load("press", step.value["press"], step.rate["press"])
        assert second.step(i * H, H)
    assert np.array_equal(first.row, second.row)
    assert first.dataset()["exchange"]["load_press_rate"].values[2] > 0.0


@pytest.mark.parametrize(("force", "lifts"), [(50.0, False), (2500.0, False), (250e3, True)])
def test_a_rigid_body_that_slides_or_lifts_from_the_start(force: float, lifts: bool) -> None:
    """A block that 1 kN presses: held, sliding, thrown off; as in the run under the same force."""
    size = (0.1, 0.1, 0.02)
    block = {
        "material": "steel",
        "rigid": True,
        "box": {"origin": [0.0] * 3, "size": list(size), "elements": [2, 2, 1]},
    }
    direction = [0.0, 0.0, 1.0] if lifts else [1.0, 0.0, 0.0]
    push = {"face": "block.zmax", "force": direction, "law": "input"}
    tables = {
        "name": "block",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"block": block},
        "interface": {"floor": {"sides": ["block.zmin", "ground"], "friction_coefficient": 0.1}},
        "load": {"clamp": {"face": "block.zmax", "pressure": 1e5, "law": "constant"}, "push": push},
        "time": {"end": 1e-4, "step": 1e-5},
    }
    scene = latin_fmu.scene_from_dict(tables)
    direct = latin_fmu.solve(
        scene.replace("load.push", {**push, "law": "constant", "force": [force * x for x in direction]})
    )
    expected = direct.interfaces["floor"].force()
    session = Session(scene)
    session.set_load("push", force)
    session.initialize()
    names = [f"interface.floor.force[{k}]" for k in (1, 2, 3)]
    for step in range(10):
        assert session.step(step * 1e-5, 1e-5).accepted
        assert np.abs(session.values(names) - expected[step + 1]).max() <= 1e-9 * 1e3
