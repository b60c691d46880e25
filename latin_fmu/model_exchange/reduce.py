"""Scene -> reduced model: bonded substructures as bodies, patches and bonds of interfaces, Ritz coordinates, a static
check of the patches, names of the variables.

A patch resists the mean motion of its points only. Where a body bends between the points of a patch (a punch on the
middle of a plate) the reduced contact is too soft: forces come late and are too small, even where impulses agree.

Variables are those shared with co-simulation, then states, their derivatives, event indicators; the place in the table
is the value reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.body import side_impedance
from ..assembly.interfaces import completed
from ..assembly.merged_assembly import jump, merge, placed
from ..assembly.problem import DiscretisedProblem, characteristic_traction
from ..building import discretise
from ..cholesky.factor import CholeskyFactor
from ..cosim.output_table import ENERGY
from ..cosim.variable import Variable, output, parameter
from ..cosim.variables import scalar_table
from ..errors import Problem, SceneError
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, Index, InterfaceUnit
from ..latin.probes import SensorPlace
from ..propagator import SubstructureModel
from ..propagator.model import reduced_rank
from ..propagator.reduction import ReducedModel, reduce_model
from ..scene.boundaries import Driven
from ..scene.fields import GROUND, split_face
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from ..scene.settings import HHTTable
from ..time_scheme import NO_BRANCHES
from .equations import (
    DAMPING,
    ENERGY_NAMES,
    EVENTS,
    OUTPUTS,
    SLIDING,
    STIFFNESS,
    WORKS,
    Bond,
    Branch,
    Contacts,
    Local,
    Names,
    ReducedSystem,
    Regularisation,
)

_SAME = 1e-9  # of the extent: coordinates closer than this are equal, whatever the round-off


@dataclass(frozen=True)
class BondedBody:
    """One or more substructures that perfect interfaces hold together.

    Attributes
    ----------
    name : names of the substructures, joined by ``_``. model : matrices of all of it.
    members : the substructures. where : their full dofs among those of ``model``.
    """

    name: str
    model: SubstructureModel
    members: dict[str, SubstructureModel]
    where: dict[str, slice]


def is_bond(unit: InterfaceUnit) -> bool:
    """Whether an interface neither opens nor slides."""
    return unit.behaviour.name == "perfect"


def bonded_bodies(discretised: DiscretisedProblem) -> list[BondedBody]:
    """Bodies of a scene, in the order of its substructures."""
    models = {m.name: m for c in discretised.classes for m in c.members}
    names = [n for n in discretised.scene.substructure if n in models]
    place = {n: i for i, n in enumerate(names)}
    bonds = [u for u in discretised.units if is_bond(u)]
    ends = np.array([[place[split_face(s)[0]] for s in u.sides] for u in bonds if GROUND not in u.sides])
    ends = ends.reshape(-1, 2)  # no bonds: (0,) -> (0, 2)
    graph = sp.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(names), len(names)))
    _, label = connected_components(graph, directed=False)
    bodies = []
    for number in dict.fromkeys(label):  # in the order of the scene
        members = [models[n] for n, i in zip(names, label, strict=True) if i == number]
        member_names = {m.name for m in members}
        # bonds with the ground are refused before: side E is of the body
        joined = [u for u in bonds if split_face(u.sides[0])[0] in member_names]
        bodies.append(_body(members, joined, discretised))
    return bodies


def _body(members: list[SubstructureModel], bonds: list[InterfaceUnit], discretised: DiscretisedProblem) -> BondedBody:
    by_name = {m.name: m for m in members}
    if not bonds:
        only = members[0]
        return BondedBody(only.name, only, by_name, {only.name: slice(0, only.n_full)})
    try:
        # branches of unlike materials are taken member by member (``branches_of``)
        merged = merge([replace(m, branches=NO_BRANCHES) for m in members], bonds, discretised.info)
    except ValueError as error:
        where = ", ".join(f"interface.{unit.name}" for unit in bonds)
        problem = Problem(
            where,
            f"perfect connections that no reduced model holds: {error}",
            remedy="mesh the two faces alike, or solve the scene itself",
        )
        raise SceneError([problem], "the scene has no reduced model") from error
    return BondedBody("_".join(by_name), merged.model, by_name, merged.where)


def patches(points: Array, areas: Array, n: int) -> list[Index]:
    """Points of each patch: the largest patch is halved across its longest direction until there are n.

    points : (n_point, 3), m. areas : (n_point,), m2. n : wanted number, >= 1; no more than points.
    """
    parts = [np.arange(len(points))]
    while len(parts) < n:
        order = sorted(range(len(parts)), key=lambda i: (-areas[parts[i]].sum(), i))  # of equal ones the first
        largest = next((i for i in order if len(parts[i]) > 1), None)
        if largest is None:
            break
        parts[largest : largest + 1] = _halves(parts[largest], points, areas)
    return parts


def _halves(members: Index, points: Array, areas: Array) -> list[Index]:
    inside = points[members]
    extent = np.ptp(inside, axis=0)
    # the first axis among those that are equally long but for round-off
    axis = int(np.argmax(extent > (1.0 - _SAME) * extent.max()))
    # places of one row of a mesh become equal, so that the order of points decides and not their round-off
    along = np.round(inside[:, axis] / max(float(extent.max()), np.finfo(float).tiny) / _SAME) * _SAME
    order = np.argsort(along, kind="stable")
    reached = np.cumsum(areas[members[order]])
    # a point that reaches the half but for round-off closes the first part
    cut = int(np.searchsorted(reached, reached[-1] / 2 * (1.0 + _SAME)))
    cut = min(max(cut, 1), len(members) - 1)  # neither part is empty
    return [members[order[:cut]], members[order[cut:]]]


@dataclass(frozen=True)
class Cut:
    """An interface that may open, cut into patches. ``number`` counts the interfaces of the scene."""

    number: int
    unit: InterfaceUnit
    members: list[Index]

    @classmethod
    def of(cls, number: int, unit: InterfaceUnit, n_patch: int) -> Cut:
        """Cut an interface into patches."""
        return cls(number, unit, patches(unit.geometry.points, unit.geometry.areas, n_patch))

    @property
    def areas(self) -> Array:
        """Areas of the patches, (n_patch,), m2."""
        return np.array([self.unit.geometry.areas[m].sum() for m in self.members])

    def mean(self, values: Array) -> Array:
        """Means of values (n_point, ...) over the patches, weighted by area."""
        weights = self.unit.geometry.areas
        return np.stack([np.tensordot(weights[m] / weights[m].sum(), values[m], axes=1) for m in self.members])

    def trace(self, side: int) -> sp.csr_array | None:
        """(3 n_patch, n_full) mean motion of a side in local axes; None for the ground."""
        local = self.unit.geometry.local_trace(side, 3)
        if local is None:
            return None
        weights, n_point = self.unit.geometry.areas, self.unit.geometry.n_point
        rows = np.repeat(np.arange(len(self.members)), [len(m) for m in self.members])
        points = np.concatenate(self.members)
        share = weights[points] / self.areas[rows]
        mean = sp.csr_array((share, (rows, points)), shape=(len(self.members), n_point))
        # rows 3 patch + component
        return sp.csr_array(sp.kron(mean, sp.eye_array(3)) @ local)


def body_trace(body: BondedBody, cuts: Sequence[Cut]) -> tuple[sp.csr_array, Array]:
    """Mean motion of the patches of all interfaces on a body, E' counted positive and E negative.

    Returns
    -------
    (3 n_patch of all cuts, n_full), zero where the body has no part in it, and the areas (3 n_patch,) of its rows.
    """
    blocks, areas = [], []
    for cut in cuts:
        block = sp.csr_array((3 * len(cut.members), body.model.n_full))
        for side, face in enumerate(cut.unit.sides):
            trace = None
            if face != GROUND:
                trace = cut.trace(side)
            if trace is not None and (name := split_face(face)[0]) in body.where:
                if side:
                    sign = 1.0
                else:
                    sign = -1.0
                # both sides may lie on one body: their rows add up to the relative motion
                block = sp.csr_array(block + sign * placed(trace, body.where[name].start, body.model.n_full))
        blocks.append(block)
        areas.append(np.repeat(cut.areas, 3))
    if not blocks:
        return sp.csr_array((0, body.model.n_full)), np.zeros(0)
    return sp.csr_array(sp.vstack(blocks)), np.concatenate(areas)


def face_means(body: BondedBody, units: Sequence[InterfaceUnit]) -> Array:
    """(n_interface, 2, 3, n_full) mean motion of both sides of every interface in global axes, weighted by area."""
    means = np.zeros((len(units), 2, 3, body.model.n_full))
    for i, unit in enumerate(units):
        share = sp.csr_array(unit.geometry.areas[None, :] / unit.geometry.areas.sum())
        for side, face in enumerate(unit.sides):
            trace = unit.geometry.traces[side]
            if trace is not None and (name := split_face(face)[0]) in body.where:
                mean = sp.csr_array(sp.kron(share, sp.eye_array(3)) @ trace)
                means[i, side] = placed(mean, body.where[name].start, body.model.n_full).toarray()
    return means


Part = tuple[BondedBody, Array, sp.csr_array]
"""A body, its basis (n_full, size), its traces of patches (3 n_patch, n_full)."""


def bond_of(interface: int, unit: InterfaceUnit, parts: Sequence[Part], load_names: Sequence[str]) -> Bond:
    """Force through a perfect interface inside a body: equilibrium of side E under translations of its nodes.

    parts : all bodies, in the order of their coordinates.
    """
    name = split_face(unit.sides[0])[0]
    sizes = [basis.shape[1] for _, basis, _ in parts]
    number = next(i for i, (body, _, _) in enumerate(parts) if name in body.where)
    body, basis, trace = parts[number]
    model = body.members[name]
    # virtual work along these translations: what is missing to the equilibrium of side E goes through the bond
    test = _translations(unit, model.expansion)
    here = basis[body.where[name]]

    def rows(matrix: sp.csr_array | None) -> Array:
        wide = np.zeros((3, sum(sizes)))
        if matrix is not None:
            start = sum(sizes[:number])
            # three rows first: the matrix is never multiplied with the whole basis
            wide[:, start : start + sizes[number]] = (test @ matrix) @ here
        return wide

    loads = np.zeros((3, len(load_names)))
    for load in model.loads:
        loads[:, load_names.index(load.name)] += test @ load.pattern
    pushed = (trace[:, body.where[name]] @ test.T).reshape(-1, 3, 3)  # patch, component, direction
    normal = unit.geometry.areas @ unit.geometry.frames[:, 0]
    return Bond(  # those of one law add up
        interface=interface,
        inertia=rows(model.mass),
        damping=rows(model.damping),
        stiffness=rows(model.stiffness),
        loads=loads,
        pressure=pushed[:, 0].T,
        shear=pushed[:, 1:].transpose(1, 2, 0),
        normal=normal / np.linalg.norm(normal),
    )


def _translations(unit: InterfaceUnit, expansion: sp.csr_array) -> Array:
    """(3, n_full of side E): one along each axis at the nodes of the interface, 0 where a direction is held."""
    trace = unit.geometry.traces[0]
    test = np.zeros((3, trace.shape[1]))
    # (node, axis) number the full dofs: the columns of a trace are the nodes of the face
    test[trace.indices % 3, trace.indices] = 1.0
    free = np.diff(expansion.indptr) > 0  # a held dof has no row entries
    return test * free


@dataclass(frozen=True)
class ReducedBody:
    """A body in its Ritz coordinates.

    Attributes
    ----------
    trace : (3 n_patch of all interfaces, n_full) motion of the patches, E' positive, E negative. mass : kg.
    """

    body: BondedBody
    model: ReducedModel
    trace: sp.csr_array
    mass: float

    @classmethod
    def of(cls, body: BondedBody, cuts: Sequence[Cut], n_mode: int) -> ReducedBody:
        """Reduce a body to its Ritz coordinates."""
        trace, area = body_trace(body, cuts)
        # rows in which a body has no part are no channels of it
        needed = np.flatnonzero(_transmits(cuts) & (np.diff(trace.indptr) > 0))
        here = replace(body.model, trace=sp.csr_array(trace[needed]), channel_area=area[needed])
        reduced = reduce_model(here, n_mode, exciting=_uniform(cuts)[needed])
        # translations in three directions, each with the mass of the body
        return cls(body, reduced, trace, float(body.model.inertia.sum()) / 3.0)

    @property
    def size(self) -> int:
        """Number of Ritz coordinates."""
        return len(self.model.eigenvalues)

    @property
    def n_state(self) -> int:
        """States of its motion: coordinates, velocities, elongations of the branches of each of its materials."""
        branches = {m.branches for m in self.body.members.values()}
        return self.size * (2 + sum(map(len, branches)))

    @property
    def basis(self) -> Array:
        """Ritz vectors (n_full, size), scaled to the size of a displacement."""
        # unit modal mass -> modal mass that of the body, so that a rigid translation of 1 m is a coordinate of size 1
        scaled: Array = self.model.basis * np.sqrt(self.mass)
        return scaled

    def rows(self, place: SensorPlace) -> Array:
        """(3, size) displacement of a sensor from the coordinates, 0 where it is on another body."""
        if place.substructure not in self.body.where:
            return np.zeros((3, self.size))
        here = self.basis[self.body.where[place.substructure]]
        return np.asarray(place.rows @ here)


def _transmits(cuts: Sequence[Cut]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows of a trace of patches that carry traction: no tangential ones where there is no friction."""
    rows = [np.tile(np.arange(3) < c.unit.behaviour.n_component, len(c.members)) for c in cuts]
    return np.concatenate([np.zeros(0, dtype=bool), *rows])


