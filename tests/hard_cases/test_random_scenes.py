"""Property: a random small scene converges with all laws kept, or reports that it does not. There is no third outcome.

500 scenes and more: ``pytest -m slow tests/hard_cases/test_random_scenes.py`` (see CONTRIBUTING).
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import latin_fmu
from latin_fmu.interface.laws import SEPARATION, STICK

from .random_scenes import outcome, scene

# Seeds that once had a third outcome or still need the last fall-back; kept for good.
FOUND = {
    4: "undamped scheme, windows of 4: penetration drifts with the tolerance",
    13: "step of 1e5 transits: round-off of the elastic energy",
    44: "mu 10, unaccelerated: stalls with the impedance",
    47: "penetration grows slowly under the tolerance",
    87: "step of 7e4 transits: does not converge, says so",
    148: "round-off of the energy balance at a step of 5e3 transits",
}


@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 2**32 - 1))
def test_two_outcomes(seed):
    assert outcome(seed) in ("converged", "not converged")


@pytest.mark.parametrize("seed", sorted(FOUND))
def test_found_seeds(seed):
    assert outcome(seed) in ("converged", "not converged")


def test_most_converge():
    """Of the first 18 seeds (steps from 1e-1 to 1e5 transits, k off by ten, mu to 10) five in six converge, with
    their balance of energy and, in short steps, work against the laws below 1e-4."""
    outcomes = [outcome(seed) for seed in range(18)]
    assert outcomes.count("converged") >= 15


@pytest.mark.parametrize("seed", range(24))
def test_status_of_no_slip_agrees_with_the_traction(seed: int) -> None:
    """Stick wherever a point carries a traction, pressed or not; separation only where it carries none."""
    described = scene(seed)
    for interface in described["interface"].values():
        if "friction_coefficient" in interface:
            del interface["friction_coefficient"]
            interface["behaviour"] = "no_slip"
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(described))
    largest = max(np.abs(h.traction).max() for h in solution.interfaces.values())
    for history in solution.interfaces.values():
        if history.contact_status is None:
            continue
        size = np.linalg.norm(history.traction, axis=-1)
        assert (history.contact_status[size > 1e-4 * largest] == STICK).all()
        assert (size[history.contact_status != SEPARATION] > 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_many(block):
    """Another 600 scenes, thirty a test; the message names the seed."""
    for seed in range(1000 + 30 * block, 1000 + 30 * (block + 1)):
        try:
            outcome(seed)
        except Exception as error:  # any exception at all is the finding
            raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}") from error
