"""Effects that a scene does not use are absent: same result as with the effect idle, nothing counted for it."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly import body as body_module
from latin_fmu.building import build
from latin_fmu.fem.elements import MeanStress
from latin_fmu.latin import solver, windows
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine
from tests.scenes import solve

Tables = dict[str, Any]


def scene(**interface: Any) -> Tables:
    """Two elastic blocks that touch, the lower one pushed off the axis: friction, waves, no symmetry."""
    block = Box(STEEL, (0.01, 0.01, 0.02), (2, 2, 4))
    return column(
        {"a": block, "b": block},
        {"meet": interface},
        {"end": 2e-5, "instants": 60},
        load={"push": {"face": "a.zmin", "traction": [1e6, 0.0, 5e6], "law": half_sine(8e-6)}},
        output={"fields": True},
    )


def same(first: latin_fmu.Solution, second: latin_fmu.Solution, within: float) -> None:
    """Equal displacements of every substructure, relative to the largest of all."""
    largest = max(np.abs(h.displacement).max() for h in second.substructures.values())
    for name, history in first.substructures.items():
        other = second.substructures[name].displacement
        assert np.abs(history.displacement - other).max() <= within * largest, name


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Calls of what effects call, counted."""
    counted: Counter[str] = Counter()

    def watch(owner: Any, name: str, label: str) -> None:
        original = getattr(owner, name)

        def counting(*arguments: Any, **keys: Any) -> Any:
            counted[label] += 1
            return original(*arguments, **keys)

        monkeypatch.setattr(owner, name, counting)

    watch(MeanStress, "__call__", "stress")
    watch(body_module, "stiffness", "stiffness")
    watch(solver.WindowSolver, "solve", "iteration")
    return counted


