"""Whether the program marches an assembly by its modes where the scene leaves the choice to it.

It does where that march costs far less than that of the bodies, and its error can be told and is small: steps longer
than waves take through an element, few relative motions, faces that neither land nor are hit by a front. Its error is
that of a march in steps twice as long with fewer modes (``accuracy.reduction``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from ..fem.contact_layer import longest_edge
from ..scene.settings import AutomaticPropagator, AutomaticScheme, ModalPropagatorTable
from .problem import DiscretisedProblem
from .propagator_choice import modes_refused
from .tied_assembly import Joints, TieError

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
