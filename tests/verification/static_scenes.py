"""Quasi-static scenes written in Python: stacks of blocks, a bar gripped between two rough planes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from latin_fmu.stability import scenes
from latin_fmu.stability.scenes import Box, column
from tests.scenes import ramp

STEEL = scenes.STEEL.table()


def scene(steps: int, end: float = 1.0, **solver: Any) -> dict[str, Any]:
    """A quasi-static scene of steel without bodies."""
    time = {"end": end, "instants": steps, "quasi_static": True}
    made = column({}, {}, time, name="static", solver=solver, output={"fields": True, "energy": True})
    return made | {"material": {"steel": dict(STEEL)}}


def add_block(
    into: dict[str, Any], name: str, origin: tuple[float, ...], size: tuple[float, ...], elements: tuple[int, ...]
) -> None:
    """A steel block."""
    into["substructure"][name] = Box(scenes.STEEL, size, elements).table(origin)


def add_stack(
    into: dict[str, Any],
    size: tuple[float, float, float],
    elements: Sequence[tuple[int, int, int]],
    pressure: float,
    gap: float = 0.0,
    **interface: Any,
) -> dict[str, Any]:
    """Blocks free to spread, one on the other, each ``gap`` above the lower one, pressed more and more; no base."""
    for i, counts in enumerate(elements):
        name = f"b{i + 1}"
        add_block(into, name, (0.0, 0.0, i * (size[2] + gap)), size, counts)
        for axis in "xy":
            into["boundary"][f"{name}_{axis}"] = {"type": "symmetry", "face": f"{name}.{axis}min"}
        if i:
            into["interface"][f"i{i}"] = {"sides": [f"b{i}.zmax", f"{name}.zmin"], **interface}
    top = f"b{len(elements)}.zmax"
    into["load"]["press"] = {"face": top, "pressure": pressure, "law": ramp((0, 0), (1, 1))}
    return into


def plates(
    n: int,
    size: tuple[float, float, float] = (0.1, 0.05, 0.006),
    elements: tuple[int, int, int] = (10, 5, 2),
    friction: float = 0.3,
    pressure: float = 100e6,
    shear: float = 20e6,
    steps: int = 20,
    **solver: Any,
) -> dict[str, Any]:
    """``n`` plates on a fixed base, pressed in the first half of the interval and sheared in the second."""
    made = scene(steps, **solver)
    made["boundary"]["base"] = {"type": "fixed", "face": "b1.zmin"}
    made["load"]["press"] = {"face": f"b{n}.zmax", "pressure": pressure, "law": ramp((0, 0), (0.5, 1), (1, 1))}
    made["load"]["shear"] = {"face": f"b{n}.zmax", "traction": [shear, 0.0, 0.0], "law": ramp((0, 0), (0.5, 0), (1, 1))}
    for i in range(1, n + 1):
        add_block(made, f"b{i}", (0.0, 0.0, (i - 1) * size[2]), size, elements)
        made["boundary"][f"y{i}"] = {"type": "symmetry", "face": f"b{i}.ymin"}
        if i > 1:
            made["interface"][f"i{i - 1}"] = {
                "sides": [f"b{i - 1}.zmax", f"b{i}.zmin"],
                "friction_coefficient": friction,
            }
    return made
