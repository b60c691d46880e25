"""Joints that are closed from the start keep their clamp force, at default settings: at rest, on a base that shakes, in
the frame of that base, riding along, turning; and bodies that bounce gain no energy.

What is closed stands where the laws put it: the error that an instant leaves is made up in the next ones
(``kernels.local_stage``). Without that errors add up, and the bolt of the lap joint loses 58 % of its force in 3 ms on
the shaken base, 69 % in 4,000 instants at rest.
"""

from __future__ import annotations

import copy
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.compiled import library
from latin_fmu.cosim import Session
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.results.solution import Solution
from latin_fmu.stability.joints import clamped_pair, kept_clamp
from latin_fmu.stability.scenes import Box, Material, column
from tests.fmu.host import Host
from tests.scenes import solve

LAP = Path(__file__).parents[2] / "models" / "lap_joint" / "lap_joint.msh"
FORCE, STEP, PULSE, PEAK = 5e3, 10e-6, 1e-3, 4903.3
SHAKEN: dict[str, Any] = tomllib.loads(f"""
name = "shaken"
[material.steel]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0
[mesh.joint]
file = '{LAP}'
scale = 1e-3
parts = "*"
material = "steel"
[substructure.washer]
bending_modes = true
[substructure.lower]
bending_modes = true
[substructure.upper]
bending_modes = true
[contact.all]
search = 0.05e-3
friction_coefficient = 0.2
except = [["bolt", "nut"]]
[interface.cut]
sides = ["bolt.bolt_cut", "nut.nut_cut"]
behaviour = "perfect"
[bolt.b1]
substructure = "bolt"
axis = [0, 0, 1]
force = {FORCE}
[time]
step = {STEP}
""")
Tables = dict[str, Any]


def lap(instants: int, boundary: Tables, **tables: Any) -> Tables:
    """The bolted lap joint of the models with its lower plate held or driven at one end."""
    scene = copy.deepcopy(SHAKEN) | {"boundary": {"wall": {"face": "lower.lower_right", **boundary}}}
    scene["time"] |= {"end": instants * STEP} | tables.pop("time", {})
    return scene | tables


def pulse(**others: Any) -> Tables:
    """Base acceleration along z, a half sine of 1 ms and 500 g."""
    law = {"type": "half_sine", "duration": PULSE}
    driven = {"type": "acceleration", "components": ["x", "y", "z"], "value": [0.0, 0.0, PEAK], "law": law}
    return driven | others


def bolt(solution: Solution) -> np.ndarray:
    """Force of the bolt over time, N."""
    return np.asarray(solution.bolts["b1"].force)


@cache
def exact_shaken(instants: int) -> np.ndarray:
    return bolt(solve(lap(instants, pulse(), solver={"tolerance": 1e-7})))


WHILE_SHAKEN = pytest.mark.parametrize("instants", [120, pytest.param(300, marks=pytest.mark.slow)])  # the pulse: 100


@WHILE_SHAKEN
def test_a_shaken_joint_keeps_its_clamp_force(instants: int) -> None:
    """Default settings against a tolerance of 1e-7, at every instant; the joint slips and opens."""
    force = bolt(solve(lap(instants, pulse())))
    assert np.abs(force - exact_shaken(instants)).max() <= 2e-3 * FORCE
    if instants == 300:
        assert exact_shaken(300)[290] == pytest.approx(4915.8, abs=0.5)


@WHILE_SHAKEN
def test_base_and_gravity_frame_agree(instants: int) -> None:
    """The same motion in the frame of the base, where gravity acts with the opposite sign."""
    law = {"type": "half_sine", "duration": PULSE}
    gravity = {"acceleration": [0.0, 0.0, -PEAK], "law": law}
    force = bolt(solve(lap(instants, {"type": "fixed"}, gravity=gravity)))
    assert np.abs(force - exact_shaken(instants)).max() <= 1e-3 * FORCE


