"""Readers of other libraries in a process of their own: what does not return, takes all memory or dies is told."""

from __future__ import annotations

import importlib
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.mesh_files import child
from latin_fmu.mesh_files.child import NO_LIMIT, Limits, read_in_child
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.reading import read_content

from .test_formats import exodus

DOUBLES = """
import os, signal, sys, time
import numpy as np
from latin_fmu.errors import MeshError, Problem
from latin_fmu.mesh_files.content import MeshContent

def burn(path):
    while True: pass

def wait(path):
    time.sleep(60)

def memory(path):
    return MeshContent(np.ones((10**9, 3)))

def die(path):
    os.kill(os.getpid(), signal.SIGSEGV)

def leave(path):
    sys.exit(3)

def refuse(path):
    raise MeshError([Problem(path.name, "bad", "7", "8", "mend it")], "unreadable mesh")

def noisy(path):
    print("noise of Python")
    os.system("echo noise of C")
    return MeshContent(np.full((1, 3), 7.0), node_sets={str(os.getpid()): np.zeros(1, int)})
"""


@pytest.fixture
def doubles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    (tmp_path / "reader_doubles.py").write_text(DOUBLES)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(child, "_SECONDS", 1.0)
    monkeypatch.setattr(child, "_MEMORY", 1 << 30)
    sys.modules.pop("reader_doubles", None)
    return importlib.import_module("reader_doubles")


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of processor time and memory")
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("burn", "takes more than 1 s of processor time"),
        ("memory", "takes more than 1.1 GB of memory"),
        ("die", "dies (SIGSEGV)"),
        ("leave", "dies (exit code 1)"),
    ],
)
def test_what_a_library_does_to_its_process_is_told(name: str, words: str, doubles: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "part.zzz"
    path.write_bytes(b"")
    with pytest.raises(MeshError) as caught:
        read_in_child(getattr(doubles, name), path, "Zzz, the library zlib")
    assert f"part.zzz: the reader of Zzz, the library zlib {words}" in str(caught.value)
    assert "--no-limit" in str(caught.value)


def test_a_library_that_waits(doubles: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "_SECONDS", 0.01)
    monkeypatch.setattr(child, "_START", 0.5)
    path = tmp_path / "part.zzz"
    path.write_bytes(b"")
    with pytest.raises(MeshError, match="does not return within"):
        read_in_child(doubles.wait, path, "Zzz")


def test_errors_and_content_come_back_and_nothing_is_said(
    doubles: ModuleType, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "part.zzz"
    path.write_bytes(b"")
    with pytest.raises(MeshError) as caught:
        read_in_child(doubles.refuse, path, "Zzz")
    assert str(caught.value) == "unreadable mesh: 1 problem\n  1. part.zzz: bad (value: 7); allowed: 8; mend it"
    content = read_in_child(doubles.noisy, path, "Zzz")
    np.testing.assert_array_equal(content.points, np.full((1, 3), 7.0))
    assert capfd.readouterr() == ("", "")


def test_without_limits_it_is_this_process(
    doubles: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "part.zzz"
    path.write_bytes(b"")
    owner = next(iter(read_in_child(doubles.noisy, path, "Zzz").node_sets))
    monkeypatch.setenv(NO_LIMIT, "0")
    assert owner != next(iter(read_in_child(doubles.noisy, path, "Zzz").node_sets))


def test_limits_grow_with_the_file(tmp_path: Path) -> None:
    small, large = tmp_path / "small", tmp_path / "large"
    small.write_bytes(b"")
    large.write_bytes(bytes(3_000_000))
    assert Limits.of(small).seconds == 10.0
    assert Limits.of(large).seconds == pytest.approx(16.0)
    assert Limits.of(small).memory <= Limits.of(large).memory


def test_a_format_read_by_a_library_is_read_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same content, of another process: netCDF4 is not touched here."""
    path = exodus(tmp_path / "cube.e")
    import netCDF4

    def fail(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(netCDF4, "Dataset", fail)
    assert len(read_content(path).points) == 27


Reader = Callable[[Path], MeshContent]


def test_a_host_that_is_no_python_starts_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program with Python inside would start itself again."""
    path = tmp_path / "part.zzz"
    path.write_bytes(b"")
    monkeypatch.setattr(sys, "executable", "/usr/bin/host_of_fmus")
    monkeypatch.setattr(child.subprocess, "Popen", None)

    def reader(_: Path) -> MeshContent:
        return MeshContent(np.zeros((2, 3)))

    assert len(read_in_child(reader, path, "Zzz").points) == 2
    assert pickle.dumps(Limits.of(path))
