"""exodus-helper: element blocks by name, side sets or node sets by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from exodus_helper import Exodus

from .solid import EXODUS_NAMES, Format, Solid, sides_of

TITLE: Final = "exodus-helper"
REQUIRES: Final = ("exodus-helper==1.6.0", "numpy")
PACKAGE: Final = "exodus-helper"
FORMATS: Final = {
    ".e, side sets": Format(".e", option="sides"),
    ".g, node sets": Format(".g", option="nodes"),
    ".e of 64 bits": Format(".e", option="large"),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    pieces = solid.rows("exodus", flat=False)
    by_nodes = form.option == "nodes"
    sizes: dict[str, Any] = {
        "num_dim": 3,
        "num_nodes": len(solid.points),
        "num_elem": sum(len(rows) for _, rows, _ in pieces),
        "num_el_blk": len(pieces),
        "num_node_sets": len(solid.faces) if by_nodes else 0,
        "num_side_sets": 0 if by_nodes else len(solid.faces),
    }
    file = Exodus(str(path), mode="w", **sizes)
    file.put_coords(*solid.points.T)
    several = len({body for _, _, body in pieces}) < len(pieces)  # a block has one type of cells
    for i, (kind, rows, body) in enumerate(pieces, 1):
        file.put_elem_blk_info(i, EXODUS_NAMES[kind], len(rows), rows.shape[1], 0)
        file.put_elem_connectivity(i, (rows + 1).ravel().astype(np.int64 if form.option == "large" else np.int32))
        file.put_elem_blk_name(i, f"{body}_{kind}" if several else body)
    for i, face in enumerate(solid.faces, 1):
        if by_nodes:
            nodes = solid.nodes_of(face) + 1
            file.put_node_set_params(i, len(nodes))
            file.put_node_set(i, nodes)
            continue
        elements, sides = sides_of(solid, face)
        file.put_side_set_params(i, len(elements), 0)
        file.put_side_set(i, elements, sides)
        file.put_side_set_name(i, face)
    if by_nodes:
        file.put_node_set_names(list(solid.faces))
    file.close()
