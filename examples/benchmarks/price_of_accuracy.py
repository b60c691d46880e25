"""What a wanted accuracy costs against the best that could have been known: ``--accuracy`` beside the study.

For four models, impulse and contact instant, 5, 1 and 0.2 %: CPU time of the whole search (its coarse runs, the final
one, all estimates), true and estimated error; beside it the cheapest setting that the study (``latin-fmu cost``) finds
with the truth in hand, of the scene's own scheme and of any scheme and propagator. Both without output (fields,
energies), measured in turns, medians.
Four minutes; one model and 5 % with --quick.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from harness import tools

import latin_fmu
from latin_fmu.accuracy.adaptive_resolution import Choice, choose
from latin_fmu.accuracy.runs import run_at
from latin_fmu.accuracy.study import Row, Study, cheapest, main_variant, study, variants_of
from latin_fmu.run_quantities import measure_solution
from latin_fmu.scene.schema import Scene

QUANTITIES = {
    "impact_bar": ("wall.impulse", "wall.first_contact"),
    "beam_in_traction": ("contact.impulse", "contact.first_contact"),
    "bouncing_bar": ("wall.impulse", "wall.first_contact"),
    "two_specimen_crushing": ("crush.impulse", "crush.separation"),  # the specimens touch from the start
}
TARGETS = (0.05, 0.01, 0.002)
BARE = ("output.fields=false", "output.stress=false", "output.energy=false")
ROUNDS, SHORT = 3, 2.0
Result = TypeVar("Result")
LIMIT = 120.0


@dataclass(frozen=True)
class Case:
    """One model, quantity and target.

    ``seconds`` of the search; ``own``, ``best``: of the cheapest settings of the scene's own scheme and of any, and
    their names; NaN where the study has none.
    """

    model: str
    quantity: str
    target: float
    choice: Choice
    true: float
    seconds: float
    own: float
    best: float
    best_name: str


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Study, search, compare, and return the checked numbers."""
    arguments = tools.options(argv, __doc__)
    models, targets, budget = (("impact_bar",), TARGETS[:1], 8.0) if arguments.quick else (QUANTITIES, TARGETS, 60.0)
    head = f"{'':34}{'target':>8}{'true':>9}{'estimate':>9}{'CPU s':>9}"
    print(f"{head}{'own scheme':>12}{'ratio':>7}{'any':>9}{'ratio':>7}")
    cases = []
    for model in models:
        scene = latin_fmu.load_scene(tools.MODELS / model / "scene.toml", BARE)
        found = study(scene, budget, lambda _: None, methods=True)
        for quantity in QUANTITIES[model]:
            for target in targets:
                cases.append(compared(model, found, quantity, target))
                print(line(cases[-1]), flush=True)
    return numbers(cases)


def compared(model: str, found: Study, quantity: str, target: float) -> Case:
    """One search beside the cheapest settings of the study, measured in turns."""
    accuracy = found.scene.accuracy.model_copy(update={"quantity": quantity})
    scene = found.scene.model_copy(update={"accuracy": accuracy})
    rows = [cheapest(found, quantity, target, name) for name in (found.main, None)]
    choice, first = timed(lambda: choose(scene, target, LIMIT, lambda _: None))
    rounds = ROUNDS if first < SHORT else 1
    seconds: list[list[float]] = [[], [], []]
    for _ in range(rounds):
        seconds[0].append(timed(lambda: choose(scene, target, LIMIT, lambda _: None))[1] if rounds > 1 else first)
        for i, row in enumerate(rows, 1):
            seconds[i].append(math.nan if row is None else timed(lambda row=row: again(scene, row))[1])
    assert choice.solution is not None
    true = measure_solution(scene, choice.solution).error(quantity, found.reference.quantities)
    medians = (float(np.median(column)) for column in seconds)
    name = "-" if rows[1] is None else f"{rows[1].variant}, mesh x {rows[1].resolution.mesh:.2g}"
    return Case(model, quantity, target, choice, true, *medians, name)


def again(scene: Scene, row: Row) -> None:
    """A run of the study once more."""
    variants = (main_variant(scene), *variants_of(scene))
    run_at(next(v.scene for v in variants if v.name == row.variant and v.scene is not None), row.resolution)


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """A result and the CPU time it took."""
    start = clock.process_time()
    result = work()
    return result, clock.process_time() - start


def line(case: Case) -> str:
    """One row of the tools.table."""
    estimated = f"{100 * case.choice.error:.2g} %" if case.choice.reached else "refused"
    text = f"{case.model + ' ' + case.quantity.split('.')[1]:34}{f'{100 * case.target:g} %':>8}"
    text += f"{f'{100 * case.true:.2g} %':>9}{estimated:>9}{case.seconds:9.3g}{case.own:12.3g}"
    text += f"{case.seconds / case.own:7.1f}{case.best:9.3g}{case.seconds / case.best:7.1f}"
    return f"{text}  {case.best_name}"


def numbers(cases: Sequence[Case]) -> dict[str, float]:
    """Counts and medians."""
    reached = [c for c in cases if c.choice.reached]
    own = [c.seconds / c.own for c in reached if not math.isnan(c.own)]
    best = [c.seconds / c.best for c in reached if not math.isnan(c.best)]
    return {
        "cases": len(cases),
        "reached": len(reached),
        "true_error_below_target": sum(c.true <= c.target for c in reached),
        "median_ratio_own_scheme": float(np.median(own)),
        "median_ratio_any_scheme": float(np.median(best)),
        "within_3_of_own_scheme": sum(r <= 3.0 for r in own) / len(own),
        "within_3_of_any_scheme": sum(r <= 3.0 for r in best) / len(best),
        "not_reached_by_the_study": sum(math.isnan(c.best) for c in reached),
    }


if __name__ == "__main__":
    print(tools.table(main()))
