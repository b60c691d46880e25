"""Bodies in a static start that are on their way down to what will catch them.

A body above a table has an equilibrium on the table, but that is not where it starts: at t = 0 nothing holds it. Bodies
that are bonded or in contact at t = 0 form groups. Where a rigid motion q of a group is free of all their joints and
supports, and the loads f do work on it, the group is accelerated by

    a = R (R^T M R)^-1 R^T f,    R: the free motions q

and is in balance with its inertia, f - M a (inertia relief). Its static start is that balance, in the place that the
scene has: stresses of loads that hold each other are there, and a weight, which falls freely, makes none. The motion
begins at rest with the acceleration a. What no interface can catch is refused (``free_bodies.unheld``).

Strains of t = 0, of temperatures for instance, may bring a falling body into contact. Its loads are in balance with its
inertia, so that no pressure can act on it: it moves out of the way, as little as possible (``places_at_rest``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..assembly.body import Body, body_sides
from ..assembly.conditions import Conditions, RigidConditions
from ..assembly.models import ContactLayer, load_terms
from ..assembly.problem import DiscretisedProblem
from ..fem.mesh import Array
from ..interface.laws import NoSlip, coulomb_coefficient
from ..latin.assembly import InterfaceUnit
from ..propagator import LoadTerm, SubstructureModel
from ..propagator.model import with_load
from ..scene.schema import Scene, straining_loads
from .free_bodies import BALANCED, FreeGroup, free_groups, ways_of


@dataclass(frozen=True)
class FallingGroup:
    """Bodies that move together from t = 0 on, and the interfaces that may catch them."""

    free: FreeGroup
    catching: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Bodies of the group."""
        return tuple(self.free.motions)


def falling_groups(
    scene: Scene, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: Sequence[InterfaceUnit]
) -> list[FallingGroup]:
    """Groups of bodies at rest that the loads of t = 0 move where only open interfaces could hold them; none without
    inertia, where every increment is an equilibrium."""
    waiting = [unit for unit in units if _is_open(unit)]
    if not waiting or scene.time.quasi_static:
        return []
    closed = [unit for unit in units if not _is_open(unit)]
    found = []
    for group in free_groups(bodies, conditions, closed):
        catching = tuple(u.name for u in waiting if any(name in group.motions for _, _, name in body_sides([u])))
        if catching and group.work(_forces(scene, bodies, group))[0] > BALANCED:
            found.append(FallingGroup(group, catching))
    return found


def falling_in(problem: DiscretisedProblem) -> list[FallingGroup]:
    """``falling_groups`` of the static start of a problem."""
    names = [name for name in problem.bodies if not problem.scene.substructure[name].motion_keys]
    bodies = {name: problem.bodies[name] for name in names}
    conditions = {name: problem.conditions[name] for name in names}
    units = [u for u in problem.units if all(name in bodies for _, _, name in body_sides([u])) and not _yields(u)]
    return falling_groups(problem.scene, bodies, conditions, units)


def closed_by_strains(
    problem: DiscretisedProblem, before: Mapping[str, Array], traction: Mapping[str, Array], least: float
) -> list[str]:
    """Interfaces that are open in the scene, and may catch a falling group, but are pressed in the static start: what
    acts at t = 0 strains bodies into each other.

    The group has no equilibrium with them, since its inertia holds all its loads; nothing but the nodes that fix its
    place would resist the pressure.

    before, traction : tractions with tight bolts, and in the static start. least : Pa, above which one is a pressure.
    """

    names = [unit.name for unit in problem.units if _is_open(unit) and _closes(unit, before, traction, least)]
    if names:
        catching = {name for group in falling_in(problem) for name in group.catching}
    else:
        catching = set()
    return [name for name in names if name in catching]


def held_by_friction_alone(
    problem: DiscretisedProblem, before: Mapping[str, Array], traction: Mapping[str, Array], least: float
) -> list[str]:
    """Interfaces with friction or without slip that hold something in a static start by the way to it alone, where
    their bodies are in balance without them.

    A point without slip that touches without pressure may carry any shear. Strains that close a gap press on a body
    that nothing held on its way: where friction holds it there, one that had come beside the way would not be pressed.
    To carry nothing is a solution of both, too, unless the sides overlap then.

    before, traction, least : as for ``closed_by_strains``.
    """
    names = []
    for unit in problem.units:
        if not unit.behaviour.opens or unit.name not in traction or coulomb_coefficient(unit.behaviour) == 0.0:
            continue
        pressure, shear = (float(np.abs(part).max(initial=0.0)) for part in np.split(traction[unit.name], [1], 1))
        alone = isinstance(unit.behaviour, NoSlip) and shear > least >= pressure
        names += [unit.name] * (alone or (_is_open(unit) and _closes(unit, before, traction, least)))
    if not names:
        return []
    still = [name for name in problem.bodies if not problem.scene.substructure[name].motion_keys]
    bodies = {name: problem.bodies[name] for name in still}
    conditions = {name: problem.conditions[name] for name in still}
    units = [u for u in problem.units if u.name in traction and u.name not in names]
    groups = free_groups(bodies, conditions, units)
    balanced = all(group.work(_forces(problem.scene, bodies, group))[0] <= BALANCED for group in groups)
    if balanced:
        return names
    return []


