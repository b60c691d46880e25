"""Scenes of the cost model: shipped models, benchmark problems, effects one by one."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark_problems import Case, bars, crushing, plates, tower
from price_of_effects import JOINT, LAYER, MEET, SOFT, STEP, base, changed

import latin_fmu

Tables = dict[str, Any]
MODELS = Path(__file__).parents[1] / "models"
OWN = {"propagator": "direct", "share_identical": False}


@dataclass(frozen=True)
class Pair:
    """Effects switched on and off, as ``latin-fmu explain`` names them."""

    name: str
    effects: tuple[str, ...]
    on: Tables
    off: Tables


def models() -> dict[str, latin_fmu.Scene]:
    """Every shipped scene but one of minutes."""
    files = sorted(file for file in MODELS.glob("*/*.toml") if file.parent.name != "bolted_beam")
    return {f"{file.parent.name}/{file.stem}": latin_fmu.load_scene(file) for file in files}


def benchmarks(quick: bool) -> dict[str, latin_fmu.Scene]:
    """Problems P1, P2, P3 and stacks of plates without inertia; each way to march, with own and shared factors."""
    small: list[Case] = [bars((1, 1, 50), None), crushing(4, 0.3), tower(4, 4), plates(4)]
    large = [bars((4, 4, 100), None), crushing(10, 0.3), crushing(14, 0.3), tower(16, 4), tower(16, 6), plates(16)]
    scenes = {f"{c.case}, {c.n_blocks} blocks": _solved(c, OWN) for c in (small if quick else small + large)}
    scenes["P3 n=4, 16 blocks, shared"] = _solved(tower(16, 4), {"propagator": "direct"})
    for solver in ({"propagator": "reduced"}, {"propagator": "cg"}, {"precision": "float32"}, {"window": 10}):
        scenes[f"P2 n=4, {next(iter(solver.values()))}"] = _solved(crushing(4, 0.3), solver)
    scenes["P2 n=4, whole interval"] = _solved(crushing(4, 0.3), {"window": "whole"})
    scenes["P2 n=4, explicit"] = _solved(crushing(4, 0.3), {"propagator": "explicit"}, finer=3)  # stable
    whole_faces = changed(base(4 if quick else 12, 60), {"interface.meet.friction_coefficient": 0.3})
    return scenes | {"contact of whole faces": scene(whole_faces)}


def _solved(case: Case, solver: Tables, finer: int = 1) -> latin_fmu.Scene:
    """A case with solver settings of its own and ``finer`` times the instants."""
    tables: Tables = {**copy.deepcopy(case.description), "solver": solver}
    tables["time"]["instants"] *= finer
    return scene(tables)


def pairs(elements: int, instants: int) -> list[Pair]:
    """Effects on two blocks that are pushed from both ends."""
    start = changed(
        base(elements, instants),
        {
            "load.back": {"face": "b.zmax", "pressure": 1e8, "law": {"type": "half_sine", "duration": 30 * STEP}},
            "solver.share_identical": False,
        },
    )
    apart = copy.deepcopy(start)
    del apart["interface"]
    rubbed = changed(start, {"interface.meet.friction_coefficient": 0.2})
    bond = {**MEET, "behaviour": "perfect"}
    return [
        Pair("contact", ("unilateral contact",), start, apart),
        Pair("friction", ("friction",), rubbed, start),
        Pair(
            "soft contact",
            ("unilateral contact", "friction", "layers and joints"),
            changed(start, {"interface.meet": SOFT}),
            apart,
        ),
        Pair("elastic layer", ("layers and joints",), changed(start, {"interface.meet": LAYER}), apart),
        Pair("viscous joint", ("layers and joints",), changed(start, {"interface.meet": JOINT}), apart),
        Pair("bond, one solve", ("perfect bond",), changed(start, {"interface.meet": bond}), apart),
        Pair(
            "bond, iterated",
            ("perfect bond",),
            changed(start, {"interface.meet": bond, "solver.bonds": "iterate"}),
            apart,
        ),
        Pair("damping", ("damping",), changed(start, {"material.steel.rayleigh_stiffness": 1e-8}), start),
        Pair("body force", ("body force",), changed(start, {"substructure.a.body_force": [0.0, 0.0, 1e7]}), start),
        Pair("energy balance", ("energy balance",), changed(start, {"output.energy": True}), start),
        Pair("stress", ("stress",), changed(start, {"output.stress": True}), start),
        Pair("interior history", ("interior history",), changed(start, {"output.fields": True}), start),
    ]


def scene(tables: Tables) -> latin_fmu.Scene:
    """The scene of a description."""
    return latin_fmu.scene_from_dict(copy.deepcopy(tables))
