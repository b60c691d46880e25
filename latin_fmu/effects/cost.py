"""Predicted CPU time and memory of a run, before anything is factorised, and whether it fits.

An instant reads the factors, the sparse matrices and the condensed operators of all substructures once or several
times. The prediction counts their entries; five times per operation turn counts into seconds on one core of a
common server. ``examples/benchmarks/cost_model.py`` compares prediction and measurement, and fits the constants
(``--fit``). On another machine all of them change by about the same factor: shares and comparisons stay.

Memory is compared with what this process may take. The sizes of arrays are counted; what the libraries take in between
(matrices while they are assembled, factors while they are computed, copies while results are written) is a factor on
them, measured on boxes and blocks (``tests/test_memory.py``). They are estimates to some 30 %: a run is refused only
where they exceed the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy.sparse as sp

from ..assembly.inactive_substructures import arrival_times, marched_share
from ..assembly.problem import DiscretisedProblem, characteristic_traction, settings_of
from ..assembly.propagator_choice import (
    ClassSize,
    PropagatorSettings,
    chosen_propagators,
    class_size,
    factor_bytes,
    interfaces_of,
    operator_bytes,
)
from ..cholesky.substitution import LANES
from ..errors import SceneError
from ..interface.laws import bonds
from ..kernels.energy_parts import TERMS
from ..kernels.krylov import VECTORS
from ..latin.assembly import Array, InterfaceUnit, class_points
from ..latin.search_direction import LARGEST
from ..latin.tied_bodies import MOST_TIED
from ..machine import memory_room
from ..propagator.direct import ConjugateGradients
from ..propagator.interface_probing import ROUGH, Points, truncation_of
from ..propagator.interface_sweeps import SET_UP, long_steps, stiffness_over_inertia
from ..propagator.model import SubstructureModel, operator_weights
from ..results.writing import IN_MEMORY, STREAMED
from ..scene.schema import Scene
from ..scene.settings import WHOLE
from ..time_scheme import TimeScheme

if TYPE_CHECKING:
    from ..joined.bond_groups import GroupedAssembly

OPERATIONS: Final = ("flop", "entry", "sparse", "value", "call")
"""``flop`` : multiplications of a factorisation. ``entry`` : entries of factors and condensed operators that are read.
``sparse`` : the same of sparse matrices. ``value`` : values of the vectors of an instant, all their operations
together. ``call`` : calls of the Python driver."""


def numbers(**amounts: float) -> Array:
    """Counts of operations, or the CPU seconds of one of each, in the order of ``OPERATIONS``."""
    return np.array([amounts.get(name, 0.0) for name in OPERATIONS])


SECONDS: Final = numbers(flop=3.5e-11, entry=1.8e-10, sparse=4.8e-10, value=9.5e-9, call=1.3e-4)
CACHE: Final = 8e6  # bytes of operators; the part that does not fit in the cache takes twice as long
_TOGETHER = 0.5  # cost of one more member of a class over the cost of the first
_PASSES = 0.65  # sweeps of the whole interval per iteration: instants before the first change are not marched again
_SEQUENTIAL = 3.0  # sweeps of the whole interval after a sequential start
_CALLS = 20.0  # of the Python driver that a run, and each class of substructures, takes once
_CG_STEPS = 40  # iterations of conjugate gradients per solution, for steps near the wave transit of an element
_SOLVED = 3.0  # multiplications of a column of a table, over the entries of the factor that it takes
_PATTERNS = 900.0  # entries: patterns and sums of matrices of a class without dense interfaces, tables of the residual
_KEPT = 0.3  # calls that keep the fields of a class
_LANCZOS = 60  # products with the stiffness for the stable step of an explicit propagator
_STRESS = numbers(sparse=144.0, value=30.0)  # per cell of the stress recovery
_SAMPLED = 1e-3  # residual of the columns of ``_reach``, in truncations
_COLOURS = 1.4  # colours of a table, over the points within its radius of a point inside
_OF_CHECK = 0.8  # columns of the tables of the force residual, over those of Y

# LATIN iterations per window, measured on the shipped models and benchmarks; friction: per coupled interface; growth of
# those of an instant by the decade of stiffness over inertia in a step: at the tolerance 1e-3, and by its decades
FRICTION = 2.05
PER_INTERFACE = 0.25
MOST_COUPLED = 7
CONTACT = 1.8
BONDED = 4.0
LAYERED = 3.6
STATIC = 7.0
LONG_WINDOW = 6.0
_BY_STEP = 0.5
_BY_TOLERANCE = 0.8
_TOLERANCE = 1e-3
# the same of an increment of a static start, which is solved to round-off; with the products of its Newton steps, which
# large interfaces need
_CLOSELY, _CLOSELY_LARGE = 40.0, 400.0


@dataclass(frozen=True)
class RunClass:
    """A class of identical substructures in a run. size : of its operators. nodes, cells : of one member's mesh.
    rigid : whether it cannot deform. marched : share of the instants at which it is marched."""

    size: ClassSize
    nodes: int
    cells: int
    rigid: bool
    marched: float = 1.0

    @property
    def together(self) -> float:
        """Cost of one instant of all members over that of one member."""
        return self.marched * (1.0 + _TOGETHER * (self.size.members - 1))


@dataclass(frozen=True)
class RunSize:
    """Sizes that determine the cost of a run.

    Attributes
    ----------
    classes : of substructures. propagator : its settings. n_flat : interface unknowns, both sides.
    n_instant : steps. window : instants per window. sequential : whether a longer window starts from a sequential pass.
    iterations : LATIN iterations expected per window. effort : factor on those of short steps.
    static : no inertia. at_once : one linear solve per instant.
    fields, stress, energy, every : stored quantities. unbalanced : accelerations at t = 0 have to be solved for.
    increments : of the static problems before the motion, 0 where there are none.
    """

    classes: tuple[RunClass, ...]
    propagator: PropagatorSettings
    n_flat: int
    n_instant: int
    window: int
    sequential: bool
    iterations: float
    effort: float
    static: bool
    at_once: bool
    fields: bool
    stress: bool
    energy: bool
    every: int
    unbalanced: bool
    increments: int

    def scaled(self, **factors: float) -> RunSize:
        """With sizes of every class (names of ``ClassSize``) multiplied by factors."""

        def changed(c: RunClass) -> RunClass:
            return replace(c, size=replace(c.size, **{k: round(f * getattr(c.size, k)) for k, f in factors.items()}))

        return replace(self, classes=tuple(map(changed, self.classes)))


def run_size(discretised: DiscretisedProblem, grouped: GroupedAssembly | None = None) -> RunSize:
    """Sizes of the run of a discretised problem, ``grouped`` where bonded bodies are one substructure."""
    scene, marched = discretised.scene, of_groups(discretised, grouped)
    units, layout = marched.units, marched.layout
    share = _marched(discretised)
    output = scene.output
    effort = _effort(discretised)
    bodies = {m.name: [m.name] for c in marched.classes for m in c.members}
    if grouped is not None:
        bodies |= {g.model.name: list(g.where) for g in grouped.groups}
    classes, interfaces = [], interfaces_of(scene)
    sizes = iterated(marched, [class_size(c.members[0], len(c.members), interfaces) for c in marched.classes])
    for c, size in zip(marched.classes, sizes, strict=True):
        members = [discretised.bodies[name] for name in bodies[c.members[0].name]]
        counts = sum(body.mesh.n_node for body in members), sum(body.mesh.n_cell for body in members)
        # members of a class may start to move at different instants: the mean counts
        moving = float(np.mean([max(share[name] for name in bodies[m.name]) for m in c.members]))
        classes.append(RunClass(size, *counts, members[0].rigid, moving))
    return RunSize(
        classes=tuple(classes),
        propagator=chosen_propagators(scene, marched.classes)[0],
        n_flat=layout.n_flat,
        n_instant=scene.time.n_step,
        window=scene.time.n_step if scene.solver.window == WHOLE else int(scene.solver.window),
        sequential=scene.solver.window != 1 and scene.solver.start == "sequential",
        iterations=expected_iterations(scene, units, effort),
        effort=effort,
        static=scene.time.quasi_static,
        at_once=solved_at_once(scene, units),
        fields=output.keeps_fields,
        stress=output.stress,
        energy=output.energy,
        every=output.every,
        unbalanced=_unbalanced(scene),
        increments=_increments(discretised),
    )


def of_groups(discretised: DiscretisedProblem, grouped: GroupedAssembly | None) -> DiscretisedProblem:
    """The problem with the substructures and interfaces of the march, for their sizes alone."""
    if grouped is None:
        return discretised
    return replace(discretised, classes=grouped.classes, units=grouped.units, layout=grouped.layout)


def solved_at_once(scene: Scene, units: Sequence[InterfaceUnit]) -> bool:
    """Whether every instant is one linear solve: perfect interfaces only, windows of one instant."""
    solver = scene.solver
    direct = solver.window == 1 and solver.bonds == "direct" and not scene.time.quasi_static
    return direct and bool(units) and all(bonds(u.behaviour) for u in units)


def expected_iterations(scene: Scene, units: Sequence[InterfaceUnit], effort: float) -> float:
    """LATIN iterations of a window (one solve of perfect interfaces counts as one); ``effort`` as in ``RunSize``."""
    if not units:
        return 0.0
    if solved_at_once(scene, units):
        return 1.0
    if scene.time.quasi_static:
        return STATIC
    if scene.solver.window != 1:
        return LONG_WINDOW
    if any(not u.behaviour.opens for u in units):
        return effort * (BONDED if any(bonds(u.behaviour) for u in units) else LAYERED)
    if any(u.behaviour.n_component > 1 for u in units):
        return effort * (FRICTION + PER_INTERFACE * min(len(units), MOST_COUPLED))
    return effort * CONTACT


def _effort(d: DiscretisedProblem) -> float:
    """Factor on the iterations of an instant by the length of the step and the tolerance.

    In a step in which waves cross many elements an interface feels all others at once, as in statics, and convergence
    is slower. The measure is the stiffness over the inertia in the operator of the march, the median of a body and the
    geometric mean of all. The tolerance counts from the largest traction, that of tight bolts included, of which
    motions may be a small part.
    """
    if d.scene.time.quasi_static or not d.units:
        return 1.0
    weights, elastic = d.scheme.operator(d.dt), (c.members[0].reduced for c in d.classes if c.members[0].nodal is None)
    ratios = [stiffness_over_inertia(weights, mass, stiffness) for mass, _, stiffness in elastic]
    ratios = [ratio for ratio in ratios if ratio > 0.0]
    if ratios:
        decades = float(np.mean(np.log10(np.add(1.0, ratios))))
    else:
        decades = 0.0
    moving = characteristic_traction(d.scene, d.bodies, d.time)
    relative = d.scene.solver.tolerance * (d.characteristic_traction / moving if moving else 1.0)
    stricter = max(0.0, float(np.log10(_TOLERANCE / relative)))
    return 1.0 + decades * (_BY_STEP + _BY_TOLERANCE * stricter)


def _marched(discretised: DiscretisedProblem) -> dict[str, float]:
    """Share of the instants at which each substructure is marched: without a tolerance for substructures at rest an
    implicit march leaves out only those that no wave reaches."""
    scene, names = discretised.scene, discretised.bodies
    if scene.time.quasi_static or scene.solver.skip_at_rest == "off":
        return dict.fromkeys(names, 1.0)
    arrival = arrival_times(scene, discretised.bodies, discretised.units, discretised.time)
    if scene.solver.skip_at_rest == "tolerance":
        return {name: marched_share(arrival[name], discretised.time) for name in names}
    return {name: float(np.isfinite(arrival[name])) for name in names}


def _increments(discretised: DiscretisedProblem) -> int:
    """Increments of the tightening of each order of bolts, and of the equilibrium under what acts at t = 0."""
    scene, start = discretised.scene, discretised.scene.time.start
    if start.type != "static":
        return 0
    from ..statics.statics import something_acts, static_scene

    orders = len({cut.table.order for cut in discretised.cuts.values()})
    loaded = not scene.time.quasi_static and something_acts(static_scene(scene, {}))
    return start.increments * (orders + loaded)


def _unbalanced(scene: Scene) -> bool:
    """Whether forces act at t = 0 without an equilibrium under them."""
    if scene.time.quasi_static or scene.time.start.type == "static":
        return False
    return any(law.sample(np.zeros(1))[0] != 0.0 for law in scene.force_laws.values())


# -- counts -----------------------------------------------------------------------------------------------------------
def operator_counts(run: RunSize) -> Array:
    """Operations that make the operators of all classes from their matrices."""
    kind, modes = "direct" if run.static else run.propagator.kind, run.propagator.modes
    total = numbers(call=_CALLS * len(run.classes))
    for size in (c.size for c in run.classes):
        dense = size.flops + size.interface**3 + 3.0 * size.channels**3
        if size.swept:
            dense = SET_UP * size.flops + _SOLVED * size.columns * size.swept
            total += numbers(sparse=_PATTERNS * size.stiffness)
        if kind == "direct":
            total += numbers(flop=dense)
        elif kind == "explicit":
            total += numbers(sparse=_LANCZOS * size.stiffness)
        elif kind == "reduced":
            total += numbers(flop=dense + size.flops + 6.0 * size.unknowns * size.basis(modes) ** 2)
            total += numbers(entry=16.0 * size.factor * (size.channels + 5 * modes))
        # conjugate gradients: no factor, one solution per unknown of the interface
        else:
            total += _CG_STEPS * size.interface * numbers(sparse=size.sparse, value=0.5 * size.unknowns)
    return total


def march_counts(run: RunSize) -> Array:
    """Operations of all instants, with the start and the stored quantities."""
    # iterations of one instant are products with condensed matrices; those of a longer window march again
    if run.window == 1:
        sweeps = 1.0
    else:
        sweeps = run.iterations + 1.0
    if run.sequential:
        sweeps = _SEQUENTIAL
    elif run.window >= run.n_instant > 1:
        sweeps *= _PASSES
    total = sweeps * run.n_instant * _instant(run) + _stored(run) + numbers(call=_CALLS)
    if run.at_once:
        total += numbers(flop=float(run.n_flat) ** 3, entry=float(run.n_instant * run.n_flat**2))
    if run.increments:
        # K alone has factors of its own, made and left before the march: no tables, products in double precision
        sizes = (replace(c.size, columns=0.0, product=2.0 * c.size.swept) for c in run.classes)
        classes = tuple(replace(c, size=size) for c, size in zip(run.classes, sizes, strict=True))
        if any(c.size.swept for c in classes):
            iterations = _CLOSELY_LARGE
        else:
            iterations = _CLOSELY
        start = replace(run, classes=classes, static=True, window=1, iterations=iterations)
        total += run.increments * _instant(start) + operator_counts(start)
    elif run.unbalanced:
        # M a = f - K u at t = 0: another factor
        total += numbers(flop=sum(c.size.flops for c in run.classes), call=_CALLS)
    return total


def _instant(run: RunSize) -> Array:
    """One instant of all classes and interfaces (of one sweep, where a window has several)."""
    if run.window == 1 or run.static:
        iterations = run.iterations
    else:
        iterations = 1.0
    total = numbers(value=(iterations + 2.0) * run.n_flat)
    memory = 0.0
    for c in run.classes:
        one = _march(run, c.size, iterations)
        memory += float(one @ numbers(entry=4.0, sparse=12.0))  # bytes; factors are read twice
        total += c.together * one
    if run.static:
        total += numbers(call=(min(iterations, STATIC) + 2.0) * len(run.classes))
    # the part of the operators that each instant reads from memory again
    if memory:
        beyond = max(0.0, 1.0 - CACHE / memory)
    else:
        beyond = 0.0
    return total * (1.0 + numbers(entry=beyond))  # on entries alone: the others stay as counted


def _march(run: RunSize, size: ClassSize, iterations: float) -> Array:
    """One instant of one substructure: half solves, sparse products, one condensed product per iteration."""
    kind = run.propagator.kind
    n = float(size.unknowns)
    condensed = (iterations + 1.0) * size.channels**2
    # entries are counted as numbers of 8 bytes: one in single precision is half of one
    if run.propagator.precision == "float64":
        factor = size.factor
    else:
        factor = 0.5 * size.factor
    dense = 2.0 * size.interface**2 + condensed
    if size.swept:  # of the march; of the force residual, by tables where steps are short; of the iteration
        dense = (4.0 if size.product >= 2.0 * size.swept else 2.0) * size.swept + iterations * size.product
    if run.static:
        return numbers(entry=2.0 * factor + dense)
    if kind == "direct":
        # modal damping: in the product with C and in both half solves
        dense += 3.0 * size.modal * n
        return numbers(entry=2.0 * factor + dense, sparse=size.sparse, value=n)
    if kind == "explicit":
        return numbers(sparse=size.stiffness + size.damping, value=n)
    if kind == "reduced":
        basis = float(size.basis(run.propagator.modes))
        return numbers(entry=4.0 * size.channels * basis + condensed, value=basis)
    steps = 2.5 * _CG_STEPS  # two solutions of an instant; fitted to the times of four shipped models
    return numbers(entry=dense, sparse=steps * size.sparse, value=0.5 * steps * n)


def _stored(run: RunSize) -> Array:
    """Energies at every instant, fields and stress at those that are stored."""
    total, stored = numbers(), run.n_instant // run.every + 1.0  # with t = 0
    for c in run.classes:
        if run.energy:
            total += run.n_instant * c.together * numbers(sparse=c.size.sparse, value=c.size.unknowns)
        if run.fields:
            total += stored * numbers(value=6.0 * c.nodes * c.size.members, call=_KEPT)
        if run.stress and not c.rigid:
            total += stored * (c.cells * c.size.members * _STRESS + numbers(call=1.0))
    return total


# -- seconds ----------------------------------------------------------------------------------------------------------
def seconds(counts: Array) -> float:
    """CPU time of so many operations, s."""
    return float(counts @ SECONDS)


PAYS: Final = 20.0
"""Predicted CPU seconds of the march of the bodies from which on modes are tried: their own set-up takes seconds."""


class Prediction:
    """Predicted cost of a discretised problem: CPU seconds of its operators and of its march, memory in bytes.

    preparation : CPU seconds that meshes, matrices and interfaces took. grouped : the substructures of the march where
    bonded bodies are one.
    """

    def __init__(
        self, discretised: DiscretisedProblem, preparation: float = 0.0, grouped: GroupedAssembly | None = None
    ) -> None:
        self.discretised = of_groups(discretised, grouped)
        self.scene = discretised.scene
        self.preparation = preparation
        self.run = run_size(discretised, grouped)

    @cached_property
    def tables(self) -> Tables | None:
        """Sparse tables of large interfaces, by a sample of their columns; None where there are none."""
        return tables(self.discretised, [c.size for c in self.run.classes])

    def with_tables(self) -> Prediction:
        """The same, with the products of the iteration by the tables; without them they are counted by substitution."""
        if self.tables is not None:
            sizes = self.tables.in_sizes([c.size for c in self.run.classes])
            # iterations read entries of four bytes, half of what an entry of a factor counts
            pairs = zip(self.run.classes, sizes, strict=True)
            self.run = replace(self.run, classes=tuple(replace(c, size=size) for c, size in pairs))
        return self

    @cached_property
    def operators(self) -> float:
        """Factorised and condensed operators, s."""
        return seconds(operator_counts(self.run))

    @cached_property
    def march(self) -> float:
        """All instants, stored quantities included, s."""
        return seconds(march_counts(self.run))

    @cached_property
    def tries_modes(self) -> bool:
        """Whether the program tries the march by the modes of the assembly before that by its bodies."""
        if self.scene.time.quasi_static or self.march < PAYS:
            return False
        from .modal_choice import tries_modes

        return tries_modes(self.discretised)

    @property
    def memory(self) -> float:
        """Operators and states, bytes."""
        return sum(operator_bytes(c.size, self.run.propagator) for c in self.run.classes)

    def total(self, name: str) -> int:
        """Sum of a size (name in ``ClassSize``) over all substructures."""
        return sum(c.size.members * getattr(c.size, name) for c in self.run.classes)

    @property
    def instant(self) -> float:
        """One instant, stored quantities included, s."""
        return self.march / self.run.n_instant


# -- large interfaces: dense matrices, substitution or sparse tables, and what a product of the iteration reads --------
@dataclass(frozen=True)
class Tables:
    """Sparse tables of Y: their truncation, the distance that they reach, m, and of each class with any the entries, of
    four bytes, and the columns that are solved for (0 elsewhere)."""

    truncation: float
    reach: float
    entries: tuple[float, ...]
    columns: tuple[float, ...]

    def in_sizes(self, sizes: Sequence[ClassSize]) -> list[ClassSize]:
        """The sizes of the classes with products by tables."""
        rows = zip(sizes, self.entries, self.columns, strict=True)
        return [replace(s, product=0.5 * e, columns=c) if s.swept else s for s, e, c in rows]


def short_steps(d: DiscretisedProblem, sizes: Sequence[ClassSize]) -> bool:
    """Whether a force on an interface without dense matrices reaches little beyond its point in a window."""
    settings = settings_of(d.scene)
    if settings.window != 1 or settings.quasi_static or not any(s.swept for s in sizes):
        return False
    weights = d.scheme.operator(float(d.time[1] - d.time[0]))
    matrices = (c.members[0].reduced for c, size in zip(d.classes, sizes, strict=True) if size.swept)
    return not any(long_steps(weights, mass, stiffness) for mass, _, stiffness in matrices)


def iterated(d: DiscretisedProblem, sizes: Sequence[ClassSize]) -> list[ClassSize]:
    """The sizes with what a product by substitution reads: half where the iteration may take single precision."""
    settings = settings_of(d.scene)
    rough = min(settings.tolerance, settings.force_tolerance) >= ROUGH
    if rough and short_steps(d, sizes):
        half = 0.5
    else:
        half = 1.0
    return [replace(s, product=half * s.product) for s in sizes]


def tables(d: DiscretisedProblem, sizes: Sequence[ClassSize]) -> Tables | None:
    """Tables of the run; None where it has none."""
    settings = settings_of(d.scene)
    truncation = truncation_of(min(settings.tolerance, settings.force_tolerance))
    if not settings.tables or not truncation or not short_steps(d, sizes):
        return None
    dt, reach = float(d.time[1] - d.time[0]), 0.0
    entries, columns = [0.0] * len(sizes), [0.0] * len(sizes)
    for i, (c, size) in enumerate(zip(d.classes, sizes, strict=True)):
        if not size.swept:
            continue
        points = class_points(d.layout, d.units, c.channels)
        radius, share, inside = _reach(c.members[0], d.scheme, dt, points, truncation)
        if share > settings.tables:
            return None
        reach, width = max(reach, radius), points.channels.shape[1]
        # pairs of channels within reach
        entries[i] = share * size.channels**2
        columns[i] = (1.0 + _OF_CHECK) * width * _COLOURS * inside
    return Tables(truncation, reach, tuple(entries), tuple(columns))


def _reach(
    model: SubstructureModel, scheme: TimeScheme, dt: float, points: Points, truncation: float
) -> tuple[float, float, float]:
    """Distance beyond which the blocks of Y are below the truncation, m, their share of all blocks, and the largest
    number of points within the distance: by columns of conjugate gradients for points in the middle and at the ends of
    a face, without any factor."""
    mass, damping, stiffness = model.reduced
    weights = operator_weights(model, scheme, dt)
    matrix = weights[0] * mass + weights[2] * stiffness + (0.0 if damping is None else weights[1] * damping)
    trace, picked = model.reduced_trace, points.picked()[:4]
    at, component = np.nonzero(points.channels[picked] >= 0)
    channels = points.channels[picked][at, component]
    forces = trace[channels].T.toarray()
    # displacement of a channel under a unit force on itself: the diagonal is that of Y
    softness = (
        trace[channels] @ ConjugateGradients(sp.csr_array(matrix), _SAMPLED * truncation).solve(forces)
    ).diagonal()
    dashpots = np.zeros(trace.shape[0])
    for e in np.unique(component):
        here = points.channels[:, e]
        # with the largest softness the weakest dashpots, so that motion reaches furthest
        dashpots[here[here >= 0]] = 1.0 / max(softness[component == e].max(), np.finfo(float).tiny)
    matrix = matrix + trace.T @ sp.diags_array(dashpots) @ trace
    moved = np.abs(trace @ ConjugateGradients(sp.csr_array(matrix), _SAMPLED * truncation).solve(forces))
    on_points = np.where(points.channels[..., None] >= 0, moved[points.channels], 0.0).max(axis=1)  # largest of a block
    apart: Array = np.linalg.norm(points.positions[:, None] - points.positions[picked[at]], axis=2)
    within = on_points > truncation * on_points.max(initial=0.0)
    reach = float(apart[within].max(initial=0.0))
    # a row of points at the distance counts whatever its round-off
    return reach, float(within.mean()), float((apart <= 1.0001 * reach).sum(axis=0).max(initial=0))


_CELL: Final = 15e3  # bytes of matrices and meshes per cell
_OPERATORS: Final = 2.2  # peak while operators are made, over their size
_COPIES: Final = 3.0  # stored fields: as they were kept, as one array, and while they are written
_COLUMNS: Final = 40.0  # vectors of the bodies for a parameter: motion, work, forces of the instants of a call
_IMAGE, _VARIED = 0.8, 2.2  # of derivatives over the operators; beside it for varied matrices and the run marched again
_LIBRARIES: Final = 15e6  # loaded after the set-up
_WIDEST: Final = 4.0  # columns of the table of convergence, over the mean number of iterations
_PARTS = (
    "operators and meshes",
    "Newton steps",
    "threads",
    "histories of interfaces",
    "fields",
    "energies and sensors",
    "records of windows",
    "derivatives",
)


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes that a run needs, beside those that the process has taken: operators and meshes, vectors and factors of
    Newton steps, work of further threads, histories of interfaces and their copies, stored fields, energies and
    sensors, records of the windows, derivatives by parameters."""

    operators: float
    newton: float
    threads: float
    interfaces: float
    fields: float
    energies: float
    windows: float
    derivatives: float

    @property
    def total(self) -> float:
        """Sum of all parts, bytes."""
        return float(sum(vars(self).values()))

    def text(self) -> str:
        """The parts that count, largest first."""
        parts = zip(vars(self).values(), _PARTS, strict=True)
        shown = sorted((size, name) for size, name in parts if size >= 0.01 * self.total)
        return ", ".join(f"{name} {amount(size)}" for size, name in reversed(shown))


