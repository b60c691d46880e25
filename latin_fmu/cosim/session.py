"""A session: one scene taken through a simulation by communication steps.

session = Session(scene)                              # windowed mode
session.set_load("press", value=0.3, rate=1e5)
session.initialize()
report = session.step(0.0, 1e-6)
force = session.value("interface.crush.force[3]")
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from ..assembly.interfaces import completed
from ..errors import InputError, LatinError, Problem
from ..latin.record import Array, InterfaceHistory
from ..latin.state_serialization import decode, encode
from ..results.estimates import ErrorEstimate
from ..scene.schema import Scene
from .loads import Curve, Loads
from .modes import Prescribed, Windowed
from .settings import Settings, StepReport, refused, why_not
from .step_history import AcceptedStep, Chain
from .variables import PRESCRIBED, scalar_table


class Session:
    """A scene in a co-simulation.

    Parameters
    ----------
    scene : loads with the law ``input`` are set here, the others keep their law; its time counts from the start of
        the simulation.
    settings : mode and choices, see ``Settings``.

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
        self._kind = hashlib.sha256((self.scene.text() + repr(self.settings.choices())).encode()).hexdigest()
        self._engine: Windowed | Prescribed | None = None
        self.chain = Chain()
        self.reset()

    def reset(self) -> None:
        """Back to before ``initialize``; loads at their start values, no histories. Operators are kept."""
        self.time, self._t0, self.started = 0.0, 0.0, False
        self._loads.reset()
        self.row: Array = np.zeros(len(self.outputs))
        self.chain.clear()
        if self._engine is not None:
            self._engine.reset()

    @property
    def prescribed(self) -> bool:
        """Whether the mode is prescribed."""
        return self.settings.mode == PRESCRIBED

    # -- inputs ---------------------------------------------------------------------------------------------------
    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads set from outside."""
        return self._loads.names

    def set_load(self, name: str, value: float, rate: float = 0.0) -> None:
        """Amplitude of a load at the start of the next step and its rate (1/s) over it.

        Raises InputError for a load that is not set from outside.
        """
        self._loads.set(name, value, rate)

    def load(self, name: str) -> tuple[float, float]:
        """Value and rate that were set."""
        return self._loads.get(name)

    def set_history(self, name: str, times: Sequence[float] | Array, values: Sequence[float] | Array) -> None:
        """History of a load for prescribed mode: linear between its points, held at both ends.

        Raises InputError for a load that is not set from outside, numbers that are not finite, times that do not
        increase.
        """
        self._loads.set_history(name, times, values)

    # -- run ------------------------------------------------------------------------------------------------------
    def initialize(self, t0: float = 0.0) -> None:
        """Build the scene; in prescribed mode also solve it. ``t0`` is the present time of the simulation, s.

        Raises
        ------
        InputError : the scene cannot be built, an input is no number. SolverError : prescribed mode, no convergence.
        """
        bad = self._loads.not_finite()
        if bad or not math.isfinite(t0):
            raise InputError([Problem(bad or "start time", "is not a finite number")], "the session cannot start")
        engine = self._built()
        engine.start(self._loads)
        self.row = engine.row
        self._t0 = self.time = float(t0)
        self._loads.begin()
        self.started = True

    def _built(self) -> Windowed | Prescribed:
        if self._engine is None:
            self._engine = (Prescribed if self.prescribed else Windowed)(self.scene, self.settings)
        return self._engine

    def step(self, t: float, h: float) -> StepReport:
        """Go on from t by h, s, with the loads set before. A step that is refused changes nothing."""
        engine = self._engine
        if engine is None or not self.started:
            return refused("the session is not initialized")
        bad = self._loads.not_finite()
        trouble = f"{bad} is not a finite number" if bad else why_not(t, h, self.time, self._time_step)
        if trouble:
            return refused(trouble)
        try:
            report = engine.step(self._loads, t, h, self._t0)
        except LatinError as error:
            return refused(str(error))
        if report.accepted:
            self.time, self.row = t + h, engine.row
            if self.settings.keep:
                self._keep(t, h, engine)
        return report

    def _keep(self, t: float, h: float, engine: Windowed | Prescribed) -> None:
        segment = engine.segment if isinstance(engine, Windowed) else None
        value, rate = dict(self._loads.value), dict(self._loads.rate)
        self.chain.append(AcceptedStep(t, t + h, self.row, value, rate, segment))

    # -- outputs --------------------------------------------------------------------------------------------------
    def value(self, name: str) -> float:
        """A scalar output. Raises InputError for a name that is none."""
        return float(self.values([name])[0])

    def values(self, names: Sequence[str]) -> Array:
        """Scalar outputs (n,), read at once."""
        try:
            return self.row[[self._index[name] for name in names]]
        except KeyError as error:
            raise InputError([Problem(str(error.args[0]), "no output of this name")]) from None

    def window(self) -> tuple[Array, dict[str, InterfaceHistory]]:
        """Instants (n,), s, and interface histories of the last step (the whole interval in prescribed mode)."""
        if self._engine is None:
            return np.zeros(0), {}
        return self._t0 + self._engine.time, self._engine.interfaces

    def instant(self) -> int:
        """Index of the present instant in ``window``."""
        return -1 if self._engine is None else self._engine.instant(self.time - self._t0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks about the scene, known after ``initialize``."""
        run = None if self._engine is None else self._engine.run
        return () if run is None else run.problem.warnings

    def given_curves(self) -> dict[str, Curve]:
        """Loads set from outside when the session was initialized: histories, else constants."""
        return self._loads.curves(self.scene.time.end)

    def estimate_error(self) -> ErrorEstimate:
        """Estimated relative error of every quantity of the steps kept (prescribed mode: of the whole interval), from
        coarser runs of what was solved; takes as long as these."""
        from .session_results import session_error

        return session_error(self, self._engine)

    def dataset(self, estimate: bool = False) -> xr.DataTree:
        """Accepted steps as a DataTree: that of a run, and group ``exchange`` with inputs and outputs by step; where
        wanted group ``accuracy`` with the estimated errors."""
        from .session_results import session_tree

        tree = session_tree(self, self._engine)
        if estimate:
            tree["/accuracy"] = xr.DataTree(self.estimate_error().group().dataset())
        return tree

    # -- state ----------------------------------------------------------------------------------------------------
    def snapshot(self) -> bytes:
        """Everything that determines the next steps and the outputs, versioned, bit-exact."""
        engine = self._engine if self.started else None
        tree: dict[str, Any] = {
            "time": self.time,
            "t0": self._t0,
            "started": int(self.started),
            "row": self.row,
            "loads": self._loads.tree(),
            "last": self.chain.identity,
            "engine": None if engine is None else engine.tree(),
        }
        return encode(tree, self._kind)

    def restore(self, blob: bytes) -> None:
        """Back to a snapshot of this or another session of the same scene and settings.

        Raises
        ------
        InputError : no such bytes; nothing has changed. SolverError : in prescribed mode, a session that has not
        solved these histories solves them, and cannot.
        """
        tree = decode(blob, self._kind)
        loads = Loads(self.scene)
        loads.resume(tree["loads"])
        if tree["engine"] is not None:
            self._built().resume(tree["engine"], loads)
        self._loads = loads
        self.time, self._t0, self.started = tree["time"], tree["t0"], bool(tree["started"])
        self.row = tree["row"]
        self.chain.move_to(tree["last"])
