"""Random small scenes from a seed, and what every one of them must end in."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.stability.case import contact_laws, penetration_bound

SECONDS = 20.0  # of one scene; the smallest machine needs less than one
SCHEMES = (
    {"type": "hht", "alpha": -0.1},
    {"type": "hht", "alpha": -0.3},
    {"type": "newmark", "beta": 0.3025, "gamma": 0.6},
    {"type": "newmark", "beta": 0.25, "gamma": 0.5},
)


def scene(seed: int) -> dict[str, Any]:
    """Two or three boxes in a row, perhaps on the ground, with anything in them."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 4))
    pick = rng.choice
    size = 10.0 ** rng.uniform(-3, 1)
    elements = [int(rng.integers(1, 4)), int(rng.integers(1, 4))]
    width = size * 10.0 ** rng.uniform(-0.5, 0.5, 2)
    stuffs = [_stuff(rng) for _ in range(count)]
    speeds = [np.sqrt(s["young_modulus"] / s["density"]) for s in stuffs]
    scale = float(pick(speeds)) * 10.0 ** rng.uniform(-5, -2)
    friction = float(pick([0.0, 0.1, 0.3, 1.0, 10.0]))
    described: dict[str, Any] = {
        "name": f"random_{seed}",
        "material": {},
        "substructure": {},
        "interface": {},
        "boundary": {},
        "load": {},
    }
    level, transits = 0.0, []
    for i in range(count):
        height, layers = size * 10.0 ** rng.uniform(-0.5, 0.7), int(rng.integers(1, 7))
        gap = float(pick([0.0, 0.0, 1e-6, 1e-4, 1e-2])) * size if i else 0.0
        level += gap
        described["material"][f"m{i}"] = stuffs[i]
        described["substructure"][f"b{i}"] = {
            "material": f"m{i}",
            "box": {"origin": [0.0, 0.0, level], "size": [*width, height], "elements": [*elements, layers]},
            "initial_velocity": [float(v) for v in scale * rng.normal(size=3) * pick([0.0, 1.0], size=3)],
        }
        transits.append(height / layers / speeds[i])
        level += height
        if i:
            perfect = count > 2 and rng.random() < 0.2
            described["interface"][f"i{i}"] = {
                "sides": [f"b{i - 1}.zmax", f"b{i}.zmin"],
                **({"behaviour": "perfect"} if perfect and gap == 0 else {"friction_coefficient": friction}),
            }
    _surroundings(described, rng, count, friction)
    weight = max(s["density"] for s in stuffs)
    _load(described, rng, count, weight * float(max(speeds)) * scale, 60 * float(max(transits)))
    step = float(pick([min(transits), max(transits)])) * 10.0 ** rng.uniform(-1, 1)
    described["time"] = {"end": 40 * step, "instants": 40, "scheme": dict(SCHEMES[int(rng.integers(len(SCHEMES)))])}
    described["solver"] = {
        "window": pick([1, 1, 1, 4, "whole"]).item(),
        "search_direction": {
            "type": str(pick(["automatic", "automatic", "impedance", "row", "diagonal"])),
            "factor": float(pick([1.0, 1.0, 0.1, 10.0])),
        },
        "acceleration": str(pick(["anderson", "anderson", "none"])),
    }
    window = described["solver"]["window"]
    described["solver"]["window"] = window if window == "whole" else int(window)
    described["output"] = {"energy": True}
    return described


def _stuff(rng: np.random.Generator) -> dict[str, float]:
    return {
        "young_modulus": 10.0 ** rng.uniform(5, 12),
        "poisson_ratio": float(rng.choice([0.0, 0.2, 0.3, 0.45, -0.3])),
        "density": 10.0 ** rng.uniform(1, 4.3),
    }


def _surroundings(described: dict[str, Any], rng: np.random.Generator, count: int, friction: float) -> None:
    choice = rng.integers(4)
    if choice == 0:
        described["interface"]["floor"] = {"sides": ["b0.zmin", "ground"], "friction_coefficient": friction}
    elif choice == 1:
        described["boundary"]["held"] = {"face": "b0.zmin", "type": "fixed"}
    elif choice == 2:
        described["boundary"]["plane"] = {"face": "b0.zmin", "type": "symmetry"}
    if rng.random() < 0.4:
        for i in range(count):
            described["boundary"][f"x{i}"] = {"face": f"b{i}.xmin", "type": "symmetry"}


def _load(described: dict[str, Any], rng: np.random.Generator, count: int, traction: float, span: float) -> None:
    if rng.random() < 0.3:
        return
    law = {"type": str(rng.choice(["half_sine", "rectangular_pulse"])), "duration": span * 10.0 ** rng.uniform(-2, 0)}
    size = traction * 10.0 ** rng.uniform(-1, 1)
    if rng.random() < 0.7:
        described["load"]["push"] = {"face": f"b{count - 1}.zmax", "pressure": size, "law": law}
    else:
        pull = [float(v) for v in size * rng.normal(size=3)]
        described["load"]["push"] = {"face": f"b{count - 1}.zmax", "traction": pull, "law": law}


def outcome(seed: int) -> str:
    """ "converged" or "not converged"; AssertionError for anything else."""
    start = time.process_time()
    described = scene(seed)
    solution = latin_fmu.solve(latin_fmu.scene_from_dict(described))
    assert time.process_time() - start < SECONDS, "time budget"
    for history in solution.interfaces.values():
        assert np.isfinite(history.traction).all(), "traction is not finite"
        assert np.isfinite(history.velocity).all(), "velocity is not finite"
    laws = contact_laws(solution, 1e-9)
    assert all(m.passed for m in laws), laws
    if not solution.converged:
        said = solution.status
        assert "not converged" in said, said
        assert any(place in said for place in ("worst interface", "gains energy", "residual forces")), said
        assert said.rstrip(".").split(". ")[-1], said
        return "not converged"
    check_energy(solution, described)
    assert penetration_bound(solution) <= 1.0, f"penetration over its bound: {penetration_bound(solution):.3f}"
    return "converged"


def check_energy(solution: latin_fmu.Solution, described: dict[str, Any]) -> None:
    """The discrete balance closes to round-off, friction never gives energy.

    Round-off of the elastic energy grows with the square of the Courant number (u is a small part of dt^2 a).
    """
    energy = solution.energy
    assert energy is not None
    stored = energy["kinetic"] + energy["elastic"]
    scale = max(float(stored.max()), float(np.abs(energy["work_of_loads"]).max()))
    if scale == 0:
        return
    courant = 0.0
    for body in described["substructure"].values():
        stuff, box = described["material"][body["material"]], body["box"]
        shortest = min(s / n for s, n in zip(box["size"], box["elements"], strict=True))
        speed = np.sqrt(stuff["young_modulus"] / stuff["density"])
        courant = max(courant, float(solution.time[1]) * speed / shortest)
    allowed = (1e-9 + 1e-12 * courant**2) * scale
    assert float(np.abs(energy["balance"]).max()) <= allowed, "energy balance"
    assert float(np.diff(energy["friction_dissipation"]).min(initial=0.0)) >= -1e-9 * scale, "friction gives energy"
