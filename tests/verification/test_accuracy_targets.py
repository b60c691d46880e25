"""``--accuracy`` against the truth: a guaranteed accuracy is reached, others are refused.

Impulse and contact instant of four models; exact solutions for the bars, for the crushing of two specimens the
reference from finer runs of another scheme, its own error granted. The cost of the search is printed by
``examples/benchmarks/price_of_accuracy.py``.
"""

from __future__ import annotations

import pytest

from latin_fmu.accuracy.adaptive_resolution import Choice, _Search, choose
from latin_fmu.accuracy.runs import Resolution
from latin_fmu.accuracy.study import Reference, declared
from latin_fmu.run_quantities import measure_solution

from .known_answers import shipped

QUANTITIES = [
    ("impact_bar", "wall.impulse"),
    ("impact_bar", "wall.first_contact"),
    ("impact_bar", "wall.separation"),
    ("beam_in_traction", "contact.impulse"),
    ("beam_in_traction", "contact.first_contact"),
    ("bouncing_bar", "wall.impulse"),
    ("bouncing_bar", "wall.first_contact"),
    ("two_specimen_crushing", "crush.impulse"),
    ("two_specimen_crushing", "crush.separation"),
]


def chosen(model: str, quantity: str, target: float, limit: float = 120.0) -> tuple[Choice, float, Reference]:
    """What is chosen, its true error, and the reference for it."""
    scene = shipped(model)
    reference = declared(scene)
    assert reference is not None
    accuracy = scene.accuracy.model_copy(update={"quantity": quantity})
    lean = scene.output.model_copy(update={"fields": False, "stress": False, "energy": False})
    scene = scene.model_copy(update={"accuracy": accuracy, "output": lean})
    choice = choose(scene, target, limit, lambda _: None)
    assert choice.solution is not None
    true = measure_solution(scene, choice.solution).error(quantity, reference.quantities)
    return choice, true, reference


def check(model: str, quantity: str, target: float) -> None:
    """Reached, by the estimate and in truth."""
    choice, true, reference = chosen(model, quantity, target)
    assert choice.reached, choice.sentence
    assert choice.error <= target
    known = 0.0 if reference.own_error is None else reference.own_error[quantity].error
    assert true <= target + known


@pytest.mark.parametrize("target", [0.05, 0.01])
@pytest.mark.parametrize(("model", "quantity"), QUANTITIES)
def test_the_true_error_is_below_the_target(model: str, quantity: str, target: float) -> None:
    check(model, quantity, target)


@pytest.mark.slow
@pytest.mark.parametrize(("model", "quantity"), QUANTITIES)
def test_the_sharpest_target_is_kept_or_refused(model: str, quantity: str) -> None:
    """The contact layer is viscous: an impulse within 0.2 % takes some thousand elements, above the limit."""
    choice, true, reference = chosen(model, quantity, 0.002, limit=20.0)
    known = 0.0 if reference.own_error is None else reference.own_error[quantity].error
    assert true <= 0.002 + known if choice.reached else "cannot be guaranteed" in choice.sentence


def test_what_has_no_order_is_not_promised() -> None:
    """The specimens of the crushing touch from the start: their first contact converges too slowly for 1 %."""
    choice, true, _ = chosen("two_specimen_crushing", "crush.first_contact", 0.01, limit=8.0)
    assert not choice.reached
    assert "cannot be guaranteed" in choice.sentence
    assert choice.error > 0.01
    assert true <= choice.error


def test_a_run_stopped_at_the_limit_is_not_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A finer run takes longer than predicted and is stopped: the answer is the run before it, whole."""
    predicted = _Search._too_large

    def optimistic(search: _Search, at: Resolution) -> str:
        if at.mesh > 2.0:
            search.sequence.limit = search.sequence.seconds + 0.2
            return ""
        return predicted(search, at)

    monkeypatch.setattr(_Search, "_too_large", optimistic)
    choice, true, _ = chosen("two_specimen_crushing", "crush.first_contact", 0.01)
    assert not choice.reached
    assert "stopped by its limit" in choice.sentence
    assert choice.solution is not None
    assert choice.solution.complete
    assert choice.resolution.mesh < 2.0
    assert true <= choice.error
