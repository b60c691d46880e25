"""What a scene asks of its propagators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["direct", "explicit", "reduced", "cg"]


@dataclass(frozen=True)
class PropagatorSettings:
    """Settings of the propagators of a run.

    Attributes
    ----------
    kind : registry key. modes : elastic modes of each reduced substructure. precision : of the direct factors.
    """

    kind: Kind = "direct"
    modes: int = 50
    precision: Literal["float64", "float32"] = "float64"
