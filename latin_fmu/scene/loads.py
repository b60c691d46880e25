"""Table [load.NAME]: a load on a face, and the kinds that it may be of.

A new kind is a class in a file of its own (see ``load_kinds``) and one row here, a base of `Load`.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Final

import numpy as np

from ..errors import Problem
from .describe import unit_of
from .fields import LocalAxes, about
from .laws import ConstantLaw, Law
from .load_kinds import (
    Array,
    GlobalVector,
    LoadedFace,
    LoadEstimate,
    LoadKind,
    PressureLoad,
    ResultantLoad,
    TractionLoad,
)
from .nodal_loads import NodalLoad
from .raw_scene import RawTable, exactly_one, face_problems, given, named_tables


class Load(
    # the kinds, that of the last keys of the table first
    NodalLoad,
    ResultantLoad,
    TractionLoad,
    PressureLoad,
):
    """A load on a face, times a law, of exactly one kind. Loads on one face add up."""

    axes: Annotated[LocalAxes | None, about("axes of the traction, forces and moment; default: the global axes")] = None
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()

    @property
    def kind(self) -> type[LoadKind]:
        """The kind that a key of this load chooses."""
        return next(kind for kind in LOAD_KINDS if kind.chosen_key(self.__dict__))

    @property
    def amount(self) -> float:
        """Number that the law multiplies, the length of one that is a vector."""
        value = getattr(self, self.kind.chosen_key(self.__dict__) or "")
        if isinstance(value, tuple):
            return float(np.linalg.norm(value))
        return float(value)

    @property
    def unit(self) -> str:
        """Unit of ``amount``, UDUNITS, SI."""
        return load_unit(self.__dict__) or "1"

    def to_global(self, vector: GlobalVector) -> GlobalVector:
        """Global components of a vector given along the axes of the load."""
        if self.axes is None:
            return vector
        return self.axes.to_global(vector)

    def nodal_forces(self, face: LoadedFace, /) -> Array:
        """Forces (n, 3) on the nodes of the face along the global axes where the law is 1, N."""
        return self.kind.nodal_forces(self, face)

    def largest_traction(self, face: LoadedFace, /) -> float:
        """Size of the largest traction where the law is 1, Pa."""
        return self.kind.largest_traction(self, face)

    def mean_traction(self, face: LoadedFace) -> Array:
        """Resultant over the area (3,) where the law is 1, Pa: parts on opposite facets cancel."""
        return self.kind.mean_traction(self, face)

    def arrow(self, normal: Array, /) -> Array:
        """Direction (3,) of the arrow of a picture, of any length; ``normal`` : mean one of the face, outwards."""
        return self.kind.arrow(self, normal)

    def turns(self) -> bool:
        """Whether its tractions turn the face beside what their resultant does."""
        return self.kind.turns(self)

    def doubts(self, estimate: LoadEstimate, /) -> Iterator[str]:
        """What speaks against its numbers, in words."""
        return self.kind.doubts(self, estimate)


LOAD_KINDS: Final = tuple(
    kind for kind in reversed(Load.__mro__) if issubclass(kind, LoadKind) and kind not in (LoadKind, Load)
)
"""Kinds of loads, in the order of their keys."""
Load.__doc__ = " ".join(str(table.__doc__) for table in (Load, *LOAD_KINDS))


def load_unit(table: RawTable) -> str | None:
    """Unit of what the law of a load, as written, multiplies; None where no kind is chosen."""
    for kind in LOAD_KINDS:
        if (key := kind.chosen_key(table)) is not None:
            return unit_of(kind.model_fields[key])
    return None


def load_problems(raw: Any) -> Iterator[Problem]:
    """Problems of the loads of a scene as written."""
    keys = [kind.chosen_by[0] for kind in LOAD_KINDS]
    more = [key for kind in LOAD_KINDS for key in kind.chosen_by[1:]]
    for name, table in named_tables(raw, "load").items():
        where = f"load.{name}"
        if not any(given(table, key) for key in more):
            yield from exactly_one(table, where, *keys)
        for kind in LOAD_KINDS:
            others = [key for other in LOAD_KINDS if other is not kind and (key := other.chosen_key(table))]
            yield from kind.key_problems(table, where, others)
        yield from face_problems(raw, f"{where}.face", table.get("face"))
