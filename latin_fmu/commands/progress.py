"""Progress lines of commands: iterations of a run; elapsed and remaining time of other work of several seconds."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Final, Self, TextIO

_EVERY_ON_TERMINAL, _EVERY_IN_LOG = 0.1, 3.0  # seconds between two lines of progress
PATIENCE: Final = 3.0
"""Time before the first line of progress is shown, s."""
_AGAIN_ON_TERMINAL, _AGAIN_IN_LOG = 0.5, 10.0  # seconds between two lines of a wait


class Line:
    """A line of a stream that is refreshed in place on a terminal, and a line each time elsewhere."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.terminal = stream.isatty()
        self._width = 0

    def write(self, text: str) -> None:
        """Show ``text`` in the place of what is there."""
        if self.terminal:
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def clear(self) -> None:
        """Clear the refreshed line; does nothing elsewhere."""
        if self.terminal and self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()
            self._width = 0


class Waiting:
    """Context in which a thread shows the present work, its time so far, and the time left where it can be estimated.

    Nothing is shown in the first ``PATIENCE`` seconds.

    Parameters
    ----------
    text : the work. seconds : it is expected to take, None where this is not known. quiet : show nothing.
    stream : stderr where None. clock : seconds from any origin.
    """

    def __init__(
        self,
        text: str,
        seconds: float | None = None,
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._text, self._seconds, self._quiet, self._clock = text, seconds, quiet, clock
        self._stream = sys.stderr if stream is None else stream
        self._line = Line(self._stream)
        self._since, self._share = clock(), 0.0
        self._over, self._lock = threading.Event(), threading.Lock()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        if not self._quiet:
            self._thread = threading.Thread(target=self._show, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Clear the line, and show nothing more."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        self._line.clear()

    def update(self, share: float, text: str | None = None) -> None:
        """``share`` of the work is done; ``text``: what is being done now."""
        self._share, self._text = share, self._text if text is None else text

    def log(self, text: str) -> None:
        """Print a line that stays."""
        if not self._quiet:
            with self._lock:
                self._line.clear()
                self._stream.write(text + "\n")
                self._stream.flush()

    def line(self) -> str | None:
        """The line to show now, None within the first seconds."""
        passed = self._clock() - self._since
        if passed < PATIENCE:
            return None
        whole = passed / self._share if self._share > 0.0 else self._seconds
        left = None if whole is None else max(whole - passed, 0.0)
        return f"{self._text}: {_amount(passed)} so far{_left(left)}"

    def _show(self) -> None:
        again = _AGAIN_ON_TERMINAL if self._line.terminal else _AGAIN_IN_LOG
        wait = PATIENCE
        while not self._over.wait(wait):
            with self._lock:
                if (text := self.line()) is not None:
                    self._line.write(text)
            wait = again


class Progress:
    """Prints the progress of a run.

    On a terminal one line is refreshed in place; elsewhere (a log file) a line is written every few
    seconds, so that a short run writes none.

    Parameters
    ----------
    stream : where to write, usually ``sys.stderr``.
    tolerance : value of sqrt(eta) at which a window is done; used to predict the end of a single window.
    clock : seconds from any origin; replaced in tests.
    """

    def __init__(self, stream: TextIO, tolerance: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._line = Line(stream)
        self._tolerance = tolerance
        self._clock = clock
        self._shown = -math.inf if self._line.terminal else clock()
        self._first: tuple[float, float] | None = None  # time and log10 of the first error of a single window
        self._origin: tuple[float, int] | None = None  # time and windows done at the first call
        self._set_up = Waiting("set-up", stream=stream, clock=clock)

    def begin(self) -> Self:
        """Show how long the set-up takes, until the first call of ``update``."""
        self._set_up.__enter__()
        return self

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """Report ``done`` of ``total`` windows as finished, and the state of the current one.

        ``iteration`` counts from 1 in the current window and ``error`` is its sqrt(eta). Cheap: most calls
        only read the clock.
        """
        now = self._clock()
        if self._origin is None:
            self._set_up.close()
            self._origin = (now, done)
        if total == 1 and self._first is None and 0.0 < error < math.inf:
            self._first = (now, math.log10(error))
        if now - self._shown < (_EVERY_ON_TERMINAL if self._line.terminal else _EVERY_IN_LOG):
            return
        self._shown = now
        left = self._single_window_left(now, error) if total == 1 else self._windows_left(now, done, total)
        if total == 1:
            text = f"iteration {iteration}"
        else:
            text = f"{100 * done // max(total, 1)} % ({done} of {total} windows), iteration {iteration}"
        self._line.write(f"{text}, sqrt(eta) {error:.1e}{_left(left)}")

    def close(self) -> None:
        """Clear the refreshed line; does nothing elsewhere."""
        self._set_up.close()
        self._line.clear()

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
    return "" if seconds is None else f", about {_amount(seconds)} left"


def _amount(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
