"""The image of a run for the kernels: its records and blocks of memory, the stages of a window on it.

The record of the run holds the rules of the iteration, those of the groups the interfaces, those of the classes the
substructures (``kernels.records``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final
from weakref import proxy

import numpy as np

from ..interface.laws import coulomb_coefficient
from ..kernels import entries
from ..kernels.callouts import LAW, OBSERVE, TANGENTS
from ..kernels.instants import FREE, OPENINGS
from ..kernels.newton import ACTIVE, LEFT, MADE, N_COURSE
from ..kernels.sums import MEASURES
from ..laws.dispatch import LAWS
from ..laws.maxwell_joint import MaxwellJoint
from ..propagator.image import Image, ImageClass
from ..propagator.layout import COMMUNICATION_ROWS
from ..time_scheme import joint_weights
from .assembly import Array, Assembly, Group
from .instant_solve import PerfectInterfaceSolve
from .part import Part
from .probes import Probes
from .search_direction import FLOOR, Direction
from .settings import SolverSettings

RELAXATION = 0.5
"""Factor on the residual after a stall."""
_DIFFERENCE = 1e-7  # of the largest free velocity of a group: step of the derivative of its law
_LONGEST_STATIC = 20.0  # step of the acceleration without inertia, in lengths of the residual
_AT_REST = 1e-11  # residual over the tractions of that equilibrium below which nothing moves
REUSE: Final = 1e-2
"""Change of q up to which the previous solve of a substructure is reused, in tolerances."""


def still_tractions(assembly: Assembly) -> Array:
    """Tractions (n_flat,) of the equilibrium that the motion starts from: preloads and a static start; 0 without
    inertia, Pa."""
    still = np.zeros(assembly.layout.n_flat)
    if assembly.quasi_static:
        return still
    for group in assembly.layout.groups:
        block = group.block(still)
        block[0, :, 0], block[1, :, 0] = -group.preload, group.preload
    for i, start in assembly.start_tractions.items():
        still[assembly.layout.channels(i, 0)], still[assembly.layout.channels(i, 1)] = start, -start
    return still


def reuse_bound(settings: SolverSettings) -> float:
    """Squared relative change of the fields up to which a solve is reused; below zero where none is."""
    if not settings.skip_unchanged or settings.quasi_static:
        return -1.0
    # squared, as the change that it is compared with
    return (REUSE * min(settings.tolerance, 0.1 * settings.force_tolerance)) ** 2


def make_image(
    assembly: Assembly,
    settings: SolverSettings,
    direction: Direction,
    probes: Probes | None,
    more: Mapping[str, Any],
    part: Part | None = None,
) -> Image:
    """Image of an assembly whose propagators have their initial state and are bound to ``direction``.

    more : further fields of the record of the run. part : of the assembly that this process holds, ``assembly`` being
        that of the part.
    """
    layout, static = assembly.layout, assembly.quasi_static
    depth = settings.anderson_depth
    sides = [[assembly.layout.channels(i, side) for side in (0, 1)] for i in range(len(assembly.interfaces))]
    # channels of a side are one range of the flat vector: its first, and their number
    segments = [(first.flat[0], second.flat[0], first.size) for first, second in sides]
    ground = assembly.ground.channels
    run: dict[str, Any] = {
        "n_interface": len(assembly.interfaces),
        "n_ground": len(ground),
        "n_part": len(assembly.interfaces),
        "n_owned": len(assembly.interfaces) if part is None else part.n_owned,
        "part_width": MEASURES + 2 * depth,
        "segments": np.array(segments, dtype=np.int64).reshape(-1, 3),
        # that of ground is left out where all interfaces have it: of an assembly marched by its modes
        "sides": np.array([1 if settings.residual_alone else 2 for _ in assembly.interfaces], dtype=np.int64),
        "part_order": np.arange(len(assembly.interfaces)),
        "depth": depth,
        "max_iterations": settings.max_iterations,
        "residual_alone": int(settings.residual_alone),
        "tangential": int(not layout.normal.all()),
        "layers": int(any(g.behaviour.elastic for g in layout.groups)),
        "relaxing": int(any(isinstance(g.behaviour, MaxwellJoint) for g in layout.groups)),
        "static": int(static),
        "area": layout.area,
        "still": still_tractions(assembly),
        "interface": layout.interface,
        "ground": ground,
        # without inertia no energy is added where a penetration within the tolerance is pushed out
        "deepest": -np.inf if static else 0.0,
        # copies for derivatives solve every instant exactly
        "predicted": int(direction.predictable and not more.get("linear")),
        "expects": int(direction.predicted and not more.get("linear")),
        "make_up": 1.0 / assembly.dt,
        "longest_step": _LONGEST_STATIC if static else np.inf,
        **({} if direction.coarse is None else direction.coarse.sizes),
        **direction.relative_fields(),
        **rules(settings),
        "rest_traction": assembly.rest_traction,
        **({} if part is None else part.fields()),
        **more,
    }
    groups = [_group_fields(group, assembly, bool(more.get("n_output"))) for group in layout.groups]
    if more.get("linear"):
        # derivatives have tangents in the place of laws, and nothing to make up
        groups = [{**group, "law": -1, "keeps_normal": 0, "keeps_tangential": 0} for group in groups]
    longest = assembly.n_instant
    if more.get("n_output"):  # the first segment of a co-simulation may be shorter than those after it
        longest = max(longest, COMMUNICATION_ROWS - 1)
    none = [None] * len(assembly.propagators)
    rows = (none, none) if probes is None else (probes.slide.rows, probes.rows)
    divided = [False] * len(none) if part is None else part.divided
    return Image(
        [ImageClass(*of) for of in zip(assembly.propagators, assembly.channels, *rows, divided, strict=True)],
        layout.normal,
        run,
        groups,
        min(settings.window or longest, longest),
        len(assembly.time),
        histories(assembly, None if part is None else part.whole),
    )


def _group_fields(group: Group, assembly: Assembly, exchanged: bool) -> dict[str, Any]:
    """Fields of the record of a group; ``exchanged`` : of a run for co-simulation."""
    static, relaxing = assembly.quasi_static, {}
    if isinstance(group.behaviour, MaxwellJoint):
        times = group.parameters[:, 2]
        relaxing = {"relaxes": 1, "relaxation": joint_weights(assembly.scheme, assembly.dt, times)}
    return {
        **relaxing,
        "law": law_of(group.behaviour),
        "elastic": int(group.behaviour.elastic),
        "opens": int(group.behaviour.opens),
        # without inertia contact reads the gap, of either sign
        "keeps_normal": int(group.behaviour.keeps[0] and not (static and group.behaviour.opens)),
        "keeps_tangential": int(group.behaviour.keeps[1]),
        "start": group.start,
        "n_point": group.n_point,
        "n_component": group.n_component,
        "n_parameter": group.parameters.shape[1],
        "parameters": group.parameters.astype(float),
        "tunable": int(exchanged and friction_column(group) is not None),
        "initial_gap": group.gap,
    }


def friction_column(group: Group) -> int | None:
    """Column of Coulomb's coefficient among the parameters of a group; None where it has none, or no kernel."""
    if coulomb_coefficient(group.behaviour) and group.n_component > 1 and law_of(group.behaviour) >= 0:
        return 0
    return None


