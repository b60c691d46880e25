"""Errors of the package: each says what, where, which value, what is allowed and how to mend it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


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
    """

    where: str
    what: str
    value: str | None = None
    allowed: str | None = None
    remedy: str | None = None

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}"
        if self.value is not None:
            text += f" (value: {self.value})"
        if self.allowed is not None:
            text += f"; allowed: {self.allowed}"
        if self.remedy is not None:
            text += f"; {self.remedy}"
        return text


class LatinError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(LatinError):
    """Bad input: lists every problem found, not only the first one."""

    def __init__(self, problems: Sequence[Problem], heading: str = "bad input") -> None:
        self.problems = tuple(problems)
        self.heading = heading
        super().__init__(str(self))

    def __str__(self) -> str:
        n = len(self.problems)
        lines = [f"{self.heading}: {n} problem{'s' if n != 1 else ''}"]
        lines += [f"  {i}. {problem}" for i, problem in enumerate(self.problems, 1)]
        return "\n".join(lines)


class SceneError(InputError):
    """The scene cannot be solved as written."""


class MeshError(InputError):
    """A mesh file cannot be read or used."""


class ResultsError(InputError):
    """A results file cannot be read or written."""


class SolverError(LatinError):
    """The solver met a state it cannot continue from (never a mere lack of convergence)."""
