"""The engine of a scene: the image of its run, the table of its variables, and what is recorded of its steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from typing import Any, Final

import numpy as np

from ..assembly.segments import Segment
from ..errors import SolverError
from ..kernels import inputs
from ..kernels.communication import FREE
from ..latin.interface_rows import InterfaceRows
from ..latin.outcome import Array, InterfaceHistory
from ..machine import package_version
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .communication import CommunicationRun
from .engine import ABOUT_TO, STEP, Engine, Step
from .input_table import with_laws
from .loads import GivenLoads
from .output_table import AT_POINTS
from .record import Record, WholeRecord, amplitudes_of
from .settings import Settings
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
    engine, run : None before they are needed.
    """

    def __init__(self, scene: Scene, settings: Settings, table: Sequence[Variable], identity: str) -> None:
        self._scene, self._settings, self._identity = scene, settings, identity
        starts: dict[str, Any] = {name: getattr(settings, of) for name, of in _CHOICES.items()}
        starts["endTime"] = scene.time.end
        self._table = [replace(v, start=starts[v.name]) if v.name in starts else v for v in table]
        self.engine: Engine | None = None
        self.run: CommunicationRun | None = None
        self._built: dict[str, float] = {}
        self._record: Record | None = None
        self._known: dict[str, InterfaceHistory] = {}

    def ready(self, starts: Mapping[str, float]) -> Engine:
        """The engine for these amplitudes of the inputs at the start."""
        if self.engine is None or any(starts[name] != self._built[name] for name in self._held):
            return self._build(starts)
        return self.engine

    @property
    def _held(self) -> list[str]:
        """Inputs whose amplitude at the start the image holds for alone."""
        assert self.run is not None
        image, names = self.run.image, self.run.sources.inputs
        at = image.run_fields["input_held"]
        held = image.fixed[at : at + len(names)].view(np.int64)
        return [name for name, kind in zip(names, held.tolist(), strict=True) if kind != FREE]

    def _build(self, starts: Mapping[str, float]) -> Engine:
        self.close()
        laws = {name: InputLaw(start_value=value) for name, value in starts.items()}
        scene = with_laws(self._scene, laws) if laws else self._scene
        self.run = CommunicationRun(scene, self._settings.tolerance, python=True)
        identity = Identity(f"{self._identity} {package_version()}", endless=True)
        table = table_file(self._table, self._scene, self.run, identity)
        most = 1 if self._settings.keep and self._reads_fields else self.run.steps
        self._built, self._known = dict(starts), {}
        self.engine = Engine(self.run, table, self._tell, most)
        if self._settings.prescribed:
            self._record = WholeRecord(self.run)
        elif self._settings.keep:
            self._record = Record(self.run, self._settings.interpolation)
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
        self.engine = self.run = self._record = None

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
            if self._built == starts:
                raise
            engine = self._build(starts)
            self._initialize(engine, loads, t0)
        return engine

    def _initialize(self, engine: Engine, loads: GivenLoads, t0: float) -> None:
        assert self.run is not None
        histories, names = dict[int, tuple[Array, Array]](), self.run.sources.inputs
        if self._settings.prescribed:
            histories = {names.index(name): history for name, history in loads.histories.items()}
        with self.run.run.at_work():
            engine.initialize(t0, loads.given(), histories)

    def step(self, t: float, h: float, early: bool, given: Array) -> Step:
        """Make a communication step, see ``Engine.step``."""
        assert self.engine is not None
        assert self.run is not None
        if self._record is not None and not self._settings.prescribed:
            self._record.begin()
        if not self.run.run.several:
            return self.engine.step(t, h, early, given)
        with self.run.run.at_work():
            return self.engine.step(t, h, early, given)

    def restore(self, state: bytes, loads: GivenLoads) -> Engine:
        """Restore a state, and the loads that were set then.

        Raises
        ------
        InputError : bytes that are no state of this scene and these settings; nothing changes. SolverError : histories
            of prescribed mode that do not converge.
        """
        engine = self.ready(loads.starts()) if self.engine is None else self.engine
        self._restore(engine, state)
        given, first = engine.inputs()
        known = GivenLoads(self._scene)
        known.take(first, first, engine.histories())
        starts = known.starts()
        if engine.phase == STEP and self.ready(starts) is not engine:  # it was made for another start
            assert self.engine is not None
            engine = self.engine
            self._restore(engine, state)
        loads.take(given, first, engine.histories())
        return engine

    def _restore(self, engine: Engine, state: bytes) -> None:
        assert self.run is not None
        with self.run.run.at_work():
            engine.restore(state)

    def _tell(self, what: int, made: int, n: int, whole: int) -> None:
        """Called by the engine before (ABOUT_TO) and after it has called the kernels."""
        if what == ABOUT_TO:
            self._tabulate(made, n)
        if self._record is None:
            return
        if what == ABOUT_TO:
            if made == 0 and isinstance(self._record, WholeRecord):
                assert self.run is not None
                assert self.engine is not None
                first, histories = self.engine.inputs()[1], self.engine.histories()
                self._record.open(amplitudes_of(self.run, first, histories, self._scene.time.n_step))
            self._record.about_to(made, whole)
        else:
            with np.errstate(all="ignore"):
                self._record.have_made(n)

    def _tabulate(self, made: int, n: int) -> None:
        """Let the table of the laws of the scene hold the next n time steps, beyond the end of the scene too."""
        assert self.run is not None
        sources, image = self.run.sources, self.run.image
        first, end = int(image.run[0]["law_first"]), sources.end
        if end < 0 or first <= made <= first + end - n:
            return
        # the table of the scene where it reaches, else one that begins here
        first = 0 if made + n <= end else made
        instants = self.run.drives.dt * np.arange(first, first + end + 1.0)
        table = sources.table if first == 0 else sources.own(self._scene, instants)
        at = image.run_fields["law_table"]
        image.fixed[at : at + table.size] = table.ravel()
        image.set({"law_first": first})

    def rates(self, loads: GivenLoads) -> dict[str, float]:
        """Rates over the next step, 1/s: those set; under the rule CAUSAL of a load that never had one, and is no wave,
        that of the causal line."""
        assert self.run is not None
        image, names = self.run.image, self.run.sources.inputs
        rates, given = np.zeros(len(names)), loads.given().T.copy()
        memory = image.field("inputs", inputs.N_MEMORY, len(names)).reshape(-1)
        span, kinds = float(image.field("progress", 9)[3]), np.array(self.run.sources.kinds, dtype=np.int64)
        inputs.rates(given[0], given[1], memory, kinds, span, self._settings.interpolation, rates)
        return dict(zip(names, rates.tolist(), strict=True))

    # -- what was made --------------------------------------------------------------------------------------------
    @property
    def segments(self) -> list[Segment]:
        """What was recorded of the last step; in prescribed mode of the whole interval."""
        if isinstance(self._record, WholeRecord):
            whole = self._record.segment()
            return [] if whole is None else [whole]
        return [] if self._record is None else self._record.segments

    def window(self) -> tuple[Array, dict[str, InterfaceHistory]]:
        """Instants (n,) of the last step, s since the start, and histories of the interfaces over them."""
        if self.engine is None:
            return np.zeros(0), {}
        times, rows = self.engine.window()
        histories, at, n = dict[str, InterfaceHistory](), 0, len(times)
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
        if not self._known:
            assert self.run is not None
            assembly = self.run.problem.assembly
            rows = InterfaceRows(assembly, np.zeros((1, InterfaceRows.width_of(assembly))))
            self._known = rows.histories(1, self.run.problem.output.peak_duration)
        return self._known
