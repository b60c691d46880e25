"""Natural frequencies and shapes of an assembly as results: table, groups of a file, files for ParaView.

::

    /                      provenance and scene, as attributes
    /modes                 frequency, rigid, modal_mass (mode); joints and interfaces as attributes
    /substructures/<name>  shape (mode, node, component), and the mesh
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..latin.record import Array
from ..latin.recorder import SubstructureInfo
from ..machine import provenance
from .dataset import AXES, datatree
from .files import write_groups
from .groups import CONVENTIONS, MODES, SCHEMA_VERSION, Columns, Group, annotated, describe_mesh
from .summary import aligned, readable
from .vtk import export_vtu


@dataclass(frozen=True)
class VibrationModes:
    """Modes of an assembly, undamped.

    Attributes
    ----------
    scene, name : text and name of the scene. joints : how interfaces that may open were taken.
    frequency : (n_mode,), Hz, 0 for rigid motions, which come first. rigid : (n_mode,) whether it is one.
    modal_mass : (n_mode,), kg, with shapes whose largest nodal displacement is 1.
    shapes : (n_mode, n_node, 3) by substructure. meshes : of the substructures. remarks : on every interface.
    """

    scene: str
    name: str
    joints: str
    frequency: Array
    rigid: NDArray[np.bool_]
    modal_mass: Array
    shapes: Mapping[str, Array]
    meshes: Mapping[str, SubstructureInfo]
    remarks: tuple[str, ...]

    @property
    def n_rigid(self) -> int:
        """Number of rigid motions."""
        return int(self.rigid.sum())

    def lines(self) -> list[str]:
        """Text: the joints, and a table of the modes."""
        head = f"{self.name}: joints {self.joints}, {self.n_rigid} rigid motion(s), {int((~self.rigid).sum())} mode(s)"
        rows: list[tuple[str, ...]] = [("mode", "frequency", "modal mass", "moves most", "mean squares along x, y, z")]
        if self.n_rigid:
            rows.append((f"1 to {self.n_rigid}" if self.n_rigid > 1 else "1", "rigid", "-", "-", "-"))
        for i in range(self.n_rigid, len(self.frequency)):
            largest = {name: float(np.linalg.norm(shape[i], axis=1).max()) for name, shape in self.shapes.items()}
            squares = sum(np.square(shape[i]).sum(axis=0) for shape in self.shapes.values())
            shares = ", ".join(f"{100 * share:.0f} %" for share in squares / np.sum(squares))
            text = f"{self.frequency[i]:.5g} Hz"
            moves = max(largest, key=lambda name: largest[name])
            rows.append((f"{i + 1}", text, readable(self.modal_mass[i], "kg", 3), moves, shares))
        return [head, *(f"  {remark}" for remark in self.remarks), "", *aligned(rows)]

    def groups(self) -> dict[str, Group]:
        """Groups by path: ``modes`` and one for every substructure with its shapes and mesh."""
        number = np.arange(1, len(self.frequency) + 1, dtype=np.int32)
        columns: Columns = {
            "frequency": ("mode", self.frequency),
            "rigid": ("mode", self.rigid.astype(np.int8)),
            "modal_mass": ("mode", self.modal_mass),
        }
        attrs: dict[str, object] = {"joints": self.joints, "interfaces": "\n".join(self.remarks)}
        groups = {"/": self._root(), "/modes": annotated(Group.of(columns, {"mode": number}, attrs), MODES)}
        for name, shape in self.shapes.items():
            groups[f"/substructures/{name}"] = _shapes(shape, number, self.meshes[name])
        return groups

    def _root(self) -> Group:
        return Group(
            {},
            attrs={
                **provenance(),
                "Conventions": CONVENTIONS,
                "schema_version": SCHEMA_VERSION,
                "title": f"{self.name}: natural frequencies and shapes",
                "scene_name": self.name,
                "scene": self.scene,
            },
        )

    def to_datatree(self) -> xr.DataTree:
        """Everything as an xarray DataTree."""
        return datatree(self.groups(), self.name)

    def save(self, path: str | Path) -> None:
        """Write a netCDF-4 file, complete or not at all.

        Raises
        ------
        ResultsError : the file cannot be written.
        """
        write_groups(self.groups(), path)

    def export(self, folder: str | Path) -> Path:
        """Write files for ParaView, in which the number of the mode stands in the place of the time; the .pvd file.

        Raises
        ------
        ResultsError : the folder cannot be used.
        """
        bodies = {path: group for path, group in self.groups().items() if path.startswith("/substructures/")}
        played = {path: group.dataset().rename(mode="time") for path, group in bodies.items()}
        return export_vtu(xr.DataTree.from_dict(played), folder)


def _shapes(shape: Array, number: NDArray[np.int32], mesh: SubstructureInfo) -> Group:
    """Group of one substructure: its shapes and its mesh."""
    columns: Columns = {
        "shape": (("mode", "node", "component"), shape),
        "cell_nodes": (("cell", "cell_node"), mesh.cells),
        "mesh": ((), np.int32(0)),
    }
    positions = {f"node_{axis}": ("node", mesh.nodes[:, i]) for i, axis in enumerate(AXES)}
    group = annotated(Group.of(columns, {"mode": number, "component": AXES, **positions}), MODES)
    describe_mesh(group, mesh.cell_type, "mode")
    return group
