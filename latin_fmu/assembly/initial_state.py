"""State at t = 0: displacements and velocities given by the scene, or an equilibrium that the run starts from.

Misfits of given fields are refused, changes by the supports are remarks. A field given by a file belongs to the nodes
of a mesh. Each node takes the values of the nearest point, whose distance may be 1 % of the smallest distance between
two nodes, which leaves room for rounded coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import Problem, Problems
from ..fem.mesh import nearest
from ..latin.assembly import Array, Assembly, InterfaceUnit
from ..latin.outcome import BoltHistory
from ..latin.probes import BoltPlace
from ..latin.state_serialization import decode, encode
from ..propagator.model import closest_reduced
from ..remarks import Remark
from ..scene.fields import GROUND, split_face
from ..scene.schema import Scene
from .body import Body
from .bolts import BoltCut
from .conditions import Conditions, RigidConditions
from .models import ModelClass
from .press_fits import fits

_BESIDE: Final = 0.01  # of the smallest distance between nodes
_TEARS: Final = 1e-3  # of the largest displacement: meshes that do not match interpolate a curved field differently
_NO_JUMP: Final = 1e-9  # of the largest value on the bodies: round-off of motions that are the same
_FIELDS: Final = ("displacement", "traction", "closure", "amplitudes")
_KIND: Final = "state at t = 0"
_CHANGED: Final = 1e-9  # of the largest value of a field: round-off of conditions along inclined axes


def check_fields(bodies: Mapping[str, Body], problems: Problems, remarks: list[Remark]) -> None:
    """Refuse files without a point at a node, as those of a coarser mesh are; a finer mesh is a remark."""
    for name, body in bodies.items():
        for key in ("initial_velocity_field", "initial_displacement_field"):
            file = getattr(body.description, key)
            if file is None:
                continue
            # a results file: its nodes are those of a mesh
            if file.time is not None and len(file.points) != body.mesh.n_node:
                counts = f"the mesh of {name} in {file.file} has {len(file.points)} nodes, that of the scene "
                counts += f"{body.mesh.n_node}"
                if len(file.points) < body.mesh.n_node:
                    remedy = "use the results of a run with the same mesh, or give the field at the nodes of this mesh"
                    problems.append(Problem("initial_state.file", counts, None, "the same mesh", remedy))
                    break  # the other field is of the same file
                # said once, not for both fields
                if key == "initial_velocity_field":
                    text = f"initial state: {counts}: the values at common nodes are used"
                    remarks.append(Remark("initial_state", text))
            distance, number = nearest(body.mesh.nodes, np.asarray(file.points, dtype=float))
            spacing = _smallest_distance(body.mesh.nodes)
            worst = int(np.argmax(distance))
            if distance[worst] > _BESIDE * spacing:
                apart = int((distance > _BESIDE * spacing).sum())
                at, near = (_point(x) for x in (body.mesh.nodes[worst], file.points[number[worst]]))
                problems.add(
                    f"substructure.{name}.{key}.file",
                    f"{apart} of {len(distance)} nodes have no point of the file: the one nearest to the node {at} is "
                    f"{near}, {distance[worst]:.4g} {body.units['m']} from it",
                    file.file,
                    f"a distance of {_BESIDE * spacing:.4g} {body.units['m']}, {100 * _BESIDE:g} % of the smallest "
                    "one between nodes",
                    "give a row for every node of this mesh; check length_unit and the columns",
                )


def _smallest_distance(nodes: Array) -> float:
    """Smallest distance between two nodes at different places, m."""
    from scipy.spatial import cKDTree

    # nodes of the same place, as of a torn mesh, have distance 0
    unique = np.unique(nodes, axis=0)
    distance = np.asarray(cKDTree(unique).query(unique, k=2)[0])
    return float(distance[:, 1].min())


def _point(x: object) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in np.asarray(x, dtype=float)) + "]"


def field_remarks(scene: Scene, bodies: Mapping[str, Body], conditions: Mapping[str, Conditions]) -> list[str]:
    """Fields that supports change, and those of which a reduced basis keeps a part."""
    remarks = []
    for name, body in bodies.items():
        condition = conditions[name]
        if isinstance(condition, RigidConditions):
            continue
        # how far each dof moves with the driven faces
        if condition.pattern.size == 0:
            moved = np.zeros(body.full_size())
        else:
            moved = np.abs(condition.pattern).sum(axis=1)
        if condition.pattern.size:
            start = condition.pattern @ condition.start()
        else:
            start = np.zeros(body.full_size())
        for kind, body_field, whole, driven_field, counts in (
            ("displacement", body.displacement_field, body.initial_displacement, start, np.ones(len(moved), bool)),
            # velocities of driven dofs are those of the motion, and are not compared
            ("velocity", body.velocity_field, body.initial_velocity, np.zeros(len(moved)), moved == 0),
        ):
            if body_field is None:
                continue
            free = (whole() - driven_field)[:, None]
            # what the conditions cannot represent; at driven nodes velocities are those of the motion
            unmet = free - condition.expansion @ closest_reduced(condition.expansion, free)
            residual = np.where(counts, unmet[:, 0], 0.0)
            changed = np.abs(residual) > _CHANGED * np.abs(free).max()
            if changed.any():
                unit = body.units["m" if kind == "displacement" else "m s-1"]
                remarks.append(
                    f"substructure {name}: conditions override the initial {kind} field at "
                    f"{len(np.unique(np.flatnonzero(changed) // 3))} nodes; the largest change is "
                    f"{np.abs(residual).max():.3g} {unit}"
                )
            if scene.solver.propagator.type == "reduced":
                remarks.append(
                    f"substructure {name}: the initial {kind} field is projected onto the modes and static shapes of "
                    "the reduced basis, nearest in the norm of the mass"
                )
    return remarks


def field_tractions(body: Body, impedance: float) -> Iterator[float]:
    """Largest tractions that the fields of a body bring, Pa: its impedance (Pa s m-1) times the largest speed, and the
    largest mean stress of an element."""
    if body.velocity_field is not None:
        yield impedance * float(np.linalg.norm(body.velocity_field, axis=1).max())
    if body.displacement_field is not None:
        yield float(np.abs(body.shape.stress(body.displacement_field)).max())


def initial_problems(
    scene: Scene, bodies: Mapping[str, Body], units: list[InterfaceUnit], problems: Problems, remarks: list[Remark]
) -> None:
    """Overlaps, open preloads and torn bonds that initial displacements make; velocity jumps of bonds are remarks."""
    static = scene.time.start.type == "static"
    for unit in units:
        first, second = (None if side == GROUND else scene.substructure[split_face(side)[0]] for side in unit.sides)
        assert first is not None
        where = f"interface.{unit.name}"
        if unit.behaviour.compliant:  # a layer takes any jump
            continue
        zero = (0.0, 0.0, 0.0)
        # of E' over E
        if second is None:
            moved = zero
        else:
            moved = second.initial_displacement
        uniform = np.subtract(moved, first.initial_displacement)
        by_field, level = _jump(unit, bodies, "displacement_field")
        jump = uniform + by_field
        if not unit.behaviour.opens:
            worst = jump[int(np.argmax(np.abs(jump).max(axis=1)))]
            if np.abs(worst).max() > max(_TEARS * level, _NO_JUMP * _largest(unit, bodies, "displacement")):
                problems.add(
                    where,
                    "initial displacements separate a bonded interface",
                    str(worst.tolist()),
                    remedy="give both sides the same initial displacement",
                )
            if _velocities_differ(scene, unit, bodies):
                text = (
                    "bonded sides start with different velocities; the jump is lost in the first step, with its energy"
                )
                remarks.append(Remark("initial_state", f"interface {unit.name}: {text}"))
            continue
        # N points from E to E': moving apart along it opens
        gap = unit.geometry.gap + np.einsum("pi,pi->p", unit.geometry.frames[:, 0], jump)
        size = float(np.ptp(unit.geometry.points, axis=0).max())
        # an overlap of the meshes is that of a press fit, which a static start closes
        if not fits([unit]) or not static:
            deeper = gap
        else:
            deeper = gap - np.minimum(unit.geometry.gap, 0.0)
        if deeper.min() < -1e-9 * max(size, float(np.abs(jump).max())):
            problems.add(
                where,
                "the sides overlap at the start",
                f"by {-gap.min():.6g} {scene.unit_system['m']} in all",
                remedy="change the initial displacements (with [initial_state], choose an instant at which the "
                "contact is open), or move the meshes apart",
            )
        # a gap of the scene itself has been reported with the interface
        elif unit.preload > 0 and gap.max() > 1e-9 * size and not unit.geometry.gap.any():
            problems.add(
                f"{where}.preload",
                "a preloaded interface cannot be open",
                f"{gap.max():.6g} {scene.unit_system['m']}",
                remedy="leave out the initial displacement that opens it, or the preload",
            )


def _jump(unit: InterfaceUnit, bodies: Mapping[str, Body], field: str) -> tuple[Array, float]:
    """Jump of a field across an interface (n_point, 3), side E' minus side E, and the largest value on the sides."""
    jump, level = np.zeros((unit.geometry.n_point, 3)), 0.0
    for side, face in enumerate(unit.sides):
        values = None
        if face != GROUND:
            values = getattr(bodies[split_face(face)[0]], field)
        trace = unit.geometry.traces[side]
        if values is not None and trace is not None:
            at_points = np.asarray(trace @ values.ravel()).reshape(-1, 3)
            level = max(level, float(np.abs(at_points).max(initial=0.0)))
            # E' less E
            jump += (2 * side - 1) * at_points
    return jump, level


