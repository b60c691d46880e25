"""The image of a run: search directions come and go, the memory stays."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels import entries
from latin_fmu.kernels.instants import OPENINGS
from latin_fmu.kernels.substructure import linear_response
from latin_fmu.propagator import DirectPropagator
from latin_fmu.propagator.image import Image, ImageClass
from latin_fmu.time_scheme import TimeScheme
from tests.alone import alone_of, started_alone
from tests.plain_kernels import call

Array = np.ndarray
Make = Callable[..., Any]


@pytest.fixture
def marched(model: Make, begin: Make, hht: TimeScheme) -> DirectPropagator:
    """A propagator at its first instant, before the interface forces."""
    propagator = begin([model("held")], hht)
    alone_of(propagator).predict()
    return propagator


def respond(propagator: DirectPropagator) -> Array:
    """Velocities of the channels for q = 1 with the direction that the image uses."""
    image, n = propagator.state.image, propagator.n_channel
    image.field("q", n)[:] = 1.0
    call(linear_response, image, 0, image.field("q", n), image.field("w", n))
    return image.field("w", n).copy()


def expected(propagator: DirectPropagator, k: Array) -> Array:
    """The same from dense algebra."""
    free, d = propagator.state.part("w_free", len(k)), propagator.operators.admittance
    return np.linalg.solve(np.eye(len(k)) + d * k, free + d @ np.ones(len(k)))


@pytest.mark.parametrize("between", [False, True], ids=["last", "before_another"])
def test_a_direction_set_afresh_takes_no_further_memory(marched: DirectPropagator, between: bool) -> None:
    image, rng, sizes = marched.state.image, np.random.default_rng(3), []
    for i in range(60):
        k = rng.uniform(0.1, 4.0, marched.n_channel)
        marched.bind(k)
        image.bind(-1, afresh=True)
        np.testing.assert_allclose(respond(marched), expected(marched, k), rtol=1e-10)
        if between and i == 1:
            image.bind(-2)
        sizes.append(image.fixed.size)
    assert sizes[-1] == sizes[2]


def test_a_propagator_alone_takes_no_further_memory(marched: DirectPropagator) -> None:
    rng, sizes = np.random.default_rng(3), []
    for _ in range(60):
        marched.bind(rng.uniform(0.1, 4.0, marched.n_channel))
        alone_of(marched).respond(np.ones((marched.n_channel, 1)))
        sizes.append(marched.state.image.fixed.size)
    assert sizes[-1] == sizes[1]


def test_directions_placed_before_are_kept(marched: DirectPropagator) -> None:
    """Bit for bit, whatever was placed since."""
    image, rng, first = marched.state.image, np.random.default_rng(4), []
    for key in range(10, 16):
        marched.bind(rng.uniform(0.1, 4.0, marched.n_channel))
        image.bind(key)
        first.append(respond(marched))
        image.bind(-1, afresh=True)
        np.testing.assert_array_equal(respond(marched), first[-1])
    for key, response in enumerate(first, 10):
        image.bind(key)
        np.testing.assert_array_equal(respond(marched), response)


def free_velocity(propagator: DirectPropagator) -> Array:
    """Velocities of the channels without interface forces, computed again by the kernels."""
    propagator.state.image.call(entries.BEGIN, 1, 1, OPENINGS)
    return propagator.state.part("w_free", propagator.n_channel).copy()


def test_a_run_continues_on_a_copy_of_its_blocks(marched: DirectPropagator) -> None:
    """The records hold positions: nothing is read where the blocks were before."""
    image, first = marched.state.image, free_velocity(marched)
    old, image.fixed, image.moving = (image.fixed, image.moving), image.fixed.copy(), image.moving.copy()
    image._write_records()
    for block in old:
        block[:] = np.nan
    np.testing.assert_array_equal(free_velocity(marched), first)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_panels_lie_in_memory_once(model: Make, begin: Make, hht: TimeScheme, precision: str) -> None:
    """In the fixed block, also after it has grown; solutions stay the same to the last bit."""
    held = model("held")
    propagator = begin([replace(held, model=held.model.with_factor(precision))], hht)
    factor, load = propagator.operators.factor, np.random.default_rng(5).normal(size=(propagator.n_dof, 4))
    own, solution = weakref.ref(factor.panels), factor.solve(load)
    panels, velocity = factor.panels.copy(), alone_of(propagator).predict().ravel()
    assert own() is None
    image, blocks, rng = propagator.state.image, [], np.random.default_rng(6)
    for key in range(10, 18):
        propagator.bind(rng.uniform(0.1, 4.0, propagator.n_channel))
        image.bind(key)
        np.testing.assert_array_equal(free_velocity(propagator), velocity)
        np.testing.assert_array_equal(factor.solve(load), solution)
        np.testing.assert_array_equal(factor.panels, panels)
        assert np.shares_memory(factor.panels, image.fixed)
        if not any(block() is image.fixed for block in blocks):
            blocks.append(weakref.ref(image.fixed))
    assert len(blocks) > 1
    assert [block() is None for block in blocks] == [True] * (len(blocks) - 1) + [False]


def test_classes_with_one_factor_share_its_panels(model: Make, begin: Make, hht: TimeScheme) -> None:
    """In one image their places are the same; images before and after are not changed by each other."""
    held = model("held")
    first = begin([held], hht)
    second = DirectPropagator([held.model], hht, first.dt, energy=True, twin=first)
    second.begin([held.histories], first.dt)
    started_alone(second, np.zeros((second.n_channel, 1)), second.mass_factor())
    factor = first.operators.factor
    assert second.operators.factor is factor
    velocity = alone_of(first).predict().ravel()
    before, n = first.state.image, first.n_channel
    places = [np.arange(n)[:, None], np.arange(n, 2 * n)[:, None]]
    both = Image(
        [ImageClass(first, places[0]), ImageClass(second, places[1])],
        np.ones(2 * n, dtype=bool),
        n_time=len(held.histories.time),
        histories={},
    )
    for propagator in (first, second):
        np.testing.assert_array_equal(free_velocity(propagator), velocity)
    assert len({int(row["panels"]) for row in both.classes}) == 1
    assert np.shares_memory(factor.panels, both.fixed)
    both.fixed[:] = np.nan
    before.call(entries.BEGIN, 1, 1, OPENINGS)
    np.testing.assert_array_equal(before.moving[before.row(0)["w_free"] :][:n], velocity)
