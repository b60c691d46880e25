"""FMUs joined through ports by a stock master (low-level loops of fmpy): with FMUs of another exporter, and by waves.

The other FMUs are written by the exporter of pythonfmu as it is. Limits, set before the runs: momentum 1e-6; the error
falls by 1.7 to 2.4 with half the communication step (order 1), by 3.3 to 5 with rates (order 2).
"""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

import latin_fmu
from fmu_build.build import build_fmu
from latin_fmu.cosim import Session, Settings
from latin_fmu.cosim.variables import RATE

from .host import Host
from .test_hosts import SCRIPTS, python_of, ran

E, RHO, SIDE = 200e9, 8000.0, 0.01
AREA, C = SIDE**2, np.sqrt(E / RHO)
FREE = {"name": "free", "material": {"steel": {"young_modulus": E, "poisson_ratio": 0.0, "density": RHO}}}
OTHERS = {
    "SpringMass": '''
        class SpringMass(Fmi2Slave):
            """A mass behind a spring that only pushes the port: exact over a step, released between two."""

            def __init__(self, **kwargs):
                super().__init__(**kwargs)
                self.mass, self.stiffness, self.speed = 1.0, 1.0, 0.0
                self.displacement, self.velocity = 0.0, 0.0
                self.place, self.force, self.meanForce = 0.0, 0.0, 0.0
                for name in ("mass", "stiffness", "speed"):
                    self.register_variable(Real(name, causality=Fmi2Causality.parameter,
                                                variability=Fmi2Variability.tunable))
                for name in ("displacement", "velocity"):
                    self.register_variable(Real(name, causality=Fmi2Causality.input))
                for name in ("place", "force", "meanForce"):
                    self.register_variable(Real(name, causality=Fmi2Causality.output))

            def do_step(self, current_time, step_size):
                w = (self.stiffness / self.mass) ** 0.5
                y, dy = self.place - self.displacement, self.speed - self.velocity
                before = self.speed
                if y >= 0.0 and (y > 0.0 or dy > 0.0):
                    c, s = math.cos(w * step_size), math.sin(w * step_size)
                    y, dy = y * c + dy / w * s, dy * c - y * w * s
                else:
                    y += dy * step_size
                self.place = y + self.displacement + self.velocity * step_size
                self.speed = dy + self.velocity
                self.force = self.stiffness * max(y, 0.0)
                self.meanForce = self.mass * (before - self.speed) / step_size
                return True
    ''',
    "PushedMass": '''
        class PushedMass(Fmi2Slave):
            """A mass under a constant push and the force of the port: exact over a step."""

            def __init__(self, **kwargs):
                super().__init__(**kwargs)
                self.mass, self.push, self.force, self.forceRate = 1.0, 0.0, 0.0, 0.0
                self.velocity, self.acceleration = 0.0, 0.0
                for name in ("mass", "push"):
                    self.register_variable(Real(name, causality=Fmi2Causality.parameter,
                                                variability=Fmi2Variability.tunable))
                for name in ("force", "forceRate"):
                    self.register_variable(Real(name, causality=Fmi2Causality.input))
                for name in ("velocity", "acceleration"):
                    self.register_variable(Real(name, causality=Fmi2Causality.output))

            def do_step(self, current_time, step_size):
                total = self.push + self.force
                self.velocity += (total * step_size + 0.5 * self.forceRate * step_size**2) / self.mass
                self.acceleration = (total + self.forceRate * step_size) / self.mass
                return True
    ''',
}
_IMPORTS = "import math\nfrom pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real\n\n\n"


@pytest.fixture(scope="module")
def others(tmp_path_factory) -> dict[str, Path]:
    """FMUs of the exporter of pythonfmu."""
    from pythonfmu.builder import FmuBuilder

    made, folder = {}, tmp_path_factory.mktemp("others")
    for name, text in OTHERS.items():
        script = folder / f"{name.lower()}_fmu.py"
        script.write_text(_IMPORTS + textwrap.dedent(text))
        made[name] = Path(FmuBuilder.build_FMU(script, dest=folder / f"{name}.fmu"))
    return made


