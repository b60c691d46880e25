"""The entry through which Python runs the kernels of a run: ``call(pools, action, a, b, c, d)``.

Every action is a function of the modules beside this one. They share one entry, so that the code which they have in
common is compiled once.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, fields, kernel, share
from .acceleration import difference_parts, shorten, weighted_products
from .communication import communicate, conclude, follow, place, present
from .indicator import accept, class_norms, error_indicator, relative_forces, residual_parts, set_error
from .instants import (
    correct,
    end_instant,
    end_window_instant,
    first_guess,
    free_motion,
    march_instants,
    open_accounts,
    read_start,
)
from .iteration import (
    balance,
    begin_window,
    force_norms,
    force_residual,
    iterate,
    judge,
    linear_stage,
    measure,
    next_stage,
    rewind,
)
from .local_stage import (
    finish,
    open_window,
    outgoing,
    points_stage,
    prepare,
    read_gaps,
    read_jumps,
    read_motion,
    solve_points,
)
from .newton import (
    active_matrix,
    admit_residual,
    advance_iterate,
    change_tractions,
    full_step,
    propose,
    trial_parts,
    try_length,
)
from .outputs import gather_fields
from .records import CLASS, GROUP, RUN
from .substructure import linear_response, predict
from .sums import exchange
from .tasks import end_class, serve

(
    MARCH,
    ITERATE,
    CORRECT,
    PREDICT,
    END_CLASS,
    END_INSTANT,
    FIRST_GUESS,
    FREE_MOTION,
    LINEAR_STAGE,
    OUTGOING,
    PREPARE,
    POINTS,
    FINISH,
    MEASURE,
    JUDGE,
    NEXT,
    OPEN,
    BEGIN,
    REWIND,
    END_WINDOW,
    ACCEPT,
    READ_START,
    OPEN_ACCOUNTS,
    RESPOND,
    FORCES,
    COMMUNICATE,
    PRESENT,
    FIELDS,
    SERVE,
    FOLLOW,
    PLACE,
    CONCLUDE,
) = range(32)
"""Actions of ``call``."""

Array = NDArray[np.float64]


class Pools(NamedTuple):
    """Records and the two blocks of memory as kernels take them; names with an ending are views of the same block."""

    run: NDArray[Any]  # (1,) of RUN
    classes: NDArray[Any]  # (n_class,) of CLASS
    groups: NDArray[Any]  # (n_group,) of GROUP
    fixed: Array  # constants and direction
    fixed_int: NDArray[np.int64]
    fixed_col: NDArray[np.uint32]
    fixed_single: NDArray[np.float32]
    moving: Array  # histories, state, work, output
    moving_int: NDArray[np.int64]


_ITEM: Final = "f8[::1], i8[::1]"
POOLS: Final = fields(
    Pools,
    f"run[::1], classes[::1], groups[::1], {_ITEM}, u4[::1], f4[::1], {_ITEM}",
    run=RUN,
    classes=CLASS,
    groups=GROUP,
)


# these run from inside ``march_instants`` and by actions of their own
share(
    predict,
    first_guess,
    free_motion,
    next_stage,
    linear_stage,
    balance,
    outgoing,
    prepare,
    solve_points,
    finish,
    measure,
    judge,
    difference_parts,
    weighted_products,
    shorten,
    advance_iterate,
    propose,
    open_window,
    accept,
    end_class,
    end_instant,
    march_instants,
    open_accounts,
    read_start,
    points_stage,
    error_indicator,
    residual_parts,
    set_error,
    class_norms,
    force_norms,
    relative_forces,
    read_gaps,
    read_motion,
    read_jumps,
    admit_residual,
    active_matrix,
    change_tractions,
    full_step,
    trial_parts,
    try_length,
)


@entry("pools, i8, i8, i8, i8, i8 -> i8", pools=POOLS)
def call(pools: Any, action: int, a: int, b: int, c: int, d: int) -> int:
    """Do an action with its arguments; its result, 0 where it has none."""
    run = pools.run[0]
    if action == MARCH:
        return march_instants(pools, a, b)
    if action == ITERATE:
        # ``begin`` in the count of the first instant, ``limit`` in the record: there are four arguments
        return iterate(pools, a, b, 0, pools.moving_int[run.iterations], c, d, run.limit)
    if action == CORRECT:
        return correct(pools, a, 0)
    if action == JUDGE:
        return judge(pools, a, b, c, d == 1)
    if action == COMMUNICATE:
        return communicate(pools, a, b, c, d)
    if action == PRESENT:
        return present(pools, a, b)
    if action == PLACE:
        return place(pools)
    if action == END_INSTANT:
        end_instant(pools, a, b)
    elif action == FIRST_GUESS:
        first_guess(pools, a)
    elif action == FREE_MOTION:
        free_motion(pools, a, pools.moving[run.w : run.w + run.n_flat])
        exchange(pools, run.w, run.n_flat, 1)
    elif LINEAR_STAGE <= action <= MEASURE:
        _part_of_stage(pools, action, a, b, c)
    elif action == NEXT:
        advance_iterate(pools, a, b, c)
    elif action == OPEN:
        open_window(pools, a, b)
    elif action == BEGIN:
        begin_window(pools)
    elif action == REWIND:
        rewind(pools)
    elif action == END_WINDOW:
        end_window_instant(pools, a, b)
    elif action == ACCEPT:
        accept(pools, a)
    elif action == READ_START:
        read_start(pools)
    elif action == OPEN_ACCOUNTS:
        open_accounts(pools)
    elif action == FORCES:
        force_residual(pools, a)
    elif action == FOLLOW:
        follow(pools, a, b, c)
    elif action == CONCLUDE:
        conclude(pools, a, b, c, d)
    elif action == FIELDS:
        gather_fields(pools, a)
    elif action == SERVE:
        serve(pools, a)
    elif action == PREDICT:
        predict(pools, a, b)
    elif action == END_CLASS:
        end_class(pools, a, b)
    elif action == RESPOND:
        q, w = run.q + b * run.n_flat, run.w + b * run.n_flat
        linear_response(pools, a, pools.moving[q : q + run.n_flat], pools.moving[w : w + run.n_flat])
    return 0


@kernel
def _part_of_stage(pools: Any, action: int, a: int, b: int, c: int) -> None:
    """Parts of an iteration: of the window, of an instant, of the group ``a`` at an instant."""
    if action == LINEAR_STAGE:
        linear_stage(pools, a, b, c)
    elif action == OUTGOING:
        for g in range(len(pools.groups)):
            outgoing(pools, g, a, 0, pools.groups[g].n_point)
    elif action == PREPARE:
        prepare(pools, a, b, 0, pools.groups[a].n_point)
    elif action == POINTS:
        solve_points(pools, a, 0, pools.groups[a].n_point)
    elif action == FINISH:
        finish(pools, a, b, c, 0, pools.groups[a].n_point)
    elif action == MEASURE:
        measure(pools, a, 0)
