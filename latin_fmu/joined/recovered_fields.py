"""What the bodies of a reduced assembly did: fields, interfaces, sensors, reactions and tensions from its march.

The motion of all bodies is a sum of few shapes: rigid motions and modes, static responses to loads, shapes that follow
driven faces, and static responses to relative motions. Of these there are as many as contacts have unknowns, but their
histories lie in a space of few dimensions (``reduced_assembly.compressed``), so that few solutions give all instants.

Bonds are no unknowns of the march. Their tractions F follow from the equilibrium of the bodies that they join,

    T^T area F = K u + C v + M a - f - (forces of the other interfaces)

(``bond_forces``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
import scipy.sparse as sp

from ..kernels.energy_parts import N_TERM
from ..latin.assembly import Array, Index
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import SubstructureHistory
from ..latin.probes import SERIES, OutputRequest, Reading
from ..latin.recorder import Recorder, SubstructureInfo
from ..machine import give_back_memory
from ..propagator.forcing import STRAIN
from ..propagator.model import SubstructureModel, closest_reduced, relaxing_part
from ..time_scheme import MasslessContact, MaxwellBranches
from .bond_forces import BondForces
from .motion_rows import basis_of, row_shares
from .recovered_energies import assembly_energies, part_prestress
from .reduced_run import NAME, RELATIVE, ReducedMarch
from .tied_assembly import jump_rows, placed

_INSTANTS: Final = 64  # whose forces on all dofs are there at a time


def relaxing(branches: MaxwellBranches, dt: float, moved: Array) -> Array:
    """What Maxwell branches add to displacements (n_time, k) in internal forces: the sum of their elongations times
    their strengths, relaxed at the start, as ``kernels.maxwell``; dt : step, s."""
    added = np.zeros_like(moved)
    for strength, decay, of_motion, _ in branches.weights(MasslessContact(), dt).T:
        elongation = of_motion * np.diff(moved, axis=0, prepend=moved[:1])
        for t in range(1, len(elongation)):
            elongation[t] += decay * elongation[t - 1]
        added += strength * elongation
    return added


def expansions(march: ReducedMarch) -> tuple[sp.csr_array, sp.csr_array]:
    """E Q and E R: full dofs by the free dofs, and by the relative motions."""
    tied = march.tied
    return sp.csr_array(tied.expansion[:, : tied.n_free]), sp.csr_array(tied.expansion[:, tied.n_free :])


def of_relative(march: ReducedMarch, relative: Array, responses: Array) -> Array:
    """What all dofs (n_full, k) do with relative motions (n_r, k) and the static ``responses`` -K+ K_qr r (n_free, k):
    these less rigid motions, and what modes have of r at rest."""
    reduced, (of_free, of_contacts) = march.reduced, expansions(march)
    modal = np.hstack([reduced.rigid, reduced.elastic * reduced.marched.p])
    shares = np.vstack([reduced.rigid_share @ relative, reduced.marched_gamma @ relative])
    return np.asarray(of_free @ (responses - modal @ shares) + of_contacts @ relative)


@dataclass(frozen=True)
class RelativeShapes:
    """Shapes that changes of relative motions are sums of: of these, ``shapes`` (n_r, k), the static ``responses``
    (n_free, k) to them, and of all dofs, ``moved`` (n_full, k)."""

    shapes: Array
    responses: Array
    moved: Array

    @staticmethod
    def of(march: ReducedMarch, changes: Array, share: float | None = None) -> RelativeShapes:
        """Those of changes (n_time, n_r); ``share`` as for ``StaticSolver.spanning``."""
        shapes, responses = march.reduced.solver.spanning(changes, march.reduced.coupling, share)
        return RelativeShapes(shapes, responses, of_relative(march, shapes, responses))

    def damped(self, march: ReducedMarch) -> RelativeShapes:
        """The same of a march with another damping, in which modes have other shares of relative motions."""
        return replace(self, moved=of_relative(march, self.shapes, self.responses))


@dataclass(frozen=True)
class Motions:
    """Motion of all bodies of a reduced assembly over its march.

    Attributes
    ----------
    march : what was marched. modes : displacements, velocities and accelerations (n_time, 3, n_mode). relative :
    relative motions (n_time, n_r), m. span : shapes of their changes, None for their own.
    """

    march: ReducedMarch
    modes: Array
    relative: Array
    span: RelativeShapes | None = None

    # -- the parts of u = E Q (P a + X r) + E R r + B d ----------------------------------------------------------------
    @cached_property
    def _basis(self) -> Array:
        """P (n_free, m + n_load): rigid motions, modes as they are marched, static responses to loads."""
        return basis_of(self.march)

    @cached_property
    def _amplitudes(self) -> Array:
        """Of P and of the driven faces: of displacements, velocities and accelerations (3, n_time, k)."""
        reduced, drives = self.march.reduced, self.march.drives
        first, m = reduced.rigid.shape[1], reduced.n_mode
        n_time = len(self.modes)
        loads = drives.amplitudes[:, :n_time].T, drives.rates[:, :n_time].T / self.march.bodies.dt
        static = (reduced.drives[first:m] / reduced.marched.values[:, None]).T
        rows = []
        for kind in range(3):
            # modes beyond what loads make of them at rest; loads have no inertia of their own
            modal, load = self.modes[:, kind].copy(), loads[kind] if kind < 2 else np.zeros_like(loads[0])
            modal[:, first:] -= load @ static
            rows.append(np.hstack([modal, load, drives.motions[kind, :, :n_time].T]))
        return np.stack(rows)

    def _in_time(self, relative: Array, shapes: Array) -> Array:
        """Amplitudes ``relative`` @ ``shapes`` (n_time, k) of relative motions with their velocities and accelerations,
        (3, n_time, k): those of the march are of a scheme for what has no mass."""
        (model,), dt = self.march.assembly.propagators[0].members, self.march.bodies.dt
        histories, speed = relative @ shapes, model.velocity[self.march.reduced.n_mode :] @ shapes
        change = np.diff(histories, axis=0, prepend=histories[:1] - dt * speed)
        # at the last instant, that of the step before
        following = np.vstack([change[1:], change[-1:]])
        return np.stack([histories, 0.5 * (change + following) / dt, (following - change) / dt**2])

    # -- of all dofs, by shapes ----------------------------------------------------------------------------------------
    @cached_property
    def _relative(self) -> tuple[Array, Array]:
        """Of the relative motions of t = 0 and their changes since: what all dofs (n_full, k) do with their shapes, and
        the amplitudes (3, n_time, k) of these."""
        march, start = self.march, self.relative[:1]
        span = self.span or RelativeShapes.of(march, self.relative - start)
        at_start = march.reduced.solver.solve(-np.asarray(march.reduced.coupling @ start.T))
        moved = np.hstack([of_relative(march, start.T, at_start), span.moved])
        amplitudes = self._in_time(self.relative - start, span.shapes)
        first = np.zeros((3, len(self.relative), 1))
        first[0] = 1.0
        return moved, np.concatenate([first, amplitudes], axis=2)

    @cached_property
    def shapes(self) -> Array:
        """(n_full, n_shape): relative motions, rigid motions and modes, loads, driven faces."""
        of_free, _ = expansions(self.march)
        return np.hstack([self._relative[0], of_free @ self._basis, self.march.drives.shapes])

    @cached_property
    def amplitudes(self) -> Array:
        """Of the shapes: of displacements, velocities and accelerations, (3, n_time, n_shape)."""
        return np.concatenate([self._relative[1], self._amplitudes], axis=2)

    def of(self, rows: sp.csr_array | Array, kind: int) -> Array:
        """Displacements (``kind`` 0), velocities (1) or accelerations (2) of rows (k, n_full), (n_time, k)."""
        return np.asarray(self.amplitudes[kind] @ np.asarray(rows @ self.shapes).T)

    def write(self, rows: sp.csr_array, kind: int, out: Array) -> None:
        """Write those of rows (k, n_full) to ``out`` (n_time, k)."""
        shapes = np.asarray(rows @ self.shapes).T
        for at in range(0, len(out), _INSTANTS):
            out[at : at + _INSTANTS] = self.amplitudes[kind][at : at + _INSTANTS] @ shapes

    def full(self, where: slice, kind: int, instants: Index | slice) -> Array:
        """Those of full dofs at instants, (n_instant, k)."""
        return np.asarray(self.amplitudes[kind][instants] @ self.shapes[where].T)

    def whole(self, kind: int, instant: int) -> Array:
        """Displacements or velocities (n_full,) of all dofs at one instant, with nothing left out."""
        reduced, (of_free, _) = self.march.reduced, expansions(self.march)
        near = self.relative[max(instant - 1, 0) : instant + 2]
        relative = self._in_time(near, np.eye(near.shape[1]))[kind, min(instant, 1), :, None]
        moved = of_relative(self.march, relative, reduced.solver.solve(-np.asarray(reduced.coupling @ relative)))
        a = self._amplitudes[kind, instant]
        count = self._basis.shape[1]
        return np.asarray(moved[:, 0] + of_free @ (self._basis @ a[:count]) + self.march.drives.shapes @ a[count:])

    # -- of few rows, exactly ------------------------------------------------------------------------------------------
    def sensed(self, rows: sp.csr_array) -> Array:
        """Displacements, velocities and accelerations of rows A (k, n_full), (3, n_time, k).

        Nothing is left out, as the shapes of relative motions do, whose accelerations may be those of a few points."""
        shares = row_shares(self.march, rows)
        moved = self._in_time(self.relative, shares.relative.T)
        others = np.hstack([shares.basis, shares.driven])
        return np.asarray(moved + self._amplitudes @ others.T)

    @cached_property
    def _strains(self) -> dict[MaxwellBranches, Array]:
        """``strains`` that are known, by branches."""
        return {}

    def strains(self, model: SubstructureModel) -> Array:
        """``relaxing`` amplitudes of the shapes of a body, (n_time, n_shape)."""
        if model.branches not in self._strains:
            self._strains[model.branches] = self.relaxing(model, self.amplitudes[0])
        return self._strains[model.branches]

    def relaxing(self, model: SubstructureModel, moved: Array) -> Array:
        """``relaxing`` displacements of a body."""
        return relaxing(model.branches, self.march.bodies.dt, moved)

    # -- forces of bonds -------------------------------------------------------------------------------------------
    def internal_forces(self) -> Array:
        """K u + C v + M a less the loads, (n_row, n_time), N, of the bodies and the joints with springs and dashpots,
        at the dofs of bonded faces."""
        tied = self.march.reduced.tied
        drives = self.march.drives
        n_time = len(self.modes)
        rows = self._bonded_dofs
        out = np.empty((len(rows), n_time))
        for model in tied.models:
            where = tied.where[model.name]
            here = (rows >= where.start) & (rows < where.stop)
            dofs = rows[here] - where.start
            if not len(dofs):
                continue
            shapes, (u, v, a) = self.shapes[where], self.amplitudes
            if model.unrelaxed is None:
                total = (model.stiffness[dofs] @ shapes) @ (u + self.strains(model)).T
            else:
                total = (model.stiffness[dofs] @ shapes) @ u.T
                total += (relaxing_part(model)[dofs] @ shapes) @ self.strains(model).T
            total += (model.inertia[dofs] @ shapes) @ a.T
            if model.damping is not None:
                total += (model.damping[dofs] @ shapes) @ v.T
            if (modal := model.modal_rows) is not None:
                total += modal.T[dofs] @ ((modal @ shapes) @ v.T)
            out[here] = total
        # those of the scene alone: driven faces enter by the motion itself
        n_load = drives.n_load
        out -= drives.forces[rows, :n_load] @ drives.amplitudes[:n_load, :n_time]
        return out

    @cached_property
    def _bonded_dofs(self) -> Index:
        """Full dofs at bonded faces."""
        march = self.march
        layout, joints = march.bodies.layout, march.reduced.tied.joints
        channels = [layout.channels(i, side).ravel() for i in joints.bonded for side in (0, 1)]
        flat = np.concatenate([np.zeros(0, dtype=np.int64), *channels])
        return np.unique(march.reduced.tied.trace[flat].indices).astype(np.int64)

    def bond_tractions(self, others: Callable[[slice], Array]) -> dict[int, Array]:
        """Tractions (n_time, k) on side E of each bond, local frames, Pa; ``others`` : forces (n_full, n_instant) of
        all other interfaces on the bodies at some instants, N."""
        march = self.march
        layout, tied = march.bodies.layout, march.reduced.tied
        bonded = tied.joints.bonded
        if not bonded:
            return {}
        expansion = sp.csr_array(sp.block_diag([m.expansion for m in tied.models], format="csr"))
        bonds = BondForces(bonded, layout, tied.trace, expansion)
        internal = self.internal_forces()
        rows = self._bonded_dofs
        tractions: dict[int, list[Array]] = {i: [] for i in bonded}
        for at in range(0, internal.shape[1], _INSTANTS):
            part = slice(at, at + _INSTANTS)
            forces = -others(part)
            forces[rows] += internal[:, part]
            for i, traction in bonds.tractions(forces).items():
                tractions[i].append(traction)
        return {i: np.concatenate(parts) for i, parts in tractions.items()}


class MarchHistories(Protocol):
    """What is read of the march of a reduced assembly."""

    @property
    def n_kept(self) -> int:
        """Instants, t = 0 included."""

    @property
    def rows(self) -> InterfaceRows:
        """Fields of its interfaces."""

    def series(self, kind: str) -> Mapping[Any, Array]:
        """Series of a kind over the kept instants by name."""


class RecoveredRecorder(Recorder):
    """Histories of the bodies and interfaces of an assembly that was marched as a reduced one.

    Parameters
    ----------
    march : the reduced assembly, at the end of its march. recorder : what was recorded of it. request, info : as for a
    ``Recorder``.
    """

    def __init__(
        self, march: ReducedMarch, recorder: MarchHistories, request: OutputRequest, info: dict[str, SubstructureInfo]
    ) -> None:
        give_back_memory()  # of the march
        super().__init__(march.bodies, request, info)
        self.n_kept = n = recorder.n_kept
        self._march, self._motions = march, self._motions_of(march, recorder.series("path"))
        inner, assembly = recorder.rows, march.bodies
        layout, inner_layout = assembly.layout, march.assembly.layout
        rows = self.rows
        flat_f, flat_w = rows.f_hat[:n], rows.w_hat[:n]
        self._velocities(flat_w)
        for j, i in enumerate(march.units):
            first, second = (layout.channels(i, side) for side in (0, 1))
            near, far = (inner_layout.channels(j, side) for side in (0, 1))
            flat_f[:, first], flat_f[:, second] = inner.f_hat[:n][:, near], inner.f_hat[:n][:, far]
            # what the law says of the sides: the motion of one as it is, of the other relative to it
            self._move_sides(flat_w, (first, second), inner.w_hat[:n][:, near] - inner.w_hat[:n][:, far])
            group, inner_group = layout.group(i), inner_layout.group(j)
            g, h = layout.groups.index(group), inner_layout.groups.index(inner_group)
            if g in rows.gaps:
                own_gaps = inner.gaps[h][:n, inner_group.members[j]]
                opening = inner.w_hat[1:n][:, far[:, 0]] - inner.w_hat[1:n][:, near[:, 0]]
                rows.gaps[g][:n, group.members[i]] = self._gaps_of(own_gaps, opening)
        self._recover_bonds(flat_f)
        self._read_series(n)
        self._recover_bodies()
        if request.energy:
            histories = self._motions.modes, self._motions.relative
            self._energy = assembly_energies(march, histories, recorder.series("energy"), self._layer_energy())
            # shapes of all bodies cost as much as the march: not where no stress has a stiffness
            if any(model.geometric is not None for model in march.tied.models):
                part_prestress(self._energy, march.tied, self._motions.shapes, self._motions.amplitudes[0])
        else:
            self._energy = np.zeros((n, N_TERM))
        if request.energy:
            self._series["energy"]["drift"][:n] = recorder.series("energy")["drift"]
        self._leave(n)
        del self._motions  # shapes of all bodies: a march for the estimate of the error may follow

    def add(self, other: RecoveredRecorder, factor: float) -> None:
        """Add what another one of the same bodies has kept, times a factor."""
        self.rows.table[:] += factor * other.rows.table
        for kind in SERIES:
            for name, values in self._series[kind].items():
                values += factor * other._series[kind][name]

    def _velocities(self, flat_w: Array) -> None:
        """Velocities of the sides of all interfaces, and of the ground."""
        self._motions.write(self._march.tied.trace, 1, flat_w)
        self._ground(flat_w)

    def _move_sides(self, flat_w: Array, sides: tuple[Index, Index], relative: Array) -> None:
        """Set velocities of E' from those of E, and those of E over E'."""
        flat_w[:, sides[1]] = flat_w[:, sides[0]] - relative

    def _recover_bonds(self, flat_f: Array) -> None:
        """Tractions of springs between sides and of bonds, slip of interfaces without tangential unknowns."""
        layout = self._march.bodies.layout
        self._layers(flat_f)
        back = sp.csr_array(self._march.tied.trace.T @ sp.diags_array(layout.area))
        for i, traction in self._motions.bond_tractions(lambda part: np.asarray(back @ flat_f[part].T)).items():
            shape = -1, *layout.channels(i, 0).shape
            flat_f[:, layout.channels(i, 0)] = traction.reshape(shape)
            flat_f[:, layout.channels(i, 1)] = -traction.reshape(shape)
        self._slide()

    def _recover_bodies(self) -> None:
        """Fields of the bodies at the instants that are stored, and largest stresses."""
        self._keep_fields()
        self._keep_stresses()

    def _motions_of(self, march: Any, histories: Mapping[str, Array]) -> Any:
        """Motion of the bodies by the histories of the dofs of the march."""
        return Motions(march, histories[NAME], histories[RELATIVE][:, 0])

    def _gaps_of(self, gaps: Array, opening: Array) -> Array:
        """Gaps (n_time, n_point) by those kept, and velocities of opening of the law (n_time - 1, n_point)."""
        # as the law has moved the sides: the scheme of the march adds up their velocities
        return np.cumsum(np.concatenate([gaps[:1], opening * self._march.bodies.dt]), axis=0)

    def _ground(self, flat: Array) -> None:
        """Velocities of the ground."""
        assembly = self._march.bodies
        for i, velocity in assembly.ground.velocity.items():
            frames = assembly.interfaces[i].geometry.frames[:, : assembly.interfaces[i].behaviour.n_component]
            flat[:, assembly.layout.channels(i, 1)] = np.einsum("pci,ti->tpc", frames, velocity[: len(flat)])

    def _layers(self, flat_f: Array) -> None:
        """Tractions of springs between sides."""
        march, n = self._march, len(flat_f)
        layout, tied = march.bodies.layout, march.tied
        for i in tied.joints.linear:
            group, channels = layout.group(i), layout.channels(i, 0)
            # of E' over E, as laws take it
            jump = -self._motions.of(jump_rows(layout, tied.trace, i), 0).reshape(n, *channels.shape)
            parameters, rest = group.parameters[group.members[i]], np.zeros((len(channels), 2))
            law = march.bodies.interfaces[i].behaviour
            for t in range(n):
                traction = law.local(np.zeros_like(jump[t]), rest, jump[t], 1.0, parameters)
                flat_f[t, channels], flat_f[t, layout.channels(i, 1)] = traction, -traction

    def _slide(self) -> None:
        """Tangential velocities of interfaces without tangential unknowns."""
        tied, n = self._march.tied, self.n_kept
        models = {m.name: m for m in tied.models}
        for i, slide in self.rows.slide.items():
            unit = self._march.bodies.interfaces[i]
            for side, face in enumerate(unit.sides):
                trace = unit.geometry.traces[side]
                if trace is None:
                    slide[:n, side] = self._march.bodies.ground.velocity[i][:n, None]
                    continue
                name = face.split(".")[0]
                nodal = models[name].nodal
                if nodal is None:
                    motion = trace
                else:
                    motion = sp.csr_array(trace @ nodal)
                moved = self._motions.of(placed(tied.where[name], tied.trace.shape[1], motion), 1)
                slide[:n, side] = moved.reshape(n, -1, 3)

    def _read_series(self, n: int) -> None:
        """Sensors, reactions, bolts and paths."""
        places = {name: (c, m) for c, p in enumerate(self._march.bodies.propagators) for m, name in enumerate(p.names)}
        motions, assembly, tied = self._motions, self._march.bodies, self._march.tied
        read = [(key, name, place) for key in SERIES for name, place in self.request.places(key).items()]
        rows = []
        for _, _, place in read:
            c, member = places[place.substructure]
            model = assembly.propagators[c].members[member]
            full = place.full_rows(model, False)
            if model.nodal is not None:
                full = full @ model.nodal
            rows.append(placed(tied.where[place.substructure], tied.trace.shape[1], full))
        # together: vectors of all dofs
        series = motions.sensed(sp.csr_array(sp.vstack(rows))) if rows else np.zeros((3, n, 0))
        ends = np.cumsum([matrix.shape[0] for matrix in rows])
        for (key, name, place), matrix, end in zip(read, rows, ends, strict=True):
            c, member = places[place.substructure]
            values = np.moveaxis(series[:, :, end - matrix.shape[0] : end], 0, 1)
            if assembly.propagators[c].n_sensed > STRAIN:
                added = motions.relaxing(assembly.propagators[c].members[member], values[:, 0])
                values = np.concatenate([values, added[:, None]], axis=1)
            of = Reading(assembly, c, member, slice(0, n), self.rows.f_hat[:n])
            self._series[key][name][:n] = place.read(values, of)

    def _nodes(self, name: str, kind: int, instants: Index) -> Array:
        """Displacements or velocities (n, n_node, 3) of the nodes of a body at instants."""
        motions = self._motions
        tied = self._march.tied
        model = next(m for m in tied.models if m.name == name)
        moved = motions.full(tied.where[name], kind, instants)
        if model.nodal is not None:
            moved = moved @ model.nodal.T
        return np.asarray(moved.reshape(len(instants), -1, 3))

    def _keep_fields(self) -> None:
        """Fields at the instants that are stored."""
        if not self._stored.wanted:
            return
        instants = np.arange(0, self.n_kept, self.request.every)
        self._stored.times += self._march.bodies.time[instants].tolist()
        for name in self._stored.fields:
            self._stored.add(name, self._nodes(name, 0, instants), self._nodes(name, 1, instants))

    def _keep_stresses(self) -> None:
        """Largest stresses of bodies with a yield stress."""
        instants = np.arange(0, self.n_kept, self.stresses.every)
        times = self._march.bodies.time[instants]
        for name in self.stresses.tables:
            if self._info[name].stress is not None:
                self.stresses.look_at(name, self._nodes(name, 0, instants), instants, times)

    def _layer_energy(self) -> Array:
        """Energy (n,), J, of the springs between sides, which the march has among that of the bodies."""
        total, histories = np.zeros(self.n_kept), self.interfaces()
        for i in self._march.reduced.tied.joints.linear:
            energy = histories[self._march.bodies.interfaces[i].name].layer_energy
            if energy is not None:
                total += energy
        return total

    def _terms(self) -> dict[str, Array]:
        """Energies of the assembly as a whole: those of single bodies are not followed."""
        if self.request.energy:
            return {NAME: self._energy}
        return {}

    def substructures(self) -> dict[str, SubstructureHistory]:
        """Histories of the bodies for which fields are requested; without energies."""
        return {name: self._stored.history(name, None) for name in (self._info if self._stored.wanted else ())}

    def _leave(self, n: int) -> None:
        """Leave the bodies in their motion at the end."""
        where = self._march.tied.where
        u, v = (self._motions.whole(kind, n - 1) for kind in (0, 1))
        for propagator in self._march.bodies.propagators:
            fields, forcing = [], propagator.forcing
            propagator.instant = n - 1
            for full, imposed in ((u, forcing.imposed_u(n - 1)), (v, forcing.imposed_v(n - 1))):
                motion = np.stack([full[where[name]] for name in propagator.names], axis=1) - imposed
                fields.append(closest_reduced(propagator.members[0].expansion, motion))
            propagator.state.set(*fields)
