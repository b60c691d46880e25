"""A run that goes on segment by segment on one grid of time steps: loads given from outside, snapshots."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Any, Final

import numpy as np

from ..assembly.initial_state import InitialState
from ..assembly.models import KeptOperators
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem
from ..assembly.propagator_choice import modes_refused
from ..building import discretise, started
from ..errors import InputError, Problem, SceneError
from ..fem.mesh import Array
from ..joined.modal_problem import modal_problem
from ..joined.tied_assembly import TieError
from ..latin.assembly import Assembly, GroundState
from ..latin.outcome import BoltHistory, InterfaceHistory, ReactionHistory, SensorHistory, SubstructureHistory, Timings
from ..latin.recorder import Recorder
from ..latin.state_serialization import decode, encode
from ..latin.status import WindowList, stored_energy
from ..latin.windows import Run
from ..machine import one_thread
from ..propagator import Propagator
from ..propagator.base import full_displacement, full_velocity
from ..propagator.forcing import STRAIN, MotionState
from ..remarks import remarks_of
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .output_table import marched_by_modes

_ON_GRID = 1e-6  # of a time step: distance of an end from the instant that it stands for
_NO_ENERGIES: Final = "no energies are followed in communication steps of an assembly that is marched by its modes"
RUNNING: Final = ("friction_dissipation", "contact_dissipation", "ground_work", "joint_dissipation")


@dataclass(frozen=True)
class Segment:
    """Histories of one segment; the first instant of each is the start of the segment.

    Attributes
    ----------
    time : (n + 1,), s. interfaces, substructures, sensors, reactions, bolts, windows : as in a whole run; histories are
        made from the ``recorder`` when they are read.
    converged, status : whether every window converged, and a sentence. accepted : whether the state moved on.
    energy : terms of the assembly at the instants, accumulated since t = 0; None unless the scene requests them.
    """

    time: Array
    windows: WindowList
    converged: bool
    accepted: bool
    status: str
    energy: dict[str, Array] | None
    sensors: dict[str, SensorHistory]
    reactions: dict[str, ReactionHistory]
    bolts: dict[str, BoltHistory]
    recorder: Recorder

    @cached_property
    def interfaces(self) -> dict[str, InterfaceHistory]:
        """Histories of the interfaces."""
        return self.recorder.interfaces()

    @cached_property
    def substructures(self) -> dict[str, SubstructureHistory]:
        """Histories of the substructures for which some output is requested."""
        return self.recorder.substructures()

    @cached_property
    def iterations(self) -> int:
        """LATIN iterations over all windows."""
        return int(self.windows.counts()[:, 0].sum())

    @cached_property
    def error_indicator(self) -> float:
        """Largest sqrt(eta) of the accepted iterates of the windows."""
        return self.windows.largest_error()


class SegmentState:
    """A scene at the end of a segment, and at the beginning of the next one.

    Parameters
    ----------
    scene : forces whose law is ``input`` take the histories given from outside; the others keep their law.
    tolerance : replaces the tolerance of the scene (the force tolerance in proportion).

    Attributes
    ----------
    dt : time step, s. steps : time steps so far. run : windows of the present segment, None before the first.
    running : energies (J) that the interfaces have dissipated so far, by kind. stored : kinetic and elastic energy at
    t = 0, J, None where it is not known yet or not accounted for.

    Raises
    ------
    SceneError : the scene cannot be built.
    """

    def __init__(self, scene: Scene, tolerance: float | None = None) -> None:
        self.scene = scene
        if yields := [name for name, bolt in scene.bolt.items() if bolt.hardening is not None]:
            raise SceneError.of(
                "the scene cannot be run in steps",
                f"bolt.{yields[0]}.hardening",
                "the plastic elongation of a bolt is found by repeated runs",
                remedy="omit hardening: the bolt then remains elastic",
            )
        with one_thread():
            self._discretised = discretise(scene, kept=KeptOperators() if marched_by_modes(scene) else None)
            self.problem = self._built(self._discretised, None)  # a static start waits for the loads
        if tolerance is not None:
            factor = tolerance / self.problem.settings.tolerance
            settings = self.problem.settings
            self.problem = replace(
                self.problem,
                settings=replace(settings, tolerance=tolerance, force_tolerance=factor * settings.force_tolerance),
            )
        self._laws = {n: law for n, law in scene.force_laws.items() if isinstance(law, InputLaw)}
        self._amplitudes: dict[str, float] | None = None  # of the static start
        self.timings = Timings()
        self.steps = 0
        self.running: dict[str, float] = {}
        self.run: Run | None = None
        self.stored: float | None = None
        self._grid, self.dt = self.problem.assembly.time, self.problem.assembly.dt
        self._kind = hashlib.sha256(scene.text().encode()).hexdigest()

    def _built(self, discretised: DiscretisedProblem, start: InitialState | None) -> SolverReadyProblem:
        """The problem from an equilibrium, None: from the initial values of the scene; marched by modes where the scene
        says so. ``discretised`` : with the stiffness of the stress of the equilibrium where it counts.

        Raises
        ------
        SceneError : an assembly that has no modes to be marched by.
        """
        if not marched_by_modes(self.scene):
            return discretised.build(start)
        reasons = modes_refused(self.scene, False)
        try:
            if not reasons:
                problem = modal_problem(discretised, start)
                remarks = remarks_of("propagator", [_NO_ENERGIES] if self.scene.output.energy else [])
                return replace(problem, warnings=(*problem.warnings, *remarks))
        except TieError as error:
            reasons.append(str(error))
        raise SceneError.of(
            "the scene cannot be run in steps",
            "solver.propagator",
            f"its assembly cannot be marched by its modes: {'; '.join(reasons)}",
            "modal",
            remedy='use "automatic", which marches body by body in communication steps',
        )

    @property
    def starts_static(self) -> bool:
        """Whether the run starts from a static equilibrium."""
        return self._discretised.scene.time.start.type == "static"

    @property
    def time(self) -> float:
        """The present time, s."""
        return float(self.instants(self.steps, 0)[0])

    def instants(self, steps: int, n: int) -> Array:
        """The instant after so many time steps, and the n following ones, (n + 1,), s."""
        end = steps + n + 1
        # beyond the interval of the scene by the step: a session may go on
        if end <= len(self._grid):
            return self._grid[steps:end]
        return self.dt * np.arange(steps, float(end))

    def settle(self, amplitudes: Mapping[str, float]) -> None:
        """Solve the static equilibrium that the scene starts from, before the first segment, for these amplitudes of
        loads set from outside (others have their start value).

        Raises
        ------
        SceneError : there is no equilibrium; the state is unchanged.
        """
        start = self._at_start(amplitudes)
        # the equilibrium of these amplitudes is known
        if start == self._amplitudes or not self.starts_static:
            return
        before = self.problem
        with one_thread():
            problem = self._built(*started(self._discretised, start))
        output = replace(before.output, bolts=problem.output.bolts)
        self.problem = replace(problem, settings=before.settings, output=output)
        self._amplitudes, self.run = start, None

    def _at_start(self, amplitudes: Mapping[str, float]) -> dict[str, float]:
        """Amplitudes at t = 0 of all loads that are set from outside."""
        start = np.zeros(1)
        return {n: float(amplitudes[n] if n in amplitudes else law.sample(start)[0]) for n, law in self._laws.items()}

    def begin(self, n: int, loads: Mapping[str, Array]) -> Run:
        """Begin a segment of n time steps at the present time, without solving it; ``loads`` : as for
        ``SegmentedRun.advance``."""
        problem, assembly = self.problem, self.problem.assembly
        if self.run is None:
            fields = {"n_motion_state": motion_size(assembly)}
            for propagator in assembly.propagators:
                propagator.restart()  # the motions given from outside may start otherwise than those it was built with
        problem.timeline.begin(assembly, self.instants(self.steps, n), loads, self._resumed(), self.dt)
        arguments = assembly, problem.output, problem.info
        recorder = Recorder(*arguments)
        if self.run is not None:
            self.run.begin_segment(recorder)
        else:
            self.run = Run(assembly, problem.settings, recorder, self.timings, communication=fields)
        return self.run

    def _resumed(self) -> dict[int, GroundState]:
        """Let the propagators go on from the state in the image; the state of the ground of interfaces."""
        assembly = self.problem.assembly
        if self.run is None:
            return {i: GroundState(np.zeros(3), None) for i in assembly.ground.start}
        image = self.run.image
        motions, ground = unpacked_motions(assembly, image.field("motion_state", motion_size(assembly)).copy())
        for c, (propagator, motion) in enumerate(zip(assembly.propagators, motions, strict=True)):
            propagator.resume(image, c, motion)
        return ground

    def displacement(self, substructure: str) -> Array:
        """Displacements of all nodes of a substructure at the present time, (n_node, 3), m."""
        propagator, member = self._place(substructure)
        return full_displacement(propagator, member)

    def velocity(self, substructure: str) -> Array:
        """Velocities of all nodes of a substructure at the present time, (n_node, 3), m s-1."""
        propagator, member = self._place(substructure)
        return full_velocity(propagator, member)

    def _place(self, substructure: str) -> tuple[Propagator, int]:
        """Propagator of a substructure, and its number there."""
        return next(
            (p, p.names.index(substructure)) for p in self.problem.assembly.propagators if substructure in p.names
        )

    # -- states ---------------------------------------------------------------------------------------------------
    def get_state(self) -> dict[str, Any] | None:
        """Copy of the state of the image, and what is known beside it: all that determines the next segment to the last
        bit; None at t = 0."""
        if self.run is None:
            return None
        return {
            "made": self.steps,
            "start": self._amplitudes,
            "running": dict(self.running),
            "stored": self.stored,
            "state": self.run.image.state.copy(),
        }

    def set_state(self, state: Mapping[str, Any] | None) -> None:
        """Return to a state that ``get_state`` returned."""
        if state is None:
            self.reset()
            return
        assert self.run is not None
        self.run.image.state[:] = state["state"]
        self.steps, self.stored, self.running = state["made"], state["stored"], dict(state["running"])
        self._resumed()

    def reset(self) -> None:
        """Back to t = 0."""
        for propagator in self.problem.assembly.propagators:
            propagator.restart()
        self.steps = 0
        self.running = {}
        self.stored = None
        self.run = None


class SegmentedRun(SegmentState):
    """A scene advanced segment by segment."""

    def advance(self, end: float, n: int, loads: Mapping[str, Array] | None = None, accept: bool = False) -> Segment:
        """Solve n steps from the present time to ``end``.

        Parameters
        ----------
        end : the instant n time steps later, s. n : number of them. loads : amplitude (n + 1,) of loads by name.
        accept : move on even where a window did not converge (its best iterate); else the state is untouched.

        Raises
        ------
        InputError : an end that is not n time steps later.
        """
        last = (self.steps + n) * self.dt
        if n < 1 or not abs(end - last) <= _ON_GRID * self.dt:
            what = f"is not {n} time steps of {self.dt:g} s after {self.time:g} s"
            raise InputError([Problem("end of a segment", what, f"{end!r} s", f"{last!r} s")])
        # for the case that the segment fails
        before = self.get_state()
        try:
            with one_thread():
                segment = self._solve(n, loads or {})
        except Exception:  # of any kind: the state must not be half of the next one
            self.set_state(before)
            raise
        if not segment.converged and (not accept or (self.run is not None and self.run.stopped)):
            self.set_state(before)
            return replace(segment, accepted=False)
        self.steps += n
        if segment.energy is not None:
            for term in RUNNING:
                if term in segment.energy:
                    self.running[term] = float(segment.energy[term][-1])
        if self.run is not None:
            state = packed_motions(self.problem.assembly, n)
            self.run.image.field("motion_state", len(state))[:] = state
        return segment

    def _solve(self, n: int, loads: Mapping[str, Array]) -> Segment:
        # the first segment: a start that depends on the loads is found with them
        if self.run is None:
            self.settle({name: float(values[0]) for name, values in loads.items()})
        run = self.begin(n, loads)
        assembly, recorder = self.problem.assembly, run.recorder
        run.all()
        energy = recorder.assembly_energy(assembly)
        if energy is not None:
            for term in RUNNING:
                if term in energy:
                    energy[term] = energy[term] + self.running.get(term, 0.0)
            first = float(stored_energy(energy)[0])
            if self.stored is None:
                self.stored = first
            # the balance of a segment counts from its first instant, that of the session from t = 0
            energy["balance"] = energy["balance"] + (first - self.stored)
        converged, sentence = run.status(energy, self.stored)
        return Segment(
            assembly.time[: recorder.n_kept],
            run.windows,
            converged,
            True,
            sentence,
            energy,
            recorder.sensors(assembly),
            recorder.reactions(assembly),
            recorder.bolt_histories(),
            recorder,
        )

    def snapshot(self) -> bytes:
        """The state as bytes, with a version number."""
        return encode(self.get_state(), self._kind)

    def restore(self, blob: bytes) -> None:
        """Back to a snapshot of the same scene, taken by this or another instance.

        Raises
        ------
        InputError : bytes that are no such snapshot; the state is unchanged.
        """
        state = decode(blob, self._kind)
        if state is not None:
            self.settle(state["start"] or {})
            if self.run is None:  # not started yet: histories and a run must exist
                with one_thread():
                    self.begin(1, {})
        self.set_state(state)


# -- motions from outside: part of the state in the image --------------------------------------------------------------
def motion_size(assembly: Assembly) -> int:
    """Numbers that prescribed motions (u, v, a, elongations of each class) and the ground (u, a) go on from."""
    return sum(map(prod, map(_motions_of, assembly.propagators))) + 6 * len(assembly.ground.start)


def packed_motions(assembly: Assembly, instant: int) -> Array:
    """These numbers at an instant of the segment."""
    forcings = [p.forcing for p in assembly.propagators if _motions_of(p)[1]]
    ends = assembly.ground.end(instant)
    of_ground = [np.asarray(field) for i in assembly.ground.start for field in ends[i]]
    return np.concatenate([np.zeros(0), *(f.motion_table()[:, instant].ravel() for f in forcings), *of_ground])


def unpacked_motions(assembly: Assembly, state: Array) -> tuple[list[list[MotionState]], dict[int, GroundState]]:
    """Motions of the members by class, and the ground by interface; views of the numbers."""
    motions, at = list[list[MotionState]](), 0
    for n, k, m in map(_motions_of, assembly.propagators):
        u, v, a, *rest = state[at : at + n * k * m].reshape(n, k, m)
        elongations = np.reshape(rest, (n - STRAIN, k, m))
        motions.append([(u[:, j], a[:, j], v[:, j], elongations[:, :, j]) for j in range(m)])
        at += n * k * m
    grounds = enumerate(assembly.ground.start)
    return motions, {i: GroundState(*state[at + 6 * e : at + 6 * e + 6].reshape(2, 3)) for e, i in grounds}


def _motions_of(propagator: Propagator) -> tuple[int, int, int]:
    """Histories of a prescribed motion, prescribed motions of a member, and members."""
    histories = STRAIN + len(propagator.branches)
    return histories, propagator.members[0].imposed_pattern.shape[1], len(propagator.members)
