"""Loads beside waves: how fast what acts on a scene changes, over the time that a wave takes across it.

A load that changes slowly against the transit of waves moves bodies as in an equilibrium, and their lowest modes:
whether mesh and step follow a wave front makes no difference to its answer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from ..latin.assembly import Array, InterfaceUnit
from ..remarks import Remark
from ..scene.boundaries import Driven
from ..scene.laws import InputLaw, RectangularPulseLaw, StepLaw, TimeLaw
from ..scene.schema import Scene
from ..scene.settings import StaticStart
from .body import Body
from .models import approaches

_REFINE = "refine the mesh there (a smaller step alone does not help)"
_NAMED = 2  # sides that are named before "and so many more"
SLOW = 10.0
"""Time in which loads change over the longest transit of a wave from which on waves do not count."""


def load_pace(scene: Scene, time: Array) -> float:
    """Time in which the fastest of all laws changes by its largest value, s: 0 of one that jumps or is set from
    outside, infinite where nothing changes. ``time`` : (n,) instants of the run."""
    laws = list(_laws(scene))
    # a jump has no pace: its waves are excited however long it lasts
    if any(isinstance(law, StepLaw | RectangularPulseLaw | InputLaw) for law in laws):
        return 0.0
    return min((_pace(law.sample(time), time) for law in laws), default=np.inf)


def longest_transit(bodies: Mapping[str, Body]) -> float:
    """Time of a wave across the whole assembly at the slowest shear speed, s; 0 of rigid bodies alone."""
    nodes = np.concatenate([body.mesh.nodes for body in bodies.values()])
    elastic = [body.shape.elasticity for body in bodies.values() if not body.rigid]
    slowest = min((material.wave_speeds[1] for material in elastic), default=np.inf)
    return float(np.ptp(nodes, axis=0).max() / slowest)


def waves_count(scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit], time: Array) -> bool:
    """Whether the answer of a scene may depend on how waves are followed: something jumps, moves or lands, or a load
    changes faster than ``SLOW`` transits of a wave."""
    transit = longest_transit(bodies)
    if scene.time.quasi_static or transit == 0.0:
        return False
    moving = scene.thrown or any(table.initial_keys for table in scene.substructure.values())
    if moving or _begins_suddenly(scene, time) or load_pace(scene, time) < SLOW * transit:
        return True
    opening = [unit for unit in units if unit.behaviour.opens]
    # no face of it touches
    apart = [unit for unit in opening if unit.geometry.gap.min(initial=np.inf) > 0.0]
    return bool(apart) or any(approaches(bodies, unit) for unit in opening)


def _laws(scene: Scene) -> Iterator[TimeLaw]:
    yield from scene.force_laws.values()
    yield from (boundary.law for boundary in scene.boundary.values() if isinstance(boundary, Driven))
    yield from (port.law(component) for port in scene.port.values() for component in port.components)
    grounds = (interface.ground_velocity for interface in scene.interface.values())
    yield from (ground.law for ground in grounds if ground is not None)


def _begins_suddenly(scene: Scene, time: Array) -> bool:
    """Whether something acts at t = 0 that no equilibrium has before: loads without a static start, motions of
    faces."""
    first = time[:1]
    loads = []
    if not (isinstance(scene.time.start, StaticStart) or scene.bolt):
        loads = list(scene.force_laws.values())
    faces = [boundary.law for boundary in scene.boundary.values() if isinstance(boundary, Driven)]
    return any(float(law.sample(first)[0]) != 0.0 for law in (*loads, *faces))


def _pace(amplitude: Array, time: Array) -> float:
    """Time in which a sampled law changes by its largest value, s."""
    steepest = float(np.abs(np.diff(amplitude) / np.diff(time)).max(initial=0.0))
    if steepest == 0.0:
        return float("inf")
    return float(np.abs(amplitude).max()) / steepest


def resolution_remarks(sides: Iterable[str]) -> list[Remark]:
    """One remark on all reasons why waves are not followed at sides of interfaces, as
    ``latin.search_direction.unresolved_sides`` says."""
    reasons: dict[str, list[str]] = {}
    for sentence in sides:
        side, _, rest = sentence.partition(": ")
        # the reason is what stands before the numbers
        reasons.setdefault(rest.partition(" to follow")[0], []).append(side)
    found, remedies = [], []
    for reason, at in reasons.items():
        if len(at) > _NAMED:
            more = f" and {len(at) - _NAMED} more sides"
        else:
            more = ""
        found.append(f"{reason} to follow a wave at {'; '.join(at[:_NAMED])}{more}")
        remedy = "use smaller steps"
        if reason.startswith("the mesh"):
            remedy = _REFINE
        remedies.append(remedy)
    what = "contacts shorter than the travel time of a wave through a few elements are not resolved; if they matter,"
    text = f"{', and '.join(found)}: {what} {', and '.join(remedies)}"
    if found:
        return [Remark("resolution", text)]
    return []
