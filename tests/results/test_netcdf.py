"""Files: round trip, atomic writing, refusals."""

from __future__ import annotations

import random
from contextlib import closing, suppress
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from latin_fmu import ResultsError
from latin_fmu.cli import main
from latin_fmu.results import views
from latin_fmu.results.files import open_results, write_netcdf
from latin_fmu.results.solution import Solution

from . import synthetic


def assert_same(tree: xr.DataTree, path: Path) -> None:
    """The file holds what the tree holds: fields of substructures to single precision, the rest exactly."""
    with closing(open_results(path)) as stored:
        assert [node.path for node in stored.subtree] == [node.path for node in tree.subtree]
        for node in tree.subtree:
            mine, read = node.to_dataset(), stored[node.path].to_dataset()
            if node.path.startswith("/substructures/"):
                xr.testing.assert_allclose(mine, read, rtol=1e-6)
            else:
                xr.testing.assert_identical(mine, read)


@pytest.mark.parametrize("kind", ["crushing", "bars", "stalled", "stack"])
def test_round_trip(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    solution: Solution = request.getfixturevalue(kind)
    solution.save(tmp_path / "out.nc")
    assert_same(solution.to_datatree(), tmp_path / "out.nc")


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    n_time=st.integers(2, 60),
    window=st.integers(1, 70),
    friction=st.sampled_from([0.0, 0.3]),
    text=st.text(st.characters(blacklist_categories=["Cs", "Cc"]), max_size=20),
)
def test_round_trip_of_any_size(n_time: int, window: int, friction: float, text: str, tmp_path: Path) -> None:
    solution = Solution(synthetic.crushing(n_time, window, friction), text, "any")
    solution.save(tmp_path / "any.nc")
    assert_same(solution.to_datatree(), tmp_path / "any.nc")


def test_storage_is_compressed_and_grows_with_time(crushing: Solution, tmp_path: Path) -> None:
    crushing.save(tmp_path / "out.nc")
    with netCDF4.Dataset(tmp_path / "out.nc") as file:
        interface, body = file["interfaces/crush"], file["substructures/lower"]
        assert interface.dimensions["time"].isunlimited()
        assert interface["traction"].filters()["zlib"]
        assert interface["traction"].dtype == np.float64
        assert body["displacement"].dtype == np.float32


def test_plain_xarray_keeps_seconds_as_numbers(crushing: Solution, tmp_path: Path) -> None:
    crushing.save(tmp_path / "out.nc")
    with closing(xr.open_datatree(tmp_path / "out.nc", engine="netcdf4")) as tree:
        assert tree["interfaces/crush/time"].dtype == np.float64


def test_saving_counts_as_output(crushing: Solution, tmp_path: Path) -> None:
    crushing.save(tmp_path / "out.nc")
    assert crushing.timings.output > 0.0


def test_failure_leaves_the_old_file_and_nothing_else(
    crushing: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "out.nc"
    target.write_bytes(b"old")

    def full_disk(path: Path, *_: object, **__: object) -> None:
        Path(path).write_bytes(b"half")
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("netCDF4.Dataset", full_disk)
    with pytest.raises(ResultsError, match="HDF error"):
        write_netcdf(crushing.to_datatree(), target)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_interruption_leaves_nothing(crushing: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(path: Path, *_: object, **__: object) -> None:
        Path(path).write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr("netCDF4.Dataset", interrupted)
    with pytest.raises(KeyboardInterrupt):
        crushing.save(tmp_path / "out.nc")
    assert not list(tmp_path.iterdir())


def test_places_that_cannot_be_written(crushing: Solution, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path, words in [
        (tmp_path, "this is a folder"),
        (tmp_path / "missing" / "out.nc", "does not exist"),
        (tmp_path / "file" / "out.nc", "not a folder"),
    ]:
        with pytest.raises(ResultsError, match=words):
            crushing.save(path)


def test_files_that_cannot_be_opened(crushing: Solution, tmp_path: Path) -> None:
    (tmp_path / "text.nc").write_text("not netCDF")
    xr.Dataset({"a": ("b", [1.0])}).to_netcdf(tmp_path / "foreign.nc", engine="netcdf4")
    future = crushing.to_datatree()
    future.attrs["schema_version"] = "99.0"
    write_netcdf(future, tmp_path / "future.nc")
    for name, words in [
        ("missing.nc", "no such file"),
        (".", "this is a folder"),
        ("text.nc", "not a readable netCDF-4 file"),
        ("foreign.nc", "not written by latin_fmu"),
        ("future.nc", r"another version \(value: 99.0\)"),
    ]:
        with pytest.raises(ResultsError, match=words) as caught:
            open_results(tmp_path / name)
        assert caught.value.problems[0].remedy


def test_damaged_files_are_a_sentence(
    bars: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Bytes changed behind a head that HDF5 still opens: a ResultsError where the values are read, or a figure."""
    monkeypatch.chdir(tmp_path)
    bars.save("whole.nc")
    whole, draw, codes = Path("whole.nc").read_bytes(), random.Random(16), set()
    name = next(iter(bars.interfaces))
    for _ in range(25):
        content = bytearray(whole)
        for _ in range(draw.choice([1, 3, 30])):
            content[draw.randrange(len(content))] = draw.randrange(256)
        Path("damaged.nc").write_bytes(bytes(content))
        codes.add(main(["plot", "damaged.nc", "-o", "damaged.png"]))
        with suppress(ResultsError), closing(open_results("damaged.nc")) as tree:
            views.resultant(tree, name)
    assert codes <= {0, 2}
    assert "Traceback" not in capsys.readouterr().err
