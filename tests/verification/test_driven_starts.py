"""Faces that are held or driven start where their bodies are, and as fast as these, or are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.api import check
from latin_fmu.cosim import Session
from latin_fmu.errors import InputError, SceneError

OFFSET = 0.2e-3
BUMP = {"type": "table", "times": [0.0, 4e-4, 6e-4, 8e-4], "values": [OFFSET, OFFSET, 1.25 * OFFSET, OFFSET]}
SCHEMES = ["hht", "newmark", "generalized_alpha", "massless_contact", "central_difference"]


def column(boundary: dict[str, Any], **keys: Any) -> dict[str, Any]:
    """A plastic column with a condition at its foot; ``keys`` of its substructure, or of the scene."""
    box = {"size": [0.02, 0.02, 0.1], "elements": [1, 1, 8]}
    body = {key: keys.pop(key) for key in list(keys) if key.startswith("initial_")}
    foot = {"face": "column.zmin", **boundary}
    return {
        "name": "column",
        "material": {"plastic": {"young_modulus": 2e9, "poisson_ratio": 0.35, "density": 1200.0}},
        "substructure": {"column": {"material": "plastic", "box": box, **body}},
        "boundary": {"base": foot},
        "sensor": {"top": {"face": "column.zmax"}},
        "time": {"end": 8e-4, "step": 4e-6},
        "output": {"fields": True},
        **keys,
    }


def driven(kind: str, value: float, law: Any = "constant") -> dict[str, Any]:
    return {"type": kind, "components": ["x", "y", "z"], "value": [0.0, 0.0, value], "law": law}


def problem_of(scene: dict[str, Any]) -> Any:
    with pytest.raises(SceneError) as caught:
        check(latin_fmu.scene_from_dict(scene))
    (problem,) = caught.value.problems
    return problem


def motion(scene: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instants, displacements and velocities along z of all nodes."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(scene))
    history = solution.outcome.substructures["column"]
    return solution.outcome.time, history.displacement[..., 2], history.velocity[..., 2]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_record_with_an_offset_is_refused(scheme: str) -> None:
    time = {"end": 8e-4, "step": 4e-6, "scheme": scheme}
    problem = problem_of(column(driven("displacement", 1.0, BUMP), time=time))
    assert problem.where == "boundary.base"
    assert "0.0002 m away from where column is" in problem.what
    for remedy in ("subtract the value at t = 0", "initial_displacement", 'time.start = "static"'):
        assert remedy in problem.remedy


@pytest.mark.parametrize("remedy", ["subtracted", "displaced", "static"])
def test_its_remedies_leave_the_top_at_rest_until_the_bump(remedy: str) -> None:
    law = dict(BUMP)
    keys: dict[str, Any] = {}
    if remedy == "subtracted":
        law["values"] = [value - OFFSET for value in law["values"]]
    elif remedy == "displaced":
        keys = {"initial_displacement": [0.0, 0.0, OFFSET]}
    else:
        keys = {"time": {"end": 8e-4, "step": 4e-6, "start": "static"}}
    time, u, v = motion(column(driven("displacement", 1.0, law), **keys))
    before = time < 3.9e-4
    assert np.abs(v[before]).max() < 1e-7 * np.abs(v).max()
    assert np.ptp(u[before]) < 1e-9 * OFFSET
    assert np.ptp(u) > 0.25 * OFFSET


def test_a_base_that_starts_faster_than_its_body_is_refused() -> None:
    problem = problem_of(column(driven("velocity", 2.0)))
    assert problem.where == "boundary.base"
    assert "they differ by 2 m/s" in problem.what
    assert "initial_velocity" in problem.remedy
    assert 'law = "step"' in problem.remedy


@pytest.mark.parametrize("kind", ["displacement", "velocity"])
def test_a_body_that_starts_faster_than_its_base_is_refused(kind: str) -> None:
    law = {"type": "half_sine", "start": 1e-4, "duration": 2e-4}
    problem = problem_of(column(driven(kind, 1e-3, law), initial_velocity=[0.0, 0.0, 3.0]))
    assert problem.where == "boundary.base"
    assert "they differ by 3 m/s" in problem.what


@pytest.mark.parametrize("kind", ["velocity", "displacement"])
def test_a_body_as_fast_as_its_base_keeps_its_velocity(kind: str) -> None:
    law = "constant" if kind == "velocity" else {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    _, _, v = motion(column(driven(kind, 2.0, law), initial_velocity=[0.0, 0.0, 2.0]))
    assert np.abs(v[:-1] - 2.0).max() < 1e-9


PULSE = {"type": "half_sine", "duration": 4e-4}
INCLINED = {"x": [0.0, 0.6, 0.8], "y": [0.0, -0.8, 0.6]}
PROPAGATORS: dict[str, dict[str, Any]] = {
    "direct": {},
    "cg": {"solver": {"propagator": "cg"}},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 8}}},
    "explicit": {"time": {"end": 8e-4, "step": 2e-6, "scheme": "central_difference"}},
}


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("axes", [None, INCLINED])
@pytest.mark.parametrize("propagator", list(PROPAGATORS))
def test_an_accelerated_base_starts_as_fast_as_its_body(propagator: str, axes: Any, rigid: bool) -> None:
    """In a frame that moves with the body it is the run from rest."""
    shaken = driven("acceleration", 2e4, PULSE) | ({} if axes is None else {"axes": axes})
    if axes is not None:
        shaken |= {"components": ["x"], "value": [2e4]}
    fast = [0.0, 1.5, 2.0]
    runs = []
    for keys in ({}, {"initial_velocity": fast}, {"motion": {"velocity": fast}}):
        scene = column(shaken, **keys, **PROPAGATORS[propagator])
        scene["substructure"]["column"]["rigid"] = rigid and propagator == "direct"
        runs.append(latin_fmu.solve(latin_fmu.scene_from_dict(scene)))
    still, *others = (run.outcome.substructures["column"] for run in runs)
    for history in others:
        away = history.velocity - fast - still.velocity
        assert np.abs(away).max() < 1e-8 * np.abs(still.velocity).max()


def test_a_sudden_start_is_a_step() -> None:
    """All rests at t = 0; the base is fast from the first step on, the top when the wave is there: twice as fast."""
    time, _, v = motion(column(driven("velocity", 2.0, "step")))
    assert not v[0].any()
    base, top = v.min(axis=1), v.max(axis=1)
    early, late = time < 0.3e-4, (time > 1e-4) & (time < 1.4e-4)
    assert base[1:][early[1:]].max() < 2.0
    assert top[late].mean() == pytest.approx(4.0, rel=0.1)


def test_an_initial_displacement_of_a_held_face_is_refused() -> None:
    problem = problem_of(column({"type": "fixed"}, initial_displacement=[0.0, 0.0, 1e-4]))
    assert problem.where == "substructure.column.initial_displacement"
    assert "moves nodes that are held by 0.0001 m" in problem.what
    check(
        latin_fmu.scene_from_dict(column({"type": "fixed", "components": ["x"]}, initial_displacement=[0.0, 1e-4, 0.0]))
    )


@pytest.mark.parametrize("kind", ["displacement", "velocity"])
def test_a_rigid_body_starts_with_its_base_as_well(kind: str) -> None:
    scene = column(driven(kind, 1e-3))
    scene["substructure"]["column"]["rigid"] = True
    assert problem_of(scene).where == "boundary.base"


def test_an_inclined_condition_is_compared_along_its_own_axes() -> None:
    axes = {"x": [0.0, 0.6, 0.8], "y": [0.0, -0.8, 0.6]}
    boundary = {"type": "displacement", "components": ["x"], "value": [1.0], "axes": axes, "law": BUMP}
    assert problem_of(column(boundary)).where == "boundary.base"
    check(latin_fmu.scene_from_dict(column(boundary, initial_displacement=[0.0, 0.6 * OFFSET, 0.8 * OFFSET])))


def test_a_lost_velocity_of_a_held_face_is_a_remark() -> None:
    lines = check(latin_fmu.scene_from_dict(column({"type": "fixed"}, initial_velocity=[0.0, 0.0, 3.0])))
    assert any("start with 3 m/s: their velocity is lost in the first step" in line for line in lines)


def test_a_session_refuses_the_offset_that_its_host_sets() -> None:
    session = Session(latin_fmu.scene_from_dict(column(driven("displacement", 1.0, "input"))))
    session.set_load("boundary.base", OFFSET, 0.0)
    with pytest.raises(InputError, match="away from where column is"):
        session.initialize()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_record_that_ends_with_the_run_has_no_corner_there(scheme: str) -> None:
    """Its last slope is kept up to the last instant; where the place of the face is that of the record."""
    end, step = 8e-4, 4e-6
    law = {"type": "table", "times": [0.0, 2e-4, end], "values": [0.0, 0.0, 1.0]}
    scene = column(driven("displacement", OFFSET, law), time={"end": end, "step": step, "scheme": scheme})
    scene["sensor"]["foot"] = {"face": "column.zmin"}
    foot = latin_fmu.solve(latin_fmu.scene_from_dict(scene)).sensors["foot"]
    assert foot.velocity[-1, 2] == pytest.approx(OFFSET / 6e-4, rel=1e-9)
    assert foot.displacement[-1, 2] == pytest.approx(OFFSET, rel=1e-9)


def test_a_session_ends_there_without_a_corner_too() -> None:
    end, step = 8e-4, 4e-6
    law = {"type": "table", "times": [0.0, 2e-4, end], "values": [0.0, 0.0, 1.0]}
    scene = column(driven("displacement", OFFSET, law), time={"end": end, "step": step})
    scene["sensor"]["foot"] = {"face": "column.zmin"}
    session = Session(latin_fmu.scene_from_dict(scene))
    session.initialize()
    for i in range(20):
        assert session.step(i * 4e-5, 4e-5)
    names = ["sensor.foot.displacement[3]", "sensor.foot.velocity[3]"]
    assert session.values(names) == pytest.approx([OFFSET, OFFSET / 6e-4], rel=1e-9)


def corners(scheme: str, step: float, **material: Any) -> latin_fmu.Solution:
    """A bar whose foot follows a path with a corner at an instant, one between instants, and turns back at once; a
    block on it that may lift off."""
    elastic = {"young_modulus": 70e9, "poisson_ratio": 0.3, "density": 2700.0, **material}
    box = {"size": [0.01, 0.01, 0.02], "elements": [1, 1, 3]}
    tables = {
        "name": "corners",
        "material": {"m": elastic},
        "substructure": {
            "bar": {"material": "m", "box": box},
            "block": {"material": "m", "box": box | {"origin": [0.0, 0.0, 0.02]}},
        },
        "interface": {"seat": {"behaviour": "contact", "sides": ["bar.zmax", "block.zmin"]}},
        "boundary": {
            "base": {"type": "displacement", "face": "bar.zmin", "components": ["z"], "value": [STROKE], "law": PATH}
        },
        "sensor": {"face": {"face": "bar.zmin"}},
        "time": {"end": PATH["times"][-1], "step": step, "scheme": scheme},
        "solver": {"tolerance": 1e-10, "max_iterations": 2000},
        "output": {"energy": True},
    }
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables))


PATH: dict[str, Any] = {
    "type": "table",
    "times": [0.0, 1e-4, 1.53e-4, 2e-4, 2.6e-4, 4e-4],
    "values": [0.0, 0.0, 1.0, 0.4, 0.4, 0.4],
}
STROKE = 2e-5
DAMPED = {"damping_ratios": {"frequencies": [1e3, 1e5], "ratios": [0.02, 0.02]}}
RAYLEIGH = {"rayleigh_stiffness": 1e-7, "rayleigh_mass": 50.0, "frame": "absolute"}


@pytest.mark.parametrize("material", [{}, DAMPED, RAYLEIGH], ids=["elastic", "by strain", "rayleigh"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_face_is_on_its_path_at_every_instant_and_the_energy_closes(scheme: str, material: dict[str, Any]) -> None:
    """Velocities are means of the slopes before and after; accelerations their differences, which end with the path."""
    step = 5e-7 if scheme == "central_difference" else 5e-6
    solution = corners(scheme, step, **material)
    assert solution.converged
    time, face = solution.time, solution.sensors["face"]
    place = STROKE * np.interp(time, PATH["times"], PATH["values"])
    assert face.displacement[:, 2] == pytest.approx(place, abs=1e-12 * STROKE)
    rates = np.diff(place) / step
    assert face.velocity[1:-1, 2] == pytest.approx(0.5 * (rates[:-1] + rates[1:]), abs=1e-9 * np.abs(rates).max())
    energy = solution.energy
    assert np.abs(energy["balance"]).max() < 1e-10 * np.abs(energy["work_of_loads"]).max()


@pytest.mark.parametrize("kind", ["law", "input"])
def test_a_session_has_the_face_on_its_path_too(kind: str) -> None:
    """A law of the scene to round-off; a host's values where it has set them, at the end of its steps."""
    end, step, rate = PATH["times"][-1], 5e-6, 1e-5
    law: Any = PATH if kind == "law" else "input"
    scene = column(driven("displacement", STROKE, law), time={"end": end, "step": step})
    scene["sensor"]["foot"] = {"face": "column.zmin"}
    session = Session(latin_fmu.scene_from_dict(scene))

    def place(t: float) -> float:
        return float(np.interp(t, PATH["times"], PATH["values"]))

    if kind == "input":
        session.set_load("boundary.base", place(0.0), 0.0)
    session.initialize()
    for i in range(round(end / rate)):
        if kind == "input":
            session.set_load("boundary.base", place(i * rate), (place((i + 1) * rate) - place(i * rate)) / rate)
        assert session.step(i * rate, rate)
        (found,) = session.values(["sensor.foot.displacement[3]"])
        assert found == pytest.approx(STROKE * place((i + 1) * rate), abs=1e-10 * STROKE)
