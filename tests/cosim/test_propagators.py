"""Every propagator serves a session: steps, a snapshot, the same steps again to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.assembly.propagator_choice import PROPAGATORS
from latin_fmu.cosim import Session

from .scenes import blocks

EVERY = tuple({"type": kind, "modes": 20} if kind == "reduced" else kind for kind in PROPAGATORS)


@pytest.mark.parametrize("propagator", EVERY, ids=str)
def test_a_session_runs_and_goes_back(propagator):
    """Windowed co-simulation: steps, a snapshot, the same steps again to the last bit."""
    scene = blocks(solver={"propagator": propagator}, time={"end": 6e-6, "step": 0.1e-6})
    session = Session(scene)
    session.initialize()
    assert session.step(0.0, 1e-6)
    kept = session.snapshot()
    heads = []
    for _ in range(2):
        assert session.step(1e-6, 1e-6)
        assert session.step(2e-6, 1e-6)
        heads.append(session.row.copy())
        session.restore(kept)
    np.testing.assert_array_equal(heads[0], heads[1])
    assert np.abs(heads[0]).max() > 0
