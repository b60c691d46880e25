"""Made-up solutions, by kind of run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from latin_fmu.results.estimates import ErrorEstimate, QuantityEstimate
from latin_fmu.results.solution import Solution

from . import synthetic


@pytest.fixture
def crushing() -> Solution:
    """Frictional contact, many windows, fields and energy."""
    return Solution(synthetic.crushing(), 'name = "crushing"', "crushing")


@pytest.fixture
def bars() -> Solution:
    """Joint and frictionless contact, one window, no further output."""
    return Solution(synthetic.bars(), 'name = "bars"\n[solver]\ntolerance = 1e-3', "bars")


@pytest.fixture
def stalled() -> Solution:
    """The bars, not converged."""
    return Solution(synthetic.bars(converged=False), 'name = "bars"\n[solver]\ntolerance = 1e-3', "bars")


@pytest.fixture
def stack() -> Solution:
    """Sixteen contacts."""
    return Solution(synthetic.stack(16), 'name = "stack"', "stack")


@pytest.fixture
def estimated(bars: Solution) -> Solution:
    """The bars with an estimated error: one quantity of known order, one without."""
    known = QuantityEstimate("contact.impulse", 2.7, 0.012, 1.1, False)
    unknown = QuantityEstimate("contact.peak_force", 4e4, 0.3)
    return replace(bars, estimate=ErrorEstimate((known, unknown), ("a remark",), 0.1))
