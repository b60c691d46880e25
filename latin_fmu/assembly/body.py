"""Bodies: meshes and matrices of the substructures of a scene, shared where shape and material are equal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy.sparse as sp

from ..errors import MeshError, Problem, Problems
from ..fem.dissection import dissection
from ..fem.elasticity import Elasticity, Isotropic, Orthotropic
from ..fem.elements import (
    BENDING_CELLS,
    Elements,
    MeanStress,
    Recovery,
    RigidBody,
    body_load,
    lumped_mass,
    mass,
    rigid_body,
    stiffness,
)
from ..fem.faces import Face, Surface, face_of, nodal_values
from ..fem.mesh import Array, FacetSet, Index, Mesh, boundary, box_mesh, nearest
from ..fem.reference_cells import REDUCED_CELLS, UNIFORM_CELLS
from ..latin.assembly import InterfaceUnit, Layout
from ..remarks import Remark
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.initial_fields import DISPLACEMENT_FIELDS, VELOCITY_FIELDS, DisplacementFile, Gradient, VelocityFile
from ..scene.materials import MaterialTable
from ..scene.schema import Scene
from ..scene.substructures import MeshFile, Substructure
from ..scene.unit_texts import unit_size
from ..scene.units import SI, UnitSystem
from ..time_scheme import MaxwellBranches

if TYPE_CHECKING:
    from ..mesh_files.content import MeshContent


_OF_MOTION: Final = (
    "rigid",
    "initial_velocity",
    "initial_spin",
    "initial_displacement",
    *VELOCITY_FIELDS,
    *DISPLACEMENT_FIELDS,
    "body_force",
    "body_force_law",
)
"""Keys of a substructure that its mesh and its matrices do not depend on."""


def elasticity_of(material: MaterialTable) -> Elasticity:
    """Elasticity of a material of the scene."""
    orthotropic = material.orthotropic
    if orthotropic is None:
        assert material.poisson_ratio is not None, "material_problems"
        alpha = material.thermal_expansion or 0.0
        return Isotropic(material.density, material.young_moduli[0], material.poisson_ratio, expansions=(alpha,) * 3)
    constants = orthotropic.young_moduli, orthotropic.poisson_ratios, orthotropic.shear_moduli
    axes = []
    if orthotropic.axes is not None:
        axes = [orthotropic.axes.rows]
    alphas = orthotropic.thermal_expansions or (0.0, 0.0, 0.0)
    return Orthotropic(material.density, *constants, *axes, expansions=alphas)


def branches_of(material: MaterialTable) -> MaxwellBranches:
    """Maxwell branches of the damping of a material."""
    damping = material.damping
    return MaxwellBranches(damping.strengths, damping.times)


def fast_elasticity_of(material: MaterialTable) -> Elasticity:
    """Elasticity that fronts of waves meet, of a material of the scene: that of its branches before they relax."""
    return elasticity_of(material).stiffened(branches_of(material).instantaneous)


class Shape:
    """Mesh and unit-material matrices, computed once per shape and material."""

    def __init__(
        self, mesh: Mesh, material: MaterialTable, bending_modes: bool = False, moduli: Array | None = None
    ) -> None:
        self.mesh = mesh
        self.material = material
        self.bending_modes = bending_modes
        self.moduli = moduli
        """Moduli (n_cell,) over that of the material; None where all are 1."""

    def of(self, material: MaterialTable) -> Shape:
        """The shape with another material; what the mesh alone gives is shared."""
        shape = Shape(self.mesh, material, self.bending_modes, self.moduli)
        shape.__dict__.update(elements=self.elements, rank=self.rank)
        return shape

    @cached_property
    def elasticity(self) -> Elasticity:
        """Elasticity of the material."""
        return elasticity_of(self.material)

    @cached_property
    def fast_elasticity(self) -> Elasticity:
        """Elasticity that fronts of waves meet."""
        return fast_elasticity_of(self.material)

    @cached_property
    def elements(self) -> Elements:
        """Elements of the mesh."""
        return Elements(self.mesh, self.moduli)

    @cached_property
    def mass(self) -> sp.csr_array:
        """Consistent mass (3 n_node, 3 n_node), kg."""
        return mass(self.elements, self.material.density)

    @cached_property
    def lumped_mass(self) -> Array | None:
        """Positive masses (3 n_node,) where the row sums of the mass are not, else None."""
        nodal = lumped_mass(self.elements, self.material.density)
        if nodal is None:
            return None
        return np.repeat(nodal, 3)

    @cached_property
    def stiffness(self) -> sp.csr_array:
        """Stiffness (3 n_node, 3 n_node), N m-1."""
        return stiffness(self.elements, self.elasticity, self.bending_modes)

    @cached_property
    def thermal_load(self) -> Array:
        """Nodal forces (3 n_node,), N K-1, of a change of temperature, int B^T C alpha dV: those of the displacements
        alpha x of free expansion, which the elements hold exactly."""
        arms = self.mesh.nodes - self.mesh.nodes.mean(axis=0)
        return np.asarray(self.stiffness @ (arms @ self.elasticity.expansion).ravel())

    @cached_property
    def rank(self) -> tuple[Array, Array]:
        """Elimination rank of the full dofs, and the rank behind the part of the dissection that each belongs to."""
        rank, behind = dissection(self.mesh)
        return np.repeat(rank, 3), np.repeat(behind, 3)

    @cached_property
    def stress(self) -> MeanStress:
        """Stress recovery: displacements (n_node, 3) to mean stress (n_cell, 6), Pa."""
        return MeanStress(self.elements, self.elasticity)

    @cached_property
    def recovery(self) -> Recovery:
        """Strains of the elements and stresses at the nodes from displacements."""
        return Recovery(self.elements, self.elasticity, self.bending_modes)

    def body_load(self, force: Array) -> Array:
        """Nodal forces (3 n_node,), N, of a body force, N m-3: uniform (3,), or its values at the nodes (n_node, 3)."""
        return body_load(self.elements, force)

    @property
    def impedances(self) -> tuple[float, float]:
        """(rho c_p, rho c_s), Pa s m-1, of the fastest and of the slowest wave."""
        c_p, c_s = self.fast_elasticity.wave_speeds
        return self.material.density * c_p, self.material.density * c_s


@dataclass(frozen=True)
class AddedMass:
    """Point masses on a body.

    Attributes
    ----------
    matrix : (3 n_node, 3 n_node), kg. lumped : (3 n_node,) the same at the nodes, all >= 0, kg, but for masses with an
        arm or inertia, which masses at nodes do not represent. arms : nodes of the faces that these follow.
    """

    matrix: sp.csr_array
    lumped: Array
    arms: Index


@dataclass(frozen=True)
class RigidFace:
    """A face or node set whose nodes move as those of a rigid body.

    Attributes
    ----------
    face : its name on the body. components : motions, out of x, y, z and the rotations rx, ry, rz, that the nodes have
    along the axes that are named; along the other axes they are free.
    """

    face: str
    components: tuple[str, ...]


@dataclass(frozen=True)
class Body:
    """One substructure: its mesh in its place, shape (shared by equal bodies), faces, point masses, rigid faces."""

    name: str
    mesh: Mesh
    shape: Shape
    description: Substructure
    added: AddedMass | None = None
    rigid_faces: tuple[RigidFace, ...] = ()
    units: UnitSystem = SI
    """Of the scene, for messages."""
    touching: str = ALL_OF_IT
    """Face that takes part in searches for contacts: all of it, but for the free shanks of screws."""

    @cached_property
    def mass(self) -> sp.csr_array:
        """Consistent mass with the point masses (3 n_node, 3 n_node), kg. Times a uniform acceleration it is the load
        of gravity or of a moving frame."""
        return self.with_added(self.shape.mass)

    def with_added(self, mass: sp.csr_array) -> sp.csr_array:
        """A mass of the mesh (3 n_node, 3 n_node), kg, with that of the point masses."""
        if self.added is None:
            return mass
        return sp.csr_array(mass + self.added.matrix)

    @cached_property
    def lumped_mass(self) -> Array | None:
        """Positive masses (3 n_node,), kg, where the row sums of the mass do not serve, else None."""
        masses = self.shape.lumped_mass
        if self.added is None:
            return masses
        # row sums of the mass, whose components do not couple
        if masses is None:
            masses = self.shape.mass @ np.ones(self.full_size())
        return np.asarray(masses + self.added.lumped)

    @cached_property
    def rigid_motions(self) -> RigidBody:
        """Rigid motions about the mass centre and their mass, point masses included."""
        plain = rigid_body(self.mesh, self.shape.material.density)
        if self.added is None:
            return plain
        return plain.with_mass(self.mesh.nodes, self.added.matrix)

    @cached_property
    def outside(self) -> FacetSet:
        """All boundary facets."""
        return boundary(self.mesh)

    def facets(self, name: str) -> FacetSet:
        """Facets of a named face; "*" is the whole boundary."""
        if name == ALL_OF_IT:
            return self.outside
        return self.mesh.faces[name]

    @cached_property
    def _faces(self) -> dict[str, Face]:
        """Faces found before: several checks need the same one, and every point of a study."""
        return {}

    def nodes_of(self, name: str) -> Index:
        """Nodes of a named face, with the edges and points of its name; "*" is the whole boundary."""
        if name == ALL_OF_IT:
            return self.outside.nodes
        return self.mesh.nodes_of(name)

    def face(self, name: str) -> Face:
        """Nodal integrals of a face."""
        if name not in self._faces:
            self._faces[name] = face_of(self.mesh.nodes, self.facets(name))
        return self._faces[name]

    def surface(self, name: str) -> Surface:
        """A face as flat pieces."""
        return Surface(self.mesh.nodes, self.facets(name))

    def of(self, description: Substructure, material: MaterialTable) -> bool:
        """Whether a substructure of this description and material has this mesh and these matrices."""
        described = self.description
        # with what motion alone reads taken from the other: equal descriptions are equal meshes and matrices
        alike = description.model_copy(update={key: getattr(described, key) for key in _OF_MOTION})
        return self.shape.material == material and alike == described

    def described(self, description: Substructure, shape: Shape, units: UnitSystem) -> Body:
        """The body on the same mesh by another description or shape; its faces are shared."""
        body = Body(self.name, self.mesh, shape, description, units=units)
        body.__dict__["_faces"] = self._faces
        return body

    @property
    def rigid_nodes(self) -> Index:
        """Nodes of the faces that move as rigid bodies."""
        # an empty array first: bodies without rigid faces have none to join
        return np.unique(np.concatenate([np.zeros(0, np.int64), *(self.nodes_of(f.face) for f in self.rigid_faces)]))

    @property
    def rigid(self) -> bool:
        """Whether the substructure is undeformable."""
        return self.description.rigid

    def initial_velocity(self) -> Array:
        """Velocity of the nodes at t = 0, (3 n_node,), m s-1."""
        description = self.description
        velocity = np.tile(np.asarray(description.initial_velocity, dtype=float), (self.mesh.n_node, 1))
        if any(description.initial_spin):
            # about the mass centre, point masses included
            arm = self.mesh.nodes - self.rigid_motions.centre
            velocity += np.cross(np.asarray(description.initial_spin), arm)
        if self.velocity_field is None:
            return velocity.ravel()
        return (velocity + self.velocity_field).ravel()

    def initial_displacement(self) -> Array:
        """Displacement of the nodes at t = 0, (3 n_node,), m."""
        uniform = np.tile(np.asarray(self.description.initial_displacement, dtype=float), self.mesh.n_node)
        if self.displacement_field is None:
            return uniform
        return uniform + self.displacement_field.ravel()

    @cached_property
    def velocity_field(self) -> Array | None:
        """Part of the velocity at t = 0 by a gradient and a file, (n_node, 3), m s-1; None without these."""
        return self._field(self.description.initial_velocity_gradient, self.description.initial_velocity_field)

    @cached_property
    def displacement_field(self) -> Array | None:
        """Part of the displacement at t = 0 by a gradient and a file, (n_node, 3), m; None without these."""
        description = self.description
        return self._field(description.initial_displacement_gradient, description.initial_displacement_field)

    def _field(self, gradient: Gradient | None, file: VelocityFile | DisplacementFile | None) -> Array | None:
        """G (x - centre) plus the values of the points of a file nearest to the nodes."""
        if gradient is None and file is None:
            return None
        field = np.zeros((self.mesh.n_node, 3))
        if gradient is not None:
            # rows of G by rows of places
            field += (self.mesh.nodes - self.rigid_motions.centre) @ np.asarray(gradient, dtype=float).T
        if file is not None:
            _, number = nearest(self.mesh.nodes, np.asarray(file.points, dtype=float))
            field += np.asarray(file.values, dtype=float)[number]
        return field

    def full_size(self) -> int:
        """Number of dofs of the nodes."""
        return 3 * self.mesh.n_node


def selection(nodes: Index, body: Body) -> sp.csr_array:
    """(3 n_point, 3 n_node) picks the values at the nodes."""
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    n = len(columns)
    return sp.csr_array((np.ones(n), (np.arange(n), columns)), shape=(n, body.full_size()))


def own_points(body: Body, facets: FacetSet, face: Face) -> tuple[Array, sp.csr_array]:
    """Points of a face alone, (n_point, 3), and the trace to them: its nodes, and on quadratic facets the values that
    belong to the functions with positive areas (``fem.faces``)."""
    selected, places = selection(face.nodes, body), body.mesh.nodes[face.nodes]
    if face.change is None:
        return places, selected
    values = nodal_values(facets, face.nodes)
    return values @ places, sp.csr_array(sp.kron(values, sp.eye_array(3)) @ selected)


def consecutive(sizes: Mapping[str, int]) -> tuple[dict[str, slice], int]:
    """Slices of parts of these sizes one behind the other, by name, and the size of the whole."""
    ends = np.cumsum([*sizes.values()]).tolist()
    return {n: slice(end - size, end) for (n, size), end in zip(sizes.items(), ends, strict=True)}, ends[-1]


def body_sides(units: Sequence[InterfaceUnit]) -> Iterator[tuple[int, int, str]]:
    """Number of the interface, side (0 or 1) and substructure of every side that is not the ground."""
    for i, unit in enumerate(units):
        for side, face in enumerate(unit.sides):
            if face != GROUND:
                yield i, side, split_face(face)[0]


def side_impedance(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> Array:
    """Material impedance of every channel, (n_flat,), Pa s m-1; 0 on the ground and on rigid bodies."""
    impedance = np.zeros(layout.n_flat)
    for i, side, name in body_sides(units):
        if not bodies[name].rigid:
            channels = layout.channels(i, side)
            along, across = bodies[name].shape.fast_elasticity.impedances(units[i].geometry.frames[:, 0])
            impedance[channels[:, 0]], impedance[channels[:, 1:]] = along, across[:, None]
    return impedance


def side_stiffness(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> Array:
    """Stiffness per area of the body behind every channel (n_flat,), Pa m-1, 0 on the ground: modulus over length, E
    along the normal (lambda + 2 mu would make nearly incompressible bodies too stiff), mu along the face."""
    stiffness = np.zeros(layout.n_flat)
    for i, side, name in body_sides(units):
        material, length = bodies[name].shape.elasticity, _length(bodies[name], units[i])
        channels, (along, across) = layout.channels(i, side), material.moduli_along(units[i].geometry.frames[:, 0])
        stiffness[channels[:, 0]] = along / length
        stiffness[channels[:, 1:]] = across[:, None] / length
    return stiffness


def flexibility(bodies: dict[str, Body], units: list[InterfaceUnit], layout: Layout) -> dict[str, float]:
    """Elastic approach of the bodies of each interface under a mean pressure, L/E of both sides, m Pa-1; rigid bodies
    and the ground have none."""
    stiffness, compliance = side_stiffness(bodies, units, layout), {unit.name: 0.0 for unit in units}
    for i, side, name in body_sides(units):
        if not bodies[name].rigid:
            # stiffness along the normal: E over the length
            compliance[units[i].name] += 1.0 / float(stiffness[layout.channels(i, side)[0, 0]])
    return compliance


def _length(body: Body, unit: InterfaceUnit) -> float:
    """Size of a body behind an interface, m: along the normal; where the face is wider, the geometric mean with its
    width, for the bending and the shear lag of thin bodies."""
    normal = unit.geometry.frames[:, 0].mean(axis=0)
    along = float(np.ptp(body.mesh.nodes @ normal))
    along = max(along, 1e-3 * body.mesh.size)  # a face seen edge on
    return float(np.sqrt(along * max(along, np.sqrt(unit.geometry.areas.sum()))))


class _MeshFiles:
    """Mesh files of a scene: each is read once, and each of its problems is reported once."""

    def __init__(self) -> None:
        self.contents: dict[Path, MeshContent | None] = {}
        self._reported: set[Problem] = set()

    def mesh(self, name: str, table: MeshFile, base_dir: Path, problems: Problems) -> Mesh | None:
        """Mesh of a substructure; None where it cannot be read, with problems that were not reported before."""
        from ..fem.mesh_file import mesh_of, refined
        from ..mesh_files.adjusted_nodes import adjusted
        from ..mesh_files.reading import read_content

        path = base_dir / table.file
        try:
            if path not in self.contents:
                # None first: a file that cannot be read is not read again
                self.contents[path] = None
                self.contents[path] = read_content(path)
            content = self.contents[path]
            if content is None:
                return None
            content.refuse(table.ignore)
            if table.adjust:
                content = adjusted(content)
            mesh = mesh_of(content, path.name, table.group, table.scale, table.points)
            for _ in range(table.refine):
                mesh = refined(mesh)
            return mesh
        except MeshError as error:
            fresh = [p for p in error.problems if p not in self._reported]
            self._reported.update(fresh)
            where = f"substructure.{name}.mesh"
            problems += [Problem(where, f"{p.where}: {p.what}", p.value, p.allowed, p.remedy) for p in fresh]
            return None


def _deck_remarks(files: _MeshFiles, scene: Scene) -> Iterator[Remark]:
    """What the decks say that the scene does not use."""
    if not files.contents:
        return
    from ..mesh_files.attachments import taken
    from ..mesh_files.deck_scene import left_out
    from ..mesh_files.unused import unused_content

    for path, content in files.contents.items():
        tables = {name: s.mesh for name, s in scene.substructure.items() if s.mesh is not None}
        here = {name: t for name, t in tables.items() if scene.base_dir / t.file == path}
        by_group = {t.group: name for name, t in here.items() if t.group is not None}
        whole = not any(t.mesh_only for t in here.values())
        if whole and content is not None and (words := left_out(content, by_group, scene)):
            verb = "is"
            if len(words) > 1:
                verb = "are"
            text = f"mesh file {path.name}: {', '.join(words)} {verb} not used"
            yield Remark("deck", f"{text}: add the required parts to the scene")
        if content is not None:
            if any(t.group is None for t in here.values()):
                # a body of the whole file
                by_group = {}
            for sentence in unused_content(content, by_group, taken(content, scene)):
                yield Remark("deck", f"mesh file {path.name}: {sentence}")


def _unit_remarks(files: _MeshFiles, scene: Scene) -> Iterator[Remark]:
    """Mesh files whose unit of length is another one than their ``scale`` says."""
    metre = scene.unit_system["m"]
    for path, content in files.contents.items():
        names = []
        if content is not None:
            names = [content.unit, content.unit.lower()]
        size = next((size for name in names if (size := unit_size(name, "m")) is not None), None)
        if content is None or size is None:
            continue
        wanted = float(size / scene.unit_system.exact_size("m"))
        scales = {table.scale for table in _tables_of(path, scene).values()}
        if wrong := sorted(scale for scale in scales if not math.isclose(scale, wanted, rel_tol=1e-6)):
            text = f"mesh file {path.name}: its lengths are in {content.unit} by its own account, scale = {wrong[0]:g} "
            yield Remark("size", f"{text}makes {wrong[0]:g} {metre} of one: is it scale = {wanted:g}?")


def _tables_of(path: Path, scene: Scene) -> dict[str, MeshFile]:
    """Tables of the substructures whose mesh is of a file."""
    tables = {name: s.mesh for name, s in scene.substructure.items() if s.mesh is not None}
    return {name: table for name, table in tables.items() if scene.base_dir / table.file == path}


def _file_lines(files: _MeshFiles, scene: Scene, bodies: Mapping[str, Body]) -> Iterator[str]:
    """One line for each mesh file: its bodies, their volume and mass, its unit of length, what is left out."""
    units = scene.unit_system
    for path, content in files.contents.items():
        tables = _tables_of(path, scene)
        if content is None or not tables:
            continue
        chosen = [bodies[name] for name in tables if name in bodies]
        volume = sum(float(body.shape.elements.volume.sum()) for body in chosen)
        mass = sum(float(body.shape.elements.volume.sum()) * body.shape.material.density for body in chosen)
        scales = " or ".join(f"{scale:g}" for scale in sorted({table.scale for table in tables.values()}))
        if content.unit:
            unit = f" (the file says {content.unit})"
        else:
            unit = ""
        if len(tables) == 1:
            many = "1 body"
        else:
            many = f"{len(tables)} bodies"
        words = [many, f"{volume:.6g} {units['m3']}", f"{mass:.6g} {units['kg']}"]
        words += [f"a unit of it is {scales} {units['m']}{unit}", *content.said]
        solids = sum(len(cells) for cells in content.solids.values()) - sum(body.mesh.n_cell for body in chosen)
        lost = []
        if solids > 0 and not any(t.refine for t in tables.values()):
            lost = [f"{solids} solid cells"]
        lost += [f"{count} {kind}" for kind, count in content.skipped.items()]
        text = f"  file {path.name}: {', '.join(words)}"
        if lost:
            text += f"; left out: {', '.join(lost)}"
        yield text


_KEYS_OF_CELLS: Final = (
    ("bending_modes", BENDING_CELLS, "the mesh has no 8-node hexahedra"),
    ("reduced_integration", REDUCED_CELLS, "the mesh has no 20-node hexahedra and no 6-node wedges"),
    ("uniform_strain", UNIFORM_CELLS, "the mesh has no 8-node hexahedra"),
)
"""Keys of a substructure that cells of some types alone have, and what is missing where there are none."""


def _with_rules(name: str, mesh: Mesh, description: Substructure, problems: Problems) -> Mesh:
    """The mesh with the rules of its cells that the keys of a substructure name."""
    where = f"substructure.{name}"
    if description.bending_modes and description.uniform_strain:
        what = "elements with bending modes are integrated at eight points"
        problems.add(f"{where}.uniform_strain", what, "true", remedy="omit one of the two keys")
    for key, types, missing in _KEYS_OF_CELLS:
        if not getattr(description, key):
            continue
        if not set(types) & set(mesh.cell_types):
            problems.add(f"{where}.{key}", missing, ", ".join(mesh.cell_types), remedy="omit the key")
        if key != "bending_modes":
            mesh = mesh.with_reduced_rules(types)
    return mesh


def build_bodies(
    scene: Scene,
    problems: Problems,
    earlier: Mapping[str, Body] | None = None,
    remarks: list[Remark] | None = None,
    lines: list[str] | None = None,
) -> dict[str, Body]:
    """Bodies of every substructure whose mesh can be read; the errors of others are added to ``problems``.

    earlier : bodies of another scene, whose meshes and matrices serve where the description is equal, the meshes alone
        where the material is another one.
    remarks : takes remarks on what mesh files hold beyond meshes. lines : takes a line on each mesh file that is read.
    """
    bodies: dict[str, Body] = {}
    shapes: dict[tuple[object, ...], Shape] = {}
    files = _MeshFiles()
    for name in scene.substructure:
        description = scene.moving(name)
        material = scene.material[description.material]
        old = None
        if earlier is not None:
            old = earlier.get(name)
        if old is not None and old.of(description, material):
            plain = old.added is None and not old.rigid_faces
            if not (plain and old.description == description and old.units == scene.unit_system):
                old = old.described(description, old.shape, scene.unit_system)
            bodies[name] = old
        elif old is not None and old.of(description, old.shape.material):
            key: tuple[object, ...] = (old.shape, material)
            if key not in shapes:
                shapes[key] = old.shape.of(material)
            bodies[name] = old.described(description, shapes[key], scene.unit_system)
        elif description.box is not None:
            box = description.box
            key = (box.size, box.elements, material, description.bending_modes, description.uniform_strain)
            placed = box_mesh(np.asarray(box.origin), np.asarray(box.size), box.elements)
            placed = _with_rules(name, placed, description, problems)
            if key not in shapes:
                # at the origin: equal boxes at other places share matrices to the last bit
                unit = box_mesh(np.zeros(3), np.asarray(box.size), box.elements)
                shapes[key] = Shape(replace(unit, blocks=placed.blocks), material, description.bending_modes)
            bodies[name] = Body(name, placed, shapes[key], description, units=scene.unit_system)
        elif description.mesh is not None:
            mesh = files.mesh(name, description.mesh, scene.base_dir, problems)
            if mesh is None:
                continue
            mesh = _with_rules(name, mesh, description, problems)
            shape = Shape(mesh, material, description.bending_modes)
            bodies[name] = Body(name, mesh, shape, description, units=scene.unit_system)
    if remarks is not None:
        remarks += _deck_remarks(files, scene)
        remarks += _unit_remarks(files, scene)
    if lines is not None:
        lines += _file_lines(files, scene, bodies)
    return bodies
