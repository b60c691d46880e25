"""Propagators by name: a new one is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from ..time_scheme import TimeScheme
from .base import Propagator
from .direct import CgPropagator, DirectPropagator
from .explicit import ExplicitPropagator
from .interface_sweeps import Form, in_form
from .model import SubstructureModel
from .reduced import ReducedPropagator

Kind = Literal["direct", "explicit", "reduced", "cg"]


@dataclass(frozen=True)
class PropagatorSettings:
    """Settings of the propagators of a run.

    Attributes
    ----------
    kind : registry key. modes : elastic modes of each reduced substructure. precision : of the direct factors.
    interface : how direct propagators solve with interfaces (``interface_sweeps.Form``).
    """

    kind: Kind = "direct"
    modes: int = 50
    precision: Literal["float64", "float32"] = "float64"
    interface: Form = "automatic"


Members = Sequence[SubstructureModel]
Maker = Callable[[Members, TimeScheme, float, bool, PropagatorSettings, Propagator | None], Propagator]


def _direct(
    members: Members, scheme: TimeScheme, dt: float, energy: bool, settings: PropagatorSettings, twin: Propagator | None
) -> Propagator:
    if settings.precision != "float64":
        members = [m.with_factor(settings.precision) for m in members]
    members = in_form(members, settings.interface)
    return DirectPropagator(members, scheme, dt, energy, twin if isinstance(twin, DirectPropagator) else None)


def _reduced(
    members: Members, scheme: TimeScheme, dt: float, energy: bool, settings: PropagatorSettings, twin: Propagator | None
) -> Propagator:
    if members[0].nodal is not None:  # a rigid body has nothing to reduce
        return DirectPropagator(members, scheme, dt, energy)
    twin = twin if isinstance(twin, ReducedPropagator) else None
    return ReducedPropagator(members, scheme, dt, energy, settings.modes, twin)


PROPAGATORS: Mapping[str, Maker] = MappingProxyType(
    {
        "direct": _direct,
        "explicit": lambda members, scheme, dt, energy, *_: ExplicitPropagator(members, scheme, dt, energy),
        "reduced": _reduced,
        "cg": lambda members, scheme, dt, energy, *_: CgPropagator(members, scheme, dt, energy),
    }
)


def make_propagator(
    members: Members,
    scheme: TimeScheme,
    dt: float,
    energy: bool,
    settings: PropagatorSettings,
    twin: Propagator | None = None,
) -> Propagator:
    """Propagator of a class of identical substructures.

    Parameters
    ----------
    members : models with equal matrices and traces. scheme, dt : time scheme and step, s. energy : whether to account
        for energies. settings : which propagator, and how. twin : one with the same operators, to share them with
        (where the kind can).

    Raises
    ------
    KeyError : unknown name (the scene reader checks names first).
    """
    return PROPAGATORS[settings.kind](members, scheme, dt, energy, settings, twin)
