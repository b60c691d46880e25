"""Made-up solutions, by kind of run."""

from __future__ import annotations

import pytest

from latin_fmu.results.solution import Solution

from . import synthetic


@pytest.fixture
def crushing() -> Solution:
    """Frictional contact, many windows, fields and energy."""
    return Solution(synthetic.crushing(), 'name = "crushing"', "crushing")


@pytest.fixture
def bars() -> Solution:
    """Joint and frictionless contact, one window, nothing asked for."""
    return Solution(synthetic.bars(), 'name = "bars"\n[solver]\ntolerance = 1e-3', "bars")


@pytest.fixture
def stalled() -> Solution:
    """The bars, not converged."""
    return Solution(synthetic.bars(converged=False), 'name = "bars"\n[solver]\ntolerance = 1e-3', "bars")


@pytest.fixture
def stack() -> Solution:
    """Sixteen contacts."""
    return Solution(synthetic.stack(16), 'name = "stack"', "stack")
