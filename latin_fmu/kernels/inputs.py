"""Amplitudes of inputs inside a communication step, from what was set for it and what the steps before have left.

Over a communication step of ``total`` time steps from value V, rate r and the amplitude p reached before, at x time
steps from its start: HOLD V; RATE V + r x dt; LINE p + (V - p) x / total; CAUSAL as RATE, with the rate of the causal
line (``cosim.loads``) where none was ever set; PATH as LINE, with the rate r of a displacement after the step, where
the whole history is known. A motion starts at p by every rule, a displacement drives by its rate over the time step
that begins at an instant, at the end of a communication step by that over the last one. A wave without a rate is the
straight line from p, as if it had travelled for the step: a wave that is held gains energy, and so does one that is
extrapolated.

A communication step may begin and end inside a time step. The run stands at the last instant of its grid, and the
integral of the input since that instant is carried along. In the time step in which it began, a fraction f after its
first instant, a communication step drives the run by its own line u, extended to both instants, and a constant,

    s = u + (I - integral of u over the fraction f) / dt,    I : integral carried,

so that the time step has the integral of what was set: a held input its mean, a straight line across communication
points its own amplitude. Beginnings at instants have f = 0, no integral, and u alone. A displacement needs none: its
rate over the time step is that of the amplitudes that drive the run.

``memory`` (6, n_input) : REACHED amplitude at the end of the last communication step; BEFORE value set for that step;
HELD 1 where the value before that one was the same; RATED 1 where a rate other than 0 was set; CARRIED integral since
the last instant, s; DRIVEN amplitude that drove the run there. ``span`` : length of the last communication step, s, 0
before the first.

``begin`` : f. ``total`` : length of the communication step, time steps. ``whole`` : time steps that end in it.
``rest`` : fraction of a time step after the last of them.
"""

from __future__ import annotations

from typing import Any, Final

from ..compiled import entry, kernel

HOLD = 0
RATE = 1
LINE = 2
CAUSAL = 3
PATH = 4
"""Rules of interpolation."""
LOAD = 0
MOTION = 1
DISPLACEMENT = 2
WAVE = 3
"""Kinds of inputs."""
REACHED = 0
BEFORE = 1
HELD = 2
RATED = 3
CARRIED = 4
DRIVEN = 5
"""Rows of the memory."""
N_MEMORY: Final = 6
_SAME_STEP, _DRIFT = 1e-9, 1e-12
"""Of a time step, and of the time since the start: differences that add up from round-off."""


@kernel
def rate_over(inputs: Any, memory: Any, kinds: Any, e: int, span: float, rule: int) -> float:
    """Rate of an input over the communication step, s-1: that set, or that of the causal line."""
    n = len(kinds)
    value, rate = inputs[0][e], inputs[1][e]
    if rule != CAUSAL or kinds[e] == WAVE or rate != 0.0 or memory[RATED * n + e] != 0.0:
        return float(rate)
    # no step before, or a jump from a value that was held
    jump = span == 0.0 or memory[HELD * n + e] == 1.0
    return float(0.0 if jump else (value - memory[BEFORE * n + e]) / span)


@kernel
def amplitude(
    inputs: Any, memory: Any, kinds: Any, e: int, span: float, x: float, total: float, rule: int, dt: float
) -> float:
    """Amplitude of an input x time steps after the start of the communication step. ``inputs`` : values, rates set."""
    value = inputs[0][e]
    reached = memory[REACHED * len(kinds) + e]
    kind = kinds[e]
    if kind == WAVE and rule != HOLD and inputs[1][e] == 0.0:
        rule = LINE
    if rule == HOLD:
        return float(value)
    if rule in (LINE, PATH):
        # the value itself at the end, whatever the round-off
        return float(value if x == total else x * ((value - reached) / total) + reached)
    return float(value + rate_over(inputs, memory, kinds, e, span, rule) * (x * dt))


@kernel
def at_instant(
    inputs: Any, memory: Any, kinds: Any, e: int, span: float, j: int, begin: float, total: float, rule: int, dt: float
) -> float:
    """Amplitude of an input that drives the run after j of the time steps that the communication step ends."""
    n, kind = len(kinds), kinds[e]
    # a step that begins between two instants goes on from what drove the run, and so does a motion
    if j == 0 and (begin > 0.0 or kind not in (LOAD, WAVE)):
        return float(memory[DRIVEN * n + e])
    now = amplitude(inputs, memory, kinds, e, span, j - begin, total, rule, dt)
    if begin == 0.0 or j > 1 or kind == DISPLACEMENT:
        return now
    # the integral of a line is its middle value times its length
    middle = amplitude(inputs, memory, kinds, e, span, -0.5 * begin, total, rule, dt)
    return float(now + (memory[CARRIED * n + e] / dt - begin * middle))