def _uniform(cuts: Sequence[Cut]) -> Array:
    """Uniform tractions on every interface, one a column, (3 n_patch of all, 3 n_cut)."""
    blocks = [np.tile(np.eye(3), (len(c.members), 1)) for c in cuts]
    columns: Array = sp.block_diag([sp.coo_array(block) for block in (*blocks, np.zeros((0, 0)))]).toarray()
    return columns


def loads_of(bodies: Sequence[ReducedBody], root: Array) -> tuple[list[str], Array]:
    """Names of the load terms, each once, and their forces on the coordinates (n, n_load)."""
    names = list(dict.fromkeys(load.name for b in bodies for load in b.body.model.loads))
    table = np.zeros((len(root), len(names)))
    start = 0
    for b in bodies:
        for load, column in zip(b.body.model.loads, b.model.loads.T, strict=True):
            table[start : start + b.size, names.index(load.name)] += column
        start += b.size
    return names, table * root[:, None]


def damping_of(bodies: Sequence[ReducedBody]) -> Array | None:
    """(n, n) damping of all bodies, N s m-1; None where there is none."""
    if all(b.model.damping is None for b in bodies):
        return None
    # coordinates are q / sqrt(m): modal matrices are multiplied by m
    parts = [np.zeros((b.size, b.size)) if b.model.damping is None else b.mass * b.model.damping for b in bodies]
    blocks: Array = sp.block_diag([sp.coo_array(part) for part in parts]).toarray()
    return blocks


