"""ParaView export, read back with meshio."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
import pytest

from latin_fmu import ResultsError
from latin_fmu.results import vtk
from latin_fmu.results.solution import Solution
from latin_fmu.results.vtk import export_vtu


def entries(index: Path) -> list[dict[str, str]]:
    """Attributes of the data sets a .pvd lists."""
    return [item.attrib for item in ET.parse(index).getroot().iter("DataSet")]


def test_index_lists_every_file_with_its_time(crushing: Solution, tmp_path: Path) -> None:
    index = export_vtu(crushing, tmp_path / "out")
    listed = entries(index)
    assert {item["file"] for item in listed} == {path.name for path in index.parent.glob("*.vtu")}
    stored = crushing.substructures["lower"].time
    for part in ("substructure_lower", "interface_crush"):
        times = [float(item["timestep"]) for item in listed if item["name"] == part]
        np.testing.assert_array_equal(times, stored)
    assert len({(item["timestep"], item["part"]) for item in listed}) == len(listed)


def test_substructure_fields(crushing: Solution, tmp_path: Path) -> None:
    history = crushing.substructures["lower"]
    export_vtu(crushing.to_datatree(), tmp_path / "out")
    mesh = meshio.read(tmp_path / "out" / "substructure_lower_00007.vtu")
    np.testing.assert_array_equal(mesh.points, history.nodes)
    np.testing.assert_array_equal(mesh.cells_dict["hexahedron"], history.cells)
    np.testing.assert_array_equal(mesh.point_data["displacement"], history.displacement[7])
    np.testing.assert_array_equal(mesh.point_data["velocity"], history.velocity[7])
    xx, yy, zz, yz, xz, xy = history.stress[7, 0]
    np.testing.assert_array_equal(mesh.cell_data["stress"][0], [[xx, yy, zz, xy, yz, xz]])
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    deviator = tensor - np.trace(tensor) / 3.0 * np.eye(3)
    assert mesh.cell_data["von_mises"][0][0] == pytest.approx(np.sqrt(1.5 * np.sum(deviator**2)))


def test_interface_points(crushing: Solution, tmp_path: Path) -> None:
    history = crushing.interfaces["crush"]
    export_vtu(crushing, tmp_path / "out")
    mesh = meshio.read(tmp_path / "out" / "interface_crush_00030.vtu")  # fields are stored at every other instant
    np.testing.assert_array_equal(mesh.points, history.points)
    np.testing.assert_array_equal(mesh.point_data["traction"], history.traction[60])
    np.testing.assert_array_equal(mesh.point_data["contact_status"], history.contact_status[60])
    np.testing.assert_array_equal(mesh.point_data["gap"], history.gap[60])
    np.testing.assert_array_equal(mesh.point_data["velocity_Ep"], history.velocity[60, 1])
    assert mesh.point_data["pressure"].max() == pytest.approx(-history.traction[60, :, 2].min())


def test_without_fields_all_instants_of_the_interfaces(bars: Solution, tmp_path: Path) -> None:
    listed = entries(export_vtu(bars, tmp_path / "out"))
    assert {item["name"] for item in listed} == {"interface_joint", "interface_contact"}
    assert len(listed) == 2 * bars.time.size


def test_a_second_export_replaces_the_first(crushing: Solution, bars: Solution, tmp_path: Path) -> None:
    export_vtu(bars, tmp_path / "out")
    index = export_vtu(crushing, tmp_path / "out")
    assert not list(index.parent.glob("*joint*"))
    assert list(tmp_path.iterdir()) == [tmp_path / "out"]


def test_folders_of_others_are_left_alone(crushing: Solution, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    for folder, words in [
        (tmp_path, "holds other files"),
        (tmp_path / "thesis.tex", "not a folder"),
        (tmp_path / "a" / "b", "does not exist"),
    ]:
        with pytest.raises(ResultsError, match=words):
            export_vtu(crushing, folder)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_failure_keeps_the_former_export(crushing: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = export_vtu(crushing, tmp_path / "out")
    before = sorted(path.name for path in index.parent.iterdir())

    def full_disk(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(vtk, "_vtu", full_disk)
    with pytest.raises(ResultsError, match="No space left"):
        export_vtu(crushing, tmp_path / "out")
    assert sorted(path.name for path in index.parent.iterdir()) == before
    assert list(tmp_path.iterdir()) == [tmp_path / "out"]
