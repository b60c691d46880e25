"""What each kind of load says of itself: amount, unit, arrow; each key that chooses one has a unit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latin_fmu import tables
from latin_fmu.scene.describe import unit_of
from latin_fmu.scene.loads import LOAD_KINDS, Load, load_unit

NORMAL = np.array([0.0, 0.0, 1.0])
TURNED = {"x": [0.0, 1.0, 0.0], "y": [-1.0, 0.0, 0.0]}  # x of the load is y


@pytest.mark.parametrize(
    ("keys", "amount", "unit", "arrow"),
    [
        ({"pressure": 2.0}, 2.0, "Pa", [0.0, 0.0, -1.0]),
        ({"pressure": -2.0}, -2.0, "Pa", [0.0, 0.0, 1.0]),
        ({"pressure": 0.0}, 0.0, "Pa", [0.0, 0.0, -1.0]),
        ({"traction": [3.0, 0.0, 4.0], "axes": TURNED}, 5.0, "Pa", [0.0, 3.0, 4.0]),
        ({"force": [2.0, 0.0, 0.0], "moment": [0.0, 0.0, 9.0], "axes": TURNED}, 2.0, "N", [0.0, 2.0, 0.0]),
        ({"moment": [2.0, 0.0, 0.0], "axes": TURNED}, 2.0, "N m", [0.0, 2.0, 0.0]),
        ({"nodal_force": [2.0, 0.0, 0.0], "axes": TURNED}, 2.0, "N", [0.0, 2.0, 0.0]),
    ],
)
def test_a_load_says_amount_and_arrow(keys: dict[str, Any], amount: float, unit: str, arrow: list[float]) -> None:
    load = Load(face="cube.zmax", **keys)
    assert (load.amount, load.unit) == (amount, unit)
    assert load_unit(keys) == unit
    assert np.allclose(load.arrow(NORMAL), arrow, atol=1e-15)
    assert load.turns() == ("moment" in keys)


def test_every_kind_is_complete() -> None:
    assert len(LOAD_KINDS) == 4
    for kind in LOAD_KINDS:
        assert all(unit_of(kind.model_fields[key]) for key in kind.chosen_by)
        # what would be asked of `Load` itself, for ever
        assert {"nodal_forces", "largest_traction", "arrow"} <= vars(kind).keys()
        assert str(kind.__doc__) in str(tables.Load.__doc__)
