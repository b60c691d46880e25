"""What each effect costs when a scene calls for it, and when it is there but idle: CPU time, unknowns, memory.

Two elastic blocks in frictionless contact, one pushed, are the base: what is off there is not allocated and not called.
Every row adds one effect, idle (its result is that of the base) and at work; rows of one base are measured in turns.
A chain of eight blocks, of which the wave reaches three, shows what substructures at rest save. Writes one figure:
  price_of_effects.png  CPU time of the march relative to the base, idle and at work
"""

from __future__ import annotations

import copy
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from example_tools import BLUE, ORANGE, options, save, table, tidy
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.assembly.build import build

Tables = dict[str, Any]
STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
MEET = {"sides": ["a.zmax", "b.zmin"]}
SOFT = {**MEET, "behaviour": "soft_contact", "normal_stiffness": 1e15, "friction_coefficient": 0.2}
LAYER = {**MEET, "behaviour": "elastic_layer", "normal_stiffness": 1e15, "tangential_stiffness": 4e14}
JOINT = {**MEET, "behaviour": "viscous_joint", "normal_viscosity": 4e7, "tangential_viscosity": 2e7}
EDGE, STEP, ROUNDS = 0.01, 2e-7, 5
SPEED = float(np.sqrt(210e9 * 0.7 / (1.3 * 0.4) / 7800.0))


@dataclass(frozen=True)
class Row:
    """One effect: changes of the base (dotted path -> value, None removes) that make it idle and put it to work."""

    name: str
    idle: Tables | None
    active: Tables | None


ROWS = (
    Row("contact (against none)", {"interface.meet.gap": 1.0}, {}),
    Row("friction", {"interface.meet.friction_coefficient": 1e-13}, {"interface.meet.friction_coefficient": 0.2}),
    Row("preload", {"interface.meet.preload": 1e-20}, {"interface.meet.preload": 1e7}),
    Row("damping", {"material.steel.rayleigh_stiffness": 1e-25}, {"material.steel.rayleigh_stiffness": 1e-8}),
    Row("body force", {"substructure.a.body_force": [0.0, 0.0, 1e-20]}, {"substructure.a.body_force": [0.0, 0.0, 1e7]}),
    Row("absorbing end", None, {"boundary.out": {"type": "absorbing", "face": "b.zmax"}}),
    Row("energy balance", None, {"output.energy": True}),
    Row("stress", None, {"output.stress": True}),
    Row("interior history", None, {"output.fields": True}),
    Row("soft contact", {"interface.meet": {**SOFT, "gap": 1.0}}, {"interface.meet": SOFT}),
    Row("elastic layer", None, {"interface.meet": LAYER}),
    Row("viscous joint", None, {"interface.meet": JOINT}),
    Row("rigid upper block", None, {"substructure.b.rigid": True}),
    Row("bond, one solve", None, {"interface.meet.behaviour": "perfect"}),
    Row("bond, iterated", None, {"interface.meet.behaviour": "perfect", "solver.bonds": "iterate"}),
)


def base(elements: int, instants: int) -> Tables:
    """Two blocks in frictionless contact."""
    box = {"size": [EDGE] * 3, "elements": [elements] * 3}
    return {
        "name": "base",
        "material": {"steel": dict(STEEL)},
        "substructure": {
            "a": {"material": "steel", "box": box},
            "b": {"material": "steel", "box": {**box, "origin": [0.0, 0.0, EDGE]}},
        },
        "interface": {"meet": dict(MEET)},
        "load": {"push": {"face": "a.zmin", "pressure": 1e8, "law": {"type": "half_sine", "duration": 30 * STEP}}},
        "time": {"end": instants * STEP, "instants": instants},
        "output": {},
        "solver": {},
        "boundary": {},
    }


def chain(elements: int) -> Tables:
    """Eight bonded blocks, the wave is in the third at the end."""
    transit = 2 * EDGE / SPEED
    tables = base(elements, round(2.9 * 16 * elements))
    del tables["interface"]["meet"], tables["substructure"]["a"], tables["substructure"]["b"]
    for i in range(1, 9):
        across, along = max(elements // 2, 1), 4 * elements
        box = {"origin": [0.0, 0.0, 2 * EDGE * i], "size": [EDGE, EDGE, 2 * EDGE], "elements": [across, across, along]}
        tables["substructure"][f"b{i}"] = {"material": "steel", "box": box}
        if i > 1:
            tables["interface"][f"i{i}"] = {"sides": [f"b{i - 1}.zmax", f"b{i}.zmin"], "behaviour": "perfect"}
    tables["load"]["push"] = {"face": "b1.zmin", "pressure": 1e8, "law": {"type": "half_sine", "duration": transit}}
    tables["time"]["end"] = 2.9 * transit
    return tables


def changed(tables: Tables, changes: Tables) -> Tables:
    """A copy with some values set."""
    tables = copy.deepcopy(tables)
    for path, value in changes.items():
        *holders, key = path.split(".")
        table = tables
        for holder in holders:
            table = table.setdefault(holder, {})
        table[key] = value
    return tables


def without_interface(tables: Tables) -> Tables:
    """The base with its blocks apart, each its own as in contact."""
    tables = changed(tables, {"solver.share_identical": False})
    del tables["interface"]
    return tables


def march_seconds(tables: Tables) -> float:
    """CPU time of a run without its set-up, s."""
    timings = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(tables))).timings
    return timings.total - timings.setup


