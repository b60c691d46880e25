"""Peak memory of the process against the process status."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latin_fmu import SceneError, load_scene, open_results, solve
from latin_fmu.machine import peak_memory

from .test_cli import SCENE


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no process status here")
def test_peak_memory_is_that_of_this_process() -> None:
    """Also after it has grown by 100 MB; to the half megabyte by which the two accounts of the system may differ."""
    for size in (1, 100_000_000):
        block = np.ones(size, dtype=np.uint8)
        status = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
        assert peak_memory() == pytest.approx(1024 * int(status), abs=5e5)
        assert peak_memory() > block.nbytes


@pytest.mark.parametrize("every", [7, 40, 300])
def test_thinned_histories_are_those_of_every_so_many_instants(every: int, tmp_path: Path) -> None:
    """Also where tangential velocities are read from the substructures, and where the last instant is not kept."""
    (tmp_path / "scene.toml").write_text(SCENE)
    whole, thinned = (
        solve(load_scene(tmp_path / "scene.toml", ["time.instants=100", f"output.interfaces_every={n}"]))
        for n in (1, every)
    )
    a, b = whole.interfaces["meet"], thinned.interfaces["meet"]
    for name in ("traction", "velocity", "gap", "contact_status"):
        np.testing.assert_array_equal(getattr(a, name)[::every], getattr(b, name))
    np.testing.assert_array_equal(thinned.outcome.interface_time, whole.time[::every])
    assert len(thinned.time) == 101
    assert any("output.interfaces_every" in warning for warning in thinned.warnings)
    thinned.save(tmp_path / "a.nc")
    tree = open_results(tmp_path / "a.nc")
    np.testing.assert_array_equal(tree["interfaces/meet/time"].values, whole.time[::every])
    tree.close()
    assert "meet" in thinned.summary()


def test_energies_need_every_instant(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    with pytest.raises(
        SceneError, match=r"output\.interfaces_every: the energies of the interfaces need every instant"
    ):
        load_scene(tmp_path / "scene.toml", ["output.energy=true", "output.interfaces_every=2"])
