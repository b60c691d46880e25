"""Bodies that nothing holds, under loads in balance: their strains are those of a statically determinate support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import latin_fmu
from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import STEEL, Box, column
from latin_fmu.statics import starts
from tests.scenes import solve

Tables = dict[str, Any]
EXACT, PULL = 1e-8, 50e6
SIDE, HEIGHT = 0.02, 0.03
RAMP = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}


def bars(behaviour: str = "contact", scale: float = 1.0, **time: Any) -> Tables:
    """Two bars pressed together by their ends, and sheared by tractions in balance, whose couples are, too."""
    keys = {"friction_coefficient": 0.4} if behaviour == "contact" else {}
    made = column(
        {name: Box(STEEL, (SIDE, SIDE, HEIGHT), (2, 2, 3)) for name in ("b1", "b2")},
        {"i1": {"behaviour": behaviour, **keys}},
        {"end": 1.0, "instants": 3, "quasi_static": True} | time,
        solver={"tolerance": 1e-11, "max_iterations": 5000},
        output={"fields": True, "stress": True, "reactions": True},
    )
    for face, traction in {
        "b1.zmin": [2e6, 0.0, PULL],
        "b2.zmax": [-2e6, 0.0, -PULL],
        "b2.xmin": [1e6, 3e6, 4e6],
        "b2.xmax": [-1e6, -3e6, -4e6],
        "b2.ymin": [3e6, 2e6, 0.0],
        "b2.ymax": [-3e6 * scale, -2e6, 0.0],
    }.items():
        made["load"][face.replace(".", "_")] = {"face": face, "traction": traction, "law": RAMP}
    return made


def stresses(solution: latin_fmu.Solution) -> np.ndarray:
    return np.concatenate([np.asarray(b.stress)[-1] for b in solution.substructures.values()])


def off(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


def held_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three, two and one displacements of three corners of the lower bar are held, whatever is chosen."""

    def by_hand(groups: Sequence[Any], bodies: Any, conditions: Any, units: Any) -> Any:  # noqa: ARG001
        nodes = bodies["b1"].mesh.nodes
        corners = SIDE * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        origin, on_x, on_y = (int(np.abs(nodes - corner).sum(axis=1).argmin()) for corner in corners)
        dofs = [3 * origin, 3 * origin + 1, 3 * origin + 2, 3 * on_x + 1, 3 * on_x + 2, 3 * on_y + 2]
        own = conditions["b1"]
        kept = np.setdiff1d(np.arange(own.expansion.shape[1]), own.expansion[dofs].indices)
        return conditions | {"b1": replace(own, expansion=sp.csr_array(own.expansion[:, kept]))}

    monkeypatch.setattr(starts, "with_place", by_hand)


@pytest.mark.parametrize("behaviour", ["contact", "perfect"])
def test_stresses_are_those_of_a_statically_determinate_support(
    behaviour: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = solve(bars(behaviour))
    held_by_hand(monkeypatch)
    pinned = solve(bars(behaviour))
    assert off(stresses(free), stresses(pinned)) < EXACT
    assert off(free.interfaces["i1"].traction, pinned.interfaces["i1"].traction) < EXACT
    places = [s.substructures["b2"].displacement[-1] for s in (free, pinned)]
    assert off(places[0], places[1]) > 1e-2  # another place


def test_no_support_carries_anything() -> None:
    """The forces on every body are in balance without a reaction, and a pull alone gives the uniform stress p."""
    tables = bars()
    tables["load"] = {n: load for n, load in tables["load"].items() if "z" in n}
    for load in tables["load"].values():
        load["traction"][0] = 0.0
    solution = solve(tables)
    stress = stresses(solution)
    assert np.abs(stress[:, 2] + PULL).max() < EXACT * PULL
    assert np.abs(np.delete(stress, 2, axis=1)).max() < EXACT * PULL
    meeting = solution.interfaces["i1"]
    assert meeting.areas @ meeting.traction[-1] == pytest.approx(
        [0.0, 0.0, -PULL * SIDE**2], abs=EXACT * PULL * SIDE**2
    )


def test_loads_out_of_balance_are_told_with_their_number() -> None:
    with pytest.raises(SceneError, match=r"substructure: nothing holds b1, b2.*move .*out of balance by") as caught:
        solve(bars(scale=1.001))
    assert "[-1.8, 0, 0] N" in str(caught.value)
    assert "balance its loads" in str(caught.value)
    tables = bars()
    tables["load"]["b2_xmin"]["law"] = "input"
    with pytest.raises(SceneError, match="out of balance"):  # an input is in balance with nothing
        solve(tables)


def test_a_couple_is_out_of_balance_too() -> None:
    tables = bars()
    tables["load"]["b2_ymin"]["traction"][0] = tables["load"]["b2_ymax"]["traction"][0] = 0.0
    with pytest.raises(SceneError, match="out of balance"):
        solve(tables)


def test_a_static_start_of_a_free_assembly_stays_at_rest() -> None:
    """Tightened and let go: under loads in balance nothing moves."""
    tables = bars(quasi_static=False, end=2e-5, instants=40, start="static")
    for load in tables["load"].values():
        load["law"] = "constant"
    solution = solve(tables)
    speed = max(float(np.abs(b.velocity).max()) for b in solution.substructures.values())
    c = np.sqrt(STEEL.young / STEEL.density)
    assert speed < EXACT * PULL / (STEEL.density * c)
    assert any("takes the place with the least displacement" in w for w in solution.outcome.warnings)
    del tables["load"]["b2_zmax"]
    with pytest.raises(SceneError, match="nothing holds b1, b2"):
        solve(tables)


def test_a_block_on_ice_has_a_place_where_nothing_pushes_it_along() -> None:
    """Without friction a pressed block can slide; where nothing pushes it, it stays."""
    tables = bars()
    tables["interface"]["i1"]["friction_coefficient"] = 0.0
    tables["boundary"]["base"] = {"type": "fixed", "face": "b1.zmin"}
    tables["load"] = {"press": {"face": "b2.zmax", "pressure": PULL, "law": RAMP}}
    solution = solve(tables)
    meeting = solution.interfaces["i1"]
    assert meeting.areas @ meeting.traction[-1, :, 2] == pytest.approx(-PULL * SIDE**2, rel=EXACT)
    tables["load"]["push"] = {"face": "b2.xmin", "force": [1.0, 0.0, 0.0], "law": RAMP}
    with pytest.raises(SceneError, match=r"b2 can move along x, along y and turn.*by \[1, 0, 0\] N"):
        solve(tables)
