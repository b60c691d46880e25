"""What a run needs of an assembly that is marched as other substructures than its bodies."""

from __future__ import annotations

from typing import Any, Protocol

from ..latin.assembly import Assembly
from ..latin.probes import OutputRequest
from ..latin.recorder import Recorder, SubstructureInfo
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

    def settings(self, settings: SolverSettings) -> SolverSettings:
        """The rules of the iteration."""

    def recorder(self, energy: bool) -> Recorder:
        """That of the march."""


class GroupedMarch(Protocol):
    """An assembly in which bonded bodies are one substructure (``bonded_run``)."""

    @property
    def assembly(self) -> Assembly:
        """Of the groups, and of the bodies that are in none."""

    @property
    def in_words(self) -> str:
        """What is marched as one."""

    def recorder(self, request: OutputRequest, info: dict[str, SubstructureInfo], thinned: int, *file: Any) -> Recorder:
        """That of the bodies and all interfaces, which is fed by the march of the groups; parameters as for
        ``Recorder``."""