def amount(size: float) -> str:
    """Bytes as MB or GB."""
    if size >= 1e9:
        return f"{size / 1e9:.3g} GB"
    return f"{size / 1e6:.3g} MB"


def memory_need(p: Prediction, stream: bool = False) -> MemoryNeed:
    """Memory of the run of a prediction; ``stream`` : histories of interfaces may go to a file."""
    scene = p.scene
    run = p.run
    units = p.discretised.units
    output, n_time = scene.output, run.n_instant + 1
    members = sum(c.size.members for c in run.classes)
    cells = sum(c.size.members * c.cells for c in run.classes)
    nodes = sum(c.size.members * c.nodes for c in run.classes)
    points = sum(u.geometry.n_point for u in units)
    opening = sum(u.geometry.n_point for u in units if u.behaviour.opens)
    sliding = sum(u.geometry.n_point for u in units if u.behaviour.n_component == 1)
    most = max((u.geometry.n_point for u in units), default=0)
    per_instant = 2 * run.n_flat + opening + 6 * sliding
    instants = ceil(n_time / output.interfaces_every)
    # a temporary file takes all instants, memory keeps some of them
    if stream and 8.0 * per_instant * instants > STREAMED:
        instants = min(instants, IN_MEMORY)
    numbers = per_instant + 9 * points + opening + 15 * most  # as histories in global axes, and copies of one interface
    numbers += output.surfaces * (4 * points + 9 * most)
    per_cell = 6 * (output.stress + output.strain) + 3 * (output.principal_stress and output.stress)
    per_node = 6 * output.keeps_fields + 7 * output.nodal_stress
    per_node += 3 * (output.principal_stress and output.nodal_stress)
    if output.keeps_fields or output.stress:
        stored = run.n_instant // run.every + 1
    else:
        stored = 0
    if output.energy:
        terms = len(TERMS) * (2 * members + 2) + 12 + 6 * len(units)
    else:
        terms = 0
    window = run.n_instant / run.window
    unknowns = sum(c.size.members * c.size.unknowns for c in run.classes)
    return MemoryNeed(
        operators=_LIBRARIES + _CELL * cells + _OPERATORS * p.memory,
        newton=_newton_bytes(p),
        # a tile of vectors of the largest class each, for substitutions of its set-up and its pieces
        threads=8.0 * LANES * (scene.solver.threads - 1) * max(c.size.unknowns for c in run.classes),
        interfaces=8.0 * numbers * instants,
        fields=8.0 * _COPIES * stored * (per_cell * cells + per_node * nodes),
        energies=8.0 * n_time * (terms + 12 * (len(scene.sensor) + 2 * len(scene.port)) + 4),
        windows=window * (8.0 + 16.0 * run.iterations * (1.0 + _WIDEST)),
        derivatives=_derivative_bytes(p, numbers * n_time + _COLUMNS * unknowns),
    )


