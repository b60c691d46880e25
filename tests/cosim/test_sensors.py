"""Sensors of a prescribed run: their motions are recorded, not the fields."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session, Settings

from .scenes import blocks

TIMES, VALUES = [0.0, 2e-6, 6e-6], [0.0, 1.0, 0.3]
SENSORS = {
    "head": {"substructure": "upper", "point": [0.005, 0.005, 0.02]},
    "edge": {"substructure": "upper", "point": [0.0, 0.005, 0.02]},
    "foot": {"substructure": "lower", "point": [0.005, 0.005, 0.01]},
}


def solved(output: dict[str, object]) -> Session:
    session = Session(blocks(sensor=SENSORS, output=output), Settings(mode=1))
    session.set_history("press", TIMES, VALUES)
    session.initialize()
    return session


@pytest.fixture(scope="module")
def whole() -> latin_fmu.Solution:
    """The plain run, with all fields."""
    loads = blocks().model_dump()["load"]
    law = {"type": "table", "times": TIMES, "values": VALUES}
    return latin_fmu.solve(blocks(load={**loads, "press": {**loads["press"], "law": law}}, output={"fields": True}))


@pytest.mark.parametrize(
    "output", [{}, {"energy": True}, {"fields": True, "every": 7}, {"stress": True, "every": 7}], ids=str
)
def test_sensors_are_the_fields_of_a_plain_run_at_their_nodes(output, whole):
    session = solved(output)
    assert session.step(0.0, 4.2e-6)
    for name, sensor in SENSORS.items():
        history = whole.substructures[str(sensor["substructure"])]
        node = np.argmin(np.linalg.norm(history.nodes - np.array(sensor["point"]), axis=1))
        for what in ("displacement", "velocity"):
            names = [f"sensor.{name}.{what}[{k}]" for k in (1, 2, 3)]
            assert np.array_equal(session.values(names), getattr(history, what)[21, node])


def test_only_what_the_scene_wants_is_kept(whole):
    assert "substructures" not in solved({}).dataset()
    energy = solved({"energy": True})._solver.segments[0].substructures["upper"]
    assert energy.displacement is None
    assert len(energy.energy["kinetic"]) == 31
    fields = solved({"fields": True, "every": 7})._solver.segments[0].substructures["upper"]
    assert fields.time == pytest.approx(whole.substructures["upper"].time[::7])
    assert np.array_equal(fields.velocity, whole.substructures["upper"].velocity[::7])
    stress = solved({"stress": True, "every": 7})._solver.segments[0].substructures["upper"]
    assert len(stress.stress) == len(stress.time) == 5
