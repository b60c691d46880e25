"""Substructures that are not asked again: the same answers, fewer of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.build import build
from latin_fmu.latin import windows
from latin_fmu.latin.global_stage import GlobalStage
from latin_fmu.latin.settings import Settings
from latin_fmu.latin.solver import Direction
from latin_fmu.latin.unchanged import Answers, negligible

Tables = dict[str, Any]


def stack(n: int = 8, **solver: Any) -> Tables:
    """Blocks of two materials in a row, pressed and rubbed at one end: some interfaces converge before others."""
    names = [f"b{i}" for i in range(n)]
    contact = {"behaviour": "contact", "friction_coefficient": 0.3}
    return {
        "name": "stack",
        "material": {
            "soft": {"young_modulus": 70e9, "poisson_ratio": 0.3, "density": 2700.0},
            "hard": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0},
        },
        "substructure": {
            name: {
                "material": ("soft", "hard")[i % 2],
                "box": {"origin": [0, 0, 0.01 * i], "size": [0.01, 0.01, 0.01], "elements": [2, 2, 3]},
            }
            for i, name in enumerate(names)
        },
        "interface": {
            f"i{i}": {"sides": [f"b{i}.zmax", f"b{i + 1}.zmin"], **contact} for i in range(n - 1)
        },
        "load": {
            "press": {"face": "b0.zmin", "traction": [5e7, 0.0, 2e8], "law": {"type": "half_sine", "duration": 4e-6}}
        },
        "time": {"end": 12e-6, "instants": 60},
        "solver": solver,
    }  # fmt: skip


def outcome(**solver: Any) -> Any:
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(stack(**solver)))
    assert solution.converged, solution.status
    return solution.outcome


def forces(found: Any) -> np.ndarray:
    return np.concatenate([history.traction.ravel() for history in found.interfaces.values()])


@pytest.mark.parametrize("compiled", [True, False])
def test_one_instant_at_a_time(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer solves, and an answer that has moved by far less than tolerance."""
    if not compiled:
        monkeypatch.setattr(windows, "marches", lambda _: False)
    every, few = outcome(skip_unchanged=False), outcome(skip_unchanged=True)
    assert few.passes < 0.95 * every.passes
    assert np.linalg.norm(forces(few) - forces(every)) < 1e-4 * np.linalg.norm(forces(every))


def test_whole_window() -> None:
    """Both stop at a tolerance of 1e-3."""
    every, few = (outcome(window="whole", start="zero", skip_unchanged=skip) for skip in (False, True))
    assert few.passes < 0.95 * every.passes
    assert np.linalg.norm(forces(few) - forces(every)) < 2e-3 * np.linalg.norm(forces(every))


@pytest.mark.parametrize("n", [1, 12])
def test_an_answer_to_what_has_not_changed_is_the_answer(n: int) -> None:
    """Against a stage that asks every substructure each time: the same to the last bit; what was marched is counted."""
    scene = latin_fmu.scene_from_dict(stack(3, window=12, skip_at_rest="off"))
    stages = []
    for keeps in (False, True):
        assembly = build(scene).assembly
        direction = Direction(assembly, Settings(window=12), n)
        direction.bind()
        weights = direction.indicator.weights[0]
        answers = Answers(n, weights, 0.0, len(assembly.propagators)) if keeps else None
        stages.append(GlobalStage(assembly, direction.k, n, None, answers))
    always, once = stages
    solved = "condensed" if n == 1 else "marched"
    rng, q = np.random.default_rng(3), np.zeros((n, len(always.k)))
    for first, block in ((0, 0), (n - 1, 1), (n, 0), (n // 2, 2), (n // 3, 0)):
        before = getattr(always, solved), getattr(once, solved)
        channels = always.assembly.channels[block].ravel()
        q[first:, channels] += 1e6 * rng.normal(size=(n - first, len(channels)))
        np.testing.assert_array_equal(always(q), once(q))
        asked = getattr(once, solved) - before[1]
        assert getattr(always, solved) - before[0] == 3 * n
        if before[1] == 0:
            assert asked == 3 * n
        elif first == n:
            assert asked == 0
        else:
            assert n - first <= asked <= n - first + 3  # a state was kept close before


def test_what_counts_as_unchanged() -> None:
    weights, channels = np.array([1.0, 4.0]), np.array([[0], [1]])
    answers = Answers(5, weights, 1e-4, 2)
    q = np.ones((5, 2))
    assert answers.first_changed(0, channels, q) == 0  # nothing known yet
    answers.keep(0, channels, 0, q, 2 * q)
    answers.begin(8.0)  # 1e-4 x 8 x 5 instants / 2 classes = 2e-3
    moved = q.copy()
    moved[1, 0] += 0.03  # 0.9e-3
    assert answers.first_changed(0, channels, moved) == 5
    moved[3, 1] += 0.02  # + 1.6e-3
    assert answers.first_changed(0, channels, moved) == 3
    answers.forget()
    assert answers.first_changed(0, channels, q) == 0


def test_settings() -> None:
    assert negligible(Settings(tolerance=1e-3, force_tolerance=1e-2)) == pytest.approx(1e-10)
    assert negligible(Settings(tolerance=1e-3, force_tolerance=1e-4)) == pytest.approx(1e-14)
    assert negligible(Settings(skip_unchanged=False)) < 0.0
    assert negligible(Settings(quasi_static=True)) < 0.0
