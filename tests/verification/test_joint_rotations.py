"""Joints whose sides are apart: a rigid rotation of the assembly strains none, or it is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.api import check
from latin_fmu.errors import SceneError

SIDE, SPIN = 0.05, 1.0
LAYER = {"behaviour": "elastic_layer", "normal_stiffness": 1e11, "tangential_stiffness": 1e11}
DASHPOTS = {"behaviour": "viscous_joint", "normal_viscosity": 1e6, "tangential_viscosity": 1e6}


def pair(distance: float, *, rigid: bool = True, **tables: Any) -> dict[str, Any]:
    """Two cubes, one above the other, that turn about x through their common centre as one."""
    top, n = SIDE + distance, 1 if rigid else 2
    centre = np.array([0.5 * SIDE, 0.5 * SIDE, SIDE + 0.5 * distance])
    bodies = {}
    for name, z in (("low", 0.0), ("high", top)):
        middle = np.array([0.5 * SIDE, 0.5 * SIDE, z + 0.5 * SIDE])
        bodies[name] = {
            "material": "steel",
            "rigid": rigid,
            "box": {"origin": [0.0, 0.0, z], "size": [SIDE] * 3, "elements": [n, n, n]},
            "initial_spin": [SPIN, 0.0, 0.0],
            "initial_velocity": np.cross([SPIN, 0.0, 0.0], middle - centre).tolist(),
        }
    return {
        "name": "turning",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": bodies,
        "time": {"end": 4e-3, "instants": 400, "scheme": "newmark"},
        "solver": {"tolerance": 1e-9},
        "output": {"fields": True},
        **tables,
    }


def joint(**keys: Any) -> dict[str, Any]:
    return {"interface": {"joint": {"sides": ["low.zmax", "high.zmin"], **keys}}}


def spring(*ends: Any, **keys: Any) -> dict[str, Any]:
    return {"spring": {"joint": {"ends": list(ends), **keys}}}


def problem_of(tables: dict[str, Any]) -> Any:
    with pytest.raises(SceneError) as caught:
        check(latin_fmu.scene_from_dict(tables))
    (problem,) = caught.value.problems
    return problem


def spins(tables: dict[str, Any]) -> np.ndarray:
    """Angular velocity of each body about x, (n_body, n_time)."""
    outcome = latin_fmu.solve(latin_fmu.scene_from_dict(tables)).outcome
    found = []
    for history in outcome.substructures.values():
        arms = history.nodes - history.nodes.mean(axis=0)
        moved = history.velocity - history.velocity.mean(axis=1, keepdims=True)
        inertia = (arms[:, 1:] ** 2).sum()
        found.append((arms[:, 1] * moved[..., 2] - arms[:, 2] * moved[..., 1]).sum(axis=1) / inertia)
    return np.array(found)


@pytest.mark.parametrize("keys", [LAYER, DASHPOTS], ids=["elastic_layer", "viscous_joint"])
@pytest.mark.parametrize("distance", [1e-3, 10e-3])
def test_a_layer_with_a_thickness_is_refused(keys: dict[str, Any], distance: float) -> None:
    problem = problem_of(pair(distance, **joint(**keys)))
    assert problem.where == "interface.joint"
    assert problem.value == f"{distance:.4g} m"
    assert "move the meshes together" in problem.remedy


@pytest.mark.parametrize("keys", [LAYER, DASHPOTS], ids=["elastic_layer", "viscous_joint"])
def test_a_layer_without_one_turns_with_its_bodies(keys: dict[str, Any]) -> None:
    assert np.abs(spins(pair(0.0, **joint(**keys))) - SPIN).max() < 1e-6


@pytest.mark.parametrize("key", ["stiffness", "viscosity"])
@pytest.mark.parametrize("rigid", [True, False])
def test_a_spring_across_the_line_of_its_ends_is_refused(key: str, rigid: bool) -> None:
    faces = "low.zmax", "high.zmin"
    across = pair(1e-3, rigid=rigid, **spring(*faces, direction=[0.0, 1.0, 0.0], **{key: 100.0}))
    problem = problem_of(across)
    assert problem.where == "spring.joint"
    assert "both ends the same point" in problem.remedy
    lateral = pair(1e-3, rigid=rigid, **spring(*faces, **{f"lateral_{key}": 100.0}))
    assert problem_of(lateral).where == "spring.joint"


@pytest.mark.parametrize("key", ["stiffness", "viscosity"])
@pytest.mark.parametrize("way", ["line", "point"])
def test_its_remedies_leave_the_rotation_alone(key: str, way: str) -> None:
    """1e6 N/m, or 100 N s/m, that would halve the angular momentum across the line of the ends."""
    size = {key: 1e6 if key == "stiffness" else 100.0}
    if way == "line":
        tables = spring("low.zmin", "high.zmax", **size)
    else:
        point = [0.5 * SIDE, 0.5 * SIDE, SIDE]
        ends = [{"face": face, "point": point} for face in ("low.zmin", "high.zmax")]
        tables = spring(*ends, direction=[0.0, 1.0, 0.0], **size)
    assert np.abs(spins(pair(0.0, **tables)) - SPIN).max() < 1e-6


def test_supports_that_keep_it_from_turning_allow_a_thickness() -> None:
    base = {"base": {"type": "fixed", "face": "low.zmin"}}
    tables = pair(1e-3, **joint(**LAYER), boundary=base)
    for body in tables["substructure"].values():
        del body["initial_spin"], body["initial_velocity"]
    check(latin_fmu.scene_from_dict(tables))


@pytest.mark.parametrize("edge", ["low.ymin", "low.xmin"])
def test_a_hinge_does_not(edge: str) -> None:
    """The foot stays on its plane and one edge of it down: the assembly turns about that edge."""
    foot = {"type": "fixed", "face": "low.zmin", "components": ["x", "y"]}
    hinge = {"type": "fixed", "face": edge, "components": ["z"]}
    tables = pair(1e-3, **joint(**LAYER), boundary={"foot": foot, "hinge": hinge})
    for body in tables["substructure"].values():
        del body["initial_spin"], body["initial_velocity"]
    assert problem_of(tables).where == "interface.joint"


def test_a_spring_to_the_ground_acts_along_its_direction() -> None:
    """The ground does not turn: its end is where the spring begins."""
    tables = pair(0.0, **joint(behaviour="perfect"))
    ends = ["high.zmax", "ground"]
    tables["spring"] = {"tie": {"ends": ends, "direction": [0.0, 1.0, 0.0], "stiffness": 100.0}}
    check(latin_fmu.scene_from_dict(tables))
