"""Keeps the accepted fields of a run; at its end histories of interfaces and substructures, and the energies.

Interface energies follow from the histories of the interfaces. Works over a step use the time scheme's weights of the
instants n-1, n, n+1, as the energy balances of the substructures do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, BinaryIO, Final

import numpy as np

from ..kernels.energy_parts import TERMS
from ..propagator.image import Image
from .assembly import Array, Assembly
from .interface_rows import InterfaceRows, InterfaceStream
from .outcome import BoltHistory, InterfaceHistory, PointFields, ReactionHistory, SensorHistory, SubstructureHistory
from .part import Part
from .probes import BoltPlace, Probes, SensorPlace, nodes_of
from .reactions import Support, reaction_histories

_SMALL: Final = 2000  # dofs of all nodes up to which the kernels keep the fields of many instants


@dataclass(frozen=True)
class OutputRequest:
    """What to keep: displacement and velocity fields, mean stress, energies; fields every ``every`` instants; the
    motion of sensors, the reactions of supports and the tensions of bolts at every instant.

    interfaces_every : the histories of interfaces at every so many instants (``Recorder``).
    peak_duration : of the mean whose largest value is the peak force, s; None for a share of the contact.
    """

    fields: bool = False
    stress: bool = False
    energy: bool = False
    every: int = 1
    sensors: Mapping[str, SensorPlace] = field(default_factory=dict)
    peak_duration: float | None = None
    interfaces_every: int = 1
    supports: Mapping[str, Support] = field(default_factory=dict)
    bolts: Mapping[str, BoltPlace] = field(default_factory=dict)


@dataclass(frozen=True)
class SubstructureInfo:
    """Mesh of a substructure for the results, and its stress recovery (displacements (n_node, 3) -> (n_cell, 6),
    None where no stress is requested)."""

    nodes: Array
    cells: np.ndarray
    cell_type: str
    stress: Callable[[Array], Array] | None


class Recorder:
    """Histories of interfaces (always) and substructures (as requested).

    thinned : those of interfaces are kept at every so many instants; the energies need them at every one. file : where
    those of interfaces go at ``thinned`` instants when ``in_memory`` holds fewer.
    """

    rows_before = 0
    """Rows of the image's output that a call of the kernels leaves in front of those of its instants."""

    def __init__(
        self,
        assembly: Assembly,
        request: OutputRequest,
        substructures: dict[str, SubstructureInfo],
        thinned: int = 1,
        file: BinaryIO | None = None,
        in_memory: int = 1,
    ) -> None:
        self._request, self._info = request, substructures
        self._stores = request.fields or request.stress
        n_time = len(assembly.time)
        every = thinned if file is None else in_memory
        table = np.zeros((len(range(0, n_time, every)), InterfaceRows.width_of(assembly)))
        self.rows = InterfaceRows(assembly, table, every)
        self.stream = None if file is None else InterfaceStream(assembly, file, thinned, request.peak_duration)
        self._places = {name: (c, m) for c, p in enumerate(assembly.propagators) for m, name in enumerate(p.names)}
        self._fields: dict[str, dict[str, list[Array]]] = {name: {} for name in self._places}
        self._field_times: list[float] = []
        self._energy = [np.zeros((n_time * request.energy, len(TERMS), len(p.members))) for p in assembly.propagators]
        self._drift_work = np.zeros(n_time * request.energy)
        self._motions = {name: np.zeros((n_time, 3, 3)) for name in request.sensors}
        self._forces = {name: np.zeros((n_time, 2, 3)) for name in request.supports}
        self._tensions = {name: np.zeros(n_time) for name in request.bolts}
        self._histories: tuple[int, dict[str, InterfaceHistory]] = -1, {}  # of so many instants
        self._probes: Probes | None = None
        self.n_kept = 0
        """Instants kept so far, t = 0 included."""

    @property
    def sliding(self) -> list[int]:
        """Interfaces whose tangential velocities come from the substructures."""
        return sorted(self.rows.slide)

    def probes(self, assembly: Assembly, fields: bool) -> Probes | None:
        """What an image keeps of the substructures for this recorder beside their energies, None where that is nothing;
        ``fields`` : those that are stored, too, where the substructures are small."""
        request = self._request
        whole = fields and self._stores
        whole = whole and sum(nodes_of(p.members[0]).shape[0] * len(p.members) for p in assembly.propagators) <= _SMALL
        if not (whole or self.rows.slide or request.sensors or request.supports or request.bolts):
            return None
        return Probes(assembly, self.sliding, request.sensors, request.supports, request.bolts, whole)

    @property
    def places(self) -> Mapping[str, SensorPlace]:
        """Places of the sensors."""
        return self._request.sensors

    @property
    def supports(self) -> Mapping[str, Support]:
        """Supports whose reactions are kept."""
        return self._request.supports

    @property
    def bolts(self) -> Mapping[str, BoltPlace]:
        """Bolts whose tensions are kept."""
        return self._request.bolts

    def keep(self, assembly: Assembly, image: Image, probes: Probes | None, n: int, row: int = 0) -> None:
        """Keep the next n instants, rows of the image's output from ``row`` on; the first ones are t = 0."""
        rows, now = slice(row, row + n), slice(self.n_kept, self.n_kept + n)
        self.rows.keep(image, probes, self.n_kept, n, row)
        if self.stream is not None:
            self.stream.keep(image, probes, self.n_kept, n, row)
        if probes is not None:
            probes.read(assembly, image, now, rows, self._motions, self._forces, self._tensions)
        self._probes = probes
        if self._request.energy:
            for c, kept in enumerate(self._energy):
                kept[now] = image.output(c, "energies", len(TERMS))[rows]
            self._drift_work[now] = image.field("history_works", image.rows)[rows]
        self.n_kept += n
        if self._stores:
            self._keep_fields(assembly, image, now, row)

    def until_fields(self) -> int:
        """Instants from the last kept one to the next whose fields are kept."""
        if self._stores and not (self._probes is not None and self._probes.whole):
            return self._request.every - (self.n_kept - 1) % self._request.every
        return self.rows.every * len(self.rows.table)

    def _keep_fields(self, assembly: Assembly, image: Image, now: slice, row: int) -> None:
        """Keep the requested fields at those of the instants ``now`` that are to be kept: from the rows of the image's
        output from ``row`` on, else of the present state, that of the last of them."""
        every, whole = self._request.every, self._probes if self._probes is not None and self._probes.whole else None
        first = now.stop - 1 if whole is None else now.start
        instants = range(-(-first // every) * every, now.stop, every)
        if not instants:
            return
        self._field_times += assembly.time[instants].tolist()
        rows = slice(row + instants[0] - now.start, row + now.stop - now.start, every)
        for name, (c, member) in self._places.items():
            propagator, kept = assembly.propagators[c], self._fields[name]
            if whole is None:
                motion: list[Any] = [[propagator.full_displacement(member)], [propagator.full_velocity(member)]]
            else:
                motion = [whole.fields(image, c, member, kind, rows, instants) for kind in (0, 1)]
            if self._request.fields:
                kept.setdefault("displacement", []).extend(motion[0])
                kept.setdefault("velocity", []).extend(motion[1])
            recover = self._info[name].stress
            if self._request.stress and recover is not None:
                kept.setdefault("stress", []).extend(map(recover, motion[0]))

    # -- parts of the histories -------------------------------------------------------------------------------------
    def _views(self, first: int) -> dict[str, Array]:
        """What is kept in memory from the instant ``first`` on, time first, by name."""
        energy: dict[Any, Array] = {}
        if self._request.energy:
            energy = {**dict(enumerate(self._energy)), "drift": self._drift_work}
        tables: dict[str, Mapping[Any, Array]] = {
            "motion": self._motions,
            "force": self._forces,
            "tension": self._tensions,
            "energy": energy,
        }
        views = {
            f"{name} {key}": values[first : self.n_kept]
            for name, table in tables.items()
            for key, values in table.items()
        }
        return views | {"interfaces": self.rows.table[self.rows.row(first) : self.rows.row(self.n_kept)]}

    def part(self, first: int, n_fields: int) -> dict[str, Any]:
        """What has been kept from the instant ``first`` and the stored fields ``n_fields`` on, as plain arrays."""
        return {
            "n_kept": self.n_kept,
            "rows": self._views(first),
            "stream": None if self.stream is None else self.stream.rows(self._streamed(first), self.stream.n_row),
            "times": np.array(self._field_times[n_fields:]),
            "fields": {
                name: {key: np.array(values[n_fields:]) for key, values in fields.items()}
                for name, fields in self._fields.items()
            },
        }

    def append(self, part: Mapping[str, Any], first: int) -> None:
        """Put a ``part`` from the instant ``first`` on behind what has been kept."""
        self.n_kept = part["n_kept"]
        for name, values in self._views(first).items():
            values[:] = part["rows"][name]
        if self.stream is not None:
            self.stream.append(part["stream"])
        self._field_times += part["times"].tolist()
        for name, fields in part["fields"].items():
            for key, values in fields.items():
                self._fields[name].setdefault(key, []).extend(values)

    def _streamed(self, instant: int) -> int:
        """Row of the stream of the first instant from ``instant`` on."""
        return 0 if self.stream is None else -(-instant // self.stream.every)

    @property
    def n_fields(self) -> int:
        """Instants whose fields have been kept."""
        return len(self._field_times)

    # -- parts of other processes ---------------------------------------------------------------------------------
    def join(self, part: Part) -> None:
        """Complete what the processes of a run have kept of their own substructures and interfaces."""
        processes, assembly = part.processes, part.whole
        self._join_rows(part)
        for table in (self._motions, self._forces, self._tensions, {"drift": self._drift_work}):
            for values in table.values():
                processes.add(values)
        own = [c for c, owner in enumerate(assembly.owner) if owner == processes.rank]
        energy: dict[int, Array] = {}
        for kept in processes.collect((dict(zip(own, self._energy, strict=True)), self._fields, self._massless())):
            energy |= kept[0]
            self._fields |= kept[1]
            self._massless().update(kept[2])
        self._energy = [energy[c] for c in range(len(assembly.propagators))]
        self._places = {name: (c, m) for c, p in enumerate(assembly.propagators) for m, name in enumerate(p.names)}

    def _join_rows(self, part: Part) -> None:
        """Rows of all interfaces. Tractions, velocities and gaps are those of the owner of an interface, what slides
        along a side has the process of the side."""
        processes, n_row = part.processes, len(self.rows.table)
        width, wide = InterfaceRows.width_of(part.assembly), InterfaceRows.width_of(part.whole)
        here, there = (
            InterfaceRows(a, np.arange(float(n))[None]) for a, n in ((part.assembly, width), (part.whole, wide))
        )
        own, into = [np.zeros(0)], [np.zeros(0)]
        for number, i in enumerate(part.interfaces):
            owned = number < part.n_owned
            if owned:
                own += here.columns(number)
                into += there.columns(i)
            for side, process in enumerate(part.sides[i] if i in there.slide else ()):
                if process == part.rank or (process < 0 and owned):
                    own.append(here.slide[number][0, side].ravel())
                    into.append(there.slide[i][0, side].ravel())
        picked = np.concatenate(own).astype(np.int64)
        columns = processes.collect(np.concatenate(into).astype(np.int64))
        ends = np.cumsum([0, *(n_row * len(c) for c in columns)]).tolist()
        every = processes.gather(self.rows.table[:, picked].ravel(), ends)
        table = np.zeros((n_row, wide))
        for c, first, last in zip(columns, ends, ends[1:], strict=False):
            table[:, c] = every[first:last].reshape(n_row, -1)
        self.rows = InterfaceRows(part.whole, table, self.rows.every)

    def _massless(self) -> set[str]:
        return set() if self._probes is None else self._probes.sensors.massless

    # -- histories --------------------------------------------------------------------------------------------
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Interface histories over the kept instants."""
        if self._histories[0] != self.n_kept:
            row = self.rows.row(self.n_kept)
            self._histories = self.n_kept, self.rows.histories(row, self._request.peak_duration)
        return self._histories[1]

    def points(self) -> dict[str, PointFields]:
        """Fields of the interfaces at their points over the kept instants."""
        known, histories = self._histories
        if known != self.n_kept:
            return self.rows.fields(self.rows.row(self.n_kept))
        return {name: h.points_over_time for name, h in histories.items()}

    def sensors(self, assembly: Assembly) -> dict[str, SensorHistory]:
        """Histories of the sensors over the kept instants."""
        return self._measured(assembly, ports=False)

    def port_motions(self, assembly: Assembly) -> dict[str, SensorHistory]:
        """Measured motions of ports over the kept instants; their names have a dot, which those of sensors have not."""
        return self._measured(assembly, ports=True)

    def _measured(self, assembly: Assembly, ports: bool) -> dict[str, SensorHistory]:
        places = {name: place for name, place in self.places.items() if ("." in name) is ports}
        kept = {name: self._motions[name][: self.n_kept] for name in places}
        return {} if self._probes is None else self._probes.sensors.histories(assembly, places, kept)

    def reactions(self, assembly: Assembly) -> dict[str, ReactionHistory]:
        """Reactions of the supports over the kept instants."""
        return self._reactions(assembly, ports=False)

    def port_reactions(self, assembly: Assembly) -> dict[str, ReactionHistory]:
        """Reactions of the faces that ports move over the kept instants; names as for ``port_motions``."""
        return self._reactions(assembly, ports=True)

    def _reactions(self, assembly: Assembly, ports: bool) -> dict[str, ReactionHistory]:
        supports = {name: support for name, support in self.supports.items() if ("." in name) is ports}
        kept = {name: self._forces[name][: self.n_kept] for name in supports}
        return reaction_histories(assembly, supports, kept) if kept else {}

    def bolt_histories(self) -> dict[str, BoltHistory]:
        """Tensions of the bolts over the kept instants."""
        return {
            name: replace(bolt.description, force=self._tensions[name][: self.n_kept])
            for name, bolt in self.bolts.items()
        }

    def substructures(self) -> dict[str, SubstructureHistory]:
        """Histories of the substructures for which some output is requested."""
        if not (self._stores or self._request.energy):
            return {}
        time = np.array(self._field_times)
        histories = {}
        for name, info in self._info.items():
            fields = {key: np.stack(values) for key, values in self._fields[name].items()}
            energy = None
            if self._request.energy:
                energy = dict(zip(TERMS, self._energy_terms(name).T, strict=True))
            histories[name] = SubstructureHistory(
                name,
                info.nodes,
                info.cells,
                info.cell_type,
                time,
                fields.get("displacement"),
                fields.get("velocity"),
                fields.get("stress"),
                energy,
            )
        return histories

    def _energy_terms(self, name: str) -> Array:
        """Terms (n_time, terms) of a substructure, J."""
        c, member = self._places[name]
        return self._energy[c][: self.n_kept, :, member]

    def assembly_energy(self, assembly: Assembly) -> dict[str, Array] | None:
        """Sums over the substructures, dissipation of the interfaces, balance; None unless requested.

        balance = change of (kinetic + elastic) + damping + landing + scheme - work of loads - interface work. The
        interface work is - friction - contact dissipation + ground work - joint dissipation - change of layer energy
        + drift work, but for the different weights of the instants in these terms (friction takes the end of each
        instant, so that it never decreases) and for the normal part of the drift work, which is a part of the contact
        dissipation too. The drift work is what the iteration, which stops at a tolerance, does against the laws.
        """
        if not self._request.energy:
            return None
        n = self.n_kept
        tables = [self._energy_terms(name) for name in self._places]
        total = {t: sum((table[:, j] for table in tables), np.zeros(n)) for j, t in enumerate(TERMS)}
        series, dt = self._series(assembly), assembly.dt
        total["friction_dissipation"] = np.zeros(n)
        for power in (s["friction_power"] for s in series if "friction_power" in s):
            total["friction_dissipation"][1:] += np.cumsum(power[1:]) * dt
        total["contact_dissipation"] = sum((_running(s["loss"][1:]) for s in series if "loss" in s), np.zeros(n))
        total["drift_work"] = self._drift_work[:n].copy()
        if layers := [s["layer_energy"] for s in series if "layer_energy" in s]:
            total["layer_energy"] = np.sum(layers, axis=0)
        if joints := [s["joint_power"] for s in series if "joint_power" in s]:
            power = np.sum(joints, axis=0)
            total["joint_dissipation"] = _running(0.5 * dt * (power[1:] + power[:-1]))
        if any(g.any() for g in assembly.ground.values()):
            weights = assembly.scheme.traction_weights()
            works = [ground_work(series[i]["force"], assembly.ground_path(i)[:n], weights) for i in assembly.ground]
            total["ground_work"] = sum(works, np.zeros(n))
        stored = total["kinetic"] + total["elastic"]
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

    def _series(self, assembly: Assembly) -> list[dict[str, Array]]:
        """``energy_series`` of every interface over the kept instants; block by block where they are in a file."""
        weights, offset = assembly.scheme.traction_weights(), assembly.scheme.gap_offset(assembly.dt)

        def of(histories: Mapping[str, InterfaceHistory], known: int) -> list[dict[str, Array]]:
            made = [energy_series(h, weights, offset, i in assembly.ground) for i, h in enumerate(histories.values())]
            return [{key: values[known:] for key, values in series.items()} for series in made]

        if self.stream is None:
            return of(self.interfaces(), 0)
        # the weights of a step take the instant before it
        parts = [of(histories, 2 if first else 0) for first, _, histories in self.stream.blocks(overlap=2)]
        return [
            {key: np.concatenate([part[i][key] for part in parts]) for key in series}
            for i, series in enumerate(parts[0])
        ]


# -- energies of interfaces -------------------------------------------------------------------------------------
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
    return series | ({"force": history.force()} if force else {})


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
    before = np.concatenate([values[:1], values[:-2]])
    combined: Array = weights[0] * before + weights[1] * values[:-1] + weights[2] * values[1:]
    return combined


def _running(steps: Array) -> Array:
    """Running sums (n_time,) of values per step, 0 at the start."""
    return np.concatenate([[0.0], np.cumsum(steps)])
