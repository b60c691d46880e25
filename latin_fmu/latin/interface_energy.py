"""What interfaces give and take, from their own histories: impact losses, work of a moving ground.

Works over a step use the time scheme's weights of the instants n-1, n, n+1, as the substructures' accounts do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .layout import Array
from .record import InterfaceHistory


def impact_losses(history: InterfaceHistory, weights: tuple[float, float, float], lead: float) -> Array:
    """Energy (n_time,) lost to the normal contact law since the start, J: - sum of pressure x change of gap.

    A closed point that stays closed loses nothing; a closing one loses what the end-of-instant law takes out: the
    kinetic energy of the layer of elements that meets the other side, which goes to zero under refinement. ``lead``:
    how far ahead of the instants the gaps are, s.
    """
    if history.gap is None or history.layer_energy is not None:
        return np.zeros(len(history.traction))
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
    gap = history.gap
    if lead:
        opening = history.velocity[:, 1] - history.velocity[:, 0]
        gap = gap - lead * np.einsum("tpc,pc->tp", opening, history.normals)
    power = -_weighted(pressure, weights) * np.diff(gap, axis=0)
    return _running(power @ history.areas)


def yielding_terms(histories: Sequence[InterfaceHistory], dt: float) -> dict[str, Array]:
    """Energy of elastic layers and dissipation of viscous joints, (n_time,) each, J; only what there is."""
    terms = {}
    layers = [h.layer_energy for h in histories if h.layer_energy is not None]
    joints = [h.joint_power for h in histories if h.joint_power is not None]
    if layers:
        terms["layer_energy"] = np.sum(layers, axis=0)
    if joints:
        power = np.sum(joints, axis=0)
        terms["joint_dissipation"] = _running(0.5 * dt * (power[1:] + power[:-1]))
    return terms


def ground_work(history: InterfaceHistory, path: Array, weights: tuple[float, float, float]) -> Array:
    """Work (n_time,) that a moving ground does on side E since the start, J; ``path`` (n_time, 3) its travel, m."""
    force = _weighted(history.force(), weights)
    return _running(np.einsum("tc,tc->t", force, np.diff(path, axis=0)))


def _weighted(values: Array, weights: tuple[float, float, float]) -> Array:
    """Weighted values of each step, (n_time - 1, ...); the first step counts its start twice."""
    before = np.concatenate([values[:1], values[:-2]])
    combined: Array = weights[0] * before + weights[1] * values[:-1] + weights[2] * values[1:]
    return combined


def _running(steps: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(steps)])
