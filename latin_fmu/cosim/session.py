"""A session: one scene taken through a simulation by communication steps; its results and their estimated errors.

session = Session(scene)                              # windowed mode
session.set_load("press", value=0.3, rate=1e5)
session.initialize()
report = session.step(0.0, 1e-6)
force = session.value("interface.crush.force[3]")
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from ..api import computable
from ..assembly.interfaces import completed
from ..assembly.segments import Segment
from ..errors import InputError, LatinError, Problem
from ..latin.outcome import Array, InterfaceHistory
from ..latin.state_serialization import check_like, decode, encode, unlike
from ..machine import provenance
from ..results.dataset import datatree, result_groups, root_group
from ..results.estimates import ErrorEstimate
from ..results.groups import SCHEMA_VERSION, in_units, unit_attributes
from ..results.quantities import AXES
from ..results.solution import Solution
from ..scene.laws import InputLaw, TableLaw
from ..scene.schema import Scene
from ..scene.units import SI, UnitSystem
from .derivatives import Derivatives
from .input_table import with_laws
from .loads import Curve, Loads
from .prescribed import Prescribed
from .settings import Settings, StepReport, is_round_off, refused, why_not
from .step_history import AcceptedStep, StepHistory, curves_of, joined
from .variable import Variable, input_of
from .variables import scalar_table
from .windowed import Windowed

_COMPONENT = re.compile(r"(.+)\[(\d)\]")


class Session:
    """A scene in a co-simulation.

    Parameters
    ----------
    scene : loads with the law ``input`` are set here, the others keep their law; its time counts from the start of
        the simulation.
    settings : mode and choices, see ``Settings``. No history of the steps is kept unless they say so.

    Raises
    ------
    InputError : a setting out of range.
    """

    def __init__(self, scene: Scene, settings: Settings | None = None) -> None:
        scene = completed(scene)  # variables are named after interfaces
        self.settings = Settings() if settings is None else settings
        self.scene = self.settings.applied(scene)
        self.table = scalar_table(scene)
        self.outputs = tuple(v.name for v in self.table if v.causality == "output")
        self._index = {name: i for i, name in enumerate(self.outputs)}
        self._loads = Loads(scene)
        self._time_step = self.settings.step_of(scene)
        # what snapshots must agree in: the scene as it is solved, and what was chosen
        self._kind = hashlib.sha256((self.scene.text() + repr(self.settings.choices())).encode()).hexdigest()
        self._mode: Windowed | Prescribed | None = None
        self._starts: dict[str, float] = {}
        self._derivatives: Derivatives | None = None  # about the last step for which some were computed
        self.step_history = StepHistory()
        self.reset()

    def reset(self) -> None:
        """Return to before ``initialize``: loads at their start values, no histories. Operators are kept."""
        self.time, self._t0, self.started = 0.0, 0.0, False
        self._loads.reset()
        self.row: Array = np.zeros(len(self.outputs))
        self.step_history.clear()
        if self._mode is not None:
            self._mode.reset()

    # -- inputs ---------------------------------------------------------------------------------------------------
    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads set from outside."""
        return self._loads.names

    def set_load(self, name: str, value: float, rate: float = 0.0) -> None:
        """Set the amplitude of a load at the start of the next step and its rate (1/s) over the step.

        Raises InputError for a load that is not set from outside.
        """
        self._loads.set(name, value, rate)

    def load(self, name: str) -> tuple[float, float]:
        """Value and rate of a load that were set."""
        return self._loads.get(name)

    def set_history(self, name: str, times: Sequence[float] | Array, values: Sequence[float] | Array) -> None:
        """Set the history of a load for prescribed mode: linear between its points, constant beyond them.

        Raises InputError for a load that is not set from outside, numbers that are not finite, times that do not
        increase.
        """
        self._loads.set_history(name, times, values)

    # -- run ------------------------------------------------------------------------------------------------------
    def initialize(self, t0: float = 0.0) -> None:
        """Build the scene; in prescribed mode also solve it. ``t0`` is the present time of the simulation, s.

        Raises
        ------
        InputError : the scene cannot be built, an input is not finite. SolverError : prescribed mode, no convergence;
            a matrix is singular, numbers overflow.
        """
        bad = self._loads.not_finite()
        if bad or not math.isfinite(t0):
            raise InputError([Problem(bad or "start time", "is not a finite number")], "the session cannot start")
        self._loads.begin()
        with computable():
            mode = self._prepared_mode(self._loads)
            mode.start(self._loads, float(t0))
        self.row = mode.row
        self._t0 = self.time = float(t0)
        self.started = True

    def _prepared_mode(self, loads: Loads) -> Windowed | Prescribed:
        """The mode, built for the displacements that the driven faces have at the start."""
        starts = loads.starts()
        # displacements at the start are part of the geometry of the problem: with others it is built anew
        if self._mode is None or starts != self._starts:
            laws = {name: InputLaw(start_value=value) for name, value in starts.items()}
            scene = with_laws(self.scene, laws) if laws else self.scene
            self._mode, self._starts = (
                (Prescribed if self.settings.prescribed else Windowed)(scene, self.settings),
                starts,
            )
        return self._mode

    def step(self, t: float, h: float, early: bool = False) -> StepReport:
        """Advance from t by h, s, with the loads set before. A step that is refused changes nothing; one below 1e-9 of
        the time step, or below the last digit of t, moves the clock alone.

        early : end the step with the first time step in which there is a contact event (``cosim.outputs``).
        """
        mode = self._mode
        if mode is None or not self.started:
            return refused("the session is not initialized")
        if trouble := why_not(t, h, self.time, self._time_step):
            return refused(trouble)
        if is_round_off(t, h, self._time_step):
            self.time = t + h
            return StepReport(True)
        if bad := self._loads.not_finite():
            return refused(f"{bad} is not a finite number", again=True)
        # before the step, which accepts what they follow from
        rates = self._loads.rates(self.settings.interpolation) if self.settings.keep else {}
        try:
            report = mode.step(self._loads, t, h, self._t0, early)
        except LatinError as error:
            return refused(str(error), again=True)
        if report.accepted:
            # t + h and not a sum of own steps: hosts compare it with theirs
            self.time, self.row = t + h if report.early is None else report.early, mode.row
            if self.settings.keep:
                segment = mode.segment if isinstance(mode, Windowed) else None
                self.step_history.append(AcceptedStep(t, self.time, self.row, dict(self._loads.value), rates, segment))
        return report

    def derivative(self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]) -> Array:
        """Directional derivative (n_unknown,) of outputs at the end of the last step by inputs over it: the sum over
        ``knowns`` (``load.NAME.value``, ``load.NAME.rate``, ...) of d unknown / d known times ``seed``.

        Exact, for the solution at hand, while a small change of the inputs changes the contact state of no point; it
        makes the step anew, three or six times for each input, up to twelve after a stall. Windowed mode.

        Raises
        ------
        InputError : other variables, prescribed mode, no step so far. SolverError : no unique derivative.
        """
        if not isinstance(self._mode, Windowed) or not self.started:
            what = "not available in prescribed mode, or before initialization"
            raise InputError([Problem("directional derivative", what, None, "mode = 0 (windowed)")])
        if self._derivatives is None or not self._derivatives.of(self._mode.last_step):
            self._derivatives = Derivatives(self._mode, self.outputs)
        return self._derivatives.product(unknowns, knowns, seed)

    # -- outputs --------------------------------------------------------------------------------------------------
    def value(self, name: str) -> float:
        """Value of a scalar output. Raises InputError where there is no output of this name."""
        return float(self.values([name])[0])

    def values(self, names: Sequence[str]) -> Array:
        """Scalar outputs (n,), read at once."""
        try:
            return self.row[[self._index[name] for name in names]]
        except KeyError as error:
            raise InputError([Problem(str(error.args[0]), "no output of this name")]) from None

    def window(self) -> tuple[Array, dict[str, InterfaceHistory]]:
        """Instants (n,), s, and interface histories of the last step (the whole interval in prescribed mode)."""
        if self._mode is None:
            return np.zeros(0), {}
        return self._t0 + self._mode.time, self._mode.interfaces

    def instant(self) -> tuple[int, int]:
        """Index of the present instant in ``window``, and number of instants there."""
        mode = self._mode
        return (-1, 0) if mode is None else (mode.instant(self.time - self._t0), mode.n_instant)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks about the scene, known after ``initialize``."""
        run = None if self._mode is None else self._mode.run
        return () if run is None else run.problem.warnings

    def estimate_error(self) -> ErrorEstimate:
        """Estimated relative error of every quantity of the steps kept (prescribed mode: of the whole interval).

        It needs coarser runs of the same interval and takes as long as these. Raises InputError as ``dataset``.
        """
        _check_kept(self.settings)
        given = self._loads.curves(self.scene.time.end)
        return estimated_error(self.scene, self.settings, list(self.step_history), self._mode, given, self._t0)

    def dataset(self, estimate: bool = False) -> xr.DataTree:
        """Accepted steps as a DataTree: groups of a run, and ``exchange`` with inputs and outputs by step.

        estimate : add group ``accuracy`` with the estimated errors.

        Raises InputError in windowed mode without ``Settings.keep``.
        """
        _check_kept(self.settings)
        tree = result_tree(self.scene, self.table, list(self.step_history), self._mode)
        if estimate:
            tree["/accuracy"] = xr.DataTree(self.estimate_error().group(self.scene.unit_system).dataset())
        return tree

    def close(self) -> None:
        """Free the operators and the history; the session cannot be used after this."""
        self.step_history.clear()
        self._mode = self._derivatives = None

    # -- state ----------------------------------------------------------------------------------------------------
    def snapshot(self) -> bytes:
        """Everything that determines the next steps and the outputs, as bytes, bit for bit."""
        mode = self._mode if self.started else None
        of_mode = None if mode is None else mode.get_state()
        state: dict[str, Any] = {
            "time": self.time,
            "t0": self._t0,
            "started": int(self.started),
            "row": self.row,
            "loads": self._loads.get_state(),
            "last": self.step_history.identity,
            "mode": of_mode,
        }
        return encode(state, self._kind)

    def restore(self, blob: bytes, check: bool = False) -> None:
        """Restore a snapshot of this or another session of the same scene and settings.

        check : it came from outside: compare sizes, kinds and ranges of its numbers with those here. A check that
        fails may leave the session changed: save it before, and restore it.

        Raises
        ------
        InputError : bytes that are no such snapshot; nothing changes. SolverError : in prescribed mode, where these
        histories are solved anew and do not converge.
        """
        state = decode(blob, self._kind)
        # new ones until everything has been checked
        loads = Loads(self.scene)
        if check:
            own = {"time": 0.0, "t0": 0.0, "started": 1, "row": self.row, "loads": None, "last": "", "mode": None}
            check_like(state, own, "state", free=("mode", "loads"))
            loads.check_state(state["loads"])
            if state["started"] != (state["mode"] is not None) or state["time"] < state["t0"]:
                raise unlike("state", "not started, or a time before the start")
        loads.set_state(state["loads"])
        if state["mode"] is not None:
            self._prepared_mode(loads).set_state(state["mode"], loads, check)
        self._loads = loads
        self.time, self._t0, self.started = state["time"], state["t0"], bool(state["started"])
        self.row = state["row"]
        self.step_history.move_to(state["last"])


def _check_kept(settings: Settings) -> None:
    if not (settings.keep or settings.prescribed):
        what, remedy = "the accepted steps are not kept", "make the session with Settings(keep=True)"
        raise InputError([Problem("Settings.keep", what, "False", None, remedy)], "the session has no history")


def result_tree(
    scene: Scene, table: Sequence[Variable], steps: Sequence[AcceptedStep], mode: Windowed | Prescribed | None
) -> xr.DataTree:
    """Results of the accepted steps; group ``exchange`` holds inputs and outputs at the communication points kept."""
    segments = [] if mode is None else _segments(mode, steps)
    if mode is None or mode.run is None or not segments:
        tree = xr.DataTree(name=scene.name)
        tree.attrs = {**provenance(), "scene_name": scene.name, "schema_version": SCHEMA_VERSION}
        tree.attrs.update(unit_attributes(scene.unit_system))
    else:
        problem = mode.run.problem
        outcome = joined(segments, mode.run.timings, problem.warnings)
        groups = {"/": root_group(outcome, scene.name, scene.text(), provenance())}
        groups |= result_groups(outcome, problem.recovered, scene.sensor, surfaces=scene.output.surfaces)
        tree = datatree(in_units(groups, scene.unit_system), scene.name)
    if steps or not isinstance(mode, Prescribed):
        tree["/exchange"] = xr.DataTree(exchange_dataset(table, steps, scene.unit_system))
    return tree


def _segments(mode: Windowed | Prescribed, steps: Sequence[AcceptedStep]) -> list[Segment]:
    segments = [mode.segment] if isinstance(mode, Prescribed) else [step.segment for step in steps]
    return [segment for segment in segments if segment is not None]


def exchange_dataset(table: Sequence[Variable], steps: Sequence[AcceptedStep], units: UnitSystem = SI) -> xr.Dataset:
    """Inputs (held at the start of a step) and outputs (at its end) by step, in ``units``; dots in names become
    underscores."""
    outputs = [v for v in table if v.causality == "output"]
    rows = np.array([step.row for step in steps]).reshape(len(steps), len(outputs))
    columns: dict[str, tuple[tuple[str, ...], Array, dict[str, str]]] = {
        "step_start": (("time",), np.array([s.start for s in steps]), {"units": "s", "long_name": "start of the step"})
    }
    for variable in table:
        if variable.causality == "input":
            name, what = input_of(variable.name)
            values = np.array([getattr(step, what)[name] for step in steps])
            columns[_plain(variable.name)] = (("time",), values, _attributes(variable, units))
    places = {variable.name: i for i, variable in enumerate(outputs)}
    for i, variable in enumerate(outputs):
        match = _COMPONENT.fullmatch(variable.name)
        three = [places.get(f"{match[1]}[{k}]", -1) for k in (1, 2, 3)] if match else [-1]
        if match is None or min(three) < 0:  # a port may have one or two components
            columns[_plain(variable.name)] = (("time",), rows[:, i], _attributes(variable, units))
        # the first of three components writes the vector
        elif match[2] == "1":
            attributes = _attributes(variable, units) | {"long_name": variable.description.removesuffix(", x")}
            columns[_plain(match[1])] = (("time", "component"), rows[:, three], attributes)
    time = np.array([step.end for step in steps])
    dataset = xr.Dataset(columns, coords={"time": time, "component": AXES})
    dataset["time"].attrs = {"units": "s", "long_name": "communication point, end of the step"}
    dataset["component"].attrs = {"long_name": "global axis"}
    return dataset


def _attributes(variable: Variable, units: UnitSystem) -> dict[str, str]:
    """netCDF attributes of a variable in the units of the scene."""
    meaning = {"long_name": variable.description}
    return meaning if variable.unit is None else {"units": units.label(variable.unit), **meaning}


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("[", "_").removesuffix("]")


def estimated_error(
    scene: Scene,
    settings: Settings,
    steps: Sequence[AcceptedStep],
    mode: Windowed | Prescribed | None,
    given: dict[str, Curve],
    t0: float,
) -> ErrorEstimate:
    """Estimated relative error of every quantity of the solved interval.

    The loads set from outside become tables, jumps at communication points included; the coarser runs then are runs of
    a plain scene (see ``estimate_error``).

    given : loads when the session was initialized at ``t0``, s: histories, else constants.
    """
    from ..accuracy.estimate import estimate_error

    if mode is None or mode.run is None:
        return _no_estimate("nothing was solved")
    segments = _segments(mode, steps)
    if isinstance(mode, Windowed):
        if not segments or steps[0].start != t0:
            return _no_estimate(
                "the steps from the start on are not known: nothing was solved, or a state was restored"
            )
        given = curves_of(steps, settings.interpolation, given)
    plain = _plain_scene(scene, settings, given, segments)
    solved = Solution(joined(segments, mode.run.timings, mode.run.problem.warnings), plain.text(), plain.name)
    return estimate_error(plain, solved)


def _plain_scene(scene: Scene, settings: Settings, curves: dict[str, Curve], segments: Sequence[Segment]) -> Scene:
    """The scene with the loads that were set, over the instants of segments from the start on."""
    from ..accuracy.runs import with_tolerance

    scene = with_laws(scene, {name: TableLaw(times=times, values=values) for name, (times, values) in curves.items()})
    n = sum(len(segment.time) - 1 for segment in segments)
    time = scene.time.model_copy(update={"end": float(segments[-1].time[-1]), "step": None, "instants": n})
    changes: dict[str, object] = {"time": time}
    if settings.tolerance is not None:
        changes["solver"] = with_tolerance(scene, settings.tolerance)
    return scene.model_copy(update=changes)


def _no_estimate(reason: str) -> ErrorEstimate:
    return ErrorEstimate((), (f"no estimate: {reason}",))