def _derivative_bytes(p: Prediction, numbers: float) -> float:
    """Memory of the derivatives by parameters, with so many ``numbers`` for each, beside a second image of the run."""
    names = p.scene.differentiated
    if not names:
        return 0.0
    from ..sensitivities.copies import MOST

    images = _IMAGE + (_VARIED if any(name.startswith("material.") for name in names) else 0.0)
    # copies of the run for the runs that check derivatives
    if p.scene.output.check_sensitivities == "none":
        copies = 0
    else:
        copies = min(len(names) + 1, MOST)
    return 8.0 * (len(names) + copies) * numbers + images * p.memory


def _newton_bytes(p: Prediction) -> float:
    """Matrix of the active points; where products take its place the vectors of the method, and the factor of the tied
    assembly that preconditions them, in single precision, as it is made and in the image of the run."""
    settings = settings_of(p.scene)
    run = p.run
    units = p.discretised.units
    if not settings.newton or settings.window != 1 or not settings.anderson_depth or run.at_once or not units:
        return 0.0
    if run.static:
        return 8.0 * (VECTORS + 1) * run.n_flat
    unknowns = float(sum(u.geometry.n_point * u.behaviour.n_component for u in units))
    sizes = [c.size for c in run.classes]
    if not any(size.swept for size in sizes):
        return 8.0 * min(float(LARGEST), unknowns**2)
    if short_steps(p.discretised, sizes):
        return 0.0
    tied = factor_bytes(sum(size.members * size.unknowns for size in sizes)) / 8.0
    tied = min(tied, MOST_TIED * sum(size.members * size.factor for size in sizes))
    return 8.0 * (VECTORS + 1) * unknowns + 2 * 4.0 * tied


