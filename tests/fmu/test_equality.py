"""The FMU and the session give the same numbers, to the last digit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.cosim import Session, Settings
from tests.cosim.scenes import bar, blocks

from .host import COMPILED, Host
from .test_compiled import equal

H = 0.6e-6


def test_windowed(opened, fmi):
    host, session = opened(fmi), Session(blocks())
    host.start()
    session.initialize()
    names = list(session.outputs)
    t = 0.0
    for i, h in enumerate([H, H, 0.37 * H, 2 * H, H]):
        host.set(load__press__value=0.2 * i, load__press__rate=1e4)
        session.set_load("press", 0.2 * i, 1e4)
        assert host.step(t, h)
        assert session.step(t, h)
        t = t + h
        assert np.array_equal(host.read(names), session.values(names))
        assert fmi == "2" or host.read(["time"]) == t
    assert abs(session.value("interface.crush.force[3]")) > 100.0


def test_prescribed_from_a_file(opened, fmi, tmp_path):
    """The run with the loads as laws, but for the order of sums over the points: 1e-13 of the largest force."""
    times, values = [0.0, 2e-6, 6e-6], [0.0, 1.0, 0.3]
    file = tmp_path / "loads.csv"
    file.write_text("time,press\n" + "".join(f"{t!r},{a!r}\n" for t, a in zip(times, values, strict=True)))
    loads = blocks().model_dump()["load"]
    law = {"type": "table", "times": times, "values": values}
    whole = latin_fmu.solve(blocks(load={**loads, "press": {**loads["press"], "law": law}}))
    host = opened(fmi)
    host.set(mode=1, historyFile=str(file))
    host.start()
    assert not [m for m in host.messages if m[0] > 1], host.messages
    force, dt = whole.interfaces["crush"].force(), 6e-6 / 30
    for i in range(30):
        assert host.step(i * dt, dt)
        read = np.array(host.read([f"interface.crush.force[{k}]" for k in (1, 2, 3)]))
        assert np.abs(read - force[i + 1]).max() <= 1e-13 * np.abs(force).max()
    assert not host.step(30 * dt, dt)
    assert "endTime" in host.messages[-1][2]


@pytest.fixture
def near(made, fmus) -> Callable[[Any, Any], None]:
    """Check arrays of an FMU: with Python those of the session but for the order of sums over the points, compiled 1e-9
    of the largest."""

    def check(found: Any, wanted: Any) -> None:
        limit = (1e-12 if made is fmus else 1e-9) * np.nanmax(np.abs(wanted))
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=limit)

    return check


@pytest.fixture
def same(made, fmus) -> Callable[[Host, Session], None]:
    """Check all outputs in this way, compiled against the largest of their unit."""

    def check(host: Host, session: Session) -> None:
        if made is fmus:
            assert np.array_equal(host.read(list(session.outputs)), session.row)
        else:
            equal(host, session)

    return check


def test_prescribed_from_a_table_in_place_of_a_path(made, opened, fmi, same):
    """For hosts without a file system of their own: the string is the table."""
    session = Session(blocks(), Settings(mode=1))
    session.set_history("press", [0.0, 2e-6, 6e-6], [0.0, 1.0, 0.3])
    session.initialize()
    assert session.step(0.0, 3.1e-6)
    for mark in (";", "\n"):
        host = opened(fmi, made[fmi])
        host.set(mode=1, historyFile=mark.join(["time,press", "0,0", "2e-6,1", "6e-6,0.3"]))
        host.start()
        assert host.step(0.0, 3.1e-6), host.messages
        same(host, session)


@pytest.mark.parametrize(
    "table",
    [
        "time,pres;0,0;1e-6,1",
        "press;1",
        "time,press;0,0;0,1",
        "time,press;0,x",
        "time,press;",
        "time,press,press;0,0,1",
    ],
)
def test_a_table_that_cannot_be_used_is_an_error(made, opened, table):
    host = opened("2", made["2"])
    host.set(mode=1, historyFile=table)
    with pytest.raises(FMICallException):
        host.start()
    assert host.messages[-1][0] == 3
    assert not host.step(0.0, H)


def test_a_prescribed_run_is_in_its_file_without_a_step(opened, fmi, tmp_path):
    """For hosts without arrays: terminated right after initialization."""
    host = opened(fmi)
    host.set(mode=1, historyFile="time,press;0,0;3e-6,1", resultsFile=str(tmp_path / "window.nc"))
    host.start()
    host.fmu.terminate()
    session = Session(blocks(), Settings(mode=1))
    session.set_history("press", [0.0, 3e-6], [0.0, 1.0])
    session.initialize()
    with latin_fmu.open_results(tmp_path / "window.nc") as tree:
        force = session.window()[1]["crush"].force()
        assert np.abs(tree["interfaces/crush"]["force"].values - force).max() <= 1e-12 * np.abs(force).max()


def test_prescribed_from_netcdf(opened, tmp_path):
    import xarray as xr

    file = tmp_path / "loads.nc"
    xr.Dataset({"press": ("time", [0.0, 1.0])}, coords={"time": [0.0, 3e-6]}).to_netcdf(file, engine="netcdf4")
    session = Session(blocks(), Settings(mode=1))
    session.set_history("press", [0.0, 3e-6], [0.0, 1.0])
    session.initialize()
    host = opened("2")
    host.set(mode=1, historyFile=str(file))
    host.start()
    assert host.step(0.0, 4e-6)
    session.step(0.0, 4e-6)
    names = list(session.outputs)
    assert np.array_equal(host.read(names), session.values(names))


def test_prescribed_from_arrays(made, opened, same, near):
    """Another instance that is given the state solves the histories that it holds."""
    times, values = [0.0, 1e-6, 3e-6], [0.0, 0.8, 0.1]
    session = Session(blocks(), Settings(mode=1))
    session.set_history("press", times, values)
    session.initialize()
    host, other = (opened("3", made["3"]) for _ in range(2))
    host.fmu.enterConfigurationMode()
    host.set(history__size=4)
    host.fmu.exitConfigurationMode()
    host.set(mode=1, history__time=[*times, times[-1]], load__press__history=[*values, values[-1]])
    host.start()
    assert host.read(["window.count"]) == 31
    assert host.step(0.0, 4e-6), host.messages
    session.step(0.0, 4e-6)
    same(host, session)
    time, interfaces = session.window()
    history = interfaces["crush"]
    assert host.read(["window.count"]) == len(time)
    near(host.array("window.time", 31), time)
    near(host.array("interface.crush.window.force", 93).reshape(31, 3), history.force())
    near(host.array("interface.crush.points.traction", 27).reshape(9, 3), history.traction[20])
    other.restore(other.from_bytes(host.to_bytes(host.save())))
    assert all(one.step(4e-6, 1e-6) for one in (host, other))
    assert np.array_equal(other.read(), host.read())


def padded(values: list[float], size: int = 101) -> list[float]:
    """An array of the size a host finds: the last value repeated."""
    return values + [values[-1]] * (size - len(values))


def test_arrays_of_the_size_they_have(fmus, opened):
    """A host without structural parameters sets whole arrays; the whole window is there before the first step."""
    times, values = padded([0.0, 1e-6, 3e-6]), padded([0.0, 0.8, 0.1])
    session = Session(blocks(), Settings(mode=1))
    session.set_history("press", times[:3], values[:3])
    session.initialize()
    host = opened("3")
    host.set(mode=1, history__time=times, load__press__history=values)
    host.start()
    time, interfaces = session.window()
    assert host.read(["window.count"]) == len(time) == 31
    assert np.array_equal(host.array("window.time", 31), time)
    force = interfaces["crush"].force()
    assert np.abs(host.array("interface.crush.window.force", 93).reshape(31, 3) - force).max() <= 1e-12 * force.max()
    assert host.array("interface.crush.window.closed", 31)[0] == session.value("interface.crush.closed")
    given = {"mode": 1, "history.time": times, "load.press.history": values}
    assert session.step(0.0, 3e-6)
    for defaults in (False, True):
        result = fmpy.simulate_fmu(
            str(fmus["3"]),
            stop_time=3e-6,
            output_interval=1e-6,
            start_values=given,
            apply_default_start_values=defaults,
            output=["interface.crush.force[3]"],
        )
        assert result["interface.crush.force[3]"][-1] == session.value("interface.crush.force[3]")


def test_arrays_nobody_sets_are_no_histories(fmus):
    result = fmpy.simulate_fmu(
        str(fmus["3"]), stop_time=3e-6, output_interval=3e-6, start_values={"mode": 1}, apply_default_start_values=True
    )
    session = Session(blocks(), Settings(mode=1))
    session.initialize()
    assert session.step(0.0, 3e-6)
    assert result["interface.crush.force[3]"][-1] == session.value("interface.crush.force[3]") != 0.0


def test_arrays_of_a_windowed_step(made, opened, near):
    """Over the instants of the step, 0 behind them, and at the points."""
    host, session = opened("3", made["3"]), Session(blocks())
    host.set(load__press__value=1.0)
    session.set_load("press", 1.0, 0.0)
    host.start()
    session.initialize()
    for i in range(3):
        assert host.step(i * 1e-6, 1e-6)
        assert session.step(i * 1e-6, 1e-6)
    time, interfaces = session.window()
    history = interfaces["crush"]
    assert host.read(["window.count"]) == 6
    near(host.array("window.time", 31)[:6], time)
    assert not host.array("window.time", 31)[6:].any()
    assert not host.array("interface.crush.window.force", 93)[18:].any()
    for name, expected in {
        "window.force": history.force(),
        "points.traction": history.traction[-1],
        "points.velocity": history.velocity[-1],
        "points.gap": history.gap[-1],
        "points.status": history.contact_status[-1],
    }.items():
        size = 93 if name.startswith("window") else expected.size
        near(host.array(f"interface.crush.{name}", size)[: expected.size].reshape(expected.shape), expected)


def test_a_host_without_arrays_reads_their_first_elements(opened):
    """One number per variable is what pathsim-fmi reads; any other count that does not fit is an error."""
    host = opened("3")
    host.start()
    host.set(load__press__value=1.0)
    assert host.step(0.0, 1e-6)
    names = ["interface.crush.points.traction", "interface.crush.force[3]", "interface.crush.points.status"]
    whole = [host.array(name, size)[0] for name, size in zip(names, (27, 1, 9), strict=True)]
    references = [host.reference(name) for name in names]
    assert np.array_equal(host.fmu.getFloat64(references, nValues=3), whole)
    with pytest.raises(FMICallException):
        host.fmu.getFloat64(references, nValues=4)
    assert "reads 4 values of variables with 37 values" in host.messages[-1][-1]


def test_a_host_that_sets_values_alone_gets_the_causal_line(opened, fmi):
    host, session = opened(fmi), Session(blocks(), Settings(keep=True))
    host.start()
    session.initialize()
    for i, value in enumerate((0.25, 0.4, 0.7, 0.9)):
        host.set(load__press__value=value)
        session.set_load("press", value)
        assert host.step(i * H, H)
        assert session.step(i * H, H)
    assert np.array_equal(host.read(list(session.outputs)), session.row)
    assert session.step_history.head.step.rate["press"] == pytest.approx(0.2 / H)


def test_the_tolerance_of_the_host_is_taken(opened):
    host, session = opened("2"), Session(blocks(), Settings(tolerance=1e-6))
    host.start(tolerance=5e-6)  # a relative accuracy: the iteration leaves a tenth of it
    session.initialize()
    host.step(0.0, H)
    session.step(0.0, H)
    assert host.read(["solver.errorIndicator"]) == session.value("solver.errorIndicator") <= 1e-6
    assert host.read(["interface.crush.velocityE[3]"]) == pytest.approx(
        session.value("interface.crush.velocityE[3]"), rel=1e-12
    )


def test_simulate_fmu_runs_without_a_stop_time_in_the_setup(fmus, fmi):
    result = fmpy.simulate_fmu(
        str(fmus[fmi]),
        stop_time=3e-6,
        output_interval=1e-6,
        start_values={"load.press.value": 0.5},
        output=["interface.crush.force[3]"],
    )
    assert len(result) == 4


def early_steps(fmu: Any, stop: float, h: float) -> list[tuple[bool, float]]:
    """Whether a step of FMI 3 ended early and where, step by step."""
    ends, t = [], 0.0
    while t < stop - 1e-12:
        event, terminated, early, reached = fmu.doStep(t, min(h, stop - t))
        assert not event
        assert not terminated
        ends.append((early, reached))
        t = reached
    return ends


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=COMPILED)])
@pytest.mark.parametrize("mode", [0, 1])
def test_a_step_ends_early_where_the_host_allows_it(tmp_path, mode, compiled):
    """The bar touches the wall at 0.05 s and leaves it: each time the step ends with its time step of 0.02 s."""
    path = build_fmu(bar(), tmp_path / "bar.fmu", "3", python=not compiled)
    host, refusing = Host(path, tmp_path / "early", early=True), Host(path, tmp_path / "plain")
    for h in (host, refusing):
        h.set(mode=mode)
        h.start()
    ends = early_steps(host.fmu, 1.0, 0.3)
    assert [end for early, end in ends if early] == pytest.approx([0.06, 0.74])
    assert [end for early, end in ends if not early] == pytest.approx([0.36, 0.66, 1.0])
    plain = early_steps(refusing.fmu, 1.0, 0.2)
    assert [early for early, _ in plain] == [False] * 5
    names = [
        f"interface.wall.{name}" for name in ("touches", "lastTouch", "separations", "lastSeparation", "impulse[3]")
    ]
    assert host.read(names) == pytest.approx(refusing.read(names), rel=1e-6)
    assert host.read(names)[:2] == pytest.approx([1.0, 0.05])
    host.close()
    refusing.close()


def test_simulate_fmu_records_the_early_ends(tmp_path):
    path = build_fmu(bar(), tmp_path / "bar.fmu", "3", python=True)
    result = fmpy.simulate_fmu(str(path), stop_time=1.0, output_interval=0.2, early_return_allowed=True)
    times = [0.0, 0.06, 0.2, 0.4, 0.6, 0.74, 0.8, 1.0]
    assert result["time"] == pytest.approx(times)
    assert result["interface.wall.touches"] == pytest.approx([float(t > 0.05) for t in times])
