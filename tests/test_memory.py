"""Memory: what a process took, what a run will take, what it may take; histories that are thinned."""

from __future__ import annotations

import gc
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import SceneError, Solution, api, attempts, load_scene, march, open_results, scene_from_dict, solve
from latin_fmu.assembly.propagator_choice import PropagatorSettings, fitting
from latin_fmu.building import discretise
from latin_fmu.cli import main
from latin_fmu.cosim import Session, Settings
from latin_fmu.effects import cost
from latin_fmu.effects.cost import MemoryNeed, Prediction, memory_need
from latin_fmu.latin import interface_rows
from latin_fmu.machine import free_memory, group_limits, memory_room, peak_memory
from latin_fmu.results import dataset
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.stability.scenes import STEEL, Box, Description, column, placed, rubbing

from .cosim.scenes import blocks
from .test_checkpoint import Stopping, assert_equal
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
    """Also where tangential velocities are read from the substructures, with a part that is prescribed, and where the
    last instant is not kept."""
    driven = """[boundary.drive]
type = "velocity"
face = "left.xmin"
components = ["x"]
value = [0.01]
law = { type = "table", times = [0.0, 40e-6], values = [0.0, 1.0] }
"""
    (tmp_path / "scene.toml").write_text(SCENE + driven)
    whole, thinned = (
        solve(load_scene(tmp_path / "scene.toml", ["time.instants=100", f"output.interfaces_every={n}"]))
        for n in (1, every)
    )
    a, b = whole.interfaces["meet"], thinned.interfaces["meet"]
    for name in ("traction", "velocity", "gap", "contact_status"):
        np.testing.assert_array_equal(getattr(a, name)[::every], getattr(b, name))
    assert a.velocity[50, 0, 0, 0] != 0.0
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


def test_what_other_processes_take_is_not_free(tmp_path, capsys, monkeypatch):
    """A scene that fits in the machine and not in what is free is refused, with both numbers."""
    table = tmp_path / "meminfo"
    table.write_text("MemTotal: 24000000 kB\nMemFree: 9000000 kB\nMemAvailable:   15000000 kB\n")
    assert free_memory(table) == 15_360_000_000
    assert free_memory(tmp_path / "nothing") == 0
    for name, size in (("physical_memory", 25e9), ("free_memory", 0.4e9)):
        monkeypatch.setattr(f"latin_fmu.machine.{name}", lambda size=size: int(size))
    monkeypatch.setattr("latin_fmu.machine.group_limits", list)
    assert memory_room() == (0.4e9, "free now, of 25 GB of this machine")
    assert memory_room(now=False)[0] > 20e9
    (tmp_path / "scene.toml").write_text(SCENE)
    assert main(["check", str(tmp_path / "scene.toml"), "--set", "time.instants=3000000"]) == 2
    message = capsys.readouterr().err
    assert "the run does not fit in the available memory" in message
    assert "allowed: 400 MB (free now, of 25 GB of this machine)" in message
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    assert "available memory 400 MB (free now, of 25 GB of this machine)" in capsys.readouterr().out
    # the propagator, and the numbers of a scene, do not depend on it
    problem = discretise(load_scene(tmp_path / "scene.toml"))
    monkeypatch.setattr("latin_fmu.machine.free_memory", lambda: 1000)
    assert fitting(problem.classes, PropagatorSettings()).kind == "direct"


@pytest.mark.parametrize(
    ("settings", "fits"),
    [
        (("time.instants=10000000", "output.fields=true", "output.stress=true"), False),
        (("time.instants=100000", "output.fields=true", "output.stress=true"), True),
        (("time.instants=800000", "output.energy=true"), True),
        (("time.instants=3000000",), False),
    ],
)
def test_what_does_not_fit_is_refused_with_settings_that_do(settings, fits, tmp_path, capsys, monkeypatch):
    """In check and before a run; with the settings of the message the scene can be solved."""
    monkeypatch.setattr("latin_fmu.effects.cost.memory_room", lambda: (0.4e9, "a test"))
    (tmp_path / "scene.toml").write_text(SCENE)
    given = [word for setting in settings for word in ("--set", setting)]
    for command in ("check", "run"):
        assert main([command, str(tmp_path / "scene.toml"), *given]) == 2
        message = capsys.readouterr().err
        assert "memory: the run does not fit in the available memory (value: about " in message
        assert "allowed: 400 MB (a test)" in message
    assert ("it fits with" in message) == fits
    assert fits or "fewer instants" in message
    if fits:
        pairs = re.findall(r"(output\.\w+) = (\w+)", message.split("it fits with")[1])
        changed = [word for key, value in pairs for word in ("--set", f"{key}={value}")]
        assert main(["check", str(tmp_path / "scene.toml"), *given, *changed]) == 0
        assert "memory: about " in capsys.readouterr().out


