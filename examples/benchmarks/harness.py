"""What the benchmarks share: problems as scenes, CPU times in turn on one thread, distances of force histories.

Boxes stacked along z, regular 8-node hexahedra, matching nodes; quarter symmetry (u_x = 0 at x = 0, u_y = 0 at y = 0);
the lowest face cannot move along z; pressure on the top face; at rest at t = 0.

P1  two bars of 10 x 10 x 100 mm with a gap of 10 um, no friction, a step of pressure: shocks at a slender contact.
P2  a steel block crushed on an aluminium one by a half-sine pulse, friction between them.
P3  the same with 2 to 16 blocks, aluminium and steel in turn: many contact surfaces.

Timed runs begin with matrices in memory and compiled kernels, factorise, and end with the interface histories.
"""

from __future__ import annotations

import gc
import sys
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import latin_fmu
from latin_fmu.assembly.problem import DiscretisedProblem, SolverReadyProblem
from latin_fmu.building import discretise
from latin_fmu.latin.outcome import Outcome
from latin_fmu.march import march
from latin_fmu.stability.scenes import ALUMINIUM, STEEL, Box, Description, Material, column, half_sine

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # of all benchmarks
import example_tools as tools

BAR = Material(210e9, 7800.0, 0.0, "bar")
EDGE, LENGTH = 0.01, 0.1  # m
PRESSURE, GAP = 100e6, 1e-5  # of P1
OWN: dict[str, Any] = {"propagator": "direct", "share_identical": False}
TIGHT = {"tolerance": 1e-6, "force_tolerance": 1e-5}


# -- problems ---------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Case:
    """One problem: ``case`` names it in tables, ``description`` is its scene.

    ``published`` is the linear transient of the same problem as published with it, s, assembly included: SciPy's
    SuperLU or CHOLMOD on the author's machine; None where none is.
    """

    case: str
    n_blocks: int
    mu: float
    description: Description
    published: float | None = None


def bars(elements: Sequence[int], published: float | None) -> Case:
    """P1. Poisson's ratio is 0 on the coarse mesh and 0.3 where the section is resolved."""
    rod = Box(BAR if elements[0] == 1 else STEEL, (EDGE, EDGE, LENGTH), elements)
    load = {"pressure": PRESSURE, "law": {"type": "step"}}
    return Case("P1 " + "x".join(map(str, elements)), 2, 0.0, _stack([rod] * 2, GAP, 0.0, load, 250, 0.4e-6), published)


def crushing(n: int, mu: float, published: float | None = None) -> Case:
    """P2 with n^3 elements in each block."""
    blocks = [Box(material, (EDGE,) * 3, (n,) * 3) for material in (ALUMINIUM, STEEL)]
    return Case(f"P2 n={n}", 2, mu, _stack(blocks, 0.0, mu, _pulse(), 200, 0.15e-6), published)


def tower(blocks: int, n: int, published: float | None = None) -> Case:
    """P3: ``blocks`` blocks of n^3 elements."""
    bodies = [Box(STEEL if i % 2 else ALUMINIUM, (EDGE,) * 3, (n,) * 3) for i in range(blocks)]
    return Case(f"P3 n={n}", blocks, 0.3, _stack(bodies, 0.0, 0.3, _pulse(), 200, 0.2e-6), published)


def plates(count: int, elements: Sequence[int] = (8, 8, 2)) -> Case:
    """Stack of steel plates, pressed and then sheared without inertia (``example_tools.pressed_plates``)."""
    return Case(f"plates {'x'.join(map(str, elements))}", count, 0.3, tools.pressed_plates(count, elements))


def quick_cases() -> list[Case]:
    """A first look, under a minute."""
    return [
        bars((1, 1, 50), 0.033),
        *(crushing(4, mu, 0.037) for mu in (0.1, 10.0)),
        tower(2, 4, 0.033),
        tower(16, 4, 0.206),
    ]


def all_cases(finest: bool = False) -> list[Case]:
    """Every problem; ``finest`` adds P2 with 20^3 elements in a block."""
    coefficients = (0.0, 0.1, 0.3, 10.0)
    cases = [bars((1, 1, 50), 0.033), bars((4, 4, 100), 1.14)]
    for n, published in ((4, 0.037), (10, 0.85), *(((20, None),) if finest else ())):
        cases += [crushing(n, mu, published) for mu in coefficients]
    for n, seconds in ((4, (0.033, 0.050, 0.115, 0.206)), (6, (None, None, None, 1.41))):
        cases += [tower(blocks, n, s) for blocks, s in zip((2, 4, 8, 16), seconds, strict=True)]
    return cases


def _pulse() -> Description:
    return {"pressure": 200e6, "law": half_sine(10e-6)}


