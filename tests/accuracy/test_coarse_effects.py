"""``explain --run``: what a coarse run finds about contact, friction and waves, against cases that are known."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.accuracy.coarse_effects import coarse_run
from latin_fmu.cli import main
from latin_fmu.reader import load_scene
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine

MODELS = Path(__file__).parents[2] / "models"
LENGTH, SPEED = 0.1, float(np.sqrt(STEEL.young / STEEL.density))


def bar(law: Any, crossings: float, nu: float = 0.0) -> dict[str, Any]:
    """A bar held at its foot, pressed at its top, for so many crossings of a wave."""
    made = column(
        {"bar": Box(STEEL, (0.01, 0.01, LENGTH), (1, 1, 20))},
        {},
        {"end": crossings * LENGTH / SPEED, "instants": int(40 * crossings)},
        boundary={"base": {"type": "fixed", "face": "bar.zmin", "components": ["z"]}},
        load={"push": {"face": "bar.zmax", "pressure": 1e6, "law": law}},
    )
    made["material"]["steel"]["poisson_ratio"] = nu
    return made


def findings(tables: dict[str, Any]) -> list[str]:
    run = coarse_run(latin_fmu.scene_from_dict(copy.deepcopy(tables)))
    assert run.converged
    return run.findings


@pytest.mark.parametrize(("mu", "words"), [(10.0, "no point slips at mu = 10"), (0.1, "% of the contact slips")])
def test_friction_that_holds_everything_is_named(mu: float, words: str) -> None:
    path = MODELS / "two_specimen_crushing" / "scene.toml"
    run = coarse_run(load_scene(path, [f"interface.crush.friction_coefficient={mu}"]))
    assert sum(words in finding for finding in run.findings) == 1
    fine = latin_fmu.solve(load_scene(path, [f"interface.crush.friction_coefficient={mu}"]))
    slips = (fine.interfaces["crush"].contact_status == 2).mean()
    assert bool(slips < 1e-3) is (mu > 1.0)  # the same on the mesh of the scene


def test_slow_loads_make_a_bar_quasi_static_and_sudden_ones_do_not() -> None:
    """Half-sine over 60 crossings: vibrations stay at (pi / 2 n)^2 / 2 of the strain energy, n crossings a quarter
    wave; a step that stays makes an undamped bar swing about its equilibrium: kinetic and strain energy swap."""
    slow = bar(half_sine(60 * LENGTH / SPEED), 80.0)
    assert sum("bar is quasi-static" in f for f in findings(slow)) == 1
    sudden = bar("step", 20.0)
    sudden["time"]["scheme"] = "newmark"
    assert sum("bar vibrates until the end" in f for f in findings(sudden)) == 1


def blocks(**interface: Any) -> dict[str, Any]:
    block = Box(STEEL, (0.01, 0.01, 0.02), (2, 2, 4))
    return column(
        {"low": block, "high": block},
        {"meet": interface},
        {"end": 2e-5, "instants": 100},
        boundary={"base": {"type": "fixed", "face": "low.zmin"}},
        load={"push": {"face": "high.zmax", "pressure": 1e8, "law": half_sine(4e-5)}},
    )


def test_a_gap_that_stays_open() -> None:
    made = blocks(gap=1e-3)
    found = findings(made)
    assert any("interface meet is always open: the smallest gap is" in f for f in found)
    assert any("substructure low stays at rest" in f for f in found)


def test_a_contact_that_is_as_good_as_bonded_is_and_the_remedy_holds() -> None:
    """Neither opens nor slips: the bonded scene has the same forces."""
    made = blocks(friction_coefficient=2.0)
    made["interface"]["meet"]["preload"] = 1e7
    assert any('behaviour = "perfect" gives the same changes of forces' in f for f in findings(made))
    free = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(made))).interfaces["meet"].force()
    made["interface"]["meet"] = {k: made["interface"]["meet"][k] for k in ("sides",)} | {"behaviour": "perfect"}
    bonded = latin_fmu.solve(latin_fmu.scene_from_dict(made)).interfaces["meet"].force()
    held = free - free[0]  # without the preload
    assert np.abs(held - bonded).max() <= 2e-2 * np.abs(bonded).max()


def test_a_hard_body_on_a_soft_one_is_as_good_as_rigid() -> None:
    made = blocks(friction_coefficient=0.0)
    made["boundary"] = {}
    made["material"]["rubber"] = {"young_modulus": 1e7, "poisson_ratio": 0.3, "density": 1000.0}
    made["substructure"]["low"]["material"] = "rubber"
    made["substructure"]["high"]["initial_velocity"] = [0.0, 0.0, -1.0]
    made["load"], made["time"] = {}, {"end": 5e-4, "instants": 200}
    assert any("high is practically rigid" in f for f in findings(made))


def test_increments_have_no_waves() -> None:
    run = coarse_run(load_scene(MODELS / "pressed_plates" / "scene.toml"))
    assert run.converged
    assert all(f.startswith("interface i") or f.startswith("friction") for f in run.findings)


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    path = str(MODELS / "impact_bar" / "scene.toml")
    assert main(["explain", path, "--run", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["coarse_run"]) == {"description", "converged", "findings"}