def branches_of(bodies: Sequence[ReducedBody], units: Sequence[InterfaceUnit]) -> list[Branch]:
    """Maxwell branches of all bodies, those of one material together."""
    sizes = np.cumsum([0, *(b.size for b in bodies)])
    sides = [split_face(unit.sides[0])[0] for unit in units if is_bond(unit)]
    bonds = [unit for unit in units if is_bond(unit)]
    result = []
    for branches in dict.fromkeys(m.branches for b in bodies for m in b.body.members.values() if len(m.branches)):
        places = []
        blocks = []
        rows = []
        for i, b in enumerate(bodies):
            members = {name: m for name, m in b.body.members.items() if m.branches == branches}
            if not members:
                continue
            places.append(np.arange(sizes[i], sizes[i + 1]))
            parts = {name: b.basis[b.body.where[name]] for name in members}
            blocks.append(sum(parts[name].T @ (m.stiffness @ parts[name]) for name, m in members.items()))
            row = np.zeros((len(bonds), 3, b.size))
            for k, (unit, side) in enumerate(zip(bonds, sides, strict=True)):
                if side in members:
                    row[k] = _translations(unit, members[side].expansion) @ (members[side].stiffness @ parts[side])
            rows.append(row)
        for strength, time in zip(branches.strengths, branches.times, strict=True):
            stiffness: Array = sp.block_diag([sp.coo_array(block) for block in blocks]).toarray()
            forces = np.concatenate(rows, axis=-1)
            result.append(Branch(time, np.concatenate(places).astype(float), strength * stiffness, strength * forces))
    return result


