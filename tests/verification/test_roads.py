"""Explicit and reduced marches, compiled whole instants against the long road that observers take."""

from __future__ import annotations

import numpy as np
import pytest

import latin_fmu

from .blocks import stack

PROPAGATORS = ("explicit", {"type": "reduced", "modes": 20})


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("propagator", PROPAGATORS, ids=str)
def test_both_roads_give_the_same_answer(propagator, friction):
    """Members that share operators, damping, initial motion, gaps that open, ground that moves."""
    scene = stack(4, "contact", friction, propagator=propagator, tolerance=1e-7)
    for material in scene["material"].values():
        material["rayleigh_mass"] = 1e4
        material["rayleigh_stiffness"] = 1e-9
    scene["substructure"]["b3"]["initial_velocity"] = [0.0, 0.0, 1.0]
    del scene["boundary"]["base"]
    scene["interface"]["floor"] = {
        "sides": ["b1.zmin", "ground"],
        "friction_coefficient": friction,
        "ground_velocity": {
            "direction": [0, 0, 1],
            "amplitude": 2.0,
            "law": {"type": "half_sine", "duration": 8e-6},
        },
    }
    described = latin_fmu.scene_from_dict(scene)
    compiled, long = latin_fmu.solve(described), latin_fmu.solve(described, observer=lambda _: None)
    assert compiled.converged
    assert long.converged
    for name, history in long.interfaces.items():
        found = compiled.interfaces[name]
        for field in ("traction", "velocity", "gap"):
            expected = getattr(history, field)
            size = max(np.abs(expected).max(), 1e-10)  # m; gaps that stay closed are round-off
            assert np.abs(getattr(found, field) - expected).max() <= 2e-5 * size, (name, field)
    for name, history in long.substructures.items():
        field = compiled.substructures[name].displacement
        assert np.abs(field - history.displacement).max() <= 1e-6 * np.abs(history.displacement).max()
    for solution in (compiled, long):
        energy = solution.energy
        largest = max(np.abs(term).max() for term in energy.values())
        assert np.abs(energy["balance"]).max() <= 1e-10 * largest
        assert energy["damping_dissipation"][-1] > 0
