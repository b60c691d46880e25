"""Communication steps of a session in one call of the kernels each (``kernels.communication``).

The image of the run serves both drivers: all that the next step depends on is its state. Inputs are written into it
before each step.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..kernels import entries
from ..kernels.outputs import N_SOLVER
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import Array, InterfaceHistory
from ..latin.windows import Run
from ..propagator.image import Image
from ..propagator.layout import COMMUNICATION_ROWS
from ..scene.schema import Scene
from .loads import GridPart, Loads
from .output_rows import OutputRows
from .outputs import first_event
from .variables import ENERGIES

_WORK: Final = list(ENERGIES).index("interface_work")
_CANCELLED: Final = 1e-6  # of the work of the interfaces, as there
_SAFE: Final = 0.25  # of the energy put in: half of what ``latin.status.with_energy`` allows to be gained


class Origin(NamedTuple):
    """Start of the last step in kernels: state of the run and loads; and what of the grid that step took, and the
    number of its time steps."""

    state: dict[str, Any]
    loads: Loads
    part: GridPart
    n: int


class KernelSteps:
    """The image of a run as the kernels advance it.

    Parameters
    ----------
    scene, run, outputs : what is solved, and its outputs. rule : of interpolation.

    Attributes
    ----------
    must_record : whether a step has to be recorded, because its energies do not follow from the outputs. origin : of
    the last step in kernels.
    """

    must_record = False
    origin: Origin | None = None

    def __init__(self, scene: Scene, rule: int, run: SegmentedRun, outputs: OutputRows) -> None:
        self._scene, self._rule, self._run = scene, rule, run
        self.sources, self._outputs = outputs.sources, outputs
        self._moved = any(port.causality == "motion_in" for port in scene.port.values())
        self._states = np.zeros(0), np.zeros(0)  # before this step, before the last one
        self._has_rows = False  # whether the output of the image is that of the last step

    # -- what the kernels can do ------------------------------------------------------------------------------------
    def fit(self, n: int) -> bool:
        """Whether the kernels can make the next n time steps."""
        run, problem, end = self._run.run, self._run.problem, self.sources.end
        if run is None or 0 <= end < self._run.made + n:
            return False
        if self._run.room:
            return True
        if problem.settings.window != 1 or run.on_threads:
            return False
        return run.compiles() and not (self._moved and problem.assembly.scheme.explicit)

    @property
    def _follows_energy(self) -> bool:
        """Whether the outputs show a scheme that gains energy: where contacts and friction alone dissipate at the
        interfaces, and nothing moves from outside."""
        problem = self._run.problem
        grounds = [joint.ground_velocity for joint in self._scene.joints.values()]
        if any(velocity is not None for velocity in grounds):
            return False
        behaviours = [unit.behaviour for unit in problem.assembly.interfaces]
        return not any(b.elastic or b.compliant for b in behaviours) and not any(
            propagator.forcing.moves for propagator in problem.assembly.propagators
        )

    @property
    def _image(self) -> Image:
        assert self._run.run is not None
        return self._run.run.image

    def _lay_out(self, loads: Loads, part: GridPart) -> None:
        """Lay the histories out for as many time steps as one call makes, the first of them that to come."""
        run, made = self._run, self._run.made
        given = loads.driving(part, run.dt, self._rule)
        rows, own = np.ones((COMMUNICATION_ROWS, len(self.sources))), self.sources.table
        for e, name in enumerate(self.sources.inputs):
            rows[:2, e] = given[name][:2]
        for row in (0, 1):
            rows[row, len(self.sources.inputs) :] = own[min(made + row, len(own) - 1)]
        kept = self._image.state.copy()
        image = run.lay_out(self.sources.named(rows)).image
        image.state[:] = kept  # gaps read from the displacements of a moving ground would differ by round-off
        image.set({"first_row": 0})
        accounted = run.problem.output.energy and not run.problem.assembly.quasi_static
        self._followed = accounted and self._follows_energy
        self.must_record = accounted and not self._followed

    # -- steps ----------------------------------------------------------------------------------------------------
    def march(self, loads: Loads, part: GridPart, early: bool = False) -> Array | None:
        """Make a communication step; outputs at its end, None where a time step did not converge: then nothing has
        changed. ``early`` : up to the end of the first time step with a contact event."""
        run = self._run
        if run.room < min(part.n, COMMUNICATION_ROWS - 1):
            self._lay_out(loads, part)
        now, last = self._states
        before = run.get_state(now)
        assert before is not None
        begun = Origin(before, loads, part, part.n)
        row = self._marched(begun, early=early)
        if row is not None and self._ends < part.n:
            self._image.state[:], begun = before["state"], begun._replace(n=self._ends)
            row = self._marched(begun)
        if row is None or (self._followed and self._gains_energy(row)):
            self._image.state[:] = before["state"]
            return None
        self._states, self.origin = (last, before["state"]), begun
        self._has_rows = begun.n < COMMUNICATION_ROWS
        run.made += begun.n
        if run.problem.output.energy:
            friction = run.running["friction_dissipation"] = float(self._image.field("progress", 9)[5])
            if self._followed:  # the interfaces dissipate the work that the bodies do on them
                work = row[self._outputs.of_solver + N_SOLVER + _WORK]
                run.running["contact_dissipation"] = -float(work) - friction
        return row

    def accept(self, given: Loads, loads: Loads) -> bool:
        """Let the loads go on from what a ``march`` to the end of the step has left of those ``given`` to it; False
        where the last one was another."""
        if self.origin is None or self.origin.loads is not given or self.origin.n < self.origin.part.n:
            return False
        progress = self._image.field("progress", 9).tolist()
        loads.memory[:] = self._image.field("inputs", *loads.memory.shape)
        loads.span, loads.behind = progress[3], progress[7]
        return True

    def recorded(self) -> Segment:
        """The ``march`` that was just made as the Python driver records it; taken back where it is not accepted."""
        assert self.origin is not None
        step, after, run = self.origin, self._image.state.copy(), self._run
        has_rows = self._has_rows and run.room > 0  # no segment was begun since
        run.set_state(step.state)

        def solve(run: Run) -> None:
            if has_rows and run.recorder.until_fields() >= step.n:
                run.image.state[:] = after
                run.keep_marched(1, step.n, 1)
            else:
                run.image.state[:] = step.state["state"]
                run.image.set({"first_row": 0})
                self._marched(step, run)

        driving = step.loads.driving(step.part, run.dt, self._rule)
        given = {name: line[: step.n + 1] for name, line in driving.items()}
        with np.errstate(all="ignore"):
            segment = run.advance((run.made + step.n) * run.dt, step.n, given, solve=solve)
        run.room, self._has_rows = step.n, False
        if not segment.accepted:
            self.origin = None  # another step follows from there
        return segment

    def _marched(self, step: Origin, run: Run | None = None, early: bool = False) -> Array | None:
        """Outputs at the end of a step from the state in the image, None where a time step did not converge; ``run`` :
        records the instants; ``early`` : up to a contact event, which ends the time step ``_ends``."""
        image, inputs, self._has_rows, self._ends = self._image, self.sources.inputs, False, step.n
        image.field("input_value", len(inputs))[:] = [step.loads.value[name] for name in inputs]
        image.field("input_rate", len(inputs))[:] = [step.loads.rate[name] for name in inputs]
        image.field("inputs", *step.loads.memory.shape)[:] = step.loads.memory
        progress = image.field("progress", 9)
        progress[0], progress[3], progress[7], progress[8] = (
            step.state["made"],
            step.loads.span,
            step.loads.behind,
            step.part.rest,
        )
        image.field("worst", len(self._run.problem.assembly.interfaces))[:] = 0.0
        outputs = image.field("output", image.rows, self._outputs.n)
        most, done, some = COMMUNICATION_ROWS - 1, 0, 0
        if run is not None and run.recorder.until_fields() < step.n:
            most = 1  # fields of the instants in between are kept
        while done < self._ends:
            some = min(most, step.n - done)
            if image.call(entries.COMMUNICATE, some, self._rule, done, step.part.n) != some:
                return None
            if run is not None:
                run.keep_marched(done + 1, some, 1)
            event = first_event(outputs[: some + 1, self._outputs.of_event :]) if early else None
            done, self._ends = done + some, self._ends if event is None else done + event
        last: Array = outputs[some].copy()
        return last

    def _gains_energy(self, row: Array) -> bool:
        """Whether the scheme may have gained energy, so that ``latin.status.with_energy`` must check the energies."""
        first = self._outputs.of_solver + N_SOLVER
        _, _, of_loads, work, _, damping, landing, scheme, _ = row[first : first + len(ENERGIES)].tolist()
        put_in = self._run.stored + max(of_loads, 0.0) + _CANCELLED * abs(work)
        return not work - damping - landing - scheme <= _SAFE * put_in

    def iterations(self, row: Array) -> tuple[int, float]:
        """Iterations and largest error indicator of the step with these outputs."""
        first = self._outputs.of_solver
        return int(row[first]), float(row[first + 1])

    def histories(self) -> dict[str, InterfaceHistory]:
        """Histories of the interfaces over the instants of the last step."""
        assert self.origin is not None
        run, n = self._run, self.origin.n + 1
        assembly, duration = run.problem.assembly, run.problem.output.peak_duration
        rows = InterfaceRows(assembly, np.zeros((n, InterfaceRows.width_of(assembly))))
        if self._has_rows and run.room and not rows.slide:
            rows.keep(self._image, None, 0, n, 0)
            return rows.histories(n, duration)
        before = run.get_state()
        segment = self.recorded()
        run.set_state(before)
        return segment.interfaces
