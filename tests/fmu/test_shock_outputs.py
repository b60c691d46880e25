"""Outputs of a shock test through the FMI: arrays beside scalars, accelerations in g, steps that are taken back."""

from __future__ import annotations

import re
from pathlib import Path

import fmpy
import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.checks import validate
from latin_fmu.cosim import Session
from tests.cosim.test_shock_outputs import shaken

from .host import KINDS, Host

H = 0.73e-6


@pytest.fixture(scope="module", params=KINDS)
def shock(request, tmp_path_factory) -> dict[str, Path]:
    """FMUs of the shaken blocks, by version of the FMI."""
    folder, python = tmp_path_factory.mktemp("shock"), request.param == "python"
    scene = shaken(output={"acceleration": "g"})
    return {fmi: build_fmu(scene, folder / f"{fmi}.fmu", fmi, python=python) for fmi in ("2", "3")}


def test_outputs_are_those_of_a_session_and_steps_are_taken_back(shock, fmi, tmp_path):
    host, session = Host(shock[fmi], tmp_path / "instance"), Session(shaken())
    host.start()
    session.initialize()
    for i in range(6):
        before = host.from_bytes(host.to_bytes(host.save()))
        for again in range(2):
            if again:
                host.restore(before)
            assert host.step(i * H, H)
            rows = host.read(session.outputs)
        assert session.step(i * H, H)
        assert np.abs(rows - session.row).max() <= 1e-12 * np.abs(session.row).max()
    assert session.value("sensor.head.accelerationFiltered[3]") != 0.0
    assert session.value("sensor.head.relativeVelocity[3]") != session.value("sensor.head.velocity[3]")
    host.close()


def test_arrays_are_their_scalars(shock, tmp_path):
    host = Host(shock["3"], tmp_path / "instance")
    host.start()
    assert host.step(0.0, H)
    arrays = {name: v for name, v in host.variables.items() if ".vector." in name}
    assert {"sensor.head.vector.acceleration", "interface.crush.vector.impulse"} <= set(arrays)
    scalars = [name for name in host.outputs if re.search(r"\[\d\]$", name)]
    found = {}
    for name, variable in arrays.items():
        stem, size = name.replace(".vector", ""), int(variable.dimensions[0].start)
        found |= {f"{stem}[{k + 1}]": value for k, value in enumerate(host.array(name, size))}
    assert [found[name] for name in scalars] == host.read(scalars).tolist()
    assert len(found) == len(scalars) > 30
    assert any(found.values())
    host.close()


def test_accelerations_are_shown_in_g(shock, fmi):
    """By the factor to the display unit: 1 m/s2 is 1 / 9.80665 g."""
    assert validate(shock[fmi]) == []
    description = fmpy.read_model_description(str(shock[fmi]))
    (unit,) = (u for u in description.unitDefinitions if u.name == "m/s2")
    (shown,) = unit.displayUnits
    assert (shown.name, float(shown.factor) * 9.80665) == ("g", pytest.approx(1.0, rel=1e-15))
    for variable in description.modelVariables:
        assert variable.displayUnit == ("g" if variable.unit == "m/s2" else None)
    assert len([v for v in description.modelVariables if v.displayUnit]) >= 9


def test_the_unit_of_a_scene_has_its_own_factor(tmp_path):
    fmu = build_fmu(shaken(units="mm-t-s-MPa"), tmp_path / "a.fmu", "3")
    (unit,) = (u for u in fmpy.read_model_description(str(fmu)).unitDefinitions if u.name == "mm/s2")
    assert float(unit.displayUnits[0].factor) == pytest.approx(1e-3 / 9.80665, rel=1e-15)


def test_the_results_file_has_accelerations(shock, tmp_path):
    host = Host(shock["3"], tmp_path / "instance")
    host.set(resultsFile=str(tmp_path / "out.nc"))
    host.start()
    for i in range(4):
        assert host.step(i * H, H)
    last = host.read([f"sensor.head.acceleration[{k}]" for k in (1, 2, 3)])
    host.fmu.terminate()
    host.close()
    stored = latin_fmu.open_results(tmp_path / "out.nc")["sensors/head/acceleration"]
    assert stored.attrs["units"] == "m s-2"
    assert stored.values[-1].tolist() == last.tolist()
