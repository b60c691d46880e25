"""no_slip under pressure is a perfect bond in motion too, whatever gaps of the size of a rounding error there are."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine


def pressed(behaviour: str, scheme: str) -> dict[str, Any]:
    """Two blocks under a dead pressure, in equilibrium; then a shear shock that the pressure outlasts."""
    block = Box(STEEL, (0.02, 0.02, 0.01), (3, 3, 2))
    return column(
        {"lower": block, "upper": block},
        {"meet": {"behaviour": behaviour}},
        {"end": 1.5e-5, "instants": 75, "start": "static", "scheme": scheme},
        boundary={"base": {"type": "fixed", "face": "lower.zmin"}},
        load={
            "press": {"face": "upper.zmax", "pressure": 100e6},
            "shock": {"face": "upper.zmax", "traction": [1e7, 4e6, 0.0], "law": half_sine(5e-6)},
        },
        output={"fields": True},
        solver={"tolerance": 1e-8},
    )


@pytest.mark.parametrize("scheme", ["hht", "newmark"])
def test_no_slip_under_pressure_is_a_bond(scheme: str) -> None:
    bonded, held = (
        latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(pressed(behaviour, scheme))))
        for behaviour in ("perfect", "no_slip")
    )
    assert held.converged, held.status
    history = held.interfaces["meet"]
    assert history.traction[..., 2].max() < -2e7  # pressed everywhere and always
    shaken = bonded.substructures["upper"].velocity
    difference = held.substructures["upper"].velocity - shaken
    assert np.abs(difference).max() < 1e-5 * np.abs(shaken).max()


def apart(gap: float, pressure: float, scheme: str = "hht") -> dict[str, Any]:
    """A block that moves sideways over a gap that never closes; the lower one is squeezed on its sides."""
    block = Box(STEEL, (0.1, 0.1, 0.1), (2, 2, 3))
    return column(
        {"lower": block, "upper": Box(STEEL, (0.1, 0.1, 0.1), (2, 2, 3), velocity=(1.0, 0.0, 0.0))},
        {"meet": {"behaviour": "no_slip"}},
        {"end": 4e-4, "instants": 40, "scheme": scheme},
        gap=gap,
        boundary={"base": {"type": "fixed", "face": "lower.zmin"}},
        load={
            name: {"face": f"lower.{name}", "traction": [0.0, side * pressure, 0.0], "law": half_sine(4e-4)}
            for name, side in (("ymax", 1.0), ("ymin", -1.0))
        },
        sensor={"top": {"face": "upper.zmax"}},
    )


@pytest.mark.parametrize("scheme", ["hht", "newmark", "generalized_alpha"])
def test_no_load_elsewhere_closes_a_gap(scheme: str) -> None:
    """A traction counts as one of this interface alone: the block goes on as it was thrown. Stretched along y the lower
    block gets thinner, so that the gap opens."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(apart(1e-5, 3e8, scheme)))
    assert solution.converged, solution.status
    assert not solution.interfaces["meet"].traction.any()
    assert solution.sensors["top"].velocity[:, 0] == pytest.approx(np.ones(41), abs=1e-9)


@pytest.mark.parametrize("behaviour", ["no_slip", "contact", "soft_contact"])
@pytest.mark.parametrize("seed", range(4))
def test_points_that_are_open_at_both_ends_of_a_step_carry_nothing(behaviour: str, seed: int) -> None:
    """A block that bounces and tumbles: what a point carries, it carries closed, or in the step in which it lands."""
    rng = np.random.default_rng(seed)
    law: dict[str, Any] = {"behaviour": behaviour}
    if behaviour != "no_slip":
        law["friction_coefficient"] = 0.4
    if behaviour == "soft_contact":
        law["normal_stiffness"] = 1e15
    block = Box(STEEL, (0.02, 0.02, 0.01), (3, 3, 2))
    thrown = Box(STEEL, (0.02, 0.02, 0.01), (2, 3, 2), velocity=(*rng.normal(size=2).tolist(), -2.0))
    scene = column(
        {"lower": block, "upper": thrown},
        {"meet": law},
        {"end": 3e-5, "instants": 100},
        gap=1e-6,
        boundary={"base": {"type": "fixed", "face": "lower.zmin"}},
        load={"hit": {"face": "upper.xmax", "traction": (5e7 * rng.normal(size=3)).tolist(), "law": half_sine(8e-6)}},
    )
    history = latin_fmu.solve(latin_fmu.scene_from_dict(scene)).interfaces["meet"]
    assert history.gap is not None
    size = np.linalg.norm(history.traction, axis=2)
    # a gap that is none, beside the displacements of micrometres
    is_open = history.gap > 1e-15
    landing = is_open[:-1] & (history.traction[1:] * history.normals).sum(axis=2).astype(bool)
    both = is_open[:-1] & is_open[1:] & ~landing
    assert size.max() > 1e6
    assert both.mean() > 0.05
    assert landing.mean() < 0.25
    assert size[1:][both].max() <= 1e-12 * size.max()
