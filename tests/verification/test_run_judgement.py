"""The end of a run judges it: closed points that sink, energies that do not add up, bodies that turn; messages agree
with the tests that they report."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import build
from latin_fmu.checks.release import Release, released
from latin_fmu.cli import main
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.latin.status import with_energy
from latin_fmu.scene.schema import toml_text
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import ramp

from .static_scenes import add_block, scene
from .test_clamped_joints import bolt, lap, pulse

Tables = dict[str, Any]


def solve(tables: Tables) -> latin_fmu.Solution:
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables))


def number(pattern: str, text: str) -> float:
    """The number that a pattern with one group finds in a text."""
    found = re.search(pattern, text)
    assert found is not None, text
    return float(found[1])


# -- sinking --------------------------------------------------------------------------------------------------------
def test_a_clamped_joint_that_sinks_is_not_trustworthy() -> None:
    """The shaken lap joint at a tolerance of 0.3: the depth by the gaps in the results, the share by the bolt."""
    solution = solve(lap(290, pulse(), solver={"tolerance": 0.3, "force_tolerance": 3.0}))
    assert solution.converged
    assert not solution.trustworthy
    assert solution.status.startswith("not trustworthy: interface ")
    assert "the shortening of bolt b1 (allowed: 1 %)" in solution.status
    assert "reduce solver.tolerance, for example to 0.03" in solution.status
    told = number(r"interface washer_bolt: .*? by ([\d.e-]+) m", solution.status)
    gap, touching = solution.interfaces["washer_bolt"].gap, solution.interfaces["washer_bolt"].contact_status
    assert gap is not None
    assert touching is not None
    never = (touching > 0).all(axis=0)
    assert told == pytest.approx((gap[0] - gap)[:, never].max(), rel=1e-2)
    share = number(r"interface washer_bolt: .*? m, ([\d.]+) % of the shortening", solution.status)
    assert share == pytest.approx(100.0 * told / solution.bolts["b1"].shortening, rel=0.05)
    whole = f"{int(((gap[0] - gap).max(axis=0) > 0.01 * solution.bolts['b1'].shortening)[never].sum())} of {len(never)}"
    assert f"interface washer_bolt: excessive penetration at {whole} points that never opened" in solution.status


@pytest.mark.slow
def test_the_same_joint_at_the_default_is_trustworthy() -> None:
    solution = solve(lap(290, pulse()))
    assert solution.trustworthy
    assert solution.outcome.sunk() <= 0.01 * solution.bolts["b1"].shortening
    assert np.abs(bolt(solution)[-1] / 4915.8 - 1.0) <= 1e-3


def history(gap: list[list[float]], pressure: list[list[float]]) -> InterfaceHistory:
    """An interface with these gaps and pressures, (instants, points)."""
    table, traction = np.array(gap), np.zeros((len(gap), len(gap[0]), 3))
    traction[..., 2] = -np.array(pressure)
    points, up = np.zeros((len(gap[0]), 3)), np.tile([0.0, 0.0, 1.0], (len(gap[0]), 1))
    status = np.array(pressure, dtype=np.int8)
    velocity = np.zeros((len(gap), 2, len(gap[0]), 3))
    sides = ("a.zmax", "b.zmin")
    given = (points, np.ones(len(points)), up, np.zeros(len(points)), 0.3, traction, velocity, table, status, None)
    return InterfaceHistory("i", "contact", sides, *given)


def test_points_that_stayed_closed_are_told_from_those_that_landed() -> None:
    """Points, in turn: pressed throughout, landed from a gap, opened and closed again, closed under way and sunk
    afterwards, and one that never touches."""
    n, sink = 30, 1e-9 * np.arange(30.0)
    gap, pressure = np.zeros((n, 5)), np.ones((n, 5))
    gap[:, 0] = -sink
    gap[:, 1], pressure[:5, 1] = np.where(np.arange(n) < 5, 1e-6, -4e-8), 0.0
    gap[:, 2], pressure[10, 2] = -2.0 * sink, 0.0
    pressure[:3, 3] = 0.0
    gap[3:, 3] = -1e-8 - sink[: n - 3]
    gap[:, 4], pressure[:, 4] = 1e-6, 0.0
    made = history(gap.tolist(), pressure.tolist())
    np.testing.assert_allclose(made.sunk(), [29e-9, 0.0, 0.0, 16e-9, 0.0], rtol=1e-9, atol=1e-20)
    assert made.penetration() == pytest.approx(58e-9)
    assert made.landed() == pytest.approx(58e-9)  # the point that has opened
    assert history(gap[:, :2].tolist(), pressure[:, :2].tolist()).landed() == pytest.approx(4e-8)


def test_openings_below_the_accuracy_of_velocities_are_none() -> None:
    """Points, in turn: opens twice within the noise, once beyond it, within it at the start and at the end (no
    opening between two contacts), and touches throughout; openings of neighbours in the table do not mix."""
    gap, pressure = np.full((8, 4), -1e-9), np.ones((8, 4))
    gap[[1, 2, 5], 0], pressure[[1, 2, 5], 0] = [2e-9, 1e-9, 2e-9], 0.0
    gap[2:5, 1], pressure[2:5, 1] = [1e-9, 4e-9, 1e-9], 0.0
    gap[[0, 7], 2], pressure[[0, 7], 2] = 1e-9, 0.0
    joint = history(gap.tolist(), pressure.tolist())
    expected = pressure > 0.0
    np.testing.assert_array_equal(joint.closed(), expected)
    np.testing.assert_array_equal(joint.closed(0.5e-9), expected)
    expected[[1, 2, 5], 0] = True
    np.testing.assert_array_equal(joint.closed(3e-9), expected)
    expected[2:5, 1] = True
    np.testing.assert_array_equal(joint.closed(5e-9), expected)
    # sunk counts a point as closed throughout where its openings are noise
    gap[6, 0] = -7e-9
    joint = history(gap.tolist(), pressure.tolist())
    assert joint.sunk()[0] == 0.0
    assert joint.sunk(3e-9)[0] == pytest.approx(6e-9)


# -- rotations ------------------------------------------------------------------------------------------------------
def turning(degrees: float) -> Tables:
    """A free block that turns by an angle."""
    made = column({"block": Box(STEEL, (0.02, 0.03, 0.04), (2, 3, 4))}, {}, {"end": 1e-4, "instants": 50})
    made["substructure"]["block"]["initial_spin"] = (np.radians(degrees) / 1e-4 * np.array([0.6, 0.0, 0.8])).tolist()
    return made


@pytest.mark.parametrize(("degrees", "good"), [(9.8, True), (10.2, False)])
def test_a_rotation_beyond_ten_degrees_is_not_trustworthy(degrees: float, good: bool) -> None:
    solution = solve(turning(degrees))
    assert solution.converged
    assert solution.trustworthy is good
    assert any("has rotated by" in warning for warning in solution.warnings) is good
    if not good:
        assert number(r"block has rotated by ([\d.]+) degrees", solution.status) == pytest.approx(degrees, rel=1e-2)
        assert "allowed: 10 degrees" in solution.status


# -- energies -------------------------------------------------------------------------------------------------------
def absurd(step: float) -> Tables:
    """Four blocks in a pile that slides off its place, in steps far beyond the time of a wave through a block."""
    blocks = {name: Box(STEEL, (0.02, 0.02, 0.02), (3, 3, 3)) for name in "abc"}
    blocks["d"] = Box(STEEL, (0.02, 0.02, 0.02), (3, 3, 3), velocity=(1.0, 2.0, -3.0))
    joints = {name: {"friction_coefficient": 0.3} for name in "ijk"}
    made = column(blocks, joints, {"end": 30 * step, "instants": 30}, output={"energy": True})
    return made | {"gravity": {"acceleration": [1.0, 0.0, -9.81]}}


def test_an_account_that_does_not_close_is_not_trustworthy() -> None:
    """Steps of 1e6 Courant numbers: the sums of the energies in the results, and angles beyond all bounds."""
    solution = solve(absurd(10.0))
    assert solution.converged
    assert not solution.trustworthy
    energy = solution.energy
    assert energy is not None
    told = number(r"energy: the balance of the bodies has a residual of ([-\d.e+]+) J", solution.status)
    assert told == pytest.approx(energy["balance"][-1], rel=1e-2)
    size = max(abs(float(energy[key][-1])) for key in ("kinetic", "elastic", "work_of_loads", "interface_work"))
    assert number(r"([\d.]+) % of its largest term", solution.status) == pytest.approx(100 * abs(told) / size, rel=0.05)
    assert number(r"has rotated by ([\d.e+]+) degrees", solution.status) > 1e6
    without = absurd(10.0) | {"output": {}}
    assert "the balance of the bodies has a residual of" in solve(without).status  # kept or not


def test_an_account_that_closes_is_not_told() -> None:
    solution = solve(absurd(1e-5))
    assert solution.trustworthy
    assert "energy" not in solution.status


def test_the_message_on_gained_energy_has_the_numbers_of_its_test() -> None:
    """The sum of the dissipations against half of the energy put in, computed here from the same terms."""
    time, zero = np.array([0.0, 1.0, 2.0]), np.zeros(3)
    energy = dict.fromkeys(("elastic", "work_of_loads", "interface_work", "damping_dissipation"), zero)
    energy |= dict.fromkeys(("prestress", "landing_dissipation", "friction_dissipation", "contact_dissipation"), zero)
    energy |= {"kinetic": np.array([2.0, 2.9, 3.2]), "scheme_dissipation": np.array([0.0, -0.9, -1.2])}
    converged, sentence = with_energy(True, "converged", time, energy)
    assert not converged
    assert "until t = 2 s" in sentence
    assert number(
        r"together have added ([\d.]+) times the energy put in \(allowed: 0.5 times", sentence
    ) == pytest.approx(0.6)
    energy["scheme_dissipation"] = np.array([0.0, -0.9, -0.99])
    assert with_energy(True, "converged", time, energy) == (True, "converged")


# -- forces in statics ----------------------------------------------------------------------------------------------
def pushed(stop: bool) -> Tables:
    """Two blocks, the lower one displaced by its face; with a fixed face on the other side or nothing."""
    made = scene(4)
    add_block(made, "low", (0.0, 0.0, 0.0), (0.04, 0.04, 0.02), (3, 3, 2))
    add_block(made, "up", (0.0, 0.0, 0.02), (0.04, 0.04, 0.02), (3, 3, 2))
    made["interface"]["face"] = {"sides": ["low.zmax", "up.zmin"], "behaviour": "perfect"}
    moved = {"type": "displacement", "face": "low.zmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 1e-5]}
    made["boundary"]["push"] = moved | {"law": ramp((0, 0), (1, 1))}
    if stop:
        made["boundary"]["stop"] = {"type": "fixed", "face": "up.zmax"}
    return made


def test_forces_of_round_off_are_not_out_of_balance() -> None:
    solution = solve(pushed(False))
    assert solution.trustworthy
    assert "forces on all bodies within round-off" in solution.status
    assert not [warning for warning in solution.warnings if "out of balance" in warning]
    assert max(r.largest for r in solution.outcome.resultants.values()) < 1e-3  # N, where the stop takes 1e5
    held = solve(pushed(True))
    assert "forces on every body in balance to" in held.status
    assert max(r.largest for r in held.outcome.resultants.values()) > 1e4


# -- exit codes -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("tables", "strict", "code"),
    [(lambda: turning(10.2), [], 1), (lambda: turning(5.0), [], 0), (lambda: turning(5.0), ["--strict"], 6)],
)
def test_exit_codes(tables: Callable[[], Tables], strict: list[str], code: int, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(toml_text(tables()))
    target = tmp_path / "out.nc"
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(target), "--quiet", "--no-estimate", *strict]) == code
    tree = latin_fmu.open_results(target)
    assert (tree.attrs["converged"], tree.attrs["trustworthy"]) == (1, int(code != 1))
    tree.close()


# -- joints that a load presses -------------------------------------------------------------------------------------
TO_AND_FRO = {
    "type": "table",
    "times": [0.0, 0.01, 0.02, 0.03, 0.05, 0.06, 0.07, 0.08, 0.1],
    "values": [0.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 0.0],
}
WEIGHT = 7800.0 * 0.04 * 0.04 * 0.01 * 9.81


def shaken_plate(tolerance: float, **more: Any) -> Tables:
    """A plate that lies on a table by its weight alone and slips to and fro on it."""
    steel = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    ground = {"direction": [1.0, 0.0, 0.0], "amplitude": 0.1, "law": TO_AND_FRO}
    table = {"sides": ["plate.zmin", "ground"], "friction_coefficient": 0.2, "ground_velocity": ground}
    box = {"size": [0.04, 0.04, 0.01], "elements": [2, 2, 1]}
    return {
        "name": "shaken_plate",
        "material": {"steel": steel},
        "substructure": {"plate": {"material": "steel", "box": box}},
        "interface": {"table": table},
        "gravity": {"acceleration": [0.0, 0.0, -9.81]},
        "time": {"end": 0.12, "step": 1e-4, "start": {"type": "static"}},
        "solver": {"tolerance": tolerance},
    } | more


def test_a_plate_that_its_weight_presses_is_trustworthy() -> None:
    """Points have sunk by more than the elastic approach, which takes no force from a weight; the force is right."""
    # at 1e-4 the last bits of a BLAS decide whether all points open for an instant
    solution = solve(shaken_plate(1e-5))
    history = solution.interfaces["table"]
    approach = 0.01 * 0.765e3 / 210e9
    assert history.sunk().max() > 0.01 * approach
    np.testing.assert_allclose(history.normal_resultant(), WEIGHT, rtol=1e-3)
    assert solution.trustworthy
    assert not [w for w in solution.warnings if w.code == "sinking"]


def test_a_plate_whose_force_strays_is_told() -> None:
    """By four parts in a hundred at single instants, by one in the mean over two steps (the mass times the second
    difference of the gap)."""
    solution = solve(shaken_plate(6e-4))
    history = solution.interfaces["table"]
    stray = np.abs(history.normal_resultant() / WEIGHT - 1.0)
    assert 0.01 < stray.max() < 0.1
    (warning,) = [w for w in solution.warnings if w.code == "sinking"]
    assert solution.trustworthy
    assert "interface table: its sides, pressed together by loads alone" in warning
    assert "reduce solver.tolerance, for example to 6e-05" in warning
    assert history.gap is not None
    told = number(r"force between them by ([\d.]+) %", warning)
    moved = np.diff(history.gap @ history.areas, n=2, axis=0) / history.areas.sum() / 1e-4**2
    assert told == pytest.approx(100.0 * np.abs(moved).max() / 9.81, rel=0.5)


def pressed_joint(tables: Tables, joint: str) -> Release | None:
    """The joint of a scene as one that loads press, all points of all joints touching."""
    problem = build(latin_fmu.scene_from_dict(tables))
    models = [m for p in problem.assembly.propagators for m in p.members]
    nodes = {name: info.nodes for name, info in problem.info.items()}
    return released(models, nodes, problem.assembly.interfaces, {}, joint)


def standing(joints: Tables, **more: Any) -> Tables:
    """A plate on a table that also touches what ``joints`` has."""
    made = shaken_plate(1e-3, **more)
    made["interface"]["table"] = {"sides": ["plate.zmin", "ground"]}
    del made["time"]["start"]
    made["interface"] |= joints
    return made


@pytest.mark.parametrize("rigid", [False, True])
def test_the_mass_that_an_approach_moves(rigid: bool) -> None:
    made = standing({})
    made["substructure"]["plate"] |= {"rigid": rigid}
    free = pressed_joint(made, "table")
    assert free is not None
    assert free.mass == pytest.approx(WEIGHT / 9.81)
    assert free.stiffness == 0.0


def test_a_wall_without_friction_holds_nothing_and_one_with_friction_does() -> None:
    for friction, clamped in ((0.0, False), (0.3, True)):
        wall = {"sides": ["plate.xmin", "ground"], "friction_coefficient": friction}
        assert (pressed_joint(standing({"wall": wall}), "table") is None) is clamped


def test_a_ceiling_clamps_and_a_spring_has_its_stiffness() -> None:
    assert pressed_joint(standing({"ceiling": {"sides": ["plate.zmax", "ground"]}}), "table") is None
    assert (
        pressed_joint(standing({"glue": {"sides": ["plate.xmin", "ground"], "behaviour": "perfect"}}), "table") is None
    )
    spring = {"ends": ["plate.zmax", "ground"], "direction": [0.0, 0.0, 1.0], "stiffness": 3e4}
    free = pressed_joint(standing({}, spring={"s": spring}), "table")
    assert free is not None
    assert free.stiffness == pytest.approx(3e4)
    assert free.mass == pytest.approx(WEIGHT / 9.81)


def test_a_plate_on_two_wide_legs_is_held_by_their_elasticity() -> None:
    """It lies flat on each of them: where one sinks, the force within the other moves."""
    made = standing({})
    leg = {"material": "steel", "box": {"origin": [0.0, 0.0, -0.01], "size": [0.01, 0.04, 0.01], "elements": [1, 2, 1]}}
    made["substructure"]["leg"] = leg
    made["boundary"] = {"leg": {"type": "fixed", "face": "leg.zmin"}}
    made["substructure"]["plate"]["box"]["elements"] = [4, 2, 1]
    made["interface"]["table"]["sides"] = ["plate.zmin", "leg.zmax"]
    assert pressed_joint(made, "table") is not None
    made["substructure"]["other"] = {**leg, "box": {**leg["box"], "origin": [0.03, 0.0, -0.01]}}
    made["boundary"]["other"] = {"type": "fixed", "face": "other.zmin"}
    made["interface"]["more"] = {"sides": ["plate.zmin", "other.zmax"]}
    assert pressed_joint(made, "table") is None
