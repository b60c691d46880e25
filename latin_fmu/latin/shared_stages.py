"""The stages of a window of a distributed run: exchanges between the calls of the kernels (``kernels.shared``)."""

from __future__ import annotations

import numpy as np

from ..kernels import entries
from ..kernels.instants import CORRECTED, WITHIN
from ..kernels.iteration import BROKEN, CONVERGED, STALLED
from ..kernels.newton import ACTIVE, N_COURSE, POWER, RESIDUAL
from ..kernels.shared import FUSED, GUESS, LONG, NEEDED, NEWTON
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
        self._reuses = exchange.divided and float(image.run[0]["reuse"]) >= 0.0
        self._fused = not (self._reuses or exchange.has_coarse or image.run[0]["longest_step"] < np.inf)

    def of(self, direction: Direction) -> SharedStages:
        """Those of one instant with another search direction."""
        return SharedStages(self.image, direction, 1, self.first, self._exchange)

    def begin(self) -> None:
        """Openings at the start of the window."""
        super().begin()
        for kind in range(3 if self.n > 1 else 0):
            self.image.call(entries.MOTION, self.first - 1, kind)
            self._exchange.share("displacement")
            self.image.call(entries.JUMPS, kind)

    def free_motion(self) -> None:
        """Velocities of all channels without tractions, into ``w``."""
        super().free_motion()
        self._exchange.share("w")

    def first_guess(self) -> None:
        """First q of an instant."""
        self._take_guess(self.image.call(entries.FIRST, self.first), fused=False)

    def _take_guess(self, needed: int, fused: bool) -> None:
        """Exchange what the first q needs; ``fused`` : the linear stage follows."""
        if needed:
            self._exchange.neighbours(1)
            self.image.call(entries.GUESSED, needed, self.first, int(fused))

    def evaluate(self, iteration: int, phase: int = 0) -> None:
        """``kernels.iteration.next_stage``, with the exchanges between its parts."""
        course = self.image.field("course", N_COURSE)
        if iteration == 0:
            course[:] = 0.0
        newton = self.n == 1 and course[ACTIVE] == 1.0
        if not (newton and self._newton_step(iteration)):
            if newton:
                self.image.call(entries.LEAVE, iteration)
            self._linear_stage(iteration)
            self.image.call(entries.LOCAL_PARTS, self.n, iteration, phase)
        self._exchange.parts()
        if self.image.call(entries.ERROR, self.n):
            self._exchange.norms(self.n)
            self.image.call(entries.RELATIVE_FORCES, self.n)

    def advance(self, iteration: int, phase: int) -> None:
        """The next q after an iterate that has not converged."""
        if self.image.call(entries.NEXT, self.n, iteration, phase):
            self._shorten()

    def _shorten(self) -> None:
        self._exchange.parts()
        self.image.call(entries.SHORTEN, self.n)

    def _linear_stage(self, iteration: int) -> None:
        """Linear stage of the substructures here, and the exchange of W."""
        image, exchange = self.image, self._exchange
        if self._reuses and iteration:
            image.call(entries.CHANGES, self.n)
            exchange.changes(self.n)
        image.call(entries.SEND_STAGE, self.n, self.first, iteration)
        if exchange.has_coarse:
            exchange.coarse()
            image.call(entries.BALANCE)
        exchange.neighbours(self.n)

    def _newton_step(self, iteration: int) -> bool:  # noqa: ARG002, as where laws are called by Python
        """``kernels.iteration.newton_step`` up to its measures, with the exchanges between its parts."""
        image, exchange = self.image, self._exchange
        image.call(entries.ADMIT)
        exchange.share("step_w")
        image.call(entries.ACTIVATE)
        exchange.counts()
        size = image.call(entries.MATRIX)
        if size:
            exchange.matrix(size)
        if not image.call(entries.CHANGE, size):
            return False
        exchange.share("step_w")
        image.call(entries.FULL_STEP)
        exchange.parts()
        image.call(entries.SIZE)
        self._linear_stage(1)
        image.call(entries.TAKE, image.run_fields["w"], 0, 1)
        image.call(entries.KEEP_END)
        self._search()
        image.call(entries.PARTS)
        return True

    def _try(self, halving: int) -> float:
        """Both stages at a share of the step; its residual."""
        self.image.call(entries.TRY, halving)
        self._exchange.parts()
        self.image.call(entries.TRIAL_SIZE)
        return float(self.image.field("course", N_COURSE)[RESIDUAL])

    def end_instant(self, instant: int, i: int = 0) -> None:
        """Gaps and accepted fields at the end of an instant, the i-th of the window."""
        self._exchange.displacements()
        super().end_instant(instant, i)
        self._exchange.touch()

    def march(self, first: int, n: int) -> int:
        """``kernels.instants.march_instants``: windows of one instant until one does not converge; how many did."""
        image, counts, exchange = self.image, self.image.field("counts", 2), self._exchange
        for call in range(n):
            self.first = first + call
            self._take_guess(
                image.call(entries.BEGIN_INSTANT, self.first, int(call > 0), int(self._fused)), self._fused
            )
            solved = counts[1]
            for name in ("iterations", "corrections"):
                image.counts(name, call + 1)[call] = 0
            if not (self._iterate(call) and self._within(call)):
                counts[1] = solved  # the Python driver solves this instant again, and counts
                return call
            exchange.neighbours(exchange.fields)
        image.call(entries.TAKE_END, first + n - 1)
        return n

    def _within(self, call: int) -> bool:
        """Correct an instant solved by tables of Y until its defect is within the tolerance; whether it is."""
        image, result = self.image, CORRECTED if self.image.run[0]["sparse"] else WITHIN
        while result == CORRECTED:
            self._exchange.processes.add(image.field("course", N_COURSE)[RESIDUAL : POWER + 1])
            result = image.call(entries.DECIDE, self.first, call)
            if result == CORRECTED:
                self._take_guess(GUESS, self._fused)
                if not self._iterate(call):
                    return False
        return result == WITHIN

    def _iterate(self, call: int) -> bool:
        """``kernels.iteration.iterate`` for one instant; whether it converged."""
        image, exchange, how, bits = self.image, self._exchange, FUSED * self._fused, 0
        begin = int(image.counts("iterations", call + 1)[call])
        for iteration in range(begin, int(image.run[0]["max_iterations"])):
            if not (bits & NEWTON and self._newton_step(iteration)):
                if bits & NEWTON:
                    image.call(entries.LEAVE, iteration)
                if bits & NEWTON or not self._fused:
                    self._linear_stage(iteration - begin)
                else:
                    exchange.neighbours(1)
                image.call(entries.LOCAL_PARTS, 1, iteration, begin)
            exchange.parts()
            bits = image.call(entries.VERDICT, self.first, call, iteration, how)
            if bits & NEEDED:
                exchange.norms(1)
                bits = image.call(entries.VERDICT, self.first, call, iteration, how + 1)
            if bits & CONVERGED:
                return True
            if bits & (STALLED | BROKEN):
                return False
            if bits & LONG:
                self._shorten()
        return False

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
