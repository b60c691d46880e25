"""Derivatives by parameters against central differences of converged runs, and against closed forms."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu import api, attempts
from latin_fmu.assembly.problem import DiscretisedProblem, SolverReadyProblem
from latin_fmu.building import build
from latin_fmu.errors import ResultsError, SceneError, SolverError
from latin_fmu.interface.laws import SLIP, STICK
from latin_fmu.latin import search_direction
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.latin.search_direction import relative_operator
from latin_fmu.pictures.sensitivity_picture import tornado_figure
from latin_fmu.results import sensitivities
from latin_fmu.results.owner_records import InterfaceRecord
from latin_fmu.scene.quantity_table import INTERFACE, RunScalar, values_of
from latin_fmu.sensitivities import copies, riders, tangent_run
from latin_fmu.sensitivities.tangent_run import TangentRun
from latin_fmu.sensitivities.tangents import Tangents
from latin_fmu.stability.scenes import STEEL, Box, placed
from tests.results import synthetic
from tests.scenes import MODELS
from tests.verification import sensitivity_flags

TIGHT = ("solver.tolerance=1e-11", "solver.force_tolerance=1e-10", "output.fields=false", "output.energy=false")
STEP = 1e-5
CRUSHING = (
    "two_specimen_crushing",
    ("substructure.lower.box.elements=[3,3,3]", "substructure.upper.box.elements=[3,3,3]", "time.step=0.3e-6"),
    ("interface.crush.friction_coefficient", "load.press.pressure"),
)
HAMMER = (
    "hammer_on_plate",
    (
        "substructure.plate.box.elements=[6,6,2]",
        "substructure.hammer.box.elements=[2,2,4]",
        "time.step=1.9e-6",
        "time.end=1.9e-4",
    ),
    ("interface.blow.friction_coefficient", "substructure.hammer.initial_velocity.2"),
)
SHEAR = (
    "shear_interface",
    (),
    ("interface.fault.friction_coefficient", "interface.fault.preload", "load.incident.traction.0"),
)
BOUNCE = (
    "bouncing_bar",
    ("substructure.bar.box.elements=[1,1,20]", "time.instants=220", "interface.wall.gap=4.987"),
    ("interface.wall.gap", "substructure.bar.body_force.2"),
)
DAMPED = (BOUNCE[0], (*BOUNCE[1], "substructure.bar.modal_damping={ratio=0.05,below=30.0}"), BOUNCE[2])
PLATES = (
    "pressed_plates",
    tuple(f"substructure.p{i}.box.elements=[3,3,1]" for i in range(1, 9)),
    ("interface.i3.friction_coefficient", "load.press.pressure", "load.shear.traction.0"),
)
BOLTED = (
    "lap_joint",
    (
        'time={start="static",end=8e-6,step=5e-7}',
        'load.pull.law={type="half_sine",start=0.0,duration=2e-5}',
        'sensor.end={face="upper.upper_left",spectrum={lowest=5e4}}',
    ),
    ("contact.all.friction_coefficient", "bolt.m6.force", "load.pull.traction.0"),
)
MATERIALS = (
    "two_specimen_crushing",
    (
        "substructure.lower.box.elements=[2,2,2]",
        "substructure.upper.box.elements=[2,2,2]",
        "time.step=0.3e-6",
        "material.steel.rayleigh_stiffness=2e-8",
    ),
    ("material.steel.young_modulus", "material.aluminium.density", "material.steel.rayleigh_stiffness"),
)
LANDING = (
    "impact_bar",
    ("substructure.bar.box.elements.2=10", "time.instants=40", "interface.wall.gap=4.87"),
    ("material.bar.young_modulus", "material.bar.density"),
)
STRAINED = (
    "lap_joint",
    ('time={start="static",end=4e-6,step=5e-7}', 'load.pull.law={type="half_sine",start=0.0,duration=2e-5}'),
    ("material.steel.young_modulus", "material.steel.poisson_ratio"),
)
Case = tuple[str, tuple[str, ...], tuple[str, ...]]
SOFT = 'interface.crush={sides=["lower.zmax","upper.zmin"],behaviour="soft_contact",normal_stiffness=1e14,'
PULSE = 'law={type="half_sine",duration=1e-5}}'
HEAT = ("material.steel.thermal_expansion=12e-6", "material.aluminium.thermal_expansion=23e-6")
RAMP = '{type="table",times=[0.0,0.25,1.0],values=[0.0,1.0,1.0]}'
RISE = '{type="table",times=[0.0,1.0],values=[0.0,1.0]}'
SLOWLY = 'time={end=1.0,instants=4,quasi_static=true,start="given"}'


def crushed(settings: tuple[str, ...], *parameters: str, of_interface: str = "crush") -> Case:
    """Two small specimens under other loads, conditions and laws."""
    size = ("substructure.lower.box.elements=[2,2,2]", "substructure.upper.box.elements=[2,2,2]")
    steps = ("time.step=0.3e-6", "time.end=9e-6") if SLOWLY not in settings else ()
    friction = f"interface.{of_interface}.friction_coefficient"
    return "two_specimen_crushing", (*size, *steps, *settings), (*parameters, friction)


OTHERS = (
    crushed(
        (
            "material.steel.damping_ratios={frequencies=[1e4,1e6],ratios=[0.05,0.03]}",
            "material.aluminium.damping_ratios={frequencies=[1e4,1e5],ratios=[0.02,0.02]}",
        ),
        "material.steel.young_modulus",
        "material.steel.damping_ratios.ratios.0",
        "material.aluminium.density",
    ),
    crushed(
        (*HEAT, 'load.press.law="constant"', f'temperature.heat={{substructures=["upper"],change=80.0,{PULSE}'),
        "temperature.heat.change",
        "material.steel.thermal_expansion",
        "material.steel.young_modulus",
    ),
    crushed(
        (*HEAT, SLOWLY, f"load.press.law={RAMP}", f"temperature.heat={{change=80.0,law={RAMP}}}"),
        "material.aluminium.thermal_expansion",
        "temperature.heat.change",
    ),
    crushed(
        ('time.start="static"', "gravity={acceleration=[0.0,0.0,-1e7]}", 'effects.prestress="off"'),
        "gravity.acceleration.2",
        "material.steel.density",
        "material.aluminium.young_modulus",
    ),
    crushed((f"gravity={{acceleration=[0.0,0.0,-1e7],{PULSE}",), "gravity.acceleration.2", "material.steel.density"),
    crushed(
        (SOFT + "friction_coefficient=0.1,gap=2.03e-6}",),
        "interface.crush.normal_stiffness",
        "interface.crush.gap",
        "material.steel.density",
    ),
    crushed(
        (SOFT + "friction_coefficient=0.1,preload=1e8}", 'time.start="static"'),
        "interface.crush.preload",
        "interface.crush.normal_stiffness",
    ),
    crushed(
        # the load grows in every step: points on the friction limit that do not slide have no direction of slip
        (SOFT + "friction_coefficient=0.1}", SLOWLY, f"load.press.law={RISE}"),
        "interface.crush.normal_stiffness",
        "material.steel.young_modulus",
    ),
    # unlike meshes over a part of the face: points with hardly any area are merged
    crushed(
        ("substructure.upper.box={origin=[0.0,0.0,0.01],size=[0.0072,0.0083,0.01],elements=[3,2,2]}",),
        "material.aluminium.density",
        "load.press.pressure",
    ),
    *(
        crushed(
            ("load={}", f'boundary.drive={{type="{kind}",face="upper.zmax",components=["z"],value=[{value}],{PULSE}'),
            "boundary.drive.value.0",
            "material.steel.young_modulus",
        )
        for kind, value in (("velocity", -8.0), ("displacement", -3e-5), ("acceleration", -2e6))
    ),
    crushed(
        (
            'interface.floor={sides=["lower.zmin","ground"],behaviour="contact",friction_coefficient=0.2,'
            f"ground_velocity={{direction=[0.0,0.0,1.0],amplitude=2.0,{PULSE}}}",
            "boundary={"
            + ",".join(
                f'{body}_{axis}={{type="symmetry",face="{body}.{axis}min"}}'
                for body in ("lower", "upper")
                for axis in "xy"
            )
            + "}",
        ),
        "interface.floor.ground_velocity.amplitude",
        of_interface="floor",
    ),
)


def scalars(history: InterfaceHistory, time: np.ndarray) -> dict[str, float]:
    """Scalars of an interface that have derivatives."""
    return values_of("derivatives", INTERFACE, InterfaceRecord.of(history, time))


def scene_of(case: Case) -> latin_fmu.Scene:
    """The scene of a case, without derivatives."""
    return latin_fmu.load_scene(MODELS / case[0] / "scene.toml", (*TIGHT, *case[1]))


@cache
def differentiated(case: Case) -> latin_fmu.Solution:
    """The solution of a case with its derivatives."""
    scene = scene_of(case).replace("output.check_sensitivities", "none")
    solution = latin_fmu.solve(scene.replace("output.sensitivities", list(case[2])))
    assert solution.converged, solution.status
    return solution


@cache
def ends(case: Case, parameter: str) -> tuple[latin_fmu.Solution, latin_fmu.Solution]:
    """Solutions with a parameter a little larger and a little smaller."""
    scene = scene_of(case)
    value = next(d.value for d in differentiated(case).sensitivities.derivatives if d.name == parameter)
    more, less = (latin_fmu.solve(scene.replace(parameter, value + sign * STEP * abs(value))) for sign in (1, -1))
    return more, less


def apart(own: np.ndarray, more: np.ndarray, less: np.ndarray, value: float) -> float:
    """Distance of a derivative from a central difference, over the largest."""
    difference = (more - less) / (2.0 * STEP * np.sign(value))
    return float(np.abs(own - difference).max() / np.abs(difference).max())


EVERY = (CRUSHING, HAMMER, SHEAR, BOUNCE, DAMPED, PLATES, BOLTED, MATERIALS, LANDING, STRAINED, *OTHERS)


BY_HISTORIES = [pytest.param(case, marks=[pytest.mark.slow] * (case[0] == "lap_joint")) for case in EVERY]


@pytest.mark.parametrize("case", BY_HISTORIES, ids=lambda case: f"{case[0]}-{case[2][0]}")
def test_histories_are_those_of_central_differences(case: Case) -> None:
    """Tractions and velocities at every point and instant; no state changes within the differences."""
    for d in differentiated(case).sensitivities.derivatives:
        more, less = ends(case, d.name)
        for name, history in more.interfaces.items():
            status = less.interfaces[name].contact_status
            assert status is None or np.array_equal(history.contact_status, status)
        # of all interfaces together; round-off of the differences: 1e-11 of the fields over twice the step
        for field, limit in (("traction", 2e-5), ("velocity", 2e-4)):
            every = (d.interfaces, more.interfaces, less.interfaces)
            own, a, b = (np.concatenate([getattr(h, field).ravel() for h in table.values()]) for table in every)
            assert apart(own, a, b, d.value) < limit, (d.name, field)


@pytest.mark.parametrize("case", [CRUSHING, SHEAR, BOUNCE, PLATES, MATERIALS], ids=lambda case: case[2][0])
def test_scalars_are_those_of_central_differences(case: Case) -> None:
    solution = differentiated(case)
    known = solution.sensitivities
    for i, d in enumerate(known.derivatives):
        more, less = ends(case, d.name)
        for name, history in solution.interfaces.items():
            pair = [scalars(s.interfaces[name], s.time) for s in (more, less)]
            for key in scalars(history, solution.time):
                difference = np.sign(d.value) * (pair[0][key] - pair[1][key]) / (2.0 * STEP)
                # of interfaces that do not slip the work is round-off
                floor = 1e-9 / STEP * max(abs(q.value) for q in known.quantities if q.quantity.endswith(key))
                assert known[f"{name}.{key}"].changes[i] == pytest.approx(difference, rel=1e-4, abs=floor), key


@pytest.mark.slow
def test_tension_of_a_bolt_follows_the_force_it_is_given() -> None:
    """Statics keep the tension at its target; the shock changes it alike."""
    solution = differentiated(BOLTED)
    more, less = ends(BOLTED, "bolt.m6.force")
    own = next(d for d in solution.sensitivities.derivatives if d.name == "bolt.m6.force")
    assert own.bolts["m6"].force[0] == pytest.approx(5e3, rel=1e-9)
    assert apart(own.bolts["m6"].force, more.bolts["m6"].force, less.bolts["m6"].force, own.value) < 1e-6
    for motion in ("displacement", "velocity"):
        values = [getattr(s.sensors["end"], motion) for s in (more, less)]
        assert apart(getattr(own.sensors["end"], motion), *values, own.value) < 1e-4


@pytest.mark.slow
def test_spectra_and_last_values_are_those_of_central_differences() -> None:
    solution = differentiated(BOLTED)
    known = solution.sensitivities
    own = known.spectra["end"]
    for i, d in enumerate(known.derivatives):
        more, less = ends(BOLTED, d.name)
        for kind in ("acceleration", "pseudo_velocity"):
            values = [getattr(s.spectra["end"], kind) for s in (more, less)]
            assert apart(getattr(own, kind)[i], *values, d.value) < 1e-4, (d.name, kind)
        peaks = [float(s.spectra["end"].acceleration[0].max()) for s in (more, less)]
        tensions = [float(s.bolts["m6"].force[-1]) for s in (more, less)]
        for quantity, (a, b) in (("end.spectrum_peak", peaks), ("m6.last_bolt_force", tensions)):
            difference = np.sign(d.value) * (a - b) / (2.0 * STEP)
            assert known[quantity].changes[i] == pytest.approx(difference, rel=1e-4, abs=1e-6 * known[quantity].value)
    stored = solution.to_datatree()["sensitivities/sensors/end/spectrum/acceleration"]
    assert stored.dims == ("parameter", "response", "frequency", "component")
    np.testing.assert_array_equal(stored.values, own.acceleration)


def test_dissipation_of_the_assembly_is_that_of_its_interfaces() -> None:
    case = (CRUSHING[0], (*CRUSHING[1], "output.energy=true"), CRUSHING[2])
    known = differentiated(case).sensitivities["energy.friction_dissipation"]
    for d, change in zip(differentiated(case).sensitivities.derivatives, known.changes, strict=True):
        more, less = (s.energy["friction_dissipation"][-1] for s in ends(case, d.name))
        assert change == pytest.approx((more - less) / (2.0 * STEP), rel=1e-4)


def test_a_thrown_bar_touches_later_by_the_gap_over_its_speed() -> None:
    """d(first contact)/d(gap) = 1/v, and by the speed -gap/v^2."""
    settings = ("substructure.bar.box.elements.2=10", "time.instants=40", "interface.wall.gap=4.87")
    case = ("impact_bar", settings, ("interface.wall.gap", "substructure.bar.initial_velocity.2"))
    changes = differentiated(case).sensitivities["wall.first_contact"].changes
    # for gap and speed as large again
    np.testing.assert_allclose(changes, [0.487, -0.487], rtol=1e-9)


@pytest.mark.slow
def test_impulse_of_a_thrown_bar_follows_its_mass() -> None:
    """The impulse is 2 m v whatever its stiffness is and whenever it lands: d/d(density) is the impulse; by gap and
    modulus it is 0, which is flagged, for fronts of 300 N are shifted in time. The contact lasts 2 L / c."""
    parameters = ("interface.wall.gap", "material.bar.young_modulus", "material.bar.density")
    fine = ("substructure.bar.box.elements.2=200", "time.instants=1600", "interface.wall.gap=4.9871")
    known = differentiated(("impact_bar", fine, parameters)).sensitivities
    impulse, separation = known["wall.impulse"], known["wall.separation"]
    assert impulse.changes[2] == pytest.approx(200.0, rel=0.06)
    np.testing.assert_allclose(impulse.changes[:2] / 200.0, 0.0, atol=0.06)
    assert impulse.flagged.tolist() == [True, True, False]
    np.testing.assert_allclose(separation.changes[1:], [-1.0 / 3.0, 1.0 / 3.0], rtol=0.1)


@pytest.mark.slow
def test_tension_follows_the_modulus_of_a_bolt_that_is_shortened() -> None:
    """With a given shortening the tension is that of the stiffness of the joint, all of steel."""
    settings = ("bolt.m6={substructure='bolt',axis=[0.0,0.0,1.0],shortening=2e-6}", "time.instants=2")
    scene = latin_fmu.load_scene(MODELS / "lap_joint/scene.toml", ("load={}", *TIGHT, *settings))
    solution = latin_fmu.solve(scene.replace("output.sensitivities", ["material.steel.young_modulus"]))
    bolt = solution.bolts["m6"].force
    np.testing.assert_allclose(solution.sensitivities.derivatives[0].bolts["m6"].force, bolt, rtol=1e-6)


def test_slip_of_a_sheared_interface_follows_its_friction() -> None:
    """A wave of shear tau(t) from below, half the load on the absorbing face, slips with 2 (tau - mu p) / (rho c) while
    tau > mu p: with mu the slip changes by -2 p / (rho c) times the time of slip."""
    refined = tuple(f"substructure.{name}.box.elements.2=300" for name in ("lower", "upper"))
    case = ("shear_interface", (*refined, "time.instants=1920"), ("interface.fault.friction_coefficient",))
    pulse, amplitude, friction, pressure = 3.0472470011002204e-05, 6e6, 0.3, 10e6
    impedance = np.sqrt(7800.0 * 210e9 / 2.5)
    duration = pulse * (1.0 - 2.0 * np.arcsin(friction * pressure / amplitude) / np.pi)
    change = differentiated(case).sensitivities["fault.slip"].changes[0]
    assert change == pytest.approx(-friction * 2.0 * pressure / impedance * duration, rel=1e-3)


def test_data_of_the_file_has_one_entry_a_parameter(tmp_path: Path) -> None:
    solution = differentiated(SHEAR)
    solution.save(tmp_path / "shear.nc")
    with latin_fmu.open_results(tmp_path / "shear.nc") as tree:
        whole = tree["sensitivities"]
        assert list(whole["parameter"].values) == list(SHEAR[2])
        interface = tree["sensitivities/interfaces/fault"]
        assert interface["force"].dims == ("parameter", "time", "component")
        assert interface["force"].attrs["units"] == "N"
        change = interface["force"].sel(parameter="interface.fault.preload", component="z").values
        # side E is pressed down by the preload, whatever the shear is
        np.testing.assert_allclose(change, solution.interfaces["fault"].force()[:, 2], rtol=1e-6)


def test_the_summary_says_what_changes_a_quantity_most() -> None:
    """Everything follows a load in its size but where it sticks: forces by 10 % for 10 %."""
    said = [line for line in differentiated(CRUSHING).summary().splitlines() if "crush peak force" in line]
    assert len(said) == 1
    assert "+10 % for 10 % more pressure of press" in said[0]


def test_a_tornado_has_a_bar_for_each_parameter(tmp_path: Path) -> None:
    differentiated(CRUSHING).save(tmp_path / "crushing.nc")
    with latin_fmu.open_results(tmp_path / "crushing.nc") as tree:
        figure = tornado_figure(tree)
    axis = next(axis for axis in figure.axes if axis.get_title() == "crush peak force")
    longest = max(axis.patches, key=lambda bar: abs(bar.get_width()))
    assert [label.get_text() for label in axis.get_yticklabels()][-1] == "pressure of press"
    assert longest.get_width() == pytest.approx(10.0, rel=1e-3)
    for flag in (0, 1):
        tree = differentiated(CRUSHING).to_datatree()
        tree["sensitivities"]["flagged"].values[:] = flag
        bars = [bar for axis in tornado_figure(tree).axes for bar in axis.patches]
        assert bars
        assert all(bool(bar.get_hatch()) is bool(flag) for bar in bars)
    latin_fmu.solve(scene_of(BOUNCE)).save(tmp_path / "plain.nc")
    with latin_fmu.open_results(tmp_path / "plain.nc") as tree, pytest.raises(ResultsError, match="no derivatives"):
        tornado_figure(tree)


def test_states_change_where_a_derivative_leads_out_of_them() -> None:
    """A tenth of the pressure, of the friction that is left, of the gap or of the sliding is left at each point: a
    state changes within 1 % of a parameter where the derivative is above ten times what it is a tenth of."""
    made = synthetic.contact("joint", np.linspace(0.0, 1.0, 3), -1.0, 2.0, 1e6, friction=0.5)
    nothing, (n_time, n) = np.zeros_like(made.traction), made.pressure().shape
    still = np.zeros_like(made.velocity)
    held = replace(made, gap=np.full((n_time, n), 1e-6), velocity=still)
    pressed = nothing + np.array([0.0, 0.0, -1.0])
    sheared = nothing + np.array([0.4, 0.0, -1.0])  # 0.1 of 0.5 is left
    sliding = still.copy()
    sliding[:, 1, :, 0] = 0.1
    for status, traction, velocity, to, moved in (
        (STICK, sheared, still, nothing + np.array([1.0, 0.0, 0.0]), still),
        (STICK, pressed, still, nothing + np.array([0.0, 0.0, 10.0]), still),
        (SLIP, sheared, sliding, nothing, -sliding),
    ):
        history = replace(held, contact_status=np.full((n_time, n), status), traction=traction, velocity=velocity)
        for factor, share in ((90.0, 0.0), (110.0, 1.0)):
            factor *= 0.1 if moved is still else 1.0
            change = replace(history, traction=factor * to, velocity=factor * moved, gap=np.zeros((n_time, n)))
            found = sensitivities._changing(history, change, 0.0)
            np.testing.assert_allclose(found, share, err_msg=f"{status} {factor}")
    open_ = replace(held, contact_status=np.concatenate([np.full((1, n), STICK), np.zeros((2, n), dtype=int)]))
    for slope, share in ((-0.9e-4, 0.0), (-1.1e-4, 1.0)):
        change = replace(open_, traction=nothing, velocity=still, gap=np.full((n_time, n), slope))
        np.testing.assert_allclose(sensitivities._changing(open_, change, 0.0)[1:], share)


def test_without_parameters_there_is_nothing() -> None:
    solution = latin_fmu.solve(scene_of(BOUNCE))
    assert solution.sensitivities is None
    for name, history in solution.interfaces.items():
        assert np.array_equal(history.traction, differentiated(BOUNCE).interfaces[name].traction)


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ("interface.wall.behaviour", "give the key a number"),
        ("substructure.bar.body_force", "list of numbers.*substructure.bar.body_force.0 to .*2; name one item"),
        ("interface.wall.form.radius", "no number under this name.*if the scene omits it, add it"),
        ("substructure.bar.box.size.2", "changes the shape"),
        ("time.end", "changes interfaces, instants or the time scheme"),
    ],
)
def test_parameters_without_a_derivative_are_refused(parameter: str, words: str) -> None:
    scene = scene_of(BOUNCE).replace("output.sensitivities", [parameter])
    with pytest.raises(SceneError, match=words):
        latin_fmu.solve(scene)


def test_materials_of_a_body_in_modal_damping_are_refused() -> None:
    (material,) = scene_of(DAMPED).material
    scene = scene_of(DAMPED).replace("output.sensitivities", [f"material.{material}.density"])
    with pytest.raises(SceneError, match="changes the damping of the modes of bar"):
        latin_fmu.solve(scene)


def test_a_gap_of_the_meshes_has_the_derivatives_of_one_of_the_scene() -> None:
    """A block that flies through a gap: the meshes are as far apart as the number says, or touch. What it hits starts
    from its equilibrium on another block, by an interface that is found."""
    made = []
    for place in (0.02, 0.02 + 2e-5):
        bodies = {
            "base": (Box(STEEL, (0.02, 0.02, 0.02), (2, 2, 2)), (0.0, 0.0, -0.02)),
            "low": (Box(STEEL, (0.02, 0.02, 0.02), (2, 2, 2)), (0.0, 0.0, 0.0)),
            "high": (Box(STEEL, (0.02, 0.02, 0.02), (2, 2, 2)), (0.0, 0.0, place)),
        }
        data = placed(bodies, {"end": 2e-5, "step": 5e-7, "start": "static"})
        data["boundary"] = {"frame": {"type": "fixed", "face": "base.zmin"}}
        data["contact"] = {"all": {"search": 1e-6, "behaviour": "perfect"}}
        data["load"] = {"push": {"face": "low.xmax", "pressure": 1e5}}
        data["substructure"]["high"]["initial_velocity"] = [0.0, 0.0, -3.0]
        data["interface"] = {"meet": {"sides": ["low.zmax", "high.zmin"], "gap": 2e-5}}
        data["output"] = {"sensitivities": ["interface.meet.gap"], "check_sensitivities": "none"}
        (change,) = latin_fmu.solve(latin_fmu.scene_from_dict(data)).sensitivities.derivatives
        made.append(change.interfaces["meet"].traction)
    assert np.abs(made[0]).max() > 0.0
    np.testing.assert_allclose(made[1], made[0], atol=1e-6 * np.abs(made[0]).max())


def test_an_increment_without_a_derivative_is_no_instant_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise SolverError("the derivatives by parameters have no unique value at t = 0.2 s")

    monkeypatch.setattr(TangentRun, "march", fails)
    scene = scene_of(BOLTED).replace("output.sensitivities", ["contact.all.friction_coefficient"])
    (warning,) = [w for w in latin_fmu.solve(scene).warnings if "no derivatives" in w]
    for words in ("at t = 0.2 s, where t goes from 0 to 1 s", "tightening of m6, before the run", "points_from"):
        assert words in warning


def test_runs_without_derivatives_are_refused() -> None:
    scene = scene_of(BOUNCE).replace("output.sensitivities", ["interface.wall.gap"])
    with pytest.raises(SceneError, match=r"windows of several instants"):
        latin_fmu.solve(scene.replace("solver.window", 10))


def test_a_run_whose_derivatives_fail_keeps_its_results(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise SolverError("the derivatives by parameters have no unique value at t = 0 s")

    monkeypatch.setattr(Tangents, "march", fails)
    solution = latin_fmu.solve(scene_of(BOUNCE).replace("output.sensitivities", ["interface.wall.gap"]))
    assert solution.converged
    assert solution.sensitivities is None
    assert any("no derivatives: the derivatives by parameters have no unique value" in w for w in solution.warnings)


def test_a_run_with_more_of_a_parameter_takes_the_place_of_a_contradicted_change() -> None:
    """A secant over 5 % where the derivative is flagged or further off than a tenth, the derivative elsewhere."""
    parameters = ["interface.crush.friction_coefficient", "load.press.pressure"]
    scene = scene_of(CRUSHING).replace("output.sensitivities", parameters)
    checked = latin_fmu.solve(scene.replace("output.check_sensitivities", "all")).sensitivities
    plain, values = differentiated(CRUSHING).sensitivities, scene_of(CRUSHING).interface["crush"].friction_coefficient
    more = latin_fmu.solve(scene_of(CRUSHING).replace(parameters[0], 1.05 * values))
    there = scalars(more.interfaces["crush"], more.time)
    taken = 0
    for own, q in zip(plain.quantities, checked.quantities, strict=True):
        secant = (there[q.quantity.rpartition(".")[2]] - q.value) / 0.05
        apart = abs(secant - own.changes[0]) > max(0.1 * abs(secant), 0.01 * abs(q.value))
        replaced = bool(apart or own.flagged[0])
        assert checked.is_secant(q)[0] == replaced, q.quantity
        assert q.changes[0] == pytest.approx(secant if replaced else own.changes[0], rel=1e-6)
        assert not q.flagged.any()
        taken += replaced
    assert 0 < taken < len(plain.quantities)
    said = " ".join(checked.lines())
    assert "(by a run with 5 % more)" in said
    assert "by runs with 5 % more friction coefficient of crush, pressure of press" in said
    assert 'output.check_sensitivities = "all"' in " ".join(plain.lines())


def test_a_secant_takes_the_place_of_a_change_that_is_flagged_or_contradicted() -> None:
    """By a tenth of the secant, and a hundredth of the value; not of one without a run."""
    plain = differentiated(CRUSHING).sensitivities
    for change, flagged, value, taken in (
        (1.0, False, 1.05, False),
        (1.0, False, 1.2, True),
        (1.0, True, 1.05, True),
        (0.001, False, 0.009, False),
    ):
        q = replace(plain.quantities[0], value=1.0, changes=np.full(2, change), flagged=np.full(2, flagged))
        checked = replace(plain, quantities=[q]).checked([{q.quantity: 1.0 + 0.05 * value}, None])
        (made,) = checked.quantities
        np.testing.assert_allclose(made.changes, [value if taken else change, change])
        assert checked.is_secant(made).tolist() == [taken, False]
        assert made.flagged.tolist() == [flagged and not taken, flagged]
        assert checked.tried == CRUSHING[2][:1]


def test_a_run_checks_the_parameters_by_which_a_quantity_is_flagged() -> None:
    """Two of the seven quantities are flagged by the friction, none by the pressure."""
    plain = differentiated(CRUSHING).sensitivities
    assert [sum(int(q.flagged[i]) for q in plain.quantities) for i in range(2)] == [2, 0]
    assert plain.flagged.tolist() == [True, False]
    one = replace(
        plain, quantities=[plain.quantities[0], replace(plain.quantities[1], flagged=np.array([False, True]))]
    )
    assert one.flagged.tolist() == [bool(plain.quantities[0].flagged[0]), True]
    scene = scene_of(CRUSHING).replace("output.sensitivities", list(CRUSHING[2]))
    assert latin_fmu.solve(scene).sensitivities.tried == CRUSHING[2]
    checked = latin_fmu.solve(scene.replace("output.check_sensitivities", "flagged")).sensitivities
    assert checked.tried == CRUSHING[2][:1]
    for own, q in zip(plain.quantities, checked.quantities, strict=True):
        assert q.changes[1] == own.changes[1]
        assert checked.is_secant(q)[0] >= own.flagged[0]
        assert not checked.is_secant(q)[1]
    assert plain.tried == ()


def test_a_parameter_of_0_and_a_run_that_fails_keep_their_flags(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first has no value 5 % larger; the run of the second does not converge."""
    scene = scene_of(CRUSHING).replace("output.check_sensitivities", "all").replace("time.end", 3e-6)
    names = ["substructure.upper.initial_velocity.0", "load.press.pressure"]
    first = latin_fmu.solve(scene)

    def solve(other: latin_fmu.Scene, **_: object) -> latin_fmu.Solution:
        assert other.load["press"].pressure == pytest.approx(1.05 * scene.load["press"].pressure)
        return replace(first, outcome=replace(first.outcome, converged=False, status="no convergence"))

    run = latin_fmu.solve
    monkeypatch.setattr(api, "solve", solve)
    solution = run(scene.replace("output.sensitivities", names))
    assert solution.sensitivities.tried == ()
    assert solution.sensitivities.secants == {}
    said = " ".join(map(str, solution.outcome.warnings))
    assert f"derivatives by {names[0]} are not checked: its value is 0" in said
    assert f"derivatives by {names[1]} are not checked: no convergence" in said


