"""What a shock test measures, as outputs: those of a run of the same scene, at every instant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session
from latin_fmu.cosim.output_table import base_of
from latin_fmu.results.filters import low_pass
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import half_sine
from tests.verification.bolted_meshes import write_joint
from tests.verification.test_bolts import moving

from .scenes import blocks

PASS = {"type": "low_pass", "cutoff": 4e5, "order": 5, "phaseless": False}
SENSORS = {
    "head": {"substructure": "upper", "point": [0.005, 0.005, 0.02], "filter": PASS},
    "joint": {"face": "upper.zmin", "filter": {"type": "low_pass", "cutoff": 4e5}},
}
SHAKEN = {"type": "acceleration", "face": "lower.zmin", "components": ["x", "z"], "value": [2e5, -4e5]}
TIME = {"end": 6e-6, "step": 0.05e-6}
BASE = SHAKEN | {"law": half_sine(5e-6)}
HIT = {"type": "table", "times": [0.0, 4e-6], "values": [0.7, 0.0]}  # at once, so that filters begin with it


def shaken(**changes: Any) -> Scene:
    """The blocks on a base that is shaken along two axes, with a hit from above."""
    tables = blocks().tables()
    press = tables["load"]["press"] | {"law": HIT}
    given = {"boundary": {"base": BASE}, "sensor": SENSORS, "load": {"press": press}, "output": {}, "time": TIME}
    return blocks(**given | changes)


def outputs_of(scene: Scene) -> dict[str, np.ndarray]:
    """Outputs at the instants of the scene, vectors by their stem."""
    session, n, dt = Session(scene), scene.time.n_step, scene.time.time_step
    session.initialize()
    rows = [session.row.copy()]
    for i in range(n):
        assert session.step(i * dt, dt)
        rows.append(session.row.copy())
    columns = dict(zip(session.outputs, np.transpose(rows), strict=True))
    stems = dict.fromkeys(name[:-3] for name in columns if name.endswith("[2]"))
    vectors = {s: np.stack([columns[f"{s}[{k}]"] for k in (1, 2, 3) if f"{s}[{k}]" in columns], axis=1) for s in stems}
    return columns | vectors


def largest(values: np.ndarray) -> np.ndarray:
    """Largest length so far of vectors (n, k), or of numbers (n,)."""
    return np.maximum.accumulate(np.linalg.norm(values.reshape(len(values), -1), axis=1))


def near(found: np.ndarray, wanted: np.ndarray) -> None:
    assert np.abs(wanted).max() > 0.0
    assert np.abs(found - wanted).max() <= 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize(
    "changes",
    [{}, {"solver": {"tolerance": 1e-10, "propagator": "explicit"}}, {"time": TIME | {"scheme": "massless_contact"}}],
    ids=["default", "explicit", "massless"],
)
def test_motions_are_those_of_a_run(changes):
    """Of sensors, on nodes without mass and by explicit schemes, too; those of the base are of a sensor on it."""
    changes = {"solver": {"tolerance": 1e-10}} | changes
    scene = shaken(**changes)
    run = latin_fmu.solve(shaken(**changes, sensor=SENSORS | {"base": {"face": "lower.zmin"}}))
    found, base = outputs_of(scene), run.sensors["base"]
    assert run.converged
    for name in SENSORS:
        history = run.sensors[name]
        for what in ("displacement", "velocity", "acceleration"):
            values, own = getattr(history, what), f"sensor.{name}."
            near(found[f"{own}{what}"], values)
            near(found[f"{own}largest{what.capitalize()}"], largest(values))
            if what != "acceleration":
                near(found[f"{own}relative{what.capitalize()}"], values - getattr(base, what))
        near(found[f"{own}largestRelativeDisplacement"], largest(history.displacement - base.displacement))
    behind = low_pass(run.sensors["head"].acceleration, scene.sensor["head"].filter, scene.time.time_step)
    near(found["sensor.head.accelerationFiltered"], behind)
    # forwards and backwards: what follows is not known
    assert "sensor.joint.accelerationFiltered" not in found
    force = run.interfaces["crush"].force()
    near(found["interface.crush.largestForce"], largest(force))


FIXED = {"type": "fixed", "face": "lower.zmin"}


@pytest.mark.parametrize(
    ("boundary", "base"),
    [
        ({"a": FIXED}, None),
        ({"a": BASE}, "lower.zmin"),
        ({"a": BASE, "b": BASE | {"face": "upper.zmax"}}, "lower.zmin"),
        ({"a": BASE, "b": BASE | {"face": "upper.zmax", "value": [2e5, -3e5]}}, None),
        ({"a": BASE, "b": FIXED | {"face": "upper.zmax", "components": ["y"]}}, "lower.zmin"),
        ({"a": BASE, "b": FIXED | {"face": "upper.zmax", "components": ["z"]}}, None),
        ({"a": SHAKEN | {"law": "input"}}, "lower.zmin"),
        ({"a": SHAKEN | {"law": "input"}, "b": SHAKEN | {"face": "upper.zmax", "law": "input"}}, None),
    ],
)
def test_a_base_moves_everything_that_is_held_along_its_axes(boundary, base):
    scene = shaken(boundary=boundary)
    assert base_of(scene) == base
    names = [name for name in Session(scene).outputs if "relative" in name and name.startswith("sensor")]
    assert bool(names) == (base is not None)


def test_without_inertia_there_is_no_acceleration():
    scene = blocks(time={"end": 6e-6, "step": 2e-6, "quasi_static": True}, output={})
    names = Session(scene).outputs
    assert "sensor.head.largestDisplacement" in names
    assert not [name for name in names if "cceleration" in name]


def test_resultants_of_a_shank_are_those_at_its_cut(tmp_path: Path):
    """A plate that is pushed sideways bends and shears its bolt."""
    tables = moving(write_joint(tmp_path), pull=1000.0, instants=12)
    tables["load"]["pull"]["traction"][0] = 4.0 * tables["load"]["pull"]["traction"][2]
    scene = latin_fmu.scene_from_dict(tables)
    bolt, found = latin_fmu.solve(scene).bolts["b"], outputs_of(scene)
    row = bolt.sections.number("cut")
    force, moment = bolt.section_force[:, row], bolt.section_moment[:, row]
    wanted = {"force": force[:, 0], "shearForce": force[:, 1:], "bendingMoment": moment[:, 1:], "torsion": moment[:, 0]}
    for name, values in wanted.items():
        size = np.abs(force if name.endswith("orce") else moment).max()
        assert np.abs(found[f"bolt.b.{name}"] - values).max() <= 1e-6 * size
        assert name == "torsion" or np.abs(values).max() > 1e-2 * size
    for name in ("force", "shearForce", "bendingMoment"):
        near(found[f"bolt.b.largest{name[0].upper()}{name[1:]}"], largest(found[f"bolt.b.{name}"]))


def test_a_state_has_the_filter_and_the_largest_so_far():
    """And a simulation begins without them."""
    session, h, rows = Session(shaken()), 0.5e-6, []
    for begun in (False, True):
        if begun:
            session.reset()
        session.initialize()
        for i in range(4):
            assert session.step(i * h, h)
        kept = session.snapshot()
        for _ in range(2):
            session.restore(kept)
            for i in range(4, 9):
                assert session.step(i * h, h)
            rows.append(session.row.tobytes())
    assert len(set(rows)) == 1
