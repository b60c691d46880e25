"""Where an equilibrium is lost: closed forms, a program with all points and fine polygons, and bisection by runs."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import latin_fmu
from latin_fmu.assembly.body import body_sides
from latin_fmu.building import build, discretise
from latin_fmu.errors import SceneError
from latin_fmu.latin.assembly import NoEquilibrium
from latin_fmu.reader import load_scene
from latin_fmu.statics import free_bodies
from latin_fmu.statics.free_bodies import LimitLoad, loss_of_equilibrium
from tests.scenes import ramp

from .static_scenes import add_block, plates, scene

MODELS = Path(__file__).parents[2] / "models"
SIZE, WEIGHT = (0.04, 0.04, 0.02), 100e6  # m, N m-3
VOLUME, FACE = SIZE[0] * SIZE[1] * SIZE[2], SIZE[0] * SIZE[1]


def inclined(push: float, degrees: float = 20.0, friction: float = 0.5, steps: int = 20, **keys: Any) -> dict[str, Any]:
    """A heavy block on a face inclined by an angle about y, pushed along it by a growing traction, Pa."""
    made = scene(steps)
    add_block(made, "base", (-0.01, -0.01, -0.01), (0.06, 0.06, 0.01), (6, 6, 1))
    add_block(made, "upper", (0.0, 0.0, 0.0), SIZE, (3, 3, 2))
    slope = np.radians(degrees)
    force = WEIGHT * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    made["substructure"]["upper"]["body_force"] = force.tolist()
    made["interface"]["face"] = {"sides": ["base.zmax", "upper.zmin"], "friction_coefficient": friction}
    made["boundary"]["base"] = {"type": "fixed", "face": "base.zmin"}
    made["load"]["push"] = {"face": "upper.zmax", "traction": [push, 0.0, 0.0], "law": ramp((0, 0), (1, 1))}
    return made | keys


def slipping(push: float, degrees: float = 20.0, friction: float = 0.5) -> float:
    """Share of the push at which the block slips, by hand."""
    slope, weight = np.radians(degrees), WEIGHT * VOLUME
    return weight * (friction * np.cos(slope) - np.sign(push) * np.sin(slope)) / (abs(push) * FACE)


def lost(made: dict[str, Any]) -> NoEquilibrium | None:
    return loss_of_equilibrium(discretise(latin_fmu.scene_from_dict(copy.deepcopy(made))))


@pytest.mark.parametrize(("push", "way"), [(2e6, "x"), (-3e6, "-x")])
def test_a_block_on_an_inclined_face_slips(push: float, way: str) -> None:
    """The run ends before the increment in which the block slips, and names block, direction and share of the load."""
    found, share = lost(inclined(push)), slipping(push)
    assert found is not None
    assert found.time == pytest.approx(share, rel=1e-9)
    assert found.what == f"upper moves along {way} at {share:.4g} of load push"
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(inclined(push)))
    assert not solution.converged
    assert found.what in solution.status
    assert solution.time[-1] <= share < solution.time[-1] + 1 / 20 + 1e-12
    assert sum(w.iterations for w in solution.windows) <= 100 * len(solution.windows)


def test_a_block_that_its_weight_moves() -> None:
    found = lost(inclined(1e6, degrees=30.0))
    assert found is not None
    assert (found.instant, found.what) == (1, "upper moves along x at 0 of the loads of the first increment")


@pytest.mark.slow
def test_bisection_by_runs_finds_the_same_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the linear program: equilibria converge up to 0.05 % below the share, none 0.05 % above."""
    monkeypatch.setattr(free_bodies, "loss_of_equilibrium", lambda _: None)
    share = slipping(2e6)
    for factor, held in ((0.99, True), (0.9995, True), (1.0005, False), (1.01, False)):
        made = inclined(2e6 * share * factor, steps=4)
        assert latin_fmu.solve(latin_fmu.scene_from_dict(made)).converged is held, factor


def test_a_tall_block_topples() -> None:
    """Pushed at its top it turns about its lower edge when push x height = weight x half width."""
    made = inclined(2e6, degrees=0.0, friction=1.0)
    made["substructure"]["upper"]["box"] |= {"size": [0.02, 0.04, 0.08], "elements": [2, 3, 4]}
    found = lost(made)
    assert found is not None
    assert found.time == pytest.approx(WEIGHT * 0.08 * 0.01 / (2e6 * 0.08), rel=1e-9)
    assert "upper turns about y" in found.what


