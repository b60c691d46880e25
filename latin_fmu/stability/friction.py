"""Friction: from none to no slip, oblique impact, wedges, a coefficient for which no solution converges."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import cos, degrees, radians, sin

import numpy as np

from .case import TIGHT, Bench, Case, Measure, contact_laws, distance, energies, energy_laws, impulse, laws, make_case
from .scenes import Box, Material, cornered, press, two_boxes, without_slip

STICK = 1


def cases() -> Iterator[Case]:
    """From no friction to no slip: crushing, oblique impact, a corner of three walls."""
    case = partial(make_case, "friction")
    for mu in (0.0, 0.1, 0.3, 1.0, 10.0, 1e6):
        expectation = "same cost at any mu; stick and slip where expected"
        yield case(f"crushing, mu {mu:g}", expectation, _crushing, mu)
    for angle in (0, 15, 30, 45, 60, 73):
        expectation = "impulse on the cone and against the sliding, momentum exact"
        yield case(f"oblique impact, {angle} degrees", expectation, _oblique, angle)
    for mu in (0.0, 0.1, 0.3, 1.0, 10.0):
        expectation = "a node of three interfaces: converged; total force unique for mu <= 0.3"
        yield case(f"corner of three walls, mu {mu:g}", expectation, _corner, mu)
    yield case("corner of three walls, no_slip", "converged where mu 1e6 is not", _no_slip_corner)
    yield case("crushing, no_slip", "the result of mu 1e6, same cost", _no_slip_crushing)
    expectation = "no convergence point by point: stops with a message, laws kept"
    yield case("corner of three walls, mu 1e6", expectation, _not_convergent)


def _crushing(friction: float, bench: Bench) -> list[Measure]:
    solution = bench.converged(press(friction, 6, 60))
    smooth = bench.converged(press(0.0, 6, 60), counted=False)
    history = solution.interfaces["meet"]
    status = history.contact_status
    assert status is not None
    measures = [
        Measure("passes over mu 0", solution.passes / smooth.passes, 2.0),
        Measure("mu 0 over passes", smooth.passes / solution.passes, 2.0),
        *laws(solution),
    ]
    if friction == 0:
        measures.append(Measure("points that stick", int(np.count_nonzero(status == STICK)), 0))
    if friction >= 10:
        slid, free = (_slipped(s.interfaces["meet"], solution.time[1]) for s in (solution, smooth))
        measures.append(Measure("slip over that of mu 0", slid / free, 0.01))
    return measures


def _slipped(history: object, step: float) -> float:
    """Largest distance a point slips while it is pressed, m."""
    velocity, status = history.velocity, history.contact_status  # type: ignore[attr-defined]
    relative = velocity[:, 1] - velocity[:, 0]
    sliding = np.linalg.norm(relative[..., :2], axis=2) * (status > 0)
    return float(sliding.sum(axis=0).max()) * step


def _oblique(angle: int, bench: Bench) -> list[Measure]:
    friction, turn = 0.1, 0.3
    tilt = radians(angle)
    velocity = (sin(tilt) * cos(turn), sin(tilt) * sin(turn), cos(tilt))
    first, second = Box(Material(), elements=(3, 3, 8), velocity=velocity), Box(Material(), elements=(3, 3, 8))
    scene = two_boxes(first, second, 1 / 16, 60, friction, tolerance=1e-6, max_iterations=1000)
    scene["output"] = {"energy": True, "fields": True, "every": 60}
    solution = bench.converged(scene)
    received = solution.interfaces["meet"].impulse(solution.time)[-1]
    along = float(np.hypot(received[0], received[1]))
    measures = [Measure("momentum lost", _momentum_drift(solution), 1e-11)]
    if angle >= 30:  # slides all along: tan(angle) > 2 mu (1 + Z_s/Z_p)
        back = float(np.arctan2(-received[1], -received[0]))
        measures += [
            Measure("impulse ratio over mu off by", abs(along / -received[2] / friction - 1), 1e-3),
            Measure("direction off by degrees", abs(degrees(back - turn)), 0.05),
        ]
    elif angle == 0:
        measures.append(Measure("shear impulse", along / -received[2], 1e-6))
    else:
        measures.append(Measure("impulse ratio over mu", along / -received[2] / friction, 1.0))
    return measures + energy_laws(solution)


def _momentum_drift(solution: object) -> float:
    """Change of the momentum of two equal cubes of unit mass over that at the start."""
    total = []
    for stored in (0, -1):
        momentum = np.zeros(3)
        for history in solution.substructures.values():  # type: ignore[attr-defined]
            velocity = history.velocity[stored]
            weight = _lumped(history.nodes, history.cells)
            momentum += weight @ velocity
        total.append(momentum)
    return float(np.linalg.norm(total[1] - total[0]) / np.linalg.norm(total[0]))


def _lumped(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Volume carried by each node of a mesh of boxes (integral of its shape function)."""
    corners = nodes[cells]
    volume = np.prod(corners.max(axis=1) - corners.min(axis=1), axis=1) / 8
    weight = np.zeros(len(nodes))
    np.add.at(weight, cells, volume[:, None])
    return weight


THROW = (-1.0, -0.7, -0.4)


def _corner(friction: float, bench: Bench) -> list[Measure]:
    # at 1e-3 the work of the errors is told as just above its limit for some coefficients
    solution = bench.converged(cornered(THROW, friction, tolerance=1e-4))
    measures = laws(solution)
    if friction <= 0.3:
        totals = []
        for kind in ("diagonal", "impedance"):
            scene = cornered(THROW, friction, search_direction=kind, **{**TIGHT, "tolerance": 1e-11})
            tight = bench.converged(scene, counted=False)
            totals.append(np.stack([h.force() for h in tight.interfaces.values()]).sum(axis=0))
        measures.append(Measure("total force of two search directions differs by", distance(*totals), 1e-8))
    return measures


def _no_slip_corner(bench: Bench) -> list[Measure]:
    solution = bench.converged(without_slip(cornered(THROW, 0.0)))
    energy = energies(solution)
    taken = float(np.abs(energy["friction_dissipation"]).max() / energy["kinetic"][0])
    return [Measure("work of the tangential tractions", taken, 2e-3), *energy_laws(solution)]


def _no_slip_crushing(bench: Bench) -> list[Measure]:
    rough = bench.converged(press(1e6, 6, 60), counted=False)
    solution = bench.converged(without_slip(press(0.0, 6, 60)))
    forces = (s.interfaces["meet"].force() for s in (solution, rough))
    return [
        Measure("force differs by", distance(*forces), 0.05),  # holds the points that touch without pressure too
        Measure("normal impulse differs by", abs(impulse(solution) / impulse(rough) - 1), 2e-3),
        Measure("passes over mu 1e6", solution.passes / rough.passes, 1.5),
        *energy_laws(solution),
    ]


def _not_convergent(bench: Bench) -> list[Measure]:
    solution = bench.solve(cornered(THROW, 1e6))
    status = solution.status
    vague = solution.converged or not ("interface" in status and "friction" in status and "step" in status)
    finite = all(np.isfinite(h.traction).all() for h in solution.interfaces.values())
    return [
        Measure("message without interface, friction and remedy", float(vague and not solution.converged), 0),
        Measure("numbers that are not finite", float(not finite), 0),
        Measure("iterations in a window", max(bench.iterations), 300),
        *contact_laws(solution),
    ]
