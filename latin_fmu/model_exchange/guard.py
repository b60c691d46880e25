"""No exception may reach the exporter of an FMU: it would free the instance the host still holds."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from ..errors import LatinError
from .board import ERROR

Method = TypeVar("Method", bound=Callable[..., Any])


class Speaker(Protocol):
    """Has a log, and knows what it has told."""

    log: Callable[[int, str], None]
    told: set[str]


def guarded(method: Method) -> Method:
    """Log what a method raises, each complaint once, and return None."""

    @wraps(method)
    def call(self: Speaker, *args: Any) -> Any:
        try:
            with np.errstate(all="ignore"):  # an integrator may try states without sense
                return method(self, *args)
        except LatinError as error:
            complaint = str(error)
        except Exception as error:  # the host must survive whatever happens here
            complaint = f"unexpected {type(error).__name__} in {method.__name__}: {error}"
        if complaint not in self.told:  # an integrator asks again and again
            self.told.add(complaint)
            self.log(ERROR, complaint)
        return None

    return cast(Method, call)
