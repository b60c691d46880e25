"""Quasi-static stacks of plates: one merged mesh as reference, flat iterations, no influence of k and dt."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg as spla

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.effects.explanation import explain
from latin_fmu.latin.coarse_problem import CoarseProblem
from tests.scenes import solve, solved

from .oracles.hexahedra import Block, merged
from .static_scenes import STEEL, add_block, plates, scene

SIZE, ELEMENTS = (0.06, 0.03, 0.01), (6, 3, 2)
PRESSURE, SHEAR = 50e6, 20e6


def reference(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and displacements of the plates merged into one mesh, assembled and solved by the tests' own code."""
    material = STEEL["young_modulus"], STEEL["poisson_ratio"], STEEL["density"]
    solid = merged([Block((0, 0, i * SIZE[2]), SIZE, ELEMENTS, *material) for i in range(n)])
    top = solid.on_plane(2, n * SIZE[2])
    force = np.zeros(solid.n_dof)
    areas = solid.face_areas(top)
    force[3 * top], force[3 * top + 2] = SHEAR * areas, -PRESSURE * areas
    base, side = solid.on_plane(2, 0.0), solid.on_plane(1, 0.0)
    held = np.unique(np.concatenate([3 * base, 3 * base + 1, 3 * base + 2, 3 * side + 1]))
    free = np.setdiff1d(np.arange(solid.n_dof), held)
    u = np.zeros(solid.n_dof)
    u[free] = spla.spsolve(solid.stiffness[free][:, free].tocsc(), force[free])
    return solid.nodes, u.reshape(-1, 3)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_bonded_plates_are_one_body(n: int):
    """Perfect interfaces against one mesh, to 1e-8 (one plate: no interface at all)."""
    made = plates(n, SIZE, ELEMENTS, pressure=PRESSURE, shear=SHEAR, steps=2, tolerance=1e-11)
    for interface in made["interface"].values():
        interface.pop("friction_coefficient")
        interface["behaviour"] = "perfect"
    solution = solve(made)
    nodes, u = reference(n)
    size = np.abs(u).max()
    for body in solution.substructures.values():
        distance = np.linalg.norm(nodes[:, None] - body.nodes[None], axis=2)
        nearest = distance.argmin(axis=0)
        assert distance.min(axis=0).max() < 1e-9
        assert body.displacement[-1] == pytest.approx(u[nearest], abs=1e-8 * size)


def iterations(n: int) -> tuple[float, int]:
    """Mean and largest number of iterations of an increment."""
    windows = solve(plates(n, pressure=100e6, shear=20e6, steps=20, tolerance=1e-3)).windows
    counts = [w.iterations for w in windows]
    return float(np.mean(counts)), max(counts)


def test_iterations_do_not_grow_with_the_stack():
    """4, 8, 16 plates pressed then sheared."""
    few, some, many = (iterations(n) for n in (4, 8, 16))
    assert few[0] < 6
    assert max(some[0], many[0]) <= 1.3 * few[0]
    # of the first increment, from nothing: Newton steps would take fewer, and cost more
    assert max(some[1], many[1]) <= 3.0 * few[1]


def test_coarse_problem_is_what_keeps_them_flat(monkeypatch: pytest.MonkeyPatch):
    """Without it a stack of 16 takes more than three times as many, or does not settle at all."""
    made = plates(16, pressure=100e6, shear=20e6, steps=10, newton=False)
    with_it = sum(w.iterations for w in solve(made).windows)
    monkeypatch.setattr(CoarseProblem, "sizes", {"n_coarse": 0, "n_coarse_here": 0, "n_coarse_own": 0})
    without = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(made)))
    assert not without.converged or sum(w.iterations for w in without.windows) > 3 * with_it


@pytest.mark.parametrize(
    "direction",
    [
        {"type": "automatic", "factor": 0.3},
        {"type": "automatic", "factor": 2.0},
        {"type": "impedance"},
        {"type": "diagonal"},
    ],
    ids=lambda d: f"{d['type']}-{d.get('factor', 1)}",
)
def test_search_direction_does_not_change_the_answer(direction: dict[str, Any]):
    """Forces and displacements of a sheared stack for other k."""
    made = plates(3, SIZE, ELEMENTS, pressure=PRESSURE, shear=0.2 * PRESSURE, steps=6, tolerance=1e-7)
    plain = solve(made)
    other = solve(made | {"solver": {"tolerance": 1e-7, "search_direction": direction}})
    scale = np.abs(plain.interfaces["i1"].force()).max()
    for name, history in plain.interfaces.items():
        assert other.interfaces[name].force() == pytest.approx(history.force(), abs=1e-5 * scale)
    u, v = (s.substructures["b3"].displacement for s in (plain, other))
    assert v == pytest.approx(u, abs=1e-4 * np.abs(u).max())


