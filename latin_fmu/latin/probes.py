"""What a run keeps of its substructures at every instant: sliding without friction, sensors, reactions, bolts, and
the fields of small substructures where they are stored.

The rows of all go into the image of the run, so that the march of many instants in one call keeps them too.

A reaction is the resultant force of a support, from the equation of motion at the dofs that it holds. With e the sum
over these dofs, component by component (of a dof that several supports hold, the share of each), and F the tractions of
the interfaces,

    R = e (M a + C v + K y) - e f - e T^T area F

is the force that the support exerts on the body; y is u, and what Maxwell branches add to it (``kernels.maxwell``).
u, v and a are those of the instants; in explicit schemes, whose
accelerations and tractions are means over a step, K u, C v and f are means over it, too. Implicit schemes that weight
the forces of two instants satisfy the equation of motion at an instant up to their own order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
import scipy.sparse as sp

from ..propagator.forcing import STRAIN
from ..propagator.image import Image
from ..propagator.model import SubstructureModel, node_values
from .assembly import Array, Assembly
from .outcome import BoltHistory, ReactionHistory, SensorHistory

SERIES: Final[Mapping[str, tuple[str, tuple[int, ...] | None]]] = {
    "motion": ("sensors", (3, 3)),  # displacement, velocity, acceleration
    "force": ("supports", (2, 3)),  # of the reaction: what explicit schemes take as a mean over the step, and the rest
    "tension": ("bolts", None),
    "path": ("faces", None),
}
"""What is kept at every instant: field of the request with the places, and shape; None where it is that of a place."""


class Measured(Protocol):
    """A place on a substructure whose rows of motions give a series."""

    @property
    def substructure(self) -> str:
        """Name of the body."""

    def full_rows(self, model: SubstructureModel, explicit: bool, /) -> sp.csr_array | Array:
        """Rows (k, n_full), of all nodes where the model has shapes, of what is read from the motion of the body."""

    def read(self, values: Array, of: Reading, /) -> Array:
        """The series (n, ...) from the rows of displacements, velocities and accelerations (n, 3, k), with Maxwell
        branches (n, 4, k): what these add to the displacements in the internal forces."""


def _strained(values: Array) -> Array:
    """Displacements (n, k) that the stiffness takes in the internal forces: with what Maxwell branches add."""
    if values.shape[1] == STRAIN:
        return values[:, 0]
    return values[:, 0] + values[:, STRAIN]


@dataclass(frozen=True)
class Reading:
    """Instants that are read: assembly, class and member of the body, instants, tractions (n, n_flat), Pa."""

    assembly: Assembly
    number: int
    member: int
    instants: slice
    tractions: Array


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

    def full_rows(self, _model: SubstructureModel, _explicit: bool, /) -> sp.csr_array | Array:
        """Those of the place."""
        return self.rows

    def read(self, values: Array, _of: Reading, /) -> Array:
        """The motion as it is."""
        return values[:, :STRAIN]


def by_instants(rows: Array, matrix: Array) -> Array:
    """The product of rows (n, k), one an instant, with a matrix (k, m), one row at a time.

    A product of many rows has other bits than those of each, and so has one of numbers that do not lie side by side; a
    run that goes on from a checkpoint has the bits of one in one go.
    """
    product = np.empty((len(rows), matrix.shape[1]))
    for row, result in zip(np.ascontiguousarray(rows), product, strict=True):
        np.dot(row, matrix, out=result)
    return product


@dataclass(frozen=True)
class Support:
    """A boundary condition that holds or drives dofs of an elastic substructure.

    Attributes
    ----------
    substructure, face : its body and face. model : of the substructure, with the matrices of its mesh.
    sum : e (3, n_full): what the support takes of forces on the nodes, summed up; components that other supports hold,
        too, by their shares (``assembly.supports.shared_out``).
    """

    substructure: str
    face: str
    model: SubstructureModel
    sum: sp.csr_array

    def full_rows(self, model: SubstructureModel, explicit: bool, /) -> sp.csr_array | Array:
        """e K, e C, e M one below the other, (9, n_full); explicit schemes have the lumped mass of ``model``."""
        # what the equation of motion of the march has: lumped in explicit schemes
        if explicit and model.nodal is None:
            mass = model.mass
        else:
            mass = self.model.mass
        e, nothing = self.sum, sp.csr_array((3, self.model.n_full))
        rows = [nothing] * 3
        for i, matrix in enumerate((self.model.stiffness, self.model.damping, mass)):
            if matrix is not None:
                rows[i] = e @ matrix
        if (modal := self.model.modal_rows) is not None:
            rows[1] = rows[1] + sp.csr_array((e @ modal.T) @ modal)
        return sp.csr_array(sp.vstack(rows))

    @cached_property
    def loads(self) -> Array:
        """Resultants on the held dofs for amplitude 1, (n_load, 3), N."""
        return np.array([self.sum @ load.pattern for load in self.model.loads]).reshape(-1, 3)

    @cached_property
    def spread(self) -> Array:
        """Resultants on the held dofs of unit tractions on the channels, (n_channel, 3), m2."""
        return np.asarray(self.model.channel_area[:, None] * (self.model.trace @ self.sum.T.toarray()))

    def read(self, values: Array, of: Reading, /) -> Array:
        """The two parts of the reaction (n, 2, 3), N: K u + C v - f, and M a less the tractions."""
        static = _strained(values)[:, :3] + values[:, 1, 3:6]  # rows: e K, e C, e M, three each
        amplitudes = of.assembly.propagators[of.number].forcing.amplitudes[of.member]
        for amplitude, load in zip(amplitudes, self.loads, strict=True):
            static = static - amplitude[of.instants, None] * load
        channels = of.assembly.channels[of.number][:, of.member]
        carried = by_instants(of.tractions[:, channels], self.spread)
        return np.stack([static, values[:, 2, 6:] - carried], axis=1)


@dataclass(frozen=True)
class BoltPlace:
    """A tightened bolt: resultants of the internal forces on sections of its shank, r = terms . amplitudes - pattern u;
    the first one is its tension, a change of temperature adds its own, a plastic elongation shortens it less.

    Attributes
    ----------
    substructure : its body. pattern : (6 n_section, n_full), of the cut first (``assembly.bolts``).
    description : its history in the results, without instants. terms : resultants (6 n_section,) where u = 0 by load
        terms of amplitude 1, N and N m: of the bolt itself, stiffness times its shortening, and of temperatures.
    """

    substructure: str
    pattern: sp.csr_array
    description: BoltHistory
    terms: Mapping[str, Array] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        """That of its series at an instant: sections, and axial force, two shear forces, torsion, two moments of
        each."""
        return self.pattern.shape[0] // 6, 6

    def cut_term(self, load: str, k: int) -> float:
        """Resultant k of the cut where u = 0 by a load term of amplitude 1, N or N m."""
        if load in self.terms:
            return float(self.terms[load][k])
        return 0.0

    def full_rows(self, _model: SubstructureModel, _explicit: bool, /) -> sp.csr_array | Array:
        """The pattern of all sections."""
        return self.pattern

    def read(self, values: Array, of: Reading, /) -> Array:
        """Resultants (n, n_section, 6), N and N m."""
        resultants = -_strained(values)
        forcing = of.assembly.propagators[of.number].forcing
        for load, amplitude in zip(forcing.members[of.member].loads, forcing.amplitudes[of.member], strict=True):
            if load.name in self.terms:
                resultants = resultants + amplitude[of.instants, None] * self.terms[load.name]
        return np.asarray(resultants.reshape(-1, *self.shape))


@dataclass(frozen=True)
class FacePlace:
    """Side of an interface that is left out of the run.

    Attributes
    ----------
    substructure : its body. trace : (3 n_point, 3 n_node) from the nodes to the points, global axes.
    """

    substructure: str
    trace: sp.csr_array

    @property
    def shape(self) -> tuple[int, int]:
        """That of its series at an instant."""
        return 2, self.trace.shape[0]

    def full_rows(self, _model: SubstructureModel, _explicit: bool, /) -> sp.csr_array | Array:
        """Those of the trace."""
        return self.trace

    def read(self, values: Array, _of: Reading, /) -> Array:
        """Displacements and velocities (n, 2, 3 n_point) of the points."""
        return values[:, :2]


@dataclass(frozen=True)
class OutputRequest:
    """What to keep: displacement and velocity fields, mean stress, energies; fields every ``every`` instants; the
    motion of sensors, the reactions of supports, the tensions of bolts and the paths of faces at every instant.

    interfaces_every : the histories of interfaces at every so many instants (``Recorder``).
    peak_duration : of the mean whose largest value is the peak force, s; None for a share of the contact.
    watch : whether the largest von Mises stresses of the bodies with a yield stress are kept.
    contacts_alone : whether nothing is read of single points but the contacts of an assembly that is marched by its
    modes; bond_resultants : whether the resultants of its bonds are then.
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
    faces: Mapping[str, FacePlace] = field(default_factory=dict)
    watch: bool = False
    contacts_alone: bool = False
    bond_resultants: bool = False

    def places(self, key: str) -> Mapping[str, Measured]:
        """Places of a kind of ``SERIES`` by name."""
        places: Mapping[str, Measured] = getattr(self, SERIES[key][0])
        return places

    def series(self, n_time: int) -> dict[str, dict[str, Array]]:
        """Room for what is kept at so many instants, by kind and name."""
        room: dict[str, dict[str, Array]] = {}
        for key, (_, shape) in SERIES.items():
            places: Mapping[str, Any] = self.places(key)
            room[key] = {n: np.zeros((n_time, *(p.shape if shape is None else shape))) for n, p in places.items()}
        return room


