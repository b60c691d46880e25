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
    assert "lower solver.tolerance, as to 0.03" in solution.status
    told = number(r"interface washer_bolt: .*? by ([\d.e-]+) m", solution.status)
    gap, touching = solution.interfaces["washer_bolt"].gap, solution.interfaces["washer_bolt"].contact_status
    assert gap is not None
    assert touching is not None
    never = (touching > 0).all(axis=0)
    assert told == pytest.approx((gap[0] - gap)[:, never].max(), rel=1e-2)
    share = number(r"interface washer_bolt: .*? m, ([\d.]+) % of the shortening", solution.status)
    assert share == pytest.approx(100.0 * told / solution.bolts["b1"].shortening, rel=0.05)
    whole = f"{int(((gap[0] - gap).max(axis=0) > 0.01 * solution.bolts['b1'].shortening)[never].sum())} of {len(never)}"
    assert f"interface washer_bolt: {whole} points that never opened" in solution.status


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
    assert any("has turned by" in warning for warning in solution.warnings) is good
    if not good:
        assert number(r"block has turned by ([\d.]+) degrees", solution.status) == pytest.approx(degrees, rel=1e-2)
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
    told = number(r"energy: the account of the bodies is open by ([-\d.e+]+) J", solution.status)
    assert told == pytest.approx(energy["balance"][-1], rel=1e-2)
    size = max(abs(float(energy[key][-1])) for key in ("kinetic", "elastic", "work_of_loads", "interface_work"))
    assert number(r"([\d.]+) % of its largest term", solution.status) == pytest.approx(100 * abs(told) / size, rel=0.05)
    assert number(r"has turned by ([\d.e+]+) degrees", solution.status) > 1e6
    without = absurd(10.0) | {"output": {}}
    assert "the account of the bodies is open by" in solve(without).status  # kept or not


def test_an_account_that_closes_is_not_told() -> None:
    solution = solve(absurd(1e-5))
    assert solution.trustworthy
    assert "energy" not in solution.status


def test_the_message_on_gained_energy_has_the_numbers_of_its_test() -> None:
    """The sum of the dissipations against half of the energy put in, computed here from the same terms."""
    time, zero = np.array([0.0, 1.0, 2.0]), np.zeros(3)
    energy = dict.fromkeys(("elastic", "work_of_loads", "interface_work", "damping_dissipation"), zero)
    energy |= dict.fromkeys(("landing_dissipation", "friction_dissipation", "contact_dissipation"), zero)
    energy |= {"kinetic": np.array([2.0, 2.9, 3.2]), "scheme_dissipation": np.array([0.0, -0.9, -1.2])}
    converged, sentence = with_energy(True, "converged", time, energy)
    assert not converged
    assert "by t = 2 s" in sentence
    assert number(r"together added ([\d.]+) times the energy put in \(allowed: 0.5 times", sentence) == pytest.approx(
        0.6
    )
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
    assert "no force on any body beyond round-off" in solution.status
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
