"""Bodies that are never touched are left out of a run with the same results; where one is touched it is repeated."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu import building as problems
from latin_fmu.assembly.untouched import touched
from latin_fmu.building import discretise
from latin_fmu.results.checkpoint import Checkpoint
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import ALUMINIUM, EDGE, STEEL, Box, column, half_sine
from tests.results import synthetic
from tests.scenes import solve

GAP = 2e-3
FIELDS = ("traction", "velocity", "gap", "contact_status", "friction_power", "initial_gap", "areas", "points")
CHOICE = "left out, never touched"
STARTS = {"type": "velocity", "law": "step"}


def lidded(gap: float = GAP, speed: float = 0.0, long: int = 4, **tables: Any) -> dict[str, Any]:
    """Two blocks, crushed on their sides, with a lid above a gap, which is held at its top; ``speed`` of the upper,
    ``long`` elements high."""
    low, up = (Box(material, (EDGE,) * 3, (3, 3, long)) for material in (ALUMINIUM, STEEL))
    tables = {"solver": {"tolerance": 1e-8}, "output": {"energy": True}, "time": {}} | tables
    made = column(
        {"low": low, "up": Box(STEEL, (EDGE,) * 3, (3, 3, long), (0.0, 0.0, speed)), "lid": up},
        {"meet": {"friction_coefficient": 0.3}, "top": {"friction_coefficient": 0.2}},
        {"end": 8e-6, "instants": 40, "scheme": {"type": "hht"}, **tables.pop("time")},
        boundary={
            "base": {"type": "symmetry", "face": "low.zmin"},
            "held": {"type": "fixed", "face": "lid.zmax"},
            **tables.pop("boundary", {}),
        },
        load={
            "press": {"face": "up.xmax", "pressure": 2e8, "law": half_sine(6e-6)},
            "side": {"face": "low.xmin", "pressure": 1e8, "law": half_sine(5e-6)},
            **tables.pop("load", {}),
        },
        **tables,
    )
    made["substructure"]["lid"]["box"]["origin"][2] += gap
    made["interface"]["top"]["gap"] = gap
    return made


def with_all(tables: dict[str, Any]) -> latin_fmu.Solution:
    """The solution of a run with all bodies."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(problems, "never_touched", lambda *_: frozenset())
        return solve(tables)