@pytest.mark.slow
def test_frames_agree_on_a_base_that_gets_fast() -> None:
    """A pulse of 10 ms takes the base to 31 m/s, ten times the speed that the one of 1 ms leaves."""
    law = {"type": "half_sine", "duration": 10 * PULSE}
    gravity = {"acceleration": [0.0, 0.0, -PEAK], "law": law}
    force = bolt(solve(lap(1200, pulse(law=law))))
    assert np.abs(force - bolt(solve(lap(1200, {"type": "fixed"}, gravity=gravity)))).max() <= 1e-3 * FORCE
    assert np.abs(force[-1] - FORCE) <= 0.05 * FORCE


_SLOW = [pytest.param(scheme, 1500, marks=pytest.mark.slow) for scheme in ("hht", "generalized_alpha", "newmark")]


@pytest.mark.parametrize(("scheme", "instants"), [("hht", 300), *_SLOW])
def test_a_joint_at_rest_stays(scheme: str, instants: int) -> None:
    force = bolt(solve(lap(instants, {"type": "fixed"}, time={"scheme": scheme})))
    assert np.abs(force - FORCE).max() <= 1e-7 * FORCE


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["hht", "generalized_alpha"])
def test_a_joint_at_rest_stays_for_long(scheme: str) -> None:
    """1e5 instants: what is off does not grow, and nothing moves by more than 1e-7 of the bolt's shortening in a
    thousand of them, but for the vibration that round-off excites and the schemes hardly damp."""
    output = {"interfaces_every": 1000}
    sensor = {"end": {"face": "upper.upper_left"}, "cut": {"face": "bolt.bolt_cut"}}
    scene = lap(100_000, {"type": "fixed"}, time={"scheme": scheme}, output=output, sensor=sensor)
    solution = solve(scene)
    off = np.abs(bolt(solution) - FORCE)
    assert off.max() <= 1e-5 * FORCE
    assert off[-10_000:].max() <= 3.0 * max(off[10_000:20_000].max(), 1e-9 * FORCE)
    shortening = float(solution.bolts["b1"].shortening)
    for at in solution.sensors.values():
        moved = at.displacement[::1000]
        assert np.abs(np.diff(moved, axis=0)).max() <= 5e-7 * shortening


# -- a pair that rides; 2,000 instants are a case of the stability suite (``stability.joints``) ----------------------
RIDE = (30.0, -20.0, 100.0)


@pytest.mark.slow
def test_a_clamped_pair_rides_for_long() -> None:
    measures = kept_clamp(solve(clamped_pair(100_000, RIDE)))
    assert all(m.passed for m in measures), measures


# -- the same in steps of a master, with states taken back, from checkpoints, in an FMU -----------------------------
LENGTHS = pytest.mark.parametrize(  # instants of the run, and of a communication step; the long one is not pushed: the
    # push makes the pair turn by 108 degrees in it
    ("instants", "every"),
    [(1000, 20), pytest.param(100_000, 100, marks=pytest.mark.slow)],
)
MOVED = {"press": {"face": "up.zmax", "traction": [2e6, 0.0, 0.0], "law": {"type": "half_sine", "duration": 2e-4}}}


def in_steps(take: Any, read: Any, take_back: Any, steps: int, every: int) -> np.ndarray:
    """Forces of the joint after every step; every seventh step is made twice, from the state before it."""
    rows = []
    for i in range(steps):
        if i % 7 == 3:
            take_back(lambda i=i: take(i * every * 1e-6))
        take(i * every * 1e-6)
        rows.append(read())
    return np.array(rows)


def carried(instants: int, pushed: bool = True) -> Tables:
    """The clamped pair that rides at 100 m/s and is pushed along the joint, less than friction holds."""
    return clamped_pair(instants, RIDE) | ({"load": copy.deepcopy(MOVED)} if pushed else {})


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    reason="at the default tolerance the errors of the iteration excite an axial vibration of the pair, which turns "
    "after the push: the clamp force is off by up to 8.5e-3 after 1e5 instants (at a tolerance of 1e-6: 1e-7)",
)
def test_a_pushed_pair_keeps_its_clamp_force_for_long() -> None:
    history = latin_fmu.solve(latin_fmu.scene_from_dict(carried(100_000))).interfaces["joint"]
    force = history.force()[:, 2]
    assert np.abs(force[-2000:] / force[0] - 1.0).max() <= 1e-4


