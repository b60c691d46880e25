"""Parametric studies: grid, points, operators used again, interruption, failures, processes, file and figure."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from latin_fmu import InputError, SceneError, SolverError, api, building, cli, load_scene, scene_from_dict, solve, sweep
from latin_fmu.assembly import interfaces, problem
from latin_fmu.assembly.models import KeptOperators
from latin_fmu.parametric import study as study_module
from latin_fmu.parametric.point import parameters_of, read_parameter, to_and_fro
from latin_fmu.propagator import direct
from latin_fmu.results.interface_fields import slip_in_contact

SCENE = Path(__file__).parents[2] / "models" / "two_specimen_crushing" / "scene.toml"
TINY = (
    "substructure.lower.box.elements=[2,2,2]",
    "substructure.upper.box.elements=[2,2,2]",
    "time.step=1e-6",
    "output.energy=true",
)
FRICTION = "interface.crush.friction_coefficient"
PRESSURE = "load.press.pressure"
NAMES = {FRICTION: "interface_crush_friction_coefficient", PRESSURE: "load_press_pressure"}
"""Of parameters in a study, by their keys."""


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Scenes (as text) that are solved in this process, in order."""
    texts: list[str] = []
    original = api.solve

    def counting(scene: Any, **options: Any) -> Any:
        texts.append(scene.text())
        return original(scene, **options)

    monkeypatch.setattr(api, "solve", counting)
    return texts


# -- the grid ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=-0.1:0.2:4", (-0.1, 0.0, 0.1, 0.2)),  # without round-off: -1e-17 would be refused as negative
        ("a.b=1:5:3", (1, 3, 5)),
        ("a.b=1:2:3", (1.0, 1.5, 2.0)),
        ("a.b=1e5,2e5", (1e5, 2e5)),
        ("a.b=hht, newmark", ("hht", "newmark")),
        ("a.b=[1.0, 0.0],[2.0, 0.0]", ([1.0, 0.0], [2.0, 0.0])),
        ('a.b="x:1:2"', ("x:1:2",)),
    ],
)
def test_values_of_a_parameter(text: str, values: tuple[Any, ...]) -> None:
    parameter = read_parameter(text)
    assert parameter.key == "a.b"
    assert parameter.values == values
    assert [repr(v) for v in parameter.values] == [repr(v) for v in values]  # types and signs of zeros too


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        (["a.b"], "no parameter with values"),
        (["a.b=0:1:1"], "2 to 20000"),
        (["a.b=0:1:99999999999999"], "2 to 20000"),
        (["a.b=x:1:3"], "two numbers"),
        (["a.b=0:1e999:3"], "two numbers"),
        (["a.b=1,1"], "given twice"),
        (["a.b=1,2", "a.b=3,4"], "given twice"),
        (["a.b=0:1:1000", "c.d=0:1:1000"], "1000000 points (1000 x 1000)"),
        ([], "number of parameters"),
    ],
)
def test_bad_parameters_are_refused(vary: list[str], words: str) -> None:
    with pytest.raises(InputError) as caught:
        parameters_of(vary)
    assert words in str(caught.value)


def test_points_follow_their_neighbours() -> None:
    points = list(to_and_fro([2, 3, 4]))
    assert sorted(points) == list(np.ndindex(2, 3, 4))
    assert all(np.abs(np.subtract(a, b)).sum() == 1 for a, b in pairwise(points))


def test_an_unknown_key_is_refused_before_anything_is_solved(solved: list[str]) -> None:
    with pytest.raises(SceneError, match="frictoin"):
        sweep(SCENE, ["interface.crush.frictoin=0:1:3"], settings=TINY)
    assert not solved


