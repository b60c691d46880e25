"""What an observer of the iteration sees, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .latin.assembly import Array, Assembly
from .latin.record import InterfaceHistory
from .latin.recorder import interface_history
from .latin.solver import IterationEvent


@dataclass(frozen=True)
class Iteration:
    """One LATIN iteration, seen from outside; fields are computed when asked for.

    ``window`` counts from 0, ``iteration`` from 1. ``error_indicator`` is sqrt(eta), ``force_mismatch`` NaN where
    it was not evaluated.
    """

    window: int
    iteration: int
    error_indicator: float
    force_mismatch: float
    _event: IterationEvent
    _assembly: Assembly

    def interface(self, name: str) -> InterfaceHistory:
        """Local-stage fields of this iterate over the window's instants (gap left out).

        Raises
        ------
        KeyError : unknown interface.
        """
        names = [u.name for u in self._assembly.interfaces]
        if name not in names:
            raise KeyError(f"no interface {name!r}; there are {', '.join(names)}")
        return interface_history(self._assembly, names.index(name), self._event.f_hat, self._event.w_hat)

    def displacement(self, name: str) -> Array:
        """Linear-stage displacement of a substructure in this iterate, (n, n_node, 3), m: costs one more march.

        Raises
        ------
        KeyError : unknown substructure.
        """
        where = {n: (p, m) for p in self._assembly.propagators for m, n in enumerate(p.names)}
        if name not in where:
            raise KeyError(f"no substructure {name!r}; there are {', '.join(where)}")
        propagator, member = where[name]
        fields: list[Array] = []
        self._event.trial(lambda _: fields.append(propagator.full_displacement(member)))
        return np.stack(fields)


Observer = Callable[[Iteration], None]
