"""Explicit propagator on whole scenes: exact bars, the implicit solution, the merged body, energy, no penetration."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import latin_fmu
from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import Material, bar, column, half_sine
from tests.scenes import MODELS, pressure, solve, solved

from .blocks import stack

TRANSIT = 0.5 / np.sqrt(210e9 / 7800.0)
EXPLICIT = "solver.propagator=explicit", "time.scheme=central_difference"


def closes(energy) -> None:
    """Energy balance to 1e-11 of the largest term."""
    assert np.abs(energy["balance"]).max() <= 1e-11 * max(np.abs(term).max() for term in energy.values())


def bars(n: int) -> latin_fmu.Solution:
    """Beam in traction, n steps at Courant number 0.99."""
    cells = (f"substructure.{b}.box.elements=[1, 1, {n // 6}]" for b in ("bar1_a", "bar1_b", "bar2"))
    plain = ("output.fields=false", "output.stress=false", "solver.window=1")
    return solved("beam_in_traction/scene", f"time.instants={n}", *EXPLICIT, *plain, *cells)


def test_bars_meet_the_exact_contact():
    """Closing at 2.3 L/c within a step, contact stress p0 within 1.5 %, impulse 0.7 p0 L/c within 1 %, then 0.95 %."""
    for n, limit in ((300, 0.0100), (600, 0.0095)):
        solution = bars(n)
        history, time = pressure(solution, "contact"), solution.time
        assert abs(time[np.argmax(history > 0.01 * history.max())] - 2.3 * TRANSIT) <= time[1]
        assert history.max() == pytest.approx(100e6, rel=0.015)
        assert np.trapezoid(history, time) == pytest.approx(0.7 * 100e6 * TRANSIT, rel=limit)
        assert solution.interfaces["contact"].penetration() <= 1e-15
        closes(solution.energy)
        assert max(w.iterations for w in solution.windows) <= 2


def test_impact_losses_vanish_under_refinement():
    lost = [s.energy["contact_dissipation"][-1] / s.energy["work_of_loads"][-1] for s in (bars(300), bars(600))]
    assert 0.0 < lost[1] < 0.6 * lost[0] < 0.01


def test_difference_to_the_implicit_answer_shrinks_with_the_mesh():
    """Crushing with friction, cut short while the bodies touch: force within 5 %, impulse within 2 %, then less."""
    differences, lost = [], []
    for elements in (3, 6):
        scenes = [stack(2, "contact", 0.3, elements=elements) for _ in range(2)]
        for scene in scenes:
            scene["time"] = {"end": 12e-6, "instants": 40 * elements}
        scenes[1]["solver"] = {"propagator": "explicit"}
        implicit, explicit = (solve(s).interfaces["i1"] for s in scenes)
        time = np.linspace(0.0, 12e-6, 40 * elements + 1)
        forces = [h.normal_resultant() for h in (implicit, explicit)]
        differences.append(np.linalg.norm(forces[1] - forces[0]) / np.linalg.norm(forces[0]))
        impulses = [h.impulse(time)[-1, 2] for h in (implicit, explicit)]
        lost.append(abs(impulses[1] / impulses[0] - 1))
    assert lost[1] < 0.6 * lost[0] < 0.6 * 0.02, lost
    assert differences[0] < 0.05
    assert differences[1] < 0.7 * differences[0], differences


def test_bonded_blocks_march_as_one_body():
    """Two blocks with a perfect interface against one block of both: same lumped mass, same motion."""
    cut = stack(2, "perfect", propagator="explicit", tolerance=1e-10)
    cut["material"]["aluminium"] = cut["material"]["steel"]
    one = stack(1, "perfect", propagator="explicit")
    one["material"]["aluminium"] = cut["material"]["steel"]
    one["substructure"]["b1"]["box"] = {"origin": [0, 0, 0], "size": [0.01, 0.01, 0.02], "elements": [3, 3, 6]}
    actual, expected = solve(cut).substructures["b2"], solve(one).substructures["b1"]
    top = np.isclose(expected.nodes[:, 2], 0.02), np.isclose(actual.nodes[:, 2], 0.02)
    u, v = expected.displacement[:, top[0]], actual.displacement[:, top[1]]
    np.testing.assert_allclose(v, u, atol=1e-7 * np.abs(u).max())


def test_absorbing_periodic_columns_keep_their_laws():
    """Shear through a preloaded frictional interface: at most mu sigma0 gets through."""
    solution = solved("shear_interface/scene", *EXPLICIT)
    closes(solution.energy)
    implicit = solved("shear_interface/scene")
    forces = [s.interfaces["fault"].force()[:, 0] for s in (solution, implicit)]
    assert np.linalg.norm(forces[0] - forces[1]) <= 0.06 * np.linalg.norm(forces[1])


def test_a_moving_ground_works():
    """A wall that pushes a bar: bar and ground part at no time, and the balance closes with the ground's work."""
    moving = {"direction": [0, 0, 1], "amplitude": 3.0, "law": half_sine(0.4)}
    scene = column(
        {"bar": bar(Material(900.0), 10.0, 20)},
        {},
        {"end": 0.6, "instants": 60},
        interface={"wall": {"sides": ["bar.zmin", "ground"], "ground_velocity": moving}},
        solver={"propagator": "explicit"},
        output={"energy": True},
    )
    solution = solve(scene)
    closes(solution.energy)
    energy = solution.energy
    given = energy["ground_work"][-1] - energy["contact_dissipation"][-1]
    assert given == pytest.approx(energy["interface_work"][-1], rel=1e-9)
    gap = solution.interfaces["wall"].gap
    assert gap is not None
    assert np.abs(gap[:12]).max() <= 1e-12
    # a bar pushed at v answers with rho c v: half a sine of 3 m/s over the 400 ms, impulse within 2 %
    pushed = solution.interfaces["wall"].impulse(solution.time)[np.searchsorted(solution.time, 0.39), 2]
    assert abs(pushed) == pytest.approx(30.0 * 3.0 * 2 / np.pi * 0.4, rel=0.02)


