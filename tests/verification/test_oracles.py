"""The solutions of bars against published numbers and closed forms.

Those of solids (``hexahedra``, ``monolithic``, ``contact``, ``contact_march``) are compared with the package in
``test_equivalence``, to 1e-6 and closer: code that has nothing in common with theirs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from .oracles import balances, cases, sliding_block
from .oracles.bars import Bar, Waves
from .oracles.connections import Contact, Joint, PrescribedStress, closing_time
from .oracles.histories import fitted_order, observed_orders, relative_integral_error, relative_l2_error
from .oracles.piecewise import PiecewiseLinear, product_integral

RNG_SEED = 20000
TIGHT = 1e-12


# ---- piecewise-linear functions -------------------------------------------------------------------------


def test_piecewise_values_at_a_jump_and_integrals() -> None:
    f = PiecewiseLinear.from_pieces(0.0, [(1.0, 2.0, 4.0), (3.0, -1.0, -1.0)])
    assert f(1.0) == 4.0
    assert f(1.0, after=True) == -1.0
    assert f.integral(0.0, 3.0) == pytest.approx(1.0, abs=TIGHT)
    assert f.integral(0.5, 2.0) == pytest.approx(0.5 * 3.5 - 1.0, rel=TIGHT)
    assert product_integral(f, f, 0.0, 3.0) == pytest.approx((64 - 8) / 6 + 2.0, rel=TIGHT)
    assert f.double_integral(0.0, 1.0) == pytest.approx(1.0 + 1.0 / 3.0, rel=TIGHT)


def test_piecewise_joins_straight_continuations() -> None:
    f = PiecewiseLinear.from_pieces(0.0, [(1.0, 0.0, 1.0), (2.0, 1.0, 2.0), (3.0, 2.0, 0.0)])
    assert f.knots == [0.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("gap", "velocity", "rate", "expected"),
    [
        (5.0, -10.0, 0.0, 0.5),
        (5.0, 0.0, -10.0, 1.0),
        (5.0, 10.0, 0.0, math.inf),
        (1.0, 0.0, 1.0, math.inf),
        (1e-12, -1.0, 0.0, 1e-12),
        (1.0, 1.0, -4.0, 1.0),
        (0.0, 3.0, -2.0, 3.0),
    ],
)
def test_closing_time(gap: float, velocity: float, rate: float, expected: float) -> None:
    assert closing_time(gap, velocity, rate) == pytest.approx(expected, rel=TIGHT)


# ---- bars -----------------------------------------------------------------------------------------------


def test_beam_in_traction_has_the_published_instants() -> None:
    solved = cases.beam_in_traction()
    transit, pressure = solved.waves.bars[0].transit, 100e6
    closings, openings = cases.contact_instants(solved)
    assert np.array(closings) / transit == pytest.approx([2.3], rel=TIGHT)
    assert np.array(openings) / transit == pytest.approx([4.3], rel=TIGHT)
    p = solved.pressure
    assert [p(t * transit) / pressure for t in (2.2, 2.5, 2.99, 3.01, 4.0)] == pytest.approx([0, 1, 1, 0, 0], abs=TIGHT)
    assert p.integral(0.0, solved.waves.end) == pytest.approx(0.7 * pressure * transit, rel=TIGHT)
    end_velocity = solved.waves.velocity[2][0]
    assert end_velocity(1.99 * transit) == pytest.approx(0.0, abs=TIGHT)
    assert end_velocity(2.01 * transit) == pytest.approx(2 * pressure / solved.waves.bars[0].impedance, rel=TIGHT)


def test_beam_in_traction_waves_have_the_published_lengths() -> None:
    """A tension pulse of length 0.3 L goes back in bar 1, a compression pulse of 0.7 L on in bar 2."""
    solved = cases.beam_in_traction()
    bar = solved.waves.bars[0]
    x = (np.arange(2000) + 0.5) / 2000 * bar.length
    in_bar_1, _ = solved.waves.field(1, x, 2.95 * bar.transit)
    in_bar_2, _ = solved.waves.field(2, x, 3.2 * bar.transit)
    assert np.mean(in_bar_1 > 0.5e8) == pytest.approx(0.3, abs=1e-3)
    assert np.mean(in_bar_2 < -0.5e8) == pytest.approx(0.7, abs=1e-3)
    assert in_bar_1.max() == pytest.approx(1e8, rel=TIGHT)
    assert in_bar_2.min() == pytest.approx(-1e8, rel=TIGHT)


def test_impact_bar() -> None:
    solved = cases.impact_bar()
    assert cases.contact_instants(solved)[0] == pytest.approx([0.5], rel=TIGHT)
    assert cases.contact_instants(solved)[1] == pytest.approx([0.5 + 2 / 3], rel=TIGHT)
    assert solved.pressure(0.8) == pytest.approx(300.0, rel=TIGHT)
    assert solved.pressure.integral(0.0, 2.0) == pytest.approx(200.0, rel=TIGHT)
    stress, velocity = solved.waves.field(0, [0.0, 3.0, 10.0], 1.5)
    assert velocity == pytest.approx(10.0, rel=TIGHT)
    assert stress == pytest.approx(0.0, abs=1e-9)


def test_bouncing_bar() -> None:
    solved = cases.bouncing_bar(16.0)
    closings, openings = cases.contact_instants(solved)
    k = np.arange(6)
    assert closings == pytest.approx(1 + 8 * k / 3, rel=TIGHT)
    assert openings == pytest.approx(5 / 3 + 8 * k[: len(openings)] / 3, rel=TIGHT)
    p = solved.pressure
    for i in range(5):
        a, b = float(closings[i]), float(openings[i])
        first, last = (300.0, 500.0) if i % 2 == 0 else (500.0, 300.0)
        assert p(a + 1e-9, after=True) == pytest.approx(first, rel=1e-6)
        assert p(b - 1e-9) == pytest.approx(last, rel=1e-6)
        assert p.integral(a, b) == pytest.approx(800 / 3, rel=1e-11)
    foot = [5.0 + solved.waves.displacement(0, 0.0, t) for t in (8 / 3, 16 / 3)]
    assert foot == pytest.approx([3 + 8 / 9, 5.0], rel=1e-11)
    assert balances.energy(solved.waves, 15.0) == pytest.approx(balances.work(solved.waves, 15.0), abs=1e-9 * 500)


def test_bouncing_bar_stays_periodic_for_twenty_bounces() -> None:
    solved = cases.bouncing_bar(60.0)
    assert 5.0 + solved.waves.displacement(0, 0.0, 10 * 16 / 3) == pytest.approx(5.0, rel=1e-10)
    assert len(cases.contact_instants(solved)[0]) == 23


@pytest.mark.parametrize("ratio", [1.0, 3.0, 0.01, 1e6])
def test_unequal_bars_collide(ratio: float) -> None:
    """Stress Z1 Z2 dv/(Z1 + Z2) from the closing instant until the first reflection is back."""
    first, second = Bar(1.0, 2.0, 3.0, velocity=1.0), Bar(1.5, 2.0 * ratio, 3.0 * ratio, velocity=-0.5)
    solved = cases.colliding_bars(first, second, 0.3, 6.0)
    expected = first.impedance * second.impedance * 1.5 / (first.impedance + second.impedance)
    assert cases.contact_instants(solved)[0][0] == pytest.approx(0.2, rel=TIGHT)
    back = 0.2 + 2 * min(first.transit, second.transit)
    assert [solved.pressure(t) for t in (0.21, back - 1e-6)] == pytest.approx([expected] * 2, rel=TIGHT)
    assert balances.momentum(solved.waves, 6.0) == pytest.approx(3.0 - 0.5 * 4.5 * ratio, rel=1e-11)


def test_two_bars_on_a_wall() -> None:
    solved = cases.two_bars_on_a_wall()
    bar = solved.waves.bars[0]
    closing = 1e-5 * bar.impedance / (2 * 100e6) + bar.transit
    assert cases.contact_instants(solved)[0] == pytest.approx([closing], rel=TIGHT)
    assert closing == pytest.approx(21.30e-6, abs=5e-9)
    p = solved.pressure
    assert p(30e-6) == pytest.approx(100e6, rel=TIGHT)
    assert p(70e-6) == pytest.approx(200e6, rel=TIGHT)


@pytest.mark.parametrize("name", ["beam", "impact", "bouncing", "wall", "uneven"])
def test_energy_and_momentum_close_to_round_off(name: str) -> None:
    build: dict[str, Callable[[], cases.Solved]] = {
        "beam": cases.beam_in_traction,
        "impact": cases.impact_bar,
        "bouncing": cases.bouncing_bar,
        "wall": cases.two_bars_on_a_wall,
        "uneven": lambda: cases.colliding_bars(Bar(1.0, 2.0, 3.0, 1.0), Bar(0.77, 5.0, 1.3, -1.0), 0.1, 12.0),
    }
    solved = build[name]()
    waves = solved.waves
    start, scale = (balances.energy(waves, 0.0), max(balances.energy(waves, t) for t in np.linspace(0, waves.end, 50)))
    for time in np.linspace(0.0, waves.end, 23)[1:]:
        assert abs(balances.energy(waves, time) - start - balances.work(waves, time)) < 1e-11 * scale
        assert balances.momentum(waves, time) == pytest.approx(
            balances.impulse(waves, time), abs=1e-11 * math.sqrt(scale * 1e4)
        )
        assert solved.gap(time) > -1e-11 * max(1.0, solved.initial_gap)
    assert all(v >= 0.0 for v in (*solved.pressure.left, *solved.pressure.right))


def test_joined_bars_are_one_bar() -> None:
    """A joint of equal bars is invisible; of unequal bars it transmits 2 Z2/(Z1 + Z2) of the stress."""
    pulse = PrescribedStress(PiecewiseLinear.from_pieces(0.0, [(0.4, -1.0, -1.0), (4.0, 0.0, 0.0)]))
    free = PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, 4.0))
    whole = Waves([Bar(2.0, 1.0, 1.0)], [pulse, free], 4.0)
    cut = Waves([Bar(0.7, 1.0, 1.0), Bar(1.3, 1.0, 1.0)], [pulse, Joint(), free], 4.0)
    for time in (0.9, 1.7, 3.3):
        assert cut.field(1, [0.5, 1.0], time)[0] == pytest.approx(whole.field(0, [1.2, 1.7], time)[0], abs=TIGHT)
    unequal = Waves([Bar(1.0, 1.0, 1.0), Bar(1.0, 9.0, 1.0)], [pulse, Joint(), free], 1.3)
    assert unequal.stress[1](1.2) == pytest.approx(-2 * 3.0 / 4.0, rel=TIGHT)


def test_resting_contact_does_not_chatter() -> None:
    """Touching bars at rest, and a preloaded pair, keep their state for ever."""
    still = cases.colliding_bars(Bar(1.0, 1.0, 1.0), Bar(1.0, 4.0, 1.0), 0.0, 9.0)
    assert cases.contact_instants(still) == ([], [])
    assert still.pressure.integral(0.0, 9.0) == 0.0
    hold = PrescribedStress(PiecewiseLinear.constant(-3.0, 0.0, 9.0))
    bars = [Bar(1.0, 1.0, 1.0, stress=-3.0), Bar(0.3, 4.0, 1.0, stress=-3.0)]
    pressed = Waves(bars, [hold, Contact(0.0), hold], 9.0)
    assert np.array(pressed.stress[1].left) == pytest.approx(-3.0, rel=TIGHT)
    assert np.array(pressed.velocity[1][0].left) == pytest.approx(0.0, abs=TIGHT)


# ---- shear --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("threshold", [0.0, 0.3, 0.8, 1e6])
def test_shear_wave_is_clipped_by_friction(threshold: float) -> None:
    modulus, density, length, end = 4.0, 1.0, 1.0, 4.0
    incident = cases.piecewise(lambda t: math.sin(2 * math.pi * t), end, 64)
    solved = cases.shear_interface(modulus, density, length, incident, threshold, end)
    waves, transit, impedance = solved.waves, 0.5, 2.0
    for time in np.linspace(transit, end, 200)[1:]:
        arriving = incident(time - transit)
        transmitted = min(max(arriving, -threshold), threshold)
        assert waves.stress[1](time) == pytest.approx(transmitted, abs=1e-10)
        first, second = (v(time) for v in waves.velocity[1])
        assert second - first == pytest.approx(2 * (arriving - transmitted) / impedance, abs=1e-10)
    slip = PiecewiseLinear.from_pieces(
        0.0, [(e, abs(q - p), abs(q1 - p1)) for (_, e, p, p1), (_, _, q, q1) in _paired(waves)]
    )
    lost = balances.dissipation(waves, 1, end)
    assert lost == pytest.approx(threshold * slip.integral(0.0, end), rel=1e-9, abs=1e-9)
    assert lost >= -1e-12
    assert balances.energy(waves, end) == pytest.approx(balances.work(waves, end), abs=1e-10)


def _paired(waves: Waves) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Pieces of both sides' velocities at connection 1 cut at the same times."""
    first, second = waves.velocity[1]
    cuts = sorted({*first.knots, *second.knots})
    return [((a, b, *first.on(a, b)), (a, b, *second.on(a, b))) for a, b in itertools.pairwise(cuts) if b > a]


