"""Reactions of supports: statics, waves in a bar, balance of momentum, supports that share nodes with interfaces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.supports import shared_out
from latin_fmu.stability.scenes import Box, Material, column

E, RHO, L, SIDE = 210e9, 7800.0, 1.0, 0.1
C, AREA = np.sqrt(E / RHO), SIDE**2


def bar(n: int = 40, **tables: Any) -> latin_fmu.Scene:
    """A bar along z that moves along its axis only, held at its foot; reactions and fields are kept."""
    steel = Material(E, RHO, name="steel")
    sides = {s: {"type": "symmetry", "face": f"bar.{s}"} for s in ("xmin", "ymin")}
    data = column(
        {"bar": Box(steel, (SIDE, SIDE, L), (1, 1, n))},
        {},
        {"end": 2.8 * L / C, "instants": 280},
        boundary={"foot": {"type": "fixed", "face": "bar.zmin"}, **sides},
        output={"reactions": True, "fields": True},
    )
    for key, table in tables.items():
        data[key] = {**data.get(key, {}), **table}
    return latin_fmu.scene_from_dict(data)


def test_a_bar_pulled_by_a_displacement() -> None:
    """E A delta / L at both ends."""
    top = {"type": "displacement", "face": "bar.zmax", "components": ["z"], "value": [1e-4]}
    top["law"] = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    scene = bar(5, boundary={"top": top}, time={"end": 1.0, "instants": 4, "quasi_static": True})
    reactions = latin_fmu.solve(scene).reactions
    expected = E * AREA * 1e-4 / L * np.linspace(0, 1, 5)
    assert reactions["top"].force[:, 2] == pytest.approx(expected, rel=1e-9, abs=1e-6)
    assert reactions["foot"].force[:, 2] == pytest.approx(-expected, rel=1e-9, abs=1e-6)
    assert abs(reactions["foot"].force[:, :2]).max() < 1e-6 * expected[-1]


MARCHES: dict[str, dict[str, Any]] = {
    "direct": {},
    "generalized_alpha": {"time": {"scheme": "generalized_alpha"}},
    "explicit": {"solver": {"propagator": "explicit"}, "time": {"instants": 600}},
    "reduced": {"solver": {"propagator": {"type": "reduced", "modes": 30}}},
}


@pytest.mark.parametrize("changes", MARCHES.values(), ids=MARCHES)
def test_a_wave_doubles_at_the_support(changes: dict[str, Any]) -> None:
    """A pressure p applied at once arrives at L / c and is 2 p at the foot until 3 L / c."""
    press = {"face": "bar.zmax", "pressure": 1e6, "law": "step"}
    scene = bar(load={"press": {**press, "law": {"type": "step"}}}, **changes)
    solution = latin_fmu.solve(scene)
    force, t = solution.reactions["foot"].force[:, 2], solution.time * C / L
    before, after = t < 0.8, (t > 1.2) & (t < 2.8)
    assert force[before].mean() == pytest.approx(0.0, abs=0.01e6 * AREA)
    assert force[after].mean() == pytest.approx(2e6 * AREA, rel=0.02)


def test_a_driven_end_needs_the_impedance() -> None:
    """rho c A v, until the wave comes back."""
    top = {"type": "velocity", "face": "bar.zmax", "components": ["z"], "value": [-0.5], "law": "step"}
    solution = latin_fmu.solve(bar(boundary={"top": top}))
    t = solution.time * C / L
    early = (t > 0.1) & (t < 1.8)
    assert solution.reactions["top"].force[early, 2].mean() == pytest.approx(-RHO * C * AREA * 0.5, rel=0.02)


@pytest.mark.parametrize("name", ["direct", "explicit", "reduced"])
def test_momentum(name: str) -> None:
    """The impulse of loads and reactions is the momentum of the body, a smooth pulse within 1 %."""
    pulse = {"face": "bar.zmax", "pressure": 1e6, "law": {"type": "half_sine", "duration": 1.2 * L / C}}
    gravity = {"bar": {"material": "steel", "box": {"size": [SIDE, SIDE, L], "elements": [1, 1, 40]}}}
    gravity["bar"]["body_force"] = [0.0, 0.0, -4e5]
    solution = latin_fmu.solve(bar(load={"press": pulse}, substructure=gravity, **MARCHES[name]))
    t, force = solution.time, solution.reactions["foot"].force[:, 2]
    applied = -1e6 * AREA * np.where(t < 1.2 * L / C, np.sin(np.pi * t / (1.2 * L / C)), 0.0) - 4e5 * AREA * L
    if name == "explicit":  # means over the steps
        steps = force[1:] + 0.5 * (applied[1:] + applied[:-1])
    else:
        steps = 0.5 * (force[1:] + applied[1:] + force[:-1] + applied[:-1])
    impulse = np.concatenate([[0.0], np.cumsum(steps * np.diff(t))])
    history = solution.substructures["bar"]
    levels, number = np.unique(history.nodes[:, 2].round(9), return_inverse=True)
    velocity = np.stack([history.velocity[:, number == i, 2].mean(axis=1) for i in range(len(levels))], axis=1)
    momentum = RHO * AREA * np.trapezoid(velocity, levels, axis=1)
    limit = 5e-4 if name == "explicit" else 0.01
    assert impulse == pytest.approx(momentum, abs=limit * np.abs(momentum).max())


def test_a_support_carries_its_own_mass() -> None:
    """A bar of two elements that a support accelerates needs mass times acceleration, on average over its vibration."""
    end, v = 40 * L / C, 2.0
    law = {"type": "table", "times": [0.0, end], "values": [0.0, 1.0]}
    foot = {"type": "velocity", "face": "bar.zmin", "components": ["z"], "value": [v], "law": law}
    solution = latin_fmu.solve(bar(2, boundary={"foot": foot}, time={"end": end, "instants": 800}))
    force = solution.reactions["foot"].force[200:, 2]
    window = np.hanning(len(force))  # no part of a period is left over
    assert force @ window / window.sum() == pytest.approx(RHO * AREA * L * v / end, rel=0.02)


def sheared(**changes: Any) -> latin_fmu.Scene:
    """A block pressed and pushed on a fixed one; a symmetry plane holds the edge of the contact face, too."""
    block = Box(Material(E, RHO, 0.3, "steel"), (0.02, 0.02, 0.01), (3, 3, 2))
    law = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    data = column(
        {"low": block, "up": block},
        {"joint": {"friction_coefficient": 0.4}},
        {"end": 1.0, "instants": 4, "quasi_static": True},
        boundary={
            "base": {"type": "fixed", "face": "low.zmin"},
            "wall": {"type": "fixed", "face": "low.xmin"},
            "plane": {"type": "symmetry", "face": "up.ymin"},
            "stop": {"type": "fixed", "face": "up.xmax", "components": ["x"]},
        },
        load={
            "press": {"face": "up.zmax", "pressure": 50e6, "law": law},
            "push": {"face": "up.zmax", "traction": [15e6, 3e6, 0.0], "law": law},
        },
        solver={"tolerance": 1e-8},
        output={"reactions": True},
    )
    return latin_fmu.scene_from_dict(data | changes)


def test_supports_that_share_nodes_with_an_interface() -> None:
    solution = latin_fmu.solve(sheared())
    r = {name: history.force for name, history in solution.reactions.items()}
    joint = solution.interfaces["joint"].force()  # on low
    area = 4e-4
    loads = np.linspace(0, 1, 5)[:, None] * np.array([15e6, 3e6, -50e6]) * area
    largest = 50e6 * area
    assert r["base"] + r["wall"] + joint == pytest.approx(np.zeros((5, 3)), abs=1e-5 * largest)
    assert r["plane"] + r["stop"] - joint + loads == pytest.approx(np.zeros((5, 3)), abs=1e-5 * largest)
    assert abs(r["plane"][-1, 1]) > 1e-3 * largest
    assert abs(r["stop"][-1, 0]) > 1e-3 * largest
    assert abs(r["plane"][:, [0, 2]]).max() == 0.0  # it holds y alone


def test_in_file_summary_and_report(tmp_path: Path) -> None:
    solution = latin_fmu.solve(sheared())
    solution.save(tmp_path / "out.nc")
    tree = latin_fmu.open_results(tmp_path / "out.nc")
    assert np.array_equal(tree["reactions/base/force"].values, solution.reactions["base"].force)
    assert tree["reactions/base/force"].attrs["units"] == "N"
    assert tree["reactions/stop"].attrs["face"] == "up.xmax"
    tree.close()
    assert "largest reaction" in solution.summary(details=True)
    assert solution.report()["reactions"]["base"]["last"] == solution.reactions["base"].force[-1].tolist()
    assert latin_fmu.solve(sheared(output={})).reactions == {}


def corner(first: str, second: str) -> dict[str, np.ndarray]:
    """Reactions of a cube held at two faces that share an edge, in one of the two orders of the scene."""
    data = column(
        {"cube": Box(Material(E, RHO, 0.3, "steel"), (0.02, 0.02, 0.02), (2, 2, 2))},
        {},
        {"end": 1.0, "instants": 2, "quasi_static": True},
        boundary={side: {"type": "fixed", "face": f"cube.{side}"} for side in (first, second)},
        load={"pull": {"face": "cube.ymax", "traction": [30e6, 0.0, 30e6], "law": {"type": "step", "start": 0.0}}},
        output={"reactions": True},
    )
    reactions = latin_fmu.solve(latin_fmu.scene_from_dict(data)).reactions
    return {name: history.force[-1] for name, history in reactions.items()}


def test_two_supports_share_their_edge_in_any_order() -> None:
    """A cube and its load are their own mirror image across the plane x = z; so are the reactions of both faces."""
    before, after = corner("zmin", "xmin"), corner("xmin", "zmin")
    largest = 30e6 * 4e-4
    for side in ("xmin", "zmin"):
        assert before[side] == pytest.approx(after[side], abs=1e-9 * largest)
    assert before["xmin"] == pytest.approx(before["zmin"][::-1], abs=1e-6 * largest)
    assert before["xmin"] + before["zmin"] == pytest.approx([-largest, 0.0, -largest], abs=1e-6 * largest)


def test_shares_of_directions_that_are_not_orthogonal() -> None:
    """Planes push along their normals; of a direction that n supports hold, each has the n-th part."""
    n, m = np.array([1.0, 0.0, 0.0]), np.array([np.cos(np.pi / 3), np.sin(np.pi / 3), 0.0])
    node = np.array([1])
    first, second = shared_out([(node, n[None]), (node, m[None])], 6)
    force = np.concatenate([np.zeros(3), 2.0 * n + 3.0 * m])
    assert first @ force == pytest.approx(2.0 * n, abs=1e-12)
    assert second @ force == pytest.approx(3.0 * m, abs=1e-12)
    everything, along = shared_out([(node, np.eye(3)), (node, n[None])], 6)
    assert along @ force == pytest.approx(0.5 * (force[3:] @ n) * n, abs=1e-12)
    assert everything @ force + along @ force == pytest.approx(force[3:], abs=1e-12)