class Plain:
    """An FMI 2 instance as a stock master handles it."""

    def __init__(self, path: Path, folder: Path, **start: float) -> None:
        description = fmpy.read_model_description(str(path), validate=False)
        self._places = {v.name: v.valueReference for v in description.modelVariables}
        self._kinds = {v.name: v.type for v in description.modelVariables}
        place = fmpy.extract(str(path), unzipdir=str(folder))
        self._fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=place,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self._fmu.instantiate()
        self._fmu.setupExperiment(startTime=0.0)
        self.set(**start)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def set(self, **values: float) -> None:
        for name, value in values.items():
            place = self._places[name.replace("__", ".")]
            if self._kinds[name.replace("__", ".")] == "Integer":
                self._fmu.setInteger([place], [int(value)])
            else:
                self._fmu.setReal([place], [value])

    def give(self, name: str, value: float, rate: float = 0.0) -> None:
        """Value and rate of an input of a port."""
        stem, index = name[:-3], name[-3:]
        self._fmu.setReal([self._places[name], self._places[f"{stem}Rate{index}"]], [value, rate])

    def get(self, name: str) -> float:
        return float(self._fmu.getReal([self._places[name]])[0])

    def step(self, t: float, h: float) -> None:
        self._fmu.doStep(t, h)

    def close(self) -> None:
        self._fmu.terminate()
        self._fmu.freeInstance()


@pytest.fixture
def opened(tmp_path) -> Any:
    instances: list[Plain] = []

    def open_fmu(path: Path, **start: float) -> Plain:
        instances.append(Plain(path, tmp_path / f"instance{len(instances)}", **start))
        return instances[-1]

    yield open_fmu
    for instance in instances:
        instance.close()


def bar(n: int, port: dict[str, Any], end: float, dt: float, rigid: bool = False, **tables: Any) -> latin_fmu.Scene:
    """A bar of n elements along z with a port."""
    box = {"origin": [0, 0, 0], "size": [SIDE, SIDE, n * SIDE], "elements": [1, 1, n]}
    body = {"material": "steel", "box": box, "rigid": rigid, "bending_modes": not rigid}
    data = {**FREE, "substructure": {"bar": body}, "port": port, "time": {"end": end, "step": dt}, "solver": {}}
    return latin_fmu.scene_from_dict(data | tables)


# -- force in, motion out ---------------------------------------------------------------------------------------------
MASS, OWN, STIFFNESS, SPEED = 0.01, RHO * SIDE**3, 2e6, 3.0
OMEGA = np.sqrt(STIFFNESS * (MASS + OWN) / (MASS * OWN))
HALF = np.pi / OMEGA
FORCE_IN = {"foot": {"face": "bar.zmin", "components": ["z"]}}


