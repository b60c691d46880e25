"""Time schemes compared on impact: accuracy, noise, energy and cost on one mesh and step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from .case import Bench
from .duration import bouncing, kept
from .measures import impulse, pressure_force
from .scenes import thrown

SCHEMES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "hht, alpha -0.1 (default)": {"type": "hht", "alpha": -0.1},
        "hht, alpha -0.3": {"type": "hht", "alpha": -0.3},
        "massless_contact": {"type": "massless_contact"},
        "newmark, undamped": {"type": "newmark", "beta": 0.25, "gamma": 0.5},
        "newmark, gamma 0.6": {"type": "newmark", "beta": 0.3025, "gamma": 0.6},
        "newmark, gamma 0.7": {"type": "newmark", "beta": 0.36, "gamma": 0.7},
    }
)
_SPEED, _FORCE, _IMPULSE, _ENERGY = 10.0, 300.0, 200.0, 500.0


@dataclass(frozen=True)
class SchemeRow:
    """One scheme: relative error of the impulse, peak and total variation of the force over the exact ones, shares
    of energy kept, penetration over step x speed, mean iterations per window."""

    name: str
    impulse_error: float
    peak: float
    variation: float
    kept_after_throw: float
    penetration: float
    bounces: int
    kept_after_bounces: float
    iterations: float


def compare_schemes(elements: int = 50, bounces: int = 3) -> list[SchemeRow]:
    """Rows of all schemes; the step is 0.6 of the transit of an element."""
    return [_row(name, dict(scheme), elements, bounces) for name, scheme in SCHEMES.items()]


def _row(name: str, scheme: dict[str, Any], elements: int, bounces: int) -> SchemeRow:
    bench = Bench()
    scene = thrown(elements, round(2.0 / (0.6 / 3 / elements)), 2.0, 5.0, -_SPEED, 0.0)
    scene["time"]["scheme"] = scheme
    solution = bench.solve(scene)
    force = pressure_force(solution, "wall")
    energy = solution.energy
    assert energy is not None
    stored = energy["kinetic"] + energy["elastic"]
    dropped = bench.solve(bouncing(bounces, elements, scheme))
    return SchemeRow(
        name=name,
        impulse_error=impulse(solution, "wall") / _IMPULSE - 1,
        peak=float(force.max()) / _FORCE,
        variation=float(np.abs(np.diff(force)).sum()) / (2 * _FORCE),
        kept_after_throw=float(stored[-1] / stored[0]),
        penetration=solution.outcome.penetration() / (float(solution.time[1]) * _SPEED),
        bounces=bounces,
        kept_after_bounces=kept(dropped),
        iterations=sum(bench.iterations) / len(bench.iterations),
    )
