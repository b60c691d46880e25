"""Whether a direct march fits in the memory of the machine."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from ..memory import physical_memory
from ..propagator.cost import bytes_held, factor_bytes, size_of
from ..propagator.registry import PropagatorSettings
from .models import ModelClass

FITS: Final = 0.7  # part of the memory of the machine that operators may take


def memory_needed(classes: list[ModelClass], settings: PropagatorSettings) -> float:
    """Operators and states of classes of substructures, bytes."""
    sizes = [size_of(c.members[0], len(c.members)) for c in classes]
    return sum(bytes_held(settings.kind, size, settings.modes, settings.precision) for size in sizes)


def fitting(classes: list[ModelClass], settings: PropagatorSettings, memory: float | None = None) -> PropagatorSettings:
    """The settings, or conjugate gradients where a direct march does not fit in the ``memory`` (bytes; None: of this
    machine)."""
    room = FITS * (physical_memory() if memory is None else memory)
    if settings.kind != "direct" or not room:
        return settings
    if sum(factor_bytes(c.members[0].expansion.shape[1]) for c in classes) < 0.3 * room:  # no need to look closer
        return settings
    return replace(settings, kind="cg") if memory_needed(classes, settings) > room else settings
