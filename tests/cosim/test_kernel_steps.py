"""Sessions against segments of a run, along random walks.

Two sessions take the same steps: one straight on, one that makes other steps in between and takes them back, goes on
from bytes or in a session that was opened anew; so does a run by segments (``segments``). The first two are equal bit
for bit, the third but for the order of sums. Limit, set before the runs: that of ``test_communication``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.variables import CAUSAL, LINE, RATE
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import half_sine

from . import test_driven as driven
from . import test_ports as ports
from .scenes import blocks
from .segments import Segments
from .test_communication import LIMIT, WITHOUT_INERTIA, peaks_apart

STEPS = 14
GRADIENTS = 1e-6  # that the solution by conjugate gradients leaves of round-off
PRESS = {"press": (0.1, 1.0)}
LONG = {"end": 60e-6, "step": 0.2e-6}


def smooth_blocks(**changes: Any) -> Scene:
    """The two blocks without friction and without energies: tangential velocities come from the bodies."""
    joint = {"sides": ["lower.zmax", "upper.zmin"]}
    return blocks(interface={"crush": joint}, output={}, time=LONG, **changes)


def held_blocks() -> Scene:
    """Without inertia; no load but the one from outside, so that steps of any length have their place in time."""
    scene = blocks().model_dump()
    base = {"type": "fixed", "face": "lower.zmin"}
    held = {"type": "fixed", "face": "upper.xmax", "components": ["x", "y"]}
    time = {"end": 1.0, "instants": 30, "quasi_static": True}
    load = {"press": scene["load"]["press"]}
    return blocks(time=time, boundary={"base": base, "held": held}, output={}, load=load)


def wave_bar() -> Scene:
    port = {"face": "bar.zmax", "causality": "wave", "components": ["z"], "impedance": [0.7 * ports.Z]}
    return ports.bar(20, 400, port={"foot": port}, output={"energy": False})


def moved_bar() -> Scene:
    """A bar by the explicit march, whose end is moved: its force is a mean over two time steps."""
    port = {"face": "bar.zmax", "causality": "motion_in", "components": ["z"]}
    return ports.bar(10, 200, propagator="explicit", port={"foot": port}, output={"energy": True})


def on_layer(law: Any) -> Scene:
    """A bar on moving ground with an elastic layer between, which starts from the acceleration of the ground."""
    layer = {"behaviour": "elastic_layer", "normal_stiffness": 4500.0, "tangential_stiffness": 1500.0}
    return driven.bars(law, "ground", layer)


FREE: dict[str, Any] = {"load": {"press": {"face": "upper.zmax", "pressure": 100e6, "law": {"type": "input"}}}}
WALKS: Mapping[str, tuple[Any, Mapping[str, tuple[float, float]], float]] = {
    "blocks": (lambda: blocks(time=LONG), PRESS, LIMIT),
    "free load": (lambda: blocks(time=LONG, output={"energy": False}, **FREE), PRESS, LIMIT),
    "smooth": (smooth_blocks, PRESS, LIMIT),
    "fields": (lambda: blocks(time=LONG, output={"fields": True, "every": 2, "energy": True}), PRESS, LIMIT),
    "reduced": (lambda: blocks(time=LONG, solver={"propagator": {"type": "reduced", "modes": 20}}), PRESS, LIMIT),
    "explicit": (lambda: blocks(time={"end": 20e-6, "step": 0.1e-6}, solver={"propagator": "explicit"}), PRESS, LIMIT),
    "gradients": (lambda: blocks(time=LONG, solver={"propagator": "cg"}), PRESS, GRADIENTS),
    "moved": (moved_bar, {"port.foot.velocity[3]": (0.0, 0.05)}, LIMIT),
    "held": (held_blocks, PRESS, WITHOUT_INERTIA),
    "layer": (lambda: on_layer({"type": "input"}), {"ground.wall": (0.0, 0.05)}, LIMIT),
    "layer by law": (lambda: on_layer(half_sine(0.25)), {}, LIMIT),
    "wave": (wave_bar, {"port.foot.incident[3]": (-1.0, 1.0)}, LIMIT),
    **{
        kind: (lambda kind=kind: driven.bars({"type": "input"}, kind), {driven.name_of(kind): (0.0, 0.05)}, LIMIT)
        for kind in driven.KINDS
    },
}


class Walk:
    """The two sessions and the segments, and their rows."""

    def __init__(self, scene: Scene, inputs: Mapping[str, tuple[float, float]], seed: int, keep: bool) -> None:
        self.draw, self.inputs, self.scene = np.random.default_rng(seed), inputs, scene
        self.settings = Settings(interpolation=(CAUSAL, RATE, LINE)[seed % 3], keep=keep)
        self.dt, self.t = scene.time.time_step, (0.0, 3.0 * scene.time.time_step)[seed % 2]
        self.sessions = [Session(scene, self.settings) for _ in range(2)]
        self.known = Segments(scene, self.settings.interpolation)
        for name in inputs:
            self.known.loads.set(name, 0.0)
            for session in self.sessions:
                session.set_load(name, 0.0)
        self.known.initialize(self.t)
        for session in self.sessions:
            session.initialize(self.t)
        self.rows: list[list[np.ndarray]] = [[], []]
        self.start, self.straight = self.t, inputs is PRESS  # a load along N alone

    def give(self, sessions: list[Session], known: Segments | None = None) -> None:
        for name, (low, high) in self.inputs.items():
            value = float(self.draw.uniform(low, high))
            rate = float(self.draw.choice([0.0, (high - low) / (5.0 * self.dt)])) if self.draw.random() < 0.3 else 0.0
            for session in sessions:
                session.set_load(name, value, rate)
            if known is not None:
                known.loads.set(name, value, rate)

    def size(self) -> float:
        """Of a step: one time step, several, more than one call of the kernels makes, or none of them."""
        parts = self.draw.choice([1.0, 1.0, 1.0, 3.0, 8.0, 0.37], p=[0.3, 0.2, 0.1, 0.2, 0.1, 0.1])
        return float(parts) * self.dt

    def stray(self) -> None:
        """Steps of the second session that are taken back."""
        other = self.sessions[1]
        saved = other.snapshot()
        loads = [(name, *other.load(name)) for name in self.inputs]
        for _ in range(int(self.draw.integers(0, 3))):
            self.give([other])
            other.step(other.time, self.size())  # without inertia it may be refused
        if self.draw.random() < 0.3:
            other = self.sessions[1] = Session(self.scene, self.settings)
        elif self.draw.random() < 0.2:
            other.reset()
        other.restore(saved, check=True)
        assert [(name, *other.load(name)) for name in self.inputs] == loads

    def step(self) -> None:
        if self.draw.random() < 0.5:
            self.stray()
        self.give(self.sessions, self.known)
        h = self.size()
        reports, trouble = [session.step(self.t, h) for session in self.sessions], self.known.step(self.t, h)
        assert {report.accepted for report in reports} == {not trouble}, [trouble, *(r.message for r in reports)]
        self.t = self.t + h * reports[0].accepted
        straight, other = (session.row for session in self.sessions)
        assert np.array_equal(straight, other)
        self.rows[0].append(self.known.row)
        self.rows[1].append(straight)

    def assert_agrees(self, limit: float) -> None:
        straight, other = self.sessions
        known, got = (np.array(rows) for rows in self.rows)
        apart = peaks_apart(straight.table, known, got, self.t - self.start)
        if self.straight:  # the instant of a slip follows from |T| / N, and this resultant T is round-off
            apart = {name: value for name, value in apart.items() if not name.endswith(".lastSlip")}
        worst = max(apart, key=lambda name: apart[name])
        assert apart[worst] <= limit, (worst, apart[worst])
        known_fields, own_fields = self.known.histories, straight.window()[1]
        for field in ("traction", "velocity", "gap", "contact_status"):
            values = {n: f for n, h in known_fields.items() if (f := getattr(h, field)) is not None}
            scale = max((np.abs(f).max(initial=0.0) for f in values.values()), default=0.0)
            for name, kept in values.items():
                mine = getattr(own_fields[name], field)
                assert mine.shape == kept.shape
                assert np.abs(mine - kept).max(initial=0.0) <= limit * scale + 1e-15 * (field == "gap")
        if not self.settings.keep:  # else a session opened anew does not know the steps before
            assert straight.snapshot() == other.snapshot()


QUICK = [(name, i % 2, bool(i % 2)) for i, name in enumerate(WALKS)]
SLOW = [(name, seed, keep) for name in WALKS for seed in range(8) for keep in (False, True)]


@pytest.mark.parametrize(
    ("name", "seed", "keep"),
    [*QUICK, *(pytest.param(*walk, marks=pytest.mark.slow) for walk in SLOW if walk not in QUICK)],
)
def test_a_random_walk_is_that_of_segments(name, seed, keep):
    make, inputs, limit = WALKS[name]
    walk = Walk(make(), inputs, seed, keep)
    for _ in range(STEPS):
        walk.step()
    walk.assert_agrees(limit)


def test_a_step_beyond_the_laws_of_the_scene_is_made():
    """Their tables end with the scene, and are made anew beyond."""
    walk = Walk(blocks(), PRESS, 0, False)
    for _ in range(34):
        walk.give(walk.sessions, walk.known)
        assert not walk.known.step(walk.t, walk.dt)
        for session in walk.sessions:
            assert session.step(walk.t, walk.dt)
        walk.t = walk.t + walk.dt
        walk.rows[0].append(walk.known.row)
        walk.rows[1].append(walk.sessions[0].row)
    walk.assert_agrees(LIMIT)
