"""List of the windows of a run: records, or tables of numbers from which they are made."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any, Final, overload

import numpy as np

from .assembly import Array, Index
from .record import WindowRecord

_CURVES: Final = ("error_indicator", "force_mismatch")


class WindowList(Sequence[WindowRecord]):
    """Records of windows in order.

    The compiled driver leaves tables of numbers for hundreds of windows (``keep``); their records are made when they
    are read, and not kept.
    """

    def __init__(self, records: Sequence[WindowRecord] = ()) -> None:
        self._records: dict[int, WindowRecord] = {}
        # converged windows of one instant: number of the first, its instant, iterations and Newton steps, ends of the
        # curves of each window, curves one after the other (padded, they would take several times as much memory)
        self._tables: list[tuple[int, int, Index, Index, Array, Array]] = []
        self._n = 0
        for record in records:
            self.append(record)

    def append(self, record: WindowRecord) -> None:
        """Add the record of a window."""
        self._records[self._n] = record
        self._n += 1

    def keep(self, first: int, counts: Index, errors: Array, residuals: Array) -> None:
        """Add converged windows of one instant, from the instant ``first`` on.

        Parameters
        ----------
        counts : (n, 2) iterations, and Newton steps among them. errors, residuals : (n, most) indicators and force
            residuals after each iteration, copied.
        """
        held = np.arange(errors.shape[1]) < counts[:, :1]
        curves = errors[held], residuals[held]
        self._tables.append((self._n, first, counts.copy(), np.cumsum(counts[:, 0]), *curves))
        self._n += len(counts)

    def cut(self, length: int) -> list[WindowRecord]:
        """Remove and return the windows beyond the first ``length``."""
        removed = self[length:]
        self._records = {at: record for at, record in self._records.items() if at < length}
        tables, self._tables = self._tables, []
        for at, first, counts, ends, *curves in tables:
            if at < length:
                last = min(length - at, len(counts))
                errors, residuals = (curve[: ends[last - 1]] for curve in curves)
                self._tables.append((at, first, counts[:last], ends[:last], errors, residuals))
        self._n = min(self._n, length)
        return removed

    def failed(self) -> list[WindowRecord]:
        """Windows that did not converge."""
        return [record for record in self._records.values() if not record.converged]

    def with_fallbacks(self) -> int:
        """Number of windows that needed a fall-back."""
        return sum(bool(record.fallbacks) for record in self._records.values())

    def most_iterations(self) -> int:
        """Largest number of iterations of a window."""
        return int(self.counts()[:, 0].max(initial=0))

    def disagreement(self) -> float:
        """Largest difference of the tractions of both stages in a window of several instants."""
        return max((record.disagreement for record in self._records.values()), default=0.0)

    def largest_error(self) -> float:
        """Largest sqrt(eta) of the accepted iterates."""
        errors = [record.final_error for record in self._records.values()]
        for _, _, _, ends, curve, _ in self._tables:
            errors += curve[ends - 1].tolist()
        return max(errors, default=0.0)

    def counts(self) -> Index:
        """Iterations and Newton steps among them of the windows, (n, 2), in any order."""
        tables = [table[2] for table in self._tables]
        if self._records or not tables:
            records = [(record.iterations, record.newton_steps) for record in self._records.values()]
            tables.insert(0, np.array(records, dtype=np.int64).reshape(-1, 2))
        return np.concatenate(tables) if len(tables) > 1 else tables[0]

    def part(self, first: int) -> dict[str, Any]:
        """The windows from number ``first`` on as plain arrays, for ``extend``."""
        records = self[first:]
        curves = [np.array([x for r in records for x in getattr(r, name)]) for name in _CURVES]
        return {
            "numbers": np.array(
                [
                    (r.first_instant, r.last_instant, r.converged, r.accepted, r.iterations, r.newton_steps)
                    for r in records
                ],
                dtype=np.int64,
            ).reshape(-1, 6),
            **dict(zip(_CURVES, curves, strict=True)),
            "disagreement": np.array([r.disagreement for r in records]),
            "fallbacks": {str(i): list(r.fallbacks) for i, r in enumerate(records) if r.fallbacks},
        }

    def extend(self, part: Mapping[str, Any]) -> None:
        """Add the windows of a ``part``."""
        numbers = part["numbers"]
        ends = np.cumsum(numbers[:, 4])[:-1]
        curves = [np.split(part[name], ends) if len(numbers) else [] for name in _CURVES]
        fallbacks, at = part["fallbacks"], 0
        while at < len(numbers):
            n = _plain(numbers[at:], fallbacks, at)
            if n:
                counts = np.ascontiguousarray(numbers[at : at + n, 4:])
                tables = (_padded(curve[at : at + n], counts[:, 0]) for curve in curves)
                self.keep(int(numbers[at, 0]), counts, *tables)
            else:
                first, last, done, accepted, _, steps = numbers[at].tolist()
                errors, residuals = (curve[at].tolist() for curve in curves)
                used = list(fallbacks.get(str(at), []))
                apart = float(part["disagreement"][at])
                self.append(WindowRecord(first, last, errors, residuals, used, bool(done), accepted, steps, apart))
            at += max(n, 1)

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, at: int) -> WindowRecord: ...
    @overload
    def __getitem__(self, at: slice) -> list[WindowRecord]: ...
    def __getitem__(self, at: int | slice) -> WindowRecord | list[WindowRecord]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(self._n))]
        at = range(self._n)[at]
        if at in self._records:
            return self._records[at]
        start, first, counts, ends, *flat = self._tables[bisect_right(self._tables, at, key=itemgetter(0)) - 1]
        row, instant, (count, steps) = at - start, first + at - start, counts[at - start].tolist()
        errors, residuals = (curve[ends[row] - count : ends[row]].tolist() for curve in flat)
        return WindowRecord(instant, instant, errors, residuals, [], True, count - 1, steps)


def _plain(numbers: Index, fallbacks: Mapping[str, Any], at: int) -> int:
    """Number of windows at the start of ``numbers`` that are successive instants, converged without fall-back; ``at``:
    number of the first one among the keys of ``fallbacks``."""
    first, last, converged, accepted, counts, _ = numbers.T
    plain = (first == last) & (converged == 1) & (accepted == counts - 1) & (first == first[0] + np.arange(len(first)))
    plain &= [str(at + i) not in fallbacks for i in range(len(first))]
    return len(plain) if plain.all() else int(np.argmin(plain))


def _padded(curves: Sequence[Array], counts: Index) -> Array:
    """Curves of different lengths as rows of a table."""
    table = np.full((len(curves), int(counts.max(initial=0))), np.nan)
    for row, curve in zip(table, curves, strict=True):
        row[: len(curve)] = curve
    return table
