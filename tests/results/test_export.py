"""Sensors in tables and universal files: what is read back from them is what the run has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.stability.scenes import Box, Material, column

STEEL = Material(210e9, 7800.0, 0.3, "steel")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A block on its way, in mm, t, s, MPa, with a filtered sensor and one with a spectrum."""
    block = Box(Material(210e3, 7.8e-9, 0.3, "steel"), (10.0, 10.0, 10.0), (1, 1, 2))
    data = column(
        {"block": block},
        {},
        {"end": 2e-5, "instants": 50},
        load={"hit": {"face": "block.zmax", "pressure": 10.0, "law": {"type": "half_sine", "duration": 1e-5}}},
        sensor={
            "top": {"face": "block.zmax", "spectrum": {"lowest": 1e4, "highest": 4e5, "per_octave": 3}},
            "foot": {"face": "block.zmin", "filter": {"type": "low_pass", "cutoff": 3e5}},
        },
        units="mm-t-s-MPa",
    )
    path = tmp_path_factory.mktemp("export") / "out.nc"
    latin_fmu.solve(latin_fmu.scene_from_dict(data)).save(path)
    return path


def functions(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray, list[str]]]:
    """Abscissa, values and the records 6 to 11 of every dataset 58 of a universal file, by the first line."""
    found, lines = {}, path.read_text(encoding="utf-8").splitlines()
    assert all(len(line) <= 80 for line in lines)
    starts = [i for i, line in enumerate(lines) if line == "    -1"]
    assert len(starts) % 2 == 0
    for first, last in zip(starts[::2], starts[1::2], strict=True):
        if lines[first + 1].strip() != "58":
            assert lines[first + 1].strip() == "164"
            continue
        block = lines[first + 2 : last]
        kind, n, even = (int(x) for x in (block[6][:10], block[6][10:20], block[6][20:30]))
        start, step = float(block[6][30:43]), float(block[6][43:56])
        assert kind == 4
        numbers = [float(x) for line in block[11:] for x in line.split()]
        x = start + step * np.arange(n) if even else np.array(numbers[::2])
        found[block[0]] = x, np.array(numbers if even else numbers[1::2]), block[5:11]
    return found


def test_universal_file(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(file)]) == 0
    assert "out_sensors.unv" in capsys.readouterr().out
    read, tree = functions(file.with_name("out_sensors.unv")), latin_fmu.open_results(file)
    for name in ("top", "foot"):
        node = tree[f"sensors/{name}"]
        for motion, data in (("displacement", 8), ("velocity", 11), ("acceleration", 12)):
            for axis, letter in enumerate("xyz"):
                x, values, records = read[f"{name} {motion} {letter}"]
                np.testing.assert_allclose(x, node["time"].values, rtol=1e-5, atol=1e-12)
                np.testing.assert_allclose(values, 1e-3 * node[motion].values[:, axis], rtol=1e-11, atol=1e-30)
                assert records[0].split()[0] == "1"  # a response in time, at this node along this axis
                assert records[0].split()[4:7] == [name, str(1 + (name == "foot")), str(axis + 1)]
                assert (int(records[2][:10]), int(records[3][:10])) == (17, data)
    assert "foot acceleration_filtered z" in read
    spectrum = tree["sensors/top/spectrum"]
    x, values, records = read["top maximax acceleration z Q 10"]
    np.testing.assert_allclose(x, spectrum["frequency"].values, rtol=1e-5)
    np.testing.assert_allclose(values, 1e-3 * spectrum["acceleration"].values[0, :, 2], rtol=1e-11)
    assert records[0].split()[0] == "24"
    assert (int(records[2][:10]), int(records[3][:10])) == (18, 12)
    assert len(read) == 3 * (3 + 6) + 2 * 5 * 3
    tree.close()


def test_universal_file_is_read_by_pyuff(file: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    assert main(["export", str(file)]) == 0
    sets = pyuff.UFF(str(file.with_name("out_sensors.unv"))).read_sets()
    tree = latin_fmu.open_results(file)
    (own,) = [s for s in sets if s.get("id1", "").strip() == "top acceleration z"]
    np.testing.assert_allclose(own["data"], 1e-3 * tree["sensors/top/acceleration"].values[:, 2], rtol=1e-11)
    assert (own["func_type"], own["rsp_dir"], own["ordinate_spec_data_type"]) == (1, 3, 12)
    (unit,) = [s for s in sets if s["type"] == 164]
    assert unit["units_code"] == 1
    (own,) = [s for s in sets if s.get("id1", "").strip() == "top maximax acceleration z Q 10"]
    np.testing.assert_allclose(own["x"], tree["sensors/top/spectrum/frequency"].values, rtol=1e-5)
    tree.close()


def test_tables_in_g(file: Path) -> None:
    """9.80665 m s-2, of a scene in mm; other columns stay in its units. The table of spectra, too."""
    stem = file.with_name("g")
    assert main(["export", str(file), "--sensor", "top", "--g", "-o", f"{stem}.csv"]) == 0  # the stem, or a file of it
    head, *rows = stem.with_name("g.csv").read_text().splitlines()
    columns = dict(zip(head.split(","), np.array([r.split(",") for r in rows], float).T, strict=True))
    tree = latin_fmu.open_results(file)
    top = tree["sensors/top"]
    assert len(columns) == 1 + 9
    np.testing.assert_allclose(columns["time [s]"], top["time"].values, rtol=1e-8)
    np.testing.assert_allclose(columns["top velocity z [mm s-1]"], top["velocity"].values[:, 2], rtol=1e-8, atol=1e-12)
    wanted = top["acceleration"].values[:, 2] / 9806.65
    np.testing.assert_allclose(columns["top acceleration z [g]"], wanted, rtol=1e-8, atol=1e-12)
    assert main(["srs", str(file), "--g", "-o", str(file.with_name("srs"))]) == 0
    head, *rows = file.with_name("srs.csv").read_text().splitlines()
    columns = dict(zip(head.split(","), np.array([r.split(",") for r in rows], float).T, strict=True))
    wanted = top["spectrum/acceleration"].values[0, :, 2] / 9806.65
    np.testing.assert_allclose(columns["top maximax acceleration z [g]"], wanted, rtol=1e-8)
    assert "top maximax pseudo_velocity z [mm s-1]" in columns
    tree.close()


def test_refused(tmp_path: Path, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Results without sensors, or of pure numbers; a sensor that is not there."""
    assert main(["export", str(file), "--sensor", "tpo"]) == 2
    assert "did you mean 'top'" in capsys.readouterr().err
    bare = column({"block": Box(STEEL, (1.0, 1.0, 1.0))}, {}, {"end": 1e-5, "instants": 2}, units="none")
    latin_fmu.solve(latin_fmu.scene_from_dict(bare)).save(tmp_path / "bare.nc")
    assert main(["export", str(tmp_path / "bare.nc")]) == 2
    assert "the results have no sensors" in capsys.readouterr().err
    bare["sensor"] = {"top": {"face": "block.zmax"}}
    latin_fmu.solve(latin_fmu.scene_from_dict(bare)).save(tmp_path / "pure.nc")
    assert main(["export", str(tmp_path / "pure.nc"), "--g"]) == 2
    assert "--g: the results have no units" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "pure.nc")]) == 0
    text = (tmp_path / "pure_sensors.unv").read_text()
    assert text.splitlines()[2].split() == ["9US:", "USER_DEFINED", "2"]  # user-defined units
    assert "m s-2" not in text
