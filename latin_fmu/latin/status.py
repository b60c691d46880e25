"""Course of the iteration: the windows of a run, as records or tables of numbers, and its status in a sentence."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any, Final, NamedTuple, overload

import numpy as np

from ..interface.laws import coulomb_coefficient
from ..kernels.newton import CLOSER, UNCERTAIN
from .assembly import Array, Assembly, Index, NoEquilibrium
from .outcome import WindowRecord
from .settings import SolverSettings

ERRORS, BALANCED = 1e-4, 1e-3
"""Work of the errors over the energy put in, up to which a run has converged: ERRORS a thousand instants, BALANCED in
all, at once where steps are longer than waves take through an element; and of a window of several instants."""
AT_REST = 5e-3
"""Least energy put in that the work of the errors is compared with, over what passes the interfaces in a window."""
ROUND_OFF = 1e-9
"""Share of the work of the largest tractions on the velocities they give, over a time step, that is round-off."""
_GAIN = 0.5  # of the energy put in: more than that gained, a run is not called converged
_IN_BODIES = "damping_dissipation", "landing_dissipation", "scheme_dissipation"
_AT_INTERFACES = "friction_dissipation", "contact_dissipation", "joint_dissipation"
_CANCELLED = 1e-6  # of the work of the interfaces


def stored_energy(energy: Mapping[str, Array]) -> Array:
    """What bodies have stored by a balance of energies (n_time,), J: kinetic, of the strains, and of the geometric
    stiffness."""
    stored: Array = energy["kinetic"] + energy["elastic"] + energy["prestress"]
    return stored


class Account(NamedTuple):
    """The account of the energies of all bodies at the end of a run, J: its sum, which is zero but for round-off, the
    size of its largest term, and what is negligible (``round_off``)."""

    open: float
    largest: float
    negligible: float


def status(
    assembly: Assembly, settings: SolverSettings, windows: WindowList, interface_indicator: Array | None
) -> tuple[bool, str]:
    """Whether every window converged, and a sentence: the iterations, or the worst place and a remedy."""
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


def allowed_work(instants: float, short: bool) -> float:
    """Share of the energy put in that errors may do as work in so many instants; ``short``: of single instants that
    resolve waves. An instant may always do a little, and energy that swings to and fro is put in once."""
    if short:
        return min(BALANCED, ERRORS * max(1.0, instants / 1000.0))
    return BALANCED


def with_work(sentence: str, work: float, put_in: float, allowed: float, tolerance: float) -> tuple[bool, str]:
    """The status of a run whose windows have all converged: it has not where the errors that they left had done more
    work at the interfaces by any instant, ``work`` in J, than the share ``allowed`` of the energy put in.

    The work test of an instant bounds that of its own error. Where the pressure rises many times from one instant to
    the next, to make that error up takes as many times the work.
    """
    # NaN has not converged
    if work <= allowed * put_in:
        return True, sentence
    if put_in > 0.0:
        share = work / put_in
    else:
        share = np.inf
    return False, (
        f"not converged: the work of the residual forces of the iteration at the interfaces is {share:.1e} of the "
        f"energy put in (allowed: {allowed:g}). Reduce solver.tolerance, for example to {0.1 * tolerance:g}"
    )


def with_energy(
    converged: bool,
    sentence: str,
    time: Array,
    energy: Mapping[str, Array] | None,
    stored: float | None = None,
    negligible: float = 0.0,
) -> tuple[bool, str]:
    """The status of a run, which has not converged where the dissipations of all kinds together are negative by more
    than half of the energy put in.

    That is the energy at t = 0, and the largest of each work so far: of loads, moving ground, layers that relax, and of
    driven faces on what they touch (interface work that no dissipation accounts for). The convergence of the
    iteration at every instant, to a relative tolerance, does not exclude a scheme that gains energy.

    Parameters
    ----------
    energy : terms (n_time,) of the assembly, J; None where they are not accounted for. stored : energy of the
        bodies at t = 0, J, where ``time`` begins later. negligible : work that round-off can do, J (``round_off``).
    """
    if energy is None or not len(time):
        return converged, sentence
    now = stored_energy(energy)
    if stored is None:
        before = float(now[0])
    else:
        before = stored
    put_in = np.full(len(now), before + negligible + float(np.finfo(float).tiny))
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
        # NaN is wrong, too
        wrong = np.flatnonzero(~(-lost <= _GAIN * put_in))
    if not len(wrong):
        return converged, sentence
    at = int(wrong[0])
    # a share: units of the scene are not known here
    gained = (
        f"energy: until t = {time[at]:.6g} s contacts, joints, damping and the time scheme together have added "
        f"{-float(lost[at]) / float(put_in[at]):.3g} times the energy put in (allowed: {_GAIN:g} times): "
        'the time scheme gains energy. Use time.scheme = "automatic", or smaller steps'
    )
    if converged:
        return False, f"not converged, {gained}"
    return False, f"{sentence}; {gained}"


def round_off(assembly: Assembly) -> float:
    """Work, J, that round-off of the motion can do, as of bodies that a preload holds at rest."""
    layout, impedance = assembly.layout, assembly.impedance
    yielding = np.divide(layout.area, impedance, out=np.zeros_like(impedance), where=layout.normal & (impedance > 0))
    return ROUND_OFF * assembly.characteristic_traction**2 * float(yielding.sum()) * assembly.dt


def _no_equilibrium(assembly: Assembly, lost: NoEquilibrium) -> str:
    """The sentence on a run without inertia that ends where contact and friction cannot hold the loads."""
    return (
        f"no equilibrium beyond t = {lost.time:.6g} s (instant {lost.instant}): {lost.what}, and contact and friction "
        f"cannot hold it; results end at t = {assembly.time[assembly.instant]:.6g} s. Hold it by a boundary, raise "
        "pressure or friction, reduce the load, or include inertia (time.quasi_static = false)"
    )


def _excess(settings: SolverSettings, window: WindowRecord) -> str:
    """The measure of the accepted iterate that exceeds what is allowed: the indicator, the force residual, the work."""
    # the rule of ``kernels.newton.share_to_meet``
    slow = window.first_instant == window.last_instant and window.iterations > UNCERTAIN and not window.newton_steps
    if slow and not settings.residual_alone:
        share = CLOSER
    else:
        share = 1.0
    error, forces = share * settings.tolerance, share * settings.force_tolerance
    if not window.final_error <= error:
        return f"error indicator {window.final_error:.2e} (tolerance {error:.1e})"
    if not window.final_mismatch <= forces:
        return f"interface force residual {window.final_mismatch:.2e} (tolerance {forces:.1e})"
    if window.imbalance > 0.0:
        allowed = f"(allowed {BALANCED:g})"
        return f"work of the residual forces {window.imbalance:.2e} of the energy put in {allowed}"
    return "work of the residual forces above its allowed share of the energy put in"


def _where(assembly: Assembly, interface_indicator: Array | None) -> str:
    """The interface with the largest indicator."""
    if interface_indicator is None or not assembly.interfaces:
        return ""
    unit = assembly.interfaces[int(np.argmax(interface_indicator))]
    friction = coulomb_coefficient(unit.behaviour)
    sentence = f"; worst interface {unit.name}"
    if friction:
        sentence += f" (friction coefficient {friction:g})"
    return sentence


def _converged(settings: SolverSettings, windows: WindowList) -> str:
    """The sentence on a run without failed windows."""
    helped = windows.with_fallbacks()
    iterations, steps, _ = windows.counts().T
    most = int(iterations.max(initial=0))
    sentence = f"converged: {len(windows)} window(s), at most {most} iteration(s) "
    sentence += f"to sqrt(eta) <= {settings.tolerance:g}"
    if steps.any():
        sentence += f", Newton steps in {np.count_nonzero(steps)} (at most {steps.max()}, counted as iterations)"
    if windows.disagreement() > settings.tolerance:
        sentence += f"; fields and tractions of windows differ by up to {100 * windows.disagreement():.2g} %"
    if helped:
        sentence += f", fall-backs used in {helped}"
    return sentence


def _used(failed: list[WindowRecord]) -> str:
    """The fall-backs of the failed windows."""
    used = sorted({f for w in failed for f in w.fallbacks})
    if used:
        return f" and the fall-backs {', '.join(used)}"
    return ""


def _remedy(assembly: Assembly, settings: SolverSettings, failed: list[WindowRecord]) -> str:
    """What to change, by the kind of failure."""
    if assembly.quasi_static:
        return (
            "There may be no equilibrium: check that contact and friction can carry the loads at this instant (no body "
            "slides away, topples or is pulled off). If they can, raise solver.max_iterations or use smaller steps"
        )
    if any(not np.isfinite(w.final_error) for w in failed):
        return "The search direction or the input is out of range: check the units, and omit search_direction"
    if any(w.iterations >= settings.max_iterations for w in failed):
        return 'Raise solver.max_iterations, reduce solver.window, or use acceleration = "anderson"'
    if any((coulomb_coefficient(u.behaviour) or 0.0) > 10 for u in assembly.interfaces):
        return 'Use behaviour = "no_slip" for surfaces that never slide, or a smaller time step'
    if settings.window != 1:
        return "Use solver.window = 1, or a smaller time step"
    return "Check that no point is clamped from both sides and cannot move; use a smaller time step or a finer mesh"


_CURVES: Final = ("error_indicator", "force_mismatch")


class WindowList(Sequence[WindowRecord]):
    """Records of windows in order.

    The compiled driver leaves tables of numbers for hundreds of windows (``keep``); their records are made when they
    are read, and not kept.
    """

    def __init__(self, records: Sequence[WindowRecord] = ()) -> None:
        self._records: dict[int, WindowRecord] = {}
        # converged windows of one instant: number of the first, its instant, counts, defects, ends of the curves of
        # each window, curves one after the other (padded, they would take several times as much memory)
        self._tables: list[tuple[int, int, Index, Array, Index, Array, Array]] = []
        self._n = 0
        for record in records:
            self.append(record)

    def append(self, record: WindowRecord) -> None:
        """Add the record of a window."""
        self._records[self._n] = record
        self._n += 1

    def keep(self, first: int, counts: Index, errors: Array, residuals: Array, defects: Array) -> None:
        """Add converged windows of one instant, from the instant ``first`` on.

        Parameters
        ----------
        counts : (n, 3) iterations, Newton steps among them, corrections. errors, residuals : (n, most) indicators and
            force residuals after each iteration, copied. defects : (n,) at the end, copied.
        """
        # row by row: the curves one after the other, without what pads them
        mask = np.arange(errors.shape[1]) < counts[:, :1]
        curves = errors[mask], residuals[mask]
        self._tables.append((self._n, first, counts.copy(), defects.copy(), np.cumsum(counts[:, 0]), *curves))
        self._n += len(counts)

    def cut(self, length: int) -> list[WindowRecord]:
        """Remove and return the windows beyond the first ``length``."""
        removed = self[length:]
        self._records = {at: record for at, record in self._records.items() if at < length}
        tables, self._tables = self._tables, []
        for at, first, counts, defects, ends, *curves in tables:
            if at < length:
                last = min(length - at, len(counts))
                errors, residuals = (curve[: ends[last - 1]] for curve in curves)
                self._tables.append((at, first, counts[:last], defects[:last], ends[:last], errors, residuals))
        self._n = min(self._n, length)
        return removed

    def failed(self) -> list[WindowRecord]:
        """Windows that did not converge."""
        return [record for record in self._records.values() if not record.converged]

    def with_fallbacks(self) -> int:
        """Number of windows that needed a fall-back."""
        return sum(bool(record.fallbacks) for record in self._records.values())

    def most_iterations(self) -> int:
        """Largest number of iterations of a window."""
        return int(self.counts()[:, 0].max(initial=0))

    def disagreement(self) -> float:
        """Largest difference of the tractions of both stages in a window of several instants."""
        return max((record.disagreement for record in self._records.values()), default=0.0)

    def largest_error(self) -> float:
        """Largest sqrt(eta) of the accepted iterates."""
        errors = [record.final_error for record in self._records.values()]
        for *_, ends, curve, _ in self._tables:
            errors += curve[ends - 1].tolist()
        return max(errors, default=0.0)

    def largest_defect(self) -> float:
        """Largest defect of the interface laws that a truncated operator has left at an instant."""
        tables = (float(table[3].max(initial=0.0)) for table in self._tables)
        return max((*tables, *(record.defect for record in self._records.values())), default=0.0)

    def counts(self) -> Index:
        """Iterations, Newton steps among them and corrections of the windows, (n, 3), in any order."""
        tables = [table[2] for table in self._tables]
        if self._records or not tables:
            records = [(r.iterations, r.newton_steps, r.corrections) for r in self._records.values()]
            tables.insert(0, np.array(records, dtype=np.int64).reshape(-1, 3))
        # one table alone needs no copy
        if len(tables) > 1:
            return np.concatenate(tables)
        return tables[0]

    def part(self, first: int) -> dict[str, Any]:
        """The windows from number ``first`` on as plain arrays, for ``extend``."""
        records = self[first:]
        curves = [np.array([x for r in records for x in getattr(r, name)]) for name in _CURVES]
        return {
            "numbers": np.array(
                [
                    (
                        r.first_instant,
                        r.last_instant,
                        r.converged,
                        r.accepted,
                        r.iterations,
                        r.newton_steps,
                        r.corrections,
                    )
                    for r in records
                ],
                dtype=np.int64,
            ).reshape(-1, 7),
            **dict(zip(_CURVES, curves, strict=True)),
            "disagreement": np.array([r.disagreement for r in records]),
            "defect": np.array([r.defect for r in records]),
            "imbalance": np.array([r.imbalance for r in records]),
            "fallbacks": {str(i): list(r.fallbacks) for i, r in enumerate(records) if r.fallbacks},
        }

    def extend(self, part: Mapping[str, Any]) -> None:
        """Add the windows of a ``part``."""
        numbers = part["numbers"]
        # curves of all windows stand one behind the other, each as long as its iterations
        ends = np.cumsum(numbers[:, 4])[:-1]
        curves = [np.split(part[name], ends) if len(numbers) else [] for name in _CURVES]
        fallbacks, at = part["fallbacks"], 0
        while at < len(numbers):
            # windows without anything special stay in tables
            n = _plain(numbers[at:], fallbacks, at)
            if n:
                counts = np.ascontiguousarray(numbers[at : at + n, 4:])
                errors, residuals = (_padded(curve[at : at + n], counts[:, 0]) for curve in curves)
                self.keep(int(numbers[at, 0]), counts, errors, residuals, part["defect"][at : at + n])
            else:
                first, last, done, accepted, _, steps, corrections = numbers[at].tolist()
                curve, forces = (values[at].tolist() for values in curves)
                used = list(fallbacks.get(str(at), []))
                rest = (
                    float(part["disagreement"][at]),
                    float(part["defect"][at]),
                    corrections,
                    float(part["imbalance"][at]),
                )
                self.append(WindowRecord(first, last, curve, forces, used, bool(done), accepted, steps, *rest))
            at += max(n, 1)

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, at: int) -> WindowRecord: ...
    @overload
    def __getitem__(self, at: slice) -> list[WindowRecord]: ...
    def __getitem__(self, at: int | slice) -> WindowRecord | list[WindowRecord]:
        if isinstance(at, slice):
            return [self[i] for i in range(*at.indices(self._n))]
        at = range(self._n)[at]
        if at in self._records:
            return self._records[at]
        start, first, counts, defects, ends, *flat = self._tables[bisect_right(self._tables, at, key=itemgetter(0)) - 1]
        row = at - start
        instant = first + at - start
        (count, steps, corrections) = counts[at - start].tolist()
        errors, residuals = (curve[ends[row] - count : ends[row]].tolist() for curve in flat)
        rest = 0.0, float(defects[row]), corrections
        return WindowRecord(instant, instant, errors, residuals, [], True, count - 1, steps, *rest)


def _plain(numbers: Index, fallbacks: Mapping[str, Any], at: int) -> int:
    """Number of windows at the start of ``numbers`` that are successive instants, converged without fall-back; ``at``:
    number of the first one among the keys of ``fallbacks``."""
    first, last, converged, accepted, counts, *_ = numbers.T
    # what ``keep`` assumes of a table
    plain = (first == last) & (converged == 1) & (accepted == counts - 1) & (first == first[0] + np.arange(len(first)))
    plain &= [str(at + i) not in fallbacks for i in range(len(first))]
    if plain.all():
        return len(plain)
    return int(np.argmin(plain))


def _padded(curves: Sequence[Array], counts: Index) -> Array:
    """Curves of different lengths as rows of a table."""
    table = np.full((len(curves), int(counts.max(initial=0))), np.nan)
    for row, curve in zip(table, curves, strict=True):
        row[: len(curve)] = curve
    return table
