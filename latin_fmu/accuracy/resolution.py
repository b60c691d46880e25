"""A scene on another mesh, with another time step or tolerance; the error of loads sampled at its time steps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..assembly.build import discretise
from ..fem.elements import wave_speeds
from ..scene.boundaries import AXES
from ..scene.fields import split_face
from ..scene.laws import InputLaw, RectangularPulseLaw, StepLaw, sampled_impulse_error
from ..scene.schema import Scene
from ..scene.settings import WHOLE, AutomaticScheme, GeneralizedAlphaTable, HHTTable
from ..scene.substructures import MAX_REFINEMENTS, MeshFile, Substructure

FEWEST_STEPS: Final = 8
"""Least number of time steps of a coarser run."""
_MOST_KEPT: Final = 50_000  # instants of interface histories, about


@dataclass(frozen=True)
class Resolution:
    """How fine a run is: elements per length and steps per time, relative to the scene as written.

    ``tolerance`` on sqrt(eta); that of the scene where None.
    """

    mesh: float = 1.0
    time: float = 1.0
    tolerance: float | None = None


def mesh_files(scene: Scene) -> list[MeshFile]:
    """Meshes from files: they can be refined, and be coarser again, but not coarser than the file."""
    return [body.mesh for body in scene.substructure.values() if body.mesh is not None]


def coarsens_mesh(scene: Scene) -> bool:
    """Whether a coarser mesh exists: of boxes, and of files that are refined."""
    files = mesh_files(scene)
    return all(file.refine > 0 for file in files) if files else bool(counts_that_vary(scene))


def mesh_factor(scene: Scene, wanted: float) -> float:
    """The factor nearest to ``wanted`` by which the meshes can change.

    It leaves the largest number of elements of boxes whole; where a mesh is from a file it is a power of two.
    """
    files = mesh_files(scene)
    if not files:
        return reachable(counts_that_vary(scene), wanted)
    levels = [file.refine for file in files]
    power = math.floor(math.log2(wanted) + 0.5)
    return float(2.0 ** max(min(power, MAX_REFINEMENTS - max(levels)), -min(levels)))


def counts_that_vary(scene: Scene) -> list[int]:
    """Numbers of elements other than one: those that a change of the mesh scales."""
    boxes = [body.box for body in scene.substructure.values() if body.box is not None]
    return [n for box in boxes for n in box.elements if n > 1]


def reachable(counts: list[int], factor: float) -> float:
    """The factor nearest to ``factor`` that leaves the largest number of elements whole.

    >>> reachable([6, 6], 0.25), reachable([5], 0.5)
    (0.3333333333333333, 0.6)
    """
    largest = max(counts)
    return max(1, int(largest * factor + 0.5)) / largest


def at_resolution(scene: Scene, resolution: Resolution) -> Scene:
    """The scene with numbers of elements and steps multiplied, without the output that no quantity needs.

    The time step is divided by ``resolution.time`` exactly; the last instant falls at the end or less than a step
    after it. One element across stays one.

    Raises
    ------
    SceneError : the mesh or the number of steps leaves the range of a scene.
    """
    every = max(1, scene.output.interfaces_every, int(scene.time.n_step * resolution.time) // _MOST_KEPT)
    changes: dict[str, object] = {
        "output": type(scene.output)(peak_duration=scene.output.peak_duration, interfaces_every=max(1, every))
    }
    if resolution.mesh != 1.0:
        changes["substructure"] = {n: _refined(body, resolution.mesh) for n, body in scene.substructure.items()}
    if resolution.time != 1.0:
        n = max(1, math.ceil(scene.time.n_step * resolution.time - 1e-6))
        step = scene.time.time_step / resolution.time
        changes["time"] = scene.time.model_copy(update={"end": n * step, "step": None, "instants": n})
    if resolution.tolerance is not None:
        changes["solver"] = with_tolerance(scene, resolution.tolerance)
    return scene.model_copy(update=changes)


def element_transit(scene: Scene, interface: str, spacing: float) -> float:
    """Longest time a pressure wave needs to cross an element beside an interface, s.

    spacing : size of an element whose mesh is from a file, m.
    """
    longest = 0.0
    for face in scene.interface[interface].sides:
        name, side = split_face(face)
        body = scene.substructure.get(name)
        if body is None or body.rigid:
            continue
        material = scene.material[body.material]
        size = spacing
        if body.box is not None:
            edges = np.divide(body.box.size, body.box.elements)
            size = float(edges[AXES.index(side[0])] if side[0] in AXES else edges.max())
        speed = wave_speeds(material.young_modulus, material.poisson_ratio, material.density)[0]
        longest = max(longest, size / speed)
    return longest


def with_tolerance(scene: Scene, tolerance: float) -> object:
    """Solver settings with another tolerance; a force tolerance that was given keeps its ratio to it."""
    solver = scene.solver
    update: dict[str, object] = {"tolerance": tolerance}
    if solver.force_tolerance is not None:
        update["force_tolerance"] = solver.force_tolerance * tolerance / solver.tolerance
    return solver.model_copy(update=update)


def in_short_windows(scene: Scene) -> Scene:
    """The scene with windows of one instant in the place of one whole window: same solution, far fewer sweeps. Its time
    scheme is the one chosen for this mesh, on coarser and finer ones too."""
    if isinstance(scene.time.scheme, AutomaticScheme) and not scene.time.quasi_static:
        scheme = GeneralizedAlphaTable() if discretise(scene).scheme.name == "generalized_alpha" else HHTTable()
        scene = scene.model_copy(update={"time": scene.time.model_copy(update={"scheme": scheme})})
    if scene.solver.window != WHOLE:
        return scene
    update = {"window": 1, "acceleration": type(scene.solver)().acceleration}
    return scene.model_copy(update={"solver": scene.solver.model_copy(update=update)})


def _refined(body: Substructure, factor: float) -> Substructure:
    if body.box is not None:
        box = body.box.model_copy(update={"elements": _scaled(body.box.elements, factor)})
        return body.model_copy(update={"box": box})
    assert body.mesh is not None
    mesh = body.mesh.model_copy(update={"refine": body.mesh.refine + round(math.log2(factor))})
    return body.model_copy(update={"mesh": mesh})


def _scaled(elements: tuple[int, int, int], factor: float) -> tuple[int, ...]:
    return tuple(n if n == 1 else max(1, math.floor(n * factor + 0.5)) for n in elements)


def sampling_error(scene: Scene, step: float | None = None) -> float:
    """Largest relative error of the impulse of a load sampled with a step (s; that of the scene where None).

    Loads that are inputs count as exact.
    """
    step = scene.time.time_step if step is None else step
    time = step * np.arange(math.ceil(scene.time.end / step - 1e-6) + 1)
    laws = [law for law in scene.force_laws.values() if not isinstance(law, InputLaw)]
    return max((abs(sampled_impulse_error(law, time)) for law in laws), default=0.0)


def aligned(scene: Scene, factor: float) -> float:
    """A number of steps relative to that of the scene, near ``factor`` (within 12 %), with jumps of loads at instants.

    A pulse that ends between two instants loses or gains up to half a step of impulse, which would count as an error
    of the run.
    """
    step = scene.time.time_step
    choices = [factor]
    for jump in _jumps(scene):
        first, last = math.ceil(0.88 * factor * jump / step), math.floor(1.12 * factor * jump / step)
        choices += [k * step / jump for k in range(max(first, 1), min(last, first + 100) + 1)]
    errors = np.round([sampling_error(scene, step / choice) for choice in choices], 6)
    best = np.flatnonzero(errors == errors.min())
    return min((choices[i] for i in best), key=lambda choice: abs(choice - factor))


def _jumps(scene: Scene) -> list[float]:
    """Instants inside the interval at which a load jumps, s."""
    jumps = set()
    for law in scene.force_laws.values():
        if isinstance(law, StepLaw | RectangularPulseLaw):
            jumps.add(law.start)
        if isinstance(law, RectangularPulseLaw):
            jumps.add(law.start + law.duration)
    return sorted(t for t in jumps if 0.0 < t < scene.time.end)
