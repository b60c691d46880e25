"""Displacements and velocities at t = 0 that differ from node to node, against closed forms and against other keys."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.inactive_substructures import arrival_times
from latin_fmu.building import discretise

STRAIN, LENGTH, SPEED = 1e-4, 0.1, 1000.0  # of the bar below: c = sqrt(E / rho)
SPIN = (1.0, -2.0, 3.0)
AXIAL = [[STRAIN, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]


def bar(elements=40, instants=800, end=8e-4, **keys):
    """A bar without lateral strain, E = 1 GPa, rho = 1000 kg m-3; ``keys`` of its substructure."""
    box = {"origin": [0.3, 0.0, 0.0], "size": [LENGTH, 0.01, 0.01], "elements": [elements, 1, 1]}
    return {
        "name": "bar",
        "material": {"stuff": {"young_modulus": 1e9, "poisson_ratio": 0.0, "density": 1000.0}},
        "substructure": {"bar": {"material": "stuff", "box": box, **keys}},
        "time": {"end": end, "instants": instants},
        "output": {"fields": True, "energy": True},
    }


def stretched(**settings):
    """The bar held at its left end, stretched evenly, and released at its right end at t = 0."""
    scene = bar(initial_displacement_gradient=AXIAL, initial_displacement=[STRAIN * LENGTH / 2, 0.0, 0.0])
    held = {"type": "fixed", "face": "bar.xmin", "components": ["x"]}
    return {**scene, "boundary": {"wall": held}, **settings}


def solved(scene, folder=None):
    return latin_fmu.solve(latin_fmu.scene_from_dict(scene, folder))


def fields(solution):
    """Nodes, displacements and velocities of the bar."""
    history = solution.outcome.substructures["bar"]
    return history.nodes, history.displacement, history.velocity


def triangle(time):
    """Displacement of the released end: u = STRAIN (L - c t) until the wave is back at t = 2 L / c, period 4 L / c."""
    phase = np.mod(SPEED * time / LENGTH, 4.0)
    return STRAIN * LENGTH * (np.abs(phase - 2.0) - 1.0)


@pytest.mark.parametrize("propagator", ["direct", "explicit", "reduced"])
def test_a_stretched_bar_vibrates_as_the_wave_solution(propagator):
    """Two periods 4 L / c: the end within 1 % of its amplitude in the mean, and within 5 % at the last corner, which
    dispersion over 320 elements rounds."""
    scene = stretched(solver={"propagator": propagator})
    if propagator == "explicit":
        scene["time"] = {**scene["time"], "scheme": "central_difference"}
    solution = solved(scene)
    nodes, displacement, _ = fields(solution)
    end = displacement[:, np.argmax(nodes[:, 0]), 0]
    error = (end - triangle(solution.time)) / (STRAIN * LENGTH)
    assert np.abs(error).max() < 0.05
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.abs(displacement[..., 1:]).max() < 1e-9 * STRAIN * LENGTH


def test_the_energy_account_starts_with_the_strain_energy():
    """E A L strain^2 / 2 at t = 0, and at the end with what the scheme dissipates, both to 1e-10."""
    energy = solved(stretched()).energy
    stored = 0.5 * 1e9 * STRAIN**2 * LENGTH * 0.01**2
    assert energy["elastic"][0] == pytest.approx(stored, rel=1e-10)
    assert energy["kinetic"][0] == 0.0
    later = sum(energy[term][-1] for term in ("kinetic", "elastic", "scheme_dissipation"))
    assert later == pytest.approx(stored, rel=1e-10)


def spin_gradient(spin):
    x, y, z = spin
    return [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]


def test_a_skew_velocity_gradient_is_a_spin():
    first = fields(solved(bar(4, 50, initial_spin=SPIN)))
    second = fields(solved(bar(4, 50, initial_velocity_gradient=spin_gradient(SPIN))))
    for one, other in zip(first, second, strict=True):
        assert np.abs(one - other).max() <= 1e-12 * np.abs(one).max()
    assert np.abs(first[2]).max() > 0.1


def write(path, nodes, values, header="x,y,z,u,v,w\n", length=1.0, scale=1.0):
    """A file of a field, its rows in an order of their own."""
    rows = np.column_stack([nodes / length, values / scale])[::-1]
    path.write_text(header + "".join(",".join(repr(float(x)) for x in row) + "\n" for row in rows))


def mesh_nodes(scene):
    return discretise(latin_fmu.scene_from_dict(scene)).bodies["bar"].mesh.nodes


def test_a_file_of_a_field_is_the_gradient(tmp_path):
    """Coordinates in mm, velocities in cm/s, displacements in um; centre of the bar at (0.35, 0.005, 0.005)."""
    gradient = np.array([[10.0, 2.0, 0.0], [-3.0, 5.0, 1.0], [0.0, 4.0, -6.0]])
    nodes = mesh_nodes(bar(4, 50))
    linear = (nodes - [0.35, 0.005, 0.005]) @ gradient.T
    write(tmp_path / "v.csv", nodes, linear, length=1e-3, scale=1e-2)
    write(tmp_path / "u.csv", nodes, 1e-5 * linear, header="", length=1e-3, scale=1e-6)
    given = bar(
        4,
        50,
        initial_velocity_field={"file": "v.csv", "length_unit": "mm", "unit": "cm/s", "columns": [*"xyzuvw"]},
        initial_displacement_field={"file": "u.csv", "length_unit": "mm", "unit": "um"},
    )
    small = (1e-5 * gradient).tolist()
    wanted = bar(4, 50, initial_velocity_gradient=gradient.tolist(), initial_displacement_gradient=small)
    for one, other in zip(fields(solved(wanted)), fields(solved(given, tmp_path)), strict=True):
        assert np.abs(one - other).max() <= 1e-9 * np.abs(one).max()


def test_the_effective_scene_needs_no_file(tmp_path):
    nodes = mesh_nodes(bar(4, 50))
    write(tmp_path / "v.csv", nodes, np.ones_like(nodes))
    scene = latin_fmu.scene_from_dict(bar(4, 50, initial_velocity_field={"file": "v.csv"}), tmp_path)
    assert latin_fmu.scene_from_dict(scene.tables()).text() == scene.text()
    (tmp_path / "v.csv").unlink()
    velocity = fields(latin_fmu.solve(latin_fmu.scene_from_dict(scene.tables())))[2]
    assert np.abs(velocity - 1.0).max() < 1e-12


@pytest.mark.parametrize("scheme", [{"type": "newmark", "gamma": 0.5}, {"type": "central_difference"}])
def test_a_vibration_continues_from_its_fields(tmp_path, scheme):
    """Schemes whose state is u and v, a from equilibrium: 1e-8 of the uninterrupted run after a restart."""
    scene = stretched()
    scene["time"] = {"end": 8e-4, "instants": 800, "scheme": scheme}
    nodes, u, v = fields(solved(scene))
    for name, values in (("u", u[400]), ("v", v[400])):
        write(tmp_path / f"{name}.csv", nodes, values)
    keys = {"initial_velocity_field": {"file": "v.csv"}, "initial_displacement_field": {"file": "u.csv"}}
    second = {**scene, **bar(end=4e-4, instants=400, **keys)}
    second["time"] = {**second["time"], "scheme": scheme}
    _, later_u, later_v = fields(solved(second, tmp_path))
    assert np.abs(later_u - u[400:]).max() < 1e-8 * np.abs(u).max()
    assert np.abs(later_v - v[400:]).max() < 1e-8 * np.abs(v).max()


def test_supports_win_over_a_field_and_say_so():
    scene = bar(4, 50, initial_velocity_gradient=[[100.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    scene["boundary"] = {"wall": {"type": "fixed", "face": "bar.xmin"}}
    solution = solved(scene)
    nodes, _, velocity = fields(solution)
    wall = nodes[:, 0] == nodes[:, 0].min()
    assert not velocity[:, wall].any()
    assert velocity[0, ~wall, 0].max() == pytest.approx(100.0 * LENGTH / 2)
    text = "conditions override the initial velocity field at 4 nodes; the largest change is 5 m/s"
    assert any(text in warning for warning in solution.warnings)


def test_a_field_disturbs_its_body_at_once():
    scene = stretched()
    second = {
        **scene["substructure"]["bar"],
        "box": {**scene["substructure"]["bar"]["box"], "origin": [0.40002, 0.0, 0.0]},
    }
    still = {key: second[key] for key in ("material", "box")}
    scene["substructure"]["still"] = still
    scene["interface"] = {"joint": {"sides": ["bar.xmax", "still.xmin"], "behaviour": "contact"}}
    problem = discretise(latin_fmu.scene_from_dict(scene))
    arrival = arrival_times(problem.scene, problem.bodies, problem.units, problem.time)
    assert arrival["bar"] == 0.0
    assert problem.characteristic_traction == pytest.approx(1e9 * STRAIN)


GIVEN = {"initial_velocity_gradient": spin_gradient(SPIN)}
SHAPED = {"initial_displacement_gradient": AXIAL}
FILE = {"initial_velocity_field": {"file": "v.csv"}}


def static(scene):
    scene["time"]["start"] = "static"


def quasi_static(scene):
    scene["time"]["quasi_static"] = True


@pytest.mark.parametrize(
    ("keys", "change", "text", "words"),
    [
        (GIVEN | {"rigid": True}, None, "", "a rigid body does not deform"),
        (GIVEN, quasi_static, "", "without inertia every step is an equilibrium"),
        (SHAPED, static, "", "the displacements at t = 0 are those of the static equilibrium"),
        ({"initial_velocity_gradient": [[1.0, 0.0, 0.0]]}, None, "", "initial_velocity_gradient"),
        (FILE, None, None, "the file does not exist"),
        (FILE, None, "0,0,0,1,nan,0\n", "line 1 is not 6 finite numbers"),
        (FILE, None, "0,0,0,1\n", "no such column"),
        (FILE, None, "x,y,z,u,v,w\n", "one value for each point"),
        (FILE, None, "0.3,0,0,1,1,1\n", "19 of 20 nodes have no point of the file"),
        ({"initial_velocity_field": {"file": "v.csv", "columns": [1, 2]}}, None, "0,0\n", "not six columns"),
        (
            {"initial_velocity_field": {"file": "v.csv", "unit": "mm"}},
            None,
            "0,0,0,1,1,1\n",
            "a unit of a length, not of a velocity",
        ),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, keys, change, text, words):
    scene = bar(4, 50, **keys)
    if change is not None:
        change(scene)
    if text is not None:
        (tmp_path / "v.csv").write_text(text)
    with pytest.raises(latin_fmu.SceneError) as caught:
        discretise(latin_fmu.scene_from_dict(scene, tmp_path))
    assert words in str(caught.value)


def test_a_torn_bond_and_an_overlap_are_refused():
    for behaviour, words in (("perfect", "separate a bonded interface"), ("contact", "the sides overlap at the start")):
        scene = bar(4, 50, **SHAPED)
        box = {**scene["substructure"]["bar"]["box"], "origin": [0.4, 0.0, 0.0]}
        scene["substructure"]["still"] = {"material": "stuff", "box": box}
        scene["interface"] = {"joint": {"sides": ["bar.xmax", "still.xmin"], "behaviour": behaviour}}
        with pytest.raises(latin_fmu.SceneError) as caught:
            discretise(latin_fmu.scene_from_dict(scene))
        assert words in str(caught.value)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Folder with the results of the stretched bar: trapezoidal rule, fields at every second instant."""
    folder = tmp_path_factory.mktemp("results")
    scene = stretched(output={"fields": True, "every": 2})
    scene["time"] = {**scene["time"], "scheme": TRAPEZOIDAL}
    solution = solved(scene)
    solution.save(folder / "out.nc")
    return folder, fields(solution)


