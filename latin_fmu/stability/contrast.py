"""What may not matter: contrasts of impedance and length, shapes and ties (slivers, symmetry, redundant and shared
interfaces), settings that may change the cost but not the result; and input that must be refused, every problem at
once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import inf, nan
from typing import Any, Final

import numpy as np

from ..errors import SceneError
from .case import (
    TIGHT,
    Bench,
    Case,
    Measure,
    against_round_off,
    distance,
    energy_laws,
    force_off,
    impulse,
    laws,
    make_case,
    mean_iterations,
    penetration_bound,
    pressure_force,
    resultant,
)
from .scenes import ALUMINIUM, STEEL, UNIT, Box, Description, Material, bar, column, press, rubbing, stack, two_boxes

RATIOS = (1.0, 10.0, 1e2, 1e4, 1e6)


def contrast_cases() -> Iterator[Case]:
    """Contrasts of stiffness and density for bars and blocks, of length, and a side the mesh does not resolve."""
    case = partial(make_case, "contrast")
    kinds = [(what, ratio) for what in ("E", "rho") for ratio in RATIOS]
    for what, ratio in kinds:
        yield case(f"bars, {what} ratio {ratio:g}", "stress Z1 Z2 v/(Z1+Z2), cost of contrast 1", _bars, what, ratio)
    expectation = "force of the same discrete problem at round-off, cost of contrast 1"
    for friction in (0.0, 0.3):
        for what, ratio in kinds:
            name = f"blocks, {what} ratio {ratio:g}, mu {friction:g}"
            yield case(name, expectation, _blocks, what, ratio, friction)
    for ratio in (1.0, 10.0, 100.0):
        name = f"bars, length ratio 1:{ratio:g}"
        yield case(name, "the short bar stops: impulse rho L v", _lengths, ratio, quick=ratio < 100)
    yield case("blocks, soft side not resolved", "converged is not accurate: warned", _unresolved)


def _materials(what: str, ratio: float, poisson: float = 0.0) -> tuple[Material, Material]:
    if what == "E":
        hard = Material(ratio, 1.0, poisson)
    else:
        hard = Material(1.0, ratio, poisson)
    return Material(1.0, 1.0, poisson), hard


def bars(what: str, ratio: float, elements: int = 30) -> tuple[Description, float]:
    """Two bars of equal transit, the first thrown on the second; the scene and the exact contact stress."""
    soft, hard = _materials(what, ratio)
    low, up = bar(soft, 1.0, elements, 1.0), bar(hard, hard.speed, elements)
    exact = soft.impedance * hard.impedance / (soft.impedance + hard.impedance)
    return two_boxes(low, up, 1.0 / elements, int(1.8 * elements)), exact


def _bars(what: str, ratio: float, bench: Bench) -> list[Measure]:
    scene, exact = bars(what, ratio)
    solution = bench.converged(scene)
    even = bench.converged(bars(what, 1.0)[0], counted=False)
    # of 54 steps: behind the ripple of the front; the wave comes back after 60
    settled = pressure_force(solution)[20:50]
    step, end = solution.time[1], solution.time[-1]
    late = abs(impulse(solution) / exact - end) / step
    return [
        Measure("mean stress off by", abs(float(settled.mean()) / exact - 1), 1e-3),
        Measure("ripple after 20 steps", float(np.abs(settled / exact - 1).max()), 6e-3),
        Measure("delay in steps", late, 0.6),
        Measure("iterations over contrast 1", mean_iterations(solution) / mean_iterations(even), 3.0),
        *energy_laws(solution),
    ]


def blocks(what: str, ratio: float, friction: float, **solver: Any) -> Description:
    """Two cubes of 3 x 3 x 3 elements, one thrown askew on the other; the step follows the faster wave."""
    soft, hard = _materials(what, ratio, 0.3)
    step = 1.0 / 3.0 / max(soft.pressure_speed, hard.pressure_speed)
    return two_boxes(Box(soft, velocity=(0.3, 0.0, 1.0)), Box(hard), step, 40, friction, **solver)


def _blocks(what: str, ratio: float, friction: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(blocks(what, ratio, friction))
    exact = bench.converged(blocks(what, ratio, friction, **TIGHT), counted=False)
    even = bench.converged(blocks(what, 1.0, friction), counted=False)
    return [
        force_off(solution, exact, 1e-2),
        Measure("passes over contrast 1", solution.passes / even.passes, 3.0),
        *laws(solution),
    ]


def _lengths(ratio: float, bench: Bench) -> list[Measure]:
    material, elements = Material(), 20
    short = bar(material, 1.0 / ratio, elements, 1.0)
    if ratio > 10:
        number = round(4 * ratio)
    else:
        number = elements * round(ratio)
    long = bar(material, 1.0, number)
    step = 1.0 / ratio / elements
    solution = bench.converged(two_boxes(short, long, step, 3 * elements))
    # the wave is back from the free end after two transits of the short bar
    rest = pressure_force(solution)[int(2.5 * elements) :]
    measures = [Measure("impulse off by", abs(impulse(solution) * ratio - 1.0), 0.03)]
    # elements of one length on both sides: else fronts are reflected at the coarser mesh
    if long.elements[2] >= elements * ratio:
        measures.append(Measure("stress left", float(np.abs(rest).max()), 0.0))
    return measures + energy_laws(solution)


def _unresolved(bench: Bench) -> list[Measure]:
    solution = bench.converged(blocks("E", 1e6, 0.0))
    silent = not any("too coarse" in remark for remark in solution.warnings)
    return [Measure("runs without a warning", float(silent), 0.0)]


def shape_cases() -> Iterator[Case]:
    """Slivers, near incompressibility, symmetry, redundant and shared interfaces, floating bodies, stacks."""
    case = partial(make_case, "shape")
    expectation = "force of the same discrete problem at round-off"
    for aspect in (10.0, 100.0, 1000.0):
        for shape in ("thin", "long", "flat"):
            yield case(f"{shape} elements, aspect {aspect:g}", expectation, _sliver, shape, aspect)
    for poisson in (-0.9, 0.45, 0.49, 0.499, 0.4999):
        expectation = "force of the problem at round-off; locking warned"
        yield case(f"Poisson's ratio {poisson:g}", expectation, _poisson, poisson)
    for mu in (0.0, 0.1, 0.3, 1.0, 10.0):
        yield case(f"planes of symmetry across the interface, mu {mu:g}", "quarter model = full model", _symmetry, mu)
    for mu in (0.0, 0.3):
        yield case(f"interface declared twice, mu {mu:g}", "total force that of one interface", _twice, mu)
        expectation = "corner nodes of three interfaces, floating blocks: laws kept, symmetry kept"
        yield case(f"eight blocks around a point, mu {mu:g}", expectation, _eight, mu)
    yield case("smallest interface: one element face", "stress of a wider bar", _smallest)
    for count in (16, 4):
        expectation = "converged, no flipping, separation of a tight run"
        yield case(f"stack of {count} blocks, gap 0", expectation, _stack, count, quick=count < 16)


def _sliver(shape: str, aspect: float, bench: Bench) -> list[Measure]:
    # thin along z, the way of the wave: the step follows the thickness
    size = {"thin": (1, 1, 1 / aspect), "long": (1, 1, aspect), "flat": (aspect, 1, 1)}[shape]
    if shape == "thin":
        step = 0.2 / aspect
    else:
        step = 0.2
    material = Material(1.0, 1.0, 0.3)
    scene = two_boxes(Box(material, size, velocity=(0.3, 0.0, 1.0)), Box(material, size), step, 30, 0.3)
    return against_round_off(bench, scene)


def _poisson(poisson: float, bench: Bench) -> list[Measure]:
    material = Material(1.0, 1.0, poisson)
    scene = two_boxes(Box(material, velocity=(0.3, 0.0, 1.0)), Box(material), 0.2, 30, 0.3)
    measures = against_round_off(bench, scene)
    if poisson > 0.45:
        silent = not any("lock" in w for w in bench.solve(scene, counted=False).warnings)
        measures.append(Measure("locking not warned", float(silent), 0))
    return measures


def _symmetry(friction: float, bench: Bench) -> list[Measure]:
    tight: dict[str, Any] = {"tolerance": 1e-10, "max_iterations": 3000}
    quarter = bench.converged(press(friction, 2, 60, **tight)).interfaces["meet"]
    full = bench.converged(press(friction, 2, 60, quarter=False, **tight), counted=False).interfaces["meet"]
    # the points of the quarter are among those of the full model
    apart = np.linalg.norm(full.points[None] - quarter.points[:, None], axis=2)
    same = apart.argmin(axis=1)
    assert full.gap is not None
    assert quarter.gap is not None
    return [
        Measure("traction differs by", distance(quarter.traction, full.traction[:, same]), 1.5e-9),
        Measure("gap differs by", distance(quarter.gap, full.gap[:, same]), 2e-10),
    ]


def _twice(friction: float, bench: Bench) -> list[Measure]:
    materials = Material(1.0, 1.0, 0.3), Material(3.0, 2.0, 0.3)
    scene = two_boxes(Box(materials[0], velocity=(0.3, 0.0, 1.0)), Box(materials[1]), 0.2, 30, friction, **TIGHT)
    once = bench.converged(scene, counted=False)
    scene["interface"]["again"] = dict(scene["interface"]["meet"])
    twice = bench.converged(scene)
    total = resultant(twice) + resultant(twice, "again")
    silent = not any("meet" in w and "again" in w for w in twice.warnings)
    return [
        Measure("total force differs by", distance(total, resultant(once)), 1e-8),
        Measure("not warned", float(silent), 0),
        *energy_laws(twice),
    ]


def _eight(friction: float, bench: Bench) -> list[Measure]:
    scene = column({"b000": Box(Material(poisson=0.3))}, {}, {"end": 6.0, "instants": 30}, output={"energy": True})
    for place in np.ndindex(2, 2, 2):
        i, j, k = place
        block = Box(elements=(2, 2, 2), velocity=(0.3 - 0.6 * i, 0.2 - 0.4 * j, 1.0 - 2.0 * k))
        scene["substructure"][f"b{i}{j}{k}"] = block.table(tuple(map(float, place)))
        for axis, name in enumerate("xyz"):
            # a block below 1 on an axis has the one above it as neighbour
            if place[axis] == 0:
                other = "".join("1" if n == axis else str(c) for n, c in enumerate(place))
                faces = f"b{i}{j}{k}.{name}max", f"b{other}.{name}min"
                scene["interface"][f"{name}{i}{j}{k}"] = rubbing(*faces, friction)
    solution = bench.converged(scene)
    # the velocities differ in sign alone: eight equal blocks meet in four equal pairs along z
    vertical = [pressure_force(solution, n) for n in solution.interfaces if n.startswith("z")]
    return [
        Measure("the four equal forces differ by", max(distance(f, vertical[0]) for f in vertical), 1.4e-13),
        *laws(solution),
    ]


def _smallest(bench: Bench) -> list[Measure]:
    material = Material()
    wide = Box(material, UNIT, (4, 4, 20), (0.0, 0.0, 1.0)), Box(material, UNIT, (4, 4, 20))
    thin = bar(material, 1.0, 20, 1.0), bar(material, 1.0, 20)
    narrow, broad = (two_boxes(*pair, 0.05, 40, **TIGHT) for pair in (thin, wide))
    for scene in (narrow, broad):
        scene["time"]["scheme"] = "hht"  # its mass does not depend on the width of the elements
    one, many = bench.converged(narrow), bench.converged(broad, counted=False)
    return [Measure("force differs by", distance(pressure_force(one), pressure_force(many)), 1.8e-8)]


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
            # stick and slip are one: a change between them opens nothing
            touching = (status > 0).astype(int)
            flips = max(flips, int(np.abs(np.diff(touching, axis=0)).sum(axis=0).max()))
        apart = max(apart, abs(float(ends[0] - ends[1])))
    off, missing = (0.0, 0.0)  # the worst instant is a separation, shifted within the tolerance: 3 % of the peak
    for name in solution.interfaces:
        force, reference = (resultant(run, name) for run in (solution, exact))
        off = max(off, float(np.linalg.norm(force - reference) / np.linalg.norm(reference)))
        missing = max(missing, abs(impulse(solution, name) / impulse(exact, name) - 1))
    return [
        Measure("force history of the worst interface off by (L2)", off, 3e-2),
        Measure("impulse off by (twice the force tolerance allowed)", missing, 7e-3),
        Measure("last contact off by steps", apart, 0),
        Measure("changes of state of a point", flips, 16),
        *laws(solution),
    ]


# -- settings and bad input ------------------------------------------------------------------------------------------
# (mass, length, time) units: how many of them make one kg, m, s
UNITS: Final = {
    "mm-t-s": (1e-3, 1e3, 1.0),
    "km": (1.0, 1e-3, 1.0),
    "nano (ug, nm, ns)": (1e9, 1e9, 1e9),
    "g-mm-us": (1e3, 1e3, 1e6),
    "E 1e-9 of SI": (1e-9, 1.0, 1.0),
    "E 1e15 of SI": (1e3, 1e-6, 1e-3),
}


def setting_cases() -> Iterator[Case]:
    """Search directions, windows, units and steps that must not change the result."""
    case = partial(make_case, "settings")
    for kind in ("automatic", "impedance"):
        for factor in (1e-2, 0.1, 10.0, 1e2):
            yield case(f"k {kind} x {factor:g}", "the result of k x 1", _direction, kind, factor)
    for window in (2, 5, 10, "whole"):
        for ratio in (1.0, 1e4):
            name = f"windows of {window}, E ratio {ratio:g}"
            yield case(name, "the result of one-step windows", _window, window, ratio)
    for name, units in UNITS.items():
        yield case(f"units {name}", "SI after scaling, same iterations", _units, units)
    for transits in (1e-6, 1e-3, 1.0, 1e2, 1e4):
        expectation = "converged, laws kept, penetration bounded"
        yield case(f"step of {transits:g} transits", expectation, _step, transits)


def _scene(ratio: float = 3.0, step: float = 0.2, **solver: Any) -> Description:
    low, up = Material(1.0, 1.0, 0.3), Material(ratio, 2.0 if ratio == 3.0 else 1.0, 0.3)
    return two_boxes(Box(low, velocity=(0.3, 0.1, 1.0)), Box(up), step, 30, 0.3, **solver)


def _direction(kind: str, factor: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(_scene(search_direction={"type": kind, "factor": factor}, tolerance=1e-4))
    reference = bench.converged(_scene(tolerance=1e-8, max_iterations=3000), counted=False)
    return [force_off(solution, reference, 2e-3), *laws(solution)]


def _window(window: int | str, ratio: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(_scene(ratio, window=window, tolerance=1e-4, max_iterations=1000))
    reference = bench.converged(_scene(ratio, tolerance=1e-8, max_iterations=3000), counted=False)
    return [force_off(solution, reference, 8e-5)]


def _crush(mass: float, length: float, time: float) -> Description:
    """Oblique impact of two 10 mm blocks over a gap of 1 um, in given units."""
    # Pa = kg m-1 s-2
    pressure, weight = mass / length / time**2, mass / length**3
    size = (0.01 * length,) * 3
    low, up = (Material(s.young * pressure, s.density * weight, s.poisson) for s in (ALUMINIUM, STEEL))
    velocity = (3.0 * length / time, 0.0, 10.0 * length / time)
    return two_boxes(Box(low, size, velocity=velocity), Box(up, size), 2e-7 * time, 60, 0.3, 1e-6 * length)


def _units(units: tuple[float, float, float], bench: Bench) -> list[Measure]:
    mass, length, time = units
    scaled, si = bench.converged(_crush(*units)), bench.converged(_crush(1.0, 1.0, 1.0), counted=False)
    force = resultant(scaled) / (mass * length / time**2)
    counts = [[w.iterations for w in s.windows] for s in (scaled, si)]
    differing = sum(a != b for a, b in zip(*counts, strict=True))
    return [
        Measure("force differs by", distance(force, resultant(si)), 1e-11),
        Measure("windows with other iterations", differing, 0),
    ]


def _step(transits: float, bench: Bench) -> list[Measure]:
    """Round-off of the elastic energy grows with the square of the rigid travel: 3e-12 of it is allowed."""
    solution = bench.converged(_scene(step=transits))
    round_off = 1e-9 + 3e-12 * transits**2
    return [Measure("penetration over its bound", penetration_bound(solution), 1.0), *laws(solution, round_off)]


# name of the damage: key of the scene of ``press``, its value, place that the message must name where another one
DAMAGES: Final[dict[str, tuple[str, Any, str]]] = {
    "load that is not a number": ("load.press.pressure", nan, ""),
    "infinite load": ("load.press.pressure", inf, ""),
    "table with a value that is not a number": (
        "load.press.law",
        {"type": "table", "times": [0.0, 1.0], "values": [0.0, nan]},
        "",
    ),
    "density 0": ("material.first.density", 0.0, ""),
    "Poisson's ratio 0.5": ("material.first.poisson_ratio", 0.5, ""),
    "unknown face": ("interface.meet.sides", ["low.top", "up.zmin"], ""),
    "no elements": ("substructure.low.box.elements", [3, 0, 3], ""),
    "faces with nothing in common": ("substructure.low.box.origin", [0.03, 0.0, 0.0], "interface.meet.sides"),
    "faces turned away from each other": ("interface.meet.sides", ["low.zmin", "up.zmin"], ""),
}


def bad_input_cases() -> Iterator[Case]:
    """One case per kind of mistake, and one with all that can be found at once."""
    case = partial(make_case, "bad input")
    for name, (key, value, place) in DAMAGES.items():
        yield case(name, "refused before solving, place named", _refused, key, value, place or key)
    yield case("five mistakes", "all problems in one message", _all_at_once)


def changed(scene: Description, key: str, value: Any) -> Description:
    """The scene with another value at a dotted key."""
    *holders, last = key.split(".")
    table = scene
    for holder in holders:
        table = table[holder]
    table[last] = value
    return scene


def _refused(key: str, value: Any, place: str, bench: Bench) -> list[Measure]:
    try:
        bench.solve(changed(press(0.3), key, value))
    except SceneError as error:
        return [Measure("place not named", float(place not in str(error)), 0)]
    return [Measure("solved without an error", 1.0, 0)]


def _all_at_once(bench: Bench) -> list[Measure]:
    scene = press(0.3)
    for name in ("load that is not a number", "density 0", "no elements"):
        changed(scene, *DAMAGES[name][:2])
    changed(scene, "material.second.young_modulus", -1.0)
    changed(scene, "time.end", 0.0)
    try:
        bench.solve(scene)
    except SceneError as error:
        return [Measure("problems not in the message", 5 - len(error.problems), 0)]
    return [Measure("solved without an error", 1.0, 0)]
