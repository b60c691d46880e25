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
import pytest

from fmu_build.build import build_fmu
from latin_fmu.compiled import library

from .host import hosts_folder
from .scenes import bar, blocks

SCRIPTS = Path(__file__).parent / "hosts"
STEP, N, INPUT, VALUE, OUTPUT = 1e-6, 4, "load.press.value", 0.6, "interface.crush.force[3]"
MODULES = {
    "libcosimpy": "libcosimpy",
    "ecospy": "ecospy",
    "pathsim": "pathsim_fmi",
    "cofmupy": "cofmupy",
    "gemseo": "gemseo_fmu",
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


@pytest.fixture
def expected(opened) -> list[float]:
    host = opened("2")
    host.set(load__press__value=VALUE)
    host.start()
    rows = []
    for i in range(N):
        assert host.step(i * STEP, STEP)
        rows.append(float(host.read([OUTPUT])[0]))
    assert rows[-1] != 0.0
    return rows


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    ("host", "version"),
    [("libcosimpy", "2"), *((host, v) for host in ("ecospy", "pathsim", "cofmupy", "gemseo") for v in ("2", "3"))],
)
def test_host(host, version, compiled, fmus, expected, tmp_path):
    """An input set, steps made, an output read."""
    script, fmu = SCRIPTS / f"with_{host}.py", fmus[version]
    if compiled:
        if library.loaded() is None:
            pytest.skip("no library of kernels here")
        fmu = build_fmu(blocks(), tmp_path / "compiled.fmu", version, compiled=True)
    given = [str(fmu), str(STEP), str(N), INPUT, str(VALUE), OUTPUT]
    said = ran([python_of(host), str(script), *given], tmp_path).splitlines()
    rows = json.loads(next(line for line in said if re.fullmatch(r"\[[-+\d.e, ]+\]", line)))
    first = 1 if host == "pathsim" else 0  # pathsim reads after the step that begins at its time point
    assert rows[: N - first] == pytest.approx(expected[first:], rel=1e-9, abs=1e-6)


def test_container_of_two(fmus, expected, tmp_path):
    (tmp_path / "blocks.fmu").write_bytes(fmus["2"].read_bytes())
    build_fmu(bar(), tmp_path / "bar.fmu")
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
    assert result[OUTPUT][1:] == pytest.approx(expected, rel=1e-9, abs=1e-6)
    assert result["interface.wall.velocityE[3]"][-1] == pytest.approx(-10.0)


def test_the_guide_names_the_versions_that_are_installed():
    root = Path(__file__).parents[2]
    script = (Path(__file__).parent / "install_hosts.sh").read_text()
    table = [line for line in (root / "docs" / "fmu.md").read_text().splitlines() if line.startswith("| ")]
    pins = re.findall(r"([\w-]+)==([\d.]+)", script)
    assert len(pins) == 6
    for name, version in pins:
        assert any(f"{name} {version}" in line for line in table), f"{name} {version}"
