"""Faces whose nodes do not match: uniform states, waves, momentum and partial cover against what is known exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.cosim.session import Session
from latin_fmu.fem.elements import Elements, mass
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.stability.scenes import Box, Material, column
from latin_fmu.stability.surfaces import turned, typed_box, write_mesh
from tests.scenes import ramp, solve

from .blocks import stack
from .static_scenes import STEEL, add_block, add_stack, scene

E, NU = STEEL["young_modulus"], STEEL["poisson_ratio"]
SIZE, PRESSURE = (0.02, 0.01, 0.01), 80e6
FIVE = ((6, 6), (4, 4), (7, 5), (3, 3), (5, 4))
KINDS = ("hexahedron", "tetra", "wedge", "wedge15", "tetra10", "hexahedron20", "hexahedron27")
ROLLER = {"behaviour": "elastic_layer", "normal_stiffness": 2e13, "tangential_stiffness": 0.0}


# -- uniform compression ------------------------------------------------------------------------------------------
def pressed(counts: tuple[tuple[int, int], ...], friction: float, **interface: Any) -> dict[str, Any]:
    """Blocks with these in-plane numbers of elements, free to spread, pressed on a plane of symmetry."""
    made, elements = scene(2, tolerance=1e-10), [(*n, 2) for n in counts]
    made["boundary"]["base"] = {"type": "symmetry", "face": "b1.zmin"}
    return add_stack(made, SIZE, elements, PRESSURE, friction_coefficient=friction, **interface)


def of_kind(made: dict[str, Any], kind: str, folder: Path, turn: np.ndarray | None = None) -> dict[str, Any]:
    """The blocks as mesh files of another type of cells; ``turn`` : rotated, on rollers instead of symmetry planes."""
    for i, (name, body) in enumerate(made["substructure"].items()):
        elements = body.pop("box")["elements"]
        mesh = typed_box(kind, (0.0, 0.0, i * SIZE[2]), SIZE, tuple(elements))
        write_mesh(folder / f"{name}.msh", mesh, None if turn is None else lambda x: x @ turn.T)
        body["mesh"] = {"file": str(folder / f"{name}.msh"), "group": "body"}
    if turn is not None:
        for name, boundary in made["boundary"].items():
            made["interface"][f"roller_{name}"] = {"sides": [boundary["face"], "ground"], **ROLLER}
        made["boundary"] = {}
    return made


def check_uniform(made: dict[str, Any], most: int, turn: np.ndarray | None = None) -> None:
    """Pressure at every point and displacement at every node, to 1e-8; at most so many iterations."""
    q = np.eye(3) if turn is None else turn
    solution = solve(made)
    sunk = 0.0 if turn is None else PRESSURE / ROLLER["normal_stiffness"]
    for name, history in solution.interfaces.items():
        if name.startswith("i"):
            pressure = -history.traction[-1] @ q[:, 2]
            assert pressure == pytest.approx(PRESSURE, rel=1e-8)
    height = len(solution.substructures) * SIZE[2]
    for body in solution.substructures.values():
        x = body.nodes @ q
        exact = PRESSURE / E * np.stack([NU * x[:, 0], NU * x[:, 1], -x[:, 2]], axis=1) - [0, 0, sunk]
        assert body.displacement[-1] @ q == pytest.approx(exact, abs=1e-8 * PRESSURE / E * height)
    assert max(w.iterations for w in solution.windows) <= most


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("owner", ["automatic", "Ep"])
def test_patch_of_two(friction: float, owner: str) -> None:
    check_uniform(pressed(((6, 6), (4, 4)), friction, points_from=owner), 70)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_patch_of_five(friction: float) -> None:
    check_uniform(pressed(FIVE, friction), 80)


@pytest.mark.parametrize("kind", KINDS)
def test_patch_of_every_type_of_cell(kind: str, tmp_path: Path) -> None:
    check_uniform(of_kind(pressed(((6, 6), (4, 4)), 0.3), kind, tmp_path), 100)


@pytest.mark.parametrize("kind", ["hexahedron", "tetra10"])
def test_tilted_patch(kind: str, tmp_path: Path) -> None:
    turn = turned([0.3, 1.0, 0.2], 30.0)
    check_uniform(of_kind(pressed(((4, 4), (3, 3)), 0.3), kind, tmp_path, turn), 100, turn)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize("kind", KINDS)
def test_patch_of_five_of_every_type_of_cell(kind: str, degrees: float, friction: float, tmp_path: Path) -> None:
    turn = turned([0.3, 1.0, 0.2], degrees) if degrees else None
    check_uniform(of_kind(pressed(FIVE, friction), kind, tmp_path, turn), 130, turn)


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron20"])
def test_quadratic_faces_with_matching_nodes(kind: str, tmp_path: Path) -> None:
    """Nodes opposite each other: positive areas by the change of basis, on both sides alike."""
    made = of_kind(pressed(((4, 3), (4, 3)), 0.3), kind, tmp_path)
    unit = discretise(latin_fmu.scene_from_dict(made)).units[0]
    assert unit.geometry.matching
    assert unit.geometry.areas.min() > 0.0
    assert abs(unit.geometry.traces[0] - unit.geometry.traces[1]).max() > 0.0  # other numbers of the same nodes
    check_uniform(made, 60)


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron20", "hexahedron27"])
@pytest.mark.parametrize("counts", [((4, 3), (4, 3)), ((6, 6), (4, 4))])
def test_patch_with_points_at_corners(kind: str, counts: Any, tmp_path: Path) -> None:
    """Matching or not, a uniform state passes as with points at all nodes, of which there are some four times more."""
    made = of_kind(pressed(counts, 0.3, points_at="corners"), kind, tmp_path)
    unit = discretise(latin_fmu.scene_from_dict(made)).units[0]
    finer = max(counts)
    assert unit.geometry.n_point == (finer[0] + 1) * (finer[1] + 1)
    assert unit.geometry.cells is not None
    # triangles or quadrilaterals between corners, over the whole face
    assert len(unit.geometry.cells) == finer[0] * finer[1] * (2 if kind == "tetra10" else 1)
    check_uniform(made, 130)


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron27"])
def test_ground_with_points_at_corners(kind: str, tmp_path: Path) -> None:
    """A block pressed on the ground: the base carries the pressure evenly, the block spreads without friction."""
    made = pressed(((3, 2),), 0.0)
    del made["boundary"]["base"]
    ground = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    made["interface"]["base"] = {"sides": ["b1.zmin", "ground"], "points_at": "corners", "ground": ground}
    made = of_kind(made, kind, tmp_path)
    solution = solve(made)
    base = solution.interfaces["base"]
    assert base.traction.shape[1] == 4 * 3
    assert -base.traction[-1, :, 2] == pytest.approx(-PRESSURE, rel=1e-7)
    nodes = solution.substructures["b1"].nodes
    sideways = solution.substructures["b1"].displacement[-1][:, 0]
    assert sideways == pytest.approx(NU * PRESSURE / E * nodes[:, 0], abs=1e-7 * PRESSURE / E * SIZE[0])


def test_corners_carry_an_edge_as_well_as_nodes_do(tmp_path: Path) -> None:
    """A block pressed on a larger one, whose pressures at the edge have no limit: with points at corners the approach
    is as near to that of a mesh twice as fine as with points at nodes, to a factor of 1.5."""

    def approach(n: int, points_at: str) -> float:
        made = scene(1, tolerance=1e-8)
        made["boundary"]["base"] = {"type": "fixed", "face": "b1.zmin"}
        for name, origin, size, counts in (
            ("b1", (0.0, 0.0, 0.0), (0.02, 0.02, 0.01), (2 * n, 2 * n, n)),
            ("b2", (0.003, 0.004, 0.01), (0.01, 0.011, 0.008), (n + 1, n + 1, n)),
        ):
            add_block(made, name, origin, size, counts)
        interface = {"sides": ["b1.zmax", "b2.zmin"], "friction_coefficient": 0.3, "points_at": points_at}
        made["interface"]["seat"] = interface
        made["load"]["press"] = {"face": "b2.zmax", "pressure": PRESSURE, "law": ramp((0, 0), (1, 1))}
        for name, table in made["substructure"].items():
            box = table.pop("box")
            mesh = typed_box("tetra10", tuple(box["origin"]), tuple(box["size"]), tuple(box["elements"]))
            write_mesh(tmp_path / f"{name}.msh", mesh, None)
            table["mesh"] = {"file": str(tmp_path / f"{name}.msh"), "group": "body"}
        solution = solve(made)
        body = solution.substructures["b2"]
        top = np.flatnonzero(body.nodes[:, 2] > 0.0179)
        return float(body.displacement[-1][top, 2].mean())

    fine = approach(4, "nodes")
    errors = {points: abs(approach(2, points) / fine - 1.0) for points in ("nodes", "corners")}
    assert 0.001 < errors["corners"] < 1.5 * errors["nodes"]


@pytest.mark.parametrize("behaviour", ["perfect", "no_slip"])
def test_bonded_patch(behaviour: str) -> None:
    made = pressed(FIVE, 0.0)
    for interface in made["interface"].values():
        interface["behaviour"] = behaviour
        del interface["friction_coefficient"]
    check_uniform(made, 200)


# -- bars ---------------------------------------------------------------------------------------------------------
def bars(
    n: int, m: int, poisson: float = 0.0, friction: float = 0.0, steps: int = 200, **solver: Any
) -> dict[str, Any]:
    """A bar of n x n elements thrown on one of m x m, 2 m/s."""
    size, material = (0.01, 0.01, 0.1), Material(E, 7800.0, poisson)
    return column(
        {"a": Box(material, size, (n, n, 20), (0.0, 0.0, 2.0)), "b": Box(material, size, (m, m, 20))},
        {"i": {"friction_coefficient": friction}},
        {"end": 4 * 0.1 / material.speed, "instants": steps},
        solver=solver,
        output={"fields": True, "energy": True},
    )


def iterations_in_touch(solution: latin_fmu.Solution) -> float:
    """Mean number over the instants at which some point touches."""
    touch = (solution.interfaces["i"].contact_status[1:] > 0).any(axis=1)
    return float(np.mean([w.iterations for w, t in zip(solution.windows, touch, strict=True) if t]))


def test_bars_without_lateral_strain_are_those_of_matching_meshes() -> None:
    """Plane waves: no difference between 4/3 and 4/4 elements but the tolerance."""
    one, two = (solve(bars(4, m, tolerance=1e-8)).interfaces["i"].normal_resultant() for m in (3, 4))
    assert one == pytest.approx(two, abs=1e-7 * np.abs(two).max())


_SLOW = [pytest.param(n, m, marks=pytest.mark.slow) for n, m in ((6, 4), (6, 2), (8, 6), (8, 4), (8, 2))]


@pytest.mark.parametrize(("n", "m"), [(4, 3), (4, 2), *_SLOW])
def test_iterations_grow_little(n: int, m: int) -> None:
    one, same = solve(bars(n, m, NU, 0.3)), solve(bars(n, n, NU, 0.3))
    assert iterations_in_touch(one) <= 1.6 * iterations_in_touch(same)
    impulse = [np.trapezoid(s.interfaces["i"].normal_resultant(), s.time) for s in (one, same)]
    assert impulse[0] == pytest.approx(impulse[1], rel=2e-3)


def test_explicit_bars() -> None:
    counts = []
    for m in (2, 3):
        made = bars(3, m, NU, 0.2, 800)
        made["time"]["scheme"] = {"type": "central_difference"}
        counts.append(iterations_in_touch(solve(made)))
    assert counts[0] <= 2.2 * counts[1]


def test_reduced_bars() -> None:
    """Modes of the free bars and of the covered points carry the wave as well as those of matching meshes."""
    made = [bars(3, m, NU, 0.2, propagator={"type": "reduced", "modes": 40}) for m in (2, 3)]
    one, two = (s.interfaces["i"].normal_resultant() for s in map(solve, made))
    assert np.trapezoid(one) == pytest.approx(np.trapezoid(two), rel=2e-3)


@pytest.mark.parametrize(("n", "m"), [(4, 3), (3, 4)])
def test_linear_and_angular_momentum(n: int, m: int) -> None:
    """A spinning bar thrown on another: what one loses the other gains."""
    made = bars(n, m, NU, 0.3, 60, tolerance=1e-11)
    for name, z in (("a", 0.0), ("b", 0.03)):
        made["substructure"][name]["box"] |= {"origin": [0, 0, z], "size": [0.01, 0.01, 0.03]}
        made["substructure"][name]["box"]["elements"][2] = 5
    made["substructure"]["a"] |= {"initial_velocity": [1.0, 0.5, 3.0], "initial_spin": [20.0, 10.0, 30.0]}
    made["time"] |= {"end": 3e-5, "scheme": "hht"}  # in which the mass of every node stays where it is
    solution = solve(made)
    assert np.abs(solution.interfaces["i"].traction).max() > 0.0
    linear, angular = np.zeros((61, 3)), np.zeros((61, 3))
    for name, body in solution.substructures.items():
        box = made["substructure"][name]["box"]
        mesh = box_mesh(*(np.array(box[k], float) for k in ("origin", "size")), tuple(box["elements"]))
        moved = (mass(Elements(mesh), 7800.0) @ body.velocity.reshape(61, -1).T).T.reshape(61, -1, 3)
        linear += moved.sum(axis=1)
        angular += np.cross(mesh.nodes, moved).sum(axis=1)
    for total in (linear, angular):
        assert np.abs(total - total[0]).max() <= 1e-11 * np.abs(total[0]).max()


# -- partial cover ------------------------------------------------------------------------------------------------
def pressed_on_a_plate(reach: float, shift: float, elements: int, owner: str) -> dict[str, Any]:
    """A soft block without lateral strain on a stiff plate of 1 mm elements, ``reach`` into the last ones."""
    made, h = scene(2, tolerance=1e-8), 1e-3
    made["material"]["soft"] = {"young_modulus": 210e6, "poisson_ratio": 0.0, "density": 1000.0}
    add_block(made, "plate", (0.0, 0.0, -2 * h), (6 * h, 6 * h, 2 * h), (6, 6, 2))
    wide = (3 + reach - shift) * h
    add_block(made, "block", ((1 + shift) * h, h, 0.0), (wide, (3 + reach) * h, 2 * h), (elements, elements, 2))
    made["substructure"]["block"]["material"] = "soft"
    made["boundary"]["base"] = {"type": "fixed", "face": "plate.zmin"}
    sides = ["plate.zmax", "block.zmin"]
    made["interface"]["i"] = {"sides": sides, "friction_coefficient": 0.3, "points_from": owner}
    made["load"]["press"] = {"face": "block.zmax", "pressure": 1e6, "law": ramp((0, 0), (1, 1))}
    return made


@pytest.mark.parametrize("share", [0.2, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(("shift", "elements"), [(0.0, 5), (0.97, 3)])
def test_partly_covered_owner(share: float, shift: float, elements: int) -> None:
    """The nodes beyond the block's edges have ``share`` of their areas, its square at the corner."""
    made = pressed_on_a_plate(float(np.sqrt(2 * share)), shift, elements, "E")
    solution = solve(made)
    history = solution.interfaces["i"]
    pressure = -history.traction[-1, :, 2] / 1e6
    assert pressure.min() > 0.9
    assert pressure.max() < 1.1
    assert max(w.iterations for w in solution.windows) <= 40
    assert history.areas @ pressure == pytest.approx(history.areas.sum(), rel=1e-6)


