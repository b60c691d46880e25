"""Abaqus decks of several parts: solved as the deck says, and what is not used is listed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import load_scene
from latin_fmu.api import solve
from latin_fmu.building import discretise
from latin_fmu.cli import main
from latin_fmu.commands import REMARKED
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.reader import scene_from_dict

from .decks import element_rows, layer, node_rows

BOX = box_mesh(np.zeros(3), np.array([100.0, 100.0, 100.0]), (2, 2, 2))  # mm
STEEL = "*MATERIAL, NAME=Steel\n*DENSITY\n7.8e-9,\n*ELASTIC\n210e3, 0.3\n"
SCENE = """\
name = "deck"

[mesh.assembly]
file = "deck.inp"
scale = 1e-3

[load.press]
face = "Top.Up"
pressure = 1e6
law = {type = "half_sine", duration = 1e-4}

[time]
end = 1e-4
step = 2e-6
"""


def part(name: str) -> str:
    """A block with surfaces of elements on its lower and upper end, and a node set on the lower one."""
    text = f"*PART, NAME={name}\n*NODE\n{node_rows(BOX.nodes)}*ELEMENT, TYPE=C3D8, ELSET=all\n"
    text += element_rows(BOX.blocks[0].cells)
    for surface, face, label in (("Down", "zmin", "S1"), ("Up", "zmax", "S2")):
        cells = ", ".join(map(str, layer(BOX, face)))
        text += f"*ELSET, ELSET=_{surface}, INTERNAL\n{cells}\n*SURFACE, NAME={surface}\n_{surface}, {label}\n"
    low = ", ".join(str(n + 1) for n in np.unique(BOX.faces["zmin"].nodes))
    return f"{text}*NSET, NSET=Low\n{low}\n*SOLID SECTION, ELSET=all, MATERIAL=STEEL\n*END PART\n"


def deck(tie: str = "*TIE, NAME=Glue\nTop-1.Down, Base-1.Up\n", boundary: str = "Base-1.Low, ENCASTRE\n") -> str:
    """Two parts above each other, tied; the lower one is held; a step with a load."""
    instances = "*INSTANCE, NAME=Base-1, PART=Base\n*END INSTANCE\n"
    instances += "*INSTANCE, NAME=Top-1, PART=Top\n0., 0., 100.\n*END INSTANCE\n"
    step = f"*STEP\n*DYNAMIC, EXPLICIT\n, 1e-4\n*BOUNDARY\n{boundary}*DLOAD\n"
    step += "Top-1.all, GRAV, 9810., 0., 0., -1.\n*END STEP\n"
    return f"{part('Base')}{part('Top')}*ASSEMBLY, NAME=A\n{instances}{tie}*END ASSEMBLY\n{STEEL}{step}"


def written(folder: Path, text: str, scene: str = SCENE) -> str:
    (folder / "deck.inp").write_text(text)
    (folder / "scene.toml").write_text(scene.replace("Top.Up", "Top_1.Up"))
    return str(folder / "scene.toml")


def boxes() -> dict[str, Any]:
    """The same scene by hand."""
    size = {"size": [0.1, 0.1, 0.1], "elements": [2, 2, 2]}
    return {
        "name": "boxes",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "base": {"material": "steel", "box": {**size, "origin": [0.0, 0.0, 0.0]}},
            "top": {"material": "steel", "box": {**size, "origin": [0.0, 0.0, 0.1]}},
        },
        "interface": {"glue": {"sides": ["top.zmin", "base.zmax"], "behaviour": "perfect"}},
        "boundary": {"low": {"type": "fixed", "face": "base.zmin"}},
        "load": {"press": {"face": "top.zmax", "pressure": 1e6, "law": {"type": "half_sine", "duration": 1e-4}}},
        "time": {"end": 1e-4, "step": 2e-6},
    }


def test_a_deck_is_solved_as_it_says(tmp_path: Path) -> None:
    """Material, tie and support of the deck: the forces of the same scene by hand."""
    scene = load_scene(written(tmp_path, deck()))
    assert {name: i.behaviour for name, i in scene.interface.items()} == {"Glue": "perfect"}
    assert scene.material["STEEL"].young_modulus == pytest.approx(210e9)
    assert scene.material["STEEL"].density == pytest.approx(7800.0)
    one, other = solve(scene), solve(scene_from_dict(boxes()))
    forces = [next(iter(s.interfaces.values())).force() for s in (one, other)]
    assert np.abs(forces[0]).max() > 1e3
    assert forces[0] == pytest.approx(forces[1], abs=2e-3 * np.abs(forces[1]).max())


def test_what_is_not_used_is_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", written(tmp_path, deck()), "--strict"]) == REMARKED
    shown = capsys.readouterr().out
    assert "mesh file deck.inp: *DLOAD, *DYNAMIC, *STEP are not used" in shown
    written(tmp_path, deck(tie="*TIE, NAME=Glue\nNowhere, Base-1.Up\n", boundary="Base-1.Low, 1, 3, 0.5\n"))
    remark = next(str(r) for r in discretise(load_scene(tmp_path / "scene.toml")).remarks if r.code == "deck")
    assert "*BOUNDARY, *DLOAD, *DYNAMIC, *STEP, *TIE Glue are not used" in remark


def test_the_scene_comes_first(tmp_path: Path) -> None:
    """Its material, its interface between the parts, its boundary on the face."""
    own = "[material.soft]\nyoung_modulus = 3e9\npoisson_ratio = 0.3\ndensity = 1200.0\n\n"
    own += '[substructure.Top_1]\nmaterial = "soft"\n\n[interface.mine]\nsides = ["Base_1.Up", "Top_1.Down"]\n\n'
    own += '[boundary.roll]\ntype = "fixed"\nface = "Base_1.Low"\ncomponents = ["z"]\n\n'
    scene = load_scene(written(tmp_path, deck(), SCENE.replace("[load.press]", f"{own}[load.press]")))
    assert list(scene.interface) == ["mine"]
    assert scene.interface["mine"].behaviour == "contact"
    assert list(scene.boundary) == ["roll"]
    assert scene.substructure["Top_1"].material == "soft"
    assert scene.substructure["Base_1"].material == "STEEL"


@pytest.mark.parametrize(
    ("cards", "unused"),
    [
        ("*ELASTIC, TYPE=ORTHOTROPIC\n1., 2., 3.\n", "*ELASTIC"),
        ("*ELASTIC\n210e3, 0.3, 20.\n190e3, 0.3, 200.\n", "*ELASTIC"),
        ("*ELASTIC\nsteel\n", "*ELASTIC"),
        ("*PLASTIC\n300., 0.\n", "*PLASTIC"),
    ],
)
def test_materials_that_are_not_taken(cards: str, unused: str, tmp_path: Path) -> None:
    """Constants that depend on temperature or direction, and other laws."""
    text = deck().replace("*ELASTIC\n210e3, 0.3\n", cards)
    own = "[material.mine]\nyoung_modulus = 3e9\npoisson_ratio = 0.3\ndensity = 1200.0\n\n"
    scene = SCENE.replace("scale = 1e-3", 'scale = 1e-3\nmaterial = "mine"').replace("[mesh.", f"{own}[mesh.", 1)
    remarks = discretise(load_scene(written(tmp_path, text, scene))).remarks
    assert any(unused in remark for remark in remarks if remark.code == "deck")
