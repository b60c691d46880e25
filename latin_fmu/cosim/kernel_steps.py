"""Communication steps of a session in one call of the kernels each (``kernels.communication``).

The image of the run serves both drivers: displacements, velocities, tractions, gaps, outputs and what the next ones
follow from are in the same places. Inputs are written into it before each step, and what the step leaves of them is
read. The Python driver is given the prescribed motions before its next step.
"""

from __future__ import annotations

from math import prod
from typing import Final, NamedTuple

import numpy as np

from ..assembly.segments import Segment, SegmentedRun
from ..kernels import entries
from ..kernels.outputs import N_SOLVER
from ..latin.assembly import GroundState
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import Array, InterfaceHistory
from ..latin.windows import Run
from ..propagator.forcing import MotionState
from ..propagator.image import COMMUNICATION_ROWS, Image
from ..scene.schema import Scene
from .loads import Loads, Part
from .output_rows import OutputRows
from .outputs import first_event
from .variables import ENERGIES

_WORK: Final = list(ENERGIES).index("interface_work")
_CANCELLED: Final = 1e-6  # of the work of the interfaces, as there
_SAFE: Final = 0.25  # of the energy put in: half of what ``latin.status.with_energy`` allows to be gained


class Origin(NamedTuple):
    """Start of the last step in kernels: state of the image, time steps made before, loads; and what of the grid that
    step took, and the number of its time steps."""

    state: Array
    made: int
    loads: Loads
    part: Part
    n: int