MAX_STATES = 600  # an integrator fills a Jacobian of this size squared by differences
MAX_PATCHES = 64  # of an interface
COARSEST = 0.1  # difference of deflections beyond which patches are too coarse
_HEADING = "the scene has no reduced model"


def reduced_system(scene: Scene, n_mode: int = 12, n_patch: int = 4) -> ReducedSystem:
    """Reduce a scene to a few coordinates per body.

    Parameters
    ----------
    n_mode : elastic modes per body. n_patch : patches per interface that may open.

    Raises
    ------
    SceneError : the scene cannot be built, has features without a reduced form, or gives too many states.
    """
    scene = completed(scene)
    problems = list(_unknown(scene, n_mode, n_patch))
    if problems:
        raise SceneError(problems, _HEADING)
    # without a time scheme of its own, contact nodes keep their mass
    discretised = discretise(scene.model_copy(update={"time": scene.time.model_copy(update={"scheme": HHTTable()})}))
    cuts = [Cut.of(i, u, n_patch) for i, u in enumerate(discretised.units) if not is_bond(u)]
    whole = bonded_bodies(discretised)
    problems = [
        Problem(
            f"substructure.{next(iter(body.members))}",
            "no node is free to move",
            remedy="omit it and put the others in contact with the ground",
        )
        for body in whole
        if not body.model.expansion.shape[1]
    ]
    if problems:
        raise SceneError(problems, _HEADING)
    bodies = [ReducedBody.of(body, cuts, n_mode) for body in whole]
    # displacements and velocities of all shapes, and the impulse of each interface
    n_state = sum(b.n_state for b in bodies) + 3 * len(discretised.units)
    if n_state > MAX_STATES:
        problem = Problem(
            "modes, patches",
            f"give {n_state} states",
            f"{n_mode}, {n_patch}",
            f"at most {MAX_STATES} states",
            "take fewer modes, or fewer patches",
        )
        raise SceneError([problem], _HEADING)
    system = _assembled(discretised, cuts, bodies)
    soft = {n: r for n, r in deflections(system, whole, cuts).items() if abs(r - 1.0) > COARSEST}
    if soft:
        raise SceneError([_too_coarse(name, ratio, n_patch) for name, ratio in soft.items()], _HEADING)
    return system