def _velocities_differ(scene: Scene, unit: InterfaceUnit, bodies: Mapping[str, Body]) -> bool:
    """Whether the sides of an interface start with different velocities: translation, spin and fields of the bodies,
    and the motion of the ground."""
    jump = np.zeros((unit.geometry.n_point, 3))
    level = 0.0
    tears = 0.0
    for side, (face, trace) in enumerate(zip(unit.sides, unit.geometry.traces, strict=True)):
        if face == GROUND or trace is None:
            moving = scene.joints[unit.name].ground_velocity
            if moving is None:
                continue
            at_points = np.asarray(moving.vector, dtype=float) * float(moving.law.sample(np.zeros(1))[0])
        else:
            body = bodies[split_face(face)[0]]
            at_points = np.asarray(trace @ body.initial_velocity()).reshape(-1, 3)
            # meshes that do not match interpolate linear motions exactly
            if body.description.initial_velocity_field is not None:
                tears = _TEARS
        level = max(level, float(np.abs(at_points).max(initial=0.0)))
        # E' less E
        jump += (2 * side - 1) * at_points
    limit = max(tears * level, _NO_JUMP * max(level, _largest(unit, bodies, "velocity")))
    # rods keep their normal components alone
    components = np.einsum("pc,pjc->pj", jump, unit.geometry.frames[:, : unit.behaviour.n_component])
    return bool(np.abs(components).max(initial=0.0) > limit)


