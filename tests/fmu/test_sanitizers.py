"""The C files of FMUs under address and undefined-behaviour sanitizers of gcc, and under valgrind.

The tests of states, faults, arrays and damaged files run once more on libraries that end the process on an access
outside of an object or on what C does not define (``sanitized.py``); a host in C runs a compiled FMU under valgrind.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fmu_build.build import build_fmu
from latin_fmu.compiled import library

from .host import extracted
from .sanitized import KERNELS, SANITIZERS, kernels_library
from .test_compiled import DT, scene

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
LEFT_OUT = "host_in_c or cycles_and_threads or a_failure_is_a_status or c_library_alone or archive_of_the_crushing"
"""Hosts without sanitizers, and tests of the libraries themselves."""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        library.target() != "linux-x86_64" or shutil.which("gcc") is None or not KERNELS.is_file(),
        reason="needs Linux, gcc, and the kernels that latin_fmu.aot has compiled in the source tree",
    ),
]


def runtime() -> str:
    """The runtime libraries of the sanitizers, which come first in a process."""
    commands = (["gcc", f"-print-file-name={name}"] for name in ("libasan.so", "libubsan.so"))
    paths = (subprocess.run(command, capture_output=True, text=True, check=True).stdout for command in commands)
    return " ".join(path.strip() for path in paths)


@pytest.mark.parametrize("file", ["test_compiled", "test_states", "test_faults", "test_ports"])
def test_no_access_outside_and_nothing_undefined(file: str) -> None:
    """Leaks are those of the Python of the host, and not looked for here."""
    checks = {"LD_PRELOAD": runtime(), "ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "tests.fmu.sanitized", "-m", "not slow"]
    command += ["-k", f"not ({LEFT_OUT})", str(HERE / f"{file}.py")]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | checks, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert "AddressSanitizer" not in said, said[-5000:]
    assert "runtime error" not in said, said[-5000:]
    assert done.returncode == 0, said[-5000:]
    assert " passed" in said


def test_the_sanitizers_find_what_they_look_for(tmp_path: Path) -> None:
    """A program that reads behind its memory ends with their message."""
    source, program = tmp_path / "wrong.c", tmp_path / "wrong"
    text = "#include <stdlib.h>\nint main(int n, char **g) { char *p = malloc(4); return g[0][0] + p[3 + n]; }\n"
    source.write_text(text)
    subprocess.run(["gcc", *SANITIZERS, str(source), "-o", str(program)], check=True)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "AddressSanitizer" in done.stderr


def older_kernels() -> bytes:
    """The kernels for a processor without AVX, some of whose instructions valgrind does not know; two minutes."""
    code = """
import sys
from dataclasses import replace
from latin_fmu import aot
from latin_fmu.aot import linking
name = "linux-x86_64"
linking.TARGETS = {name: replace(linking.TARGETS[name], cpu="x86-64-v2")}
sys.stdout.buffer.write(aot._make([name])[name])
"""
    pytest.importorskip("numba")
    return subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout


@pytest.mark.parametrize("watch", ["sanitizers", "valgrind"])
def test_a_host_in_c(watch: str, tmp_path: Path) -> None:
    """Steps, every other one taken back, of a compiled FMU: no wrong access and no block of memory lost."""
    by_valgrind = watch == "valgrind"
    if by_valgrind and shutil.which("valgrind") is None:
        pytest.skip("no valgrind")
    options = () if by_valgrind else SANITIZERS
    files, references = extracted(build_fmu(scene(), tmp_path / "blocks.fmu", "2"), tmp_path / "fmu")
    shutil.copy(kernels_library(tmp_path, options, older_kernels() if by_valgrind else b""), files[0])
    program, compiler = tmp_path / "steps", ["gcc", "-g", "-O1", "-D_GNU_SOURCE", *options]
    subprocess.run([*compiler, str(HERE / "steps.c"), "-o", str(program), "-ldl", "-lpthread"], check=True)
    inputs = f"{references['load.press.value']},{references['load.press.rate']}"
    lines = ["0.25 0.0", *(f"{'back ' if i % 2 else ''}{DT!r} 0.5 0.0" for i in range(10))]
    checker = ["valgrind", "--error-exitcode=99", "--leak-check=full", "--errors-for-leak-kinds=definite", "-q"]
    command = [*(checker if by_valgrind else []), str(program), *files, inputs, inputs]
    done = subprocess.run(command, input="\n".join(lines), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-5000:]
    assert len(done.stdout.splitlines()) == 11
