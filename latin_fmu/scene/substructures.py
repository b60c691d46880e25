"""Tables [substructure], [mesh], [temperature], [rotation], by name, [gravity], [motion]: bodies and what acts all over
them."""

import math
import re
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ..errors import Problem, shown
from .fields import (
    GROUND,
    Count,
    Direction,
    Flag,
    Name,
    Positive,
    PositiveCount,
    Real,
    SceneTable,
    Text,
    Vector,
    _as_list,
    about,
    entry,
    refusal,
)
from .initial_fields import DISPLACEMENT_FIELDS, VELOCITY_FIELDS, DisplacementFile, Gradient, VelocityFile
from .laws import ConstantLaw, Law
from .raw_scene import (
    RawTable,
    chosen_type,
    exactly_one,
    given,
    is_explicit,
    named_tables,
    reference_problems,
    single_table,
    text_list,
)

MAX_ELEMENTS = 20_000_000
LARGEST_ASPECT = 1e6


def _check_amount(elements: tuple[int, int, int]) -> tuple[int, int, int]:
    if math.prod(elements) > MAX_ELEMENTS:
        raise refusal("too many elements", value=elements, allowed=f"at most {MAX_ELEMENTS} in one substructure")
    return elements


Sizes = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_as_list)]
Elements = Annotated[
    tuple[PositiveCount, PositiveCount, PositiveCount], BeforeValidator(_as_list), AfterValidator(_check_amount)
]


_SMALLEST, _LARGEST = 1e-60, 1e60  # m; products of several such lengths are still numbers


class BoxTable(SceneTable):
    """A box along the axes, cut into 8-node hexahedra; its faces are xmin xmax ymin ymax zmin zmax."""

    origin: Annotated[Vector, about("corner with the smallest coordinates", "m")] = (0.0, 0.0, 0.0)
    size: Annotated[Sizes, about("lengths along x, y, z", "m")]
    elements: Annotated[Elements, about("number of elements along x, y, z (20 million in all at most)", "1")]

    @model_validator(mode="after")
    def _check_shape(self) -> Self:
        """Refuse flat elements, whose matrices are not positive definite in double precision, and absurd lengths."""
        edges = [length / count for length, count in zip(self.size, self.elements, strict=True)]
        if min(edges) < _SMALLEST or max(*map(abs, self.origin), *self.size) > _LARGEST:
            raise refusal(
                "lengths out of range",
                value=f"origin {list(self.origin)}, size {list(self.size)}",
                allowed=f"edges from {_SMALLEST:g} m, coordinates up to {_LARGEST:g} m",
            )
        if max(edges) > LARGEST_ASPECT * min(edges):
            raise refusal(
                "elements are too flat (size over elements, along x, y, z)",
                value=tuple(float(f"{edge:.3g}") for edge in edges),
                allowed=f"edges that differ by a factor of at most {LARGEST_ASPECT:g}",
            )
        return self


MAX_REFINEMENTS: Final = 4  # 4096 cells of each
Refinements = Annotated[
    Count,
    about(
        "number of times that every cell is split into eight; the surface remains that of the file and does not "
        "approach the meshed geometry",
        "1",
        ge=0,
        le=MAX_REFINEMENTS,
    ),
]


Words = Annotated[tuple[Text, ...], BeforeValidator(_as_list)]
Ignored = Annotated[
    Words,
    about(
        "unsupported element types and keywords of the file that are ignored: solids of another kind, such as "
        '"COH3D8", and keywords that change the mesh'
    ),
]


MeshOnly = Annotated[
    Flag,
    about(
        "of an Abaqus or CalculiX deck nothing but the mesh is taken: its materials, ties and supports stand in the "
        "scene, as `latin-fmu import` writes them"
    ),
]
SingleNodes = Annotated[
    tuple[Text, ...],
    about(
        "node sets that are nodes alone, no face, whatever facets have their corners in them: corners of quadratic "
        "facets without the middle nodes, on which forces or supports of a deck act"
    ),
]
Adjusted = Annotated[
    Flag,
    about(
        "slave nodes of the contact pairs of a deck are moved onto the master as its ADJUST says, where this is flat"
    ),
]


