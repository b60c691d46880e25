"""Bars against their exact solution."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes import pressure, solved

from .oracles import cases, histories

TRANSIT = 0.5 / np.sqrt(210e9 / 7800.0)
ALL_BARS = ("bar1_a", "bar1_b", "bar2")


def refined(n: int) -> tuple[str, ...]:
    """beam_in_traction with n steps, mesh in proportion."""
    return (
        f"time.instants={n}",
        *(f"substructure.{b}.box.elements=[1, 1, {n // 5}]" for b in ALL_BARS),
        "output.fields=false",
        "output.stress=false",
    )


def test_paper_setting_converges_as_the_paper_says():
    """One window from zero, no acceleration: sqrt(eta) <= 1e-3; the paper converges in six iterations."""
    solution = solved("beam_in_traction/scene")
    assert len(solution.windows) == 1
    assert solution.windows[0].iterations <= 8
    assert solution.windows[0].fallbacks == []
    assert solution.passes <= 9
    assert solution.error_indicator <= 1e-3


def test_contact_instant_and_impulse():
    """Closing at 2.3 L/c within 1.5 steps; impulse 0.7 p0 L/c within 0.5 % (a first-order gap gives +2 %)."""
    solution = solved("beam_in_traction/scene")
    history, time = pressure(solution, "contact"), solution.time
    first = time[np.argmax(history > 0.01 * history.max())]
    assert abs(first - 2.3 * TRANSIT) <= 1.5 * time[1]
    assert np.trapezoid(history, time) == pytest.approx(0.7 * 100e6 * TRANSIT, rel=5e-3)
    exact = cases.beam_in_traction()
    assert abs(histories.relative_integral_error(time, history, exact.pressure)) < 5e-3


def test_force_history_converges_at_the_order_of_a_front():
    """L2 error of a shock front: order about 1/2 (a jump), the impulse stays within 0.5 % at every resolution."""
    exact = cases.beam_in_traction()
    errors = []
    for n in (250, 500):
        solution = solved("beam_in_traction/scene", *refined(n))
        assert solution.windows[0].iterations <= 8  # the count does not depend on the resolution
        history = pressure(solution, "contact")
        errors.append(histories.relative_l2_error(solution.time, history, exact.pressure))
        assert abs(histories.relative_integral_error(solution.time, history, exact.pressure)) < 5e-3
    order = histories.fitted_order((2.0, 1.0), errors)
    assert 0.3 < order < 1.0, f"errors {errors}, order {order:.2f}"
    assert errors[0] < 0.25


def test_waves_after_the_contact():
    """Bar 2 carries a compression of length 0.7 L, bar 1 the reflected tension of length 0.3 L, same level."""
    solution = solved("beam_in_traction/scene")
    at = round(3.15 * 42)  # both pulses are inside their bars
    length = 0.5 / 50
    second = solution.substructures["bar2"].stress[at, :, 2]
    first = np.concatenate([solution.substructures[b].stress[at, :, 2] for b in ("bar1_a", "bar1_b")])
    # integral of the stress = level x length of the pulse
    assert second.sum() * length == pytest.approx(-100e6 * 0.7 * 0.5, rel=0.02)
    assert first.sum() * length == pytest.approx(100e6 * 0.3 * 0.5, rel=0.06)
    assert np.median(second[second < -50e6]) == pytest.approx(-100e6, rel=0.05)
    assert np.median(first[first > 50e6]) == pytest.approx(100e6, rel=0.1)


def test_impact_bar_numbers_and_their_refinement():
    """Force 300, contact 0.5 ... 1.1667, impulse 200, rebound at +10: errors fall under refinement."""
    exact = cases.impact_bar()
    errors = []
    for level in (1, 2, 4):
        overrides = (f"time.instants={400 * level}", f"substructure.bar.box.elements=[1, 1, {100 * level}]")
        solution = solved("impact_bar/scene", "output.fields=false", *overrides)
        history, time = pressure(solution, "wall"), solution.time
        touching = time[history > 0.01 * history.max()]
        assert abs(touching[0] - 0.5) <= 1.5 * time[1]
        assert abs(touching[-1] - 7 / 6) <= 3 * time[1]
        plateau = history[(time > 0.7) & (time < 1.0)]
        assert plateau.mean() == pytest.approx(300.0, rel=5e-3)
        errors.append(abs(histories.relative_integral_error(time, history, exact.pressure)))
    assert errors[0] < 0.012
    assert errors[2] < 0.006
    assert histories.fitted_order((4.0, 2.0, 1.0), errors) > 0.5, errors


def test_bouncing_bar_two_contacts():
    """Contacts [1, 5/3] and [11/3, 13/3], impulse 800/3 each, foot at 3.8889 at t = 8/3."""
    losses = []
    for level in (1, 2):
        mesh = (f"time.instants={1100 * level}", f"substructure.bar.box.elements=[1, 1, {100 * level}]")
        # at the default tolerance a third of the loss is of the iteration
        solution = solved("bouncing_bar/scene", "output.fields=false", "solver.tolerance=1e-5", *mesh)
        history, time = pressure(solution, "wall"), solution.time
        on = history > 0.01 * history.max()
        early, late = time[on & (time < 2.6)], time[on & (time > 2.6)]
        step = time[1]
        assert abs(early[0] - 1.0) <= 1.5 * step
        assert abs(early[-1] - 5 / 3) <= 0.02 * level**-0.6  # the end of the contact is smeared
        assert abs(late[0] - 11 / 3) <= 0.01  # energy lost at the first impact shortens the flight
        assert abs(late[-1] - 13 / 3) <= 0.02 * level**-0.6
        first = np.trapezoid(np.where(time < 2.6, history, 0), time)
        second = np.trapezoid(np.where(time >= 2.6, history, 0), time)
        assert first == pytest.approx(800 / 3, rel=3e-3)
        assert second == pytest.approx(800 / 3, rel=1e-2)
        foot = solution.interfaces["wall"].gap[np.argmin(np.abs(time - 8 / 3))].mean()
        assert foot == pytest.approx(3.8889, rel=2e-2 / level)  # without viscosity the foot swings on
        energy = solution.energy
        losses.append(-(energy["kinetic"] + energy["elastic"] - energy["work_of_loads"])[-1] / 500)
    assert losses[0] < 0.015  # of the energy of the fall, lost by the scheme at the impacts (HHT: 0.039)
    assert losses[0] > 1.5 * losses[1]


def test_shear_wave_on_a_frictional_interface():
    """Transmitted shear = clip(incident, +- mu sigma0); dissipation mu sigma0 per unit slip (Miller, Tran 1979)."""
    limit, area, duration = 3e6, 4e-6, 3.0472470011002204e-05
    impedance = 7800 * np.sqrt(84e9 / 7800)
    errors = []
    for level in (1, 2):
        overrides = [f"time.instants={320 * level}"]
        overrides += [f"substructure.{b}.box.elements=[1, 1, {50 * level}]" for b in ("lower", "upper")]
        solution = solved("shear_interface/scene", "output.fields=false", *overrides)
        time, history = solution.time, solution.interfaces["fault"]
        inside = (time >= duration) & (time <= 2 * duration)
        incident = np.where(inside, 2 * limit * np.sin(np.pi * (time - duration) / duration), 0.0)
        transmitted = np.clip(incident, -limit, limit)
        shear = -history.force()[:, 0] / area  # on side E, opposite to the incident motion
        # across the shear there is nothing but what the iteration tolerance (1e-3) lets pass
        assert np.abs(history.force()[:, 1]).max() < 1e-3 * limit * area
        assert np.abs(shear).max() <= limit * 1.01  # the contact pressure itself moves a little
        errors.append(float(np.linalg.norm(shear - transmitted) / np.linalg.norm(transmitted)))
        assert np.trapezoid(shear, time) == pytest.approx(np.trapezoid(transmitted, time), rel=1e-3)
        slip_rate = 2 * (incident - transmitted) / impedance
        dissipated = area * limit * np.trapezoid(slip_rate, time)
        assert solution.energy["friction_dissipation"][-1] == pytest.approx(dissipated, rel=2e-3)
        assert set(np.unique(history.contact_status)) == {1, 2}
    assert errors[0] < 0.02
    assert errors[1] < 0.7 * errors[0]
