"""Bolts: tension and clamp force, stress of the shank, load share, order of tightening, propagators, bad input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from latin_fmu import scene_from_dict, solve
from latin_fmu.api import check
from latin_fmu.assembly.merged_assembly import merge
from latin_fmu.building import discretise, solver_ready, started
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.effects.cost import run_size
from latin_fmu.effects.explanation import explain
from latin_fmu.errors import SceneError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import Mesh
from latin_fmu.modal.modes import vibration_modes
from latin_fmu.model_exchange.reduce import reduced_system
from latin_fmu.parametric.study import sweep
from latin_fmu.results.solution import Solution
from latin_fmu.scene.threads import tensile_stress_area
from latin_fmu.scene.units import SI, UNIT_SYSTEMS
from latin_fmu.stability.scenes import Box, Material, column, placed
from latin_fmu.stability.surfaces import turned, typed_box, write_mesh

from .bolted_meshes import SHANK_AREA, write_joint

Array = np.ndarray
E = 200e9
STEEL = Material(E, 7800.0, 0.3, "steel")
PRELOAD = 5000.0
RING = np.pi * (16e-3**2 - 11e-3**2)  # of the outer faces of the plates that are pulled, about


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Meshes of two plates and one bolt."""
    return write_joint(tmp_path_factory.mktemp("joint"))


def bar(held: list[str], bolt: dict[str, Any], poisson: float = 0.3, **other: Any) -> dict[str, Any]:
    """A bar of 10 x 10 x 50 mm with the faces ``held`` fixed and one bolt."""
    made = column(
        {"bar": Box(replace(STEEL, poisson=poisson), (0.01, 0.01, 0.05), (2, 2, 7))},
        {},
        {"end": 1.0, "instants": 2, "quasi_static": True},
        boundary={face: {"type": "fixed", "face": f"bar.{face}"} for face in held},
        bolt={"b": {"substructure": "bar", "axis": [0, 0, 1], **bolt}},
        output={"stress": True, "every": 1, "fields": True},
    )
    # any stress: above 1 GPa a bolt without a yield stress is refused
    made["material"]["steel"]["yield_stress"] = 1e12
    return made | other


def joint(files: dict[str, Path], pull: float = 0.0, mu: float = 0.8, **other: Any) -> dict[str, Any]:
    """Two plates under one bolt of 5 kN, then pulled apart by the force ``pull``, N."""
    contact = {"behaviour": "contact", "friction_coefficient": mu}
    sides = {
        "head": ["upper.seat", "bolt.head"],
        "nut": ["bolt.nut", "lower.seat"],
        "plates": ["lower.joint", "upper.joint"],
    }
    data: dict[str, Any] = {
        "name": "joint",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {n: {"material": "steel", "mesh": {"file": str(files[n])}} for n in ("bolt", "lower", "upper")},
        "interface": {name: {"sides": pair, **contact} for name, pair in sides.items()},
        "boundary": {"hold": {"type": "fixed", "face": "lower.far"}},
        "bolt": {"b": {"substructure": "bolt", "axis": [0, 0, 1], "force": PRELOAD}},
        "time": {"end": 1.0, "instants": 2, "quasi_static": True},
        "output": {"stress": True},
    }
    if pull:
        ramp = {"type": "table", "times": [0, 1], "values": [0, 1]}
        data["load"] = {"pull": {"face": "upper.far", "traction": [0, 0, pull / RING], "law": ramp}}
    return data | other


def shank_stress(solution: Solution, reach: float) -> Array:
    """Mean axial stress of the bolt's elements between -reach and reach, (n_time,), Pa."""
    history = solution.substructures["bolt"]
    middle = np.abs(history.nodes[history.cells][:, :, 2].mean(axis=1)) < reach
    volume = Elements(Mesh.uniform(history.nodes, "hexahedron", history.cells)).volume[middle]
    assert history.stress is not None
    return np.asarray(history.stress[:, middle, 2] @ volume / volume.sum())


def stressed(solution: Solution) -> Array:
    """Stresses of the bar, (n_time, n_cell, 6), Pa."""
    stress = solution.substructures["bar"].stress
    assert stress is not None
    return np.asarray(stress)


# -- one body ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("point", [None, [0.005, 0.005, 0.012], [0.005, 0.005, 0.03]])
def test_shortening_of_a_held_bar(point: list[float] | None) -> None:
    """F = E A delta / L wherever the cut is; uniform stress in all elements, those at the cut too."""
    bolt = {"shortening": 20e-6} | ({} if point is None else {"point": point})
    solution = solve(scene_from_dict(bar(["zmin", "zmax"], bolt, poisson=0.0)))
    force = E * 1e-4 * 20e-6 / 0.05
    assert solution.bolts["b"].force == pytest.approx(force, rel=1e-10)
    assert stressed(solution)[..., 2] == pytest.approx(force / 1e-4, rel=1e-9)
    assert solution.bolts["b"].area == pytest.approx(1e-4, rel=1e-12)