def _closes(unit: InterfaceUnit, before: Mapping[str, Array], traction: Mapping[str, Array], least: float) -> bool:
    """Whether an interface is pressed in a static start, and not by bolts or press fits before."""

    def pressed(state: Mapping[str, Array]) -> bool:
        return unit.name in state and float(state[unit.name][:, 0].min(initial=0.0)) < -least

    return pressed(traction) and not pressed(before)


def _yields(unit: InterfaceUnit) -> bool:
    """Whether an interface carries nothing at rest."""
    return unit.behaviour.compliant and not unit.behaviour.elastic


def _is_open(unit: InterfaceUnit) -> bool:
    """Whether an interface has a gap at all its points."""
    return unit.behaviour.opens and float(unit.geometry.gap.min(initial=np.inf)) > 0.0


def _forces(scene: Scene, bodies: Mapping[str, Body], group: FreeGroup) -> Iterator[tuple[str, Array, Array]]:
    """Body, pattern (3 n_node,) and amplitude (1,) of each load at t = 0."""
    laws = scene.force_laws
    for name in group.motions:
        for term in load_terms(scene, name, bodies[name], None, straining=False):
            yield name, term.pattern, laws[term.name].sample(np.zeros(1))


def falling_parts(groups: Sequence[FallingGroup]) -> list[tuple[list[str], str]]:
    """For ``free_bodies.free_list``: groups that start in the place of the scene and are moved from there."""
    return [
        (
            list(group.names),
            f"can {ways_of(next(iter(group.free.motions.values())))} under its loads: it starts in its place, at rest, "
            f"and moves on until interface {' or '.join(group.catching)} closes",
        )
        for group in groups
    ]


def held_in_place(groups: Sequence[FallingGroup], conditions: Mapping[str, Conditions]) -> dict[str, Conditions]:
    """The conditions with rigid bodies of groups that are all rigid held: nothing in them has a static problem."""
    changed = dict(conditions)
    for group in groups:
        supports = {name: conditions[name] for name in group.names}
        if all(isinstance(support, RigidConditions) for support in supports.values()):
            for name, support in supports.items():
                changed[name] = replace(support, expansion=sp.csr_array(support.expansion[:, :0]))
    return changed


def relieved(
    problem: DiscretisedProblem, groups: Sequence[FallingGroup], layers: Mapping[str, ContactLayer]
) -> DiscretisedProblem:
    """A static problem whose groups are in balance with their inertia; ``layers`` : of the motion that follows, whose
    masses are accelerated."""
    forces: dict[str, list[LoadTerm]] = {}
    for group in groups:
        members = {m.name: m for c in problem.classes for m in c.members if m.name in group.names}
        for name, terms in _inertia(problem, group, members, layers).items():
            forces.setdefault(name, []).extend(terms)
    if not forces:
        return problem
    classes = []
    for c in problem.classes:
        changed = []
        for model in c.members:
            for term in forces.get(model.name, ()):
                model = with_load(model, term)
            changed.append(model)
        classes.append(replace(c, members=changed))
    return replace(problem, classes=classes)


def _inertia(
    problem: DiscretisedProblem,
    group: FallingGroup,
    members: Mapping[str, SubstructureModel],
    layers: Mapping[str, ContactLayer],
) -> dict[str, list[LoadTerm]]:
    """Forces -M a of each load on the bodies of a group, on their full dofs."""
    motions, momenta = {}, {}
    for name, model in members.items():
        support, nodal = problem.conditions[name], group.free.motions[name]
        if isinstance(support, RigidConditions):
            motions[name] = la.lstsq(support.nodal, nodal)[0]
            momenta[name] = support.basis.T @ support.body.mass @ support.basis @ motions[name]
        else:
            layer = layers.get(name)
            motions[name] = nodal
            momenta[name] = (problem.bodies[name].mass if layer is None else layer.mass) @ nodal
        assert model.n_full == len(motions[name])
    inertia = np.sum([motions[name].T @ momenta[name] for name in members], axis=0)
    work: dict[str, Array] = {}
    for name, model in members.items():
        for load in model.loads:
            if load.name and load.name in problem.scene.force_laws and load.name not in straining_loads(problem.scene):
                part = motions[name].T @ load.pattern
                if load.name in work:
                    part = work[load.name] + part
                work[load.name] = part
    accelerations = {load: np.asarray(la.solve(inertia, f, assume_a="pos")) for load, f in work.items()}
    return {
        name: [LoadTerm(load, -np.asarray(momenta[name] @ a)) for load, a in accelerations.items()] for name in members
    }
