"""What drives a run by communication steps: sources, and how histories and initial state follow from them.

How the columns of the histories, the motion state and the initial state depend on the amplitudes of the sources
(``kernels.communication``) is not written down a second time: it is determined from ``Timeline.begin`` and
``initial_conditions`` by unit amplitudes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from ..assembly.supports import rates_of_steps
from ..joined.reduced_run import DrivePlace, ReducedMarch, drive_places
from ..kernels.communication import BY_BOTH, BY_VALUE, FREE
from ..kernels.inputs import DISPLACEMENT, LOAD, MOTION, WAVE
from ..latin.initial_conditions import initial_conditions
from ..latin.outcome import Array
from ..latin.run_image import histories
from ..propagator.forcing import SUMS
from ..scene.laws import ConstantLaw, InputLaw, sampled
from ..scene.schema import Scene
from ..time_scheme import NO_BRANCHES
from .input_table import Source, given_of, sources_of
from .load_strains import LoadStrains
from .segments import SegmentedRun, motion_size, packed_motions, unpacked_motions

_UNITS = (1.0, 1e3, 1e6)  # changes of an amplitude that are tried
_AFFINE = 1e-9  # of the initial state: difference that round-off can bring


@dataclass(frozen=True)
class Sources:
    """Amplitudes that drive a run: inputs, then laws of the scene that vary.

    Attributes
    ----------
    inputs, laws : names, as in ``input_table.sources_of``. kinds : of the inputs. table : (n_law, n) of the own laws at
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
        inputs = given_of(scene)
        time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        laws = {name: sample(time) for name, sample in _own_laws(scene).items()}
        varies = any(not isinstance(s.law, ConstantLaw) for s in sources_of(scene) if s.name in laws)
        start = np.array([source.start for source in inputs], dtype=float)
        if laws:
            table = np.stack([*laws.values()], axis=1)[: None if varies else 1]
        else:
            table = np.zeros((1, 0))
        names, kinds = tuple(s.name for s in inputs), tuple(s.drives for s in inputs)
        return cls(names, tuple(laws), kinds, start, table, len(time) - 1 if varies else -1)

    def law_amplitudes(self, scene: Scene, time: Array) -> Array:
        """Amplitudes of the own laws at other instants, (n, n_law)."""
        laws = _own_laws(scene)
        if laws:
            return np.stack([laws[name](time) for name in self.laws], axis=1)
        return np.zeros((len(time), 0))

    def __len__(self) -> int:
        return len(self.inputs) + len(self.laws)

    def initial(self) -> Array:
        """Amplitudes at the first two instants for the start values of the inputs, (2, n)."""
        # driven by its rate
        if self.inputs:
            start = np.where(np.array(self.kinds) == DISPLACEMENT, 0.0, self.start)
        else:
            start = self.start
        # instants 0 and 1; of a table of one row that row twice
        rows = self.table[[0, min(1, len(self.table) - 1)]]
        return np.concatenate([np.stack([start, start]), rows], axis=1)

    def named(self, amplitudes: Array) -> dict[str, Array]:
        """Histories (n_time, n) by name."""
        return dict(zip((*self.inputs, *self.laws), amplitudes.T, strict=True))


def _own_laws(scene: Scene) -> dict[str, Callable[[Array], Array]]:
    """What samples the laws of the scene that vary or move, as they drive the run, by source."""
    return {
        source.name: sampler(source, scene.time.end)
        for source in sources_of(scene)
        if not isinstance(source.law, InputLaw | ConstantLaw)
        or (isinstance(source.law, ConstantLaw) and source.drives not in (LOAD, WAVE))
    }


def sampler(source: Source, end: float) -> Callable[[Array], Array]:
    """What gives the law of a source at the instants of a run, as it drives the run; of a displacement its rate over
    the step that begins there. end : last instant of the run, s.
    """
    if source.drives == DISPLACEMENT:
        return partial(rates_of_steps, source.law.sample, end=end)
    if source.drives == MOTION:
        return source.law.sample
    return partial(sampled, source.law)


