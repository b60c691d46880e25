"""Bodies that an equilibrium leaves free start in the place of least displacement, whatever they are called."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import STEEL, Box, column
from latin_fmu.statics.places_at_rest import _nearest
from tests.scenes import solve

ALPHA, CHANGE, EDGE = 1.2e-5, 50.0, 0.02
SIDE = (EDGE, EDGE, EDGE)


def heated(hot: list[str], **tables: Any) -> dict[str, Any]:
    """Two cubes, the upper one on the lower one without any load; some of them are hot."""
    scene = column(
        {"lower": Box(STEEL, SIDE, (2, 2, 2)), "upper": Box(STEEL, SIDE, (2, 2, 2))},
        {"meet": {"friction_coefficient": 0.3}},
        {"end": 1e-6, "instants": 4, "start": "static"},
        temperature={"hot": {"substructures": hot, "change": CHANGE}},
        output={"fields": True},
        **tables,
    )
    for material in scene["material"].values():
        material["thermal_expansion"] = ALPHA
    return scene


def grown(nodes: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Displacements of free expansion about a point."""
    return np.asarray(ALPHA * CHANGE * (nodes - centre))


def test_a_free_body_expands_about_its_centre() -> None:
    scene = heated(["upper"])
    del scene["interface"], scene["substructure"]["lower"]
    history = solve(scene).substructures["upper"]
    expected = grown(history.nodes, history.nodes.mean(axis=0))
    assert history.displacement[0] == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_a_hot_body_lifts_what_lies_on_it_and_moves_it_no_further() -> None:
    """The lower cube grows about its axis from the plane that it stands on; the upper one is lifted, nothing else."""
    scene = heated(["lower"], boundary={"base": {"type": "symmetry", "face": "lower.zmin"}})
    solution = solve(scene)
    lower, upper = (solution.substructures[name] for name in ("lower", "upper"))
    centre = lower.nodes.mean(axis=0) - [0.0, 0.0, 0.5 * EDGE]
    expected = grown(lower.nodes, centre)
    size = np.abs(expected).max()
    assert lower.displacement[0] == pytest.approx(expected, abs=1e-9 * size)
    lifted = np.tile([0.0, 0.0, ALPHA * CHANGE * EDGE], (len(upper.nodes), 1))
    assert upper.displacement[0] == pytest.approx(lifted, abs=1e-9 * size)
    assert not solution.interfaces["meet"].traction[0].any()
    said = [warning for warning in solution.warnings if "only contacts" in warning]
    assert len(said) == 1
    assert "substructure lower, upper: only contacts without pressure" in said[0]


PULL = [0.0, 0.0, -5.0]  # m s-2


def close_to_a_hot_body(gap: float, first: str = "upper") -> dict[str, Any]:
    """A load on the upper cube, and a gap below it that the hot lower one closes; ``first`` in the scene."""
    scene = heated(["lower"], boundary={"base": {"type": "symmetry", "face": "lower.zmin"}})
    scene["interface"]["meet"] |= {"gap": gap}
    scene["substructure"]["upper"]["body_force"] = (STEEL.density * np.array(PULL)).tolist()
    scene["substructure"] = dict(sorted(scene["substructure"].items(), key=lambda item: item[0] != first))
    return scene


@pytest.mark.parametrize("first", ["lower", "upper"])
def test_a_hot_body_pushes_what_falls_out_of_its_way(first: str) -> None:
    """The inertia of the upper cube holds its load, so that nothing can press it: it is lifted, nothing else, by what
    the lower one grows beyond the gap."""
    gap = 0.3 * ALPHA * CHANGE * EDGE
    solution = solve(close_to_a_hot_body(gap, first))
    upper, meet = solution.substructures["upper"], solution.interfaces["meet"]
    size = ALPHA * CHANGE * EDGE
    lifted = np.tile([0.0, 0.0, size - gap], (len(upper.nodes), 1))
    assert upper.displacement[0] == pytest.approx(lifted, abs=1e-8 * size)
    assert not meet.traction[0].any()


def test_a_body_that_cannot_get_out_of_the_way_is_refused() -> None:
    """Between two hot cubes that grow by more than both gaps, its place has no solution without pressure."""
    scene = close_to_a_hot_body(0.3 * ALPHA * CHANGE * EDGE)
    lid = {**scene["substructure"]["upper"], "box": {**scene["substructure"]["upper"]["box"]}}
    lid["box"]["origin"] = [0.0, 0.0, 2.0 * EDGE]
    scene["substructure"]["lid"] = lid
    scene["boundary"]["roof"] = {"type": "fixed", "face": "lid.zmax"}
    scene["interface"]["above"] = {"sides": ["upper.zmax", "lid.zmin"], "gap": 0.1 * ALPHA * CHANGE * EDGE}
    with pytest.raises(SceneError, match=r"interface\.meet.*strains of t = 0 close it") as told:
        solve(scene)
    assert 'time.start = "given"' in str(told.value)


