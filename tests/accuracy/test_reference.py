"""Exact quantities declared with models: valid for their scene, equal to the oracles, dropped when physics change."""

from __future__ import annotations

import tomllib

import pytest

import latin_fmu
from latin_fmu.accuracy.reference import FILE, declared, physics_of
from latin_fmu.accuracy.refinement import Resolution, at_resolution

from ..verification.known_answers import (
    MODELS,
    beam_in_traction,
    bouncing_bar,
    impact_bar,
    shear_interface,
    shipped,
)

DECLARED = tuple(sorted(file.parent.name for file in MODELS.glob(f"*/{FILE}")))


def test_there_are_some() -> None:
    assert DECLARED == ("beam_in_traction", "bouncing_bar", "impact_bar", "shear_interface")


@pytest.mark.parametrize("known", [beam_in_traction(), bouncing_bar(), impact_bar(), shear_interface()])
def test_declared_values_are_those_of_the_waves(known) -> None:
    reference = declared(shipped(known.name))
    assert reference is not None
    assert reference.exact
    for quantity, value in reference.measured.values.items():
        assert value == pytest.approx(known.exact.values[quantity], rel=1e-9, abs=1e-12)
    for name, force in reference.measured.forces.items():
        assert force.distance(known.exact.forces[name]) <= 1e-9 * force.norm()


@pytest.mark.parametrize("model", DECLARED)
def test_meshes_and_solvers_do_not_change_the_physics(model: str) -> None:
    scene = shipped(model)
    overrides = ["time.instants=77", "solver.tolerance=1e-5", "time.scheme=newmark", "output.energy=false"]
    other = latin_fmu.load_scene(MODELS / model / "scene.toml", overrides)
    assert physics_of(other) == physics_of(scene)
    finer = at_resolution(scene, Resolution(2.0, 1.0))
    assert physics_of(finer) == physics_of(scene)


@pytest.mark.parametrize(
    "change",
    ["material.bar.density=1.1", "substructure.bar.initial_velocity=[0.0, 0.0, -9.0]", "time.end=1.9"],
)
def test_other_physics_have_no_reference(change: str) -> None:
    assert declared(latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", [change])) is None


@pytest.mark.parametrize("text", ["{", "[]", '{"scene": "impact_bar"}', "\x00"])
def test_a_damaged_reference_is_an_error_not_a_crash(text: str, tmp_path) -> None:
    (tmp_path / FILE).write_text(text)
    scene = latin_fmu.scene_from_dict(tomllib.loads(shipped("impact_bar").text()), tmp_path)
    with pytest.raises(latin_fmu.SceneError, match="not a usable reference"):
        declared(scene)
