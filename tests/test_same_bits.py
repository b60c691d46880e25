"""What is looked at, shown or kept beside a run changes no bit of it: observer, progress, threads, results."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.compiled import PLAIN
from latin_fmu.latin.windows import Run
from tests.scenes import MINUTES, MODELS

pytestmark = pytest.mark.skipif(PLAIN, reason="the kernels of a run are plain Python: too slow")

SCENES = sorted(p for p in MODELS.glob("*/*.toml") if p.parent.name not in MINUTES)
SHORT = 10  # instants of the quick tier
# seconds each even so: whole runs alone, in the slow tier
LONG = ("lap_joint/scene", "lap_joint/shock", "pressed_plates/scene", "punched_plates/scene")
LONG += ("stacked_blocks/n04", "stacked_blocks/n08", "stacked_blocks/n16")
WAYS = ("observer", "trials", "progress and results", "threads", "stages")


def names(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def shortened(path: Path) -> list[str]:
    """Settings that cut a scene after a few of its steps."""
    time = latin_fmu.load_scene(path).time
    n = min(SHORT, time.n_step)
    settings = [f"time.end={time.end * n / time.n_step!r}"]
    return settings if time.step is not None else [*settings, f"time.instants={n}"]


class Sink:
    """Receiver of the progress; ``updates`` : number of its calls."""

    def __init__(self) -> None:
        self.updates = 0

    def update(self, done: int, total: int, iteration: int, error: float) -> None:
        """Count."""
        assert 0 <= done < total
        assert iteration > 0
        assert error >= 0.0
        self.updates += 1


def solved(path: Path, settings: list[str], way: str, folder: Path) -> Any:
    """Outcome of a scene, looked at in some way."""
    if way == "threads":
        settings = [*settings, "solver.threads=2"]
    if way == "progress and results":
        settings = [*settings, "output.energy=true", "output.fields=true", "output.every=5"]
    scene = latin_fmu.load_scene(path, settings)
    seen: list[float] = []

    def look(iteration: Any) -> None:
        seen.append(iteration.error_indicator)
        for name in scene.interface:
            iteration.interface(name)
        if way == "trials" and len(seen) % 7 == 0:
            iteration.displacement(sorted(scene.substructure)[0])

    sink = Sink() if way == "progress and results" else None
    solution = latin_fmu.solve(scene, observer=look if way in ("observer", "trials") else None, progress=sink)
    assert bool(seen) == (way in ("observer", "trials"))
    assert sink is None or sink.updates
    if way == "progress and results":
        solution.save(folder / "out.nc")
    return solution.outcome


def bits(outcome: Any) -> Iterator[tuple[str, Any]]:
    """Everything that the histories of an outcome hold."""
    yield "status", (outcome.converged, outcome.status)
    yield "work", (outcome.marched, outcome.passes)
    yield "windows", [(w.iterations, w.fallbacks, w.accepted) for w in outcome.windows]
    yield "errors", [list(w.error_indicator) for w in outcome.windows]
    yield "force residuals", [np.array(w.force_mismatch).tobytes() for w in outcome.windows]
    yield "indicator", outcome.interface_indicator
    for name, history in outcome.interfaces.items():
        for field in ("traction", "velocity", "gap", "contact_status", "friction_power", "layer_energy"):
            values = getattr(history, field)
            yield f"{name} {field}", None if values is None else values.tobytes()


def compare(path: Path, settings: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = dict(bits(solved(path, settings, "", folder)))
    assert any(value is not None and any(value) for key, value in plain.items() if key.endswith("velocity"))
    for way in WAYS:
        if way == "stages":
            monkeypatch.setattr(Run, "marches", property(lambda _: False))
        other = dict(bits(solved(path, settings, way, folder)))
        assert plain.keys() == other.keys()
        assert [key for key in plain if plain[key] != other[key]] == [], way


@pytest.mark.parametrize("path", [path for path in SCENES if names(path) not in LONG], ids=names)
def test_looking_changes_nothing(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compare(path, shortened(path), tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("path", SCENES, ids=names)
def test_looking_changes_nothing_in_a_whole_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compare(path, [], tmp_path, monkeypatch)
