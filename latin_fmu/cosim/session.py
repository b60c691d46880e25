"""A session: one scene taken through a simulation by communication steps; its results and their estimated errors.

session = Session(scene)                              # windowed mode
session.set_load("press", value=0.3, rate=1e5)
session.initialize()
report = session.step(0.0, 1e-6)
force = session.value("interface.crush.force[3]")
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence

import numpy as np
import xarray as xr

from ..arithmetic import computable
from ..assembly.interfaces import completed
from ..errors import InputError, Problem
from ..latin.outcome import Array, InterfaceHistory
from ..machine import provenance
from ..results.dataset import datatree, result_groups, root_group
from ..results.estimates import ErrorEstimate
from ..results.groups import SCHEMA_VERSION, in_units, unit_attributes
from ..results.quantities import AXES
from ..results.solution import Solution
from ..scene.laws import TableLaw
from ..scene.schema import Scene
from ..scene.units import SI, UnitSystem
from .engine import DISCARD, STEP, WARNING
from .input_table import with_laws
from .loads import Curve, GivenLoads
from .scene_engine import SceneEngine
from .segments import Segment
from .settings import Settings, StepReport, refused
from .step_history import AcceptedStep, StepHistory, curves_of, joined
from .variable import Variable, input_of
from .variables import scalar_table

_COMPONENT = re.compile(r"(.+)\[(\d)\]")
_MAGIC = b"LATINSES"


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
        if settings is None:
            self.settings = Settings()
        else:
            self.settings = settings
        scene = completed(self.settings.with_values(scene))  # variables are named after interfaces
        self.scene = self.settings.applied(scene)
        self.table = scalar_table(scene)
        self.outputs = tuple(v.name for v in self.table if v.causality == "output")
        self._index = {name: i for i, name in enumerate(self.outputs)}
        self._of_solver = self._index["solver.iterations"]  # the indicator follows
        self._loads = GivenLoads(scene)
        # what snapshots must agree in: the scene as it is solved, and what was chosen
        identity = hashlib.sha256((self.scene.text() + repr(self.settings.choices())).encode()).hexdigest()
        self._solver = SceneEngine(self.scene, self.settings, self.table, identity)
        self.parameters = self._solver.parameters
        self.step_history = StepHistory()
        self.reset()

    def reset(self) -> None:
        """Return to before ``initialize``: loads and parameters at their start values, no histories. Operators are
        kept."""
        self.time = 0.0
        self._t0 = 0.0
        self.started = False
        self._loads.reset()
        self.parameters.reset()
        self.row: Array = np.zeros(len(self.outputs))
        self.step_history.clear()

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
        InputError : the scene cannot be built, an input is not finite, a choice is none. SolverError : prescribed mode,
            no convergence; a matrix is singular, numbers overflow.
        """
        self.started = False
        self._loads.begin()
        with computable():
            engine = self._solver.initialize(self._loads, float(t0))
        self.row, self._t0, self.time, self.started = engine.row, float(t0), float(t0), True

    def step(self, t: float, h: float, early: bool = False) -> StepReport:
        """Advance from t by h, s, with the loads set before. A step that is refused changes nothing; one below 1e-9 of
        the time step, or below the last digit of t, moves the clock alone.

        early : end the step with the first time step in which there is a contact event (``cosim.output_table``).
        """
        engine = self._solver.engine
        if engine is None or not self.started:
            return refused("the session is not initialized")
        keeps = self.settings.keep
        # before the step, which accepts what they follow from
        rates = {}
        if keeps:
            rates = self._solver.rates(self._loads)
            self._solver.begin_step()
        status, message, end, n = engine.step(float(t), float(h), early, self._loads.table)
        if status > WARNING:
            return refused(message, again=status == DISCARD)
        self.time, self.row = end, engine.row
        if keeps and n >= 0:
            segments = tuple(self._solver.segments)
            if self.settings.prescribed:
                segments = ()
            self.step_history.append(AcceptedStep(t, end, self.row, dict(self._loads.value), rates, segments))
        if n < 1:
            return StepReport(True)
        iterations, indicator = self.row[self._of_solver : self._of_solver + 2].tolist()
        return StepReport(True, "", n, int(iterations), indicator, early=None if end == t + h else end)

    def derivative(self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]) -> Array:
        """Directional derivative (n_unknown,) of outputs at the end of the last step by inputs over it: the sum over
        ``knowns`` (``load.NAME.value``, ``load.NAME.rate``, ...) of d unknown / d known times ``seed``.

        Exact, for the solution at hand, while a small change of the inputs changes the contact state of no point; it
        makes the step anew, three or six times for each input, up to twelve after a stall. Windowed mode.

        Raises
        ------
        InputError : other variables, prescribed mode, no step so far. SolverError : no unique derivative.
        """
        places = {variable.name: i for i, variable in enumerate(self.table)}
        if bad := [Problem(name, "no variable of this name") for name in (*unknowns, *knowns) if name not in places]:
            raise InputError(bad, "these derivatives are not available")
        engine = self._solver.engine
        if engine is None or not self.started:
            raise InputError([Problem("directional derivative", "not available before initialization")])
        return engine.derivative([places[name] for name in unknowns], [places[name] for name in knowns], seed)

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
        if self.started:
            time, histories = self._solver.window()
        else:
            time, histories = np.zeros(0), {}
        return self._t0 + time, histories

    def instant(self) -> tuple[int, int]:
        """Index of the present instant in ``window``, and number of instants there."""
        engine = self._solver.engine
        if engine is None or not self.started:
            return (-1, 0)
        return engine.instant()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks about the scene, known after ``initialize``."""
        if self._solver.run is None:
            return ()
        return self._solver.run.problem.warnings

    def estimate_error(self) -> ErrorEstimate:
        """Estimated relative error of every quantity of the steps kept (prescribed mode: of the whole interval).

        It needs coarser runs of the same interval and takes as long as these. Raises InputError as ``dataset``.
        """
        _check_kept(self.settings)
        curves = self._loads.curves(self.scene.time.end)
        return estimated_error(self.scene, self.settings, list(self.step_history), self._solver, curves, self._t0)

    def dataset(self, estimate: bool = False) -> xr.DataTree:
        """Accepted steps as a DataTree: groups of a run, and ``exchange`` with inputs and outputs by step.

        estimate : add group ``accuracy`` with the estimated errors.

        Raises InputError in windowed mode without ``Settings.keep``.
        """
        _check_kept(self.settings)
        tree = result_tree(self.scene, self.settings, self.table, list(self.step_history), self._solver)
        if estimate:
            tree["/accuracy"] = xr.DataTree(self.estimate_error().group(self.scene.unit_system).dataset())
        return tree

    def close(self) -> None:
        """Free the operators and the history; the session cannot be used after this."""
        self.step_history.clear()
        self._solver.close()
        self.started = False

    # -- state ----------------------------------------------------------------------------------------------------
    def snapshot(self) -> bytes:
        """Everything that determines the next steps and the outputs, as bytes, bit for bit."""
        with computable():
            state = self._solver.snapshot(self._loads, self.started)
        return _MAGIC + self.step_history.identity.encode().ljust(32) + state

    def restore(self, blob: bytes, check: bool = True) -> None:
        """Restore a snapshot of this or another session of the same scene and settings; ``check`` has no effect: what
        cannot be is always refused.

        Raises
        ------
        InputError : bytes that are no such snapshot; nothing changes. SolverError : in prescribed mode, where these
        histories are solved anew and do not converge.
        """
        del check
        n = len(_MAGIC)
        # what is no state is refused by the engine
        if blob[:n] == _MAGIC:
            state = blob[n + 32 :]
        else:
            state = blob
        identity = blob[n : n + 32].decode(errors="replace").strip()
        with computable():
            engine = self._solver.restore(state, self._loads)
        self.time, self._t0 = engine.times()
        self.row, self.started = engine.row, engine.phase == STEP
        self.step_history.move_to(identity)


def _check_kept(settings: Settings) -> None:
    if not (settings.keep or settings.prescribed):
        what, remedy = "the accepted steps are not stored", "create the session with Settings(keep=True)"
        raise InputError([Problem("Settings.keep", what, "False", None, remedy)], "the session has no history")


def result_tree(
    scene: Scene, settings: Settings, table: Sequence[Variable], steps: Sequence[AcceptedStep], solver: SceneEngine
) -> xr.DataTree:
    """Results of the accepted steps; group ``exchange`` holds inputs and outputs at the communication points kept."""
    segments = _segments(settings, solver, steps)
    if solver.run is None or not segments:
        tree = xr.DataTree(name=scene.name)
        tree.attrs = {**provenance(), "scene_name": scene.name, "schema_version": SCHEMA_VERSION}
        tree.attrs.update(unit_attributes(scene.unit_system))
    else:
        problem = solver.run.problem
        outcome = joined(segments, solver.run.run.timings, problem.warnings)
        groups = {"/": root_group(outcome, scene.name, scene.text(), provenance())}
        groups |= result_groups(outcome, problem.recovered, scene.sensor, surfaces=scene.output.surfaces)
        tree = datatree(in_units(groups, scene.unit_system), scene.name)
    if steps or not settings.prescribed:
        tree["/exchange"] = xr.DataTree(exchange_dataset(table, steps, scene.unit_system))
    return tree


def _segments(settings: Settings, solver: SceneEngine, steps: Sequence[AcceptedStep]) -> list[Segment]:
    if settings.prescribed:
        return solver.segments
    return [segment for step in steps for segment in step.segments]


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
        if match:
            three = [places.get(f"{match[1]}[{k}]", -1) for k in (1, 2, 3)]
        else:
            three = [-1]
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
    if variable.unit is None:
        return meaning
    return {"units": units.label(variable.unit), **meaning}


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("[", "_").removesuffix("]")


def estimated_error(
    scene: Scene,
    settings: Settings,
    steps: Sequence[AcceptedStep],
    solver: SceneEngine,
    curves: dict[str, Curve],
    t0: float,
) -> ErrorEstimate:
    """Estimated relative error of every quantity of the solved interval.

    The loads set from outside become tables, jumps at communication points included; the coarser runs then are runs of
    a plain scene (see ``estimate_error``).

    curves : loads when the session was initialized at ``t0``, s: histories, else constants.
    """
    from ..accuracy.estimate import estimate_error

    if solver.run is None:
        return _no_estimate("nothing was solved")
    if solver.run.problem.reduced is not None:
        return _no_estimate("of an assembly that is marched by its modes no histories are kept")
    segments = _segments(settings, solver, steps)
    if not settings.prescribed:
        if not segments or steps[0].start != t0:
            return _no_estimate(
                "the steps from the start on are not known: nothing was solved, or a state was restored"
            )
        curves = curves_of(steps, settings.interpolation, curves)
    plain = _plain_scene(scene, settings, curves, segments)
    solved = Solution(joined(segments, solver.run.run.timings, solver.run.problem.warnings), plain.text(), plain.name)
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
