"""Whether bodies start where, and as fast as, what holds and drives them does.

A face that starts away from its body strains the one layer of elements behind it by the whole offset, and one that
starts with another velocity strikes it. The part of the motion of a body at t = 0 that its conditions cannot represent,

    r = w - P P^+ w,    w = u - D d

(u displacements or velocities of its nodes at t = 0, P the motions that the conditions leave, D and d shapes and values
of the prescribed motions) is lost at the start, or is an offset. It has to vanish.

A path given by displacements may start with a corner, as it may have others later on: before t = 0 it rests, or has its
first slope.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import Problems, shown
from ..fem.mesh import Array
from ..propagator.model import closest_reduced
from ..remarks import Remark
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import Body
from .conditions import Conditions, RigidConditions

_OFFSET: Final = 1e-6  # of the largest displacement of a body or path
_TEARS: Final = 1e-3  # of fields: meshes of files interpolate a curved field differently
_SPEED: Final = 1e-2  # of the largest speed: recorded velocities have an offset
_REMEDY: Final = (
    "subtract the value at t = 0 from the law, give the same initial_displacement to all that moves with the face, or "
    'set time.start = "static"'
)


def check_driven_starts(
    scene: Scene,
    bodies: Mapping[str, Body],
    conditions: Mapping[str, Conditions],
    problems: Problems,
    remarks: list[Remark],
) -> None:
    """Refuse faces that do not start where their bodies are, or not as fast; a held face of a moving body is a remark.

    Without inertia every increment is an equilibrium: nothing is compared. A static start strains bodies at rest by
    what their faces are displaced at t = 0, and initial displacements are counted from there.
    """
    if scene.time.quasi_static:
        return
    time = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
    if scene.motion is not None and scene.thrown:
        _check_ground(scene, scene.motion.velocity, problems)
    for name, body in bodies.items():
        supports, table = conditions[name], scene.substructure[name]  # its velocities are relative to [motion]
        settles = scene.time.start.type == "static" and not table.motion_keys
        if table.initial_keys or (supports.motions and not settles):
            _check_places(body, supports, time, settles, problems)
        if supports.motions or body.description.motion_keys:
            _check_speeds(body, supports, time, problems, [] if scene.thrown else remarks)
        if scene.motion is not None and scene.thrown:
            _check_throw(body, supports, scene.motion.velocity, problems)


def _check_places(body: Body, supports: Conditions, time: Array, settles: bool, problems: Problems) -> None:
    """Displacements at t = 0; ``settles`` : they are added to an equilibrium that has those of prescribed motions."""
    initial = body.initial_displacement()
    if settles:
        start = np.zeros(len(supports.motions))
    else:
        start = supports.start()
    rest = np.abs(_rest(body, supports, initial, start, velocity=False))
    paths = [m.value * m.law.sample(time) for m in supports.motions if m.kind == "displacement"]
    level = _OFFSET * max(float(np.abs(x).max()) for x in (initial, *paths))
    if body.displacement_field is not None:
        level += _TEARS * float(np.abs(body.displacement_field).max())
    apart = rest > level
    if not apart.any():
        return
    for source in _sources(supports, apart):
        motions = [m.value * float(m.law.sample(np.zeros(1))[0]) for m in supports.motions if m.source == source]
        size = f"{rest[_moved(supports, source)].max():.6g} {body.units['m']}"
        problems.add(
            source,
            f"its face starts {size} away from where {body.name} is at t = 0, by which the elements behind it would be "
            "strained at once",
            shown(motions),
            f"where {body.name} is at t = 0",
            _REMEDY,
        )
    keys = [key for key in body.description.initial_keys if "displacement" in key]
    if keys and apart[_still(supports)].any():
        size = f"{rest[_still(supports)].max():.6g} {body.units['m']}"
        problems.add(
            f"substructure.{body.name}.{keys[0]}",
            f"moves nodes that are held by {size}, by which the elements behind them would be strained at once",
            shown(getattr(body.description, keys[0])),
            "no displacement where a boundary holds the body",
            "omit it, or let the displacement vanish at the held face (initial_displacement_gradient, or a field)",
        )


def _check_speeds(body: Body, supports: Conditions, time: Array, problems: Problems, remarks: list[Remark]) -> None:
    """Velocities at t = 0."""
    initial = body.initial_velocity()
    speeds = start_velocities(supports, initial, time)
    rest = np.abs(_rest(body, supports, initial, speeds, velocity=True))
    paths = [motion.largest_speed(time) for motion in supports.motions]
    apart = rest > _SPEED * max(float(np.abs(initial).max()), *paths, 0.0)
    if not apart.any():
        return
    unit = body.units["m s-1"]
    for source in _sources(supports, apart):
        start = [float(v) for v, m in zip(speeds, supports.motions, strict=True) if m.source == source]
        problems.add(
            source,
            f"its face starts with another velocity than {body.name}, which it would strike at t = 0: they differ by "
            f"{rest[_moved(supports, source)].max():.6g} {unit}",
            shown(start),
            f"the velocity of {body.name} at t = 0",
            f"give initial_velocity to {body.name} and all that moves with it, begin the law with that velocity, or "
            'set law = "step" for a face that starts suddenly',
        )
    if body.velocity_field is None and apart[_still(supports)].any():  # of fields it is said elsewhere
        lost = rest[_still(supports)].max()
        text = f"a boundary holds nodes that start with {lost:.3g} {unit}: their velocity is lost in the first "
        remarks.append(Remark("initial_state", f"substructure {body.name}: {text}step, with its energy"))


def _check_throw(body: Body, supports: Conditions, velocity: Sequence[float], problems: Problems) -> None:
    """What holds nodes of a body that starts with the velocity (3,) of the whole assembly, m s-1."""
    uniform = np.tile(np.asarray(velocity, dtype=float), body.mesh.n_node)
    rest = np.abs(_rest(body, supports, uniform, np.zeros(len(supports.motions)), velocity=True))[_still(supports)]
    if rest.max(initial=0.0) > _SPEED * np.abs(uniform).max():
        problems.add(
            "motion.velocity",
            f"a boundary holds {body.name}, which cannot start with the velocity of the assembly",
            shown(list(velocity)),
            "no component along what boundaries hold",
            "omit the boundary, or drive its face by a velocity that starts with that of the assembly",
        )


def _check_ground(scene: Scene, velocity: Sequence[float], problems: Problems) -> None:
    """Bonds between bodies that start with the velocity (3,) of the whole assembly, m s-1, and ground without it."""
    for name, joint in scene.joints.items():
        if joint.behaviour != "perfect" or not joint.against_ground:
            continue
        ground = joint.ground_velocity
        moving = np.zeros(3)
        if ground is not None:
            moving = np.asarray(ground.vector) * float(ground.law.sample(np.zeros(1))[0])
        if np.abs(moving - velocity).max() > _SPEED * np.abs(velocity).max():
            problems.add(
                "motion.velocity",
                f"interface {name} bonds {split_face(joint.sides[0])[0]} to the ground, which does not move with it",
                shown(list(velocity)),
                f"the velocity of the ground, {shown(moving.tolist())}",
                f"leave interface {name} out, or give its ground_velocity this velocity",
            )


def start_velocities(supports: Conditions, initial: Array, time: Array) -> Array:
    """Velocities of the prescribed motions at t = 0, (n_motion,), m s-1; ``initial`` (3 n_node,) those of the body.

    Of a path the one of the slopes before and after t = 0 that is closer to the motion of the body.
    """
    step = float(time[1])
    values = np.zeros(len(supports.motions))
    for k, motion in enumerate(supports.motions):
        values[k] = motion.start_velocity()
        if motion.kind == "displacement":
            slope = motion.value * float(np.diff(motion.law.sample(np.array([0.0, step])))[0]) / step
            mean = _mean(supports, k, initial)
            values[k] = 0.0
            if abs(slope - mean) < abs(mean):
                values[k] = slope
    return values


def _shapes(supports: Conditions) -> Array:
    """Displacements of the nodes (3 n_node, n_motion) for unit values of the prescribed motions."""
    if isinstance(supports, RigidConditions):
        return np.asarray(supports.nodal @ supports.pattern)
    return supports.pattern


def _mean(supports: Conditions, k: int, initial: Array) -> float:
    """Velocity of a body along the motion k of its conditions."""
    shape = _shapes(supports)[:, k]
    square = float(shape @ shape)
    if square > 0.0:
        return float(shape @ initial) / square
    return 0.0


def _rest(body: Body, supports: Conditions, values: Array, driven: Array, velocity: bool) -> Array:
    """r of the module docstring, (3 n_node,), of displacements or velocities ``values`` (3 n_node,) at t = 0;
    ``driven`` (n_motion,) those of the prescribed motions."""
    if isinstance(supports, RigidConditions):
        table = body.description
        if velocity:
            shift, turn = np.asarray(table.initial_velocity), np.asarray(table.initial_spin)
        else:
            shift, turn = np.asarray(table.initial_displacement), np.zeros(3)
        return np.asarray(values - supports.nodal @ supports.values(shift, turn, driven))
    moved = values - supports.pattern @ driven
    return np.asarray(moved - supports.expansion @ closest_reduced(supports.expansion, moved[:, None])[:, 0])


def _sources(supports: Conditions, apart: NDArray[np.bool_]) -> list[str]:
    """Prescribed motions that take part at the dofs marked by ``apart``."""
    return [
        source for source in dict.fromkeys(m.source for m in supports.motions) if apart[_moved(supports, source)].any()
    ]


def _still(supports: Conditions) -> NDArray[np.bool_]:
    """(3 n_node,) dofs that no prescribed motion moves."""
    return np.asarray(~_shapes(supports).any(axis=1))


def _moved(supports: Conditions, source: str) -> NDArray[np.bool_]:
    """(3 n_node,) dofs that the motions of a source move."""
    columns = [k for k, motion in enumerate(supports.motions) if motion.source == source]
    return np.asarray(_shapes(supports)[:, columns].any(axis=1))
