"""``latin-fmu fmu`` and ``latin-fmu simulate``."""

from __future__ import annotations

import csv
import re
import zipfile
from pathlib import Path

import pytest

from latin_fmu import cli
from latin_fmu.commands import fmu as commands
from latin_fmu.compiled import library
from tests.cosim.scenes import blocks

MODELS = Path(__file__).parents[2] / "models"
CONJUGATE_GRADIENTS = ["--set", "solver.propagator={type='cg'}"]  # in Python, not in the kernels


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "blocks.toml"
    path.write_text(blocks().text())
    return path


@pytest.mark.parametrize("version", ["2", "3"])
def test_build_and_simulate(scene_file, tmp_path, version, capsys):
    target, out = tmp_path / "blocks.fmu", tmp_path / "out.csv"
    assert cli.main(["fmu", str(scene_file), "-o", str(target), "--fmi", version]) == 0
    assert "valid" in capsys.readouterr().out
    loads = tmp_path / "loads.csv"
    loads.write_text("time,load.press.value\n0,0\n3e-6,1\n")
    code = cli.main(
        ["simulate", str(target), "--input", str(loads), "-o", str(out), "--step", "1e-6", "--stop", "4e-6"]
    )
    assert code == 0
    assert "5 rows" in capsys.readouterr().out
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5
    assert float(rows[-1]["interface.crush.force[3]"]) != 0.0


def needs_tool(fmu: Path) -> bool:
    """Whether an FMU says that it needs something where it runs."""
    return 'needsExecutionTool="true"' in zipfile.ZipFile(fmu).read("modelDescription.xml").decode()


def test_python_is_a_choice_or_a_need(scene_file, tmp_path, capsys, monkeypatch):
    """A scene that needs Python gives an FMU with Python, and a remark says why; without a library there is none."""
    target, asked = tmp_path / "a.fmu", ["fmu", str(scene_file), "-o", str(tmp_path / "a.fmu"), "--reference", "none"]
    assert cli.main([*asked, "--python"]) == 0
    assert needs_tool(target)
    assert "needs Python" not in capsys.readouterr().err
    assert cli.main([*asked, *CONJUGATE_GRADIENTS]) == 0
    assert needs_tool(target)
    assert "warning: this FMU needs Python at run time, as with --python: " in capsys.readouterr().err
    monkeypatch.setattr(library, "shipped", dict)
    for option in ([], ["--portable"], ["--modes", "6"]):
        assert cli.main([*asked, *option]) == 2
        assert "the library of compiled kernels is missing here" in capsys.readouterr().err
    assert cli.main([*asked, "--python"]) == 2
    assert "FMI 2: has no platform for which there are libraries here (value: none)" in capsys.readouterr().err
    for wrong in (["--python", "--portable"], ["--python", "--modes", "6"], ["--patches", "2"]):
        assert cli.main([*asked, *wrong]) == 2
        assert "contradict" in capsys.readouterr().err


def test_a_folder_of_scenes_and_one_that_cannot_be_made(tmp_path, capsys):
    scenes, made = tmp_path / "scenes", tmp_path / "fmus"
    (scenes / "pair").mkdir(parents=True)
    (scenes / "pair" / "scene.toml").write_text(blocks().text())
    (scenes / "pair" / "bad.toml").write_text("name = 1\n")
    assert cli.main(["fmu", str(scenes), "-o", str(made), "--reference", "none"]) == 2
    assert [path.name for path in made.iterdir()] == ["pair.fmu"]
    said = capsys.readouterr()
    assert "pair.fmu" in said.out
    assert "bad.toml" in said.err
    assert cli.main(["fmu", str(made), "-o", str(made)]) == 2
    assert "holds no scene file" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert cli.main(["fmu", str(scenes), "-o", str(tmp_path / "file")]) == 2
    assert "no folder for FMUs" in capsys.readouterr().err


def test_the_size_of_a_large_compiled_fmu_is_printed_before(scene_file, tmp_path, capsys, monkeypatch):
    """Within a factor of two of the matrices in the file; nothing of small ones."""
    target = tmp_path / "blocks.fmu"
    assert cli.main(["fmu", str(scene_file), "-o", str(target)]) == 0
    assert "--modes" not in capsys.readouterr().err
    monkeypatch.setattr(commands, "_LARGE", 1e6)
    assert cli.main(["fmu", str(MODELS / "stacked_blocks" / "n02.toml"), "-o", str(target)]) == 0
    told = re.search(r"need about ([\d.]+) MB in the FMU .* --modes 20", capsys.readouterr().err)
    assert told is not None
    size = zipfile.ZipFile(target).getinfo("resources/image.bin").file_size
    assert 0.5 * size < 1e6 * float(told[1]) < 2.0 * size


