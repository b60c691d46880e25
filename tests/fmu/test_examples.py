"""The examples with FMUs run, and their numbers are right."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

import latin_fmu
from latin_fmu.cosim import Session

from .host import Host

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def example(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module named by the test's parameter."""
    for folder in (EXAMPLES, EXAMPLES / "benchmarks"):
        monkeypatch.syspath_prepend(str(folder))
    return importlib.import_module(request.param)


def test_every_example_is_tested_here():
    names = {path.stem for path in EXAMPLES.glob("fmu_*.py")}
    others = {"fmu_first", "fmu_sweep", "fmu_cut_bar", "fmu_package", "fmu_model_exchange", "fmu_stop"}
    assert names == {*others, "fmu_pythonfmu"}


@pytest.mark.parametrize("example", ["fmu_first"], indirect=True)
def test_first(example):
    numbers = example.main()
    assert numbers["force"] == pytest.approx(23.7e3, rel=0.02)
    assert 0.0 < numbers["slipping"] <= 1.0


@pytest.mark.parametrize("example", ["fmu_pythonfmu"], indirect=True)
def test_a_slave_of_pythonfmu_around_a_session(example, tmp_path):
    """The numbers of a session, to the bit after steps that are taken back."""
    host = Host(example.build(tmp_path), tmp_path / "slave")
    session = Session(latin_fmu.load_scene(example.MODEL, ["load.press.law=input"]))
    host.set(press=1.0)
    session.set_load("press", 1.0)
    host.start()
    session.initialize()
    forces = []
    for i in range(10):
        before = host.from_bytes(host.to_bytes(host.save()))
        host.set(press=0.2)
        assert host.step(i * 3e-7, 3e-7)
        host.restore(before)
        host.set(press=1.0 - 0.1 * i)
        session.set_load("press", 1.0 - 0.1 * i)
        assert host.step(i * 3e-7, 3e-7)
        assert session.step(i * 3e-7, 3e-7)
        forces.append(session.value("interface.crush.normalForce"))
        assert host.read(["force", "largest"]).tolist() == [forces[-1], max(0.0, *forces)]
    host.close()
    assert max(forces) > 8e3
    assert example.main()["largest"] == pytest.approx(9.89e3, rel=1e-3)


@pytest.mark.parametrize("example", ["fmu_sweep"], indirect=True)
def test_sweep(example):
    """No gap opens and the friction is the same share: the response is in proportion to the load."""
    assert example.main()["ratio"] == pytest.approx(2.0, rel=1e-2)


@pytest.mark.parametrize("example", ["fmu_stop"], indirect=True)
def test_stop(example, tmp_path):
    """The L2 error of the contact force is below the limits of both kinds of exchange, at dt and at 5 dt."""
    numbers = example.main(["--quick", "-o", str(tmp_path)])
    limits = {("waves", 1): 0.02, ("waves", 5): 0.06, ("force and rate", 1): 0.002, ("force and rate", 5): 0.01}
    for (kind, parts), limit in limits.items():
        assert 0.0 < numbers[f"error, {kind}, {parts} dt"] < limit
        assert numbers[f"error, waves, strip not taken off, {parts} dt"] > limit
    if importlib.util.find_spec("libcosimpy"):
        for parts in (1, 5):
            ours, theirs = (numbers[f"error, {kind}, {parts} dt"] for kind in ("waves", "waves, libcosim"))
            assert theirs == pytest.approx(ours, rel=1e-6)
    assert numbers["peak of its second half over that of its first"] <= 1.0
    assert (tmp_path / "stop.png").stat().st_size > 10_000


@pytest.mark.parametrize("example", ["fmu_cut_bar"], indirect=True)
def test_a_bar_cut_into_two_fmus_is_the_whole_bar(example):
    numbers = example.main()
    assert numbers["error"] < 1e-7
    assert numbers["iterations"] < 4


@pytest.mark.parametrize("example", ["fmu_package"], indirect=True)
def test_package(example):
    assert example.main() == {"components": 2, "connections": 1}


@pytest.mark.slow
@pytest.mark.parametrize("example", ["fmu_overhead"], indirect=True)
def test_overhead(example):
    numbers = example.main()
    assert numbers["overhead"] < 0.05
    assert numbers["operators"] == 2  # one for each of the two specimens, in a thousand steps
    assert numbers["reading"] < 2e-3
    assert numbers["kernels"] < numbers["single"] < 2.0 * numbers["kernels"]  # 1.5 where nothing else runs