class MeshFile(SceneTable):
    """A mesh read from a file (hexahedra of 8, 20 or 27 nodes, tetrahedra of 4 or 10, wedges of 6, 15 or 18,
    pyramids of 5 or 13, also mixed); its faces are the named surface groups of the file."""

    file: Annotated[Text, about("mesh file, relative to the scene file (its formats: docs/mesh_files.md)")]
    group: Annotated[Text | None, about("named volume group to use; default: the whole file")] = None
    scale: Annotated[Real, about("length of one file unit (1e-3 for a mesh in mm)", "m", gt=0)] = 1.0
    refine: Refinements = 0
    ignore: Ignored = ()
    mesh_only: MeshOnly = False
    points: SingleNodes = ()
    adjust: Adjusted = False


class ModalDampingTable(SceneTable):
    """Damping C = M Phi diag(2 zeta omega) Phi^T M of the elastic modes of a substructure, its interfaces free, held as
    its boundaries hold it; rigid motions and the motion of driven faces lose nothing.

    Not with explicit steps. With the reduced propagator its static shapes count as modes of their own frequencies;
    otherwise `below` is required, and each mode is a vector of the unknowns of the body that every instant reads.
    """

    ratio: Annotated[Real, about("damping ratio zeta of each mode", "1", gt=0, lt=1)]
    below: Annotated[
        Real | None,
        about("frequency up to which modes are damped; default: all modes of the reduced basis", "Hz", gt=0),
    ] = None


class Substructure(SceneTable):
    """An elastic body, or a rigid one. It has exactly one of `box` and `mesh`."""

    material: Annotated[Name, about("name of a [material.NAME] table")]
    box: Annotated[BoxTable | None, about("a box meshed by the program")] = None
    mesh: Annotated[MeshFile | None, about("a mesh read from a file")] = None
    rigid: Annotated[
        Flag, about("undeformable: six unknowns (small rotations about the mass centre), no stiffness")
    ] = False
    bending_modes: Annotated[
        Flag, about("incompatible modes, so that 8-node hexahedra represent bending; eliminated inside each element")
    ] = False
    reduced_integration: Annotated[
        Flag,
        about(
            "stiffness of 20-node hexahedra from 2 x 2 x 2 points, of 6-node wedges from 2, as C3D20R and C3D6 of "
            "CalculiX; a cell alone can deform without a force"
        ),
    ] = False
    uniform_strain: Annotated[
        Flag,
        about(
            "strain of 8-node hexahedra uniform, with a small stiffness against hourglass modes, as C3D8R of CalculiX; "
            "bodies bend far too easily with fewer than four over their thickness"
        ),
    ] = False
    modal_damping: Annotated[
        ModalDampingTable | None, about("damping of the modes, one ratio for all up to a frequency")
    ] = None
    initial_velocity: Annotated[Vector, about("uniform velocity at t = 0", "m s-1")] = (0.0, 0.0, 0.0)
    initial_spin: Annotated[
        Vector, about("angular velocity at t = 0, about the mass centre (small rotations)", "rad s-1")
    ] = (0.0, 0.0, 0.0)
    initial_displacement: Annotated[Vector, about("uniform displacement at t = 0", "m")] = (0.0, 0.0, 0.0)
    initial_velocity_gradient: Annotated[
        Gradient | None, about("velocity at t = 0 per distance from the mass centre; a row for each component", "s-1")
    ] = None
    initial_displacement_gradient: Annotated[
        Gradient | None, about("displacement at t = 0 per distance from the mass centre; likewise", "1")
    ] = None
    initial_velocity_field: Annotated[VelocityFile | None, about("velocities of the nodes at t = 0 from a file")] = None
    initial_displacement_field: Annotated[
        DisplacementFile | None, about("displacements of the nodes at t = 0 from a file")
    ] = None
    body_force: Annotated[Vector, about("force per unit volume", "N m-3")] = (0.0, 0.0, 0.0)
    body_force_law: Annotated[Law, about("time law a(t) of the body force")] = ConstantLaw()

    @property
    def motion_keys(self) -> tuple[str, ...]:
        """Keys of velocities at t = 0 that are not zero."""
        return self._initial("initial_velocity", "initial_spin", *VELOCITY_FIELDS)

    @property
    def initial_keys(self) -> tuple[str, ...]:
        """Keys of velocities and displacements at t = 0 that are not zero."""
        return *self.motion_keys, *self._initial("initial_displacement", *DISPLACEMENT_FIELDS)

    @property
    def initial_fields(self) -> bool:
        """Whether velocities or displacements at t = 0 differ from node to node by a gradient or a file."""
        return any(getattr(self, key) is not None for key in (*VELOCITY_FIELDS, *DISPLACEMENT_FIELDS))

    def _initial(self, *keys: str) -> tuple[str, ...]:
        return tuple(key for key in keys if (value := getattr(self, key)) is not None and np.any(_numbers_of(value)))


