"""Explicit and reduced marches: the compiled driver against the Python driver, which observers need."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu
from latin_fmu.assembly.build import build

from .blocks import stack

PROPAGATORS = ("explicit", {"type": "reduced", "modes": 20})


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("propagator", PROPAGATORS, ids=str)
def test_both_drivers_give_the_same_answer(propagator, friction):
    """Members that share operators, damping, initial motion, gaps that open, ground that moves."""
    scene = stack(5, "contact", friction, propagator=propagator, tolerance=1e-7)
    for material in scene["material"].values():
        material["rayleigh_mass"] = 1e4
        material["rayleigh_stiffness"] = 1e-9
    for i in range(1, 6):  # nothing is at rest: the second and the fourth block are one class from the start
        scene["substructure"][f"b{i}"]["initial_velocity"] = [0.0, 0.0, 1.0 - 0.2 * i]
    del scene["boundary"]["base"]
    scene["interface"]["floor"] = {
        "sides": ["b1.zmin", "ground"],
        "friction_coefficient": friction,
        "ground_velocity": {"direction": [0, 0, 1], "amplitude": 2.0, "law": {"type": "half_sine", "duration": 8e-6}},
    }
    described = latin_fmu.scene_from_dict(scene)
    compiled, python = latin_fmu.solve(described), latin_fmu.solve(described, observer=lambda _: None)
    assert any(len(p.names) > 1 for p in build(described).assembly.propagators)
    assert compiled.converged
    assert python.converged
    for name, history in python.interfaces.items():
        compiled_history = compiled.interfaces[name]
        for field in ("traction", "velocity", "gap"):
            expected = getattr(history, field)
            size = max(np.abs(expected).max(), 1e-10)  # m; gaps that stay closed are round-off
            assert np.abs(getattr(compiled_history, field) - expected).max() <= 2e-5 * size, (name, field)
    for name, history in python.substructures.items():
        field = compiled.substructures[name].displacement
        assert np.abs(field - history.displacement).max() <= 1e-6 * np.abs(history.displacement).max()
    for solution in (compiled, python):
        energy = solution.energy
        largest = max(np.abs(term).max() for term in energy.values())
        assert np.abs(energy["balance"]).max() <= 1e-10 * largest
        assert energy["damping_dissipation"][-1] > 0