def test_a_tall_block_topples_while_it_slides_along_what_pushes_it() -> None:
    """A guided block pushes at 3/4 of the height, with friction on its face: F (3/4 h - mu b) = W b / 2."""
    made = inclined(2e6, degrees=0.0, friction=1.0)
    made["substructure"]["upper"]["box"] |= {"size": [0.02, 0.04, 0.08], "elements": [2, 3, 4]}
    add_block(made, "pusher", (-0.02, 0.0, 0.06), (0.02, 0.04, 0.02), (2, 3, 1))
    made["interface"]["side"] = {"sides": ["pusher.xmax", "upper.xmin"], "friction_coefficient": 0.1}
    for face in ("zmin", "zmax"):
        made["boundary"][f"guide_{face}"] = {"type": "fixed", "face": f"pusher.{face}", "components": ["y", "z"]}
    made["load"]["push"]["face"] = "pusher.xmin"
    lost_at = lost(made)
    assert lost_at is not None
    assert lost_at.time == pytest.approx(WEIGHT * 0.02 * 0.08 * 0.01 / (0.06 - 0.1 * 0.02) / (2e6 * 0.02), rel=1e-9)
    assert lost_at.what.startswith("upper turns about y, pusher moves along x")


def test_plates_sheared_slide_on_the_weakest_face() -> None:
    """Pressed first, then sheared: all plates above the smoothest face move, at mu p / tau of the shear."""
    made = plates(4, (0.04, 0.04, 0.005), (4, 4, 1), friction=0.3, pressure=50e6, shear=20e6)
    made["interface"]["i2"]["friction_coefficient"] = 0.1
    found = lost(made)
    assert found is not None
    assert found.what == "b3 moves along x, b4 moves along x at 0.25 of load shear"
    assert found.time == pytest.approx(0.5 + 0.5 * 0.25, rel=1e-9)


def test_a_temperature_moves_nothing() -> None:
    """It has no part in the limit, nor in the share of the load."""
    made = plates(4, (0.04, 0.04, 0.005), (4, 4, 1), friction=0.3, pressure=50e6, shear=20e6)
    made["interface"]["i2"]["friction_coefficient"] = 0.1
    for material in made["material"].values():
        material["thermal_expansion"] = 12e-6
    made["temperature"] = {"day": {"change": 30.0, "law": ramp((0, 0), (1, 1))}}
    found = lost(made)
    assert found is not None
    assert found.what == "b3 moves along x, b4 moves along x at 0.25 of load shear"


def test_a_plate_pulled_off() -> None:
    made = plates(2, (0.03, 0.02, 0.01), (3, 2, 1), pressure=50e6, shear=0.0)
    made["load"]["press"]["law"] = ramp((0, 0), (0.5, 1), (1, -1))
    found = lost(made)
    assert found is not None
    assert found.time == pytest.approx(0.75, rel=1e-9)
    assert "b2 moves along z at 0 of load press" in found.what


def test_a_static_start_names_what_moves() -> None:
    made = inclined(1e6, degrees=30.0)
    made["time"] = {"end": 1e-5, "instants": 10, "start": "static"}
    with pytest.raises(SceneError, match="upper moves along x"):
        build(latin_fmu.scene_from_dict(made))


@pytest.mark.parametrize("model", ["pressed_plates", pytest.param("lap_joint", marks=pytest.mark.slow), "gripped_bar"])
def test_shipped_models_stand(model: str) -> None:
    assert loss_of_equilibrium(discretise(load_scene(MODELS / model / "scene.toml", []))) is None


def random_stack(seed: int) -> dict[str, Any]:
    """Two or three blocks of any size on a base, pressed, then pulled and pushed anywhere."""
    rng = np.random.default_rng(seed)
    made, level, count = scene(8), 0.0, int(rng.integers(2, 4))
    add_block(made, "b0", (0.0, 0.0, -0.01), (0.05, 0.05, 0.01), (4, 4, 1))
    made["boundary"]["base"] = {"type": "fixed", "face": "b0.zmin"}
    for i in range(1, count + 1):
        edge, height = float(rng.uniform(0.02, 0.045)), float(rng.uniform(0.01, 0.03))
        x, y = (float(v) for v in rng.uniform(0.0, 0.05 - edge, 2))
        add_block(made, f"b{i}", (x, y, level), (edge, edge, height), (*(int(rng.integers(2, 4)),) * 2, 2))
        mu = float(rng.choice([0.1, 0.3, 0.6, 1.0]))
        made["interface"][f"i{i}"] = {"sides": [f"b{i - 1}.zmax", f"b{i}.zmin"], "friction_coefficient": mu}
        level += height
    pressed, later = ramp((0, 0), (0.5, 1), (1, 1)), ramp((0, 0), (0.5, 0), (1, 1))
    pressure = float(rng.uniform(5e6, 5e7))
    made["load"]["press"] = {"face": f"b{count}.zmax", "pressure": pressure, "law": pressed}
    for k in range(int(rng.integers(1, 3))):
        face = f"b{int(rng.integers(1, count + 1))}.{rng.choice(['xmax', 'ymax', 'zmax'])!s}"
        traction = (rng.normal(size=3) * [1, 1, 0.3] * 10 ** rng.uniform(6, 7.3)).tolist()
        made["load"][f"pull{k}"] = {"face": face, "traction": traction, "law": later}
    return made


