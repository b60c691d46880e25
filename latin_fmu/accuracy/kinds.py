"""The quantities engineers use, and how an error of each is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ..latin.wanted_accuracy import LEFT

FLOOR: Final = 1e-3
"""Relative errors below this count as this."""


@dataclass(frozen=True)
class Kind:
    """A kind of quantity.

    Attributes
    ----------
    key : last part of the name of a quantity, ``interface.key`` or ``sensor.key``. unit : UDUNITS.
    meaning : what it is. scale : what its error is divided by.
    order : expected order of convergence when mesh and time step are refined together: contact makes everything of
        first order, and a front leaves 1/2 to the L2 norm.
    safety : the extrapolated error is multiplied by this. Chosen on problems with closed solutions (see
        ``tests/verification/test_error_estimate.py``) so that the product covers the true error.
    iteration : error left by the iteration, over the tolerance on sqrt(eta); largest measured on eight scenes.
    change : error over the change by the last refinement by two: 95 % of 903 cases with closed solutions (ten scenes,
        mesh and step from 1/4 to 4 times those written, Courant number 0.75) lie below.
    changes : the same where the change before is known too: the error is below the larger of the first number x the
        last change and the second x the one before. A last change that is small by chance is so held against it.
    """

    key: str
    unit: str
    meaning: str
    scale: str
    order: float = 1.0
    safety: float = 2.0
    iteration: float = LEFT
    change: float = 2.5
    changes: tuple[float, float] = (2.0, 0.8)


_INSTANT: Final = "the instant itself, a hundredth of the interval at least"

IMPULSE: Final = Kind("impulse", "N s", "normal force integrated over time", "integral of the magnitude of the force")
FIRST_CONTACT: Final = Kind(
    "first_contact",
    "s",
    "instant at which the normal force first exceeds 1 % of its peak (sides that come from apart: at which they meet)",
    _INSTANT,
    safety=0.65,
    iteration=0.15,
    change=3.0,
    changes=(1.4, 0.6),
)
SEPARATION: Final = Kind(
    "separation",
    "s",
    "instant from which on the normal force stays below 1 % of its peak",
    _INSTANT,
    iteration=0.3,
    change=3.5,
    changes=(1.4, 1.2),
)
PEAK_FORCE: Final = Kind("peak_force", "N", "largest normal force", "itself", change=4.0, changes=(4.0, 0.5))
FRICTION_WORK: Final = Kind(
    "friction_work",
    "J",
    "work dissipated by friction",
    "itself, a thousandth of impulse x largest velocity at least",
    iteration=2.0,
    change=2.4,
    changes=(1.2, 0.3),
)
FORCE_HISTORY: Final = Kind(
    "force_history",
    "N s0.5",
    "normal force over time, distance in L2",
    "L2 norm of the force",
    order=0.5,
    safety=0.95,
    iteration=1.0,
    change=2.0,
    changes=(2.0, 0.2),
)
DISPLACEMENT: Final = Kind(
    "displacement",
    "m",
    "displacement of a sensor at the end",
    "largest displacement of the sensor",
    change=1.8,
    changes=(1.8, 0.2),
)

KINDS: Final = (IMPULSE, FIRST_CONTACT, SEPARATION, PEAK_FORCE, FRICTION_WORK, FORCE_HISTORY, DISPLACEMENT)
"""All kinds, in the order of tables."""


def kind_of(quantity: str) -> Kind:
    """Kind of the quantity ``owner.key``.

    >>> kind_of("crush.impulse").unit
    'N s'
    """
    key = quantity.rpartition(".")[2]
    return next(kind for kind in KINDS if kind.key == key)
