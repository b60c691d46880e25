"""Bodies whose free nodes all lie on a face that may open, and have no mass there."""

from __future__ import annotations

import pytest

import latin_fmu
from fmu_build.build import compiled_files
from latin_fmu.cosim import Session
from latin_fmu.errors import SolverError
from latin_fmu.stability.scenes import STEEL, Box, column, half_sine


@pytest.mark.parametrize("layers", [1, 2])
def test_one_layer_of_elements_under_a_displaced_face(layers: int) -> None:
    """A sentence, not the error of the factorisation; two layers have an inner node and are solved."""
    drive = {"type": "displacement", "face": "low.zmin", "components": ["x", "y", "z"], "value": [0.0, 0.0, 1e-6]}
    tables = column(
        {"low": Box(STEEL, (0.01,) * 3, (2, 2, layers)), "up": Box(STEEL, (0.01,) * 3, (2, 2, 2), (0.0, 0.0, -1.0))},
        {"joint": {"friction_coefficient": 0.2}},
        {"end": 1e-6, "step": 1e-7, "scheme": "generalized_alpha"},
        boundary={"drive": drive | {"law": half_sine(1e-5)}},
    )
    scene = latin_fmu.scene_from_dict(tables)
    if layers == 1:
        for made in (latin_fmu.solve, lambda s: Session(s).initialize(), lambda s: compiled_files(s, "2")):
            with pytest.raises(SolverError, match="at least two layers of elements"):
                made(scene)
    else:
        assert latin_fmu.solve(scene).time[-1] == pytest.approx(1e-6)
