"""Loads, faces and ground driven from outside: the FMU gives the numbers of the session, and those of the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.checks import with_inputs
from latin_fmu.compiled import library
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.input_table import given_of, inputs_of, with_laws
from latin_fmu.cosim.variable import input_variable
from latin_fmu.scene.laws import TableLaw
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, Material, bar, column, rubbing
from tests.cosim import test_driven as driven
from tests.scenes import clamp

from .host import KINDS, Host

H = 4 * driven.STEP


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("kind", driven.KINDS)
def test_the_fmu_is_the_session(opened, fmi, tmp_path, kind, compiled):
    if compiled and library.loaded() is None:
        pytest.skip("no library of kernels here")
    scene = driven.bars({"type": "input"}, kind)
    host = opened(fmi, build_fmu(scene, tmp_path / "driven.fmu", fmi, python=not compiled))
    session, stem = Session(scene, Settings(keep=False)), driven.name_of(kind)
    session.set_load(stem, 0.0, 1.0)
    session.initialize()
    host.set(**{f"{stem}.rate".replace(".", "__"): 1.0})
    host.start()
    for i in range(10):
        session.set_load(stem, i * H, 1.0)
        host.set(**{f"{stem}.value".replace(".", "__"): i * H})
        assert session.step(i * H, H)
        assert host.step(i * H, H)
        if compiled:
            names = [name for name in session.outputs if name in host.variables]
            row = session.values(names)
            assert np.abs(host.read(names) - row).max() <= 1e-9 * np.abs(row).max()
        else:
            assert np.array_equal(host.read(session.outputs), session.row)
    assert abs(session.value("interface.joint.normalForce")) > 0.0


# -- every quantity of an input, in both modes and kinds, against a run with the same law --------------------------
STEPS, DT = 40, 0.005
TIMES = np.linspace(0.0, STEPS * DT, STEPS + 1)
INPUT = {"type": "input"}
QUANTITIES = (
    *("press", "body_force.upper", "gravity.acceleration", "port.foot.force[3]", "port.side.incident[3]"),
    *("boundary.slide", "boundary.place", "boundary.shake", "port.knob.velocity[1]", "ground.wall"),
)


def every_quantity() -> Scene:
    """Three bonded boxes that anything can drive; linear, so that all that differs is how inputs reach the run."""
    box = bar(Material(900.0, poisson=0.3), 2.0, 4)
    data = column(
        {
            "lower": box,
            "middle": box,
            "upper": replace(box, keys={"body_force": [1.0, 0.0, 2.0], "body_force_law": INPUT}),
        },
        {"joint": {"behaviour": "perfect"}, "bond": {"behaviour": "perfect"}},
        {"end": STEPS * DT, "step": DT},
        name="every_quantity",
        boundary={
            name: {"type": kind, "face": "upper.zmax", "components": [component], "value": [1.5], "law": INPUT}
            for name, kind, component in (
                ("slide", "velocity", "x"),
                ("shake", "acceleration", "y"),
                ("place", "displacement", "z"),
            )
        },
        load={"press": {"face": "upper.xmax", "pressure": 3.0, "law": INPUT}},
        gravity={"acceleration": [0.0, 0.0, -9.81], "law": INPUT},
        port={
            "foot": {"face": "lower.xmin", "components": ["z"]},
            "side": {"face": "lower.xmax", "components": ["z"], "causality": "wave", "impedance": [20.0]},
            "knob": {"face": "middle.ymax", "components": ["x"], "causality": "motion_in"},
        },
    )
    wall = {"direction": [0.0, 1.0, 1.0], "amplitude": 2.0, "law": INPUT}
    data["interface"]["wall"] = {"sides": ["lower.zmin", "ground"], "behaviour": "perfect", "ground_velocity": wall}
    return latin_fmu.scene_from_dict(data)


def forces(interface: str = "joint") -> list[str]:
    return [f"interface.{interface}.force[{k}]" for k in (1, 2, 3)]


@cache
def rough() -> np.ndarray:
    """Amplitudes from 0 on with a corner at every instant."""
    return np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).normal(size=STEPS))])


def ramp() -> np.ndarray:
    """Amplitudes from 0 on without a corner."""
    return np.linspace(0.0, 3.0, STEPS + 1)


def table(times: np.ndarray, values: np.ndarray) -> TableLaw:
    return TableLaw(times=tuple(times.tolist()), values=tuple(values.tolist()))


@cache
def run_of(quantity: str, straight: bool) -> np.ndarray:
    """Forces (n + 1, 3) of the run with the law of the quantity."""
    law = {quantity: table(TIMES, ramp() if straight else rough())}
    forces: np.ndarray = latin_fmu.solve(with_laws(every_quantity(), law)).interfaces["joint"].force()
    return forces


@pytest.fixture(scope="module")
def driven_fmus(tmp_path_factory) -> dict[str, Path]:
    """An FMU of ``every_quantity`` of each kind: FMI 2 compiled, FMI 3 with Python."""
    folder, scene = tmp_path_factory.mktemp("driven"), every_quantity()
    fmus = {"python": build_fmu(scene, folder / "python.fmu", "3", python=True)}
    if library.loaded() is not None:
        fmus["compiled"] = build_fmu(scene, folder / "compiled.fmu", "2")
    return fmus


def forces_of(
    host: Host, quantity: str, mode: int, times: np.ndarray, values: np.ndarray, names: Sequence[str] = forces()
) -> np.ndarray:
    """Outputs (n + 1, n_name) of an FMU driven by values that are linear between times, by rates or as a history."""
    rates = np.diff(values) / np.diff(times)
    given = [input_variable(quantity, part) for part in ("value", "rate")]

    def give(i: int) -> None:
        host.set(**dict(zip(given, (float(values[i]), float(rates[i])), strict=True)))

    if mode == 1:
        lines = "".join(f";{t!r},{a!r}" for t, a in zip(times.tolist(), values.tolist(), strict=True))
        host.set(mode=1, historyFile=f"time,{quantity}{lines}", endTime=float(times[-1]))
    else:
        give(0)
    host.start()
    rows = [host.read(names)]
    for i, (t, end) in enumerate(pairwise(times.tolist())):
        if mode == 0:
            give(i)
        assert host.step(t, end - t), host.messages[-1]
        rows.append(host.read(names))
    return np.array(rows)


@pytest.mark.parametrize("mode", [0, 1])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_input_acts_as_the_law_in_a_run(opened, driven_fmus, quantity, kind, mode):
    """To 1e-9. At a corner a displacement that is set step by step has the velocity of the step, that of a history the
    mean of both slopes, as in the run: its future is known."""
    assert quantity in inputs_of(every_quantity())
    straight = quantity == "boundary.place" and mode == 0
    expected = run_of(quantity, straight)
    got = forces_of(opened(path=driven_fmus[kind]), quantity, mode, TIMES, ramp() if straight else rough())
    assert np.abs(got - expected).max() <= 1e-9 * np.abs(expected).max()
    assert np.abs(expected).max() > 0.0


@pytest.mark.skipif(library.loaded() is None, reason="no library of kernels here")
def test_both_kinds_take_a_displacement_step_by_step_alike(opened, driven_fmus):
    first, second = (
        forces_of(opened(path=driven_fmus[kind]), "boundary.place", 0, TIMES, rough()) for kind in driven_fmus
    )
    assert np.abs(first - second).max() <= 1e-9 * np.abs(first).max()


def test_the_quantities_are_all_there_are():
    assert {source.name for source in given_of(every_quantity())} == set(QUANTITIES)


@pytest.mark.skipif(library.loaded() is None, reason="no library of kernels here")
@pytest.mark.parametrize("block", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["", "rigid"])
@pytest.mark.parametrize(
    "drive", ["acceleration", *(pytest.param(d, marks=pytest.mark.slow) for d in ("velocity", "displacement"))]
)
def test_the_base_of_a_bolted_joint_moves_from_the_first_step_on(opened, fmi, tmp_path, drive, block):
    """A compiled FMU gives the run, by rates and as a whole history, with a rigid block that is pressed on the joint,
    too. The start is an equilibrium whose round-off must not decide whether bodies accelerate: the initial state is a
    linear function of the motion."""
    times = np.linspace(0.0, 8e-6, 5)
    values = {
        "velocity": 1e6 * times,
        "acceleration": 1e5 * np.sin(0.3 + 2e5 * times),
        "displacement": 1e6 * np.maximum(times - times[1], 0.0) ** 2,
    }[drive]
    base = {"type": drive, "face": "lower.xmin", "components": ["x", "y", "z"], "value": [1.0, 0.0, 1.0], "law": INPUT}
    # histories that differ by round-off take other iterations
    data = clamp(boundary={"wall": base}, load={}, solver={"tolerance": 1e-12})
    names = ["joint", "rest"] if block else ["joint"]
    if block:
        data["substructure"]["block"] = {
            "material": data["substructure"]["upper"]["material"],
            "rigid": True,
            "box": {"origin": [0.045, 0.0, 0.01], "size": [0.01, 0.02, 0.01], "elements": [2, 2, 1]},
        }
        data["interface"]["rest"] = rubbing("upper.zmax", "block.zmin", 0.2)
        data["load"] = {"press": {"face": "block.zmax", "pressure": 8e6}}
    scene = latin_fmu.scene_from_dict(data | {"time": {"end": float(times[-1]), "instants": 4}})
    solution = latin_fmu.solve(with_laws(scene, {"boundary.wall": table(times, values)}))
    expected = np.hstack([solution.interfaces[name].force() for name in names])
    fmu = build_fmu(scene, tmp_path / "clamp.fmu", fmi)
    for mode in (0, 1):
        if mode == 0 and drive == "displacement":
            continue  # its velocity is that of the step, not that of the run
        read = [output for name in names for output in forces(name)]
        got = forces_of(opened(path=fmu), "boundary.wall", mode, times, values, read)
        assert np.abs(got - expected).max() <= 1e-9 * np.abs(expected).max()
    moved = np.abs(expected - expected[0]).max(axis=0)
    assert (moved.reshape(-1, 3).max(axis=1) > 1e-3 * np.abs(expected).max()).all()


def standing(foot: bool, friction: float, law: object = INPUT) -> Scene:
    """A rigid block that is pressed on a rigid or elastic foot whose base is accelerated along x and z."""
    side = (0.02, 0.02)
    motion = {"type": "acceleration", "face": "foot.zmin", "components": ["x", "y", "z"], "value": [1.0, 0.0, 1.0]}
    data = column(
        {
            "foot": Box(STEEL, (*side, 0.005), (2, 2, 1), keys={"rigid": foot}),
            "block": Box(STEEL, (*side, 0.01), (2, 2, 1), keys={"rigid": True}),
        },
        {"joint": {"friction_coefficient": friction}},
        {"end": 8e-6, "instants": 4, "start": "static"},
        load={"press": {"face": "block.zmax", "pressure": 8e6}},
        boundary={"wall": motion | {"law": law}},
        solver={"tolerance": 1e-12},
    )
    return latin_fmu.scene_from_dict(data)


@pytest.mark.skipif(library.loaded() is None, reason="no library of kernels here")
@pytest.mark.parametrize(("foot", "friction", "away"), [(True, 0.3, -1e8), (False, 1.5, 1e8)], ids=["rigid", "elastic"])
def test_a_rigid_body_is_accelerated_with_what_it_stands_on(opened, fmi, tmp_path, foot, friction, away):
    """By its first outputs, too; where it slides at once, which is no linear function of the motion, an FMU that has
    its initial state from when it was made says so."""
    scene, times = standing(foot, friction), np.linspace(0.0, 8e-6, 5)
    fmu = build_fmu(scene, tmp_path / "block.fmu", fmi)
    for size in (1e2, 1e4):
        values = size * np.sin(0.3 + 2e5 * times)
        solution = latin_fmu.solve(with_laws(scene, {"boundary.wall": table(times, values)}))
        expected = solution.interfaces["joint"].force()
        for mode in (0, 1):
            got = forces_of(opened(path=fmu), "boundary.wall", mode, times, values)
            assert np.abs(got - expected).max() <= 1e-9 * np.abs(expected).max()
    host = opened(path=fmu)
    host.set(boundary__wall__value=away)
    with pytest.raises(FMICallException):
        host.start()
    assert "slide or lift off immediately at interface joint" in host.messages[-1][2]


def test_all_inputs_are_whatever_drives_a_scene():
    """Loads, driven faces, ground, ports, body forces and gravity; each keeps its law as history and starts with it."""
    law = table(np.array([0.0, 1.0]), np.array([0.25, 1.0]))
    made = with_inputs(with_laws(every_quantity(), dict.fromkeys(QUANTITIES, law)), ["all"])
    assert made.laws == dict.fromkeys(QUANTITIES, law)
    assert {source.name: source.start for source in given_of(made.scene)} == dict.fromkeys(QUANTITIES, 0.25)
