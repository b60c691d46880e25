"""Price and influence of the effects of a scene: it is solved with one of them changed at a time.

An effect is what a user may leave out: friction, opening and slip of a contact, inertia and elasticity of a body,
bending modes, damping, bodies that are never touched, stored fields, sensors, spectra. So is every setting that
``effects.explanation`` suggests. Price: CPU time that a run takes less without the effect. Influence: distance of
forces and motions from those of the scene then (``changes``).

A change is suggested where it saves ``WORTH`` of the CPU time or more and changes the results by ``SMALL`` or less.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from .. import api
from ..effects.explanation import WORTH
from ..effects.scene_effects import scene_with
from ..errors import InputError, LatinError
from ..interface.laws import SEPARATION, SLIP
from ..latin.outcome import InterfaceHistory
from ..results.owner_records import Signal
from ..results.solution import Solution
from ..run_quantities import measure_solution
from ..scene.fields import split_face
from ..scene.materials import DAMPING_KEYS
from ..scene.quantity_table import ACCELERATION_PEAK
from ..scene.readable_numbers import aligned
from ..scene.schema import Scene, with_settings
from .runs import FEWEST_STEPS, Resolution, at_resolution, coarsens_mesh, mesh_factor, message_of

SMALL: Final = 0.01
"""Largest relative change of the results by a suggested change."""
LONG: Final = 60.0
"""CPU time of a run beyond which the effects are measured at half its resolution, s."""
MOST_RUNS: Final = 40.0
"""Where no limit is given the runs together take at most so many times the CPU time of one, and ``LEAST_LIMIT``."""
LEAST_LIMIT: Final = 20.0  # s
_ENOUGH: Final = 1.0  # CPU time of the rounds of a run that settle its time, s
LEAST_ROUNDS: Final = 3  # of a run
MOST_ROUNDS: Final = 8
_EACH: Final = 4  # interfaces or bodies that are switched one at a time, more are named; runs between two as written
_LIGHT: Final = 1e-3  # factor on the density of a body without inertia
GROUPS: Final = ("forces", "motions", "accelerations")
"""Kinds of results that are compared, see ``changes``."""

Tables = dict[str, Any]
Edit = Callable[[Tables], Tables | None]
"""Changes the tables of a scene, or gives others."""


@dataclass(frozen=True)
class Switch:
    """A change of a scene that takes an effect away.

    Attributes
    ----------
    effect : in words. what : what to write in the scene. edit : does so in its tables.
    """

    effect: str
    what: str
    edit: Edit

    def changed(self, scene: Scene) -> Scene:
        """The scene without the effect.

        Raises
        ------
        SceneError : it is none.
        """
        return scene_with(scene, self.edit)


@dataclass
class MeasuredEffect:
    """An effect and what was measured without it.

    Attributes
    ----------
    effect, what : as of ``Switch``. scene : without it. times : CPU time of each of its runs, s.
    changes : relative, of ``forces``, ``motions`` and ``accelerations``; without those that the scene does not have.
    remark : why nothing was measured.
    """

    effect: str
    what: str
    scene: Scene
    times: list[float] = field(default_factory=list)
    changes: dict[str, float] = field(default_factory=dict)
    remark: str = ""

    @property
    def cpu(self) -> float:
        """CPU time of a run, the least of all, s; NaN without one."""
        return min(self.times, default=math.nan)

    @property
    def scatter(self) -> float:
        """How far the runs differ: the mean of the CPU times over the least, less one."""
        return sum(self.times) / len(self.times) / self.cpu - 1.0

    def cells(self, plain: float) -> tuple[str, ...]:
        """A row of the table; ``plain`` : CPU time of the scene, s."""
        if self.remark:
            return (self.effect, *["-"] * (1 + len(GROUPS)), f"{self.what}: {self.remark}")
        changes = (f"{100 * self.changes[k]:.2g} %" if k in self.changes else "-" for k in GROUPS)
        return (self.effect, f"{100 * (1.0 - self.cpu / plain):+.0f} %", *changes, self.what)


@dataclass(frozen=True)
class MeasuredEffects:
    """Effects of a scene with price and influence.

    Attributes
    ----------
    description : of the runs. plain : the scene as written. effects : a row each. unmeasured : what was not, and why.
    limited : whether a limit of CPU time ended the measurement.
    """

    description: str
    plain: MeasuredEffect
    effects: list[MeasuredEffect]
    unmeasured: list[str]
    limited: bool = False

    @property
    def suggested(self) -> list[MeasuredEffect]:
        """Changes that save ``WORTH`` or more, beyond the scatter of runs, and whose influence is ``SMALL`` or less;
        cheapest first."""
        most = (1.0 - max(WORTH, self.plain.scatter)) * self.plain.cpu
        worth = [e for e in self.effects if e.cpu < most and max(e.changes.values(), default=math.inf) <= SMALL]
        return sorted(worth, key=lambda e: e.cpu)

    def report(self) -> dict[str, Any]:
        """Plain data for JSON."""
        suggested = self.suggested
        rows = [
            {
                "effect": e.effect,
                "change": e.what,
                "cpu_seconds": e.cpu if e.times else None,
                "saving": 1.0 - e.cpu / self.plain.cpu if e.times else None,
                "changes": e.changes,
                "suggested": e in suggested,
                "remark": e.remark,
            }
            for e in self.effects
        ]
        return {
            "description": f"measured {self.description}",
            "cpu_seconds": self.plain.cpu,
            "effects": rows,
            "unmeasured": self.unmeasured,
            "limited": self.limited,
        }

    def text(self) -> str:
        """Table of the effects, and the suggested changes."""
        rows = [e.cells(self.plain.cpu) for e in self.effects]
        table = aligned([("without", "saves", *GROUPS), *(row[:-1] for row in rows)])
        lines = [f"Effects measured, {self.description}: CPU time saved without each, change of the results"]
        lines += [f"{line}   {last}" for line, last in zip(table, ("by", *(row[-1] for row in rows)), strict=True)]
        lines += [f"  not measured: {text}" for text in self.unmeasured]
        found = [f"  * {e.what} (saves {100 * (1 - e.cpu / self.plain.cpu):.0f} %)" for e in self.suggested]
        lines.append(f"Saves {100 * WORTH:.0f} % or more, changes the results by {100 * SMALL:.0f} % or less:")
        return "\n".join([*lines, *(found or ["  nothing"])])


def measured_effects(
    scene: Scene,
    suggested: Sequence[tuple[str, ...]] = (),
    predicted: float = 0.0,
    limit: float | None = None,
    report: Callable[[float], None] = lambda _: None,
) -> MeasuredEffects:
    """Solve the scene with one of its effects changed at a time.

    Each run is made three to eight times, in turn with the others, until it has taken a second; its least CPU time
    counts.

    Parameters
    ----------
    suggested : settings to follow, as for ``--set``. predicted : CPU time of a run, s; a long one is measured at half
        the resolution. limit : CPU time of all runs together, s. report : called with the share of the work done.

    Raises
    ------
    LatinError : the scene cannot be built or solved.
    """
    begin, where = clock.process_time(), "at the resolution of the scene"
    if predicted > LONG:
        scene, where = _halved(scene), "at half the resolution of the scene"
    plain = MeasuredEffect("nothing", "", scene)
    solution = _timed(plain, limit)
    if not solution.converged:
        why = f"every effect: {solution.status}"
        return MeasuredEffects(where, plain, [], [why], bool(solution.interrupted))
    # from begin on: the run as written counts, too
    ends = begin + (MOST_RUNS * plain.cpu + LEAST_LIMIT if limit is None else limit)
    switches, unmeasured = _few([*_switches(scene, solution), *map(_followed, suggested)])
    rows, limited = [], False
    for i, switch in enumerate(switches):
        report((i + 1) / (LEAST_ROUNDS * (len(switches) + 1)))
        try:
            row = MeasuredEffect(switch.effect, switch.what, switch.changed(scene))
            limited = limited or clock.process_time() >= ends
            if limited:
                row.remark = "not run, the limit of CPU time is reached"
            else:
                _measure(row, plain.scene, solution, ends - clock.process_time())
        except InputError:
            continue  # the scene does not have the effect, or needs it
        except LatinError as error:
            row.remark = message_of(error)
        rows.append(row)
    _repeated(plain, rows, ends, report)
    report(1.0)
    steps = len(solution.time) - 1
    return MeasuredEffects(f"{where} ({steps} steps, {plain.cpu:.2g} s a run)", plain, rows, unmeasured, limited)


def _halved(scene: Scene) -> Scene:
    """The scene with half its elements along an edge and half its steps, and its output."""
    if coarsens_mesh(scene):
        mesh = mesh_factor(scene, 0.5)
    else:
        mesh = 1.0
    if scene.time.quasi_static or scene.time.n_step < 2 * FEWEST_STEPS:
        time = 1.0
    else:
        time = 0.5
    return at_resolution(scene, Resolution(mesh, time)).model_copy(update={"output": scene.output})


def _timed(row: MeasuredEffect, limit: float | None = None) -> Solution:
    """Solve the scene of a row, spectra of sensors included, and keep the CPU time."""
    start = clock.process_time()
    solution = api.solve(row.scene, max_cpu=limit)
    # computed at the first access: a part of the cost of sensors
    _ = solution.spectra
    row.times.append(clock.process_time() - start)
    return solution


def _measure(row: MeasuredEffect, scene: Scene, plain: Solution, limit: float) -> None:
    """Solve a scene without an effect, and compare with its solution as written."""
    other = _timed(row, limit)
    if other.converged:
        row.changes = changes(scene, plain, other)
    else:
        row.times, row.remark = [], other.status


def _repeated(
    plain: MeasuredEffect, rows: Sequence[MeasuredEffect], ends: float, report: Callable[[float], None]
) -> None:
    """Repeat runs in turn, as long as there is time until ``ends``: a machine with other work is slow for some seconds
    at a time. That of the scene as written comes after every few others: the savings of all are relative to it."""
    turns = [row for i, other in enumerate(rows) for row in ([plain, other] if i % _EACH == 0 else [other])]
    for count in range(1, MOST_ROUNDS):
        for i, row in enumerate(turns):
            # most scenes need no more than the least number of rounds: short runs, of which more are made, end soon
            report(min((count + i / len(turns)) / LEAST_ROUNDS, 0.99))
            wanted = bool(row.times) and (count < LEAST_ROUNDS or count * row.cpu < _ENOUGH)
            if wanted and clock.process_time() + row.cpu < ends:
                _timed(row)


def changes(scene: Scene, plain: Solution, other: Solution) -> dict[str, float]:
    """Relative changes of the results: ``forces``, the resultants of the interfaces over time; ``motions``, the
    displacements of their sides and of the sensors over time; ``accelerations``, the largest of the sensors, in a band
    that the mesh resolves.

    Each is the largest change, of a history its root mean square, over the largest value of its kind; what one of the
    solutions does not have is left out. ``scene`` : of ``plain``.
    """
    changes_by_group: dict[str, float] = {}
    for group, (one, two) in zip(GROUPS[:2], zip(_histories(plain), _histories(other), strict=True), strict=True):
        size = max((signal.root_mean_square() for signal in one.values()), default=0.0)
        apart = [one[name].distance(two[name]) / size for name in one if name in two and size > 0.0]
        if apart:
            changes_by_group |= {group: max(apart)}
    peaks, others = ({q: v for q, v in measure_solution(scene, s).values.items() if _peak(q)} for s in (plain, other))
    size = max(peaks.values(), default=0.0)
    apart = [abs(value - others[q]) / size for q, value in peaks.items() if q in others and size > 0.0]
    return changes_by_group | ({GROUPS[2]: max(apart)} if apart else {})


def _peak(quantity: str) -> bool:
    return quantity.endswith(f".{ACCELERATION_PEAK.key}")


def _histories(solution: Solution) -> tuple[dict[str, Signal], dict[str, Signal]]:
    """Resultants of the interfaces; displacements of their sides (mean) and of the sensors: by name."""
    time = solution.outcome.interface_time
    forces = {n: Signal(time, h.force()) for n, h in solution.interfaces.items()}
    motions = {f"sensor {n}": Signal(solution.time, h.displacement) for n, h in solution.sensors.items()}
    for name, history in solution.interfaces.items():
        mean = np.einsum("p,tspc->tsc", history.areas / history.areas.sum(), history.velocity).reshape(len(time), -1)
        moved = np.cumsum(np.diff(time)[:, None] * mean[1:], axis=0)
        motions[name] = Signal(time, np.concatenate([np.zeros((1, mean.shape[1])), moved]))
    return forces, motions


# -- what can be switched ---------------------------------------------------------------------------------------------
def _switches(scene: Scene, solution: Solution) -> Iterator[Switch]:
    """Changes of a scene, by the contacts in its run."""
    yield from _of_interfaces(scene, solution)
    yield from _of_bodies(scene, solution)
    lossy = {n: [k for k in DAMPING_KEYS if getattr(m, k)] for n, m in scene.material.items()}
    if keys := [f"material.{name}.{key}" for name, found in lossy.items() for key in found]:
        yield Switch("damping of materials", f"without {', '.join(keys)}", _without(*keys, "material.*.at_frequency"))
    if modal := [f"substructure.{n}.modal_damping" for n, b in scene.substructure.items() if b.modal_damping]:
        yield Switch("damping of modes", f"without {', '.join(modal)}", _without(*modal))
    if not scene.time.quasi_static:
        yield _set("waves above some modes", "solver.propagator=reduced")
        yield Switch("inertia", "time.quasi_static = true", _static)
    outputs = [k for k in type(scene.output).model_fields if getattr(scene.output, k) is True]
    yield from (_set(f"output of {key}", f"output.{key}=false") for key in outputs)
    spectra = [f"sensor.{n}.spectrum" for n, s in scene.sensor.items() if s.spectrum is not None]
    if spectra:
        yield Switch("spectra", f"without {', '.join(spectra)}", _without(*spectra))
    if scene.sensor:
        yield Switch("sensors", "without [sensor.NAME]", _without("sensor", "limit"))


def _of_interfaces(scene: Scene, solution: Solution) -> Iterator[Switch]:
    """Friction; opening and slip of contacts without a gap."""
    for table, rows in (("interface", scene.interface), ("contact", scene.contact)):
        for name, row in rows.items():
            where = f"{table}.{name}"
            if getattr(row, "friction_coefficient", 0.0):
                yield _set(f"friction of {name}", f"{where}.friction_coefficient=0")
            history = solution.interfaces.get(name)
            # bonded across a gap it would carry a force that no contact has
            if row.behaviour not in ("contact", "no_slip") or getattr(row, "gap", None):
                continue
            effect = f"opening and slip of {name}"
            if history is not None and _stuck(history):
                effect = f"joint {name}, stuck all the time"
            yield Switch(effect, f'{where}.behaviour = "perfect"', _bonded(table, name))


def _stuck(history: InterfaceHistory) -> bool:
    """Whether an interface never opens and never slips."""
    status = history.contact_status
    return status is not None and not ((status == SEPARATION) | (status == SLIP)).any()


def _of_bodies(scene: Scene, solution: Solution) -> Iterator[Switch]:
    """Elasticity, inertia and bending modes of bodies; bodies that nothing touches."""
    for name, body in scene.substructure.items():
        if _untouched(scene, solution, name):
            yield Switch(f"body {name}, never touched", f"without [substructure.{name}]", _left_out(name))
            continue
        where = f"substructure.{name}"
        if body.bending_modes and not body.rigid:
            yield _set(f"bending modes of {name}", f"{where}.bending_modes=false")
        if body.rigid:
            continue
        if len(scene.substructure) > 1:
            yield Switch(f"elasticity of {name}", f"{where}.rigid = true", _rigid(name))
        # with another density a body that is thrown has another momentum: another scene
        if not scene.time.quasi_static and not body.motion_keys and not scene.thrown:
            yield Switch(f"inertia of {name}", f"{where}.material of its own, density x {_LIGHT:g}", _light(name))


def _untouched(scene: Scene, solution: Solution, name: str) -> bool:
    """Whether a body has interfaces, all of which are open all the time."""
    interfaces = [n for n, i in scene.interface.items() if name in {split_face(side)[0] for side in i.sides}]
    states = [solution.interfaces[n].contact_status for n in interfaces if n in solution.interfaces]
    return bool(states) and not scene.contact and all(s is not None and (s == SEPARATION).all() for s in states)


def _few(candidates: Sequence[Switch]) -> tuple[list[Switch], list[str]]:
    """Not more than a few switches of a kind; the names of the others."""
    kinds: dict[str, list[Switch]] = {}
    once: dict[str, Switch] = {}
    for switch in candidates:
        once.setdefault(switch.what, switch)  # what is suggested may be one of the others
    for switch in once.values():
        # "friction of NAME" is a kind; settings without an owner are one each
        if " of " in switch.effect:
            kind = switch.effect.partition(" of ")[0]
        else:
            kind = switch.what
        kinds.setdefault(kind, []).append(switch)
    unmeasured = [
        f"{kind} of {len(members) - _EACH} more than {_EACH}" for kind, members in kinds.items() if len(members) > _EACH
    ]
    return [switch for members in kinds.values() for switch in members[:_EACH]], unmeasured


# -- edits of tables --------------------------------------------------------------------------------------------------
def _set(effect: str, *settings: str) -> Switch:
    """A switch by settings."""
    return Switch(effect, " ".join(f"--set {s}" for s in settings), lambda tables: with_settings(tables, settings))


def _followed(settings: tuple[str, ...]) -> Switch:
    return _set("what is suggested above", *settings)


def _without(*paths: str) -> Edit:
    """Takes keys away; ``*`` is every table."""

    def edit(tables: Tables) -> None:
        for path in paths:
            *inner, last = path.split(".")
            here = [tables]
            for key in inner:
                # a missing table is an empty one: nothing is taken away
                here = [row for table in here for row in (table.values() if key == "*" else [table.get(key, {})])]
            for table in here:
                table.pop(last, None)

    return edit


def _bonded(table: str, name: str) -> Edit:
    keys = ("sides", "bodies", "search", "except", "points_from", "points_at", "ground", "ground_velocity")

    def edit(tables: Tables) -> None:
        row = tables[table][name]
        tables[table][name] = {key: value for key, value in row.items() if key in keys} | {"behaviour": "perfect"}

    return edit


def _rigid(name: str) -> Edit:
    def edit(tables: Tables) -> None:
        body = tables["substructure"][name]
        tables["substructure"][name] = {k: v for k, v in body.items() if k not in ("bending_modes", "modal_damping")}
        tables["substructure"][name]["rigid"] = True

    return edit


def _light(name: str) -> Edit:
    def edit(tables: Tables) -> None:
        body = tables["substructure"][name]
        material = dict(tables["material"][body["material"]])
        material["density"] *= _LIGHT
        tables["material"][f"{body['material']}_{name}"] = material
        # a material of its own: others keep theirs
        body["material"] = f"{body['material']}_{name}"

    return edit


def _static(tables: Tables) -> None:
    """Without inertia there are no rates: no damping, no accelerations of sensors."""
    tables["time"]["quasi_static"] = True
    rates = [f"material.*.{key}" for key in (*DAMPING_KEYS, "at_frequency")]
    _without("time.scheme", "time.start", "sensor.*.spectrum", "sensor.*.filter", "limit", *rates)(tables)


def _left_out(name: str) -> Edit:
    """Takes a body away with all that is attached to it."""

    def attached(value: object) -> bool:
        if isinstance(value, str):
            return value == name or value.startswith(f"{name}.")
        return isinstance(value, list | tuple) and any(map(attached, value))

    def edit(tables: Tables) -> None:
        tables["substructure"].pop(name)
        for kind, rows in tables.items():
            # these may have the name of a body as a value without being attached to it
            if kind not in ("material", "substructure", "mesh") and isinstance(rows, dict):
                gone = [n for n, row in rows.items() if isinstance(row, dict) and any(map(attached, row.values()))]
                for n in gone:
                    rows.pop(n)

    return edit
