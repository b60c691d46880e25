"""The same scene on another mesh, with another time step or tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..scene.schema import Scene
from ..scene.solver_settings import WHOLE


@dataclass(frozen=True)
class Resolution:
    """How fine a run is: elements per length and steps per time, relative to the scene as written.

    ``tolerance`` on sqrt(eta); that of the scene where None.
    """

    mesh: float = 1.0
    time: float = 1.0
    tolerance: float | None = None


def meshed_by_the_program(scene: Scene) -> bool:
    """Whether every substructure is a box, whose mesh can be changed."""
    return all(body.box is not None for body in scene.substructure.values())


def counts_that_vary(scene: Scene) -> list[int]:
    """Numbers of elements other than one: those that a change of the mesh scales.

    One element across says that nothing varies in that direction.
    """
    boxes = [body.box for body in scene.substructure.values() if body.box is not None]
    return [n for box in boxes for n in box.elements if n > 1]


def at_resolution(scene: Scene, resolution: Resolution) -> Scene:
    """The scene with numbers of elements and steps multiplied, stripped of what quantities do not need.

    The time step is divided by ``resolution.time`` exactly; the last instant falls at the end or less than a step
    after it. One element across stays one.

    Raises
    ------
    SceneError : the mesh or the number of steps leaves the range of a scene.
    """
    changes: dict[str, object] = {"output": _lean(scene)}
    if resolution.mesh != 1.0:
        changes["substructure"] = {
            name: body
            if body.box is None
            else body.model_copy(
                update={"box": body.box.model_copy(update={"elements": _scaled(body.box.elements, resolution.mesh)})}
            )
            for name, body in scene.substructure.items()
        }
    if resolution.time != 1.0:
        n = max(1, math.ceil(scene.time.n_step * resolution.time - 1e-6))
        step = scene.time.time_step / resolution.time
        changes["time"] = scene.time.model_copy(update={"end": n * step, "step": None, "instants": n})
    if resolution.tolerance is not None:
        changes["solver"] = with_tolerance(scene, resolution.tolerance)
    return scene.model_copy(update=changes)


def with_tolerance(scene: Scene, tolerance: float) -> object:
    """Solver settings with another tolerance; a force tolerance that was given keeps its ratio to it."""
    solver = scene.solver
    update: dict[str, object] = {"tolerance": tolerance}
    if solver.force_tolerance is not None:
        update["force_tolerance"] = solver.force_tolerance * tolerance / solver.tolerance
    return solver.model_copy(update=update)


def in_short_windows(scene: Scene) -> Scene:
    """Windows of one instant where the whole interval was one: the same answer, far fewer passes."""
    if scene.solver.window != WHOLE:
        return scene
    update = {"window": 1, "acceleration": type(scene.solver)().acceleration}
    return scene.model_copy(update={"solver": scene.solver.model_copy(update=update)})


def _scaled(elements: tuple[int, int, int], factor: float) -> tuple[int, ...]:
    return tuple(n if n == 1 else max(1, math.floor(n * factor + 0.5)) for n in elements)


def _lean(scene: Scene) -> object:
    fields = bool(scene.sensor)
    return type(scene.output)(fields=fields)
