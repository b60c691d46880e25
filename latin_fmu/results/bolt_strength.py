"""Strength of screws by VDI 2230-1:2015, the formulas alone; its numbers of equations, R7/2 and so on, in brackets.

Everything is of the whole screw. The stress area A_S = pi / 4 d_S^2, the plastic and the elastic section modulus of its
circle against torsion pi / 12 d_S^3 and pi / 16 d_S^3, against bending pi / 32 d_S^3.
"""

from __future__ import annotations

import math
from typing import Final

from ..latin.bolt_sections import ScrewData
from ..latin.outcome import BoltHistory

UTILISATION: Final = 0.9
"""nu : share of the yield stress that assembly may take (R7/1)."""
RELAXED: Final = 0.5
"""k_tau : share of the torsion of assembly that is left in service (R8/4)."""
_FLANKS: Final = 1.155  # 1 / cos 30 degrees, half of the flank angle of 60
_LIMITS: Final = 0.3, 1.0  # of F_Sm / F_0.2min, between which sigma_ASG holds


def stress_area(screw: ScrewData) -> float:
    """Stress area A_S of a thread, m2."""
    return 0.25 * math.pi * screw.stressed**2


def thread_torque(screw: ScrewData, force: float, friction: float) -> float:
    """Moment M_G in the thread, N m, under a preload, N: F d_2 / 2 (P / (pi d_2) + 1.155 mu_G) (R8/3)."""
    return 0.5 * force * screw.flank * (screw.pitch / (math.pi * screw.flank) + _FLANKS * friction)


def assembly_torsion(bolt: BoltHistory) -> float | None:
    """M_G, N m, of the whole screw under the largest tension while bolts were tightened; None where no torque is
    known."""
    screw = bolt.screw
    if screw is None or screw.thread_friction is None:
        return None
    return thread_torque(screw, max(bolt.tightening, default=0.0) / bolt.share, screw.thread_friction)


def permissible_preload(
    screw: ScrewData, yield_stress: float, friction: float, utilisation: float = UTILISATION
) -> float:
    """Assembly preload F_Mzul, N, whose von Mises stress with the torsion of assembly is ``utilisation`` of the yield
    stress, Pa, the section plastic in torsion (R7/2).

    >>> from latin_fmu.latin.bolt_sections import ScrewData
    >>> m10 = ScrewData(1.25, 9.188, 8.827, 640.0, "8.8", 51.0, "before", 0.12, None, None, None, None)  # N, mm
    >>> round(permissible_preload(m10, 640.0, 0.12) / 1e3, 1)  # kN, M10x1.25, 8.8
    31.6
    """
    ratio = 1.5 * screw.flank / screw.stressed * (screw.pitch / (math.pi * screw.flank) + _FLANKS * friction)
    return stress_area(screw) * utilisation * yield_stress / math.sqrt(1.0 + 3.0 * ratio**2)


def service_stress(screw: ScrewData, force: float, torsion: float, bending: float = 0.0) -> float:
    """sigma_red,B, Pa: of the largest force, N, the torsion of assembly, N m, k_tau of which is left (R8/4), and of a
    ``bending`` stress, Pa, that the guideline leaves out."""
    shear = RELAXED * torsion / (math.pi / 16.0 * screw.stressed**3)
    return math.hypot(force / stress_area(screw) + bending, math.sqrt(3.0) * shear)


def endurance_limit(diameter: float) -> float:
    """Stress amplitude sigma_ASV, MPa, that a thread rolled before heat treatment endures for more than 2e6 cycles; of
    the nominal diameter, mm: 0.85 (150 / d + 45) (R9/5-1).

    >>> round(endurance_limit(12.0), 1)
    48.9
    """
    return 0.85 * (150.0 / diameter + 45.0)


def endurance(screw: ScrewData, mean: float) -> float:
    """Stress amplitude, Pa, that the thread endures under a mean force, N: sigma_ASV, or rolled after heat treatment
    (2 - F_Sm / F_0.2min) sigma_ASV (R9/5-2); that of 0.3 F_0.2min below, of F_0.2min above."""
    if screw.rolled == "before" or screw.yield_stress is None:
        return screw.endurance
    ratio = mean / (screw.yield_stress * stress_area(screw))
    return (2.0 - min(max(ratio, _LIMITS[0]), _LIMITS[1])) * screw.endurance
