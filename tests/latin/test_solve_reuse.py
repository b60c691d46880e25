"""Substructures that are not solved for again: the same results, fewer of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.kernels import entries
from latin_fmu.kernels.instants import OPENINGS
from latin_fmu.kernels.linear_stage import linear_stage
from latin_fmu.latin.run_image import reuse_bound
from latin_fmu.latin.settings import SolverSettings
from latin_fmu.propagator.image import take_marched
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, column, half_sine
from tests.plain_kernels import call

Tables = dict[str, Any]


def stack(n: int = 8, **solver: Any) -> Tables:
    """Blocks of two materials in a row, pressed and rubbed at one end: some interfaces converge before others."""
    soft, hard = (Box(m, (0.01, 0.01, 0.01), (2, 2, 3)) for m in (ALUMINIUM, STEEL))
    press = {"face": "b0.zmin", "traction": [5e7, 0.0, 2e8], "law": half_sine(4e-6)}
    return column(
        {f"b{i}": (soft, hard)[i % 2] for i in range(n)},
        {f"i{i}": {"behaviour": "contact", "friction_coefficient": 0.3} for i in range(n - 1)},
        {"end": 12e-6, "instants": 60},
        load={"press": press},
        solver=solver,
    )


def outcome(**solver: Any) -> Any:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(stack(**solver)))
    assert solution.converged, solution.status
    return solution.outcome


def forces(result: Any) -> np.ndarray:
    return np.concatenate([history.traction.ravel() for history in result.interfaces.values()])


@pytest.mark.parametrize("compiled", [True, False])
def test_one_instant_at_a_time(compiled: bool, python_driver: Any) -> None:
    """Fewer solves, and a result that has moved by far less than tolerance."""
    if not compiled:
        python_driver()
    every, few = outcome(skip_unchanged=False), outcome(skip_unchanged=True)
    assert few.passes < 0.95 * every.passes
    assert np.linalg.norm(forces(few) - forces(every)) < 1e-4 * np.linalg.norm(forces(every))


def test_whole_window() -> None:
    """Both stop at a tolerance of 1e-3."""
    every, few = (outcome(window="whole", start="zero", skip_unchanged=skip) for skip in (False, True))
    assert few.passes < 0.95 * every.passes
    assert np.linalg.norm(forces(few) - forces(every)) < 2e-3 * np.linalg.norm(forces(every))


WINDOW = 12


def march(made: Any, begun: Any) -> Any:
    """A run of three blocks at t = 0, with room for windows of WINDOW instants."""
    return begun(made(stack(3, window=WINDOW, start="zero", skip_at_rest="off")))


def linear(run: Any, q: np.ndarray, iteration: int) -> tuple[np.ndarray, int]:
    """W (n, n_flat) for q, and the substructure-instants that it took."""
    n, image = len(q), run.image
    image.field("q", n, image.n_flat)[:] = q
    call(linear_stage, image, n, 1, iteration)
    return image.field("w", n, image.n_flat).copy(), sum(take_marched(image))


def open_window(run: Any, n: int, reuse: float) -> None:
    """Begin a window of n instants; solutions are kept where q has changed by no more than ``reuse``."""
    run.image.set({"reuse": reuse})
    run.image.call(entries.BEGIN, n, 1, OPENINGS)
    take_marched(run.image)


@pytest.mark.parametrize("n", [1, WINDOW])
def test_an_answer_to_what_has_not_changed_is_the_answer(made: Any, begun: Any, n: int) -> None:
    """Against a stage that solves for every substructure each time: the same to the last bit; what was marched is
    counted."""
    always, once = march(made, begun), march(made, begun)
    open_window(always, n, -1.0)
    open_window(once, n, 0.0)
    rng, q = np.random.default_rng(3), np.zeros((n, always.image.n_flat))
    for i, (first, block) in enumerate(((0, 0), (n - 1, 1), (n, 0), (n // 2, 2), (n // 3, 0))):
        channels = always.assembly.channels[block].ravel()
        q[first:, channels] += 1e6 * rng.normal(size=(n - first, len(channels)))
        (expected, every), (actual, asked) = linear(always, q, i), linear(once, q, i)
        np.testing.assert_array_equal(actual, expected)
        assert every == 3 * n
        if i == 0:
            assert asked == 3 * n
        elif first == n:
            assert asked == 0
        else:
            assert n - first <= asked <= n - first + 3  # a state was kept close before


def test_what_counts_as_unchanged(made: Any, begun: Any) -> None:
    """Squared changes of q in the norm of the indicator, summed over instants, up to reuse x scale x n / classes."""
    run, n = march(made, begun), WINDOW
    open_window(run, n, 1e-4)
    image, channel = run.image, int(run.assembly.channels[0].ravel()[4])
    image.field("scales", 3)[0] = 8.0
    image.field("measure", 8)[6] = 6.0  # of the best iterate: the larger of both counts
    weight = run.direction(1).weights[0, channel]
    level = 1e-4 * 8.0 * n / 3
    q = np.ones((n, image.n_flat))
    first, asked = linear(run, q, 0)
    assert asked == 3 * n  # nothing known yet
    q[1, channel] += np.sqrt(0.45 * level / weight)
    actual, asked = linear(run, q, 1)
    assert asked == 0
    np.testing.assert_array_equal(actual, first)
    q[9, channel] += np.sqrt(0.5 * level / weight)  # 0.95 of what counts
    assert linear(run, q, 1)[1] == 0
    q[9, channel] += np.sqrt(0.2 * level / weight)
    actual, asked = linear(run, q, 1)
    assert asked == n - 8  # from the state kept before instant 9
    np.testing.assert_array_equal(actual[:9], first[:9])
    assert (actual[9:] != first[9:]).any()
    open_window(run, n, 1e-4)
    assert linear(run, q, 1)[1] == 3 * n


def test_a_change_at_the_last_member_of_a_class_counts(made: Any, begun: Any) -> None:
    """The class of the second and fourth block; one channel of the fourth changes."""
    run, n = begun(made(stack(5, window=WINDOW, start="zero", skip_at_rest="off"))), WINDOW
    c = next(i for i, p in enumerate(run.image.propagators) if len(p.names) == 2)
    open_window(run, n, 0.0)
    q = np.ones((n, run.image.n_flat))
    assert linear(run, q, 0)[1] == 5 * n
    q[:, run.assembly.channels[c].ravel()[-1]] += 1.0
    assert linear(run, q, 1)[1] >= 2 * n


@pytest.mark.parametrize(("change", "asked"), [(0.9, 0), (1.1, 1)])
def test_one_instant_counts_by_its_own(made: Any, begun: Any, change: float, asked: int) -> None:
    run = march(made, begun)
    open_window(run, 1, 1e-4)
    channel = int(run.assembly.channels[0].ravel()[4])
    run.image.field("scales", 3)[0] = 8.0
    q = np.ones((1, run.image.n_flat))
    assert linear(run, q, 0)[1] == 3
    q[0, channel] += np.sqrt(change * 1e-4 * 8.0 / 3 / run.direction(1).weights[0, channel])
    assert linear(run, q, 1)[1] == asked


def test_settings() -> None:
    assert reuse_bound(SolverSettings(tolerance=1e-3, force_tolerance=1e-2)) == pytest.approx(1e-10)
    assert reuse_bound(SolverSettings(tolerance=1e-3, force_tolerance=1e-4)) == pytest.approx(1e-14)
    assert reuse_bound(SolverSettings(skip_unchanged=False)) < 0.0
    assert reuse_bound(SolverSettings(quasi_static=True)) < 0.0
