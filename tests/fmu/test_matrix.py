"""One engine: modes, kinds of hosts and inputs against the run with the same law.

Every input follows a straight line over the simulation, given as value and rate of each step, as the value at its end,
or as a history. Limit, set before the runs: 1e-9 of the largest force.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.variable import input_variable
from latin_fmu.cosim.variables import LINE, PRESCRIBED, RATE
from latin_fmu.scene.schema import Scene
from tests.cosim import test_driven as driven
from tests.cosim.scenes import blocks

from .host import KINDS, Host

LIMIT = 1e-9
EXACT = {"tolerance": 1e-12}
STEPS = 6


def pressed(law: Any) -> Scene:
    load = {"press": {"face": "upper.zmax", "pressure": 100e6, "law": law}}
    return blocks(load=load, solver=EXACT, output={})


INPUTS: Mapping[str, tuple[Callable[[Any], Scene], str, str, tuple[float, float]]] = {
    "load": (pressed, "press", "interface.crush.force[3]", (0.25, 2e5)),
    **{
        kind: (
            lambda law, kind=kind: driven.bars(law, kind, solver=EXACT),
            driven.name_of(kind),
            "interface.joint.force[3]",
            (0.0, 0.5),
        )
        for kind in driven.KINDS
    },
}
"""Scene from its law, name of the input, force that is compared, value at the start and rate of the line."""


def settable(of: str) -> Scene:
    make, _, _, (start, _) = INPUTS[of]
    return make({"type": "input", "start_value": start})


@cache
def run(of: str) -> np.ndarray:
    """The force at the instants of the run with the line as its law."""
    make, _, force, (start, rate) = INPUTS[of]
    end = settable(of).time.end
    table = {"type": "table", "times": [0.0, end], "values": [start, start + rate * end]}
    interface = force.split(".")[1]
    values: np.ndarray = latin_fmu.solve(make(table)).interfaces[interface].force()[:, 2]
    return values


class OfSession:
    """A session with the calls of a host."""

    def __init__(self, of: str, mode: int, rule: int) -> None:
        self.name, self.end = INPUTS[of][1], settable(of).time.end
        self.session = Session(settable(of), Settings(mode=mode, interpolation=rule))

    def give(self, value: float, rate: float) -> None:
        self.session.set_load(self.name, value, rate)

    def history(self, first: float, last: float) -> None:
        self.session.set_history(self.name, [0.0, self.end], [first, last])

    def start(self) -> None:
        self.session.initialize()

    def step(self, t: float, h: float) -> bool:
        return bool(self.session.step(t, h))

    def read(self, name: str) -> float:
        return self.session.value(name)

    def close(self) -> None:
        self.session.close()


class OfFmu(OfSession):
    """An FMU."""

    def __init__(self, of: str, mode: int, rule: int, path: Path, folder: Path) -> None:
        self.name, self.end = INPUTS[of][1], settable(of).time.end
        self.host = Host(path, folder)
        self.host.set(mode=mode, inputInterpolation=rule)

    def give(self, value: float, rate: float) -> None:
        self.host.set(**{input_variable(self.name, "value"): value, input_variable(self.name, "rate"): rate})

    def history(self, first: float, last: float) -> None:
        self.host.set(historyFile=f"time,{self.name};0,{first!r};{self.end!r},{last!r}")

    def start(self) -> None:
        self.host.start()

    def step(self, t: float, h: float) -> bool:
        return self.host.step(t, h)

    def read(self, name: str) -> float:
        return float(self.host.read([name])[0])

    def close(self) -> None:
        self.host.close()


@pytest.fixture(scope="module")
def paths(tmp_path_factory) -> Callable[[str, str], Path]:
    folder = tmp_path_factory.mktemp("matrix")

    @cache
    def made(kind: str, of: str) -> Path:
        return build_fmu(settable(of), folder / f"{kind}_{of}.fmu", "3", extra={}, python=kind == "python")

    return made


@pytest.fixture(params=["session", *KINDS])
def opened(request, paths, tmp_path) -> Iterator[Callable[[str, int, int], OfSession]]:
    hosts: list[OfSession] = []

    def make(of: str, mode: int, rule: int) -> OfSession:
        if request.param == "session":
            hosts.append(OfSession(of, mode, rule))
        else:
            hosts.append(OfFmu(of, mode, rule, paths(request.param, of), tmp_path / "fmu"))
        return hosts[-1]

    yield make
    for host in hosts:
        host.close()


@pytest.mark.parametrize("of", INPUTS)
@pytest.mark.parametrize("how", ["rate", "value", "history"])
def test_the_force_is_that_of_the_run(opened, of, how):
    _, _, force, (start, rate) = INPUTS[of]
    mode, rule = PRESCRIBED if how == "history" else 0, {"rate": RATE, "value": LINE, "history": RATE}[how]
    host, known = opened(of, mode, rule), run(of)
    h = host.end / STEPS
    if how == "history":
        host.history(start, start + rate * host.end)
    host.start()
    read = [host.read(force)]
    for i in range(STEPS):
        t = i * h
        if how == "rate":
            host.give(start + rate * t, rate)
        elif how == "value":
            host.give(start + rate * (t + h), 0.0)
        assert host.step(t, h)
        read.append(host.read(force))
    every = (len(known) - 1) // STEPS
    assert np.abs(known).max() > 0.0
    assert np.abs(np.array(read) - known[::every])[1:].max() <= LIMIT * np.abs(known).max()


def test_a_value_that_stays_is_a_constant_of_prescribed_mode(opened):
    make, _, force, _ = INPUTS["load"]
    host = opened("load", PRESCRIBED, RATE)
    host.give(0.5, 0.0)
    host.start()
    constant = {"type": "table", "times": [0.0, host.end], "values": [0.5, 0.5]}
    known = latin_fmu.solve(make(constant)).interfaces["crush"].force()[:, 2]
    assert host.step(0.0, host.end)
    assert abs(host.read(force) - known[-1]) <= LIMIT * np.abs(known).max()
