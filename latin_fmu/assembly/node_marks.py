"""Marks on the nodes of the bodies for pictures and tables of their fields: supports, edges of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..fem.footprints import near_rims
from ..fem.mesh import Index
from ..latin.assembly import InterfaceUnit
from ..latin.outcome import NodeMarks
from ..scene.boundaries import AXES, Driven, Fixed
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import Body


def node_marks(scene: Scene, bodies: Mapping[str, Body], units: Sequence[InterfaceUnit]) -> dict[str, NodeMarks]:
    """Marks by elastic body. A support is a boundary that fixes or drives all three components of a face; planes of
    symmetry and rollers leave no edge in the stress, and do not move."""
    supports: dict[str, list[Index]] = {name: [] for name, body in bodies.items() if not body.rigid}
    contacts: dict[str, list[Index]] = {name: [] for name in supports}
    for boundary in scene.boundary.values():
        if isinstance(boundary, Fixed | Driven) and len(boundary.components) == len(AXES):
            name, face = split_face(boundary.face)
            if name in supports:
                supports[name].append(bodies[name].nodes_of(face))
    for unit in units:
        for side, trace in zip(unit.sides, unit.geometry.traces, strict=True):
            name = split_face(side)[0]
            if trace is not None and name in contacts:
                # three dofs a node
                contacts[name].append(np.unique(trace.indices // len(AXES)).astype(np.int64))
    marks = {}
    for name, held in supports.items():
        mesh = bodies[name].mesh
        support = np.zeros(mesh.n_node, dtype=bool)
        support[np.concatenate([np.zeros(0, dtype=np.int64), *held])] = True
        marks[name] = NodeMarks(support, near_rims(mesh, [*contacts[name], *held]))
    return marks
