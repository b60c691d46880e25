"""Couplings: mean motions of faces joined exactly, rigid faces, forces and moments that arrive whole."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError
from latin_fmu.fem.location import MeanMotion
from latin_fmu.stability.scenes import Box, Material, placed

E, RHO, EDGE = 210e9, 7800.0, 0.1
STEEL = Material(E, RHO, 0.3, "steel")
STATIC = {"end": 1.0, "instants": 2, "quasi_static": True}


def cubes(coupling: dict[str, Any], far: float = 2.0, rigid: tuple[bool, ...] = (False, False), **tables: Any) -> Any:
    """Two cubes along x, `far` edges apart from centre to centre; the first stands on a wall."""
    cube = {undeformable: Box(STEEL, (EDGE,) * 3, (2, 3, 2), keys={"rigid": undeformable}) for undeformable in rigid}
    data = placed(
        {f"b{i}": (cube[undeformable], (far * EDGE * i, 0.0, 0.0)) for i, undeformable in enumerate(rigid)},
        STATIC,
        boundary={"wall": {"type": "fixed", "face": "b0.xmin"}},
        coupling={"c": coupling},
        solver={"tolerance": 1e-9},
        output={"fields": True},
    )
    return latin_fmu.scene_from_dict(data | tables)


def mean_of(scene: Any, body: str, face: str) -> MeanMotion:
    """Mean motion of a face of the scene."""
    whole = discretise(scene).bodies[body]
    return MeanMotion.of_face(whole.mesh.nodes, whole.face(face))


@pytest.mark.parametrize("file_face", ["xmax", "zmin"])
def test_mean_motion_of_a_linear_field(file_face: str) -> None:
    """Exact: translation of the centre, and the rotation of the skew part along with shear in the plane only."""
    scene = cubes({"ends": ["b0.xmax", "b1.xmin"]})
    nodes = discretise(scene).bodies["b0"].mesh.nodes
    motion = mean_of(scene, "b0", file_face)
    theta, shift, at = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -1.0]), np.array([0.3, -0.2, 0.5])
    field = (shift + np.cross(theta, nodes)).ravel()
    assert motion.rotation is not None
    np.testing.assert_allclose(motion.rotation @ field, theta, rtol=1e-12)
    np.testing.assert_allclose(motion.at(at) @ field, shift + np.cross(theta, at), rtol=1e-12)
    gradient = np.arange(9.0).reshape(3, 3)
    stretched = (nodes @ gradient.T).ravel()
    np.testing.assert_allclose(motion.translation @ stretched, gradient @ motion.centre, rtol=1e-12)


FORCE, MOMENT, AT = [1e3, 2e3, -3e3], [50.0, -20.0, 30.0], [0.35, 0.02, 0.08]


@pytest.mark.parametrize("rigid", [False, True], ids=["distributing", "rigid"])
def test_force_and_moment_arrive_whole(rigid: bool) -> None:
    """A force and a moment at a point off the far cube: resultant and moment in the coupling and at the wall."""
    load = {"push": {"face": "b1.xmax", "force": FORCE, "moment": MOMENT, "point": AT}}
    scene = cubes({"ends": ["b0.xmax", "b1.xmin"], "rigid": rigid}, load=load)
    outcome = latin_fmu.solve(scene)
    assert outcome.converged, outcome.status
    history = outcome.interfaces["c"]
    forces = history.areas[:, None] * history.traction[-1]  # on the first cube, at the ends of the rods
    np.testing.assert_allclose(forces.sum(axis=0), FORCE, rtol=1e-6)
    moment = np.cross(history.points - AT, forces).sum(axis=0)
    np.testing.assert_allclose(moment, MOMENT, rtol=1e-5)
    u = {n: f.displacement[-1].ravel() for n, f in outcome.substructures.items()}
    first, second = (mean_of(scene, *side) for side in (("b0", "xmax"), ("b1", "xmin")))
    assert first.rotation is not None
    assert second.rotation is not None
    size = np.abs(u["b1"]).max()
    np.testing.assert_allclose(first.at(np.array(AT)) @ u["b0"], second.at(np.array(AT)) @ u["b1"], atol=1e-6 * size)
    turn = first.rotation @ u["b0"]
    np.testing.assert_allclose(turn, second.rotation @ u["b1"], atol=1e-6 * np.abs(turn).max())


def test_a_long_cantilever_of_two_cubes() -> None:
    """Rigid cubes on a rigid coupling turn as one body: about a spring, against the closed form."""
    spring = {"s": {"ends": ["b0.xmin", "ground"], "direction": [0.0, 0.0, 1.0], "stiffness": 1e6}}
    pin = {"p": {"ends": [{"face": "b0.xmin", "point": [-0.05, 0.05, 0.05]}, "ground"], "rotations": False}}
    scene = cubes(
        {"ends": ["b0.xmax", "b1.xmin"]},
        rigid=(True, True),
        boundary={},
        spring={"s": spring["s"] | {"ends": ["b1.xmax", "ground"]}},
        time={"end": 1e-3, "instants": 10},
    )
    whole = latin_fmu.scene_from_dict(scene.tables() | {"coupling": {**scene.tables()["coupling"], **pin}})
    modes = latin_fmu.vibration_modes(whole, count=2)
    m = RHO * EDGE**3
    inertia = sum(m * EDGE**2 / 6 + m * (x + 0.05) ** 2 for x in (0.05, 0.25))
    assert modes.frequency[-1] == pytest.approx(np.sqrt(1e6 * 0.35**2 / inertia) / (2 * np.pi), rel=1e-9)


def plane_error(outcome: Any, body: str, face: str, scene: Any) -> float:
    """Largest distance of the displacements of a face from a rigid motion, over the largest displacement."""
    whole = discretise(scene).bodies[body]
    nodes = whole.facets(face).nodes
    u = outcome.substructures[body].displacement[-1]
    places = whole.mesh.nodes[nodes] - whole.mesh.nodes[nodes].mean(axis=0)
    modes = np.concatenate([np.tile(np.eye(3), (len(nodes), 1, 1)), -np.cross(np.eye(3), places[:, None])], axis=1)
    modes = modes.transpose(0, 2, 1).reshape(-1, 6)
    rest = u[nodes].ravel() - modes @ np.linalg.lstsq(modes, u[nodes].ravel(), rcond=None)[0]
    return float(np.abs(rest).max() / np.abs(u).max())


@pytest.mark.parametrize("time", [STATIC, {"end": 5e-5, "instants": 50}], ids=["static", "dynamic"])
@pytest.mark.parametrize("propagator", ["direct", {"type": "reduced", "modes": 20}], ids=["direct", "reduced"])
def test_a_rigid_face_stays_plane(time: dict[str, Any], propagator: Any) -> None:
    if time is STATIC and propagator != "direct":
        return
    load = {"push": {"face": "b0.zmax", "traction": [1e6, 0.0, -3e6]}}
    tables = {"load": load, "time": time, "solver": {"propagator": propagator}}
    free = cubes({"ends": ["b0.xmax", "b1.xmin"]}, **tables)
    assert plane_error(latin_fmu.solve(free), "b0", "xmax", free) > 1e-2
    scene = cubes({"ends": ["b0.xmax", "b1.xmin"], "rigid": True}, **tables)
    assert plane_error(latin_fmu.solve(scene), "b0", "xmax", scene) < 1e-9


@pytest.mark.parametrize("propagator", ["direct", {"type": "reduced", "modes": 20}], ids=["direct", "reduced"])
def test_a_rigid_face_alone_keeps_momentum_and_spin(propagator: Any) -> None:
    """A free body that spins, one face rigid: it starts from its own motion and goes on turning."""
    tables = {"boundary": {}, "time": {"end": 2e-5, "instants": 40}, "solver": {"propagator": propagator}}
    scene = cubes({"ends": ["b0.xmax"], "rigid": True}, rigid=(False,), **tables)
    data = scene.tables()
    data["substructure"]["b0"] |= {"initial_spin": [0.0, 0.0, 20.0], "initial_velocity": [1.0, 2.0, 3.0]}
    fields = latin_fmu.solve(latin_fmu.scene_from_dict(data)).substructures["b0"]
    np.testing.assert_allclose(fields.velocity[-1], fields.velocity[0], atol=1e-9)
    assert np.ptp(fields.velocity[0][:, 1]) == pytest.approx(20.0 * EDGE, rel=1e-12)


def test_a_rigid_edge_on_a_symmetry_plane_keeps_what_the_plane_leaves() -> None:
    """Two translations and two rotations: the face may turn about its edge in the plane, too."""
    boundary = {"half": {"type": "symmetry", "face": "b0.ymin"}}
    scene = cubes(
        {"ends": ["b0.xmax"], "rigid": True}, rigid=(False,), boundary=boundary, time={"end": 1.0, "instants": 1}
    )
    (model,) = (m for c in discretise(scene).classes for m in c.members)
    body = discretise(scene).bodies["b0"]
    nodes = body.facets("xmax").nodes
    held = int((body.mesh.nodes[:, 1] < 1e-12).sum())
    assert model.expansion.shape[1] == 3 * body.mesh.n_node - held - (3 * len(nodes) - 3) + 4


@pytest.mark.parametrize(
    ("components", "load", "alike"),
    [
        # a weight off the centre bends a face that may stay plane, and not one whose nodes move alike
        (["x"], {"force": [1e4, 0.0, 0.0], "point": [0.1, 0.08, 0.05]}, ["x"]),
        (["x", "rz"], {"force": [1e4, 0.0, 0.0], "point": [0.1, 0.08, 0.05]}, []),
        (["y", "z"], {"force": [0.0, 3e4, -2e4]}, ["y", "z"]),
    ],
)
def test_nodes_that_move_as_one_along_some_axes(components: list[str], load: dict[str, Any], alike: list[str]) -> None:
    """The force passes through, the face is even along the axes of the components and strained along the others."""
    scene = cubes(
        {"ends": ["b0.xmax"], "rigid": True, "components": components},
        rigid=(False,),
        load={"pull": {"face": "b0.xmax", **load}},
    )
    outcome = latin_fmu.solve(scene)
    body = discretise(scene).bodies["b0"]
    nodes = body.facets("xmax").nodes
    moved = outcome.substructures["b0"].displacement[-1]
    size = np.abs(moved).max()
    for i, axis in enumerate("xyz"):
        even = np.ptp(moved[nodes, i]) < 1e-9 * size
        assert even == (axis in alike), axis
    if "rz" in components:
        lever = np.stack([np.ones(len(nodes)), body.mesh.nodes[nodes, 1]], axis=1)
        rest = moved[nodes, 0] - lever @ np.linalg.lstsq(lever, moved[nodes, 0], rcond=None)[0]
        assert np.abs(rest).max() < 1e-9 * size
        assert np.ptp(moved[nodes, 0]) > 1e-2 * size


def test_nodes_that_move_alike_stretch_a_bar_by_hooke() -> None:
    """Pulled at one node, all nodes of the face alike along x, its sides free: u = F L / (E A) with Poisson's ratio."""
    boundary = {a: {"type": "symmetry", "face": f"b0.{a}min"} for a in "xyz"}
    load = {"pull": {"face": "b0.xmax", "force": [2e4, 0.0, 0.0], "point": [0.1, 0.02, 0.09]}}
    coupling = {"ends": ["b0.xmax"], "rigid": True, "components": ["x"]}
    scene = cubes(coupling, rigid=(False,), boundary=boundary, load=load)
    moved = latin_fmu.solve(scene).substructures["b0"].displacement[-1]
    stretch = 2e4 / (E * EDGE**2)
    exact = stretch * np.array([1.0, -0.3, -0.3]) * discretise(scene).bodies["b0"].mesh.nodes
    np.testing.assert_allclose(moved, exact, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("coupling", "words"),
    [
        ({"ends": ["b0.xmax", "b1.xmin"], "components": ["x"], "rigid": True}, "those of one rigid face"),
        ({"ends": ["b0.xmax"], "components": ["rx"], "rigid": True}, "no axis along which the nodes move as one"),
        ({"ends": ["b0.xmax"], "components": ["x", "x"], "rigid": True}, "one to six different ones"),
    ],
)
def test_bad_components_are_refused(coupling: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        cubes(coupling)


def test_a_sensor_on_an_arm_follows_the_face() -> None:
    """A rigid body that spins: velocity and displacement of a point off it; an elastic one: the mean motion's."""
    sensor = {"s": {"face": "b0.zmax", "point": [0.3, 0.2, 0.5]}}
    tables = {"boundary": {}, "time": {"end": 1e-5, "instants": 10}, "sensor": sensor, "solver": {}}
    for rigid in (True, False):
        scene = cubes({"ends": ["b0.xmax"], "rigid": True}, rigid=(rigid,), **tables)
        data = scene.tables()
        data["substructure"]["b0"] |= {"initial_spin": [0.0, 0.0, 20.0], "initial_velocity": [1.0, 2.0, 3.0]}
        measured = latin_fmu.solve(latin_fmu.scene_from_dict(data)).sensors["s"]
        exact = np.array([1.0, 2.0, 3.0]) + np.cross([0.0, 0.0, 20.0], [0.25, 0.15, 0.45])
        np.testing.assert_allclose(measured.velocity, np.tile(exact, (11, 1)), rtol=1e-9)
        np.testing.assert_allclose(measured.displacement[-1], 1e-5 * exact, rtol=1e-9)


def test_momentum_through_a_coupling() -> None:
    """Two free cubes, one with a velocity: momentum and angular momentum of the pair stay."""
    tables = {"boundary": {}, "time": {"end": 1e-4, "instants": 100}, "solver": {"tolerance": 1e-8}}
    scene = cubes({"ends": ["b0.xmax", "b1.xmin"]}, **tables)
    data = scene.tables()
    for n in ("b0", "b1"):  # one velocity on both sides: no jump to lose, but a turn about the far end
        data["substructure"][n]["initial_velocity"] = [0.0, 1.0, 0.0]
    data["load"] = {
        "blow": {"face": "b1.xmax", "traction": [0.0, 0.0, 1e6], "law": {"type": "half_sine", "duration": 2e-5}}
    }
    outcome = latin_fmu.solve(latin_fmu.scene_from_dict(data))
    bodies = discretise(scene).bodies
    momentum, spin = np.zeros(3), np.zeros(3)
    for n, fields in outcome.substructures.items():
        p = (bodies[n].mass @ fields.velocity[-1].ravel()).reshape(-1, 3)
        momentum += p.sum(axis=0)
        spin += np.cross(bodies[n].mesh.nodes - [0.3, 0.05, 0.05], p).sum(axis=0)
    impulse = 1e6 * EDGE**2 * np.sin(np.pi * np.arange(21) / 20).sum() * 1e-6  # as sampled
    mass = RHO * EDGE**3
    np.testing.assert_allclose(momentum, [0.0, 2 * mass, impulse], atol=1e-6 * impulse)
    before = sum(np.cross([x - 0.3, 0.0, 0.0], [0.0, mass, 0.0]) for x in (0.05, 0.25))
    np.testing.assert_allclose(spin, before, atol=1e-6 * np.abs(before).max())


@pytest.mark.parametrize(
    ("coupling", "words"),
    [
        ({"ends": ["b0.xmax"]}, "one end alone is joined to nothing"),
        ({"ends": ["b0.xmax", "b1.left"]}, "has no face of this name"),
        ({"ends": ["ground", "b1.xmin"]}, "name the ground second"),
        ({"ends": ["b0.xmin"], "rigid": True}, None),
        ({"ends": ["b0.xmax", "b0.ymin"], "rigid": True}, "shares nodes with another rigid face"),
        (
            {
                "ends": [
                    {"substructure": "b0", "point": [0.1, 0.0, 0.0]},
                    {"substructure": "b1", "point": [0.2, 0.0, 0.0]},
                ]
            },
            "use a spring",
        ),
    ],
)
def test_bad_couplings_are_refused(coupling: dict[str, Any], words: str | None) -> None:
    held = {"wall": {"type": "fixed", "face": "b0.xmin"}, "other": {"type": "fixed", "face": "b1.xmax"}}
    if words is None:
        latin_fmu.check(cubes(coupling, boundary=held))
        return
    with pytest.raises(SceneError, match=words):
        latin_fmu.check(cubes(coupling, boundary=held))


@pytest.mark.parametrize("name", ["explicit", "generalized_alpha", "cg"])
def test_other_schemes_follow_the_plain_one(name: str) -> None:
    """A blow on two coupled cubes, one face of which lands on the ground in massless contact."""
    time = {"end": 4e-4, "instants": 160} | ({"scheme": name} if name == "generalized_alpha" else {"scheme": "hht"})
    load = {"blow": {"face": "b1.xmax", "moment": [0.0, 50.0, 0.0], "law": {"type": "half_sine", "duration": 4e-4}}}
    solver = {"tolerance": 1e-6} | ({"propagator": name} if name in ("explicit", "cg") else {})
    if name == "explicit":
        time = {"end": 4e-4, "instants": 160}
    wall = {"g": {"sides": ["b1.xmin", "ground"], "gap": 1.0}}
    sensor = {"end": {"face": "b1.zmax"}}
    coupling = {"ends": ["b0.xmax", "b1.xmin"], "rigid": name != "explicit"}
    tables = {"load": load, "interface": wall, "sensor": sensor}
    plain = latin_fmu.solve(cubes(coupling, time=time | {"scheme": "hht"}, **tables)).sensors["end"].displacement
    other = latin_fmu.solve(cubes(coupling, time=time, solver=solver, **tables)).sensors["end"].displacement
    assert np.abs(other - plain).max() < 0.05 * np.abs(plain).max()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"moment": [1.0, 0.0, 0.0], "traction": [1.0, 0.0, 0.0]}, "a traction has no moment"),
        ({"pressure": 1.0, "point": [1.0, 0.0, 0.0]}, "a pressure has no point"),
        ({"point": [1.0, 0.0, 0.0]}, "neither 'pressure'"),
    ],
)
def test_bad_moments_are_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        cubes({"ends": ["b0.xmax", "b1.xmin"]}, load={"l": {"face": "b1.xmax", **change}})


def test_reactions_of_a_rigid_edge_are_refused() -> None:
    boundary = {"half": {"type": "symmetry", "face": "b0.ymin"}, "wall": {"type": "fixed", "face": "b0.xmin"}}
    tables = {"boundary": boundary, "output": {"reactions": True}, "time": {"end": 1e-5, "instants": 9}}
    with pytest.raises(SceneError, match="boundary half holds nodes of a face that a coupling makes rigid"):
        latin_fmu.check(cubes({"ends": ["b0.xmax"], "rigid": True}, rigid=(False,), **tables))


def test_a_rigid_face_needs_an_implicit_scheme() -> None:
    with pytest.raises(SceneError, match="central differences need"):
        cubes(
            {"ends": ["b0.xmax"], "rigid": True}, time={"end": 1e-5, "instants": 9}, solver={"propagator": "explicit"}
        )
