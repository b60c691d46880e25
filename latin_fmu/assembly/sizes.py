"""Size and mass of the bodies of a scene, and a warning where they are absurd."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from ..fem.elements import rigid_body
from .body import Body

LARGEST, SMALLEST = 10.0, 1e-6
"""Sizes of the largest body, m, beyond which the unit of length is doubtful: a mesh in mm read as metres."""


def mass_of(body: Body) -> float:
    """Mass of a body, kg."""
    return float(rigid_body(body.mesh, body.shape.material.density).mass[0, 0])


def body_lines(bodies: Mapping[str, Body]) -> list[str]:
    """A line per body: size of its bounding box, mass, nodes and cells."""
    lines = []
    for name, body in bodies.items():
        size = " x ".join(f"{length:.4g}" for length in body.mesh.extent())
        kinds: Counter[str] = Counter()
        for block in body.mesh.blocks:
            kinds[block.cell_type] += len(block.cells)
        cells = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        lines.append(f"  body {name}: {size} m, {mass_of(body):.4g} kg, {body.mesh.n_node} nodes, {cells}")
    return lines


def size_remarks(bodies: Mapping[str, Body]) -> list[str]:
    """A warning where the largest body is larger than ``LARGEST`` or smaller than ``SMALLEST``."""
    name, body = max(bodies.items(), key=lambda item: float(item[1].mesh.extent().max()))
    size = float(body.mesh.extent().max())
    if SMALLEST <= size <= LARGEST:
        return []
    told = f"the largest body, {name}, is {size:.4g} m long and has a mass of {mass_of(body):.4g} kg"
    if body.description.mesh is None:
        return [f"{told}: is its size in metres?"]
    scale = body.description.mesh.scale
    return [f"{told}: is scale = {scale:g} the length of a unit of its mesh file in metres (1e-3 for mm)?"]
