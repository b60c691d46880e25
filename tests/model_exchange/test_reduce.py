"""From a scene to a reduced system: patches, bodies, bonds, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError
from latin_fmu.model_exchange.equations import Equations, ReducedSystem
from latin_fmu.model_exchange.reduce import Cut, bonded_bodies, deflections, patches, reduced_system
from tests.cosim.scenes import bar

from .scenes import SIZE, pair, rods


@pytest.mark.parametrize("n", [1, 2, 4, 7, 100])
def test_patches_share_the_points(n):
    x, y = np.meshgrid(np.linspace(0, 2, 9), np.linspace(0, 1, 5), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    groups = patches(points, np.ones(45), n)
    assert len(groups) == min(n, 45)
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(45))


def test_patches_of_a_square_are_its_quarters():
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    groups = patches(points, np.ones(16), 4)
    assert [len(members) for members in groups] == [4, 4, 4, 4]
    for members in groups:
        np.testing.assert_array_equal(np.ptp(points[members], axis=0), [1.0, 1.0, 0.0])


def test_static_stiffness_of_a_contact():
    """Two rods of length L, one held: the static shortening under a pressure p is p L / E of each... the free one
    has inertia relief: a third of that."""
    system = reduced_system(rods("contact"), 2, 1)
    np.testing.assert_allclose(1.0 / system.contacts.stiffness, 1.0 / 900.0 * (1.0 + 1.0 / 3.0), rtol=2e-2)


def test_bonded_rods_are_one_body():
    """At rest under the pull: u = t x / E at the top, and the joint carries the pull."""
    system = reduced_system(rods(), 4)
    assert system.bodies == ["a_b"]
    equations = Equations(system, energy=False)
    y = equations.start()
    y[: system.n] = system.loads[:, 0] / system.stiffness
    now = equations.evaluate(0.5, y, equations.modes_at(0.5, y), {})
    top = system.places[0] @ y[: system.n]
    np.testing.assert_allclose(top, [0.0, 0.0, 3.0 * 2.0 / 900.0], atol=1e-12)
    force = now.derivative[2 * system.n :]
    np.testing.assert_allclose(force, [0.0, 0.0, 3.0 * 0.02], atol=1e-10)  # b pulls a up
    np.testing.assert_allclose(now.derivative[: 2 * system.n], 0.0, atol=1e-9)


def test_bonded_rods_of_different_meshes_are_one_body():
    """The same with three by two elements across the upper rod."""
    whole = rods().tables()
    whole["substructure"]["b"]["box"]["elements"] = [3, 2, 5]
    system = reduced_system(latin_fmu.scene_from_dict(whole), 4)
    assert system.bodies == ["a_b"]
    equations = Equations(system, energy=False)
    y = equations.start()
    y[: system.n] = system.loads[:, 0] / system.stiffness
    now = equations.evaluate(0.5, y, equations.modes_at(0.5, y), {})
    np.testing.assert_allclose(system.places[0] @ y[: system.n], [0.0, 0.0, 3.0 * 2.0 / 900.0], atol=1e-12)
    np.testing.assert_allclose(now.derivative[2 * system.n :], [0.0, 0.0, 3.0 * 0.02], atol=1e-10)


def test_contact_of_different_meshes_has_the_patches_of_matching_ones():
    """Two patches of the points of the finer face; the static response is that of the mesh (the reduction checks)."""
    whole = rods("contact").tables()
    whole["load"]["pull"]["traction"] = [0.0, 0.0, -3.0]
    whole["substructure"]["b"]["box"]["elements"] = [3, 2, 5]
    system = reduced_system(latin_fmu.scene_from_dict(whole), 4, 2)
    assert len(system.contacts.area) == 2
    np.testing.assert_allclose(system.contacts.area.sum(), 0.02)


def test_force_through_a_bond_is_what_accelerates_the_other_side():
    """A free pair of bonded blocks under a pressure: the lower one gets half of the force at once (rigid motion)."""
    scene = pair(interface={"meet": {"sides": ["lower.zmax", "upper.zmin"], "behaviour": "perfect"}})
    system = reduced_system(scene, 300)
    equations = Equations(system, energy=False)
    y = equations.start()
    y[: system.n] = np.divide(
        system.loads[:, 0] - (system.inertia * _rigid(system)),
        system.stiffness,
        out=np.zeros(system.n),
        where=system.stiffness > 0,
    )
    now = equations.evaluate(2e-6, y, equations.modes_at(2e-6, y), {})
    force = now.derivative[2 * system.n :]
    np.testing.assert_allclose(force, [0.0, 0.0, -0.5 * 100e6 * SIZE**2], atol=1e-6 * 100e6 * SIZE**2)


def _rigid(system: ReducedSystem) -> np.ndarray:
    return np.where(system.stiffness > 0, 0.0, system.loads[:, 0] / system.inertia)


def test_initial_motion_is_kept():
    system = reduced_system(bar(), 3)
    velocity = system.sides[0, 0] @ system.velocity
    np.testing.assert_allclose(velocity, [0.0, 0.0, -10.0], atol=1e-9)
    assert 0.5 * system.inertia @ system.velocity**2 == pytest.approx(0.5 * 10.0 * 100.0)


def test_bytes_and_back():
    for scene in (pair(), rods(), bar()):
        system = reduced_system(scene, 3, 2)
        serialized = system.to_bytes()
        again = ReducedSystem.from_bytes(serialized)
        assert again.to_bytes() == serialized == reduced_system(scene, 3, 2).to_bytes()
        assert again.bodies == system.bodies
        np.testing.assert_array_equal(again.contacts.opening, system.contacts.opening)


def test_what_has_no_reduced_model_is_said_at_once():
    scene = pair(
        interface={
            "meet": {"sides": ["lower.zmax", "upper.zmin"], "behaviour": "no_slip"},
            "stick": {"sides": ["lower.zmin", "ground"], "behaviour": "perfect"},
        },
        boundary={"lift": {"type": "velocity", "face": "upper.zmax", "components": ["z"], "value": [1.0]}},
        load={},
        time={"end": 6e-6, "step": 0.2e-6, "quasi_static": True},
        effects={"prestress": "on"},
    )
    with pytest.raises(SceneError) as error:
        reduced_system(scene, -1, 0)
    where = [problem.where for problem in error.value.problems]
    assert where == [
        "modes",
        "patches",
        "time.quasi_static",
        "effects.prestress",
        "interface.meet.behaviour",
        "interface.stick.sides",
        "boundary.lift.type",
    ]


def test_too_many_states():
    with pytest.raises(SceneError, match="1 to 64"):
        reduced_system(pair(), 10, 1000)
    blocks = {
        name: {"material": "steel", "box": {"origin": [0.02 * i, 0, 0], "size": [0.01] * 3, "elements": [2, 2, 2]}}
        for i, name in enumerate(f"cube{j}" for j in range(40))
    }
    load = {"traction": [1.0, 2.0, 3.0]}
    many = pair(substructure=blocks, interface={}, load={n: {**load, "face": f"{n}.zmax"} for n in blocks})
    with pytest.raises(SceneError, match="at most 600 states"):
        reduced_system(many, 80, 1)


def test_scheme_and_solver_do_not_count():
    base = reduced_system(pair(), 3, 1)
    other = pair(time={"end": 6e-6, "step": 0.2e-6, "scheme": "massless_contact"}, solver={"window": 5})
    np.testing.assert_array_equal(reduced_system(other, 3, 1).stiffness, base.stiffness)


def test_rigid_bodies_have_no_modes():
    rigid = {"material": "steel", "rigid": True, "box": {"size": [0.01, 0.01, 0.01], "elements": [2, 2, 2]}}
    upper = {"material": "steel", "box": {"origin": [0.0, 0.0, SIZE], "size": [SIZE] * 3, "elements": [2, 2, 2]}}
    with pytest.raises(SceneError, match=r"substructure\.lower\.rigid"):
        reduced_system(pair(substructure={"lower": rigid, "upper": upper}))


def test_a_temperature_at_the_start_is_refused():
    """A reduced model has no stress there; one that begins with 0 is taken."""
    steel = {"steel": {**pair().material["steel"].model_dump(exclude_none=True), "thermal_expansion": 12e-6}}

    def heated(law, **keys):
        time = {"end": 6e-6, "step": 0.2e-6, "start": "given"}
        return pair(material=steel, time=time, temperature={"day": {"change": 5.0, "law": law, **keys}})

    with pytest.raises(SceneError, match=r"temperature\.day\.law.*starts without stress.*let it rise"):
        reduced_system(heated("constant"), 3, 1)
    reduced_system(heated({"type": "table", "times": [0, 1], "values": [0, 1]}), 3, 1)


def test_what_cannot_move_is_told():
    held = {"type": "fixed"}
    faces = ("zmin", "zmax", "xmin", "xmax", "ymin", "ymax")
    box = {"size": [SIZE] * 3, "elements": [1, 1, 1]}
    blocks = pair().model_dump()["substructure"]
    blocks["lower"] = {"material": "steel", "box": box}
    blocks["upper"] = {"material": "steel", "box": {"origin": [0.0, 0.0, SIZE], **box}}
    boundary = {f"lower_{face}": {**held, "face": f"lower.{face}"} for face in faces}
    with pytest.raises(SceneError, match="no node is free to move"):
        reduced_system(pair(substructure=blocks, boundary=boundary))
    blocks["lower"]["box"] = {"size": [SIZE] * 3, "elements": [1, 1, 2]}
    boundary = {n: {**held, "face": f"{n}.{f}"} for n, f in (("lower", "zmax"), ("upper", "zmin"))}
    with pytest.raises(SceneError, match="neither side can move along the normal"):
        reduced_system(pair(substructure=blocks, boundary=boundary))


def test_patches_too_coarse_for_the_bending_are_refused():
    """A thin plate pressed down along one edge of its bed: two patches below it do not hold what bends inside them."""
    plate = {"origin": [0.0, 0.0, 0.0], "size": [0.04, 0.04, 0.002], "elements": [8, 8, 1]}
    bed = {"origin": [0.0, 0.0, -0.01], "size": [0.04, 0.04, 0.01], "elements": [8, 8, 2]}
    parts = {"plate": plate, "bed": bed}
    scene = pair(
        substructure={n: {"material": "steel", "box": box} for n, box in parts.items()},
        interface={"rest": {"sides": ["bed.zmax", "plate.zmin"]}},
        boundary={"ground": {"type": "fixed", "face": "bed.zmin"}},
        load={"edge": {"face": "plate.xmax", "traction": [0.0, 0.0, -1e6]}},
    )
    with pytest.raises(SceneError, match=r"load\.edge: with contacts closed.*2 patches"):
        reduced_system(scene, 6, 2)


def test_patches_that_are_fine_enough_deflect_like_the_mesh():
    """Loads that press whole faces: a per cent, with and without friction, against the ground too."""
    scene = pair()
    system = reduced_system(scene, 6, 4)
    prepared = discretise(scene)
    cuts = [Cut.of(i, u, 4) for i, u in enumerate(prepared.units)]
    deflection = deflections(system, bonded_bodies(prepared), cuts)
    assert list(deflection) == ["press"]
    assert deflection["press"] == pytest.approx(1.0, abs=0.01)
