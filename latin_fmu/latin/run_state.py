"""State of a run between windows: image, search directions, threads, what is recorded, segments of time, snapshots."""

from __future__ import annotations

import time as clock
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from ..cholesky.substitution import LANES
from ..compiled import PLAIN
from ..kernels import entries
from ..kernels.energy_parts import (
    INSTANTS,
    LARGEST,
    N_TERM,
    N_WORK,
    OF_DRIFT,
    OF_GROUND,
    PUT_IN,
    STORED,
    TERMS,
    WORK_OF_LOADS,
)
from ..kernels.indicator import NOTHING
from ..kernels.team import DISMISSED
from ..propagator.image import Image, take_marched
from .assembly import Array, Assembly, Index
from .exchange import Exchange
from .initial_conditions import initial_conditions
from .instant_solve import PerfectInterfaceSolve
from .outcome import Timings
from .part import Part
from .probes import Probes
from .processes import check_newton
from .recorder import Recorder
from .run_image import LawsInPython, Stages, histories, law_of, make_image, negligible_scales, still
from .search_direction import Direction
from .settings import SolverSettings
from .status import AT_REST, ROUND_OFF, Account, WindowList, allowed_work, round_off, status, with_energy, with_work

ONE = 1
LONG = 2
EXACT = 3
"""Keys of the search directions in the image: windows of one instant, longer ones, the first without tables of Y."""
SAMPLED = 64  # instants between two samples of the states, wherever the calls of the kernels end


_IDLE = 20_000  # numbers that an instant reads, below which a thread costs more than it gives
_APART = 1.1  # longest share of the classes of a thread, over the mean, up to which no class is shared by the threads


def distributed(costs: Sequence[float], threads: int, large: Collection[int]) -> list[Index]:
    """Numbers of the classes of each thread; those of the ``large`` ones that would leave other threads idle are in
    none: all threads share them.

    >>> [part.tolist() for part in distributed([4.0, 3.0, 3.0, 2.0], 2, ())]
    [[0, 3], [1, 2]]
    >>> [part.tolist() for part in distributed([9.0, 3.0, 3.0], 2, (0,))]
    [[1], [2]]
    """
    classes = sorted(range(len(costs)), key=lambda c: -costs[c])
    while True:
        parts: list[list[int]] = [[] for _ in range(threads)]
        loads = [0.0] * threads
        # largest first, each to the thread with the least
        for c in classes:
            lightest = loads.index(min(loads))
            parts[lightest].append(c)
            loads[lightest] += costs[c]
        costliest = next((c for c in classes if c in large), None)
        if costliest is None or max(loads) <= _APART * sum(loads) / threads:
            return [np.array(part, dtype=np.int64) for part in parts]
        # given to all threads, which ends the wait of the others
        classes.remove(costliest)


def _cost(row: Mapping[str, int]) -> float:
    """Numbers that an instant of a class reads, about."""
    if row.get("swept"):
        interface = 2 * row["n_panels"]
    else:
        interface = 2 * row["n_live"] ** 2 + row["n_inner"] ** 2
    return float(row["m"] * (2 * row.get("n_panels", 0) + interface + 60 * row["n"]))