def _numbers_of(value: Any) -> Any:
    return getattr(value, "values", value)


ALL = "*"


def _all_or_listed(value: object) -> object:
    if isinstance(value, str) and value != ALL:
        raise refusal("must be a list of names, or all of them", value=value, allowed='"*", or e.g. ["bolt", "nut"]')
    if isinstance(value, list | tuple) and ALL in value and len(value) > 1:
        raise refusal('"*" stands alone', value=list(value), allowed='"*", or e.g. ["bolt", "nut"]')
    if value == ALL:
        return (ALL,)
    return _as_list(value)


class MeshParts(SceneTable):
    """A mesh file with several parts: every volume group, or each group listed, becomes a substructure of its name."""

    file: Annotated[Text, about("mesh file, relative to the scene file (its formats: docs/mesh_files.md)")]
    scale: Annotated[Real, about("length of one file unit (1e-3 for a mesh in mm)", "m", gt=0)] = 1.0
    refine: Refinements = 0
    parts: Annotated[
        tuple[Text, ...],
        BeforeValidator(_all_or_listed),
        about('volume groups that become substructures; "*": those that share the cells of the file among them'),
        Field(min_length=1),
    ] = (ALL,)
    material: Annotated[
        Name | Annotated[dict[Text, Name], Field(min_length=1)] | None,
        about(
            "material of the parts whose [substructure.PART] names none; or a table of materials by patterns of names, "
            '{"bolt_*" = "steel", "*" = "aluminium"}, of which the first that fits counts'
        ),
    ] = None
    ignore: Ignored = ()
    mesh_only: MeshOnly = False
    points: SingleNodes = ()
    adjust: Adjusted = False
    take: Annotated[
        tuple[Literal["CONM2", "RBE2", "RBE3"], ...],
        BeforeValidator(_as_list),
        about("entries of a Nastran deck that become point masses and couplings, all of each kind"),
    ] = ()

    def material_of(self, part: str) -> str | None:
        """Material of a part whose substructure names none; None where the table has none for it."""
        if self.material is None or isinstance(self.material, str):
            return self.material
        return next((name for pattern, name in self.material.items() if fnmatchcase(part, pattern)), None)


def part_name(group: str) -> str:
    """Name of the substructure made of a volume group: characters that no name may hold become underscores."""
    name = re.sub("[^A-Za-z0-9_]", "_", group)
    if not name[:1].isalpha():
        name = f"part_{name}"
    # the name of the ground is taken
    if name == GROUND:
        return f"{name}_"
    return name[:100]


class Gravity(SceneTable):
    """Acceleration that acts on every body by its density, times a law: weight, a tilting table, an earthquake.

    In a frame that moves with its base at the acceleration b(t), the bodies are loaded by the acceleration -b(t).
    """

    acceleration: Annotated[Vector, about("acceleration along x, y, z", "m s-2")]
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()


