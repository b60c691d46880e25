"""Synthetic data with noise of 2 %: intervals contain the true values, and are as wide as the data make them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import latin_fmu
from latin_fmu.calibration.data import columns_of, read_measured
from latin_fmu.calibration.prediction import Predictor
from tests.calibration.test_fit import write
from tests.scenes import MODELS

DRAWS, NOISE, T = 20, 0.02, 1.98
CRUSHING = (
    "two_specimen_crushing/scene.toml",
    (
        "substructure.lower.box.elements=[3,3,3]",
        "substructure.upper.box.elements=[3,3,3]",
        "time.step=0.3e-6",
        'sensor.side={substructure="lower",point=[0.01,0.01,0.009]}',
    ),
    "time,side.displacement.x,side.displacement.z,crush.normal_force",
    {"interface.crush.friction_coefficient": (0.1, 0.2), "load.press.pressure": (200e6, 150e6)},
)
SHEAR = (
    "shear_interface/scene.toml",
    ('sensor.above={face="upper.zmin"}',),
    "time,above.velocity.x,fault.normal_force",
    {"interface.fault.friction_coefficient": (0.3, 0.4), "interface.fault.preload": (10e6, 8e6)},
)
BOLTED = (
    "lap_joint/shock.toml",
    ("time.end=40e-6", "time.step=2e-6"),
    "time,end.displacement.x,m6.tension",
    {"contact.all.friction_coefficient": (0.2, 0.15), "bolt.m6.force": (5e3, 4e3)},
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "draws"), [(CRUSHING, DRAWS), (SHEAR, DRAWS), (BOLTED, 2)], ids=["crush", "shear", "bolt"]
)
def test_intervals_contain_the_true_values(tmp_path: Path, case: tuple, draws: int) -> None:  # type: ignore[type-arg]
    """Friction and what presses: in at least 17 of 20 draws each, with at most 12 runs, at most twice as wide as the
    data allow with a known deviation."""
    model, settings, header, parameters = case
    scene, names = latin_fmu.load_scene(MODELS / model, settings), list(parameters)
    truth, start = (np.array([values[k] for values in parameters.values()]) for k in (0, 1))
    instants = np.linspace(0.05, 0.95, 60) * scene.time.end
    columns = header.count(",")
    blank = write(tmp_path / "blank.csv", header, np.column_stack([instants, *[np.ones(60)] * columns]))
    tables = read_measured([blank], scene)
    exact = Predictor(scene, tables, [(name,) for name in names], 1, 2)(truth)
    assert exact.slopes is not None
    sd = np.concatenate([np.full(60, NOISE * np.abs(exact.predicted[p]).max()) for _, _, p in columns_of(tables)])
    weighted = exact.slopes / sd[:, None]
    half = T * np.sqrt(np.diag(np.linalg.inv(weighted.T @ weighted)))
    inside, rng = np.zeros(2, dtype=int), np.random.default_rng(1)
    fit = [f"{name}={value}" for name, value in zip(names, start, strict=True)]
    for _ in range(draws):
        values = exact.predicted + sd * rng.standard_normal(len(sd))
        data = write(tmp_path / "draw.csv", header, np.column_stack([instants, *values.reshape(columns, 60)]))
        made = latin_fmu.calibrate(scene, data, fit, estimate=False)
        found = np.array([made[name].value for name in names])
        own = np.array([made[name].half for name in names])
        assert made.converged
        assert made.runs <= 12
        assert (own <= 2.0 * half).all()
        inside += np.abs(found - truth) <= own
    assert (inside >= draws - 3).all()
