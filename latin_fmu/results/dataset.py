"""An ``Outcome`` as groups of arrays with stable names, for netCDF and xarray.

::

    /                      provenance and status, as attributes
    /interfaces/<name>     INTERFACE, INTERFACE_MADE, at POINTS; where they carry cells SURFACE in its mean PLANE
    /substructures/<name>  SUBSTRUCTURE and RECOVERED as far as the scene requests them, and with any of them the MESH
                           with its NODES and their MARKS
    /substructures/<name>/energy   ENERGY of the substructure, where requested
    /sensors/<name>        SENSOR at SENSOR_PLACE, FILTERED where requested
    /sensors/<name>/spectrum       SPECTRUM where requested, its relative error where estimated
    /reactions/<boundary>  REACTION of the support on its body, where requested
    /bolts/<name>          BOLT, with SECTIONS of its shank at SECTION_PLACES, their SECTION_STRESSES, and
                           MARGINS; attributes order, target_force
    /convergence           CONVERGENCE
    /energy                ENERGY of the assembly, where requested
    /resultants            RESULTANTS of every body at the end, without inertia
    /accuracy              estimated errors (``results.estimates``), where estimated

Names in capitals are tables of ``results.quantities``, which have names, units and dimensions.
Every group has its own ``time``: the fields of a substructure may be stored at fewer instants than the run
has. What a run does not have (the gap of a perfect connection, fields not requested) is absent.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..fem.elasticity import von_mises
from ..fem.elements import Recovery, principal
from ..latin.outcome import Array, InterfaceHistory, Outcome, Resultants, SubstructureHistory, WindowRecord
from ..latin.status import WindowList
from ..scene.quantity_table import INTERFACE as OF_INTERFACE
from ..scene.quantity_table import PEAK_FORCE, RUN_SCALARS, QuantityOfInterest
from ..scene.sensors import Sensor
from .bolt_results import bolt_groups
from .files import write_groups
from .groups import StoredGroup, describe_mesh, root_attributes
from .interface_fields import Force, InterfaceFields, normal_resultant, slip_in_contact
from .owner_records import InterfaceRecord, stored_rows, stored_scalars
from .quantities import (
    AXES,
    CONVERGENCE,
    ENERGY,
    INTERFACE,
    INTERFACE_MADE,
    LABELS,
    MARKS,
    MESH,
    NODES,
    PLANE,
    POINTS,
    RECOVERED,
    RESULTANTS,
    SIDES,
    SUBSTRUCTURE,
    SURFACE,
    TENSORS,
    columns,
    named,
)
from .sensors import reaction_groups, sensor_groups

if TYPE_CHECKING:
    import xarray as xr

_PEAK: Final = 100_000  # instants of which the largest mean of a force is taken, at most
_ACROSS: Final = 1.0 - 1e-8  # cosine of a normal with the axis that it is along, 0.01 degrees
_WINDOWS: Final = 16_384  # of a block of windows


@dataclass(frozen=True)
class Recovered:
    """Request for fields beyond displacement, velocity and mean stress.

    recovery : of the substructure. strain, nodal_stress, principal_stress : as in ``[output]``; principal values are
    those of the mean stress and of the nodal stress, as far as these are kept. unstrained : part of the stress that no
    strain makes (instants (n_time,) -> (n_time, 1, 6)), Pa.
    """

    recovery: Recovery
    strain: bool
    nodal_stress: bool
    principal_stress: bool
    unstrained: Callable[[Array], Array] | None = None

    def fields(self, history: SubstructureHistory) -> dict[str, Array | None]:
        """The fields of a substructure by name, None where not requested."""
        moved, strain, nodal = history.displacement, None, None
        if self.strain and moved is not None:
            strain = self.recovery.strain(moved)
        if self.nodal_stress and moved is not None:
            nodal = self.stress_at_nodes(moved, history.time)
        return {
            "strain": strain,
            "principal_stress": self._principal(history.stress),
            "nodal_stress": nodal,
            "nodal_principal_stress": self._principal(nodal),
            "nodal_von_mises": None if nodal is None else von_mises(nodal),
        }

    def stress_at_nodes(self, displacement: Array, time: Array) -> Array:
        """Stress (n_time, n_node, 6), Pa, of displacements (n_time, n_node, 3), m, at instants (n_time,), s."""
        nodal = self.recovery.nodal_stress(displacement)
        if self.unstrained is not None:
            nodal = nodal + self.unstrained(time)
        return nodal

    def _principal(self, stress: Array | None) -> Array | None:
        """Principal stresses, None where there is no stress or where they are not requested."""
        if stress is None or not self.principal_stress:
            return None
        return principal(stress)


def datatree(groups: Mapping[str, StoredGroup], scene_name: str) -> xr.DataTree:
    """Groups of ``result_groups`` as a DataTree."""
    import xarray as xr

    return xr.DataTree.from_dict({path: group.dataset() for path, group in groups.items()}, name=scene_name)


class Stored(ABC):
    """Results of an analysis beside a run, which are stored as groups; ``name`` : of the scene."""

    name: str

    @abstractmethod
    def groups(self) -> dict[str, StoredGroup]:
        """Groups by path."""

    def to_datatree(self) -> xr.DataTree:
        """Everything as an xarray DataTree."""
        return datatree(self.groups(), self.name)

    def save(self, path: str | Path) -> None:
        """Write a netCDF-4 file, complete or not at all.

        Raises
        ------
        ResultsError : the file cannot be written.
        """
        write_groups(self.groups(), path)


def root_group(outcome: Outcome, scene_name: str, scene_text: str, provenance: Mapping[str, str]) -> StoredGroup:
    """Group of the root, with the status and the whole scene: the run can be repeated from its file."""
    timings = outcome.timings
    attrs: dict[str, object] = {
        **root_attributes("impact with frictional contact", scene_name, scene_text, provenance),
        "status": outcome.status,
        "converged": np.int8(outcome.converged),
        "complete": np.int8(outcome.complete),
        "trustworthy": np.int8(outcome.trustworthy),
        "interrupted": outcome.interrupted,
        "warnings": "\n".join(outcome.warnings),
        "cpu_seconds_set_up": timings.setup,
        "cpu_seconds_march": timings.march,
        "cpu_seconds_other": timings.other,
        "peak_memory_bytes": np.int64(timings.peak_memory),
    }
    return StoredGroup({}, attrs=attrs)


def result_groups(
    outcome: Outcome,
    recovered: Mapping[str, Recovered],
    sensors: Mapping[str, Sensor],
    spectrum_errors: Mapping[str, Array] | None = None,
    surfaces: bool = False,
    streamed: bool = False,
) -> dict[str, StoredGroup]:
    """The results of a run by path of the group (layout: module docstring), without the root.

    ``recovered``: requests for more fields, by substructure. ``sensors``: their tables in the scene.
    ``spectrum_errors``: estimated relative errors of their spectra. ``surfaces``: pressure and slip of interfaces.
    ``streamed``: without what ``result_blocks`` gives.
    """
    groups: dict[str, StoredGroup] = {}
    if not streamed:
        groups |= _interface_groups(outcome, surfaces)
    for name, substructure in outcome.substructures.items():
        if _has_fields(substructure):
            groups[f"/substructures/{name}"] = substructure_group(substructure, recovered.get(name))
        if substructure.energy is not None:
            groups[f"/substructures/{name}/energy"] = _stored_energy(substructure, outcome.time)
    groups |= sensor_groups(outcome, sensors, spectrum_errors) | reaction_groups(outcome) | bolt_groups(outcome)
    if not streamed:
        groups["/convergence"] = _convergence(outcome)
    if outcome.energy is not None:
        groups["/energy"] = energy_group(outcome.energy, outcome.time)
    if outcome.resultants:
        groups["/resultants"] = resultant_group(outcome.resultants)
    return groups


def _interface_groups(outcome: Outcome, surfaces: bool) -> dict[str, StoredGroup]:
    groups: dict[str, StoredGroup] = {}
    for name, interface in outcome.interfaces.items():
        time, indicator = outcome.interface_time, outcome.interface_indicator.get(name)
        # a sum over the instants that were kept alone would miss what is between
        ways = None
        if surfaces and len(time) == len(outcome.time):
            ways = _ways(interface, time)
        groups[f"/interfaces/{name}"] = interface_group(interface, time, indicator, surfaces, ways)
    return groups


def interface_group(
    history: InterfaceHistory,
    time: Array,
    indicator: float | None = None,
    surfaces: bool = False,
    ways: Mapping[str, Array] | None = None,
) -> StoredGroup:
    """Group ``interfaces/<name>``; ``indicator`` is sqrt(eta) restricted to this interface; ``surfaces``: with pressure
    and, where they are known, the sums over time at the points (``_ways``)."""
    record = InterfaceRecord.of(history, time)
    summed = named(INTERFACE_MADE, {"impulse": history.impulse(time)})
    fields: dict[str, object] = {"pressure": None, "error_indicator": indicator}
    if surfaces:
        fields["pressure"] = history.pressure()
    if ways is not None:
        fields |= {**ways, "slip": np.linalg.norm(ways["slip"], axis=2)}
    scalars = stored_scalars(OF_INTERFACE, record)
    stored = [*columns(INTERFACE, history), *summed, *scalars, *named(INTERFACE_MADE, fields)]
    along = [*named(LABELS, {"time": time, "side": SIDES, "component": AXES}), *columns(POINTS, history)]
    attrs: dict[str, object] = {"behaviour": history.behaviour, "face_E": history.sides[0], "face_Ep": history.sides[1]}
    if history.friction_coefficient is not None:
        attrs["friction_coefficient"] = float(history.friction_coefficient)
    if surfaces and ways is None:
        attrs["slip"] = "none: it needs the velocities at all instants (output.interfaces_every = 1)"
    meshed = history.cells is not None and len(history.cells) > 0
    if meshed:
        stored += columns(SURFACE, history)
        directions = _plane_axes(history)
        # from the origin of the global axes
        along += named(PLANE, dict(zip(PLANE, directions @ history.points.T, strict=True)))
    group = StoredGroup.of(stored, along, attrs)
    group.variables[PEAK_FORCE.key].attrs["peak_duration"] = record.duration
    if meshed:
        _describe_surface(group)
        for name, direction in zip(PLANE, directions, strict=True):
            group.variables[name].attrs["direction"] = direction
    return group


def _ways(history: InterfaceHistory, time: Array) -> dict[str, Array]:
    """What is summed up at the points over all instants, by the name of the row (``INTERFACE_MADE``): ``slip`` (n_time,
    n_point, 3) as a vector; of an interface with friction the others (n_time, n_point)."""
    ways = {"slip": slip_in_contact(history, time)}
    if history.friction_power is not None and history.has_friction:
        ways |= dict(zip(("accumulated_slip", "friction_energy"), history.slid(time), strict=True))
    return ways


def _plane_axes(history: InterfaceHistory) -> Array:
    """Directions (2, 3) of the coordinates in the mean plane of the points: the two global axes in it where it is
    across the third, else the projection of the global axis nearest to the plane and the direction across."""
    weights = history.areas / history.areas.sum()
    arms = history.points - weights @ history.points
    across = np.linalg.eigh((weights[:, None] * arms).T @ arms)[1][:, 0]
    normal = int(np.abs(across).argmax())
    if np.abs(across[normal]) > _ACROSS:
        return np.delete(np.eye(3), normal, axis=0)
    across = across * np.sign(across[normal])  # an eigenvector has no sign of its own
    first = np.eye(3)[int(np.argmin(np.abs(np.round(across, 9))))]  # round-off would choose between axes in the plane
    first = first - (first @ across) * across
    first /= np.linalg.norm(first)
    second = np.cross(across, first)
    # upwards along the axis that it has most of
    return np.stack([first, second * np.sign(second[np.abs(second).argmax()])])


def _describe_surface(group: StoredGroup) -> None:
    """UGRID attributes of the surface of an interface, a two-dimensional mesh in its mean plane."""
    group.variables["surface"].attrs.update(
        cf_role="mesh_topology",
        topology_dimension=np.int32(2),
        node_coordinates=" ".join(PLANE),
        face_node_connectivity="cells",
        node_dimension="point",
        face_dimension="cell",
    )
    group.variables["cells"].attrs.update(cf_role="face_node_connectivity", start_index=np.int32(0))
    for name, variable in group.variables.items():
        if "point" in variable.dims and name not in group.labels:
            variable.attrs.update(mesh="surface", location="node")


def interface_blocks(outcome: Outcome, surfaces: bool = False) -> Iterator[dict[str, StoredGroup]]:
    """Groups of the interfaces by path, block by block of the instants of the stream of a run; scalars follow from the
    forces of all instants and come with the last block."""
    stream = outcome.stream
    assert stream is not None
    run_time = outcome.time[:: stream.every]
    end = float(run_time[-1])
    pushed = {name: np.zeros(len(run_time)) for name in outcome.interfaces}
    impulse = dict.fromkeys(pushed, np.zeros(3))
    reached: dict[str, dict[str, Array]] = {name: {} for name in pushed}
    for first, time, histories in stream.blocks():
        groups, last = {}, first + len(time)
        for name, history in histories.items():
            ways = None
            if surfaces and stream.every == 1:
                ways = {key: way + reached[name].get(key, 0.0) for key, way in _ways(history, time).items()}
                reached[name] = {key: way[-1] for key, way in ways.items()}
            indicator = outcome.interface_indicator.get(name)
            group = interface_group(history, time, indicator, surfaces, ways)
            group.variables["impulse"].values += impulse[name]
            impulse[name] = group.variables["impulse"].values[-1].copy()
            pushed[name][first:last] = normal_resultant(InterfaceFields.of_history(history, time))
            for variable in group.variables.values():
                # blocks overlap by one instant, from which sums go on
                if first and variable.dims[:1] == ("time",):
                    variable.values = variable.values[1:]
            if last == len(run_time):
                _set_scalars(group, InterfaceRecord(Force(run_time, pushed[name]), end, history.peak_duration))
            groups[f"/interfaces/{name}"] = group
        yield groups


def _set_scalars(group: StoredGroup, record: InterfaceRecord) -> None:
    """Put the scalars of the whole run in the group of an interface; a largest mean of a very long run follows from
    some of its instants, for it takes much memory."""
    # rounded up
    every = -(-len(record.force.time) // _PEAK)
    thinned = replace(record, force=Force(record.force.time[::every], record.force.value[::every]))
    for key in stored_rows(OF_INTERFACE).keys() & group.variables.keys():
        row = RUN_SCALARS[key]
        mean = isinstance(row, QuantityOfInterest) and row.mean
        # what needs the points is not known of all instants together
        value = None
        if mean and not row.points:
            value = row.value(thinned)
        elif not row.points:
            value = row.value(record)
        if value is None:
            value = np.nan
        group.variables[key].values = np.array(value)
        if mean and every > 1:
            group.variables[key].attrs["instants"] = f"every {every}th one"
    group.variables[PEAK_FORCE.key].attrs["peak_duration"] = thinned.duration


def result_blocks(outcome: Outcome, surfaces: bool = False) -> Iterator[dict[str, StoredGroup]]:
    """The groups that ``result_groups`` leaves out of a streamed run, in blocks of instants and of windows."""
    starts = range(0, max(1, len(outcome.windows)), _WINDOWS)
    interfaces = interface_blocks(outcome, surfaces)
    windows = ({"/convergence": _convergence(outcome, start, start + _WINDOWS)} for start in starts)
    yield {**next(interfaces), **next(windows)}
    yield from interfaces
    yield from windows


def has_friction(group: xr.Dataset) -> bool:
    """Whether Coulomb friction acts at the interface of a stored group (mu > 0)."""
    return float(group.attrs.get("friction_coefficient", 0.0)) > 0.0


def energy_group(terms: Mapping[str, Array], time: Array) -> StoredGroup:
    """Group ``energy``: one variable per term (n_time,), J."""
    return StoredGroup.of(named(ENERGY, terms), named(LABELS, {"time": time}))


def _stored_energy(history: SubstructureHistory, run_time: Array) -> StoredGroup:
    """Energy terms at the stored instants of the fields (a group shares its time with those below it).

    Work and dissipation accumulate, so picking instants loses nothing in between. All instants of the run
    are kept where no field is stored.
    """
    terms = history.energy or {}
    if not _has_fields(history):
        return energy_group(terms, run_time)
    # midpoints: the number of those before an instant is the nearest one
    nearest = np.searchsorted(0.5 * (run_time[1:] + run_time[:-1]), history.time)
    return energy_group({name: values[nearest] for name, values in terms.items()}, history.time)


def substructure_group(history: SubstructureHistory, recovered: Recovered | None = None) -> StoredGroup:
    """Group ``substructures/<name>``: fields at the stored instants, and the mesh."""
    fields = [*columns(SUBSTRUCTURE, history), *columns(MARKS, history)]
    if recovered is not None:
        fields += named(RECOVERED, recovered.fields(history))
    used = {dim for row, _ in fields for dim in row.dims}
    along = {"time": history.time, "component": AXES} | {dim: names for dim, names in TENSORS.items() if dim in used}
    group = StoredGroup.of([*fields, *columns(MESH, history)], [*named(LABELS, along), *columns(NODES, history)])
    describe_mesh(group, history.cell_type)
    return group


def _convergence(outcome: Outcome, first: int = 0, last: int | None = None) -> StoredGroup:
    """Group ``convergence`` of some windows, with the settings of the run."""
    group = convergence_group(outcome.windows, outcome.time, outcome.passes, first, last)
    settings = outcome.settings.items()
    group.attrs.update({f"setting_{re.sub('[^A-Za-z0-9]+', '_', key)}": value for key, value in settings})
    return group


def convergence_group(
    windows: Sequence[WindowRecord], time: Array, passes: float, first: int = 0, last: int | None = None
) -> StoredGroup:
    """Group ``convergence``: curves padded with NaN to the longest window (at least one column); of the windows from
    number ``first`` to before ``last``."""
    chosen = windows[first:last]
    if isinstance(windows, WindowList):
        every = windows
    else:
        every = WindowList(windows)
    variables: dict[str, Any] = {"passes": float(passes)}
    if not chosen:
        return StoredGroup.of(named(CONVERGENCE, variables))
    width = max(1, every.most_iterations())
    for name in ("error_indicator", "force_mismatch"):
        variables[name] = table = np.full((len(chosen), width), np.nan)
        for row, window in zip(table, chosen, strict=True):
            curve = getattr(window, name)
            row[: len(curve)] = curve
    kinds = dict.fromkeys(("iterations", "newton_steps", "first_instant", "last_instant"), np.int32)
    truncated = {}
    if every.largest_defect() > 0.0:
        truncated = {"defect": np.float64, "corrections": np.int32}
    for name, kind in ({"converged": np.int8} | kinds | truncated).items():
        variables[name] = np.array([getattr(window, name) for window in chosen], dtype=kind)
    # an interrupted run has fewer instants than its last window names
    variables["end_time"] = time[np.minimum(variables["last_instant"], len(time) - 1)]
    if every.with_fallbacks():
        variables["fallbacks"] = np.array(["; ".join(window.fallbacks) for window in chosen], dtype=object)
    # counted from 1, as in messages
    counts = {"window": np.arange(first + 1, first + len(chosen) + 1), "iteration": np.arange(1, width + 1)}
    return StoredGroup.of(named(CONVERGENCE, variables), named(LABELS, counts))


def resultant_group(resultants: Mapping[str, Resultants]) -> StoredGroup:
    """Group ``resultants``: forces and moments (substructure, component)."""
    parts = {"load": "loads", "interface": "interfaces", "reaction": "reactions", "unbalanced": "unbalanced"}
    vectors: dict[str, Array] = {}
    for name, part in parts.items():
        both = np.stack([getattr(r, part) for r in resultants.values()])
        vectors |= {f"{name}_force": both[:, :3], f"{name}_moment": both[:, 3:]}
    along = {"substructure": list(resultants), "component": AXES}
    return StoredGroup.of(named(RESULTANTS, vectors), named(LABELS, along))


def _has_fields(history: SubstructureHistory) -> bool:
    return any(field is not None for field in (history.displacement, history.velocity, history.stress))
