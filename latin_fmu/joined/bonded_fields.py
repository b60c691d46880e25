"""What bodies and interfaces do in a march of groups (``bond_groups``): fields, sensors, reactions, tensions, bonds.

Bonds are no unknowns of the march. Their tractions F follow from the equation of motion of the bodies that they join,
in which the time scheme weights the instants (``time_scheme.implicit``). With X = K u + C v - f less the forces of the
other interfaces, at the dofs of bonded faces, HHT and Newmark have

    T^T area F_{n+1} = X_{n+1} + R_{n+1},        R_{n+1} = (M a_{n+1} + alpha R_n) / (1 + alpha),   R_0 = M a_0

and generalised alpha, in which tractions are not weighted,

    T^T area F_{n+1} = (1 - a_f) X_{n+1} + a_f X_n + (1 - a_m) M a_{n+1} + a_m M a_n.

The march keeps the motion of the dofs that K, C and M couple with bonded ones, no more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from ..assembly.body import body_sides
from ..kernels.energy_parts import TERMS
from ..latin.assembly import Array, Assembly, Index
from ..latin.probes import SERIES, FacePlace, OutputRequest, Probes, Reading
from ..latin.recorder import Recorder, SubstructureInfo, node_fields, places_in, small
from ..propagator.forcing import STRAIN
from ..propagator.image import Image
from ..propagator.model import closest_reduced, relaxing_part
from .bond_forces import BondForces
from .bond_groups import BondGroup, GroupedAssembly

_BONDS: Final = "bonds"
_SLIDE: Final = "slide"
March = tuple[GroupedAssembly, Assembly, Assembly, Mapping[str, Array]]
"""Substructures of a march, their assembly, that of the bodies, and tractions at t = 0 by interface."""


@dataclass(frozen=True)
class MotionRows(FacePlace):
    """Rows of the full dofs of a substructure whose motion is read (``trace``)."""


class BondRecovery:
    """Tractions and velocities of the bonds of a group from its motion, block of instants by block.

    Parameters
    ----------
    group : of bodies. bodies : their assembly. start : tractions at t = 0 by interface where they are known, Pa.

    Attributes
    ----------
    channels : of the bonds, (k,). moving : these, and those of side E of the other interfaces of the group (l,).
    near : numbers of the full dofs whose motion is needed. memory : of the instant before: R or X, M a, u.
    """

    def __init__(self, group: BondGroup, bodies: Assembly, start: Mapping[str, Array]) -> None:
        self._group = group
        self._bodies = bodies
        self._start = start
        layout, model = bodies.layout, group.model
        expansion = sp.csr_array(sp.block_diag([m.expansion for m in group.models], format="csr"))
        self._forces = BondForces(group.bonded, layout, group.trace, expansion)
        rows = self._forces.rows
        none = sp.csr_array((rows.shape[0], model.n_full))
        of_strains = relaxing_part(model) if len(model.branches) else None
        wanted = model.stiffness, model.damping, model.mass, of_strains
        matrices = [none if m is None else sp.csr_array(rows @ m) for m in wanted]
        sides = [layout.channels(i, side).ravel() for i in group.bonded for side in (0, 1)]
        self.channels = np.concatenate(sides)
        inner = [layout.channels(i, 0).ravel() for i in group.inner]
        self.inner, self.moving = group.inner, np.concatenate([self.channels, *inner])
        traces = sp.csr_array(group.trace[self.moving])
        self.near = np.unique(np.concatenate([m.indices for m in (*matrices, traces)])).astype(np.int64)
        self._k, self._c, self._m, self._strained = (sp.csr_array(sp.csc_array(m)[:, self.near]) for m in matrices)
        self._trace = sp.csr_array(sp.csc_array(traces)[:, self.near])
        # of the tractions of all interfaces, those that are no bonds of this group
        carried = sp.csr_array(rows @ group.trace.T @ sp.diags_array(layout.area))
        others = np.setdiff1d(np.unique(carried.indices), self.channels)
        self._others, self._on = others, sp.csr_array(sp.csc_array(carried)[:, others])
        loads = [(m, load) for m in group.models for load in m.loads]
        columns = [np.asarray(rows[:, group.where[m.name]] @ load.pattern) for m, load in loads]
        # sparse: its product rounds each instant alike, whatever the length of the block
        self._loads = sp.csr_array(np.stack([np.zeros(rows.shape[0]), *columns], axis=1))
        self.memory = np.zeros((3, max(rows.shape[0], len(self.near))))

    def _amplitudes(self, now: slice) -> Array:
        """Of the loads of all bodies (1 + n_load, n): none in front."""
        places = {name: (p, j) for p in self._bodies.propagators for j, name in enumerate(p.names)}
        members = [places[m.name] for m in self._group.models]
        parts = [amplitude[now] for p, j in members for amplitude in p.forcing.amplitudes[j]]
        return np.stack([np.zeros(now.stop - now.start), *parts])

    def fields(self, values: Array, f_hat: Array, now: slice) -> tuple[Array, Array]:
        """Tractions (n, k) of ``channels`` and velocities (n, l) of ``moving`` at the instants ``now``, which follow
        those of the call before; ``values`` : motion (n, n_sensed, n_near). f_hat : (n, n_flat) of all other
        interfaces."""
        u, v, a = (np.ascontiguousarray(values[:, kind].T) for kind in range(3))
        x = self._k @ u + self._c @ v - self._loads @ self._amplitudes(now) - self._on @ f_hat[:, self._others].T
        if values.shape[1] != STRAIN:
            x = x + self._strained @ values[:, STRAIN].T
        forces = self._forces.carried(self._carried(np.asarray(x), np.asarray(self._m @ a), now.start == 0))
        tractions = []
        for i in self._group.bonded:
            traction = forces[i]
            if now.start == 0 and self._bodies.interfaces[i].name in self._start:
                traction[0] = self._start[self._bodies.interfaces[i].name].ravel()
            tractions += [traction, -traction]
        return np.hstack(tractions), self._velocities(u, v, now.start == 0)

    def _carried(self, x: Array, inertia: Array, first: bool) -> Array:
        """T^T area F (k, n) by the time scheme (module docstring)."""
        scheme, n = self._bodies.scheme, x.shape[1]
        before, rows = self.memory[:2, : len(x)], len(x)
        (a_m, a_f), w, memory = scheme.old_weights, scheme.force_weight, scheme.memory_weight
        if a_m == a_f == 0.0:
            forces, residual = np.empty_like(x), before[0].copy()
            for t in range(n):
                start = first and t == 0
                if start:
                    residual = inertia[:, t]
                else:
                    residual = (inertia[:, t] + memory * residual) / w
                forces[:, t] = x[:, t] + residual
            self.memory[0, :rows] = residual
            return forces
        old_x, old_inertia = (np.column_stack([b, m[:, :-1]]) for b, m in zip(before, (x, inertia), strict=True))
        forces = w * x + a_f * old_x + (1.0 - a_m) * inertia + a_m * old_inertia
        if first:
            forces[:, 0] = x[:, 0] + inertia[:, 0]
        self.memory[0, :rows], self.memory[1, :rows] = x[:, -1], inertia[:, -1]
        return forces

    def _velocities(self, u: Array, v: Array, first: bool) -> Array:
        """Velocities (n, k) of the channels as the interfaces of the scheme have them."""
        scheme, width = self._bodies.scheme, len(self.near)
        before = np.column_stack([self.memory[2, :width], u[:, :-1]])
        moved = scheme.interface_velocity(before, u, v, self._bodies.dt)
        self.memory[2, :width] = u[:, -1]
        moved = np.asarray(self._trace @ moved)
        if first:
            moved[:, 0] = self._trace @ v[:, 0]
        return moved.T


class BondedRecorder(Recorder):
    """Histories of all bodies and interfaces, fed by the march of groups.

    march : see ``March``. The others as for ``Recorder``.
    """

    def __init__(
        self, march: March, request: OutputRequest, info: dict[str, SubstructureInfo], thinned: int = 1, *file: Any
    ) -> None:
        self._grouped, self._assembly, self._bodies, start = march
        super().__init__(self._bodies, request, info, thinned, *file)
        n_time = len(self._bodies.time)
        if request.energy:
            sizes = {c: len(p.members) for c, p in enumerate(self._assembly.propagators)}
            terms = {c: np.zeros((n_time, len(TERMS), m)) for c, m in sizes.items()}
            self._series["energy"] = {**terms, "drift": np.zeros(n_time)}
        self._members = {name: (p, j) for p in self._bodies.propagators for j, name in enumerate(p.names)}
        self._recoveries = {g.model.name: BondRecovery(g, self._bodies, start) for g in self._grouped.groups}
        layout, outer = self._bodies.layout, self._assembly.layout
        self._own, self._all = self._grouped.pairs(outer, layout)
        self._points = self._point_pairs()
        self._shares = {name: share for group in self._grouped.groups for name, share in group.shares.items()}

    def _point_pairs(self) -> tuple[Index, Index]:
        """Places of the points of the interfaces that are left among those of the march, and of all."""
        found: tuple[list[Index], list[Index]] = ([np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)])
        layouts = self._assembly.layout, self._bodies.layout
        for pair in enumerate(self._grouped.remaining):
            for into, layout, i in zip(found, layouts, pair, strict=True):
                group = layout.group(i)
                first = sum(g.n_point for g in layout.groups[: layout.groups.index(group)])
                points = group.members[i]
                into.append(np.arange(first + points.start, first + points.stop))
        return np.concatenate(found[0]), np.concatenate(found[1])

    # -- what the march keeps ----------------------------------------------------------------------------------------
    def probes(self, assembly: Assembly, fields: bool) -> Probes | None:
        """Rows of the substructures of the march for what is kept of the bodies."""
        places = {name: MotionRows(name, _selected(r.near, self._group(name))) for name, r in self._recoveries.items()}
        faces: dict[str, FacePlace] = {f"{_BONDS} {name}": place for name, place in places.items()}
        massless = set[str]()
        for key in SERIES:
            for name, place in self.request.places(key).items():
                p, j = self._members[place.substructure]
                model = p.members[j]
                rows = place.full_rows(model, False)
                faces[f"{key} {name}"] = self._placed(place.substructure, sp.csr_array(rows))
                if model.nodal is None:
                    full = rows
                else:
                    full = rows @ model.nodal
                moving = sp.csr_array(sp.csr_array(full) @ model.expansion)
                if key == "motion" and moving[:, model.massless].nnz:
                    massless.add(name)
        for i, side, name in body_sides(self._bodies.interfaces):
            trace = self._bodies.interfaces[i].geometry.traces[side]
            if i in self.rows.slide and trace is not None:
                faces[f"{_SLIDE} {i} {side}"] = self._placed(name, trace)
        whole = fields and self._stored.wanted and small(assembly)
        if not (whole or faces):
            return None
        probes = Probes(assembly, [], OutputRequest(faces=faces), whole)
        probes.massless = massless
        return probes

    def _group(self, name: str) -> int:
        """Number of full dofs of a group."""
        return next(g.model.n_full for g in self._grouped.groups if g.model.name == name)

    def _placed(self, name: str, rows: sp.csr_array) -> MotionRows:
        """Rows of the nodes of a body as rows of its substructure."""
        place = self._grouped.places[name]
        if place.substructure == name:
            return MotionRows(name, rows)
        shape = rows.shape[0], self._group(place.substructure)
        moved = sp.csr_array((rows.data, rows.indices + place.part.start, rows.indptr), shape=shape)
        return MotionRows(place.substructure, moved)

    # -- from the march to the bodies ----------------------------------------------------------------------------------
    def _keep_rows(self, _assembly: Assembly, image: Image, probes: Probes | None, now: slice, rows: slice) -> None:
        """Keep interfaces and series at the instants ``now``, ``rows`` of the image's output."""
        layout, n = self._bodies.layout, now.stop - now.start
        f_hat, w_hat = np.zeros((2, n, layout.n_flat))
        f_hat[:, self._all] = image.field("history_f", image.rows, image.n_flat)[rows][:, self._own]
        w_hat[:, self._all] = image.field("history_w", image.rows, image.n_flat)[rows][:, self._own]
        gaps = np.zeros((n, sum(group.n_point for group in layout.groups)))
        outer_gaps = image.field("history_gap", image.rows, int(image.run[0]["n_point"]))[rows]
        gaps[:, self._points[1]] = outer_gaps[:, self._points[0]]
        places = {} if probes is None else probes.places["path"]
        values = {} if probes is None else {k: probes.values(image, p, rows, now) for k, p in places.items()}
        for name, recovery in self._recoveries.items():
            traction, velocity = recovery.fields(values[f"{_BONDS} {name}"], f_hat, now)
            f_hat[:, recovery.channels] = traction
            # inside of a group the march has motions of E over E'
            relative = w_hat.copy()
            w_hat[:, recovery.moving] = velocity
            for i in recovery.inner:
                near, far = (layout.channels(i, side).ravel() for side in (0, 1))
                w_hat[:, far] = w_hat[:, near] - (relative[:, near] - relative[:, far])
        slides = {}
        for i in self.rows.slide:
            slides[i] = np.zeros((n, 2, self._bodies.interfaces[i].geometry.n_point, 3))
            for side in (0, 1):
                if (series := values.get(f"{_SLIDE} {i} {side}")) is not None:
                    slides[i][:, side] = series[:, 1].reshape(n, -1, 3)
                else:
                    slides[i][:, side] = self._bodies.ground.velocity[i][now][:, None]
        fields = f_hat, w_hat, gaps
        self.rows.put_slides(slides, now.start, self.rows.put(fields, now.start))
        if self.stream is not None:
            self.stream.put(fields, slides, now.start)
        for key in SERIES:
            for name, place in self.request.places(key).items():
                p, j = self._members[place.substructure]
                of = Reading(self._bodies, self._bodies.propagators.index(p), j, now, f_hat)
                motion = self._of_body(place.substructure, values[f"{key} {name}"])
                self._series[key][name][now] = place.read(motion, of)

    def _of_body(self, name: str, values: Array) -> Array:
        """Motion (n, n_sensed, k) of a body from that of its substructure, whose branches may be stronger."""
        share = self._shares.get(name, 1.0)
        if share == 1.0 or values.shape[1] == STRAIN:
            return values
        return np.concatenate([values[:, :STRAIN], share * values[:, STRAIN:]], axis=1)

    def _moved(self, of: tuple[Assembly, Image], rows: slice, instants: range, name: str, kind: int) -> Any:
        """Displacements or velocities of a body."""
        place = self._grouped.places[name]
        at = places_in(of[0])[place.substructure]
        moved = node_fields(of, self._whole, (rows, instants), at, kind)
        if place.substructure == name:
            return moved
        nodes = slice(place.part.start // 3, place.part.stop // 3)
        return [values[nodes] for values in moved]

    def _terms(self) -> dict[str, Array]:
        """Energies of the substructures of the march: of a group as a whole."""
        places = places_in(self._assembly) if self.request.energy else {}
        return {name: self._series["energy"][c][: self.n_kept, :, member] for name, (c, member) in places.items()}

    def leave(self) -> None:
        """Leave the bodies in their motion at the end of the march."""
        places, instant = places_in(self._assembly), self._assembly.instant
        for propagator in self._bodies.propagators:
            forcing, propagator.instant = propagator.forcing, instant
            fields = []
            for kind, imposed in ((0, forcing.imposed_u(instant)), (1, forcing.imposed_v(instant))):
                full = np.stack([self._full(places, name, kind) for name in propagator.names], axis=1)
                fields.append(closest_reduced(propagator.members[0].expansion, full - imposed))
            propagator.state.set(*fields)

    def _full(self, places: Mapping[str, tuple[int, int]], name: str, kind: int) -> Array:
        """Displacements or velocities (n_full,) of a body at the present instant."""
        place = self._grouped.places[name]
        c, member = places[place.substructure]
        propagator = self._assembly.propagators[c]
        forcing, state = propagator.forcing, propagator.state
        free = (state.u, state.v)[kind][:, member]
        imposed = (forcing.imposed_u, forcing.imposed_v)[kind](propagator.instant)[:, member]
        return np.asarray(propagator.members[member].expansion @ free + imposed)[place.part]

    # -- parts of the histories ----------------------------------------------------------------------------------------
    def part(self, first: int, n_fields: int) -> dict[str, Any]:
        """As that of any recorder, with what the bonds need of the last instant."""
        memory = {name: recovery.memory.copy() for name, recovery in self._recoveries.items()}
        return {**super().part(first, n_fields), "bonds": memory}

    def append(self, part: Mapping[str, Any], first: int) -> None:
        """Put a ``part`` behind what has been kept."""
        super().append(part, first)
        for name, recovery in self._recoveries.items():
            recovery.memory[:] = part["bonds"][name]


def _selected(numbers: Index, n: int) -> sp.csr_array:
    """Rows (k, n) that pick these of n numbers."""
    return sp.csr_array((np.ones(len(numbers)), numbers, np.arange(len(numbers) + 1)), shape=(len(numbers), n))
