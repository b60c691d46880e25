"""Communication steps of an assembly that is marched by its modes, against the run of the same scene."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.checks import validate
from latin_fmu import Scene, scene_from_dict
from latin_fmu.api import solve
from latin_fmu.cosim import communication
from latin_fmu.cosim.product_tables import shorten
from latin_fmu.cosim.session import Session
from latin_fmu.cosim.settings import Settings
from latin_fmu.errors import SceneError
from latin_fmu.results.solution import Solution
from tests.verification.test_modal_march import CORD, DASHPOTS, damped_by_ratios, lap
from tests.verification.test_modal_studies import stacked

MODELS = Path(__file__).parents[2] / "models"
EXACT = 1e-5  # of the largest of a history: the tolerance of both iterations, rows of displacements being exact
OF_RATES = 1e-2  # rates of relative motions over the last step, where the run has central differences
OF_FORCES = 5e-3  # of bonds, reactions and bolts, by the same rates and without accelerations of relative motions
OF_ROUNDING = 3e-5  # of tables of the march, at the default tolerance
OF_ACCELERATIONS = 1e-1  # of the stacks, whose steps are a third of the shortest period
OF_GAPS = 1e-4  # of a few nm in stiff stacks, where both iterate to 1e-5 by other windows
Histories = Mapping[str, np.ndarray]


def modal(tables: dict[str, Any], **time: Any) -> dict[str, Any]:
    """The scene by its modes, without energies."""
    other = copy.deepcopy(tables)
    other["solver"]["propagator"] = {"type": "modal"}
    other["output"]["energy"] = False
    other["time"] |= time
    return other


def outputs_of(scene: Scene, inputs: Histories, dt: float) -> tuple[Session, Histories]:
    """Outputs at the instants of a session whose inputs are straight lines between those of their histories."""
    session = Session(scene)
    count = scene.time.n_step
    if scene.time.start.type != "static":  # the image is made for other values than those of the simulation
        session.initialize()
        session.reset()
    for name, values in inputs.items():
        session.set_load(name, float(values[0]))
    session.initialize()
    rows = [session.row.copy()]
    for i in range(count):
        for name, values in inputs.items():
            session.set_load(name, float(values[i]), float(values[i + 1] - values[i]) / dt)
        assert session.step(i * dt, dt)
        rows.append(session.row.copy())
    return session, dict(zip(session.outputs, np.transpose(rows), strict=True))


def beside(tables: dict[str, Any], name: str, table: tuple[str, str], law: str = "law") -> tuple[Solution, Histories]:
    """The run of a scene, and the outputs of the session to which the amplitude of a law is given."""
    solution = solve(scene_from_dict(copy.deepcopy(tables)))
    assert solution.converged
    family, of = table
    sampled = scene_from_dict(copy.deepcopy(tables))
    amplitude = getattr(getattr(sampled, family)[of], law).sample(solution.time)
    other = copy.deepcopy(tables)
    other[family][of][law] = "input"
    dt = float(solution.time[1] - solution.time[0])
    _, outputs = outputs_of(scene_from_dict(other), {name: amplitude}, dt)
    return solution, outputs


def vector(outputs: Histories, name: str) -> np.ndarray:
    """Three components over the instants, (n, 3)."""
    return np.stack([outputs[f"{name}[{axis}]"] for axis in (1, 2, 3)], axis=1)


def assert_close(found: np.ndarray, wanted: np.ndarray, limit: float) -> None:
    """Within a share of the largest."""
    assert np.abs(found - wanted).max() <= limit * np.abs(wanted).max()


def assert_outputs(solution: Solution, outputs: Histories, contacts: tuple[str, ...]) -> None:
    """Of interfaces and sensors."""
    for name, history in solution.interfaces.items():
        share = history.areas / history.areas.sum()
        exact = EXACT if name in contacts else OF_FORCES
        assert_close(vector(outputs, f"interface.{name}.force"), history.force(), max(exact, 2e-5))
        for side, of in enumerate(("velocityE", "velocityEp")):
            mean = np.einsum("p,tpc->tc", share, history.velocity[:, side])
            if mean.any():
                assert_close(vector(outputs, f"interface.{name}.{of}"), mean, OF_RATES)
        if history.gap is not None:
            assert_close(outputs[f"interface.{name}.gap"], history.gap @ share, OF_GAPS)
            closed = (history.contact_status != 0) @ share
            assert outputs[f"interface.{name}.closed"] == pytest.approx(closed, abs=1e-9)
    for name, sensor in solution.sensors.items():
        assert_close(vector(outputs, f"sensor.{name}.displacement"), sensor.displacement, EXACT)
        assert_close(vector(outputs, f"sensor.{name}.velocity"), sensor.velocity, OF_RATES)
        # rates over the last step: between those of the run at its ends
        mean = 0.5 * (sensor.acceleration[1:] + sensor.acceleration[:-1])
        assert_close(vector(outputs, f"sensor.{name}.acceleration")[1:], mean, OF_ACCELERATIONS)


@pytest.mark.parametrize("start", ["static", "given"])
def test_outputs_of_a_stack_are_those_of_the_run(start: str) -> None:
    """Contact with friction, a bond, damping by ratios, a hit."""
    solution, outputs = beside(modal(stacked(), start=start), "tip", ("load", "tip"))
    assert_outputs(solution, outputs, ("lap",))


def test_a_load_that_is_there_at_the_start_begins_as_in_the_run() -> None:
    """The modes begin with what the load makes of them at once, as those that are left out have no inertia."""
    tables = modal(damped_by_ratios(lap()), start="given", end=2e-4)
    tables["load"]["tip"]["law"] = {"type": "table", "times": [0.0, 2e-4], "values": [1.0, 0.4]}
    solution, outputs = beside(tables, "tip", ("load", "tip"))
    assert_outputs(solution, outputs, ("lap",))


def test_springs_between_sides_and_to_the_ground() -> None:
    cord = {"ends": [{"substructure": "up", "point": [0.06, 0.01, 0.02]}, "ground"], **CORD}
    layer = {"behaviour": "elastic_layer", "normal_stiffness": 1e14, "tangential_stiffness": 4e13}
    solution, outputs = beside(modal(lap(layer, spring={"cord": cord}), end=4e-4), "tip", ("load", "tip"))
    assert_outputs(solution, outputs, ())


@pytest.mark.parametrize("low", ["contact", "bond", "springs"])
def test_a_moved_port_exerts_the_reaction_of_the_run(low: str) -> None:
    """The base of a stack, moved from outside; its reaction is that of a support with the same motion. The face shares
    nodes with the interface of the lowest plate."""
    steps = 250
    tables = modal(stacked(), end=steps * 2e-6)
    lap, glue = tables["interface"]["lap"], tables["interface"]["glue"]
    if low != "contact":
        lap["sides"], glue["sides"] = glue["sides"], lap["sides"]
    if low == "springs":
        layer = {"behaviour": "elastic_layer", "normal_stiffness": 1e14, "tangential_stiffness": 4e13}
        tables["interface"]["glue"] = {"sides": glue["sides"], **layer}
    time = 2e-6 * np.arange(steps + 1)
    values = 0.02 * np.sin(2.0 * np.pi * time / 3e-4)
    law = {"type": "table", "times": time.tolist(), "values": values.tolist()}
    base = {"type": "velocity", "face": "low.xmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 1.0], "law": law}
    del tables["load"]["tip"]
    run = copy.deepcopy(tables)
    run["boundary"] = {"clamp": base}
    solution = solve(scene_from_dict(run))
    assert solution.converged
    tables["boundary"] = {}
    tables["port"] = {"base": {"face": "low.xmin", "causality": "motion_in"}}
    _, outputs = outputs_of(scene_from_dict(tables), {"port.base.velocity[3]": values}, 2e-6)
    assert_close(-vector(outputs, "port.base.force"), solution.reactions["clamp"].force, OF_FORCES)
    assert_outputs(solution, outputs, ("lap",))


def test_the_tension_of_a_bolt_is_that_of_the_run() -> None:
    """The shipped lap joint, pulled; at its own tolerance the iterations of both differ by more."""
    changes = ["solver.propagator=modal", "solver.tolerance=1e-4", "output.energy=false"]
    scene = latin_fmu.load_scene(MODELS / "lap_joint" / "shock.toml", [*changes, "time.end=1e-4", "time.step=1e-6"])
    solution = solve(scene)
    assert solution.converged
    dt = float(solution.time[1] - solution.time[0])
    _, outputs = outputs_of(scene, {}, dt)
    for name, bolt in solution.bolts.items():
        assert_close(outputs[f"bolt.{name}.force"], bolt.force, 1e-4)
        row = bolt.sections.number("cut")
        for what, of in (("shearForce", bolt.section_force), ("bendingMoment", bolt.section_moment)):
            found = np.stack([outputs[f"bolt.{name}.{what}[{axis}]"] for axis in (1, 2)], axis=1)
            assert np.abs(found - of[:, row, 1:]).max() <= 1e-4 * np.abs(of[:, row]).max()
        change = bolt.force - bolt.force[0]
        assert_close(outputs[f"bolt.{name}.force"] - bolt.force[0], change, OF_FORCES)


def test_rounded_tables_change_less_than_the_tolerance_of_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of Y, S^-1 and the matrix of the outputs, beside tables with all their digits, at a tolerance of the iteration
    that shows it: rounded in proportion, and as for the default tolerance."""
    changes = ["propagator=modal", "tolerance=2e-6", "max_iterations=2000"]
    changes = [*(f"solver.{change}" for change in changes), "output.energy=false", "time.end=6e-5", "time.step=1e-6"]
    scene = latin_fmu.load_scene(MODELS / "lap_joint" / "shock.toml", changes)
    _, rounded = outputs_of(scene, {}, 1e-6)
    monkeypatch.setattr(communication, "shorten", lambda run, classes, fixed, _: shorten(run, classes, fixed, 1e-3))
    _, coarsely = outputs_of(scene, {}, 1e-6)
    monkeypatch.setattr(communication, "shorten", lambda *_: None)
    _, whole = outputs_of(scene, {}, 1e-6)
    names = [name for name in whole if name.endswith((".normalForce", ".largestForce", ".largestBendingMoment"))]
    names += [name for name in whole if name.startswith("sensor") and ".largest" in name]
    assert len(names) >= 10
    for found, limit in ((rounded, 0.05 * OF_ROUNDING), (coarsely, OF_ROUNDING)):
        change = {name: np.abs(found[name] - whole[name]).max() / np.abs(whole[name]).max() for name in names}
        assert 0.05 * limit < max(change.values()) <= limit, change


