"""Sizes of the bodies of a run, for its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .groups import StoredGroup
from .quantities import AXES, LABELS, MODEL, named


@dataclass(frozen=True)
class BodySize:
    """Size of a body and of its mesh.

    Attributes
    ----------
    extent : of its bounding box along x, y, z, m. volume : m3. mass : kg, point masses included. nodes : their number.
    cells : number of elements by type.
    """

    extent: tuple[float, ...]
    volume: float
    mass: float
    nodes: int
    cells: Mapping[str, int]

    @property
    def cell_types(self) -> str:
        """Number of elements by type, in words."""
        return ", ".join(f"{count} {kind}" for kind, count in self.cells.items())


def model_group(bodies: Mapping[str, BodySize]) -> StoredGroup:
    """Group ``model``: one entry a body."""
    of = list(bodies.values())
    fields = {
        "mass": np.array([body.mass for body in of]),
        "volume": np.array([body.volume for body in of]),
        "extent": np.array([body.extent for body in of]),
        "node_count": np.array([body.nodes for body in of], dtype=np.int32),
        "cell_count": np.array([sum(body.cells.values()) for body in of], dtype=np.int32),
        "cell_types": np.array([body.cell_types for body in of], dtype=object),
    }
    return StoredGroup.of(named(MODEL, fields), named(LABELS, {"substructure": list(bodies), "component": AXES}))
