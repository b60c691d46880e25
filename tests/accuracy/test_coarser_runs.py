"""Which coarser runs a scene allows."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy.estimate import coarser_runs_of
from latin_fmu.accuracy.resolution import (
    Resolution,
    aligned,
    at_resolution,
    in_short_windows,
    mesh_factor,
    reachable,
    sampling_error,
)

from ..verification.known_answers import MODELS, shipped


def test_resolution_scales_elements_and_divides_the_step() -> None:
    scene = shipped("beam_in_traction")
    coarse = at_resolution(scene, Resolution(0.5, 0.31, 1e-2))
    assert coarse.substructure["bar2"].box.elements == (1, 1, 25)
    assert coarse.time.time_step == pytest.approx(scene.time.time_step / 0.31, rel=1e-14)
    assert scene.time.end <= coarse.time.end < scene.time.end + coarse.time.time_step
    assert coarse.solver.tolerance == 1e-2
    assert not coarse.output.fields
    assert scene.substructure["bar2"].box.elements == (1, 1, 50)


def test_the_steps_of_coarser_runs_meet_the_jumps_of_the_loads() -> None:
    """The pulse lasts 42 steps: a quarter of the steps would end it between two instants."""
    scene = shipped("beam_in_traction")
    steps = aligned(scene, 0.25)
    assert 42 * steps == pytest.approx(round(42 * steps))
    assert abs(steps / 0.25 - 1) <= 0.12
    assert sampling_error(scene, scene.time.time_step / steps) < 1e-9
    assert sampling_error(scene, scene.time.time_step / 0.25) > 0.04
    assert aligned(shipped("impact_bar"), 0.25) == 0.25
    assert aligned(scene, 0.3) == pytest.approx(13 / 42)  # the nearest of 12, 13 and 14 steps


def test_small_counts_keep_one_ratio() -> None:
    assert reachable([6, 6, 6], 0.5) == 0.5
    assert reachable([5], 0.5) == 0.6
    coarser = coarser_runs_of(latin_fmu.load_scene(MODELS / "two_specimen_crushing/scene.toml"))
    assert coarser is not None
    assert coarser.half == Resolution(0.5, 0.5)
    assert coarser.quarter == Resolution(1 / 3, 1 / 3)
    assert coarser.cross == Resolution(0.5, 31 / 16)


def test_a_mesh_from_a_file_leaves_the_time_step() -> None:
    coarser = coarser_runs_of(shipped("punched_plates"))
    assert coarser is not None
    assert coarser.half == Resolution(1.0, 0.5)
    assert coarser.cross is None
    assert "mesh" in coarser.remarks[0]


def test_a_refined_mesh_from_a_file_has_coarser_ones() -> None:
    """Refined once, the mesh of the file is the coarser one; finer ones exist, four refinements at most."""
    scene = latin_fmu.load_scene(
        MODELS / "punched_plates/scene.toml",
        [f"substructure.{name}.mesh.refine=1" for name in ("lower", "upper", "punch")],
    )
    coarser = coarser_runs_of(scene)
    assert coarser is not None
    assert coarser.half.mesh == 0.5
    assert coarser.cross == Resolution(0.5, 31 / 16)
    assert coarser.quarter is None
    assert "facets" in coarser.remarks[0]
    assert {b.mesh.refine for b in at_resolution(scene, coarser.half).substructure.values() if b.mesh} == {0}
    assert [mesh_factor(scene, f) for f in (0.1, 0.4, 0.8, 1.3, 3.0, 99.0)] == [0.5, 0.5, 1.0, 1.0, 4.0, 8.0]


def test_a_handful_of_steps_cannot_be_coarsened() -> None:
    scene = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", ["time.instants=10"])
    assert coarser_runs_of(scene) is None


def test_short_windows_keep_the_answer() -> None:
    """The coarser runs of a run in one window use short ones: both are converged, so they agree."""
    scene = at_resolution(shipped("beam_in_traction"), Resolution(0.5, 0.5, 1e-6))
    whole, short = latin_fmu.solve(scene), latin_fmu.solve(in_short_windows(scene))
    assert len(whole.windows) == 1 < len(short.windows)
    force = [s.interfaces["contact"].normal_resultant() for s in (whole, short)]
    assert np.abs(force[0] - force[1]).max() < 1e-4 * force[0].max()
