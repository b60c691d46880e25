"""Copies of the bodies and interfaces of a run, for scenes that differ from its scene in numbers, as one assembly.

Copies whose operators are those of the run are members of its classes: their factors, and the matrices of the contact
points, are those of the run, and are read once for all copies. A copy with other matrices has a class of its own. The
iteration of an instant goes on until all copies together have converged, to a tolerance that leaves none of them beyond
that of the run: the squares of their residuals add up, and so do those of their sizes, which are about the same.

One copy is that of the scene of the run itself. It takes as many iterations at every instant as the others, so that
what these leave is left in all, and cancels in differences, which is not so between a copy and the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

import numpy as np

from ..assembly.initial_state import InitialState, TightBolts
from ..assembly.models import Kept, KeptOperators, ModelClass, same_operators
from ..assembly.problem import DiscretisedProblem
from ..assembly.propagator_choice import chosen_propagators, made_propagators
from ..building import discretise
from ..errors import LatinError
from ..latin.assembly import Array, Assembly, Index, InterfaceUnit, Layout
from ..latin.outcome import BoltHistory, InterfaceHistory, SensorHistory, Timings
from ..latin.probes import OutputRequest
from ..latin.recorder import Recorder
from ..latin.search_direction import inertial_impedance
from ..latin.solver import Progress
from ..latin.windows import Run, RunControl
from ..propagator import SubstructureModel
from ..propagator.model import share_operators
from ..scene.fields import GROUND
from ..scene.schema import Scene
from ..statics.displaced_starts import displaced_start
from ..statics.starts import solved_equilibrium
from ..statics.statics import Stage
from ..time_scheme import QuasiStatic

MARK: Final = "|"
"""Between the number of a copy and a name."""
MOST: Final = 8
"""Copies at a time, that of the run included: more gain little, and take memory."""
_LARGE: Final = 3000
"""Unknowns of a body from which on the factor is most of what an instant reads. Then 4 copies cost 2.7 marches (blocks
of 1,000 elements); 5 copies of blocks of 216 elements in three classes cost 5, no less than runs one by one."""
_NEWTON: Final = 0.1  # Newton steps of a run over its instants from which on the matrix of all copies would cost more
T = TypeVar("T")


def named(copy: int, name: str) -> str:
    """Name of a copy."""
    return f"{copy}{MARK}{name}"


def of_copy(table: Mapping[str, T], copy: int) -> dict[str, T]:
    """Entries of a copy under their own names."""
    head = named(copy, "")
    return {name.removeprefix(head): values for name, values in table.items() if name.startswith(head)}


def unit_of(copy: int, unit: InterfaceUnit) -> InterfaceUnit:
    """An interface between the bodies of a copy."""
    first, second = (side if side == GROUND else named(copy, side) for side in unit.sides)
    return replace(unit, name=named(copy, unit.name), sides=(first, second))


def places_in(base: Layout, layout: Layout, n_unit: int, copies: int) -> list[Index]:
    """Of every copy the places of the channels of the run among those of the copies."""
    places = []
    for copy in range(copies):
        to = np.zeros(base.n_flat, dtype=np.int64)
        for i in range(n_unit):
            for side in (0, 1):
                to[base.channels(i, side)] = layout.channels(copy * n_unit + i, side)
        places.append(to)
    return places


def differences(problem: DiscretisedProblem, other: DiscretisedProblem) -> str:
    """What the scene of another problem changes beside loads, motions, initial values, gaps, laws and materials; empty
    where nothing."""
    mine, its = (
        [(u.name, type(u.behaviour), u.behaviour.n_component, u.geometry.n_point) for u in p.units]
        for p in (problem, other)
    )
    if mine != its or len(problem.time) != len(other.time) or problem.dt != other.dt or problem.scheme != other.scheme:
        return "changes interfaces, instants or the time scheme"
    for unit, changed in zip(problem.units, other.units, strict=True):
        law, fixed = unit.behaviour, unit.behaviour.elastic and not unit.behaviour.opens
        if fixed and not np.array_equal(law.point_parameters(1), changed.behaviour.point_parameters(1)):
            return f"changes the stiffness of {unit.attached or unit.name}"
    models, others = models_of(problem), models_of(other)
    for name, model in models.items():
        for key in ("channel_area", "positions", "nodal", "imposed_pattern"):
            if not _equal(getattr(model, key), getattr(others[name], key)):
                return f"changes the shape or the conditions of {name}"
        for key in ("expansion", "trace"):
            a, b = getattr(model, key), getattr(others[name], key)
            # a body without interfaces has empty ones, which have a sum but no largest value
            if a is not b and (a.shape != b.shape or abs(a - b).sum() > 0.0):
                return f"changes the shape or the conditions of {name}"
        reshaped = model.modal is not None and any(
            abs(getattr(model, key) - getattr(others[name], key)).sum() > 0.0 for key in ("stiffness", "inertia")
        )
        if model.modal != others[name].modal or reshaped:
            return f"changes the damping of the modes of {name}"
    return ""


def _equal(a: Array | None, b: Array | None) -> bool:
    if a is None or b is None:
        return a is b
    # equal to the last bit as a rule, and that test costs less
    return np.array_equal(a, b) or (a.shape == b.shape and bool(np.allclose(a, b, rtol=1e-12)))


def models_of(problem: DiscretisedProblem) -> dict[str, SubstructureModel]:
    """Models of the substructures of a problem by name."""
    return {m.name: m for c in problem.classes for m in c.members}


def twins(stage: Stage) -> KeptOperators:
    """Operators of a stage, for the same substructures."""
    problem = stage.problem
    made_with = (problem.scheme, problem.dt, chosen_propagators(problem.scene, problem.classes)[0])
    return KeptOperators({}, [c.members[0] for c in problem.classes], stage.ready.assembly.propagators, made_with)


def assembled(
    stage: Stage, classes: list[ModelClass], units: Sequence[InterfaceUnit], layout: Layout, impedance: Array
) -> Assembly:
    """The assembly of the copies of a stage, with its operators where theirs are equal; no class of it rests, no
    traction is negligible. ``impedance`` (n_flat,) as for ``Assembly``."""
    problem = stage.problem
    scheme, dt = problem.scheme, problem.dt
    # no energies of theirs are kept, and all of them take a product with K more in every instant
    output = problem.scene.output.model_copy(update={"energy": False})
    scene = problem.scene.model_copy(update={"output": output})
    propagators, _ = made_propagators(scene, classes, scheme, dt, impedance, twins(stage), stage.operators)
    assembly = Assembly(propagators, [c.channels for c in classes], units, layout, impedance, 0.0, scheme)
    assembly.rest_traction = -1.0
    if not isinstance(scheme, QuasiStatic) and any(body.rigid for body in problem.bodies.values()):
        inertial_impedance(assembly)
    return assembly


# -- scenes marched together ------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Marched:
    """Histories of a copy at all instants of the run, by name."""

    interfaces: dict[str, InterfaceHistory]
    sensors: dict[str, SensorHistory]
    bolts: dict[str, BoltHistory]


@dataclass(frozen=True)
class _Copy:
    """A scene beside that of a run: its problem, and the equilibrium that it starts from, None where there is none."""

    problem: DiscretisedProblem
    start: InitialState | None

    @property
    def bolts(self) -> TightBolts:
        """Its bolts, as tightened."""
        if self.start is None:
            return TightBolts()
        return self.start.bolts

    @property
    def classes(self) -> list[ModelClass]:
        """Its classes, at its start."""
        if self.start is None:
            return self.problem.classes
        return self.start.displaced(self.problem.classes)


def marched_beside(
    stage: Stage, scenes: Sequence[Scene], statics: Kept | None, newton: float, progress: Progress | None = None
) -> list[tuple[Marched, Marched] | None]:
    """Histories of scenes that differ from that of a run in numbers, marched together, each with those of the copy of
    the run beside it; None for each that has to be run on its own: a single one, without inertia, with another time
    scheme or other interfaces, where it cannot be built, where all bodies are small, or where the copies do not
    converge together.

    Parameters
    ----------
    stage : the motion of the run, which has converged. statics : operators of its static start, used again and added
        to. newton : Newton steps of the run over its instants. progress : of the march, windows done and all.
    """
    pairs: list[tuple[Marched, Marched] | None] = [None] * len(scenes)
    large = max(p.n_dof for p in stage.ready.assembly.propagators) >= _LARGE
    # Newton steps take the matrix of the points of all copies, which grows with the cube of their number
    if len(scenes) < 2 or not large or isinstance(stage.problem.scheme, QuasiStatic) or newton > _NEWTON:
        return pairs
    copies = {i: copy for i, scene in enumerate(scenes) if (copy := _built(stage, scene, statics)) is not None}
    numbers = list(copies)
    for first in range(0, len(numbers), MOST - 1):
        part = numbers[first : first + MOST - 1]
        run = _run(stage, [_Copy(stage.problem, stage.start), *(copies[i] for i in part)], progress)
        if run is not None:
            tables = run.recorder.interfaces(), run.recorder.sensors(run.assembly), run.recorder.bolt_histories()
            base, *others = (
                Marched(*(of_copy(table, number) for table in tables))  # type: ignore[arg-type]
                for number in range(len(part) + 1)
            )
            for i, other in zip(part, others, strict=True):
                pairs[i] = other, base
    return pairs


def _built(stage: Stage, scene: Scene, statics: Kept | None) -> _Copy | None:
    """A scene with its static start; None where it has to be run on its own, whose error has the reason."""
    base = stage.problem
    try:
        static, operators = scene.time.start.type == "static", base.kept or KeptOperators()
        # keys of the operators of static problems are those of a scene that is built
        problem = discretise(scene, None, operators.copy() if static else operators.beside(base.bodies))
        if differences(base, problem):
            return None
        start = displaced_start(problem, solved_equilibrium(problem, {}, kept=statics)) if static else None
        return _Copy(problem, start)
    except LatinError:
        return None


def _run(stage: Stage, copies: Sequence[_Copy], progress: Progress | None) -> Run | None:
    """The run of some copies; None where it has not converged."""
    base, n = stage.problem, len(copies)
    units = [unit_of(i, unit) for i, copy in enumerate(copies) for unit in copy.problem.units]
    layout = Layout(units)
    places = places_in(base.layout, layout, len(base.units), n)
    impedance = np.zeros(layout.n_flat)
    for to, copy in zip(places, copies, strict=True):
        impedance[to] = copy.problem.impedance
    assembly = assembled(stage, list(_classes(base, copies, places)), units, layout, impedance)
    assembly.characteristic_traction = max(copy.problem.characteristic_traction for copy in copies)
    assembly.rest_traction = stage.ready.assembly.rest_traction
    histories = dict[str, Any]()
    ground = dict[int, Array]()
    sensors = dict[str, Any]()
    bolts = dict[str, Any]()
    for i, copy in enumerate(copies):
        timeline, time = copy.problem.timeline_with(copy.bolts), copy.problem.time
        if copy.start is not None:
            _renamed(copy.start, i).hand_over(assembly)
        for c in copy.classes:
            histories |= {named(i, m.name): timeline.histories(m, time) for m in c.members}
        own_ground = timeline.ground(stage.ready.assembly.interfaces, time)
        ground |= {i * len(base.units) + number: velocity for number, velocity in own_ground.items()}
        request = copy.problem.output(copy.bolts)
        sensors |= copied(request.sensors, i)
        bolts |= copied(request.bolts, i)
    for propagator in assembly.propagators:
        propagator.begin([histories[name] for name in propagator.names], base.dt)
    assembly.begin(base.time, base.dt, ground, assembly.ground.start)
    request = OutputRequest(sensors=sensors, bolts=bolts, peak_duration=stage.ready.output.peak_duration)
    settings, share = stage.ready.settings, n**-0.5
    settings = replace(settings, tolerance=share * settings.tolerance, force_tolerance=share * settings.force_tolerance)
    run = Run(assembly, settings, Recorder(assembly, request, {}), Timings(), RunControl(progress=progress))
    run.all()
    if run.status()[0]:
        return run
    return None


def _classes(base: DiscretisedProblem, copies: Sequence[_Copy], places: Sequence[Index]) -> Iterator[ModelClass]:
    """Classes of the copies: those of the run with the copies whose operators are equal, then the others."""
    entries = [(c.members[0], list[SubstructureModel](), list[Index]()) for c in base.classes]
    places_of = {m.name: (m, entry) for c, entry in zip(base.classes, entries, strict=True) for m in c.members}
    for i, (copy, to) in enumerate(zip(copies, places, strict=True)):
        for c in copy.classes:
            for member, channels in zip(c.members, c.channels.T, strict=True):
                first_member, entry = places_of[member.name]
                if not same_operators(first_member, member):
                    entries.append(entry := (member, [], []))
                entry[1].append(replace(member, name=named(i, member.name)))
                entry[2].append(to[channels])
    for first, members, channels in entries:
        if members:
            share_operators(first, members[0])
            yield ModelClass(members, np.stack(channels, axis=1))


def _renamed(state: InitialState, copy: int) -> InitialState:
    """An initial state with the tractions and closures of the interfaces of a copy."""
    traction, closure = ({named(copy, n): x for n, x in table.items()} for table in (state.traction, state.closure))
    return replace(state, traction=traction, closure=closure)


def copied(places: Mapping[str, Any], copy: int, change: Callable[[Any], Any] | None = None) -> dict[str, Any]:
    """Places of sensors or bolts on the bodies of a copy."""
    moved_places = {name: place if change is None else change(place) for name, place in places.items()}
    return {
        named(copy, n): replace(place, substructure=named(copy, place.substructure))
        for n, place in moved_places.items()
    }
