"""Progress of a run on a text stream: share done, error indicator, time left."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TextIO

_EVERY_ON_TERMINAL = 0.1
_EVERY_IN_LOG = 3.0


class Progress:
    """Prints how far a run is.

    On a terminal one line is refreshed in place; elsewhere (a log file) a line is written every few
    seconds, so that a short run writes none.

    Parameters
    ----------
    stream : where to write, usually ``sys.stderr``.
    tolerance : value of sqrt(eta) at which a window is done; used to foresee the end of a single window.
    clock : seconds from any origin; replaced in tests.
    """

    def __init__(self, stream: TextIO, tolerance: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._tolerance = tolerance
        self._clock = clock
        self._terminal = stream.isatty()
        self._shown = -math.inf if self._terminal else clock()
        self._width = 0
        self._first: tuple[float, float] | None = None  # time and log10 of the first error of a single window
        self._origin: tuple[float, int] | None = None  # time and windows done at the first call

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """Tell that ``done`` of ``total`` windows are finished and how the current one goes.

        ``iteration`` counts from 1 in the current window and ``error`` is its sqrt(eta). Cheap: most calls
        only look at the clock.
        """
        now = self._clock()
        if self._origin is None:
            self._origin = (now, done)
        if total == 1 and self._first is None and 0.0 < error < math.inf:
            self._first = (now, math.log10(error))
        if now - self._shown < (_EVERY_ON_TERMINAL if self._terminal else _EVERY_IN_LOG):
            return
        self._shown = now
        left = self._single_window_left(now, error) if total == 1 else self._windows_left(now, done, total)
        if total == 1:
            text = f"iteration {iteration}"
        else:
            text = f"{100 * done // max(total, 1)} % ({done} of {total} windows), iteration {iteration}"
        self._write(f"{text}, sqrt(eta) {error:.1e}{_left(left)}")

    def close(self) -> None:
        """Clear the refreshed line; does nothing elsewhere."""
        if self._terminal and self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()
            self._width = 0

    def _write(self, text: str) -> None:
        if self._terminal:
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def _windows_left(self, now: float, done: int, total: int) -> float | None:
        since, before = self._origin or (now, done)
        return (now - since) * (total - done) / (done - before) if done > before else None

    def _single_window_left(self, now: float, error: float) -> float | None:
        """Extrapolates log(error), which falls about linearly with the iterations, to the tolerance."""
        if self._first is None or not (0.0 < error < math.inf and self._tolerance > 0.0):
            return None
        since, at_first = self._first
        fallen = at_first - math.log10(error)
        if fallen <= 0.0 or now <= since:
            return None
        return max(0.0, (math.log10(error) - math.log10(self._tolerance)) * (now - since) / fallen)


def _left(seconds: float | None) -> str:
    if seconds is None:
        return ""
    if seconds < 90.0:
        return f", about {seconds:.0f} s left"
    if seconds < 5400.0:
        return f", about {seconds / 60.0:.0f} min left"
    return f", about {seconds / 3600.0:.1f} h left"
