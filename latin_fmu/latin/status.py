"""How the iteration went: the list of windows, the status of a run, the drift of bonded sides.

window_list
-----------
How the iteration went, window by window: records that are written out when somebody looks at them.

The compiled march leaves tables of numbers for hundreds of windows; few runs are asked about all of them.

status
------
The status of a run, as a sentence with a remedy.

drift
-----
How far bonded sides have drifted apart: velocities are tied to the tolerance, displacements add them up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

import numpy as np

from ..interface.behaviour import bonds
from .assembly import Array, Assembly, Index
from .record import WindowRecord
from .settings import Settings


class WindowList(Sequence[WindowRecord]):
    """Records of windows in order; see ``keep`` for those that exist as numbers only."""

    def __init__(self) -> None:
        self._records: list[WindowRecord | tuple[int, int, Array, Array]] = []

    def append(self, record: WindowRecord) -> None:
        """Add a window."""
        self._records.append(record)

    def keep(self, first: int, counts: Index, errors: Array, mismatches: Array) -> None:
        """Add converged windows of one instant, from the instant ``first`` on.

        Parameters
        ----------
        counts : (n,) iterations. errors, mismatches : (n, most) after each of them, copied.
        """
        most = int(counts.max(initial=0))
        errors, mismatches = errors[:, :most].copy(), mismatches[:, :most].copy()
        self._records += zip(range(first, first + len(counts)), counts.tolist(), errors, mismatches, strict=True)

    def cut(self, length: int) -> list[WindowRecord]:
        """Take off what is beyond so many windows."""
        taken = self[length:]
        del self._records[length:]
        return taken

    def failed(self) -> list[WindowRecord]:
        """Windows that did not converge."""
        return [r for r in self._records if isinstance(r, WindowRecord) and not r.converged]

    def fallen(self) -> int:
        """Number of windows that needed a fall-back."""
        return sum(isinstance(r, WindowRecord) and bool(r.fallbacks) for r in self._records)

    def most_iterations(self) -> int:
        """Iterations of the window that took most."""
        counts = [r.iterations if isinstance(r, WindowRecord) else r[1] for r in self._records]
        return max(counts, default=0)

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, at: int) -> WindowRecord: ...
    @overload
    def __getitem__(self, at: slice) -> list[WindowRecord]: ...
    def __getitem__(self, at: int | slice) -> WindowRecord | list[WindowRecord]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(len(self._records)))]
        found = self._records[at]
        if not isinstance(found, WindowRecord):
            instant, used, errors, mismatches = found
            curves = errors[:used].tolist(), mismatches[:used].tolist()
            found = self._records[at] = WindowRecord(instant, instant, *curves, [], True, used - 1)
        return found


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


_WORTH_TELLING = 1e-2


def drift_remarks(assembly: Assembly) -> list[str]:
    """A sentence per bonded interface whose sides stand apart by more than 1 % of the largest displacement."""
    if not any(bonds(unit.behaviour) for unit in assembly.interfaces):
        return []
    u = assembly.displacement()
    largest = float(np.abs(u).max())
    remarks = []
    for i, unit in enumerate(assembly.interfaces):
        if not bonds(unit.behaviour):
            continue
        first, second = (assembly.layout.channels(i, side) for side in (0, 1))
        apart = float(np.linalg.norm(u[second] - u[first], axis=1).max())
        if apart > _WORTH_TELLING * largest:
            remarks.append(
                f"bonded interface {unit.name}: its sides have drifted apart by {apart:.3g} m, "
                f"{100 * apart / largest:.2g} % of the largest displacement of the interfaces: "
                "lower solver.tolerance"
            )
    return remarks
