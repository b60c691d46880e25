"""Substructures at rest: arrival times of waves, and classes cut into parts by them.

A disturbance starts where the scene makes one (loads from their first instant on, initial values, body forces,
prescribed motions) and travels at most at the pressure wave speed along straight lines between faces of a body,
through interfaces at once, through rigid bodies at once: every assumption is on the early side. Implicit schemes send
traces of a wave ahead of it: a body is marched a share of the way and some steps before.

Members of a class are marched together, which costs less than one by one, but all of them as soon as one moves. Where
substructures at rest are skipped (``solver.skip_at_rest = "tolerance"``) a class is cut into parts by arrival time, as
far as that is predicted to pay; the parts share their operators.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..fem.mesh import Array, nearest
from ..latin.assembly import InterfaceUnit
from ..scene.boundaries import Driven
from ..scene.fields import GROUND, split_face
from ..scene.laws import InputLaw, TimeLaw
from ..scene.schema import Scene
from .body import Body
from .models import ModelClass

SHARE, STEPS = 0.35, 6
"""A body is marched from (1 - SHARE) of the arrival time, STEPS steps earlier still (measured: a chain of blocks of ten
elements each, traces of 1e-6)."""
Port = tuple[str, str]  # a substructure and one of its faces
_TOGETHER = 0.6
"""Cost of one more member of a class, marched with the others, over its cost alone."""


def arrival_times(
    scene: Scene, bodies: dict[str, Body], units: Sequence[InterfaceUnit], time: Array
) -> dict[str, float]:
    """Earliest time at which each substructure can be disturbed, s; infinite where nothing ever comes."""
    first = {name: _inside(scene, name, time) for name in bodies}
    queue: list[tuple[float, Port]] = []
    for (name, face), onset in _face_sources(scene, units, time).items():
        if onset < np.inf:
            heapq.heappush(queue, (onset, (name, face)))
    ports = [tuple(split_face(side) for side in unit.sides if side != GROUND) for unit in units]
    for name, onset in first.items():
        if onset < np.inf:
            for pair in ports:
                for port in pair:
                    if port[0] == name:
                        heapq.heappush(queue, (onset, port))
    reached: dict[Port, float] = {}
    while queue:
        now, port = heapq.heappop(queue)
        if port in reached:  # times ascend: the first is the least
            continue
        reached[port] = now
        name = port[0]
        first[name] = min(first[name], now)
        for pair in ports:
            # through an interface at once
            for here, there in (pair, pair[::-1]) if len(pair) == 2 else ():
                if here == port:
                    heapq.heappush(queue, (now, there))
            for other in pair:
                if other[0] == name and other not in reached:
                    heapq.heappush(queue, (now + _transit(bodies[name], port[1], other[1]), other))
    return first


def marched_share(arrival: float, time: Array) -> float:
    """Predicted share of the instants ``time`` (n_time,), s, at which a body reached at ``arrival`` is marched."""
    start = min(arrival * (1 - SHARE), float(time[-1])) - STEPS * float(time[1] - time[0])
    if arrival * (1 - SHARE) < time[-1]:
        return float(np.clip(1 - start / time[-1], 0.0, 1.0))
    return 0.0


def _inside(scene: Scene, name: str, time: Array) -> float:
    """Instant at which the whole body is disturbed, s; infinite where it never is."""
    described, laws = scene.substructure[name], scene.force_laws
    if described.initial_keys or scene.thrown:
        return 0.0
    sources = [load.name for load in scene.body_loads if load.acts_on(name, scene.substructure[name])]
    return min((_onset(laws[n], time) for n in sources if n in laws), default=np.inf)


def _face_sources(scene: Scene, units: Sequence[InterfaceUnit], time: Array) -> dict[Port, float]:
    """Instants at which loads, prescribed motions and moving ground first disturb faces, s."""
    onsets: dict[Port, float] = {}

    def source(face: str, onset: float) -> None:
        port = split_face(face)
        onsets[port] = min(onsets.get(port, np.inf), onset)

    for load in scene.loads.values():
        source(load.face, _onset(load.law, time))
    for boundary in scene.boundary.values():
        # a driven face whose value is zero is a held one
        if isinstance(boundary, Driven) and any(boundary.value):
            source(boundary.face, _onset(boundary.law, time))
    for port in scene.port.values():
        source(port.face, min(_onset(port.law(c), time) for c in port.components))
    joints = scene.joints
    for unit in units:
        ground = joints[unit.name].ground_velocity
        if ground is not None and any(ground.vector):
            source(unit.sides[0], _onset(ground.law, time))
    return onsets


def _onset(law: TimeLaw, time: Array) -> float:
    """Last instant at which a law is still zero (linear between instants); an input may start at once."""
    if isinstance(law, InputLaw):
        return 0.0
    # linear between instants: it begins to act behind the last zero
    acting = np.flatnonzero(law.sample(time))
    if acting.size:
        return float(time[max(int(acting[0]) - 1, 0)])
    return np.inf


def _transit(body: Body, first: str, second: str) -> float:
    """Shortest time from one face of a body to another, s."""
    if body.rigid:
        return 0.0
    distance, _ = nearest(body.mesh.nodes[body.nodes_of(first)], body.mesh.nodes[body.nodes_of(second)])
    speed = body.shape.impedances[0] / body.shape.material.density
    return float(distance.min()) / speed


def cut_by_arrival(classes: Sequence[ModelClass], marched: Mapping[str, float]) -> list[ModelClass]:
    """Classes cut where it pays; ``marched``: predicted share of the instants at which each substructure is marched."""
    parts: list[ModelClass] = []
    for whole in classes:
        order = sorted(range(len(whole.members)), key=lambda j: -marched[whole.members[j].name])
        shares = [marched[whole.members[j].name] for j in order]
        first = len(parts)
        for start, stop in _parts(shares):
            members = sorted(order[start:stop])
            twin = None
            if len(parts) != first:
                twin = first
            part = replace(whole, members=[whole.members[j] for j in members], channels=whole.channels[:, members])
            parts.append(replace(part, twin=twin))
    return parts


def _parts(shares: Sequence[float]) -> list[tuple[int, int]]:
    """Consecutive parts of falling shares with the least predicted cost (dynamic programming)."""
    best: list[tuple[float, int]] = [(0.0, 0)]  # cost of the first j members, start of their last part
    for stop in range(1, len(shares) + 1):
        options = [
            # a small price per part, so that equal shares stay together
            (best[start][0] + shares[start] * (1 + _TOGETHER * (stop - start - 1)) + 1e-9, -start)
            for start in range(stop)
        ]
        cost, start = min(options)
        best.append((cost, -start))
    parts, stop = [], len(shares)
    while stop:
        start = best[stop][1]
        parts.append((start, stop))
        stop = start
    return parts[::-1]
