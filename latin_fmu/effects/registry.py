"""All effects, in the order in which they are told. A new one is one function and one line here."""

from __future__ import annotations

from collections.abc import Callable

from . import bodies, joints, kept
from .effect import Effect
from .sizes import Sizes

EFFECTS: tuple[Callable[[Sizes], Effect], ...] = (
    bodies.inertia,
    bodies.elasticity,
    bodies.rigidity,
    bodies.damping,
    bodies.absorbing_ends,
    bodies.body_force,
    bodies.loads,
    bodies.initial_motion,
    bodies.static_start,
    bodies.prescribed_motion,
    joints.contact,
    joints.friction,
    joints.gap,
    joints.bond,
    joints.layers,
    joints.preload,
    kept.fields,
    kept.stress,
    kept.energy,
)
