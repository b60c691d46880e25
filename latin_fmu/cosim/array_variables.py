"""The arrays of the variable table (FMI 3): instants of a window, fields of points, load histories."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ..interface.registry import opens
from ..scene.schema import Scene
from .variable import Variable, output, parameter

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