def test_the_covered_face_gives_the_points() -> None:
    """Though its elements are larger than those of the plate."""
    made = pressed_on_a_plate(0.3, 0.0, 2, "automatic")
    unit = discretise(latin_fmu.scene_from_dict(made)).units[0]
    assert unit.geometry.owner == 1
    assert unit.geometry.n_point == 9
    made["interface"]["i"]["points_from"] = "E"
    assert discretise(latin_fmu.scene_from_dict(made)).units[0].geometry.owner == 0


def test_two_searches_of_one_answer() -> None:
    """Iteration and search direction leave the result with friction alone."""
    made = pressed_on_a_plate(0.4, 0.0, 4, "automatic")
    made["load"]["shear"] = {"face": "block.zmax", "traction": [2e5, 1e5, 0.0], "law": ramp((0, 0), (1, 1))}
    made["time"]["instants"] = 4
    fields = []
    for factor in (1.0, 4.0):
        made["solver"] = {"tolerance": 1e-8, "search_direction": {"factor": factor}, "max_iterations": 2000}
        fields.append(solve(made).interfaces["i"].traction)
    assert np.abs(fields[0] - fields[1]).max() <= 1e-2 * np.abs(fields[0]).max()


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("elements", [3, 12])
def test_rigid_tool_without_opposite_nodes(elements: int, friction: float) -> None:
    """However its own mesh is, the points are those of the elastic face: exact pressure, few iterations."""
    made = pressed_on_a_plate(0.4, 0.2, 5, "automatic")
    made["substructure"]["plate"] |= {"rigid": True}
    made["substructure"]["plate"]["box"]["elements"] = [elements, elements, 1]
    made["interface"]["i"]["friction_coefficient"] = friction
    if not friction:
        made["boundary"]["top"] = {"type": "fixed", "face": "block.zmax", "components": ["x", "y"]}
    solution = solve(made)
    assert -solution.interfaces["i"].traction[-1, :, 2] == pytest.approx(1e6, rel=1e-7)
    assert len(solution.interfaces["i"].areas) == 36
    assert max(w.iterations for w in solution.windows) <= 20


