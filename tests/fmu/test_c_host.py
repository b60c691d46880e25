"""A host in C, which is no Python: what fails is a status, memory stays flat, two FMUs in one process end in order."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from fmu_build.build import build_fmu
from tests.cosim.scenes import bar

from .host import COMPILED, extracted

H = 0.2e-6
_SHARED = sysconfig.get_config_var("Py_ENABLE_SHARED")
pytestmark = pytest.mark.skipif(sys.platform != "linux" or not _SHARED, reason="needs a shared library of Python")


def given(fmu: Path, folder: Path, load: str = "load.press.value") -> list[object]:
    """Library, resources as a URI, GUID, references of a load and of the history file."""
    files, references = extracted(fmu, folder)
    return [*files, references[load], references["historyFile"]]


def ran(host: Path, *arguments: object, empty: bool = False, **environment: str) -> subprocess.CompletedProcess[str]:
    """The host as a process of its own; the Python of these tests is the one it finds."""
    known = {"LATIN_FMU_PYTHON": sys.executable, **environment}
    inherited = {k: v for k, v in os.environ.items() if k not in ("PYTHONHOME", "PYTHONPATH", "LD_PRELOAD")}
    command = [str(host), *map(str, arguments)]
    env = {} if empty else inherited | known
    return subprocess.run(command, capture_output=True, text=True, env=env, timeout=500, check=False)


def test_a_run_ends_with_0(programs, made, tmp_path):
    done = ran(programs["host"], 1, 2e-6, H, 0.5, "-", *given(made["2"], tmp_path / "a b"))
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("load", "text", "code", "words"),
    [
        ("nan", "-", 13, "load.press.value = nan: is not a finite number"),
        ("1e300", "-", 12, "no convergence"),
        ("0.5", "/nope.csv", 13, "/nope.csv: no such file"),
    ],
)
def test_a_failure_is_a_status(programs, made, tmp_path, load, text, code, words):
    done = ran(programs["host"], 1, 2e-6, H, load, text, *given(made["2"], tmp_path))
    assert done.returncode == code
    assert words in done.stderr
    assert code == 13 or "DoStep(c, t, h, 1): status 2, terminated 0" in done.stderr


def test_a_python_that_is_none_is_named(programs, fmus, tmp_path):
    done = ran(programs["host"], 1, 2e-6, H, 0.5, "-", *given(fmus["2"], tmp_path), LATIN_FMU_PYTHON="/nowhere/python")
    assert done.returncode == 3
    assert "'/nowhere/python' cannot be run: set LATIN_FMU_PYTHON" in done.stderr


def test_two_fmus_in_one_process(programs, fmus, tmp_path):
    """One after the other, and again: their libraries are closed and opened, the interpreter stays."""
    other = build_fmu(bar(), tmp_path / "bar.fmu", "2", python=True)
    first = given(fmus["2"], tmp_path / "first")
    second = given(other, tmp_path / "second", "timeStep")
    done = ran(programs["host"], 3, 2e-6, H, 0.1e-6, "-", *first, *second)
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("[1]") for line in done.stderr.splitlines())  # warnings about the scene only


def test_fmus_in_threads_that_begin_at_once(programs, fmus, tmp_path):
    """Each FMU has a copy of the C library: one of them alone starts the interpreter, the others wait for it."""
    other = build_fmu(bar(), tmp_path / "bar.fmu", "2", python=True)
    arguments = []
    for i in range(2):
        arguments += given(fmus["2"], tmp_path / f"first {i}", "timeStep")
        arguments += given(other, tmp_path / f"second {i}", "timeStep")
    done = ran(programs["host"], 0, 2e-6, H, 0.1e-6, "-", *arguments)
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("[1]") for line in done.stderr.splitlines())


@COMPILED
def test_cycles_and_threads_of_compiled_fmus(programs, compiled_fmus, tmp_path):
    """In an empty environment: two FMUs 200 times, then four instances in threads that begin at once; memory stays."""
    other = build_fmu(bar(time={"end": 50 * H, "instants": 50}), tmp_path / "bar.fmu", "2")
    arguments = given(compiled_fmus["2"], tmp_path / "0") + given(other, tmp_path / "1", "inputInterpolation")
    for cycles, end, more in ((200, 4 * H, []), (0, 20 * H, arguments)):
        done = ran(programs["host"], cycles, end, H, 1.0, "-", *arguments, *more, empty=True)
        assert (done.returncode, done.stderr) == (0, "")
        if cycles:
            first, *_, last = (int(line) for line in done.stdout.split())
            assert last - first < 1000  # kB


@pytest.mark.slow
def test_memory_is_flat_over_200_cycles(programs, fmus, tmp_path):
    """The collector of reference cycles is switched off, by a module that every Python loads at its start."""
    (tmp_path / "usercustomize.py").write_text("import gc\ngc.disable()\n")
    done = ran(programs["host"], 200, 1e-6, H, 0.5, "-", *given(fmus["2"], tmp_path / "fmu"), PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    first, *_, last = (int(line) for line in done.stdout.split())
    assert last - first < 5000  # kB in 150 cycles; each kept about 1000 before
