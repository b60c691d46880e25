"""MED files: families without groups, groups of cells, facets and nodes, the order of middle nodes, the unit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.reading import read_content

from .decks import cube, read_mesh

h5py = pytest.importorskip("h5py")

STEP = "-0000000000000000001-0000000000000000001"
Families = Mapping[int, list[str]]


def write_med(
    path: Path,
    nodes: np.ndarray,
    cells: Mapping[str, tuple[np.ndarray, np.ndarray]],
    families: Families,
    of_nodes: tuple[np.ndarray, Families] | None = None,
    unit: str = "",
) -> None:
    """A file as the library of Salome writes it.

    cells : connectivity (from 0) and families of each type. families : groups by number. of_nodes : families of the
    nodes, and their groups.
    """
    with h5py.File(path, "w") as file:
        mesh = file.create_group("ENS_MAA/part")
        mesh.attrs["UNI"] = np.bytes_(unit.ljust(16) * 3)
        step = mesh.create_group(STEP)
        place = step.create_group("NOE")
        place.create_dataset("COO", data=nodes.T.ravel()).attrs["NBR"] = len(nodes)
        if of_nodes is not None:
            place.create_dataset("FAM", data=of_nodes[0])
        for code, (table, numbers) in cells.items():
            group = step.create_group(f"MAI/{code}")
            group.create_dataset("NOD", data=(table + 1).T.ravel()).attrs["NBR"] = len(table)
            if numbers.any():
                group.create_dataset("FAM", data=numbers)
        file.create_group("FAS/part/FAMILLE_ZERO").attrs["NUM"] = 0
        for kind, table in (("ELEME", families), ("NOEUD", of_nodes[1] if of_nodes else {})):
            for number, groups in table.items():
                family = file.create_group(f"FAS/part/{kind}/Family_{number}")
                family.attrs["NUM"] = number
                if groups:
                    rows = np.zeros((len(groups), 80), np.int8)
                    for row, name in zip(rows, groups, strict=True):
                        row[: len(name)] = np.frombuffer(name.encode(), np.int8)
                    family.create_dataset("GRO/NOM", data=rows)


def test_families_without_groups_are_read(tmp_path: Path) -> None:
    """Two groups of cells, one of facets beside facets in none, one of nodes: a family of each without groups."""
    box = cube()
    top, base = (box.faces[name].blocks[0].facets for name in ("zmax", "zmin"))
    cells: dict[str, Any] = {
        "HE8": (box.blocks[0].cells, np.repeat([-1, -5], 4)),
        "QU4": (np.concatenate([top, base]), np.repeat([-2, -3], 4)),
    }
    of_nodes = np.where(box.nodes[:, 0] < 1.1, 1, 2)
    families = {-1: ["low", "all"], -2: ["top"], -3: [], -5: ["up", "all"]}
    write_med(tmp_path / "part.med", box.nodes, cells, families, (of_nodes, {1: ["left"], 2: []}), "mm")
    content = read_content(tmp_path / "part.med")
    assert content.unit == "mm"
    assert set(content.facets) == {"top"}
    assert content.part_names("part.med") == ("low", "up")
    up = mesh_of(content, "part.med", "up")
    assert face(up, "top").areas.sum() == pytest.approx(1.0, rel=1e-12)
    assert face(read_mesh(tmp_path / "part.med"), "left").areas.sum() == pytest.approx(1.0, rel=1e-12)


def test_several_meshes_are_named(tmp_path: Path) -> None:
    box = cube()
    write_med(tmp_path / "part.med", box.nodes, {"HE8": (box.blocks[0].cells, np.zeros(8, int))}, {})
    with h5py.File(tmp_path / "part.med", "a") as file:
        file.create_group("ENS_MAA/other")
    with pytest.raises(MeshError, match=r"does not hold one mesh.*other, part"):
        read_content(tmp_path / "part.med")


def test_polyhedra_are_refused(tmp_path: Path) -> None:
    box = cube()
    write_med(tmp_path / "part.med", box.nodes, {"POE": (box.blocks[0].cells, np.zeros(8, int))}, {})
    with pytest.raises(MeshError, match=r"cells of a type that is not read.*POE"):
        read_content(tmp_path / "part.med")