def negligible_scales(image: Image, direction: Direction, tolerance: float) -> Array:
    """Scales (3,) of negligible fields, relative to the largest load: denominator of eta, normal and tangential
    forces; ``image`` : of windows of one instant, bound to ``direction``.

    A motion that starts from an equilibrium under forces has the loads of that equilibrium among the largest, which
    do not give the size of the motion: there the residual counts down to ``_AT_REST`` of them.
    """
    # the force residual of negligible tractions leaves their norms in ``measure``
    image.field("local_f", image.n_flat)[:], image.field("r", image.n_flat)[:] = direction.level, 0.0
    measures = image.field("measure", 9)  # all of the tractions change
    measures[:], measures[7] = 0.0, 1.0
    tiny, whole = np.finfo(float).tiny, direction.whole
    if whole.assembly.interfaces:
        image.call(entries.FORCES, 1)
    weights = whole.weights[1, whole.assembly.layout.normal]
    fields = float(whole.level.max(initial=0.0)) ** 2 * float(weights.sum())
    if still_tractions(whole.assembly).any():
        part = min(1.0, _AT_REST / (FLOOR * tolerance))
    else:
        part = 1.0
    force = max(part * float(measures[3]), tiny)
    return np.array([max(part * part * fields, tiny), force, force])


def rules(settings: SolverSettings) -> dict[str, float]:
    """Numbers of the record of the run that may change during it."""
    return {
        "tolerance": settings.tolerance,
        "force_tolerance": settings.force_tolerance,
        "relaxation": settings.relaxation,
        "reuse": reuse_bound(settings),
    }


