"""What the propagators of a run say of their accuracy."""

from __future__ import annotations

from collections.abc import Iterable

from .march import March
from .protocol import Propagator


def accuracy_remarks(propagators: Iterable[Propagator]) -> list[str]:
    """Sentences of the propagators that change the answer by more than the tolerance of the iteration."""
    return [remark for p in propagators if isinstance(p, March) for remark in p.remarks()]
