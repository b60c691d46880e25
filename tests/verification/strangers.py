"""Random chains of bars with exact answers: one half sets constants of the error estimate, the other judges them.

    python -m tests.verification.strangers --seeds 0:60

prints, for every quantity, in how many cases the estimated error is at least the true one; with ``--promises``, how
many targets a search for an accuracy promises, and how many of these it misses. A chain has 2 to 5 unlike bars,
contacts with and without gaps, bonds, a thrown body or a load (step, pulse, half sine, triangle), a free or a fixed
end; its seed alone decides. Exact: ``oracles.bars``. Seeds are of one half or the other: the even ones may set
constants, the odd ones judge them.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.accuracy.adaptive_resolution import choose
from latin_fmu.accuracy.estimate import estimate_error
from latin_fmu.run_quantities import Quantities, measure_solution
from latin_fmu.scene.quantity_table import FLOOR
from latin_fmu.stability.scenes import Box, Material, column

from .known_answers import Known, add_exact_sensor, exact_of
from .oracles.bars import Bar, Waves
from .oracles.cases import Solved
from .oracles.connections import Connection, Contact, Joint, PrescribedStress
from .oracles.piecewise import PiecewiseLinear

_PRESSURE, _SPEED = 0.1, 0.1
_LAWS = ("step", "pulse", "half_sine", "triangle")


def chain(seed: int) -> Known:
    """The chain of a seed; exact: the quantities of its contacts that are ever loaded, and of its first end."""
    rng = np.random.default_rng([417, seed])
    n = int(rng.integers(2, 6))
    bars = [Bar(rng.uniform(0.5, 2.0), np.exp(rng.uniform(0.0, 3.0)), np.exp(rng.uniform(-0.7, 1.4))) for _ in range(n)]
    contacts = [bool(rng.random() < 0.7) for _ in range(n - 1)]
    contacts[int(rng.integers(0, n - 1))] = True
    law = str(rng.choice(_LAWS)) if rng.random() < 0.5 else ""
    if not law:  # what is bonded to the first bar flies with it
        flying = next(i for i, opens in enumerate([*contacts, True]) if opens)
        bars = [Bar(b.length, b.modulus, b.density, _SPEED * (i <= flying)) for i, b in enumerate(bars)]
    slowest = max(bar.transit for bar in bars)
    moves = _SPEED if not law else 2.0 * _PRESSURE / bars[0].impedance
    gaps = [moves * slowest * rng.uniform(0.05, 0.6) * (opens and rng.random() < 0.5) for opens in contacts]
    end = float(sum(bar.transit for bar in bars) * rng.uniform(1.2, 2.2))
    fixed = bool(rng.random() < 0.4)
    element = min(bar.transit for bar in bars) / rng.uniform(8.0, 20.0)
    numbers = [max(round(bar.transit / (element * rng.uniform(0.7, 1.4))), 4) for bar in bars]
    step = rng.uniform(0.4, 1.2) * min(bar.transit / m for bar, m in zip(bars, numbers, strict=True))
    duration = slowest * rng.uniform(0.4, 2.0)

    data = _scene(f"chain_{seed}", bars, numbers, contacts, gaps, {"end": end, "instants": int(np.ceil(end / step))})
    data["load"] = {"push": {"face": "bar0.zmin", "pressure": _PRESSURE, "law": _table(law, duration)}} if law else {}
    last = f"bar{n - 1}.zmax"
    data["boundary"] = {"wall": {"type": "fixed", "face": last, "components": ["z"]}} if fixed else {}
    top = sum(bar.length for bar in bars) + sum(gaps)
    data["sensor"] = {
        "foot": {"substructure": "bar0", "point": [0.0, 0.0, 0.0], "spectrum": {}},
        "tip": {"substructure": f"bar{n - 1}", "point": [0.0, 0.0, top - bars[-1].length * fixed], "spectrum": {}},
    }
    joints = [Contact(gap) if opens else Joint() for opens, gap in zip(contacts, gaps, strict=True)]
    ends = PrescribedStress(_stress(law, duration, end)), PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, end))
    rows: list[Connection] = [ends[0], *joints, Joint() if fixed else ends[1]]
    waves, scene = Waves(bars, rows, end), latin_fmu.scene_from_dict(data)
    exact = _exact(waves, contacts, gaps, end)
    if exact.values:
        for sensor, place in (("foot", (0, 1)), ("tip", (n - 1, 1) if fixed else (n, 0))):
            add_exact_sensor(exact, sensor, waves, place, scene)
    return Known(scene.name, scene, exact)


def _scene(name: str, bars: list[Bar], numbers: list[int], contacts: list[bool], gaps: list[float], time: Any) -> Any:
    """The bars on top of each other, with gaps."""
    side = 0.2
    bodies = {
        f"bar{i}": Box(
            Material(bar.modulus, bar.density, name=f"m{i}"),
            (side, side, bar.length),
            (1, 1, m),
            (0.0, 0.0, bar.velocity),
        )
        for i, (bar, m) in enumerate(zip(bars, numbers, strict=True))
    }
    faces = {
        f"face{i}": ({"gap": gap} if gap else {}) if opens else {"behaviour": "perfect"}
        for i, (opens, gap) in enumerate(zip(contacts, gaps, strict=True))
    }
    data = column(bodies, faces, time, name=name)
    height = 0.0
    for (i, bar), gap in zip(enumerate(bars), [0.0, *gaps], strict=True):
        height += gap
        data["substructure"][f"bar{i}"]["box"]["origin"][2] = height
        height += bar.length
    return data


def _table(law: str, duration: float) -> Any:
    if law == "step":
        return "step"
    if law == "triangle":
        return {"type": "table", "times": [0.0, 0.4 * duration, duration], "values": [0.0, 1.0, 0.0]}
    return {"type": "rectangular_pulse" if law == "pulse" else law, "duration": duration}


def _stress(law: str, duration: float, end: float) -> PiecewiseLinear:
    """Stress at the loaded end; zero where nothing loads it."""
    if not law or law == "step":
        return PiecewiseLinear.constant(-_PRESSURE if law else 0.0, 0.0, end)
    if law == "pulse":
        rest = [(max(end, duration), 0.0, 0.0)] if end > duration else []
        return PiecewiseLinear.from_pieces(0.0, [(duration, -_PRESSURE, -_PRESSURE), *rest])
    times = np.array([0.0, 0.4, 1.0]) if law == "triangle" else np.linspace(0.0, 1.0, 401)
    values = np.array([0.0, 1.0, 0.0]) if law == "triangle" else np.sin(np.pi * times)
    return PiecewiseLinear.through([*duration * times, duration + end], [*-_PRESSURE * values, 0.0])


def _exact(waves: Waves, contacts: list[bool], gaps: list[float], end: float) -> Quantities:
    exact = Quantities()
    for i, opens in enumerate(contacts):
        solved = Solved(waves, i + 1, gaps[i])
        if not opens or not any(max(a, b) > 0.0 for _, _, a, b in solved.pressure.pieces(0.0, end)):
            continue
        own = exact_of(f"face{i}", solved, 0.04, end)
        for mine, theirs in ((getattr(exact, of), getattr(own, of)) for of in ("values", "scales", "forces")):
            mine.update(theirs)
    return exact


# -- the estimate against the truth -------------------------------------------------------------------------------
@dataclass(frozen=True)
class Case:
    """A quantity of a scene: true and estimated relative error, whether the estimate is a bound only, and what the
    estimate of all quantities costs over the run with the spectra of its sensors (CPU time)."""

    scene: str
    quantity: str
    true: float
    told: float
    bound: bool
    cost: float


def judged(seeds: Iterable[int]) -> Iterator[Case]:
    """Cases of the chains of seeds, whose runs converge and touch."""
    for seed in seeds:
        problem = chain(seed)
        solution, cpu = run_with_spectra(problem.scene)
        if not problem.exact.values or not solution.converged:
            sys.stderr.write(f"{problem.name}: {solution.status if problem.exact.values else 'nothing touches'}\n")
            continue
        estimate, measured = estimate_error(problem.scene, solution), measure_solution(problem.scene, solution)
        known = {own.quantity for own in estimate.quantities}
        for quantity in reached_by_waves(problem.exact):
            if quantity not in known or quantity not in measured.values:
                continue
            told = estimate[quantity]
            true = max(measured.error(quantity, problem.exact), FLOOR)
            yield Case(problem.name, quantity, true, max(told.error, FLOOR), told.bound_only, estimate.cpu / cpu)


def run_with_spectra(scene: latin_fmu.Scene) -> tuple[latin_fmu.Solution, float]:
    """Solution of a scene with the spectra that it requests, and the CPU time of both, s."""
    start = time.process_time()
    solution = latin_fmu.solve(scene)
    _ = solution.spectra
    return solution, time.process_time() - start


def table(cases: list[Case], worst: int = 0) -> str:
    """Coverage by quantity, estimated over true, the worst true over estimated, how often it is only a bound, and how
    often the error is unknown (left out of the other columns); the cost of the estimates; the worst cases."""
    lines = [
        "quantity                 n   est. >= true   est./true 50 %, 90 %   worst true/est.   only a bound   unknown"
    ]
    by_key = {case.quantity.rpartition(".")[2]: None for case in cases}
    for key in [*by_key, "all"]:
        every = [c for c in cases if key in ("all", c.quantity.rpartition(".")[2])]
        some = [c for c in every if np.isfinite(c.told)]
        if not some:
            continue
        ratio = np.array([c.told / c.true for c in some])
        median, most = np.quantile(ratio, [0.5, 0.9])
        lines.append(
            f"{key:20s} {len(some):5d} {100 * np.mean(ratio >= 1.0):12.0f} % {median:12.2f} {most:9.2f} "
            f"{1.0 / ratio.min():17.2f} {100 * np.mean([c.bound for c in some]):13.0f} % {len(every) - len(some):9d}"
        )
    costs = list({c.scene: c.cost for c in cases}.values())
    median, most = np.quantile(costs, [0.5, 0.9])
    lines.append(f"cost of an estimate over the run, {len(costs)} scenes: median {median:.2f}, 90 % {most:.2f}")
    lines += [
        f"{case.scene} {case.quantity}: true {100 * case.true:.2f} %, estimated {100 * case.told:.2f} %"
        for case in sorted(cases, key=lambda c: c.told / c.true)[:worst]
    ]
    return "\n".join(lines)


# -- promises of a search for an accuracy ---------------------------------------------------------------------------
TARGETS = {
    "impulse": 0.01,
    "displacement": 0.01,
    "first_contact": 0.05,
    "separation": 0.05,
    "peak_force": 0.05,
    "acceleration_peak": 0.1,
}


@dataclass(frozen=True)
class Promise:
    """A search: whether the target was promised, estimated and true error, and its cost over the run it ends with."""

    scene: str
    key: str
    made: bool
    told: float
    true: float
    cost: float


def promised(seeds: Iterable[int], limit: float) -> Iterator[Promise]:
    """The searches for ``TARGETS`` on the chains of seeds, with at most ``limit`` CPU seconds each."""
    for seed in seeds:
        problem = chain(seed)
        if problem.exact.values:
            yield from searched(problem.scene, problem.exact, reached_by_waves(problem.exact), TARGETS, limit)


def searched(
    scene: latin_fmu.Scene, exact: Quantities, judged: Iterable[str], targets: Mapping[str, float], limit: float
) -> Iterator[Promise]:
    """A search for each of the targets; ``judged`` : quantities whose true errors are known from ``exact``."""
    known = list(judged)
    for key, target in targets.items():
        names = [q for q in known if q.endswith(f".{key}")]
        if not names:
            continue
        accuracy = scene.accuracy.model_copy(update={"quantity": key})
        choice = choose(scene.model_copy(update={"accuracy": accuracy}), target, limit, lambda _: None)
        if choice.solution is None:
            yield Promise(scene.name, key, False, np.inf, np.nan, np.nan)
            continue
        measured = measure_solution(scene, choice.solution)
        true = max((measured.error(q, exact) for q in names if q in measured.values), default=0.0)
        yield Promise(scene.name, key, choice.reached, choice.error, true, choice.seconds / choice.cpu)


def reached_by_waves(exact: Quantities) -> list[str]:
    """Quantities but those of sensors that no wave reaches: next to nothing beside the same of others."""
    largest: dict[str, float] = {}
    for quantity, scale in exact.scales.items():
        key = quantity.rpartition(".")[2]
        largest[key] = max(scale, largest.get(key, 0.0))
    return [q for q, scale in exact.scales.items() if scale > 1e-6 * largest[q.rpartition(".")[2]]]


def promises_table(promises: list[Promise], targets: Mapping[str, float]) -> str:
    """Promises made, false ones and the worst of them, cost of the search over the run it ends with, by quantity."""
    lines = ["quantity             target   searches   promised   false   worst true/target   cost 50 %, 90 %"]
    for key, target in targets.items():
        some = [p for p in promises if p.key == key]
        made = [p for p in some if p.made]
        if not made:
            continue
        false, worst = sum(p.true > target for p in made), max(p.true for p in made) / target
        median, most = np.quantile([p.cost for p in made], [0.5, 0.9])
        lines.append(
            f"{key:20s} {100 * target:4.0f} % {len(some):10d} {len(made):10d} {false:7d} {worst:19.2f} "
            f"{median:9.1f} {most:6.1f}"
        )
    made = [p for p in promises if p.made]
    lines.append(f"{len(made)} of {len(promises)} promised, {sum(p.true > targets[p.key] for p in made)} false")
    lines += [
        f"{p.scene} {p.key}: target {100 * targets[p.key]:g} %, true {100 * p.true:.2f} %, est. {100 * p.told:.2f} %"
        for p in made
        if p.true > targets[p.key]
    ]
    return "\n".join(lines)


def chosen_seeds(parser: argparse.ArgumentParser, usual: str) -> tuple[argparse.Namespace, list[int]]:
    """The options of the command line, and the seeds that they choose."""
    parser.add_argument("--seeds", default=usual, help="FIRST:END")
    parser.add_argument("--half", choices=("even", "odd", "all"), default="all", help="even: may set constants")
    parser.add_argument("--promises", action="store_true", help="searches for an accuracy in the place of estimates")
    parser.add_argument("--limit", type=float, default=20.0, help="CPU seconds of one search")
    parser.add_argument("--worst", type=int, default=0, help="how many of the worst cases are listed")
    given = parser.parse_args()
    first, end = map(int, given.seeds.split(":"))
    halves = {"even": (0,), "odd": (1,), "all": (0, 1)}[given.half]
    return given, [seed for seed in range(first, end) if seed % 2 in halves]


def main() -> None:
    """Print the table of a range of seeds."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    given, seeds = chosen_seeds(parser, "0:40")
    if given.promises:
        print(promises_table(list(promised(seeds, given.limit)), TARGETS))  # noqa: T201
    else:
        print(table(list(judged(seeds)), given.worst))  # noqa: T201


if __name__ == "__main__":
    main()
