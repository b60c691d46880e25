"""Dense matrices of contact faces in patches: partition, error, products of the kernels."""

from __future__ import annotations

from zlib import compress

import numpy as np
import pytest

from latin_fmu.kernels.patched import memory_for, patched_norms, patched_product
from latin_fmu.propagator.patches import Patches, in_patches, leave_out_digits, partition

POINTS = 24  # of each face


def faces(count: int, apart: float, seed: int) -> np.ndarray:
    """Points (3 POINTS count, 3) of square faces at distances ``apart``, three rows each."""
    rng = np.random.default_rng(seed)
    points = [rng.uniform(0.0, 1.0, (POINTS, 3)) + np.array([apart * k, 0.0, 0.0]) for k in range(count)]
    return np.repeat(np.concatenate(points), 3, axis=0)


def by_face(count: int) -> list[np.ndarray]:
    """Rows of each face, in a mixed order of the faces."""
    rows = np.arange(3 * POINTS * count).reshape(count, -1)
    return [rows[k] for k in np.random.default_rng(4).permutation(count)]


def compliance(places: np.ndarray) -> np.ndarray:
    """Kelvin's solution, smoothed at the point itself: displacement along the axes for forces along them."""
    n = len(places) // 3
    points, matrix = places[::3], np.empty((n, 3, n, 3))
    for i in range(n):
        r = points - points[i]
        size = np.sqrt((r**2).sum(axis=1) + 0.2**2)
        both = np.einsum("ja,jb->jab", r, r) / size[:, None, None] ** 3
        matrix[i] = (2.0 * np.eye(3) / size[:, None, None] + both).transpose(1, 0, 2)
    return matrix.reshape(3 * n, 3 * n)


def product(patches: Patches, x: np.ndarray) -> np.ndarray:
    """A x by the kernel."""
    out = np.empty(len(x))
    patched_product(patches.header, patches.numbers, x, out, np.empty(4 * len(x)))
    return out


@pytest.mark.parametrize(("kind", "tolerance"), [(np.float64, 1e-12), (np.float64, 1e-6), (np.float32, 1e-6)])
def test_products_are_those_of_the_matrix_within_the_tolerance(kind: type, tolerance: float) -> None:
    places = faces(4, 3.0, 5)
    matrix = compliance(places)
    patches = in_patches(matrix, by_face(4), tolerance, kind)
    assert patches.ranks.min() > 0
    assert patches.ranks.max() <= 3 * POINTS
    columns = np.random.default_rng(6).normal(size=(3, len(places)))
    scale = np.sqrt(matrix.diagonal())
    largest = np.linalg.eigvalsh(matrix / (scale[:, None] * scale)).max()
    for x in columns:
        off = (product(patches, x) - matrix @ x) / scale
        # two bases for each block, and the rounding of what is kept
        assert np.linalg.norm(off) <= 4.0 * tolerance * largest * np.linalg.norm(scale * x)


@pytest.mark.parametrize("rounding", [1e-3, 1e-5])
def test_rounding_changes_the_product_by_what_is_allowed_and_leaves_few_digits(rounding: float) -> None:
    """By the norm of the scaled matrix; what is kept takes a part of the bytes when deflated."""
    places = faces(4, 3.0, 12)
    matrix = compliance(places)
    whole, short = (in_patches(matrix, by_face(4), 1e-7, np.float32) for _ in range(2))
    leave_out_digits(short.header, short.numbers, rounding)
    scale = np.sqrt(matrix.diagonal())
    largest = np.linalg.eigvalsh(matrix / (scale[:, None] * scale)).max()
    for x in np.random.default_rng(13).normal(size=(3, len(places))):
        change = np.linalg.norm((product(short, x / scale) - product(whole, x / scale)) / scale)
        assert 0.05 * rounding * largest <= change / np.linalg.norm(x) <= rounding * largest
    sizes = [len(compress(patches.numbers.tobytes(), 9)) for patches in (short, whole)]
    assert sizes[0] < (0.6 if rounding > 1e-4 else 0.85) * sizes[1]
    assert whole.numbers.dtype == short.numbers.dtype == np.float32


def test_the_matrix_in_patches_is_symmetric() -> None:
    places = faces(3, 2.0, 7)
    matrix = compliance(places)
    patches = in_patches(matrix, by_face(3), 1e-5, np.float32)
    x, y = np.random.default_rng(8).normal(size=(2, len(places)))
    first, second = float(y @ product(patches, x)), float(x @ product(patches, y))
    assert abs(first - second) <= 1e-13 * np.linalg.norm(x) * np.linalg.norm(y) * np.linalg.norm(matrix)


def test_norms_are_those_of_the_products() -> None:
    places = faces(4, 2.0, 9)
    matrix = compliance(places)
    patches = in_patches(matrix, by_face(4), 1e-6, np.float64)
    rows, found = np.random.default_rng(10).normal(size=(4, len(places))), np.empty(6)
    patched_norms(patches.header, patches.numbers, rows.ravel(), 2, np.empty(8 * len(places)), found)
    for first, second, norms in zip(rows[::2], rows[1::2], found.reshape(2, 3), strict=True):
        on_first, on_second = product(patches, first), product(patches, second)
        expected = first @ on_first, second @ on_second, second @ on_first
        np.testing.assert_allclose(norms, expected, rtol=1e-11)


def test_products_in_single_precision_are_those_in_double_within_its_round_off() -> None:
    places = faces(4, 3.0, 11)
    patches = in_patches(compliance(places), by_face(4), 1e-6, np.float32)
    x, out = np.random.default_rng(12).normal(size=len(places)), np.empty(len(places))
    patched_product(patches.header, patches.numbers, x, out, memory_of_single(4 * len(places), patches))
    off = np.abs(out - product(patches, x)).max() / np.abs(out).max()
    assert 0.0 < off <= len(places) * np.finfo(np.float32).eps


def memory_of_single(size: int, patches: Patches) -> np.ndarray:
    """Memory of so many numbers of float64 as one of numbers of the kind of the matrix."""
    whole: np.ndarray = memory_for(np.empty(size), patches.numbers)
    assert whole.dtype == np.float32
    assert len(whole) == 2 * size
    return whole


def test_patches_are_the_faces_and_read_less_than_the_matrix() -> None:
    places = faces(4, 6.0, 11)
    matrix = compliance(places)
    parts = partition(places, matrix, 1e-5)
    assert sorted(len(part) for part in parts) == [3 * POINTS] * 4
    assert all(np.ptp(places[part, 0]) < 1.0 for part in parts)
    patches = in_patches(matrix, parts, 1e-5, np.float32)
    assert patches.reads < 0.6 * len(places) * (len(places) + 1) / 2


def test_one_face_stays_one_patch() -> None:
    places = faces(1, 0.0, 12)
    matrix = compliance(places)
    parts = partition(places, matrix, 1e-12)
    patches = in_patches(matrix, parts, 1e-12, np.float64)
    x = np.random.default_rng(13).normal(size=len(places))
    np.testing.assert_allclose(product(patches, x), matrix @ x, rtol=1e-11, atol=1e-11)


def test_no_points_and_two() -> None:
    for n in (0, 2):
        matrix = np.eye(3 * n)
        parts = partition(np.zeros((3 * n, 3)), matrix, 1e-6)
        np.testing.assert_array_equal(
            product(in_patches(matrix, parts, 1e-6, np.float64), np.ones(3 * n)), np.ones(3 * n)
        )
