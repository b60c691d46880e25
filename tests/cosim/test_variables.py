"""The variable table."""

from __future__ import annotations

import re

import numpy as np
import pytest

from latin_fmu.cosim import Session
from latin_fmu.cosim.output_table import EVENTS, FAMILIES, INTERFACE, SOLVER, FacePoints
from latin_fmu.cosim.variable import UNITS, table_from, table_text
from latin_fmu.cosim.variables import table_of
from latin_fmu.errors import SceneError

from .scenes import bar, blocks


def test_names_are_unique_and_structured():
    table = table_of(blocks(), {"crush": 9})
    names = [v.name for v in table]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z]\w*(\.[A-Za-z]\w*)*(\[\d\])?", name) for name in names)


def test_every_real_has_a_known_unit_and_every_variable_a_meaning():
    for variable in table_of(blocks(), {"crush": 9}):
        assert variable.description
        assert (variable.unit in UNITS) == (variable.kind == "real"), variable


def test_inputs_have_starts_and_outputs_have_none():
    for variable in table_of(blocks()):
        if variable.causality == "output":
            assert variable.start is None
            counts = variable.name.endswith((".touches", ".separations", ".slips"))
            assert (variable.kind, variable.variability) == (
                ("integer", "discrete") if counts else ("real", "continuous")
            )
        elif variable.causality != "independent":
            assert variable.start is not None


def test_only_loads_with_the_law_input_are_inputs():
    inputs = [v.name for v in table_of(blocks()) if v.causality == "input"]
    assert inputs == ["load.press.value", "load.press.rate"]
    assert not [v for v in table_of(bar()) if v.causality == "input"]


def test_the_table_survives_its_file():
    table = table_of(blocks(), {"crush": 9})
    assert table_from(table_text(table)) == table


def test_a_sensor_on_a_substructure_that_is_not_there_is_refused():
    with pytest.raises(SceneError, match="did you mean 'upper'"):
        blocks(sensor={"head": {"substructure": "uper", "point": [0.0, 0.0, 0.0]}})


def test_every_output_follows_from_the_points_or_signals_or_is_written_by_the_kernels():
    for family in FAMILIES:
        for row in family.rows:
            follows = row.integral or row.largest or row.filtered
            assert row.of or follows or family in (SOLVER, EVENTS), row.name
            assert not row.unit or row.unit in UNITS


def test_outputs_of_an_interface_are_those_of_its_points():
    """The rows over the signals, which are made from unit fields, and what the kernels read point by point."""
    session = Session(blocks())
    session.initialize()
    for step in range(8):
        assert session.step(step * 0.4e-6, 0.4e-6)
    points = FacePoints.over(session.window()[1]["crush"])
    compared = [row for row in INTERFACE.rows if row.of]
    assert len(compared) == len(INTERFACE.rows) - 2  # the impulse, and the largest force
    for row in compared:
        names = [f"interface.crush.{row.name}{end}" for end in ("[1]", "[2]", "[3]")]
        values = np.ravel(row.of(points)[-1])
        got = session.values(names if len(values) == 3 else [f"interface.crush.{row.name}"])
        assert got == pytest.approx(values, rel=1e-12, abs=1e-15 + 1e-12 * np.abs(values).max()), row.name
