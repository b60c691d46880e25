"""One point of a study: the run, its quantities, and what a process keeps for the points that follow."""

from __future__ import annotations

import json
import time as clock
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from typing import Any, Final

import numpy as np

from .. import api
from ..accuracy.quantities import measure
from ..accuracy.runs import message_of
from ..assembly.kept_operators import KeptOperators
from ..errors import LatinError
from ..latin.record import Array, InterfaceHistory
from ..results.quantities_of_interest import (
    DISPLACEMENT,
    FORCE_HISTORY,
    QUANTITIES_OF_INTEREST,
    InterfaceFields,
    first_contact_time,
    largest_slip_share,
)
from ..results.solution import Solution
from ..scene.schema import Scene
from .first_guesses import FirstGuesses
from .grid import Grid, Index, Parameter

CONVERGED, NOT_CONVERGED, FAILED = 0, 1, 2
STATES: Final = ("converged", "not_converged", "failed")
"""States of a point, by number."""

Record = dict[str, Any]
"""A point as plain data: ``point``, ``state``, ``message``, and quantities by name: of the run a number, of its parts
numbers by name of the part; ``histories`` and their ``time``."""


@dataclass(frozen=True)
class Quantity:
    """A variable of a study: its dimension beside the parameters ("" for none), UDUNITS unit and long name."""

    name: str
    of: str
    unit: str
    long_name: str


_OF_INTERFACE: Final = tuple(
    Quantity(q.key, "interface", q.unit, q.long_name)
    for q in QUANTITIES_OF_INTEREST
    if q not in (DISPLACEMENT, FORCE_HISTORY)
)
QUANTITIES: Final = (
    *_OF_INTERFACE,
    Quantity("force_norm", "interface", "N s0.5", "L2 norm of the normal force over time"),
    Quantity("largest_slip", "interface", "m", "largest distance that the sides have slid along each other"),
    Quantity("slip_share", "interface", "1", "largest share of the area that slips at one instant"),
    Quantity("peak_displacement", "sensor", "m", "largest displacement of a sensor"),
    Quantity("peak_velocity", "sensor", "m s-1", "largest velocity of a sensor"),
    Quantity("peak_acceleration", "sensor", "m s-2", "largest acceleration of a sensor"),
    Quantity("peak_reaction", "boundary", "N", "largest force of a support on its body"),
    Quantity("bolt_force", "bolt", "N", "tension of a bolt at the end"),
    Quantity("largest_bolt_force", "bolt", "N", "largest tension of a bolt"),
    Quantity("energy", "energy_term", "J", "term of the energy balance at the end"),
    Quantity("penetration", "", "m", "largest penetration of all interfaces"),
    Quantity("iterations", "", "1", "iterations of all windows"),
    Quantity("passes", "", "1", "substructure-instants solved over substructures x instants"),
    Quantity("error_indicator", "", "1", "sqrt(eta) at the end of the windows, largest"),
    Quantity("cpu_set_up", "", "s", "CPU time of meshes, matrices, factors and tables"),
    Quantity("cpu", "", "s", "CPU time of the run"),
    Quantity("guessed", "", "1", "whether windows began with fields of neighbouring points"),
)
"""All quantities of a point; those a scene has none of are left out of its study."""


@dataclass(frozen=True)
class Plan:
    """What every process of a study has to know.

    Attributes
    ----------
    grid : scene and parameters. histories : whether to keep the resultants of the interfaces over time.
    guesses : whether windows of several instants begin with fields of neighbouring points.
    """

    grid: Grid
    histories: bool = False
    guesses: bool = True

    def text(self) -> str:
        """The plan as text, for other processes."""
        grid = self.grid
        vary = [[p.key, p.values] for p in grid.parameters]
        return json.dumps([grid.tables, grid.base_dir, vary, self.histories, self.guesses])

    @classmethod
    def of_text(cls, text: str) -> Plan:
        """The plan from its text."""
        tables, base_dir, vary, histories, guesses = json.loads(text)
        parameters = tuple(Parameter(key, tuple(values)) for key, values in vary)
        return cls(Grid(tables, base_dir, parameters), histories, guesses)


