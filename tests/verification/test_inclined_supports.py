"""Supports, symmetry, motions and loads along local axes: an assembly turned in space moves as it did before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import latin_fmu
from latin_fmu.errors import SceneError
from latin_fmu.propagator.model import closest_reduced
from latin_fmu.stability.surfaces import turned, typed_box, write_mesh

Tables = dict[str, Any]
EXACT = 1e-8
TURN = turned(np.array([1.0, 2.0, -0.5]), 37.0)
SHAKE = {"type": "table", "times": [0.0, 4e-6, 1e-5, 2e-5], "values": [0.0, 1.0, -0.5, 0.3]}
SIZE = np.array([0.02, 0.02, 0.01])
HEIGHTS = {"b1": 0.0, "b2": 0.01}


def shaken(folder: Path, turn: np.ndarray, cell: str = "hexahedron", rigid: bool = False, **keys: Any) -> Tables:
    """Two blocks with a plane of symmetry, one shaken and held along its own axes, the other one pressed and pushed."""
    axes = {"x": turn[:, 0].tolist(), "y": turn[:, 1].tolist()}
    bodies = {}
    for name, height in HEIGHTS.items():
        file = folder / f"{name}_{cell}_{'turned' if turn is TURN else 'straight'}.msh"
        write_mesh(file, typed_box(cell, np.array([0.0, 0.0, height]), SIZE, (2, 2, 2)), lambda x: x @ turn.T)
        bodies[name] = {"material": "steel", "mesh": {"file": file.name}}
    bodies["b2"]["rigid"] = rigid
    # Newton steps of a static problem hold floating bodies by weak dashpots: they end 1e-8 away
    solver = {"tolerance": 1e-12, "max_iterations": 9000, "newton": False} | {
        k: v for k, v in keys.items() if k == "propagator"
    }
    time = {"end": 2e-5, "instants": 40} | {k: v for k, v in keys.items() if k != "propagator"}
    driven = "displacement" if time.get("quasi_static") else "acceleration"
    amount = 1e-6 if driven == "displacement" else 2e5
    shaker = {"type": driven, "face": "b1.xmin", "components": ["x"], "value": [amount], "law": SHAKE, "axes": axes}
    made: Tables = {
        "name": "turned",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": bodies,
        "interface": {"i1": {"sides": ["b1.zmax", "b2.zmin"], "friction_coefficient": 0.3}},
        "boundary": {
            "low": {"type": "symmetry", "face": "b1.ymin"},
            "high": {"type": "symmetry", "face": "b2.ymin"},
            "base": {"type": "fixed", "face": "b1.zmin", "components": ["z"], "axes": axes},
            "shaker": shaker,
        },
        "load": {
            "press": {"face": "b2.zmax", "pressure": 2e6, "law": SHAKE | {"values": [0.0, 1.0, 1.0, 1.0]}},
            "push": {"face": "b2.xmax", "traction": [-2e5, 0.0, 1e5], "law": SHAKE, "axes": axes},
        },
        "time": time,
        "solver": solver,
        "output": {"fields": True, "reactions": True, "energy": True},
    }
    if turn is not TURN:
        for table in (*made["boundary"].values(), *made["load"].values()):
            table.pop("axes", None)
    return made


def solved(tables: Tables, folder: Path) -> latin_fmu.Solution:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables, folder))
    assert solution.converged, solution.status
    return solution


def off(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


@pytest.mark.parametrize(
    "keys",
    [
        {"scheme": "hht"},
        {"scheme": "generalized_alpha"},
        {"cell": "tetra10", "scheme": "hht"},
        {"rigid": True},
        {"quasi_static": True},
        {"start": "static"},
        {"propagator": {"type": "reduced", "modes": 20}},
        {"propagator": "cg"},
        {"propagator": "explicit", "instants": 300},
        {"propagator": "explicit", "instants": 300, "cell": "tetra10"},
    ],
    ids=str,
)
def test_turned_in_space_it_moves_as_before(tmp_path: Path, keys: Tables) -> None:
    """Displacements, contact tractions and reactions, in components of the turned axes."""
    before, after = (solved(shaken(tmp_path, turn, **keys), tmp_path) for turn in (np.eye(3), TURN))
    for name, body in before.substructures.items():
        assert off(after.substructures[name].displacement @ TURN, body.displacement) < EXACT
    assert off(after.interfaces["i1"].traction @ TURN, before.interfaces["i1"].traction) < EXACT
    for name, reaction in before.reactions.items():
        assert off(after.reactions[name].force @ TURN, reaction.force) < 10 * EXACT, name
    work = before.energy["work_of_loads"] if before.energy else np.zeros(1)
    if work.any():
        assert off(after.energy["work_of_loads"], work) < EXACT


def problems(tables: Tables, folder: Path) -> str:
    with pytest.raises(SceneError) as caught:
        latin_fmu.check(latin_fmu.scene_from_dict(tables, folder))
    return str(caught.value)


def test_conditions_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    """A face that is driven along a direction in which its edge is held; a periodic face with axes of its own."""
    tables = shaken(tmp_path, TURN)
    tables["boundary"]["base"]["components"] = ["x", "y", "z"]
    assert "boundary.shaker: drives nodes that another condition already fixes or drives" in problems(tables, tmp_path)
    tables = shaken(tmp_path, TURN)
    tables["boundary"]["around"] = {"type": "periodic", "faces": ["b1.xmin", "b1.xmax"]}
    assert "turns nodes of a periodic face" in problems(tables, tmp_path)


def test_two_planes_of_symmetry_hold_their_edge_in_both_directions(tmp_path: Path) -> None:
    """At an edge of oblique planes the free direction is that of the edge."""
    tables = shaken(tmp_path, TURN, rigid=False, quasi_static=True)
    tables["boundary"]["side"] = {"type": "symmetry", "face": "b2.xmin"}
    moved = solved(tables, tmp_path).substructures["b2"]
    local = np.asarray(moved.displacement)[-1] @ TURN
    where = moved.nodes @ TURN
    edge = (where[:, :2] < 1e-9).all(axis=1)
    assert edge.sum() == 3
    assert np.abs(local[edge, :2]).max() < 1e-12 * np.abs(local).max()
    assert np.abs(local[where[:, 0] < 1e-9, 0]).max() < 1e-12 * np.abs(local).max()
    assert np.abs(local[edge, 2]).max() > 0.1 * np.abs(local[:, 2]).max()


def test_a_direction_that_is_no_axis_is_no_copy_of_a_dof() -> None:
    """u = (0.6, 0.8, 0) q: the value closest to u = (3, 4, 5) is 5."""
    closest = closest_reduced(sp.csr_array([[0.6], [0.8], [0.0]]), np.array([[3.0], [4.0], [5.0]]))
    assert closest == pytest.approx(np.array([[5.0]]))
