"""Predicted against measured CPU time: shipped models, benchmark problems, and effects switched on and off.

``latin-fmu explain`` predicts counts of operations times seconds per operation. Here every scene is solved, and
prediction and measurement (operators and march, median of several rounds, one thread) stand side by side; for effects,
the predicted share of the march beside the share that the march takes longer with the effect than without.

  --fit    fits the seconds per operation to these runs and prints them for latin_fmu/effects/cost.py: to be done on
           another machine, or after the kernels have changed
"""

from __future__ import annotations

import copy
import gc
import time as clock
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np
from harness import OWN, Case, bars, crushing, plates, tools, tower
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.building import discretise, solver_ready, started
from latin_fmu.effects.cost import OPERATIONS, Prediction, RunSize, march_counts, operator_counts
from latin_fmu.effects.explanation import explain
from latin_fmu.march import march as march_problem
from latin_fmu.stability.scenes import STEEL, Box, Description, column, half_sine

FACTOR = 2.0  # aimed at for totals
SMALL = 0.05  # shares below are noise
EDGE, STEP = 0.01, 2e-7  # m, s
MINUTES = ("bolted_beam", "electronics_box", "thin_beam")
LAWS = {
    "soft contact": {"behaviour": "soft_contact", "normal_stiffness": 1e15, "friction_coefficient": 0.2},
    "elastic layer": {"behaviour": "elastic_layer", "normal_stiffness": 1e15, "tangential_stiffness": 4e14},
    "viscous joint": {"behaviour": "viscous_joint", "normal_viscosity": 4e7, "tangential_viscosity": 2e7},
}


# -- scenes -----------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Pair:
    """Effects switched on and off, as ``latin-fmu explain`` names them."""

    name: str
    effects: tuple[str, ...]
    on: Description
    off: Description


def models() -> dict[str, latin_fmu.Scene]:
    """Every shipped scene but those of minutes."""
    files = sorted(file for file in tools.MODELS.glob("*/*.toml") if file.parent.name not in MINUTES)
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
    whole_faces = pushed(4 if quick else 12, 60, **{"interface.meet.friction_coefficient": 0.3})
    return scenes | {"contact of whole faces": latin_fmu.scene_from_dict(whole_faces)}


def _solved(case: Case, solver: Description, finer: int = 1) -> latin_fmu.Scene:
    """A case with solver settings of its own and ``finer`` times the instants."""
    tables: Description = {**copy.deepcopy(case.description), "solver": solver}
    tables["time"]["instants"] *= finer
    return latin_fmu.scene_from_dict(tables)


def pushed(elements: int, instants: int, **changes: Any) -> Description:
    """Two blocks in frictionless contact, one pushed; with changes by dotted path."""
    block = Box(STEEL, (EDGE,) * 3, (elements,) * 3)
    push = {"face": "a.zmin", "pressure": 1e8, "law": half_sine(30 * STEP)}
    time = {"end": instants * STEP, "instants": instants}
    tables = column({"a": block, "b": block}, {"meet": {}}, time, load={"push": push}, solver={}, output={})
    for path, value in changes.items():
        *holders, key = path.split(".")
        table = tables
        for holder in holders:
            table = table[holder]
        table[key] = value
    return tables


def pairs(elements: int, instants: int) -> list[Pair]:
    """Effects on two blocks that are pushed from both ends."""

    def made(**changes: Any) -> Description:
        back = {"face": "b.zmax", "pressure": 1e8, "law": half_sine(30 * STEP)}
        return pushed(elements, instants, **{"load.back": back, "solver.share_identical": False, **changes})

    start, apart, sides = made(), made(), {"sides": ["a.zmax", "b.zmin"]}
    del apart["interface"]
    rubbed = made(**{"interface.meet.friction_coefficient": 0.2})
    bond = {"interface.meet": {**sides, "behaviour": "perfect"}}
    laws = {name: made(**{"interface.meet": {**sides, **law}}) for name, law in LAWS.items()}
    layers = ("layers and joints",)
    return [
        Pair("contact", ("unilateral contact",), start, apart),
        Pair("friction", ("friction",), rubbed, start),
        Pair("soft contact", ("unilateral contact", "friction", *layers), laws["soft contact"], apart),
        *(Pair(name, layers, laws[name], apart) for name in ("elastic layer", "viscous joint")),
        Pair("bond, one solve", ("perfect bond",), made(**bond), apart),
        Pair("bond, iterated", ("perfect bond",), made(**bond, **{"solver.bonds": "iterate"}), apart),
        Pair("damping", ("damping",), made(**{"material.steel.rayleigh_stiffness": 1e-8}), start),
        Pair("body force", ("body force",), made(**{"substructure.a.body_force": [0.0, 0.0, 1e7]}), start),
        Pair("energy balance", ("energy balance",), made(**{"output.energy": True}), start),
        Pair("stress", ("stress",), made(**{"output.stress": True}), start),
        Pair("interior history", ("interior history",), made(**{"output.fields": True}), start),
    ]


