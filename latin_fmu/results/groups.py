"""Groups of a results file as plain arrays, and units and meaning of every variable in one table.

Units are UDUNITS strings. Nothing here carries a ``standard_name``: the CF table has none for contact
mechanics, and its ``time`` is a date, not the time since the start of a run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..scene.units import UnitSystem, system_named

if TYPE_CHECKING:
    import xarray as xr

Columns = dict[str, tuple[object, ...]]


@dataclass
class Variable:
    """An array with the names of its dimensions and its attributes."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: dict[str, Any] = field(default_factory=dict)


@dataclass
class Group:
    """Variables of one group; ``labels`` names the coordinates among them.

    A coordinate with the name of its only dimension labels what lies along it, in the groups below too.
    """

    variables: dict[str, Variable]
    labels: frozenset[str] = frozenset()
    attrs: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, columns: Columns, coordinates: Mapping[str, object] | None = None, attrs: dict[str, Any] | None = None
    ) -> Group:
        """From (dimensions, values) by name, and labels along dimensions by the name of the dimension."""
        given = {**columns, **(coordinates or {})}
        made: dict[str, Variable] = {}
        for name, entry in given.items():
            dims, values = entry if isinstance(entry, tuple) else (name, entry)
            names = (dims,) if isinstance(dims, str) else tuple(dims)
            made[name] = Variable(names, np.asarray(values))
        return cls(made, frozenset(coordinates or ()), attrs or {})

    @classmethod
    def of_dataset(cls, dataset: xr.Dataset) -> Group:
        """The group of an xarray dataset."""
        variables = {
            str(name): Variable(tuple(map(str, v.dims)), _read_as(v.values, name in dataset.coords), dict(v.attrs))
            for name, v in dataset.variables.items()
        }
        return cls(variables, frozenset(map(str, dataset.coords)), dict(dataset.attrs))

    def dataset(self) -> xr.Dataset:
        """The group as an xarray dataset."""
        import xarray as xr

        made = {name: (v.dims, _written_as(v.values), v.attrs) for name, v in self.variables.items()}
        data = {name: v for name, v in made.items() if name not in self.labels}
        return xr.Dataset(data, {name: made[name] for name in made if name in self.labels}, self.attrs)

    def indexes(self) -> dict[str, Variable]:
        """Coordinates that label their own dimension."""
        return {name: v for name, v in self.variables.items() if name in self.labels and v.dims == (name,)}

    def sizes(self) -> dict[str, int]:
        """Length of every dimension, in the order of the variables."""
        sizes: dict[str, int] = {}
        for variable in self.variables.values():
            sizes.update(zip(variable.dims, variable.values.shape, strict=True))
        return sizes


def _written_as(values: NDArray[Any]) -> NDArray[Any]:
    """The values; texts as objects, for which zarr has a stable type (of text of one length it has none)."""
    return values.astype(object) if values.dtype.kind == "U" else values


def _read_as(values: NDArray[Any], label: bool) -> NDArray[Any]:
    """The values; labels that are texts of any type as texts of one length."""
    return values.astype(str) if label and values.dtype.kind in "OT" else values


def _by_depth(paths: Iterable[str]) -> list[str]:
    """Paths and those above them, level by level as xarray lists them."""

    def depth(path: str) -> int:
        return len(PurePosixPath(path).parts)

    given = sorted(paths, key=depth)
    every = {str(p): None for path in given for p in (*reversed(PurePosixPath(path).parents), path)}
    return sorted(every, key=depth)


def with_labels(groups: Mapping[str, Group]) -> Iterator[tuple[str, Group]]:
    """Groups by path, with the labels of their dimensions from the groups above where they have none of their own."""
    for path in _by_depth(groups):
        group = groups.get(path) or Group({})
        above = [groups[str(p)] for p in PurePosixPath(path).parents if str(p) in groups]
        handed = {name: v for other in reversed(above) for name, v in other.indexes().items()}
        sizes = group.sizes()
        missing = {name: v for name, v in handed.items() if name in sizes and name not in group.variables}
        yield path, Group({**group.variables, **missing}, group.labels | set(missing), group.attrs)


UNITS: Final = "unit_system"
"""Attribute of the root: the system of units of the scene."""
CONVENTIONS = "CF-1.11 UGRID-1.0"
SCHEMA_VERSION = "1.5"
"""Changes its first number when a name or meaning changes, the second when something is added."""


@dataclass(frozen=True)
class Meaning:
    """What a variable is: UDUNITS ``units`` (None for labels and text), ``long_name``, maybe ``comment``."""

    units: str | None
    long_name: str
    comment: str | None = None

    def attributes(self) -> dict[str, str]:
        """As netCDF attributes, absent ones left out."""
        pairs = {"units": self.units, "long_name": self.long_name, "comment": self.comment}
        return {key: value for key, value in pairs.items() if value is not None}


