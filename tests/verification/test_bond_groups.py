"""Bodies that perfect interfaces join are one substructure of the march: against the iteration on these interfaces."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict
from latin_fmu import solve as solve_scene
from latin_fmu.building import discretise
from latin_fmu.effects import march_choice
from latin_fmu.effects.cost import Prediction
from latin_fmu.joined.bond_groups import GroupedAssembly
from latin_fmu.joined.bonded_run import grouped_assembly
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.results.solution import Solution
from latin_fmu.stability.scenes import STEEL, Box, Description, Material, column, half_sine
from tests.scenes import clamp, solve

EDGE = 0.02
RATIOS = {"frequencies": [5e3, 1e5], "ratios": [0.02, 0.02]}
SOFT = Material(7e10, 2700.0, 0.3, "soft", {"damping_ratios": RATIOS})
EXACT = {"tolerance": 1e-11, "max_iterations": 400}
CLOSE = 1e-8
PERFECT: dict[str, Any] = {"behaviour": "perfect"}
EVERYTHING = {"fields": True, "energy": True, "stress": True, "reactions": True, "every": 10}
HIT = {"face": "top.zmax", "pressure": 5e7, "law": half_sine(6e-6)}
SHAKE = {"type": "velocity", "face": "low.zmin", "components": ["x", "y", "z"], "value": [0.2, 0.0, 1.0]}
FOOT = {"feet": {"type": "fixed", "face": "low.zmin", "components": ["x", "y", "z"]}}


def tower(joints: dict[str, dict[str, Any]], **tables: Any) -> Description:
    """Three blocks of unlike meshes, the middle one of another material whose strains relax."""
    blocks = {
        "low": Box(STEEL, (EDGE,) * 3, (3, 3, 3)),
        "mid": Box(SOFT, (EDGE,) * 3, (4, 4, 3)),
        "top": Box(STEEL, (EDGE,) * 3, (3, 3, 3)),
    }
    given = {"boundary": FOOT, "load": {"hit": HIT}, "output": EVERYTHING, "solver": EXACT} | tables
    sensor = {"sensor": {"tip": {"face": "top.zmax"}, "inside": {"face": "low.zmax"}}}
    return column(blocks, joints, {"end": 16e-6, "step": 4e-7}, **sensor, **given)


def thrown() -> Description:
    """Two bonded blocks that land on a wall."""
    tables = tower({"bond": PERFECT, "upper": PERFECT}, boundary={}, load={})
    for body in tables["substructure"].values():
        body["initial_velocity"] = [0.5, 0.0, -2.0]
    wall = {"sides": ["low.zmin", "ground"], "friction_coefficient": 0.2, "gap": 1e-6}
    tables["interface"] = {"wall": wall, **tables["interface"]}
    return tables


def bridged() -> Description:
    """Two blocks in contact that a column beside them holds by arms: the contact is inside of the group."""
    tables = tower({"joint": {"friction_coefficient": 0.3}, "upper": {"friction_coefficient": 0.0}})
    half = EDGE / 2
    for name, place, size in (
        ("foot", [EDGE, 0.0, 0.0], [half, EDGE, half]),
        ("hand", [EDGE, 0.0, 3 * half], [half, EDGE, half]),
        ("post", [3 * half, 0.0, 0.0], [half, EDGE, 2 * EDGE]),
    ):
        box = Box(STEEL, size, (1, 3, round(2 * size[2] / half)))
        tables["substructure"][name] = box.table(place)
    for name, sides in {
        "low_foot": ["foot.xmin", "low.xmax"],
        "mid_hand": ["hand.xmin", "mid.xmax"],
        "foot_post": ["foot.xmax", "post.xmin"],
        "hand_post": ["hand.xmax", "post.xmin"],
    }.items():
        tables["interface"][name] = {"sides": sides, **PERFECT}
    return tables


SCENES: dict[str, Description] = {
    "bonded": tower({"bond": PERFECT, "upper": PERFECT}),
    "with a contact": tower({"bond": PERFECT, "joint": {"friction_coefficient": 0.3}}),
    "without friction": tower({"bond": PERFECT, "joint": {"friction_coefficient": 0.0}}),
    "with a layer": tower(
        {
            "bond": PERFECT,
            "layer": {"behaviour": "elastic_layer", "normal_stiffness": 1e14, "tangential_stiffness": 4e13},
        }
    ),
    "driven": tower(
        {"bond": PERFECT, "joint": {"friction_coefficient": 0.3}},
        boundary={"base": SHAKE | {"law": half_sine(8e-6)}},
        load={},
    ),
    "contact inside": bridged(),
    "thrown": thrown(),
    "bolted": clamp(
        output={"energy": True, "reactions": True},
        solver=EXACT,
        load={"press": {"face": "upper.zmax", "pressure": 8e6, "law": half_sine(4e-6)}},
    )
    | {"time": {"end": 4e-6, "step": 4e-7, "start": "static"}},
}
SCHEMES = [{"type": name} for name in ("hht", "newmark", "massless_contact", "generalized_alpha")]


def both_ways(tables: Description, monkeypatch: pytest.MonkeyPatch) -> tuple[Solution, Solution]:
    """A scene with its bonds eliminated, whatever that costs, and iterated."""
    monkeypatch.setattr(march_choice, "_SET_UP", -1e9)
    iterated = copy.deepcopy(tables)
    iterated["solver"] = iterated.get("solver", {}) | {"bonds": "iterate"}
    grouped, plain = solve(tables), solve(iterated)
    assert "eliminated" in grouped.outcome.settings["bonds"]
    assert "bonds" not in plain.outcome.settings
    return grouped, plain


def apart(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(first - second).max() / max(np.abs(second).max(), 1e-300))


def assert_equal(grouped: Solution, plain: Solution) -> None:
    """All histories of bodies and interfaces, those of the bonds included."""
    largest = max(np.abs(h.traction).max() for h in plain.interfaces.values())
    for name, history in plain.interfaces.items():
        other = grouped.interfaces[name]
        assert apart(other.velocity, history.velocity) < CLOSE, name
        assert np.abs(other.traction - history.traction).max() < CLOSE * largest, name
        assert apart(other.force(), history.force()) < CLOSE or np.abs(history.force()).max() == 0.0, name
        if history.gap is not None:
            assert np.abs(other.gap - history.gap).max() < CLOSE * EDGE * 1e-3, name
    for name, sensor in plain.sensors.items():
        for kind in ("displacement", "velocity", "acceleration"):
            assert apart(getattr(grouped.sensors[name], kind), getattr(sensor, kind)) < CLOSE, (name, kind)
    for name, reaction in plain.outcome.reactions.items():
        assert apart(grouped.outcome.reactions[name].force, reaction.force) < CLOSE, name
    for name, bolt in plain.outcome.bolts.items():
        assert apart(grouped.outcome.bolts[name].force, bolt.force) < CLOSE, name
    for name, body in plain.substructures.items():
        for kind in ("displacement", "velocity", "stress"):
            if getattr(body, kind) is not None:
                assert apart(getattr(grouped.substructures[name], kind), getattr(body, kind)) < CLOSE, (name, kind)
    energies, others = plain.outcome.energy, grouped.outcome.energy
    assert energies is not None
    assert others is not None
    scale = max(float(np.abs(term).max()) for term in energies.values())
    for term, values in energies.items():
        assert np.abs(others[term] - values).max() < CLOSE * scale, term


@pytest.mark.parametrize("name", SCENES)
def test_a_group_moves_as_its_bonded_bodies(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the time scheme that the program chooses."""
    assert_equal(*both_ways(SCENES[name], monkeypatch))


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme["type"])
@pytest.mark.parametrize("name", ["driven", "thrown"])
def test_in_every_time_scheme(name: str, scheme: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Tractions of bonds are weighted as those of the scheme, and velocities are its interface velocities."""
    tables = copy.deepcopy(SCENES[name])
    tables["time"]["scheme"] = scheme
    tables["solver"] = EXACT | {"tolerance": 1e-12}
    assert_equal(*both_ways(tables, monkeypatch))


def test_bonds_alone_are_one_solve_per_instant(monkeypatch: pytest.MonkeyPatch) -> None:
    """There is nothing to iterate."""
    grouped, plain = both_ways(SCENES["bonded"], monkeypatch)
    assert all(window.iterations == 1 for window in grouped.outcome.windows)
    assert len(grouped.outcome.windows) == len(plain.outcome.windows)
    assert "3 bodies in 1 group, 2 bonds eliminated" in grouped.outcome.settings["bonds"]


def grouping(tables: Description, restricted: bool = False) -> tuple[GroupedAssembly | None, str]:
    """Groups of a scene, and why there are none."""
    return grouped_assembly(discretise(scene_from_dict(copy.deepcopy(tables))), restricted)


def test_a_run_says_why_bonds_are_iterated() -> None:
    """In one line; in none where the scene asks for the iteration or has no bonds."""
    tables = copy.deepcopy(SCENES["bonded"])
    assert "one by one" in grouping(tables, restricted=True)[1]
    windows = tables | {"solver": {"window": 5}}
    assert grouping(windows) == (None, "windows of several instants are solved body by body")
    assert solve(windows).outcome.settings["bonds"].startswith("iterated: windows of several instants")
    assert grouping(tables | {"solver": {"bonds": "iterate"}}) == (None, "")
    assert grouping(tower({"one": {}, "other": {}})) == (None, "")
    for body in tables["substructure"].values():
        body["rigid"] = True
    tables["boundary"] = {}
    assert grouping(tables) == (None, "bonds of rigid bodies")


def test_bodies_that_are_torn_apart_are_iterated(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sides of a bond that start with unlike velocities lose their jump in the first step."""
    monkeypatch.setattr(march_choice, "_SET_UP", -1e9)
    tables = tower({"bond": PERFECT, "upper": PERFECT}, boundary={})
    tables["substructure"]["top"]["initial_velocity"] = [0.0, 0.0, -1.0]
    words = solve(tables | {"solver": {}}).outcome.settings["bonds"]
    assert words == "iterated: the sides of interface upper are moving apart at t = 0"


def test_bodies_that_relax_in_unlike_times_are_iterated() -> None:
    """Their branches would have springs of several kinds."""
    tables = copy.deepcopy(SCENES["bonded"])
    tables["material"][STEEL.name]["damping_ratios"] = RATIOS | {"frequencies": [1e3, 1e4]}
    assert grouping(tables) == (None, "bonds of bodies that relax in unlike times")


def test_equal_groups_are_one_class() -> None:
    """As equal bodies are; the contact between them is no part of a group."""
    pair = Box(STEEL, (EDGE,) * 3, (3, 3, 3))
    joints = {"a": PERFECT, "joint": {"friction_coefficient": 0.3}, "b": PERFECT}
    tables = column({f"b{i}": pair for i in range(4)}, joints, {"end": 4e-6, "step": 4e-7})
    for i in range(4):  # faces that meet others have traces of their own
        tables["interface"][f"to{i}"] = {"sides": [f"b{i}.xmax", "ground"], "gap": 1e-3}
    tables["interface"].pop("joint")
    grouped, why = grouping(tables)
    assert why == ""
    assert grouped is not None
    assert [len(c.members) for c in grouped.classes] == [2]
    assert grouped.remaining == tuple(range(2, 6))


@pytest.mark.parametrize("n_step", [2, 4000])
def test_the_cheaper_march_is_taken(n_step: int) -> None:
    """Alike blocks share a factor, which is the cheaper way for a few steps. Neither names nor their order change the
    choice."""
    block, n, chosen = Box(STEEL, (EDGE,) * 3, (10, 10, 10)), 6, set()
    for names in ([f"b{i}" for i in range(n)], [f"x{n - i}" for i in range(n)]):
        tables = column(
            dict.fromkeys(names, block),
            {f"i{i}": {"friction_coefficient": 0.3} if i % 2 else PERFECT for i in range(n - 1)},
            {"end": n_step * 2e-6, "instants": n_step},
            load={"hit": HIT | {"face": f"{names[-1]}.zmax"}},
        )
        discretised = discretise(scene_from_dict(tables))
        grouped, prediction, why = march_choice.cheaper_march(discretised, Prediction(discretised), False)
        chosen.add((grouped is None, round(prediction.march, 9), why))
    assert len(chosen) == 1
    assert chosen.pop()[0] is (n_step == 2)


def test_a_run_is_continued_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the tractions of bonds take of the instant before is in the checkpoint."""
    monkeypatch.setattr(march_choice, "_SET_UP", -1e9)
    scene = scene_from_dict(copy.deepcopy(SCENES["with a contact"]))
    whole, seen = solve_scene(scene), [0]

    def stop() -> bool:
        seen[0] += 1
        return seen[0] > 8

    file = tmp_path / "run.checkpoint"
    part = solve_scene(scene, checkpoint=Checkpoint(file, every=3, stop=stop, log=lambda _: None))
    assert part.interrupted
    rest = solve_scene(scene, checkpoint=Checkpoint(file, resume=True, log=lambda _: None))
    for name, history in whole.interfaces.items():
        assert np.array_equal(rest.interfaces[name].traction, history.traction)
        assert np.array_equal(rest.interfaces[name].velocity, history.velocity)
    assert np.array_equal(rest.sensors["tip"].acceleration, whole.sensors["tip"].acceleration)
