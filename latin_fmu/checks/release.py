"""What holds the sides of a joint together: their weight, or bodies that are clamped.

The clamp force of a bolt, or of a part pressed in between others, is the force of deformed bodies: sides that approach
by a part of the deformation lose that part of the force. What weight or another load presses keeps its force wherever
the sides are. The two differ by the rigid motions of the bodies: where the sides of the joint can be lifted off each
other without a deformation, every other joint staying closed, the balance of the loads alone gives the force between
them (the joint is statically determinate along its normals). Two terms of the force N then depend on the approach s,

    N = N of the loads + k s + m s'',

k of the springs and layers that the lifting strains, m the mass that an approach of the sides moves:

    w = G q  normal opening of the points of the joint that touch, q the rigid motions that all other joints allow,
    g the mean of the rows of G over the areas,    1 / m = g M^-1 g^T,    k = q^T K q  for a mean opening of 1.

Friction at other joints counts as holding, so that a joint is taken for clamped where both are possible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..assembly.body import consecutive
from ..fem.elements import rigid_modes
from ..joined.joined_assembly import Parts
from ..latin.assembly import Array, InterfaceUnit
from ..propagator import SubstructureModel
from ..propagator.model import closest_reduced
from ..statics.free_bodies import HELD

_LIFTED = 1e-6  # opening of a point over the mean one from which on it closes when the others open
_AT_ALL = 1e-3  # mean opening over the largest that is possible


@dataclass(frozen=True)
class Release:
    """A joint whose sides can be lifted off each other without a deformation of bodies.

    Attributes
    ----------
    mass : that an approach of the sides moves, kg. stiffness : of springs and layers against it, N m-1.
    """

    mass: float
    stiffness: float


def released(
    models: Sequence[SubstructureModel],
    nodes: Mapping[str, Array],
    units: Sequence[InterfaceUnit],
    touching: Mapping[str, NDArray[np.bool_]],
    joint: str,
) -> Release | None:
    """The joint of this name as one that loads press, None where deformed bodies do (module docstring).

    Parameters
    ----------
    models : of all substructures. nodes : (n_node, 3) of each, m. units : all interfaces. touching : (n_point,) by
        name of those that may open, whether a point is pressed.
    """
    parts = Parts.of(models)
    motions = {model.name: _rigid(model, nodes[model.name]) for model in models}
    where, total = consecutive({name: rigid.shape[1] for name, rigid in motions.items()})
    moved = np.zeros((parts.n, total))
    for name, rigid in motions.items():
        moved[parts.where[name], where[name]] = rigid
    squares, springs = np.zeros((total, total)), np.zeros((total, total))
    opening, areas = np.zeros((0, total)), np.zeros(0)
    for unit in units:
        points = touching.get(unit.name, np.ones(unit.geometry.n_point, dtype=bool))
        relative = np.asarray(parts.jump(unit, local=True) @ moved).reshape(len(points), 3, total)[points]
        if unit.name == joint:
            # the jump of owner less other along N: an opening or an approach, by the owner's side
            if unit.geometry.owner == 0:
                sign = -1.0
            else:
                sign = 1.0
            opening, areas = sign * relative[:, 0], unit.geometry.areas[points]
            continue
        stiffness = _stiffness(unit)
        weights = unit.geometry.areas[points, None] * stiffness
        springs += np.einsum("pc,pcm,pcn->mn", weights, relative, relative)
        rows = relative[:, _rigid_components(unit)].reshape(-1, total)
        squares += rows.T @ rows / max(len(points), 1)
    if not (total and len(opening)):
        return None
    values, vectors = la.eigh(squares)
    free = vectors[:, values < HELD * max(float(values[-1]), HELD)]
    return _lifted(opening @ free, areas, free.T @ (moved.T @ (parts.mass @ moved)) @ free, free.T @ springs @ free)


def _lifted(opening: Array, areas: Array, mass: Array, springs: Array) -> Release | None:
    """The joint of an opening (n_point, n_free) by the free motions, with their mass and stiffness; None where none of
    them opens all of its points."""
    if not opening.shape[1]:
        return None
    weights = np.sqrt(areas)[:, None]
    uniform = la.lstsq(weights * opening, weights[:, 0])[0]
    lifted, mean = opening @ uniform, areas @ opening / areas.sum()
    if not (lifted.min() > -_LIFTED and mean @ uniform > _AT_ALL):
        return None
    compliance = float(mean @ la.lstsq(mass, mean)[0])
    return Release(1.0 / compliance, float(uniform @ springs @ uniform) / float(mean @ uniform) ** 2)


def _rigid(model: SubstructureModel, nodes: Array) -> Array:
    """Rigid motions (n_full, 0 ... 6) that the conditions of a substructure allow, of unit size."""
    full = rigid_modes(nodes, nodes.mean(axis=0), float(np.ptp(nodes, axis=0).max()))
    # a body with unknowns of its own: those that move its nodes like this
    if model.nodal is None:
        unknowns = full
    else:
        unknowns = la.lstsq(model.nodal, full)[0]
    allowed = model.expansion @ closest_reduced(model.expansion, unknowns)
    against = full - (allowed if model.nodal is None else model.nodal @ allowed)
    values, vectors = la.eigh(against.T @ against / len(nodes))
    return np.asarray(unknowns @ vectors[:, values < HELD])


def _stiffness(unit: InterfaceUnit) -> Array:
    """Stiffness per area (3,) of an elastic interface in its local frame, N m-3; 0 of others."""
    if not unit.behaviour.elastic:
        return np.zeros(3)
    along = float(getattr(unit.behaviour, "normal_stiffness", 0.0))
    return np.array([along, *[float(getattr(unit.behaviour, "tangential_stiffness", 0.0))] * 2])


def _rigid_components(unit: InterfaceUnit) -> list[int]:
    """Components in the local frame along which an interface keeps the sides together where they touch."""
    behaviour = unit.behaviour
    across = [1, 2][: behaviour.n_component - 1]
    if behaviour.opens:
        return ([] if behaviour.elastic else [0]) + across
    if behaviour.compliant:
        return []
    return [0, *across]