COORDINATES: Final[Mapping[str, Meaning]] = {
    "time": Meaning("s", "time since the start of the run"),
    "component": Meaning(None, "global axis"),
    "side": Meaning(None, "side of the interface"),
    "x": Meaning("m", "x of the interface point, reference configuration, side E"),
    "y": Meaning("m", "y of the interface point, reference configuration, side E"),
    "z": Meaning("m", "z of the interface point, reference configuration, side E"),
    "node_x": Meaning("m", "x of the node, reference configuration"),
    "node_y": Meaning("m", "y of the node, reference configuration"),
    "node_z": Meaning("m", "z of the node, reference configuration"),
    "stress_component": Meaning(None, "component of the symmetric stress tensor"),
    "strain_component": Meaning(None, "component of the symmetric strain tensor"),
    "principal": Meaning("1", "number of the principal value, largest first"),
    "window": Meaning("1", "number of the window, from 1"),
    "iteration": Meaning("1", "number of the LATIN iteration in its window, from 1"),
}

INTERFACE: Final[Mapping[str, Meaning]] = {
    "area": Meaning("m2", "area carried by the interface point"),
    "normal": Meaning("1", "unit normal N, from side E to side Ep"),
    "initial_gap": Meaning("m", "gap at the start of the run"),
    "traction": Meaning("Pa", "traction exerted by the interface on side E", "local-stage field"),
    "velocity": Meaning("m s-1", "velocity of both sides of the interface", "local-stage field"),
    "gap": Meaning("m", "opening along N, from the displacements", "negative where the sides penetrate"),
    "contact_status": Meaning(None, "contact status", "a closed frictionless point has status slip"),
    "force": Meaning("N", "resultant force exerted by the interface on side E"),
    "impulse": Meaning("N s", "force integrated over time since the start of the run"),
    "peak_force": Meaning("N", "largest mean of the normal resultant over the time of the attribute peak_duration (s)"),
    "peak_force_raw": Meaning("N", "largest normal resultant of all instants", "has no limit where bodies land"),
    "pressure": Meaning("Pa", "normal pressure, positive in compression", "local-stage field"),
    "slip": Meaning("m", "distance that side Ep has moved along the face of E while in contact, from the start"),
    "cells": Meaning(None, "points of each triangle or quadrilateral of the surface", "-1: the cell has three points"),
    "surface": Meaning(None, "topology of the surface of the interface"),
    "surface_x": Meaning("m", "first coordinate of the point in the mean plane of the interface"),
    "surface_y": Meaning("m", "second coordinate of the point in the mean plane of the interface"),
    "friction_power": Meaning("W", "power dissipated by friction"),
    "layer_energy": Meaning("J", "elastic energy of the layer"),
    "joint_power": Meaning("W", "power dissipated by the viscous joint"),
    "error_indicator": Meaning(
        "1", "error indicator sqrt(eta) of this interface", "largest over the windows, at their last iteration"
    ),
}

SUBSTRUCTURE: Final[Mapping[str, Meaning]] = {
    "displacement": Meaning("m", "displacement", "linear-stage field"),
    "velocity": Meaning("m s-1", "velocity", "linear-stage field"),
    "stress": Meaning("Pa", "mean stress of the element, tension positive", "linear-stage field"),
    "strain": Meaning("1", "mean strain of the element", "components of the tensor: half the engineering shear"),
    "nodal_stress": Meaning(
        "Pa", "stress at the node, tension positive", "mean over the elements around the node, by volume"
    ),
    "principal_stress": Meaning("Pa", "principal values of the mean stress of the element"),
    "nodal_principal_stress": Meaning("Pa", "principal values of the stress at the node"),
    "cell_nodes": Meaning(None, "nodes of each element, in VTK order", "-1: the element has fewer nodes"),
    "mesh": Meaning(None, "topology of the mesh"),
}

REACTION: Final[Mapping[str, Meaning]] = {"force": Meaning("N", "resultant force exerted by the support on the body")}

BOLT: Final[Mapping[str, Meaning]] = {
    "force": Meaning("N", "tension of the shank", "resultant along the axis of the stresses on a cut of the shank"),
    "mean_stress": Meaning("Pa", "tension of the shank over its section"),
    "shortening": Meaning("m", "shortening of the shank, counted from before the bolts were tightened"),
    "section_area": Meaning("m2", "section of the shank across its axis"),
    "order": Meaning("1", "bolts tightened last, in ascending order"),
    "tightening_force": Meaning("N", "tension when the bolts of each order were tight, before other loads"),
}

