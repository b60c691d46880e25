"""Predicted cost of a scene: of the propagator chosen, and of the others, for whoever wants to choose otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from ..propagator.cost import Cost, bytes_held
from ..propagator.registry import Kind
from .run_cost import run_cost
from .run_sizes import RunSizes

_WORTH: Final = 0.4  # a propagator that costs less than this part of the chosen one is suggested
_KINDS: Final[tuple[Kind, ...]] = ("direct", "explicit", "reduced", "cg")
_SUGGESTED: Final[Mapping[Kind, str]] = MappingProxyType(
    {
        "explicit": "a lumped mass, where the step is stable",
        "reduced": "some modes instead of the mesh; its set-up is shared by studies and FMUs",
    }
)


@dataclass(frozen=True)
class Prediction:
    """Predicted cost of a run (``run_cost``; within a factor of 1.5 on the machine it is fitted to).

    Attributes
    ----------
    kind : propagator chosen. n_instant : instants. costs : of every propagator that the scene can have.
    """

    kind: Kind
    n_instant: int
    costs: dict[Kind, Cost]

    @property
    def setup(self) -> float:
        """Seconds of CPU from the scene to operators."""
        return self.costs[self.kind].setup

    @property
    def march(self) -> float:
        """Seconds of CPU for all instants."""
        return self.n_instant * self.costs[self.kind].instant

    @property
    def memory(self) -> float:
        """Bytes of operators and state."""
        return self.costs[self.kind].memory

    def cheaper(self) -> list[tuple[Kind, str, float]]:
        """Propagators that change the answer but would cost much less: which, in a sentence, cost over the present."""
        own = self.costs[self.kind].total(self.n_instant)
        found: list[tuple[Kind, str, float]] = []
        for kind, what in _SUGGESTED.items():
            other = self.costs.get(kind)
            if other is None or kind == self.kind:
                continue
            march = self.n_instant * other.instant if kind == "reduced" else other.total(self.n_instant)
            if march < _WORTH * own:
                sentence = f"another answer by the {kind} propagator ({what}): about {march:.2g} s, not {own:.2g} s"
                if kind == "reduced":
                    sentence += f", after {other.setup:.2g} s of set-up"
                found.append((kind, sentence, march / own))
        return found

    def text(self) -> str:
        """One line: propagator, seconds, memory."""
        return (
            f"{self.kind} propagator: about {self.setup:.2g} s for the operators and {self.march:.2g} s for "
            f"{self.n_instant} instants, {self.memory / 1e6:.3g} MB"
        )


def predict(sizes: RunSizes) -> Prediction:
    """Predicted cost of a run, whichever way its substructures are marched."""
    kinds: tuple[Kind, ...] = (sizes.kind,) if sizes.static else _KINDS
    costs: dict[Kind, Cost] = {}
    for kind in kinds:
        found = run_cost(replace(sizes, kind=kind))
        memory = sum(bytes_held(kind, c.size, sizes.modes, sizes.precision) for c in sizes.classes)
        costs[kind] = Cost(found.set_up, found.march / sizes.n_instant, memory)
    return Prediction(sizes.kind, sizes.n_instant, costs)
