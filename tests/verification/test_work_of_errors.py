"""Work that the laws of the interfaces do not allow: what the errors of the iteration add to or take from the energy.

The stopping test bounds it instant by instant (``kernels.indicator.work_of_error``), and a run in which it exceeds 1e-4
of the energy put in a thousand instants has not converged, 1e-3 where steps are too long for waves and in windows of
several instants. A ball that bounces and thrown bars show the same by an account that knows nothing of it: the energy
after against that of a run at a tight tolerance.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.building import build
from latin_fmu.kernels.energy_parts import N_WORK, PUT_IN
from latin_fmu.latin.outcome import Timings
from latin_fmu.latin.recorder import Recorder
from latin_fmu.latin.status import BALANCED, ERRORS
from latin_fmu.latin.windows import Run
from latin_fmu.results.solution import Solution
from latin_fmu.stability.scenes import Box, Material, column
from tests.hard_cases import random_scenes
from tests.scenes import solved

from .test_ball_impact import ball


def share(solution: Solution) -> float:
    """Largest work of the errors over the energy put in, by the energies of the results."""
    energy = solution.energy
    assert energy is not None
    put_in = energy["kinetic"][0] + energy["elastic"][0] + energy["work_of_loads"] + energy.get("ground_work", 0.0)
    largest = max(float(put_in.max()), float(energy["kinetic"].max()))
    return float(np.abs(energy["drift_work"]).max()) / largest if largest > 0.0 else 0.0


def set_up(scene: latin_fmu.Scene) -> Run:
    problem = build(scene)
    return Run(problem.assembly, problem.settings, Recorder(problem.assembly, problem.output, problem.info), Timings())


def randomly(seed: int, window: int | str) -> tuple[Solution, bool]:
    """A random scene's solution, and whether its steps resolve waves."""
    described = random_scenes.scene(seed)
    described["solver"]["window"] = window
    scene = latin_fmu.scene_from_dict(described)
    return latin_fmu.solve(scene), window == 1 and set_up(scene).direction(1).short


def check(seeds: range, window: int | str) -> None:
    """Nine tenths of the scenes have converged, all of them with the work that is allowed for their steps; instant by
    instant, four in five of them with that of short ones."""
    shares: dict[float, list[float]] = {ERRORS: [], BALANCED: []}
    for seed in seeds:
        solution, short = randomly(seed, window)
        if solution.converged:
            shares[ERRORS if short else BALANCED].append(share(solution))
    assert sum(map(len, shares.values())) >= 0.9 * len(seeds)
    for allowed, kept in shares.items():
        assert max(kept, default=0.0) <= 1.1 * allowed, allowed  # the largest energy put in is that up to the end
    if window == 1:
        kept = [*shares[ERRORS], *shares[BALANCED]]
        assert np.mean(np.array(kept) <= ERRORS) >= 0.8, np.sort(kept)[-5:]


def test_random_scenes() -> None:
    check(range(2000, 2012), 1)


@pytest.mark.slow
def test_hundred_random_scenes() -> None:
    check(range(2100, 2200), 1)


@pytest.mark.parametrize("window", [2, 20, "whole"])
def test_longer_windows(window: int | str) -> None:
    """Windows of several instants balance or have not converged."""
    check(range(2000, 2010), window)


@pytest.mark.slow
@pytest.mark.parametrize("window", [2, 5, 20, "whole"])
def test_longer_windows_of_fifty_scenes(window: int | str) -> None:
    check(range(2200, 2250), window)


@pytest.mark.parametrize(
    "model", ["beam_in_traction", "hammer_on_plate", "impact_bar", "shear_interface", "two_specimen_crushing"]
)
def test_shipped_models(model: str) -> None:
    assert share(solved(f"{model}/scene")) <= ERRORS


def pressed(account: bool, **choices: str) -> Run:
    """Two blocks that are pushed by a ramp and meet in short steps."""
    blocks = {name: Box(Material(210e9, 7800.0, 0.3), (0.1, 0.1, 0.1), (3, 3, 3)) for name in ("low", "up")}
    tables = copy.deepcopy(column(blocks, {"meet": {"friction_coefficient": 0.2}}, {"end": 1e-4, "instants": 100}))
    tables["boundary"] = {"foot": {"type": "fixed", "face": "low.zmin"}}
    ramp = {"type": "table", "times": [0.0, 3e-5, 1e-4], "values": [0.0, 1.0, 0.4]}
    tables["load"] = {"push": {"face": "up.zmax", "traction": [2e6, 0.0, -1e7], "law": ramp}}
    tables["output"] = {"energy": account}
    for table, key in (("time", "scheme"), ("solver", "propagator")):
        tables.setdefault(table, {})
        tables[table] |= {key: choices[key]} if key in choices else {}
    run = set_up(latin_fmu.scene_from_dict(tables))
    run.all()
    return run