@pytest.mark.parametrize(("shortening", "told"), [(6e-4, False), (4e-3, True)])
def test_the_cut_is_no_strain(shortening: float, told: bool) -> None:
    """A twelfth of an element at the cut, 1.2 % of the bar; then 8 % of the bar."""
    result = solve(scene_from_dict(bar(["zmin", "zmax"], {"shortening": shortening})))
    assert any("has a strain of" in warning for warning in result.warnings) == told


def test_shortening_of_a_free_end() -> None:
    """No stress; the free end moves towards the held one by the shortening, in one piece."""
    solution = solve(scene_from_dict(bar(["zmin"], {"shortening": 20e-6})))
    assert np.abs(stressed(solution)).max() < 1e-12 * E
    assert np.abs(solution.bolts["b"].force).max() < 1e-6
    history = solution.substructures["bar"]
    assert history.displacement is not None
    moved = history.displacement[-1][history.nodes[:, 2] > 0.03]
    assert moved == pytest.approx(np.tile([0.0, 0.0, -20e-6], (len(moved), 1)), abs=1e-15)


def test_force_of_a_held_bar() -> None:
    """The force is met, and its shortening is F L / (E A)."""
    solution = solve(scene_from_dict(bar(["zmin", "zmax"], {"force": PRELOAD}, poisson=0.0)))
    bolt = solution.bolts["b"]
    assert bolt.force == pytest.approx(PRELOAD, rel=1e-10)
    assert bolt.shortening == pytest.approx(PRELOAD * 0.05 / (E * 1e-4), rel=1e-10)
    assert stressed(solution)[..., 2] == pytest.approx(PRELOAD / 1e-4, rel=1e-9)


def test_recovered_fields_hold_the_cut() -> None:
    """Strains and nodal stresses of a stretched shank are uniform across the cut, with bending modes too."""
    data = bar(["zmin", "zmax"], {"force": PRELOAD}, poisson=0.0)
    data["substructure"]["bar"]["bending_modes"] = True
    data["output"] |= {"strain": True, "nodal_stress": True, "principal_stress": True}
    tree = solve(scene_from_dict(data)).to_datatree()["substructures/bar"]
    stress = PRELOAD / 1e-4
    assert tree["strain"].sel(strain_component="zz").values == pytest.approx(stress / E, rel=1e-9)
    assert tree["nodal_stress"].sel(stress_component="zz").values == pytest.approx(stress, rel=1e-9)
    assert tree["principal_stress"].sel(principal=1).values == pytest.approx(stress, rel=1e-9)


@pytest.mark.parametrize("cells", ["tetra", "tetra10", "wedge", "hexahedron20", "hexahedron27"])
def test_cut_along_any_cells(cells: str, tmp_path: Path) -> None:
    """A turned bar of any cells, whose cut is not plane: F = E A delta / L, uniform stress, the section projected."""
    turn = turned(np.array([1.0, 2.0, 3.0]), 40.0)
    mesh = typed_box(cells, np.zeros(3), np.array([0.01, 0.01, 0.05]), (2, 2, 5))
    write_mesh(tmp_path / "bar.msh", mesh, lambda x: x @ turn.T)
    axis = turn @ [0.0, 0.0, 1.0]
    data = bar(["zmin", "zmax"], {"shortening": 20e-6, "axis": axis.tolist()}, poisson=0.0)
    data["substructure"]["bar"] = {"material": "steel", "mesh": {"file": str(tmp_path / "bar.msh")}}
    solution = solve(scene_from_dict(data))
    force = E * 1e-4 * 20e-6 / 0.05
    assert solution.bolts["b"].area == pytest.approx(1e-4, rel=1e-9)
    assert solution.bolts["b"].force == pytest.approx(force, rel=1e-8)
    along = np.einsum("i,j->ij", axis, axis)[(0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)] * [1, 1, 1, 2, 2, 2]
    assert stressed(solution) @ along == pytest.approx(force / 1e-4, rel=1e-8)


# -- two plates -------------------------------------------------------------------------------------------------------
def test_two_plates_under_one_bolt(files: dict[str, Path]) -> None:
    """Bolt force = clamp force on all three interfaces = 5000 N; mean stress of the shank 110.2 MPa."""
    solution = solve(scene_from_dict(joint(files, mu=0.2)))
    bolt = solution.bolts["b"]
    assert bolt.force == pytest.approx(PRELOAD, rel=1e-8)
    for history in solution.interfaces.values():
        assert history.normal_resultant() == pytest.approx(PRELOAD, rel=1e-6)
    assert bolt.area == pytest.approx(SHANK_AREA, rel=1e-9)
    for reach in (3.1e-3, 10e-3):
        assert shank_stress(solution, reach) == pytest.approx(110.2e6, rel=1e-4)
    assert bolt.force / bolt.area == pytest.approx(110.2e6, rel=1e-6)
    group = solution.to_datatree()["bolts/b"]
    assert group["tightening_force"].values == pytest.approx([PRELOAD])
    assert "tightened to" in solution.summary(details=True)
    assert solution.report()["bolts"]["b"]["target_force"] == PRELOAD


