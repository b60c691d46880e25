"""Whether the program marches an assembly by its modes where the scene leaves the choice to it.

It does where that march costs far less than that of the bodies, and its error can be told and is small: steps longer
than waves take through an element, few relative motions, faces that neither land nor are hit by a front. Its error is
that of a march in steps twice as long with fewer modes (``accuracy.reduction``). Two such marches do not see the mass
that their modes leave out of parts that slide as a whole: where contacts let go of a part entirely, the bodies are
marched.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..fem.contact_layer import longest_edge
from ..interface.laws import STICK
from ..latin.outcome import InterfaceHistory
from ..scene.fields import split_face
from ..scene.settings import AutomaticPropagator, AutomaticScheme, ModalPropagatorTable
from .problem import DiscretisedProblem
from .propagator_choice import modes_refused
from .tied_assembly import Joints, TieError

_STICKING: Final = 3  # points that hold two bodies in all their motions
MOST_RELATIVE: Final = 4000
"""Relative motions at most: their stiffness is a dense matrix."""
PAYS: Final = 20.0
"""Predicted CPU seconds of the march of the bodies from which on modes are tried: their own set-up takes seconds."""


def tries_modes(discretised: DiscretisedProblem) -> bool:
    """Whether the march by modes suits a scene that leaves the choice to the program."""
    scene = discretised.scene
    automatic = isinstance(scene.solver.propagator, AutomaticPropagator) and isinstance(
        scene.time.scheme, AutomaticScheme
    )
    if not automatic or modes_refused(scene, False) or discretised.histories:
        return False
    # else bodies land, or a front reaches their faces
    if discretised.scheme.name != "hht":
        return False
    return 0 < _relative(discretised) <= MOST_RELATIVE and _long_steps(discretised)


def by_choice(discretised: DiscretisedProblem) -> DiscretisedProblem:
    """The problem of a scene that asks for modes."""
    # not by its text: interfaces that a search has found are in the scene of the problem alone
    solver = discretised.scene.solver.model_copy(update={"propagator": ModalPropagatorTable()})
    return replace(discretised, scene=discretised.scene.model_copy(update={"solver": solver}))


def let_go(discretised: DiscretisedProblem, interfaces: Mapping[str, InterfaceHistory]) -> str:
    """A body that at some instant no contact with enough sticking points joins to the others and to what holds them;
    empty where there is none."""
    units = [unit for unit in discretised.units if unit.name in interfaces]
    held = [_held(interfaces[unit.name]) for unit in units]
    models = [model for c in discretised.classes for model in c.members]
    names = [model.name for model in models]
    supported = [i for i, m in enumerate(models) if m.expansion.shape[1] < m.n_full]
    number = {name: i for i, name in enumerate(names)}
    # the last node: the ground, of a floating assembly nothing
    ground = len(names)
    ends = [[number.get(split_face(face)[0], ground) for face in unit.sides] for unit in units]
    for pattern in np.unique(np.stack(held, axis=1), axis=0) if held else ():
        pairs = [pair for pair, holds in zip(ends, pattern, strict=True) if holds]
        pairs += [[i, ground] for i in supported]
        first, second = np.array(pairs, dtype=int).reshape(-1, 2).T
        graph = sp.coo_array((np.ones(len(first)), (first, second)), shape=(ground + 1, ground + 1))
        label = connected_components(graph, directed=False)[1][:ground]
        largest = np.bincount(label).argmax()
        if (label != largest).any():
            return names[int(np.flatnonzero(label != largest)[0])]
    return ""


def _held(history: InterfaceHistory) -> NDArray[np.bool_]:
    """Whether an interface holds its sides together at each instant after the start, (n_time - 1,)."""
    if history.contact_status is None:
        return np.ones(history.traction.shape[0] - 1, dtype=bool)
    sticking = (history.contact_status[1:] == STICK).sum(axis=1)
    return np.asarray(sticking >= min(_STICKING, history.contact_status.shape[1]))


def _relative(discretised: DiscretisedProblem) -> int:
    """Number of relative motions of contacts; 0 where a joint cannot be followed."""
    try:
        joints = Joints.of(discretised.units)
    except TieError:
        return 0
    return sum(discretised.layout.channels(i, 0).size for i in joints.relative)


def _long_steps(discretised: DiscretisedProblem) -> bool:
    """Whether waves cross every element of every elastic body within a step."""
    bodies = [body for body in discretised.bodies.values() if not body.rigid]
    transits = [longest_edge(b.shape.mesh) / b.shape.fast_elasticity.bar_speed for b in bodies]
    return bool(transits) and max(transits) <= discretised.dt
