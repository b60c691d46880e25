"""Export for ParaView: one ``.vtu`` file per part and stored instant, and one ``.pvd`` that lists them.

Substructures carry their fields, stresses with the von Mises stress; interfaces are surfaces of triangles and
quadrilaterals with traction, pressure, velocities, gap and contact status; all sensors are one cloud of points. Both
are exported at the instants at which the fields of the substructures are stored, so that every instant shows the whole
assembly; where no field is stored, at all instants of the run.
"""

from __future__ import annotations

import os
import zlib
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Protocol
from xml.sax.saxutils import quoteattr

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..fem.elasticity import von_mises
from ..fem.mesh import cell_blocks
from ..latin.outcome import Array
from .quantities import SENSOR
from .writing import check_folder, unwritable, write_whole

_VTK_TENSOR: Final = ["xx", "yy", "zz", "xy", "yz", "xz"]
"""Order in which VTK reads six numbers as a symmetric tensor; ours is xx yy zz yz xz xy."""


_VTK_CELLS: Final = MappingProxyType(
    {
        "vertex": 1,
        "triangle": 5,
        "quad": 9,
        "tetra": 10,
        "hexahedron": 12,
        "wedge": 13,
        "pyramid": 14,
        "tetra10": 24,
        "hexahedron20": 25,
        "wedge15": 26,
        "pyramid13": 27,
        "hexahedron27": 29,
        "wedge18": 32,
    }
)
"""Numbers of the types of cells (vtkCellType.h)."""


class HasTree(Protocol):
    """Anything that can turn into a DataTree, e.g. a ``Solution``."""

    def to_datatree(self) -> xr.DataTree:
        """The results, laid out as in ``results.dataset``."""
        ...


@dataclass(frozen=True)
class _Piece:
    """What one .vtu file holds; cells and their fields block by block of one type of cells."""

    points: Array
    cells: list[tuple[str, NDArray[np.int64]]]
    point_data: dict[str, NDArray[Any]]
    cell_data: dict[str, list[NDArray[Any]]]


def check_export_folder(folder: str | Path) -> Path:
    """Make sure an export can be written to ``folder``: new, empty, or holding an earlier export only; the folder that
    its links lead to.

    Raises
    ------
    ResultsError : it holds other files, is no folder, or its parent cannot be written to.
    """
    target = Path(os.path.realpath(folder))
    if os.path.lexists(target) and not target.is_dir():
        raise unwritable(target, "this is not a folder", "choose another folder")
    if target.is_dir() and any(path.suffix not in (".vtu", ".pvd") for path in target.iterdir()):
        raise unwritable(target, "the folder holds other files, an export would mix with them", "name a new folder")
    check_folder(target.parent)
    return target


def export_vtu(results: xr.DataTree | HasTree, folder: str | Path) -> Path:
    """Write the export to ``folder``, whole or not at all; return the path of ``results.pvd``.

    An earlier export in ``folder`` is replaced.

    Raises
    ------
    UnwrittenError : the folder cannot be used (see ``check_export_folder``) or writing failed.
    """
    if isinstance(results, xr.DataTree):
        tree = results
    else:
        tree = results.to_datatree()
    write_whole(folder, lambda draft: _write_all(tree, draft), check_export_folder)
    return Path(folder) / "results.pvd"


def _write_all(tree: xr.DataTree, folder: Path) -> None:
    folder.mkdir()
    entries = []
    for part, (name, dataset) in enumerate(_parts(tree).items()):
        if "mesh" in dataset:
            make = _substructure_piece
        else:
            if "sensor" in dataset:
                make = _sensor_piece
            else:
                make = _interface_piece
        for i, time in enumerate(dataset["time"].values):
            piece = make(dataset.isel(time=i))
            file = f"{name}_{i:05d}.vtu"
            (folder / file).write_bytes(_vtu(piece))
            entries.append(
                f'    <DataSet timestep="{float(time)!r}" part="{part}" name={quoteattr(name)} file={quoteattr(file)}/>'
            )
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">']
    lines = [*head, "  <Collection>", *entries, "  </Collection>", "</VTKFile>", ""]
    (folder / "results.pvd").write_text("\n".join(lines), encoding="utf-8")


def _vtu(piece: _Piece) -> bytes:
    """Text of a .vtu file (VTK XML format, version 1.0), numbers packed by zlib."""
    counts = [cells.shape for _, cells in piece.cells]
    flat = [cells.ravel() for _, cells in piece.cells]
    arrays = {
        "connectivity": np.concatenate(flat),
        "offsets": np.cumsum(np.concatenate([np.full(n, width) for n, width in counts])),
        "types": np.concatenate([np.full(len(c), _VTK_CELLS[kind], dtype=np.uint8) for kind, c in piece.cells]),
    }
    by_cell = {name: np.concatenate(blocks) for name, blocks in piece.cell_data.items()}
    sections = {"PointData": piece.point_data, "CellData": by_cell, "Points": {"points": piece.points}, "Cells": arrays}
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        'compressor="vtkZLibDataCompressor">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{len(piece.points)}" NumberOfCells="{len(arrays["types"])}">',
    ]
    for section, fields in sections.items():
        lines += [f"<{section}>", *(_data_array(name, values) for name, values in fields.items()), f"</{section}>"]
    return "\n".join([*lines, "</Piece>", "</UnstructuredGrid>", "</VTKFile>", ""]).encode()


