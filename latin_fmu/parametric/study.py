"""A parametric study: the full factorial of some keys of a scene over processes, resumable, as one dataset.

The parameters are the dimensions of the dataset:

================  ==============================  ===========================================================
variable          dimensions                      content
================  ==============================  ===========================================================
``state``         parameters                      0 converged, 1 not converged, 2 failed
``converged``     parameters                      1 where the point converged, else 0
``message``       parameters                      how the run ended, or why there is none
quantities        parameters (, part)             ``point.QUANTITIES``; NaN where a point has none
``force`` ...     parameters, part, time (, axis)  resultants of the interfaces, where histories are kept
================  ==============================  ===========================================================

``part`` is ``interface``, ``sensor``, ``boundary`` or ``energy_term``. The scene is in the attributes.
"""

from __future__ import annotations

import shutil
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ..assembly.build import discretise
from ..effects.cost import Prediction
from ..effects.memory import amount, memory_need
from ..errors import InputError, LatinError, SceneError, SolverError
from ..latin.state_serialization import decode, encode, opened, sealed
from ..machine import memory_room, provenance
from ..reader import read_tables
from ..results.checkpoint import scene_digest
from ..results.dataset import AXES
from ..results.files import write_netcdf
from ..results.groups import CONVENTIONS, SCHEMA_VERSION, UNITS
from ..results.writing import check_target, unwritable, write_bytes
from ..scene.overrides import apply_overrides
from ..scene.schema import Scene
from .grid import Grid, Index, Parameter, parameters_of, value_text
from .point import CONVERGED, FAILED, QUANTITIES, STATES, Plan, Quantity, Record
from .workers import solve_points

Log = Callable[[str], None]

_KIND: Final = "points of a study"
_HEAD: Final = "study"  # name of the file that identifies the study of the points in a folder
_HEADING: Final = "the study cannot be made"
_MOST_JOBS: Final = 1024
KIND: Final = "parametric study"
"""Attribute ``kind`` of the file of a study."""
_HISTORIES: Final = {
    "force": ("N", "force on side E of an interface"),
    "normal_force": ("N", "normal force of an interface, positive in compression"),
}


class Store:
    """Records of the points of a study in a folder beside its file: each is written whole, as soon as it is known.

    Parameters
    ----------
    output : file of the study. digest : of the scene and of what is kept of each point.
    """

    def __init__(self, output: Path, grid: Grid, digest: str) -> None:
        self.folder, self._grid, self._digest = Path(f"{output}.points"), grid, digest

    def begin(self) -> dict[Index, Record]:
        """Make the folder, or read the records of the points in it.

        Raises
        ------
        InputError : the points are of another scene or version. ResultsError : the folder cannot be written to.
        """
        head = self.folder / _HEAD
        if not head.exists():
            try:
                self.folder.mkdir(exist_ok=True)
            except OSError as error:
                raise unwritable(
                    self.folder, f"cannot be made: {error.strerror or error}", "choose another place"
                ) from error
            write_bytes(head, sealed(b"", _KIND, self._digest), rescue=False)
            return {}
        try:
            opened(head.read_bytes(), _KIND, self._digest)
        except SolverError as error:
            what = "the points here are of another scene, of other parameters, or of another version"
            remedy = "name another output, or remove this folder"
            raise InputError.of("the study cannot be continued", str(self.folder), what, remedy=remedy) from error
        return {point: record for point in self._grid.order if (record := self._read(point)) is not None}

    def _read(self, point: Index) -> Record | None:
        """The record of a point; None where it is not there, or damaged."""
        with suppress(OSError, LatinError):
            content = (self.folder / self._grid.file_name(point)).read_bytes()
            record: Record = decode(opened(content, _KIND, self._digest), _KIND)
            return record
        return None

    def keep(self, point: Index, record: Record) -> None:
        """Write the record of a point."""
        content = sealed(encode(record, _KIND), _KIND, self._digest)
        write_bytes(self.folder / self._grid.file_name(point), content, rescue=False)

    def remove(self) -> None:
        """Remove the folder: the study has been written."""
        shutil.rmtree(self.folder, ignore_errors=True)


@dataclass
class _Progress:
    """Tells the points as they come, with the time left."""

    total: int
    log: Log | None
    done: int
    came: int = 0
    failed: int = 0

    def __post_init__(self) -> None:
        self._begun = clock.monotonic()

    def update(self, point: str, record: Record) -> None:
        """One more point."""
        self.done, self.came = self.done + 1, self.came + 1
        self.failed += record["state"] == FAILED
        if self.log is None:
            return
        left = (clock.monotonic() - self._begun) / self.came * (self.total - self.done)
        more = f"; about {left:.0f} s left" if left < 90.0 else f"; about {left / 60.0:.0f} min left"
        state = STATES[int(record["state"])].replace("_", " ")
        why = f": {record['message']}" if record["state"] == FAILED else ""
        end = more if self.done < self.total else ""
        self.log(f"{self.done} of {self.total}: {point}: {state}{why}{end}")


