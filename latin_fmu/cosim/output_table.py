"""The outputs of a co-simulation, one row each.

A row says how an output is called, its unit and meaning, its numbers, and how it follows from the signals of an instant
(``signals``): by a linear function, or from another output: its integral over time, what it is behind a causal filter,
its largest length so far. What is neither is written by the kernels (``kernels.outputs.WRITTEN``). Variables, the
record of the run that Python and C march, arrays over a window, results and derivatives follow from the rows, in their
order.

Contact events are touch, separation and slip: how many there were, and the instant of the last one. An event belongs to
an interface as a whole and lies in the time step from t_(j-1) to t_j in which its state changes:

=============  ====================================  ===============================================================
event          state at t_(j-1), at t_j              instant, kept inside the time step
=============  ====================================  ===============================================================
touch          no point in contact, some             t_(j-1) + min over the points in contact at t_j of g / v
separation     some point in contact, none           t_(j-1) + N / (-dN/dt)
slip           some point in contact sticks, none    t_(j-1) + (q_j - q) / (dq/dt), q = |T| / N
=============  ====================================  ===============================================================

g is the gap at a point and v the speed at which it closes; N and T are the normal and the tangential resultant, and q_j
is on the friction cone. Values without index are those at t_(j-1), rates of N and q those over the time step before it.
Each instant is where a straight line reaches the state that the event begins: its error is of second order in the time
step where g, N or q are smooth before the event. Where the line does not reach it the instant is t_j.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from ..interface.laws import SEPARATION, SLIP, STICK
from ..latin.outcome import Array, InterfaceHistory
from ..results.quantities import ENERGY as _TERMS
from ..scene.boundaries import Driven, Fixed
from ..scene.interfaces import Interface
from ..scene.laws import InputLaw
from ..scene.ports import COMPONENTS, Port
from ..scene.schema import Scene
from ..scene.sensors import LowPass, Sensor
from ..scene.settings import ModalPropagatorTable
from .variable import AXES, Variable, output


def marched_by_modes(scene: Scene) -> bool:
    """Whether communication steps march the assembly of a scene by its modes: where the scene demands it."""
    return isinstance(scene.solver.propagator, ModalPropagatorTable)


class FacePoints(NamedTuple):
    """Fields of an interface at n instants, and its faces.

    traction : (n, n_point, 3) on side E, Pa. velocity : (n, 2, n_point, 3), m s-1. gap : (n, n_point), m. status : (n,
    n_point). areas : (n_point,), m2. share : of the whole area. normals : (n_point, 3).
    """

    traction: Array
    velocity: Array
    gap: Array
    status: Any
    areas: Array
    share: Array
    normals: Array

    @classmethod
    def over(cls, history: InterfaceHistory) -> FacePoints:
        """At the instants of a history; nothing for what it lacks."""
        fields = history.points_over_time
        areas = history.areas
        nothing = np.zeros(0)
        if fields.gap is None:
            gap = nothing
        else:
            gap = fields.gap
        columns = fields.traction, fields.velocity, gap, fields.contact_status
        return cls(*columns, areas, areas / areas.sum(), history.normals)

    def means(self) -> Array:
        """Mean velocities of both sides, weighted by area, (n, 2, 3), m s-1."""
        means: Array = np.einsum("p,tspc->tsc", self.share, self.velocity)
        return means


def _scalar(_: Any) -> Sequence[int | None]:
    return (None,)


def _vector(_: Any) -> Sequence[int | None]:
    return 0, 1, 2


def _connected(causality: str, turned: int) -> Callable[[Port], Sequence[int | None]]:
    """Axes of the connected translations (0) or rotations (1) of the ports of a causality."""

    def axes(port: Port) -> Sequence[int | None]:
        numbers = [COMPONENTS.index(c) for c in port.components if port.causality == causality]
        return [number % 3 for number in numbers if number // 3 == turned]

    return axes


def _measured(turned: int) -> Callable[[Port], Sequence[int | None]]:
    """Axes of the motion of a port, which is measured where it is not set."""
    # ``rotates`` is 0 or 1: velocities always, angular ones of ports that turn
    return lambda port: () if port.causality == "motion_in" or turned > port.rotates else (0, 1, 2)


def _opening(interface: Interface) -> Sequence[int | None]:
    """A number of an interface that can open."""
    if interface.behaves_open:
        return (None,)
    return ()


@dataclass(frozen=True)
class OutputKind:
    """A row of the table.

    Attributes
    ----------
    name : last part of the name. unit : UDUNITS, empty for a whole number, which changes at events. meaning : with the
        words of the family in braces.
    of : of an interface the values, (n,) or (n, 3), from ``FacePoints``: linear in its fields, as the rows over the
        signals are made from unit fields, but for names in ``kernels.outputs.WRITTEN``; else rows over the signals,
        (1, n_signal) or (3, n_signal), from ``Signals`` and the name of the owner. None: integral, or written by the
        kernels.
    axes : axes of its numbers from the owner, a table of the scene; None for a scalar; empty where it has no such
        output.
    integral : of the output before it since the start, by the trapezoidal rule.
    at_start : whether it depends on inputs when initialization ends. least, most : limits. constant : whether its
        derivatives by inputs are 0. of_clock : whether it follows from the lengths of the steps alone.
    largest : name of the output of the owner whose largest length since the start it is, empty for none. filtered :
        whether it is the output before it behind the filter of the owner.
    over_window : meaning of the array over the instants of a window; none where empty. along : words for the axes.
    lag : half of a part that explicit schemes take as the mean over the last two instants, likewise; None: none.
    """

    name: str
    unit: str
    meaning: str
    of: Callable[..., Any] | None = None
    axes: Callable[[Any], Sequence[int | None]] = _scalar
    integral: bool = False
    at_start: bool = False
    least: float | None = None
    most: float | None = None
    constant: bool = False
    of_clock: bool = False
    over_window: str = ""
    largest: str = ""
    filtered: bool = False
    along: Sequence[str] = AXES
    lag: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Family:
    """Outputs of one kind of table. prefix : of the names. owners : of a scene, by name. words : of the meanings, from
    name and owner. rows : in their order."""

    prefix: str
    owners: Callable[[Scene], Mapping[str, Any]]
    words: Callable[[str, Any], Mapping[str, str]]
    rows: tuple[OutputKind, ...]

    def row(self, name: str) -> OutputKind:
        """The row of a name."""
        return next(row for row in self.rows if row.name == name)


def _largest(name: str, unit: str, meaning: str, of: str) -> OutputKind:
    """The largest length so far of another output of the owner."""
    return OutputKind(name, unit, meaning, least=0.0, constant=True, largest=of)


def _share(name: str, text: str, chosen: Callable[[Any], Any]) -> OutputKind:
    about, window = f"share of the area {text}", f"share of the area {name}"
    limits: Any = {"at_start": True, "least": 0.0, "most": 1.0, "constant": True, "over_window": window}
    return OutputKind(name, "1", about, lambda p: chosen(p.status) @ p.share, _opening, **limits)


INTERFACE: Final = Family(
    "interface.{}.",
    lambda scene: scene.joints,
    lambda name, interface: {"name": name, "first": interface.sides[0], "second": interface.sides[1]},
    (
        OutputKind(
            *("force", "N", "resultant force of interface {name} on {first}"),
            *(lambda p: np.einsum("p,tpc->tc", p.areas, p.traction), _vector),
            at_start=True,
            over_window="resultant force on the first side",
        ),
        OutputKind(
            "impulse", "N s", "time integral of the resultant force since the start", None, _vector, integral=True
        ),
        OutputKind(
            *("velocityE", "m s-1", "mean velocity of {first}, weighted by area", lambda p: p.means()[:, 0], _vector),
            over_window="mean velocity of side E",
        ),
        OutputKind(
            *("velocityEp", "m s-1", "mean velocity of {second}, weighted by area", lambda p: p.means()[:, 1], _vector),
            over_window="mean velocity of side Ep",
        ),
        OutputKind(
            *("relativeVelocity", "m s-1", "mean velocity of {second} relative to {first}"),
            *(lambda p: p.means()[:, 1] - p.means()[:, 0], _vector),
        ),
        OutputKind(
            *("normalForce", "N", "normal resultant, positive in compression"),
            lambda p: 0.0 - np.einsum("p,tpc,pc->t", p.areas, p.traction, p.normals),  # no negative zero
            at_start=True,
        ),
        _largest("largestForce", "N", "largest resultant force of interface {name} so far", "force"),
        OutputKind(
            *("gap", "m", "mean gap, weighted by area; negative where the sides penetrate"),
            *(lambda p: p.gap @ p.share, _opening),
            over_window="mean gap",
        ),
        OutputKind("smallestGap", "m", "smallest gap of all points", lambda p: p.gap.min(axis=1), _opening),
        _share("closed", "in contact", lambda status: status != SEPARATION),
        _share("sticking", "in contact and sticking", lambda status: status == STICK),
        _share("slipping", "in contact and slipping", lambda status: status == SLIP),
    ),
)


def _read(method: str, *what: Any) -> Callable[..., Any]:
    """Rows that a method of ``Signals`` gives for an owner."""
    return lambda signals, name: getattr(signals, method)(name, *what)


def _of_sensor(name: str, sensor: Sensor) -> Mapping[str, str]:
    return {"about": f"of sensor {name}, " + (f"mean of {sensor.face}" if sensor.face else f"a point of {sensor.body}")}


def _through_causal(sensor: Sensor) -> Sequence[int | None]:
    """Axes of what is behind the filter of a sensor, where that needs nothing that is to come."""
    if isinstance(sensor.filter, LowPass) and not sensor.filter.phaseless:
        return _vector(sensor)
    return ()


_MOTIONS: Final = (("displacement", "m"), ("velocity", "m s-1"), ("acceleration", "m s-2"))


def _motions(first: int, end: int) -> Iterator[OutputKind]:
    """Displacement (0), velocity (1), acceleration (2) of a sensor, behind its filter, and their largest so far."""
    for kind, (name, unit) in list(enumerate(_MOTIONS))[first:end]:
        yield OutputKind(name, unit, f"{name} {{about}}", _read("motion", kind), _vector)
        if kind == ACCELERATION:
            about = f"{name} {{about}}, behind its filter"
            yield OutputKind(f"{name}Filtered", unit, about, axes=_through_causal, filtered=True)
        yield _largest(f"largest{name.capitalize()}", unit, f"largest {name} {{about}}, so far", name)


ACCELERATION: Final = 2
SENSOR: Final = Family("sensor.{}.", lambda scene: scene.sensor, _of_sensor, tuple(_motions(0, ACCELERATION)))
ACCELERATED: Final = Family(
    "sensor.{}.",
    lambda scene: {} if scene.time.quasi_static else scene.sensor,
    _of_sensor,
    tuple(_motions(ACCELERATION, ACCELERATION + 1)),
)


def base_of(scene: Scene) -> str | None:
    """The face that drives a scene as a base; None where there is none. Faces are a base where all of them are driven
    alike and nothing else is held along the same axes: then one of them is as good as another."""
    driven = {name: table for name, table in scene.boundary.items() if isinstance(table, Driven)}
    if not driven or any(table.axes is not None for table in driven.values()):
        return None
    alike = {repr((t.type, t.components, t.value, t.law)) for t in driven.values()}
    first = next(iter(driven.values()))
    apart = len(driven) > 1 and isinstance(first.law, InputLaw)  # each may be set to another value
    held = [table for table in scene.boundary.values() if isinstance(table, Fixed)]
    if len(alike) > 1 or apart or any(t.axes or set(t.components) & set(first.components) for t in held):
        return None
    return first.face


BASE: Final = "boundary.base"
"""Name of the sensor on the base that relative motions are measured from."""


def measured(scene: Scene) -> Scene:
    """The scene with a sensor on its base, where outputs are relative to it; histories leave out names with a dot."""
    base = base_of(scene)
    if base is None or not scene.sensor:
        return scene
    return scene.model_copy(update={"sensor": {**scene.sensor, BASE: Sensor(face=base)}})


def _relative_to_base(kind: int) -> Callable[..., Any]:
    return lambda signals, name: signals.motion(name, kind) - signals.motion(BASE, kind)


def _relative(first: int, end: int) -> tuple[OutputKind, ...]:
    return tuple(
        OutputKind(f"relative{name.capitalize()}", unit, f"{name} {{about}}, relative to the base", of, _vector)
        for (name, unit), of in zip(_MOTIONS[first:end], map(_relative_to_base, range(first, end)), strict=True)
    )


RELATIVE: Final = Family(
    "sensor.{}.",
    lambda scene: {} if base_of(scene) is None else scene.sensor,
    _of_sensor,
    (
        *_relative(0, 2),
        _largest(
            "largestRelativeDisplacement",
            "m",
            "largest displacement {about}, relative to the base, so far",
            "relativeDisplacement",
        ),
    ),
)


def _pair(causality: str, method: str, what: tuple[Any, ...], *words: tuple[str, str, str]) -> Iterator[OutputKind]:
    """Of ports of a causality what a method of ``Signals`` gives for translations and for rotations."""
    for turned, (name, unit, meaning) in enumerate(words):
        of, axes = _read(method, turned, *what), _connected(causality, turned)
        lag = None
        if method == "exerted":
            lag = _read("half_before", turned)
        yield OutputKind(name, unit, meaning, of, axes, at_start=True, lag=lag)


PORT: Final = Family(
    "port.{}.",
    lambda scene: scene.port,
    lambda name, _: {"name": name},
    (
        *_pair(
            *("motion_in", "exerted", ()),
            ("force", "N", "force that the body exerts through port {name}"),
            ("moment", "N m", "moment that the body exerts through port {name}, about its centre"),
        ),
        OutputKind("displacement", "m", "displacement of port {name}", _read("port_motion", 0, 0), _measured(0)),
        OutputKind("velocity", "m s-1", "velocity of port {name}", _read("port_motion", 0, 1), _measured(0)),
        OutputKind("rotation", "rad", "rotation of port {name}", _read("port_motion", 1, 0), _measured(1)),
        OutputKind(
            "angularVelocity", "rad s-1", "angular velocity of port {name}", _read("port_motion", 1, 1), _measured(1)
        ),
        *_pair(
            *("wave", "wave", (1.0,)),
            ("force", "N", "force on the body through port {name}"),
            ("moment", "N m", "moment on the body through port {name}, about its centre"),
        ),
        *_pair(
            *("wave", "wave", (-1.0,)),
            ("reflected", "N", "reflected wave Z v - F of port {name}, incident on the port on the other side"),
            ("reflectedMoment", "N m", "reflected wave Z omega - M of port {name}, incident on the other side"),
        ),
    ),
)
_ACROSS: Final = "first direction across its axis", "second direction across its axis"


def _across(_: Any) -> Sequence[int | None]:
    return 0, 1


BOLT: Final = Family(
    "bolt.{}.",
    lambda scene: scene.bolt,
    lambda name, bolt: {"name": name, "body": bolt.substructure},
    (
        OutputKind("force", "N", "tension of bolt {name} in {body}", _read("shank", (0,)), at_start=True),
        OutputKind(
            *("shearForce", "N", "shear force of bolt {name} at its cut", _read("shank", (1, 2)), _across),
            along=_ACROSS,
            at_start=True,
        ),
        OutputKind("torsion", "N m", "torsion of bolt {name} at its cut", _read("shank", (3,)), at_start=True),
        OutputKind(
            *("bendingMoment", "N m", "bending moment of bolt {name} at its cut", _read("shank", (4, 5)), _across),
            along=_ACROSS,
            at_start=True,
        ),
        _largest("largestForce", "N", "largest tension of bolt {name} so far", "force"),
        _largest("largestShearForce", "N", "largest shear force of bolt {name} at its cut so far", "shearForce"),
        _largest(
            "largestBendingMoment", "N m", "largest bending moment of bolt {name} at its cut so far", "bendingMoment"
        ),
    ),
)


def _solver(name: str, unit: str, meaning: str, **more: Any) -> OutputKind:
    return OutputKind(name, unit, meaning, constant=True, **more)


SOLVER: Final = Family(
    "",
    lambda scene: {"": scene},
    lambda _name, _scene: {},
    (  # written by the kernels, and summed up in C, as one block in this order
        _solver("solver.iterations", "1", "iterations of the last step, over all its windows", least=0.0),
        _solver("solver.errorIndicator", "1", "largest error indicator sqrt(eta) of the windows of the last step"),
        _solver(
            "solver.converged", "1", "1 where every window of the last step converged, else 0", least=0.0, most=1.0
        ),
        _solver(
            *("solver.instants", "1", "time steps that ended in the last communication step that ended some"),
            least=0.0,
            of_clock=True,
        ),
        _solver(
            *(
                "innerTime",
                "s",
                "instant of the outputs: the last of the time steps not beyond the communication point",
            ),
            of_clock=True,
        ),
    ),
)


def _energy(name: str, *parts: str) -> OutputKind:
    """A sum of ``kernels.outputs.ENERGIES``, those less that begin with -; of the one of its name without any."""
    meaning = _TERMS[name].meaning.removesuffix(" of the run")
    return OutputKind(name, "J", meaning, lambda signals, _: signals.energies(parts or (name,)))


def follows_energies(scene: Scene) -> bool:
    """Whether energies are outputs: asked for, and of bodies that are marched themselves."""
    return scene.output.energy and not marched_by_modes(scene)


ENERGY: Final = Family(
    "energy.",
    lambda scene: {"": scene} if follows_energies(scene) else {},
    lambda _name, _scene: {},
    (
        _energy("kinetic"),
        _energy("elastic"),
        _energy("prestress"),
        _energy("work_of_loads"),
        _energy("interface_work"),
        _energy("friction_dissipation"),
        _energy("damping_dissipation"),
        _energy("landing_dissipation"),
        _energy("scheme_dissipation"),
        _energy(
            *("balance", "kinetic", "elastic", "prestress", "-start", "damping_dissipation"),
            *("landing_dissipation", "scheme_dissipation", "-work_of_loads", "-interface_work"),
        ),
    ),
)


def _event(count: str, instant: str, becomes: str) -> tuple[OutputKind, OutputKind]:
    """How many events there were, and the instant of the last one."""
    about = f"number of times that the interface became {becomes}"
    last = f"instant of the last of interface.{{name}}.{count}; 0 before the first"
    of_count = OutputKind(count, "", about, None, _opening, least=0.0, constant=True)
    return of_count, OutputKind(instant, "s", last, None, _opening, constant=True)


EVENTS: Final = Family(
    "interface.{}.",
    lambda scene: scene.joints,
    lambda name, _: {"name": name},
    (
        *_event("touches", "lastTouch", "in contact, after none of its points was"),
        *_event("separations", "lastSeparation", "open at all points, after one was in contact"),
        *_event("slips", "lastSlip", "slipping at all points in contact, after one stuck"),
    ),
)
FAMILIES: Final = INTERFACE, SENSOR, ACCELERATED, RELATIVE, PORT, BOLT, SOLVER, ENERGY, EVENTS
"""In the order of the outputs; those of events are the last."""
AT_POINTS: Final[Mapping[str, tuple[str, str, tuple[int, ...]]]] = {
    "traction": ("Pa", "traction on the first side at the points", (0, 3)),
    "velocity": ("m s-1", "velocity of both sides at the points", (2, 0, 3)),
    "gap": ("m", "gap at the points", (0,)),
    "status": ("1", "contact status at the points: separation 0, stick 1, slip 2", (0,)),
}
"""Unit, meaning and shape of the arrays ``interface.NAME.points``, with 0 for the number of points; the numbers of an
interface that can open alone are the last. Their order is that of ``signals``."""


class Placed(NamedTuple):
    """A row of an owner."""

    family: Family
    name: str
    owner: Any
    row: OutputKind

    @property
    def stem(self) -> str:
        """Name of the output, without the number of its axis."""
        return f"{self.family.prefix.format(self.name)}{self.row.name}"

    @property
    def vector(self) -> str:
        """Name of the array of its numbers."""
        return f"{self.family.prefix.format(self.name)}vector.{self.row.name}"

    @property
    def about(self) -> str:
        """What it means, with the words of its owner."""
        return self.row.meaning.format(**self.family.words(self.name, self.owner))

    @property
    def along(self) -> list[str]:
        """Words for its numbers."""
        return [self.row.along[axis] for axis in self.row.axes(self.owner) if axis is not None]

    @property
    def names(self) -> list[str]:
        """Names of its numbers, axes counted from 1."""
        return [self.stem if axis is None else f"{self.stem}[{axis + 1}]" for axis in self.row.axes(self.owner)]

    def variables(self, inputs: tuple[str, ...]) -> Iterator[Variable]:
        """Its numbers as variables. inputs : names of the values that are set from outside."""
        row, about = self.row, self.about
        for name, axis in zip(self.names, row.axes(self.owner), strict=True):
            if axis is None:
                text = about
            else:
                text = f"{about}, {row.along[axis]}"
            if not row.unit:
                yield Variable(name, "output", "discrete", "integer", text, minimum=row.least)
                continue
            if row.at_start:
                depends = inputs
            else:
                depends = ()
            limits = {"minimum": row.least, "maximum": row.most}
            yield output(name, row.unit, text, **limits, initial_dependencies=depends, follows_inputs=not row.of_clock)


def outputs_of(scene: Scene) -> Iterator[Placed]:
    """Every row of a scene, in the order of its outputs."""
    for family in FAMILIES:
        for name, owner in family.owners(scene).items():
            yield from (Placed(family, name, owner, row) for row in family.rows if row.axes(owner))


def places_of(scene: Scene) -> dict[str, int]:
    """Place of every scalar output in a row of outputs, by name."""
    names = [name for placed in outputs_of(scene) for name in placed.names]
    return {name: place for place, name in enumerate(names)}


def places_from(family: Family, placed: Placed, name: str, places: Mapping[str, int]) -> list[int]:
    """Places of another output of the owner of a row, a row of a family of that owner."""
    return [places[number] for number in Placed(family, placed.name, placed.owner, family.row(name)).names]


def first_of_events(places: Mapping[str, int]) -> int:
    """Place of the first output of contact events, the number of outputs where there is none."""
    return min(
        (place for name, place in places.items() if name.endswith(f".{EVENTS.rows[0].name}")), default=len(places)
    )
