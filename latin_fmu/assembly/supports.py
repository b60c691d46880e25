"""Supports and ports of the bodies on their meshes.

Supports: prescribed motions, conditions along directions that are no global axes, and the dofs whose forces are
reactions.

A condition holds or drives the displacement of a node along unit directions, one row each, R u = V m (m the
prescribed motions, V zero where it holds). With all rows of a node together

    u = Z q + D m,    Z orthonormal, R Z = 0,    D = R^+ V

are the free displacements along the columns of Z and those that follow the motions. The columns of Z are orthonormal,
so that a mass that is equal along all directions of a node stays diagonal.

Ports on the meshes: where their motion is measured, their dashpots, the rigid motion and the reaction of a moved
face, and their outputs.

A component has one row t of the least-squares fit T, R of the motion of its face (``fem.location.MeanMotion``): the
force through the port acts by the pattern t^T, and the dashpot of a wave port, force -Z v on the mean velocity
v = t . u', is the damping matrix Z t^T t. Central differences have a diagonal matrix instead: the nodes have shares of
Z by area, so that the resultant is the same.

A moved face has u = U + Theta x r, r from the centre. What it exerts on what moves it has the resultant and the moment
of minus the reactions of its nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import Problem, Problems, SceneError
from ..fem.faces import changes_basis, consistent_dashpots, lumped_dashpots
from ..fem.location import cross_matrix
from ..fem.mesh import Array, Index
from ..latin.probes import SensorPlace, Support
from ..propagator import SubstructureModel
from ..propagator.model import diagonal_matrix
from ..scene.boundaries import AXES, Absorbing, Boundary, Driven, Fixed, Periodic, Symmetry
from ..scene.fields import split_face
from ..scene.laws import InputLaw, TimeLaw
from ..scene.ports import COMPONENTS, TRANSLATIONS, Port
from ..scene.schema import Scene
from .attachments import mean_over, place_on_face
from .body import Body

FLAT = 1e-6
"""Deviation of the normals of a plane face."""
HELD = -1
"""Number of the motion of a direction that is held."""
_DEPENDENT = 1e-6  # sine between a direction and those before it, below which it depends on them
_AGREES = 1e-9  # deviation of a motion along a direction that is set twice

NOTHING: Final[Mapping[str, Array]] = MappingProxyType({})  # no motion is set from outside


@dataclass(frozen=True)
class PrescribedMotion:
    """A prescribed velocity, displacement or acceleration, ``value`` times a law.

    ``kind``: which of the three. ``source``: name of a motion set from outside, ``boundary.NAME`` or an input of a
    port, whose histories are those of ``velocity``. ``arm``: largest displacement of a node per unit of it, m.
    ``speed``: velocity at t = 0 of one given by accelerations, m s-1.
    """

    law: TimeLaw
    value: float
    kind: Literal["velocity", "displacement", "acceleration"]
    source: str = ""
    arm: float = 1.0
    speed: float = 0.0

    def driving(
        self, time: Array, over_steps: bool = False, amplitudes: Mapping[str, Array] = NOTHING, end: float = np.inf
    ) -> Array:
        """What drives the motion at the instants, (n_time,): velocity or acceleration there; of a displacement law its
        rate over the step that begins there, so that the place is exact at every instant.

        over_steps : of a velocity, its mean over the step that ends at an instant. amplitudes : by source, amplitudes
        (n_time,) in the place of the law's, of a displacement such rates. end : last instant of the scene, s, which is
        no corner of a law that ends there.
        """
        if self.source in amplitudes:
            at: Array = self.value * amplitudes[self.source]
        elif self.kind == "displacement":
            at = self.value * rates_of_steps(self.law.sample, time, end)
        else:
            at = self.value * self.law.sample(time)
        if over_steps and self.kind == "velocity":
            return np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1])])
        return at

    def start(self) -> float:
        """Displacement at t = 0, m."""
        if self.kind == "displacement":
            return self.value * float(self.law.sample(np.zeros(1))[0])
        return 0.0

    def start_velocity(self) -> float:
        """Velocity at t = 0 that the condition gives, m s-1; 0 of displacements, whose path may have a corner there."""
        if self.kind == "velocity":
            return self.value * float(self.law.sample(np.zeros(1))[0])
        return self.speed

    def largest_speed(self, time: Array) -> float:
        """Largest velocity at the instants, m s-1; an input counts as 1 at least, its displacement as if it took the
        whole time."""
        size = self.arm * abs(self.value)
        if isinstance(self.law, InputLaw):
            size *= max(abs(self.law.start_value), 1.0)
            end = float(time[-1])
            return {"velocity": size, "displacement": size / end, "acceleration": abs(self.speed) + size * end}[
                self.kind
            ]
        speeds = self.arm * self.driving(time)
        if self.kind == "acceleration":
            speeds = self.arm * self.speed + np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(time))
        return float(np.abs(speeds).max())


def rates_of_steps(place: Callable[[Array], Array], time: Array, end: float = np.inf) -> Array:
    """Rates (n_time,) of a displacement over the steps that begin at the instants, 1/s; at ``end``, the last instant of
    the scene, over the step before, as a path that ends there has no corner."""
    step = time[1] - time[0]
    last = (time <= end + 1e-6 * step) & (time + step > end + 1e-6 * step)
    begin = np.where(last, time - step, time)
    rates: Array = (place(begin + step) - place(begin)) / step
    return rates


def inclined_directions(body: Body, boundary: Boundary) -> Array | None:
    """Unit directions (n, 3) that a condition holds or drives, where they are no global axes; else None."""
    if isinstance(boundary, Symmetry):
        normals = body.face(split_face(boundary.face)[1]).normals
        mean: Array = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
        plane = np.abs(normals - mean).max() <= FLAT
        if plane and np.abs(mean).max() < 1 - FLAT:
            return np.array([mean])
        return None
    if isinstance(boundary, Fixed | Driven) and boundary.axes is not None:
        return np.array(boundary.axes.rows)[[AXES.index(component) for component in boundary.components]]
    return None


@dataclass
class Directions:
    """Directions of nodes that are held or driven.

    Attributes
    ----------
    rows : by node: unit directions (3,), the number of the motion that drives them, and the name of the condition.
    """

    rows: dict[int, list[tuple[Array, int, str]]] = field(default_factory=dict)

    def add(self, nodes: Index, directions: Array, motions: list[int], name: str) -> None:
        """Set directions (n, 3) of nodes; ``motions`` : numbers of motions (n,), ``HELD`` where they are held."""
        for node in nodes.tolist():
            rows = self.rows.setdefault(node, [])
            rows += [(d, m, name) for d, m in zip(directions, motions, strict=True)]

    def add_axes(self, fixed: NDArray[np.bool_], driver: Index) -> None:
        """Add the global axes along which the same nodes are held or driven, (n_full,)."""
        for node, rows in self.rows.items():
            dofs = 3 * node + np.flatnonzero(fixed[3 * node : 3 * node + 3] | (driver[3 * node : 3 * node + 3] >= 0))
            rows += [(np.eye(3)[dof % 3], HELD if fixed[dof] else int(driver[dof]), "") for dof in dofs.tolist()]

    def solved(self, n_motion: int, tied: Index, problems: Problems) -> dict[int, tuple[Array, Array]]:
        """Z (3, n_free) and D (3, n_motion) by node; empty, with a problem, where conditions contradict each other or
        nodes are ``tied`` to others."""
        solutions: dict[bytes, tuple[Array, Array] | None] = {}
        found: dict[int, tuple[Array, Array]] = {}
        for node, rows in self.rows.items():
            # nodes with equal conditions are solved once
            key = np.concatenate([np.append(d, m) for d, m, _ in rows]).tobytes()
            if key in solutions:
                solution = solutions[key]
            else:
                solution = solutions.setdefault(key, _solved(rows, n_motion))
            if solution is None:
                problems.add(
                    f"boundary.{[name for _, _, name in rows if name][-1]}",
                    "drives nodes that another condition already fixes or drives",
                    remedy="shared edges belong to one condition: omit the component in one of them",
                )
                return {}
            found[node] = solution
        if shared := set(found) & set(tied.tolist()):
            # the least node, so that the message does not depend on the order of the set
            problems.add(
                f"boundary.{self.rows[min(shared)][0][2]}",
                "turns nodes of a periodic face",
                remedy="periodic faces allow no conditions along local axes",
            )
            return {}
        return found

    def matrices(self, n_full: int, n_motion: int) -> tuple[sp.csr_array, Array]:
        """All rows R (n_row, n_full) and V (n_row, n_motion)."""
        every = [(node, d, m) for node, rows in self.rows.items() for d, m, _ in rows]
        places = (
            np.repeat(np.arange(len(every)), 3),
            (3 * np.array([e[0] for e in every])[:, None] + range(3)).ravel(),
        )
        values = np.concatenate([e[1] for e in every])
        pattern = np.zeros((len(every), n_motion))
        for i, (_, _, motion) in enumerate(every):
            if motion != HELD:
                pattern[i, motion] = 1.0
        return sp.coo_array((values, places), shape=(len(every), n_full)).tocsr(), pattern


def _solved(rows: list[tuple[Array, int, str]], n_motion: int) -> tuple[Array, Array] | None:
    """Z and D of one node, None where its conditions contradict each other."""
    basis, values = np.zeros((0, 3)), np.zeros((0, n_motion))  # orthonormal rows and the motions along them
    for direction, motion, _ in rows:
        motion_row = np.zeros(n_motion)
        if motion != HELD:
            motion_row[motion] = 1.0
        share = basis @ direction
        # what is new in the direction, and what is left of its motion for that
        rest, rest_values = direction - share @ basis, motion_row - share @ values
        size = float(np.linalg.norm(rest))
        if size > _DEPENDENT:
            basis, values = np.vstack([basis, rest / size]), np.vstack([values, rest_values / size])
        # another motion along a direction that those before determine
        elif np.abs(rest_values).max(initial=0.0) > _AGREES:
            return None
    free: list[Array] = []
    for axis in np.argsort(np.linalg.norm(basis, axis=0), kind="stable"):  # the axes that are least held come first
        rest = np.eye(3)[axis]
        for taken in (*basis, *free, *basis, *free):  # twice is enough for round-off
            rest = rest - (taken @ rest) * taken
        if len(free) < 3 - len(basis) and np.linalg.norm(rest) > 0.1:
            free.append(rest / np.linalg.norm(rest))
    directions = np.array(free).reshape(-1, 3).T
    # the rows of the basis are orthonormal: its transpose is R^+
    return np.where(np.abs(directions) < 1e-15, 0.0, directions), basis.T @ values


def with_directions(
    expansion: sp.csr_array, pattern: Array, solved: Mapping[int, tuple[Array, Array]]
) -> tuple[sp.csr_array, Array]:
    """Expansion and pattern of a body whose other nodes have theirs, with those of nodes of ``Directions.solved``."""
    dofs = (3 * np.fromiter(solved, dtype=np.int64)[:, None] + np.arange(3)).ravel()
    unchanged = np.ones(expansion.shape[0], dtype=bool)
    unchanged[dofs] = False
    rest = sp.csr_array(sp.diags_array(unchanged.astype(float)) @ expansion)
    rest.eliminate_zeros()
    # without the columns that turned nodes alone had
    rest = sp.csr_array(rest[:, np.flatnonzero(np.bincount(rest.indices, minlength=rest.shape[1]))])
    block = sp.coo_array(sp.block_diag([sp.coo_array(z) for z, _ in solved.values()]))
    shape = (expansion.shape[0], block.shape[1])
    turned = sp.coo_array((block.data, (dofs[block.coords[0]], block.coords[1])), shape=shape).tocsr()
    moved = pattern.copy()
    moved[dofs] = np.concatenate([d for _, d in solved.values()])
    whole = sp.csr_array(sp.hstack([rest, turned], format="csr"))
    whole.eliminate_zeros()
    return whole, moved


def shared_out(holding: Sequence[tuple[Index, Array]], n_full: int) -> list[sp.csr_array]:
    """Sums (3, n_full) of what each support takes of nodal forces.

    A support exerts forces on its nodes along its directions, with the projector P_i. Where several hold a node, their
    forces P_i f_i have the sum r, and the least sum of squares among all that have it:

        f_i = P_i S^+ r,   S = sum of P_i

    Along a direction that n supports hold, each has r / n; independent directions have what r has along them. Neither
    names, order nor frame change it.

    holding : by support, nodes (n,) and orthonormal directions (n_direction, 3).
    """
    total = np.zeros((n_full // 3, 3, 3))
    for nodes, directions in holding:
        total[nodes] += directions.T @ directions
    sums = []
    for nodes, directions in holding:
        # directions nearer than _DEPENDENT have an eigenvalue of half its square
        inverse = np.linalg.pinv(total[nodes], rcond=0.25 * _DEPENDENT**2, hermitian=True)
        parts = (directions.T @ directions) @ inverse
        rows = np.tile(np.repeat(np.arange(3), 3), len(nodes))
        columns = (3 * nodes[:, None] + np.tile(np.arange(3), 3)).ravel()
        whole = sp.coo_array((parts.ravel(), (rows, columns)), shape=(3, n_full)).tocsr()
        whole.eliminate_zeros()
        sums.append(whole)
    return sums


def held_directions(name: str, boundary: Fixed | Driven | Symmetry, body: Body) -> tuple[Index, Array]:
    """Nodes (n,) and unit directions (n_direction, 3) that a condition holds or drives."""
    face = split_face(boundary.face)[1]
    if isinstance(boundary, Fixed):
        nodes = body.nodes_of(face)
    else:
        nodes = body.face(face).nodes
    if np.isin(nodes, body.rigid_nodes).any():
        what = f"boundary {name} holds nodes of a face that a coupling makes rigid, which carry its forces, too"
        problem = Problem("output.reactions", what, remedy="omit output.reactions, or rigid")
        raise SceneError([problem], "the scene cannot be built")
    directions = inclined_directions(body, boundary)
    if directions is not None:
        return nodes, directions
    if isinstance(boundary, Symmetry):
        # the face of a symmetry lies across one axis
        return nodes, np.eye(3)[[int(np.argmax(np.abs(body.face(face).normals[0])))]]
    return nodes, np.eye(3)[[AXES.index(component) for component in boundary.components]]


def supports(
    boundaries: Mapping[str, Boundary], bodies: Mapping[str, Body], models: Mapping[str, SubstructureModel]
) -> dict[str, Support]:
    """Supports of the elastic bodies: what each boundary takes of the forces on the nodes that it holds or drives."""
    faces = {n: b.face for n, b in boundaries.items() if not isinstance(b, Absorbing | Periodic)}
    holding: dict[str, dict[str, tuple[Index, Array]]] = {}
    for name, boundary in boundaries.items():
        if isinstance(boundary, Absorbing | Periodic):
            continue
        body = bodies[split_face(boundary.face)[0]]
        if not body.rigid:
            holding.setdefault(body.name, {})[name] = held_directions(name, boundary, body)
    supported = {}
    for body_name, directions in holding.items():
        sums = shared_out(list(directions.values()), bodies[body_name].full_size())
        for name, whole in zip(directions, sums, strict=True):
            supported[name] = Support(body_name, faces[name], models[body_name], whole)
    # in the order of the scene
    return {name: supported[name] for name in boundaries if name in supported}


def absorbing_dashpots(body: Body, face_name: str) -> tuple[sp.csr_array, sp.csr_array]:
    """Dashpots of an absorbing face, and the same lumped."""
    facets, impedance = body.facets(face_name), body.shape.elasticity.impedance
    lumped = lumped_dashpots(body.mesh.nodes, facets, impedance)
    if not changes_basis(facets):
        return lumped, lumped
    return consistent_dashpots(body.mesh.nodes, facets, impedance), lumped


_MOST = 3000  # nodes of a face whose dashpot couples all of them: nine million entries
_MOVES = 1e-9  # of the size of a face: a node displaced less by a rotation does not move


def port_key(name: str, turned: bool = False) -> str:
    """Name of the measured motion, or reaction, of a port: its translation (force), or its rotation (moment)."""
    if turned:
        return f"port.{name}.rotation"
    return f"port.{name}"


def port_places(scene: Scene, bodies: Mapping[str, Body]) -> dict[str, SensorPlace]:
    """Places where the motion of ports is measured, by ``port_key``; a rotation has the rows of one for its arm."""
    places = {}
    for name, port in scene.port.items():
        if port.causality == "motion_in":
            continue
        body = bodies[port.body]
        motion, mean = place_on_face(body, port.face).motion, mean_over(body, port.face)
        places[port_key(name)] = SensorPlace(port.body, mean.rows(body.mesh.n_node), motion.centre, port.face)
        if port.rotates:
            assert motion.rotation is not None, "a face of one node"
            places[port_key(name, turned=True)] = SensorPlace(port.body, motion.rotation, motion.centre, port.face)
    return places


def port_lines(scene: Scene, bodies: Mapping[str, Body]) -> list[str]:
    """Face, inputs, centre and area of every port, and rho c A of its body, for the command ``check``."""
    lines, units = [], scene.unit_system
    for name, port in scene.port.items():
        place, material = place_on_face(bodies[port.body], port.face), bodies[port.body].shape.elasticity
        area, at = place.area, place.point
        along = float(material.moduli_along(place.face.normals)[0].mean())
        bar = area * float(np.sqrt(along * material.density))
        centre = ", ".join(f"{round(float(x), 9) + 0.0:.6g}" for x in at)
        lines.append(
            f"  port {name}: {port.causality.replace('_', ' ')}, {' '.join(port.components)} of {port.face}, centre "
            f"[{centre}], {area:.6g} {units['m2']}; impedance of a bar of this section {bar:.4g} {units['N s m-1']}"
        )
    return lines


# -- wave ports -------------------------------------------------------------------------------------------------------
def port_dashpots(body: Body, name: str, port: Port, diagonal: bool, problems: Problems) -> sp.csr_array:
    """Dashpots (n_full, n_full) of a wave port, N s m-1; with ``diagonal`` those of translations by area. A face of too
    many nodes is added to ``problems``."""
    place = place_on_face(body, port.face)
    motion, face = place.motion, place.face
    full, shares = sp.csr_array((body.full_size(), body.full_size())), np.zeros((body.mesh.n_node, 3))
    if len(face.nodes) > _MOST and not diagonal:
        problems.add(
            f"port.{name}.face",
            "the dashpot of a wave port couples every node of its face with every other one",
            f"{port.face} with {len(face.nodes)} nodes",
            f"at most {_MOST} nodes",
            'name a smaller face, choose causality = "force_in", or the explicit propagator',
        )
        return full
    for component, impedance in zip(port.components, port.impedance or (), strict=True):
        if diagonal:
            # shared out by area: a diagonal matrix, which an explicit march can divide by
            shares[face.nodes, COMPONENTS.index(component)] = impedance * face.areas / face.areas.sum()
            continue
        rows = motion.rotation
        if component in TRANSLATIONS:
            rows = motion.translation
        assert rows is not None
        row = sp.csr_array(rows[[COMPONENTS.index(component) % 3]])
        # Z times the mean motion, spread as that is measured: r^T Z r
        full = sp.csr_array(full + impedance * (row.T @ row))
    if diagonal:
        return diagonal_matrix(shares.ravel())
    return full


# -- moved faces ------------------------------------------------------------------------------------------------------
def port_shapes(body: Body, name: str, port: Port, problems: Problems) -> tuple[Index, Array]:
    """Dofs (n,) that a moved face drives, and their displacements (n, n_component) for unit motions of the components;
    a rotation that would move nodes along an axis that is not driven is added to ``problems``."""
    place = place_on_face(body, port.face)
    arms = place.arms
    shapes = np.zeros((len(arms), 3, len(port.components)))
    for j, component in enumerate(port.components):
        axis = np.eye(3)[COMPONENTS.index(component) % 3]
        if component in TRANSLATIONS:
            shapes[:, :, j] = axis
        else:
            shapes[:, :, j] = np.cross(axis, arms)
    driven = [component in port.components for component in TRANSLATIONS]
    for j, component in enumerate(port.components):
        # a rotation must not drag nodes along an axis that stays free
        stray = np.abs(shapes[:, :, j]).max(axis=0) > _MOVES * np.abs(arms).max()
        if missing := [TRANSLATIONS[i] for i in np.flatnonzero(stray & ~np.array(driven))]:
            problems.add(
                f"port.{name}.components",
                f"the rotation {component} moves nodes of the face along {', '.join(missing)}",
                ", ".join(port.components),
                "translations along every axis that a rotation moves nodes along",
                f"add {', '.join(missing)} to the components, or leave {component} out",
            )
    dofs = (3 * place.face.nodes[:, None] + np.flatnonzero(driven)).ravel()
    return dofs, shapes[:, driven].reshape(len(dofs), -1)


def port_motions(body: Body, name: str, port: Port) -> list[PrescribedMotion]:
    """Motions of the components of a moved face, in their order."""
    arms = {c: 1.0 if c in TRANSLATIONS else body.mesh.size for c in port.components}
    return [PrescribedMotion(port.law(c), 1.0, "velocity", n, arms[c]) for n, c in port.inputs(name).items()]


def port_supports(
    scene: Scene, bodies: Mapping[str, Body], models: Mapping[str, SubstructureModel]
) -> dict[str, Support]:
    """Supports whose reactions are the force and the moment of moved faces, by ``port_key``."""
    by_key = {}
    for name, port in scene.port.items():
        if port.causality != "motion_in":
            continue
        place = place_on_face(bodies[port.body], port.face)
        nodes, arms = place.face.nodes, place.arms
        driven = np.array([component in port.components for component in TRANSLATIONS], dtype=float)
        for turned, blocks in ((False, np.tile(np.eye(3), (len(arms), 1, 1))), (True, cross_matrix(arms))):
            if turned and not port.rotates:
                continue
            columns = np.broadcast_to(3 * nodes[:, None, None] + np.arange(3), blocks.shape)
            rows = np.broadcast_to(np.arange(3)[:, None], blocks.shape)
            # columns of components that the port does not drive have no part in its reaction
            entries = ((blocks * driven).ravel(), (rows.ravel(), columns.ravel()))
            parts = sp.csr_array(sp.coo_array(entries, shape=(3, place.body.full_size())))
            parts.eliminate_zeros()
            by_key[port_key(name, turned)] = Support(port.body, port.face, models[port.body], parts)
    return by_key
