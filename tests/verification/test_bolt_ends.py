"""What holds the ends of a bolt: ten screws that nothing holds, ten that something does; needs gmsh."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from latin_fmu import scene_from_dict
from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.building import discretise
from latin_fmu.errors import SceneError

from .screw_meshes import Part, Profile, write

R, HEAD = 2.5, 4.25  # radii of shank and head, mm
FLAT: Profile = ((0, -8), (R, -8), (R, 6), (HEAD, 6), (HEAD, 10), (0, 10))
CONE: Profile = ((0, -8), (R, -8), (R, 3), (5.5, 6), (0, 6))
UPSIDE_DOWN: Profile = ((0, -8), (R, -8), (R, 3), (5.0, 3), (R, 5.5), (R, 6), (0, 6))
PLAIN: Profile = ((0, -1), (2.75, -1), (2.75, 7), (0, 7))
COUNTERSUNK: Profile = ((0, -1), (2.75, -1), (2.75, 3.25), (5.5, 6), (5.5, 7), (0, 7))
FUNNEL: Profile = ((0, -1), (6.0, -1), (6.0, 2.0), (5.0, 3), (R, 5.5), (R, 7), (0, 7))
THROUGH: Profile = ((0, -13), (2.75, -13), (2.75, 7), (0, 7))
LONG: Profile = ((0, -14), (R, -14), (R, 6), (HEAD, 6), (HEAD, 10), (0, 10))
SHOULDER: Profile = ((0, -16), (HEAD, -16), (HEAD, -12), (R, -12), (R, 6), (HEAD, 6), (HEAD, 10), (0, 10))


def _at(height: float) -> Any:
    return lambda _, z, extent: extent < 1e-3 and abs(z - height) < 1e-3


def _round(radius: float, _: float, extent: float) -> bool:
    return abs(radius - R) < 1e-3 and extent > 5.0


def _hole(radius: float, bottom: float = -8.0) -> Profile:
    return ((0, bottom), (radius, bottom), (radius, 1), (0, 1))


def parts(
    screw: Profile = FLAT, hole: Profile | None = None, plate: Profile | None = None, **more: Part
) -> dict[str, Part]:
    """A screw through a plate of 6 mm in a block of 12 mm; the thread is the lower part of its shank."""
    wall = {"hole": _round} if hole is None else {}
    tip = {"tip": _at(screw[0][1])}
    tip |= {"shank": _round}
    return {
        "screw": Part(screw, faces=tip),
        "base": Part(
            _hole(R) if hole is None else hole, ((-10, -10, -12), (20, 20, 12)), {"bottom": _at(-12.0)} | wall
        ),
        "plate": Part(PLAIN if plate is None else plate, ((-10, -10, 0), (20, 20, 6))),
        **more,
    }


def scene(file: Path, **other: Any) -> dict[str, Any]:
    """The parts with contacts by a search, the screw tightened."""
    law = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
    made: dict[str, Any] = {
        "name": "ends",
        "material": {"steel": law},
        "mesh": {"cad": {"file": str(file), "scale": 1e-3, "parts": "*", "material": "steel"}},
        "contact": {"all": {"search": 0.05e-3, "friction_coefficient": 0.2}},
        "boundary": {"floor": {"type": "fixed", "face": "base.bottom"}},
        "bolt": {"m5": {"substructure": "screw", "axis": [0.0, 0.0, 1.0], "force": 5.5e3}},
        "time": {"quasi_static": True, "end": 1.0, "instants": 1},
    }
    return made | other


THREAD = {"sides": ["screw.shank", "base.hole"], "search": 0.05e-3}
NUT = Part(((R, -15), (HEAD, -15), (HEAD, -12), (R, -12)))
LAYER = {"behaviour": "elastic_layer", "normal_stiffness": 1e14, "tangential_stiffness": 1e13}
DASHPOT = {"behaviour": "viscous_joint", "normal_viscosity": 1e6, "tangential_viscosity": 1e6}
SPRING = {"ends": [{"face": "screw.tip"}, {"face": "base.bottom"}], "direction": [0.0, 0.0, 1.0], "stiffness": 1e8}
BOND = {"thread": {**THREAD, "behaviour": "perfect"}}
FIXED = {"tip": {"type": "fixed", "face": "screw.tip"}, "floor": {"type": "fixed", "face": "base.bottom"}}
FITTING = ((0, -8), (2.8, -8), (2.8, -2), (R, -2), (R, 6), (HEAD, 6), (HEAD, 10), (0, 10))

Case = tuple[Mapping[str, Part], dict[str, Any], dict[str, Any], str]
NOT_HELD: dict[str, Case] = {
    "curved": (parts(), {}, {}, "the end of screw at [0, 0, -0.008]"),
    "straight": (parts(), {"order": 1}, {"gap": "closed"}, "the end of screw"),
    "coarse": (parts(), {"size": 12.0, "curvature": 5}, {"gap": "closed"}, "the end of screw"),
    "clearance": (parts(hole=_hole(2.75, -10)), {}, {}, "no interface is there"),
    "nut missing": (parts(LONG, _hole(2.75, -13), THROUGH), {}, {}, "the end of screw at [0, 0, -0.014]"),
    "countersunk upside down": (
        parts(UPSIDE_DOWN, plate=FUNNEL),
        {},
        {"interface": BOND, "gap": "closed"},
        "the head of screw at [0, 0, 0.006]",
    ),
    "smooth pin": (parts(), {}, {"friction_coefficient": 0.0}, "the end of screw"),
    "dashpot": (parts(), {}, {"interface": {"thread": {**THREAD, **DASHPOT}}}, "the end of screw"),
    "spring across": (parts(), {}, {"spring": {"s": {**SPRING, "direction": [1.0, 0.0, 0.0]}}}, "spring.s"),
    "layer without shear": (
        parts(),
        {},
        {"interface": {"thread": {**THREAD, **LAYER, "tangential_stiffness": 0.0}}},
        "interface.thread",
    ),
}
HELD: dict[str, Case] = {
    "bond": (parts(), {}, {"interface": BOND}, ""),
    "countersunk": (parts(CONE, _hole(2.75, -9), COUNTERSUNK), {}, {"boundary": FIXED, "gap": "closed"}, ""),
    "press fit": (
        parts(),
        {},
        {"interface": {"thread": {**THREAD, "friction_coefficient": 0.2, "interference": 1e-5}}},
        "",
    ),
    "rough press fit": (
        parts(),
        {},
        {"interface": {"thread": {**THREAD, "behaviour": "no_slip", "interference": 1e-5}}},
        "",
    ),
    "nut": (
        parts(LONG, _hole(2.75, -13), THROUGH, nut=NUT),
        {},
        {"interface": {"thread": {**THREAD, "sides": ["screw.shank", "nut.*"], "behaviour": "perfect"}}},
        "",
    ),
    "spring along": (parts(), {}, {"spring": {"s": SPRING}}, ""),
    "fixed tip": (parts(), {}, {"boundary": FIXED}, ""),
    "coupling": (parts(), {}, {"coupling": {"c": {"ends": [{"face": "screw.tip"}, {"face": "base.bottom"}]}}}, ""),
    "layer": (parts(), {}, {"interface": {"thread": {**THREAD, **LAYER}}}, ""),
    "shoulder": (parts(SHOULDER, _hole(2.75, -13), THROUGH), {}, {}, ""),
}


def built(case: Case, folder: Path) -> DiscretisedProblem:
    """A case as ``check`` builds it."""
    meshes, options, other, _ = case
    data = scene(write(folder / "parts.msh", meshes, **{"size": 8.0, "curvature": 8, **options})) | other
    search = {key: data.pop(key) for key in ("gap", "friction_coefficient") if key in data}
    data["contact"]["all"] |= search
    return discretise(scene_from_dict(data))


@pytest.mark.parametrize("name", NOT_HELD)
def test_an_end_that_nothing_holds_is_refused_by_its_name(name: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as error:
        built(NOT_HELD[name], tmp_path)
    text = str(error.value)
    assert "bolt.m5.thread: nothing holds" in text
    assert NOT_HELD[name][3] in text


@pytest.mark.parametrize("name", HELD)
def test_an_end_that_something_holds_is_accepted(name: str, tmp_path: Path) -> None:
    assert list(built(HELD[name], tmp_path).cuts) == ["m5"]
