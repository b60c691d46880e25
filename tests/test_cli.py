"""The command line: exit codes, what goes to which stream, errors before the long part."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from latin_fmu import SolverError, api
from latin_fmu.cli import COMMANDS, main
from latin_fmu.results.solution import Solution

from .results import synthetic

MODELS = Path(__file__).parents[1] / "models"

SCENE = """\
name = "two_bars"
[material.steel]
young_modulus = 210e9
poisson_ratio = 0.0
density = 7800.0
[substructure.left]
material = "steel"
box = { origin = [0.0, 0.0, 0.0], size = [0.01, 0.01, 0.1], elements = [1, 1, 5] }
[substructure.right]
material = "steel"
box = { origin = [0.0, 0.0, 0.1], size = [0.01, 0.01, 0.1], elements = [1, 1, 5] }
[interface.meet]
sides = ["left.zmax", "right.zmin"]
[load.push]
face = "left.zmin"
pressure = 1e6
[time]
end = 40e-6
instants = 20
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A scene file in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    return "scene.toml"


@pytest.fixture
def stalling(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver that does not converge."""
    outcome = synthetic.bars(converged=False)
    monkeypatch.setattr(api, "solve", lambda scene, **_: Solution(outcome, scene.text(), scene.name))


@pytest.mark.usefixtures("scene")
def test_run_writes_results_beside_and_tells_a_summary(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "scene.toml"]) == 0
    out = capsys.readouterr().out
    assert Path("two_bars.nc").is_file()
    assert "two_bars: converged" in out
    assert "results: two_bars.nc" in out
    assert "meet" in out


def test_json_is_alone_on_stdout(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "-o", "a.nc", "--json"]) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert report["converged"] is True
    assert len(report["iterations"]) == 20
    assert report["interfaces"]["meet"]["impulse"][2] < 0.0
    assert "results: a.nc" in captured.err


def test_a_run_loads_what_it_needs(scene: str) -> None:
    """The libraries and modules that a run of boxes without modes leaves out, and NumPy as it was: its tools can be
    imported afterwards."""
    code = (
        "import sys; from latin_fmu.cli import main; "
        f"assert main(['run', {scene!r}, '--quiet']) == 0; "
        "unused = {'numba', 'llvmlite', 'xarray', 'pandas', 'matplotlib', 'meshio', 'numpy.f2py', 'numpy.testing', "
        "'scipy.cluster', 'scipy.integrate', 'scipy.optimize', 'scipy.signal', 'scipy.stats'}; "
        "unused |= {f'latin_fmu.{name}' for name in ('joined.reduced_run', 'joined.joined_assembly', "
        "'checks.release', 'mesh_files.content', 'scene.universal_files')}; "
        "assert not unused & set(sys.modules), unused & set(sys.modules); "
        "import numpy; assert numpy.testing.assert_allclose; assert numpy.f2py.main"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="sizes of the libraries of Linux")
def test_a_small_run_takes_the_memory_of_its_libraries(scene: str) -> None:
    """Two thirds of it are Python, NumPy, SciPy, netCDF4 and pydantic when they are loaded."""
    code = (
        "import sys; from latin_fmu.cli import main; from latin_fmu.machine import peak_memory; "
        f"assert main(['run', {scene!r}, '--quiet']) == 0; print(peak_memory())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 112 * 2**20


def test_settings_are_changed_by_name(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "--json", "--set", "time.instants=10", "--set", "solver.window=5"]) == 0
    assert len(json.loads(capsys.readouterr().out)["iterations"]) == 2


def test_quiet_says_nothing(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("stalling")
def test_not_converged_is_one_and_results_are_marked(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    from latin_fmu import open_results

    assert main(["run", scene, "-o", "a.nc", "--quiet"]) == 1
    assert "use shorter windows" in capsys.readouterr().err
    tree = open_results("a.nc")
    assert tree.attrs["converged"] == 0
    tree.close()


def test_paraview_files(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "--vtk", "pv", "--set", "output.fields=true", "--set", "output.every=10"]) == 0
    assert str(Path("pv/results.pvd")) in capsys.readouterr().out
    assert len(list(Path("pv").glob("substructure_left_*.vtu"))) == 3


def test_an_unknown_command_is_answered_with_the_nearest_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rnu", "scene.toml"]) == 2
    said = capsys.readouterr().err
    assert "rnu: no command of this name; allowed: run, check" in said
    assert "did you mean 'run'?" in said


def test_a_run_draws_its_figure(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "-o", "a.nc", "--figure", "a.png"]) == 0
    assert "figure: a.png" in capsys.readouterr().out
    assert Path("a.png").stat().st_size > 5000
    assert main(["run", scene, "-o", "b.nc", "--figure", "b.doc"]) == 2
    assert "allowed: .png, .pdf, .svg" in capsys.readouterr().err
    assert not Path("b.nc").exists()  # refused before the run


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "nothing.toml"],
        ["run", "scene.toml", "--set", "material.steel.density=-1"],
        ["run", "scene.toml", "--set", "materiel.steel.density=1"],
        ["run", "scene.toml", "--set", "density"],
        ["run", "scene.toml", "-o", "missing/a.nc"],
        ["run", "scene.toml", "-o", "."],
        ["run", "scene.toml", "--vtk", "."],
        ["check", "nothing.toml"],
        ["plot", "nothing.nc"],
        ["plot", "nothing.toml"],
        ["plot", "scene.toml", "--bodies"],
        ["plot", "nothing.nc", "-o", "a.doc"],
        ["run"],
        ["fly"],
        [],
    ],
)
@pytest.mark.usefixtures("scene")
def test_bad_input_is_two_and_explained_before_any_solve(
    arguments: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(api, "solve", lambda *_, **__: pytest.fail("solved in spite of bad input"))
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err
    assert "Traceback" not in captured.err


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt(), 130), (SolverError("singular"), 3)])
def test_a_run_cut_short(
    error: BaseException, code: int, scene: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(api, "solve", stopped)
    assert main(["run", scene]) == code
    assert capsys.readouterr().err.startswith("latin-fmu: ")
    assert [path.name for path in Path().iterdir()] == [scene]


def test_a_full_disk_does_not_cost_the_numbers(
    scene: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full_disk(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("latin_fmu.results.writing._move", full_disk)
    assert main(["run", scene, "--json"]) == 4
    captured = capsys.readouterr()
    assert json.loads(captured.out)["converged"] is True
    assert "No space left" in captured.err


def test_check_tells_sizes(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", scene]) == 0
    assert "meet" in capsys.readouterr().out
    assert [path.name for path in Path().iterdir()] == [scene]


def test_plot_draws_beside_the_results_or_where_told(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scene, "-o", "a.nc", "--quiet"]) == 0
    assert main(["plot", "a.nc"]) == 0
    assert main(["plot", "a.nc", "-o", "b.svg"]) == 0
    assert "figure: a.png" in capsys.readouterr().out
    assert Path("a.png").stat().st_size > 5000
    assert Path("b.svg").read_text().startswith("<?xml")


def test_reference_as_text_and_as_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reference"]) == 0
    assert "young_modulus" in capsys.readouterr().out
    assert main(["reference", "--schema"]) == 0
    assert "properties" in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"]])
def test_help_has_examples(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 0
    assert "examples:\n  latin-fmu" in capsys.readouterr().out


def test_every_command_is_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--help"])
    text = capsys.readouterr().out
    for command in COMMANDS:
        assert f"\n    {command}" in text


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    import latin_fmu

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"latin-fmu {latin_fmu.__version__}\n"


@pytest.mark.parametrize(
    "more",
    [["solver.window='whole'"], ['solver.search_direction={type="uniform", normal=1e-12, tangential=1e-12}']],
    ids=["one window", "search direction far off"],
)
def test_a_run_that_stops_early_is_written_and_can_be_plotted(tmp_path, capsys, more):
    """Exit code 1, the message names where it stopped, the file holds what was accepted."""
    scene, out = str(MODELS / "two_specimen_crushing" / "scene.toml"), tmp_path / "out.nc"
    settings = ["solver.max_iterations=1", "solver.start=zero", "time.end=6e-6", *more]
    assert main(["run", scene, "-o", str(out), *(word for s in settings for word in ("--set", s))]) == 1
    assert "stopped there, results end at t =" in capsys.readouterr().out
    assert main(["plot", str(out), "-o", str(tmp_path / "out.png")]) == 0
    assert (tmp_path / "out.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("setting", "code"),
    [
        ("load.push.pressure=1e307", 3),
        ("substructure.left.initial_velocity=[0.0, 0.0, 1e305]", 1),
        ("time.end=1e-200", 2),
    ],
)
def test_absurd_numbers_end_in_a_sentence(
    scene: str, setting: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """No traceback and no warning of a library, which is an error here: what overflows is refused, or a run that does
    not converge."""
    assert main(["run", scene, "--quiet", "--set", setting, "--set", "time.instants=2"]) == code
    assert "Traceback" not in capsys.readouterr().err


def test_every_command_whose_output_is_data_prints_json(scene: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing else on stdout, and the numbers of the files that are written."""

    def printed(*words: str) -> Any:
        assert main([*words, "--json"]) == 0
        return json.loads(capsys.readouterr().out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))

    found = printed("check", scene)
    assert found["steps"] == 20
    assert found["interfaces"][0]["area"] == pytest.approx(1e-4)
    assert found["classes"][0]["unknowns"] == 72
    assert all(warning.keys() == {"code", "text"} for warning in found["warnings"])
    assert found.keys() >= {"memory_bytes", "step", "scene"}
    assert printed("explain", scene)["effects"]
    modes = printed("modes", scene, "--count", "2", "-o", "modes.nc")
    with xr.open_datatree("modes.nc") as tree:
        assert modes["frequency"]["values"] == tree["modes"]["frequency"].values.tolist()
    assert modes["frequency"]["units"] == "Hz"
    study = printed("sweep", scene, "--vary", "load.push.pressure=1e6,2e6", "--jobs", "1", "-o", "study.nc")
    with xr.open_dataset("study.nc") as stored:
        assert study["state"]["values"] == stored["state"].values.tolist()
        assert study.keys() >= set(stored.variables)
    Path("scene.toml").write_text(SCENE + '[sensor.top]\nface = "right.zmax"\n')
    assert main(["run", scene, "-q", "-o", "out.nc"]) == 0
    spectra = printed("srs", "out.nc", "--lowest", "2e4", "--highest", "4e4")
    assert spectra["top"]["acceleration"]["dims"] == ["response", "frequency", "component"]
    assert spectra["top"]["quality"] == 10.0