class PointSolver:
    """Solves points of a study one after the other in one process, and keeps what the next one can use.

    Attributes
    ----------
    kept : operators of the last point. guesses : fields of the last points.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.kept, self.guesses = plan, KeptOperators(), FirstGuesses()
        self._lock = Lock()  # a worker of a cluster may have several threads

    def solve(self, point: Index) -> Record:
        """The record of a point; whatever goes wrong in it is its message."""
        with self._lock:
            start = clock.process_time()
            try:
                record = self._solved(point)
            except LatinError as error:
                record = failed(message_of(error))
            except MemoryError:
                record = failed("the memory does not suffice")
            except Exception as error:  # a study outlives whatever one of its points does
                record = failed(f"{type(error).__name__}: {error}")
            if record["state"] == FAILED:
                self.kept = KeptOperators()
            return {**record, "point": list(point), "cpu": clock.process_time() - start}

    def _solved(self, point: Index) -> Record:
        grid, guesses = self.plan.grid, self.guesses
        scene = grid.scene(point)
        guesses.begin(point, grid.place(point))
        solution = api.solve(scene, kept=self.kept, fields=guesses if self.plan.guesses else None)
        guesses.end(solution.passes, solution.converged)
        state = CONVERGED if solution.converged else NOT_CONVERGED
        record = {"state": state, "message": solution.status, "guessed": float(guesses.used)}
        record |= quantities_of(scene, solution)
        return record | (histories_of(solution) if self.plan.histories else {})


def failed(message: str) -> Record:
    """The record of a point without results."""
    return {"state": FAILED, "message": message}


@lru_cache(maxsize=1)
def _solver(plan: str) -> PointSolver:
    """The solver of a process, which lives as long as points of its study come."""
    return PointSolver(Plan.of_text(plan))


def solve_point(plan: str, point: Index) -> Record:
    """Solve a point of a study in the process that calls it; ``plan`` as text."""
    return _solver(plan).solve(point)


def quantities_of(scene: Scene, solution: Solution) -> Record:
    """Quantities of a run by name; of its parts by name of the part, where it reached its end."""
    outcome = solution.outcome
    numbers = {
        "iterations": float(sum(window.iterations for window in solution.windows)),
        "passes": solution.passes,
        "error_indicator": solution.error_indicator,
        "cpu_set_up": solution.timings.setup,
    }
    if not solution.complete:
        return numbers
    values: dict[str, dict[str, float]] = {}
    time = outcome.interface_time
    for name, history in solution.interfaces.items():
        for key, value in _of_interface(scene, history, time, outcome.interfaces_every == 1).items():
            values.setdefault(key, {})[name] = value
    for name, sensor in solution.sensors.items():
        for key in ("displacement", "velocity", "acceleration"):
            motion = getattr(sensor, key)
            if motion is not None:
                values.setdefault(f"peak_{key}", {})[name] = _largest(motion)
    for name, reaction in solution.reactions.items():
        values.setdefault("peak_reaction", {})[name] = _largest(reaction.force)
    for name, bolt in solution.bolts.items():
        values.setdefault("bolt_force", {})[name] = float(bolt.force[-1])
        values.setdefault("largest_bolt_force", {})[name] = float(bolt.force.max())
    if solution.energy is not None:
        values["energy"] = {term: float(history[-1]) for term, history in solution.energy.items()}
    return {**values, **numbers, "penetration": outcome.penetration()}


def _of_interface(scene: Scene, history: InterfaceHistory, time: Array, whole: bool) -> dict[str, float]:
    """Quantities of one interface; times of a contact that never closes are left out, and slip unless its ``whole``
    history is kept."""
    measured = measure(time, {history.name: history}, scene.time.end).values
    values = {key.rpartition(".")[2]: value for key, value in measured.items()}
    values["force_norm"] = values.pop(FORCE_HISTORY.key)
    fields = InterfaceFields.of_history(history, time)
    if first_contact_time(fields) is None:
        values.pop("first_contact", None)
        values.pop("separation", None)
    if history.contact_status is not None:
        values["slip_share"] = largest_slip_share(fields) or 0.0
        values.setdefault("friction_work", 0.0)
    if history.contact_status is not None and whole:
        values["largest_slip"] = float(history.slip(time).max(initial=0.0))
    return values


def histories_of(solution: Solution) -> Record:
    """Resultants of the interfaces over time: force (n_time, 3) on side E and normal force (n_time,), N."""
    forces = {name: history.force() for name, history in solution.interfaces.items()}
    normal = {name: history.normal_resultant() for name, history in solution.interfaces.items()}
    return {"time": solution.outcome.interface_time, "histories": {"force": forces, "normal_force": normal}}


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
