"""Curved contacts pressed and sheared: Hertz, and the partial slip of Cattaneo and Mindlin, in closed form.

Two bodies of one material meet on a half width (cylinder) or radius (sphere) a under P, with the pressure
p0 sqrt(1 - (r/a)^2). Sheared by Q < mu P they stick for r < c and slip outside (Johnson, Contact Mechanics, 7.2):

    cylinder  a^2 = 4 P R / (pi E*)     p0 = 2 P / (pi a)         c = a (1 - Q / (mu P))^(1/2)
    sphere    a^3 = 3 P R / (4 E*)      p0 = 3 P / (2 pi a^2)     c = a (1 - Q / (mu P))^(1/3)
    traction  q = mu p0 [sqrt(1 - (r/a)^2) - (c/a) sqrt(1 - (r/c)^2)],   the second term for r < c only
    taken back from Q1 to Q:  slip of the other sign outside c' = a (1 - (Q1 - Q) / (2 mu P))^(1/2)    (cylinder)
    sphere    shift (3 mu P (2 - nu) / (8 G a)) [1 - (1 - Q / (mu P))^(2/3)]

with E* = E / (2 (1 - nu^2)). P and Q are those of the interface: faces far away are displaced.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from tests.scenes import given_motion, ramp

from .curved_meshes import about_zero, outwards, write_block

E, NU, RADIUS, FRICTION, WIDTH = 210e9, 0.3, 0.1, 0.5, 1e-3  # WIDTH: half of the contact aimed at
STAR, G = E / (2 * (1 - NU**2)), E / (2 * (1 + NU))
DEPTH = WIDTH**2 / RADIUS  # unit of approach and shift


def scene(steps: int, down: float, along: list[tuple[float, float]]) -> dict[str, Any]:
    """The curved block brought down by ``down`` DEPTH in the first interval, then moved along x (time, DEPTH)."""
    return {
        "name": "curved",
        "material": {"steel": {"young_modulus": E, "poisson_ratio": NU, "density": 7800.0}},
        "substructure": {
            name: {"material": "steel", "mesh": {"file": f"{name}.msh", "group": "body"}} for name in ("flat", "round")
        },
        "interface": {"touch": {"sides": ["flat.surface", "round.surface"], "friction_coefficient": FRICTION}},
        "boundary": {
            "foot": {"type": "fixed", "face": "flat.back"},
            "down": given_motion("round.back", [-down * DEPTH], ramp((0, 0), (1, 1)), "z", kind="displacement"),
            "along": given_motion("round.back", [DEPTH], ramp((0, 0), (1, 0), *along), kind="displacement"),
        },
        "time": {"end": along[-1][0], "instants": steps, "quasi_static": True},
        "solver": {"tolerance": 1e-4, "max_iterations": 400},
    }


def solved(tables: dict[str, Any], folder: Path) -> latin_fmu.Solution:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(tables, folder))
    assert solution.converged, solution.status
    return solution


def semicircle(r: np.ndarray, values: np.ndarray, radius: float) -> tuple[float, float]:
    """Height and radius of sqrt(1 - (r/radius)^2) fitted to values within 0.8 of the radius expected."""
    inside = r < 0.8 * radius
    table = np.stack([np.ones(inside.sum()), r[inside] ** 2], axis=1)
    constant, slope = np.linalg.lstsq(table, values[inside] ** 2, rcond=None)[0]
    return float(np.sqrt(constant)), float(np.sqrt(-constant / slope))


def dome(r: np.ndarray, radius: float) -> np.ndarray:
    return np.sqrt(np.clip(1 - (r / radius) ** 2, 0, None))


# -- cylinder on a plane ------------------------------------------------------------------------------------------
PER_WIDTH = 20  # elements in WIDTH
SIZE = WIDTH / PER_WIDTH


@pytest.fixture(scope="module")
def cylinder(tmp_path_factory: pytest.TempPathFactory) -> latin_fmu.Solution:
    """Plane strain, sheared to 0.92 of the friction limit and half-way back; far faces 20 half widths away."""
    folder = tmp_path_factory.mktemp("cylinder")
    x = about_zero(SIZE, 30, 20 * WIDTH, 1.25)
    y, z = np.array([0.0, 4 * SIZE]), outwards(SIZE, 20 * WIDTH, 1.25)
    write_block(folder / "flat.msh", x, y, -z[::-1], None)
    write_block(folder / "round.msh", x, y, z, lambda x, _: x**2 / (2 * RADIUS))
    tables = scene(10, 1.8, [(2, 1.3), (2.5, 0.1)])
    for name in ("flat", "round"):
        for side in ("ymin", "ymax"):
            tables["boundary"][f"{name} {side}".replace(" ", "_")] = {"type": "symmetry", "face": f"{name}.{side}"}
    return solved(tables, folder)


def line(solution: latin_fmu.Solution, instant: int) -> dict[str, Any]:
    """Pressure, shear traction and status along the contact of the cylinder, forces per length, exact widths."""
    history = solution.interfaces["touch"]
    one = history.points[:, 1] == 0.0
    order = np.argsort(history.points[one, 0])
    traction, status = history.traction[instant, one][order], history.contact_status[instant, one][order]
    force = history.force()[instant] / (4 * SIZE)
    p, q = -force[2], abs(force[0])
    a = float(np.sqrt(4 * p * RADIUS / (np.pi * STAR)))
    return {
        "x": history.points[one, 0][order],
        "pressure": -traction[:, 2],
        "shear": traction[:, 0],
        "status": status,
        "P": p,
        "Q": q,
        "signed": force[0],
        "a": a,
        "p0": 2 * p / (np.pi * a),
        "c": a * np.sqrt(1 - min(q / (FRICTION * p), 1.0)),
    }


def test_cylinder_hertz(cylinder: latin_fmu.Solution) -> None:
    """Half width to an element, largest pressure to 0.5 %, pressure anywhere to 2 % of it."""
    at = line(cylinder, 4)
    assert at["a"] == pytest.approx(WIDTH, rel=0.03)
    edge = np.abs(at["x"][at["pressure"] > 0]).max()
    assert edge <= at["a"] + 1e-9 <= edge + SIZE
    height, width = semicircle(np.abs(at["x"]), at["pressure"], at["a"])
    assert height == pytest.approx(at["p0"], rel=0.005)
    assert width == pytest.approx(at["a"], rel=0.01)
    assert np.abs(at["pressure"] - at["p0"] * dome(at["x"], at["a"])).max() < 0.02 * at["p0"]


@pytest.mark.parametrize("instant", [5, 6, 7, 8])
def test_cylinder_cattaneo_mindlin(cylinder: latin_fmu.Solution, instant: int) -> None:
    """Stick half width to an element, and to 2 % by the traction in it; the traction to 5 % of mu p0 anywhere."""
    at = line(cylinder, instant)
    assert 0.2 < at["Q"] / (FRICTION * at["P"]) < 0.95
    stuck = np.abs(at["x"][at["status"] == 1]).max()
    assert stuck <= at["c"] <= stuck + SIZE
    limit = FRICTION * at["p0"]
    exact = limit * (dome(at["x"], at["a"]) - at["c"] / at["a"] * dome(at["x"], at["c"]))
    assert np.abs(np.abs(at["shear"]) - exact).max() < 0.05 * limit
    height, width = semicircle(np.abs(at["x"]), FRICTION * at["pressure"] - np.abs(at["shear"]), at["c"])
    assert width == pytest.approx(at["c"], rel=0.02)
    assert height == pytest.approx(limit * at["c"] / at["a"], rel=0.02)


def test_cylinder_on_the_way_back(cylinder: latin_fmu.Solution) -> None:
    """Slip turns at the edge: outside c' the traction is that of the other sign."""
    peak, at = line(cylinder, 8), line(cylinder, 10)
    back = (peak["signed"] - at["signed"]) / np.sign(peak["signed"])
    assert 0.5 < back / (FRICTION * at["P"]) < 1.5
    turned = at["a"] * np.sqrt(1 - back / (2 * FRICTION * at["P"]))
    slipping = np.abs(at["x"][at["status"] == 2])
    assert slipping.min() - SIZE <= turned <= slipping.min()
    assert np.sign(at["shear"][at["status"] == 2]) == pytest.approx(-np.sign(peak["signed"]))


