"""The variable table of a scene: everything that a co-simulation sets or reads.

Scalars come first (all of FMI 2), then arrays (FMI 3 only). The order is the value reference. Names are structured,
components are counted from 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from ..results.quantities import ENERGY, SENSOR
from ..scene.boundaries import Driven
from ..scene.laws import InputLaw, TimeLaw
from ..scene.ports import COMPONENTS, INPUTS, MOTIONS, REFLECTED, Port, indexed
from ..scene.schema import BODY_FORCE, GRAVITY, Scene
from .variable import AXES, Kind, Variable, input_variable, is_wave, output, parameter, variable_of, vector

WINDOWED, PRESCRIBED = 0, 1
HOLD, RATE, LINE, CAUSAL = 0, 1, 2, 3
MAX_WINDOW = 100_000  # instants
HISTORY = 101  # instants of the load histories, where the host sets no size: one array element each
_INSTANTS = ("window.size",)
_SHARES: Final[Mapping[str, str]] = {
    "closed": "in contact",
    "sticking": "in contact and sticking",
    "slipping": "in contact and slipping",
}

INNER_TIME: Final = "innerTime"
"""Output that says which instant the outputs are those of."""

EVENTS: Final[Mapping[str, tuple[str, str]]] = {
    "touches": ("lastTouch", "in contact, after none of its points was"),
    "separations": ("lastSeparation", "open at all points, after one was in contact"),
    "slips": ("lastSlip", "slipping at all points in contact, after one stuck"),
}
"""Output that counts a contact event of an interface: output of its last instant, and what the interface becomes."""

_TERMS: Final = ("kinetic", "elastic", "work_of_loads", "interface_work", "friction_dissipation", "damping_dissipation")
ENERGIES: Final[Mapping[str, str]] = {
    name: ENERGY[name].meaning.removesuffix(" of the run")
    for name in (*_TERMS, "landing_dissipation", "scheme_dissipation", "balance")
}
"""Outputs of the energies of the assembly, with their meaning."""


def inputs_of(scene: Scene) -> dict[str, InputLaw]:
    """Laws set from outside: of forces by their names in ``Scene.force_laws``, of driven faces by ``boundary.NAME``, of
    moving ground by ``ground.INTERFACE``, of ports by the names of ``Port.inputs``."""
    laws = dict(scene.force_laws)
    for name, port in scene.port.items():
        laws |= {source: port.law(component) for source, component in port.inputs(name).items()}
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, Driven):
            laws[f"boundary.{name}"] = boundary.law
    for name, interface in scene.interface.items():
        if interface.ground_velocity is not None:
            laws[f"ground.{name}"] = interface.ground_velocity.law
    return {name: law for name, law in laws.items() if isinstance(law, InputLaw)}


def with_laws(scene: Scene, laws: Mapping[str, TimeLaw]) -> Scene:
    """The scene with other laws of its inputs, by the names of ``inputs_of``."""
    parts: dict[str, Any] = {
        "load": {n: _with_law(load, laws.get(n)) for n, load in scene.load.items()},
        "gravity": _with_law(scene.gravity, laws.get(GRAVITY)),
        "substructure": {
            n: body.model_copy(update={"body_force_law": laws[f"{BODY_FORCE}{n}"]})
            if f"{BODY_FORCE}{n}" in laws
            else body
            for n, body in scene.substructure.items()
        },
        "boundary": {n: _with_law(b, laws.get(f"boundary.{n}")) for n, b in scene.boundary.items()},
        "port": {n: _with_port_laws(n, port, laws) for n, port in scene.port.items()},
        "interface": {
            n: i.model_copy(update={"ground_velocity": _with_law(i.ground_velocity, laws[f"ground.{n}"])})
            if f"ground.{n}" in laws
            else i
            for n, i in scene.interface.items()
        },
    }
    return scene.model_copy(update=parts)


def _with_law(table: Any, law: TimeLaw | None) -> Any:
    return table if law is None else table.model_copy(update={"law": law})


def _with_port_laws(name: str, port: Port, laws: Mapping[str, TimeLaw]) -> Port:
    given = {component: laws[source] for source, component in port.inputs(name).items() if source in laws}
    return port.model_copy(update={"laws": {**port.laws, **given}}) if given else port


def scalar_table(scene: Scene) -> tuple[Variable, ...]:
    """Scalar variables of a scene (all of FMI 2); the outputs of contact events are the last."""
    inputs = inputs_of(scene)
    depends = tuple(input_variable(name, "value") for name in inputs)
    rows: list[Variable] = [
        Variable("time", "independent", "continuous", "real", "time since the start of the scene", "s"),
        *_parameters(scene),
    ]
    for name, law in inputs.items():
        rows += _inputs(name, law)
    for name in scene.joints:
        rows += _interface(scene, name, depends)
    for name in scene.sensor:
        sensor = scene.sensor[name]
        about = f"of sensor {name}, " + (f"mean of {sensor.face}" if sensor.face else f"a point of {sensor.body}")
        for motion in ("displacement", "velocity"):
            rows += vector(f"sensor.{name}.{motion}", str(SENSOR[motion].unit), f"{motion} {about}")
    for name, port in scene.port.items():
        rows += _port(name, port, depends)
    for name, bolt in scene.bolt.items():
        about = f"tension of bolt {name} in {bolt.substructure}"
        rows.append(output(f"bolt.{name}.force", "N", about, initial_dependencies=depends))
    rows += _solver()
    if scene.output.energy:
        rows += [output(f"energy.{name}", "J", text) for name, text in ENERGIES.items()]
    for name in opening_interfaces(scene):
        rows += _events(name)
    return tuple(rows)


def opening_interfaces(scene: Scene) -> list[str]:
    """Names of the interfaces that can open, which have contact events."""
    return [name for name, interface in scene.joints.items() if interface.behaves_open]


_MEANINGS: Final[Mapping[str, str]] = {
    "mode": "0: windowed, every step solves its own interval with the inputs given; 1: prescribed, the whole interval "
    "is solved from given histories when initialization ends and played back",
    "inputInterpolation": "load inside a step. 0: held at the value; 1: value + rate x time since the start of the "
    "step; 2: straight line from the end of the last step to the value, reached at the end of this step; 3: as 1 "
    "for a load once a rate other than 0 was set, else the straight line through its last two values; held over the "
    "first step and over a step that begins with a jump after two equal values. The incident wave of a port follows "
    "2, unless this is 0 or its rate is set",
    "timeStep": "time step of the run; communication steps may be of any length",
    "endTime": "end of the interval solved in prescribed mode, a whole number of timeStep",
    "tolerance": "tolerance on the error indicator sqrt(eta); a fifth of the tolerance of the importer replaces it",
    "maxIterations": "largest number of iterations of a window",
    "historyFile": "prescribed mode: CSV or netCDF file with a time column or coordinate and one column or variable "
    "per input: name of the load, body_force.SUBSTRUCTURE, gravity.acceleration, boundary.NAME, or ground.INTERFACE; "
    "or the CSV table itself, its rows separated by line breaks or semicolons: time,NAME;0,0;1e-6,1",
    "resultsFile": "netCDF file written when the simulation is terminated, holding accepted steps only; nothing where "
    "empty",
    "estimateError": "1: the error of each quantity, from coarser runs made when the simulation is terminated, is "
    "written to the results file",
}
"""Descriptions of the parameters."""


def _parameters(scene: Scene) -> Iterator[Variable]:
    time, solver = scene.time, scene.solver
    rows: tuple[tuple[str, Kind, float | int | str, str | None, float | None, float | None], ...] = (
        ("mode", "integer", WINDOWED, None, 0, 1),
        ("inputInterpolation", "integer", CAUSAL, None, 0, 3),
        ("timeStep", "real", time.time_step, "s", 0.0, None),
        ("endTime", "real", time.end, "s", 0.0, None),
        ("tolerance", "real", solver.tolerance, "1", 0.0, 1.0),
        ("maxIterations", "integer", solver.max_iterations, None, 1, None),
        ("historyFile", "string", "", None, None, None),
        ("resultsFile", "string", "", None, None, None),
        ("estimateError", "integer", 0, None, 0, 1),
    )
    for name, kind, start, unit, minimum, maximum in rows:
        yield parameter(name, kind, start, _MEANINGS[name], unit=unit, minimum=minimum, maximum=maximum)


def _inputs(name: str, law: InputLaw) -> Iterator[Variable]:
    stem = variable_of(name)
    kind, _, own = stem.partition(".")
    if kind == "port":
        yield from _port_inputs(name, law)
        return
    thing = {
        "load": "load",
        "body_force": "the body force of",
        "gravity": "the gravity of all bodies, its",
        "boundary": "the motion of boundary",
        "ground": "the velocity of the ground of interface",
    }
    what, moment = f"amplitude that multiplies {thing[kind]} {own}", "at the start of the step"
    yield Variable(f"{stem}.value", "input", "continuous", "real", f"{what}, {moment}", "1", law.start_value)
    yield Variable(f"{stem}.rate", "input", "continuous", "real", f"rate of the {what}, over the step", "s-1", 0.0)


_PORT_WORDS: Final[Mapping[str, tuple[str, str, str]]] = {
    "force": ("N", "N s-1", "force on the body through port {}"),
    "moment": ("N m", "N m s-1", "moment on the body through port {}, about its centre"),
    "velocity": ("m s-1", "m s-2", "velocity of port {}"),
    "angularVelocity": ("rad s-1", "rad s-2", "angular velocity of port {}"),
    "displacement": ("m", "m s-1", "displacement of port {}"),
    "rotation": ("rad", "rad s-1", "rotation of port {}"),
    "incident": ("N", "N s-1", "incident wave F + Z v of port {}, F the force on the body"),
    "incidentMoment": ("N m", "N m s-1", "incident wave M + Z omega of port {}, M the moment on the body"),
    "reflected": ("N", "N s-1", "reflected wave Z v - F of port {}, incident on the port on the other side"),
    "reflectedMoment": ("N m", "N m s-1", "reflected wave Z omega - M of port {}, incident on the other side"),
    "impedance": ("N s m-1", "", "impedance Z of port {}"),
    "rotationalImpedance": ("N m s", "", "impedance Z of port {}, of a rotation"),
}
"""Unit, unit of the rate, and meaning of the quantities of ports."""


def _port_words(name: str) -> tuple[str, str, str]:
    """Unit, unit of the rate, and meaning of an input of a port."""
    return _PORT_WORDS[name.partition("[")[0].rpartition(".")[2]]


def _port_inputs(name: str, law: InputLaw) -> Iterator[Variable]:
    unit, per_second, meaning = _port_words(name)
    about = f"{meaning.format(name.split('.')[1])}, {AXES[int(name[-2]) - 1]}"
    when = "at the end of the step, at its start where the rate is set" if is_wave(name) else "at the start of the step"
    yield Variable(name, "input", "continuous", "real", f"{about}, {when}", unit, law.start_value)
    rate = input_variable(name, "rate")
    yield Variable(rate, "input", "continuous", "real", f"rate of the {about}, over the step", per_second, 0.0)


def _port(name: str, port: Port, depends: tuple[str, ...]) -> Iterator[Variable]:
    """Outputs of a port, and its impedances."""

    def chosen(words: tuple[str, str], exerted: bool = False) -> Iterator[Variable]:
        for component in port.components:
            place = indexed(name, words, component)
            word = words[COMPONENTS.index(component) // 3]
            unit, _, meaning = _PORT_WORDS[word]
            meaning = meaning.replace("on the body through", "that the body exerts through") if exerted else meaning
            yield output(place, unit, f"{meaning.format(name)}, {component[-1]}", initial_dependencies=depends)

    if port.causality == "motion_in":
        yield from chosen(INPUTS["force_in"], exerted=True)
        return
    for turned in (0, 1) if port.rotates else (0,):
        for words in MOTIONS:
            unit, _, meaning = _PORT_WORDS[words[turned]]
            yield from vector(f"port.{name}.{words[turned]}", unit, meaning.format(name))
    if port.causality == "wave":
        yield from chosen(INPUTS["force_in"])
        yield from chosen(REFLECTED)
        words = ("impedance", "rotationalImpedance")
        for component, impedance in zip(port.components, port.impedance or (), strict=True):
            unit, _, meaning = _PORT_WORDS[words[COMPONENTS.index(component) // 3]]
            about = f"{meaning.format(name)}, {component[-1]}"
            yield Variable(indexed(name, words, component), "local", "constant", "real", about, unit, impedance)


def _interface(scene: Scene, name: str, depends: tuple[str, ...]) -> Iterator[Variable]:
    interface = scene.joints[name]
    first, second = interface.sides
    where = f"interface.{name}"
    yield from vector(
        f"{where}.force", "N", f"resultant force of interface {name} on {first}", initial_dependencies=depends
    )
    yield from vector(f"{where}.impulse", "N s", "time integral of the resultant force since the start")
    yield from vector(f"{where}.velocityE", "m s-1", f"mean velocity of {first}, weighted by area")
    yield from vector(f"{where}.velocityEp", "m s-1", f"mean velocity of {second}, weighted by area")
    yield from vector(f"{where}.relativeVelocity", "m s-1", f"mean velocity of {second} relative to {first}")
    yield output(f"{where}.normalForce", "N", "normal resultant, positive in compression", initial_dependencies=depends)
    if not interface.behaves_open:
        return
    yield output(f"{where}.gap", "m", "mean gap, weighted by area; negative where the sides penetrate")
    yield output(f"{where}.smallestGap", "m", "smallest gap of all points")
    for key, text in _SHARES.items():
        yield output(
            f"{where}.{key}", "1", f"share of the area {text}", minimum=0.0, maximum=1.0, initial_dependencies=depends
        )


def _events(name: str) -> Iterator[Variable]:
    for count, (instant, text) in EVENTS.items():
        where = f"interface.{name}"
        about = f"number of times that the interface became {text}"
        yield Variable(f"{where}.{count}", "output", "discrete", "integer", about, minimum=0.0)
        yield output(f"{where}.{instant}", "s", f"instant of the last of {where}.{count}; 0 before the first")


def _solver() -> Iterator[Variable]:
    yield output("solver.iterations", "1", "iterations of the last step, over all its windows", minimum=0.0)
    yield output("solver.errorIndicator", "1", "largest error indicator sqrt(eta) of the windows of the last step")
    converged = "1 where every window of the last step converged, else 0"
    yield output("solver.converged", "1", converged, minimum=0.0, maximum=1.0)
    yield output(
        "solver.instants",
        "1",
        "number of time steps that ended in the last communication step that ended some",
        minimum=0.0,
    )
    inner = "instant of the outputs: the last one of the time steps, not beyond the communication point"
    yield output(INNER_TIME, "s", inner)


def table_of(scene: Scene, n_point: Mapping[str, int] | None = None) -> tuple[Variable, ...]:
    """The variable table: scalars, and arrays where the number of points of each interface is given."""
    arrays = () if n_point is None else _arrays(scene, inputs_of(scene), n_point)
    return (*scalar_table(scene), *arrays)


# -- arrays (FMI 3) ----------------------------------------------------------------------------------------------
def _arrays(scene: Scene, loads: Mapping[str, InputLaw], n_point: Mapping[str, int]) -> Iterator[Variable]:
    """Arrays of a scene: load histories, instants of a window, fields of points.

    loads : laws of those set from outside. n_point : number of points of each interface.
    """
    for name, start, meaning in (
        ("window.size", scene.time.n_step + 1, "number of instants the arrays of a window can hold"),
        ("history.size", HISTORY, "number of elements of the load histories of prescribed mode"),
    ):
        yield Variable(
            name, "structuralParameter", "fixed", "count", meaning, None, start, minimum=1, maximum=MAX_WINDOW
        )
    size = ("history.size",)
    if loads:
        about = (
            "instants of the load histories, increasing; the last is repeated up to the size of the array; all equal"
        )
        yield parameter("history.time", "real", 0.0, f"{about}: none given", unit="s", dimensions=size)
    for name, law in loads.items():
        unit = _port_words(name)[0] if name.startswith("port.") else "1"
        about = f"amplitudes of {variable_of(name).replace('.', ' ', 1)} at history.time"
        yield parameter(input_variable(name, "history"), "real", law.start_value, about, unit=unit, dimensions=size)
    yield output("window.count", "1", "number of instants of the window, its start included", minimum=0.0)
    yield output("window.time", "s", "instants of the window, NaN beyond the last", dimensions=_INSTANTS)
    for name in scene.joints:
        yield from _interface_arrays(scene, name, n_point[name])


def _interface_arrays(scene: Scene, name: str, n_point: int) -> Iterator[Variable]:
    where, note, vectors = f"interface.{name}", "at the instants of the window", (*_INSTANTS, 3)
    yield output(f"{where}.window.force", "N", f"resultant force on the first side {note}", dimensions=vectors)
    for side in ("E", "Ep"):
        what = f"mean velocity of side {side} {note}"
        yield output(f"{where}.window.velocity{side}", "m s-1", what, dimensions=vectors)
    points, both = f"{where}.points", (2, n_point, 3)
    yield output(f"{points}.traction", "Pa", "traction on the first side at the points", dimensions=(n_point, 3))
    yield output(f"{points}.velocity", "m s-1", "velocity of both sides at the points", dimensions=both)
    if not scene.joints[name].behaves_open:
        return
    yield output(f"{where}.window.gap", "m", f"mean gap {note}", dimensions=_INSTANTS)
    for key in _SHARES:
        yield output(f"{where}.window.{key}", "1", f"share of the area {key} {note}", dimensions=_INSTANTS)
    yield output(f"{points}.gap", "m", "gap at the points", dimensions=(n_point,))
    status = "contact status at the points: separation 0, stick 1, slip 2"
    yield output(f"{points}.status", "1", status, dimensions=(n_point,))
