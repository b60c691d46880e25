"""Models that come with the package: listed with their sizes, copied whole or not at all, run as printed."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import pytest

from latin_fmu.assembly.body import build_bodies
from latin_fmu.cli import main
from latin_fmu.errors import Problems
from latin_fmu.reader import load_scene

MODELS = Path(__file__).parents[1] / "models"
NAMES = sorted(path.name for path in MODELS.iterdir() if path.is_dir())


@pytest.fixture
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_model_is_listed_with_its_size(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo"]) == 0
    rows = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.strip()}
    assert set(NAMES) <= set(rows)
    for name in NAMES:
        scene = load_scene(min((MODELS / name).glob("*.toml"), key=lambda path: (path.stem != "scene", path.stem)))
        nodes = sum(len(body.mesh.nodes) for body in build_bodies(scene, Problems()).values())
        assert f" {nodes}, {scene.time.n_step} " in rows[name]


def test_the_printed_commands_solve_and_draw_the_copy(empty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "impact_bar"]) == 0
    copied = {path.name for path in Path("impact_bar").iterdir()}
    assert copied == {path.name for path in (MODELS / "impact_bar").iterdir()}
    for name in copied - {"README.md"}:
        assert Path("impact_bar", name).read_bytes() == (MODELS / "impact_bar" / name).read_bytes()
    assert "latin-fmu run impact_bar/scene.toml" in Path("impact_bar/README.md").read_text(encoding="utf-8")
    commands = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  latin-fmu ")]
    assert [main(shlex.split(command)[1:]) for command in commands] == [0, 0]
    assert {path.name for path in empty.iterdir()} == {"impact_bar", "impact_bar.nc", "impact_bar.png"}


@pytest.mark.usefixtures("empty")
def test_a_model_without_scene_toml_names_its_scenes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "stacked_blocks"]) == 0
    out = capsys.readouterr().out
    assert "latin-fmu run stacked_blocks/n02.toml -o stacked_blocks.nc" in out
    assert "stacked_blocks/n16.toml" in out


@pytest.mark.parametrize("taken", ["file", "folder", "link"])
def test_nothing_is_overwritten(taken: str, empty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = empty / "impact_bar"
    {"file": place.touch, "folder": place.mkdir, "link": lambda: place.symlink_to("nowhere")}[taken]()
    assert main(["demo", "impact_bar"]) == 2
    assert "this file or folder already exists" in capsys.readouterr().err
    assert list(empty.iterdir()) == [place]
    assert not (place.is_dir() and list(place.iterdir()))


def test_an_unknown_model_is_named_with_those_there_are(empty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "impact_bars"]) == 2
    error = capsys.readouterr().err
    assert "did you mean 'impact_bar'?" in error
    assert "stacked_blocks" in error
    assert not list(empty.iterdir())


def test_a_copy_that_fails_leaves_nothing(
    empty: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(source: Path, target: Path) -> None:
        Path(target).write_bytes(source.read_bytes()[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    assert main(["demo", "impact_bar"]) == 4
    assert "No space left on device" in capsys.readouterr().err
    assert not list(empty.iterdir())