def in_turns(scenes: Sequence[Tables], rounds: int) -> list[float]:
    """Median CPU time of every scene, measured in turns after one round that does not count."""
    found = [[march_seconds(tables) for tables in scenes] for _ in range(rounds + 1)]
    return [float(np.median(column)) for column in zip(*found[1:], strict=True)]


def unknowns(tables: Tables) -> tuple[int, int]:
    """Unknowns of the substructures, and of the interfaces."""
    assembly = build(latin_fmu.scene_from_dict(copy.deepcopy(tables))).assembly
    return sum(p.n_dof * len(p.names) for p in assembly.propagators), assembly.layout.n_flat


def megabytes(tables: Tables) -> float:
    """Peak memory of a run, set-up included, MB."""
    scene = latin_fmu.scene_from_dict(copy.deepcopy(tables))
    tracemalloc.start()
    latin_fmu.solve(scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure, draw, and return the checked numbers."""
    arguments = options(argv, __doc__)
    elements, instants, rounds = (3, 60, 1) if arguments.quick else (6, 200, ROUNDS)

    # scene: the base and one change at a time
    start = base(elements, instants)
    apart = without_interface(start)
    scenes, names = [start, apart], ["base", "base, blocks apart"]
    for row in ROWS:
        for kind, changes in (("idle", row.idle), ("at work", row.active)):
            if changes is not None:
                scenes.append(changed(start, changes))
                names.append(f"{row.name}: {kind}")

    # solve
    seconds = dict(zip(names, in_turns(scenes, rounds), strict=True))
    kinds = ("off", "exact", "round_off", "tolerance")
    waves = [changed(chain(elements), {"solver.skip_at_rest": kind}) for kind in kinds]
    rest = dict(zip(kinds, in_turns(waves, rounds), strict=True))
    marched = {
        k: latin_fmu.solve(latin_fmu.scene_from_dict(w)).outcome.marched for k, w in zip(kinds, waves, strict=True)
    }

    # check
    print(f"{'':34}{'CPU ms':>10}{'of base':>10}{'unknowns':>10}{'interface':>11}{'peak MB':>9}")
    for name, tables in zip(names, scenes, strict=True):
        bodies, interface = unknowns(tables)
        print(
            f"{name:34}{1e3 * seconds[name]:10.2f}{seconds[name] / seconds['base']:10.2f}{bodies:10d}{interface:11d}"
            f"{np.nan if arguments.quick else megabytes(tables):9.1f}"
        )
    numbers = {
        "open_contact_over_no_interface": seconds["contact (against none): idle"] / seconds["base, blocks apart"],
        "idle_friction_over_frictionless": seconds["friction: idle"] / seconds["base"],
        "energy_over_none": seconds["energy balance: at work"] / seconds["base"],
        "soft_contact_over_contact": seconds["soft contact: at work"] / seconds["friction: at work"],
        "layer_over_iterated_bond": seconds["elastic layer: at work"] / seconds["bond, iterated: at work"],
        "rigid_over_elastic": seconds["rigid upper block: at work"] / seconds["base"],
        "one_solve_over_iterated_bond": seconds["bond, one solve: at work"] / seconds["bond, iterated: at work"],
        "interface_unknowns_frictionless": float(unknowns(start)[1]),
        "interface_unknowns_friction": float(unknowns(changed(start, ROWS[1].active or {}))[1]),
        "chain_marched_exact": marched["exact"],
        "chain_marched_round_off": marched["round_off"],
        "chain_marched_tolerance": marched["tolerance"],
        "chain_time_tolerance_over_off": rest["tolerance"] / rest["off"],
    }

    # save
    save(figure(seconds), arguments.folder, "price_of_effects")
    return numbers


def figure(seconds: dict[str, float]) -> Figure:
    """Bars of the time relative to the base."""
    drawn = Figure(figsize=(8.5, 6.0), layout="constrained")
    axis = drawn.subplots()
    for place, row in enumerate(reversed(ROWS)):
        reference = seconds["base, blocks apart"] if row.name.startswith("contact") else seconds["base"]
        for shift, kind, colour in ((0.2, "idle", ORANGE), (-0.2, "at work", BLUE)):
            value = seconds.get(f"{row.name}: {kind}")
            if value is not None:
                axis.barh(
                    place + shift,
                    value / reference,
                    height=0.38,
                    color=colour,
                    label=kind if place == len(ROWS) - 1 else None,
                )
                axis.text(
                    value / reference + 0.02, place + shift, f"{value / reference:.2f}", va="center", fontsize="small"
                )
    axis.axvline(1.0, color="0.3", linewidth=1.0, linestyle="--")
    axis.set_yticks(range(len(ROWS)), [row.name for row in reversed(ROWS)])
    axis.set(
        xlabel="CPU time of the march over that of the base (1: the effect is off)",
        title="What an effect costs where a scene calls for it",
    )
    axis.legend(frameon=False, loc="lower right")
    tidy(axis)
    return drawn


if __name__ == "__main__":
    print(table(main()))
