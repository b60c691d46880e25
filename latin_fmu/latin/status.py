"""Course of the iteration: the list of windows, the status of a run in a sentence, the drift of bonded sides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ..interface.laws import coulomb_coefficient
from .assembly import Array, Assembly, NoEquilibrium
from .record import WindowRecord
from .settings import Settings
from .window_list import WindowList

SLOW: Final = 12
"""Iterations from which on the residual of an instant underestimates the error of its tractions."""
_OFF = "their tractions may be off by ten times the tolerance"
_GAIN = 0.5  # of the energy put in: more than that gained, a run is not called converged
_IN_BODIES = "damping_dissipation", "landing_dissipation", "scheme_dissipation"
_AT_INTERFACES = "friction_dissipation", "contact_dissipation", "joint_dissipation"
_CANCELLED = 1e-6  # of the work of the interfaces


def status(
    assembly: Assembly, settings: Settings, windows: WindowList, interface_indicator: Array | None
) -> tuple[bool, str]:
    """Whether every window converged, and a sentence that says so, or names the worst place and a remedy."""
    failed = windows.failed()
    if not failed and assembly.lost is not None and assembly.instant < assembly.n_instant:
        return False, _no_equilibrium(assembly, assembly.lost)
    if not failed:
        return True, _converged(settings, windows)
    first, worst = failed[0], max(failed, key=lambda w: w.final_error)
    last = assembly.instant
    sentence = (
        f"not converged in {len(failed)} of {len(windows)} window(s), first at t = "
        f"{assembly.time[first.first_instant]:.6g} s (instant {first.first_instant}): {_excess(settings, worst)} "
        f"after {max(w.iterations for w in failed)} iterations{_used(failed)}{_where(assembly, interface_indicator)}"
    )
    if last < assembly.n_instant:
        sentence += f"; stopped there, results end at t = {assembly.time[last]:.6g} s"
    return False, sentence + f". {_remedy(assembly, settings, failed)}"


def with_energy(
    converged: bool, sentence: str, time: Array, energy: Mapping[str, Array] | None, stored: float | None = None
) -> tuple[bool, str]:
    """The status of a run, which has not converged where the dissipations of all kinds together are negative by more
    than half of the energy put in.

    That is the energy at t = 0, and the largest of each work so far: of loads, moving ground, layers that relax, and of
    driven faces on what they touch (interface work that no dissipation accounts for). An iteration that converges to
    its relative tolerance at every instant does not notice a scheme that gains energy.

    Parameters
    ----------
    energy : terms (n_time,) of the assembly, J; None where they are not accounted for. stored : kinetic and elastic
        energy at t = 0, J, where ``time`` begins later.
    """
    if energy is None or not len(time):
        return converged, sentence
    now = energy["kinetic"] + energy["elastic"]
    put_in = np.full(len(now), (float(now[0]) if stored is None else stored) + float(np.finfo(float).tiny))
    zero = np.zeros(len(now))
    ground, layers = energy.get("ground_work", zero), energy.get("layer_energy", zero)
    with np.errstate(all="ignore"):  # a run that blew up
        at_interfaces = sum((energy.get(name, zero) for name in _AT_INTERFACES), zero)
        lost = at_interfaces + sum(energy[name] for name in _IN_BODIES)
        driven = energy["interface_work"] + at_interfaces - ground + layers - layers[0]
        for work in (energy["work_of_loads"], ground, layers[0] - layers, driven):
            put_in += np.maximum.accumulate(np.maximum(work, 0.0))
        # works that cancel, of a preload and what holds it, leave their round-off
        put_in += _CANCELLED * np.maximum.accumulate(np.abs(energy["interface_work"]))
        wrong = np.flatnonzero(~(-lost <= _GAIN * put_in))
    if not len(wrong):
        return converged, sentence
    at = int(wrong[0])
    gained = (
        f"energy: at t = {time[at]:.6g} s the bodies hold {now[at]:.3g} J, where {float(put_in[at]):.3g} J were put in "
        f"(allowed: {1.0 + _GAIN:g} times as much): the time scheme gains energy. Use time.scheme = "
        '"generalized_alpha", or "hht" with smaller steps'
    )
    return False, f"not converged, {gained}" if converged else f"{sentence}; {gained}"


def _no_equilibrium(assembly: Assembly, lost: NoEquilibrium) -> str:
    """The sentence on a run without inertia that ends where contact and friction cannot hold the loads."""
    return (
        f"no equilibrium beyond t = {lost.time:.6g} s (instant {lost.instant}): {lost.what}, and contact and friction "
        f"cannot hold it; results end at t = {assembly.time[assembly.instant]:.6g} s. Hold it by a boundary, raise "
        "pressure or friction, lower the load, or give the scene inertia (time.quasi_static = false)"
    )


def _excess(settings: Settings, window: WindowRecord) -> str:
    """The measure of the accepted iterate that exceeds its tolerance: the indicator, else the force residual."""
    if window.final_error <= settings.tolerance and np.isfinite(window.final_mismatch):
        return f"interface force residual {window.final_mismatch:.2e} (tolerance {settings.force_tolerance:.1e})"
    return f"error indicator {window.final_error:.2e} (tolerance {settings.tolerance:.1e})"


def _where(assembly: Assembly, interface_indicator: Array | None) -> str:
    """The interface with the largest indicator."""
    if interface_indicator is None or not assembly.interfaces:
        return ""
    unit = assembly.interfaces[int(np.argmax(interface_indicator))]
    friction = coulomb_coefficient(unit.behaviour)
    return f"; worst interface {unit.name}" + (f" (friction coefficient {friction:g})" if friction else "")


def _converged(settings: Settings, windows: WindowList) -> str:
    """The sentence on a run without failed windows."""
    helped = windows.with_fallbacks()
    iterations, steps = windows.counts().T
    most = int(iterations.max(initial=0))
    sentence = f"converged: {len(windows)} window(s), at most {most} iteration(s) "
    sentence += f"to sqrt(eta) <= {settings.tolerance:g}"
    if steps.any():
        sentence += f", Newton steps in {np.count_nonzero(steps)} (at most {steps.max()}, counted as iterations)"
    slow = np.count_nonzero((iterations > SLOW) & (steps == 0)) if most > SLOW and settings.window == 1 else 0
    if slow:
        sentence += f"; {slow} of more than {SLOW} iterations without Newton steps: {_OFF}"
    if windows.disagreement() > settings.tolerance:
        sentence += f"; fields and tractions of windows disagree by up to {100 * windows.disagreement():.2g} %"
    return sentence + (f", fall-backs used in {helped}" if helped else "")


def _used(failed: list[WindowRecord]) -> str:
    """The fall-backs of the failed windows."""
    used = sorted({f for w in failed for f in w.fallbacks})
    return f" and the fall-backs {', '.join(used)}" if used else ""


def _remedy(assembly: Assembly, settings: Settings, failed: list[WindowRecord]) -> str:
    """What to change, by the kind of failure."""
    if assembly.quasi_static:
        return (
            "There may be no equilibrium: check that contact and friction can hold the loads of this instant (no body "
            "slides away, topples or is pulled off); where they can, raise solver.max_iterations or take smaller steps"
        )
    if any(not np.isfinite(w.final_error) for w in failed):
        return "The search direction or the data are out of range: check units, and leave search_direction automatic"
    if any(w.iterations >= settings.max_iterations for w in failed):
        return "Raise solver.max_iterations, shorten solver.window, or use acceleration anderson"
    if any((coulomb_coefficient(u.behaviour) or 0.0) > 10 for u in assembly.interfaces):
        return 'Surfaces that never slide converge with behaviour = "no_slip"; or use a smaller time step'
    if settings.window != 1:
        return "Use solver.window = 1, or a smaller time step"
    return (
        "Check that no point is pressed from both sides without room to move; use a smaller time step or a finer mesh"
    )
