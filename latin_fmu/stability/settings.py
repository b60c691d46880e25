"""Settings that may change the cost but not the result, and input that must be refused, every problem at once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import inf, nan
from typing import Any, Final

from ..errors import SceneError
from .case import Bench, Case, Measure, distance, laws, make_case, penetration_bound
from .scenes import ALUMINIUM, STEEL, Box, Description, Material, press, two_boxes

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
    forces = (s.interfaces["meet"].force() for s in (solution, reference))
    return [Measure("force off by", distance(*forces), 2e-3), *laws(solution)]


def _window(window: int | str, ratio: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(_scene(ratio, window=window, tolerance=1e-4, max_iterations=1000))
    reference = bench.converged(_scene(ratio, tolerance=1e-8, max_iterations=3000), counted=False)
    forces = (s.interfaces["meet"].force() for s in (solution, reference))
    return [Measure("force off by", distance(*forces), 5e-3)]


def _crush(mass: float, length: float, time: float) -> Description:
    """Oblique impact of two 10 mm blocks over a gap of 1 um, in given units."""
    pressure, weight = mass / length / time**2, mass / length**3
    size = (0.01 * length,) * 3
    low, up = (Material(s.young * pressure, s.density * weight, s.poisson) for s in (ALUMINIUM, STEEL))
    velocity = (3.0 * length / time, 0.0, 10.0 * length / time)
    return two_boxes(Box(low, size, velocity=velocity), Box(up, size), 2e-7 * time, 60, 0.3, 1e-6 * length)


def _units(units: tuple[float, float, float], bench: Bench) -> list[Measure]:
    mass, length, time = units
    scaled, si = bench.converged(_crush(*units)), bench.converged(_crush(1.0, 1.0, 1.0), counted=False)
    force = scaled.interfaces["meet"].force() / (mass * length / time**2)
    counts = [[w.iterations for w in s.windows] for s in (scaled, si)]
    differing = sum(a != b for a, b in zip(*counts, strict=True))
    return [
        Measure("force differs by", distance(force, si.interfaces["meet"].force()), 1e-11),
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
