"""What the processes of a run exchange where the kernels call out for it (``processes``, ``kernels.callouts``)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..kernels import callouts
from ..propagator.image import Image
from .assembly import Array
from .part import Part
from .search_direction import Direction


class Exchange:
    """What the processes of a run exchange where the kernels call out for it.

    Parameters
    ----------
    part, image : of the assembly that this process holds. direction : that of the part.

    Attributes
    ----------
    parts : gathers the sums over each interface.
    """

    def __init__(self, part: Part, image: Image, direction: Direction) -> None:
        self.part = part
        self.processes = part.processes
        self._image = image
        run, gathering = image.run_fields, self.processes.gathering
        width, owned = run["part_width"], list(map(len, part.owned))
        local, every = (
            image.field(name, n * width) for name, n in (("own_parts", part.n_owned), ("parts", sum(owned)))
        )
        self.parts = gathering(local, every, [n * width for n in owned])
        self._norms: dict[int, Callable[[], None]] = {}
        self._neighbours: dict[int, Callable[[], None]] = {}
        # classes of which several processes have members
        self._divided = len(set(part.whole.part_of)) < len(part.whole.part_of)
        self._point_owned = direction.relative.get("point_owned")
        self.has_coarse = bool(run.get("n_coarse", 0))
        if self.has_coarse and direction.coarse is not None:
            shares = direction.coarse.shares
            # processes without sums are among those that gather
            shares = [*shares, *[0] * (part.size - len(shares))]
            self.coarse = gathering(
                image.field("coarse_own", shares[part.rank]), image.field("coarse_parts", sum(shares)), shares
            )
        image.callouts.add(
            {
                callouts.MESSAGES: lambda n, *_: self.neighbours(n),
                callouts.PARTS_OF_ALL: lambda *_: self.parts(),
                callouts.NORMS_OF_ALL: lambda n, *_: self.norms(n),
                callouts.COARSE: lambda *_: self.coarse(),
                callouts.CHANGES: lambda n, *_: self.changes(n),
                callouts.UNKNOWNS: lambda *_: self.unknowns(),
                callouts.MATRIX: lambda size, *_: self.matrix(size),
                callouts.SUM: lambda at, n, _: self.processes.add(image.moving[at : at + n]),
            }
        )

    def neighbours(self, n: int) -> None:
        """Exchange messages of n fields with the neighbours."""
        if n not in self._neighbours:
            # outbox and inbox hold the messages of all neighbours one behind the other
            messages = []
            at = 0
            start = 0
            for rank, outbox, inbox in self.part.neighbours:
                end, last = at + n * len(outbox), start + n * len(inbox)
                messages.append((rank, self._field("outbox", at, end), self._field("inbox", start, last)))
                at, start = end, last
            self._neighbours[n] = self.processes.sending(messages)
        self._neighbours[n]()

    def _field(self, name: str, first: int, last: int) -> Array:
        return self._image.field(name, last)[first:]

    def norms(self, n: int) -> None:
        """Gather the norms of the force residual over a window of n instants."""
        if n not in self._norms:
            sizes = [4 * n * (self.part.whole.owner.count(r) + 1) for r in range(self.part.size)]
            local, every = (
                self._image.field("own_norms", sizes[self.part.rank]),
                self._image.field("all_norms", sum(sizes)),
            )
            self._norms[n] = self.processes.gathering(local, every, sizes)
        self._norms[n]()

    def touch(self) -> None:
        """Find out whether any traction of the last accepted instant acts."""
        acts = np.array([float(self._image.field("f_hat", self._image.n_flat).any())])
        # a sum over processes: above 0 where any of them has one
        self.processes.add(acts)
        self._image.field("touched", 1)[0] = float(acts[0] > 0.0)

    def changes(self, n: int) -> None:
        """Changes of q at all members of the divided classes over a window of n instants."""
        if not self._divided:
            return
        part, image = self.part, self._image
        local = [image.class_field(c, "changes", n) for c, divided in enumerate(part.divided) if divided]
        counts = np.bincount(part.whole.part_of)
        rows = [[c for c, r in enumerate(part.whole.owner) if r == rank] for rank in range(part.size)]
        rows = [[c for c in own_rows if counts[part.whole.part_of[c]] > 1] for own_rows in rows]
        ends = np.cumsum([0, *(n * len(r) for r in rows)]).tolist()
        every = self.processes.gather(np.concatenate([np.zeros(0), *local]), ends).reshape(-1, n)
        numbers = [part.whole.part_of[c] for r in rows for c in r]
        for field, c in zip(local, rows[part.rank], strict=True):
            total = np.zeros(n)
            # the members of one class, wherever they are
            for number, values in zip(numbers, every, strict=True):
                if number == part.whole.part_of[c]:
                    total += values
            field[:] = total

    def unknowns(self) -> None:
        """Unknowns of a Newton step at the points that other processes hold."""
        image = self._image
        n = int(image.run_fields["n_place"])
        # each point is counted by one process: the sum has all of them
        every = (np.diff(image.counts("unknown_of", n + 1)) * self._point_owned).astype(float)
        self.processes.add(every)
        image.counts("elsewhere", n)[:] = every

    def matrix(self, size: int) -> None:
        """Sum over the processes of matrix and right-hand side of a Newton step."""
        image = self._image
        count = int(image.counts("unknown_of", int(image.run_fields["n_place"]) + 1)[-1])
        for name, n in (("matrix", size), ("unknowns", count)):
            self.processes.add(image.field(name, n))

    def whole(self, values: Array) -> Array:
        """Values (n, channels of the assembly) from those of the channels held, (n, n_flat)."""
        n, picked = len(values), self.part.owned_channels
        ends = np.cumsum([0, *(n * len(wide) for wide, _ in picked)]).tolist()
        every = self.processes.gather(values[:, picked[self.part.rank][1]].ravel(), ends)
        out = np.zeros((n, self.part.whole.layout.n_flat))
        for (wide, _), first, last in zip(picked, ends, ends[1:], strict=False):
            out[:, wide] = every[first:last].reshape(n, -1)
        return out
