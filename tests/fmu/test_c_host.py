"""A host in C, which is no Python: what fails is a status, memory stays flat, two FMUs in one process end in order."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import fmpy
import pytest

from fmu_build.bridge import zig
from fmu_build.build import build_fmu
from latin_fmu.compiled import library
from tests.cosim.scenes import bar

H = 0.2e-6
_SHARED = sysconfig.get_config_var("Py_ENABLE_SHARED")
pytestmark = pytest.mark.skipif(sys.platform != "linux" or not _SHARED, reason="needs a shared library of Python")


@pytest.fixture(scope="module")
def host(tmp_path_factory) -> Path:
    """The host, compiled by the compiler of this machine, else that of ziglang."""
    try:
        compiler = ["cc"] if shutil.which("cc") else list(zig(library.target()))
    except ModuleNotFoundError:
        pytest.skip("no C compiler")
    target = tmp_path_factory.mktemp("host") / "host"
    source = Path(__file__).with_name("host.c")
    options = ["-std=c99", "-D_GNU_SOURCE", "-O1", "-ldl", "-lpthread"]
    subprocess.run([*compiler, str(source), "-o", str(target), *options], check=True)
    return target


def extracted(fmu: Path, folder: Path, load: str = "load.press.value") -> list[str]:
    """Library, resources as a URI, GUID, references of a load and of the history file."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    description = fmpy.read_model_description(str(fmu))
    references = {v.name: v.valueReference for v in description.modelVariables}
    model = folder / "binaries" / "linux64" / f"{description.coSimulation.modelIdentifier}.so"
    numbers = [str(references[name]) for name in (load, "historyFile")]
    return [str(model), (folder / "resources").as_uri(), description.guid, *numbers]


def ran(host: Path, *arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """The host as a process of its own; the Python of these tests is the one it finds."""
    known = {"LATIN_FMU_PYTHON": sys.executable, **environment}
    inherited = {k: v for k, v in os.environ.items() if k not in ("PYTHONHOME", "PYTHONPATH", "LD_PRELOAD")}
    command = [str(host), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=inherited | known, timeout=500, check=False)


def test_a_run_ends_with_0(host, fmus, tmp_path):
    done = ran(host, 1, 2e-6, H, 0.5, "-", *extracted(fmus["2"], tmp_path / "a b"))
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("load", "text", "code", "words"),
    [
        ("nan", "-", 13, "load.press.value = nan: is not a finite number"),
        ("1e300", "-", 12, "DoStep(c, t, h, 1): status 2, terminated 0"),
        ("0.5", "/nope.csv", 13, "/nope.csv: no such file"),
    ],
)
def test_a_failure_is_a_status(host, fmus, tmp_path, load, text, code, words):
    done = ran(host, 1, 2e-6, H, load, text, *extracted(fmus["2"], tmp_path))
    assert done.returncode == code
    assert words in done.stderr


def test_a_python_that_is_none_is_named(host, fmus, tmp_path):
    done = ran(host, 1, 2e-6, H, 0.5, "-", *extracted(fmus["2"], tmp_path), LATIN_FMU_PYTHON="/nowhere/python")
    assert done.returncode == 3
    assert "'/nowhere/python' cannot be run: set LATIN_FMU_PYTHON" in done.stderr


def test_two_fmus_in_one_process(host, fmus, tmp_path):
    """One after the other, and again: their libraries are closed and opened, the interpreter stays."""
    other = build_fmu(bar(), tmp_path / "bar.fmu", "2", python=True)
    first = extracted(fmus["2"], tmp_path / "first")
    second = extracted(other, tmp_path / "second", "timeStep")
    done = ran(host, 3, 2e-6, H, 0.1e-6, "-", *first, *second)
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("[1]") for line in done.stderr.splitlines())  # warnings about the scene only


def test_fmus_in_threads_that_begin_at_once(host, fmus, tmp_path):
    """Each FMU has a copy of the C library: one of them alone starts the interpreter, the others wait for it."""
    other = build_fmu(bar(), tmp_path / "bar.fmu", "2", python=True)
    given = []
    for i in range(2):
        given += extracted(fmus["2"], tmp_path / f"first {i}", "timeStep")
        given += extracted(other, tmp_path / f"second {i}", "timeStep")
    done = ran(host, 0, 2e-6, H, 0.1e-6, "-", *given)
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("[1]") for line in done.stderr.splitlines())


@pytest.mark.slow
def test_memory_is_flat_over_200_cycles(host, fmus, tmp_path):
    """The collector of reference cycles is switched off, by a module that every Python loads at its start."""
    (tmp_path / "usercustomize.py").write_text("import gc\ngc.disable()\n")
    given = extracted(fmus["2"], tmp_path / "fmu")
    done = ran(host, 200, 1e-6, H, 0.5, "-", *given, PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stderr
    first, *_, last = (int(line) for line in done.stdout.split())
    assert last - first < 5000  # kB in 150 cycles; each kept about 1000 before
