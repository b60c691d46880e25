"""Errors in a call: they are logged, the step is discarded, the host goes on and the state is as before."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import textwrap
import tomllib
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

import fmu_build.build
from fmu_build.adapter import CoSimulationAdapter, ModelExchangeAdapter, check_packages
from fmu_build.build import build_fmu
from fmu_build.drive import described
from latin_fmu import InputError
from tests.cosim.scenes import bar, blocks

H = 0.6e-6


def assert_refused(host, t: float, h: float, words: str, status: int = 2) -> None:
    """The step is not made, with these words and this status, and the state is as before."""
    saved = host.save()
    before = host.to_bytes(saved)
    assert not host.step(t, h)
    assert host.last == status
    level, category, message = host.messages[-1]
    assert (level, category) == (status, {2: "logStatusDiscard", 3: "logStatusError"}[status])
    assert words in message, message
    host.restore(saved)
    assert host.to_bytes(host.save()) == before


def assert_failed(host, words: str) -> None:
    """The end of the initialization is an error with these words; so is every step after it."""
    host.prepare()
    assert host.status(host.fmu.exitInitializationMode) == 3
    level, category, message = host.messages[-1]
    assert (level, category) == (3, "logStatusError")
    assert words in message, message
    assert_refused(host, 0.0, H, "initialization failed", 3)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_inputs(opened, fmi, bad):
    host = opened(fmi)
    host.start()
    host.set(load__press__value=bad)
    assert_refused(host, 0.0, H, "load.press.value")
    host.set(load__press__value=0.5)
    assert host.step(0.0, H)


@pytest.mark.parametrize(
    ("h", "words", "status"),
    [(0.0, "greater than 0", 3), (-1.0, "greater than 0", 3), (1e9, "at most", 2), (math.nan, "finite", 3)],
)
def test_step_sizes(opened, fmi, h, words, status):
    host = opened(fmi)
    host.start()
    assert_refused(host, 0.0, h, words, status)
    assert host.step(0.0, H)


def test_a_missing_history_file(opened, fmi):
    host = opened(fmi)
    host.set(mode=1, historyFile="nowhere %s.csv")
    percent = "%%" if fmi == "2" else "%"  # in FMI 2 the text is a format of printf
    assert_failed(host, f"nowhere {percent}s.csv: no such file")


def test_an_unwritable_results_file(opened, fmi, tmp_path):
    host = opened(fmi)
    host.set(resultsFile=str(tmp_path / "no folder" / "x.nc"))
    assert_failed(host, "no folder")


def test_results_file(opened, fmi, tmp_path):
    from latin_fmu import open_results

    file = tmp_path / "out.nc"
    host = opened(fmi)
    host.set(resultsFile=str(file))
    host.start()
    host.step(0.0, H)
    state = host.save()
    host.step(H, 3 * H)
    host.restore(state)
    host.step(H, H)
    assert not file.exists()
    host.fmu.terminate()
    tree = open_results(file)
    assert tree["interfaces/crush"]["time"].values == pytest.approx(np.linspace(0.0, 2 * H, 7))
    tree.close()


def test_no_convergence(opened, fmi):
    host = opened(fmi)
    host.set(maxIterations=1, tolerance=1e-10, load__press__value=1.0)
    host.start()
    assert_refused(host, 0.0, H, "no convergence")


def test_prescribed_mode_refuses_changed_inputs(opened, fmi):
    host = opened(fmi)
    host.set(mode=1, endTime=1.2e-6)
    host.start()
    host.set(load__press__value=0.9)
    assert_refused(host, 0.0, H, "no effect in prescribed mode")


def test_parameters_are_fixed_after_initialization(opened, fmi):
    host = opened(fmi)
    host.start()
    assert host.status(lambda: host.set(timeStep=1e-3)) == 3
    assert "timeStep is fixed after initialization and was not set" in host.messages[-1][2]
    assert host.read(["timeStep"])[0] == pytest.approx(0.2e-6, rel=1e-12)


def test_a_step_before_initialization(opened, fmi):
    host = opened(fmi)
    assert not host.step(0.0, H)
    assert host.last == 3


def test_nothing_is_printed_and_no_file_appears(fmus, fmi, tmp_path):
    code = f"""
        import sys
        from pathlib import Path
        sys.path[:0] = [{str(Path(__file__).parents[2])!r}]
        from tests.fmu.host import Host
        host = Host(Path({str(fmus[fmi])!r}), Path({str(tmp_path / "extracted")!r}))
        host.start()
        host.step(0.0, {H!r}); host.step(0.0, -1.0)
        host.status(host.fmu.terminate)
        host.close()
    """
    work = tmp_path / "work"
    work.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        cwd=work,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert done.stderr == ""
    assert not list(work.iterdir())


def test_two_scenes_in_one_process(opened, fmi, tmp_path):
    other = build_fmu(bar(), tmp_path / "bar.fmu", fmi, python=True)
    first, second = opened(fmi), opened(fmi, other)
    for host in (first, second):
        host.start()
    assert second.step(0.0, 0.02)
    assert first.step(0.0, H)
    assert second.read(["interface.wall.velocityE[3]"]) == pytest.approx(-10.0)


def test_two_versions_of_the_package_in_one_process(opened, fmus, fmi, tmp_path, monkeypatch):
    real = fmu_build.build.package_files

    def changed():
        files = real()
        text = files["latin_fmu/cosim/image_maker.py"].decode()
        return {**files, "latin_fmu/cosim/image_maker.py": (text + "\nOTHER = True\n").encode()}

    monkeypatch.setattr("fmu_build.build.package_files", changed)
    other = build_fmu(blocks(), tmp_path / "other.fmu", fmi, python=True)
    first, second = opened(fmi), opened(fmi, other)
    for host in (first, second):
        host.start()
        assert host.step(0.0, H)
    assert np.array_equal(first.read(), second.read())
    with zipfile.ZipFile(fmus[fmi]) as a, zipfile.ZipFile(other) as b:
        roots = [next(n.split("/")[1] for n in z.namelist() if n.startswith("resources/latin_fmu_")) for z in (a, b)]
    assert roots[0] != roots[1]
    for root, other_version in zip(roots, (False, True), strict=True):
        assert hasattr(sys.modules[f"{root}.latin_fmu.cosim.image_maker"], "OTHER") == other_version


def test_fifty_instances(opened):
    hosts = [opened() for _ in range(50)]
    for host in hosts[:5]:
        host.start()
        assert host.step(0.0, H)
    assert all(np.array_equal(hosts[0].read(), host.read()) for host in hosts[1:5])


def test_a_folder_that_is_gone(opened, fmi):
    """The host removes the first extraction; the second instance still finds its modules."""
    first = opened(fmi, folder="first")
    first.start()
    first.close()
    first.fmu.freeInstance = lambda: None
    second = opened(fmi, folder="second")
    second.set(mode=1, endTime=H)
    second.start()
    assert second.step(0.0, H), second.messages


def test_a_folder_outside_ascii(opened, fmi):
    host = opened(fmi, folder="Grüße é 衝突 100%25")
    host.start()
    assert host.step(0.0, H)


def test_missing_packages_are_named(fmus, fmi, tmp_path):
    """On a host without them instantiation fails, with their names."""
    code = f"""
        import sys, json
        from pathlib import Path
        sys.path[:0] = [{str(Path(__file__).parents[2])!r}]
        import importlib.util
        real = importlib.util.find_spec
        importlib.util.find_spec = lambda name, *a: None if name == "threadpoolctl" else real(name, *a)
        from tests.fmu import host
        heard = []
        host.Host._two_hears = lambda self, *a: heard.append(a[-1].decode())
        host.Host._three_hears = lambda self, *a: heard.append(a[-1].decode())
        try:
            host.Host(Path({str(fmus[fmi])!r}), Path({str(tmp_path / "x")!r}))
        except Exception as error:
            print(json.dumps([str(error), *heard]))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    said = " ".join(json.loads(done.stdout.splitlines()[-1]))
    assert "threadpoolctl" in said