def test_thread_of_a_separate_nut(files: dict[str, Path]) -> None:
    """A perfect interface bonds screw and nut: force and shortening are those of bolt and nut in one mesh."""
    data = joint(files)
    del data["substructure"]["bolt"]
    for name in ("screw", "nut"):
        data["substructure"][name] = {"material": "steel", "mesh": {"file": str(files[name])}}
    data["interface"]["head"]["sides"] = ["upper.seat", "screw.head"]
    data["interface"]["nut"]["sides"] = ["nut.nut", "lower.seat"]
    data["interface"]["thread"] = {"sides": ["screw.thread", "nut.thread"], "behaviour": "perfect"}
    data["bolt"]["b"]["substructure"] = "screw"
    two, one = solve(scene_from_dict(data)), solve(scene_from_dict(joint(files)))
    assert two.bolts["b"].force == pytest.approx(PRELOAD, rel=1e-8)
    assert two.bolts["b"].shortening == pytest.approx(one.bolts["b"].shortening, rel=1e-6)
    assert np.linalg.norm(two.interfaces["thread"].force(), axis=1) == pytest.approx(PRELOAD, rel=1e-6)


def test_plates_pulled_apart_after_the_lock(files: dict[str, Path]) -> None:
    """The bolt force grows by phi F, phi the share of the shank in one linear body of the same parts (3 %)."""
    pulled = solve(scene_from_dict(joint(files, pull=2000.0)))
    load = pulled.outcome.resultants["upper"].loads[2]
    whole = joint(files, pull=2000.0)
    del whole["bolt"]
    whole["interface"] = {
        name: {"sides": table["sides"], "behaviour": "perfect"} for name, table in whole["interface"].items()
    }
    share = shank_stress(solve(scene_from_dict(whole)), 3.1e-3)[-1] * SHANK_AREA / load
    growth = (pulled.bolts["b"].force - PRELOAD) / load
    assert growth == pytest.approx([0.0, 0.5 * share, share], rel=0.03, abs=1e-9)
    clamped = pulled.interfaces["plates"].normal_resultant()
    assert clamped == pytest.approx(pulled.bolts["b"].force - load * np.array([0, 0.5, 1]), rel=1e-4)


# -- several bolts ----------------------------------------------------------------------------------------------------
BODIES = {"left": 0.0, "middle": 25e-3, "right": 50e-3}


def frame(bolts: dict[str, dict[str, Any]], **other: Any) -> dict[str, Any]:
    """Two beams of 60 mm on three columns of 50 mm, all bonded; ``bolts`` by column."""
    beam, part = Box(STEEL, (60e-3, 10e-3, 10e-3), (12, 2, 2)), Box(STEEL, (10e-3, 10e-3, 50e-3), (2, 2, 5))
    bodies = {"lower": (beam, (0.0, 0.0, 0.0)), "upper": (beam, (0.0, 0.0, 60e-3))}
    bodies |= {name: (part, (x, 0.0, 10e-3)) for name, x in BODIES.items()}
    bonds = {f"{name}_foot": ["lower.zmax", f"{name}.zmin"] for name in BODIES}
    bonds |= {f"{name}_top": [f"{name}.zmax", "upper.zmin"] for name in BODIES}
    made = placed(
        bodies,
        {"end": 1.0, "instants": 1, "quasi_static": True},
        interface={name: {"sides": sides, "behaviour": "perfect"} for name, sides in bonds.items()},
        boundary={"hold": {"type": "fixed", "face": "lower.zmin"}},
        bolt={name: {"substructure": name, "axis": [0, 0, 1], **table} for name, table in bolts.items()},
        solver={"tolerance": 1e-8},
    )
    return made | other


@pytest.fixture(scope="module")
def influence() -> Array:
    """Tensions of the bolts left and right (rows) per shortening of one of them (columns), from two linear solves."""
    columns = []
    for name in ("left", "right"):
        both = {n: {"shortening": 1e-5 if n == name else 1e-30} for n in ("left", "right")}
        solved = solve(scene_from_dict(frame(both)))
        columns.append([solved.bolts[n].force[-1] / 1e-5 for n in ("left", "right")])
    return np.array(columns).T


def test_second_bolt_changes_the_force_of_the_first(influence: Array) -> None:
    """Elastic interaction: left to 4 kN, then right to 3 kN, against the influence coefficients."""
    assert influence[0, 1] == pytest.approx(influence[1, 0], rel=1e-7)  # reciprocity
    assert abs(influence[0, 1]) > 0.02 * influence[0, 0]
    bolts = {"left": {"force": 4000.0, "order": 2}, "right": {"force": 3000.0, "order": 5}}
    solved = solve(scene_from_dict(frame(bolts))).bolts
    first = 4000.0 / influence[0, 0]
    second = (3000.0 - influence[1, 0] * first) / influence[1, 1]
    assert solved["left"].orders == (2, 5)
    assert solved["left"].tightening == pytest.approx([4000.0, influence[0] @ [first, second]], rel=1e-6)
    assert solved["right"].tightening == pytest.approx([influence[1, 0] * first, 3000.0], rel=1e-6)
    assert [solved[n].shortening for n in ("left", "right")] == pytest.approx([first, second], rel=1e-6)
    assert solved["left"].force[-1] == pytest.approx(solved["left"].tightening[-1], rel=1e-9)