@kernel
def drive(
    inputs: Any,
    memory: Any,
    kinds: Any,
    e: int,
    span: float,
    j: int,
    whole: int,
    begin: float,
    rest: float,
    rule: int,
    dt: float,
) -> float:
    """What drives the run after j of the ``whole`` time steps that a communication step ends: the amplitude, of a
    displacement its rate over the time step that begins there, after the last one over that."""
    total = (whole + rest) - begin
    if kinds[e] != DISPLACEMENT:
        return float(at_instant(inputs, memory, kinds, e, span, j, begin, total, rule, dt))
    if rule == PATH and j == whole:
        return float(inputs[1][e])
    first = max(min(j, whole - 1), 0)
    old = at_instant(inputs, memory, kinds, e, span, first, begin, total, rule, dt)
    return float((at_instant(inputs, memory, kinds, e, span, first + 1, begin, total, rule, dt) - old) / dt)


@kernel
def keep(
    inputs: Any,
    memory: Any,
    kinds: Any,
    span: float,
    done: int,
    whole: int,
    begin: float,
    rest: float,
    rule: int,
    dt: float,
) -> float:
    """Memory after ``done`` of the ``whole`` time steps, with which the communication step ends, at an instant unless
    they are all; its length, s."""
    n = len(kinds)
    total = (whole + rest) - begin
    behind = rest if done == whole else 0.0
    # length that was made, in time steps
    ended = (done + behind) - begin
    for e in range(n):
        value, carried = inputs[0][e], 0.0
        if behind > 0.0:
            # since the last instant: the whole step where it has reached none
            part = behind if done > 0 else ended
            middle = amplitude(inputs, memory, kinds, e, span, ended - 0.5 * part, total, rule, dt)
            # what was carried is carried on as long as no instant is reached
            carried = part * dt * middle + (memory[CARRIED * n + e] if done == 0 else 0.0)
        memory[DRIVEN * n + e] = at_instant(inputs, memory, kinds, e, span, done, begin, total, rule, dt)
        memory[REACHED * n + e] = amplitude(inputs, memory, kinds, e, span, ended, total, rule, dt)
        memory[CARRIED * n + e] = carried
        # BEFORE is still that of the step before
        memory[HELD * n + e] = 1.0 if span > 0.0 and value == memory[BEFORE * n + e] else 0.0
        memory[BEFORE * n + e] = value
        if inputs[1][e] != 0.0:
            memory[RATED * n + e] = 1.0
    return ended * dt


@kernel
def placed(instant: float, begin: float, end: float, length: float, off: float) -> tuple[int, float]:
    """Time steps from the ``instant`` up to the last one not beyond the end of a communication step, and the
    fraction that follows. ``end`` of the step since the start, ``length``, round-off of both ``off``: in time steps. An
    end within round-off of an instant is there; whole time steps from an instant end at one, whatever they add up
    to."""
    n, rest = int(length + 0.5), 0.0
    if begin > 0.0 or n == 0 or abs(length - n) > _SAME_STEP * length + off:
        n = int(max(end - instant, 0.0))
        rest = max(end - instant, 0.0) - n
        near = _SAME_STEP + _DRIFT * end + off
        # within round-off of the next instant
        if rest > 1.0 - near:
            n, rest = n + 1, 0.0
        elif rest < near and n > 0:
            rest = 0.0
        # no instant is reached: the fractions add up
        elif n == 0:
            rest = begin + length
    return n, rest


@entry("f8[::1], f8[::1], f8[::1], i8[::1], f8, f8, i8, f8, f8, f8[:, ::1]")
def interpolate(
    value: Any,
    rate: Any,
    memory: Any,
    kinds: Any,
    span: float,
    dt: float,
    rule: int,
    begin: float,
    rest: float,
    lines: Any,
) -> None:
    """Write what drives a run over a communication step into ``lines`` (n_input, whole + 1)."""
    whole = lines.shape[1] - 1
    for e in range(len(kinds)):
        for j in range(whole + 1):
            lines[e, j] = drive((value, rate), memory, kinds, e, span, j, whole, begin, rest, rule, dt)


@entry("f8[::1], f8[::1], f8[::1], i8[::1], f8, i8, f8[::1]")
def rates(value: Any, rate: Any, memory: Any, kinds: Any, span: float, rule: int, out: Any) -> None:
    """Write the rates of the inputs over a communication step into ``out`` (n_input,)."""
    for e in range(len(kinds)):
        out[e] = rate_over((value, rate), memory, kinds, e, span, rule)


@entry("f8[::1], f8[::1], f8[::1], i8[::1], f8, f8, i8, i8, i8, f8, f8 -> f8")
def accept(
    value: Any,
    rate: Any,
    memory: Any,
    kinds: Any,
    span: float,
    dt: float,
    rule: int,
    done: int,
    whole: int,
    begin: float,
    rest: float,
) -> float:
    """``keep`` for a caller in Python."""
    return float(keep((value, rate), memory, kinds, span, done, whole, begin, rest, rule, dt))
