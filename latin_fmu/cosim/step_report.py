"""What became of a communication step."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StepReport:
    """``accepted`` False: the state is as before, ``message`` says why and what to do."""

    accepted: bool
    message: str = ""
    instants: int = 0
    iterations: int = 0
    error_indicator: float = 0.0

    def __bool__(self) -> bool:
        return self.accepted


def refused(message: str) -> StepReport:
    """A step that was not made."""
    return StepReport(False, message)
