"""What ``explain`` suggests and what warnings advise, followed: as cheap as predicted, with the stated loss."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import build, discretise
from latin_fmu.effects.explanation import LUMPED, Suggestion, explain
from latin_fmu.reader import load_scene, scene_from_dict
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine
from tests.scenes import MINUTES, MODELS, solved

SHIPPED = sorted({path.parent.name for path in MODELS.glob("*/scene.toml")} - {*MINUTES})
QUICK = [pytest.param(name, marks=pytest.mark.slow) if name == "lap_joint" else name for name in SHIPPED]
OTHER_RESULT = {LUMPED: 0.05}
"""Relative change of impulse and peak force by what is lost; nothing for what concerns stored quantities only."""


def model(name: str, settings: tuple[str, ...] = ()) -> Scene:
    return load_scene(MODELS / name / "scene.toml", list(settings))


def suggestions(name: str) -> list[Suggestion]:
    return explain(model(name)).suggestions


def forces(solution: latin_fmu.Solution) -> np.ndarray:
    """Impulse and largest mean force of every interface."""
    report = solution.report()["interfaces"].values()
    return np.array([value for i in report for value in (*i["impulse"], i["peak_force"])])


@pytest.mark.parametrize("name", QUICK)
def test_suggestions_of_shipped_models_are_accepted_and_keep_their_word(name: str) -> None:
    made = suggestions(name)
    plain = forces(solved(f"{name}/scene")) if made else np.zeros(0)
    for suggestion in made:
        assert suggestion.settings or "can be omitted" in suggestion.what
        assert suggestion.factor is None or suggestion.factor < 0.95
        changed = latin_fmu.solve(model(name, suggestion.settings))
        assert changed.converged, changed.status
        allowed = OTHER_RESULT.get(suggestion.loss, 1e-9)
        assert np.abs(forces(changed) - plain).max() <= allowed * np.abs(plain).max(), suggestion


def cpu(scene: Scene) -> float:
    """CPU seconds of the fastest of three runs."""
    seconds = []
    for _ in range(3):
        start = time.process_time()
        latin_fmu.solve(scene)
        seconds.append(time.process_time() - start)
    return min(seconds)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_suggestions_of_shipped_models_cost_what_they_say(name: str) -> None:
    for suggestion in suggestions(name):
        if suggestion.factor is not None:
            measured = cpu(model(name, suggestion.settings)) / cpu(model(name))
            assert 1 / 1.5 <= measured / suggestion.factor <= 1.5, (suggestion, measured)


@pytest.mark.parametrize("name", QUICK)
def test_the_switch_of_a_gap_is_accepted(name: str) -> None:
    """On meshes that stand apart a gap of zero is refused: it is switched off as closed."""
    effect = next(e for e in explain(model(name)).effects if e.name == "initial gap")
    if effect.on:
        value = effect.switch.removeprefix("gap = ")
        discretise(model(name, tuple(f"{key}={value}" for key in effect.why)))


# -- other scenes -------------------------------------------------------------------------------------------------
def rod(**changes: Any) -> dict[str, Any]:
    """A block struck on another, finely meshed along one direction."""
    block = Box(STEEL, (0.02, 0.02, 0.02), (8, 8, 8))
    made = column(
        {"a": block, "b": block},
        {"meet": {"friction_coefficient": 0.2}},
        {"end": 4e-5, "instants": 100},
        boundary={"base": {"type": "fixed", "face": "a.zmin"}},
        load={"push": {"face": "b.zmax", "pressure": 1e8, "law": half_sine(1e-5)}},
    )
    return made | changes


def of_kind(scene: dict[str, Any], word: str) -> list[Suggestion]:
    return [s for s in explain(scene_from_dict(scene)).suggestions if word in " ".join(s.settings)]


def test_an_explicit_march_is_suggested_with_a_stable_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step longer than the stable one is cut; one much longer brings no suggestion, whatever it would save."""
    monkeypatch.setattr("latin_fmu.effects.explanation.CHEAP", 100.0)
    for instants, expected in ((240, False), (60, True), (3, None)):
        scene = rod(time={"end": 4e-5, "instants": instants})
        made = of_kind(scene, "explicit")
        if expected is None:
            assert not made
            continue
        assert len(made) == 1
        assert any("time.instants" in s for s in made[0].settings) is expected
        for setting in made[0].settings:
            key, _, value = setting.partition("=")
            table, _, last = key.partition(".")
            scene.setdefault(table, {})[last] = int(value) if value.isdigit() else value
        build(scene_from_dict(scene))


