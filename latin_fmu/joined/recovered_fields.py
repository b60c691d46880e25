"""What the bodies of a reduced assembly did: fields, interfaces, sensors, reactions and tensions from its march.

The motion of all bodies is a sum of few shapes: rigid motions and modes, static responses to loads, shapes that follow
driven faces, and static responses to relative motions. Of these there are as many as contacts have unknowns, but their
histories lie in a space of few dimensions (``compressed``), so that few solutions give all instants.

Bonds are no unknowns of the march. Their tractions F follow from the equilibrium of the bodies that they join,

    T^T area F = K u + C v + M a - f - (forces of the other interfaces)

(``bond_forces``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..kernels.energy_parts import ELASTIC, INTERFACE_WORK, KINETIC, N_TERM, WORK_OF_LOADS
from ..latin.assembly import Array, Index
from ..latin.outcome import SubstructureHistory
from ..latin.probes import SERIES, OutputRequest, Reading
from ..latin.recorder import Recorder, SubstructureInfo
from ..machine import give_back_memory
from ..propagator.model import SubstructureModel, closest_reduced
from ..time_scheme import MasslessContact, MaxwellBranches
from .bond_forces import BondForces
from .reduced_run import NAME, RELATIVE, ReducedMarch
from .tied_assembly import MASS, STIFFNESS, jump_rows

_EXACT: Final = 1e-3  # of the largest change of the relative motions, left out of their shapes
_BLOCK: Final = 32  # shapes that are looked for at a time
_COLUMNS: Final = 40  # that are solved together: vectors of all dofs
_INSTANTS: Final = 64  # whose forces on all dofs are there at a time


def compressed(histories: Array) -> Array:
    """Orthonormal shapes (n, k) of histories (n_time, n) whose span holds them to a share ``_EXACT`` of the largest: a
    span found by random sums of what is left, and of it the fewest shapes that do."""
    rest, found = histories.copy(), list[Any]()
    size = np.linalg.norm(rest, axis=1).max(initial=0.0)
    random = np.random.default_rng(0)  # the same shapes every time
    while size > 0.0 and np.linalg.norm(rest, axis=1).max() > _EXACT * size:
        rank = sum(shape.shape[1] for shape in found)
        count = min(_BLOCK, min(histories.shape) - rank)
        if count <= 0:
            break
        mixed = rest.T @ random.normal(size=(len(rest), count))
        for shape in found:
            mixed -= shape @ (shape.T @ mixed)
        new, _ = la.qr(mixed, mode="economic", check_finite=False)
        found.append(new)
        rest -= (rest @ new) @ new.T
    shapes = np.hstack([np.zeros((histories.shape[1], 0)), *found])
    if not shapes.shape[1]:
        return shapes
    weights, sizes, turn = la.svd(histories @ shapes, full_matrices=False)
    # of each history, what the shapes from each one on hold, and what none does
    shares = np.cumsum((weights * sizes)[:, ::-1] ** 2, axis=1)[:, ::-1] + (rest**2).sum(axis=1)[:, None]
    count = int((shares.max(axis=0) > (_EXACT * size) ** 2).sum())
    return np.asarray(shapes @ turn[:count].T)


@dataclass(frozen=True)
class Motions:
    """Motion of all bodies of a reduced assembly over its march.

    Attributes
    ----------
    march : what was marched. modes : displacements, velocities and accelerations (n_time, 3, n_mode). relative :
    relative motions (n_time, n_r), m.
    """

    march: ReducedMarch
    modes: Array
    relative: Array

    @cached_property
    def _relative(self) -> tuple[Array, Array]:
        """Shapes (n_r, k) of the relative motions: those of t = 0 and of the changes since; amplitudes (3, n_time, k)
        of displacements, velocities and accelerations: those of the march are of a scheme for what has no mass."""
        (model,), dt = self.march.assembly.propagators[0].members, self.march.bodies.dt
        r, speed = self.relative - self.relative[0], model.velocity[None, self.march.reduced.n_mode :]
        shapes = compressed(r)
        moved = r @ shapes
        change = np.diff(moved, axis=0, prepend=-dt * (speed @ shapes))
        # at the last instant, that of the step before
        following = np.vstack([change[1:], change[-1:]])
        amplitudes = np.stack([moved, 0.5 * (change + following) / dt, (following - change) / dt**2])
        first = np.zeros((3, len(r), 1))
        first[0] = 1.0
        return np.column_stack([self.relative[0], shapes]), np.concatenate([first, amplitudes], axis=2)

    @cached_property
    def shapes(self) -> Array:
        """(n_full, n_shape): rigid motions and modes, relative motions, loads, driven faces."""
        reduced, tied = self.march.reduced, self.march.reduced.tied
        n = tied.n_free
        relative = self._relative[0]
        driven = self.march.drives.shapes
        of_free, of_relative = sp.csr_array(tied.expansion[:, :n]), sp.csr_array(tied.expansion[:, n:])
        first = reduced.rigid.shape[1]
        m = reduced.n_mode
        loads = reduced.static_loads
        end = m + relative.shape[1]
        shapes = np.empty((len(driven), end + loads.shape[1] + driven.shape[1]))
        shapes[:, :first] = of_free @ reduced.rigid
        shapes[:, first:m] = of_free @ (reduced.elastic * reduced.marched.p)
        for at in range(0, relative.shape[1], _COLUMNS):
            part = relative[:, at : at + _COLUMNS]
            static = reduced.solver.solve(-np.asarray(reduced.coupling @ part))
            static -= reduced.rigid @ (reduced.rigid_share @ part)
            shapes[:, m + at : m + at + part.shape[1]] = of_free @ static + of_relative @ part
        shapes[:, end : end + loads.shape[1]] = of_free @ loads
        shapes[:, end + loads.shape[1] :] = driven
        return shapes

    @cached_property
    def amplitudes(self) -> Array:
        """Of the shapes: of displacements, velocities and accelerations, (3, n_time, n_shape)."""
        reduced, drives = self.march.reduced, self.march.drives
        first = reduced.rigid.shape[1]
        m = reduced.n_mode
        n_time = len(self.modes)
        loads = drives.amplitudes[:, :n_time].T, drives.rates[:, :n_time].T / self.march.bodies.dt
        static = (reduced.drives[first:m] / reduced.marched.values[:, None]).T
        shapes, relative = self._relative
        of_relative = (reduced.marched_gamma @ shapes).T
        rows = []
        for kind in range(3):
            # modes beyond what relative motions and loads make of them at rest; loads have no inertia of their own
            modal, load = self.modes[:, kind].copy(), loads[kind] if kind < 2 else np.zeros_like(loads[0])
            modal[:, first:] -= relative[kind] @ of_relative + load @ static
            rows.append(np.hstack([modal, relative[kind], load, drives.motions[kind, :, :n_time].T]))
        return np.stack(rows)

    def of(self, rows: sp.csr_array | Array, kind: int) -> Array:
        """Displacements (``kind`` 0), velocities (1) or accelerations (2) of rows (k, n_full), (n_time, k)."""
        return np.asarray(self.amplitudes[kind] @ np.asarray(rows @ self.shapes).T)

    def write(self, rows: sp.csr_array, kind: int, out: Array) -> None:
        """Write those of rows (k, n_full) to ``out`` (n_time, k)."""
        shapes = np.asarray(rows @ self.shapes).T
        for at in range(0, len(out), _INSTANTS):
            out[at : at + _INSTANTS] = self.amplitudes[kind][at : at + _INSTANTS] @ shapes

    def sensed(self, rows: sp.csr_array, model: SubstructureModel) -> Array:
        """Displacements, velocities, accelerations of rows (k, n_full) of a body, and what internal forces take for
        displacements, (n_time, 4, k)."""
        shapes = np.asarray(rows @ self.shapes)
        return np.stack([a @ shapes.T for a in (*self.amplitudes, self.strains(model))], axis=1)

    def full(self, where: slice, kind: int, instants: Index | slice) -> Array:
        """Those of full dofs at instants, (n_instant, k)."""
        return np.asarray(self.amplitudes[kind][instants] @ self.shapes[where].T)

    def placed(self, name: str, rows: sp.csr_array | Array) -> sp.csr_array:
        """Rows (k, n) of the full dofs of a body among those of all, (k, n_full)."""
        matrix = sp.csr_array(rows)
        where = self.march.tied.where[name]
        shape = matrix.shape[0], self.shapes.shape[0]
        return sp.csr_array((matrix.data, matrix.indices + where.start, matrix.indptr), shape=shape)

    @cached_property
    def _strains(self) -> dict[MaxwellBranches, Array]:
        """``strains`` that are known, by branches."""
        return {}

    def strains(self, model: SubstructureModel) -> Array:
        """What Maxwell branches add to the amplitudes of the displacements in the internal forces of a body, (n_time,
        n_shape): the sum of their elongations times their strengths, relaxed at the start, as ``kernels.maxwell``."""
        if model.branches not in self._strains:
            moved = self.amplitudes[0]
            added = self._strains[model.branches] = np.zeros_like(moved)
            for strength, decay, of_motion, _ in model.branches.weights(MasslessContact(), self.march.bodies.dt).T:
                elongation = of_motion * np.diff(moved, axis=0, prepend=moved[:1])
                for t in range(1, len(elongation)):
                    elongation[t] += decay * elongation[t - 1]
                added += strength * elongation
        return self._strains[model.branches]

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
            total = (model.stiffness[dofs] @ shapes) @ (u + self.strains(model)).T
            total += (model.inertia[dofs] @ shapes) @ a.T
            if model.damping is not None:
                total += (model.damping[dofs] @ shapes) @ v.T
            out[here] = total
        # those of the scene alone: driven faces enter by the motion itself
        n_load = drives.forces.shape[1] - 3 * drives.shapes.shape[1]
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


class RecoveredRecorder(Recorder):
    """Histories of the bodies and interfaces of an assembly that was marched as a reduced one.

    Parameters
    ----------
    march : the reduced assembly, at the end of its march. recorder : what was recorded of it. request, info : as for a
    ``Recorder``.
    """

    def __init__(
        self, march: ReducedMarch, recorder: Recorder, request: OutputRequest, info: dict[str, SubstructureInfo]
    ) -> None:
        give_back_memory()  # of the march
        super().__init__(march.bodies, request, info)
        self.n_kept = n = recorder.n_kept
        self._march, self._motions = march, self._motions_of(march, recorder.series("path"))
        inner, assembly = recorder.rows, march.bodies
        layout, inner_layout = assembly.layout, march.assembly.layout
        tied = march.tied
        rows = self.rows
        flat_f, flat_w = rows.f_hat[:n], rows.w_hat[:n]
        self._motions.write(tied.trace, 1, flat_w)
        self._ground(flat_w)
        for j, i in enumerate(march.units):
            first, second = (layout.channels(i, side) for side in (0, 1))
            near, far = (inner_layout.channels(j, side) for side in (0, 1))
            flat_f[:, first], flat_f[:, second] = inner.f_hat[:n][:, near], inner.f_hat[:n][:, far]
            # what the law says of the sides: the motion of E as it is, of E' relative to it
            flat_w[:, second] = flat_w[:, first] - (inner.w_hat[:n][:, near] - inner.w_hat[:n][:, far])
            group, inner_group = layout.group(i), inner_layout.group(j)
            g, h = layout.groups.index(group), inner_layout.groups.index(inner_group)
            if g in rows.gaps:
                own_gaps = inner.gaps[h][:n, inner_group.members[j]]
                opening = inner.w_hat[1:n][:, far[:, 0]] - inner.w_hat[1:n][:, near[:, 0]]
                rows.gaps[g][:n, group.members[i]] = self._gaps_of(own_gaps, opening)
        self._layers(flat_f)
        back = sp.csr_array(tied.trace.T @ sp.diags_array(layout.area))
        for i, traction in self._motions.bond_tractions(lambda part: np.asarray(back @ flat_f[part].T)).items():
            shape = -1, *layout.channels(i, 0).shape
            flat_f[:, layout.channels(i, 0)] = traction.reshape(shape)
            flat_f[:, layout.channels(i, 1)] = -traction.reshape(shape)
        self._slide()
        self._read_series(n)
        self._keep_fields()
        self._keep_stresses()
        if request.energy:
            self._energy = self._whole_energy(recorder)
        else:
            self._energy = np.zeros((n, N_TERM))
        if request.energy:
            self._series["energy"]["drift"][:n] = recorder.series("energy")["drift"]
        self._leave(n)
        del self._motions  # shapes of all bodies: a march for the estimate of the error may follow

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
                moved = self._motions.of(self._motions.placed(name, motion), 1)
                slide[:n, side] = moved.reshape(n, -1, 3)

    def _read_series(self, n: int) -> None:
        """Sensors, reactions, bolts and paths."""
        places = {name: (c, m) for c, p in enumerate(self._march.bodies.propagators) for m, name in enumerate(p.names)}
        motions, assembly = self._motions, self._march.bodies
        for key in SERIES:
            for name, place in self.request.places(key).items():
                c, member = places[place.substructure]
                model = assembly.propagators[c].members[member]
                full = place.full_rows(model, False)
                if model.nodal is not None:
                    full = full @ model.nodal
                values = motions.sensed(motions.placed(place.substructure, sp.csr_array(full)), model)
                if not (assembly.propagators[c].n_sensed > 3):
                    values = values[:, :3]
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

    # -- energies --------------------------------------------------------------------------------------------------
    def _whole_energy(self, recorder: Recorder) -> Array:
        """Energies (n, N_TERM) of the assembly: those of the march, and of the motion B d and the static responses to
        the loads, which it is relative to."""
        march, n = self._march, self.n_kept
        tables: Mapping[Any, Array] = recorder.series("energy")
        terms = tables[0][:, :, 0].copy()  # by number of the class
        drives, reduced = march.drives, march.reduced
        moved = drives.shapes.shape[1]
        motions = self._motions
        m = reduced.n_mode
        modes, relative = motions.modes[:n], motions.relative[:n]
        if moved and n > 1:
            speed = np.gradient(relative, march.bodies.dt, axis=0)
        else:
            speed = np.zeros_like(relative)
        k_d, m_d = (drives.shapes.T @ reduced.tied.times(kind, drives.shapes) for kind in (STIFFNESS, MASS))
        d, rate = drives.motions[0, :, :n].T, drives.motions[1, :, :n].T
        count = reduced.drives.shape[1]
        of_stiffness, of_mass = (reduced.drives[:, count - k * moved : count - (k - 1) * moved] for k in (3, 1))
        # forces on the march have the sign of their inertia reversed
        inertia = modes[:, 1] @ of_mass[:m] + speed @ of_mass[m:]
        springs = modes[:, 0] @ of_stiffness[:m] + relative @ of_stiffness[m:]
        kinetic = 0.5 * np.einsum("ti,ij,tj->t", rate, m_d, rate) - (rate * inertia).sum(axis=1)
        elastic = 0.5 * np.einsum("ti,ij,tj->t", d, k_d, d) - (d * springs).sum(axis=1)
        elastic += self._static_energy(count - 3 * moved)
        terms[:, KINETIC] += kinetic
        terms[:, ELASTIC] += elastic
        terms[:, WORK_OF_LOADS] += kinetic - kinetic[0] + elastic - elastic[0]
        # that of the springs between sides belongs to the interfaces
        layers = self._layer_energy()
        terms[:, ELASTIC] -= layers
        terms[:, INTERFACE_WORK] -= layers - layers[0]
        return terms

    def _static_energy(self, n_load: int) -> Array:
        """Energy (n,), J, of the static responses to the loads of the scene that modes and relative motions leave."""
        reduced = self._march.reduced
        drives = self._march.drives
        n = self.n_kept
        first = reduced.rigid.shape[1]
        m = reduced.n_mode
        free = reduced.tied.n_free
        flexibility = reduced.forces[:free, :n_load].T @ reduced.static_loads[:, :n_load]
        modes = reduced.drives[first:m, :n_load]
        flexibility = flexibility - modes.T @ (modes / reduced.marched.values[:, None])
        a = drives.amplitudes[:n_load, :n].T
        return np.asarray(0.5 * np.einsum("ti,ij,tj->t", a, flexibility, a))

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
        where, every = self._march.tied.where, slice(None)
        u, v = (self._motions.full(every, kind, slice(n - 1, n))[0] for kind in (0, 1))
        for propagator in self._march.bodies.propagators:
            fields, forcing = [], propagator.forcing
            propagator.instant = n - 1
            for full, imposed in ((u, forcing.imposed_u(n - 1)), (v, forcing.imposed_v(n - 1))):
                motion = np.stack([full[where[name]] for name in propagator.names], axis=1) - imposed
                fields.append(closest_reduced(propagator.members[0].expansion, motion))
            propagator.state.set(*fields)