def _too_coarse(load: str, ratio: float, n_patch: int) -> Problem:
    return Problem(
        f"load.{load}",
        "with contacts closed, the reduced model does not deflect like the mesh",
        f"{ratio:.2f} times, {n_patch} patches",
        f"within {100 * COARSEST:.0f} %",
        "take more patches (a patch does not resist bending inside it), or solve the scene itself",
    )


def _hot_at_start(scene: Scene) -> Iterator[Problem]:
    """Temperatures that strain a body at t = 0, where a reduced model has no stress."""
    for load in scene.body_loads:
        strains = load.kind.strains and any(load.acts_on(*body) for body in scene.substructure.items())
        if strains and load.law.sample(np.zeros(1))[0] != 0.0:
            yield Problem(
                load.kind.place(load.of),
                "a reduced model starts without stress: a temperature that is not 0 then is a thermal shock",
                None,
                "laws that begin with 0",
                "let it rise, or make an FMU for co-simulation (without --model-exchange)",
            )


def _otherwise_started(scene: Scene) -> Iterator[Problem]:
    """Starts, and motions, that a reduced model does not have."""
    if scene.time.quasi_static:
        yield Problem("time.quasi_static", "a reduced model moves", "true", "false", "omit it")
    for name in scene.bolt:
        remedy = "remove the bolt, or make an FMU for co-simulation (without --model-exchange)"
        yield Problem(f"bolt.{name}", "a reduced model has no bolts", None, None, remedy)
    # a bolt is refused above: its static start is not named as well
    if scene.time.start.type == "static" and not scene.bolt:
        yield Problem(
            "time.start", "a reduced model starts from the values given", "static", "given", 'set time.start = "given"'
        )
    if scene.effects.prestress == "on":
        yield Problem(
            "effects.prestress",
            "a reduced model does not have the stiffness of the stress at t = 0",
            "on",
            "automatic, off",
            "omit it, or make an FMU for co-simulation (without --model-exchange)",
        )


