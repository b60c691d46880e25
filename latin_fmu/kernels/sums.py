"""Sums over the interfaces of an assembly, and what the processes of a run exchange.

A sum over the assembly is one over each interface first, into a row of ``own_parts``, then over the interfaces in the
order of the scene. In one process ``own_parts`` and ``parts`` are one array. Of several, each has the rows of the
interfaces that it owns, and receives those of all. The sums are the same to the last bit for any number of processes:
the acceleration enlarges round-off by the inverse of pivots down to 1e-12 (``acceleration.RANK``).

A process (``latin.processes``) computes the linear stage of its substructures and the local stage of the interfaces
that touch them, an interface between two processes on both. What the other side of such an interface needs goes through
``outbox`` and ``inbox``: the values at the channels of one process that the other takes, neighbour after neighbour. The
caller sends them (``callouts``).
"""

from __future__ import annotations

from typing import Any, Final

from ..compiled import kernel, ordered_kernel
from .callouts import MESSAGES, PARTS_OF_ALL, call_out

MEASURES: Final = 6
"""Numbers of a row of ``parts`` that measures take; those of the acceleration stand behind them."""

RUN_FIELDS: Final[tuple[tuple[str, str], ...]] = (
    ("n_part", "interfaces of all processes"),
    ("part_width", "numbers of a row of ``parts``"),
    ("segments", "constants, int64 (n_interface, 3): first channels of both sides of an interface, channels of a side"),
    ("sides", "constants, int64 (n_interface,): sides that iterate, 1 where E' is ground, with inertia"),
    ("part_order", "constants, int64 (n_part,): rows of the interfaces in ``parts``, in the order of the scene"),
    ("parts", "work (n_part, part_width): sums over each interface, those of all processes"),
    ("own_parts", "work (n_interface, part_width) if shared else parts: those here"),
    ("totals", "work (part_width,): their sums over the interfaces"),
    ("n_coarse_here", "those of the interfaces of this process"),
    ("n_coarse_own", "sums of forces that the substructures of this process have; all: 2 n_coarse"),
    ("coarse_order", "direction, int64 (2, n_coarse): places of the sums of both sides in ``coarse_parts``"),
    ("coarse", "work (n_coarse + n_coarse_here,)"),
    ("coarse_parts", "work (2 * n_coarse,): sums of the sides, those of all processes"),
    ("coarse_own", "work (n_coarse_own,) if shared else coarse_parts: those here"),
    ("callout", "address of the function of the caller (``callouts``), 0 for none"),
    ("failed", "work (1,): 1 where it has failed"),
    ("shared", "1 where other processes hold substructures: the caller exchanges what they compute (``callouts``)"),
    ("n_owned", "interfaces of this process that it owns, the first ones"),
    ("n_process", "processes"),
    ("n_neighbour", "processes that hold the other side of an interface"),
    ("n_norm", "classes of all processes, each with the members that one holds, plus ``n_process``"),
    ("n_send", "channels that other processes take"),
    ("n_take", "channels taken from them"),
    ("send_starts", "constants, int64 (n_neighbour + 1,): first of the channels that each neighbour takes"),
    ("send_places", "constants, int64: these channels"),
    ("take_starts", "constants, int64 (n_neighbour + 1,): first of the channels taken from each neighbour"),
    ("take_places", "constants, int64: these channels"),
    ("norm_order", "constants, int64 (n_norm,): rows of ``all_norms``, those of classes in their order, then flags"),
    ("touched", "state (1,) if shared: 1 where a traction acts on any interface"),
    ("outbox", "work (max(w, 2 + layers), n_send) if shared: messages, of two fields at least"),
    ("inbox", "work (max(w, 2 + layers), n_take) if shared: likewise"),
    ("own_norms", "work (classes + 1, w, 4) if shared: norms of the classes here, and 1 where a traction acts"),
    ("all_norms", "work (n_norm, w, 4) if shared: those of all processes"),
    ("acting", "work (1,) if shared: 1 where a traction of the last iterate acts"),
    ("n_place", "points of the interfaces of all processes, where Newton steps may end an instant"),
    ("point_owned", "constants, int64 (n_place,): 1 where this process counts the point"),
    ("elsewhere", "work, int64 (n_place,) if shared: unknowns of the points held elsewhere"),
)
"""Fields of the record of the run, see ``records``."""


@ordered_kernel
def add_parts(pools: Any, first: int, n: int) -> None:
    """``totals`` of n columns of ``parts`` from ``first`` on: sums over the interfaces of all processes in their order
    in the scene, so that they are the same for any number of processes."""
    run, work = pools.run[0], pools.moving
    for column in range(first, first + n):
        total = 0.0
        for e in range(run.n_part):
            total += work[run.parts + pools.fixed_int[run.part_order + e] * run.part_width + column]
        work[run.totals + column] = total


@kernel
def exchange_parts(pools: Any) -> None:
    """``parts`` of all processes from the ``own_parts`` of each."""
    if pools.run[0].shared == 1:
        call_out(pools, PARTS_OF_ALL, 0, 0, 0)


@kernel
def exchange(pools: Any, at: int, stride: int, n: int) -> None:
    """Replace n fields, ``stride`` numbers apart from ``at`` on, at the channels of other processes by theirs."""
    run, moving = pools.run[0], pools.moving
    if run.shared == 0:
        return
    # neighbour after neighbour, field after field: so the other side takes them
    to = run.outbox
    for s in range(run.n_neighbour):
        first, last = pools.fixed_int[run.send_starts + s], pools.fixed_int[run.send_starts + s + 1]
        for i in range(n):
            for e in range(first, last):
                moving[to] = moving[at + i * stride + pools.fixed_int[run.send_places + e]]
                to += 1
    call_out(pools, MESSAGES, n, 0, 0)
    start = run.inbox
    for s in range(run.n_neighbour):
        first, last = pools.fixed_int[run.take_starts + s], pools.fixed_int[run.take_starts + s + 1]
        for i in range(n):
            for e in range(first, last):
                moving[at + i * stride + pools.fixed_int[run.take_places + e]] = moving[start]
                start += 1
