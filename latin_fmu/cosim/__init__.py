"""Co-simulation of a scene: a session advanced by communication steps, and the table of its variables.

The names below are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .session import Session
    from .settings import Settings, StepReport
    from .waveform_relaxation import WaveformMaster

__all__ = ["Session", "Settings", "StepReport", "WaveformMaster"]


def __getattr__(name: str) -> object:
    from importlib import import_module

    homes = {
        "Session": "session",
        "Settings": "settings",
        "StepReport": "settings",
        "WaveformMaster": "waveform_relaxation",
    }
    if name not in homes:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{homes[name]}", __name__), name)
