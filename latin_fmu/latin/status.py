"""The status of a run, as a sentence with a remedy."""

from __future__ import annotations

import numpy as np

from .assembly import Assembly
from .layout import Array
from .record import WindowRecord
from .settings import Settings


def status(
    assembly: Assembly, settings: Settings, windows: list[WindowRecord], interface_indicator: Array | None
) -> tuple[bool, str]:
    """Whether every window converged, and a sentence that says so or names the worst place."""
    failed = [w for w in windows if not w.converged]
    if not failed:
        return True, _converged(settings, windows)
    first = failed[0]
    names = [u.name for u in assembly.interfaces]
    worst = (
        names[int(np.argmax(interface_indicator))] if interface_indicator is not None and names else "none"
    )
    behaviour = assembly.interfaces[names.index(worst)].behaviour if names else None
    friction = getattr(behaviour, "friction_coefficient", 0.0)
    reached = max(w.error_indicator[-1] if not w.error_indicator else min(w.error_indicator) for w in failed)
    sentence = (
        f"not converged in {len(failed)} of {len(windows)} window(s), first at t = "
        f"{assembly.time[first.first_instant]:.6g} s (instant {first.first_instant}): error indicator "
        f"{reached:.2e} (wanted {settings.tolerance:.1e}) after {max(w.iterations for w in failed)} iterations"
        f"{_used(failed)}; worst interface {worst}"
    )
    if friction:
        sentence += f" (friction coefficient {friction:g})"
    return False, sentence + f". {_remedy(settings, failed)}"


def _converged(settings: Settings, windows: list[WindowRecord]) -> str:
    most = max((w.iterations for w in windows), default=0)
    helped = sum(1 for w in windows if w.fallbacks)
    sentence = (
        f"converged: {len(windows)} window(s), at most {most} iteration(s) "
        f"to sqrt(eta) <= {settings.tolerance:g}"
    )
    return sentence + (f", fall-backs used in {helped}" if helped else "")


def _used(failed: list[WindowRecord]) -> str:
    used = sorted({f for w in failed for f in w.fallbacks})
    return f" and the fall-backs {', '.join(used)}" if used else ""


def _remedy(settings: Settings, failed: list[WindowRecord]) -> str:
    if any(w.iterations >= settings.max_iterations for w in failed):
        return "Raise solver.max_iterations, shorten solver.window, or use acceleration anderson"
    if settings.window != 1:
        return "Use solver.window = 1, or a smaller time step"
    return "Use a smaller time step, a lower friction coefficient, or a finer mesh on the softer side"