def test_unit_of_time_does_not_matter():
    """The same increments over 1 s and over 1e-4 s: equal counts, equal result."""
    slow = plates(3, SIZE, ELEMENTS, pressure=PRESSURE, shear=0.2 * PRESSURE, steps=6)
    fast = copy.deepcopy(slow)
    fast["time"]["end"] = 1e-4
    for load in fast["load"].values():
        load["law"]["times"] = [1e-4 * t for t in load["law"]["times"]]
    one, other = solve(slow), solve(fast)
    assert [w.iterations for w in one.windows] == [w.iterations for w in other.windows]
    for name, body in one.substructures.items():
        size = np.abs(body.displacement).max()
        assert other.substructures[name].displacement == pytest.approx(body.displacement, abs=1e-11 * size)


def test_forces_balance_on_every_plate():
    """Action and reaction carry the load down the stack to the iteration tolerance."""
    made = plates(4, SIZE, ELEMENTS, pressure=PRESSURE, shear=0.2 * PRESSURE, steps=6, tolerance=1e-8)
    solution = solve(made)
    load = SIZE[0] * SIZE[1] * PRESSURE * np.array([0.2, 0.0, -1.0])
    for history in solution.interfaces.values():
        force = history.force()[-1]
        assert force[[0, 2]] == pytest.approx(load[[0, 2]], abs=1e-6 * abs(load[2]))


def test_shipped_plates():
    """models/pressed_plates: the numbers of its README."""
    solution = solved("pressed_plates/scene")
    for history in solution.interfaces.values():
        assert history.force()[-1] == pytest.approx([19.2e3, 0.0, -80e3], abs=1e-3 * 80e3)
    energy = solution.energy
    assert energy["work_of_loads"][-1] == pytest.approx(0.624, rel=0.002)
    assert energy["friction_dissipation"][-1] == pytest.approx(0.0966, rel=0.005)


def test_penetration_does_not_add_up():
    """What the tolerance leaves open or overlapping in an increment is put right in the next."""
    solution = solve(plates(4, steps=60))
    squeezed = np.abs(solution.substructures["b4"].displacement[-1]).max()
    for history in solution.interfaces.values():
        assert history.gap.min() > -1e-3 * squeezed


@pytest.mark.parametrize("steps", [10, 40])
def test_sides_that_never_slide_stay_where_they_are(steps: int):
    """no_slip under pressure is a perfect bond, whatever gaps of the size of the tolerance the increments leave."""
    made = plates(4, (0.04, 0.04, 0.01), (4, 4, 2), pressure=10e6, shear=1.5e6, steps=steps)
    bonded = copy.deepcopy(made)
    for tables, behaviour in ((made, "no_slip"), (bonded, "perfect")):
        for interface in tables["interface"].values():
            interface.pop("friction_coefficient")
            interface["behaviour"] = behaviour
    u, exact = (solve(s).substructures["b4"].displacement[-1] for s in (made, bonded))
    assert u == pytest.approx(exact, abs=1e-2 * np.abs(exact).max())


def test_loads_are_followed_back():
    """Pressed, sheared until it slips in part, unsheared, unpressed but for 1 %: friction took the work."""
    made = plates(3, SIZE, ELEMENTS, pressure=PRESSURE, shear=0.27 * PRESSURE, steps=24, tolerance=1e-5)
    made["load"]["press"]["law"] |= {"times": [0, 0.25, 0.75, 1], "values": [0, 1, 1, 0.01]}
    made["load"]["shear"]["law"] |= {"times": [0, 0.25, 0.5, 0.75, 1], "values": [0, 0, 1, 0, 0]}
    solution = solve(made)
    energy = solution.energy
    assert energy["elastic"][-1] < 1e-3 * energy["elastic"].max()
    assert energy["friction_dissipation"][-1] > 0.05 * energy["elastic"].max()
    lost = energy["friction_dissipation"] + energy["contact_dissipation"]
    assert energy["work_of_loads"] == pytest.approx(lost + energy["elastic"], abs=0.02 * energy["elastic"].max())
    assert (np.diff(energy["friction_dissipation"]) >= -1e-9 * energy["elastic"].max()).all()
    assert np.abs(energy["balance"]).max() < 1e-12 * energy["elastic"].max()


