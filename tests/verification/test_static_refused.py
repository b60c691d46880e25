"""Quasi-static scenes that make no sense are refused with a reason; nothing of inertia is built for those that do."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly import body as bodies
from latin_fmu.building import build
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.errors import SceneError
from tests.scenes import ramp, solve

from .static_scenes import add_block, plates, scene

SIZE, ELEMENTS = (0.03, 0.02, 0.01), (3, 2, 1)
Damage = Callable[[dict[str, Any]], object]


def small(**solver: Any) -> dict[str, Any]:
    """Two plates."""
    return plates(2, SIZE, ELEMENTS, pressure=50e6, shear=10e6, steps=4, **solver)


def _scheme(s: dict[str, Any]) -> None:
    s["time"]["scheme"] = "newmark"


def _velocity(s: dict[str, Any]) -> None:
    s["substructure"]["b2"]["initial_velocity"] = [0.0, 0.0, -1.0]


def _absorbing(s: dict[str, Any]) -> None:
    s["boundary"]["end"] = {"type": "absorbing", "face": "b2.xmax"}


def _damping(s: dict[str, Any]) -> None:
    s["material"]["steel"]["rayleigh_stiffness"] = 1e-7


def _window(s: dict[str, Any]) -> None:
    s["solver"]["window"] = "whole"


def _explicit(s: dict[str, Any]) -> None:
    s["solver"]["propagator"] = "explicit"


@pytest.mark.parametrize(
    ("damage", "where"),
    [
        (_scheme, "time.scheme"),
        (_velocity, "substructure.b2.initial_velocity"),
        (_absorbing, "boundary.end"),
        (_damping, "material.steel.rayleigh_stiffness"),
        (_window, "solver.window"),
        (_explicit, "solver.propagator"),
    ],
)
def test_what_needs_inertia_is_refused(damage: Damage, where: str):
    made = small()
    damage(made)
    with pytest.raises(SceneError) as caught:
        latin_fmu.scene_from_dict(made)
    problems = [p for p in caught.value.problems if p.where == where]
    assert problems
    assert "quasi_static" in f"{problems[0].what} {problems[0].remedy}"
    made["time"]["quasi_static"] = False  # the same scene with inertia is a scene
    if damage is not _explicit:
        latin_fmu.scene_from_dict(made)


def test_all_at_once():
    made = small()
    for damage in (_scheme, _velocity, _absorbing, _damping, _window):
        damage(made)
    with pytest.raises(SceneError) as caught:
        latin_fmu.scene_from_dict(made)
    assert len(caught.value.problems) == 5


def _frictionless(s: dict[str, Any]) -> None:
    s["interface"]["i1"]["friction_coefficient"] = 0.0


def _no_interface(s: dict[str, Any]) -> None:
    s["interface"] = {}


def _no_base(s: dict[str, Any]) -> None:
    del s["boundary"]["base"]


@pytest.mark.parametrize(
    ("damage", "names", "ways"),
    [
        (_frictionless, ["b2"], "along x"),  # y is held by symmetry, turns by the pressed face
        (_no_interface, ["b2"], "along x, along z"),
        (_no_base, ["b1", "b2"], "along x, along z"),
    ],
)
def test_what_nothing_holds_is_named(damage: Damage, names: list[str], ways: str):
    """Before anything is factorised: which substructures, and how they could move."""
    made = small()
    damage(made)
    with pytest.raises(SceneError) as caught:
        latin_fmu.solve(latin_fmu.scene_from_dict(made))
    (problem,) = caught.value.problems
    assert problem.where == (f"substructure.{names[0]}" if len(names) == 1 else "substructure")
    assert f"{', '.join(names)} can move" in str(problem.value) or len(names) == 1
    assert ways in str(problem.value)


def test_held_by_one_node_less_than_needed_turns():
    """A block held along one edge can turn about it, and about nothing else."""
    made = scene(1)
    add_block(made, "b", (0.0, 0.0, 0.0), SIZE, ELEMENTS)
    add_block(made, "support", (-0.01, 0.0, -0.01), (0.01, 0.02, 0.01), (1, 2, 1))
    made["boundary"]["all"] = {"type": "fixed", "face": "support.zmin"}
    made["boundary"]["plane"] = {"type": "fixed", "face": "b.ymin", "components": ["y"]}
    made["load"]["push"] = {"face": "b.xmax", "pressure": 1e6}
    with pytest.raises(SceneError) as caught:
        latin_fmu.solve(latin_fmu.scene_from_dict(made))
    assert "along x, along z" in str(caught.value.problems[0].value)


def test_pulled_apart_is_no_equilibrium():
    """A plate pulled off another: the run ends at the load it could follow, with a message."""
    made = small()
    del made["load"]["shear"]
    made["load"]["press"]["law"] = ramp((0, 0), (0.5, 1), (1, -1))
    solution = solve(made, converged=False)
    assert "no equilibrium" in solution.status
    assert solution.time[-1] < 1.0
    assert np.abs(solution.interfaces["i1"].force()).max() == pytest.approx(50e6 * SIZE[0] * SIZE[1], rel=1e-2)


def test_no_mass_is_assembled(monkeypatch: pytest.MonkeyPatch):
    """Neither assembled nor kept nor a scheme of motion anywhere."""

    def refuse(*_: object) -> None:
        raise AssertionError("mass assembled")

    monkeypatch.setattr(bodies, "mass", refuse)
    problem = build(latin_fmu.scene_from_dict(small()))
    for propagator in problem.assembly.propagators:
        assert all(m.mass is None and m.damping is None for m in propagator.members)
        assert not hasattr(propagator.operators, "mass")
    solve(small())
    made = small()
    made["time"]["quasi_static"] = False
    moving = latin_fmu.scene_from_dict(made)
    with pytest.raises(AssertionError, match="mass assembled"):
        build(moving)


def test_scene_text_reads_back():
    """The effective scene, defaults written out, is the same scene."""
    read = latin_fmu.scene_from_dict(small())
    assert latin_fmu.scene_from_dict(tomllib.loads(read.text())) == read


def test_segments_give_the_same_path():
    """A run cut into segments, rolled back in between, ends where the whole run ends."""
    made = small(tolerance=1e-8)
    whole = solve(made)
    run = SegmentedRun(latin_fmu.scene_from_dict(copy.deepcopy(made)))
    run.advance(0.5, 2)
    kept = run.snapshot()
    run.advance(0.75, 1)
    run.restore(kept)
    first = run.advance(1.0, 2)
    last = {n: run.displacement(n) for n in ("b1", "b2")}
    assert first.converged
    for name, u in last.items():
        exact = whole.substructures[name].displacement[-1]
        assert u == pytest.approx(exact, abs=1e-5 * np.abs(exact).max())
    run.restore(kept)
    run.advance(1.0, 2)
    for name, u in last.items():
        assert (run.displacement(name) == u).all()  # to the last bit


def test_a_rigid_punch_is_held_in_place():
    """A rigid block pressed on an elastic one: its force arrives, it stands on the deformed face."""
    made = small(tolerance=1e-6)
    made["substructure"]["b2"]["rigid"] = True
    solution = solve(made)
    area, force = SIZE[0] * SIZE[1], solution.interfaces["i1"].force()[-1]
    assert force[[0, 2]] == pytest.approx(area * np.array([10e6, -50e6]), abs=1e-4 * 50e6 * area)
    top = solution.substructures["b2"].displacement[-1]
    assert -50e6 / 210e9 * SIZE[2] < top[:, 2].mean() < -0.5 * 50e6 / 210e9 * SIZE[2]


def test_a_body_without_interfaces_stands_beside_the_others():
    """It is solved with them, by itself: u_z = - p z / E."""
    made = small()
    add_block(made, "alone", (1.0, 0.0, 0.0), SIZE, ELEMENTS)
    for axis in "xyz":
        made["boundary"][f"alone_{axis}"] = {"type": "symmetry", "face": f"alone.{axis}min"}
    made["load"]["alone"] = {"face": "alone.zmax", "pressure": 21e6, "law": ramp((0, 0), (1, 1))}
    body = solve(made).substructures["alone"]
    assert body.displacement[-1, :, 2] == pytest.approx(-21e6 / 210e9 * body.nodes[:, 2], abs=1e-12 * SIZE[2])
