"""Derivatives of the outputs at the end of a communication step by one input over it.

While no point opens or closes, sticks or begins to slip, the end of a step depends smoothly on its inputs. The step is
made again from the state before it. Beside it two variants with a little more and a little less of the input are made,
with the laws of the interfaces about the solution of each instant in the place of their own,

    F_hat = F* + J (jump + g - jump* - g*),        J = dF_hat / djump  (``laws.dispatch.tangent``),

with * the solution, jump the free velocities and g the normalised gaps of the points. Their fields are then affine in
the input, and energies quadratic: the central difference of the variants is the derivative but for round-off, whatever
its length. In slip J is the consistent tangent; the traction keeps to the cone and to the direction of slip. What
counts points (shares, iterations, events) does not change: its derivative is 0.

One instant of a variant is a linear system for the incoming quantity, q = F_hat + k W_hat with both stages as an affine
map of q. It is solved to round-off by the generalised minimal residual method (``krylov``), each solution for the
residual of the last.

A caller gives a copy of the moving block with ``room`` numbers behind it, and a record of the run of its own, of which
some rules are changed here. The room holds four states (base, more, less, before the step), the laws, the outputs of
the first three, the points with the smallest gaps, and the vectors of the linear system.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .communication import begin_rows, conclude, given_of
from .inputs import N_MEMORY, rate_over
from .instants import end_instant, first_guess, guess_from_reference, march_instants
from .krylov import combine, length_of, orthogonalise
from .linear_stage import linear_stage
from .local_stage import POINT, add_tangent_at, finish, open_window, outgoing, prepare
from .outputs import BEGIN, END, OF_GROUP, SMALLEST, summary_of
from .sparse_response import squared_defect
from .tasks import END as END_CLASS
from .tasks import PREDICT, SOLUTION, each_class

Array = NDArray[np.float64]

BASE = 0
MORE = 1
LESS = 2
BEFORE = 3
"""States in the room."""
UNSOLVED = 1
SINGULAR = 2
OWN_LAW = 3
"""Results of ``derive``: an instant needs a fall-back; the linear system has no unique solution; a law is written in
Python, whose tangents are not here."""
_EFFECT, _LARGEST = 1e-2, 1e8
"""Relative change of tractions and velocities below which the difference is enlarged, as far as it exceeds round-off;
factor at most."""
_VECTORS = 200
_ROUNDS = 12
_PART = 1e-8
"""Directions of a solution, solutions, and part of the residual that one leaves."""
_SMALL, _ENOUGH, _ENOUGH_HALVED = 1e-14, 1e-9, 1e-5
"""Residual over q at which they end, and above which there is no derivative; the same where matrices of an assembly
marched by its modes are float32, whose round-off is that of the residual."""
_CORRECTIONS = 12
"""Corrections of an instant with tables of Y at most."""
_RULES = 4


@kernel
def vectors_of(pools: Any) -> int:
    """Directions of a solution."""
    return int(min(_VECTORS, pools.run[0].n_flat))


@kernel
def place_of_laws(pools: Any) -> int:
    """Numbers of the room before the laws."""
    return int(4 * pools.run[0].state_size)


@kernel
def place_of_rows(pools: Any) -> int:
    """Numbers before the outputs."""
    at = place_of_laws(pools)
    for g in range(len(pools.groups)):
        h = pools.groups[g].n_component
        at += pools.groups[g].n_point * (h * (2 + h) + 2 * (h if pools.groups[g].elastic == 1 else 1))
    return int(at)


@kernel
def place_of_system(pools: Any) -> int:
    """Numbers before the linear system."""
    run = pools.run[0]
    return int(place_of_rows(pools) + 3 * run.n_output + run.n_interface + _RULES + POINT)


@kernel
def room(pools: Any) -> int:
    """Numbers that are needed behind the moving block."""
    n, width = pools.run[0].n_flat, vectors_of(pools) + 1
    return int(place_of_system(pools) + (2 + width) * n + width * (width + 2))


@kernel
def derive(pools: Any, which: int, rule: int, n: int, whole: int) -> int:
    """Write the derivatives of the outputs into their row 0: by the value (``which`` = 2 e) or the rate (2 e + 1) of
    the input e, over a step of ``whole`` time steps that has ended after n. Its inputs, place and the state before it
    are in the moving block. 0, UNSOLVED, SINGULAR, OWN_LAW, or a negative status (``communication``); with ``which``
    below 0 the ``room``."""
    if which < 0:
        return room(pools)
    for g in range(len(pools.groups)):
        if pools.groups[g].law < 0:
            return OWN_LAW
    run = pools.run[0]
    moving = pools.moving
    e = which // 2
    at = len(moving) - room(pools)
    value, rate = moving[run.input_value + e], moving[run.input_rate + e]
    length = (whole + moving[run.progress + 8] - moving[run.progress + 7]) * run.dt
    # a rate counts by what it adds over the step
    size = max(abs(value), abs(rate) * length, 1.0)
    # with no rate set that of the causal line
    count = run.n_input
    memory = moving[run.inputs : run.inputs + N_MEMORY * count]
    kinds = pools.fixed_int[run.input_kind : run.input_kind + count]
    slope = rate_over(given_of(pools), memory, kinds, e, moving[run.progress + 3], rule)
    if which % 2 == 1:
        # slope - size must not be 0: the rules of interpolation take a rate of 0 for none
        size = max(size / length, 2.0 * abs(slope))
    keep_rules(pools, at)
    for j in range(run.state_size):
        moving[at + BEFORE * run.state_size + j] = moving[j]
    # a second time where the effect is small: the round-off of the variants is that of their whole fields
    for again in range(2):
        status = march_variants(pools, at, which, rule, n, whole, slope, size)
        if status != 0:
            return status
        effect = effect_of(pools, at)
        if again == 1 or effect == 0.0 or effect >= _EFFECT:
            break
        size *= min(_EFFECT / effect, _LARGEST)
    set_column(pools, at, size)
    return 0


@kernel
def keep_rules(pools: Any, at: int) -> None:
    """Keep what the variants change of the rules of the run; no solve is reused and no thread but this one works."""
    run = pools.run[0]
    rules = pools.moving[at + place_of_system(pools) - _RULES - POINT :]
    rules[0] = run.deepest
    rules[1] = run.rest_traction
    rules[2] = run.make_up
    # a solve for another q would leave the variants not affine
    run.reuse = -1.0
    run.threads = 1


@kernel
def set_rules(pools: Any, at: int, variant: int) -> None:
    """Rules of the base, or of variants: a penetrated point has a gap, no class rests, no drift is made up."""
    run = pools.run[0]
    rules = pools.moving[at + place_of_system(pools) - _RULES - POINT :]
    run.deepest = rules[0] if variant == BASE else -np.inf
    run.rest_traction = rules[1] if variant == BASE else -1.0
    run.make_up = rules[2] if variant == BASE else 0.0


@kernel
def march_variants(pools: Any, at: int, which: int, rule: int, n: int, whole: int, slope: float, size: float) -> int:
    """Make n time steps of the base and of both variants; 0, or a status of ``derive``. ``slope`` : rate of the input
    over the step, ``size`` : change of value or rate."""
    run = pools.run[0]
    moving = pools.moving
    e = which // 2
    n_state, status = run.state_size, 0
    value, rate = moving[run.input_value + e], moving[run.input_rate + e]
    for step in range(n):
        for variant in range(3):
            # each goes on from its own state
            start = at + (BEFORE if step == 0 else variant) * n_state
            for j in range(n_state):
                moving[j] = moving[start + j]
            change = 0.0 if variant == BASE else size if variant == MORE else -size
            moving[run.input_value + e] = value + (change if which % 2 == 0 else 0.0)
            # the base follows the rule; variants have the rate that it gives, and the change, written out
            moving[run.input_rate + e] = slope + change if which % 2 == 1 and variant != BASE else rate
            set_rules(pools, at, variant)
            status = end_time_step(pools, at, variant, rule, step, whole)
            if status != 0:
                return status
            for j in range(n_state):
                moving[at + variant * n_state + j] = moving[j]
            if step == n - 1:
                keep_row(pools, at, variant)
    moving[run.input_value + e], moving[run.input_rate + e] = value, rate
    return 0


@kernel
def end_time_step(pools: Any, at: int, variant: int, rule: int, step: int, whole: int) -> int:
    """Make one time step of the base or of a variant; 0, or a status of ``derive``."""
    status = begin_rows(pools, 1, rule, step, whole)
    if status != 0:
        return status
    laws = at + place_of_laws(pools)
    if variant != BASE:
        if not solve_instant_by_tangents(pools, laws, at + place_of_system(pools)):
            return SINGULAR
    elif march_instants(pools, 1, 1) < 1:
        return UNSOLVED
    else:
        linearise(pools, laws, at + place_of_system(pools) - POINT)
    conclude(pools, 1, step, whole, rule)
    return 0


# -- laws about a solution ------------------------------------------------------------------------------------------
@kernel
def linearise(pools: Any, at: int, scratch: int) -> None:
    """Laws of all points about the last local stage: jump, traction (p, h), reach, 1 where it changes with the gap (p,)
    or (p, h), tangent (p, h, h), group after group."""
    run, moving = pools.run[0], pools.moving
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        h = group.n_component
        size, wide = group.n_point * h, group.n_point * (h if group.elastic == 1 else 1)
        # gaps that the law takes: the last row of ``opened``
        start = group.opened + 3 * wide
        for j in range(size):
            moving[at + j], moving[at + size + j] = moving[group.jump + j], moving[group.traction + j]
        for j in range(wide):
            moving[at + 2 * size + j] = moving[group.reach + j]
            moves = moving[start + j] >= run.deepest  # a penetration stays as it is
            if group.elastic == 1:  # the tractions of friction follow the velocities alone
                moves = group.opens == 0 or j % h == 0
            moving[at + 2 * size + wide + j] = 1.0 if moves else 0.0
        at += 2 * (size + wide)
        for p in range(group.n_point):
            tangent = moving[at + p * h * h : at + (p + 1) * h * h]
            tangent[:] = 0.0
            add_tangent_at(pools, g, p, moving[scratch : scratch + POINT], tangent)
        at += size * h


@kernel
def apply_tangents(pools: Any, g: int, at: int) -> int:
    """Tractions of the points of a group by their tangents; the place of the laws of the next group."""
    moving, group = pools.moving, pools.groups[g]
    h = group.n_component
    width = h if group.elastic == 1 else 1
    size, wide = group.n_point * h, group.n_point * width
    of_reach, tangents = at + 2 * size, at + 2 * (size + wide)
    for p in range(group.n_point):
        for a in range(h):
            total = moving[at + size + p * h + a]
            for b in range(h):
                change = moving[group.jump + p * h + b] - moving[at + p * h + b]
                # one gap a point opens along N, component 0
                if b < width:
                    j = p * width + b
                    change += moving[of_reach + wide + j] * (moving[group.reach + j] - moving[of_reach + j])
                total += moving[tangents + (p * h + a) * h + b] * change
            moving[group.traction + p * h + a] = total
    return int(tangents + size * h)


# -- one instant of a variant ---------------------------------------------------------------------------------------
@kernel
def solve_instant_by_tangents(pools: Any, laws: int, at: int) -> bool:
    """Solve an instant with the ``laws``, and end it; False where its linear system has no unique solution. With tables
    of Y the exact motion corrects it until the defect falls no more (``sparse_response``)."""
    run, work = pools.run[0], pools.moving
    each_class(pools, PREDICT, 1, 0)
    open_window(pools, 1, 0)
    if run.n_flat > 0:
        first_guess(pools, 1)
        last = np.inf
        for _ in range(_CORRECTIONS):
            if not solve_system(pools, laws, at):
                return False
            if run.sparse == 0:
                break
            each_class(pools, SOLUTION, 1, 0)
            defect = np.sqrt(squared_defect(pools))
            if not defect < 0.5 * last:
                break
            last = defect
            guess_from_reference(pools, work[run.q : run.q + run.n_flat], True)
            for c in range(len(pools.classes)):
                if pools.classes[c].sparse == 1:
                    work[pools.classes[c].ended] = 0.0
    each_class(pools, END_CLASS, 1, 0)
    end_instant(pools, 1, 0)
    return True


@kernel
def residual(pools: Any, laws: int, q: Array, out: Array) -> None:
    """out = F_hat + k W_hat - q of both stages, with the ``laws``."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    for j in range(n):
        work[run.q + j] = q[j]
    linear_stage(pools, 1, 1, 0)
    for g in range(len(pools.groups)):
        n_point = pools.groups[g].n_point
        outgoing(pools, g, 0, 0, n_point)
        prepare(pools, g, 0, 0, n_point)
        laws = apply_tangents(pools, g, laws)
        finish(pools, g, 0, 1, 0, n_point)
    for j in range(n):
        out[j] = work[run.local_f + j] + pools.fixed[run.k + j] * work[run.local_w + j] - q[j]


