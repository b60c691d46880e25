"""A front through a joint that is closed from the start, against the exact solution and against bonded bars.

Scene and measures are those of ``examples/front_through_joint.py``.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.assembly import models
from latin_fmu.building import discretise

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
front = importlib.import_module("front_through_joint")


@pytest.mark.parametrize("scheme", [None, "generalized_alpha"])
@pytest.mark.parametrize("rise", [0, 4])
@pytest.mark.parametrize("elements", [40, *(pytest.param(n, marks=pytest.mark.slow) for n in (80, 160))])
def test_a_front_leaves_nothing_behind(elements: int, rise: float, scheme: str | None) -> None:
    """By default and with ``generalized_alpha``: after the exact separation at most 0.3 % of the pressure, a peak of at
    most that of the bonded bars and 3 %, at most 0.5 % of the energy lost beyond theirs, the impulse to 2 %."""
    behind, peak, lost, impulse, _ = front.measured(elements, rise, scheme)
    assert behind <= 0.3
    assert peak <= 1.03
    assert abs(lost) <= 0.5
    assert abs(impulse) <= 2.0


def test_the_measures_find_chatter_and_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of HHT, and of a viscous layer at the closed faces, which the default has not."""
    assert front.measured(40, 0, "hht")[0] > 3.0
    monkeypatch.setattr(models, "_lands", lambda *_: True)
    assert front.measured(40, 0, "generalized_alpha")[2] > 1.0


@pytest.mark.parametrize(
    ("rise", "scheme"), [(0, "generalized_alpha"), (4, "generalized_alpha"), (8, "generalized_alpha"), (20, "hht")]
)
def test_the_scheme_follows_the_front(rise: float, scheme: str) -> None:
    """A load that grows by a fifth within a twentieth of a bar is a front; of slower ones HHT gives the better force.
    The same rise in time has the same scheme on any mesh."""
    for elements in (40, 80):
        scene = latin_fmu.scene_from_dict(front.bars(elements, rise * elements / 40))
        assert discretise(scene).scheme.name == scheme