@pytest.fixture
def images(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Images of the runs of a test, in order; numbers of what layers start from are marked with NaN before a run."""
    run_images: list[Any] = []
    march = windows.Run.all

    def marked(run: windows.Run) -> None:
        run.image.field("layer", run.image.n_flat)[:] = np.nan
        run_images.append(run.image)
        march(run)

    monkeypatch.setattr(windows.Run, "all", marked)
    return run_images


# -- interfaces ---------------------------------------------------------------------------------------------------
def test_no_friction_no_tangential_unknowns() -> None:
    without, idle = scene(), scene(friction_coefficient=1e-13)
    without["solver"] = idle["solver"] = {"tolerance": 1e-8}
    same(solve(without), solve(idle), 1e-7)
    few, many = (build(latin_fmu.scene_from_dict(t)).assembly for t in (without, idle))
    assert many.layout.n_flat == 3 * few.layout.n_flat == 54
    assert [p.n_channel for p in few.propagators] == [9, 9]
    history = solve(without).interfaces["meet"]
    assert history.friction_power is None
    assert "friction_power" not in solve(without).to_datatree()["interfaces/meet"]
    assert solve(idle).interfaces["meet"].friction_power is not None


def test_a_gap_that_never_closes_costs_one_check_an_instant() -> None:
    open_, free = scene(gap=1.0, friction_coefficient=0.3), scene()
    open_["time"]["scheme"] = "hht"  # where bodies may land the mass of their contact nodes is moved
    del free["interface"]
    checked = solve(open_)
    same(solve(free), checked, 1e-13)
    assert {w.iterations for w in checked.windows} == {1}
    assert not checked.interfaces["meet"].traction.any()


@pytest.mark.parametrize(
    "idle",
    [
        {"behaviour": "elastic_layer", "normal_stiffness": 0.0, "tangential_stiffness": 0.0},
        {"behaviour": "viscous_joint", "normal_viscosity": 0.0, "tangential_viscosity": 0.0},
    ],
    ids=["layer", "joint"],
)
def test_a_layer_of_no_stiffness_is_no_interface(idle: Tables) -> None:
    free = scene()
    del free["interface"]
    same(solve(free), solve(scene(**idle)), 1e-13)


def test_stiff_layers_and_joints_are_bonds() -> None:
    bonded = solve(scene(behaviour="perfect"))
    layer = scene(behaviour="elastic_layer", normal_stiffness=1e19, tangential_stiffness=1e19)
    joint = scene(behaviour="viscous_joint", normal_viscosity=1e15, tangential_viscosity=1e15)
    for tables in (layer, joint):
        tables["solver"] = {"tolerance": 1e-6}
        same(bonded, solve(tables), 1e-4)


def test_without_layers_nothing_reads_what_they_start_from(images: list[Any]) -> None:
    solve(scene())
    solve(scene(behaviour="elastic_layer", normal_stiffness=1e14, tangential_stiffness=1e14))
    without, layered = (image.field("layer", image.n_flat) for image in images)
    assert np.isnan(without).all()
    assert np.isfinite(layered).all()
    assert layered.any()


def test_no_preload_no_balancing_force() -> None:
    none, idle = scene(), scene(preload=1e-20)
    count = [
        sum(len(p.members[0].loads) for p in build(latin_fmu.scene_from_dict(t)).assembly.propagators)
        for t in (none, idle)
    ]
    assert count == [1, 3]
    same(solve(none), solve(idle), 1e-6)


# -- bonds: one linear pass ---------------------------------------------------------------------------------------
def test_perfect_interfaces_only_means_one_pass_and_no_iteration(calls: Counter[str], images: list[Any]) -> None:
    solution = solve(scene(behaviour="perfect"))
    assert calls["iteration"] == 0
    assert images[0].run[0]["direct_bonds"] == 1
    assert solution.outcome.marched == 1.0
    assert {w.iterations for w in solution.windows} == {1}
    assert solution.error_indicator < 1e-10
    tight = scene(behaviour="perfect")
    tight["solver"] = {"bonds": "iterate", "tolerance": 1e-11}
    iterated = solve(tight)
    assert iterated.outcome.passes > 2.0
    same(solution, iterated, 1e-9)
    force, other = (s.interfaces["meet"].force() for s in (solution, iterated))
    assert np.abs(force - other).max() < 1e-8 * np.abs(other).max()


def test_bonds_that_say_the_same_twice_are_solved_too() -> None:
    """Four blocks around an edge, each bonded to two neighbours: the fourth bond repeats the others on the edge."""
    names = {"a": (0.0, 0.0), "b": (0.01, 0.0), "c": (0.01, 0.01), "d": (0.0, 0.01)}
    tables = scene()
    tables["substructure"] = {
        n: {"material": "steel", "box": {"origin": [x, y, 0.0], "size": [0.01] * 3, "elements": [2] * 3}}
        for n, (x, y) in names.items()
    }
    pairs = {"ab": "xmax xmin", "bc": "ymax ymin", "dc": "xmax xmin", "ad": "ymax ymin"}
    tables["interface"] = {
        p: {"sides": [f"{p[i]}.{f}" for i, f in enumerate(faces.split())], "behaviour": "perfect"}
        for p, faces in pairs.items()
    }
    solution = solve(tables)
    tables["solver"] = {"bonds": "iterate", "tolerance": 1e-10, "max_iterations": 2000}
    same(solution, solve(tables), 1e-8)
    assert solution.error_indicator < 1e-10


def test_bonds_to_moving_ground() -> None:
    """Bonded to ground at constant speed, over two segments: the block follows."""
    from latin_fmu.cosim.segments import SegmentedRun

    tables = scene()
    del tables["load"]
    tables["interface"] = {
        "meet": {"sides": ["a.zmax", "b.zmin"], "behaviour": "perfect"},
        "base": {
            "sides": ["a.zmin", "ground"],
            "behaviour": "perfect",
            "ground_velocity": {"direction": [0.0, 0.0, 1.0], "amplitude": 2.0},
        },
    }
    for part in tables["substructure"].values():
        part["initial_velocity"] = [0.0, 0.0, 2.0]
    run = SegmentedRun(latin_fmu.scene_from_dict(tables))
    assert run.advance(1e-5, 30).accepted
    assert run.advance(3e-5, 60).accepted
    for name in "ab":
        np.testing.assert_allclose(run.displacement(name), np.tile([0.0, 0.0, 6e-5], (45, 1)), atol=1e-16)


# -- bodies -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("key", ["rayleigh_mass", "rayleigh_stiffness"])
def test_no_damping_no_damping_matrix(key: str) -> None:
    none, idle = scene(), scene()
    idle["material"]["steel"][key] = 1e-25
    matrices = [build(latin_fmu.scene_from_dict(t)).assembly.propagators[0].members[0].damping for t in (none, idle)]
    assert matrices[0] is None
    assert matrices[1] is not None
    same(solve(none), solve(idle), 1e-9)


def test_an_absorbing_end_does_nothing_before_a_wave_arrives() -> None:
    none, idle = scene(), scene()
    idle["boundary"] = {"out": {"type": "absorbing", "face": "b.zmax"}}
    for tables in (none, idle):
        tables["time"] = {"end": 4e-6, "instants": 12}  # the wave is in the first block still
    matrices = [build(latin_fmu.scene_from_dict(t)).assembly.propagators[-1].members[0].damping for t in (none, idle)]
    assert matrices[0] is None
    same(solve(none), solve(idle), 1e-3)


def test_no_body_force_no_load() -> None:
    none, idle = scene(), scene()
    idle["substructure"]["a"]["body_force"] = [0.0, 0.0, 1e-20]
    count = [
        [len(m.loads) for p in build(latin_fmu.scene_from_dict(t)).assembly.propagators for m in p.members]
        for t in (none, idle)
    ]
    assert sorted(count[0]) == [0, 1]
    assert sum(count[1]) == 2
    same(solve(none), solve(idle), 1e-6)


def test_a_rigid_body_assembles_no_stiffness(calls: Counter[str]) -> None:
    tables = scene()
    for part in tables["substructure"].values():
        part["rigid"] = True
    build(latin_fmu.scene_from_dict(tables))
    assert calls["stiffness"] == 0
    build(latin_fmu.scene_from_dict(scene()))
    assert calls["stiffness"] == 1  # one for both: same shape and material


# -- output -------------------------------------------------------------------------------------------------------
def test_what_is_not_asked_for_is_neither_computed_nor_kept(calls: Counter[str], images: list[Any]) -> None:
    bare, full = scene(), scene()
    bare["output"] = {}
    full["output"] = {"fields": True, "stress": True, "energy": True}
    without = solve(bare)
    assert calls["stress"] == 0
    assert images[0].classes["accounted"].all()  # the iteration stops by the work of its error, too
    tree = without.to_datatree()
    assert "substructures" not in tree
    assert "energy" not in tree
    assert without.energy is None
    complete = solve(full)
    assert images[1].classes["accounted"].all()
    assert len(np.unique(complete.energy["work_of_loads"][:20])) == 20  # brought up to date at every instant
    assert calls["stress"] == 2 * 61
    np.testing.assert_array_equal(without.interfaces["meet"].traction, complete.interfaces["meet"].traction)
