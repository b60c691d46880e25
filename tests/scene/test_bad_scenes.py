"""Every mistake is named: path in the file, what is wrong, the value, what is allowed, the likely name."""

from __future__ import annotations

import math
from typing import Any

import pytest

from latin_fmu.errors import SceneError
from latin_fmu.reader import scene_from_dict

GONE = object()
ORTHOTROPIC = {"young_moduli": [25e9, 10e9, 10e9], "poisson_ratios": [0.3, 0.3, 0.3], "shear_moduli": [4e9, 4e9, 3e9]}
TABLE = {"type": "table"}
DRIVEN = {"type": "velocity", "face": "left.zmin", "components": ["z"]}
PERIODIC = {"type": "periodic"}

# path to change, new value (GONE removes), where the problem is reported, parts of the message
CASES: list[tuple[str, Any, str, list[str]]] = [
    # fields
    ("name", GONE, "name", ["missing"]),
    ("name", "two bars", "name", ["not a valid name", "two bars", "underscores"]),
    ("name", 3, "name", ["must be a string", "3"]),
    ("description", "\ud800", "description", ["not valid text"]),
    ("materials", {}, "materials", ["unknown key", "did you mean 'material'"]),
    ("a.b", 1, "a", ["unknown key", "{'b': 1}"]),
    ("loads", {f"press{i}": {"face": "bar.zmax", "pressure": 1.0} for i in range(9)}, "loads", ["a table with 9 keys"]),
    ("material", {}, "material", ["at least one"]),
    ("material", [], "material", ["must be a table"]),
    ("substructure", GONE, "substructure", ["missing"]),
    ("substructure", {}, "substructure", ["at least one"]),
    ("substructure.ground", {}, "substructure.ground", ["reserved"]),
    ("material.2nd", {}, "material.2nd", ["not a valid name", "letter"]),
    ("material.steel", 3, "material.steel", ["must be a table", "3"]),
    ("material.steel.young_modulus", GONE, "material.steel.young_modulus", ["missing", "> 0", "[Pa]"]),
    ("material.steel.young_modulu", 1, "material.steel.young_modulu", ["unknown key", "did you mean 'young_modulus'"]),
    ("material.steel.young_modulus", -1.0, "material.steel.young_modulus", ["out of range", "-1.0", "> 0", "[Pa]"]),
    ("material.steel.young_modulus", "210e9", "material.steel.young_modulus", ["a text without a unit", "'210e9'"]),
    ("material.steel.young_modulus", True, "material.steel.young_modulus", ["must be a number", "true"]),
    ("material.steel.young_modulus", math.nan, "material.steel.young_modulus", ["finite", "nan"]),
    ("material.steel.young_modulus", 10**400, "material.steel.young_modulus", ["number out of range"]),
    ("material.steel.young_modulus", 10**5000, "material.steel.young_modulus", ["too large"]),
    ("material.steel.density", 0, "material.steel.density", ["out of range", "> 0", "kg m-3"]),
    ("material.steel.poisson_ratio", GONE, "material.steel.poisson_ratio", ["missing", "< 0.5", "orthotropic"]),
    ("material.steel.orthotropic", ORTHOTROPIC, "material.steel.young_modulus", ["orthotropic material", "leave out"]),
    (
        "material.steel",
        {"density": 1.0, "orthotropic": {**ORTHOTROPIC, "poisson_ratios": [1.6, 0.3, 0.3]}},
        "material.steel.orthotropic",
        ["not positive definite", "|nu_12| < 1.581", "nu_ji is nu_ij E_j / E_i"],
    ),
    (
        "material.steel",
        {"density": 1.0, "orthotropic": {**ORTHOTROPIC, "poisson_ratios": [1.0, 0.9, 0.9]}},
        "material.steel.orthotropic",
        ["not positive definite", "> 0 (here -"],
    ),
    (
        "material.steel",
        {"density": 1.0, "orthotropic": {**ORTHOTROPIC, "axes": {"x": [1.0, 0.0, 0.0], "y": [-2.0, 0.0, 0.0]}}},
        "material.steel.orthotropic.axes",
        ["parallel"],
    ),
    ("material.steel.poisson_ratio", 0.5, "material.steel.poisson_ratio", ["out of range", "> -1, < 0.5"]),
    ("substructure.left.box.size", [1.0, 2.0], "substructure.left.box.size", ["too few", "3 numbers", "[m]"]),
    ("substructure.left.box.size", [1.0, 2.0, 3.0, 4.0], "substructure.left.box.size", ["too many"]),
    ("substructure.left.box.size", 1.0, "substructure.left.box.size", ["must be a list"]),
    ("substructure.left.box.size", [1.0, 2.0, 0.0], "substructure.left.box.size[2]", ["out of range", "> 0"]),
    ("substructure.left.box.elements", [1, 1, 0], "substructure.left.box.elements[2]", ["out of range", ">= 1"]),
    ("substructure.left.box.elements", [1, 1, 2.5], "substructure.left.box.elements[2]", ["integer", "2.5"]),
    ("substructure.left.box.elements", [10**4] * 3, "substructure.left.box.elements", ["too many elements"]),
    ("substructure.left.box.size", [1e-70, 1e-70, 1e-70], "substructure.left.box", ["lengths out of range", "1e-60"]),
    ("substructure.left.box.origin", [0.0, 0.0, -1e200], "substructure.left.box", ["lengths out of range", "1e+60"]),
    ("substructure.left.box.size", [0.1, 0.1, 1e-50], "substructure.left.box", ["elements are too flat", "1e+06"]),
    ("substructure.left.initial_velocity", [0, math.inf, 0], "substructure.left.initial_velocity[1]", ["finite"]),
    ("load.push.force", [0.0, 0.0, 1.0], "load.push", ["both 'pressure' and 'force'"]),
    ("load.push.axes", {"x": [1, 0, 0], "y": [2, 0, 0]}, "load.push.axes", ["x and y are parallel"]),
    ("load.push.axes", {"x": [1, 0, 0], "y": [0, 1, 0]}, "load.push.axes", ["a pressure acts along the normal"]),
    (
        "load.push.law",
        {"type": "csv", "file": "a.csv", "times": [0, 1], "values": [0, 1], "value_unit": "kN"},
        "load.push.law.value_unit",
        ["a force, but the law multiplies a pressure", "'kN'", "MPa"],
    ),
    (
        "temperature.day",
        {"change": 5.0},
        "material.steel.thermal_expansion",
        ["no coefficient of expansion", "number [K-1]"],
    ),
    (
        "temperature.day",
        {"change": 5.0, "substructures": ["lefd"]},
        "temperature.day.substructures[0]",
        ["did you mean 'left'"],
    ),
    (
        "temperature.day",
        {"change": 5.0, "substructures": ["*", "left"]},
        "temperature.day.substructures",
        ['"*" stands alone'],
    ),
    ("temperature.day", {"change": 5.0, "law": "input"}, "temperature.day.law", ["cannot be an input", "table"]),
    ("temperature.day", {"change": 5.0, "substructures": ["left", 3]}, "temperature.day.substructures[1]", ["string"]),
    ("temperature.day", {"change": math.nan}, "temperature.day.change", ["finite"]),
    ("gravity.acceleration", [0.0, -9.81], "gravity.acceleration", ["too few", "3 numbers", "[m s-2]"]),
    ("gravity", {"accelaration": [0.0, 0.0, -9.81]}, "gravity.accelaration", ["did you mean 'acceleration'"]),
    ("substructure.left.body_force_law", "ramp", "substructure.left.body_force_law.type", ["unknown type"]),
    ("interface.meet.friction_coefficient", -0.1, "interface.meet.friction_coefficient", ["out of range", ">= 0"]),
    ("interface.meet.gap", -1e-6, "interface.meet.gap", ["out of range", ">= 0", "[m]"]),
    ("interface.meet.gap", "shut", "interface.meet.gap", ["not a gap", "measured", "closed"]),
    ("interface.meet.points_from", "e", "interface.meet.points_from", ["unknown value", "Ep"]),
    ("interface.meet.search", 0.0, "interface.meet.search", ["out of range", "> 0"]),
    (
        "interface.meet.ground",
        {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
        "interface.meet.ground",
        ["no ground on this interface"],
    ),
    (
        "interface.meet.behaviour",
        "contct",
        "interface.meet.behaviour",
        ["contact, elastic_layer, maxwell_joint, no_slip, perfect", "did you mean 'contact'"],
    ),
    ("interface.meet.behaviour", 1, "interface.meet.behaviour", ["must be a string"]),
    ("interface.meet.sides", GONE, "interface.meet.sides", ["missing"]),
    ("interface.meet.sides", ["left.zmax"], "interface.meet.sides", ["too few"]),
    ("interface.meet.sides", "left.zmax", "interface.meet.sides", ["must be a list"]),
    ("interface.meet.sides", ["left.zmax", "right"], "interface.meet.sides[1]", ["not a valid side", "ground"]),
    ("output.fields", 1, "output.fields", ["true or false"]),
    ("output.every", 0, "output.every", ["out of range", ">= 1"]),
    ("solver.max_iterations", 10**18, "solver.max_iterations", ["out of range", ">= 1, <= 100000"]),
    ("solver.tolerance", 0.0, "solver.tolerance", ["out of range", "> 0"]),
    ("solver.relaxation", 1.5, "solver.relaxation", ["out of range", "<= 1"]),
    ("solver.window", "all", "solver.window", ["not a window", '"whole"']),
    ("solver.window", "hole", "solver.window", ["did you mean 'whole'"]),
    ("solver.window", True, "solver.window", ["not a window", "true"]),
    ("solver.start", "zeros", "solver.start", ["sequential, zero", "did you mean 'zero'"]),
    # tables chosen by their type
    ("load.push.law.type", "half_sin", "load.push.law.type", ["unknown type", "step", "did you mean 'half_sine'"]),
    ("load.push.law", "ramp", "load.push.law.type", ["unknown type", "'ramp'", "rectangular_pulse"]),
    ("load.push.law.type", GONE, "load.push.law.type", ["type is missing", "half_sine"]),
    ("load.push.law.duration", GONE, "load.push.law.duration", ["missing", "> 0", "[s]"]),
    ("load.push.law.durations", 1.0, "load.push.law.durations", ["unknown key", "did you mean 'duration'"]),
    ("load.push.law", 3, "load.push.law", ["must be a table"]),
    ("load.push.law", [1], "load.push.law", ["must be a table"]),
    ("load.push.law.type", ["step"], "load.push.law.type", ["unknown type"]),
    ("boundary.held.type", "fixd", "boundary.held.type", ["periodic", "did you mean 'fixed'"]),
    ("boundary.held.type", GONE, "boundary.held.type", ["type is missing"]),
    ("boundary.held.value", [1.0], "boundary.held.value", ["unknown key", "components"]),
    ("boundary.held.components", ["x", "w"], "boundary.held.components[1]", ["'w'", "x, y, z"]),
    ("boundary.held.components", ["x", "x"], "boundary.held.components", ["different axes"]),
    ("boundary.held.components", [], "boundary.held.components", ["different axes"]),
    ("time.scheme", "hhtt", "time.scheme.type", ["hht, newmark", "did you mean 'hht'"]),
    ("time.scheme", {"alpha": 0.1}, "time.scheme.alpha", ["out of range", "<= 0"]),
    ("solver.search_direction", "uniform", "solver.search_direction.normal", ["missing", "Pa s m-1"]),
    ("solver.search_direction", {"factor": 0}, "solver.search_direction.factor", ["out of range"]),
    ("solver.acceleration", {"depth": 0}, "solver.acceleration.depth", ["out of range", ">= 1"]),
    ("solver.acceleration", "andersen", "solver.acceleration.type", ["did you mean 'anderson'"]),
    # laws
    ("load.push.law", TABLE, "load.push.law.times", ["missing"]),
    ("load.push.law", {**TABLE, "times": [0, 1], "values": [0]}, "load.push.law", ["2 times, 1 values"]),
    ("load.push.law", {**TABLE, "times": [0], "values": [0]}, "load.push.law", ["two points"]),
    (
        "load.push.law",
        {**TABLE, "times": [0, 1, 1], "values": [0, 1, 2]},
        "load.push.law",
        ["times[2] = 1.0 after 1.0"],
    ),
    ("load.push.law", {**TABLE, "times": [0, math.nan], "values": [0, 1]}, "load.push.law.times[1]", ["finite"]),
    ("load.push.law", {"type": "csv", "file": "none.csv"}, "load.push.law", ["does not exist", "relative to"]),
    # alternatives
    ("load.push.pressure", GONE, "load.push", ["neither", "'pressure'", "'traction'"]),
    ("load.push.traction", [0, 0, 1], "load.push", ["both"]),
    ("substructure.left.box", GONE, "substructure.left", ["neither", "'box'", "'mesh'"]),
    ("substructure.left.mesh", {"file": "a.msh"}, "substructure.left", ["both"]),
    ("time.step", GONE, "time", ["neither", "'step'", "'instants'"]),
    ("time.instants", 10, "time", ["both"]),
    # names between tables
    ("substructure.left.material", "steal", "substructure.left.material", ["'steal'", "did you mean 'steel'"]),
    ("interface.meet.sides", ["lft.zmax", "right.zmin"], "interface.meet.sides[0]", ["did you mean 'left.zmax'"]),
    ("interface.meet.sides", ["left.top", "right.zmin"], "interface.meet.sides[0]", ["no face", "zmax"]),
    ("interface.meet.sides", ["left.zmaxx", "right.zmin"], "interface.meet.sides[0]", ["did you mean 'zmax'"]),
    ("interface.meet.sides", ["ground", "right.zmin"], "interface.meet.sides[0]", ["ground", "second"]),
    ("interface.meet.sides", ["ground", "ground"], "interface.meet.sides[0]", ["cannot be the ground"]),
    ("interface.meet.sides", ["left.zmax", "left.zmax"], "interface.meet.sides", ["cannot meet itself"]),
    ("load.push.face", "left.end", "load.push.face", ["no face", "zmin"]),
    ("boundary.held.face", "rigth.zmax", "boundary.held.face", ["did you mean 'right.zmax'"]),
    ("substructure.left.mesh", {"file": "no.msh"}, "substructure.left.mesh.file", ["no such file", "no.msh"]),
    # contradictions
    ("interface.meet.behaviour", "perfect", "interface.meet.friction_coefficient", ["perfect", "remove it"]),
    (
        "interface.open",
        {"sides": ["left.zmax", "right.zmin"], "gap": 1, "preload": 2},
        "interface.open.preload",
        ["gap = 1"],
    ),
    (
        "interface.meet.ground_velocity",
        {"direction": [0, 0, 1], "amplitude": 1},
        "interface.meet.ground_velocity",
        ["no ground"],
    ),
    (
        "interface.wall",
        {"sides": ["left.zmin", "ground"], "ground_velocity": {"direction": [0, 0, 0], "amplitude": 1}},
        "interface.wall.ground_velocity.direction",
        ["cannot be zero"],
    ),
    ("boundary.driven", {**DRIVEN, "value": [1, 2]}, "boundary.driven.value", ["one number per component"]),
    (
        "boundary.twice",
        {**DRIVEN, "face": "right.zmax", "value": [1]},
        "boundary.twice",
        ["z on 'right.zmax'", "'held'"],
    ),
    ("boundary.twice", {"type": "symmetry", "face": "right.zmax"}, "boundary.twice", ["z on", "'held'"]),
    ("boundary.pair", {**PERIODIC, "faces": ["left.xmin", "left.xmin"]}, "boundary.pair.faces", ["two different"]),
    ("boundary.pair", {**PERIODIC, "faces": ["left.xmin", "right.xmax"]}, "boundary.pair.faces", ["one substructure"]),
    ("boundary.pair", {**PERIODIC, "faces": ["left.xmin", "left.ymax"]}, "boundary.pair.faces", ["opposite", "xmin"]),
    ("boundary.pair", {**PERIODIC, "faces": ["left.xmin", "left.zz"]}, "boundary.pair.faces[1]", ["no face"]),
    ("boundary.pair", {**PERIODIC, "face": "left.xmin"}, "boundary.pair.faces", ["missing"]),
    # time
    ("time.end", 1.05e-5, "time.end", ["not an integer number of steps", "nearest: end = 1e-05", "instants = 1"]),
    ("time.end", 1e-7, "time.end", ["nearest: end = 1e-05"]),
    ("time.step", 1e-300, "time.step", ["more than 10000000 steps"]),
    ("time", {"end": 1.0, "instants": 10**8}, "time.instants", ["out of range", "10000000"]),
    ("time", {"end": 5e-324, "instants": 100}, "time.end", ["step length out of range", "1e-60 to 1e+60 s"]),
    ("time", {"end": 1e-200, "instants": 3}, "time.end", ["step length out of range"]),
    ("time", {"end": 3e-200, "step": 1e-200}, "time.step", ["step length out of range"]),
    ("time", {"end": 1e200, "instants": 3}, "time.end", ["step length out of range"]),
    ("time", 3, "time", ["must be a table"]),
]


def change(data: dict[str, Any], path: str, value: object) -> None:
    """Set or remove one item of a nested dictionary."""
    *tables, last = path.split(".")
    for key in tables:
        data = data.setdefault(key, {})
    if value is GONE:
        del data[last]
    else:
        data[last] = value


@pytest.mark.parametrize(
    ("path", "value", "where", "parts"), CASES, ids=[f"{i}-{case[2]}" for i, case in enumerate(CASES)]
)
def test_mistake_is_named(small: dict[str, Any], path: str, value: object, where: str, parts: list[str]) -> None:
    change(small, path, value)
    with pytest.raises(SceneError) as caught:
        scene_from_dict(small)
    at_place = [str(problem) for problem in caught.value.problems if problem.where == where]
    assert at_place, f"nothing reported at {where}: {caught.value}"
    assert any(all(part in text for part in parts) for text in at_place), at_place


def test_small_scene_is_valid(small: dict[str, Any]) -> None:
    assert scene_from_dict(small).name == "small"


def test_all_problems_in_one_message(small: dict[str, Any]) -> None:
    """Field errors hide no relation, one table no other."""
    wanted = {
        "material.steel.density": -1,
        "substructure.left.material": "brass",
        "interface.meet.sides": ["left.top", "nobody.zmin"],
        "interface.meet.gap": "wide",
        "load.push.traction": [0, 0, 1],
        "time.end": 1.05e-5,
        "solver.tolerances": 1,
    }
    for path, value in wanted.items():
        change(small, path, value)
    with pytest.raises(SceneError) as caught:
        scene_from_dict(small)
    places = [problem.where for problem in caught.value.problems]
    expected = [
        "material.steel.density",
        "interface.meet.gap",
        "solver.tolerances",
        "substructure.left.material",
        "interface.meet.sides[0]",
        "interface.meet.sides[1]",
        "load.push",
        "time.end",
    ]
    assert sorted(places) == sorted(expected)
    assert str(caught.value).startswith("the scene cannot be used: 8 problems")


def test_missing_materials_are_reported_once(small: dict[str, Any]) -> None:
    """A misspelt [material] table must not turn every use of it into another problem."""
    small["materials"] = small.pop("material")
    with pytest.raises(SceneError) as caught:
        scene_from_dict(small)
    assert [problem.where for problem in caught.value.problems] == ["material", "materials"]


@pytest.mark.parametrize("data", [None, 3, "scene", [], {1: 2}, {"name": {"a": {}}}])
def test_other_data_is_refused(data: object) -> None:
    with pytest.raises(SceneError):
        scene_from_dict(data)


def test_endless_nesting_is_refused(small: dict[str, Any]) -> None:
    deep: dict[str, Any] = {}
    for _ in range(100_000):
        deep = {"a": deep}
    loop: dict[str, Any] = {}
    loop["a"] = loop
    for value in (deep, loop):
        for path in ("extra", "load.push.law", "material.steel.density", "substructure.left.box"):
            change(small, path, value)
        with pytest.raises(SceneError):
            scene_from_dict(small)


@pytest.mark.parametrize("key", ["a.b", "a\nb", "x" * 10_000, "", "\x00", "é"])
def test_odd_names_are_shown_readably(small: dict[str, Any], key: str) -> None:
    small["material"][key] = small["material"]["steel"]
    with pytest.raises(SceneError) as caught:
        scene_from_dict(small)
    assert all(len(problem.where) < 120 and "\n" not in problem.where for problem in caught.value.problems)
