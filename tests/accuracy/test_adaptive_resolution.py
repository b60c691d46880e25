"""A wanted accuracy: reached and cheap where it can be, refused honestly where it cannot."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.accuracy.adaptive_resolution import COURANT, Choice, RefinementSequence, choose, step_ratio
from latin_fmu.cli import main
from latin_fmu.commands import LIMITED, NOT_CONVERGED, SOLVER_FAILED
from latin_fmu.run_quantities import measure_solution
from latin_fmu.scene.quantity_table import IMPULSE

from ..verification.known_answers import MODELS, Known, impact_bar, shipped, thrown_bars, thrown_on_wall


def aimed(known: Known, quantity: str, target: float, limit: float = 60.0) -> tuple[Choice, float]:
    """What is chosen, and the true error of it."""
    accuracy = known.scene.accuracy.model_copy(update={"quantity": quantity})
    choice = choose(known.scene.model_copy(update={"accuracy": accuracy}), target, limit, lambda _: None)
    assert choice.solution is not None
    measured = measure_solution(known.scene, choice.solution)
    return choice, max(measured.error(q, known.exact) for q in known.quantities if q.endswith(quantity))


@pytest.mark.parametrize(("quantity", "target"), [("impulse", 0.05), ("first_contact", 0.002)])
def test_the_true_error_is_below_the_target(quantity: str, target: float) -> None:
    choice, true = aimed(impact_bar(), quantity, target)
    assert choice.reached
    assert true <= choice.error <= target
    assert choice.solution is not None
    assert choice.solution.estimate is not None
    assert choice.solution.estimate[f"wall.{quantity}"].error == choice.error
    assert choice.solution.outcome.energy is not None  # the output that the scene requests
    assert choice.resolution.mesh < 1.5


def test_the_raw_peak_of_a_force_that_jumps_is_refused() -> None:
    choice, true = aimed(impact_bar(), "peak_force_raw", 0.05)
    assert not choice.reached
    assert "use peak_force, a time-averaged force" in choice.sentence
    assert true <= choice.error


@pytest.mark.parametrize("target", [0.06, 0.2, 0.3])
@pytest.mark.parametrize("quantity", ["impulse", "first_contact", "separation", "peak_force"])
@pytest.mark.parametrize(
    "made",
    [thrown_bars, partial(thrown_on_wall, 0.2, 2.37), partial(thrown_on_wall, 1.0, 1.13)],
    ids=["bars", "wall 0.2", "wall 1"],
)
def test_the_accuracy_guaranteed_for_landing_bars_is_reached(
    made: Callable[[], Known], quantity: str, target: float
) -> None:
    """Within twelve runs, the cheap ones across included."""
    known = made()
    output = known.scene.output.model_copy(update={"energy": False})
    accuracy = known.scene.accuracy.model_copy(update={"quantity": quantity})
    lines: list[str] = []
    scene = known.scene.model_copy(update={"output": output, "accuracy": accuracy})
    choice = choose(scene, target, 60.0, lines.append)
    assert choice.reached
    assert choice.solution is not None
    measured = measure_solution(scene, choice.solution)
    assert max(measured.error(choice.quantity, known.exact), choice.error) <= target
    assert sum(" s  mesh x" in line for line in lines) <= 12


def test_what_costs_too_much_is_refused_before_it_is_run() -> None:
    choice, _ = aimed(impact_bar(), "impulse", 0.001, limit=0.5)
    assert not choice.reached
    assert "of the limit of 0.5 s for all runs" in choice.sentence
    assert choice.seconds < 1.0


def test_steps_follow_the_courant_number() -> None:
    """Impact bar: c dt / h = 30 x 0.005 / 0.1 = 1.5."""
    assert step_ratio(shipped("impact_bar")) == pytest.approx(1.5 / COURANT)
    fine = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", ["time.instants=4000"])
    assert step_ratio(fine) == 1.0


def test_runs_that_agree_on_an_order_extrapolate() -> None:
    """Impulse of the impact bar: error falls with the order 0.9; the estimate lies between 1 and 3 times the truth."""
    known = impact_bar()
    sequence = RefinementSequence(known.scene, lambda _: None)
    for factor in sequence.chain(0.71):
        sequence.run(sequence.at(factor))
    estimate = sequence.estimate(0.71, "wall.impulse")
    true = sequence.run(sequence.at(0.71)).quantities.error("wall.impulse", known.exact)
    assert not estimate.bound_only
    assert 0.4 < estimate.order < 1.3
    assert true <= estimate.error <= 3.0 * true
    assert len(sequence.runs) == 3


def test_two_runs_make_an_estimate() -> None:
    """The change of the impulse by a refinement by two (half of 35 elements are 18), a share of that of the force over
    time, and the iteration."""
    known = impact_bar()
    sequence = RefinementSequence(known.scene, lambda _: None)
    halves = [sequence.at(factor) for factor in sequence.chain(0.35)[:2]]
    estimate = sequence.estimate(0.35, "wall.impulse")
    assert len(sequence.runs) == 2
    assert not estimate.bound_only
    at = {run.resolution: run.quantities.values["wall.impulse"] for run in sequence.runs}
    fine, half = (at[resolution] for resolution in halves)
    ratio, left = sequence.at(0.35).time / sequence.at(0.18).time, 0.5 * known.scene.solver.tolerance
    runs = [next(run for run in sequence.runs if run.resolution == at).quantities for at in halves]
    beside = IMPULSE.share * runs[0].error("wall.force_rms", runs[1]) * runs[1].scales["wall.force_rms"]
    beside /= runs[0].scales["wall.force_rms"]
    assert estimate.error == pytest.approx(IMPULSE.alone * abs(fine - half) / fine / (ratio - 1.0) + beside + left)
    assert abs(fine / 200.0 - 1.0) <= estimate.error


def searched(settings: list[str]) -> tuple[Choice, list[str]]:
    """What is chosen for 5 % on the impulse of the impact bar, and the lines about runs."""
    lines: list[str] = []
    scene = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", settings)
    choice = choose(scene, 0.05, 60.0, lines.append)
    return choice, [line for line in lines if " s  mesh x" in line]


def test_the_search_makes_no_run_twice() -> None:
    """Three coarse runs are enough for 5 %, the coarsest for the estimate of the one that confirms; where the scene
    requests no output the finest one is the result, else it is made once more with its output."""
    bare, runs = searched(["output.energy=false", "output.fields=false"])
    assert bare.reached
    assert len(runs) == 3
    assert not any("with its output" in line for line in runs)
    full, again = searched(["output.energy=false", "output.fields=false", "output.surfaces=true"])
    assert len(again) == len(runs) + 1
    assert "with its output" in again[-1]
    assert full.resolution == bare.resolution
    assert full.solution is not None
    assert full.solution.surfaces


def test_the_search_grows_towards_a_sharper_target() -> None:
    """Runs with their halves, none twice; all others cost at most three times the finest."""
    lines: list[str] = []
    scene = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", ["output.energy=false", "output.fields=false"])
    choice = choose(scene, 0.01, 60.0, lines.append)
    assert choice.reached
    at = [line.split("mesh x ")[1].split(", with")[0].split(", steps x ") for line in lines if " s  mesh x" in line]
    runs = [(float(mesh), float(steps)) for mesh, steps in at]
    assert len(set(runs)) == len(runs)
    assert max(runs)[0] == pytest.approx(choice.resolution.mesh, rel=1e-2)
    assert sum(mesh * steps for mesh, steps in runs) < 4.0 * max(runs)[0] * max(runs)[1]


def test_a_tolerance_that_leaves_too_much_work_is_lowered() -> None:
    """At 0.01 every instant converges, and what is left adds up to 1.03 times the work that is allowed."""
    lines: list[str] = []
    choice = choose(latin_fmu.load_scene(MODELS / "hammer_on_plate/scene.toml"), 0.1, 60.0, lines.append)
    assert choice.reached, choice.sentence
    assert any("Reduce solver.tolerance" in line for line in lines)
    assert choice.solution is not None
    assert choice.solution.converged
    assert choice.sentence.endswith("tolerance 0.001")


def test_the_command_line_aims(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = str(MODELS / "impact_bar/scene.toml"), str(tmp_path / "a.nc")
    assert main(["run", scene, "-o", out, "--accuracy", "5%", "--json"]) == 0
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert report["accuracy_target"]["reached"] is True
    assert report["accuracy_target"]["estimated_error"] <= 0.05
    assert report["interfaces"]["wall"]["impulse"][2] == pytest.approx(200.0, rel=0.05)
    assert "mesh x" in captured.err
    settings = ["--set", "accuracy.target=0.001", "--max-cpu", "0.2"]
    # the next run is predicted to take too long, before there is a result on a machine that is busy, or a run reaches
    # the limit itself
    assert main(["run", scene, "-o", out, *settings]) in (NOT_CONVERGED, LIMITED, SOLVER_FAILED)
    captured = capsys.readouterr()
    assert "cannot be guaranteed" in captured.out + captured.err


@pytest.mark.parametrize("text", ["0", "100%", "little", "-1%", "nan"])
def test_what_is_no_accuracy_is_refused(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(MODELS / "impact_bar/scene.toml"), f"--accuracy={text}"]) == 2
    assert "--accuracy" in capsys.readouterr().err
