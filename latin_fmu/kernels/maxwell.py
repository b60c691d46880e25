"""Maxwell branches of a class (``time_scheme.maxwell``) in the march, and their part of the account of energies.

The internal forces of an instant are K y of the displacements

    y = u + sum_j g_j e_j,      e_new = c_e e + c_u (u_new - u),

so that one product with K serves the body and its branches. K e_j follows the same recursion as e_j: the account takes
no product for it but that with K u, which it needs anyway. Where a part K_0 of K has no branches, as some bodies of a
class of several have none (``UNRELAXED``), K_0 sum_j g_j e_j is taken off again, and K_0 (u_new - u) in the account.

In the middle of an EXPLICIT step y is u_mid + sum_j g_j e_mid, with the weights of half a step. The work on branch j is

    Du.g K e_mid = D(g e.K e / 2) + g (h / 2) [(e + e_mid).K (e + e_mid) + (e_mid + e_new).K (e_mid + e_new)]
                   + (g / 2) [(u_mid - u).K (e_mid - e) - (u_new - u_mid).K (e_new - e_mid)],

the last row being the part of the scheme.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .energy_parts import DAMPED, ELASTIC, N_TERM, OF_SCHEME, WORK_OF_LOADS, add_dot, copied, whole_product
from .records import EXPLICIT, HALF_RATIO, OF_ELONGATION, OF_MOTION, STRENGTH
from .splits import STIFFNESS, UNRELAXED, add_product

Array = NDArray[np.float64]


@kernel
def weight(pools: Any, c: int, what: int, j: int) -> float:
    """g, c_e, c_u or h of branch j of a class."""
    row = pools.classes[c]
    return float(pools.fixed[row.branches + what * row.n_branch + j])


# -- in the march -----------------------------------------------------------------------------------------------------
@kernel
def add_strains(pools: Any, c: int, new: float, old: float, out: Array) -> None:
    """Add ``new`` times sum_j g_j e_j at the free displacements of the new instant and ``old`` times that of the old
    one to displacements (n m,)."""
    row, state = pools.classes[c], pools.moving
    size = row.n * row.m
    u, u_free = state[row.u : row.u + size], state[row.u_free : row.u_free + size]
    of_motion = 0.0
    for j in range(row.n_branch):
        strength = weight(pools, c, STRENGTH, j)
        factor = strength * (new * weight(pools, c, OF_ELONGATION, j) + old)
        of_motion += strength * new * weight(pools, c, OF_MOTION, j)
        at = row.elongation + j * size
        elongation = state[at : at + size]
        for i in range(size):
            out[i] += factor * elongation[i]
    for i in range(size):
        out[i] += of_motion * (u_free[i] - u[i])


@kernel
def subtract_strained(pools: Any, c: int, new: float, old: float, moved: Array, load: Array) -> None:
    """Subtract K y from a load (n m,); ``moved`` : the displacements without the branches, which are overwritten; the
    others as for ``add_strains``."""
    add_strains(pools, c, new, old, moved)
    add_product(pools, c, STIFFNESS, -1.0, moved, load)
    if pools.classes[c].unrelaxed_rows > 0:
        moved[:] = 0.0
        add_strains(pools, c, new, old, moved)
        add_product(pools, c, UNRELAXED, 1.0, moved, load)


@kernel
def leave_instant(pools: Any, c: int) -> None:
    """Elongations of the next instant but for its displacements (``reach_instant``), before these are known."""
    row, state = pools.classes[c], pools.moving
    size = row.n * row.m
    u, u_free = state[row.u : row.u + size], state[row.u_free : row.u_free + size]
    for j in range(row.n_branch):
        c_e, c_u = weight(pools, c, OF_ELONGATION, j), weight(pools, c, OF_MOTION, j)
        at = row.elongation + j * size
        elongation = state[at : at + size]
        if row.kind == EXPLICIT:
            # both halves of the step: u_free is the place in its middle
            for i in range(size):
                middle = c_e * elongation[i] + c_u * (u_free[i] - u[i])
                elongation[i] = c_e * middle - c_u * u_free[i]
        else:
            for i in range(size):
                elongation[i] = c_e * elongation[i] - c_u * u[i]


@kernel
def reach_instant(pools: Any, c: int) -> None:
    """Elongations of the instant, whose displacements are known now."""
    row, state = pools.classes[c], pools.moving
    size = row.n * row.m
    u = state[row.u : row.u + size]
    for j in range(row.n_branch):
        moved, at = weight(pools, c, OF_MOTION, j), row.elongation + j * size
        elongation = state[at : at + size]
        for i in range(size):
            elongation[i] += moved * u[i]


# -- in the account of energies ---------------------------------------------------------------------------------------
@kernel
def whole_elongation(pools: Any, c: int, j: int, instant: int, out: Array) -> None:
    """Elongation of branch j of dofs and motions (n + n_motion, m)."""
    row = pools.classes[c]
    run = pools.run[0]
    moving = pools.moving
    size, count = row.n * row.m, row.n_motion * row.m
    copied(moving[row.elongation + j * size : row.elongation + (j + 1) * size], out[:size])
    at = row.motions + ((3 + j) * run.n_time + instant) * count
    copied(moving[at : at + count], out[size : size + count])


@kernel
def open_branches(pools: Any, c: int, instant: int, force: Array, scratch: Array) -> None:
    """Begin the account of the branches: elongations, K times these, energies; ``force`` K u becomes K y; ``scratch``
    (n + n_motion, m)."""
    row, moving = pools.classes[c], pools.moving
    m, wide = row.m, (row.n + row.n_motion) * row.m
    elastic = moving[row.totals + ELASTIC * m : row.totals + (ELASTIC + 1) * m]
    for j in range(row.n_branch):
        elongation, strained = fields_of(pools, c, j, wide)
        whole_elongation(pools, c, j, instant, elongation)
        whole_product(pools, c, STIFFNESS, elongation, strained)
        if row.unrelaxed_rows > 0:
            whole_product(pools, c, UNRELAXED, elongation, scratch)
            for i in range(wide):
                strained[i] -= scratch[i]
        strength = weight(pools, c, STRENGTH, j)
        add_dot(m, 0.5 * strength, elongation, strained, elastic)
        for i in range(wide):
            force[i] += strength * strained[i]


@kernel
def fields_of(pools: Any, c: int, j: int, wide: int) -> tuple[Array, Array]:
    """e_j and K e_j of the last instant on dofs and motions."""
    row, moving = pools.classes[c], pools.moving
    elongation: Array = moving[row.past_elongation + j * wide : row.past_elongation + (j + 1) * wide]
    strained: Array = moving[row.branch_force + j * wide : row.branch_force + (j + 1) * wide]
    return elongation, strained


@kernel
def account_branches(pools: Any, c: int, instant: int, step: Array, force: Array, old: Array, scratch: Array) -> None:
    """Energies of the branches over a ``step`` u_new - u of a DIRECT class; ``force`` K u becomes K y, ``old`` is K y
    of the instant before; ``scratch`` (2, n + n_motion, m)."""
    row, moving = pools.classes[c], pools.moving
    m, wide = row.m, (row.n + row.n_motion) * row.m
    totals = moving[row.totals : row.totals + N_TERM * m]
    change, new = scratch[:wide], scratch[wide : 2 * wide]
    # K (u_new - u): K y of the instant before has the branches in it
    for i in range(wide):
        change[i] = force[i] - old[i]
    for j in range(row.n_branch):
        strength, strained = weight(pools, c, STRENGTH, j), fields_of(pools, c, j, wide)[1]
        for i in range(wide):
            change[i] += strength * strained[i]
    if row.unrelaxed_rows > 0:
        whole_product(pools, c, UNRELAXED, step, new)
        for i in range(wide):
            change[i] -= new[i]
    for j in range(row.n_branch):
        strength = weight(pools, c, STRENGTH, j)
        c_e = weight(pools, c, OF_ELONGATION, j)
        c_u = weight(pools, c, OF_MOTION, j)
        elongation, strained = fields_of(pools, c, j, wide)
        whole_elongation(pools, c, j, instant, new)
        # the sums of both instants first: the loss is a product of them
        for i in range(wide):
            elongation[i] += new[i]
            before = strained[i]
            strained[i] = c_e * before + c_u * change[i]
            new[i] = before + strained[i]
        lost = 0.5 * strength * weight(pools, c, HALF_RATIO, j)
        add_dot(m, lost, elongation, new, totals[DAMPED * m : (DAMPED + 1) * m])
        whole_elongation(pools, c, j, instant, elongation)
        add_dot(m, 0.5 * strength, elongation, strained, totals[ELASTIC * m : (ELASTIC + 1) * m])
        for i in range(wide):
            force[i] += strength * strained[i]


@kernel
def account_explicit_branches(
    pools: Any, c: int, instant: int, first: Array, of_first: Array, step: Array, of_step: Array
) -> None:
    """Energies of the branches over a step of an EXPLICIT class (module docstring).

    first, of_first : u_mid - u and K times it; step, of_step : u_new - u likewise; all (n + n_motion, m).
    """
    row, moving = pools.classes[c], pools.moving
    m = row.m
    wide = (row.n + row.n_motion) * row.m
    size = row.n * row.m
    totals = moving[row.totals : row.totals + N_TERM * m]
    damped, of_scheme = totals[DAMPED * m : (DAMPED + 1) * m], totals[OF_SCHEME * m : (OF_SCHEME + 1) * m]
    of_loads = totals[WORK_OF_LOADS * m : (WORK_OF_LOADS + 1) * m]
    for j in range(row.n_branch):
        strength = weight(pools, c, STRENGTH, j)
        c_e = weight(pools, c, OF_ELONGATION, j)
        c_u = weight(pools, c, OF_MOTION, j)
        lost = 0.5 * strength * weight(pools, c, HALF_RATIO, j)
        elongation, strained = fields_of(pools, c, j, wide)
        for member in range(m):
            loss = 0.0
            scheme = 0.0
            reaction = 0.0
            stored = 0.0
            for i in range(member, wide, m):
                last = step[i] - first[i]
                of_last = of_step[i] - of_first[i]
                e, k_e = elongation[i], strained[i]
                middle, k_middle = c_e * e + c_u * first[i], c_e * k_e + c_u * of_first[i]
                new, k_new = c_e * middle + c_u * last, c_e * k_middle + c_u * of_last
                loss += (e + middle) * (k_e + k_middle) + (middle + new) * (k_middle + k_new)
                scheme += first[i] * (k_middle - k_e) - last * (k_new - k_middle)
                stored += new * k_new
                if i >= size:
                    reaction += step[i] * k_middle
                elongation[i], strained[i] = new, k_new
            damped[member] += lost * loss
            of_scheme[member] += 0.5 * strength * scheme
            of_loads[member] += strength * reaction
            totals[ELASTIC * m + member] += 0.5 * strength * stored
    if row.n_branch > 0:
        _take_elongations(pools, c, instant, wide)


@kernel
def _take_elongations(pools: Any, c: int, instant: int, wide: int) -> None:
    """Elongations of the march in the place of those of the account, from which round-off parts them."""
    for j in range(pools.classes[c].n_branch):
        whole_elongation(pools, c, j, instant, fields_of(pools, c, j, wide)[0])