def test_a_held_face_does_not_give_the_points() -> None:
    """A fine fixed face under a coarse free one would hold it at more points than it has nodes."""
    made = pressed_on_a_plate(0.4, 0.0, 3, "automatic")
    made["substructure"]["plate"]["box"] |= {"origin": [1e-3, 1e-3, -2e-3], "size": [3.4e-3, 3.4e-3, 2e-3]}
    made["substructure"]["plate"]["box"]["elements"] = [12, 12, 1]
    assert discretise(latin_fmu.scene_from_dict(made)).units[0].geometry.n_point == 169
    made["boundary"]["all"] = {"type": "fixed", "face": "plate.zmax"}
    solution = solve(made)
    assert -solution.interfaces["i"].traction[-1, :, 2] == pytest.approx(1e6, rel=1e-6)
    assert len(solution.interfaces["i"].areas) == 16


# -- every behaviour and scheme -----------------------------------------------------------------------------------
LAYER = {"normal_stiffness": 1e14, "tangential_stiffness": 1e13}
BEHAVIOURS: dict[str, dict[str, Any]] = {
    "perfect": {},
    "no_slip": {},
    "contact": {"friction_coefficient": 0.2},
    "elastic_layer": LAYER,
    "soft_contact": {"normal_stiffness": 1e14, "friction_coefficient": 0.2},
    "viscous_joint": {"normal_viscosity": 1e7, "tangential_viscosity": 1e6},
    "maxwell_joint": {"normal_stiffness": 1e14, "tangential_stiffness": 1e13, "relaxation_time": 1.0},
}


