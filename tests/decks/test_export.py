"""Scenes as decks: brought back by the import they are the same scene, run by CalculiX 2.20 they have the same answer,
and what no card says is named or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.commands import BAD_INPUT, CONVERGED
from latin_fmu.decks.card_text import card, corners, field_text
from latin_fmu.decks.export_draft import DeckChoices
from latin_fmu.decks.export_keys import KEYS
from latin_fmu.decks.exporting import ExportedDeck, export_deck
from latin_fmu.decks.importing import import_deck
from latin_fmu.errors import InputError
from latin_fmu.scene.interfaces import Interface
from latin_fmu.scene.schema import Scene
from tests.scenes import MODELS
from tests.verification.bolted_meshes import write_joint
from tests.verification.test_bolts import joint

from .beside import displacements

STEEL = {"young_modulus": 210e3, "poisson_ratio": 0.3, "density": 7.8e-9}
RAMP = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
STATIC = {"end": 1.0, "instants": 2, "quasi_static": True}


def bar(**tables: Any) -> dict[str, Any]:
    """A bar of 10 x 10 x 40 mm held at its lower end, with a sensor at a corner of the upper one."""
    body = {"material": "steel", "box": {"size": [10.0, 10.0, 40.0], "elements": [2, 2, 4]}}
    return {
        "name": "bar",
        "units": "mm-t-s-MPa",
        "material": {"steel": dict(STEEL)},
        "substructure": {"bar": body},
        "boundary": {"hold": {"type": "fixed", "face": "bar.zmin"}},
        "sensor": {"tip": {"substructure": "bar", "point": [10.0, 10.0, 40.0]}},
        "time": dict(STATIC),
        **tables,
    }


def stack(interface: dict[str, Any], gap: float = 0.0, above: int = 3, **tables: Any) -> dict[str, Any]:
    """Two blocks of 10 mm on each other, the upper one with ``above`` elements across, the lower one with two."""
    boxes = {"low": (0.0, 10.0, [2, 2, 2]), "high": (10.0 + gap, 10.0, [above, above, 2])}
    bodies = {
        name: {"material": "steel", "box": {"origin": [0.0, 0.0, z], "size": [10.0, 10.0, high], "elements": elements}}
        for name, (z, high, elements) in boxes.items()
    }
    hold = {
        "floor": {"type": "fixed", "face": "low.zmin"},
        "side": {"type": "fixed", "face": "high.xmin", "components": ["x"]},
        "back": {"type": "fixed", "face": "high.ymin", "components": ["y"]},
    }
    press = {"press": {"face": "high.zmax", "pressure": 100.0, "law": RAMP}}
    data = bar(substructure=bodies, boundary=hold, load=press, interface={"lap": interface}, **tables)
    data["sensor"] = {"tip": {"substructure": "high", "point": [10.0, 10.0, 20.0 + gap]}}
    data["solver"] = {"tolerance": 1e-8}
    return data


def exported(data: dict[str, Any]) -> ExportedDeck:
    """The deck of a description."""
    return export_deck(latin_fmu.scene_from_dict(data))


def brought_back(scene: Scene, folder: Path) -> Scene:
    """The scene of its own deck, solved as accurately."""
    (folder / "there.inp").write_text(export_deck(scene).text)
    units = {"SI": "m", "mm-t-s-MPa": "mm-t-s"}[scene.units]
    found = import_deck(folder / "there.inp", folder, units)  # type: ignore[arg-type]
    tables = {**found.tables, "solver": {"tolerance": scene.solver.tolerance}}
    return latin_fmu.scene_from_dict(tables, folder)


def push(**more: Any) -> dict[str, Any]:
    """A load on the upper end of the bar."""
    return {"push": {"face": "bar.zmax", "law": RAMP, **more}}


ORTHOTROPIC = {
    "orthotropic": {
        "young_moduli": [60e3, 20e3, 10e3],
        "poisson_ratios": [0.2, 0.3, 0.25],
        "shear_moduli": [8e3, 6e3, 4e3],
        "axes": {"x": [1.0, 1.0, 0.0], "y": [-1.0, 1.0, 0.0]},
        "thermal_expansions": [1e-5, 2e-5, 3e-5],
    },
    "density": 2e-9,
}
PULSE = {"end": 20e-6, "instants": 20}
TURNED = {"x": [1.0, 1.0, 0.0], "y": [-1.0, 1.0, 0.0]}
SINE = {"type": "half_sine", "duration": 10e-6}
SCENES: dict[str, dict[str, Any]] = {
    "pressure": bar(load=push(pressure=7.0)),
    "traction": bar(load=push(traction=[3.0, 1.0, -2.0])),
    "force off the middle": bar(load=push(force=[30.0, 0.0, 5.0], point=[0.0, 0.0, 40.0])),
    "forces on nodes": bar(load=push(nodal_force=[1.0, 0.0, 2.0])),
    "gravity": bar(gravity={"acceleration": [0.0, 9810.0, 1.0], "law": RAMP}),
    "rotation": bar(rotation={"spin": {"angular_velocity": 3e3, "axis": [1, 1, 0], "point": [0, 9, 0], "law": RAMP}}),
    "a driven face": bar(
        boundary={
            "hold": {"type": "fixed", "face": "bar.zmin"},
            "drive": {
                "type": "displacement", "face": "bar.zmax", "components": ["x", "z"], "value": [0.1, -0.2], "law": RAMP,
            },
        }
    ),
    "axes of a support": bar(
        boundary={
            "hold": {"type": "fixed", "face": "bar.zmin"},
            "guide": {"type": "fixed", "face": "bar.zmax", "components": ["x"], "axes": TURNED},
        },
        gravity={"acceleration": [9810.0, 0.0, 0.0], "law": RAMP},
    ),
    "heat": bar(
        material={"steel": {**STEEL, "thermal_expansion": 1.2e-5}}, temperature={"hot": {"change": 100.0, "law": RAMP}}
    ),
    "an orthotropic material": bar(material={"steel": dict(ORTHOTROPIC)}, load=push(traction=[3.0, 1.0, -2.0])),
    "heat of an orthotropic material": bar(
        material={"steel": dict(ORTHOTROPIC)}, temperature={"hot": {"change": 100.0, "law": RAMP}}
    ),
    "bending modes": bar(
        substructure={
            "bar": {
                "material": "steel", "bending_modes": True, "box": {"size": [10.0, 10.0, 40.0], "elements": [2, 2, 4]},
            }
        },
        load=push(traction=[3.0, 0.0, 0.0]),
    ),
    "uniform strain": bar(
        substructure={
            "bar": {
                "material": "steel", "uniform_strain": True, "box": {"size": [10.0, 10.0, 40.0], "elements": [2, 2, 4]},
            }
        },
        load=push(traction=[3.0, 0.0, 0.0]),
    ),
    "contact": stack({"sides": ["low.zmax", "high.zmin"], "friction_coefficient": 0.3}),
    "a layer without tension": stack(
        {"sides": ["low.zmax", "high.zmin"], "behaviour": "soft_contact", "normal_stiffness": 1e6}
    ),
    "an elastic layer": stack(
        {
            "sides": ["low.zmax", "high.zmin"], "behaviour": "elastic_layer",
            "normal_stiffness": 1e6, "tangential_stiffness": 4e5,
        }
    ),
    "a bond": stack({"sides": ["low.zmax", "high.zmin"], "behaviour": "perfect", "search": 0.1}, above=2),
}  # fmt: skip
MOTIONS: dict[str, dict[str, Any]] = {
    "a pulse": bar(load=push(pressure=50.0, law=SINE), time=dict(PULSE)),
    "a load at once": bar(load=push(pressure=50.0, law={"type": "constant"}), time=dict(PULSE)),
    "a flight": bar(
        substructure={"bar": {**bar()["substructure"]["bar"], "initial_velocity": [0.0, 0.0, 1e3]}}, time=dict(PULSE)
    ),
    "from an equilibrium": bar(
        load={
            "weight": {"face": "bar.zmax", "pressure": 20.0},
            "push": {"face": "bar.xmax", "pressure": 50.0, "law": SINE},
        },
        time={**PULSE, "start": "static"},
    ),
    "damping": bar(
        material={"steel": {**STEEL, "rayleigh_mass": 2e4, "rayleigh_stiffness": 1e-7, "frame": "absolute"}},
        load=push(pressure=50.0, law=SINE),
        time=dict(PULSE),
    ),
}


# against themselves alone: slip in ccx is regularised, and bodies that a gap alone holds diverge in it
OF_CONTACT: dict[str, dict[str, Any]] = {
    "slip under a soft block": stack({"sides": ["low.zmax", "high.zmin"], "friction_coefficient": 0.1}),
    "a gap that closes": stack({"sides": ["low.zmax", "high.zmin"], "gap": 0.01}, time={"end": 20e-6, "instants": 40}),
}
OF_CONTACT["slip under a soft block"]["material"]["rubbery"] = {**STEEL, "young_modulus": 5e3, "poisson_ratio": 0.45}
OF_CONTACT["slip under a soft block"]["substructure"]["high"]["material"] = "rubbery"
OF_CONTACT["a gap that closes"]["load"]["press"]["law"] = {"type": "constant"}


@pytest.mark.parametrize("name", [*SCENES, *MOTIONS, *OF_CONTACT])
def test_a_scene_is_the_same_after_its_deck(name: str, tmp_path: Path) -> None:
    """Motions of a corner and forces of the interface; names of bodies, materials, interfaces, sensors stay."""
    scene = latin_fmu.scene_from_dict({**SCENES, **MOTIONS, **OF_CONTACT}[name])
    back = brought_back(scene, tmp_path)
    for kind in ("material", "substructure", "interface", "sensor", "boundary"):
        assert list(getattr(back, kind)) == list(getattr(scene, kind))
    first, second = latin_fmu.solve(scene), latin_fmu.solve(back)
    here, there = (solution.sensors["tip"].displacement for solution in (first, second))
    assert np.abs(here).max() > 1e-6
    np.testing.assert_allclose(there, here, atol=2e-6 * np.abs(here).max())
    for interface, history in first.interfaces.items():
        # the side that gives the points is the first one of the deck
        same = back.interface[interface].sides[0].startswith(scene.interface[interface].sides[0].split(".")[0])
        force = history.force() * (1.0 if same else -1.0)
        found = second.interfaces[interface].force()
        np.testing.assert_allclose(found, force, atol=1e-6 * np.abs(force).max())


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_has_the_answer_of_calculix(name: str, tmp_path: Path) -> None:
    """Static steps; contacts with the penalty of the deck, ties at the nodes of the slave."""
    scene = latin_fmu.scene_from_dict(SCENES[name])
    there = displacements(export_deck(scene).text, tmp_path, "tip")
    here = latin_fmu.solve(scene).sensors["tip"].displacement[-1]
    [row] = there[max(there)]
    if name == "axes of a support":
        # printed along the axes of the set
        row = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) @ row / np.sqrt(2.0)
    tolerance = 1e-2 if scene.interface else 1e-5
    np.testing.assert_allclose(row, here, atol=tolerance * np.abs(here).max())


@pytest.mark.parametrize("name", [name for name in MOTIONS if name != "from an equilibrium"])
def test_a_motion_is_that_of_calculix(name: str, tmp_path: Path) -> None:
    scene = latin_fmu.scene_from_dict(MOTIONS[name])
    there = displacements(export_deck(scene, DeckChoices(direct=True)).text, tmp_path, "tip")
    here = latin_fmu.solve(scene).sensors["tip"].displacement
    tolerance = 2e-3 if name in ("a load at once", "damping") else 2e-5
    assert len(there) == 20
    for time, rows in there.items():
        row = int(np.argmin(np.abs(scene.time.time_step * np.arange(21) - time)))
        np.testing.assert_allclose(rows[0], here[row], atol=tolerance * np.abs(here).max())


def bolted(folder: Path, **time: Any) -> dict[str, Any]:
    """The joint of the tests of bolts, pressed together beside its bolt, then hit."""
    data = joint(write_joint(folder))
    data["sensor"] = {"tip": {"substructure": "upper", "point": [0.0, 0.0, 0.0]}}
    data["load"] = {"hit": {"face": "upper.far", "pressure": 2e6, "law": {"type": "half_sine", "duration": 10e-6}}}
    data["time"] = {"end": 20e-6, "instants": 10, "start": "static"} | time
    data["solver"] = {"tolerance": 1e-8}
    data["accuracy"] = {"estimate": False}
    del data["sensor"], data["output"]
    return data


def test_a_bolted_joint_is_the_same_after_its_deck(tmp_path: Path) -> None:
    """Tightened, then dynamic: forces of bolt and interfaces to 1e-6, under their names; in ccx the joint is pressed by
    the force of the bolt."""
    scene = latin_fmu.scene_from_dict(bolted(tmp_path))
    back = brought_back(scene, tmp_path)
    assert list(back.bolt) == ["b"]
    assert back.time.start.type == "static"
    first, second = latin_fmu.solve(scene), latin_fmu.solve(back)
    np.testing.assert_allclose(second.bolts["b"].force, first.bolts["b"].force, rtol=1e-6)
    for name, history in first.interfaces.items():
        here, there = history.normal_resultant(), second.interfaces[name].normal_resultant()
        np.testing.assert_allclose(there, here, atol=1e-6 * np.abs(here).max())


def test_bolts_of_several_orders_are_tightened_one_after_the_other(tmp_path: Path) -> None:
    data = bolted(tmp_path)
    data["bolt"]["b"]["order"] = 2
    data["substructure"]["upper_bolt"] = dict(data["substructure"]["bolt"])
    data["substructure"]["plate"] = dict(data["substructure"]["lower"])
    data["interface"]["other"] = {"sides": ["upper_bolt.nut", "plate.seat"], "behaviour": "perfect"}
    data["boundary"]["plate"] = {"type": "fixed", "face": "plate.far"}
    data["boundary"]["head"] = {"type": "fixed", "face": "upper_bolt.head"}
    data["bolt"]["a"] = {"substructure": "upper_bolt", "axis": [0, 0, 1], "shortening": 1e-6}
    deck = exported(data)
    steps = deck.steps.split("*END STEP\n")
    a, b = deck.bolts["a"], deck.bolts["b"]
    assert f"*BOUNDARY\n{a}, 1, 1, 1e-06\n" in steps[0]
    assert f"*CLOAD\n{b}, 1, 5000\n" in steps[1]
    assert f"*BOUNDARY, FIXED\n{b}, 1, 1\n" in steps[2]
    assert "*DYNAMIC" in steps[2]


# -- what is used -----------------------------------------------------------------------------------------------------
def test_every_key_of_a_scene_is_decided() -> None:
    """Written, left out or refused: a new key of a table needs a row."""
    tables = {name: field.annotation for name, field in Scene.model_fields.items() if name in KEYS and name != "output"}
    classes = {"scene": Scene, "interface": Interface, "output": Scene.model_fields["output"].annotation}
    for name, annotation in tables.items():
        classes.setdefault(name, annotation.__args__[-1])  # type: ignore[union-attr]
    assert classes.keys() == KEYS.keys()
    for kind, table in classes.items():
        keys = KEYS[kind]
        decided = {*keys.written, *keys.left_out, *keys.refused}
        assert set(table.model_fields) == decided, kind


LOST = {
    "sensor.tip.filter": bar(
        sensor={"tip": {**bar()["sensor"]["tip"], "filter": {"type": "low_pass", "cutoff": 1e5}}}, time=dict(PULSE)
    ),
    "sensor.tip": bar(sensor={"tip": {"substructure": "bar", "point": [1.0, 2.0, 3.0]}}),
    "sensor.tip.face": bar(sensor={"tip": {"face": "bar.zmax"}}),
    "material.steel.damping_ratios": bar(
        material={"steel": {**STEEL, "damping_ratios": {"frequencies": [1e3, 1e4], "ratios": [0.01, 0.01]}}},
        time=dict(PULSE),
    ),
    "time.scheme": bar(time={**PULSE, "scheme": "massless_contact"}),
    "interface.lap.points_at": stack({"sides": ["low.zmax", "high.zmin"], "points_at": "corners"}),
}


@pytest.mark.parametrize("where", LOST)
def test_what_is_left_out_is_named_with_its_consequence(where: str) -> None:
    deck = exported(LOST[where])
    [line] = [line for line in deck.summary() if line.startswith(f"left out: {where}: ")]
    assert len(line.split(": ", 2)[2]) > 10
    assert f"** {line}" in deck.text


SPRING = {"ends": [{"substructure": "bar", "point": [10.0, 10.0, 40.0]}, "ground"], "stiffness": 1.0}
REFUSED = {
    "spring": bar(spring={"cord": {**SPRING, "direction": [0.0, 0.0, 1.0]}}),
    "point_mass": bar(point_mass={"lump": {"substructure": "bar", "point": [10.0, 10.0, 40.0], "mass": 1e-6}}),
    "boundary.way": bar(
        boundary={**bar()["boundary"], "way": {"type": "absorbing", "face": "bar.zmax"}}, time=dict(PULSE)
    ),
    "interface.lap.preload": stack({"sides": ["low.zmax", "high.zmin"], "preload": 1.0}),
    "interface.floor": bar(interface={"floor": {"sides": ["bar.zmin", "ground"]}}),
    "substructure.bar.initial_spin": bar(
        substructure={"bar": {**bar()["substructure"]["bar"], "initial_spin": [0.0, 0.0, 1.0]}},
        boundary={},
        time=dict(PULSE),
    ),
    "load.again": bar(load={**push(pressure=1.0), "again": {"face": "bar.zmax", "pressure": 2.0, "law": SINE}}),
    "load.push.law": bar(load=push(pressure=1.0, law={"type": "input"})),
}


@pytest.mark.parametrize("where", REFUSED)
def test_what_no_card_says_is_refused(where: str) -> None:
    with pytest.raises(InputError) as error:
        exported(REFUSED[where])
    assert where in [problem.where for problem in error.value.problems]


def test_names_that_differ_by_their_case_alone_stay_two() -> None:
    """CalculiX writes all names in capitals; sets and surfaces share their names."""
    load = {"Hold": {"face": "bar.xmin", "pressure": 1.0, "law": RAMP}}
    text = exported(bar(load=load)).text
    assert "*NSET, NSET=hold\n" in text
    assert "*SURFACE, NAME=Hold_2, TYPE=ELEMENT\n" in text


# -- text -------------------------------------------------------------------------------------------------------------
def test_fields_fit_the_lines_of_calculix() -> None:
    assert all(len(field_text(x)) <= 20 for x in (-1.23456789012345e-123, 2.0 / 3.0, -1e300 / 3.0))
    lines = list(card("ELEMENT", {"TYPE": "C3D20"}, [range(1, 22)]))
    assert lines[1].endswith("16,")
    assert lines[2] == "17, 18, 19, 20, 21"


def test_points_on_a_line_are_left_out() -> None:
    times = np.linspace(0.0, 1.0, 101)
    values = np.where(times < 0.3, 0.0, np.minimum(times - 0.3, 0.5))
    kept = corners(times, values)
    assert len(kept) < 8
    np.testing.assert_allclose(np.interp(times, times[kept], values[kept]), values, atol=1e-12)


# -- the command ------------------------------------------------------------------------------------------------------
def test_export_writes_a_deck_and_keeps_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Under the name of the scene unless another text is there; never over a mesh of the scene."""
    monkeypatch.chdir(tmp_path)
    scene = str(MODELS / "pressed_plates" / "scene.toml")
    assert main(["export", "--deck", scene]) == CONVERGED
    shown = capsys.readouterr().out
    assert "used: interface.i1: *CONTACT PAIR" in shown
    text = Path("scene.inp").read_text()
    assert main(["export", "--deck", scene]) == CONVERGED
    assert main(["import", "scene.inp", "-o", "back.toml"]) == CONVERGED
    Path("scene.inp").write_text(text + "** mine\n")
    assert main(["export", "--deck", scene]) == BAD_INPUT
    assert Path("scene.inp").read_text().endswith("** mine\n")
    assert main(["export", "--deck", scene, "-o", "scene.inp"]) == CONVERGED
    assert Path("scene.inp").read_text() == text
    assert main(["export", "--deck", "back.toml", "-o", "scene.inp"]) == BAD_INPUT
    assert "mesh of the scene" in capsys.readouterr().err
