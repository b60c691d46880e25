"""Interfaces solved with by truncated tables against the exact operator: forces, defects, corrections, limits."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.compiled import PLAIN
from latin_fmu.effects.cost import Prediction
from latin_fmu.effects.explanation import choices
from latin_fmu.errors import SceneError
from latin_fmu.latin import search_direction
from latin_fmu.propagator import interface_probing
from latin_fmu.propagator.interface_probing import Table
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, column, half_sine
from tests.scenes import pressed_stack, rayleigh

pytestmark = pytest.mark.skipif(PLAIN, reason="the kernels are not compiled")

Tables = dict[str, Any]
MODELS = Path(__file__).resolve().parents[2] / "models"
COURANT_ONE = 1.5e-7  # s, for elements of 1 mm


def plates(m: int, instants: int, courant: float = 1.0, **solver: Any) -> Tables:
    """Two plates of m x m x 2 elements of 1 mm with friction, aluminium under steel, pressed and sheared."""
    size, elements = (1e-3 * m, 1e-3 * m, 2e-3), (m, m, 2)
    step = courant * COURANT_ONE
    tables = column(
        {"lower": Box(ALUMINIUM, size, elements), "upper": Box(STEEL, size, elements)},
        {"crush": {"friction_coefficient": 0.3}},
        {"end": step * instants, "step": step, "scheme": "hht"},
        load={
            "press": {"face": "upper.zmax", "pressure": 2e8, "law": half_sine(40 * COURANT_ONE)},
            "shear": {"face": "upper.zmax", "traction": [3e7, 1e7, 0.0], "law": half_sine(30 * COURANT_ONE)},
        },
        solver={"share_identical": False, **solver},
        output={"fields": False},
    )
    tables["boundary"] = {"base": {"type": "symmetry", "face": "lower.zmin"}}
    return tables


def solved(tables: Tables, form: str, **solver: Any) -> latin_fmu.Solution:
    """Solution with one form of the interfaces."""
    tables = copy.deepcopy(tables)
    tables["solver"] |= {"interface_operator": form, **solver}
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables))


def tractions(solution: latin_fmu.Solution) -> np.ndarray:
    """Tractions of all interfaces, one after the other."""
    return np.concatenate([history.traction.ravel() for history in solution.interfaces.values()])


def apart(first: latin_fmu.Solution, second: latin_fmu.Solution) -> float:
    """Difference of the tractions of all channels and instants over those of the second, in the mean square."""
    a, b = tractions(first), tractions(second)
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def defects(solution: latin_fmu.Solution) -> list[float]:
    """Defects of the instants, some larger than zero: tables were used."""
    own = [window.defect for window in solution.windows]
    assert max(own) > 0.0
    return own


def corrections(solution: latin_fmu.Solution) -> int:
    """Corrections of all instants."""
    return sum(window.corrections for window in solution.windows)


TIGHT = {"tolerance": 1e-5, "force_tolerance": 1e-5}


def test_forces_at_courant_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Truncated at 1e-4, iterated to 1e-5: forces within 5e-5 of those of the exact operator."""
    monkeypatch.setattr(interface_probing, "_OF_TOLERANCE", 10.0)
    tables = plates(16, 40, **TIGHT)
    sparse, exact = (solved(tables, form) for form in ("sparse", "exact"))
    assert sparse.converged
    assert max(defects(sparse)) <= 1e-5
    assert apart(sparse, exact) <= 5e-5


@pytest.mark.parametrize("courant", [1.0, 2.0, 5.0])
def test_forces_of_longer_steps(courant: float) -> None:
    """Corrected to 1e-4: forces within 2e-4 of those of the exact operator iterated to 1e-7, the defect within the
    tolerance at every instant."""
    tables = plates(12, 30, courant, tolerance=1e-4, force_tolerance=1e-3)
    sparse, exact = solved(tables, "sparse"), solved(tables, "exact", tolerance=1e-7, force_tolerance=1e-6)
    assert sparse.converged
    assert max(defects(sparse)) <= 1e-4
    assert apart(sparse, exact) <= 2e-4


