"""The part of an assembly that one process of a run holds: its substructures, and the interfaces that touch them.

It is an assembly of its own, with a layout of its own: interfaces and channels have other numbers than in the whole.
The interfaces that the process owns come first. An interface belongs to the process of its side E; the process of side
E', if that is another one, computes it too, but does not count it in sums or write it to the results.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from .assembly import Assembly, Index, Layout
from .coarse_problem import CoarseProblem
from .processes import Processes
from .search_direction import Direction


class Part:
    """The part of an assembly, which has begun, that this one of the ``processes`` holds; ``whole.owner`` has the
    process of each class.

    Attributes
    ----------
    whole, assembly : the whole one, and the part as an assembly. interfaces : numbers in the whole of its interfaces,
    of which the first ``n_owned`` are owned. channels : (n_flat,) numbers in the whole of its channels.
    owned : per process the numbers of the interfaces that it owns. divided : per class of the part, whether other
    processes hold members of it. neighbours : per process that holds other sides of the interfaces, in ascending order,
    its number, the channels that it takes and the channels that are taken from it.
    """

    def __init__(self, whole: Assembly, processes: Processes) -> None:
        self.whole, self.processes = whole, processes
        rank, size = self.rank, self.size = processes.rank, processes.size
        owner = np.full(whole.layout.n_flat, -1)
        for process, channels in zip(whole.owner, whole.channels, strict=True):
            owner[channels] = process
        every = range(len(whole.interfaces))
        # all channels of a side belong to one substructure
        self.sides = [[int(owner[whole.layout.channels(i, side)[0, 0]]) for side in (0, 1)] for i in every]
        """Per interface of the whole the processes of its sides, -1 for ground."""
        self.owned = [[i for i in every if self.sides[i][0] == r] for r in range(size)]
        others = [i for i in every if self.sides[i][1] == rank != self.sides[i][0]]  # E' here, E elsewhere
        self.interfaces, self.n_owned = [*self.owned[rank], *others], len(self.owned[rank])
        self.classes = [c for c, process in enumerate(whole.owner) if process == rank]
        counts = np.bincount(np.array(whole.part_of, dtype=np.int64))
        self.divided = [bool(counts[whole.part_of[c]] > 1) for c in self.classes]
        self.assembly = self._restricted()
        self.neighbours = self._neighbours()

    def _restricted(self) -> Assembly:
        """The part as an assembly."""
        whole, part = self.whole, copy.copy(self.whole)
        part.interfaces = [whole.interfaces[i] for i in self.interfaces]
        layout = part.layout = Layout(part.interfaces)
        # numbers in the whole of the channels of the part
        self.channels = np.zeros(layout.n_flat, dtype=np.int64)
        for number, i in enumerate(self.interfaces):
            group, wide = layout.group(number), whole.layout.group(i)
            for name in ("parameters", "gap", "preload"):
                getattr(group, name)[group.members[number]] = getattr(wide, name)[wide.members[i]]
            for side in (0, 1):
                self.channels[layout.channels(number, side)] = whole.layout.channels(i, side)
        # numbers in the part of the channels of the whole, -1 elsewhere
        place = np.full(whole.layout.n_flat, -1)
        place[self.channels] = np.arange(layout.n_flat)
        part.propagators = [whole.propagators[c] for c in self.classes]
        part.channels = [place[whole.channels[c]] for c in self.classes]
        part.part_of = part.owner = ()
        part.take_interfaces(whole, self.interfaces, self.channels)
        return part

    def _neighbours(self) -> list[tuple[int, Index, Index]]:
        """See the attribute."""
        outbox: dict[int, list[Index]] = {}
        inbox: dict[int, list[Index]] = {}
        # in the order of the whole, so that sender and receiver have the channels in one order
        for i in sorted(self.interfaces):
            number = self.interfaces.index(i)
            # ``other`` has the opposite side: it gets this one, and gives its own
            for side, other in ((0, self.sides[i][1]), (1, self.sides[i][0])):
                if other not in (-1, self.rank):
                    outbox.setdefault(other, []).append(self.assembly.layout.channels(number, side).ravel())
                    inbox.setdefault(other, []).append(self.assembly.layout.channels(number, 1 - side).ravel())
        return [(r, np.concatenate(outbox[r]), np.concatenate(inbox[r])) for r in sorted(outbox)]

    def gathered_order(self) -> Index:
        """Row of every interface of the whole among those of all processes, one process after the other."""
        # of a permutation its inverse
        order: Index = np.argsort(np.concatenate([np.zeros(0, dtype=np.int64), *map(_integers, self.owned)]))
        return order

    @cached_property
    def owned_channels(self) -> list[tuple[Index, Index]]:
        """Per process the channels of the interfaces that it owns: numbers in the whole; of this process in the part,
        too (of others nothing)."""
        picked = []
        for r, owned in enumerate(self.owned):
            here = range(len(owned) if r == self.rank else 0)
            wide = [self.whole.layout.channels(i, side).ravel() for i in owned for side in (0, 1)]
            local = [self.assembly.layout.channels(i, side).ravel() for i in here for side in (0, 1)]
            none = np.zeros(0, dtype=np.int64)
            picked.append((np.concatenate([none, *wide]), np.concatenate([none, *local])))
        return picked

    def fields(self) -> dict[str, Any]:
        """Fields of the record of the run (``kernels.records``)."""
        whole, classes = self.whole, self.whole.owner
        counts = [classes.count(r) for r in range(self.size)]
        first = np.cumsum([0, *(n + 1 for n in counts)])  # rows of norms: classes of a process, then its flag
        seen, rows = [0] * self.size, []
        for r in classes:
            # the next row of its process
            rows.append(int(first[r]) + seen[r])
            seen[r] += 1
        rows += [int(first[r + 1]) - 1 for r in range(self.size)]  # flags
        outbox, inbox = [n[1] for n in self.neighbours], [n[2] for n in self.neighbours]
        none = np.zeros(0, dtype=np.int64)
        return {
            "shared": 1,
            "n_process": self.size,
            "n_class": len(set(whole.part_of)),
            "n_neighbour": len(self.neighbours),
            "n_part": len(whole.interfaces),
            "part_order": self.gathered_order(),
            "tangential": int(not whole.layout.normal.all()),
            "layers": int(any(g.behaviour.elastic for g in whole.layout.groups)),
            "n_norm": len(rows),
            "norm_order": _integers(rows),
            "n_send": sum(map(len, outbox)),
            "n_take": sum(map(len, inbox)),
            "send_starts": np.cumsum([0, *map(len, outbox)]),
            "take_starts": np.cumsum([0, *map(len, inbox)]),
            "send_places": np.concatenate([none, *outbox]),
            "take_places": np.concatenate([none, *inbox]),
        }

    def direction(self, whole: Direction) -> Direction:
        """The search direction of the part, from that of the whole assembly."""
        part, picked = copy.copy(whole), self.channels
        part.assembly = self.assembly
        part.parent = whole
        part.own_coarse = self.coarse
        part.k = whole.k[picked]
        part.z = whole.z[picked]
        part.metric = whole.metric[picked]
        part.weights, part.newton_z = whole.weights[:, picked], whole.newton_z[picked]
        part.relative = self.relative(whole.relative)
        return part

    def coarse(self, whole: CoarseProblem) -> CoarseProblem:
        """The coarse problem of the part."""
        return whole.of_part(self.channels, self.interfaces, self.sides, self.rank)

    def relative(self, whole: dict[str, Any]) -> dict[str, Any]:
        """Fields of the record of the run for Newton steps, from those of the whole assembly: its points are numbered
        as there, those that are not held here have no group."""
        if "point_group" not in whole or whole.get("krylov"):
            return whole
        groups = self.assembly.layout.groups
        table = np.full((len(self.whole.layout.groups), max(g.n_point for g in self.whole.layout.groups), 3), -1)
        table[..., 2] = 0  # counted here: set below
        for number, i in enumerate(self.interfaces):
            group, wide = self.assembly.layout.group(number), self.whole.layout.group(i)
            g = next(g for g, other in enumerate(self.whole.layout.groups) if other is wide)
            here = next(g for g, other in enumerate(groups) if other is group)
            points = table[g, wide.members[i]]
            points[:, 0], points[:, 1] = here, np.arange(group.members[number].start, group.members[number].stop)
            points[:, 2] = number < self.n_owned
        # points in the order of the whole
        numbers = table[whole["point_group"], whole["point_number"]].T
        names = ("point_group", "point_number", "point_owned")
        owners = zip(("owner", "owner_class", "live_row"), self.assembly.owners(), strict=True)
        return whole | dict(zip(names, map(np.ascontiguousarray, numbers), strict=True)) | dict(owners)


def _integers(values: Sequence[int]) -> Index:
    return np.array(values, dtype=np.int64)
