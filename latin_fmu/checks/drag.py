"""Drag by the mass part of Rayleigh damping: what it takes from bodies that move as a whole.

C = a M acts on absolute velocities, as a medium at rest would. By formula, without a run: a face that is driven with
the displacement s meets a force a m s' beside the inertia m s'', so that the reaction is off by about

    a max |s'| / max |s''|;

a part with a free motion loses the share 1 - exp(-a t) of its momentum in the time t, and under a constant force F it
tends to the velocity F / (a m). Damping by strain does none of this.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from ..assembly.body import Body, body_sides
from ..assembly.conditions import Conditions
from ..assembly.supports import PrescribedMotion
from ..errors import Problem
from ..latin.assembly import InterfaceUnit
from ..scene.boundaries import Driven
from ..scene.laws import InputLaw
from ..scene.schema import Scene

LARGEST: Final = 0.01
"""Share of a force, or of a momentum, up to which the drag is allowed without a word."""
_REMEDY: Final = (
    "damp the strain alone (damping_ratios, loss_factor or rayleigh_stiffness), or set material.{0}.frame = "
    '"absolute" where a medium at rest is meant'
)


def drag_problems(
    scene: Scene, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: Sequence[InterfaceUnit]
) -> Iterator[Problem]:
    """Driven faces and free parts that the mass part of Rayleigh damping brakes by more than ``LARGEST``."""
    drags = {n: b.shape.material.drag for n, b in bodies.items() if b.shape.material.frame is None}
    if scene.time.quasi_static or not any(drags.values()):
        return
    from ..statics.free_bodies import free_groups

    yield from _driven(scene, bodies, units, drags)
    # a contact may open: it holds nothing
    joined = [unit for unit in units if not unit.behaviour.opens]
    for group in free_groups(bodies, conditions, joined):
        masses = {name: float(bodies[name].rigid_motions.mass[0, 0]) for name in group.motions}
        rate = sum(drags.get(n, 0.0) * mass for n, mass in masses.items()) / sum(masses.values())
        lost = -math.expm1(-rate * scene.time.end)
        if lost > LARGEST:
            name = next(n for n in group.motions if drags.get(n))
            material = bodies[name].description.material
            yield Problem(
                f"material.{material}.rayleigh_mass",
                f"brakes the free motion of {', '.join(group.motions)} as a medium at rest would",
                f"{100 * lost:.3g} % of the momentum in {scene.time.end:g} s, and under a force F no faster than "
                f"F / ({rate:.4g} 1/s x {sum(masses.values()):.4g} {scene.unit_system['kg']})",
                f"at most {100 * LARGEST:g} %",
                _REMEDY.format(material),
            )


def _driven(
    scene: Scene, bodies: Mapping[str, Body], units: Sequence[InterfaceUnit], drags: Mapping[str, float]
) -> Iterator[Problem]:
    """Driven faces that a body with drag moves with."""
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    for key, boundary in scene.boundary.items():
        if not isinstance(boundary, Driven) or isinstance(boundary.law, InputLaw):
            continue
        along = max(boundary.value, key=abs)
        speed = PrescribedMotion(boundary.law, along, boundary.type).driving(time, end=scene.time.end)
        if boundary.type == "acceleration":
            from scipy.integrate import cumulative_trapezoid  # a quarter of a second to load

            rate, speed = speed, cumulative_trapezoid(speed, time, initial=0)
        else:
            rate = np.gradient(speed, time)
        name = boundary.face.partition(".")[0]
        moved = [n for n in _moving_with(name, bodies, units) if drags.get(n)]
        largest = float(np.abs(rate).max())
        if not moved or largest == 0.0:
            continue
        share = max(drags[n] for n in moved) * float(np.abs(speed).max()) / largest
        if share > LARGEST:
            material = bodies[max(moved, key=lambda n: drags[n])].description.material
            yield Problem(
                f"material.{material}.rayleigh_mass",
                f"brakes what boundary.{key} moves as a medium at rest would",
                f"{100 * share:.3g} % of the largest force of inertia",
                f"at most {100 * LARGEST:g} %",
                _REMEDY.format(material),
            )


def _moving_with(name: str, bodies: Mapping[str, Body], units: Sequence[InterfaceUnit]) -> list[str]:
    """Bodies that a body is joined to or in contact with, through others too."""
    neighbours: dict[str, set[str]] = {n: set() for n in bodies}
    for unit in units:
        sides = [owner for _, _, owner in body_sides([unit])]
        for side in sides:
            neighbours[side] |= set(sides)
    found, queue = {name}, [name]
    while queue:
        new = neighbours.get(queue.pop(), set()) - found
        found |= new
        queue += new
    return [n for n in bodies if n in found]
