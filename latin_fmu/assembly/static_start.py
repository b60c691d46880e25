"""``time.start = "static"``: the equilibrium under what acts at t = 0, as the initial state of the motion.

The static problem is the scene without inertia: the same meshes and interfaces, loads raised to their value at t = 0,
faces driven by a velocity and moving ground at rest, no dashpots. Substructures that have a velocity of their own are
not in it. It is solved far more closely than the motion will be, so that what is left unbalanced is not seen there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import Problem, SceneError
from ..interface.behaviour import bonds
from ..latin.layout import InterfaceUnit, Layout
from ..latin.record import Timings
from ..latin.recorder import Recorder
from ..latin.status import status
from ..latin.windows import Run
from ..propagator import StaticPropagator
from ..scene.fields import GROUND, split_face
from ..scene.schema import Scene
from ..scene.static_scene import resting, something_acts, static_interfaces, static_scene
from ..scene.time_settings import StaticStart
from ..time_scheme import QuasiStatic
from .body import Body
from .checks import boundaries_of
from .conditions import Conditions
from .initial_state import InitialState
from .models import model_classes
from .rigid import conditions_on
from .statics import unheld

if TYPE_CHECKING:
    from .build import Built, Prepared

TIGHT = 1e-11, 1e-9  # tolerances of the static solution; that of the scene where round-off lets neither


def starts_static(scene: Scene) -> bool:
    """Whether the motion starts from a static equilibrium."""
    return isinstance(scene.time.start, StaticStart)


def start_problems(
    scene: Scene, bodies: dict[str, Body], conditions: dict[str, Conditions], units: list[InterfaceUnit]
) -> Iterator[Problem]:
    """What keeps a scene with ``time.start = "static"`` from having one static equilibrium."""
    still = resting(scene)
    if not still:
        yield Problem(
            "time.start",
            "every substructure has an initial velocity: nothing is at rest",
            "static",
            "given",
            "leave time.start out",
        )
        return
    for unit in units:
        moving = [n for n in (split_face(side)[0] for side in unit.sides) if n != GROUND and n not in still]
        tied = bonds(unit.behaviour) or unit.behaviour.elastic or unit.preload > 0
        if moving and tied:
            yield Problem(
                f"interface.{unit.name}",
                "holds or presses a substructure that has an initial velocity, so that it is "
                "not in equilibrium at the start",
                moving[0],
                None,
                f"remove the velocity of {moving[0]}, or leave time.start out",
            )
    kept = static_interfaces(scene)
    yield from unheld(
        {n: bodies[n] for n in still},
        {n: conditions[n] for n in still},
        [u for u in units if u.name in kept],
        "time.start",
    )


def static_state(whole: Prepared, amplitudes: Mapping[str, float]) -> InitialState | None:
    """The equilibrium that the motion starts from; None where nothing acts at t = 0.

    Parameters
    ----------
    amplitudes : at t = 0, of loads that are set from outside; those left out have their start value.

    Raises
    ------
    SceneError : contact and friction cannot hold the loads.
    """
    scene = static_scene(whole.scene, amplitudes)
    if not something_acts(scene):
        return None
    prepared = _prepared(whole, scene)
    solver = whole.scene.solver
    wanted = [*((tight, tight) for tight in TIGHT), (solver.tolerance, solver.force_mismatch_tolerance)]
    for tolerance, force in wanted:
        built = prepared.build()
        built = replace(built, settings=replace(built.settings, tolerance=tolerance, force_tolerance=force))
        run = Run(built.assembly, built.settings, Recorder(built.assembly, built.wanted, built.info), Timings())
        run.all()
        converged, sentence = status(built.assembly, built.settings, run.state.windows, run.state.interface_indicator)
        if converged:
            return _handed(built, run, amplitudes, tolerance)
    raise SceneError(
        [
            Problem(
                "time.start",
                f"no static equilibrium under the loads of t = 0 was found: {sentence}",
                "static",
                "given",
                "hold what slides or topples, or leave time.start out",
            )
        ],
        "the scene cannot be built",
    )


def _handed(built: Built, run: Run, amplitudes: Mapping[str, float], tolerance: float) -> InitialState:
    """Displacements, tractions and gaps at the end of the static run."""
    assembly, displacement = built.assembly, {}
    for p in assembly.propagators:
        assert isinstance(p, StaticPropagator)
        imposed = p.forcing.imposed_u(p.instant)
        for j, member in enumerate(p.members):
            displacement[member.name] = member.expansion @ p.state.u[:, j] + imposed[:, j]
    traction, closure = {}, {}
    gaps = dict(zip(map(id, assembly.layout.groups), run.gaps(), strict=True))
    for i, unit in enumerate(assembly.interfaces):
        group = assembly.layout.group(i)
        points = group.members[i]
        traction[unit.name] = group.block(run.f_hat)[0, points]
        if unit.behaviour.opens and not unit.behaviour.elastic:
            closure[unit.name] = np.where(traction[unit.name][:, 0] < 0.0, gaps[id(group)][points], 0.0)
    windows = run.state.windows
    told = f"static equilibrium, {len(windows)} increment(s), {sum(w.iterations for w in windows)} iterations"
    remarks = (
        ()
        if tolerance in TIGHT
        else (
            f"the static start was found to {tolerance:g} only (wanted {TIGHT[-1]:g}): what it leaves unbalanced moves",
        )
    )
    return InitialState(displacement, traction, closure, dict(amplitudes), told, remarks)


def _prepared(whole: Prepared, scene: Scene) -> Prepared:
    """The static problem on the meshes and interfaces that are there."""
    bodies = {name: whole.bodies[name] for name in scene.substructure}
    problems: list[Problem] = []
    conditions = {n: conditions_on(b, boundaries_of(scene, n), problems) for n, b in bodies.items()}
    assert not problems, problems  # the same conditions stood before
    units = [unit for unit in whole.units if unit.name in scene.interface]
    layout, scheme = Layout(units), QuasiStatic()
    classes = model_classes(scene, bodies, conditions, units, layout, scheme)
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    return replace(
        whole,
        scene=scene,
        bodies=bodies,
        conditions=conditions,
        units=units,
        layout=layout,
        classes=classes,
        scheme=scheme,
        time=time,
        remarks=(),
    )