def test_an_observer_sees_the_iterates_and_changes_nothing():
    """The trial displacement of the last iterate of an increment is what the run keeps."""
    made = latin_fmu.scene_from_dict(plates(2, SIZE, ELEMENTS, pressure=PRESSURE, shear=0.1 * PRESSURE, steps=4))
    seen: dict[int, np.ndarray] = {}

    def watch(iteration: latin_fmu.Iteration) -> None:
        seen[iteration.window] = iteration.displacement("b2")[0]

    watched, plain = latin_fmu.solve(made, observer=watch), latin_fmu.solve(made)
    kept = plain.substructures["b2"].displacement
    assert (watched.substructures["b2"].displacement == kept).all()
    for window, u in seen.items():
        assert u == pytest.approx(kept[window + 1], abs=1e-12 * np.abs(kept).max())


def test_slow_dynamics_come_to_the_same():
    """Loads a hundred times slower than the waves: the run with inertia gives the same forces and displacements, and
    says what the quasi-static one would cost."""
    still = plates(2, SIZE, ELEMENTS, pressure=PRESSURE, shear=0.1 * PRESSURE, steps=10)
    moving = copy.deepcopy(still)
    moving["time"] = {"end": 2e-3, "instants": 500}
    for load in moving["load"].values():
        load["law"]["times"] = [2e-3 * t for t in load["law"]["times"]]
    scene = latin_fmu.scene_from_dict(moving)
    # increments of equilibrium cost more iterations than steps: worth a tenth where there are many steps
    many = latin_fmu.scene_from_dict({**moving, "time": {"end": 2e-3, "instants": 5000}})
    said = [s.what for s in explain(many).suggestions if "time.quasi_static=true" in s.settings]
    assert not any("time.quasi_static=true" in s.settings for s in explain(scene).suggestions)
    assert len(said) == 1
    assert "times slower than the longest wave transit" in said[0]
    one, other = solve(still), latin_fmu.solve(scene)
    assert other.converged, other.status
    force, reference = (s.interfaces["i1"].force()[-1] for s in (other, one))
    assert force == pytest.approx(reference, abs=0.01 * np.abs(reference).max())
    u, exact = (s.substructures["b2"].displacement[-1] for s in (other, one))
    assert u == pytest.approx(exact, abs=0.03 * np.abs(exact).max())


def test_a_stall_of_a_tall_stack_is_passed_before_newton_steps():
    """64 plates of 8x8x2: 23, then 31 iterations an increment; 400 where the acceleration goes on after its stall."""
    solution = solve(plates(64, SIZE, (8, 8, 2), pressure=50e6, shear=2e5, steps=8))
    assert max(w.iterations for w in solution.windows) < 60


@pytest.mark.parametrize(
    "pressed",
    [
        {"preload": 1e6},
        {"preload_force": 100.0},
        {"behaviour": "soft_contact", "preload": 1e6, "normal_stiffness": 1e14},
    ],
    ids=["pressure", "force", "soft"],
)
def test_a_preload_of_any_kind_is_the_scale_of_a_scene_without_loads(pressed: dict[str, Any]) -> None:
    """Two held blocks pressed with 1 MPa: tolerances are shares of it, and round-off is no energy."""
    tables = scene(4)
    for i, name in enumerate("ab"):
        add_block(tables, name, (0.0, 0.0, 0.01 * i), (0.01, 0.01, 0.01), (2, 2, 2))
    tables["boundary"] = {f: {"type": "fixed", "face": face} for f, face in (("low", "a.zmin"), ("high", "b.zmax"))}
    tables["interface"]["meet"] = {"sides": ["a.zmax", "b.zmin"], **pressed}
    made = latin_fmu.scene_from_dict(tables)
    assert discretise(made).characteristic_traction == pytest.approx(1e6)
    solution = latin_fmu.solve(made)
    assert solution.status.startswith("converged"), solution.status
    np.testing.assert_allclose(solution.interfaces["meet"].force()[:, 2], -100.0, rtol=1e-9)
