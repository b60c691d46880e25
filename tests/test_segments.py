"""A run in segments: loads from outside, snapshots."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cosim.segments import SegmentedRun
from latin_fmu.stability.scenes import Material, bar, column, half_sine

MODELS = Path(__file__).parents[1] / "models"


def scene(model: str, *overrides: str):
    return latin_fmu.load_scene(MODELS / f"{model}.toml", overrides)


def pieces(run: SegmentedRun, bounds, total: int, **kwargs):
    """Advance over pieces of the interval; the concatenated tractions and the last segment."""
    end = run.scene.time.end
    parts = []
    for a, b in itertools.pairwise(bounds):
        segment = run.advance(end * b / total, b - a, **kwargs)
        assert segment.converged, segment.status
        parts.append(segment)
    return parts


@pytest.mark.parametrize("model", ["impact_bar/scene", "shear_interface/scene", "two_specimen_crushing/scene"])
def test_segments_equal_the_whole_run(model):
    """Same windows, same numbers: cutting the interval changes results by round-off of the instants only."""
    described = scene(model, "output.fields=false")
    whole = latin_fmu.solve(described)
    n = described.time.n_step
    parts = pieces(SegmentedRun(described), [0, n // 5, n // 2, n], n)
    for name, history in whole.interfaces.items():
        cut = np.concatenate([p.interfaces[name].traction[(i > 0) :] for i, p in enumerate(parts)])
        # round-off grows where points that stick begin to slip
        assert np.abs(cut - history.traction).max() <= 1e-8 * np.abs(history.traction).max()
    energy = parts[-1].energy
    for term, values in whole.energy.items():
        scale = max(np.abs(v).max() for v in whole.energy.values())
        # works weigh three instants: the first step of a segment knows two (1e-8)
        assert abs(energy[term][-1] - values[-1]) <= 1e-7 * scale, term


def test_one_segment_is_the_run_itself():
    """Bit for bit."""
    described = scene("two_specimen_crushing/scene", "output.energy=false", "time.end=6e-6")
    whole = latin_fmu.solve(described)
    segment = SegmentedRun(described).advance(described.time.end, described.time.n_step)
    assert np.array_equal(whole.interfaces["crush"].traction, segment.interfaces["crush"].traction)


def test_snapshot_restore_is_bit_identical():
    """Save, go on, come back, go on again; in the same instance and in a fresh one."""
    described = scene("bouncing_bar/scene", "output.fields=false")
    run = SegmentedRun(described)
    run.advance(1.0, 200)
    run.advance(1.065, 13)
    snapshot = run.snapshot()
    first = run.advance(1.365, 60)
    run.advance(1.615, 50)
    run.restore(snapshot)
    again = run.advance(1.365, 60)
    fresh = SegmentedRun(described)
    fresh.restore(snapshot)
    elsewhere = fresh.advance(1.365, 60)
    for other in (again, elsewhere):
        assert np.array_equal(first.interfaces["wall"].traction, other.interfaces["wall"].traction)
        assert np.array_equal(first.energy["balance"], other.energy["balance"])
    assert first.interfaces["wall"].traction.any()
    run.restore(snapshot)
    assert run.snapshot() == snapshot


def test_reset_starts_again():
    described = scene("impact_bar/scene", "output.fields=false")
    run = SegmentedRun(described)
    first = run.advance(0.7, 140)
    run.reset()
    assert np.array_equal(first.interfaces["wall"].traction, run.advance(0.7, 140).interfaces["wall"].traction)


@pytest.mark.parametrize("damage", [b"", b"nonsense", lambda b: b[:-8], lambda b: b + b"x", lambda b: b[:40]])
def test_damaged_snapshots_are_refused(damage):
    run = SegmentedRun(scene("impact_bar/scene"))
    run.advance(0.1, 20)
    snapshot = run.snapshot()
    with pytest.raises(latin_fmu.InputError, match="state"):
        run.restore(damage(snapshot) if callable(damage) else damage)
    assert run.snapshot() == snapshot


def test_snapshots_of_another_scene_are_refused():
    run = SegmentedRun(scene("impact_bar/scene"))
    run.advance(0.1, 20)
    with pytest.raises(latin_fmu.InputError, match="another scene"):
        SegmentedRun(scene("bouncing_bar/scene")).restore(run.snapshot())


def test_ends_beside_the_grid_are_refused():
    run = SegmentedRun(scene("impact_bar/scene", "output.fields=false"))
    run.advance(0.1, 20)
    snapshot = run.snapshot()
    for end, n in ((0.4, 10), (0.1, 0), (0.1024, 1), (float("nan"), 1)):
        with pytest.raises(latin_fmu.InputError, match="time steps"):
            run.advance(end, n)
    assert run.snapshot() == snapshot
    assert run.advance(0.1 + 0.1 * (1 + 1e-12), 20).accepted


def test_loads_from_outside():
    """The history given for a load replaces its law."""
    described = scene("two_specimen_crushing/scene", "output.energy=false", "time.end=9e-6")
    time = np.linspace(0.0, 9e-6, 61)
    name = next(iter(described.load))
    law = described.load[name].law.sample(time)
    by_law = SegmentedRun(described).advance(9e-6, 60)
    given = SegmentedRun(described).advance(9e-6, 60, {name: law})
    none = SegmentedRun(described).advance(9e-6, 60, {name: np.zeros(61)})
    assert np.array_equal(by_law.interfaces["crush"].traction, given.interfaces["crush"].traction)
    assert not none.interfaces["crush"].traction.any()


def test_a_segment_that_does_not_converge_leaves_the_state_alone():
    described = scene("two_specimen_crushing/scene", "solver.max_iterations=1", "output.energy=false")
    run = SegmentedRun(described)
    snapshot = run.snapshot()
    segment = run.advance(3e-6, 20)
    assert not segment.converged
    assert not segment.accepted
    assert run.time == 0.0
    assert run.snapshot() == snapshot
    # a window far from any answer stops the segment, and cannot be accepted
    assert not run.advance(3e-6, 20, accept=True).accepted
    assert run.snapshot() == snapshot
    few = ("solver.tolerance=1e-9", "solver.max_iterations=11", "solver.newton=false")
    described = scene("two_specimen_crushing/scene", *few)
    run = SegmentedRun(described)
    assert run.advance(3e-6, 20, accept=True).accepted
    assert run.time == 3e-6
    snapshot = run.snapshot()
    assert not run.advance(6e-6, 20).accepted
    assert run.snapshot() == snapshot


def test_driven_bodies_go_on_where_they_are():
    """Prescribed motion and moving ground over several segments equal the whole run."""
    law = half_sine(3.0)
    moving = {"direction": [0, 0, -1], "amplitude": 0.1, "law": law}
    driven = {"type": "velocity", "face": "bar.zmin", "components": ["z"], "value": [0.2], "law": law}
    tables = column(
        {"bar": bar(Material(4.0), 4.0, 8)},
        {},
        {"end": 6.0, "instants": 120},
        interface={"wall": {"sides": ["bar.zmax", "ground"], "gap": 0.05, "ground_velocity": moving}},
        boundary={"push": driven},
        solver={"tolerance": 1e-10},
        output={"energy": True},
    )
    described = latin_fmu.scene_from_dict(tables)
    whole = latin_fmu.solve(described)
    parts = pieces(SegmentedRun(described), [0, 30, 77, 120], 120)
    history = whole.interfaces["wall"]
    cut = np.concatenate([p.interfaces["wall"].traction[(i > 0) :] for i, p in enumerate(parts)])
    assert history.traction.any()
    assert np.abs(cut - history.traction).max() <= 1e-8 * np.abs(history.traction).max()
    gaps = np.concatenate([p.interfaces["wall"].gap[(i > 0) :] for i, p in enumerate(parts)])
    assert np.abs(gaps - history.gap).max() <= 1e-10
    assert np.abs(whole.energy["balance"]).max() <= 1e-12