def _stack(bodies: Sequence[Box], gap: float, mu: float, load: Description, steps: int, step: float) -> Description:
    """Blocks b1, b2, ... from the bottom to the top, interfaces i1, i2, ..., the load ``press`` on the top."""
    blocks = {f"b{i}": body for i, body in enumerate(bodies, 1)}
    contact = {"behaviour": "contact", "friction_coefficient": mu, "gap": gap}
    boundary = {"base": {"type": "symmetry", "face": "b1.zmin"}}
    boundary |= {f"{b}_{axis}": {"type": "symmetry", "face": f"{b}.{axis}min"} for b in blocks for axis in "xy"}
    return column(
        blocks,
        {f"i{i}": dict(contact) for i in range(1, len(blocks))},
        {"end": steps * step, "instants": steps},
        gap,
        name="stack",
        boundary=boundary,
        load={"press": {"face": f"b{len(blocks)}.zmax", **load}},
    )


# -- runs -------------------------------------------------------------------------------------------------------------
def prepared(case: Case, solver: dict[str, Any]) -> DiscretisedProblem:
    """Matrices of a case with these settings of the iteration."""
    return discretise(latin_fmu.scene_from_dict({**case.description, "solver": solver}))


def stable(case: Case, solver: dict[str, Any]) -> DiscretisedProblem:
    """The same with as many more instants as an explicit propagator needs."""
    steps = case.description["time"]["instants"]
    for more in (1.0, 1.04, 1.1, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0):
        time = case.description["time"] | {"instants": int(np.ceil(more * steps))}
        ready = prepared(replace(case, description=case.description | {"time": time}), solver)
        with suppress(latin_fmu.SceneError):
            ready.build()
            return ready
    raise ValueError(f"{case.case}: not stable with {6 * steps} steps")


def contact_run(ready: DiscretisedProblem) -> Outcome:
    """Factorise, march, contact included, to the interface histories."""
    return march(ready.build()).outcome


def second_run(
    ready: DiscretisedProblem, built: SolverReadyProblem, given: Mapping[str, np.ndarray] | None = None
) -> Outcome:
    """Another run with what was set up for the first; ``given`` amplitudes (n_time,) of loads by name."""
    for propagator in built.assembly.propagators:
        propagator.restart()
    built.timeline.begin(built.assembly, ready.time, given or {}, built.assembly.ground.start)
    return march(built).outcome


def cpu(work: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    gc.collect()
    start = clock.process_time()
    work()
    return clock.process_time() - start


def in_turn(works: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median CPU seconds of each, called in turn in every round, on one thread."""
    found: dict[str, list[float]] = {name: [] for name in works}
    with threadpool_limits(1):
        for _ in range(rounds):
            for name, work in works.items():
                found[name].append(cpu(work))
    return {name: median(values) for name, values in found.items()}


def rounds_for(seconds: float) -> int:
    """How often to repeat something that takes this long."""
    return 9 if seconds < 0.3 else 5 if seconds < 3.0 else 3


def force_error(found: Outcome, reference: Outcome) -> float:
    """Relative L2 distance of the force histories of all interfaces, at the instants of the reference."""
    there = np.concatenate([h.force().T for h in reference.interfaces.values()])
    forces = np.concatenate([found.interfaces[n].force().T for n in reference.interfaces])
    here = np.stack([np.interp(reference.time, found.time, row) for row in forces])
    return float(np.linalg.norm(here - there) / np.linalg.norm(there))


# -- exact ------------------------------------------------------------------------------------------------------------
def bars_exact(time: tools.Array, cells: int = 2000) -> dict[str, tools.Array]:
    """Contact pressure, Pa, and displacement of the top face, m, of P1 at the instants ``time``, by characteristics.

    In each bar s + Z v travels down and s - Z v travels up unchanged (s stress, v velocity along z, Z = rho c). On a
    grid where a wave crosses one cell a step the travelling waves are shifted: nothing is approximated inside the bars.
    """
    impedance = BAR.impedance
    step = LENGTH / cells / BAR.speed
    steps = int(np.ceil(time[-1] / step)) + 1
    # travelling waves as rings: a wave that enters at step i leaves at step i + cells
    up, down = np.zeros((2, cells)), np.zeros((2, cells))
    gap, pressure, top = GAP, np.zeros(steps), np.zeros(steps)
    for i in range(steps):
        k = i % cells
        at_contact, at_wall = up[0, k], down[0, k]
        at_top, from_above = up[1, k], down[1, k]
        opening = (from_above + at_contact) / impedance  # speed without contact
        if gap + step * opening <= 0.0:
            pressure[i] = max(0.0, -0.5 * (from_above + at_contact) - 0.5 * impedance * gap / step)
        p = pressure[i]
        gap += step * (opening + 2.0 * p / impedance)
        top[i] = (-PRESSURE - at_top) / impedance  # s = -PRESSURE there
        up[0, k], down[0, k] = at_wall, -2.0 * p - at_contact  # the wall does not move
        up[1, k], down[1, k] = -2.0 * p - from_above, -2.0 * PRESSURE - at_top
    at = step * np.arange(steps)
    moved = np.concatenate([[0.0], np.cumsum(0.5 * step * (top[1:] + top[:-1]))])
    return {"contact force": np.interp(time, at, pressure), "top displacement": np.interp(time, at, moved)}
