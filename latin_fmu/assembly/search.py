"""Interfaces that [contact.NAME] tables ask for, found between the boundaries of the bodies."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ..errors import Problem, SceneError
from ..fem.common_part import common_cells
from ..fem.mesh import Array, nearest
from ..fem.surface import Surface
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.interfaces import Interface
from ..scene.schema import Scene
from .body import Body, build_bodies

_LEAST = 1e-3  # a common area below this share of a facet is a touch of edges, no interface


def completed(scene: Scene) -> Scene:
    """The scene with the interfaces that its contact tables find, as if they had been written by hand.

    Raises
    ------
    SceneError : meshes that cannot be read; bodies that overlap.
    """
    if not scene.contact:
        return scene
    problems: list[Problem] = []
    bodies = build_bodies(scene, problems)
    whole = scene if problems else with_found(scene, bodies, problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    return whole


def with_found(scene: Scene, bodies: dict[str, Body], problems: list[Problem]) -> Scene:
    """The same for bodies that stand already; overlaps deeper than a search go to ``problems``."""
    if not scene.contact:
        return scene
    by_hand = {frozenset(split_face(side)[0] for side in i.sides) for i in scene.interface.values()}
    surfaces = {name: body.surface(ALL_OF_IT) for name, body in bodies.items()}
    found: dict[str, Interface] = {}
    taken = set(by_hand)
    for name, table in scene.contact.items():
        names = [n for n in bodies if table.parts is None or n in table.parts]
        for first, second in _near_pairs(names, surfaces, table.search):
            pair = frozenset((first, second))
            if pair in taken or pair in table.exceptions:
                continue
            one, other = surfaces[first], surfaces[second]
            area, depth = _common(one, other, table.search)
            if area > _LEAST * min(one.facet_area, other.facet_area):
                taken.add(pair)
                free = _free_name(f"{first}_{second}", {*scene.interface, *found})
                found[free] = table.interface(first, second)
            elif depth > 0.0:
                problems.append(
                    Problem(
                        f"contact.{name}.search",
                        f"{first} and {second} overlap at the start by more than this",
                        f"{depth:.4g} m",
                        f"at most {table.search:g} m",
                        "move the meshes apart, or leave the pair out by except",
                    )
                )
    return scene.model_copy(update={"interface": {**scene.interface, **found}, "contact": {}})


def _near_pairs(names: list[str], surfaces: dict[str, Surface], search: float) -> list[tuple[str, str]]:
    """Pairs whose bounding boxes are nearer than ``search``."""
    boxes = {n: _box(surfaces[n]) for n in names}
    return [
        (a, b)
        for a, b in combinations(names, 2)
        if bool(((boxes[a][0] - search <= boxes[b][1]) & (boxes[b][0] - search <= boxes[a][1])).all())
    ]


def _box(surface: Surface) -> tuple[Array, Array]:
    places = surface.nodes[surface.facets.nodes]
    return places.min(axis=0), places.max(axis=0)


def _common(first: Surface, second: Surface, search: float) -> tuple[float, float]:
    """Area within ``search`` of each other, m2, and how far the faces overlap where that is up to twice as much, m."""
    cells = [c for row in common_cells(first, second, 2 * search) for c in row]
    area = sum(float(c.areas[np.abs(c.distance) <= search].sum()) for c in cells)
    deepest = max((-float(c.distance.min()) for c in cells if len(c)), default=0.0)
    return area, deepest if deepest > search else 0.0


def _free_name(wanted: str, taken: set[str]) -> str:
    number, name = 1, wanted[:96]
    while name in taken:
        number += 1
        name = f"{wanted[:96]}_{number}"
    return name


def lonely_remarks(scene: Scene, bodies: dict[str, Body]) -> list[str]:
    """Substructures without an interface, beside others that have some."""
    joined = {split_face(side)[0] for i in scene.interface.values() for side in i.sides if side != GROUND}
    if not joined:
        return []
    remarks = []
    for name in bodies:
        if name in joined:
            continue
        distance = {n: _distance(bodies[name], b) for n, b in bodies.items() if n != name}
        closest = min(distance, key=lambda n: distance[n])
        remarks.append(
            f"substructure {name} touches nothing: it has no interface; {closest} is the nearest, "
            f"{distance[closest]:.4g} m between nodes"
        )
    return remarks


def _distance(one: Body, other: Body) -> float:
    places = [body.mesh.nodes[body.outside.nodes] for body in (one, other)]
    found, _ = nearest(*places)
    return float(np.min(found))
