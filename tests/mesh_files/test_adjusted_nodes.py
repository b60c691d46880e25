"""ADJUST of a contact pair moves nodes of its slave onto the master."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.mesh_files.abaqus import read_abaqus
from latin_fmu.mesh_files.adjusted_nodes import adjusted, has_adjusted, surface_rows
from tests.decks.blocks import STEEL, contact, two_blocks


def deck(pair: str) -> str:
    """Two blocks 0.05 apart, the lower face of the upper one tilted by another 0.1 over its length."""
    text = two_blocks((1, 1, 1), 0.05).replace("10, 10.0, 0.0, 10.05", "10, 10.0, 0.0, 10.15")
    text = text.replace("12, 10.0, 10.0, 10.05", "12, 10.0, 10.0, 10.15")
    return text + STEEL + "*NSET, NSET=SOME\n10, 11\n" + contact(pair=pair)


@pytest.mark.parametrize(
    ("pair", "heights"),
    [
        (", ADJUST=0.01", [10.05, 10.15, 10.05, 10.15]),
        (", ADJUST=0.06", [10.0, 10.15, 10.0, 10.15]),
        (", ADJUST=0.2", [10.0, 10.0, 10.0, 10.0]),
        (", ADJUST=SOME", [10.05, 10.0, 10.0, 10.15]),
    ],
)
def test_nodes_within_reach_are_moved(pair: str, heights: list[float]) -> None:
    """Those within the distance, or in the set; others stay, and the master does."""
    content = read_abaqus(deck(pair), "deck.inp", lambda _: "")
    assert has_adjusted(content)
    moved = adjusted(content)
    np.testing.assert_allclose(moved.points[8:12, 2], heights)
    np.testing.assert_array_equal(
        np.delete(moved.points, slice(8, 12), axis=0), np.delete(content.points, slice(8, 12), axis=0)
    )
    np.testing.assert_array_equal(content.labels[surface_rows(content, "HIGHDOWN")], [9, 10, 11, 12])


def test_without_the_word_nothing_is_adjusted() -> None:
    assert not has_adjusted(read_abaqus(deck(""), "deck.inp", lambda _: ""))
