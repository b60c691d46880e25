"""The mistakes of a beginner: none is silent, and each sentence names the thing, its value and the remedy."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from latin_fmu.cli import main
from latin_fmu.commands import BAD_INPUT, REMARKED

SCENE = """\
name = "blocks"

[material.steel]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0

[substructure.lower]
material = "steel"
box = {origin = [0.0, 0.0, 0.0], size = [0.1, 0.1, 0.1], elements = [2, 2, 2]}

[substructure.upper]
material = "steel"
box = {origin = [0.0, 0.0, 0.1], size = [0.1, 0.1, 0.1], elements = [2, 2, 2]}

[interface.joint]
sides = ["lower.zmax", "upper.zmin"]
friction_coefficient = 0.3

[boundary.floor]
type = "fixed"
face = "lower.zmin"

[load.press]
face = "upper.zmax"
pressure = 1e6
law = {type = "half_sine", duration = 1e-4}

[time]
end = 2e-4
step = 2e-6
"""
JOINT = SCENE[SCENE.index("[interface.joint]") : SCENE.index("[boundary.floor]")]
LOAD = SCENE[SCENE.index("[load.press]") : SCENE.index("[time]")]
FOUND = "[contact.all]\nsearch = 20e-6\nfriction_coefficient = 0.3\n\n[boundary.floor]"


def lifted(distance: float) -> tuple[str, str]:
    """The upper block moved along z."""
    return "origin = [0.0, 0.0, 0.1]", f"origin = [0.0, 0.0, {0.1 + distance!r}]"


# what is changed (pairs of old and new text), exit code of `check --strict`, words that it prints
MISTAKES: dict[str, tuple[list[tuple[str, str]], int, list[str]]] = {
    "key misspelt": ([("density =", "densty =")], BAD_INPUT, ["densty", "did you mean 'density'"]),
    "table misspelt": ([("[boundary.floor]", "[boundry.floor]")], BAD_INPUT, ["boundry", "did you mean 'boundary'"]),
    "name misspelt": ([('material = "steel"', 'material = "stell"')], BAD_INPUT, ["stell", "steel"]),
    "value misspelt": ([('"fixed"', '"fixd"')], BAD_INPUT, ["fixd", "fixed"]),
    "interface misspelt": ([('"upper.zmin"', '"uper.zmin"')], BAD_INPUT, ["uper", "did you mean 'upper.zmin'"]),
    "face misspelt": ([('"upper.zmin"', '"upper.zmni"')], BAD_INPUT, ["zmni", "zmin"]),
    "quotes missing": ([('"fixed"', "fixed")], BAD_INPUT, ["TOML", "quotes", "line"]),
    "brackets missing": ([("size = [0.1, 0.1, 0.1]", "size = 0.1, 0.1, 0.1")], BAD_INPUT, ["TOML", "[ ]", "line"]),
    "decimal comma": ([("poisson_ratio = 0.3", "poisson_ratio = 0,3")], BAD_INPUT, ["TOML", "decimal point", "line"]),
    "modulus in GPa": ([("210e9", "210")], REMARKED, ["Young's modulus of 210 Pa", "GPa", "2.1e+11"]),
    "modulus in MPa": ([("210e9", "210e3")], REMARKED, ["Young's modulus of 210000 Pa", "MPa", "2.1e+11"]),
    "density in g/cm3": ([("7800.0", "7.8")], REMARKED, ["density of 7.8 kg/m3", "g/cm3", "7800"]),
    "density in t/mm3": ([("7800.0", "7.8e-9")], REMARKED, ["density of 7.8e-09 kg/m3", "t/mm3", "7800"]),
    "pressure in MPa": ([("pressure = 1e6", "pressure = 1.0")], REMARKED, ["press", "MPa"]),
    "pressure too large": ([("pressure = 1e6", "pressure = 1e12")], REMARKED, ["press", "Young's modulus"]),
    "size in mm": ([("0.1", "100.0")], REMARKED, ["100 m long", "is its size in m?"]),
    "friction in per cent": ([("coefficient = 0.3", "coefficient = 30")], REMARKED, ["30", "per cent", "0.3"]),
    "negative gap": ([(JOINT, JOINT.rstrip() + "\ngap = -1e-5\n\n")], BAD_INPUT, ["joint.gap", "-1e-05", ">= 0"]),
    "gap in mm": ([(JOINT, JOINT.rstrip() + "\ngap = 0.05\n\n")], REMARKED, ["joint", "gap of 0.05 m", "mm"]),
    "negative pressure": ([("pressure = 1e6", "pressure = -1e6")], REMARKED, ["press", "negative", "pulls"]),
    "parts that do not touch": ([lifted(0.5)], REMARKED, ["joint", "gap of 0.5 m"]),
    "parts that overlap": ([lifted(-1e-3)], BAD_INPUT, ["joint", "overlap", "0.001 m", "apart"]),
    "parts beside each other": (
        [("origin = [0.0, 0.0, 0.1]", "origin = [0.5, 0.0, 0.1]")],
        BAD_INPUT,
        ["joint", "no part in common", "0.4 m apart"],
    ),
    "parts too far for a search": (
        [(JOINT + "[boundary.floor]", FOUND), lifted(1e-3)],
        REMARKED,
        ["no interface", "search", "0.001 m"],
    ),
    "overlap deeper than a search": (
        [(JOINT + "[boundary.floor]", FOUND), lifted(-1e-3)],
        BAD_INPUT,
        ["lower and upper", "overlap", "0.001 m", "search"],
    ),
    "no interface": ([(JOINT, "")], REMARKED, ["no interface", "[contact.NAME]"]),
    "no material": ([(SCENE[SCENE.index("[material") : SCENE.index("[substructure.l")], "")], BAD_INPUT, ["material"]),
    "unknown group": (
        [("box = {origin = [0.0, 0.0, 0.1], size = [0.1, 0.1, 0.1], elements = [2, 2, 2]}",
          'mesh = {file = "two.msh", group = "lid"}')],
        BAD_INPUT,
        ["two.msh", "no such volume group", "lid"],
    ),
    "mesh missing": (
        [("box = {origin = [0.0, 0.0, 0.1], size = [0.1, 0.1, 0.1], elements = [2, 2, 2]}",
          'mesh = {file = "lid.msh"}')],
        BAD_INPUT,
        ["lid.msh", "no such file", "relative to the scene"],
    ),
    "folder for a mesh": (
        [("box = {origin = [0.0, 0.0, 0.1], size = [0.1, 0.1, 0.1], elements = [2, 2, 2]}",
          'mesh = {file = "folder.msh"}')],
        BAD_INPUT,
        ["folder.msh", "folder"],
    ),
    "STEP for a mesh": (
        [("box = {origin = [0.0, 0.0, 0.1], size = [0.1, 0.1, 0.1], elements = [2, 2, 2]}",
          'mesh = {file = "part.step"}')],
        BAD_INPUT,
        ["part.step", "CAD", "latin-fmu mesh part.step"],
    ),
    "CSV missing": ([('{type = "half_sine", duration = 1e-4}', '{type = "csv", file = "pulse.csv"}')], BAD_INPUT,
                    ["pulse.csv", "does not exist", "relative to the scene"]),
    "step as long as the pulse": ([("step = 2e-6", "step = 1e-4")], REMARKED, ["press", "too long"]),
    "step of half the pulse": ([("step = 2e-6", "step = 5e-5")], REMARKED, ["press", "too long"]),
    "step not dividing the end": ([("step = 2e-6", "step = 3e-6")], BAD_INPUT, ["time.end", "3e-06", "instants"]),
    "step far above Courant": (
        [
            ("step = 2e-6", "step = 1e-2"),
            ("end = 2e-4", "end = 1.0"),
            ('{type = "half_sine", duration = 1e-4}', '"step"'),
        ],
        REMARKED,
        ["elements of", "in a step", "smaller steps"],
    ),
    "step far below Courant": (
        [("step = 2e-6", "step = 1e-9"), ("end = 2e-4", "end = 1e-6"), ("duration = 1e-4", "duration = 1e-6")],
        REMARKED,
        ["steps to cross an element", "longer steps"],
    ),
    "quasi-static without support": (
        [('scheme', 'scheme'), ("step = 2e-6", 'step = 2e-6\nquasi_static = true'),
         (SCENE[SCENE.index("[boundary") : SCENE.index("[load")], "")],
        BAD_INPUT,
        ["lower", "hold"],
    ),
    "more memory than there is": ([("elements = [2, 2, 2]", "elements = [250, 250, 250]")], BAD_INPUT, ["memory"]),
    "no load": ([(LOAD, "")], REMARKED, ["nothing loads or moves", "[load]"]),
    "load on a face inside": ([('"upper.zmax"', '"upper.zmin"')], REMARKED, ["upper.zmin", "joint", "free face"]),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_in_a_scene(mistake: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes, code, words = MISTAKES[mistake]
    text = SCENE
    for old, new in changes:
        text = text.replace(old, new)
    (tmp_path / "scene.toml").write_text(text)
    (tmp_path / "folder.msh").mkdir()
    (tmp_path / "part.step").write_text("ISO-10303-21;")
    (tmp_path / "two.msh").write_bytes((Path(__file__).parent / "two.msh").read_bytes())
    assert main(["check", str(tmp_path / "scene.toml"), "--strict"]) == code
    shown = "".join(capsys.readouterr())
    assert "Traceback" not in shown
    assert not [word for word in words if word not in shown], shown


def test_the_scene_without_a_mistake_has_no_remark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    assert main(["check", str(tmp_path / "scene.toml"), "--strict"]) == 0, "".join(capsys.readouterr())


def written(folder: Path, text: str = SCENE) -> str:
    """Path of a scene file with this text."""
    (folder / "scene.toml").write_text(text)
    return str(folder / "scene.toml")


FOREIGN = b"CDF\x01" + bytes(100)

# arguments (SCENE: the scene of this file), words of the sentence
COMMANDS: dict[str, tuple[list[str], list[str]]] = {
    "scene missing": (["check", "nothing.toml"], ["nothing.toml", "no such file"]),
    "folder for a scene": (["check", "."], ["this is a folder", "scene.toml"]),
    "results missing": (["plot", "nothing.nc"], ["nothing.nc", "no such file"]),
    "foreign results": (["plot", "foreign.nc"], ["foreign.nc", "written by a run"]),
    "no results at all": (["srs", "text.nc"], ["text.nc", "written by a run"]),
    "output onto an input": (["run", "SCENE", "-o", "scene.toml"], ["is an input", "another file"]),
    "another suffix": (["run", "SCENE", "-o", "out.csv"], ["out.csv", "netCDF", "not as .csv", "plot"]),
    "a figure of another format": (["plot", "SCENE", "-o", "out.csv"], ["out.csv", ".png"]),
    "output onto a device": (["run", "SCENE", "-o", "/dev/null"], ["device", "e.g. out.nc"]),
    "model copied twice": (["demo", "impact_bar"], ["impact_bar", "already exists", "rename"]),
    "setting without a value": (["check", "SCENE", "--set", "solver.tolerance"], ["--set", "name.key=value"]),
    "setting with a comma": (["check", "SCENE", "--set", "solver.tolerance=1e-4,5"], ["tolerance", "1e-4,5"]),
    "setting that leaves the list open": (
        ["check", "SCENE", "--set", "substructure.upper.initial_velocity=[0,"],
        ["initial_velocity", "[0,"],
    ),
}


@pytest.mark.parametrize("mistake", COMMANDS)
def test_mistakes_on_the_command_line(
    mistake: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, words = COMMANDS[mistake]
    scene = written(tmp_path)
    (tmp_path / "foreign.nc").write_bytes(FOREIGN)
    (tmp_path / "text.nc").write_text("no results")
    (tmp_path / "impact_bar").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main([scene if word == "SCENE" else word for word in arguments]) == BAD_INPUT
    shown = "".join(capsys.readouterr())
    assert "Traceback" not in shown
    assert not [word for word in words if word not in shown], shown
    assert not (tmp_path / "out.csv").exists()


def test_a_bare_word_is_a_text_in_a_setting(tmp_path: Path) -> None:
    """Quotes that the shell takes away are not missed."""
    assert main(["check", written(tmp_path), "--set", 'boundary.floor.type="fixed"']) == 0
    assert main(["check", written(tmp_path), "--set", "boundary.floor.type=fixed"]) == 0


def deck(second: float, first_label: int) -> str:
    """Two cubes above each other, the upper one at the height ``second``, its nodes from a label on."""
    square = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)]
    lines = ["*NODE"]
    for start, low in ((1, 0.0), (first_label, second)):
        corners = [(x, y, low + z) for z in (0.0, 0.1) for x, y in square]
        lines += [f"{start + i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(corners)]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=PART")
    for label, start in ((1, 1), (2, first_label)):
        lines.append(", ".join(map(str, (label, *range(start, start + 8)))))
    return "\n".join(
        [
            *lines,
            "*NSET, NSET=BOTTOM",
            "1, 2, 3, 4",
            "*NSET, NSET=TOP",
            ", ".join(str(first_label + i) for i in range(4, 8)),
            "",
        ]
    )


@pytest.mark.parametrize(
    ("height", "words"),
    [(0.1, ["2 pieces", "4 nodes", "torn", "merge"]), (0.3, ["2 pieces", "do not touch", "separate parts"])],
)
def test_torn_parts(height: float, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A part with duplicate nodes along a plane, and two blocks that share no node."""
    (tmp_path / "part.inp").write_text(deck(height, 11))
    box = SCENE[SCENE.index("[substructure.lower]") : SCENE.index("[boundary.floor]")]
    one = '[substructure.lower]\nmaterial = "steel"\nmesh = {file = "part.inp"}\n\n'
    text = SCENE.replace(box, one).replace("lower.zmin", "lower.BOTTOM").replace("upper.zmax", "lower.TOP")
    assert main(["check", written(tmp_path, text), "--strict"]) == REMARKED
    shown = "".join(capsys.readouterr())
    assert not [word for word in words if word not in shown], shown


