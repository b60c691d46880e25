"""Communication steps of a session in calls of the kernels (``kernels.communication``).

The image of the run holds all that the next step depends on in its state. Inputs are written into it before each step.
The kernels set the histories of a step, march and follow its outputs; windows that they do not solve are left to
``latin.windows`` in between: those of several instants, and those of one that need a fall-back.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..kernels import entries
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import Array, InterfaceHistory
from ..latin.windows import Run
from ..propagator.image import Image
from ..propagator.layout import COMMUNICATION_ROWS
from ..scene.schema import Scene
from .loads import GridPart, Loads
from .output_rows import OutputRows
from .outputs import first_event

_CANCELLED: Final = 1e-6  # of the work of the interfaces, as there
_SAFE: Final = 0.25  # of the energy put in: half of what ``latin.status.with_energy`` allows to be gained


class Origin(NamedTuple):
    """Start of a step: state of the run (at t = 0 under these loads) and loads; what of the grid the step takes, and
    the number of its time steps."""

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
    must_record : whether a step has to be recorded, because its energies, or forces of moved faces, do not follow from
    the outputs. origin : of the last step. begun : of the one that is made.
    """

    must_record = False
    origin: Origin | None = None
    begun: Origin | None = None

    def __init__(self, scene: Scene, rule: int, run: SegmentedRun, outputs: OutputRows) -> None:
        self._scene, self._rule, self._run = scene, rule, run
        self.sources, self._outputs = outputs.sources, outputs
        most, end = COMMUNICATION_ROWS - 1, self.sources.end
        # own laws are tabulated over the interval of the scene, and no call goes beyond a table
        self._most = most if end < 0 else min(most, end)  # time steps that one call can make
        self._states = np.zeros(0), np.zeros(0)  # before this step, before the last one
        self._by_caller = False  # whether windows are solved from Python
        self._has_rows = False  # whether the output of the image is that of the last step

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
    def image(self) -> Image:
        """The image of the run."""
        assert self._run.run is not None
        return self._run.run.image

    def _lay_out(self, loads: Loads, part: GridPart) -> Run:
        """Lay the histories out for as many time steps as one call makes, the first of them that to come."""
        run, made = self._run, self._run.made
        given = loads.driving(part, run.dt, self._rule)
        rows = np.ones((COMMUNICATION_ROWS, len(self.sources)))  # what varies must not look constant to the layout
        rows[:2, : len(given)] = np.reshape([line[:2] for line in given.values()], (-1, 2)).T
        rows[:2, len(given) :] = self.sources.own(self._scene, run.instants(made, 1))
        with np.errstate(all="ignore"):  # an overflow is reported as "not converged"
            march = run.lay_out(self.sources.named(rows))
        self._by_caller = march.settings.window != 1 or not march.marches
        march.image.set({"first_row": 0, "by_caller": int(self._by_caller)})
        accounted = run.problem.output.energy and not run.problem.assembly.quasi_static
        self._followed = accounted and self._follows_energy
        self.must_record = (accounted and not self._followed) or bool(self._outputs.incomplete)
        return march

    def _open(self, loads: Loads, part: GridPart) -> None:
        """The state at t = 0 under the loads of the first step."""
        image = self._lay_out(loads, part).image
        self.give(image, loads, part, 0)
        image.call(entries.PRESENT, self._rule, part.n)
        if self._run.problem.output.energy and not self._run.problem.assembly.quasi_static:
            self._run.stored = float(image.field("progress", 9)[4])

    # -- steps ----------------------------------------------------------------------------------------------------
    def march(self, loads: Loads, part: GridPart, early: bool = False) -> Array | None:
        """Make a communication step; outputs at its end. None where it has to be ``recorded``: an instant needs a
        fall-back, windows have several instants, the scheme may have gained energy.

        early : up to the end of the first time step with a contact event.
        """
        run, self.begun = self._run, None
        if run.run is None:
            self._open(loads, part)
        elif run.room < min(part.n, COMMUNICATION_ROWS - 1):
            self._lay_out(loads, part)
        before = run.get_state(self._states[0])
        assert before is not None
        self.begun, self._has_rows = Origin(before, loads, part, part.n), False
        if self._by_caller:
            return None
        row = self._marched(self.begun, early=early)
        # an event has ended a time step before the last: made once more, up to there, as the loads go on from its end
        if row is not None and self._ends < part.n:
            self.image.state[:], self.begun = before["state"], self.begun._replace(n=self._ends)
            row = self._marched(self.begun)
        if row is None or (self._followed and self._gains_energy(row)):
            return None
        self._has_rows = self.begun.n < COMMUNICATION_ROWS
        run.made += self.begun.n
        if run.problem.output.energy:
            friction = run.running["friction_dissipation"] = float(self.image.field("progress", 9)[5])
            if self._followed:  # the interfaces dissipate the work that the bodies do on them
                work = row[self._outputs.places["energy.interface_work"]]
                run.running["contact_dissipation"] = -float(work) - friction
        return row

    def take_back(self) -> None:
        """Return to the state before the step that is made."""
        if self._run.made == 0:
            self._run.reset()
        elif self.begun is not None:
            self._run.set_state(self.begun.state)

    def accept(self, loads: Loads) -> None:
        """End the step that was made to its end: let the loads go on from what it has left of them."""
        progress = self.image.field("progress", 9).tolist()
        loads.memory[:] = self.image.field("inputs", *loads.memory.shape)
        loads.span, loads.behind = progress[3], progress[7]

    def keep_state(self) -> None:
        """Keep the state before the step that was made until the next one is."""
        self.origin = self.begun
        assert self.origin is not None
        # two buffers in turn: that of the last step stays readable while the next one is made
        self._states = self._states[1], self.origin.state["state"]

    def recorded(self, early: bool = False) -> Segment:
        """The step as a segment: what ``march`` has just made, else it is made now; taken back where it is not
        accepted. ``early`` : as there."""
        assert self.begun is not None
        step, run = self.begun, self._run
        after = self.image.state.copy() if self._has_rows and run.room > 0 else None  # no segment was begun since
        run.set_state(step.state)

        def solve(run: Run) -> None:
            # the rows can be kept as they are where no field in between has to be stored
            if after is not None and run.recorder.until_fields() >= step.n:
                run.image.state[:] = after
                run.keep_marched(1, step.n, 1)
            else:
                run.image.state[:] = step.state["state"]
                run.image.set({"first_row": 0})
                self._marched(step, run, early)

        driving = step.loads.driving(step.part, run.dt, self._rule)
        given = {name: line[: step.n + 1] for name, line in driving.items()}
        with np.errstate(all="ignore"):
            segment = run.advance((run.made + step.n) * run.dt, step.n, given, solve=solve)
        run.room, self._has_rows = step.n, False
        if early and segment.accepted and self._ends < step.n:
            run.set_state(step.state)
            self.begun = step._replace(n=self._ends)
            return self.recorded()  # once more, as one that ends there
        return segment

    def give(self, image: Image, loads: Loads, part: GridPart, made: int) -> Array:
        """Write inputs and place of a step into an image; its ``progress``."""
        inputs = self.sources.inputs
        image.field("input_value", len(inputs))[:] = [loads.value[name] for name in inputs]
        image.field("input_rate", len(inputs))[:] = [loads.rate[name] for name in inputs]
        image.field("inputs", *loads.memory.shape)[:] = loads.memory
        progress = image.field("progress", 9)
        progress[0], progress[3], progress[7], progress[8] = made, loads.span, loads.behind, part.rest
        progress[6] = self._outputs.start
        return progress

    def _marched(self, step: Origin, run: Run | None = None, early: bool = False) -> Array | None:
        """Outputs at the end of a step from the state in the image, None where a time step did not converge; ``run`` :
        records the instants, with fall-backs; ``early`` : up to a contact event, which ends the time step ``_ends``."""
        march, image, self._ends = self._run.run, self.image, step.n
        assert march is not None
        self.give(image, step.loads, step.part, step.state["made"])
        image.field("worst", len(self._run.problem.assembly.interfaces))[:] = 0.0
        outputs = image.field("output", image.rows, self._outputs.n)
        most, done, row = self._most, 0, 0
        if run is not None and run.recorder.until_fields() < step.n:
            most = 1  # fields of the instants in between are kept
        while done < self._ends:
            n = min(most, step.n - done)
            self.tabulate(step.state["made"] + done, n)
            row = march.communicate(n, self._rule, done, step.part.n)
            if run is None and row < n:
                return None
            if run is not None and row:
                run.keep_marched(done + 1, row, 1)
            if run is not None and row < n:
                solved = self._solved(run, row, n - row, done, step.part.n)
                if not solved:
                    return None
                row += solved
            event = first_event(outputs[: row + 1, self._outputs.of_event :]) if early else None
            done, self._ends = done + row, self._ends if event is None else done + event
        last: Array = outputs[row].copy()
        return last

    def _solved(self, run: Run, row: int, left: int, done: int, whole: int) -> int:
        """Solve the window behind a row, which the kernels have left, and end its time steps; how many, 0 where it did
        not converge. ``left`` : rows of the call. ``done`` : time steps before the call, of ``whole``."""
        image = run.image
        n = min(run.settings.window or left, left, image.window) if self._by_caller else 1
        record = run.solve_rows(row + 1, n, done)
        if not record.converged:
            return 0
        progress = image.field("progress", 9)
        progress[1] += record.iterations
        progress[2] = max(progress[2], record.final_error)
        image.set({"first_row": 0})
        for i in range(row, row + n):
            image.call(entries.CONCLUDE, i + 1, done + i, whole, self._rule)
        return n

    # -- own laws of the scene ------------------------------------------------------------------------------------
    def tabulate(self, made: int, n: int) -> None:
        """Let the table of own laws hold the next n time steps, beyond the end of the scene too."""
        sources, image = self.sources, self.image
        first, end = int(image.run_fields.get("law_first", 0)), sources.end
        if end < 0 or first <= made <= first + end - n:
            return
        # the table of the scene where it reaches, else one that begins here
        first = 0 if made + n <= end else made
        table = sources.table if first == 0 else sources.own(self._scene, self._run.instants(first, end))
        image.write()
        at = image.run_fields["law_table"]
        image.fixed[at : at + table.size] = table.ravel()
        image.set({"law_first": first})

    # -- what follows from the outputs ----------------------------------------------------------------------------
    def _gains_energy(self, row: Array) -> bool:
        """Whether the scheme may have gained energy, so that ``latin.status.with_energy`` must check the energies."""
        names = "work_of_loads", "interface_work", "damping_dissipation", "landing_dissipation", "scheme_dissipation"
        places = [self._outputs.places[f"energy.{name}"] for name in names]
        of_loads, work, damping, landing, scheme = row[places].tolist()
        put_in = (self._run.stored or 0.0) + max(of_loads, 0.0) + _CANCELLED * abs(work)
        return not work - damping - landing - scheme <= _SAFE * put_in  # NaN, too

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
            rows.keep(self.image, None, 0, n, 0)
            return rows.histories(n, duration)
        before, self.begun = run.get_state(), self.origin
        segment = self.recorded()
        run.set_state(before)
        return segment.interfaces
