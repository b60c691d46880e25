"""``explain``: every effect on or off with its reason, sizes as built, suggestions that hold, stable JSON."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from latin_fmu.building import build
from latin_fmu.cli import main
from latin_fmu.effects.explanation import Explanation, explain
from latin_fmu.effects.scene_effects import EFFECTS
from latin_fmu.reader import load_scene, scene_from_dict
from latin_fmu.scene.overrides import key_lines, line_of
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import MINUTES, MODELS

NAMES = {
    "inertia",
    "elastic bodies",
    "rigid bodies",
    "damping",
    "absorbing ends",
    "body force",
    "surface loads",
    "temperature",
    "bolts",
    "initial motion",
    "static start",
    "stiffness of stress",
    "prescribed motion",
    "unilateral contact",
    "friction",
    "initial gap",
    "perfect bond",
    "layers and joints",
    "preload",
    "interior history",
    "stress",
    "energy balance",
}


def tables() -> dict[str, Any]:
    """Two blocks in frictionless contact, one pushed: as few effects as a scene can have."""
    block = Box(STEEL, (0.01, 0.01, 0.02), (2, 2, 4))
    load = {"push": {"face": "a.zmin", "pressure": 1e6, "law": "step"}}
    return column({"a": block, "b": block}, {"meet": {}}, {"end": 1e-5, "instants": 20}, load=load)


def explained(scene: dict[str, Any]) -> Explanation:
    return explain(scene_from_dict(copy.deepcopy(scene)))


def on(explanation: Explanation) -> set[str]:
    return {e.name for e in explanation.effects if e.on}


BASE = {"inertia", "elastic bodies", "surface loads", "unilateral contact"}


def test_a_plain_scene_has_four_effects_and_every_effect_is_told() -> None:
    explanation = explained(tables())
    assert on(explanation) == BASE
    assert {e.name for e in explanation.effects} == NAMES
    assert len(EFFECTS) == len(NAMES)
    for effect in explanation.effects:
        assert all((effect.reason, effect.switch, effect.why))
        if not effect.on:
            assert (effect.unknowns, effect.kernels, effect.memory, effect.cost) == (0, (), 0, 0.0)


@pytest.mark.parametrize(
    ("path", "value", "effect"),
    [
        ("material.steel.rayleigh_stiffness", 1e-9, "damping"),
        ("substructure.a.body_force", [0.0, 0.0, 1.0], "body force"),
        ("substructure.a.initial_velocity", [0.0, 0.0, 1.0], "initial motion"),
        ("substructure.a.initial_spin", [0.0, 0.0, 1.0], "initial motion"),
        ("substructure.b.rigid", True, "rigid bodies"),
        ("interface.meet.friction_coefficient", 0.2, "friction"),
        ("interface.meet.gap", 1e-6, "initial gap"),
        ("interface.meet.preload", 1e5, "preload"),
        ("interface.meet.preload_force", 10.0, "preload"),
        ("boundary.out", {"type": "absorbing", "face": "b.zmax"}, "absorbing ends"),
        (
            "boundary.tool",
            {"type": "velocity", "face": "b.zmax", "components": ["z"], "value": [1.0], "law": "step"},
            "prescribed motion",
        ),
        ("output.fields", True, "interior history"),
        ("output.stress", True, "stress"),
    ],
)
def test_one_key_switches_one_effect(path: str, value: Any, effect: str) -> None:
    scene = tables()
    *holders, key = path.split(".")
    table = scene
    for holder in holders:
        table = table.setdefault(holder, {})
    table[key] = value
    explanation = explained(scene)
    assert on(explanation) == BASE | {effect}
    shown = next(e for e in explanation.effects if e.name == effect)
    assert any(path.startswith(why) or why.startswith(path) for why in shown.why)


def test_behaviours_are_told_apart() -> None:
    scene = tables()
    scene["interface"]["meet"]["behaviour"] = "perfect"
    assert on(explained(scene)) == BASE - {"unilateral contact"} | {"perfect bond"}
    assert "at once" in explained(scene).choices["window"]
    assert explained(scene).prediction["iterations_per_instant"] == 1.0
    scene["solver"] = {"bonds": "iterate"}
    assert "at once" not in explained(scene).choices["window"]
    scene["interface"]["meet"] |= {"behaviour": "elastic_layer", "normal_stiffness": 1e12, "tangential_stiffness": 0.0}
    assert on(explained(scene)) == BASE - {"unilateral contact"} | {"layers and joints"}
    del scene["interface"]
    assert on(explained(scene)) == BASE - {"unilateral contact"}
    assert "no interface" in explained(scene).choices["window"]


@pytest.mark.parametrize("model", ["two_specimen_crushing", "beam_in_traction", "shear_interface"])
def test_sizes_are_those_of_the_built_scene(model: str) -> None:
    scene = load_scene(MODELS / model / "scene.toml")
    explanation, assembly = explain(scene), build(scene).assembly
    assert explanation.prediction["unknowns"] == sum(p.n_dof * len(p.names) for p in assembly.propagators)
    assert explanation.prediction["interface_unknowns"] == assembly.layout.n_flat
    unknowns = {e.name: e.unknowns for e in explanation.effects}
    parts = ("unilateral contact", "friction", "perfect bond", "layers and joints")
    assert sum(unknowns[p] for p in parts) == assembly.layout.n_flat
    factors = [p.operators.factor for p in assembly.propagators]
    held = sum(f.panels.nbytes + f.symbolic.rows.nbytes + 2 * f.schur.nbytes for f in factors)
    elastic = next(e for e in explanation.effects if e.name == "elastic bodies")
    assert 0.5 * held < elastic.memory < 2.5 * held


def test_friction_counts_two_thirds_of_the_unknowns() -> None:
    scene = tables()
    scene["interface"]["meet"]["friction_coefficient"] = 0.2
    with_friction = {e.name: e for e in explained(scene).effects}
    without = {e.name: e for e in explained(tables()).effects}
    assert with_friction["friction"].unknowns == 2 * with_friction["unilateral contact"].unknowns
    assert without["unilateral contact"].unknowns == with_friction["unilateral contact"].unknowns
    assert without["friction"].unknowns == 0


@pytest.mark.parametrize(
    ("path", "value", "effect"),
    [
        ("material.steel.rayleigh_stiffness", 1e-9, "damping"),
        ("substructure.a.body_force", [0.0, 0.0, 1.0], "body force"),
        ("output.stress", True, "stress"),
        ("output.fields", True, "interior history"),
    ],
)
def test_the_cost_of_an_effect_is_the_difference_to_the_scene_without(path: str, value: Any, effect: str) -> None:
    """The cost of an effect that explain gives for one scene is the difference of the predictions of two scenes."""
    plain, scene = tables(), tables()
    *holders, key = path.split(".")
    table: Any = scene
    for holder in holders:
        table = table.setdefault(holder, {})
    table[key] = value
    with_it, without = explained(scene), explained(plain)
    cost = next(e.cost for e in with_it.effects if e.name == effect)
    difference = with_it.prediction["cpu_seconds_instant"] - without.prediction["cpu_seconds_instant"]
    assert cost > 0
    assert cost == pytest.approx(difference, rel=1e-9)
    assert next(e.cost for e in without.effects if e.name == effect) == 0.0


# -- suggestions --------------------------------------------------------------------------------------------------
def suggested(scene: dict[str, Any], word: str) -> bool:
    return any(word in s.what for s in explained(scene).suggestions)


def test_tiny_friction_is_noticed() -> None:
    scene = tables()
    for body in scene["substructure"].values():
        body["box"]["elements"] = [10, 10, 1]
    scene["time"] |= {"instants": 2000}
    scene["interface"]["meet"]["friction_coefficient"] = 1e-4
    assert suggested(scene, "friction with mu")
    scene["interface"]["meet"]["friction_coefficient"] = 0.1
    assert not suggested(scene, "friction with mu")


def test_what_saves_less_than_a_tenth_is_not_suggested() -> None:
    """Friction that changes nothing, in a scene whose time goes elsewhere."""
    scene = tables()
    scene["interface"]["meet"]["friction_coefficient"] = 1e-4
    assert not suggested(scene, "friction with mu")


def test_shares_of_time_add_up_to_one_at_most() -> None:
    """Leaving one effect out may save what another one needs, too."""
    found = explain(load_scene(MODELS / "two_specimen_crushing" / "scene.toml"))
    assert sum(e.cost for e in found.effects if e.on) > 1.05 * found.prediction["cpu_seconds_instant"]
    assert sum(e["share_of_time"] for e in found.report()["effects"]) == pytest.approx(1.0, abs=0.01)


def test_a_gap_that_cannot_close_is_noticed() -> None:
    scene = tables()
    scene["interface"]["meet"]["gap"] = 1.0
    assert suggested(scene, "cannot close")
    scene["interface"]["meet"]["gap"] = 1e-8
    assert not suggested(scene, "cannot close")
    scene["interface"]["meet"]["gap"] = 1.0
    scene["substructure"]["a"]["body_force"] = [0.0, 0.0, 1.0]
    assert not suggested(scene, "cannot close")


def test_factors_in_single_precision_are_suggested_for_large_parts() -> None:
    scene = tables()
    scene["substructure"]["a"]["box"] |= {"elements": [13, 13, 13]}
    scene["time"]["instants"] = 5000
    scene.setdefault("solver", {})["propagator"] = "direct"
    found = [s for s in explained(scene).suggestions if s.settings == ("solver.precision=float32",)]
    assert len(found) == 1
    assert "single precision" in found[0].what
    assert "balance to 1e-6" in found[0].loss
    assert found[0].factor is not None
    assert found[0].factor < 0.9
    assert not suggested(tables(), "single precision")


def test_what_could_be_rigid_is_noticed() -> None:
    scene = tables()
    scene["time"] |= {"instants": 2000}
    assert not suggested(scene, "as a rigid body")
    scene["material"]["rubber"] = {"young_modulus": 1e3, "poisson_ratio": 0.3, "density": 1000.0}
    scene["substructure"]["b"]["material"] = "rubber"
    assert suggested(scene, "substructure a: its wave impedance")
    assert not suggested(scene, "substructure b")


def test_an_equilibrium_is_no_reason_for_a_rigid_body() -> None:
    """Increments of a quasi-static run are longer than any wave transit: the joint needs its elasticity."""
    scene = tables()
    scene["time"] |= {"quasi_static": True, "end": 1.0}
    scene["interface"]["meet"]["friction_coefficient"] = 0.3
    scene["boundary"] = {"base": {"type": "fixed", "face": "b.zmax"}}
    assert not suggested(scene, "as a rigid body")


def test_costly_output_is_noticed() -> None:
    scene = tables()
    for body in scene["substructure"].values():
        body["box"]["elements"] = [5, 5, 10]
    scene["time"] |= {"instants": 2000}
    for key, name in (("stress", "stress"), ("fields", "interior history")):
        scene["output"] = {key: True}
        assert suggested(scene, f"{name} takes")


# -- words --------------------------------------------------------------------------------------------------------
def test_lines_of_keys() -> None:
    lines = key_lines('name = "x"\n\n[a.b]  # here\nc = 1\nd.e = {f = 2}\n["q"]\n')
    assert lines == {"name": 1, "a.b": 3, "a.b.c": 4, "a.b.d.e": 5, "q": 6}
    assert line_of(lines, "a.b.c") == 4
    assert line_of(lines, "a.b.d.e.f") == 5
    assert line_of(lines, "a.b.missing") is None
    assert line_of(lines, "nothing") is None
    odd = 'text = """\n[b]\nc = 1\n"""\n  [x.y]\n  z = [\n  ["q"],\n  ["r"]\n  ]\n  w = 1\n[[list]]\nc = 3\n'
    assert key_lines(odd) == {"text": 1, "x.y": 5, "x.y.z": 6, "x.y.w": 10}


@pytest.mark.parametrize(
    "path",  # those of minutes are made in tests/scene/test_remarks.py
    sorted(p for p in MODELS.glob("*/scene.toml") if p.parent.name not in MINUTES),
    ids=lambda p: p.parent.name,
)
def test_every_model_is_explained_for_a_reader(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(path)]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 140
    for part in ("On:", "Off (not allocated", "Chosen:", "Suggestions", "predicted", "(line "):
        assert part in out
    if path.parent.name == "lap_joint":
        assert "as a rigid body" not in out
    assert all(name in out for name in NAMES)


def test_json_keeps_its_keys(capsys: pytest.CaptureFixture[str]) -> None:
    path = MODELS / "two_specimen_crushing" / "scene.toml"
    assert main(["explain", str(path), "--json", "--set", "interface.crush.friction_coefficient=0"]) == 0
    report = json.loads(capsys.readouterr().out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert report["schema_version"] == "1.4"
    keys = {"schema_version", "scene", "effects", "choices", "prediction", "suggestions"}
    keys |= {"warnings", "warning_codes", "unchecked"}
    assert set(report) == keys
    assert set(report["effects"][0]) == {
        "name",
        "on",
        "why",
        "lines",
        "reason",
        "switch",
        "unknowns",
        "kernels",
        "memory_bytes",
        "share_of_time",
    }
    assert set(report["prediction"]) == {
        "cpu_seconds_set_up",
        "cpu_seconds_instants",
        "cpu_seconds_instant",
        "memory_bytes",
        "unknowns",
        "interface_unknowns",
        "instants",
        "iterations_per_instant",
    }
    assert set(report["choices"]) == {"window", "search direction", "acceleration", "interfaces", "propagator"}
    friction = next(e for e in report["effects"] if e["name"] == "friction")
    assert not friction["on"]
    assert all(set(s) == {"what", "settings", "cost_factor", "loss"} for s in report["suggestions"])


def test_a_wrong_scene_is_told_as_everywhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = tmp_path / "scene.toml"
    wrong.write_text('name = "x"\n')
    assert main(["explain", str(wrong)]) == 2
    assert "material" in capsys.readouterr().err


def test_rigid_bodies_alone_have_no_wave() -> None:
    """A slow load on them is told nothing by the time that a wave takes."""
    box = {"box": {"size": [0.01] * 3, "elements": [1, 1, 1]}, "material": "steel", "rigid": True}
    load = {"push": {"face": "b.zmax", "pressure": 1e5, "law": {"type": "half_sine", "duration": 1e-3}}}
    time = {"end": 1e-3, "instants": 10}
    told = explained(
        {"name": "r", "material": {"steel": STEEL.table()}, "substructure": {"b": box}, "load": load, "time": time}
    )
    assert not any("slower" in s.what for s in told.suggestions)