def _unknown(scene: Scene, n_mode: int, n_patch: int) -> Iterator[Problem]:
    for what, value, least, most in (("modes", n_mode, 0, MAX_STATES // 2), ("patches", n_patch, 1, MAX_PATCHES)):
        if not least <= value <= most:
            yield Problem(what, "not a possible number", str(value), f"{least} to {most}")
    yield from _otherwise_started(scene)
    yield from _hot_at_start(scene)
    for name, interface in scene.interface.items():
        if interface.behaviour not in ("contact", "perfect"):
            yield Problem(
                f"interface.{name}.behaviour", "has no regularised law", interface.behaviour, "contact, perfect"
            )
        elif interface.behaviour == "perfect" and GROUND in interface.sides:
            yield Problem(
                f"interface.{name}.sides",
                "a bond with the ground",
                ", ".join(interface.sides),
                remedy='hold the face by a boundary of type "fixed"',
            )
    for key in ("spring", "coupling"):
        for name in getattr(scene, key):
            yield Problem(f"{key}.{name}", f"a reduced model has no {key}s", remedy="use the FMU for co-simulation")
    for name in scene.port:
        yield Problem(f"port.{name}", "a reduced model has no ports", remedy="use the FMU for co-simulation")
    for name, body in scene.substructure.items():
        if body.rigid:
            yield Problem(f"substructure.{name}.rigid", "a rigid body has no modes", remedy="make it elastic")
    for name, boundary in scene.boundary.items():
        if getattr(boundary, "axes", None) is not None:
            what, remedy = "a reduced model holds faces along the global axes", "use the FMU for co-simulation"
            yield Problem(f"boundary.{name}.axes", what, remedy=remedy)
        if isinstance(boundary, Driven):
            yield Problem(
                f"boundary.{name}.type",
                "motions are not prescribed to a reduced model",
                boundary.type,
                remedy="move the ground of a contact, or use a load",
            )
    for name, interface in scene.interface.items():
        if interface.ground_velocity is not None and isinstance(interface.ground_velocity.law, InputLaw):
            yield Problem(
                f"interface.{name}.ground_velocity.law",
                "the ground of a reduced model is not driven from outside",
                "input",
                "another law",
                "use the FMU for co-simulation",
            )


def _assembled(discretised: DiscretisedProblem, cuts: Sequence[Cut], bodies: Sequence[ReducedBody]) -> ReducedSystem:
    scene, units = discretised.scene, discretised.units
    m = np.concatenate([np.full(b.size, b.mass) for b in bodies])
    root = np.sqrt(m)
    stiffness = m * np.concatenate([b.model.eigenvalues for b in bodies])  # 0 for rigid motions
    motion = np.hstack([b.trace @ b.basis for b in bodies]).reshape(-1, 3, len(m))
    names, loads = loads_of(bodies, root)
    laws: Mapping[str, Any] = scene.force_laws
    traction = characteristic_traction(scene, discretised.bodies, discretised.time) or 1.0
    impedance = side_impedance(discretised.bodies, units, discretised.layout)
    # v = p / z
    if (impedance > 0.0).any():
        speed = traction * float(np.mean(1.0 / impedance[impedance > 0.0]))
    else:
        speed = 1.0
    places, sensors = _sensors(discretised, bodies)
    return ReducedSystem(
        bodies=[b.body.name for b in bodies],
        sizes=[b.size for b in bodies],
        interfaces=[u.name for u in units],
        inertia=m,
        stiffness=stiffness,
        damping=damping_of(bodies),
        branches=branches_of(bodies, units),
        loads=loads,
        load_names=names,
        laws={n: laws[n].model_dump() for n in dict.fromkeys(names) if n},
        displacement=np.concatenate([b.model.displacement for b in bodies]) / root,  # q / sqrt(m)
        velocity=np.concatenate([b.model.velocity for b in bodies]) / root,
        contacts=_contacts(cuts, motion, stiffness),
        bonds=[
            bond_of(i, u, [(b.body, b.basis, b.trace) for b in bodies], names)
            for i, u in enumerate(units)
            if is_bond(u)
        ],
        sides=np.concatenate([face_means(b.body, units) @ b.basis for b in bodies], axis=-1),
        ground=_ground(scene, units),
        sensors=sensors,
        places=places,
        traction=traction,
        speed=speed,
        end=scene.time.end,
    )


def _contacts(cuts: Sequence[Cut], motion: Array, stiffness: Array) -> Contacts:
    """``motion`` : (n_patch, 3, n) of E' relative to E."""
    owner, softness = [], []
    elastic = stiffness > 0.0  # a rigid motion gives no static shortening
    at = 0
    for cut in cuts:
        rows = motion[at : at + len(cut.members), 0]
        push = cut.areas @ rows
        # mean opening under a unit pressure on both sides, without the rigid motions, m Pa-1
        compliance = float(np.sum(push[elastic] ** 2 / stiffness[elastic]) / cut.areas.sum())
        if compliance <= 0.0:
            problem = Problem(f"interface.{cut.unit.name}", "neither side can move along the normal")
            raise SceneError([problem], _HEADING)
        owner += [cut.number] * len(rows)
        softness += [compliance] * len(rows)
        at += len(rows)
    friction = [coulomb_coefficient(c.unit.behaviour) or 0.0 for c in cuts for _ in c.members]
    # no friction, no sliding: patches neither creep nor enter the friction of others
    sliding = motion[:, 1:].transpose(1, 0, 2) * (np.array(friction).reshape(-1) > 0.0)[None, :, None]
    return Contacts(
        owner=np.array(owner, dtype=float),
        area=np.concatenate([np.zeros(0), *(c.areas for c in cuts)]),
        opening=motion[:, 0],
        sliding=sliding,
        frames=np.concatenate([np.zeros((0, 3, 3)), *(c.mean(c.unit.geometry.frames) for c in cuts)]),
        gap=np.concatenate([np.zeros(0), *(c.mean(c.unit.geometry.gap) for c in cuts)]),
        preload=np.array([c.unit.preload for c in cuts for _ in c.members]),
        friction=np.array(friction),
        stiffness=1.0 / np.array(softness),
    )


def _ground(scene: Scene, units: Sequence[InterfaceUnit]) -> list[tuple[int, Array, dict[str, object]]]:
    moving = [(i, scene.interface[u.name].ground_velocity) for i, u in enumerate(units)]
    return [(i, np.array(g.vector), g.law.model_dump()) for i, g in moving if g is not None]


def _sensors(discretised: DiscretisedProblem, bodies: Sequence[ReducedBody]) -> tuple[Array, list[str]]:
    """(n_sensor, 3, n) displacement of the sensors from the coordinates, and their names."""
    blocks = [np.zeros((0, 3, sum(b.size for b in bodies)))]
    for place in discretised.sensors.values():
        row = [b.rows(place) for b in bodies]
        blocks.append(np.hstack(row)[None])
    return np.concatenate(blocks), list(discretised.sensors)


_CLOSED = 1e4  # stiffness of a closed contact over the static stiffness of its bodies, in both models
_INERTIA = 6.0  # inertia like that of a motion exp(6 t / end): it holds what nothing else holds


def deflections(system: ReducedSystem, bodies: Sequence[BondedBody], cuts: Sequence[Cut]) -> dict[str, float]:
    """Deflection b . A^-1 b under every load b on a face: that of the reduced model over that of the mesh.

    A = K + (6 / end)^2 M + springs that close the contacts. Loads that move nothing are left out.
    """
    growth = (_INERTIA / system.end) ** 2
    # loads on faces only: body_force.SUBSTRUCTURE and gravity.acceleration have a dot
    names = [name for name in system.load_names if name and "." not in name]
    if not names:
        return {}
    full = _mesh(system, bodies, cuts, names, growth)
    c = system.contacts
    springs = _CLOSED * c.stiffness * c.area
    matrix = np.diag(system.stiffness + growth * system.inertia) + (c.opening.T * springs) @ c.opening
    for rows in c.sliding:
        matrix += (rows.T * springs) @ rows
    loads = system.loads[:, [system.load_names.index(name) for name in names]]
    reduced = np.einsum("ij,ij->j", loads, la.solve(matrix, loads, assume_a="pos"))
    return {n: float(r / f) for n, r, f in zip(names, reduced, full, strict=True) if f > 0.0}


def _mesh(
    system: ReducedSystem, bodies: Sequence[BondedBody], cuts: Sequence[Cut], names: Sequence[str], growth: float
) -> Array:
    """Deflections (n_load,) of the mesh."""
    models = [body.model for body in bodies]
    expansion = sp.csr_array(sp.block_diag([m.expansion for m in models]))
    matrix = sp.csr_array(sp.block_diag([m.stiffness + growth * m.inertia for m in models]))
    sizes = [m.n_full for m in models]
    starts = [sum(sizes[:i]) for i in range(len(sizes))]
    where = {
        name: slice(start + part.start, start + part.stop)
        for body, start in zip(bodies, starts, strict=True)
        for name, part in body.where.items()
    }
    for cut in cuts:
        traces = [cut.unit.geometry.local_trace(side, cut.unit.behaviour.n_component) for side in (0, 1)]
        rows = jump(cut.unit, traces, where, sum(sizes))
        # equal for all patches of an interface
        stiffness = system.contacts.stiffness[system.contacts.owner == cut.number][0]
        area = np.repeat(cut.unit.geometry.areas, cut.unit.behaviour.n_component)
        matrix = matrix + rows.T @ (sp.diags_array(_CLOSED * stiffness * area) @ rows)
    loads = np.zeros((sum(sizes), len(names)))
    for model, start in zip(models, starts, strict=True):
        for load in model.loads:
            if load.name in names:
                loads[start : start + model.n_full, names.index(load.name)] += load.pattern
    # dofs that are held drop out
    loads = expansion.T @ loads
    factor = CholeskyFactor(sp.csr_array(expansion.T @ matrix @ expansion), np.zeros(0, dtype=np.int64), _rank(bodies))
    deflection: Array = np.einsum("ij,ij->j", loads, factor.solve(loads))
    return deflection


def _rank(bodies: Sequence[BondedBody]) -> Array | None:
    """Elimination order: body after body, each in its own order; None where one has none."""
    ranks, start = [], 0.0
    for body in bodies:
        if body.model.ordering is None:
            return None
        rank = reduced_rank(body.model.expansion, body.model.ordering) + start
        start = float(rank.max(initial=start)) + 1.0  # bodies are not coupled but by springs: one after the other
        ranks.append(rank)
    return np.concatenate(ranks)


def names_of(scene: Scene, system: ReducedSystem, starts: Sequence[float], nominals: Sequence[float]) -> Names:
    """Variables of the reduced model of a scene.

    starts, nominals : of all states, in their order.
    """
    table = tuple(_table(scene, Regularisation.of(system)))
    place = {v.name: i for i, v in enumerate(table)}
    read = [f"interface.{name}.impulse[{axis}]" for name in system.interfaces for axis in (1, 2, 3)]
    if scene.output.energy:
        read += [f"energy.{name}" for name in WORKS]
    rows = list(_coordinates(system, starts, nominals))
    # value references in the order of y: coordinates and velocities, impulses, works
    states = [*range(len(table), len(table) + len(rows)), *(place[name] for name in read)]
    named = [*((v.name, v.unit) for v in rows), *((name, table[place[name]].unit or "1") for name in read)]
    first = len(table) + len(rows)
    for reference, (name, unit) in zip(states, named, strict=True):
        rate = {"m": "m s-1", "m s-1": "m s-2", "N s": "N", "J": "W"}[unit]
        # from the unit of the state
        rows.append(Local(f"der({name})", rate, f"time derivative of {name}", derivative_of=reference))
    second = len(table) + len(rows)
    rows += _indicators(system)
    return Names(table, tuple(rows), tuple(states), first, second)


def _table(scene: Scene, default: Regularisation) -> Iterator[Variable]:
    rows = scalar_table(scene)
    stiffness = (
        "stiffness of the contact over the static stiffness of the two bodies under uniform pressure: they penetrate "
        "by 1 / this of their static shortening"
    )
    damping = (
        "damping of the contact: part of the pressure taken off where the bodies leave each other at their "
        "characteristic velocity"
    )
    sliding = "sliding velocity below which a patch sticks: it creeps instead of resting"
    yield rows[0]
    yield parameter(STIFFNESS, "real", default.stiffness, stiffness, unit="1", minimum=0.0)
    yield parameter(DAMPING, "real", default.damping, damping, unit="1", minimum=0.0)
    yield parameter(SLIDING, "real", default.sliding, sliding, unit="m s-1", minimum=0.0)
    yield from (row for row in rows if row.causality == "input")
    for row in rows:
        family, _, name = row.name.partition(".")
        if row.causality == "output" and name.rpartition(".")[2].partition("[")[0] in OUTPUTS.get(family, ()):
            share = row.name.endswith((".closed", ".sticking", ".slipping"))
            yield replace(row, variability="discrete" if share else row.variability, initial_dependencies=())
    if scene.output.energy:
        yield from (output(f"energy.{name}", "J", text) for name, text in _energies().items())
    yield replace(output(EVENTS, "1", "changes of contact states since the start", minimum=0.0), variability="discrete")


def _energies() -> dict[str, str]:
    texts = {
        **{row.name: row.meaning for row in ENERGY.rows},
        "contact": "energy stored in the springs of the contacts",
        "contact_dissipation": "energy dissipated by the damping of the contacts since the start",
    }
    return {name: texts[name] for name in ENERGY_NAMES}


def _coordinates(system: ReducedSystem, starts: Sequence[float], nominals: Sequence[float]) -> Iterator[Local]:
    number = 0
    for kind, unit in (("displacement", "m"), ("velocity", "m s-1")):
        for body, size in zip(system.bodies, system.sizes, strict=True):
            for i in range(1, size + 1):
                text = f"{kind} of Ritz vector {i} of {body}, scaled by the root of its mass"
                yield Local(f"modes.{body}.{kind}[{i}]", unit, text, float(starts[number]), float(nominals[number]))
                number += 1
    for k, branch in enumerate(system.branches, start=1):
        for i in branch.places.astype(int) + 1:
            text = f"elongation of Maxwell branch {k} in coordinate {i}"
            yield Local(f"modes.elongation{k}[{i}]", "m", text, float(starts[number]), float(nominals[number]))
            number += 1


def _indicators(system: ReducedSystem) -> Iterator[Local]:
    owners = [system.interfaces[int(i)] for i in system.contacts.owner]
    numbers = [owners[: i + 1].count(o) for i, o in enumerate(owners)]
    for key, text in (
        ("gapIndicator", "distance of patch {} of {} from opening or closing, in penetrations under the load"),
        ("slidingIndicator", "distance of patch {} of {} from stick or slip, in slidingVelocity"),
    ):
        for owner, number in zip(owners, numbers, strict=True):
            yield Local(f"interface.{owner}.{key}[{number}]", "1", text.format(number, owner))
