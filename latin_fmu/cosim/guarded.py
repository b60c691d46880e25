"""Levels of the messages of a participant, and the guard that lets no exception out."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol, TypeVar, cast

from ..errors import LatinError

OK, WARNING, DISCARD, ERROR = 0, 1, 2, 3
"""Levels of a message, as the FMI counts them."""

Log = Callable[[int, str], None]
Method = TypeVar("Method", bound=Callable[..., Any])


class HasLog(Protocol):
    """Anything with a log."""

    log: Log


def guarded(fallback: object) -> Callable[[Method], Method]:
    """Log what a method raises and return ``fallback``."""

    def wrap(method: Method) -> Method:
        @wraps(method)
        def call(self: HasLog, *args: Any) -> Any:
            try:
                return method(self, *args)
            except LatinError as error:
                self.log(ERROR, str(error))
            except Exception as error:  # the host must survive whatever happens here
                self.log(ERROR, f"unexpected {type(error).__name__} in {method.__name__}: {error}")
            return fallback

        return cast(Method, call)

    return wrap
