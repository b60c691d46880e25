"""The assembly of a scene before it runs: parts in colours, interfaces, supports, loads, motions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.spatial import KDTree

from ..assembly.body import Body, build_bodies
from ..assembly.interfaces import with_found
from ..building import discretise
from ..checks.mesh_checks import check_faces
from ..errors import Problems, SceneError
from ..fem.mesh import Array, Index
from ..latin.assembly import InterfaceUnit
from ..scene.boundaries import Driven
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.interfaces import Interface
from ..scene.readable_numbers import readable
from ..scene.schema import Scene, faces_of
from ..scene.units import UnitSystem
from .frame import Skin, View, arrow, axes_with_units, draw, shifts_apart, skin_of
from .style import PARTS, Colour, colours, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUPPORTS: Final = {
    "fixed": "#303030",
    "symmetry": "#8A8A8A",
    "absorbing": "#5B4A8A",
    "periodic": "#9C8A5A",
    "velocity": "#7F3C8D",
    "displacement": "#7F3C8D",
    "acceleration": "#7F3C8D",
}
BONDED: Final = "#6B4F3A"
"""Colour of bonded faces where they are many."""
LOAD, MOTION = "#B00000", "#0050A0"
_AZIMUTH, _ELEVATION = -60.0, 25.0
# between bodies of the exploded view: of the size of the assembly, and at most of the mean size of its bodies
_APART, _APART_OF_BODY = 0.3, 0.6
_ARROW: Final = 0.16
_MOST_NAMES: Final = 9
_FEW_BONDS: Final = 4  # more of them have one colour, for contacts to stand out


@dataclass(frozen=True)
class _Joint:
    """An interface as it is drawn.

    Attributes
    ----------
    nodes : body -> its nodes that take part. normal : (3,) area-weighted mean of N from the first body to the second,
        shorter than 1 where the face is curved, 0 where it is closed. bond : what it is where it cannot open, else "".
    gap : body -> share of the largest gap at these nodes; empty where the scene gives the faces no form.
    """

    name: str
    text: str
    nodes: dict[str, Index]
    normal: Array
    gap: Mapping[str, Array] = field(default_factory=dict)
    bond: str = ""


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
    strong = _colours(assembly.joints)
    skins = {name: skin_of(body.mesh, _rgb(tints[name])) for name, body in bodies.items()}
    _paint(assembly, skins, strong)
    everything = np.concatenate([s.points for s in skins.values()])
    mean = float(np.mean([body.mesh.size for body in bodies.values()]))
    distance = min(_APART * float(np.ptp(everything, axis=0).max()), _APART_OF_BODY * mean)
    joined = [([*joint.nodes], joint.normal) for joint in assembly.joints if len(joint.nodes) == 2]
    pairs = [(sides[0], sides[1], normal) for sides, normal in joined]
    shifts = shifts_apart(list(bodies), pairs, distance)
    apart = [s.moved(shifts[name]) for name, s in skins.items()]
    figure, axes = _layout(apart, above)
    draw(axes[0], list(skins.values()), above)
    _arrows(axes[0], scene, bodies, above)
    axes_with_units(axes[0], everything, above, scene.unit_system.label("m"))
    if len(bodies) > 1:
        words = "apart, "
    else:
        words = ""
    # all but the large one, from the last
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
        if scene.contact:
            found = with_found(scene, bodies, Problems()).interface
        else:
            found = scene.interface
        reach = max((table.search for table in scene.contact.values()), default=0.0)
        return _Assembly(scene, bodies, [_named_joint(name, i, bodies, reach) for name, i in found.items()])
    described, tables = discretised.scene, discretised.scene.joints
    built = [
        _built_joint(unit, tables[unit.name].form is not None, described.unit_system) for unit in discretised.units
    ]
    return _Assembly(described, discretised.bodies, built)


def _built_joint(unit: InterfaceUnit, formed: bool, units: UnitSystem) -> _Joint:
    """The part of the faces that takes part; ``formed``: with its gap."""
    geometry = unit.geometry
    nodes = {
        # three dofs a node
        split_face(side)[0]: np.unique(trace.indices // 3).astype(np.int64)
        for side, trace in zip(unit.sides, geometry.traces, strict=True)
        if trace is not None
    }
    normal = geometry.areas @ geometry.frames[:, 0] / geometry.areas.sum()
    text, gap = f"{unit.name}: {unit.behaviour.name}, {geometry.n_point} points", {}
    if formed and (largest := float(geometry.gap.max())) > 0.0:
        text += f", gap up to {readable(largest, units.label('m'), 3, figure=True)} (white)"
        # of a node: mean over the points that it takes part in
        there = [trace for trace in geometry.traces if trace is not None]
        for (body, rows), trace in zip(nodes.items(), there, strict=True):
            sums = abs(trace).T @ np.repeat(
                np.stack([geometry.gap / largest, np.ones(geometry.n_point)], axis=1), 3, axis=0
            )
            at_nodes = sums.reshape(-1, 3, 2).sum(axis=1)[rows]
            gap[body] = at_nodes[:, 0] / at_nodes[:, 1]
    bond = ""
    if not unit.behaviour.opens:
        bond = unit.behaviour.name
    return _Joint(unit.name, text, nodes, normal, gap, bond)


def _named_joint(name: str, interface: Interface, bodies: Mapping[str, Body], reach: float) -> _Joint:
    """The whole faces; of whole surfaces, as contacts that are found have, what is within ``reach`` of the other, m."""
    faces = {split_face(side)[0]: split_face(side)[1] for side in interface.sides if side != GROUND}
    nodes = {body: bodies[body].facets(face).nodes for body, face in faces.items()}
    places = {body: bodies[body].mesh.nodes[rows] for body, rows in nodes.items()}
    if len(nodes) == 2 and set(faces.values()) == {ALL_OF_IT}:
        near = {}
        for body, other in zip(places, reversed(places), strict=True):
            tree = KDTree(places[other])
            # a node may be opposite the middle of an element
            spacing = float(np.median(np.asarray(tree.query(places[other], k=[2])[0])))
            near[body] = nodes[body][np.asarray(tree.query(places[body])[0]) <= reach + 0.75 * spacing]
        nodes = near
    first, face = split_face(interface.sides[0])
    whole = bodies[first].face(face)
    areas = whole.vector_areas[np.isin(whole.nodes, nodes[first])]
    normal = areas.sum(axis=0) / max(float(np.linalg.norm(areas, axis=1).sum()), 1e-300)  # 0 of a closed face
    if interface.behaviour in ("contact", "no_slip"):
        bond = ""
    else:
        bond = interface.behaviour
    return _Joint(name, f"{name}: {interface.behaviour}", nodes, normal, bond=bond)


def _colours(joints: Sequence[_Joint]) -> dict[str, Colour]:
    """Colours by interface: distinct ones for those that may open; bonds have one where they are many."""
    bonds = [j.name for j in joints if j.bond]
    one = len(bonds) > _FEW_BONDS
    distinct = [j.name for j in joints if not (j.bond and one)]
    by_name = dict(zip(distinct, colours(len(distinct)), strict=True))
    if one:
        by_name |= dict.fromkeys(bonds, BONDED)
    return by_name


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
        for face in faces_of(boundary):
            body, name = split_face(face)
            nodes = assembly.bodies[body].nodes_of(name)
            skins[body] = skins[body].painted(nodes, _rgb(SUPPORTS[boundary.type]))
    for joint in assembly.joints:
        for body, nodes in joint.nodes.items():
            skins[body] = skins[body].painted(nodes, _rgb(strong[joint.name]))
            if body in joint.gap:
                skins[body] = skins[body].faded(nodes, joint.gap[body])


_Vector = tuple[Array, Array, str, str, bool]
"""Place, direction, label and colour of an arrow; whether it starts at the place (it ends there otherwise)."""


def _arrows(axis: Axes, scene: Scene, bodies: Mapping[str, Body], view: View) -> None:
    """Loads, driven faces, ports, gravity and initial velocities, all of one length."""
    everything = np.concatenate([b.mesh.nodes for b in bodies.values()])
    length = _ARROW * float(np.ptp(everything, axis=0).max())
    of_loads = _loads(scene, bodies, everything, length)
    for at, direction, text, colour, away in (*of_loads, *_motions(scene, bodies), *_of_bodies(scene, bodies)):
        size = float(np.linalg.norm(direction))
        if size > 0:
            arrow(axis, view, at, length * direction / size, colour, text, away)


def _amount(scene: Scene, value: float | Array, unit: str) -> str:
    """A number, or the size of a vector, with its unit in the system of the scene."""
    return readable(float(np.linalg.norm(value)), scene.unit_system.shown(unit), 3, figure=True)


def _loads(scene: Scene, bodies: Mapping[str, Body], everything: Array, length: float) -> Iterator[_Vector]:
    for name, load in scene.load.items():
        centre, normal = _middle(bodies, load.face)
        direction = load.arrow(normal)
        text = readable(load.amount, scene.unit_system.shown(load.unit), 3, figure=True)
        # how far the assembly reaches ahead of the face
        ahead = float(((everything - centre) @ direction).max()) / max(float(np.linalg.norm(direction)), 1e-300)
        outwards = bool(direction @ normal > 0) and ahead < 0.1 * length  # it pulls, and nothing is in the way
        yield centre, direction, f"{name}\n{text}", LOAD, outwards


def _motions(scene: Scene, bodies: Mapping[str, Body]) -> Iterator[_Vector]:
    """Driven faces and ports."""
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, Driven):
            direction = np.zeros(3)
            direction[["xyz".index(c) for c in boundary.components]] = boundary.value
            if boundary.axes is not None:
                # components along own axes -> global ones
                direction = np.array(boundary.axes.rows).T @ direction
            unit = {"velocity": "m s-1", "displacement": "m", "acceleration": "m s-2"}[boundary.type]
            text = f"{name}\n{_amount(scene, direction, unit)}"
            yield _middle(bodies, boundary.face)[0], direction, text, SUPPORTS[boundary.type], True
    for name, port in scene.port.items():
        text = f"{name}\nport, {port.causality.replace('_', ' ')}: {' '.join(port.components)}"
        colour = LOAD
        if port.causality == "motion_in":
            colour = MOTION
        yield *_middle(bodies, port.face), text, colour, True


def _of_bodies(scene: Scene, bodies: Mapping[str, Body]) -> Iterator[_Vector]:
    """Loads of all bodies, beside them; initial velocities and loads of single bodies."""
    of_body: dict[str, list[tuple[Array, str, str]]] = {
        n: [(np.asarray(b.description.initial_velocity, dtype=float), "m s-1", MOTION)] for n, b in bodies.items()
    }
    for load in scene.body_loads:
        direction, owner = load.kind.arrow(load.table), load.kind.owner(load.of)
        if direction is None:
            continue
        if owner is not None:
            of_body[owner].append((direction, load.kind.unit, LOAD))
            continue
        beside = np.min([body.mesh.nodes.min(axis=0) for body in bodies.values()], axis=0)
        yield beside, direction, f"{load.key}\n{_amount(scene, direction, load.kind.unit)}", LOAD, True
    for body in bodies.values():
        low, high = body.mesh.nodes.min(axis=0), body.mesh.nodes.max(axis=0)
        for direction, unit, colour in of_body[body.name]:
            aside = np.abs(direction) > 0.1 * np.linalg.norm(direction)
            # behind the body, so that neither arrow nor label covers it
            behind = 0.5 * (low + high) - 0.5 * (high - low) * np.sign(direction) * aside
            yield behind, direction, f"{body.name}\n{_amount(scene, direction, unit)}", colour, False


def _middle(bodies: Mapping[str, Body], face: str) -> tuple[Array, Array]:
    """Centre of a face, m, and its mean normal; an edge or point has none, (0, 0, 0)."""
    name, face_name = split_face(face)
    if face_name != ALL_OF_IT and face_name not in bodies[name].mesh.faces:
        return bodies[name].mesh.nodes[bodies[name].nodes_of(face_name)].mean(axis=0), np.zeros(3)
    facets = bodies[name].face(face_name)
    weights = np.linalg.norm(facets.vector_areas, axis=1)
    centre = weights @ bodies[name].mesh.nodes[facets.nodes] / weights.sum()
    normal = facets.vector_areas.sum(axis=0)
    return centre, normal / max(float(np.linalg.norm(normal)), 1e-300)


def _legend(figure: Figure, assembly: _Assembly, tints: Mapping[str, str], strong: Mapping[str, Colour]) -> None:
    from matplotlib.patches import Patch

    parts = [(tints[n], f"{n} ({b.description.material})") for n, b in assembly.bodies.items()]
    bonds = [joint for joint in assembly.joints if joint.bond]
    joints = [(strong[joint.name], joint.text) for joint in assembly.joints if not joint.bond]
    if len(bonds) > _FEW_BONDS:
        kinds = dict.fromkeys(joint.bond for joint in bonds)
        of_kind = {kind: [joint.name for joint in bonds if joint.bond == kind] for kind in kinds}
        bonded: list[tuple[Colour, str]] = [(BONDED, f"{kind}: {_few(names)}") for kind, names in of_kind.items()]
    else:
        bonded = [(strong[joint.name], joint.text) for joint in bonds]
    by_type: dict[str, list[str]] = {}
    for name, boundary in assembly.scene.boundary.items():
        by_type.setdefault(boundary.type, []).append(name)
    supports = [(SUPPORTS[support], f"{support}: {_few(names)}") for support, names in by_type.items()]
    items = [
        *_shortened(parts, "parts"),
        *_shortened(joints, "interfaces that may open", 2 * _MOST_NAMES),
        *bonded,
        *supports,
    ]
    handles = [Patch(facecolor=colour, edgecolor="0.3", linewidth=0.5, label=text) for colour, text in items]
    if max(len(text) for _, text in items) < 30:
        columns = 4
    else:
        columns = 3
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize="small", frameon=False)


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" ... ({len(names)})" if len(names) > 3 else "")


def _shortened(items: Sequence[tuple[Colour, str]], what: str, most: int = _MOST_NAMES) -> list[tuple[Colour, str]]:
    if len(items) <= most:
        return list(items)
    return [*items[:most], ("#FFFFFF", f"... {len(items)} {what} in all")]