TRAPEZOIDAL = {"type": "newmark", "gamma": 0.5}


def continued(**state):
    scene = bar(end=4e-4, instants=400)
    scene["time"]["scheme"] = TRAPEZOIDAL
    return {**scene, "boundary": stretched()["boundary"], "initial_state": {"file": "out.nc", "time": 4e-4, **state}}


def test_a_run_continues_from_a_results_file(results):
    """The file has single precision: 1e-6 of the uninterrupted run in displacement, 1e-5 in velocity, to which the
    rounding of displacements contributes by the highest frequency of the mesh."""
    folder, (_, u, v) = results
    scene = latin_fmu.scene_from_dict(continued(), folder)
    assert scene.initial_state is None  # the effective scene holds the fields and needs no file
    _, later_u, later_v = fields(latin_fmu.solve(latin_fmu.scene_from_dict(scene.tables())))
    assert np.abs(later_u[::2] - u[200:]).max() < 1e-6 * np.abs(u).max()
    assert np.abs(later_v[::2] - v[200:]).max() < 1e-5 * np.abs(v).max()


@pytest.mark.parametrize(
    ("state", "change", "words"),
    [
        ({"file": "none.nc"}, {}, "no such file"),
        ({"file": "text.nc"}, {}, "not a readable results file"),
        ({"time": 4.01e-4}, {}, "one of 401 instants, the nearest are 0.0004, 0.000402"),
        ({"time": 1.0}, {}, "not stored at this instant"),
        ({"bodies": ["rod"]}, {}, "no substructure of this name"),
        ({}, {"name": "rod"}, "no displacements and velocities of rod in the file"),
        ({}, {"rigid": True}, "a rigid body takes no fields"),
        ({}, {"initial_velocity": [1.0, 0.0, 0.0]}, "the body starts from the state of [initial_state]"),
        ({}, {"elements": [80, 1, 1]}, "has 164 nodes, that of the scene 324"),
        ({}, {"elements": [30, 1, 1]}, "nodes have no point of the file"),
        ({}, {"size": [0.2, 0.01, 0.01]}, "nodes have no point of the file"),
        ({}, {"start": "static"}, "starts from a static equilibrium"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(results, state, change, words):
    folder, _ = results
    (folder / "text.nc").write_text("no results\n")
    scene = continued(**state)
    body = scene["substructure"]["bar"]
    for key, value in change.items():
        if key == "name":
            del scene["boundary"]
            scene["substructure"] = {value: body}
        elif key == "start":
            scene["time"]["start"] = value
        else:
            (body["box"] if key in body["box"] else body)[key] = value
    with pytest.raises(latin_fmu.SceneError) as caught:
        discretise(latin_fmu.scene_from_dict(scene, folder))
    assert words in str(caught.value)


def test_a_coarser_mesh_starts_from_the_common_nodes(results):
    """So do the coarser runs of an error estimate."""
    folder, (nodes, u, _) = results
    scene = continued()
    scene["substructure"]["bar"]["box"]["elements"] = [20, 1, 1]
    solution = solved(scene, folder)
    coarse, start, _ = fields(solution)
    both = [np.flatnonzero(np.linalg.norm(nodes - node, axis=1) < 1e-9)[0] for node in coarse]
    assert np.abs(start[0] - u[200][both]).max() < 1e-6 * np.abs(u).max()
    assert any("has 164 nodes, that of the scene 84" in warning for warning in solution.warnings)


def test_bars_after_an_impact_continue_and_those_in_contact_are_refused(tmp_path):
    """Two bars of one length swap their velocities in 2 L / c; the contact carries rho c v / 2 until then."""
    scene = bar(20, 300, 3e-4)
    right = {"material": "stuff", "box": {**scene["substructure"]["bar"]["box"], "origin": [0.4, 0.0, 0.0]}}
    scene["substructure"]["right"] = right
    scene["interface"] = {"joint": {"sides": ["bar.xmax", "right.xmin"], "behaviour": "contact"}}
    scene["time"]["scheme"] = "massless_contact"
    first = {**scene, "substructure": {**scene["substructure"]}}
    first["substructure"]["bar"] = {**scene["substructure"]["bar"], "initial_velocity": [1.0, 0.0, 0.0]}
    solution = solved(first)
    solution.save(tmp_path / "out.nc")
    with pytest.raises(latin_fmu.SceneError, match=r"the contact joint carries tractions up to 5\.0.*e\+05 Pa"):
        latin_fmu.scene_from_dict({**scene, "initial_state": {"file": "out.nc", "time": 5e-5}}, tmp_path)
    scene["time"] = {**scene["time"], "end": 2e-5, "instants": 20}
    later = solved({**scene, "initial_state": {"file": "out.nc", "time": 2.8e-4}}, tmp_path)
    assert not later.outcome.interfaces["joint"].traction.any()
    gap = later.outcome.interfaces["joint"].gap[-1]
    assert gap == pytest.approx(solution.outcome.interfaces["joint"].gap[-1], rel=1e-4)


def test_a_state_beside_a_broken_table_is_reported(results):
    with pytest.raises(latin_fmu.SceneError, match="substructure: must be a table"):
        latin_fmu.scene_from_dict({**continued(), "substructure": 7}, results[0])


# -- velocities of bonded sides -------------------------------------------------------------------------------------
def pair(first, second, **interface):
    """Two bonded cubes, one above the other, with keys of their substructures."""
    size = 0.05
    box = {"size": [size] * 3, "elements": [2, 2, 2]}
    above = {**box, "origin": [0.0, 0.0, size]}
    return {
        "name": "pair",
        "material": {"stuff": {"young_modulus": 1e9, "poisson_ratio": 0.3, "density": 1000.0}},
        "substructure": {
            "low": {"material": "stuff", "box": box, **first},
            "up": {"material": "stuff", "box": above, **second},
        },
        "interface": {"bond": {"sides": ["low.zmax", "up.zmin"], "behaviour": "perfect", **interface}},
        "time": {"end": 1e-5, "instants": 10},
    }


def turning(spin, centre, place):
    """A cube about a place whose centre is given."""
    arm = np.subtract(centre, place)
    return {"initial_velocity": np.cross(spin, arm).tolist(), "initial_spin": list(spin)}


LOW, UP = (0.025, 0.025, 0.025), (0.025, 0.025, 0.075)


@pytest.mark.parametrize("place", [(0.025, 0.025, 0.05), (0.1, -0.3, 0.7)])
def test_a_pair_that_turns_as_one_loses_no_jump(place):
    """About the middle of the bonded faces, whose own velocity is round-off, and about a point outside."""
    for spin in ((1.0, 0.0, 0.0), (0.3, -1.7, 0.9)):
        scene = pair(turning(spin, LOW, place), turning(spin, UP, place))
        assert not [r for r in discretise(latin_fmu.scene_from_dict(scene)).remarks if "the jump is lost" in r]
        skew = [[0.0, -spin[2], spin[1]], [spin[2], 0.0, -spin[0]], [-spin[1], spin[0], 0.0]]
        for body in scene["substructure"].values():
            del body["initial_spin"]
            body["initial_velocity_gradient"] = skew
        assert not [r for r in discretise(latin_fmu.scene_from_dict(scene)).remarks if "the jump is lost" in r]


def test_a_displaced_pair_of_round_off_is_not_torn():
    """Stretched about the bonded faces: their own displacement is round-off."""
    grown = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1e-4]]
    ends = ({"initial_displacement_gradient": grown, "initial_displacement": [0.0, 0.0, d]} for d in (-2.5e-6, 2.5e-6))
    scene = pair(*ends)
    discretise(latin_fmu.scene_from_dict(scene))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"initial_spin": [0.0, 0.0, 1.0]}, {}),
        ({"initial_velocity": [0.0, 0.0, 1.0]}, {}),
        ({"initial_velocity": [0.0, 0.0, 1.0]}, {"initial_velocity": [0.0, 0.0, 1.0 + 1e-6]}),
        (turning((1.0, 0.0, 0.0), LOW, LOW), turning((1.0, 0.0, 0.0), UP, UP)),
    ],
)
def test_bonded_sides_with_other_velocities_lose_the_jump(first, second):
    remarks = discretise(latin_fmu.scene_from_dict(pair(first, second))).remarks
    assert len([r for r in remarks if "interface bond: bonded sides start with different velocities" in r]) == 1


def test_a_body_bonded_to_ground_starts_as_fast_as_it():
    moving = {"direction": [1.0, 0.0, 0.0], "amplitude": 2.0, "law": {"type": "constant"}}
    for speed, lost in ((2.0, 0), (1.0, 1)):
        scene = pair({"initial_velocity": [speed, 0.0, 0.0]}, {"initial_velocity": [speed, 0.0, 0.0]})
        base = {"sides": ["low.zmin", "ground"], "behaviour": "perfect", "ground_velocity": moving}
        scene["interface"]["base"] = base
        remarks = discretise(latin_fmu.scene_from_dict(scene)).remarks
        assert len([r for r in remarks if "the jump is lost" in r]) == lost
