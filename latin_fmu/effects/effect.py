"""One effect of a scene: on or off, why, what it adds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Effect:
    """An effect as it stands in one scene.

    Attributes
    ----------
    name : of the effect. on : whether the scene calls for it.
    why : keys of the scene that decide, e.g. ``interface.crush.friction_coefficient``; a key that is not written
        stands for its default.
    reason : the same in words. switch : what would turn it the other way.
    unknowns : unknowns it adds (dofs of substructures, or interface unknowns), over all substructures or interfaces.
    kernels : functions that are called because of it. memory : bytes it holds during a run or leaves in the results.
    cost : CPU seconds per instant, predicted; 0 where nothing is called.
    """

    name: str
    on: bool
    why: tuple[str, ...]
    reason: str
    switch: str
    unknowns: int = 0
    kernels: tuple[str, ...] = ()
    memory: int = 0
    cost: float = 0.0

    def report(self, instant: float) -> dict[str, Any]:
        """Plain data; ``instant``: predicted CPU time of one instant, s."""
        return {
            "name": self.name,
            "on": self.on,
            "why": list(self.why),
            "reason": self.reason,
            "switch": self.switch,
            "unknowns": self.unknowns,
            "kernels": list(self.kernels),
            "memory_bytes": self.memory,
            "share_of_time": round(self.cost / instant, 4) if instant > 0 else 0.0,
        }


@dataclass(frozen=True)
class Suggestion:
    """What might be changed, never done unasked.

    Attributes
    ----------
    what : a sentence. settings : what to write, as for ``--set``. factor : predicted cost after over before, None
        where the cost does not change or is not known.
    """

    what: str
    settings: tuple[str, ...] = field(default=())
    factor: float | None = None

    def report(self) -> dict[str, Any]:
        """Plain data."""
        factor = None if self.factor is None else round(self.factor, 4)
        return {"what": self.what, "settings": list(self.settings), "cost_factor": factor}
