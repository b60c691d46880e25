"""Settings that must change the cost and never the answer, and input that must be refused, every problem at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import inf, nan
from typing import Any, Final

from ..errors import SceneError
from .case import Bench, Case, Description, Measure, distance, laws, penetration_bound
from .scenes import ALUMINIUM, STEEL, Box, Stuff, press, two_boxes

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
    """See the module docstring."""
    for kind in ("automatic", "impedance"):
        for factor in (1e-2, 0.1, 10.0, 1e2):
            yield Case(f"k {kind} x {factor:g}", "settings", "the answer of k x 1", partial(_direction, kind, factor))
    for window in (2, 5, 10, "whole"):
        for ratio in (1.0, 1e4):
            yield Case(
                f"windows of {window}, E ratio {ratio:g}",
                "settings",
                "the answer of one-step windows",
                partial(_window, window, ratio),
            )
    for name, units in UNITS.items():
        yield Case(f"units {name}", "settings", "SI after scaling, same iterations", partial(_units, units))
    for transits in (1e-6, 1e-3, 1.0, 1e2, 1e4):
        yield Case(
            f"step of {transits:g} transits",
            "settings",
            "converged, laws kept, penetration bounded",
            partial(_step, transits),
        )


def _scene(ratio: float = 3.0, step: float = 0.2, **solver: Any) -> Description:
    low, up = Stuff(1.0, 1.0, 0.3), Stuff(ratio, 2.0 if ratio == 3.0 else 1.0, 0.3)
    return two_boxes(Box(low, velocity=(0.3, 0.1, 1.0)), Box(up), step, 30, 0.3, **solver)


def _direction(kind: str, factor: float, bench: Bench) -> list[Measure]:
    found = bench.converged(_scene(search_direction={"type": kind, "factor": factor}, tolerance=1e-4))
    wanted = bench.converged(_scene(tolerance=1e-8, max_iterations=3000), counted=False)
    forces = (s.interfaces["meet"].force() for s in (found, wanted))
    return [Measure("force off by", distance(*forces), 2e-3), *laws(found)]


def _window(window: int | str, ratio: float, bench: Bench) -> list[Measure]:
    found = bench.converged(_scene(ratio, window=window, tolerance=1e-4, max_iterations=1000))
    wanted = bench.converged(_scene(ratio, tolerance=1e-8, max_iterations=3000), counted=False)
    forces = (s.interfaces["meet"].force() for s in (found, wanted))
    return [Measure("force off by", distance(*forces), 5e-3)]


def _crush(mass: float, length: float, time: float) -> Description:
    """Oblique impact of two 10 mm blocks over a gap of 1 um, in given units."""
    pressure, weight = mass / length / time**2, mass / length**3
    size = (0.01 * length,) * 3
    low, up = (Stuff(s.young * pressure, s.density * weight, s.poisson) for s in (ALUMINIUM, STEEL))
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


Damage = Callable[[Description], None]


def _nan_load(scene: Description) -> None:
    scene["load"]["press"]["pressure"] = nan


def _infinite_load(scene: Description) -> None:
    scene["load"]["press"]["pressure"] = inf


def _nan_law(scene: Description) -> None:
    scene["load"]["press"]["law"] = {"type": "table", "times": [0.0, 1.0], "values": [0.0, nan]}


def _no_density(scene: Description) -> None:
    scene["material"]["first"]["density"] = 0.0


def _incompressible(scene: Description) -> None:
    scene["material"]["first"]["poisson_ratio"] = 0.5


def _unknown_face(scene: Description) -> None:
    scene["interface"]["meet"]["sides"][0] = "low.top"


def _no_elements(scene: Description) -> None:
    scene["substructure"]["low"]["box"]["elements"] = [3, 0, 3]


def _nothing_in_common(scene: Description) -> None:
    box = scene["substructure"]["low"]["box"]
    box["origin"] = [box["origin"][0] + 3 * box["size"][0], *box["origin"][1:]]


def _facing_away(scene: Description) -> None:
    scene["interface"]["meet"]["sides"] = ["low.zmin", "up.zmin"]


DAMAGES: Final[dict[str, tuple[Damage, str]]] = {
    "load that is not a number": (_nan_load, "load.press.pressure"),
    "infinite load": (_infinite_load, "load.press.pressure"),
    "table with a value that is not a number": (_nan_law, "load.press.law"),
    "density 0": (_no_density, "material.first.density"),
    "Poisson's ratio 0.5": (_incompressible, "material.first.poisson_ratio"),
    "unknown face": (_unknown_face, "interface.meet.sides"),
    "no elements": (_no_elements, "substructure.low.box.elements"),
    "faces with nothing in common": (_nothing_in_common, "interface.meet.sides"),
    "faces that look away": (_facing_away, "interface.meet.sides"),
}


def bad_input_cases() -> Iterator[Case]:
    """One case per damage, and all that the reader can see at once."""
    for name in DAMAGES:
        yield Case(name, "bad input", "refused before solving, place named", partial(_refused, name))
    yield Case("five mistakes", "bad input", "all told at once", _all_at_once)


def _refused(name: str, bench: Bench) -> list[Measure]:
    damage, place = DAMAGES[name]
    scene = press(0.3)
    damage(scene)
    try:
        bench.solve(scene)
    except SceneError as error:
        return [Measure("place not named", float(place not in str(error)), 0)]
    return [Measure("solved in silence", 1.0, 0)]


def _all_at_once(bench: Bench) -> list[Measure]:
    scene = press(0.3)
    for damage in (_nan_load, _no_density, _no_elements):
        damage(scene)
    scene["material"]["second"]["young_modulus"] = -1.0
    scene["time"]["end"] = 0.0
    try:
        bench.solve(scene)
    except SceneError as error:
        return [Measure("problems not told", 5 - len(error.problems), 0)]
    return [Measure("solved in silence", 1.0, 0)]
