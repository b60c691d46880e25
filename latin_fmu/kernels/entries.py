"""The entry through which Python runs the kernels of a run: ``call(pools, action, a, b, c, d)``.

Every action is a function of the modules beside this one. They share one entry, so that the code which they have in
common is compiled once.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, fields, share
from .acceleration import difference_parts, shorten, weighted_products
from .communication import communicate, place, present
from .derivatives import derive
from .indicator import class_norms, error_indicator, relative_forces, residual_parts, set_error
from .instants import (
    accept,
    begin_at,
    correct,
    end_at,
    end_instant,
    first_guess,
    free_motion,
    leave_window,
    march_instants,
    open_accounts,
    read_start,
)
from .iteration import force_norms, force_residual, iterate, judge, measure, next_stage
from .linear_stage import balance, linear_stage
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
from .substructure import predict
from .tangent_march import march_tangents
from .tasks import end_class, serve

START, MARCH, BEGIN, ITERATE, CORRECT, LEAVE, END, FORCES, SERVE = range(9)
"""Actions of ``call`` on a run: begin at t = 0; march windows of one instant; of a window on its own the start, its
iterations, their correction by the exact motion, their end, the march over an instant; size of the forces; a thread."""
PRESENT, PLACE, COMMUNICATE, FIELDS, DERIVE = range(9, 14)
TANGENT = 14
"""Actions on communication steps (``communication``): outputs at the present instant; time steps of a step; make them;
fields at the points; derivatives of the outputs. March of derivatives by
parameters (``tangent_march``)."""

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
    if action == COMMUNICATE:
        return communicate(pools, a, b, c, d)
    if action == PRESENT:
        return present(pools, a, b)
    if action == PLACE:
        return place(pools)
    if action == DERIVE:
        return derive(pools, a, b, c, d)
    if action == TANGENT:
        return march_tangents(pools, a, b)
    if action == START:
        if a == 1:
            open_accounts(pools)
        read_start(pools)
    elif action == BEGIN:
        begin_at(pools, a, b, c)
    elif action == LEAVE:
        leave_window(pools, a)
    elif action == END:
        end_at(pools, a, b, c)
    elif action == FORCES:
        force_residual(pools, a)
    elif action == FIELDS:
        gather_fields(pools, a)
    elif action == SERVE:
        serve(pools, a)
    return 0
