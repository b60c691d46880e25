"""Checkpoints: a run that is stopped or killed and continued gives the bits of one that is not."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import InputError, SolverError, load_scene, open_results, solve
from latin_fmu.cli import main
from latin_fmu.latin import state_serialization
from latin_fmu.results import checkpoint as module
from latin_fmu.results import writing
from latin_fmu.results.checkpoint import Checkpoint

from .test_cli import SCENE
from .test_process import MAIN, environment

MODELS = Path(__file__).parents[1] / "models"
MORE = [getattr(signal, name) for name in ("SIGHUP", "SIGQUIT", "SIGXCPU", "SIGUSR1") if hasattr(signal, name)]
MEASURED = ("cpu_seconds", "peak_memory", "history", "cost")  # attributes that differ between any two runs
LONG = ["--set", "time.end=4e-3", "--set", "time.instants=2000", "--set", "output.energy=true", "--no-estimate"]
LONG += ["--set", "output.fields=true", "--set", "output.stress=true", "--set", "output.every=30"]


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scene file in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a long run that was not stopped."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "scene.toml").write_text(SCENE)
    assert main(["run", str(folder / "scene.toml"), "-o", str(folder / "whole.nc"), "--quiet", *LONG]) == 0
    return folder / "whole.nc"


def contents(file: Path) -> dict[str, Any]:
    """Every variable and attribute of a results file, as bytes, but for what is measured."""
    tree = open_results(file)
    found: dict[str, Any] = {}
    for node in tree.subtree:
        data = node.to_dataset(inherit=False)
        found |= {f"{node.path}@{key}": repr(value) for key, value in data.attrs.items()}
        for name, variable in data.variables.items():
            values = variable.values
            stored = values.tobytes() if values.dtype.kind != "O" else repr(values.tolist()).encode()
            found[f"{node.path}/{name}"] = (variable.dims, values.shape, values.dtype.str, stored, repr(variable.attrs))
    tree.close()
    return {key: value for key, value in found.items() if not key.split("@")[-1].startswith(MEASURED)}


def assert_equal(first: Path, second: Path) -> None:
    """Whether two results files hold the same bits."""
    a, b = contents(first), contents(second)
    assert a.keys() == b.keys()
    assert not [key for key in a if a[key] != b[key]]


class Stopping(Checkpoint):
    """Stops a run at the first check from an instant on."""

    def __init__(self, path: Path, at: int, **options: Any) -> None:
        super().__init__(path, stop=lambda: self.seen >= at, log=lambda _: None, **options)
        self.seen, self.written = 0, [0]

    def check(self, run: Any) -> bool:
        self.seen = run.assembly.instant
        before = self._last
        stopped = super().check(run)
        if self._last != before:
            self.written.append(self._last)
        return stopped


BARS: tuple[str, ...] = ("time.instants=200", "time.end=4e-4")
KINDS: dict[str, tuple[str, ...]] = {
    "contact": BARS,
    "energies, fields, stress": (*BARS, "output.energy=true", "output.fields=true", "output.stress=true"),
    "windows of five instants": (*BARS, "solver.window=5", "output.every=5"),
    "sequential start": (*BARS, "solver.window=20", "solver.start=sequential"),
    "explicit": ('solver.propagator="explicit"', "time.instants=210", "time.end=4e-4"),
    "reduced": (*BARS, 'solver.propagator={type="reduced", modes=3}'),
    "modal": (*BARS, 'solver.propagator={type="modal", highest=2e4}', "output.energy=true", "output.fields=true"),
    "conjugate gradients": (*BARS, 'solver.propagator="cg"'),
    "bonded": (*BARS, "interface.meet.behaviour=perfect"),
    "sensor": (*BARS, 'sensor.end={substructure="left", point=[0.0, 0.0, 0.0]}', "output.energy=true"),
    "two_specimen_crushing": ("output.every=9",),
    "two_specimen_crushing: fall-backs": ("solver.max_iterations=4", "solver.tolerance=1e-6"),
    "gripped_bar": (),
    "pressed_plates": (),
}
LONGEST = "pressed_plates"


@pytest.mark.parametrize("kind", [*(k for k in KINDS if k != LONGEST), pytest.param(LONGEST, marks=pytest.mark.slow)])
def test_stopped_and_continued_runs_have_the_same_bits(kind: str, scene: Path) -> None:
    """Twice stopped, at instants that no call of the kernels ends at by itself."""
    model = MODELS / kind.split(":")[0] / "scene.toml"
    described = load_scene(model if model.exists() else scene, list(KINDS[kind]))
    solve(described).save("whole.nc")
    for share in (0.2, 0.55):
        at = round(share * described.time.n_step) + 1
        part = solve(described, checkpoint=Stopping(Path("c"), at, every=23, resume=True))
        assert not part.complete
        assert "interrupted at t = " in part.status
    checkpoint = Checkpoint("c", resume=True, log=lambda _: None)
    solve(described, checkpoint=checkpoint).save("continued.nc")
    checkpoint.remove()
    assert_equal(Path("whole.nc"), Path("continued.nc"))
    assert sorted(path.name for path in Path().iterdir()) == ["continued.nc", "scene.toml", "whole.nc"]


@pytest.mark.parametrize(("every", "window"), [(1, 1), (17, 1), (20, 5), (23, 5)])
def test_at_most_so_many_instants_are_lost(every: int, window: int, scene: Path) -> None:
    described = load_scene(scene, ["time.instants=200", f"solver.window={window}"])
    checkpoint = Stopping(Path("c"), 1000, every=every)
    solve(described, checkpoint=checkpoint)
    assert np.diff(checkpoint.written).max() <= every
    assert checkpoint.written[-1] == 200


def interrupted(scene: Path, *settings: str) -> Path:
    """A checkpoint of a run that was stopped."""
    solve(load_scene(scene, list(settings)), checkpoint=Stopping(Path("c"), 11, every=4))
    return Path("c")


def refused(scene: Path, *settings: str) -> str:
    """How a checkpoint is refused."""
    with pytest.raises((SolverError, InputError)) as caught:
        solve(load_scene(scene, list(settings)), checkpoint=Checkpoint("c", resume=True))
    return str(caught.value)


def test_a_checkpoint_of_another_scene_version_or_machine(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    interrupted(scene)
    assert "another scene" in refused(scene, "load.push.pressure=2e6")
    with monkeypatch.context() as changed:
        changed.setattr(module, "machine", lambda: "abacus, big-endian")
        assert "another kind of machine" in refused(scene)
        assert "here 'abacus, big-endian'" in refused(scene)
    with monkeypatch.context() as changed:
        changed.setattr(state_serialization, "package_version", lambda: "9.9")
        assert "another version of latin_fmu" in refused(scene)
        assert "9.9" in refused(scene)
    assert solve(load_scene(scene), checkpoint=Checkpoint("c", resume=True, log=lambda _: None)).complete


def test_a_damaged_checkpoint(scene: Path) -> None:
    """Flipped bits and cuts in both files, of a run with one generation."""
    interrupted(scene)
    Path("c.previous").unlink(missing_ok=True)
    draw = random.Random(16)
    for path in (Path("c"), Path("c.histories")):
        whole = path.read_bytes()
        for _ in range(5):
            at = draw.randrange(len(whole))
            for damaged in (whole[:at], whole[:at] + bytes([whole[at] ^ (1 << draw.randrange(8))]) + whole[at + 1 :]):
                path.write_bytes(damaged)
                message = refused(scene)
                assert "cannot be used" in message, (path, at)
                assert path.name in message
        path.write_bytes(whole)
    Path("c.histories").write_bytes(Path("c.histories").read_bytes() + b"a part that was being written")
    assert solve(load_scene(scene), checkpoint=Checkpoint("c", resume=True, log=lambda _: None)).complete


def test_windows_longer_than_the_interval_are_refused(scene: Path) -> None:
    with pytest.raises(InputError, match="between two windows, which have 20 instants"):
        solve(load_scene(scene, ["solver.window='whole'"]), checkpoint=Checkpoint("c", every=5))
    assert main(["run", str(scene), "--checkpoint", "soon"]) == 2
    assert main(["run", str(scene), "--checkpoint", "0"]) == 2
    assert main(["run", str(scene), "--checkpoint", "5", "--accuracy", "10%"]) == 2


def test_a_checkpoint_that_cannot_be_written_stops_nothing(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.os, "fsync", full)
    lines: list[str] = []
    assert solve(load_scene(scene), checkpoint=Checkpoint("c", every=1, log=lines.append)).complete
    assert lines == ["the checkpoint could not be written, the run continues: [Errno 28] No space left on device"]


def test_a_second_run_on_one_checkpoint_is_refused(scene: Path) -> None:
    first = Checkpoint("c", every=5)

    class Second(Checkpoint):
        def check(self, run: Any) -> bool:
            with pytest.raises(InputError, match=r"another run uses this checkpoint \(value: process \d+\)"):
                solve(load_scene(scene), checkpoint=first)
            return super().check(run)

    assert solve(load_scene(scene, ["time.instants=3"]), checkpoint=Second("c", every=2)).complete


def test_resuming_without_a_checkpoint_begins(scene: Path) -> None:
    assert main(["run", str(scene), "-o", "a.nc", "--resume", "--checkpoint", "5", "--quiet"]) == 0
    assert not Path("a.nc.checkpoint").exists()
    assert not Path("a.nc.checkpoint.histories").exists()


def test_the_checkpoint_before_is_used_where_the_last_is_damaged(scene: Path) -> None:
    interrupted(scene)
    whole = Path("c").read_bytes()
    Path("c").write_bytes(whole[: len(whole) // 2])
    lines: list[str] = []
    assert solve(load_scene(scene), checkpoint=Checkpoint("c", resume=True, log=lines.append)).complete
    assert "the previous checkpoint is used" in lines[0]
    assert "continued from c.previous" in lines[1]


def test_a_run_that_does_not_continue_keeps_an_earlier_checkpoint(scene: Path) -> None:
    """Under a number: nothing of the earlier run is overwritten, nor removed at the end of the new one."""
    for number in (1, 2):
        interrupted(scene)
        before = {name: Path(f"c{name}").read_bytes() for name in ("", ".histories")}
        lines: list[str] = []
        solve(load_scene(scene), checkpoint=(own := Checkpoint("c", every=20, log=lines.append)))
        own.remove()
        assert len(lines) == 1
        assert f"kept as c.{number} and c.{number}.histories" in lines[0]
        assert {name: Path(f"c.{number}{name}").read_bytes() for name in before} == before
        assert not Path("c").exists()
    interrupted(scene)
    Checkpoint("c").remove()  # of a run that has written none
    assert Path("c").exists()


def test_checkpoints_follow_no_links(scene: Path) -> None:
    """Another user of the folder could have placed one that leads to a file of this user."""
    for name in ("c", "c.histories"):
        Path("victim").write_text("mine")
        Path(name).unlink(missing_ok=True)
        Path(name).symlink_to("victim")
        with pytest.raises(InputError, match="this is a link"):
            solve(load_scene(scene), checkpoint=Checkpoint("c", every=5))
        lines: list[str] = []
        stopped = Stopping(Path("c"), 20)
        stopped._log = lines.append  # written without having been asked for, as after a signal
        assert not solve(load_scene(scene, list(BARS)), checkpoint=stopped).complete
        assert "this is a link" in lines[0]
        assert Path("victim").read_text() == "mine"
        Path(name).unlink()


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_signal_that_is_ignored_stays_so(scene: Path) -> None:
    """As under nohup."""
    assert scene.exists()
    code = f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n{signalled(signal.SIGHUP, 700)}"
    process = started(code=code)
    _, errors = process.communicate(timeout=100)
    assert process.returncode == 0, errors


def test_drafts_of_killed_processes_are_removed(scene: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    stem = writing._draft_stem()
    others = [f"{stem}{os.getpid()}-a.nc", ".latin-fmu-0-other.nc", f"{stem}x.nc"]
    for name in (f"{stem}{dead.pid}-a.nc", *others):
        Path(name).write_text("")
    Path(f"{stem}{dead.pid}-folder").mkdir()
    assert main(["run", str(scene), "-o", "a.nc", "--quiet", "--no-estimate"]) == 0
    assert sorted(path.name for path in Path().glob(".latin-fmu-*")) == sorted(others)


def started(*more: str, code: str = MAIN) -> subprocess.Popen[str]:
    """A run of the command line that has begun."""
    command = [sys.executable, "-c", code, "run", "scene.toml", "-o", "a.nc", *LONG, *more]
    process = subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert process.stderr.readline() == "ready\n"
    return process


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, signal.SIGINT, *(pytest.param(int(n), marks=pytest.mark.slow) for n in MORE)]
)
def test_signals_leave_results_and_a_checkpoint(number: int, scene: Path, whole: Path) -> None:
    process = started(code=signalled(number, 700))
    out, errors = process.communicate(timeout=100)
    assert process.returncode == 128 + number, errors
    assert "Traceback" not in errors
    assert "continue with --resume" in out
    part = open_results("a.nc")
    assert part.attrs["complete"] == 0
    assert "interrupted at t = " in part.attrs["status"]
    assert 700 <= part["interfaces/meet"].sizes["time"] < 2001
    part.close()
    assert main(["run", str(scene), "-o", "a.nc", "--resume", "--quiet", *LONG]) == 0
    assert_equal(whole, Path("a.nc"))
    assert not Path("a.nc.checkpoint").exists()


def signalled(number: int, instant: int) -> str:
    """Code of a process that sends itself a signal at the first call of the recorder from an instant on."""
    return f"""