@pytest.mark.skipif(os.name != "posix", reason="needs ulimit")
def test_a_mesh_beyond_the_limit_of_the_process(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    done = shell(
        tmp_path, "ulimit -v 4000000; latin-fmu run scene.toml --set substructure.left.box.elements=[250,250,250]"
    )
    assert done.returncode == 2, done.stderr
    assert (
        "substructure.left.box.elements: the matrices of 15625000 elements need more than the available memory"
        in done.stderr
    )
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
        assert "latin-fmu: insufficient memory: " in capsys.readouterr().err


@pytest.mark.parametrize(
    "settings",
    [
        ("time.instants=10000",),
        ("time.instants=400", "output.fields=true", "output.stress=true", "substructure.left.box.elements=[6,6,12]"),
    ],
)
def test_predicted_memory_against_real(settings: tuple[str, ...], tmp_path: Path) -> None:
    """To a factor of two, of what the process takes after the set-up of Python and of the libraries."""
    (tmp_path / "scene.toml").write_text(SCENE)
    code = f"""
from latin_fmu import api, load_scene, march
from latin_fmu.building import discretise
from latin_fmu.effects.cost import Prediction
from latin_fmu.effects.cost import memory_need
from latin_fmu.latin import interface_rows
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


def test_newton_steps_and_threads_are_in_the_predicted_memory() -> None:
    """A matrix of the active points, vectors of products where steps are long on large faces, none where they are
    short, vectors of all channels in statics; a tile of vectors for every further thread."""

    def need(step: float, elements: int = 4, **solver: Any) -> MemoryNeed:
        boxes = {name: Box(STEEL, (0.01, 0.01, 0.01), (elements, elements, 1)) for name in "ab"}
        quasi_static = solver.pop("quasi_static", False)
        time = {"end": 10 * step, "step": step, "quasi_static": quasi_static}
        scene = column(boxes, {"meet": {"friction_coefficient": 0.3}}, time, solver=solver)
        if quasi_static:
            scene["boundary"] = {n: {"type": "fixed", "face": f"{n}.{f}"} for n, f in (("a", "zmin"), ("b", "zmax"))}
        return memory_need(Prediction(discretise(scene_from_dict(scene))))

    points = 25
    assert need(1e-6).newton == 8.0 * (3 * points) ** 2
    assert need(1e-6, newton=False).newton == 0.0
    assert need(1e-3, quasi_static=True).newton == 8.0 * 101 * 6 * points
    assert need(1e-8, 16, interface_operator="sparse").newton == 0.0
    products = need(1e-3, 16, interface_operator="sparse").newton
    assert products > 8.0 * 101 * 3 * 17**2 + 8.0 * 100 * 2 * 3 * 2 * 17**2  # a factor of 100 entries a row and more
    assert need(1e-6, threads=2).threads == 8.0 * 8 * 3 * 50
    assert need(1e-6).threads == 0.0


def test_streamed_histories_are_foreseen_with_the_instants_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run of fewer instants than are kept in memory keeps all of them there."""
    monkeypatch.setattr(cost, "STREAMED", 0.0)
    blocks = column({"a": Box(STEEL), "b": Box(STEEL)}, {"meet": {}}, {"end": 1e-5, "instants": 100})
    prediction = Prediction(discretise(scene_from_dict(blocks)))
    assert memory_need(prediction, stream=True) == memory_need(prediction)
    monkeypatch.setattr(cost, "IN_MEMORY", 50)
    fewer = memory_need(prediction, stream=True).interfaces
    assert fewer == pytest.approx(50 / 101 * memory_need(prediction).interfaces)


def streamed(scene: Path, target: Path, *settings: str, **options: Any) -> Solution:
    """A run that keeps the histories of its interfaces in a file, saved."""
    solution = solve(load_scene(scene, list(settings)), stream=target.parent, **options)
    assert solution.outcome.stream is not None
    solution.save(target)
    solution.outcome.stream.close()
    return solution


@pytest.fixture
def small_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Histories go to a file although they are short, and are read in blocks of 64 instants."""
    monkeypatch.setattr(march, "STREAMED", 0.0)
    monkeypatch.setattr(march, "IN_MEMORY", 100)
    monkeypatch.setattr(interface_rows, "_BLOCK", 64)
    monkeypatch.setattr(dataset, "_WINDOWS", 50)


SUMS = (
    *("force", "impulse", "friction_power", "peak_force", "peak_force_raw", "slip", "layer_energy", "joint_power"),
    *("accumulated_slip", "friction_energy"),
)
"""Variables that are summed over time or points, in blocks."""


def assert_close(place: Path) -> None:
    """The files of the run in memory and of the streamed one agree to the last bit, but for sums."""
    a, b = (open_results(place / name) for name in ("whole.nc", "streamed.nc"))
    assert {n.path for n in a.subtree} == {n.path for n in b.subtree}
    for path in (n.path for n in a.subtree):
        first, second = (tree[path].to_dataset(inherit=False) for tree in (a, b))
        assert first.sizes == second.sizes
        for name, variable in first.variables.items():
            values, others = variable.values, second.variables[name].values
            if name in SUMS or path == "/energy":
                np.testing.assert_allclose(values, others, rtol=0, atol=1e-12 * np.abs(values).max())
            else:
                np.testing.assert_array_equal(values, others, err_msg=f"{path} {name}")
            assert variable.attrs.keys() == second.variables[name].attrs.keys()
        assert first.attrs.get("slip") == second.attrs.get("slip")
    a.close()
    b.close()


@pytest.mark.usefixtures("small_memory")
@pytest.mark.parametrize("every", [1, 3])
def test_streamed_histories_are_those_of_a_run_in_memory(every: int, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    settings = ("time.instants=300", "time.end=6e-4", f"output.interfaces_every={every}", "output.surfaces=true")
    solve(load_scene(scene, list(settings))).save(tmp_path / "whole.nc")
    part = streamed(scene, tmp_path / "streamed.nc", *settings)
    assert len(part.outcome.interface_time) <= 101
    assert any("the results file holds all histories" in w for w in part.warnings) or every == 3
    assert "meet" in part.summary()
    assert_close(tmp_path)


@pytest.mark.usefixtures("small_memory")
@pytest.mark.parametrize("settings", [(), ("time.scheme=hht",), ("solver.propagator=explicit",)])
def test_streamed_energies_and_slip_are_those_of_a_run_in_memory(settings: tuple[str, ...], tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(scene_from_dict(losses()).text())
    whole = solve(load_scene(scene, list(settings)))
    whole.save(tmp_path / "whole.nc")
    part = streamed(scene, tmp_path / "streamed.nc", *settings)
    assert len(part.outcome.interface_time) <= 101
    assert part.energy is not None
    assert all(len(values) == 301 for values in part.energy.values())
    for name in ("friction_dissipation", "layer_energy", "joint_dissipation", "ground_work", "contact_dissipation"):
        assert part.energy[name].any(), name
    assert_close(tmp_path)


@pytest.mark.usefixtures("small_memory")
def test_a_streamed_run_continues_from_a_checkpoint(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    settings = ("time.instants=300", "time.end=6e-4")
    streamed(scene, tmp_path / "whole.nc", *settings)
    for at in (71, 190):
        streamed(scene, tmp_path / "part.nc", *settings, checkpoint=Stopping(tmp_path / "c", at, every=23, resume=True))
    last = Checkpoint(tmp_path / "c", resume=True, log=lambda _: None)
    streamed(scene, tmp_path / "continued.nc", *settings, checkpoint=last)
    assert_equal(tmp_path / "whole.nc", tmp_path / "continued.nc")


def peak_of_a_run(place: Path, code: str, settings: list[str]) -> list[float]:
    """Peak memory of a process that solves three small blocks, behind the numbers that ``code`` prints."""
    (place / "scene.toml").write_text(three_blocks())
    whole = f"""
from pathlib import Path
from latin_fmu import api, load_scene, march
from latin_fmu.machine import peak_memory
scene = load_scene("scene.toml", {settings})
{code}
solution = api.solve(scene, stream=Path("."))
assert solution.converged and solution.outcome.stream is not None
solution.save("a.nc")
solution.outcome.stream.close()
print(peak_memory())
"""
    command = [sys.executable, "-c", whole]
    done = subprocess.run(command, cwd=place, env=environment(), check=True, capture_output=True, text=True)
    return [float(word) for word in done.stdout.split()]


def losses() -> Description:
    """Impacts, friction, a moving ground, an elastic layer and a viscous joint."""
    block = Box(STEEL, (0.02, 0.02, 0.01), (2, 2, 1))
    places = {"low": (0.0, 0.0), "top": (0.0, 0.01), "beside": (0.02, 0.01), "last": (0.04, 0.01)}
    layer = {"behaviour": "elastic_layer", "normal_stiffness": 1e13, "tangential_stiffness": 1e12}
    joint = {"behaviour": "viscous_joint", "normal_viscosity": 1e7, "tangential_viscosity": 1e6}
    ground = {"direction": [0.0, 0.0, 1.0], "amplitude": 0.1, "law": "constant"}
    return placed(
        {name: (block, (x, 0.0, z)) for name, (x, z) in places.items()},
        {"end": 3e-4, "instants": 300},
        interface={
            "slides": rubbing("low.zmax", "top.zmin", 0.2),
            "layer": {"sides": ["top.xmax", "beside.xmin"], **layer},
            "joint": {"sides": ["beside.xmax", "last.xmin"], **joint},
            "floor": {"sides": ["low.zmin", "ground"], "behaviour": "perfect", "ground_velocity": ground},
        },
        load={
            "press": {"face": "top.zmax", "pressure": 1e7},
            "pull": {"face": "last.xmax", "traction": [8e6, 0.0, 0.0]},
        },
        output={"energy": True, "surfaces": True},
    )


def three_blocks() -> str:
    """Text of a scene of three small blocks in a pile."""
    tables = column(
        {f"b{i}": Box(STEEL, (0.01,) * 3, (2, 2, 2)) for i in range(3)},
        {f"i{i}": {"friction_coefficient": 0.3} for i in range(2)},
        {"end": 5e-3, "instants": 50000},
        boundary={"base": {"type": "symmetry", "face": "b0.zmin"}},
        load={"push": {"face": "b2.zmax", "pressure": 1e6}},
    )
    return scene_from_dict(tables).text()


@pytest.mark.slow
def test_memory_hardly_grows_with_the_instants(tmp_path: Path) -> None:
    """From 5,000 to 20,000 instants: the rows in memory stay 500, the windows take 100 bytes each, and what the summary
    reads at once grows (20.3 MB in all); in memory the histories would take 4.4 kB per instant, 66 MB."""
    code = "march.STREAMED, march.IN_MEMORY = 0.0, 500"
    short, long = (peak_of_a_run(tmp_path, code, [f"time.instants={n}"])[0] for n in (5_000, 20_000))
    assert long - short < 25e6


@pytest.mark.slow
def test_a_million_instants_of_three_blocks_within_500_mb(tmp_path: Path) -> None:
    assert peak_of_a_run(tmp_path, "", ["time.instants=1000000", "time.end=0.1"])[0] < 500e6


@pytest.mark.slow
def test_memory_of_a_streamed_run_with_energies_and_slip_is_within_the_prediction(tmp_path: Path) -> None:
    """A hundred thousand instants; in memory its histories would take 0.7 GB."""
    code = """
from latin_fmu.building import discretise
from latin_fmu.effects.cost import Prediction
from latin_fmu.effects.cost import memory_need
print(peak_memory() + memory_need(Prediction(discretise(scene)), stream=True).total)
"""
    settings = ["time.instants=100000", "time.end=0.01", "output.energy=true", "output.surfaces=true"]
    predicted, peak = peak_of_a_run(tmp_path, code, settings)
    assert 0.5 * predicted < peak < predicted < 500e6


def test_a_disk_without_room_for_the_results_is_told_before_the_run(tmp_path, capsys, monkeypatch):
    (tmp_path / "scene.toml").write_text(SCENE)
    usage = shutil.disk_usage(tmp_path)._replace(free=200_000)
    monkeypatch.setattr("latin_fmu.results.writing.shutil.disk_usage", lambda _: usage)
    monkeypatch.setattr(attempts, "march", lambda *_, **__: pytest.fail("solved although there is no room"))
    assert (
        main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "a.nc"), "--set", "time.instants=20000"]) == 2
    )
    assert "0 MB are free, the file may need 1 MB" in capsys.readouterr().err


@pytest.mark.slow
def test_a_long_run_with_its_error_estimate_stays_below_500_mb(tmp_path: Path) -> None:
    """Three hundred thousand instants of three small blocks; the coarser run with shorter steps has half a million,
    whose histories would take 2 GB in memory."""
    (tmp_path / "scene.toml").write_text(three_blocks())
    settings = ["time.instants=300000", "time.end=0.03", "solver.tolerance=1e-6"]
    words = [word for setting in settings for word in ("--set", setting)]
    code = f"""
from latin_fmu.cli import main
from latin_fmu.machine import peak_memory
assert main(["run", "scene.toml", "-o", "a.nc", "--quiet", *{words}]) == 0
print(peak_memory())
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment(), check=True, capture_output=True, text=True
    )
    assert float(done.stdout.split()[-1]) < 500e6


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no process status here")
def test_memory_is_given_back_after_a_run(tmp_path: Path) -> None:
    """In a process that goes on: after four runs whose histories take 44 MB each it is as large as after the second."""
    (tmp_path / "scene.toml").write_text(three_blocks())
    code = """
import gc
from pathlib import Path
from latin_fmu import load_scene, solve
scene = load_scene("scene.toml", ["time.instants=10000", "time.end=1e-3"])
for _ in range(4):
    solve(scene)
    gc.collect()
    print(4096 * int(Path("/proc/self/statm").read_text().split()[1]))
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), check=True, capture_output=True, text=True)
    _, second, *_, last = (int(word) for word in done.stdout.split())
    assert last < second + 20e6


LEFT = ("Image", "Assembly", "Run", "DirectPropagator", "CholeskyFactor", "Recorder", "SegmentedRun")
"""Types of what a solution needs and gives back."""
KINDS_OF_RUN = {
    "implicit": {},
    "explicit": {"solver": {"propagator": "explicit"}},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 10}}},
    "windows": {"solver": {"window": 4}},
    "static start": {"time": {"end": 2e-6, "step": 0.2e-6, "start": "static"}},
    "quasi-static": {"time": {"end": 2e-6, "step": 0.2e-6, "quasi_static": True}},
    "energies": {"output": {"energy": True, "fields": True}},
}


def left_behind(make: Callable[[], object]) -> list[str]:
    """Names of ``LEFT`` of which there are more objects after a second call than after the first, the collector off."""
    counts = []
    gc.collect()
    gc.disable()
    try:
        for _ in range(2):
            make()
            names = [type(thing).__name__ for thing in gc.get_objects()]
            counts.append({name: names.count(name) for name in LEFT})
    finally:
        gc.enable()
    return [name for name in LEFT if counts[1][name] > counts[0][name]]


@pytest.mark.parametrize("kind", KINDS_OF_RUN)
def test_a_solution_leaves_nothing_behind(kind: str) -> None:
    """Memory is given back with the solution, without the collector of cycles: in a study of many runs it would come
    late, as it counts objects and not bytes."""
    scene = blocks(**{"time": {"end": 2e-6, "step": 0.2e-6}, **KINDS_OF_RUN[kind]})
    assert left_behind(lambda: solve(scene)) == []


@pytest.mark.parametrize("mode", [0, 1])
def test_a_session_leaves_nothing_behind(mode: int) -> None:
    def session() -> None:
        made = Session(blocks(), Settings(mode=mode))
        made.initialize()
        assert made.step(0.0, 1e-6)
        if mode == 0:
            made.derivative(["interface.crush.normalForce"], ["load.press.value"], [1.0])
        made.close()

    assert left_behind(session) == []
