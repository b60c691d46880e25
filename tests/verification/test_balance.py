"""Energy, momentum, no tension, friction that dissipates: on every model."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import latin_fmu
from tests.scenes import MINUTES, MODELS, solve, solved

from .blocks import stack

SHIPPED = sorted(
    str(p.relative_to(MODELS).with_suffix("")) for p in MODELS.glob("*/*.toml") if p.parent.name not in MINUTES
)  # which takes minutes
QUICK = [pytest.param(m, marks=pytest.mark.slow) if m.startswith("lap_joint") else m for m in SHIPPED]
# sqrt(eta) is an energy norm over all interfaces; the residual of the work is bounded by it times the work exchanged
MULTIPLE = 10.0
INCREMENTS = 3e-3


def exchanged(solution):
    """Scale of works, J: what crosses the interfaces (sum of |power| dt over sides and instants, local-stage
    fields), or the largest term of the energy balance where more (rigid ground: no work crosses)."""
    dt = solution.time[1]
    crossing = sum(
        np.abs(np.einsum("p,tpc,tpc->t", h.areas, h.traction, h.velocity[:, side])).sum() * dt
        for h in solution.interfaces.values()
        for side in (0, 1)
    )
    return max(crossing, *(np.abs(term).max() for term in solution.energy.values()))


@pytest.mark.parametrize("model", QUICK)
def test_every_model_keeps_the_laws(model):
    solution = solved(model)
    for history in solution.interfaces.values():
        normal = np.einsum("tpc,pc->tp", history.traction, history.normals)
        if history.contact_status is None:
            continue
        scale = np.abs(normal).max()
        assert normal.max() <= 1e-12 * scale  # contact never pulls
        assert (history.contact_status[normal >= 0] == 0).all()
        if history.friction_power is not None:
            # a stuck point dissipates traction times the round-off of its velocities
            size = np.abs(history.velocity).max() * np.abs(history.traction).max() * history.areas.sum()
            assert history.friction_power.min() >= -1e-14 * size
            shear = np.linalg.norm(history.traction - normal[..., None] * history.normals, axis=-1)
            assert (shear <= history.friction_coefficient * -normal + 1e-9 * scale).all()


@pytest.mark.parametrize("model", SHIPPED)
def test_every_model_closes_its_energy(model):
    """Per substructure and for the assembly: to 1e-10 of the largest term, each term computed by itself."""
    solution = solved(model)
    accounts = [h.energy for h in solution.substructures.values()]
    for energy in accounts:
        stored = energy["kinetic"] + energy["elastic"]
        rest = (
            stored
            - stored[0]
            + energy["damping_dissipation"]
            + energy["scheme_dissipation"]
            + energy["landing_dissipation"]
            - energy["work_of_loads"]
            - energy["interface_work"]
        )
        largest = max(np.abs(term).max() for term in energy.values())
        assert np.abs(rest).max() <= 1e-10 * largest
    total = solution.energy
    assert np.abs(total["balance"]).max() <= 1e-10 * max(np.abs(t).max() for t in total.values())
    assert (np.diff(total["friction_dissipation"]) >= -1e-12 * total["friction_dissipation"][-1]).all()


def work_residual(solution):
    """Momentum and interface-work residual, relative.

    Momentum: total momentum against the impulse of loads and supports is exact by construction where tractions of
    the two sides are opposite; what can differ is the velocity of the two sides under those tractions. Interface
    work: power of the tractions on the marched velocities against the local-stage ones.
    """
    dt = solution.time[1]
    work = 0.0
    for history in solution.interfaces.values():
        for side, name in enumerate(history.sides):
            if name == "ground":
                continue
            part, _ = name.split(".")
            body = solution.substructures[part]
            nodes = np.argmin(
                np.linalg.norm(body.nodes[None] - (history.points + side * _shift(history))[:, None], axis=2), axis=1
            )
            marched = body.velocity[:, nodes]
            gap = marched - history.velocity[:, side]
            power = np.einsum("p,tpc,tpc->tp", history.areas, history.traction, gap)
            work += np.abs(power).sum() * dt
    return work / exchanged(solution)


def _shift(history):
    return history.initial_gap[:, None] * history.normals


@pytest.mark.parametrize("model", SHIPPED)
def test_interface_work_is_what_friction_impacts_and_ground_take(model):
    """At every instant: work of the marched tractions against the losses by the local-stage fields, within a stated
    multiple of sqrt(eta) of the largest term."""
    solution = solved(model)
    energy = solution.energy
    losses = energy["friction_dissipation"] + energy["contact_dissipation"] - energy.get("ground_work", 0.0)
    largest = max(np.abs(term).max() for term in energy.values())
    # increments of load: friction takes the traction at their end, works the mean of both ends
    allowed = INCREMENTS if not energy["kinetic"].any() else 0.0
    allowed += MULTIPLE * solution.error_indicator
    assert np.abs(energy["interface_work"] + losses).max() <= allowed * largest


def test_impact_losses_vanish_under_refinement():
    """Two blocks thrown at each other: the loss of the contact law falls with the mesh, and it is reported."""
    losses = []
    for elements in (2, 4):
        scene = stack(2, "contact", 0.0, gap=1e-5, elements=elements)
        scene["boundary"], scene["load"] = {}, {}
        scene["substructure"]["b2"]["initial_velocity"] = [0.0, 0.0, -10.0]
        scene["time"] = {"end": 1.2e-5, "instants": 40 * elements, "scheme": "hht"}
        energy = solve(scene).energy
        total = energy["kinetic"] + energy["elastic"]
        lost = total[0] - total[-1]
        dissipated = energy["contact_dissipation"][-1] + energy["scheme_dissipation"][-1]
        assert dissipated == pytest.approx(lost, rel=1e-6)
        losses.append(lost / total[0])
    assert losses[1] < 0.7 * losses[0]


def test_a_resting_pair_stays_at_rest():
    """Preloaded, nothing loaded: round-off never grows to more than round-off."""
    scene = stack(2, "contact", 0.3)
    scene["load"] = {}
    scene["interface"]["i1"]["preload"] = 1e7
    scene["time"] = {"end": 4e-5, "instants": 200}
    solution = solve(scene)
    history = solution.interfaces["i1"]
    assert np.abs(history.traction - history.traction[0]).max() < 1e-9 * 1e7
    assert max(w.iterations for w in solution.windows) <= 5


def test_ring_down_of_a_bonded_pair_never_gains_energy():
    """Half-sine on a bonded pair at default tolerance, long after the pulse: energy falls, as the scheme's."""
    scene = stack(2, "perfect")
    scene["time"] = {"end": 3e-4, "instants": 1500}
    energy = solve(scene).energy
    total = (energy["kinetic"] + energy["elastic"])[100:]
    assert total[-1] < total[0]
    assert (np.maximum.accumulate(total[::-1])[::-1] <= total * 1.02).all()  # no later rise above 2 %


