"""What the cost of a run depends on, known before anything is factorised or solved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..compiled import COMPILES
from ..interface.behaviour import bonds
from ..latin.assembly import InterfaceUnit
from ..propagator.cost import Precision, Size, size_of
from ..propagator.registry import Kind
from ..scene.schema import Scene
from ..scene.solver_settings import WHOLE
from .inactive_substructures import arrival_times, marched_share
from .problem import DiscretisedProblem
from .propagator_choice import chosen_propagators

# LATIN iterations of windows of one instant, measured on the shipped models and benchmarks
FRICTION, PER_INTERFACE, MOST_COUPLED = 2.25, 0.27, 7
CONTACT, BONDED, LAYERED, STATIC, WHOLE_WINDOW = 1.8, 4.0, 3.6, 7.0, 6.0


@dataclass(frozen=True)
class ClassSizes:
    """A class of identical substructures. size : of its matrices. nodes, cells : of one member's mesh. rigid : whether
    it cannot deform. marched : share of the instants at which it is."""

    size: Size
    nodes: int
    cells: int
    rigid: bool
    marched: float = 1.0

    @property
    def n_member(self) -> int:
        """Substructures."""
        return self.size.members


@dataclass(frozen=True)
class RunSizes:
    """Sizes of a run.

    Attributes
    ----------
    classes : of substructures. kind, modes, precision : of the propagators.
    bodies, interfaces, cells : substructures, interfaces, cells of the meshes that are assembled (one of each shape).
    n_flat : interface unknowns of both sides. probed : points of each interface without tangential ones.
    n_instant : steps. window : instants per window.
    sequential : whether a longer window starts from a sequential pass. static : no inertia.
    iterations : LATIN iterations expected per window. at_once : one linear solve per instant (bonds).
    fields, stress, energy, every : what is kept. unbalanced : whether accelerations at t = 0 are to be found.
    increments : of a static start, 0 where there is none.
    """

    classes: tuple[ClassSizes, ...]
    kind: Kind
    modes: int
    precision: Precision
    bodies: int
    interfaces: int
    cells: int
    n_flat: int
    probed: tuple[int, ...]
    n_instant: int
    window: int
    sequential: bool
    static: bool
    iterations: float
    at_once: bool
    fields: bool
    stress: bool
    energy: bool
    every: int
    unbalanced: bool
    increments: int

    @property
    def compiled(self) -> bool:
        """Whether whole instants are compiled."""
        return COMPILES and self.window == 1 and not self.static and self.kind != "cg" and self.precision == "float64"

    @property
    def members(self) -> int:
        """Substructures of all classes."""
        return sum(c.n_member for c in self.classes)

    def resized(
        self,
        channels: float = 1.0,
        interface: float = 1.0,
        entries: float = 1.0,
        mass_entries: float = 1.0,
        damping_entries: float = 1.0,
        factor_entries: float = 1.0,
    ) -> RunSizes:
        """With the sizes of every class multiplied by these factors."""

        def changed(size: Size) -> Size:
            return replace(
                size,
                channels=round(channels * size.channels),
                interface=round(interface * size.interface),
                entries=round(entries * size.entries),
                mass_entries=round(mass_entries * size.mass_entries),
                damping_entries=round(damping_entries * size.damping_entries),
                factor_entries=factor_entries * size.factor_entries,
            )

        return replace(self, classes=tuple(replace(c, size=changed(c.size)) for c in self.classes))


def run_sizes(discretised: DiscretisedProblem) -> RunSizes:
    """Sizes of a discretised problem."""
    scene, units = discretised.scene, discretised.units
    settings = chosen_propagators(scene, discretised.classes)[0]
    share = _marched(discretised)
    classes = []
    for c in discretised.classes:
        body = discretised.bodies[c.members[0].name]
        marched = float(np.mean([share[m.name] for m in c.members]))
        size = size_of(c.members[0], len(c.members))
        classes.append(ClassSizes(size, body.mesh.n_node, body.mesh.n_cell, body.rigid, marched))
    shapes = {id(b.shape): b.mesh.n_cell for b in discretised.bodies.values() if not b.rigid}
    window = scene.time.n_step if scene.solver.window == WHOLE else int(scene.solver.window)
    sequential = scene.solver.window == WHOLE and scene.solver.start == "sequential"
    at_once = solved_at_once(scene, units)
    output, start = scene.output, scene.time.start
    return RunSizes(
        classes=tuple(classes),
        kind=settings.kind,
        modes=settings.modes,
        precision=settings.precision,
        bodies=len(discretised.bodies),
        interfaces=len(units),
        cells=sum(shapes.values()),
        n_flat=discretised.layout.n_flat,
        probed=tuple(u.geometry.n_point for u in units if u.behaviour.n_component == 1),
        n_instant=scene.time.n_step,
        window=window,
        sequential=sequential,
        static=scene.time.quasi_static,
        iterations=expected_iterations(scene, units),
        at_once=at_once,
        fields=output.keeps_fields,
        stress=output.stress,
        energy=output.energy,
        every=output.every,
        unbalanced=_unbalanced(scene),
        increments=start.increments if start.type == "static" else 0,
    )


def solved_at_once(scene: Scene, units: Sequence[InterfaceUnit]) -> bool:
    """Whether every instant is one linear solve: perfect interfaces only, windows of one instant."""
    solver = scene.solver
    wanted = solver.window == 1 and solver.bonds == "direct" and not scene.time.quasi_static
    return wanted and bool(units) and all(bonds(u.behaviour) for u in units)


def expected_iterations(scene: Scene, units: Sequence[InterfaceUnit]) -> float:
    """LATIN iterations of a window (one solve of the bonds counts as one)."""
    if not units:
        return 0.0
    if solved_at_once(scene, units):
        return 1.0
    if scene.time.quasi_static:
        return STATIC
    if scene.solver.window != 1:
        return WHOLE_WINDOW
    if any(not u.behaviour.opens for u in units):
        return BONDED if any(bonds(u.behaviour) for u in units) else LAYERED
    if any(u.behaviour.n_component > 1 for u in units):
        return FRICTION + PER_INTERFACE * min(len(units), MOST_COUPLED)
    return CONTACT


def _marched(discretised: DiscretisedProblem) -> dict[str, float]:
    """Share of the instants at which each substructure is marched: nothing is at rest for long in an implicit march
    unless the tolerance lets it, or nothing ever comes."""
    scene, names = discretised.scene, discretised.bodies
    if scene.time.quasi_static or scene.solver.skip_at_rest == "off":
        return dict.fromkeys(names, 1.0)
    arrival = arrival_times(scene, discretised.bodies, discretised.units, discretised.time)
    if scene.solver.skip_at_rest == "tolerance":
        return {name: marched_share(arrival[name], discretised.time) for name in names}
    return {name: float(np.isfinite(arrival[name])) for name in names}


def _unbalanced(scene: Scene) -> bool:
    """Whether forces act at t = 0 that nothing balances."""
    if scene.time.quasi_static or scene.time.start.type == "static":
        return False
    if any(any(s.body_force) for s in scene.substructure.values()):
        return True
    return any(load.law.sample(np.zeros(1))[0] != 0.0 for load in scene.load.values())
