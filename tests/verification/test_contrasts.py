"""Hard cases against solvers that share nothing with the package: exact waves, and the coupled contact problem."""

from __future__ import annotations

import numpy as np
import pytest

from latin_fmu.stability.case import pressure_force
from latin_fmu.stability.contrast import bars, blocks
from tests.scenes import solve

from .oracles.bars import Bar
from .oracles.cases import colliding_bars
from .oracles.contact_march import Body, ContactFace, march_contact
from .oracles.hexahedra import Block, matching_nodes, merged
from .oracles.monolithic import LinearSystem, Scheme


@pytest.mark.parametrize("ratio", [1.0, 10.0, 1e2, 1e4, 1e6])
@pytest.mark.parametrize("what", ["E", "rho"])
def test_transmission_at_any_contrast(what, ratio):
    """Exact waves of two bars: impulse to 1 % (half a step of delay of 54), mean stress to 1e-3."""
    scene, _ = bars(what, ratio)
    solution = solve(scene)
    stuff = scene["material"]["second"]
    hard = Bar(np.sqrt(stuff["young_modulus"] / stuff["density"]), stuff["young_modulus"], stuff["density"])
    exact = colliding_bars(Bar(1.0, 1.0, 1.0, velocity=1.0), hard, 0.0, float(solution.time[-1])).pressure
    force, time = pressure_force(solution), solution.time
    wanted = exact.integral(0.0, float(time[-1]))
    assert np.trapezoid(force, time) == pytest.approx(wanted, rel=1.2e-2)
    assert force[20:50].mean() == pytest.approx(exact.integral(time[20], time[49]) / (time[49] - time[20]), rel=1e-3)


def bodies_of(scene):
    """The two blocks of ``contrast.blocks`` for the coupled solver."""
    step, count = scene["time"]["end"] / scene["time"]["instants"], scene["time"]["instants"]
    solids, bodies = [], []
    for name in ("low", "up"):
        table = scene["substructure"][name]
        box, stuff = table["box"], scene["material"][table["material"]]
        material = stuff["young_modulus"], stuff["poisson_ratio"], stuff["density"]
        solid = merged([Block(tuple(box["origin"]), tuple(box["size"]), tuple(box["elements"]), *material)])
        system = LinearSystem(solid.mass, None, solid.stiffness, np.zeros(0, dtype=np.int64), step, Scheme.hht(-0.1))
        velocity = np.tile(table["initial_velocity"], len(solid.nodes))
        loads = np.zeros((count + 1, solid.n_dof))
        bodies.append(Body(system, loads, np.zeros(solid.n_dof), velocity))
        solids.append(solid)
    return solids, bodies


@pytest.mark.parametrize("ratio", [1.0, 1e2, 1e4, 1e6])
@pytest.mark.parametrize(("what", "friction"), [("E", 0.0), ("E", 0.3), ("rho", 0.3)])
def test_contact_forces_at_any_contrast(what, friction, ratio):
    """Newton on the whole contact operator at every instant, default settings: resultant to 1 %."""
    scene = blocks(what, ratio, friction)
    solids, bodies = bodies_of(scene)
    nodes = solids[0].on_plane(2, 1.0), solids[1].on_plane(2, 1.0)
    normals = np.tile([0.0, 0.0, 1.0], (len(nodes[0]), 1))
    face = ContactFace((0, 1), nodes, normals, np.zeros(len(nodes[0])), friction)
    expected = march_contact(bodies, [face], tolerance=1e-10).force[0].sum(axis=1)
    force = solve(scene).interfaces["meet"].force()
    assert np.abs(force - expected).max() < 1e-2 * np.abs(expected).max()


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_iterated_far_the_points_agree_too(friction):
    """Contrast 1e4, tolerance 1e-9: every nodal force to 1e-6."""
    scene = blocks("rho", 1e4, friction, tolerance=1e-9, max_iterations=3000)
    solids, bodies = bodies_of(scene)
    nodes = solids[0].on_plane(2, 1.0), solids[1].on_plane(2, 1.0)
    normals = np.tile([0.0, 0.0, 1.0], (len(nodes[0]), 1))
    face = ContactFace((0, 1), nodes, normals, np.zeros(len(nodes[0])), friction)
    expected = march_contact(bodies, [face]).force[0]
    history = solve(scene).interfaces["meet"]
    order = matching_nodes(history.points, solids[0].nodes[nodes[0]])
    nodal = history.traction * history.areas[:, None]
    assert np.abs(nodal - expected[:, order]).max() < 1e-6 * np.abs(expected).max()
