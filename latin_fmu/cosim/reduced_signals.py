"""Outputs of a run by communication steps whose assembly is marched by its modes (``joined.reduced_run``).

Contacts are interfaces of the march, and their outputs those of any other; motions of the bodies, forces of bonds and
tensions of bolts are rows of the motion of all bodies (``joined.motion_rows``). With u = (basis a) + R r + B d they are
linear in what the march has at an instant: modes zeta, relative motions r, loads f and motions d of driven faces. Of r,
of which the rows of all outputs take few combinations, the image keeps these: the right singular vectors of R.

Rates of r are those of the scheme, rates of loads those over the last step: of first order in the step, where a run,
which knows the instants that follow, has central differences. Accelerations of r and of loads have no part in forces.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from ..assembly.supports import port_key
from ..joined.motion_rows import RowShares, bond_rows, carried_rows, mean_rows, row_shares, spring_rows
from ..joined.reduced_run import NAME, DrivePlace, MotionPlace, ReducedMarch, drive_places
from ..joined.tied_assembly import DAMPING, MASS, STIFFNESS, STRAINED, placed
from ..latin.assembly import Array, Index
from ..latin.probes import OutputRequest
from ..latin.recorder import Recorder
from ..propagator.forcing import STRAIN
from ..scene.schema import Scene
from .drives import Drives
from .signals import Signals

_LEFT_OUT: Final = 1e-7  # of the rows of all outputs on relative motions, each of length 1: singular values below
_ROUNDED: Final = 1e-7  # of these rows, what the digits of a combination that are left out amount to, thrice
_READ: Final = "outputs"


@dataclass(frozen=True)
class OutputRows:
    """Rows of the motion of all bodies that outputs read, and what they read of the march.

    Attributes
    ----------
    places : rows of each reading by kind and name. shares : of all rows. combined : (n, k) of the rows, by combinations
    (k, n_r) of the relative motions, ``combinations``. bonds : rows that give sums of tractions of bonds by the forces
    g on the bodies: (4, n_full) resultants by name of the interface, (3, n_full) those on held dofs by ``_held``.
    """

    places: Mapping[tuple[str, str], slice]
    shares: RowShares
    combined: Array
    combinations: Array
    bonds: Mapping[str, sp.csr_array]

    @staticmethod
    def of(march: ReducedMarch, request: OutputRequest) -> OutputRows:
        """Of sensors, supports and bolts of a request, and of the interfaces that are no contacts."""
        tied, units = march.tied, march.bodies.interfaces
        models = {model.name: model for model in tied.models}
        rows = dict[tuple[str, str], sp.csr_array]()
        for kind in ("motion", "force", "tension"):
            for name, place in request.places(kind).items():
                model = models[place.substructure]
                full = place.full_rows(model, False)
                # of a bolt the cut alone
                if kind == "tension":
                    full = full[:6]
                if model.nodal is not None:
                    full = full @ model.nodal
                rows[kind, name] = placed(tied.where[place.substructure], tied.trace.shape[1], full)
        for i, unit in enumerate(units):
            for side in (0, 1):
                if unit.geometry.traces[side] is not None:
                    rows[f"side {side}", unit.name] = mean_rows(march, i, side)
        bonds = {units[i].name: of_bond for i, of_bond in bond_rows(march).items()}
        for name, support in request.supports.items():
            bonds[_held(name)], rows["held", name] = carried_rows(march, support)
        relaxing = [name for name, model in models.items() if len(model.branches)]
        for name, of_bond in bonds.items():
            stiff = sp.csr_array(tied.rows_times(STIFFNESS, of_bond, [*models]) + of_bond @ tied.springs)
            rows["stiffness", name] = stiff
            for kind, number in (("damping", DAMPING), ("mass", MASS)):
                rows[kind, name] = tied.rows_times(number, of_bond, [*models])
            rows["strained", name] = tied.rows_times(STRAINED, of_bond, relaxing)
        for i in tied.joints.linear:
            rows["springs", units[i].name] = spring_rows(march, i)
        ends = np.cumsum([0, *(matrix.shape[0] for matrix in rows.values())]).tolist()
        places = {key: slice(*span) for key, span in zip(rows, itertools.pairwise(ends), strict=True)}
        shares = row_shares(march, sp.csr_array(sp.vstack([sp.csr_array((0, tied.trace.shape[1])), *rows.values()])))
        relative = shares.relative.copy()
        for (kind, _), part in places.items():  # accelerations of r are not taken
            relative[part][{"mass": slice(None), "force": slice(6, 9)}.get(kind, slice(0))] = 0.0
        return OutputRows(places, shares, *_combinations(relative), bonds)


def _held(support: str) -> str:
    """Name of the sums of tractions of bonds on the dofs that a support holds."""
    return f"held by {support}"


def _combinations(relative: Array) -> tuple[Array, Array]:
    """Rows (n, n_r) as sums (n, k) of few orthonormal combinations (k, n_r)."""
    sizes = np.linalg.norm(relative, axis=1)
    there = sizes > 0.0
    if not there.any():
        return np.zeros((len(relative), 0)), np.zeros((0, relative.shape[1]))
    _, values, vectors = np.linalg.svd(relative[there] / sizes[there, None], full_matrices=False)
    vectors = vectors[values > _LEFT_OUT]
    # digits that no row tells would double the size of an FMU: those of small singular values, and beyond float32
    steps = _ROUNDED / np.sqrt(relative.shape[1]) / values[: len(vectors), None]
    steps = np.exp2(np.floor(np.log2(np.maximum(steps, np.finfo(np.float32).eps * np.abs(vectors)))))
    return relative @ vectors.T, np.rint(vectors / steps) * steps


class ReducedSignals(Signals):
    """The outputs of a reduced assembly from the signals of its march."""

    def __init__(self, scene: Scene, drives: Drives, march: ReducedMarch, request: OutputRequest) -> None:
        self._march, self._of_bodies = march, request
        self._rows = OutputRows.of(march, request)
        m, n_r = march.reduced.n_mode, march.tied.n_relative
        read = sp.csr_array(sp.block_diag([sp.eye_array(m), sp.csr_array(self._rows.combinations)]))
        if not n_r:
            read = sp.csr_array(sp.eye_array(m))
        self.request = OutputRequest(faces={_READ: MotionPlace(NAME, read)})
        super().__init__(scene, drives, Recorder(march.assembly, self.request, {}))
        self._places = drive_places(march.tied, drives.bodies)
        self._numbers = {unit.name: i for i, unit in enumerate(drives.bodies.interfaces)}

    # -- rows of the motion --------------------------------------------------------------------------------------------
    def _moved(self, key: tuple[str, str], kind: int) -> sp.csr_array:
        """Displacements (0), velocities (1), accelerations (2) of rows of the motion (k, n), or what branches of the
        bodies add to displacements in internal forces (``STRAIN``)."""
        march, part, shares = self._march, self._rows.places[key], self._rows.shares
        reduced, m = march.reduced, march.reduced.n_mode
        first, n_load = reduced.rigid.shape[1], len(self._places)
        basis, place = shares.basis[part], self.probes.places["path"][_READ]
        rows = sp.lil_array((basis.shape[0], self.n))
        if kind == STRAIN and not len(self._assembly.propagators[0].branches):
            return sp.csr_array(rows)
        modal = [self._sensor(0, kind, place.part.start + j, 0) for j in range(place.part.stop - place.part.start)]
        rows[:, modal[:m]] = basis[:, :m]
        if kind != 2:
            rows[:, modal[m:]] = self._rows.combined[part]
        # loads beside what the modes have of them at rest
        static = reduced.drives[first:m] / reduced.marched.values[:, None]
        loads = basis[:, m:] - basis[:, first:m] @ static
        for k in range(n_load):
            self._add_drive(rows, k, kind, loads[:, k])
        for k in range(march.tied.driven.shape[1]):
            place_of_motion = self._places[n_load - march.tied.driven.shape[1] + k]
            self._add_motion(rows, place_of_motion, kind, shares.driven[part, k])
        return sp.csr_array(rows)

    def _add_motion(self, rows: sp.lil_array, place: DrivePlace, kind: int, column: Array) -> None:
        """Add the motion of a driven face, or what the branches of its body make of it, times a column (k,)."""
        weights = {kind: 1.0}
        if kind == STRAIN:
            weights = {STRAIN + j: g for j, g in enumerate(self._bodies.propagators[place.number].branches.strengths)}
        for what, weight in weights.items():
            self._add_column(rows, self._motion(place.number, what, place.entry, place.member), weight * column)

    def _add_drive(self, rows: sp.lil_array, k: int, kind: int, column: Array) -> None:
        """Add the amplitude of a drive (0), its rate over the last step (1), nothing for its acceleration (2), or what
        the branches of the bodies make of it (``STRAIN``), times a column (k,)."""
        place = self._places[k]
        if kind == STRAIN:
            self._add_strain_of(rows, k, column)
            return
        if kind == 2:
            return
        if place.kind is not None:
            # the rate of an acceleration is not known
            if place.kind + kind < 3:
                at = self._motion(place.number, place.kind + kind, place.entry, place.member)
                rows[:, [at]] += column[:, None]
            return
        member = self._bodies.propagators[place.number].forcing.members[place.member]
        source = self._source(member.loads[place.entry].name)
        if kind == 0:
            constant = place.amplitude(self._bodies)[0] if source is None else 1.0
            self._add_column(rows, self._one if source is None else source, constant * column)
        elif source is not None:
            self._add_column(rows, source, column / self._drives.dt)
            self._add_column(rows, source - len(self._drives.sources), -column / self._drives.dt)

    def _add_strain_of(self, rows: sp.lil_array, k: int, column: Array) -> None:
        """Add what the branches of the bodies make of a drive."""
        strains = self._drives.strains
        at = strains.place(k)
        if at is None:
            return
        for j, strength in enumerate(strains.branches.strengths):
            self._add_column(rows, self._drive + self._drives.n_moved + at + j, strength * column)

    def _add_column(self, rows: Any, at: int, column: Array) -> None:
        """Add a column (k,) to the one at a place."""
        rows[:, [at]] += column[:, None]

    def motion(self, name: str, kind: int) -> sp.csr_array:
        """Displacement (0) or velocity (1) of a sensor, or of a port by its key."""
        return self._moved(("motion", name), kind)

    def exerted(self, name: str, turned: int) -> sp.csr_array:
        """Force that the body exerts through a port that is moved, or its moment."""
        key = port_key(name, turned=bool(turned))
        place = self._of_bodies.supports[key]
        parts = [self._moved(("force", key), kind)[3 * kind : 3 * kind + 3] for kind in range(3)]
        number, member = self._place_of(place.substructure)
        if len(self._bodies.propagators[number].branches):
            parts.append(self._moved(("force", key), STRAIN)[:3])
        total = sp.lil_array(sp.csr_array(sum(parts[1:], start=parts[0])))
        forcing = self._bodies.propagators[number].forcing
        for axis in range(3):
            terms = zip(forcing.members[member].loads, forcing.amplitudes[member], place.loads, strict=True)
            for load, amplitude, resultant in terms:
                self._add_load(total, axis, load.name, amplitude, -resultant[axis])
        carried = sp.csr_array(place.spread.T) @ self._tractions(self._bodies.channels[number][:, member])
        carried = carried + self._sums_of_bonds(_held(key)) + self._moved(("held", key), 0)
        return -sp.csr_array(sp.csr_array(total) - carried)

    def _place_of(self, substructure: str) -> tuple[int, int]:
        """Class and member of a body."""
        propagators = self._bodies.propagators
        return next((c, p.names.index(substructure)) for c, p in enumerate(propagators) if substructure in p.names)

    def _tractions(self, channels: Index) -> sp.csr_array:
        """Tractions (k, n), Pa, of contacts at channels of the interfaces of the bodies; zero for bonds and springs."""
        layout, inner = self._bodies.layout, self._assembly.layout
        where = np.full(layout.n_flat, -1, dtype=np.int64)
        for j, i in enumerate(self._march.units):
            for side in (0, 1):
                where[layout.channels(i, side)] = inner.channels(j, side)
        at = where[channels]
        there = np.flatnonzero(at >= 0)
        values = np.ones(len(there)), (there, at[there])
        return sp.csr_array(sp.coo_array(values, shape=(len(channels), self.n)))

    def differenced(self, _name: str, /) -> bool:
        """Whether the acceleration of a sensor is the rate of its velocity: relative motions have none."""
        return True

    def shank(self, name: str, which: Sequence[int]) -> sp.csr_array:
        """Resultants of the shank of a bolt at its cut."""
        bolt = self._of_bodies.bolts[name]
        number, member = self._place_of(bolt.substructure)
        strained = self._moved(("tension", name), 0)
        if len(self._bodies.propagators[number].branches):
            strained = strained + self._moved(("tension", name), STRAIN)
        rows = sp.lil_array(-strained[list(which)])
        forcing = self._bodies.propagators[number].forcing
        for row, k in enumerate(which):
            for load, amplitude in zip(forcing.members[member].loads, forcing.amplitudes[member], strict=True):
                self._add_load(rows, row, load.name, amplitude, bolt.cut_term(load.name, k))
        return sp.csr_array(rows)

    # -- interfaces ----------------------------------------------------------------------------------------------------
    def linear_of(self, name: str, row_matrix: sp.csr_array) -> dict[str, sp.csr_array]:
        """Linear outputs of an interface from the signals, by the names of their rows."""
        i = self._numbers[name]
        unit = self._bodies.interfaces[i]
        rows = dict[str, sp.csr_array]()
        if i in self._march.units:
            rows |= self._interface_rows(self._march.units.index(i), row_matrix)
        else:
            forces = self._sums_of_bonds(name) if name in self._rows.bonds else self._moved(("springs", name), 0)
            rows |= {"force": sp.csr_array(forces[:3]), "normalForce": sp.csr_array(forces[3:])}
        if not unit.against_ground:
            sides = [self._moved((f"side {side}", name), 1) for side in (0, 1)]
            rows |= {"velocityE": sides[0], "velocityEp": sides[1]}
            if i not in self._march.units:
                rows["relativeVelocity"] = sp.csr_array(sides[1] - sides[0])
        elif i not in self._march.units:
            first = self._moved(("side 0", name), 1)
            rows |= {"velocityE": first, "velocityEp": sp.csr_array(first.shape), "relativeVelocity": -first}
        return rows

    def _sums_of_bonds(self, name: str) -> sp.csr_array:
        """Sums of tractions of bonds (k, n), from the equilibrium of the bodies that they join."""
        march, rows = self._march, self._rows.bonds[name]
        parts = [self._moved((part, name), kind) for kind, part in enumerate(("stiffness", "damping", "mass"))]
        total = sp.lil_array(parts[0] + parts[1] + parts[2] + self._moved(("strained", name), STRAIN))
        loads = rows @ march.drives.forces[:, : march.drives.n_load]
        for k in range(march.drives.n_load):
            self._add_drive(total, k, 0, -np.asarray(loads[:, k]))
        tied, layout = march.tied, march.bodies.layout
        carried = sp.csr_array(rows @ tied.trace.T @ sp.diags_array(layout.area))
        return sp.csr_array(sp.csr_array(total) - carried @ self._tractions(np.arange(layout.n_flat, dtype=np.int64)))
