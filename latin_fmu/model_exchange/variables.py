"""Variables of a reduced model: those it shares with co-simulation, then states, their derivatives, event indicators.

The place in the table is the value reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..cosim.variable import Variable, output, parameter
from ..cosim.variables import ENERGIES, scalar_table
from ..cosim.variables import EVENTS as CONTACT_EVENTS
from ..scene.schema import Scene
from .contact_law import Regularisation
from .system import DAMPING, ENERGY_NAMES, EVENTS, SLIDING, STIFFNESS, WORKS, Local, Names, ReducedSystem


def names_of(scene: Scene, system: ReducedSystem, starts: Sequence[float], nominals: Sequence[float]) -> Names:
    """Variables of the reduced model of a scene.

    starts, nominals : of all states, in their order.
    """
    table = tuple(_table(scene, Regularisation.of(system)))
    place = {v.name: i for i, v in enumerate(table)}
    read = [f"interface.{name}.impulse[{axis}]" for name in system.interfaces for axis in (1, 2, 3)]
    read += [f"energy.{name}" for name in WORKS] if scene.output.energy else []
    rows = list(_coordinates(system, starts, nominals))
    states = [*range(len(table), len(table) + len(rows)), *(place[name] for name in read)]
    named = [*((v.name, v.unit) for v in rows), *((name, table[place[name]].unit or "1") for name in read)]
    first = len(table) + len(rows)
    for reference, (name, unit) in zip(states, named, strict=True):
        rate = {"m": "m s-1", "m s-1": "m s-2", "N s": "N", "J": "W"}[unit]
        rows.append(Local(f"der({name})", rate, f"time derivative of {name}", derivative_of=reference))
    second = len(table) + len(rows)
    rows += _indicators(system)
    return Names(table, tuple(rows), tuple(states), first, second)


def _table(scene: Scene, default: Regularisation) -> Iterator[Variable]:
    counted = tuple(f".{word}" for count, (instant, _) in CONTACT_EVENTS.items() for word in (count, instant))
    rows = [row for row in scalar_table(scene) if not row.name.endswith(counted)]
    stiffness = (
        "stiffness of the contact over the static stiffness of the two bodies under uniform pressure: they penetrate "
        "by 1 / this of their static shortening"
    )
    damping = (
        "damping of the contact: part of the pressure taken off where the bodies leave each other at their "
        "characteristic velocity"
    )
    sliding = "sliding velocity below which a patch sticks: it creeps instead of resting"
    yield rows[0]
    yield parameter(STIFFNESS, "real", default.stiffness, stiffness, unit="1", minimum=0.0)
    yield parameter(DAMPING, "real", default.damping, damping, unit="1", minimum=0.0)
    yield parameter(SLIDING, "real", default.sliding, sliding, unit="m s-1", minimum=0.0)
    yield from (row for row in rows if row.causality == "input")
    for row in rows:
        if row.causality == "output" and row.name.startswith(("interface.", "sensor.")):
            share = row.name.endswith((".closed", ".sticking", ".slipping"))
            yield replace(row, variability="discrete" if share else row.variability, initial_dependencies=())
    if scene.output.energy:
        yield from (output(f"energy.{name}", "J", text) for name, text in _energies().items())
    yield replace(output(EVENTS, "1", "changes of contact states since the start", minimum=0.0), variability="discrete")


def _energies() -> dict[str, str]:
    texts = {
        **ENERGIES,
        "contact": "energy stored in the springs of the contacts",
        "contact_dissipation": "energy dissipated by the damping of the contacts since the start",
    }
    return {name: texts[name] for name in ENERGY_NAMES}


def _coordinates(system: ReducedSystem, starts: Sequence[float], nominals: Sequence[float]) -> Iterator[Local]:
    number = 0
    for kind, unit in (("displacement", "m"), ("velocity", "m s-1")):
        for body, size in zip(system.bodies, system.sizes, strict=True):
            for i in range(1, size + 1):
                text = f"{kind} of Ritz vector {i} of {body}, scaled by the root of its mass"
                yield Local(f"modes.{body}.{kind}[{i}]", unit, text, float(starts[number]), float(nominals[number]))
                number += 1


def _indicators(system: ReducedSystem) -> Iterator[Local]:
    owners = [system.interfaces[int(i)] for i in system.contacts.owner]
    numbers = [owners[: i + 1].count(o) for i, o in enumerate(owners)]
    for key, text in (
        ("gapIndicator", "distance of patch {} of {} from opening or closing, in penetrations under the load"),
        ("slidingIndicator", "distance of patch {} of {} from stick or slip, in slidingVelocity"),
    ):
        for owner, number in zip(owners, numbers, strict=True):
            yield Local(f"interface.{owner}.{key}[{number}]", "1", text.format(number, owner))
