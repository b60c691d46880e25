"""Operators of the scene solved last, for a scene that differs in parameters which enter none or few of them.

Friction, preload, amplitudes, laws and initial velocities change no operator; a time step changes the factors, a
material the matrices too. What may be used again is decided by comparison: meshes and element matrices where the
description of a body is equal, factors where all matrices of a class, the time scheme and the step are equal to the
last bit. A key that is not listed here can therefore cost time, but never give other results.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from ..propagator import Propagator, SubstructureModel
from .body import Body

_OWN: Final = frozenset(("name", "store", "loads", "displacement", "velocity", "imposed_start"))
"""Fields of a model that no operator depends on."""


Kept = dict[bytes, list[tuple[float, Any]]]
"""Operators of static problems by ``ModelClass.key``."""


@dataclass
class KeptOperators:
    """Bodies, models and propagators of the scene solved last (module docstring).

    Attributes
    ----------
    bodies : by substructure. models : first member of every class, before its propagator changes it. propagators : of
        the classes. made_with : scheme, step (s) and choices that the propagators were made with.
    """

    bodies: dict[str, Body] = field(default_factory=dict)
    models: list[SubstructureModel] = field(default_factory=list)
    propagators: list[Propagator] = field(default_factory=list)
    made_with: tuple[Any, ...] = ()

    def adopt(self, model: SubstructureModel) -> None:
        """Give a model the reduced matrices of one with equal matrices, where there is one."""
        known = self._like(model)
        if known is not None:
            self.models[known].share_operators(model)

    def twin(self, model: SubstructureModel, made_with: tuple[Any, ...]) -> Propagator | None:
        """Propagator with the operators of a model, made with the same scheme, step and choices; None where there is
        none."""
        known = self._like(model) if self.propagators and made_with == self.made_with else None
        return None if known is None else self.propagators[known]

    def replace(
        self, models: Sequence[SubstructureModel], propagators: Sequence[Propagator], made_with: tuple[Any, ...]
    ) -> None:
        """Take the operators of the scene that is solved next in the place of the former ones."""
        self.models, self.propagators, self.made_with = list(models), list(propagators), made_with

    def _like(self, model: SubstructureModel) -> int | None:
        """Number of the class with the operators of a model; None where there is none."""
        return next((i for i, known in enumerate(self.models) if same_operators(known, model)), None)


def same_operators(first: SubstructureModel, second: SubstructureModel) -> bool:
    """Whether all matrices of two models are equal to the last bit."""
    names = [f.name for f in fields(SubstructureModel) if f.name not in _OWN]
    return all(_same(getattr(first, name), getattr(second, name)) for name in names)


def _same(a: Any, b: Any) -> bool:
    if a is b:
        return True
    if isinstance(a, sp.csr_array) and isinstance(b, sp.csr_array):
        parts = ((a.indptr, b.indptr), (a.indices, b.indices), (a.data, b.data))
        return a.shape == b.shape and all(np.array_equal(x, y) for x, y in parts)
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return type(a) is type(b) and isinstance(a, str | int | float) and a == b