class KernelSteps:
    """The image of a run as the kernels advance it.

    Parameters
    ----------
    scene, run, outputs : what is solved, and its outputs. rule : of interpolation.

    Attributes
    ----------
    valid : whether the image holds the present state of inputs, too. must_record : whether a step
    has to be recorded, because its energies do not follow from the outputs. origin : of the last step, None where the
    Python driver made it.
    """

    def __init__(self, scene: Scene, rule: int, run: SegmentedRun, outputs: OutputRows) -> None:
        self._scene, self._rule, self._run = scene, rule, run
        self.sources, self._outputs = outputs.sources, outputs
        self._moved = any(port.causality == "motion_in" for port in scene.port.values())
        self._states = np.zeros(0), np.zeros(0)  # before this step, before the last one
        self.reset()

    def reset(self) -> None:
        """Take the state in the image as one of the Python driver."""
        self.valid = self._read = self._has_rows = self.must_record = False
        self._room = 0  # time steps that histories are laid out for
        self.origin: Origin | None = None

    # -- what the kernels can do ------------------------------------------------------------------------------------
    @property
    def made(self) -> int:
        """Time steps made since the start."""
        return self._made if self.valid else self._run.made

    def fit(self, n: int) -> bool:
        """Whether the kernels can make the next n time steps."""
        if self.made == 0 or 0 <= self.sources.end < self.made + n:
            return False
        return self.valid or self._compiles()

    def _compiles(self) -> bool:
        """Whether nothing in a step of this run needs Python."""
        run, problem = self._run.run, self._run.problem
        if run is None or problem.settings.window != 1 or run.on_threads:
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

    # -- from the Python driver -----------------------------------------------------------------------------------
    def ready(self, n: int) -> bool:
        """Whether a step of n time steps needs no ``take_over``."""
        return self.valid and self._room >= min(n, COMMUNICATION_ROWS - 1)

    def take_over(self, loads: Loads, part: Part) -> None:
        """Write what the kernels need into the image, which the Python driver has left at the present time.

        loads, part : of the step that is made next.
        """
        self.give_back()
        kept = self._image.state.copy()
        self._lay_out(loads, part)
        self._image.state[:] = kept  # gaps read from the displacements of a moving ground would differ by round-off
        if not self.valid:
            self._made, self._unrecorded = self._run.made, False
        self.valid, self._room, self._read = True, COMMUNICATION_ROWS - 1, False

    @property
    def _image(self) -> Image:
        assert self._run.run is not None
        return self._run.run.image

    def _lay_out(self, loads: Loads, part: Part) -> None:
        """Lay the histories out for as many time steps as one call makes, the first of them that to come."""
        run, made = self._run, self._run.made
        given = loads.driving(part, run.dt, self._rule)
        rows, own = np.ones((COMMUNICATION_ROWS, len(self.sources))), self.sources.table
        for e, name in enumerate(self.sources.inputs):
            rows[:2, e] = given[name][:2]
        for row in (0, 1):
            rows[row, len(self.sources.inputs) :] = own[min(made + row, len(own) - 1)]
        image = run.lay_out(self.sources.named(rows)).image
        image.set({"first_row": 0})
        accounted = run.problem.output.energy and not run.problem.assembly.quasi_static
        self._followed = accounted and self._follows_energy
        self.must_record = accounted and not self._followed
        if len(self._states[0]) != len(image.state):
            self._states = np.empty(len(image.state)), np.empty(len(image.state))

    # -- steps ----------------------------------------------------------------------------------------------------
    def march(self, loads: Loads, part: Part, early: bool = False) -> Array | None:
        """Make a communication step; outputs at its end, None where a time step did not converge: then nothing has
        changed. ``early`` : up to the end of the first time step with a contact event."""
        now, last = self._states
        np.copyto(now, self._image.state)
        begun = Origin(now, self._made, loads, part, part.n)
        row = self._marched(begun, early=early)
        if row is not None and self._ends < part.n:
            self._image.state[:], begun = now, begun._replace(n=self._ends)
            row = self._marched(begun)
        if row is None or (self._followed and self._gains_energy(row)):
            self._image.state[:] = now
            return None
        self._undo = self._states, self.origin, self._read, self._unrecorded
        self._states, self.origin, self._made, self._read = (last, now), begun, begun.made + begun.n, False
        self._has_rows, self._unrecorded = begun.n < COMMUNICATION_ROWS, True
        return row

    def recorded(self) -> Segment:
        """The ``march`` that was just made as the Python driver records it; taken back where it is not accepted."""
        segment = self._recorded()
        self._read = self._unrecorded = False
        self._room = len(segment.time) - 1
        if not segment.accepted:
            assert self.origin is not None
            self._image.state[:], self._made = self.origin.state, self.origin.made
            self._states, self.origin, self._read, self._unrecorded = self._undo
            self._has_rows = False
        return segment

    def _recorded(self) -> Segment:
        """The last step from its origin on; the state afterwards is that of now."""
        assert self.origin is not None
        step, after, has_rows, dt = self.origin, self._image.state.copy(), self._has_rows, self._run.dt
        self.return_to_origin()
        self.leave()

        def solve(run: Run) -> None:
            if has_rows and run.recorder.until_fields() >= step.n:
                run.image.state[:] = after
                run.keep_marched(1, step.n, 1)
            else:
                run.image.state[:] = step.state
                run.image.set({"first_row": 0})
                self._marched(step, run)

        driving = step.loads.driving(step.part, dt, self._rule)
        given = {name: line[: step.n + 1] for name, line in driving.items()}
        with np.errstate(all="ignore"):
            return self._run.advance((step.made + step.n) * dt, step.n, given, solve=solve)

    def _marched(self, step: Origin, run: Run | None = None, early: bool = False) -> Array | None:
        """Outputs at the end of a step from the state in the image, None where a time step did not converge; ``run`` :
        records the instants; ``early`` : up to a contact event, which ends the time step ``_ends``."""
        image, inputs, self._has_rows, self._ends = self._image, self.sources.inputs, False, step.n
        image.field("input_value", len(inputs))[:] = [step.loads.value[name] for name in inputs]
        image.field("input_rate", len(inputs))[:] = [step.loads.rate[name] for name in inputs]
        image.field("inputs", *step.loads.memory.shape)[:] = step.loads.memory
        progress = image.field("progress", 9)
        progress[0], progress[3], progress[7], progress[8] = (
            step.made,
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

    # -- to the Python driver -------------------------------------------------------------------------------------
    def leave(self) -> None:
        """Mark the image as one that the Python driver changes next."""
        self._room, self._has_rows = 0, False

    def give_back(self) -> None:
        """Give motions and times to the Python driver."""
        if self.valid and not self._read:
            self._give(self._image.state, self._made, self._unrecorded)
            self._read, self._unrecorded = True, False

    def return_to_origin(self) -> None:
        """Return to before the last step, for the Python driver."""
        assert self.origin is not None
        self._image.state[:] = self.origin.state
        self._give(self.origin.state, self.origin.made, self._undo[-1])

    def _part(self, state: Array, name: str, *shape: int) -> Array:
        """A field of the state of the image, a view."""
        at = int(self._image.run[0][name])
        return state[at : at + prod(shape)].reshape(shape)

    def _give(self, state: Array, made: int, unrecorded: bool) -> None:
        run, at = self._run, 0
        moved = self._part(state, "motion_state", int(self._image.run[0]["n_motion_state"]))
        motions: list[list[MotionState]] = []
        for propagator in run.problem.assembly.propagators:
            k, m = propagator.members[0].imposed_pattern.shape[1], len(propagator.members)
            u, v, a = moved[at : at + 3 * k * m].reshape(3, k, m)
            motions.append([(u[:, j].copy(), a[:, j].copy(), v[:, j].copy()) for j in range(m)])
            at += 3 * k * m
        ground = {}
        for i in run.ground:
            ground[i] = GroundState(moved[at : at + 3].copy(), moved[at + 3 : at + 6].copy())
            at += 6
        losses = {}
        if run.problem.output.energy:
            friction = losses["friction_dissipation"] = float(self._part(state, "progress", 9)[5])
            if self._followed and unrecorded:  # the interfaces dissipate the work that the bodies do on them
                work = self._part(state, "present", self._outputs.n)[self._outputs.of_solver + N_SOLVER + _WORK]
                losses["contact_dissipation"] = -float(work) - friction
        run.go_on(made, motions, ground, losses)

    def histories(self) -> dict[str, InterfaceHistory]:
        """Histories of the interfaces over the instants of the last step."""
        assert self.origin is not None
        run, n = self._run, self.origin.n + 1
        assembly, duration = run.problem.assembly, run.problem.output.peak_duration
        rows = InterfaceRows(assembly, np.zeros((n, InterfaceRows.width_of(assembly))))
        if self._has_rows and not rows.slide:
            rows.keep(self._image, None, 0, n, 0)
            return rows.histories(n, duration)
        self.give_back()
        before = run.get_state()
        segment = self._recorded()
        run.set_state(before)
        return segment.interfaces
