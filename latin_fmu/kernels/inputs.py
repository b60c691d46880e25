"""Amplitudes of inputs inside a communication step, from what was set for it and what the steps before have left.

Over n time steps from value V, rate r and the amplitude p reached before: HOLD V; RATE V + r t; LINE from p to V;
CAUSAL as RATE, with the rate of the causal line (``cosim.loads``) where none was ever set. A motion starts at p by
every rule, a displacement drives by its rate over the time step. A wave without a rate is the straight line from p,
as if it had travelled for the step: a wave that is held gains energy, and so does one that is extrapolated.

``memory`` (5, n_input) : REACHED, SLOPE amplitude at the end of the last communication step and its rate there, s-1;
BEFORE value set for that step; HELD 1 where the value before that one was the same; RATED 1 where a rate other than 0
was set. ``span`` : length of the last communication step, s, 0 before the first.
"""

from __future__ import annotations

from typing import Any, Final

from ..compiled import entry, kernel

HOLD, RATE, LINE, CAUSAL = 0, 1, 2, 3
"""Rules of interpolation."""
LOAD, MOTION, DISPLACEMENT, WAVE = 0, 1, 2, 3
"""Kinds of inputs."""
REACHED, SLOPE, BEFORE, HELD, RATED = 0, 1, 2, 3, 4
"""Rows of the memory."""
N_MEMORY: Final = 5


@kernel
def rate_over(given: Any, memory: Any, kinds: Any, e: int, span: float, rule: int) -> float:
    """Rate of an input over the communication step, s-1: that set, or that of the causal line."""
    n = len(kinds)
    value, rate = given[0][e], given[1][e]
    if rule != CAUSAL or kinds[e] == WAVE or rate != 0.0 or memory[RATED * n + e] != 0.0:
        return float(rate)
    held = span == 0.0 or memory[HELD * n + e] == 1.0
    return float(0.0 if held else (value - memory[BEFORE * n + e]) / span)


@kernel
def amplitude(
    given: Any, memory: Any, kinds: Any, e: int, span: float, j: int, whole: int, rule: int, dt: float
) -> float:
    """Amplitude of an input after j of the time steps of the communication step. ``given`` : values and rates set."""
    value, reached, kind = given[0][e], memory[REACHED * len(kinds) + e], kinds[e]
    if kind == WAVE and rule != HOLD and given[1][e] == 0.0:
        rule = LINE
    if j == 0 and (rule == LINE or kind not in (LOAD, WAVE)):
        return float(reached)
    if rule == HOLD:
        return float(value)
    if rule == LINE:
        return float(value if j == whole else j * ((value - reached) / whole) + reached)
    return float(value + rate_over(given, memory, kinds, e, span, rule) * (j * dt))


@kernel
def drive(given: Any, memory: Any, kinds: Any, e: int, span: float, j: int, whole: int, rule: int, dt: float) -> float:
    """What drives the run after j of the time steps: the amplitude, of a displacement its rate over the time step."""
    now = amplitude(given, memory, kinds, e, span, j, whole, rule, dt)
    if kinds[e] != DISPLACEMENT:
        return now
    if j == 0:
        return float(memory[SLOPE * len(kinds) + e])
    return (now - amplitude(given, memory, kinds, e, span, j - 1, whole, rule, dt)) / dt


@kernel
def keep(given: Any, memory: Any, kinds: Any, span: float, done: int, whole: int, rule: int, dt: float) -> None:
    """Memory after ``done`` of the time steps, with which the communication step ends."""
    n = len(kinds)
    for e in range(n):
        value = given[0][e]
        last = amplitude(given, memory, kinds, e, span, done, whole, rule, dt)
        old = amplitude(given, memory, kinds, e, span, done - 1, whole, rule, dt)
        memory[SLOPE * n + e], memory[REACHED * n + e] = (last - old) / dt, last
        memory[HELD * n + e] = 1.0 if span > 0.0 and value == memory[BEFORE * n + e] else 0.0
        memory[BEFORE * n + e] = value
        if given[1][e] != 0.0:
            memory[RATED * n + e] = 1.0


@entry("f8[::1], f8[::1], f8[::1], i8[::1], f8, f8, i8, f8[:, ::1]")
def interpolate(value: Any, rate: Any, memory: Any, kinds: Any, span: float, dt: float, rule: int, lines: Any) -> None:
    """Write what drives a run over a communication step into ``lines`` (n_input, whole + 1)."""
    whole = lines.shape[1] - 1
    for e in range(len(kinds)):
        for j in range(whole + 1):
            lines[e, j] = drive((value, rate), memory, kinds, e, span, j, whole, rule, dt)


@entry("f8[::1], f8[::1], f8[::1], i8[::1], f8, i8, f8[::1]")
def rates(value: Any, rate: Any, memory: Any, kinds: Any, span: float, rule: int, made: Any) -> None:
    """Write the rates of the inputs over a communication step into ``made`` (n_input,)."""
    for e in range(len(kinds)):
        made[e] = rate_over((value, rate), memory, kinds, e, span, rule)


@entry("f8[::1], f8[::1], f8[::1], i8[::1], f8, f8, i8, i8, i8")
def accept(
    value: Any, rate: Any, memory: Any, kinds: Any, span: float, dt: float, rule: int, done: int, whole: int
) -> None:
    """``keep`` for a caller in Python."""
    keep((value, rate), memory, kinds, span, done, whole, rule, dt)
