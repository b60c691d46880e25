"""Marches over many instants: windows of one instant, bodies alone."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel
from .class_row import CLASS
from .groups import GROUP, read_gaps, read_reach
from .iteration import iterate
from .substructure import commit, predict, probe, read_displacement
from .views import floats, integers
from .work import COEFFICIENTS, FLAT, HISTORY, LIMITS, WORK

Array = NDArray[np.float64]

_TYPES: Final = {
    "rows": CLASS, "groups": GROUP, "Flat": FLAT, "Work": WORK, "Limits": LIMITS, "Scheme": COEFFICIENTS,
    "History": HISTORY,
}  # fmt: skip


@entry(
    "rows[::1], groups[::1], Flat, Work, Limits, Scheme, History, f8[::1], f8[:, ::1], i8, i8 -> i8", **_TYPES
)
def march_instants(
    classes: Any, groups: Any, flat: Any, work: Any, limits: Any, scheme: Any, history: Any, gap_start: Array,
    bonds: Array, first: int, n: int,
) -> int:  # fmt: skip
    """Solve up to n windows of one instant from the instant ``first``; how many converged before one that did not.

    ``work.f_hat``, ``work.w_hat`` hold the last accepted fields on entry and on return. ``bonds`` (n_flat, n_flat)
    gives q from the velocities without traction where all interfaces are perfect (``latin.bonded``); else (0, 0).
    """
    every = np.arange(len(classes))
    for step in range(n):
        instant = first + step
        predict_some(classes, scheme, instant, every)
        if solve_instant(classes, groups, flat, work, limits, scheme, history, bonds, step, instant) == 0:
            return step
        work.marched[0] += commit_some(classes, scheme, instant, work, every)
        close_instant(groups, flat, work, scheme, history, gap_start, instant)
    return n


@entry("rows[::1], Scheme, i8, i8[::1]", **_TYPES)
def predict_some(classes: Any, scheme: Any, instant: int, which: Any) -> None:
    """Free response of some classes; each writes into its own row only."""
    for c in which:
        predict(classes[c], scheme, instant)


@entry("rows[::1], groups[::1], Flat, Work, Limits, Scheme, History, f8[:, ::1], i8, i8 -> i8", **_TYPES)
def solve_instant(
    classes: Any, groups: Any, flat: Any, work: Any, limits: Any, scheme: Any, history: Any, bonds: Array, step: int,
    instant: int,
) -> int:  # fmt: skip
    """Iterate over the instant whose free responses are known; 1 where it converged (without interfaces: at once)."""
    if len(work.q) == 0:
        history.errors[step, 0], history.mismatches[step, 0], history.iterations[step] = 0.0, 0.0, 1
        return 1
    if len(bonds):
        free_motion(classes, flat, work.w, instant)
        np.dot(bonds, work.w, work.q)
    else:
        first_guess(classes, flat, work, instant)
    errors, mismatches, solved = history.errors[step], history.mismatches[step], work.marched[1]
    used = iterate(classes, groups, flat, work, limits, scheme, instant, errors, mismatches)
    history.iterations[step] = used
    if used <= 0:
        work.marched[1] = solved  # the long road counts its own
        if instant > 0:
            work.f_hat[:] = history.f_hat[instant - 1]
            work.w_hat[:] = history.w_hat[instant - 1]
        return 0
    return 1


@entry("rows[::1], Scheme, i8, Work, i8[::1] -> i8", **_TYPES)
def commit_some(classes: Any, scheme: Any, instant: int, work: Any, which: Any) -> int:
    """End the instant of some classes with the tractions of ``work``; substructures marched. Each class writes into its
    own row and at its own channels only."""
    marched = 0
    for c in which:
        marched += commit(classes[c], scheme, instant, work.f_hat)
        probe(classes[c], instant)
        read_displacement(classes[c], instant, scheme.gap_lead, 0.0, True, work.displacement)
        if len(work.layer) > 0:
            read_displacement(
                classes[c], instant, scheme.gap_lead + scheme.layer_v, scheme.layer_a, False, work.layer
            )
    return marched


@entry("groups[::1], Flat, Work, Scheme, History, f8[::1], i8", **_TYPES)
def close_instant(
    groups: Any, flat: Any, work: Any, scheme: Any, history: Any, gap_start: Array, instant: int
) -> None:
    """Keep the instant and bring gaps and indicators up to date."""
    for g in range(len(flat.ground)):
        work.displacement[flat.ground[g]] = flat.ground_displacement[instant, g]
    read_gaps(groups, gap_start, work.displacement, instant)
    if len(work.layer) > 0:
        for g in range(len(flat.ground)):
            work.layer[flat.ground[g]] = flat.ground_layer[instant, g]
        read_reach(groups, gap_start, work.layer, scheme.layer_rate)
    history.f_hat[instant] = work.f_hat
    history.w_hat[instant] = work.w_hat
    accept(flat, work)


@kernel
def first_guess(classes: Any, flat: Any, work: Any, instant: int) -> None:
    """q of the last fields; where nothing touched, of the free motion: the answer as long as nothing does."""
    touched = False
    for j in range(len(work.q)):
        work.q[j] = work.f_hat[j] + flat.k[j] * work.w_hat[j]
        touched = touched or work.f_hat[j] != 0.0
    if touched:
        return
    free_motion(classes, flat, work.w, instant)
    for j in range(len(work.q)):
        work.q[j] = flat.k[j] * work.w[j]


@kernel
def free_motion(classes: Any, flat: Any, w: Array, instant: int) -> None:
    """Velocities of the channels without traction, (n_flat,)."""
    for c in range(len(classes)):
        row = classes[c]
        size = row.n_channel * row.m
        channels, w_free = integers(row.channels, size), floats(row.w_free, size)
        for at in range(size):
            w[channels[at]] = w_free[at]
    for g in range(len(flat.ground)):
        w[flat.ground[g]] = flat.ground_velocity[instant, g]


@kernel
def accept(flat: Any, work: Any) -> None:
    """Bring the largest indicator of each interface up to date."""
    share = work.shares
    share[:] = 0.0
    for j in range(len(work.q)):
        share[flat.interface[j]] += flat.weights[0, j] * work.residual[j] * work.residual[j]
    for i in range(len(share)):
        work.interface_indicator[i] = max(work.interface_indicator[i], np.sqrt(share[i] / work.scales[0]))


@entry("rows[::1], Scheme, i8, i8", **_TYPES)
def march_alone(classes: Any, scheme: Any, first: int, n: int) -> None:
    """March substructures without interfaces."""
    nothing = np.zeros(1)
    for step in range(n):
        for c in range(len(classes)):
            predict(classes[c], scheme, first + step)
            commit(classes[c], scheme, first + step, nothing)