def law_of(behaviour: Any) -> int:
    """Code of the law for the kernels; -1 where the behaviour's own ``local`` is called."""
    if getattr(behaviour, "compiled", False):
        return LAWS[behaviour.name]
    return -1


def all_in_kernels(image: Image) -> bool:
    """Whether the kernels hold every factor and every law."""
    return image.factored and all(g["law"] >= 0 for g in image.groups)


def still(assembly: Assembly) -> bool:
    """Whether the ``histories`` of a segment follow from its number of instants alone."""
    return assembly.ground.rests and not assembly.quasi_static


def histories(assembly: Assembly, whole: Assembly | None = None) -> dict[str, Array]:
    """Motion of the ground at the instants of the segment, and the ``continuation`` of the loads; ``whole`` : the
    assembly that this one is a part of."""
    scheme = assembly.scheme
    dt = assembly.dt
    n_time = len(assembly.time)
    share = continuation(assembly if whole is None else whole)
    if assembly.ground.rests:
        rest = np.zeros((n_time, len(assembly.ground.channels)))
        names = ("ground_velocity", "ground_displacement", "ground_acceleration", "ground_layer")
        return {**dict.fromkeys(names, rest), "continuation": share}
    velocity, displacement, acceleration = assembly.ground.tables(scheme, n_time)
    # ``gap_offset`` ahead, as those of the substructures
    displacement = displacement + scheme.gap_offset(dt) * velocity
    one, zero = np.ones(1), np.zeros(1)
    # the rest displacement of a layer is linear in v and a: factors by unit arguments
    layer_v, layer_a = (float(scheme.layer_jump(zero, *va, dt)[0][0]) for va in ((one, zero), (zero, one)))
    return {
        "ground_velocity": velocity,
        "ground_displacement": displacement,
        "ground_acceleration": acceleration,
        "ground_layer": displacement + layer_v * velocity + layer_a * acceleration,
        "continuation": share,
    }


def continuation(assembly: Assembly) -> Array:
    """Share (n_time,), 0 ... 1, of the last velocities in the first guess of each increment without inertia.

    It is the component of the increment of the loads along the one before, over the size of that one; 1 where there is
    none before. The last velocities are a good guess while the loads continue as before; where the loads turn or stop,
    they have the wrong sign at sliding points.
    """
    n_time = len(assembly.time)
    if not assembly.quasi_static:
        return np.ones(n_time)
    along = np.zeros(n_time)
    size = np.zeros(n_time)
    change = np.zeros(n_time)
    for propagator in assembly.propagators:
        before = last = propagator.forcing.at(0)
        for t in range(1, n_time):
            new = propagator.forcing.at(t)
            along[t] += float(np.vdot(new - last, last - before))
            size[t] += float(np.vdot(last - before, last - before))
            change[t] += float(np.vdot(new - last, new - last))
            before, last = last, new
    ground = np.zeros(n_time, dtype=bool)
    for velocity in assembly.ground.velocity.values():
        ground[1:] |= np.einsum("ti,ti->t", velocity[1:], velocity[:-1]) > 0.0
    # loads that stay: by whether the ground moves on as it did
    part = np.divide(along, size, out=ground.astype(float), where=(size > 0) & (change > 0))
    part[:2] = 1.0  # at the start of a run there are no velocities; a segment continues the one before
    share: Array = np.clip(part, 0.0, 1.0)
    return share


_ITERATE = ("q", "local_f", "local_w", "r")  # fields of the image that make an iterate, with ``measure``


