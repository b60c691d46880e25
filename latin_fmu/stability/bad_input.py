"""Input that must be refused before solving, every problem at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import inf, nan
from typing import Final

from ..errors import SceneError
from .case import Bench, Case, Description, Measure
from .scenes import press

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


def cases() -> Iterator[Case]:
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
