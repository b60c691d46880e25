"""Fields of the interfaces over the instants: rows as they are kept, and histories in global axes made from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import BinaryIO

import numpy as np

from ..interface.laws import SEPARATION, as_layer, coulomb_coefficient
from ..laws.maxwell_joint import MaxwellJoint
from ..propagator.image import Image
from .assembly import Array, Assembly
from .outcome import InterfaceHistory, PointFields
from .part import Part
from .probes import Probes

NO_CONTACT = 1e-6  # pressure that does not count as contact, over the traction the loads can bring
_BLOCK = 4096  # rows of a stream that are read at a time


class InterfaceRows:
    """Local-stage fields of all interfaces at every so many instants, one row each.

    Parameters
    ----------
    table : (n_row, width) numbers, see ``width_of``; rows are filled by ``keep``. every : instants from row to row.

    Attributes
    ----------
    f_hat, w_hat : (n_row, n_flat) tractions and velocities in the local frames, views of the table, as are:
    gaps : (n_row, n_point) by number of a group that opens. slide : (n_row, 2, n_point, 3) velocities of both sides by
    number of a frictionless interface: it has no tangential unknowns, they come from the substructures.
    """

    def __init__(self, assembly: Assembly, table: Array, every: int = 1) -> None:
        self._assembly = assembly
        self.table = table
        self.every = every
        n, layout = assembly.layout.n_flat, assembly.layout
        self.f_hat, self.w_hat = table[:, :n], table[:, n : 2 * n]
        self.gaps: dict[int, Array] = {}
        self.slide: dict[int, Array] = {}
        at = 2 * n
        for g, group in enumerate(layout.groups):
            if group.behaviour.opens:
                self.gaps[g] = table[:, at : at + group.n_point]
                at += group.n_point
        for i, unit in enumerate(assembly.interfaces):
            if unit.behaviour.n_component == 1:  # no tangential unknowns
                size = 6 * unit.geometry.n_point
                self.slide[i] = table[:, at : at + size].reshape(len(table), 2, unit.geometry.n_point, 3)
                at += size

    @staticmethod
    def width_of(assembly: Assembly) -> int:
        """Numbers of a row."""
        gaps = sum(group.n_point for group in assembly.layout.groups if group.behaviour.opens)
        slide = sum(6 * u.geometry.n_point for u in assembly.interfaces if u.behaviour.n_component == 1)
        return int(2 * assembly.layout.n_flat + gaps + slide)

    def columns(self, interface: int) -> list[Array]:
        """Tractions, velocities and gaps of an interface in the first row."""
        layout = self._assembly.layout
        flat = [layout.channels(interface, side).ravel() for side in (0, 1)]
        fields = [field[0, channels] for field in (self.f_hat, self.w_hat) for channels in flat]
        gap = self.gaps.get(layout.groups.index(layout.group(interface)))
        if gap is None:
            return fields
        return [*fields, gap[0, layout.group(interface).members[interface]]]

    def row(self, instant: int) -> int:
        """Row of the first instant from ``instant`` on that is kept."""
        return -(-instant // self.every)

    def keep(self, image: Image, probes: Probes | None, first: int, n: int, row: int, at: int | None = None) -> int:
        """Keep those of the n instants from ``first`` on that are to be kept, from the rows of the image's output from
        ``row`` on, in the rows of the table from ``at`` on (None: their own); how many."""
        into = self.put(_fields(image, slice(row, row + n)), first, at)
        skipped, count = -first % self.every, int(into.stop - into.start)
        rows = slice(row + skipped, row + n, self.every)
        if probes is not None and self.slide:
            probed = [image.output(c, "probed", "n_probe")[rows] for c in range(len(image.propagators))]
            instants = slice(first + skipped, first + n, self.every)
            probes.slide.read(self._assembly, instants, into, probed, self.slide)
        return count

    def put(self, fields: tuple[Array, Array, Array], first: int, at: int | None = None) -> slice:
        """Keep those of the n instants from ``first`` on that are to be kept, of tractions and velocities (n, n_flat)
        and gaps (n, n_point) of all groups; the rows of the table, from ``at`` on (None: their own)."""
        n, picked = len(fields[0]), slice(-first % self.every, None, self.every)
        if at is None:
            start = self.row(first)
        else:
            start = at
        into = slice(start, start + self.row(first + n) - self.row(first))
        self.f_hat[into], self.w_hat[into], gaps = (values[picked] for values in fields)
        # there is a place for every point, also of groups that do not open
        place = 0
        for g, group in enumerate(self._assembly.layout.groups):
            if g in self.gaps:
                self.gaps[g][into] = gaps[:, place : place + group.n_point]
            place += group.n_point
        return into

    def put_slides(self, slides: Mapping[int, Array], first: int, into: slice) -> None:
        """Keep the ``slide`` (n, 2, n_point, 3) of the instants of ``put``, which has returned ``into``."""
        for i, values in slides.items():
            self.slide[i][into] = values[-first % self.every :: self.every]

    def histories(self, n: int, peak_duration: float | None) -> dict[str, InterfaceHistory]:
        """Histories in global axes of the first n rows; ``peak_duration`` as in the request of output."""
        names = [unit.name for unit in self._assembly.interfaces]
        return {
            name: interface_history(self._assembly, i, *self._of(i, n), peak_duration) for i, name in enumerate(names)
        }

    def fields(self, n: int) -> dict[str, PointFields]:
        """Fields of the interfaces in the first n rows, a part of the histories."""
        names = [unit.name for unit in self._assembly.interfaces]
        return {name: self.fields_of(i, n) for i, name in enumerate(names)}

    def fields_of(self, interface: int, n: int) -> PointFields:
        """Fields of one interface in the first n rows."""
        return point_fields(self._assembly, interface, *self._of(interface, n))

    def _of(self, interface: int, n: int) -> tuple[Array, Array, Array | None, Array | None]:
        """What is kept of an interface in the first n rows."""
        layout = self._assembly.layout
        group = layout.group(interface)
        gap = self.gaps.get(layout.groups.index(group))
        own_gap = None
        if gap is not None:
            own_gap = gap[:n, group.members[interface]]
        return self.f_hat[:n], self.w_hat[:n], own_gap, self.slide.get(interface)


def _fields(image: Image, rows: slice) -> tuple[Array, Array, Array]:
    """Tractions, velocities and gaps of all interfaces in rows of the output of an image."""
    f_hat, w_hat = (image.field(f"history_{name}", image.rows, image.n_flat)[rows] for name in ("f", "w"))
    return f_hat, w_hat, image.field("history_gap", image.rows, int(image.run[0]["n_point"]))[rows]


class InterfaceStream:
    """Rows of the interfaces in a file, where they are too many for the memory.

    Parameters
    ----------
    file : open for reading and writing, empty, for this run alone. every : instants from row to row.
    """

    def __init__(self, assembly: Assembly, file: BinaryIO, every: int, peak_duration: float | None) -> None:
        self._assembly = assembly
        self._file = file
        self.every = every
        self._width, self._peak_duration = InterfaceRows.width_of(assembly), peak_duration
        self._next = InterfaceRows(assembly, np.zeros((0, self._width)), every)
        self.n_row = 0

    def keep(self, image: Image, probes: Probes | None, first: int, n: int, row: int) -> None:
        """Keep instants as ``InterfaceRows.keep`` does."""
        rows = self._room(image.rows)
        self.append(rows.table[: rows.keep(image, probes, first, n, row, at=0)])

    def put(self, fields: tuple[Array, Array, Array], slides: Mapping[int, Array], first: int) -> None:
        """Keep instants as ``InterfaceRows.put`` does, with the ``slides`` (n, 2, n_point, 3)."""
        rows = self._room(len(fields[0]))
        into = rows.put(fields, first, at=0)
        rows.put_slides(slides, first, into)
        self.append(rows.table[into])

    def _room(self, n: int) -> InterfaceRows:
        """Rows for so many instants."""
        # views of the table are made anew where it grows
        if len(self._next.table) < n:
            self._next = InterfaceRows(self._assembly, np.zeros((n, self._width)), self.every)
        return self._next

    def append(self, rows: Array) -> None:
        """Put rows (n, width) behind those that are there."""
        self._file.seek(8 * self.n_row * self._width)  # ``rows`` moves the place in the file
        self._file.write(np.ascontiguousarray(rows).tobytes())
        self.n_row += len(rows)

    def rows(self, first: int, last: int) -> Array:
        """Rows from ``first`` to before ``last``, (n, width)."""
        self._file.seek(8 * first * self._width)
        content = self._file.read(8 * (last - first) * self._width)
        return np.frombuffer(content).reshape(last - first, self._width)

    def blocks(self, overlap: int = 1) -> Iterator[tuple[int, Array, dict[str, InterfaceHistory]]]:
        """The histories in blocks: row of the first instant, instants (n,), histories by name. A block begins with the
        last ``overlap`` instants of the one before."""
        first = 0
        while True:
            last = min(first + _BLOCK, self.n_row)
            rows = InterfaceRows(self._assembly, self.rows(first, last), self.every)
            time = self._assembly.time[:: self.every][first:last]
            yield first, time, rows.histories(last - first, self._peak_duration)
            if last == self.n_row:
                return
            first = last - overlap

    def close(self) -> None:
        """Close the file: the histories can be read no more."""
        self._file.close()


def joined_rows(rows: InterfaceRows, part: Part) -> InterfaceRows:
    """Rows of all interfaces from those of the processes. Tractions, velocities and gaps are those of the owner of an
    interface, what slides along a side has the process of the side."""
    processes, n_row = part.processes, len(rows.table)
    width, wide = InterfaceRows.width_of(part.assembly), InterfaceRows.width_of(part.whole)
    # tables whose entries are their column numbers: views of them tell where each field stands
    here, there = (InterfaceRows(a, np.arange(float(n))[None]) for a, n in ((part.assembly, width), (part.whole, wide)))
    picked, into = [np.zeros(0)], [np.zeros(0)]
    for number, i in enumerate(part.interfaces):
        owned = number < part.n_owned
        if owned:
            picked += here.columns(number)
            into += there.columns(i)
        if i not in there.slide:
            continue
        for side, process in enumerate(part.sides[i]):
            # the ground has no process: its side is that of the owner
            if process == part.rank or (process < 0 and owned):
                picked.append(here.slide[number][0, side].ravel())
                into.append(there.slide[i][0, side].ravel())
    columns = processes.collect(np.concatenate(into).astype(np.int64))
    ends = np.cumsum([0, *(n_row * len(c) for c in columns)]).tolist()
    every = processes.gather(rows.table[:, np.concatenate(picked).astype(np.int64)].ravel(), ends)
    table = np.zeros((n_row, wide))
    for c, first, last in zip(columns, ends, ends[1:], strict=False):
        table[:, c] = every[first:last].reshape(n_row, -1)
    return InterfaceRows(part.whole, table, rows.every)


def point_fields(
    assembly: Assembly, index: int, f_hat: Array, w_hat: Array, gap: Array | None, slide: Array | None
) -> PointFields:
    """Fields of interface ``index`` at its points in global axes; arguments as for ``interface_history``.

    A pressure below 1e-6 of the traction that the loads can bring (round-off, and the numerical precursor of a wave
    that has not arrived) does not count as contact; nor does a traction, for laws without a friction coefficient.
    """
    unit, group = assembly.interfaces[index], assembly.layout.group(index)
    points = group.members[index]
    f_hat, w_hat = group.block(f_hat)[:, 0, points], group.block(w_hat)[:, :, points]
    behaviour = unit.behaviour
    geometry = unit.geometry
    status = None
    in_global_axes = geometry.global_axes[behaviour.n_component]
    traction, velocity = in_global_axes(f_hat), in_global_axes(w_hat)
    if slide is not None:
        normal = geometry.frames[:, 0]
        tangential = slide[: len(f_hat)]
        # one normal after the other: einsum takes four times as long for products of three
        along = ((tangential * normal)[..., None] * normal[:, None, :]).sum(axis=-2)
        # of the velocities of the sides what is not along N, which ``velocity`` has already
        velocity = velocity + tangential - along
    if behaviour.opens:
        status = behaviour.status(f_hat, group.parameters[points])
        carried = -f_hat[..., 0]  # F acts on side E and N points out of it: pressure is negative
        if coulomb_coefficient(behaviour) is None:  # such a law may hold shear without pressure
            carried = np.maximum(carried, np.abs(f_hat).max(axis=-1))
        status[carried <= NO_CONTACT * assembly.characteristic_traction] = SEPARATION
    return PointFields(traction, velocity, gap, status)


def interface_history(
    assembly: Assembly,
    index: int,
    f_hat: Array,
    w_hat: Array,
    gap: Array | None = None,
    slide: Array | None = None,
    peak_duration: float | None = None,
) -> InterfaceHistory:
    """History of interface ``index`` in global axes from local-frame fields.

    Parameters
    ----------
    f_hat, w_hat : (n, n_flat) local-stage tractions and velocities. gap : (n, n_point) or None.
    slide : (n_time, 2, n_point, 3) velocities of the sides where tangential unknowns are absent, else None.
    peak_duration : as in the request of output.
    """
    unit, group = assembly.interfaces[index], assembly.layout.group(index)
    points = group.members[index]
    traction, velocity, gap, status = point_fields(assembly, index, f_hat, w_hat, gap, slide)
    f_hat, w_hat = group.block(f_hat)[:, 0, points], group.block(w_hat)[:, :, points]
    behaviour = unit.behaviour
    geometry = unit.geometry
    parameters = group.parameters[points]
    friction_power = joint_power = None
    if behaviour.opens and behaviour.n_component > 1:
        density = np.zeros(f_hat.shape[:-1])
        for c in range(1, behaviour.n_component):
            # F on E is along the motion of E' relative to E: friction dissipates, >= 0
            density += f_hat[..., c] * (w_hat[:, 1, :, c] - w_hat[:, 0, :, c])
        friction_power = density @ geometry.areas
    layer = as_layer(behaviour)
    layer_energy = None
    if layer is not None:
        layer_energy = layer.stored_energy(f_hat, parameters) @ geometry.areas
    # viscous joints: power of the tractions on the jump of velocities
    if behaviour.compliant and layer is None:
        joint_power = (f_hat * (w_hat[:, 1] - w_hat[:, 0])).sum(axis=-1) @ geometry.areas
    elif isinstance(behaviour, MaxwellJoint):
        assert layer_energy is not None
        # the dashpots take F.e / tau of the springs' F.e / 2
        joint_power = 2.0 * layer_energy / behaviour.relaxation_time
    return InterfaceHistory(
        unit.name,
        behaviour.name,
        unit.sides,
        geometry.points,
        geometry.areas,
        geometry.frames[:, 0],
        geometry.gap,
        coulomb_coefficient(behaviour),
        traction=traction,
        velocity=velocity,
        gap=gap,
        contact_status=status,
        friction_power=friction_power,
        layer_energy=layer_energy,
        joint_power=joint_power,
        cells=geometry.cells,
        quasi_static=assembly.quasi_static,
        # a mean over the time that only orders increments is no force
        peak_duration=0.0 if assembly.quasi_static else peak_duration,
    )
