"""From description to operators: the one place that knows both the scene and the solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import Problem, SceneError
from ..latin.assembly import Assembly
from ..latin.layout import Layout
from ..latin.recorder import SubstructureInfo, Wanted
from ..latin.search_direction import SearchDirection, unresolved_sides
from ..latin.settings import Settings
from ..time_scheme import make_scheme
from .body import build_bodies, locking_remarks
from .boundaries import Periodic
from .checks import (
    boundaries_of,
    characteristic_traction,
    check_faces,
    initial_problems,
    redundancy_remarks,
    sampling_remarks,
)
from .conditions import build_conditions
from .fields import split_face
from .models import build_propagators, side_impedance
from .pairing import build_interface
from .schema import Scene
from .solver_settings import WHOLE, Anderson, Uniform
from .timeline import Timeline


@dataclass(frozen=True)
class Built:
    """A scene turned into operators, ready to run.

    The assembly stands at t = 0 with the instants of the scene; ``timeline`` can give it others.
    """

    assembly: Assembly
    settings: Settings
    wanted: Wanted
    info: dict[str, SubstructureInfo]
    warnings: tuple[str, ...]
    timeline: Timeline


def build(scene: Scene) -> Built:
    """Meshes, matrices, interfaces and factors of a scene.

    Raises
    ------
    SceneError : meshes that cannot be read, unknown faces, faces that do not fit; all at once.
    """
    problems: list[Problem] = []
    bodies = build_bodies(scene, problems)
    check_faces(scene, bodies, problems)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    conditions = {
        name: build_conditions(body, boundaries_of(scene, name), problems) for name, body in bodies.items()
    }
    found = [build_interface(n, i, bodies, problems) for n, i in scene.interface.items()]
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    units = [unit for unit in found if unit is not None]
    remarks: list[str] = []
    initial_problems(scene, units, problems, remarks)
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    layout = Layout(units)
    scheme = make_scheme(scene.time.scheme.type, scene.time.scheme.model_dump(exclude={"type"}))
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    dt = float(time[1] - time[0])
    propagators, channels = build_propagators(scene, bodies, conditions, units, layout, scheme, dt)
    assembly = Assembly(
        propagators, channels, units, layout, side_impedance(bodies, units, layout),
        characteristic_traction(scene, bodies, time), scheme,
    )  # fmt: skip
    timeline = Timeline(scene, conditions)
    timeline.begin(assembly, time, {}, assembly.ground_start)
    remarks += [
        *redundancy_remarks(scene),
        *locking_remarks(
            bodies, {split_face(b.faces[0])[0] for b in scene.boundary.values() if isinstance(b, Periodic)}
        ),
        *sampling_remarks(scene, time),
        *unresolved_sides(assembly),
    ]
    output = scene.output
    info = {
        n: SubstructureInfo(
            b.mesh.nodes, b.mesh.cells, b.mesh.cell_type, b.shape.stress if output.stress else None
        )
        for n, b in bodies.items()
    }
    wanted = Wanted(output.fields, output.stress, output.energy, output.every)
    return Built(assembly, settings_of(scene), wanted, info, tuple(remarks), timeline)


def settings_of(scene: Scene) -> Settings:
    """Settings of the iteration."""
    solver = scene.solver
    direction = solver.search_direction
    uniform = (direction.normal, direction.tangential) if isinstance(direction, Uniform) else (0.0, 0.0)
    return Settings(
        tolerance=solver.tolerance,
        force_tolerance=solver.force_mismatch_tolerance,
        max_iterations=solver.max_iterations,
        search_direction=SearchDirection(direction.type, direction.factor, *uniform),
        anderson_depth=solver.acceleration.depth if isinstance(solver.acceleration, Anderson) else 0,
        relaxation=solver.relaxation,
        window=0 if solver.window == WHOLE else min(int(solver.window), scene.time.n_step),
        sequential_start=solver.window == WHOLE and solver.start == "sequential",
    )