@dataclass
class Iterate:
    """A copy of one iterate of a window; arrays (n, n_flat); ``measures`` as ``kernels.records`` lists them."""

    q: Array
    f_hat: Array
    w_hat: Array
    residual: Array
    measures: Array

    @classmethod
    def last(cls, stages: Stages) -> Iterate:
        """A copy of the last iterate of a window."""
        q, f_hat, w_hat, residual = (stages.field(name).copy() for name in _ITERATE)
        return cls(q, f_hat, w_hat, residual, stages.measures())

    def put(self, stages: Stages) -> None:
        """Make this iterate the last one of a window."""
        for name, values in zip(_ITERATE, (self.q, self.f_hat, self.w_hat, self.residual), strict=True):
            stages.field(name)[...] = values
        stages.image.field("measure", 9)[:] = self.measures

    @property
    def error(self) -> float:
        """Error indicator sqrt(eta)."""
        return float(self.measures[0])


def rate_of(image: Image, group: Group) -> float:
    """The argument ``rate`` of the law of a group (``laws.dispatch``), s-1."""
    run = image.run[0]
    return float(run["layer_rate"] if group.behaviour.elastic else 1.0 / run["dt"])


class LawsInPython:
    """Laws of interfaces written in Python, where the kernels call out for them (``kernels.callouts``)."""

    def __init__(self, image: Image, groups: Sequence[Group]) -> None:
        self._image: Image = proxy(image)  # which calls this
        self._groups = groups
        if any(law_of(group.behaviour) < 0 for group in groups):
            image.callouts.add({LAW: self._solve, TANGENTS: self._differentiate})

    def _jump(self, g: int) -> Array:
        """Free velocities (n_point, n_component) of a group in the last local stage, a view."""
        group = self._groups[g]
        return self._image.group_field(g, "jump", group.n_point, group.n_component)

    def _tractions(self, g: int, jump: Array, points: slice) -> Array:
        """Tractions of points of a group under free velocities."""
        image, group = self._image, self._groups[g]
        place, elastic = int(image.groups[g]["z_sum"]), group.behaviour.elastic
        # copies: a law may be anyone's, and must not write into the image
        z = image.fixed[place : place + 2 * group.n_point].reshape(-1, 2)[points].copy()
        reach = image.group_field(g, "reach", *((group.n_point, group.n_component) if elastic else (group.n_point,)))
        return group.behaviour.local(jump, z, reach[points].copy(), rate_of(image, group), group.parameters[points])

    def _solve(self, g: int, low: int, high: int) -> None:
        """Tractions of the points from ``low`` to ``high`` of a group."""
        group, points = self._groups[g], slice(low, high)
        traction = self._image.group_field(g, "traction", group.n_point, group.n_component)
        traction[points] = self._tractions(g, self._jump(g)[points].copy(), points)

    def _differentiate(self, g: int, *_: int) -> None:
        """Derivative of the law of a group by its free velocities, by one difference per component."""
        group = self._groups[g]
        jump = self._jump(g).copy()
        every = slice(None)
        derivative = self._image.group_field(g, "tangent", group.n_point, 3, 3)
        derivative[...] = 0.0
        base, step = self._tractions(g, jump, every), _DIFFERENCE * float(np.abs(jump).max(initial=0.0))
        for c in range(group.n_component if step > 0.0 else 0):
            moved = jump.copy()
            moved[:, c] += step
            derivative[:, : group.n_component, c] = (self._tractions(g, moved, every) - base) / step


