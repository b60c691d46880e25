"""Semi-smooth Newton step on the relative operator of the interfaces at one instant.

Where a step is long the condensed operator of an instant is of long range: the iteration settles points that slip or
open one after the other. With tractions F on sides E and -F on E', the velocities of both sides follow from the
admittances D of their substructures, and with A the sum of these admittances over both sides the opening velocity and
the local stage read

    d = d_0 - A F,    F = T(d + z F),    T: the laws at the points (``laws``), z = 1/k summed over the sides

Newton's method on this equation takes the tangent J of the laws (Alart and Curnier 1991; Christensen, Klarbring, Pang
and Stroemberg 1998), with u the change of d + z F and rho = F - F_hat the residual,

    dF = -rho + J u,    u = z dF - A dF:      J = sum of columns c_i and rows r_i of rank one / (z_i + s_i)
    [r_i . A c_j + s_i delta_ij] y_j = -z_i r_i . rho + r_i . A rho,      dF = -rho + sum of c_i y_i

with three unknowns y at a point that sticks, two at one that slips (the traction along the direction of slip follows
from the pressure, so that the friction law needs no outer fixed point, whatever mu is; cf. the bipotential of De Saxce
and Feng 1998) and none at one that is open. The block of the active points is factorised directly (``envelope``), on
large interfaces solved by products alone (``krylov``).
Points that several interfaces hold make it singular: a share ``proximal`` of z is added to the diagonal of rows of
normal and sticking components. The solution does not change by that, as the right-hand side is the true residual.

The step is made in the incoming quantity q = F + k W and halved at most twice, until the residual of the local stage in
the norm of the iteration falls; both stages are linear between its ends, so that this takes no products. A step is made
where it costs less than the iterations it saves (``_pays``), or where the iteration has stalled. Only products with D
(``admit``) and blocks of its entries (``coupling``) occur. Without inertia a floating body has no D: there the step is
made by products of the linear stage (``iteration_step``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .acceleration import difference_parts, next_iterate
from .active_points import activate, add_relative, assemble, is_factored, soften, solve_active, sum_of_tangents
from .callouts import MATRIX, SUM, UNKNOWNS, call_out
from .iteration_step import step_on_iteration
from .krylov import add_columns, admit, solve_by_products, widen
from .local_stage import finish, outgoing, prepare, solve_points
from .sums import add_parts, exchange, exchange_parts

Array = NDArray[np.float64]

COLD = 6
WARM = 3
LATE = 9
"""Iterations before the first step; the same where the instant before ended with one; iterations after which a step is
made however close the tolerance is."""
FAR = 10.0
"""Distance from the tolerances from which on a step is made after COLD iterations."""
RECENT = 5
"""Iterations whose rate is taken for those to come, without inertia; two with it."""
STEPS = 40
"""Steps at one instant at most."""
HALVINGS, DECREASE = 2, 0.1
"""Halvings of a step; share of the linear decrease of the residual that a step has to give."""
SLOW, LITTLE = 6, 0.02
"""Steps in a row that decrease the residual by less than a share LITTLE, after which the method is left."""
GAIN = 0.1
"""Share of the distance from the tolerances at the first step that an iterate has to be below for the acceleration to
go on from it where the method is left: a step may have moved floating bodies far."""
N_FINISH = 6
"""Numbers of ``finish`` (``keep_course``)."""
N_COURSE = 13
MADE, ACTIVE, SIZE, WITHOUT, LEFT, PHASE, BEGUN, RESIDUAL, POWER, DUE, TANGENTS, LAST, PRODUCTS = range(N_COURSE)
"""Numbers of ``course``: steps made, 1 while the next iterate is a Newton step, residual of the last trial, steps in a
row without decrease, 1 where the method was left, iteration from which on the acceleration has its differences,
distance from the tolerances at the first step, of several processes the defect of tables, and its power, 1 where the
iteration has stalled and a step is due whatever it costs, sum of the tangents of the last step, number of the last
iteration, products of the steps where they are made by these."""
UNCERTAIN, CLOSER = 12, 0.1
"""Iterations without a Newton step from which on the residual of an instant underestimates the error of its tractions,
by up to ten times; share of the tolerances that ends it then."""
EXPECTED, UNSETTLED = 2, 6
"""Steps that end an instant, as their price is reckoned with; those by products while none have been made, where faces
meet and the points find their states."""
SOME = 6.0
MANY = 50.0
BESIDE = 3.0
"""Products of a step by these before any was made, with the tied assembly and without; iterations that such a step
costs beside its products."""
SLOWER = 2.0
"""How many times more iterations an instant of long range takes than the rate of the last ones lets expect."""
NEAR = 100.0
AIM = 0.1
ROUGH_STEPS = 8
"""Distance from the tolerances up to which a step by products is solved as far as it has to be to end the instant, and
the share of the tolerances that it aims at: farther off the active points change anyway. Steps of an instant after
which all are solved closely."""
FADING = 0.985
"""What steps by products cost at the last instant that ended with some counts less with every instant without, so that
they are tried again."""


@kernel
def propose(pools: Any) -> bool:
    """Ends of a Newton step: q and W of the last iterate are kept, the new q is that of the full step; False where the
    matrix is singular."""
    run, work = pools.run[0], pools.moving
    if run.on_iteration == 1:
        before = work[run.course + SIZE]
        keep_start(pools)
        set_size(pools)
        return step_on_iteration(pools, work[run.course + SIZE], before)
    if run.krylov == 1:
        widen(pools)
    admit_residual(pools)
    if not change_tractions(pools, active_matrix(pools)):
        return False
    full_step(pools)
    set_size(pools)
    return True


@kernel
def admit_residual(pools: Any) -> None:
    """Velocities that the residual of the tractions alone gives, into ``step_w``."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    for j in range(n):
        x[j] = work[run.local_f + j] - work[run.f + j]  # -rho
    admit(pools, x, v)
    exchange(pools, run.step_w, n, 1)


