"""Layers, dashpots and springs that a rigid rotation would strain.

A joint acts at one point of each side, x on E and x' on E'. In a rigid rotation w both sides move apart by

    w x s,    s = x' - x

which strains the joint along its directions d by w . (s x d), and its two forces make a couple s x F that nothing
takes: a free assembly would gain or lose angular momentum. Along the line of its ends (d parallel to s) neither is so,
nor where both forces act at one point (s = 0). It does not matter where supports keep everything that is joined to both
sides from turning that way: then the joint measures a displacement across a fixed line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.body import Body, body_sides
from ..assembly.conditions import Conditions
from ..errors import Problem
from ..fem.elements import rigid_modes
from ..fem.mesh import Array
from ..latin.assembly import InterfaceUnit
from ..scene.fields import split_face
from ..scene.schema import Scene

_ALONG: Final = ("normal_stiffness", "normal_viscosity")
_THICK: Final = 1e-3  # of the size of the smaller body; bonded faces have to be as close


def rotation_problems(
    scene: Scene, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: Sequence[InterfaceUnit]
) -> Iterator[Problem]:
    """A problem for every joint between two bodies that a rigid rotation strains, where such a rotation is free."""
    thick = [unit for unit in units if _lever(bodies, unit) > _limit(bodies, unit)]
    if not thick:
        return
    parts = _joined(list(bodies), units)
    motions: dict[int, dict[str, Array]] = {}
    for unit in thick:
        part = parts[split_face(unit.sides[0])[0]]
        if part not in motions:
            members = {name: bodies[name] for name in bodies if parts[name] == part}
            motions[part] = _free_motions(members, conditions, units)
        # squares over the free motions: whichever basis of them was found
        strained = np.linalg.norm(_relative(unit, motions[part]), axis=1)
        if strained.max(initial=0.0) > _limit(bodies, unit):
            yield _problem(scene, unit, _lever(bodies, unit))


def _limit(bodies: Mapping[str, Body], unit: InterfaceUnit) -> float:
    return _THICK * min(bodies[name].mesh.size for _, _, name in body_sides([unit]))


def _lever(bodies: Mapping[str, Body], unit: InterfaceUnit) -> float:
    """Largest relative motion of the sides in a rotation of 1 rad about an axis, m; 0 for what may open, whose sides
    are brought together by motion, and for joints to the ground, which does not turn."""
    if unit.behaviour.opens or unit.against_ground:
        return 0.0
    names = {name for _, _, name in body_sides([unit])}
    turns = {name: rigid_modes(bodies[name].mesh.nodes, np.zeros(3), 1.0)[:, 3:] for name in names}
    return float(np.abs(_relative(unit, turns)).max(initial=0.0))


def _relative(unit: InterfaceUnit, motions: Mapping[str, Array]) -> Array:
    """Relative motions along the directions in which a joint acts, (n_channel, n), in motions (3 n_node, n) of the
    bodies."""
    n = unit.behaviour.n_component
    relative: Array = np.zeros((unit.geometry.n_point * n, next(iter(motions.values())).shape[1]))
    for _, side, name in body_sides([unit]):
        trace = unit.geometry.local_trace(side, n)
        if trace is not None:
            relative += (2 * side - 1) * (trace @ motions[name])
    if any(getattr(unit.behaviour, key, 1.0) == 0.0 for key in _ALONG):  # a lateral spring alone
        relative.reshape(-1, n, relative.shape[1])[:, 0] = 0.0
    return relative


def _joined(names: list[str], units: Sequence[InterfaceUnit]) -> dict[str, int]:
    """Number of the part of the assembly that each body belongs to: bodies that are bonded, or touch at the start."""
    number = {name: i for i, name in enumerate(names)}
    pairs = [
        [number[split_face(side)[0]] for side in unit.sides]
        for unit in units
        if not unit.against_ground and (not unit.behaviour.opens or unit.geometry.gap.min(initial=0.0) <= 0.0)
    ]
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    graph = sp.coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(len(names),) * 2)
    labels = connected_components(graph, directed=False)[1]
    return dict(zip(names, labels.tolist(), strict=True))


def _free_motions(
    bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: Sequence[InterfaceUnit]
) -> dict[str, Array]:
    """Rigid motions (3 n_node, n) of bodies as one, which neither their conditions nor joints to the ground hinder;
    rotations of 1 rad."""
    from ..statics.free_bodies import HELD, allowed_motions

    centre = np.mean([body.mesh.nodes.mean(axis=0) for body in bodies.values()], axis=0)
    size = max(float(np.abs(body.mesh.nodes - centre).max()) for body in bodies.values())
    modes = {name: rigid_modes(body.mesh.nodes, centre, size) for name, body in bodies.items()}
    squares = np.zeros((6, 6))
    for name, body in bodies.items():
        allowed = allowed_motions(body, conditions[name])
        hindered = modes[name]
        if allowed.shape[1]:
            hindered = modes[name] - allowed @ la.lstsq(allowed, modes[name])[0]
        squares += hindered.T @ hindered / len(hindered)
    for unit in units:
        if unit.against_ground and not unit.behaviour.opens and split_face(unit.sides[0])[0] in bodies:
            relative = _relative(unit, modes)
            squares += relative.T @ relative / max(len(relative), 1)
    values, vectors = la.eigh(squares)
    free = vectors[:, values < HELD]
    return {name: mode @ free * size for name, mode in modes.items()}


def _problem(scene: Scene, unit: InterfaceUnit, lever: float) -> Problem:
    length = scene.unit_system["m"]
    name = next((n for n, spring in scene.spring.items() if unit.name in spring.interfaces(n)), None)
    if name is not None:
        return Problem(
            f"spring.{name}",
            "acts across the line that joins its ends: turned with its bodies as one it would be strained, and its two "
            "forces make a couple that nothing takes",
            f"{lever:.4g} {length} between the lines of its forces",
            "a direction along the line of the ends, or both ends at one point",
            "leave direction and lateral keys out, or give both ends the same point: "
            '{face = "body.face", point = [...]}, which a rigid arm joins to the face',
        )
    return Problem(
        f"interface.{unit.name}",
        "its faces are apart: turned with its bodies as one the layer would be strained, and its tractions make a "
        "couple that nothing takes",
        f"{lever:.4g} {length}",
        "faces that touch, or bodies that supports keep from turning",
        "move the meshes together, mesh the layer as a body, or use springs with both ends at one point",
    )