# -- points -----------------------------------------------------------------------------------------------------------
def test_quantities_are_those_of_runs_of_their_own() -> None:
    study = sweep(SCENE, {FRICTION: [0.0, 0.3], PRESSURE: np.array([1e8, 2e8])}, settings=TINY, histories=True)
    assert study["impulse"].dims == (*NAMES.values(), "interface")
    assert {study[name].attrs["scene_key"] for name in NAMES.values()} == set(NAMES)
    assert study["force"].dims[-1] == "component"
    for point in ({FRICTION: 0.0, PRESSURE: 2e8}, {FRICTION: 0.3, PRESSURE: 1e8}):
        solution = solve(load_scene(SCENE, [*TINY, *(f"{key}={value}" for key, value in point.items())]))
        report, history = solution.report(), solution.interfaces["crush"]
        one = study.sel({NAMES[key]: value for key, value in point.items()}).sel(interface="crush")
        assert float(one["peak_force"]) == report["interfaces"]["crush"]["peak_force"]
        slid = np.linalg.norm(slip_in_contact(history, solution.time), axis=2)
        assert float(one["largest_slip"]) == slid.max() > 0.0
        np.testing.assert_array_equal(one["normal_force"], history.normal_resultant())
        np.testing.assert_array_equal(one["force"], history.force())
        assert solution.energy is not None
        assert float(one["energy"].sel(energy_term="elastic")) == solution.energy["elastic"][-1]
        assert float(one["iterations"]) == sum(report["iterations"])
        assert str(one["message"].values) == solution.status
    assert (study["friction_work"] > 0.0).values.ravel().tolist() == [False, False, True, True]
    assert study["converged"].values.all()


def test_a_point_that_fails_is_kept_with_its_sentence() -> None:
    study = sweep(SCENE, {FRICTION: [0.2, -1.0, 0.1]}, settings=TINY)
    assert study["state"].values.tolist() == [0, 2, 0]
    assert str(study["message"].values[1]).startswith(f"{FRICTION}: ")
    assert np.isnan(study["peak_force"].values[1]).all()
    assert np.isfinite(study["peak_force"].values[[0, 2]]).all()


def test_a_point_that_does_not_converge_is_marked() -> None:
    study = sweep(SCENE, {"solver.max_iterations": [1, 200]}, settings=TINY)
    assert study["state"].values.tolist() == [1, 0]
    assert study["converged"].values.tolist() == [0, 1]
    assert "not converged" in str(study["message"].values[0])
    assert np.isnan(study["impulse"].values[0]).all()  # it stopped at the first instant