def _data_array(name: str, values: NDArray[Any]) -> str:
    """An array of a .vtu file in one block: counts and sizes, then what zlib makes of the numbers."""
    kind = {"f": "Float64", "i": "Int64", "u": "UInt8", "b": "UInt8"}[values.dtype.kind]
    data = np.ascontiguousarray(values, dtype={"Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}[kind]).tobytes()
    packed = zlib.compress(data)
    # number of blocks, size of a block, of the last one (0: as the others), packed size of each
    if data:
        sizes = np.array([1, len(data), 0, len(packed)], dtype="<u8").tobytes()
        text = b64encode(sizes).decode() + b64encode(packed).decode()
    else:
        text = b64encode(np.zeros(3, dtype="<u8").tobytes()).decode()
    if values.ndim > 1:
        width = values.shape[1]
    else:
        width = 1
    if values.ndim > 1:
        components = f' NumberOfComponents="{width}"'
    else:
        components = ""
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{components} format="binary">{text}</DataArray>'


def _parts(tree: xr.DataTree) -> dict[str, xr.Dataset]:
    """Groups to export by file name, substructures first, all at the same instants."""
    bodies = {
        f"substructure_{name}": dataset for name, dataset in _children(tree, "substructures") if "time" in dataset.dims
    }
    clouds = {f"interface_{name}": dataset for name, dataset in _children(tree, "interfaces")}
    if sensors := dict(_children(tree, "sensors")):
        placed = [dataset.reset_coords(["x", "y", "z"]) for dataset in sensors.values()]
        clouds["sensors"] = xr.concat(placed, "sensor", combine_attrs="drop").assign_coords(sensor=list(sensors))
    if bodies:
        stored = next(iter(bodies.values()))["time"]
        clouds = {name: dataset.sel(time=stored, method="nearest") for name, dataset in clouds.items()}
    return {**bodies, **clouds}


def _children(tree: xr.DataTree, group: str) -> Iterator[tuple[str, xr.Dataset]]:
    if group in tree.children:
        for name, node in tree[group].children.items():
            yield name, node.to_dataset()


def _substructure_piece(instant: xr.Dataset) -> _Piece:
    points = np.stack([instant[f"node_{axis}"].values for axis in "xyz"], axis=1)
    nodes = instant["cell_nodes"].values
    table = np.nan_to_num(nodes, nan=-1).astype(np.int64)  # cells with fewer nodes, as a file gives them
    cells = [(b.cell_type, b.cells) for b in cell_blocks(table)]
    point_data, by_cell = _fields(instant, "node"), _fields(instant, "cell")
    ends = np.cumsum([len(c) for _, c in cells])[:-1]
    cell_data = {name: np.split(values, ends) for name, values in by_cell.items()}
    return _Piece(points, cells, point_data, cell_data)


def _fields(instant: xr.Dataset, place: str) -> dict[str, NDArray[Any]]:
    """Fields at the nodes or cells; tensors in the order of VTK, stresses of cells with their von Mises value."""
    fields: dict[str, NDArray[Any]] = {}
    for name in (str(n) for n, variable in instant.data_vars.items() if variable.dims[:1] == (place,)):
        values = instant[name]
        for tensor in ("stress_component", "strain_component"):
            if tensor in values.dims:
                values = values.sel({tensor: _VTK_TENSOR})
        if name not in ("cell_nodes", "cell_shape"):
            fields[name] = _plain(values)
        if name == "stress":  # the file has that of the stress at the nodes
            fields["von_mises"] = von_mises(fields[name])
    return fields


def _interface_piece(instant: xr.Dataset) -> _Piece:
    points = np.stack([instant[axis].values for axis in "xyz"], axis=1)
    traction, normal = _plain(instant["traction"]), _plain(instant["normal"])
    velocity = _plain(instant["velocity"])
    point_data: dict[str, NDArray[Any]] = {
        "traction": traction,
        "pressure": -np.einsum("pc,pc->p", traction, normal),
        "normal": normal,
        "velocity_E": velocity[0],
        "velocity_Ep": velocity[1],
    }
    for name in ("gap", "contact_status", "slip", "accumulated_slip", "friction_energy"):
        if name in instant:
            point_data[name] = instant[name].values
    return _Piece(points, _interface_cells(instant), point_data, {})


def _interface_cells(instant: xr.Dataset) -> list[tuple[str, NDArray[np.int64]]]:
    """Triangles and quadrilaterals between the points, and the points that are in none of them."""
    n_point = instant.sizes["point"]
    if "cells" not in instant:
        return [("vertex", np.arange(n_point)[:, None])]
    table = np.nan_to_num(instant["cells"].values, nan=-1).astype(np.int64)
    triangles, quads = table[table[:, 3] < 0, :3], table[table[:, 3] >= 0]
    # ParaView shows no point that is in no cell
    alone = np.setdiff1d(np.arange(n_point), table)
    kinds = (("triangle", triangles), ("quad", quads), ("vertex", alone[:, None]))
    return [(kind, cells) for kind, cells in kinds if len(cells)]


def _sensor_piece(instant: xr.Dataset) -> _Piece:
    points = np.stack([instant[axis].values for axis in "xyz"], axis=1)
    point_data: dict[str, NDArray[Any]] = {name: _plain(instant[name]) for name in SENSOR if name in instant}
    return _Piece(points, [("vertex", np.arange(len(points))[:, None])], point_data, {})


def _plain(values: xr.DataArray) -> Array:
    return np.ascontiguousarray(values.values, dtype=float)