def least_output(p: Prediction) -> float:
    """Bytes that the results file takes at least, where its numbers are packed to a tenth."""
    need = memory_need(p)
    return 0.1 * (0.5 * need.interfaces + 0.5 * need.fields / _COPIES + need.energies)


def memory_line(p: Prediction, stream: bool = False) -> str:
    """A line on the memory that a run needs and may take."""
    need, (room, limit) = memory_need(p, stream), memory_room()
    if limit:
        free = f"; available memory {amount(room)} ({limit})"
    else:
        free = ""
    return f"memory: about {amount(need.total)} ({need.text()}){free}"


def check_memory(p: Prediction, stream: bool = False) -> None:
    """Make sure that a run fits in the memory that this process may take.

    Raises
    ------
    SceneError : it does not; with the numbers, and settings with which it would.
    """
    need, (room, limit) = memory_need(p, stream), memory_room()
    if limit and need.total > room:
        raise SceneError.of(
            "the scene cannot be solved here",
            "memory",
            "the run does not fit in the available memory",
            f"about {amount(need.total)}: {need.text()}",
            f"{amount(max(room, 0.0))} ({limit})",
            _remedy(p, need, room),
        )


def _remedy(p: Prediction, need: MemoryNeed, room: float) -> str:
    """Settings with which the run fits: of fields first, then of interfaces and energies, then of operators."""
    output, settings = p.scene.output, []
    rest = need.total
    for part, keys, every in (
        ("fields", ("fields", "stress", "strain", "nodal_stress", "principal_stress"), "every"),
        ("energies", ("energy",), None),
        ("interfaces", (), "interfaces_every"),
    ):
        size = getattr(need, part)
        if rest <= room or size < 0.01 * need.total:
            continue
        others = rest - size
        # if all else left some room, fewer instants are enough; a fifth is kept free for what is an estimate
        if every is not None and others < 0.8 * room:
            factor = ceil(size / (0.8 * room - others))
            settings.append(f"output.{every} = {factor * getattr(output, every)}")
            rest = others + size / factor
        else:
            # interfaces are always kept: no key turns them off
            settings += [f"output.{key} = false" for key in keys if getattr(output, key)]
            if keys:
                rest = others
    if rest > room:
        operators = need.operators > 0.5 * room
        settings.append("a coarser mesh" if operators else "fewer instants (time.instants)")
    if rest <= room:
        return f"it fits with {' and '.join(settings)}"
    return f"use {', '.join(settings)}"
