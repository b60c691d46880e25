"""Differences between the quantities of a run and of coarser ones, as the estimate needs them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..results.estimates import QuantityEstimate
from ..scene.schema import Scene
from .companions import Companions
from .extrapolation import Differences, judge
from .kinds import DISPLACEMENT, FIRST_CONTACT, FORCE_HISTORY, PEAK_FORCE, SEPARATION, kind_of
from .measured import Measured
from .sampling import sampling_error


def judged(
    scene: Scene, run: Measured, coarser: Mapping[str, Measured], companions: Companions
) -> tuple[QuantityEstimate, ...]:
    """Estimates from the quantities of a run and of the coarser ones ``half``, ``quarter``, ``half_mesh``."""
    sampling = sampling_error(scene)
    estimates = []
    for quantity, value in run.values.items():
        kind = kind_of(quantity)
        differences = differences_of(scene, quantity, run, coarser, companions, sampling)
        result = judge(kind, differences)
        mesh = relative(quantity, run, run, coarser["half_mesh"]) if "half_mesh" in coarser else math.nan
        time = differences.half if companions.half_mesh is None else differences.steps
        estimates.append(
            QuantityEstimate(
                quantity, value, kind.unit, result.error, result.order, kind.order, result.bound_only, mesh, time
            )
        )
    return tuple(estimates)


def differences_of(
    scene: Scene, quantity: str, run: Measured, coarser: Mapping[str, Measured], companions: Companions, sampling: float
) -> Differences:
    """What the coarser runs say of one quantity."""
    half, quarter, mesh = coarser["half"], coarser.get("quarter"), coarser.get("half_mesh")
    kind = kind_of(quantity)
    return Differences(
        half=relative(quantity, run, run, half),
        quarter=math.nan if quarter is None else relative(quantity, run, half, quarter),
        steps=math.nan if mesh is None else relative(quantity, run, half, mesh),
        same_way=quarter is None or same_way(quantity, run, half, quarter),
        ratios=companions.ratios,
        ringing=run.ringing[quantity.rpartition(".")[0]] if kind is PEAK_FORCE else 0.0,
        sampling=0.0 if kind in (FIRST_CONTACT, SEPARATION) else sampling,
        iteration=kind.iteration * scene.solver.tolerance,
    )


def relative(quantity: str, run: Measured, a: Measured, b: Measured) -> float:
    """Distance of a quantity between two runs over the scale it has in ``run``; 0 where nothing happens."""
    if quantity not in a.values or quantity not in b.values:
        return math.nan
    scale = run.scales[quantity]
    return a.distance(quantity, b) / scale if scale > 0.0 else 0.0


def same_way(quantity: str, run: Measured, half: Measured, quarter: Measured) -> bool:
    """Whether both refinements change the quantity in the same direction (always, for a norm of differences)."""
    owner = quantity.rpartition(".")[0]
    kind = kind_of(quantity)
    if kind is FORCE_HISTORY or quantity not in half.values or quantity not in quarter.values:
        return True
    if kind is DISPLACEMENT:
        fine, coarse = (m.vectors for m in (run, quarter))
        return float((fine[owner] - half.vectors[owner]) @ (half.vectors[owner] - coarse[owner])) > 0.0
    fine_step = run.values[quantity] - half.values[quantity]
    return fine_step * (half.values[quantity] - quarter.values[quantity]) > 0.0
