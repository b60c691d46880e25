"""The three benchmark problems as scenes written in Python.

Boxes stacked along z, regular 8-node hexahedra, matching nodes; quarter symmetry (u_x = 0 at x = 0, u_y = 0 at y = 0);
the lowest face cannot move along z; pressure on the top face; at rest at t = 0.

P1  two bars of 10 x 10 x 100 mm with a gap of 10 um, no friction, a step of pressure: shocks at a slender contact.
P2  a steel block crushed on an aluminium one by a half-sine pulse, friction between them.
P3  the same with 2 to 16 blocks, aluminium and steel in turn: many contact surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

Description = dict[str, Any]

ALUMINIUM = {"young_modulus": 70e9, "poisson_ratio": 0.3, "density": 2700.0}
STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
BAR = {"young_modulus": 210e9, "poisson_ratio": 0.0, "density": 7800.0}
EDGE, LENGTH = 0.01, 0.1  # m


@dataclass(frozen=True)
class Case:
    """One problem: ``case`` names it in tables, ``description`` is its scene.

    ``published`` is the linear transient of the same problem as published with it, s, assembly included: SciPy's
    SuperLU or CHOLMOD on the author's machine; None where none is.
    """

    case: str
    n_blocks: int
    mu: float
    description: Description
    published: float | None = None


def bars(elements: Sequence[int], published: float | None) -> Case:
    """P1. Poisson's ratio is 0 on the coarse mesh and 0.3 where the section is resolved."""
    slender = elements[0] == 1
    load = {"face": "b2.zmax", "pressure": 100e6, "law": {"type": "step"}}
    scene = _stack([BAR if slender else STEEL] * 2, (EDGE, EDGE, LENGTH), elements, 1e-5, 0.0, load, 250, 0.4e-6)
    return Case("P1 " + "x".join(map(str, elements)), 2, 0.0, scene, published)


def crushing(n: int, mu: float, published: float | None = None) -> Case:
    """P2 with n^3 elements in each block."""
    scene = _stack([ALUMINIUM, STEEL], (EDGE,) * 3, (n,) * 3, 0.0, mu, _pulse(2), 200, 0.15e-6)
    return Case(f"P2 n={n}", 2, mu, scene, published)


def tower(blocks: int, n: int, published: float | None = None) -> Case:
    """P3: ``blocks`` blocks of n^3 elements."""
    materials = [STEEL if i % 2 else ALUMINIUM for i in range(blocks)]
    scene = _stack(materials, (EDGE,) * 3, (n,) * 3, 0.0, 0.3, _pulse(blocks), 200, 0.2e-6)
    return Case(f"P3 n={n}", blocks, 0.3, scene, published)


def plates(count: int, elements: Sequence[int] = (8, 8, 2)) -> Case:
    """Stack of steel plates on a fixed base, slow: pressed by 50 MPa on top, then sheared by 5 MPa along x.

    40 x 40 x 5 mm each. No symmetry is used. The shear stays far below sliding; its moment opens the edges of high
    stacks, where the plates also slip. Twenty steps without inertia.
    """
    scene = _stack([STEEL] * count, (0.04, 0.04, 0.005), elements, 0.0, 0.3, {}, 20, 0.05)
    up, down = [0.0, 0.5, 1.0], [0.0, 1.0, 1.0]
    top = f"b{count}.zmax"
    scene["time"]["quasi_static"] = True
    scene["boundary"] = {"base": {"type": "fixed", "face": "b1.zmin"}}
    scene["load"] = {
        "press": {"face": top, "pressure": 50e6, "law": {"type": "table", "times": up, "values": down}},
        "shear": {
            "face": top,
            "traction": [5e6, 0.0, 0.0],
            "law": {"type": "table", "times": up, "values": [0.0, 0.0, 1.0]},
        },
    }
    return Case(f"plates {'x'.join(map(str, elements))}", count, 0.3, scene)


def quick_cases() -> list[Case]:
    """A first look, under a minute."""
    return [
        bars((1, 1, 50), 0.033),
        *(crushing(4, mu, 0.037) for mu in (0.1, 10.0)),
        tower(2, 4, 0.033),
        tower(16, 4, 0.206),
    ]


def all_cases(finest: bool = False) -> list[Case]:
    """Every problem; ``finest`` adds P2 with 20^3 elements in a block."""
    coefficients = (0.0, 0.1, 0.3, 10.0)
    cases = [bars((1, 1, 50), 0.033), bars((4, 4, 100), 1.14)]
    for n, published in ((4, 0.037), (10, 0.85), *(((20, None),) if finest else ())):
        cases += [crushing(n, mu, published) for mu in coefficients]
    for n, seconds in ((4, (0.033, 0.050, 0.115, 0.206)), (6, (None, None, None, 1.41))):
        cases += [tower(blocks, n, s) for blocks, s in zip((2, 4, 8, 16), seconds, strict=True)]
    return cases


def _pulse(blocks: int) -> Description:
    return {"face": f"b{blocks}.zmax", "pressure": 200e6, "law": {"type": "half_sine", "duration": 10e-6}}


def _stack(
    materials: Sequence[Description],
    size: Sequence[float],
    elements: Sequence[int],
    gap: float,
    mu: float,
    load: Description,
    steps: int,
    step: float,
) -> Description:
    """Blocks b1, b2, ... from the bottom to the top, interfaces i1, i2, ..., the load ``press``."""
    kinds = {f"m{k}": m for k, m in enumerate({str(m): m for m in materials}.values())}
    scene: Description = {
        "name": "stack",
        "material": kinds,
        "substructure": {},
        "interface": {},
        "load": {"press": load},
        "boundary": {"base": {"type": "symmetry", "face": "b1.zmin"}},
        "time": {"end": steps * step, "instants": steps},
    }
    for i, material in enumerate(materials, 1):
        name = next(k for k, m in kinds.items() if m == material)
        box = {"origin": [0.0, 0.0, (i - 1) * (size[2] + gap)], "size": list(size), "elements": list(elements)}
        scene["substructure"][f"b{i}"] = {"material": name, "box": box}
        for axis in "xy":
            scene["boundary"][f"b{i}_{axis}"] = {"type": "symmetry", "face": f"b{i}.{axis}min"}
        if i > 1:
            interface: Description = {"sides": [f"b{i - 1}.zmax", f"b{i}.zmin"], "behaviour": "contact"}
            interface |= {"friction_coefficient": mu, "gap": gap}
            scene["interface"][f"i{i - 1}"] = interface
    return scene
