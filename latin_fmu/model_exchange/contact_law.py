"""Regularised contact and friction of patches, and their discrete states.

Contact of a patch (P pressure, g gap, s sliding velocity of E' over E; k, d, v_r the regularisation):

    elastic part   p = preload - k g           while closed, 0 while open
    pressure       P = p (1 - d g')            d > 0 takes out what the missing modes would carry away
    friction       tau = mu P s / v_r          while sticking: creep at less than v_r instead of no motion
                   tau = mu P s / |s|          while slipping

Closed or open, sticking or slipping are discrete states that change at events only; between events the right-hand side
is smooth. A state is left a little beyond its bound (hysteresis), so that an event never triggers the next one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .system import Array, ReducedSystem

Flags = NDArray[np.bool_]
GAP_MARGIN = 1e-6  # of the penetration under the characteristic pressure
SLIDING_MARGIN = 1e-3  # of the velocity of regularisation
_DUE = 0.1  # of the margin: an event is due here, whatever side of the root a host stops at


@dataclass(frozen=True)
class Regularisation:
    """What replaces the laws of contact and friction.

    Attributes
    ----------
    stiffness : contact stiffness over the static stiffness of the two bodies. damping : d in units of 1 / the
        characteristic velocity. sliding : v_r, m s-1.
    """

    stiffness: float
    damping: float
    sliding: float

    @classmethod
    def of(cls, system: ReducedSystem) -> Regularisation:
        """Default regularisation of a system."""
        return cls(20.0, 0.5, 1e-3 * system.speed)


@dataclass
class Modes:
    """Discrete states: which patches are closed, which of them stick, and the segment of the time laws."""

    closed: Flags
    sticking: Flags
    segment: int


class Motion(NamedTuple):
    """Of the patches: gap and its rate (n_patch,), sliding velocity (2, n_patch)."""

    gap: Array
    rate: Array
    sliding: Array


class Traction(NamedTuple):
    """Of the patches: pressure and its elastic part (n_patch,), friction on E (2, n_patch), Pa."""

    pressure: Array
    elastic: Array
    shear: Array


class ContactLaw:
    """Tractions, indicators and discrete states from the motion of the patches."""

    def __init__(self, system: ReducedSystem, regularisation: Regularisation) -> None:
        contacts = system.contacts
        self.regularisation = regularisation
        self.stiffness: Array = regularisation.stiffness * contacts.stiffness
        self.damping = regularisation.damping / system.speed
        self._friction, self._preload = contacts.friction, contacts.preload
        self.penetration: Array = system.traction / self.stiffness  # under the characteristic pressure

    def traction(self, motion: Motion, modes: Modes) -> Traction:
        """Tractions while the discrete states hold."""
        elastic = np.where(modes.closed, self._preload - self.stiffness * motion.gap, 0.0)
        pressure = elastic * np.maximum(0.0, 1.0 - self.damping * motion.rate)
        speed, bound = np.hypot(*motion.sliding), self.regularisation.sliding
        reach = np.where(modes.sticking, bound, np.maximum(speed, 0.5 * bound))
        return Traction(pressure, elastic, self._friction * np.maximum(pressure, 0.0) * motion.sliding / reach)

    def indicators(self, motion: Motion, modes: Modes) -> tuple[Array, Array]:
        """Positive while the discrete states hold, (n_patch,) each, of the size 1 whatever the scene.

        For the gaps, in penetrations under the characteristic pressure, and for stick and slip, in v_r.
        """
        beyond = (motion.gap - self._preload / self.stiffness) / self.penetration
        normal = GAP_MARGIN + np.where(modes.closed, -beyond, beyond)
        beyond = np.hypot(*motion.sliding) / self.regularisation.sliding - 1.0
        tangential = SLIDING_MARGIN + np.where(modes.sticking, -beyond, beyond)
        return normal, np.where(modes.closed & (self._friction > 0.0), tangential, 1.0)

    def switched(self, motion: Motion, modes: Modes) -> tuple[Modes, int]:
        """Discrete states after an event, and how many of them changed."""
        opens = self.indicators(motion, modes)[0] <= _DUE * GAP_MARGIN
        closed = modes.closed ^ opens
        here = Modes(closed, modes.sticking, modes.segment)
        turns = self.indicators(motion, here)[1] <= _DUE * SLIDING_MARGIN
        sticking = np.where(closed, modes.sticking ^ turns, True)
        return Modes(closed, sticking, modes.segment), int(opens.sum() + turns.sum())

    def called_for(self, motion: Motion, segment: int) -> Modes:
        """Discrete states that follow from the motion alone."""
        closed = self._preload - self.stiffness * motion.gap > 0.0
        sticking = ~closed | (np.hypot(*motion.sliding) <= self.regularisation.sliding)
        return Modes(closed, sticking, segment)
