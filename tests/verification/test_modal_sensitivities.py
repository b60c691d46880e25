"""Derivatives of runs that are marched by the modes of their assembly, against central differences of such runs and
against the derivatives of the march of the bodies."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import load_scene, scene_from_dict
from latin_fmu.api import solve
from latin_fmu.effects import cost
from latin_fmu.errors import SceneError
from latin_fmu.joined import reduced_assembly
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.results.sensitivities import scalars_of
from latin_fmu.results.sensors import spectra_of
from latin_fmu.results.solution import Solution
from latin_fmu.scene.schema import Scene
from latin_fmu.sensitivities import spanned_recorder, tangents
from latin_fmu.sensitivities.tangents import value_of
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import MODELS
from tests.verification.test_modal_march import HIGHEST, PLATE, PRESS, SHAKE, damped, damped_by_ratios, lap

STEP = 1e-5
OF_DAMPING = 1e-2  # changes what the runs do so little that round-off is as large for less
TIGHT = {"tolerance": 1e-10, "force_tolerance": 1e-9, "propagator": {"type": "modal", "highest": HIGHEST}}
SHORT = {"end": 3e-4, "step": 2e-6, "start": "static"}
SPECTRUM = {"lowest": 500.0, "highest": 8000.0, "per_octave": 3}
SENSOR = {"tip": {"face": "up.xmax", "spectrum": SPECTRUM}}
CLOSE = 3e-3
OPEN = 1e-10  # changes of gaps of closed points are round-off, m
INSIDE = "shank"  # bond inside a light bolt: round-off of its accelerations is as large as a difference
FRICTION = "interface.lap.friction_coefficient"


def plates(law: dict[str, Any] | None = None, **tables: Any) -> dict[str, Any]:
    """Two plates with friction in a short run."""
    given = {"time": SHORT, "output": {"energy": True}, "sensor": SENSOR, "solver": TIGHT} | tables
    return lap(law) | given


def with_bond() -> dict[str, Any]:
    """Three plates, two of them bonded, on a shaken base."""
    plate = Box(STEEL, PLATE, (12, 4, 2))
    return column(
        {"low": plate, "up": plate, "top": plate},
        {"lap": {"friction_coefficient": 0.3}, "glue": {"behaviour": "perfect"}},
        SHORT,
        boundary={"clamp": SHAKE | {"law": {"type": "half_sine", "duration": 0.2e-3}}},
        load={"press": PRESS | {"face": "top.zmax"}},
        sensor={"tip": {"face": "top.xmax"}},
        solver=TIGHT,
    )


def bolted() -> Scene:
    """The model of a lap joint with a bolt."""
    settings = (
        'time={start="static",end=5e-5,step=1e-6}',
        'load.pull.law={type="half_sine",start=0.0,duration=6e-5}',
        'sensor.end={face="upper.upper_left"}',
        "output={}",
    )
    return load_scene(MODELS / "lap_joint/scene.toml", settings).replace("solver", TIGHT)


def viscous() -> dict[str, Any]:
    """Plates with Rayleigh damping."""
    scene = damped(plates())
    scene["material"]["steel"] |= {"rayleigh_mass": 3000.0, "rayleigh_stiffness": 4e-6, "frame": "absolute"}
    return scene


def thrown() -> dict[str, Any]:
    """The upper plate begins with a velocity, under loads that begin at once."""
    scene = plates(time=SHORT | {"start": "given"})
    scene["substructure"]["up"]["initial_velocity"] = [0.0, 0.0, -0.5]
    return scene


SOFT = {"behaviour": "soft_contact", "normal_stiffness": 1e14, "friction_coefficient": 0.3}
CASES: dict[str, tuple[Any, tuple[str, ...]]] = {
    "friction and loads": (plates(), (FRICTION, "load.press.pressure", "load.tip.force.2", "load.tip.law.duration")),
    "gap": (plates({"friction_coefficient": 0.3, "gap": 1e-6}), ("interface.lap.gap", FRICTION)),
    "damped by ratios": (damped_by_ratios(plates()), (FRICTION, "load.tip.force.2")),
    "damping by ratios": (damped_by_ratios(plates()), ("material.steel.damping_ratios.ratios.0", FRICTION)),
    "viscous damping": (viscous(), ("material.steel.rayleigh_stiffness", "material.steel.rayleigh_mass")),
    "soft contact": (plates(SOFT), ("interface.lap.normal_stiffness", FRICTION)),
    "frictionless": (plates({"friction_coefficient": 0.0}), ("load.tip.force.2",)),
    "thrown": (thrown(), ("substructure.up.initial_velocity.2", FRICTION)),
    "driven, with a bond": (with_bond(), (FRICTION, "boundary.clamp.value.2", "load.press.pressure")),
    "bolted": (bolted(), ("contact.all.friction_coefficient", "bolt.m6.force", "load.pull.traction.0")),
}


def scene_of(case: str) -> Scene:
    """The scene of a case."""
    given = CASES[case][0]
    if isinstance(given, Scene):
        return given
    return scene_from_dict(copy.deepcopy(given))


def with_derivatives(scene: Scene, parameters: tuple[str, ...], checks: str = "none") -> Solution:
    """A converged run with derivatives."""
    scene = scene.replace("output.sensitivities", list(parameters))
    solution = solve(scene.replace("output.check_sensitivities", checks))
    assert solution.converged
    assert solution.sensitivities is not None, solution.warnings
    return solution


@pytest.fixture(autouse=True)
def shapes_leave_nothing_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """What they leave out of tractions of bonds is as large as a difference."""
    monkeypatch.setattr(reduced_assembly, "_EXACT", 1e-10)
    monkeypatch.setattr(spanned_recorder, "_LEFT_OUT", 1e-10)


@cache
def differentiated(case: str) -> Solution:
    """A case with its derivatives, marched by modes."""
    solution = with_derivatives(scene_of(case), CASES[case][1])
    assert "modes of the assembly" in solution.outcome.settings["propagator"]
    return solution


def step_of(parameter: str) -> float:
    """Change of a parameter over its value in differences of runs."""
    return OF_DAMPING if parameter.startswith("material.") else STEP


@cache
def varied(case: str, parameter: str, sign: float) -> Solution:
    """A case with a parameter a little larger or smaller."""
    scene = scene_of(case)
    solution = solve(scene.replace(parameter, (1.0 + sign * step_of(parameter)) * value_of(scene, parameter)))
    assert solution.converged
    return solution


def apart(exact: np.ndarray, found: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(exact - found).max() / np.abs(exact).max(initial=1e-300))


PAIRS = [(case, parameter) for case, (_, parameters) in CASES.items() for parameter in parameters]
# a quarter of them in quick runs of the tests
QUICK = [pair for pair in PAIRS[::4] if pair[0] != "bolted"]
SLOW = [pytest.param(*pair, marks=pytest.mark.slow) for pair in PAIRS if pair not in QUICK]


@pytest.mark.parametrize(("case", "parameter"), [*QUICK, *SLOW])
def test_derivatives_are_differences_of_runs(case: str, parameter: str) -> None:
    """Histories of interfaces, bonds among them, sensors and bolts."""
    found = differentiated(case).sensitivities
    assert found is not None
    change = next(d for d in found.derivatives if d.name == parameter)
    more, less = (varied(case, parameter, sign) for sign in (1.0, -1.0))
    assert change.interfaces
    assert change.sensors
    for name, history in change.interfaces.items():
        runs = more.interfaces[name], less.interfaces[name]
        if name == INSIDE:
            continue
        if history.contact_status is None:
            # tractions of its points have round-off of single precision
            assert apart(slope(parameter, *(h.force() for h in runs)), history.force()) < CLOSE
            continue
        assert apart(slope(parameter, *(h.traction for h in runs)), history.traction) < CLOSE
        assert apart(slope(parameter, *(h.velocity[:, 0] - h.velocity[:, 1] for h in runs)), jump(history)) < CLOSE
        gaps = slope(parameter, *(h.gap for h in runs))
        if np.abs(gaps).max() > OPEN:
            assert apart(gaps, history.gap) < CLOSE
    for name, sensor in change.sensors.items():
        for key in ("displacement", "velocity", "acceleration"):
            ends = (getattr(run.sensors[name], key) for run in (more, less))
            assert apart(slope(parameter, *ends), getattr(sensor, key)) < CLOSE
    for name, bolt in change.bolts.items():
        assert apart(slope(parameter, more.bolts[name].force, less.bolts[name].force), bolt.force) < CLOSE


def slope(parameter: str, more: np.ndarray, less: np.ndarray) -> np.ndarray:
    """Central difference."""
    return (more - less) / (2.0 * step_of(parameter))


def jump(history: InterfaceHistory) -> np.ndarray:
    """Velocity of side E over that of E'."""
    return history.velocity[:, 0] - history.velocity[:, 1]


