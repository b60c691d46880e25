"""Scenes as nested tables: boxes on top of each other, and the problems that hard cases are made of.

``column`` makes any stack of boxes, ``placed`` any boxes; tables may be changed before ``scene_from_dict`` reads them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import sqrt
from typing import Any

Description = dict[str, Any]
"""A scene as nested tables, as a scene file holds them."""
Triple = Sequence[float]
UNIT: Triple = (1.0, 1.0, 1.0)
REST: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Material:
    """An elastic material (any consistent units). keys : further keys of its table, e.g. ``rayleigh_mass``."""

    young: float = 1.0
    density: float = 1.0
    poisson: float = 0.0
    name: str = "m"
    keys: Mapping[str, float] = field(default_factory=dict)

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
        return {"young_modulus": self.young, "poisson_ratio": self.poisson, "density": self.density, **self.keys}


@dataclass(frozen=True)
class Box:
    """A box substructure: material, size, elements, velocity. keys : further keys of its table, e.g. ``rigid``."""

    material: Material = Material()
    size: Triple = UNIT
    elements: Sequence[int] = (3, 3, 3)
    velocity: Triple = REST
    keys: Mapping[str, Any] = field(default_factory=dict)

    def table(self, origin: Triple = REST) -> Description:
        """The substructure's table in a scene."""
        box = {"origin": list(origin), "size": [float(s) for s in self.size], "elements": list(self.elements)}
        velocity = [float(v) for v in self.velocity]
        return {"material": self.material.name, "box": box, "initial_velocity": velocity, **self.keys}


def column(
    bodies: Mapping[str, Box],
    interfaces: Mapping[str, Mapping[str, Any]],
    time: Mapping[str, Any],
    gap: float = 0.0,
    **tables: Any,
) -> Description:
    """Boxes on top of each other along z, the first one at the origin.

    Parameters
    ----------
    bodies : boxes by name, from below. interfaces : further keys of each interface by name, from below.
    time : table of the time. gap : between neighbours, m. tables : further tables, e.g. ``load``, or ``name``.
    """
    height, stacked = 0.0, dict[str, tuple[Box, Triple]]()
    for name, box in bodies.items():
        stacked[name] = (box, (0.0, 0.0, height))
        height += float(box.size[2]) + gap
    pairs = zip(pairwise(bodies), interfaces.items(), strict=True)
    contacts = {name: {"sides": [f"{low}.zmax", f"{up}.zmin"], **keys} for (low, up), (name, keys) in pairs}
    return placed(stacked, time, **{"name": "column", "interface": contacts, "boundary": {}, "load": {}, **tables})


def placed(bodies: Mapping[str, tuple[Box, Triple]], time: Mapping[str, Any], **tables: Any) -> Description:
    """Boxes with their lowest corners at given places.

    Parameters
    ----------
    bodies : boxes and places, m, by name. time : table of the time. tables : further tables, e.g. ``interface``.
    """
    return {
        "name": "boxes",
        "material": {box.material.name: box.material.table() for box, _ in bodies.values()},
        "substructure": {name: box.table(origin) for name, (box, origin) in bodies.items()},
        "time": dict(time),
        **tables,
    }


def bolted_stack(
    material: Material, force: float, friction: float, time: Mapping[str, Any], **tables: Any
) -> Description:
    """Two plates between two yokes, which two bolts beside the plates pull together; held at the foot.

    Parameters
    ----------
    force : of each bolt, N. friction : coefficient between the plates. time, tables : as in ``placed``.
    """
    places = {  # origin, size in mm, elements
        "base": ((0, 0, 0), (60, 20, 8), (12, 4, 2)),
        "lower": ((20, 0, 8), (20, 20, 6), (4, 4, 2)),
        "upper": ((20, 0, 14), (20, 20, 6), (4, 4, 2)),
        "cover": ((0, 0, 20), (60, 20, 8), (12, 4, 2)),
        "left": ((5, 5, 8), (5, 10, 12), (2, 4, 4)),
        "right": ((50, 5, 8), (5, 10, 12), (2, 4, 4)),
    }
    bodies = {
        name: (Box(material, [1e-3 * s for s in size], counts, keys={"bending_modes": True}), [1e-3 * x for x in at])
        for name, (at, size, counts) in places.items()
    }
    bonds = {
        f"{bolt}_{yoke}": {"sides": sides, "behaviour": "perfect"}
        for bolt in ("left", "right")
        for yoke, sides in (("base", ["base.zmax", f"{bolt}.zmin"]), ("cover", [f"{bolt}.zmax", "cover.zmin"]))
    }
    contacts = {
        "bottom": rubbing("base.zmax", "lower.zmin", 0.5),
        "joint": rubbing("lower.zmax", "upper.zmin", friction),
        "top": rubbing("upper.zmax", "cover.zmin", 0.5),
    }
    axis = [0.0, 0.0, 1.0]
    return placed(
        bodies,
        time,
        interface=bonds | contacts,
        boundary={"held": {"type": "fixed", "face": "base.zmin"}},
        bolt={name: {"substructure": name, "axis": axis, "force": force} for name in ("left", "right")},
        **tables,
    )


