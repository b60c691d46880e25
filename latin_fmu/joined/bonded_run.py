"""A run in which bonded bodies are one substructure (``bond_groups``), and what all bodies and interfaces do in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..assembly.body_motions import joined_histories, standing_bodies
from ..assembly.initial_state import InitialState
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem, ready
from ..assembly.propagator_choice import chosen_propagators
from ..interface.laws import bonds
from ..latin.assembly import Array, Assembly
from ..latin.probes import OutputRequest
from ..latin.recorder import SubstructureInfo
from .bond_groups import GroupedAssembly, suited
from .bonded_fields import BondedRecorder
from .tied_assembly import TieError


@dataclass(frozen=True)
class BondedMarch:
    """An assembly of groups that is ready to be marched.

    Attributes
    ----------
    grouped : its substructures. assembly : of these. bodies : of all bodies, with ``BodyMotions``.
    start : tractions (n_point, n_component) on side E of the interfaces at t = 0 by name, Pa; empty where not known.
    """

    grouped: GroupedAssembly
    assembly: Assembly
    bodies: Assembly
    start: dict[str, Array]

    @property
    def in_words(self) -> str:
        """What is marched as one."""
        return self.grouped.in_words

    def recorder(
        self, request: OutputRequest, info: dict[str, SubstructureInfo], thinned: int, *file: Any
    ) -> BondedRecorder:
        """That of the bodies and all interfaces, which is fed by the march of the groups; parameters as for
        ``Recorder``."""
        return BondedRecorder((self.grouped, self.assembly, self.bodies, self.start), request, info, thinned, *file)


def grouped_assembly(discretised: DiscretisedProblem, restricted: bool) -> tuple[GroupedAssembly | None, str]:
    """The substructures of a march in which bonds are eliminated; None, and why not, where they are iterated: in no
    words where the scene asks for that, or has no bonds. ``restricted`` : whether the caller takes laws of its own,
    derivatives, several processes, or looks at iterates."""
    scene, units = discretised.scene, discretised.units
    iterated = scene.solver.bonds == "iterate" or scene.time.quasi_static or discretised.scheme.explicit
    if iterated or not any(bonds(unit.behaviour) for unit in units):
        return None, ""
    if chosen_propagators(scene, discretised.classes)[0].kind != "direct":
        return None, ""
    reasons = {
        "windows of several instants are solved body by body": scene.solver.window != 1,
        "bodies are omitted while they rest": scene.solver.skip_at_rest == "tolerance",
        "derivatives, observers, several processes and user-defined laws require single bodies, one by one": restricted,
    }
    if given_reasons := [reason for reason, holds in reasons.items() if holds]:
        return None, given_reasons[0]
    models = {m.name: m for c in discretised.classes for m in c.members}
    moving = discretised.timeline.ground(units, discretised.time)
    bonded, why = suited(units, models, moving)
    if not bonded:
        return None, f"bonds {why}"
    try:
        return GroupedAssembly.of(discretised.classes, units, discretised.layout, discretised.bodies, bonded), ""
    except TieError as error:
        return None, str(error)


def bonded_problem(
    discretised: DiscretisedProblem, start: InitialState | None, grouped: GroupedAssembly
) -> SolverReadyProblem:
    """The problem with its ``grouped`` assembly ready to be marched, from an equilibrium where there is one.

    Raises
    ------
    TieError : sides of bonds are apart at t = 0, or move apart.
    """
    if start is not None:
        grouped = grouped.displaced(start)
    grouped.check_start(discretised.units, discretised.layout)
    _, bodies, timeline = standing_bodies(discretised, start, discretised.scheme)
    layout, outer = bodies.layout, grouped.layout
    here, there = grouped.pairs(outer, layout)
    impedance = np.zeros(outer.n_flat)
    impedance[here] = discretised.impedance[there]
    # relative motions have both sides in series
    for i in (i for group in grouped.groups for i in group.inner):
        sides = [outer.channels(grouped.remaining.index(i), side) for side in (0, 1)]
        first, second = (impedance[channels] for channels in sides)
        impedance[sides[0]], impedance[sides[1]] = first * second / (first + second), 0.0
    assembly, remarks = discretised.assembled(grouped.classes, grouped.units, outer, impedance)
    if start is not None:
        start.hand_over(assembly)
    models = {group.model.name: group for group in grouped.groups}
    for propagator in assembly.propagators:
        histories = [
            joined_histories(discretised, timeline, models[m.name].models if m.name in models else [m], m)
            for m in propagator.members
        ]
        propagator.begin(histories, discretised.dt)
    ground = timeline.ground(grouped.units, discretised.time)
    assembly.begin(discretised.time, discretised.dt, ground, assembly.ground.start)
    about = discretised.about(assembly, start, timeline, remarks)
    # rigid bodies have got theirs
    bodies.impedance[there] = np.where(bodies.impedance[there] > 0.0, bodies.impedance[there], assembly.impedance[here])
    march = BondedMarch(grouped, assembly, bodies, {} if start is None else dict(start.traction))
    return ready(discretised, bodies, about, grouped=march)
