"""Tunable parameters of FMUs: coefficients of friction that a host changes while it steps."""

from __future__ import annotations

import struct
import zipfile
from contextlib import closing
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from fmu_build.build import build_fmu
from latin_fmu import scene_from_dict
from latin_fmu.cosim.session import Session
from latin_fmu.cosim.settings import Settings
from latin_fmu.cosim.table_file import checksum
from tests.cosim.scenes import blocks
from tests.cosim.test_tunable import sliding

from .host import COMPILED, Host

FRICTION = "interface.crush.friction_coefficient"
NAMES = Session(blocks()).outputs
DT = 0.2e-6


def stepped(session: Session, changes: dict[int, float], count: int = 30) -> np.ndarray:
    """Rows of a session with the friction changed before some of the steps."""
    session.set_load("press", 0.3)
    session.initialize()
    rows = []
    for i in range(count):
        if i in changes:
            session.parameters[FRICTION] = changes[i]
        assert session.step(i * DT, DT)
        rows.append(session.row.copy())
    return np.array(rows)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_a_host_changes_friction_under_way_as_a_session_does(made: dict[str, Path], fmi: str, tmp_path: Path) -> None:
    changes = {8: 0.02, 20: 0.5}
    expected = stepped(Session(blocks()), changes)
    with closing(Host(made[fmi], tmp_path / "one")) as host:
        variable = host.variables[FRICTION]
        assert (variable.causality, variable.variability, float(variable.start)) == ("parameter", "tunable", 0.2)
        host.prepare()
        host.set(load__press__value=0.3)
        host.fmu.exitInitializationMode()
        for i in range(8):
            assert host.step(i * DT, DT)
        state = host.save()
        block = host.to_bytes(state)
        rows = []
        for i in range(8, 30):
            if i in changes:
                host.set(interface__crush__friction_coefficient=changes[i])
            assert host.step(i * DT, DT)
            rows.append(host.read(NAMES))
        scale = np.abs(expected).max(axis=0)
        assert (np.abs(np.array(rows) - expected[8:]) <= 1e-9 * scale + 1e-300).all()
        # a state has the friction of its time; a second instance goes on from it alike
        host.restore(state)
        assert host.read([FRICTION])[0] == 0.2
        with closing(Host(made[fmi], tmp_path / "two")) as other:
            other.start()
            other.set(interface__crush__friction_coefficient=0.9)
            other.restore(other.from_bytes(block))
            assert other.read([FRICTION])[0] == 0.2
            for one in (host, other):
                assert one.step(8 * DT, DT)
            np.testing.assert_array_equal(host.read(NAMES), other.read(NAMES))
            np.testing.assert_allclose(host.read(NAMES), stepped(Session(blocks()), {})[8], rtol=1e-9, atol=1e-300)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_values_that_cannot_be_are_refused_and_change_nothing(made: dict[str, Path], fmi: str, tmp_path: Path) -> None:
    with closing(Host(made[fmi], tmp_path / "one")) as host:
        host.start()
        for value in (-0.1, float("nan"), float("inf")):
            kind = "Float64" if host.three else "Real"
            setter = getattr(host.fmu, f"set{kind}")
            assert host.status(setter, [host.reference(FRICTION)], [value]) == 3
            assert f"{FRICTION} = " in host.messages[-1][2]
            assert "must be a finite number, 0 or more" in host.messages[-1][2]
        assert host.read([FRICTION])[0] == 0.2


@COMPILED
def test_in_prescribed_mode_friction_is_set_before_the_start(compiled_fmus: dict[str, Path], tmp_path: Path) -> None:
    scene = blocks().replace(FRICTION, 0.05)
    session = Session(scene, Settings(mode=1))
    session.set_history("press", [0.0, 6e-6], [0.25, 0.6])
    session.initialize()
    session.step(0.0, 6e-6)
    with closing(Host(compiled_fmus["3"], tmp_path / "one")) as host:
        host.set(mode=1, interface__crush__friction_coefficient=0.05)
        host.set(historyFile="time,press;0,0.25;6e-6,0.6")
        host.start()
        assert host.step(0.0, 6e-6)
        np.testing.assert_allclose(host.read(NAMES), session.row, rtol=1e-8, atol=1e-12 * np.abs(session.row).max())
        setter = host.fmu.setFloat64
        assert host.status(setter, [host.reference(FRICTION)], [0.3]) == 3
        assert "in prescribed mode the whole interval was solved before" in host.messages[-1][2]


@COMPILED
def test_a_state_of_prescribed_mode_brings_the_solution_of_its_friction(
    compiled_fmus: dict[str, Path], tmp_path: Path
) -> None:
    rows = []
    with closing(Host(compiled_fmus["3"], tmp_path / "one")) as one, closing(
        Host(compiled_fmus["3"], tmp_path / "two")
    ) as two:  # fmt: skip
        for host, friction in ((one, 0.05), (two, 0.2)):
            host.set(mode=1, interface__crush__friction_coefficient=friction)
            host.set(historyFile="time,press;0,0.25;6e-6,0.6")
            host.start()
            assert host.step(0.0, 2e-6)
        state = one.to_bytes(one.save())
        two.restore(two.from_bytes(state))
        for host in (one, two):
            assert host.step(2e-6, 4e-6)
            rows.append(host.read(NAMES))
    np.testing.assert_array_equal(*rows)


@COMPILED
def test_a_state_with_a_friction_that_cannot_be_is_refused(compiled_fmus: dict[str, Path], tmp_path: Path) -> None:
    odd = 0.123456789
    with closing(Host(compiled_fmus["3"], tmp_path / "one")) as host:
        host.start()
        host.set(interface__crush__friction_coefficient=odd)
        block = host.to_bytes(host.save())
        assert block.count(struct.pack("<d", odd)) == 1
        body = block[16:].replace(struct.pack("<d", odd), struct.pack("<d", -odd))
        assert host.status(host.from_bytes, block[:8] + struct.pack("<Q", checksum(body)) + body) == 3
        assert "a parameter in it cannot be" in host.messages[-1][2]


@COMPILED
def test_a_rigid_body_that_would_slide_at_the_start_is_refused(tmp_path: Path) -> None:
    """Its initial acceleration is that of a body at rest; with enough friction it starts."""
    tables = sliding().tables()
    del tables["substructure"]["plate"]["initial_velocity"]
    tables["load"] = {"push": {"face": "plate.xmin", "traction": [2500.0, 0.0, 0.0]}}
    file = build_fmu(scene_from_dict(tables), tmp_path / "plate.fmu", "3")
    name = "interface.table.friction_coefficient"
    for friction, starts in ((0.4, True), (0.01, False)):
        with closing(Host(file, tmp_path / f"host{friction}")) as host:
            host.set(**{name.replace(".", "__"): friction})
            host.prepare()
            assert (host.status(host.fmu.exitInitializationMode) == 0) == starts
            if not starts:
                assert any("slide or lift off immediately at interface table" in text for _, _, text in host.messages)


@COMPILED
def test_a_parameter_set_has_the_friction_of_the_scene(compiled_fmus: dict[str, Path]) -> None:
    with zipfile.ZipFile(compiled_fmus["3"]) as archive:
        (file,) = (name for name in archive.namelist() if name.endswith(".ssv"))
        tree = ElementTree.fromstring(archive.read(file))
    values = {one.get("name"): one[0].get("value") for one in tree.iter() if one.tag.endswith("}Parameter")}
    assert float(values[FRICTION] or "nan") == 0.2