@pytest.fixture
def guess_lid(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lid is always left out first."""
    real: Callable[..., frozenset[str]] = problems.never_touched

    def guessed(scene: Scene, *rest: Any) -> frozenset[str]:
        return frozenset({"lid"}) if scene.solver.skip_at_rest != "off" else real(scene, *rest)

    monkeypatch.setattr(problems, "never_touched", guessed)


def without_lid(tables: dict[str, Any]) -> dict[str, Any]:
    """The scene of the two blocks alone."""
    alone = copy.deepcopy(tables)
    del alone["substructure"]["lid"], alone["interface"]["top"], alone["boundary"]["held"]
    return alone


def test_the_bits_are_those_of_the_scene_without_the_body() -> None:
    tables = lidded()
    few, alone = solve(tables), solve(without_lid(tables))
    assert few.outcome.settings[CHOICE] == "lid"
    assert few.outcome.settings["time scheme"] == alone.outcome.settings["time scheme"]
    for field in FIELDS:
        ours, theirs = (getattr(s.interfaces["meet"], field) for s in (few, alone))
        np.testing.assert_array_equal(ours, theirs, err_msg=field)
    for term, values in alone.energy.items():
        np.testing.assert_array_equal(few.energy[term], values, err_msg=term)


@pytest.mark.parametrize("scheme", ["hht", "automatic", "generalized_alpha", "massless_contact"])
@pytest.mark.parametrize("side", [0, 1])
def test_the_results_are_those_with_all_bodies(side: int, scheme: str) -> None:
    """To the tolerance, what is stored of the body left out and of its interface included, contact layers of the faces
    towards it too; ``side`` : that of the interface which is in the run. Automatic: its gap counts as a landing."""
    tables = lidded(time={"scheme": {"type": scheme}}, long=14 if scheme == "automatic" else 4)
    if side == 1:
        tables["interface"]["top"]["sides"].reverse()
    few, every = solve(tables), with_all(tables)
    assert few.outcome.settings[CHOICE] == "lid"
    assert CHOICE not in every.outcome.settings
    assert few.outcome.settings["time scheme"] == every.outcome.settings["time scheme"]
    assert list(few.interfaces) == list(every.interfaces) == ["meet", "top"]
    assert list(few.substructures) == list(every.substructures) == ["low", "up", "lid"]
    for name, history in few.interfaces.items():
        for field in FIELDS:
            ours, theirs = (np.asarray(getattr(h, field)) for h in (history, every.interfaces[name]))
            assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype), field
            np.testing.assert_allclose(
                ours, theirs, rtol=0, atol=2e-5 * np.abs(theirs).max(), err_msg=f"{name} {field}"
            )
    travel = GAP - few.interfaces["top"].gap
    assert np.abs(travel).max() > 1e-7
    np.testing.assert_allclose(travel, GAP - every.interfaces["top"].gap, rtol=0, atol=1e-5 * np.abs(travel).max())
    for term, values in few.energy.items():
        np.testing.assert_allclose(values, every.energy[term], rtol=0, atol=1e-6 * every.energy["work_of_loads"].max())
    assert set(few.substructures["lid"].energy) == set(every.substructures["lid"].energy)
    ours, theirs = ([w.split(" (")[0] for w in s.warnings if "never touch" in w] for s in (few, every))
    assert len(ours) == 1
    assert ours == theirs
    assert few.outcome.interface_indicator["top"] == 0.0


def test_a_gap_that_a_step_would_close_has_touched() -> None:
    """1 um wide at every instant, closing at 1 m/s at the last one: in steps beyond 1 us."""
    made = synthetic.contact("top", np.linspace(0.0, 1.0, 3), 2.0, 3.0, 1e8)
    velocity = np.zeros_like(made.velocity)
    velocity[2, 1, :, 2] = -1.0
    open_ = replace(made, gap=np.full(made.gap.shape, 1e-6), velocity=velocity)
    assert not touched([open_], 0.99e-6)
    assert touched([open_], 1.01e-6)
    assert not touched([replace(open_, velocity=-velocity)], 1.0)
    assert not touched([replace(open_, velocity=velocity[:, ::-1])], 1.0)
    last = velocity[:, 1, :, 2] < 0.0
    assert touched([replace(open_, gap=np.where(last, np.nan, 1e-6))], 0.99e-6)
    assert touched([replace(open_, gap=np.where(last, -1e-7, 1e-6), velocity=-velocity)], 1.0)  # closed, if opening


@pytest.mark.usefixtures("guess_lid")
def test_a_guess_that_was_wrong_is_found_and_all_bodies_are_solved_for() -> None:
    """The upper block is thrown against the lid: the bits are those of a run with all bodies."""
    tables = lidded(gap=2e-5, speed=10.0)
    guessed, every = solve(tables), with_all(tables)
    assert np.abs(every.interfaces["top"].traction).max() > 1e6
    assert CHOICE not in guessed.outcome.settings
    for name, history in guessed.interfaces.items():
        np.testing.assert_array_equal(history.traction, every.interfaces[name].traction)
        np.testing.assert_array_equal(history.gap, every.interfaces[name].gap)


@pytest.mark.parametrize(
    "change",
    [
        {"solver": {"skip_at_rest": "off"}},
        {"output": {"fields": True}},
        {"output": {"reactions": True}},
        {"output": {"interfaces_every": 2}},
        {"sensor": {"tip": {"face": "lid.zmin"}}},
        {"gravity": {"acceleration": [0.0, 0.0, -9.81]}},
        {"speed": 1e3},
        {"gap": 1e-5},
        {"time": {"scheme": {"type": "central_difference"}}},
        {"solver": {"propagator": {"type": "reduced", "modes": 10}}},
        {"time": {"start": "static"}},
        {"load": {"on_lid": {"face": "lid.xmin", "pressure": 1e5}}},
        {"boundary": {"held": {"face": "lid.zmax", "components": ["z"], "value": [1.0], **STARTS}}},
    ],
    ids=lambda change: " ".join(change),
)
def test_all_bodies_stay_where_something_asks_for_them(change: dict[str, Any]) -> None:
    """Outputs of the lid, loads and motions on it, gaps that the others may close, and modes of bodies, which depend on
    all their faces."""
    scene = latin_fmu.scene_from_dict(lidded(**change))
    assert discretise(scene, leave_out=True).untouched is None
    assert discretise(latin_fmu.scene_from_dict(lidded()), leave_out=True).untouched is not None


@pytest.mark.parametrize("guessed", [True, False], ids=["of the run without", "of the run with all bodies"])
def test_a_run_that_is_stopped_goes_on_from_its_checkpoint(tmp_path: Path, guessed: bool) -> None:
    """The bodies of the checkpoint count, not the guess at the time of the second call."""
    scene, path = latin_fmu.scene_from_dict(lidded()), tmp_path / "run.checkpoint"
    calls, said = iter([False] * 3 + [True] * 100), list[str]()
    first = Checkpoint(path, every=5, stop=lambda: next(calls))
    with pytest.MonkeyPatch.context() as patch:
        if not guessed:
            patch.setattr(problems, "never_touched", lambda *_: frozenset())
        whole, stopped = latin_fmu.solve(scene), latin_fmu.solve(scene, checkpoint=first)
    assert stopped.interrupted
    assert len(stopped.outcome.time) < 41
    resumed = latin_fmu.solve(scene, checkpoint=Checkpoint(path, resume=True, log=said.append))
    assert "continued from" in said[-1]
    assert (CHOICE in resumed.outcome.settings) is guessed
    for name, history in whole.interfaces.items():
        for field in ("traction", "velocity", "gap"):
            np.testing.assert_array_equal(getattr(resumed.interfaces[name], field), getattr(history, field))
