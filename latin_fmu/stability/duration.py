"""Long runs: many bounces, many transits, energy under refinement."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from ..latin.record import Array
from ..results.solution import Solution
from .case import Bench, Case, Description, Measure
from .measures import energy_laws, impulse, openings, pressure_force
from .scenes import thrown

PERIOD = 8 / 3  # from one contact to the next
FALL = 500.0  # energy of the fall, J


def cases() -> Iterator[Case]:
    """See the module docstring."""
    damped: dict[str, Any] = {"type": "newmark", "beta": 0.3025, "gamma": 0.6}
    schemes: dict[str, dict[str, Any]] = {"hht": {"type": "hht"}, "newmark, gamma 0.6": damped}
    for name, scheme in schemes.items():
        yield Case(
            f"20 bounces, {name}",
            "duration",
            "energy never above its start, period kept",
            partial(_bounces, 20, 50, scheme),
            quick=False,
        )
    for elements in (25, 50):
        yield Case(
            f"20 bounces, massless contact nodes, {elements} elements",
            "duration",
            "at least 95 % of the energy kept at Courant number 0.6",
            partial(_keeps, elements),
            quick=elements < 50,
        )
    yield Case(
        "5 bounces, hht",
        "duration",
        "energy never above its start, period kept",
        partial(_bounces, 5, 25, {"type": "hht"}),
    )
    yield Case("energy after 3 bounces, hht", "duration", "loss falls by 1.5 per refinement", _refinement)
    yield Case(
        "50 transits in one window of contact",
        "duration",
        "mean force is the weight, energy kept",
        _transits,
        quick=False,
    )


def bouncing(bounces: int, elements: int, scheme: dict[str, Any], **solver: Any) -> Description:
    """The bar dropped from 5 under gravity 10, step 0.6 of the transit of an element."""
    end = PERIOD * bounces
    instants = round(end / (0.6 / 3 / elements))
    scene = thrown(elements, instants, end, 5.0, 0.0, 10.0, **solver)
    scene["time"]["scheme"] = scheme
    return scene


def closings(force: Array, time: Array) -> Array:
    """Instants at which contact begins, a pause of a quarter of the period between two."""
    on = np.flatnonzero(force > 0.02 * force.max())
    fresh = np.concatenate([[True], np.diff(time[on]) > PERIOD / 4])
    found: Array = time[on][fresh]
    return found


def kept(solution: Solution) -> float:
    """Stored energy minus work of gravity at the end, from -500 (all lost) as a share of the energy of the fall."""
    energy = solution.energy
    assert energy is not None
    return 1 + float((energy["kinetic"] + energy["elastic"] - energy["work_of_loads"])[-1]) / FALL


def _bounces(bounces: int, elements: int, scheme: dict[str, Any], bench: Bench) -> list[Measure]:
    solution = bench.converged(bouncing(bounces, elements, scheme))
    start = closings(pressure_force(solution, "wall"), solution.time)[:3]
    exact = 1 + PERIOD * np.arange(len(start))
    damped = scheme["type"] != "hht"  # takes a quarter of the energy per three bounces, and so of the flight
    return [
        Measure("first three contacts off by", float(np.abs(start / exact - 1).max()), 5e-2 if damped else 1e-2),
        Measure("energy lost per bounce", (1 - kept(solution)) / bounces, 0.06),
        *energy_laws(solution),
    ]


def _keeps(elements: int, bench: Bench) -> list[Measure]:
    """Nearly conserving, not dissipative: a thousandth may be gained; the start is not at rest at the foot (1e-5)."""
    solution = bench.converged(bouncing(20, elements, {"type": "massless_contact"}))
    start = closings(pressure_force(solution, "wall"), solution.time)[:3]
    exact = 1 + PERIOD * np.arange(len(start))
    return [
        Measure("first three contacts off by", float(np.abs(start / exact - 1).max()), 1e-2),
        Measure("energy lost", 1 - kept(solution), 0.05),
        *energy_laws(solution, round_off=1e-5),
    ]


def _refinement(bench: Bench) -> list[Measure]:
    """Loss of the scheme alone: the iteration is taken far enough (1e-5) not to be seen."""
    lost = []
    for elements in (16, 32, 64):
        solution = bench.converged(bouncing(3, elements, {"type": "hht"}, tolerance=1e-5))
        lost.append(1 - kept(solution))
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
    weight = 100.0
    return [
        Measure("mean force over weight off by", abs(impulse(solution, "wall") / (weight * 50 / 3) - 1), 5e-2),
        Measure("openings", openings(force, 10.0), 26),
        *energy_laws(solution),
    ]