def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, Sequence[Any]] | Sequence[str],
    output: str | Path | None = None,
    *,
    settings: Sequence[str] = (),
    jobs: int = 1,
    scheduler: str | None = None,
    histories: bool = False,
    guesses: bool = True,
    log: Log | None = None,
    max_cpu: float | None = None,
) -> xr.Dataset:
    """Solve a scene for all combinations of the values of some of its keys.

    Points that fail are marked in the result, with their message. With windows of several instants, a point begins with
    the fields of its neighbours, which saves iterations and moves results within the tolerance of the iteration.

    Parameters
    ----------
    scene : file, or a scene. vary : values by key, ``{"load.press.pressure": [1e8, 2e8]}``, or texts as for the option
        ``--vary`` of the command line.
    output : netCDF file of the study. Points that are done are kept beside it (``OUTPUT.points``) until it is written,
        so that the same call continues after an interruption.
    settings : changes of the scene that hold at all points, as for ``--set``.
    jobs : processes on this machine, one thread each; with more than one a script needs ``if __name__ == "__main__":``.
    scheduler : address of a dask scheduler whose workers solve the points instead (files of meshes and laws must be
        found at the same place there).
    histories : keep the resultants of the interfaces over time. guesses : whether neighbours give first guesses.
    log : takes a line of text after each point. max_cpu : CPU seconds that a point may take.

    Returns
    -------
    Dataset with the parameters as dimensions; see ``parametric.study``.

    Raises
    ------
    InputError : no such key, absurd sizes, a folder with the points of another study, dask.distributed missing.
    ResultsError : the output cannot be written.
    """
    if isinstance(scene, Scene):
        tables, base_dir = apply_overrides(scene.tables(), settings), scene.base_dir
    else:
        tables, base_dir = read_tables(scene, settings), Path(scene).parent
    grid = Grid(tables, str(base_dir.resolve()), parameters_of(vary))
    checked = grid.check()
    _check_options(grid, jobs, scheduler, histories)
    _check_memory(checked, min(jobs, len(grid.order)))
    digest = scene_digest(checked, [*(p.key for p in grid.parameters), f"histories {histories}"])
    target = None if output is None else check_target(output)
    store = None if target is None else Store(target, grid, digest)
    records = {} if store is None else store.begin()
    if log is not None and records:
        log(f"{len(records)} of {len(grid.order)} points were done before")
    progress = _Progress(len(grid.order), log, len(records))
    again = False

    def keep(point: Index, record: Record, lost: bool) -> None:
        nonlocal again
        records[point] = record
        again |= lost  # worth another try: its process is to blame, not the point
        if store is not None and not lost:
            store.keep(point, record)
        progress.update(grid.words(point), record)

    waiting = [point for point in grid.order if point not in records]
    solve_points(waiting, Plan(grid, histories, guesses, max_cpu).text(), jobs, scheduler, keep)
    study = dataset_of(grid, checked, records, histories)
    if store is not None and output is not None:
        _write(study, output)
        if not again:
            store.remove()
    return study


def _write(study: xr.Dataset, output: str | Path) -> None:
    import xarray as xr

    write_netcdf(xr.DataTree(study), output)


def _check_options(grid: Grid, jobs: int, scheduler: str | None, histories: bool) -> None:
    if not 1 <= jobs <= _MOST_JOBS:
        raise InputError.of(_HEADING, "--jobs", "number of processes", str(jobs), f"1 to {_MOST_JOBS}")
    if scheduler is not None and jobs > 1:
        what, remedy = "the workers of the scheduler solve the points", "leave --jobs or --scheduler out"
        raise InputError.of(_HEADING, "--jobs", what, str(jobs), remedy=remedy)
    for p in grid.parameters if histories else ():
        if p.key.startswith("time.") or p.key == "output.interfaces_every":
            what, remedy = "histories need the same instants at all points", "leave --histories out"
            raise InputError.of(_HEADING, f"--vary {p.key}", what, remedy=remedy)


def _check_memory(scene: Scene, jobs: int) -> None:
    """Make sure that so many runs fit in the memory that this process may take."""
    if jobs == 1:
        return
    try:
        need = memory_need(Prediction(discretise(scene))).total
    except SceneError:  # some of the points may be better
        return
    room, limit = memory_room()
    if limit and jobs * need > room:
        what = f"{jobs} processes of about {amount(need)} each"
        fitting = f"at most {max(1, int(room / need))} processes in {amount(max(room, 0.0))} ({limit})"
        raise InputError.of(_HEADING, "--jobs", "the runs need more memory than there is", what, fitting)


