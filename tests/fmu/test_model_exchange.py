"""The Model Exchange FMU: valid, and in agreement with the co-simulation FMU of the same scene."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import latin_fmu
from fmu_build.build import build_fmu, build_model_exchange
from fmu_build.checks import validate
from latin_fmu import cli
from latin_fmu.errors import SceneError
from tests.cosim.scenes import bar, blocks
from tests.scenes import MINUTES, MODELS

from .exchange_host import ExchangeHost, integrate
from .test_hosts import SCRIPTS, ran, tool

SMALL = ["substructure.lower.box.elements=[3,3,3]", "substructure.upper.box.elements=[3,3,3]"]
CASES = {
    "impact_bar": ([], "wall"),
    "beam_in_traction": (["solver.window=1", "solver.acceleration=anderson"], "contact"),
    "two_specimen_crushing": (SMALL, "crush"),
}


@pytest.fixture(scope="module")
def pressed(tmp_path_factory) -> Path:
    """Two blocks with friction, a load from outside, a sensor, energies."""
    return build_model_exchange(blocks(), tmp_path_factory.mktemp("exchange") / "blocks.fmu", 6)


@pytest.fixture
def opened(pressed):
    hosts = []

    def open_fmu(path: Path = pressed) -> ExchangeHost:
        hosts.append(ExchangeHost(path))
        return hosts[-1]

    yield open_fmu
    for host in hosts:
        host.close()


NAMES = sorted({path.parent.name for path in MODELS.glob("*/scene.toml")} - {*MINUTES})
LONG = ("beam_in_traction", "hammer_on_plate", "lap_joint")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in NAMES])
def test_every_model_that_moves_gives_a_valid_fmu(name, tmp_path):
    if name == "stacked_blocks":
        pytest.skip("many substructures: the same code, more time")
    scene = latin_fmu.load_scene(MODELS / name / "scene.toml")
    if scene.time.quasi_static or name == "punched_plates":  # a punch on the middle of a plate
        with pytest.raises(SceneError, match="has no reduced model"):
            build_model_exchange(scene, tmp_path / "model.fmu", 4, 2)
        return
    assert validate(build_model_exchange(scene, tmp_path / "model.fmu", 4, 2)) == []


def test_with_inputs_and_sensors_too(pressed):
    assert validate(pressed) == []


@pytest.mark.parametrize("case", CASES)
def test_impulse_of_the_contact_is_that_of_the_solver(case, tmp_path):
    """Two descriptions of contact, two integrators, two models of the bodies: 2 % on the impulse of the contact."""
    overrides, contact = CASES[case]
    scene = latin_fmu.load_scene(MODELS / case / "scene.toml", [*overrides, "output.fields=false"])
    history = latin_fmu.solve(scene).outcome.interfaces[contact]
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    impulse, force = history.impulse(time)[-1, 2], history.normal_resultant()
    reduced, cpu = integrate(build_model_exchange(scene, tmp_path / "me.fmu"))
    assert reduced[f"interface.{contact}.impulse[3]"][-1] == pytest.approx(impulse, rel=0.02)
    reduced_force = reduced[f"interface.{contact}.normalForce"]
    assert reduced_force.max() == pytest.approx(force.max(), rel=0.35)
    assert (reduced_force >= -1e-3 * reduced_force.max()).all()
    starts = [t[np.argmax(f > 0.05 * f.max())] for t, f in ((time, force), (reduced["time"], reduced_force))]
    assert starts[1] == pytest.approx(starts[0], abs=0.03 * scene.time.end)
    assert cpu < 20.0


@pytest.mark.slow
def test_more_modes_come_closer(tmp_path):
    """Two bars with a gap: 6 % off with 4 modes per body, 0.8 % with 24."""
    overrides, contact = CASES["beam_in_traction"]
    scene = latin_fmu.load_scene(MODELS / "beam_in_traction" / "scene.toml", [*overrides, "output.fields=false"])
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    exact = latin_fmu.solve(scene).outcome.interfaces[contact].impulse(time)[-1, 2]
    few, many = (
        integrate(build_model_exchange(scene, tmp_path / "me.fmu", n, 1))[0][f"interface.{contact}.impulse[3]"][-1]
        for n in (4, 24)
    )
    assert abs(many / exact - 1.0) < 0.012 < 0.03 < abs(few / exact - 1.0)


def test_impulse_of_the_contact_is_that_of_the_fmu_for_co_simulation(pressed, fmus):
    load = {"load.press.value": 1.0}
    reference = fmpy.simulate_fmu(str(fmus["3"]), start_values=load, output_interval=0.2e-6)
    compare(reference, integrate(pressed, load)[0], "crush", 0.03)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_shipped_models_agree_with_their_fmu_for_co_simulation(case, tmp_path):
    overrides, contact = CASES[case]
    scene = latin_fmu.load_scene(MODELS / case / "scene.toml", overrides)
    step = 2 * scene.time.time_step
    reference = fmpy.simulate_fmu(str(build_fmu(scene, tmp_path / "co.fmu", "3", python=True)), output_interval=step)
    compare(reference, integrate(build_model_exchange(scene, tmp_path / "me.fmu"))[0], contact, 0.02)


def compare(reference, reduced, contact: str, tolerance: float) -> None:
    """The same variables, one to one."""
    for axis in (1, 2, 3):
        name = f"interface.{contact}.impulse[{axis}]"
        largest = abs(reference[f"interface.{contact}.impulse[3]"][-1])
        assert largest > 0.0
        assert reduced[name][-1] == pytest.approx(reference[name][-1], abs=tolerance * largest)
    ours = {name for name in reduced.dtype.names if not name.startswith(("energy.contact", "model."))}
    assert ours <= set(reference.dtype.names)


def test_thrown_bar_gives_back_its_momentum(tmp_path):
    """Closed form: the bar leaves as it came, after 2 L / c; the impulse is twice its momentum, 2 m v = 200 N s."""
    base = bar().model_dump()["substructure"]["bar"]
    box = {"origin": [0.0, 0.0, 0.5], "size": [1.0, 1.0, 10.0], "elements": [1, 1, 40]}
    body = {"material": base["material"], "box": box, "initial_velocity": [0.0, 0.0, -10.0]}
    scene = bar(substructure={"bar": body}, time={"end": 1.2, "instants": 60})
    result, _ = integrate(build_model_exchange(scene, tmp_path / "bar.fmu", 20))
    assert result["interface.wall.impulse[3]"][-1] == pytest.approx(200.0, rel=0.01)
    touching = result["time"][result["interface.wall.closed"] > 0.5]
    assert touching[0] == pytest.approx(0.05, abs=0.01)
    assert touching[-1] - touching[0] == pytest.approx(2.0 * 10.0 / 30.0, rel=0.03)
    assert result["interface.wall.velocityE[3]"][0] == pytest.approx(-10.0)


@pytest.mark.slow
def test_another_host_with_another_integrator(tmp_path):
    """pathsim-fmi with an explicit Runge-Kutta scheme finds the impulse and the events of fmpy with CVode."""
    fmu = build_model_exchange(bar(time={"end": 1.2, "instants": 60}), tmp_path / "bar.fmu", 8)
    name = "interface.wall.impulse[3]"
    script = str(SCRIPTS / "with_pathsim_exchange.py")
    command = [tool("common", "python"), script, str(fmu), "1.2", name]
    value, events = json.loads(ran(command, tmp_path).splitlines()[-1])
    result, _ = integrate(fmu)
    assert value == pytest.approx(result[name][-1], rel=1e-3)
    assert events == result["model.events"][-1]


@pytest.mark.slow
def test_fmutool_finds_nothing(pressed, tmp_path):
    output = ran([tool("common", "fmutool"), "-input", str(pressed), "-check"], tmp_path)
    assert "compliant with FMI-3.0" in output
    assert "No semantic error" in output


def test_energies(pressed):
    """The balance closes to the tolerance of the integrator, and what is lost never comes back."""
    result, _ = integrate(pressed, {"load.press.value": 1.0})
    work = np.abs(result["energy.work_of_loads"]).max()
    assert np.abs(result["energy.balance"]).max() < 2e-3 * work
    for name in ("friction_dissipation", "contact_dissipation"):
        assert (np.diff(result[f"energy.{name}"]) >= -1e-6 * work).all()
    stored = result["energy.kinetic"] + result["energy.elastic"] + result["energy.contact"]
    lost = result["energy.friction_dissipation"] + result["energy.contact_dissipation"]
    assert np.abs(stored + lost - result["energy.work_of_loads"]).max() < 3e-3 * work


def test_events_are_few_and_counted(pressed):
    """Contact states change some dozen times; chatter would be thousands."""
    events = []
    result, _ = integrate(pressed, {"load.press.value": 1.0}, events)
    assert 4 <= result["model.events"][-1] <= 150
    assert len(events) <= 200
    assert (np.diff(result["model.events"]) >= 0).all()
    shares = result["interface.crush.sticking"] + result["interface.crush.slipping"]
    np.testing.assert_allclose(shares, result["interface.crush.closed"])


@pytest.mark.slow
def test_stiffer_contact_penetrates_less(pressed):
    soft, stiff = (
        integrate(pressed, {"load.press.value": 1.0, "contactStiffness": k})[0]["interface.crush.smallestGap"].min()
        for k in (5.0, 50.0)
    )
    assert soft < 3.0 * stiff < 0.0


def test_an_input_drives_the_load(pressed):
    """A ramp given by value and rate is the ramp given by many values.

    Tight tolerance: the host changes values between the steps of an integrator that is not informed of these jumps."""
    ramp = np.array([(0.0, 0.0), (6e-6, 1.0)], dtype=[("time", float), ("load.press.value", float)])
    by_values, _ = integrate(pressed, signals=ramp, tolerance=1e-8)
    by_rate, _ = integrate(pressed, {"load.press.value": 0.0, "load.press.rate": 1.0 / 6e-6}, tolerance=1e-8)
    for name in ("interface.crush.impulse[3]", "sensor.head.velocity[3]"):
        assert by_values[name][-1] == pytest.approx(by_rate[name][-1], rel=5e-3)


def test_same_scene_same_bytes(pressed, tmp_path):
    again = build_model_exchange(blocks(), tmp_path / "again.fmu", 6)
    assert again.read_bytes() == pressed.read_bytes()
    assert build_model_exchange(blocks(), again, 5).read_bytes() != pressed.read_bytes()


def test_contents(pressed):
    with zipfile.ZipFile(pressed) as archive:
        names = set(archive.namelist())
        page = archive.read("documentation/index.html").decode()
        needs = archive.read("documentation/externalDependencies.txt").decode()
    assert {"resources/reduced.bin", "terminalsAndIcons/icon.png", "documentation/licenses/license.txt"} <= names
    assert "cross-check" in page
    assert "interface.crush.gapIndicator[4]" in page
    assert "numba" not in needs


# -- faults and states ----------------------------------------------------------------------------------------------


def test_states_are_exact(opened):
    host = opened()
    host.start(**{"load.press.value": 1.0})
    rng = np.random.default_rng(0)
    states = host.states() + 1e-9 * rng.normal(size=host.n_state)
    host.go(1e-7, states)
    saved = host.fmu.getFMUState()
    serialized = bytes(host.fmu.serializeFMUState(saved))
    before = host.look()
    host.update()
    host.go(3e-6, np.zeros(host.n_state))
    assert not np.array_equal(host.look(), before)
    for state in (saved, host.fmu.deserializeFMUState(serialized)):
        host.fmu.setFMUState(state)
        np.testing.assert_array_equal(host.look(), before)
    other = opened()
    other.start()
    other.fmu.setFMUState(other.fmu.deserializeFMUState(serialized))
    np.testing.assert_array_equal(other.look(), before)
    for wrong in (b"nonsense", serialized[:-1], serialized[:200] + bytes([serialized[200] ^ 1]) + serialized[201:]):
        with pytest.raises(FMICallException):
            other.fmu.deserializeFMUState(wrong)
        assert "state cannot be used" in other.messages[-1][1]
        np.testing.assert_array_equal(other.look(), before)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_input_that_is_no_number_ends_the_simulation(opened, value):
    host = opened()
    host.start()
    host.set("load.press.value", value)
    assert host.messages[-1][0] == 3
    assert "load.press.value" in host.messages[-1][1]
    assert not np.isfinite(host.derivatives()).all()
    assert host.update()[1]
    host.set("load.press.value", 0.5)
    assert np.isfinite(host.derivatives()).all()
    assert not host.update()[1]


def test_states_that_are_no_numbers_leave_the_instance_alive(opened):
    host = opened()
    host.start()
    good = host.states()
    reference = host.derivatives()
    host.go(0.0, np.full(host.n_state, np.nan))
    assert not np.isfinite(host.derivatives()).any()
    host.go(0.0, np.full(host.n_state, 1e300))
    host.derivatives()
    host.go(0.0, good)
    np.testing.assert_array_equal(host.derivatives(), reference)


def test_a_host_with_cvode_stops_on_a_bad_input(pressed):
    """The integrator cannot converge on NaN, with a message."""
    rows = [(0.0, 1.0), (2e-6, 1.0), (2.1e-6, np.nan)]
    signals = np.array(rows, dtype=[("time", float), ("load.press.value", float)])
    with pytest.raises(RuntimeError, match="CVode"):
        integrate(pressed, signals=signals)


@pytest.mark.parametrize(("name", "value"), [("contactStiffness", 0.0), ("slidingVelocity", np.nan)])
def test_bad_parameters_are_refused(opened, name, value):
    host = opened()
    kept = host.read(name)
    with pytest.raises(FMICallException):
        host.set(name, value)
    assert host.messages[-1][0] == 3
    assert host.read(name) == kept


def test_start_values_of_states_and_reset(opened):
    """Another start is taken; a reset removes it."""
    host = opened()
    name = "modes.lower.velocity[1]"
    host.start(**{name: 3.0})
    assert 3.0 in host.states()
    thrown = host.derivatives()
    host.fmu.reset()
    host.start()
    assert host.read(name) == 0.0
    assert not np.array_equal(host.derivatives(), thrown)


def test_what_is_calculated_or_fixed_is_not_set(opened):
    host = opened()
    host.start()
    for name in ("interface.crush.normalForce", "contactStiffness", "der(modes.lower.velocity[1])"):
        with pytest.raises(FMICallException):
            host.set(name, 1.0)
        assert "was not set" in host.messages[-1][1]


def test_many_instances_do_not_disturb_each_other(opened):
    hosts = [opened() for _ in range(5)]
    for i, host in enumerate(hosts):
        host.start(**{"load.press.value": float(i)})
    derivatives = [host.derivatives() for host in hosts]
    np.testing.assert_allclose(
        derivatives[4] - derivatives[0], 4 * (derivatives[1] - derivatives[0]), rtol=1e-9, atol=1e-3
    )


def test_scenes_without_a_reduced_model_are_refused(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    sides = ["lower.zmax", "upper.zmin"]
    scene.write_text(blocks(interface={"crush": {"sides": sides, "behaviour": "no_slip"}}).text())
    target = tmp_path / "x.fmu"
    assert cli.main(["fmu", str(scene), "-o", str(target), "--model-exchange"]) == 2
    assert "has no regularised law" in capsys.readouterr().err
    assert not target.exists()


def test_command(tmp_path, capsys):
    scene, target = tmp_path / "scene.toml", tmp_path / "x.fmu"
    scene.write_text(blocks().text())
    asked = ["fmu", str(scene), "-o", str(target)]
    assert cli.main([*asked, "--model-exchange", "--modes", "3", "--patches", "1"]) == 0
    assert "valid" in capsys.readouterr().out
    assert fmpy.read_model_description(str(target)).modelExchange is not None
    for wrong in (["--patches", "3"], ["--model-exchange", "--fmi", "2"]):
        assert cli.main([*asked, *wrong]) == 2
        assert "contradict" in capsys.readouterr().err


def test_simulate(pressed, tmp_path, capsys):
    """The command integrates, and prints where and why an integration ends."""
    out, loads = tmp_path / "out.csv", tmp_path / "loads.csv"
    loads.write_text("time,load.press.value\n0,0\n6e-6,1\n")
    asked = ["simulate", str(pressed), "-o", str(out), "--input", str(loads), "--step", "1e-6"]
    assert cli.main(asked) == 0
    rows = out.read_text().splitlines()
    assert len(rows) == 8
    assert float(rows[-1].split(",")[rows[0].split(",").index("interface.crush.normalForce")]) > 0.0
    loads.write_text("time,load.press.value\n0,1\n2e-6,1\n2.1e-6,nan\n")
    assert cli.main(asked) == 2
    assert "no finite number in column load.press.value" in capsys.readouterr().err
    loads.write_text("time,load.press.value\n0,1\n2e-6,1\n2.1e-6,1e308\n")
    assert cli.main(asked) == 3
    assert "At t = 2.00" in capsys.readouterr().err
    assert cli.main([*asked[:4], "--start", "load.pres.value=1"]) == 2
    assert "no variable of this name" in capsys.readouterr().err
