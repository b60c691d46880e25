"""Keeps the accepted fields of a run; at its end histories of interfaces and substructures, and the energies.

Interface energies follow from the histories of the interfaces. Works over a step use the time scheme's weights of the
instants n-1, n, n+1, as the energy balances of the substructures do.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np

from ..fem.elasticity import von_mises
from ..kernels.energy_parts import TERMS
from ..propagator.base import full_displacement, full_velocity
from ..propagator.image import Image
from .assembly import Array, Assembly, Index
from .interface_rows import InterfaceRows, InterfaceStream, joined_rows
from .outcome import (
    BoltHistory,
    InterfaceHistory,
    NodeMarks,
    PointFields,
    ReactionHistory,
    SensorHistory,
    SubstructureHistory,
)
from .part import Part
from .probes import SERIES, OutputRequest, Probes, nodes_of, reaction_histories, sensor_histories
from .status import stored_energy

_WATCHED: Final = 500  # instants at which the stresses of bodies with a yield stress are looked at, at most
_SMALL: Final = 20_000  # dofs of all nodes up to which the kernels keep the fields of many instants


@dataclass(frozen=True)
class SubstructureInfo:
    """Mesh of a substructure for the results, its stress recovery (displacements (n_node, 3) -> (n_cell, 6), None where
    no stress is requested), the part of the stress that displacements do not make (instants (n_time,) -> (n_time,
    n_cell or 1, 6)), its yield stress, Pa, None where none is given, and marks of its nodes where fields are kept."""

    nodes: Array
    cells: np.ndarray
    cell_type: str
    stress: Callable[[Array], Array] | None
    unstrained: Callable[[Array], Array] | None = None
    yield_stress: float | None = None
    marks: NodeMarks | None = None


class StoredFields:
    """Fields of the substructures at the instants that are stored.

    Attributes
    ----------
    times : of these instants, s. fields : lists of arrays by substructure and name.
    """

    def __init__(self, request: OutputRequest, info: Mapping[str, SubstructureInfo], names: Sequence[str]) -> None:
        self._request, self._info = request, info
        self.times: list[float] = []
        self.fields: dict[str, dict[str, list[Array]]] = {name: {} for name in names}

    @property
    def wanted(self) -> bool:
        """Whether any are stored."""
        return self._request.fields or self._request.stress

    def keep(self, _instants: range, times: Array, moved: Callable[[str, int], Any]) -> None:
        """Keep the requested fields at further instants of these ``times``, s; ``moved`` : displacements (0) or
        velocities (1) of a body at them, (n, n_node, 3)."""
        self.times += times.tolist()
        for name in self.fields:
            self.add(name, moved(name, 0), moved(name, 1))

    def add(self, name: str, displacement: Iterable[Array], velocity: Iterable[Array]) -> None:
        """Keep what is requested of the motion of a body at further instants, (n_node, 3) each."""
        recover, fields = self._info[name].stress, dict[str, Any]()
        if self._request.fields:
            fields = {"displacement": displacement, "velocity": velocity}
        if self._request.stress and recover is not None:
            fields["stress"] = map(recover, displacement)
        for key, values in fields.items():
            self.fields[name].setdefault(key, []).extend(values)

    def part(self, first: int) -> dict[str, Any]:
        """Those from the stored instant ``first`` on, as plain arrays."""
        return {
            "times": np.array(self.times[first:]),
            "fields": {
                name: {key: np.array(values[first:]) for key, values in fields.items()}
                for name, fields in self.fields.items()
            },
        }

    def append(self, part: Mapping[str, Any]) -> None:
        """Put a ``part`` behind what has been kept."""
        self.times += part["times"].tolist()
        for name, fields in part["fields"].items():
            for key, values in fields.items():
                self.fields[name].setdefault(key, []).extend(values)

    def history(self, name: str, energy: dict[str, Array] | None) -> SubstructureHistory:
        """History of a substructure."""
        fields, info = {key: np.stack(values) for key, values in self.fields[name].items()}, self._info[name]
        times, stress = np.array(self.times), fields.get("stress")
        if stress is not None and info.unstrained is not None:
            stress = stress + info.unstrained(times)
        motion = fields.get("displacement"), fields.get("velocity"), stress
        return SubstructureHistory(name, info.nodes, info.cells, info.cell_type, times, *motion, energy, info.marks)


def _read(whole: Probes | None, now: slice, row: int, every: int) -> tuple[range, slice]:
    """Those of the instants ``now`` that are multiples of ``every`` and whose fields can be read, and their rows in the
    image's output from ``row`` on: all of them by the probes of all nodes, else the last one."""
    if whole is None:
        first = now.stop - 1
    else:
        first = now.start
    instants = range(-(-first // every) * every, now.stop, every)
    if instants:
        begin = instants[0]
    else:
        begin = now.stop
    return instants, slice(row + begin - now.start, row + now.stop - now.start, every)


class LargestStress(NamedTuple):
    """Largest von Mises stress of a body in a run.

    Attributes
    ----------
    stress : mean of an element, Pa. time : s. element : its number. above : number of elements above the yield stress
        then.
    """

    stress: float
    time: float
    element: int
    above: int


class LargestStresses:
    """Largest von Mises stresses of the bodies with a yield stress, at 500 instants at most.

    Attributes
    ----------
    tables : (n_time, 3) by body: stress, Pa, its element, number of elements above the yield stress; 0 at instants that
        are not looked at. every : at every so many.
    """

    def __init__(self, info: Mapping[str, SubstructureInfo], n_time: int) -> None:
        self._info = {name: of for name, of in info.items() if of.yield_stress is not None}
        self.tables = {name: np.zeros((n_time, 3)) for name in self._info}
        self.every = -(-n_time // _WATCHED)

    def keep(self, names: Collection[str], instants: range, times: Array, moved: Callable[[str, int], Any]) -> None:
        """Look at instants of these ``times``, s, of those of the bodies ``names`` that have a table; ``moved`` as for
        ``StoredFields.keep``."""
        for name, info in self._info.items():
            # not in the run, or in another process
            if info.stress is not None and info.yield_stress is not None and name in names:
                self.look_at(name, moved(name, 0), instants, times)

    def look_at(self, name: str, moved: Iterable[Array], instants: Sequence[int] | Index, times: Array) -> None:
        """Look at a body with displacements (n_node, 3) at instants, of these times, s."""
        info = self._info[name]
        assert info.stress is not None
        assert info.yield_stress is not None
        stress = np.stack([info.stress(u) for u in moved])
        if info.unstrained is not None:
            stress = stress + info.unstrained(times)
        size = von_mises(stress)
        above = (size > info.yield_stress).sum(axis=1)
        self.tables[name][instants] = np.stack([size.max(axis=1), size.argmax(axis=1), above], axis=1)

    def of(self, time: Array) -> dict[str, LargestStress]:
        """The largest ones of the run by body; ``time`` (n_time,) of its instants, s."""
        stresses = {}
        for name, table in self.tables.items():
            i = int(np.argmax(table[: len(time), 0]))
            stresses[name] = LargestStress(float(table[i, 0]), float(time[i]), int(table[i, 1]), int(table[i, 2]))
        return stresses


class Recorder:
    """Histories of interfaces (always) and substructures (as requested).

    thinned : those of interfaces are kept at every so many instants; the energies need them at every one. file : where
    those of interfaces go at ``thinned`` instants when ``in_memory`` holds fewer.
    """

    def __init__(
        self,
        assembly: Assembly,
        request: OutputRequest,
        substructures: dict[str, SubstructureInfo],
        thinned: int = 1,
        file: BinaryIO | None = None,
        in_memory: int = 1,
    ) -> None:
        self.request, self._info = request, substructures
        n_time = len(assembly.time)
        if file is None:
            every = thinned
        else:
            every = in_memory
        table = np.zeros((len(range(0, n_time, every)), InterfaceRows.width_of(assembly)))
        self.rows = InterfaceRows(assembly, table, every)
        self.stream = None
        if file is not None:
            self.stream = InterfaceStream(assembly, file, thinned, request.peak_duration)
        self._places = places_in(assembly)
        self._stored = StoredFields(request, substructures, list(self._places))
        self._series: dict[str, dict[Any, Array]] = {**request.series(n_time), "energy": {}}
        if request.energy:
            terms = {c: np.zeros((n_time, len(TERMS), len(p.members))) for c, p in enumerate(assembly.propagators)}
            self._series["energy"] = {**terms, "drift": np.zeros(n_time)}
        watched: Mapping[str, SubstructureInfo] = {}
        if request.watch:
            watched = substructures
        self.stresses = LargestStresses(watched, n_time)
        self._series["von_mises"] = self.stresses.tables
        self._histories: tuple[int, dict[str, InterfaceHistory]] = -1, {}  # of so many instants
        self._probes: Probes | None = None
        self._whole: Probes | None = None  # those of all nodes, where they are kept at every instant
        self.n_kept = 0
        """Instants kept so far, t = 0 included."""
        self.unread = frozenset[str]()
        """Names of interfaces that have no histories."""
        self.bond_resultants: dict[str, Array] = {}
        """Normal resultants (n_time,) of these by name, N, positive in compression, as far as they are requested."""

    @property
    def sliding(self) -> list[int]:
        """Interfaces whose tangential velocities come from the substructures."""
        return sorted(self.rows.slide)

    def probes(self, assembly: Assembly, fields: bool) -> Probes | None:
        """What an image keeps of the substructures for this recorder beside their energies, None where that is nothing;
        ``fields`` : those that are stored, too, where the substructures are small."""
        whole = fields and self._stored.wanted and small(assembly)
        if not (whole or self.rows.slide or any(self._series[key] for key in SERIES)):
            return None
        return Probes(assembly, self.sliding, self.request, whole)

    def keep(self, assembly: Assembly, image: Image, probes: Probes | None, n: int, row: int = 0) -> None:
        """Keep the next n instants, rows of the image's output from ``row`` on; the first ones are t = 0."""
        rows, now = slice(row, row + n), slice(self.n_kept, self.n_kept + n)
        self._keep_rows(assembly, image, probes, now, rows)
        self._probes, self._whole = probes, None
        if probes is not None and probes.whole:
            self._whole = probes
        for key, history in self._series["energy"].items():
            drift = key == "drift"
            # the work of the drift is one number an instant, of all interfaces
            if drift:
                terms = image.field("history_works", image.rows)
            else:
                terms = image.output(key, "energies", len(TERMS))
            history[now] = terms[rows]
        self.n_kept += n

        def look(every: int, keep: Callable[..., None]) -> None:
            instants, picked = _read(self._whole, now, row, every)
            if instants:
                moved = partial(self._moved, (assembly, image), picked, instants)
                keep(instants, assembly.time[instants], moved)

        if self._stored.wanted:
            look(self.request.every, self._stored.keep)
        if self.stresses.tables:
            look(self.stresses.every, partial(self.stresses.keep, self._places))

    def _keep_rows(self, assembly: Assembly, image: Image, probes: Probes | None, now: slice, rows: slice) -> None:
        """Keep interfaces and series at the instants ``now``, ``rows`` of the image's output."""
        n = now.stop - now.start
        self.rows.keep(image, probes, now.start, n, rows.start)
        if self.stream is not None:
            self.stream.keep(image, probes, now.start, n, rows.start)
        if probes is not None:
            probes.read(assembly, image, now, rows, self._series)

    def _moved(self, of: tuple[Assembly, Image], rows: slice, instants: range, name: str, kind: int) -> Any:
        """Displacements (``kind`` 0) or velocities (1) of a substructure, (n, n_node, 3), at instants that are ``rows``
        of the image's output, else the present one."""
        return node_fields(of, self._whole, (rows, instants), self._places[name], kind)

    def until_fields(self) -> int:
        """Instants from the last kept one to the next whose fields are kept."""
        steps = []
        if self._whole is None:
            if self._stored.wanted:
                steps += [self.request.every]
            if self.stresses.tables:
                steps += [self.stresses.every]
        # more than there are: nothing has to be read between two calls
        many = self.rows.every * len(self.rows.table)
        return min((every - (self.n_kept - 1) % every for every in steps), default=many)

    # -- parts of the histories -------------------------------------------------------------------------------------
    def part(self, first: int, n_fields: int) -> dict[str, Any]:
        """What has been kept from the instant ``first`` and the stored fields ``n_fields`` on, as plain arrays."""
        stream, rows = self.stream, None
        if stream is not None:
            rows = stream.rows(-(-first // stream.every), stream.n_row)
        return {"n_kept": self.n_kept, "rows": _views(self, first), "stream": rows, **self._stored.part(n_fields)}

    def append(self, part: Mapping[str, Any], first: int) -> None:
        """Put a ``part`` from the instant ``first`` on behind what has been kept."""
        self.n_kept = part["n_kept"]
        for name, values in _views(self, first).items():
            values[:] = part["rows"][name]
        if self.stream is not None:
            self.stream.append(part["stream"])
        self._stored.append(part)

    @property
    def n_fields(self) -> int:
        """Instants whose fields have been kept."""
        return len(self._stored.times)

    # -- parts of other processes ---------------------------------------------------------------------------------
    def join(self, part: Part) -> None:
        """Complete what the processes of a run have kept of their own substructures and interfaces."""
        processes, assembly = part.processes, part.whole
        self.rows = joined_rows(self.rows, part)
        numbers = [c for c, owner in enumerate(assembly.owner) if owner == processes.rank]
        energy = self._series["energy"]
        drift = {key: energy.pop(key) for key in ("drift",) if key in energy}
        # others hold zeros for what they do not march: the sum is complete
        for table in (*(self._series[key] for key in (*SERIES, "von_mises")), drift):
            for values in table.values():
                processes.add(values)
        if self._probes is None:
            massless = set()
        else:
            massless = self._probes.massless
        terms: dict[Any, Array] = {}
        # classes of the part have numbers of their own
        for share in processes.collect(
            (dict(zip(numbers, energy.values(), strict=False)), self._stored.fields, massless)
        ):
            terms |= share[0]
            self._stored.fields |= share[1]
            massless.update(share[2])
        self._series["energy"] = dict(sorted(terms.items())) | drift
        self._places = places_in(assembly)

    # -- histories --------------------------------------------------------------------------------------------
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Interface histories over the kept instants."""
        if self._histories[0] != self.n_kept:
            row = self.rows.row(self.n_kept)
            self._histories = self.n_kept, self.rows.histories(row, self.request.peak_duration)
        return self._histories[1]

    def points(self) -> dict[str, PointFields]:
        """Fields of the interfaces at their points over the kept instants."""
        length, histories = self._histories
        if length != self.n_kept:
            return self.rows.fields(self.rows.row(self.n_kept))
        return {name: h.points_over_time for name, h in histories.items()}

    def series(self, kind: str) -> dict[str, Array]:
        """Series of a kind over the kept instants by name."""
        return {name: values[: self.n_kept] for name, values in self._series[kind].items()}

    def sensors(self, assembly: Assembly) -> dict[str, SensorHistory]:
        """Histories of the sensors over the kept instants; names with a dot are those of ports."""
        places = {name: place for name, place in self.request.sensors.items() if "." not in name}
        if self._probes is None:
            massless = set()
        else:
            massless = self._probes.massless
        return sensor_histories(assembly, places, self.series("motion"), massless)

    def reactions(self, assembly: Assembly, ports: bool = False) -> dict[str, ReactionHistory]:
        """Reactions of the supports over the kept instants, or of faces that ``ports`` move, by names with a dot."""
        supports = {name: support for name, support in self.request.supports.items() if ("." in name) is ports}
        return reaction_histories(assembly, supports, self.series("force"))

    def bolt_histories(self) -> dict[str, BoltHistory]:
        """Tensions of the bolts and resultants on sections of their shanks over the kept instants."""
        resultants = self.series("tension")
        histories = {}
        for name, bolt in self.request.bolts.items():
            q = bolt.description.plastic_elongation
            if q is not None:
                q = q[: self.n_kept]
            # side by side: sums have the bits of one series
            force = np.ascontiguousarray(resultants[name][:, 0, 0])
            named = bolt.description.sections
            on_sections = resultants[name] if named is None else resultants[name][:, named.rows]
            shear, moment = on_sections[..., :3], on_sections[..., 3:]
            filled = replace(bolt.description, force=force, plastic_elongation=q)
            histories[name] = replace(filled, section_force=shear, section_moment=moment)
        return histories

    def substructures(self) -> dict[str, SubstructureHistory]:
        """Histories of the substructures for which some output is requested."""
        terms, wanted = self._terms(), self._stored.wanted or self.request.energy
        energies = {name: dict(zip(TERMS, table.T, strict=True)) for name, table in terms.items()}
        if not wanted:
            return {}
        return {name: self._stored.history(name, energies.get(name)) for name in self._info}

    def _terms(self) -> dict[str, Array]:
        """Energies (n_time, terms) of the substructures, J, where requested."""
        if not self.request.energy:
            return {}
        places = self._places.items()
        return {name: self._series["energy"][c][: self.n_kept, :, member] for name, (c, member) in places}

    def assembly_energy(self, assembly: Assembly) -> dict[str, Array] | None:
        """Energies of the assembly (``energy_balance``), each (n_time,), J; None unless requested."""
        if not self.request.energy:
            return None
        drift = self._series["energy"]["drift"][: self.n_kept]
        return energy_balance(assembly, list(self._terms().values()), drift, _interface_series(self, assembly))


def small(assembly: Assembly) -> bool:
    """Whether the nodes of an assembly are so few that the image may keep them all."""
    return sum(nodes_of(p.members[0]).shape[0] * len(p.members) for p in assembly.propagators) <= _SMALL


def node_fields(
    of: tuple[Assembly, Image], whole: Probes | None, at: tuple[slice, range], place: tuple[int, int], kind: int
) -> Any:
    """Displacements (``kind`` 0) or velocities (1) (n, n_node, 3) of the member of a class at a ``place``: by the
    probes of all nodes, at the rows and instants ``at``, else of the present state."""
    c, member = place
    if whole is not None:
        return whole.fields(of[1], c, member, kind, *at)
    return [(full_displacement, full_velocity)[kind](of[0].propagators[c], member)]


def _views(recorder: Recorder, first: int) -> dict[str, Array]:
    """What is kept in memory from the instant ``first`` on, time first, by name."""
    views = {
        f"{kind} {key}": values[first : recorder.n_kept]
        for kind, table in recorder._series.items()
        for key, values in table.items()
    }
    return views | {"interfaces": recorder.rows.table[recorder.rows.row(first) : recorder.rows.row(recorder.n_kept)]}


def _interface_series(recorder: Recorder, assembly: Assembly) -> list[dict[str, Array]]:
    """``energy_series`` of every interface over the kept instants; block by block where they are in a file."""
    weights, offset = assembly.scheme.traction_weights(), assembly.scheme.gap_offset(assembly.dt)

    def of(histories: Mapping[str, InterfaceHistory], start: int) -> list[dict[str, Array]]:
        against = assembly.ground.velocity
        energies = [energy_series(h, weights, offset, i in against) for i, h in enumerate(histories.values())]
        return [{key: values[start:] for key, values in series.items()} for series in energies]

    if recorder.stream is None:
        return of(recorder.interfaces(), 0)
    # the weights of a step take the instant before it
    parts = [of(histories, 2 if first else 0) for first, _, histories in recorder.stream.blocks(overlap=2)]
    return [
        {key: np.concatenate([part[i][key] for part in parts]) for key in series} for i, series in enumerate(parts[0])
    ]


def places_in(assembly: Assembly) -> dict[str, tuple[int, int]]:
    """Class and member of every substructure."""
    return {name: (c, m) for c, p in enumerate(assembly.propagators) for m, name in enumerate(p.names)}


# -- energies ---------------------------------------------------------------------------------------------------
def energy_balance(
    assembly: Assembly, tables: Sequence[Array], drift: Array, series: Sequence[Mapping[str, Array]]
) -> dict[str, Array]:
    """Sums over the substructures, dissipation of the interfaces, balance, each (n_time,), J.

    balance = change of (kinetic + elastic + prestress) + damping + landing + scheme - work of loads - interface work.
    The interface work is - friction - contact dissipation + ground work - joint dissipation - change of layer energy
    + drift work, but for the different weights of the instants in these terms (friction takes the end of each
    instant, so that it never decreases) and for the normal part of the drift work, which is a part of the contact
    dissipation too. The drift work is what the iteration, which stops at a tolerance, does against the laws.

    tables : (n_time, terms) of the substructures. drift : (n_time,) drift work. series : ``energy_series`` of every
    interface.
    """
    n, dt = len(drift), assembly.dt
    total = {t: sum((table[:, j] for table in tables), np.zeros(n)) for j, t in enumerate(TERMS)}
    total["friction_dissipation"] = np.zeros(n)
    for power in (s["friction_power"] for s in series if "friction_power" in s):
        # end of the instant, not a mean of the weights: friction never gives energy back
        total["friction_dissipation"][1:] += np.cumsum(power[1:]) * dt
    total["contact_dissipation"] = sum((_running(s["loss"][1:]) for s in series if "loss" in s), np.zeros(n))
    total["drift_work"] = drift.copy()
    if layers := [s["layer_energy"] for s in series if "layer_energy" in s]:
        total["layer_energy"] = np.sum(layers, axis=0)
    if joints := [s["joint_power"] for s in series if "joint_power" in s]:
        power = np.sum(joints, axis=0)
        # trapezoid rule
        total["joint_dissipation"] = _running(0.5 * dt * (power[1:] + power[:-1]))
    ground = assembly.ground
    if any(g.any() for g in ground.velocity.values()):
        weights = assembly.scheme.traction_weights()
        works = [ground_work(series[i]["force"], ground.travel[i][:n], weights) for i in ground.velocity]
        total["ground_work"] = sum(works, np.zeros(n))
    stored = stored_energy(total)
    # each term is computed on its own: 0 up to round-off
    total["balance"] = (
        stored
        - stored[0]
        + total["damping_dissipation"]
        + total["landing_dissipation"]
        + total["scheme_dissipation"]
        - total["work_of_loads"]
        - total["interface_work"]
    )
    return total


def energy_series(
    history: InterfaceHistory, weights: tuple[float, float, float], offset: float, force: bool
) -> dict[str, Array]:
    """What the energies of an interface follow from, one row an instant: ``friction_power``, ``joint_power`` (W),
    ``layer_energy``, ``loss`` of the step that ends there (J), as far as there are any; ``force`` (N) on request.

    offset : time from the instants to the displacements that give the gaps, s.
    """
    names = ("friction_power", "layer_energy", "joint_power")
    series = {name: values for name in names if (values := getattr(history, name)) is not None}
    if history.gap is not None and history.layer_energy is None:
        series["loss"] = np.concatenate([[0.0], _impact_losses(history, history.gap, weights, offset)])
    if force:
        series["force"] = history.force()
    return series


def _impact_losses(history: InterfaceHistory, gap: Array, weights: tuple[float, float, float], offset: float) -> Array:
    """Energy (n_time - 1,) that each step loses to the normal contact law, J: - sum of pressure x change of gap.

    A point that stays closed loses nothing. A point that closes loses the energy that the end-of-instant law
    dissipates: the kinetic energy of the layer of elements that meets the other side, which goes to zero under
    refinement.
    """
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
    if offset:
        opening = history.velocity[:, 1] - history.velocity[:, 0]
        gap = gap - offset * np.einsum("tpc,pc->tp", opening, history.normals)
    power = -_weighted(pressure, weights) * np.diff(gap, axis=0)
    steps: Array = power @ history.areas
    return steps


def ground_work(force: Array, path: Array, weights: tuple[float, float, float]) -> Array:
    """Work (n_time,) that a moving ground does on side E since the start, J.

    force : (n_time, 3) of the ground, N. path : (n_time, 3) its travel, m.
    """
    return _running(np.einsum("tc,tc->t", _weighted(force, weights), np.diff(path, axis=0)))


def _weighted(values: Array, weights: tuple[float, float, float]) -> Array:
    """Weighted values of each step, (n_time - 1, ...); the first step takes its start for the instant before."""
    # instants n - 1 of steps n to n + 1
    before = np.concatenate([values[:1], values[:-2]])
    combined: Array = weights[0] * before + weights[1] * values[:-1] + weights[2] * values[1:]
    return combined


def _running(steps: Array) -> Array:
    """Running sums (n_time,) of values per step, 0 at the start."""
    return np.concatenate([[0.0], np.cumsum(steps)])