def spoiled(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    """Let the tables of Y be wrong by a factor."""
    made = search_direction.interface_tables

    def tables(*given: Any) -> dict[str, Table]:
        own = made(*given)
        if "y" in own:
            own["y"] = replace(own["y"], values=(factor * own["y"].values).astype(np.float32))
        return own

    monkeypatch.setattr(search_direction, "interface_tables", tables)


def test_a_wrong_table_is_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Y wrong by a fifth: corrections at most instants, and the same forces."""
    tables = plates(12, 20, tolerance=1e-4, force_tolerance=1e-3)
    exact = solved(tables, "exact")
    spoiled(monkeypatch, 0.8)
    sparse = solved(tables, "sparse")
    assert corrections(sparse) > 10
    assert max(defects(sparse)) <= 1e-4
    assert apart(sparse, exact) <= 2e-4


def test_a_useless_table_is_left_for_the_exact_operator(monkeypatch: pytest.MonkeyPatch) -> None:
    """Y of the wrong sign: the instants are solved again with the exact operator, to the same forces."""
    tables = plates(12, 20, tolerance=1e-4, force_tolerance=1e-3)
    exact = solved(tables, "exact")
    spoiled(monkeypatch, -3.0)
    sparse = solved(tables, "sparse")
    assert sparse.converged
    assert max(w.defect for w in sparse.windows) <= 1e-4
    assert apart(sparse, exact) <= 2e-4


@pytest.mark.parametrize(
    ("wrong", "left"),
    [
        ("none", {"normal", "tangential", "y"}),
        ("y", {"normal", "tangential"}),
        ("normal", {"y"}),
        ("tangential", {"y"}),
    ],
)
def test_an_inaccurate_table_is_left_out(wrong: str, left: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables are verified by solutions: Y by a fifth too small, those of the force residual by half too large."""
    probed, made, names = interface_probing._probed, search_direction.interface_tables, set[str]()
    truncations = {rough: name for name, _, rough in interface_probing._OF_NORMS}

    def spoiled_probe(solve: Any, points: Any, n: int, truncation: float, most: float) -> Table | None:
        table, name = probed(solve, points, n, truncation, most), truncations.get(truncation, "y")
        if table is None or name != wrong:
            return table
        return replace(table, values=table.values * np.float32(0.8 if name == "y" else 1.5))

    def tables(*given: Any) -> dict[str, Table]:
        own = made(*given)
        names.update(own)
        return own

    monkeypatch.setattr(interface_probing, "_probed", spoiled_probe)
    monkeypatch.setattr(search_direction, "interface_tables", tables)
    solution = solved(plates(12, 3, tolerance=1e-4, force_tolerance=1e-3), "sparse")
    assert names == left
    assert (max(window.defect for window in solution.windows) > 0.0) == ("y" in left)


def bodies(interface: Tables, **solver: Any) -> Tables:
    """Blocks of two classes, one with several members, on moving ground."""
    steel, soft = (Box(material, (6e-3, 5e-3, 3e-3), (6, 5, 3)) for material in (STEEL, ALUMINIUM))
    tables = pressed_stack(
        [soft, steel, steel, steel],
        {"end": 30 * COURANT_ONE, "instants": 30, "scheme": "hht"},
        duration=30 * COURANT_ONE,
        solver={"tolerance": 1e-4, "force_tolerance": 1e-3, **solver},
        output={"fields": False, "energy": True},
    )
    tables["interface"]["i1"] |= interface
    return tables


def plain(_: Tables) -> None:
    """Classes of one member and of three."""


def non_matching(tables: Tables) -> None:
    tables["substructure"]["b3"]["box"]["elements"] = [5, 6, 3]


def landing(tables: Tables) -> None:
    """The default scheme of bodies that land."""
    tables["time"].pop("scheme")
    tables["substructure"]["b3"]["initial_velocity"] = [1.0, 0.0, -5.0]
    tables["interface"]["i2"]["gap"] = 2e-6


def bonded(tables: Tables) -> None:
    tables["interface"]["i0"] = {"sides": tables["interface"]["i0"]["sides"], "behaviour": "perfect"}


def frictionless(tables: Tables) -> None:
    """Points with three channels and with one on the same body."""
    tables["interface"]["i1"]["friction_coefficient"] = 0.0


def several_threads(tables: Tables) -> None:
    tables["solver"]["threads"] = 2


@pytest.mark.parametrize(
    "change",
    [plain, rayleigh, non_matching, landing, bonded, frictionless, several_threads],
    ids=lambda change: change.__name__,
)
def test_equal_answers(change: Callable[[Tables], None]) -> None:
    """Forces within 3e-4 of those of the exact operator iterated to 1e-7, energies accounted for."""
    tables = bodies({})
    change(tables)
    sparse, exact = solved(tables, "sparse"), solved(tables, "exact", tolerance=1e-7, force_tolerance=1e-6)
    assert sparse.converged
    assert max(defects(sparse)) <= 1e-4
    assert apart(sparse, exact) <= 3e-4
    assert sparse.energy is not None


def test_meshes_from_files() -> None:
    """Plates of the shipped model with unstructured meshes, one of them between two interfaces."""
    tables = latin_fmu.load_scene(MODELS / "punched_plates" / "scene.toml").tables()
    tables["time"] = {"end": 6e-6, "step": 2e-7, "scheme": "hht"}
    tables["solver"] = {"tolerance": 1e-4, "force_tolerance": 1e-3}
    for body in tables["substructure"].values():
        body["mesh"]["file"] = str(MODELS / "punched_plates" / body["mesh"]["file"])
    sparse, exact = solved(tables, "sparse"), solved(tables, "exact", tolerance=1e-7, force_tolerance=1e-6)
    assert sparse.converged
    assert max(defects(sparse)) <= 1e-4
    assert apart(sparse, exact) <= 3e-4


def test_defects_are_in_the_results() -> None:
    solution = solved(plates(8, 10), "sparse")
    convergence = solution.to_datatree()["convergence"]
    assert float(convergence["defect"].max()) == max(defects(solution))
    assert int(convergence["corrections"].sum()) == corrections(solution)
    assert solution.report()["defect"] == max(defects(solution))


@pytest.mark.parametrize(
    ("solver", "courant"),
    [({"tolerance": 1e-7, "force_tolerance": 1e-6}, 1.0), ({}, 10.0)],
    ids=["tolerances below single precision", "long steps"],
)
def test_the_exact_operator_elsewhere(solver: Tables, courant: float) -> None:
    """Where tables are of no use the exact operator is taken: no defect."""
    sparse, exact = (solved(plates(6, 6, courant, **solver), form) for form in ("sparse", "exact"))
    assert all(window.defect == 0.0 for window in sparse.windows)
    np.testing.assert_array_equal(tractions(sparse), tractions(exact))


@pytest.mark.parametrize("change", [{"window": 6}, {"window": "whole"}])
def test_refused_over_longer_windows(change: Tables) -> None:
    with pytest.raises(SceneError, match=r"solver\.interface_operator.*only within an instant"):
        solved(plates(4, 12), "sparse", **change)


def test_truncation_and_reach_are_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """``explain`` predicts the distance that the tables of the run have, without a factor."""
    scene = latin_fmu.scene_from_dict(plates(16, 1))
    text = choices(Prediction(discretise(scene)))["interfaces"]
    assert text.startswith("sparse tables, truncated at 0.0001 of the largest entry, points within ")
    assert text.endswith("in lower, upper")
    made, radii = search_direction.interface_tables, list[float]()

    def tables(*given: Any) -> dict[str, Table]:
        own = made(*given)
        radii.append(1e3 * own["y"].radius)
        return own

    monkeypatch.setattr(search_direction, "interface_tables", tables)
    latin_fmu.solve(scene)
    assert abs(float(text.split("points within ")[1].split(" mm")[0]) / max(radii) - 1.0) < 0.2


def test_colours_keep_their_distance() -> None:
    """Points on two faces that meet at an edge, and on a cylinder: no two of a colour within the distance."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 15), np.linspace(0.0, 1.0, 15))
    flat = np.stack([u.ravel(), v.ravel(), 0.0 * u.ravel()], axis=1)
    round_ = np.stack([u.ravel(), np.cos(3 * v.ravel()), np.sin(3 * v.ravel())], axis=1)
    positions = np.concatenate([flat, flat[:, [2, 1, 0]], round_])
    colour = interface_probing.coloured(cKDTree(positions), positions, 0.3)
    for own in range(colour.max() + 1):
        same = positions[colour == own]
        apart_ = np.linalg.norm(same[:, None] - same, axis=2)[~np.eye(len(same), dtype=bool)]
        assert apart_.min(initial=1.0) > 0.3
    assert colour.max() < 60


# -- bodies that nothing touches, and couplings at massless nodes ---------------------------------------------------
BLOCK = (0.02, 0.02, 0.01)


def beside(**solver: Any) -> Tables:
    """A pressed pair, and a block that touches nothing, which falls by a body force."""
    tables = column(
        {"low": Box(STEEL, BLOCK, (2, 2, 2)), "up": Box(STEEL, BLOCK, (2, 2, 2))},
        {"face": {"friction_coefficient": 0.3}},
        {"end": 3e-6, "instants": 10},
        boundary={"base": {"type": "fixed", "face": "low.zmin"}},
        load={"press": {"face": "up.zmax", "pressure": 1e7}},
        solver=solver,
        output={"fields": True},
    )
    tables["substructure"]["far"] = copy.deepcopy(tables["substructure"]["up"])
    tables["substructure"]["far"]["box"]["origin"] = [1.0, 0.0, 0.0]
    tables["substructure"]["far"]["body_force"] = [0.0, 0.0, -1e9]
    return tables


@pytest.mark.parametrize("form", ["exact", "sparse"])
def test_a_body_that_nothing_touches(form: str) -> None:
    """It falls by a t^2 / 2 beside the others, which are solved for as with the operator of the program's choice."""
    known, found = solved(beside(), "automatic"), solved(beside(), form)
    assert found.converged
    fall = -0.5 * 1e9 / STEEL.density * 3e-6**2
    assert found.substructures["far"].displacement[-1, :, 2] == pytest.approx(np.full(27, fall), rel=1e-6)
    assert apart(found, known) < 2e-3
    tables = beside()
    tables["solver"]["interface_operator"] = form
    assert choices(Prediction(discretise(latin_fmu.scene_from_dict(tables))))  # its cost is predicted, too


@pytest.mark.parametrize("form", ["exact", "sparse"])
@pytest.mark.parametrize("rotations", [False, True])
def test_a_coupling_at_nodes_without_mass(form: str, rotations: bool) -> None:
    """The edge of a coupled face belongs to a contact, whose nodes have no mass in this scheme; a force acts from the
    start, so that tractions of the coupling are found at t = 0."""
    tables = beside()
    del tables["substructure"]["far"]
    del tables["load"]["press"]
    tables["time"]["scheme"] = "generalized_alpha"
    tables["substructure"]["up"]["body_force"] = [0.0, 0.0, -1e9]
    tables["coupling"] = {"c": {"ends": ["low.ymax", "up.ymax"], "rotations": rotations}}
    known, found = (solved(tables, kind, tolerance=1e-7) for kind in ("automatic", form))
    assert found.converged
    assert apart(found, known) < 1e-5
