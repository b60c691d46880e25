"""Impedance and length contrasts between neighbours."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from .case import Bench, Case, Description, Measure
from .measures import TIGHT, distance, energy_laws, impulse, laws, mean_iterations, pressure_force
from .scenes import Box, Stuff, bar, two_boxes

RATIOS = (1.0, 10.0, 1e2, 1e4, 1e6)


def cases() -> Iterator[Case]:
    """Contrasts of stiffness and density for bars and blocks, of length, and a side the mesh does not resolve."""
    for what in ("E", "rho"):
        for ratio in RATIOS:
            yield Case(
                f"bars, {what} ratio {ratio:g}",
                "contrast",
                "stress Z1 Z2 v/(Z1+Z2), cost of contrast 1",
                partial(_bars, what, ratio),
            )
    for friction in (0.0, 0.3):
        for what in ("E", "rho"):
            for ratio in RATIOS:
                yield Case(
                    f"blocks, {what} ratio {ratio:g}, mu {friction:g}",
                    "contrast",
                    "force of the same discrete problem at round-off, cost of contrast 1",
                    partial(_blocks, what, ratio, friction),
                )
    for ratio in (1.0, 10.0, 100.0):
        yield Case(
            f"bars, length ratio 1:{ratio:g}",
            "contrast",
            "the short bar stops: impulse rho L v",
            partial(_lengths, ratio),
            quick=ratio < 100,
        )
    yield Case("blocks, soft side not resolved", "contrast", "converged is not accurate: warned", _unresolved)


def _stuffs(what: str, ratio: float, poisson: float = 0.0) -> tuple[Stuff, Stuff]:
    hard = Stuff(ratio, 1.0, poisson) if what == "E" else Stuff(1.0, ratio, poisson)
    return Stuff(1.0, 1.0, poisson), hard


def bars(what: str, ratio: float, elements: int = 30) -> tuple[Description, float]:
    """Two bars of equal transit, the first thrown on the second; the scene and the exact contact stress."""
    soft, hard = _stuffs(what, ratio)
    low, up = bar(soft, 1.0, elements, 1.0), bar(hard, hard.speed, elements)
    exact = soft.impedance * hard.impedance / (soft.impedance + hard.impedance)
    return two_boxes(low, up, 1.0 / elements, int(1.8 * elements)), exact


def _bars(what: str, ratio: float, bench: Bench) -> list[Measure]:
    scene, exact = bars(what, ratio)
    solution = bench.converged(scene)
    even = bench.converged(bars(what, 1.0)[0], counted=False)
    settled = pressure_force(solution)[20:50]
    step, end = solution.time[1], solution.time[-1]
    late = abs(impulse(solution) / exact - end) / step
    return [
        Measure("mean stress off by", abs(float(settled.mean()) / exact - 1), 1e-3),
        Measure("ripple after 20 steps", float(np.abs(settled / exact - 1).max()), 2e-2),
        Measure("delay in steps", late, 0.6),
        Measure("iterations over contrast 1", mean_iterations(solution) / mean_iterations(even), 3.0),
        *energy_laws(solution),
    ]


def blocks(what: str, ratio: float, friction: float, **solver: Any) -> Description:
    """Two cubes of 3 x 3 x 3 elements, one thrown askew on the other; the step follows the faster wave."""
    soft, hard = _stuffs(what, ratio, 0.3)
    step = 1.0 / 3.0 / max(soft.pressure_speed, hard.pressure_speed)
    return two_boxes(Box(soft, velocity=(0.3, 0.0, 1.0)), Box(hard), step, 40, friction, **solver)


def _blocks(what: str, ratio: float, friction: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(blocks(what, ratio, friction))
    exact = bench.converged(blocks(what, ratio, friction, **TIGHT), counted=False)
    even = bench.converged(blocks(what, 1.0, friction), counted=False)
    found, wanted = (s.interfaces["meet"].force() for s in (solution, exact))
    return [
        Measure("force off by", distance(found, wanted), 1e-2),
        Measure("passes over contrast 1", solution.passes / even.passes, 3.0),
        *laws(solution),
    ]


def _lengths(ratio: float, bench: Bench) -> list[Measure]:
    stuff, elements = Stuff(), 20
    short = bar(stuff, 1.0 / ratio, elements, 1.0)
    long = bar(stuff, 1.0, round(4 * ratio) if ratio > 10 else elements * round(ratio))
    step = 1.0 / ratio / elements
    solution = bench.converged(two_boxes(short, long, step, 3 * elements))
    left = pressure_force(solution)[int(2.5 * elements) :]
    measures = [Measure("impulse off by", abs(impulse(solution) * ratio - 1.0), 0.03)]
    if long.elements[2] >= elements * ratio:
        measures.append(Measure("stress left", float(np.abs(left).max()), 0.02))
    return measures + energy_laws(solution)


def _unresolved(bench: Bench) -> list[Measure]:
    solution = bench.converged(blocks("E", 1e6, 0.0))
    silent = not any("too coarse" in remark for remark in solution.warnings)
    return [Measure("runs without a warning", float(silent), 0.0)]
