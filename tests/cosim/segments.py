"""A scene advanced by segments of a run, against which the engine of co-simulation is compared.

Histories come from the laws of the scene (``assembly.timeline``), windows of one instant are marched as in a run, and
outputs follow from the recorded fields, by their formulas over the points. None of it is used by the engine: that takes
its histories from matrices over the inputs, and its outputs from matrices over signals.
"""

from __future__ import annotations

from inspect import unwrap
from typing import Any, NamedTuple

import numpy as np

from latin_fmu.assembly.interfaces import completed
from latin_fmu.assembly.supports import port_key
from latin_fmu.cosim.input_table import given_of
from latin_fmu.cosim.output_table import INTERFACE, FacePoints
from latin_fmu.cosim.segments import Segment, SegmentedRun
from latin_fmu.cosim.variables import scalar_table
from latin_fmu.kernels import inputs
from latin_fmu.latin.outcome import InterfaceHistory
from latin_fmu.scene.schema import Scene

Array = np.ndarray[Any, np.dtype[np.float64]]
_placed = unwrap(inputs.placed)
_AXES = (1, 2, 3)
_ENERGIES = (
    "kinetic",
    "elastic",
    "work_of_loads",
    "interface_work",
    "friction_dissipation",
    "damping_dissipation",
    "scheme_dissipation",
)


class GridPart(NamedTuple):
    """Time steps that end in a communication step, and the fraction of one between the last instant and its end."""

    n: int
    rest: float


class Loads:
    """Inputs of a scene, and what the steps so far have left of them (``kernels.inputs``)."""

    def __init__(self, scene: Scene) -> None:
        given = given_of(scene)
        self.value = {source.name: source.start for source in given}
        self.rate = dict.fromkeys(self.value, 0.0)
        self.kinds = np.array([source.drives for source in given], dtype=np.int64)
        self.memory: Array = np.zeros((inputs.N_MEMORY, len(given)))
        self.memory[[inputs.REACHED, inputs.BEFORE, inputs.DRIVEN]] = list(self.value.values())
        self.span = self.behind = 0.0

    def set(self, name: str, value: float, rate: float = 0.0) -> None:
        """Set value and rate."""
        self.value[name], self.rate[name] = float(value), float(rate)

    def begin(self) -> None:
        """Start a simulation with the present values."""
        self.memory[[inputs.REACHED, inputs.DRIVEN]] = self._given()[0]
        self.memory[[inputs.HELD, inputs.RATED, inputs.CARRIED]], self.span, self.behind = 0.0, 0.0, 0.0

    def _given(self) -> tuple[Array, Array]:
        return np.array(list(self.value.values()), dtype=float), np.array(list(self.rate.values()), dtype=float)

    def driving(self, part: GridPart, dt: float, rule: int) -> dict[str, Array]:
        """Amplitudes (n + 1,) over the time steps of dt, s, that a step ends; of displacements their rates."""
        lines = np.zeros((len(self.value), part.n + 1))
        memory = self.memory.reshape(-1)
        inputs.interpolate(*self._given(), memory, self.kinds, self.span, dt, rule, self.behind, part.rest, lines)
        return dict(zip(self.value, lines, strict=True))

    def part(self, made: int, t: float, h: float, t0: float, dt: float) -> GridPart:
        """What of the grid the step from t to t + h, s, ends; ``made`` : time steps so far, since t0."""
        off = 4e-16 * (abs(t) + abs(t + h)) / dt
        return GridPart(*_placed(made, self.behind, (t + h - t0) / dt, h / dt, off))

    def accept(self, part: GridPart, dt: float, rule: int) -> None:
        """End a step."""
        begin, memory = self.behind, self.memory.reshape(-1)
        given = self._given()
        self.span = inputs.accept(*given, memory, self.kinds, self.span, dt, rule, part.n, part.n, begin, part.rest)
        self.behind = part.rest


class Segments:
    """A scene advanced by communication steps, each a segment of a run.

    Attributes
    ----------
    row : outputs (n_output,) in the order of a session; NaN for those that are not computed here. histories : of the
        interfaces over the last step.
    """

    def __init__(self, scene: Scene, rule: int) -> None:
        self.scene = completed(scene)
        self.table = scalar_table(self.scene)
        self.outputs = [v.name for v in self.table if v.causality == "output"]
        self.run, self.loads, self.rule = SegmentedRun(self.scene), Loads(self.scene), rule
        self.t0 = 0.0
        self.impulses: dict[str, Array] = {}
        self.histories: dict[str, InterfaceHistory] = {}
        self.row: Array = np.full(len(self.outputs), np.nan)

    def initialize(self, t0: float = 0.0) -> None:
        """Begin with the inputs that are set, at t0, s."""
        self.t0 = t0
        self.loads.begin()

    def step(self, t: float, h: float) -> str:
        """Advance from t by h, s; why not, where a window does not converge."""
        dt = self.run.dt
        part = self.loads.part(self.run.steps, t, h, self.t0, dt)
        if part.n:
            driving = self.loads.driving(part, dt, self.rule)
            with np.errstate(all="ignore"):
                segment = self.run.advance((self.run.steps + part.n) * dt, part.n, driving)
            if not segment.accepted:
                return segment.status
            self._follow(segment, dt)
        self.loads.accept(part, dt, self.rule)
        return ""

    def _follow(self, segment: Segment, dt: float) -> None:
        """Outputs at the end of a segment."""
        known: dict[str, float] = {"innerTime": self.t0 + self.run.steps * dt, "solver.converged": 1.0}
        known["solver.instants"] = len(segment.time) - 1.0
        known |= {"solver.iterations": float(segment.iterations), "solver.errorIndicator": segment.error_indicator}
        for name, history in segment.interfaces.items():
            force = history.force()
            steps = 0.5 * dt * (force[1:] + force[:-1]).sum(axis=0)
            self.impulses[name] = self.impulses.get(name, np.zeros(3)) + steps
            known |= _numbered(f"interface.{name}.impulse", self.impulses[name])
            points = FacePoints.over(history)
            for row in INTERFACE.rows:
                if row.of is not None and row.axes(self.scene.joints[name]):
                    known |= _numbered(f"interface.{name}.{row.name}", np.asarray(row.of(points))[-1])
        for name, sensor in segment.sensors.items():
            known |= _numbered(f"sensor.{name}.displacement", sensor.displacement[-1])
            known |= _numbered(f"sensor.{name}.velocity", sensor.velocity[-1])
        reactions = segment.recorder.reactions(self.run.problem.assembly, ports=True)
        for name, turned, what in [(n, t, w) for n in self.scene.port for t, w in ((False, "force"), (True, "moment"))]:
            if (moved := reactions.get(port_key(name, turned))) is not None:
                known |= _numbered(f"port.{name}.{what}", -moved.force[-1])
        for name, bolt in segment.bolts.items():
            known[f"bolt.{name}.force"] = float(bolt.force[-1])
        if segment.energy is not None:
            known |= {f"energy.{name}": float(segment.energy[name][-1]) for name in _ENERGIES if name in segment.energy}
        self.histories = segment.interfaces
        self.row = np.array([known.get(name, np.nan) for name in self.outputs])


def _numbered(stem: str, values: Array) -> dict[str, float]:
    """Values by the names of the outputs, components counted from 1."""
    if values.ndim == 0:
        return {stem: float(values)}
    return {f"{stem}[{i}]": float(value) for i, value in zip(_AXES, values, strict=True)}
