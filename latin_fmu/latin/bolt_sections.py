"""What is known of a shank and of what it clamps, beside its tension: plain numbers for histories and results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CUT = "cut"
"""Name of the section of the cut, whose axial force is the tension."""
HEAD, THREAD, PARTING = "head", "thread", "parting"


@dataclass(frozen=True)
class ShankSections:
    """Sections of a shank by name, from the head to the thread.

    Attributes
    ----------
    names : (n,) "head", "parting" (with numbers where there are several), "cut", "thread". rows : (n,) row of each
        among those that are recorded; sections on the same facets share one.
    centres : (n, 3) m. areas : (n,) of the mesh across the axis, m2. directions : (3, 3) unit vectors: the axis, and
        two across it. missing : what was not found, a sentence each.
    """

    names: tuple[str, ...]
    rows: Index
    centres: Array
    areas: Array
    directions: Array
    missing: tuple[str, ...] = ()

    def number(self, *names: str) -> int:
        """Number of the first of these sections that there is, else of the cut."""
        return next(self.names.index(name) for name in (*names, CUT) if name in self.names)


@dataclass(frozen=True)
class ClampedFace:
    """An interface of clamped parts around a shank.

    Attributes
    ----------
    interface : its name. points : numbers of its points that are nearer to this shank than to the others that cross it.
    friction : Coulomb's coefficient; None where the interface has none.
    """

    interface: str
    points: Index
    friction: float | None


@dataclass(frozen=True)
class ScrewData:
    """What margins of a screw take, of the whole screw.

    Attributes
    ----------
    pitch, flank, stressed : P, d_2 and the diameter d_S of the stress area, m. yield_stress : R_p0.2 of its class, else
        of its material, Pa; None where neither is known. property_class : its name.
    endurance : sigma_ASV, Pa. rolled : "before" or "after" heat treatment. thread_friction : mu_G; None where the screw
        is not tightened by a torque. permissible_pressure : p_G of the clamped part under head and nut, Pa; None where
        it is not given. head, nut : area of their bearing surfaces, m2; None where there is none. clamp_length : l_K,
        m; None where an end was not found.
    """

    pitch: float
    flank: float
    stressed: float
    yield_stress: float | None
    property_class: str | None
    endurance: float
    rolled: str
    thread_friction: float | None
    permissible_pressure: float | None
    head: float | None
    nut: float | None
    clamp_length: float | None
