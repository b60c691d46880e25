"""Accepted steps of a session: their history, the loads over them, and their segments as one run.

The history is a chain of links, so that a session whose state is restored returns to an earlier step.
"""

from __future__ import annotations

import hashlib
import itertools
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final
from weakref import WeakValueDictionary

import numpy as np

from ..latin.outcome import Array, InterfaceHistory, Outcome, SubstructureHistory, Timings, WindowRecord
from ..latin.status import stored_energy
from ..results.quantities import BOLT, INTERFACE, REACTION, SENSOR, SUBSTRUCTURE, Rows, fields_over_time
from .loads import Curve, rule_of
from .segments import RUNNING, Segment
from .variables import HOLD, LINE

INTERFACE_FIELDS: Final = fields_over_time(INTERFACE, InterfaceHistory)

_JUMP: Final = 1e-7  # of a step: distance of the two times at which a jump is written


@dataclass(frozen=True)
class AcceptedStep:
    """A step: from ``start`` to ``end``, s; outputs at its end; loads at its start and their rates over it, 1/s; its
    segments, where they are recorded."""

    start: float
    end: float
    row: Array
    value: dict[str, float]
    rate: dict[str, float]
    segments: tuple[Segment, ...]


class Link:
    """A step and the one before it; ``identity`` is a digest of all steps up to it."""

    def __init__(self, step: AcceptedStep, before: Link | None, identity: str) -> None:
        self.step, self.before = step, before
        digest = hashlib.sha256(identity.encode())
        # repr: all digits of floats
        digest.update(repr((step.start, step.end, step.value, step.rate)).encode())
        digest.update(step.row.tobytes())
        self.identity = digest.hexdigest()[:32]


class StepHistory:
    """The accepted steps, the last of them in ``head``.

    Steps that were rolled back can be returned to while they are among the last ``RECENT`` or their link is referenced
    elsewhere. A history moved to a step that is no longer in memory starts again from there.
    """

    RECENT = 256

    def __init__(self) -> None:
        self.head: Link | None = None
        self._forgotten = ""  # identity of a last step that is not in memory
        self._links: WeakValueDictionary[str, Link] = WeakValueDictionary()
        self._recent: deque[Link] = deque(maxlen=self.RECENT)

    @property
    def identity(self) -> str:
        """Identity of the last step; empty before the first."""
        if self.head is None:
            return self._forgotten
        return self.head.identity

    def append(self, step: AcceptedStep) -> None:
        """Add a step after the last one."""
        self.head = Link(step, self.head, self.identity)
        self._links[self.head.identity] = self.head
        self._recent.append(self.head)

    def move_to(self, identity: str) -> None:
        """Make the step with this identity the last one."""
        # not known any more: None, so that the history begins anew behind that identity
        self.head, self._forgotten = self._links.get(identity), identity

    def clear(self) -> None:
        """Remove all steps."""
        self.head, self._forgotten = None, ""
        self._recent.clear()

    def __iter__(self) -> Iterator[AcceptedStep]:
        steps, link = [], self.head
        while link is not None:
            steps.append(link.step)
            link = link.before
        return reversed(steps)


def curves_of(steps: Sequence[AcceptedStep], rule: int, before: Mapping[str, Curve]) -> dict[str, Curve]:
    """Loads over accepted steps, times from the start of the first one.

    Parameters
    ----------
    rule : HOLD, RATE, LINE or CAUSAL. before : curves whose last value is that of the start.
    """
    t0 = steps[0].start
    curves: dict[str, Curve] = {}
    for name, (_, curve) in before.items():
        first = rule_of(name, rule, steps[0].rate[name])
        times, values = [0.0], [steps[0].value[name]]
        if first == LINE:
            # a line starts from the value reached, which is not among those of the step
            values = [curve[-1]]
        for step in steps:
            value, h = step.value[name], step.end - step.start
            step_rule = rule_of(name, rule, step.rate[name])
            # a jump: two times next to each other, as times of a table must increase
            if step_rule != LINE and value != values[-1]:
                times.append(times[-1] + _JUMP * h)
                values.append(value)
            if step_rule not in (HOLD, LINE):
                value = value + step.rate[name] * h
            times.append(step.end - t0)
            values.append(value)
        curves[name] = (tuple(times), tuple(values))
    return curves


# -- segments as one run ------------------------------------------------------------------------------------------
def joined(segments: Sequence[Segment], timings: Timings, warnings: tuple[str, ...]) -> Outcome:
    """Outcome of a run from segments that follow one another."""
    first = segments[0]
    indicator = max(s.error_indicator for s in segments)
    return Outcome(
        time=_joined_arrays([s.time for s in segments]),
        interfaces={
            name: _joined_fields([s.interfaces[name] for s in segments], INTERFACE) for name in first.interfaces
        },
        substructures={
            name: _joined_substructure([s.substructures[name] for s in segments]) for name in first.substructures
        },
        windows=_joined_windows(segments),
        interface_indicator={},
        converged=all(s.converged for s in segments),
        status=f"{len(segments)} accepted segment(s), largest error indicator {indicator:.3g}",
        passes=float("nan"),
        energy=_since_the_start([s.energy for s in segments]),
        sensors={name: _joined_fields([s.sensors[name] for s in segments], SENSOR) for name in first.sensors},
        reactions={name: _joined_fields([s.reactions[name] for s in segments], REACTION) for name in first.reactions},
        bolts={name: _joined_fields([s.bolts[name] for s in segments], BOLT) for name in first.bolts},
        timings=timings,
        warnings=warnings,
    )


def _joined_arrays(parts: Sequence[Array]) -> Array:
    """Values over time; the first instant of a part is the last of the one before."""
    return np.concatenate([part[(i > 0) :] for i, part in enumerate(parts)])


def _joined_fields(parts: Sequence[Any], table: Rows) -> Any:
    """A history over the instants of all parts: its stored fields over time, as far as they are kept."""
    fields = fields_over_time(table, type(parts[0]))
    names = (name for name in fields if getattr(parts[0], name) is not None)
    return replace(parts[0], **{name: _joined_arrays([getattr(part, name) for part in parts]) for name in names})


def _since_the_start(parts: Sequence[dict[str, Array] | None]) -> dict[str, Array] | None:
    """Energies of segments that count from the first instant of each, counted from that of the first segment."""
    terms = [dict(part) for part in parts if part is not None]
    if not terms:
        return None
    stored = float(stored_energy(terms[0])[0])
    for before, part in itertools.pairwise(terms):
        for name in RUNNING:
            if name in part:
                part[name] = part[name] + before[name][-1]
        part["balance"] = part["balance"] + float(stored_energy(part)[0]) - stored
    return _joined_energies(terms)


def _joined_energies(parts: Sequence[dict[str, Array] | None]) -> dict[str, Array] | None:
    terms = [part for part in parts if part is not None]
    if terms:
        return {term: _joined_arrays([part[term] for part in terms]) for term in terms[0]}
    return None


def _joined_substructure(parts: Sequence[SubstructureHistory]) -> SubstructureHistory:
    time, energy = _joined_arrays([part.time for part in parts]), _joined_energies([part.energy for part in parts])
    joined_parts: SubstructureHistory = _joined_fields(parts, SUBSTRUCTURE)
    return replace(joined_parts, time=time, energy=energy)


def _joined_windows(segments: Sequence[Segment]) -> list[WindowRecord]:
    windows, done = [], 0
    for segment in segments:
        windows += [
            replace(w, first_instant=w.first_instant + done, last_instant=w.last_instant + done)
            for w in segment.windows
        ]
        # its first instant is the last of the one before
        done += len(segment.time) - 1
    return windows
