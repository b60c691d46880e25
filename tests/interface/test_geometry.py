"""Interface geometry, Eqs. (18)-(19): frames and traces in the local frame."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from latin_fmu.interface import InterfaceGeometry
from latin_fmu.interface.geometry import local_frames


def random_normals(n: int) -> np.ndarray:
    normals = np.random.default_rng(3).normal(size=(n, 3))
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def test_frames_are_right_handed_with_the_normal_first() -> None:
    normals = np.concatenate([random_normals(50), np.eye(3), -np.eye(3)])
    frames = local_frames(normals)
    np.testing.assert_allclose(frames[:, 0], normals, atol=1e-15)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, 1, 2), np.tile(np.eye(3), (56, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-14)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_tangents_follow_the_axes_where_the_normal_does(axis: int, sign: float) -> None:
    """Round-off in the normal never leaks one direction into another (a held direction stays held)."""
    normal = sign * np.eye(3)[axis] + 1e-16
    frame = local_frames(normal[None])[0]
    assert np.count_nonzero(frame) == 3
    assert set(np.unique(np.abs(frame))) == {0.0, 1.0}
    assert not np.signbit(frame[frame == 0.0]).any()  # equal interfaces compare equal, bit by bit


def test_local_trace_takes_components_along_the_frame() -> None:
    n_point, n_node = 4, 7
    rng = np.random.default_rng(5)
    nodes = np.array([6, 0, 3, 2])
    columns = (3 * nodes[:, None] + np.arange(3)).ravel()
    pick = sp.csr_array((np.ones(12), (np.arange(12), columns)), shape=(12, 3 * n_node))
    frames = local_frames(random_normals(n_point))
    geometry = InterfaceGeometry(
        rng.normal(size=(n_point, 3)), np.ones(n_point), frames, np.zeros(n_point), (pick, None)
    )
    assert geometry.n_point == n_point
    values = rng.normal(size=(n_node, 3))
    for n_component in (1, 3):
        trace = geometry.local_trace(0, n_component)
        assert trace is not None
        expected = np.einsum("pci,pi->pc", frames[:, :n_component], values[nodes])
        np.testing.assert_allclose(trace @ values.ravel(), expected.ravel(), atol=1e-14)
    assert geometry.local_trace(1, 3) is None
