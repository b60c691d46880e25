"""Hertz, Cattaneo and Mindlin with a mesh of its own for each body (closed forms: ``test_static_hertz``)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu

from .curved_meshes import about_zero, outwards, write_block
from .test_static_hertz import FRICTION, RADIUS, STAR, WIDTH, check_sphere, scene, semicircle, solved

THICKNESS = WIDTH / 5


def cylinder(folder: Path, flat: int, round_: int) -> latin_fmu.Solution:
    """Plane strain, ``flat`` and ``round_`` elements in the half width, three against two along the axis; pressed, then
    sheared to about half the friction limit."""
    for name, per, along in (("flat", flat, 3), ("round", round_, 2)):
        size = WIDTH / per
        x = about_zero(size, int(1.5 * per), 20 * WIDTH, 1.25)
        y, z = np.linspace(0.0, THICKNESS, along + 1), outwards(size, 20 * WIDTH, 1.25)
        if name == "flat":
            write_block(folder / "flat.msh", x, y, -z[::-1], None)
        else:
            write_block(folder / "round.msh", x, y, z, lambda x, _: x**2 / (2 * RADIUS))
    tables = scene(8, 1.8, [(2, 0.65)])
    for name in ("flat", "round"):
        for side in ("ymin", "ymax"):
            tables["boundary"][f"{name}_{side}"] = {"type": "symmetry", "face": f"{name}.{side}"}
    return solved(tables, folder)


@pytest.mark.parametrize(
    ("flat", "round_"),
    [(10, 14), *(pytest.param(*pair, marks=pytest.mark.slow) for pair in ((14, 10), (20, 13), (13, 20), (20, 10)))],
)
def test_cylinder(flat: int, round_: int, tmp_path: Path) -> None:
    """Largest pressure and half width to 1 %; stick width at Q/(mu P) = 0.48 to 4 %."""
    solution = cylinder(tmp_path, flat, round_)
    history = solution.interfaces["touch"]
    one = history.points[:, 1] < 1e-9
    order = np.argsort(history.points[one, 0])
    x = np.abs(history.points[one, 0][order])
    shares = []
    for instant in range(4, 9):
        traction, force = history.traction[instant, one][order], history.force()[instant] / THICKNESS
        p, q = -force[2], abs(force[0])
        a = float(np.sqrt(4 * p * RADIUS / (np.pi * STAR)))
        height, width = semicircle(x, -traction[:, 2], a)
        assert height == pytest.approx(2 * p / (np.pi * a), rel=0.01)
        assert width == pytest.approx(a, rel=0.01)
        part = q / (FRICTION * p)
        if part > 0.3:
            c = a * np.sqrt(1 - part)
            _, stick = semicircle(x, FRICTION * -traction[:, 2] - np.abs(traction[:, 0]), c)
            assert stick == pytest.approx(c, rel=0.04)
            shares.append(part)
    assert min(abs(part - 0.48) for part in shares) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(("flat", "round_"), [(10, 13), (13, 10)])
def test_sphere(flat: int, round_: int, tmp_path: Path) -> None:
    """Half of a sphere on a block, cut by the plane of symmetry, by meshes that do not match."""
    for name, per in (("flat", flat), ("round", round_)):
        size = WIDTH / per
        x, z = about_zero(size, int(1.2 * per), 10 * WIDTH, 1.6), outwards(size, 10 * WIDTH, 1.6)
        y = x[len(x) // 2 :]
        if name == "flat":
            write_block(tmp_path / "flat.msh", x, y, -z[::-1], None)
        else:
            write_block(tmp_path / "round.msh", x, y, z, lambda x, y: (x**2 + y**2) / (2 * RADIUS))
    tables = scene(7, 1.2, [(1.75, 0.35)])
    tables["time"] |= {"end": 1.75, "instants": 7}
    for name in ("flat", "round"):
        tables["boundary"][f"{name}_half"] = {"type": "symmetry", "face": f"{name}.ymin"}
    shares = check_sphere(solved(tables, tmp_path).interfaces["touch"], range(4, 8), 0.015, 0.04)
    assert shares[-1] == pytest.approx(0.48, abs=0.1)
