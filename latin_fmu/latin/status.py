"""The status of a run, as a sentence with a remedy."""

from __future__ import annotations

import numpy as np

from .assembly import Assembly
from .layout import Array
from .record import WindowRecord
from .settings import Settings
from .window_list import WindowList


def status(
    assembly: Assembly, settings: Settings, windows: WindowList, interface_indicator: Array | None
) -> tuple[bool, str]:
    """Whether every window converged, and a sentence that says so or names the worst place."""
    failed = windows.failed()
    if not failed:
        return True, _converged(settings, windows)
    first, worst = failed[0], max(failed, key=lambda w: w.final_error)
    reached = assembly.instant
    sentence = (
        f"not converged in {len(failed)} of {len(windows)} window(s), first at t = "
        f"{assembly.time[first.first_instant]:.6g} s (instant {first.first_instant}): {_reached(settings, worst)} "
        f"after {max(w.iterations for w in failed)} iterations{_used(failed)}{_where(assembly, interface_indicator)}"
    )
    if reached < assembly.n_instant:
        sentence += f"; stopped there, results end at t = {assembly.time[reached]:.6g} s"
    return False, sentence + f". {_remedy(assembly, settings, failed)}"


def _reached(settings: Settings, window: WindowRecord) -> str:
    """What the accepted iterate misses: the indicator, or the force mismatch where the indicator is met."""
    if window.final_error <= settings.tolerance and np.isfinite(window.final_mismatch):
        return f"force mismatch of the sides {window.final_mismatch:.2e} (wanted {settings.force_tolerance:.1e})"
    return f"error indicator {window.final_error:.2e} (wanted {settings.tolerance:.1e})"


def _where(assembly: Assembly, interface_indicator: Array | None) -> str:
    """The interface with the largest indicator."""
    if interface_indicator is None or not assembly.interfaces:
        return ""
    unit = assembly.interfaces[int(np.argmax(interface_indicator))]
    friction = getattr(unit.behaviour, "friction_coefficient", 0.0)
    return f"; worst interface {unit.name}" + (f" (friction coefficient {friction:g})" if friction else "")


def _converged(settings: Settings, windows: WindowList) -> str:
    helped = windows.fallen()
    sentence = (
        f"converged: {len(windows)} window(s), at most {windows.most_iterations()} iteration(s) "
        f"to sqrt(eta) <= {settings.tolerance:g}"
    )
    return sentence + (f", fall-backs used in {helped}" if helped else "")


def _used(failed: list[WindowRecord]) -> str:
    used = sorted({f for w in failed for f in w.fallbacks})
    return f" and the fall-backs {', '.join(used)}" if used else ""


def _remedy(assembly: Assembly, settings: Settings, failed: list[WindowRecord]) -> str:
    if assembly.quasi_static:
        return (
            "There may be no equilibrium: check that contact and friction can hold the loads of this instant (nothing "
            "slides away, topples or is pulled off); where they can, raise solver.max_iterations or take smaller steps"
        )
    if any(not np.isfinite(w.final_error) for w in failed):
        return "The search direction or the data are out of range: check units, and leave search_direction automatic"
    if any(w.iterations >= settings.max_iterations for w in failed):
        return "Raise solver.max_iterations, shorten solver.window, or use acceleration anderson"
    if any(getattr(u.behaviour, "friction_coefficient", 0.0) > 10 for u in assembly.interfaces):
        return 'Surfaces that never slide converge with behaviour = "no_slip"; or use a smaller time step'
    if settings.window != 1:
        return "Use solver.window = 1, or a smaller time step"
    return "Check that no point is pressed from both sides without a way out; use a smaller time step or a finer mesh"
