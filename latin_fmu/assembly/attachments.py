"""Places on bodies; point masses, springs and couplings there: mass matrices and interfaces.

A place, of a sensor or a port, too, is a point of the solid, the mean over a face, or a point on a rigid arm that
follows the mean motion of a face (``fem.location.MeanMotion``). With T the motion of the place and R the rotation of
the mean motion of its face the kinetic energy of a mass m with the moments of inertia J gives

    M = m T^T T + R^T J R

A mass spread evenly over a face has its share of it at every node.

A spring is an interface with one point: the traces of its sides are the motions T of its ends, its laws those of a
bonded layer. Its area, that of the face or of the side of an element, only scales tractions to those of other
interfaces: the stiffness of the whole is kept.

A distributing coupling joins two rigid motions by six rods, two along each axis, that stand off the common point p by a
length l: their elongations are the relative translation and rotation,

    (u + theta x l e_j) . e_i,   (u - theta x l e_j) . e_i,      j next after i among x, y, z

so that the forces of the rods are statically determinate and give the force and the moment of the coupling. A point of
a solid has no rotation: it is joined by its three translations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..errors import Problems, shown
from ..fem.faces import Face
from ..fem.location import Location, MeanMotion, locate, nearest_surface_point
from ..fem.mesh import Array, Index
from ..interface import BEHAVIOURS, Behaviour, InterfaceGeometry, Perfect, Rods
from ..interface.geometry import local_frames
from ..latin.assembly import InterfaceUnit
from ..latin.probes import SensorPlace
from ..propagator.model import diagonal_matrix
from ..scene.attachments import End, PointMass
from ..scene.fields import ALL_OF_IT, split_face
from ..scene.interfaces import PARAMETERS, TAKES, Interface
from ..scene.schema import Scene
from .body import AddedMass, Body, RigidFace


@dataclass(frozen=True)
class PlaceOnBody:
    """A place on a body, or on the ground.

    Attributes
    ----------
    point : (3,), m; of a face without a point its centre. motion : that the place follows, None on the ground.
    body : None for the ground. face : integrals over the face, None for a point of the solid and for the ground.
    """

    point: Array
    motion: MeanMotion | None = None
    body: Body | None = None
    face: Face | None = None

    @property
    def area(self) -> float:
        """Area of the face, else of the side of an element of mean volume, m2; infinite on the ground."""
        if self.body is None:
            return np.inf
        if self.face is not None:
            return float(self.face.areas.sum())
        side: float = float(self.body.shape.elements.volume.mean()) ** (2 / 3)  # of a cube
        return side

    def trace_at(self, *points: Array) -> sp.csr_array | None:
        """Velocities of the body at the points (3,), (3 n_point, 3 n_node); None of the ground."""
        if self.motion is None:
            return None
        return sp.csr_array(sp.vstack([self.motion.at(point) for point in points]))


@dataclass(frozen=True)
class PlaceOnFace(PlaceOnBody):
    """The mean over a face, or a point on an arm from it."""

    motion: MeanMotion
    body: Body
    face: Face

    @property
    def arms(self) -> Array:
        """Nodes of the face from its centre, (n, 3), m."""
        return self.body.mesh.nodes[self.face.nodes] - self.motion.centre


def place_on_face(body: Body, name: str, point: Sequence[float] | None = None) -> PlaceOnFace:
    """The mean over a face ``"substructure.face"`` of a body, or a point (3,), m, on an arm from it."""
    face = body.face(split_face(name)[1])
    motion = MeanMotion.of_face(body.mesh.nodes, face)
    if point is None:
        place = motion.centre
    else:
        place = np.asarray(point, dtype=float)
    return PlaceOnFace(place, motion, body, face)


def place_on(
    body: Body, face: str | None, point: Sequence[float] | None, where: str, problems: Problems
) -> PlaceOnBody | None:
    """The place that a face, a point or both describe; None, with a problem at the key ``where``, for a point outside
    the body."""
    if face is not None:
        return place_on_face(body, face, point)
    at = np.asarray(point, dtype=float)
    location = _located(body, at, f"{where}.point", problems)
    if location is None:
        return None
    return PlaceOnBody(at, MeanMotion.of_point(at, location, body.mesh.n_node), body)


def _located(body: Body, point: Array, where: str, problems: Problems) -> Location | None:
    """A point (3,), m, in terms of the nodes of a body; None, with a problem at the key ``where``, outside it."""
    location = locate(body.mesh, point)
    if location is not None:
        return location
    distance, near = nearest_surface_point(body.surface(ALL_OF_IT), point)
    at = ", ".join(f"{x:.6g}" for x in near)
    problems.add(
        where,
        f"the point is outside {body.name}, {distance:.4g} {body.units['m']} from its surface",
        shown(point.tolist()),
        "a point in or on the body",
        f"the nearest point of the surface is [{at}]",
    )
    return None


def mean_over(body: Body, name: str) -> Location:
    """Mean over a face ``"substructure.face"`` by area; nodes without a share of it are left out."""
    face = body.face(split_face(name)[1])
    return Location.of(face.nodes, face.areas / face.areas.sum())


def sensor_places(scene: Scene, bodies: Mapping[str, Body], problems: Problems) -> dict[str, SensorPlace]:
    """Places of the sensors of a scene; a point outside its body is added to ``problems``."""
    places = {}
    for name, sensor in scene.sensor.items():
        body = bodies[sensor.body]
        if sensor.face is not None and sensor.point is None:
            mean = mean_over(body, sensor.face)
            centre = mean.weights @ body.mesh.nodes[mean.nodes]
            places[name] = SensorPlace(sensor.body, mean.rows(body.mesh.n_node), centre, sensor.face)
        elif at := place_on(body, sensor.face, sensor.point, f"sensor.{name}", problems):
            assert at.motion is not None
            places[name] = SensorPlace(sensor.body, at.motion.at(at.point), at.point, sensor.face)
    return places


_NONE: Index = np.zeros(0, dtype=np.int64)
_TIME: Final = "relaxation_time"  # the parameter that is not per area
_TOGETHER = 1e-9  # of the size of an end: ends closer to each other have no direction


def with_masses(scene: Scene, bodies: dict[str, Body], problems: Problems) -> dict[str, Body]:
    """The bodies with the point masses of the scene; points outside their bodies are added to ``problems``."""
    added: dict[str, list[AddedMass]] = {}
    for name, mass in scene.point_mass.items():
        body = bodies[mass.body]
        if mass.spread:
            added.setdefault(mass.body, []).append(_spread(body, mass))
            continue
        at_place = _at_place(body, mass, f"point_mass.{name}", problems)
        if at_place is not None:
            added.setdefault(mass.body, []).append(at_place)
    return bodies | {n: replace(bodies[n], added=_sum(masses)) for n, masses in added.items()}


def _spread(body: Body, mass: PointMass) -> AddedMass:
    """A mass spread evenly over a face."""
    face = body.face(split_face(str(mass.face))[1])
    nodal = np.zeros(body.mesh.n_node)
    # positive: corners of quadratic facets may have negative areas
    nodal[face.nodes] = mass.mass * face.positive_areas / face.positive_areas.sum()
    lumped = np.repeat(nodal, 3)
    return AddedMass(diagonal_matrix(lumped), lumped, _NONE)


def _at_place(body: Body, mass: PointMass, where: str, problems: Problems) -> AddedMass | None:
    """A mass at a point of the body, or of an arm on a face."""
    place = place_on(body, mass.face, mass.point, where, problems)
    if place is None or place.motion is None:
        return None
    at = place.motion.at(place.point)
    # u = A d of the place: M = A^T m A
    matrix = sp.csr_array(mass.mass * (at.T @ at))
    lumped, rotation = np.zeros(body.full_size()), place.motion.rotation
    if rotation is None:
        weights = np.maximum(at.sum(axis=0), 0.0)  # functions of quadratic cells have negative values
        # weights of all three components add up to 3: each component has the whole mass
        return AddedMass(matrix, 3.0 * mass.mass * weights / weights.sum(), _NONE)
    if mass.inertia is not None:
        matrix = sp.csr_array(matrix + rotation.T @ sp.diags_array(np.asarray(mass.inertia)) @ rotation)
    return AddedMass(matrix, lumped, np.unique(at.indices // 3).astype(np.int64))


def _sum(masses: list[AddedMass]) -> AddedMass:
    """All masses of one body."""
    matrix = sp.csr_array(sum((m.matrix for m in masses[1:]), masses[0].matrix))
    matrix.sort_indices()
    # sums of SciPy may have indices of 32 bits, the factors take 64
    matrix.indices, matrix.indptr = matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
    lumped: Array = np.sum([m.lumped for m in masses], axis=0)
    return AddedMass(matrix, lumped, np.unique(np.concatenate([m.arms for m in masses])))


def spring_units(scene: Scene, bodies: dict[str, Body], problems: Problems) -> list[InterfaceUnit]:
    """Interfaces that stand for the springs of a scene (``Scene.joints``); bad places are added to ``problems``."""
    units = []
    for name, spring in scene.spring.items():
        where = f"spring.{name}"
        ends = [_end(bodies, end, f"{where}.ends[{i}]", problems) for i, end in enumerate(spring.ends)]
        first, second = ends
        if first is None or second is None:
            continue
        if spring.direction is None:
            line = second.point - first.point
        else:
            line = np.asarray(spring.direction)
        length = float(np.abs(line).max())  # squares of a direction may over- or underflow
        if spring.direction is None and length <= _TOGETHER * np.sqrt(first.area):
            what = "the ends are at the same place, so that the spring has no direction"
            problems.add(where, what, f"{length:.4g} {scene.unit_system['m']} apart", remedy="give direction")
            continue
        # the ground is infinite: the area is that of the body
        area = min(end.area for end in ends if end is not None)
        frames = local_frames((line / length)[None])
        traces = first.trace_at(first.point), second.trace_at(second.point)
        assert traces[0] is not None
        geometry = InterfaceGeometry(
            first.point[None], np.array([area]), frames, np.zeros(1), (traces[0], traces[1]), 0, False
        )
        units += [
            InterfaceUnit(n, interface.sides, _law(interface, area), geometry, 0.0, where)
            for n, interface in spring.interfaces(name).items()
        ]
    return units


def coupling_units(scene: Scene, bodies: dict[str, Body], problems: Problems) -> list[InterfaceUnit]:
    """Interfaces that stand for the couplings of a scene; bad places are added to ``problems``."""
    units = []
    for name, coupling in scene.coupling.items():
        if len(coupling.ends) < 2:
            continue  # it joins nothing, and may be an edge or a point, which have no place
        where = f"coupling.{name}"
        ends = [_end(bodies, end, f"{where}.ends[{i}]", problems) for i, end in enumerate(coupling.ends)]
        faces = [end for end in ends if end is not None]
        if len(faces) < 2:
            continue
        (interface,) = coupling.interfaces(name).values()
        # a point of a solid has no arm: it has to be the common point
        solid = [end for end in faces if end.motion is not None and end.motion.rotation is None]
        point = (solid or faces)[0].point
        # the size of the face: rotations lengthen the rods by as much as translations
        length = max(end.motion.radius for end in faces if end.motion is not None)
        area = min(end.area for end in faces)
        if coupling.rotations and not solid:
            geometry = _rods(faces, point, length, area)
            unit = InterfaceUnit(name, interface.sides, Rods(), geometry, 0.0, where)
        else:
            geometry = _ball_joint(faces, point, area)
            unit = InterfaceUnit(name, interface.sides, Perfect(), geometry, 0.0, where)
        units.append(unit)
    return units


def _ball_joint(ends: list[PlaceOnBody], point: Array, area: float) -> InterfaceGeometry:
    """One point (3,), m, whose translations are joined."""
    first, second = (end.trace_at(point) for end in ends)
    assert first is not None
    return InterfaceGeometry(
        point[None], np.array([area]), local_frames(np.eye(3)[:1]), np.zeros(1), (first, second), 0, False
    )


def _rods(ends: list[PlaceOnBody], point: Array, length: float, area: float) -> InterfaceGeometry:
    """Six rods about a point (3,), m (module docstring)."""
    axes = np.eye(3)
    directions = np.repeat(axes, 2, axis=0)
    # two points for each axis i, on either side of p along the next axis
    points = point + length * np.stack([s * axes[(i + 1) % 3] for i in range(3) for s in (1.0, -1.0)])
    traces = [end.trace_at(*points) for end in ends]
    assert traces[0] is not None
    return InterfaceGeometry(
        points, np.full(6, area / 6), local_frames(directions), np.zeros(6), (traces[0], traces[1]), 0, False
    )


def with_rigid_faces(scene: Scene, bodies: dict[str, Body]) -> dict[str, Body]:
    """The bodies with the faces that couplings make rigid; every face of a rigid body is so already."""
    faces: dict[str, list[RigidFace]] = {}
    for coupling in scene.coupling.values():
        for end in coupling.ends if coupling.rigid else ():
            if end.face is not None and not bodies[end.body].rigid:
                rigid = RigidFace(split_face(end.face)[1], coupling.components)
                faces.setdefault(end.body, []).append(rigid)
    return {n: replace(b, rigid_faces=tuple(dict.fromkeys(faces.get(n, ())))) for n, b in bodies.items()}


def _end(bodies: dict[str, Body], end: End, where: str, problems: Problems) -> PlaceOnBody | None:
    """The place of an end of a spring or coupling; None, with a problem, where it has none."""
    if end.against_ground:
        if end.point is None:
            place = np.zeros(3)
        else:
            place = np.asarray(end.point, dtype=float)
        return PlaceOnBody(place)
    return place_on(bodies[end.body], end.face, end.point, where, problems)


def _law(interface: Interface, area: float) -> Behaviour:
    """The layer that has the stiffness, or viscosity, of the whole on this area, m2."""
    keys = TAKES[interface.behaviour]
    values = {key: getattr(interface, key) / area for key in PARAMETERS if key in keys and key != _TIME}
    if _TIME in keys:
        values |= {_TIME: interface.relaxation_time}
    return BEHAVIOURS[interface.behaviour](**values)
