"""How the iteration went, window by window: records that are written out when somebody looks at them.

The compiled march leaves tables of numbers for hundreds of windows; few runs are asked about all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

from .layout import Array, Index
from .record import WindowRecord


class WindowList(Sequence[WindowRecord]):
    """Records of windows in order; see ``keep`` for those that exist as numbers only."""

    def __init__(self) -> None:
        self._records: list[WindowRecord | tuple[int, int, Array, Array]] = []

    def append(self, record: WindowRecord) -> None:
        """Add a window."""
        self._records.append(record)

    def keep(self, first: int, counts: Index, errors: Array, mismatches: Array) -> None:
        """Add converged windows of one instant, from the instant ``first`` on.

        Parameters
        ----------
        counts : (n,) iterations. errors, mismatches : (n, most) after each of them, copied.
        """
        most = int(counts.max(initial=0))
        errors, mismatches = errors[:, :most].copy(), mismatches[:, :most].copy()
        self._records += zip(range(first, first + len(counts)), counts.tolist(), errors, mismatches, strict=True)

    def cut(self, length: int) -> list[WindowRecord]:
        """Take off what is beyond so many windows."""
        taken = self[length:]
        del self._records[length:]
        return taken

    def failed(self) -> list[WindowRecord]:
        """Windows that did not converge."""
        return [r for r in self._records if isinstance(r, WindowRecord) and not r.converged]

    def fallen(self) -> int:
        """Number of windows that needed a fall-back."""
        return sum(isinstance(r, WindowRecord) and bool(r.fallbacks) for r in self._records)

    def most_iterations(self) -> int:
        """Iterations of the window that took most."""
        counts = [r.iterations if isinstance(r, WindowRecord) else r[1] for r in self._records]
        return max(counts, default=0)

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, at: int) -> WindowRecord: ...
    @overload
    def __getitem__(self, at: slice) -> list[WindowRecord]: ...
    def __getitem__(self, at: int | slice) -> WindowRecord | list[WindowRecord]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(len(self._records)))]
        found = self._records[at]
        if not isinstance(found, WindowRecord):
            instant, used, errors, mismatches = found
            curves = errors[:used].tolist(), mismatches[:used].tolist()
            found = self._records[at] = WindowRecord(instant, instant, *curves, [], True, used - 1)
        return found
