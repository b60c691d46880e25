"""Other hosts run the FMUs and give the numbers of fmpy.

Their environments are made by ``install_hosts.sh``; ``LATIN_FMU_HOSTS`` names their folder.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import fmpy
import pytest

from fmu_build.build import build_fmu

from .scenes import bar

pytestmark = pytest.mark.slow
HOSTS = Path(os.environ.get("LATIN_FMU_HOSTS", "no-hosts"))
SCRIPTS = Path(__file__).parent / "hosts"
STEP, N, INPUT, VALUE, OUTPUT = 1e-6, 4, "load.press.value", 0.6, "interface.crush.force[3]"


def tool(environment: str, name: str) -> str:
    path = HOSTS / environment / "bin" / name
    if not path.exists():
        pytest.skip(f"no {path}: see install_hosts.sh")
    return str(path)


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


@pytest.mark.parametrize(
    ("host", "version"),
    [("libcosimpy", "2"), ("ecospy", "2"), ("ecospy", "3"), ("pathsim", "2"), ("pathsim", "3")],
)
def test_host(host, version, fmus, expected, tmp_path):
    script = SCRIPTS / f"with_{host}.py"
    command = [
        tool(host, "python"),
        str(script),
        str(fmus[version]),
        str(STEP),
        str(N),
        INPUT,
        str(VALUE),
        OUTPUT,
    ]
    rows = json.loads(
        next(
            line
            for line in ran(command, tmp_path).splitlines()
            if line.startswith("[-") or line.startswith("[0")
        )
    )
    first = 1 if host == "pathsim" else 0  # pathsim reads after the step that begins at its time point
    assert rows[: N - first] == pytest.approx(expected[first:], rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("version", ["2", "3"])
def test_fmutool_finds_nothing(version, fmus, tmp_path):
    said = ran([tool("toolbox", "fmutool"), "-input", str(fmus[version]), "-check"], tmp_path)
    assert "seems to be compliant" in said
    assert "No semantic error" in said
    assert "ERROR" not in said


def test_container_of_two(fmus, expected, tmp_path):
    (tmp_path / "blocks.fmu").write_bytes(fmus["2"].read_bytes())
    build_fmu(bar(), tmp_path / "bar.fmu")
    plan = {"name": "both.fmu", "step_size": STEP, "fmu": ["blocks.fmu", "bar.fmu"]}
    (tmp_path / "both.json").write_text(json.dumps(plan))
    ran([tool("toolbox", "fmucontainer"), "-fmu-directory", ".", "-container", "both.json"], tmp_path)
    result = fmpy.simulate_fmu(
        str(tmp_path / "both.fmu"), stop_time=N * STEP, output_interval=STEP, start_values={INPUT: VALUE},
        output=["interface.crush.force[3]", "interface.wall.velocityE[3]"],
    )  # fmt: skip
    assert result[OUTPUT][1:] == pytest.approx(expected, rel=1e-9, abs=1e-6)
    assert result["interface.wall.velocityE[3]"][-1] == pytest.approx(-10.0)
