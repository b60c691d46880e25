"""`--accuracy` against the truth: the true error is below the target, and what the chosen run costs is told.

Three scenes; exact solutions where there are any, for the crushing of two specimens a run twice as fine as the finest
chosen. The cost is compared with the cheapest setting of the study (``latin-fmu cost``) that reaches the target.
"""

from __future__ import annotations

import math
import sys
from functools import cache

import pytest

from latin_fmu.accuracy.analysis import price
from latin_fmu.accuracy.runs import measure_solution
from latin_fmu.accuracy.study import Study, study
from latin_fmu.accuracy.target import choose
from latin_fmu.scene.schema import Scene

from .known_answers import shipped

SCENES = {"impact_bar": "wall", "beam_in_traction": "contact", "two_specimen_crushing": "crush"}


@cache
def studied(name: str) -> Study:
    return study(shipped(name), 60.0, lambda _: None)


def aimed_at(scene: Scene, quantity: str) -> Scene:
    return scene.model_copy(update={"accuracy": scene.accuracy.model_copy(update={"quantity": quantity})})


@pytest.mark.slow
@pytest.mark.parametrize("target", [0.05, 0.01, 0.002])
@pytest.mark.parametrize("key", ["impulse", "first_contact"])
@pytest.mark.parametrize("name", SCENES)
def test_the_true_error_is_below_the_target(name: str, key: str, target: float) -> None:
    found = studied(name)
    quantity = f"{SCENES[name]}.{key}"
    choice = choose(aimed_at(found.scene, quantity), target, 60.0, lambda _: None)
    assert choice.solution is not None
    true = measure_solution(found.scene, choice.solution).error(quantity, found.reference.measured)
    best = price(found, quantity, target).row
    cost = math.nan if best is None or best.run is None else choice.cpu / best.run.cpu
    sys.stdout.write(
        f"{quantity} to {100 * target:g} %: {'reached' if choice.reached else 'refused'}, true {100 * true:.3f} %, "
        f"estimated {100 * choice.error:.3f} %, {choice.cpu:.2f} CPU s ({choice.seconds:.2f} with the search), "
        f"{cost:.1f} times the cheapest of the study\n"
    )
    if not choice.reached:
        assert quantity == "crush.first_contact", (
            choice.sentence
        )  # a force that grows from nothing on a coarse mesh
        assert "cannot be promised" in choice.sentence
        return
    own = found.reference.own_error
    assert true <= target + (0.0 if own is None else own[quantity].error)