@pytest.mark.parametrize(("case", "parameter"), [*QUICK, *SLOW])
def test_scalars_are_differences_of_runs(case: str, parameter: str) -> None:
    """Those that are not flagged, to a per cent of the change or a thousandth of the value."""
    solution, scene = differentiated(case), scene_of(case)
    found = solution.sensitivities
    assert found is not None
    number = [d.name for d in found.derivatives].index(parameter)
    runs = [varied(case, parameter, sign) for sign in (1.0, -1.0)]
    more, less = (scalars_of(run.outcome, spectra_of(run.outcome, scene.sensor)) for run in runs)
    compared = 0
    for q in found.quantities:
        if q.flagged[number] or q.quantity not in more or q.quantity.startswith(INSIDE):
            continue
        difference = (more[q.quantity] - less[q.quantity]) / (2.0 * step_of(parameter))
        assert abs(q.changes[number] - difference) <= 0.01 * abs(difference) + 1e-3 * abs(q.value), q.quantity
        compared += 1
    assert compared > 0


@pytest.mark.parametrize(
    "case", ["friction and loads", "damped by ratios", pytest.param("bolted", marks=pytest.mark.slow)]
)
def test_derivatives_of_both_marches_agree(case: str) -> None:
    """As far as steps and modes allow: displacements, and forces and tensions by what presses the joint."""
    modes = differentiated(case).sensitivities
    bodies = with_derivatives(scene_of(case).replace("solver.propagator", "direct"), CASES[case][1]).sensitivities
    assert modes is not None
    assert bodies is not None
    for first, second in zip(bodies.derivatives, modes.derivatives, strict=True):
        for name, sensor in first.sensors.items():
            assert apart(sensor.displacement, second.sensors[name].displacement) < 0.03
        if first.name in ("load.press.pressure", "bolt.m6.force"):
            for name, bolt in first.bolts.items():
                assert apart(bolt.force, second.bolts[name].force) < 0.01
            for name, history in first.interfaces.items():
                assert apart(history.force(), second.interfaces[name].force()) < 0.03


