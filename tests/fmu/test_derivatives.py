"""Directional derivatives through the functions of the FMI are those of the session; a master with Newton's method."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import fromstring
from zipfile import ZipFile

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from fmu_build.build import build_fmu
from latin_fmu.cosim import Session
from latin_fmu.scene.schema import Scene
from tests.cosim.scenes import blocks

from .host import COMPILED, Host

H = 3e-6  # longer than the way of a wave through a block
UNKNOWNS = ["interface.crush.force[3]", "interface.crush.velocityEp[3]", "energy.kinetic"]
KNOWNS = ["load.press.value", "load.press.rate"]
ROUND_OFF, EXACT = 1e-11, 1e-8
SMALL = 1e-3  # of the load


def precise() -> Scene:
    """The two blocks, with an iteration that leaves round-off to differences."""
    return blocks(solver={"tolerance": 1e-12}, time={"end": 15e-6, "step": 0.2e-6})


@pytest.fixture(scope="module", params=[False, pytest.param(True, marks=COMPILED)], ids=["python", "compiled"])
def made(request, tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("fmus")
    return {fmi: build_fmu(precise(), folder / f"{fmi}.fmu", fmi, {}, python=not request.param) for fmi in ("2", "3")}


@pytest.fixture
def host(made, fmi, tmp_path) -> Iterator[Host]:
    one = Host(made[fmi], tmp_path / "instance")
    yield one
    one.close()


def derivative(host, unknowns, knowns, seed) -> np.ndarray:
    places = [[host.reference(name) for name in names] for names in (unknowns, knowns)]
    return np.array(host.fmu.getDirectionalDerivative(*places, seed))


def test_equal_to_the_session(host):
    session = Session(precise())
    host.start()
    session.initialize()
    for i in range(3):
        host.set(load__press__value=0.4 * i, load__press__rate=1e4)
        session.set_load("press", 0.4 * i, 1e4)
        assert host.step(i * H, H)
        assert session.step(i * H, H)
    host.set(load__press__value=9.0)  # for the next step: the derivatives are those of the last one
    for seed in ([1.0, 0.0], [0.3, 2e4]):
        derivatives = derivative(host, UNKNOWNS, KNOWNS, seed)
        known = session.derivative(UNKNOWNS, KNOWNS, seed)
        assert derivatives == pytest.approx(known, rel=ROUND_OFF)
        assert (derivatives != 0.0).all()
    host.set(load__press__value=0.8)
    assert host.step(3 * H, H)
    assert session.step(3 * H, H)
    assert host.read(session.outputs) == pytest.approx(session.row, rel=ROUND_OFF, abs=1e-18)


def test_dependencies_are_those_of_the_derivatives(host, made, fmi):
    """An input that is not listed has no derivative (FMI 3, 2.4); the clock depends on none."""
    host.start()
    for i in range(3):
        host.set(load__press__value=0.4 * i + 0.1, load__press__rate=1e4)
        assert host.step(i * H, H)
    listed = dependencies(made[fmi], "Output")
    known = [name for name in host.outputs if not name.startswith(("interface.crush.last", "window"))]  # have none
    for name in KNOWNS:
        column = derivative(host, known, [name], [1.0])
        assert {known[i] for i in np.flatnonzero(column)} <= {output for output in listed if name in listed[output]}
        assert np.count_nonzero(column) > 20
    clock = {"innerTime", "solver.instants", *(["window.count", "window.time"] if fmi == "3" else [])}
    assert {output for output, names in listed.items() if not names} == clock
    assert all(names in ([], KNOWNS) for names in listed.values())
    initial = dependencies(made[fmi], "InitialUnknown")
    assert initial["interface.crush.force[3]"] == KNOWNS[:1]
    assert initial["interface.crush.velocityEp[3]"] == []


def dependencies(fmu: Path, tag: str) -> dict[str, list[str]]:
    """Names that the model structure lists for each variable."""
    with ZipFile(fmu) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
    variables = list(root.find("ModelVariables"))
    if root.get("fmiVersion") == "2.0":
        names = {str(i): v.get("name") for i, v in enumerate(variables, 1)}
        unknowns, key = root.findall(f"ModelStructure/{tag}s/Unknown"), "index"
    else:
        names = {v.get("valueReference"): v.get("name") for v in variables}
        unknowns, key = root.findall(f"ModelStructure/{tag}"), "valueReference"
    return {names[u.get(key)]: [names[place] for place in u.get("dependencies").split()] for u in unknowns}


def test_equal_to_differences_by_rollback(host):
    """The contact state stays while the load is changed."""
    host.start()
    host.set(load__press__value=0.5)
    assert host.step(0.0, H)
    before, rows = host.save(), []
    for change in (SMALL, -SMALL, 0.0):
        host.restore(before)
        host.set(load__press__value=0.9 + change, load__press__rate=1e3)
        assert host.step(H, H)
        rows.append(host.read(UNKNOWNS))
    difference = (rows[0] - rows[1]) / (2.0 * SMALL)
    assert derivative(host, UNKNOWNS, KNOWNS[:1], [1.0]) == pytest.approx(difference, rel=EXACT)


def test_a_master_with_newtons_method_converges_quadratically(host):
    """The pressure is that of a spring whose force grows with the third power of the way of the face, over one step."""
    way, press = "sensor.head.displacement[3]", "load.press.value"
    host.start()
    before, value, left = host.save(), 0.6, []
    for _ in range(6):
        host.restore(before)
        host.set(load__press__value=value)
        assert host.step(0.0, H)
        moved = float(host.read([way])[0])
        stiffness = 0.5 / 2e-6**3  # the order of the way under this pressure
        left.append(value - 1.0 - stiffness * moved**3)
        slope = 1.0 - 3.0 * stiffness * moved**2 * float(derivative(host, [way], [press], [1.0])[0])
        value -= left[-1] / slope
    sizes = np.abs(left)
    assert sizes[0] > 0.1, sizes
    quadratic = [b <= max(2.0 * a * a, 1e-6) for a, b in pairwise(sizes[1:])]
    assert all(quadratic), sizes
    assert sizes[-1] < 1e-6, sizes


def test_refused_with_a_sentence(host):
    host.start()
    with pytest.raises(FMICallException):
        derivative(host, UNKNOWNS, KNOWNS, [1.0, 0.0])
    assert "make a step first" in host.messages[-1][2]
    assert host.step(0.0, H)
    for unknown, known, words in (
        ("load.press.value", KNOWNS[0], "is not an output"),
        (UNKNOWNS[0], "sensor.head.velocity[1]", "is not an input"),
        ("interface.crush.lastTouch", KNOWNS[0], "is the instant of an event"),
    ):
        with pytest.raises(FMICallException):
            derivative(host, [unknown], [known], [1.0])
        assert words in host.messages[-1][2]
    saved = host.save()
    assert derivative(host, UNKNOWNS, KNOWNS[:1], [1.0]).any()
    host.restore(saved)
    with pytest.raises(FMICallException):
        derivative(host, UNKNOWNS, KNOWNS[:1], [1.0])


def test_after_a_step_inside_a_time_step_nothing_depends_on_the_inputs(host):
    host.start()
    assert host.step(0.0, 0.03e-6)
    assert not derivative(host, UNKNOWNS, KNOWNS[:1], [1.0]).any()


@pytest.mark.parametrize("python", [True, pytest.param(False, marks=COMPILED)], ids=["python", "compiled"])
def test_there_is_none_in_the_first_step_of_a_static_start(fmi, python, tmp_path):
    """What a step requires of the inputs there, and the other kind of FMU, are no remedy."""
    time = {"end": 15e-6, "step": 0.2e-6, "start": "static"}
    fmu = build_fmu(blocks(time=time), tmp_path / "static.fmu", fmi, {}, python=python)
    host = Host(fmu, tmp_path / "instance")
    host.start()
    assert host.step(0.0, H)
    with pytest.raises(FMICallException):
        derivative(host, UNKNOWNS, KNOWNS[:1], [1.0])
    assert "the state at t = 0 was computed only for the start value of" in host.messages[-1][2]
    assert "make a second step" in host.messages[-1][2]
    assert host.step(H, H)
    assert derivative(host, UNKNOWNS, KNOWNS[:1], [1.0]).any()
    host.close()


def test_the_description_says_so(host):
    plural = "s" if host.three else ""
    assert f'providesDirectionalDerivative{plural}="true"' in (host.folder / "modelDescription.xml").read_text()