@kernel
def active_matrix(pools: Any) -> int:
    """Unknowns of the step, their right-hand side and matrix, to which the processes of a run add theirs; size of the
    matrix (with ``krylov``, which has none, the number of unknowns), 0 where there are none."""
    run = pools.run[0]
    count = activate(pools)
    if run.shared == 1:  # the points of other processes have their unknowns between those of this one
        call_out(pools, UNKNOWNS, 0, 0, 0)
        count = activate(pools)
    pools.moving[run.course + TANGENTS] = sum_of_tangents(pools)
    if count == 0:
        return 0
    add_relative(pools, pools.moving[run.step_w : run.step_w + run.n_flat])
    if run.krylov == 1:
        return count
    if is_factored(pools, count):
        return count  # more than 0: the matrix is not read
    size = assemble(pools)
    soften(pools)
    # sums over processes follow: each right-hand side is counted by the owner of its point
    for p in range(run.n_place if run.shared == 1 else 0):
        if pools.fixed_int[run.point_owned + p] == 0:
            for i in range(pools.moving_int[run.unknown_of + p], pools.moving_int[run.unknown_of + p + 1]):
                pools.moving[run.unknowns + i] = 0.0
    if run.shared == 1 and size > 0:
        call_out(pools, MATRIX, size, 0, 0)
    return size


