"""Bodies: meshes and matrices of the substructures of a scene, shared where shape and material are equal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from ..errors import MeshError, Problem
from ..fem.elasticity import BENDING_CELLS, body_load, lumped_mass, mass, stiffness, wave_speeds
from ..fem.elements import Elements, rigid_body
from ..fem.faces import Face, face_of
from ..fem.mesh import Array, FacetSet, Mesh, boundary, box_mesh, nested_dissection
from ..fem.stress import MeanStress, Recovery
from ..fem.surface import Surface
from ..scene.fields import ALL_OF_IT
from ..scene.materials import Material
from ..scene.schema import Scene
from ..scene.substructures import MeshFile, Substructure

if TYPE_CHECKING:
    from ..mesh_files.content import MeshContent


class Shape:
    """Mesh and unit-material matrices, computed once per shape and material."""

    def __init__(self, mesh: Mesh, material: Material, bending_modes: bool = False) -> None:
        self.mesh, self.material, self.bending_modes = mesh, material, bending_modes

    @cached_property
    def elements(self) -> Elements:
        """Elements of the mesh."""
        return Elements(self.mesh)

    @cached_property
    def mass(self) -> sp.csr_array:
        """Mass (3 n_node, 3 n_node), assembled where it is asked for."""
        return mass(self.elements, self.material.density)

    @cached_property
    def lumped_mass(self) -> Array | None:
        """Positive masses (3 n_node,) where the row sums of the mass are not, else None."""
        found = lumped_mass(self.elements, self.material.density)
        return None if found is None else np.repeat(found, 3)

    @cached_property
    def stiffness(self) -> sp.csr_array:
        """Stiffness (3 n_node, 3 n_node)."""
        m = self.material
        return stiffness(self.elements, m.young_modulus, m.poisson_ratio, self.bending_modes)

    @cached_property
    def rank(self) -> Array:
        """Elimination rank of the full dofs."""
        return np.repeat(nested_dissection(self.mesh), 3)

    @cached_property
    def stress(self) -> MeanStress:
        """Stress recovery: displacements (n_node, 3) to mean stress (n_cell, 6), Pa."""
        m = self.material
        return MeanStress(self.elements, m.young_modulus, m.poisson_ratio)

    @cached_property
    def recovery(self) -> Recovery:
        """Strains of the elements and stresses at the nodes from displacements."""
        m = self.material
        return Recovery(self.elements, m.young_modulus, m.poisson_ratio, self.bending_modes)

    def body_load(self, force: Array) -> Array:
        """Nodal forces (3 n_node,) of a uniform body force, N."""
        return body_load(self.elements, force)

    @property
    def impedances(self) -> tuple[float, float]:
        """(rho c_p, rho c_s), Pa s m-1."""
        m = self.material
        c_p, c_s = wave_speeds(m.young_modulus, m.poisson_ratio, m.density)
        return m.density * c_p, m.density * c_s


@dataclass(frozen=True)
class Body:
    """One substructure: its shape, where it stands, its faces as they are asked for."""

    name: str
    mesh: Mesh
    shape: Shape
    description: Substructure

    @cached_property
    def outside(self) -> FacetSet:
        """All boundary facets."""
        return boundary(self.mesh)

    def facets(self, name: str) -> FacetSet:
        """Facets of a named face; "*" is the whole boundary."""
        return self.outside if name == ALL_OF_IT else self.mesh.faces[name]

    def face(self, name: str) -> Face:
        """Nodal integrals of a face."""
        return face_of(self.mesh.nodes, self.facets(name))

    def surface(self, name: str) -> Surface:
        """A face as flat pieces."""
        return Surface(self.mesh.nodes, self.facets(name))

    @property
    def rigid(self) -> bool:
        """Whether the substructure is undeformable."""
        return self.description.rigid

    def initial_velocity(self) -> Array:
        """Velocity of the nodes at t = 0, (3 n_node,), m s-1."""
        description = self.description
        velocity = np.tile(np.asarray(description.initial_velocity, dtype=float), (self.mesh.n_node, 1))
        if any(description.initial_spin):
            arm = self.mesh.nodes - rigid_body(self.mesh, self.shape.material.density).centre
            velocity += np.cross(np.asarray(description.initial_spin), arm)
        return velocity.ravel()

    def full_size(self) -> int:
        """Number of dofs of the nodes."""
        return 3 * self.mesh.n_node


class _MeshFiles:
    """Mesh files of a scene: each is read once, and what is wrong with it is said once."""

    def __init__(self) -> None:
        self._contents: dict[Path, MeshContent | None] = {}
        self._said: set[Problem] = set()

    def mesh(self, name: str, table: MeshFile, base_dir: Path, problems: list[Problem]) -> Mesh | None:
        """Mesh of a substructure; None where it cannot be had, with its problems told unless they were before."""
        from ..fem.mesh_file import mesh_of
        from ..mesh_files.reading import read_content

        path = base_dir / table.file
        try:
            if path not in self._contents:
                self._contents[path] = None
                self._contents[path] = read_content(path)
            content = self._contents[path]
            return None if content is None else mesh_of(content, path.name, table.group, table.scale)
        except MeshError as error:
            fresh = [p for p in error.problems if p not in self._said]
            self._said.update(fresh)
            where = f"substructure.{name}.mesh"
            problems += [Problem(where, f"{p.where}: {p.what}", p.value, p.allowed, p.remedy) for p in fresh]
            return None


def build_bodies(scene: Scene, problems: list[Problem]) -> dict[str, Body]:
    """Bodies of every substructure whose mesh can be had; what is wrong with others goes to ``problems``."""
    bodies: dict[str, Body] = {}
    shapes: dict[tuple[object, ...], Shape] = {}
    files = _MeshFiles()
    for name, description in scene.substructure.items():
        material = scene.material[description.material]
        if description.box is not None:
            box = description.box
            key: tuple[object, ...] = (box.size, box.elements, material, description.bending_modes)
            mesh = box_mesh(np.asarray(box.origin), np.asarray(box.size), box.elements)
            if key not in shapes:
                unit = box_mesh(np.zeros(3), np.asarray(box.size), box.elements)
                shapes[key] = Shape(unit, material, description.bending_modes)
            bodies[name] = Body(name, mesh, shapes[key], description)
        elif description.mesh is not None:
            found = files.mesh(name, description.mesh, scene.base_dir, problems)
            if found is None:
                continue
            mesh = found
            if description.bending_modes and not set(BENDING_CELLS) & set(mesh.cell_types):
                problems.append(
                    Problem(
                        f"substructure.{name}.bending_modes",
                        "the mesh has no 8-node hexahedra",
                        ", ".join(mesh.cell_types),
                        remedy="leave the key out",
                    )
                )
            shape = Shape(mesh, material, description.bending_modes)
            bodies[name] = Body(name, mesh, shape, description)
    return bodies
