"""Descriptions the hard cases are made of: two boxes that meet, a bar that bounces, blocks under a press."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

from .case import Description

Triple = Sequence[float]
UNIT: Triple = (1.0, 1.0, 1.0)
REST: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Stuff:
    """An elastic material (any consistent units)."""

    young: float = 1.0
    density: float = 1.0
    poisson: float = 0.0

    @property
    def impedance(self) -> float:
        """rho c of a bar."""
        return sqrt(self.young * self.density)

    @property
    def speed(self) -> float:
        """Wave speed of a bar."""
        return sqrt(self.young / self.density)

    @property
    def pressure_speed(self) -> float:
        """Speed of pressure waves in the solid."""
        nu = self.poisson
        return sqrt(self.young / self.density * (1 - nu) / ((1 + nu) * (1 - 2 * nu)))

    def table(self) -> dict[str, float]:
        """The material's table in a scene."""
        return {"young_modulus": self.young, "poisson_ratio": self.poisson, "density": self.density}


@dataclass(frozen=True)
class Box:
    """A box substructure: material, size, elements, velocity."""

    stuff: Stuff = Stuff()
    size: Triple = UNIT
    elements: Sequence[int] = (3, 3, 3)
    velocity: Triple = REST

    def table(self, material: str, origin: Triple) -> dict[str, Any]:
        """The substructure's table in a scene."""
        box = {"origin": list(origin), "size": [float(s) for s in self.size], "elements": list(self.elements)}
        return {"material": material, "box": box, "initial_velocity": [float(v) for v in self.velocity]}


def two_boxes(
    low: Box,
    up: Box,
    step: float,
    instants: int,
    friction: float = 0.0,
    gap: float = 0.0,
    behaviour: str = "contact",
    **solver: Any,
) -> Description:
    """Box ``up`` stands on box ``low`` along z, ``gap`` apart; interface ``meet``; further keys: [solver]."""
    meet: dict[str, Any] = {"sides": ["low.zmax", "up.zmin"], "behaviour": behaviour}
    if behaviour == "contact":
        meet["friction_coefficient"] = friction
    return {
        "name": "two_boxes",
        "material": {"first": low.stuff.table(), "second": up.stuff.table()},
        "substructure": {
            "low": low.table("first", REST),
            "up": up.table("second", (0.0, 0.0, float(low.size[2]) + gap)),
        },
        "interface": {"meet": meet},
        "boundary": {},
        "load": {},
        "time": {"end": instants * step, "instants": instants},
        "solver": solver,
        "output": {"energy": True},
    }


def bar(stuff: Stuff, length: float, elements: int, speed: float = 0.0) -> Box:
    """A bar of unit section along z."""
    return Box(stuff, (1.0, 1.0, length), (1, 1, elements), (0.0, 0.0, speed))


def thrown(
    elements: int, instants: int, end: float, gap: float, speed: float, gravity: float, **solver: Any
) -> Description:
    """Bar of length 10, E 900, rho 1 (wave speed 30) above rigid ground, thrown down or dropped; interface ``wall``."""
    falling = bar(Stuff(900.0, 1.0), 10.0, elements, speed).table("bar", (0.0, 0.0, gap))
    return {
        "name": "thrown_bar",
        "material": {"bar": Stuff(900.0, 1.0).table()},
        "substructure": {"bar": falling | {"body_force": [0.0, 0.0, -gravity]}},
        "interface": {"wall": {"sides": ["bar.zmin", "ground"], "gap": gap}},
        "time": {"end": end, "instants": instants},
        "solver": solver,
        "output": {"energy": True},
    }


def cornered(velocity: Triple, friction: float, elements: int = 3, **solver: Any) -> Description:
    """A unit block thrown into a corner of three walls: one node is held by three interfaces."""
    block = Box(Stuff(1.0, 1.0, 0.3), UNIT, (elements,) * 3, velocity)
    return {
        "name": "corner",
        "material": {"rubber": block.stuff.table()},
        "substructure": {"block": block.table("rubber", REST)},
        "interface": {
            face: {"sides": [f"block.{face}", "ground"], "friction_coefficient": friction}
            for face in ("xmin", "ymin", "zmin")
        },
        "time": {"end": 8.0, "instants": 60},
        "solver": solver,
        "output": {"energy": True},
    }


ALUMINIUM, STEEL = Stuff(70e9, 2700.0, 0.3), Stuff(210e9, 7800.0, 0.3)
EDGE, PRESSURE = 0.01, 200e6


def press(friction: float, elements: int = 3, instants: int = 100, quarter: bool = True, **solver: Any) -> Description:
    """Steel block on aluminium block crushed by a half-sine pressure of 10 us; the base slides and stays down."""
    side, count = (EDGE, elements) if quarter else (2 * EDGE, 2 * elements)
    size, number = (side, side, EDGE), (count, count, elements)
    scene = two_boxes(
        Box(ALUMINIUM, size, number), Box(STEEL, size, number), 30e-6 / instants, instants, friction, **solver
    )
    scene["boundary"] = {"base": {"type": "symmetry", "face": "low.zmin"}}
    for name, table in scene["substructure"].items():
        if quarter:
            for axis in "xy":
                scene["boundary"][f"{name}_{axis}"] = {"type": "symmetry", "face": f"{name}.{axis}min"}
        else:
            table["box"]["origin"][:2] = [-EDGE, -EDGE]
    law = {"type": "half_sine", "duration": 10e-6}
    scene["load"] = {"press": {"face": "up.zmax", "pressure": PRESSURE, "law": law}}
    return scene


def stack(count: int, friction: float, elements: int = 3, instants: int = 150, **solver: Any) -> Description:
    """``count`` alternating blocks that touch (gap 0), quarter symmetry, half-sine pressure of 10 us on the top."""
    scene = press(friction, elements, instants, **solver)
    size, number = (EDGE,) * 3, (elements,) * 3
    scene["substructure"], scene["interface"] = {}, {}
    scene["boundary"] = {"base": {"type": "symmetry", "face": "b1.zmin"}}
    scene["load"]["press"]["face"] = f"b{count}.zmax"
    for i in range(1, count + 1):
        stuff, name = (ALUMINIUM, "first") if i % 2 else (STEEL, "second")
        scene["substructure"][f"b{i}"] = Box(stuff, size, number).table(name, (0.0, 0.0, (i - 1) * EDGE))
        for axis in "xy":
            scene["boundary"][f"b{i}_{axis}"] = {"type": "symmetry", "face": f"b{i}.{axis}min"}
        if i > 1:
            scene["interface"][f"i{i - 1}"] = {
                "sides": [f"b{i - 1}.zmax", f"b{i}.zmin"],
                "friction_coefficient": friction,
            }
    return scene
