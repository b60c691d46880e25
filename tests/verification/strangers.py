"""Random chains of bars with exact answers: one half sets constants of the error estimate, the other judges them.

    python -m tests.verification.strangers --seeds 0:60

prints, for every quantity, in how many cases the estimated error is at least the true one. A chain has 2 to 5 unlike
bars, contacts with and without gaps, bonds, a thrown body or a load (step, pulse, half sine, triangle), a free or a
fixed end; its seed alone decides. Exact: ``oracles.bars``. Seeds are of one half or the other: the even ones may set
constants, the odd ones judge them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.accuracy.estimate import estimate_error
from latin_fmu.accuracy.runs import Quantities, measure_solution
from latin_fmu.results.quantities_of_interest import FLOOR
from latin_fmu.stability.scenes import Box, Material, column

from .known_answers import Known, exact_of
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
    data["sensor"] = {"foot": {"substructure": "bar0", "point": [0.0, 0.0, 0.0]}}
    joints = [Contact(gap) if opens else Joint() for opens, gap in zip(contacts, gaps, strict=True)]
    ends = PrescribedStress(_stress(law, duration, end)), PrescribedStress(PiecewiseLinear.constant(0.0, 0.0, end))
    rows: list[Connection] = [ends[0], *joints, Joint() if fixed else ends[1]]
    waves = Waves(bars, rows, end)
    return Known(f"chain_{seed}", latin_fmu.scene_from_dict(data), _exact(waves, contacts, gaps, end))


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
        own = exact_of(f"face{i}", solved, 0.04, end, {"foot": (0, 1)})
        for mine, theirs in (
            (getattr(exact, of), getattr(own, of)) for of in ("values", "scales", "forces", "vectors")
        ):
            mine.update(theirs)
    return exact


# -- the estimate against the truth -------------------------------------------------------------------------------
@dataclass(frozen=True)
class Case:
    """A quantity of a chain: true and estimated relative error, and whether the estimate is told to be a bound only."""

    chain: str
    quantity: str
    true: float
    told: float
    bound: bool


def judged(seeds: Iterable[int]) -> Iterator[Case]:
    """Cases of the chains of seeds, whose runs converge and touch."""
    for seed in seeds:
        problem = chain(seed)
        solution = latin_fmu.solve(problem.scene)
        if not problem.exact.values or not solution.converged:
            sys.stderr.write(f"{problem.name}: {solution.status if problem.exact.values else 'nothing touches'}\n")
            continue
        estimate, measured = estimate_error(problem.scene, solution), measure_solution(problem.scene, solution)
        known = {own.quantity for own in estimate.quantities}
        for quantity in problem.quantities:
            if quantity not in known or quantity not in measured.values:
                continue
            told = estimate[quantity]
            true = max(measured.error(quantity, problem.exact), FLOOR)
            yield Case(problem.name, quantity, true, max(told.error, FLOOR), told.bound_only)


def table(cases: list[Case]) -> str:
    """Coverage by quantity, told over true, the worst true over told, and how often only a bound is told."""
    lines = ["quantity             n   told >= true   told/true 50 %, 90 %   worst true/told   only a bound"]
    by_key = {case.quantity.rpartition(".")[2]: None for case in cases}
    for key in [*by_key, "all"]:
        some = [c for c in cases if key in ("all", c.quantity.rpartition(".")[2])]
        ratio = np.array([c.told / c.true for c in some])
        median, most = np.quantile(ratio, [0.5, 0.9])
        lines.append(
            f"{key:16s} {len(some):5d} {100 * np.mean(ratio >= 1.0):12.0f} % {median:12.2f} {most:9.2f} "
            f"{1.0 / ratio.min():17.2f} {100 * np.mean([c.bound for c in some]):13.0f} %"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table of a range of seeds."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seeds", default="0:40", help="FIRST:END")
    parser.add_argument("--half", choices=("even", "odd", "all"), default="all", help="even: may set constants")
    parser.add_argument("--worst", type=int, default=0, help="how many of the worst cases are listed")
    given = parser.parse_args()
    first, end = map(int, given.seeds.split(":"))
    halves = {"even": (0,), "odd": (1,), "all": (0, 1)}[given.half]
    cases = list(judged(seed for seed in range(first, end) if seed % 2 in halves))
    print(table(cases))  # noqa: T201
    for case in sorted(cases, key=lambda c: c.told / c.true)[: given.worst]:
        print(f"{case.chain} {case.quantity}: true {100 * case.true:.2f} %, told {100 * case.told:.2f} %")  # noqa: T201


if __name__ == "__main__":
    main()