@pytest.mark.parametrize(
    ("behaviour", "scheme"),
    [*((b, "hht") for b in BEHAVIOURS), *((b, "massless_contact") for b in ("perfect", "contact"))],
)
def test_every_behaviour(behaviour: str, scheme: str) -> None:
    """A finer block in a stack under a pulse: forces near those of the matching stack, energies that close."""
    impulses = []
    for elements in (3, 4):
        made = stack(3, behaviour)
        made["substructure"]["b2"]["box"]["elements"] = [elements] * 3
        made["time"]["scheme"] = scheme
        for interface in made["interface"].values():
            interface.update(BEHAVIOURS[behaviour])
        solution = solve(made)
        impulses.append(np.trapezoid(solution.interfaces["i2"].normal_resultant(), solution.time))
        terms = solution.energy
        assert np.abs(terms["balance"]).max() <= 1e-10 * max(np.abs(t).max() for t in terms.values())
    assert impulses[1] == pytest.approx(impulses[0], rel=0.03)


# -- sessions and FMUs --------------------------------------------------------------------------------------------
def thrown_stack(**solver: Any) -> dict[str, Any]:
    """Three blocks of different meshes under a pulse."""
    made = stack(3, "contact", 0.2, **solver)
    made["substructure"]["b2"]["box"]["elements"] = [4, 4, 3]
    return made


def test_a_session_is_a_run() -> None:
    """Communication points leave the interface forces of the run."""
    scene = latin_fmu.scene_from_dict(thrown_stack(tolerance=1e-8))
    force = latin_fmu.solve(scene).interfaces["i1"].force()
    session = Session(scene)
    session.initialize()
    session.step(0.0, scene.time.end)
    at_end = session.values([f"interface.i1.force[{i}]" for i in (1, 2, 3)])
    assert at_end == pytest.approx(force[-1], abs=1e-5 * np.abs(force).max())