@pytest.mark.parametrize(
    "choices",
    [
        {"scheme": "hht"},
        {"scheme": "newmark"},
        {"scheme": "generalized_alpha"},
        {"scheme": "massless_contact"},
        {"propagator": "explicit"},
        {"propagator": "reduced"},
    ],
    ids=str,
)
def test_the_account_changes_nothing(choices: dict[str, str]) -> None:
    """The stopping test needs the work of the loads; where it alone is followed it is that of the whole account."""
    short, whole = pressed(False, **choices), pressed(True, **choices)
    assert all(p.loads_only for p in short.assembly.propagators)
    assert not any(p.loads_only for p in whole.assembly.propagators)
    put_in = [float(run.image.field("works", N_WORK)[PUT_IN]) for run in (short, whole)]
    assert put_in[0] > 0.0
    assert put_in[0] == pytest.approx(put_in[1], rel=1e-14)
    last = [run.image.field("history_f", run.image.rows, run.image.n_flat)[-1] for run in (short, whole)]
    assert np.array_equal(*last)
    assert short.account() is None
    assert whole.account() is not None


def energy_kept(solution: Solution) -> float:
    """Kinetic and elastic energy at the end over that at the start."""
    energy = solution.energy
    assert solution.converged
    assert energy is not None
    stored = energy["kinetic"] + energy["elastic"]
    return float(stored[-1] / stored[0])


def bouncing(scheme: str, instants: int, tolerance: float) -> float:
    scene = ball() | {"output": {"energy": True}, "solver": {"tolerance": tolerance}}
    scene["time"] |= {"instants": instants, "scheme": scheme}
    return energy_kept(latin_fmu.solve(latin_fmu.scene_from_dict(scene)))


@pytest.mark.slow
@pytest.mark.parametrize(("instants", "within"), [(50, 5e-4), (200, 2e-4)])
@pytest.mark.parametrize("scheme", ["generalized_alpha", "hht"])
def test_a_ball_gains_no_energy(scheme: str, instants: int, within: float) -> None:
    default = bouncing(scheme, instants, 1e-3)
    assert default <= 1.0 + 1e-5
    assert default == pytest.approx(bouncing(scheme, instants, 1e-8), abs=within)


def thrown(scheme: str, tolerance: float) -> float:
    """Energy after two unlike bars have met, the second at rest."""
    first, second = Material(210e9, 7800.0, 0.0, name="steel"), Material(70e9, 2700.0, 0.0, name="aluminium")
    bars = {
        "low": Box(first, (1.0, 1.0, 30.0), (1, 1, 30), velocity=(0.0, 0.0, 1.0)),
        "up": Box(second, (1.0, 1.0, 30.0), (1, 1, 30)),
    }
    scene = copy.deepcopy(column(bars, {"meet": {"friction_coefficient": 0.0}}, {"end": 16e-3, "instants": 200}))
    scene["time"]["scheme"] = scheme
    scene |= {"output": {"energy": True}, "solver": {"tolerance": tolerance}}
    return energy_kept(latin_fmu.solve(latin_fmu.scene_from_dict(scene)))


@pytest.mark.parametrize("scheme", ["hht", "newmark", "generalized_alpha"])
def test_thrown_bars_keep_what_the_scheme_leaves(scheme: str) -> None:
    exact = thrown(scheme, 1e-8)
    for tolerance in (1e-2, 1e-3, 1e-5):
        kept = thrown(scheme, tolerance)
        assert kept == pytest.approx(exact, abs=2e-4)
        assert kept <= 1.0 + 1e-5


def test_the_status_tells_work_against_the_laws() -> None:
    """A body 600 times lighter between two others: its place is cheap to get wrong while the pressure is low, and dear
    to make up when that rises."""
    described: dict[str, Any] = random_scenes.scene(508)
    described["solver"]["window"] = 1
    coarse = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(described)))
    assert share(coarse) > BALANCED
    assert not coarse.converged
    assert "work of the residual forces of the iteration at the interfaces" in coarse.status
    assert "solver.tolerance" in coarse.status
    described["solver"]["tolerance"] = 1e-4
    assert latin_fmu.solve(latin_fmu.scene_from_dict(described)).converged
