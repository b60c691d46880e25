"""What a deck prints of a run: displacements and forces of nodes, values at integration points, forces of contacts, as
blocks of ``dat_file``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..fem.elasticity import ROWS
from ..fem.reference_cells import Rule, cell_rule, simplex_rule, volume_rule
from ..latin.outcome import InterfaceHistory
from ..mesh_files.adjusted_nodes import surface_rows
from ..mesh_files.content import Array, Index
from ..mesh_files.deck_scene import rows_of_set
from ..results.solution import Solution
from .dat_file import DatBlock, dat_text
from .print_cards import DeckPrints, PrintInstant
from .translation import PrintRequest

_ORDER: Final = (0, 1, 2, 5, 4, 3)
"""xx yy zz xy xz yz of tensors in the order of ``fem.elasticity``."""
_PRESSED: Final = 1e-9  # of the largest pressure: points that count as closed


def point_rule(name: str) -> Rule:
    """Integration points of a type of element, in the order in which CalculiX prints them (measured, ccx 2.20).

    >>> [len(point_rule(name).weights) for name in ("C3D8", "C3D8R", "C3D20R", "C3D20", "C3D10", "C3D15", "C3D6")]
    [8, 1, 8, 27, 4, 9, 2]
    """
    if name in ("C3D8R", "C3D20R", "C3D20"):
        number = {"C3D8R": 1, "C3D20R": 2, "C3D20": 3}[name]
        return volume_rule("hexahedron", number)
    if name == "C3D4":
        return simplex_rule(1, 3)
    if name == "C3D6":
        return cell_rule("wedge", reduced=True)
    return cell_rule({"C3D8": "hexahedron", "C3D8I": "hexahedron", "C3D10": "tetra10", "C3D15": "wedge15"}[name])


def printed_text(prints: DeckPrints, solution: Solution) -> str:
    """The ``.dat`` of a run."""
    return dat_text(printed_blocks(prints, solution))


def printed_blocks(prints: DeckPrints, solution: Solution) -> Iterator[DatBlock]:
    """The blocks that a deck prints, in the order of CalculiX; instants that a run has not reached have none."""
    values = PrintedValues(prints, solution)
    reached = solution.time[-1] + 1e-9 * abs(solution.time[-1])
    for instant, request in prints.printed():
        if instant.scene > reached:
            return
        for word in request.words:
            if request.keyword == "NODE PRINT":
                yield from values.of_nodes(word, request, instant)
            elif request.keyword == "EL PRINT":
                yield from values.of_elements(word, request, instant)
            else:
                yield from values.of_contact(request, instant)


class PrintedValues:
    """Values of a run by what the deck calls them.

    Forces of all nodes and values of elements at one instant are kept until the next one.
    """

    def __init__(self, prints: DeckPrints, solution: Solution) -> None:
        self.prints, self.content, self.solution = prints, prints.content, solution
        self._forces: tuple[float, Array] = (np.nan, np.zeros(0))
        self._rows_of = {group: self.content.nodes_of(group) for group in prints.parts}

    # -- nodes ---------------------------------------------------------------------------------------------------
    def of_nodes(self, word: str, request: PrintRequest, instant: PrintInstant) -> Iterator[DatBlock]:
        """A block of nodes, and the sum of forces where it is asked for."""
        rows = rows_of_set(self.content, request.target)
        rows = rows[rows < len(self.content.labels)]
        if word == "RF":
            values = self.nodal_forces(instant.scene)[rows]
        else:
            values = self.motion(rows, word, instant.scene)
        there = ~np.isnan(values).any(axis=1)
        rows, values = rows[there], values[there]
        if not len(rows):
            return
        total = values.sum(axis=0)
        turned = np.zeros(len(rows), dtype=bool)
        if request.local:
            values, turned = self._along_local_axes(rows, values)
        labels = self.content.labels[rows]
        order = np.argsort(labels, kind="stable")
        if word != "RF" or request.totals != "ONLY":
            yield DatBlock(word, request.target, instant.deck, labels[order, None], values[order], turned[order])
        if word == "RF" and request.totals != "NO":
            yield DatBlock("total RF", request.target, instant.deck, np.zeros((1, 0), dtype=np.int64), total[None])

    def motion(self, rows: Index, word: str, time: float) -> Array:
        """Displacement or velocity (n, 3) of nodes; NaN where it is not known."""
        values = np.full((len(rows), 3), np.nan)
        for group, part in self.prints.parts.items():
            history = self.solution.substructures.get(part)
            field = None
            if history is not None:
                field = history.displacement if word == "U" else history.velocity
            nodes = self._rows_of[group]
            inside = np.isin(rows, nodes)
            if history is not None and field is not None:
                i = int(np.abs(history.time - time).argmin())
                values[inside] = field[i][np.searchsorted(nodes, rows[inside])]
        for k, row in enumerate(rows.tolist()):
            sensor = self.solution.sensors.get(self.prints.sensors.get(row, ""))
            if sensor is not None and np.isnan(values[k]).any():
                i = int(np.abs(self.solution.time - time).argmin())
                values[k] = (sensor.displacement if word == "U" else sensor.velocity)[i]
        return values

    def nodal_forces(self, time: float) -> Array:
        """Forces (n_point, 3) that hold the elements around every node; NaN at nodes of contacts, where other forces
        act, and of rigid bodies."""
        if self._forces[0] == time:
            return self._forces[1]
        total = np.full((len(self.content.points), 3), np.nan)
        for group, part in self.prints.parts.items():
            recovered = self.solution.recovered.get(part)
            history = self.solution.substructures.get(part)
            if recovered is None or history is None or history.displacement is None:
                continue
            i = int(np.abs(history.time - time).argmin())
            unstrained = None
            if recovered.unstrained is not None:
                unstrained = recovered.unstrained(history.time[i : i + 1])[0]
            rows = self._rows_of[group]
            forces = recovered.recovery.nodal_forces(np.asarray(history.displacement[i]), unstrained)
            total[rows] = np.where(np.isnan(total[rows]), 0.0, total[rows]) + forces
        for slave, _, master in (pair.partition("/") for pair in self.prints.pairs):
            for name in (slave, master):
                total[surface_rows(self.content, name)] = np.nan
        self._forces = time, total
        return total

    def tensors(self, word: str, time: float) -> Array:
        """Stress (S), strain (E) or mechanical strain (ME) at all nodes (n_point, 6): means over the elements around of
        all parts, NaN elsewhere."""
        total = np.zeros((len(self.content.points), 6))
        count = np.zeros(len(total))
        for group, part in self.prints.parts.items():
            recovered, history = self.solution.recovered.get(part), self.solution.substructures.get(part)
            if recovered is None or history is None or history.displacement is None:
                continue
            i = int(np.abs(history.time - time).argmin())
            moved = np.asarray(history.displacement[i])[None]
            if word == "E":
                values = recovered.recovery.strain_of(recovered.recovery.nodal_stress(moved)[0])
            else:
                values = recovered.stress_at_nodes(moved, history.time[i : i + 1])[0]
            if word == "ME":
                values = recovered.recovery.strain_of(values)
            cells = [self.content.solids[kind][rows].ravel() for kind, rows in self.content.volumes[group].items()]
            around = np.bincount(np.concatenate(cells), minlength=len(total))
            rows = self._rows_of[group]
            total[rows] += around[rows, None] * values
            count[rows] += around[rows]
        count[count == 0.0] = np.nan
        return np.asarray(total / count[:, None])

    def _along_local_axes(self, rows: Index, values: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Values along the axes of *TRANSFORM where these are the same at all its nodes, and which rows these are."""
        assert self.content.deck is not None
        along, turned = values.copy(), np.zeros(len(rows), dtype=bool)
        for name, axes in self.content.deck.transforms.items():
            if axes is None:
                continue
            x, y = np.array(axes[0]), np.array(axes[1])
            z = np.cross(x, y)
            system = np.array([x, np.cross(z, x), z])
            system /= np.linalg.norm(system, axis=1, keepdims=True)
            inside = np.isin(rows, rows_of_set(self.content, name))
            along[inside] = values[inside] @ system.T
            turned |= inside
        return along, turned

    # -- elements ------------------------------------------------------------------------------------------------
    def of_elements(self, word: str, request: PrintRequest, instant: PrintInstant) -> Iterator[DatBlock]:
        """A block of elements, and the sum of volumes or energies where it is asked for."""
        found = list(self._elements(request.target, instant.scene))
        if not found:
            return
        if word in ("EVOL", "ELSE"):
            labels = np.concatenate([labels for labels, *_ in found])
            values = np.concatenate([_of_cells(word, *fields) for _, *fields in found])[:, None]
            order = np.argsort(labels, kind="stable")
            if request.totals != "ONLY":
                yield DatBlock(word, request.target, instant.deck, labels[order, None], values[order])
            if request.totals != "NO":
                none = np.zeros((1, 0), dtype=np.int64)
                yield DatBlock(f"total {word}", request.target, instant.deck, none, values.sum(axis=0)[None])
            return
        tables, rows = [], []
        for labels, *fields in found:
            values = _at_points(word, *fields)
            count = values.shape[1]
            numbers = np.tile(np.arange(1, count + 1), len(labels))
            tables.append(np.stack([np.repeat(labels, count), numbers], axis=1))
            rows.append(values.reshape(len(labels) * count, -1))
        table, values = np.concatenate(tables), np.concatenate(rows)
        order = np.lexsort((table[:, 1], table[:, 0]))
        yield DatBlock(word, request.target, instant.deck, table[order], values[order])

    def _elements(self, elset: str, time: float) -> Iterator[tuple[Index, Array, Array, Array, Array]]:
        """Of the elements of a set, by part and type: labels (n,), strain, mechanical strain and stress (n, p, 6),
        volumes (n, p)."""
        name = {key.upper(): key for key in self.content.volumes}[elset]
        for group, part in self.prints.parts.items():
            recovered, history = self.solution.recovered.get(part), self.solution.substructures.get(part)
            if recovered is None or history is None or history.displacement is None:
                continue
            i = int(np.abs(history.time - time).argmin())
            first = 0
            for number, (kind, cells) in enumerate(self.content.volumes[group].items()):
                for word, of_type in self.content.types.items():
                    wanted = np.intersect1d(
                        self.content.volumes[name].get(kind, cells[:0]), of_type.get(kind, cells[:0])
                    )
                    rows = np.flatnonzero(np.isin(cells, wanted))
                    if not len(rows):
                        continue
                    moved = np.asarray(history.displacement[i])
                    strain, stress, volumes = recovered.recovery.at_points(moved, number, rows, point_rule(word))
                    mechanical = strain
                    if recovered.unstrained is not None:
                        free = recovered.unstrained(history.time[i : i + 1])[0]
                        extra = free[(first + rows) % len(free), None, :]
                        mechanical = strain + recovered.recovery.strain_of(extra)
                        stress = stress + extra
                    yield self.content.cell_labels[kind][cells[rows]], strain, mechanical, stress, volumes
                first += len(cells)

    # -- contacts ------------------------------------------------------------------------------------------------
    def of_contact(self, request: PrintRequest, instant: PrintInstant) -> Iterator[DatBlock]:
        """Statistics of the force on the slave of a pair."""
        outcome = self.solution.outcome
        found = [self.solution.interfaces[name] for name in self.prints.pairs.get(request.target, ())]
        if not found:
            return
        i = int(np.abs(outcome.interface_time - instant.scene).argmin())
        values = _statistics(found, i)[None]
        yield DatBlock("CF", request.target, instant.deck, np.zeros((1, 0), dtype=np.int64), values)


