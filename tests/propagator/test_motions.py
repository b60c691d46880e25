"""Prescribed motions: velocities and steps of displacement laws, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.assembly.supports import PrescribedMotion
from latin_fmu.scene.laws import TableLaw

TIME = np.linspace(0.0, 2.0, 9)
LAW = TableLaw(times=(0.0, 1.0, 2.0), values=(0.0, 3.0, 1.0))  # 3 m/s, then -2 m/s


def test_displacement_law() -> None:
    """Times 0.1: slopes of the lines that the steps lie on which begin at the instants; a path that ends with the scene
    keeps its last slope, one that ends before is held."""
    motion = PrescribedMotion(LAW, 0.1, "displacement")
    assert motion.driving(TIME, end=2.0) == pytest.approx([*[0.3] * 4, *[-0.2] * 5])
    assert motion.driving(TIME) == pytest.approx([*[0.3] * 4, *[-0.2] * 4, 0.0])


def test_velocity_law() -> None:
    """The mean over a step is that of the values at its ends."""
    motion = PrescribedMotion(LAW, 0.1, "velocity")
    assert motion.driving(TIME) == pytest.approx([0.0, 0.075, 0.15, 0.225, 0.3, 0.25, 0.2, 0.15, 0.1])
    over_steps = [0.0, 0.0375, 0.1125, 0.1875, 0.2625, 0.275, 0.225, 0.175, 0.125]
    assert motion.driving(TIME, over_steps=True) == pytest.approx(over_steps)
