"""March of the derivatives of a run by parameters: the equations of each instant about their solution.

A parameter p enters loads, initial values, gaps, laws and matrices. The derivative of an instant obeys the equations of
the instant with the derivatives of its data, and at every point of the interfaces, with J = dF_hat/djump of the law at
the solution (``laws.dispatch.tangent``),

    F_hat' = J (jump' + m reach') + dF_hat/dp,        m = 1 where the traction follows the gap, else 0.

Its substructures are copies of those of the run, one set for each parameter, as further members of their classes: one
substitution serves all. Between the copies nothing is coupled, and all have the tangents of the run: the matrix of the
active points is made and factorised once. The caller writes J, m and dF_hat/dp of the instants of a call into the rows
of ``slopes``, ``follows`` and ``sources``. The system is linear: a Newton step (``newton``) solves it, and is repeated
until the residual is round-off. Copies of a reduced assembly, whose matrices the kernels have in patches, are solved by
the caller (``by_caller``).

Where a parameter enters matrices, the motion of the run is needed: it is marched with the tractions known as
``sources`` (``given``), its motion kept in ``course``, and the forces that the caller makes of it drive the derivatives
(``forced``).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import kernel
from .active_points import activate, add_relative, assemble, is_factored, soften, solve_active
from .callouts import DERIVATIVES, call_out, has_failed
from .instants import end_instant, first_guess
from .krylov import add_columns, admit, length_of
from .linear_stage import linear_stage
from .local_stage import finish, open_window, outgoing, prepare
from .newton import SIZE, admit_residual, full_step, propose
from .tasks import END, PREDICT, each_class

_MOST = 40
_ENOUGH = 1e-13
_ALLOWED = 1e-9
_BY_PRODUCTS = 1e-5
"""Steps of an instant; residual over the incoming quantity that ends them; the largest one of a solution, and without
matrix: products reduce it no further where bonded faces have more points than the coarser mesh can follow, so that
tractions are not unique (1.5e-6 at the thread of a screw; derivatives of forces and motions agree with runs)."""


@kernel
def march_tangents(pools: Any, first: int, n: int) -> int:
    """March n instants from ``first`` on; how many have a solution before one that has none, or no unique one."""
    for call in range(n):
        instant = first + call
        if pools.run[0].forced == 1:
            _take_forces(pools, instant)
        each_class(pools, PREDICT, instant, 0)
        open_window(pools, 1, instant - 1)
        if pools.run[0].n_flat > 0 and not _solve(pools, instant):
            return call
        each_class(pools, END, instant, 0)
        end_instant(pools, instant, 0)
        if pools.run[0].given == 1:
            _keep_course(pools, instant)
    return n


@kernel
def _take_forces(pools: Any, instant: int) -> None:
    """Constant forces of the classes at an instant."""
    moving, line = pools.moving, instant - pools.run[0].first_row
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n * row.m
        for i in range(size):
            moving[row.constant + i] = moving[row.forces + line * size + i]


@kernel
def _keep_course(pools: Any, instant: int) -> None:
    """Keep the motion of the classes at the end of an instant."""
    moving, line = pools.moving, instant - pools.run[0].first_row
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        size = row.n * row.m
        to = row.course + line * 3 * size
        for i in range(size):
            moving[to + i] = moving[row.u + i]
            moving[to + size + i] = moving[row.v + i]
            moving[to + 2 * size + i] = moving[row.a + i]


@kernel
def _solve(pools: Any, instant: int) -> bool:
    """Solve one instant; whether the residual is that of a solution."""
    run, work = pools.run[0], pools.moving
    n, row = run.n_flat, instant - run.first_row
    for g in range(len(pools.groups)):
        group = pools.groups[g]
        size = 9 * group.n_point
        for j in range(size):
            work[group.tangent + j] = work[group.slopes + row * size + j]
    work[run.course + SIZE] = 0.0
    first_guess(pools, instant)
    q, last = work[run.q : run.q + n], np.inf
    linear_stage(pools, 1, instant, 0)
    size = _residual(pools, row)
    # the motion with inertia takes the tractions alone, which are the sources
    if run.given == 1 and run.static == 0:
        return True
    if run.by_caller == 1:
        call_out(pools, DERIVATIVES, row, 0, 0)
        return not has_failed(pools) and _residual(pools, row) <= _ALLOWED * length_of(q)
    for _ in range(_MOST):
        if size <= _ENOUGH * length_of(q) or not size < 0.5 * last:
            break
        last = size
        if run.on_iteration == 1 or run.krylov == 1:
            if not propose(pools):
                return False
            linear_stage(pools, 1, instant, 0)
        else:
            if not _step(pools):
                return False
            # the linear stage of its q
            for j in range(n):
                work[run.w + j] += work[run.step_w + j]
        size = _residual(pools, row)
    allowed = _BY_PRODUCTS if run.on_iteration == 1 else _ALLOWED
    return bool(size <= allowed * length_of(q))


@kernel
def _step(pools: Any) -> bool:
    """q of the full step, copy after copy with the factors of the first; False where the matrix is singular."""
    run, work = pools.run[0], pools.moving
    x, v = work[run.step_f : run.step_f + run.n_flat], work[run.step_w : run.step_w + run.n_flat]
    admit_residual(pools)
    solved = True
    for copy in range(run.linear):
        count = activate(pools)
        add_relative(pools, v)
        if count > 0 and solved:
            if not is_factored(pools, count):
                assemble(pools)
                soften(pools)
            solved = solve_active(pools)
            add_columns(pools, work[run.unknowns : run.unknowns + count], x)
        # points of the next copy, after the last one those of the first
        for p in range(run.n_place):
            n = pools.groups[pools.fixed_int[run.point_group + p]].n_point // run.linear
            pools.fixed_int[run.point_number + p] += n if copy < run.linear - 1 else (1 - run.linear) * n
    admit(pools, x, v)
    full_step(pools)
    return solved


@kernel
def _residual(pools: Any, row: int) -> float:
    """Fields of the local stage for q and W of ``work``; length of the residual ``r`` of both stages."""
    run, work = pools.run[0], pools.moving
    for g in range(len(pools.groups)):
        n_point = pools.groups[g].n_point
        outgoing(pools, g, 0, 0, n_point)
        prepare(pools, g, 0, 0, n_point)
        _apply(pools, g, row)
        finish(pools, g, 0, 1, 0, n_point)
    for j in range(run.n_flat):
        work[run.r + j] = work[run.local_f + j] + pools.fixed[run.k + j] * work[run.local_w + j] - work[run.q + j]
    return length_of(work[run.r : run.r + run.n_flat])


@kernel
def _apply(pools: Any, g: int, row: int) -> None:
    """Tractions of the points of a group by their slopes."""
    work, group = pools.moving, pools.groups[g]
    h = group.n_component
    width = h if group.elastic == 1 else 1
    sources = group.sources + row * group.n_point * h
    follows = group.follows + row * group.n_point * width
    for p in range(group.n_point):
        for a in range(h):
            total = work[sources + p * h + a]
            for b in range(h):
                change = work[group.jump + p * h + b]
                # one gap a point opens along N, component 0
                if b < width:
                    change += work[follows + p * width + b] * work[group.reach + p * width + b]
                total += work[group.tangent + 9 * p + 3 * a + b] * change
            work[group.traction + p * h + a] = total