def test_steps_are_taken_back_to_the_last_bit() -> None:
    scene = scene_from_dict(input_stack())
    session, dt = Session(scene), scene.time.time_step
    session.initialize()
    for i in range(20):
        session.set_load("tip", 0.03 * i)
        assert session.step(i * dt, dt)
    state = session.snapshot()
    rows = []
    for _ in range(2):
        for i in range(20, 40):
            session.set_load("tip", 0.03 * i)
            assert session.step(i * dt, dt)
        rows.append(session.row.copy())
        session.restore(state)
    assert np.array_equal(*rows)
    other = Session(scene)
    other.restore(state)
    for i in range(20, 40):
        other.set_load("tip", 0.03 * i)
        assert other.step(i * dt, dt)
    assert np.array_equal(other.row, rows[0])


def input_stack() -> dict[str, Any]:
    """The stack with its hit from outside."""
    tables = modal(stacked())
    tables["load"]["tip"]["law"] = "input"
    return tables


def test_derivatives_are_those_of_other_steps() -> None:
    scene = scene_from_dict(input_stack())
    names = [
        "interface.lap.force[1]",
        "interface.glue.force[3]",
        "sensor.tip.displacement[3]",
        "sensor.tip.velocity[3]",
    ]
    dt = scene.time.time_step

    def stepped(change: float) -> Session:
        session = Session(scene, Settings(tolerance=1e-9))
        session.initialize()
        for i in range(30):
            session.set_load("tip", 0.03 * i + (change if i == 29 else 0.0))
            assert session.step(i * dt, dt)
        return session

    found = stepped(0.0).derivative(names, ["load.tip.value"], [1.0])
    more, less = (stepped(change).values(names) for change in (1e-2, -1e-2))
    assert found == pytest.approx((more - less) / 2e-2, rel=1e-3)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_compiled_fmu_has_the_bits_of_the_session(fmi: str, tmp_path: Path) -> None:
    from fmpy import simulate_fmu

    scene = scene_from_dict(input_stack())
    file = build_fmu(scene, tmp_path / "stack.fmu", fmi=fmi)
    assert not validate(file)
    dt, names = scene.time.time_step, ["interface.lap.normalForce", "interface.glue.force[3]", "sensor.tip.velocity[3]"]
    result = simulate_fmu(
        str(file), start_values={"load.tip.rate": 2e3}, stop_time=30 * dt, output_interval=dt, output=names
    )
    session = Session(scene)
    session.set_load("tip", 0.0, 2e3)
    session.initialize()
    for i in range(30):
        session.set_load("tip", 0.0, 2e3)
        assert session.step(i * dt, dt)
    assert [float(result[name][-1]) for name in names] == session.values(names).tolist()