class Drives:
    """Columns of the histories, motion state and initial state of an assembly for given amplitudes of its sources.

    Attributes
    ----------
    bodies : the assembly that loads, driven faces and moving ground act on. assembly : the one that is marched, which
    is another one where the bodies are marched by their modes. strains : elongations of loads, the last numbers of the
    motion state. n_moved, n_state : numbers of the motion state before them, and all.
    """

    def __init__(self, run: SegmentedRun, sources: Sources) -> None:
        self.bodies, self.assembly = run.problem.assembly, run.problem.marched
        self._reduced = cast(ReducedMarch | None, run.problem.reduced)
        self._timeline = run.problem.timeline
        self.sources = sources
        self.dt = run.dt
        # all of them have terms, also those that are constant in this segment
        for propagator in self.bodies.propagators:
            propagator.forcing.sources = frozenset((*sources.inputs, *sources.laws))
        if self._reduced is not None:
            (propagator,) = self.assembly.propagators
            propagator.forcing.sources = frozenset(load.name for load in propagator.members[0].loads)
        self._start = dict(self.bodies.ground.start)
        self._grounds = list(self._start)
        self.strains = self._load_strains()
        self._strained = np.zeros(self.strains.size)
        self.n_moved = motion_size(self.bodies)
        self.n_state = self.n_moved + self.strains.size

    def _load_strains(self) -> LoadStrains:
        """What the branches of the bodies make of static responses to loads: of a reduced assembly."""
        if self._reduced is None:
            return LoadStrains([], NO_BRANCHES, self.dt)
        march = self._reduced
        places = [(k, p) for k, p in enumerate(drive_places(march.tied, self.bodies)) if self._varies(p)]
        return LoadStrains(places, self.assembly.propagators[0].branches, self.dt)

    def _varies(self, place: DrivePlace) -> bool:
        """Whether a drive of a reduced assembly is a motion, or a load that a source gives."""
        if place.kind is not None:
            return True
        load = self.bodies.propagators[place.number].forcing.members[place.member].loads[place.entry]
        return load.name in (*self.sources.inputs, *self.sources.laws)

    def begin(self, amplitudes: Array, state: Array | None = None) -> None:
        """Begin a segment with these amplitudes (n_time, n_source) from a motion state, None: from that at t = 0."""
        # without the histories of the segment before
        bodies = self.bodies
        dt = self.dt
        ground = self._start
        for propagator in bodies.propagators:
            propagator.restart()
        self._strained = np.zeros(self.strains.size) if state is None else state[self.n_moved :]
        if state is not None:
            motions, ground = unpacked_motions(bodies, state)
            for propagator, motion in zip(bodies.propagators, motions, strict=True):
                propagator.forcing.set_motion_state(motion)
        # instants count from the start of the segment
        time: Array = np.arange(float(len(amplitudes)))
        self._timeline.begin(bodies, time * dt, self.sources.named(amplitudes), ground, dt)
        if self._reduced is not None:
            if state is None:
                self._reduced.restart()
            self._reduced.begin()

    def columns(self, instant: int) -> Array:
        """Columns of an instant in the order of ``kernels.communication.spread_columns``."""
        parts = [np.zeros(0)]
        for propagator in self.assembly.propagators:
            forcing = propagator.forcing
            terms = forcing.sums(propagator.members[0].trace, propagator.dashpots)[1]
            for name in SUMS:
                # a term that is absent has no amplitudes, and no column
                amplitudes = []
                if name in terms:
                    amplitudes = terms[name].amplitudes
                parts.append(np.array([a[instant] for a in amplitudes]))
            if forcing.moves:
                parts.append(forcing.motion_table()[:, instant].ravel())
        tables = histories(self.assembly)
        names = ("ground_velocity", "ground_displacement", "ground_acceleration", "ground_layer")
        return np.concatenate([*parts, *(tables[name][instant] for name in names)])

    def reached(self, instant: int) -> Array:
        """Motion state at an instant of the segment."""
        strains = self.strains.after(self.bodies, self._strained, instant)
        return np.concatenate([packed_motions(self.bodies, instant), strains])

    def rows(self, amplitudes: Array) -> Array:
        """Drives (n_time, n_drive) at the instants of a segment that the assembly has begun, with the amplitudes
        (n_time, n_source) that it has begun with."""
        n, parts = len(amplitudes), [np.zeros((len(amplitudes), 0))]
        forcings = [propagator.forcing for propagator in self.bodies.propagators if propagator.forcing.moves]
        # rows are instants: (kind, instant, motion, member) turned
        parts += [forcing.motion_table().transpose(1, 0, 2, 3).reshape(n, -1) for forcing in forcings]
        ground = self.bodies.ground
        first = ground.end(0)
        for i in self._grounds:
            parts.append(first[i].displacement + ground.travel[i])
            # no acceleration before the first step: that of its start
            parts.append(np.concatenate([[first[i].acceleration], np.diff(ground.velocity[i], axis=0) / self.dt]))
        # at the first instant those before it are its own: nothing jumps there
        before = np.concatenate([amplitudes[:1], amplitudes[:-1]])
        return np.concatenate([*parts, before, amplitudes, np.ones((n, 1))], axis=1)

    def opening(self) -> list[Array]:
        """Initial state: u, v, a, residual and state on a stiffness of the face of the classes, f_hat and w_hat."""
        fields = initial_conditions(self.assembly)
        classes = list[Array]()
        for propagator in self.assembly.propagators:
            face = propagator.state.face
            classes += [*(x.ravel() for x in propagator.state.fields), np.zeros(0) if face is None else face.copy()]
        return [*classes, *fields]

    def inertia(self) -> list[float]:
        """Largest nodal force of inertia of each class at the first instant, N, that its motion from outside brings."""
        if self.assembly.quasi_static:
            return [0.0] * len(self.assembly.propagators)
        forces = [propagator.forcing.inertia(0) for propagator in self.assembly.propagators]
        return [0.0 if force is None else float(np.abs(force).max(initial=0.0)) for force in forces]

    def force_products(self) -> Array:
        """Products of the patterns of the forces of each class, one table after the other."""
        parts = [np.zeros(0)]
        for propagator in self.assembly.propagators:
            # read of quasi-static runs alone: how far the loads go on (``kernels.communication.continuation``)
            force = propagator.forcing.sums(propagator.members[0].trace, propagator.dashpots)[1]["force"]
            table = np.zeros((len(force.patterns), propagator.n_dof * len(propagator.members)))
            for row, (where, values) in zip(table, force.patterns, strict=True):
                row[where] = values
            parts.append((table @ table.T).ravel())
        return np.concatenate(parts)

    def slides(self) -> dict[int, Array]:
        """Velocity (3,) of the ground of interfaces at the last instant."""
        return {i: self.assembly.ground.velocity[i][-1] for i in self.assembly.ground.start}


