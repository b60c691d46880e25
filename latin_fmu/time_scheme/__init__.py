"""Time schemes: constant operators of an implicit one-step march, Eqs. (9)-(11)."""

from .hht import HHT, Newmark
from .registry import SCHEMES, make_scheme
from .scheme import TimeScheme

__all__ = ["HHT", "SCHEMES", "Newmark", "TimeScheme", "make_scheme"]
