"""Directional derivatives of the outputs at the end of a communication step by the inputs over that step.

The step is solved anew from the state before it, once for the tangents of the interfaces and twice for each input, with
a little more and a little less of it (``latin.linearised_step``). While the contact state of no point changes, fields
are affine in the inputs and energies quadratic, so that the central difference is exact but for round-off. What counts
points (shares, iterations) does not change then: its derivative is 0. Counters and instants of events count as
constant, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..assembly.segments import Segment
from ..errors import InputError, Problem, SolverError
from ..latin.linearised_step import PointLaws, Tangents, march
from ..latin.record import Array
from ..latin.windows import Run
from .variable import input_of, is_wave
from .variables import EVENTS
from .windowed import LastStep, Windowed

_EFFECT = 1e-2  # on the tractions, relative: smaller ones are enlarged, as far as they exceed round-off
_LARGEST = 1e8  # factor
_CONSTANT = ("closed", "sticking", "slipping", *EVENTS)
_INSTANTS = tuple(last for last, _ in EVENTS.values())
_LINE_RATE = "a wave whose rate is 0 is the straight line to its value, which has no derivative by the rate"


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
        now = mode.keep_state()
        try:
            if self._laws is None:
                self._laws = self._linearise()
            size = self._size(name, what)
            rows = [self._row(self._perturbed(name, what, sign * size)) for sign in (1.0, -1.0)]
        finally:
            now()
        assert step is mode.last_step
        column = (rows[0] - rows[1]) / (2.0 * size)
        for i, output in enumerate(self._outputs):
            if output.startswith("solver.") or output.rpartition(".")[2] in _CONSTANT:
                column[i] = 0.0
        return np.asarray(column)

    def _linearise(self) -> list[list[PointLaws]]:
        """Solve the step again, for the laws about its solution."""
        tangents = Tangents()
        segment = self._solve("", "", 0.0, lambda run: run.all(tangents))
        if len(tangents.laws) != self._step.n or segment.windows.with_fallbacks():
            raise SolverError("there is no derivative here: the iteration of the last step needed a fall-back")
        points = segment.recorder.points()
        self._lowest = {name: int(f.gap[-1].argmin()) for name, f in points.items() if f.gap is not None}
        self._end = _fields(segment)
        return tangents.laws

    def _size(self, name: str, what: str) -> float:
        """Change of an input that changes the tractions and velocities noticeably: round-off counts the less."""
        value, rate = self._step.loads.get(name)
        size = max(abs(value), abs(rate) * self._step.h, 1.0) / (1.0 if what == "value" else self._step.h)
        changed = _fields(self._perturbed(name, what, size))
        effect = max(
            (
                float(np.linalg.norm(a - b)) / float(np.linalg.norm(b))
                for a, b in zip(changed, self._end, strict=True)
                if b.any()
            ),
            default=1.0,
        )
        return size * min(max(_EFFECT / effect, 1.0), _LARGEST) if effect > 0.0 else size

    def _perturbed(self, name: str, what: str, change: float) -> Segment:
        """The linearised step with another value or rate of an input."""
        laws = self._laws
        assert laws is not None
        return self._solve(name, what, change, lambda run: march(run, laws))

    def _solve(self, name: str, what: str, change: float, solve: Callable[[Run], None]) -> Segment:
        """The step from the state before it, with a change of an input."""
        step, mode = self._step, self._mode
        step.before()
        loads = step.loads.copy()
        if name:
            value, rate = loads.get(name)
            if what == "value":
                loads.set(name, value + change, rate)
            else:  # that of the causal line where none was set
                loads.set(name, value, loads.rates(mode.rule)[name] + change)
        amplitudes = loads.amplitudes(step.h, step.n, mode.rule)
        driving = loads.driving(amplitudes, step.h / step.n)
        return mode.run.advance(step.end, step.n, driving, solve=solve)

    def _row(self, segment: Segment) -> Array:
        """Scalar outputs at the end of a linearised step."""
        row, *_ = self._mode.outputs_of(segment, self._step.impulse)
        points = segment.recorder.points()
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
    return [np.concatenate([getattr(f, what)[-1].ravel() for f in points]) for what in ("traction", "velocity")]
