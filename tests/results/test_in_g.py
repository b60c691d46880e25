"""Accelerations in g by ``[output] acceleration = "g"``: what people read is in g, what is stored is not."""

from __future__ import annotations

import json
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import latin_fmu
from latin_fmu.cli import main
from latin_fmu.errors import SceneError
from latin_fmu.pictures.summary_picture import spectra_figure, summary_figure
from latin_fmu.results.groups import unit_of, units_of
from latin_fmu.results.spectra import stored_spectra
from latin_fmu.scene.readable_numbers import prefix_for, readable
from latin_fmu.scene.units import SI, UNIT_SYSTEMS

SIZES = {"SI": 9.80665, "mm-t-s-MPa": 9806.65, "in-lbf-s-psi": 9.80665 / 0.0254}
"""Standard gravity in each system."""


def scene(system: str, **keys: Any) -> latin_fmu.Scene:
    """A block on its way under a pulse, with a spectrum and a filter."""
    return latin_fmu.scene_from_dict(
        {
            "name": "block",
            "units": system,
            "material": {"steel": {"young_modulus": "210 GPa", "poisson_ratio": 0.3, "density": "7.8 g/cm3"}},
            "substructure": {"b": {"material": "steel", "box": {"size": ["10 mm"] * 3, "elements": [1, 1, 2]}}},
            "load": {
                "hit": {"face": "b.zmax", "pressure": "10 MPa", "law": {"type": "half_sine", "duration": "10 us"}}
            },
            "gravity": {"acceleration": [0, 0, "-2 g"]},
            "sensor": {
                "top": {"face": "b.zmax", "spectrum": {"lowest": 1e4, "highest": 4e5, "per_octave": 3}},
                "foot": {"face": "b.zmin", "filter": {"type": "low_pass", "cutoff": 3e5}},
            },
            "time": {"end": "20 us", "instants": 50},
            "output": {"acceleration": "g", **keys},
        }
    )


def labels(figure: Figure) -> str:
    return " ".join([axis.get_ylabel() + " " + axis.get_title() for axis in figure.axes])


@pytest.mark.parametrize("system", SIZES)
def test_summary_figures_and_tables_are_in_g(tmp_path: Path, capsys: pytest.CaptureFixture[str], system: str) -> None:
    solution = latin_fmu.solve(scene(system))
    top = solution.sensors["top"]
    peak = np.abs(top.acceleration[:, :]).max() / SIZES[system]
    text = solution.summary(details=True)
    assert "m/s2" not in text
    assert "in/s2" not in text
    assert f"acceleration up to {peak:.3g} g" in text
    assert f"{peak:.4g} g" in text  # of the table of sensors
    (largest,) = re.findall(r"spectrum \(Q 10\) up to (\S+) g", text)
    spectrum = solution.spectra["top"].acceleration[0].max() / SIZES[system]
    assert float(largest) == pytest.approx(spectrum, rel=5e-3)

    file = tmp_path / "out.nc"
    solution.save(file)
    with latin_fmu.open_results(file) as tree:
        stored = tree["sensors/top/acceleration"]
        assert stored.attrs["units"] == UNIT_SYSTEMS[system].label("m s-2")  # type: ignore[index]
        np.testing.assert_allclose(stored.values, top.acceleration)
        assert units_of(tree.attrs) == UNIT_SYSTEMS[system].with_g  # type: ignore[index]
        assert prefix_for(1.0, unit_of(stored, ""))[0] == pytest.approx(SIZES[system])
        figure = summary_figure(tree)
        assert "(g)" in labels(figure)
        assert "m/s²" not in labels(figure)
        drawn = [
            np.abs(np.asarray(line.get_ydata(), dtype=float)).max()
            for axis in figure.axes
            for line in axis.get_lines()
            if axis.get_ylabel() in ("acceleration (g)", "g")
        ]
        assert any(size == pytest.approx(peak, rel=1e-6) for size in drawn), drawn
        (panel, other) = spectra_figure(stored_spectra(tree), units=units_of(tree.attrs)).axes
        assert panel.get_ylabel() == "absolute acceleration (g)"
        assert "m" in other.get_ylabel() or "in" in other.get_ylabel()
        assert np.max(panel.get_lines()[0].get_ydata()) == pytest.approx(spectrum, rel=1e-6)
    for command in ("export", "srs"):
        assert main([command, str(file)]) == 0
    table = file.with_name("out_sensors.csv").read_text().splitlines()
    column = table[0].split(",").index("top acceleration z [g]")
    found = max(abs(float(row.split(",")[column])) for row in table[1:])
    assert found == pytest.approx(np.abs(top.acceleration[:, 2]).max() / SIZES[system], rel=1e-8)
    assert "top maximax acceleration z [g]" in file.with_name("out_srs.csv").read_text()
    assert " g " in capsys.readouterr().out


def test_srs_in_g_says_so_in_its_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``--g`` reached the table alone."""
    solution = latin_fmu.solve(scene("SI", acceleration="scene"))
    assert "m/s2" in solution.summary(details=True)
    solution.save(tmp_path / "out.nc")
    assert main(["srs", str(tmp_path / "out.nc"), "--g"]) == 0
    said = capsys.readouterr().out
    assert "m/s2" not in said
    assert re.search(r"\d g\b", said)
    record = tmp_path / "pulse.csv"
    times = 1e-4 * np.arange(200)
    values = 30.0 * np.where(times < 0.011, np.sin(np.pi * np.minimum(times / 0.011, 1.0)), 0.0)
    record.write_text("t (s),a (g)\n" + "".join(f"{t:.6f},{a:.6f}\n" for t, a in zip(times, values, strict=True)))
    words = ["srs", str(record), "--value-unit", "g", "--g", "--highest", "400", "-o", str(tmp_path / "record")]
    assert main(words) == 0
    (largest,) = re.findall(r"largest maximax (\S+) g at", capsys.readouterr().out)
    assert 45.0 < float(largest) < 55.0  # 1.65 times 30 g for Q = 10 (Harris, shock and vibration handbook)
    head, *rows = (tmp_path / "record.csv").read_text().splitlines()
    assert head.split(",")[1] == "maximax acceleration [g]"
    assert max(float(row.split(",")[1]) for row in rows) == pytest.approx(float(largest), rel=1e-3)


def test_reports_keep_the_units_of_the_scene() -> None:
    solution = latin_fmu.solve(scene("SI"))
    report = json.dumps(solution.report())
    peak = float(np.abs(solution.sensors["top"].acceleration).max())
    assert f"{peak:.6g}"[:5] in report
    assert pickle.loads(pickle.dumps(solution.units)) == SI.with_g
    assert readable(294.1995, SI.with_g.shown("m s-2")) == "30 g"
    assert readable(5.0, SI.with_g.shown("N")) == "5.000 N"


def test_pure_numbers_have_no_g() -> None:
    tables = scene("SI").tables()
    with pytest.raises(SceneError, match="accelerations cannot be shown in g"):
        latin_fmu.scene_from_dict(tables | {"units": "none"})
