"""The stages of a window of a distributed run: what they need of the whole assembly."""

from __future__ import annotations

import numpy as np

from ..propagator.image import Image
from .assembly import Array
from .exchange import Exchange
from .instant_solve import PerfectInterfaceSolve
from .run_image import Stages
from .search_direction import Direction


class SharedStages(Stages):
    """The stages of a window whose substructures are distributed."""

    def __init__(self, image: Image, direction: Direction, n: int, first: int, exchange: Exchange) -> None:
        super().__init__(image, direction, n, first)
        self._exchange = exchange

    def of(self, direction: Direction) -> SharedStages:
        """Those of one instant with another search direction."""
        return SharedStages(self.image, direction, 1, self.first, self._exchange)

    def ended(self) -> None:
        """Find out, at the end of an instant, whether a traction acts on any process."""
        self._exchange.touch()

    # -- what the whole assembly is needed for ----------------------------------------------------------------------
    def points_one_by_one(self, f_hat: Array) -> None:
        """Set q of one instant by the solution point by point of the whole assembly, which all processes repeat."""
        self.free_motion()
        image, exchange, whole = self.image, self._exchange, self.direction.whole
        reach = np.zeros(image.n_flat)
        for g, group in enumerate(self._groups):
            own = self._reach(g)
            group.block(reach)[0, :, : own.shape[1]] = own
        made_up = self.made_up()
        free = image.field("w", image.n_flat) + made_up
        free, wide_f, wide_reach = exchange.whole(np.stack([free, f_hat, reach]))
        gaps = []
        for group in whole.assembly.layout.groups:
            width = group.n_component if group.behaviour.elastic else 1
            gaps.append(np.ascontiguousarray(group.block(wide_reach)[0, :, :width]))
        solved = whole.points.solve(free, wide_f, gaps, self._rates())
        self.field("q")[0] = whole.incoming(*solved)[exchange.part.channels] - self.direction.k * made_up

    def bonded(self, bonds: PerfectInterfaceSolve) -> Array:
        """q (n_flat,) of the solution where all interfaces are perfect."""
        self.free_motion()
        exchange, whole = self._exchange, self.direction.whole
        made_up = self.made_up()
        free = exchange.whole((self.image.field("w", self.image.n_flat) + made_up)[None])[0]
        return np.asarray(bonds.guess(free, whole.k)[exchange.part.channels] - self.direction.k * made_up)

    def largest(self, value: float) -> float:
        """The largest value over all processes of the run."""
        return float(max(self._exchange.processes.collect(value)))

    def _over_interfaces(self, values: Array) -> Array:
        """Sums (n,) of values (n, n_flat) over the channels."""
        part = self._exchange.part
        sums: Array = values[:, part.owned_channels[part.rank][1]].sum(axis=1)
        self._exchange.processes.add(sums)
        return sums
