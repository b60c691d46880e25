"""Gaps and long runs: closed, tiny, closing later, never closing, grazing; bounces and transits of a bar."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from ..errors import SceneError
from ..latin.outcome import Array
from ..results.solution import Solution
from .case import (
    Bench,
    Case,
    Measure,
    distance,
    energies,
    energy_laws,
    impulse,
    make_case,
    openings,
    penetration_bound,
    pressure_force,
    turns,
)
from .scenes import Description, Material, bar, thrown, two_boxes

ELEMENTS = 30
STEP = 1.0 / ELEMENTS


def gap_cases() -> Iterator[Case]:
    """Gaps: closed, tiny, closing later, never closing, negative; grazing contact; contact at t = 0."""
    case = partial(make_case, "gap")
    for gap in (0.0, 1e-16, 1e-12, 1e-3, 0.5):
        yield case(f"bars, gap {gap:g} L", "impulse m v, contact when the gap is crossed", _closing, gap)
    yield case("bars, gap never closed", "no force, free flight, no iterations", _open)
    yield case("bars that overlap", "refused before solving, with the depth", _overlap)
    yield case("touching at t = 0 with a velocity jump", "no flip at the start", _touching)
    yield case("in contact at rest, no load", "nothing happens", _rest)
    expectation = "stress 0 ... 2 rho g L and back to 0, again and again"
    yield case("grazing: bar put on the ground under gravity", expectation, _grazing)
    yield case("grazing: bar released at the top of its flight", "no chatter", _barely_touching)
    yield case("bars under preload", "stay at rest, keep their preload", _preload)


def _thrown_together(gap: float, in_mesh: bool = True) -> Description:
    low, up = bar(Material(), 1.0, ELEMENTS, 1.0), bar(Material(), 1.0, ELEMENTS)
    scene = two_boxes(low, up, STEP, 90, gap=gap if in_mesh else 0.0)
    if not in_mesh:
        scene["interface"]["meet"]["gap"] = gap
    return scene


def _closing(gap: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(_thrown_together(gap))
    by_number = bench.converged(_thrown_together(gap, in_mesh=False), counted=False)
    force, time = pressure_force(solution), solution.time
    first = time[np.argmax(force > 0.01 * force.max())]  # the first True
    return [
        Measure("impulse off by", abs(impulse(solution) - 1.0), 0.75 * STEP),
        Measure("first contact late by steps", abs(first - gap) / STEP, 1.5),
        Measure("gap as number and as distance differ by", distance(pressure_force(by_number), force), 3e-10),
        Measure("penetration over its bound", penetration_bound(solution), 1.0),
        Measure("contacts beyond the first", max(openings(force, 0.1) - 1, 0), 0),
        *energy_laws(solution),
    ]


def _open(bench: Bench) -> list[Measure]:
    solution = bench.converged(_thrown_together(50.0))
    energy = energies(solution)
    drift = float(np.abs(energy["kinetic"] / energy["kinetic"][0] - 1).max())
    return [
        Measure("force", float(np.abs(pressure_force(solution)).max()), 0.0),
        Measure("kinetic energy changed by", drift, 1e-12),
        Measure("iterations per step", max(bench.iterations), 2),
    ]


def _overlap(bench: Bench) -> list[Measure]:
    try:
        bench.solve(_thrown_together(-1e-3))
    except SceneError as error:
        return [Measure("depth not in the message", float("0.001" not in str(error)), 0)]
    return [Measure("overlap solved without an error", 1.0, 0)]


def _touching(bench: Bench) -> list[Measure]:
    solution = bench.converged(_thrown_together(0.0))
    force = pressure_force(solution)
    early = force[1:20]  # without t = 0, where nothing acts yet
    return [
        Measure("largest stress over Z v/2", float(early.max()) / 0.5, 1.4),
        Measure("lack at step 2", 1.0 - float(force[2]) / 0.5, 0.3),
        Measure("turns by more than 2 % in 19 steps", turns(early, 0.01), 10),
        Measure("force at t = 0", abs(float(force[0])), 0.0),
    ]


def _rest(bench: Bench) -> list[Measure]:
    scene = _thrown_together(0.0)
    scene["substructure"]["low"]["initial_velocity"] = [0.0, 0.0, 0.0]
    solution = bench.converged(scene)
    energy = energies(solution)
    return [
        Measure("force", float(np.abs(pressure_force(solution)).max()), 0.0),
        Measure("kinetic energy", float(energy["kinetic"].max()), 0.0),
        Measure("iterations per step", max(bench.iterations), 1),
    ]


def _grazing(bench: Bench) -> list[Measure]:
    """Contact stress rho g c t until 2 L/c, back to 0 at 4 L/c with speed 0: a grazing exit every 4/3."""
    scene = thrown(50, 2000, 20 / 3, 0.0, 0.0, 10.0)
    solution = bench.converged(scene)
    force, time = pressure_force(solution, "wall"), solution.time
    # rho g c t up to 2 L / c: 10 x 30 x 2/3 = 200, twice the weight
    exact = 200.0 * (1 - np.abs(1 - (time % (4 / 3)) / (2 / 3)))
    return [
        Measure("stress off by (of 200)", float(np.abs(force - exact).max()) / 200, 0.06),
        Measure("mean stress over weight", abs(float(force[1:].mean()) / 100 - 1), 9e-4),
        Measure("openings in 5 periods", openings(force, 10.0), 0),
        *energy_laws(solution),
    ]


def _barely_touching(bench: Bench) -> list[Measure]:
    """Thrown up from below so that it arrives at the gap with speed 0: rises 0.05 in 0.1 under gravity 10."""
    scene = thrown(50, 400, 0.2, 0.05, 0.0, 10.0)
    scene["substructure"]["bar"]["initial_velocity"] = [0.0, 0.0, 1.0]
    scene["substructure"]["roof"] = bar(Material(), 1.0, 5).table((0.0, 0.0, 10.1))
    scene["boundary"] = {"held": {"type": "fixed", "face": "roof.zmax"}}
    scene["interface"]["roof"] = {"sides": ["bar.zmax", "roof.zmin"]}
    solution = bench.converged(scene)
    force = pressure_force(solution, "roof")
    # a point mass would just touch: 1 t - 5 t^2 = 0.05 at t = 0.1; the step resolves the top within dt^2 g / 8
    return [
        # Z v = 30 x 0.01
        Measure("stress over that of 1 % of the launch speed", float(force.max()) / (30.0 * 0.01), 0.36),
        Measure("openings", openings(force, 0.0), 3),
        *energy_laws(solution),
    ]


def _preload(bench: Bench) -> list[Measure]:
    """Quiet to the tolerance: 1e-2 on the force by default, in proportion when it is tightened."""
    material, measures = Material(), []
    for tolerance in (1e-3, 1e-9):
        scene = two_boxes(bar(material, 1.0, 5), bar(material, 1.0, 5), 0.1, 100, tolerance=tolerance)
        scene["interface"]["meet"]["preload"] = 1e-3
        force = pressure_force(bench.converged(scene))
        lost = float(np.abs(force / 1e-3 - 1).max())
        measures.append(Measure(f"preload lost at tolerance {tolerance:g}", lost, 1.3e-13))
    return measures


PERIOD = 8 / 3  # from one contact to the next: 2 s of flight from height 5 under gravity 10, and 2 L/c of contact
FALL = 500.0  # energy of the fall, J


def long_cases() -> Iterator[Case]:
    """Long runs: many bounces, many transits, energy under refinement."""
    case = partial(make_case, "duration")
    damped: dict[str, Any] = {"type": "newmark", "beta": 0.3025, "gamma": 0.6}
    expectation = "energy never above its start, period kept"
    yield case("20 bounces, hht", expectation, _bounces, 20, 50, {"type": "hht"}, quick=False)
    yield case("20 bounces, newmark, gamma 0.6", expectation, _bounces, 20, 50, damped, quick=False)
    for elements in (25, 50):
        name, claim = f"20 bounces, massless contact nodes, {elements} elements", "at least 95 % of the energy kept"
        yield case(name, f"{claim} at Courant number 0.6", _keeps, elements, quick=elements < 50)
    yield case("5 bounces, hht", expectation, _bounces, 5, 25, {"type": "hht"})
    landing, alpha = "force within 10 % of the plateau, energy never above its start", {"type": "generalized_alpha"}
    for courant in (0.05, 0.6, 4.0):
        quick = courant > 0.05
        yield case(
            f"landing, generalized_alpha, Courant number {courant:g}", landing, _landing, courant, alpha, quick=quick
        )
    undamped = alpha | {"landing_damping": 0.0}
    yield case(
        "20 bounces, generalized_alpha, landing_damping 0", "at least 65 % of the energy kept", _keeps_by, 25, undamped
    )
    yield case("20 bounces, generalized_alpha at Courant number 30", "energy never above its start", _long_steps)
    yield case("energy after 3 bounces, hht", "loss falls by 1.5 per refinement", _refinement)
    yield case("50 transits in one window of contact", "mean force is the weight, energy kept", _transits, quick=False)


def bouncing(bounces: int, elements: int, scheme: dict[str, Any], **solver: Any) -> Description:
    """The bar dropped from 5 under gravity 10, step 0.6 of the transit of an element."""
    end = PERIOD * bounces
    # transit of an element: (10 / elements) / 30
    instants = round(end / (0.6 / 3 / elements))
    scene = thrown(elements, instants, end, 5.0, 0.0, 10.0, **solver)
    scene["time"]["scheme"] = scheme
    return scene


def closings(force: Array, time: Array) -> Array:
    """Instants at which contact begins, a pause of a quarter of the period between two."""
    on = np.flatnonzero(force > 0.02 * force.max())
    # a ripple that opens for some steps is no bounce
    fresh = np.concatenate([[True], np.diff(time[on]) > PERIOD / 4])
    starts: Array = time[on][fresh]
    return starts


def energy_share(solution: Solution) -> float:
    """Stored energy minus work of gravity at the end, from -500 (all lost) as a share of the energy of the fall."""
    energy = energies(solution)
    return 1 + float((energy["kinetic"] + energy["elastic"] - energy["work_of_loads"])[-1]) / FALL


def _bounces(bounces: int, elements: int, scheme: dict[str, Any], bench: Bench) -> list[Measure]:
    solution = bench.converged(bouncing(bounces, elements, scheme))
    start = closings(pressure_force(solution, "wall"), solution.time)[:3]
    exact = 1 + PERIOD * np.arange(len(start))
    damped = scheme["type"] != "hht"  # takes a quarter of the energy per three bounces, and so of the flight
    return [
        Measure("first three contacts off by", float(np.abs(start / exact - 1).max()), 5e-2 if damped else 1e-2),
        Measure("energy lost per bounce", (1 - energy_share(solution)) / bounces, 0.06),
        *energy_laws(solution),
    ]


def _keeps(elements: int, bench: Bench) -> list[Measure]:
    """Nearly conserving, not dissipative: a thousandth may be gained; the start is not at rest at the foot (1e-5)."""
    solution = bench.converged(bouncing(20, elements, {"type": "massless_contact"}))
    start = closings(pressure_force(solution, "wall"), solution.time)[:3]
    exact = 1 + PERIOD * np.arange(len(start))
    return [
        Measure("first three contacts off by", float(np.abs(start / exact - 1).max()), 1e-2),
        Measure("energy lost", 1 - energy_share(solution), 0.042),
        *energy_laws(solution, round_off=2.4e-12),
    ]


def _landing(courant: float, scheme: dict[str, Any], bench: Bench) -> list[Measure]:
    """The bar thrown at 10 from 0.1 above the ground: force 300 for 2/3, worst of three landing phases."""
    elements = 40
    peaks = []
    gained = []
    step = courant / 3 / elements  # in transits of 10/40 at speed 30
    for phase in (0.1, 0.4, 0.9):
        # gap crossed at speed 10 after ``phase`` of a step
        scene = thrown(
            elements, max(8, round(0.9 / step)), max(8, round(0.9 / step)) * step, 10 * phase * step, -10.0, 0.0
        )
        scene["time"]["scheme"] = scheme
        solution = bench.converged(scene)
        energy = energies(solution)
        stored = energy["kinetic"] + energy["elastic"]
        peaks.append(float(pressure_force(solution, "wall").max()) / 300.0)
        gained.append(float(stored.max() / stored[0]) - 1.0)
    return [Measure("largest force over 300", max(peaks), 1.10), Measure("energy gained", max(gained), 1e-14)]


def _keeps_by(elements: int, scheme: dict[str, Any], bench: Bench) -> list[Measure]:
    """Energy lost in 20 bounces, and gained at any instant."""
    solution = bench.converged(bouncing(20, elements, scheme))
    return [Measure("energy lost", 1 - energy_share(solution), 0.35), *energy_laws(solution, round_off=1e-12)]


def _long_steps(bench: Bench) -> list[Measure]:
    """Step of 30 transits of an element, where massless_contact gains 89 times its energy."""
    elements, step = 25, 30 / 3 / 25
    scene = thrown(elements, 150, 150 * step, 5.0, 0.0, 10.0)
    scene["time"]["scheme"] = {"type": "generalized_alpha"}
    solution = bench.converged(scene)
    energy = energies(solution)
    total = energy["kinetic"] + energy["elastic"] - energy["work_of_loads"]
    return [Measure("energy gained over that of the fall", float(total.max()) / FALL, 1e-4)]


def _refinement(bench: Bench) -> list[Measure]:
    """Loss of the scheme alone: the iteration is taken far enough (1e-5) not to be seen."""
    lost = []
    for elements in (16, 32, 64):
        solution = bench.converged(bouncing(3, elements, {"type": "hht"}, tolerance=1e-5))
        lost.append(1 - energy_share(solution))
    return [
        Measure("lost with 16 elements", lost[0], 0.2),
        Measure("with 32", lost[1], 0.15),
        Measure("with 64", lost[2], 0.08),
        Measure("slowest fall", 1.5 / min(lost[0] / lost[1], lost[1] / lost[2]), 1.0),
    ]


def _transits(bench: Bench) -> list[Measure]:
    """Bar put on the ground under gravity: 50 transits, 12.5 periods of 4 L/c."""
    solution = bench.converged(thrown(50, 5000, 50 / 3, 0.0, 0.0, 10.0))
    force = pressure_force(solution, "wall")
    # rho L g A = 1 x 10 x 10 x 1
    weight = 100.0
    return [
        Measure("mean force over weight off by", abs(impulse(solution, "wall") / (weight * 50 / 3) - 1), 7e-4),
        Measure("openings", openings(force, 10.0), 0),
        *energy_laws(solution),
    ]