def test_nothing_rigid_where_an_equilibrium_is_sought() -> None:
    scene = rod()
    scene["material"]["rubber"] = {"young_modulus": 1e3, "poisson_ratio": 0.3, "density": 1000.0}
    scene["substructure"]["b"]["material"] = "rubber"
    assert of_kind(scene, "rigid")
    scene["time"]["start"] = "static"
    assert not of_kind(scene, "rigid")
    effects = {e.name: e for e in explain(scene_from_dict(scene)).effects}
    assert "rigid = true" not in effects["elastic bodies"].switch


def test_slow_loads_are_followed_without_inertia() -> None:
    """The suggested run is accepted and follows the load; a body that nothing holds brings no suggestion."""
    scene = rod()
    scene["time"] = {"end": 2e-3, "instants": 200}
    scene["load"]["push"]["law"] = half_sine(2e-3)
    (made,) = of_kind(scene, "quasi_static")
    assert made.loss
    scene["time"] |= {"quasi_static": True, "instants": int(made.settings[1].partition("=")[2])}
    solution = latin_fmu.solve(scene_from_dict(scene))
    assert solution.converged
    assert solution.interfaces["meet"].normal_resultant().max() == pytest.approx(1e8 * 0.02**2, rel=1e-2)
    scene = rod(boundary={})
    scene["time"] = {"end": 2e-3, "instants": 200}
    scene["load"]["push"]["law"] = half_sine(2e-3)
    assert not of_kind(scene, "quasi_static")


# -- warnings -----------------------------------------------------------------------------------------------------
def warnings(scene: dict[str, Any], word: str) -> list[str]:
    return [w for w in build(scene_from_dict(scene)).warnings if word in w]


def test_a_body_too_stiff_in_bending_is_cured_by_its_setting() -> None:
    scene = rod(interface={})
    scene["substructure"] = {"a": scene["substructure"]["a"]}
    scene["substructure"]["a"]["box"] |= {"size": [0.2, 0.02, 0.005], "elements": [8, 2, 1]}
    scene["load"]["push"]["face"] = "a.zmax"
    (warning,) = warnings(scene, "too stiff")
    assert "set substructure.a.bending_modes" in warning
    scene["substructure"]["a"]["bending_modes"] = True
    assert not warnings(scene, "too stiff")


def test_a_law_between_instants_is_cured_by_its_instants() -> None:
    scene = rod(time={"end": 4e-5, "instants": 30})
    scene["load"]["push"]["law"] = {"type": "rectangular_pulse", "duration": 1e-5}
    (warning,) = warnings(scene, "time integral")
    assert "place the jumps at ends of steps" in warning
    scene["time"]["instants"] = 40
    assert not warnings(scene, "time integral")


def test_a_mesh_too_coarse_for_the_step_is_cured_by_the_mesh() -> None:
    scene = rod(time={"end": 1e-6, "instants": 100, "scheme": "hht"})
    coarse = warnings(scene, "too coarse for this step")
    assert len(coarse) == 1  # one line for both sides
    assert all("refine the mesh there (a smaller step alone does not help)" in w for w in coarse)
    for name in "ab":
        scene["substructure"][name]["box"]["elements"] = [1, 1, 200]
    assert not warnings(scene, "too coarse for this step")