# -- operators --------------------------------------------------------------------------------------------------------
@pytest.fixture
def factorised(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the substructures that were factorised."""
    names: list[str] = []
    original: Callable[..., Any] = direct.build_operators

    def counting(model: Any, *others: Any) -> Any:
        names.append(model.name)
        return original(model, *others)

    monkeypatch.setattr(direct, "build_operators", counting)
    return names


@pytest.mark.parametrize(
    ("vary", "count"),
    [
        ({FRICTION: [0.05, 0.1, 0.2], PRESSURE: [1e8, 2e8]}, 2),
        ({FRICTION: [0.0, 0.1, 0.2]}, 4),  # without friction one component, with it three
        ({"interface.crush.preload": [0.0, 1e6, 2e6]}, 2),
        ({"load.press.law.duration": [8e-6, 9e-6, 10e-6]}, 2),
        ({"material.steel.young_modulus": [200e9, 210e9]}, 3),  # of the steel one each, of the aluminium one
        ({"time.instants": [30, 60]}, 4),
    ],
)
def test_operators_are_factorised_once_where_no_parameter_enters_them(
    factorised: list[str], vary: dict[str, list[Any]], count: int
) -> None:
    settings = [s for s in TINY if not s.startswith("time")] if "time.instants" in vary else TINY
    tables = load_scene(SCENE, settings).tables()
    if "time.instants" in vary:
        tables["time"] = {"end": 30e-6, "instants": 30}
    study = sweep(scene_from_dict(tables, SCENE.parent), vary)
    assert study["converged"].values.all()
    assert len(factorised) == count, factorised


@pytest.mark.parametrize(
    ("vary", "counts"),
    [
        ({FRICTION: [0.05, 0.1], PRESSURE: [1e8, 2e8]}, {"conditions_on": 2, "_placed": 1, "_trace": 2}),
        ({"interface.crush.gap": [0.0, 1e-6, 2e-6]}, {"conditions_on": 2, "_placed": 1, "_trace": 2}),
        ({"boundary.lower_x.face": ["lower.xmin", "lower.xmax"]}, {"conditions_on": 3, "_placed": 2, "_trace": 2}),
    ],
)
def test_nothing_is_discretised_twice(
    monkeypatch: pytest.MonkeyPatch, vary: dict[str, list[Any]], counts: dict[str, int]
) -> None:
    """Conditions of bodies, points of interfaces and traces are made anew where what they follow from changes."""
    made: list[str] = []
    for module, name in ((building, "conditions_on"), (interfaces, "_placed"), (problem, "_trace")):
        original: Callable[..., Any] = getattr(module, name)

        def counting(*given: Any, _of: Callable[..., Any] = original, _name: str = name) -> Any:
            made.append(_name)
            return _of(*given)

        monkeypatch.setattr(module, name, counting)
    study = sweep(load_scene(SCENE, TINY), vary)
    assert (study["state"] < 2).all()
    assert {name: made.count(name) for name in counts} == counts


@pytest.mark.parametrize(
    "changes",
    [
        ("material.steel.young_modulus=190e9",),
        ("material.steel.density=7000.0",),
        ("substructure.upper.box.size=[0.01,0.01,0.012]",),
        ("boundary.lower_base.type=fixed",),
        ("boundary.lower_x.face=lower.xmax",),
        ("interface.crush.sides=['upper.zmin','lower.zmax']",),
        ("interface.crush.points_from=E",),
        ("time.step=2e-6",),
        ("time.scheme=generalized_alpha",),
        ("solver.precision=float32",),
        ("time.quasi_static=true", "time.step=6e-6", "solver.tolerance=1e-5"),
        ("time.start=static", "load.press.law.type=constant"),
        (f"{FRICTION}=0.4", f"{PRESSURE}=5e7", "substructure.upper.initial_velocity=[0.0,0.0,-1.0]"),
    ],
)
def test_kept_operators_never_change_an_answer(changes: tuple[str, ...]) -> None:
    """Runs after a run of another scene are equal to the last bit to runs of their own."""
    kept = KeptOperators()
    solve_kept = lambda scene: api.solve(scene, kept=kept)  # noqa: E731
    solve_kept(load_scene(SCENE, TINY))
    scenes = [load_scene(SCENE, [*TINY, *_without_law(changes)]), load_scene(SCENE, TINY)]
    for scene in scenes * 2:
        own, again = solve(scene), solve_kept(scene)
        np.testing.assert_array_equal(own.interfaces["crush"].traction, again.interfaces["crush"].traction)
        np.testing.assert_array_equal(own.interfaces["crush"].velocity, again.interfaces["crush"].velocity)


@pytest.mark.parametrize(
    ("changes", "count"),
    [
        ((f"{FRICTION}=0.3", "load.press.law={type = 'half_sine', duration = 8e-6}"), 2),
        ((f"{PRESSURE}=5e7",), 1),  # the Ritz vectors depend on the loads
        (("substructure.upper.initial_velocity=[0.0,0.0,-1.0]",), 1),
        (("solver.propagator={type='reduced', modes=20}",), 0),
    ],
)
def test_kept_modes_never_change_an_answer(changes: tuple[str, ...], count: int) -> None:
    kept, settings = KeptOperators(), (*TINY, "solver.propagator=reduced")
    api.solve(load_scene(SCENE, settings), kept=kept)
    before = kept.propagators
    scene = load_scene(SCENE, [*settings, *changes])
    again = api.solve(scene, kept=kept)
    assert [a.operators is b.operators for a, b in zip(before, kept.propagators, strict=True)].count(True) == count
    np.testing.assert_array_equal(solve(scene).interfaces["crush"].traction, again.interfaces["crush"].traction)


def _without_law(changes: tuple[str, ...]) -> list[str]:
    return [c if "law.type" not in c else "load.press.law={type = 'constant'}" for c in changes]


# -- interruption, resumption, loss -----------------------------------------------------------------------------------
def test_an_interrupted_study_continues_where_it_stopped(tmp_path: Path, solved: list[str]) -> None:
    output, vary = tmp_path / "study.nc", {FRICTION: [0.0, 0.1, 0.2, 0.3], PRESSURE: [1e8, 2e8]}

    def interrupt(text: str) -> None:
        if text.startswith("3 of"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(SCENE, vary, output, settings=TINY, log=interrupt)
    assert len(solved) == 3
    assert not output.exists()
    lines: list[str] = []
    study = sweep(SCENE, vary, output, settings=TINY, log=lines.append)
    assert len(solved) == len(set(solved)) == 8
    assert lines[0] == "3 of 8 points were done before"
    assert [path.name for path in tmp_path.iterdir()] == ["study.nc"]
    whole = sweep(SCENE, vary, settings=TINY)
    written = xr.open_dataset(output)
    for name in ("peak_force", "impulse", "energy", "iterations", "state"):
        np.testing.assert_array_equal(study[name], whole[name])
        np.testing.assert_array_equal(written[name], whole[name])
    written.close()


def test_points_of_another_scene_are_refused_and_more_values_continue(tmp_path: Path, solved: list[str]) -> None:
    output = tmp_path / "study.nc"

    def interrupt(text: str) -> None:
        if text.startswith("2 of"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(SCENE, {FRICTION: [0.0, 0.1, 0.2]}, output, settings=TINY, log=interrupt)
    for settings, vary in (((*TINY, "time.end=20e-6"), FRICTION), (TINY, PRESSURE)):
        with pytest.raises(InputError, match=r"another scene.*remove this folder"):
            sweep(SCENE, {vary: [0.0, 0.1]}, output, settings=settings)
    damaged = next(path for path in (tmp_path / "study.nc.points").iterdir() if path.suffix == ".point")
    damaged.write_bytes(damaged.read_bytes()[:-3])
    study = sweep(SCENE, {FRICTION: [0.2, 0.1, 0.05, 0.0]}, output, settings=TINY)
    assert study["converged"].values.all()
    assert len(solved) == 5  # two, then two new ones and the damaged one


class _Losing:
    """Executor whose process ends at the first call of all."""

    calls = 0

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        _Losing.calls += 1
        if _Losing.calls in self.lost:
            future.set_exception(BrokenProcessPool("gone"))
        else:
            future.set_result(function(*arguments))
        return future

    lost: tuple[int, ...] = (1,)


def test_a_lost_process_costs_one_point_which_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, solved: list[str]
) -> None:
    monkeypatch.setattr(study_module, "_Here", _Losing)
    monkeypatch.setattr(_Losing, "calls", 0)
    output = tmp_path / "study.nc"
    study = sweep(SCENE, {FRICTION: [0.0, 0.1, 0.2]}, output, settings=TINY)
    assert study["state"].values.tolist() == [2, 0, 0]
    assert "has ended" in str(study["message"].values[0])
    study = sweep(SCENE, {FRICTION: [0.0, 0.1, 0.2]}, output, settings=TINY)
    assert study["state"].values.tolist() == [0, 0, 0]
    assert len(solved) == 3


def test_processes_that_never_answer_end_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_module, "_Here", _Losing)
    monkeypatch.setattr(_Losing, "calls", 0)
    monkeypatch.setattr(_Losing, "lost", tuple(range(100)))
    with pytest.raises(SolverError, match="__main__"):
        sweep(SCENE, {FRICTION: [0.0, 0.1, 0.2, 0.3]}, settings=TINY)


# -- processes, clusters ----------------------------------------------------------------------------------------------
def test_two_processes_give_the_bits_of_one() -> None:
    vary = {FRICTION: [0.0, 0.1, 0.2], PRESSURE: [1e8, 2e8]}
    lines: list[str] = []
    one, two = (sweep(SCENE, vary, settings=TINY, jobs=jobs, log=lines.append) for jobs in (1, 2))
    assert [text.partition(" ")[0] for text in lines] == 2 * [str(i) for i in range(1, 7)]  # each point once
    for name in ("peak_force", "impulse", "energy", "iterations", "state", "message"):
        np.testing.assert_array_equal(one[name], two[name])


@pytest.mark.parametrize(
    ("options", "words"),
    [({"jobs": 0}, "1 to 1024"), ({"jobs": 2, "scheduler": "tcp://127.0.0.1:1"}, "omit --jobs or --scheduler")],
)
def test_bad_options_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        sweep(SCENE, {FRICTION: [0.0, 0.1]}, settings=TINY, **options)


@pytest.mark.parametrize("vary", [{FRICTION: [0.1, float("nan")]}, [f"{FRICTION}=0.1,inf"]])
def test_values_that_are_no_finite_numbers_are_refused(vary: Any) -> None:
    with pytest.raises(InputError, match=rf"--vary {FRICTION}.*not a finite number"):
        sweep(SCENE, vary, settings=TINY)


def test_histories_need_the_same_instants() -> None:
    with pytest.raises(InputError, match="the same instants"):
        sweep(SCENE, {"time.end": [20e-6, 30e-6]}, settings=TINY, histories=True)


def test_more_processes_than_the_memory_holds_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_module, "memory_room", lambda: (50e6, "control group"))
    with pytest.raises(InputError, match=r"8 processes of about .* MB each.*at most \d processes in 50 MB"):
        sweep(SCENE, {FRICTION: np.linspace(0.0, 0.5, 8)}, settings=TINY, jobs=8)


def test_without_dask_the_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"dask.distributed is not installed.*latin-fmu\[cluster\]"):
        sweep(SCENE, {FRICTION: [0.0, 0.1]}, settings=TINY, scheduler="tcp://127.0.0.1:8786")


@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_gives_the_bits_of_this_process() -> None:
    distributed = pytest.importorskip("distributed")
    vary = {FRICTION: [0.0, 0.1, 0.2, -1.0], PRESSURE: [1e8, 2e8]}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        there = sweep(SCENE, vary, settings=TINY, scheduler=cluster.scheduler_address)
    here = sweep(SCENE, vary, settings=TINY)
    for name in ("peak_force", "impulse", "energy", "iterations", "state", "message"):
        np.testing.assert_array_equal(here[name], there[name])


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(study_module, "_WAIT", 0.5)
    for address in ("tcp://127.0.0.1:9", "nowhere at all"):
        with pytest.raises(InputError, match="cannot be reached"):
            sweep(SCENE, {FRICTION: [0.0, 0.1]}, settings=TINY, scheduler=address)


# -- command line and figure ------------------------------------------------------------------------------------------
def run(*words: str | Path) -> int:
    """Exit code of a command line."""
    return cli.main([str(word) for word in words])


def test_the_command_writes_a_study_that_can_be_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "study.nc"
    scene = ("sweep", SCENE, *(word for setting in TINY for word in ("--set", setting)), "--jobs", "1", "-o", output)
    vary = "--vary", f"{FRICTION}=0:0.6:3", "--vary", f"{PRESSURE}=1e8,2e8"
    assert run(*scene, *vary) == 0
    printed = capsys.readouterr()
    assert printed.out == f"study: {output} (6 converged)\n"
    assert f"2 of 6: {FRICTION} = 0" in printed.err
    assert "s left" in printed.err
    assert run("plot", output) == 0
    assert output.with_suffix(".png").stat().st_size > 10_000
    assert run("plot", output, "--quantity", "impulse", "-o", tmp_path / "one.svg") == 0
    assert run("plot", output, "--quantity", "impulze") == 2
    assert "did you mean 'impulse'?" in capsys.readouterr().err
    assert run(*scene, "--vary", f"{FRICTION}=0.1,-1") == 1  # one of them failed
    assert "1 converged, 1 failed" in capsys.readouterr().out


@pytest.mark.parametrize(
    "vary",
    [
        [f"{FRICTION}=-0.1:0.2:4"],
        [f"{FRICTION}=0,0.1,-1", f"{PRESSURE}=1e8:2e8:7"],
        ["time.scheme=hht,newmark", f"{FRICTION}=0,0.2", f"{PRESSURE}=1e8,2e8"],
    ],
)
def test_figures_of_one_two_and_three_parameters(vary: list[str]) -> None:
    from latin_fmu.parametric.figure import study_figure

    study = sweep(SCENE, vary, settings=(*TINY, "time.step=3e-6"))
    figure = study_figure(study)
    figure.draw_without_rendering()
    titles = [axis.get_title() for axis in figure.axes]
    assert any(title.startswith("crush: peak force") for title in titles)
    failed = int((study["state"].values == 2).sum())
    assert (f"{failed} failed" in figure.get_suptitle()) == (failed > 0)
    assert ("load.press.pressure = 100000000.0" in figure.get_suptitle()) == (len(vary) == 3)
