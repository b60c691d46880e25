"""Random scenes of solid bodies with references from refined runs: the error estimate tested in three dimensions.

    python -m tests.verification.solid_strangers --seeds 0:44 --half odd

prints the table of ``strangers``. A seed takes one of eleven families in turn and draws its sizes, materials, friction,
loads and speeds. The reference of a scene is its run on a mesh and with steps ``FINEST`` times as fine; how far a run
``FINER`` times as fine is from it, extrapolated with the order of the quantity, is its own error. A quantity counts
where that is less than a third of the estimated error or of the distance between run and reference, else left out and
counted; a smaller distance counts as that error. The even seeds may set factors, the odd ones test them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.accuracy.estimate import estimate_error, observed_order
from latin_fmu.accuracy.runs import Resolution, aligned, in_short_windows, mesh_factor, mesh_files, run_at
from latin_fmu.errors import LatinError
from latin_fmu.fem.mesh import box_mesh
from latin_fmu.run_quantities import Quantities, measure_solution
from latin_fmu.scene.quantity_table import FLOOR, definition_of
from latin_fmu.stability.scenes import Box, Description, Material, bolted_stack, column, half_sine, placed, rubbing
from latin_fmu.stability.surfaces import write_mesh
from tests.fem.meshes import cut
from tests.scenes import ramp

from .strangers import Case, Promise, chosen_seeds, promises_table, run_with_spectra, searched, table

FINER, FINEST = 2.0, 3.0
TARGETS = {
    "impulse": 0.05,
    "displacement": 0.05,
    "separation": 0.1,
    "peak_force": 0.1,
    "friction_work": 0.2,
    "acceleration_peak": 0.2,
}
Random = np.random.Generator


def crush(rng: Random, folder: Path) -> Description:
    """Two unlike blocks crushed by a half sine, quarter symmetry, friction."""
    del folder
    first, second, edge = metal(rng, "first"), metal(rng, "second"), rng.uniform(0.006, 0.015)
    time = edge / min(first.speed, second.speed)
    n = int(rng.integers(4, 6))
    return column(
        {
            "low": Box(first, (edge,) * 3, (n,) * 3),
            "up": Box(second, (edge, edge, edge * rng.uniform(0.7, 1.4)), (n,) * 3),
        },
        {"meet": {"friction_coefficient": rng.uniform(0.05, 0.4)}},
        timed(6 * time, first, edge / n, rng),
        load={"press": {"face": "up.zmax", "pressure": 1e8, "law": half_sine(time * rng.uniform(2.0, 5.0))}},
        boundary={"base": {"type": "symmetry", "face": "low.zmin"}} | symmetry("low", "up"),
        sensor={"top": {"face": "up.zmax", "spectrum": {}}},
    )


def oblique_blocks(rng: Random, folder: Path) -> Description:
    """A block thrown at another one at an angle, with friction."""
    del folder
    first, second, edge = metal(rng, "first"), metal(rng, "second"), 0.01
    n, angle, speed = 4, rng.uniform(0.2, 0.9), rng.uniform(2.0, 20.0)
    up = Box(second, (edge,) * 3, (n,) * 3, (speed * np.sin(angle), 0.0, -speed * np.cos(angle)))
    return column(
        {"low": Box(first, (edge,) * 3, (n,) * 3), "up": up},
        {"meet": {"friction_coefficient": rng.uniform(0.1, 0.5)}},
        timed(5 * edge / min(first.speed, second.speed), first, edge / n, rng),
        gap=speed * 1e-7 * rng.uniform(0.0, 5.0),
        boundary={"base": {"type": "fixed", "face": "low.zmin"}},
        sensor={"tail": {"face": "up.zmax", "spectrum": {}}},
    )


def hammer_on_plate(rng: Random, folder: Path) -> Description:
    """A rod falls on the middle of a plate held at two edges; meshes that do not match."""
    del folder
    steel, other, side = metal(rng, "steel"), metal(rng, "other"), rng.uniform(0.03, 0.05)
    thick, tool = side * rng.uniform(0.1, 0.2), side * 0.25
    plate = Box(other, (side, side, thick), (10, 10, 2), keys={"bending_modes": True})
    rod = Box(steel, (tool, tool, 2 * tool), (3, 3, 6), (0.0, 0.0, -rng.uniform(1.0, 5.0)))
    at = 0.5 * (side - tool)
    return placed(
        {"plate": (plate, (0.0, 0.0, 0.0)), "rod": (rod, (at, at, thick + 1e-6))},
        timed(12 * tool / steel.speed, steel, tool / 3, rng),
        name="hammer",
        interface={"blow": rubbing("plate.zmax", "rod.zmin", rng.uniform(0.0, 0.3))},
        boundary={f"{e}": {"type": "fixed", "face": f"plate.{e}"} for e in ("xmin", "xmax")},
        sensor={"edge": {"substructure": "plate", "point": [0.5 * side, 0.1 * side, thick], "spectrum": {}}},
    )


def soft_layer(rng: Random, folder: Path) -> Description:
    """A soft layer between two hard blocks under a triangular pulse."""
    del folder
    hard = metal(rng, "hard")
    soft = Material(hard.young * rng.uniform(0.02, 0.1), hard.density * rng.uniform(0.2, 0.5), 0.35, "soft")
    edge, layer, n = 0.01, 0.01 * rng.uniform(0.2, 0.4), 4
    block = Box(hard, (edge,) * 3, (n,) * 3)
    time = layer / soft.speed
    return column(
        {"low": block, "layer": Box(soft, (edge, edge, layer), (n, n, 3)), "up": block},
        {"lower": {"friction_coefficient": rng.uniform(0.1, 0.5)}, "upper": {"behaviour": "perfect"}},
        timed(6 * time, soft, layer / 3, rng, 0.5),
        load={"press": {"face": "up.zmax", "pressure": 2e7, "law": ramp((0, 0), (0.6 * time, 1), (2.4 * time, 0))}},
        boundary={"base": {"type": "symmetry", "face": "low.zmin"}} | symmetry("low", "layer", "up"),
        sensor={"top": {"face": "up.zmax", "spectrum": {}}},
    )


def shaken_lap(rng: Random, folder: Path) -> Description:
    """A bolted stack sheared by a shock until its plates slip."""
    del folder
    steel, force = metal(rng, "steel"), rng.uniform(2e3, 5e3)
    friction = rng.uniform(0.1, 0.3)
    push = {"face": "upper.ymin", "force": [0.0, force * rng.uniform(1.0, 2.0), 0.0], "law": half_sine(40e-6)}
    time, sensor = {"end": 60e-6, "instants": 60}, {"cover": {"face": "cover.zmax", "spectrum": {}}}
    return bolted_stack(steel, force, friction, time, load={"shear": push}, sensor=sensor)


def bending_impact(rng: Random, folder: Path) -> Description:
    """A small block hits the free end of a cantilever."""
    del folder
    first, second, length = metal(rng, "first"), metal(rng, "second"), rng.uniform(0.03, 0.06)
    depth = length * rng.uniform(0.1, 0.2)
    beam = Box(first, (length, depth, depth), (14, 3, 3), keys={"bending_modes": True})
    block = Box(second, (depth,) * 3, (3, 3, 3), (0.0, 0.0, -rng.uniform(1.0, 5.0)))
    return placed(
        {"beam": (beam, (0.0, 0.0, 0.0)), "block": (block, (length - depth, 0.0, depth + 1e-6))},
        timed(20 * depth / first.speed, first, depth / 3, rng),
        name="cantilever",
        interface={"blow": rubbing("beam.zmax", "block.zmin", rng.uniform(0.0, 0.3))},
        boundary={"clamp": {"type": "fixed", "face": "beam.xmin"}},
        sensor={"tip": {"substructure": "beam", "point": [length, 0.5 * depth, 0.0], "spectrum": {}}},
    )


def cradle(rng: Random, folder: Path) -> Description:
    """A row of blocks that touch, hit by another one."""
    del folder
    steel, n = metal(rng, "steel"), int(rng.integers(2, 4))
    box = Box(steel, (0.01, 0.01, 0.015), (3, 3, 5))
    thrown = Box(steel, (0.01, 0.01, 0.015), (3, 3, 5), (0.0, 0.0, rng.uniform(1.0, 5.0)))
    bodies = {"striker": thrown, **{f"b{i}": box for i in range(n)}}
    scene = column(
        bodies,
        {f"i{i}": {"friction_coefficient": 0.1} for i in range(n)},
        timed((2.5 + n) * 0.015 / steel.speed * 1.5, steel, 0.003, rng),
        sensor={"last": {"face": f"b{n - 1}.zmax", "spectrum": {}}},
        boundary=symmetry(*bodies),
    )
    scene["substructure"]["striker"]["box"]["origin"][2] = -1e-7
    scene["interface"]["i0"]["gap"] = 1e-7
    return scene


def tetrahedra(rng: Random, folder: Path) -> Description:
    """Two blocks of tetrahedra, from files that are refined once, pressed by a pulse."""
    first, second, edge = metal(rng, "first"), metal(rng, "second"), 0.01
    for name, z in (("low", 0.0), ("up", edge)):
        box = box_mesh(np.array([0.0, 0.0, z]), np.full(3, edge), (2, 2, 2))
        write_mesh(folder / f"{name}.msh", cut(box, "tetra"))
    bodies = {
        name: {"material": name, "mesh": {"file": str(folder / f"{name}.msh"), "refine": 1}} for name in ("low", "up")
    }
    time = edge / min(first.speed, second.speed)
    return {
        "name": "tetrahedra",
        "material": {"low": first.table(), "up": second.table()},
        "substructure": bodies,
        "interface": {"meet": rubbing("low.zmax", "up.zmin", rng.uniform(0.1, 0.4))},
        "boundary": {"base": {"type": "fixed", "face": "low.zmin"}},
        "load": {"press": {"face": "up.zmax", "pressure": 1e8, "law": half_sine(time * rng.uniform(2.0, 4.0))}},
        "time": timed(5 * time, first, edge / 4, rng),
        "sensor": {"top": {"face": "up.zmax"}},
    }


def non_matching(rng: Random, folder: Path) -> Description:
    """Blocks whose meshes do not match, the upper one smaller, pressed by a pulse."""
    del folder
    first, second, edge = metal(rng, "first"), metal(rng, "second"), 0.01
    share = rng.uniform(0.4, 0.8)
    time = edge / min(first.speed, second.speed)
    return placed(
        {
            "low": (Box(first, (edge,) * 3, (5, 5, 4)), (0.0, 0.0, 0.0)),
            "up": (Box(second, (share * edge, share * edge, edge), (3, 3, 4)), (0.0, 0.0, edge)),
        },
        timed(6 * time, first, edge / 4, rng),
        name="unlike",
        interface={"meet": rubbing("low.zmax", "up.zmin", rng.uniform(0.05, 0.4))},
        boundary={"base": {"type": "fixed", "face": "low.zmin"}} | symmetry("up"),
        load={"press": {"face": "up.zmax", "pressure": 1e8, "law": half_sine(time * rng.uniform(2.0, 5.0))}},
        sensor={"top": {"face": "up.zmax", "spectrum": {}}},
    )


def statics(rng: Random, folder: Path) -> Description:
    """Blocks pressed and then sheared without inertia, until a part of the face slips."""
    del folder
    first, second, edge = metal(rng, "first"), metal(rng, "second"), 0.01
    n, friction = 4, rng.uniform(0.2, 0.5)
    return column(
        {"low": Box(first, (edge,) * 3, (n,) * 3), "up": Box(second, (edge, edge, 0.5 * edge), (n, n, 2))},
        {"meet": {"friction_coefficient": friction}},
        {"end": 1.0, "instants": 20, "quasi_static": True},
        boundary={"base": {"type": "fixed", "face": "low.zmin"}},
        load={
            "press": {"face": "up.zmax", "pressure": 5e7, "law": ramp((0, 0), (0.5, 1), (1, 1))},
            "shear": {
                "face": "up.zmax",
                "traction": [5e7 * friction * rng.uniform(0.3, 0.8), 0.0, 0.0],
                "law": ramp((0, 0), (0.5, 0), (1, 1)),
            },
        },
        sensor={"top": {"face": "up.zmax"}},
    )


def preload_then_shock(rng: Random, folder: Path) -> Description:
    """A stack at rest under a dead pressure, then a shock on its side."""
    del folder
    steel, edge, n = metal(rng, "steel"), 0.01, 4
    time = edge / steel.speed
    return column(
        dict.fromkeys(("b0", "b1"), Box(steel, (edge,) * 3, (n,) * 3)),
        {"meet": {"friction_coefficient": rng.uniform(0.2, 0.5)}},
        timed(6 * time, steel, edge / n, rng) | {"start": "static"},
        boundary={"base": {"type": "fixed", "face": "b0.zmin"}},
        load={
            "press": {"face": "b1.zmax", "pressure": 5e7},
            "shock": {
                "face": "b1.xmin",
                "pressure": rng.uniform(2e7, 6e7),
                "law": half_sine(time * rng.uniform(1.5, 4.0)),
            },
        },
        sensor={"side": {"face": "b1.xmax", "spectrum": {}}},
    )


FAMILIES: tuple[Callable[[Random, Path], Description], ...] = (
    crush,
    oblique_blocks,
    hammer_on_plate,
    soft_layer,
    shaken_lap,
    bending_impact,
    cradle,
    tetrahedra,
    non_matching,
    statics,
    preload_then_shock,
)


def solid(seed: int, folder: Path) -> latin_fmu.Scene:
    """The scene of a seed; mesh files go to a folder. Neighbouring seeds, an even and an odd one, are of one family."""
    family = FAMILIES[seed // 2 % len(FAMILIES)]
    tables = family(np.random.default_rng([733, seed]), folder)
    return latin_fmu.scene_from_dict(tables | {"name": f"{family.__name__}_{seed}"})


def metal(rng: Random, name: str) -> Material:
    """A material between light alloy and steel."""
    return Material(np.exp(rng.uniform(np.log(50e9), np.log(250e9))), rng.uniform(2500.0, 8500.0), 0.3, name)


def timed(end: float, material: Material, edge: float, rng: Random, courant: float = 0.0) -> dict[str, Any]:
    """Table of the time with steps of a Courant number between 0.5 and 1.2 (or the one given)."""
    step = edge / material.pressure_speed * (courant or rng.uniform(0.5, 1.2))
    return {"end": float(end), "instants": int(np.ceil(end / step))}


def symmetry(*bodies: str) -> Description:
    """Planes of symmetry x = 0 and y = 0 of bodies."""
    return {f"{b}_{axis}": {"type": "symmetry", "face": f"{b}.{axis}min"} for b in bodies for axis in "xy"}


def reference(scene: latin_fmu.Scene, scheme: str) -> tuple[Quantities, Quantities, float, float] | None:
    """Quantities of the finest and the second finest run, the ratio of their resolutions, and that of the second finest
    to the scene; None where one fails."""
    lean, made, factors = in_short_windows(scene, scheme), [], []
    for wanted in (FINEST, FINER):
        factor = mesh_factor(scene, wanted) if not mesh_files(scene) else (2.0 if wanted == FINEST else 1.0)
        try:
            run = run_at(lean, Resolution(factor, aligned(scene, factor)))
        except LatinError:
            return None
        if not run.converged:
            return None
        made.append(run.quantities)
        factors.append(factor)
    return made[0], made[1], factors[0] / factors[1], factors[1]


def judged(seeds: Iterable[int]) -> Iterator[Case]:
    """Cases of the scenes of seeds, with what is left out on standard error."""
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            yield from _judged(solid(seed, Path(folder)))


def promised(seeds: Iterable[int], limit: float) -> Iterator[Promise]:
    """The searches for ``TARGETS`` on the scenes of seeds, with at most ``limit`` CPU seconds each, of the quantities
    whose reference is within a fifth of the target."""
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            scene = solid(seed, Path(folder))
            if (judge := _Judge.of(scene)) is None:
                continue
            keys = {q: q.rpartition(".")[2] for q in judge.known}
            sure = [q for q, key in keys.items() if key in TARGETS and judge.unsure(q) <= 0.2 * TARGETS[key]]
            yield from searched(scene, judge.finest, sure, TARGETS, limit)


@dataclass(frozen=True)
class _Judge:
    """A run, how long it took (s), and the two finer ones of ``reference``."""

    solution: latin_fmu.Solution
    cpu: float
    measured: Quantities
    finest: Quantities
    finer: Quantities
    ratio: float
    factor: float

    @classmethod
    def of(cls, scene: latin_fmu.Scene) -> _Judge | None:
        """None where a run does not converge, which is written on standard error."""
        solution, cpu = run_with_spectra(scene)
        scheme = str(solution.outcome.settings.get("time scheme"))
        if not solution.trustworthy or (finer := reference(scene, scheme)) is None:
            sys.stderr.write(f"{scene.name}: {solution.status}; or its reference does not converge\n")
            return None
        return cls(solution, cpu, measure_solution(scene, solution), *finer)

    @property
    def known(self) -> list[str]:
        """Quantities that all runs have."""
        mine, others = self.measured.values, (self.finest, self.finer)
        return [q for q in mine if all(q in o.values for o in others) and self.finest.scales[q] > 0.0]

    def unsure(self, quantity: str) -> float:
        """Relative error of the reference."""
        between, order = self.finer.error(quantity, self.finest), definition_of(quantity).order
        apart = self.measured.error(quantity, self.finer)
        seen = observed_order(between, apart, (self.ratio, self.ratio * self.factor))
        # the expected order where none is seen
        return float(between / (self.ratio ** min(max(order, seen), 2.0 * order) - 1.0))


def _judged(scene: latin_fmu.Scene) -> Iterator[Case]:
    if (judge := _Judge.of(scene)) is None:
        return
    estimate, left = estimate_error(scene, judge.solution), []
    for own in estimate.quantities:
        quantity = own.quantity
        if quantity not in judge.known:
            continue
        apart, unsure = judge.measured.error(quantity, judge.finest), judge.unsure(quantity)
        told = max(own.error, FLOOR)
        if 3.0 * unsure > max(told if np.isfinite(told) else 0.0, apart) and unsure > FLOOR:
            left.append(quantity)
            continue
        # a distance that the reference is too coarse for counts as the error of the reference
        true = max(apart, unsure, FLOOR)
        yield Case(scene.name, quantity, true, told, own.bound_only, estimate.cpu / judge.cpu)
    sys.stderr.write(f"{scene.name}: {len(left)} left out ({', '.join(left)})\n")


def main() -> None:
    """Print the table of a range of seeds."""
    given, seeds = chosen_seeds(argparse.ArgumentParser(description=main.__doc__), "0:44")
    if given.promises:
        print(promises_table(list(promised(seeds, given.limit)), TARGETS))  # noqa: T201
    else:
        print(table(list(judged(seeds)), given.worst))  # noqa: T201


if __name__ == "__main__":
    main()