import os, sys
from latin_fmu.latin.recorder import Recorder
keep = Recorder.keep
def kept(self, *arguments, **named):
    keep(self, *arguments, **named)
    if self.n_kept > {instant}:
        print('at', self.n_kept - 1, file=sys.stderr, flush=True)
        Recorder.keep = keep
        os.kill(os.getpid(), {int(number)})
Recorder.keep = kept
{MAIN}"""


def killed(draw: random.Random, kills: int) -> Iterator[tuple[int, int]]:
    """Kill runs on one output, by turns at a random instant and after a random time: instants reached where known (else
    0), and of the checkpoint."""
    reached = 0
    for i in range(kills):
        if i % 2:
            process = started("--checkpoint", "50", "--resume")
            time.sleep(draw.uniform(0.5, 2.5))
            process.kill()
            process.communicate()
            yield 0, 0
            continue
        reached = min(reached + draw.randrange(1, 3000 // kills), 1990)
        process = started("--checkpoint", "50", "--resume", code=signalled(9, reached))
        _, errors = process.communicate(timeout=100)
        if process.returncode == 0:  # it was farther than that
            return
        assert process.returncode == -9, errors
        at = int(errors.split("at ")[-1].split()[0])
        yield at, checkpointed()


def checkpointed() -> int:
    """Instant of the checkpoint of ``a.nc``."""
    raw = Path("a.nc.checkpoint").read_bytes() if Path("a.nc.checkpoint").exists() else b""
    if not raw:
        return 0
    start = raw.index(b"LATIN-STATE")
    return int(state_serialization.decode(raw[start:], "checkpoint")["run"]["instant"])


def check_kills(scene: Path, whole: Path, kills: int) -> None:
    """Kill a run so many times, continue it, and compare."""
    done = 0
    for at, kept in killed(random.Random(16), kills):
        done += 1
        assert at - kept <= 50 or at == 0
    assert done == kills
    assert main(["run", str(scene), "-o", "a.nc", "--resume", "--quiet", *LONG]) == 0
    assert_equal(whole, Path("a.nc"))
    names = {path.name for path in Path().iterdir() if not path.name.startswith(".latin-fmu-")}  # drafts of killed runs
    assert names == {"a.nc", "scene.toml"}


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_killed_twice(scene: Path, whole: Path) -> None:
    check_kills(scene, whole, 2)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_killed_twenty_times(scene: Path, whole: Path) -> None:
    check_kills(scene, whole, 20)
