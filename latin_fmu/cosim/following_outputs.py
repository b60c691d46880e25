"""Outputs of a run by communication steps that follow from other outputs (``kernels.outputs.follow``): rates over a
time step, what is behind a causal filter, largest lengths so far; as fields of the record of the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..results.filters import causal_sections
from ..scene.schema import Scene
from .output_table import ACCELERATED, SENSOR, Placed, outputs_of, places_from


def following_fields(
    scene: Scene, places: Mapping[str, int], dt: float, differenced: Callable[[str], bool]
) -> dict[str, Any]:
    """Fields of the record of a run.

    places : of the scalar outputs, by name. dt : time step, s. differenced : whether the acceleration of a sensor, by
    name, is the rate of its velocity over the last time step.
    """
    rates, largest = list[tuple[int, int]](), list[tuple[int, int, int]]()
    passing, sections = list[tuple[int, int, int]](), [np.zeros((0, 5))]
    for placed in outputs_of(scene):
        to = [places[name] for name in placed.names]
        if placed.family is ACCELERATED and placed.row.name == "acceleration" and differenced(placed.name):
            rates += zip(places_from(SENSOR, placed, "velocity", places), to, strict=True)
        if placed.row.filtered:
            chosen = _sections(placed, dt)
            first = sum(map(len, sections))
            for of, end in zip(places_from(ACCELERATED, placed, "acceleration", places), to, strict=True):
                entered = [of, *[end] * (len(chosen) - 1)]
                passing += [(entry, end, first + k) for k, entry in enumerate(entered)]
            sections.append(chosen)
        if placed.row.largest:
            of_vector = places_from(placed.family, placed, placed.row.largest, places)
            largest.append((of_vector[0], len(of_vector), to[0]))
    return {
        **_table("rate", "rates", rates, 2),
        **_table("filtered", "filtered", passing, 3),
        **_table("largest", "largest", largest, 3),
        "sections": np.concatenate(sections),
        "n_section": sum(map(len, sections)),
    }


def _sections(placed: Placed, dt: float) -> np.ndarray:
    """b0, b1, b2, a1, a2 of the sections of the filter of a sensor, (n, 5); a0 is 1."""
    return causal_sections(placed.owner.filter, dt)[:, [0, 1, 2, 4, 5]]


def _table(count: str, name: str, rows: list[Any], width: int) -> dict[str, Any]:
    """A table of places and its number of rows."""
    return {f"n_{count}": len(rows), name: np.array(rows, dtype=np.int64).reshape(-1, width)}
