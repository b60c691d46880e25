"""Outputs of a run by communication steps: their matrix over the signals of an instant (``kernels.communication``).

The outputs of an interface are determined from ``InterfaceSeries`` by unit fields, so that its formulas are written
once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..assembly.supports import port_key
from ..latin.interface_rows import NO_CONTACT, InterfaceRows
from ..latin.outcome import Array, PointFields
from ..latin.probes import Probes
from ..latin.recorder import Recorder
from ..scene.ports import COMPONENTS
from ..scene.schema import Scene
from .drives import Drives
from .outputs import COLUMNS, InterfaceSeries
from .variables import scalar_table

_POINTS = 32  # points whose unit fields are read at a time


def _apart(values: Any) -> Any:
    """Fields (n, n_point, ...) of all points as fields (n n_point, n_point, ...) of one point each."""
    n, n_point = values.shape[:2]
    apart = np.zeros((n, n_point, *values.shape[1:]), values.dtype)
    each = np.arange(n_point)
    apart[:, each, each] = values
    return apart.reshape(n * n_point, *values.shape[1:])


class SignalPlaces:
    """Places of the signals of an assembly."""

    def __init__(self, drives: Drives, recorder: Recorder) -> None:
        self._drives, assembly = drives, drives.assembly
        self._assembly, self._request = assembly, recorder.request
        self.probes = Probes(assembly, recorder.sliding, self._request)
        n = assembly.layout.n_flat
        at = 2 * n + sum(g.n_point for g in assembly.layout.groups)
        self._sensed: list[int] = []
        self._probed: list[int] = []
        self._n_sensor: list[int] = []
        self._motions: list[int] = []
        of_motion = 0
        for c, propagator in enumerate(assembly.propagators):
            m, rows, slides = len(propagator.members), self.probes.rows[c], self.probes.slide.rows[c]
            self._n_sensor.append(0 if rows is None else rows.shape[0])
            self._sensed.append(at)
            self._probed.append(at + 3 * self._n_sensor[-1] * m)
            at = self._probed[-1] + (0 if slides is None else slides.shape[0] * m)
            self._motions.append(of_motion)
            of_motion += 3 * propagator.members[0].imposed_pattern.shape[1] * m
        self._drive = at
        self.n = at + drives.n_state + 2 * len(drives.sources) + 1

    def _sensor(self, c: int, kind: int, row: int, member: int) -> int:
        """Place of the displacement, velocity or acceleration of a sensor row of a class."""
        m = len(self._assembly.propagators[c].members)
        return int(self._sensed[c] + (kind * self._n_sensor[c] + row) * m + member)

    def _motion(self, c: int, kind: int, k: int, member: int) -> int:
        """Place of the displacement, velocity or acceleration of a prescribed motion."""
        members = self._assembly.propagators[c].members
        row = kind * members[0].imposed_pattern.shape[1] + k
        return int(self._drive + self._motions[c] + row * len(members) + member)

    def _source(self, name: str) -> int | None:
        """Place of the amplitude of a source at the instant; None for a load that is constant."""
        names = (*self._drives.sources.inputs, *self._drives.sources.laws)
        first = self._drive + self._drives.n_state + len(names)
        return first + names.index(name) if name in names else None

    def _add_load(self, rows: Any, row: int, name: str, amplitude: Array, share: float) -> None:
        """Add ``share`` times the amplitude of a load, a signal where it varies."""
        source = self._source(name)
        rows[row, self.n - 1 if source is None else source] += share * (amplitude[0] if source is None else 1.0)

    def _add_motions(self, rows: Any, row: int, of: tuple[int, int, int], shapes: Array) -> None:
        """Add what prescribed motions of a class and member add, by ``shapes`` (n_motion,); ``of``: class, 0 for their
        displacements, 1 for velocities, 2 for accelerations, member."""
        c, kind, member = of
        for k in np.flatnonzero(shapes):
            rows[row, self._motion(c, kind, int(k), member)] += shapes[k]


class Signals(SignalPlaces):
    """The outputs of an assembly that follow from its signals."""

    def _kept(self) -> sp.csr_array:
        """Numbers of a row of ``InterfaceRows`` from the signals."""
        layout, n = self._assembly.layout, self._assembly.layout.n_flat
        width = InterfaceRows.width_of(self._assembly)
        table = InterfaceRows(self._assembly, np.arange(float(width))[None])
        cells: list[tuple[int, int, float]] = [(j, j, 1.0) for j in range(2 * n)]
        first = 2 * n
        for g, group in enumerate(layout.groups):
            if g in table.gaps:
                cells += [(int(to), first + p, 1.0) for p, to in enumerate(table.gaps[g][0])]
            first += group.n_point
        slide = self.probes.slide
        for c, member, rows, i, side in slide.places:
            to = table.slide[i][0, side].ravel().astype(int)
            m, trace = len(self._assembly.propagators[c].members), slide.traces[c]
            for row, place in zip(range(rows.start, rows.stop), to, strict=True):
                cells.append((int(place), self._probed[c] + row * m + member, 1.0))
            if self._assembly.propagators[c].forcing.moves and trace is not None:
                moved = sp.csr_array(trace[rows]) @ self._assembly.propagators[c].members[member].imposed_pattern
                for own, k in np.argwhere(moved):
                    cells.append((int(to[own]), self._motion(c, 1, int(k), member), float(moved[own, k])))
        where = np.array([*cells, *self._ground_entries(table)]).reshape(-1, 3)
        places = where[:, 0].astype(np.int64), where[:, 1].astype(np.int64)
        return sp.csr_array(sp.coo_array((where[:, 2], places), shape=(width, self.n)))

    def _ground_entries(self, table: InterfaceRows) -> list[tuple[int, int, float]]:
        """Velocities of the ground at the points of frictionless interfaces."""
        made: list[tuple[int, int, float]] = []
        drives, n_x, n_s = self._drives, self._drives.n_state, len(self._drives.sources)
        for e in range(2 * n_s if self.probes.slide.ground else 0):
            amplitudes = np.zeros(2 * n_s)
            amplitudes[e] = 1.0
            drives.begin(amplitudes.reshape(2, n_s))
            for i, velocity in drives.slides().items():
                if i in self.probes.slide.ground and velocity.any():
                    to = table.slide[i][0, 1].astype(int)
                    made += [(int(row[k]), self._drive + n_x + e, float(velocity[k])) for row in to for k in range(3)]
        return made

    def _interface_rows(self, i: int, kept: sp.csr_array) -> tuple[sp.csr_array, list[int]]:
        """Outputs of an interface from the signals, and the numbers of columns of its parts."""
        assembly, width = self._assembly, kept.shape[0]
        own, geometry = self._unknowns(i, width), assembly.interfaces[i].geometry
        faces = (geometry.areas, geometry.areas / geometry.areas.sum(), geometry.frames[:, 0])
        every = self._unit_fields(i, width)
        blocks, sizes, order = [], list[int](), list[Any]()
        for start in range(0, geometry.n_point, _POINTS):
            some = slice(start, start + _POINTS)
            fields = PointFields(
                _apart(every.traction[:, some]),
                _apart(every.velocity.transpose(0, 2, 1, 3)[:, some]).transpose(0, 2, 1, 3),
                None if every.gap is None else _apart(every.gap[:, some]),
                None if every.contact_status is None else _apart(every.contact_status[:, some]),
            )
            columns = InterfaceSeries.of(fields, *(values[some] for values in faces)).columns(
                np.zeros((len(fields.traction), 3))
            )
            sizes = [column.shape[1] for column in columns]
            if len(columns) > 6:  # read point by point
                columns[7][:], columns[8][:] = 0.0, 0.0
            blocks.append(sp.csr_array(np.concatenate(columns, axis=1)))
            order.append(own[:, some].ravel())
        picked = sp.csr_array(sp.csc_array(sp.vstack(blocks)).T)
        return sp.csr_array(picked @ kept[np.concatenate(order)]), sizes

    def _unit_fields(self, i: int, width: int) -> PointFields:
        """Fields of an interface whose points all have one of their unknowns 1, (n_unknown, ...): a point depends on
        its own unknowns alone."""
        own = self._unknowns(i, width)
        rows = np.zeros((len(own), width))
        for row, unknowns in zip(rows, own, strict=True):
            row[unknowns] = 1.0
        return InterfaceRows(self._assembly, rows).fields_of(i, len(rows))

    def _shear_rows(self, i: int) -> sp.csr_array:
        """Tangential resultant (3, n) of an interface on its first side."""
        geometry, channels = self._assembly.interfaces[i].geometry, self._assembly.layout.channels(i, 0)
        rows = sp.lil_array((3, self.n))
        for k in range(1, channels.shape[1]):
            for axis in range(3):
                rows[axis, channels[:, k]] = geometry.areas * geometry.frames[:, k, axis]
        return sp.csr_array(rows)

    def _point_fields(self, kept: sp.csr_array) -> dict[str, Any]:
        """Fields of the record of the run: what describes the points of the interfaces, one interface after the other:
        traction (n_point, 3), velocity (2, n_point, 3), where there is a gap that and contact state (n_point,)."""
        blocks, at = [sp.csr_array((0, self.n))], 0
        status = np.full(len(self._assembly.interfaces), -1, dtype=np.int64)
        for i, unit in enumerate(self._assembly.interfaces):
            n = unit.geometry.n_point
            own, fields = self._unknowns(i, kept.shape[0]), self._unit_fields(i, kept.shape[0])
            parts = [fields.traction.reshape(-1, 1, n, 3), fields.velocity]
            parts += [] if fields.gap is None else [fields.gap.reshape(-1, 1, n, 1)]
            for values in parts:
                unknown, side, p, axis = np.nonzero(values)
                size = int(np.prod(values.shape[1:]))
                to = (side * n + p) * values.shape[3] + axis
                entries = values[unknown, side, p, axis], (to, own[unknown, p])
                blocks.append(sp.csr_array(sp.coo_array(entries, shape=(size, kept.shape[0]))) @ kept)
                at += size
            if fields.gap is not None:
                blocks.append(sp.csr_array((n, self.n)))
                status[i] = at
                at += n
        return {"field": sp.csr_array(sp.vstack(blocks)), "status_place": status}

    def _unknowns(self, i: int, width: int) -> Any:
        """Numbers in a row of ``InterfaceRows`` of the unknowns of an interface, (n_unknown, n_point)."""
        layout, group = self._assembly.layout, self._assembly.layout.group(i)
        table = InterfaceRows(self._assembly, np.arange(float(width))[None])
        flat = [layout.channels(i, side) for side in (0, 1)]
        parts: list[Any] = [flat[0].T, *((f + layout.n_flat).T for f in flat)]
        parts += [table.gaps[g][:, group.members[i]] for g in table.gaps if layout.groups[g] is group]
        parts += [table.slide[i][0].transpose(0, 2, 1).reshape(6, -1)] if i in table.slide else []
        return np.concatenate(parts).astype(np.int64)

    def _motion_rows(self, name: str) -> sp.csr_array:
        """Displacement and velocity of a sensor, or of a port (6, n)."""
        place, rows = self.probes.places["motion"][name], sp.lil_array((6, self.n))
        c, member = place.number, place.member
        for kind in range(2):
            for axis, row in enumerate(range(place.part.start, place.part.stop)):
                rows[3 * kind + axis, self._sensor(c, kind, row, member)] = 1.0
                self._add_motions(rows, 3 * kind + axis, (c, kind, member), place.shapes[axis])
        return sp.csr_array(rows)

    def _port_rows(self, scene: Scene) -> Iterator[sp.csr_array]:
        """Outputs of the ports, in the order of ``variables.scalar_table``."""
        for name, port in scene.port.items():
            chosen, keys = [COMPONENTS.index(c) for c in port.components], [port_key(name)]
            keys += [port_key(name, turned=True)] if port.rotates else []
            if port.causality == "motion_in":
                yield -sp.csr_array(sp.vstack([self._reaction_rows(key) for key in keys]))[chosen]
                continue
            measured = [self._motion_rows(key) for key in keys]
            yield from measured
            if port.causality == "wave":
                incident = sp.lil_array((len(chosen), self.n))
                for row, source in enumerate(port.inputs(name)):
                    place = self._source(source)
                    assert place is not None
                    incident[row, place] = 1.0
                speed = sp.csr_array(sp.vstack([rows[3:] for rows in measured]))[chosen]
                braked = sp.csr_array(sp.diags_array(np.asarray(port.impedance)) @ speed)
                yield sp.csr_array(incident) - braked
                yield 2.0 * braked - sp.csr_array(incident)

    def _reaction_rows(self, name: str) -> sp.csr_array:
        """Reaction (3, n) of a moved face (``latin.probes``)."""
        place, support = self.probes.places["force"][name], self._request.supports[name]
        c, member, forcing = place.number, place.member, self._assembly.propagators[place.number].forcing
        rows, first = sp.lil_array((3, self.n)), place.part.start
        for axis in range(3):
            for kind in range(3):
                rows[axis, self._sensor(c, kind, first + 3 * kind + axis, member)] = 1.0
                self._add_motions(rows, axis, (c, kind, member), place.shapes[3 * kind + axis])
            terms = zip(forcing.members[member].loads, forcing.amplitudes[member], support.loads, strict=True)
            for load, amplitude, resultant in terms:
                self._add_load(rows, axis, load.name, amplitude, -resultant[axis])
            for channel, area in zip(self._assembly.channels[c][:, member], support.spread[:, axis], strict=True):
                rows[axis, int(channel)] -= area
        return sp.csr_array(rows)

    def _bolt_rows(self) -> Iterator[sp.csr_array]:
        """Tension of each bolt (1, n)."""
        for name, bolt in self._request.bolts.items():
            place, rows = self.probes.places["tension"][name], sp.lil_array((1, self.n))
            rows[0, self._sensor(place.number, 0, place.part.start, place.member)] = -1.0
            self._add_motions(rows, 0, (place.number, 0, place.member), -place.shapes[0])
            forcing = self._assembly.propagators[place.number].forcing
            terms = zip(forcing.members[place.member].loads, forcing.amplitudes[place.member], strict=True)
            for load, amplitude in terms:
                self._add_load(rows, 0, load.name, amplitude, bolt.terms.get(load.name, 0.0))
            yield sp.csr_array(rows)

    def fields(self, scene: Scene) -> dict[str, Any]:
        """Fields of the record of the run: outputs from the signals, and what is read point by point."""
        assembly = self._assembly
        kept, blocks, at = self._kept(), [sp.csr_array((0, self.n))], 0
        summary = np.full((len(assembly.interfaces), 6), -1, dtype=np.int64)
        share = np.zeros(sum(g.n_point for g in assembly.layout.groups))
        groups = assembly.layout.groups
        first = np.cumsum([0, *(g.n_point for g in groups)])
        for i, unit in enumerate(assembly.interfaces):
            group = assembly.layout.group(i)
            points = group.members[i]
            matrix, sizes = self._interface_rows(i, kept)
            places = at + np.cumsum([0, *sizes])
            opens = len(sizes) > 6
            summary[i] = (
                places[0],
                places[1],
                places[7] if opens else -1,
                assembly.layout.groups.index(group),
                *(points.start, points.stop),
            )
            begun = first[groups.index(group)]
            share[begun + points.start : begun + points.stop] = unit.geometry.areas / unit.geometry.areas.sum()
            blocks.append(matrix)
            at += sum(sizes)
        sensors = [self._motion_rows(name) for name in self._request.sensors if "." not in name]
        for rows in (*sensors, *self._port_rows(scene), *self._bolt_rows()):
            blocks.append(rows)
            at += rows.shape[0]
        n_output = sum(v.causality == "output" for v in scalar_table(scene))
        blocks.append(sp.csr_array((n_output - at, self.n)))
        shear = sp.csr_array(sp.vstack([self._shear_rows(i) for i in range(len(summary))] or blocks[:1]))
        return {
            "output": sp.csr_array(sp.vstack(blocks)),
            "n_output": n_output,
            "n_signal": self.n,
            "of_solver": at,
            "summary": summary,
            "area_share": share,
            "of_event": n_output - COLUMNS * int((summary[:, 2] >= 0).sum()),
            "shear": shear,
            "no_contact": NO_CONTACT * assembly.characteristic_traction,
            **self._point_fields(kept),
        }
