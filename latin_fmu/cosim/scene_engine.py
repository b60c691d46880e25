"""The engine of a scene: the image of its run, the table of its variables, and what is recorded of its steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from typing import Any, Final

import numpy as np

from ..errors import SolverError
from ..kernels import inputs
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import Array, InterfaceHistory
from ..machine import package_version
from ..scene.schema import Scene
from .communication import CommunicationRun
from .engine import STEP, Engine, set_numbers
from .handed_run import ABOUT_TO, HandedRun
from .loads import GivenLoads
from .output_table import AT_POINTS
from .parameters import TunableParameters
from .record import Record, WholeRecord, amplitudes_of
from .segments import Segment
from .settings import Settings
from .started_run import StartedRun
from .table_file import Identity, table_file
from .variable import Variable

_CHOICES: Final = {"mode": "mode", "inputInterpolation": "interpolation"}


class SceneEngine:
    """The engine of a scene, made when it is first needed, and anew where the initial state depends on other values.

    Parameters
    ----------
    scene : with names for its interfaces, as it is solved. settings : of the session. table : its variables. identity :
        digest of the scene and the settings.

    Attributes
    ----------
    engine : None before it is needed. parameters : that may change between steps.
    """

    def __init__(self, scene: Scene, settings: Settings, table: Sequence[Variable], identity: str) -> None:
        self._scene = scene
        self._settings = settings
        self._identity = identity
        starts: dict[str, Any] = {name: getattr(settings, of) for name, of in _CHOICES.items()}
        starts["endTime"] = scene.time.end
        self._table = [replace(v, start=starts[v.name]) if v.name in starts else v for v in table]
        self._started = StartedRun(scene, settings.tolerance)
        self.engine: Engine | None = None
        self._record: Record | None = None
        self._last_histories: dict[str, InterfaceHistory] = {}
        fixed = ""
        if settings.keep or settings.prescribed:
            fixed = "steps are kept with the numbers of the scene"
        self.parameters = TunableParameters(self._table, fixed)

    @property
    def run(self) -> CommunicationRun | None:
        """The run; None before it is needed."""
        return self._started.run

    def ready(self, starts: Mapping[str, float]) -> Engine:
        """The engine for these amplitudes of the inputs at the start."""
        before = self._started.run
        run = self._started.of(starts)
        if self.engine is None or run is not before:
            return self._build(run)
        return self.engine

    def _build(self, run: CommunicationRun) -> Engine:
        if self.engine is not None:
            self.engine.close()
        table = table_file(
            self._table, self._scene, run, Identity(f"{self._identity} {package_version()}", endless=True)
        )
        # of an assembly that is marched by its modes the outputs alone are kept
        records = (self._settings.keep or self._settings.prescribed) and run.problem.reduced is None
        if records and self._reads_fields:
            most = 1
        else:
            most = run.steps
        handed = HandedRun(run, table, self._notify if records else None, most, whole=True)
        self._last_histories = {}
        sizes = len(run.sources.inputs), int(run.image.run[0]["n_output"])
        self.engine = Engine(handed, *sizes, run.run.at_work if run.run.several else None)
        self.parameters.engine = self.engine
        self._record = None
        if records and self._settings.prescribed:
            self._record = WholeRecord(run)
        elif records:
            self._record = Record(run, self._settings.interpolation)
        return self.engine

    @property
    def _reads_fields(self) -> bool:
        """Whether fields of the bodies are recorded, which are read instant by instant."""
        assert self.run is not None
        output = self.run.problem.output
        return output.fields or output.stress or output.watch

    def close(self) -> None:
        """Free the engine."""
        if self.engine is not None:
            self.engine.close()
        self.engine = self._record = self.parameters.engine = None
        self._started.forget()

    # -- steps ----------------------------------------------------------------------------------------------------
    def initialize(self, loads: GivenLoads, t0: float) -> Engine:
        """Begin a simulation with these loads at t0, s; in prescribed mode solve it.

        Raises
        ------
        SceneError : the scene cannot be built. SolverError : inputs that cannot be used, no convergence.
        """
        starts = loads.starts()
        engine = self.ready(starts)
        try:
            self._initialize(engine, loads, t0)
        except SolverError:
            # the initial state may be none of the values that it was not built for
            if self._started.starts == starts:
                raise
            engine = self._build(self._started.made_for(starts))
            self._initialize(engine, loads, t0)
        return engine

    def _initialize(self, engine: Engine, loads: GivenLoads, t0: float) -> None:
        assert self.run is not None
        histories, names = dict[int, tuple[Array, Array]](), self.run.sources.inputs
        if self._settings.prescribed:
            histories = {names.index(name): history for name, history in loads.histories.items()}
        engine.initialize(t0, loads.table, histories, self.parameters.by_reference())

    def begin_step(self) -> None:
        """Before a communication step that is recorded."""
        if self._record is not None and not self._settings.prescribed:
            self._record.begin()

    def restore(self, state: bytes, loads: GivenLoads) -> Engine:
        """Restore a state, and the loads that were set then.

        Raises
        ------
        InputError : bytes that are no state of this scene and these settings; nothing changes. SolverError : histories
            of prescribed mode that do not converge.
        """
        if self.engine is None:
            engine = self.ready(loads.starts())
        else:
            engine = self.engine
        engine.restore(state)
        now, first = engine.inputs()
        start = GivenLoads(self._scene)
        start.take(first, first, engine.histories())
        starts = start.starts()
        if engine.phase == STEP and self.ready(starts) is not engine:  # it was made for another start
            assert self.engine is not None
            engine = self.engine
            engine.restore(state)
        loads.take(now, first, engine.histories())
        self.parameters.take_over(engine)
        return engine

    def snapshot(self, loads: GivenLoads, started: bool) -> bytes:
        """The state of the engine, of a simulation that has not ``started`` that before its start."""
        engine = self.engine
        if engine is None or not started:
            engine = self.ready(loads.starts())
            set_numbers(engine, self.parameters.by_reference())
        return engine.snapshot(loads.table)

    def _notify(self, what: int, steps: int, n: int, whole: int) -> None:
        """Called by the engine before (ABOUT_TO) and after it has called the kernels."""
        if self._record is None:
            return
        if what == ABOUT_TO:
            if steps == 0 and isinstance(self._record, WholeRecord):
                assert self.run is not None
                assert self.engine is not None
                first, histories = self.engine.inputs()[1], self.engine.histories()
                self._record.open(amplitudes_of(self.run, first, histories, self._scene.time.n_step))
            self._record.about_to(steps, whole)
        else:
            with np.errstate(all="ignore"):
                self._record.have_made(n)

    def rates(self, loads: GivenLoads) -> dict[str, float]:
        """Rates over the next step, 1/s: those set; under the rule CAUSAL of a load that never had one, and is no wave,
        that of the causal line."""
        assert self.run is not None
        image, names = self.run.image, self.run.sources.inputs
        rates, table = np.zeros(len(names)), loads.table.T.copy()
        memory = image.field("inputs", inputs.N_MEMORY, len(names)).reshape(-1)
        span, kinds = float(image.field("progress", 9)[3]), np.array(self.run.sources.kinds, dtype=np.int64)
        inputs.rates(table[0], table[1], memory, kinds, span, self._settings.interpolation, rates)
        return dict(zip(names, rates.tolist(), strict=True))

    # -- what was made --------------------------------------------------------------------------------------------
    @property
    def segments(self) -> list[Segment]:
        """What was recorded of the last step; in prescribed mode of the whole interval."""
        if isinstance(self._record, WholeRecord):
            whole = self._record.segment()
            if whole is None:
                return []
            return [whole]
        if self._record is None:
            return []
        return self._record.segments

    def window(self) -> tuple[Array, dict[str, InterfaceHistory]]:
        """Instants (n,) of the last step, s since the start, and histories of the interfaces over them."""
        if self.engine is None:
            return np.zeros(0), {}
        times, rows = self.engine.window()
        histories = dict[str, InterfaceHistory]()
        at = 0
        n = len(times)
        for name, history in self._geometries().items():
            fields = dict[str, Any]()
            for what, (_, _, shape) in AT_POINTS.items():
                if len(shape) > 1 or history.gap is not None:
                    sizes = [k or len(history.areas) for k in shape]
                    end = at + prod(sizes)
                    fields[what], at = np.ascontiguousarray(rows[:, at:end]).reshape(n, *sizes), end
            if "status" in fields:
                fields["contact_status"] = fields.pop("status").astype(np.int8)
            histories[name] = replace(history, **fields)
        return times, histories

    def _geometries(self) -> dict[str, InterfaceHistory]:
        """A history of each interface, for all but its fields."""
        if not self._last_histories:
            assert self.run is not None
            assembly = self.run.problem.marched
            rows = InterfaceRows(assembly, np.zeros((1, InterfaceRows.width_of(assembly))))
            self._last_histories = rows.histories(1, self.run.problem.output.peak_duration)
        return self._last_histories
