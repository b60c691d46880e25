"""``time.start = "static"``: what was bolted, stacked and loaded before the shock stays where it is until the shock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.cosim.session import Session
from latin_fmu.effects.explanation import explain
from latin_fmu.stability.scenes import STEEL, Box, column
from tests.scenes import solve

Tables = dict[str, Any]
SIDE, HEIGHT, PRESSURE, SHEAR = 0.02, 0.01, 50e6, 4e6


def stack(start: Any = "static", **solver: Any) -> Tables:
    """Three blocks on a fixed base under a dead pressure and a dead shear load that friction holds."""
    return column(
        dict.fromkeys(("b0", "b1", "b2"), Box(STEEL, (SIDE, SIDE, HEIGHT), (3, 3, 2))),
        {f"i{i}": {"friction_coefficient": 0.3} for i in range(2)},
        {"end": 2e-5, "instants": 100, "start": start},
        boundary={"base": {"type": "fixed", "face": "b0.zmin"}},
        load={
            "press": {"face": "b2.zmax", "pressure": PRESSURE},
            "shear": {"face": "b2.zmax", "traction": [SHEAR, 0.0, 0.0]},
        },
        output={"fields": True},
        solver={"tolerance": 1e-7, **solver},
    )


def speed(solution: latin_fmu.Solution) -> float:
    """Largest velocity of any node at any instant, m s-1."""
    return max(float(np.abs(body.velocity).max()) for body in solution.substructures.values())


def rest(n: int, scheme: str | None = None) -> float:
    """Largest velocity in n instants under dead loads at the default tolerance, over p / (rho c)."""
    tables = stack()
    tables["time"] |= {"end": n * 2e-7, "instants": n} | ({} if scheme is None else {"scheme": scheme})
    tables["output"] = {}
    del tables["solver"]["tolerance"]
    velocities = [np.abs(history.velocity).max() for history in solve(tables).interfaces.values()]
    return float(max(velocities)) * STEEL.density * np.sqrt(STEEL.young / STEEL.density) / PRESSURE


@pytest.mark.parametrize("scheme", [None, "hht", "generalized_alpha"])
def test_dead_loads_leave_a_stack_at_rest(scheme: str | None) -> None:
    """Errors far below the tolerance of the dead loads do not add up to a motion: a residual of 1e-12 is round-off."""
    assert rest(5000, scheme) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("scheme", [None, "hht", "generalized_alpha"])
def test_dead_loads_leave_a_stack_at_rest_for_ever(scheme: str | None) -> None:
    assert rest(100_000, scheme) < 1e-8


# -- nothing moves ------------------------------------------------------------------------------------------------
def as_it_is(_: Tables) -> None:
    pass


def undamped(tables: Tables) -> None:
    tables["time"]["scheme"] = "newmark"


def massless(tables: Tables) -> None:
    tables["time"]["scheme"] = "massless_contact"


def explicit(tables: Tables) -> None:
    tables["time"] |= {"scheme": "central_difference", "instants": 200}


def reduced(tables: Tables) -> None:
    tables["solver"]["propagator"] = {"type": "reduced", "modes": 10}


def long_windows(tables: Tables) -> None:
    tables["solver"]["window"] = 10


def heavy_and_damped(tables: Tables) -> None:
    tables["material"]["steel"] |= {"frame": "absolute", "rayleigh_mass": 1e3, "rayleigh_stiffness": 1e-8}
    for body in tables["substructure"].values():
        body["body_force"] = [0.0, 0.0, -1e8]
    tables["boundary"]["quiet"] = {"type": "absorbing", "face": "b2.xmax"}


def rigid_on_top(tables: Tables) -> None:
    tables["substructure"]["b2"]["rigid"] = True


def bonded(tables: Tables) -> None:
    tables["interface"]["i0"] = {"sides": ["b0.zmax", "b1.zmin"], "behaviour": "perfect"}


def never_slipping(tables: Tables) -> None:
    tables["interface"]["i0"] = {"sides": ["b0.zmax", "b1.zmin"], "behaviour": "no_slip"}


def bolted(tables: Tables) -> None:
    tables["interface"]["i0"]["preload_force"] = 2e7 * SIDE**2


def glued_and_soft(tables: Tables) -> None:
    tables["interface"]["i0"] = {
        "sides": ["b0.zmax", "b1.zmin"],
        "behaviour": "elastic_layer",
        "normal_stiffness": 1e14,
        "tangential_stiffness": 3e13,
    }
    tables["interface"]["i1"] |= {"behaviour": "soft_contact", "normal_stiffness": 1e14, "preload": 1e7}


def slipping_in_part(tables: Tables) -> None:
    for interface in tables["interface"].values():
        interface["friction_coefficient"] = 0.085


def closed_by_the_load(tables: Tables) -> None:
    """The block above is held at its side and bent down onto the one below, over part of the face."""
    tables["interface"]["i1"]["gap"] = 1e-6
    tables["boundary"]["ends"] = {"type": "fixed", "face": "b2.xmin"}
    tables["load"]["shear"]["traction"] = [0.0, 0.0, -SHEAR]


CHANGES: list[Callable[[Tables], None]] = [
    as_it_is,
    undamped,
    massless,
    explicit,
    reduced,
    long_windows,
    heavy_and_damped,
    rigid_on_top,
    bonded,
    never_slipping,
    bolted,
    glued_and_soft,
    slipping_in_part,
    closed_by_the_load,
]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_dead_loads_move_nothing_after_the_hand_over(change: Callable[[Tables], None]) -> None:
    """1e-8 of the velocities that the same loads bring where they are put on at t = 0 (1e-7 where stiff layers, whose
    forces are differences of displacements, share the load)."""
    tables, without = stack(), stack("given")
    change(tables)
    change(without)
    ringing, still = solve(without), solve(tables)
    assert speed(ringing) > 0.2 * PRESSURE / STEEL.impedance
    limit = 1e-7 if change is glued_and_soft else 1e-8
    assert speed(still) < limit * speed(ringing)
    moved = max(float(np.abs(body.displacement[0]).max()) for body in still.substructures.values())
    assert moved > 1e-6
    assert any(history.traction[0].any() for history in still.interfaces.values())


def test_short_steps_do_not_magnify_what_the_tolerance_has_left_of_the_gaps() -> None:
    tables = stack()
    tables["time"]["end"] = 1e-9
    assert speed(solve(tables)) < 1e-8 * PRESSURE / STEEL.impedance


def test_partial_slip_is_there_and_handed_over() -> None:
    tables = stack()
    slipping_in_part(tables)
    status = solve(tables).interfaces["i0"].contact_status
    assert {1, 2} == set(np.unique(status[0]).tolist())
    np.testing.assert_array_equal(status[0], status[1])


# -- a shock on top -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("bonds", ["direct", "iterate"])
@pytest.mark.parametrize("shocked", ["by a load", "by its base"])
def test_a_shock_on_a_bonded_bar_adds_to_its_static_state(bonds: str, shocked: str) -> None:
    """Superposition: what the shock does to the preloaded bar, minus the static state, is what it does to the bar."""

    def bar(start: str, dead: bool) -> Tables:
        tables = stack(start, bonds=bonds, tolerance=1e-10)
        for i in range(2):
            tables["interface"][f"i{i}"] = {"sides": [f"b{i}.zmax", f"b{i + 1}.zmin"], "behaviour": "perfect"}
        if not dead:
            tables["load"] = {}
        pulse = {"type": "half_sine", "duration": 6e-6}
        if shocked == "by a load":
            tables["load"]["shock"] = {"face": "b2.zmax", "traction": [1e7, 0.0, -8e7], "law": pulse}
        else:
            tables["boundary"]["base"] |= {
                "type": "velocity",
                "components": ["x", "y", "z"],
                "value": [0.0, 0.1, 2.0],
                "law": pulse,
            }
        return tables

    both, alone = solve(bar("static", True)), solve(bar("given", False))
    for name, body in both.substructures.items():
        other = alone.substructures[name]
        added = body.displacement - body.displacement[0]
        assert np.abs(added - other.displacement).max() < 1e-8 * np.abs(other.displacement).max()
        assert np.abs(body.velocity - other.velocity).max() < 1e-8 * np.abs(other.velocity).max()
    for name, history in both.interfaces.items():
        added = history.traction[1:] - both.interfaces[name].traction[:1]
        other = alone.interfaces[name].traction[1:]
        if shocked == "by a load":  # a base that starts with a jump of velocity has tractions at t = 0 already
            assert np.abs(added - other).max() < 1e-8 * np.abs(history.traction).max()


LENGTH, WIDTH, N, FRICTION, GRIP = 0.5, 0.02, 25, 0.25, 50e6
LOST = 2 * FRICTION * GRIP * WIDTH  # friction force per length on both planes, N m-1
STIFFNESS = STEEL.young * WIDTH * WIDTH
TRANSIT = LENGTH / STEEL.speed


def clamped(first: float, last: float, transits: float) -> Tables:
    """A bar clamped between two planes, pulled at one end by ``first`` and then slowly by ``last`` times the friction
    that its whole length can bring (nu = 0, one element across: one-dimensional shear lag)."""
    whole = LOST * LENGTH / WIDTH**2
    planes = {
        side: {"sides": [f"bar.{side}", "ground"], "friction_coefficient": FRICTION, "preload": GRIP}
        for side in ("zmin", "zmax")
    }
    end = transits * TRANSIT
    law = {"type": "table", "times": [0.0, end], "values": [first, last]}
    return column(
        {"bar": Box(replace(STEEL, poisson=0.0), (LENGTH, WIDTH, WIDTH), (N, 1, 1))},
        {},
        {"end": end, "instants": round(60 * transits), "start": {"increments": 20}},
        interface=planes,
        load={"pull": {"face": "bar.xmax", "traction": [whole, 0.0, 0.0], "law": law}},
        output={"fields": True},
        solver={"tolerance": 1e-5},
    )


def end_of(solution: latin_fmu.Solution) -> np.ndarray:
    bar = solution.substructures["bar"]
    return bar.displacement[:, bar.nodes[:, 0] > 0.999 * LENGTH, 0].mean(axis=1)


def test_a_clamped_block_stays_stuck_below_the_limit() -> None:
    """Slip over F / q from the pulled end, u = F^2 / (2 E A q), at the start and after the slow pull; else stick."""
    solution = solve(clamped(0.4, 0.8, 40))
    u = end_of(solution)
    for instant, part in ((0, 0.4), (-1, 0.8)):
        exact = (part * LOST * LENGTH) ** 2 / (2 * STIFFNESS * LOST)
        # the pull takes 40 transits: the bar swings about its equilibrium by a few percent
        assert u[instant] == pytest.approx(exact, rel=3e-3 if instant == 0 else 0.04)
        history = solution.interfaces["zmin"]
        slipping = history.points[history.contact_status[instant] == 2, 0]
        assert slipping.min() == pytest.approx(LENGTH * (1 - part), abs=2 * LENGTH / N)
    stuck = solution.interfaces["zmin"].contact_status[:, history.points[:, 0] < 0.15 * LENGTH]
    assert (stuck == 1).all()


def test_a_clamped_block_slips_at_the_limit() -> None:
    """The far end begins to slide when the pull reaches the friction of the whole length, and not before."""
    solution = solve(clamped(0.4, 1.1, 70))
    history = solution.interfaces["zmin"]
    far = history.points[:, 0] < 1e-9
    first = int(np.argmax((history.contact_status[:, far] == 2).any(axis=1)))
    pull = np.interp(first, [0, len(history.contact_status) - 1], [0.4, 1.1])
    assert pull == pytest.approx(1.0, abs=0.03)


# -- parts that move, motions ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5, 1e-6])
def test_a_projectile_takes_no_part_until_it_arrives(tolerance: float) -> None:
    """A preloaded stack at rest converges beside a body that flies, and stays at rest to a fifth of the tolerance."""
    tables = stack()
    box = {"origin": [0.0, 0.0, 3 * HEIGHT + 2e-5], "size": [SIDE, SIDE, HEIGHT], "elements": [3, 3, 2]}
    tables["substructure"]["shot"] = {"material": "steel", "box": box, "initial_velocity": [0.0, 0.0, -5.0]}
    tables["interface"]["hit"] = {"sides": ["b2.zmax", "shot.zmin"]}
    tables["solver"] = {"tolerance": tolerance}
    solution = solve(tables)
    arrival = (2e-5 - solution.substructures["b2"].displacement[0, :, 2].max()) / 5.0
    before = solution.time < 0.95 * arrival
    assert 5 < before.sum() < 95
    for name in ("b0", "b1", "b2"):
        assert np.abs(solution.substructures[name].velocity[before]).max() < 0.2 * 5.0 * tolerance
    assert not solution.interfaces["hit"].traction[before].any()
    assert np.abs(solution.interfaces["hit"].traction[~before]).max() > 1e7


def test_a_stretched_bar_is_stretched_from_the_start() -> None:
    """A face displaced at t = 0 strains the bar evenly, and lets it go when the displacement is taken back."""
    tables = column(
        {"bar": Box(replace(STEEL, poisson=0.0), (0.1, 0.01, 0.01), (10, 1, 1))},
        {},
        {"end": 1e-5, "instants": 50, "start": "static"},
        boundary={
            "foot": {"type": "fixed", "face": "bar.xmin"},
            "head": {"type": "displacement", "face": "bar.xmax", "components": ["x"], "value": [1e-5]},
        },
        output={"fields": True},
    )
    bar = solve(tables).substructures["bar"]
    np.testing.assert_allclose(bar.displacement[0, :, 0], 1e-4 * bar.nodes[:, 0], rtol=0, atol=1e-15)
    assert np.abs(bar.velocity).max() < 1e-9


# -- sessions -------------------------------------------------------------------------------------------------------
def test_inputs_count_with_the_value_they_are_given_at_the_start() -> None:
    tables = stack()
    tables["load"]["press"]["law"] = {"type": "input", "start_value": 0.5}
    scene = latin_fmu.scene_from_dict(tables)
    end, n = scene.time.end, scene.time.n_step
    runs = {}
    for value in (0.5, 1.0):
        run = SegmentedRun(scene)
        run.advance(end / 2, n // 2, {"press": np.full(n // 2 + 1, value)})
        snapshot = run.snapshot()
        segment = run.advance(end, n // 2, {"press": np.full(n // 2 + 1, value)})
        runs[value] = segment.interfaces["i0"].traction
        assert np.abs(run.velocity("b2")).max() < 1e-7
        fresh = SegmentedRun(scene)  # of the other start value
        fresh.restore(snapshot)
        again = fresh.advance(end, n // 2, {"press": np.full(n // 2 + 1, value)})
        np.testing.assert_array_equal(again.interfaces["i0"].traction, runs[value])
        run.reset()
        once_more = run.advance(end / 2, n // 2, {"press": np.full(n // 2 + 1, 0.5)})
        assert once_more.converged
        assert np.abs(run.velocity("b2")).max() < 1e-7
    pressures = [traction[-1, :, 2].sum() for traction in runs.values()]
    assert pressures[1] == pytest.approx(2 * pressures[0], rel=0.01)


def test_a_session_starts_in_equilibrium_with_its_inputs() -> None:
    """The force is there when initialization ends, and stays to the tolerance while the input does."""
    tables = stack()
    tables["load"]["press"]["law"] = "input"
    session = Session(latin_fmu.scene_from_dict(tables))
    session.set_load("press", 0.8)
    session.initialize()
    force = session.value("interface.i0.normalForce")
    assert abs(force) == pytest.approx(0.8 * PRESSURE * SIDE**2, rel=1e-8)
    for _ in range(3):
        assert session.step(session.time, 2e-6).accepted
        assert session.value("interface.i0.normalForce") == pytest.approx(force, rel=1e-8)


# -- refusals -------------------------------------------------------------------------------------------------------
def floating(tables: Tables) -> str:
    del tables["boundary"]["base"]
    return "substructure: nothing holds b0, b1"


def slippery(tables: Tables) -> str:
    tables["interface"]["i0"]["friction_coefficient"] = 0.02
    return "time.start: no static equilibrium"


def all_thrown(tables: Tables) -> str:
    for body in tables["substructure"].values():
        body["initial_velocity"] = [0.0, 0.0, 1.0]
    return "time.start: every substructure has an initial velocity"


def thrown_but_bonded(tables: Tables) -> str:
    tables["substructure"]["b2"]["initial_velocity"] = [0.0, 0.0, 1.0]
    tables["interface"]["i1"] = {"sides": ["b1.zmax", "b2.zmin"], "behaviour": "perfect"}
    return "interface.i1: holds or presses a substructure that has an initial velocity"


def static_all_along(tables: Tables) -> str:
    tables["time"] |= {"quasi_static": True, "instants": 5}
    return "time.start: every step is an equilibrium already"


def misspelt(tables: Tables) -> str:
    tables["time"]["start"] = "statik"
    return "did you mean 'static'"


@pytest.mark.parametrize(
    "change",
    [floating, slippery, all_thrown, thrown_but_bonded, static_all_along, misspelt],
    ids=lambda change: change.__name__,
)
def test_what_has_no_static_start_is_refused(change: Callable[[Tables], str]) -> None:
    tables = stack()
    said = change(tables)
    with pytest.raises(latin_fmu.SceneError, match=said):
        latin_fmu.solve(latin_fmu.scene_from_dict(tables))


def test_explain_tells_it() -> None:
    effects = {
        start: next(e for e in explain(latin_fmu.scene_from_dict(stack(start))).effects if e.name == "static start")
        for start in ("static", "given")
    }
    assert (effects["static"].on, effects["given"].on) == (True, False)
    assert effects["static"].memory > 0 == effects["given"].memory


def test_nothing_that_acts_is_no_start() -> None:
    tables = stack()
    tables["load"] = {}
    assert speed(solve(tables)) == 0.0
