"""Directional derivatives through the functions of the FMI are those of the session."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from latin_fmu.cosim import Session
from tests.cosim.scenes import blocks

H = 3e-6  # longer than the way of a wave through a block
UNKNOWNS = ["interface.crush.force[3]", "interface.crush.velocityEp[3]", "energy.kinetic"]
KNOWNS = ["load.press.value", "load.press.rate"]


def derivative(host, unknowns, knowns, seed) -> np.ndarray:
    places = [[host.reference(name) for name in names] for names in (unknowns, knowns)]
    return np.array(host.fmu.getDirectionalDerivative(*places, seed))


def test_equal_to_the_session(opened, fmi):
    host, session = opened(fmi), Session(blocks())
    host.start()
    session.initialize()
    for i in range(3):
        host.set(load__press__value=0.4 * i, load__press__rate=1e4)
        session.set_load("press", 0.4 * i, 1e4)
        assert host.step(i * H, H)
        assert session.step(i * H, H)
    for seed in ([1.0, 0.0], [0.3, 2e4]):
        derivatives = derivative(host, UNKNOWNS, KNOWNS, seed)
        assert np.array_equal(derivatives, session.derivative(UNKNOWNS, KNOWNS, seed))
        assert (derivatives != 0.0).all()
    assert host.step(3 * H, H)
    assert session.step(3 * H, H)
    assert np.array_equal(host.read(session.outputs), session.row)


def test_refused_with_a_sentence(opened, fmi):
    host = opened(fmi)
    host.start()
    with pytest.raises(FMICallException):
        derivative(host, UNKNOWNS, KNOWNS, [1.0, 0.0])
    assert "make a step first" in host.messages[-1][2]
    assert host.step(0.0, H)
    with pytest.raises(FMICallException):
        derivative(host, ["load.press.value"], KNOWNS, [1.0, 0.0])
    assert "is not an output" in host.messages[-1][2]
    assert derivative(host, UNKNOWNS, KNOWNS[:1], [1.0]).any()


def test_the_description_says_so(opened, fmi):
    plural = "s" if fmi == "3" else ""
    assert f'providesDirectionalDerivative{plural}="true"' in (opened(fmi).folder / "modelDescription.xml").read_text()
