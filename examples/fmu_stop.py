"""A lever strikes a stop: the lever is an FMU of another exporter, striker and stop are one of this package.

See: two stock masters that exchange values once a communication step give the contact force of one run of the whole.
With wave ports, which any master can connect, the pair is joined by a strip as long as a wave runs in a step. The
striker is built without it: left on, it is mass that was not there, and the broken line is wrong. Forces stay bounded
over 100,000 steps. With force and rate the striker is whole, but a script has to make the steps in turn. The lever,
written below for the exporter of pythonfmu, turns about a hub under a torque and bends at its tip, a spring; in the one
run it is a rigid body of its inertia over the square of its length. Waves are also passed on by the master of libcosim
where libcosimpy is installed. Writes stop.png.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import closing
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np
from example_tools import BLUE, EXACT, GREEN, VERMILION, Array, options, save, table, tidy
from matplotlib.figure import Figure
from pythonfmu import FmuBuilder

import latin_fmu
from fmu_build.build import build_fmu
from fmu_build.drive import FmuPeer

LENGTH, INERTIA, TORQUE, BENDING = 0.1, 2e-3, 50.0, 8e6  # m, kg m^2, N m, N/m at the tip of the lever
SIDE, STRIKER, GAP = 0.01, 0.06, 50e-6  # m: section and length of the striker, its distance from the stop
YOUNG, DENSITY = 210e9, 7800.0  # N/m^2, kg/m^3, of the striker
SPEED = (YOUNG / DENSITY) ** 0.5
IMPEDANCE = DENSITY * SPEED * SIDE**2  # N s/m, of a bar: it lets waves out of the striker
STEP, END, ELEMENT = 1e-6, 0.8e-3, 5e-3  # s; m
LEVER = f'''
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

PARTS = 4


class Lever(Fmi2Slave):
    """Lever with a bending tip: either the motion of the tip is given, or the wave Z v - F that comes from it."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.angle, self.rate, self.tip, self.before = 0.0, 0.0, 0.0, 0.0
        self.displacement, self.velocity, self.impedance = 0.0, 0.0, 0.0
        self.incident, self.reflected, self.force, self.meanForce = 0.0, 0.0, 0.0, 0.0
        self.register_variable(
            Real("impedance", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )
        for name in ("displacement", "velocity", "incident"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("reflected", "force", "meanForce"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        h, impulse, start = step_size / PARTS, 0.0, self.displacement
        for i in range(PARTS):
            self.angle += 0.5 * h * self.rate
            if self.impedance:
                wave = self.before + (i + 0.5) / PARTS * (self.incident - self.before)
                self.tip += h * self.speed(wave, self.tip + 0.5 * h * self.speed(wave, self.tip))
                middle = self.tip - 0.5 * h * self.speed(wave, self.tip)
            else:
                middle = start + (i + 0.5) * h * self.velocity
            bent = self.bend(middle)
            self.rate += h * ({TORQUE} - {LENGTH} * math.cos(self.angle) * bent) / {INERTIA}
            self.angle += 0.5 * h * self.rate
            impulse += h * bent
        if not self.impedance:
            self.tip = start + step_size * self.velocity
        self.before = self.incident
        self.force, self.meanForce = self.bend(self.tip), impulse / step_size
        self.reflected = self.incident + 2.0 * self.force
        return True

    def bend(self, tip):
        return {BENDING} * ({LENGTH} * math.sin(self.angle) - tip)

    def speed(self, wave, tip):
        return (wave + self.bend(tip)) / self.impedance
'''


def scene(strip: float = 0.0, **tables: Any) -> latin_fmu.Scene:
    """Striker before the stop, along x; a strip, m, taken off its rear."""
    length = STRIKER - strip
    bar = {"size": [length, SIDE, SIDE], "elements": [round(length / ELEMENT), 1, 1]}
    striker = {"origin": [-GAP - length, 0.0, 0.0], **bar}
    stop = {"origin": [0.0, -SIDE, -SIDE], "size": [2 * SIDE, 3 * SIDE, 3 * SIDE], "elements": [3, 3, 3]}
    data = {
        "name": "striker_and_stop",
        "material": {
            "steel": {"young_modulus": YOUNG, "poisson_ratio": 0.3, "density": DENSITY},
            "polymer": {"young_modulus": 2e9, "poisson_ratio": 0.4, "density": 1200.0},
        },
        "substructure": {
            "striker": {"material": "steel", "box": striker, "bending_modes": True},
            "stop": {"material": "polymer", "box": stop, "bending_modes": True},
        },
        "interface": {
            "blow": {"sides": ["stop.xmin", "striker.xmax"], "behaviour": "contact", "friction_coefficient": 0.2}
        },
        "boundary": {"housing": {"type": "fixed", "face": "stop.xmax"}},
        "time": {"end": END, "step": STEP, "scheme": {"type": "generalized_alpha"}},
        "solver": {"tolerance": 1e-6, "window": 1},
    }
    for key, table_ in tables.items():
        data[key] = {**data.get(key, {}), **table_}
    return latin_fmu.scene_from_dict(data)


def one_run() -> tuple[Array, Array]:
    """Times and contact force, N, with the lever as a rigid body."""
    size = INERTIA / LENGTH**2 / (DENSITY * SIDE**2)
    box = {"origin": [-GAP - STRIKER - size - 1e-3, 0.0, 0.0], "size": [size, SIDE, SIDE], "elements": [1, 1, 1]}
    whole = scene(
        substructure={"lever": {"material": "steel", "rigid": True, "box": box}},
        spring={"tip": {"ends": ["lever.xmax", "striker.xmin"], "direction": [1, 0, 0], "stiffness": BENDING}},
        boundary={"guide": {"type": "fixed", "face": "lever.xmin", "components": ["y", "z"]}},
        load={"torque": {"face": "lever.xmin", "force": [TORQUE / LENGTH, 0.0, 0.0], "law": {"type": "constant"}}},
    )
    solved = latin_fmu.solve(whole)
    return solved.time, np.abs(solved.interfaces["blow"].force()[:, 0])


def by_waves(lever_fmu: Path, stop_fmu: Path, parts: int, steps: int) -> Array:
    """Contact force after each of so many steps of ``parts`` time steps: waves are passed on after every step."""
    h, force = parts * STEP, np.zeros(steps)
    with closing(FmuPeer(lever_fmu, {"impedance": IMPEDANCE})) as lever, closing(FmuPeer(stop_fmu)) as stop:
        for i in range(steps):
            to_lever, to_stop = stop.value("port.tip.reflected[1]"), lever.value("reflected")
            lever.set("incident", to_lever)
            stop.set("port.tip.incident[1]", to_stop)
            for fmu in (lever, stop):
                assert fmu.step(i * h, h), fmu.complaint
            force[i] = stop.value("interface.blow.normalForce")
    return force


def in_libcosim(lever_fmu: Path, stop_fmu: Path, parts: int, steps: int) -> Array:
    """The same, by the master of libcosim: two connections, and steps."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(round(parts * STEP * 1e9))  # ns
    lever, stop = (execution.add_local_slave(CosimLocalSlave(str(p), p.stem)) for p in (lever_fmu, stop_fmu))
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    of_lever, of_stop = ({v.name.decode(): v.reference for v in execution.slave_variables(s)} for s in (lever, stop))
    manipulator.slave_real_values(lever, [of_lever["impedance"]], [IMPEDANCE])
    taken = of_stop["port.tip.incident[1]"]
    assert execution.connect_real_variables(lever, of_lever["reflected"], stop, taken) == 0
    sent = of_stop["port.tip.reflected[1]"]
    assert execution.connect_real_variables(stop, sent, lever, of_lever["incident"]) == 0
    force = np.zeros(steps)
    for i in range(steps):
        assert execution.step()
        force[i] = observer.last_real_values(stop, [of_stop["interface.blow.normalForce"]])[0]
    return force


def by_force(lever_fmu: Path, stop_fmu: Path, parts: int, steps: int) -> Array:
    """Contact force after each step; the lever steps with the motion of the tip, the striker with its mean force."""
    h, force, before = parts * STEP, np.zeros(steps), 0.0
    with closing(FmuPeer(lever_fmu)) as lever, closing(FmuPeer(stop_fmu, {"inputInterpolation": 1})) as stop:
        for i in range(steps):
            lever.set("displacement", stop.value("port.tip.displacement[1]"))
            lever.set("velocity", stop.value("port.tip.velocity[1]"))
            assert lever.step(i * h, h)
            mean, end = lever.value("meanForce"), lever.value("force")
            slope = (end - before) / h
            stop.set_load("port.tip.force[1]", mean - 0.5 * slope * h, slope)
            assert stop.step(i * h, h), stop.complaint
            force[i], before = stop.value("interface.blow.normalForce"), end
    return force


def draw(run: tuple[Array, Array], drawn: dict[tuple[str, int], Array], long: Array) -> Figure:
    """Contact force of both masters against one run; the long run by peaks of a thousand steps."""
    figure = Figure(figsize=(11.0, 3.9), layout="constrained")
    forces, peaks = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    kinds = (("waves", GREEN, "-"), ("force and rate", BLUE, "-"), ("waves, strip not taken off", VERMILION, "--"))
    for kind, colour, style in kinds:
        values = drawn[kind, 5]
        at = 1e3 * 5 * STEP * np.arange(1, len(values) + 1)
        forces.plot(at, values, style, color=colour, linewidth=1.3, label=f"{kind}, every 5 dt")
    forces.plot(1e3 * run[0], run[1], **EXACT | {"label": "one run"})
    forces.set(xlabel="time (ms)", ylabel="contact force (N)", title="A lever strikes a stop: two FMUs against one run")
    each = min(1000, len(long) // 20)
    top = long[: len(long) // each * each].reshape(-1, each).max(axis=1)
    peaks.plot(each * np.arange(1, len(top) + 1), top, color=GREEN, label="waves, every 5 dt")
    peaks.axhline(TORQUE / LENGTH, **EXACT | {"label": "at rest"})
    peaks.set(xlabel="communication steps", ylabel=f"peak of {each} steps (N)", title="Long run", ylim=(0.0, None))
    for axis in (forces, peaks):
        axis.legend(frameon=False, fontsize="small")
        tidy(axis)
    return figure


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Run all, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)
    run, count = one_run(), 2_000 if arguments.quick else 100_000
    numbers, drawn = {"peak of the contact force, one run, N": float(run[1].max())}, {}
    tip = {"face": "striker.xmin", "components": ["x"]}
    waves = {**tip, "causality": "wave", "impedance": [IMPEDANCE]}
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "lever_of_another_tool.py"
        script.write_text(LEVER)
        lever = Path(FmuBuilder.build_FMU(script, dest=Path(folder) / "Lever.fmu"))
        held = build_fmu(scene(port={"tip": tip}), Path(folder) / "force.fmu", extra={})
        whole = build_fmu(scene(port={"tip": waves}), Path(folder) / "whole.fmu", extra={})
        for parts in (1, 5):
            shorter = scene(SPEED * parts * STEP, port={"tip": waves})
            joined = build_fmu(shorter, Path(folder) / f"waves{parts}.fmu", extra={})
            given = parts, round(END / STEP / parts)
            drawn["waves", parts] = by_waves(lever, joined, *given)
            drawn["waves, strip not taken off", parts] = by_waves(lever, whole, *given)
            drawn["force and rate", parts] = by_force(lever, held, *given)
            if util.find_spec("libcosimpy"):
                drawn["waves, libcosim", parts] = in_libcosim(lever, joined, *given)
        long = by_waves(lever, joined, 5, count)
    for (kind, parts), force in drawn.items():
        wanted = run[1][parts::parts]
        numbers[f"error, {kind}, {parts} dt"] = float(np.linalg.norm(force - wanted) / np.linalg.norm(wanted))
    numbers["steps of the long run"] = float(count)
    first, second = (float(half.max()) for half in np.split(long, 2))
    numbers["peak of its second half over that of its first"] = second / first
    print(f"figure: {save(draw(run, drawn, long), arguments.folder, 'stop')}")
    print(table(numbers))
    return numbers


if __name__ == "__main__":
    main()
