"""Predicted against measured CPU time: shipped models, benchmark problems, and effects switched on and off.

What ``latin-fmu explain`` predicts is counts of operations times seconds per operation. Here every scene is solved, and
prediction and measurement (set-up and march, median of several rounds, one thread) stand side by side; for effects, the
share of the march that explain tells against what the march takes longer with the effect than without.

  --fit    fits the seconds per operation to these runs and prints them as they stand in
           latin_fmu/propagator/seconds.py: to be done on another machine, or after the kernels have changed

Writes cost_model.png: predicted over measured seconds, and shares.
"""

from __future__ import annotations

import gc
import time as clock
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

import numpy as np
from benchmark_fit import Measured, fitted, predicted
from benchmark_scenes import Pair, benchmarks, models, pairs, scene
from example_tools import BLUE, ORANGE, save, table, tidy
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.api import run
from latin_fmu.assembly.build import discretise
from latin_fmu.assembly.run_sizes import run_sizes
from latin_fmu.effects.explanation import explain

FACTOR = 1.5  # aimed at for totals
SMALL = 0.05  # shares below are noise


def measured(scenes: Mapping[str, latin_fmu.Scene], rounds: int) -> dict[str, Measured]:
    """Every scene solved in turn, after one round that does not count."""
    times: dict[str, list[tuple[float, float, float]]] = {name: [] for name in scenes}
    told: dict[str, tuple[float, float]] = {}
    with threadpool_limits(1):
        for _ in range(rounds + 1):
            for name, one in scenes.items():
                gc.collect()
                at = [clock.process_time()]
                ready = discretise(one)
                at.append(clock.process_time())
                built = ready.build()
                at.append(clock.process_time())
                found = run(built)
                at.append(clock.process_time())
                times[name].append((at[1] - at[0], at[2] - at[1], at[3] - at[2]))
                told[name] = float(np.mean([w.iterations for w in found.windows])), found.marched
    return {
        name: Measured(
            run_sizes(discretise(one)), *(median(part) for part in zip(*times[name][1:], strict=True)), *told[name]
        )
        for name, one in scenes.items()
    }


def shares(pair: Pair, runs: Mapping[str, Measured]) -> tuple[float, float]:
    """Share of the march that explain tells for an effect, and the one measured."""
    told = explain(scene(pair.on))
    cost = sum(e.cost for e in told.effects if e.name in pair.effects)
    on, off = runs[f"{pair.name}: on"], runs[f"{pair.name}: off"]
    return cost / told.prediction["cpu_seconds_instant"], 1.0 - off.march / on.march


def options(argv: Sequence[str] | None) -> Namespace:
    """The command line."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few small scenes, once")
    parser.add_argument("--fit", action="store_true", help="fit the seconds per operation, and print them")
    parser.add_argument("-o", "--folder", type=Path, default=Path("figures"), help="where the figure goes")
    said = parser.parse_args(argv)
    said.folder.mkdir(parents=True, exist_ok=True)
    return said


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure, compare, draw; returns the checked numbers."""
    said = options(argv)
    rounds, elements, instants = (1, 3, 60) if said.quick else (3, 6, 200)

    # scene: models, benchmarks, effects
    found = {n: s for n, s in models().items() if not said.quick or s.time.n_step < 100}
    found |= benchmarks(said.quick)
    switched = pairs(elements, instants)
    for pair in switched:
        found |= {f"{pair.name}: on": scene(pair.on), f"{pair.name}: off": scene(pair.off)}
    more = [] if said.quick else pairs(4, instants)
    for pair in more:
        found |= {f"{pair.name}, coarse: on": scene(pair.on)}

    # solve
    runs = measured(found, rounds)
    per = fitted(list(runs.values())) if said.fit else None

    # check
    print(f"{'':50}{'set-up ms':>18}{'march ms':>18}{'total':>8}{'iterations':>14}")
    print(f"{'':50}{'told  measured':>18}{'told  measured':>18}{'ratio':>8}{'told   met':>14}")
    ratios = {}
    for name, one in runs.items():
        told = predicted(one.sizes, per)
        ratios[name] = sum(told) / one.total
        seconds = told[0], one.preparation + one.operators, told[1], one.march
        print(
            f"{name:50}"
            + "".join(f"{1e3 * value:9.1f}" for value in seconds)
            + f"{ratios[name]:8.2f}{one.sizes.iterations:8.1f}{one.iterations:6.1f}"
        )
    print(f"\n{'share of the march':50}{'told':>8}{'measured':>10}")
    by_effect = {pair.name: shares(pair, runs) for pair in switched}
    for name, (told_share, met) in by_effect.items():
        print(f"{name:50}{told_share:8.3f}{met:10.3f}")
    if per is not None:
        print("\n" + "\n".join(f'        "{name}": {value:.3g},' for name, value in per.items()))

    # save
    save(figure(runs, ratios, by_effect), said.folder, "cost_model")
    off = np.abs(np.log(list(ratios.values())))
    seen = [(told_share, met) for told_share, met in by_effect.values() if met > SMALL]
    return {
        "scenes": float(len(ratios)),
        "within_factor_1.5": float((off < np.log(FACTOR)).mean()),
        "worst_factor": float(np.exp(off.max())),
        "typical_factor": float(np.exp(np.median(off))),
        "shares_within_factor_2": float(np.mean([0.5 < a / b < 2.0 for a, b in seen])),
    }


def figure(
    runs: Mapping[str, Measured], ratios: Mapping[str, float], by_effect: Mapping[str, tuple[float, float]]
) -> Figure:
    """Predicted over measured totals, and shares of effects."""
    drawn = Figure(figsize=(11.0, 4.6), layout="constrained")
    left, right = drawn.subplots(1, 2)
    seconds = np.array([runs[name].total for name in ratios])
    left.axhspan(1 / FACTOR, FACTOR, color="0.93", linewidth=0)
    left.axhline(1.0, color="0.4", linewidth=1.0)
    left.semilogx(seconds, list(ratios.values()), "o", color=BLUE, markersize=4.5, alpha=0.8)
    left.set_yscale("log")
    left.set_ylim(0.4, 2.5)
    left.set_yticks([0.5, 0.67, 1.0, 1.5, 2.0], ["1/2", "1/1.5", "1", "1.5", "2"])
    left.minorticks_off()
    left.set(xlabel="measured CPU time (s)", ylabel="predicted over measured", title="Total of a run")
    names = list(by_effect)
    places = np.arange(len(names))[::-1]
    for shift, column, colour, label in ((0.2, 0, ORANGE, "explain"), (-0.2, 1, BLUE, "measured, on - off")):
        right.barh(places + shift, [100 * by_effect[n][column] for n in names], 0.38, color=colour, label=label)
    right.set_yticks(places, names)
    right.set(xlabel="share of the march (%)", title="What an effect takes")
    right.legend(frameon=False, loc="upper right")
    for axis in (left, right):
        tidy(axis)
    return drawn


if __name__ == "__main__":
    print(table(main()))
