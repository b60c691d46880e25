"""Remarks on waves: one line at most, and only where the answer may depend on how waves are followed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.wave_pace import SLOW, load_pace, longest_transit, waves_count
from latin_fmu.building import discretise

LENGTH = 0.05
SHEAR = float(np.sqrt(210e9 / (2 * 1.3) / 7800.0))
TRANSIT = 2 * LENGTH / SHEAR
"""Of a shear wave along both blocks, s: 31 us."""


def blocks(law: Any, **keys: Any) -> latin_fmu.Scene:
    """A block on a thin, soft one, clamped: the mesh of one is too coarse for the step, the step too long for that of
    the other."""
    tables = {
        "name": "blocks",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "substructure": {
            "low": {"material": "steel", "box": {"size": [0.02, 0.02, LENGTH], "elements": [1, 1, 2]}},
            "high": {
                "material": "steel",
                "box": {"origin": [0.0, 0.0, LENGTH], "size": [0.02, 0.02, LENGTH], "elements": [1, 1, 60]},
            },
        },
        "interface": {"joint": {"sides": ["low.zmax", "high.zmin"]}},
        "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
        "load": {"push": {"face": "high.zmax", "pressure": 1e6, "law": law}},
        "time": {"end": 0.02, "step": 1e-4, "scheme": "hht"},
    }
    return latin_fmu.scene_from_dict(tables | keys)


def on_waves(scene: latin_fmu.Scene) -> list[str]:
    problem = discretise(scene).build()
    return [text for text in problem.warnings if text.code in ("resolution", "step")]


def test_a_slow_pulse_has_no_line_on_waves() -> None:
    """6 ms over the longest transit of 31 us: 62 times slower over its steepest flank."""
    assert on_waves(blocks({"type": "half_sine", "duration": 6e-3})) == []


@pytest.mark.parametrize(
    ("law", "keys"),
    [
        ({"type": "half_sine", "duration": 8e-4}, {}),
        ("step", {}),
        ("constant", {}),  # acts suddenly, without an equilibrium before it
        ({"type": "half_sine", "duration": 6e-3}, {"motion": {"velocity": [0.0, 0.0, -1.0]}, "boundary": {}}),
        (
            {"type": "half_sine", "duration": 6e-3},
            {"interface": {"joint": {"sides": ["low.zmax", "high.zmin"], "gap": 1e-4}}},
        ),
    ],
)
def test_what_excites_waves_has_one_line(law: Any, keys: dict[str, Any]) -> None:
    (text,) = on_waves(blocks(law, **keys))
    assert "to follow a wave at" in text


def test_a_constant_load_of_an_equilibrium_has_none() -> None:
    time = {"end": 0.02, "step": 1e-4, "scheme": "hht", "start": "static"}
    assert on_waves(blocks("constant", time=time)) == []


def test_a_step_that_is_far_off_says_that_alone() -> None:
    (text,) = on_waves(blocks("step", time={"end": 1.0, "step": 1e-2, "scheme": "hht"}))
    assert "in a step: waves are not resolved" in text
    assert on_waves(blocks({"type": "half_sine", "duration": 1.0}, time={"end": 1.0, "step": 1e-2})) == []


def test_pace_and_transit_are_those_of_their_formulas() -> None:
    """A half sine changes fastest at its start, by its peak in T / pi."""
    for duration in (6e-3, 4e-4):
        time = {"end": 0.02, "step": 1e-5}
        made = discretise(blocks({"type": "half_sine", "duration": duration}, time=time))
        assert load_pace(made.scene, made.time) == pytest.approx(duration / np.pi, rel=1e-2)
        assert longest_transit(made.bodies) == pytest.approx(TRANSIT, rel=1e-9)
        slow = duration / np.pi > SLOW * TRANSIT
        assert waves_count(made.scene, made.bodies, made.units, made.time) == (not slow)