@LENGTHS
def test_sessions_keep_the_clamp_force(instants: int, every: int) -> None:
    session = Session(latin_fmu.scene_from_dict(carried(instants, instants == 1000)))
    session.initialize()
    columns = [session.outputs.index(f"interface.joint.force[{i}]") for i in (1, 2, 3)]

    def take(t: float) -> None:
        report = session.step(t, every * 1e-6)
        assert report, report.message

    def take_back(step: Any) -> None:
        kept = session.snapshot()
        step()
        session.restore(kept)

    force = in_steps(take, lambda: session.row[columns].copy(), take_back, instants // every, every)
    whole = solve(carried(instants, instants == 1000)).interfaces["joint"].force()
    assert np.abs(force - whole[every::every]).max() <= 1e-9 * np.abs(whole).max()
    assert force[-1, 2] == pytest.approx(whole[0, 2], rel=1e-4)


@LENGTHS
def test_fmus_keep_the_clamp_force(instants: int, every: int, tmp_path: Path) -> None:
    """Compiled where there is a library of the kernels, else with Python inside."""
    compiled = library.loaded() is not None
    scene = latin_fmu.scene_from_dict(carried(instants, instants == 1000))
    host = Host(build_fmu(scene, tmp_path / "pair.fmu", "2", python=not compiled), tmp_path / "instance")
    try:
        host.start()
        names = [f"interface.joint.force[{i}]" for i in (1, 2, 3)]

        def take(t: float) -> None:
            assert host.step(t, every * 1e-6), host.messages

        def take_back(step: Any) -> None:
            kept = host.to_bytes(host.save())
            step()
            host.restore(host.from_bytes(kept))

        force = in_steps(take, lambda: host.read(names), take_back, instants // every, every)
    finally:
        host.close()
    whole = solve(carried(instants, instants == 1000)).interfaces["joint"].force()
    assert np.abs(force - whole[every::every]).max() <= 1e-9 * np.abs(whole).max()


def test_a_continued_run_keeps_the_clamp_force(tmp_path: Path) -> None:
    """A pushed pair that goes on from a checkpoint half-way has the bits of one that was not stopped."""
    scene = latin_fmu.scene_from_dict(carried(200))
    whole = latin_fmu.solve(scene).interfaces["joint"].traction

    asked: list[int] = []
    first = Checkpoint(tmp_path / "pair.checkpoint", every=20, stop=lambda: bool(asked.append(1)) or len(asked) > 3)
    stopped = latin_fmu.solve(scene, checkpoint=first)
    assert 20 < len(stopped.time) < len(whole)
    second = Checkpoint(tmp_path / "pair.checkpoint", resume=True, log=lambda _: None)
    assert np.array_equal(latin_fmu.solve(scene, checkpoint=second).interfaces["joint"].traction, whole)


# -- friction at rest --------------------------------------------------------------------------------------------
def crept(instants: int) -> float:
    """Largest travel along the face, after a hundredth of the run, of a block at 80 % of the slope at which it would
    slide, over its elastic deflection; it starts from equilibrium."""
    weight, steel = [0.4 * 9.81, 0.0, -9.81], Material(210e9, 7800.0, 0.3, name="steel")
    scene = column({"block": Box(steel, (0.02, 0.03, 0.05), (2, 2, 3))}, {}, {"end": instants * 1e-6})
    scene["time"] |= {"instants": instants, "start": "static"}
    ground = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    scene["interface"] = {"floor": {"sides": ["block.zmin", "ground"], "ground": ground, "friction_coefficient": 0.5}}
    solution = solve(scene | {"gravity": {"acceleration": weight}})
    history = solution.interfaces["floor"]
    assert (history.contact_status < 2).all()  # open at the edge, nowhere sliding
    travel = history.slip_path(solution.time)
    return float(np.abs(travel[-1] - travel[instants // 100]).max() / (7800.0 * 9.81 * 0.05**2 / 210e9))


def test_friction_at_rest_does_not_creep() -> None:
    assert crept(2000) <= 1e-9


@pytest.mark.slow
def test_friction_at_rest_does_not_creep_for_long() -> None:
    assert crept(100_000) <= 1e-9
