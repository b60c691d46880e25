"""Other hosts run the FMUs and give the numbers of fmpy.

Their environments are made by ``install_hosts.sh``; ``LATIN_FMU_HOSTS`` names their folder. What is not installed is
skipped with the reason.
"""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import fmpy
import numpy as np
import pytest

from fmu_build.build import build_fmu
from fmu_build.reference import FOLDER, reference_of
from fmu_build.ssp import write_ssp
from latin_fmu.compiled import library
from latin_fmu.cosim import Session, Settings
from tests.cosim.scenes import bar, blocks

from .compatibility import INPUT, OUTPUT, STEP, TUNING, VALUE, N, expected, in_fmpy, in_host, judged
from .host import hosts_folder

SCRIPTS = Path(__file__).parent / "hosts"
MODULES = {
    "libcosimpy": "libcosimpy",
    "ecospy": "ecospy",
    "pathsim": "pathsim_fmi",
    "cofmupy": "cofmupy",
    "gemseo": "gemseo_fmu",
    "omsimulator": "OMSimulator",
    "fmuloader": "fmuloader",
}


def tool(environment: str, name: str) -> str:
    folder = hosts_folder()
    if folder is None:
        pytest.skip("LATIN_FMU_HOSTS names no folder made by tests/fmu/install_hosts.sh")
    path = folder / environment / "bin" / name
    if not path.exists():
        pytest.skip(f"{name} is not installed in {environment}: see tests/fmu/install_hosts.sh")
    return str(path)


def python_of(host: str) -> str:
    """The Python that has the host; skips where it has not, or where the host itself cannot be loaded."""
    python = tool(host if host in ("cofmupy", "gemseo") else "common", "python")
    done = subprocess.run([python, "-c", f"import {MODULES[host]}"], capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"{host} cannot be loaded: {done.stderr.strip().splitlines()[-1]}")
    return python


def ran(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    ("host", "version"),
    [
        ("libcosimpy", "2"),
        ("omsimulator", "2"),
        ("fmuloader", "3"),
        *((host, v) for host in ("ecospy", "pathsim", "cofmupy", "gemseo") for v in ("2", "3")),
    ],
)
def test_host(host, version, compiled, fmus, tmp_path):
    """An input set, steps made, an output read."""
    fmu = fmus[version]
    if compiled:
        if library.loaded() is None:
            pytest.skip("no library of kernels here")
        fmu = build_fmu(blocks(), tmp_path / "compiled.fmu", version)
    assert in_host(Path(python_of(host)), SCRIPTS / f"with_{host}.py", fmu) == "passed"


@pytest.mark.parametrize("host", TUNING)
def test_a_parameter_changed_under_way(host, fmus):
    version = "3" if host == "fmuloader" else "2"
    assert in_host(Path(python_of(host)), SCRIPTS / f"with_{host}.py", fmus[version], tuned=True) == "passed"


def test_ssp_in_omsimulator(fmus, tmp_path):
    """The second block is loaded by the share of the first that slips, a step late."""
    python, slips = python_of("omsimulator"), "interface.crush.slipping"
    parts = {"first": fmus["2"], "second": fmus["2"]}
    package = write_ssp(tmp_path / "a.ssp", "a", parts, [("first", slips, "second", INPUT)], N * STEP, step=STEP)
    first, second = (Session(blocks(), Settings(keep=False)) for _ in range(2))
    first.set_load("press", VALUE)
    for session in (first, second):
        session.initialize()
    rows = []
    for i in range(N):
        second.set_load("press", first.value(slips))
        for session in (first, second):
            assert session.step(i * STEP, STEP)
        rows.append((first.value(OUTPUT), second.value(OUTPUT)))
    assert np.abs(rows).max(axis=0).min() > 0.0
    for name, wanted in zip(parts, np.transpose(rows), strict=True):
        given = [str(package), str(STEP), str(N), f"first.{INPUT}", str(VALUE), f"{name}.{OUTPUT}"]
        printed = ran([python, str(SCRIPTS / "with_omsimulator.py"), *given], tmp_path)
        got = json.loads(next(line for line in printed.splitlines() if line.startswith("[")))
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def test_container_of_two(fmus, tmp_path):
    (tmp_path / "blocks.fmu").write_bytes(fmus["2"].read_bytes())
    build_fmu(bar(), tmp_path / "bar.fmu", python=True)
    plan = {"name": "both.fmu", "step_size": STEP, "fmu": ["blocks.fmu", "bar.fmu"]}
    (tmp_path / "both.json").write_text(json.dumps(plan))
    ran([tool("common", "fmucontainer"), "-fmu-directory", ".", "-container", "both.json"], tmp_path)
    result = fmpy.simulate_fmu(
        str(tmp_path / "both.fmu"),
        stop_time=N * STEP,
        output_interval=STEP,
        start_values={INPUT: VALUE},
        output=["interface.crush.force[3]", "interface.wall.velocityE[3]"],
    )
    assert result[OUTPUT][1:] == pytest.approx(expected(), rel=1e-9, abs=1e-6)
    assert result["interface.wall.velocityE[3]"][-1] == pytest.approx(-10.0)


def test_an_fmu_that_does_not_give_its_reference_fails(tmp_path):
    files = reference_of(blocks()).files
    name = f"{FOLDER}/blocks_ref.csv"
    head, *rows = files[name].decode().splitlines()
    last = rows[-1].split(",")
    last[head.split(",").index(OUTPUT)] = "1.0"
    wrong = {**files, name: "\n".join([head, *rows[:-1], ",".join(last)]).encode()}
    right, off = (
        build_fmu(blocks(), tmp_path / f"{i}.fmu", extra=extra, python=True) for i, extra in enumerate((files, wrong))
    )
    assert judged(in_fmpy(right)) == "passed"
    assert judged(in_fmpy(off)).startswith("failed: off by")


def test_the_page_names_the_versions_that_are_installed():
    root = Path(__file__).parents[2]
    script = (Path(__file__).parent / "install_hosts.sh").read_text()
    page = (root / "docs" / "fmu_compatibility.md").read_text()
    table = [line for line in page.splitlines() if line.startswith("| ")]
    pins = re.findall(r"([\w-]+)==([\d.]+)", script)
    assert len(pins) == 8
    for name, version in pins:
        assert any(f"{name} {version}" in line for line in table), f"{name} {version}"
