"""Memory: what a process took, what a run will take, what it may take; histories that are thinned."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from latin_fmu import SceneError, api, load_scene, open_results, solve
from latin_fmu.cli import main
from latin_fmu.machine import group_limits, peak_memory

from .test_cli import SCENE
from .test_process import environment, shell


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no process status here")
def test_peak_memory_is_that_of_this_process() -> None:
    """Also after it has grown by 100 MB; to the half megabyte by which the two accounts of the system may differ."""
    for size in (1, 100_000_000):
        block = np.ones(size, dtype=np.uint8)
        status = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
        assert peak_memory() == pytest.approx(1024 * int(status), abs=5e5)
        assert peak_memory() > block.nbytes


@pytest.mark.parametrize("every", [7, 40, 300])
def test_thinned_histories_are_those_of_every_so_many_instants(every: int, tmp_path: Path) -> None:
    """Also where tangential velocities are read from the substructures, and where the last instant is not kept."""
    (tmp_path / "scene.toml").write_text(SCENE)
    whole, thinned = (
        solve(load_scene(tmp_path / "scene.toml", ["time.instants=100", f"output.interfaces_every={n}"]))
        for n in (1, every)
    )
    a, b = whole.interfaces["meet"], thinned.interfaces["meet"]
    for name in ("traction", "velocity", "gap", "contact_status"):
        np.testing.assert_array_equal(getattr(a, name)[::every], getattr(b, name))
    np.testing.assert_array_equal(thinned.outcome.interface_time, whole.time[::every])
    assert len(thinned.time) == 101
    assert any("output.interfaces_every" in warning for warning in thinned.warnings)
    thinned.save(tmp_path / "a.nc")
    tree = open_results(tmp_path / "a.nc")
    np.testing.assert_array_equal(tree["interfaces/meet/time"].values, whole.time[::every])
    tree.close()
    assert "meet" in thinned.summary()


def test_energies_need_every_instant(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    with pytest.raises(
        SceneError, match=r"output\.interfaces_every: the energies of the interfaces need every instant"
    ):
        load_scene(tmp_path / "scene.toml", ["output.energy=true", "output.interfaces_every=2"])


def test_limits_of_control_groups(tmp_path: Path) -> None:
    """Of both versions, of the groups above too; no limit is none."""
    groups, root = tmp_path / "groups", tmp_path / "root"
    groups.write_text("5:cpu,memory:/a/b\n3:cpuset:/\n0::/c/d\n")
    for place, name, text in (
        ("memory/a/b", "memory.limit_in_bytes", "9223372036854771712"),
        ("memory/a", "memory.limit_in_bytes", "5000"),
        ("c", "memory.max", "7000"),
        ("c/d", "memory.max", "max"),
    ):
        (root / place).mkdir(parents=True, exist_ok=True)
        (root / place / name).write_text(f"{text}\n")
    assert sorted(group_limits(groups, root)) == [(5000, "control group"), (7000, "control group")]
    assert group_limits(tmp_path / "nothing", root) == []


@pytest.mark.parametrize(
    ("settings", "fits"),
    [
        (("time.instants=10000000", "output.fields=true", "output.stress=true"), False),
        (("time.instants=100000", "output.fields=true", "output.stress=true"), True),
        (("time.instants=300000", "output.energy=true"), True),
        (("time.instants=600000",), True),
    ],
)
def test_what_does_not_fit_is_refused_with_settings_that_do(settings, fits, tmp_path, capsys, monkeypatch):
    """In check and before a run; with the settings of the message the scene can be solved."""
    monkeypatch.setattr("latin_fmu.effects.memory.memory_room", lambda: (0.4e9, "a test"))
    (tmp_path / "scene.toml").write_text(SCENE)
    given = [word for setting in settings for word in ("--set", setting)]
    for command in ("check", "run"):
        assert main([command, str(tmp_path / "scene.toml"), *given]) == 2
        told = capsys.readouterr().err
        assert "memory: the run needs more memory than it may take (value: about " in told
        assert "allowed: 400 MB (a test)" in told
    assert ("it fits with" in told) == fits
    assert fits or "fewer instants" in told
    if fits:
        pairs = re.findall(r"(output\.\w+) = (\w+)", told.split("it fits with")[1])
        changed = [word for key, value in pairs for word in ("--set", f"{key}={value}")]
        assert main(["check", str(tmp_path / "scene.toml"), *given, *changed]) == 0
        assert "memory: about " in capsys.readouterr().out


@pytest.mark.skipif(os.name != "posix", reason="needs ulimit")
@pytest.mark.parametrize("command", ["check", "run"])
def test_a_mesh_beyond_the_limit_of_the_process(command: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    done = shell(
        tmp_path,
        f"ulimit -v 4000000; latin-fmu {command} scene.toml --set substructure.left.box.elements=[250,250,250]",
    )
    assert done.returncode == 2, done.stderr
    assert "substructure.left.box.elements: the matrices of 15625000 elements need more memory" in done.stderr
    assert "RLIMIT_AS, ulimit -v" in done.stderr
    assert "use fewer elements, e.g. [" in done.stderr


def test_a_lack_of_memory_is_a_sentence(tmp_path, capsys, monkeypatch):
    """Of any library: as it is, as cause of another error, as number or text of the system."""
    (tmp_path / "scene.toml").write_text(SCENE)
    for error in (MemoryError("Unable to allocate 43 GB"), OSError(12, "Cannot allocate memory"), ImportError("x.so")):

        def failing(*_: object, error: BaseException = error, **__: object) -> None:
            try:
                raise MemoryError
            except MemoryError as cause:
                raise error from cause

        monkeypatch.setattr(api, "solve", failing)
        assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "a.nc")]) == 5
        assert "latin-fmu: the memory does not suffice: " in capsys.readouterr().err


@pytest.mark.parametrize(
    "settings",
    [
        ("time.instants=20000",),
        ("time.instants=500", "output.fields=true", "output.stress=true", "substructure.left.box.elements=[8,8,16]"),
    ],
)
def test_predicted_memory_against_real(settings: tuple[str, ...], tmp_path: Path) -> None:
    """To a factor of two, of what the process takes after the set-up of Python and of the libraries."""
    (tmp_path / "scene.toml").write_text(SCENE)
    code = f"""
from latin_fmu import api, load_scene
from latin_fmu.assembly.build import discretise
from latin_fmu.effects.cost import Prediction
from latin_fmu.effects.memory import memory_need
from latin_fmu.machine import group_limits, peak_memory
scene = load_scene("scene.toml", {list(settings)})
before = peak_memory()
need = memory_need(Prediction(discretise(scene))).total
api.solve(scene).save("a.nc")
print((peak_memory() - before) / need)
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), check=True, capture_output=True, text=True)
    assert 0.5 < float(done.stdout) < 2.0
