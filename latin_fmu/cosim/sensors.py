"""Where the sensors of a scene sit on its meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from ..fem.mesh import nearest
from ..latin.record import Array, SubstructureHistory
from ..latin.recorder import SubstructureInfo
from ..scene.schema import Scene

Places = dict[str, tuple[str, int]]
"""Substructure and node by sensor."""


def places_of(scene: Scene, info: Mapping[str, SubstructureInfo]) -> Places:
    """The node nearest to the point of each sensor."""
    places = {}
    for name, sensor in scene.sensor.items():
        _, node = nearest(np.asarray([sensor.point]), info[sensor.substructure].nodes)
        places[name] = (sensor.substructure, int(node[0]))
    return places


def motion_now(
    places: Places, displacement: Callable[[str], Array], velocity: Callable[[str], Array]
) -> list[tuple[Array, Array]]:
    """Displacement and velocity (1, 3) of every sensor at the present time."""
    return [(displacement(body)[None, node], velocity(body)[None, node]) for body, node in places.values()]


def nodes_of(places: Places) -> dict[str, NDArray[np.int64]]:
    """Nodes with a sensor, by substructure."""
    bodies = {body for body, _ in places.values()}
    return {body: np.unique([node for b, node in places.values() if b == body]) for body in sorted(bodies)}


def motion_of(
    places: Places, histories: Mapping[str, SubstructureHistory], nodes: Mapping[str, NDArray[np.int64]] | None
) -> list[tuple[Array, Array]]:
    """Displacement and velocity (n_time, 3) of every sensor from stored fields, those of ``nodes`` or of all."""
    found = []
    for body, node in places.values():
        displacement, velocity = histories[body].displacement, histories[body].velocity
        assert displacement is not None
        assert velocity is not None
        place = node if nodes is None else int(np.searchsorted(nodes[body], node))
        found.append((displacement[:, place], velocity[:, place]))
    return found