def rubbing(first: str, second: str, friction: float) -> Description:
    """Table of a contact of two faces with Coulomb friction."""
    return {"sides": [first, second], "friction_coefficient": friction}


def without_slip(scene: Description) -> Description:
    """The scene itself, changed: surfaces that never slide on each other at all interfaces."""
    for table in scene["interface"].values():
        table["behaviour"] = "no_slip"
        table.pop("friction_coefficient", None)
    return scene


def half_sine(duration: float) -> Description:
    """Law of a load: half a sine wave of so many seconds."""
    return {"type": "half_sine", "duration": duration}


def two_boxes(
    low: Box, up: Box, step: float, instants: int, friction: float = 0.0, gap: float = 0.0, **solver: Any
) -> Description:
    """Box ``up`` on box ``low``, ``gap`` apart; interface ``meet``, materials first and second; keys of [solver]."""
    bodies = {
        "low": replace(low, material=replace(low.material, name="first")),
        "up": replace(up, material=replace(up.material, name="second")),
    }
    meet = {"meet": {"friction_coefficient": friction}}
    time = {"end": instants * step, "instants": instants}
    return column(bodies, meet, time, gap, solver=solver, output={"energy": True})


def bar(material: Material, length: float, elements: int, speed: float = 0.0) -> Box:
    """A bar of unit section along z."""
    return Box(material, (1.0, 1.0, length), (1, 1, elements), (0.0, 0.0, speed))


def thrown(
    elements: int, instants: int, end: float, gap: float, speed: float, gravity: float, **solver: Any
) -> Description:
    """Bar of length 10, E 900, rho 1 (wave speed 30) above rigid ground, thrown down or dropped; interface ``wall``."""
    # density 1
    falling = replace(bar(Material(900.0), 10.0, elements, speed), keys={"body_force": [0.0, 0.0, -gravity]})
    time = {"end": end, "instants": instants}
    scene = column({"bar": falling}, {}, time, solver=solver, output={"energy": True})
    scene["substructure"]["bar"]["box"]["origin"][2] = gap
    scene["interface"]["wall"] = {"sides": ["bar.zmin", "ground"], "gap": gap}
    return scene


def cornered(velocity: Triple, friction: float, elements: int = 3, **solver: Any) -> Description:
    """A unit block thrown into a corner of three walls: one node is held by three interfaces."""
    block = Box(Material(poisson=0.3), elements=(elements,) * 3, velocity=velocity)
    scene = column({"block": block}, {}, {"end": 1.6, "instants": 12}, solver=solver, output={"energy": True})
    for face in ("xmin", "ymin", "zmin"):
        scene["interface"][face] = rubbing(f"block.{face}", "ground", friction)
    return scene


ALUMINIUM, STEEL = Material(70e9, 2700.0, 0.3, "aluminium"), Material(210e9, 7800.0, 0.3, "steel")
EDGE, PRESSURE = 0.01, 200e6


def press(friction: float, elements: int = 3, instants: int = 100, quarter: bool = True, **solver: Any) -> Description:
    """Steel block on aluminium block crushed by a half-sine pressure of 10 us; the base slides and stays down."""
    # planes of symmetry at x = 0 and y = 0
    if quarter:
        side, count = EDGE, elements
    else:
        side, count = 2 * EDGE, 2 * elements
    low, up = (Box(m, (side, side, EDGE), (count, count, elements)) for m in (ALUMINIUM, STEEL))
    scene = two_boxes(low, up, 30e-6 / instants, instants, friction, **solver)
    _crush(scene, quarter)
    if not quarter:
        # about the axes, so that the quarter keeps its place
        for table in scene["substructure"].values():
            table["box"]["origin"][:2] = [-EDGE, -EDGE]
    return scene


def stack(count: int, friction: float, elements: int = 3, instants: int = 150, **solver: Any) -> Description:
    """``count`` alternating blocks that touch (gap 0), quarter symmetry, half-sine pressure of 10 us on the top."""
    low, up = (Box(m, (EDGE,) * 3, (elements,) * 3) for m in (ALUMINIUM, STEEL))
    bodies = {f"b{i}": low if i % 2 else up for i in range(1, count + 1)}
    interfaces = {f"i{i}": {"friction_coefficient": friction} for i in range(1, count)}
    time = {"end": 30e-6, "instants": instants}
    scene = column(bodies, interfaces, time, solver=solver, output={"energy": True})
    _crush(scene, quarter=True)
    return scene


def _crush(scene: Description, quarter: bool) -> None:
    """Pressure on the top, a base that slides, planes of symmetry x = 0 and y = 0 (of a quarter)."""
    names = list(scene["substructure"])
    scene["load"] = {"press": {"face": f"{names[-1]}.zmax", "pressure": PRESSURE, "law": half_sine(10e-6)}}
    scene["boundary"] = {"base": {"type": "symmetry", "face": f"{names[0]}.zmin"}}
    for name in names if quarter else ():
        for axis in "xy":
            scene["boundary"][f"{name}_{axis}"] = {"type": "symmetry", "face": f"{name}.{axis}min"}