@kernel
def change_tractions(pools: Any, size: int) -> bool:
    """Change of the tractions in the step into ``step_f``, and the velocities that it gives; ``size`` from
    ``active_matrix``. False where the matrix is singular."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    if size > 0 and run.krylov == 1:
        products = solve_by_products(pools, size, share_left(pools))
        if products == 0:
            return False
        work[run.course + PRODUCTS] += float(products)
        for j in range(n):  # -rho again: the products took it for scratch
            x[j] = work[run.local_f + j] - work[run.f + j]
    elif size > 0 and not solve_active(pools):
        return False
    count = pools.moving_int[run.unknown_of + run.n_place]
    add_columns(pools, work[run.unknowns : run.unknowns + count], x)
    admit(pools, x, v)
    exchange(pools, run.step_w, n, 1)
    return True


@kernel
def share_left(pools: Any) -> float:
    """Share of the linear residual that a step by products leaves (inexact Newton method, Dembo, Eisenstat and Steihaug
    1982)."""
    run, work = pools.run[0], pools.moving
    if work[run.course + MADE] >= ROUGH_STEPS:
        return 0.0  # as little as there can be: the rough ones did not end it
    now = _merit(pools, int(work[run.course + LAST]))
    return float(min(run.newton_share, AIM / now) if now <= NEAR else run.newton_share)


@kernel
def full_step(pools: Any) -> None:
    """``keep_start``, and q of the full step."""
    keep_start(pools)
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    x, v = work[run.step_f : run.step_f + n], work[run.step_w : run.step_w + n]
    f, q = work[run.f : run.f + n], work[run.q : run.q + n]
    w, k = work[run.w : run.w + n], pools.fixed[run.k : run.k + n]
    for j in range(n):
        q[j] = f[j] + x[j] + k[j] * (w[j] + v[j])  # F + k W with F + dF, W + dW


@kernel
def keep_start(pools: Any) -> None:
    """Keep q and W of the last iterate; the squared residual over each interface goes to ``own_parts``."""
    run, work = pools.run[0], pools.moving
    for j in range(run.n_flat):
        work[run.old_q + j], work[run.old_w + j] = work[run.q + j], work[run.w + j]
    for e in range(run.n_interface):
        total, size = 0.0, pools.fixed_int[run.segments + 3 * e + 2]
        for side in range(2):
            at = pools.fixed_int[run.segments + 3 * e + side]
            r, metric = work[run.r + at : run.r + at + size], pools.fixed[run.metric + at : run.metric + at + size]
            for j in range(size):
                total += metric[j] * r[j] * r[j]
        work[run.own_parts + e * run.part_width] = total


@kernel
def set_size(pools: Any) -> None:
    """Residual at the start of a step, from the ``parts`` of all interfaces."""
    run, work = pools.run[0], pools.moving
    exchange_parts(pools)
    add_parts(pools, 0, 1)
    work[run.course + SIZE] = np.sqrt(work[run.totals])


@kernel
def keep_end(pools: Any) -> None:
    """Keep q and W at the end of the full step."""
    run, work = pools.run[0], pools.moving
    for j in range(run.n_flat):
        work[run.new_q + j], work[run.new_w + j] = work[run.q + j], work[run.w + j]


@kernel
def trial_fields(pools: Any, length: float) -> None:
    """Fields of the linear stage at a share of the step."""
    run, work = pools.run[0], pools.moving
    n = run.n_flat
    q, w = work[run.q : run.q + n], work[run.w : run.w + n]
    old_q, old_w = work[run.old_q : run.old_q + n], work[run.old_w : run.old_w + n]
    new_q, new_w = work[run.new_q : run.new_q + n], work[run.new_w : run.new_w + n]
    for j in range(n):
        q[j] = old_q[j] + length * (new_q[j] - old_q[j])
        w[j] = old_w[j] + length * (new_w[j] - old_w[j])
    for g in range(len(pools.groups)):
        outgoing(pools, g, 0, 0, pools.groups[g].n_point)


@kernel
def trial_parts(pools: Any) -> None:
    """Squared residual of the local stage of a trial over each interface, into ``own_parts``."""
    run, work = pools.run[0], pools.moving
    for e in range(run.n_interface):
        total, size = 0.0, pools.fixed_int[run.segments + 3 * e + 2]
        for side in range(2):
            at = pools.fixed_int[run.segments + 3 * e + side]
            k, metric = (
                pools.fixed[run.k + at : run.k + at + size],
                pools.fixed[run.metric + at : run.metric + at + size],
            )
            q, f_hat = work[run.q + at : run.q + at + size], work[run.local_f + at : run.local_f + at + size]
            w_hat = work[run.local_w + at : run.local_w + at + size]
            for j in range(size):
                rest = f_hat[j] + k[j] * w_hat[j] - q[j]
                total += metric[j] * rest * rest
        work[run.own_parts + e * run.part_width] = total


@kernel
def trial_size(pools: Any) -> float:
    """Residual of the local stage of a trial in the norm of the iteration, from the ``parts`` of all interfaces."""
    exchange_parts(pools)
    add_parts(pools, 0, 1)
    return float(np.sqrt(pools.moving[pools.run[0].totals]))


@kernel
def try_length(pools: Any, length: float) -> None:
    """Both stages at a share of the step; ``trial_parts``."""
    trial_fields(pools, length)
    for g in range(len(pools.groups)):
        n_point = pools.groups[g].n_point
        prepare(pools, g, 0, 0, n_point)
        solve_points(pools, g, 0, n_point)
        finish(pools, g, 0, 1, 0, n_point)
    trial_parts(pools)


@kernel
def search(pools: Any) -> None:
    """Halve the step until the residual falls enough, at most HALVINGS times; the best trial is the iterate. Without
    inertia it is the full step where no trial is better than the start: where the active points are far from those of
    the solution, short steps lead in circles, and a few full ones to it."""
    course = pools.moving[pools.run[0].course : pools.run[0].course + N_COURSE]
    before = course[SIZE]
    best = np.inf
    best_length = 1.0
    length = 1.0
    last = 1.0
    for _ in range(HALVINGS + 1):
        last = length
        try_length(pools, length)
        size = trial_size(pools)
        if size < best:
            best, best_length = size, length
        # as much as a linear residual would fall, but for a share
        if size <= (1.0 - DECREASE * length) * before:
            break
        length *= 0.5
    if best > before and pools.run[0].on_iteration == 1:
        best_length = 1.0
    if last != best_length:  # the fields are those of a worse trial
        try_length(pools, best_length)
    count_step(pools, best)


@kernel
def count_step(pools: Any, size: float) -> None:
    """Count a step with this residual at its end."""
    course = pools.moving[pools.run[0].course : pools.run[0].course + N_COURSE]
    course[MADE] += 1.0
    course[WITHOUT] = course[WITHOUT] + 1.0 if size > (1.0 - LITTLE) * course[SIZE] else 0.0


@kernel
def leave(pools: Any, iteration: int) -> None:
    """Go back to the iterate before the first step, or to a much better one, and to the acceleration, which begins
    anew with this iteration."""
    run, work = pools.run[0], pools.moving
    course = work[run.course : run.course + N_COURSE]
    course[ACTIVE], course[LEFT], course[PHASE] = 0.0, 1.0, float(iteration)
    for j in range(run.n_flat):
        work[run.q + j] = work[run.best_q + j]


@kernel
def continues(pools: Any, iteration: int) -> bool:
    """Whether the next iterate is that of a Newton step, or the best one where the method is left; decided after the
    verdict on this iterate. Acceleration goes on where at its present rate it ends within two iterations. After
    instants that ended at the same active points the step comes first: its factors are at hand (``keep_course``)."""
    run, work = pools.run[0], pools.moving
    course, finish = work[run.course : run.course + N_COURSE], work[run.finish : run.finish + N_FINISH]
    if run.newton == 0 or course[LEFT] == 1.0:
        return False
    if course[ACTIVE] == 1.0:
        if course[MADE] >= STEPS or course[WITHOUT] >= SLOW:
            leave(pools, iteration + 1)
        # either way q is known: the acceleration makes no step
        return True
    count, warm = iteration + 1, finish[0] > 0.0  # the last instant ended with a step
    now, settled = _merit(pools, iteration), finish[2] >= 1.0 and course[MADE] == 0.0
    # factors that serve many instants are worth what the iterations of these have cost
    if settled and (warm or (count >= WARM and finish[3] + count >= EXPECTED * run.newton_price)):
        course[ACTIVE], course[BEGUN] = 1.0, now
        return True
    if count < (WARM if warm else COLD):
        return False
    # at least WARM iterations: there are two before
    past = _merit(pools, iteration - 2)
    if not warm and now <= FAR and count < LATE:
        return False
    # at the rate of the last two iterations two more do: now (now / past) <= 1
    if now * now <= past:
        return False
    if course[DUE] == 1.0:
        course[ACTIVE], course[BEGUN] = 1.0, now
        return True
    cost = price_of_products(pools) if run.krylov == 1 else float(EXPECTED * run.newton_price)
    if run.krylov == 1:  # as many products as there are unknowns, at most: none where all points have opened
        cost = min(cost, activate(pools) * run.newton_price + BESIDE)
    span = min(RECENT, iteration) if run.static == 1 else 2
    past = _merit(pools, iteration - span)
    rest = _left(now, past, span, 1.0)
    if run.static == 1:
        rest = _left(now, past, span, share_to_meet(count + rest))
    if run.krylov == 1 and finish[4] > 0.0:  # what the last instant without steps took is known
        pays = finish[4] - count > cost or count >= max(cost, finish[4])
    else:
        pays = _pays(cost, count, SLOWER * rest if run.krylov == 1 else rest)
    if not pays:
        return False
    course[ACTIVE], course[BEGUN] = 1.0, now
    return True


@kernel
def share_to_meet(count: float) -> float:
    """Share of the tolerances that ends an instant after so many iterations without a Newton step."""
    return CLOSER if count > UNCERTAIN else 1.0


@kernel
def price_of_products(pools: Any) -> float:
    """Cost of the steps by products that end an instant, in iterations: what those of the last one did cost."""
    run = pools.run[0]
    price = pools.moving[run.finish + 5]
    # where the points have settled steps are tried once, whatever they cost: few are needed then
    if price > 0.0 or pools.moving[run.finish] > 0.0:
        return float(price)
    products = SOME if run.tied_super > 0 else MANY
    return float(UNSETTLED * (products * run.newton_price + BESIDE))


@kernel
def _merit(pools: Any, iteration: int) -> float:
    """Distance of an iterate from both tolerances; where that from one is known, from the other in their last ratio."""
    run = pools.run[0]
    at = run.merits + 2 * iteration
    merit = pools.moving[at + 1]
    return float(merit if np.isfinite(merit) else pools.moving[run.measure + 5] * pools.moving[at])


@kernel
def keep_course(pools: Any) -> None:
    """Keep how an accepted instant ended, in ``finish``: number of Newton steps, that of an instant before with a minus
    where none ended this one; sum of its last tangents; instants in a row that ended with the same sum; iterations made
    in them; where steps are made by products the iterations of the last instant without any, and the cost in iterations
    of those of the last instant that followed one with steps, 0: not known. An instant that needed no iteration changes
    nothing.

    While the active points stay the same, a step costs a substitution, and the next instant begins with one. The
    decision follows from the state alone, and not from factors at hand: a run that continues from a state makes it too.
    """
    run, work = pools.run[0], pools.moving
    course, finish = work[run.course : run.course + N_COURSE], work[run.finish : run.finish + N_FINISH]
    if run.newton == 0 or course[LAST] == 0.0:
        return
    # after few iterations no step is in sight; without inertia there are no factors to keep
    compared = run.on_iteration == 0 and (course[MADE] > 0.0 or course[LAST] >= COLD)
    if course[MADE] == 0.0 and compared:
        # the active points of an instant without steps, to be compared with those of the next
        activate(pools)
        course[TANGENTS] = sum_of_tangents(pools)
    if run.shared == 1 and compared:
        call_out(pools, SUM, run.course + TANGENTS, 1, 0)
    retreat = course[LEFT] == 1.0  # the steps did not end it
    same = compared and course[TANGENTS] == finish[1] and run.krylov == 0 and not retreat
    steps, warm = course[MADE] if course[MADE] > 0.0 else abs(finish[0]), finish[0] > 0.0
    finish[0], finish[1] = steps if course[MADE] > 0.0 and not retreat else -steps, course[TANGENTS]
    finish[2] = finish[2] + 1.0 if same else 0.0
    finish[3] = course[LAST] + 1.0 + (finish[3] if same else 0.0)
    if run.krylov == 0:
        return
    if course[MADE] == 0.0:
        finish[4], finish[5] = course[LAST] + 1.0, FADING * finish[5]
    else:
        # not that of the first instant with steps, at which the points find their states
        finish[5] = course[PRODUCTS] * run.newton_price + BESIDE * course[MADE] if warm else 0.0


@kernel
def _pays(cost: float, count: int, rest: float) -> bool:
    """Whether steps that cost so many iterations cost less than those that they save, the ``rest``. Where the
    iterations made have cost as much already, their rate is not relied on: the whole costs at most twice the better of
    both ways."""
    return bool(count >= cost or rest > cost)


@kernel
def _left(now: float, past: float, span: int, target: float) -> float:
    """Iterations to a share ``target`` of the tolerances at the rate of the last ``span``; 0 where they lead away."""
    # no decrease: no rate
    if not now < past:
        return 0.0
    # log10 of the distance over that lost in an iteration
    return float(span * np.log10(max(now / target, 1.0)) / np.log10(past / now))


@kernel
def steps_made(pools: Any, window: int, iteration: int, phase: int) -> int:
    """Steps of the acceleration before this iteration; ``phase``: the one from which on it has its differences."""
    if window > 1:
        return iteration - phase
    return iteration - max(phase, int(pools.moving[pools.run[0].course + PHASE]))


@kernel
def advance_iterate(pools: Any, window: int, iteration: int, phase: int) -> None:
    """Next q after an iterate that has not converged: by the acceleration, or left to a Newton step."""
    if window == 1 and continues(pools, iteration):
        return
    steps = steps_made(pools, window, iteration, phase)
    if pools.run[0].shared == 0:  # else they have been exchanged with the measures (``iteration.measure``)
        difference_parts(pools, window, steps)
    next_iterate(pools, window, steps)
