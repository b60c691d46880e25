"""Directional derivatives of the outputs at the end of a communication step by the inputs over that step.

The step is solved anew from the state before it, once for the tangents of the interfaces and twice for each input, with
a little more and a little less of it. While the contact state of no point changes, fields are
affine in the inputs and energies quadratic, so that the central difference is exact but for round-off. What counts
points (shares, iterations) does not change then: its derivative is 0. Counters and instants of events count as
constant, too.

While no point opens or closes, sticks or begins to slip, the end of a segment of windows of one instant depends
smoothly on its loads and motions. ``Tangents`` keeps the laws of the interfaces about the solution at every instant,

    F_hat = F* + J (jump + g - jump* - g*),        J = dF_hat / djump  (``laws.dispatch.tangent``),

with * the solution, jump the free velocities and g the normalised gaps of the points. ``march`` solves the instants
of a segment with these laws in the place of their own. The fields are then affine in the histories that drive the
segment, and energies quadratic: a central difference of any length is the derivative but for round-off. In slip J is
the consistent tangent; the traction keeps to the cone and to the direction of slip.

One instant is a linear system for the incoming quantity, q = F_hat + k W_hat with both stages as an affine map of q. It
is solved by GMRES to round-off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg as spla

from ..assembly.segments import Segment
from ..errors import InputError, Problem, SolverError
from ..kernels import entries
from ..latin.assembly import Array
from ..latin.outcome import WindowRecord
from ..latin.run_image import Stages, rate_of
from ..latin.windows import Run
from ..laws.dispatch import law_tangents
from .variable import input_of, is_wave
from .variables import EVENTS, INNER_TIME
from .windowed import LastStep, Windowed

_EFFECT = 1e-2  # on the tractions, relative: smaller ones are enlarged, as far as they exceed round-off
_LARGEST = 1e8  # factor
_CONSTANT = ("closed", "sticking", "slipping", INNER_TIME, *EVENTS)
_INSTANTS = tuple(last for last, _ in EVENTS.values())
_LINE_RATE = "a wave whose rate is 0 is the straight line to its value, which has no derivative by the rate"
_ROUNDS, _SMALL, _ENOUGH = 6, 1e-14, 1e-9
"""Solutions of the system of an instant, each for the residual of the last; residual over q at which they end, and
above which there is no derivative."""
_BASIS, _PART = 200, 1e-8  # directions of GMRES; part of a residual that one solution leaves


class Derivatives:
    """Derivatives about the last step of a run in windowed mode.

    Parameters
    ----------
    mode : the run, at the end of its last step; it is the same again after each call. outputs : names, in the order of
        the rows.

    Raises
    ------
    InputError : there is no step to differentiate, or its windows have several instants.
    """

    def __init__(self, mode: Windowed, outputs: Sequence[str]) -> None:
        if mode.last_step is None:
            what = "no step was made since the start, or since a state was restored"
            raise InputError([Problem("directional derivative", what, None, None, "make a step first")])
        if mode.run.problem.settings.window != 1:
            what, remedy = "of windows of several instants are not available", "solver.window = 1"
            raise InputError([Problem("directional derivatives", what, None, None, remedy)])
        self._mode, self._step, self._outputs = mode, mode.last_step, list(outputs)
        self._laws: list[list[PointLaws]] | None = None
        self._lowest: dict[str, int] = {}  # points with the smallest gaps, by interface
        self._columns: dict[str, Array] = {}

    def of(self, step: LastStep | None) -> bool:
        """Whether these are derivatives about a step."""
        # the same object: a step made again after a rollback is another one
        return step is self._step

    def product(self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]) -> Array:
        """Sum over the inputs of d unknown / d known times ``seed``, (n_unknown,).

        knowns : names of variables, value or rate of an input.

        Raises
        ------
        InputError : a variable that is no output, or no input. SolverError : the linear system has no solution.
        """
        problems = [Problem(name, "is not an output of this model") for name in unknowns if name not in self._outputs]
        problems += [
            Problem(name, "is the instant of an event, whose derivative is not available", remedy="leave it out")
            for name in unknowns
            if name.rpartition(".")[2] in _INSTANTS
        ]
        problems += [Problem(name, "is not an input of this model") for name in knowns if not self._is_input(name)]
        problems += [Problem(name, _LINE_RATE) for name in knowns if self._is_line(*input_of(name))]
        if problems:
            raise InputError(problems, "there is no directional derivative")
        places = [self._outputs.index(name) for name in unknowns]
        total = np.zeros(len(places))
        for name, factor in zip(knowns, seed, strict=True):
            # one column for each input, kept as long as the step is the last one
            if name not in self._columns:
                self._columns[name] = self._column(*input_of(name))
            total += factor * self._columns[name][places]
        return total

    def _is_input(self, name: str) -> bool:
        load, what = input_of(name)
        return load in self._step.loads.names and what in ("value", "rate")

    def _is_line(self, name: str, what: str) -> bool:
        return what == "rate" and is_wave(name) and self._step.loads.get(name)[1] == 0.0

    def _column(self, name: str, what: str) -> Array:
        """d outputs / d input, (n_output,)."""
        mode, step = self._mode, self._step
        if not step.n:  # no time step ended in it: outputs are held
            return np.zeros(len(self._outputs))
        # the run stands at the end of the step, and the segments below start before it
        now = mode.run.get_state()
        try:
            if self._laws is None:
                self._laws = self._linearise()
            size = self._size(name, what)
            rows = [self._row(self._perturbed(name, what, sign * size)) for sign in (1.0, -1.0)]
        finally:
            mode.run.set_state(now)
        assert step is mode.last_step
        # exact for fields that are affine, and energies that are quadratic in the input
        column = (rows[0] - rows[1]) / (2.0 * size)
        for i, output in enumerate(self._outputs):
            if output.startswith("solver.") or output.rpartition(".")[2] in _CONSTANT:
                column[i] = 0.0
        return np.asarray(column)

    def _linearise(self) -> list[list[PointLaws]]:
        """Solve the step again, for the laws about its solution."""
        tangents = Tangents()
        segment = self._solve("", "", 0.0, lambda run: run.all(tangents))
        # one set of laws is needed for each instant, those of its solution
        if len(tangents.laws) != self._step.n or segment.windows.with_fallbacks():
            raise SolverError("there is no derivative here: the iteration of the last step needed a fall-back")
        points = segment.recorder.points()
        self._lowest = {name: int(f.gap[-1].argmin()) for name, f in points.items() if f.gap is not None}
        self._end = _fields(segment)
        return tangents.laws

    def _size(self, name: str, what: str) -> float:
        """Change of an input that changes the tractions and velocities noticeably: round-off counts the less."""
        value, rate = self._step.loads.get(name)
        h = self._step.h
        # a rate counts by what it adds over the step
        size = max(abs(value), abs(rate) * h, 1.0) / (1.0 if what == "value" else h)
        changed = _fields(self._perturbed(name, what, size))
        effect = max(
            (
                float(np.linalg.norm(a - b)) / float(np.linalg.norm(b))
                for a, b in zip(changed, self._end, strict=True)
                if b.any()
            ),
            default=1.0,
        )
        # a small effect is enlarged: the round-off of the marches is that of their whole fields
        return size * min(max(_EFFECT / effect, 1.0), _LARGEST) if effect > 0.0 else size

    def _perturbed(self, name: str, what: str, change: float) -> Segment:
        """The linearised step with another value or rate of an input."""
        laws = self._laws
        assert laws is not None
        return self._solve(name, what, change, lambda run: march(run, laws))

    def _solve(self, name: str, what: str, change: float, solve: Callable[[Run], None]) -> Segment:
        """The step from the state before it, with a change of an input."""
        step, mode = self._step, self._mode
        # the loads of the step stay as they are: ``last_step`` is used for every input
        step.before()
        loads = step.loads.copy()
        if name:
            value, rate = loads.get(name)
            if what == "value":
                loads.set(name, value + change, rate)
            else:  # that of the causal line where none was set
                loads.set(name, value, loads.rates(mode.rule)[name] + change)
        return mode.advance(step.n, loads.driving(step.part, mode.run.dt, mode.rule), solve)

    def _row(self, segment: Segment) -> Array:
        """Scalar outputs at the end of a linearised step."""
        row = self._mode.outputs_of(segment)
        points = segment.recorder.points()
        # the smallest gap is that of one point, and stays with it
        for name, point in self._lowest.items():
            gap = points[name].gap
            assert gap is not None
            row[self._outputs.index(f"interface.{name}.smallestGap")] = gap[-1, point]
        return row


def _fields(segment: Segment) -> list[Array]:
    """Tractions and velocities of the interfaces at the end of a segment."""
    points = segment.recorder.points().values()
    if not points:
        return []
    # apart, since each is compared in its own unit
    return [np.concatenate([getattr(f, what)[-1].ravel() for f in points]) for what in ("traction", "velocity")]


@dataclass(frozen=True)
class PointLaws:
    """Laws of the points of a group about a solution.

    Attributes
    ----------
    jump, traction : (p, h). normalised_gap : as the law takes it, (p,) or (p, h). tangent : (p, h, h), Pa s m-1.
    moves : of the shape of ``normalised_gap``: 1 where it changes with the gap, 0 where a penetration stays as it is.
    """

    jump: Array
    normalised_gap: Array
    traction: Array
    tangent: Array
    moves: Array

    def at(self, jump: Array, normalised_gap: Array) -> Array:
        """Tractions (p, h) by the tangent."""
        change = jump - self.jump
        # normalised to a velocity, so that it adds to the jump
        opening = self.moves * (normalised_gap - self.normalised_gap)
        if opening.ndim == 2:
            change = change + opening
        else:
            # one gap a point opens along the normal, component 0
            change[:, 0] += opening
        traction: Array = self.traction + np.einsum("pab,pb->pa", self.tangent, change)
        return traction


class Tangents:
    """A ``WindowMonitor`` that keeps the laws about the solution of each instant, one window after the other.

    Attributes
    ----------
    laws : per instant those of the groups.
    """

    def __init__(self) -> None:
        self.laws: list[list[PointLaws]] = []

    def instants(self, _run: Run) -> int:
        """One instant a call: after it the fields of the local stage are those of the solution."""
        return 1

    def check(self, run: Run) -> bool:
        """Keep the laws about the last solved instant."""
        if run.assembly.instant > len(self.laws):
            stages = Stages(run.image, run.direction(1), 1, run.assembly.instant)
            self.laws.append([_about(stages, g) for g in range(len(run.image.groups))])
        return False

    def stops(self) -> bool:
        """False: the run is never stopped."""
        return False


def _about(stages: Stages, g: int) -> PointLaws:
    """Laws of a group about the last local stage."""
    image, group = stages.image, stages.direction.assembly.layout.groups[g]
    points, h, elastic = group.n_point, group.n_component, group.behaviour.elastic
    # elastic laws take a displacement jump in each component, others the normal gap
    width = (points, h) if elastic else (points,)
    # copies: the next local stage writes to the same places
    jump, traction = (image.group_field(g, name, points, h).copy() for name in ("jump", "traction"))
    normalised_gap, start = image.group_field(g, "reach", *width).copy(), image.group_field(g, "opened", 4, *width)[3]
    z = stages.direction.group_fields()[g]["z_sum"]
    tangent = law_tangents(
        int(image.groups[g]["law"]), jump, z, normalised_gap, rate_of(image, group), group.parameters
    )
    # ``max(gap, 0)``: a point that overlaps does not move with its gap
    moves = np.ones(width) if elastic else (start >= image.run[0]["deepest"]).astype(float)
    if elastic and group.behaviour.opens:  # the tractions of friction follow the velocities alone
        moves[:, 1:] = 0.0
    return PointLaws(jump, normalised_gap, traction, tangent, moves)


def march(run: Run, laws: list[list[PointLaws]]) -> None:
    """Solve the segment of a run, which has begun it, with the laws about a solution.

    Raises
    ------
    SolverError : the linear system of an instant cannot be solved: several interfaces hold a point, or nothing does.
    """
    image, kept = run.image, {name: run.image.run[0][name] for name in ("deepest", "rest_traction", "reuse", "make_up")}
    run.use_single_instants()
    # no bounds and no rules by size: the march is affine in what drives it
    image.set({"deepest": -np.inf, "rest_traction": -1.0, "reuse": -1.0, "make_up": 0.0})
    try:
        for at, about in enumerate(laws):
            instant = _Instant(run, at + 1, about)
            instant.solve()
            run.windows.append(instant.end())
    finally:
        # after an error, too: the run goes on with its own rules
        image.set(kept)


class _Instant:
    """One instant of a linearised segment."""

    def __init__(self, run: Run, first: int, laws: list[PointLaws]) -> None:
        self._run, self._first, self._laws = run, first, laws
        self._stages = Stages(run.image, run.direction(1), 1, first)
        self._k = self._stages.direction.k

    def solve(self) -> None:
        """Solve for q; raises SolverError."""
        image, n = self._run.image, self._run.image.n_flat
        image.call(entries.OPEN, 1, self._first - 1)
        # motions without traction, once: no residual changes them
        for c in range(len(image.propagators)):
            image.call(entries.PREDICT, c, self._first)
        if not n:
            return
        image.call(entries.FIRST_GUESS, self._first)
        # a copy: ``_residual`` writes q into the image
        q = image.field("q", n).copy()
        residual = self._residual(q)
        for _ in range(_ROUNDS):
            size = float(np.linalg.norm(residual))
            if size <= _SMALL * np.linalg.norm(q):
                break
            base, unit = residual, size  # steps of this length keep the digits of the difference

            def applied(x: Array, q: Array = q, base: Array = base, unit: float = unit) -> Array:
                length = float(np.linalg.norm(x))
                if length == 0.0:
                    return np.zeros_like(x)
                step = unit / length
                # -dr/dq x, so that the solution for the residual is the change of q
                return np.asarray((base - self._residual(q + step * x)) / step)

            system = spla.LinearOperator((n, n), applied, dtype=float)
            # ``maxiter`` counts restarts of the basis
            change, _ = spla.gmres(system, residual, rtol=_PART, atol=0.0, restart=min(n, _BASIS), maxiter=2)
            trial = self._residual(q + change)
            # written so that NaN ends it
            if not np.linalg.norm(trial) < size:
                break
            q, residual = q + change, trial
        # of the q that is kept: the loop may end on a trial that was refused
        left = float(np.linalg.norm(self._residual(q)))
        if not left <= _ENOUGH * np.linalg.norm(q):
            raise SolverError(
                "there is no derivative here: the interfaces about the present solution have no unique solution "
                f"(residual {left:.2g} of {np.linalg.norm(q):.2g})"
            )

    def _residual(self, q: Array) -> Array:
        """F_hat + k W_hat - q of both stages."""
        image, n = self._run.image, self._run.image.n_flat
        image.field("q", n)[:] = q
        image.call(entries.LINEAR_STAGE, 1, self._first, 0)
        image.call(entries.OUTGOING, 0)
        for g, law in enumerate(self._laws):
            image.call(entries.PREPARE, g, 0)
            jump, normalised_gap = (
                image.group_field(g, "jump", *law.jump.shape),
                image.group_field(g, "reach", *law.normalised_gap.shape),
            )
            image.group_field(g, "traction", *law.jump.shape)[...] = law.at(jump, normalised_gap)
            image.call(entries.FINISH, g, 0, 1)
        return np.asarray(image.field("local_f", n) + self._k * image.field("local_w", n) - q)

    def end(self) -> WindowRecord:
        """Move the substructures to the end of the instant and record it; its window."""
        run, image = self._run, self._run.image
        image.set({"first_row": self._first})
        run.end_instant(self._stages)
        return WindowRecord(self._first, self._first, [0.0], [0.0], converged=True)
