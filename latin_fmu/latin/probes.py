"""What a run keeps of its substructures at every instant: sliding without friction, sensors, reactions, bolts, and
the fields of small substructures where they are stored.

The rows of all go into the image of the run, so that the march of many instants in one call keeps them too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..propagator.image import Image
from ..propagator.model import SubstructureModel
from .assembly import Array, Assembly
from .outcome import BoltHistory, SensorHistory
from .reactions import Support, SupportProbes


@dataclass(frozen=True)
class SensorPlace:
    """Where a sensor is.

    Attributes
    ----------
    substructure : its body. rows : (3, 3 n_node) its motion from those of all nodes. point : (3,) of a point sensor,
        the centre of the face for the mean over a face, reference configuration, m.
    face : that a mean, or the arm to a point, is of, else None.
    """

    substructure: str
    rows: sp.csr_array
    point: Array
    face: str | None = None


def nodes_of(model: SubstructureModel) -> sp.csr_array:
    """Matrix (3 n_node, n_dof) from the dofs of a substructure to the vectors at its nodes."""
    return model.expansion if model.nodal is None else sp.csr_array(model.nodal @ model.expansion)


def _stacked(parts: Sequence[sp.csr_array]) -> sp.csr_array | None:
    """Rows of all parts; None where there are none."""
    if len(parts) < 2:
        return parts[0] if parts else None
    return sp.csr_array(sp.vstack(parts))


class SensorProbes:
    """Motions of the sensors, read from the substructures.

    Attributes
    ----------
    rows : per class (n_row, n_dof) from the dofs of a member to its sensors, x y z of one after the other.
    places : sensor, class, member and rows of each sensor. shapes : per class (n_row, n_motion) of prescribed motions.
    massless : sensors on nodes without mass.
    """

    def __init__(self, assembly: Assembly, places: Mapping[str, SensorPlace]) -> None:
        self.places: list[tuple[str, int, int, slice]] = []  # sensor, class, member, rows
        self.rows: list[sp.csr_array] = []
        self.shapes: list[Array] = []  # per class (n_row, n_motion) of prescribed motions
        self.massless: set[str] = set()
        for c, propagator in enumerate(assembly.propagators):
            model = propagator.members[0]
            here = {name: place for name, place in places.items() if place.substructure in propagator.names}
            if not here:
                self.rows.append(sp.csr_array((0, propagator.n_dof)))
                self.shapes.append(np.zeros((0, model.imposed_pattern.shape[1])))
                continue
            full = sp.csr_array(sp.vstack([place.rows for place in here.values()]))
            full = full if model.nodal is None else sp.csr_array(full @ model.nodal)
            rows = sp.csr_array(full @ model.expansion)
            without_mass = rows[:, propagator.operators.massless]
            for i, (name, place) in enumerate(here.items()):
                part = slice(3 * i, 3 * i + 3)
                self.places.append((name, c, propagator.names.index(place.substructure), part))
                if without_mass[part].nnz:
                    self.massless.add(name)
            self.rows.append(rows)
            self.shapes.append(np.asarray(full @ model.imposed_pattern))

    def read(
        self, assembly: Assembly, sensed: Sequence[Array | None], instants: slice, motions: Mapping[str, Array]
    ) -> None:
        """Write the motions at these instants into ``motions``: (n_time, 3, 3) by sensor, displacement, velocity and
        acceleration. ``sensed`` : per class (n, 3, n_row, n_member) those of ``rows``."""
        for name, c, member, part in self.places:
            kept = sensed[c]
            assert kept is not None
            values = kept[:, :, part, member]
            imposed = assembly.propagators[c].forcing.motion_histories(member)
            if imposed is not None:
                shapes = self.shapes[c][part]
                values = values + np.stack([field[instants] @ shapes.T for field in imposed], axis=1)
            motions[name][instants] = values

    def histories(
        self, assembly: Assembly, places: Mapping[str, SensorPlace], motions: Mapping[str, Array]
    ) -> dict[str, SensorHistory]:
        """Histories of the sensors from motions (n, 3, 3)."""
        histories = {}
        for name, place in places.items():
            displacement, velocity, acceleration = motions[name].transpose(1, 0, 2)
            remark = "mean over the step that ends at the instant" if assembly.scheme.explicit else ""
            if assembly.quasi_static:
                acceleration, remark = None, "quasi-static run: no inertia, time only orders the increments of load"
            elif name in self.massless:
                remark = "difference quotient of the velocity: nodes in contact have no mass in this time scheme"
                acceleration = np.concatenate([acceleration[:1], np.diff(velocity, axis=0) / assembly.dt])
            histories[name] = SensorHistory(
                name, place.substructure, place.face, place.point, displacement, velocity, acceleration, remark
            )
        return histories


@dataclass(frozen=True)
class BoltPlace:
    """A tightened bolt: its tension is F = stiffness * shortening - pattern . u, the resultant along the axis of the
    internal forces on its cut.

    Attributes
    ----------
    substructure : its body. pattern : (n_full,) forces on the nodes per shortening, N m-1. stiffness : N m-1.
    description : its history in the results, without instants.
    """

    substructure: str
    pattern: Array
    stiffness: float
    description: BoltHistory

    def force(self, projection: Array) -> Array:
        """Tension, N, where pattern . u is ``projection``, N."""
        return np.asarray(self.stiffness * self.description.shortening - projection)


class BoltProbes:
    """Tensions of the bolts, read from the displacements of their substructures.

    Attributes
    ----------
    rows : per class (n_row, n_dof), one for each bolt. places : bolt, class, member, row, and (n_motion,) what
        prescribed motions add.
    """

    def __init__(self, assembly: Assembly, bolts: Mapping[str, BoltPlace]) -> None:
        self.rows: list[sp.csr_array] = []
        self.places: list[tuple[str, int, int, int, Array]] = []  # bolt, class, member, row, shapes of motions
        for c, propagator in enumerate(assembly.propagators):
            model = propagator.members[0]
            blocks: list[Array] = []
            for name, bolt in bolts.items():
                if bolt.substructure in propagator.names:
                    full = bolt.pattern if model.nodal is None else bolt.pattern @ model.nodal
                    member = propagator.names.index(bolt.substructure)
                    self.places.append((name, c, member, len(blocks), full @ model.imposed_pattern))
                    blocks.append(full[None])
            rows = sp.csr_array(sp.csr_array(np.concatenate(blocks)) @ model.expansion) if blocks else None
            self.rows.append(sp.csr_array((0, propagator.n_dof)) if rows is None else rows)

    def read(
        self,
        assembly: Assembly,
        sensed: Sequence[Array | None],
        instants: slice,
        bolts: Mapping[str, BoltPlace],
        tensions: Mapping[str, Array],
    ) -> None:
        """Write the tensions at these instants into ``tensions``, (n_time,) by bolt; ``sensed`` : as for
        ``SensorProbes.read``."""
        for name, c, member, row, shapes in self.places:
            kept = sensed[c]
            assert kept is not None
            values = kept[:, 0, row, member]
            imposed = assembly.propagators[c].forcing.motion_histories(member)
            if imposed is not None:
                values = values + imposed[0][instants] @ shapes
            tensions[name][instants] = bolts[name].force(values)


class Probes:
    """All kinds for one run.

    Parameters
    ----------
    sliding : numbers of the interfaces without tangential unknowns. places : of the sensors. supports : whose reactions
        are kept. bolts : whose tensions are kept. whole : whether all nodes are among the rows, for ``fields``.

    Attributes
    ----------
    rows : per class (n_row, n_dof) of sensors, supports and bolts whose motions the image keeps, None where there are
        none.
    """

    def __init__(
        self,
        assembly: Assembly,
        sliding: Sequence[int],
        places: Mapping[str, SensorPlace],
        supports: Mapping[str, Support],
        bolts: Mapping[str, BoltPlace],
        whole: bool = False,
    ) -> None:
        self.slide = SlideProbes(assembly, sliding)
        self.sensors, self.supports = SensorProbes(assembly, places), SupportProbes(assembly, supports)
        self.bolts, self._bolts = BoltProbes(assembly, bolts), bolts
        self._propagators, self.whole = assembly.propagators, whole
        self._nodes = [nodes_of(p.members[0]) if whole else sp.csr_array((0, p.n_dof)) for p in self._propagators]
        every = zip(self.sensors.rows, self.supports.rows, self.bolts.rows, self._nodes, strict=True)
        self.rows = [_stacked([rows for rows in own if rows.shape[0]]) for own in every]

    def read(
        self,
        assembly: Assembly,
        image: Image,
        instants: slice,
        rows: slice,
        motions: Mapping[str, Array],
        forces: Mapping[str, Array],
        tensions: Mapping[str, Array],
    ) -> None:
        """Write the ``motions`` of the sensors, the parts of the reaction ``forces`` and the ``tensions`` of the bolts
        at these instants, ``rows`` of the output of the image."""
        own: list[Array | None] = [None] * len(self.rows)
        others: list[Array | None] = [None] * len(self.rows)
        last: list[Array | None] = [None] * len(self.rows)
        for c, matrix in enumerate(self.rows):
            if matrix is not None:
                kept = image.output(c, "sensed", 3 * matrix.shape[0])[rows]
                kept = kept.reshape(len(kept), 3, matrix.shape[0], -1)
                ends = np.cumsum([part.rows[c].shape[0] for part in (self.sensors, self.supports, self.bolts)])
                own[c], others[c], last[c], _ = np.split(kept, ends, axis=2)
        self.sensors.read(assembly, own, instants, motions)
        self.bolts.read(assembly, last, instants, self._bolts, tensions)
        if forces:
            tractions = image.field("history_f", image.rows, image.n_flat)[rows]
            self.supports.read(assembly, others, tractions, instants, forces)

    def fields(self, image: Image, c: int, member: int, kind: int, rows: slice, instants: Sequence[int]) -> Array:
        """Displacements (``kind`` 0, m) or velocities (1, m s-1) of all nodes of a member, (n, n_node, 3), in ``rows``
        of the output, those at ``instants``; where they are kept ``whole``."""
        propagator, matrix = self._propagators[c], self.rows[c]
        assert matrix is not None
        kept = image.output(c, "sensed", 3 * matrix.shape[0])[rows]
        nodes = self._nodes[c].shape[0]
        values = kept.reshape(len(kept), 3, matrix.shape[0], -1)[:, kind, -nodes:, member]
        values = values.copy().reshape(len(kept), -1, 3)  # the next call of the kernels writes there
        if not propagator.forcing.moves:
            return values
        imposed = (propagator.forcing.imposed_u, propagator.forcing.imposed_v)[kind]
        return values + np.stack([propagator.members[member].node_values(imposed(t)[:, member]) for t in instants])


class SlideProbes:
    """Tangential velocities of frictionless interfaces, read from the substructures.

    Such interfaces have no tangential unknowns; every point needs the velocity of its node on each side.

    Parameters
    ----------
    interfaces : numbers of the interfaces without tangential unknowns.

    Attributes
    ----------
    rows : per class (n_probe, n_dof) rows of the nodes of those faces, x y z of one point after the other; None
        where a class has none.
    places : class, member, rows, interface and side. traces : per class (n_probe, n_full) from all dofs. ground : those
        against ground.
    """

    def __init__(self, assembly: Assembly, interfaces: Sequence[int]) -> None:
        propagators = self._propagators = assembly.propagators
        self.ground = [i for i in interfaces if assembly.interfaces[i].against_ground]
        self.places: list[tuple[int, int, slice, int, int]] = []  # class, member, rows, interface, side
        faces: list[list[sp.csr_array]] = [[] for _ in propagators]
        self.traces: list[sp.csr_array | None] = []
        for c, propagator in enumerate(propagators):
            for member, name in enumerate(propagator.names):
                at = 0
                for i in interfaces:
                    unit = assembly.interfaces[i]
                    for side, face in enumerate(unit.sides):
                        trace = unit.geometry.traces[side]
                        if trace is None or face.split(".")[0] != name:
                            continue
                        if member == 0:
                            faces[c].append(trace)
                        self.places.append((c, member, slice(at, at + trace.shape[0]), i, side))
                        at += trace.shape[0]
            full = _stacked(faces[c])
            nodal = propagator.members[0].nodal
            self.traces.append(full if full is None or nodal is None else sp.csr_array(full @ nodal))
        self.rows = [
            None if full is None else sp.csr_array(full @ propagator.members[0].expansion)
            for full, propagator in zip(self.traces, propagators, strict=True)
        ]

    def read(
        self, assembly: Assembly, instants: slice, into: slice, probed: Sequence[Array], slide: Mapping[int, Array]
    ) -> None:
        """Write the velocities ``probed`` (n, n_probe, n_member) per class at n instants into rows of ``slide``,
        (n_row, 2, n_point, 3) per interface."""
        for c, member, rows, i, side in self.places:
            values = probed[c][:, rows, member]
            forcing, trace = self._propagators[c].forcing, self.traces[c]
            if forcing.moves and trace is not None:
                part = sp.csr_array(trace[rows])
                imposed = [
                    part @ forcing.imposed_v(t)[:, member] for t in range(instants.start, instants.stop, instants.step)
                ]
                values = values + np.stack(imposed) if imposed else values
            slide[i][into, side] = values.reshape(len(values), values.shape[1] // 3, 3)
        for i in self.ground:
            slide[i][into, 1] = assembly.ground[i][instants][:, None]