def test_an_fmu_without_fmpy_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "fmpy", None)
    monkeypatch.chdir(tmp_path)
    assert main(["fmu", written(tmp_path), "-o", "blocks.fmu"]) == 0
    shown = "".join(capsys.readouterr())
    assert "blocks.fmu" in shown
    assert "not checked" in shown
    assert (tmp_path / "blocks.fmu").is_file()


def test_run_says_what_check_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Remarks of ``check`` stand in the summary and in the report of ``run``, with codes; faces that never touch."""
    scene = written(tmp_path, SCENE.replace("coefficient = 0.3", "coefficient = 30"))
    options = ["-o", str(tmp_path / "out.nc"), "--no-estimate"]
    assert main(["run", scene, *options, "--strict"]) == REMARKED
    assert "per cent" in capsys.readouterr().out
    assert main(["run", scene, *options, "--json", "--quiet"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["warning_codes"] == ["friction"]
    assert main(["explain", scene, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warning_codes"] == ["friction"]
    apart = written(tmp_path, SCENE.replace(*lifted(1e-3)))
    assert main(["run", apart, *options, "--strict"]) == REMARKED
    assert "never touch" in capsys.readouterr().out


def test_a_strained_body_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """E in GPa: the strains at the end are no small ones."""
    soft = SCENE.replace("210e9", "210").replace("pressure = 1e6", "pressure = 100.0")
    soft = soft.replace("[time]", '[boundary.side]\ntype = "symmetry"\nface = "lower.xmin"\n\n[time]')
    soft = soft.replace("2e-4", "2.0").replace("2e-6", "0.02").replace("duration = 1e-4", "duration = 4.0")
    main(["run", written(tmp_path, soft), "-o", str(tmp_path / "out.nc"), "--no-estimate"])
    assert "has a strain of" in capsys.readouterr().out
