"""The accepted steps of a session: a chain one can go back along, so that steps rolled back are never stored."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakValueDictionary

from ..assembly.segments import Segment
from ..latin.record import Array


@dataclass(frozen=True)
class AcceptedStep:
    """A step: from ``start`` to ``end``, s; outputs at its end; loads during it; its segment (windowed mode)."""

    start: float
    end: float
    row: Array
    value: dict[str, float]
    rate: dict[str, float]
    segment: Segment | None


class Link:
    """A step and the one before it. Its identity is a digest of all steps up to it."""

    def __init__(self, step: AcceptedStep, before: Link | None, identity: str) -> None:
        self.step, self.before = step, before
        digest = hashlib.sha256(identity.encode())
        digest.update(repr((step.start, step.end, step.value, step.rate)).encode())
        digest.update(step.row.tobytes())
        self.identity = digest.hexdigest()[:32]


class Chain:
    """The steps accepted so far.

    Links of other branches are found again while they are among the last ``RECENT`` or somebody holds them
    (``head``); a chain moved to a link that is gone begins there anew.
    """

    RECENT = 256

    def __init__(self) -> None:
        self.head: Link | None = None
        self._gone = ""  # identity of a last step whose link is gone
        self._known: WeakValueDictionary[str, Link] = WeakValueDictionary()
        self._recent: deque[Link] = deque(maxlen=self.RECENT)

    @property
    def identity(self) -> str:
        """Of the last step; empty before the first."""
        return self._gone if self.head is None else self.head.identity

    def append(self, step: AcceptedStep) -> None:
        """Add a step."""
        self.head = Link(step, self.head, self.identity)
        self._known[self.head.identity] = self.head
        self._recent.append(self.head)

    def move_to(self, identity: str) -> None:
        """Make the step of this identity the last one."""
        self.head, self._gone = self._known.get(identity), identity

    def clear(self) -> None:
        """Forget the steps."""
        self.head, self._gone = None, ""
        self._recent.clear()

    def __iter__(self) -> Iterator[AcceptedStep]:
        steps, link = [], self.head
        while link is not None:
            steps.append(link.step)
            link = link.before
        return reversed(steps)
