"""Results as netCDF-4: written whole or not at all, opened with a check of what they are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ..errors import Problem, ResultsError
from .attributes import SCHEMA_VERSION
from .files import unwritable, written_whole

_CHUNK: Final = {"time": 50, "point": 4096, "node": 4096, "cell": 4096}
_SINGLE_PRECISION = (
    "displacement", "velocity", "stress", "strain", "nodal_stress", "principal_stress", "nodal_principal_stress",
)  # fmt: skip


def write_netcdf(tree: xr.DataTree, path: str | Path) -> None:
    """Write ``tree`` to ``path``, atomically: an existing file is replaced only by a complete one.

    Interface fields keep double precision, substructure fields single precision; both are compressed, and
    ``time`` is unlimited.

    Raises
    ------
    ResultsError : the file cannot be written (folder missing or read-only, disk full, ``path`` is a folder).
    """
    target = Path(path)
    nodes = {node.path: node.to_dataset(inherit=False) for node in tree.subtree}
    encoding = {where: _encoding(where, dataset) for where, dataset in nodes.items()}
    unlimited = {where: ["time"] for where, dataset in nodes.items() if "time" in dataset.dims}
    with written_whole(target) as draft:
        try:
            tree.to_netcdf(
                draft,
                engine="netcdf4",
                encoding={where: settings for where, settings in encoding.items() if settings},
                unlimited_dims=unlimited,
                write_inherited_coords=True,
            )
        except RuntimeError as error:  # how the netCDF library reports a failed write to disk
            raise unwritable(target, f"the netCDF library failed: {error}", "check free space") from error


def _encoding(where: str, dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    settings: dict[str, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        values = variable.dtype.kind
        if values in "U":
            settings[str(name)] = {"dtype": "S1"}
        if values not in "fiu":
            continue
        choice: dict[str, Any] = {}
        if values == "f" and not _padded(variable):
            choice["_FillValue"] = None
        if name == "cell_nodes" and (variable.values < 0).any():
            choice["_FillValue"] = -1
        if variable.dtype == np.float64 and where.startswith("/substructures/") and name in _SINGLE_PRECISION:
            choice["dtype"] = "float32"
        if variable.size:
            choice.update(_storage(dict(variable.sizes)))
        settings[str(name)] = choice
    return settings


def _storage(sizes: Mapping[Any, int]) -> dict[str, Any]:
    """Chunks and compression of an array; scalars have none."""
    if not sizes:
        return {}
    if len(sizes) == 1:
        chunks = tuple(min(size, 4096) for size in sizes.values())
    else:
        chunks = tuple(min(size, _CHUNK.get(str(dim), size)) for dim, size in sizes.items())
    return {"zlib": True, "complevel": 1, "shuffle": True, "chunksizes": chunks}


def _padded(variable: xr.Variable) -> bool:
    """Whether NaN stands for "nothing here": only then is a fill value declared."""
    return bool(np.isnan(variable.values).any())


def open_results(path: str | Path) -> xr.DataTree:
    """Open a results file as a DataTree, read lazily; close it with ``tree.close()``.

    Times stay numbers in seconds.

    Raises
    ------
    ResultsError : no such file, not a netCDF-4 file, not written by this package, or written by a version
        whose layout this one does not know.
    """
    source = Path(path)
    if not source.is_file():
        what = "this is a folder" if source.is_dir() else "no such file"
        raise _unreadable(source, what, remedy="give the .nc file written by a run")
    try:
        tree = xr.open_datatree(source, engine="netcdf4", decode_times=False, decode_timedelta=False)
    except (OSError, ValueError, RuntimeError) as error:
        remedy = "give the .nc file written by a run"
        raise _unreadable(source, f"this is not a readable netCDF-4 file: {error}", remedy=remedy) from error
    version = tree.attrs.get("schema_version")
    if "scene_name" not in tree.attrs or not isinstance(version, str):
        tree.close()
        raise _unreadable(
            source,
            "this netCDF file was not written by latin_fmu",
            remedy="give the .nc file written by a run",
        )
    if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
        tree.close()
        raise _unreadable(
            source,
            "the layout of this file is of another version",
            version,
            f"{SCHEMA_VERSION.split('.')[0]}.x",
            "open it with the version of latin_fmu that wrote it",
        )
    return tree


def _unreadable(
    path: Path, what: str, value: str | None = None, allowed: str | None = None, remedy: str | None = None
) -> ResultsError:
    return ResultsError([Problem(str(path), what, value, allowed, remedy)], "cannot read the results")
