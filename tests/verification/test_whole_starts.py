"""Static starts over the whole assembly at once: against its bodies one by one, in its forms, and in studies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import Scene, scene_from_dict
from latin_fmu.assembly.initial_state import InitialState
from latin_fmu.assembly.models import Kept
from latin_fmu.assembly.problem import DiscretisedProblem, SolverReadyProblem
from latin_fmu.building import discretise
from latin_fmu.joined import static_assembly
from latin_fmu.joined.static_assembly import StaticAssembly, StaticShapes
from latin_fmu.joined.tied_assembly import TieError
from latin_fmu.statics import equilibrium
from latin_fmu.statics.starts import solved_equilibrium
from latin_fmu.statics.static_run import StaticMarch
from latin_fmu.statics.statics import Stage, static_problem, static_scene

from .test_sliding_frames import frame

LAP_JOINT = Path(__file__).parents[2] / "models" / "lap_joint" / "scene.toml"
FRICTION = "contact.all.friction_coefficient"
EXACT = 1e-7  # of the largest: bodies are tied to 1e-9 of their motion


def lap_joint(**changes: float) -> Scene:
    scene = latin_fmu.load_scene(LAP_JOINT)
    for key, value in changes.items():
        scene = scene.replace(key.replace("__", "."), value)
    return scene


def sagging() -> Scene:
    """A frame whose columns are pushed less than they are clamped, from its static start on."""
    tables: dict[str, Any] = frame(3)
    del tables["load"]
    tables["time"] = {"end": 1e-5, "instants": 2, "start": "static"}
    return scene_from_dict(tables)


@pytest.fixture
def ways(monkeypatch: pytest.MonkeyPatch) -> list[type]:
    """What was solved of each static problem."""
    found = list[type]()
    solved = equilibrium._solved

    def seen(make: Any, limits: Any) -> Any:
        ended = solved(make, limits)
        found.append(type(ended.solved))
        return ended

    monkeypatch.setattr(equilibrium, "_solved", seen)
    return found


def started(problem: DiscretisedProblem, operators: Kept | None = None, stages: list[Stage] | None = None) -> Any:
    return solved_equilibrium(problem, {}, stages, {} if operators is None else operators)


def assert_same(first: InitialState, second: InitialState) -> None:
    for of in ("displacement", "traction"):
        wanted, found = getattr(first, of), getattr(second, of)
        largest = max(np.abs(values).max(initial=0.0) for values in wanted.values())
        assert largest > 0.0
        for name, values in wanted.items():
            assert np.abs(found[name] - values).max(initial=0.0) <= EXACT * largest, (of, name)


@pytest.mark.parametrize("scene", [lap_joint, sagging])
def test_the_whole_assembly_has_the_equilibrium_of_its_bodies(scene: Any, ways: list[type]) -> None:
    problem = discretise(scene())
    whole, bodies = started(problem), started(problem, stages=[])
    assert set(ways) == {StaticMarch, SolverReadyProblem}
    assert ways[0] is StaticMarch
    assert_same(bodies, whole)


def test_dofs_that_follow_by_substitution_give_it_too(monkeypatch: pytest.MonkeyPatch, ways: list[type]) -> None:
    problem = discretise(lap_joint())
    dense = started(problem)
    made = list[bool]()

    def without(*given: Any) -> StaticShapes:
        made.append(True)
        if given[-1]:
            raise TieError("contacts hold nodes twice")
        return shapes(*given)

    shapes = static_assembly._shapes
    monkeypatch.setattr(static_assembly, "_shapes", without)
    monkeypatch.setattr(equilibrium, "_over_all", _first(equilibrium._over_all))
    swept = started(problem)
    assert len(made) == 2
    assert set(ways) == {StaticMarch}
    assert_same(dense, swept)


def _first(over_all: Any) -> Any:
    """The whole assembly in whatever form."""
    return lambda problem, start, settings, operators, related=False: over_all(problem, start, settings, operators)  # noqa: ARG005


@pytest.mark.parametrize(("module", "name"), [(static_assembly, "MOST_CHANNELS"), (equilibrium, "_ORDERS")])
def test_many_contacts_and_many_orders_of_bolts_take_the_bodies(
    monkeypatch: pytest.MonkeyPatch, ways: list[type], module: Any, name: str
) -> None:
    monkeypatch.setattr(module, name, 0)
    started(discretise(lap_joint()))
    assert ways[0] is SolverReadyProblem


def test_frictions_share_factors_and_stiffnesses_do_not() -> None:
    operators: Kept = {}
    first = started(discretise(lap_joint()), operators)
    count = {key: len(made) for key, made in operators.items()}
    assert count
    slippery = started(discretise(lap_joint(contact__all__friction_coefficient=0.05)), operators)
    assert {key: len(made) for key, made in operators.items()} == count
    assert_same(started(discretise(lap_joint(contact__all__friction_coefficient=0.05))), slippery)
    assert any(np.abs(first.traction[name] - t).max() > 1e-3 * np.abs(t).max() for name, t in slippery.traction.items())
    soft = lap_joint(material__steel__young_modulus=100e9)
    assert_same(started(discretise(soft)), started(discretise(soft), operators))
    assert len(operators) == 2 * len(count)


def test_the_key_tells_bonds_stiffnesses_and_supports_but_no_friction() -> None:
    def key(table: str, name: str, **changes: Any) -> bytes:
        tables = frame(3)
        if "behaviour" in changes:
            del tables[table][name]["friction_coefficient"]
        tables[table][name] |= changes
        problem = discretise(scene_from_dict(tables))
        return StaticAssembly.of(problem.classes, problem.units, problem.layout, problem.bodies).key

    same = key("interface", "low0")
    assert key("interface", "low0", friction_coefficient=0.9) == same
    bonded, soft = key("interface", "low0", behaviour="perfect"), key("material", "m", young_modulus=1e9)
    assert len({same, bonded, soft, key("boundary", "base", face="low.xmin")}) == 4


def test_stages_with_loose_and_tight_bolts_share_nothing() -> None:
    """Bolts that are tightened to a force have a softer shank than those that keep their shortening."""
    whole = discretise(lap_joint())
    scene = static_scene(whole.scene, {}, loaded=False)
    keys = set()
    for free in ([], list(whole.cuts)):
        problem = static_problem(whole, scene, free)
        keys.add(StaticAssembly.of(problem.classes, problem.units, problem.layout, problem.bodies).key)
    assert len(keys) == 2


def test_layers_of_other_stiffness_share_nothing() -> None:
    keys = set()
    for stiffness in (1e12, 1e11):
        tables = frame(3)
        del tables["interface"]["low0"]["friction_coefficient"]
        layer = {"behaviour": "elastic_layer", "normal_stiffness": stiffness, "tangential_stiffness": stiffness}
        tables["interface"]["low0"] |= layer
        problem = discretise(scene_from_dict(tables))
        keys.add(StaticAssembly.of(problem.classes, problem.units, problem.layout, problem.bodies).key)
    assert len(keys) == 2


def test_a_state_is_where_the_next_stage_begins() -> None:
    """Relative motions among the dofs are those of the state: contacts that have slipped do not slip again."""
    problem = discretise(lap_joint())
    state = started(problem)
    whole = StaticAssembly.of(problem.classes, problem.units, problem.layout, problem.bodies)
    assert whole.shapes.there is not None
    expansion, full = whole.shapes.expansion, np.concatenate([state.displacement[m.name] for m in whole.models])
    assert np.abs(whole.shapes.jump @ full).max() > 1e-9 * np.abs(full).max()
    assert np.abs(expansion @ whole.reduced(full)[:, 0] - full).max() <= EXACT * np.abs(full).max()
