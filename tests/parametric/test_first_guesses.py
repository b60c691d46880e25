"""First guesses of windows from neighbouring points of a study: fewer iterations, the same results."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import api, load_scene, sweep
from latin_fmu.latin.solver import COLD
from latin_fmu.parametric.point import FirstGuesses

SCENE = Path(__file__).parents[2] / "models" / "two_specimen_crushing" / "scene.toml"
FRICTION = "interface.crush.friction_coefficient"
WHOLE = (
    "substructure.lower.box.elements=[3,3,3]",
    "substructure.upper.box.elements=[3,3,3]",
    "time.step=0.3e-6",
    "solver.window=whole",
    "solver.start=zero",
)
TWELVE = f"{FRICTION}=0.1:0.34:12"


def test_guesses_halve_the_iterations_of_a_study() -> None:
    """12 points in one window each: at most half the iterations of cold starts, results within the tolerance 1e-3."""
    cold, guessed = (sweep(SCENE, [TWELVE], settings=WHOLE, guesses=guesses) for guesses in (False, True))
    assert cold["converged"].values.all()
    assert guessed["converged"].values.all()
    assert guessed["guessed"].values.sum() == 11
    assert guessed["iterations"].sum() <= 0.5 * cold["iterations"].sum()
    assert guessed["passes"].sum() <= 0.5 * cold["passes"].sum()
    for name in ("peak_force", "impulse"):
        np.testing.assert_allclose(guessed[name], cold[name], rtol=2e-3)


@pytest.mark.parametrize("start", ["zero", "sequential"])
def test_guesses_lead_to_the_same_answer(start: str) -> None:
    """At a tight tolerance, from guesses and from cold starts."""
    settings = (
        *WHOLE,
        f"solver.start={start}",
        "time.step=0.6e-6",
        "solver.tolerance=1e-7",
        "solver.max_iterations=1000",
    )
    vary = {FRICTION: [0.1, 0.15, 0.2, 0.3]}
    cold, guessed = (
        sweep(SCENE, vary, settings=settings, guesses=guesses, histories=True) for guesses in (False, True)
    )
    assert guessed["guessed"].values.tolist() == [0, 1, 1, 1]
    assert guessed["converged"].values.all()
    scale = float(np.abs(cold["force"]).max())
    np.testing.assert_allclose(guessed["force"], cold["force"], atol=1e-6 * scale, rtol=0)
    np.testing.assert_allclose(guessed["friction_work"], cold["friction_work"], rtol=1e-5)


def test_windows_of_one_instant_take_no_guesses() -> None:
    study = sweep(SCENE, {FRICTION: [0.1, 0.2]}, settings=(*WHOLE, "solver.window=1"))
    assert study["guessed"].values.tolist() == [0, 0]


class _Wrong:
    """First guesses far from any solution."""

    def __init__(self, size: float) -> None:
        self.size, self.kept = size, list[int]()

    def first_guess(self, first: int, n: int, n_flat: int) -> tuple[Any, Any]:
        """Random fields."""
        random = np.random.default_rng(first)
        return self.size * random.standard_normal((n, n_flat)), random.standard_normal((n, n_flat))

    def keep(self, first: int, f_hat: Any, w_hat: Any) -> None:
        """Note the window."""
        assert f_hat.shape == w_hat.shape
        self.kept.append(first)


@pytest.mark.parametrize(("size", "iterations"), [(1e8, 500), (1e30, 40)])
def test_a_bad_guess_costs_iterations_but_no_answer(size: float, iterations: int) -> None:
    """Windows that do not converge from a guess start again without it, as a run without guesses would."""
    scene = load_scene(
        SCENE, [*WHOLE, "solver.window=25", "solver.tolerance=1e-5", f"solver.max_iterations={iterations}"]
    )
    wrong = _Wrong(size)
    own, other = api.solve(scene), api.solve(scene, fields=wrong)
    assert own.converged
    assert other.converged
    assert wrong.kept == [1, 26, 51, 76]
    again = [COLD in window.fallbacks for window in other.windows]
    assert again == [size > 1e20] * 4
    traction = own.interfaces["crush"].traction
    if all(again):
        np.testing.assert_array_equal(other.interfaces["crush"].traction, traction)
    else:
        # friction at points that both planes of symmetry hold is any within the cone: only random guesses change it
        forces = [run.interfaces["crush"].normal_resultant() for run in (own, other)]
        assert np.abs(forces[1] - forces[0]).max() <= 2e-4 * forces[0].max()


def _studied(points: list[float], fields: list[Any], cost: float = 1.0) -> FirstGuesses:
    """Guesses after points at these places, with these fields."""
    guesses = FirstGuesses()
    for i, (place, field) in enumerate(zip(points, fields, strict=True)):
        guesses.begin((i,), [place])
        guesses.first_guess(1, 2, 3)
        guesses.keep(1, np.full((2, 3), field), np.full((2, 3), 2.0 * field))
        guesses.end(cost, True)
    return guesses


def test_fields_that_depend_linearly_on_the_parameter_are_continued_exactly() -> None:
    guesses = _studied([0.0, 0.1, 0.3], [5.0, 6.0, 8.0])
    guesses.begin((3,), [0.4])
    guess = guesses.first_guess(1, 2, 3)
    assert guess is not None
    np.testing.assert_allclose(guess[0], 9.0, rtol=1e-12)
    np.testing.assert_allclose(guess[1], 18.0, rtol=1e-12)
    assert guesses.used
    assert guesses.first_guess(7, 2, 3) is None  # another window
    assert guesses.first_guess(1, 2, 4) is None  # another mesh


def test_the_nearest_point_serves_where_there_is_no_line() -> None:
    guesses = FirstGuesses()
    for point, place, field in (((0, 0), [0.0, 0.0], 1.0), ((0, 1), [0.0, 0.1], 3.0)):
        guesses.begin(point, place)
        guesses.keep(1, np.full((2, 3), field), np.full((2, 3), field))
        guesses.end(1.0, True)
    guesses.begin((1, 1), [0.1, 0.1])
    guess = guesses.first_guess(1, 2, 3)
    assert guess is not None
    np.testing.assert_array_equal(guess[0], 3.0)


def test_guesses_that_cost_more_than_cold_starts_are_given_up_for_a_while() -> None:
    guesses = FirstGuesses()
    used = []
    for i in range(30):
        guesses.begin((i,), [0.1 * i])
        guesses.first_guess(1, 2, 3)
        used.append(guesses.used)
        guesses.keep(1, np.zeros((2, 3)), np.zeros((2, 3)))
        guesses.end(5.0 if guesses.used else 2.0, True)
    assert used[:6] == [False, True, True, True, True, False]
    assert 0 < sum(used[5:]) <= 2


def test_points_that_did_not_converge_give_no_guess() -> None:
    guesses = FirstGuesses()
    guesses.begin((0,), [0.0])
    guesses.keep(1, np.zeros((2, 3)), np.zeros((2, 3)))
    guesses.end(1.0, False)
    guesses.begin((1,), [0.1])
    assert guesses.first_guess(1, 2, 3) is None
