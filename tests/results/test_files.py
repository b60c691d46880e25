"""Whole or not at all, for any kind of file."""

from __future__ import annotations

from pathlib import Path

import pytest

from latin_fmu import ResultsError
from latin_fmu.results.files import check_target, written_whole


def test_a_good_block_leaves_only_its_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with written_whole(target) as draft:
        assert draft.suffix == ".txt"
        draft.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("bug")])
def test_a_failed_block_leaves_the_old_file(tmp_path: Path, error: BaseException) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    expected = ResultsError if isinstance(error, OSError) else type(error)
    with pytest.raises(expected):
        _write_half(target, error)
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def _write_half(target: Path, error: BaseException) -> None:
    with written_whole(target) as draft:
        draft.write_text("half")
        raise error


def test_checking_leaves_no_trace(tmp_path: Path) -> None:
    check_target(tmp_path / "a.nc")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_refuses_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("latin_fmu.results.files.tempfile.TemporaryFile", refused)
    with pytest.raises(ResultsError, match="Permission denied"):
        check_target(tmp_path / "a.nc")
