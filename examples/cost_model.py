"""Predicted against measured CPU time: shipped models, benchmark problems, and effects switched on and off.

``latin-fmu explain`` predicts counts of operations times seconds per operation. Here every scene is solved, and
prediction and measurement (operators and march, median of several rounds, one thread) stand side by side; for effects,
the predicted share of the march beside the share that the march takes longer with the effect than without.

  --fit    fits the seconds per operation to these runs and prints them for latin_fmu/effects/cost.py: to be done on
           another machine, or after the kernels have changed

Writes cost_model.png: predicted over measured seconds, and shares.
"""

from __future__ import annotations

import gc
import time as clock
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np
from benchmark_scenes import Pair, benchmarks, models, pairs, scene
from example_tools import BLUE, ORANGE, save, table, tidy
from matplotlib.figure import Figure
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.api import run
from latin_fmu.assembly.build import discretise, solver_ready
from latin_fmu.effects.cost import OPERATIONS, Prediction, RunSize, march_counts, operator_counts
from latin_fmu.effects.explanation import explain

FACTOR = 2.0  # aimed at for totals
SMALL = 0.05  # shares below are noise


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
                built = solver_ready(ready, {})
                middle = clock.process_time()
                outcome = run(built)
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
    explained = explain(scene(pair.on))
    cost = sum(e.cost for e in explained.effects if e.name in pair.effects)
    on, off = runs[f"{pair.name}: on"], runs[f"{pair.name}: off"]
    return cost / explained.prediction["cpu_seconds_instant"], 1.0 - off.march / on.march


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure, compare, draw; returns the checked numbers."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few small scenes, once")
    parser.add_argument("--fit", action="store_true", help="fit the seconds per operation, and print them")
    parser.add_argument("-o", "--folder", type=Path, default=Path("figures"), help="where the figure goes")
    options = parser.parse_args(argv)
    options.folder.mkdir(parents=True, exist_ok=True)
    quick: bool = options.quick

    # scenes: models, benchmarks, effects
    scenes = {n: s for n, s in models().items() if not quick or s.time.n_step < 100} | benchmarks(quick)
    switched = pairs(3, 60) if quick else pairs(6, 200)
    for pair in switched:
        scenes |= {f"{pair.name}: on": scene(pair.on), f"{pair.name}: off": scene(pair.off)}

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

    # save
    save(figure(runs, ratios, by_effect), options.folder, "cost_model")
    off = np.abs(np.log(list(ratios.values())))
    seen = [(predicted, met) for predicted, met in by_effect.values() if met > SMALL]
    return {
        "scenes": float(len(ratios)),
        "within_factor_2": float((off < np.log(FACTOR)).mean()),
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
    left.set(xlabel="measured CPU time (s)", ylabel="predicted over measured", title="Operators and march of a run")
    names = list(by_effect)
    places = np.arange(len(names))[::-1]
    for shift, column, colour, label in ((0.2, 0, ORANGE, "explain"), (-0.2, 1, BLUE, "measured, on - off")):
        right.barh(places + shift, [100 * by_effect[n][column] for n in names], 0.38, color=colour, label=label)
    right.set_yticks(places, names)
    right.set(xlabel="share of the march (%)", title="Share of an effect")
    right.legend(frameon=False, loc="upper right")
    for axis in (left, right):
        tidy(axis)
    return drawn


if __name__ == "__main__":
    print(table(main()))
