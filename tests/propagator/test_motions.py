"""Prescribed motions: velocities and steps of displacement laws, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.assembly.supports import PrescribedMotion
from latin_fmu.scene.laws import TableLaw

TIME = np.linspace(0.0, 2.0, 9)
LAW = TableLaw(times=(0.0, 1.0, 2.0), values=(0.0, 3.0, 1.0))  # 3 m/s, then -2 m/s


def test_displacement_law() -> None:
    """Times 0.1: the mean velocity over each step is the slope of the line that the step lies on; at the kinks and ends
    central differences over one step are means of the slopes on both sides."""
    motion = PrescribedMotion(LAW, 0.1, "displacement")
    assert motion.step_velocity(TIME) == pytest.approx([0.0, *[0.3] * 4, *[-0.2] * 4])
    assert motion.velocity(TIME)[1:8] == pytest.approx([0.3, 0.3, 0.3, 0.05, -0.2, -0.2, -0.2])


def test_velocity_law() -> None:
    """The mean over a step is that of the values at its ends."""
    motion = PrescribedMotion(LAW, 0.1, "velocity")
    assert motion.velocity(TIME) == pytest.approx([0.0, 0.075, 0.15, 0.225, 0.3, 0.25, 0.2, 0.15, 0.1])
    assert motion.step_velocity(TIME) == pytest.approx(
        [0.0, 0.0375, 0.1125, 0.1875, 0.2625, 0.275, 0.225, 0.175, 0.125]
    )
