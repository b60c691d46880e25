"""Contact with friction, Eqs. (18)-(23): closed forms, statuses, and the law against a statement in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from latin_fmu.interface import Contact
from latin_fmu.interface.laws import SEPARATION, SLIP, STICK

from . import plain_laws

Array = NDArray[np.float64]

# Numbers at which branches meet, with ordinary ones.
JUMP = st.one_of(st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-300, -1e-300, 1e12, -1e12]), st.floats(-3.0, 3.0))
COMPLIANCE = st.one_of(st.sampled_from([0.0, 1e-12, 1.0, 1e12]), st.floats(1e-3, 1e3))
REACH = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(0.0, 3.0))
FRICTION = st.one_of(st.sampled_from([0.0, 1e-12, 1e6, 1e12]), st.floats(0.0, 2.0))


def local(jump: Array, z: Array, normalised_gap: Array, friction: Array) -> Array:
    return Contact.local(jump, z, normalised_gap, 1.0, friction[:, None])


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(st.lists(st.tuples(JUMP, JUMP, JUMP, COMPLIANCE, COMPLIANCE, REACH, FRICTION), min_size=1, max_size=8))
def test_law_is_that_of_numpy(rows: list[tuple[float, ...]]) -> None:
    table = np.array(rows)
    jump, z = np.ascontiguousarray(table[:, :3]), np.ascontiguousarray(table[:, 3:5])
    normalised_gap, parameters = table[:, 5].copy(), np.ascontiguousarray(table[:, 6:])
    for n_component in (1, 3):
        part = np.ascontiguousarray(jump[:, :n_component])
        kernel = Contact.local(part, z, normalised_gap, 1.0, parameters)
        expected = plain_laws.contact(part, z, normalised_gap, 1.0, parameters)
        assert np.isfinite(kernel).all()
        np.testing.assert_allclose(kernel, expected, rtol=1e-13, atol=1e-298)  # products of 1e-300 and 1e-12 underflow


def test_formulas_with_tractions(points: Any) -> None:
    """Section 'Contact with friction': outgoing tractions p, kappa = k k'/(k + k'), pressure and stick traction."""
    p, mu = points(3), 0.3
    outgoing = p.f - p.k * p.w
    kappa = p.k[0] * p.k[1] / p.k.sum(axis=0)
    opening = outgoing[0, :, 0] / p.k[0, :, 0] - outgoing[1, :, 0] / p.k[1, :, 0]
    pressure = kappa[:, 0] * np.maximum(0.0, -(opening + p.normalised_gap))
    stick = kappa[:, 1:] * (outgoing[0] / p.k[0] - outgoing[1] / p.k[1])[:, 1:]
    size = np.linalg.norm(stick, axis=1)
    sliding = size > mu * pressure
    shear = np.where(sliding[:, None], mu * (pressure / size)[:, None] * stick, stick)
    f_hat = local(p.jump, p.z, p.normalised_gap, np.full(len(p.normalised_gap), mu))
    np.testing.assert_allclose(f_hat, np.column_stack([-pressure, shear]), rtol=0, atol=1e-12)
    assert 0.2 < sliding[pressure > 0].mean() < 0.98  # both branches are exercised


def test_equal_k_and_closed_gap_give_the_contact_indicators(points: Any) -> None:
    """(20), (21): P = -k C_n, C_n = [(W' - W)/2 - (F' - F)/(2k)].N, and the tangential indicator G_n."""
    p = points(3)
    k = 2.5
    f_hat = local(
        (p.w[1] - p.f[1] / k) - (p.w[0] - p.f[0] / k),
        np.full((len(p.normalised_gap), 2), 2 / k),
        np.zeros(len(p.normalised_gap)),
        np.full(len(p.normalised_gap), 1e9),
    )
    indicator = (p.w[1] - p.w[0]) / 2 - (p.f[1] - p.f[0]) / (2 * k)
    closed = indicator[:, 0] < 0
    np.testing.assert_allclose(-f_hat[closed, 0], -k * indicator[closed, 0], rtol=1e-13)
    np.testing.assert_allclose(f_hat[closed, 1:], k * indicator[closed, 1:], rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(f_hat[~closed], 0.0)
    assert closed.any()
    assert not closed.all()


def test_rigid_ground_is_the_limit_of_a_stiff_side(points: Any) -> None:
    """k' to infinity: kappa = k_E and W_E' = the motion of the ground."""
    stiff, mu = points(3), 0.3
    stiff.k[1] = 1e14
    friction = np.full(len(stiff.normalised_gap), mu)
    limit = local(stiff.jump, stiff.z, stiff.normalised_gap, friction)
    ground = local(
        stiff.w[1] - stiff.free[0], np.ascontiguousarray(1 / stiff.k[0][:, :2]), stiff.normalised_gap, friction
    )
    np.testing.assert_allclose(limit, ground, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    ("jump", "normalised_gap", "mu", "expected"),
    [
        ((0.5, 1.0, 0.0), 0.0, 0.3, SEPARATION),  # opening
        ((-0.5, 1.0, 0.0), 0.6, 0.3, SEPARATION),  # closing, too far away
        ((-0.5, 1.0, 0.0), 0.5, 0.3, SEPARATION),  # arrives exactly, without pressure
        ((0.0, 1.0, 0.0), 0.0, 0.3, SEPARATION),  # touches without pressure
        ((-1.0, 0.0, 0.0), 0.0, 0.3, STICK),
        ((-1.0, 0.2, 0.2), 0.0, 0.3, STICK),
        ((-1.0, 0.25, 0.25), 0.0, 0.3, SLIP),
        ((-1.0, 5.0, -5.0), 0.0, 0.3, SLIP),
        ((-1.0, 5.0, -5.0), 0.0, 1e6, STICK),
    ],
)
def test_status_with_friction(
    jump: tuple[float, float, float], normalised_gap: float, mu: float, expected: int
) -> None:
    f_hat = local(np.array([jump]), np.full((1, 2), 0.5), np.array([normalised_gap]), np.array([mu]))
    assert Contact.status(f_hat, np.array([[mu]]))[0] == expected


def test_every_sliding_point_is_told_so(points: Any) -> None:
    """No rounding of the projection on the cone turns slip into stick."""
    p = points(3)
    for mu in (1e-6, 0.05, 0.3, 1.0):
        friction = np.full(len(p.normalised_gap), mu)
        f_hat = local(p.jump, p.z, p.normalised_gap, friction)
        slide = np.linalg.norm(p.jump[:, 1:] - p.z[:, 1:] * f_hat[:, 1:], axis=1)
        status = Contact.status(f_hat, friction[:, None])
        pressed = f_hat[:, 0] < 0
        np.testing.assert_array_equal(status == SEPARATION, ~pressed)
        np.testing.assert_array_equal(status[pressed] == SLIP, slide[pressed] > 1e-9)


def test_frictionless_contact_has_normal_unknowns_only_and_slips() -> None:
    contact = Contact()
    assert contact.n_component == 1
    assert Contact(0.1).n_component == 3
    f_hat = np.array([[-1.0], [0.0], [-0.0]])
    np.testing.assert_array_equal(contact.status(f_hat, contact.point_parameters(3)), [SLIP, SEPARATION, SEPARATION])


def test_zero_friction_equals_the_normal_unknown_alone(points: Any) -> None:
    p = points(3)
    zero = np.zeros(len(p.normalised_gap))
    full = local(p.jump, p.z, p.normalised_gap, zero)
    alone = local(np.ascontiguousarray(p.jump[:, :1]), p.z, p.normalised_gap, zero)
    np.testing.assert_array_equal(full[:, :1], alone)
    np.testing.assert_array_equal(full[:, 1:], 0.0)
