"""Time schemes and the equilibrium of the start: faces that it lifts land, gaps that it closes do not."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import latin_fmu
from tests.scenes import clamp

Tables = dict[str, Any]
E, RHO = 210e9, 7800.0
STEEL = {"steel": {"young_modulus": E, "poisson_ratio": 0.3, "density": RHO}}


def solved(tables: Tables) -> latin_fmu.Solution:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables))
    assert solution.converged, solution.status
    return solution


def remarks(solution: latin_fmu.Solution) -> list[str]:
    return [w for w in solution.warnings if w.code == "scheme"]


def lever(force: float, step: float) -> Tables:
    """A beam on two blocks that touch it, pressed down at one of its ends, beyond the block there."""

    def box(origin: list[float], size: list[float], elements: list[int]) -> Tables:
        return {"material": "steel", "box": {"origin": origin, "size": size, "elements": elements}}

    return {
        "name": "lever",
        "material": STEEL,
        "substructure": {
            "beam": box([0.0, 0.0, 0.01], [0.12, 0.02, 0.01], [12, 2, 6]),
            "foot": box([0.02, 0.0, 0.0], [0.03, 0.02, 0.01], [3, 2, 5]),
            "heel": box([0.09, 0.0, 0.0], [0.03, 0.02, 0.01], [3, 2, 5]),
        },
        "interface": {n: {"sides": ["beam.zmin", f"{n}.zmax"], "friction_coefficient": 0.3} for n in ("foot", "heel")},
        "spring": {"back": {"ends": ["beam.xmax", "ground"], "direction": [0.0, 0.0, 1.0], "stiffness": 1e6}},
        "boundary": {n: {"type": "fixed", "face": f"{n}.zmin"} for n in ("foot", "heel")},
        "load": {"press": {"face": "beam.xmin", "force": [0.0, 0.0, force]}},
        "time": {"end": 20 * step, "instants": 20, "start": "static"},
    }


def test_a_face_that_the_start_lifts_lands() -> None:
    """The gaps that are told are those of the results at t = 0."""
    solution = solved(lever(-1000.0, 2e-7))
    gap = solution.interfaces["heel"].gap
    assert gap is not None
    assert gap[0].min() > 0.0
    (warning,) = remarks(solution)
    told = re.search(r"interface heel is closed as it is meshed, and open by ([\d.]+) um to ([\d.]+) um", warning)
    assert told is not None
    assert [float(told[1]), float(told[2])] == pytest.approx([1e6 * gap[0].min(), 1e6 * gap[0].max()], rel=1e-2)
    assert 'choose time.scheme = "generalized_alpha"' in warning
    every = np.concatenate([history.gap[0] for history in solution.interfaces.values() if history.gap is not None])
    scheme = str(solution.outcome.settings["time scheme"])
    assert f"in the equilibrium of the start {int((every > 1e-14).sum())} of {len(every)} points are open" in scheme


@pytest.mark.parametrize(("force", "step"), [(-1000.0, 1e-5), (0.0, 2e-7)], ids=["long steps", "nothing lifts"])
def test_a_start_that_speaks_against_nothing(force: float, step: float) -> None:
    made = lever(force, step)
    if not force:
        del made["load"]
        made["gravity"] = {"acceleration": [0.0, 0.0, -9.81]}
    assert not [w for w in remarks(solved(made)) if "equilibrium of the start" in w]


def test_the_tightened_joint_is_open_beside_its_pressure() -> None:
    """Told in the words of the scheme, and no landing."""
    solution = solved(clamp())
    scheme = str(solution.outcome.settings["time scheme"])
    told = re.search(r"in the equilibrium of the start (\d+) of (\d+) points are open, by up to [\d.]+ [un]m\)", scheme)
    assert told is not None, scheme
    assert 0 < int(told[1]) < int(told[2])
    assert not [w for w in remarks(solution) if "equilibrium of the start" in w]


def stopped(force: float) -> Tables:
    """A bar that a static force presses against a stop, a micrometre from its end."""
    faces = {s: {"type": "symmetry", "face": f"bar.{s}"} for s in ("xmin", "ymin", "zmin")}
    return {
        "name": "stopped",
        "material": STEEL,
        "substructure": {"bar": {"material": "steel", "box": {"size": [0.01, 0.01, 0.1], "elements": [2, 2, 20]}}},
        "interface": {"stop": {"sides": ["bar.zmax", "ground"], "gap": 1e-6, "friction_coefficient": 0.0}},
        "boundary": faces,
        "load": {"push": {"face": "bar.zmax", "force": [0.0, 0.0, force]}},
        "time": {"end": 1e-6, "instants": 10, "start": "static"},
    }


@pytest.mark.parametrize(("stretch", "closed"), [(2e-6, True), (0.5e-6, False)])
def test_a_gap_that_the_start_closes_does_not_land(stretch: float, closed: bool) -> None:
    """A force stretches the bar by a length, F = E A u / L, against a gap of 1 um."""
    solution = solved(stopped(stretch * E * 1e-4 / 0.1))
    assert str(solution.outcome.settings["time scheme"]).startswith("generalized_alpha (bodies land: stop")
    found = [w for w in remarks(solution) if "are closed in the equilibrium of the start" in w]
    assert bool(found) is closed
    if closed:
        assert "chosen for the gaps of stop" in found[0]
        assert 'time.scheme = "hht"' in found[0]