SENSOR: Final[Mapping[str, Meaning]] = {
    "displacement": Meaning("m", "displacement of the sensor"),
    "velocity": Meaning("m s-1", "velocity of the sensor"),
    "acceleration": Meaning(
        "m s-2",
        "acceleration of the sensor",
        "acceleration of the time scheme; where the scheme weights forces of two instants, that of about a tenth of a "
        "step earlier",
    ),
    "displacement_filtered": Meaning("m", "displacement of the sensor, low pass"),
    "velocity_filtered": Meaning("m s-1", "velocity of the sensor, low pass"),
    "acceleration_filtered": Meaning("m s-2", "acceleration of the sensor, low pass"),
    "x": Meaning("m", "x of the sensor, reference configuration"),
    "y": Meaning("m", "y of the sensor, reference configuration"),
    "z": Meaning("m", "z of the sensor, reference configuration"),
}

SPECTRUM: Final[Mapping[str, Meaning]] = {
    "frequency": Meaning("Hz", "natural frequency of the oscillator"),
    "response": Meaning(None, "part of the response", "primary: during the record, residual: after it"),
    "acceleration": Meaning("m s-2", "largest absolute acceleration of the oscillator"),
    "pseudo_velocity": Meaning("m s-1", "largest relative displacement of the oscillator times its angular frequency"),
    "relative_error": Meaning(
        "1",
        "estimated relative error of the spectrum",
        "difference from the spectrum of a run on a coarser mesh with a longer step over (ratio of steps - 1), for "
        "errors of first order; the largest within half an octave",
    ),
}

MODES: Final[Mapping[str, Meaning]] = {
    "mode": Meaning("1", "number of the mode, rigid motions first"),
    "frequency": Meaning("Hz", "natural frequency, 0 for rigid motions"),
    "rigid": Meaning(None, "whether the mode is a rigid motion"),
    "modal_mass": Meaning("kg", "modal mass", "of the shape whose largest nodal displacement is 1"),
    "scheme_damping": Meaning(
        "1", "damping ratio of the time scheme in a run with the step of the scene", "share of critical damping"
    ),
    "landing_damping": Meaning(
        "1", "damping ratio of the viscous layer at faces that may open", "share of critical damping"
    ),
    "body_damping": Meaning(
        "1", "damping ratio of Rayleigh damping, absorbing faces and wave ports", "share of critical damping"
    ),
    "shape": Meaning("1", "displacement in the mode, largest nodal displacement of the assembly 1"),
    "cell_nodes": Meaning(None, "nodes of each element, in VTK order", "-1: the element has fewer nodes"),
    "mesh": Meaning(None, "topology of the mesh"),
}

ENERGY: Final[Mapping[str, Meaning]] = {
    "kinetic": Meaning("J", "kinetic energy"),
    "elastic": Meaning("J", "elastic energy"),
    "work_of_loads": Meaning("J", "work of the loads since the start of the run"),
    "interface_work": Meaning("J", "work of the interface tractions on the substructures since the start of the run"),
    "friction_dissipation": Meaning("J", "energy dissipated by friction since the start of the run"),
    "contact_dissipation": Meaning("J", "energy lost to the normal contact law (impacts) since the start of the run"),
    "drift_work": Meaning(
        "J",
        "work against the laws of the interfaces since the start of the run: of the solver's errors of place",
        "positive: the bodies gain it",
    ),
    "layer_energy": Meaning("J", "elastic energy of the layers"),
    "joint_dissipation": Meaning("J", "energy dissipated by viscous joints since the start of the run"),
    "ground_work": Meaning("J", "work of moving ground since the start of the run"),
    "damping_dissipation": Meaning("J", "energy dissipated by material damping since the start of the run"),
    "landing_dissipation": Meaning(
        "J", "energy dissipated by the viscosity of contact layers since the start of the run"
    ),
    "scheme_dissipation": Meaning("J", "energy dissipated by the time scheme since the start of the run"),
    "balance": Meaning("J", "residual of the energy balance"),
}

RESULTANTS: Final[Mapping[str, Meaning]] = {
    "load_force": Meaning("N", "sum of the loads at the end, with what balances a preload"),
    "interface_force": Meaning("N", "sum of the interface forces at the end"),
    "reaction_force": Meaning("N", "sum of the forces of the supports at the end"),
    "unbalanced_force": Meaning("N", "sum of the forces that are not in balance at the end"),
    "load_moment": Meaning("N m", "moment of the loads about the centre of the body"),
    "interface_moment": Meaning("N m", "moment of the interface forces about the centre of the body"),
    "reaction_moment": Meaning("N m", "moment of the forces of the supports about the centre of the body"),
    "unbalanced_moment": Meaning("N m", "moment of what is not in balance about the centre of the body"),
    "substructure": Meaning(None, "substructure"),
}

