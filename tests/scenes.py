"""Scenes of the tests: shipped ones, solved once for a whole session, and tables of ``latin_fmu.stability.scenes``."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.stability.scenes import STEEL, Box, Description, column, half_sine, placed, rubbing

MODELS = Path(__file__).parents[1] / "models"
MINUTES = ("bolted_beam", "electronics_box", "thin_beam")
"""Models whose runs take minutes."""


def solve(description: Description, converged: bool = True) -> latin_fmu.Solution:
    """Solve a description, which stays as it is; ``converged`` : whether it must."""
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(description)))
    assert solution.converged is converged, solution.status
    return solution


@cache
def solved(model: str, *overrides: str) -> latin_fmu.Solution:
    """Solution of ``models/<model>.toml`` with overrides; must converge."""
    solution = latin_fmu.solve(latin_fmu.load_scene(MODELS / f"{model}.toml", overrides))
    assert solution.converged, solution.status
    return solution


def pressure(solution: latin_fmu.Solution, interface: str) -> np.ndarray:
    """Mean contact pressure over the face, (n_time,), Pa."""
    history = solution.interfaces[interface]
    mean: np.ndarray = history.normal_resultant() / history.areas.sum()
    return mean


def ramp(*points: tuple[float, float]) -> dict[str, Any]:
    """Table law through (time, value) points."""
    return {"type": "table", "times": [t for t, _ in points], "values": [v for _, v in points]}


def given_motion(
    face: str, value: Sequence[float], law: Any, components: str = "x", kind: str = "velocity"
) -> Description:
    """Table of a face whose motion along some components, as in "xz", is given."""
    return {"type": kind, "face": face, "components": list(components), "value": list(value), "law": law}


def pressed_stack(
    boxes: Sequence[Box],
    time: Description,
    contact: Description | None = None,
    duration: float = 5e-6,
    shear: tuple[float, float, float] = (3e7, 1e7, 0.0),
    **keys: Any,
) -> Description:
    """Boxes b0, b1, ... on the ground; interfaces floor, i0, i1, ... with friction or as ``contact`` says; the last box
    is pressed by a half sine of this duration, s, and sheared by a step, Pa."""
    names, joint = [f"b{i}" for i in range(len(boxes))], contact or {"friction_coefficient": 0.3}
    tables = column(
        dict(zip(names, boxes, strict=True)),
        {f"i{i}": joint for i in range(len(boxes) - 1)},
        time,
        load={
            "press": {"face": f"{names[-1]}.zmax", "pressure": 2e8, "law": half_sine(duration)},
            "shear": {"face": f"{names[-1]}.zmax", "traction": list(shear), "law": {"type": "step"}},
        },
        **keys,
    )
    tables["interface"] = {"floor": {"sides": ["b0.zmin", "ground"], **joint}, **tables["interface"]}
    return tables


def clamp(**tables: Any) -> Description:
    """Two plates between the jaws of a clamp whose shank is tightened beside them, and pressed by a load."""
    places = {  # origin and size in mm, elements of 5 mm
        "lower": ((0, 0, -10), (60, 20, 10)),
        "upper": ((0, 0, 0), (60, 20, 10)),
        "head": ((20, 10, 10), (20, 15, 10)),
        "nut": ((20, 10, -20), (20, 15, 10)),
        "shank": ((25, 20, -10), (10, 5, 20)),
    }
    touching = {"joint": ("lower.zmax", "upper.zmin"), "over": ("upper.zmax", "head.zmin")}
    touching["under"] = ("nut.zmax", "lower.zmin")
    bonded = {"top": ("shank.zmax", "head.zmin"), "thread": ("nut.zmax", "shank.zmin")}
    bodies = {
        name: (Box(STEEL, [1e-3 * x for x in size], [x // 5 for x in size]), [1e-3 * x for x in origin])
        for name, (origin, size) in places.items()
    }
    return placed(
        bodies,
        {"end": 1e-4, "instants": 10},
        **{
            "interface": {name: rubbing(*sides, 0.2) for name, sides in touching.items()}
            | {name: {"sides": list(sides), "behaviour": "perfect"} for name, sides in bonded.items()},
            "boundary": {"wall": {"type": "fixed", "face": "lower.xmin"}},
            "bolt": {"b": {"substructure": "shank", "axis": [0.0, 0.0, 1.0], "force": 5e3}},
            "load": {"press": {"face": "upper.zmax", "pressure": 8e6}},
            "sensor": {"tip": {"face": "upper.xmax"}},
            **tables,
        },
    )


def rayleigh(tables: Description) -> None:
    """Rayleigh damping of all materials."""
    for material in tables["material"].values():
        material |= {"frame": "absolute", "rayleigh_mass": 1e3, "rayleigh_stiffness": 1e-8}