def _matrix(of: Callable[[Array], Array], n: int) -> sp.csr_array:
    """Matrix of an affine function of n numbers; its last column is the value at zero."""
    # column by column: which drive a column depends on is not known beforehand
    base = of(np.zeros(n))
    columns = [sp.csc_array((of(unit) - base)[:, None]) for unit in np.eye(n)]
    # the constant part meets the 1 at the end of the drives
    return sp.csr_array(sp.hstack([*columns, sp.csc_array(base[:, None])]))


def history_fields(drives: Drives) -> dict[str, Any]:
    """Columns and motion state of a time step, and those at t = 0, as matrices over the drives; the sources."""
    n_x, n_s = drives.n_state, len(drives.sources)

    def step(z: Array) -> Array:
        # two instants from the state before the step: number 1 is its end
        drives.begin(z[n_x:].reshape(2, n_s), z[:n_x])
        return np.concatenate([drives.columns(1), drives.reached(1)])

    def first(z: Array) -> Array:
        drives.begin(z[n_x:].reshape(2, n_s))
        return np.concatenate([drives.columns(0), drives.reached(0)])

    def start(z: Array) -> Array:
        # from a state, not from t = 0: the start of any later step
        drives.begin(z[n_x:].reshape(2, n_s), z[:n_x])
        return np.concatenate([drives.columns(0), drives.reached(0)])

    fields: dict[str, Any] = {}
    static = drives.assembly.quasi_static
    for prefix, of in (("", step), ("first_", first), *((("start_", start),) if static else ())):
        matrix = _matrix(of, n_x + 2 * n_s)
        # of an empty state -0 would be all rows, and is none
        fields[f"{prefix}column"], fields[f"{prefix}motion"] = matrix[: matrix.shape[0] - n_x], matrix[-n_x or None :]
        if not n_x:
            fields[f"{prefix}column"], fields[f"{prefix}motion"] = matrix, matrix[:0]
    # of the start the columns alone are needed: its motion state is the one that is given
    fields.pop("start_motion", None)
    if static:
        products = drives.force_products()
    else:
        products = np.zeros(0)
    sources, sizes = drives.sources, {"n_motion_state": n_x, "n_drive": n_x + 2 * n_s + 1, "n_source": n_s}
    inputs = {"n_input": len(sources.inputs), "input_kind": np.array(sources.kinds, dtype=np.int64)}
    inputs |= {"input_held": np.full(len(sources.inputs), FREE), "input_start": sources.start}
    laws = {"law_table": sources.table, "law_end": sources.end}
    return fields | sizes | inputs | laws | {"force_products": products}


