"""The reference solutions against closed forms: each is checked before it is used."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from .oracles import balances, cases, sliding_block
from .oracles.bars import Bar, Waves
from .oracles.connections import Contact, Joint, PrescribedStress, closing_time
from .oracles.contact import ContactProblem, force_scale, gauss_seidel, jacobian, newton, one_point, solve
from .oracles.contact_march import Body, ContactFace, march_contact
from .oracles.hexahedra import Block, merged
from .oracles.histories import fitted_order, observed_orders, relative_integral_error, relative_l2_error
from .oracles.monolithic import LinearSystem, Scheme, march
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


# ---- solids -------------------------------------------------------------------------------------------

STEEL = (210e9, 0.3, 7800.0)


def test_brick_assembly_passes_the_patch_test() -> None:
    solid = merged([Block((0, 0, 0), (1, 2, 3), (2, 1, 2), *STEEL), Block((0, 0, 3), (1, 2, 1), (2, 1, 1), *STEEL)])
    assert len(solid.nodes) == 3 * 2 * 4
    assert solid.mass.sum() == pytest.approx(3 * 7800.0 * 8.0, rel=TIGHT)
    strain = np.array([[1.0, 0.2, -0.3], [0.2, -0.5, 0.1], [-0.3, 0.1, 0.4]])
    field = (solid.nodes @ strain).ravel()
    trace = np.trace(strain)
    lame, shear = 210e9 * 0.3 / (1.3 * 0.4), 210e9 / 2.6
    energy = 0.5 * 8.0 * (lame * trace**2 + 2 * shear * (strain**2).sum())
    assert 0.5 * field @ solid.stiffness @ field == pytest.approx(energy, rel=1e-12)
    spin = (solid.nodes @ np.array([[0, 1, -2], [-1, 0, 3], [2, -3, 0.0]])).ravel()
    assert np.abs(solid.stiffness @ spin).max() < 1e-12 * np.abs(solid.stiffness.data).max()
    top = solid.on_plane(2, 4.0)
    assert solid.face_areas(top).sum() == pytest.approx(2.0, rel=TIGHT)


def _bar_system(n: int, step: float, scheme: Scheme) -> tuple[LinearSystem, np.ndarray, np.ndarray]:
    """A unit bar along z without lateral motion (c = 1), free; nodes and areas of its end z = 0."""
    solid = merged([Block((0, 0, 0), (0.1, 0.1, 1.0), (1, 1, n), 1.0, 0.0, 1.0)])
    held = np.nonzero(np.arange(solid.n_dof) % 3 != 2)[0]
    end = solid.on_plane(2, 0.0)
    return LinearSystem(solid.mass, None, solid.stiffness, held, step, scheme), end, solid.face_areas(end)


def test_monolithic_march_converges_to_the_exact_wave() -> None:
    """Smooth pulse, refined in space and time together: second order."""
    smooth = cases.piecewise(lambda t: -(math.sin(math.pi * t) ** 2) if t < 1 else 0.0, 2.0, 800)
    exact = Waves([Bar(1.0, 1.0, 1.0)], [PrescribedStress(smooth), PrescribedStress(smooth.scaled(0.0))], 2.0)
    errors = []
    for n in (10, 20, 40):
        system, end, areas = _bar_system(n, 1.0 / n, Scheme.newmark())
        time = np.linspace(0.0, 2.0, 2 * n + 1)
        loads = np.zeros((len(time), system.n_dof))
        loads[:, 3 * end + 2] = np.outer(-smooth.sample(time), areas)
        computed = march(system, loads).displacement[-1, 3 * end[0] + 2]
        errors.append(abs(computed - exact.displacement(0, 0.0, 2.0)))
    assert min(observed_orders([1 / 10, 1 / 20, 1 / 40], errors)) > 1.7, errors


def test_newmark_keeps_energy_and_hht_loses_some() -> None:
    kept = {}
    for name, scheme in (("newmark", Scheme.newmark()), ("hht", Scheme.hht(-0.1))):
        system, _, _ = _bar_system(10, 0.03, scheme)
        v0 = np.zeros(system.n_dof)
        v0[system.free] = np.random.default_rng(RNG_SEED).normal(size=len(system.free))
        run = march(system, np.zeros((100, system.n_dof)), v0=v0)
        u, v = (x[-1, system.free] for x in (run.displacement, run.velocity))
        start = 0.5 * v0[system.free] @ system.mass @ v0[system.free]
        kept[name] = 0.5 * (v @ system.mass @ v + u @ system.stiffness @ u) / start
    assert kept["newmark"] == pytest.approx(1.0, rel=1e-10)
    assert 0.2 < kept["hht"] < 0.99


# ---- contact of one instant ---------------------------------------------------------------------------


def _random_problem(seed: int, points: int, friction: float) -> ContactProblem:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3 * points, 3 * points)) / math.sqrt(3 * points)
    operator = root @ root.T * 0.3 + np.eye(3 * points)
    return ContactProblem(
        operator, rng.normal(size=(points, 3)), rng.exponential(0.3, points), np.full(points, friction)
    )


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("points", [1, 4, 12])
def test_contact_solution_satisfies_the_law(points: int, friction: float) -> None:
    problem = _random_problem(points, points, friction)
    force = solve(problem)
    velocity, scale = problem.velocity(force), force_scale(problem)
    normal, opening = force[:, 0], problem.bias + velocity[:, 0]
    assert normal.min() >= -TIGHT * scale
    assert opening.min() >= -1e-10
    assert np.abs(normal * opening).max() < 1e-10 * scale
    tangential = np.linalg.norm(force[:, 1:], axis=1)
    assert (tangential <= friction * normal + 1e-10 * scale).all()
    power = (force[:, 1:] * velocity[:, 1:]).sum(axis=1)
    slip = np.linalg.norm(velocity[:, 1:], axis=1)
    assert power == pytest.approx(-friction * normal * slip, abs=1e-9 * scale)


def test_newton_and_gauss_seidel_agree() -> None:
    problem = _random_problem(7, 10, 0.4)
    aim = 1e-13 * force_scale(problem)
    by_newton = newton(problem, np.zeros((10, 3)), aim, iterations=12)
    by_sweeps = gauss_seidel(problem, np.zeros((10, 3)), aim)
    assert by_newton == pytest.approx(by_sweeps, abs=1e-11 * force_scale(problem))


def test_newton_matrix_is_the_derivative() -> None:
    problem = _random_problem(5, 8, 0.4)
    force = solve(problem) + np.random.default_rng(RNG_SEED).normal(size=(8, 3))
    step = np.random.default_rng(RNG_SEED + 1).normal(size=(8, 3))
    difference = (problem.residual(force + 1e-6 * step) - problem.residual(force - 1e-6 * step)) / 2e-6
    assert jacobian(problem, force) @ step.ravel() == pytest.approx(difference.ravel(), abs=1e-7)


def test_one_point_known_answers() -> None:
    block = np.diag([2.0, 1.0, 1.0])
    assert one_point(block, np.array([0.1, 5.0, 5.0]), 0.5) == pytest.approx(np.zeros(3))
    assert one_point(block, np.array([-4.0, 0.3, -0.4]), 0.5) == pytest.approx([2.0, -0.3, 0.4])
    assert one_point(block, np.array([-4.0, 3.0, -4.0]), 0.5) == pytest.approx([2.0, -0.6, 0.8])


def test_contact_forces_scale_with_the_motion() -> None:
    problem = _random_problem(3, 6, 0.3)
    larger = ContactProblem(problem.operator * 1e-9, problem.free * 1e3, problem.bias * 1e3, problem.friction)
    assert solve(larger) == pytest.approx(1e12 * solve(problem), rel=1e-9, abs=1e-10 * force_scale(larger))


# ---- contact transient --------------------------------------------------------------------------------


def _two_block_march(friction: float, speed: tuple[float, float]) -> tuple[list[Body], ContactFace, float]:
    """Two unequal blocks, gap 0, the upper one thrown on the lower one, which is glued to the ground."""
    lower = merged([Block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1.0, 0.3, 1.0)])
    upper = merged([Block((0, 0, 1), (1, 1, 1), (2, 2, 2), 3.0, 0.3, 2.0)])
    step, n_time = 0.05, 60
    feet = lower.on_plane(2, 0.0)
    held = (3 * feet[:, None] + np.arange(3)).ravel()
    bodies = []
    for solid, fixed, v in ((lower, held, (0.0, 0.0)), (upper, np.zeros(0, np.int64), speed)):
        system = LinearSystem(solid.mass, None, solid.stiffness, fixed, step, Scheme.hht())
        v0 = np.tile([v[0], 0.0, v[1]], len(solid.nodes))
        bodies.append(Body(system, np.zeros((n_time, solid.n_dof)), np.zeros(solid.n_dof), v0))
    nodes = (lower.on_plane(2, 1.0), upper.on_plane(2, 1.0))
    normals = np.tile([0.0, 0.0, 1.0], (9, 1))
    return bodies, ContactFace((0, 1), nodes, normals, np.zeros(9), friction), step


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_contact_march_keeps_the_laws(friction: float) -> None:
    bodies, face, step = _two_block_march(friction, (0.05, -0.1))
    run = march_contact(bodies, [face], "euler")
    force, opening = run.force[0], run.opening_velocity[0]
    assert force[:, :, 2].max() <= 1e-12
    assert force[:, :, 2].min() < -1e-4
    assert run.gap[0].min() > -1e-12
    size = np.linalg.norm(force[:, :, :2], axis=2)
    assert (size <= -friction * force[:, :, 2] + 1e-10).all()
    assert (size.max() > 1e-10) == (friction > 0.0)
    power = (force[:, :, :2] * opening[:, :, :2]).sum(axis=(1, 2))  # of the force on E along W' - W
    assert power.min() >= -1e-12
    # Momentum of the flying block: what it lost is the impulse of the scheme's weighting of the force.
    n_dof = bodies[1].system.n_dof
    ones = np.zeros((n_dof, 3))
    for d in range(3):
        ones[d::3, d] = 1.0
    displacement = run.displacement[1]
    weighted = 0.9 * force.sum(axis=1)[1:] + 0.1 * force.sum(axis=1)[:-1]
    late = np.diff(displacement, axis=0)[-1] / step  # mean velocity of the last step
    mass = bodies[1].system.mass
    assert (ones.T @ mass @ late)[1] == pytest.approx(0.0, abs=1e-10)
    gained = ones.T @ mass @ (late - bodies[1].velocity)
    assert gained[2] == pytest.approx(-step * weighted[:, 2].sum(), rel=0.05)


def test_contact_march_of_bars_tends_to_the_exact_impact() -> None:
    """Impact bar on a rigid wall against the travelling waves: impulse, and the L2 error of the force."""
    exact = cases.impact_bar(2.0)
    errors, impulses, steps = [], [], []
    for n in (25, 50, 100):
        solid = merged([Block((0, 0, 0), (0.5, 0.5, 10.0), (1, 1, n), 900.0, 0.0, 1.0)])
        step = 0.5 * 10.0 / n / 30.0
        n_time = round(2.0 / step) + 1
        held = np.nonzero(np.arange(solid.n_dof) % 3 != 2)[0]
        system = LinearSystem(solid.mass, None, solid.stiffness, held, step, Scheme.hht())
        v0 = np.tile([0.0, 0.0, -10.0], len(solid.nodes))
        body = Body(system, np.zeros((n_time, solid.n_dof)), np.zeros(solid.n_dof), v0)
        foot = solid.on_plane(2, 0.0)
        face = ContactFace((0, None), (foot, foot), np.tile([0.0, 0.0, -1.0], (4, 1)), np.full(4, 5.0), 0.0)
        run = march_contact([body], [face])
        time = np.linspace(0.0, (n_time - 1) * step, n_time)
        pressure = run.force[0][:, :, 2].sum(axis=1) / 0.25
        errors.append(relative_l2_error(time, pressure, exact.pressure))
        impulses.append(relative_integral_error(time, pressure, exact.pressure))
        steps.append(step)
    assert abs(impulses[-1]) < 5e-3, impulses
    assert errors[-1] < 0.15, errors
    assert fitted_order(steps, errors) > 0.25, errors


# ---- block under 8 cos t ------------------------------------------------------------------------------


def test_sliding_block_reproduces_the_listed_numbers() -> None:
    phases = sliding_block.slips(7.0)
    assert [p.begin for p in phases] == pytest.approx([0.0, 2.946347, 6.087939], abs=5e-7)
    assert [p.end for p in phases] == pytest.approx([0.338608, 3.532835, 6.674427], abs=5e-7)
    places = [sliding_block.position(t) for t in (1.0, 4.0, 7.0)]
    assert places == pytest.approx([3.00434857, 2.99130283, 3.00434857], abs=5e-9)
    assert sliding_block.velocity(0.15) == pytest.approx(0.01830506, abs=5e-9)
    assert sliding_block.velocity(1.0) == 0.0
