"""Stored quantities of a run, a row each: name, unit, dimensions, meaning and comment, and what the values come from.

A table is of one kind of group. Its rows read the object that a group is made of, by the attribute of their name or by
a function beside the table; datasets, files and the texts of FMUs follow from them. Units are UDUNITS strings, of SI.
Nothing carries a ``standard_name``: the CF table has none for contact mechanics, and its ``time`` is a date, not the
time since the start of a run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from .bolt_strength import assembly_torsion


@dataclass(frozen=True)
class StoredQuantity:
    """A stored quantity.

    Attributes
    ----------
    name : of the variable. unit : UDUNITS, None for labels and text. dims : names of the dimensions.
    meaning : long name. comment : None where there is none. words : of the values 0, 1, ... of a status.
    of : the values from the object of a group, None where it has none.
    """

    name: str
    unit: str | None
    dims: tuple[str, ...]
    meaning: str
    comment: str | None
    of: Callable[[Any], Any]
    words: str = ""

    @property
    def attributes(self) -> dict[str, Any]:
        """As netCDF attributes, absent ones left out."""
        pairs: dict[str, Any] = {"units": self.unit, "long_name": self.meaning, "comment": self.comment}
        if self.words:
            flags = np.arange(len(self.words.split()), dtype=np.int8)
            pairs |= {"flag_values": flags, "flag_meanings": self.words}
        return {key: value for key, value in pairs.items() if value is not None}


class Named(Protocol):
    """An entry of one quantity."""

    @property
    def quantity(self) -> str:
        """Its name, ``owner.key``."""
        ...


Of = TypeVar("Of", bound=Named)


class ByQuantity(Generic[Of]):
    """Base of results with an entry of type ``Of`` for each quantity: ``made["crush.impulse"]``."""

    quantities: Sequence[Of]

    @cached_property
    def by_quantity(self) -> dict[str, Of]:
        """Entries by the name of their quantity."""
        return {of.quantity: of for of in self.quantities}

    def __getitem__(self, quantity: str) -> Of:
        """Entry of one quantity (KeyError where there is none)."""
        return self.by_quantity[quantity]


Columns = Sequence[tuple[StoredQuantity, Any]]
"""Rows with their values."""
Rows = Mapping[str, StoredQuantity]
"""Rows by name."""


def cells_of(text: str) -> Iterator[list[str]]:
    """Cells of the lines of a table, between bars."""
    return ([" ".join(cell.split()) for cell in line.split("|")] for line in text.strip().splitlines())


def rows(text: str, of: Mapping[str, Callable[[Any], Any]] | None = None) -> Rows:
    """A table from lines ``name | unit | dimensions | meaning | comment | words``; the last two may be left out, and a
    unit ``-`` is none.

    of : functions from the object of a group to values that are not its attribute of this name.
    """
    table = {}
    for line in cells_of(text):
        name, unit, dims, meaning, comment, words, *_ = [*line, "", ""]
        source = (of or {}).get(name, attrgetter(name))
        symbol: str | None = unit
        if unit == "-":
            symbol = None
        table[name] = StoredQuantity(name, symbol, tuple(dims.split()), meaning, comment or None, source, words)
    return table


def columns(table: Rows, source: Any) -> list[tuple[StoredQuantity, Any]]:
    """Rows with their values of the object of a group, those that it has."""
    return [(row, values) for row in table.values() if (values := row.of(source)) is not None]


def named(table: Rows, arrays: Mapping[str, Any]) -> list[tuple[StoredQuantity, Any]]:
    """Rows with values by name, those that are not None."""
    return [(table[name], values) for name, values in arrays.items() if values is not None]


def fields_over_time(table: Rows, history: type) -> tuple[str, ...]:
    """Names of the rows over time that are fields of a history."""
    fields = getattr(history, "__dataclass_fields__", {})
    return tuple(name for name, row in table.items() if row.dims[:1] == ("time",) and name in fields)


AXES: Final = ["x", "y", "z"]
SIDES: Final = ["E", "Ep"]
LABELS: Final = rows(
    """
    time             | s  | time             | time since the start of the run
    component        | -  | component        | global axis
    side             | -  | side             | side of the interface
    stress_component | -  | stress_component | component of the symmetric stress tensor
    strain_component | -  | strain_component | component of the symmetric strain tensor
    principal        | 1  | principal        | number of the principal value, largest first
    order            | 1  | order            | bolts tightened last, in ascending order
    section          | -  | section          | section of the shank, from the head to the thread
    direction        | -  | direction        | direction of a section: along the axis of the shank, and two across it
    check            | -  | check            | check of the screw | VDI 2230-1:2015
    frequency        | Hz | frequency        | natural frequency of the oscillator
    response         | -  | response         | part of the response | primary: during the record, residual: after it
    substructure     | -  | substructure     | substructure
    window           | 1  | window           | number of the window, from 1
    iteration        | 1  | iteration        | number of the LATIN iteration in its window, from 1
    mode             | 1  | mode             | number of the mode, rigid motions first
    """
)
"""Labels along a dimension."""
TENSORS: Final[Mapping[str, Any]] = {
    "stress_component": ["xx", "yy", "zz", "yz", "xz", "xy"],
    "strain_component": ["xx", "yy", "zz", "yz", "xz", "xy"],
    "principal": np.array([1, 2, 3], dtype=np.int32),
}
"""Labels of the dimensions of tensors."""


def _places(name: str, dims: str, meaning: str, of: str) -> Rows:
    """Coordinates of places (..., 3), an attribute, along x, y and z."""
    text = "\n".join(f"{name}{axis} | m | {dims} | {axis} of {meaning}" for axis in AXES)

    def along(i: int) -> Callable[[Any], Any]:
        return lambda source: getattr(source, of)[..., i]

    return rows(text, {f"{name}{axis}": along(i) for i, axis in enumerate(AXES)})


def _mark(name: str) -> Callable[[Any], Any]:
    """Mark of the nodes of a substructure as numbers, None where it has no marks."""
    return lambda history: None if history.marks is None else getattr(history.marks, name).astype(np.int8)


def _nothing(_: Any) -> Any:
    """Value of a variable that only carries attributes."""
    return np.int32(0)


INTERFACE: Final = rows(
    """
    area           | m2    | point                     | area carried by the interface point
    normal         | 1     | point component           | unit normal N, from side E to side Ep
    initial_gap    | m     | point                     | gap at the start of the run
    traction       | Pa    | time point component      | traction exerted by the interface on side E | local-stage field
    velocity       | m s-1 | time side point component | velocity of both sides of the interface | local-stage field
    gap | m | time point | opening along N, from the displacements | negative where the sides penetrate
    contact_status | - | time point | contact status | a closed frictionless point has status slip \
        | separation stick slip
    force          | N     | time component            | resultant force exerted by the interface on side E
    friction_power | W     | time                      | power dissipated by friction
    layer_energy   | J     | time                      | elastic energy of the layer
    joint_power    | W     | time                      | power dissipated by the viscous joint
    """,
    {"area": attrgetter("areas"), "normal": attrgetter("normals"), "force": lambda history: history.force()},
)
"""Of an ``InterfaceHistory``."""
INTERFACE_MADE: Final = rows(
    """
    impulse         | N s | time component | force integrated over time since the start of the run
    pressure        | Pa  | time point     | normal pressure, positive in compression | local-stage field
    slip | m | time point | distance that side Ep has moved along the face of E while in contact, from the start
    accumulated_slip | m | time point | length of the way of side Ep along the face of E while it slides, from the start
    friction_energy | J m-2 | time point | energy dissipated by friction per area, from the start
    error_indicator | 1 | | error indicator sqrt(eta) of this interface | largest over the windows, at their last \
        iteration
    """
)
"""What follows from such a history and the instants of the run."""
POINTS: Final = _places("", "point", "the interface point, reference configuration, side E", "points")
SURFACE: Final = rows(
    """
    cells | - | cell corner | points of each triangle or quadrilateral of the surface | -1: the cell has three points
    surface   | - |       | topology of the surface of the interface
    """,
    {"surface": _nothing},
)
"""Of an ``InterfaceHistory`` whose points have cells."""
PLANE: Final = rows(
    """
    surface_x | m | point | first coordinate of the point in the mean plane of the interface | along its direction, \
        from the origin of the global axes
    surface_y | m | point | second coordinate of the point in the mean plane of the interface | along its direction, \
        from the origin of the global axes
    """
)

SUBSTRUCTURE: Final = rows(
    """
    displacement | m     | time node component        | displacement | linear-stage field
    velocity     | m s-1 | time node component        | velocity | linear-stage field
    stress       | Pa    | time cell stress_component | mean stress of the element, tension positive | linear-stage \
        field
    """
)
"""Of a ``SubstructureHistory``."""
RECOVERED: Final = rows(
    """
    strain | 1 | time cell strain_component | mean strain of the element | components of the tensor: half the \
        engineering shear
    principal_stress | Pa | time cell principal  | principal values of the mean stress of the element
    nodal_stress | Pa | time node stress_component | stress at the node, tension positive | mean over the elements \
        around the node
    nodal_principal_stress | Pa | time node principal | principal values of the stress at the node
    nodal_von_mises | Pa | time node | von Mises stress at the node | of nodal_stress
    """
)
MARKS: Final = rows(
    """
    support | - | node | whether a boundary fixes or drives the node along all axes | | free held
    contact_edge | - | node | whether the node belongs to a cell at the edge of a contact or a support | stress has no \
        limit there under refinement | away at_edge
    """,
    {name: _mark(name) for name in ("support", "contact_edge")},
)
"""Of the nodes of a ``SubstructureHistory`` with fields."""
MESH: Final = rows(
    """
    cell_nodes | - | cell cell_node | nodes of each element, in VTK order | -1: the element has fewer nodes
    mesh       | - |                | topology of the mesh
    """,
    {"cell_nodes": attrgetter("cells"), "mesh": _nothing},
)
NODES: Final = _places("node_", "node", "the node, reference configuration", "nodes")

SENSOR: Final = rows(
    """
    displacement | m     | time component | displacement of the sensor
    velocity     | m s-1 | time component | unfiltered velocity of the sensor
    acceleration | m s-2 | time component | unfiltered acceleration of the sensor | acceleration of the time scheme; \
        where the scheme weights forces of two instants, that of about a tenth of a step earlier
    """
)
"""Of a ``SensorHistory``."""
FILTERED: Final = {
    name: replace(row, name=f"{name}_filtered", meaning=f"{name} of the sensor behind its filter", comment=None)
    for name, row in SENSOR.items()
}
"""Motions of a sensor behind its filter."""
SENSOR_PLACE: Final = _places("", "", "the sensor, reference configuration", "point")

SPECTRUM: Final = rows(
    """
    acceleration    | m s-2 | response frequency component | largest absolute acceleration of the oscillator
    pseudo_velocity | m s-1 | response frequency component | largest relative displacement of the oscillator times its \
        angular frequency
    relative_displacement | m | response frequency component | largest relative displacement of the oscillator
    equivalent_static_acceleration | m s-2 | response frequency component | largest relative displacement of the \
        oscillator times the square of its angular frequency
    relative_error | 1 | response frequency component | estimated relative error of the spectrum | difference from the \
        spectrum of a run on a coarser mesh with a longer step over (ratio of steps - 1), for errors of first order; \
        the largest within half an octave
    """
)
"""Of a ``ShockSpectrum``, with its estimated error."""
REACTION: Final = rows("force | N | time component | resultant force exerted by the support on the body")
"""Of a ``ReactionHistory``."""
BOLT: Final = rows(
    """
    force            | N  | time | tension of the shank | resultant along the axis of the stresses on a cut of the shank
    mean_stress      | Pa | time | tension of the shank over its section
    thread_area        | m2 |    | tensile stress area of the whole thread, by ISO 898-1
    thread_stress      | Pa | time | tension over the tensile stress area of the thread, of the modelled part
    share              | 1  |      | share of the whole screw that is modelled
    plastic_elongation | m | time | plastic elongation of the shank since the bolts were tightened
    shortening       | m  |      | shortening of the shank, counted from before the bolts were tightened
    section_area     | m2 |      | section of the shank across its axis
    clamp_length     | m  |      | clamp length l_K
    assembly_torsion | N m |     | torsion of assembly M_G | by the friction of the thread under the largest tension \
        while bolts were tightened
    section_force    | N   | time section direction | forces in the shank at its sections: axial, two shear forces | \
        what the part beyond the section, along the axis, exerts on the one before it
    section_moment   | N m | time section direction | moments in the shank about the centres of its sections: torsion, \
        two bending moments | what the part beyond the section, along the axis, exerts on the one before it
    tightening_force | N  | order | tension when the bolts of each order were tight, before other loads
    """,
    {
        "mean_stress": lambda bolt: bolt.force / bolt.area,
        "thread_stress": lambda bolt: None if bolt.thread_area is None else bolt.force / bolt.stress_area,
        "section_area": attrgetter("area"),
        "clamp_length": lambda bolt: None if bolt.screw is None else bolt.screw.clamp_length,
        "assembly_torsion": assembly_torsion,
        "tightening_force": lambda bolt: np.array(bolt.tightening),
    },
)
"""Of a ``BoltHistory``."""
SECTIONS: Final = rows(
    """
    direction_vector | 1  | direction component | unit vector of a direction of the sections
    mesh_section_area | m2 | section | section of the mesh across the axis
    """,
    {"direction_vector": attrgetter("directions"), "mesh_section_area": attrgetter("areas")},
)
"""Of the ``ShankSections`` of a bolt."""
SECTION_PLACES: Final = _places("section_", "section", "the centre of the section, reference configuration", "centres")
SECTION_STRESSES: Final = rows(
    """
    nominal_stress | Pa | time section | axial force over the section | over the tensile stress area of the thread, \
        where there is one, else over that of the mesh
    bending_stress | Pa | time section | bending stress at the edge of the section | of a circle of the same area
    edge_stress | Pa | time section | largest axial stress at the edge of the section | nominal and bending
    """,
    {f"{name}_stress": attrgetter(name) for name in ("nominal", "bending", "edge")},
)
"""Of ``SectionStresses``."""
MARGINS: Final = rows(
    """
    safety | 1 | check | safety of the screw: what is allowed over what acts | of separation: smallest clamp force \
        over that at the start
    clause | - | check | step and equation of VDI 2230-1:2015
    """
)
LIMIT: Final = rows(
    """
    spectrum | m s-2 | frequency | spectrum of the sensor, unit of its kind
    allowed  | m s-2 | frequency | limit, unit of the kind of the spectrum
    safety   | 1     |           | safety of the bolt
    least    | 1     |           | smallest safety that is allowed
    """
)
"""Of a limit that a run is judged by."""
MODEL: Final = rows(
    """
    mass       | kg | substructure           | mass of the body, point masses included
    volume     | m3 | substructure           | volume of the elements
    extent     | m  | substructure component | size of the bounding box
    node_count | 1  | substructure           | number of nodes
    cell_count | 1  | substructure           | number of elements
    cell_types | -  | substructure           | number of elements by type
    """
)
"""Of the bodies."""
BOLT_END: Final = rows(
    "end_force | N | | tension at the end | mean over the last periods where it still oscillates, else the last value"
)
"""What follows from such a history and the instants of the run."""

ENERGY: Final = rows(
    """
    kinetic              | J | time | kinetic energy
    elastic              | J | time | elastic energy of the strains
    prestress            | J | time | energy of the geometric stiffness of the stress at t = 0
    work_of_loads        | J | time | work of the loads since the start of the run
    interface_work       | J | time | work of the interface tractions on the substructures since the start of the run
    friction_dissipation | J | time | energy dissipated by friction since the start of the run
    contact_dissipation  | J | time | energy lost to the normal contact law (impacts) since the start of the run
    drift_work | J | time | work against the laws of the interfaces since the start of the run: of the solver's errors \
        of place | positive: the bodies gain it
    layer_energy         | J | time | elastic energy of the layers
    joint_dissipation    | J | time | energy dissipated by viscous joints since the start of the run
    ground_work          | J | time | work of moving ground since the start of the run
    damping_dissipation  | J | time | energy dissipated by material damping since the start of the run
    landing_dissipation  | J | time | energy dissipated by the viscosity of contact layers since the start of the run
    scheme_dissipation   | J | time | energy dissipated by the time scheme since the start of the run
    balance              | J | time | residual of the energy balance
    """
)
"""Terms of the energies of a substructure, or of the assembly."""


RESULTANTS: Final = rows(
    """
    load_force        | N   | substructure component | sum of the loads at the end, with what balances a preload
    load_moment       | N m | substructure component | moment of the loads about the centre of the body
    interface_force   | N   | substructure component | sum of the interface forces at the end
    interface_moment  | N m | substructure component | moment of the interface forces about the centre of the body
    reaction_force    | N   | substructure component | sum of the forces of the supports at the end
    reaction_moment | N m | substructure component | moment of the forces of the supports about the centre of the body
    unbalanced_force  | N   | substructure component | sum of the forces that are not in balance at the end
    unbalanced_moment | N m | substructure component | moment of what is not in balance about the centre of the body
    """
)
"""Of the ``Resultants`` of all bodies."""


CONVERGENCE: Final = rows(
    """
    error_indicator | 1 | window iteration | error indicator sqrt(eta) after each iteration
    force_mismatch  | 1 | window iteration | relative difference of the forces of both stages after each iteration
    iterations      | 1 | window           | LATIN iterations of the window
    newton_steps    | 1 | window           | iterations of the window that were Newton steps
    defect | 1 | window | residual of the laws of interfaces with truncated tables, in the norm of the error indicator
    corrections     | 1 | window           | corrections of the window by exact velocities
    converged       | - | window           | whether the window converged | | not_converged converged
    first_instant   | 1 | window           | index in time of the first instant of the window
    last_instant    | 1 | window           | index in time of the last instant of the window
    end_time        | s | window           | time at the end of the window
    fallbacks       | - | window           | fall-backs used in the window, in order
    passes          | 1 |                  | substructure-instants solved / (substructures x instants)
    """
)
"""Of the windows of a run."""
