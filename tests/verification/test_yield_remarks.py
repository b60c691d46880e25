"""Bodies beyond the yield stress of their material: a rod pulled at its end, whose stress is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu import scene_from_dict, solve
from latin_fmu.fem.elasticity import von_mises
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.results.solution import Solution

PULL, TURN, END = 100e6, 1e-4, 2e-4  # Pa, s, s


def rod(yield_stress: float | None, checkpoint: Checkpoint | None = None, **other: Any) -> Solution:
    """A rod that is free to contract, pulled at its end by a stress that rises to 100 MPa and falls again."""
    steel = {"young_modulus": 200e9, "poisson_ratio": 0.3, "density": 7800.0}
    box = {"size": [0.01, 0.01, 0.1], "elements": [1, 1, 10], "origin": [0.0, 0.0, 0.0]}
    held = {axis: {"type": "fixed", "face": f"rod.{axis}min", "components": [axis]} for axis in "xyz"}
    law = {"type": "table", "times": [0.0, TURN, END], "values": [0.0, 1.0, 0.0]}
    data: dict[str, Any] = {
        "name": "rod",
        "material": {"steel": steel if yield_stress is None else steel | {"yield_stress": yield_stress}},
        "substructure": {"rod": {"material": "steel", "box": box}},
        "boundary": held,
        "load": {"pull": {"face": "rod.zmax", "traction": [0.0, 0.0, PULL], "law": law}},
        "sensor": {"tip": {"face": "rod.zmax"}},
        "time": {"end": END, "step": 1e-6},
    }
    return solve(scene_from_dict(data | other), checkpoint=checkpoint)


def told(solution: Solution) -> list[str]:
    return [str(warning) for warning in solution.warnings if getattr(warning, "code", "") == "yield"]


def test_a_rod_in_equilibrium_has_the_stress_of_its_load() -> None:
    """sigma = F / A in every element, largest at the turn of the load; nothing is told below the yield stress."""
    still = {"time": {"quasi_static": True, "end": END, "instants": 20}}
    (text,) = told(rod(80e6, **still))
    assert "substructure rod exceeds its yield stress 80.00 MPa: von Mises stress of at least 100.0 MPa" in text
    assert "MPa at 100 us, mean of the element" in text
    assert "10 of 10 elements above. The model is elastic" in text
    assert told(rod(101e6, **still)) == []
    assert told(rod(None, **still)) == []


def test_a_temperature_that_is_hindered_counts() -> None:
    """E alpha T of a rod held at both ends that expands along its axis alone: 200e9 x 12e-6 x 50 = 120 MPa, without any
    strain."""
    constants = {"young_moduli": [200e9] * 3, "poisson_ratios": [0.0] * 3, "shear_moduli": [100e9] * 3}
    along = {"orthotropic": constants | {"thermal_expansions": [0.0, 0.0, 12e-6]}, "density": 7800.0}
    fixed = {"type": "fixed", "face": "rod.zmax", "components": ["z"]}
    held = {axis: {"type": "fixed", "face": f"rod.{axis}min", "components": [axis]} for axis in "xyz"}
    heated = {"heat": {"substructures": ["rod"], "change": 50.0}}
    solution = rod(
        110e6,
        material={"steel": along | {"yield_stress": 110e6}},
        boundary=held | {"end": fixed},
        load={},
        temperature=heated,
        time={"quasi_static": True, "end": 1.0, "instants": 2},
    )
    assert "von Mises stress of at least 120.0 MPa at " in told(solution)[0]


@pytest.mark.parametrize("stored", [False, True], ids=["alone", "with stored stresses"])
def test_waves_are_seen_when_they_are_largest(stored: bool) -> None:
    """The same element, instant and count as in stored stresses of all instants, and no bit of the motion changes."""
    known = rod(None, output={"stress": True})
    stress = von_mises(np.asarray(known.substructures["rod"].stress))
    i, element = (int(k) for k in np.unravel_index(int(stress.argmax()), stress.shape))
    watched = rod(80e6, output={"stress": stored})
    place = 0.005 + 0.01 * element
    (text,) = told(watched)
    assert f"{stress.max() / 1e6:.1f} MPa at {1e6 * known.time[i]:.0f} us, mean" in text
    assert f"mean of the element at [0.005, 0.005, {place:.4g}]" in text
    assert f"{(stress[i] > 80e6).sum()} of 10 elements above" in text
    assert (watched.sensors["tip"].displacement == known.sensors["tip"].displacement).all()


def test_many_bodies_are_one_sentence() -> None:
    """The worst one is described, four more are named with their stresses, the rest is counted."""
    box = {"size": [0.01, 0.01, 0.01], "elements": [1, 1, 1]}
    names = [f"b{i}" for i in range(7)]
    solution = rod(
        80e6,
        substructure={n: {"material": "steel", "box": box | {"origin": [0.02 * i, 0, 0]}} for i, n in enumerate(names)},
        boundary={n: {"type": "fixed", "face": f"{n}.zmin"} for n in names},
        load={
            n: {"face": f"{n}.zmax", "traction": [0.0, 0.0, (200.0 + i) * 1e6], "law": {"type": "constant"}}
            for i, n in enumerate(names)
        },
        sensor={},
        time={"quasi_static": True, "end": 1.0, "instants": 2},
    )
    (text,) = told(solution)
    assert text.startswith("substructure b6 exceeds its yield stress 80.00 MPa: von Mises stress of at least ")
    assert text.count(" MPa at ") == 5
    assert "; also b5 (" in text
    assert "), 2 more. The model is elastic" in text


def test_a_continued_run_tells_what_was_before(tmp_path: Path) -> None:
    """Stopped at 0.16 ms, after the largest stress at 0.12 ms."""
    calls = iter(range(10**6))
    stopped = rod(80e6, Checkpoint(tmp_path / "rod.ckpt", every=1, stop=lambda: next(calls) >= 160))
    assert not stopped.complete
    assert stopped.time[-1] > 1.25e-4
    assert told(rod(80e6, Checkpoint(tmp_path / "rod.ckpt", resume=True, log=lambda _: None))) == told(rod(80e6))


def test_von_mises_of_known_stresses() -> None:
    """Tension: itself; shear: sqrt(3) times it; pressure: none."""
    stresses = np.array([[3.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0], [5.0, 5.0, 5.0, 0, 0, 0]])
    assert von_mises(stresses) == pytest.approx([3.0, 2.0 * np.sqrt(3.0), 0.0])
