"""The right-hand side: identities of energy and momentum, laws of contact and friction, events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latin_fmu.model_exchange.equations import (
    GAP_MARGIN,
    N_WORK,
    WORKS,
    Amplitudes,
    ContactLaw,
    ContactModes,
    ContactMotion,
    Equations,
    Regularisation,
)
from latin_fmu.model_exchange.reduce import reduced_system
from tests.cosim.scenes import bar

from .scenes import pair, random_state, rods

MOVING = {
    "floor": {
        "sides": ["bar.zmin", "ground"],
        "friction_coefficient": 0.4,
        "ground_velocity": {"direction": [1.0, 0.0, 2.0], "amplitude": np.sqrt(5.0)},
    }
}


@pytest.fixture(scope="module")
def equations():
    return Equations(reduced_system(pair(), 4, 4), energy=True)


@pytest.mark.parametrize("seed", range(4))
def test_power_balance(equations, seed):
    """What the load and the interfaces do is stored; what the interfaces do is taken from their springs or lost."""
    s = equations.system
    y, modes = random_state(equations, seed)
    now = equations.evaluate(2e-6, y, modes, {})
    x, v, a = y[: s.n], y[s.n : 2 * s.n], now.derivative[s.n : 2 * s.n]
    loads, interface, friction, contact, damping = now.derivative[-N_WORK:]
    stored = s.inertia * v @ a + s.stiffness * x @ v
    scale = abs(s.inertia * v) @ abs(a)
    assert stored == pytest.approx(loads + interface - damping, abs=1e-12 * scale)
    springs = -np.sum(s.contacts.area * now.traction.elastic * now.motion.rate)
    assert modes.closed.any()
    assert interface == pytest.approx(-springs - friction - contact, abs=1e-12 * scale)
    assert friction >= 0.0
    assert contact >= 0.0


@pytest.mark.parametrize("seed", range(4))
def test_damping_of_contact_takes_all_where_it_takes_the_pressure_off(equations, seed):
    """Power of the interfaces with so much damping that patches that leave have no pressure: P g' = p g' - loss."""
    strong = Equations(equations.system, energy=True)
    strong.use(replace(Regularisation.of(equations.system), damping=1e3))
    y, modes = random_state(strong, seed)
    now = strong.evaluate(2e-6, y, modes, {})
    area, traction, rate = strong.system.contacts.area, now.traction, now.motion.rate
    assert (traction.pressure == 0.0).any()
    taken = np.sum(area * (traction.elastic - traction.pressure) * rate)
    assert now.derivative[-N_WORK:][WORKS.index("contact_dissipation")] == pytest.approx(taken, rel=1e-12)


def test_force_is_mass_times_acceleration_of_a_thrown_bar():
    s = reduced_system(bar(), 5)
    equations = Equations(s, energy=False)
    y, modes = random_state(equations, 1)
    y[0] = -10.0  # far below the ground
    modes = equations.modes_at(0.0, y)
    now = equations.evaluate(0.0, y, modes, {})
    force = now.derivative[2 * s.n + 2]
    centre = s.sides[0, 0][2, 0] * now.derivative[s.n]  # the only rigid motion: translation
    assert modes.closed.all()
    assert force > 0.0
    assert force == pytest.approx(s.inertia[0] * centre, rel=1e-10)


def test_coulomb(equations):
    law = equations.law
    mu, bound = equations.system.contacts.friction, law.regularisation.sliding
    n = len(mu)
    for speed, stick in ((0.3, True), (5.0, False)):
        sliding = np.zeros((2, n))
        sliding[0] = speed * bound
        motion = ContactMotion(np.full(n, -1e-7), np.zeros(n), sliding)
        traction = law.traction(motion, law.called_for(motion, 0))
        np.testing.assert_allclose(traction.shear[0], mu * traction.pressure * (speed if stick else 1.0))
        np.testing.assert_array_equal(traction.shear[1], 0.0)
        np.testing.assert_allclose(traction.pressure, law.stiffness * 1e-7)


@pytest.mark.parametrize("seed", range(20))
def test_an_event_does_not_call_for_the_next_one(equations, seed):
    """From any discrete state: two switches at most (contact, then stick), then every indicator is positive."""
    rng = np.random.default_rng(seed)
    y, right = random_state(equations, seed)
    n = len(right.closed)
    modes = ContactModes(rng.random(n) < 0.5, rng.random(n) < 0.5, 0)
    for _ in range(2):
        modes, _ = equations.switch(0.0, y, modes)
    assert (equations.indicators(0.0, y, modes) > 0.0).all()
    assert equations.switch(0.0, y, modes)[1] == 0
    np.testing.assert_array_equal(modes.closed, right.closed)


def test_at_the_bound_a_state_is_kept_and_left_beyond_it(equations):
    law, n = equations.law, len(equations.system.contacts.area)
    for gap, after in ((0.5, True), (2.0, False)):
        motion = ContactMotion(gap * GAP_MARGIN * law.penetration, np.zeros(n), np.zeros((2, n)))
        modes, _ = law.switched(motion, ContactModes(np.ones(n, bool), np.ones(n, bool), 0))
        np.testing.assert_array_equal(modes.closed, after)
        modes, changed = law.switched(motion, modes)
        assert changed == 0


def test_preload_is_in_equilibrium():
    """A preloaded interface at rest: its pressure is the preload, and nothing moves."""
    scene = pair(
        interface={"meet": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.3, "preload": 5e6}}
    )
    equations = Equations(reduced_system(scene, 4, 4), energy=False)
    y = equations.start()
    now = equations.evaluate(0.0, y, equations.modes_at(0.0, y), {})
    np.testing.assert_allclose(now.traction.pressure, 5e6)
    acceleration = now.derivative[equations.system.n : 2 * equations.system.n]
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-8 * 5e6 * 1e-4 / equations.system.inertia.min())


def test_damped_contact_never_pulls(equations):
    n = len(equations.system.contacts.area)
    law = ContactLaw(equations.system, replace(Regularisation.of(equations.system), damping=2.0))
    motion = ContactMotion(np.full(n, -1e-7), np.full(n, 10 * equations.system.speed), np.zeros((2, n)))
    assert (law.traction(motion, law.called_for(motion, 0)).pressure == 0.0).all()


def test_laws_are_read_inside_their_segment():
    """At a jump the value is that of the segment the model is in; the jumps are time events."""
    amplitudes = Amplitudes(reduced_system(pair(), 1, 1))
    assert amplitudes.knots == pytest.approx([1e-6, 3e-6])
    assert [amplitudes.segment(t) for t in (0.0, 1e-6, 2e-6, 3e-6)] == [0, 1, 1, 2]
    assert [amplitudes.next_knot(i) for i in range(3)] == [*amplitudes.knots, None]
    values = [(1e-6, 0, 0.0), (1e-6, 1, 1.0), (3e-6, 1, 1.0), (3.1e-6, 1, 1.0), (3e-6, 2, 0.0)]
    for t, segment, value in values:
        assert amplitudes.at(t, segment, {}) == pytest.approx([value])


def test_loads_from_outside():
    load = {"face": "upper.zmax", "pressure": 1.0, "law": {"type": "input", "start_value": 0.5}}
    amplitudes = Amplitudes(reduced_system(pair(load={"press": load}), 1, 1))
    assert amplitudes.inputs == ["press"]
    assert amplitudes.at(1.0, 0, {}) == pytest.approx([0.5])
    assert amplitudes.at(3.0, 0, {"press": (2.0, 10.0, 1.0)}) == pytest.approx([22.0])


def test_moving_ground():
    """Velocity (1, 0, 2): the ground closes the gap by 2 t along -N = z and drags the bar along x."""
    s = reduced_system(bar(interface=MOVING), 2)
    equations = Equations(s, energy=False)
    y = equations.start()
    motion, ground = equations.motion(0.1, y, 0)
    np.testing.assert_allclose(motion.gap, -0.2)
    np.testing.assert_allclose(ground, [[1.0, 0.0, 2.0]])
    np.testing.assert_allclose(np.hypot(*motion.sliding), 1.0)
    now = equations.evaluate(0.1, y, equations.modes_at(0.1, y), {})
    force = now.derivative[2 * s.n : 2 * s.n + 3]
    assert force[0] > 0.0
    assert force[0] == pytest.approx(0.4 * force[2])


def test_only_bonds():
    equations = Equations(reduced_system(rods(), 3), energy=True)
    y = equations.start()
    modes = equations.modes_at(0.0, y)
    assert equations.indicators(0.0, y, modes).shape == (0,)
    assert np.isfinite(equations.evaluate(0.0, y, modes, {}).derivative).all()