class Motion(SceneTable):
    """A common velocity of all substructures at t = 0, for an assembly with an initial velocity.

    It is added to the initial velocities of the substructures, which then are relative to it: a static start, with its
    bolts, is an equilibrium of what moves with it. Supports have to move with it as well.
    """

    velocity: Annotated[Vector, about("velocity of the whole assembly at t = 0", "m s-1")]


class Temperature(SceneTable):
    """A uniform change of temperature of bodies, times a law; stresses arise where they cannot expand freely.

    Counted from the temperature at which the parts fit without stress and the bolts are tightened. Changes add up.
    """

    substructures: Annotated[
        tuple[Text, ...],
        BeforeValidator(_all_or_listed),
        about('substructures whose temperature changes; "*": all elastic ones'),
        Field(min_length=1),
    ] = (ALL,)
    change: Annotated[Real, about("change of temperature", "K")]
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()

    def heats(self, substructure: str) -> bool:
        """Whether the temperature of this elastic substructure changes."""
        return self.change != 0.0 and (ALL in self.substructures or substructure in self.substructures)


class RotationTable(SceneTable):
    """Centrifugal force of bodies that turn about an axis: rho omega^2 r per volume, away from the axis, times a law.

    Bodies are described in the frame that turns with them, on their places at t = 0: the force does not grow with their
    displacements, and motions relative to that frame have no Coriolis force. The law multiplies the force, which grows
    with the square of the speed.
    """

    substructures: Annotated[
        tuple[Text, ...],
        BeforeValidator(_all_or_listed),
        about('substructures that turn; "*": all of them'),
        Field(min_length=1),
    ] = (ALL,)
    angular_velocity: Annotated[Real, about("angular velocity omega", "rad s-1", gt=0)]
    axis: Annotated[Direction, about("direction of the axis", "1")]
    point: Annotated[Vector, about("a point on the axis", "m")] = (0.0, 0.0, 0.0)
    law: Annotated[Law, about("time law a(t) of the force")] = ConstantLaw()

    def acceleration(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centrifugal acceleration (n, 3), m s-2, of places (n, 3), m: omega^2 times their distance from the axis.

        >>> RotationTable(angular_velocity=10.0, axis=[0, 0, 2]).acceleration(np.array([[0.3, 0.0, 5.0]])).tolist()
        [[30.0, 0.0, 0.0]]
        """
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        arms = places - np.array(self.point)
        radial: NDArray[np.float64] = arms - np.outer(arms @ axis, axis)
        return self.angular_velocity**2 * radial

    def turns(self, substructure: str) -> bool:
        """Whether this substructure turns."""
        return ALL in self.substructures or substructure in self.substructures


# -- checks of these tables with each other and with others ---
def substructure_problems(raw: Any, base_dir: Path | None) -> Iterator[Problem]:
    """Problems of the substructures of a scene as written; their faces are checked with the meshes."""
    for name, table in named_tables(raw, "substructure").items():
        where = f"substructure.{name}"
        yield from exactly_one(table, where, "box", "mesh")
        yield from reference_problems(raw, f"{where}.material", "material", table.get("material"))
        if table.get("rigid") is True and chosen_type(single_table(raw, "time"), "scheme") == "massless_contact":
            yield Problem(
                f"{where}.rigid",
                "massless_contact removes the mass of contact nodes, which a rigid body does not have",
                'time.scheme = "massless_contact"',
                "hht or newmark",
                "choose another scheme, or leave the body elastic",
            )
        if given(table, "modal_damping"):
            yield from _modal_problems(raw, where, table)
        file = entry(table.get("mesh"), "file")
        if isinstance(file, str) and base_dir is not None and not _is_file(base_dir, file):
            yield Problem(
                f"{where}.mesh.file", "no such file", shown(file), None, "file names are relative to the scene file"
            )


def _modal_problems(raw: Any, where: str, table: RawTable) -> Iterator[Problem]:
    """Modal damping of a body that has no modes in the run."""
    if table.get("rigid") is True:
        yield Problem(f"{where}.modal_damping", "a rigid body has no elastic modes", None, None, "remove it")
    if single_table(raw, "time").get("quasi_static") is True:
        what = "damping acts on rates: not with quasi_static = true"
        yield Problem(f"{where}.modal_damping", what, None, None, "remove it, or omit quasi_static")
    if is_explicit(raw):
        what, remedy = "explicit steps know no modes", "damp the material by rayleigh_mass, or choose another scheme"
        yield Problem(f"{where}.modal_damping", what, None, "an implicit time scheme", remedy)
    solver, modal = single_table(raw, "solver"), table["modal_damping"]
    if chosen_type(solver, "propagator") == "reduced":
        return
    if isinstance(modal, Mapping) and not given(modal, "below"):
        what = "'below' is missing: the modes of a mesh are as many as its unknowns"
        remedy = 'give the highest frequency of interest, or take solver.propagator = "reduced"'
        yield Problem(f"{where}.modal_damping", what, None, "a frequency [Hz]", remedy)
    if (form := chosen_type(solver, "interface_operator")) in ("exact", "sparse"):
        what = "modal damping joins all points of an interface, so that it has a dense matrix"
        yield Problem("solver.interface_operator", what, shown(form), "automatic, dense", "omit it")


def _is_file(base_dir: Path, name: str) -> bool:
    try:
        return (base_dir / name).is_file()
    except (OSError, ValueError):  # a name the system refuses, e.g. too long or with a null character
        return False


def rotation_problems(raw: Any) -> Iterator[Problem]:
    """Names of bodies that turn, of a scene as written, that are not there."""
    for name, table in named_tables(raw, "rotation").items():
        for i, body in enumerate(text_list(table.get("substructures"))):
            if body != ALL:
                yield from reference_problems(raw, f"rotation.{name}.substructures[{i}]", "substructure", body)


def temperature_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the changes of temperature of a scene as written: names, laws, materials without an expansion."""
    bodies, materials = named_tables(raw, "substructure"), named_tables(raw, "material")
    unknown = dict[str, tuple[str, str]]()
    for name, table in named_tables(raw, "temperature").items():
        listed = text_list(table.get("substructures"))
        for i, body in enumerate(listed):
            where = f"temperature.{name}.substructures[{i}]"
            if body != ALL:
                yield from reference_problems(raw, where, "substructure", body)
            if bodies.get(body, {}).get("rigid") is True:
                yield Problem(where, "a rigid body does not expand", body, "elastic substructures", "omit it")
        if chosen_type(table, "law") == "input":
            yield Problem(
                f"temperature.{name}.law",
                "a temperature cannot be an input: the stresses of the results follow its law",
                "input",
                "constant, table, csv and the laws of pulses",
                "give its history as a table",
            )
        for body, written in bodies.items():
            material, heated = written.get("material"), not listed or ALL in listed or body in listed
            if heated and written.get("rigid") is not True and isinstance(material, str):
                unknown.setdefault(material, (name, body))
    for material, (name, body) in unknown.items():
        properties = materials.get(material, {})
        if given(properties, "orthotropic"):
            key, allowed = "orthotropic.thermal_expansions", "list of 3 numbers [K-1]"
            missing = not given(single_table(properties, "orthotropic"), "thermal_expansions")
        else:
            key, allowed = "thermal_expansion", "number [K-1]"
            missing = not given(properties, key)
        if properties and missing:
            yield Problem(
                f"material.{material}.{key}",
                f"temperature {name!r} acts on {body!r}, which has no coefficient of expansion",
                None,
                allowed,
                "e.g. 11.7e-6 for steel, 23e-6 for aluminium; 0 for a body that does not expand",
            )