CONVERGENCE: Final[Mapping[str, Meaning]] = {
    "error_indicator": Meaning("1", "error indicator sqrt(eta) after each iteration"),
    "force_mismatch": Meaning("1", "relative difference of the forces of both stages after each iteration"),
    "iterations": Meaning("1", "LATIN iterations of the window"),
    "newton_steps": Meaning("1", "iterations of the window that were Newton steps"),
    "defect": Meaning(
        "1", "residual of the laws of interfaces with truncated tables, in the norm of the error indicator"
    ),
    "corrections": Meaning("1", "corrections of the window by exact velocities"),
    "converged": Meaning(None, "whether the window converged"),
    "first_instant": Meaning("1", "index in time of the first instant of the window"),
    "last_instant": Meaning("1", "index in time of the last instant of the window"),
    "end_time": Meaning("s", "time at the end of the window"),
    "fallbacks": Meaning(None, "fall-backs used in the window, in order"),
    "passes": Meaning("1", "substructure-instants solved / (substructures x instants)"),
}

_FLAGS: Final[Mapping[str, tuple[list[int], str]]] = {
    "contact_status": ([0, 1, 2], "separation stick slip"),
    "converged": ([0, 1], "not_converged converged"),
    "rigid": ([0, 1], "elastic rigid"),
}


def annotated(group: Group, meanings: Mapping[str, Meaning]) -> Group:
    """``group`` with units, long names and flags from ``meanings`` and ``COORDINATES``, in place.

    The long name of a variable without an entry is its name.
    """
    for name, variable in group.variables.items():
        meaning = meanings.get(name) or COORDINATES.get(name) or _unexplained(name, meanings)
        variable.attrs.update(meaning.attributes())
        if name in _FLAGS and name in meanings:
            values, words = _FLAGS[name]
            variable.attrs.update(flag_values=np.array(values, dtype=np.int8), flag_meanings=words)
    return group


def in_units(groups: dict[str, Group], units: UnitSystem) -> dict[str, Group]:
    """``groups`` with the names that their units have in the system of a scene, in place; the root names the system."""
    for group in groups.values() if units.names else ():
        for variable in group.variables.values():
            if "units" in variable.attrs:
                variable.attrs["units"] = units.label(variable.attrs["units"])
    if "/" in groups:
        groups["/"].attrs[UNITS] = units.name
    return groups


def units_of(attributes: Mapping[Any, Any]) -> UnitSystem:
    """System of units of results, from the attributes of their root; SI where they do not say."""
    return system_named(attributes.get(UNITS))


def unit_of(variable: xr.DataArray, si: str) -> str:
    """Unit (UDUNITS) of stored values; ``si``: that of files without one."""
    return str(variable.attrs.get("units", si))


def _unexplained(name: str, meanings: Mapping[str, Meaning]) -> Meaning:
    return Meaning("J" if meanings is ENERGY else None, name.replace("_", " "))


# -- volume meshes by UGRID ------------------------------------------------------------
_FEWEST: Final = np.array([4, 5, 6, 8])  # corners
_CORNERS: Final = np.zeros(28, dtype=np.int64)  # by number of nodes
_CORNERS[[4, 10]], _CORNERS[[5, 13]], _CORNERS[[6, 15, 18]], _CORNERS[[8, 20, 27]] = _FEWEST
_SHAPES: Final[Mapping[str, Any]] = {
    "long_name": "shape of the element",
    "flag_values": np.arange(4, dtype=np.int8),
    "flag_meanings": "tetrahedron pyramid wedge hexahedron",
}
"""UGRID's names of the shapes, by the number of corners."""


def describe_mesh(group: Group, cell_type: str, along: str = "time") -> None:
    """UGRID attributes of a three-dimensional unstructured mesh, and of the fields on it, which have a dimension
    ``along``."""
    group.variables["mesh"].attrs.update(
        cf_role="mesh_topology",
        topology_dimension=np.int32(3),
        node_coordinates="node_x node_y node_z",
        volume_node_connectivity="cell_nodes",
        volume_shape_type="cell_shape",
        cell_type=cell_type,
    )
    nodes = (group.variables["cell_nodes"].values >= 0).sum(axis=1)
    shape = np.searchsorted(_FEWEST, _CORNERS[nodes]).astype(np.int8)
    group.variables["cell_shape"] = Variable(("cell",), shape, dict(_SHAPES))
    group.variables["cell_nodes"].attrs.update(cf_role="volume_node_connectivity", start_index=np.int32(0))
    for name, variable in group.variables.items():
        if along in variable.dims and name not in group.labels:
            variable.attrs.update(mesh="mesh", location="volume" if "cell" in variable.dims else "node")
