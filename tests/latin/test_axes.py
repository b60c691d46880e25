"""Interface fields turned into global axes, and the median of the sides' resistances, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.interface.geometry import Rotation
from latin_fmu.latin.search_direction import _median

Array = np.ndarray


def frames(kind: str, n_point: int) -> Array:
    """Local axes (n_point, 3, 3): along the global ones (some reversed), turned, or turning from point to point."""
    rng = np.random.default_rng(1)
    if kind == "along the axes":
        one = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        return np.repeat(one[None], n_point, axis=0)
    turned = np.linalg.qr(rng.normal(size=(n_point, 3, 3)))[0]
    return turned if kind == "turning" else np.repeat(turned[:1], n_point, axis=0)


@pytest.mark.parametrize("n_component", [1, 3])
@pytest.mark.parametrize("kind", ["along the axes", "turned", "turning"])
def test_rotation_into_global_axes(kind: str, n_component: int) -> None:
    """A part of a larger array, as the histories of an interface are."""
    whole = np.random.default_rng(2).normal(size=(4, 2, 9, n_component))
    axes = frames(kind, 5)[:, :n_component]
    for values in (whole[:, :, 2:7], whole[:, 0, 2:7], whole[:0, 0, 2:7]):
        actual = Rotation(axes)(values)
        np.testing.assert_allclose(actual, np.einsum("...pc,pci->...pi", values, axes), atol=1e-15)


@pytest.mark.parametrize("n", [1, 2, 3, 8, 25])
def test_median(n: int) -> None:
    values = np.random.default_rng(n).normal(size=n)
    assert _median(values) == np.median(values)
