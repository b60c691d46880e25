"""Values with units in a scene: every key that has a unit, in all systems, by all ways into a scene."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from pydantic import BaseModel, ValidationError

import latin_fmu
from latin_fmu import tables
from latin_fmu.calibration.study import parameters_of as fitted_parameters
from latin_fmu.errors import InputError, SceneError
from latin_fmu.parametric.point import in_scene_units as in_units_of
from latin_fmu.parametric.point import parameters_of
from latin_fmu.scene.describe import is_named, kind_of, tables_in, tag_of, unit_of
from latin_fmu.scene.overrides import text_with_numbers
from latin_fmu.scene.reference import reference_schema
from latin_fmu.scene.schema import NAMED, Scene
from latin_fmu.scene.unit_texts import QUANTITIES
from latin_fmu.scene.unit_values import in_scene_units
from latin_fmu.scene.units import UNIT_SYSTEMS

from .test_unit_texts import by_pint

TEXT = 1.5
"""Number of all texts."""


def keys() -> Iterator[tuple[tuple[Any, ...], type[BaseModel], str]]:
    """Path of every key whose numbers have a unit, with types of tables in it as {type: ...}; its table; its name."""
    waiting: list[tuple[tuple[Any, ...], type[BaseModel]]] = [((), Scene)]
    seen: set[type[BaseModel]] = set()
    while waiting:
        path, table = waiting.pop(0)
        if table in seen:
            continue
        seen.add(table)
        here = (*path, {"type": tag_of(table)}) if tag_of(table) is not None else path
        for name, field in table.model_fields.items():
            kind = kind_of(field)
            if re.search("number", kind) and "string" not in kind and not tables_in(field.annotation):
                yield (*here, name), table, name
            for inner in tables_in(field.annotation):
                # ends of springs are a list of tables
                several = "list" in kind and not is_named(field)
                step = (name, "NAME") if is_named(field) else (name, 0) if several else (name,)
                waiting.append(((*here, *step), inner))


CASES = list(keys())


def nested(path: tuple[Any, ...], value: Any) -> Any:
    """A scene with a value at a path."""
    if not path:
        return value
    first, rest = path[0], path[1:]
    if isinstance(first, dict):
        return first | nested(rest, value)
    return [nested(rest, value)] if first == 0 else {first: nested(rest, value)}


def shaped(kind: str, text: Any) -> Any:
    """A value of a kind with a text in each of its places."""
    if "lists of" in kind:
        return [[text] * 3] * 3
    return [text] * 3 if "list of" in kind else text


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from leaves(item, (*path, key)) if key != "type" else ()
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from leaves(item, (*path, i))
    else:
        yield path, value


def unit_at(table: type[BaseModel], key: str, place: tuple[Any, ...]) -> str:
    """Unit of a number of a key, written down here once more for those whose items differ."""
    if key == "coefficients":
        return {1: "m", 0: "1", -1: "m-1", -2: "m-2", -3: "m-3"}[1 - place[-1] - place[-2]]
    return str(unit_of(table.model_fields[key]))


def test_all_keys_with_units_are_found() -> None:
    """Beside spread, whose numbers have the units of others, and names of units and columns."""
    found = {f"{table.__name__}.{name}" for _, table, name in CASES}
    assert len(found) > 100
    assert {"Load.force", "MeshFile.scale", "OperatorFolder.limit", "End.point", "Gravity.acceleration"} <= found
    units = {unit_of(table.model_fields[name]) for _, table, name in CASES}
    assert units <= QUANTITIES.keys()
    assert len(units) == 23


@pytest.fixture(scope="module")
def registry() -> Any:
    pint = pytest.importorskip("pint")
    return pint.UnitRegistry()


@pytest.mark.parametrize("system", ["SI", "mm-t-s-MPa", "in-lbf-s-psi"])
@pytest.mark.parametrize(("path", "table", "name"), CASES, ids=lambda v: v.__name__ if isinstance(v, type) else None)
def test_a_text_is_the_number_in_the_units_of_the_scene(
    registry: Any, path: tuple[Any, ...], table: type[BaseModel], name: str, system: str
) -> None:
    """Sizes by pint, both those of the texts and those of the system."""
    field, units = table.model_fields[name], UNIT_SYSTEMS[system]
    unit = str(unit_of(field))
    for word in QUANTITIES[unit].names if name != "coefficients" else ("m",):
        raw = nested(path, shaped(kind_of(field), f"{TEXT} {word}"))
        made, misfits = in_scene_units(Scene, raw, units)
        places = [(place, value) for place, value in leaves(made) if value not in ("hht",)]
        assert places
        if name != "coefficients":
            assert misfits == []
        for place, value in places:
            own = unit_at(table, name, place)
            if own != unit:  # a coefficient of another power
                assert isinstance(value, str)
                continue
            # in "1.5 lbf s2/in" the unit of the system has to be divided by itself
            expected = TEXT * by_pint(registry, word, unit) / by_pint(registry, units.label(unit), unit)
            assert value == pytest.approx(expected, rel=1e-9), (word, place)


@pytest.mark.parametrize("system", ["SI", "mm-t-s-MPa", "in-lbf-s-psi", "none"])
@pytest.mark.parametrize(("path", "table", "name"), CASES, ids=lambda v: v.__name__ if isinstance(v, type) else None)
def test_a_wrong_text_is_refused_with_what_is_right(
    path: tuple[Any, ...], table: type[BaseModel], name: str, system: str
) -> None:
    field = table.model_fields[name]
    unit = str(unit_of(field))
    wrong = "kN" if unit != "N" else "mm"
    for text, part in (
        (f"1 {wrong}", f"but the key takes {QUANTITIES[unit].words}"),
        (f"5,5 {QUANTITIES[unit].names[0]}", "no number with a unit"),
        ("1 furlong", "unknown unit 'furlong'"),
        ("7", "a text without a unit"),
    ):
        raw = nested(path, shaped(kind_of(field), text))
        made, misfits = in_scene_units(Scene, raw, UNIT_SYSTEMS[system])
        assert made is raw
        assert len(misfits) == len(list(leaves(raw)))
        expected = "the numbers of the scene have no units" if system == "none" and "," not in text else part
        assert expected in misfits[0].what, text
        assert (misfits[0].allowed is None) == (system == "none")
        assert system == "none" or QUANTITIES[unit].names[0] in str(misfits[0].allowed)


def test_g_is_what_the_key_takes() -> None:
    made, misfits = in_scene_units(
        Scene,
        {"gravity": {"acceleration": [0.0, 0.0, "-1 g"]}, "point_mass": {"m": {"mass": "100 g"}}},
        UNIT_SYSTEMS["mm-t-s-MPa"],
    )
    assert not misfits
    assert made["gravity"]["acceleration"] == [0.0, 0.0, -9806.65]
    assert made["point_mass"]["m"]["mass"] == 1e-4
    _, (misfit,) = in_scene_units(Scene, {"load": {"p": {"force": ["1 g", 0, 0]}}}, UNIT_SYSTEMS["SI"])
    assert "an acceleration or a mass, but the key takes a force" in misfit.what


def test_items_of_a_key_have_units_of_their_own() -> None:
    form = {"type": "polynomial", "coefficients": [["1 um", "2 mm/m", "3 1/m"], ["4 um/mm"], ["5 1/mm"]]}
    made, misfits = in_scene_units(Scene, {"interface": {"i": {"form": form}}}, UNIT_SYSTEMS["mm-t-s-MPa"])
    assert not misfits
    assert made["interface"]["i"]["form"]["coefficients"] == [[1e-3, 2e-3, 3e-3], [4e-3], [5.0]]
    port = {"components": ["z", "rx"], "impedance": ["2 N s/mm", "3 N mm s"]}
    made, misfits = in_scene_units(Scene, {"port": {"p": port}}, UNIT_SYSTEMS["SI"])
    assert not misfits
    assert made["port"]["p"]["impedance"] == [2000.0, 3e-3]


# -- whole scenes ----------------------------------------------------------------------------------------------
WITH_UNITS = """\
name = "cube"
units = "SYSTEM"

