"""Remarks on finished runs: slip beyond an element, rotations beyond two degrees; resultants of bodies in statics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.checks.run_checks import balance_remarks
from latin_fmu.latin.outcome import Resultants
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import ramp, solve

from .static_scenes import add_block, scene

SIZE = (0.04, 0.04, 0.02)


def remarks(tables: dict[str, Any], word: str) -> list[str]:
    solution = solve(tables)
    found = [w for w in solution.warnings if word in w]
    assert all(w in solution.summary(details=True) for w in found)
    return found


# -- fixed pairs, small rotations -----------------------------------------------------------------------------------
def sliding(distance: float, friction: float = 0.0) -> dict[str, Any]:
    """A block pressed on the ground that slides along it by a distance, over elements of 5 mm."""
    made = column(
        {"block": Box(STEEL, (0.02, 0.02, 0.02), (4, 4, 4))},
        {},
        {"end": 1e-4, "instants": 50},
        load={"press": {"face": "block.zmax", "pressure": 1e6}},
    )
    made["interface"] = {"floor": {"sides": ["block.zmin", "ground"], "gap": 0.0, "friction_coefficient": friction}}
    made["substructure"]["block"]["initial_velocity"] = [distance / 1e-4, 0.0, 0.0]
    return made


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_a_slip_beyond_an_element_is_told(friction: float) -> None:
    (warning,) = remarks(sliding(0.0065, friction), "slip by")
    assert "interface floor" in warning
    assert "element size of 0.005 m" in warning
    assert not remarks(sliding(0.0045, friction), "slip by")


def test_a_slip_without_contact_is_none() -> None:
    made = sliding(0.02)
    made["interface"]["floor"]["gap"] = 1.0
    assert not remarks(made, "slip by")


@pytest.mark.parametrize(("degrees", "warned"), [(1.8, False), (2.2, True)])
def test_a_rotation_beyond_two_degrees_is_warned_of(degrees: float, warned: bool) -> None:
    made = column({"block": Box(STEEL, (0.02, 0.03, 0.04), (2, 3, 4))}, {}, {"end": 1e-4, "instants": 50})
    made["substructure"]["block"]["initial_spin"] = (np.radians(degrees) / 1e-4 * np.array([0.6, 0.0, 0.8])).tolist()
    found = remarks(made, "has rotated by")
    assert bool(found) is warned
    if warned:
        assert f"block has rotated by {degrees:.3g} degrees" in found[0]


# -- resultants -----------------------------------------------------------------------------------------------------
def pressed() -> dict[str, Any]:
    """A block on a base, pressed and sheared at its top, out of the middle."""
    made = scene(4)
    add_block(made, "base", (0.0, 0.0, -0.01), (0.04, 0.04, 0.01), (4, 4, 1))
    add_block(made, "upper", (0.0, 0.0, 0.0), SIZE, (4, 4, 2))
    made["interface"]["face"] = {"sides": ["base.zmax", "upper.zmin"], "friction_coefficient": 0.5}
    made["boundary"]["base"] = {"type": "fixed", "face": "base.zmin"}
    made["load"]["press"] = {"face": "upper.zmax", "pressure": 50e6, "law": ramp((0, 0), (1, 1))}
    made["load"]["shear"] = {"face": "upper.xmax", "traction": [0.0, 5e6, 0.0], "law": ramp((0, 0), (1, 1))}
    return made


def test_resultants_of_every_body() -> None:
    """Loads by hand; interface forces and reactions hold them: forces and moments, in the results file too."""
    solution = solve(pressed())
    made = solution.outcome.resultants
    force = np.array([0.0, 5e6 * 0.04 * 0.02, -50e6 * 0.04**2])
    moment = np.cross([0.02, 0.0, 0.0], [0.0, force[1], 0.0])  # about the centre
    np.testing.assert_allclose(made["upper"].loads, [*force, *moment], atol=1e-9 * abs(force[2]))
    largest = abs(force[2])
    np.testing.assert_allclose(made["upper"].interfaces, -made["upper"].loads, atol=1e-4 * largest)
    below = np.cross([0.02, 0.02, 0.01] - np.array([0.02, 0.02, -0.005]), force)  # the upper block on the base
    np.testing.assert_allclose(made["base"].reactions[:3], -force, atol=1e-4 * largest)
    np.testing.assert_allclose(made["base"].reactions[3:], -moment - below, atol=1e-4 * largest * 0.04)
    for body in made.values():
        assert np.abs(body.unbalanced).max() <= 1e-4 * largest
        total = body.parts.sum(axis=0) + body.unbalanced
        assert np.abs(total).max() <= 1e-9 * largest  # of all nodes, K u has no resultant
    assert "forces on every body in balance to" in solution.status
    assert "forces on every body closed to" in solution.summary(details=True)
    tree = solution.to_datatree()
    kept = tree["resultants"].to_dataset()
    np.testing.assert_array_equal(kept["reaction_force"].sel(substructure="base"), made["base"].reactions[:3])
    assert solution.report()["resultants"]["base"]["reactions"] == made["base"].reactions.tolist()


def test_a_body_out_of_balance_is_told() -> None:
    """The balance falls with the tolerance; ten tolerances beyond it are a warning."""
    coarse, fine = (pressed() | {"solver": {"tolerance": t}} for t in (1e-2, 1e-7))
    off = [max(np.linalg.norm(r.unbalanced[:3]) for r in solve(s).outcome.resultants.values()) for s in (coarse, fine)]
    assert off[1] < 1e-3 * off[0]
    zero, force = np.zeros(6), np.array([100.0, 0, 0, 0, 0, 0])
    (warning,) = balance_remarks({"a": Resultants(force, zero, zero, force)}, 1e-5)
    assert "substructure a: its forces are out of balance by 1e+02 %" in warning
    assert not balance_remarks({"a": Resultants(force, -force, zero, 1e-6 * force)}, 1e-5)


def test_motions_have_no_resultants() -> None:
    assert not solve(sliding(1e-3)).outcome.resultants


UP_AND_DOWN = {"type": "table", "times": [0.0, 0.25, 0.75, 1.0], "values": [0.0, 1.0, -1.0, 0.0]}


def test_a_cycle_that_ends_unloaded_is_in_balance() -> None:
    """Shares are those of the largest force of the cycle; preloads count, whose resultant on a wedged block is 0."""
    tables = {
        "name": "wedged",
        "material": {"m": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {"block": {"material": "m", "box": {"size": [0.01] * 3, "elements": [2, 2, 2]}}},
        "interface": {
            side: {"sides": [f"block.{side}", "ground"], "friction_coefficient": 1.0, "preload": 5e6}
            for side in ("xmin", "xmax")
        },
        "load": {"push": {"face": "block.zmax", "traction": [0.0, 0.0, 1e6], "law": UP_AND_DOWN}},
        "time": {"end": 1.0, "instants": 20, "quasi_static": True},
        "solver": {"tolerance": 1e-9, "force_tolerance": 1e-9},
    }
    solution = solve(tables)
    assert not [w for w in solution.warnings if "out of balance" in w]
    made = solution.outcome.resultants["block"]
    assert made.largest == pytest.approx(500.0, rel=0.05)
    assert np.linalg.norm(made.unbalanced[:3]) < 1e-8 * made.largest


def test_a_press_that_ends_unloaded_is_in_balance() -> None:
    tables = pressed()
    for load in tables["load"].values():
        load["law"] = {"type": "half_sine", "duration": tables["time"]["end"]}
    solution = solve(tables)
    assert not [w for w in solution.warnings if "out of balance" in w]
    share = float(solution.status.split("in balance to ")[1].split(" ")[0])
    assert share < 1e-4