# ---- distances and orders -----------------------------------------------------------------------------


def test_l2_error_of_a_shock_front_has_order_one_half() -> None:
    """A jump sampled at its instants and joined by a straight line: error^2 is h/3 exactly."""
    exact = PiecewiseLinear.from_pieces(0.0, [(0.5, 0.0, 0.0), (1.0, 1.0, 1.0)])
    steps = [1 / n for n in (10, 20, 40, 80)]
    errors = []
    for n in (10, 20, 40, 80):
        t = np.linspace(0.0, 1.0, n + 1)
        errors.append(relative_l2_error(t, exact.sample(t), exact))
    assert errors == pytest.approx([math.sqrt(h / 3 / 0.5) for h in steps], rel=1e-10)
    assert observed_orders(steps, errors) == pytest.approx([0.5] * 3, rel=1e-10)
    assert fitted_order(steps, errors) == pytest.approx(0.5, rel=1e-10)
    t = np.linspace(0.0, 1.0, 11)
    assert relative_integral_error(t, exact.sample(t), exact) == pytest.approx(-0.1, rel=1e-10)


# ---- block under 8 cos t ------------------------------------------------------------------------------


def test_sliding_block_reproduces_the_listed_numbers() -> None:
    phases = sliding_block.slips(7.0)
    assert [p.begin for p in phases] == pytest.approx([0.0, 2.946347, 6.087939], abs=5e-7)
    assert [p.end for p in phases] == pytest.approx([0.338608, 3.532835, 6.674427], abs=5e-7)
    places = [sliding_block.position(t) for t in (1.0, 4.0, 7.0)]
    assert places == pytest.approx([3.00434857, 2.99130283, 3.00434857], abs=5e-9)
    assert sliding_block.velocity(0.15) == pytest.approx(0.01830506, abs=5e-9)
    assert sliding_block.velocity(1.0) == 0.0