def test_merged_assembly_carries_the_bolts() -> None:
    """Bonded to one body, the frame under the loads of its locked bolts has their forces."""
    moving = {"end": 1e-6, "instants": 1}
    scene = scene_from_dict(frame({"left": {"force": 4000.0}, "right": {"force": 3000.0}}, time=moving))
    discretised = discretise(scene)
    problem = solver_ready(*started(discretised, {}))
    merged = merge([m for c in discretised.classes for m in c.members], discretised.units, problem.info)
    amplitudes = merged.histories(problem.timeline, np.array([0.0, 1.0])).amplitudes
    p, model = merged.model.expansion, merged.model
    force = sum(history[-1] * load.pattern for history, load in zip(amplitudes, model.loads, strict=True))
    u = p @ spsolve(sp.csc_array(p.T @ model.stiffness @ p), p.T @ force)
    bolts = problem.output.bolts
    told = {n: bolts[n].cut_term(f"bolt.{n}", 0) * bolts[n].description.shortening for n in ("left", "right")}
    forces = [told[n] - (bolts[n].pattern @ u[merged.where[n]])[0] for n in ("left", "right")]
    assert forces == pytest.approx([4000.0, 3000.0], rel=1e-6)


@pytest.mark.parametrize("identical", [True, False])
def test_bolts_of_one_order_reach_their_forces_together(influence: Array, identical: bool) -> None:
    """Both forces are met at once, of bodies that share their operators too."""
    bolts = {"left": {"force": 4000.0}, "right": {"force": 3000.0}}
    solver = {"tolerance": 1e-8, "share_identical": identical}
    solved = solve(scene_from_dict(frame(bolts, solver=solver))).bolts
    assert [solved[n].force[-1] for n in ("left", "right")] == pytest.approx([4000.0, 3000.0], rel=1e-8)
    expected = np.linalg.solve(influence, [4000.0, 3000.0])
    assert [solved[n].shortening for n in ("left", "right")] == pytest.approx(expected, rel=1e-6)


def test_study_over_the_force_of_a_bolt(influence: Array) -> None:
    """A parametric study keeps the forces of the bolts: that of the other one is linear in the one that varies."""
    bolts = {"left": {"force": 1000.0}, "right": {"shortening": 10e-6, "order": 2}}
    study = sweep(scene_from_dict(frame(bolts)), {"bolt.left.force": [1000.0, 3000.0]})
    forces = study["last_bolt_force"].transpose(..., "bolt").sel(bolt=["left", "right"]).values
    left = np.array([1000.0, 3000.0])
    shortenings = np.array([left / influence[0, 0], [10e-6, 10e-6]])
    assert forces == pytest.approx((influence @ shortenings).T, rel=1e-5)


def test_force_and_shortening_in_one_order(influence: Array) -> None:
    """One bolt by its shortening, the other by its force, together."""
    bolts = {"left": {"shortening": 10e-6}, "right": {"force": 3000.0}}
    solved = solve(scene_from_dict(frame(bolts))).bolts
    other = (3000.0 - influence[1, 0] * 10e-6) / influence[1, 1]
    assert solved["right"].shortening == pytest.approx(other, rel=1e-6)
    assert solved["left"].force[-1] == pytest.approx(influence[0] @ [10e-6, other], rel=1e-6)


def test_bolts_are_tightened_on_what_nothing_holds() -> None:
    """Free in space the tensions are reached, and then nothing moves."""
    bolts = {"left": {"force": 4000.0}, "right": {"force": 4000.0}}
    free = frame(bolts, time={"end": 1e-5, "instants": 20}, output={"fields": True})
    del free["boundary"]
    solved = solve(scene_from_dict(free))
    shortening = solved.bolts["left"].shortening
    for name in bolts:
        assert solved.bolts[name].force == pytest.approx(4000.0, rel=1e-8)
        assert solved.bolts[name].shortening == pytest.approx(shortening, rel=1e-8)  # the frame is symmetric
    speed = max(float(np.abs(np.asarray(b.velocity)).max()) for b in solved.substructures.values())
    assert speed < 1e-8 * shortening / 1e-5


# -- in motion --------------------------------------------------------------------------------------------------------
def moving(files: dict[str, Path], pull: float = 0.0, instants: int = 40, **other: Any) -> dict[str, Any]:
    """The joint in motion for 40 us, a half sine of 20 us pulling the upper plate."""
    data = joint(files, time={"end": 40e-6, "instants": instants}, solver={"tolerance": 1e-7}, output={})
    if pull:
        law = {"type": "half_sine", "duration": 20e-6}
        data["load"] = {"pull": {"face": "upper.far", "traction": [0, 0, pull / RING], "law": law}}
    return data | other


def test_tight_joint_stays_at_rest(files: dict[str, Path]) -> None:
    """Without loads nothing moves and the force of the bolt stays."""
    solution = solve(scene_from_dict(moving(files)))
    assert solution.bolts["b"].force == pytest.approx(PRELOAD, rel=1e-9)
    for history in solution.interfaces.values():
        assert np.abs(history.velocity).max() < 1e-9


