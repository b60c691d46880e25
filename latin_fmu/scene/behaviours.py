"""Names of the interface behaviours a scene may ask for: those of the registry."""

from __future__ import annotations

from ..interface.registry import BEHAVIOURS, opens

__all__ = ["BEHAVIOUR_NAMES", "opens"]

BEHAVIOUR_NAMES = tuple(sorted(BEHAVIOURS))
