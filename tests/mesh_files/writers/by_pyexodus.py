"""pyexodus: element blocks, side sets by name."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pyexodus import exodus

from .solid import EXODUS_NAMES, Format, Solid, sides_of

TITLE: Final = "pyexodus"
REQUIRES: Final = ("pyexodus==0.1.7", "numpy")
PACKAGE: Final = "pyexodus"
FORMATS: Final = {".e": Format(".e")}


def write(solid: Solid, form: Format, path: Path) -> None:  # noqa: ARG001 - it has one format
    """The solid in a format."""
    pieces = solid.rows("exodus", flat=False)
    count = sum(len(rows) for _, rows, _ in pieces)
    sizes = [3, len(solid.points), count, len(pieces), 0, len(solid.faces)]
    file = exodus(str(path), "w", "numpy", "solid", *sizes, io_size=8)
    file.put_coords(*solid.points.T)
    for i, (kind, rows, _) in enumerate(pieces, 1):
        file.put_elem_blk_info(i, EXODUS_NAMES[kind], len(rows), rows.shape[1], 0)
        file.put_elem_connectivity(i, rows + 1)
    for i, face in enumerate(solid.faces, 1):
        elements, sides = sides_of(solid, face)
        file.put_side_set_params(i, len(elements), 0)
        file.put_side_set(i, elements, sides)
        file.put_side_set_name(i, face)
    file.close()