def test_force_returns_after_a_hit(files: dict[str, Path]) -> None:
    """Damped ring-down: the force swings with the load and comes back to that of the lock."""
    data = moving(files, pull=2000.0, time={"end": 300e-6, "instants": 150})
    data["material"]["steel"] |= {"rayleigh_mass": 6e4, "frame": "absolute"}
    force = solve(scene_from_dict(data)).bolts["b"].force
    assert np.ptp(force) > 50.0
    assert np.abs(force[-20:] - PRELOAD).max() < 0.01 * np.abs(force - PRELOAD).max()


def test_reduced_bodies_carry_the_bolt(files: dict[str, Path]) -> None:
    """Reduced run against the direct one: the change of the force within 2 %."""
    modes = {"tolerance": 1e-7, "propagator": {"type": "reduced", "modes": 60}}
    direct, reduced = (
        solve(scene_from_dict(moving(files, pull=1000.0, **more))).bolts["b"].force - PRELOAD
        for more in ({}, {"solver": modes})
    )
    assert reduced[0] == pytest.approx(0.0, abs=1e-6)
    assert reduced == pytest.approx(direct, abs=0.02 * np.abs(direct).max())


def test_explicit_run_carries_the_bolt(files: dict[str, Path]) -> None:
    """The explicit run keeps the equilibrium; under a load its force follows that of a direct one with short steps
    within 6 % of the largest change (its mass is lumped, and the mesh is coarse)."""
    rest = moving(files, time={"end": 1e-6, "instants": 80})
    rest["solver"] = {"tolerance": 1e-7, "propagator": "explicit"}
    assert solve(scene_from_dict(rest)).bolts["b"].force == pytest.approx(PRELOAD, rel=1e-9)
    short = moving(files, pull=1000.0, time={"end": 8e-6, "instants": 640})
    direct = solve(scene_from_dict(short | {"time": {"end": 8e-6, "instants": 80}})).bolts["b"].force - PRELOAD
    short["solver"] = {"tolerance": 1e-7, "propagator": "explicit"}
    explicit = solve(scene_from_dict(short)).bolts["b"].force[::8] - PRELOAD
    assert np.abs(direct).max() > 20.0
    assert explicit == pytest.approx(direct, abs=0.06 * np.abs(direct).max())


def test_load_that_acts_at_the_start(files: dict[str, Path]) -> None:
    """A constant load comes after the tightening, before t = 0: the force at the start is that of the static run."""
    tables = joint(files, pull=2000.0)
    tables["solver"] = tables.get("solver", {}) | {"tolerance": 1e-8, "force_tolerance": 1e-8}
    static = solve(scene_from_dict(tables)).bolts["b"]
    data = moving(files, time={"end": 2e-6, "instants": 2})
    data["load"] = {"pull": {"face": "upper.far", "traction": [0, 0, 2000.0 / RING]}}
    solution = solve(scene_from_dict(data))
    assert solution.bolts["b"].force == pytest.approx(static.force[-1], rel=1e-7)
    assert solution.bolts["b"].tightening == pytest.approx([PRELOAD], rel=1e-10)