def dataset_of(grid: Grid, scene: Scene, records: Mapping[Index, Record], histories: bool) -> xr.Dataset:
    """Dataset of a study (module docstring): ``records`` of all points of the ``grid``, ``scene`` as written."""
    dims = tuple(p.key for p in grid.parameters)
    coordinates: dict[str, Any] = {p.key: _coordinate(p) for p in grid.parameters}
    states = np.full(grid.shape, 0, dtype=np.int8)
    messages = np.full(grid.shape, "", dtype=object)
    for point, record in records.items():
        states[point], messages[point] = record["state"], record["message"]
    meanings = {"flag_values": np.arange(len(STATES), dtype=np.int8), "flag_meanings": " ".join(STATES)}
    flags = {"flag_values": np.array([0, 1], dtype=np.int8), "flag_meanings": "no yes"}
    variables: dict[str, Any] = {
        "state": (dims, states, {"long_name": "state of the point", **meanings}),
        "converged": (dims, (states == CONVERGED).astype(np.int8), {"long_name": "whether it converged", **flags}),
        "message": (dims, messages.astype(np.str_), {"long_name": "how the run ended, or why there is none"}),
    }
    for quantity in QUANTITIES:
        _add_quantity(variables, coordinates, grid, records, quantity)
    if histories:
        _add_histories(variables, coordinates, grid, records)
    study = xr.Dataset(variables, coordinates, _attributes(scene))
    for variable in study.variables.values():
        if "units" in variable.attrs:
            variable.attrs["units"] = scene.unit_system.label(variable.attrs["units"])
    return study


def _coordinate(parameter: Parameter) -> Any:
    values = parameter.values
    written = (
        np.array(values, dtype=float) if parameter.numeric else np.array([value_text(v) for v in values], dtype=np.str_)
    )
    attributes = {"long_name": f"scene key {parameter.key}"}
    if parameter.numeric and (unit := parameter.unit):
        attributes["units"] = unit
    return parameter.key, written, attributes


def _attributes(scene: Scene) -> dict[str, Any]:
    return {
        **provenance(),
        "Conventions": CONVENTIONS,
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "title": f"{scene.name}: parametric study",
        "scene_name": scene.name,
        "scene": scene.text(),
        UNITS: scene.units,
    }


def _parts(records: Mapping[Index, Record], name: str) -> list[str]:
    """Names of the parts that have a quantity at some point, in the order of the first that names them."""
    return list(dict.fromkeys(part for record in records.values() for part in record.get(name, ())))


def _add_quantity(
    variables: dict[str, Any],
    coordinates: dict[str, Any],
    grid: Grid,
    records: Mapping[Index, Record],
    quantity: Quantity,
) -> None:
    """Add one quantity, where some point has it; parts are a coordinate that all quantities of their kind share."""
    given = {point: record[quantity.name] for point, record in records.items() if quantity.name in record}
    if not given:
        return
    dims, shape = tuple(p.key for p in grid.parameters), grid.shape
    if not quantity.of:
        values = np.full(shape, np.nan)
        for point, value in given.items():
            values[point] = value
    else:
        parts = _all_parts(coordinates, records, quantity.of)
        dims, values = (*dims, quantity.of), np.full((*shape, len(parts)), np.nan)
        for point, by_part in given.items():
            for part, value in by_part.items():
                values[(*point, parts.index(part))] = value
    variables[quantity.name] = (dims, values, {"units": quantity.unit, "long_name": quantity.long_name})


def _all_parts(coordinates: dict[str, Any], records: Mapping[Index, Record], kind: str) -> list[str]:
    """Names of the parts of one kind, as a coordinate."""
    if kind not in coordinates:
        names = [q.name for q in QUANTITIES if q.of == kind]
        parts = list(dict.fromkeys(part for name in names for part in _parts(records, name)))
        coordinates[kind] = (kind, np.array(parts, dtype=np.str_), {"long_name": kind.replace("_", " ")})
    return [str(part) for part in coordinates[kind][1]]


def _add_histories(
    variables: dict[str, Any], coordinates: dict[str, Any], grid: Grid, records: Mapping[Index, Record]
) -> None:
    """Add the resultants of the interfaces over time; points cut short have no values at the instants they lack."""
    given = {point: record for point, record in records.items() if "histories" in record}
    if not given:
        return
    time = max((np.asarray(record["time"]) for record in given.values()), key=len)
    coordinates["time"] = ("time", time, {"units": "s", "long_name": "time since the start"})
    coordinates["axis"] = ("axis", np.array(AXES, dtype=np.str_))
    parts = _all_parts(coordinates, records, "interface")
    for name, (unit, long_name) in _HISTORIES.items():
        more, more_dims = ((len(AXES),), ("axis",)) if name == "force" else ((), ())
        values = np.full((*grid.shape, len(parts), len(time), *more), np.nan)
        for point, record in given.items():
            for part, history in record["histories"][name].items():
                values[point][parts.index(part), : len(history)] = history
        dims = (*(p.key for p in grid.parameters), "interface", "time", *more_dims)
        variables[name] = (dims, values, {"units": unit, "long_name": long_name})
