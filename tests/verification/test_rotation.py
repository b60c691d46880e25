"""Centrifugal force of bodies that turn: closed forms of a rod and of a disk, resultants, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.errors import SceneError
from latin_fmu.stability.scenes import Box, Material, placed
from latin_fmu.stability.surfaces import write_mesh

from .test_press_fits import ring

E, RHO = 210e9, 7800.0
STATIC = {"end": 1.0, "instants": 2, "quasi_static": True}


def rod(rotation: dict[str, Any], time: Any = None, nu: float = 0.3, **tables: Any) -> Any:
    """A rod of 0.2 m along x, held by symmetry at its first end; another one apart from it."""
    box = Box(Material(E, RHO, nu, "steel"), (0.2, 0.01, 0.01), (8, 1, 1))
    data = placed({"rod": (box, (0.1, 0.0, 0.0)), "other": (box, (0.1, 0.5, 0.0))}, time or STATIC, **tables)
    data["boundary"] = {
        f"{body}_{side}": {"type": "symmetry", "face": f"{body}.{side}min"}
        for body in ("rod", "other")
        for side in "xyz"
    } | tables.get("boundary", {})
    return latin_fmu.scene_from_dict(data | {"rotation": {"spin": rotation}, "output": {"fields": True}})


def test_a_rod_stretches_by_its_own_pull() -> None:
    """Without Poisson's ratio u' = rho omega^2 (b^2 - s^2) / (2 E) at the distance s from the axis, b that of the end;
    nodes of linear elements have the exact value, and only the body that is named turns."""
    omega, at = 300.0, 0.02
    spin = {"angular_velocity": omega, "axis": [0.0, 0.0, 2.0], "point": [at, 0.0, 7.0], "substructures": ["rod"]}
    solution = latin_fmu.solve(rod(spin, nu=0.0))
    x = np.linspace(0.0, 0.2, 9) + 0.1 - at
    far, near = x[-1], x[0]
    exact = RHO * omega**2 / (2.0 * E) * (far**2 * (x - near) - (x**3 - near**3) / 3.0)
    moved = solution.substructures["rod"].displacement
    assert np.abs(solution.substructures["other"].displacement).max() == 0.0
    # halfway the law of a static run without one is there in full
    for instant in (1, 2):
        np.testing.assert_allclose(moved[instant].reshape(-1, 9, 3)[0, :, 0], exact, rtol=1e-9, atol=1e-18)
        # and nothing along the axis, however far the point on it is
        assert np.abs(moved[instant][:, 2]).max() < 1e-12 * exact.max()


@pytest.mark.parametrize(("kind", "tolerance"), [("hexahedron20", 2e-3), ("tetra10", 1e-2)])
def test_a_disk_grows_as_that_of_timoshenko(kind: str, tolerance: float, tmp_path: Path) -> None:
    """Radial displacement of an annular disk in plane stress (Timoshenko, Theory of Elasticity, art. 32)."""
    a, b, nu, omega = 0.02, 0.1, 0.3, 800.0
    write_mesh(tmp_path / "disk.msh", ring(kind, (a, b), (6, 6, 1), 0.004), lambda x: x)
    scene = latin_fmu.scene_from_dict(
        {
            "name": "disk",
            "material": {"steel": {"young_modulus": E, "poisson_ratio": nu, "density": RHO}},
            "substructure": {
                "disk": {"material": "steel", "mesh": {"file": str(tmp_path / "disk.msh"), "group": "body"}}
            },
            "boundary": {f: {"type": "symmetry", "face": f"disk.{f}"} for f in ("first", "last", "foot")},
            "rotation": {"spin": {"angular_velocity": omega, "axis": [0.0, 0.0, 1.0]}},
            "sensor": {n: {"substructure": "disk", "point": [r, 0.0, 0.0]} for n, r in (("bore", a), ("rim", b))},
            "time": STATIC,
        }
    )
    solution = latin_fmu.solve(scene)
    for name, r in (("bore", a), ("rim", b)):
        rest = a**2 + b**2 + (1 + nu) / (1 - nu) * (a * b / r) ** 2 - (1 + nu) / (3 + nu) * r**2
        exact = (3 + nu) * (1 - nu) / 8 * RHO * omega**2 / E * r * rest
        assert solution.sensors[name].displacement[-1, 0] == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize(
    ("keys", "rigid"),
    [
        ({"scheme": "hht"}, False),
        ({"scheme": "hht"}, True),
        ({"scheme": "massless_contact"}, False),
        ({"propagator": "explicit"}, False),
    ],
    ids=str,
)
def test_a_free_body_is_pushed_off_by_its_mass_times_its_distance(keys: dict[str, Any], rigid: bool) -> None:
    """Momentum after a time t under a ramp: m omega^2 r t / 2, of a body with a point mass."""
    box = Box(Material(E, RHO, 0.3, "steel"), (0.02, 0.02, 0.02), (2, 2, 2), keys={"rigid": rigid})
    end = 2e-5
    law = {"type": "table", "times": [0.0, end], "values": [0.0, 1.0]}
    data = placed(
        {"b": (box, (0.1, -0.01, -0.01))},
        {"end": end, "instants": 100} | ({"scheme": keys["scheme"]} if "scheme" in keys else {}),
        rotation={"spin": {"angular_velocity": 200.0, "axis": [0.0, 1.0, 0.0], "law": law}},
        point_mass={"lump": {"face": "b.xmax", "mass": 0.05}},
        sensor={"face": {"face": "b.xmin"}},
        output={"fields": True, "energy": True},
    )
    if "propagator" in keys:
        data["solver"] = {"propagator": "explicit"}
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(data))
    body, mass = RHO * 0.02**3, 0.05
    mean = (body * 0.11 + mass * 0.12) / (body + mass)
    speed = solution.sensors["face"].velocity[-1]
    if rigid:
        assert speed[0] == pytest.approx(200.0**2 * mean * end / 2.0, rel=2e-5)
    field = solution.substructures["b"].velocity[-1]
    # all points move out, the mean as fast as the mass centre but for the vibration
    assert field[:, 0].mean() == pytest.approx(200.0**2 * mean * end / 2.0, rel=0.05)
    assert np.abs(field[:, 1].mean()) < 1e-3 * speed[0]


@pytest.mark.parametrize(
    ("spin", "words"),
    [
        ({"angular_velocity": 0.0, "axis": [0, 0, 1]}, "angular_velocity"),
        ({"angular_velocity": 1.0, "axis": [0, 0, 0]}, "axis"),
        ({"angular_velocity": 1.0, "axis": [0, 0, 1], "substructures": ["rot"]}, "rotation.spin.substructures"),
        ({"angular_velocity": 1.0, "axis": [0, 0, 1], "substructures": "rod"}, "list of names"),
    ],
)
def test_bad_rotations_are_refused(spin: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        rod(spin)


def test_a_rotation_grows_with_the_square_of_its_speed() -> None:
    """And is added to by another one, as the law says."""
    half = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    slow = latin_fmu.solve(rod({"angular_velocity": 100.0, "axis": [0, 0, 1]}))
    fast = latin_fmu.solve(rod({"angular_velocity": 200.0, "axis": [0, 0, 1], "law": half}))
    a, b = (s.substructures["rod"].displacement for s in (slow, fast))
    np.testing.assert_allclose(b[2], 4.0 * a[2], rtol=1e-9, atol=1e-9 * np.abs(b).max())
    np.testing.assert_allclose(b[1], 2.0 * a[1], rtol=1e-9, atol=1e-9 * np.abs(b).max())
