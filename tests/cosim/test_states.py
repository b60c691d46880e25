"""Rollback: whatever is saved and restored in between, the straight run comes out bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.cosim import Session, Settings
from latin_fmu.errors import InputError

from .scenes import bar, blocks

H = 0.4e-6


def test_a_prescribed_state_goes_on_in_a_new_session():
    first = Session(blocks(), Settings(mode=1, end_time=2e-6))
    first.set_history("press", [0.0, 1e-6], [0.0, 1.0])
    first.initialize()
    assert first.step(0.0, H)
    second = Session(blocks(), Settings(mode=1, end_time=2e-6))
    second.restore(first.snapshot())
    for session in (first, second):
        assert session.step(H, H)
    assert np.array_equal(second.row, first.row)


def test_states_of_other_scenes_and_settings_are_refused():
    session = Session(blocks())
    session.initialize()
    snapshot = session.snapshot()
    for other in (Session(bar()), Session(blocks(), Settings(tolerance=1e-5))):
        with pytest.raises(InputError, match="state"):
            other.restore(snapshot)
    with pytest.raises(InputError):
        session.restore(snapshot[:-9])
    assert session.snapshot() == snapshot


def test_steps_rolled_back_are_not_in_the_dataset():
    session = Session(blocks(), Settings(keep=True))
    session.initialize()
    assert session.step(0.0, H)
    back = session.snapshot()
    assert session.step(H, 3 * H)
    session.restore(back)
    assert session.step(H, H)
    ahead = session.snapshot()
    session.restore(back)
    session.restore(ahead)
    tree = session.dataset()
    assert tree["exchange"]["time"].values == pytest.approx([H, 2 * H])
    times = tree["interfaces/crush"]["time"].values
    assert times == pytest.approx(np.linspace(0, 2 * H, 5))
    assert tree["interfaces/crush"]["force"].values[-1] == pytest.approx(
        tree["exchange"]["interface_crush_force"].values[-1]
    )


def test_dataset_is_written_and_read(tmp_path):
    from latin_fmu import open_results
    from latin_fmu.results.files import write_netcdf

    session = Session(blocks(output={"energy": True, "fields": True}), Settings(keep=True))
    session.initialize()
    for i in range(3):
        assert session.step(i * H, H)
    write_netcdf(session.dataset(), tmp_path / "out.nc")
    tree = open_results(tmp_path / "out.nc")
    force = tree["exchange"]["interface_crush_force"]
    assert force.attrs["units"] == "N"
    assert force.shape == (3, 3)
    assert tree["substructures/upper"]["displacement"].sizes["time"] == 7
    tree.close()