def nodes_of(model: SubstructureModel) -> sp.csr_array:
    """Matrix (3 n_node, n_dof) from the dofs of a substructure to the vectors at its nodes."""
    if model.nodal is None:
        return model.expansion
    return sp.csr_array(model.nodal @ model.expansion)


def _stacked(parts: Sequence[sp.csr_array]) -> sp.csr_array | None:
    """Rows of all parts; None where there are none."""
    if len(parts) < 2:
        if parts:
            return parts[0]
        return None
    return sp.csr_array(sp.vstack(parts))


@dataclass(frozen=True)
class ProbePlace:
    """A place among the classes: number of the class and of the member, rows among those of the class, and shapes
    (k, n_motion) of prescribed motions."""

    number: int
    member: int
    part: slice
    shapes: Array


class Probes:
    """What is read of the substructures in one run.

    Parameters
    ----------
    sliding : numbers of the interfaces without tangential unknowns. request : sensors, supports and bolts. whole :
        whether all nodes are among the rows, for ``fields``.

    Attributes
    ----------
    rows : per class (n_row, n_dof) whose motions the image keeps, None where there are none: sensors, then supports,
        bolts, and nodes.
    places : by kind of ``SERIES`` and name. massless : sensors on nodes without mass.
    """

    def __init__(self, assembly: Assembly, sliding: Sequence[int], request: OutputRequest, whole: bool = False) -> None:
        self.slide = SlideProbes(assembly, sliding)
        self._propagators = assembly.propagators
        self._request = request
        self.whole = whole
        self.places: dict[str, dict[str, ProbePlace]] = {key: {} for key in SERIES}
        self.massless: set[str] = set()
        self.rows: list[sp.csr_array | None] = []
        self._nodes: list[int] = []
        for c, propagator in enumerate(assembly.propagators):
            model = propagator.members[0]
            at = 0
            parts = dict[int, slice]()
            alive = []  # what is gone may give its number to another
            blocks = []
            for key in SERIES:
                for name, place in request.places(key).items():
                    if place.substructure not in propagator.names:
                        continue
                    full = place.full_rows(model, assembly.scheme.explicit)
                    number, member = id(full), propagator.names.index(place.substructure)
                    alive.append(full)
                    # models with shapes have other full dofs than the nodes
                    if model.nodal is not None:
                        full = full @ model.nodal
                    matrix = sp.csr_array(sp.csr_array(full) @ model.expansion)
                    if number not in parts:  # members may have the same rows
                        parts[number] = slice(at, at + matrix.shape[0])
                        blocks.append(matrix)
                        at += matrix.shape[0]
                    shapes = np.asarray(full @ model.imposed_pattern)
                    self.places[key][name] = ProbePlace(c, member, parts[number], shapes)
                    if key == "motion" and matrix[:, propagator.operators.massless].nnz:
                        self.massless.add(name)
            if whole:
                blocks += [nodes_of(model)]
                self._nodes.append(blocks[-1].shape[0])
            else:
                self._nodes.append(0)
            self.rows.append(_stacked(blocks))

    def _sensed(self, image: Image, c: int, rows: slice) -> Array | None:
        """Displacements, velocities, accelerations and, with Maxwell branches, strains of the rows of a class,
        (n, n_sensed, n_row, n_member)."""
        matrix = self.rows[c]
        if matrix is None:
            return None
        n = self._propagators[c].n_sensed
        output = image.output(c, "sensed", n * matrix.shape[0])[rows]
        return output.reshape(len(output), n, matrix.shape[0], -1)

    def read(
        self, assembly: Assembly, image: Image, instants: slice, rows: slice, series: Mapping[str, Mapping[str, Array]]
    ) -> None:
        """Write the ``series`` of all places at these instants, ``rows`` of the output of the image."""
        tractions = image.field("history_f", image.rows, image.n_flat)[rows]
        for key, places in self.places.items():
            for name, place in places.items():
                values = self.values(image, place, rows, instants)
                of = Reading(assembly, place.number, place.member, instants, tractions)
                series[key][name][instants] = self._request.places(key)[name].read(values, of)

    def values(self, image: Image, place: ProbePlace, rows: slice, instants: slice) -> Array:
        """Displacements, velocities, accelerations and, with Maxwell branches, strains (n, n_sensed, k) of a place at
        these instants, ``rows`` of the output of the image."""
        fields = self._sensed(image, place.number, rows)
        assert fields is not None
        values = fields[:, :, place.part, place.member]
        imposed = self._propagators[place.number].forcing.motion_histories(place.member)
        if imposed is None:
            return values
        return values + np.stack([by_instants(motion[instants], place.shapes.T) for motion in imposed], axis=1)

    def fields(self, image: Image, c: int, member: int, kind: int, rows: slice, instants: Sequence[int]) -> Array:
        """Displacements (``kind`` 0, m) or velocities (1, m s-1) of all nodes of a member, (n, n_node, 3), in ``rows``
        of the output, those at ``instants``; where they are kept ``whole``."""
        propagator, sensed = self._propagators[c], self._sensed(image, c, rows)
        assert sensed is not None
        values = sensed[:, kind, -self._nodes[c] :, member]
        values = values.copy().reshape(len(values), -1, 3)  # the next call of the kernels writes there
        if not propagator.forcing.moves:
            return values
        imposed = (propagator.forcing.imposed_u, propagator.forcing.imposed_v)[kind]
        return values + np.stack([node_values(propagator.members[member], imposed(t)[:, member]) for t in instants])


