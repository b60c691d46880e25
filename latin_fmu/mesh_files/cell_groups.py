"""Groups of cells of a file that has numbers at its cells and no names: which of the numbers name parts.

Data that are called as programs call the part or the material of a cell name them, also where they are written as
floating point numbers. Data that number the cells (as many values as cells, or a name such as ``ElementId``) and those
of a solver (``vtkGhostType``, ranks) name nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from .content import Index

_PARTS: Final = (
    "physical",  # gmsh
    "partid",  # ANSA, LS-PrePost, FEBio
    "part",
    "objectid",  # VTK: ids of element blocks
    "elementblockids",
    "blockid",
    "block",
    "bodyid",
    "body",
    "componentid",
    "component",
    "cellentityids",  # gmsh
    "ref",  # medit
    "attribute",  # MFEM, tetgen
    "attributes",
    "geometryid",
    "subdomain",
    "subdomainid",
    "region",
    "regionid",
    "propertyid",
    "property",
    "pid",
    "materialid",
    "materialids",
    "material",
    "matid",
    "mat",
    "group",
    "geometrical",  # gmsh: entities of the geometry
)
"""Names of data that say to which part a cell belongs, without capitals and signs, the surest first."""

_NUMBERS: Final = re.compile(
    "(vtk)?(original|global|pedigree)*(element|cell|e|proc|process|processor)?(id|ids|number|label|labels|index)"
    "|element|rank|process|processor|partition|(vtk)?ghost.*|level|colou?r|(cell|element)?type"
)
"""Names of data that number cells, processes or kinds."""

_MOST_VALUES: Final = 1000  # data of unknown name with more values than this number something, they name no groups
_NO_GROUP: Final = ("gmsh:", "medit:")  # the value 0 of these is a cell in no group


def groups_of_data(cell_data: Mapping[str, Sequence[Any]], counts: Sequence[int]) -> dict[str, list[Index]]:
    """Rows of every group by block of cells, one group for each value of the data that name parts.

    Of several data of a known name the surest counts. Of unknown ones all do: where they do not agree the groups
    overlap, and which of them are parts is the choice of the user.

    Parameters
    ----------
    cell_data : values at the cells, block by block. counts : cells of each block.
    """
    tables: dict[str, list[Index]] = {}
    for key, blocks in cell_data.items():
        if (whole := _whole_numbers(blocks, counts)) is not None:
            tables[key] = whole
    named = sorted((_PARTS.index(_plain(key)), key) for key in tables if _plain(key) in _PARTS)
    integer = [key for key in tables if all(np.asarray(block).dtype.kind in "iu" for block in cell_data[key])]
    chosen = [key for _, key in named[:1]] or sorted(key for key in integer if _may_name(key, tables[key]))
    groups: dict[str, list[Index]] = {}
    for key in chosen:
        short = re.sub("[^A-Za-z0-9_]+", "_", key.split(":")[-1]).strip("_") or "group"
        for value in np.unique(np.concatenate(tables[key])).tolist():
            if value or not key.startswith(_NO_GROUP):
                groups[f"{short}_{value}"] = [np.flatnonzero(table == value) for table in tables[key]]
    return groups


def _plain(key: str) -> str:
    return re.sub("[^a-z0-9]", "", key.split(":")[-1].lower())


def _whole_numbers(blocks: Sequence[Any], counts: Sequence[int]) -> list[Index] | None:
    """Values of data with one whole number at each cell, None for other data."""
    tables = [np.asarray(block) for block in blocks]
    if len(tables) != len(counts) or not sum(counts):
        return None
    if any(table.dtype.kind not in "iuf" or table.size != n for table, n in zip(tables, counts, strict=True)):
        return None
    flat = np.concatenate([table.ravel() for table in tables])
    # whole, and exact as a floating point number
    if flat.dtype.kind == "f" and not (np.isfinite(flat).all() and (np.abs(flat) < 2**53).all() and _is_whole(flat)):
        return None
    return [table.ravel().astype(np.int64) for table in tables]


def _is_whole(values: Any) -> bool:
    return bool((values == np.rint(values)).all())


def _may_name(key: str, tables: list[Index]) -> bool:
    """Whether data of an unknown name may name parts: they are no numbers of the cells."""
    values = np.concatenate(tables)
    count = len(np.unique(values))
    return not _NUMBERS.fullmatch(_plain(key)) and count <= _MOST_VALUES and (count < len(values) or len(values) == 1)
