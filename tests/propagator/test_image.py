"""The image of a run: search directions come and go, the memory stays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from latin_fmu.kernels import entries
from latin_fmu.propagator import DirectPropagator
from latin_fmu.time_scheme import TimeScheme

Array = np.ndarray
Make = Callable[..., Any]


@pytest.fixture
def marched(model: Make, begin: Make, hht: TimeScheme) -> DirectPropagator:
    """A propagator at its first instant, before the interface forces."""
    propagator = begin([model("held")], hht)
    propagator.predict()
    return propagator


def respond(propagator: DirectPropagator) -> Array:
    """Velocities of the channels for q = 1 with the direction that the image uses."""
    image, n = propagator._image, propagator.n_channel
    image.field("q", n)[:] = 1.0
    image.call(entries.RESPOND, 0)
    return image.field("w", n).copy()


def expected(propagator: DirectPropagator, k: Array) -> Array:
    """The same from dense algebra."""
    free, d = propagator._part("w_free", len(k)), propagator.operators.admittance
    return np.linalg.solve(np.eye(len(k)) + d * k, free + d @ np.ones(len(k)))


@pytest.mark.parametrize("between", [False, True], ids=["last", "before_another"])
def test_a_direction_set_afresh_takes_no_further_memory(marched: DirectPropagator, between: bool) -> None:
    image, rng, sizes = marched._image, np.random.default_rng(3), []
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
        marched.respond(np.ones((marched.n_channel, 1)))
        sizes.append(marched._image.fixed.size)
    assert sizes[-1] == sizes[1]


def test_directions_placed_before_are_kept(marched: DirectPropagator) -> None:
    """Bit for bit, whatever was placed since."""
    image, rng, first = marched._image, np.random.default_rng(4), []
    for key in range(10, 16):
        marched.bind(rng.uniform(0.1, 4.0, marched.n_channel))
        image.bind(key)
        first.append(respond(marched))
        image.bind(-1, afresh=True)
        np.testing.assert_array_equal(respond(marched), first[-1])
    for key, found in enumerate(first, 10):
        image.bind(key)
        np.testing.assert_array_equal(respond(marched), found)