def _at_points(word: str, strain: Array, mechanical: Array, stress: Array, volumes: Array) -> Array:
    """Values (n, p, m) of elements at points by the word of the deck."""
    del volumes
    if word == "ENER":
        return _density(mechanical, stress)[..., None]
    return {"S": stress, "E": strain, "ME": mechanical}[word][..., _ORDER]


def _of_cells(word: str, strain: Array, mechanical: Array, stress: Array, volumes: Array) -> Array:
    """Volume or energy (n,) of elements."""
    del strain
    if word == "EVOL":
        return np.asarray(volumes.sum(axis=1))
    return np.asarray((_density(mechanical, stress) * volumes).sum(axis=1))


def _density(strain: Array, stress: Array) -> Array:
    """Energy over volume sigma : eps / 2 of tensors (..., 6)."""
    twice = np.where(np.arange(len(ROWS)) < 3, 1.0, 2.0)
    return np.asarray(0.5 * (strain * stress * twice).sum(axis=-1))


def _statistics(histories: list[InterfaceHistory], i: int) -> Array:
    """Force and moment about the origin, middle and normal of the closed points, moment about the middle, area, normal
    and shear force (18,), on the slave."""
    traction = np.concatenate([history.traction[i] for history in histories])
    areas = np.concatenate([history.areas for history in histories])
    points = np.concatenate([history.points for history in histories])
    normals = np.concatenate([history.normals for history in histories])
    forces = areas[:, None] * traction
    pushed = np.linalg.norm(traction, axis=1)
    closed = pushed > _PRESSED * max(float(pushed.max()), 1e-300)
    area = float(areas[closed].sum())
    total, moment = forces.sum(axis=0), np.cross(points, forces).sum(axis=0)
    middle = np.zeros(3)
    normal = np.zeros(3)
    if area > 0.0:
        middle = areas[closed] @ points[closed] / area
        normal = areas[closed] @ normals[closed] / area
    length = float(np.linalg.norm(normal)) or 1.0
    along = float(total @ normal) / length
    shear = float(np.linalg.norm(total - along * normal / length))
    about = np.cross(points - middle, forces).sum(axis=0)
    return np.array([*total, *moment, *middle, *(normal / length), *about, area, along, shear])
