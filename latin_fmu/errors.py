"""Errors of the package: each says what is wrong, where, which value, what is allowed and how to mend it."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True)
class Problem:
    """One thing wrong with an input.

    Attributes
    ----------
    where : path of the offending item, e.g. ``interface.crush.sides[1]`` or a file name.
    what : what is wrong, as a sentence without final stop.
    value : the offending value as text, or None where there is none to show.
    allowed : what would have been accepted, or None.
    remedy : what to do, e.g. "did you mean 'young_modulus'?", or None.
    line : of the file of the scene, where it is known.
    """

    where: str
    what: str
    value: str | None = None
    allowed: str | None = None
    remedy: str | None = None
    line: int | None = None

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}"
        if self.value is not None:
            text += f" (value: {self.value})"
        if self.allowed is not None:
            text += f"; allowed: {self.allowed}"
        if self.remedy is not None:
            text += f"; {self.remedy}"
        return text if self.line is None else f"{text} (line {self.line})"


class Problems(list[Problem]):
    """Problems of one input, collected to be reported together."""

    def add(
        self, where: str, what: str, value: str | None = None, allowed: str | None = None, remedy: str | None = None
    ) -> None:
        """One more problem (see ``Problem``)."""
        self.append(Problem(where, what, value, allowed, remedy))


class LatinError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(LatinError):
    """Bad input: lists every problem found, not only the first one."""

    def __init__(self, problems: Sequence[Problem], heading: str = "bad input") -> None:
        self.problems = tuple(problems)
        self.heading = heading
        super().__init__(str(self))

    @classmethod
    def of(
        cls,
        heading: str,
        where: str,
        what: str,
        value: str | None = None,
        allowed: str | None = None,
        remedy: str | None = None,
    ) -> Self:
        """Error with one problem (see ``Problem``)."""
        return cls([Problem(where, what, value, allowed, remedy)], heading)

    def __str__(self) -> str:
        n = len(self.problems)
        lines = [f"{self.heading}: {n} problem{'s' if n != 1 else ''}"]
        lines += [f"  {i}. {problem}" for i, problem in enumerate(self.problems, 1)]
        return "\n".join(lines)


class SceneError(InputError):
    """The scene cannot be solved as written."""


class NeedsPythonError(InputError):
    """An FMU that needs no Python cannot be made of this scene."""


class KernelsError(InputError):
    """No library of compiled kernels fits this machine and the sources of this package."""


class MeshError(InputError):
    """A mesh file cannot be read or used."""


class ResultsError(InputError):
    """A results file cannot be read or written."""


class SolverError(LatinError):
    """The solver met a state it cannot continue from (never a mere lack of convergence)."""


def listed(names: Iterable[str], most: int = 12) -> str:
    """Names for a message, the first ones of many; "none" where there are none."""
    ordered = sorted(names)
    return (", ".join(ordered[:most]) + (f", ... ({len(ordered)} in all)" if len(ordered) > most else "")) or "none"


def did_you_mean(name: object, candidates: Iterable[str]) -> str | None:
    """ "did you mean 'x'?" for the closest known name, None where nothing comes close."""
    if not isinstance(name, str) or len(name) > 200:
        return None
    names = list(candidates)
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