[material.steel]
young_modulus = "210 GPa"
poisson_ratio = 0.3
density = "7.8 g/cm3"

[substructure.cube]
material = "steel"
box = {size = ["2 cm", "20 mm", "0.02 m"], elements = [2, 2, 2]}

[boundary.base]
type = "displacement"
face = "cube.zmin"
components = ["x", "y", "z"]
value = [0, 0, "1 um"]
law = {type = "half_sine", duration = "40 us"}

[load.push]
face = "cube.zmax"
force = [0, 0, "-2 kN"] # downwards
law = {type = "half_sine", duration = "20 us"}

[sensor.top]
substructure = "cube"
point = ["10 mm", "10 mm", "20 mm"]

[point_mass.lid]
face = "cube.zmax"
mass = "100 g"

[time]
end = "40 us"
step = "0.5 us"

[spread]
load.push.force.2 = "100 N"
"material.steel.young_modulus" = ["200 GPa", "220 GPa"]
point_mass.lid.mass = "5 %"
"""


def written(folder: Path, system: str = "SI", text: str = WITH_UNITS) -> Path:
    file = folder / "scene.toml"
    file.write_text(text.replace("SYSTEM", system))
    return file


def test_a_scene_in_mm_has_the_same_answer(tmp_path: Path) -> None:
    """The same texts in three systems: the same motion, to round-off, in the units of each."""
    peaks = {}
    for system in ("SI", "mm-t-s-MPa", "in-lbf-s-psi"):
        scene = latin_fmu.load_scene(written(tmp_path, system), ["spread={}"])
        solution = latin_fmu.solve(scene)
        peaks[system] = abs(solution.sensors["top"].velocity[:, 2]).max() * UNIT_SYSTEMS[system].size("m s-1")
    assert peaks["SI"] > 1e-3
    assert peaks["mm-t-s-MPa"] == pytest.approx(peaks["SI"], rel=1e-9)
    assert peaks["in-lbf-s-psi"] == pytest.approx(peaks["SI"], rel=1e-9)


def test_a_body_without_interfaces_has_bands(tmp_path: Path) -> None:
    """The motion is in proportion to the force, of which "100 N" are 5 %."""
    settings = ["boundary.base.value.2=0", "spread={}", "spread.load.push.force.2=100 N"]
    solution = latin_fmu.solve(latin_fmu.load_scene(written(tmp_path, "mm-t-s-MPa"), settings))
    assert solution.bands is not None
    band = solution.bands.bands["/spread/sensors/top"]["velocity"]
    size = abs(solution.bands.histories["/spread/sensors/top"].variables["velocity"].values)
    assert size.max() > 0.0
    np.testing.assert_allclose(band.deviation, 0.05 * size, atol=1e-7 * size.max())


def test_numbers_are_those_that_are_written_by_hand(tmp_path: Path) -> None:
    scene = latin_fmu.load_scene(written(tmp_path))
    assert scene.load["push"].force == (0.0, 0.0, -2000.0)
    assert scene.time.step == 0.5e-6
    assert scene.time.n_step == 80
    assert scene.boundary["base"].value == (0.0, 0.0, 1e-6)  # type: ignore[union-attr]
    assert scene.spread == {
        "load.push.force.2": 100.0,
        "material.steel.young_modulus": (200e9, 220e9),
        "point_mass.lid.mass": "5 %",
    }
    # the effective scene has numbers alone, and is read back as the same scene
    assert latin_fmu.scene_from_dict(scene.tables(), scene.base_dir) == scene


def test_settings_and_parameters_have_units(tmp_path: Path) -> None:
    file = written(tmp_path, "mm-t-s-MPa")
    scene = latin_fmu.load_scene(file, ["load.push.force.2=-3 kN", "spread={}", 'time.end="20 us"'])
    assert (scene.load["push"].force, scene.time.end) == ((0.0, 0.0, -3000.0), 2e-5)
    assert scene.replace("point_mass.lid.mass", "1 kg").point_mass["lid"].mass == 1e-3
    for text, values in {
        "sensor.top.point.2=1cm:20mm:3": (10.0, 15.0, 20.0),
        "boundary.base.value.2=1 um,2e-3": (1e-3, 2e-3),
        'load.push.force=["1 N",0,0],[0,"1 kN",0]': ([1.0, 0, 0], [0, 1000.0, 0]),
    }.items():
        (parameter,) = in_units_of(parameters_of([text]), scene.tables())
        assert parameter.values == values
    (parameter,) = in_units_of(parameters_of({"load.push.force.2": ["1 kN", "2 kN"]}), scene.tables())
    assert parameter.values == (1000.0, 2000.0)
    with pytest.raises(InputError, match="a length, but the key takes a force"):
        in_units_of(parameters_of(["load.push.force.2=1 mm:2 mm:2"]), scene.tables())
    with pytest.raises(InputError, match="the value is given twice"):
        in_units_of(parameters_of(["load.push.force.2=1 kN,1000 N"]), scene.tables())
    with pytest.raises(InputError, match="two values with units of the same kind"):
        parameters_of(["load.push.force.2=1 kN:2:3"])
    (fit,) = fitted_parameters(["point_mass.lid.mass=0.1 kg:50 g:200 g"], scene)
    assert (fit.start, fit.low, fit.high) == (1e-4, 5e-5, 2e-4)
    with pytest.raises(InputError, match="a force, but the key takes a mass"):
        fitted_parameters(["point_mass.lid.mass=1 N"], scene)


def test_a_study_has_numbers_on_its_axis(tmp_path: Path) -> None:
    study = latin_fmu.sweep(
        written(tmp_path), ["load.push.force.2=-1 kN:-2000 N:2"], settings=["spread={}", "time.end=5 us"]
    )
    assert study["load_push_force_2"].values.tolist() == [-1000.0, -2000.0]
    assert study["load_push_force_2"].attrs["units"] == "N"


def test_a_fitted_number_takes_the_place_of_a_text(tmp_path: Path) -> None:
    made = text_with_numbers(written(tmp_path).read_text(), {"point_mass.lid.mass": 0.125}, NAMED)
    assert made is not None
    assert "\nmass = 0.125\n" in made
    assert latin_fmu.load_scene(written(tmp_path, text=made)).point_mass["lid"].mass == 0.125


def test_tables_in_python_have_units_of_the_scene_that_they_get_into() -> None:
    push = tables.Load(face="cube.zmax", force=(0, 0, "1 kN"), law=tables.HalfSineLaw(duration="6 ms"))  # type: ignore[arg-type]
    assert (push.force, push.law.duration) == ((0.0, 0.0, 1000.0), 6e-3)  # type: ignore[union-attr]
    steel = tables.Material(young_modulus="210 GPa", poisson_ratio=0.3, density="7.8 g/cm3")  # type: ignore[arg-type]
    cube = tables.Substructure(material="steel", box=tables.Box(size=["2 cm"] * 3, elements=(2, 2, 2)))  # type: ignore[arg-type]
    for system, size, density in (("SI", 0.02, 7800.0), ("mm-t-s-MPa", 20.0, 7.8e-9)):
        scene = latin_fmu.Scene(
            name="cube",
            units=system,  # type: ignore[arg-type]
            material={"steel": steel},
            substructure={"cube": cube},
            load={"push": push},
            time=tables.Time(end="40 us", step="0.5 us"),  # type: ignore[arg-type]
        )
        assert scene.substructure["cube"].box.size == (size,) * 3  # type: ignore[union-attr]
        assert scene.material["steel"].density == density
        assert scene.load["push"].force == (0.0, 0.0, 1000.0)
        assert scene.time.n_step == 80
    with pytest.raises(ValidationError, match="a length, but the key takes a force"):
        tables.Load(face="cube.zmax", force=(0, 0, "1 mm"))  # type: ignore[arg-type]


def test_all_wrong_texts_are_said_at_once_with_their_lines(tmp_path: Path) -> None:
    text = WITH_UNITS.replace('"-2 kN"', '"-2 mm"').replace('end = "40 us"', 'end = "40,5 us"').replace("100 N", "1 s")
    with pytest.raises(SceneError) as caught:
        latin_fmu.load_scene(written(tmp_path, text=text))
    message = str(caught.value)
    assert "3 problems" in message
    assert "load.push.force[2]: a length, but the key takes a force (value: '-2 mm')" in message
    assert "time.end: no number with a unit (value: '40,5 us')" in message
    assert "decimal point" in message
    assert "spread.load.push.force.2: a time, but the key takes a force" in message
    assert "(line 22)" in message


def test_a_scene_of_pure_numbers_takes_no_texts(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="the numbers of the scene have no units"):
        latin_fmu.load_scene(written(tmp_path, "none"))


def test_words_that_are_no_values_stay_those_of_the_key() -> None:
    raw = {"interface": {"i": {"gap": "closed"}}, "load": {"p": {"pressure": "high"}}}
    assert in_scene_units(Scene, raw, UNIT_SYSTEMS["SI"]) == (raw, [])
    made, _ = in_scene_units(Scene, {"interface": {"i": {"gap": "20 um"}}}, UNIT_SYSTEMS["SI"])
    assert made["interface"]["i"]["gap"] == 20e-6


def test_the_json_schema_takes_them(tmp_path: Path) -> None:
    schema = json.loads(json.dumps(reference_schema()))
    right = tomllib.loads(written(tmp_path).read_text()) | {"spread": {"load.push.force.2": ["1 N", 2.0]}}
    jsonschema.validate(right, schema)
    for path, value in ((("time", "end"), "soon"), (("load", "push", "force"), [0, 0, "2"])):
        wrong = copy.deepcopy(right)
        here: Any = wrong
        for part in path[:-1]:
            here = here[part]
        here[path[-1]] = value
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, schema)