@pytest.mark.parametrize("quasi_static", [False, True])
def test_segments_give_the_force_of_one_run(files: dict[str, Path], quasi_static: bool) -> None:
    """A run in two segments, as an FMU makes them, and back to a snapshot between them."""
    data = joint(files, pull=2000.0) if quasi_static else moving(files, pull=1000.0, instants=10)
    if quasi_static:  # in one run over all bodies at once, in segments body by body: equal to the tolerance
        data["solver"] = data.get("solver", {}) | {"tolerance": 1e-9, "force_tolerance": 1e-9}
    scene = scene_from_dict(data)
    end, n = scene.time.end, scene.time.n_step
    whole = solve(scene).bolts["b"].force
    run = SegmentedRun(scene)
    first = run.advance(end / 2, n // 2)
    kept = run.snapshot()
    second = run.advance(end, n - n // 2)
    run.restore(kept)
    again = run.advance(end, n - n // 2)
    parts = np.concatenate([first.bolts["b"].force, second.bolts["b"].force[1:]])
    assert parts == pytest.approx(whole, rel=1e-7)
    assert (again.bolts["b"].force == second.bolts["b"].force).all()


def test_session_tells_the_force(files: dict[str, Path]) -> None:
    """Output of an FMU for co-simulation: the force when initialized and after steps; reduced models refuse bolts."""
    scene = scene_from_dict(moving(files, pull=1000.0, instants=10))
    whole = solve(scene).bolts["b"].force
    session = Session(scene, Settings())
    session.initialize()
    forces = [float(session.values(["bolt.b.force"])[0])]
    for start in (0.0, 20e-6):
        assert session.step(start, 20e-6)
        forces.append(float(session.values(["bolt.b.force"])[0]))
    assert forces == pytest.approx(whole[::5], rel=1e-7)
    with pytest.raises(SceneError, match=r"bolt.b: a reduced model has no bolts"):
        reduced_system(scene)


def test_frequencies_of_the_tight_joint(files: dict[str, Path]) -> None:
    """Points pressed by the bolt stick: those of the bonded parts; with a gap under the head left open they are not."""
    scene = scene_from_dict(moving(files))
    sticking, bonded = (vibration_modes(scene, joints, 3) for joints in ("sticking", "bonded"))
    assert sticking.frequency == pytest.approx(bonded.frequency, rel=1e-6)
    assert all("closed when the bolts are tight" in remark for remark in sticking.remarks)
    data = moving(files)
    data["interface"]["plates"] |= {"gap": 20e-6, "friction_coefficient": 0.0}
    wide = vibration_modes(scene_from_dict(data), "sticking", 3)  # closed by the bolt, free to slide
    assert "48 of 48" in wide.remarks[2]
    assert wide.frequency[0] < 0.9 * bonded.frequency[0]


@pytest.mark.parametrize("factor", [None, 0.15])
def test_torque_gives_a_force(files: dict[str, Path], factor: float | None) -> None:
    """F = T / (K d); the table of bolts and ``check`` say it."""
    data = joint(files)
    data["bolt"]["b"] = {"substructure": "bolt", "axis": [0, 0, 1], "torque": 6.0, "diameter": 8e-3}
    data["bolt"]["b"] |= {} if factor is None else {"nut_factor": factor}
    scene = scene_from_dict(data)
    bolt = solve(scene).bolts["b"]
    assert bolt.tightening[-1] == pytest.approx(6.0 / ((factor or 0.2) * 8e-3), rel=1e-9)
    assert bolt.force[-1] == pytest.approx(6.0 / ((factor or 0.2) * 8e-3), rel=1e-6)
    line = next(line for line in check(scene) if line.startswith("  bolt b:"))
    assert f"N of 6 N m, nut factor {factor or 0.2:g}, mean stress" in line


def test_torque_and_frictions_give_a_force_and_a_torsion(files: dict[str, Path]) -> None:
    """R13/1 of VDI 2230-1, by hand: M8 with friction 0.12 and a bearing surface from 9 to 11.63 mm; M_G is
    F (0.16 P + 0.58 d_2 mu); the clamp length is that between the seats."""
    data = joint(files)
    screw = {
        "torque": 6.0,
        "thread": "M8",
        "thread_friction": 0.12,
        "head_friction": 0.1,
        "head_bearing": [9e-3, 11.63e-3],
    }
    data["bolt"]["b"] = {"substructure": "bolt", "axis": [0, 0, 1], **screw}
    thread, head = 0.16 * 1.25e-3 + 0.58 * 7.188e-3 * 0.12, 0.05 * 10.315e-3
    scene = scene_from_dict(data)
    solution = solve(scene)
    bolt = solution.bolts["b"]
    assert bolt.tightening[-1] == pytest.approx(6.0 / (thread + head), rel=1e-4)
    report = solution.report()["bolts"]["b"]
    # 0.58 stands for 1.155 / 2
    assert report["assembly_torsion"] == pytest.approx(bolt.tightening[-1] * thread, rel=5e-3)
    assert report["clamp_length"] == pytest.approx(20e-3)
    line = next(line for line in check(scene) if line.startswith("  bolt b:"))
    assert "N of 6 N m, friction 0.12 of the thread and 0.1 under the head, mean stress" in line


def test_check_and_explain_tell_of_bolts(files: dict[str, Path]) -> None:
    """Section, stress and shortening in the lines of the command check; an effect of the command explain."""
    scene = scene_from_dict(moving(files))
    line = next(line for line in check(scene) if line.startswith("  bolt b:"))
    for word in ("section 4.53721e-05 m2", "at [0, 0, 0]", "5000 N", "1.102e+08 Pa", "order 1"):
        assert word in line
    assert {"bolts", "static start"} <= {effect.name for effect in explain(scene).effects if effect.on}


# -- bad input --------------------------------------------------------------------------------------------------------
REFUSED: list[tuple[str, dict[str, Any], tuple[str, ...]]] = [
    ("bolt.b", {"shortening": 1e-5}, ("bolt.b:", "both 'force' and 'shortening'")),
    ("bolt.b", {"force": None}, ("bolt.b:", "neither 'force' nor 'torque' nor 'shortening'")),
    ("bolt.b", {"torque": 5.0, "diameter": 6e-3}, ("bolt.b:", "both 'force' and 'torque'")),
    ("bolt.b", {"force": None, "torque": 5.0}, ("bolt.b.torque", "needs 'diameter'", "nut_factor diameter")),
    ("bolt.b", {"nut_factor": 0.15}, ("bolt.b.nut_factor", "needs 'torque'")),
    ("bolt.b", {"force": None, "torque": 5.0, "diameter": 0.0}, ("bolt.b.diameter", "> 0", "[m]")),
    ("bolt.b", {"substructure": "bold"}, ("bolt.b.substructure", "did you mean 'bolt'")),
    ("bolt.b", {"axis": [1, 0, 0]}, ("bolt.b", "no section of bolt across the axis")),
    ("bolt.b", {"axis": [1, 0, 0], "point": [0, 0, 0]}, ("bolt.b.axis", "no shank", "m wide", "m long")),
    ("bolt.b", {"substructure": "upper"}, ("bolt.b.axis", "no shank", "0.032 m wide", "0.01 m long")),
    ("bolt.b", {"point": [0, 0, 0.1]}, ("bolt.b", "meets no element", "plane at 0.1 m", "0.015 m")),
    ("bolt.b", {"point": [0.03, 0, 0]}, ("bolt.b.point", "m away", "[0.03, 0.0, 0.0]")),
    ("bolt.b", {"axis": [0, 0, 0]}, ("bolt.b.axis", "direction cannot be zero")),
    ("bolt.b", {"order": 0}, ("bolt.b.order",)),
    ("bolt.b", {"force": -5.0}, ("bolt.b.force",)),
    ("substructure.bolt", {"rigid": True}, ("bolt.b.substructure", "rigid body cannot elongate")),
    ("substructure.bolt", {"initial_velocity": [0, 0, 1.0]}, ("bolt.b.substructure", "[0, 0, 1.0]", "at rest")),
    ("time", {"start": "given"}, ("time.start", "bolts are tightened")),
    ("material.steel", {"yield_stress": 100e6}, ("bolt.b", "5000 N / 4.53721e-05 m2", "1.102e+08 Pa", "1e+08 Pa")),
    ("bolt.b", {"thread_friction": 0.12}, ("bolt.b.thread_friction", "needs its size", "0.12")),
    (
        "bolt.b",
        {"force": None, "torque": 5.0, "thread": "M8", "thread_friction": 0.12, "nut_factor": 0.2},
        ("bolt.b.nut_factor", "stands for the friction", "one of the two"),
    ),
    ("bolt.b", {"head_friction": 0.1}, ("bolt.b.head_friction", "'torque' and 'thread_friction' alone")),
    ("bolt.b", {"head_bearing": [9e-3, 8e-3]}, ("bolt.b.head_bearing", "no ring", "inner < outer")),
    ("bolt.b", {"thread": "M6.1"}, ("bolt.b.thread", "no metric or unified thread", "M6.1", "M10x1")),
    ("interface.plates", None, ("bolt.b.force", "nothing resists", "with upper")),
]


@pytest.mark.parametrize(("where", "change", "words"), REFUSED, ids=[" ".join(map(str, r[:2])) for r in REFUSED])
def test_refused(files: dict[str, Path], where: str, change: dict[str, Any] | None, words: tuple[str, ...]) -> None:
    """Bolts that cannot be: a sentence with the place and the numbers."""
    data = moving(files)
    *path, last = where.split(".")
    table = data[path[0]] if path else data
    if change is None:
        del table[last]
    else:
        table[last] = {key: value for key, value in (table[last] | change).items() if value is not None}
    with pytest.raises(SceneError) as error:
        check(scene_from_dict(data))
    for word in words:
        assert word in str(error.value)


def test_yield_stress_counts_for_a_shortening(files: dict[str, Path]) -> None:
    """The tension that a shortening brings is checked, too; and a cut through a face with an interface is refused."""
    data = moving(files)
    data["bolt"]["b"] = {"substructure": "bolt", "axis": [0, 0, 1], "shortening": 16.61e-6}
    data["material"]["steel"]["yield_stress"] = 100e6
    with pytest.raises(SceneError, match=r"mean stress of the shank, 50\d\d.* N / 4.53721e-05 m2"):
        solve(scene_from_dict(data))
    data["material"]["steel"]["yield_stress"] = 120e6
    assert solve(scene_from_dict(data)).bolts["b"].force[0] / 4.53721e-05 == pytest.approx(111e6, rel=0.01)


def test_the_stress_of_a_thread_is_over_its_stress_area(files: dict[str, Path]) -> None:
    """By hand: 5 kN over the 36.6 mm2 of M8 are 137 MPa, over the 45.4 mm2 of the mesh 110 MPa."""
    data = moving(files)
    data["material"]["steel"]["yield_stress"] = 120e6
    plain = solve(scene_from_dict(data))
    assert "at most 110 MPa over its meshed section" in " ".join(plain.summary().split())
    assert "thread_stress" not in plain.to_datatree()["bolts/b"]
    data["bolt"]["b"]["thread"] = "M8"
    with pytest.raises(SceneError, match=r"stress of the thread M8, 5000 N / 3.66\d+e-05 m2.*1.366e\+08 Pa"):
        check(scene_from_dict(data))
    data["material"]["steel"]["yield_stress"] = 140e6
    threaded = solve(scene_from_dict(data))
    assert (threaded.bolts["b"].force == plain.bolts["b"].force).all()
    assert "at most 137 MPa over the stress area of M8" in " ".join(threaded.summary().split())
    stored = threaded.to_datatree()["bolts/b"]
    assert float(stored["thread_stress"][0]) == pytest.approx(5e3 / 36.6e-6, rel=1e-3)
    assert threaded.report()["bolts"]["b"]["largest_stress"] == pytest.approx(float(stored["thread_stress"].max()))
    line = next(text for text in check(scene_from_dict(data)) if text.startswith("  bolt b"))
    assert "mean stress 1.366e+08 Pa over the stress area of M8, 3.661e-05 m2" in line
    data["units"] = "none"
    with pytest.raises(SceneError, match=r"bolt.b.thread: a thread has a size in mm"):
        scene_from_dict(data)


# ISO 898-1:2013, tables 4 and 6
STRESS_AREAS = {
    "M3": 5.03,
    "M5": 14.2,
    "M8": 36.6,
    "M12": 84.3,
    "M24": 353,
    "M8x1": 39.2,
    "M10x1.25": 61.2,
    "M12x1.5": 88.1,
}


def test_stress_areas_are_those_of_the_standard() -> None:
    assert {t: tensile_stress_area(t) for t in STRESS_AREAS} == pytest.approx(STRESS_AREAS, rel=2e-3)
    mm = scene_from_dict(bar(["zmin", "zmax"], {"force": PRELOAD, "thread": "M24"})).bolt["b"]
    assert mm.thread_area(UNIT_SYSTEMS["mm-t-s-MPa"]) == pytest.approx(1e6 * (mm.thread_area(SI) or 0.0))


def test_a_tension_that_follows_a_load_in_statics_does_not_oscillate() -> None:
    """A bar without interfaces whose end is moved to and fro: what is lost is that of the last value."""
    times = np.linspace(0.0, 1.0, 21)
    law = {"type": "table", "times": times.tolist(), "values": np.sin(7.0 * np.pi * times).tolist()}
    moved = {"type": "displacement", "face": "bar.zmax", "components": ["z"], "value": [1e-6], "law": law}
    data = bar(["zmin"], {"force": PRELOAD}, time={"end": 1.0, "instants": 20, "quasi_static": True})
    data["boundary"]["moved"] = moved
    data["load"] = {}
    solution = solve(scene_from_dict(data))
    force = solution.bolts["b"].force
    assert np.ptp(force) > 0.1 * PRELOAD
    assert float(solution.to_datatree()["bolts/b"]["end_force"]) == force[-1]
    assert "oscillates" not in solution.summary()


def test_cut_on_an_interface_is_refused() -> None:
    """A node of the cut that belongs to an interface, or is held along the axis, is counted in the sentence."""
    data = bar(["zmin", "zmax"], {"force": PRELOAD, "point": [0.005, 0.005, 0.012]})
    data["boundary"]["side"] = {"type": "fixed", "face": "bar.xmin", "components": ["z"]}
    with pytest.raises(SceneError, match="3 of the 9 nodes of the cut of bar are held along the axis"):
        check(scene_from_dict(data))
    data["boundary"]["side"]["components"] = ["x"]  # a plane of symmetry through the axis
    assert solve(scene_from_dict(data)).bolts["b"].force == pytest.approx(PRELOAD)
    del data["boundary"]["side"]
    data["interface"] = {"thread": {"sides": ["bar.xmin", "ground"], "behaviour": "perfect"}}
    with pytest.raises(SceneError, match="3 of the 9 nodes of the cut of bar are of interfaces: thread"):
        check(scene_from_dict(data))


def test_what_leaves_no_section_is_named() -> None:
    """An interface along the whole shank comes first, with its stretch, then held ends; a thread at one end leaves
    sections for the cut."""
    data = bar(["zmin"], {"force": PRELOAD})
    data["interface"] = {"thread": {"sides": ["bar.xmin", "ground"], "behaviour": "perfect"}}
    with pytest.raises(SceneError) as error:
        check(scene_from_dict(data))
    text = str(error.value)
    assert "interface thread from 0 to 0.05 m, held nodes from 0 to 0 m, bar from 0 to 0.05 m along the axis" in text
    assert "the threaded faces alone" in text
    data["interface"]["thread"]["sides"][0] = "bar.zmax"
    assert any(line.startswith("  bolt b:") for line in check(scene_from_dict(data)))


@pytest.mark.slow
def test_force_that_is_not_reached() -> None:
    """A shank that is pressed to the beam by 100 N cannot pull at it with more: which bolt, the force reached and the
    target."""
    data = frame({"left": {"force": 4000.0}})
    data["interface"]["left_top"] = {"sides": ["left.zmax", "upper.zmin"], "preload_force": 100.0}
    with pytest.raises(SceneError) as error:
        solve(scene_from_dict(data))
    for word in ("bolt.left", "bolts of order 1 cannot be tightened", "left 0 of 4000 N"):
        assert word in str(error.value)


@pytest.mark.parametrize(("order", "pull", "problems"), [(1, 0.0, 1), (2, 0.0, 2), (2, 1e5, 3)])
def test_increments_before_the_motion_are_counted(order: int, pull: float, problems: int) -> None:
    """Of every order of bolts, and of the equilibrium under what acts at t = 0."""
    bolts = {"left": {"force": 4000.0, "order": 1}, "right": {"force": 3000.0, "order": order}}
    time = {"end": 1e-6, "instants": 1, "start": {"type": "static", "increments": 3}}
    loads = {"pull": {"face": "upper.zmax", "traction": [0.0, 0.0, pull]}} if pull else {}
    discretised = discretise(scene_from_dict(frame(bolts, time=time, load=loads)))
    assert run_size(discretised).increments == 3 * problems
