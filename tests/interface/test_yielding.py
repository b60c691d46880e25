"""Elastic layers, soft contact and viscous joints: limits, parameters, energies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.interface import BEHAVIOURS, Behaviour

LAYER = {"normal_stiffness": 2.0, "tangential_stiffness": 0.7}
SOFT = {"normal_stiffness": 0.5, "friction_coefficient": 0.3}
JOINT = {"normal_viscosity": 2.0, "tangential_viscosity": 0.7}


def solved(behaviour: Behaviour, p: Any, rate: float = 0.8) -> np.ndarray:
    return behaviour.local(p.jump, p.z, p.normalised_gap, rate, behaviour.point_parameters(len(p.normalised_gap)))


@pytest.mark.parametrize(("name", "keys"), [("elastic_layer", list(LAYER)), ("viscous_joint", list(JOINT))])
def test_a_stiff_joint_is_a_perfect_connection(points: Any, name: str, keys: list[str]) -> None:
    stiff = BEHAVIOURS[name](**dict.fromkeys(keys, 1e14))
    p = points(stiff)
    if stiff.elastic:
        p.normalised_gap[:] = 0.0
    perfect = BEHAVIOURS["perfect"]()
    np.testing.assert_allclose(solved(stiff, p), solved(perfect, p), rtol=1e-10)


def test_a_stiff_soft_contact_is_contact(points: Any) -> None:
    stiff = BEHAVIOURS["soft_contact"](**{"normal_stiffness": 1e14, "friction_coefficient": 0.4})
    hard = BEHAVIOURS["contact"](**{"friction_coefficient": 0.4})
    p = points(stiff)
    p.normalised_gap[:, 0] = np.abs(p.normalised_gap[:, 0])  # contact knows no compression at the start
    row = hard.point_parameters(len(p.normalised_gap))
    expected = hard.local(p.jump, p.z, np.ascontiguousarray(p.normalised_gap[:, 0]), 0.8, row)
    np.testing.assert_allclose(solved(stiff, p), expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("elastic_layer", {"normal_stiffness": 2.0, "tangential_stiffness": 0.0}),
        ("soft_contact", {"normal_stiffness": 2.0}),
        ("viscous_joint", {"normal_viscosity": 2.0, "tangential_viscosity": 0.0}),
    ],
)
def test_what_slides_freely_has_no_tangential_unknowns(name: str, parameters: dict[str, float]) -> None:
    assert BEHAVIOURS[name](**parameters).n_component == 1


def test_stored_energy_is_that_of_the_springs() -> None:
    layer = BEHAVIOURS["elastic_layer"](**LAYER)
    u = np.array([[0.1, -0.2, 0.3]])
    k = np.array([2.0, 0.7, 0.7])
    assert layer.stored_energy(k * u, layer.point_parameters(1))[0] == pytest.approx(0.5 * (k * u**2).sum())
    soft = BEHAVIOURS["soft_contact"](**SOFT)
    assert soft.stored_energy(np.array([[-0.5 * 0.2, 9.0, 9.0]]), soft.point_parameters(1))[0] == pytest.approx(
        0.5 * 0.5 * 0.2**2
    )