# -- sphere on a plane --------------------------------------------------------------------------------------------
PER_RADIUS = 5


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> latin_fmu.Solution:
    """Half of it, a plane of symmetry along the shear; far faces 10 radii away."""
    folder = tmp_path_factory.mktemp("sphere")
    size = WIDTH / PER_RADIUS
    x, z = about_zero(size, 8, 10 * WIDTH, 1.5), outwards(size, 10 * WIDTH, 1.4)
    y = x[len(x) // 2 :]
    write_block(folder / "flat.msh", x, y, -z[::-1], None)
    write_block(folder / "round.msh", x, y, z, lambda x, y: (x**2 + y**2) / (2 * RADIUS))
    tables = scene(9, 1.2, [(2.75, 0.7)])
    tables["time"] |= {"end": 2.25, "instants": 9}
    for name in ("flat", "round"):
        tables["boundary"][f"{name}_half"] = {"type": "symmetry", "face": f"{name}.ymin"}
    return solved(tables, folder)


def check_sphere(history: Any, instants: range, limit: float, stick_limit: float) -> list[float]:
    """Radius a and largest pressure to ``limit``, stick radius to ``stick_limit`` of a; Q / (mu P) of every instant."""
    r, shares = np.hypot(history.points[:, 0], history.points[:, 1]), []
    for instant in instants:
        force = 2 * history.force()[instant]
        p, part = -force[2], abs(force[0]) / (FRICTION * -force[2])
        a = (3 * p * RADIUS / (4 * STAR)) ** (1 / 3)
        pressure = -history.traction[instant, :, 2]
        height, radius = semicircle(r, pressure, a)
        assert radius == pytest.approx(a, rel=limit)
        assert height == pytest.approx(3 * p / (2 * np.pi * a**2), rel=limit)
        if 0.1 < part < 0.9:
            c = a * (1 - part) ** (1 / 3)
            _, stick = semicircle(r, FRICTION * pressure - np.abs(history.traction[instant, :, 0]), c)
            assert stick == pytest.approx(c, abs=stick_limit * a)
        shares.append(part)
    return shares


def test_sphere_hertz_and_mindlin(sphere: latin_fmu.Solution) -> None:
    assert check_sphere(sphere.interfaces["touch"], range(4, 10), 0.01, 0.02)[-1] > 0.7


def test_sphere_shift(sphere: latin_fmu.Solution) -> None:
    """The part of the shift that is not linear in Q is that of the contact (the linear one holds the blocks too)."""
    history = sphere.interfaces["touch"]
    force = 2 * history.force()[4:]
    p = -force[-1, 2]
    part = np.abs(force[:, 0]) / (FRICTION * p)
    a = (3 * p * RADIUS / (4 * STAR)) ** (1 / 3)
    contact = 3 * FRICTION * p * (2 - NU) / (8 * G * a) * (1 - (1 - part) ** (2 / 3))
    moved = DEPTH * 0.7 * (sphere.time[4:] - 1) / 1.75
    (scale, _), *_ = np.linalg.lstsq(np.stack([contact, part], axis=1), moved, rcond=None)
    assert scale == pytest.approx(1.0, abs=0.03)
