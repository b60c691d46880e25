"""Directional derivatives of the outputs at the end of a communication step by the inputs over that step.

The kernels make the step anew from the state before it (``kernels.derivatives``), once for each input of which a
derivative is requested; the result is kept until the next step. Counters and instants of events count as constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..errors import InputError, Problem, SolverError
from ..kernels import entries
from ..kernels.communication import BEYOND_LAWS
from ..kernels.derivatives import OWN_LAW, SINGULAR, UNSOLVED
from ..latin.outcome import Array
from ..latin.run_image import RELAXATION
from ..machine import one_thread
from ..propagator.image import aside
from .output_table import EVENTS
from .variable import input_of, is_wave
from .windowed import LastStep, Windowed

_INSTANTS = tuple(row.name for row in EVENTS.rows if row.unit)
_WHY_NOT: Final = {
    UNSOLVED: "the iteration of the last step needed a fall-back",
    SINGULAR: "the interfaces about the present solution have no unique solution",
    OWN_LAW: "a law of an interface is written in Python, and only laws of the package have their tangents in kernels",
    BEYOND_LAWS: "the step is longer than the time laws of the scene are known",
}
_RELAXED: Final = {"depth": 0, "relaxation": RELAXATION}
_FROM_START: Final = "the state at t = 0 is known for the start value of this input alone: make a second step"
_MEAN: Final = "is a mean over two time steps in an explicit march, which the step made anew does not give"
_LINE_RATE = "a wave whose rate is 0 is the straight line to its value, which has no derivative by the rate"


def _refusal(status: int) -> SolverError:
    return SolverError(f"there is no derivative here: {_WHY_NOT.get(status, _FROM_START)}")


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
        InputError : a variable that is no output, or no input. SolverError : there is no unique derivative.
        """
        problems = [Problem(name, "is not an output of this model") for name in unknowns if name not in self._outputs]
        problems += [
            Problem(name, "is the instant of an event, whose derivative is not available", remedy="leave it out")
            for name in unknowns
            if name.rpartition(".")[2] in _INSTANTS
        ]
        problems += [
            Problem(name, _MEAN, remedy='leave it out, or use propagator "direct"')
            for name in unknowns
            if name in self._mode.incomplete
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
        """d outputs / d input, (n_output,). Raises SolverError, InputError."""
        n_output = len(self._outputs)
        if not self._step.n:  # no time step ended in it: outputs are held
            return np.zeros(n_output)
        kernels, step, image = self._mode.kernels, self._mode.kernels.origin, self._mode.kernels.image
        assert step is not None
        made = step.state["made"]
        if made:
            kernels.tabulate(made, step.n)
        else:  # the state at t = 0 follows from the inputs, too
            if any(row["law"] < 0 for row in image.groups):
                raise _refusal(OWN_LAW)
            image = self._mode.at_start()
        image.set({"first_row": 0})
        which = 2 * kernels.sources.inputs.index(name) + int(what == "rate")
        kept = {name: image.run_fields[name] for name in _RELAXED}
        for rules in (kept, _RELAXED):  # after a stall
            with one_thread(), aside(image, image.call(entries.DERIVE, -1)), np.errstate(all="ignore"):
                try:
                    image.set(rules)
                    if made:
                        image.state[:] = step.state["state"]
                    kernels.give(image, step.loads, step.part, made)
                    status = image.call(entries.DERIVE, which, self._mode.rule, step.n, step.part.n)
                    column: Array = image.field("output", n_output).copy()
                finally:
                    image.set(kept)
            if status != UNSOLVED:
                break
        if status != 0:
            raise _refusal(status)
        return column
