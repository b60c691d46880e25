"""Writing of outputs: whole or not at all, in the place of regular files only, and never lost."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
import xarray as xr

from fmu_build.build import write_archive
from fmu_build.ssp import write_ssp
from latin_fmu import ResultsError
from latin_fmu.commands.fmu import write_csv
from latin_fmu.pictures.style import save_figure
from latin_fmu.results import writing
from latin_fmu.results.files import write_netcdf
from latin_fmu.results.vtk import export_vtu
from latin_fmu.results.writing import UnwrittenError, check_target, write_bytes, write_whole

TREE = xr.DataTree(xr.Dataset({"a": ("x", [1.0, 2.0])}))
WRITERS: dict[str, Callable[[Path], object]] = {
    "a.nc": lambda path: write_netcdf(TREE, path),
    "a.png": lambda path: save_figure(plt.figure(), path),
    "a.csv": lambda path: write_csv(path, ["time"], [[0.0], [1.0]]),
    "a.md": lambda path: write_bytes(path, b"new"),
    "a.fmu": lambda path: write_archive(path, {"modelDescription.xml": b"new"}),
    "a.ssp": lambda path: write_ssp(path, "name", {}, [], 1.0),
    "folder": lambda path: export_vtu(TREE, path),
}


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The temporary folder of a test, where rescued files go."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(writing.tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """The folder that outputs are written to."""
    folder = tmp_path / "place"
    folder.mkdir()
    return folder


def test_a_good_block_leaves_only_its_file(place: Path) -> None:
    target = place / "a.txt"
    target.write_text("old")

    def write(draft: Path) -> None:
        assert draft.suffix == ".txt"
        assert draft.parent == place
        draft.write_text("new")
        assert target.read_text() == "old"

    assert write_whole(target, write) == target
    assert target.read_text() == "new"
    assert list(place.iterdir()) == [target]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("bug")])
def test_an_interrupted_writer_leaves_the_old_file(place: Path, temporary: Path, error: BaseException) -> None:
    target = place / "a.txt"
    target.write_text("old")

    def write(draft: Path) -> None:
        draft.write_text("half")
        raise error

    with pytest.raises(type(error)):
        write_whole(target, write)
    assert target.read_text() == "old"
    assert list(place.iterdir()) == [target]
    assert not list(temporary.iterdir())


def test_a_full_disk_gives_a_rescued_file(place: Path, temporary: Path) -> None:
    target = place / "a.txt"
    target.write_text("old")

    def write(draft: Path) -> None:
        draft.write_text("new")
        if draft.parent == place:
            raise OSError(28, "No space left on device")

    with pytest.raises(UnwrittenError, match="No space left on device") as caught:
        write_whole(target, write)
    (rescued,) = temporary.rglob("a.txt")
    assert rescued.read_text() == "new"
    assert f"it was written to {rescued} instead" in str(caught.value)
    assert target.read_text() == "old"
    assert list(place.iterdir()) == [target]


def test_without_a_place_for_the_rescued_file_nothing_is_left(place: Path, temporary: Path) -> None:
    def write(draft: Path) -> None:
        draft.write_text("half")
        raise OSError(28, "No space left on device")

    with pytest.raises(UnwrittenError, match="not written to the temporary folder either"):
        write_whole(place / "a.txt", write)
    assert not list(place.iterdir())
    assert not list(temporary.iterdir())


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_rescues_its_output_where_the_folder_has_gone(name: str, place: Path, temporary: Path) -> None:
    place.rmdir()
    with pytest.raises(UnwrittenError, match="the folder does not exist"):
        WRITERS[name](place / name)
    assert len(list(temporary.rglob(name))) == 1


@pytest.mark.parametrize("name", WRITERS)
def test_no_writer_replaces_what_is_no_file(name: str, place: Path) -> None:
    target = place / name
    os.mkfifo(target)
    with pytest.raises(ResultsError, match=r"pipe|not a folder"):
        WRITERS[name](target)
    assert stat.S_ISFIFO(target.lstat().st_mode)
    assert list(place.iterdir()) == [target]


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_follows_links(name: str, place: Path, tmp_path: Path) -> None:
    """Also a link to what is not there yet, and a link to a link."""
    behind = tmp_path / f"behind{Path(name).suffix}"
    first, second = place / name, place / f"other_{name}"
    first.symlink_to(behind)
    second.symlink_to(first)
    WRITERS[name](first)
    WRITERS[name](second)
    assert first.is_symlink()
    assert second.is_symlink()
    assert behind.is_dir() if name == "folder" else behind.is_file()
    assert sorted(place.iterdir()) == [first, second]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="devices are made by root only")
def test_a_device_stays_a_device(place: Path) -> None:
    """A character device of this folder alone, never one of the machine."""
    target = place / "device.nc"
    try:
        os.mknod(target, stat.S_IFCHR | 0o600, os.makedev(1, 3))
    except PermissionError:
        pytest.skip("no devices may be made here")
    with pytest.raises(ResultsError, match="this is a device"):
        check_target(target)
    with pytest.raises(ResultsError, match="this is a device"):
        write_netcdf(TREE, target)
    assert stat.S_ISCHR(target.lstat().st_mode)


def test_a_link_that_leads_to_itself(place: Path) -> None:
    (place / "a.nc").symlink_to(place / "b.nc")
    (place / "b.nc").symlink_to(place / "a.nc")
    with pytest.raises(ResultsError, match="a link that leads to itself"):
        check_target(place / "a.nc")


def test_a_name_that_is_too_long(place: Path) -> None:
    with pytest.raises(ResultsError, match="cannot be reached: File name too long"):
        check_target(place / ("a" * 300))
    longest = place / f"{'a' * 252}.nc"
    write_bytes(longest, b"new")
    assert longest.read_bytes() == b"new"


def test_the_mode_of_the_file_is_kept(place: Path) -> None:
    target = place / "a.txt"
    target.write_text("old")
    target.chmod(0o640)
    write_bytes(target, b"new")
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_a_protected_file_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = place / "a.nc"
    target.write_text("old")
    monkeypatch.setattr(writing.os, "access", lambda *_: False)  # root may write everywhere
    with pytest.raises(ResultsError, match="protected against writing"):
        check_target(target)


def test_free_space_is_told_before(place: Path) -> None:
    check_target(place / "a.nc", 1e3)
    with pytest.raises(ResultsError, match=r"MB are free, the file may need 1000000000000 MB.*output\.every"):
        check_target(place / "a.nc", 1e18)


def test_checking_leaves_no_trace(place: Path) -> None:
    check_target(place / "a.nc")
    assert not list(place.iterdir())


def test_a_folder_that_refuses_files(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("latin_fmu.results.writing.tempfile.TemporaryFile", refused)
    with pytest.raises(ResultsError, match="Permission denied"):
        check_target(place / "a.nc")
