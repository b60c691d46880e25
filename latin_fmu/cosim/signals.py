"""Outputs of a run by communication steps: their matrix over the signals of an instant (``kernels.communication``).

The rows of outputs (``output_table``) ask here for what they follow from; those of an interface are determined by unit
fields of its points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..assembly.supports import port_key
from ..kernels.outputs import ENERGIES, N_SUMMARY, READ, WRITTEN
from ..latin.assembly import Assembly
from ..latin.interface_rows import NO_CONTACT, InterfaceRows
from ..latin.outcome import Array, PointFields
from ..latin.probes import ProbePlace, Probes
from ..latin.recorder import Recorder
from ..propagator.forcing import STRAIN
from ..scene.ports import COMPONENTS
from ..scene.schema import Scene
from .drives import Drives
from .following_outputs import following_fields
from .output_table import INTERFACE, FacePoints, first_of_events, follows_energies, outputs_of, places_of

_POINTS = 32  # points whose unit fields are read at a time


def _apart(values: Any) -> Any:
    """Fields (n, n_point, ...) of all points as fields (n n_point, n_point, ...) of one point each."""
    n, n_point = values.shape[:2]
    # row k n_point + p: unknown k of point p alone
    apart = np.zeros((n, n_point, *values.shape[1:]), values.dtype)
    each = np.arange(n_point)
    apart[:, each, each] = values
    return apart.reshape(n * n_point, *values.shape[1:])


def _shear_rows(assembly: Assembly, i: int, n: int) -> sp.csr_array:
    """Tangential resultant (3, n) of an interface on its first side from n signals, tractions first."""
    geometry, channels = assembly.interfaces[i].geometry, assembly.layout.channels(i, 0)
    rows = sp.lil_array((3, n))
    for k in range(1, channels.shape[1]):  # channel 0 is the normal, which has no part in the shear
        for axis in range(3):
            rows[axis, channels[:, k]] = geometry.areas * geometry.frames[:, k, axis]
    return sp.csr_array(rows)


def _unknowns(assembly: Assembly, i: int, width: int) -> Any:
    """Numbers in a row of ``InterfaceRows`` of the unknowns of an interface, (n_unknown, n_point)."""
    layout, group = assembly.layout, assembly.layout.group(i)
    table = InterfaceRows(assembly, np.arange(float(width))[None])
    flat = [layout.channels(i, side) for side in (0, 1)]
    # traction of side E alone, whose opposite is that of E'; velocities of both sides, n_flat later
    parts: list[Any] = [flat[0].T, *((f + layout.n_flat).T for f in flat)]
    parts += [table.gaps[g][:, group.members[i]] for g in table.gaps if layout.groups[g] is group]
    if i in table.slide:
        parts += [table.slide[i][0].transpose(0, 2, 1).reshape(6, -1)]
    # six numbers a point: three components of each side
    return np.concatenate(parts).astype(np.int64)


class SignalPlaces:
    """Places of the signals of an assembly."""

    def __init__(self, drives: Drives, recorder: Recorder) -> None:
        self._drives, assembly = drives, drives.assembly
        self._assembly, self._bodies, self._request = assembly, drives.bodies, recorder.request
        self.probes = Probes(assembly, recorder.sliding, self._request)
        n = assembly.layout.n_flat
        # the order of the kernels: tractions, velocities, gaps, then the classes, then the drives
        at = 2 * n + sum(g.n_point for g in assembly.layout.groups)
        self._sensed: list[int] = []
        self._probed: list[int] = []
        self._n_sensor: list[int] = []
        for c, propagator in enumerate(assembly.propagators):
            m = len(propagator.members)
            rows = self.probes.rows[c]
            slides = self.probes.slide.rows[c]
            if rows is None:
                self._n_sensor.append(0)
            else:
                self._n_sensor.append(rows.shape[0])
            self._sensed.append(at)
            self._probed.append(at + propagator.n_sensed * self._n_sensor[-1] * m)
            at = self._probed[-1]
            if slides is not None:
                at += slides.shape[0] * m
        self._drive = at
        sizes = [
            (STRAIN + len(p.branches)) * p.members[0].imposed_pattern.shape[1] * len(p.members)
            for p in self._bodies.propagators
        ]
        self._motions = np.cumsum([0, *sizes])
        self._energies = at + drives.n_state + 2 * len(drives.sources) + 1
        self._one = self._energies - 1
        self.n = self._energies

    def _sensor(self, c: int, kind: int, row: int, member: int) -> int:
        """Place of the displacement, velocity, acceleration or ``STRAIN`` of a sensor row of a class."""
        m = len(self._assembly.propagators[c].members)
        # all displacements of a class, then its velocities, then its accelerations, then the strains of its branches;
        # members run fastest
        return int(self._sensed[c] + (kind * self._n_sensor[c] + row) * m + member)

    def _motion(self, c: int, kind: int, k: int, member: int) -> int:
        """Place of the displacement, velocity, acceleration or, from 3 on, of an elongation of a prescribed motion."""
        members = self._bodies.propagators[c].members
        row = kind * members[0].imposed_pattern.shape[1] + k
        return int(self._drive + self._motions[c] + row * len(members) + member)

    def _source(self, name: str) -> int | None:
        """Place of the amplitude of a source at the instant; None for a load that is constant."""
        names = (*self._drives.sources.inputs, *self._drives.sources.laws)
        # behind the motion state stand the amplitudes before the step; those at the instant come after them
        first = self._drive + self._drives.n_state + len(names)
        if name in names:
            return first + names.index(name)
        return None

    def _add_load(self, rows: Any, row: int, name: str, amplitude: Array, share: float) -> None:
        """Add ``share`` times the amplitude of a load, a signal where it varies."""
        source = self._source(name)
        rows[row, self._one if source is None else source] += share * (amplitude[0] if source is None else 1.0)

    def _add_motions(self, rows: Any, row: int, of: tuple[int, int, int], shapes: Array) -> None:
        """Add what prescribed motions of a class and member add, by ``shapes`` (n_motion,); ``of``: class, 0 for their
        displacements, 1 for velocities, 2 for accelerations, member."""
        c, kind, member = of
        for k in np.flatnonzero(shapes):
            rows[row, self._motion(c, kind, int(k), member)] += shapes[k]

    def _add_strains(self, rows: Any, row: int, place: ProbePlace, at: int, shapes: Array, factor: float = 1.0) -> None:
        """Add ``factor`` times what Maxwell branches add to a displacement that is read from row ``at`` of a place and
        from prescribed motions by ``shapes`` (n_motion,)."""
        branches = self._assembly.propagators[place.number].branches
        if not len(branches):
            return
        rows[row, self._sensor(place.number, STRAIN, at, place.member)] += factor
        for j, strength in enumerate(branches.strengths):
            moved = factor * strength * shapes
            self._add_motions(rows, row, (place.number, STRAIN + j, place.member), moved)

    def _static_rows(self, name: str) -> sp.csr_array:
        """Part (3, n) of the reaction of a moved face (``latin.probes``) that its displacements, velocities and loads
        give."""
        place, support = self.probes.places["force"][name], self._request.supports[name]
        member, forcing = place.member, self._assembly.propagators[place.number].forcing
        rows, first = sp.lil_array((3, self.n)), place.part.start
        for axis in range(3):
            for kind in range(2):
                self._add_read(rows, axis, kind, place)
            self._add_strains(rows, axis, place, first + axis, place.shapes[axis])
            terms = zip(forcing.members[member].loads, forcing.amplitudes[member], support.loads, strict=True)
            for load, amplitude, resultant in terms:
                self._add_load(rows, axis, load.name, amplitude, -resultant[axis])
        return sp.csr_array(rows)

    def _inertia_rows(self, name: str) -> sp.csr_array:
        """Part (3, n) that its accelerations and the tractions of the interfaces give."""
        place, support = self.probes.places["force"][name], self._request.supports[name]
        rows, channels = sp.lil_array((3, self.n)), self._assembly.channels[place.number][:, place.member]
        for axis in range(3):
            self._add_read(rows, axis, 2, place)
            for channel, area in zip(channels, support.spread[:, axis], strict=True):
                # - e T^T area F: the tractions of all channels of the body
                rows[axis, int(channel)] -= area
        return sp.csr_array(rows)

    def _add_read(self, rows: Any, axis: int, kind: int, place: ProbePlace) -> None:
        """Add displacements (0), velocities (1) or accelerations (2) that a place of a support reads."""
        rows[axis, self._sensor(place.number, kind, place.part.start + 3 * kind + axis, place.member)] = 1.0
        self._add_motions(rows, axis, (place.number, kind, place.member), place.shapes[3 * kind + axis])


class Signals(SignalPlaces):
    """The outputs of an assembly that follow from its signals.

    The methods that rows of ``output_table`` name give rows over the signals, (1, n) or (3, n), for the name of a
    sensor, port or bolt.
    """

    def __init__(self, scene: Scene, drives: Drives, recorder: Recorder) -> None:
        super().__init__(drives, recorder)
        self._scene = scene
        self.n += len(ENERGIES) * follows_energies(scene)

    def _kept(self) -> sp.csr_array:
        """Numbers of a row of ``InterfaceRows`` from the signals."""
        layout, n = self._assembly.layout, self._assembly.layout.n_flat
        width = InterfaceRows.width_of(self._assembly)
        # a row that holds its own column numbers: its views say where each number stands
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
                # what comes from outside of the velocity of the points: the probed rows are of the free dofs alone
                moved = sp.csr_array(trace[rows]) @ self._assembly.propagators[c].members[member].imposed_pattern
                for line, k in np.argwhere(moved):
                    cells.append((int(to[line]), self._motion(c, 1, int(k), member), float(moved[line, k])))
        where = np.array([*cells, *self._ground_entries(table)]).reshape(-1, 3)
        places = where[:, 0].astype(np.int64), where[:, 1].astype(np.int64)
        return sp.csr_array(sp.coo_array((where[:, 2], places), shape=(width, self.n)))

    def _ground_entries(self, table: InterfaceRows) -> list[tuple[int, int, float]]:
        """Velocities of the ground at the points of frictionless interfaces."""
        entries: list[tuple[int, int, float]] = []
        drives, n_x, n_s = self._drives, self._drives.n_state, len(self._drives.sources)
        for e in range(2 * n_s if self.probes.slide.ground else 0):
            amplitudes = np.zeros(2 * n_s)
            amplitudes[e] = 1.0
            drives.begin(amplitudes.reshape(2, n_s))  # two instants: before the step, at its end
            for i, velocity in drives.slides().items():
                if i in self.probes.slide.ground and velocity.any():
                    to = table.slide[i][0, 1].astype(int)
                    entries += [
                        (int(row[k]), self._drive + n_x + e, float(velocity[k])) for row in to for k in range(3)
                    ]
        return entries

    def linear_of(self, name: str, row_matrix: sp.csr_array) -> dict[str, sp.csr_array]:
        """Linear outputs of an interface from the signals, by the names of their rows."""
        numbers = {unit.name: i for i, unit in enumerate(self._assembly.interfaces)}
        return self._interface_rows(numbers[name], row_matrix)

    def _interface_rows(self, i: int, row_matrix: sp.csr_array) -> dict[str, sp.csr_array]:
        """Those of an interface of the march."""
        assembly, width = self._assembly, row_matrix.shape[0]
        unknowns, unit = _unknowns(self._assembly, i, width), assembly.interfaces[i]
        geometry = unit.geometry
        faces = (geometry.areas, geometry.areas / geometry.areas.sum(), geometry.frames[:, 0])
        every = self._unit_fields(i, width)  # of all points at once, then taken apart
        linear = [r for r in INTERFACE.rows if r.of and r.name not in WRITTEN and r.axes(self._scene.joints[unit.name])]
        blocks, sizes, order = [], list[int](), list[Any]()
        for start in range(0, geometry.n_point, _POINTS):
            some = slice(start, start + _POINTS)
            points = FacePoints(
                _apart(every.traction[:, some]),
                _apart(every.velocity.transpose(0, 2, 1, 3)[:, some]).transpose(0, 2, 1, 3),
                *(np.zeros(0) if v is None else _apart(v[:, some]) for v in (every.gap, every.contact_status)),
                *(values[some] for values in faces),
            )
            columns = [row.of(points).reshape(len(points.traction), -1) for row in linear if row.of]
            sizes = [column.shape[1] for column in columns]
            blocks.append(sp.csr_array(np.concatenate(columns, axis=1)))
            order.append(unknowns[:, some].ravel())  # as the rows of ``_apart``: unknown, then point
        picked = sp.csr_array(sp.csc_array(sp.vstack(blocks)).T)
        rows, ends = sp.csr_array(picked @ row_matrix[np.concatenate(order)]), np.cumsum([0, *sizes])
        return {row.name: rows[ends[k] : ends[k + 1]] for k, row in enumerate(linear)}

    def _unit_fields(self, i: int, width: int) -> PointFields:
        """Fields of an interface whose points all have one of their unknowns 1, (n_unknown, ...): a point depends on
        its own unknowns alone."""
        table = _unknowns(self._assembly, i, width)
        rows = np.zeros((len(table), width))
        for row, unknowns in zip(rows, table, strict=True):
            row[unknowns] = 1.0
        return InterfaceRows(self._assembly, rows).fields_of(i, len(rows))

    def _point_fields(self, row_matrix: sp.csr_array) -> dict[str, Any]:
        """Fields of the record of the run: what describes the points of the interfaces, one interface after the other:
        traction (n_point, 3), velocity (2, n_point, 3), where there is a gap that and contact state (n_point,)."""
        blocks, at = [sp.csr_array((0, self.n))], 0
        status = np.full(len(self._assembly.interfaces), -1, dtype=np.int64)
        for i, unit in enumerate(self._assembly.interfaces):
            n = unit.geometry.n_point
            width = row_matrix.shape[0]
            unknowns = _unknowns(self._assembly, i, width)
            fields = self._unit_fields(i, width)
            parts = [fields.traction.reshape(-1, 1, n, 3), fields.velocity]
            if fields.gap is not None:
                parts += [fields.gap.reshape(-1, 1, n, 1)]
            for values in parts:
                unknown, side, p, axis = np.nonzero(values)
                size = int(np.prod(values.shape[1:]))
                # place in the field (side, point, axis), row by row
                to = (side * n + p) * values.shape[3] + axis
                entries = values[unknown, side, p, axis], (to, unknowns[unknown, p])
                blocks.append(sp.csr_array(sp.coo_array(entries, shape=(size, row_matrix.shape[0]))) @ row_matrix)
                at += size
            if fields.gap is not None:
                blocks.append(sp.csr_array((n, self.n)))  # states: the kernels write them
                status[i] = at
                at += n
        return {"field": sp.csr_array(sp.vstack(blocks)), "status_place": status}

    def motion(self, name: str, kind: int) -> sp.csr_array:
        """Displacement (0), velocity (1) or acceleration (2) of a sensor, or of a port by its key."""
        place, rows = self.probes.places["motion"][name], sp.lil_array((3, self.n))
        c, member = place.number, place.member
        for axis, row in enumerate(range(place.part.start, place.part.stop)):
            rows[axis, self._sensor(c, kind, row, member)] = 1.0
            self._add_motions(rows, axis, (c, kind, member), place.shapes[axis])
        return sp.csr_array(rows)

    def port_motion(self, name: str, turned: int, kind: int) -> sp.csr_array:
        """Displacement or velocity of a port, or its rotation or angular velocity where ``turned`` is 1."""
        return self.motion(port_key(name, turned=bool(turned)), kind)

    def exerted(self, name: str, turned: int) -> sp.csr_array:
        """Force that the body exerts through a port that is moved, or its moment."""
        key = port_key(name, turned=bool(turned))
        return sp.csr_array(-self._static_rows(key) - self._inertia_rows(key))

    def half_before(self, name: str, turned: int) -> sp.csr_array:
        """Half of the part of ``exerted`` that an explicit scheme takes as the mean over the last two instants."""
        return -0.5 * self._static_rows(port_key(name, turned=bool(turned)))

    def wave(self, name: str, turned: int, sign: float) -> sp.csr_array:
        """Of a wave port the force on the body, incident wave - Z v, or its moment; with sign -1 the reflected wave."""
        port, incident, impedance = self._scene.port[name], sp.lil_array((3, self.n)), np.zeros(3)
        for source, component, z in zip(port.inputs(name), port.components, port.impedance or (), strict=True):
            place, axis = self._source(source), COMPONENTS.index(component)
            assert place is not None
            if axis // 3 == turned:
                incident[axis % 3, place], impedance[axis % 3] = 1.0, z
        braked = sp.csr_array(sp.diags_array(impedance) @ self.port_motion(name, turned, 1))
        if sign > 0.0:
            return sp.csr_array(incident) - braked
        return 2.0 * braked - sp.csr_array(incident)

    def shank(self, name: str, which: Sequence[int]) -> sp.csr_array:
        """Resultants of the shank of a bolt at its cut: tension (0), shear forces (1, 2), torsion (3), bending moments
        (4, 5)."""
        bolt, place = self._request.bolts[name], self.probes.places["tension"][name]
        rows = sp.lil_array((len(which), self.n))
        forcing = self._assembly.propagators[place.number].forcing
        for row, k in enumerate(which):
            at = place.part.start + k
            rows[row, self._sensor(place.number, 0, at, place.member)] = -1.0
            self._add_motions(rows, row, (place.number, 0, place.member), -place.shapes[k])
            self._add_strains(rows, row, place, at, place.shapes[k], -1.0)
            terms = zip(forcing.members[place.member].loads, forcing.amplitudes[place.member], strict=True)
            for load, amplitude in terms:
                self._add_load(rows, row, load.name, amplitude, bolt.cut_term(load.name, k))
        return sp.csr_array(rows)

    def energies(self, parts: Sequence[str]) -> sp.csr_array:
        """A sum of energies, less those that begin with -, added up in this order."""
        columns = [self._energies + ENERGIES.index(part.removeprefix("-")) for part in parts]
        signs = [-1.0 if part.startswith("-") else 1.0 for part in parts]
        return sp.csr_array((signs, columns, [0, len(parts)]), shape=(1, self.n))

    def _output_rows(self, row_matrix: sp.csr_array) -> tuple[sp.csr_array, list[tuple[int, int]]]:
        """All outputs from the signals, rows of zeros where they are no linear functions; places of outputs and of
        their integrals."""
        blocks, integrals, at, before = [sp.csr_array((0, self.n))], list[tuple[int, int]](), 0, 0
        linear: dict[str, dict[str, sp.csr_array]] = {}
        for placed in outputs_of(self._scene):
            row, axes = placed.row, [axis or 0 for axis in placed.row.axes(placed.owner)]
            if row.integral:
                integrals += [(before + k, at + k) for k in range(len(axes))]
            if row.of is None or row.name in WRITTEN:
                blocks.append(sp.csr_array((len(axes), self.n)))
            elif placed.family is INTERFACE:
                if placed.name not in linear:
                    linear[placed.name] = self.linear_of(placed.name, row_matrix)
                blocks.append(linear[placed.name][row.name])
            else:
                blocks.append(row.of(self, placed.name)[axes])
            before, at = at, at + len(axes)
        return sp.csr_array(sp.vstack(blocks)), integrals

    def _lags(self, places: Mapping[str, int]) -> dict[str, Any]:
        """Outputs of which an explicit scheme takes a part as the mean over the last two instants."""
        blocks, where = [sp.csr_array((0, self.n))], list[int]()
        for placed in outputs_of(self._scene) if self._assembly.scheme.explicit else ():
            if placed.row.lag is not None:
                axes = [axis or 0 for axis in placed.row.axes(placed.owner)]
                blocks.append(placed.row.lag(self, placed.name)[axes])
                where += [places[name] for name in placed.names]
        return {"lag": sp.csr_array(sp.vstack(blocks)), "lag_place": np.array(where, dtype=np.int64)}

    def differenced(self, name: str, /) -> bool:
        """Whether the acceleration of a sensor is the rate of its velocity over the last time step."""
        return name in self.probes.massless

    def fields(self) -> dict[str, Any]:
        """Fields of the record of the run: outputs from the signals, and what is read point by point."""
        assembly, places = self._assembly, places_of(self._scene)
        row_matrix, groups = self._kept(), assembly.layout.groups
        constant = [places[name] for placed in outputs_of(self._scene) if placed.row.constant for name in placed.names]
        matrix, integrals = self._output_rows(row_matrix)
        summary = np.zeros((len(assembly.interfaces), N_SUMMARY), dtype=np.int64)
        share = np.zeros(sum(g.n_point for g in groups))
        first = np.cumsum([0, *(g.n_point for g in groups)])
        for i, unit in enumerate(assembly.interfaces):
            group = assembly.layout.group(i)
            number, points = groups.index(group), group.members[i]
            named = [places.get(f"interface.{unit.name}.{name}", -1) for name in READ]
            summary[i] = *named, number, points.start, points.stop
            areas, begun = unit.geometry.areas, first[number]
            share[begun + points.start : begun + points.stop] = areas / areas.sum()
        shear = [sp.csr_array((0, self.n)), *(_shear_rows(assembly, i, self.n) for i in range(len(summary)))]
        return {
            "output": matrix,
            "n_output": len(places),
            "n_signal": self.n,
            "of_solver": places["solver.iterations"],
            "of_energy": self._energies if self._energies < self.n else -1,
            "of_event": first_of_events(places),
            "n_integral": len(integrals),
            "n_constant": len(constant),
            "constant_outputs": np.array(constant, dtype=np.int64),
            "integrals": np.array(integrals, dtype=np.int64).reshape(-1, 2),
            "summary": summary,
            "area_share": share,
            "shear": sp.csr_array(sp.vstack(shear)),
            **self._lags(places),
            **following_fields(self._scene, places, self._drives.dt, self.differenced),
            "no_contact": NO_CONTACT * assembly.characteristic_traction,
            **self._point_fields(row_matrix),
        }
