"""Windows of one instant marched by compiled kernels, as many at a time as nobody needs to look in between.

What the kernels do not do falls back on ``Run.advance``: an instant that calls for a fall-back, observers,
propagators and behaviours without compiled counterpart. Both roads give the same answer.
"""

from __future__ import annotations

import time as clock
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from ..compiled import COMPILES
from ..propagator import DirectPropagator, Propagator
from ..propagator.diagonal import DiagonalFactor
from ..propagator.march import March
from .assembly import Assembly
from .error_indicator import Scales
from .layout import Array
from .local_stage import left
from .recorder import Recorder
from .settings import Settings
from .slide_probes import SlideProbes
from .stopping import AT_REST, PATIENCE, RANK, RECENT, STALL_ACCELERATED, STALL_PLAIN, TANGENTIAL_FLOOR
from .threads import Threads
from .unchanged import negligible

if TYPE_CHECKING:
    from ..march.work import Limits
    from .windows import Run

_FIRST, _LONGEST = 16, 512  # instants of the first call, which tells how long they take, and of any
_SECONDS = 0.2  # aimed at per call, so that progress is told and an interruption is heard


def marches(assembly: Assembly) -> bool:
    """Whether the kernels know the propagators and the behaviours of an assembly."""
    if not COMPILES:
        return False
    return all(_compiles(p) and _in_double(p.operators.factor) for p in assembly.propagators) and all(
        native_address(g.behaviour) for g in assembly.layout.groups
    )


def _in_double(factor: object) -> bool:
    """Whether it is one of the package's own factors, in double precision."""
    from ..propagator.cholesky.factor import CholeskyFactor

    if isinstance(factor, DiagonalFactor):
        return True
    return isinstance(factor, CholeskyFactor) and factor.dtype == np.float64


def _compiles(propagator: Propagator) -> TypeGuard[DirectPropagator | March[Any]]:
    """Direct propagators, and those of their like that say so."""
    if isinstance(propagator, March):
        return propagator.compiles
    return type(propagator) is DirectPropagator


def native_address(behaviour: object) -> int:
    """Address of a behaviour's native function, 0 where it has none."""
    found = getattr(behaviour, "native", None)
    return 0 if found is None else int(found())


