"""Search directions: values checked by hand on bars of one element, choices, and their absence from the result."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu.latin.search_direction import channel_k, unresolved_sides
from latin_fmu.latin.settings import SearchDirection
from latin_fmu.march import march
from latin_fmu.stability.scenes import Box, Material, column

# Two bars of one element; periodic sides tie the four nodes of a face, so that each bar is a two-node rod.
AREA, LENGTH, DT = 0.25, 0.8, 0.1
YOUNG = {"soft": 3.0, "stiff": 300.0}
DENSITY = {"soft": 2.0, "stiff": 5.0}


def rods(friction: float = 0.0, dt: float = DT, scheme: str = "hht") -> dict[str, Any]:
    bodies = {n: Box(Material(YOUNG[n], DENSITY[n], name=n), (0.5, 0.5, LENGTH), (1, 1, 1)) for n in ("soft", "stiff")}
    tied = {f"{n}_{a}": {"type": "periodic", "faces": [f"{n}.{a}min", f"{n}.{a}max"]} for n in bodies for a in "xy"}
    return column(
        bodies,
        {"meet": {"friction_coefficient": friction}},
        {"end": 10 * dt, "instants": 10, "scheme": scheme},
        boundary=tied | {"held": {"type": "fixed", "face": "soft.zmin"}},
        load={"push": {"face": "stiff.zmax", "pressure": 1.0}},
    )


def admittance(name: str, dt: float, modulus: float) -> float:
    """Velocity of the contact end of a rod per newton, one HHT -0.1 instant: gain (M + c K)^-1, 2 x 2 by hand."""
    alpha = -0.1
    gamma, beta = 0.5 - alpha, (1 - alpha) ** 2 / 4
    m = DENSITY[name] * AREA * LENGTH / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    k = modulus * AREA / LENGTH * np.array([[1.0, -1.0], [-1.0, 1.0]])
    a = m + (1 + alpha) * beta * dt**2 * k
    free = a[1, 1] if name == "soft" else a[1, 1] - a[0, 1] ** 2 / a[0, 0]  # soft: the other end is held
    return float((1 + alpha) * gamma * dt / free)


def k_of(assembly: Any, wanted: SearchDirection, window: int = 1) -> tuple[list[np.ndarray], str]:
    """k of both sides (n_point, n_component), and the choice."""
    k, choice = channel_k(assembly, wanted, window)
    return [k[assembly.layout.channels(0, side)] for side in (0, 1)], choice


@pytest.mark.parametrize("factor", [1.0, 2.5])
def test_row_and_diagonal_by_hand(made: Any, factor: float) -> None:
    """row: resistance over area, 1 / (d A). diagonal: a traction on one point of area A/4 moves them all."""
    assembly = made(rods()).assembly
    row, _ = k_of(assembly, SearchDirection("row", factor))
    diagonal, _ = k_of(assembly, SearchDirection("diagonal", factor))
    for side, name in enumerate(("soft", "stiff")):
        d = admittance(name, DT, YOUNG[name])
        np.testing.assert_allclose(row[side], factor / (d * AREA), rtol=1e-11)
        np.testing.assert_allclose(diagonal[side], factor / (d * AREA / 4), rtol=1e-11)


def test_row_and_diagonal_of_the_tangents(made: Any) -> None:
    """nu = 0: the shear rod has G = E / 2; one value for both tangents."""
    assembly = made(rods(friction=0.3)).assembly
    row, _ = k_of(assembly, SearchDirection("row"))
    for side, name in enumerate(("soft", "stiff")):
        np.testing.assert_allclose(row[side][:, 0], 1 / (admittance(name, DT, YOUNG[name]) * AREA), rtol=1e-11)
        d = admittance(name, DT, YOUNG[name] / 2)
        np.testing.assert_allclose(row[side][:, 1:], 1 / (d * AREA), rtol=1e-11)


def test_impedance_and_uniform(made: Any) -> None:
    assembly = made(rods(friction=0.3)).assembly
    impedance, choice = k_of(assembly, SearchDirection("impedance", 0.5))
    assert choice == "impedance"
    for side, name in enumerate(("soft", "stiff")):
        z = np.sqrt(YOUNG[name] * DENSITY[name])
        np.testing.assert_allclose(impedance[side], np.tile(0.5 * z * np.sqrt([1.0, 0.5, 0.5]), (4, 1)), rtol=1e-13)
    uniform, _ = k_of(assembly, SearchDirection("uniform", 2.0, normal=3.0, tangential=5.0))
    for side in (0, 1):
        np.testing.assert_array_equal(uniform[side], np.tile([6.0, 10.0, 10.0], (4, 1)))


def test_one_tangential_value_per_point_and_positive(blocks_scene: Any, made: Any) -> None:
    assembly = made(blocks_scene()).assembly
    for kind in ("automatic", "impedance", "diagonal", "row"):
        for window in (1, 10):
            k, _ = channel_k(assembly, SearchDirection(kind), window)
            for i in (0, 1):
                ground = i == 0
                for side in (0, 1):
                    block = k[assembly.layout.channels(i, side)]
                    np.testing.assert_array_equal(block[:, 1], block[:, 2])
                    assert (block == 0).all() if ground and side == 1 else (block > 0).all()


def test_held_points_are_rigid(made: Any) -> None:
    """A side that cannot move at all has k = 0, like the ground, for every kind."""
    tables = rods()
    tables["interface"]["foot"] = {"sides": ["soft.zmin", "ground"]}
    assembly = made(tables).assembly
    for kind in ("impedance", "diagonal", "row"):
        k, _ = channel_k(assembly, SearchDirection(kind), 1)
        assert not k[assembly.layout.channels(1, 0)].any()
        assert not k[assembly.layout.channels(1, 1)].any()
        assert (k[assembly.layout.channels(0, 0)] > 0).all()


def test_automatic_choice(bars_scene: Any, made: Any) -> None:
    """Diagonal for windows of one instant; else the impedance where the step resolves the wave, or half the row."""
    tables = bars_scene()
    tables["time"]["scheme"] = "hht"
    fine = made(tables).assembly
    assert k_of(fine, SearchDirection(), 1)[1] == "diagonal"
    sides, choice = k_of(fine, SearchDirection(), 10)
    assert choice == "impedance"
    np.testing.assert_allclose(sides[0][:, 0], 2.0)  # rho c
    assert unresolved_sides(fine) == []
    coarse = made(tables | {"time": {"end": 240.0, "instants": 48, "scheme": "hht"}}).assembly
    sides, choice = k_of(coarse, SearchDirection(), 10)
    assert choice == "half row"
    np.testing.assert_allclose(sides[0], 0.5 * k_of(coarse, SearchDirection("row"))[0][0], rtol=1e-12)
    remarks = unresolved_sides(coarse)
    assert len(remarks) == 4
    assert "interface meet" in remarks[-1]
    assert "c.zmin" in remarks[-1]


DIRECTIONS: tuple[Any, ...] = (
    "automatic",
    {"type": "impedance", "factor": 0.4},
    {"type": "impedance", "factor": 3.0},
    {"type": "diagonal", "factor": 2.0},
    "row",
    {"type": "uniform", "normal": 1.0, "tangential": 2.5},
)


def test_k_never_changes_the_answer(blocks_scene: Any, made: Any) -> None:
    results = []
    for direction in DIRECTIONS:
        solver = {"tolerance": 1e-10, "force_tolerance": 1e-9, "search_direction": direction}
        outcome = march(made(blocks_scene(solver=solver))).outcome
        assert outcome.converged, f"{direction}: {outcome.status}"
        results.append(outcome)
    for name in ("floor", "rub"):
        exact = results[0].interfaces[name]
        scale = np.abs(exact.traction).max()
        assert scale > 0
        for other in results[1:]:
            np.testing.assert_allclose(other.interfaces[name].traction, exact.traction, atol=2e-7 * scale)
            np.testing.assert_array_equal(other.interfaces[name].contact_status, exact.contact_status)