class Stages:
    """The stages of one window of ``n`` instants that starts with instant ``first``, on the image of a run."""

    def __init__(self, image: Image, direction: Direction, n: int, first: int) -> None:
        self.image = image
        self.direction = direction
        self.n = n
        self.first = first
        self._groups = direction.assembly.layout.groups

    def of(self, direction: Direction) -> Stages:
        """Stages of one instant with another search direction."""
        return Stages(self.image, direction, 1, self.first)

    def begin(self, further: int = OPENINGS) -> None:
        """Begin the window (``kernels.instants.begin_at``)."""
        self.image.call(entries.BEGIN, self.n, self.first, further)

    def free_motion(self) -> None:
        """Velocities of all channels without tractions, into ``w``: in the rest of the window there is no reference."""
        referenced = self.image.run_fields["referenced"]
        self.image.set({"referenced": 0})
        self.begin(FREE)
        self.image.set({"referenced": referenced})

    def ended(self) -> None:
        """Called at the end of an instant."""

    def field(self, name: str) -> Array:
        """A field of the window, (n, n_flat), a view."""
        return self.image.field(name, self.n, self.image.n_flat)

    def accelerate(self, settings: SolverSettings, relaxed: bool = False, again: bool = False) -> None:
        """Acceleration of the next iterations by the settings; ``relaxed`` : relaxation RELAXATION alone; ``again`` :
        after a fall-back."""
        plain = relaxed or (again and settings.anderson_depth == 0)
        if plain:
            depth, relaxation = 0, RELAXATION
        else:
            depth, relaxation = settings.anderson_depth, settings.relaxation
        self.image.set({"depth": depth, "relaxation": relaxation})

    def iterations(self, counts: tuple[int, int, int, int], look: Callable[[int, int, int], None]) -> int:
        """``kernels.iteration.iterate`` with its ``counts`` begin, start, phase and limit, from the q of the image;
        what it returns. ``look`` is called with each iteration and its verdict."""
        image, (begin, start, phase, limit) = self.image, counts
        image.counts("iterations", 1)[0] = begin
        image.set({"observed": 1, "limit": limit})
        try:
            with image.callouts.within({OBSERVE: look}):
                return image.call(entries.ITERATE, self.n, self.first, start, phase)
        finally:
            image.set({"observed": 0})

    def points_one_by_one(self, f_hat: Array) -> None:
        """Set q of one instant by the solution point by point, from tractions f_hat (n_flat,)."""
        self.free_motion()
        gaps, w = [self.reach(g) for g in range(len(self._groups))], self.image.field("w", self.image.n_flat).copy()
        made_up = self.made_up()
        solved = self.direction.points.solve(w + made_up, f_hat, gaps, self.rates())
        # the solution has the drift made up in its velocities, q has not (``kernels.local_stage``)
        self.field("q")[0] = self.direction.incoming(*solved) - self.direction.k * made_up

    def bonded(self, bonds: PerfectInterfaceSolve) -> Array:
        """q (n_flat,) of the solution where all interfaces are perfect."""
        self.free_motion()
        free = self.image.field("w", self.image.n_flat)
        k = self.direction.k
        made_up = self.made_up()
        return bonds.guess(free + made_up, k) - k * made_up

    def made_up(self) -> Array:
        """Velocities (n_flat,) that make up the drift, on sides E' (``kernels.local_stage``)."""
        velocities = np.zeros(self.image.n_flat)
        for g, group in enumerate(self._groups):
            drift = self.image.group_field(g, "drift", 3, group.n_point, group.n_component)
            group.block(velocities)[1] = float(self.image.run[0]["make_up"]) * drift[0]
        return velocities

    def largest(self, value: float) -> float:
        """The largest value over all processes of the run."""
        return value

    def reach(self, g: int) -> Array:
        """The argument ``reach`` of the law of a group, (n_point, n_component or 1), a copy."""
        group = self._groups[g]
        if group.behaviour.elastic:
            width = group.n_component
        else:
            width = 1
        return self.image.group_field(g, "reach", group.n_point, width).copy()

    def rates(self) -> tuple[float, float]:
        """The argument ``rate`` of laws that read no displacement, and of elastic ones, s-1."""
        return float(1.0 / self.image.run[0]["dt"]), float(self.image.run[0]["layer_rate"])

    def disagreement(self) -> float:
        """Largest difference of the tractions of both stages at an instant, over their largest size so far, in the norm
        of the error indicator: fields of substructures belong to the one, reported tractions to the other."""
        apart = self._over_interfaces(self.direction.weights[1] * (self.field("f") - self.field("local_f")) ** 2)
        tractions = 0.25 * float(self.measures()[2])  # a quarter of the fields: F, F_hat, W and W_hat
        if tractions > 0.0:
            return float(np.sqrt(apart.max(initial=0.0) / tractions))
        return 0.0

    def _over_interfaces(self, values: Array) -> Array:
        """Sums (n,) of values (n, n_flat) over the channels."""
        return np.asarray(values.sum(axis=1))

    def newton_steps(self) -> int:
        """Newton steps made in this window."""
        return int(self.image.field("course", N_COURSE)[MADE])

    def leave_newton(self) -> None:
        """No Newton steps in the rest of this window: a fall-back follows."""
        self.image.field("course", N_COURSE)[[ACTIVE, LEFT]] = 0.0, 1.0

    def measures(self) -> Array:
        """Measures (9,) of the last iterate, a copy."""
        return self.image.field("measure", 9).copy()
