"""Compiled kernels kept by the contents of the package."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from latin_fmu.kernel_store import KEPT, Files, store_of

KEY = ("signature", ("x86_64", "cpu"), "bytecode")


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "extracted" / "package"
    folder.mkdir(parents=True)
    (folder / "kernels.py").write_text("A = 1\n")
    return folder


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("LATIN_FMU_CACHE", str(tmp_path / "store"))
    store_of.cache_clear()
    yield tmp_path / "store"
    store_of.cache_clear()


def test_what_is_saved_is_found(tmp_path):
    files = Files(tmp_path, "module.function")
    assert files.load(KEY) is None
    files.save(KEY, (1, b"code"))
    assert files.load(KEY) == (1, b"code")
    assert files.load(("other", *KEY[1:])) is None
    assert Files(tmp_path, "module.another").load(KEY) is None


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-1], lambda b: b[:40] + bytes([b[40] ^ 1]) + b[41:], lambda _: b""]
)
def test_damaged_files_are_not_used(tmp_path, damage):
    files = Files(tmp_path, "module.function")
    files.save(KEY, (1, b"code"))
    (path,) = tmp_path.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    assert files.load(KEY) is None
    files.save(KEY, (2, b"code"))
    assert files.load(KEY) == (2, b"code")


def test_a_file_under_another_key_is_not_used(tmp_path):
    files = Files(tmp_path, "module.function")
    files.save(KEY, "data")
    shutil.copy(files._path(KEY), files._path("other key"))
    assert files.load("other key") is None


def test_saving_where_nothing_can_be_written_is_no_error(tmp_path):
    Files(tmp_path / "missing", "module.function").save(KEY, "data")
    assert not list(tmp_path.iterdir())


def test_the_folder_follows_the_contents(package, base, tmp_path):
    first = store_of(package)
    assert first is not None
    assert first.parent == base
    again = tmp_path / "extracted again" / "package"
    shutil.copytree(package, again)
    assert store_of(again) == first
    (again / "notes.py").write_text("nothing compiled here\n")
    store_of.cache_clear()
    assert store_of(again) == first
    (again / "kernels.py").write_text("@kernel\ndef half(x):\n    return x / 2\n")
    store_of.cache_clear()
    assert store_of(again) not in (None, first)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="POSIX permissions")
def test_only_a_private_folder_is_used(package, base):
    folder = store_of(package)
    assert folder is not None
    assert folder.stat().st_mode & 0o777 == base.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    store_of.cache_clear()
    assert store_of(package) is None
    shutil.move(folder, base / "elsewhere")
    (base / "elsewhere").chmod(0o700)
    folder.symlink_to(base / "elsewhere")
    assert store_of(package) is None


def test_no_store_where_none_is_wanted_or_possible(package, base, monkeypatch):
    base.write_text("a file where the folder should be")
    assert store_of(package) is None
    for nothing in ("0", ""):
        monkeypatch.setenv("LATIN_FMU_CACHE", nothing)
        store_of.cache_clear()
        assert store_of(package) is None


def test_the_user_may_choose_the_folder_of_numba(package, tmp_path, monkeypatch):
    monkeypatch.delenv("LATIN_FMU_CACHE", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    store_of.cache_clear()
    folder = store_of(package)
    assert folder is not None
    assert folder.parent == tmp_path / "numba" / "latin-fmu"
    store_of.cache_clear()


def test_old_folders_go(package, base):
    base.mkdir()
    for i in range(KEPT + 3):
        old = base / f"{i:032x}"
        old.mkdir()
        os.utime(old, (i, i))
    newest = store_of(package)
    left = {f.name for f in base.iterdir()}
    assert len(left) == KEPT
    assert newest is not None
    assert newest.name in left
    assert f"{KEPT + 2:032x}" in left
