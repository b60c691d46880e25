"""One door from a relative accuracy to the tolerance of the iteration."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.latin.settings import ITERATION_SHARE, accuracy_of, tolerance_for
from latin_fmu.scene.quantity_table import QUANTITIES_OF_INTEREST


@pytest.mark.parametrize("accuracy", [0.2, 0.01, 3e-5])
def test_the_iteration_may_leave_a_tenth(accuracy: float) -> None:
    for definition in QUANTITIES_OF_INTEREST:
        left = tolerance_for(accuracy, definition.iteration) * definition.iteration
        assert left == pytest.approx(ITERATION_SHARE * accuracy)


def test_there_and_back_is_the_same_number() -> None:
    """A host that hands back the default tolerance of an FMU must run the scene as written, to the last bit."""
    for digits in range(1, 13):
        for mantissa in (1.0, 2.0, 3.0, 5.0, 7.0, 9.99):
            tolerance = float(f"{mantissa}e-{digits}")
            assert tolerance_for(accuracy_of(tolerance)) == tolerance
    random = np.random.default_rng(1).uniform(size=200)
    back = [tolerance_for(accuracy_of(t)) for t in random]
    assert np.allclose(back, random, rtol=1e-11)
