"""Small texts of error messages: suggestions, and values cut to a readable length."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Mapping


def did_you_mean(name: object, known: Iterable[str]) -> str | None:
    """ "did you mean 'x'?" for the closest known name, None where nothing comes close."""
    if not isinstance(name, str) or len(name) > 200:
        return None
    names = list(known)
    lowered = {known_name.lower(): known_name for known_name in names}
    close = difflib.get_close_matches(name.lower(), list(lowered), n=1, cutoff=0.6)
    return f"did you mean {lowered[close[0]]!r}?" if close else None


def shown(value: object) -> str:
    """A value as short text, whatever it is."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping) and not value:
        return "an empty table"
    short = reprlib.Repr()
    short.maxstring = short.maxother = 70
    short.maxlevel = 3
    try:
        return short.repr(list(value) if isinstance(value, tuple) else value)
    except (ValueError, RecursionError):  # an int with more digits than Python prints, endless nesting
        return f"a {type(value).__name__} too long to show"
