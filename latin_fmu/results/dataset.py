"""An ``Outcome`` as groups of arrays with stable names, for netCDF and xarray.

::

    /                      provenance and status, as attributes
    /interfaces/<name>     force, impulse (time, component); peak_force (attribute peak_duration, s),
                           peak_force_raw; traction (time, point, component);
                           velocity (time, side, point, component); gap, contact_status (time, point);
                           friction_power, layer_energy, joint_power (time); x, y, z, area, initial_gap (point);
                           normal (point, component); cells (cell, corner) of the surface, surface_x, surface_y
                           (point) in its mean plane; pressure, slip (time, point), where requested
    /substructures/<name>  only fields that the scene requests: displacement, velocity (time, node, component);
                           stress (time, cell, stress_component); strain (time, cell, strain_component);
                           nodal_stress (time, node, stress_component); principal_stress (time, cell, principal),
                           nodal_principal_stress (time, node, principal); and with any of them the mesh:
                           cell_nodes (cell, cell_node), cell_shape (cell), node_x, node_y, node_z (node)
    /substructures/<name>/energy   terms of the substructure (time), where requested
    /sensors/<name>        displacement, velocity, acceleration (time, component), with ..._filtered where
                           requested; x, y, z of the place
    /sensors/<name>/spectrum   acceleration, pseudo_velocity (response, frequency, component), where requested;
                           relative_error where estimated
    /reactions/<boundary>  force (time, component) of the support on its body, where requested
    /bolts/<name>          force, mean_stress (time); tightening_force (order); shortening, section_area; attributes
                           order, target_force
    /convergence           error_indicator, force_mismatch (window, iteration), padded with NaN;
                           iterations, newton_steps, converged, first_instant, last_instant, end_time (window);
                           defect, corrections (window) where interfaces have truncated tables; passes
    /energy                terms of the assembly (time), where requested
    /resultants            forces and moments of the loads, interfaces and supports of every body at the end, and what
                           is not in balance (substructure, component), without inertia
    /accuracy              estimated relative error, observed and expected order (quantity), where estimated

Every group has its own ``time``: the fields of a substructure may be stored at fewer instants than the run
has. What a run does not have (the gap of a perfect connection, fields not requested) is absent.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..fem.elements import Recovery, principal
from ..latin.outcome import Array, InterfaceHistory, Outcome, Resultants, SubstructureHistory, WindowRecord
from ..latin.status import WindowList
from ..scene.sensors import Sensor
from .groups import (
    CONVENTIONS,
    CONVERGENCE,
    ENERGY,
    INTERFACE,
    RESULTANTS,
    SCHEMA_VERSION,
    SUBSTRUCTURE,
    Columns,
    Group,
    annotated,
    describe_mesh,
)
from .quantities_of_interest import Force, InterfaceFields, normal_resultant, slip_in_contact
from .sensors import bolt_groups, reaction_groups, sensor_groups

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Recovered:
    """Request for fields beyond displacement, velocity and mean stress.

    recovery : of the substructure. strain, nodal_stress, principal_stress : as in ``[output]``; principal values are
    those of the mean stress and of the nodal stress, as far as these are kept.
    """

    recovery: Recovery
    strain: bool
    nodal_stress: bool
    principal_stress: bool

    def columns(self, history: SubstructureHistory) -> Columns:
        """Variables of the dataset of the substructure."""
        columns: Columns = {}
        if self.strain and history.displacement is not None:
            strain = self.recovery.strain(history.displacement)
            columns["strain"] = (("time", "cell", "strain_component"), strain)
        if self.principal_stress and history.stress is not None:
            columns["principal_stress"] = (("time", "cell", "principal"), principal(history.stress))
        if self.nodal_stress and history.displacement is not None:
            stress = self.recovery.nodal_stress(history.displacement)
            columns["nodal_stress"] = (("time", "node", "stress_component"), stress)
            if self.principal_stress:
                columns["nodal_principal_stress"] = (("time", "node", "principal"), principal(stress))
        return columns


LABELS: Final[Mapping[str, Any]] = {
    "stress_component": ("xx", "yy", "zz", "yz", "xz", "xy"),
    "strain_component": ("xx", "yy", "zz", "yz", "xz", "xy"),
    "principal": np.array([1, 2, 3], dtype=np.int32),
}
"""Coordinates of the dimensions of tensors."""


_PEAK: Final = 100_000  # instants of which the largest mean of a force is taken, at most
_WINDOWS: Final = 16_384  # of a block of windows
AXES: Final = ["x", "y", "z"]
_PLANE: Final = ("surface_x", "surface_y")
SIDES: Final = ["E", "Ep"]


def datatree(groups: Mapping[str, Group], scene_name: str) -> xr.DataTree:
    """Groups of ``result_groups`` as a DataTree."""
    import xarray as xr

    return xr.DataTree.from_dict({path: group.dataset() for path, group in groups.items()}, name=scene_name)


def result_groups(
    outcome: Outcome,
    scene_name: str,
    scene_text: str,
    provenance: Mapping[str, str],
    recovered: Mapping[str, Recovered] | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    spectrum_errors: Mapping[str, Array] | None = None,
    surfaces: bool = False,
    streamed: bool = False,
) -> dict[str, Group]:
    """The results of a run by path of the group (layout: module docstring).

    ``provenance`` and the whole ``scene_text`` become root attributes: the run can be repeated from its file.
    ``recovered``: requests for more fields, by substructure. ``sensors``: their tables in the scene.
    ``spectrum_errors``: estimated relative errors of their spectra. ``surfaces``: pressure and slip of interfaces.
    """
    groups = {"/": Group({}, attrs=_root_attributes(outcome, scene_name, scene_text, provenance))}
    for name, interface in () if streamed else outcome.interfaces.items():
        indicator = outcome.interface_indicator.get(name)
        time = outcome.interface_time
        whole = surfaces and len(time) == len(outcome.time)
        slip = np.linalg.norm(slip_in_contact(interface, time), axis=2) if whole else None
        groups[f"/interfaces/{name}"] = interface_group(interface, time, indicator, surfaces, slip)
    for name, substructure in outcome.substructures.items():
        if _has_fields(substructure):
            more = (recovered or {}).get(name)
            groups[f"/substructures/{name}"] = substructure_group(substructure, more)
        if substructure.energy is not None:
            groups[f"/substructures/{name}/energy"] = _stored_energy(substructure, outcome.time)
    groups |= sensor_groups(outcome, sensors or {}, spectrum_errors) | reaction_groups(outcome)
    groups |= bolt_groups(outcome)
    if not streamed:
        groups["/convergence"] = _convergence(outcome)
    if outcome.energy is not None:
        groups["/energy"] = energy_group(outcome.energy, outcome.time)
    if outcome.resultants:
        groups["/resultants"] = resultant_group(outcome.resultants)
    return groups


def interface_group(
    history: InterfaceHistory,
    time: Array,
    indicator: float | None = None,
    surfaces: bool = False,
    slip: Array | None = None,
) -> Group:
    """Group ``interfaces/<name>``; ``indicator`` is sqrt(eta) restricted to this interface; ``surfaces``: with pressure
    and, where it is known, the ``slip`` (n_time, n_point), m."""
    vector = ("time", "point", "component")
    columns: Columns = {
        "area": ("point", history.areas),
        "normal": (("point", "component"), history.normals),
        "initial_gap": ("point", history.initial_gap),
        "traction": (vector, history.traction),
        "velocity": (("time", "side", "point", "component"), history.velocity),
        "force": (("time", "component"), history.force()),
        "impulse": (("time", "component"), history.impulse(time)),
    }
    peak, duration, raw = InterfaceFields.of_history(history, time).peaks
    columns |= {"peak_force": ((), peak), "peak_force_raw": ((), raw)}
    if history.gap is not None:
        columns["gap"] = (("time", "point"), history.gap)
    if history.contact_status is not None:
        columns["contact_status"] = (("time", "point"), history.contact_status)
    if surfaces:
        columns["pressure"] = (("time", "point"), history.pressure())
        if slip is not None:
            columns["slip"] = (("time", "point"), slip)
    for key in ("friction_power", "layer_energy", "joint_power"):
        if (values := getattr(history, key)) is not None:
            columns[key] = ("time", values)
    if indicator is not None:
        columns["error_indicator"] = ((), indicator)
    positions = {axis: ("point", history.points[:, i]) for i, axis in enumerate(AXES)}
    labels = {"time": time, "side": SIDES, "component": AXES}
    attrs: dict[str, object] = {"behaviour": history.behaviour, "face_E": history.sides[0], "face_Ep": history.sides[1]}
    if history.friction_coefficient is not None:
        attrs["friction_coefficient"] = float(history.friction_coefficient)
    if surfaces and slip is None:
        attrs["slip"] = "none: it needs the velocities at all instants (output.interfaces_every = 1)"
    meshed = history.cells is not None and len(history.cells) > 0
    if meshed:
        columns |= {"cells": (("cell", "corner"), history.cells), "surface": ((), np.int32(0))}
        positions |= {name: ("point", x) for name, x in zip(_PLANE, _in_plane(history).T, strict=True)}
    group = annotated(Group.of(columns, {**labels, **positions}, attrs), INTERFACE)
    group.variables["peak_force"].attrs["peak_duration"] = duration
    if meshed:
        _describe_surface(group)
    return group


def _in_plane(history: InterfaceHistory) -> Array:
    """Coordinates (n_point, 2) of the points in their mean plane, m, from their centre; along the global axes where the
    plane is across one, else along the projection of the global axis nearest to the plane and the direction across."""
    weights = history.areas / history.areas.sum()
    arms = history.points - weights @ history.points
    across = np.linalg.eigh((weights[:, None] * arms).T @ arms)[1][:, 0]
    across = across * np.sign(across[np.abs(across).argmax()])
    first = np.eye(3)[int(np.argmin(np.abs(np.round(across, 9))))]
    first = first - (first @ across) * across
    first /= np.linalg.norm(first)
    return np.asarray(arms @ np.stack([first, np.cross(across, first)], axis=1))


def _describe_surface(group: Group) -> None:
    """UGRID attributes of the surface of an interface, a two-dimensional mesh in its mean plane."""
    group.variables["surface"].attrs.update(
        cf_role="mesh_topology",
        topology_dimension=np.int32(2),
        node_coordinates=" ".join(_PLANE),
        face_node_connectivity="cells",
        node_dimension="point",
        face_dimension="cell",
    )
    group.variables["cells"].attrs.update(cf_role="face_node_connectivity", start_index=np.int32(0))
    for name, variable in group.variables.items():
        if "point" in variable.dims and name not in group.labels:
            variable.attrs.update(mesh="surface", location="node")


def interface_blocks(outcome: Outcome, surfaces: bool = False) -> Iterator[dict[str, Group]]:
    """Groups of the interfaces by path, block by block of the instants of the stream of a run; peak forces follow from
    all instants and come with the last block."""
    stream = outcome.stream
    assert stream is not None
    run_time = outcome.time[:: stream.every]
    pushed = {name: np.zeros(len(run_time)) for name in outcome.interfaces}
    impulse = dict.fromkeys(pushed, np.zeros(3))
    moved: dict[str, Array | float] = dict.fromkeys(pushed, 0.0)
    for first, time, histories in stream.blocks():
        groups, last = {}, first + len(time)
        for name, history in histories.items():
            slip = None
            if surfaces and stream.every == 1:
                path = slip_in_contact(history, time) + moved[name]
                slip, moved[name] = np.linalg.norm(path, axis=2), path[-1]
            group = interface_group(history, time, outcome.interface_indicator.get(name), surfaces, slip)
            group.variables["impulse"].values += impulse[name]
            impulse[name] = group.variables["impulse"].values[-1].copy()
            pushed[name][first:last] = normal_resultant(InterfaceFields.of_history(history, time))
            for variable in group.variables.values():
                if first and variable.dims[:1] == ("time",):
                    variable.values = variable.values[1:]
            if last == len(run_time):
                _set_peaks(group, Force(run_time, pushed[name]), history.peak_duration)
            groups[f"/interfaces/{name}"] = group
        yield groups


def _set_peaks(group: Group, force: Force, requested: float | None) -> None:
    """Put the peak forces of the whole run in the group of an interface; the largest mean of a very long run follows
    from some of its instants, for it takes much memory."""
    every = -(-len(force.time) // _PEAK)
    peak, duration, _ = Force(force.time[::every], force.value[::every]).peaks(requested)
    mean, raw = group.variables["peak_force"], group.variables["peak_force_raw"]
    mean.values, raw.values = np.array(peak), np.array(force.raw_peak())
    mean.attrs["peak_duration"] = duration
    if every > 1:
        mean.attrs["instants"] = f"every {every}th one"


def result_blocks(outcome: Outcome, surfaces: bool = False) -> Iterator[dict[str, Group]]:
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


def energy_group(terms: Mapping[str, Array], time: Array) -> Group:
    """Group ``energy``: one variable per term (n_time,), J."""
    columns: Columns = {name: ("time", values) for name, values in terms.items()}
    return annotated(Group.of(columns, {"time": time}), ENERGY)


def _stored_energy(history: SubstructureHistory, run_time: Array) -> Group:
    """Energy terms at the stored instants of the fields (a group shares its time with those below it).

    Work and dissipation accumulate, so picking instants loses nothing in between. All instants of the run
    are kept where no field is stored.
    """
    terms = history.energy or {}
    if not _has_fields(history):
        return energy_group(terms, run_time)
    nearest = np.searchsorted(0.5 * (run_time[1:] + run_time[:-1]), history.time)
    return energy_group({name: values[nearest] for name, values in terms.items()}, history.time)


def substructure_group(history: SubstructureHistory, recovered: Recovered | None = None) -> Group:
    """Group ``substructures/<name>``: fields at the stored instants, and the mesh."""
    fields = {"displacement": history.displacement, "velocity": history.velocity}
    columns: Columns = {
        name: (("time", "node", "component"), values) for name, values in fields.items() if values is not None
    }
    if history.stress is not None:
        columns["stress"] = (("time", "cell", "stress_component"), history.stress)
    if recovered is not None:
        columns |= recovered.columns(history)
    used = {dim for column in columns.values() for dim in column[0]}  # type: ignore[attr-defined]
    labels: dict[str, object] = {"time": history.time, "component": AXES}
    labels |= {dim: list(names) for dim, names in LABELS.items() if dim in used}
    positions = {f"node_{axis}": ("node", history.nodes[:, i]) for i, axis in enumerate(AXES)}
    columns["cell_nodes"] = (("cell", "cell_node"), history.cells)
    columns["mesh"] = ((), np.int32(0))
    group = annotated(Group.of(columns, {**labels, **positions}), SUBSTRUCTURE)
    describe_mesh(group, history.cell_type)
    return group


def _convergence(outcome: Outcome, first: int = 0, last: int | None = None) -> Group:
    """Group ``convergence`` of some windows, with the settings of the run."""
    group = convergence_group(outcome.windows, outcome.time, outcome.passes, first, last)
    settings = outcome.settings.items()
    group.attrs.update({f"setting_{re.sub('[^A-Za-z0-9]+', '_', key)}": value for key, value in settings})
    return group


def convergence_group(
    windows: Sequence[WindowRecord], time: Array, passes: float, first: int = 0, last: int | None = None
) -> Group:
    """Group ``convergence``: curves padded with NaN to the longest window (at least one column); of the windows from
    number ``first`` to before ``last``."""
    columns: Columns = {"passes": ((), float(passes))}
    chosen, numbers = windows[first:last], windows if isinstance(windows, WindowList) else WindowList(windows)
    if not chosen:
        return annotated(Group.of(columns), CONVERGENCE)
    width = max(1, numbers.most_iterations())
    for name in ("error_indicator", "force_mismatch"):
        table = np.full((len(chosen), width), np.nan)
        for row, window in zip(table, chosen, strict=True):
            curve = getattr(window, name)
            row[: len(curve)] = curve
        columns[name] = (("window", "iteration"), table)
    end = np.array([window.last_instant for window in chosen], dtype=np.int32)
    columns["iterations"] = ("window", np.array([window.iterations for window in chosen], dtype=np.int32))
    columns["newton_steps"] = ("window", np.array([window.newton_steps for window in chosen], dtype=np.int32))
    if numbers.largest_defect() > 0.0:
        columns["defect"] = ("window", np.array([window.defect for window in chosen]))
        columns["corrections"] = ("window", np.array([window.corrections for window in chosen], dtype=np.int32))
    columns["converged"] = ("window", np.array([window.converged for window in chosen], dtype=np.int8))
    columns["first_instant"] = ("window", np.array([w.first_instant for w in chosen], dtype=np.int32))
    columns["last_instant"] = ("window", end)
    columns["end_time"] = ("window", time[np.minimum(end, len(time) - 1)])
    if numbers.with_fallbacks():
        columns["fallbacks"] = ("window", np.array(["; ".join(w.fallbacks) for w in chosen], dtype=object))
    counts = {"window": np.arange(first + 1, first + len(chosen) + 1), "iteration": np.arange(1, width + 1)}
    return annotated(Group.of(columns, counts), CONVERGENCE)


def resultant_group(resultants: Mapping[str, Resultants]) -> Group:
    """Group ``resultants``: forces and moments (substructure, component)."""
    parts = {"load": "loads", "interface": "interfaces", "reaction": "reactions", "unbalanced": "unbalanced"}
    columns: Columns = {}
    for name, part in parts.items():
        both = np.stack([getattr(r, part) for r in resultants.values()])
        columns[f"{name}_force"] = (("substructure", "component"), both[:, :3])
        columns[f"{name}_moment"] = (("substructure", "component"), both[:, 3:])
    return annotated(Group.of(columns, {"substructure": list(resultants), "component": AXES}), RESULTANTS)


def _has_fields(history: SubstructureHistory) -> bool:
    return any(field is not None for field in (history.displacement, history.velocity, history.stress))


def _root_attributes(
    outcome: Outcome, scene_name: str, scene_text: str, provenance: Mapping[str, str]
) -> dict[str, object]:
    timings = outcome.timings
    return {
        **provenance,
        "Conventions": CONVENTIONS,
        "schema_version": SCHEMA_VERSION,
        "title": f"{scene_name}: impact with frictional contact",
        "scene_name": scene_name,
        "scene": scene_text,
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
