"""Names of the interface behaviours a scene may ask for: those of the registry."""

from __future__ import annotations

from ..interface.registry import BEHAVIOURS

BEHAVIOUR_NAMES = tuple(sorted(BEHAVIOURS))