MODULUS = "material.steel.young_modulus"


def test_derivatives_by_matrices_are_refused_with_modes() -> None:
    scene = scene_of("friction and loads").replace("output.sensitivities", [FRICTION, MODULUS])
    with pytest.raises(SceneError, match="take the march of the bodies") as raised:
        solve(scene)
    (problem,) = raised.value.problems
    assert problem.value == MODULUS
    assert "friction" in str(problem.allowed)
    assert "automatic" in str(problem.remedy)


@pytest.mark.parametrize(("parameters", "by_modes"), [((FRICTION,), True), ((FRICTION, MODULUS), False)])
def test_the_choice_follows_the_parameters(
    parameters: tuple[str, ...], by_modes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By itself the program marches the bodies where a parameter changes matrices, and says so."""
    monkeypatch.setattr(cost, "PAYS", 0.0)
    scene = scene_of("damped by ratios").replace("solver", {"tolerance": 1e-5, "reduction_error": 0.9})
    solution = with_derivatives(scene, parameters)
    assert (solution.truncation is not None) is by_modes
    remarks = [text for text in solution.warnings if "marched body by body" in text]
    assert [MODULUS in text for text in remarks] == [True] * (not by_modes)


def test_checks_are_runs_by_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the set-up of the run, with the secant of a larger parameter."""
    found = []
    lowest = reduced_assembly.lowest
    monkeypatch.setattr(reduced_assembly, "lowest", lambda *args: found.append(1) or lowest(*args))
    sensitivities = with_derivatives(scene_of("damped by ratios"), (FRICTION,), "all").sensitivities
    assert sensitivities is not None
    assert sensitivities.tried == (FRICTION,)
    assert len(found) == 1


@pytest.mark.slow
def test_calibration_is_marched_by_modes_on_one_set_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """By friction and damping, from the velocity of a run: every run has derivatives, and modes are looked for once."""
    monkeypatch.setattr(cost, "PAYS", 0.0)
    friction, ratio = "interface.lap.friction_coefficient", "material.steel.damping_ratios.ratios"
    solver = {"tolerance": 1e-6, "reduction_error": 0.9}
    scene = scene_of("damping by ratios").replace("solver", solver).replace("output", {})
    truth = solve(scene)
    data = tmp_path / "measured.csv"
    table = np.column_stack([truth.time, truth.sensors["tip"].velocity[:, 2]])[::3]
    np.savetxt(data, table, delimiter=",", header="time,tip.velocity.z", comments="")
    found, runs = [], []
    lowest, marched = reduced_assembly.lowest, tangents.marched_by_modes
    monkeypatch.setattr(reduced_assembly, "lowest", lambda *args: found.append(1) or lowest(*args))
    monkeypatch.setattr(tangents, "marched_by_modes", lambda *args: runs.append(1) or marched(*args))
    made = latin_fmu.calibrate(scene, data, [f"{friction}=0.25", f"{ratio}.0,{ratio}.1=0.04"], estimate=False)
    assert made.converged
    assert made[friction].value == pytest.approx(0.3, rel=0.01)
    assert len(found) == 1
    assert len(runs) == made.runs