@pytest.mark.parametrize("window", [1, "whole"])
def test_interface_work_residual_vanishes_with_the_tolerance(window):
    """Below 1e-9 at tolerance 1e-11."""
    scene = stack(2, "contact", 0.2, tolerance=1e-11, window=window, max_iterations=5000)
    assert work_residual(solve(scene)) < 1e-9


def test_momentum_of_free_bodies():
    """Two free blocks thrown at each other, default tolerance, windows of one instant: momentum to round-off."""
    scene = stack(2, "contact", 0.3, gap=1e-5)
    scene["boundary"] = {}
    scene["load"] = {}
    scene["substructure"]["b1"]["initial_velocity"] = [3.0, -2.0, 10.0]
    scene["substructure"]["b2"]["initial_velocity"] = [-1.0, 4.0, -5.0]
    solution = solve(scene)
    assert np.abs(solution.interfaces["i1"].impulse(solution.time)[-1]).min() > 0
    volume = 0.01**3
    total = 0.0
    for name, density in (("b1", 2700.0), ("b2", 7800.0)):
        history = solution.substructures[name]
        lumped = _lumped(history.nodes) * density * volume
        total = total + np.einsum("n,tnc->tc", lumped, history.velocity)
    # the scheme weights forces over a step alike on both sides, so their sum never moves
    assert np.abs(total - total[0]).max() < 1e-11 * np.abs(total).max()


def _lumped(nodes):
    """Share of the volume of each node of a regular block of cubes."""
    share = np.ones(len(nodes))
    for axis in range(3):
        x = nodes[:, axis]
        inside = (x > x.min() + 1e-9) & (x < x.max() - 1e-9)
        share *= np.where(inside, 1.0, 0.5)
    return share / share.sum()


def test_sides_of_a_bond_that_stand_apart_are_told():
    """Loose tolerance, long ring-down: the sides of a joint stand apart and the run reports it; tight: it does not."""
    scene = stack(2, "perfect", tolerance=0.6, force_tolerance=6.0, bonds="iterate")
    scene["time"] = {"end": 2e-4, "instants": 1000}
    coarse = latin_fmu.solve(latin_fmu.scene_from_dict(copy.deepcopy(scene)))
    assert any("drifted apart" in w for w in coarse.warnings)
    assert not coarse.converged  # by the work of its errors
    scene["solver"] = {"tolerance": 1e-6}
    assert not solve(scene).warnings


def thrown_bond(n: int, scheme: str = "hht") -> list[str]:
    """Warnings on two bonded blocks of which one has an initial velocity."""
    scene = stack(2, "perfect", tolerance=1e-8)
    scene["boundary"], scene["load"] = {}, {}
    scene["substructure"]["b2"]["initial_velocity"] = [0.5, 0.0, 1.0]
    scene["time"] = {"end": 1e-5, "instants": n, "scheme": scheme}
    return [w for w in solve(scene).warnings if "apart by" in w]


def test_bond_of_sides_with_different_velocities():
    """Apart by half a step of the jump at any tolerance: the remedy is the step, and it works."""
    (warning,) = thrown_bond(20)
    assert f"apart by {0.5 * 5e-7 * np.hypot(1.0, 0.5):.3g} m" in warning
    assert "use smaller steps" in warning
    assert "tolerance" not in warning.split("at any tolerance; ")[1]
    assert not thrown_bond(400)


def test_bond_that_nothing_reaches():
    """Round-off of a few atoms' width is no drift."""
    scene = stack(2, "perfect", bonds="iterate", skip_at_rest="off")
    scene["substructure"]["b2"]["box"] |= {"size": [0.01, 0.01, 0.2], "elements": [3, 3, 60]}
    scene["time"] = {"end": 4e-7, "instants": 2}
    assert not [w for w in solve(scene).warnings if "apart" in w]


def test_work_of_moving_ground():
    """Ground that drives a block at rest: what it gives is what the block holds and loses."""
    scene = stack(1, "contact")
    scene["load"], scene["boundary"] = {}, {}
    ground = {"direction": [0, 0, 1], "amplitude": 3.0, "law": {"type": "constant"}}
    scene["interface"]["floor"] = {"sides": ["b1.zmin", "ground"], "gap": 0.0, "ground_velocity": ground}
    energy = solve(scene).energy
    gained = (energy["kinetic"] + energy["elastic"])[-1]
    lost = energy["contact_dissipation"][-1] + energy["scheme_dissipation"][-1]
    assert gained > 0
    assert energy["ground_work"][-1] == pytest.approx(gained + lost, rel=1e-6)
