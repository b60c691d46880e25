"""What a scene asks of its propagators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["direct", "explicit", "reduced"]


@dataclass(frozen=True)
class PropagatorSettings:
    """Settings of the propagators of a run.

    Attributes
    ----------
    kind : registry key. modes : elastic modes of each reduced substructure.
    """

    kind: Kind = "direct"
    modes: int = 50