# -- parameters and files that make no sense -------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"timeStep": 1.0}, "timeStep: is longer than the simulation"),
        ({"mode": 1, "timeStep": 1e-14}, "more than 1000000 time steps"),
        ({"maxIterations": 0}, "maxIterations"),
        ({"endTime": -1.0}, "endTime"),
    ],
)
def test_parameters_that_make_no_sense(opened, fmi, given, words):
    host = opened(fmi)
    host.set(**given)
    assert_failed(host, words)


def changed(fmu: Path, target: Path, name: str, change) -> Path:
    """The FMU with another content of one file."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.namelist():
            content = old.read(entry)
            new.writestr(entry, change(content) if re.fullmatch(name, entry) else content)
    return target


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("resources/variables.bin", lambda c: c[: len(c) // 2], "variables.bin is damaged"),
        (
            "resources/scene/scene.toml",
            lambda c: c.replace(b"0.2", b"0.3"),
            "resources/scene/scene.toml is missing or was changed",
        ),
        (".*/latin_fmu/latin/solver.py", lambda c: c + b"\n", "latin/solver.py is missing or was changed"),
        (".*/_kernels.*so", lambda c: c[:-1] + bytes([c[-1] ^ 1]), "is missing or was changed"),
        ("resources/digests.json", lambda c: c.replace(b"0", b"1"), "belong to different FMUs"),
        ("resources/digests.json", lambda _: b"", "belong to different FMUs"),
    ],
)
def test_files_that_are_not_those_of_the_fmu(fmus, fmi, tmp_path, capsys, name, change, words):
    from latin_fmu import cli

    other = changed(fmus[fmi], tmp_path / "changed.fmu", name, change)
    assert cli.main(["simulate", str(other), "-o", str(tmp_path / "o.csv"), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


@pytest.mark.parametrize("start", ["mode=0.5", "mode=one", "timeStep=soon"])
def test_start_values_that_are_none(fmus, tmp_path, capsys, start):
    from latin_fmu import cli

    given = ["simulate", str(fmus["2"]), "-o", str(tmp_path / "o.csv"), "--quiet", "--start", start]
    assert cli.main(given) == 2
    assert start.partition("=")[0] in capsys.readouterr().err


def test_packages_that_are_too_old_are_named(monkeypatch):
    """As found by the host: its own loaded module, or the one first on its path."""
    monkeypatch.setattr(sys.modules["pydantic"], "__version__", "1.10.2")
    monkeypatch.setattr(sys.modules["numpy"], "__version__", "2.0.0rc1")
    with pytest.raises(ImportError, match=r"packages pydantic >= 2.10 \(here 1.10.2\); Python 3") as caught:
        check_packages(CoSimulationAdapter.needed)
    assert "numpy" not in str(caught.value)


def test_packages_are_those_of_the_project():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    stated = dict(requirement.split(">=") for requirement in project["dependencies"])
    assert dict(CoSimulationAdapter.needed) == {k: v for k, v in stated.items() if k != "matplotlib"}
    assert ModelExchangeAdapter.needed.items() <= stated.items()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_histories_come_from_regular_files_and_are_not_quoted(opened, fmi, tmp_path):
    pipe, secret = tmp_path / "pipe.csv", tmp_path / "secret.csv"
    os.mkfifo(pipe)
    secret.write_text("time,press\n0,hunter2\n")
    for file, words in ((pipe, "not a regular file"), (Path("/dev/zero"), "not a regular file"), (secret, "row 2")):
        host = opened(fmi)
        host.set(mode=1, historyFile=str(file))
        assert_failed(host, words)
        assert "hunter2" not in " ".join(text for *_, text in host.messages)


# -- a host that looks at no status but exceptions -------------------------------------------------------------------
BAD_RUNS = {
    "no file": {"start_values": {"mode": 1, "historyFile": "/nope.csv"}},
    "iterations": {"start_values": {"maxIterations": 2, "tolerance": 1e-9, "load.press.value": 1.0}},
    "nan": {"start_values": {"load.press.value": 0.5}, "nan": 3e-6},
    "nan at the end": {"start_values": {"load.press.value": 0.5}, "nan": 5.5e-6},
    "mode": {"start_values": {"mode": 7}},
    "step": {"start_values": {"timeStep": 1.0}},
}


@pytest.mark.parametrize("case", BAD_RUNS)
def test_simulate_fmu_raises(fmus, fmi, case, capsys):
    """fmpy goes on after a discarded step of FMI 2 as if it had been made: the next step, or the end, is an error."""
    given = dict(BAD_RUNS[case])
    if "nan" in given:
        at = given.pop("nan")
        rows = [(0.0, 0.5), (at, 0.5), (at + 0.2e-6, math.nan), (7e-6, math.nan)]
        given["input"] = np.array(rows, dtype=[("time", float), ("load.press.value", float)])
    with pytest.raises(Exception, match=r"failed with status [23]"):
        fmpy.simulate_fmu(str(fmus[fmi]), stop_time=6e-6, output_interval=0.2e-6, **given)
    # whatever the host says of debug logging; no logger of its own: the next FMU would call it after it is freed
    assert re.search(r"^\[(ERROR|DISCARD)\] ", capsys.readouterr().out, re.MULTILINE)


def test_archives_that_would_unpack_to_much_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
        archive.writestr("resources/zeros", bytes(150_000_000))
    with pytest.raises(InputError, match=r"'resources/zeros' would unpack to 150000000 bytes"):
        described(tmp_path / "bomb.fmu")
