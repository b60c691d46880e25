"""Guard words between the arrays of every image, checked after each call of the kernels; a plugin of pytest.

    python -m pytest -p tests.guards

A kernel that writes behind the end of an array of state, work, output or histories changes a guard word, and the call
that did it fails with the places. Reading one gives NaN, which the tests of results find.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from latin_fmu.kernels.team import LINE
from latin_fmu.propagator.class_record import BlockLayout
from latin_fmu.propagator.image import Image

WORD = np.array(np.nan)
PATTERN = WORD.view(np.int64).item()
_reserve, _lay_out, _begin, _call = BlockLayout.reserve, Image._lay_out_moving, Image.begin, Image.call
_collected: list[list[int]] = []  # of the layouts that are being made, the innermost last


def reserve(self: BlockLayout, size: int, owner: Any = None) -> int:
    """A line of guard words behind the array."""
    before = self.size
    at = _reserve(self, size, owner)
    if self.size > before:
        if _collected:
            _collected[-1].append(self.size)
        self.size += LINE
    return at


def lay_out(self: Image) -> None:
    """Places of state, work and output, with guards."""
    _collected.append([])
    _lay_out(self)
    self.guards = _collected.pop()
    self.history_guards: list[int] = []


def begin(self: Image, *arguments: Any) -> None:
    """Histories with guards; those of the last segment are gone."""
    _collected.append([])
    _begin(self, *arguments)
    self.history_guards = _collected.pop()


def words(image: Image) -> Any:
    """Places of all guard words."""
    starts = np.array([*image.guards, *image.history_guards], dtype=np.int64)
    return (starts[:, None] + np.arange(LINE)).ravel()


def call(self: Image, action: int, *arguments: int) -> int:
    """The call, and a look at the guards."""
    places = words(self)
    places = places[places < len(self.moving)]
    self.moving[places] = WORD  # states that were kept and are put back hold older words
    result = _call(self, action, *arguments)
    changed = places[self.moving[places].view(np.int64) != PATTERN]
    assert not len(changed), f"action {action} of the kernels wrote guard words at {changed[:8].tolist()}"
    return result


BlockLayout.reserve, Image._lay_out_moving, Image.begin, Image.call = reserve, lay_out, begin, call  # type: ignore[method-assign]
