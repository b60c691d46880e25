"""Ports on the meshes: where their motion is measured, their dashpots, the rigid motion and the reaction of a moved
face, and their outputs.

A component has one row t of the least-squares fit T, R of the motion of its face (``fem.location.MeanMotion``): the
force through the port acts by the pattern t^T, and the dashpot of a wave port, force -Z v on the mean velocity
v = t . u', is the damping matrix Z t^T t. Central differences have a diagonal matrix instead: the nodes have shares of
Z by area, so that the resultant is the same.

A moved face has u = U + Theta x r, r from the centre. What it exerts on what moves it has the resultant and the moment
of minus the reactions of its nodes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp

from ..errors import Problems
from ..fem.location import cross_matrix
from ..fem.mesh import Array, Index
from ..latin.assembly import Assembly
from ..latin.probes import SensorPlace, Support
from ..latin.recorder import Recorder
from ..propagator import SubstructureModel
from ..propagator.model import diagonal_matrix
from ..scene.ports import COMPONENTS, TRANSLATIONS, Port
from ..scene.schema import Scene
from .body import Body
from .places import mean_over, place_on_face
from .supports import Motion

_MOST = 3000  # nodes of a face whose dashpot couples all of them: nine million entries
_MOVES = 1e-9  # of the size of a face: a node displaced less by a rotation does not move


def port_key(name: str, turned: bool = False) -> str:
    """Name of the measured motion, or reaction, of a port: its translation (force), or its rotation (moment)."""
    return f"port.{name}.rotation" if turned else f"port.{name}"


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
        place, material = place_on_face(bodies[port.body], port.face), bodies[port.body].shape.material
        area, at = place.area, place.point
        bar = area * float(np.sqrt(material.young_modulus * material.density))
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
            shares[face.nodes, COMPONENTS.index(component)] = impedance * face.areas / face.areas.sum()
            continue
        rows = motion.translation if component in TRANSLATIONS else motion.rotation
        assert rows is not None
        row = sp.csr_array(rows[[COMPONENTS.index(component) % 3]])
        full = sp.csr_array(full + impedance * (row.T @ row))
    return diagonal_matrix(shares.ravel()) if diagonal else full


# -- moved faces ------------------------------------------------------------------------------------------------------
def port_shapes(body: Body, name: str, port: Port, problems: Problems) -> tuple[Index, Array]:
    """Dofs (n,) that a moved face drives, and their displacements (n, n_component) for unit motions of the components;
    a rotation that would move nodes along an axis that is not driven is added to ``problems``."""
    place = place_on_face(body, port.face)
    arms = place.arms
    shapes = np.zeros((len(arms), 3, len(port.components)))
    for j, component in enumerate(port.components):
        axis = np.eye(3)[COMPONENTS.index(component) % 3]
        shapes[:, :, j] = axis if component in TRANSLATIONS else np.cross(axis, arms)
    driven = [component in port.components for component in TRANSLATIONS]
    for j, component in enumerate(port.components):
        stray = np.abs(shapes[:, :, j]).max(axis=0) > _MOVES * np.abs(arms).max()
        if missing := [axis for axis, moves, own in zip(TRANSLATIONS, stray, driven, strict=True) if moves and not own]:
            problems.add(
                f"port.{name}.components",
                f"the rotation {component} moves nodes of the face along {', '.join(missing)}",
                ", ".join(port.components),
                "translations along every axis that a rotation moves nodes along",
                f"add {', '.join(missing)} to the components, or leave {component} out",
            )
    dofs = (3 * place.face.nodes[:, None] + np.flatnonzero(driven)).ravel()
    return dofs, shapes[:, driven].reshape(len(dofs), -1)


def port_motions(body: Body, name: str, port: Port) -> list[Motion]:
    """Motions of the components of a moved face, in their order."""
    arms = {c: 1.0 if c in TRANSLATIONS else body.mesh.size for c in port.components}
    return [Motion(port.law(c), 1.0, "velocity", n, arms[c]) for n, c in port.inputs(name).items()]


def port_supports(
    scene: Scene, bodies: Mapping[str, Body], models: Mapping[str, SubstructureModel]
) -> dict[str, Support]:
    """Supports whose reactions are the force and the moment of moved faces, by ``port_key``."""
    made = {}
    for name, port in scene.port.items():
        if port.causality != "motion_in":
            continue
        place = place_on_face(bodies[port.body], port.face)
        nodes, arms = place.face.nodes, place.arms
        driven = np.array([component in port.components for component in TRANSLATIONS], dtype=float)
        dofs = (3 * nodes[:, None] + np.flatnonzero(driven)).ravel()
        for turned, blocks in ((False, np.tile(np.eye(3), (len(arms), 1, 1))), (True, cross_matrix(arms))):
            if turned and not port.rotates:
                continue
            columns = np.broadcast_to(3 * nodes[:, None, None] + np.arange(3), blocks.shape)
            rows = np.broadcast_to(np.arange(3)[:, None], blocks.shape)
            entries = ((blocks * driven).ravel(), (rows.ravel(), columns.ravel()))
            parts = sp.csr_array(sp.coo_array(entries, shape=(3, place.body.full_size())))
            parts.eliminate_zeros()
            made[port_key(name, turned)] = Support(port.body, port.face, dofs, models[port.body], parts)
    return made


# -- outputs ----------------------------------------------------------------------------------------------------------
def moved_face_forces(scene: Scene, assembly: Assembly, recorder: Recorder) -> Array:
    """Forces and moments that bodies exert through the faces that ports move, over the kept instants, (n, k): those of
    one port after the other, in the order of its components."""
    reactions, columns = recorder.reactions(assembly, ports=True), [np.zeros((recorder.n_kept, 0))]
    for name, port in scene.port.items():
        keys = [key for key in (port_key(name), port_key(name, True)) if key in reactions]
        if keys:
            both = np.concatenate([reactions[key].force for key in keys], axis=1)
            columns.append(-both[:, [COMPONENTS.index(component) for component in port.components]])
    return np.concatenate(columns, axis=1)
