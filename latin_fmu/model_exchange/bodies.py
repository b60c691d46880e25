"""Bonded substructures as one body: perfect interfaces are gone before anything is reduced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.merged_assembly import merge
from ..assembly.problem import DiscretisedProblem
from ..errors import Problem, SceneError
from ..latin.assembly import InterfaceUnit
from ..propagator import SubstructureModel
from ..scene.fields import GROUND, split_face


@dataclass(frozen=True)
class BondedBody:
    """One or more substructures that perfect interfaces hold together.

    Attributes
    ----------
    name : names of the substructures, joined by ``_``. model : matrices of all of it.
    members : the substructures. where : their full dofs among those of ``model``.
    """

    name: str
    model: SubstructureModel
    members: dict[str, SubstructureModel]
    where: dict[str, slice]


def is_bond(unit: InterfaceUnit) -> bool:
    """Whether an interface neither opens nor slides."""
    return unit.behaviour.name == "perfect"


def bonded_bodies(discretised: DiscretisedProblem) -> list[BondedBody]:
    """Bodies of a scene, in the order of its substructures."""
    models = {m.name: m for c in discretised.classes for m in c.members}
    names = [n for n in discretised.scene.substructure if n in models]
    place = {n: i for i, n in enumerate(names)}
    bonds = [u for u in discretised.units if is_bond(u)]
    ends = np.array([[place[split_face(s)[0]] for s in u.sides] for u in bonds if GROUND not in u.sides])
    ends = ends.reshape(-1, 2)
    graph = sp.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(names), len(names)))
    _, label = connected_components(graph, directed=False)
    bodies = []
    for number in dict.fromkeys(label):
        members = [models[n] for n, i in zip(names, label, strict=True) if i == number]
        held = {m.name for m in members}
        joined = [u for u in bonds if split_face(u.sides[0])[0] in held]
        bodies.append(_body(members, joined, discretised))
    return bodies


def _body(members: list[SubstructureModel], bonds: list[InterfaceUnit], discretised: DiscretisedProblem) -> BondedBody:
    by_name = {m.name: m for m in members}
    if not bonds:
        only = members[0]
        return BondedBody(only.name, only, by_name, {only.name: slice(0, only.n_full)})
    try:
        merged = merge(members, bonds, discretised.info)
    except ValueError as error:
        where = ", ".join(f"interface.{unit.name}" for unit in bonds)
        problem = Problem(
            where,
            f"perfect connections that no reduced model holds: {error}",
            remedy="mesh the two faces alike, or solve the scene itself",
        )
        raise SceneError([problem], "the scene has no reduced model") from error
    return BondedBody("_".join(by_name), merged.model, by_name, merged.where)
