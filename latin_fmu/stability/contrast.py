"""Contrasts of impedance and length, shapes and ties: slivers, symmetry, redundant and shared interfaces."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from .case import (
    TIGHT,
    Bench,
    Case,
    Description,
    Measure,
    distance,
    energy_laws,
    impulse,
    laws,
    mean_iterations,
    pressure_force,
)
from .scenes import UNIT, Box, Stuff, bar, press, stack, two_boxes

RATIOS = (1.0, 10.0, 1e2, 1e4, 1e6)


def contrast_cases() -> Iterator[Case]:
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


def shape_cases() -> Iterator[Case]:
    """See the module docstring."""
    for aspect in (10.0, 100.0, 1000.0):
        for shape in ("thin", "long", "flat"):
            yield Case(
                f"{shape} elements, aspect {aspect:g}",
                "shape",
                "force of the same discrete problem at round-off",
                partial(_sliver, shape, aspect),
            )
    for poisson in (-0.9, 0.45, 0.49, 0.499, 0.4999):
        yield Case(
            f"Poisson's ratio {poisson:g}",
            "shape",
            "force of the problem at round-off; locking warned",
            partial(_poisson, poisson),
        )
    for friction in (0.0, 0.1, 0.3, 1.0, 10.0):
        yield Case(
            f"planes of symmetry across the interface, mu {friction:g}",
            "shape",
            "quarter model = full model",
            partial(_symmetry, friction),
        )
    for friction in (0.0, 0.3):
        yield Case(
            f"interface declared twice, mu {friction:g}",
            "shape",
            "total force that of one interface",
            partial(_twice, friction),
        )
        yield Case(
            f"eight blocks around a point, mu {friction:g}",
            "shape",
            "corner nodes of three interfaces, floating blocks: laws kept, symmetry kept",
            partial(_eight, friction),
        )
    yield Case("smallest interface: one element face", "shape", "stress of a wider bar", _smallest)
    yield Case(
        "stack of 16 blocks, gap 0",
        "shape",
        "converged, no flipping, separation of a tight run",
        partial(_stack, 16),
        quick=False,
    )
    yield Case(
        "stack of 4 blocks, gap 0", "shape", "converged, no flipping, separation of a tight run", partial(_stack, 4)
    )


def _against_tight(bench: Bench, scene: Description, limit: float = 1e-2) -> list[Measure]:
    solution = bench.converged(scene)
    exact = bench.converged(scene | {"solver": dict(TIGHT)}, counted=False)
    found, wanted = (s.interfaces["meet"].force() for s in (solution, exact))
    return [Measure("force off by", distance(found, wanted), limit), *laws(solution)]


def _sliver(shape: str, aspect: float, bench: Bench) -> list[Measure]:
    size = {"thin": (1, 1, 1 / aspect), "long": (1, 1, aspect), "flat": (aspect, 1, 1)}[shape]
    step = 0.2 / aspect if shape == "thin" else 0.2
    stuff = Stuff(1.0, 1.0, 0.3)
    scene = two_boxes(Box(stuff, size, velocity=(0.3, 0.0, 1.0)), Box(stuff, size), step, 30, 0.3)
    return _against_tight(bench, scene)


def _poisson(poisson: float, bench: Bench) -> list[Measure]:
    stuff = Stuff(1.0, 1.0, poisson)
    scene = two_boxes(Box(stuff, velocity=(0.3, 0.0, 1.0)), Box(stuff), 0.2, 30, 0.3)
    measures = _against_tight(bench, scene)
    if poisson > 0.45:
        silent = not any("lock" in w for w in bench.solve(scene, counted=False).warnings)
        measures.append(Measure("locking not warned", float(silent), 0))
    return measures


def _symmetry(friction: float, bench: Bench) -> list[Measure]:
    tight: dict[str, Any] = {"tolerance": 1e-10, "max_iterations": 3000}
    quarter = bench.converged(press(friction, 2, 60, **tight)).interfaces["meet"]
    full = bench.converged(press(friction, 2, 60, quarter=False, **tight), counted=False).interfaces["meet"]
    apart = np.linalg.norm(full.points[None] - quarter.points[:, None], axis=2)
    same = apart.argmin(axis=1)
    assert full.gap is not None
    assert quarter.gap is not None
    return [
        Measure("traction differs by", distance(quarter.traction, full.traction[:, same]), 1e-8),
        Measure("gap differs by", distance(quarter.gap, full.gap[:, same]), 1e-8),
    ]


def _twice(friction: float, bench: Bench) -> list[Measure]:
    stuffs = Stuff(1.0, 1.0, 0.3), Stuff(3.0, 2.0, 0.3)
    scene = two_boxes(Box(stuffs[0], velocity=(0.3, 0.0, 1.0)), Box(stuffs[1]), 0.2, 30, friction, **TIGHT)
    once = bench.converged(scene, counted=False)
    scene["interface"]["again"] = dict(scene["interface"]["meet"])
    twice = bench.converged(scene)
    total = twice.interfaces["meet"].force() + twice.interfaces["again"].force()
    silent = not any("meet" in w and "again" in w for w in twice.warnings)
    return [
        Measure("total force differs by", distance(total, once.interfaces["meet"].force()), 1e-8),
        Measure("not warned", float(silent), 0),
        *energy_laws(twice),
    ]


def _eight(friction: float, bench: Bench) -> list[Measure]:
    scene = two_boxes(Box(), Box(), 0.2, 30)
    scene["substructure"], scene["interface"] = {}, {}
    stuff = Stuff(1.0, 1.0, 0.3)
    scene["material"] = {"rubber": stuff.table()}
    for i, j, k in np.ndindex(2, 2, 2):
        velocity = (0.3 - 0.6 * i, 0.2 - 0.4 * j, 1.0 - 2.0 * k)
        block = Box(stuff, UNIT, (2, 2, 2), velocity)
        scene["substructure"][f"b{i}{j}{k}"] = block.table("rubber", (float(i), float(j), float(k)))
        for axis, name in enumerate("xyz"):
            if (i, j, k)[axis] == 0:
                other = [i, j, k]
                other[axis] = 1
                sides = [f"b{i}{j}{k}.{name}max", f"b{other[0]}{other[1]}{other[2]}.{name}min"]
                scene["interface"][f"{name}{i}{j}{k}"] = {"sides": sides, "friction_coefficient": friction}
    solution = bench.converged(scene)
    vertical = [pressure_force(solution, n) for n in solution.interfaces if n.startswith("z")]
    return [
        Measure("the four equal forces differ by", max(distance(f, vertical[0]) for f in vertical), 1e-2),
        *laws(solution),
    ]


def _smallest(bench: Bench) -> list[Measure]:
    stuff = Stuff()
    wide = Box(stuff, UNIT, (4, 4, 20), (0.0, 0.0, 1.0)), Box(stuff, UNIT, (4, 4, 20))
    one = bench.converged(two_boxes(bar(stuff, 1.0, 20, 1.0), bar(stuff, 1.0, 20), 0.05, 40, **TIGHT))
    many = bench.converged(two_boxes(*wide, 0.05, 40, **TIGHT), counted=False)
    return [Measure("force differs by", distance(pressure_force(one), pressure_force(many)), 1e-7)]


def _stack(count: int, bench: Bench) -> list[Measure]:
    solution = bench.converged(stack(count, 0.3))
    exact = bench.converged(stack(count, 0.3, **TIGHT), counted=False)
    apart, flips = 0.0, 0
    for name in solution.interfaces:
        ends = []
        for run in (solution, exact):
            force = pressure_force(run, name)
            ends.append(np.flatnonzero(force > 0.01 * force.max())[-1])
            status = run.interfaces[name].contact_status
            assert status is not None
            touching = (status > 0).astype(int)
            flips = max(flips, int(np.abs(np.diff(touching, axis=0)).sum(axis=0).max()))
        apart = max(apart, abs(float(ends[0] - ends[1])))
    off, missing = (0.0, 0.0)  # the worst instant is a separation, shifted within the tolerance: 3 % of the peak
    for name in solution.interfaces:
        found, wanted = (run.interfaces[name].force() for run in (solution, exact))
        off = max(off, float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted)))
        missing = max(missing, abs(impulse(solution, name) / impulse(exact, name) - 1))
    return [
        Measure("force history of the worst interface off by (L2)", off, 3e-2),
        Measure("impulse off by (twice the force tolerance allowed)", missing, 2e-2),
        Measure("last contact off by steps", apart, 2),
        Measure("changes of state of a point", flips, 16),
        *laws(solution),
    ]
