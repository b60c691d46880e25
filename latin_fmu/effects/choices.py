"""What the solver takes for this scene where several ways lead to the same answer, and what the run will cost."""

from __future__ import annotations

from typing import Any

from ..assembly.propagator_choice import chosen_propagators
from ..scene.solver_settings import WHOLE, Anderson
from .effect import Effect
from .sizes import Sizes


def choices(sizes: Sizes) -> dict[str, str]:
    """Window, search direction, acceleration, propagator, in words."""
    solver = sizes.scene.solver
    window = (
        f"one window over all {sizes.n_instant} instants"
        if solver.window == WHOLE
        else "windows of one instant"
        if solver.window == 1
        else f"windows of {solver.window} instants"
    )
    direction = solver.search_direction
    kind: str = direction.type
    if kind == "automatic":
        kind = "automatic: 1 / D_ii of one instant" if solver.window == 1 else "automatic: rho c, or half the row value"
    acceleration = solver.acceleration
    accelerated = (
        f"anderson, depth {acceleration.depth}" if isinstance(acceleration, Anderson) else "none (plain iteration)"
    )
    if not sizes.discretised.units:
        window, kind, accelerated = "no interface: one linear march", "none", "none"
    elif sizes.solved_at_once:
        window, kind, accelerated = "every instant at once: perfect interfaces only", "none", "none"
    marched = chosen_propagators(sizes.scene, sizes.discretised.classes)[0]
    return {
        "window": window,
        "search direction": kind + (f", times {direction.factor:g}" if direction.factor != 1 else ""),
        "acceleration": accelerated,
        "propagator": f"{marched.kind}, scheme {sizes.scene.time.scheme.type}",
    }


def prediction(sizes: Sizes, effects: list[Effect]) -> dict[str, Any]:
    """Predicted cost of the run: CPU seconds of set-up and instants (``assembly.run_cost``), and memory."""
    memory = sizes.factor_bytes + sum(e.memory for e in effects if e.on and e.name not in ("elastic bodies",))
    return {
        "cpu_seconds_set_up": round(sizes.cost.set_up, 4),
        "cpu_seconds_instants": round(sizes.cost.march, 4),
        "cpu_seconds_instant": sizes.instant,
        "memory_bytes": int(memory),
        "unknowns": sizes.n_dof,
        "interface_unknowns": sizes.n_flat,
        "instants": sizes.n_instant,
        "iterations_per_instant": sizes.iterations,
    }