def test_the_table_of_flags_counts_what_runs_replace() -> None:
    """Off or flagged: the changes that are replaced by default; left: those of no run with "flagged"."""
    scene = scene_of(CRUSHING)
    pairs = sensitivity_flags.judged(scene)
    wanted = scene.replace("output.sensitivities", sensitivity_flags.parameters_of(scene))
    checked = latin_fmu.solve(wanted.replace("output.check_sensitivities", "all")).sensitivities
    replaced = np.concatenate([checked.is_secant(q) for q in checked.quantities])
    np.testing.assert_array_equal(pairs.off | pairs.flagged, replaced)
    usual = latin_fmu.solve(wanted.replace("output.check_sensitivities", "flagged")).sensitivities
    agreed = np.concatenate([usual.is_secant(q) | q.flagged for q in usual.quantities])
    np.testing.assert_array_equal(pairs.left, replaced & ~agreed)
    assert 0 < pairs.off.sum() < len(pairs.off)
    held = np.array([[True, False, False], [True, True, False], [True, False, True], [False, False, False]]).T
    made = sensitivity_flags.Pairs(np.full(4, "slip"), *held, parameters=1, runs=1)
    assert made.left.tolist() == [True, False, False, False]
    assert pairs.runs == len(usual.tried)


@pytest.mark.parametrize(
    "case", [pytest.param(MATERIALS, id="materials"), pytest.param(BOLTED, id="tightened bolt", marks=pytest.mark.slow)]
)
def test_runs_that_check_are_the_same_together_and_one_by_one(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies with the operators of the run share its classes, others have their own; friction and a bolt force change
    the start, too."""
    scene = scene_of((case[0], (*case[1], "output.check_sensitivities=all"), ()))
    wanted = scene.replace("output.sensitivities", list(case[2]))
    together, members = list[list[bool]](), list[list[int]]()
    beside, march = riders.marched_beside, copies.Run.all

    def marched(*given: object) -> list[object]:
        made = beside(*given)
        together.append([pair is not None for pair in made])
        return made

    def counted(run: copies.Run) -> None:
        members.append([len(p.members) for p in run.assembly.propagators])
        march(run)

    monkeypatch.setattr(riders, "marched_beside", marched)
    alone = latin_fmu.solve(wanted).sensitivities
    # at this tolerance instants take Newton steps
    monkeypatch.setattr(copies, "_LARGE", 0)
    monkeypatch.setattr(copies, "_NEWTON", np.inf)
    monkeypatch.setattr(copies.Run, "all", counted)
    own = latin_fmu.solve(wanted).sensitivities
    assert together == [[False] * 3, [True] * 3]
    assert sum(members[-1]) == 4 * len(scene.substructure)
    assert max(members[-1]) >= (4 if case is BOLTED else 3)
    assert own.tried == alone.tried == tuple(wanted.output.sensitivities)
    assert sum(alone.is_secant(q).sum() for q in alone.quantities) > 0
    for first, second in zip(alone.quantities, own.quantities, strict=True):
        np.testing.assert_array_equal(alone.is_secant(first), own.is_secant(second), err_msg=first.quantity)
        limit = 1e-5 * np.maximum(np.abs(first.changes), abs(first.value))
        assert (np.abs(first.changes - second.changes) <= limit).all(), first.quantity


def test_a_run_that_checks_takes_the_operators_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction changes none of them, the modulus of steel those of one of two bodies."""
    solved, known = attempts.solver_ready, list[list[bool]]()

    def ready(problem: DiscretisedProblem, *given: object) -> SolverReadyProblem:
        before = [] if problem.kept is None else [id(p.operators) for p in problem.kept.propagators]
        made = solved(problem, *given)
        known.append([id(p.operators) in before for p in made.assembly.propagators])
        return made

    monkeypatch.setattr(attempts, "solver_ready", ready)
    scene = scene_of((MATERIALS[0], (*MATERIALS[1], "output.check_sensitivities=all"), ()))
    names = ["material.steel.young_modulus", "interface.crush.friction_coefficient"]
    latin_fmu.solve(scene.replace("output.sensitivities", names))
    assert known == [[False, False], [True, False], [True, True]]


def test_parameters_that_cannot_be_larger_keep_their_flags() -> None:
    """A body of almost incompressible steel has no Poisson ratio 5 % larger: a remark says that it is not checked."""
    settings = ("material.steel.poisson_ratio=0.48", "output.check_sensitivities=all", "time.instants=4")
    scene = latin_fmu.load_scene(MODELS / "shear_interface/scene.toml", settings)
    solution = latin_fmu.solve(scene.replace("output.sensitivities", ["material.steel.poisson_ratio"]))
    assert not any(solution.sensitivities.is_secant(q).any() for q in solution.sensitivities.quantities)
    assert any("poisson_ratio are not checked" in str(w) for w in solution.outcome.warnings)


def test_a_peak_that_another_one_overtakes_is_flagged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two peaks of 1 and 0.99: by 5 % of a parameter that raises the second by its own height it is the larger one."""
    row = RunScalar("peak", "N", "a peak", "interface", lambda record: float(record))
    monkeypatch.setattr(sensitivities, "rows_of", lambda _: [row])
    overtaken = [{"peak": peak} for peak in (1.0, 1.0, 0.99 * 1.05)]
    raised = [{"peak": peak} for peak in (1.0 + 1e-6, 1.0 - 1e-6, 1.05)]
    owner = sensitivities._Owner("joint", 1.0, [None, None], [overtaken, raised])
    ((_, q),) = owner.quantities("interface")
    assert q.flagged.tolist() == [True, False]
    np.testing.assert_allclose(q.changes, [0.0, 1.0], atol=1e-9)


def test_progress_of_derivatives_goes_to_the_last_instant() -> None:
    """Instants of the motion with iteration 0, after the windows of the run."""
    calls = list[tuple[int, int, int]]()

    class Sink:
        def update(self, done: int, total: int, iteration: int, error: float) -> None:
            del error
            calls.append((done, total, iteration))

    scene = scene_of(BOUNCE).replace("output.check_sensitivities", "none")
    latin_fmu.solve(scene.replace("output.sensitivities", list(BOUNCE[2])), progress=Sink())
    run = [call for call in calls if call[2] > 0]
    assert calls[: len(run)] == run
    assert [done for done, _, _ in calls[len(run) :]][-1] == 220
    assert {total for _, total, _ in calls[len(run) :]} == {220}


@pytest.mark.parametrize("limit", ["one copy", "none"])
def test_derivatives_whose_matrix_is_too_large_are_the_same(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the matrix of one parameter where that of all is too large, and by products of the iteration where that one
    is, too."""
    own = differentiated(CRUSHING)
    one = relative_operator(build(scene_of(CRUSHING)).assembly)["n_matrix"]
    for module in (search_direction, tangent_run):
        monkeypatch.setattr(module, "LARGEST", one if limit == "one copy" else 0)
    relative, made = list[dict[str, object]](), tangent_run.TangentRun.made_direction

    def direction(*given: object) -> search_direction.Direction:
        found = made(*given)
        relative.append(found.relative)
        return found

    monkeypatch.setattr(tangent_run.TangentRun, "made_direction", direction)
    scene = scene_of(CRUSHING).replace("output.check_sensitivities", "none")
    again = latin_fmu.solve(scene.replace("output.sensitivities", list(CRUSHING[2])))
    for first, second in zip(own.sensitivities.derivatives, again.sensitivities.derivatives, strict=True):
        force = first.interfaces["crush"].force()
        assert second.interfaces["crush"].force() == pytest.approx(force, abs=1e-5 * np.abs(force).max())
    assert relative
    for found in relative:
        assert found.get("on_iteration", 0) == (limit == "none")
        assert found.get("n_matrix", 0) == (one if limit == "one copy" else 0)
