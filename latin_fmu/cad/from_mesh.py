"""Parts of a mesh that comes from elsewhere as an assembly: the scene of such a mesh is written as that of a CAD file.

A mesh has no round faces of a known axis and radius, so that screws are possible by their names alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..errors import MeshError, Problem, listed
from ..fem.elements import Elements
from ..fem.faces import face, face_of
from ..fem.mesh import Mesh, boundary
from ..fem.mesh_file import mesh_of
from ..mesh_files.content import MeshContent
from ..scene.schema import toml_value
from ..scene.substructures import part_name
from .facts import Array, CadAssembly, CadPart, Screw, Triple
from .labels import part_order
from .scene_text import SceneSketch, sketch_of
from .screws import is_named_screw
from .step_text import UNITS

_LARGE: Final = 5.0  # units over all, from which on they are taken for mm
_TOUCH: Final = 1e-4  # of the size over all: distance up to which faces touch
_FLAT: Final = 1e-4  # of the size of a part: from the end of its box


def assembly_of_mesh(
    content: MeshContent, file: str, whole: str, unit: str | None = None, chosen: Sequence[str] = ()
) -> CadAssembly:
    """The parts of a mesh file as an assembly; their lengths are in its unit.

    Parameters
    ----------
    content : of the file. file : its name. whole : name of the part of a file without volume groups.
    unit : of length; None: that which the file names, else by the size. chosen : volume groups that are parts;
    empty: those that share the cells.

    Raises
    ------
    MeshError : groups that overlap or have the same name, unusable cells, no solid cells.
    """
    if not content.solids:
        what, holds = "the file holds no solid cells", content.without_solids()
        remedy = "mesh the volume, or extrude a plane mesh"
        raise MeshError([Problem(file, what, holds or None, remedy=remedy)], "unusable mesh")
    groups: list[str | None] = [*(chosen or _groups(content, file))] or [None]
    names = [part_name(group) if group else whole for group in groups]
    if len(set(names)) < len(names):
        twice = [str(group) for group, name in zip(groups, names, strict=True) if names.count(name) > 1]
        what, remedy = "several volume groups give substructures of the same name", "rename them"
        raise MeshError([Problem(file, what, listed(twice), remedy=remedy)], "unusable mesh")
    meshes = {name: mesh_of(content, file, group) for name, group in zip(names, groups, strict=True)}
    parts = [
        _part(name, group, number, meshes[name])
        for number, (name, group) in enumerate(zip(names, groups, strict=True), start=1)
    ]
    said = unit or _named_unit(content)
    length = said or ("mm" if _size(parts) > _LARGE else "m")
    assembly = CadAssembly(file, length, UNITS[length], sorted(parts, key=part_order), guessed=said is None)
    if assembly.guessed:
        assembly.remarks.append(f"the file names no unit: {length} by its size, else --unit")
    assembly.faces = {part.name: list(meshes[part.name].faces) for part in assembly.parts}
    assembly.ends = {name: area for part in parts for name, area in _ends(part, parts, meshes[part.name])}
    assembly.screws = [_possible(part) for part in assembly.parts if is_named_screw(part)]
    sizes = [(mesh.n_cell, mesh.n_node) for mesh in meshes.values()]
    assembly.counts = {"cells": sum(cells for cells, _ in sizes), "nodes": sum(nodes for _, nodes in sizes)}
    assembly.left_out = [f"{problem.what} ({word})" for word, problem in content.refused.items()]
    if content.deck is not None:
        assembly.left_out.append("what the deck says beyond its mesh; latin-fmu import takes it")
    return assembly


def _groups(content: MeshContent, file: str) -> tuple[str, ...]:
    """Groups that are the parts of a file.

    Raises
    ------
    MeshError : they overlap.
    """
    try:
        return content.part_names(file)
    except MeshError as error:
        remedy = "name those that are parts: --part A --part B"
        raise MeshError([replace(problem, remedy=remedy) for problem in error.problems], error.heading) from None


def sketch_of_mesh(
    assembly: CadAssembly, content: MeshContent, name: str, file: str, chosen: Sequence[str] = ()
) -> SceneSketch:
    """The scene of the parts of a mesh; ``file`` : the mesh, relative to the scene. ``chosen`` : groups that are listed
    in it."""
    sketch = sketch_of(assembly, name, file, _TOUCH * _size(assembly.parts))
    lines = [f"parts = {toml_value(list(chosen))}"] if chosen else []
    if content.refused:
        words = toml_value(list(content.refused))
        lines.append(f"ignore = {words}".ljust(40) + "# (?) what of the file is left out")
    if content.deck is not None:
        lines.append("mesh_only = true".ljust(40) + "# else: latin-fmu import")
    return replace(sketch, lines=lines)


def _named_unit(content: MeshContent) -> str | None:
    """Unit of length that a file names, if it is one of ``UNITS``."""
    return next((name for name in (content.unit, content.unit.lower()) if name in UNITS), None)


def _size(parts: Sequence[CadPart]) -> float:
    """Diagonal of the box around all parts."""
    low, high = np.min([part.low for part in parts], axis=0), np.max([part.high for part in parts], axis=0)
    return float(np.linalg.norm(high - low))


def _part(name: str, group: str | None, number: int, mesh: Mesh) -> CadPart:
    """A part from its mesh, without round faces."""
    volume, moment = 0.0, np.zeros(3)
    for _, points in Elements(mesh).points():
        places = np.einsum("pn,cni->cpi", points.values, mesh.nodes[points.cells])
        volume += float(points.volumes.sum())
        moment += np.einsum("cp,cpi->i", points.volumes, places)
    area = float(face_of(mesh.nodes, boundary(mesh)).areas.sum())
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    path = () if group is None else (group,)
    box = _triple(low), _triple(high)
    return CadPart(name, path, number, volume, area, _triple(moment / volume), *box, None, (), np.zeros((0, 3)), 0.0)


def _triple(values: Array) -> Triple:
    x, y, z = values.tolist()
    return x, y, z


def _ends(part: CadPart, parts: Sequence[CadPart], mesh: Mesh) -> Iterator[tuple[str, float]]:
    """Named flat faces at the ends of the box of a part, "part.face", with their areas; those that may touch another
    part, whose box is at theirs, are none."""
    touch, others = 2.0 * _TOUCH * _size(parts), [other for other in parts if other is not part]
    for name, facets in mesh.faces.items():
        places = mesh.nodes[facets.nodes]
        low, high = places.min(axis=0), places.max(axis=0)
        flat = high - low <= _FLAT * part.diagonal
        at_end = np.minimum(low - np.array(part.low), np.array(part.high) - high) <= _FLAT * part.diagonal
        if not (flat & at_end).any():
            continue
        apart = [np.maximum(low - np.array(other.high), np.array(other.low) - high).max() for other in others]
        if all(distance > touch for distance in apart):
            yield f"{part.name}.{name}", float(face(mesh, name).positive_areas.sum())


def _possible(part: CadPart) -> Screw:
    why = "by its name; a mesh does not tell its shank and its thread"
    return Screw(part.name, False, "screw", why, 0.0)
