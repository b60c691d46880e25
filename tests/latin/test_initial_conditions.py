"""The instant t = 0: tractions of perfect, open, preloaded and grounded interfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.latin.initial_conditions import initial_conditions
from latin_fmu.march import march
from tests.scenes import given_motion

LOADS: dict[str, dict[str, Any]] = {
    "end_load": {"load": {"pull": {"face": "a.zmin", "traction": [0.3, -0.1, 0.8]}}},
    "gravity": {"gravity": [0.1, 0.0, -2.0]},
    "damped_motion": {"damping": True, "speeds": True},
    "driven_end": {"drive": True, "gravity": [0.0, 0.3, 1.0]},
}


def cut(bars_scene: Any, bar_box: Any, case: str, pieces: int) -> dict[str, Any]:
    """A held bar of length 3 in one piece or three joined ones, under the initial conditions ``case``."""
    what = LOADS[case]
    names = "abc"[:pieces]
    tables: dict[str, Any] = bars_scene("perfect")
    material = tables["material"]["m"] | {"poisson_ratio": 0.3}
    if what.get("damping"):
        material |= {"frame": "absolute", "rayleigh_mass": 0.7, "rayleigh_stiffness": 0.2}
    tables["material"] = {"m": material}
    length, n = 3.0 / pieces, 12 // pieces
    tables["substructure"] = {
        name: {"material": "m", "box": bar_box(i * length, length, n, 2)} for i, name in enumerate(names)
    }
    for body in tables["substructure"].values():
        if "gravity" in what:
            body["body_force"] = what["gravity"]
        if what.get("speeds"):
            body["initial_velocity"] = [0.2, 0.0, -0.4]
    if pieces == 1:
        tables["interface"] = {}
    last = names[-1]
    tables["boundary"] = {"held": {"type": "fixed", "face": f"{last}.zmax"}}
    if what.get("drive"):
        law = {"type": "table", "times": [0.0, 1.0, 3.0], "values": [0.0, 1.0, 0.0]}
        tables["boundary"]["driven"] = given_motion("a.zmin", [0.5], law, "z")
    tables["load"] = what.get("load", {})
    tables["solver"] = {"tolerance": 1e-11, "force_tolerance": 1e-9}
    return tables


def by_place(built: Any, field: str) -> dict[tuple[float, ...], np.ndarray]:
    """Nodal values at t = 0 by node coordinates; the pieces must agree where they meet."""
    values: dict[tuple[float, ...], np.ndarray] = {}
    for p in built.assembly.propagators:
        for j, name in enumerate(p.names):
            imposed = getattr(p.forcing, f"imposed_{field}")(p.instant)[:, j]
            full = (p.members[j].expansion @ getattr(p.state, field)[:, j] + imposed).reshape(-1, 3)
            for x, value in zip(built.info[name].nodes, full, strict=True):
                key = tuple(np.round(x, 9) + 0.0)
                if key in values:
                    np.testing.assert_allclose(value, values[key], atol=1e-10)
                values[key] = value
    return values


@pytest.mark.parametrize("case", LOADS)
def test_a_cut_bar_starts_like_the_merged_one(bars_scene: Any, bar_box: Any, made: Any, case: str) -> None:
    """Accelerations of all nodes at t = 0, and the motion that follows."""
    whole, pieces = (made(cut(bars_scene, bar_box, case, n)) for n in (1, 3))
    for built in (whole, pieces):
        initial_conditions(built.assembly)
    one, three = by_place(whole, "a"), by_place(pieces, "a")
    assert one.keys() == three.keys()
    scale = max(float(np.abs(a).max()) for a in one.values())
    assert scale > 0.1
    for key, a in one.items():
        np.testing.assert_allclose(three[key], a, atol=1e-9 * scale)
    end = [march(made(cut(bars_scene, bar_box, case, n))).outcome for n in (1, 3)]
    assert end[1].converged
    lowest = end[1].substructures["c"].displacement
    nodes = end[1].substructures["c"].nodes
    same = [int(np.argmin(np.linalg.norm(end[0].substructures["a"].nodes - x, axis=1))) for x in nodes]
    merged = end[0].substructures["a"].displacement[:, same]
    np.testing.assert_allclose(lowest, merged, atol=1e-7 * np.abs(merged).max())


def test_tractions_are_opposite_and_zero_where_contact_is_open(blocks_scene: Any, made: Any) -> None:
    tables = blocks_scene()
    for body in tables["substructure"].values():
        body["body_force"] = [0.0, 0.0, -1.0]
    built = made(tables)
    traction, velocity = initial_conditions(built.assembly)
    assert not traction.any()  # contact at t = 0 is left to the first instant
    high = built.assembly.layout.channels(1, 1)
    np.testing.assert_allclose(velocity[high], np.tile([-0.1, 0.05, 0.02], (9, 1)), atol=1e-15)


def test_preload_is_there_and_nothing_moves(blocks_scene: Any, made: Any) -> None:
    tables = blocks_scene()
    tables["substructure"]["high"].pop("initial_velocity")
    tables["interface"]["rub"]["preload"] = 3.0
    built = made(tables)
    traction, _ = initial_conditions(built.assembly)
    for side, sign in ((0, -1.0), (1, 1.0)):
        channels = built.assembly.layout.channels(1, side)
        np.testing.assert_array_equal(traction[channels[:, 0]], sign * 3.0)
        assert not traction[channels[:, 1:]].any()
    for p in built.assembly.propagators:
        assert not p.state.a.any()


def test_body_bonded_to_moving_ground_takes_its_acceleration(bars_scene: Any, made: Any) -> None:
    tables = bars_scene("perfect")
    tables["boundary"], tables["load"] = {}, {}
    law = {"type": "table", "times": [0.0, 1.0, 3.0], "values": [0.0, 1.0, 1.0]}
    tables["interface"]["shaken"] = {
        "sides": ["c.zmax", "ground"],
        "behaviour": "perfect",
        "ground_velocity": {"direction": [0.0, 3.0, 4.0], "amplitude": 0.5, "law": law},
    }
    built = made(tables)
    initial_conditions(built.assembly)
    a = by_place(built, "a")
    for key, value in a.items():
        if key[2] == 3.0:
            np.testing.assert_allclose(value, [0.0, 0.3, 0.4], atol=1e-11)
