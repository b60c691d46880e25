"""Predicted cost of a scene: of the propagator chosen, and of the others, for whoever wants to choose otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from ..memory import physical_memory
from ..propagator.cost import Cost, cost, factor_bytes, size_of
from ..propagator.settings import Kind, PropagatorSettings
from .models import ModelClass

FITS: Final = 0.7  # part of the memory of the machine that operators may take
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
    """Predicted cost of a run (``propagator.cost``: right within a factor of three).

    Attributes
    ----------
    kind : propagator chosen. n_instant : instants. costs : of every propagator.
    """

    kind: Kind
    n_instant: int
    costs: dict[Kind, Cost]

    @property
    def setup(self) -> float:
        """Seconds of CPU for the operators."""
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
            other = self.costs[kind]
            march = self.n_instant * other.instant if kind == "reduced" else other.total(self.n_instant)
            if kind != self.kind and march < _WORTH * own:
                sentence = (
                    f"another answer by the {kind} propagator ({what}): about {march:.2g} s, not {own:.2g} s"
                )
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


def predict(classes: list[ModelClass], settings: PropagatorSettings, n_instant: int) -> Prediction:
    """Predicted cost of classes of substructures over so many instants, whichever way they are marched."""
    sizes = [size_of(c.members[0], len(c.members)) for c in classes]
    costs: dict[Kind, Cost] = {
        kind: sum(
            (cost(kind, size, settings.modes, settings.precision) for size in sizes), Cost(0.0, 0.0, 0.0)
        )
        for kind in _KINDS
    }
    return Prediction(settings.kind, n_instant, costs)


def fitting(
    classes: list[ModelClass], settings: PropagatorSettings, memory: float | None = None
) -> PropagatorSettings:
    """The settings, or conjugate gradients where a direct march does not fit in the ``memory`` (bytes; None: of this
    machine)."""
    room = FITS * (physical_memory() if memory is None else memory)
    if settings.kind != "direct" or not room:
        return settings
    if (
        sum(factor_bytes(c.members[0].expansion.shape[1]) for c in classes) < 0.3 * room
    ):  # no need to look closer
        return settings
    return replace(settings, kind="cg") if predict(classes, settings, 1).memory > room else settings
