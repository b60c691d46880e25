"""Kratos: a model part with a part for each body and face."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import KratosMultiphysics as Kratos

from .solid import Format, Solid

TITLE: Final = "Kratos"
REQUIRES: Final = ("KratosMultiphysics==10.4.4", "numpy")
PACKAGE: Final = "KratosMultiphysics"
FORMATS: Final = {".mdpa": Format(".mdpa", near=1e-5)}


def model_part(solid: Solid, model: Any) -> Any:
    """The solid as Kratos has it."""
    whole = model.CreateModelPart("solid")
    property_ = whole.CreateNewProperties(1)
    for i, place in enumerate(solid.points.tolist(), 1):
        whole.CreateNewNode(i, *place)
    members: dict[str, tuple[list[int], list[int], set[int]]] = {
        name: ([], [], set()) for name in (*solid.bodies, *solid.faces)
    }
    number = 0
    for _, rows, name in solid.rows("kratos"):
        word = f"Element3D{rows.shape[1]}N" if name in solid.bodies else f"SurfaceCondition3D{rows.shape[1]}N"
        for row in (rows + 1).tolist():
            number += 1
            if name in solid.bodies:
                whole.CreateNewElement(word, number, row, property_)
            else:
                whole.CreateNewCondition(word, number, row, property_)
            members[name][name in solid.faces].append(number)
            members[name][2].update(row)
    for name, (elements, conditions, nodes) in members.items():
        part = whole.CreateSubModelPart(name)
        part.AddNodes(sorted(nodes))
        part.AddElements(elements)
        part.AddConditions(conditions)
    return whole


def write(solid: Solid, form: Format, path: Path) -> None:  # noqa: ARG001 - it has one format
    """The solid in a format."""
    model = Kratos.Model()
    part = model_part(solid, model)
    Kratos.ModelPartIO(str(path.with_suffix("")), Kratos.IO.WRITE | Kratos.IO.MESH_ONLY).WriteModelPart(part)
