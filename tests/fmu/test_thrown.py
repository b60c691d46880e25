"""A tightened assembly that falls: the FMU gives the numbers of the session."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.compiled import library
from latin_fmu.cosim import Session, Settings
from tests.verification.test_thrown_assembly import bolted, with_floor

H = 5e-6


@pytest.mark.parametrize("compiled", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_fmu_falls_as_the_session_does(opened, fmi, tmp_path, compiled):
    if compiled and library.loaded() is None:
        pytest.skip("no library of kernels here")
    scene = latin_fmu.scene_from_dict(with_floor(bolted([0.0, 0.0, -1.0]), 15e-6))
    host = opened(fmi, build_fmu(scene, tmp_path / "thrown.fmu", fmi, python=not compiled))
    session = Session(scene, Settings(keep=False))
    session.initialize()
    host.start()
    names = [name for name in session.outputs if name in host.variables]
    forces = [session.value("bolt.m5.force")]
    for i in range(4):
        assert session.step(i * H, H)
        assert host.step(i * H, H)
        row = session.values(names)
        assert np.abs(host.read(names) - row).max() <= 1e-9 * np.abs(row).max()
        forces.append(session.value("bolt.m5.force"))
    assert forces[:2] == pytest.approx([1500.0, 1500.0], rel=1e-8)
    assert abs(forces[-1] - 1500.0) > 1.0
