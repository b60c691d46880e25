"""Substructures that no wave has reached are not marched: how many instants that saves, and what it changes."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.inactive_substructures import arrival_times, cut_by_arrival
from latin_fmu.building import build, discretise
from latin_fmu.effects.explanation import explain
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine
from tests.scenes import solve

LENGTH = 0.02
TRANSIT = LENGTH / STEEL.pressure_speed
STARTS = {"type": "velocity", "law": "step"}


def chain(
    n: int = 8, transits: float = 2.9, elements: int = 10, behaviour: str = "perfect", **solver: Any
) -> dict[str, Any]:
    """``n`` blocks in a row, half-sine pressure of one transit on the first: the wave is in the third at the end."""
    block = Box(STEEL, (0.01, 0.01, LENGTH), (1, 1, elements))
    return column(
        {f"b{i}": block for i in range(1, n + 1)},
        {f"i{i}": {"behaviour": behaviour} for i in range(1, n)},
        {"end": transits * TRANSIT, "instants": round(4 * elements * transits)},
        solver={"skip_unchanged": False} | solver,
        load={"push": {"face": "b1.zmin", "pressure": 1e8, "law": half_sine(TRANSIT)}},
        output={"fields": True},
    )


def arrivals(tables: dict[str, Any]) -> dict[str, float]:
    prepared = discretise(latin_fmu.scene_from_dict(copy.deepcopy(tables)))
    return arrival_times(prepared.scene, prepared.bodies, prepared.units, prepared.time)


def apart(first: latin_fmu.Solution, second: latin_fmu.Solution) -> tuple[float, float]:
    """Largest difference of displacements and of forces, relative to the largest of the second."""
    moved = max(np.abs(h.displacement).max() for h in second.substructures.values())
    force = max(np.abs(h.force()).max() for h in second.interfaces.values()) or 1.0
    return (
        max(np.abs(h.displacement - second.substructures[n].displacement).max() for n, h in first.substructures.items())
        / moved,
        max(np.abs(h.force() - second.interfaces[n].force()).max() for n, h in first.interfaces.items()) / force,
    )


# -- the count ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("behaviour", ["perfect", "contact"])
def test_eight_bodies_of_which_the_wave_reaches_three(behaviour: str) -> None:
    """Marched: below 45 % of all substructure-instants; the result changes by less than the tolerance of 1e-5."""
    rules = ("off", "tolerance")
    every, few = (solve(chain(behaviour=behaviour, elements=16, skip_at_rest=s, tolerance=1e-5)) for s in rules)
    assert every.outcome.marched == 1.0
    assert few.outcome.marched < 0.45
    displacement, force = apart(few, every)
    assert displacement < 1e-5
    assert force < 1e-5
    for name in ("b6", "b7", "b8"):
        assert not few.substructures[name].displacement.any()


@pytest.mark.parametrize("window", [7, "whole"])
def test_long_windows_pass_over_bodies_at_rest_too(window: Any) -> None:
    every, few = (solve(chain(4, 1.5, window=window, bonds="iterate", skip_at_rest=s)) for s in ("off", "tolerance"))
    assert few.outcome.marched < 0.8 * every.outcome.marched
    assert max(apart(few, every)) < 2e-3  # two runs iterated to 1e-3


def test_energies_are_accounted_for_all_the_same() -> None:
    tables = chain(4)
    tables["output"]["energy"] = True
    every, few = (solve({**tables, "solver": {"skip_at_rest": s}}).energy for s in ("off", "tolerance"))
    for term in ("kinetic", "elastic", "work_of_loads"):
        np.testing.assert_allclose(few[term], every[term], atol=1e-4 * every["work_of_loads"].max())
    # the traction that a body woken now did not see before is in its work
    assert np.abs(few["balance"]).max() < 1e-11 * few["work_of_loads"].max()


# -- exactly ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("window", [1, 5])
def test_what_nothing_has_reached_is_passed_over_exactly(window: int) -> None:
    """A gap that closes late and a load that starts late: the same to the last bit, with fewer instants marched."""
    tables = chain(3, 3.4, behaviour="contact", window=window)
    tables["interface"]["i2"]["gap"] = 2e-6
    tables["load"]["push"]["law"]["start"] = 0.5 * TRANSIT
    every, few = (
        solve({**tables, "solver": {"window": window, "skip_at_rest": s, "skip_unchanged": False}})
        for s in ("off", "exact")
    )
    assert few.outcome.marched < 0.7 * every.outcome.marched
    assert few.interfaces["i2"].traction.any()  # it does close
    for name, history in few.substructures.items():
        np.testing.assert_array_equal(history.displacement, every.substructures[name].displacement)
        np.testing.assert_array_equal(history.velocity, every.substructures[name].velocity)
    for name, history in few.interfaces.items():
        np.testing.assert_array_equal(history.traction, every.interfaces[name].traction)


@pytest.mark.parametrize(
    "moving",
    [
        {"substructure": {"initial_velocity": [0.0, 0.0, 1.0]}},
        {"substructure": {"initial_spin": [1.0, 0.0, 0.0]}},
        {"substructure": {"body_force": [0.0, 0.0, 1e6]}},
        {"boundary": {"tool": {"face": "b2.zmax", "components": ["z"], "value": [1.0], **STARTS}}},
        {
            "interface": {
                "g": {
                    "sides": ["b2.zmax", "ground"],
                    "ground_velocity": {"direction": [0.0, 0.0, -1.0], "amplitude": 1.0},
                }
            }
        },
    ],
    ids=["velocity", "spin", "weight", "driven", "ground"],
)
def test_nothing_that_moves_is_passed_over(moving: dict[str, Any]) -> None:
    tables = chain(2, 0.5, behaviour="contact")
    del tables["load"]
    tables["substructure"]["b2"] |= moving.get("substructure", {})
    tables["interface"] |= moving.get("interface", {})
    tables["boundary"] = moving.get("boundary", {})
    every, few = (solve({**tables, "solver": {"skip_at_rest": s}}) for s in ("off", "exact"))
    assert few.substructures["b2"].displacement.any()
    assert apart(few, every) == (0.0, 0.0)


def test_rounding_errors_do_not_wake_a_body() -> None:
    """The default: fewer substructure-instants than where nothing but zero counts as rest, the same to round-off."""
    scenes = {s: chain(elements=16, bonds="iterate", skip_at_rest=s) for s in ("exact", "round_off")}
    every, few = (solve(scene) for scene in scenes.values())
    assert few.outcome.marched < 0.9 * every.outcome.marched
    assert few.outcome.passes < every.outcome.passes - 0.1
    assert max(apart(few, every)) < 1e-10
    assert solve(chain(elements=16, bonds="iterate")).outcome.marched == few.outcome.marched


# -- arrival times ------------------------------------------------------------------------------------------------
def test_arrival_times_are_those_of_the_pressure_wave() -> None:
    times = arrivals(chain(4))
    np.testing.assert_allclose(list(times.values()), TRANSIT * np.arange(4), rtol=1e-12)


def test_fronts_meet_the_modulus_of_fast_motions() -> None:
    """Strong damping over three decades: the front in the last of four blocks is ahead of a wave of the static modulus,
    as its arrival time says."""
    tables = chain(4, 3.8, 20, tolerance=1e-6)
    centre = 1.0 / TRANSIT
    ratios = {"frequencies": [centre / 1e3, centre], "ratios": [0.05, 0.05]}
    for material in tables["material"].values():
        material["damping_ratios"] = ratios
    scene = latin_fmu.scene_from_dict(copy.deepcopy(tables))
    (damping,) = {material.damping for material in scene.material.values()}
    # the frequency of the pulse is in the branches' reach: the modulus there is that of fast motions to some percent
    rise = float(damping.modulus(np.array([centre])).real[0])
    assert rise > 1.4
    fast = 1.0 + sum(damping.strengths)
    assert fast > rise
    assert np.sqrt(fast) == pytest.approx(1.29, abs=0.01)
    expected = TRANSIT / np.sqrt(fast)
    np.testing.assert_allclose(list(arrivals(tables).values()), expected * np.arange(4), rtol=1e-12)
    solution = solve(tables)
    force = np.abs(solution.interfaces["i3"].force()).max(axis=1)
    met = solution.time[np.argmax(force > 0.1 * 1e8 * 1e-4)]
    assert 3 * expected < met < 0.97 * 3 * TRANSIT


def test_arrival_times_follow_what_the_scene_does() -> None:
    tables = chain(4)
    tables["load"]["push"]["law"]["start"] = 0.2 * TRANSIT
    step = tables["time"]["end"] / tables["time"]["instants"]
    assert arrivals(tables)["b1"] == pytest.approx(0.2 * TRANSIT, abs=step)
    tables["substructure"]["b2"]["rigid"] = True
    assert arrivals(tables)["b3"] == pytest.approx(1.2 * TRANSIT, abs=step)
    tables["load"]["push"]["law"] = "input"
    assert arrivals(tables)["b1"] == 0.0
    tables["substructure"]["b4"]["initial_velocity"] = [0.0, 1.0, 0.0]
    times = arrivals(tables)
    assert times["b4"] == 0.0
    assert times["b3"] == 0.0  # they touch
    tables["load"]["push"]["pressure"] = 1.0
    del tables["load"], tables["interface"]["i3"], tables["substructure"]["b4"]
    assert set(arrivals(tables).values()) == {np.inf}


# -- classes ------------------------------------------------------------------------------------------------------
def test_a_cut_class_shares_its_operators() -> None:
    assembly = build(latin_fmu.scene_from_dict(chain(skip_at_rest="tolerance"))).assembly
    whole = build(latin_fmu.scene_from_dict(chain())).assembly
    assert len(whole.propagators) == 3  # first, inner, last
    inner = [p for p in assembly.propagators if p.names[0] not in ("b1", "b8")]
    assert len(inner) > 1
    assert all(p.operators is inner[0].operators for p in inner)


def test_classes_are_cut_only_where_it_pays() -> None:
    classes = discretise(latin_fmu.scene_from_dict(chain())).classes
    names = [f"b{i}" for i in range(1, 9)]
    kept = cut_by_arrival(classes, dict.fromkeys(names, 1.0))
    assert [c.members for c in kept] == [c.members for c in classes]
    late = cut_by_arrival(classes, {n: float(n < "b4") for n in names})
    assert sorted([m.name for m in c.members] for c in late) == [["b1"], ["b2", "b3"], ["b4", "b5", "b6", "b7"], ["b8"]]
    flat = np.concatenate([c.channels.ravel() for c in late])
    assert len(np.unique(flat)) == len(flat) == sum(c.channels.size for c in classes)


def test_explain_says_when_it_pays() -> None:
    tables = chain() | {"output": {}}
    tables["time"]["instants"] *= 10
    scene = latin_fmu.scene_from_dict(tables)
    assert any("5 of 8 substructures" in s.what for s in explain(scene).suggestions)
    busy = latin_fmu.scene_from_dict(chain(2))
    assert not any("not reached" in s.what for s in explain(busy).suggestions)
