"""What most scripts take from a results file: resultants, maps of pressure, skins of bodies, spectra of sensors.

The functions take the DataTree of ``open_results`` or ``Solution.to_datatree`` and return xarray objects with units.
Maps and skins are UGRID meshes that ``xugrid.UgridDataset`` opens and plots.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, Problem
from ..fem.mesh import Mesh, boundary, cell_blocks
from .files import readable
from .groups import unit_of, units_of
from .quantities_of_interest import InterfaceFields, friction_resultant, normal_resultant
from .spectra import RESPONSES, shock_response_spectrum

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]


def resultant(tree: xr.DataTree, interface: str) -> xr.Dataset:
    """Force of an interface over time: ``force`` (time, component) on its first side, ``normal`` (time), positive in
    compression, and ``friction`` (time), the magnitude of the tangential resultant; N.

    Raises InputError where there is no such interface.

    Examples
    --------
    >>> tree = latin_fmu.solve(latin_fmu.load_scene("models/impact_bar/scene.toml")).to_datatree()
    >>> latin_fmu.resultant(tree, "wall")["normal"].sizes["time"]
    401
    """
    group = _group(tree, "interfaces", interface)
    with readable(_source(tree)):
        fields = InterfaceFields.of_dataset(group)
        made = group[["force"]]
    for name, values, text in (
        ("normal", normal_resultant(fields), "normal resultant, positive in compression"),
        ("friction", friction_resultant(fields), "magnitude of the tangential resultant"),
    ):
        made[name] = ("time", values, {"units": unit_of(made["force"], "N"), "long_name": text})
    return made


def pressure_map(tree: xr.DataTree, interface: str, time: float | None = None) -> xr.Dataset:
    """Contact pressure of an interface as a UGRID mesh in its mean plane: ``pressure`` (point), Pa, and ``area``.

    time : the stored instant nearest to it is taken, s; that with the largest normal force where None.

    Raises InputError where there is no such interface, or its points carry no cells.

    Examples
    --------
    >>> solution = latin_fmu.solve(latin_fmu.load_scene("models/two_specimen_crushing/scene.toml"))
    >>> made = latin_fmu.pressure_map(solution.to_datatree(), "crush")
    >>> made["pressure"].dims, made["pressure"].attrs["units"]
    (('point',), 'Pa')
    """
    group = _group(tree, "interfaces", interface)
    if "cells" not in group:
        what = "has no surface: its points carry no cells"
        raise InputError([Problem(f"interface {interface}", what)], "there is no map")
    with readable(_source(tree)):
        fields = InterfaceFields.of_dataset(group)
    at = int(normal_resultant(fields).argmax() if time is None else np.abs(fields.time - time).argmin())
    pressure = -np.einsum("pc,pc->p", fields.traction[at], fields.normals) + 0.0  # no negative zero
    attrs = {
        "units": unit_of(group["traction"], "Pa"),
        "long_name": "contact pressure",
        "mesh": "surface",
        "location": "node",
    }
    made = group[["surface", "cells", "area"]]
    made["pressure"] = ("point", pressure, attrs)
    return made.assign_attrs(time=float(fields.time[at]))


def skin(tree: xr.DataTree, substructure: str) -> xr.Dataset:
    """Outer surface of a body as a UGRID mesh of faces, projected along z: node_x, node_y, node_z (node), m, ``faces``
    (face, corner), and the fields at its nodes that the file holds, e.g. ``velocity`` (time, node, component).

    Raises InputError where no field of this substructure is in the file (``output.fields = true``).

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/impact_bar/scene.toml", ["output.fields=true"])
    >>> made = latin_fmu.skin(latin_fmu.solve(scene).to_datatree(), "bar")
    >>> made["faces"].dims
    ('face', 'corner')
    """
    group = _group(tree, "substructures", substructure, "store fields: output.fields = true")
    with readable(_source(tree)):
        nodes = np.stack([group[f"node_{axis}"].values for axis in "xyz"], axis=1)
        tables = [block.corners for block in boundary(Mesh(nodes, cell_blocks(group["cell_nodes"].values), {})).blocks]
    corners = np.full((sum(map(len, tables)), max(t.shape[1] for t in tables)), -1, dtype=np.int64)
    row = 0
    for table in tables:
        corners[row : row + len(table), : table.shape[1]] = table
        row += len(table)
    used, numbers = np.unique(corners[corners >= 0], return_inverse=True)
    corners[corners >= 0] = numbers
    fields = [str(name) for name, v in group.data_vars.items() if "node" in v.dims]
    made = group[fields].isel(node=used).drop_attrs(deep=False)
    for name in fields:
        made[name].attrs.update(mesh="skin", location="node")
    connectivity = {
        "cf_role": "face_node_connectivity",
        "start_index": np.int32(0),
        "long_name": "corners of the faces",
    }
    made["faces"] = (("face", "corner"), corners, connectivity | {"_FillValue": np.int64(-1)})
    made["skin"] = (
        (),
        np.int32(0),
        {
            "cf_role": "mesh_topology",
            "topology_dimension": np.int32(2),
            "node_coordinates": "node_x node_y",
            "face_node_connectivity": "faces",
            "node_dimension": "node",
            "face_dimension": "face",
            "long_name": f"skin of {substructure}, in the plane of x and y",
        },
    )
    return made


def sensor_spectrum(tree: xr.DataTree, sensor: str, frequencies: ArrayLike, quality: float = 10.0) -> xr.Dataset:
    """Shock response spectrum of the stored acceleration of a sensor: ``acceleration`` (response, frequency,
    component), m s-2, and ``pseudo_velocity``, m s-1; see ``shock_response_spectrum``.

    Raises InputError where there is no such sensor, or as ``shock_response_spectrum``.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/lap_joint/shock.toml", ["time.end=50e-6"])
    >>> tree = latin_fmu.solve(scene).to_datatree()
    >>> latin_fmu.sensor_spectrum(tree, "end", [20e3, 50e3])["acceleration"].dims
    ('response', 'frequency', 'component')
    """
    import xarray as xr

    history = _history(tree, sensor, "acceleration")
    step = float(history["time"][1] - history["time"][0])
    made = shock_response_spectrum(history.values, step, frequencies, quality)
    dims = ("response", "frequency", "component")
    label = units_of(tree.attrs).label
    hertz = {"units": "Hz", "long_name": "natural frequency of the oscillator"}
    return xr.Dataset(
        {
            "acceleration": (dims, made.acceleration, {"units": label("m s-2"), "long_name": "largest acceleration"}),
            "pseudo_velocity": (
                dims,
                made.pseudo_velocity,
                {"units": label("m s-1"), "long_name": "largest pseudo-velocity"},
            ),
        },
        {
            "response": np.array(RESPONSES, dtype=object),
            "frequency": ("frequency", made.frequency, hertz),
            "component": history["component"].values,
        },
        {"quality": quality},
    )


def amplitude_spectrum(tree: xr.DataTree, sensor: str, quantity: str = "acceleration") -> xr.DataArray:
    """Amplitudes (frequency, component) of the harmonics of a history of a sensor, its mean at 0 Hz:

        A_k = (2 / n) |sum over j of x_j exp(-2 pi i j k / n)|,    without the factor 2 at k = 0 and at n / 2.

    The n instants are one period, without window function; unit of the history.

    Raises InputError where there is no such sensor or quantity.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/gripped_bar/scene.toml")
    >>> tree = latin_fmu.solve(scene).to_datatree()
    >>> latin_fmu.amplitude_spectrum(tree, "end", "displacement").dims
    ('frequency', 'component')
    """
    history = _history(tree, sensor, quantity)
    n, step = len(history), float(history["time"][1] - history["time"][0])
    amplitude = np.abs(np.fft.rfft(history.values, axis=0)) * (2.0 / n)
    amplitude[[0, -1] if n % 2 == 0 else [0]] *= 0.5
    coords = {"frequency": ("frequency", np.fft.rfftfreq(n, step), {"units": "Hz", "long_name": "frequency"})}
    made = history.drop_vars("time").rename(time="frequency").isel(frequency=slice(len(amplitude)))
    return made.copy(data=amplitude).assign_coords(coords)


def _history(tree: xr.DataTree, sensor: str, quantity: str) -> xr.DataArray:
    group = _group(tree, "sensors", sensor)
    if quantity not in group or group[quantity].dims != ("time", "component") or len(group["time"]) < 2:
        allowed = ", ".join(str(n) for n, v in group.data_vars.items() if v.dims == ("time", "component"))
        raise InputError([Problem(f"sensor {sensor}", "has no such history", quantity, allowed or "none")])
    return group[quantity]


def _source(tree: xr.DataTree) -> str:
    """Name of the file of a tree, for errors."""
    return str(tree.encoding.get("source", "results"))


def _group(tree: Mapping[str, Any], kind: str, name: str, remedy: str | None = None) -> xr.Dataset:
    """A group of the results as a dataset of its own. Raises InputError where it is missing."""
    groups = tree[kind].children if kind in tree else {}
    if name not in groups or not groups[name].data_vars:
        there = ", ".join(n for n, group in groups.items() if group.data_vars) or "none"
        raise InputError([Problem(f"{kind}/{name}", "is not in the results", None, there, remedy)])
    dataset: xr.Dataset = groups[name].to_dataset()
    return dataset
