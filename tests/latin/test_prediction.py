"""Tractions expected in the next instant, and what a run gains by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latin_fmu import load_scene
from latin_fmu.building import discretise, solver_ready
from latin_fmu.kernels.newton import LAST, N_COURSE, UNCERTAIN
from latin_fmu.kernels.prediction import EXACT, ORDER, expect
from latin_fmu.latin.outcome import Timings
from latin_fmu.latin.recorder import Recorder
from latin_fmu.latin.windows import Run
from latin_fmu.propagator.image import Image
from tests.plain_kernels import call
from tests.scenes import MODELS

SCENE = MODELS / "stacked_blocks" / "n04.toml"


def image_of(tolerance: float) -> Image:
    """The image of a run with several interfaces, at its start."""
    problem = solver_ready(discretise(load_scene(SCENE)), None)
    settings = replace(problem.settings, tolerance=tolerance)
    return Run(problem.assembly, settings, Recorder(problem.assembly, problem.output, problem.info), Timings()).image


def marched(image: Image, tractions: np.ndarray, iterations: int = UNCERTAIN + 1) -> tuple[np.ndarray, float]:
    """Change expected after these instants (n, N) of so many iterations, and the misfit."""
    f_hat = image.field("f_hat", image.n_flat)
    image.field("course", N_COURSE)[LAST] = iterations - 1
    for ended in tractions:
        call(expect, image, ended.copy())
        f_hat[:] = ended
    return image.field("ahead", image.n_flat).copy(), float(image.field("misfit", 1)[0])


def test_vibrations_are_continued() -> None:
    """As many vibrations as the fit has pairs of changes, about any mean: the next instant is known. Points without
    traction stay so."""
    image, rng, t = image_of(1e-6), np.random.default_rng(3), np.arange(2 * ORDER + 3)
    assert image.run_fields["predicted"] == 1
    shapes, mean = rng.normal(size=(2, ORDER // 2, image.n_flat)), rng.normal(size=image.n_flat) + 10.0
    waves = np.exp(1j * np.outer(t, [0.5, 1.1, 1.9][: ORDER // 2]))
    tractions = mean + waves.real @ shapes[0] + waves.imag @ shapes[1]
    tractions[-2:, ::7] = 0.0
    tractions[:-2, ::7] = 0.0
    ahead, misfit = marched(image, tractions[:-1])
    change = tractions[-1] - tractions[-2]
    np.testing.assert_allclose(ahead, change, rtol=0, atol=1e-6 * np.abs(change).max())
    assert not ahead[::7].any()
    assert misfit == pytest.approx(np.sqrt(EXACT), rel=1.0)


def test_nothing_is_expected_where_changes_do_not_follow() -> None:
    rng = np.random.default_rng(3)
    shape, noise = rng.normal(size=(2, image_of(1e-6).n_flat))
    steps = np.array([0.0, 0.0, 0.0, 1e-9, 1.0])
    cases = {
        "noise": rng.normal(size=(2 * ORDER, len(shape))),
        "no change": np.ones((ORDER, 1)) * shape,
        # the fit has coefficients of 1e9
        "first change after round-off": np.cumsum(steps)[:, None] * shape + noise,
    }
    for name, tractions in cases.items():
        ahead, misfit = marched(image_of(1e-6), tractions)
        assert misfit == 1.0, name
        assert not ahead.any(), name


def test_short_instants_expect_nothing() -> None:
    """Few iterations gain nothing, and would leave the error of the expectation."""
    waves = np.sin(0.3 * np.arange(2 * ORDER))[:, None] * np.ones(image_of(1e-6).n_flat)
    assert marched(image_of(1e-6), waves)[1] < 1.0
    assert marched(image_of(1e-6), waves, UNCERTAIN)[1] == 1.0


def test_rough_tolerances_extrapolate_nothing() -> None:
    assert image_of(1e-3).run_fields["expects"] == 0