class Team:
    """Threads of one run (``kernels.team``): while a call of the kernels is at work, the others wait in it for tasks.

    Parameters
    ----------
    image : of the run. count : number of threads.
    """

    def __init__(self, image: Image, count: int) -> None:
        self._image, self._busy = image, False
        self._pool: ThreadPoolExecutor | None = None
        costs = [_cost(image.row(c)) for c in range(len(image.propagators))]
        if count == 1 or PLAIN or sum(costs) < _IDLE:
            return
        rows = [image.row(c) for c in range(len(costs))]
        large = [c for c, row in enumerate(rows) if row["n_piece"] or row["m"] == 2 or row["m"] > LANES]
        image.use_threads(count, distributed(costs, count, large))
        self._pool = ThreadPoolExecutor(count - 1, thread_name_prefix="latin-fmu")
        self._others = range(1, count)

    @property
    def several(self) -> bool:
        """Whether there is more than one thread."""
        return self._pool is not None

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Context of calls of the kernels that the threads share."""
        if self._pool is None or self._busy:
            yield
            return
        self._busy = True
        numbers = self._image.counts("team", DISMISSED + 1)
        # records are written once, before several threads read them
        self._image.write()
        numbers[DISMISSED] = 0
        waiting = [self._pool.submit(self._image.call, entries.SERVE, thread) for thread in self._others]
        try:
            yield
        finally:
            numbers[DISMISSED], self._busy = 1, False
            for one in waiting:
                # errors of the threads are raised here
                one.result()


class RunImage:
    """The image of a run, its search directions, and the energies that the state of the image accounts for.

    Parameters
    ----------
    assembly, settings : the problem and the rules of its solution. recorder : reads what the image keeps.
    communication : fields of the record of the run for communication steps in kernels. part : of the assembly that this
        process holds where its substructures are distributed, else None.

    Attributes
    ----------
    local : the assembly, or the part of it, that the image is of.
    """

    def __init__(
        self,
        assembly: Assembly,
        settings: SolverSettings,
        recorder: Recorder,
        communication: Mapping[str, Any],
        part: Part | None,
    ) -> None:
        self.assembly, self.settings = assembly, settings
        self.part, self.local = part, assembly if part is None else part.assembly
        start = initial_conditions(assembly)
        self._exchange: Exchange | None = None
        self._directions: dict[int, Direction] = {}
        self._direct_bonds = False
        # where the perfect interfaces are too many, or redundant, for one matrix in the kernels
        self._bonds: PerfectInterfaceSolve | None = None
        one = self.direction(1)
        one.bind()
        # communication steps have signals of all that is probed: there fields are read instant by instant
        self._probes: Probes | None = recorder.probes(self.local, fields=not communication.get("n_output"))
        if not assembly.interfaces:
            part = None
        if part is not None:
            with part.processes.agreed():
                check_newton(one)
        self.image = make_image(self.local, settings, one, self._probes, communication, part)
        if part is not None:
            self._exchange = Exchange(part, self.image, one)
        LawsInPython(self.image, self.local.layout.groups)
        if part is not None:
            start = start[0][part.channels], start[1][part.channels]
        self.f_hat[:], self.w_hat[:] = start
        self._use(1)
        self.image.field("scales", 3)[:] = negligible_scales(self.image, one, settings.tolerance)

    @property
    def probes(self) -> Probes | None:
        """What the image keeps of the substructures for a recorder beside their energies, None where nothing."""
        return self._probes

    def stages(self, n: int, first: int) -> Stages:
        """Stages of a window of n instants from the instant ``first`` on."""
        if self._exchange is None:
            return Stages(self.image, self.direction(n), n, first)
        return SharedStages(self.image, self.direction(n), n, first, self._exchange)

    @property
    def f_hat(self) -> Array:
        """Tractions of the last accepted instant (n_flat,), a view, Pa."""
        return self.image.field("f_hat", self.image.n_flat)

    @property
    def w_hat(self) -> Array:
        """Velocities of the last accepted instant (n_flat,), a view, m s-1."""
        return self.image.field("w_hat", self.image.n_flat)

    def gaps(self) -> list[Array]:
        """Gaps (n_point,) of each group at the present instant, m."""
        groups = self.local.layout.groups
        return [self.image.group_field(g, "gap", group.n_point).copy() for g, group in enumerate(groups)]

    def direction(self, n: int) -> Direction:
        """Search direction for windows of n instants (kept: one for n = 1, one for longer windows)."""
        key = min(n, LONG)
        if key not in self._directions:
            compiled = all(law_of(group.behaviour) >= 0 for group in self.assembly.layout.groups)
            # tables serve windows of one instant, with laws that the kernels have
            usable = self.settings.window == 1 and compiled
            if usable:
                settings = self.settings
            else:
                settings = replace(self.settings, tables=0.0)
            self._directions[key] = self.made_direction(settings, n)
        return self._directions[key]

    def made_direction(self, settings: SolverSettings, n: int) -> Direction:
        """Search direction by these settings for windows of n instants, of the part that this process holds."""
        direction = Direction(self.assembly, settings, n)
        if self.part is None:
            return direction
        return self.part.direction(direction)

    def _use(self, n: int, exact: bool = False) -> None:
        """Bind propagators and image to the search direction for windows of n instants; ``exact``: without tables of
        Y."""
        direction = self.direction(n)
        exact &= direction.sparse  # without tables both are one direction
        if exact:
            key = EXACT
        else:
            key = min(n, LONG)
        if self.image.bound == key:
            return
        direction.bind(exact)
        self.image.bind(key, direction.run_fields(), direction.group_fields())

    def choices(self) -> dict[str, str]:
        """Automatic choices, in words."""
        if self._direct_bonds:
            return {"bonds": "one linear solve per instant"}
        windows = {ONE: "windows of one instant", LONG: "longer windows"}
        choices = {f"search direction, {windows[key]}": d.choice for key, d in self._directions.items()}
        if self.settings.newton and self.settings.window == 1 and self.direction(1).too_large:
            choices["Newton steps"] = "none: the interfaces have more points than their matrix is made for"
        return choices

    def _drift_work(self) -> float:
        """Work against the laws of the interfaces since the start (``drift_work`` of the energies), J."""
        return self._over_processes(float(self.image.field("works", N_WORK)[OF_DRIFT]))

    def _put_in(self) -> float:
        """Energy put in since the start (``indicator.own_put_in``), J; -1 where energies are not accounted for."""
        image, works = self.image, self.image.field("works", N_WORK)
        energy = float(works[STORED] + works[OF_GROUND])
        for c, propagator in enumerate(self.local.propagators):
            if not propagator.energy:
                return -1.0
            terms = image.class_field(c, "totals", N_TERM, len(propagator.members))
            energy += float(terms[WORK_OF_LOADS].sum())
        # never less than it was
        return max(self._over_processes(energy), float(works[PUT_IN]))

    def count_as_put_in(self, stored: float) -> None:
        """Let the errors of the iteration be compared with an energy, J, that an assembly has beside that of its
        account at the start."""
        works = self.image.field("works", N_WORK)
        works[OF_GROUND] += max(stored - float(works[STORED]), 0.0)

    def account(self) -> Account | None:
        """The account of energies since the start, which sums up to round-off; None where it is not kept, or is
        distributed over processes."""
        if self.part is not None or not all(p.energy and not p.loads_only for p in self.local.propagators):
            return None
        works, total = self.image.field("works", N_WORK), np.zeros(N_TERM)
        for c, propagator in enumerate(self.local.propagators):
            total += self.image.class_field(c, "totals", N_TERM, len(propagator.members)).sum(axis=1)
        terms = dict(zip(TERMS, total.tolist(), strict=True))
        put_in = terms.pop("work_of_loads") + terms.pop("interface_work")
        open_by = sum(terms.values()) - float(works[STORED]) - put_in
        largest = max(float(np.abs(total).max(initial=0.0)), float(works[STORED]))
        return Account(open_by, largest, round_off(self.assembly) * max(1.0, float(works[INSTANTS])))

    def _over_processes(self, value: float) -> float:
        """Sum over the processes of the run."""
        total = np.array([value])
        if self.part is not None:
            self.part.processes.add(total)
        return float(total[0])


class RunState(RunImage):
    """All that a run holds between two windows.

    Parameters
    ----------
    assembly, settings, communication, part : as for ``RunImage``. recorder : keeps the accepted fields.

    Attributes
    ----------
    windows : records of the windows of the segment. interface_indicator : (n_interface,) largest indicator of each.
    marched, condensed : substructure-instants marched, and solved through the condensed operator, since the start.
    refusals : windows of one instant that the compiled driver left to the Python driver.
    stopped : whether a window ended so far from a solution that the run cannot continue.
    """

    def __init__(
        self,
        assembly: Assembly,
        settings: SolverSettings,
        recorder: Recorder,
        timings: Timings,
        communication: Mapping[str, Any] | None = None,
        part: Part | None = None,
    ) -> None:
        super().__init__(assembly, settings, recorder, communication or {}, part)
        self.recorder, self.timings = recorder, timings
        self._joined: Array | None = None  # tractions of the whole assembly at the end of a distributed run
        self.marched = self.condensed = 0
        self._team = Team(self.image, self.settings.threads)
        self.refusals = 0
        self._per_instant = 0.0
        self._refused = False
        self._still = still(assembly)
        self._clear()
        self._begin_recording(accounts=True)

    def _clear(self) -> None:
        """Forget the windows of the last segment."""
        self.windows = WindowList()
        self.interface_indicator: Array | None = None
        self.stopped = False
        self._sequence: list[tuple[Array, Array]] | None = None  # fields of a sequential first guess, not recorded

    @property
    def tractions(self) -> Array:
        """Tractions of the last accepted instant on all interfaces of the assembly; of a distributed run after
        ``join``, Pa."""
        if self._joined is None:
            return self.f_hat
        return self._joined

    def snapshot(self) -> dict[str, Any]:
        """All that the next window of this segment depends on, beside what has been recorded."""
        counts = {
            "marched": self.marched,
            "condensed": self.condensed,
            "stopped": self.stopped,
            "refusals": self.refusals,
        }
        samples = [p.sampled for p in self.assembly.propagators]
        return counts | {"instant": self.assembly.instant, "state": self.image.state, "samples": samples}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Return to a ``snapshot``; the caller restores windows and recorder."""
        for name in ("marched", "condensed", "stopped", "refusals"):
            setattr(self, name, snapshot[name])
        self.image.state[:] = snapshot["state"]
        # the state has no instant: propagators keep it
        self._set_instant(snapshot["instant"])
        for propagator, sampled in zip(self.assembly.propagators, snapshot["samples"], strict=True):
            propagator.sampled[:] = sampled
        if self.windows:
            self._read_indicator()

    def begin_segment(self, recorder: Recorder) -> None:
        """Continue after the assembly has begun a new segment of time."""
        self._clear()
        alike, self._still = self._still, still(self.assembly)
        if not (alike and self._still and self.image.begin_alike(len(self.assembly.time))):
            self.image.begin(len(self.assembly.time), histories(self.assembly))
        self.image.field("worst", len(self.assembly.interfaces))[:] = 0.0
        self.recorder = recorder
        self._begin_recording()

    def _begin_recording(self, accounts: bool = False) -> None:
        """Record the first instant of the segment, with which the accounts of energies begin."""
        self.image.set({"first_row": 0})
        self.image.call(entries.START, int(accounts))
        if self._exchange is not None:
            self._exchange.touch()
        self.recorder.keep(self.local, self.image, self._probes, 1)

    def _set_first_row(self, instant: int) -> None:
        """Let the next call of the kernels begin its output with an instant."""
        self.image.set({"first_row": instant})

    def _record_instant(self, _: int) -> None:
        """Record the present instant, which the last call of the kernels has marched."""
        self._record(1, self.assembly.instant - int(self.image.run_fields["first_row"]))

    def _record(self, n: int, row: int = 0) -> None:
        """Record n accepted instants, rows of the image's output from ``row`` on."""
        if self._sequence is None:
            self.recorder.keep(self.local, self.image, self._probes, n, row)
        else:
            f_hat, w_hat = (
                self.image.field(name, self.image.rows, self.image.n_flat) for name in ("history_f", "history_w")
            )
            self._sequence.append((f_hat[row : row + n].copy(), w_hat[row : row + n].copy()))

    def join(self) -> None:
        """Complete recorder, motions and counts by those of the other processes, at the end of a distributed run."""
        if self.part is None:
            return
        processes = self.part.processes
        self.recorder.join(self.part)
        # counts are small enough to be exact as float
        count = np.array([self.marched, self.condensed], dtype=float)
        processes.add(count)
        self.marched, self.condensed = map(int, count)
        if self.interface_indicator is not None:
            indicator = self.interface_indicator[: self.part.n_owned]
            every = processes.gather(indicator, np.cumsum([0, *map(len, self.part.owned)]).tolist())
            self.interface_indicator = every[self.part.gathered_order()]
        if self._exchange is not None:
            self._joined = self._exchange.whole(self.f_hat[None])[0]
        processes.forget()
        ends = [(p.state.fields, p.sampled) for p in self.local.propagators]
        parts = [iter(part) for part in processes.collect(ends)]
        for owner, propagator in zip(self.assembly.owner, self.assembly.propagators, strict=True):
            motion, sampled = next(parts[owner])
            if owner != processes.rank:
                propagator.state.set(*motion)
                propagator.sampled[:] = sampled

    def status(self, energy: Mapping[str, Array] | None = None, stored: float | None = None) -> tuple[bool, str]:
        """Whether every window of the segment converged, and a sentence on it; ``energy`` and ``stored`` as for
        ``status.with_energy``."""
        converged, sentence = status(self.assembly, self.settings, self.windows, self.interface_indicator)
        if self.assembly.quasi_static:
            return converged, sentence
        negligible, works = round_off(self.assembly), self.image.field("works", N_WORK)
        alone = self.part is None
        if alone:
            put_in = self._put_in()
        else:
            put_in = float(works[PUT_IN])
        if converged and put_in >= 0.0:  # the largest is that of all processes, up to the instant before the last
            work = max(float(works[LARGEST]), 0.0)
            if alone:
                work = max(work, abs(float(works[OF_DRIFT])))
            # residuals below NOTHING of the tractions are accepted, as of bodies that rest under a preload
            work -= negligible * max(1.0, NOTHING / ROUND_OFF * float(works[INSTANTS]))
            # by residuals alone: the modes that are left out resolve no waves
            waves = self.settings.window == 1 and not self.settings.residual_alone
            short = waves and self.direction(1).short
            allowed = allowed_work(float(works[INSTANTS]), short)
            # where a body at rest alone is loaded nothing is put in: a share of what passes the interfaces in a window
            passes = float(self.image.field("scales", 3)[0]) * self.settings.window * self.assembly.dt
            put_in = max(put_in, AT_REST * passes)
            converged, sentence = with_work(sentence, work, put_in, allowed, self.settings.tolerance)
        if energy is None:
            return converged, sentence
        return with_energy(converged, sentence, self.assembly.time, energy, stored, negligible)

    def named_indicator(self) -> dict[str, float]:
        """Largest indicator of each interface by name; empty where there is none."""
        if self.interface_indicator is None:
            return {}
        names = [unit.name for unit in self.assembly.interfaces]
        return dict(zip(names, map(float, self.interface_indicator), strict=True))

    def _read_indicator(self) -> None:
        """Copy the largest indicators of the interfaces from the image."""
        if self.assembly.interfaces:
            self.interface_indicator = self.image.field("worst", len(self.local.interfaces)).copy()

    def _sample(self) -> None:
        """Sample the states at fixed instants, however many are solved in one call."""
        instant = self.assembly.instant
        if instant % SAMPLED == 0 or instant == self.assembly.n_instant:
            for propagator in self.local.propagators:
                propagator.sample()

    def _count(self, before: float) -> None:
        """Add the work, and the CPU time since ``before``, that of the process then."""
        marched, condensed = take_marched(self.image)
        self.marched += marched
        self.condensed += condensed
        self.timings.march += clock.process_time() - before

    def _set_instant(self, instant: int) -> None:
        for propagator in self.assembly.propagators:
            propagator.instant = instant


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
        image = self.image
        exchange = self._exchange
        whole = self.direction.whole
        reach = np.zeros(image.n_flat)
        for g, group in enumerate(self._groups):
            # one field for all groups: at the places of side E
            group_reach = self.reach(g)
            group.block(reach)[0, :, : group_reach.shape[1]] = group_reach
        made_up = self.made_up()
        free = image.field("w", image.n_flat) + made_up
        free, wide_f, wide_reach = exchange.whole(np.stack([free, f_hat, reach]))
        gaps = []
        for group in whole.assembly.layout.groups:
            if group.behaviour.elastic:
                width = group.n_component
            else:
                width = 1
            gaps.append(np.ascontiguousarray(group.block(wide_reach)[0, :, :width]))
        solved = whole.points.solve(free, wide_f, gaps, self.rates())
        # k of the part times what is made up: q of the sides and not of the laws
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
