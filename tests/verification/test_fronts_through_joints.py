"""A front through a joint that is closed from the start, against the exact solution and against bonded bars.

Two equal bars in a line, no friction, a pulse on the end of the first. By characteristics the joint carries the pulse
from t = L/c on and separates when it has passed: nothing acts there any more, and no energy is lost. Bonded bars show
what mesh and scheme make of the front where no joint opens.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.build import discretise
from latin_fmu.stability.scenes import Box, Material, column

LENGTH, PULSE, END = 1.0, 1.0, 4.0
"""Of a bar, m; duration of the pulse, s; of the run, s. Density, modulus and so the wave speed are 1."""


def bars(elements: int, rise: float, scheme: Any = None, bonded: bool = False) -> dict[str, Any]:
    """The scene; ``rise`` of the pulse in elements."""
    parts = {name: Box(Material(1.0, 1.0, 0.0), (0.1, 0.1, LENGTH), (1, 1, elements)) for name in ("a", "b")}
    joint = {"behaviour": "perfect"} if bonded else {"friction_coefficient": 0.0}
    time = {"end": END, "instants": round(2 * END * elements / LENGTH)}
    scene = copy.deepcopy(column(parts, {"joint": joint}, time)) | {"output": {"energy": True}}
    sides = [(name, side) for name in parts for side in ("xmin", "xmax", "ymin", "ymax")]
    scene["boundary"] = {f"{name}_{side}": {"type": "symmetry", "face": f"{name}.{side}"} for name, side in sides}
    scene["time"] |= {"scheme": scheme} if scheme else {}
    last = rise * LENGTH / elements
    points = [(0.0, 0.0), (last, 1.0), (PULSE, 1.0), (PULSE + last, 0.0), (END, 0.0)]
    if rise == 0:
        points = [(0.0, 1.0), (PULSE, 1.0), (PULSE + 1e-9, 0.0), (END, 0.0)]
    law = {"type": "table", "times": [t for t, _ in points], "values": [v for _, v in points]}
    scene["load"] = {"push": {"face": "a.zmin", "traction": [0.0, 0.0, 1.0], "law": law}}
    return scene


def solved(elements: int, rise: float, **changes: Any) -> tuple[latin_fmu.Solution, np.ndarray]:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(bars(elements, rise, **changes)))
    assert solution.converged, solution.status
    return solution, np.abs(solution.interfaces["joint"].traction[:, :, 2]).mean(axis=1)


def kept(solution: latin_fmu.Solution, rise: float, elements: int) -> float:
    """Kinetic and elastic energy over the work of the load, while the pulse crosses the second bar."""
    energy, last = solution.energy, rise * LENGTH / elements
    assert energy is not None
    during = (solution.time > 2.2 + last) & (solution.time < 2.9)
    return float((energy["kinetic"] + energy["elastic"])[during].mean() / energy["work_of_loads"][during].mean())


@pytest.mark.parametrize("scheme", [None, "generalized_alpha"])
@pytest.mark.parametrize("rise", [0, 4])
@pytest.mark.parametrize("elements", [40, *(pytest.param(n, marks=pytest.mark.slow) for n in (80, 160))])
def test_a_front_leaves_nothing_behind(elements: int, rise: float, scheme: str | None) -> None:
    """By default and with ``generalized_alpha``: after the exact separation at most 0.3 % of the pressure, a peak of at
    most that of the bonded bars and 3 %, at most 0.5 % of the energy lost beyond theirs, the impulse to 2 %."""
    solution, pressure = solved(elements, rise, scheme=scheme)
    bonded, through = solved(elements, rise, scheme="generalized_alpha", bonded=True)
    separated = LENGTH + PULSE + rise * LENGTH / elements
    assert pressure[solution.time > separated + 0.25].max() <= 3e-3
    assert pressure.max() <= 1.03 * through.max()
    assert abs(kept(solution, rise, elements) - kept(bonded, rise, elements)) <= 5e-3
    assert np.trapezoid(pressure, solution.time) == pytest.approx(PULSE, rel=0.02)


@pytest.mark.parametrize(
    ("rise", "scheme"), [(0, "generalized_alpha"), (4, "generalized_alpha"), (8, "generalized_alpha"), (20, "hht")]
)
def test_the_scheme_follows_the_front(rise: float, scheme: str) -> None:
    """A load that grows by a fifth within a twentieth of a bar is a front; of slower ones HHT gives the better force.
    The same rise in time has the same scheme on any mesh."""
    for elements in (40, 80):
        scene = latin_fmu.scene_from_dict(bars(elements, rise * elements / 40))
        assert discretise(scene).scheme.name == scheme