@kernel
def solve_system(pools: Any, laws: int, at: int) -> bool:
    """Solve q = F_hat + k W_hat from the q of ``work`` on; whether the residual is that of a solution."""
    run = pools.run[0]
    work = pools.moving
    most = vectors_of(pools)
    n, width = run.n_flat, vectors_of(pools) + 1
    q, rest = work[at : at + n], work[at + n : at + 2 * n]
    basis, small = work[at + 2 * n : at + (2 + width) * n], work[at + (2 + width) * n :][: width * (width + 2)]
    for j in range(n):
        q[j] = work[run.q + j]
    residual(pools, laws, q, rest)
    for _ in range(_ROUNDS):
        size = length_of(rest)
        if size <= _SMALL * length_of(q):
            break
        used = directions(pools, laws, q, rest, basis, small)
        combine(small, used, most)
        trial = basis[used * n : (used + 1) * n]
        for j in range(n):
            trial[j] = q[j]
        for k in range(used):
            y = small[(most + 2) * width + k]
            for j in range(n):
                trial[j] += y * basis[k * n + j]
        # the basis has been summed: its place is free
        remainder = basis[:n]
        residual(pools, laws, trial, remainder)
        # ends for NaN, too
        if not length_of(remainder) < size:
            break
        for j in range(n):
            q[j], rest[j] = trial[j], remainder[j]
    # fields of the q that is kept: the last ones may be of a trial that was refused
    residual(pools, laws, q, rest)
    enough = _ENOUGH
    for c in range(len(pools.classes)):
        if pools.classes[c].patched == 1 and pools.classes[c].halved == 1:
            enough = _ENOUGH_HALVED
    return bool(length_of(rest) <= enough * length_of(q))


