"""Groups of a results file as plain arrays, made of rows of quantities; their units, their labels, their meshes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..machine import provenance
from ..scene.units import ACCELERATION, AS_G, UnitSystem, system_named
from .quantities import Columns

if TYPE_CHECKING:
    import xarray as xr


@dataclass
class StoredVariable:
    """An array with the names of its dimensions and its attributes."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: dict[str, Any] = field(default_factory=dict)


@dataclass
class StoredGroup:
    """Variables of one group; ``labels`` names the coordinates among them.

    A coordinate with the name of its only dimension labels what lies along it, in the groups below too.
    """

    variables: dict[str, StoredVariable]
    labels: frozenset[str] = frozenset()
    attrs: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, columns: Columns, labels: Columns = (), attrs: dict[str, Any] | None = None) -> StoredGroup:
        """From rows with values: variables, and coordinates; texts are coordinates, so that two files can be
        subtracted."""
        variables = {
            row.name: StoredVariable(row.dims, np.asarray(v), row.attributes) for row, v in (*columns, *labels)
        }
        texts = {name for name, variable in variables.items() if variable.values.dtype.kind in "OU"}
        return cls(variables, frozenset({*texts, *(row.name for row, _ in labels)}), attrs or {})

    @classmethod
    def of_dataset(cls, dataset: xr.Dataset) -> StoredGroup:
        """The group of an xarray dataset."""
        variables = {
            str(name): StoredVariable(
                tuple(map(str, v.dims)), _read_as(v.values, name in dataset.coords), dict(v.attrs)
            )
            for name, v in dataset.variables.items()
        }
        return cls(variables, frozenset(map(str, dataset.coords)), dict(dataset.attrs))

    def dataset(self) -> xr.Dataset:
        """The group as an xarray dataset."""
        import xarray as xr

        variables = {name: (v.dims, _written_as(v.values), v.attrs) for name, v in self.variables.items()}
        data = {name: v for name, v in variables.items() if name not in self.labels}
        return xr.Dataset(data, {name: variables[name] for name in variables if name in self.labels}, self.attrs)

    def report(self) -> dict[str, Any]:
        """Plain data for strict JSON: the attributes, and of each variable ``dims``, ``units`` where it has some, and
        ``values`` (None for a number that is not finite)."""
        entries: dict[str, Any] = {name: _plain(np.asarray(value)) for name, value in self.attrs.items()}
        for name, variable in self.variables.items():
            units = {}
            if "units" in variable.attrs:
                units = {"units": variable.attrs["units"]}
            entries[name] = {"dims": list(variable.dims), **units, "values": _plain(variable.values)}
        return entries

    def indexes(self) -> dict[str, StoredVariable]:
        """Coordinates that label their own dimension."""
        return {name: v for name, v in self.variables.items() if name in self.labels and v.dims == (name,)}

    def sizes(self) -> dict[str, int]:
        """Length of every dimension, in the order of the variables."""
        sizes: dict[str, int] = {}
        for variable in self.variables.values():
            sizes.update(zip(variable.dims, variable.values.shape, strict=True))
        return sizes


def finite(value: float | None) -> float | None:
    """A number for strict JSON: None in the place of one that is not finite."""
    if value is not None and math.isfinite(value):
        return float(value)
    return None


def _plain(values: NDArray[Any]) -> Any:
    """Values as numbers and texts of Python."""
    if values.dtype.kind == "f":
        # strict JSON has neither NaN nor infinity
        values = np.where(np.isfinite(values), values.astype(object), np.array(None))
    return values.tolist()


def _written_as(values: NDArray[Any]) -> NDArray[Any]:
    """The values; texts as objects, for which zarr has a stable type (of text of one length it has none)."""
    if values.dtype.kind == "U":
        return values.astype(object)
    return values


def _read_as(values: NDArray[Any], label: bool) -> NDArray[Any]:
    """The values; labels that are texts of any type as texts of one length."""
    if label and values.dtype.kind in "OT":
        return values.astype(str)
    return values


def _by_depth(paths: Iterable[str]) -> list[str]:
    """Paths and those above them, level by level as xarray lists them."""

    def depth(path: str) -> int:
        return len(PurePosixPath(path).parts)

    groups = sorted(paths, key=depth)
    every = {str(p): None for path in groups for p in (*reversed(PurePosixPath(path).parents), path)}
    return sorted(every, key=depth)


def with_labels(groups: Mapping[str, StoredGroup]) -> Iterator[tuple[str, StoredGroup]]:
    """Groups by path, with the labels of their dimensions from the groups above where they have none of their own."""
    for path in _by_depth(groups):
        group = groups.get(path) or StoredGroup({})
        above = [groups[str(p)] for p in PurePosixPath(path).parents if str(p) in groups]
        handed = {name: v for other in reversed(above) for name, v in other.indexes().items()}
        sizes = group.sizes()
        missing = {name: v for name, v in handed.items() if name in sizes and name not in group.variables}
        yield path, StoredGroup({**group.variables, **missing}, group.labels | set(missing), group.attrs)


