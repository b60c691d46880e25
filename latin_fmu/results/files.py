"""Result files: netCDF-4, written whole or not at all, and checked when opened."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..errors import LatinError, Problem, ResultsError
from ..file_digest import add_digest, is_damaged
from .groups import READ_VERSIONS, SCENE_KEY, SCHEMA_VERSION, StoredGroup, StoredVariable, plain_name, with_labels
from .quantities import RECOVERED, SUBSTRUCTURE
from .writing import write_whole

if TYPE_CHECKING:
    import xarray as xr


Blocks = Callable[[], Iterable[Mapping[str, StoredGroup]]]
"""Gives groups by path, instants after instants; called once per attempt to write."""

_GROWING: Final = ("time", "window")
_CACHE: Final = 250_000  # bytes of chunks per variable that is written in blocks, in order
_CHUNK: Final = {"time": 50, "window": 4096, "point": 4096, "node": 4096, "cell": 4096}
_SINGLE_PRECISION: Final = frozenset({*SUBSTRUCTURE, *RECOVERED})


def write_netcdf(tree: xr.DataTree, path: str | Path) -> None:
    """Write a DataTree as ``write_groups`` does."""
    write_groups({node.path: StoredGroup.of_dataset(node.to_dataset(inherit=False)) for node in tree.subtree}, path)


def write_groups(groups: Mapping[str, StoredGroup], path: str | Path, blocks: Blocks | None = None) -> None:
    """Write ``groups`` (by path) to the file ``path``, atomically: an existing file is replaced only by a complete one.

    Interface fields keep double precision, substructure fields single precision; both are compressed, and
    ``time`` is unlimited.

    blocks : gives groups that take the place of those of the same path, the first instants first.

    Raises
    ------
    UnwrittenError : the file cannot be written (folder missing or read-only, disk full, ``path`` is a folder).
    """
    from netCDF4 import Dataset

    def write(draft: Path) -> None:
        try:
            # the bytes of the name as the system has them: the library would encode it for the locale, ASCII for C
            with Dataset(os.fsencode(draft).decode("latin-1"), "w", format="NETCDF4", encoding="latin-1") as file:
                parts: Iterator[Mapping[str, StoredGroup]] = iter(())
                if blocks is not None:
                    parts = iter(blocks())
                for where, group in with_labels({**groups, **next(parts, {})}):
                    place = file
                    if where != "/":
                        place = file.createGroup(where)
                    _write_group(place, where, group, blocks is not None)
                for part in parts:
                    for where, group in part.items():
                        _append(file[where], group)
        except RuntimeError as error:  # how the netCDF library reports a failed write to disk
            raise OSError(errno.EIO, f"the netCDF library failed: {error}") from error
        add_digest(draft)

    write_whole(path, write)


def _append(place: Any, group: StoredGroup) -> None:
    """Write the variables over instants or windows behind those that are there, and single numbers anew."""
    sizes = {dim: len(place.dimensions[dim]) for dim in _GROWING if dim in place.dimensions}
    for name, variable in group.variables.items():
        if not variable.dims:
            place.variables[name][...] = variable.values
            place.variables[name].setncatts(variable.attrs)
        elif variable.dims[0] in sizes:
            first = sizes[variable.dims[0]]
            place.variables[name][first : first + len(variable.values)] = variable.values


def _write_group(place: Any, where: str, group: StoredGroup, grows: bool) -> None:
    """Dimensions, attributes and variables of one group; ``grows``: more of them follow."""
    place.setncatts(group.attrs)
    for name, size in group.sizes().items():
        if name == "time" or (grows and name in _GROWING):
            place.createDimension(name, None)
        else:
            place.createDimension(name, size)
    for name, variable in group.variables.items():
        attrs = dict(variable.attrs)
        if name not in group.labels and (beside := _labels_of(group, variable)):
            attrs["coordinates"] = beside
        if variable.values.dtype.kind in "U":
            _write_text(place, name, variable, attrs)
        else:
            _write_array(place, where, name, variable, attrs, grows)


def _labels_of(group: StoredGroup, variable: StoredVariable) -> str:
    """CF's list of the coordinates of a variable that are no dimensions of their own."""
    return " ".join(
        name
        for name in sorted(group.labels)
        if group.variables[name].dims != (name,) and set(group.variables[name].dims) <= set(variable.dims)
    )


