"""The assembly of a scene before it runs: parts in colours, interfaces, supports, loads, motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from ..assembly.body import Body, build_bodies
from ..assembly.build import discretise
from ..assembly.checks import check_faces
from ..errors import Problems, SceneError
from ..fem.mesh import Array, Index
from ..latin.assembly import InterfaceUnit
from ..results.summary import readable
from ..scene.boundaries import Driven, Periodic
from ..scene.fields import GROUND, split_face
from ..scene.interfaces import Interface
from ..scene.schema import Scene
from .frame import Skin, View, arrow, axes_with_units, draw, skin_of
from .style import Colour, colours, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# light enough for the strong colours of interfaces to stand out
PARTS: Final = ("#A6BDD7", "#E8C9A0", "#B5D3A8", "#D9B3C7", "#C9C3E6", "#E5DF9B", "#A9D6D2", "#D8CCC0")
SUPPORTS: Final = {
    "fixed": "#303030",
    "symmetry": "#8A8A8A",
    "absorbing": "#5B4A8A",
    "periodic": "#9C8A5A",
    "velocity": "#7F3C8D",
    "displacement": "#7F3C8D",
    "acceleration": "#7F3C8D",
}
LOAD, MOTION = "#B00000", "#0050A0"
_AZIMUTH, _ELEVATION = -60.0, 25.0
# between bodies of the exploded view: of the size of the assembly, and at most of the mean size of its bodies
_APART, _APART_OF_BODY = 0.3, 0.6
_ARROW: Final = 0.16
_MOST_NAMES: Final = 9


@dataclass(frozen=True)
class _Item:
    """A line of the legend."""

    colour: Colour
    text: str


@dataclass(frozen=True)
class _Joint:
    """An interface as it is drawn.

    Attributes
    ----------
    nodes : body -> its nodes that take part. normal : (3,) area-weighted mean of N from the first body to the second,
        shorter than 1 where the face is curved, 0 where it is closed. area : m2.
    """

    name: str
    text: str
    nodes: dict[str, Index]
    normal: Array


@dataclass(frozen=True)
class _Assembly:
    """Scene, bodies and interfaces of a picture."""

    scene: Scene
    bodies: dict[str, Body]
    joints: list[_Joint]


@styled
def assembly_figure(scene: Scene, warnings: list[str]) -> Figure:
    """The parts in place, and apart with their interfaces coloured; loads and motions as arrows.

    Interfaces that cannot be built are drawn as the whole faces of the scene; ``warnings`` have the reasons.

    Raises
    ------
    SceneError : meshes that cannot be read, unknown faces.
    """
    assembly = _assembly(scene, warnings)
    bodies = assembly.bodies
    above, below = View.at(_AZIMUTH, _ELEVATION), View.at(_AZIMUTH, -_ELEVATION)
    tints = {name: PARTS[i % len(PARTS)] for i, name in enumerate(bodies)}
    strong = dict(zip((j.name for j in assembly.joints), colours(len(assembly.joints)), strict=True))
    skins = {name: skin_of(body.mesh, _rgb(tints[name])) for name, body in bodies.items()}
    _paint(assembly, skins, strong)
    everything = np.concatenate([s.points for s in skins.values()])
    mean = float(np.mean([body.mesh.size for body in bodies.values()]))
    distance = min(_APART * float(np.ptp(everything, axis=0).max()), _APART_OF_BODY * mean)
    shifts = _shifts(assembly, distance)
    apart = [s.moved(shifts[name]) for name, s in skins.items()]
    figure, axes = _layout(apart, above)
    draw(axes[0], list(skins.values()), above)
    _arrows(axes[0], scene, bodies, above)
    axes_with_units(axes[0], everything, above, scene.unit_system.label("m"))
    words = "apart, " if len(bodies) > 1 else ""
    for axis, (view, side) in zip(axes[:0:-1], ((below, "below"), (above, "above")), strict=False):
        draw(axis, apart, view)
        axis.set_title(f"{words}from {side}", fontsize=9)
    _legend(figure, assembly, tints, strong)
    figure.suptitle(scene.name, fontweight="bold")
    return figure


def _assembly(scene: Scene, warnings: list[str]) -> _Assembly:
    """Bodies and interfaces, built as for a run where that works."""
    try:
        discretised = discretise(scene)
    except SceneError as error:
        problems = Problems()
        bodies = build_bodies(scene, problems)
        check_faces(scene, bodies, problems)
        if problems:
            raise
        warnings += [f"drawn as written, the scene does not build: {problem}" for problem in error.problems]
        joints = [_named_joint(name, i, bodies) for name, i in scene.interface.items()]
        return _Assembly(scene, bodies, joints)
    return _Assembly(discretised.scene, discretised.bodies, [_built_joint(unit) for unit in discretised.units])


def _built_joint(unit: InterfaceUnit) -> _Joint:
    """The part of the faces that takes part."""
    geometry = unit.geometry
    nodes = {
        split_face(side)[0]: np.unique(trace.indices // 3).astype(np.int64)
        for side, trace in zip(unit.sides, geometry.traces, strict=True)
        if trace is not None
    }
    normal = geometry.areas @ geometry.frames[:, 0] / geometry.areas.sum()
    return _Joint(unit.name, f"{unit.name}: {unit.behaviour.name}, {geometry.n_point} points", nodes, normal)


def _named_joint(name: str, interface: Interface, bodies: Mapping[str, Body]) -> _Joint:
    """The whole faces."""
    faces = {split_face(side)[0]: split_face(side)[1] for side in interface.sides if side != GROUND}
    first, face = split_face(interface.sides[0])
    areas = bodies[first].face(face).vector_areas
    normal = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
    nodes = {body: bodies[body].facets(face).nodes for body, face in faces.items()}
    return _Joint(name, f"{name}: {interface.behaviour}", nodes, normal)


def _layout(apart: Sequence[Skin], view: View) -> tuple[Figure, list[Axes]]:
    """A figure with a large picture and two smaller ones: beside each other where the bodies make a tower."""
    from matplotlib.figure import Figure

    width, height = np.ptp(np.concatenate([view.project(s.points) for s in apart]), axis=0)
    tower = height > 1.1 * width
    figure = Figure(figsize=(10.5, 9.0 if height > 4.0 * width else 6.4), layout="constrained")
    if len(apart) == 1:  # it cannot be taken apart: from above it is the large picture
        return figure, list(figure.subplots(1, 2, width_ratios=(1.6, 1.0)))
    if tower:
        return figure, list(figure.subplots(1, 3, width_ratios=(1.6, 1.0, 1.0)))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    places = (grid[:, 0], grid[0, 1], grid[1, 1])
    return figure, [figure.add_subplot(place) for place in places]


def _rgb(colour: Colour) -> Array:
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(colour))


def _paint(assembly: _Assembly, skins: dict[str, Skin], strong: Mapping[str, Colour]) -> None:
    """Faces of supports and interfaces in their colours."""
    for boundary in assembly.scene.boundary.values():
        for face in boundary.faces if isinstance(boundary, Periodic) else (boundary.face,):
            body, name = split_face(face)
            nodes = assembly.bodies[body].facets(name).nodes
            skins[body] = skins[body].painted(nodes, _rgb(SUPPORTS[boundary.type]))
    for joint in assembly.joints:
        for body, nodes in joint.nodes.items():
            skins[body] = skins[body].painted(nodes, _rgb(strong[joint.name]))


def _shifts(assembly: _Assembly, distance: float) -> dict[str, Array]:
    """Shift of every body (3,) of the exploded view: along the normals of its interfaces, least squares over all."""
    names = list(assembly.bodies)
    rows, wanted = [np.ones(len(names))], [np.zeros(3)]  # the bodies together stay where they are
    for joint in assembly.joints:
        if len(joint.nodes) == 2:
            first, second = joint.nodes
            row = np.zeros(len(names))
            row[names.index(first)], row[names.index(second)] = -1.0, 1.0
            rows.append(row)
            wanted.append(distance * joint.normal)
    shifts = np.linalg.lstsq(np.array(rows), np.array(wanted), rcond=None)[0]
    return dict(zip(names, shifts, strict=True))


def _arrows(axis: Axes, scene: Scene, bodies: Mapping[str, Body], view: View) -> None:
    """Loads, driven faces, ports, gravity and initial velocities."""
    label = scene.unit_system.label
    everything = np.concatenate([b.mesh.nodes for b in bodies.values()])
    length = _ARROW * float(np.ptp(everything, axis=0).max())
    for name, load in scene.load.items():
        centre, normal = _middle(bodies, load.face)
        if load.pressure is not None:
            direction, text = (
                -np.sign(load.pressure or 1.0) * normal,
                readable(load.pressure, label("Pa"), 3, figure=True),
            )
        else:
            turns = load.force is None and load.traction is None
            direction = np.asarray(load.moment if turns else load.uniform_traction(1.0), dtype=float)
            unit = "N m" if turns else "Pa" if load.force is None else "N"
            text = readable(float(np.linalg.norm(direction)), label(unit), 3, figure=True)
        ahead = float(((everything - centre) @ direction).max()) / max(float(np.linalg.norm(direction)), 1e-300)
        outwards = bool(direction @ normal > 0) and ahead < 0.1 * length  # it pulls, and nothing is in the way
        _arrow(axis, view, centre, direction, length, LOAD, f"{name}\n{text}", outwards)
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, Driven):
            centre, _ = _middle(bodies, boundary.face)
            direction = np.zeros(3)
            direction[["xyz".index(c) for c in boundary.components]] = boundary.value
            if boundary.axes is not None:
                direction = np.array(boundary.axes.rows).T @ direction
            unit = {"velocity": "m s-1", "displacement": "m", "acceleration": "m s-2"}[boundary.type]
            text = readable(float(np.linalg.norm(direction)), label(unit), 3, figure=True)
            _arrow(axis, view, centre, direction, length, SUPPORTS[boundary.type], f"{name}\n{text}", True)
    for name, port in scene.port.items():
        centre, normal = _middle(bodies, port.face)
        text = f"{name}\nport, {port.causality.replace('_', ' ')}: {' '.join(port.components)}"
        _arrow(axis, view, centre, normal, length, MOTION if port.causality == "motion_in" else LOAD, text, True)
    if scene.gravity is not None:
        direction, beside = np.asarray(scene.gravity.acceleration, dtype=float), everything.min(axis=0)
        text = f"gravity\n{readable(float(np.linalg.norm(direction)), label('m s-2'), 3, figure=True)}"
        _arrow(axis, view, beside, direction, length, LOAD, text, True)
    for body in bodies.values():
        low, high = body.mesh.nodes.min(axis=0), body.mesh.nodes.max(axis=0)
        for vector, unit, colour in (
            (body.description.initial_velocity, "m s-1", MOTION),
            (body.description.body_force, "N m-3", LOAD),
        ):
            direction = np.asarray(vector, dtype=float)
            size = float(np.linalg.norm(direction))
            # behind the body, so that neither arrow nor label covers it
            behind = 0.5 * (low + high) - 0.5 * (high - low) * np.sign(direction) * (np.abs(direction) > 0.1 * size)
            text = f"{body.name}\n{readable(size, label(unit), 3, figure=True)}"
            _arrow(axis, view, behind, direction, length, colour, text)


def _arrow(
    axis: Axes, view: View, at: Array, direction: Array, length: float, colour: str, label: str, away: bool = False
) -> None:
    size = float(np.linalg.norm(direction))
    if size > 0:
        arrow(axis, view, at, length * direction / size, colour, label, away)


def _middle(bodies: Mapping[str, Body], face: str) -> tuple[Array, Array]:
    """Centre of a face, m, and its mean normal."""
    name, face_name = split_face(face)
    facets = bodies[name].face(face_name)
    weights = np.linalg.norm(facets.vector_areas, axis=1)
    centre = weights @ bodies[name].mesh.nodes[facets.nodes] / weights.sum()
    normal = facets.vector_areas.sum(axis=0)
    return centre, normal / max(float(np.linalg.norm(normal)), 1e-300)


def _legend(figure: Figure, assembly: _Assembly, tints: Mapping[str, str], strong: Mapping[str, Colour]) -> None:
    from matplotlib.patches import Patch

    parts = [_Item(tints[n], f"{n} ({b.description.material})") for n, b in assembly.bodies.items()]
    joints = [_Item(strong[joint.name], joint.text) for joint in assembly.joints]
    by_type: dict[str, list[str]] = {}
    for name, boundary in assembly.scene.boundary.items():
        by_type.setdefault(boundary.type, []).append(name)
    held = [_Item(SUPPORTS[support], f"{support}: {_few(names)}") for support, names in by_type.items()]
    items = [*_shortened(parts, "parts"), *_shortened(joints, "interfaces"), *held]
    handles = [Patch(facecolor=item.colour, edgecolor="0.3", linewidth=0.5, label=item.text) for item in items]
    columns = 4 if max(len(item.text) for item in items) < 30 else 3
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize="small", frameon=False)


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" ... ({len(names)})" if len(names) > 3 else "")


def _shortened(items: list[_Item], what: str) -> list[_Item]:
    if len(items) <= _MOST_NAMES:
        return items
    return [*items[:_MOST_NAMES], _Item("#FFFFFF", f"... {len(items)} {what} in all")]
