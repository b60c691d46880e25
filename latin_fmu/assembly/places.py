"""Places on bodies, where sensors, ports, point masses, springs and couplings are: a point of the solid, the mean over
a face, or a point on a rigid arm that follows the mean motion of a face (``fem.location.MeanMotion``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import Problems, shown
from ..fem.faces import Face
from ..fem.location import Location, MeanMotion, locate, nearest_surface_point
from ..fem.mesh import Array
from ..latin.probes import SensorPlace
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import Body


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
        side: float = float(self.body.shape.elements.volume.mean()) ** (2 / 3)
        return side


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
    return PlaceOnFace(motion.centre if point is None else np.asarray(point, dtype=float), motion, body, face)


def place_on(
    body: Body, face: str | None, point: Sequence[float] | None, where: str, problems: Problems
) -> PlaceOnBody | None:
    """The place that a face, a point or both describe; None, with a problem at the key ``where``, for a point outside
    the body."""
    if face is not None:
        return place_on_face(body, face, point)
    at = np.asarray(point, dtype=float)
    location = _located(body, at, f"{where}.point", problems)
    return None if location is None else PlaceOnBody(at, MeanMotion.of_point(at, location, body.mesh.n_node), body)


def _located(body: Body, point: Array, where: str, problems: Problems) -> Location | None:
    """A point (3,), m, in terms of the nodes of a body; None, with a problem at the key ``where``, outside it."""
    location = locate(body.mesh, point)
    if location is not None:
        return location
    distance, near = nearest_surface_point(body.mesh, point)
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