def _largest(unit: InterfaceUnit, bodies: Mapping[str, Body], kind: str) -> float:
    """Largest initial velocity, m s-1, or displacement, m, anywhere on the bodies of an interface, whose round-off the
    values at a face have."""
    fields = [getattr(bodies[split_face(face)[0]], f"initial_{kind}")() for face in unit.sides if face != GROUND]
    return max(float(np.abs(values).max(initial=0.0)) for values in fields)


@dataclass(frozen=True)
class TightBolts:
    """Bolts of a scene after those of each order were tightened.

    Attributes
    ----------
    shortening : of each bolt, m. orders : in which they were tightened. forces : tension of every bolt when those of
        each of the orders were tight, (n_order,), N.
    """

    shortening: Mapping[str, float] = field(default_factory=dict)
    orders: tuple[int, ...] = ()
    forces: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def locked(self, cuts: Mapping[str, BoltCut]) -> dict[str, tuple[float, float]]:
        """First and last amplitude of the load terms of bolts whose shortening is kept."""
        shortenings = {name: self.shortening.get(name, 0.0) for name in cuts}
        return {name: (delta, delta) for name, delta in shortenings.items()}

    def places(
        self,
        cuts: Mapping[str, BoltCut],
        temperatures: Mapping[str, Mapping[str, float]],
        elongation: Mapping[str, Array],
    ) -> dict[str, BoltPlace]:
        """The bolts for the recorder; ``temperatures`` : changes, K, by bolt and load term. ``elongation`` : plastic
        (n_time,), m, by bolt."""
        places = {}
        for name, cut in cuts.items():
            table, delta = cut.table, self.shortening.get(name, 0.0)
            forces = self.forces.get(name, ())
            about = BoltHistory(
                name,
                table.substructure,
                table.order,
                cut.tension,
                cut.area,
                delta,
                np.zeros(0),
                self.orders,
                forces,
                elongation.get(name),
                table.size,
                cut.thread_area,
                cut.share,
                cut.named,
                clamped=cut.clamped,
                screw=cut.screw,
            )
            places[name] = BoltPlace(table.substructure, cut.rows, about, cut.terms(temperatures.get(name, {})))
        return places


