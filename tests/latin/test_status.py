"""Records of windows that are written out on demand, against plain lists of records."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.latin.outcome import WindowRecord
from latin_fmu.latin.status import WindowList, with_work


@pytest.fixture
def both() -> tuple[WindowList, list[WindowRecord]]:
    """A list with windows of both kinds, and what it should hold."""
    errors = np.array([[0.5, 1e-4, np.nan], [1e-5, 7.0, 7.0], [0.3, 0.2, 1e-4]])
    windows, counts = WindowList(), np.array([[2, 0, 0], [1, 0, 0], [3, 1, 2]])
    first = WindowRecord(1, 4, [0.1, 0.01], [np.nan, 0.5], ["relaxation 1/2"], False, 1)
    windows.append(first)
    windows.keep(5, counts, errors, 2.0 * errors, np.array([0.0, 1e-4, 1e-5]))
    last = WindowRecord(8, 8, [0.1], [0.2], [], True, 0)
    windows.append(last)
    kept = [
        WindowRecord(
            5 + i,
            5 + i,
            row[:n].tolist(),
            (2.0 * row[:n]).tolist(),
            [],
            True,
            int(n) - 1,
            int(steps),
            0.0,
            defect,
            int(c),
        )
        for i, ((n, steps, c), row, defect) in enumerate(zip(counts, errors.copy(), (0.0, 1e-4, 1e-5), strict=True))
    ]
    errors[:] = -1.0  # the tables of a march are used again
    return windows, [first, *kept, last]


def test_reads_like_a_list(both: tuple[WindowList, list[WindowRecord]]) -> None:
    windows, expected = both
    assert len(windows) == 5
    assert list(windows) == expected
    assert windows[-2] == expected[-2]
    assert windows[1:4] == expected[1:4]
    assert windows[2] == expected[2]
    with pytest.raises(IndexError):
        windows[5]


def test_summaries_look_at_nothing(both: tuple[WindowList, list[WindowRecord]]) -> None:
    windows, expected = both
    assert windows.failed() == expected[:1]
    assert windows.with_fallbacks() == 1
    assert windows.most_iterations() == 3
    assert WindowList().most_iterations() == 0
    assert not WindowList()


def test_parts_come_back(both: tuple[WindowList, list[WindowRecord]]) -> None:
    windows, expected = both
    for first in range(6):
        other = WindowList()
        for record in expected[:first]:
            other.append(record)
        other.extend(windows.part(first))
        assert repr(list(other)) == repr(expected)  # NaN included
        assert other.with_fallbacks() == 1


def test_cut(both: tuple[WindowList, list[WindowRecord]]) -> None:
    windows, expected = both
    assert windows.cut(2) == expected[2:]
    assert list(windows) == expected[:2]


@pytest.mark.parametrize(("work", "converged"), [(1e-4, True), (1.1e-4, False), (-1.0, True), (np.nan, False)])
def test_work_of_the_errors_that_is_no_number_has_not_converged(work: float, converged: bool) -> None:
    assert with_work("converged", work, 1.0, 1e-4, 1e-5)[0] == converged