def test_points_of_contacts_are_there_and_those_of_bonds_are_not() -> None:
    session = Session(scene_from_dict(input_stack()))
    session.set_load("tip", 0.0)
    session.initialize()
    assert session.step(0.0, 4e-6)
    _, histories = session.window()
    assert set(histories) == {"lap"}
    assert histories["lap"].force()[-1] == pytest.approx(
        session.values([f"interface.lap.force[{k}]" for k in (1, 2, 3)])
    )


def absorbing(tables: dict[str, Any]) -> None:
    """With dashpots at a face."""
    tables["boundary"]["far"] = {"type": "absorbing", "face": "top.xmax"}


def on_dashpots(tables: dict[str, Any]) -> None:
    """With dashpots between the sides of an interface."""
    tables["time"]["start"] = "given"
    tables["interface"]["lap"] = DASHPOTS


@pytest.mark.parametrize(
    ("change", "reason"), [(absorbing, "dashpots of an absorbing face"), (on_dashpots, "dashpots between its sides")]
)
def test_what_has_no_modes_is_refused(change: Callable[[dict[str, Any]], None], reason: str) -> None:
    tables = input_stack()
    change(tables)
    with pytest.raises(SceneError, match=reason):
        Session(scene_from_dict(tables)).initialize()


def test_energies_are_left_out_with_a_remark() -> None:
    tables = input_stack()
    tables["output"]["energy"] = True
    session = Session(scene_from_dict(tables))
    assert not any(name.startswith("energy.") for name in session.outputs)
    session.initialize()
    assert any("no energies are followed" in str(remark) for remark in session.warnings)
