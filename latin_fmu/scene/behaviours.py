"""Names of the interface behaviours a scene may ask for."""

from __future__ import annotations

BEHAVIOUR_NAMES = ("contact", "perfect")
