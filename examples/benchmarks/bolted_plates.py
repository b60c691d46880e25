"""An assembly of 21 parts: five plates, eight bolts and eight washers of 10-node tetrahedra, no two meshes match.

    python examples/benchmarks/bolted_plates.py [SIZE ...] [--threads N] [--profile] [--instants N] [--former FOLDER]

Plates of 200 x 100 x 10 mm with eight holes lie on each other; every hole has a bolt M10 with head and nut, 20 kN, and
a washer below the head. Every plate has its own number of elements around and between the holes. Steel, friction 0.2.
The ends of the lowest plate are held; the run starts tight, in equilibrium, and a shock pulls the uppermost plate.
Element sizes come in SIZE, in mm (12: 51,000 unknowns). The deck is written by this program, without gmsh.

Each size runs in a process of its own, which prints the seconds of the processor of its steps (read, discretise, static
start, operators of the march, an instant of it), its peak memory, the iterations and the force of the joint.
``--former`` runs the same with the package of another folder in turn; ``--profile`` prints a profile of
the set-up.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PLATES, ACROSS, ALONG = 5, 2, 4  # plates; holes across and along a plate
PITCH, HIGH, HOLE, SHANK, HEAD, WASHER = 50.0, 10.0, 5.5, 5.0, 8.5, 10.0  # mm; the last four are radii
HEAD_HIGH, DISC = 6.0, 2.0  # mm
PULL, FRICTION, STEP = 20e3, 0.2, 1e-6  # N, -, s


@dataclass(frozen=True)
class Figure:
    """Triangles of a plane figure: nodes (n, 2), mm, triangles (m, 3), and the ring of each, 0 in the middle."""

    nodes: Array
    triangles: Index
    ring: Index

    def merged(self, others: list[Figure]) -> Figure:
        """This and others in one, common nodes once."""
        every = [self, *others]
        shift = np.cumsum([0, *(len(f.nodes) for f in every)])
        nodes = np.concatenate([f.nodes for f in every])
        _, first, number = np.unique(np.round(nodes, 6), axis=0, return_index=True, return_inverse=True)
        triangles = np.concatenate([number.ravel()[f.triangles + s] for f, s in zip(every, shift[:-1], strict=True)])
        return Figure(nodes[first], triangles, np.concatenate([f.ring for f in every]))


def rings(radii: list[Array], angles: Array, filled: bool = False) -> Figure:
    """Rings of triangles between closed rows of points at these ``radii`` (n_angle,) each, mm; ``filled``: with a
    point in the middle."""
    n = len(angles)
    nodes = np.concatenate([np.stack([r * np.cos(angles), r * np.sin(angles)], axis=1) for r in radii])
    here, there = np.arange(n), np.roll(np.arange(n), -1)
    triangles, ring = [], []
    for k in range(len(radii) - 1):
        low, up = k * n, (k + 1) * n
        a, b, c, d = low + here, low + there, up + there, up + here
        triangles += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
        ring += [np.full(2 * n, k + 1)]
    if filled:
        nodes = np.concatenate([nodes, np.zeros((1, 2))])
        triangles.append(np.stack([np.full(n, len(nodes) - 1), here, there], axis=1))
        ring.append(np.zeros(n, dtype=np.int64))
    return Figure(nodes, np.concatenate(triangles), np.concatenate(ring))


def plate(around: int, between: int) -> Figure:
    """Eight squares with a hole each; elements on an eighth of the hole, and from there to the square."""
    angles = np.arange(8 * around) * 2.0 * np.pi / (8 * around)
    outer = PITCH / 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    shares = np.linspace(0.0, 1.0, between + 1) ** 1.5
    square = rings([HOLE + s * (outer - HOLE) for s in shares], angles)
    places = [(PITCH * (i + 0.5), PITCH * (j + 0.5)) for i in range(ALONG) for j in range(ACROSS)]
    first, *others = [Figure(square.nodes + np.array(p), square.triangles, square.ring) for p in places]
    return first.merged(others)


def extruded(figure: Figure, levels: Array, there: NDArray[np.bool_] | None = None) -> tuple[Array, Index]:
    """Nodes (n, 3), mm, and 10-node tetrahedra of a figure over levels; ``there`` (n_layer, n_triangle), all where
    None. Each prism is three tetrahedra, cut so that neighbours fit."""
    n, layers = len(figure.nodes), len(levels) - 1
    corners = np.concatenate([np.column_stack([figure.nodes, np.full(n, z)]) for z in levels])
    a, b, c = np.sort(figure.triangles, axis=1).T
    cells = []
    for k in range(layers):
        own = slice(None) if there is None else there[k]
        low = k * n
        rows = (a, b, c, c + n), (a, b, b + n, c + n), (a, a + n, b + n, c + n)
        cells += [low + np.stack(four, axis=1)[own] for four in rows]
    tets = np.concatenate(cells)
    sides = corners[tets[:, 1:]] - corners[tets[:, :1]]
    turned = np.linalg.det(sides) < 0.0
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]
    ends = tets[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]]
    edges, number = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    nodes = np.concatenate([corners, corners[edges].mean(axis=1)])
    cells_10 = np.concatenate([tets, len(corners) + number.reshape(-1, 6)], axis=1)
    used, renumbered = np.unique(cells_10, return_inverse=True)
    return nodes[used], renumbered.reshape(-1, 10)


def count(length: float, size: float, least: int = 1) -> int:
    """Elements of about a size along a length."""
    return max(least, round(length / size))


def circle(number: int) -> Array:
    """Angles of points on a circle."""
    return np.arange(number) * 2.0 * np.pi / number


def parts(size: float) -> Iterator[tuple[str, Array, Index]]:
    """Name, nodes (n, 3), mm, and tetrahedra of every part, elements of about a size, mm."""
    for i in range(PLATES):
        own = size * (1.0 + 0.08 * (i % 3))
        figure = plate(count(PITCH / 8.0, 1.2 * own) + i % 2, 1 + count(PITCH / 2.0 - HOLE, 1.2 * own))
        yield f"plate{i + 1}", *extruded(figure, np.linspace(i * HIGH, (i + 1) * HIGH, count(HIGH, own) + 1))
    top, fine = PLATES * HIGH, 0.7 * size
    turn, more = count(2.0 * np.pi * SHANK, fine, 6), count(2.0 * np.pi * WASHER, fine, 8)
    disc = rings([np.full(turn, r) for r in (SHANK, HEAD)], circle(turn), filled=True)
    grip = np.linspace(0.0, top + DISC, count(top, size, 5) + 1)
    ends = np.linspace(0.0, HEAD_HIGH, count(HEAD_HIGH, size) + 1)[1:]
    levels = np.concatenate([-ends[::-1], grip, top + DISC + ends])
    there = np.ones((len(levels) - 1, len(disc.triangles)), dtype=bool)
    there[len(ends) : -len(ends)] = disc.ring < 1
    across = np.linspace(HOLE, WASHER, count(WASHER - HOLE, fine) + 1)
    ring = rings([np.full(more, r) for r in across], circle(more))
    for k in range(ALONG * ACROSS):
        place = np.array([PITCH * (k // ACROSS + 0.5), PITCH * (k % ACROSS + 0.5)])
        at = Figure(disc.nodes + place, disc.triangles, disc.ring)
        yield f"bolt{k + 1}", *extruded(at, levels, there)
        at = Figure(ring.nodes + place, ring.triangles, ring.ring)
        yield f"washer{k + 1}", *extruded(at, top + np.array([0.0, DISC]))


def write(path: Path, size: float) -> int:
    """Write the deck; its number of unknowns."""
    nodes_before = cells_before = 0
    with path.open("w", encoding="utf-8") as deck:
        for name, nodes, cells in parts(size):
            deck.write("*NODE\n")
            numbers = nodes_before + 1 + np.arange(len(nodes))
            deck.writelines(f"{i}, {x:.9g}, {y:.9g}, {z:.9g}\n" for i, (x, y, z) in zip(numbers, nodes, strict=True))
            deck.write(f"*ELEMENT, TYPE=C3D10, ELSET={name}\n")
            rows = np.column_stack([cells_before + 1 + np.arange(len(cells)), cells + nodes_before + 1])
            deck.writelines(", ".join(map(str, row)) + "\n" for row in rows.tolist())
            if name.startswith("plate"):
                for end, x in (("left", 0.0), ("right", ALONG * PITCH)):
                    deck.write(f"*NSET, NSET={name}_{end}\n")
                    deck.writelines(f"{i}\n" for i in numbers[np.abs(nodes[:, 0] - x) < 1e-6])
            nodes_before, cells_before = nodes_before + len(nodes), cells_before + len(cells)
    return 3 * nodes_before


def tables(deck: Path, instants: int, solver: dict[str, Any]) -> dict[str, Any]:
    """Scene of the assembly."""
    return {
        "name": "bolted_plates",
        "material": {"steel": {"young_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}},
        "mesh": {"assembly": {"file": str(deck), "scale": 1e-3, "parts": "*", "material": "steel"}},
        "contact": {"all": {"search": 0.05e-3, "friction_coefficient": FRICTION}},
        "boundary": {end: {"type": "fixed", "face": f"plate1.plate1_{end}"} for end in ("left", "right")},
        "bolt": {
            f"b{k}": {"substructure": f"bolt{k}", "axis": [0.0, 0.0, 1.0], "force": PULL}
            for k in range(1, ALONG * ACROSS + 1)
        },
        "load": {
            "shock": {
                "face": f"plate{PLATES}.plate{PLATES}_right",
                "traction": [20e6, 0.0, 0.0],
                "law": {"type": "half_sine", "duration": 50e-6},
            }
        },
        "time": {"end": instants * STEP, "step": STEP, "start": {"type": "static", "increments": 2}},
        "solver": solver,
        "accuracy": {"estimate": False},
        "output": {"fields": False},
    }


def measured(size: float, instants: int, solver: dict[str, Any], profile: bool) -> dict[str, float]:
    """Seconds of the processor of every step, peak memory, bytes, and numbers of the run, in this process."""
    import latin_fmu
    from latin_fmu.building import discretise, started
    from latin_fmu.latin.outcome import Timings
    from latin_fmu.march import march

    found: dict[str, float] = {}
    clocks = [time.process_time()]

    def step(name: str) -> None:
        clocks.append(time.process_time())
        found[name] = clocks[-1] - clocks[-2]

    with TemporaryDirectory() as folder:
        deck = Path(folder) / "assembly.inp"
        found["unknowns"] = float(write(deck, size))
        clocks[-1] = time.process_time()
        wall = time.perf_counter()
        profiler = cProfile.Profile()
        if profile:
            profiler.enable()
        scene = latin_fmu.scene_from_dict(tables(deck, instants, solver))
        step("read")
        ready = discretise(scene)
        step("discretise")
        ready, start = started(ready, {})
        step("static start")
        problem = ready.build(start)
        step("operators")
        found["wall"] = time.perf_counter() - wall
        profiler.disable()
    found["peak set-up"] = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    outcome = march(problem, timings=Timings()).outcome
    found["set-up of the run"] = outcome.timings.setup
    found["instant"] = outcome.timings.march / instants
    found["peak"] = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found["iterations"] = float(np.mean([w.iterations for w in outcome.windows]))
    found["converged"] = float(outcome.converged)
    history = next(h for n, h in outcome.interfaces.items() if {"plate1", "plate2"} == set(n.split("_")))
    found["force"] = float(np.linalg.norm(history.force()[-1]))
    if profile:
        print(start.message if start is not None else "", file=sys.stderr)
        stats = pstats.Stats(profiler, stream=sys.stderr)
        stats.sort_stats("cumulative").print_stats(60)
        stats.sort_stats("tottime").print_stats(40)
    return found


def in_a_process(size: float, options: argparse.Namespace, package: str) -> dict[str, float]:
    """The same in a process of its own, on one thread but for ``--threads``, with the package of a folder."""
    one = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS")}
    path = {"PYTHONPATH": package} if package else {}
    command = [sys.executable, __file__, str(size), "--here", "--instants", str(options.instants)]
    command += ["--threads", str(options.threads), *(["--profile"] if options.profile else [])]
    done = subprocess.run(command, env={**os.environ, **one, **path}, stdout=subprocess.PIPE, text=True, check=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Print a line for each size and package."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", nargs="*", type=float, default=[10.0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--instants", type=int, default=20)
    parser.add_argument("--former", default="")
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        print(json.dumps(measured(options.sizes[0], options.instants, {"threads": options.threads}, options.profile)))
        return
    for size in options.sizes:
        for package in ([options.former] if options.former else []) + [""]:
            found = in_a_process(size, options, package)
            print("   ".join(f"{name} {value:.4g}" for name, value in found.items()), flush=True)


if __name__ == "__main__":
    main()
