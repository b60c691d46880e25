"""Search directions k, and weights derived from them.

Search directions of (12), (13), (16), (17): per side, normal and tangential, at every point. The choice changes the
number of iterations, not the converged solution. Candidates:

impedance   rho c_p and rho c_s of the side's own material: exact where the step resolves the wave
uniform     the same numbers everywhere (the paper's k = G T_c / L_c is rho c_s for T_c = L_c / c_s)
diagonal    1 / D_ii of the discrete admittance of one instant
row         resistance of the face to a uniform velocity, spread by area
static      without inertia only: 1.5 x the geometric mean of the stiffness of a body as a whole and at one point
automatic   the static one without inertia; diagonal for windows of one instant; for longer windows the impedance
            where the step resolves the wave on both sides (row k over impedance within 0.3 ... 3), else half the row
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..machine import in_threads
from ..propagator import Propagator
from ..propagator.interface_matrices import resistance
from ..propagator.interface_probing import ROUGH, Points, Table, interface_tables, truncation_of
from ..propagator.interface_sweeps import long_steps, stiffness_over_inertia
from ..propagator.static import StaticPropagator, without_round_off
from .assembly import Array, Assembly, Index
from .coarse_problem import CoarseProblem
from .instant_solve import PointByPoint
from .settings import SearchDirection, SolverSettings
from .tied_bodies import tied_fields, tied_size

RESOLVED = (0.3, 3.0)
WARNED = (0.2, 5.0)
_CLOSE: Final = 1e-7  # tolerance from which on dense tables may be in single precision
_ROUGHLY: Final = 0.03  # residual of resistances that are printed with two digits
_ROUGH, _ROUGHEST = 50.0, 0.03  # share of a residual that a step leaves times stiffness over inertia; largest share
LARGEST: Final = 2100**2
"""Numbers of the matrix up to which Newton's method is used where it factorises one: about 700 points at one interface,
more in chains. Large interfaces in long steps take it by products of D (``kernels.krylov``), those without inertia by
products of the linear stage (``kernels.iteration_step``)."""


def channel_k(assembly: Assembly, search: SearchDirection, window: int) -> tuple[Array, str]:
    """Search direction k of every channel (n_flat,), Pa s m-1 (0 where a side is rigid), and the choice in a word."""
    kind = search.kind
    if kind == "automatic" and assembly.quasi_static:
        kind = "static"
    if kind == "automatic":
        if window == 1:
            kind = "diagonal"
        else:
            kind = "resolved"
    if kind == "impedance":
        k, choice = assembly.impedance.copy(), "impedance"
    elif kind == "uniform":
        k = np.where(assembly.layout.normal, search.normal, search.tangential)
        choice = "uniform"
    elif kind == "diagonal":
        k, choice = _diagonal(assembly), "diagonal"
    elif kind == "static":
        k, choice = _static(assembly), "stiffness"
    elif kind == "row":
        k, choice = _row(assembly), "row"
    elif kind == "resolved":
        k, choice = _resolved(assembly)
    else:
        raise ValueError(f"search direction {kind!r} is not one of those of the table above")
    k = search.factor * k
    k[assembly.rigid] = 0.0  # a rigid side has no dashpot
    return k, choice


def inertial_impedance(assembly: Assembly) -> None:
    """Give the sides without a material impedance (rigid bodies) the resistance of their faces within one step."""
    row = _row(assembly)
    missing = assembly.impedance <= 0
    # with inertia ``impedance`` is the array itself
    assembly.impedance[missing] = row[missing]


def unresolved_sides(assembly: Assembly) -> list[str]:
    """Sentences on sides where mesh and step do not resolve a wave front: the solution is inaccurate there.

    The face of a body with massless contact nodes resists by its stiffness, Z times the Courant number: small steps are
    resolved, long ones are not.
    """
    massless = assembly.scheme.massless_contact
    row = _row(assembly, normal_only=True)
    least = WARNED[0]
    if massless:
        least = 0.0
    remarks = []
    for i, unit in enumerate(assembly.interfaces):
        if unit.attached:
            continue
        for side in (0, 1):
            # normal ones stand for the point
            channels = assembly.layout.channels(i, side)[:, 0]
            impedance = assembly.impedance[channels]
            if not impedance.any() or not row[channels].any():
                continue
            ratio = float(np.median(row[channels] / impedance))
            if least <= ratio <= WARNED[1]:
                continue
            what, remedy = "the step is too long for this mesh", "use smaller steps"
            if ratio > WARNED[1] and not massless:
                what = "the mesh is too coarse for this step"
                remedy = "refine the mesh there (a smaller step alone does not help)"
            remarks.append(
                f"interface {unit.name}, side {unit.sides[side]}: {what} to follow the wave (resistance of the face "
                f"over rho c = {ratio:.2g}, followed within {WARNED[0]} ... {WARNED[1]}); a contact shorter than the "
                f"passage through a few elements is not resolved: {remedy}"
            )
    return remarks


def _diagonal(assembly: Assembly) -> Array:
    """1 / D_ii; one tangential value per point (the largest admittance of its two directions)."""
    admittance = assembly.gather(
        [without_round_off(p.operators.compliance.diagonal() * p.operators.area)[:, None] for p in assembly.propagators]
    )
    return _inverse(_one_tangent(assembly, admittance))


def _static(assembly: Assembly) -> Array:
    """The direction of the operators over an increment (``propagator.static``); one tangential value."""
    stiffness = np.zeros(assembly.layout.n_flat)
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        assert isinstance(propagator, StaticPropagator)
        stiffness[channels] = propagator.operators.direction[:, None]
    return assembly.dt * _one_tangent(assembly, stiffness)


def _one_tangent(assembly: Assembly, values: Array) -> Array:
    """The values (n_flat,) with the larger of both tangential ones at every point."""
    for group in assembly.layout.groups:
        if group.n_component > 1:
            block = group.block(values)
            block[..., 1:] = block[..., 1:].max(axis=-1, keepdims=True)
    return values


def _row(assembly: Assembly, normal_only: bool = False) -> Array:
    """Total force for a unit uniform velocity of the face, over its area; ``normal_only``: 0 in the tangents, and large
    faces roughly."""
    layout, propagators = assembly.layout, assembly.propagators
    k, row_of = np.zeros(layout.n_flat), np.full(layout.n_flat, -1)
    class_of = np.full(layout.n_flat, -1)
    for c, channels in enumerate(assembly.channels):
        row_of[channels], class_of[channels] = np.arange(len(channels))[:, None], c
    cache: dict[tuple[int, bytes], float] = {}  # members of a class share what they have in common
    for i in range(len(assembly.interfaces)):
        for side in (0, 1):
            flat = layout.channels(i, side)
            c = int(class_of[flat[0, 0]])
            if c < 0:  # ground
                continue
            operators, rows = propagators[c].operators, row_of[flat]
            area = operators.area[rows[:, 0]].sum()
            for component in range(1 if normal_only else flat.shape[1]):
                numbers = rows[:, component]
                # by the channels: what two members have alike is solved for once
                key = (c, numbers.tobytes())
                if key not in cache:
                    rough = normal_only and propagators[c].swept
                    compliance = operators.compliance
                    if rough:
                        force = compliance.resistance(numbers, _ROUGHLY)
                    else:
                        force = resistance(compliance, numbers)
                    cache[key] = force / area
                k[flat[:, component]] = cache[key]
    if normal_only:
        return k
    return _one_tangent(assembly, k)


def _resolved(assembly: Assembly) -> tuple[Array, str]:
    """Impedance where both sides of an interface are resolved, else half the row value."""
    row, impedance = _row(assembly), assembly.impedance
    k = impedance.copy()
    choices = []
    for i in range(len(assembly.interfaces)):
        sides = [assembly.layout.channels(i, side) for side in (0, 1)]
        resolved = True
        for channels in sides:
            normal = channels[:, 0]
            # ground has no impedance, faces that cannot move no row value
            if impedance[normal].any() and row[normal].any():
                ratio = _median(row[normal] / impedance[normal])
                resolved &= RESOLVED[0] <= ratio <= RESOLVED[1]
        if resolved:
            choices.append("impedance")
        else:
            choices.append("half row")
            for channels in sides:
                k[channels] = 0.5 * row[channels]
    return k, ", ".join(sorted(set(choices)))


def _inverse(values: Array) -> Array:
    """Inverse 1/x where x > 0, else 0."""
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0)


def _median(values: Array) -> float:
    """Median of a few numbers (ten times as fast as that of NumPy)."""
    ordered, half = np.sort(values), len(values) // 2
    return float(0.5 * (ordered[half] + ordered[-half - 1]))


FLOOR = 1e-3
"""Fraction of the characteristic traction below which fields are negligible."""
_WIDENING = 3.0
"""Factor on z in the laws of Newton steps by products: with it, points that slip after one step return to sticking;
without, they change the direction of slip from step to step."""
_PROXIMAL = 1e-2  # of z in the relative operator
_PRICE_ON_ITERATION = 15.0  # of a Newton step without inertia, over the cost of an iteration


class Direction:
    """Search direction for windows of ``n`` instants.

    Attributes
    ----------
    k : (n_flat,), Pa s m-1. choice : its kind, in words. z : 1/k, 0 where k is 0. metric : (n_flat,) squared weights of
    the norm sum area / k q^2 (a power) in which iterates are compared. tables : ``interface_probing``, from ``bind``.
    newton : whether Newton steps may end an instant (``kernels.newton``). too_large : whether they may not because of
    the size of their matrix. relative : fields of the record of the run that describe it. parent : of a part of the
    assembly (``Part.direction``) the direction of the whole one. own_coarse : of a part what makes its coarse problem
    of that of the whole.
    """

    parent: Direction | None = None
    own_coarse: Callable[[CoarseProblem], CoarseProblem] | None = None

    def __init__(self, assembly: Assembly, settings: SolverSettings, n: int) -> None:
        self.assembly = assembly
        self._settings = settings
        self._n = n
        self.k, self.choice = channel_k(assembly, settings.search_direction, n)
        self.z = np.divide(1.0, self.k, out=np.zeros_like(self.k), where=self.k > 0)
        self.metric = assembly.layout.area * self.z
        self.coarse: CoarseProblem | None = None  # without inertia, from ``bind``
        wanted = settings.newton and n == 1 and settings.anderson_depth > 0
        self._long_steps = not assembly.quasi_static and self._of_long_range()
        wanted &= not assembly.swept or assembly.quasi_static or self._long_steps
        self.relative: dict[str, Any] = {"on_iteration": int(wanted)}
        if wanted and not assembly.quasi_static:
            self.relative = relative_operator(assembly)
        numbers = self.relative.get("n_matrix", 0)
        self.too_large = numbers > LARGEST and not assembly.swept
        self.newton = wanted and bool(assembly.interfaces) and not self.too_large
        if numbers and assembly.swept:
            self.relative |= {"krylov": 1, "n_matrix": 0, "tied_n": tied_size(assembly)}
        self.tables: list[dict[str, Table]] | None = None

    @property
    def whole(self) -> Direction:
        """That of the whole assembly."""
        if self.parent is None:
            return self
        return self.parent

    @property
    def short(self) -> bool:
        """Whether windows have one instant, in which a force reaches little beyond its point."""
        return self._n == 1 and not self.assembly.quasi_static and not self._long_steps

    @property
    def predictable(self) -> bool:
        """Whether the tractions of an instant can be extrapolated from the last ones (``kernels.prediction``)."""
        return self._n == 1 and not self.assembly.quasi_static and self._settings.anderson_depth > 0

    @property
    def predicted(self) -> bool:
        """Whether they are: at tolerances far below the change of an instant, and with the residuals alone."""
        return self.predictable and (self._settings.tolerance <= ROUGH or self._settings.residual_alone)

    @property
    def _single(self) -> bool:
        """Whether the iteration may take factors and tables in single precision, read in half the time: the motion is
        marched with the others, so that the contact laws alone are met to some 1e-6 of what changes within an instant,
        with dense tables to some 1e-8."""
        tolerance = min(self._settings.tolerance, self._settings.force_tolerance)
        if self.assembly.swept:
            return self.short and tolerance >= ROUGH
        return (self.short or self.predicted) and tolerance >= _CLOSE

    def _of_long_range(self) -> bool:
        """Whether steps are so long that the iteration alone is slow."""
        weights = self.assembly.scheme.operator(self.assembly.dt)
        return any(long_steps(weights, p.operators.mass, p.operators.stiffness) for p in self.assembly.propagators)

    def _rough_share(self) -> float:
        """Share of the linear residual that a Newton step by products may leave. Velocities of a whole face under a
        traction are this ratio times those of a point, and what is left must not turn the direction of slip."""
        weights, whole = self.assembly.scheme.operator(self.assembly.dt), self.whole.assembly.propagators
        ratios = [stiffness_over_inertia(weights, p.operators.mass, p.operators.stiffness) for p in whole]
        return min(_ROUGHEST, _ROUGH / max(ratios))

    @cached_property
    def points(self) -> PointByPoint:
        """Solution point by point, built when first used."""
        return PointByPoint(self.assembly)

    @cached_property
    def weights(self) -> Array:
        """Weights (4, n_flat) of r^2, F^2, W^2 and (W' - W)^2 in the error indicator (``kernels.indicator``)."""
        layout, k = self.assembly.layout, self.k
        # rigid sides have no part in the measure
        area = np.where(k > 0, layout.area, 0.0)
        impedance = np.where(self.assembly.impedance > 0, self.assembly.impedance, 1.0)
        f_weight, w_weight = area / impedance, area * impedance
        if self.assembly.quasi_static:
            moving = 0.0
        else:
            moving = 1.0
        relative = np.zeros_like(w_weight)
        for group in layout.groups:
            first, second = group.block(w_weight)
            fixed = np.minimum(first, second) <= 0.0  # by the ground
            # Z Z' / (Z + Z'); one side alone where the other is held
            both = np.divide(first * second, first + second, out=np.maximum(first, second), where=~fixed)
            group.block(relative)[:] = both
        # r / 2 is the half difference of tractions, z r / 2 that of velocities: both in the norm of (24)
        weights = 0.25 * (f_weight + w_weight * self.z * self.z), f_weight, moving * w_weight, moving * relative
        return np.stack(weights)

    @property
    def level(self) -> Array:
        """Tractions (n_flat,) that are negligible, Pa: a small part of what the loads can bring, along the normals."""
        level = FLOOR * self.assembly.characteristic_traction
        return np.where(self.assembly.layout.normal, level, 0.0)

    def bind(self, exact: bool = False) -> None:
        """Condense the propagators on this direction; ``exact``: without tables of Y."""
        if self.own_coarse is not None:
            self.whole.bind(exact)
            self.coarse = None
            if self.whole.coarse is not None:
                self.coarse = self.own_coarse(self.whole.coarse)
            return
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            propagator.bind(self.k[channels[:, 0]], self._single)
        if self.short and self.assembly.swept:
            if self.tables is None:
                self.tables = self._made_tables()
            for propagator, tables in zip(self.assembly.propagators, self.tables, strict=True):
                propagator.tables = {name: table for name, table in tables.items() if not (exact and name == "y")}
        if self.assembly.quasi_static and not any(p.joined for p in self.assembly.propagators):
            # Y of the classes, which the coarse problem takes one after the other
            in_threads(self._settings.threads, lambda p: p.condensed, self.assembly.propagators)
            self.coarse = CoarseProblem(self.assembly, self.k)

    def _made_tables(self) -> list[dict[str, Table]]:
        """Tables of the classes: of Y where the form of the interfaces allows it and the tolerance is not too small."""
        tolerance = min(self._settings.tolerance, self._settings.force_tolerance)
        rule = truncation_of(tolerance), self._settings.tables
        points = [self.assembly.points_of(c) for c in range(len(self.assembly.propagators))]

        def tables_of(one: tuple[Propagator, Points]) -> dict[str, Table]:
            if one[0].swept:
                return interface_tables(*one, *rule)
            return {}

        return in_threads(self._settings.threads, tables_of, zip(self.assembly.propagators, points, strict=True))

    @property
    def sparse(self) -> bool:
        """Whether some class has a table of Y."""
        return any("y" in tables for tables in self.whole.tables or ())

    def incoming(self, f_hat: Array, w_hat: Array) -> Array:
        """Quantity q = F_hat + k W_hat that the linear stage starts from."""
        q: Array = f_hat + self.k * w_hat
        return q

    def relative_fields(self) -> dict[str, Any]:
        """Fields of the record of the run for Newton steps, empty where there are none."""
        if self.newton:
            return self.relative
        return {}

    def run_fields(self) -> dict[str, Any]:
        """Fields of the record of the run (``kernels.records``)."""
        fields: dict[str, Any] = {"k": self.k, "z": self.z, "weights": self.weights, "metric": self.metric}
        krylov = self.relative.get("krylov")
        # the same share of z
        if krylov:
            proximal = _PROXIMAL / _WIDENING
        else:
            proximal = _PROXIMAL
        sparse = any("y" in p.tables for p in self.whole.assembly.propagators)
        fields |= {"newton": int(self.newton), "proximal": proximal, "sparse": int(sparse)}
        fields |= {"from_last": int(self.short), "referenced": 1 if self.short else 2 * int(self.predicted)}
        fields["newton_z"] = self.newton_z
        fields["newton_price"] = 0.0
        if self.assembly.quasi_static:
            fields["newton_price"] = _PRICE_ON_ITERATION
        elif self.newton and krylov:
            tied = tied_fields(self.assembly, proximal * self._summed(self.newton_z))
            fields |= tied | {"newton_price": product_price(self.assembly, tied), "newton_share": self._rough_share()}
        # steps of derivatives that are made on the iteration have no matrix, and no choice
        elif self.newton and "point_group" in self.whole.relative:
            fields["newton_price"] = newton_price(self.whole.assembly, self.whole.relative)
        if self.coarse is not None and self.coarse.sizes["n_coarse"]:
            fields |= self.coarse.fields()
        return fields

    def _summed(self, z: Array) -> Array:
        """Sum of z of both sides, at the channels of both, (n_flat,)."""
        total = np.zeros_like(z)
        for group in self.assembly.layout.groups:
            group.block(total)[:] = group.block(z).sum(axis=0)
        return total

    def group_fields(self) -> list[dict[str, Any]]:
        """Fields of the groups' records: 1/k of both sides, normal and tangential."""
        fields = []
        for group in self.assembly.layout.groups:
            record = {}
            for name, z in (("z_sum", self.z), ("newton_z_sum", self.newton_z)):
                both = group.block(z).sum(axis=0)
                # without tangents: N twice
                record[name] = np.ascontiguousarray(both[:, [0, min(1, group.n_component - 1)]])
            fields.append(record)
        return fields

    @cached_property
    def newton_z(self) -> Array:
        """z (n_flat,) of the laws in Newton steps: by products, _WIDENING times that of the iteration, but for laws
        that are written in Python."""
        if not self.relative.get("krylov"):
            return self.z
        z = self.z.copy()
        for group in self.assembly.layout.groups:
            if getattr(group.behaviour, "compiled", False):
                z[group.start : group.stop] *= _WIDENING
        return z


def relative_operator(assembly: Assembly) -> dict[str, Any]:
    """Blocks of the relative operator of Newton's method (``kernels.newton``), as fields of the record of the run;
    ``n_matrix`` : numbers of the matrix where every point is active.

    The blocks are the interfaces. Two of them are coupled where they share a substructure. Their order is the
    reverse Cuthill-McKee order of that graph, so that the matrix has a small envelope: block tridiagonal for a chain.
    """
    layout, owner = assembly.layout, assembly.owners()
    order, low, high = ordered_blocks(assembly, owner[0])
    groups = []
    numbers = []
    sizes = [0]
    unknowns = []
    for i in order:
        # points of an interface among those of its group
        group = layout.group(i)
        points = np.arange(group.members[i].start, group.members[i].stop)
        groups.append(np.full(len(points), next(g for g, other in enumerate(layout.groups) if other is group)))
        numbers.append(points)
        sizes.append(len(points))
        unknowns.append(len(points) * group.n_component)
    starts = np.cumsum([0, *unknowns])
    return {
        "n_block": len(order),
        "n_unknown": int(starts[-1]),
        # an envelope as ``envelope.place_rows`` makes it: rows of a block reach from its first to its last neighbour
        "n_matrix": sum(n * int(starts[b + 1] - starts[a]) for n, a, b in zip(unknowns, low, high, strict=True)),
        "block_low": low,
        "block_high": high,
        "block_points": np.cumsum(sizes),
        "n_place": sum(sizes),
        "point_group": np.concatenate([np.zeros(0, dtype=np.int64), *groups]),
        "point_number": np.concatenate([np.zeros(0, dtype=np.int64), *numbers]),
        "point_owned": np.ones(sum(sizes), dtype=np.int64),
        "owner": owner[0],
        "owner_class": owner[1],
        "live_row": owner[2],
    }


# time of a number of a table in a product, of a channel in the local stage and the measures, of an entry of the matrix
# that is assembled, of a multiplication of its factorisation, all over the first
_CHANNEL = 40.0
_ENTRY = 25.0
_FLOP = 0.15
_ACTIVE = 0.5  # share of the unknowns that are active, of which the price is reckoned


def _read(assembly: Assembly) -> float:
    """Numbers that an iteration reads, channels in units of these: the tables of all classes, or two substitutions."""
    total = _CHANNEL * assembly.layout.n_flat
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        n, members = channels.shape
        if propagator.swept:
            table = 2.0 * propagator.operators.factor.symbolic.face_entries
        else:
            table = 0.5 * n * n
        total += table * max(1.0, members / 4)
    return total


def product_price(assembly: Assembly, tied: Mapping[str, Any]) -> float:
    """Cost of a product of a Newton step with its preconditioner, the tied assembly, over that of an iteration."""
    entries = float(tied.get("tied_entries", 0))  # twice, in single precision
    return 1.0 + entries / _read(assembly)


def newton_price(assembly: Assembly, relative: dict[str, Any]) -> float:
    """Cost of a Newton step over that of an iteration, by the sizes of the whole assembly: the same on all processes.

    An iteration reads the tables of all classes once, a step assembles and factorises the matrix of the active points.
    """
    iteration = _read(assembly)
    groups, points = relative["point_group"], np.diff(relative["block_points"])
    size = np.array([group.n_component for group in assembly.layout.groups])[groups]
    if len(size):
        sizes = _ACTIVE * np.add.reduceat(size, np.cumsum([0, *points[:-1]]))
    else:
        sizes = np.zeros(0)
    reach = np.array(
        [sizes[a : b + 1].sum() for a, b in zip(relative["block_low"], relative["block_high"], strict=True)]
    )
    return float((sizes * (_ENTRY * reach + _FLOP * reach**2)).sum() / iteration)


def ordered_blocks(assembly: Assembly, owner: Index) -> tuple[list[int], Index, Index]:
    """Interfaces in the order of the blocks; first and last block that each is coupled with, neither decreasing."""
    n = len(assembly.interfaces)
    if n < 2:
        return list(range(n)), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    shares = np.zeros((n, assembly.n_substructure))
    for i in range(n):
        for side in (0, 1):
            body = owner[assembly.layout.channels(i, side).ravel()[0]]
            if body >= 0:
                shares[i, body] = 1.0
    graph = sp.csr_array(shares @ shares.T + np.eye(n))
    order = reverse_cuthill_mckee(graph, symmetric_mode=True)
    table = graph.toarray()[np.ix_(order, order)] > 0
    low = np.array([int(np.argmax(row)) for row in table], dtype=np.int64)
    low = np.minimum.accumulate(low[::-1])[::-1].copy()  # of this block or a later one: the factors fill no more
    # a column reaches down to the last block whose envelope begins at it or before
    high = np.array([int(np.flatnonzero(low <= b)[-1]) for b in range(n)], dtype=np.int64)
    return [int(i) for i in order], low, high
