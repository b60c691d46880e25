"""The master for waveform relaxation on sessions: two halves of a bar against the whole."""

from __future__ import annotations

import math

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim import Session
from latin_fmu.cosim.waveform_relaxation import Coupling, Side, WaveformMaster
from latin_fmu.errors import InputError, SolverError
from latin_fmu.stability.scenes import Material, bar, column

IMPEDANCE, DT = 2.0, 0.05  # rho c; s


def part(name: str, start: float, length: float, loads: dict) -> latin_fmu.Scene:
    body = bar(Material(4.0), length, round(4 * length))
    sensor = {"cut": {"substructure": name, "point": [0.0, 0.0, 2.0]}}
    tables = column({name: body}, {}, {"end": 1.0, "step": DT}, name=name, load=loads, sensor=sensor)
    tables["substructure"][name]["box"]["origin"][2] = start
    return latin_fmu.scene_from_dict(tables)


def halves() -> dict[str, Session]:
    cut = {"traction": [0.0, 0.0, 1.0], "law": {"type": "input"}}
    push = {"face": "front.zmin", "pressure": 0.1, "law": {"type": "half_sine", "duration": 1.0}}
    scenes = {
        "front": part("front", 0.0, 2.0, {"push": push, "cut": {"face": "front.zmax", **cut}}),
        "back": part("back", 2.0, 2.0, {"cut": {"face": "back.zmin", **cut}}),
    }
    sessions = {name: Session(scene) for name, scene in scenes.items()}
    for session in sessions.values():
        session.initialize()
    return sessions


def coupling(impedance: float = IMPEDANCE) -> Coupling:
    return Coupling(*(Side(name, "cut", "sensor.cut.velocity[3]", impedance) for name in ("front", "back")))


@pytest.mark.parametrize("impedance", [IMPEDANCE, 0.3 * IMPEDANCE])
def test_two_halves_are_the_whole(impedance):
    """The search direction changes how many iterations are needed, not what comes out."""
    push = {"face": "whole.zmin", "pressure": 0.1, "law": {"type": "half_sine", "duration": 1.0}}
    whole = Session(part("whole", 0.0, 4.0, {"push": push}))
    whole.initialize()
    peers = halves()
    master = WaveformMaster(peers, [coupling(impedance)], tolerance=1e-11)
    velocities, expected = [], []
    for i in range(60):
        report = master.step(i * DT, DT)
        assert report.iterations <= 6
        assert whole.step(i * DT, DT)
        velocities.append([s.value("sensor.cut.velocity[3]") for s in peers.values()])
        expected.append(whole.value("sensor.cut.velocity[3]"))
    scale = np.abs(expected).max()
    assert scale > 0.01
    assert np.abs(np.array(velocities) - np.array(expected)[:, None]).max() <= 1e-7 * scale


def test_what_cannot_agree_is_told_and_taken_back():
    peers = halves()
    master = WaveformMaster(peers, [coupling()], tolerance=1e-30, max_iterations=3)
    before = {name: peer.snapshot() for name, peer in peers.items()}
    with pytest.raises(SolverError, match="differ"):
        master.step(0.0, DT)
    assert {name: peer.snapshot() for name, peer in peers.items()} == before


def test_a_peer_that_refuses_takes_all_back():
    peers = halves()
    master = WaveformMaster(peers, [coupling()])
    before = {name: peer.snapshot() for name, peer in peers.items()}
    with pytest.raises(SolverError, match="refuses"):
        master.step(0.0, math.nan)
    assert {name: peer.snapshot() for name, peer in peers.items()} == before


def test_bad_couplings_are_listed():
    peers = halves()
    wrong = Coupling(Side("front", "cut", "v", -1.0), Side("nobody", "cut", "v", 1.0))
    with pytest.raises(InputError) as caught:
        WaveformMaster(peers, [wrong])
    assert len(caught.value.problems) == 2