def _write_array(
    place: Any, where: str, name: str, variable: StoredVariable, attrs: Mapping[str, Any], grows: bool
) -> None:
    values = variable.values
    if values.dtype.kind == "O":
        kind: Any = str
    else:
        kind = values.dtype
    storage: dict[str, Any] = {}
    if values.dtype.kind in "fiu":
        if values.dtype == np.float64 and where.startswith("/substructures/") and name in _SINGLE_PRECISION:
            kind = np.dtype(np.float32)
        if values.dtype.kind == "f" and np.isnan(values).any():  # NaN: no value
            storage["fill_value"] = np.nan
        if values.size:
            storage |= _storage(variable)
            if grows:
                storage["chunk_cache"] = _CACHE
    stored = place.createVariable(name, kind, variable.dims, **storage)
    stored.setncatts(attrs)
    if values.size:
        stored[...] = values


def _write_text(place: Any, name: str, variable: StoredVariable, attrs: Mapping[str, Any]) -> None:
    """Text as bytes along a dimension of its own, which all netCDF readers support.

    Strings of netCDF-4 end the process where a file with compressed numbers is opened twice (netCDF4 1.7.5, netcdf-c
    4.10.1).
    """
    texts = np.char.encode(variable.values, "utf-8")
    width = max(1, texts.dtype.itemsize)
    length = f"string{width}"
    if length not in place.dimensions:
        place.createDimension(length, width)
    stored = place.createVariable(name, "S1", (*variable.dims, length))
    stored.setncatts(attrs)
    stored.setncattr("_Encoding", "utf-8")
    # else the library would join the bytes that it is given
    stored.set_auto_chartostring(False)
    if texts.size:
        stored[...] = texts.astype(f"S{width}").reshape(*texts.shape, 1).view("S1")


def _storage(variable: StoredVariable) -> dict[str, Any]:
    """Chunks, compression and checksums of an array, so that damage is an error when it is read; scalars have none."""
    shape = variable.values.shape
    if not shape:
        return {}
    if len(shape) == 1:
        chunks = (min(shape[0], 4096),)
    else:
        chunks = tuple(min(n, _CHUNK.get(dim, n)) for dim, n in zip(variable.dims, shape, strict=True))
    return {"zlib": True, "complevel": 1, "shuffle": True, "fletcher32": True, "chunksizes": chunks}


def open_results(path: str | Path) -> xr.DataTree:
    """Open a results file as a DataTree, read lazily; close it with ``tree.close()``.

    Times stay numbers in seconds.

    Raises
    ------
    ResultsError : no such file, not a netCDF-4 file, not written by this package, or written by a version
        whose layout this one does not know.

    Examples
    --------
    >>> solution = latin_fmu.solve(latin_fmu.load_scene("models/impact_bar/scene.toml"))
    >>> solution.save(folder / "bar.nc")
    >>> with latin_fmu.open_results(folder / "bar.nc") as tree:
    ...     float(tree["interfaces/wall/force"][-1, 2])
    0.0
    """

    source = Path(path)
    if not source.is_file():
        if source.is_dir():
            what = "this is a folder"
        else:
            what = "no such file"
        raise _unreadable(source, what, remedy="give the .nc file written by a run")
    damaged = "the file is damaged: its digest does not match"
    try:
        if is_damaged(source):
            raise _unreadable(source, damaged, remedy="take an intact copy, or run the scene again")
        tree = _opened(source)
    except ResultsError:
        raise
    except UnicodeEncodeError as error:
        what = (
            f"the netCDF library cannot write this name in the encoding of the locale ({sys.getfilesystemencoding()})"
        )
        raise _unreadable(source, what, remedy="set LC_ALL=C.UTF-8, or rename file and folders") from error
    except Exception as error:  # the library of a damaged file raises many kinds
        remedy = "give the .nc file written by a run"
        raise _unreadable(source, f"this is not a readable netCDF-4 file: {error}", remedy=remedy) from error
    version = tree.attrs.get("schema_version")
    if "scene_name" not in tree.attrs or not isinstance(version, str):
        tree.close()
        raise _unreadable(
            source, "this netCDF file was not written by latin_fmu", remedy="give the .nc file written by a run"
        )
    if version.split(".")[0] not in READ_VERSIONS:
        tree.close()
        raise _unreadable(
            source,
            "the layout of this file is of another version",
            version,
            " or ".join(f"{number}.x" for number in READ_VERSIONS),
            "open it with the version of latin_fmu that wrote it",
        )
    return _with_strings(_renamed(tree) if version.split(".")[0] != SCHEMA_VERSION.split(".")[0] else tree)