@kernel
def directions(pools: Any, laws: int, q: Array, rest: Array, basis: Array, small: Array) -> int:
    """Arnoldi vectors about q from its residual ``rest`` on; their number."""
    n = pools.run[0].n_flat
    most = vectors_of(pools)
    size = length_of(rest)
    for j in range(n):
        basis[j] = rest[j] / size
    small[(most + 2) * (most + 1)] = size
    for k in range(most):
        vector, new = basis[k * n : (k + 1) * n], basis[(k + 1) * n : (k + 2) * n]
        for j in range(n):  # steps of this length keep the digits of the difference
            new[j] = q[j] + size * vector[j]
        residual(pools, laws, new, new)
        for j in range(n):
            # -dr/dq along it: the solution for the residual is the change of q
            new[j] = (rest[j] - new[j]) / size
        if not orthogonalise(basis, small, n, k, most) > _PART * size:
            return k + 1
    return most


# -- the difference -------------------------------------------------------------------------------------------------
@kernel
def keep_row(pools: Any, at: int, variant: int) -> None:
    """Keep the outputs of row 1; smallest gaps are those of the points that have them in the base."""
    run, moving = pools.run[0], pools.moving
    rows = at + place_of_rows(pools)
    lowest, row = rows + 3 * run.n_output, rows + variant * run.n_output
    for i in range(run.n_output):
        moving[row + i] = moving[run.output + run.n_output + i]
    for i in range(run.n_interface):
        summary = summary_of(pools, i)
        if summary[SMALLEST] < 0:
            continue
        gaps = run.history_gap + run.n_point + pools.groups[summary[OF_GROUP]].first_point
        if variant == BASE:
            least = summary[BEGIN]
            for p in range(summary[BEGIN], summary[END]):
                if moving[gaps + p] < moving[gaps + least]:
                    least = p
            # an index among numbers
            moving[lowest + i] = least
        moving[row + summary[SMALLEST]] = moving[gaps + int(moving[lowest + i])]


@kernel
def effect_of(pools: Any, at: int) -> float:
    """Largest relative change of tractions and of velocities between a variant and the base; 1 where there are none."""
    run, moving = pools.run[0], pools.moving
    largest, found = 0.0, False
    for kind in range(2):
        base = at + (run.f_hat if kind == 0 else run.w_hat)
        more = base + MORE * run.state_size
        change = 0.0
        whole = 0.0
        for j in range(run.n_flat):
            change += (moving[more + j] - moving[base + j]) ** 2
            whole += moving[base + j] ** 2
        if whole > 0.0:
            found = True
            largest = max(largest, np.sqrt(change / whole))
    return float(largest if found else 1.0)


@kernel
def set_column(pools: Any, at: int, size: float) -> None:
    """Central difference of the outputs of the variants into row 0; 0 of what counts points, iterations or events."""
    run, moving = pools.run[0], pools.moving
    more = at + place_of_rows(pools) + MORE * run.n_output
    for i in range(run.n_output):
        moving[run.output + i] = (moving[more + i] - moving[more + run.n_output + i]) / (2.0 * size)
    for i in range(run.n_constant):
        moving[run.output + pools.fixed_int[run.constant_outputs + i]] = 0.0