def sensor_histories(
    assembly: Assembly, places: Mapping[str, SensorPlace], motions: Mapping[str, Array], massless: set[str]
) -> dict[str, SensorHistory]:
    """Histories of the sensors from motions (n, 3, 3)."""
    histories = {}
    for name, place in places.items():
        displacement, velocity, acceleration = motions[name].transpose(1, 0, 2)
        if assembly.scheme.explicit:
            remark = "mean over the step that ends at the instant"
        else:
            remark = ""
        if assembly.quasi_static:
            acceleration, remark = None, "quasi-static run: no inertia, time only orders the increments of load"
        elif name in massless:
            remark = "difference quotient of the velocity: nodes in contact have no mass in this time scheme"
            acceleration = np.concatenate([acceleration[:1], np.diff(velocity, axis=0) / assembly.dt])
        histories[name] = SensorHistory(
            name, place.substructure, place.face, place.point, displacement, velocity, acceleration, remark
        )
    return histories


def reaction_histories(
    assembly: Assembly, supports: Mapping[str, Support], forces: Mapping[str, Array]
) -> dict[str, ReactionHistory]:
    """Reactions from their two parts (n, 2, 3)."""
    histories = {}
    for name, support in supports.items():
        static, inertia = forces[name].transpose(1, 0, 2)
        if assembly.scheme.explicit:
            # the equation of motion of a step takes K u, C v and f as means over it
            static = np.concatenate([static[:1], 0.5 * (static[1:] + static[:-1])])
        histories[name] = ReactionHistory(name, support.substructure, support.face, static + inertia)
    return histories


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
        self.rows: list[sp.csr_array | None] = []
        for c, propagator in enumerate(propagators):
            for member, name in enumerate(propagator.names):
                at = 0
                for i in interfaces:
                    unit = assembly.interfaces[i]
                    for side, face in enumerate(unit.sides):
                        trace = unit.geometry.traces[side]
                        if trace is None or face.split(".")[0] != name:
                            continue
                        if member == 0:  # the rows of all members are those of the first
                            faces[c].append(trace)
                        self.places.append((c, member, slice(at, at + trace.shape[0]), i, side))
                        at += trace.shape[0]
            full, rows = _stacked(faces[c]), None
            model = propagator.members[0]
            if full is not None and model.nodal is not None:
                full = sp.csr_array(full @ model.nodal)
            if full is not None:
                rows = sp.csr_array(full @ model.expansion)
            self.traces.append(full)
            self.rows.append(rows)

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
                if imposed:
                    values = values + np.stack(imposed)
            slide[i][into, side] = values.reshape(len(values), values.shape[1] // 3, 3)
        for i in self.ground:
            slide[i][into, 1] = assembly.ground.velocity[i][instants][:, None]