def _renamed(tree: xr.DataTree) -> xr.DataTree:
    """A file of a layout of version 1 with the names of today: parameters of studies had dotted names there, and the
    dimension ``component`` of their histories was ``axis``. Values of other units (``force_norm``) keep their names."""
    content = tree.to_dataset(inherit=False)
    names = {str(name): plain_name(str(name)) for name in content.variables if "." in str(name)}
    for name in names:
        content[name].attrs[SCENE_KEY] = name
    if "kind" in tree.attrs and "axis" in content.dims:
        names["axis"] = "component"
    if names:
        tree.dataset = content.rename(names)
    return tree


def _with_strings(tree: xr.DataTree) -> xr.DataTree:
    """The tree with its texts as strings of any length, for which zarr has a type; the file holds bytes."""
    import xarray as xr

    for node in tree.subtree:
        content = node.to_dataset(inherit=False)
        texts = {name: v for name, v in content.variables.items() if v.dtype.kind in "OSU"}
        strings = {name: xr.Variable(v.dims, v.values.astype(object), v.attrs) for name, v in texts.items()}
        if strings:
            labels = {name: v for name, v in strings.items() if name in content.coords}
            data = {name: v for name, v in strings.items() if name not in labels}
            node.dataset = content.assign_coords(labels).assign(data)
    return tree


def _opened(source: Path) -> xr.DataTree:
    """A file of a run, with groups, or of a compiled FMU: netCDF-3 has none, and ``interfaces.crush.traction`` is the
    variable ``traction`` of the group ``interfaces/crush``."""
    import xarray as xr

    with source.open("rb") as file:
        # netCDF-3 by its magic; netCDF-4 is HDF5
        flat = file.read(3) == b"CDF"
    if not flat:
        return xr.open_datatree(source, engine="netcdf4", decode_times=False, decode_timedelta=False)
    content = xr.open_dataset(source, engine="netcdf4", decode_times=False, decode_timedelta=False)
    groups: dict[str, xr.Dataset] = {
        "/": xr.Dataset(attrs={k: v for k, v in content.attrs.items() if "." not in k and k != "coordinates"})
    }
    for full, variable in content.variables.items():
        path, _, name = str(full).rpartition(".")
        labels = content.attrs.get(f"{path}.coordinates".lstrip("."), "").split()
        group = groups.setdefault("/" + path.replace(".", "/"), xr.Dataset())
        dims = [str(dim).rpartition(".")[2] for dim in variable.dims]
        # _data: ``data`` would read the values
        lazy = xr.Variable(dims, variable._data, variable.attrs, variable.encoding)
        if name in labels:
            group.coords[name] = lazy
        else:
            group[name] = lazy
    for full, value in content.attrs.items():
        path, _, name = str(full).rpartition(".")
        if path and name != "coordinates":
            groups["/" + path.replace(".", "/")].attrs[name] = value
    time = groups["/"].coords["time"]
    # a label of the root would be handed down to groups without instants
    groups["/"] = groups["/"].drop_vars("time")
    for group in groups.values():
        if "time" in group.dims:
            group.coords["time"] = time
    tree = xr.DataTree.from_dict(groups)
    # the tree alone closes the file, not its groups
    tree.set_close(content.close)
    return tree


@contextmanager
def readable(path: str | Path) -> Iterator[None]:
    """Context in which values of an open results file are read: those that cannot be had are a ResultsError.

    A file whose head is whole may be damaged behind it: values are read when they are needed, and the libraries then
    raise errors of many kinds.

    Raises
    ------
    ResultsError : the file is damaged, or lacks a part.
    """
    try:
        yield
    except LatinError:
        raise
    except (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError) as error:
        what = f"the file is damaged or incomplete: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise _unreadable(Path(path), what, remedy="take an intact copy, or run the scene again") from error


def _unreadable(
    path: Path, what: str, value: str | None = None, allowed: str | None = None, remedy: str | None = None
) -> ResultsError:
    return ResultsError([Problem(str(path), what, value, allowed, remedy)], "cannot read the results")