@dataclass(frozen=True)
class InitialState:
    """Displacements and interface tractions in equilibrium.

    Attributes
    ----------
    displacement : (n_full,) by substructure, m. traction : (n_point, n_component) on side E by interface, local frames,
        Pa. closure : (n_point,) by interface, m: residual gaps of closed points, within the tolerance.
    amplitudes : of the loads that are set from outside. message : how it was computed. remarks : warnings.
    bolts : as tightened. sets_off : whether bodies begin to move from it: those that fall, and displaced ones.
    left_out : interfaces that are no part of the static problem, as they hold nothing.
    """

    displacement: Mapping[str, Array]
    traction: Mapping[str, Array]
    closure: Mapping[str, Array]
    amplitudes: Mapping[str, float]
    message: str
    remarks: tuple[str, ...] = ()
    bolts: TightBolts = field(default_factory=TightBolts)
    sets_off: bool = False
    left_out: tuple[str, ...] = ()

    def displaced(self, classes: list[ModelClass]) -> list[ModelClass]:
        """The classes with these initial displacements."""
        return [
            replace(c, members=[m.displaced(self.displacement.get(m.name, m.displacement)) for m in c.members])
            for c in classes
        ]

    def hand_over(self, assembly: Assembly) -> None:
        """Give an assembly the tractions, and the gaps of closed points as zero.

        A residual gap, small as it is, would have to close within the first step; in a short step that is a velocity.
        """
        assembly.sets_off = self.sets_off
        for i, unit in enumerate(assembly.interfaces):
            if unit.name in self.traction:
                assembly.start_tractions[i] = self.traction[unit.name]
            if unit.name in self.closure and not assembly.quasi_static:
                group = assembly.layout.group(i)
                group.gap[group.members[i]] = unit.geometry.gap - self.closure[unit.name]


def state_arrays(state: InitialState | None) -> dict[str, NDArray[Any]]:
    """A state as an array of bytes for an ``OperatorStore``."""
    tree: dict[str, Any] | None = None
    if state is not None:
        tree = {key: dict(getattr(state, key)) for key in _FIELDS}
        tree |= {"message": state.message, "remarks": state.remarks, "bolts": asdict(state.bolts)}
        tree |= {"left_out": state.left_out}
    return {"state": np.frombuffer(encode(tree, _KIND), dtype=np.uint8)}


def state_of(arrays: Mapping[str, NDArray[Any]]) -> InitialState | None:
    """The state from ``state_arrays``."""
    tree = decode(arrays["state"].tobytes(), _KIND)
    if tree is None:
        return None
    bolts = tree["bolts"]
    forces = {name: tuple(values) for name, values in bolts["forces"].items()}
    tight = TightBolts(bolts["shortening"], tuple(bolts["orders"]), forces)
    lists = {"remarks": tuple(tree["remarks"]), "left_out": tuple(tree["left_out"])}
    return InitialState(**tree | lists | {"bolts": tight})