@pytest.mark.parametrize("seeds", [(4, 8), pytest.param(range(3, 34), marks=pytest.mark.slow)])
def test_random_stacks_end_where_runs_without_the_program_end(
    seeds: Sequence[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No run goes beyond the loss; nine in ten end right before it, and converge to the end where there is none."""
    monkeypatch.setattr(free_bodies, "loss_of_equilibrium", lambda _: None)
    ends = []
    for seed in seeds:
        made = random_stack(seed)
        try:
            found = lost(made)
        except SceneError:  # two faces that have hardly anything in common hold nothing
            continue
        solution = latin_fmu.solve(latin_fmu.scene_from_dict(made))
        last = 8 if found is None else found.instant - 1
        assert len(solution.time) - 1 <= last, (seed, found)
        ends.append((found is None, len(solution.time) - 1 == last))
    assert 0.1 <= np.mean([held for held, _ in ends]) <= 0.6
    assert np.mean([exact for _, exact in ends]) >= 0.9


@pytest.mark.parametrize("seed", range(4))
def test_against_all_points_and_fine_polygons(seed: int) -> None:
    """Two blocks under forces in any direction and at any place: the share of a program with every point and cones of
    128 sides is at most 0.04 % below."""
    rng = np.random.default_rng(seed)
    made = inclined(0.0, degrees=float(rng.uniform(-10, 10)), friction=float(rng.uniform(0.2, 0.8)), steps=2)
    add_block(made, "top", (0.013, 0.013, 0.02), (0.0134, 0.0134, 0.01), (2, 2, 1))
    made["interface"]["second"] = {"sides": ["upper.zmax", "top.zmin"], "friction_coefficient": 0.3}
    made["load"] = {
        f"pull{i}": {
            "face": face,
            "traction": (5e6 * rng.normal(size=3) * [1, 1, 0.3]).tolist(),
            "law": ramp((0, 0), (0.5, 0), (1, 1)),
        }
        for i, face in enumerate(("upper.xmax", "top.ymax"))
    }
    made["load"]["press"] = {"face": "top.zmax", "pressure": 4e6, "law": ramp((0, 0), (0.5, 1), (1, 1))}
    problem = discretise(latin_fmu.scene_from_dict(made))
    limit = LimitLoad(problem)
    share = limit.largest(limit.path[1], limit.path[2])[0]
    assert 0.0 < share < 1.0
    assert 0.9996 * share <= _share(problem, limit) <= share * (1 + 1e-9)


def _share(problem: Any, limit: LimitLoad) -> float:
    """The same by one program: all points, 128 generators each."""
    columns = [limit.path[2] - limit.path[1]]
    for unit in problem.units:
        n = unit.geometry.n_point
        relative = np.zeros((n, 3, limit.path.shape[1]))
        for _, side, name in body_sides([unit]):
            moved = (unit.geometry.local_trace(side, 3) @ limit.motions[name]).reshape(n, 3, -1)
            relative[:, :, limit.where[name]] += (2 * side - 1) * moved
        mu = unit.behaviour.friction_coefficient
        for angle in 2 * np.pi * np.arange(128) / 128:
            columns += list(relative[:, 0] + mu * (np.cos(angle) * relative[:, 1] + np.sin(angle) * relative[:, 2]))
    matrix = np.column_stack(columns) / np.abs(columns[0]).max()
    cost = np.zeros(matrix.shape[1])
    cost[0] = -1.0
    bounds = [(None, 1.0), *[(0.0, None)] * (matrix.shape[1] - 1)]
    held = -limit.path[1] / np.abs(columns[0]).max()
    return float(linprog(cost, A_eq=matrix, b_eq=held, bounds=bounds).x[0])
