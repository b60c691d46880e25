"""Whichever way the direct march is solved, the result is the same; restarts are exact."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.propagator_choice import PROPAGATORS
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.errors import SceneError
from tests.scenes import solve

from .blocks import stack
from .test_explicit import closes

# what solves the equations of the direct march in another way: largest difference of tractions, energy balance
WAYS = {"cg": ({"propagator": "cg"}, 1e-8, 1e-10), "float32": ({"precision": "float32"}, 1e-7, 1e-6)}
EVERY = tuple({"type": kind, "modes": 20} if kind == "reduced" else kind for kind in PROPAGATORS)


@pytest.fixture(scope="module")
def direct() -> latin_fmu.Solution:
    """Three blocks with friction, direct."""
    return solve(stack(3, "contact", 0.3, tolerance=1e-6))


@pytest.mark.parametrize("way", WAYS)
def test_the_answer_is_that_of_the_direct_march(way, direct):
    settings, difference, balance = WAYS[way]
    solution = solve(stack(3, "contact", 0.3, tolerance=1e-6, **settings))
    for name, history in direct.interfaces.items():
        apart = np.abs(solution.interfaces[name].traction - history.traction).max()
        assert apart <= difference * np.abs(history.traction).max()
    assert solution.windows[0].iterations == direct.windows[0].iterations
    energy = solution.energy
    largest = max(np.abs(term).max() for term in energy.values())
    assert np.abs(energy["balance"]).max() <= balance * largest


def test_windows_without_a_factor_are_those_of_the_direct_march():
    """Several windows of several instants, with loads that change from instant to instant."""
    settings = {"window": 5, "tolerance": 1e-9, "max_iterations": 300}
    exact, traction = (
        solve(stack(2, "contact", 0.3, propagator=p, **settings)).interfaces["i1"].traction for p in ("direct", "cg")
    )
    assert np.abs(traction - exact).max() <= 1e-6 * np.abs(exact).max()


def test_float32_is_felt():
    """The option does something: results differ in more than the last bits."""
    exact, traction = (
        solve(stack(2, "contact", 0.3, precision=p)).interfaces["i1"].traction for p in ("float64", "float32")
    )
    assert np.abs(traction - exact).max() > 1e-12 * np.abs(exact).max()


@pytest.mark.parametrize("settings", [*({"propagator": kind} for kind in EVERY), {"precision": "float32"}], ids=str)
def test_a_part_after_a_snapshot_is_exact(settings):
    scene = latin_fmu.scene_from_dict(stack(2, "contact", 0.3, **settings))
    run = SegmentedRun(scene)
    run.advance(scene.time.end / 3, 20)
    kept = run.snapshot()
    first = run.advance(scene.time.end * 2 / 3, 20)
    other = SegmentedRun(scene)
    other.restore(kept)
    again = other.advance(scene.time.end * 2 / 3, 20)
    np.testing.assert_array_equal(again.interfaces["i1"].traction, first.interfaces["i1"].traction)


def test_cg_starts_bonded_bodies_as_the_factor_does():
    """Bonded blocks, one of them thrown: the traction at t = 0 needs the mass."""
    scenes = [stack(2, "perfect", propagator=p, tolerance=1e-9) for p in ("direct", "cg")]
    for scene in scenes:
        for name in ("b1", "b2"):
            scene["substructure"][name]["initial_velocity"] = [0.0, 0.0, 3.0]
        scene["load"]["pulse"]["law"] = {"type": "constant"}
    exact, traction = (solve(s).interfaces["i1"].traction for s in scenes)
    assert np.abs(exact[0]).max() > 0
    np.testing.assert_allclose(traction, exact, atol=1e-7 * np.abs(exact).max())


def test_float32_is_refused_where_there_is_no_factor():
    for propagator in ("explicit", "reduced", "cg"):
        with pytest.raises(SceneError, match="only the direct propagator has"):
            latin_fmu.scene_from_dict(stack(2, "contact", propagator=propagator, precision="float32"))


@pytest.mark.parametrize("propagator", EVERY, ids=str)
def test_energy_closes_whatever_the_propagator(propagator):
    closes(solve(stack(2, "contact", 0.3, propagator=propagator)).energy)
