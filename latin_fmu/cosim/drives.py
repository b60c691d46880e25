"""What drives a run by communication steps: sources, and how histories and initial state follow from them.

How the columns of the histories, the motion state and the initial state depend on the amplitudes of the sources
(``kernels.communication``) is not written down a second time: it is determined from ``Timeline.begin`` and
``initial_conditions`` by unit amplitudes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..assembly.segments import SegmentedRun
from ..assembly.supports import Motion
from ..kernels.communication import DISPLACEMENT, LOAD, MOTION
from ..latin.assembly import GroundState
from ..latin.initial_conditions import initial_conditions
from ..latin.record import Array
from ..latin.run_image import histories
from ..propagator.forcing import SUMS
from ..scene.boundaries import Driven
from ..scene.laws import ConstantLaw, InputLaw, sampled
from ..scene.schema import Scene
from .loads import Loads
from .variable import is_motion
from .variables import inputs_of

_AFFINE = 1e-9  # of the initial state: difference that round-off can bring


@dataclass(frozen=True)
class Sources:
    """Amplitudes that drive a run: inputs, then laws of the scene that vary.

    Attributes
    ----------
    inputs, laws : names, as in ``variables.inputs_of``. kinds : of the inputs. table : (n_law, n) of the own laws at
    the time steps; of a displacement its rate. end : time steps that the table holds, -1 where its last row holds ever
    after.
    """

    inputs: tuple[str, ...]
    laws: tuple[str, ...]
    kinds: tuple[int, ...]
    start: Array
    table: Array
    end: int

    @classmethod
    def of(cls, scene: Scene) -> Sources:
        """The sources of a scene."""
        given, loads = inputs_of(scene), Loads(scene)
        time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        laws = {n: law for n, law in scene.force_laws.items() if not isinstance(law, InputLaw | ConstantLaw)}
        own = {name: sampled(law, time) for name, law in laws.items()}
        varies = bool(own)
        for name, boundary in scene.boundary.items():
            if isinstance(boundary, Driven) and f"boundary.{name}" not in given:
                law, motion = boundary.law, Motion(boundary.law, 1.0, boundary.type)
                of_rate = motion.step_velocity if scene.time.quasi_static else motion.velocity
                own[f"boundary.{name}"] = of_rate(time) if boundary.type == "displacement" else law.sample(time)
                varies |= not isinstance(law, ConstantLaw)
        for name, interface in scene.joints.items():
            if interface.ground_velocity is not None and f"ground.{name}" not in given:
                own[f"ground.{name}"] = interface.ground_velocity.law.sample(time)
                varies |= not isinstance(interface.ground_velocity.law, ConstantLaw)
        kinds = [DISPLACEMENT if n in loads.starts() else MOTION if is_motion(n) else LOAD for n in given]
        start = np.array([law.start_value for law in given.values()], dtype=float)
        table = np.stack([*own.values()], axis=1) if own else np.zeros((1, 0))
        return cls(tuple(given), tuple(own), tuple(kinds), start, table, len(time) - 1 if varies else -1)

    def __len__(self) -> int:
        return len(self.inputs) + len(self.laws)

    def initial(self) -> Array:
        """Amplitudes at the first two instants for the start values of the inputs, (2, n)."""
        held = np.where(np.array(self.kinds) == DISPLACEMENT, 0.0, self.start) if self.inputs else self.start
        own = self.table[[0, min(1, len(self.table) - 1)]]
        return np.concatenate([np.stack([held, held]), own], axis=1)

    def named(self, amplitudes: Array) -> dict[str, Array]:
        """Histories (n_time, n) by name."""
        return dict(zip((*self.inputs, *self.laws), amplitudes.T, strict=True))


class Drives:
    """Columns of the histories, motion state and initial state of an assembly for given amplitudes of its sources."""

    def __init__(self, run: SegmentedRun, sources: Sources) -> None:
        self.assembly, self._timeline, self.sources = run.problem.assembly, run.problem.timeline, sources
        for propagator in self.assembly.propagators:
            propagator.forcing.sources = frozenset((*sources.inputs, *sources.laws))
        self._start = dict(self.assembly.ground_start)
        self._shapes = [(p.members[0].imposed_pattern.shape[1], len(p.members)) for p in self.assembly.propagators]
        self._grounds = list(self._start)
        self.n_state = sum(3 * k * m for k, m in self._shapes) + 3 * len(self._grounds)

    def begin(self, amplitudes: Array, state: Array | None = None) -> None:
        """Begin a segment with these amplitudes (n_time, n_source) from a motion state, None: from that at t = 0."""
        assembly, dt, at = self.assembly, self.assembly.dt, 0
        for propagator, (k, m) in zip(assembly.propagators, self._shapes, strict=True):
            propagator.restart()
            if state is not None:
                u, v, a = state[at : at + 3 * k * m].reshape(3, k, m)
                propagator.forcing.set_motion_state([(u[:, j], a[:, j], v[:, j]) for j in range(m)])
            at += 3 * k * m
        ground = dict(self._start)
        for i in self._grounds if state is not None else ():
            assert state is not None
            ground[i] = GroundState(state[at : at + 3], np.zeros(3))
            at += 3
        time: Array = np.arange(float(len(amplitudes)))
        self._timeline.begin(assembly, time * dt, self.sources.named(amplitudes), ground, dt)

    def columns(self, instant: int) -> Array:
        """Columns of an instant in the order of ``kernels.communication.spread_columns``."""
        parts = [np.zeros(0)]
        for propagator, (k, _) in zip(self.assembly.propagators, self._shapes, strict=True):
            forcing = propagator.forcing
            terms = forcing.sums(propagator.members[0].trace, propagator.dashpots)[1]
            for name in SUMS:
                amplitudes = terms[name].amplitudes if name in terms else []
                parts.append(np.array([a[instant] for a in amplitudes]))
            if k:
                parts.append(forcing.motion_table()[:, instant].ravel())
        tables = histories(self.assembly)
        names = ("ground_velocity", "ground_displacement", "ground_acceleration", "ground_layer")
        return np.concatenate([*parts, *(tables[name][instant] for name in names)])

    def state(self, instant: int) -> Array:
        """Motion state of an instant."""
        parts = [np.zeros(0)]
        for propagator, (k, _) in zip(self.assembly.propagators, self._shapes, strict=True):
            if k:
                parts.append(propagator.forcing.motion_table()[:, instant].ravel())
        ground = self.assembly.ground_end(instant)
        return np.concatenate([*parts, *(ground[i].displacement for i in self._grounds)])

    def opening(self) -> Array:
        """Initial state: u, v, a and residual of the classes, f_hat and w_hat."""
        fields = initial_conditions(self.assembly)
        states = [np.concatenate([x.ravel() for x in p.state[1:]]) for p in self.assembly.propagators]
        return np.concatenate([*states, *fields])

    def slides(self) -> dict[int, Array]:
        """Velocity (3,) of the ground of interfaces at the last instant."""
        return {i: self.assembly.ground[i][-1] for i in self._grounds}


def _matrix(of: Callable[[Array], Array], n: int) -> sp.csr_array:
    """Matrix of an affine function of n numbers; its last column is the value at zero."""
    base = of(np.zeros(n))
    columns = [sp.csc_array((of(unit) - base)[:, None]) for unit in np.eye(n)]
    return sp.csr_array(sp.hstack([*columns, sp.csc_array(base[:, None])]))


def history_fields(drives: Drives) -> dict[str, Any]:
    """Columns and motion state of a time step, and those at t = 0, as matrices over the drives."""
    n_x, n_s = drives.n_state, len(drives.sources)

    def step(z: Array) -> Array:
        drives.begin(z[n_x:].reshape(2, n_s), z[:n_x])
        return np.concatenate([drives.columns(1), drives.state(1)])

    def first(z: Array) -> Array:
        drives.begin(z[n_x:].reshape(2, n_s))
        return np.concatenate([drives.columns(0), drives.state(0)])

    fields: dict[str, Any] = {}
    for prefix, of in (("", step), ("first_", first)):
        matrix = _matrix(of, n_x + 2 * n_s)
        fields[f"{prefix}column"], fields[f"{prefix}motion"] = matrix[: matrix.shape[0] - n_x], matrix[-n_x or None :]
        if not n_x:
            fields[f"{prefix}column"], fields[f"{prefix}motion"] = matrix, matrix[:0]
    return fields | {"n_column": fields["column"].shape[0], "n_motion_state": n_x, "n_drive": n_x + 2 * n_s + 1}


def opening_fields(drives: Drives, free: bool) -> dict[str, Any]:
    """What of the initial state depends on the inputs; ``free``: whether it is determined for other start values than
    those of the scene. An input that it depends on otherwise than linearly is held."""
    sources, n_x, n_s = drives.sources, drives.n_state, len(drives.sources)
    n_input, start = len(sources.inputs), sources.initial()

    def opening(change: Array) -> Array:
        drives.begin(start + change)
        return drives.opening()

    base = opening(np.zeros_like(start))
    held = np.array([int(kind == DISPLACEMENT or not free) for kind in sources.kinds], dtype=np.int64)
    for e in np.flatnonzero(held == 0):
        changes = []
        for first, second in ((1.0, 0.0), (0.0, 1.0), (-2.0, 0.5)):
            change = np.zeros_like(start)
            change[:, e] = first, second
            changes.append(opening(change) - base)
        scale = np.abs(base) + np.abs(changes[0]) + np.abs(changes[1])
        off = np.abs(changes[2] + 2.0 * changes[0] - 0.5 * changes[1])
        held[e] = (off > _AFFINE * (scale + 1e-6 * scale.max(initial=0.0))).any()
    zero = start * np.concatenate([held, np.ones(n_s - n_input)])
    base, columns = opening(zero - start), dict[int, Array]()
    for e in np.flatnonzero(held == 0):
        for row in range(2):
            change = zero - start
            change[row, e] += 1.0
            columns[n_x + row * n_s + e] = opening(change) - base
    touched = np.zeros(len(base), dtype=bool)
    for column in columns.values():
        touched |= column != 0.0
    place = np.flatnonzero(touched)
    table = np.zeros((len(place), n_x + 2 * n_s + 1))
    table[:, -1] = base[place]
    for at, column in columns.items():
        table[:, at] = column[place]
    return {
        "n_opening": len(place),
        "opening_place": place.astype(np.int64),
        "opening": sp.csr_array(table),
        "input_held": held,
        "input_start": sources.start,
        "input_kind": np.array(sources.kinds, dtype=np.int64),
        "law_table": sources.table,
        "n_law": len(sources.table),
        "law_end": sources.end,
        "n_input": n_input,
        "n_source": n_s,
    }
