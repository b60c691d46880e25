"""System structure packages: valid, with units and parameter sets, run by another tool, refused with reasons."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy.ssp
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from lxml import etree

from fmu_build.ssp import write_ssp
from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import InputError
from tests.cosim.scenes import blocks

SCHEMAS = Path(fmpy.ssp.__file__).parent / "schema"
SCHEMAS_2 = [Path(folder) for folder in [os.environ.get("SSP2_SCHEMAS")] if folder]
"""Folder ``schema`` of the repository modelica/ssp-standard at v2.0."""
LINE = ("first", "interface.crush.slipping", "second", "load.press.value")
PARAMETERS = {
    "first": {"load.press.value": 0.5, "tolerance": 1e-5, "maxIterations": 80},
    "second": {"historyFile": "time,press;0,0;1e-6,1", "mode": 1},
}
OMS = "{https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd}"


@pytest.fixture
def package(fmus, fmi, tmp_path) -> Callable[..., Path]:
    def write(**changes: Any) -> Path:
        given = {"name": "pair", "connections": [LINE], "stop": 6e-6, "parameters": PARAMETERS, "step": 0.6e-6}
        return write_ssp(
            tmp_path / "pair.ssp", components={"first": fmus[fmi], "second": fmus[fmi]}, **{**given, **changes}
        )

    return write


def tree_of(package: Path, member: str) -> Any:
    """A member, valid by the schemas of its kind: of SSP 1.0, and of 2.0 where they are at hand."""
    kind = {"ssd": "Description", "ssv": "ParameterValues"}[member[-3:]]
    with zipfile.ZipFile(package) as archive:
        tree = etree.fromstring(archive.read(member))
    for schemas in (SCHEMAS, *SCHEMAS_2):
        etree.XMLSchema(etree.parse(str(schemas / f"SystemStructure{kind}.xsd"))).assertValid(tree)
    return tree


def test_the_parts_are_valid_and_hold_what_was_given(package):
    path = package()
    system = tree_of(path, "SystemStructure.ssd")
    connectors = {(e.getparent().getparent().get("name"), e.get("name")): e for e in system.iter("{*}Connector")}
    assert {LINE[:2], LINE[2:], ("first", "interface.crush.force[3]")} <= set(connectors)
    assert {e.get("kind") for e in connectors.values()} == {"input", "output"}
    assert connectors["first", "interface.crush.force[3]"].find("{*}Real").get("unit") == "N"
    assert not [name for _, name in connectors if ".vector." in name or ".points." in name]  # arrays
    assert [e.get("source") for e in system.iter("{*}ParameterBinding")] == [
        "resources/first.ssv",
        "resources/second.ssv",
    ]
    first, second = (tree_of(path, f"resources/{name}.ssv") for name in ("first", "second"))
    values = {e.get("name"): (e[0].tag.rpartition("}")[2], e[0].get("value"), e[0].get("unit")) for e in first[0]}
    assert values == {
        "load.press.value": ("Real", "0.5", "1"),
        "tolerance": ("Real", "1e-05", "1"),
        "maxIterations": ("Integer", "80", None),
    }
    assert [unit.get("name") for unit in first.iter("{*}Unit")] == ["1"]
    assert second[0][0][0].get("value") == "time,press;0,0;1e-6,1"


def test_units_have_their_exponents(package):
    line = ("first", "interface.crush.force[3]", "second", "load.press.value")
    system = tree_of(package(connections=[line], parameters={"first": {"timeStep": 1e-7}}), "SystemStructure.ssd")
    bases = {e.get("name"): dict(e[0].attrib) for e in system.iter("{*}Unit")}
    assert bases["N"] == {"kg": "1", "m": "1", "s": "-2"}
    assert bases["1"] == {}


def test_what_is_empty_is_left_out(package):
    """No connections, no parameters: elements without children are not valid in a system."""
    system = tree_of(package(connections=[], parameters={}), "SystemStructure.ssd")
    assert system.find("{*}System/{*}Connections") is None
    assert len(list(system.iter("{*}Connector"))) > 50
    assert system.find("{*}DefaultExperiment").get("stopTime") == "6e-06"


def test_omsimulator_finds_its_master(package):
    """Its version 2 reads the element of the master, version 3 the attributes; both require them last in the system."""
    system = tree_of(package(), "SystemStructure.ssd")
    first, experiment = system.iter(f"{OMS}SimulationInformation")
    assert first.getparent().getparent().get("type") == "org.openmodelica"
    assert system.find("{*}System")[-1].tag.endswith("}Annotations")
    assert dict(first.attrib) == {"name": "oms_ma_default", "method": "oms_ma", "fixedStepSize": "6e-07"}
    assert first[0].tag == f"{OMS}FixedStepMaster"
    assert (first[0].get("description"), first[0].get("stepSize")) == ("oms-ma", "6e-07")
    assert experiment.get("resultFile") == "pair_res.mat"


def test_another_tool_runs_it(fmus, tmp_path):
    """The master of fmpy: the second block is loaded by the share of the first that slips, a step late."""
    path = write_ssp(tmp_path / "pair.ssp", "pair", {"first": fmus["2"], "second": fmus["2"]}, [LINE], 6e-6)
    h, n = 0.6e-6, 8
    rows = simulate_ssp(str(path), stop_time=(n - 0.5) * h, step_size=h)
    first, second = (Session(blocks(), Settings(keep=False)) for _ in range(2))
    for session in (first, second):
        session.initialize()
    shares, loads = [], [0.0]
    for i in range(n):
        second.set_load("press", loads[-1])
        assert first.step(i * h, h)
        assert second.step(i * h, h)
        shares.append(first.value(LINE[1]))
        loads.append(shares[-1])
    assert max(shares) > 0.0
    assert np.array_equal(rows["first.interface.crush.slipping"], shares)
    assert np.array_equal(rows["second.load.press.value"], loads[1:])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "my pair"}, "system 'my pair': is not an identifier"),
        (
            {"connections": [("third", "x", "second", "load.press.value")]},
            "third.x: no such component; allowed: first, second",
        ),
        (
            {"connections": [("first", "x", "second", "load.press.value")]},
            "first.x: the FMU has no variable of this name",
        ),
        (
            {"connections": [("first", "load.press.value", "second", "load.press.value")]},
            "first.load.press.value: is no output, where a connection has one",
        ),
        (
            {"connections": [(*LINE[:2], "second", "interface.crush.slipping")]},
            "second.interface.crush.slipping: is no input, where a connection has one",
        ),
        ({"parameters": {"first": {"tolerence": 1.0}}}, "first.tolerence: the FMU has no variable of this name"),
        (
            {"parameters": {"first": {"maxIterations": 1.5}}},
            "first.maxIterations: is of another kind (value: 1.5); allowed: Integer",
        ),
        ({"parameters": {"first": {"historyFile": 1}}}, "allowed: String"),
    ],
)
def test_what_does_not_fit_is_refused(package, changes, words):
    with pytest.raises(InputError) as caught:
        package(**changes)
    assert words in str(caught.value)


def test_a_component_that_is_no_fmu_is_refused(tmp_path):
    file = tmp_path / "a.fmu"
    file.write_text("nothing")
    for path in (file, tmp_path / "nowhere.fmu"):
        with pytest.raises(InputError, match="not an FMU"):
            write_ssp(tmp_path / "a.ssp", "a", {"first": path}, [], 1.0)
