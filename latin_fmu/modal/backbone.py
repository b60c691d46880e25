"""Backbone of a joint: frequency and damping of a mode of the clamped assembly against the amplitude.

Quasi-static modal analysis (Festjens, Chevallier, Dion 2013; Lacayo, Allen 2019). From the equilibrium u_0 that the
scene starts from, its bolts tight, the assembly is loaded without inertia by

    f = alpha M phi,    phi^T M phi = 1

phi a mode of the joints as they are clamped: closed and sticking where they are pressed. Such a load is in balance
with the rigid motions. With the modal displacement q = phi^T M (u - u_0), the loads +alpha and -alpha of an amplitude
and the loss D of a whole loop,

    omega^2 = 2 alpha / (q(+alpha) - q(-alpha)),    zeta = D / (2 pi alpha q)

(the secant, and the loss over that of an oscillator with zeta = 1 of the same secant). Where materials have Maxwell
branches the frequencies are times that of the linear mode with the stiffness there over its static one; the damping is
that of the joints alone. D is the work of friction, slip
by slip, which has no difference of large numbers.

The amplitudes are taken from the largest one down, as in a ring-down, after a loop of the largest one that is not
counted: tightening leaves points at the limit of friction, whose tractions relax in the first loops and would count as
damping.

    half     +alpha to -alpha, twice its loss: joints that are alike for both signs of the load
    full     back to +alpha as well: any joint
    masing   from 0 up, as tightened: 0 to alpha alone, four times its loss, and omega^2 = alpha / q. Exact where no
             point slid before and all keep their pressure (Masing's rule); points that open or close are counted

The amplitude is that of a sensor along its motion in the mode, or of the point that moves most; rigid motions, which
the static problem leaves undetermined, are taken out. The first loads are those of the linear mode. Where points slide
or open they make other amplitudes than those wanted: the loops are run again with loads interpolated between those that
are known, ln alpha over ln amplitude, until all amplitudes are met. Loads without an equilibrium are a bound on alpha,
from which the largest amplitude follows that the joint can have in statics.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, get_args

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import ArrayLike

from ..assembly.initial_state import InitialState
from ..assembly.models import Kept
from ..assembly.problem import DiscretisedProblem
from ..building import discretise, without_scheme
from ..errors import InputError, Problem, SolverError, did_you_mean, listed
from ..joined.dynamic_stiffness import curve_lines
from ..joined.joined_assembly import JoinedAssembly, pressed_of
from ..latin.assembly import Array
from ..latin.outcome import InterfaceHistory, Timings
from ..latin.probes import SensorPlace
from ..latin.recorder import Recorder
from ..latin.windows import Run, RunControl
from ..machine import one_thread
from ..propagator.model import LoadTerm, with_load
from ..reader import scene_from_dict
from ..results.dataset import Stored
from ..results.groups import StoredGroup, in_units, root_attributes
from ..results.quantities import columns, rows
from ..scene.readable_numbers import aligned, readable
from ..scene.schema import Scene
from ..scene.settings import StaticStart
from ..scene.units import SI, UnitSystem
from ..statics.prestressed import corrected, stressed_problem
from ..statics.statics import static_problem, static_scene, static_state, tightened

Loop = Literal["half", "full", "masing"]
LOOPS: Final = get_args(Loop)
_LOAD: Final = "modal load"
_PLACE: Final = "place of the amplitude"
_MOST: Final = 1000  # increments up to an amplitude
_CUTS: Final = 5  # of all increments in two, where one does not converge
_ITERATIONS: Final = 200  # of an increment
_FEW: Final = 40  # sliding points: a front of some elements in width
_SIZES: Final = (1e-12, 0.1)  # smallest and largest amplitude, of the size of the assembly
_NEAREST: Final = 1e-4  # least share by which amplitudes may differ from those wanted
_TRIES: Final = 12  # loops until the amplitudes are those wanted
_LESS: Final = 16.0  # loads over those of the next try, where not even the first increment has an equilibrium
_FAILS: Final = 4  # tries without any equilibrium
_STEEPEST, _FLATTEST = 1.0, 0.02  # d ln alpha / d ln amplitude beyond what is known: linear; close to sliding away
_ASIDE: Final = 0.3  # of ``within``: loads beside those at which the iteration stalls
_CLOSE: Final = 1e-3  # of a load that has no equilibrium: nearer ones are not tried
_MOVES: Final = 1e-9  # of the largest displacement of the mode: below, a sensor does not move in it


def backbone(
    scene: Scene,
    mode: int,
    amplitudes: ArrayLike,
    sensor: str | None = None,
    *,
    loop: Loop = "half",
    increments: int = 2,
    tolerance: float = 1e-9,
    within: float = 0.01,
    progress: Callable[[int, int, int, float], None] | None = None,
) -> Backbone:
    """Frequency and damping of a mode against the amplitude, by static loops after tightening (module docstring).

    Parameters
    ----------
    mode : number of the elastic mode of the clamped assembly, from 1. amplitudes : (n,) > 0, m, from 1e-12 to a tenth
        of the size of the assembly. sensor : whose amplitude is meant; None for the point that moves most in the mode.
    loop : half, full or masing. increments : of load from 0 to an amplitude, a half loop that is measured has twice as
        many; all are cut in two, again and again, where one does not converge.
    tolerance : of the static iteration, whose residuals are the floor of the losses. within : share by which the
        amplitudes of the result may differ from those wanted; infinite: the loops of the linear loads, whose amplitudes
        are larger where points slide, in a third of the time. progress : called with the number of increments done,
        that of all, iterations and error of the last one.

    Raises
    ------
    InputError : an argument that does not fit the scene. SceneError : the scene cannot be built, or has no equilibrium.
    SolverError : an increment did not converge, 16 times as short as it was given; an amplitude that no load makes.

    Examples
    --------
    >>> scene = latin_fmu.load_scene("models/lap_joint/shock.toml")
    >>> curve = latin_fmu.backbone(scene, 1, [1e-6], "end", increments=1)
    >>> f"{curve.amplitude[0]:.2g} m, {curve.frequency[0]:.0f} Hz, {curve.damping[0]:.0e}"
    '1e-06 m, 863 Hz, ...'
    """
    wanted = np.sort(np.asarray(amplitudes, dtype=float).ravel())
    _check(scene, mode, wanted, sensor, loop, (increments, tolerance, within))
    with one_thread():
        whole = discretise(_at_rest(scene))
        _check_sizes(whole, wanted)
        operators: Kept = {}
        tight = tightened(whole, operators) if whole.cuts else None
        state = static_state(whole, {}, tight, operators)
        if state is None:
            what = "nothing presses the joints: no bolts, and nothing acts at t = 0"
            raise InputError([Problem("SCENE", what, remedy="tighten bolts, or give a preload or load")], "no backbone")
        stressed = stressed_problem(without_scheme(scene), state)
        whole = replace(whole, prestress=stressed.prestress)
        if whole.prestress is not None:
            state = corrected(whole, state, {})
        joined = JoinedAssembly.of(stressed, "sticking", pressed_of(stressed, state))
        shape = _Shape.of(joined, mode, whole, sensor)
        _check_rest(scene, whole, shape)

        def loops(levels: Array) -> _Loops:
            for cut in range(_CUTS):
                path = _Path.of(levels, loop, increments * 2**cut)
                run, recorder = _run(_loaded(whole, shape, path.load), state, operators, tolerance, progress)
                converged, sentence = run.status()
                reached = float(np.abs(path.load[: run.assembly.instant + 1]).max())
                if converged:
                    return _Loops.of(shape, path, recorder, loop)
            return _Loops(path, sentence, reached)

        # of the linear mode: q = alpha / omega^2, which moves the place by q times sensed
        result = _searched(loops, wanted, shape.omega**2 / shape.sensed, within, scene.unit_system)
        return _read(scene, shape, result, loop, mode, tolerance)


def _check(
    scene: Scene, mode: int, amplitudes: Array, sensor: str | None, loop: str, numbers: tuple[int, float, float]
) -> None:
    """Arguments that can be judged without meshes; ``numbers`` : increments, tolerance, within. Raises InputError."""
    (increments, tolerance, within), problems = numbers, []
    if mode < 1:
        problems.append(Problem("mode", "out of range", str(mode), "1 for the first elastic mode, 2, ..."))
    if not (len(amplitudes) and (amplitudes > 0).all() and np.isfinite(amplitudes).all()):
        problems.append(Problem("amplitude", "out of range", str(amplitudes.tolist()), "one or more, > 0"))
    if sensor is not None and sensor not in scene.sensor:
        sensors = list(scene.sensor)
        problems.append(
            Problem("sensor", "no sensor of this name", sensor, listed(sensors), did_you_mean(sensor, sensors))
        )
    if loop not in LOOPS:
        problems.append(Problem("loop", "unknown", loop, ", ".join(LOOPS), did_you_mean(loop, LOOPS)))
    if not 1 <= increments <= _MOST:
        problems.append(Problem("increments", "out of range", str(increments), f"1 to {_MOST}"))
    if not 0 < tolerance < 1e-2:
        problems.append(Problem("tolerance", "out of range", f"{tolerance:g}", "> 0, < 1e-2"))
    if not within >= _NEAREST:
        problems.append(Problem("within", "out of range", f"{within:g}", f"{_NEAREST:g} or more"))
    if problems:
        raise InputError(problems, "no backbone")


def _check_sizes(whole: DiscretisedProblem, amplitudes: Array) -> None:
    """Amplitudes that the displacements of the assembly can have. Raises InputError."""
    nodes, metre = np.concatenate([body.mesh.nodes for body in whole.bodies.values()]), whole.scene.unit_system["m"]
    size = float(np.ptp(nodes, axis=0).max())
    low, high = _SIZES[0] * size, _SIZES[1] * size
    if wrong := [a for a in amplitudes.tolist() if not low <= a <= high]:
        what = "no amplitude of an assembly of this size: displacements are small, and larger than round-off"
        allowed = f"{low:.3g} to {high:.3g} {metre}"
        raise InputError([Problem("amplitude", what, ", ".join(f"{a:g}" for a in wrong), allowed)], "no backbone")


def _check_rest(scene: Scene, whole: DiscretisedProblem, shape: _Shape) -> None:
    """Bodies that move at t = 0 are not in the equilibrium of the start, and have no part in a mode. Raises
    InputError."""
    still = static_scene(whole.scene, {}).substructure
    largest = max(float(np.abs(f).max()) for f in shape.forces.values())
    moving = [n for n, f in shape.forces.items() if n not in still and np.abs(f).max() > _MOVES * largest]
    problems = [
        Problem(
            f"substructure.{name}",
            "it moves at t = 0, so that the equilibrium does not hold it, and it has a part in the mode",
            ", ".join(scene.substructure[name].initial_keys) or None,
            remedy="omit the initial motion for the backbone",
        )
        for name in moving
    ]
    if problems:
        raise InputError(problems, "no backbone")


def _at_rest(scene: Scene) -> Scene:
    """The scene as a motion that starts from its equilibrium."""
    if isinstance(scene.time.start, StaticStart):
        start = scene.time.start
    else:
        start = StaticStart()
    return scene.model_copy(update={"time": scene.time.model_copy(update={"quasi_static": False, "start": start})})


@dataclass(frozen=True)
class _Shape:
    """A mode, and what of a static state is compared with it.

    Attributes
    ----------
    omega : s-1, of the linear assembly. forces : M phi (n_full,) by substructure. rows : (1 + n_rigid, 3 n_node) by
        substructure: q and the rigid motions from the displacements of the nodes. place, direction : where the
        amplitude is read, (3,) unit vector. rigid : (n_rigid,) what a rigid motion adds there. sensed : displacement
        there for q = 1. rise : frequency of the mode with the stiffness there, over that with the static one.
    """

    omega: float
    rise: float
    forces: Mapping[str, Array]
    rows: Mapping[str, Array]
    place: SensorPlace
    direction: Array
    rigid: Array
    sensed: float

    @staticmethod
    def of(joined: JoinedAssembly, mode: int, whole: DiscretisedProblem, sensor: str | None) -> _Shape:
        """The elastic mode of this number, from 1. Raises InputError: there is none, or the sensor does not move."""
        modes, parts = joined.modes(mode), joined.parts
        number = modes.n_rigid + mode - 1
        if number >= len(modes.omega):
            n = len(modes.omega) - modes.n_rigid
            raise InputError(
                [Problem("mode", "the assembly has fewer elastic modes", str(mode), f"1 to {n}")], "no backbone"
            )
        full = modes.expansion @ modes.vectors[:, [number, *range(modes.n_rigid)]]
        pulled = parts.mass @ full
        forces = {}
        rows = {}
        moved = {}
        for name, model in parts.models.items():
            part = parts.where[name]
            forces[name] = pulled[part, 0]
            # rigid: a with N^T a = M phi, N the motions of the nodes, the shortest of many
            rows[name] = (pulled[part] if model.nodal is None else la.lstsq(model.nodal.T, pulled[part])[0]).T
            moved[name] = full[part] if model.nodal is None else model.nodal @ full[part]
        if sensor is None:
            place = _largest(moved, whole)
        else:
            place = whole.sensors[sensor]
        there = place.rows @ moved[place.substructure]
        size, most = float(np.linalg.norm(there[:, 0])), max(float(np.abs(u[:, 0]).max()) for u in moved.values())
        if size <= _MOVES * most:
            raise InputError([Problem("sensor", f"it does not move in mode {mode}", sensor)], "no backbone")
        direction = there[:, 0] / size
        omega, damped = float(modes.omega[number]), joined.eigenvalues(modes)
        if damped is None:
            rise = 1.0
        else:
            rise = float(np.abs(damped[number])) / omega
        return _Shape(omega, rise, forces, rows, place, direction, direction @ there[:, 1:], size)

    @property
    def places(self) -> dict[str, SensorPlace]:
        """Places whose motions hold the place of the amplitude and the ``rows``, three of a substructure each."""
        places = {_PLACE: self.place}
        for name, part_rows in self.rows.items():
            for first in range(0, len(part_rows), 3):
                three = np.zeros((3, part_rows.shape[1]))
                three[: len(part_rows) - first] = part_rows[first : first + 3]
                places[f"{name} {first}"] = SensorPlace(name, sp.csr_array(three), np.zeros(3))
        return places

    def measured(self, recorder: Recorder, instants: int) -> tuple[Array, Array]:
        """Modal displacement and displacement at the place, without rigid motions, since the start, (n_time,) each."""
        motion = {name: values[:instants, 0] - values[0, 0] for name, values in recorder.series("motion").items()}
        sums = np.zeros((instants, 1 + len(self.rigid)))
        for name, part_rows in self.rows.items():
            parts = [motion[f"{name} {first}"] for first in range(0, len(part_rows), 3)]
            sums += np.concatenate(parts, axis=1)[:, : len(part_rows)]
        return sums[:, 0], motion[_PLACE] @ self.direction - sums[:, 1:] @ self.rigid


def _largest(moved: Mapping[str, Array], whole: DiscretisedProblem) -> SensorPlace:
    """The node that moves most in the mode, the first column of ``moved`` (3 n_node, n) by substructure."""
    sizes = {name: np.linalg.norm(u[:, 0].reshape(-1, 3), axis=1) for name, u in moved.items()}
    name = max(sizes, key=lambda n: float(sizes[n].max()))
    node = int(sizes[name].argmax())
    entries = (np.ones(3), (np.arange(3), 3 * node + np.arange(3)))
    rows = sp.csr_array(sp.coo_array(entries, shape=(3, len(moved[name]))))
    return SensorPlace(name, rows, whole.bodies[name].mesh.nodes[node])


@dataclass(frozen=True)
class _Path:
    """Loads of a run, and where each amplitude is reached.

    Attributes
    ----------
    load : (n_time,) factor alpha at the instants, the first one 0. top, other, end : (n_amplitude,) instants of +alpha,
        of -alpha (masing: of the start), and of the end of what is measured.
    """

    load: Array
    top: Array
    other: Array
    end: Array

    @staticmethod
    def of(levels: Array, loop: Loop, increments: int) -> _Path:
        """The loads of increasing levels alpha (n,), in the order of the module docstring."""
        load, marks = [0.0], []

        def go(to: float, steps: int) -> int:
            load.extend(np.linspace(load[-1], to, steps + 1)[1:].tolist())
            return len(load) - 1

        if loop == "masing":
            tops = np.array([go(level, increments) for level in levels.tolist()])
            return _Path(np.array(load), tops, np.zeros_like(tops), tops)
        go(levels[-1], increments)
        for level in levels[::-1].tolist():
            if load[-1] > 0.0:
                go(-level, 2 * increments)
            # on the way up nothing is measured, and how it is cut hardly counts
            top, other = go(level, increments), go(-level, 2 * increments)
            marks.append((top, other, go(level, 2 * increments) if loop == "full" else other))
        top, other, end = np.array(marks[::-1]).T
        return _Path(np.array(load), top, other, end)


@dataclass(frozen=True)
class _Loops:
    """The loops of some levels, or why there are none.

    Attributes
    ----------
    path : their loads. sentence : of an increment without an equilibrium, empty where there is none. reached : largest
        load up to which there is one. q, moved : (n_time,) of ``_Shape.measured``. histories : of the interfaces.
    """

    path: _Path
    sentence: str
    reached: float
    q: Array | None = None
    moved: Array | None = None
    histories: Mapping[str, InterfaceHistory] | None = None
    swing: float = 2.0
    """Amplitudes between the instants ``top`` and ``other``."""

    @staticmethod
    def of(shape: _Shape, path: _Path, recorder: Recorder, loop: Loop) -> _Loops:
        """Those of a run that has converged."""
        q, moved = shape.measured(recorder, len(path.load))
        # masing: from the start to +alpha is half of the whole swing already
        if loop == "masing":
            swing = 1.0
        else:
            swing = 2.0
        return _Loops(path, "", float(np.abs(path.load).max()), q, moved, recorder.interfaces(), swing)

    @property
    def amplitude(self) -> Array:
        """(n,) at the place, m."""
        assert self.moved is not None
        return np.asarray(np.abs(self.moved[self.path.top] - self.moved[self.path.other]) / self.swing)

    @property
    def half(self) -> Array:
        """(n,) modal displacement, kg0.5 m."""
        assert self.q is not None
        return np.asarray((self.q[self.path.top] - self.q[self.path.other]) / self.swing)


def _searched(
    loops: Callable[[Array], _Loops], wanted: Array, stiffness: float, within: float, units: UnitSystem
) -> _Loops:
    """Loops whose amplitudes are those wanted (n,), m, to the share ``within``; ``stiffness`` : levels of the linear
    mode over amplitudes. Raises SolverError: no load makes an amplitude."""
    levels = wanted * stiffness
    amplitudes = dict[float, float]()
    limit = np.inf
    fails, lost = 0, ""
    for _ in range(_TRIES):
        result = loops(levels)
        if not result.sentence:
            amplitudes |= dict(zip(levels.tolist(), result.amplitude.tolist(), strict=True))
            if (np.abs(result.amplitude - wanted) <= within * wanted).all() and (result.half > 0.0).all():
                return result
            top = _interpolated(amplitudes, wanted[-1:], limit)[0]
        elif amplitudes and levels[-1] < max(amplitudes):
            # larger loads have an equilibrium: the iteration has stalled, as it will not under slightly other ones
            levels = levels * (1.0 - _ASIDE * within)
            continue
        else:
            lost, limit = result.sentence, min(limit, float(levels[-1]))
            fails += not amplitudes
            # what was reached before the loads were too large, or far less
            if not amplitudes:
                top = max(result.reached, limit / _LESS)
            else:
                top = np.sqrt(limit * max(amplitudes))
        if (
            fails >= _FAILS
            or top >= (1.0 - _CLOSE) * limit
            or (amplitudes and max(amplitudes) >= (1.0 - _CLOSE) * limit)
        ):
            break
        if amplitudes:
            levels = _interpolated(amplitudes, wanted, limit)
        # none above the largest, and none equal to it
        levels = np.minimum(levels, top * np.linspace(1.0, 1.0 - _CLOSE, len(levels))[::-1])
    raise SolverError(_unreached(amplitudes, wanted, within, lost, units))


def _interpolated(pairs: Mapping[float, float], wanted: Array, limit: float) -> Array:
    """Levels (n,) for amplitudes wanted, increasing, from known pairs, below the level that has no equilibrium."""
    levels = np.array(sorted(pairs))
    amplitudes = np.maximum.accumulate(np.array([pairs[level] for level in levels.tolist()]))
    moved = amplitudes > 0.0
    if not moved.any():
        return np.asarray(np.minimum(2.0 * levels[-1] * wanted / wanted[-1], limit))
    x = np.log(amplitudes[moved])
    y = np.log(levels[moved])
    at = np.log(wanted)
    x, first = np.unique(x, return_index=True)
    y = y[first]
    if len(x) > 1:
        slope = (y[-1] - y[-2]) / (x[-1] - x[-2])
    else:
        slope = _STEEPEST
    beyond = y[-1] + np.clip(slope, _FLATTEST, _STEEPEST) * (at - x[-1])
    found = np.where(at > x[-1], beyond, np.where(at < x[0], y[0] + at - x[0], np.interp(at, x, y)))
    new_levels = np.exp(found)
    if new_levels[-1] >= (1.0 - _CLOSE) * limit:
        new_levels[-1] = np.sqrt(limit * levels[-1])
    return np.asarray(np.minimum.accumulate(new_levels[::-1])[::-1])


def _unreached(pairs: Mapping[float, float], wanted: Array, within: float, lost: str, units: UnitSystem) -> str:
    """Which amplitude is not reached, and why."""
    metre = units.label("m")
    largest = max(pairs.values(), default=0.0)
    first = next((a for a in wanted.tolist() if a > (1.0 + within) * largest), wanted[-1])
    words = f"amplitude not reached: {readable(first, metre, 4)} is wanted, and the largest load with an equilibrium "
    words += f"makes {readable(largest, metre, 4)}" if pairs else "makes less"
    if lost:
        words += f"; under a larger one: {lost}"
    if pairs:
        remedy = f"ask for at most {readable(largest, metre, 3)}"
    else:
        remedy = "ask for smaller amplitudes"
    return f"{words}; {remedy}, tighten the joint further, or take more increments or a larger tolerance"


def _loaded(whole: DiscretisedProblem, shape: _Shape, load: Array) -> DiscretisedProblem:
    """The static problem under the loads of t = 0, which stay, and the modal load."""
    scene = static_scene(whole.scene, {})
    data = _held(scene.tables())
    data["time"]["instants"] = len(load) - 1
    problem = static_problem(whole, scene_from_dict(data, scene.base_dir), prestress=whole.prestress)
    problem = replace(problem, sensors=shape.places, histories={_LOAD: load})
    terms = {name: LoadTerm(_LOAD, forces) for name, forces in shape.forces.items()}
    classes = [replace(c, members=[with_load(m, terms[m.name]) for m in c.members]) for c in problem.classes]
    return replace(problem, classes=classes)


def _held(table: Any) -> Any:
    """The tables of a static scene with the last value of its laws at all instants."""
    if not isinstance(table, dict):
        return table
    if table.get("type") == "table" and "times" in table:
        return {**table, "values": [table["values"][-1]] * len(table["values"])}
    return {key: _held(value) for key, value in table.items()}


def _run(
    discretised: DiscretisedProblem,
    state: InitialState,
    operators: Kept,
    tolerance: float,
    progress: Callable[[int, int, int, float], None] | None,
) -> tuple[Run, Recorder]:
    """All loads from the initial state."""
    problem = discretised.build(state, operators)
    settings = replace(problem.settings, tolerance=tolerance, force_tolerance=tolerance, max_iterations=_ITERATIONS)
    recorder = Recorder(problem.assembly, problem.output, problem.info)
    run = Run(problem.assembly, settings, recorder, Timings(), RunControl(progress=progress))
    run.all()
    return run, recorder


def _read(scene: Scene, shape: _Shape, loops: _Loops, loop: Loop, mode: int, tolerance: float) -> Backbone:
    """The backbone from the histories of a run."""
    path = loops.path
    q = loops.q
    histories = loops.histories
    assert q is not None
    assert histories is not None
    power = sum((h.friction_power for h in histories.values() if h.friction_power is not None), np.zeros(len(q)))
    work = np.concatenate([[0.0], np.cumsum(power[1:])]) / (len(q) - 1)  # instants are parts of 1 s
    if loop == "masing":
        first = np.zeros_like(path.top)
    else:
        first = path.top
    load, half = path.load[path.top], loops.half
    loss = {"half": 2.0, "full": 1.0, "masing": 4.0}[loop] * (work[path.end] - work[first])
    spans = list(zip(first, path.end, strict=True))
    return Backbone(
        name=scene.name,
        scene=scene.text(),
        mode=mode,
        loop=loop,
        tolerance=tolerance,
        linear_frequency=shape.rise * shape.omega / (2 * np.pi),
        amplitude=loops.amplitude,
        frequency=shape.rise * np.sqrt(load / half) / (2 * np.pi),
        damping=loss / (2 * np.pi * load * half),
        loss=loss,
        slipping=np.array([_changed(histories, a, b, 2) for a, b in spans]),
        opening=np.array([_changed(histories, a, b, 0) for a, b in spans]),
        sensor_force=path.load / shape.sensed,
        sensor_displacement=shape.sensed * q,
        units=scene.unit_system,
        curves=tuple(curve_lines(scene.material)),
    )


def _changed(histories: Mapping[str, InterfaceHistory], first: int, last: int, status: int) -> int:
    """Number of points that have this contact status at some of the instants; of separation: at some, not at all."""
    count = 0
    for history in histories.values():
        if history.contact_status is not None:
            there = history.contact_status[first : last + 1] == status
            # the first instant is slid to by what came before
            count += int((there.any(axis=0) & ~there.all(axis=0) if status == 0 else there[1:].any(axis=0)).sum())
    return count


_CURVE: Final = rows(
    """
    amplitude | m  | level | amplitude of the sensor | along its motion in the mode, without rigid motions
    frequency | Hz | level | frequency of the mode at this amplitude | by the secant of the loop
    damping   | 1  | level | damping ratio of the mode at this amplitude | share of critical damping, by friction alone
    loss      | J  | level | work of friction in a whole loop
    slipping  | 1  | level | number of points that slide in the loop
    opening   | 1  | level | number of points that open or close in the loop
    """
)
_LOOPS: Final = rows(
    """
    sensor_force | N | increment | force along the motion of the sensor in the mode that does the work of the modal load
    sensor_displacement | m | increment | displacement of the sensor in the mode, from the equilibrium of the start
    """
)


@dataclass(frozen=True)
class Backbone(Stored):
    """Frequency and damping of a mode of the clamped assembly against the amplitude.

    Attributes
    ----------
    name, scene : of the scene, and its text. mode : number of the elastic mode, from 1. loop, tolerance : as given.
    linear_frequency : of the mode with all pressed points sticking, Hz.
    amplitude : (n,) of the sensor, m. frequency : (n,), Hz. damping : (n,) share of critical. loss : (n,) of a whole
        loop, J. slipping, opening : (n,) numbers of points that slide, and that open or close, in the loop.
    sensor_force, sensor_displacement : (n_increment,) of all increments: displacement u q of the sensor in the mode,
        m, with u that for q = 1, and the force alpha / u, N, that does the work of the modal load on it.
    """

    name: str
    scene: str
    mode: int
    loop: Loop
    tolerance: float
    linear_frequency: float
    amplitude: Array
    frequency: Array
    damping: Array
    loss: Array
    slipping: Array
    opening: Array
    sensor_force: Array
    sensor_displacement: Array
    units: UnitSystem = SI
    curves: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Text: what was done, and a table of the amplitudes."""
        head = f"{self.name}: mode {self.mode}, {self.linear_frequency:.6g} Hz with all pressed points sticking; "
        head += f"loops: {self.loop}, {len(self.sensor_force) - 1} increments, tolerance {self.tolerance:g}"
        table: list[tuple[str, ...]] = [("amplitude", "frequency", "damping, %", "loss", "sliding", "opening")]
        for a, f, zeta, d, s, o in zip(
            *(self.amplitude, self.frequency, self.damping, self.loss, self.slipping, self.opening), strict=True
        ):
            sizes = readable(float(a), self.units.label("m"), 4), f"{f:.6g} Hz", f"{100 * zeta:.4g}"
            table.append((*sizes, readable(float(d), self.units.label("J"), 4), str(s), str(o)))
        lines = [head, "", *aligned(table)]
        few = (self.slipping > 0) & (self.slipping < _FEW)
        if few.any():
            most = readable(float(self.amplitude[few].max()), self.units.label("m"), 3)
            rule = "their loss holds where a mesh with shorter elements at the rims of the pressure gives the same"
            lines += ["", f"up to {most} fewer than {_FEW} points slide: {rule}"]
        if self.loop == "masing":
            if self.opening.any():
                open_or_close = "some open or close here: "
            else:
                open_or_close = ""
            rule = "Masing's rule holds where no point has slid before and all keep their pressure"
            lines += ["", f"{rule}; {open_or_close}compare with --loop half"]
        if self.curves:
            rule = "damping: that of the joints alone; frequencies: with the stiffness of materials at that of the mode"
            lines += ["", rule, *self.curves]
        return lines

    def groups(self) -> dict[str, StoredGroup]:
        """Groups by path: ``backbone`` and, with all increments, ``loops``."""
        about: dict[str, object] = {"mode": self.mode, "loop": self.loop, "tolerance": self.tolerance}
        about["linear_frequency"] = self.linear_frequency
        title = f"frequency and damping of mode {self.mode} against the amplitude"
        groups = {
            "/": StoredGroup({}, attrs=root_attributes(title, self.name, self.scene)),
            "/backbone": StoredGroup.of(columns(_CURVE, self), attrs=about),
            "/loops": StoredGroup.of(columns(_LOOPS, self)),
        }
        return in_units(groups, self.units)

    def as_csv(self) -> str:
        """The table, in the units of the scene."""
        stored = columns(_CURVE, self)[:4]  # without the numbers of points
        names = [f"{row.name} [{self.units.label(str(row.unit))}]" for row, _ in stored]
        table = zip(*(values for _, values in stored), strict=True)
        return "\n".join([",".join(names), *(",".join(f"{x:.9g}" for x in row) for row in table)]) + "\n"
