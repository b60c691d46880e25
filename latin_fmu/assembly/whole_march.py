"""What a run needs of an assembly that is marched as one substructure."""

from __future__ import annotations

from typing import Protocol

from ..latin.assembly import Assembly
from ..latin.recorder import Recorder
from ..latin.settings import SolverSettings


class WholeMarch(Protocol):
    """An assembly that is marched as one substructure: by its modes (``reduced_run``), or without inertia
    (``static_fields``)."""

    @property
    def assembly(self) -> Assembly:
        """Of the one substructure."""

    @property
    def stored(self) -> float:
        """Elastic energy of all bodies at t = 0, J."""

    @property
    def in_words(self) -> str:
        """What is marched."""

    def settings(self, given: SolverSettings) -> SolverSettings:
        """The rules of the iteration."""

    def recorder(self, energy: bool) -> Recorder:
        """That of the march."""