def thrown(opened: Any, fmus: dict[str, Path], steps: int, rates: bool) -> tuple[float, float]:
    """Error of the velocity of a rigid block, and of the momentum at the end, when a mass behind a spring strikes it;
    the mass goes first, then the block has the mean force of the same step. It begins and ends without force: the
    impulse of a force that jumps comes one time step later.
    """
    other = opened(fmus["SpringMass"], mass=MASS, stiffness=STIFFNESS, speed=SPEED)
    block = opened(fmus["block"], inputInterpolation=1)
    h, error, before = HALF / steps, 0.0, 0.0
    block.step(0.0, h)
    for i in range(steps + steps // 4):
        other.set(displacement=block.get("port.foot.displacement[3]"))
        if rates:
            other.set(velocity=block.get("port.foot.velocity[3]"))
        other.step(i * h, h)
        force, mean = other.get("force"), other.get("meanForce")
        slope = (force - before) / h if rates else 0.0
        block.give("port.foot.force[3]", mean - 0.5 * slope * h, slope)
        block.step((i + 1) * h, h)
        before = force
        own = block.get("port.foot.velocity[3]")
        wanted = SPEED * MASS / (MASS + OWN) * (1 - np.cos(OMEGA * (i + 1) * h))
        error = max(error, abs(own - wanted) / SPEED if i < 0.9 * steps else 0.0)
    assert force == mean == 0.0
    momentum = OWN * block.get("port.foot.velocity[3]") + MASS * other.get("speed")
    return error, abs(momentum / (MASS * SPEED) - 1.0)


@pytest.mark.parametrize(("rates", "low", "high"), [(False, 1.7, 2.4), (True, 3.3, 5.0)])
def test_a_mass_behind_a_spring_meets_a_block(opened, others, tmp_path, rates, low, high):
    scene = bar(1, FORCE_IN, HALF, HALF / 512, rigid=True)
    fmus = {**others, "block": build_fmu(scene, tmp_path / "block.fmu", python=True)}
    (coarse, lost), (fine, _) = (thrown(opened, fmus, steps, rates) for steps in (32, 64))
    assert lost <= 1e-6
    assert low <= coarse / fine <= high
    assert fine <= (2e-3 if rates else 0.05)


def test_momentum_of_an_elastic_bar(opened, others):
    """The bar takes what the mass loses, though it vibrates: momentum from the velocities of its nodes."""
    n, steps = 8, 80
    dt = 0.5 * SIDE / C
    scene = bar(n, FORCE_IN, steps * dt, dt, output={"fields": True})
    other = opened(others["SpringMass"], mass=MASS, stiffness=STIFFNESS, speed=SPEED)
    session = Session(scene, Settings(interpolation=RATE, keep=True))
    session.initialize()
    assert session.step(0.0, dt)  # before they meet
    for i in range(steps):
        other.set(displacement=session.value("port.foot.displacement[3]"))
        other.set(velocity=session.value("port.foot.velocity[3]"))
        other.step(i * dt, dt)
        session.set_load("port.foot.force[3]", other.get("meanForce"))
        assert session.step((i + 1) * dt, dt)
    session.set_load("port.foot.force[3]", 0.0)  # the spring lets go
    assert session.step((steps + 1) * dt, 4 * dt)
    velocity = session.dataset()["substructures/bar"]["velocity"].values[-1, :, 2].reshape(n + 1, -1).mean(axis=1)
    weights = np.full(n + 1, RHO * AREA * SIDE)
    weights[[0, -1]] *= 0.5
    own = float(weights @ velocity)
    assert own > 0.1 * MASS * SPEED
    assert own + MASS * other.get("speed") == pytest.approx(MASS * SPEED, rel=1e-6)


# -- motion in, force out ---------------------------------------------------------------------------------------------
HEAVY, PUSH, N = 2.0, 1e4, 5
TIP = {"tip": {"face": "bar.zmax", "causality": "motion_in", "components": ["z"]}}
HELD = {"boundary": {"wall": {"type": "fixed", "face": "bar.zmin"}}}
PERIOD = 2 * np.pi * np.sqrt(HEAVY * N * SIDE / (E * AREA))


def pushed(opened: Any, fmus: dict[str, Path], steps: int, rates: bool, wanted: np.ndarray) -> float:
    """Error of the velocity of a heavy mass on the tip of a held bar, over half a period."""
    mass, h = opened(fmus["PushedMass"], mass=HEAVY, push=PUSH), 0.5 * PERIOD / steps
    tip = opened(fmus["tip"], inputInterpolation=1)
    error, before, top = 0.0, 0.0, float(np.abs(wanted).max())
    for i in range(steps):
        force = tip.get("port.tip.force[3]")
        own, slope = mass.get("velocity"), (force - before) / h
        acceleration = (PUSH + force) / HEAVY
        mass.set(force=force, forceRate=slope if rates else 0.0)
        tip.give("port.tip.velocity[3]", own, acceleration if rates else 0.0)
        mass.step(i * h, h)
        tip.step(i * h, h)
        before = force
        error = max(error, abs(mass.get("velocity") - wanted[(i + 1) * (len(wanted) - 1) // steps]) / top)
    return error


@pytest.mark.parametrize(("rates", "low", "high"), [(False, 1.7, 2.4), (True, 3.3, 5.0)])
def test_a_mass_pushes_the_tip_of_a_bar(opened, others, tmp_path, rates, low, high):
    """Against one run in which the mass is spread over the face."""
    n, end = 512, 0.5 * PERIOD
    whole = bar(
        N,
        {},
        end,
        end / n,
        **HELD,
        point_mass={"mass": {"face": "bar.zmax", "mass": HEAVY}},
        load={"push": {"face": "bar.zmax", "force": [0.0, 0.0, PUSH]}},
        sensor={"tip": {"face": "bar.zmax"}},
    )
    wanted = latin_fmu.solve(whole).sensors["tip"].velocity[:, 2]
    tip = build_fmu(bar(N, TIP, end, end / n, **HELD), tmp_path / "tip.fmu", python=True)
    coarse, fine = (pushed(opened, {**others, "tip": tip}, steps, rates, wanted) for steps in (64, 128))
    assert low <= coarse / fine <= high
    assert fine <= (5e-3 if rates else 0.1)


# -- waves ------------------------------------------------------------------------------------------------------------
def cut_bars(folder: Path, steps: int) -> tuple[list[Path], float]:
    """Two free bars that exchange waves, the first one struck at its free end, and the time step."""
    dt, made = 0.5 * SIDE / C, []
    strike = {"type": "half_sine", "duration": 8 * dt}
    for name, n, face in (("first", 3, "bar.zmax"), ("second", 2, "bar.zmin")):
        port = {"cut": {"face": face, "causality": "wave", "components": ["z"], "impedance": [RHO * C * AREA]}}
        load = {"strike": {"face": "bar.zmin", "pressure": 1e7, "law": strike}} if name == "first" else {}
        made.append(build_fmu(bar(n, port, steps * dt, dt, load=load), folder / f"{name}.fmu", python=True))
    return made, dt


CUT = "port.cut.incident[3]", "port.cut.reflected[3]"


def exchange(opened: Any, paths: list[Path], dt: float, steps: int, parts: int = 1) -> np.ndarray:
    """Force at the cut (steps,), every step with what the other side has sent; start values as they are."""
    pair = [opened(path) for path in paths]
    force, h = np.zeros(steps), parts * dt
    for i in range(steps):
        sent = [fmu.get(CUT[1]) for fmu in pair]
        for fmu, wave in zip(pair, sent[::-1], strict=True):
            fmu.give(CUT[0], wave)
        for fmu in pair:
            fmu.step(i * h, h)
        force[i] = pair[0].get("port.cut.force[3]")
    return force


@pytest.mark.parametrize("parts", [1, 5])
def test_waves_in_a_stock_master_are_bounded(opened, tmp_path, parts):
    paths, dt = cut_bars(tmp_path, 4000)
    force = np.abs(exchange(opened, paths, dt, 400, parts))
    assert 0.1 * 1e7 * AREA <= force.max() <= 2 * 1e7 * AREA
    assert force[200:].max() <= 1.01 * force[:200].max()


def test_waves_in_libcosim_are_those_in_fmpy(opened, tmp_path):
    """A master in C++ that connects outputs with inputs and makes steps of one size."""
    paths, dt = cut_bars(tmp_path, 400)
    names = [CUT[1], CUT[0], "port.cut.force[3]"]
    given = [str(SCRIPTS / "couple_libcosimpy.py"), *map(str, paths), repr(float(dt)), "60", *names]
    said = ran([python_of("libcosimpy"), *given], tmp_path).splitlines()
    rows = json.loads(next(line for line in said if re.fullmatch(r"\[[-+\d.e, ]+\]", line)))
    assert rows == pytest.approx(exchange(opened, paths, dt, 60).tolist(), rel=0, abs=1e-9 * 1e7 * AREA)


@pytest.mark.slow
def test_waves_are_bounded_for_ever(opened, tmp_path):
    paths, dt = cut_bars(tmp_path, 100_000)
    force = np.abs(exchange(opened, paths, dt, 100_000))
    peaks = force.reshape(10, -1).max(axis=1)
    assert force.max() <= 2 * 1e7 * AREA
    assert (np.diff(peaks) <= 1e-9 * force.max()).all()


# -- what the FMU says of its ports -----------------------------------------------------------------------------------
def test_terminals_and_constants_of_ports(tmp_path, fmi):
    """One terminal for each port, the impedance as a constant of the description, the numbers of a session."""
    wave = {"cut": {"face": "bar.zmax", "causality": "wave", "components": ["z", "rx"], "impedance": [400.0, 0.5]}}
    scene = bar(2, {**wave, "foot": {"face": "bar.zmin", "components": ["x", "z"]}}, 1e-5, 1e-6)
    host = Host(build_fmu(scene, tmp_path / "ports.fmu", fmi, python=True), tmp_path / "ports")
    session = Session(scene, Settings(keep=False))
    session.initialize()
    host.start()
    known = [float(host.variables[f"port.cut.{n}"].start) for n in ("impedance[3]", "rotationalImpedance[1]")]
    assert known == [400.0, 0.5]
    assert host.read(["port.cut.impedance[3]"]) == [400.0]
    assert host.variables["port.cut.incident[3]"].causality == "input"
    for name, value in (("port.cut.incident[3]", 50.0), ("port.foot.force[1]", -3.0)):
        session.set_load(name, value)
        host.set(**{name.replace(".", "__"): value})
    assert session.step(0.0, 1e-6)
    assert host.step(0.0, 1e-6)
    assert np.array_equal(host.read(session.outputs), session.row)
    if fmi == "3":
        text = (host.folder / "terminalsAndIcons" / "terminalsAndIcons.xml").read_text()
        assert 'name="port.cut"' in text
        assert 'terminalKind="latin_fmu.port"' in text
        assert 'variableName="port.foot.force[1]" memberName="force[1]"' in text
    host.close()
