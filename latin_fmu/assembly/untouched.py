"""Bodies at rest without load behind a gap that the others do not close: a run leaves them out, with their interfaces.

A body at rest without loads stays there until an interface closes. The estimate of the largest way of the others is

    V T + J / Z + J_N T / (rho L),

T the length of the run, V the largest velocity given to a body, J the impulse of the loads per area, J_N its part along
the normals of the interface (both that of the largest traction over T where other loads than those on faces act),
Z = rho c_p and L the size of a body: the way of a face under tractions as long as no wave returns, and that of a free
body as a whole. A gap beyond it is taken for one that stays open. Whether it does is checked by the motion of the run:
the law of contact (``kernels.local_stage``) gives no traction as long as

    G / dt + d > 0

at every instant of the finished run. If that does not hold the run is void, and is repeated with all bodies.

The others keep the time scheme that is chosen with all bodies, and their faces towards the bodies left out the masses
and contact layers that the scheme gives faces which may open: the run differs from that with all bodies by the
tolerance of the iteration (4e-8 of the largest at 1e-8). Reduced bodies have modes that depend on all their faces, and
stay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fem.mesh import padded_cells
from ..interface.laws import SEPARATION, Contact, coulomb_coefficient
from ..kernels.energy_parts import TERMS
from ..latin.assembly import Array, Assembly, InterfaceUnit
from ..latin.outcome import InterfaceHistory, SubstructureHistory
from ..latin.probes import FacePlace
from ..latin.recorder import Recorder, SubstructureInfo
from ..scene.boundaries import Driven, Fixed, Symmetry
from ..scene.fields import split_face
from ..scene.raw_scene import CENTRAL
from ..scene.schema import Scene, straining_loads
from .body import Body, body_sides
from .loaded_faces import BodyFace

MOST = 64e6
"""Bytes of the histories of all interfaces up to which bodies are left out: larger ones go to a file instant by
instant."""
_NUMBERS = 19  # of a point at an instant: tractions and velocities of both sides, velocities of sliding ones, the gap


@dataclass(frozen=True)
class Untouched:
    """Bodies left out of a run, and their interfaces with the bodies that are not.

    Attributes
    ----------
    sides : interfaces by name, with the side (0, 1) that is in the run. info : meshes of the bodies left out.
    interfaces, bodies : names of all of the scene, in its order.
    """

    sides: Mapping[str, tuple[InterfaceUnit, int]]
    info: Mapping[str, SubstructureInfo]
    interfaces: tuple[str, ...]
    bodies: tuple[str, ...]

    @staticmethod
    def of(bodies: Mapping[str, Body], units: Sequence[InterfaceUnit], names: frozenset[str]) -> Untouched:
        """Of all bodies and interfaces of a scene, and the names of the bodies left out."""
        sides, info = dict[str, tuple[InterfaceUnit, int]](), dict[str, SubstructureInfo]()
        for unit in units:
            owners = {side: owner for _, side, owner in body_sides([unit])}
            if names & set(owners.values()):
                sides.update((unit.name, (unit, side)) for side, owner in owners.items() if owner not in names)
        for name, body in bodies.items():
            if name in names:
                cells, types = padded_cells(body.mesh.blocks), " ".join(body.mesh.cell_types)
                info[name] = SubstructureInfo(body.mesh.nodes, cells, types, None)
        return Untouched(sides, info, tuple(unit.name for unit in units), tuple(bodies))

    @property
    def faces(self) -> dict[str, FacePlace]:
        """Sides whose motion the run has to keep, by interface."""
        places = {}
        for name, (unit, side) in self.sides.items():
            trace = unit.geometry.traces[side]
            assert trace is not None  # the ground is no body
            places[name] = FacePlace(split_face(unit.sides[side])[0], trace)
        return places

    def complete(
        self,
        histories: Mapping[str, InterfaceHistory],
        bodies: Mapping[str, SubstructureHistory],
        recorder: Recorder,
        assembly: Assembly,
    ) -> tuple[dict[str, InterfaceHistory], dict[str, SubstructureHistory]]:
        """Histories of all interfaces and, where any are stored, bodies of the scene, from those of a run without what
        is left out."""
        interfaces = self._interfaces(
            recorder.series("path"), assembly.scheme.gap_offset(assembly.dt), recorder.request.peak_duration
        )
        whole = {**histories, **interfaces}
        rest = {}
        if bodies:
            rest = self._bodies(recorder.n_kept)
        return {n: whole[n] for n in self.interfaces}, {n: {**bodies, **rest}[n] for n in self.bodies if bodies}

    def _interfaces(
        self, paths: Mapping[str, Array], offset: float, peak_duration: float | None
    ) -> dict[str, InterfaceHistory]:
        """Histories of the interfaces left out, without tractions; ``paths`` : displacements and velocities
        (n_time, 2, 3 n_point) of ``faces``, ``offset`` : time from the instants to the displacements that give the
        gaps, s."""
        histories = {}
        for name, (unit, side) in self.sides.items():
            n_time, geometry = len(paths[name]), unit.geometry
            motion = paths[name].reshape(n_time, 2, geometry.n_point, 3)
            # the motion of E' opens the gap, that of E closes it
            along = np.einsum("tkpc,pc->ktp", motion, geometry.frames[:, 0]) * (2 * side - 1)
            velocity = np.zeros((n_time, 2, geometry.n_point, 3))
            velocity[:, side] = motion[:, 1]
            histories[name] = InterfaceHistory(
                name,
                unit.behaviour.name,
                unit.sides,
                geometry.points,
                geometry.areas,
                geometry.frames[:, 0],
                geometry.gap,
                coulomb_coefficient(unit.behaviour),
                traction=np.zeros((n_time, geometry.n_point, 3)),
                velocity=velocity,
                gap=geometry.gap + along[0] + offset * along[1],
                contact_status=np.full((n_time, geometry.n_point), SEPARATION, dtype=np.int8),
                friction_power=np.zeros(n_time) if unit.behaviour.n_component > 1 else None,
                cells=geometry.cells,
                peak_duration=peak_duration,
            )
        return histories

    def _bodies(self, n_time: int) -> dict[str, SubstructureHistory]:
        """Histories of the bodies left out, whose energies over so many instants are zero."""
        nothing = {term: np.zeros(n_time) for term in TERMS}
        return {
            name: SubstructureHistory(name, i.nodes, i.cells, i.cell_type, np.zeros(0), None, None, None, dict(nothing))
            for name, i in self.info.items()
        }


def touched(histories: Sequence[InterfaceHistory], dt: float) -> bool:
    """Whether an interface left out may have closed at an instant: a gap is not above the way of a step dt, s."""
    for history in histories:
        assert history.gap is not None
        opening = np.diff(history.velocity, axis=1)[:, 0]
        along = np.einsum("tpc,pc->tp", opening, history.normals)
        before = np.concatenate([history.gap[:1], history.gap[:-1]])
        # written so that NaN has touched
        if not (np.minimum(before, history.gap) + dt * np.minimum(along, 0.0) > 0.0).all():
            return True
    return False


def never_touched(
    scene: Scene, bodies: Mapping[str, Body], units: Sequence[InterfaceUnit], traction: float
) -> frozenset[str]:
    """Names of the bodies that probably no other one touches; ``traction`` : largest that the loads can bring, Pa.

    None without inertia or with an explicit scheme, with gravity, temperature, bolts or a static start, where fields or
    reactions are stored, where the histories of the interfaces are thinned or large, and with ``skip_at_rest = "off"``.
    """
    output, time = scene.output, scene.time
    stored = output.keeps_fields or output.stress or output.recovers or output.reactions
    if time.quasi_static or time.scheme.type == CENTRAL or time.start.type == "static" or straining_loads(scene):
        return frozenset()
    if stored or output.interfaces_every > 1 or scene.bolt or scene.solver.skip_at_rest == "off":
        return frozenset()
    if 8 * _NUMBERS * sum(unit.geometry.n_point for unit in units) * (time.n_step + 1) > MOST:
        return frozenset()
    resting = {name for name, body in bodies.items() if _rests(scene, body)}
    if not resting or len(resting) == len(bodies):
        return frozenset()
    way = _Way(scene, bodies, traction)
    for unit in units:
        sides = {name for _, _, name in body_sides([unit])}
        # the normal of the first point: an estimate, which ``touched`` checks after the run
        if not _stays_open(unit, sides, way.along(unit.geometry.frames[0, 0])) or sides <= resting:
            resting -= sides
    return frozenset(resting)


def _rests(scene: Scene, body: Body) -> bool:
    """Whether nothing but its interfaces drives a body, and no output is of it alone."""
    name, described = body.name, body.description
    faces = [load.face for load in scene.loads.values()]
    named = {split_face(face)[0] for face in faces} | {port.body for port in scene.port.values()}
    named |= {sensor.body for sensor in scene.sensor.values()}
    fixed = all(isinstance(b, Fixed | Symmetry) for b in scene.boundaries_of(name).values())
    loaded = any(load.acts_on(name, scene.substructure[name]) for load in scene.body_loads)
    return fixed and name not in named and not described.initial_keys and not loaded


def _stays_open(unit: InterfaceUnit, sides: set[str], way: float) -> bool:
    """Whether an interface of two bodies is a contact with a gap beyond this way, m."""
    contact = isinstance(unit.behaviour, Contact) and not unit.attached and not unit.preload
    return contact and len(sides) == 2 and float(unit.geometry.gap.min()) > way


class _Way:
    """Estimate of the module docstring; ``traction`` : largest that the loads can bring, Pa."""

    def __init__(self, scene: Scene, bodies: Mapping[str, Body], traction: float) -> None:
        time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        self._end, self._speed, self._impulses = scene.time.end, 0.0, list[Array]()
        for load in scene.loads.values():
            mean = load.mean_traction(BodyFace.of(bodies, load.face))
            self._impulses.append(mean * float(np.trapezoid(np.abs(load.law.sample(time)), time)))
        for body in bodies.values():
            described = body.description
            spin = float(np.linalg.norm(described.initial_spin)) * body.mesh.size
            self._speed = max(self._speed, float(np.linalg.norm(described.initial_velocity)) + spin)
        driven = any(isinstance(boundary, Driven) for boundary in scene.boundary.values())
        pushed = bool(scene.body_loads) or any(body.description.initial_fields for body in bodies.values())
        moved = any(i.ground_velocity is not None or i.initial_pressure(1.0) for i in scene.interface.values())
        turned = any(load.turns() for load in scene.loads.values())
        # what has no impulse of its own: as if the largest traction acted from start to end
        if driven or pushed or moved or turned or scene.port:
            self._any = traction * self._end
        else:
            self._any = 0.0
        self._softest = max((1.0 / b.shape.impedances[0] for b in bodies.values() if not b.rigid), default=0.0)
        self._lightest = max(1.0 / (b.shape.material.density * b.mesh.size) for b in bodies.values())

    def along(self, normal: Array) -> float:
        """Largest way along a unit vector (3,), m."""
        impulse = self._any + sum(float(np.linalg.norm(j)) for j in self._impulses)
        pushing = self._any + sum(abs(float(j @ normal)) for j in self._impulses)
        return self._speed * self._end + impulse * self._softest + pushing * self._end * self._lightest
