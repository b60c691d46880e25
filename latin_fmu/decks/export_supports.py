"""Supports and prescribed motions of a scene as cards: sets of nodes by the names of the boundaries, axes, values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Final

import numpy as np

from ..fem.mesh import Array, Index
from ..scene.boundaries import AXES, Boundary, Driven, Fixed, PrescribedDisplacement, PrescribedVelocity, Symmetry
from ..scene.fields import LocalAxes, split_face
from ..scene.laws import InputLaw, sampled
from .card_text import card
from .export_draft import DeckDraft

_ALONG: Final = 1e-9  # sine of the angle to an axis of what is along it


@dataclass(frozen=True)
class DrivenSet:
    """A motion of a set of nodes.

    Attributes
    ----------
    name : of its amplitude. nodes : set. degrees : components, from 1, and the displacement of each where the
    amplitude is 1, m. times, values : (n,) of the amplitude. before : its value before t = 0.
    """

    name: str
    nodes: str
    degrees: tuple[tuple[int, float], ...]
    times: Array
    values: Array
    before: float


def support_cards(deck: DeckDraft, moved_later: bool) -> Iterator[str]:
    """Sets of nodes, axes, and what is held; ``moved_later`` : whether driven nodes are held in steps before."""
    for name, boundary in deck.scene.boundary.items():
        if isinstance(boundary, Fixed | Symmetry | Driven):
            body, face = split_face(boundary.face)
            if body in deck.ready.bodies:
                nodes = deck.ready.bodies[body].nodes_of(face)
                deck.boundary_sets[name], lines = deck.node_set(name, body, nodes)
                yield from lines
        else:
            deck.refuse(f"boundary.{name}", "no card holds nodes so", boundary.type)
    yield from _transforms(deck)
    rows = [
        (deck.boundary_sets[name], degree, degree)
        for name, boundary in deck.scene.boundary.items()
        if name in deck.boundary_sets and (moved_later or not isinstance(boundary, Driven))
        for degree in _degrees(deck, boundary)
    ]
    if rows:
        yield from card("BOUNDARY", rows=rows)
    for name, boundary in deck.scene.boundary.items():
        if name in deck.boundary_sets and not isinstance(boundary, Driven):
            deck.used(f"boundary.{name}", f"*BOUNDARY {deck.boundary_sets[name]}")


def _degrees(deck: DeckDraft, boundary: Boundary) -> list[int]:
    """Degrees of freedom that a boundary holds or moves."""
    if isinstance(boundary, Symmetry):
        return [1 + (_axis_of(_normal(deck, boundary)) or 0)]
    assert isinstance(boundary, Fixed | Driven)
    return [1 + AXES.index(axis) for axis in boundary.components]


def _transforms(deck: DeckDraft) -> Iterator[str]:
    """*TRANSFORM of the sets whose components are along axes of their own."""
    turned: dict[str, Index] = {}
    for name, nodes in deck.boundary_sets.items():
        boundary = deck.scene.boundary[name]
        rows = _local_rows(deck, boundary)
        if rows is None:
            continue
        yield from card("TRANSFORM", {"NSET": nodes, "TYPE": "R"}, [tuple(chain(*rows))])
        turned[name] = _numbers(deck, name)
    for name, numbers in turned.items():
        others = [other for other in deck.boundary_sets if other != name]
        shared = [other for other in others if np.isin(numbers, _numbers(deck, other)).any()]
        loads = [load for load, table in deck.scene.loads.items() if np.isin(numbers, _loaded(deck, table.face)).any()]
        if shared or loads:
            what = "axes of nodes that are held or loaded along others as well"
            deck.refuse(f"boundary.{name}", what, ", ".join([*shared, *loads]), "let the faces share no nodes")


def _local_rows(deck: DeckDraft, boundary: Boundary) -> tuple[tuple[float, ...], ...] | None:
    """Axes x and y of the components of a boundary; None where they are the global ones."""
    if isinstance(boundary, Symmetry):
        normal = _normal(deck, boundary)
        if _axis_of(normal) is not None:
            return None
        across = np.eye(3)[int(np.abs(normal).argmin())]
        return LocalAxes(x=tuple(normal.tolist()), y=tuple(across.tolist())).rows[:2]
    axes = getattr(boundary, "axes", None)
    if axes is None:
        return None
    rows: tuple[tuple[float, ...], ...] = axes.rows[:2]
    return rows


def _normal(deck: DeckDraft, boundary: Symmetry) -> Array:
    """Unit normal (3,) of a plane of symmetry."""
    body, face = split_face(boundary.face)
    total = deck.ready.bodies[body].face(face).vector_areas.sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def _axis_of(normal: Array) -> int | None:
    """The global axis that a direction is along."""
    axis = int(np.abs(normal).argmax())
    if np.abs(np.delete(normal, axis)).max() < _ALONG:
        return axis
    return None


def _numbers(deck: DeckDraft, boundary: str) -> Index:
    """Numbers of the nodes of a boundary."""
    return _loaded(deck, deck.scene.boundary[boundary].face)  # type: ignore[union-attr]


def _loaded(deck: DeckDraft, face: str) -> Index:
    body, name = split_face(face)
    return deck.mesh.nodes[body][deck.ready.bodies[body].nodes_of(name)]


# -- motions ----------------------------------------------------------------------------------------------------------
def driven_sets(deck: DeckDraft) -> Iterator[DrivenSet]:
    """Prescribed motions as displacements: a deck of CalculiX has no velocities and accelerations of nodes."""
    time = deck.ready.time
    for name, boundary in deck.scene.boundary.items():
        if not isinstance(boundary, Driven) or name not in deck.boundary_sets:
            continue
        if isinstance(boundary.law, InputLaw):
            deck.refuse(f"boundary.{name}.law", "a motion that is set from outside")
            continue
        values, before = sampled(boundary.law, time), 0.0
        if isinstance(boundary, PrescribedDisplacement):
            before = float(boundary.law.sample(time[:1])[0])
            text = "*BOUNDARY with *AMPLITUDE"
        elif isinstance(boundary, PrescribedVelocity):
            values = _integrated(time, values)
            text = "*BOUNDARY with *AMPLITUDE: displacements, the integral of the velocity"
        else:
            values = _twice_integrated(time, values)
            text = "*BOUNDARY with *AMPLITUDE: displacements, the acceleration integrated twice"
        degrees = tuple(zip(_degrees(deck, boundary), boundary.value, strict=True))
        deck.used(f"boundary.{name}", text)
        yield DrivenSet(deck.free_name("amplitudes", name), deck.boundary_sets[name], degrees, time, values, before)


def _integrated(time: Array, values: Array) -> Array:
    """Integral (n,) of a history that is linear between its points."""
    steps = 0.5 * np.diff(time) * (values[1:] + values[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def _twice_integrated(time: Array, values: Array) -> Array:
    """Integral of the integral (n,) of a history that is linear between its points."""
    dt = np.diff(time)
    speed = _integrated(time, values)
    steps = dt * speed[:-1] + dt**2 / 6.0 * (2.0 * values[:-1] + values[1:])
    return np.concatenate([[0.0], np.cumsum(steps)])
