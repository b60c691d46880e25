"""The variable table of a scene: everything a co-simulation sets or reads, in one place.

Scalars come first (they are the whole of the FMI 2 interface), arrays after them (FMI 3 only). The order is the
value reference. Names are structured, components are counted from 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from ..interface.registry import opens
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .variable import Variable, output, parameter, vector

WINDOWED, PRESCRIBED = 0, 1
HOLD, RATE, LINE = 0, 1, 2

ENERGIES: Final[Mapping[str, str]] = {
    "kinetic": "kinetic energy",
    "elastic": "elastic energy",
    "work_of_loads": "work of the loads since the start",
    "interface_work": "work of the interface tractions on the substructures since the start",
    "friction_dissipation": "energy dissipated by friction since the start",
    "damping_dissipation": "energy dissipated by material damping since the start",
    "scheme_dissipation": "energy dissipated by the time scheme since the start",
    "balance": "what the energy balance leaves over",
}


def input_loads(scene: Scene) -> list[str]:
    """Loads with the law ``input``: those set from outside."""
    return [name for name, load in scene.load.items() if isinstance(load.law, InputLaw)]


def scalar_table(scene: Scene) -> tuple[Variable, ...]:
    """Scalar variables of a scene (all of FMI 2)."""
    loads = input_loads(scene)
    depends = tuple(f"load.{name}.value" for name in loads)
    rows: list[Variable] = [
        Variable("time", "independent", "continuous", "real", "time since the start of the scene", "s"),
        *_parameters(scene),
    ]
    for name in loads:
        rows += _inputs(scene, name)
    for name in scene.interface:
        rows += _interface(scene, name, depends)
    for name in scene.sensor:
        about = f"of the node of {scene.sensor[name].substructure} nearest to sensor {name}"
        rows += vector(f"sensor.{name}.displacement", "m", f"displacement {about}")
        rows += vector(f"sensor.{name}.velocity", "m s-1", f"velocity {about}")
    rows += _solver()
    if scene.output.energy:
        rows += [output(f"energy.{name}", "J", text) for name, text in ENERGIES.items()]
    return tuple(rows)


def _parameters(scene: Scene) -> Iterator[Variable]:
    time, solver = scene.time, scene.solver
    yield parameter(
        "mode",
        "integer",
        WINDOWED,
        "0: windowed, every step solves its own interval with the inputs given; 1: prescribed, the whole interval is "
        "solved from given histories when initialization ends and played back",
        minimum=0,
        maximum=1,
    )
    yield parameter(
        "inputInterpolation",
        "integer",
        RATE,
        "load inside a step. 0: held at the value; 1: value + rate x time since the start of the step; 2: straight "
        "line from the end of the last step to the value, reached at the end of this step",
        minimum=0,
        maximum=2,
    )
    yield parameter(
        "timeStep",
        "real",
        time.time_step,
        unit="s",
        minimum=0.0,
        description="longest time step inside a communication step, which is cut into equal parts",
    )
    yield parameter(
        "endTime",
        "real",
        time.end,
        unit="s",
        minimum=0.0,
        description="end of the interval solved in prescribed mode, a whole number of timeStep",
    )
    yield parameter(
        "tolerance",
        "real",
        solver.tolerance,
        unit="1",
        minimum=0.0,
        maximum=1.0,
        description="tolerance on the error indicator sqrt(eta); a fifth of the importer's, if any, goes first",
    )
    yield parameter(
        "maxIterations", "integer", solver.max_iterations, "largest number of iterations of a window", minimum=1
    )
    yield parameter(
        "historyFile",
        "string",
        "",
        "prescribed mode: CSV or netCDF file with a time column or coordinate and one column or variable per load",
    )
    yield parameter(
        "resultsFile",
        "string",
        "",
        "netCDF file written when the simulation is terminated, holding accepted steps only; nothing where empty",
    )
    yield parameter(
        "estimateError",
        "integer",
        0,
        "1: coarser runs, made when the simulation is terminated, tell the error of each quantity in the results file",
        minimum=0,
        maximum=1,
    )


def _inputs(scene: Scene, name: str) -> Iterator[Variable]:
    law = scene.load[name].law
    assert isinstance(law, InputLaw)
    what = f"amplitude that multiplies load {name}"
    yield Variable(
        f"load.{name}.value", "input", "continuous", "real", f"{what}, at the start of the step", "1", law.start_value
    )
    yield Variable(f"load.{name}.rate", "input", "continuous", "real", f"rate of the {what}, over the step", "s-1", 0.0)


def _interface(scene: Scene, name: str, depends: tuple[str, ...]) -> Iterator[Variable]:
    interface = scene.interface[name]
    first, second = interface.sides
    where = f"interface.{name}"
    yield from vector(f"{where}.force", "N", f"resultant force of interface {name} on {first}", depends=depends)
    yield from vector(f"{where}.impulse", "N s", "time integral of the resultant force since the start")
    yield from vector(f"{where}.velocityE", "m s-1", f"mean velocity of {first}, weighted by area")
    yield from vector(f"{where}.velocityEp", "m s-1", f"mean velocity of {second}, weighted by area")
    yield from vector(f"{where}.relativeVelocity", "m s-1", f"mean velocity of {second} relative to {first}")
    yield output(f"{where}.normalForce", "N", "normal resultant, positive in compression", depends=depends)
    if not opens(interface.behaviour):
        return
    yield output(f"{where}.gap", "m", "mean gap, weighted by area; negative where the sides penetrate")
    yield output(f"{where}.smallestGap", "m", "smallest gap of all points")
    for key, text in (
        ("closed", "in contact"),
        ("sticking", "in contact and sticking"),
        ("slipping", "in contact and slipping"),
    ):
        yield output(f"{where}.{key}", "1", f"share of the area {text}", minimum=0.0, maximum=1.0, depends=depends)


def _solver() -> Iterator[Variable]:
    yield output("solver.iterations", "1", "iterations of the last step, over all its windows", minimum=0.0)
    yield output("solver.errorIndicator", "1", "largest error indicator sqrt(eta) of the windows of the last step")
    yield output(
        "solver.converged", "1", "1 where every window of the last step converged, else 0", minimum=0.0, maximum=1.0
    )
    yield output("solver.instants", "1", "number of time steps the last communication step was cut into", minimum=0.0)


def table_of(scene: Scene, n_point: Mapping[str, int] | None = None) -> tuple[Variable, ...]:
    """The variable table: scalars, and arrays where the number of points of each interface is given."""
    arrays = () if n_point is None else array_table(scene, input_loads(scene), n_point)
    return (*scalar_table(scene), *arrays)


# -- The arrays of the variable table (FMI 3): instants of a window, fields of points, load histories.
MAX_WINDOW = 100_000  # instants


def array_table(scene: Scene, loads: Sequence[str], n_point: Mapping[str, int]) -> tuple[Variable, ...]:
    """Arrays of a scene: instants of a window, fields of points, histories given up front.

    loads : those set from outside. n_point : number of points of each interface.
    """
    rows = [
        _count("window.size", scene.time.n_step + 1, "number of instants the arrays of a window can hold"),
        _count("history.size", 1, "number of instants of the load histories of prescribed mode; 1: none given"),
    ]
    if loads:
        size = ("history.size",)
        rows.append(parameter("history.time", "real", 0.0, "instants of the load histories", unit="s", dimensions=size))
        rows += [
            parameter(f"load.{name}.history", "real", 0.0, f"amplitudes of load {name}", unit="1", dimensions=size)
            for name in loads
        ]
    instants: tuple[int | str, ...] = ("window.size",)
    rows.append(output("window.count", "1", "number of instants of the window, its start included", minimum=0.0))
    rows.append(output("window.time", "s", "instants of the window, NaN beyond the last", dimensions=instants))
    for name in scene.interface:
        rows += _interface_arrays(scene, name, instants, n_point[name])
    return tuple(rows)


def _count(name: str, start: int, description: str) -> Variable:
    return Variable(
        name, "structuralParameter", "fixed", "count", description, None, start, minimum=1, maximum=MAX_WINDOW
    )


def _interface_arrays(scene: Scene, name: str, instants: tuple[int | str, ...], n_point: int) -> Iterator[Variable]:
    where, note = f"interface.{name}", "at the instants of the window"
    yield output(f"{where}.window.force", "N", f"resultant force on the first side {note}", dimensions=(*instants, 3))
    for side in ("E", "Ep"):
        yield output(
            f"{where}.window.velocity{side}", "m s-1", f"mean velocity of side {side} {note}", dimensions=(*instants, 3)
        )
    yield output(f"{where}.points.traction", "Pa", "traction on the first side at the points", dimensions=(n_point, 3))
    yield output(
        f"{where}.points.velocity", "m s-1", "velocity of both sides at the points", dimensions=(2, n_point, 3)
    )
    if not opens(scene.interface[name].behaviour):
        return
    yield output(f"{where}.window.gap", "m", f"mean gap {note}", dimensions=instants)
    for key in ("closed", "sticking", "slipping"):
        yield output(f"{where}.window.{key}", "1", f"share of the area {key} {note}", dimensions=instants)
    yield output(f"{where}.points.gap", "m", "gap at the points", dimensions=(n_point,))
    yield output(
        f"{where}.points.status",
        "1",
        "contact status at the points: separation 0, stick 1, slip 2",
        dimensions=(n_point,),
    )