def opening_fields(drives: Drives, settled: bool) -> dict[str, Any]:
    """What of the initial state depends on the inputs, as a matrix over the drives, and the inputs that are held.

    settled : whether the scene starts from an equilibrium that its loads determine. Held are then the loads; always
    displacements, whose initial value the geometry contains, and inputs that the initial state depends on otherwise
    than linearly.
    """
    sources = drives.sources
    n_x = drives.n_state
    n_s = len(drives.sources)
    start, kinds = sources.initial(), np.array(sources.kinds, dtype=np.int64)

    def opening(amplitudes: Array) -> list[Array]:
        drives.begin(amplitudes)
        return drives.opening()

    base = opening(start)
    units = [
        0.0 if settled and kind in (LOAD, WAVE) else _linear_over(drives, start, base, e)
        for e, kind in enumerate(kinds)
    ]
    linear = np.array(units, dtype=float) > 0.0
    # inputs on which it depends linearly have columns: without them here
    zero = start * np.concatenate([~linear, np.ones(n_s - len(kinds))])
    base, columns = opening(zero), dict[int, Array]()
    for e in np.flatnonzero(linear).tolist():
        for row in range(2):
            # 0 where the input was taken out
            unit = zero.copy()
            unit[row, e] += units[e]
            columns[n_x + row * n_s + e] = (np.concatenate(opening(unit)) - np.concatenate(base)) / units[e]
    table = np.zeros((sum(map(len, base)), n_x + 2 * n_s + 1))
    for at, column in columns.items():
        table[:, at] = column
    place = np.flatnonzero(table.any(axis=1))
    # behind ``place``: the constant part alone is in the image already
    table[:, -1] = np.concatenate(base)
    # free is an input with a column, but for a displacement, whose initial value is part of the geometry
    constraint = np.where(
        linear,
        np.where(kinds == DISPLACEMENT, BY_VALUE, FREE),
        np.where(np.isin(kinds, (LOAD, WAVE)), BY_VALUE, BY_BOTH),
    )
    return {
        "opening_place": place.astype(np.int64),
        "opening": sp.csr_array(table[place]),
        "input_held": constraint.astype(np.int64),
    }


def _linear_over(drives: Drives, start: Array, base: list[Array], e: int) -> float:
    """A change of the amplitude of an input over which the initial state is an affine function of it; 0 where there is
    none. A larger one where round-off of large forces hides what a change of 1 brings."""
    return next((unit for unit in _UNITS if _is_affine(drives, start, base, e, unit)), 0.0)


def _is_affine(drives: Drives, start: Array, base: list[Array], e: int, unit: float) -> bool:
    """Whether the initial state is an affine function of the amplitudes of an input at the first two instants. A
    residual is a difference of forces: its round-off is that of the forces of inertia."""
    changes, forces = [], np.zeros(len(drives.assembly.propagators))
    # without the input, where the columns of the opening begin: a body that slides at the start value may stand there
    back = -start[:, e] / unit
    far = max(1.0, float(np.abs(back).max()))
    for change in ((1.0, 0.0), (0.0, 1.0), (-2.0, 0.5), back):
        amplitudes = start.copy()
        amplitudes[:, e] += unit * np.array(change)
        drives.begin(amplitudes)
        changes.append([new - old for new, old in zip(drives.opening(), base, strict=True)])
        forces = np.maximum(forces, drives.inertia())
    for k, (old, first, second, both, without) in enumerate(zip(base, *changes, strict=True)):
        # affine: f(a, b) - f = a (f(1, 0) - f) + b (f(0, 1) - f)
        scale = np.abs(old) + np.abs(first) + np.abs(second)
        # fields are u, v, a, residual and state of the face of each class in turn: 3 is the residual
        if k % 5 == 3 and k // 5 < len(forces):
            residual = forces[k // 5]
        else:
            residual = 0.0
        allowed = _AFFINE * max(scale.max(initial=0.0), residual)
        if np.abs(both + 2.0 * first - 0.5 * second).max(initial=0.0) > allowed:
            return False
        if np.abs(without - back[0] * first - back[1] * second).max(initial=0.0) > far * allowed:
            return False
    return True
