"""Friction, from none to no slip: oblique impact, wedges, a coefficient for which no solution converges; and closed
joints: clamped ones that ride, turn, resonate and are loaded again, fronts through joints, cradles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import cos, degrees, pi, radians, sin
from typing import Any

import numpy as np

from ..latin.outcome import Array, InterfaceHistory
from ..results.solution import Solution
from .case import (
    TIGHT,
    Bench,
    Case,
    Measure,
    contact_laws,
    distance,
    energies,
    energy_laws,
    force_off,
    impulse,
    laws,
    make_case,
    pressure_force,
    resultant,
)
from .scenes import (
    ALUMINIUM,
    EDGE,
    PRESSURE,
    REST,
    STEEL,
    Box,
    Description,
    Material,
    Triple,
    bar,
    column,
    cornered,
    press,
    two_boxes,
    without_slip,
)

STICK = 1


def friction_cases() -> Iterator[Case]:
    """From no friction to no slip: crushing, oblique impact, a corner of three walls."""
    case = partial(make_case, "friction")
    for mu in (0.0, 0.1, 0.3, 1.0, 10.0, 1e6):
        expectation = "same cost at any mu; stick and slip where expected"
        yield case(f"crushing, mu {mu:g}", expectation, _crushing, mu)
    for angle in (0, 15, 30, 45, 60, 73):
        expectation = "impulse on the cone and against the sliding, momentum exact"
        yield case(f"oblique impact, {angle} degrees", expectation, _oblique, angle)
    for mu in (0.0, 0.1, 0.3, 1.0, 10.0):
        expectation = "a node of three interfaces: converged; total force unique for mu <= 0.3"
        yield case(f"corner of three walls, mu {mu:g}", expectation, _corner, mu)
    yield case("corner of three walls, no_slip", "converged where mu 1e6 is not", _no_slip_corner)
    yield case("crushing, no_slip", "the result of mu 1e6, same cost", _no_slip_crushing)
    expectation = "no convergence point by point: stops with a message, laws kept"
    yield case("corner of three walls, mu 1e6", expectation, _not_convergent)


def _crushing(friction: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(press(friction, 6, 60))
    smooth = bench.converged(press(0.0, 6, 60), counted=False)
    history = solution.interfaces["meet"]
    status = history.contact_status
    assert status is not None
    measures = [
        Measure("passes over mu 0", solution.passes / smooth.passes, 2.0),
        Measure("mu 0 over passes", smooth.passes / solution.passes, 2.0),
        *laws(solution),
    ]
    if friction == 0:
        measures.append(Measure("points that stick", int(np.count_nonzero(status == STICK)), 0))
    if friction >= 10:
        slid, free = (_slipped(s.interfaces["meet"], solution.time[1]) for s in (solution, smooth))
        measures.append(Measure("slip over that of mu 0", slid / free, 0.01))
    return measures


def _slipped(history: InterfaceHistory, step: float) -> float:
    """Largest distance a point slips while it is pressed, m."""
    assert history.contact_status is not None
    relative = history.velocity[:, 1] - history.velocity[:, 0]
    sliding = np.linalg.norm(relative[..., :2], axis=2) * (history.contact_status > 0)  # z is the normal
    return float(sliding.sum(axis=0).max()) * step


def _oblique(angle: int, bench: Bench) -> list[Measure]:
    friction, turn = 0.1, 0.3
    tilt = radians(angle)
    velocity = (sin(tilt) * cos(turn), sin(tilt) * sin(turn), cos(tilt))
    first, second = Box(Material(), elements=(3, 3, 8), velocity=velocity), Box(Material(), elements=(3, 3, 8))
    scene = two_boxes(first, second, 1 / 16, 60, friction, tolerance=1e-6, max_iterations=1000)
    scene["output"] = {"energy": True, "fields": True, "every": 60}
    solution = bench.converged(scene)
    received = solution.interfaces["meet"].impulse(solution.time)[-1]
    along = float(np.hypot(received[0], received[1]))
    measures = [Measure("momentum lost", _momentum_drift(solution), 3.1e-13)]
    if angle >= 30:  # slides all along: tan(angle) > 2 mu (1 + Z_s/Z_p)
        # side E slides over E' at rest: friction acts on it against its velocity
        back = float(np.arctan2(-received[1], -received[0]))
        measures += [
            Measure("impulse ratio over mu off by", abs(along / -received[2] / friction - 1), 1.8e-4),
            Measure("direction off by degrees", abs(degrees(back - turn)), 0.012),
        ]
    elif angle == 0:
        measures.append(Measure("shear impulse", along / -received[2], 6e-15))
    else:
        measures.append(Measure("impulse ratio over mu", along / -received[2] / friction, 1.0))
    return measures + energy_laws(solution)


def _momentum_drift(solution: Solution) -> float:
    """Change of the momentum of two equal cubes of unit density over that at the start."""
    total = np.zeros((2, 3))
    for history in solution.substructures.values():
        assert history.velocity is not None
        assert history.cells is not None
        corners = history.nodes[history.cells]
        volume = np.prod(corners.max(axis=1) - corners.min(axis=1), axis=1)  # of boxes; an eighth goes to each corner
        weight = np.bincount(history.cells.ravel(), np.repeat(volume / 8, 8), len(history.nodes))
        total += weight @ history.velocity[[0, -1]]
    return float(np.linalg.norm(total[1] - total[0]) / np.linalg.norm(total[0]))


THROW = (-1.0, -0.7, -0.4)


def _corner(friction: float, bench: Bench) -> list[Measure]:
    # at 1e-3 the work of the errors is just above its limit for some coefficients
    solution = bench.converged(cornered(THROW, friction, tolerance=1e-4))
    measures = laws(solution)
    if friction <= 0.3:
        totals = []
        for kind in ("diagonal", "impedance"):
            scene = cornered(THROW, friction, search_direction=kind, **{**TIGHT, "tolerance": 1e-11})
            tight = bench.converged(scene, counted=False)
            totals.append(np.sum([resultant(tight, name) for name in tight.interfaces], axis=0))
        measures.append(Measure("total force of two search directions differs by", distance(*totals), 3e-10))
    return measures


def _no_slip_corner(bench: Bench) -> list[Measure]:
    solution = bench.converged(without_slip(cornered(THROW, 0.0)))
    energy = energies(solution)
    taken = float(np.abs(energy["friction_dissipation"]).max() / energy["kinetic"][0])
    return [Measure("work of the tangential tractions", taken, 1.2e-16), *energy_laws(solution)]


def _no_slip_crushing(bench: Bench) -> list[Measure]:
    rough = bench.converged(press(1e6, 6, 60), counted=False)
    solution = bench.converged(without_slip(press(0.0, 6, 60)))
    return [
        force_off(solution, rough, 0.05, what="force differs by"),  # holds the points that touch without pressure too
        Measure("normal impulse differs by", abs(impulse(solution) / impulse(rough) - 1), 1.2e-5),
        Measure("passes over mu 1e6", solution.passes / rough.passes, 1.5),
        *energy_laws(solution),
    ]


def _not_convergent(bench: Bench) -> list[Measure]:
    solution = bench.solve(cornered(THROW, 1e6))
    status = solution.status
    vague = not ("interface" in status and "friction" in status and "step" in status)
    finite = all(np.isfinite(h.traction).all() for h in solution.interfaces.values())
    return [
        Measure("message without interface, friction and remedy", float(vague and not solution.converged), 0),
        Measure("numbers that are not finite", float(not finite), 0),
        Measure("iterations in a window", max(bench.iterations), 300),
        *contact_laws(solution),
    ]


# -- closed joints ---------------------------------------------------------------------------------------------------
CLAMP = 1e7  # Pa
CLAMPED: Triple = (0.02, 0.03, 0.05)  # m


def joint_cases() -> Iterator[Case]:
    """Clamped pairs in rigid motions, friction at resonance, loads that come back, fronts, cradles."""
    case = partial(make_case, "joint")
    for speed in (0.0, 1.0, 100.0, 3000.0):
        yield case(f"clamped pair rides at {speed:g} m/s", "the joint at rest (Galilean invariance)", _rides, speed)
    for spin in (0.5, 60.0):
        yield case(f"clamped pair turns at {spin:g} rad/s", "the joint at rest (no strain)", _turns, spin)
    for ratio, name in ((2.0, "grows"), (1.0, "decays")):
        expectation = "peaks X0 + n (pi F0/2 - 2 mu N)/k (exact)"
        yield case(f"block on a spring at resonance, F0/(mu N) {ratio:g}: {name}", expectation, _resonates, ratio)
    yield case("block on a spring at resonance, F0/(mu N) 0.9: held", "never slips", _held)
    for low, mu in (("aluminium", 0.0), ("steel", 0.3)):
        expectation = "the same state each time (one equilibrium), none without load"
        yield case(f"steel on {low} pressed three times, mu {mu:g}", expectation, _pressed_again, low, mu)
    expectation = "|force - load| <= L/c times the changes of the load's rate (exact bar)"
    yield case("bar unloaded to a fifth and loaded again", expectation, _ramps)
    for scheme in ("hht", "generalized_alpha"):
        expectation = "a front as in the bonded bar and as d'Alembert's"
        yield case(f"front through 8 closed joints, {scheme}", expectation, _front, scheme)
        for thrown in (1, 2):
            name = f"cradle of 5 bars, {thrown} thrown, {scheme}"
            yield case(name, "as many fly off: impulses of the exact bars, momentum", _cradle, thrown, scheme)


def clamped_pair(
    instants: int, velocity: Triple = REST, spin: Triple = REST, step: float = 1e-6, friction: float = 0.3
) -> Description:
    """Two steel bars end to end, pressed together, free, in a rigid motion of linear elasticity, v + spin x X."""
    body = Box(replace(STEEL, name="steel"), CLAMPED, (2, 2, 3), velocity)
    joint = {"joint": {"friction_coefficient": friction, "preload": CLAMP}}
    scene = column({"low": body, "up": body}, joint, {"end": instants * step, "instants": instants})
    for table in scene["substructure"].values() if any(spin) else ():
        box = table["box"]
        # origin, size, elements
        axes = [o + np.linspace(0.0, s, n + 1) for o, s, n in zip(*(box[k] for k in box), strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        values = np.asarray(velocity) + np.cross(spin, points)
        table["initial_velocity_field"] = {"file": "turn", "points": points.tolist(), "values": values.tolist()}
    return scene


def kept_clamp(solution: Solution) -> list[Measure]:
    """A clamped pair has not felt its rigid motion: exact values 0; allowed a tenth of the default tolerance, 1e-3."""
    history = solution.interfaces["joint"]
    force, status = history.force()[:, 2], history.contact_status
    assert status is not None
    assert history.gap is not None
    relative = history.velocity[:, 1] - history.velocity[:, 0]
    # bars stand along z: x and y are tangential
    across = float(np.abs(relative[..., :2]).max()) / max(1.0, float(np.abs(history.velocity).max()))
    # shortening of one of the bars under the clamping pressure: sigma L / E
    approach = CLAMP * CLAMPED[2] / STEEL.young
    return [
        Measure("clamp force changed by", float(np.abs(force / force[0] - 1.0).max()), 5e-6),
        Measure("gap over the elastic approach", float(np.abs(history.gap - history.gap[0]).max()) / approach, 3.4e-7),
        Measure("slip velocity over the fastest", across, 2e-15),
        Measure("points that do not stick", int(np.count_nonzero(status != STICK)), 0),
    ]


def _rides(speed: float, bench: Bench) -> list[Measure]:
    return kept_clamp(bench.converged(clamped_pair(2000, (0.3 * speed, -0.2 * speed, speed))))


def _turns(spin: float, bench: Bench) -> list[Measure]:
    return kept_clamp(bench.converged(clamped_pair(2000, spin=(0.5 * spin, -0.3 * spin, 0.8 * spin))))


# -- friction at resonance -------------------------------------------------------------------------------------------
CYCLES = 5
PER_CYCLE = 200
SLIDES = 0.3


def _oscillator(ratio: float, start: float) -> tuple[Description, float, float]:
    """A rigid unit block on rough ground, pressed, and tied by a spring to a wall; F0 = ratio mu N at its frequency 1
    rad/s. The scene, mu N, and k; ``start``: displacement at t = 0 over mu N/k, against the first push."""
    hold = SLIDES  # of a clamping force of 1
    end = CYCLES * 2 * pi
    time = np.linspace(0.0, end, CYCLES * PER_CYCLE + 1)
    law = {"type": "table", "times": time.tolist(), "values": np.sin(time).tolist()}
    keys = {"rigid": True, "initial_displacement": [-start * hold, 0.0, 0.0]}
    block = Box(Material(1e6), (1.0, 1.0, 1.0), (1, 1, 1), keys=keys)
    spring = {"ends": ["block.xmin", "ground"], "direction": [1.0, 0.0, 0.0], "stiffness": 1.0}
    scene = column(
        {"block": block},
        {},
        {"end": end, "instants": CYCLES * PER_CYCLE},
        spring={"tie": spring},
        load={"push": {"face": "block.xmin", "force": [ratio * hold, 0.0, 0.0], "point": [0.0, 0.5, 0.0], "law": law}},
        boundary={"level": {"type": "symmetry", "face": "block.ymin"}},
        output={"fields": True, "energy": True},
        solver={"tolerance": 1e-6},
    )
    scene["interface"] = {"floor": {"sides": ["block.zmin", "ground"], "friction_coefficient": SLIDES}}
    scene["load"]["clamp"] = {"face": "block.zmax", "pressure": 1.0}
    return scene, hold, 1.0


def _resonates(ratio: float, bench: Bench) -> list[Measure]:
    """m x'' + k x = F0 sin(w t) - mu N sign x' turns at w t = n pi exactly, where it starts from -X0 with k X0 > mu N:
    each half cycle adds (pi F0/2 - 2 mu N)/k. Second order in w dt = 0.03: 1e-3, taken five times."""
    start = 6.0
    scene, hold, stiffness = _oscillator(ratio, start)
    solution = bench.converged(scene)
    moved = _along(solution)[:, 0]
    n = np.arange(2 * CYCLES + 1)
    exact = -((-1.0) ** n) * (start * hold + n * (pi / 2 * ratio - 2.0) * hold) / stiffness
    peaks = moved[:: PER_CYCLE // 2]
    travel = float(np.abs(np.diff(exact)).sum())
    assert solution.energy is not None
    heat = float(solution.energy["friction_dissipation"][-1])
    return [
        Measure("peaks off by", distance(peaks, exact), 2.5e-3),
        Measure("work of friction over mu N times the path off by", abs(heat / (hold * travel) - 1), 1.6e-3),
        *laws(solution),
    ]


def _along(solution: Solution) -> Array:
    """Displacements of the nodes of the block along its spring, (n_time, n_node)."""
    displacement = solution.substructures["block"].displacement
    assert displacement is not None
    return displacement[:, :, 0]


def _held(bench: Bench) -> list[Measure]:
    scene, hold, stiffness = _oscillator(0.9, 0.0)
    solution = bench.converged(scene)
    moved = _along(solution)  # which points of a rigid block carry more, up to the cone, is not unique: none moves
    return [Measure("moved, over F0/k", float(np.abs(moved).max()) * stiffness / (0.9 * hold), 1e-6), *laws(solution)]


# -- loads that come back --------------------------------------------------------------------------------------------
def _pressed_again(low: str, friction: float, bench: Bench) -> list[Measure]:
    """Without friction a pressed joint has one equilibrium; with it, equal blocks have no shear to slip by. Limit: a
    thousand times the tolerance of the iteration, 1e-9."""
    base = {"aluminium": ALUMINIUM, "steel": STEEL}[low]
    lower, upper = (Box(m, (EDGE,) * 3, (3, 3, 3)) for m in (base, STEEL))
    scene = two_boxes(lower, upper, 0.1, 50, friction, tolerance=1e-9)
    scene["time"]["quasi_static"] = True
    law = {"type": "table", "times": [float(t) for t in range(6)], "values": [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]}
    scene["load"] = {"press": {"face": "up.zmax", "pressure": PRESSURE, "law": law}}
    scene["boundary"] = {"base": {"type": "fixed", "face": "low.zmin"}}
    scene["boundary"] |= {f"up_{a}": {"type": "symmetry", "face": f"up.{a}min"} for a in "xy"}
    scene["output"] = {}
    solution = bench.converged(scene)
    traction = solution.interfaces["meet"].traction
    unloaded = float(np.abs(traction[[20, 40]]).max()) / PRESSURE
    return [
        Measure("second loading differs from the first by", distance(traction[21:31], traction[1:11]), 2e-8),
        Measure("third", distance(traction[41:51], traction[1:11]), 2e-8),
        Measure("traction without load", unloaded, 0.0),
        Measure("resultant over the load off by", abs(pressure_force(solution)[10] / (PRESSURE * EDGE**2) - 1), 1e-9),
    ]


def _ramps(bench: Bench) -> list[Measure]:
    """The force at the foot of a bar answers a step of its load by 0 and 2 in turn, for 2 L/c each, and so a change of
    its rate by a triangle of height L/c about the load: the bound. 1 % of it for the elements."""
    transits, low = 40.0, 0.2
    corners = [0.0, 1.0, 2.0, 3.0]
    values = [0.0, 1.0, low, 1.0]
    rates = np.diff([0.0, *np.diff(values), *[0.0]]) / transits  # jumps of the rate at the corners
    scene = column({"bar": bar(Material(), 1.0, 20)}, {}, {"end": 4 * transits, "instants": 3200})
    law = {"type": "table", "times": [c * transits for c in [*corners, 5.0]], "values": [*values, 1.0]}
    scene["interface"] = {"foot": {"sides": ["bar.zmin", "ground"]}}
    scene["load"] = {"press": {"face": "bar.zmax", "pressure": 1.0, "law": law}}
    scene["output"] = {"energy": True}
    solution = bench.converged(scene)
    force = pressure_force(solution, "foot")
    load = np.interp(solution.time, np.array([*corners, 5.0]) * transits, [*values, 1.0])
    bound = float(np.abs(rates).sum())
    return [
        Measure("force off the load, over its bound", float(np.abs(force - load).max()) / bound, 1.01),
        Measure("openings", int(np.count_nonzero(force[10:] <= 0.0)), 0),
        Measure("mean force off by", abs(float((force - load).mean())) / bound, 2.5e-4),
        *energy_laws(solution),
    ]


# -- fronts and cradles ----------------------------------------------------------------------------------------------
ELEMENTS = 20


def _front(scheme: str, bench: Bench) -> list[Measure]:
    """d'Alembert: a sudden pressure travels at c as it is. The joints stay closed, which is what bonded ones are; the
    limit is that of the force, 1e-2. The front is as wide as the dispersion of the elements makes it, the limits on it
    those of thrown bars (``contrast``)."""
    count, material = 9, Material()
    bodies = {f"b{i}": bar(material, 1.0, ELEMENTS) for i in range(count)}

    def row_of_bars(**keys: Any) -> Description:
        step, end = 1.0 / ELEMENTS, 1.6 * count
        joints = {f"i{i}": dict(keys) for i in range(1, count)}
        scene = column(bodies, joints, {"end": end, "instants": round(end / step), "scheme": scheme})
        scene["load"] = {"press": {"face": "b0.zmin", "pressure": 1.0}}
        scene["boundary"] = {"far": {"type": "absorbing", "face": f"b{count - 1}.zmax"}}
        return scene

    solution = bench.converged(row_of_bars())
    bonded = bench.converged(row_of_bars(behaviour="perfect"), counted=False)
    apart = 0.0
    late = 0.0
    off = 0.0
    for i in range(1, count):
        force, time = pressure_force(solution, f"i{i}"), solution.time
        missing = float(np.trapezoid(1.0 - force, time)) - i  # of the impulse: the delay of the front
        late = max(late, abs(missing) * ELEMENTS)
        off = max(off, abs(float(force[time > i + 3.0].mean()) - 1.0))
        apart = max(apart, distance(force, pressure_force(bonded, f"i{i}")))
    # the same masses
    same = []
    if scheme == "hht":
        same = [Measure("force off that of bonded bars by", apart, 1e-2)]
    return [*same, Measure("front late by steps", late, 0.6), Measure("mean pressure behind it off by", off, 1e-3)]


def _cradle(thrown: int, scheme: str, bench: Bench) -> list[Measure]:
    """Equal bars exchange their velocities: joint i passes on (min(n - i, k) - max(k - i, 0)) m v. Each joint adds the
    error of two bars (``impact``): 0.75 elements of impulse."""
    count = 5
    bodies = {f"b{i}": bar(Material(), 1.0, ELEMENTS, float(i < thrown)) for i in range(count)}
    end = 2.2 * count
    time = {"end": end, "instants": round(end * ELEMENTS), "scheme": scheme}
    scene = column(bodies, {f"i{i}": {} for i in range(1, count)}, time, output={"energy": True, "fields": True})
    solution = bench.converged(scene)
    passed = np.array([impulse(solution, f"i{i}") for i in range(1, count)])
    exact = np.array([min(count - i, thrown) - max(thrown - i, 0) for i in range(1, count)], dtype=float)
    off = float(np.abs(passed - exact).max())
    measures = [Measure("impulse of a joint off by", off, 0.75 * (count - 1) / ELEMENTS)]
    if scheme == "hht":  # contact nodes have their mass
        total = sum(_mean_velocity(solution, name) for name in bodies)
        measures.append(Measure("momentum lost", abs(total / thrown - 1.0), 7.5e-12))
    return measures + energy_laws(solution)


def _mean_velocity(solution: Solution, body: str) -> float:
    """Mean velocity along z of a bar of equal elements at the end (integral of its shape functions)."""
    history = solution.substructures[body]
    # nodes of a layer have the same z to the bit: they come from one axis
    at, number = np.unique(history.nodes[:, 2], return_inverse=True)
    assert history.velocity is not None
    velocity = np.bincount(number, history.velocity[-1][:, 2]) / np.bincount(number)
    return float(np.trapezoid(velocity, at) / np.ptp(at))
