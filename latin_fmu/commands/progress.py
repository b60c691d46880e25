"""Progress lines of commands: elapsed and remaining time of work of several seconds, and the windows of a run."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Final, Self, TextIO

PATIENCE: Final = 3.0
"""Time before the first line of progress is shown, s."""
_AGAIN_ON_TERMINAL, _AGAIN_IN_LOG = 0.5, 10.0  # seconds between two lines: a log is read afterwards


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

    def reached(self, share: float, text: str | None = None) -> None:
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


class Progress(Waiting):
    """Waiting for a run: its set-up, and from the first call of ``update`` on its windows and their time left.

    Parameters
    ----------
    tolerance : value of sqrt(eta) at which a window is done; used to predict the end of a single window.
    quiet, stream, clock : as of ``Waiting``.
    """

    def __init__(
        self,
        tolerance: float,
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__("set-up", None, quiet, stream, clock)
        self._tolerance = tolerance
        self._state: tuple[int, int, int, float] | None = None  # of the last call, in one piece: a thread reads it
        self._origin = (0.0, 0)  # time and windows done at the first call: the set-up does not count
        self._first: tuple[float, float] | None = None  # time and log10 of the first error of a single window

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """Note ``done`` of ``total`` windows as finished, and the state of the current one.

        ``iteration`` counts from 1 in the current window and ``error`` is its sqrt(eta).
        """
        if self._state is None:
            self._origin = (self._clock(), done)
        if total == 1 and self._first is None and 0.0 < error < math.inf:
            self._first = (self._clock(), math.log10(error))
        self._state = done, total, iteration, error

    def line(self) -> str | None:
        """The line to show now, None within the first seconds."""
        if self._state is None or self._clock() - self._since < PATIENCE:
            return super().line()
        done, total, iteration, error = self._state
        begun, before = self._origin
        if total == 1:
            text, left = f"iteration {iteration}", self._single_window_left(error)
        else:
            text = f"{100 * done // max(total, 1)} % ({done} of {total} windows), iteration {iteration}"
            left = (self._clock() - begun) * (total - done) / (done - before) if done > before else None
        return f"{text}, sqrt(eta) {error:.1e}{_left(left)}"

    def _single_window_left(self, error: float) -> float | None:
        """Extrapolates log(error), which falls about linearly with the iterations, to the tolerance."""
        if self._first is None or not (0.0 < error < math.inf and self._tolerance > 0.0):
            return None
        since, at_first = self._first
        fallen, passed = at_first - math.log10(error), self._clock() - since
        if fallen <= 0.0 or passed <= 0.0:
            return None
        return max(0.0, (math.log10(error) - math.log10(self._tolerance)) * passed / fallen)


def _left(seconds: float | None) -> str:
    return "" if seconds is None else f", about {_amount(seconds)} left"


def _amount(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