class CompiledRun:
    """The compiled road of a run over one segment of time.

    Parameters
    ----------
    run : bound to the direction of windows of one instant. bonds : see ``Bonds.incoming``, where all are perfect.
    """

    def __init__(self, run: Run, bonds: Array | None = None) -> None:
        from ..march import classes, groups, instants, work

        self._run, self._kernels = run, instants
        assembly, direction = run.assembly, run.direction(1)
        self._direction = direction
        layout, settings = assembly.layout, run.settings
        propagators = [p for p in assembly.propagators if _compiles(p)]  # all, see ``marches``
        self._probes = SlideProbes(assembly, propagators, run.recorder.sliding)
        self._classes = classes.ClassTable(propagators, assembly.channels, self._probes.rows, layout.normal)
        self._groups = groups.GroupTable(
            layout.groups, [native_address(g.behaviour) for g in layout.groups], direction.local.z_sums
        )
        self._work = work.make_work(
            layout.n_flat,
            len(assembly.interfaces),
            settings.anderson_depth,
            settings.max_iterations,
            any(g.behaviour.elastic for g in layout.groups),
        )
        self._limits = _limits(settings, not layout.normal.all(), assembly.rest_traction)
        self._scheme = work.coefficients(assembly.scheme, assembly.dt, assembly.rest_traction)
        self._gap_start = np.concatenate([np.zeros(0), *(g.gap for g in layout.groups)])
        self._errors = np.empty((_LONGEST, settings.max_iterations))
        self._mismatches = np.empty((_LONGEST, settings.max_iterations))
        self._counts = np.zeros(_LONGEST, dtype=np.int64)
        self._bonds = np.zeros((0, 0)) if bonds is None else np.ascontiguousarray(bonds)
        self._threads = Threads(
            [float(row["n_panels"] * row["m"]) for row in self._classes.rows], settings.threads
        )
        self._states: list[object] = []
        self._per_instant = 0.0
        self.refused = False  # the instant after the last one needs the long road
        self.begin(run.recorder)

    def begin(self, recorder: Recorder) -> None:
        """Take up the next segment of time with the same operators."""
        from ..march.work import Flat, History

        assembly, direction = self._run.assembly, self._direction
        layout = assembly.layout
        self._classes.begin(len(assembly.time))
        self._groups.begin(recorder.gaps)
        ground, velocity, displacement = assembly.ground_tables()
        displacement = displacement + assembly.scheme.gap_lead(assembly.dt) * velocity
        acceleration = np.diff(velocity, axis=0, prepend=velocity[:1]) / assembly.dt  # not read at instant 0
        seen = displacement + self._scheme.layer_v * velocity + self._scheme.layer_a * acceleration
        self._flat = Flat(
            direction.k, direction.local.z, layout.area, direction.indicator.weights, direction.weight**2,
            layout.interface, layout.normal.astype(np.int64), ground, velocity, displacement, seen,
        )  # fmt: skip
        self._history = History(recorder.f_hat, recorder.w_hat, self._errors, self._mismatches, self._counts)

    def advance(self, n: int) -> int:
        """Solve up to n windows of one instant; how many converged (fewer: the next one needs the long road)."""
        run, work, state = self._run, self._work, self._run.state
        assembly, recorder = run.assembly, run.recorder
        longest = max(1, int(_SECONDS / self._per_instant)) if self._per_instant > 0 else _FIRST
        n = min(n, _LONGEST, longest, recorder.instants_unseen())
        before = clock.perf_counter()
        self._enter()
        first = assembly.propagators[0].state.instant + 1
        done = (self._march_together if self._threads.several else self._march)(first, n)
        if done:
            accounted = recorder.wants_energy
            tractions = [work.f_hat[c] if accounted else None for c in assembly.channels]
            self._classes.store(done, tractions)
            self._states = [p.state for p in assembly.propagators]
            state.f_hat, state.w_hat = work.f_hat.copy(), work.w_hat.copy()
            state.scales = Scales(float(work.scales[0]), (float(work.scales[1]), float(work.scales[2])))
            state.interface_indicator = work.interface_indicator.copy()
            run.take_gaps([gap.copy() for gap in self._groups.gaps])
            recorder.kept(assembly, done, self._probes, self._classes.probed)
            self._tell(first, done)
        run.count(int(work.marched[0]), int(work.marched[1]))
        self.refused = done < n
        seconds = clock.perf_counter() - before
        run.timings.global_stage += seconds
        self._per_instant = seconds / max(done, 1)
        return done

    def _march(self, first: int, n: int) -> int:
        """Up to n instants in one call; how many converged."""
        done: int = self._kernels.march_instants(
            self._classes.rows, self._groups.rows, self._flat, self._work, self._limits, self._scheme, self._history,
            self._gap_start, self._bonds, first, n,
        )  # fmt: skip
        return done

    def _march_together(self, first: int, n: int) -> int:
        """The same with the substructures on several threads."""
        kernels, scheme, rows, work = self._kernels, self._scheme, self._classes.rows, self._work
        for step in range(n):
            instant = first + step
            self._threads.each(lambda which, at=instant: kernels.predict_some(rows, scheme, at, which))  # type: ignore[misc]
            solved = kernels.solve_instant(
                rows, self._groups.rows, self._flat, work, self._limits, scheme, self._history, self._bonds, step,
                instant,
            )  # fmt: skip
            if not solved:
                return step
            work.marched[0] += self._threads.each(
                lambda which, at=instant: kernels.commit_some(rows, scheme, at, work, which)  # type: ignore[misc]
            )
            kernels.close_instant(
                self._groups.rows, self._flat, work, scheme, self._history, self._gap_start, instant
            )
        return n

    def _enter(self) -> None:
        """Bring the kernels' copies up to the state of the run."""
        work, state, propagators = self._work, self._run.state, self._run.assembly.propagators
        if len(self._states) != len(propagators) or any(
            p.state is not known for p, known in zip(propagators, self._states, strict=True)
        ):
            self._take_up()
        work.f_hat[:], work.w_hat[:] = state.f_hat, state.w_hat
        work.scales[:] = (state.scales.field, *state.scales.force)
        work.interface_indicator[:] = 0.0 if state.interface_indicator is None else state.interface_indicator
        work.marched[:] = 0
        for own, gap in zip(self._groups.gaps, self._run.gaps(), strict=True):
            own[:] = gap

    def _take_up(self) -> None:
        """Copy in what another road has left (what this one has left itself is kept to the last bit)."""
        self._classes.take_up()
        if not len(self._work.layer):
            return
        groups = self._run.assembly.layout.groups
        seen = left(self._run.assembly, self._run.gaps())
        for group, reach, jumps in zip(groups, self._groups.reaches, seen, strict=True):
            if group.behaviour.elastic:
                reach[:] = jumps * self._scheme.layer_rate

    def _tell(self, first: int, done: int) -> None:
        self._run.state.windows.told(first, self._counts[:done], self._errors[:done], self._mismatches[:done])


def _limits(settings: Settings, tangential: bool, rest_traction: float) -> Limits:
    from ..march.work import Limits

    return Limits(
        settings.tolerance, settings.force_tolerance, AT_REST, settings.max_iterations, PATIENCE, RECENT,
        STALL_ACCELERATED if settings.anderson_depth else STALL_PLAIN, TANGENTIAL_FLOOR, settings.relaxation, RANK,
        int(tangential), rest_traction, negligible(settings),
    )  # fmt: skip