@pytest.mark.parametrize("window", [10, "whole"])
def test_longer_windows_give_the_same_answer(window):
    scene = stack(2, "contact", 0.3, propagator="explicit", tolerance=1e-5)
    sequential = solve(scene).interfaces["i1"].normal_resultant()
    scene["solver"]["window"] = window
    longer = solve(scene).interfaces["i1"].normal_resultant()
    np.testing.assert_allclose(longer, sequential, atol=2e-3 * np.abs(sequential).max())


def test_a_step_that_is_not_stable_names_the_one_that_is():
    scene = stack(2, "contact", propagator="explicit")
    scene["time"] = {"end": 12e-6, "instants": 12}
    with pytest.raises(SceneError, match=r"longer than the stable one.*instants = \d+"):
        latin_fmu.solve(latin_fmu.scene_from_dict(scene))
    advice = int(_advice(scene))
    scene["time"]["instants"] = advice
    solve(scene)


def _advice(scene) -> str:
    with pytest.raises(SceneError) as caught:
        latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(scene)))
    return str(caught.value).split("instants = ")[1].split()[0]


def test_scheme_and_propagator_go_together():
    """Each selects the other where it is left out; what is refused: ``hard_cases.test_pairs``."""
    scene = latin_fmu.scene_from_dict(stack(2, "contact", propagator="explicit"))
    assert scene.time.scheme.type == "central_difference"
    again = latin_fmu.load_scene(MODELS / "impact_bar/scene.toml", ["time.scheme=central_difference"])
    assert again.solver.propagator.type == "automatic"


def test_a_rigid_body_among_elastic_ones():
    """A rigid upper block: its face moves as one, D is no longer diagonal; the result is the implicit one."""
    scenes = [stack(2, "contact", 0.3, **solver) for solver in ({}, {"propagator": "explicit"})]
    for scene in scenes:
        scene["substructure"]["b2"]["rigid"] = True
    implicit, explicit = (solve(s) for s in scenes)
    closes(explicit.energy)
    forces = [s.interfaces["i1"].normal_resultant() for s in (implicit, explicit)]
    assert np.linalg.norm(forces[1] - forces[0]) <= 0.08 * np.linalg.norm(forces[0])