# -- comparison -------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Measured:
    """A run: its predicted sizes; measured CPU seconds of operators and march; LATIN iterations per window."""

    size: RunSize
    operators: float
    march: float
    iterations: float

    @property
    def total(self) -> float:
        """CPU seconds of operators and march."""
        return self.operators + self.march


def measured(scenes: Mapping[str, latin_fmu.Scene], rounds: int) -> dict[str, Measured]:
    """Every scene solved in turn, after one round that does not count."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in scenes}
    runs = {}
    with threadpool_limits(1):
        for _ in range(rounds + 1):
            for name, one in scenes.items():
                ready = discretise(one)
                gc.collect()
                start = clock.process_time()
                built = solver_ready(*started(ready, {}))
                middle = clock.process_time()
                outcome = march_problem(built).outcome
                times[name].append((middle - start, clock.process_time() - middle))
                seconds = (median(part) for part in zip(*times[name][-rounds:], strict=True))
                iterations = float(np.mean([w.iterations for w in outcome.windows]))
                runs[name] = Measured(Prediction(ready).run, *seconds, iterations)
    return runs


def fitted(runs: Sequence[Measured]) -> np.ndarray:
    """Seconds per operation: non-negative, relative errors of all times weighed alike."""
    # with the iterations of the run: the fit is not to make up for a wrong number
    counts = [march_counts(replace(r.size, iterations=r.iterations)) for r in runs]
    counts += [operator_counts(r.size) for r in runs]
    matrix, times = np.array(counts), np.array([r.march for r in runs] + [r.operators for r in runs])
    weight = 1.0 / times
    for _ in range(30):  # towards equal errors of the logarithm
        rows = matrix * weight[:, None]
        size = np.maximum(np.abs(rows).max(axis=0), 1e-300)
        per = nnls(rows / size, times * weight)[0] / size
        weight = 1.0 / np.sqrt(times * np.maximum(matrix @ per, 0.1 * times))
    return per


def shares(pair: Pair, runs: Mapping[str, Measured]) -> tuple[float, float]:
    """Share of the march that ``explain`` predicts for an effect, and the one measured."""
    explained = explain(latin_fmu.scene_from_dict(pair.on))
    cost = sum(e.cost for e in explained.effects if e.name in pair.effects)
    on, off = runs[f"{pair.name}: on"], runs[f"{pair.name}: off"]
    return cost / explained.prediction["cpu_seconds_instant"], 1.0 - off.march / on.march


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure and compare; returns the checked numbers."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few small scenes, once")
    parser.add_argument("--fit", action="store_true", help="fit the seconds per operation, and print them")
    options = parser.parse_args(argv)
    quick: bool = options.quick

    # scenes: models, benchmarks, effects
    scenes = {n: s for n, s in models().items() if not quick or s.time.n_step < 100} | benchmarks(quick)
    switched = pairs(3, 60) if quick else pairs(6, 200)
    for pair in switched:
        on, off = (latin_fmu.scene_from_dict(tables) for tables in (pair.on, pair.off))
        scenes |= {f"{pair.name}: on": on, f"{pair.name}: off": off}

    # solve
    runs = measured(scenes, 1 if quick else 3)

    # compare
    print(f"{'':50}{'operators ms':>20}{'march ms':>20}{'total':>8}{'iterations':>16}")
    print(f"{'':50}{'predicted  measured' * 2:>40}{'ratio':>8}{'predicted   met':>16}")
    per = fitted(list(runs.values()))
    ratios = {}
    for name, one in runs.items():
        prediction = Prediction(discretise(scenes[name]))
        ratios[name] = (prediction.operators + prediction.march) / one.total
        seconds = prediction.operators, one.operators, prediction.march, one.march
        columns = "".join(f"{1e3 * value:10.1f}" for value in seconds)
        print(f"{name:50}{columns}{ratios[name]:8.2f}{one.size.iterations:10.1f}{one.iterations:6.1f}")
    print(f"\n{'share of the march':50}{'predicted':>10}{'measured':>10}")
    by_effect = {pair.name: shares(pair, runs) for pair in switched}
    for name, (predicted, met) in by_effect.items():
        print(f"{name:50}{predicted:10.3f}{met:10.3f}")
    if options.fit:
        print("\n" + ", ".join(f"{name}={value:.2g}" for name, value in zip(OPERATIONS, per, strict=True)))

    off = np.abs(np.log(list(ratios.values())))
    seen = [(predicted, met) for predicted, met in by_effect.values() if met > SMALL]
    return {
        "scenes": float(len(ratios)),
        "within_factor_2": float((off < np.log(FACTOR)).mean()),
        "worst_factor": float(np.exp(off.max())),
        "typical_factor": float(np.exp(np.median(off))),
        "shares_within_factor_2": float(np.mean([0.5 < a / b < 2.0 for a, b in seen])),
    }


if __name__ == "__main__":
    print(tools.table(main()))