@pytest.mark.parametrize("python", [[], pytest.param(["--python"], marks=pytest.mark.slow)])
def test_what_acts_is_said_when_an_fmu_is_made_and_run(scene_file, tmp_path, capsys, python):
    """Laws of the scene act in the FMU; an input does when it is set; without both there is a warning."""
    target, out = tmp_path / "blocks.fmu", tmp_path / "out.csv"
    unmoved = ["load.push.law=input", "load.press.law=input"]
    nothing = "no load was applied: all inputs remained 0, and nothing else loads or moves a body"
    for settings, at_making, started, at_running in (
        ([], ["load.press.value = 0.25", "acts in the FMU as in the scene: load push (half_sine)\n"], [], ""),
        (
            ["load.press.law={type='constant'}"],
            ["scene: load press (constant), load push (half_sine) (--inputs press makes press an input)"],
            [],
            "",
        ),
        (unmoved, ["load.press.value = 0, load.push.value = 0", "the FMU stays at rest"], [], nothing),
        (unmoved, ["the FMU stays at rest"], ["--start", "load.press.value=0.1"], ""),
        (unmoved, ["the FMU stays at rest"], ["--start", "mode=1"], nothing),
        (unmoved, ["the FMU stays at rest"], ["--start", "mode=1", "--start", "historyFile=time,press;0,0;1e-6,1"], ""),
        (["load={}"], ["warning: nothing loads or moves a body in this FMU"], [], "nothing loads or moves a body"),
    ):
        changes = [word for setting in settings for word in ("--set", setting)]
        made = ["fmu", str(scene_file), "-o", str(target), "--reference", "none", *python, *changes]
        assert cli.main(made) == 0
        said = capsys.readouterr().out
        assert all(text in said for text in at_making), said
        assert cli.main(["simulate", str(target), "--stop", "1e-6", "-o", str(out), *started]) == 0
        warned = [line for line in capsys.readouterr().err.splitlines() if "warning of the FMU" in line]
        assert [at_running in line for line in warned] == [True] * bool(at_running), (settings, started, warned)


def test_a_refused_step_ends_the_run_with_its_message(scene_file, tmp_path, capsys):
    target = tmp_path / "blocks.fmu"
    assert cli.main(["fmu", str(scene_file), "-o", str(target), "--python"]) == 0
    start = ["--start", "maxIterations=1", "--start", "tolerance=1e-9"]
    assert cli.main(["simulate", str(target), *start, "-o", str(tmp_path / "o.csv"), "--quiet"]) == 3
    assert "no convergence" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.fmu"], "no such file"),
        (["{fmu}", "--start", "x=1"], "no variable of this name"),
        (["{fmu}", "--start", "x"], "NAME=VALUE"),
        (["{fmu}", "--input", "nowhere.csv"], "nowhere.csv"),
        (["{fmu}", "--input", "{inf}"], "no finite number in column load.press.value (value: inf)"),
    ],
)
def test_bad_arguments(fmus, tmp_path, arguments, words, capsys):
    infinite = tmp_path / "inf.csv"
    infinite.write_text("time,load.press.value\n0,inf\n1,1\n")
    given = [a.replace("{fmu}", str(fmus["2"])).replace("{inf}", str(infinite)) for a in arguments]
    assert cli.main(["simulate", *given, "-o", str(tmp_path / "o.csv")]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("times", "words"),
    [((1, 2), "begins after the simulation"), ((-2, -1), "ends before the simulation"), ((0, 1), ""), ((0,), "")],
)
def test_inputs_at_other_times_than_those_of_the_simulation_are_told(fmus, tmp_path, times, words, capsys):
    table = tmp_path / "in.csv"
    table.write_text("\n".join(["time,load.press.value", *(f"{time},1" for time in times)]))
    asked = ["simulate", str(fmus["2"]), "--input", str(table), "--stop", "1e-6", "-o", str(tmp_path / "o.csv")]
    assert cli.main(asked) == 0
    said = capsys.readouterr().err
    assert ("warning: the table of inputs" in said) == bool(words)
    assert words in said
