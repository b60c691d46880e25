"""From the values of the variables to the settings, loads and histories of a session."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..latin.settings import tolerance_for
from .guarded import WARNING, Log
from .values import Values

if TYPE_CHECKING:  # see ``participant``
    from .session import Session
    from .settings import Settings


def settings_of(values: Values, host_tolerance: float | None) -> Settings:
    """The parameters as settings; the tolerance of the host, where it gives one, goes first.

    The host's tolerance is a relative accuracy wanted; the parameter ``tolerance`` is on sqrt(eta).
    """
    from .settings import Settings

    given = None if host_tolerance is None or not host_tolerance > 0.0 else tolerance_for(host_tolerance)
    return Settings(
        mode=int(values.number("mode")),
        interpolation=int(values.number("inputInterpolation")),
        time_step=values.number("timeStep"),
        end_time=values.number("endTime"),
        tolerance=values.number("tolerance") if given is None else given,
        max_iterations=int(values.number("maxIterations")),
        keep=bool(values.text("resultsFile")),
    )


def check_results_file(values: Values) -> None:
    """Raises ResultsError where the results, if they are asked for, cannot be written."""
    if target := values.text("resultsFile"):
        from ..results.files import check_target

        check_target(target)


def estimate_wanted(values: Values) -> bool:
    """Whether the errors of what was solved are to be estimated at the end."""
    return bool(values.number("estimateError"))


def push_loads(values: Values, session: Session) -> None:
    """Inputs to the session."""
    for name in session.loads:
        session.set_load(name, values.number(f"load.{name}.value"), values.number(f"load.{name}.rate"))


def push_histories(values: Values, session: Session, log: Log) -> None:
    """Histories to the session, those of the file first.

    Raises InputError where the file, or a history, cannot be used.
    """
    from .history_file import read_histories

    file = values.text("historyFile")
    if not session.prescribed:
        if file:
            log(WARNING, "historyFile has no effect in windowed mode: set mode = 1")
        return
    if file:
        for name, (times, amplitudes) in read_histories(file, session.loads).items():
            session.set_history(name, times, amplitudes)
    for name, (times, amplitudes) in values.histories().items():
        session.set_history(name, times, amplitudes)
