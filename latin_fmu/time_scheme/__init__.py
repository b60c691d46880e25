"""Time schemes: constant operators of a one-step march, Eqs. (9)-(11)."""

from .central_difference import CentralDifference
from .hht import HHT, Newmark
from .quasi_static import QuasiStatic
from .registry import SCHEMES, make_scheme
from .scheme import TimeScheme

__all__ = ["HHT", "SCHEMES", "CentralDifference", "Newmark", "QuasiStatic", "TimeScheme", "make_scheme"]
