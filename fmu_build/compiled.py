"""FMUs that need no Python: the functions of the FMI in C, in the library of the kernels, on the image of a run.

The C files of ``latin_fmu/cosim/runtime`` are linked into the library of the kernels (``latin_fmu.aot``). An FMU
carries that library, the image of the run (``latin_fmu.cosim.communication``), the table of its variables
(``latin_fmu.cosim.table_file``), and a results file without records, written here.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import netCDF4
import numpy as np

import latin_fmu
from latin_fmu.aot import linking
from latin_fmu.compiled import library
from latin_fmu.cosim import c_runtime
from latin_fmu.cosim.communication import CommunicationRun, write
from latin_fmu.cosim.table_file import Identity, RecordPart, checksum, output_places, table_file
from latin_fmu.cosim.variable import Variable
from latin_fmu.cosim.variables import table_of
from latin_fmu.errors import InputError, NeedsPythonError, Problem
from latin_fmu.latin.interface_rows import InterfaceRows
from latin_fmu.results.dataset import interface_group
from latin_fmu.results.groups import SCHEMA_VERSION, StoredGroup, StoredVariable, in_units
from latin_fmu.results.quantities import AXES, BOLT, ENERGY, LABELS, SENSOR, named
from latin_fmu.scene.schema import Scene

CONSTANTS: Final = ("timeStep", "tolerance", "maxIterations")
"""Parameters that an image is made for."""


@dataclass(frozen=True)
class CompiledRun:
    """What the FMU of a scene carries: its variables, the files of its resources, its token."""

    table: tuple[Variable, ...]
    image: bytes
    variables: bytes
    results: bytes
    token: str


def compiled_run(scene: Scene, fmi: str) -> CompiledRun:
    """The compiled FMU of a scene with names for its interfaces.

    Raises
    ------
    NeedsPythonError : the kernels do not hold something of this scene; SceneError : it cannot be built.
    """
    if scene.fmu.parameters:
        names = ", ".join(scene.fmu.parameters)
        what, remedy = "an image is made for the numbers of the scene", "omit it, or export an FMU with Python"
        raise NeedsPythonError(
            [Problem("fmu.parameters", what, names, None, remedy)], "the scene needs Python at run time"
        )
    run = CommunicationRun(scene)
    image, table = write(run), _table_of(run, fmi, constant=True)
    text = hashlib.sha256(image + repr((fmi, table)).encode()).hexdigest()[:32]
    token = f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:]}}}"
    results, record = results_file(run, table, output_places(table, run))
    identity = Identity(token, checksum(image), checksum(results), record)
    return CompiledRun(table, image, table_file(table, scene, run, identity), results, token)


def hosted_run(scene: Scene, fmi: str) -> CompiledRun:
    """What the FMU with Python of a scene carries of a run, which is made when a simulation begins: no image, no token.

    Raises
    ------
    SceneError : the scene cannot be built.
    """
    run = CommunicationRun(scene, python=True)
    table = _table_of(run, fmi, constant=False)
    results, record = results_file(run, table, output_places(table, run))
    identity = Identity("", 0, checksum(results), record)
    return CompiledRun(table, b"", table_file(table, scene, run, identity), results, "")


def _table_of(run: CommunicationRun, fmi: str, constant: bool) -> tuple[Variable, ...]:
    n_point = {unit.name: unit.geometry.n_point for unit in run.run.assembly.interfaces}
    return tuple(_variables(table_of(run.scene, n_point if fmi == "3" else None), constant))


def libraries(portable: bool = False) -> dict[str, bytes]:
    """Libraries of the kernels with the functions of the FMI, by platform; ``portable`` : those that need no AVX2.

    Raises
    ------
    InputError : there is none that was made from these sources.
    """
    digest, end = c_runtime.digest().encode(), library.PORTABLE if portable else ""
    shipped = library.shipped()
    wanted = {name.removesuffix(end): shipped[name] for name in shipped if name.endswith(library.PORTABLE) == portable}
    fit = {name: content for name, path in wanted.items() if digest in (content := path.read_bytes())}
    if not fit:
        targets = " ".join(f"{name}{end}" for name in ("linux-x86_64", "windows-x86_64"))
        known_targets = ", ".join(name for name in linking.TARGETS if name.endswith(library.PORTABLE) == portable)
        remedy = (
            f"in a source tree run: python -m latin_fmu.aot {targets} (of {known_targets} those on which it is to run)"
        )
        if not portable:
            remedy = f"install a wheel, or, {remedy}"
        problem = Problem("compiled FMU", "the library of compiled kernels is missing here", None, None, remedy)
        raise InputError([problem], "the FMU cannot be compiled")
    return fit


# -- variables ----------------------------------------------------------------------------------------------------
def _variables(table: Sequence[Variable], constant: bool) -> Iterator[Variable]:
    """The variables of an FMU; ``constant`` : whether its image is made beforehand."""
    for variable in table:
        if constant and variable.name in CONSTANTS:
            about = f"{variable.description.partition(',')[0].partition(';')[0]}; fixed when the FMU is made"
            yield replace(variable, causality="local", variability="constant", description=about)
        elif variable.name == "historyFile":
            yield replace(variable, description=variable.description.replace("CSV or netCDF file", "CSV file"))
        else:
            yield variable


# -- the results file ---------------------------------------------------------------------------------------------
# netCDF-3 has no groups: ``interfaces.crush.traction`` stands for the variable ``traction`` of the group
# ``interfaces/crush``; its dimensions and the attributes of groups are named in the same way. An instant is a record:
# the time, scalar outputs, and fields at the points (``cosim.communication``, action FIELDS).
_POINTS: Final = {"traction": "traction", "velocity": "velocity", "gap": "gap", "contact_status": "status"}
"""Names in the results of what ``interface.NAME.points`` has."""
_COMPONENT: Final = re.compile(r"(.*)\[([123])\]")
_FAMILIES: Final = {"sensor": ("sensors", SENSOR), "bolt": ("bolts", BOLT), "energy": ("energy", ENERGY)}
"""Groups of the results by the first part of the name of an output, and what their variables mean."""


def results_file(
    run: CommunicationRun, table: Sequence[Variable], places: Mapping[str, int]
) -> tuple[bytes, list[RecordPart]]:
    """The file without records, and the parts of a record in the order of the file.

    Parameters
    ----------
    table : variables of the FMU. places : of scalar outputs in a row, of arrays at points among the fields, by name.
    """
    root = {
        "source": f"latin_fmu {latin_fmu.__version__}: LATIN method, compiled FMU",
        "scene_name": run.scene.name,
        "schema_version": SCHEMA_VERSION,
        "unit_system": run.scene.unit_system.name,
    }
    time = StoredGroup.of((), named(LABELS, {"time": np.zeros(1)}), root)
    groups = in_units({"/": time, **dict(_interfaces(run)), **dict(_outputs(table))}, run.scene.unit_system)
    parts: dict[str, RecordPart] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "results.nc"
        with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as file:
            file.createDimension("time", None)
            for of_group, group in groups.items():
                parts |= _add_group(file, of_group, group, places)
        whole = path.read_bytes()
    record = sum(part.count * (4 if part.whole else 8) for part in parts.values())
    # the file has one record, which is cut off; the number of records stands behind the magic number
    return whole[:4] + bytes(4) + whole[8:-record], list(parts.values())


def _add_group(
    file: netCDF4.Dataset, path: str, group: StoredGroup, places: Mapping[str, int]
) -> dict[str, RecordPart]:
    """Write a group; its variables over time in their order."""
    parts: dict[str, RecordPart] = {}
    attributes = {**group.attrs, "coordinates": " ".join(sorted(group.labels))}
    for name, value in attributes.items():
        file.setncattr(_flat(path, name), value)
    for name, variable in group.variables.items():
        # one coordinate for all groups
        if name == "time" and path != "/":
            continue
        if "time" in variable.dims:
            source = ("time", 0) if name == "time" else _source(path, name, places)
            if source is None:
                continue
            whole, count = variable.values.dtype.kind in "iu", variable.values[0].size
            parts[_flat(path, name)] = RecordPart(*source, count, whole)
        _add_variable(file, path, name, variable)
    return parts


def _flat(path: str, name: str) -> str:
    """Name in the file of what a group has."""
    return ".".join([*(part for part in path.split("/") if part), name])


def _add_variable(file: netCDF4.Dataset, path: str, name: str, variable: StoredVariable) -> None:
    """Write a variable with its dimensions; texts as characters along a dimension of their own."""
    values = np.asarray(variable.values)
    dims = ["time" if dim == "time" else _flat(path, dim) for dim in variable.dims]
    if values.dtype.kind in "OUS":
        values = np.char.encode(values.astype(str), "utf-8")
        dims.append(f"text{values.dtype.itemsize}")  # characters are a dimension in netCDF-3
        values = values.view("S1").reshape(*values.shape, -1)
    elif values.dtype.kind in "iub":
        values = values.astype("i4")  # netCDF-3 has no integers of 8 bytes
    for dim, size in zip(dims, values.shape, strict=True):
        if dim not in file.dimensions:
            file.createDimension(dim, size)
    target = file.createVariable(_flat(path, name), values.dtype, dims)
    if values.dtype.kind == "S":
        target.setncattr("_Encoding", "utf-8")
        target.set_auto_chartostring(False)
    target[...] = values
    for key, value in variable.attrs.items():
        target.setncattr(
            key, value.astype("i4") if isinstance(value, np.ndarray) and value.dtype.kind == "i" else value
        )


def _interfaces(run: CommunicationRun) -> Iterator[tuple[str, StoredGroup]]:
    """Groups of the interfaces in the present state, one instant."""
    assembly, image = run.run.assembly, run.image
    rows = InterfaceRows(assembly, np.zeros((1, InterfaceRows.width_of(assembly))))
    rows.keep(image, None, 0, 1, 0)
    for name, history in rows.histories(1, None).items():
        group = interface_group(history, np.zeros(1))
        for of_the_whole in ("peak_force", "peak_force_raw"):
            del group.variables[of_the_whole]
        yield f"/interfaces/{name}", group


def _outputs(table: Sequence[Variable]) -> Iterator[tuple[str, StoredGroup]]:
    """Groups of sensors, bolts and energies from the scalar outputs, one instant."""
    names = {
        _COMPONENT.sub(r"\1", v.name): 3 if _COMPONENT.fullmatch(v.name) else 1
        for v in table
        if v.causality == "output" and not v.is_array
    }
    arrays_by_path: dict[str, dict[str, np.ndarray]] = {}
    for name, n in names.items():
        family, *owner, what = name.split(".") if "." in name else ("", name)
        if family in _FAMILIES and what in _FAMILIES[family][1]:
            path = "/".join(["", _FAMILIES[family][0], *owner])
            arrays_by_path.setdefault(path, {})[what] = np.zeros((1, 3) if n == 3 else 1)
    meanings = dict(_FAMILIES.values())
    for path, arrays in arrays_by_path.items():
        labels = {"component": AXES} if any(values.ndim > 1 for values in arrays.values()) else {}
        yield path, StoredGroup.of(named(meanings[path.split("/")[1]], arrays), named(LABELS, labels))


def _source(path: str, name: str, places: Mapping[str, int]) -> tuple[str, int] | None:
    """Where a variable of a record comes from; None where C has no such numbers."""
    family, _, owner = path.removeprefix("/").partition("/")
    prefix = {variable: key for key, (variable, _) in _FAMILIES.items()} | {"interfaces": "interface"}
    stem = ".".join(part for part in (prefix[family], owner) if part)
    if family == "interfaces" and name in _POINTS:
        return "field", places[f"{stem}.points.{_POINTS[name]}"]
    for variable in (f"{stem}.{name}", f"{stem}.{name}[1]"):
        if variable in places:
            return "output", places[variable]
    return None