UNITS: Final = "unit_system"
SHOWN_ACCELERATION: Final = "shown_acceleration"
SHOWN: Final = "shown_units"
"""Attributes of a file, and of a variable, that figures and tables show in another unit than it is stored in."""
"""Attribute of the root: the system of units of the scene."""
CONVENTIONS = "CF-1.11 UGRID-1.0"
SCHEMA_VERSION = "2.0"
"""Changes its first number when a name or meaning changes, the second when something is added."""
READ_VERSIONS: Final = ("1", "2")
"""First numbers that are read: names of the first are brought to those of today (``files.open_results``)."""
SCENE_KEY: Final = "scene_key"
"""Attribute of a parameter of a study: the dotted name of the key of the scene that it is."""


def plain_name(key: str) -> str:
    """Name of a variable or dimension, of letters, digits and underscores (CF 2.3), of a dotted key of a scene.

    >>> plain_name("interface.crush.friction_coefficient")
    'interface_crush_friction_coefficient'
    """
    return re.sub(r"\W", "_", key, flags=re.ASCII)


def key_of(parameter: xr.DataArray) -> str:
    """Dotted key of a parameter of a study."""
    return str(parameter.attrs.get(SCENE_KEY, parameter.name))


def root_attributes(title: str, scene_name: str, scene: str, origin: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Attributes of the root of a file: versions and time of creation, conventions, what it holds, and the scene;
    ``origin`` : the first two, now where None."""
    if origin is None:
        origin = provenance()
    return {
        **origin,
        "Conventions": CONVENTIONS,
        "schema_version": SCHEMA_VERSION,
        "title": f"{scene_name}: {title}",
        "scene_name": scene_name,
        "scene": scene,
    }


def in_units(groups: dict[str, StoredGroup], units: UnitSystem) -> dict[str, StoredGroup]:
    """``groups`` with the names that their units have in the system of a scene, in place; the root names the system."""
    # SI has no names of its own: nothing to do
    for group in groups.values() if units.names or units.in_g else ():
        for variable in group.variables.values():
            label_in(variable.attrs, units)
    if "/" in groups:
        groups["/"].attrs.update(unit_attributes(units))
    return groups


def label_in(attributes: dict[Any, Any], units: UnitSystem) -> None:
    """The unit of a variable as it is called in a system, and how it is shown, in place."""
    if "units" in attributes:
        if units.in_g and attributes["units"] == ACCELERATION:
            attributes[SHOWN] = "g"
        attributes["units"] = units.label(attributes["units"])


def unit_attributes(units: UnitSystem) -> dict[str, str]:
    """Attributes of the root of a file that name the system of its units, and how accelerations are shown."""
    if units.in_g:
        return {UNITS: units.name, SHOWN_ACCELERATION: "g"}
    return {UNITS: units.name}


def units_of(attributes: Mapping[Any, Any]) -> UnitSystem:
    """System of units of results, from the attributes of their root; SI where they do not say."""
    return system_named(attributes.get(UNITS), attributes.get(SHOWN_ACCELERATION) == "g")


def unit_of(variable: xr.DataArray, si: str) -> str:
    """Unit (UDUNITS) of stored values for ``readable``, marked where they are shown in g; ``si``: that of files without
    one."""
    unit = str(variable.attrs.get("units", si))
    if variable.attrs.get(SHOWN) == "g":
        return unit + AS_G
    return unit


def children_of(tree: xr.DataTree, kind: str) -> Mapping[str, xr.DataTree]:
    """Groups by name below ``kind`` (interfaces, sensors, ...), none where there is no such group."""
    if kind in tree.children:
        return tree.children[kind].children
    return {}


def datasets_of(tree: xr.DataTree, kind: str) -> dict[str, xr.Dataset]:
    """Datasets of those groups, by name."""
    return {name: node.to_dataset() for name, node in children_of(tree, kind).items()}


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


def describe_mesh(group: StoredGroup, cell_type: str, along: str = "time") -> None:
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
    # the number of corners gives the shape of a cell of any degree
    shape = np.searchsorted(_FEWEST, _CORNERS[nodes]).astype(np.int8)
    group.variables["cell_shape"] = StoredVariable(("cell",), shape, dict(_SHAPES))
    group.variables["cell_nodes"].attrs.update(cf_role="volume_node_connectivity", start_index=np.int32(0))
    for name, variable in group.variables.items():
        if along in variable.dims and name not in group.labels:
            variable.attrs.update(mesh="mesh", location="volume" if "cell" in variable.dims else "node")
