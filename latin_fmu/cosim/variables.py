"""The variable table of a scene: everything that a co-simulation sets or reads.

Scalars come first (all of FMI 2), then arrays (FMI 3 only). The order is the value reference. Names are structured,
components are counted from 1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from ..scene.describe import unit_at
from ..scene.overrides import number_at
from ..scene.ports import COMPONENTS, indexed
from ..scene.schema import Scene
from ..scene.settings import MAX_ITERATIONS
from .input_table import given_of
from .output_table import AT_POINTS, marched_by_modes, outputs_of
from .variable import UNITS, Kind, Variable, input_variable, output, parameter, variable_of

WINDOWED, PRESCRIBED = 0, 1
HOLD = 0
RATE = 1
LINE = 2
CAUSAL = 3
MAX_WINDOW = 100_000  # instants
HISTORY = 101  # instants of the load histories, where the host sets no size: one array element each
_INSTANTS = ("window.size",)


def scalar_table(scene: Scene) -> tuple[Variable, ...]:
    """Scalar variables of a scene (all of FMI 2); the outputs of contact events are the last."""
    inputs = given_of(scene)
    depends = tuple(input_variable(source.name, "value") for source in inputs)
    rows: list[Variable] = [
        Variable("time", "independent", "continuous", "real", "time since the start of the scene", "s"),
        *_parameters(scene),
    ]
    rows += tunables_of(scene)
    for source in inputs:
        rows += source.variables()
    rows += _impedances(scene)
    for placed in outputs_of(scene):
        rows += placed.variables(depends)
    return tuple(rows)


_MEANINGS: Final[Mapping[str, str]] = {
    "mode": "0: windowed, every step solves its own interval with the inputs given; 1: prescribed, the whole interval "
    "is solved from given histories when initialization ends and played back",
    "inputInterpolation": "load inside a step. 0: held at the value; 1: value + rate x time since the start of the "
    "step; 2: straight line from the end of the last step to the value, reached at the end of this step; 3: as 1 "
    "for a load once a rate other than 0 was set, else the straight line through its last two values; held over the "
    "first step and over a step that begins with a jump after two equal values. The incident wave of a port follows "
    "2, unless this is 0 or its rate is set",
    "timeStep": "time step of the run; communication steps may be of any length",
    "endTime": "end of the interval solved in prescribed mode, an integer multiple of timeStep",
    "tolerance": "tolerance on the error indicator sqrt(eta); replaced by a fifth of the tolerance of the importer",
    "maxIterations": "largest number of iterations of a window",
    "historyFile": "prescribed mode: CSV or netCDF file with a time column or coordinate and one column or variable "
    "per input, called as it is without load. and .value: NAME of a load, gravity.acceleration, boundary.NAME, ...; "
    "or the CSV table itself, its rows separated by line breaks or semicolons: time,NAME;0,0;1e-6,1",
    "resultsFile": "netCDF file written when the simulation is terminated, holding accepted steps only; nothing where "
    "empty",
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
        ("maxIterations", "integer", solver.max_iterations, None, 1, MAX_ITERATIONS),
        ("historyFile", "string", "", None, None, None),
        ("resultsFile", "string", "", None, None, None),
    )
    for name, kind, start, unit, minimum, maximum in rows:
        yield parameter(name, kind, start, _MEANINGS[name], unit=unit, minimum=minimum, maximum=maximum)
    tables = scene.tables() if scene.fmu.parameters else {}
    for name in scene.fmu.parameters:
        unit = unit_at(Scene, name)
        if unit in UNITS:
            words = f"{name} of the scene"
        else:
            words, unit = f"{name} of the scene, {unit or 'without unit'}", None
        yield parameter(name, "real", number_at(tables, name) or 0.0, words, unit=unit)


def tunables_of(scene: Scene) -> Iterator[Variable]:
    """Coefficients of friction, which the local stage alone knows: a host may change them between communication steps.

    None where such a number is among ``fmu.parameters``: it is one of the scene then, which is set before the start.
    """
    if any(name.endswith("friction_coefficient") for name in scene.fmu.parameters):
        return
    for name, interface in scene.joints.items():
        if interface.behaves_open and interface.friction_coefficient > 0.0:
            about = f"coefficient of friction of interface {name} from the next step on; a static start has the scene's"
            start = float(interface.friction_coefficient)
            yield Variable(
                f"interface.{name}.friction_coefficient", "parameter", "tunable", "real", about, "1", start, minimum=0.0
            )


def _impedances(scene: Scene) -> Iterator[Variable]:
    """Impedances of the components of wave ports."""
    words = ("impedance", "rotationalImpedance")
    for name, port in scene.port.items():
        # other ports have components and no impedance
        for component, impedance in zip(port.components, port.impedance or (), strict=bool(port.impedance)):
            turned = COMPONENTS.index(component) // 3
            if turned:
                unit, about = "N m s", ", of a rotation"
            else:
                unit, about = "N s m-1", ""
            text = f"impedance Z of port {name}{about}, {component[-1]}"
            yield Variable(indexed(name, words, component), "local", "constant", "real", text, unit, impedance)


_OVER_THE_OTHER: Final = (
    "velocity of the first side at the points, between bodies that over the second side, and that of the ground"
)


def table_of(scene: Scene, n_point: Mapping[str, int] | None = None) -> tuple[Variable, ...]:
    """The variable table: scalars, and arrays where the number of points of each interface is given."""
    if n_point is None:
        return scalar_table(scene)
    return (*scalar_table(scene), *_arrays(scene, n_point))


# -- arrays (FMI 3) ----------------------------------------------------------------------------------------------
def _arrays(scene: Scene, n_point: Mapping[str, int]) -> Iterator[Variable]:
    """Arrays of a scene: load histories, instants of a window, fields of points. ``n_point`` : number of points of each
    interface whose points are marched."""
    for name, start, meaning in (
        ("window.size", scene.time.n_step + 1, "number of instants the arrays of a window can hold"),
        ("history.size", HISTORY, "number of elements of the load histories of prescribed mode"),
    ):
        yield Variable(
            name, "structuralParameter", "fixed", "count", meaning, None, start, minimum=1, maximum=MAX_WINDOW
        )
    size = ("history.size",)
    sources = given_of(scene)
    if sources:
        about = (
            "instants of the load histories, increasing; the last is repeated up to the size of the array; all equal"
        )
        yield parameter("history.time", "real", 0.0, f"{about}: none given", unit="s", dimensions=size)
    for source in sources:
        about = f"amplitudes of {variable_of(source.name).replace('.', ' ', 1)} at history.time"
        name = input_variable(source.name, "history")
        yield parameter(name, "real", source.start, about, unit=source.words[0], dimensions=size)
    about = "number of instants of the window, its start included"
    yield output("window.count", "1", about, minimum=0.0, follows_inputs=False)
    about = "instants of the window, 0 beyond the last"
    yield output("window.time", "s", about, dimensions=_INSTANTS, follows_inputs=False)
    for placed in outputs_of(scene):
        if placed.row.over_window:
            what, n = f"{placed.row.over_window} at the instants of the window, 0 beyond the last", len(placed.names)
            where, _, name = placed.stem.rpartition(".")
            sizes: tuple[str | int, ...] = _INSTANTS
            if n > 1:
                sizes = (*_INSTANTS, n)
            yield output(f"{where}.window.{name}", placed.row.unit, what, dimensions=sizes)
    for placed in outputs_of(scene):
        if (n := len(placed.names)) > 1:
            about = placed.about
            yield output(placed.vector, placed.row.unit, f"{about}: {', '.join(placed.along)}", dimensions=(n,))
    for name, interface in scene.joints.items():
        for what, (unit, meaning, shape) in AT_POINTS.items():
            if name in n_point and (len(shape) > 1 or interface.behaves_open):
                if what == "velocity" and marched_by_modes(scene):
                    meaning = _OVER_THE_OTHER
                numbers = tuple(k or n_point[name] for k in shape)
                yield output(f"interface.{name}.points.{what}", unit, meaning, dimensions=numbers)