def test_derivatives_have_the_place_too() -> None:
    """With more expansion the upper cube is lifted further, by its height over the plane, and moved nowhere else."""
    scene = heated(["lower"], boundary={"base": {"type": "symmetry", "face": "lower.zmin"}})
    (name,) = scene["material"]
    scene["sensor"] = {"top": {"face": "upper.zmax"}, "side": {"face": "lower.xmax"}}
    scene["output"] = {"sensitivities": [f"material.{name}.thermal_expansion"], "check_sensitivities": "none"}
    known = solve(scene).sensitivities
    assert known is not None
    sensors = known.derivatives[0].sensors
    # relative changes: of the displacements, which are proportional to it
    size = ALPHA * CHANGE * EDGE
    assert sensors["top"].displacement[0] == pytest.approx([0.0, 0.0, size], abs=1e-4 * size)
    assert sensors["side"].displacement[0] == pytest.approx([0.5 * size, 0.0, 0.5 * size], abs=1e-4 * size)


def test_a_body_that_shrinks_is_not_followed() -> None:
    """The lower cube shrinks away from the upper one, which stays where the scene has it."""
    scene = heated(["lower"], boundary={"base": {"type": "symmetry", "face": "lower.zmin"}})
    scene["temperature"]["hot"]["change"] = -CHANGE
    solution = solve(scene)
    assert np.abs(solution.substructures["upper"].displacement[0]).max() < 1e-9 * ALPHA * CHANGE * EDGE
    gap = solution.interfaces["meet"].gap
    assert gap is not None
    assert gap[0] == pytest.approx(np.full(gap.shape[1], ALPHA * CHANGE * EDGE), rel=1e-9)


def test_names_and_order_do_not_count() -> None:
    """A fixed base, which grows into a dome, with a cube off its middle and a hot one on that."""
    scene = heated(["lower", "top"], boundary={"base": {"type": "fixed", "face": "lower.zmin"}})
    bodies = scene["substructure"]
    bodies["upper"]["box"] |= {"origin": [0.3 * EDGE, 0.1 * EDGE, EDGE], "elements": [3, 2, 2]}
    bodies["top"] = copy.deepcopy(bodies["upper"])
    bodies["top"]["box"] |= {"origin": [0.1 * EDGE, 0.35 * EDGE, 2.0 * EDGE], "elements": [1, 2, 1]}
    scene["interface"]["over"] = {"sides": ["upper.zmax", "top.zmin"], "friction_coefficient": 0.3}
    names = {"lower": "z", "upper": "b", "top": "a"}
    other = copy.deepcopy(scene)
    other["substructure"] = {names[name]: bodies[name] for name in ("top", "upper", "lower")}
    other["interface"] = {
        name: {**scene["interface"][name], "sides": sides}
        for name, sides in (("over", ["b.zmax", "a.zmin"]), ("meet", ["z.zmax", "b.zmin"]))
    }
    other["boundary"]["base"]["face"] = "z.zmin"
    other["temperature"]["hot"]["substructures"] = ["a", "z"]
    first, second = solve(scene), solve(other)
    for body in ("upper", "top"):
        moved = first.substructures[body].displacement[0]
        assert np.abs(moved).max() > 1e-6
        found = second.substructures[names[body]].displacement[0]
        assert found == pytest.approx(moved, abs=1e-8 * np.abs(moved).max())
    for history in first.interfaces.values():
        assert history.gap is not None
        # no overlap, and a body no higher than what is below lifts it
        assert history.gap[0].min() == pytest.approx(0.0, abs=1e-8 * ALPHA * CHANGE * EDGE)


@pytest.mark.parametrize("seed", range(20))
def test_the_nearest_point_fulfils_its_conditions(seed: int) -> None:
    """Karush, Kuhn and Tucker: feasible, and the gradient is a sum of the active rows with factors >= 0."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 8)), int(rng.integers(0, 30))
    root = rng.normal(size=(n, n)) + 2.0 * np.eye(n)
    mass, momentum, rows, rooms = root @ root.T, rng.normal(size=n), rng.normal(size=(m, n)), rng.random(m)
    rooms[: m // 3] = 0.0
    y = _nearest(mass, 10.0 * momentum, rows, rooms)
    left, gradient = rooms + rows @ y, mass @ y + 10.0 * momentum
    assert left.min(initial=0.0) >= -1e-10
    active = rows[left < 1e-9]
    factors = np.linalg.lstsq(active.T, gradient, rcond=None)[0] if len(active) else np.zeros(0)
    assert active.T @ factors == pytest.approx(gradient, abs=1e-8)
    if len(active) <= n:
        assert factors.min(initial=0.0) >= -1e-9
