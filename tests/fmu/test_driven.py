"""Faces and ground driven from outside: the FMU gives the numbers of the session."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_build.build import build_fmu
from latin_fmu.compiled import library
from latin_fmu.cosim import Session, Settings
from tests.cosim import test_driven as driven

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
